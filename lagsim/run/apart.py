"""Subsystems that do not touch, integrated apart and shown together.

Each runs on its own, with its own steps, as far as a block of rows; the rows that all
have are joined, and the columns computed from the joined state. So memory is bounded,
whatever the ratio of their speeds.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.run.arc import first_arc
from lagsim.run.arcs import Recorder, Run
from lagsim.run.system.runner import BLOCK
from lagsim.run.trajectory import Ending, Outcome, Statistics, Trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.plan.subsystems import Subsystem
    from lagsim.run.arc import Arc
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Observer


class Part:
    """A subsystem on its way, with the rows that have not been joined yet.

    Attributes
    ----------
    columns : list of int
        Where t, q and q' of a row go in a row of the whole, of n coordinates.
    """

    def __init__(self, part: Subsystem, n: int, first: Arc, **others: Any) -> None:
        self.run = Run(first, [self], **others)
        self.names = ", ".join(part.equations.q)
        self.columns = [0, *(1 + j for j in part.coordinates)]
        self.columns += [1 + n + j for j in part.coordinates]
        self.waiting = np.empty((0, len(self.columns)))
        self.ending: Ending | None = self.run.begin()

    def add(self, rows: Floats) -> None:
        """Keep rows until they are joined."""
        self.waiting = np.concatenate([self.waiting, rows[:, : len(self.columns)]])

    def fill(self, most_steps: int, arc_steps: float) -> None:
        """Go on until a block of rows waits, or to the end."""
        while self.ending is None and len(self.waiting) < BLOCK:
            self.ending = self.run.advance(most_steps, arc_steps)
            if self.ending == _DONE:
                self.run.show_last()

    def join(self, count: int, states: Floats) -> None:
        """Put rows that waited into those of the whole (count, 1 + 2 n)."""
        states[:, self.columns] = self.waiting[:count]
        self.waiting = self.waiting[count:]

    def trajectory(self) -> Trajectory:
        """Put together what it has done so far."""
        return self.run.trajectory(self.ending or _DONE)


_DONE = Ending(Outcome.DONE)


class Apart:
    """A run of subsystems.

    The system of the whole shows the rows; its `parts` are integrated.
    """

    def __init__(
        self,
        whole: Arc,
        observers: Sequence[Observer],
        *,
        interrupt: Interrupt | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        plan, system, start = whole.plan, whole.system, whole.start
        self.settings, self.system, self.runner = whole.settings, system, whole.runner
        self.recorder, self.progress = Recorder(observers), progress
        # Called between two calls of the kernels.
        self.tick: Callable[[Apart], None] | None = None
        self.runner.prepare()
        self.parts = []
        for x, own in zip(plan.parts, system.parts, strict=True):
            alike = x.plan
            if alike.rtol is not None and plan.rtol is not None:
                # A repeat has other tolerances, and other rows.
                alike = replace(alike, rtol=plan.rtol, atol=plan.atol)
            first = first_arc(
                x.subsystem.equations, x.subsystem.at(start), alike, own,
                self.settings, whole.state.longest,
            )  # fmt: skip
            part = Part(x.subsystem, len(start.q), first, interrupt=interrupt)
            self.parts.append(part)

    def whole(self, most_steps: int, arc_steps: float = 0.0) -> Trajectory:
        """Go through the whole run; each arc counts as some steps besides its own."""
        while True:
            if self.tick is not None:
                self.tick(self)
            for part in self.parts:
                part.fill(most_steps, arc_steps)
            self._join()
            reached = min(part.run.t for part in self.parts)
            ended = [part for part in self.parts if part.ending is not None]
            failed = [part for part in ended if part.ending != _DONE]
            if failed or len(ended) == len(self.parts):
                break
            if self.progress is not None:
                self.progress((reached - self.settings.start) / self.settings.duration)
        last = min(failed, key=lambda part: part.run.t, default=ended[0])
        return self._trajectory(last, reached)

    def _join(self) -> None:
        """Hand on the rows that all subsystems have."""
        count = min(len(part.waiting) for part in self.parts)
        if not count:
            return
        states = np.zeros((count, 1 + self.system.size))
        for part in self.parts:
            part.join(count, states)
        self.recorder.hand_on(self.runner.tabulate(states))

    def _trajectory(self, last: Part, reached: float) -> Trajectory:
        """Put together what the subsystems did; `last` decides on the outcome."""
        found = [part.trajectory() for part in self.parts]
        own = found[self.parts.index(last)]
        reason = own.reason
        if not own.outcome.complete:
            reason = f"subsystem ({last.names}): {reason}"
        counts = [x.statistics for x in found]
        return own._replace(
            reason=reason,
            end=reached,
            rows=self.recorder.rows,
            statistics=Statistics(
                sum(x.steps for x in counts),
                sum(x.rejections for x in counts),
                sum(x.evaluations for x in counts),
                sum(x.factorisations for x in counts),
                arcs=sum(x.arcs for x in counts),
            ),
            events=sorted((e for x in found for e in x.events), key=lambda e: e.time),
            event_counts=sum((Counter(x.event_counts) for x in found), Counter()),
            warnings=[w for x in found for w in x.warnings],
            choices=[c for x in found for c in x.choices],
            extents={k: v for x in found for k, v in x.extents.items()},
            largest_energy=sum(x.largest_energy for x in found),
        )
