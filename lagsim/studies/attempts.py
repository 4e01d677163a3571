"""The rows of a run: made, judged, and made anew by other means where they fail.

One attempt goes the whole way: rows to their consumers, the repeat that estimates their
error, the verdict on both. Where that leaves a doubt, a second attempt by other means
takes the place of the first; where it fails as well, the run has no answer from the
time on that the verdict names, and says so.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from lagsim.cli._closing import progress_bar
from lagsim.cli._writing import Output

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility import Start
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.state import State
    from lagsim.model.model import Model
    from lagsim.model.settings import Settings
    from lagsim.outputs.table import TableWriter
    from lagsim.plan import Plan
    from lagsim.run.error import ErrorBar
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers.ledger import Ledger
    from lagsim.run.observers.thinning import Thinning
    from lagsim.run.system import System
    from lagsim.run.trajectory import Trajectory
    from lagsim.studies.alarms import Doubt, Witness
    from lagsim.studies.error_bar import Allowance, Checkpoints

# The steps of a second attempt are shorter than those of the repeat that failed to
# confirm the first: by this part, which no small whole numbers give.
SHORTER = 0.3819660112501051
# A second attempt may make so many times the steps that the evaluations of the first
# are worth, and so many times those that it must make; or so many, whatever it was.
MORE = 10
PER_STEP = 12
AT_LEAST = 3
ENOUGH = 20_000


class ErrorBars(Enum):
    """When a run is repeated to estimate its error."""

    AUTO = "auto"
    ALWAYS = "always"
    NEVER = "never"


class Job(Protocol):
    """What an attempt asks of the run that it belongs to."""

    error_bars: ErrorBars
    plots: bool
    quiet: bool
    timings: dict[str, float]

    def lap(self, name: str) -> None:
        """Record the time since the last lap."""


class Means(NamedTuple):
    """How an attempt is made; `longest_step` and `most_steps` 0: as usual."""

    plan: Plan
    system: System
    longest_step: float = 0.0
    most_steps: int = 0
    arc_steps: float = 0.0


class Attempt(NamedTuple):
    """The rows of a run, as far as they are known afterwards."""

    means: Means
    trajectory: Trajectory
    ledger: Ledger
    witness: Witness
    thin: Thinning | None
    checkpoints: Checkpoints
    bar: ErrorBar | str
    output: Output

    @property
    def plan(self) -> Plan:
        """The plan by which they were made."""
        return self.means.plan

    @property
    def system(self) -> System:
        """The system by which they were made."""
        return self.means.system


class Account:
    """The ledger of a repeat: what is no answer itself accuses no run."""

    def __init__(self, equations: Equations, start: State, system: System) -> None:
        from lagsim.run.observers.ledger import Ledger
        from lagsim.studies.alarms import Witness

        names = system.columns.names
        self.equations, self.start = equations, start
        self.ledger = Ledger(names)
        self.witness = Witness(names, len(equations.q))

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        self.ledger.add(rows)
        self.witness.add(rows)

    def fault(self, plan: Plan, trajectory: Trajectory) -> str:
        """Say why they are no answer; "" where they may be one."""
        from lagsim.studies.alarms import doubt_about

        doubt = doubt_about(
            self.equations, self.start, plan, trajectory, self.ledger, self.witness,
            "a repeat has none",
        )  # fmt: skip
        return "" if doubt is None else f"from t = {doubt.time:.6g} on, {doubt.text}"


class Attempts:
    """Makes the rows of a run."""

    def __init__(
        self,
        job: Job,
        equations: Equations,
        start: Start,
        settings: Settings,
        writer: TableWriter,
        interrupt: Interrupt,
    ) -> None:
        self.job, self.equations, self.start = job, equations, start
        self.settings = settings
        self.writer, self.interrupt = writer, interrupt
        # What all that judges the first attempt may cost.
        self.allowance: Allowance | None = None

    def best(self, means: Means) -> Attempt:
        """Make the rows, anew where they are in doubt."""
        first = self._made(means)
        doubt = self._doubt(first)
        if doubt is None or not (doubt.refutes or self._is_outlier(first)):
            return first
        others = self._others(first, doubt)
        if others is None:
            return _judged(first, doubt)
        second = self._made(others)
        if second.trajectory.outcome.complete or self.interrupt.asked:
            return _judged(second, self._doubt(second))
        return _judged(self._made(means, first.bar), doubt)

    def _made(self, means: Means, bar: ErrorBar | str | None = None) -> Attempt:
        """Make one attempt; the table and all that rows go to begin anew.

        `bar` is what a repeat says of it, where one has been made before.
        """
        from lagsim.run.observers.ledger import Ledger
        from lagsim.run.simulate import simulate
        from lagsim.run.states import MOST_STEPS
        from lagsim.studies.alarms import Witness
        from lagsim.studies.error_bar import Checkpoints

        job, equations, system = self.job, self.equations, means.system
        names = system.columns.names
        ledger, thin = Ledger(names), self._thinning(names)
        checkpoints = Checkpoints(len(equations.q), self.settings)
        witness = Witness(names, len(equations.q))
        consumers: list[Any] = [ledger, checkpoints, witness, *([thin] if thin else [])]
        if self.writer.rows:
            self.writer.begin_anew()
        output = Output(consumers, self.writer, self.interrupt)
        with progress_bar(quiet=job.quiet) as progress:
            job.lap("output")
            trajectory = simulate(
                equations, self.start, means.plan, system, self.settings, [output],
                interrupt=self.interrupt, progress=progress,
                longest_step=means.longest_step,
                most_steps=means.most_steps or MOST_STEPS,
                arc_steps=means.arc_steps,
            )  # fmt: skip
            job.lap("integrate")
        job.timings["integrate"] -= output.seconds
        job.timings["output"] += output.seconds
        if bar is None:
            self._charge(means, trajectory)
            bar = self._error_bar(means, trajectory, checkpoints)
        return Attempt(
            means, trajectory, ledger, witness, thin, checkpoints, bar, output
        )

    def _charge(self, means: Means, trajectory: Trajectory) -> None:
        """Let the first attempt set the allowance; take from it what others cost."""
        from lagsim.studies.error_bar import Allowance, Price

        if self.allowance is None:
            self.allowance = Allowance(means.system, trajectory)
        else:
            price = Price(means.system, means.plan.method, PER_STEP)
            self.allowance.take(price, trajectory)

    def _thinning(self, names: Sequence[str]) -> Thinning | None:
        if not self.job.plots:
            return None
        from lagsim.run.observers.thinning import picture_thinning

        model: Model = self.equations.model
        return picture_thinning(model, names)

    def _error_bar(
        self, means: Means, trajectory: Trajectory, checkpoints: Checkpoints
    ) -> ErrorBar | str:
        """Estimate the error of the run, or say why not."""
        from lagsim.studies.error_bar import repeat

        if self.job.error_bars is ErrorBars.NEVER:
            return "not asked for"
        if self.interrupt.asked:
            return "the run was cut short"
        always = self.job.error_bars is ErrorBars.ALWAYS
        with progress_bar(quiet=self.job.quiet) as progress:
            bar = repeat(
                self.equations, self.start, self.settings, means.plan, means.system,
                trajectory, checkpoints, always=always, account=self._account,
                allowance=self.allowance, interrupt=self.interrupt,
                progress=progress,
            )  # fmt: skip
        self.job.lap("error_bar")
        return bar

    def _account(self, system: System) -> Account:
        return Account(self.equations, self.start, system)

    def _doubt(self, attempt: Attempt) -> Doubt | None:
        from lagsim.studies.alarms import doubt_about

        if self.interrupt.asked:
            return None
        return doubt_about(
            self.equations, self.start, attempt.plan, attempt.trajectory,
            attempt.ledger, attempt.witness, attempt.bar,
        )  # fmt: skip

    def _is_outlier(self, attempt: Attempt) -> bool:
        """Ask a third run which of two is off."""
        from lagsim.studies.error_bar import is_outlier

        bar = attempt.bar
        assert not isinstance(bar, str)
        found = bool(bar.parted) or is_outlier(
            self.equations, self.start, self.settings, attempt.plan,
            attempt.system, attempt.trajectory, attempt.checkpoints, bar,
            account=self._account, allowance=self.allowance, interrupt=self.interrupt,
        )  # fmt: skip
        self.job.lap("error_bar")
        return found

    def _others(self, first: Attempt, doubt: Doubt) -> Means | None:
        """Give other means than those of an attempt that is in doubt."""
        from lagsim.notes import Choice
        from lagsim.studies.error_bar import Price, by_other_means

        trajectory = first.trajectory
        ways = by_other_means(
            self.equations, self.start, self.settings, first.plan, first.system,
            trajectory,
        )  # fmt: skip
        other = next(ways, None)
        if other is None:
            return None
        longest = SHORTER * other.longest_step
        least = (trajectory.end - trajectory.start) / longest
        worth = trajectory.statistics.evaluations / PER_STEP
        most = max(ENOUGH, int(MORE * worth + AT_LEAST * least))
        price = Price(other.system, other.plan.method, PER_STEP)
        assert self.allowance is not None
        most = max(1, self.allowance.most(price, most))
        rtol = "" if other.plan.rtol is None else f" at rtol {other.plan.rtol:.2g}"
        choice = Choice(
            f"made anew: {other.plan.method}{rtol}, steps up to {longest:.3g}",
            f"by {first.plan.method}, from t = {doubt.time:.9g} on, {doubt.text}",
        )
        plan = replace(other.plan, choices=(*first.plan.choices, choice))
        return Means(plan, other.system, longest, most, price.arc)


def _judged(attempt: Attempt, doubt: Doubt | None) -> Attempt:
    """Give an attempt as what it is after a verdict that nothing can change."""
    from lagsim.run.trajectory import Outcome

    if doubt is None or not doubt.refutes:
        return attempt
    outcome = Outcome.NO_ANSWER
    reason = f"from t = {doubt.time:.9g} on the rows are no answer: {doubt.text}"
    trajectory = replace(
        attempt.trajectory, outcome=outcome, reason=f"{reason}: {outcome.advice}"
    )
    # What a repeat says of a motion that is no answer is no error.
    return attempt._replace(trajectory=trajectory, bar="the rows are no answer")
