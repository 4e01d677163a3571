"""The way of a model to its rows: cases, what they ask for, and sessions."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.mechanics.instant import Instant
from lagsim.model.reader import read
from lagsim.run.observers import Keep
from lagsim.run.session import LAPS, Clock, StartError, check, open_case, wanted
from lagsim.run.trajectory import Outcome
from tests.support import case_of

SPRING = """
parameters: {k: 4, a: 1}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
initial: {x: a}
simulation: {duration: 3, output_step: 0.1, method: dop853}
"""
ROD = """
parameters: {l: 1}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: l, y: 0}
simulation: {duration: 1, output_step: 0.1}
"""


def rows(session):
    keep = Keep()
    assert session.run([keep]).outcome is Outcome.DONE
    return keep.table


def off(found, amplitude, rate):
    """Give how far x is from amplitude*cos(rate*t)."""
    return np.max(np.abs(found[:, 1] - amplitude * np.cos(rate * found[:, 0])))


def test_values_that_are_bound_are_those_of_the_run():
    case = case_of(SPRING)
    assert off(rows(case.ready()), 1.0, 2.0) < 1e-9
    other = case.bind({"k": 9.0, "a": "3/2"})
    assert other.equations.graph is case.equations.graph
    assert off(rows(other.ready()), 1.5, 3.0) < 1e-9


def test_another_state_to_start_from():
    case = case_of(SPRING)
    other = case.at(Instant(0.0, np.array([0.0]), np.array([2.0])))
    found = rows(other.ready())
    assert np.max(np.abs(found[:, 1] - np.sin(2.0 * found[:, 0]))) < 1e-9


def test_settings_are_asked_for_beside_the_model():
    case = case_of(SPRING).asking(end=1.0, method="rk4", step=0.01)
    session = case.ready()
    found = rows(session)
    assert session.plan.method == "rk4"
    assert found[-1, 0] == 1.0
    # Order 4: h^4 w^5 t/120 is about 3e-9.
    assert 1e-11 < off(found, 1.0, 2.0) < 1e-7


def test_a_session_runs_again_at_other_tolerances(monkeypatch):
    session = case_of(SPRING).ready()
    tight = rows(session)

    def compiled(*_):
        pytest.fail("nothing is compiled again")

    monkeypatch.setattr("lagsim.run.system.object_code", compiled)
    loose = rows(session.by(replace(session.plan, rtol=1e-4)))
    assert off(tight, 1.0, 2.0) < 1e-9 < off(loose, 1.0, 2.0) < 1e-2
    few = session.asking(output_step=1.0)
    assert np.array_equal(rows(few)[:, 0], [0.0, 1.0, 2.0, 3.0])
    assert session._replace(most_steps=3).run([]).outcome is Outcome.TOO_MANY_STEPS


def test_a_start_that_is_not_admissible_begins_no_run():
    model = read(ROD, "rod.yaml", {"l": "2"})
    with pytest.raises(StartError, match="rod") as told:
        open_case(model)
    assert told.value.exit_code == 1
    assert not told.value.examined.admissible
    case, choices = check(model)
    assert (case.examined.admissible, choices) == (False, ())
    with pytest.raises(StartError):
        case_of(ROD).bind({"l": 2.0})


def test_a_check_tells_the_choices_of_the_run():
    choices = check(read(ROD, "rod.yaml"))[1]
    assert choices == case_of(ROD).plan().choices != ()


def test_what_cannot_be_run_is_told_at_once():
    text = ROD.replace("duration: 1, ", "")
    model = read(text, "rod.yaml")
    with pytest.raises(InputError) as told:
        wanted(model, "sweep", hint="say how long")
    (problem,) = told.value.problems
    assert problem.code == "missing-key"
    assert "`sweep`" in problem.text
    assert problem.hint == "say how long"


def test_the_laps_of_a_clock_are_all_the_time_there_was(monkeypatch):
    ticks = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))
    clock = Clock()
    began = clock._last
    open_case(read(SPRING, "spring.yaml"), clock=clock).ready(clock=clock)
    assert tuple(clock.timings) == LAPS
    assert min(clock.timings[lap] for lap in ("derive", "compile")) > 0.0
    # Between the first reading of the clock and the last nothing is left out.
    assert sum(clock.timings.values()) == clock._last - began
