"""Taylor: the power series of the motion, computed on the expression graph.

Recurrences give the coefficients up to order K, operation by operation: as
straight-line code, or, if that is long, as a loop over the order with vectorised
products. K follows from the tolerance (15 at the default), the step from the last four
coefficients; two alone vanish at a symmetric start, and the error would then grow
without a warning. The next step's series, which is needed anyway, gives the defect of
the equations at the end of the step: a step that is too long is repeated. If that
happens to most steps, the model is stiff. Rows between steps are values of the series,
to full order. The method for tight tolerances; it takes longer to compile than others.
On the imaginary axis order 15 does not grow for step * frequency below 1.66, and beyond
by less than its truncation error, which limits the step. If an expression has a value
but no derivatives (drag that grows with the square of the speed, at rest), there is no
series, and `dop853` continues.

Sources: A. Jorba and M. Zou, Experimental Mathematics 14 (2005), sections 3.1 to 3.3;
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd
ed., section I.8.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.methods.parts.adaptive import usable_step
from lagsim.methods.parts.controller import (
    LOCAL,
    foresee,
    look_again,
    record_measured,
    record_sizes,
    set_tolerances,
)
from lagsim.methods.parts.interface import series
from lagsim.methods.parts.looks import suspect
from lagsim.methods.parts.noise import (
    TIGHT,
    find_drift,
    keep_rest,
    look_at_rounding,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.power_series import (
    MOST_ORDER,
    Taylor,
    buffer,
    chosen_step,
    is_finite,
    lead,
    log2_of,
    misfit,
    reach,
    sum_rates,
    two_to_the,
)
from lagsim.methods.parts.projection import met_part, project
from lagsim.methods.parts.singular import leave_loss, passable, record_between
from lagsim.methods.parts.state import (
    DONE,
    LOSS_AHEAD,
    NOT_FINITE,
    PROJECTION_FAILED,
    STEP_TOO_SMALL,
)
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.structure import Structure

NAME = "taylor"
TITLE = "Taylor series, order from the tolerance"
ORDER = 15  # at the default tolerance
DENSE_ORDER = 15
ADAPTIVE = True
IMAGINARY_LIMIT = 1.66
HANDLES = "smooth models, not large; equality constraints"

NEEDS = ("series",)

CONSTRAINED = True
SLEEPERS = True
SWITCHES = True

LEAST_ORDER = 4
# At tight tolerances steps of lower order, shorter and more of them, cost the same and
# average more of what forces are rounded by.
TIGHT_ORDER = 14
# A step made anew is shortened by not less than the first, not more than the second.
# An error of up to this many tolerances is let pass: the bound is for the step before.
PASSED = 1.0
SHORTER = 0.9
# A step that is shorter than this part of the last one is asked for the reason.
SUDDEN = 0.7
# So often the first step and its tolerances are made to agree, to this part.
LOOKS = 20
SETTLED = 0.7
SHORTEST = 0.2


def order_for(rtol: float) -> int:
    """Give the order for a tolerance (Jorba and Zou, (3-5))."""
    order = math.ceil(1.0 - 0.5 * math.log(LOCAL * max(rtol, 1e-300)))
    most = TIGHT_ORDER if rtol < TIGHT else MOST_ORDER
    return min(max(order, LEAST_ORDER), most)


def refusal(_scene: Structure) -> str:
    """Give "": what it cannot handle shows when its code is estimated."""
    return ""


def amplification(z: complex) -> float:
    """Give the size of the sum of z^k / k! up to ORDER."""
    return abs(sum(z**k / math.factorial(k) for k in range(ORDER + 1)))


STATE = Taylor


def start(s: Taylor, p: Parameters) -> None:
    """Begin an arc: the series at its start, the first step."""
    size = s.size
    y = s.y
    c = s.series
    s.which = 0.0
    series(s.t, y, p, c)
    s.evaluations += 1.0
    s.step_h = 0.0
    begin_trials(s)
    record_sizes(s, p)
    rates = at(c, 1 + size)
    look_at_rounding(s, p, s.t, y, rates, 1.0)
    foresee(s, p, rates)
    # Tolerances depend on the step, and on where it leads what is at rest.
    new = s.new
    # One that was taken back has a length to begin with.
    first = s.most_step if s.most_step > 0.0 else s.row_step
    s.h = min(float(first), s.end - s.t)
    for _ in range(LOOKS):
        before = s.h
        lead(size, c, before, new)
        set_tolerances(s, p, s.t, new, rates, before)
        s.h = min(before, chosen_step(s, c, s.t))
        if s.h > SETTLED * before:
            break
    if CONSTRAINED:
        s.h = leave_loss(s, p, s.h)


def step(s: Taylor, p: Parameters) -> int:
    """Make one accepted step, or give a code other than 0.

    Around its one series lies all else: what proposes a state, and what concludes from
    the series there.
    """
    while True:
        code = propose(s, p)
        if code != DONE:
            return code
        series(s.t + s.trial, s.new, p, at(s.series, buffer(s.size, 1.0 - s.which)))
        if conclude(s, p):
            return DONE
        # Close to a loss of rank a series enlarges rounding by powers of the step.
        if CONSTRAINED and s.passes > 0.0:
            return LOSS_AHEAD


def propose(s: Taylor, p: Parameters) -> int:
    """Leave a step to try as s.trial, the state after it as s.new.

    Or give a code other than 0, that of what was wrong with the last one tried.
    """
    while True:
        h = usable_step(s, p)
        if h == 0.0:
            return int(s.trouble)
        s.trial = h
        if attempt(s, p, h) == 0:
            s.h = SHORTEST * h
            s.trouble = NOT_FINITE
        elif CONSTRAINED and project(s, p, s.t + h, h, s.new, s.work) == 0:
            s.h = 0.25 * h
            s.trouble = PROJECTION_FAILED
        else:
            return DONE
        s.rejected = 1.0
        s.rejections += 1.0


def conclude(s: Taylor, p: Parameters) -> bool:
    """Accept the step that was tried, or choose a shorter one.

    From the series after it, which lies where the present one does not.
    """
    h = s.trial
    # How independent the rows are there, as the projection has left it.
    health = s.work[s.n + 1]
    error = check(s, p, h)
    if error <= PASSED:
        accept(s, p, h)
        if CONSTRAINED:
            record_between(s, p, health, h)
        return True
    s.h = SHORTEST * h
    s.trouble = NOT_FINITE
    if error < 1e300:
        shorter = two_to_the(log2_of(PASSED / error) / (s.series[0] + 1.0))
        s.h = h * max(SHORTEST, SHORTER * shorter)
        s.trouble = STEP_TOO_SMALL
    s.rejected = 1.0
    s.rejections += 1.0
    return False


def begin_trials(s: Taylor) -> None:
    """Begin a step: nothing has been tried yet."""
    s.trouble = STEP_TOO_SMALL
    s.rejected = 0.0


def attempt(s: Taylor, p: Parameters, h: float) -> int:
    """Give the state after a step of length h; 0 where it is not finite."""
    size = s.size
    new = s.new
    c = at(s.series, buffer(size, s.which))
    if s.rtol < TIGHT and s.rejected == 0.0:
        find_drift(s, p, at(c, 1 + size), s.drift)
    reach(s, c, s.rest, h, new)
    # Beside that, as each of both sums waits for itself.
    sum_rates(size, 0, c, h, s.rates)
    return 1 if is_finite(size, new) else 0


def check(s: Taylor, p: Parameters, h: float) -> float:
    """Give the error in units of the tolerance, from y' at the end of the step.

    What the series' rate differs by there from y' is (K + 1) y_(K+1) h^K and what
    follows; the next step's series has y'.
    """
    size = s.size
    c = at(s.series, buffer(size, s.which))
    following = at(s.series, buffer(size, 1.0 - s.which))
    new = s.new
    s.evaluations += 1.0
    set_tolerances(s, p, s.t + h, new, at(c, 1 + size), h)
    error = misfit(s, c[0], at(following, 1 + size), s.rates, h)
    # Perhaps it is nothing but rounding.
    doubtful = error > PASSED and error < 1e300
    if doubtful and look_again(s, p, h, new, at(c, 1 + size), 1.0):
        error = misfit(s, c[0], at(following, 1 + size), s.rates, h)
    return passable(s, error) if CONSTRAINED else error


def accept(s: Taylor, p: Parameters, h: float) -> None:
    """Take the new state and its series; the old one is the dense output."""
    size = s.size
    y = s.y
    new = s.new
    following = at(s.series, buffer(size, 1.0 - s.which))
    rates = at(following, 1 + size)
    # First what the next step waits for; what follows here does not.
    next_ = chosen_step(s, following, s.t + h)
    if SLEEPERS:
        before = at(s.series, buffer(size, s.which) + 1 + size)
        suspect(s, p, h, y, before, new, rates)
    if CONSTRAINED:
        s.met = met_part(s, following[0] + 1.0)
    s.which = 1.0 - s.which
    rest = s.rest
    carried = s.carried
    for i in range(size):
        y[i] = new[i]
        carried[i] = rest[i]
    keep_rest(s)
    s.step_t = s.t
    s.step_h = h
    s.t = s.t + h
    s.steps += 1.0
    record_measured(s, p)
    s.h = next_
    if next_ < SUDDEN * h:
        # Perhaps it is rounding that the last coefficients consist of.
        look_at_rounding(s, p, s.t, y, rates, 1.0)
        set_tolerances(s, p, s.t, y, rates, h)
        s.h = chosen_step(s, following, s.t)
    s.at_bound = max(s.at_bound + (1.0 if s.rejected > 0.0 else -1.0), 0.0)
    begin_trials(s)


def interpolate(s: Taylor, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step: the series there."""
    before = at(s.series, buffer(s.size, 1.0 - s.which))
    reach(s, before, s.carried, x * s.step_h, out)


def interpolate_rates(s: Taylor, x: float, out: Floats) -> None:
    """Give the slope of that, from the velocities on."""
    before = at(s.series, buffer(s.size, 1.0 - s.which))
    sum_rates(s.size, s.n, before, x * s.step_h, out)
