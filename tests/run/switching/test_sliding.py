"""Where both sides push onto a surface the motion follows it: friction, and more."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from lagsim.methods import method, names
from tests.run.switching.scenes import events
from tests.support import run


@pytest.mark.slow
def test_dry_friction_to_rest():
    found = run("dry-friction")
    d, w = 0.2 * 9.81 / 100, 10.0
    times = [k * math.pi / w for k in range(1, 6)]
    kinds = ["switch"] * 4 + ["stick"]
    # Turning points are flat: a velocity off by 1e-11 is 1e-11/18 in time, and more as
    # the acceleration falls to a tenth of that.
    assert [t for t, _ in events(found)] == pytest.approx(times, abs=1e-10)
    assert [kind for _, kind in events(found)] == kinds
    assert np.max(np.abs(found["error"])) < 1e-11
    at_rest = found["t"] > times[-1] + 1e-9
    assert found["x"][-1] == pytest.approx(-(0.2 - 10 * d), abs=1e-11)
    assert not np.any(found["x_dot"][at_rest])
    assert np.max(np.abs(found["x_ddot"][at_rest])) < 1e-15
    # Friction holds what the spring pulls.
    assert found["friction"][at_rest] == pytest.approx(100 * found["x"][at_rest])
    assert found.drift < 1e-11
    # Five arcs of a swing each, and one at rest: no chatter.
    assert found.trajectory.statistics.steps < 6 * 40


def slip_phase(K=100.0, F0=5.0, c=2.0, v0=0.2):
    """Return the duration of a slip in stick-slip, and the place where it sticks."""
    s = c / 2
    w = math.sqrt(K - s * s)
    middle = (F0 - c * v0) / K
    a = F0 / K - middle
    b = (v0 - s * a) / w

    def x(t):
        return middle + math.exp(s * t) * (a * math.cos(w * t) + b * math.sin(w * t))

    def slip(t):
        A, B = s * a + w * b, s * b - w * a
        return math.exp(s * t) * (A * math.cos(w * t) + B * math.sin(w * t)) - v0

    length = brentq(slip, 0.3, 0.6, xtol=1e-15)
    return length, x(length)


@pytest.mark.slow
def test_stick_slip_has_its_period():
    found = run("stick-slip")
    length, x_back = slip_phase()
    stuck = (0.05 - x_back) / 0.2
    times, kinds = [0.0, 0.25], ["stick", "slip"]
    while times[-1] + length + stuck < 5:
        times += [times[-1] + length, times[-1] + length + stuck]
        kinds += ["stick", "slip"]
    got = [t for t, _ in events(found)]
    # Errors of 1e-11 of the velocity over an acceleration of about 1.
    assert got[: len(times)] == pytest.approx(times, abs=1e-9)
    assert [k for _, k in events(found)][: len(times)] == kinds
    t = found["t"]
    for begin, end in zip(times[::2], times[1::2], strict=True):
        rows = (t > begin + 1e-6) & (t < end - 1e-6)
        assert np.max(np.abs(found["slip"][rows])) < 1e-15
        assert np.max(np.abs(found["x_ddot"][rows])) < 1e-13
        assert found["friction"][rows] == pytest.approx(100 * found["x"][rows])
    assert found.drift < 1e-11


@pytest.mark.parametrize(
    "options", [{"method": "rk4", "step": 0.01}, {"loops": True}, {"rtol": 1e-6}]
)
def test_stick_slip_by_any_means(options):
    found = run("stick-slip", duration=1, **options)
    length, _ = slip_phase()
    times = [0.0, 0.25, 0.25 + length]
    # RK4 at a tenth of a radian: 1e-5 of the amplitude.
    tight = 1e-9 if options == {"loops": True} else 1e-5
    assert [t for t, _ in events(found)][:3] == pytest.approx(times, abs=tight)


# Not for forces that depend on velocities; or goes over switches.
OTHERS = {"moreau", "kahan-li6", "kahan-li8", "rattle", "verlet"}


@pytest.mark.parametrize("name", sorted({*names()} - OTHERS))
def test_stick_slip_by_every_method(name):
    step = {} if method(name).ADAPTIVE else {"step": 0.004}
    found = run("stick-slip", duration=2, method=name, **step)
    assert [k for _, k in events(found)] == ["stick", "slip"] * 3
    # Euler, of order 1, is off by 0.004 s with steps of 0.004 s; the others less.
    length, _ = slip_phase()
    assert events(found)[2][0] == pytest.approx(0.25 + length, abs=0.01)
    stuck = (found["t"] > 0.25 + length + 0.01) & (found["t"] < 0.9)
    assert np.max(np.abs(found["slip"][stuck])) < 1e-15


TWO = """
parameters: {f: 0.15, k: 1}
coordinates: {x: {}, z: {}}
definitions: {fx: -f*sign(x_dot), fz: -f*sign(z_dot)}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: k*(x - z)^2/2}
forces: {x: fx, z: fz}
initial: {x: 1, z: -1}
simulation: {duration: 20, output_step: 0.05}
"""


@pytest.mark.slow
def test_two_blocks_that_turn_and_stick_together():
    # Mirror images, each on a spring of 2 k to the middle: d = f/2k = 0.075, turning
    # points 1 - 2 n d to +-0.05 after 7 swings, which is within d, so they stay there.
    found = run(TWO)
    swings = [k * math.pi / math.sqrt(2) for k in range(1, 8)]
    # Each event belongs to both, or to one of them and a rounding later to the other.
    times = np.array([t for t, _ in events(found)])
    assert np.min(np.abs(times[:, None] - swings), axis=1) == pytest.approx(0, abs=1e-9)
    assert found["x"][-1] == pytest.approx(0.05, abs=1e-10)
    assert found["z"][-1] == pytest.approx(-0.05, abs=1e-10)
    assert found["fx"][-1] == pytest.approx(0.1, abs=1e-9)
    assert found["fz"][-1] == pytest.approx(-0.1, abs=1e-9)
    assert np.max(np.abs(found["x"] + found["z"])) < 1e-10
    assert found.trajectory.statistics.steps < 9 * 40


STACK = """
parameters: {M: 2, m: 1, mu: 0.3, g: 9.81}
coordinates: {x: {}, z: {}}
definitions: {s: z - x, hold: -mu*m*g*sign(s_dot)}
energy: {kinetic: (M*x_dot^2 + m*z_dot^2)/2, potential: 0}
forces: {s: hold, x: 2*t}
initial: {x: 0, z: 0}
simulation: {duration: 8, output_step: 0.05}
"""


def test_a_block_on_a_sledge_is_carried_until_friction_gives_way():
    # Together x'' = 2 t/3, held by m x''; that is mu m g at t = 1.5 mu g = 4.4145.
    found = run(STACK)
    loose = 1.5 * 0.3 * 9.81
    assert events(found) == [(0.0, "stick"), (pytest.approx(loose, abs=1e-12), "slip")]
    t = found["t"]
    carried = t < loose
    assert found["hold"][carried] == pytest.approx(2 * t[carried] / 3, abs=1e-12)
    assert np.max(np.abs(found["x"][carried] - t[carried] ** 3 / 9)) < 1e-12
    later = t[~carried] - loose
    exact = loose**3 / 9 + loose**2 / 3 * later + 0.3 * 9.81 * later**2 / 2
    assert np.max(np.abs(found["z"][~carried] - exact)) < 1e-10
    assert found.drift < 1e-9


def test_many_blocks_that_start_at_rest_together():
    # Each third block is pulled hard enough to slide, the others hold.
    n = 9
    names = [f"x{i}" for i in range(n)]
    forces = [f"{q}: {i % 3} - 1.5*sign({q}_dot)" for i, q in enumerate(names)]
    text = f"""
coordinates: {{{", ".join(f"{q}: {{}}" for q in names)}}}
energy: {{kinetic: {" + ".join(f"{q}_dot^2/2" for q in names)}, potential: 0}}
forces: {{{", ".join(forces)}}}
initial: {{{", ".join(f"{q}: 0" for q in names)}}}
simulation: {{duration: 2, output_step: 0.1}}
"""
    found = run(text)
    for i, q in enumerate(names):
        assert found[q][-1] == pytest.approx(1.0 if i % 3 == 2 else 0.0, abs=1e-12)
    assert len(events(found)) == 6


BEAD = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {wire: y = x^2/2}
forces: {x: -2*sign(x_dot)}
initial: {x: 1, y: 0.5}
simulation: {duration: 10, output_step: 0.01}
"""


@pytest.mark.slow
@pytest.mark.parametrize("loops", [False, True])
def test_friction_with_a_constraint(loops):
    # From a to b the work is -2 |a - b|: 9.81 (a^2 - b^2)/2 = 2 (a - b) for b < a gives
    # a + b = 4/9.81; it stays where the slope 9.81 x is below 2.
    found = run(BEAD, loops=loops)
    first = 4 / 9.81 - 1
    second = -4 / 9.81 - first
    assert abs(second) * 9.81 < 2
    assert [k for _, k in events(found)] == ["switch", "stick"]
    assert np.min(found["x"]) == pytest.approx(first, abs=1e-4)  # the row beside it
    assert found["x"][-1] == pytest.approx(second, abs=1e-10)
    assert not np.any(found["x_dot"][-100:])
    assert np.max(np.abs(found["residual_wire"])) < 1e-14
    # At rest: weight and friction balance along the wire, lambda is the weight.
    assert found["lambda_wire"][-1] == pytest.approx(9.81, abs=1e-12)
    assert np.max(np.abs(found["x_ddot"][-100:])) < 1e-12


@pytest.mark.slow
def test_a_spiral_of_two_frictions_ends_at_its_limit():
    # Velocities turn through the quadrants, each third of a side shorter: 1/3 + 1/9 ...
    text = """
coordinates: {x: {}, z: {}}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: 0}
forces: {x: -sign(x_dot) + 2*sign(z_dot), z: -sign(z_dot) - 2*sign(x_dot)}
initial: {x: 0, z: 0, x_dot: 1}
simulation: {duration: 10, output_step: 0.1}
"""
    found = run(text)
    zeno = [e.time for e in found.trajectory.events if e.kind == "zeno"]
    assert zeno == pytest.approx([0.5, 0.5], abs=1e-12)
    for v in ("x_dot", "z_dot", "x_ddot", "z_ddot"):
        assert np.max(np.abs(found[v][found["t"] > 0.55])) < 1e-15


@pytest.mark.slow
def test_switches_in_no_time_end_the_run():
    # From rest velocities go round a square that never grows nor shrinks: of no size.
    text = """
coordinates: {x: {}, z: {}}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: 0}
forces: {x: "if(z_dot >= 0, -1, 1)", z: "if(x_dot >= 0, 1, -1)"}
initial: {x: 0, z: 0}
simulation: {duration: 10, output_step: 0.1}
"""
    found = run(text)
    assert found.trajectory.outcome.name == "SWITCHES_ACCUMULATE"
    assert (
        "`if(z_dot >= 0, ...)`, `if(x_dot >= 0, ...)` accumulate"
        in found.trajectory.reason
    )
    assert [w.code for w in found.trajectory.warnings] == ["unresolved-switch"]
    assert found.trajectory.statistics.steps < 1000


@pytest.mark.parametrize("force", [0.5, 1.5, 1.9, -0.5, -1.5, -1.9])
@pytest.mark.parametrize("push", [1.0, -1.0])
def test_friction_whose_bound_depends_on_what_another_holds(force, push):
    # Held, sign(y_dot) counts as push/1.5 between -1 and 1, and the bound 1 or 2 of the
    # other friction as a mean by that.
    found = run(f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
forces:
  x: {force} - if(y_dot > 0, 2, 1)*sign(x_dot)
  y: {push} - 1.5*sign(y_dot)
initial: {{x: 0, y: 0}}
simulation: {{duration: 2, output_step: 0.1}}
""")
    left = max(0.0, abs(force) - (1.5 + push / 3.0))
    t = found["t"]
    assert found["x"] == pytest.approx(math.copysign(left, force) * t**2 / 2, abs=1e-12)
    assert not np.any(found["y"])
    assert found.trajectory.outcome.complete


# Functions f that step up at x = 1. There the force 0.3 - f holds a body at rest, with
# f = 0.3 in the mean of both sides. In the last four several surfaces step together.
FUNCTIONS = [
    "floor(x)^2", "tb(floor(x))", "1.5*tb(floor(x))", "mod(floor(x), 2)",
    "if(floor(x) > 0.5, 1, 0)*floor(x)^2", "exp(floor(x)) - 1", "max(floor(x), 0)^2",
    "mod(-x, 1)^2", "2*sign(floor(x) - 0.5) + 2",
    "heaviside(x - 1)*if(x > 1, 2, 0)", "heaviside(2*x - 2)*floor(x)",
    "ceil(x - 1)*floor(x)", "if(x > 1, if(2*x >= 2, 1, 3), if(x < 1, 0, 5))",
]  # fmt: skip


@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_force_in_a_definition_is_the_force_that_acts(function):
    found = run(f"""
tables: {{tb: {{points: [[-3, 0], [0, 0], [1, 1], [3, 0]], outside: extend}}}}
coordinates: {{x: {{}}}}
definitions: {{f: "{function}", g: "2 + 3*({function})", use: tb(t)}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: 0.3 - f}}
initial: {{x: 1}}
simulation: {{duration: 1, output_step: 0.25}}
""")
    assert np.all(found["x"] == 1.0)
    assert np.max(np.abs(found["x_ddot"])) < 1e-15
    assert found["f"] == pytest.approx(0.3, abs=1e-15)
    assert found["g"] == pytest.approx(2.9, abs=1e-14)
