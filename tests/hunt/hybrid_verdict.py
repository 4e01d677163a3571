"""Comparison of a run of lagsim with the run of the hybrid referee.

Both read the scene in a form of their own.
"""

from __future__ import annotations

import csv
import math
import warnings
from typing import NamedTuple

import numpy as np

from tests.hunt.hybrid import Equations, Hybrid, Plain
from tests.hunt.integrator import NoTruthError
from tests.hunt.verdict import Verdict, broken

# The start of the second motion is this much aside, and what that does is what a state
# that is known so well may do.
NUDGE = 1e-12
# Two motions farther apart than this part are none.
TRUSTED = 1e-7
# What is granted: this part of the size of what moves; and so many times the two
# motions' distance.
GRANTED, GAIN = 1e-8, 30.0
# At a row beside an impact or an event values are those of before or after.
BESIDE = 1e-6


class Told(NamedTuple):
    """A scene in both forms, for lagsim and for the referee.

    names : the referee's name -> lagsim's column
    near : permitted difference of the times of rows
    shift, scale : shift and scale of lagsim's clock
    rounding : rounding errors of lagsim's places and times
    floor : the least size of a velocity, as a part of the largest
    excused : codes of warnings -> factor by which these enlarge the tolerance
    """

    text: str
    plain: Plain
    names: dict[str, str]
    start: float
    times: list[float]
    near: float = 1e-8
    shift: float = 0.0
    scale: float = 1.0
    rounding: float = 0.0
    floor: float = 0.0
    excused: tuple[tuple[str, float], ...] = ()


def truth(told):
    """Return the motion, the errors of its rows (k, 2n + states), and their sizes."""
    equations = Equations(told.plain)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        first = Hybrid(equations).path(told.start, told.times)
        other = Hybrid(equations, 1e-10, 2e-10, NUDGE).path(told.start, told.times)
    if len(first.rows) != len(other.rows) or len(first.events) != len(other.events):
        raise NoTruthError("the two motions have other events")
    a, b = (np.array([row[1] for row in path.rows]) for path in (first, other))
    size, n = np.max(np.abs(a), axis=0) + 1e-3, equations.n
    v = size[n : 2 * n]
    size[n : 2 * n] = np.maximum(v, told.floor * np.max(v))
    off = np.where(_beside(first)[:, None], 0.0, np.abs(a - b))
    known = np.maximum.accumulate(off, axis=0) / size
    if not np.all(np.isfinite(a)) or np.max(known) > TRUSTED:
        raise NoTruthError(f"the two motions differ by {np.max(known):.1e}")
    return first, known, size


def _beside(path, near=BESIDE):
    times = np.array([row[0] for row in path.rows])
    turns = [*path.impacts, *(t for t, _, _ in path.events), np.inf]
    return np.min(np.abs(times[:, None] - np.array(turns)), axis=1) < near


def tried(told, lagsim, *options):
    """Run a scene by the referee and by lagsim; return file and verdict."""
    try:
        exact = truth(told)
    except (NoTruthError, np.linalg.LinAlgError) as fault:
        return Verdict("uncounted", str(fault))
    answer = lagsim.run(told.text, *options)
    return broken(answer) or judged(told, lagsim, answer, *exact)


def _names(path):
    """Return the referee's names of coordinates, velocities and states."""
    o = path.e.o
    return [x.name for x in (*o.q, *o.v, *o.s)]


def _near(known):
    """Return the permitted difference of times; known : as a part of sizes."""
    return 1e-8 + 1e3 * float(np.max(known))


def states(told, path, answer):
    """Return the states (rows, columns) of a run at the times of the truth."""
    times = np.array([row[0] for row in path.rows])
    t = (answer.column("t") - told.shift) * told.scale
    at = np.searchsorted(t, times + told.near, side="right") - 1
    columns = [answer.column(told.names[name])[at] for name in _names(path)]
    return np.stack(columns, axis=1)


def judged(told, lagsim, answer, path, known, size, error=0.0):
    """Compare rows, modes, events and sections; the energy less the work stays.

    error : (rows, columns) the error permitted to a method with fixed steps, in sizes
    """
    record, times = answer.record, np.array([row[0] for row in path.rows])
    warned = tuple(w["code"] for w in record["warnings"])
    if record["outcome"] != ("until" if path.armed.get("done") else "done"):
        return Verdict("wrong-rows", record["outcome"])
    t = (answer.column("t") - told.shift) * told.scale
    at = np.searchsorted(t, times + told.near, side="right") - 1
    late = np.abs(t[at] - times)
    if path.armed.get("done") and np.any(error):
        late[-1] = max(0.0, abs(t[-1] - times[-1]) - _near(known + error / GAIN))
    if np.any(late > told.near):
        return Verdict("wrong-rows", f"rows at {t[-1]!r}, truth {times[-1]!r}")
    names = _names(path)
    rows = np.array([row[1] for row in path.rows])
    found = np.stack([answer.column(told.names[name])[at] for name in names], axis=1)
    beside, rounding = _beside(path), 2.0**-52 * told.rounding
    if np.any(error):
        known = known + error / GAIN
        beside = _beside(path, max(BESIDE, _near(known)))
    grain = GRANTED + GAIN * known * (1.0 + 10.0 * rounding / NUDGE)
    grain = grain + 1e3 * rounding / size
    over = np.where(beside[:, None], 0.0, np.abs(found - rows) / size / grain)
    if path.armed.get("done"):
        over[-1] = 0.0
    k, i = np.unravel_index(int(np.argmax(over)), over.shape)
    events = [(e["time"], e["kind"], e.get("name") or e.get("constraint"))
              for e in record["events"]]  # fmt: skip
    text = (
        f"{names[i]} at {times[k]!r}: lagsim {found[k, i]!r}, truth {rows[k, i]!r}, "
        f"granted {grain[k, i] * size[i]:.1e}; {record['method']}, {warned}; off from "
        f"{times[int(np.argmax(np.any(over > 1, axis=1)))]}; turns {path.turns[:9]}; "
        f"impacts {path.impacts[:8]}; events {events[:12]}"
    )
    if over[k, i] > 1.0:
        most = max((x for code, x in told.excused if code in warned), default=0.0)
        if over[k, i] < most:
            return Verdict("uncounted", text, None, warned)
        return Verdict("wrong", text, float(over[k, i]), warned)
    if fault := _others(told, lagsim, answer, path, beside, at, known, error):
        return Verdict(fault[0], f"{fault[1]}; {text}", None, warned)
    return Verdict("fine", text, float(over[k, i]), warned)


def _others(told, lagsim, answer, path, beside, at, known, error):
    """Return texts on wrong modes, events, sections or energy balance."""
    near = _near(known)
    for k, mode in enumerate(path.e.modes):
        values = np.array([row[2][k] for row in path.rows])
        off = np.abs(answer.column(mode)[at] - values)
        if np.any(off[~beside] > near * (1 + np.max(np.abs(values)))):
            return "wrong-mode", f"{mode}: {answer.column(mode)[at]}, truth {values}"
    mine = [(t, name) for t, name, _ in path.events]
    theirs = [
        (e["time"], e["name"]) for e in answer.record["events"] if e["kind"] == "event"
    ]
    if not _alike(mine, theirs, near) or [x for _, x in mine] != [x for _, x in theirs]:
        return "wrong-events", f"{theirs}, truth {mine}"
    n = len(path.e.o.q)
    for name, crossings in path.crossings.items():
        place = lagsim.folder / "out" / f"section_{name}.csv"
        with place.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        column = told.names[path.e.o.v[0].name]
        pairs = [(float(row["t"]), float(row[column])) for row in rows]
        truth = [(t, y[n]) for t, y in crossings]
        if not _alike(pairs, truth, 10 * near):
            return "wrong-section", f"{name}: {pairs}, truth {truth}"
    drift, energy = answer.record["energy_drift"], answer.column("energy")
    part = math.inf if told.rounding else 3e-8 + 100.0 * float(np.max(error))
    most = part * (1 + np.max(np.abs(energy)))
    if drift is not None and drift > most:
        return "wrong-balance", f"energy - work moves by {drift:.1e}"
    return None


def _alike(some, others, near):
    """Return whether two lists have equal lengths and their times agree."""
    return len(some) == len(others) and all(
        abs(a[0] - b[0]) <= near for a, b in zip(some, others, strict=True)
    )
