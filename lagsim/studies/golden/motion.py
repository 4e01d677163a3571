"""A model's motion at chosen rows, and its variants, which measure its bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError
from lagsim.mechanics.instant import Instant
from lagsim.methods import method as method_named
from lagsim.model.model import DEFAULT_RTOL
from lagsim.run.observers.checkpoints import numbers
from lagsim.run.observers.ledger import Ledger
from lagsim.studies.moved import nearest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Settings
    from lagsim.plan.plan import Plan
    from lagsim.run.session import Case
    from lagsim.run.trajectory import Trajectory

# Rows are kept at every so-many-th, and these are the most that are kept.
MOST_ROWS = 200
LEAST_ROWS = 40
MOST_CELLS = 2400

# Of the variants: what the tolerance is multiplied by, how often the start and the
# parameters are perturbed, and the methods that are tried besides. Each run at a larger
# tolerance is one draw of where the steps fall, which says little of others nearby: the
# largest of a few says what they reach.
LOOSER, TIGHTER = (100.0, 70.0, 50.0, 30.0, 10.0), 0.1
# No tolerance below this means anything (see `error_bar`).
TIGHTEST = 1e-14
SEEDS = 4
METHODS = ("dop853", "taylor", "radau")


@dataclass(frozen=True, slots=True)
class Motion:
    """Rows of a run, one of each `stride`, with the first and the last.

    And both rows of each impact, which share their time.

    Attributes
    ----------
    columns : tuple of str
    rows : ndarray, shape (k, columns)
    scales : ndarray
        The largest scale of each residual, by its column; nan for other columns.
    """

    columns: tuple[str, ...]
    rows: Floats
    scales: dict[str, float]
    trajectory: Trajectory
    plan: Plan

    def at(self, times: Floats, near: float, *, ends: bool) -> Floats:
        """Give the rows (k, columns) at some times; nan where there is none.

        Parameters
        ----------
        near
            Between times that are the same; two that an impact has go with the nearest
            impact's, whose time is a result.
        ends
            The last of the times is an end, and goes with the end of this motion: where
            an event ends a run, its time is a result.
        """
        found = np.full((len(times), len(self.columns)), np.nan)
        t = self.rows[:, 0]
        place = np.minimum(np.searchsorted(t, times - near), len(t) - 1)
        same = np.abs(t[place] - times) <= near
        found[same] = self.rows[place[same]]
        asked, first = np.flatnonzero(befores(times)), np.flatnonzero(befores(t))
        if len(asked) and len(first):
            place = first[nearest(times[asked], t[first])]
            found[asked], found[asked + 1] = self.rows[place], self.rows[place + 1]
            same[asked] = same[asked + 1] = True
        if ends and len(times) and not same[-1]:
            found[-1] = self.rows[-1]
        return found


class Sparse:
    """Keeps one row of each `stride` output times, impacts, and the last row."""

    def __init__(self, settings: Settings, stride: int) -> None:
        self._start, self._step = settings.start, settings.output_step
        self._stride = stride
        self._kept: list[Floats] = []

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns); those of the last time wait for its others."""
        rows = np.concatenate([*self._kept[-1:], rows])
        t = rows[:, 0]
        places = numbers(t, self._start, self._step)
        wanted = (places >= 0) & (places % self._stride == 0) | paired(t)
        late = t == t[-1]
        self._kept[-1:] = [rows[wanted & ~late], rows[late]]

    @property
    def table(self) -> Floats:
        """What is kept (k, columns)."""
        return np.concatenate(self._kept)


def befores(t: Floats) -> Flags:
    """Tell which of some times have the next, and no other, as their twin (k,)."""
    same = np.concatenate(([False], t[1:] == t[:-1], [False]))[: len(t) + 1]
    return np.asarray(same[1:] & ~same[:-1] & ~np.append(same[2:], [False]))


def paired(t: Floats) -> Flags:
    """Tell which of some times have a twin (k,)."""
    first = befores(t)
    return np.asarray(first | np.append([False], first)[: len(t)])


def perturbed(case: Case, seed: int) -> Case:
    """Give the case with start and parameters moved by one unit in the last place.

    What is zero stays, since its neighbours are no rounding errors.
    """
    random = np.random.default_rng(seed)

    def moved(x: Floats) -> Floats:
        other = np.nextafter(x, np.where(random.random(x.shape) < 0.5, -1, 1) * np.inf)
        return np.where(x == 0.0, 0.0, other)

    model = case.equations.model
    values = moved(np.array([p.value for p in model.parameters]))
    parameters = tuple(
        p._replace(value=float(v))
        for p, v in zip(model.parameters, values, strict=True)
    )
    equations = case.equations.of(replace(model, parameters=parameters))
    start = case.start
    state = Instant(start.t, moved(start.q), moved(start.v))
    return case._replace(equations=equations).at(state)


def motion_of(case: Case, stride: int) -> Motion:
    """Run it.

    Raises
    ------
    InputError
        Where the method cannot handle the case.
    """
    session = case.ready()
    names = session.system.columns.names
    kept, ledger = Sparse(session.case.settings, stride), Ledger(names)
    trajectory = session.run([kept, ledger])
    scales = {f"residual_{name}": scale for name, scale in ledger.scales.items()}
    table = session.system.columns.table
    rows = kept.table[:, :table]
    return Motion(names[:table], rows, scales, trajectory, session.plan)


def variants(case: Case, base: Motion, stride: int) -> Iterator[tuple[str, Motion]]:
    """Give runs that differ from the golden one as far as one may, with their kinds.

    The kinds are `looser`, `tighter`, `perturbed` and `method`. One that does not come
    to the end is left out.
    """
    for kind, other in _asked(case, base.plan):
        try:
            found = motion_of(other, stride)
        except InputError:
            continue
        if found.trajectory.outcome is base.trajectory.outcome:
            yield kind, found


def _asked(case: Case, plan: Plan) -> Iterator[tuple[str, Case]]:
    name = plan.method
    if method_named(name).ADAPTIVE:
        assert plan.rtol is not None
        factors = [*(("looser", factor) for factor in LOOSER), ("tighter", TIGHTER)]
        for kind, factor in factors:
            rtol = max(plan.rtol * factor, TIGHTEST)
            atol = None if plan.atol is None else plan.atol * factor
            # With the method that such a run would take, where nobody has named one.
            yield kind, case.asking(rtol=rtol, atol=atol)
    else:
        assert plan.step is not None
        # An error of order p becomes 2^p times larger, one of order 4 16 times.
        yield "looser", case.asking(method=name, step=2.0 * plan.step)
        yield "tighter", case.asking(method=name, step=0.5 * plan.step)
        # Some are exact at any step: what a method with a tolerance may err by.
        rtol = LOOSER[0] * DEFAULT_RTOL
        yield "looser", case.asking(method=METHODS[0], rtol=rtol, atol=None)
    for seed in range(SEEDS):
        yield "perturbed", perturbed(case, seed)
    for other in METHODS:
        if other != name:
            yield "method", case.asking(method=other, formulation="auto")
