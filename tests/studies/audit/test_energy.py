"""Energy that is gained, lost or drifts: findings and warnings, on spoilt rows too.

Of the whole and of groups that touch no other; jumps of an expression are no error.
"""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import lagsim
from lagsim.mechanics.groups import groups
from lagsim.run.error import ErrorBar
from lagsim.studies.audit.balances import Energy, group_balances
from tests.small_scenes import held_pendulum, scene
from tests.studies.judged import cautions, codes, doubt, evidence
from tests.support import run

SWING = scene("x: 1", "1 - cos(x)", simulation="duration: 10, output_step: 0.01")
ROD = held_pendulum("pi/2", "duration: 10, output_step: 0.01")


def spoilt(found, column, change):
    """Return a run with a function of the time added to a column of its rows."""
    rows = found.rows.copy()
    place = found.system.columns.names.index(column)
    rows[:, place] += change(rows[:, 0])
    return replace(found, rows=rows)


def bar_of(found, error, **more):
    """Return an error estimate that is equal for the coordinate and its rate."""
    t = found.rows[:, 0]
    errors = error(t)[:, None]
    scales = np.ptp(found.rows[:, 1:2], axis=0)
    return ErrorBar("dop853", 1e-13, ("x",), t, errors, scales, rates=errors, **more)


def bump(size):
    return lambda t: size * (np.abs(t - 5.0) < 0.25)


def test_a_sound_run_is_not_in_doubt():
    for text in (SWING, ROD):
        found = run(text)
        assert doubt(found) is None
        assert codes(found) == []


def steady(error, since=0.0):
    return lambda t: error * (t >= since)


def grown(t):
    return 1e-12 * (1 + t)


# The energy in play is 1 - cos 1 = 0.46; the first and the last value are the same. Of
# a speed up to 1 an error of 1e-4 is worth no more than 2e-4. So much more than that
# is a drift: a thousand tolerances, and a millionth at least.
WHOLE = 1.0 - math.cos(1.0)
GAINED, LOST, DRIFTS = ["energy-gained"], ["energy-lost"], ["energy-drifts"]
UNKNOWN, EXPLAINED = ["error-unknown"], steady(1e-3, 4)
# A bump of energy, options of the run, the error that is estimated; the codes, and
# whether that refutes the run: `...` where it is another test's.
SPOILT = [
    (0.3, {}, None, GAINED, True), (3e-3, {}, None, GAINED, True),
    (-0.3, {}, None, LOST, True),
    (0.3, {}, steady(1.0, 4), ..., True),
    (1e-5, {}, None, UNKNOWN, ...), (-1e-4, {}, None, UNKNOWN, ...),
    (1e-5, {"rtol": 1e-6}, None, [], ...), (-1e-4, {"rtol": 1e-6}, None, [], ...),
    (1e-4, {}, grown, ..., True), (1e-4, {}, steady(1e-4, 4), ..., False),
    # An error that comes later explains nothing.
    (1e-4, {}, steady(1e-4, 7), ..., True),
    (1e-5, {}, EXPLAINED, DRIFTS, ...), (-1e-4, {}, EXPLAINED, DRIFTS, ...),
    (1e-3, {}, EXPLAINED, GAINED, ...), (-1e-2, {}, EXPLAINED, LOST, ...),
    *((2 * most * WHOLE, {"rtol": rtol}, EXPLAINED, DRIFTS, ...)
      for rtol, most in ((1e-7, 1e-4), (1e-8, 1e-5), (1e-10, 1e-6))),
    *((0.5 * most * WHOLE, {"rtol": rtol}, EXPLAINED, [], ...)
      for rtol, most in ((1e-7, 1e-4), (1e-8, 1e-5), (1e-10, 1e-6))),
    # Methods with fixed steps are not asked; an absolute tolerance was asked for.
    (0.3, {"method": "rk4", "step": "0.01"}, None, ..., False),
    (1e-5, {"method": "rk4", "step": "0.01"}, steady(1e-6), [], ...),
    (1e-5, {"atol": "1e-5"}, steady(1e-5), [], ...),
]  # fmt: skip


@pytest.mark.slow
def test_spoilt_energy():
    asked = {str(options): options for _, options, *_ in SPOILT}
    sound = {name: run(SWING, **options) for name, options in asked.items()}
    for size, options, error, expected, refuted in SPOILT:
        case = size, options
        found = spoilt(sound[str(options)], "energy", bump(size))
        bar = "not estimated" if error is None else bar_of(found, error)
        assert expected is ... or codes(found, bar) == expected, case
        told = doubt(found, bar)
        if refuted is True:
            assert told.refutes, case
            assert told.time == pytest.approx(4.75, abs=0.02), case
        assert refuted is not False or told is None, case


ONE_SIDED = scene(
    "x: 1, y: 0.3", "y^2/2 + POTENTIAL", simulation="duration: 10, output_step: 0.01"
)
CONTINUOUS = [
    "if(x > 0, x^2, 0) + if(x < 0, 3*x^2, 0)",
    "x^2 + max(0, -x)^2",
    "abs(x)",
    "x^2/2 + if(x > 0.5, (x - 0.5)*y, 0)",
    "x^2 + sign(x)*x^3",
    "x^2 + 1e-3*sign(x + y)*(x + y)",
    "x^2 + if(y > 0, 1, 1)*x^2",
]
JUMPING = [
    "x^2 + if(x > 0, 0.01, 0)",
    "x^2/2 + floor(3*x)",
    "x^2 + sign(y)*(1 + y)",
    "x^2 + if(x > 0 and y > 0, x + y, 0)",
    "x^2 + heaviside(x - 0.2)",
]


@pytest.mark.parametrize("potential", CONTINUOUS)
def test_an_energy_with_switches_is_judged_where_it_is_continuous(potential):
    found = run(ONE_SIDED.replace("POTENTIAL", potential))
    assert found.drift < 1e-8
    assert doubt(found) is None
    told = doubt(spoilt(found, "energy", bump(0.3)))
    assert told.refutes
    assert told.time == pytest.approx(4.75, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("potential", JUMPING)
def test_an_energy_that_jumps_is_not(potential):
    """A jump of the potential makes no impulse, and its energy is another."""
    found = run(ONE_SIDED.replace("POTENTIAL", potential))
    assert found.drift > 1e-3
    assert doubt(found) is None
    assert doubt(spoilt(found, "energy", bump(0.3))) is None


def test_a_jump_that_one_row_alone_shows():
    # At t = 1.01: of the 1001 rows each other one is kept to be looked at.
    potential = "x^2 + if(abs(x - 0.142) < 0.001, 0.01, 0)"
    found = run(ONE_SIDED.replace("POTENTIAL", potential))
    assert found.drift > 1e-3
    assert doubt(found) is None


def test_a_constraint_that_lets_go():
    found = spoilt(run(ROD), "residual_rod", lambda t: 1e-3 * np.maximum(t - 6, 0))
    told = doubt(found)
    assert told.refutes
    assert "`rod`" in told.text
    assert told.time == pytest.approx(6.0, abs=0.05)
    assert "constraint-not-held" in codes(found)


def test_a_constraint_whose_terms_all_vanish_is_held():
    """Off by rounding, and so is all that it is made of; x moves by 1 beside it."""
    text = scene(
        "x: 1, y: 0, z: 0",
        "x^2/2",
        constraints="flat: y - z = 0",
        simulation="duration: 10, method: dop853, formulation: projection",
    )
    found = run(text)
    for name in ("y", "residual_flat", "scale:flat"):
        found = spoilt(found, name, lambda t: 1e-17 * (t > 3))
    assert doubt(found) is None
    assert codes(found) == []
    off = spoilt(found, "residual_flat", lambda t: 1e-3 * (t > 3))
    assert doubt(off).refutes


def test_another_end_is_in_doubt_and_told():
    found = run(SWING)
    bar = bar_of(found, lambda t: 1e-12 * (1 + t), parted="it ended with `done`")
    told = doubt(found, bar)
    assert told is not None
    assert not told.refutes
    assert codes(found, bar) == ["end-in-doubt"]


def test_what_drifts_loosely_off_its_constraint_is_not_judged():
    loose = run(ROD, formulation="drift", method="dop853", rtol="1e-3")
    assert doubt(loose) is None


# Groups that touch no other

# A pendulum of 1 J, and beside it an oscillator of 50 kJ, or more.
BALL = scene(
    "y: 1, z: 1",
    "9.81*y + M*z^2/2",
    "y_dot^2/2 + M*z_dot^2/2",
    parameters="M: 1e5",
    constraints="floor: {relation: y >= 0, restitution: 0.5}",
    simulation="duration: 2, output_step: 0.01",
)
ROD_BESIDE = scene(
    "x: 1, y: 0, z: 1",
    "y + M*z^2/2",
    "(x_dot^2 + y_dot^2)/2 + M*z_dot^2/2",
    parameters="M: 1e5",
    constraints="rod: x^2 + y^2 = 1",
    simulation="duration: 10, output_step: 0.01",
)


def beside(M=1e5, more="", start=0.0, **forces):
    return scene(
        "x: 1, z: 1", f"1 - cos(x) + M*z^2/2{more}", "x_dot^2/2 + M*z_dot^2/2",
        parameters=f"M: {M}", **forces,
        simulation=f"start: {start}, duration: 10, output_step: 0.01",
    )  # fmt: skip


def faster(found, name, speed, since):
    """Return a run whose body of unit mass is faster from a time on."""
    late = found["t"] - found["t"][0] > since
    gain = late * (found[name] * speed + speed**2 / 2)
    wrong = spoilt(found, name, lambda _: late * speed)
    return spoilt(wrong, "energy", lambda _: gain)


def shown(found):
    monitor = evidence(found).monitor
    return {b.names: b for b in group_balances(found.equations, monitor)}


SCENES = [
    beside(),
    beside(M=1e9, start=1e3),
    beside(forces="x: -0.1*x_dot"),
    beside(forces="x: 0.3*sin(t)"),
    beside(forces="z: 1e3*sin(t)"),
    beside(more=" + x*sin(2*t)/10"),
    beside(forces="x: -0.1*x_dot, z: 1e3*sin(t)"),
    beside(forces="x: 0.3*sin(t), z: -1e3*z_dot", M=1e7, start=-50),
    beside(more=" + x*sin(2*t)/10 + sin(3*t)", forces="z: -z_dot"),
    ROD_BESIDE,
]


@pytest.mark.parametrize("text", [*SCENES, BALL])
def test_sound_groups_are_not_in_doubt(text):
    found = run(text)
    assert len(shown(found)) == 2
    for balance in shown(found).values():
        assert balance.drift < 1e-8 * balance.in_play
    assert doubt(found) is None


@pytest.mark.parametrize("text", SCENES)
def test_no_other_energy_hides_what_a_body_gains(text):
    """A velocity that is off by 5 % is 1e-7 of the energy beside it, or less."""
    found = run(text)
    told = doubt(faster(found, "x_dot", 0.05, since=5))
    assert told.refutes
    assert re.search(r"\bx\b", told.text)
    assert not re.search(r"\bz\b", told.text)
    assert told.time - found["t"][0] == pytest.approx(5, abs=0.2)


def test_a_bounce_that_gains_beside_an_oscillator():
    found = run(BALL)
    told = doubt(faster(found, "y_dot", 0.1, since=1))
    assert told.refutes
    assert told.time == pytest.approx(1, abs=0.05)


def test_the_share_of_each_group():
    """The pendulum's energy is 1 - cos 1 = 0.4597, the oscillator's M/2."""
    balance = shown(run(beside()))
    assert balance["x",].in_play == pytest.approx(1 - np.cos(1), rel=1e-2)
    assert balance["z",].in_play == pytest.approx(5e4, rel=1e-2)


@pytest.mark.parametrize(
    "more", [" + 0.1*x*z", " + sqrt(1 + x^2 + z^2)", " + 0.1*(x - z)^2"]
)
def test_what_is_no_sum_is_one_account(more):
    found = run(beside(M=1, more=more))
    assert not shown(found)
    assert doubt(found) is None
    assert doubt(spoilt(found, "energy", bump(0.3))).refutes


@pytest.mark.parametrize("more", [{}, {"forces": "x: -0.1*x_dot"}])
def test_no_group_counts_energy_of_another_that_its_expression_contains(more):
    """M is the identity, but each term of its expression has both velocities."""
    kinetic = "(x_dot + z_dot)^2/2 - x_dot*z_dot"
    more |= {"simulation": "duration: 10, output_step: 0.01"}
    found = run(scene("x: 1, z: 1", "x^2/2 + 5*z^2", kinetic, **more))
    assert groups(found.equations) == [[0], [1]]
    assert not shown(found)
    assert {work.energy for work in found.equations.works} <= {found.equations.energy}
    whole = (found["x_dot"] ** 2 + found["z_dot"] ** 2 + found["x"] ** 2) / 2
    assert found["energy"] == pytest.approx(whole + 5 * found["z"] ** 2, rel=1e-13)
    assert doubt(found) is None
    assert doubt(spoilt(found, "energy", bump(0.3))).refutes


def test_impacts_beside_energy_that_would_round_their_work():
    """A difference of 1.5e15 J would be known to 0.1 J, of 7 J."""
    heavy = BALL.replace("M: 1e5", "M: 1e9").replace("M*z^2/2", "1.5e15*z^2")
    found = run(heavy.replace("y: 1,", "y: 0.7,"), duration=0.6)
    (impact,) = found.trajectory.events
    assert impact.energy == pytest.approx(-0.75 * 9.81 * 0.7, rel=1e-9)
    assert shown(found)["y",].drift < 1e-9
    assert doubt(found) is None
    assert doubt(faster(found, "y_dot", 0.1, since=0.5)).refutes


ALIASED = """
parameters: {{A: {A}, T: {T}, m: {m}}}
coordinates: {{x: {{}}, z: {{}}{more[0]}}}
energy: {{kinetic: m*x_dot^2/2 + z_dot^2/2{more[1]}, potential: z^2}}
forces: {{x: m*A*cos(2*pi*t/T)}}
initial: {{x: 0, z: 1{more[2]}}}
simulation: {{duration: 20*T, output_step: {step}*T}}
"""
ALONE = ("", "", "")
LINKED = (", u: {}", " + m*(x_dot - u_dot)^2", ", u: 0")  # which moves as x does


def aliased(A=1.0, T=1.0, m=1.0, more=ALONE, step=1.0):
    """Return a model whose rows show x at rest, at rate A T sin(2 pi t/T)/(2 pi)."""
    return ALIASED.format(A=A, T=T, m=m, more=more, step=step)


@pytest.mark.parametrize("bar", ["auto", "never"])
@pytest.mark.parametrize("method", ["dop853", "radau"])
@pytest.mark.parametrize(
    "options", [{}, {"more": LINKED}, {"A": 1e-3, "T": 10.0, "m": 1e6}]
)
def test_rows_that_alias_a_group_are_no_fault(method, bar, options):
    model = lagsim.load(aliased(**options))
    found = lagsim.simulate(model, method=method, rtol=1e-5, error_bar=bar)
    assert (found.outcome, found.warnings) == ("done", [])


@pytest.mark.parametrize("more", [ALONE, LINKED])
@pytest.mark.parametrize("step", [0.01, 1.0])
def test_the_energy_in_play_is_that_between_rows_too(step, more):
    found = run(aliased(step=step, more=more))
    greatest = 1 / (8 * np.pi**2)
    # Ends of steps may pass over the greatest rate by a part of a step.
    assert evidence(found).balances[0].in_play == pytest.approx(greatest, rel=0.1)


# Energies whose expression jumps


def turning(potential, k=1.0, X=0.0):
    start, kinetic = "x: X + 1, y: 0.1, y_dot: 1", "k*(x_dot^2 + y_dot^2)/2"
    values, lasts = f"k: {k}, X: {X}", "duration: 10"
    return scene(start, potential, kinetic, parameters=values, simulation=lasts)


PULL = " + k*((x - X)^2 + y^2)/2"
CUT = [
    "k*0.4*atan2(y, x - X)",
    "-k*0.4*atan2(-y, x - X)",
    "k*0.4*atan2(2*y, 2*(x - X))",
    "k*0.4*(atan2(y, x - X) + 3)",
]


def told(found):
    """Return the texts on the energy."""
    return [c.text for c in cautions(found) if c.code.startswith("energy-")]


@pytest.mark.parametrize(("k", "X"), [(1.0, 0.0), (1e6, 0.0), (1e-6, 5.0)])
@pytest.mark.parametrize("potential", CUT)
def test_a_cut_is_no_energy_gained(potential, k, X):
    """Round the cut `energy` changes by k 0.4 2 pi a turn, as a multiple of it."""
    found = run(turning(potential + PULL, k, X))
    steps = (found["energy"] - found["energy"][0]) / (0.8 * np.pi * k)
    assert np.max(np.abs(steps)) > 0.5
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert not told(found)


def test_turns_that_rows_do_not_resolve_are_jumps_of_one_size():
    """Some 6 turns from one row to the next; energy changes by whole jumps."""
    potential = "0.4*atan2(y, x)" + PULL
    text = turning(potential)
    found = run(text, duration="400", output_step="40")
    steps = np.diff(found["energy"]) / (0.8 * np.pi)
    assert np.max(np.abs(steps)) > 2.5
    assert steps == pytest.approx(np.round(steps), abs=1e-7)
    assert not told(found)


STEPS = {
    # potential, and its jump at x = X from below to above
    "if(x > X, a*(x - X) + 0.3*k, 2*a*(x - X))": 0.3,
    "if(x < X, -a*(x - X), 0)": 0.0,
    "k*floor(0.5 + (x - X)/4)*0.3 + k*(x - X)^2/2": None,
    "k*(x - X)^2/2 + 0.4*k*atan(1/(x - X))": 0.4 * np.pi,
    "k*(x - X)^2/2 - 0.4*k*atan((x - X)^(-1))": -0.4 * np.pi,
}


@pytest.mark.parametrize(("k", "X"), [(1.0, 0.0), (1e6, 3.0), (1e-6, -40.0)])
@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize("potential", STEPS)
def test_a_step_of_the_potential_is_no_energy_gained(potential, k, X, beside):
    """The velocity goes on through it, and energy changes by the step."""
    start, kinetic = "x: X - 1, x_dot: 0.9", "k*x_dot^2/2"
    if beside:
        start, kinetic = f"{start}, z: 0, z_dot: 1", f"{kinetic} + 1e3*k*z_dot^2/2"
    values = f"k: {k}, X: {X}, a: -k/3"
    found = run(scene(start, potential, kinetic, parameters=values), duration=5)
    jump = STEPS[potential]
    past = found["x"] > X
    if jump is not None:
        assert set(past.tolist()) == {False, True}
        change = found["energy"] - found["energy"][0]
        assert change == pytest.approx(np.where(past, jump * k, 0.0), abs=1e-9 * k)
    assert not told(found)


def test_a_step_that_loses_energy_beside_a_cut_it_never_meets_is_its_own():
    """An angle that is continuous on the way is no excuse for a drift."""
    text = turning("0.4*atan2(y, x)" + PULL, X=30)
    found = run(text, method="euler", step="0.05")
    [text] = told(found)
    assert "euler" in text


def test_a_step_that_loses_energy_beside_one_that_it_passes_is_told_by_itself():
    """Euler's energy grows by some (1 + h^2) a step, whatever the energy of the angle.

    It is 1 at first, and the angle adds 2.5 on a turn. A jump of 2.5 would be counted
    as 0.9 of the energy in play.
    """
    text = turning("0.4*atan2(y, x)" + PULL)
    found = run(text, method="euler", step="0.01")
    [alarm] = [c for c in cautions(found) if c.code.startswith("energy-")]
    assert alarm.code == "energy-gained"
    part = float(re.search(r" (\d\S*)", alarm.text)[1])
    # Between the medians of the first and the last tenth.
    growth = (1.0001**950 - 1.0001**50) / np.max(found["kinetic"])
    assert growth < part < 3.5 * growth


def test_the_sides_of_an_angle_are_those_of_its_cut():
    found = run(turning("atan2(y, x)"), duration="0.1")
    energy = Energy(found.equations, found.equations.energy)
    above, below = np.array([[0, -1, s, 0, 0] for s in (1e-3, -1e-3)])
    right = np.array([0, 1, 1e-3, 0, 0])
    assert energy.jump(above, below, 1e-9) == pytest.approx(-2.0 * np.pi, abs=3e-3)
    assert energy.jump(below, above, 1e-9) == pytest.approx(2.0 * np.pi, abs=3e-3)
    assert energy.jump(above, right, 1e-9) == 0.0


# Drifts beyond the tolerance

# Two stars about each other, e = 0.28, far from the origin.
STARS = """
parameters: {D: 0, G: 1, m: 1, L: 1, T: 1, heavy: 0}
coordinates: {x: {}, y: {}, u: {}, v: {}MORE}
energy:
  kinetic: m*(x_dot^2 + y_dot^2 + u_dot^2 + v_dot^2)/2KINETIC
  potential: -G*m/hypot(u - x, v - y)POTENTIAL
initial:
  x: (D - 0.5)*L
  y: D*L
  u: (D + 0.5)*L
  v: D*L
  y_dot: -0.6*L/T
  v_dot: 0.6*L/T
INITIAL
simulation: {duration: 200*T, output_step: 0.5*T}
"""
PLAIN = dict.fromkeys(("MORE", "KINETIC", "POTENTIAL", "INITIAL"), "")
BESIDE = {
    "MORE": ", z: {}",
    "KINETIC": " + 1e9*z_dot^2/2",
    "POTENTIAL": " + 1e9*z^2",
    "INITIAL": "  z: 1",
}


def stars(words, **values):
    text = STARS
    for name, more in words.items():
        text = text.replace(name, more)
    return lagsim.load(text).bind(**values)


def told_of(model, **options):
    found = lagsim.simulate(model, **options)
    return found, [w["code"] for w in found.record["warnings"]]


@pytest.fixture(scope="module")
def near():
    """The motion near the origin, which has ten digits more."""
    found, codes = told_of(stars(PLAIN), rtol="1e-13")
    assert codes == ["unused-parameter"]
    return found


@pytest.mark.parametrize(
    ("words", "values"),
    [
        (PLAIN, {"D": 1e9}),
        (PLAIN, {"D": -3e9}),
        (PLAIN, {"D": 1e9, "L": 1e-6, "G": 1e-18}),
        (PLAIN, {"D": 1e9, "T": 1e-3, "G": 1e6}),
        (PLAIN, {"D": 1e9, "m": 1e-9}),
        (BESIDE, {"D": 1e9}),
    ],
)
@pytest.mark.slow
def test_stars_far_from_the_origin(words, values, near):
    found, codes = told_of(stars(words, **values))
    assert "energy-drifts" in codes
    # The motion is that near the origin, moved: within what is told_of of it.
    size, far = values.get("L", 1.0), values["D"]
    true = np.max(np.abs(found["x"] / size - far - near["x"])) / np.ptp(near["x"])
    error = found.record["error"]["coordinates"]["x"]["relative"]
    assert true / 30 < error < 30 * true


@pytest.mark.slow
def test_energy_that_drifts_without_an_estimate_has_one_warning_too():
    _, codes = told_of(stars(PLAIN, D=1e9), error_bar="never")
    assert codes.count("error-unknown") == 1
    assert "energy-drifts" not in codes


@pytest.mark.slow
@pytest.mark.parametrize("far", [1e3, 1e5])
def test_what_is_far_away_and_keeps_its_energy_has_none(far):
    assert told_of(stars(PLAIN, D=far))[1] == ["unused-parameter"]


@pytest.mark.parametrize("far", [1e9, 1e12])
def test_the_rounding_of_a_row_is_no_drift(far):
    # y is off by its last places, and so is its energy; the motion is a parabola.
    start, lasting = f"y: {far}, y_dot: 3", "duration: 0.5, output_step: 0.01"
    text = scene(start, f"9.81*(y - {far})", simulation=lasting)
    assert told_of(lagsim.load(text))[1] == []


# A body beside another

# A light body in units of energy `u`, each with a mistake of another kind.
SPRING = "{u}*x^2/2"
WRONG = {
    "a coarse step": ("rk4", 0.7, SPRING, ""),
    "a method that gains": ("euler", 0.02, SPRING, ""),
    "a method that gains, damped": ("euler", 0.05, SPRING, "x: -0.05*{u}*x_dot"),
    "a coarse step, driven": ("rk4", 0.8, SPRING, "x: 0.1*{u}*sin(0.3*t)"),
    "a cut in its expression": ("euler", 0.05, "{u}*(0.3*atan2(x, -1) + x^2/2)", ""),
}
# A heavy body: what it adds to T and V, a force on it, a constraint.
OTHERS = {
    "heavy": ("z", "M*z_dot^2/2", "M*z^2/2", "", ""),
    "driven": ("z", "M*z_dot^2/2", "M*z^2/2", "z: M*sin(0.7*t)", ""),
    "damped": ("z", "M*z_dot^2/2", "M*z^2/2", "z: -0.1*M*z_dot", ""),
    "moved": ("z", "M*z_dot^2/2", "M*z^2*(1 + 0.1*sin(t))/2", "", ""),
    "bouncing": (
        "z", "M*z_dot^2/2", "9.81*M*z", "",
        "constraints: {{floor: {{relation: z >= 0, restitution: 0.6}}}}",
    ),
    "slipping": (
        "z", "M*z_dot^2/2", "M*z^2/2", "",
        "constraints: {{belt: {{relation: z_dot = 0.3, limit: 0.2*M}}}}",
    ),
}  # fmt: skip
SCENE = """
parameters: {{M: {M}}}
coordinates: {{x: {{}}{q}}}
energy: {{kinetic: {u}*x_dot^2/2{T}, potential: "{V}"}}
{forces}
{constraint}
initial: {{x: 1{start}}}
simulation: {{start: {t}, duration: 12.6, output_step: 0.05}}
"""


def bodies(potential, force, other="", u=1.0, M=1e5, t=0.0):
    q, T, V, push, constraint = OTHERS.get(other, ("",) * 5)
    forces = ", ".join(x for x in (force, push) if x)
    return SCENE.format(
        M=M, u=u, q=q and f", {q}: {{}}", start=q and f", {q}: 1", T=T and f" + {T}",
        V=potential.format(u=u) + (V and f" + {V}"), t=t,
        forces=forces and f"forces: {{{forces.format(u=u)}}}",
        constraint=constraint.format(),
    )  # fmt: skip


def alarmed(text, **options):
    return [c for c in cautions(run(text, **options)) if c.code.startswith("energy")]


@pytest.mark.slow
@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("wrong", WRONG)
def test_a_mistake_is_told_as_it_is_alone(wrong, other):
    method, step, *light = WRONG[wrong]
    (alone,) = alarmed(bodies(*light), method=method, step=step)
    found = alarmed(bodies(*light, other), method=method, step=step)
    own = [c for c in found if re.search(r"\bof x\b", c.text)]
    if other in ("bouncing", "slipping"):  # whose events cut steps, or have rows
        assert [c.code for c in own] == [alone.code]
    else:
        assert [c.text.replace(" of x", "") for c in own] == [alone.text]
    assert all(re.search(r"\bof [xz]\b", c.text) for c in found)


@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("force", ["", "x: -0.05*{u}*x_dot", "x: 0.1*{u}*sin(0.3*t)"])
@pytest.mark.parametrize("M", [1e5, 1e12])
def test_no_alarm_where_all_is_well(force, other, M):
    assert cautions(run(bodies(SPRING, force, other, M=M))) == []


@pytest.mark.parametrize("first", OTHERS)
def test_a_mistake_of_the_heavy_one_is_not_the_light_ones(first):
    """A light pendulum at rest, whatever the heavy one gains."""
    text = bodies(SPRING, "", first).replace("x: 1,", "x: 0,")
    found = alarmed(text, method="euler", step=0.05)
    assert {c.code for c in found} <= {"energy-gained"}
    assert all(re.search(r"\bof z\b", c.text) for c in found)


@pytest.mark.slow
@pytest.mark.parametrize("far", [1, 100])
def test_the_rounding_of_a_constraint_at_rest_is_no_drift(far):
    # A roof of straight pieces: near its corner each piece has the rounding of its
    # values at the points of the table, which are large.
    text = f"""
coordinates: {{x: {{}}, h: {{}}}}
energy: {{kinetic: (x_dot^2 + h_dot^2)/2, potential: 2*h}}
tables:
  roof:
    points: [[{-7000 * far}, {3500 * far}], [0, 0], [{9000 * far}, {4500 * far}]]
    interpolation: linear
    outside: extend
constraints: {{track: h = roof(x - {500 * far})}}
initial: {{x: {{guess: {1669 * far}}}, h: {{guess: {300 * far}}}}}
simulation: {{duration: 1, output_step: 0.5, begin: rest}}
"""
    assert doubt(run(text)) is None
