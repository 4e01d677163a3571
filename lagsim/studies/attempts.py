"""Attempts at a run: each with an error bar and an audit, until one passes the audit.

An attempt consists of the run, whose rows go to observers, of the repeat that estimates
its error, and of the audit of both. If the audit has a finding, the run is attempted
again by other means. If that attempt fails as well, the outcome of the run is
`no-answer` from the time of the finding on.

Runs and repeats are trials (`trial.tried`) of sessions. `repeats` selects the means of
a repeat and limits its cost; `error_bar` compares its rows with those of the run. If a
repeat has the counts of steps of the run, it is discarded, and another one is made.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import KW_ONLY, dataclass, field, replace
from enum import Enum
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from lagsim.outputs.manifest import manifest
from lagsim.run.error import ErrorBar, Failed
from lagsim.run.events.sections import Sections
from lagsim.run.interrupt import MOST_STEPS, Interrupt
from lagsim.run.observers import Corners, Extremes, Observer, Relay, Store
from lagsim.run.observers.thinning import Frames, picture_thinning
from lagsim.run.trajectory import Outcome
from lagsim.studies.audit.alarms import alarms
from lagsim.studies.audit.evidence import Evidence, constraint_residual
from lagsim.studies.audit.finding import Finding, audit, finding_text, up_to
from lagsim.studies.error_bar import error_bar_of
from lagsim.studies.repeats import (
    GOLDEN,
    LEAST_ROWS,
    TIGHTER,
    Allowance,
    Repeat,
    by_other_means,
    excess,
    second_session,
    steps_of,
    tightened,
)
from lagsim.studies.trial import Compiled, tried
from lagsim.tolerances import SAME_ROW

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Caution
    from lagsim.outputs.table import EventsWriter
    from lagsim.plan.plan import Plan
    from lagsim.run.observers.appended import Appended
    from lagsim.run.session import Session, Stopwatch

    # Called with a run, and with its `relay` and `session` as keywords.
    Joined: TypeAlias = Callable[..., None]
    Advance: TypeAlias = Callable[[float], None] | None
    Progress: TypeAlias = Callable[[str], contextlib.AbstractContextManager[Advance]]

# Largest difference to the repeat of a method without error control, relative to a
# range, at which both agree: 1e5 of its tolerances.
AGREED = 1e-8
# The difference to a run with steps shortened by GOLDEN is between 0.38 of the error
# (at order 1) and the whole error. If it is less than this part of another estimate,
# that estimate is too large.
LESS = 0.3
# Two repeats confirm each other if their difference is below this part of their
# difference to the run.
ALIKE = 1e-4


class ErrorBars(Enum):
    """Condition under which a run is repeated to estimate its error."""

    AUTO = "auto"
    ALWAYS = "always"
    NEVER = "never"


class Records(NamedTuple):
    """Selection of the records of a run, besides its table and its evidence.

    Attributes
    ----------
    thinned, animated : bool
        Whether rows are kept for pictures, and for the page that plays the motion.
    cornered : bool
        Whether rows at events are kept even if no thinned rows are kept, for pictures
        that are drawn from other rows.
    appended : Appended or None
        Columns of sensitivities, which the store appends.
    """

    thinned: bool = False
    animated: bool = False
    cornered: bool = False
    appended: Appended | None = None


PLAIN = Records()


class Attempt(Evidence):
    """One run of a session: evidence for its audit, and rows for pictures and pages.

    Attributes
    ----------
    thin, corners, frames
        Rows for pictures, rows at events, and rows of the page that plays the motion;
        each is None if not requested.
    found : Sections or None
        The sections; None if the model has no section.
    extremes : Extremes or None
        The ranges of columns, for pictures of sections.
    fault : OSError or None
        The error that prevented rows from being stored; None if there was none.
    appended : Appended or None
        Columns of sensitivities, appended to the table; None if not requested.
    """

    fault: OSError | None = None

    def __init__(self, session: Session, records: Records, stride: int = 1) -> None:
        super().__init__(session, stride)
        self.appended = records.appended
        e, names, count = self.equations, session.columns.names, session.columns.table
        thinned, sections = records.thinned, bool(e.model.output.sections)
        self.corners = Corners() if records.cornered or thinned else None
        self.thin = picture_thinning(e.model, names) if thinned else None
        self.found = Sections(e.model, count) if sections else None
        self.extremes = Extremes(count) if thinned and sections else None
        self.frames: Frames | None = None
        if records.animated:
            from lagsim.outputs.animation import frames_of

            self.frames = frames_of(e, names)
        others: list[Observer | None] = [self.thin, self.frames, self.extremes]
        self._others = [x for x in others if x is not None]

    def add(self, rows: Floats) -> None:
        """Pass rows (k, columns) to the observers of the evidence and to the others."""
        super().add(rows)
        for other in self._others:
            other.add(rows)

    @property
    def sections(self) -> dict[str, Floats]:
        """Rows (k, columns) of each section of the model, by name."""
        if self.found is None:
            return {}
        return self.found.tables([x.name for x in self.equations.model.output.sections])

    def cautions(self) -> list[Caution]:
        """Return all warnings on the run."""
        found = alarms(self)
        if self.frames is not None:
            from lagsim.outputs.animation import nothing_to_draw

            found += nothing_to_draw(self.equations.model)
        return found + (self.appended.cautions if self.appended else [])

    def record(
        self,
        cautions: Sequence[Caution],
        timings: Mapping[str, float],
        files: Sequence[str],
    ) -> dict[str, Any]:
        """Return the content of run.json.

        cautions : all warnings.
        timings : seconds by stage.
        files : names of the files.
        """
        return manifest(
            self.session, self.trajectory, self.residuals, constraint_residual(self),
            self.bar, cautions,
            {name: round(t, 6) for name, t in timings.items()}, files, self.appended,
        )  # fmt: skip


def _means(plan: Plan) -> str:
    """Return a text with the method of a plan, and its tolerance or step size."""
    setting, value = plan.accuracy
    digits = 3 if setting == "step" else 2
    return f"{plan.method} at {setting} {value:.{digits}g}"


@dataclass
class Attempts:
    """Attempts at a run, until one passes the audit.

    Attributes
    ----------
    store : Store
        Receives the rows.
    interrupt : Interrupt
        Requests of an early end.
    clock : Stopwatch
        Measures the seconds of each stage.
    error_bars : ErrorBars
        When a run is repeated to estimate its error.
    replaces : bool
        Whether a second attempt, by other means, replaces a run that fails the audit.
    records : Records
        The records of each attempt.
    progress : callable
        Maps a label to a context manager, whose value is a function to be called with
        the fraction done, or None.
    joined : callable or None
        Called with the run of the first attempt before the run begins.
    followers : sequence of Store
        Further stores, which receive the rows that `store` has received.
    allowance : Allowance or None
        The remaining budget of repeats and second attempts.
    tried : list of str
        The methods of all attempts, with their tolerances or steps.
    listed : EventsWriter or None
        Writes all events; with None the trajectory has them.
    compiled : Compiled
        Sessions whose functions serve repeats of methods without error control.
    """

    store: Store
    interrupt: Interrupt
    clock: Stopwatch
    _: KW_ONLY
    error_bars: ErrorBars = ErrorBars.AUTO
    replaces: bool = True
    records: Records = PLAIN
    progress: Progress = lambda _label: contextlib.nullcontext()
    joined: Joined | None = None
    followers: Sequence[Store] = ()
    listed: EventsWriter | None = None
    compiled: Compiled = field(default_factory=Compiled)
    allowance: Allowance | None = field(default=None, init=False)
    tried: list[str] = field(default_factory=list, init=False)

    def best(self, session: Session) -> Attempt:
        """Return the first attempt at a run, or a second one that passes the audit.

        If neither passes, the outcome of the attempt is `no-answer` from the time of
        the finding on.
        """
        first = self._completed(session)
        finding = None if self.interrupt.requested else audit(first)
        if finding is None or not (finding.refutes or self._is_outlier(first)):
            return first
        other = next(self._repeats(first), None) if self.replaces else None
        if other is None:
            return self._judged(first, finding)
        assert self.allowance is not None
        second = self._completed(
            second_session(
                other, first.session, first.trajectory, finding, self.allowance
            )
        )
        if self.interrupt.requested:
            return second
        if second.trajectory.outcome.complete:
            return self._judged(second, audit(second))
        return self._judged(self._completed(session, first.bar), finding)

    def _judged(self, attempt: Attempt, finding: Finding | None) -> Attempt:
        """Return an attempt with the outcome that follows from its finding.

        Without a finding, or if the finding is uncertain, the attempt is returned
        unchanged; else its outcome is `no-answer`. If a constraint is violated, the run
        is repeated up to the last row before the time of the finding.

        finding : None if there is none.
        """
        if finding is None or not finding.refutes:
            return attempt
        reason = f"from t = {finding.time:.9g} on the rows are not valid: "
        reason += finding.text
        if finding.violates_constraint:
            attempt = self._completed(up_to(attempt.session, finding.time), attempt.bar)
            end = attempt.trajectory.end
            reason += f"; the last row, at t = {end:.9g}, satisfies it"
        reason += f" (tried: {', '.join(dict.fromkeys(self.tried))})"
        outcome = Outcome.NO_ANSWER
        trajectory = attempt.trajectory._replace(
            outcome=outcome, reason=f"{reason}: {outcome.advice}"
        )
        # A difference from a repeat is no error estimate if the rows are not valid.
        attempt.end(trajectory, "the rows are not valid")
        return attempt

    def _completed(
        self, session: Session, bar: ErrorBar | str | None = None
    ) -> Attempt:
        """Run a session, and return its result as an attempt; earlier rows are deleted.

        Parameters
        ----------
        bar : ErrorBar or str, optional
            The error bar from an earlier repeat; None to make a repeat.
        """
        stride = 0 if self.error_bars is ErrorBars.NEVER else 1
        made = Attempt(session, self.records, stride)
        self.tried.append(_means(session.plan))
        for store in (self.store, *self.followers) if self.store.rows else ():
            store.begin_anew()
        if self.listed is not None and self.listed.table.rows:
            self.listed.table.begin_anew()
        relay = Relay(self.store, [made, *self.followers], self.interrupt)
        clock = self.clock
        clock.lap("output")
        import_module("lagsim.run.arcs")  # not while the clock runs for it
        clock.lap("import")
        joined, self.joined = self.joined, None
        with self.progress("run") as progress:
            trial = tried(
                session, observer=relay, interrupt=self.interrupt, progress=progress,
                corners=made.corners, sections=made.found, listed=self.listed,
                joined=joined and partial(joined, relay=relay, session=session),
            )  # fmt: skip
            if progress is not None and trial.complete:
                progress(1.0)
            clock.lap("integrate")
        clock.timings["integrate"] -= relay.seconds
        clock.timings["output"] += relay.seconds
        made.fault = relay.fault
        made.end(trial.trajectory, "not requested" if bar is None else bar)
        if bar is None:
            # The first attempt sets the allowance; later attempts are charged to it.
            if self.allowance is None:
                self.allowance = Allowance(session.system, trial.trajectory)
            else:
                self.allowance.take(Repeat(session), trial.trajectory)
            made.bar = self._error_bar(made)
        return made

    def _error_bar(self, attempt: Attempt) -> ErrorBar | str:
        """Return the error bar of an attempt, or the reason why there is none.

        It is computed by `repeated`, with progress shown, unless the options of the run
        or an interrupt exclude a repeat.
        """
        self.clock.lap("import")
        if self.error_bars is ErrorBars.NEVER:
            return "not requested"
        if self.interrupt.requested:
            return "the run was cut short"
        with self.progress("error bar") as progress:
            bar = self.repeated(attempt, progress)
            if progress is not None and not isinstance(bar, str):
                progress(1.0)
        self.clock.lap("error_bar")
        return bar

    def repeated(self, run: Attempt, progress: Advance = None) -> ErrorBar | str:
        """Repeat a run by other means; return the error bar from the difference.

        If no repeat is possible or valid, the reason is returned as a text.

        Parameters
        ----------
        progress
            Called with the fraction of the repeat that is done.
        """
        if len(run.checkpoints.rows) < 2:
            return "there are too few rows to compare"
        session, trajectory = run.session, run.trajectory
        always = self.error_bars is ErrorBars.ALWAYS
        if not always and (expected := excess(session, trajectory)):
            return (
                f"a repeat would need about {expected:.1e} operations "
                "(--error-bar always repeats nevertheless)"
            )
        found = Failed("no other method can repeat the run")
        end = trajectory.end - SAME_ROW * (trajectory.end - trajectory.start)
        for other in self._repeats(run):
            again = self._again(run, other, progress, always=always)
            repeated, plan = again.trajectory, again.plan
            if repeated.outcome is Outcome.INTERRUPTED:
                return "the repeat was interrupted"
            if wrong := finding_text(again):
                text = f"a repeat by {plan.method} is not valid itself: {wrong}"
                found = Failed(text)
            elif plan.method == session.plan.method and (
                steps_of(repeated) == steps_of(trajectory)
            ):
                text = f"a repeat by {plan.method} took the same steps as the run"
                found = Failed(text)
            elif repeated.outcome.complete or repeated.end >= end:
                return self._by_own_steps(run, error_bar_of(run, again), always=always)
            else:
                where = f"{plan.method} ended at t = {repeated.end:.6g}"
                found = Failed(f"a repeat did not finish: {where}")
        return found

    def _by_own_steps(self, run: Attempt, bar: ErrorBar, *, always: bool) -> ErrorBar:
        """Return the error bar from shorter steps of the run's method, if far smaller.

        Else the error bar `bar` is returned: its repeat is by a method with error
        control, which can be less accurate than the run. If both agree within the
        tolerance of that repeat, no feature has been passed over, and the difference to
        shorter steps of the run's method is the better estimate.

        always : whether the repeat may exceed the allowance.
        """
        plan = run.session.plan
        fixed = plan.rtol is None and plan.method != bar.method
        if not fixed or bar.parted or bar.relative > AGREED:
            return bar
        assert plan.step is not None
        row = run.session.case.settings.output_step
        step = GOLDEN * plan.step
        if step < row:  # rows stay ends of steps
            step = row / math.ceil(row / step)
        shorter = Repeat(run.session._replace(plan=replace(plan, step=step)), 1.0)
        again = self._again(run, shorter, always=always)
        if finding_text(again) or not again.trajectory.outcome.complete:
            return bar
        other = error_bar_of(run, again)
        return other if other.relative < LESS * bar.relative else bar

    def _is_outlier(self, run: Attempt) -> bool:
        """Whether a second, tighter repeat shows that the run is wrong.

        If the run has passed over a feature, both repeats agree far better with each
        other than with the run. If motions diverge exponentially, the differences are
        in proportion to the tolerances, and the run is not wrong.
        """
        bar = run.bar
        assert not isinstance(bar, str)
        other = next(self._repeats(run), None)
        if bar.parted or other is None:
            return bool(bar.parted)
        way = other.session
        longest = GOLDEN * GOLDEN * way.longest_step
        way = way._replace(plan=tightened(way.plan, TIGHTER), longest_step=longest)
        third = self._again(run, other._replace(session=way))
        self.clock.lap("error_bar")
        if finding_text(third):
            return False
        found = third.checkpoints.numbered
        if not bar.repeated.keys() <= found.keys():
            return False
        alike = [np.abs(found[k] - row) for k, row in bar.repeated.items()]
        apart = np.max(third.checkpoints.valued(np.array(alike)), axis=0)
        return bool(np.max(bar.lost_by(apart)) < ALIKE * np.max(bar.lost))

    def _repeats(self, run: Attempt) -> Iterator[Repeat]:
        """Yield alternative integrations of a run, the best first."""
        return by_other_means(run.session, run.trajectory, self.compiled)

    def _again(
        self,
        run: Attempt,
        other: Repeat,
        progress: Advance = None,
        *,
        always: bool = False,
    ) -> Evidence:
        """Repeat a run by the integration `other`; subtract the cost from the budget.

        always : whether the repeat may exceed the allowance.
        """
        rows, case = run.checkpoints, other.session.case
        finer = -(-LEAST_ROWS // len(rows.rows)) if rows.stride == 1 else 1
        spacing = rows.stride * case.settings.output_step / finer
        other = other._replace(session=other.session.with_settings(output_step=spacing))
        assert self.allowance is not None
        most = MOST_STEPS
        if not always:
            most = self.allowance.steps_beside(run.session, run.trajectory, other)
        made = Evidence(other.limited(most), finer)
        trial = tried(
            made.session, observer=made, interrupt=self.interrupt, progress=progress
        )
        self.allowance.take(other, trial.trajectory)
        return made.end(trial.trajectory, "a repeat has none")
