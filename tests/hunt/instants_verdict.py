"""A run of lagsim against the flights of a random model of instants."""

from __future__ import annotations

import csv
import math
from copy import copy

import numpy as np

from tests.hunt.flights import Script
from tests.hunt.instants import JUMPS, made, written
from tests.hunt.series import UndecidedError
from tests.hunt.verdict import Verdict, broken, replaced

# Speeds at the start and all forces are this much aside in a second motion.
NUDGE = 1e-9
# What coincides by speeds alone still does under other forces; and where these leave it
# open, under forces that are hardly others, whose motion is so many times farther off.
NUDGES = (
    ({"forces": NUDGE, "speeds": NUDGE}, 1.0), ({"forces": NUDGE}, 1.0),
    ({"forces": 1e-12}, 1e3),
)  # fmt: skip
# A model that magnifies it to more than this part of what moves is none to compare.
TRUSTED = 1e-5
# Granted: this part of the size, and as much of the distance to the second motion.
GRANTED, GAIN = 2e-9, 1.0
# Rows this near to an instant, in the model's own time, may be before or after it.
BESIDE = 1e-6
# The most motions of a model that leaves open how it moves on.
MOST_WAYS = 16
# What is refused, and why that is right.
REFUSED = ("static", "too many operations")


class Truth:
    """A motion of a model. known : (rows, columns) how far the nudged one is off.

    script : the ways taken where the model leaves open how it moves on
    error : (rows, columns) the error permitted to a method with fixed steps
    """

    def __init__(self, model, script):
        self.made, self.open, self.error = model, False, 0.0
        self.first = _run(model, 0.0, script)
        faults = []
        for nudge, part in NUDGES:
            try:
                self._compare(model, _run(model, nudge, script.again()), part)
            except UndecidedError as fault:
                faults.append(fault)
            else:
                return
        raise faults[0]

    def permitting(self, error):
        """Return the motion with another permitted error, and the rows beside it."""
        new = copy(self)
        new.error = error
        near = max(BESIDE, _near(new))
        new.beside = _beside(self.times, self.first.instants, near)
        return new

    def _compare(self, model, other, part):
        both = (self.first, other)
        width = 2 * model.model.n + len(model.model.states)
        a, b = (np.array([row[1] for row in x.rows]).reshape(-1, width) for x in both)
        events = [[name for _, name in x.events] for x in both]
        cuts = [list(map(len, x.crossings.values())) for x in both]
        same = len(self.first.instants) == len(other.instants)
        if self.first.chatters != other.chatters and None in (
            self.first.chatters, other.chatters
        ):  # fmt: skip
            raise UndecidedError("the nudged motion has another end")
        if a.shape != b.shape or events[0] != events[1] or cuts[0] != cuts[1]:
            raise UndecidedError("the nudged motion has other events")
        if not same or self.first.done != other.done:
            raise UndecidedError("the nudged motion has other instants")
        self.rows = a
        self.times = np.array([row[0] for row in self.first.rows])
        self.beside = _beside(self.times, self.first.instants)
        m = model.model
        v = slice(m.n, 2 * m.n)
        self.size = np.max(np.abs(a), axis=0, initial=0.0) + 1e-3
        self.size[v] = np.maximum(self.size[v], 1e-2 * np.max(self.size[v]))
        off = np.where(self.beside[:, None], 0.0, part * np.abs(a - b))
        known = np.maximum.accumulate(off, axis=0)
        if np.max(known / self.size, initial=0.0) > TRUSTED:
            raise UndecidedError("it magnifies what is not known")
        self.known = known


def _run(model, nudge, script):
    try:
        return model.flights(nudge, script)
    except (np.linalg.LinAlgError, OverflowError) as fault:
        raise UndecidedError(repr(fault)) from fault


def truths(model):
    """Return the motions of a model: several where the model does not determine one.

    They are `open` where further motions may exist.

    Raises
    ------
    UndecidedError
        If the referee finds no motion, or too many.
    """
    found, faults, script = [], [], Script()
    for _ in range(MOST_WAYS):
        script.asked = 0
        try:
            found.append(Truth(model, script))
        except UndecidedError as fault:
            faults.append(fault)
        script = script.next()
        if script is None:
            break
    if not found:
        raise faults[0]
    for truth in found:
        truth.open = bool(faults) or script is not None or truth.first.flights.helds > 0
    return found


def _beside(times, instants, near=BESIDE):
    """Return a mask of the rows near instants that have causes other than clocks."""
    turns = np.array([t for t, clocked in instants if not clocked] + [math.inf])
    return np.min(np.abs(times[:, None] - turns), axis=1) < near


def tried(seed, lagsim, *options):
    """Run the model of a seed by the referee and by lagsim; return file and verdict."""
    model = made(seed)
    file = written(model)
    try:
        ways = truths(model)
    except UndecidedError as fault:
        return file, Verdict("uncounted", str(fault))
    answer = lagsim.run(file, *options)
    return file, judged_by(ways, lagsim, answer)


def judged_by(ways, lagsim, answer):
    """Return the verdict on a run, which must follow one of several motions."""
    found = [judged(truth, lagsim, answer) for truth in ways]
    best = next((x for x in found if not x.is_fault), found[0])
    broke = best.kind in ("hang", "crash", "repeated")
    if best.is_fault and not broke and any(truth.open for truth in ways):
        return Verdict("uncounted", f"there may be more motions: {best.text}")
    return best


def judged(truth, lagsim, answer):
    """Return the verdict on a run against one motion."""
    found = broken(answer)
    if truth.first.chatters is not None:
        return _chatters(truth, answer)
    if found is not None:
        if any(word in found.text for word in REFUSED) and found.kind == "refused-2":
            return Verdict("uncounted", found.text)
        return found
    record = answer.record
    if found := replaced(record):
        return found
    if record["outcome"] != ("until" if truth.first.done else "done"):
        return Verdict("wrong-rows", f"{record['outcome']} at {record['end']}")
    warned = tuple(w["code"] for w in record["warnings"])
    checks = (_rows, _modes, _shown, _events, _sections, _balance)
    for check in checks:
        if fault := check(truth, answer, lagsim.folder):
            more = (f"{record['method']}, warned {warned}; instants "
                    f"{truth.first.instants[:12]}")  # fmt: skip
            return Verdict(fault[0], f"{fault[1]}; {more}", None, warned)
    return Verdict("fine")


def _chatters(truth, answer):
    """Return the verdict on a run whose events undo each other."""
    end = truth.first.chatters
    if answer.record is None or "chatter" not in str(answer.record["reason"]):
        return Verdict("no-end", f"events undo each other at {end!r}")
    off = abs(answer.record["end"] / truth.made.words.time - end)
    if off > _near(truth) + 1e-9 * end:
        return Verdict("wrong-end", f"{answer.record['end']!r}, truth {end!r}")
    fault = _rows(truth, answer, None) if len(truth.times) else None
    return Verdict(*fault) if fault else Verdict("fine")


def _times(truth, answer):
    """Return the rows (k,) of lagsim at the times of the truth: the last of each."""
    w = truth.made.words
    t = answer.column("t") / w.time
    near = 1e-9 * truth.made.step
    at = np.searchsorted(t, truth.times + near, side="right") - 1
    if truth.first.done and abs(t[-1] - truth.times[-1]) <= _near(truth):
        at[-1] = len(t) - 1  # located, as events are
    return t, at


def _grain(truth):
    """Return permitted differences of states (rows, columns), in model units."""
    w, n = truth.made.words, truth.made.model.n
    grain = GRANTED * truth.size + GAIN * truth.known + truth.error
    if w.far:
        # Places are multiples of the rounding of x, and speeds follow.
        ulp = 2.0**-52 * abs(w.far)
        more = 1e3 * ulp * (1.0 + truth.known / NUDGE / truth.size)
        grain[:, : 2 * n] += more[:, : 2 * n]
        grain[:, 2 * n :] += more[:, 2 * n :]
    return grain


def states(truth, answer):
    """Return the states (rows, columns) of a run at the times of the truth."""
    m, w = truth.made.model, truth.made.words
    columns = [answer.column(f"x{i + 1}") / w.length - w.far for i in range(m.n)]
    columns += [answer.column(f"x{i + 1}_dot") * w.time / w.length for i in range(m.n)]
    columns += [answer.column(z) for z in m.states]
    _, at = _times(truth, answer)
    return np.stack(columns, axis=1)[at]


def _rows(truth, answer, _folder):
    t, at = _times(truth, answer)
    off = np.abs(t[at] - truth.times)
    if truth.first.done:
        off[-1] = max(0.0, off[-1] - _near(truth))
    if np.any(off > 1e-7 * truth.made.step + 1e-12):
        return "wrong-rows", f"rows end at {t[-1]!r}, truth {truth.times[-1]!r}"
    found = states(truth, answer)
    off = np.where(truth.beside[:, None], 0.0, np.abs(found - truth.rows))
    if truth.first.done:
        off[-1] = 0.0
    over = off / _grain(truth)
    if np.max(over) <= 1.0:
        return None
    k, i = np.unravel_index(int(np.argmax(over)), over.shape)
    first = truth.times[int(np.argmax(np.any(over > 1.0, axis=1)))]
    return "wrong", (
        f"column {i} at {truth.times[k]!r}: lagsim {found[k, i]!r}, truth "
        f"{truth.rows[k, i]!r}, granted {_grain(truth)[k, i]:.1e}, off from {first!r}"
    )


def _modes(truth, answer, _folder):
    _, at = _times(truth, answer)
    for u in truth.made.model.modes:
        found = answer.column(u)[at]
        right = np.array([row[2][u] for row in truth.first.rows])
        off = np.abs(found - right) > 1e-6 * (1.0 + np.abs(right))
        if np.any(off & ~truth.beside):
            k = int(np.argmax(off & ~truth.beside))
            return "wrong-mode", (
                f"{u} at {truth.times[k]!r}: lagsim {found[k]}, truth {right[k]}"
            )
    return None


def _shown(truth, answer, _folder):
    """Compare definitions, and accelerations, off the instants."""
    m, w = truth.made.model, truth.made.words
    _, at = _times(truth, answer)
    near = max(BESIDE, _near(truth)) if np.any(truth.error) else BESIDE
    clear = _beside(truth.times, [(t, False) for t, _ in truth.first.instants], near)
    clear |= truth.times == truth.times[0]
    rows = truth.first.rows
    if abs(w.far) > 1e5:
        return None
    loose = 1e-6 + 10.0 * float(np.max(truth.known / truth.size)) * 1e2
    loose += 100.0 * float(np.max(truth.error / truth.size))
    for name in m.shown:
        right = np.array([row[4].get(name, math.nan) for row in rows])
        found = answer.column(name)[at]
        off = np.abs(found - right) > loose * (1.0 + np.abs(right))
        off &= ~clear & ~np.isnan(right)
        if np.any(off):
            k = int(np.argmax(off))
            return "wrong-shown", (
                f"{name} at {truth.times[k]!r}: lagsim {found[k]}, truth {right[k]}"
            )
    for i in range(m.n):
        right = np.array([row[3][i] for row in rows])
        found = answer.column(f"x{i + 1}_ddot")[at] / w.force
        off = np.abs(found - right) > loose * (1.0 + np.max(np.abs(right)))
        off &= ~clear
        if np.any(off):
            k = int(np.argmax(off))
            return "wrong-acceleration", (
                f"{i} at {truth.times[k]!r}: lagsim {found[k]}, truth {right[k]}"
            )
    return None


def _near(truth):
    near = 1e-7 + 1e3 * float(np.max(truth.known, initial=0.0))
    return near + 30.0 * float(np.max(truth.error, initial=0.0))


def _events(truth, answer, _folder):
    w = truth.made.words
    found = [(e["time"] / w.time, e["name"]) for e in answer.record["events"]
             if e["kind"] == "event"]  # fmt: skip
    right = truth.first.events
    same = [x for _, x in found] == [x for _, x in right]
    near = _near(truth)
    if same and all(
        abs(a - b) < near for (a, _), (b, _) in zip(found, right, strict=True)
    ):
        return None
    return "wrong-events", f"{found[:20]}, truth {right[:20]}"


def _sections(truth, _answer, folder):
    m, w = truth.made.model, truth.made.words
    near = _near(truth) + 1e4 * 2.0**-52 * abs(w.far)
    for name, crossings in truth.first.crossings.items():
        place = folder / "out" / f"section_{name}.csv"
        with place.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        t = [float(row["t"]) / w.time for row in rows]
        right = [c[0] for c in crossings]
        if len(t) != len(right) or any(
            abs(a - b) > near for a, b in zip(t, right, strict=True)
        ):
            return "wrong-section", f"{name} at {t[:15]}, truth {right[:15]}"
        for row, (at, values, modes) in zip(rows, crossings, strict=True):
            for i in range(m.n):
                v = float(row[f"x{i + 1}_dot"]) * w.time / w.length
                if abs(v - values[m.n + i]) > 10.0 * near * (1.0 + truth.size[m.n + i]):
                    return "wrong-section", f"{name} at {at}: v {v}, truth {values}"
            for u, x in modes.items():
                if abs(float(row[u]) - x) > 1e-6 * (1.0 + abs(x)):
                    return "wrong-section", f"{name} at {at}: {u} {row[u]}, truth {x}"
    return None


def _balance(truth, answer, _folder):
    drift, energy = answer.record["energy_drift"], answer.column("energy")
    size = np.max(np.abs(energy)) + np.max(np.abs(answer.column("kinetic")))
    if truth.made.words.far or drift is None:
        return None
    if any(x.kind in JUMPS for v in truth.made.model.potentials for x in v.nodes()):
        return None  # The energy jumps, and nothing else does.
    part = 1e-7 + 100.0 * float(np.max(truth.error / truth.size, initial=0.0))
    if drift > part * (size + truth.made.words.force * truth.made.words.length):
        return "wrong-balance", f"energy - work moves by {drift:.1e} of {size:.1e}"
    return None
