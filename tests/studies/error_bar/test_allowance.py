"""What judging may cost, and errors that rounded times make."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp, mpf

from lagsim.model.reader import read
from lagsim.run.interrupt import MOST_STEPS
from lagsim.run.trajectory import Outcome
from lagsim.studies.error_bar import Allowance, Repeat
from tests.studies.error_bar.test_error_bar import PENDULUM
from tests.studies.judged import barred
from tests.support import run

WAVE = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: "sign(sin(3*(t - T)))"}
initial: {x: 0}
parameters: {T: START}
simulation: {start: START, duration: 9, output_step: 0.25}
"""


def test_arcs_count_as_steps():
    whole = run(WAVE.replace("START", "0")).trajectory
    assert whole.statistics.arcs == 9  # half periods: 27/pi = 8.6
    count = whole.statistics.steps
    # Five arcs are all that the rest of the steps is worth.
    cut = run(
        WAVE.replace("START", "0"), most_steps=count + 5000, arc_steps=1000.0
    ).trajectory
    assert cut.outcome is Outcome.TOO_MANY_STEPS
    assert cut.statistics.arcs <= 6
    enough = run(
        WAVE.replace("START", "0"), most_steps=MOST_STEPS, arc_steps=1000.0
    ).trajectory
    assert enough.outcome is Outcome.DONE


def test_all_repeats_together_stay_within_the_allowance():
    found = run(PENDULUM)
    allowance = Allowance(found.system, found.trajectory)
    before = allowance.left
    price = Repeat(found.session)
    assert allowance.steps(price) > 1000
    allowance.take(price, found.trajectory)
    assert before > allowance.left > 0.0
    allowance.left = 0.0
    _, bar = barred(read(PENDULUM, "model.yaml"), allowance=allowance)
    assert bar.startswith("a repeat did not finish")


def exact(start, times):
    """Give the exact positions: parabolas between the zeros of the sine."""
    mp.dps = 40
    half, found = mp.pi / 3, []
    for time in times:
        left, x, v, sign = mpf(float(time)) - mpf(start), mpf(0), mpf(0), 1
        while left > 0:
            h = min(left, half)
            x, v = x + v * h + sign * h * h / 2, v + sign * h
            left, sign = left - h, -sign
        found.append(x)
    return found


@pytest.mark.parametrize("start", ["-537.3", "10000.1", "2000000.7"])
def test_times_of_switches_are_rounded_and_told(start):
    checkpoints, bar = barred(read(WAVE.replace("START", start), "model.yaml"))
    rows = checkpoints.rows
    truth = exact(float(start), rows[:, 0])
    off = max(
        abs(float(mpf(float(x)) - y)) for x, y in zip(rows[:, 1], truth, strict=True)
    )
    told = float(np.max(bar.errors))
    assert off > 1e-15  # the zeros of the sine are no doubles
    assert off < 30 * told
    assert told < 1000 * off
