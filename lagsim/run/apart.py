"""Subsystems that do not touch, integrated apart and shown together.

Each runs on its own, with its own steps, as far as a block of rows; the rows that all
have are joined, and the columns computed from the joined state. So memory is bounded,
whatever the ratio of their speeds.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.run.arcs import BLOCK, Run
from lagsim.run.trajectory import Outcome, Statistics, Trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.state import State
    from lagsim.model.settings import Settings
    from lagsim.plan import Plan
    from lagsim.plan.subsystems import Subsystem
    from lagsim.run.arcs import Consumer
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.system import System


class Part(Run):
    """A subsystem on its way, with the rows that have not been joined yet."""

    def __init__(
        self,
        part: Subsystem,
        start: State,
        plan: Plan,
        system: System,
        settings: Settings,
        interrupt: Interrupt | None,
        longest_step: float,
    ) -> None:
        super().__init__(
            part.equations, part.at(start), plan, system, settings, [], interrupt,
            None, longest_step,
        )  # fmt: skip
        n = len(part.coordinates)
        full = len(start.q)
        self.consumers = [self]
        self.names = ", ".join(part.equations.q)
        # Where t, q and q' of a row go in a row of the whole.
        self.columns = [0, *(1 + j for j in part.coordinates)]
        self.columns += [1 + full + j for j in part.coordinates]
        self.width = 1 + 2 * n
        self.waiting = np.empty((0, self.width))
        self.outcome: Outcome | None = None
        self._begin_arc(self.settings.end)

    def add(self, rows: Floats) -> None:
        """Keep rows until they are joined."""
        self.waiting = np.concatenate([self.waiting, rows[:, : self.width]])

    def fill(self, most_steps: int) -> None:
        """Go on until a block of rows waits, or to the end."""
        while self.outcome is None and len(self.waiting) < BLOCK:
            self.outcome = self.advance(most_steps)
        if self.outcome is Outcome.DONE and self.rows_left:
            self._last_row()
            self.rows_left = False

    rows_left = True


class Apart:
    """A run of subsystems.

    Parameters
    ----------
    system : System
        Of the whole: it shows the rows. Its `parts` are integrated.
    """

    def __init__(
        self,
        start: State,
        plan: Plan,
        system: System,
        settings: Settings,
        consumers: Sequence[Consumer],
        interrupt: Interrupt | None,
        progress: Callable[[float], None] | None,
        longest_step: float,
    ) -> None:
        self.system, self.consumers, self.progress = system, consumers, progress
        self.runner = system.link(system.plan.method)
        self.runner.prepare()
        self.settings = settings
        self.parts = []
        for x, own in zip(plan.parts, system.parts, strict=True):
            alike = x.plan
            if alike.rtol is not None and plan.rtol is not None:
                # A repeat has other tolerances, and other rows.
                alike = replace(alike, rtol=plan.rtol, atol=plan.atol)
            part = Part(
                x.subsystem, start, alike, own, settings, interrupt, longest_step
            )
            self.parts.append(part)
        self.rows = 0

    def whole(self, most_steps: int, arc_steps: float = 0.0) -> Trajectory:
        """Go through the whole run."""
        for part in self.parts:
            part.arc_steps = arc_steps
        while True:
            for part in self.parts:
                part.fill(most_steps)
            self._join()
            reached = min(part.t for part in self.parts)
            ended = [part for part in self.parts if part.outcome is not None]
            failed = [part for part in ended if part.outcome is not Outcome.DONE]
            if failed or len(ended) == len(self.parts):
                break
            if self.progress is not None:
                self.progress((reached - self.settings.start) / self.settings.duration)
        return self._trajectory(min(failed, key=_time, default=ended[0]), reached)

    def _join(self) -> None:
        """Hand on the rows that all subsystems have."""
        count = min(len(part.waiting) for part in self.parts)
        if not count:
            return
        states = np.zeros((count, 1 + self.system.size))
        for part in self.parts:
            states[:, part.columns] = part.waiting[:count]
            part.waiting = part.waiting[count:]
        rows = self.runner.tabulate(states)
        self.rows += count
        for consumer in self.consumers:
            consumer.add(rows)

    def _trajectory(self, last: Part, reached: float) -> Trajectory:
        """Put together what the subsystems did; `last` decides on the outcome."""
        assert last.outcome is not None
        found = [part.trajectory(part.outcome or Outcome.DONE) for part in self.parts]
        own = found[self.parts.index(last)]
        reason = own.reason
        if not own.outcome.complete:
            reason = f"subsystem ({last.names}): {reason}"
        counts = [x.statistics for x in found]
        return replace(
            own,
            reason=reason,
            end=reached,
            rows=self.rows,
            statistics=Statistics(
                sum(x.steps for x in counts),
                sum(x.rejections for x in counts),
                sum(x.evaluations for x in counts),
                sum(x.factorisations for x in counts),
                arcs=sum(x.arcs for x in counts),
            ),
            events=sorted((e for x in found for e in x.events), key=lambda e: e.time),
            warnings=[w for x in found for w in x.warnings],
            choices=[c for x in found for c in x.choices],
            extents={k: v for x in found for k, v in x.extents.items()},
        )


def _time(part: Part) -> float:
    return part.t
