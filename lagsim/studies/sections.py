"""Sections of a motion: its states where a relation is crossed, and every period.

The run is repeated with the same steps and more rows, which its method interpolates
within them: at least SAMPLES in the shortest step, and more until the values of the
relation's function follow from each other. Where it has another sign in the next row is
a crossing; where it comes close to 0 between two rows, its extreme is looked for, which
has a crossing on both sides if it lies past 0. The run is repeated for states at better
and better times. So a section changes no step, and what is between two rows of the
table is not lost.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import unusable
from lagsim.language.evaluate import evaluate
from lagsim.methods.parts.missed import BETWEEN
from lagsim.outputs.letters import letters_of, raised
from lagsim.outputs.table import table_of
from lagsim.outputs.units import units
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers import Moments

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Section
    from lagsim.outputs import Made
    from lagsim.run.session import Session
    from lagsim.run.trajectory import Trajectory

SAMPLES = 8
# Of a run of a few steps the shortest is not known: it has so many.
FEW = 500
# Rows at most: of the samples, and of a strobe.
MOST, STROBES = 4_000_000, 1_000_000
# Of the largest of its terms, what rounding makes of 0.
NOTHING = 2.0**-46
# Beside a row there may be a dip by so many of the second differences there; smooth is
# what is known to a tenth of one. Each run divides a stretch by so many.
NEAR, PARTS = 0.25, 8
# Values follow from those around where they are off by no more than this part of how
# those vary; that is asked at so many places at most.
KNOWN, PROBES = 0.1, 2000
# Runs in which a crossing is looked for: three do, and bisection needs no more.
PASSES = 60
# Of the values beside it, what is left at a crossing; more is a jump without a state.
SMALL = 1e-6


class _Samples:
    """Observer that keeps the time and some columns of all rows up to an end."""

    def __init__(self, columns: list[int], end: float, interrupt: Interrupt) -> None:
        self._columns, self._end, self._interrupt = [0, *columns], end, interrupt
        self._blocks: list[Floats] = []

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        self._blocks.append(rows[rows[:, 0] <= self._end][:, self._columns])
        if rows[-1, 0] > self._end:
            self._interrupt.stop()

    @property
    def table(self) -> Floats:
        """Time and columns (1 + columns, rows)."""
        return np.concatenate(self._blocks).T


def sections(session: Session, made: Trajectory) -> dict[str, Floats]:
    """Rows (k, columns) of each section of a run, with the columns of its table.

    Raises
    ------
    InputError
        If a strobe has too many.
    """
    e, columns = session.equations, session.columns
    asked = e.model.output.sections
    located = [s for s in asked if s.at is not None]
    found: dict[str, Floats] = {}
    if located:
        names = [columns.names.index(f"section.{s.name}") for s in located]
        t, *values = _sampled(session, made, [x for k in names for x in (k, k + 1)])
        pairs = zip(values[::2], values[1::2], strict=True)
        for section, name, (g, terms) in zip(located, names, pairs, strict=True):
            # What a constraint holds at 0 crosses nothing.
            nothing = float(NOTHING * np.max(terms, initial=0.0))
            clear = np.abs(g) > nothing
            dense = _with_dips(session, name, t[clear], g[clear], nothing)
            stretches = _crossings(*dense, section.direction)
            found[section.name] = _located(session, *stretches, name)
    for section in asked:
        if section.every is not None:
            found[section.name] = rows_at(session, _strobe(session, made, section))
    return {s.name: found[s.name][:, : columns.table] for s in asked}


def _sampled(session: Session, made: Trajectory, names: list[int]) -> Floats:
    """Return times and values of columns (1 + columns, k), as dense as these need."""
    settings, arcs = session.case.settings, made.statistics.arcs
    finest = max(
        made.statistics.smallest_step or settings.duration / FEW,
        SAMPLES * settings.duration / MOST,
    )
    spacing = min(finest, settings.output_step) / SAMPLES
    while True:
        interrupt = Interrupt()
        samples = _Samples(names, made.end, interrupt)
        session.asking(output_step=spacing).run([samples], interrupt=interrupt)
        table = samples.table
        if PARTS * table.shape[1] > MOST or _unknown(session, names, table) <= 6 * arcs:
            return table
        spacing /= PARTS


def _unknown(session: Session, names: list[int], table: Floats) -> int:
    """Count the probes between rows that do not follow from the two on both sides.

    At up to PROBES places. A few do not beside each jump, and most where the relation
    has many periods in a step, as the sine of an angle that grows evenly.
    """
    t, g = table[0], table[1:]
    if len(t) < 4:
        return 0
    k, x = np.unique(np.linspace(1, len(t) - 3, PROBES).astype(int)), BETWEEN
    near = np.stack([g[:, k + j] for j in (-1, 0, 1, 2)], axis=-1)
    cubic = (x - 1) * (x - 2) * np.array([-x / 6, (x + 1) / 2, 0, 0])
    cubic += (x + 1) * x * np.array([0, 0, (2 - x) / 2, (x - 1) / 6])
    now = rows_at(session, t[k] + x * (t[k + 1] - t[k]))[:, names].T
    off, sizes = abs(near @ cubic - now), np.max(abs(g), axis=1, keepdims=True)
    unknown = off > np.maximum(KNOWN * np.ptp(near, axis=-1), SMALL * sizes)
    return int(np.count_nonzero(unknown.any(axis=0)))


def _approaches(t: Floats, g: Floats) -> tuple[Floats, Floats, Floats]:
    """Stretches (k,), from and to, in which g may pass 0 and return; its sign there.

    Beside the rows (of three or more) where it is closest to 0, and no farther than a
    part of its second difference. Beyond both ends g counts as before them.
    """
    k = np.arange(len(t))
    before, after = abs(k - 1), len(t) - 1 - abs(len(t) - 2 - k)
    side = np.sign(g)
    a, b, c = side * g[before], side * g, side * g[after]
    near = np.flatnonzero((a >= b) & (b <= c) & (b < NEAR * (a - 2.0 * b + c)))
    return t[np.maximum(near - 1, 0)], t[np.minimum(near + 1, k[-1])], side[near]


def _with_dips(
    session: Session, name: int, t: Floats, g: Floats, nothing: float
) -> tuple[Floats, Floats]:
    """Return the times and values of a column with those of dips over 0 between rows.

    Each run parts all stretches, until they have dipped or cannot. What dips by no more
    than rounding makes of 0 is a touch, and no crossing.
    """
    lo, hi, side = _approaches(t, g) if len(t) > 2 else (t[:0], t[:0], t[:0])
    while len(lo):
        times = np.linspace(lo, hi, PARTS + 1, axis=1)
        heights = rows_at(session, times.ravel())[:, name].reshape(times.shape)
        heights *= side[:, None]
        k, best = np.arange(len(lo)), np.argmin(heights, axis=1)
        low, high = np.maximum(best - 1, 0), np.minimum(best + 1, PARTS)
        least, lo, hi = heights[k, best], times[k, low], times[k, high]
        bend = heights[k, low] - 2.0 * least + heights[k, high]
        dips = least < -nothing
        t = np.append(t, times[k, best][dips])
        g = np.append(g, (side * least)[dips])
        open_ = ~dips & (least < NEAR * bend) & (bend > nothing)
        open_ &= hi - lo > 4.0 * np.spacing(np.abs(hi))
        lo, hi, side = lo[open_], hi[open_], side[open_]
    order = np.argsort(t, kind="stable")
    return t[order], g[order]


def _crossings(t: Floats, g: Floats, direction: str) -> tuple[Floats, Floats]:
    """Give the ends of stretches (k, 2) with one crossing each, and g there, not 0."""
    change = np.flatnonzero(g[:-1] * g[1:] < 0.0)
    rises = g[change + 1] > 0.0
    change = change[{"up": rises, "down": ~rises}.get(direction, rises | ~rises)]
    both = change[:, None] + [0, 1]
    return t[both], g[both]


def _located(session: Session, ends: Floats, values: Floats, name: int) -> Floats:
    """Rows (k, columns) at crossings, by regula falsi and, where that lags, halves."""
    sizes, jumps = np.max(np.abs(values), axis=1), ends[:, 0] == ends[:, 1]
    rows = np.full((len(ends), len(session.columns.names)), np.nan)
    open_, width = np.arange(len(ends)), np.full(len(ends), np.inf)
    for _ in range(PASSES):
        if not len(open_):
            break
        (a, b), (at_a, at_b) = ends[open_].T, values[open_].T
        with np.errstate(all="ignore"):
            time = b - at_b * (b - a) / (at_b - at_a)
        slow = ~((time >= a) & (time <= b)) | (b - a > 0.5 * width[open_])
        time = np.where(slow, 0.5 * (a + b), time)
        width[open_] = b - a
        now = rows_at(session, time)
        rows[open_], value = now, now[:, name]
        side = np.where(value * at_a > 0.0, 0, 1)
        ends[open_, side], values[open_, side] = time, value
        near = 4.0 * np.spacing(np.abs(time))
        done = (value == 0.0) | (np.ptp(ends[open_], axis=1) <= near)
        open_ = open_[~(done | ~np.isfinite(value))]
    small = np.abs(rows[:, name]) <= SMALL * sizes
    jumps |= _with_set_modes(session, ends, ~(small | jumps), rows)
    return np.asarray(rows[small | jumps])


def _with_set_modes(
    session: Session, ends: Floats, apart: Floats, rows: Floats
) -> Floats:
    """Where, of those apart, an event sets a mode (k,); it fills the rows after it."""
    names = session.columns.names
    modes = [names.index(mode) for mode in session.equations.model.modes]
    found = apart & (np.ptp(ends, axis=1) <= 8.0 * np.spacing(np.abs(ends[:, 1])))
    if not modes or not found.any():
        return np.zeros_like(found)
    before, after = (rows_at(session, times) for times in ends[found].T)
    rows[found] = after
    found[found] = (before[:, modes] != after[:, modes]).any(axis=1)
    return np.asarray(found)


def _strobe(session: Session, made: Trajectory, section: Section) -> Floats:
    model = session.case.model
    assert section.every is not None
    values = model.parameter_values
    (period,) = evaluate(model.graph, [section.every], values)
    count = (made.end - made.start) / period if period > 0.0 else np.nan
    if not count < STROBES:
        text = f"`every` of the section `{section.name}` is {period:g}"
        text += f"; a run has at most {STROBES:,} of its periods"
        raise unusable("out-of-range", text, section.place)
    times = made.start + period * np.arange(np.floor(count + 1e-9) + 1.0)
    return np.minimum(times, made.end)


def rows_at(session: Session, times: Floats) -> Floats:
    """Rows (k, columns) of the run at some times (k,), by repeating it in its steps."""
    interrupt = Interrupt()
    different, places = np.unique(times, return_inverse=True)
    moments = Moments(different, len(session.columns.names), interrupt)
    if len(different):
        asked = session.asking(moments=tuple(different.tolist()))
        asked.run([moments], interrupt=interrupt)
    return moments.rows[places]


def tables(session: Session, found: dict[str, Floats]) -> Iterator[Made]:
    """Give name and content of the table of each section."""
    columns = session.columns.of_table
    for name, rows in found.items():
        yield f"section_{name}.csv", table_of(columns, rows.tolist())


def pictures(session: Session, found: dict[str, Floats], form: str) -> Iterator[Made]:
    """Give name and content of the picture of each section."""
    from lagsim.outputs.figure import Column, content, crossed

    e, names = session.equations, session.columns.of_table
    letters, known = letters_of(e.model), units(e, names)
    for section in e.model.output.sections:
        rows = found[section.name]
        varying = [
            name
            for name, x in zip(names, rows.T, strict=True)
            if len(x) and name != "t" and np.ptp(x) > 1e-9 * np.max(np.abs(x))
        ]
        shown = section.plot or [*dict.fromkeys([*varying, *names])][:2]
        x, y = (
            Column(letters.name(n), raised(known.get(n, "")), rows[:, names.index(n)])
            for n in shown
        )
        title = f"{e.model.name}: {section.name}"
        yield f"section_{section.name}.{form}", content(crossed(title, x, y), form)
