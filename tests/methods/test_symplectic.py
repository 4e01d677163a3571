"""Invariants of symplectic methods: structure over one step, energy over many."""

import math

import numpy as np
import pytest

import lagsim
from lagsim.mechanics.equations import Instant
from lagsim.methods import kahan_li6, kahan_li8
from lagsim.run.observers import Keep
from tests.small_scenes import held_pendulum
from tests.support import ready, run

FREE = """
coordinates: {a: {}, b: {}}
energy:
  kinetic: a_dot^2/2 + b_dot^2 + a_dot*b_dot/3
  potential: -cos(a) + a*b^2/2 + b^4/4 + b^2/2
initial: {a: 1, b: 0.3, b_dot: -0.2}
"""
PENDULUM = held_pendulum(2)
# Masses 1 and 2, so that the metric matters; each rod of length 1.
DOUBLE = """
coordinates: {x: {}, y: {}, u: {}, v: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2 + u_dot^2 + v_dot^2, potential: y + 2*v}
constraints: {first: x^2 + y^2 = 1, second: (u - x)^2 + (v - y)^2 = 1}
initial: {x: sin(1), y: -cos(1), u: sin(1) + sin(0.5), v: -cos(1) - cos(0.5)}
"""
# The pivot of the pendulum is shaken: constraint and `work` depend on time.
SHAKEN = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y}
constraints: {rod: x^2 + (y - 0.1*sin(2*t))^2 = 1}
initial: {x: sin(1), y: -cos(1), x_dot: {guess: 0}, y_dot: {guess: 0}}
"""


def test_compositions_are_symmetric_and_meet_the_conditions_that_are_sums():
    # Hairer, Lubich, Wanner, section V.3.2, (3.5) to (3.9): the sums of odd powers; the
    # others are left to the observed orders.
    for module in (kahan_li6, kahan_li8):
        weights = np.array(module.WEIGHTS)
        assert len(weights) == module.STATE.allocate().stages
        assert list(weights) == list(weights[::-1])
        assert abs(math.fsum(weights) - 1.0) < 4e-16
        for power in range(3, module.ORDER, 2):
            assert abs(math.fsum(weights**power)) < 4e-16
        assert abs(math.fsum(weights ** (module.ORDER + 1))) > 1e-5 or module.ORDER == 8
        assert max(abs(weights)) < 0.8


@pytest.mark.parametrize(
    ("table", "power", "derivative"),
    [(kahan_li8.BEND, 3, 2), (kahan_li8.RISE, 2, 1)],
)
def test_the_tables_of_the_dense_output_are_inverses(table, power, derivative):
    w = np.polynomial.Polynomial([0, 1, -1]) ** power
    c = np.polynomial.Polynomial([-0.5, 1])
    rows = [
        [(w * c**m).deriv(derivative)(x) for m in range(4)] for x in kahan_li8.NODES
    ]
    assert np.allclose(np.array(table) @ rows, np.eye(4), rtol=0, atol=1e-13)


def reversed_error(text, **options):
    """Return the distance from the start after a run there and back."""
    session = ready(text, **options)
    case = session.case
    start, n = case.start, len(case.equations.q)
    for _ in range(2):
        keep = Keep()
        session.run([keep])
        last = keep.table[-1]
        turned = Instant(start.t, last[1 : 1 + n], -last[1 + n : 1 + 2 * n], start.s)
        session = session._replace(case=case.at(turned))
    ends = [*turned.q - start.q, *turned.v - start.v]
    assert np.max(np.abs(last[1 : 1 + n] - keep.table[0][1 : 1 + n])) > 0.1
    return np.max(np.abs(ends))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        (FREE, "verlet"),
        (FREE, "kahan-li6"),
        (FREE, "kahan-li8"),
        (PENDULUM, "rattle"),
        (DOUBLE, "rattle"),
    ],
)
def test_running_back_returns_on_the_same_path(text, name):
    # Steps of 1/8 are exact in time; each of 160 steps rounds, and the motion enlarges
    # that by its own sensitivity, below 100 here. RK4 is off by 1e-5.
    text += "simulation: {duration: 10, output_step: 1, step: 1/8, method: rk4}"
    assert reversed_error(text, method=name) < 160 * 2e-16 * 100
    if name == "verlet":
        assert reversed_error(text) > 1e-6


LONG = "simulation: {duration: 20000, output_step: 0.9, method: METHOD, step: STEP}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "name", "step", "most"),
    [
        # 3,000 periods of about 6.7. Errors of (h w)^2/10 and, for order 6 and 8, of
        # that power of h w over a large number.
        (FREE.replace("a: 1, b: 0.3", "a: 0.4, b: 0.2"), "verlet", 0.1, 1e-3),
        (FREE.replace("a: 1, b: 0.3", "a: 0.4, b: 0.2"), "kahan-li6", 0.4, 1e-6),
        (FREE.replace("a: 1, b: 0.3", "a: 0.4, b: 0.2"), "kahan-li8", 0.4, 3e-8),
        (PENDULUM, "rattle", 0.1, 1e-2),
    ],
)
def test_the_energy_swings_and_does_not_drift(text, name, step, most):
    options = LONG.replace("METHOD", name).replace("STEP", str(step))
    found = run(text + options)
    energy = found["energy"] - found["energy"][0]
    assert np.max(np.abs(energy)) < most
    # Rows at all phases: the mean of a tenth of them is off by about a hundredth of
    # the swing, and a drift of that in all would show.
    tenth = len(energy) // 10
    means = [np.mean(part) for part in (energy[:tenth], energy[-tenth:])]
    assert abs(means[1] - means[0]) < 0.03 * np.ptp(energy)
    assert np.max(np.abs(energy[-tenth:])) < 1.1 * np.max(np.abs(energy[:tenth]))


KEPLER = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: "-1/hypot(x, y)"}
initial: {x: 0.7, y: 0, y_dot: sqrt(1.3/0.7)}
simulation: {duration: 2*pi*ORBITS, output_step: 2*pi*EVERY, method: METHOD, step: H}
"""


def kepler(name, orbits, step):
    """Return Kepler's motion with rows at the nearest point, at most 1000 of them."""
    words = {"METHOD": name, "ORBITS": orbits, "EVERY": max(1, orbits // 1000)}
    text = KEPLER.replace("step: H", f"step: {step}")
    for word, value in words.items():
        text = text.replace(word, str(value))
    return text


# The energy is -1/2; it is rounded in rows as the difference of 0.93 and 1.43. Hairer,
# Lubich, Wanner, section VIII.5: what is left is the rounding of the forces, 1e-16
# times a kick of 0.02 in each of 1.7e7 stages, at random: some 8e-15.
@pytest.mark.parametrize(
    ("orbits", "most"),
    [(100, 4e-15), pytest.param(10_000, 2e-14, marks=pytest.mark.slow)],
)
def test_keplers_energy_is_kept_to_rounding(orbits, most):
    assert run(kepler("kahan-li8", orbits, "2*pi/100")).drift < most


def test_one_evaluation_for_each_stage():
    for name, stages in (("verlet", 1), ("kahan-li6", 9), ("kahan-li8", 17)):
        simulation = f"duration: 8, output_step: 1, method: {name}, step: 1/4"
        statistics = run(f"{FREE}simulation: {{{simulation}}}").trajectory.statistics
        assert (statistics.steps, statistics.evaluations) == (32, 1 + 32 * stages)
        assert statistics.rejections == 0
    # Rows within a step cost four more, in that step only: those at 0.3 and 0.6 of
    # each unit are within, the third is its end.
    simulation = "duration: 2, output_step: 3/10, method: kahan-li6, step: 1/2"
    statistics = run(f"{FREE}simulation: {{{simulation}}}").trajectory.statistics
    assert (statistics.steps, statistics.evaluations) == (4, 1 + 4 * 9 + 4 * 4)


@pytest.mark.slow
def test_rattle_accounts_for_work():
    # Order 2: a quarter of the error for half of the step, in a scene whose constraint
    # does work.
    drifts = []
    for step in (0.02, 0.01):
        simulation = f"duration: 10, output_step: 0.1, method: rattle, step: {step}"
        drifts.append(run(f"{SHAKEN}simulation: {{{simulation}}}").drift)
    assert drifts[0] < 1e-3
    assert drifts[0] / drifts[1] == pytest.approx(4.0, rel=0.1)
    found = run(f"{SHAKEN}simulation: {{{simulation}}}")
    exact = run(f"{SHAKEN}simulation: {{duration: 10, output_step: 0.1}}")
    for column in ("x", "y", "x_dot", "y_dot", "lambda_rod", "work"):
        assert np.max(np.abs(found[column] - exact[column])) < 5e-3
        assert np.ptp(exact[column]) > 0.1


TWICE = PENDULUM.replace("x^2 + y^2 = 1", "x^2 + y^2 = 1, again: 2*x^2 + 2*y^2 = 2")
MASSLESS = """
coordinates: {x: {}, y: {}, s: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y + s^2/2}
constraints: {rod: x^2 + y^2 = 1, slide: s = x}
initial: {x: sin(2), y: -cos(2), s: sin(2)}
"""


@pytest.mark.parametrize(
    "text", [TWICE, pytest.param(MASSLESS, marks=pytest.mark.slow)]
)
def test_rattle_on_what_only_the_loops_solve(text):
    options = "duration: 10, output_step: 0.1"
    exact = run(f"{text}simulation: {{{options}}}")
    errors = []
    for step in (0.02, 0.01):
        found = run(f"{text}simulation: {{{options}, method: rattle, step: {step}}}")
        assert np.max(np.abs(found["residual_rod"])) < 1e-15 * 4
        errors.append(np.max(np.abs(found["x"] - exact["x"])))
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.slow
def test_rattle_follows_rods_that_turn_far_in_a_step():
    # Ten rods that whip at the free end: a plain projection onto the old gradients
    # leaves four fifths of the error in each iteration at t = 4.7.
    found = run("chain-cartesian", method="rattle", step="0.005", duration="6")
    assert found.trajectory.outcome.word == "done"
    residuals = [name for name in found.system.columns.names if "residual_" in name]
    assert len(residuals) == 10
    assert max(np.max(np.abs(found[name])) for name in residuals) < 1e-14


# --- forces of time beside events and sections ----------------------------------------
# The search for events once had an array with the name of the times of the stages, and
# overwrote these: errors fell like h in place of h^2 to h^8.

DRIVEN = """\
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^2/2}
forces: {x: sin(3*t)}
modes: {n: 0}
events: {up: {at: x >= 0.3, set: {n: n + 1}}}
output: {sections: {down: {at: x = 0.2, direction: down}}}
initial: {x: 0, x_dot: 0.4}
simulation: {duration: 10, output_step: 0.5}
"""
# Bounds of the error of x at h = 0.02. The phase of the free oscillation is off by
# h^2/24 (verlet) and h^2/12 (midpoint) per second: 1.7e-4 and 3.3e-4 after 10 s, here
# twice these. Order p of the force sin 3t: (3 h)^p/(p + 1)! per second, the remainder
# of its series, is 1.1e-6 (p = 4) and 9e-11 (6) after 10 s, and below rounding (8).
MOST = {
    "verlet": 3.4e-4, "midpoint": 6.7e-4, "rk4": 1e-6, "gauss4": 1e-6,
    "kahan-li6": 1e-9, "kahan-li8": 1e-12,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("method", MOST)
def test_a_driven_oscillator_that_passes_an_event_and_a_section(method):
    result = lagsim.simulate(
        lagsim.load(DRIVEN), method=method, step=0.02, error_bar="never"
    )
    # x'' + x = sin(3 t)
    exact = 0.775 * np.sin(result.t) - np.sin(3.0 * result.t) / 8.0
    assert np.max(np.abs(result["x"] - exact)) <= MOST[method]
    fine = np.linspace(0.0, 10.0, 100_001)
    x = 0.775 * np.sin(fine) - np.sin(3.0 * fine) / 8.0
    assert result["n"][-1] == np.sum((x[:-1] < 0.3) & (x[1:] >= 0.3))
    falls = fine[1:][(x[:-1] > 0.2) & (x[1:] <= 0.2)]
    assert result.sections["down"]["t"] == pytest.approx(falls, abs=1e-3)
