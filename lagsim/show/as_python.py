"""The equations as a Python module that needs numpy only, straight from the graph.

Each function is straight-line code in which shared parts are computed once. The
branches of `if` are all computed and one is taken; values of the others that are not
finite raise no warning.
"""

from __future__ import annotations

import inspect
import keyword
import re
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language import tables
from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, DATA, TRUTH, VARIABLE
from lagsim.mechanics.constraints import constraint_row
from lagsim.show import in_words

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations


_OWN = (
    "np", "t", "q", "q_dot", "out", "COORDINATES", "CONSTRAINTS", "ONE_SIDED",
    "CONDITIONS", "PARAMETERS", "STATES", "DATA",
)  # fmt: skip
# An expression of more operations than this gets a name, for people.
LONGEST = 6
_TAKEN = frozenset((*keyword.kwlist, *_OWN))
_HEAD = '''"""Equations of motion of {name}, written by lagsim {version}.

M q'' = f + A^T lambda,  A q'' = b,  Qc = A^T lambda.

Functions take the time t, the coordinates q and the velocities q_dot, in the order of
COORDINATES. PARAMETERS are read at each call. Rows of constraints in ONE_SIDED hold
only while the contact is closed. Constraints in CONDITIONS hold only at times, under
conditions on g (or a rate), its rate g' (or that rate itself) and lambda.
"""

import numpy as np

COORDINATES = {coordinates}
CONSTRAINTS = {constraints}
ONE_SIDED = {one_sided}
CONDITIONS = {conditions}
PARAMETERS = {parameters}
'''
_STATES = """
# First-order states: all functions take their values s, in this order, after q_dot.
STATES = {}
"""

_TABLES = """
{numbers}
# Of tables: knots, and coefficients.
DATA = (
{rows})


{functions}"""


def as_python(equations: Equations, version: str) -> str:
    """Return the text of the Python module of `derive --format python`.

    It is described in docs/derive.md.

    version : the version of lagsim, for the head of the module.
    """
    e, g = equations, equations.graph
    model = e.model
    flow = e.flow
    rows = [constraint_row(g, c.name, c.relation.node, flow) for c in model.constraints]
    states, first = [x.rate for x in e.states], [x.name for x in e.states]
    head = _HEAD.format(
        name=model.name.replace("\\", "/").replace('"', "'"),
        version=version,
        coordinates=_tuple(e.q),
        constraints=_tuple([c.name for c in model.constraints]),
        one_sided=_tuple([c.name for c in model.constraints if c.law is not None]),
        conditions=_dictionary(
            {c.name: in_words(c) for c in model.constraints if not c.always}
        ),
        parameters=_dictionary({p.name: p.value for p in model.parameters}),
    )
    head += _STATES.format(_tuple(first)) if first else ""
    if model.tables:
        head = head.replace(
            "import numpy as np\n", "from math import floor\n\nimport numpy as np\n", 1
        )
        head += _tables(g)
    n, m = len(e.q), len(rows)
    functions = [
        _function(e, "mass_matrix", "M", [x for row in e.M for x in row], (n, n)),
        _function(e, "force", "f", list(e.f), (n,)),
        _function(e, "constraint_matrix", "A", [x for r in rows for x in r.A], (m, n)),
        _function(e, "constraint_rhs", "b", [r.b for r in rows], (m,)),
    ]
    if states:
        functions.append(_function(e, "state_rates", "s'", states, (len(states),)))
    return "\n\n".join([head, *functions])


def _data(g: Graph) -> list[int]:
    return [n for n, op in enumerate(g.ops) if op == DATA]


def _tables(g: Graph) -> str:
    """Return the code of arrays and functions of tables."""
    arrays = [g.payload(n).values for n in _data(g)]
    rows = "".join(f"    {row!r},\n".replace("nan", 'float("nan")') for row in arrays)
    numbers = "".join(
        f"{x} = {getattr(tables, x)!r}\n" for x in ("BELOW", "TINY", "FAR")
    )
    text = "\n\n".join(map(inspect.getsource, tables.functions()))
    text = re.sub(r": Floats\b", "", text)
    return _TABLES.format(numbers=numbers, rows=rows, functions=text)


def _tuple(names: Sequence[str]) -> str:
    return f"({', '.join(map(_quoted, names))}{',' if len(names) == 1 else ''})"


def _dictionary(values: Mapping[str, object]) -> str:
    lines = [f"    {_quoted(name)}: {value!r},\n" for name, value in values.items()]
    return "{\n" + "".join(lines) + "}" if lines else "{}"


def _quoted(name: str) -> str:
    return f'"{name}"'


def _function(
    e: Equations, name: str, letter: str, nodes: list[int], shape: tuple[int, ...]
) -> str:
    """Return the Python code of a function that returns an array.

    name, letter : the name of the function, and the letter of its result.
    nodes : the entries.
    shape : the shape of the array.
    """
    g, first = e.graph, ", s" if e.states else ""
    size = ", ".join(map(str, shape))
    lines = [
        f"def {name}(t, q, q_dot{first}):",
        f'    """Give {letter} ({size}{"," if len(shape) == 1 else ""})."""',
        f"    out = np.zeros(({size}{',' if len(shape) == 1 else ''}))",
    ]
    filled = [(k, node) for k, node in enumerate(nodes) if node != g.zero]
    if filled:
        steps, values = _steps(e, [node for _, node in filled])
        lines.append('    with np.errstate(all="ignore"):')
        lines += [f"        {step}" for step in steps]
        for (k, _), value in zip(filled, values, strict=True):
            index = ", ".join(map(str, np.unravel_index(k, shape)))
            lines.append(f"        out[{index}] = {value}")
    lines.append("    return out")
    return "\n".join(lines) + "\n"


def _steps(e: Equations, nodes: Sequence[int]) -> tuple[list[str], list[str]]:
    """Return lines of code that compute nodes, and an expression for each node.

    Each line is an assignment to a local name. A node that is used once is written
    within the expression that uses it.
    """
    g = e.graph
    cone = g.cone(nodes)
    uses = Counter(a for n in cone for a in g.args[n])
    texts = _inputs(e, cone)
    lines = [f"{name} = np.float64({source})" for name, source in texts.values()]
    # a name takes no operations
    written = {n: (name, 0) for n, (name, _) in texts.items()}
    prefix, count = "z", 0
    while any(name.startswith(prefix) for name, _ in texts.values()):
        prefix += "_"
    for n in cone:
        if n in written:
            continue
        code, operations = _code(g, n, written)
        if g.args[n] and (uses[n] > 1 or operations > LONGEST):
            count += 1
            lines.append(f"{prefix}{count} = {code}")
            code, operations = f"{prefix}{count}", 0
        written[n] = code, operations
    return lines, [written[n][0] for n in nodes]


def _inputs(e: Equations, cone: Sequence[int]) -> dict[int, tuple[str, str]]:
    """Return the variables that a generated function reads.

    The result maps a node to the local name of the variable, and the expression that is
    its value.

    cone : the nodes that the function evaluates.
    """
    sources = {p.name: f'PARAMETERS["{p.name}"]' for p in e.model.parameters}
    sources |= {q: f"q[{k}]" for k, q in enumerate(e.q)}
    sources |= {v: f"q_dot[{k}]" for k, v in enumerate(e.velocities)}
    sources |= {x.name: f"s[{k}]" for k, x in enumerate(e.states)}
    found: dict[int, tuple[str, str]] = {}
    taken = {*_TAKEN, *("s" for _ in e.states)}
    for n in cone:
        if e.graph.ops[n] != VARIABLE:
            continue
        name = str(e.graph.payload(n))
        local = name.replace(".", "_")  # the name of a member
        local = local if local.isidentifier() else f"x{n}"
        # `t` is an argument already, and is converted to a number that divides without
        # raising.
        while local in taken and name != "t":
            local += "_"
        taken.add(local)
        found[n] = local, sources.get(name, "t")
    return found


def _code(g: Graph, n: int, written: Mapping[int, tuple[str, int]]) -> tuple[str, int]:
    """Return the Python code of a node, and the number of operations in the code.

    n : the node.
    written : code and operations of the nodes that are its arguments.
    """
    op = g.ops[n]
    if op == DATA:
        return f"DATA[{_data(g).index(n)}]", 0
    if op in (CONSTANT, TRUTH):
        value = repr(g.payload(n))
        return (f"({value})" if value.startswith("-") else value), 0
    parts = [written[a] for a in g.args[n]]
    factors = [text if _is_atom(text) else f"({text})" for text, _ in parts]
    if op in ("div", "pow") and all(g.ops[a] == CONSTANT for a in g.args[n]):
        factors[0] = (
            f"np.float64({factors[0]})"  # a number that divides by 0 without raising
        )
    return OPERATIONS[op].python.format(*factors), 1 + sum(k for _, k in parts)


_ATOM = re.compile(r"[\w.]+(\([^()]*\))?\Z")


def _is_atom(text: str) -> bool:
    """Whether text needs no parentheses: a name, a number, a call."""
    return bool(_ATOM.match(text)) or (text[0] == "(" and ")" not in text[:-1])
