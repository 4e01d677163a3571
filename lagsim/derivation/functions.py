"""Functions of the model language that sympy has not, or not with our derivatives.

They are differentiated branch by branch: a step has slope 0, also where it jumps, and
`min` and `max` have the slope of the argument that is taken. sympy's own would answer
with Dirac's delta, and rewrite what a person wrote. (Their names differ from sympy's,
whose printers and simplifiers go by the name of a class.)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sympy as sp

if TYPE_CHECKING:
    from collections.abc import Callable


class Spelled(sp.Function):  # type: ignore[misc]
    """A real function; `spelled` is its name in the model language."""

    spelled = ""

    def _eval_is_extended_real(self) -> bool:
        return True


class _Step(Spelled):
    def fdiff(self, _argindex: int = 1) -> Any:
        """Give the slope: a step has none."""
        return sp.S.Zero


class SignStep(_Step):
    """-1, 0 or 1."""

    spelled = "sign"


class HeavisideStep(_Step):
    """0 below 0, 1 from there on."""

    spelled = "heaviside"


class FloorStep(_Step):
    """The largest whole number that is not greater."""

    spelled = "floor"


class CeilStep(_Step):
    """The smallest whole number that is not less."""

    spelled = "ceil"


class RealAbs(Spelled):
    """The absolute value."""

    spelled = "abs"

    def fdiff(self, _argindex: int = 1) -> Any:
        """Give the slope."""
        return SignStep(self.args[0])


class RealCbrt(Spelled):
    """The real cube root."""

    spelled = "cbrt"

    def fdiff(self, _argindex: int = 1) -> Any:
        """Give the slope."""
        return 1 / (3 * self**2)


class RealLog10(Spelled):
    """The logarithm to base 10."""

    spelled = "log10"

    def fdiff(self, _argindex: int = 1) -> Any:
        """Give the slope."""
        return 1 / (self.args[0] * sp.log(10))


class _Extreme(Spelled):
    def _eval_derivative(self, s: Any) -> Any:
        x, y = self.args
        dx, dy = x.diff(s), y.diff(s)
        if dx == dy:
            return dx
        return sp.Piecewise((dx, self.first(x, y)), (dy, True))

    @staticmethod
    def first(x: Any, y: Any) -> Any:
        """Give the condition under which the first argument is taken."""
        raise NotImplementedError


class MinBranch(_Extreme):
    """The smaller of two."""

    spelled = "min"

    @staticmethod
    def first(x: Any, y: Any) -> Any:
        """Give the condition under which the first argument is taken."""
        return sp.Le(x, y)


class MaxBranch(_Extreme):
    """The greater of two."""

    spelled = "max"

    @staticmethod
    def first(x: Any, y: Any) -> Any:
        """Give the condition under which the first argument is taken."""
        return sp.Ge(x, y)


TWINS: dict[str, Callable[..., Any]] = {
    c.spelled: c
    for c in (
        SignStep, HeavisideStep, FloorStep, CeilStep, RealAbs, RealCbrt, RealLog10,
        MinBranch, MaxBranch,
    )
}  # fmt: skip
