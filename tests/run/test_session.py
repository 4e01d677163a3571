"""Stages from a model to its rows: cases, their settings, and sessions."""

import itertools
import time

import pytest

from lagsim.model.reader import read
from lagsim.run.session import LAPS, StartError, Stopwatch, check, open_case
from tests.small_scenes import spring
from tests.support import case_of, refused

SPRING = spring(
    "duration: 3, output_step: 0.1, method: dop853", parameters="k: 4, a: 1", x="a"
)
ROD = """
parameters: {l: 1}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: l, y: 0}
simulation: {duration: 1, output_step: 0.1}
"""


@pytest.mark.slow
def test_values_that_are_bound_begin_no_run_where_the_start_is_not_admissible():
    with refused("inadmissible", "rod", kind=StartError):
        case_of(ROD).bind({"l": 2.0})
    case, choices = check(read(ROD, "rod.yaml", {"l": "2"}))
    assert (case.examined.admissible, choices) == (False, ())


def test_a_check_tells_the_choices_of_the_run():
    choices = check(read(ROD, "rod.yaml"))[1]
    assert choices == case_of(ROD).plan().choices != ()


def test_the_laps_of_a_clock_are_all_the_time_there_was(monkeypatch):
    ticks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))
    clock = Stopwatch()
    began = clock._last
    open_case(read(SPRING, "spring.yaml"), clock=clock).ready(clock=clock)
    assert tuple(clock.timings) == LAPS
    assert min(clock.timings[lap] for lap in ("derive", "compile")) > 0.0
    # Between the first reading of the clock and the last nothing is left out.
    assert sum(clock.timings.values()) == clock._last - began
