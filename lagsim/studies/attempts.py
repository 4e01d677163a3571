"""The rows of a run: made, with an error bar, judged, and regenerated where they fail.

One attempt goes the whole way: rows to their observers, the repeat that estimates their
error, the audit of both. Where that has a finding, a second attempt by other means
takes the place of the first; where it fails as well, the run has no answer from the
time on that the verdict names, and says so.

A local error says little of the motion: the estimate is the difference of two whole
runs, so that it knows how errors grow on the way. The error of a coordinate is measured
by its range; where it rests but for rounding, by its value, by the motion of what
constraints link with it, or by how far the forces on it would take it.

A repeat with the same steps would have the same blind spots: what one step passes over,
and what a step at the bound of stability is off by, is then no difference. So it is
made at a hundredth of the tolerance, and in steps that are forced to be others: none is
longer than a part of the output step, nor, where the method is the same, than a part of
the run's own; and by another method where something might hide from this one's steps.
Where the tolerance is as tight as any, the repeat's is looser. The counts of both runs
are compared: a repeat that has made the run's own steps is no estimate, and another is
made.

The repeat costs a few times the run. Costs are counted in operations, never in seconds,
so that a rerun gives the same result: every repeat may cost some times the run; and all
of them together, with what is repeated besides, no more than an allowance that the run
itself sets.
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
from lagsim.plan.plan import ANY, Plan
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
from lagsim.studies.alarms import (
    Evidence,
    Finding,
    alarms,
    audit,
    constraint_residual,
    fault,
    inertia_roots,
    up_to,
)
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
    from lagsim.program.system import System
    from lagsim.run.session import Case, Clock, Session

    # Takes a run, and by their names its `relay` and `session`.
    Joined: TypeAlias = Callable[..., None]
    Advance: TypeAlias = Callable[[float], None] | None
    Progress: TypeAlias = Callable[[str], contextlib.AbstractContextManager[Advance]]

# What moves by a million times its error does not rest.
RESOLVED_BY = 1e-6


def _scales(
    found: Floats, moving: Floats, linked: Floats, largest: Floats, held: Floats
) -> tuple[Floats, Floats]:
    """Return the scales of errors (n,), and the ranges below which there is no horizon.

    Parameters
    ----------
    found, moving, linked, largest, held
        Of each coordinate the range, the motion beside it, that of what it is linked
        with, the largest value, and how far it would move if nothing held it.
    """
    scales = np.fmax(found, COMPUTED_ZERO * moving)
    for size in (largest, linked):
        scales = np.where(found > SUM_ROUNDOFF * size, scales, np.fmax(scales, size))
    scales = np.where(found <= SUM_ROUNDOFF * held, np.fmax(scales, held), scales)
    still = np.fmax(NO_MOTION * moving, SUM_ROUNDOFF * held / LOST)
    return scales, np.fmax(still, SUM_ROUNDOFF * largest / LOST)


def compared(
    case: Case,
    runs: tuple[Trajectory, Trajectory],
    plan: Plan,
    checkpoints: Checkpoints,
    again: Checkpoints,
) -> ErrorBar:
    """Return the error bar of a run by a repeat: rows of the same numbers, and ends.

    Parameters
    ----------
    runs, checkpoints, again
        The run and its repeat, and the rows of each.
    plan
        Of the repeat.
    """
    equations, start, n = case.equations, case.start, len(case.equations.q)
    run, repeated = runs
    repeats = again.numbered
    pairs = [(x, repeats[k]) for k, x in checkpoints.numbered.items() if k in repeats]
    apart = abs(run.end - repeated.end)
    alike = run.outcome is repeated.outcome and apart < case.settings.output_step
    assert checkpoints.last is not None
    assert again.last is not None
    if alike and checkpoints.last[0] > pairs[-1][0][0]:
        pairs.append((checkpoints.last, again.last))
    mine, theirs = np.array(pairs).swapaxes(0, 1)
    every = np.abs(theirs - mine)
    every = np.fmax(every, UNIT_ROUNDOFF * _largest(mine))
    # Times are rounded, too, also those at which forces step.
    late = UNIT_ROUNDOFF * _largest(mine[:, :1] * mine[:, 1 + n : 1 + 2 * n])
    every[:, 1 : 1 + n] = np.fmax(every[:, 1 : 1 + n], late)
    errors = checkpoints.valued(every)
    own, worst = checkpoints.high - checkpoints.low, np.max(errors, axis=0)
    names = *equations.q, *(x.name for x in equations.states)
    # Of rows and of steps: rows may be few, or show oscillations in the same phase.
    nothing = np.nan, np.nan
    steps = np.array([repeated.extents.get(name, nothing) for name in names]).T
    low = np.fmin.reduce([checkpoints.low, again.low, steps[0]])
    high = np.fmax.reduce([checkpoints.high, again.high, steps[1]])
    sizes = np.asarray(high - low)
    # Where the two are apart, the repeat's motion is another one; it counts only where
    # the run has hardly moved.
    sizes = np.where((worst > LOST * sizes) & (own > LOST * sizes), own, sizes)
    roots = inertia_roots(equations, start)
    labels = joined(n, [row.A.entries for row in equations.rows])
    moving, linked, held = np.zeros((3, len(names)))
    moving[:n] = largest_beside(roots, sizes[:n])
    linked[:n] = in_groups(labels, roots, sizes[:n])
    largest = np.max(np.abs(checkpoints.valued(mine)), axis=0)
    # What constraints link shares the rounding of its positions.
    largest[:n] = np.fmax(largest[:n], in_groups(labels, roots, largest[:n]))
    scales, still = _scales(sizes, moving, linked, largest, held)
    # All else moves by far more than its error, or than a part of what moves beside it.
    slow = (sizes <= NO_MOTION * moving) | (worst > RESOLVED_BY * scales)
    if slow[:n].any():
        which, step = np.flatnonzero(slow[:n]).tolist(), case.settings.output_step
        held[:n] = could_push(equations, mine, which, step).reach
        if equations.states:
            held[n:] = could_follow(equations, mine, held[:n])
        scales, still = _scales(sizes, moving, linked, largest, held)
    rounding = np.fmax(SUM_ROUNDOFF * largest, SUM_ROUNDOFF * held)
    parted = ""
    if run.outcome.complete and repeated.outcome.complete and not alike:
        parted = (
            f"it ended with `{run.outcome.word}` at t = {run.end:.9g}, and a repeat by "
            f"{plan.method} with `{repeated.outcome.word}` at t = {repeated.end:.9g}"
        )
    return ErrorBar(
        method=plan.method,
        rtol=plan.rtol,
        names=names,
        times=mine[:, 0],
        errors=errors,
        scales=scales,
        still=still,
        rates=every[:, 1 + n : 1 + 2 * n],
        repeated=repeats,
        parted=parted,
        rests=bool(np.all(sizes <= rounding)),
    )


def _largest(values: Floats) -> Floats:
    """Return the largest sizes up to each row (k, n)."""
    return np.asarray(np.maximum.accumulate(np.abs(values), axis=0))


# How much tighter the repeat's tolerance is, how much where that does not come to its
# end, and the loosest that a repeat is made at: loose ones may both be far off, and
# alike.
TIGHTER, LOOSER = 100.0, 3.0
LOOSEST = 1e-6
# That of the repeat of a method without error control.
FREE_RTOL = 1e-13
# Its error may be so large a part of a range: 1e5 of its tolerances.
AGREED = 1e-8
# The difference to steps shortened by GOLDEN is 0.38 of the error, at order 1, to all
# of it: where it is less than this part of another estimate, that is off by more.
LESS = 0.3
# A method whose steps are exact, whatever their length.
EXACT = "exponential"
# The longest step of a repeat, as a part of the output step (not a ratio of small whole
# numbers: looks fall elsewhere in each row), and of the steps of the same method.
WITHIN = 0.75**0.5
GOLDEN = (5.0**0.5 - 1.0) / 2.0
# Operations that a repeat may always take to keep its steps short.
SHORT = 2e7
# Evaluations in a step with rows in it, of what repeats most runs.
PER_STEP = 15.0
# Of a series: it is evaluated once, and once more where rounding is carried.
SERIES_STEP = 2.0

# Operations that a repeat may take without being asked for: about 2 s.
BUDGET = 2e9
# No repeat takes more than so many times the run, or so many operations: one that does
# has encountered something that the run has not.
MOST_TIMES = 20.0
ALWAYS = 2e8
# All that judges a run takes no more than so many times the run, and so many operations
# besides: about 2 s, where constraints are solved by loops 10 s.
WHOLE_TIMES = 10.0
WHOLE = 1e9
# Evaluations and columns of a row cost about this much besides their operations.
OVERHEAD = 20
# A series takes about so many times the operations of the rates that it is made of.
SERIES_LENGTH = 50
# What an arc costs besides its steps, as it is begun in Python: a millisecond. It
# counts for less, since a repeat may have to go through switches that the run missed:
# through 2000 of them, at least; and through so many times those of the run.
ARC = 1e5
MOST_ARCS = 3.0

# Rows of the repeat, at least: ranges are taken from them, too.
LEAST_ROWS = 64
# Two repeats agree by far where they are apart by this part of what the run is off.
ALIKE = 1e-4


def cost(system: System, method: str) -> float:
    """Return the cost of an evaluation, in operations."""
    operations = float(system.operations)
    if system.plan.method == SERIES and method != SERIES:
        operations /= SERIES_LENGTH
    return operations + OVERHEAD


def own_cost(system: System, trajectory: Trajectory) -> float:
    """Return the cost of the evaluations of a run, in operations."""
    return trajectory.statistics.evaluations * cost(system, system.plan.method)


class Repeat(NamedTuple):
    """Other means of integration: a session, and the evaluations in a step."""

    session: Session
    per_step: float = PER_STEP

    @property
    def evaluation(self) -> float:
        """The cost of an evaluation, in operations."""
        return cost(self.session.system, self.session.plan.method)

    @property
    def step(self) -> float:
        """The cost of a step, in operations."""
        return self.per_step * self.evaluation

    def limited(self, most: int) -> Session:
        """Return the session with a limit on steps; an arc counts as some of them."""
        arc = ARC / self.step if most < MOST_STEPS else 0.0
        return self.session._replace(most_steps=most, arc_steps=arc)


class Allowance:
    """The budget of operations left for the verification of a run."""

    def __init__(self, system: System, trajectory: Trajectory) -> None:
        arcs = ARC * trajectory.statistics.arcs
        self.left = WHOLE_TIMES * (own_cost(system, trajectory) + arcs) + WHOLE

    def steps(self, other: Repeat, operations: float = math.inf) -> int:
        """Return the number of steps that so many operations allow, or what is left."""
        return int(min(operations, self.left) / other.step)

    def take(self, other: Repeat, trajectory: Trajectory) -> None:
        """Charge the cost of a run by such means."""
        made = trajectory.statistics
        price = made.evaluations * other.evaluation + ARC * made.arcs
        self.left = max(0.0, self.left - price)


def by_other_means(session: Session, trajectory: Trajectory) -> Iterator[Repeat]:
    """Return other means of integration, the best first."""
    plan, system, settings = session.plan, session.system, session.case.settings
    span = trajectory.end - trajectory.start

    def way(plan: Plan, longest: float, session: Session = session) -> Session:
        """Return a session with steps as long as they must be to be affordable."""
        own = own_cost(session.system, trajectory)
        most = min(max(2.0 * own, SHORT), BUDGET / 2.0)
        price = PER_STEP * cost(session.system, plan.method)
        longest = max(longest, span * price / most)
        return session._replace(plan=plan, longest_step=longest)

    mean = span / max(trajectory.statistics.steps, 1)
    within = WITHIN * settings.output_step
    if plan.rtol is None and plan.method == EXACT:
        yield Repeat(
            way(replace(plan, method=ANY, rtol=TIGHTEST_RTOL, step=None), within)
        )
        assert plan.step is not None
        others = replace(plan, step=GOLDEN * plan.step)
        yield Repeat(session._replace(plan=others, longest_step=within), 1.0)
        return
    if plan.rtol is None:
        free = session.case.asking(
            method=ANY, formulation="auto", rtol=FREE_RTOL, atol=None
        ).ready()
        found = way(free.plan, within, free)
        yield Repeat(found._replace(case=session.case))
        return
    same = GOLDEN * min(mean, settings.output_step)
    per_step = SERIES_STEP if plan.method == SERIES else PER_STEP
    # A series that misses no feature of the model, whatever its steps, has other means
    # enough in other steps.
    sees_all = not system.indicators
    for tighter in (tightened(plan, TIGHTER), tightened(plan, LOOSER)):
        is_tighter = not plan.rtol or (tighter.rtol or 0.0) < plan.rtol
        # The tolerance may leave another method no room to be better.
        room = not plan.rtol or ((tighter.rtol or 0.0) > TIGHTEST_RTOL and is_tighter)
        alike = plan.method == SERIES and (sees_all or not room)
        if plan.method != ANY and not alike:
            yield Repeat(way(replace(tighter, method=ANY), within))
        if plan.method == ANY or alike or plan.method != SERIES:
            found = way(tighter, same)
            if not is_tighter:
                longest = min(found.longest_step, GOLDEN * mean)
                found = found._replace(longest_step=longest)
            yield Repeat(found, per_step)
    # Shorter than half of the run's steps cannot be the same.
    shortest = tightened(plan, TIGHTER)
    found = session._replace(plan=shortest, longest_step=GOLDEN * GOLDEN * mean)
    yield Repeat(found, per_step)


def tightened(plan: Plan, times: float) -> Plan:
    """Return the plan of a repeat: its tolerance is never nearly that of the run."""
    rtol = plan.rtol or 0.0
    if rtol:
        rtol = min(max(rtol / times, TIGHTEST_RTOL), LOOSEST)
        assert plan.rtol is not None
        if max(rtol / plan.rtol, plan.rtol / rtol) < (1.0 - 1e-9) * LOOSER:
            rtol = LOOSER * plan.rtol
    factor = rtol / plan.rtol if plan.rtol else 1.0 / times
    atol = None if plan.atol is None else plan.atol * min(factor, 1.0)
    return replace(plan, rtol=rtol, atol=atol)


def _steps(trajectory: Trajectory) -> tuple[float | None, ...]:
    """Return counts, and the shortest step to the last bit, that tell all steps."""
    made = trajectory.statistics
    return made.steps, made.rejections, made.smallest_step


# The steps of a second attempt are shorter than those of the repeat that failed to
# confirm the first: by this part, which no small whole numbers give.
SHORTER = 0.3819660112501051
# A second attempt may make so many times the steps that the evaluations of the first
# are worth, and so many times those that it must make; or so many, whatever it was.
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
    """The rows of a run: what judges them, and what is kept of them besides.

    Attributes
    ----------
    checkpoints
        Those that a repeat is compared with.
    thin, corners, frames
        Those for pictures, those at events, and those of a page; None where they are
        not wanted.
    found : Sections or None
        Its sections; None where there are none.
    extremes : Extremes or None
        The ranges of columns, for pictures of these.
    fault : OSError or None
        Why not all of them could be stored.
    """

    fault: OSError | None = None

    def __init__(self, session: Session, wish: Attempts) -> None:
        super().__init__(session)
        model, names = self.equations.model, session.columns.names
        self.checkpoints = Checkpoints(self.equations, session.case.settings)
        self.corners = Corners() if wish.cornered or wish.thinned else None
        self.thin = picture_thinning(model, names) if wish.thinned else None
        self.found: Sections | None = None
        if model.output.sections:
            self.found = Sections(model, session.columns.table)
        self.extremes: Extremes | None = None
        if self.found is not None and wish.thinned:
            self.extremes = Extremes(session.columns.table)
        self.frames: Frames | None = None
        if wish.animated:
            from lagsim.outputs.animation import frames_of

            self.frames = frames_of(self.equations, names)

    @property
    def sections(self) -> dict[str, Floats]:
        """Rows (k, columns) of the sections that are asked for."""
        if self.found is None:
            return {}
        return self.found.tables([x.name for x in self.equations.model.output.sections])

    def cautions(self) -> list[Caution]:
        """Return all warnings on it."""
        found = alarms(self)
        if self.frames is not None:
            from lagsim.outputs.animation import nothing_to_draw

            found += nothing_to_draw(self.equations.model)
        return found

    def record(
        self,
        cautions: Sequence[Caution],
        timings: Mapping[str, float],
        files: Sequence[str],
    ) -> dict[str, Any]:
        """Return the content of run.json."""
        return manifest(
            self.session, self.trajectory, self.residuals, constraint_residual(self),
            self.bar, cautions,
            {name: round(t, 6) for name, t in timings.items()}, files,
        )  # fmt: skip


def _means(plan: Plan) -> str:
    """Return a method with its tolerance, or its step."""
    own = f"step {plan.step:.3g}" if plan.rtol is None else f"rtol {plan.rtol:.2g}"
    return f"{plan.method} at {own}"


@dataclass
class Attempts:
    """Makes the rows of a run.

    Attributes
    ----------
    store
        Gets the rows.
    thinned, animated
        They are kept for pictures, and for a page, too.
    cornered
        Those at events are kept, for pictures that are made of other rows.
    progress
        Gives, for what is done, what is to be called with the fraction done.
    joined
        Gets the run of the first attempt before it begins.
    followers
        Get the rows of the attempt that is given, as far as the store could take them.
    allowance
        What all that judges the first attempt may still cost.
    tried
        The methods, and their tolerances or steps, by which rows have been made.
    """

    store: Store
    interrupt: Interrupt
    clock: Clock
    _: KW_ONLY
    error_bars: ErrorBars = ErrorBars.AUTO
    thinned: bool = False
    cornered: bool = False
    animated: bool = False
    progress: Progress = lambda _label: contextlib.nullcontext()
    joined: Joined | None = None
    followers: Sequence[Store] = ()
    allowance: Allowance | None = field(default=None, init=False)
    tried: list[str] = field(default_factory=list, init=False)

    def best(self, session: Session) -> Attempt:
        """Make the rows; regenerate them where the audit has a finding."""
        first = self._made(session)
        finding = None if self.interrupt.asked else audit(first)
        if finding is None or not (finding.refutes or self._is_outlier(first)):
            return first
        others = self._others(first, finding)
        if others is None:
            return self._judged(first, finding)
        second = self._made(others)
        if self.interrupt.asked:
            return second
        if second.trajectory.outcome.complete:
            return self._judged(second, audit(second))
        return self._judged(self._made(session, first.bar), finding)

    def _judged(self, attempt: Attempt, finding: Finding | None) -> Attempt:
        """Return an attempt after a verdict that nothing can change.

        Rows end where constraints part.
        """
        if finding is None or not finding.refutes:
            return attempt
        reason = f"from t = {finding.time:.9g} on the rows are not valid: "
        reason += finding.text
        if finding.parts:
            attempt = self._made(up_to(attempt.session, finding.time), attempt.bar)
            end = attempt.trajectory.end
            reason += f"; the last row, at t = {end:.9g}, satisfies it"
        reason += f" (tried: {', '.join(dict.fromkeys(self.tried))})"
        outcome = Outcome.NO_ANSWER
        trajectory = attempt.trajectory._replace(
            outcome=outcome, reason=f"{reason}: {outcome.advice}"
        )
        # What a repeat says of a motion that is no answer is no error.
        attempt.end(trajectory, "the rows are not valid")
        return attempt

    def _made(self, session: Session, bar: ErrorBar | str | None = None) -> Attempt:
        """Make one attempt; the store and all that rows go to begin again.

        `bar` is what a repeat says of it, where one has been made before.
        """
        made = Attempt(session, self)
        self.tried.append(_means(session.plan))
        for store in (self.store, *self.followers) if self.store.rows else ():
            store.begin_anew()
        kept: list[Observer | None] = [made, *self.followers, made.thin, made.frames]
        kept.append(made.extremes)
        kept += [] if self.error_bars is ErrorBars.NEVER else [made.checkpoints]
        others: list[Observer] = [x for x in kept if x is not None]
        relay = Relay(self.store, others, self.interrupt)
        clock = self.clock
        clock.lap("output")
        import_module("lagsim.run.arcs")  # not while the clock runs for it
        clock.lap("import")
        joined, self.joined = self.joined, None
        with self.progress("run") as progress:
            trajectory = session.run(
                [relay], interrupt=self.interrupt, progress=progress,
                corners=made.corners, sections=made.found,
                joined=joined and partial(joined, relay=relay, session=session),
            )  # fmt: skip
            if progress is not None and trajectory.outcome.complete:
                progress(1.0)
            clock.lap("integrate")
        clock.timings["integrate"] -= relay.seconds
        clock.timings["output"] += relay.seconds
        made.fault = relay.fault
        made.end(trajectory, "not asked for" if bar is None else bar)
        if bar is None:
            # The first attempt sets the allowance, and what others cost is taken of it.
            if self.allowance is None:
                self.allowance = Allowance(session.system, trajectory)
            else:
                self.allowance.take(Repeat(session), trajectory)
            made.bar = self._error_bar(made)
        return made

    def _error_bar(self, made: Attempt) -> ErrorBar | str:
        """Estimate the error of the run, or say why not."""
        self.clock.lap("import")
        if self.error_bars is ErrorBars.NEVER:
            return "not asked for"
        if self.interrupt.asked:
            return "the run was cut short"
        with self.progress("error bar") as progress:
            bar = self.repeated(made, progress)
            if progress is not None and not isinstance(bar, str):
                progress(1.0)
        self.clock.lap("error_bar")
        return bar

    def repeated(self, run: Attempt, progress: Advance = None) -> ErrorBar | str:
        """Return the error bar of a run, or why there is none.

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
                f"a repeat would take about {expected:.1e} operations "
                "(--error-bar always makes it)"
            )
        found = Failed("no other method can repeat the run")
        end = trajectory.end - SAME_ROW * (trajectory.end - trajectory.start)
        for other in by_other_means(session, trajectory):
            own, again = self._again(run, other, progress, always=always)
            repeated, plan = own.trajectory, own.plan
            if repeated.outcome is Outcome.INTERRUPTED:
                return "the repeat was interrupted"
            if wrong := fault(own):
                text = f"a repeat by {plan.method} is not valid itself: {wrong}"
                found = Failed(text)
            elif plan.method == session.plan.method and (
                _steps(repeated) == _steps(trajectory)
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
        """Return the error bar of fixed steps by shorter ones, where that is far less.

        A repeat with error control may be the less accurate of both. Where they agree
        as far as its tolerance leads one to expect, nothing has been passed over, and
        the difference to shorter steps of the same method tells the error.
        """
        plan = run.session.plan
        fixed = plan.rtol is None and plan.method not in (EXACT, bar.method)
        if not fixed or bar.parted or bar.relative > AGREED:
            return bar
        assert plan.step is not None
        row = run.session.case.settings.output_step
        step = GOLDEN * plan.step
        if step < row:  # rows stay ends of steps
            step = row / math.ceil(row / step)
        shorter = Repeat(run.session._replace(plan=replace(plan, step=step)), 1.0)
        own, again = self._again(run, shorter, always=always)
        if fault(own) or not own.trajectory.outcome.complete:
            return bar
        runs = run.trajectory, own.trajectory
        other = compared(run.session.case, runs, own.plan, run.checkpoints, again)
        return other if other.relative < LESS * bar.relative else bar

    def _is_outlier(self, run: Attempt) -> bool:
        """Return whether a run, and not its repeat, is wrong: by a third one.

        Two that are tighter agree better by far where the run has passed over
        something; by as much as their tolerances differ where motions part
        exponentially.
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
        if fault(own):
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
        """Run other means, charge their cost; return what judges them, and rows."""
        rows, case = run.checkpoints, other.session.case
        finer = -(-LEAST_ROWS // len(rows.rows)) if rows.stride == 1 else 1
        spacing = rows.stride * case.settings.output_step / finer
        other = other._replace(session=other.session.asking(output_step=spacing))
        settings = other.session.case.settings
        again = Checkpoints(case.equations, settings, finer)
        assert self.allowance is not None
        most = MOST_STEPS
        if not always:
            own = own_cost(run.session.system, run.trajectory)
            operations = min(BUDGET, max(MOST_TIMES * own, ALWAYS))
            operations += MOST_ARCS * ARC * run.trajectory.statistics.arcs
            most = self.allowance.steps(other, operations)
        limited = other.limited(most)
        evidence = Evidence(limited)
        found = limited.run(
            [again, evidence], interrupt=self.interrupt, progress=progress
        )
        self.allowance.take(other, found)
        return evidence.end(found, "a repeat has none"), again

    def _others(self, first: Attempt, finding: Finding) -> Session | None:
        """Return other means than those of an attempt with a finding."""
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
