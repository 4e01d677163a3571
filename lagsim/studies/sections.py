"""Sections of a motion: its states where a relation is crossed, and every period.

The run is repeated with the same steps and more rows, which its method interpolates
within them: at least SAMPLES in the shortest step. Where the relation's function has
another sign in the next row, or in a parabola through three, is a crossing; the run is
repeated for states at better and better times. So a section changes no step, and what
is between two rows of the table is not lost.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.errors import InputError, Problem
from lagsim.language.evaluate import evaluate
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
# Of the largest value, what rounding makes of 0.
NOTHING = 2.0**-46
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


class Brackets(NamedTuple):
    """Stretches (k,) with one crossing each, the values at both ends.

    seen : bool (k, 2), whether these are those of states, or of a parabola; nothing :
        what rounding makes of 0.
    """

    lo: Floats
    hi: Floats
    at_lo: Floats
    at_hi: Floats
    seen: Floats
    nothing: float


def sections(session: Session, made: Trajectory) -> dict[str, Floats]:
    """Rows (k, columns) of each section of a run, with the columns of its table.

    Raises
    ------
    InputError
        If a strobe has too many.
    """
    e, columns = session.case.equations, session.system.columns
    asked = e.model.output.sections
    located = [s for s in asked if s.at is not None]
    found: dict[str, Floats] = {}
    if located:
        names = [columns.names.index(f"section.{s.name}") for s in located]
        t, *values = _sampled(session, made, names)
        for section, name, g in zip(located, names, values, strict=True):
            brackets = _crossings(t, g, section.direction)
            found[section.name] = _located(session, brackets, name)
    for section in asked:
        if section.every is not None:
            found[section.name] = rows_at(session, _strobe(session, made, section))
    return {s.name: found[s.name][:, : columns.table] for s in asked}


def _sampled(session: Session, made: Trajectory, names: list[int]) -> Floats:
    settings, interrupt = session.case.settings, Interrupt()
    finest = max(
        made.statistics.smallest_step or settings.duration / FEW,
        SAMPLES * settings.duration / MOST,
    )
    spacing = min(finest, settings.output_step) / SAMPLES
    samples = _Samples(names, made.end, interrupt)
    session.asking(output_step=spacing).run([samples], interrupt=interrupt)
    return samples.table


def _crossings(t: Floats, g: Floats, direction: str) -> Brackets:
    """Stretches in which g (k,) changes its sign; what is 0 at the start has none."""
    nothing = float(NOTHING * np.max(np.abs(g), initial=0.0))
    clear = np.flatnonzero(np.abs(g) > nothing)
    t, g = t[clear], g[clear]
    change = np.flatnonzero(g[:-1] * g[1:] < 0.0)
    found = [t[change], t[change + 1], g[change], g[change + 1]]
    # Extremes between rows that a parabola takes through 0: two crossings.
    a, b, c = g[:-2], g[1:-1], g[2:]
    bend = np.where((even := a - 2.0 * b + c) == 0.0, np.inf, even)
    extreme, part = b - (c - a) ** 2 / (8.0 * bend), 0.5 * (a - c) / bend
    touch = np.flatnonzero(
        (a * b > 0.0) & (b * c > 0.0) & (extreme * b < 0.0) & (np.abs(part) <= 1.0)
    )
    middle = t[touch + 1] + part[touch] * 0.5 * (t[touch + 2] - t[touch])
    pairs = [
        (t[touch], middle), (middle, t[touch + 2]),
        (a[touch], extreme[touch]), (extreme[touch], c[touch]),
    ]  # fmt: skip
    found = [np.concatenate([x, *two]) for x, two in zip(found, pairs, strict=True)]
    seen = np.ones((len(change), 2), bool)
    seen = np.concatenate(
        [seen, *(np.tile(x, (len(touch), 1)) for x in ([True, False], [False, True]))]
    )
    order = np.argsort(found[0], kind="stable")
    rises = found[3][order] > 0.0
    wanted = {"up": rises, "down": ~rises}.get(direction, np.ones(len(rises), bool))
    lo, hi, at_lo, at_hi, known = (x[order][wanted] for x in (*found, seen))
    return Brackets(lo, hi, at_lo, at_hi, known, nothing)


def _located(session: Session, brackets: Brackets, name: int) -> Floats:
    """Rows (k, columns) at crossings, by regula falsi and, where that lags, halves."""
    lo, hi, at_lo, at_hi, seen = (x.copy() for x in brackets[:5])
    rows = np.full((len(lo), len(session.system.columns.names)), np.nan)
    open_, width = np.arange(len(lo)), np.inf * (hi - lo + 1.0)
    for _ in range(PASSES):
        if not len(open_):
            break
        a, b = lo[open_], hi[open_]
        with np.errstate(all="ignore"):
            time = b - at_hi[open_] * (b - a) / (at_hi[open_] - at_lo[open_])
        slow = ~((time >= a) & (time <= b)) | (b - a > 0.5 * width[open_])
        time = np.where(slow, 0.5 * (a + b), time)
        width[open_] = b - a
        now = rows_at(session, time)
        rows[open_] = now
        value = now[:, name]
        below = value * at_lo[open_] > 0.0
        for k, x, y, low in zip(open_, time, value, below, strict=True):
            if low:
                lo[k], at_lo[k] = x, y
            else:
                hi[k], at_hi[k] = x, y
            seen[k, 0 if low else 1] |= abs(y) > brackets.nothing
        near = 4.0 * np.spacing(np.abs(time))
        done = (value == 0.0) | (hi[open_] - lo[open_] <= near)
        done |= ~np.isfinite(value)
        open_ = open_[~done]
    sizes = np.maximum(np.abs(brackets.at_lo), np.abs(brackets.at_hi))
    jumps = brackets.hi == brackets.lo
    small = np.abs(rows[:, name]) <= SMALL * sizes
    return np.asarray(rows[(small | jumps) & seen.all(axis=1)])


def _strobe(session: Session, made: Trajectory, section: Section) -> Floats:
    model = session.case.equations.model
    assert section.every is not None
    values = {p.name: p.value for p in model.parameters}
    (period,) = evaluate(model.graph, [section.every], values)
    count = (made.end - made.start) / period if period > 0.0 else np.nan
    if not count < STROBES:
        text = f"`every` of the section `{section.name}` is {period:g}"
        text += f"; a run has at most {STROBES:,} of its periods"
        raise InputError([Problem("out-of-range", text, section.place)])
    times = made.start + period * np.arange(np.floor(count + 1e-9) + 1.0)
    return np.minimum(times, made.end)


def rows_at(session: Session, times: Floats) -> Floats:
    """Rows (k, columns) of the run at some times (k,), by repeating it in its steps."""
    interrupt = Interrupt()
    different, places = np.unique(times, return_inverse=True)
    moments = Moments(different, len(session.system.columns.names), interrupt)
    if len(different):
        asked = session.asking(moments=tuple(different.tolist()))
        asked.run([moments], interrupt=interrupt)
    return moments.rows[places]


def tables(session: Session, found: dict[str, Floats]) -> Iterator[Made]:
    """Give name and content of the table of each section."""
    columns = session.system.columns.of_table
    for name, rows in found.items():
        yield f"section_{name}.csv", table_of(columns, rows.tolist())


def pictures(session: Session, found: dict[str, Floats], form: str) -> Iterator[Made]:
    """Give name and content of the picture of each section."""
    from lagsim.outputs.figure import Column, content, crossed

    e, names = session.case.equations, session.system.columns.of_table
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
