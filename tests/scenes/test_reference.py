"""Every reference problem without one-sided constraints, to as many digits as it has.

Asked for are 6 correct digits at the default tolerances and 9 at rtol = atol = 1e-12,
or as many as the conditioning allows: a start that is off by a small part of its size
ends off by kappa times that, and so will errors of the size of the tolerance made on
the way.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lagsim.admissibility import examine
from lagsim.equations import derive
from lagsim.plan import make_plan
from lagsim.reader import read
from lagsim.simulate import simulate
from lagsim.system import System
from tests.scenes.reference import PROBLEMS, TWO_SIDED, model_text, states
from tests.support import Keep, run

# The second is for chaotic motion, where the first does not stay small.
NUDGES = (1e-7, 1e-10)
# Fewer digits than these are not asked for: the motion is unpredictable by then.
LEAST = 2.0
# The errors of hundreds or thousands of steps, each of the size of the tolerance, add
# up: one digit.
SLACK = 1.0
DEFAULT, TIGHT = 1e-11, 1e-12
RUNS = {DEFAULT: ({}, 6.0), TIGHT: ({"rtol": "1e-12", "atol": "1e-12"}, 9.0)}


def finer(text):
    """Give rows between the reference times too, for the size of the motion."""
    return text.replace('output_step: "', 'output_step: "1/40*')


def sizes(found):
    """Give the largest coordinate and the largest velocity of a run."""
    names = found.equations.q
    rates = found.equations.velocities
    return (
        max(np.max(np.abs(found[q])) for q in names),
        max(np.max(np.abs(found[v])) for v in rates),
    )


def row_at(found, t):
    return int(np.argmin(np.abs(found["t"] - t)))


def digits(found, state):
    """Give the correct digits of positions and velocities, of the largest of each.

    Bricard and the chain pass through rest: sizes are those of the whole motion.
    """
    k = row_at(found, state.t)
    assert found["t"][k] == pytest.approx(state.t, rel=1e-12)
    size_q, size_v = sizes(found)
    q = max(abs(found[name][k] - x) for name, x in state.q.items())
    v = max(abs(found[f"{name}_dot"][k] - x) for name, x in state.v.items())
    return -math.log10(max(q / size_q, v / size_v, 1e-17))


def nudged(text, nudge, seed):
    """Run from a start that is off by `nudge` in a direction the constraints allow."""
    options = {"rtol": "1e-13", "atol": "1e-13"}
    equations = derive(read(text, "model.yaml", options=options))
    start = examine(equations)
    plan = make_plan(equations, start, formulation="full")
    system = System(equations, plan)
    rng = np.random.default_rng(seed)
    size_q = np.max(np.abs(start.q))
    size_v = np.max(np.abs(start.v))
    q = start.q + nudge * size_q * rng.uniform(-1.0, 1.0, len(start.q))
    v = start.v + nudge * size_v * rng.uniform(-1.0, 1.0, len(start.v))
    if system.m:
        q, v = onto(system, plan, equations.model.simulation.start, q, v)
    keep = Keep()
    simulate(equations, replace(start, q=q, v=v), plan, system, [keep])
    return np.concatenate(keep.blocks)[:, 1 : 1 + 2 * len(start.q)]


def onto(system, plan, t, q, v):
    """Project by Newton's method with the model's own steps."""
    runner = system.link(plan.method)
    runner.prepare()
    n = len(q)
    y = np.concatenate([q, v, np.zeros(int(system.has_work))])
    for _ in range(4):
        y[:n] += runner.function("position_step")(t, y)[:n]
    for _ in range(4):
        y[n : 2 * n] += runner.function("velocity_step")(t, y)[:n]
    return y[:n], y[n : 2 * n]


def amplification(text):
    """Give, for each row, by how much nudges of the start grow, relative to sizes."""
    exact = run(text, rtol="1e-13", atol="1e-13")
    n = len(exact.equations.q)
    size_q, size_v = sizes(exact)
    scale = np.repeat([size_q, size_v], n)
    state = exact.rows[:, 1 : 1 + 2 * n]
    grown = np.zeros(len(state))
    for nudge in NUDGES:
        for seed in range(3):
            off = np.abs(nudged(text, nudge, seed) - state) / scale
            grown = np.maximum(grown, np.max(off, axis=1) / nudge)
    # Errors are made on the way too: what they grow by is at most of the same size.
    return exact["t"], np.maximum.accumulate(np.maximum(grown, 1.0))


@pytest.mark.parametrize("name", TWO_SIDED)
def test_reference(name):
    text = finer(model_text(name))
    times, kappa = amplification(text)
    asked = 0
    for tolerance, (options, wanted) in RUNS.items():
        found = run(text, **options)
        assert found.trajectory.outcome.word == "done"
        for state in states(name):
            k = int(np.argmin(np.abs(times - state.t)))
            allowed = -math.log10(kappa[k] * tolerance) - SLACK
            if allowed < LEAST:
                continue
            asked += 1
            least = min(wanted, allowed)
            assert digits(found, state) >= least, (state.t, tolerance, kappa[k])
    assert asked >= len(RUNS)


@pytest.mark.parametrize(
    "name", [name for name in TWO_SIDED if "initial_accelerations" in PROBLEMS[name]]
)
def test_accelerations_and_multipliers_at_the_start(name):
    first = PROBLEMS[name]["initial_accelerations"]
    found = run(model_text(name))
    a = [found[f"{q}_ddot"][0] for q in first["qddot"]]
    expected = [float(x) for x in first["qddot"].values()]
    size = np.max(np.abs(expected))
    assert a == pytest.approx(expected, rel=0, abs=1e-11 * size)
    lam = [found[f"lambda_c{k}"][0] for k in range(1, 1 + len(first["lambda"]))]
    expected = [float(x) for x in first["lambda"]]
    # Andrews: inertias from 1e-7 to 1e-5 cost the multipliers two digits more.
    size = max(1.0, np.max(np.abs(expected)))
    assert lam == pytest.approx(expected, rel=0, abs=1e-9 * size)


@pytest.mark.parametrize("name", TWO_SIDED)
def test_accelerations_and_multipliers_at_reference_times(name):
    for state in states(name):
        if state.a is None or (name.startswith("double") and state.t > 5.0):
            continue
        found = run(finer(model_text(name)), **RUNS[TIGHT][0])
        k = row_at(found, state.t)
        expected = np.array(list(state.a.values()))
        a = np.array([found[f"{q}_ddot"][k] for q in state.a])
        size = max(np.max(np.abs(found[f"{q}_ddot"])) for q in state.a)
        # They follow from the state, which is right to 9 digits or more.
        assert np.max(np.abs(a - expected)) < 1e-8 * size
        if state.lam is None or name == "bricard":
            continue
        lam = [found[f"lambda_c{j}"][k] for j in range(1, 1 + len(state.lam))]
        names = [f"lambda_c{j}" for j in range(1, 1 + len(state.lam))]
        size = max(np.max(np.abs(found[x])) for x in names)
        assert np.max(np.abs(np.array(lam) - state.lam)) < 1e-8 * size


def test_the_steady_rolling_disk_costs_few_steps():
    # theta and its rate should stay; controlled at rounding level they stalled. Ten
    # seconds are less than three turns: some tens of steps each are plenty.
    for tolerance in RUNS:
        statistics = run(
            model_text("rolling_disk_steady"), **RUNS[tolerance][0]
        ).trajectory.statistics
        assert statistics.steps < 150
        assert statistics.rejections <= 5


def test_bricard_costs_few_steps():
    # Of 24 coordinates 8 stay where they are, and one row of 24 is dependent: off the
    # constraints, in the stages of a step, it must not act as an independent one.
    for tolerance in RUNS:
        statistics = run(
            model_text("bricard"), **RUNS[tolerance][0]
        ).trajectory.statistics
        assert statistics.steps < 400
        assert statistics.rejections <= 10


def test_bricard_keeps_its_order():
    # -29.43 J, all conserved. Where the stages of one step solve with different rows
    # of the dependent 24, the error of a step falls with a lower power of it and rows
    # come out 1000 times worse: 1e-8.
    found = run(finer(model_text("bricard")))
    assert found.drift < 1e-9
    coarse = run(finer(model_text("bricard")), rtol="1e-9")
    ratio = found.trajectory.statistics.steps / coarse.trajectory.statistics.steps
    assert ratio < 100.0 ** (1 / 7)


def test_redundant_rows_cost_no_steps():
    once = run(model_text("pendulum_iftomm_a01"), method="dop853").trajectory.statistics
    thrice = run(
        model_text("pendulum_duplicate_constraints"), method="dop853"
    ).trajectory.statistics
    assert abs(thrice.steps - once.steps) <= 2
    assert thrice.rejections <= once.rejections + 2


def test_redundant_rows_share_their_force():
    found = run(model_text("pendulum_duplicate_constraints"), method="dop853")
    x, y = found["x"], found["y"]
    force = -9.81 * 3.0 * y  # tension of the pendulum let go from the horizontal
    for q, arm in (("x", x), ("y", y)):
        assert np.max(np.abs(found[f"Qc_{q}"] + force * arm)) < 1e-9
    # Of least norm: along the rows' lengths 2, 4 and 1.
    assert np.allclose(found["lambda_c2"], 2.0 * found["lambda_c1"], rtol=0, atol=1e-9)
    assert np.allclose(found["lambda_c3"], found["lambda_c1"] / 2, rtol=0, atol=1e-9)
