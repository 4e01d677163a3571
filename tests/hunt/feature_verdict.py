"""A run of a scene of features against the hybrid referee's."""

from __future__ import annotations

import csv
import warnings

import numpy as np

from tests.hunt.hybrid import Equations, Hybrid
from tests.hunt.integrator import NoTruthError
from tests.hunt.verdict import MUTE, Verdict, broken

TRUSTED, GRANTED, GAIN = 1e-7, 1e-8, 30.0


def truth(told):
    """Give the motion, and how far it is known: rows (k, 2n + states)."""
    equations = Equations(told.plain)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        first = Hybrid(equations).path(told.start, told.times)
        other = Hybrid(equations, 1e-10, 2e-9, 1e-12).path(told.start, told.times)
    if len(first.rows) != len(other.rows) or len(first.events) != len(other.events):
        raise NoTruthError("the two motions have other events")
    a, b = (np.array([row[1] for row in path.rows]) for path in (first, other))
    size = np.max(np.abs(a), axis=0) + 1e-3
    away = _beside(first)[:, None]
    known = np.maximum.accumulate(np.where(away, 0.0, np.abs(a - b)), axis=0) / size
    if not np.all(np.isfinite(a)) or np.max(known) > TRUSTED:
        raise NoTruthError(f"the two motions differ by {np.max(known):.1e}")
    return first, known, size


def _beside(path):
    times = np.array([row[0] for row in path.rows])
    turns = [*path.impacts, *(t for t, _, _ in path.events), np.inf]
    return np.min(np.abs(times[:, None] - np.array(turns)), axis=1) < 1e-6


def tried(told, lagsim):
    """Run a scene on both sides and judge."""
    try:
        exact = truth(told)
    except (NoTruthError, np.linalg.LinAlgError) as fault:
        return Verdict("uncounted", str(fault))
    answer = lagsim.run(told.text)
    if fault := broken(answer):
        return fault
    return judged(told, lagsim, answer, *exact)


def judged(told, lagsim, answer, path, known, size):
    """Compare rows, modes, events and sections; the energy less the work stays."""
    record, times = answer.record, np.array([row[0] for row in path.rows])
    warned = tuple(w["code"] for w in record["warnings"])
    if record["outcome"] != ("until" if path.armed.get("done") else "done"):
        return Verdict("wrong-rows", record["outcome"])
    t = answer.column("t")
    at = np.searchsorted(t, times + 1e-9, side="right") - 1
    if np.any(np.abs(t[at] - times) > 1e-8):
        return Verdict("wrong-rows", f"rows at {t[-1]!r}, truth {times[-1]!r}")
    o = path.e.o
    names = [x.name for x in (*o.q, *o.v, *o.s)]
    rows = np.array([row[1] for row in path.rows])
    found = np.stack([answer.column(told.names[name])[at] for name in names], axis=1)
    beside = _beside(path)[:, None]
    grain = GRANTED + GAIN * known
    over = np.where(beside, 0.0, np.abs(found - rows) / size / grain)
    if path.armed.get("done"):
        over[-1] = 0.0
    k, i = np.unravel_index(int(np.argmax(over)), over.shape)
    events = [(e["time"], e["kind"], e.get("name") or e.get("constraint"))
              for e in record["events"]]  # fmt: skip
    text = (
        f"{names[i]} at {times[k]!r}: lagsim {found[k, i]!r}, truth {rows[k, i]!r}, "
        f"granted {grain[k, i] * size[i]:.1e}; {record['method']}, {warned}; off from "
        f"{times[int(np.argmax(np.any(over > 1, axis=1)))]}; turns {path.turns[:9]}; "
        f"events {events[:12]}"
    )
    if "step-at-stability-bound" in warned and 1.0 < over[k, i] < MUTE:
        # Between steps that stability holds the interpolant is worse than they are.
        return Verdict("uncounted", text, None, warned)
    if over[k, i] > 1.0:
        return Verdict("wrong", text, float(over[k, i]), warned)
    if fault := _told(told, lagsim, answer, path, beside[:, 0], at, known):
        return Verdict(fault[0], f"{fault[1]}; {text}", None, warned)
    return Verdict("fine", text, float(over[k, i]), warned)


def _told(told, lagsim, answer, path, beside, at, known):
    """Say what is wrong with modes, events, sections or the balance of energy."""
    near = 1e-8 + 1e3 * float(np.max(known))
    for k, mode in enumerate(path.e.modes):
        values = np.array([row[2][k] for row in path.rows])
        off = np.abs(answer.column(mode)[at] - values)
        if np.any(off[~beside] > near * (1 + np.max(np.abs(values)))):
            return "wrong-mode", f"{mode}: {answer.column(mode)[at]}, truth {values}"
    mine = [(t, name) for t, name, _ in path.events]
    theirs = [
        (e["time"], e["name"]) for e in answer.record["events"] if e["kind"] == "event"
    ]
    if [x for _, x in mine] != [x for _, x in theirs] or any(
        abs(a - b) > near for (a, _), (b, _) in zip(mine, theirs, strict=True)
    ):
        return "wrong-events", f"{theirs}, truth {mine}"
    for name, crossings in path.crossings.items():
        with (lagsim.folder / "out" / f"section_{name}.csv").open(
            encoding="utf-8"
        ) as file:
            rows = list(csv.DictReader(file))
        n = len(path.e.o.q)
        pairs = [
            (float(row["t"]), float(row[told.names[path.e.o.v[0].name]]))
            for row in rows
        ]
        truth = [(t, y[n]) for t, y in crossings]
        if len(pairs) != len(truth) or any(
            abs(a[0] - b[0]) > 10 * near for a, b in zip(pairs, truth, strict=True)
        ):
            return "wrong-section", f"{name}: {pairs}, truth {truth}"
    drift, energy = answer.record["energy_drift"], answer.column("energy")
    if drift is not None and drift > 3e-8 * (1 + np.max(np.abs(energy))):
        return "wrong-balance", f"energy - work moves by {drift:.1e}"
    return None
