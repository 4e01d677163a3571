"""Fixed steps: the step around a method's formula, dense output, tableaus."""

from __future__ import annotations

from functools import cached_property
from math import floor
from typing import TYPE_CHECKING

from lagsim.language.arrays import Floats
from lagsim.methods.parts.constraints import is_finite, project_step
from lagsim.methods.parts.control import bound_roundoff, record_extents, record_sizes
from lagsim.methods.parts.driver import State
from lagsim.methods.parts.missed import next_end
from lagsim.methods.parts.newton import SOLVED, progress
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import DONE, NOT_FINITE, PROJECTION_FAILED, derivative
from lagsim.native.kernels.words import external
from lagsim.native.layout import array
from lagsim.tolerances import OVERFLOW, SAME_STEP, STATE_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterable

    Row = tuple[float, ...]

CONSTRAINED = True


class Fixed(State):
    """Memory of methods with a fixed step: the last step, and the current one."""

    old: Floats = array("size")  # the state before the last step ...
    before: Floats = array("size")  # ... y' at this state ...
    k: Floats = array("size")  # ... and y' at the state reached
    slope: Floats = array("size")  # y' after the current step ...
    new: Floats = array("size")  # ... and the state after it


@external
def make(s: Fixed, p: Parameters, after: float, h: float) -> int:
    """Compute the state `new` after a step h, and y' there.

    Return DONE, or the code of a failure (see `state`).

    after : the time there, which is t + h but for rounding.
    """
    raise NotImplementedError


def start(s: Fixed, p: Parameters) -> None:
    """Begin an arc: evaluate y' at the start."""
    derivative(s.t, s.y, p, s.k)
    s.evaluations += 1.0
    s.step_h = 0.0
    record_sizes(s, p)


def step(s: Fixed, p: Parameters) -> int:
    """Advance by one step; return DONE, or the code of a failure (see `state`)."""
    end = next_end(s, p)
    after = next_time(s, end)
    # Full steps are equal to the last bit, unlike after - t: a symplectic method
    # conserves an energy that depends on the step.
    h = s.fixed_step if after < end else after - s.t
    code = make(s, p, after, float(h))
    if code == DONE:
        take(s, p, after)
    return code


def next_time(s: State, end: float) -> float:
    """Return the time at which the next step ends.

    The time is a whole number of steps after the arc's start, or `end` if that comes
    first.
    """
    made = floor((s.t - s.arc_start) / s.fixed_step + 0.5)
    after = s.arc_start + (made + 1) * s.fixed_step
    if after + SAME_STEP * s.fixed_step >= end:
        return end
    return float(after)


def judge(
    s: Fixed, p: Parameters, h: float, v: Floats, change: Floats,
    iteration: int, largest_change: float, previous: float,
) -> int:  # fmt: skip
    """Return the state of Newton's iteration: GO_ON, RENEW, SOLVED or LOST.

    Changes that stagnate may be rounding: of velocities that should stay 0 under forces
    that cancel, or of positions far from the origin.

    v, change : (n,), the velocities and their last change.
    h : the length of the step.
    iteration : its number, from 0.
    largest_change : the largest ratio of a change to the size of its component.
    previous : the ratio of the iteration before.
    """
    state = progress(iteration, largest_change, previous)
    if state == SOLVED or iteration == 0 or not largest_change < OVERFLOW:
        return state
    if largest_change >= 0.5 * previous and is_rounding(s, p, h, v, change):
        return SOLVED
    return state


def is_rounding(s: Fixed, p: Parameters, h: float, v: Floats, change: Floats) -> bool:
    """Whether a change (n,) of velocities v (n,) by Newton's method is rounding.

    h : the length of the step.
    """
    if s.rounding_known == 0.0:
        bound_roundoff(s, p, s.t, s.y, s.k, 1.0, 0.0, 1)
        s.rounding_known = 1.0
    roundoff = s.roundoff[s.velocities]
    for i in range(s.n):
        if not abs(change[i]) <= STATE_ROUNDOFF * abs(v[i]) + h * roundoff[i]:
            return False
    return True


def conclude(s: Fixed, p: Parameters, after: float, h: float) -> int:
    """Project the new state of a step h to `after`, and evaluate y'; return a code."""
    if not is_finite(s.size, s.new):
        return NOT_FINITE
    if CONSTRAINED and project_step(s, p, after, h, s.new) == 0:
        return PROJECTION_FAILED
    derivative(after, s.new, p, s.slope)
    s.evaluations += 1.0
    return DONE


def take(s: Fixed, p: Parameters, after: float) -> None:
    """Accept the new state at time `after`; the old state is kept for interpolation."""
    s.old[:] = s.y
    s.before[:] = s.k
    s.y[:] = s.new
    s.k[:] = s.slope
    s.step_t = s.t
    s.step_h = after - s.t
    s.t = after
    s.steps += 1.0
    # Only projection needs the sizes of rates.
    if CONSTRAINED:
        record_sizes(s, p)
    else:
        record_extents(s)


def interpolate(s: Fixed, p: Parameters, x: float, out: Floats) -> None:  # noqa: ARG001
    """Write the state (size,) at the fraction x of the last step, by cubic Hermite.

    Source: Hairer, Norsett and Wanner, Solving ODEs I, II.6.
    """
    h = s.step_h
    u = 1.0 - x
    for i in range(s.size):
        change = s.y[i] - s.old[i]
        bend = u * (h * s.before[i] - change) - x * (h * s.k[i] - change)
        out[i] = s.old[i] + x * (change + u * bend)


# --- Runge-Kutta tableaus -------------------------------------------------------------


class Tableau:
    """The coefficients of a Runge-Kutta method.

    Attributes
    ----------
    A : tuple of rows, shape (s, up to s - 1)
        Without trailing zeros.
    B : tuple, shape (up to s,)
        Weights of the slopes of the stages.
    C : tuple, shape (s,)
        Fractions of the step at which the stages are evaluated.
    order : int
        Order of the method.

    Raises
    ------
    ValueError
        If the sum of a row of A differs from its C, or B violates a quadrature
        condition sum b c^(k-1) = 1/k of its order: a coefficient has been mistyped.
        (The conditions of all rooted trees up to the order are checked by the tests.)
    """

    def __init__(self, A: tuple[Row, ...], B: Row, C: Row, order: int) -> None:
        self.A, self.B, self.C, self.order = A, B, C, order
        for i, (row, c) in enumerate(zip(A, C, strict=True)):
            size = 1.0 + sum(map(abs, row))
            if abs(sum(row) - c) > 1e-14 * size:
                raise ValueError(f"row {i} of A adds up to {sum(row)!r}, not to {c!r}")
        for k in range(1, order + 1):
            terms = [b * c ** (k - 1) for b, c in zip(B, C, strict=False)]
            if abs(sum(terms) - 1 / k) > 1e-14 * (1.0 + sum(map(abs, terms))):
                raise ValueError(f"B fails the quadrature condition of order {k}")

    def amplification(self, z: complex) -> float:
        """Return |R(z)|, R(z) = 1 + z B^T (1 - z A)^-1 1, for y' = (z/h) y.

        Hairer, Norsett and Wanner, Solving ODEs II, (IV.3.2).

        Examples
        --------
        >>> euler = Tableau(((),), (1.0,), (0.0,), 1)
        >>> euler.amplification(-0.5)
        0.5
        """
        if (coefficients := self._polynomial) is not None:
            found = 0j
            for coefficient in coefficients:
                found = found * z + coefficient
            return abs(found)
        import numpy as np

        s = len(self.B)
        A = np.zeros((s, s))
        for i, row in enumerate(self.A[:s]):
            A[i, : len(row)] = row
        stages = np.linalg.solve(np.eye(s) - z * A, np.ones(s))
        return float(abs(1.0 + z * np.dot(self.B, stages)))

    @cached_property
    def _polynomial(self) -> list[float] | None:
        """Coefficients of R(z), highest power first; None for an implicit method.

        R(z) = 1 + sum over k of z^k B^T A^(k-1) 1, where A is nilpotent.
        """
        rows = self.A[: len(self.B)]
        if any(len(row) > i for i, row in enumerate(rows)):
            return None
        found, stages = [1.0], [1.0] * len(rows)
        for _ in rows:
            found.append(_dot(self.B, stages))
            stages = [_dot(row, stages) for row in rows]
        return found[::-1]


def _dot(a: Iterable[float], b: Iterable[float]) -> float:
    """Return the sum of products of a and b, up to the end of the shorter sequence."""
    return sum(x * y for x, y in zip(a, b, strict=False))
