"""Motions of a golden run and of its variants, at equal rows.

The variants change everything that can make a run differ from the golden run: a
tolerance up to a hundred times larger, a tenth of it, start and parameters perturbed by
rounding errors, and other methods. Their differences are samples of the differences of
a run on another machine. They also show how far the times of events move, and so which
rows can lie on either side of an event.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.errors import InputError
from lagsim.language.columns import RESIDUAL
from lagsim.mechanics.equations import Instant
from lagsim.model.model import DEFAULT_RTOL
from lagsim.run.observers.monitors import ResidualMonitor, grid_numbers
from lagsim.studies.comparison import mutually_nearest, nearest_times, paired_times
from lagsim.studies.trial import NO_ROWS, Compiled, tried
from lagsim.tolerances import SAME_STEP, TIGHTEST_RTOL

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from numpy.typing import NDArray

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Settings
    from lagsim.plan.plan import Plan
    from lagsim.run.session import Case
    from lagsim.studies.trial import Trial

# Factors of the tolerance of variants, the number of variants with perturbed start and
# parameters, and the methods of further variants. A run at a larger tolerance is one
# sample of the positions of steps, and other runs nearby can differ more: therefore the
# largest of several differences counts.
LOOSER, TIGHTER = tuple(float(x) for x in range(100, 0, -10)), 0.1
SEEDS = 4
METHODS = ("dop853", "taylor", "radau")


@dataclass(frozen=True, slots=True)
class SampledMotion:
    """Rows of a run: one of `stride` rows, the first and the last, and rows of impacts.

    Both rows of an impact are stored; they have one time.

    Attributes
    ----------
    columns : tuple of str
        Names of the columns of the table.
    rows : ndarray, shape (k, columns)
    scales : dict of str to float
        The largest scale of each residual, by column.
    count : int
        The number of all rows of the run.
    trial : Trial
        The run, without its rows.
    plan : Plan
        The plan of the run.
    """

    columns: tuple[str, ...]
    rows: Floats
    scales: dict[str, float]
    count: int
    trial: Trial
    plan: Plan

    def at(self, times: Floats, near: float, *, ends: bool) -> Floats:
        """Return the rows (k, columns) at given times; nan where there is no row.

        Parameters
        ----------
        times : ndarray, shape (k,)
        near : float
            The largest difference of equal times. A pair of equal times is an impact,
            whose time is a result of a run: it matches the nearest impact of this
            motion.
        ends : bool
            Whether the last of the times is an end, which matches the end of this
            motion: if an event ends a run, the time of the end is a result.
        """
        found = np.full((len(times), len(self.columns)), np.nan)
        t = self.rows[:, 0]
        place = np.minimum(np.searchsorted(t, times - near), len(t) - 1)
        same = np.abs(t[place] - times) <= near
        found[same] = self.rows[place[same]]
        impacts, first = (np.flatnonzero(before_impacts(x)) for x in (times, t))
        if len(impacts) and len(first):
            place = first[nearest_times(times[impacts], t[first])]
            found[impacts], found[impacts + 1] = self.rows[place], self.rows[place + 1]
            same[impacts] = same[impacts + 1] = True
        if ends and len(times) and not same[-1]:
            found[-1] = self.rows[-1]
        return found


def before_impacts(t: Floats) -> Flags:
    """Return a mask (k,) of the rows before an impact, among the times t (k,).

    Such a row has the time of the next row, and of no other row.

    Examples
    --------
    >>> before_impacts(np.array([0.0, 1.0, 1.0, 2.0]))
    array([False,  True, False, False])
    """
    same = np.concatenate(([False], t[1:] == t[:-1], [False]))[: len(t) + 1]
    return np.asarray(same[1:] & ~same[:-1] & ~np.append(same[2:], [False]))


def at_impacts(t: Floats) -> Flags:
    """Return a mask (k,) of both rows of each impact, among the times t (k,).

    Examples
    --------
    >>> at_impacts(np.array([0.0, 1.0, 1.0, 2.0]))
    array([False,  True,  True, False])
    """
    first = before_impacts(t)
    return np.asarray(first | np.append([False], first)[: len(t)])


def perturbed(case: Case, seed: int) -> Case:
    """Return the case with start and parameters changed by a unit in the last place.

    Each value is moved up or down at random, by `seed`. Values 0 are unchanged, since
    their neighbours are no rounding errors of 0.
    """
    random = np.random.default_rng(seed)

    def shifted(x: Floats) -> Floats:
        other = np.nextafter(x, np.where(random.random(x.shape) < 0.5, -1, 1) * np.inf)
        return np.where(x == 0.0, 0.0, other)

    model, start = case.model, case.start
    values = shifted(np.array([p.value for p in model.parameters])).tolist()
    parameters = tuple(
        p._replace(value=v) for p, v in zip(model.parameters, values, strict=True)
    )
    e, changed = case.equations, replace(model, parameters=parameters)
    equations = e.of(changed, begun_by=e.begun_by)
    state = Instant(start.t, shifted(start.q), shifted(start.v), shifted(start.s))
    return case._replace(equations=equations).at(state)


def motion_of(
    case: Case, stride: int, compiled: Compiled | None = None
) -> SampledMotion:
    """Return the motion of a case: one of `stride` output times, impacts and the end.

    Parameters
    ----------
    compiled : Compiled, optional
        Compiled functions of the model, which are used if they fit the case.

    Raises
    ------
    InputError
        If the method cannot handle the case.
    """
    session, settings = (compiled or Compiled()).session(case), case.settings
    trial = tried(session)
    residuals = ResidualMonitor(trial.columns)
    residuals.add(trial.rows)
    columns = session.columns
    rows = np.ascontiguousarray(trial.rows[:, : columns.table])
    t = rows[:, 0]
    places = grid_numbers(t, settings.start, settings.output_step)
    mask = ((places >= 0) & (places % stride == 0)) | at_impacts(t) | (t == t[-1])
    sizes = {RESIDUAL.of(name): scale for name, scale in residuals.scales.items()}
    names = columns.names[: columns.table]
    made = trial._replace(rows=NO_ROWS)
    return SampledMotion(names, rows[mask], sizes, len(rows), made, session.plan)


def variants(
    case: Case, base: SampledMotion, stride: int, compiled: Compiled
) -> Iterator[SampledMotion]:
    """Yield the motions of the variants of a case that end with the outcome of `base`.

    Variants that a method refuses are omitted.

    Parameters
    ----------
    case : Case
    base : SampledMotion
        The motion of the golden run.
    stride : int
        One of `stride` output times is sampled.
    compiled : Compiled
        The compiled functions of earlier runs.
    """
    for other in _asked(case, base.plan):
        with contextlib.suppress(InputError):
            found = motion_of(other, stride, compiled)
            if found.trial.outcome == base.trial.outcome:
                yield found


def _asked(case: Case, plan: Plan) -> Iterator[Case]:
    name = plan.method
    if plan.rtol is not None:
        for factor in (*LOOSER, TIGHTER):
            rtol = max(plan.rtol * factor, TIGHTEST_RTOL)
            atol = None if plan.atol is None else plan.atol * factor
            # With the method that such a run would select, if the file names none.
            yield case.with_settings(rtol=rtol, atol=atol)
    if plan.step is not None:
        # An error of order p is multiplied by 2^p; of order 4 by 16.
        for factor in (2.0, 0.5):
            yield case.with_settings(method=name, step=factor * plan.step)
        # Some methods are exact at any step; the variants then have a tolerance.
        rtol = LOOSER[0] * DEFAULT_RTOL
        yield case.with_settings(method=METHODS[0], rtol=rtol, atol=None)
    for seed in range(SEEDS):
        yield perturbed(case, seed)
    for other in METHODS:
        if other != name:
            yield case.with_settings(method=other, formulation="auto")


# Rows of a motion that are stored.

# Rows this close to an event, relative to the spacing, can lie on either side of it,
# and so can rows within this multiple of the shift of the event in the variants.
NEAR_EVENT = 1e-3
TIMES_MOVED = 10.0
# Least distance from an event at which its two sides are evaluated, relative to the
# spacing.
BESIDE = 1e-9
# A difference across an event is explained by slopes up to this multiple of the sum of
# the changes on both sides, each over half of the time: one for the slopes, and one for
# rounding errors.
SLOPES = 2.0
# The largest number of events considered for one row.
MOST_NEAR = 100
# The largest number of stored impacts, besides those at output times, and their least
# distance from other events, relative to the range within which rows can lie on either
# side.
MOST_IMPACTS = 6
ALONE = 4.0


class Near(NamedTuple):
    """Stored rows of a motion, and the events near each row.

    Attributes
    ----------
    rows : list of int
        Indices of rows of the motion.
    events : list of (int, float, float)
        For each event near a row: the index of that row in `rows`, the time of the
        event, and the distance from this time at which columns have their values before
        and after the event.
    """

    rows: list[int]
    events: list[tuple[int, float, float]]


def kept_rows(
    base: SampledMotion,
    others: Sequence[SampledMotion],
    settings: Settings,
    periodic: Collection[str] = (),
) -> Near:
    """Select rows of a motion: all at output times, and both rows of some impacts.

    The time of an impact differs between runs. An impact is selected if all runs
    contain it and no other event is near.

    Parameters
    ----------
    base : SampledMotion
        The motion whose rows are selected.
    others : sequence of SampledMotion
        Its variants, which show how far the times of events move.
    settings : Settings
    periodic : collection of str
        Names of periodic events of the file. They are at equal times in all runs, and
        their rows have the values after the event.
    """
    t, spacing = base.rows[:, 0], settings.output_step
    events = [e for e in base.trial.events if e.kind != "until"]
    events = [e for e in events if e.name not in periodic]
    times = np.unique([e.time for e in events])
    delays = np.full(len(times), BESIDE * spacing)
    common = t[before_impacts(t)]
    for other in others:
        pairs = paired_times(events, other.trial.events)
        by = np.minimum(TIMES_MOVED * np.abs(pairs[:, 1] - pairs[:, 0]), spacing)
        np.maximum.at(delays, np.searchsorted(times, pairs[:, 0]), by)
        impacts = other.rows[before_impacts(other.rows[:, 0]), 0]
        common = mutually_nearest(common, impacts)[:, 0]
    reach = np.maximum(delays, NEAR_EVENT * spacing)
    kept = ~at_impacts(t)
    same = np.full(len(times), SAME_STEP * spacing)
    counts = _count_within(t, times, ALONE * reach) - _count_within(t, times, same)
    alone = before_impacts(t) & np.isin(t, common) & (counts == 0)
    on_grid = alone & (grid_numbers(t, settings.start, spacing) >= 0)
    first = np.flatnonzero(alone & ~on_grid)
    chosen = np.linspace(0, len(first) - 1, min(MOST_IMPACTS, len(first)))
    for k in (*first[np.rint(chosen).astype(int)], *np.flatnonzero(on_grid)):
        kept[k : k + 2] = True
    kept[[0, -1]] = True
    rows = np.flatnonzero(kept)
    own = np.flatnonzero(kept & ~at_impacts(t))
    near, close = pairs_within(t[own], times, reach)
    near = own[near]
    order = np.lexsort((np.abs(t[near] - times[close]), near))
    near, close = near[order], close[order]
    rank = np.arange(len(near)) - np.searchsorted(near, near)
    near, close = near[rank < MOST_NEAR], close[rank < MOST_NEAR]
    places = np.searchsorted(rows, near).tolist()
    events_near = zip(
        places, times[close].tolist(), delays[close].tolist(), strict=True
    )
    return Near(rows.tolist(), [*events_near])


def _count_within(t: Floats, times: Floats, reach: Floats) -> NDArray[np.intp]:
    """Return the number of events near each row, shape (k,).

    Arguments : see `pairs_within`.
    """
    first = np.searchsorted(t, times - reach)
    after = np.searchsorted(t, times + reach, side="right")
    size = len(t) + 1
    steps = np.bincount(first, minlength=size) - np.bincount(after, minlength=size)
    return np.asarray(np.cumsum(steps)[: len(t)])


def pairs_within(
    t: Floats, times: Floats, reach: Floats
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the pairs of a row and an event that is near: indices of both, shape (p,).

    Parameters
    ----------
    t : ndarray, shape (k,)
        Times of the rows, which do not decrease.
    times, reach : ndarray, shape (e,)
        Times of the events, and the largest distances at which a row is near.

    Examples
    --------
    >>> rows, events = pairs_within(
    ...     np.array([0.0, 1.0, 2.0]), np.array([0.9, 2.5]), np.array([0.2, 2.0])
    ... )
    >>> rows.tolist(), events.tolist()
    ([1, 1, 2], [0, 1, 1])
    """
    first = np.searchsorted(t, times - reach)
    counts = np.searchsorted(t, times + reach, side="right") - first
    events = np.repeat(np.arange(len(times)), counts)
    within = np.arange(len(events)) - np.repeat(np.cumsum(counts) - counts, counts)
    return first[events] + within, events


def column_jumps(
    case: Case, base: SampledMotion, near: Near, compiled: Compiled
) -> Floats:
    """Return the jumps of all columns near each stored row, shape (rows, columns).

    A jump is the difference across an event, less the change that the slopes on both
    sides explain, so that a kink is no jump.
    """
    found = np.zeros((len(near.rows), len(base.columns)))
    if near.events:
        places, times, late = (np.array(x) for x in zip(*near.events, strict=True))
        sides = times + np.outer((-2.0, -1.0, 1.0, 2.0), late)
        sides = np.clip(sides, *base.rows[[0, -1], 0])
        session = compiled.session(case)
        rows = tried(session, sides.ravel()).rows[:, : len(base.columns)]
        with np.errstate(invalid="ignore"):
            before, across, after = np.abs(
                np.diff(rows.reshape(4, len(times), -1), axis=0)
            )
            jump = np.maximum(across - SLOPES * (before + after), 0.0)
        np.add.at(found, places.astype(int), np.nan_to_num(jump))
    found[:, 0] = 0.0
    return found
