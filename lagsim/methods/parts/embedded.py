"""Embedded explicit Runge-Kutta pairs: steps, error control, dense output.

A pair is a file of `methods` with its tableau, its error estimates and its dense output
as an `EmbeddedPair`, which is static in the kernels below. The treatment of
constraints, rounding, switches and losses of rank, common to all pairs, stands here.

Source: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations
I, 2nd ed., sections II.4 (control, (2.43c)), II.5 (methods) and II.6 (dense output).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple, cast

from lagsim.language.arrays import Floats
from lagsim.methods.parts import constraints, control
from lagsim.methods.parts import state as at
from lagsim.methods.parts.driver import State, record_speed, usable_step
from lagsim.methods.parts.first_step import first_step
from lagsim.methods.parts.fixed import Tableau
from lagsim.methods.parts.onset import (
    LIMITED,
    set_aside,
    sides_are_clear,
    spread_scales,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import check_features, derivative
from lagsim.native.kernels.words import apart, total, unrolled
from lagsim.native.layout import array, part
from lagsim.tolerances import OVERFLOW

Row = tuple[float, ...]

CONSTRAINED = True
SWITCHES = True

SAFETY = 0.9
BETA = 0.04
SHRINK = 3.0  # bounds of the factor by which a step shrinks, and grows
GROW = 6.0
# Least first step after an event, relative to the step with which the arc before would
# have continued. With 0.6 first steps are rejected where a mass begins to slide; with
# 0.3 motions with many events take a tenth fewer steps, but a motor a third more.
RESUMED = 0.1
# Error from which on steps shrink. Beside a switch far from the origin the error may be
# rounding alone; steps would become so short that the state does not change.
SHRINKING = 0.25
# Error from which on steps grow little: it may be rounding where forces cancel.
SLOWING = 1e-2
# If a stage lies near a loss of rank by accident, a step a little shorter passes the
# loss; a much shorter one ends before it. A stage lies near a loss if sigma is smaller
# there than at the start by this factor.
BESIDE = 0.3
ASIDE = 0.85


class EmbeddedPair(NamedTuple):
    """An embedded explicit pair whose last stage is the first of the next step.

    Attributes
    ----------
    A : tuple of rows, shape (stages, up to stages - 1)
        The coefficients, a row for each stage: first the s stages of a step; then the
        slope after the step, whose row has the weights of the step (s,); then further
        stages of the dense output.
    C : tuple, shape (stages,)
        Fractions of the step at which the stages are evaluated.
    estimates : tuple of rows, shape (1 or 2, s or s + 1)
        Weights of the error estimate; of two estimates, the second one of lower order,
        which are combined.
    dense : tuple of rows, shape (terms, stages)
        Weights of the terms of the dense output from the fifth on.
    order : int
        Order of the step.
    exponent, beta : float
        Powers of the error and of the error before in step control (II.4, (2.43c)).
    stability_bound : float
        Step times the rate of the fastest motion from which on the step counts as
        limited by stability, not by accuracy.
    early : float
        Fraction of a step, between its first stages, at which a near loss of rank is
        passed.
    most_last : float
        Largest last term of a dense output that is evaluated, in tolerances; with a
        larger one, rows and events are reached by a step of their own.
    """

    A: tuple[Row, ...]
    C: Row
    estimates: tuple[Row, ...]
    dense: tuple[Row, ...]
    order: int
    exponent: float
    stability_bound: float
    early: float
    most_last: float = inf
    beta: float = BETA

    @property
    def weights(self) -> Row:
        """Weights of the step (s,)."""
        return self.A[self.last]

    @property
    def last(self) -> int:
        """The number s of stages of a step, also the index of the slope after it."""
        return self.C.index(1.0, self.C.index(1.0) + 1)

    @property
    def terms(self) -> int:
        """Number of terms of the dense output."""
        return 4 + len(self.dense)

    @property
    def combines(self) -> bool:
        """Whether the pair has two error estimates, which are combined."""
        return len(self.estimates) > 1

    @property
    def ends(self) -> bool:
        """Whether the error estimate contains the slope after the step."""
        return len(self.estimates[0]) > self.last

    @property
    def largest_weight(self) -> float:
        """Largest factor x^i (1 - x)^j, 0 <= x <= 1, of the last dense term."""
        i, j = self.terms // 2, (self.terms - 1) // 2
        return float(i) ** i * float(j) ** j / float(i + j) ** (i + j)

    @property
    def tableau(self) -> Tableau:
        """The tableau of a step, whose order conditions are verified."""
        return Tableau(
            self.A[: self.last], self.weights, self.C[: self.last], self.order
        )


# The pair of the kernels below, a static value: the pair of the method's module.
PAIR = cast("EmbeddedPair", None)


class Embedded(State):
    """Memory of a pair: slopes and state of the stages, the new state, dense output."""

    stages: int  # number of slopes of a step, with those of the dense output
    terms: int  # number of terms of the dense output
    previous_error: float  # error of the last accepted step, for PI control
    uncertain: float  # 1 if the dense output of the last step may be inaccurate
    k: Floats = array(lambda s: s.stages * s.size)
    first: Floats = array("size")  # the slope at the start of the last step
    z: Floats = array("size")
    new: Floats = array("size")
    dense: Floats = array(lambda s: s.terms * s.size)
    errors: Floats = part("dense", lambda s: 2 * s.size)


def start(s: Embedded, p: Parameters) -> None:
    """Begin an arc: evaluate y' at the start, and choose the first step.

    `first_step` underestimates the step where a single rate is near 0. Most events
    change few forces: after an event the step is at least a part of the step before, up
    to the time between rows. This does not hold where rounding sets a tolerance (far
    from the origin): only shorter steps show the error past a root in a force.
    """
    resumed = min(RESUMED * s.h, s.row_step, s.end - s.t)
    if control.is_set_by_rounding(s, max(s.step_h, s.h)):
        resumed = 0.0
    derivative(s.t, s.y, p, s.k)
    s.evaluations += 1.0
    s.step_h = 0.0
    s.previous_error = 1e-4
    control.record_sizes(s, p)
    s.h = max(first_step(s, p, PAIR.order, s.k), resumed)
    s.at_bound = 0.0
    if CONSTRAINED:
        s.early = PAIR.early
        s.h = constraints.step_past_loss(s, p, s.h)


def step(s: Embedded, p: Parameters) -> int:
    """Advance by one accepted step, or return a code other than DONE."""
    rejected = False
    trouble = at.STEP_TOO_SMALL
    while True:
        h = usable_step(s, p)
        if h == 0.0:
            return trouble
        error = attempt(s, p, h)
        if not error < OVERFLOW:
            s.h = 0.1 * h
            trouble = at.NOT_FINITE
        elif error >= 1.0:
            s.h = h / min(SHRINK, error**PAIR.exponent / SAFETY)
            if CONSTRAINED and p.least_sigma < BESIDE * s.sigma:
                s.h = max(s.h, ASIDE * h)
            trouble = at.STEP_TOO_SMALL
        elif CONSTRAINED and constraints.project_step(s, p, s.t + h, h, s.new) == 0:
            s.h = 0.25 * h
            trouble = at.PROJECTION_FAILED
        else:
            break
        if CONSTRAINED and constraints.needs_loops(s):
            return at.DEGENERATE
        rejected = True
        s.rejections += 1.0
    accept(s, p, h)
    grown = error**PAIR.exponent / (s.previous_error**PAIR.beta * SAFETY)
    s.h = h / max(1.0 / GROW, min(SHRINK, grown))
    if rejected:
        s.h = min(s.h, h)
    s.previous_error = max(error, 1e-4)
    return at.DONE


def attempt(s: Embedded, p: Parameters, h: float) -> float:
    """Compute a step of length h; return its error in units of the tolerance."""
    t, size, k, new = s.t, s.size, s.k, s.new
    if CONSTRAINED:
        p.least_sigma = 1.0
    make_stages(s, p, t, s.y, h)
    for i in apart(size):
        new[i] = s.y[i]
        s.remainder[i] = h * total(
            PAIR.weights[j] * k[j * size + i] for j in unrolled(PAIR.last)
        )
    control.add_change(s, p, k, h, new)
    s.balanced_alone = 0.0
    varied = control.set_tolerances(s, p, t + h, new, k, h)
    estimate(s, p, t + h)
    errors = s.errors
    sigma = 1.0
    if CONSTRAINED and p.least_sigma < s.close_below:
        sigma = p.least_sigma
    error = error_norm(s, h, errors)
    if (
        error >= SLOWING
        and (varied or error >= 1.0)
        and sides_are_clear(s, p, s.t, s.y)
    ):
        error = error_at_onset(s, p, h, error)
    # The error may be rounding alone.
    least = 1.0
    if SWITCHES and error >= SHRINKING and control.hardly_moves(s, p, h, k):
        least = SHRINKING
    doubtful = error >= least
    if not doubtful and error >= SLOWING and s.balanced > 0.0:
        doubtful = True
        s.balanced_alone = 1.0
    while doubtful and control.allow_roundoff(s, p, h, new, k, sigma):
        error = min(error, error_norm(s, h, errors))
        doubtful = error >= least
    if CONSTRAINED and error >= 1.0 and constraints.hides_error(s, p):
        constraints.note_directions(s, p, t + h, new)
        error = constraints.error_past_loss(s, error_on_constraints(s, p, h, errors))
    return error


def error_at_onset(s: Embedded, p: Parameters, h: float, error: float) -> float:
    """Return the error of a step h in tolerances, raised for components at their onset.

    Such components begin to move by the motion of others, see `onset`. Tolerances are
    raised only if these components limit the step.

    error : the error in tolerances so far.
    """
    k, new = s.k, s.new
    if set_aside(s, h, new, k, min(error - 1.0, 0.0)) == 0:
        return error
    others = error_norm(s, h, s.errors)
    if others < 1.0 and LIMITED * others < error:
        spread_scales(s, p, s.t, s.y, k, new, h)
    control.compute_tolerances(s, p, new, k, h)
    return error_norm(s, h, s.errors)


def error_on_constraints(s: Embedded, p: Parameters, h: float, errors: Floats) -> float:
    """Return the error of a step h in tolerances, of motion on the constraints alone.

    The part that projection onto the constraints removes does not count.

    errors : (2 size,), see `error_norm`.
    """
    removed = h * h * constraints.forget_removed(s, p, h, errors)
    if PAIR.combines:
        constraints.forget_removed(s, p, h, errors[s.size :])
    return constraints.curved_error(s, removed, error_norm(s, h, errors))


def make_stages(s: Embedded, p: Parameters, t: float, y: Floats, h: float) -> None:
    """Evaluate the slopes of a step h from y (size,) at t; the first one is known."""
    size, k = s.size, s.k
    for stage in unrolled(1, PAIR.last):
        for i in apart(size):
            slope = total(PAIR.A[stage][j] * k[j * size + i] for j in unrolled(stage))
            s.z[i] = y[i] + h * slope
        derivative(t + PAIR.C[stage] * h, s.z, p, k[stage * size :])
    s.evaluations += PAIR.last - 1.0


def estimate(s: Embedded, p: Parameters, t: float) -> None:
    """Compute the error estimates of a step that ends at time t, from its slopes."""
    size, k = s.size, s.k
    if PAIR.ends:
        derivative(t, s.new, p, k[PAIR.last * size :])
        s.evaluations += 1.0
    for i in apart(size):
        for e in unrolled(len(PAIR.estimates)):
            s.errors[e * size + i] = total(
                PAIR.estimates[e][j] * k[j * size + i]
                for j in unrolled(len(PAIR.estimates[e]))
            )


def error_norm(s: Embedded, h: float, errors: Floats) -> float:
    """Return the norm of the error estimates of a step h, in units of the tolerance.

    The norm is the root mean square over the components with an error. Errors of works
    are added one by one, each by the amount by which it increases the norm of the
    motion alone. The estimate of order 3 can be large for a work whose true error is
    small, such as a polynomial in t with a tolerance near 0; in a common mean it would
    dominate all other errors. The norm is nan if an error is nan, and the step is then
    rejected.

    errors : (2 size,), both estimates of the error of the slope; the second one is not
        used if the pair has only one.
    """
    size, moving, tolerances = s.size, s.dynamic.stop, s.tolerances
    error5 = 0.0
    error3 = 0.0
    controlled = 0
    for i in range(size):
        if tolerances[i] > 0.0:
            e5 = control.against(errors[i], tolerances[i])
            if e5 > 0.0:
                controlled += 1
            if i < moving:
                error5 += e5 * e5
                if PAIR.combines:
                    e3 = control.against(errors[size + i], tolerances[i])
                    error3 += e3 * e3
    motion = combined(error5, error3)
    error = motion
    for i in range(moving, size):
        if tolerances[i] > 0.0:
            e5 = control.against(errors[i], tolerances[i])
            e3 = 0.0
            if PAIR.combines:
                e3 = control.against(errors[size + i], tolerances[i])
            both = combined(error5 + e5 * e5, error3 + e3 * e3)
            if not both <= motion:
                error += both - motion
    return h * sqrt(error / max(controlled, 1))


def combined(error5: float, error3: float) -> float:
    """Return the square of the error from two squared estimates (II.10, (10.17)).

    With one estimate, error3 is not used. nan remains nan.

    error5, error3 : the squared estimates of higher and of lower order.
    """
    if not PAIR.combines:
        return error5
    return error5 * (error5 / (error5 + 0.01 * error3)) if error5 != 0.0 else 0.0


def accept(s: Embedded, p: Parameters, h: float) -> None:
    """Accept the new state after a step h; prepare the dense output for rows."""
    size, k, new = s.size, s.k, s.new
    after = k[PAIR.last * size :]
    if CONSTRAINED or not PAIR.ends:  # a projection has moved the state
        derivative(s.t + h, new, p, after)
        s.evaluations += 1.0
    if s.signals > 0:
        check_features(s, p, h, s.y, k, new, after)
    s.step_t = s.t
    s.step_h = h
    s.t = s.t + h
    s.steps += 1.0
    record_speed(
        s, h, PAIR.stability_bound, new, after, s.z, k[(PAIR.last - 1) * size :]
    )
    row = s.row_start + s.row * s.row_step
    watched = CONSTRAINED and s.watched > 0.0
    watched = watched or s.feature_possible > 0.0
    if s.located > 0.0 or watched or (row < s.row_limit and row < s.t):
        prepare_dense(s, p)
    elif s.extras > 0.0 and s.extra < s.t:
        counted = s.evaluations
        prepare_dense(s, p)
        s.evaluations = counted  # the result does not depend on these evaluations
    s.y[:] = new
    k[:size] = k[PAIR.last * size : (PAIR.last + 1) * size]
    control.keep_compensation(s)
    control.record_measured(s, p)


def prepare_dense(s: Embedded, p: Parameters) -> None:
    """Evaluate the stages of the dense output and the coefficients of its terms."""
    h, size, y, k, dense = s.step_h, s.size, s.y, s.k, s.dense
    for stage in unrolled(PAIR.last + 1, len(PAIR.C)):
        for i in apart(size):
            slope = total(PAIR.A[stage][j] * k[j * size + i] for j in unrolled(stage))
            s.z[i] = y[i] + h * slope
        derivative(s.step_t + PAIR.C[stage] * h, s.z, p, k[stage * size :])
        s.evaluations += 1.0
    for i in apart(size):
        change = s.new[i] - y[i]
        bend = h * k[i] - change
        dense[i] = y[i]
        dense[size + i] = change
        dense[2 * size + i] = bend
        dense[3 * size + i] = change - h * k[PAIR.last * size + i] - bend
        for m in unrolled(len(PAIR.dense)):
            slope = total(
                PAIR.dense[m][j] * k[j * size + i] for j in unrolled(len(PAIR.dense[m]))
            )
            dense[(4 + m) * size + i] = h * slope
    s.uncertain = 0.0
    if PAIR.most_last < inf:
        s.first[:] = k[:size]
        # Also nan, where a stage beyond an event has overflowed, is uncertain.
        s.uncertain = 0.0 if last_term(s) <= PAIR.most_last else 1.0
    if CONSTRAINED and s.passes > 0.0:
        s.uncertain = 0.0  # a loss of rank is passed by one step and no other


def last_term(s: Embedded) -> float:
    """Return the norm of the dense output's last term at its largest, in tolerances."""
    terms, count, squares = s.dense[(PAIR.terms - 1) * s.size :], 0, 0.0
    for i in range(s.size):
        if s.tolerances[i] > 0.0 and terms[i] != 0.0:
            part = control.against(PAIR.largest_weight * terms[i], s.tolerances[i])
            squares += part * part
            count += 1
    return sqrt(squares / max(count, 1))


def interpolate(s: Embedded, p: Parameters, x: float, out: Floats) -> None:
    """Write the state (size,) at the fraction x of the last step to out (II.6, (6.7)).

    If the last term of the polynomial is too large (`uncertain`), the state is computed
    by a step that ends there.
    """
    if PAIR.most_last < inf and s.uncertain > 0.0:
        step_to(s, p, x, out)
        return
    u = 1.0 - x
    for i in apart(s.size):
        value = 0.0
        for m in unrolled(PAIR.terms - 1, 0, -1):
            value = (value + s.dense[m * s.size + i]) * (x if m % 2 == 1 else u)
        out[i] = s.dense[i] + value


def step_to(s: Embedded, p: Parameters, x: float, out: Floats) -> None:
    """Write the state (size,) at the fraction x of the last step, by a step of x h."""
    size, k, y = s.size, s.k, s.dense
    h = x * s.step_h
    k[:size] = s.first
    make_stages(s, p, s.step_t, y, h)
    for i in apart(size):
        out[i] = y[i] + h * total(
            PAIR.weights[j] * k[j * size + i] for j in unrolled(PAIR.last)
        )
    k[:size] = k[PAIR.last * size : (PAIR.last + 1) * size]


def interpolate_rates(s: Embedded, x: float, out: Floats) -> None:
    """Write the derivative of the dense output at x to components n ... of out (size,).

    The components written are the rates that follow q' in y'.
    """
    u = 1.0 - x
    for i in range(s.n, s.size):
        value = 0.0
        slope = 0.0
        for m in unrolled(PAIR.terms - 1, 0, -1):
            value = value + s.dense[m * s.size + i]
            if m % 2 == 1:
                slope = slope * x + value
                value = value * x
            else:
                slope = slope * u - value
                value = value * u
        out[i] = slope / s.step_h
