"""Functions of the model language that sympy has not, or not with our derivatives.

They are differentiated branch by branch, as their rows say: a step has slope 0, also
where it jumps, and `min` and `max` have the slope of the argument that is taken.
sympy's own would answer with Dirac's delta, and rewrite what a person wrote.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import sympy as sp

from lagsim.language.functions import FUNCTIONS
from lagsim.language.graph import Graph
from lagsim.language.symbolic import to_sympy

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

    def fdiff(self, argindex: int = 1) -> Any:
        """Give the slope."""
        if self.row.name == "log10":  # of a number the graph keeps the value alone
            return 1 / (self.args[0] * sp.log(10))
        g = Graph()
        args = tuple(g.variable(str(k)) for k in range(self.row.arity))
        assert self.row.partials is not None
        itself = g.variable("itself")
        slope = self.row.partials(g, args, itself)[argindex - 1]
        known = dict(zip(args, self.args, strict=True)) | {itself: self}
        return to_sympy(g, [slope], known=known, twins=TWINS)[0]

    def _eval_derivative(self, s: Any) -> Any:
        if self.row.branches is None:
            return super()._eval_derivative(s)
        slopes = [x.diff(s) for x in self.args]
        if slopes[0] == slopes[1]:
            return slopes[0]
        g = Graph()
        args = tuple(g.variable(str(k)) for k in range(self.row.arity))
        known = dict(zip(args, self.args, strict=True))
        first = to_sympy(g, [self.row.branches(g, args)], known=known)[0]
        return sp.Piecewise((slopes[0], first), (slopes[1], True))


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
