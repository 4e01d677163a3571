"""Runs with an error bar and an audit, and second attempts where the audit fails.

An attempt consists of the run, whose rows go to observers, of the repeat that estimates
its error, and of the audit of both. If the audit has a finding, the run is attempted
again by other means. If that attempt fails as well, the outcome of the run is
`no-answer` from the time of the finding on.

Local errors do not bound the error of the motion. The error bar is therefore the
difference of two complete runs, which includes the growth of errors. The scale of an
error is the range of the coordinate. For a coordinate at rest to rounding the scale is
its value, the motion of coordinates linked with it by constraints, or the distance that
the forces on it would move it.

A repeat with the steps of the run would pass over the features that the run passed
over, and would share the error of steps at the bound of stability. The repeat is
therefore made at a hundredth of the tolerance and with other steps: none is longer than
a part of the output step or, for the method of the run, than a part of the steps of the
run. Another method is used where the steps of the run could hide a feature. If
the tolerance is the tightest, that of the repeat is looser. If a repeat has the counts
of steps of the run, it is discarded, and another repeat is made.

A repeat costs a few times the run. Costs are counted in operations, not in seconds, so
that a rerun makes the same decisions. Each repeat has a limit relative to the run, and
all repeats and second attempts together have an allowance that depends on the run.
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

from lagsim.language.sparse import joined
from lagsim.notes import Caution, Choice
from lagsim.outputs.manifest import manifest
from lagsim.plan.method_choice import ANY
from lagsim.run.arc import SERIES
from lagsim.run.error import (
    LOST,
    ErrorBar,
    Failed,
    could_follow,
    could_push,
    in_groups,
    largest_beside,
)
from lagsim.run.events.sections import Sections
from lagsim.run.interrupt import MOST_STEPS, Interrupt
from lagsim.run.observers import Corners, Extremes, Observer, Relay, Store
from lagsim.run.observers.monitors import Checkpoints
from lagsim.run.observers.thinning import Frames, picture_thinning
from lagsim.run.trajectory import Outcome, Trajectory
from lagsim.studies.audit.alarms import alarms
from lagsim.studies.audit.evidence import (
    Evidence,
    constraint_residual,
    inertia_roots,
)
from lagsim.studies.audit.finding import Finding, audit, finding_text, up_to
from lagsim.tolerances import (
    COMPUTED_ZERO,
    NO_MOTION,
    SAME_ROW,
    SUM_ROUNDOFF,
    TIGHTEST_RTOL,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.outputs.table import EventsWriter
    from lagsim.plan.plan import Plan
    from lagsim.program.system import System
    from lagsim.run.observers.appended import Appended
    from lagsim.run.session import Case, Session, Stopwatch

    # Called with a run, and with its `relay` and `session` as keywords.
    Joined: TypeAlias = Callable[..., None]
    Advance: TypeAlias = Callable[[float], None] | None
    Progress: TypeAlias = Callable[[str], contextlib.AbstractContextManager[Advance]]

# A coordinate with an error of less than this part of its scale is not at rest.
RESOLVED_BY = 1e-6
# Ratio of the range of a motion at rest to the rounding of a sum, at most: rounding
# keeps the oscillations about a rest at a level that does not grow with the duration.
# It was 1.5 for a string that hangs, over 30 s as over 300 s.
NOISE = 4.0


def _scales(
    found: Floats, moving: Floats, linked: Floats, largest: Floats, by_forces: Floats
) -> tuple[Floats, Floats]:
    """Return the scale of errors, and the largest range at rest, of each coordinate.

    Parameters
    ----------
    found, moving, linked, largest, by_forces : ndarray, shape (n,)
        For each coordinate its range, the motion of the other coordinates scaled by
        inertia, the range of coordinates linked with it by constraints, its largest
        absolute value, and the distance that the forces on it would move it without
        constraints.

    Returns
    -------
    scales, still : ndarray, shape (n,)
        The scale of errors of each coordinate, and the range below which the coordinate
        counts as at rest, so that its error determines no horizon.
    """
    scales = np.fmax(found, COMPUTED_ZERO * moving)
    for size in (largest, linked):
        scales = np.where(found > SUM_ROUNDOFF * size, scales, np.fmax(scales, size))
    scales = np.where(
        found <= SUM_ROUNDOFF * by_forces, np.fmax(scales, by_forces), scales
    )
    still = np.fmax(NO_MOTION * moving, SUM_ROUNDOFF * by_forces / LOST)
    return scales, np.fmax(still, SUM_ROUNDOFF * largest / LOST)


def compared(
    case: Case,
    runs: tuple[Trajectory, Trajectory],
    plan: Plan,
    checkpoints: Checkpoints,
    again: Checkpoints,
) -> ErrorBar:
    """Return the error bar of a run, from its rows and the rows of a repeat.

    Output rows with equal row numbers are compared, and the last rows if both runs end
    alike.

    Parameters
    ----------
    case : Case
        The case of the run.
    runs : tuple of Trajectory
        The run and its repeat.
    plan : Plan
        The plan of the repeat.
    checkpoints, again : Checkpoints
        Rows of the run and of the repeat.
    """
    equations, start, n = case.equations, case.start, len(case.equations.q)
    run, repeated = runs
    repeats = again.numbered
    pairs = [(x, repeats[k]) for k, x in checkpoints.numbered.items() if k in repeats]
    delay = abs(run.end - repeated.end)
    same_end = run.outcome is repeated.outcome and delay < case.settings.output_step
    assert checkpoints.last is not None
    assert again.last is not None
    if same_end and checkpoints.last[0] > pairs[-1][0][0]:
        pairs.append((checkpoints.last, again.last))
    rows, repeated_rows = np.array(pairs).swapaxes(0, 1)
    every = np.abs(repeated_rows - rows)
    every = np.fmax(every, UNIT_ROUNDOFF * _largest(rows))
    # Times are rounded, too, including the times at which forces jump.
    by_time = UNIT_ROUNDOFF * _largest(rows[:, :1] * rows[:, 1 + n : 1 + 2 * n])
    every[:, 1 : 1 + n] = np.fmax(every[:, 1 : 1 + n], by_time)
    errors = checkpoints.valued(every)
    own, worst = checkpoints.high - checkpoints.low, np.max(errors, axis=0)
    names = *equations.q, *(x.name for x in equations.states)
    # Ranges of rows and of steps: rows may be few, or all at one phase of an
    # oscillation.
    nothing = np.nan, np.nan
    steps = np.array([repeated.extents.get(name, nothing) for name in names]).T
    low = np.fmin.reduce([checkpoints.low, again.low, steps[0]])
    high = np.fmax.reduce([checkpoints.high, again.high, steps[1]])
    sizes = np.asarray(high - low)
    # Where the error is large, the repeat follows another motion. Its range counts only
    # where the run itself has hardly moved.
    sizes = np.where((worst > LOST * sizes) & (own > LOST * sizes), own, sizes)
    roots = inertia_roots(equations, start)
    labels = joined(n, [row.A.entries for row in equations.rows])
    moving, linked, by_forces = np.zeros((3, len(names)))
    moving[:n] = largest_beside(roots, sizes[:n])
    linked[:n] = in_groups(labels, roots, sizes[:n])
    largest = np.max(np.abs(checkpoints.valued(rows)), axis=0)
    # Coordinates linked by constraints share the rounding of their positions.
    largest[:n] = np.fmax(largest[:n], in_groups(labels, roots, largest[:n]))
    scales, still = _scales(sizes, moving, linked, largest, by_forces)
    # The other coordinates move by far more than their errors.
    slow = (sizes <= NO_MOTION * moving) | (worst > RESOLVED_BY * scales)
    # Where a run blows up, its last forces could push a coordinate past all ranges.
    if slow[:n].any() and run.outcome is not Outcome.NOT_FINITE:
        which, step = np.flatnonzero(slow[:n]).tolist(), case.settings.output_step
        by_forces[:n] = could_push(equations, rows, which, step).reach
        if equations.states:
            by_forces[n:] = could_follow(equations, rows, by_forces[:n])
        scales, still = _scales(sizes, moving, linked, largest, by_forces)
    rounding = NOISE * SUM_ROUNDOFF * np.fmax(largest, by_forces)
    parted = ""
    if run.outcome.complete and repeated.outcome.complete and not same_end:
        parted = (
            f"it ended with `{run.outcome.word}` at t = {run.end:.9g}, and a repeat by "
            f"{plan.method} with `{repeated.outcome.word}` at t = {repeated.end:.9g}"
        )
    return ErrorBar(
        method=plan.method,
        rtol=plan.rtol,
        names=names,
        times=rows[:, 0],
        errors=errors,
        scales=scales,
        still=still,
        rates=every[:, 1 + n : 1 + 2 * n],
        repeated=repeats,
        parted=parted,
        rests=bool(np.all(sizes <= rounding)),
    )


def _largest(values: Floats) -> Floats:
    """Return, for each row, the largest |value| up to that row, shape (k, n).

    values : (k, n).
    """
    return np.asarray(np.maximum.accumulate(np.abs(values), axis=0))


# Factor by which the tolerance of a repeat is tighter, the factor if that repeat does
# not finish, and the loosest tolerance of a repeat: with loose tolerances both runs can
# have large errors that are nearly equal.
TIGHTER, LOOSER = 100.0, 3.0
LOOSEST = 1e-6
# Tolerance of the repeat of a method without error control.
FREE_RTOL = 1e-13
# Largest difference to that repeat, relative to a range, at which both agree: 1e5 of
# its tolerances.
AGREED = 1e-8
# The difference to a run with steps shortened by GOLDEN is between 0.38 of the error
# (at order 1) and the whole error. If it is less than this part of another estimate,
# that estimate is too large.
LESS = 0.3
# The longest step of a repeat relative to the output step (no ratio of small whole
# numbers, so that steps end elsewhere in each row), and to the steps of the run.
WITHIN = 0.75**0.5
GOLDEN = (5.0**0.5 - 1.0) / 2.0
# Operations that a repeat may always take to keep its steps short.
SHORT = 2e7
# Evaluations in a step with rows in it, for the method of most repeats.
PER_STEP = 15.0
# Evaluations in a step of a series: one, and one more for compensated rounding.
SERIES_STEP = 2.0

# Operations of a repeat with `--error-bar auto`, at most: about 2 s.
BUDGET = 2e9
# Limit of a repeat relative to the cost of the run, and limit in operations; the larger
# one holds. A repeat beyond it has met a feature that the run has not.
MOST_TIMES = 20.0
ALWAYS = 2e8
# The allowance of all repeats and second attempts: a multiple of the cost of the run,
# plus operations for about 2 s (10 s where constraints are solved by loops).
WHOLE_TIMES = 10.0
WHOLE = 1e9
# Cost of an evaluation, in operations, in addition to the operations of its nodes.
OVERHEAD = 20
# Operations of a series relative to the operations of the rates.
SERIES_LENGTH = 50
# Cost of the start of an arc, in operations. The true cost, a millisecond in Python, is
# higher, but a repeat must be able to pass switches that the run missed: at least 2000,
# and MOST_ARCS times as many arcs as the run.
ARC = 1e5
MOST_ARCS = 3.0

# Least number of rows of a repeat, which ranges are computed from.
LEAST_ROWS = 64
# Two repeats confirm each other if their difference is below this part of their
# difference to the run.
ALIKE = 1e-4


def evaluation_cost(system: System, method: str) -> float:
    """Return the cost of one evaluation of y' by a method, in operations."""
    operations = float(system.operations)
    if system.plan.method == SERIES and method != SERIES:
        operations /= SERIES_LENGTH
    return operations + OVERHEAD


def own_cost(system: System, trajectory: Trajectory) -> float:
    """Return the cost of a run, in operations: the cost of its evaluations of y'."""
    return trajectory.statistics.evaluations * evaluation_cost(
        system, system.plan.method
    )


class Repeat(NamedTuple):
    """Alternative integration of a run, which serves to estimate the error of the run.

    Attributes
    ----------
    session : Session
        The session of the alternative integration.
    per_step : float
        Number of evaluations of y' in a step.
    """

    session: Session
    per_step: float = PER_STEP

    @property
    def evaluation(self) -> float:
        """The cost of an evaluation of y', in operations."""
        return evaluation_cost(self.session.system, self.session.plan.method)

    @property
    def step(self) -> float:
        """The cost of a step, in operations."""
        return self.per_step * self.evaluation

    def limited(self, most: int) -> Session:
        """Return the session with a limit on the number of steps.

        most : the largest number of steps, where each arc counts as several steps.
        """
        arc = ARC / self.step if most < MOST_STEPS else 0.0
        return self.session._replace(most_steps=most, arc_steps=arc)


class Allowance:
    """Budget of operations that repeats and second attempts of a run have left."""

    def __init__(self, system: System, trajectory: Trajectory) -> None:
        arcs = ARC * trajectory.statistics.arcs
        self.left = WHOLE_TIMES * (own_cost(system, trajectory) + arcs) + WHOLE

    def steps(self, other: Repeat, operations: float = math.inf) -> int:
        """Return the number of steps of the repeat `other` within the remaining budget.

        operations : a second limit of the cost of these steps, in operations.
        """
        return int(min(operations, self.left) / other.step)

    def steps_beside(
        self, session: Session, trajectory: Trajectory, other: Repeat
    ) -> int:
        """Return the largest number of steps of the repeat `other` of a run.

        The cost is limited by the allowance, and relative to the cost of the run.

        session, trajectory : the run that is repeated.
        """
        own = own_cost(session.system, trajectory)
        operations = min(BUDGET, max(MOST_TIMES * own, ALWAYS))
        operations += MOST_ARCS * ARC * trajectory.statistics.arcs
        return self.steps(other, operations)

    def take(self, other: Repeat, trajectory: Trajectory) -> None:
        """Subtract the cost of the repeat `other` from the budget.

        trajectory : the result of the repeat.
        """
        made = trajectory.statistics
        price = made.evaluations * other.evaluation + ARC * made.arcs
        self.left = max(0.0, self.left - price)


def by_other_means(session: Session, trajectory: Trajectory) -> Iterator[Repeat]:
    """Yield alternative integrations of a run, the best first.

    Each has another method, formulation or tolerance than the run, and other steps.

    session, trajectory : the run.
    """
    plan, system, settings = session.plan, session.system, session.case.settings
    span = trajectory.end - trajectory.start

    def way(plan: Plan, longest: float, session: Session = session) -> Session:
        """Return `session` with a plan, and with a largest step size for a repeat.

        plan : the plan of the repeat.
        longest : the largest step size requested, which is increased if the repeat
            would exceed BUDGET operations.
        """
        own = own_cost(session.system, trajectory)
        most = min(max(2.0 * own, SHORT), BUDGET / 2.0)
        price = PER_STEP * evaluation_cost(session.system, plan.method)
        longest = max(longest, span * price / most)
        return session._replace(plan=plan, longest_step=longest)

    mean = span / max(trajectory.statistics.steps, 1)
    within = WITHIN * settings.output_step
    if plan.rtol is None:
        free = session.case.with_settings(
            method=ANY, formulation="auto", rtol=FREE_RTOL, atol=None
        ).ready(quick=session.system.quick)
        found = way(free.plan, within, free)
        yield Repeat(found._replace(case=session.case))
        return
    same = GOLDEN * min(mean, settings.output_step)
    per_step = SERIES_STEP if plan.method == SERIES else PER_STEP
    # If no feature of the model can be missed, a series with other steps is independent
    # enough of the run.
    sees_all = not system.indicators
    for tighter in (tightened(plan, TIGHTER), tightened(plan, LOOSER)):
        is_tighter = not plan.rtol or (tighter.rtol or 0.0) < plan.rtol
        # At the tightest tolerance another method cannot be more accurate.
        room = not plan.rtol or ((tighter.rtol or 0.0) > TIGHTEST_RTOL and is_tighter)
        same_method = plan.method == SERIES and (sees_all or not room)
        if plan.method != ANY and not same_method:
            yield Repeat(way(replace(tighter, method=ANY), within))
        if plan.method == ANY or same_method or plan.method != SERIES:
            found = way(tighter, same)
            if not is_tighter:
                longest = min(found.longest_step, GOLDEN * mean)
                found = found._replace(longest_step=longest)
            yield Repeat(found, per_step)
    # Steps of less than half the steps of the run differ from these in any case.
    shortest = tightened(plan, TIGHTER)
    found = session._replace(plan=shortest, longest_step=GOLDEN * GOLDEN * mean)
    yield Repeat(found, per_step)


def tightened(plan: Plan, times: float) -> Plan:
    """Return the plan with a tolerance that is smaller by the factor `times`.

    The tolerance stays between the tightest and the loosest of repeats, and differs
    from that of the run by the factor LOOSER or more.
    """
    rtol = plan.rtol or 0.0
    if rtol:
        rtol = min(max(rtol / times, TIGHTEST_RTOL), LOOSEST)
        assert plan.rtol is not None
        if max(rtol / plan.rtol, plan.rtol / rtol) < (1.0 - 1e-9) * LOOSER:
            rtol = LOOSER * plan.rtol
    factor = rtol / plan.rtol if plan.rtol else 1.0 / times
    atol = None if plan.atol is None else plan.atol * min(factor, 1.0)
    return replace(plan, rtol=rtol, atol=atol)


def steps_of(trajectory: Trajectory) -> tuple[float | None, ...]:
    """Return the counts of steps and the shortest step of a run, to compare runs.

    Two runs with equal results are taken to have equal steps.
    """
    made = trajectory.statistics
    return made.steps, made.rejections, made.smallest_step


# Longest step of a second attempt relative to that of the repeat that contradicted the
# first attempt; no ratio of small whole numbers.
SHORTER = 0.3819660112501051
# Limit of the steps of a second attempt: MORE times the evaluations of the first, at
# PER_ATTEMPT in a step, plus AT_LEAST times its least number of steps; or ENOUGH.
MORE = 10
PER_ATTEMPT = 12
AT_LEAST = 3
ENOUGH = 20_000


class ErrorBars(Enum):
    """Condition under which a run is repeated to estimate its error."""

    AUTO = "auto"
    ALWAYS = "always"
    NEVER = "never"


class Attempt(Evidence):
    """One run of a model: evidence for its audit, and rows for pictures and pages.

    Attributes
    ----------
    checkpoints : Checkpoints
        Rows that are compared with a repeat.
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

    def __init__(self, session: Session, attempts: Attempts) -> None:
        super().__init__(session)
        self.appended = attempts.appended
        model, names = self.equations.model, session.columns.names
        self.checkpoints = Checkpoints(self.equations, session.case.settings)
        self.corners = Corners() if attempts.cornered or attempts.thinned else None
        self.thin = picture_thinning(model, names) if attempts.thinned else None
        self.found: Sections | None = None
        if model.output.sections:
            self.found = Sections(model, session.columns.table)
        self.extremes: Extremes | None = None
        if self.found is not None and attempts.thinned:
            self.extremes = Extremes(session.columns.table)
        self.frames: Frames | None = None
        if attempts.animated:
            from lagsim.outputs.animation import frames_of

            self.frames = frames_of(self.equations, names)

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
    replaces : bool
        Whether a second attempt, by other means, replaces a run that fails the audit.
    thinned, animated : bool
        Whether rows are kept for pictures, and for the page that plays the motion.
    cornered : bool
        Whether rows at events are kept, for pictures of other rows.
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
    appended : Appended or None
        Columns of sensitivities, which the store appends.
    listed : EventsWriter or None
        Writes all events; with None the trajectory has them.
    """

    store: Store
    interrupt: Interrupt
    clock: Stopwatch
    _: KW_ONLY
    error_bars: ErrorBars = ErrorBars.AUTO
    replaces: bool = True
    thinned: bool = False
    cornered: bool = False
    animated: bool = False
    progress: Progress = lambda _label: contextlib.nullcontext()
    joined: Joined | None = None
    followers: Sequence[Store] = ()
    appended: Appended | None = None
    listed: EventsWriter | None = None
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
        others = self._second_session(first, finding) if self.replaces else None
        if others is None:
            return self._judged(first, finding)
        second = self._completed(others)
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
        made = Attempt(session, self)
        self.tried.append(_means(session.plan))
        for store in (self.store, *self.followers) if self.store.rows else ():
            store.begin_anew()
        if self.listed is not None and self.listed.table.rows:
            self.listed.table.begin_anew()
        observers: list[Observer | None] = [
            made,
            *self.followers,
            made.thin,
            made.frames,
        ]
        observers.append(made.extremes)
        observers += [] if self.error_bars is ErrorBars.NEVER else [made.checkpoints]
        others: list[Observer] = [x for x in observers if x is not None]
        relay = Relay(self.store, others, self.interrupt)
        clock = self.clock
        clock.lap("output")
        import_module("lagsim.run.arcs")  # not while the clock runs for it
        clock.lap("import")
        joined, self.joined = self.joined, None
        with self.progress("run") as progress:
            trajectory = session.run(
                [relay], interrupt=self.interrupt, progress=progress,
                corners=made.corners, sections=made.found, listed=self.listed,
                joined=joined and partial(joined, relay=relay, session=session),
            )  # fmt: skip
            if progress is not None and trajectory.outcome.complete:
                progress(1.0)
            clock.lap("integrate")
        clock.timings["integrate"] -= relay.seconds
        clock.timings["output"] += relay.seconds
        made.fault = relay.fault
        made.end(trajectory, "not requested" if bar is None else bar)
        if bar is None:
            # The first attempt sets the allowance; later attempts are charged to it.
            if self.allowance is None:
                self.allowance = Allowance(session.system, trajectory)
            else:
                self.allowance.take(Repeat(session), trajectory)
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
        expected = 2.0 * own_cost(session.system, trajectory)
        always = self.error_bars is ErrorBars.ALWAYS
        if expected > BUDGET and not always:
            return (
                f"a repeat would need about {expected:.1e} operations "
                "(--error-bar always repeats nevertheless)"
            )
        found = Failed("no other method can repeat the run")
        end = trajectory.end - SAME_ROW * (trajectory.end - trajectory.start)
        for other in by_other_means(session, trajectory):
            own, again = self._again(run, other, progress, always=always)
            repeated, plan = own.trajectory, own.plan
            if repeated.outcome is Outcome.INTERRUPTED:
                return "the repeat was interrupted"
            if wrong := finding_text(own):
                text = f"a repeat by {plan.method} is not valid itself: {wrong}"
                found = Failed(text)
            elif plan.method == session.plan.method and (
                steps_of(repeated) == steps_of(trajectory)
            ):
                text = f"a repeat by {plan.method} took the same steps as the run"
                found = Failed(text)
            elif repeated.outcome.complete or repeated.end >= end:
                runs = trajectory, repeated
                bar = compared(session.case, runs, plan, run.checkpoints, again)
                return self._by_own_steps(run, bar, always=always)
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
        own, again = self._again(run, shorter, always=always)
        if finding_text(own) or not own.trajectory.outcome.complete:
            return bar
        runs = run.trajectory, own.trajectory
        other = compared(run.session.case, runs, own.plan, run.checkpoints, again)
        return other if other.relative < LESS * bar.relative else bar

    def _is_outlier(self, run: Attempt) -> bool:
        """Whether a second, tighter repeat shows that the run is wrong.

        If the run has passed over a feature, both repeats agree far better with each
        other than with the run. If motions diverge exponentially, the differences are
        in proportion to the tolerances, and the run is not wrong.
        """
        bar, session = run.bar, run.session
        assert not isinstance(bar, str)
        other = next(by_other_means(session, run.trajectory), None)
        if bar.parted or other is None:
            return bool(bar.parted)
        way = other.session
        longest = GOLDEN * GOLDEN * way.longest_step
        way = way._replace(plan=tightened(way.plan, TIGHTER), longest_step=longest)
        own, third = self._again(run, other._replace(session=way))
        self.clock.lap("error_bar")
        if finding_text(own):
            return False
        found = third.numbered
        if not bar.repeated.keys() <= found.keys():
            return False
        alike = [np.abs(found[k] - row) for k, row in bar.repeated.items()]
        apart = np.max(third.valued(np.array(alike)), axis=0)
        return bool(np.max(bar.lost_by(apart)) < ALIKE * np.max(bar.lost))

    def _again(
        self,
        run: Attempt,
        other: Repeat,
        progress: Advance = None,
        *,
        always: bool = False,
    ) -> tuple[Evidence, Checkpoints]:
        """Repeat a run by the integration `other`; subtract the cost from the budget.

        always : whether the repeat may exceed the allowance.

        Returns
        -------
        evidence : Evidence
            The evidence of the repeat for its own audit.
        again : Checkpoints
            The rows of the repeat.
        """
        rows, case = run.checkpoints, other.session.case
        finer = -(-LEAST_ROWS // len(rows.rows)) if rows.stride == 1 else 1
        spacing = rows.stride * case.settings.output_step / finer
        other = other._replace(session=other.session.with_settings(output_step=spacing))
        settings = other.session.case.settings
        again = Checkpoints(case.equations, settings, finer)
        assert self.allowance is not None
        most = MOST_STEPS
        if not always:
            most = self.allowance.steps_beside(run.session, run.trajectory, other)
        limited = other.limited(most)
        evidence = Evidence(limited)
        found = limited.run(
            [again, evidence], interrupt=self.interrupt, progress=progress
        )
        self.allowance.take(other, found)
        return evidence.end(found, "a repeat has none"), again

    def _second_session(self, first: Attempt, finding: Finding) -> Session | None:
        """Return a session for a second attempt at a run, by other means; None if none.

        It has another method, tolerance or formulation, or shorter steps.

        first : the attempt that failed the audit.
        finding : the reason.
        """
        trajectory = first.trajectory
        other = next(by_other_means(first.session, trajectory), None)
        if other is None:
            return None
        way, before = other.session, first.session.plan
        longest = SHORTER * way.longest_step
        least = (trajectory.end - trajectory.start) / longest
        worth = trajectory.statistics.evaluations / PER_ATTEMPT
        second = Repeat(way, PER_ATTEMPT)
        assert self.allowance is not None
        most = max(ENOUGH, int(MORE * worth + AT_LEAST * least))
        way = second.limited(max(1, min(most, self.allowance.steps(second))))
        rtol = "" if way.plan.rtol is None else f" at rtol {way.plan.rtol:.2g}"
        choice = Choice(
            f"repeated: {way.plan.method}{rtol}, steps up to {longest:.3g}",
            f"{before.method} fails from t = {finding.time:.9g} on: {finding.text}",
        )
        plan = replace(way.plan, choices=(*before.choices, choice))
        return way._replace(plan=plan, longest_step=longest)
