"""Texts of a run at its end: the right names, numbers and times."""

import itertools
import math
import re

import pytest

from lagsim.run.trajectory import Outcome
from tests.small_scenes import held_pendulum
from tests.support import run

SCENE = """
coordinates: {{{names}}}
energy: {{kinetic: "{kinetic}", potential: "{potential}"}}
forces: {{{forces}}}
initial: {{{initial}}}
simulation: {{duration: 5, output_step: 0.01}}
"""


def scene(names, potential, initial, forces=""):
    start = {**dict.fromkeys(names, 1), **initial}
    return SCENE.format(
        names=", ".join(f"{n}: {{}}" for n in names),
        kinetic=" + ".join(f"{n}_dot^2/2" for n in names),
        potential=potential,
        forces=forces,
        initial=", ".join(f"{n}: {x}" for n, x in start.items()),
    )


def runaway(which, *, coupled=True, force=False):
    """Return three coordinates of which `which` runs away: w'' = 2 w^3, or w'' = w'^3.

    From 1 at speed 1 the first is 1/(1 - t).
    """
    potential = "(p - q)^2/2 + (q - r)^2/2" if coupled else "0"
    forces = f"{which}: {which}_dot^3" if force else ""
    potential += "" if force else f" - {which}^4/2"
    return scene("pqr", potential, {f"{which}_dot": 1}, forces)


def state_of(reason):
    """Read time and state back from a reason."""
    shown = re.search(r"at t = (\S+) \((.*?)\)", reason)
    pairs = [part.split(" = ") for part in shown[2].split(", ")]
    return float(shown[1]), {name: float(x) for name, x in pairs}


@pytest.mark.slow
@pytest.mark.parametrize("coupled", [True, False])
@pytest.mark.parametrize("which", ["p", "q", "r"])
def test_the_component_that_grows_is_named(which, coupled):
    found = run(runaway(which, coupled=coupled))
    reason = found.trajectory.reason
    assert found.trajectory.outcome.word == "failed"
    assert f"`{which}_dot`" in reason
    t, state = state_of(reason)
    told = float(re.search(r"fastest, at (\S+) per unit", reason)[1])
    assert told == pytest.approx(2 * state[which] ** 3, rel=1e-2)
    assert t == found.trajectory.end == found["t"][-1]
    if not coupled:
        assert t == pytest.approx(1.0, abs=1e-4)
    for name, x in state.items():
        assert x == pytest.approx(found[name][-1], rel=1e-5), name
    assert set(state) == {"p", "q", "r", "p_dot", "q_dot", "r_dot"}


def test_a_coordinate_is_named_and_not_the_ledger():
    reason = run(runaway("q", force=True)).trajectory.reason
    assert "`q_dot`" in reason


@pytest.mark.slow
def test_a_state_of_many_components_is_cut():
    names = [f"x{k}" for k in range(9)]
    springs = " + ".join(f"({a} - {b})^2/2" for a, b in itertools.pairwise(names))
    reason = run(scene(names, f"{springs} - x4^4/2", {"x4_dot": 1})).trajectory.reason
    assert "`x4_dot`" in reason
    shown = re.search(r"\((.*?)\)", reason)[1].split(", ")
    first = [*names, "x0_dot", "x1_dot", "x2_dot"]
    assert [part.split(" = ")[0] for part in shown[:12]] == first
    assert shown[12:] == ["... 6 more"]


def test_the_end_and_until_are_told_with_their_times():
    text = scene("x", "x^2/2", {})
    assert run(text).trajectory.reason == "the end was reached at t = 5.0"
    until = text.replace("duration: 5,", 'duration: 5, until: "x <= 0",')
    told = re.fullmatch(r"`x <= 0` at t = (\S+)", run(until).trajectory.reason)
    assert float(told[1]) == pytest.approx(math.pi / 2, abs=1e-9)


def test_a_step_past_all_constraints_is_told_with_its_state():
    text = held_pendulum(2, "duration: 20, method: rk4, step: 4")
    reason = run(text).trajectory.reason
    where = "at t = 0.0 (x = 0.909297, y = 0.416147, x_dot = 0, y_dot = 0)"
    assert reason.startswith(f"the constraints could not be satisfied {where}: ")


@pytest.mark.slow
def test_a_constraint_that_is_never_met_ends_the_run():
    # At rest on the tip of a cone of velocities, under gravity: the tip is left in no
    # direction more than in another, and rows that vanish project nothing.
    found = run(
        """
        coordinates: {x: {}, y: {}, z: {}}
        energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*z}
        constraints: {cone: x_dot^2 + y_dot^2 = 4*z_dot^2}
        initial: {x: 0, y: 0, z: 0}
        simulation: {duration: 1, output_step: 1e-3}
        """
    )
    assert found.trajectory.outcome is Outcome.NO_ANSWER
    assert "constraint `cone` is not satisfied at t = " in found.trajectory.reason
    assert found.trajectory.statistics.steps < 200_000
