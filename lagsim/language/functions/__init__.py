"""The functions and operators of the expression language, one table row each.

A row gives all that is known of a function (see `Function`): value, derivative, native
code, series, enclosure, and its twins in sympy, Python and LaTeX, so that they cannot
drift apart. Values never raise: outside their domain they are what IEEE 754 says (nan,
inf), as in native code. A new function is a new row.
"""

from __future__ import annotations

from lagsim.language.functions.branched import CORNERS, JUMPS
from lagsim.language.functions.operators import CONDITIONS, NUMBERS
from lagsim.language.functions.smooth import HYPERBOLIC, POWERS, TRIGONOMETRIC

_ROWS = (
    *NUMBERS, *CONDITIONS, *TRIGONOMETRIC, *HYPERBOLIC, *POWERS, *CORNERS, *JUMPS,
)  # fmt: skip
OPERATIONS = {row.name: row for row in _ROWS}
FUNCTIONS = {name: row for name, row in OPERATIONS.items() if not row.sign}
# Operators that join conditions, and are words.
JOINING = tuple(name for name, row in OPERATIONS.items() if row.sign.strip() == name)
# What selects among its arguments.
CHOOSING = frozenset(name for name, row in OPERATIONS.items() if row.branches)
# What is flat but for its jumps.
STEPS = frozenset(name for name, row in OPERATIONS.items() if row.step)
