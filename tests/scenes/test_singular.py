"""Motions through configurations in which the constraints lose their independence."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from tests.support import run

# Cranks of length 1 on pivots 1 apart, and a coupler held to both tips. Collinear at
# a = 0, pi, ...: there the anti-parallelogram branches off, and the rows of the two
# horizontal joints depend on each other.
PARALLELOGRAM = """
coordinates: {{a: {{}}, x: {{}}, y: {{}}, c: {{}}, b: {{}}}}
energy:
  kinetic: (a_dot^2 + b_dot^2 + x_dot^2 + y_dot^2 + c_dot^2/12)/2
  potential: {weight}*y
constraints:
  left_x: x - cos(c)/2 = cos(a)
  left_y: y - sin(c)/2 = sin(a)
  right_x: x + cos(c)/2 = 1 + cos(b)
  right_y: y + sin(c)/2 = sin(b)
initial:
  a: {start}
  b: a
  c: 0
  x: cos(a) + 0.5
  y: sin(a)
  a_dot: 1
  b_dot: 1
  x_dot: -sin(a)
  y_dot: cos(a)
simulation: {{duration: 10, output_step: 0.05}}
"""

# Crank and rod of the same length: at a = pi/2 the slider is over the crank's pivot and
# the row of the guide vanishes.
SLIDER_CRANK = """
coordinates: {{a: {{}}, b: {{}}, x: {{}}}}
energy: {{kinetic: (a_dot^2 + b_dot^2 + x_dot^2)/2, potential: 0}}
constraints:
  along: cos(a) + cos(b) = x
  across: sin(a) + sin(b) = 0
initial:
  a: {start}
  b: -a
  x: 2*cos(a)
  a_dot: 1
  b_dot: -1
  x_dot: -2*sin(a)
simulation: {{duration: 10, output_step: 0.05}}
"""

# The angle of N + 1 parallel uprights from the horizontal: all couplers, of mass 1 each
# too, are carried along without turning.
WEIGHT = 9.81


def four_bars(N, *, speed=1.0, length=1.0, duration=10.0, step=0.01):
    """Return IFToMM's N four-bar mechanism in the coordinates of the tips."""
    all_k, cells = range(N + 1), range(N)
    kinetic = [f"(x{k}_dot^2 + y{k}_dot^2)/6" for k in all_k]
    kinetic += [
        f"(x{k}_dot^2 + y{k}_dot^2 + x{k}_dot*x{k + 1}_dot + y{k}_dot*y{k + 1}_dot"
        f" + x{k + 1}_dot^2 + y{k + 1}_dot^2)/6"
        for k in cells
    ]
    potential = [f"{WEIGHT}*y{k}/2" for k in all_k]
    potential += [f"{WEIGHT}*(y{k} + y{k + 1})/2" for k in cells]
    lines = ["coordinates:"]
    lines += [f"  {name}{k}: {{}}" for k in all_k for name in "xy"]
    lines += ["energy:", f"  kinetic: {' + '.join(kinetic)}"]
    lines += [f"  potential: {' + '.join(potential)}", "constraints:"]
    lines += [f"  rod{k}: (x{k} - {length * k!r})^2 + y{k}^2 = 1" for k in all_k]
    lines += [
        f"  coupler{k}: (x{k + 1} - x{k})^2 + (y{k + 1} - y{k})^2 = {length**2!r}"
        for k in cells
    ]
    lines.append("initial:")
    for k in all_k:
        lines += [f"  x{k}: {length * k!r}", f"  y{k}: 1"]
        lines += [f"  x{k}_dot: {speed}", f"  y{k}_dot: 0"]
    lines.append(f"simulation: {{duration: {duration}, output_step: {step}}}")
    return "\n".join(lines) + "\n"


def loops_of(N, *, speed=1.0, length=1.0, tag=""):
    """Return the parts of the mechanism in angles, with two closures for each cell."""
    kinetic = [f"a{k}{tag}_dot^2/6" for k in range(N + 1)]
    potential = [f"{WEIGHT}*sin(a{k}{tag})/2" for k in range(N + 1)]
    constraints = []
    for k in range(N):
        a, b, c = f"a{k}{tag}", f"a{k + 1}{tag}", f"c{k}{tag}"
        turn = f"{length}*{a}_dot*{c}_dot*cos({a} - {c}) + {length**2}*{c}_dot^2/3"
        kinetic.append(f"({a}_dot^2 + {turn})/2")
        potential.append(f"{WEIGHT}*(sin({a}) + sin({b}))/2")
        constraints += [
            f"  x{k}{tag}: cos({a}) + {length}*cos({c}) = {length} + cos({b})",
            f"  y{k}{tag}: sin({a}) + {length}*sin({c}) = sin({b})",
        ]
    initial = [f"  a{k}{tag}: pi/2\n  a{k}{tag}_dot: {-speed}" for k in range(N + 1)]
    initial += [f"  c{k}{tag}: 0\n  c{k}{tag}_dot: 0" for k in range(N)]
    names = [f"a{k}{tag}" for k in range(N + 1)] + [f"c{k}{tag}" for k in range(N)]
    return names, kinetic, potential, constraints, initial


def in_angles(*mechanisms, duration=10.0):
    """Return the model of mechanisms that `loops_of` has made, side by side."""
    names, kinetic, potential, constraints, initial = (
        [line for mechanism in mechanisms for line in mechanism[part]]
        for part in range(5)
    )
    return "\n".join([
        f"coordinates: {{{', '.join(f'{name}: {{}}' for name in names)}}}",
        "energy:", f"  kinetic: {' + '.join(kinetic)}",
        f"  potential: {' + '.join(potential)}",
        "constraints:", *constraints, "initial:", *initial,
        f"simulation: {{duration: {duration}, output_step: 0.01}}", "",
    ])  # fmt: skip


def pendulum(t, N, speed):
    """Return the angle while all uprights stay parallel, by an independent method."""
    inertia, moment = (N + 1) / 3 + N, WEIGHT * ((N + 1) / 2 + N)
    found = solve_ivp(
        lambda _, u: [u[1], -moment / inertia * np.cos(u[0])],
        (t[0], t[-1]), [np.pi / 2, -speed],
        t_eval=t, method="DOP853", rtol=1e-13, atol=1e-13,
    )  # fmt: skip
    return found.y[0]


def check_four_bars(result, N, speed, length):
    """Compare the tips with the pendulum, and the energy with its first value."""
    assert result.trajectory.outcome.complete
    angle = pendulum(result["t"], N, speed)
    # The tolerance is 1e-11, over some ten turns from close to an unstable equilibrium.
    for k in range(N + 1):
        assert np.max(np.abs(result[f"x{k}"] - length * k - np.cos(angle))) < 1e-8
        assert np.max(np.abs(result[f"y{k}"] - np.sin(angle))) < 1e-8
    assert result.drift < 1e-8  # of energies of 20 to 700


def check_told(result, N, speed):
    """Assert an event at each dead point, where all bars lie flat, and no other."""
    t = np.linspace(0, result["t"][-1], 100_001)
    angle = pendulum(t, N, speed)
    flat = np.flatnonzero(np.diff(np.floor(angle / np.pi)))
    lost = sorted({round(e.time, 6) for e in result.trajectory.events})
    assert {e.kind for e in result.trajectory.events} == {"rank"}
    assert lost == pytest.approx(t[flat], abs=1.1 * t[1])


def rank_losses(result, name):
    return [
        e.time
        for e in result.trajectory.events
        if e.kind == "rank" and e.constraint == name
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "method"),
    [
        ("0.5", "auto"),
        ("1", "auto"),
        ("0", "auto"),
        ("0.5", "radau"),
        ("0", "radau"),
        ("0.5", "dopri5"),
        ("1", "dopri5"),
        ("0", "dopri5"),
    ],
)
def test_parallelogram_coasts_through_collinear(start, method):
    # Without weight both cranks turn evenly: M is constant along this branch.
    result = run(PARALLELOGRAM.format(weight=0, start=start), method=method)
    assert result.trajectory.outcome.complete
    turned = float(start) + result["t"]
    # Ten times the tolerance of 1e-11, for an angle that grows to 10.
    assert np.max(np.abs(result["a"] - turned)) < 1e-9
    assert np.max(np.abs(result["b"] - turned)) < 1e-9
    assert np.max(np.abs(result["c"])) < 1e-9
    collinear = np.pi * np.arange(1, 4) - float(start)
    found = rank_losses(result, "left_x")
    for time in collinear[collinear < 10]:
        # Located on a dense output that is right to the tolerance.
        assert min(abs(time - f) for f in found) < 1e-6
    assert all(e.conditioning < 1e-5 for e in result.trajectory.events)
    assert [w.code for w in result.trajectory.warnings].count("rank") == 1


@pytest.mark.slow
def test_parallelogram_under_weight():
    result = run(PARALLELOGRAM.format(weight=3, start="0.5"))
    assert result.trajectory.outcome.complete
    assert result.drift < 1e-9  # of energies of about 5
    assert np.max(np.abs(result["a"] - result["b"])) < 1e-8  # never the other branch
    # On this branch it is a pendulum: (1/2)(1 + 1 + 1) a'^2 + 3 sin a is constant.
    energy = 1.5 * result["a_dot"] ** 2 + 3 * np.sin(result["a"])
    assert np.max(np.abs(energy - energy[0])) < 1e-8
    assert rank_losses(result, "right_x")


@pytest.mark.slow
@pytest.mark.parametrize("start", ["0.7", "pi/2"])
def test_slider_crank_through_dead_centre(start):
    result = run(SLIDER_CRANK.format(start=start))
    assert result.trajectory.outcome.complete
    assert np.max(np.abs(result["a"] + result["b"])) < 1e-8
    # With b = -a and x = 2 cos a: a'^2 (1 + 2 sin(a)^2) is constant.
    speed = result["a_dot"] ** 2 * (1 + 2 * np.sin(result["a"]) ** 2)
    assert np.max(np.abs(speed - speed[0])) < 1e-8
    found = rank_losses(result, "across")
    angles = np.interp(found, result["t"], result["a"])
    # cos(a) = 0 there; rows every 0.05 are interpolated linearly.
    assert np.max(np.abs(np.cos(angles))) < 1e-2
    passed = int(result["a"][-1] / np.pi - 0.5) + (start == "0.7")
    assert len(found) >= passed


def test_nearly_parallel_rows_are_both_held():
    # x = 0 and x + 1e-7 y = 0 leave nothing free: a weight hangs on a tiny angle.
    result = run(
        """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {a: x = 0, b: x + 1e-7*y = 0}
initial: {x: 0, y: 0}
simulation: {duration: 2, output_step: 0.1}
"""
    )
    assert result.trajectory.outcome.complete
    assert np.max(np.abs(result["y"])) < 1e-12
    # lambda_b 1e-7 = 9.81, lambda_a = -lambda_b; half of the digits are left.
    assert result["lambda_b"] == pytest.approx(9.81e7, rel=1e-8)
    assert result["lambda_a"] == pytest.approx(-9.81e7, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("N", "speed", "length"),
    [
        (1, 1, 1.0), (2, 1, 1.0), (3, 1, 1.0), (2, 5, 1.0), (3, -0.5, 3.0), (4, 1, 1.7),
        (10, 1, 1.0),
        pytest.param(40, 1, 1.0, marks=pytest.mark.nightly),
    ],
)  # fmt: skip
def test_four_bars_pass_their_dead_points(N, speed, length):
    # N ranks are lost at once where all lie flat, and each cell could branch there.
    result = run(four_bars(N, speed=speed, length=length))
    check_four_bars(result, N, speed, length)
    if N <= 10:  # more than that are lost at once, too close to each other
        check_told(result, N, speed)


@pytest.mark.parametrize(
    ("N", "speed", "length"),
    [(1, 1, 1), (2, 1, 1), pytest.param(3, 3, 2, marks=pytest.mark.slow)],
)
def test_four_bars_in_angles(N, speed, length):
    # Stages of a step are off these constraints, which divides their error by the
    # independence; the tips' coordinates happen to keep all uprights parallel.
    result = run(in_angles(loops_of(N, speed=speed, length=length)))
    assert result.trajectory.outcome.complete
    angle = pendulum(result["t"], N, speed)
    for k in range(N + 1):
        assert np.max(np.abs(result[f"a{k}"] - angle)) < 1e-8
    assert result.drift < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("speed", [pytest.param(1.0, marks=pytest.mark.slow), 2.3])
def test_two_mechanisms_side_by_side(speed):
    # They lose rank at other times, or all at the same.
    result = run(in_angles(loops_of(1), loops_of(2, speed=speed, tag="b")))
    assert result.trajectory.outcome.complete
    assert np.max(np.abs(result["a0"] - pendulum(result["t"], 1, 1.0))) < 1e-8
    assert np.max(np.abs(result["a2b"] - pendulum(result["t"], 2, speed))) < 1e-8


# A relation that holds at first, a wall out of reach, a limited row that slides from
# the start: with each of them rows hold at times, and the rank is that of the others.
BESIDE = [
    "lock: {relation: a0 = a1, when: t < 0.1}",
    "wall: {relation: a0 >= -500, restitution: 0}",
    "rub: {relation: c0_dot = 1, limit: 0}",
]


@pytest.mark.parametrize("law", BESIDE)
@pytest.mark.parametrize(
    ("N", "method"),
    [(1, "dopri5"), (2, "auto"), pytest.param(3, "dopri5", marks=pytest.mark.slow)],
)
def test_dead_points_beside_laws(N, method, law):
    text = in_angles(loops_of(N), duration=5)
    text = text.replace("constraints:\n", f"constraints:\n  {law}\n", 1)
    result = run(text, method=method)
    assert result.trajectory.outcome.complete
    angle = pendulum(result["t"], N, 1.0)
    for k in range(N + 1):
        assert np.max(np.abs(result[f"a{k}"] - angle)) < 1e-8
    assert rank_losses(result, "x0")


@pytest.mark.slow
@pytest.mark.parametrize("law", ["a >= -500, restitution: 0", "a_dot = 0, limit: 0"])
@pytest.mark.parametrize("method", ["auto", "dopri5"])
def test_a_start_at_a_dead_point_beside_a_law(law, method):
    # Where all lies in a line at the start, one row depends on the others.
    text = PARALLELOGRAM.format(weight=0, start="0")
    row = f"constraints:\n  law: {{relation: {law}}}\n"
    result = run(text.replace("constraints:\n", row, 1), method=method)
    assert result.trajectory.outcome.complete
    assert np.max(np.abs(result["a"] - result["t"])) < 1e-9
    assert np.max(np.abs(result["c"])) < 1e-9


@pytest.mark.parametrize("names", ["along", "across", "along across"])
def test_dead_centre_of_relations_that_hold_at_times(names):
    text = SLIDER_CRANK.format(start="0.7").replace("duration: 10", "duration: 4")
    for relation in ("along: cos(a) + cos(b) = x", "across: sin(a) + sin(b) = 0"):
        name, equation = relation.split(": ")
        if name in names.split():
            held = f"{name}: {{relation: {equation}, when: t < 9}}"
            text = text.replace(relation, held)
    result = run(text)
    assert result.trajectory.outcome.complete
    assert np.max(np.abs(result["a"] + result["b"])) < 1e-8
    speed = result["a_dot"] ** 2 * (1 + 2 * np.sin(result["a"]) ** 2)
    assert np.max(np.abs(speed - speed[0])) < 1e-8
    assert rank_losses(result, "across")


# A body of 1e24 that moves beside the mechanism, and is no part of it.
HEAVY = {
    "coordinates:\n": "coordinates:\n  B: {}\n",
    "kinetic: ": "kinetic: 1e24*B_dot^2/2 + ",
    "initial:\n": "initial:\n  B: 1e6\n  B_dot: 3e3\n",
}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "radau"])
@pytest.mark.parametrize("heavy", [False, True])
@pytest.mark.parametrize("N", [1, 2])
def test_dead_points_whatever_method_is_asked_for(method, heavy, N):
    text = four_bars(N, duration=5.0)
    for old, new in HEAVY.items() if heavy else ():
        text = text.replace(old, new, 1)
    result = run(text, method=method)
    assert result.trajectory.outcome.complete
    angle = pendulum(result["t"], N, 1.0)
    for k in range(N + 1):
        assert np.max(np.abs(result[f"x{k}"] - k - np.cos(angle))) < 1e-8
    check_told(result, N, 1.0)
    # An implicit step finds no solution there, and says who made it instead.
    # A partition of the coordinates may become singular before that.
    choices = [c.choice.split(" from ")[0] for c in result.trajectory.choices]
    handed = [choice for choice in choices if choice.startswith("method")]
    assert handed == (["method: dop853"] if method == "radau" else [])


@pytest.mark.slow  # the slider-crank below turns as often
def test_a_hundred_turns():
    result = run(four_bars(2, speed=9.0, duration=63.0, step=0.1))
    assert result.trajectory.outcome.complete
    angle = pendulum(result["t"], 2, 9.0)
    assert angle[-1] < -2 * np.pi * 99
    # Errors of the speed, 1e-11 of it at each of 200 passages, add up in the angle.
    assert np.max(np.abs(result["y2"] - np.sin(angle))) < 1e-7
    assert result.drift < 1e-8


@pytest.mark.slow
def test_the_slider_crank_for_a_hundred_turns():
    text = SLIDER_CRANK.format(start="0.7").replace("duration: 10", "duration: 650")
    result = run(text)
    assert result.trajectory.outcome.complete
    assert np.max(np.abs(result["a"] + result["b"])) < 1e-8
    speed = result["a_dot"] ** 2 * (1 + 2 * np.sin(result["a"]) ** 2)
    assert np.max(np.abs(speed - speed[0])) < 1e-8
    assert result["a"][-1] > 2 * np.pi * 99


# A relation that has no value beyond a point at which its slope is infinite: the time
# until there, along an arc without forces, and of a pendulum up to its side.
ARC = quad(lambda y: np.sqrt((1 + 4 * y**2) / 5), 0, 1, epsabs=1e-13)[0]
SWING = quad(lambda a: (5.38 + 19.62 * np.cos(a)) ** -0.5, 0, np.pi / 2)[0]
EDGES = [
    ("y = sqrt(1 - x)", "0", "x: 0, y: 1, x_dot: 2, y_dot: -1", ARC),
    *(pytest.param(x, "9.81*y", "x: 0, y: -1, x_dot: 5", SWING, marks=pytest.mark.slow)
      for x in ("y = -sqrt(1 - x^2)", "y = -cos(asin(x))")),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("relation", "potential", "start", "end"), EDGES)
def test_a_relation_ends_at_its_edge(relation, potential, start, end):
    """The run ends there as well; eliminated, the motion would be thrown back."""
    found = run(f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: {potential}}}
constraints: {{c: {relation}}}
initial: {{{start}}}
simulation: {{duration: 3, output_step: 0.1}}
""")
    assert found.trajectory.outcome.failed
    # Near there y has half of the digits.
    assert found.trajectory.end == pytest.approx(end, abs=1e-7)
