"""The memory of a method between calls.

Between two calls of `advance` all data are in this memory, so a run can be paused,
shown, interrupted and resumed at no cost. Each method adds its own data in a subclass.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.arrays import Floats
from lagsim.methods.parts.parameters import Blocks, Parameters
from lagsim.native.kernels.words import external
from lagsim.native.layout import array, part

if TYPE_CHECKING:
    from collections.abc import Callable


class Clock(Blocks):
    """The time, the state, and the counters, which each step advances."""

    t: float  # time reached
    h: float  # the next step; 0 before it has been computed
    step_t: float  # the last step: the time of its start ...
    step_h: float  # ... and its length; 0 before the first
    fixed_step: float  # step size of fixed-step methods
    fresh: float  # 1 at the start of an arc
    steps: float
    rejections: float
    evaluations: float
    # number of factorisations by the method, and for the Jacobian
    factorisations: float
    y: Floats = array("size")

    work: Floats = array(lambda s: 2 * s.size + 4)  # a state ...
    # ... and further working memory
    spare: Floats = part("work", lambda s: s.size + 4, "size")
    # A point within the step: y and y' there; states near it, and their y' from the
    # equations.
    point: Floats = array(lambda s: 2 * s.size)
    point_rates: Floats = part("point", "size", "size")
    far_before: Floats = array("size")
    exact_rates: Floats = array("size")


# The largest number of states beside the rows that one call of a kernel writes.
MOST_LISTED = 64


class ArcRows(Clock):
    """The end of the arc and its rows: set by the run, used by `driver`."""

    end: float  # end of the arc
    arc_start: float
    row_start: float  # row k is at the time row_start + k*row_step ...
    row_step: float
    row_limit: float  # ... if that is less than this ...
    arc_rows: float  # ... or, before an end has been located, less than this
    row: float  # the number of the next row
    # number of states requested between rows that are still to be written ...
    extras: float
    extra: float  # ... the time of the next one ...
    listed: float  # ... and the number of their times in `extra_times`
    emitted: float  # rows written by this call
    located: float  # 1 if arcs may end within a step: every step is interpolated
    cut: (
        # the fraction of the last step at which the arc ends, until rows are written;
        # or 0
        float
    )
    # Times of the next states beside the rows, the latest first.
    extra_times: Floats = array(lambda _: MOST_LISTED)


# The part of the tolerance that one step may use: errors of many steps add up, and the
# tolerance is meant for the motion (Kepler's, e = 0.6, 100 orbits: 6 digits at 1e-11).
LOCAL = 0.1

# Return codes of `advance` and `step`.
DONE = 0
BLOCK_FULL = 1
PAUSED = 2
EVENT_FOUND = 3
STEP_TOO_SMALL = 4
NOT_FINITE = 5
PROJECTION_FAILED = 6
DEGENERATE = 7
RANK_LOST = 8
SWITCH_FOUND = 9
NEWTON_FAILED = 10
STIFF = 11
LOSS_AHEAD = 12
KNOTS_PASSED = 13


# --- functions of a model and of a method that are linked in --------------------------


def of_model(name: str) -> Callable[[float, Floats, Parameters, Floats], None]:
    """Declare the model function `name` of (t, y, p, out), which writes to `out`.

    All arrays are views into longer arrays; y has the blocks of `Blocks`, and p
    contains the parameters and the working memory of the model.
    """

    def function(t: float, y: Floats, p: Parameters, out: Floats) -> None:
        """Write the values of the model function `name` at (t, y) to `out`."""

    function.__name__ = function.__qualname__ = name
    return external(function)


# y' (size,).
derivative = of_model("derivative")
# The order K (1,), then the Taylor coefficients y_0 ... y_K (K + 1, size).
series = of_model("series")
# The Newton step onto the holonomic constraints, in the metric of M (n,); then the
# largest residual relative to its scale, 0, and a bound of it after the step.
position_step = of_model("position_step")
# The Newton step of the velocities (n,); then the largest residual, an estimate of the
# smallest singular value of the scaled constraint rows, and a bound of the residual
# after the step, 1 if unknown.
velocity_step = of_model("velocity_step")
# q'Mq'/2, the rest of the energy (2,), the diagonal of M (n,), and 0.
energies_masses = of_model("energies_masses")
# Sum of the absolute terms of each force (n,); then of the rates of the components
# after q' in y.
terms = of_model("terms")
# Bounds of the rounding of q'' (n,) by that of the forces, in units of roundoff; then
# of the rates of the components after q' in y.
rounding = of_model("rounding")
# The derivatives of q'' (n, d) row by row, exactly, by the d components of y that the
# motion depends on; those of the rates of states and works follow.
jacobian = of_model("jacobian")
# The rates of the works (works,).
power = of_model("power")
# dL/dq' (n,), dL/dq + Q (n,), the rates of works; Q are the generalized forces. For
# scenes without constraints.
lagrangian = of_model("lagrangian")
# The derivatives of dL/dq' to q and q', of dL/dq + Q to both; (n, n) each.
lagrangian_slopes = of_model("lagrangian_slopes")
# M (n, n), which dL/dq' has as its derivative to q'.
inertia = of_model("inertia")
# Coefficients of the equations of the impulses, see `Parameters.balance`; y ends with
# the multipliers.
balance = of_model("balance")
# The rate of `work` (1,) without that of multipliers.
effort = of_model("effort")
# The columns of a row, from q'' in p; and all columns of a row.
columns = of_model("columns")
observe = of_model("observe")
# The pivots of M that vary with positions, s.inertias of them.
inertias = of_model("inertias")
# The residuals or gaps of conditions: of those of events, then of `until`.
# The sizes of their terms (C,), then their slopes by the motion and t (C, d + 1).
located = of_model("located")
located_slopes = of_model("located_slopes")
# The relations (K,) of sections, left minus right side; the sizes of their terms (K,),
# then their slopes (K, size).
sections = of_model("sections")
section_slopes = of_model("section_slopes")
# Expressions (K,) of the surfaces.
surfaces = of_model("surfaces")
# Residuals (K,), rates (K,), b (K,), scales (K,), and the elements of J. A surface on
# the level of velocities has no residual on the level of positions. J (K, n + l) is
# stored row by row without zeros; `row_starts` and `row_columns` are its pattern.
surface_rows = of_model("surface_rows")
# Jump of the force along each surface, without and by each multiplier (1 + m,), of all
# surfaces (K,); empty if no equality has a corner.
corner_levers = of_model("corner_levers")
# Event function of the mode of each surface (K,).
event_functions = of_model("event_functions")
# The arguments of localized terms (K,); see `missed`.
signals = of_model("signals")


@external
def observe_rows(rows: Floats, p: Parameters, out: Floats, count: int) -> None:
    """Write all columns of up to LANES rows (count, 1 + size) to out, row by row."""


@external
def bend(h: float, c: Floats, out: Floats) -> None:
    """Write the sum over k >= 2 of y_k h^k (size,) to out.

    c : the series, its order K, then its coefficients y_0 ... y_K.
    h : time since its start.
    """


@external
def reached(
    h: float, c: Floats, compensation: Floats, out: Floats, left: Floats
) -> None:
    """Write the value at time h, sum_k y_k h^k (size,), of a series to out.

    c : the series, its order K, then its coefficients y_0 ... y_K.
    compensation : (size,), the roundoff of y_0, which is added.
    left : (size,), on return the roundoff of the value.
    """


@external
def reached_twice(
    h: float,
    further: float,
    c: Floats,
    compensation: Floats,
    out: Floats,
    beyond: Floats,
) -> None:
    """Write the values of a series at the times h and `further` to out and `beyond`.

    c, compensation : see `reached`.
    """


@external
def slope(h: float, c: Floats, out: Floats) -> None:
    """Write the derivative of a series at time h, sum_k k y_k h^(k - 1), to out.

    out : (size,).
    c : the series, its order K, then its coefficients y_0 ... y_K.
    """


@external
def weigh(c: Floats, rates: Floats, weights: Floats, out: Floats) -> None:
    """Compare the terms of a series, each with the weight of its component.

    c : the series, its order K, then its coefficients y_0 ... y_K.
    rates : (size,), another value of y_1.
    weights : (size,).
    out : (5,), on return the largest |y_k| of the orders K, K - 1, K - 2 and K - 3, and
        the largest |y_1 - rates|, infinite if one is not a number.
    """


@external
def extend(h: float, c: Floats, other: Floats, out: Floats) -> None:
    """Write the terms K to K + E of velocities in a step h to out (E + 1, n).

    K is the order, and E the number of terms beyond it, see `native.graph.polynomials`.

    c, other : the series at both ends of the step, from the first velocity on.
    """


@external
def lengthen(x: float, h: float, more: Floats, q: Floats, v: Floats) -> None:
    """Add terms beyond the order K at the fraction x of a step h, in place.

    more : (E + 1, n), the terms K to K + E of velocities, as written by `extend`.
    q, v : positions and velocities (n,).
    """


@external
def project_sliding(t: float, y: Floats, p: Parameters) -> None:
    """Project y (size,) onto the surfaces that the motion slides along, in place."""


@external
def find_crossings(s: Clock, p: Parameters) -> int:
    """Write the states of sections in the last step, see `search.find_crossings`.

    Return 0 if the buffer is full before the end of the step, else 1.
    """
    raise NotImplementedError


@external
def find_end(s: Clock, p: Parameters) -> None:
    """End the last step at its first event, if any, see `search.find_end`."""


@external
def missed_feature(s: Clock, p: Parameters) -> float:
    """Return the fraction of the step at which a localized term is missed, or 0.

    See `search.missed_feature`.
    """
    raise NotImplementedError


@external
def loses_rank(s: Clock, p: Parameters) -> bool:
    """Whether rank is lost within the last step, see `search.loses_rank`."""
    raise NotImplementedError


@external
def check_features(
    s: Clock,
    p: Parameters,
    h: float,
    old: Floats,
    old_rates: Floats,
    new: Floats,
    new_rates: Floats,
) -> None:
    """Set `feature_possible` after a step h, see `missed.check_features`.

    old, old_rates, new, new_rates : (size,), y and y' at both ends.
    """


@external
def start(s: Clock, p: Parameters) -> None:
    """Begin an arc: evaluate y' at the start, and choose the first step."""


@external
def step(s: Clock, p: Parameters) -> int:
    """Advance by one accepted step, or return a code other than DONE."""
    raise NotImplementedError


@external
def interpolate(s: Clock, p: Parameters, x: float, out: Floats) -> None:
    """Write the state (size,) at the fraction x of the last step to `out`."""


@external
def interpolate_rows(s: Clock, p: Parameters, rows: Floats, count: int) -> None:
    """Write the states at the times of rows (count, 1 + size) in the last step."""


@external
def interpolate_rates(s: Clock, x: float, out: Floats) -> None:
    """Write the derivative of the dense output at x to components n ... of out (size,).

    The components written are the rates that follow q' in y'.
    """
