"""Functions of the model language that sympy has not, or would rewrite.

Of min(x, y), sympy's own turns what a person wrote into something else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import sympy as sp

from lagsim.language.functions import FUNCTIONS

if TYPE_CHECKING:
    from lagsim.language.functions.row import Function


class Spelled(sp.Function):  # type: ignore[misc]
    """A real function; `row` is its row in the table."""

    row: ClassVar[Function]

    @property
    def spelled(self) -> str:
        """Its name in the model language."""
        return self.row.name

    def _eval_is_extended_real(self) -> bool:
        return True


def _class_name(row: Function) -> str:
    """Give a name that sympy has not; its simplifiers go by them, and its order."""
    name = row.name.capitalize()
    if row.step:
        return f"{name}Step"
    return f"{name}Branch" if row.branches else f"Real{name}"


TWINS: dict[str, type[Spelled]] = {
    name: type(_class_name(row), (Spelled,), {"row": row})
    for name, row in FUNCTIONS.items()
    if row.spelled
}
