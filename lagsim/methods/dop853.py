"""DOP853: the explicit Runge-Kutta method of order 8 by Dormand and Prince.

Error estimates of order 5 and 3, PI step control, dense output of order 7. Where
stability bounds the steps, that may err much more than they do; its last term tells,
and each row and event is then reached by a step of its own. The method for smooth, non-
stiff motion at tight tolerances. Its stability interval on the imaginary axis, where
undamped oscillations lie, is 5.96: a step cannot exceed about 0.95 periods of the
fastest mode.

Source: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations
I, 2nd ed., sections II.4 (control, (2.43c)), II.5 (method) and II.6 (dense output).
"""

from __future__ import annotations

from math import sqrt

from lagsim.language.arrays import Floats
from lagsim.methods import unrestricted
from lagsim.methods.parts import constraints, control
from lagsim.methods.parts import state as at
from lagsim.methods.parts.driver import State, record_speed, usable_step
from lagsim.methods.parts.fixed import Tableau
from lagsim.methods.parts.missed import check_features
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import derivative
from lagsim.native.kernels.words import apart, total, unrolled
from lagsim.native.layout import array, part
from lagsim.tolerances import OVERFLOW

NAME = "dop853"
TITLE = "Dormand-Prince 8(5,3)"
ORDER = 8
DENSE_ORDER = 7
ADAPTIVE = True
IMAGINARY_LIMIT = 5.96
HANDLES = "any model; equality constraints by projection"
refusal = unrestricted
NEEDS = ()
QUADRATURES = True
STATES = True

CONSTRAINED = True
LOCALIZED = True
SWITCHES = True

STAGES = 16
SAFETY = 0.9
BETA = 0.04
EXPONENT = 0.125 - 0.2 * BETA
SHRINK = 3.0  # a step shrinks at most by this, and grows at most by the next
GROW = 6.0
# An error from which on steps shrink. Beside a switch far from the origin it may be all
# rounding, and steps so short that nothing moves.
SHRINKING = 0.25
# ... and from which on they grow little: so may it be where forces cancel.
SLOWING = 1e-2
# Where a stage meets a loss of rank by accident, a step a little shorter passes it; one
# much shorter ends before it. A stage does where the rows are this much less
# independent there than at the start.
BESIDE = 0.3
ASIDE = 0.85
# The last term of the dense output has the factor x^4 (1 - x)^3: the largest value of
# that, and the value allowed of the term, in tolerances. For y' = a y the error is a
# seventh of the term, for any h a; a step bounded by accuracy has less than 250 at
# 1e-9, over the shipped models, and one bounded by stability from 300 to 1e5.
LARGEST_WEIGHT = 4.0**4 * 3.0**3 / 7.0**7
MOST_LAST = 300.0


class Dop853(State):
    """Memory of DOP853: slopes and state of the stages, the new state, dense output."""

    previous_error: float  # of the last accepted step, for PI control
    uncertain: float  # 1 where the dense output of the last step may err too much
    k: Floats = array(lambda s: STAGES * s.size)
    z: Floats = array("size")
    new: Floats = array("size")
    dense: Floats = array(lambda s: 8 * s.size)
    errors: Floats = part("dense", lambda s: 2 * s.size)


STATE = Dop853


def start(s: Dop853, p: Parameters) -> None:
    """Begin an arc: evaluate y' at its start, choose the first step."""
    derivative(s.t, s.y, p, s.k)
    s.evaluations += 1.0
    s.step_h = 0.0
    s.previous_error = 1e-4
    control.record_sizes(s, p)
    s.h = control.first_step(s, p, ORDER, s.k)
    s.at_bound = 0.0
    if CONSTRAINED:
        s.h = constraints.leave_loss(s, p, s.h)


def step(s: Dop853, p: Parameters) -> int:
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
            s.h = h / min(SHRINK, error**EXPONENT / SAFETY)
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
    grown = error**EXPONENT / (s.previous_error**BETA * SAFETY)
    s.h = h / max(1.0 / GROW, min(SHRINK, grown))
    if rejected:
        s.h = min(s.h, h)
    s.previous_error = max(error, 1e-4)
    return at.DONE


def attempt(s: Dop853, p: Parameters, h: float) -> float:
    """Evaluate the stages of a step; return its error in units of the tolerance."""
    t, size, k, new = s.t, s.size, s.k, s.new
    if CONSTRAINED:
        p.least_sigma = 1.0
    make_stages(s, p, t, s.y, h)
    for i in apart(size):
        new[i] = s.y[i]
        s.remainder[i] = h * total(B[j] * k[j * size + i] for j in unrolled(12))
    control.add_change(s, p, k, h, new)
    s.balanced_alone = 0.0
    control.set_tolerances(s, p, t + h, new, k, h)
    errors = s.errors
    for i in apart(size):
        errors[i] = total(ERROR5[j] * k[j * size + i] for j in unrolled(12))
        errors[size + i] = total(ERROR3[j] * k[j * size + i] for j in unrolled(12))
    sigma = 1.0
    if CONSTRAINED and p.least_sigma < s.close_below:
        sigma = p.least_sigma
    error = error_norm(s, h, errors)
    # The error may be rounding alone.
    doubtful = error >= 1.0
    if SWITCHES:
        doubtful = doubtful or (error >= SHRINKING and control.hardly_moves(s, p, h, k))
    if not doubtful and error >= SLOWING and s.balanced > 0.0:
        doubtful = True
        s.balanced_alone = 1.0
    while doubtful and control.allow_roundoff(s, p, h, new, k, sigma):
        error = min(error, error_norm(s, h, errors))
        doubtful = error >= 1.0
    if CONSTRAINED and error >= 1.0 and constraints.hides_error(s, p):
        constraints.note_directions(s, p, t + h, new)
        removed = h * h * constraints.forget_removed(s, p, h, errors)
        constraints.forget_removed(s, p, h, errors[size:])
        error = constraints.bent(s, removed, error_norm(s, h, errors))
        error = constraints.passable(s, error)
    return error


def make_stages(s: Dop853, p: Parameters, t: float, y: Floats, h: float) -> None:
    """Evaluate the slopes of a step h from y (size,) at t; the first slope is known."""
    size, k = s.size, s.k
    for stage in unrolled(1, 12):
        for i in apart(size):
            slope = total(A[stage][j] * k[j * size + i] for j in unrolled(stage))
            s.z[i] = y[i] + h * slope
        derivative(t + C[stage] * h, s.z, p, k[stage * size :])
    s.evaluations += 11.0


def error_norm(s: Dop853, h: float, errors: Floats) -> float:
    """Combine the estimates of order 5 and 3 (II.10, (10.17)); errors : (2 size,).

    A work is normed together with the motion if this norm exceeds that of the motion
    alone: a work with a large estimate of order 3 alone, as of a polynomial in t beside
    a tolerance of nearly 0, would hide all other errors. The mean is over the
    components with an error; others are at rest. A nan remains, and its step is
    rejected.
    """
    size, moving, tolerances = s.size, s.dynamic.stop, s.tolerances
    error5 = 0.0
    error3 = 0.0
    controlled = 0
    for i in range(size):
        if tolerances[i] > 0.0:
            e5 = control.against(errors[i], tolerances[i])
            e3 = control.against(errors[size + i], tolerances[i])
            if e5 > 0.0:
                controlled += 1
            if i < moving:
                error5 += e5 * e5
                error3 += e3 * e3
    motion = combined(error5, error3)
    error = motion
    for i in range(moving, size):
        if tolerances[i] > 0.0:
            e5 = control.against(errors[i], tolerances[i])
            e3 = control.against(errors[size + i], tolerances[i])
            both = combined(error5 + e5 * e5, error3 + e3 * e3)
            if not both <= motion:
                error += both - motion
    return h * sqrt(error / max(controlled, 1))


def combined(error5: float, error3: float) -> float:
    """Return the error estimate from two squared estimates; nan remains nan."""
    return error5 * (error5 / (error5 + 0.01 * error3)) if error5 != 0.0 else 0.0


def accept(s: Dop853, p: Parameters, h: float) -> None:
    """Accept the new state, and prepare the dense output if a row needs it."""
    size, k, new = s.size, s.k, s.new
    derivative(s.t + h, new, p, k[12 * size :])
    if LOCALIZED:
        check_features(s, p, h, s.y, k, new, k[12 * size :])
    s.step_t = s.t
    s.step_h = h
    s.t = s.t + h
    s.steps += 1.0
    s.evaluations += 1.0
    last = k[11 * size :]
    record_speed(s, h, IMAGINARY_LIMIT, new, k[12 * size :], s.z, last)
    row = s.row_start + s.row * s.row_step
    watched = CONSTRAINED and s.watched > 0.0
    watched = watched or (LOCALIZED and s.feature_possible > 0.0)
    if s.located > 0.0 or watched or (row < s.row_limit and row < s.t):
        prepare_dense(s, p)
    elif s.extras > 0.0 and s.extra < s.t:
        counted = s.evaluations
        prepare_dense(s, p)
        s.evaluations = counted  # nothing that is decided by them depends on it
    s.y[:] = new
    k[:size] = k[12 * size : 13 * size]
    control.keep_compensation(s)
    control.record_measured(s, p)


def prepare_dense(s: Dop853, p: Parameters) -> None:
    """Evaluate the three extra stages, and the coefficients of the polynomial."""
    h, size, y, k, dense = s.step_h, s.size, s.y, s.k, s.dense
    for stage in unrolled(13, 16):
        for i in apart(size):
            slope = total(A[stage][j] * k[j * size + i] for j in unrolled(stage))
            s.z[i] = y[i] + h * slope
        derivative(s.step_t + C[stage] * h, s.z, p, k[stage * size :])
    s.evaluations += 3.0
    for i in apart(size):
        change = s.new[i] - y[i]
        bend = h * k[i] - change
        dense[i] = y[i]
        dense[size + i] = change
        dense[2 * size + i] = bend
        dense[3 * size + i] = change - h * k[12 * size + i] - bend
        for m in unrolled(4):
            slope = total(DENSE[m][j] * k[j * size + i] for j in unrolled(16))
            dense[(4 + m) * size + i] = h * slope
    k[13 * size : 14 * size] = k[:size]
    s.uncertain = 1.0 if last_term(s) > MOST_LAST else 0.0
    if CONSTRAINED and s.passes > 0.0:
        s.uncertain = 0.0  # a loss of rank is passed by one step and no other


def last_term(s: Dop853) -> float:
    """Return the largest norm of the last term of the dense output, in tolerances."""
    size, count, squares = s.size, 0, 0.0
    for i in range(s.dynamic.stop):
        if s.tolerances[i] > 0.0 and s.dense[7 * size + i] != 0.0:
            part = control.against(
                LARGEST_WEIGHT * s.dense[7 * size + i], s.tolerances[i]
            )
            squares += part * part
            count += 1
    return sqrt(squares / max(count, 1))


def interpolate(s: Dop853, p: Parameters, x: float, out: Floats) -> None:
    """Write the state (size,) at the fraction x of the last step (II.6, (6.7)).

    If the polynomial is uncertain, by a step that ends there.
    """
    if s.uncertain > 0.0:
        step_to(s, p, x, out)
        return
    u = 1.0 - x
    for i in apart(s.size):
        value = 0.0
        for m in unrolled(7):
            value = (value + s.dense[(7 - m) * s.size + i]) * (x if m % 2 == 0 else u)
        out[i] = s.dense[i] + value


def step_to(s: Dop853, p: Parameters, x: float, out: Floats) -> None:
    """Write the state (size,) at a fraction x of the last step, by a step to it."""
    size, k, y = s.size, s.k, s.dense
    h = x * s.step_h
    k[:size] = k[13 * size : 14 * size]
    make_stages(s, p, s.step_t, y, h)
    for i in apart(size):
        out[i] = y[i] + h * total(B[j] * k[j * size + i] for j in unrolled(12))
    k[:size] = k[12 * size : 13 * size]


def interpolate_rates(s: Dop853, x: float, out: Floats) -> None:
    """Write the slope (size,) of the dense output at x, from the velocities on."""
    u = 1.0 - x
    for i in range(s.n, s.size):
        value = 0.0
        slope = 0.0
        for m in unrolled(7):
            value = value + s.dense[(7 - m) * s.size + i]
            if m % 2 == 0:
                slope = slope * x + value
                value = value * x
            else:
                slope = slope * u - value
                value = value * u
        out[i] = slope / s.step_h


# --- coefficients, as published by E. Hairer with his code dop853.f -------------------
# 12 stages of order 8, two error estimators, and 3 more stages for a dense output of
# order 7 (Hairer, Norsett and Wanner, Solving ODEs I, II.5 and II.6, 2nd ed. 1993).
# The last stage is the first of the next step: row 12 of A is B.

C = (
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274,
    0.2816496580927726, 0.3333333333333333, 0.25, 0.3076923076923077,
    0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0, 0.1, 0.2,
    0.7777777777777778,
)  # fmt: skip
A = (
    (),
    (0.05260015195876773,),
    (0.0197250569845379, 0.0591751709536137),
    (0.02958758547680685, 0.0, 0.08876275643042054),
    (0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792),
    (0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242),
    (0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125),
    (
        0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328,
        -0.015319437748624402, 0.008273789163814023,
    ),
    (
        0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726,
        27.59209969944671, 20.154067550477894, -43.48988418106996,
    ),
    (
        0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843,
        21.230051448181193, 15.279233632882423, -33.28821096898486,
        -0.020331201708508627,
    ),
    (
        -0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295,
        -8.149787010746927, -18.52006565999696, 22.739487099350505, 2.4936055526796523,
        -3.0467644718982196,
    ),
    (
        2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625,
        -17.9589318631188, 27.94888452941996, -2.8589982771350235, -8.87285693353063,
        12.360567175794303, 0.6433927460157636,
    ),
    (
        0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409,
        1.8915178993145003, -5.801203960010585, 0.3111643669578199,
        -0.1521609496625161, 0.20136540080403034, 0.04471061572777259,
    ),
    (
        0.056167502283047954, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25350021021662483,
        -0.2462390374708025, -0.12419142326381637, 0.15329179827876568,
        0.00820105229563469, 0.007567897660545699, -0.008298,
    ),
    (
        0.03183464816350214, 0.0, 0.0, 0.0, 0.0, 0.028300909672366776,
        0.053541988307438566, -0.05492374857139099, 0.0, 0.0, -0.00010834732869724932,
        0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325,
    ),
    (
        -0.42889630158379194, 0.0, 0.0, 0.0, 0.0, -4.697621415361164,
        7.683421196062599, 4.06898981839711, 0.3567271874552811, 0.0, 0.0, 0.0,
        -0.0013990241651590145, 2.9475147891527724, -9.15095847217987,
    ),
)  # fmt: skip
B = A[12]
ERROR5 = (
    0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502,
    1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571,
    -0.022355307863886294,
)  # fmt: skip
ERROR3 = (
    -0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
    -5.801203960010585, -0.4226823213237919, -0.1521609496625161, 0.20136540080403034,
    0.02265179219836082,
)  # fmt: skip
DENSE = (
    (
        -8.428938276109013, 0.0, 0.0, 0.0, 0.0, 0.5667149535193777,
        -3.0689499459498917, 2.38466765651207, 2.117034582445028, -0.871391583777973,
        2.2404374302607883, 0.6315787787694688, -0.08899033645133331,
        18.148505520854727, -9.194632392478356, -4.436036387594894,
    ),
    (
        10.427508642579134, 0.0, 0.0, 0.0, 0.0, 242.28349177525817, 165.20045171727028,
        -374.5467547226902, -22.113666853125306, 7.733432668472264,
        -30.674084731089398, -9.332130526430229, 15.697238121770845,
        -31.139403219565178, -9.35292435884448, 35.81684148639408,
    ),
    (
        19.985053242002433, 0.0, 0.0, 0.0, 0.0, -387.0373087493518,
        -189.17813819516758, 527.8081592054236, -11.57390253995963, 6.8812326946963,
        -1.0006050966910838, 0.7777137798053443, -2.778205752353508,
        -60.19669523126412, 84.32040550667716, 11.99229113618279,
    ),
    (
        -25.69393346270375, 0.0, 0.0, 0.0, 0.0, -154.18974869023643,
        -231.5293791760455, 357.6391179106141, 93.40532418362432, -37.45832313645163,
        104.0996495089623, 29.8402934266605, -43.53345659001114, 96.32455395918828,
        -39.17726167561544, -149.72683625798564,
    ),
)  # fmt: skip

TABLEAU = Tableau(A[:12], B, C[:12], ORDER)
amplification = TABLEAU.amplification
