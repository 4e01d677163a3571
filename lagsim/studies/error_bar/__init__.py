"""The error of a run, estimated: what a repeat by other means gives instead.

A local error says little of the motion: the estimate is the difference of two whole
runs, so that it knows how errors grow on the way. A repeat with the same steps would
have the same blind spots: what one step passes over, and what a step at the bound of
stability is off by, is then no difference. So it is made at a hundredth of the
tolerance, and in steps that are forced to be others: none is longer than a part of the
output step, nor, where the method is the same, than a part of the run's own; and by
another method where something might hide from this one's steps. Where the tolerance is
as tight as any, the repeat's is looser. The counts of both runs are compared: a repeat
that has made the run's own steps is no estimate, and another is made.

The repeat costs a few times the run. It is made while that stays within a number of
operations, never of seconds, so that a rerun gives the same result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from lagsim.language.evaluate import UNIT_ROUNDOFF
from lagsim.run.error import LOST, TIMES, CoordinateError, ErrorBar, Failed
from lagsim.run.observers import Observer
from lagsim.run.observers.checkpoints import MOST_ROWS, Checkpoints
from lagsim.run.pace import MOST_STEPS
from lagsim.run.trajectory import Outcome
from lagsim.studies.error_bar.means import (
    BUDGET,
    GOLDEN,
    TIGHTER,
    Allowance,
    Price,
    Repeat,
    by_other_means,
    cost,
    has_same_steps,
    tightened,
)
from lagsim.studies.error_bar.scales import (
    STILL,
    beside,
    hardly_moving,
    is_at_rest,
    linked,
    ranges,
    scales_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats
    from lagsim.plan.plan import Plan
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case, Session
    from lagsim.run.trajectory import Trajectory

__all__ = [
    "BUDGET",
    "LOST",
    "MOST_ROWS",
    "STILL",
    "TIMES",
    "Allowance",
    "Checkpoints",
    "CoordinateError",
    "ErrorBar",
    "Price",
    "Repeat",
    "beside",
    "by_other_means",
    "is_outlier",
    "repeat",
]

# Rows of the repeat, at least: ranges are taken from them, too.
LEAST_ROWS = 64
# Two repeats agree by far where they are apart by this part of what the run is off.
ALIKE = 1e-4


class Account(Observer, Protocol):
    """What the rows of a repeat are judged by before it may accuse a run."""

    def fault(self, trajectory: Trajectory) -> str:
        """Say why they are no answer; "" where they may be one."""


def repeat(
    session: Session,
    trajectory: Trajectory,
    checkpoints: Checkpoints,
    *,
    always: bool = False,
    account: Callable[[Session], Account] | None = None,
    allowance: Allowance | None = None,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> ErrorBar | str:
    """Give the error bar of a run, or why there is none.

    Parameters
    ----------
    session, trajectory, checkpoints
        Of the run.
    always
        Whatever it costs.
    account
        Gives what judges a repeat; one that fails says nothing, and another is made.
    allowance
        What is left for the judging of the run; by default as much as there ever is.
    progress
        Called with the fraction of the repeat that is done.
    """
    if len(checkpoints.rows) < 2:
        return "there are too few rows to compare"
    system, case = session.system, session.case
    evaluations = trajectory.statistics.evaluations
    expected = 2.0 * evaluations * cost(system, session.plan.method)
    if expected > BUDGET and not always:
        return (
            f"a repeat would take about {expected:.1e} operations "
            "(--error-bar always makes it)"
        )
    allowance = allowance or Allowance(system, trajectory)
    found = Failed("no other method can repeat the run")
    for other in by_other_means(session, trajectory):
        price, way = other.price, other.session
        most = allowance.steps(price, system, trajectory)
        way, again = _spaced(way, checkpoints)
        limits = (MOST_STEPS, 0.0) if always else (most, price.arc)
        way = way._replace(most_steps=limits[0], arc_steps=limits[1])
        own = None if account is None else account(way)
        repeated = way.run(
            [again, *([own] if own else [])], interrupt=interrupt, progress=progress
        )
        allowance.take(price, repeated)
        if repeated.outcome is Outcome.INTERRUPTED:
            return "the repeat was interrupted"
        fault = own.fault(repeated) if own else ""
        if fault:
            text = f"a repeat by {way.plan.method} is not valid itself: {fault}"
            found = Failed(text)
            continue
        if has_same_steps(session.plan, trajectory, way.plan, repeated):
            found = Failed(
                f"a repeat by {way.plan.method} took the same steps as the run"
            )
            continue
        if _is_comparable(trajectory, repeated):
            runs = trajectory, repeated
            return _compared(case, runs, way.plan, checkpoints, again)
        where = f"{way.plan.method} ended at t = {repeated.end:.6g}"
        found = Failed(f"a repeat did not finish: {where}")
    return found


def is_outlier(
    session: Session,
    trajectory: Trajectory,
    checkpoints: Checkpoints,
    bar: ErrorBar,
    *,
    account: Callable[[Session], Account] | None = None,
    allowance: Allowance | None = None,
    interrupt: Interrupt | None = None,
) -> bool:
    """Tell whether it is the run, and not its repeat, that is off: by a third one.

    Two that are tighter agree better by far where the run has passed over something; by
    as much as their tolerances differ where motions part exponentially.
    """
    other = next(by_other_means(session, trajectory), None)
    if other is None:
        return False
    system, price = session.system, other.price
    way, third = _spaced(other.session, checkpoints)
    plan = tightened(way.plan, TIGHTER)
    allowance = allowance or Allowance(system, trajectory)
    way = way._replace(plan=plan, longest_step=GOLDEN * GOLDEN * way.longest_step,
        most_steps=allowance.steps(price, system, trajectory), arc_steps=price.arc,
    )  # fmt: skip
    own = None if account is None else account(way)
    made = way.run([third, *([own] if own else [])], interrupt=interrupt)
    allowance.take(price, made)
    if own and own.fault(made):
        return False
    found = third.numbered
    alike = [np.abs(found[k] - row) for k, row in bar.repeated.items() if k in found]
    if len(alike) < len(bar.repeated):
        return False
    n = len(session.case.equations.q)
    scales = bar.scales if bar.still is None else np.fmax(bar.scales, bar.still)
    apart = np.max(np.array(alike)[:, 1 : 1 + n], axis=0)
    parts = np.divide(apart, scales, out=np.zeros(n), where=scales > 0.0)
    return bool(np.max(parts) < ALIKE * np.max(bar.lost))


def _is_comparable(trajectory: Trajectory, repeated: Trajectory) -> bool:
    """Tell whether a repeat came as far, or to an end of its own."""
    if repeated.outcome.complete:
        return True
    span = trajectory.end - trajectory.start
    return repeated.end >= trajectory.end - 1e-6 * span


def _spaced(session: Session, checkpoints: Checkpoints) -> tuple[Session, Checkpoints]:
    """Give a session with the rows of a repeat, and what keeps those to compare."""
    count = len(checkpoints.rows)
    finer = -(-LEAST_ROWS // count) if checkpoints.stride == 1 else 1
    spacing = checkpoints.stride * session.case.settings.output_step / finer
    fine = session.asking(output_step=spacing)
    n = len(fine.case.equations.q)
    return fine, Checkpoints(n, fine.case.settings, finer)


def _compared(
    case: Case,
    runs: tuple[Trajectory, Trajectory],
    plan: Plan,
    checkpoints: Checkpoints,
    again: Checkpoints,
) -> ErrorBar:
    """Compare rows of the same numbers, as far as both go, and ends alike."""
    equations, start = case.equations, case.start
    n = len(equations.q)
    rows, others = [], []
    repeats = again.numbered
    for k, row in checkpoints.numbered.items():
        other = repeats.get(k)
        if other is not None:
            rows.append(row)
            others.append(other)
    assert checkpoints.last is not None
    assert again.last is not None
    run, repeated = runs
    apart = abs(run.end - repeated.end)
    alike = run.outcome is repeated.outcome and apart < case.settings.output_step
    if alike and checkpoints.last[0] > rows[-1][0]:
        rows.append(checkpoints.last)
        others.append(again.last)
    mine, theirs = np.array(rows), np.array(others)
    errors = np.abs(theirs[:, 1:] - mine[:, 1:])
    errors = np.fmax(errors, UNIT_ROUNDOFF * _largest(mine[:, 1:]))
    # Times are rounded, too, also those at which forces step.
    late = UNIT_ROUNDOFF * _largest(mine[:, :1] * mine[:, 1 + n :])
    errors[:, :n] = np.fmax(errors[:, :n], late)
    own = checkpoints.high - checkpoints.low
    sizes = ranges(equations.q, checkpoints, again, repeated.extents)
    # Where the two are apart, the repeat's motion is another one; it counts only where
    # the run has hardly moved.
    parted_ways = np.max(errors[:, :n], axis=0) > LOST * sizes
    parted_ways &= own > LOST * sizes
    sizes = np.where(parted_ways, own, sizes)
    moving = beside(equations, start, sizes)
    mechanism = linked(equations, start, sizes)
    largest = np.max(np.abs(mine[:, 1 : 1 + n]), axis=0)
    held = np.zeros(n)
    scales, still = scales_of(sizes, moving, mechanism, largest, held)
    which = hardly_moving(sizes, moving, np.max(errors[:, :n], axis=0), scales)
    if which:
        from lagsim.run.held import could_push

        held = could_push(equations, mine, which, case.settings.output_step).reach
        scales, still = scales_of(sizes, moving, mechanism, largest, held)
    return ErrorBar(
        method=plan.method,
        rtol=plan.rtol,
        names=equations.q,
        times=mine[:, 0],
        errors=errors[:, :n],
        scales=scales,
        still=still,
        rates=errors[:, n:],
        repeated=repeats,
        parted="" if alike else _parted(run, repeated, plan),
        rests=is_at_rest(sizes, largest, held),
    )


def _largest(values: Floats) -> Floats:
    """Give the largest sizes up to each row (k, n)."""
    return np.asarray(np.maximum.accumulate(np.abs(values), axis=0))


def _parted(run: Trajectory, repeated: Trajectory, plan: Plan) -> str:
    """Say how two runs that came to their ends ended differently."""
    if not (run.outcome.complete and repeated.outcome.complete):
        return ""
    return (
        f"it ended with `{run.outcome.word}` at t = {run.end:.9g}, and a repeat by "
        f"{plan.method} with `{repeated.outcome.word}` at t = {repeated.end:.9g}"
    )
