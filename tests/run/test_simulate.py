"""The run: rows, blocks, outcomes, singular positions, equilibrium."""

import itertools
import math
import signal

import numpy as np
import pytest
from scipy.special import j0, j1, jv, jvp

from lagsim.program.pace import Pace
from lagsim.program.system import BLOCK
from lagsim.run.interrupt import Interrupt
from lagsim.run.trajectory import Outcome
from tests.small_scenes import expected_times, oscillator
from tests.support import ready, run

# Rows


@pytest.mark.parametrize("method", ["", ", method: rk4, step: 0.01"])
@pytest.mark.parametrize(
    ("start", "end", "step"),
    [
        (0.0, 1.0, 0.1),
        (0.0, 1.0, 0.3),  # does not divide: the last row is at the end all the same
        (0.7, 2.0, 0.13),
        (0.0, 3.0, 0.1),  # 30*0.1 misses 3.0 by rounding: one row at 3, not two
        (-5.0, -4.0, 0.25),
        (1e6, 1e6 + 1.0, 0.1),
        (0.0, 0.5, 0.5),
        (0.0, 1.0, 0.0007),
    ],
)
def test_row_times(start, end, step, method):
    simulation = f"start: {start!r}, end: {end!r}, output_step: {step!r}{method}"
    found = run(oscillator(simulation))
    assert list(found["t"]) == expected_times(start, end, step)
    assert found.trajectory.rows == len(found.rows)
    assert found.trajectory.end == end
    assert np.max(np.abs(found["x"] - np.cos(found["t"] - start))) < 1e-9


@pytest.mark.parametrize("output_step", [0.1, 0.025, 0.07, 0.3])
@pytest.mark.parametrize("step", [0.05, 0.03, 0.1, 1 / 30])
def test_rk4_rows_with_a_step_that_divides_or_not(step, output_step):
    found = run(
        oscillator(
            f"duration: 2, output_step: {output_step}, method: rk4, step: {step}"
        )
    )
    assert list(found["t"]) == expected_times(0.0, 2.0, output_step)
    # Whole steps, and a short one to the end where they do not divide the run.
    assert found.trajectory.statistics.steps == math.ceil(2.0 / step - 1e-9)
    # Kutta's error term h^4/120 a radian, the cubic's h^4/384: below h^4/50 over 2 s.
    assert np.max(np.abs(found["x"] - np.cos(found["t"]))) < max(step**4 / 50, 1e-14)


def test_rows_come_in_blocks_so_memory_is_bounded():
    blocks = []

    class Count:
        def add(self, rows):
            blocks.append((len(rows), rows[0, 0], rows[-1, 0]))

    trajectory = ready(oscillator("duration: 30, output_step: 1e-3")).run([Count()])
    assert max(size for size, _, _ in blocks) <= BLOCK
    assert sum(size for size, _, _ in blocks) == trajectory.rows == 30_001
    assert all(a[2] < b[1] for a, b in itertools.pairwise(blocks))


def test_progress_rises_to_the_end():
    seen = []
    run(oscillator("duration: 100, output_step: 0.01"), progress=seen.append)
    assert seen == sorted(seen)
    assert 0.0 <= seen[0] <= seen[-1] <= 1.0
    assert len(seen) >= 3


# Outcomes


COLLISION = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: -1/sqrt(x^2 + y^2)}
initial: {x: 1, y: 0}
simulation: {duration: 3, output_step: 0.01}
"""


@pytest.mark.slow
def test_a_singularity_ends_the_run_with_advice():
    # Straight into the sun: at pi/(2 sqrt 2), x goes as (t_end - t)^(2/3).
    found = run(COLLISION)
    trajectory = found.trajectory
    assert trajectory.outcome is Outcome.STEP_TOO_SMALL
    end = math.pi / (2.0 * math.sqrt(2.0))
    # It stops where steps fall to units in the last place of t.
    assert trajectory.end == pytest.approx(end, rel=0, abs=1e-10)
    assert "`x" in trajectory.reason
    assert f"t = {trajectory.end!r}" in trajectory.reason
    assert list(found["t"][:-1]) == [k * 0.01 for k in range(112)]
    assert found["t"][-1] == trajectory.end
    # The closed form t(x) = (acos(sqrt x) + sqrt(x (1 - x)))/sqrt 2, up to near.
    x = found["x"][:111]
    t = (np.arccos(np.sqrt(x)) + np.sqrt(x * (1.0 - x))) / math.sqrt(2.0)
    assert np.max(np.abs(t - found["t"][:111])) < 1e-9


def test_too_many_steps():
    found = run(oscillator("duration: 1000, output_step: 1"), most_steps=100)
    trajectory = found.trajectory
    assert trajectory.outcome is Outcome.TOO_MANY_STEPS
    assert trajectory.statistics.steps == 100
    x = f"{found['x'][-1]:.6g}"
    where = f"too many steps (100) at t = {trajectory.end!r} (x = {x}, x_dot = "
    assert trajectory.reason.startswith(where)
    assert found["t"][-1] == trajectory.end < 1000.0
    assert np.max(np.abs(found["x"] - np.cos(found["t"]))) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("method", ["", ", method: dop853"])
def test_steps_that_never_pass_a_time(method):
    # Smooth, and infinitely many swings before t = 0.6.
    text = oscillator(f"duration: 1{method}", force="sin(1/(t - 0.6))")
    trajectory = run(text).trajectory
    assert trajectory.outcome is Outcome.TOO_MANY_STEPS
    assert trajectory.statistics.steps < 3_000_000
    assert trajectory.end == pytest.approx(0.6, abs=1e-6)
    assert "t = 0.6)" in trajectory.reason


@pytest.mark.slow
def test_a_motion_that_turns_ever_faster_never_ends():
    # x'' = -exp(2 t) x has J_0(exp(t)): 10^13 turns by t = 32.
    text = oscillator("duration: 32", force="x - exp(2*t)*x", x=j0(1), v=-j1(1))
    found = run(text)
    assert found.trajectory.outcome is Outcome.TOO_MANY_STEPS
    assert found.trajectory.statistics.steps < 300_000
    assert "t = 1" in found.trajectory.reason
    assert np.max(np.abs(found["x"] - j0(np.exp(found["t"])))) < 1e-8


@pytest.mark.slow
def test_a_motion_whose_frequency_is_a_power_of_the_time_goes_on():
    # x'' = -t^6 x has sqrt(t) J_(1/8)(t^4/4).
    x, v = jv(0.125, 0.25), 0.5 * jv(0.125, 0.25) + jvp(0.125, 0.25)
    force, past = "x - t^6*x", "start: 1, duration: 34, output_step: 1"
    found = run(oscillator(past, force=force, x=x, v=v))
    t = found["t"]
    assert found.trajectory.outcome is Outcome.DONE
    assert found.trajectory.statistics.steps > 1 << 18
    exact = np.sqrt(t) * jv(0.125, t**4 / 4)
    assert np.max(np.abs(found["x"] - exact)) < 1e-5 * x


@pytest.mark.slow
@pytest.mark.parametrize("method", ["", ", method: rk4, step: 0.01"])
def test_values_that_are_not_finite(method):
    # sqrt(1 - t): no motion beyond t = 1, and no rows of nan.
    text = oscillator(f"duration: 2, output_step: 0.1{method}", force="sqrt(1 - t)")
    found = run(text)
    trajectory = found.trajectory
    assert trajectory.outcome is Outcome.NOT_FINITE
    assert 0.9 < trajectory.end <= 1.0 + 1e-9
    assert np.all(np.isfinite(found.rows))
    assert found["t"][-1] == trajectory.end
    assert len(found.rows) >= 10


@pytest.mark.parametrize(
    ("potential", "time"),
    [
        # From rest at 1: the integral of dx / sqrt(2 (V(1) - V(x))) down to 0.
        ("-1/abs(x)", math.pi / 2**1.5),
        ("-1/x^2/2", 1.0),
        ("-1/abs(x)^2/2", 1.0),
        ("-1/max(x, -x)", math.pi / 2**1.5),
    ],
)
def test_a_fall_into_a_centre_ends(potential, time):
    # Where the last step cannot be made shorter, it is not tried for ever.
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: "{potential}"}}
initial: {{x: 1}}
simulation: {{duration: 2, output_step: 0.01}}
"""
    found = run(text, most_steps=20_000)
    assert not found.trajectory.outcome.complete
    # Within 1e-6 of the centre speeds are above 1e3: what is left takes no 1e-6.
    assert found.trajectory.end == pytest.approx(time, abs=1e-6)


def test_just_enough_steps_are_no_failure():
    steps = run(oscillator("duration: 10")).trajectory.statistics.steps
    found = run(oscillator("duration: 10"), most_steps=steps)
    assert found.trajectory.outcome is Outcome.DONE


def test_kernels_work_for_a_moment_at_a_time():
    pace, cost = Pace(), 0.0
    for _ in range(40):
        pace.lasted(pace.steps * 1e-7)
    quick = pace.steps
    for _ in range(10):
        cost = pace.steps * 5e-3  # as of a step of a thousand coordinates
        pace.lasted(cost)
    assert quick > 1000
    assert cost < 0.1


def test_an_interrupt_during_the_last_block_does_not_undo_the_end():
    interrupt = Interrupt()
    interrupt.signal = signal.SIGTERM
    found = run(oscillator("duration: 1, output_step: 0.1"), interrupt=interrupt)
    # It was over before anybody looked: complete, whatever has been pressed.
    assert found.trajectory.outcome is Outcome.DONE


def test_events_have_the_rows_they_belong_to_in_a_failed_run():
    found = run(oscillator("duration: 9", force="if(t < 1, 0, 1/(t - 1)^2)"))
    assert found.trajectory.outcome.word == "failed"
    assert found.trajectory.end == 1.0
    assert found["t"][-1] == 1.0


def test_an_interrupt_is_noted_between_short_arcs():
    interrupt = Interrupt()
    interrupt.signal = signal.SIGTERM
    text = oscillator("duration: 1000, output_step: 1", x=0, force="floor(1e4*t)")
    found = run(text, interrupt=interrupt)
    assert found.trajectory.outcome is Outcome.INTERRUPTED
    assert found.trajectory.end == pytest.approx(1e-4)
