"""What ends arcs is a source: a decision of its own making is acted on as it stands."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Choice, Event
from lagsim.run.arcs import Run
from lagsim.run.decisions import Decision, Ending, Source, Turn
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers import Keep
from lagsim.run.pace import MOST_STEPS
from lagsim.run.recorder import MOST_EVENTS, Recorder
from lagsim.run.trajectory import Outcome
from tests.small_scenes import oscillator
from tests.support import ready


class Begun:
    """A run that has not gone anywhere yet, and the rows that it will make."""

    def __init__(self, *sources, duration=4, consumers=(), **keywords):
        session = ready(oscillator(f"duration: {duration}, output_step: 0.25"))
        case, keep = session.case, Keep()
        self.run = Run(
            case.equations, case.start, session.plan, session.system, case.settings,
            [keep, *consumers], **keywords,
        )  # fmt: skip
        self.run.sources[:0] = sources
        self.keep = keep

    def whole(self):
        """Go to the end; give rows (k, columns) and the trajectory."""
        trajectory = self.run.whole(MOST_STEPS)
        return self.keep.table, trajectory


class Kicks(Source):
    """Adds to the velocity at some times."""

    def __init__(self, **kicks):
        self.left = [(float(time), by) for time, by in kicks.values()]

    def limit(self, _arc):
        return self.left[0][0] if self.left else math.inf

    def decide(self, arc, code):
        if code != at.DONE or not self.left or arc.t < self.left[0][0]:
            return None
        _, by = self.left.pop(0)
        return Decision(
            events=(Event(arc.t, "kick"),),
            cautions=(Caution("kicked", "it was kicked"),),
            choices=(Choice("to be kicked", "it was there"),),
            rows=arc.observed()[None, :],
            y=np.add(arc.y, (0.0, by)),
            turn=Turn.ARC,
        )


def test_a_source_of_the_callers_ends_arcs_and_lets_the_state_jump():
    # x'' = -x from 1 at rest; each kick adds by sin(t - time).
    kicks = {"first": (1.1, 0.5), "second": (2.0, -2.0)}
    rows, trajectory = Begun(Kicks(**kicks)).whole()
    t, x, v = rows[:, :3].T
    before = np.arange(len(t)) < 5  # at 0, 0.25, ... 1
    exact, rate = np.cos(t), -np.sin(t)
    for time, by in kicks.values():
        after = t > time
        exact += after * by * np.sin(t - time)
        rate += after * by * np.cos(t - time)
    jumps = np.isin(t, [1.1, 2.0])
    # The tolerance is 1e-11 in each step; 1e-9 is far above what some ten leave.
    assert np.max(np.abs(x - exact)) < 1e-9
    assert np.max(np.abs((v - rate)[~jumps])) < 1e-9
    assert np.max(np.abs(x - np.cos(t))[before]) < 1e-9
    # Rows of both sides, the one on the grid once.
    at_first, at_second = v[t == 1.1], v[t == 2.0]
    assert at_first == pytest.approx([-math.sin(1.1), 0.5 - math.sin(1.1)], abs=1e-9)
    assert len(at_second) == 2
    assert at_second[1] - at_second[0] == pytest.approx(-2.0, abs=1e-9)
    assert [(e.time, e.kind) for e in trajectory.events] == [
        (1.1, "kick"), (2.0, "kick"),
    ]  # fmt: skip
    assert len(trajectory.warnings) == len(trajectory.choices) == 2
    assert trajectory.statistics.arcs == 3
    assert trajectory.outcome is Outcome.DONE


def test_a_source_that_says_nothing_changes_nothing():
    plain, trajectory = Begun().whole()
    rows, other = Begun(Source(), Kicks()).whole()
    assert np.array_equal(rows, plain)
    assert trajectory == other


def test_a_source_may_end_the_run():
    class End(Kicks):
        def decide(self, arc, code):
            found = super().decide(arc, code)
            ending = Ending(Outcome.CONSTRAINT_JUMPS, "gate")
            return found and found._replace(ending=ending, rows=None, y=None)

    rows, trajectory = Begun(End(first=(1.1, 0.0))).whole()
    assert trajectory.end == rows[-1, 0] == 1.1
    assert trajectory.outcome is Outcome.CONSTRAINT_JUMPS
    assert "constraint `gate`" in trajectory.reason


def test_an_arc_by_another_method_has_a_state_of_its_own():
    run = Begun().run
    run.begin()
    arc = run.arc
    kept = arc.state.flat.copy()
    other = arc.by(replace(arc.plan, method="dop853"), arc.system)
    other.tell({"h": 0.125})
    other.put(np.array([3.0, 4.0]))
    other.advance(16, 10)
    assert other.steps > 0
    assert np.array_equal(arc.state.flat, kept)
    assert other.runner.method.NAME == "dop853" != arc.runner.method.NAME


def test_who_takes_rows_may_stop_the_run():
    interrupt = Interrupt()

    class Full:
        """Has room for so many rows."""

        room = 3000

        def add(self, rows):
            self.room -= len(rows)
            if self.room <= 0:
                interrupt.stop()

    begun = Begun(duration=100_000, consumers=[Full()], interrupt=interrupt)
    rows, trajectory = begun.whole()
    assert trajectory.outcome is Outcome.INTERRUPTED
    assert interrupt.asked
    assert interrupt.signal is None
    assert 3000 <= len(rows) == trajectory.rows < 400_000
    assert rows[-1, 0] == trajectory.end < 100_000


def test_events_of_switches_and_constraints_are_kept_up_to_a_number():
    recorder = Recorder([])
    for _ in range(2):
        many = [Event(float(k), "slip", switch="s") for k in range(MOST_EVENTS - 1)]
        recorder.keep(Decision(events=tuple(many)))
    assert len(recorder.events) == MOST_EVENTS
    recorder.keep(Decision(events=(Event(1.0, "rank", "rod", 1e-9),)))
    assert len(recorder.events) == MOST_EVENTS
    recorder.keep(Decision(events=(Event(2.0, "until"), Event(3.0, "impact"))))
    assert [e.kind for e in recorder.events[MOST_EVENTS:]] == ["until", "impact"]
    assert recorder.counts == {
        "slip": 2 * MOST_EVENTS - 2, "rank": 1, "until": 1, "impact": 1,
    }  # fmt: skip
    [caution] = recorder.unlisted()
    assert f"{MOST_EVENTS - 2} of kind slip, 1 of kind rank" in caution.text


def test_events_that_are_all_kept_need_no_word():
    recorder = Recorder([])
    recorder.keep(Decision(events=(Event(1.0, "slip", switch="s"),)))
    assert recorder.unlisted() == []
