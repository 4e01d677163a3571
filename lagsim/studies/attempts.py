"""The rows of a run: made, judged, and made anew by other means where they fail.

One attempt goes the whole way: rows to their observers, the repeat that estimates their
error, the verdict on both. Where that leaves a doubt, a second attempt by other means
takes the place of the first; where it fails as well, the run has no answer from the
time on that the verdict names, and says so.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace
from enum import Enum
from functools import cached_property, partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from lagsim.run.observers import Relay
from lagsim.run.observers.checkpoints import Checkpoints
from lagsim.run.observers.ledger import Ledger
from lagsim.run.observers.witness import Witness
from lagsim.run.overflow import Gaps

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Caution
    from lagsim.run.error import ErrorBar
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Observer, Store
    from lagsim.run.observers.corners import Corners
    from lagsim.run.observers.frames import Frames
    from lagsim.run.observers.thinning import Thinning
    from lagsim.run.session import Clock, Session
    from lagsim.run.trajectory import Trajectory
    from lagsim.studies.alarms import Doubt
    from lagsim.studies.balances import Balance, Whole
    from lagsim.studies.error_bar import Allowance

    # Takes a run, and by their names its `relay` and `session`.
    Joined: TypeAlias = Callable[..., None]
    Progress: TypeAlias = Callable[
        [str], contextlib.AbstractContextManager[Callable[[float], None] | None]
    ]

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


class Account:
    """What the rows of a run are judged by: their ledger, and a witness of the motion.

    A repeat has one as well: what is no answer itself accuses no run.
    """

    def __init__(self, session: Session) -> None:
        names, shown = session.system.columns.names, session.system.columns.table
        self.session = session
        self.gaps = Gaps(names[:shown])
        self.ledger = Ledger(names)
        self.witness = Witness(names, len(session.case.equations.q))

    @cached_property
    def balances(self) -> Sequence[Balance | Whole]:
        """Of each group of coordinates and of the whole, when all rows are there."""
        from lagsim.studies.balances import accounts

        equations, plan = self.session.case.equations, self.session.plan
        return list(accounts(equations, plan, self.ledger, self.witness))

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        self.gaps.add(rows)
        self.ledger.add(rows)
        self.witness.add(rows)

    def end(self, trajectory: Trajectory) -> None:
        """Take what steps have shown between rows."""
        self.witness.between_rows = trajectory.largest_energy
        self.witness.extents = trajectory.extents

    def doubt(self, trajectory: Trajectory, bar: ErrorBar | str) -> Doubt | None:
        """Give why they are in doubt, if they are."""
        from lagsim.studies.alarms import doubt_about

        known = self.ledger, self.witness, self.balances
        return doubt_about(self.session, trajectory, *known, bar)

    def fault(self, trajectory: Trajectory) -> str:
        """Say why they are no answer; "" where they may be one."""
        self.end(trajectory)
        doubt = self.doubt(trajectory, "a repeat has none")
        return "" if doubt is None else f"from t = {doubt.time:.6g} on, {doubt.text}"


class Attempt(NamedTuple):
    """The rows of a run; `fault` is why not all of them could be stored."""

    session: Session
    trajectory: Trajectory
    account: Account
    checkpoints: Checkpoints
    thin: Thinning | None
    corners: Corners | None
    frames: Frames | None
    bar: ErrorBar | str
    fault: OSError | None

    def cautions(self) -> list[Caution]:
        """Give all that there is to know about it."""
        from lagsim.studies.alarms import alarms

        own = self.account
        known = own.ledger, own.witness, own.balances
        found = alarms(self.session, self.trajectory, *known, self.bar)
        if own.gaps.found:
            from lagsim.studies.alarms import about_gaps

            found.append(about_gaps(own.gaps.found))
        if self.frames is not None:
            from lagsim.outputs.animation import nothing_to_draw

            found += nothing_to_draw(self.session.case.equations.model)
        return found

    def record(
        self,
        cautions: Sequence[Caution],
        timings: Mapping[str, float],
        files: Sequence[str],
    ) -> dict[str, Any]:
        """Give the content of run.json."""
        from lagsim.outputs.manifest import manifest

        return manifest(
            self.session, self.trajectory, self.account.ledger, self.bar, cautions,
            {name: round(t, 6) for name, t in timings.items()}, files,
        )  # fmt: skip


class Attempts:
    """Makes the rows of a run.

    Parameters
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
    """

    def __init__(
        self,
        store: Store,
        interrupt: Interrupt,
        clock: Clock,
        *,
        error_bars: ErrorBars = ErrorBars.AUTO,
        thinned: bool = False,
        cornered: bool = False,
        animated: bool = False,
        progress: Progress = lambda _label: contextlib.nullcontext(),
        joined: Joined | None = None,
    ) -> None:
        self.store, self.interrupt, self.clock = store, interrupt, clock
        self.error_bars, self.thinned, self.progress = error_bars, thinned, progress
        self.animated, self.cornered = animated, cornered or thinned
        self.joined = joined
        # What all that judges the first attempt may cost.
        self.allowance: Allowance | None = None

    def best(self, session: Session) -> Attempt:
        """Make the rows, anew where they are in doubt."""
        first = self._made(session)
        doubt = self._doubt(first)
        if doubt is None or not (doubt.refutes or self._is_outlier(first)):
            return first
        others = self._others(first, doubt)
        if others is None:
            return self._judged(first, doubt)
        second = self._made(others)
        if second.trajectory.outcome.complete or self.interrupt.asked:
            return self._judged(second, self._doubt(second))
        return self._judged(self._made(session, first.bar), doubt)

    def _judged(self, attempt: Attempt, doubt: Doubt | None) -> Attempt:
        """Give an attempt after the verdict; rows end where constraints part."""
        if doubt is not None and doubt.parts and doubt.refutes:
            from lagsim.studies.alarms import up_to

            attempt = self._made(up_to(attempt.session, doubt.time), attempt.bar)
        return _judged(attempt, doubt)

    def _made(self, session: Session, bar: ErrorBar | str | None = None) -> Attempt:
        """Make one attempt; the store and all that rows go to begin anew.

        `bar` is what a repeat says of it, where one has been made before.
        """
        case, names = session.case, session.system.columns.names
        account = Account(session)
        checkpoints = Checkpoints(len(case.equations.q), case.settings)
        thin = frames = corners = None
        if self.cornered:
            from lagsim.run.observers.corners import Corners

            corners = Corners()
        if self.thinned:
            from lagsim.run.observers.thinning import picture_thinning

            thin = picture_thinning(case.equations.model, names)
        if self.animated:
            from lagsim.outputs.animation import frames_of

            frames = frames_of(case.equations, names)
        if self.store.rows:
            self.store.begin_anew()
        others: list[Observer] = [account]
        others += [] if self.error_bars is ErrorBars.NEVER else [checkpoints]
        others += [x for x in (thin, frames) if x is not None]
        relay = Relay(self.store, others, self.interrupt)
        clock = self.clock
        clock.lap("output")
        import_module("lagsim.run.arcs")  # not while the clock runs for it
        clock.lap("import")
        joined, self.joined = self.joined, None
        with self.progress("run") as progress:
            trajectory = session.run(
                [relay], interrupt=self.interrupt, progress=progress, corners=corners,
                joined=joined and partial(joined, relay=relay, session=session),
            )  # fmt: skip
            if progress is not None and trajectory.outcome.complete:
                progress(1.0)
            clock.lap("integrate")
        account.end(trajectory)
        clock.timings["integrate"] -= relay.seconds
        clock.timings["output"] += relay.seconds
        if bar is None:
            self._charge(session, trajectory)
            bar = self._error_bar(session, trajectory, checkpoints)
        return Attempt(
            session, trajectory, account, checkpoints, thin, corners, frames, bar,
            relay.fault,
        )  # fmt: skip

    def _charge(self, session: Session, trajectory: Trajectory) -> None:
        """Let the first attempt set the allowance; take from it what others cost."""
        from lagsim.studies.error_bar import Allowance, Price

        if self.allowance is None:
            self.allowance = Allowance(session.system, trajectory)
        else:
            price = Price(session.system, session.plan.method, PER_STEP)
            self.allowance.take(price, trajectory)

    def _error_bar(
        self, session: Session, trajectory: Trajectory, checkpoints: Checkpoints
    ) -> ErrorBar | str:
        """Estimate the error of the run, or say why not."""
        from lagsim.studies.error_bar import repeat

        self.clock.lap("import")
        if self.error_bars is ErrorBars.NEVER:
            return "not asked for"
        if self.interrupt.asked:
            return "the run was cut short"
        always = self.error_bars is ErrorBars.ALWAYS
        with self.progress("error bar") as progress:
            bar = repeat(
                session, trajectory, checkpoints, always=always, account=Account,
                allowance=self.allowance, interrupt=self.interrupt, progress=progress,
            )  # fmt: skip
            if progress is not None and not isinstance(bar, str):
                progress(1.0)
        self.clock.lap("error_bar")
        return bar

    def _doubt(self, attempt: Attempt) -> Doubt | None:
        if self.interrupt.asked:
            return None
        return attempt.account.doubt(attempt.trajectory, attempt.bar)

    def _is_outlier(self, attempt: Attempt) -> bool:
        """Ask a third run which of two is off."""
        from lagsim.studies.error_bar import is_outlier

        bar = attempt.bar
        assert not isinstance(bar, str)
        found = bool(bar.parted) or is_outlier(
            attempt.session, attempt.trajectory, attempt.checkpoints, bar,
            account=Account, allowance=self.allowance, interrupt=self.interrupt,
        )  # fmt: skip
        self.clock.lap("error_bar")
        return found

    def _others(self, first: Attempt, doubt: Doubt) -> Session | None:
        """Give other means than those of an attempt that is in doubt."""
        from lagsim.notes import Choice
        from lagsim.studies.error_bar import Price, by_other_means

        trajectory = first.trajectory
        other = next(by_other_means(first.session, trajectory), None)
        if other is None:
            return None
        way, before = other.session, first.session.plan
        longest = SHORTER * way.longest_step
        least = (trajectory.end - trajectory.start) / longest
        worth = trajectory.statistics.evaluations / PER_STEP
        most = max(ENOUGH, int(MORE * worth + AT_LEAST * least))
        price = Price(way.system, way.plan.method, PER_STEP)
        assert self.allowance is not None
        most = max(1, self.allowance.most(price, most))
        rtol = "" if way.plan.rtol is None else f" at rtol {way.plan.rtol:.2g}"
        choice = Choice(
            f"repeated: {way.plan.method}{rtol}, steps up to {longest:.3g}",
            f"{before.method} fails from t = {doubt.time:.9g} on: {doubt.text}",
        )
        plan = replace(way.plan, choices=(*before.choices, choice))
        return way._replace(
            plan=plan, longest_step=longest, most_steps=most, arc_steps=price.arc
        )


def _judged(attempt: Attempt, doubt: Doubt | None) -> Attempt:
    """Give an attempt as what it is after a verdict that nothing can change."""
    from lagsim.run.trajectory import Outcome

    if doubt is None or not doubt.refutes:
        return attempt
    outcome = Outcome.NO_ANSWER
    reason = f"from t = {doubt.time:.9g} on the rows are not valid: {doubt.text}"
    if doubt.parts:
        reason += f"; the last row, at t = {attempt.trajectory.end:.9g}, satisfies it"
    trajectory = attempt.trajectory._replace(
        outcome=outcome, reason=f"{reason}: {outcome.advice}"
    )
    # What a repeat says of a motion that is no answer is no error.
    return attempt._replace(trajectory=trajectory, bar="the rows are not valid")
