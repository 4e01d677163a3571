"""The golden of a motion: rows, bounds of their errors, horizon, invariants.

All that may make a run differ from the golden one does so here: up to a hundred times
the tolerance, a tenth of it, start and parameters moved by rounding errors, other
methods. What these runs differ by is what a run elsewhere may differ by.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.errors import InputError, Problem
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.equations import Instant
from lagsim.mechanics.reduction import MOMENTUM, conserved, momentum_of
from lagsim.methods import method as method_named
from lagsim.model.model import DEFAULT_RTOL
from lagsim.outputs.units import stated_units
from lagsim.run.observers.monitors import ResidualMonitor, numbers
from lagsim.studies.comparison import kind, moved, nearest, partners, scales
from lagsim.tolerances import SAME_ROW, SAME_STEP, UNIT_ROUNDOFF, VALUE_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations
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
        asked, first = (
            np.flatnonzero(before_impacts(times)),
            np.flatnonzero(before_impacts(t)),
        )
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
        wanted = (places >= 0) & (places % self._stride == 0) | at_impacts(t)
        late = t == t[-1]
        self._kept[-1:] = [rows[wanted & ~late], rows[late]]

    @property
    def table(self) -> Floats:
        """What is kept (k, columns)."""
        return np.concatenate(self._kept)


def before_impacts(t: Floats) -> Flags:
    """Tell which times (k,) equal the next, and no other: rows before an impact."""
    same = np.concatenate(([False], t[1:] == t[:-1], [False]))[: len(t) + 1]
    return np.asarray(same[1:] & ~same[:-1] & ~np.append(same[2:], [False]))


def at_impacts(t: Floats) -> Flags:
    """Tell which times (k,) are those of two rows: before and after an impact."""
    first = before_impacts(t)
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
    """Return the motion of a case, one row of each `stride`.

    Raises
    ------
    InputError
        Where the method cannot handle the case.
    """
    session = case.ready()
    names = session.system.columns.names
    kept, residuals = Sparse(session.case.settings, stride), ResidualMonitor(names)
    trajectory = session.run([kept, residuals])
    scales = {f"residual_{name}": scale for name, scale in residuals.scales.items()}
    table = session.system.columns.table
    rows = kept.table[:, :table]
    return Motion(names[:table], rows, scales, trajectory, session.plan)


def variants(case: Case, base: Motion, stride: int) -> Iterator[tuple[str, Motion]]:
    """Return variants of the golden run, with their kinds.

    The kinds are `looser`, `tighter`, `perturbed` and `method`. One that does not come
    to the end is left out.
    """
    for what, other in _asked(case, base.plan):
        try:
            found = motion_of(other, stride)
        except InputError:
            continue
        if found.trajectory.outcome is base.trajectory.outcome:
            yield what, found


def _asked(case: Case, plan: Plan) -> Iterator[tuple[str, Case]]:
    name = plan.method
    if method_named(name).ADAPTIVE:
        assert plan.rtol is not None
        factors = [*(("looser", factor) for factor in LOOSER), ("tighter", TIGHTER)]
        for kind, factor in factors:
            rtol = max(plan.rtol * factor, TIGHTEST)
            atol = None if plan.atol is None else plan.atol * factor
            # With the method that such a run would take, where none is named.
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


# Rows this close to an event, as a part of the spacing, may lie on either side of it;
# so may those within so many times what the variants move it by.
NEAR_EVENT = 1e-3
TIMES_MOVED = 10.0
# Impacts that are kept, at most: those that are at least so far from other events, in
# what may lie on either side.
MOST_IMPACTS = 6
ALONE = 4.0


def clear(base: Motion, others: Sequence[Motion], spacing: float) -> list[int]:
    """Return the indices of rows away from events, with the ends and some impacts.

    Of these some, evenly: both rows of each. They have times of their own, which other
    runs move.
    """
    t = base.rows[:, 0]
    events = [e for e in base.trajectory.events if e.kind != "until"]
    times = np.unique([e.time for e in events])
    reach = np.full(len(times), NEAR_EVENT * spacing)
    common = t[before_impacts(t)]
    for other in others:
        pairs = moved(events, other.trajectory.events)
        late = np.minimum(TIMES_MOVED * np.abs(pairs[:, 1] - pairs[:, 0]), spacing)
        np.maximum.at(reach, np.searchsorted(times, pairs[:, 0]), late)
        theirs = other.rows[before_impacts(other.rows[:, 0]), 0]
        common = partners(common, theirs)[:, 0]
    ends = np.isin(np.arange(len(t)), (0, len(t) - 1))
    reached = np.any(np.abs(t[:, None] - times) <= reach, axis=1)
    kept = ends | ~(reached | at_impacts(t))
    first = np.flatnonzero(before_impacts(t) & np.isin(t, common))
    apart = SAME_STEP * spacing
    alone = [
        k
        for k in first
        if not np.any(
            (np.abs(times - t[k]) > apart) & (np.abs(times - t[k]) <= ALONE * reach)
        )
    ]
    for k in np.linspace(0, len(alone) - 1, min(MOST_IMPACTS, len(alone))):
        kept[alone[round(k)] : alone[round(k)] + 2] = True
    return [int(k) for k in np.flatnonzero(kept)]


BALANCE = "energy - work"
RESIDUAL = "residual_"


def invariants(equations: Equations, motion: Motion) -> dict[str, Floats]:
    """Return the conserved quantities in the rows of a motion (rows,).

    That is the energy (less the work), each residual, and the momentum of each
    coordinate that is in neither the Lagrangian nor a force nor a constraint. Of what
    stays >= 0 it is what lies below.
    """
    column = {name: motion.rows[:, k] for k, name in enumerate(motion.columns)}
    found = {}
    if "work" in column:
        found[BALANCE] = column["energy"] - column["work"]
    else:
        found["energy"] = column["energy"]
    found |= _residuals(equations, column)
    free = conserved(equations)
    if free:
        states = [
            {"t": row[0]} | dict(zip(motion.columns[1:], row[1:], strict=True))
            for row in motion.rows
        ]
        parameters = {p.name: p.value for p in equations.model.parameters}
        nodes = [equations.momenta[k] for k in free]
        values = np.array(
            [evaluate(equations.graph, nodes, parameters | s) for s in states]
        )
        for place, k in enumerate(free):
            found[momentum_of(equations.q[k])] = values[:, place]
    return found


def _residuals(equations: Equations, column: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return the residuals (rows,) of constraints that are always in force."""
    found = {}
    kinds = {law.row.name: law for law in equations.laws}
    for name, values in column.items():
        law = kinds.get(name.removeprefix(RESIDUAL))
        if not name.startswith(RESIDUAL):
            continue
        if law is None:
            found[name] = values
        elif law.kind in (Kind.CONTACT, Kind.FREEWHEEL) and law.when is None:
            found[name] = np.minimum(values, 0.0)
    return found


# The others are samples of what should pass: of where the steps fall at a hundred times
# the tolerance and below, and of rounding errors, which another processor makes in
# every step and not only in the first. The largest of them may be exceeded several
# times over (of the shipped models by 3.3 at 85 times the tolerance), but not tenfold.
SAFETY = 10.0
# Values are rounded to a tenth of their bound, or better: a twentieth, added to it.
DIGITS = 0.1
# Past the horizon a coordinate or a velocity may be off by this part of its scale: what
# is left says little more than where the motion can be at all.
LOST = 1 / 3
# Bounds only rise. Each rise makes room for so much more, so that there are few.
ROOM = 1.5
# Columns that are kept of long tables.
MOST_COLUMNS = 60
LEAVE_OUT = (
    "without a number no run can be compared with it: leave it out of "
    "`output.columns`, or give it a value there by `if`"
)


class Invariant(NamedTuple):
    """A conserved quantity: its value, and the bound of deviations."""

    value: float
    bound: float


@dataclass(frozen=True)
class Golden:
    """A motion with bounds of its error, up to its horizon.

    Attributes
    ----------
    columns : tuple of str
        Those that are kept; the first is the time.
    rows : ndarray, shape (k, columns)
    steps : dict of str to list
        By column (time, bound) pairs: the bound holds from that time on, to the next.
    horizon : float or None
        Past this time only invariants are compared.
    invariants : dict of str to Invariant
    stride : int
        Of so many rows of the run one is kept.
    """

    columns: tuple[str, ...]
    rows: Floats
    steps: dict[str, list[tuple[float, float]]]
    horizon: float | None
    invariants: dict[str, Invariant]
    stride: int

    def bounds(self, column: str) -> Floats:
        """Give the bound of a column in each row (k,)."""
        times, bounds = np.array(self.steps[column]).T
        place = np.searchsorted(times, self.rows[:, 0], side="right") - 1
        return np.asarray(bounds[np.maximum(place, 0)])


def measure(case: Case) -> tuple[Golden, Motion]:
    """Return the golden of a case by its variants, and the motion it was made from."""
    spacing = case.settings.output_step
    span = case.settings.duration / spacing
    stride = _stride(int(span) + 2, case.ready().system.columns.table)
    base = motion_of(case, stride)
    if stride > 1 and len(base.rows) < LEAST_ROWS:  # it ended early
        stride = _stride(base.trajectory.rows, len(base.columns))
        base = motion_of(case, stride)
    others = [other for _, other in variants(case, base, stride)]
    rows = base.rows[clear(base, others, spacing)]
    near = SAME_ROW * spacing
    with np.errstate(invalid="ignore"):
        apart = _apart(rows, base, others, near) + _floors(case, base, rows)
    sizes = scales(base.columns, rows.T, stated_units(case.equations, base.columns))
    moving = [
        base.columns.index(name)
        for name in (*case.equations.q, *case.equations.velocities)
    ]
    # An impact that a variant has in another way is none to compare with: one after
    # which rounding errors decide whether something sticks has other forces.
    other = (apart > LOST * sizes)[:, sizes > 0.0].any(axis=1) & at_impacts(rows[:, 0])
    first = before_impacts(rows[:, 0])
    other[1:] |= other[:-1] & first[:-1]
    other[:-1] |= other[1:] & first[:-1]
    rows, apart = rows[~other], apart[~other]
    envelope = np.maximum.accumulate(apart, axis=0) * (1.0 + DIGITS / 2)
    lost = np.flatnonzero((envelope > LOST * sizes)[:, moving].any(axis=1))
    horizon = float(rows[lost[0], 0]) if len(lost) else None
    if horizon is not None:
        rows, envelope = rows[: lost[0]], envelope[: lost[0]]
    names = _kept(base.columns, case)
    chosen = [base.columns.index(name) for name in names]
    _ask_finite(names, rows[:, chosen], envelope[:, chosen])
    steps = {
        n: _steps(rows[:, 0], envelope[:, k])
        for n, k in zip(names, chosen, strict=True)
    }
    kept = _invariants(case, base, others)
    return Golden(names, rows[:, chosen], steps, horizon, kept, stride), base


def _stride(rows: int, columns: int) -> int:
    wanted = min(MOST_ROWS, max(LEAST_ROWS, MOST_CELLS // min(columns, MOST_COLUMNS)))
    return max(1, -(-rows // wanted))


def _kept(columns: Sequence[str], case: Case) -> tuple[str, ...]:
    """Return the columns to store; of a long table derived ones are left out first."""
    if len(columns) <= MOST_COLUMNS:
        return tuple(columns)
    e = case.equations
    derived = {
        *e.accelerations,
        *(n for n in columns if n.startswith(("Qc_", "resid"))),
    }
    first = [name for name in columns if name not in derived]
    rest = [name for name in columns if name in derived]
    wanted = {*_some(first, MOST_COLUMNS), *_some(rest, MOST_COLUMNS - len(first))}
    return tuple(name for name in columns if name in wanted)


def _some(names: Sequence[str], most: int) -> Sequence[str]:
    """Give at most so many, evenly, the first among them."""
    return names[:: -(-len(names) // most)] if most > 0 and names else []


def _floors(case: Case, base: Motion, rows: Floats) -> Floats:
    """Return the least bounds (k, columns): the tolerance, and rounding errors."""
    rtol = base.plan.rtol or DEFAULT_RTOL
    of = stated_units(case.equations, base.columns[1:])
    sizes = scales(base.columns, rows.T, of)
    alone = sizes.copy()
    for k, name in enumerate(base.columns):
        sizes[k] = base.scales.get(name, sizes[k])
        # A definition may be the difference of two others, and nothing but errors.
        alike = [i for i, c in enumerate(base.columns) if of.get(c) == of.get(name)]
        if of.get(name) and kind(name, base.columns) == "definition":
            sizes[k] = np.max(alone[alike])
    floors = rtol * sizes + VALUE_ROUNDOFF * np.max(np.abs(rows), axis=0)
    t = base.columns.index("t")
    when, floors[t] = floors[t], 0.0
    floors = floors + _roundings(case, base, rows)
    floors[at_impacts(rows[:, 0]), t] = when  # of an impact that is a result
    return np.asarray(floors)


def _ask_finite(names: Sequence[str], rows: Floats, bounds: Floats) -> None:
    """Refuse columns that are not finite, or have no finite bound."""
    problems = []
    for k, name in enumerate(names):
        # Where a row has no value, bounds may have none anywhere.
        for wrong in (~np.isfinite(rows[:, k]), ~np.isfinite(bounds[:, k])):
            if np.any(wrong):
                t = rows[np.argmax(wrong), 0]
                text = f"`{name}` has no finite value, or no bound, at t = {t:.6g}"
                problems.append(Problem("not-finite", text, hint=LEAVE_OUT))
                break
    if problems:
        raise InputError(problems)


def _roundings(case: Case, base: Motion, rows: Floats) -> Floats:
    """Return the rounding errors (k, columns) of the definitions in each row."""
    model = case.equations.model
    shown = [d for d in model.definitions if d.name in base.columns]
    found = np.zeros_like(rows)
    if not shown:
        return found
    places = [base.columns.index(d.name) for d in shown]
    eps = 2.0 * UNIT_ROUNDOFF
    parameters = {p.name: (p.value, eps * abs(p.value)) for p in model.parameters}
    nodes = [d.node for d in shown]
    for k, row in enumerate(rows.tolist()):
        values = {c: (x, eps * abs(x)) for c, x in zip(base.columns, row, strict=True)}
        errors = evaluate_with_error(model.graph, nodes, parameters | values)
        found[k, places] = [error for _, error in errors]
    return np.nan_to_num(found, nan=0.0, posinf=0.0)


def _apart(rows: Floats, base: Motion, others: Sequence[Motion], near: float) -> Floats:
    """Return the largest deviation (k, columns) of variants, times a safety factor."""
    largest = np.zeros_like(rows)
    for other in others:
        if other.columns == base.columns:
            apart = np.abs(other.at(rows[:, 0], near, ends=True) - rows)
            np.fmax(largest, apart, out=largest)
    return SAFETY * largest


def _steps(t: Floats, bounds: Floats) -> list[tuple[float, float]]:
    """Return nondecreasing bounds as few steps (time, bound)."""
    found: list[tuple[float, float]] = []
    for time, bound in zip(t.tolist(), bounds.tolist(), strict=True):
        if not found or bound > found[-1][1]:
            found.append((time, rounded_up(bound if not found else ROOM * bound)))
    return found


def rounded_up(x: float) -> float:
    """Give a number of two digits that is no smaller."""
    if not 0.0 < x < np.inf:
        return float(x)
    unit = 10.0 ** (np.floor(np.log10(x)) - 1)
    return float(f"{np.ceil(x / unit) * unit:.1e}")


def _invariants(
    case: Case, base: Motion, others: Sequence[Motion]
) -> dict[str, Invariant]:
    """Return the conserved quantities, with bounds by the variants."""
    found = {}
    rtol = base.plan.rtol or DEFAULT_RTOL
    kept = invariants(case.equations, base)
    apart = [
        invariants(case.equations, motion)
        for motion in (base, *others)
        if motion.columns == base.columns
    ]
    momenta = [np.max(np.abs(v)) for n, v in kept.items() if n.startswith(MOMENTUM)]
    moving = scales(base.columns, base.rows.T)[base.columns.index("energy")]
    for name, values in kept.items():
        value = 0.0 if name in base.scales else float(values[0])
        size = base.scales.get(name, moving)
        if name.startswith(MOMENTUM):
            size = float(max(momenta))
        reached = [float(np.max(np.abs(values[name] - value))) for values in apart]
        bound = SAFETY * max(reached) + rtol * size + VALUE_ROUNDOFF * abs(value)
        found[name] = Invariant(value, rounded_up(bound))
    return found
