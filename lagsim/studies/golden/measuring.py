"""How well a motion is known: bounds by column and time, the horizon, its invariants.

All that may make a run differ from the golden one does so here: up to a hundred times
the tolerance, a tenth of it, start and parameters moved by rounding errors, other
methods. What these runs differ by is what a run elsewhere may differ by.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError, Problem
from lagsim.language.evaluate import evaluate_with_error
from lagsim.mechanics.reduction.ignorable import MOMENTUM
from lagsim.model.model import DEFAULT_RTOL
from lagsim.studies.comparison.scales import kind, scales
from lagsim.studies.golden.clear import clear
from lagsim.studies.golden.invariants import invariants
from lagsim.studies.golden.motion import (
    LEAST_ROWS,
    MOST_CELLS,
    MOST_ROWS,
    Motion,
    befores,
    motion_of,
    paired,
    variants,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.session import Case

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
# Rounding errors of a value that was computed from others of its size.
ULPS = 16 * np.finfo(float).eps
# Bounds only rise. Each rise makes room for so much more, so that there are few.
ROOM = 1.5
# Times are the same within this part of the spacing.
SAME_TIME = 1e-6
# Columns that are kept of long tables.
MOST_COLUMNS = 60
LEAVE_OUT = (
    "without a number no run can be compared with it: leave it out of "
    "`output.columns`, or give it a value there by `if`"
)


@dataclass(frozen=True, slots=True)
class Invariant:
    """What a motion keeps: its value, and how far from it any row may be."""

    value: float
    bound: float


@dataclass(frozen=True)
class Golden:
    """A motion as far as it is known.

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
    """Run a model and its variants; give its golden, and the run it was made from."""
    spacing = case.settings.output_step
    span = case.settings.duration / spacing
    stride = _stride(int(span) + 2, _columns(case))
    base = motion_of(case, stride)
    if stride > 1 and len(base.rows) < LEAST_ROWS:  # it ended early
        stride = _stride(base.trajectory.rows, len(base.columns))
        base = motion_of(case, stride)
    others = [other for _, other in variants(case, base, stride)]
    rows = base.rows[clear(base, others, spacing)]
    near = SAME_TIME * spacing
    with np.errstate(invalid="ignore"):
        apart = _apart(rows, base, others, near) + _floors(case, base, rows)
    sizes = scales(base.columns, rows.T, units(case))
    moving = [
        base.columns.index(name)
        for name in (*case.equations.q, *case.equations.velocities)
    ]
    # An impact that a variant has in another way is none to compare with: one after
    # which rounding errors decide whether something sticks has other forces.
    other = (apart > LOST * sizes)[:, sizes > 0.0].any(axis=1) & paired(rows[:, 0])
    first = befores(rows[:, 0])
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


def units(case: Case) -> dict[str, str]:
    """Give the units of coordinates and definitions, and of their rates."""
    model = case.equations.model
    found = {d.name: d.unit for d in model.definitions}
    for c in model.coordinates:
        rates = {f"{c.name}_dot": f"{c.unit}/s", f"{c.name}_ddot": f"{c.unit}/s^2"}
        found |= {c.name: c.unit} | (rates if c.unit else {})
    return found


def _columns(case: Case) -> int:
    """Give about how many columns the table has."""
    e = case.equations
    n, m = len(e.q), len(e.rows)
    return 4 + 3 * n + len(e.model.output.columns) + (2 * m + n if m else 0)


def _stride(rows: int, columns: int) -> int:
    wanted = min(MOST_ROWS, max(LEAST_ROWS, MOST_CELLS // min(columns, MOST_COLUMNS)))
    return max(1, -(-rows // wanted))


def _kept(columns: Sequence[str], case: Case) -> tuple[str, ...]:
    """Give the columns to keep: of a long table what the others follow from first."""
    if len(columns) <= MOST_COLUMNS:
        return tuple(columns)
    e = case.equations
    derived = {
        *e.accelerations,
        *(n for n in columns if n.startswith(("Qc_", "resid"))),
    }
    first = [name for name in columns if name not in derived]
    rest = [name for name in columns if name in derived]
    if len(first) >= MOST_COLUMNS:
        every = -(-len(first) // MOST_COLUMNS)
        wanted = {"t", *first[1::every]}
    else:
        every = -(-len(rest) // (MOST_COLUMNS - len(first)))
        wanted = {*first, *rest[::every]}
    return tuple(name for name in columns if name in wanted)


def _floors(case: Case, base: Motion, rows: Floats) -> Floats:
    """Give what no bound is below, (k, columns): the tolerance, and rounding errors."""
    rtol = base.plan.rtol or DEFAULT_RTOL
    of = units(case)
    sizes = scales(base.columns, rows.T, of)
    alone = sizes.copy()
    for k, name in enumerate(base.columns):
        sizes[k] = base.scales.get(name, sizes[k])
        # A definition may be the difference of two others, and nothing but errors.
        alike = [i for i, c in enumerate(base.columns) if of.get(c) == of.get(name)]
        if of.get(name) and kind(name, base.columns) == "definition":
            sizes[k] = np.max(alone[alike])
    floors = rtol * sizes + ULPS * np.max(np.abs(rows), axis=0)
    t = base.columns.index("t")
    when, floors[t] = floors[t], 0.0
    floors = floors + _roundings(case, base, rows)
    floors[paired(rows[:, 0]), t] = when  # of an impact that is a result
    return np.asarray(floors)


def _ask_finite(names: Sequence[str], rows: Floats, bounds: Floats) -> None:
    """Refuse columns that no other run could be held against."""
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
    """Give what rounding may change of the definitions in each row (k, columns)."""
    model = case.equations.model
    shown = [d for d in model.definitions if d.name in base.columns]
    found = np.zeros_like(rows)
    if not shown:
        return found
    places = [base.columns.index(d.name) for d in shown]
    eps = float(np.finfo(float).eps)
    parameters = {p.name: (p.value, eps * abs(p.value)) for p in model.parameters}
    nodes = [d.node for d in shown]
    for k, row in enumerate(rows.tolist()):
        values = {c: (x, eps * abs(x)) for c, x in zip(base.columns, row, strict=True)}
        errors = evaluate_with_error(model.graph, nodes, parameters | values)
        found[k, places] = [error for _, error in errors]
    return np.nan_to_num(found, nan=0.0, posinf=0.0)


def _apart(rows: Floats, base: Motion, others: Sequence[Motion], near: float) -> Floats:
    """Give how far each value may be from what it is (k, columns)."""
    largest = np.zeros_like(rows)
    for other in others:
        if other.columns == base.columns:
            apart = np.abs(other.at(rows[:, 0], near, ends=True) - rows)
            np.fmax(largest, apart, out=largest)
    return SAFETY * largest


def _steps(t: Floats, bounds: Floats) -> list[tuple[float, float]]:
    """Give bounds that never fall as few steps."""
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
    """Give what is kept, and how well the runs kept it."""
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
        bound = SAFETY * max(reached) + rtol * size + ULPS * abs(value)
        found[name] = Invariant(value, rounded_up(bound))
    return found
