"""Every reference problem without one-sided constraints, to as many digits as it has.

Asked for are 6 correct digits at the default tolerances and 9 at rtol = atol = 1e-12,
or as many as the conditioning allows: a start that is off by a small part of its size
ends off by kappa times that, and so will errors of the size of the tolerance made on
the way. That number is found without lagsim.
"""

import functools
import itertools
import math

import numpy as np
import pytest

from tests.scenes.reference import (
    CONDITIONS,
    PROBLEMS,
    TWO_SIDED,
    accelerations,
    model_text,
    states,
)
from tests.support import run

# Fewer digits than these are not asked for: the motion is unpredictable by then.
LEAST = 2.0
# The errors of hundreds or thousands of steps, each of the size of the tolerance, add
# up: a factor of four.
SLACK = 0.6
DEFAULT, TIGHT = 1e-11, 1e-12
RUNS = {DEFAULT: ({}, 6.0), TIGHT: ({"rtol": "1e-12", "atol": "1e-12"}, 9.0)}


@functools.cache
def played(name, tolerance):
    """Run a problem at a tolerance, with rows between the reference times."""
    return run(finer(model_text(name)), **RUNS[tolerance][0])


def finer(text):
    """Return rows between the reference times too, for the size of the motion."""
    return text.replace('output_step: "', 'output_step: "1/40*')


def sizes(found):
    """Return the largest coordinate and the largest velocity of a run."""
    names = found.equations.q
    rates = found.equations.velocities
    return (
        max(np.max(np.abs(found[q])) for q in names),
        max(np.max(np.abs(found[v])) for v in rates),
    )


def row_at(found, t):
    return int(np.argmin(np.abs(found["t"] - t)))


def digits(found, state):
    """Return the correct digits of positions and velocities, of the largest of each.

    Bricard and the chain pass through rest: sizes are those of the whole motion.
    """
    k = row_at(found, state.t)
    assert found["t"][k] == pytest.approx(state.t, rel=1e-12)
    size_q, size_v = sizes(found)
    q = max(abs(found[name][k] - x) for name, x in state.q.items())
    v = max(abs(found[f"{name}_dot"][k] - x) for name, x in state.v.items())
    return -math.log10(max(q / size_q, v / size_v, 1e-17))


def allowed(kappa, tolerance):
    """Return the digits that a tolerance leaves where errors grow by kappa."""
    return -math.log10(kappa * tolerance) - SLACK


def predictable(name, tolerance):
    """Return the states, with references and digits, that are compared."""
    found = []
    references = sorted(PROBLEMS[name]["reference"], key=lambda r: float(r["t_value"]))
    for state, reference, kappa in zip(
        states(name), references, CONDITIONS[name], strict=True
    ):
        assert reference["digits_trusted"] >= 11
        if allowed(kappa, tolerance) >= LEAST:
            found.append((state, reference, allowed(kappa, tolerance)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", RUNS)
@pytest.mark.parametrize("name", TWO_SIDED)
def test_reference(name, tolerance):
    found, wanted = played(name, tolerance), RUNS[tolerance][1]
    assert found.trajectory.outcome.word == "done"
    asked = predictable(name, tolerance)
    assert asked
    for state, _, least in asked:
        assert digits(found, state) >= min(wanted, least), (state.t, least)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name in TWO_SIDED if "initial_accelerations" in PROBLEMS[name]]
)
def test_accelerations_and_multipliers_at_the_start(name):
    first, end = PROBLEMS[name]["initial_accelerations"], PROBLEMS[name]["t_end"]
    text = model_text(name, f"({PROBLEMS[name]['t0']}) + 1e-6*({end})")
    found = run(text, output_step=f"1e-6*({end})")
    a = [found[f"{q}_ddot"][0] for q in first["qddot"]]
    expected = [float(x) for x in first["qddot"].values()]
    size = np.max(np.abs(expected))
    assert a == pytest.approx(expected, rel=0, abs=1e-11 * size)
    lam = [found[f"lambda_c{k}"][0] for k in range(1, 1 + len(first["lambda"]))]
    expected = [float(x) for x in first["lambda"]]
    # Andrews: inertias from 1e-7 to 1e-5 cost the multipliers two digits more.
    size = max(1.0, np.max(np.abs(expected)))
    assert lam == pytest.approx(expected, rel=0, abs=1e-9 * size)


# Stored by the authors of the references, besides those that follow from the states.
STORED = {"andrews", "caraxis", "double_pendulum_cartesian"}


# What sympy derives of many bodies takes seconds.
LARGE = {"andrews", "bricard"}


@pytest.mark.parametrize(
    "name",
    [pytest.param(x, marks=[pytest.mark.slow] * (x in LARGE)) for x in TWO_SIDED],
)
def test_accelerations_and_multipliers_at_reference_times(name):
    """They follow from the state by equations that sympy derives."""
    found = played(name, TIGHT)
    names = found.equations.q
    problem = PROBLEMS[name]
    count = len([*problem["holonomic"], *problem["nonholonomic"]])
    rows = [f"c{k}" for k in range(1, 1 + count)]
    columns = [f"{q}_ddot" for q in names]
    groups = {"a": columns, "lam": [f"lambda_{r}" for r in rows]}
    groups["Qc"] = [f"Qc_{q}" for q in names] if rows else []
    asked = predictable(name, TIGHT)
    assert asked
    for state, reference, least in asked:
        k = row_at(found, state.t)
        parts = accelerations(name, reference)
        expected = dict(zip(("a", "lam", "Qc"), parts, strict=True))
        if name in STORED:
            stored = np.array([float(reference["qddot"][q]) for q in names])
            size = np.max(np.abs(stored))
            assert np.max(np.abs(expected["a"] - stored)) < 1e-10 * size
            stored = np.array([float(x) for x in reference["lambda"]])
            size = np.max(np.abs(stored))
            assert np.max(np.abs(expected["lam"] - stored)) < 1e-9 * size
        # One digit fewer than the state, at most 1e-8 of the largest.
        off = 10.0 ** (1.0 - min(9.0, least))
        for group, listed in groups.items():
            if not listed:
                continue
            size = max(np.max(np.abs(found[x])) for x in listed)
            got = np.array([found[x][k] for x in listed])
            assert np.max(np.abs(got - expected[group])) < off * size, (group, state.t)


@pytest.mark.parametrize(
    ("name", "steps", "rejections"),
    [
        # theta and its rate should stay; controlled at rounding level they stalled. Ten
        # seconds are less than three turns: some tens of steps each are plenty.
        ("rolling_disk_steady", 150, 5),
        # Of 24 coordinates 8 stay where they are, and one row of 24 is dependent: off
        # the constraints, in a step's stages, it must not act as an independent one.
        pytest.param("bricard", 400, 10, marks=pytest.mark.slow),
    ],
)
def test_what_stays_costs_few_steps(name, steps, rejections):
    for asked, *_ in RUNS.values():
        found = run(model_text(name), **asked).trajectory.statistics
        assert found.steps < steps
        assert found.rejections <= rejections


@pytest.mark.slow
def test_bricard_takes_fewer_steps_where_less_is_asked():
    # Coordinates that rest by symmetry have no range of their own: controlled by that,
    # they ask for shorter steps than those that move, the more so at loose tolerances.
    # By a method of order 8 steps grow by 100^(1/8) for each hundredth of a tolerance.
    steps = [
        run(finer(model_text("bricard")), rtol=rtol).trajectory.statistics.steps
        for rtol in ("1e-5", "1e-7", "1e-9", "1e-11", "1e-13")
    ]
    assert all(1.3 * loose < tight for loose, tight in itertools.pairwise(steps))


@pytest.mark.slow
def test_bricard_keeps_its_order():
    # -29.43 J, all conserved. Where the stages of one step solve with different rows
    # of the dependent 24, the error of a step falls with a lower power of it and rows
    # come out 1000 times worse: 1e-8.
    found = run(finer(model_text("bricard")))
    assert found.drift < 1e-9
    coarse = run(finer(model_text("bricard")), rtol="1e-9")
    ratio = found.trajectory.statistics.steps / coarse.trajectory.statistics.steps
    assert ratio < 100.0 ** (1 / 7)


@pytest.mark.slow
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
