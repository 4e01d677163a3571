"""One solve of a scene, timed as users get it: rows and all, warm, least of several."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lagsim.errors import InputError
from lagsim.methods import method as method_named
from lagsim.run.observers import Keep
from lagsim.studies.moved import on_grid

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Event
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case

# Solves are repeated while they last together less than this, but not more often than
# that: a millisecond is measured well by the least of twenty, a second by itself.
REPEATING_SECONDS = 0.2
MOST_REPEATS = 20

FORMULATIONS = ("auto", "full", "ignorable")
OF_CONSTRAINTS = ("projection", "elimination", "baumgarte", "drift")


class GivenUpError(Exception):
    """A solve takes longer than it may, or the user has had enough."""


class Patience:
    """How long a solve may last.

    Parameters
    ----------
    seconds
        For one solve.
    interrupt
        Ends it at once.
    until
        Of the clock `time.perf_counter`: no solve lasts longer.
    """

    def __init__(
        self,
        seconds: float,
        interrupt: Interrupt | None = None,
        until: float = math.inf,
    ) -> None:
        self.seconds = seconds
        self.interrupt = interrupt
        self.until = until
        self.begin()

    def begin(self) -> None:
        """Begin a solve."""
        self._end = min(time.perf_counter() + self.seconds, self.until)

    @property
    def over(self) -> bool:
        """Whether there is no time left for any solve."""
        return time.perf_counter() > self.until

    @property
    def pressed(self) -> bool:
        """Whether the user wants an end."""
        return self.interrupt is not None and self.interrupt.asked

    def check(self, _fraction: float = 0.0) -> None:
        """Raise GivenUpError where patience has run out."""
        if self.pressed or time.perf_counter() > self._end:
            raise GivenUpError


@dataclass(frozen=True, slots=True)
class Solved:
    """What one solve gave; `rows` (k, columns) is None where there is no answer.

    The rows are those of the output times, and the last; `outcome` is that of a run, or
    `too slow`; `reason` says more.
    """

    rows: Floats | None
    seconds: float
    evaluations: int
    outcome: str
    reason: str = ""
    events: Sequence[Event] = ()


class Solver(Protocol):
    """A method in a formulation, ready to solve a scene at any setting.

    Attributes
    ----------
    setting : str
        `rtol` or `step`.
    compile_seconds : float
        What making it ready took.
    """

    method: str
    formulation: str
    setting: str
    compile_seconds: float

    @property
    def names(self) -> tuple[str, ...]:
        """The columns of the rows."""

    def solve(self, value: float, patience: Patience) -> Solved:
        """Solve once.

        Raises
        ------
        GivenUpError
        """


def asking(
    case: Case,
    method: str = "auto",
    formulation: str = "auto",
    rtol: float | None = None,
) -> Case:
    """Give the case as if the file asked for this, and for nothing else."""
    return case.asking(
        method=method, formulation=formulation, rtol=rtol, atol=None, step=None
    )


class Own:
    """One of lagsim's methods, through lagsim's own run.

    Raises
    ------
    InputError
        Where the method or the formulation cannot handle the scene.
    """

    def __init__(
        self,
        case: Case,
        method: str,
        formulation: str = "auto",
        rtol: float | None = None,
    ) -> None:
        began = time.perf_counter()
        self.session = asking(case, method, formulation, rtol).ready()
        self.compile_seconds = time.perf_counter() - began
        self.case, self.plan = self.session.case, self.session.plan
        self.system = self.session.system
        self.method, self.formulation = self.plan.method, self.plan.formulation
        adaptive = bool(method_named(self.method).ADAPTIVE)
        self.setting = "rtol" if adaptive else "step"

    @property
    def names(self) -> tuple[str, ...]:
        """The columns of the rows."""
        return self.system.columns.names

    def solve(self, value: float, patience: Patience) -> Solved:
        """Solve once with the tolerance, or the step, `value`."""
        fixed = self.setting == "step"
        plan = replace(
            self.plan,
            rtol=None if fixed else value,
            atol=None,
            step=value if fixed else None,
        )
        kept = Keep()
        patience.begin()
        began = time.perf_counter()
        trajectory = self.session.by(plan).run([kept], progress=patience.check)
        seconds = time.perf_counter() - began
        rows = None
        if trajectory.outcome.complete:
            rows = on_grid(kept.table, self.case.settings)
        if rows is not None and not np.all(np.isfinite(rows)):
            rows = None
        return Solved(
            rows,
            seconds,
            trajectory.statistics.evaluations,
            trajectory.outcome.word,
            "" if rows is not None else trajectory.reason,
            trajectory.events,
        )


def formulations(case: Case, method: str) -> tuple[list[Own], dict[str, str]]:
    """Give a solver for each formulation that a method can take.

    And by formulation why another cannot be had.
    """
    found: dict[str, Own] = {}
    refused: dict[str, str] = {}
    constrained = bool(case.equations.rows)
    for formulation in (*FORMULATIONS, *(OF_CONSTRAINTS if constrained else ())):
        try:
            plan = asking(case, method, formulation).plan()
            if plan.formulation not in found:
                found[plan.formulation] = Own(case, method, formulation)
        except InputError as fault:
            said = f"`{method}` cannot handle this model: "
            refused[formulation] = fault.problems[0].text.removeprefix(said)
    return list(found.values()), refused


def least(solve: Callable[[], Solved]) -> Solved:
    """Solve again and again; give the solve that took the least time."""
    best = solve()
    spent, repeats = best.seconds, 1
    while (
        best.rows is not None
        and repeats < MOST_REPEATS
        and spent + best.seconds < REPEATING_SECONDS
    ):
        try:
            again = solve()
        except GivenUpError:
            break
        spent += again.seconds
        repeats += 1
        if again.seconds < best.seconds:
            best = again
    return best
