"""lagsim's run against the referee's: the definition of a silent wrong answer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.hunt.integrator import NoTruthError
from tests.hunt.mechanics import Mechanics
from tests.hunt.truth import Effort, Referee

if TYPE_CHECKING:
    from tests.hunt.truth import Motion

# A told error may be this much too small before the rows count as wrong; past MUTE
# no warning excuses it.
SLACK, MUTE = 100.0, 1000.0
# The second motion starts this many units in the last place away: what rounding may do
# is what that does, times GAIN, since rounding acts in every step.
NUDGE, GAIN = 8.0, 30.0
# Two motions of the referee that differ by more than this part of the range are no
# truth: the scene is not counted.
TRUSTED = 1e-8
# What is granted to a run that tells no error, as a part of the range.
UNTOLD = 1e-6
# Warnings that say nothing about the rows.
IDLE = {
    "redundant", "multipliers-not-unique", "start-changed", "step-unused",
    "tolerance-unused", "undetermined-guess", "unit-mismatch", "disguised",
}  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """The motion, and how far it is known.

    known : (k, 2n), estimated errors of the states up to each row
    """

    motion: Motion
    state: Any
    known: Any
    range: Any


@dataclass(frozen=True)
class Verdict:
    """Verdict on a run: its kind, and the ratio of true to reported error.

    kind : fine, uncounted, or a fault
    """

    kind: str
    text: str = ""
    ratio: float | None = None
    warned: tuple[str, ...] = field(default=())

    @property
    def is_fault(self):
        return self.kind not in ("fine", "uncounted")


def truth(scene):
    """Return the referee's motion of a scene.

    Raises
    ------
    NoTruthError
        Its two motions differ, by method or because the scene magnifies rounding.
    """
    mechanics = Mechanics(scene)
    motion = Referee(mechanics, Effort(columns=7)).motion()
    near = Effort(columns=6, tolerance=1e-15, nudge=NUDGE, seed=1)
    other = Referee(mechanics, near).motion()
    if len(motion.times) != len(other.times) or motion.stopped != other.stopped:
        raise NoTruthError("the two motions stop at different rows")
    state, again = (np.hstack([m.q, m.v]) for m in (motion, other))
    if not np.all(np.isfinite(state)):
        raise NoTruthError("not finite")
    known = np.maximum.accumulate(np.abs(state - again))
    spread = motion.range
    sizes = spread + 1e-6 * np.max(np.abs(state), axis=0)
    parts = np.max(known, axis=0) / np.where(sizes > 0, sizes, 1)
    if np.max(parts) > TRUSTED:
        raise NoTruthError(f"the two motions differ: {parts.astype(float)}")
    return Truth(motion, state, known, spread)


def broken(answer):
    """Return a text on the fault of a run that has no rows to compare."""
    if answer.code == -1:
        return Verdict("hang", answer.told)
    if answer.code == 70:
        return Verdict("crash", answer.told[-900:])
    record = answer.record
    if answer.code != 0 or record is None or not record["complete"]:
        reason = record.get("reason") if record else answer.told
        return Verdict(f"refused-{answer.code}", str(reason)[-900:])
    return None


def replaced(record):
    """Return a text if a second attempt has replaced the run, else an empty text."""
    for choice in record["plan"]:
        if choice["choice"].startswith("repeated"):
            return Verdict("repeated", f"{choice['choice']}: {choice['reason']}")
    return None


def judge(scene, answer, exact):
    """Return the verdict on the run of a scene."""
    if fault := broken(answer):
        return fault
    record = answer.record
    assert record is not None
    if found := replaced(record):
        return found
    warned = tuple(w["code"] for w in record["warnings"] if w["code"] not in IDLE)
    if record["outcome"] != ("until" if exact.motion.stopped else "done"):
        end = float(exact.motion.end)
        return Verdict(
            "wrong-rows", f"{record['outcome']}, but the truth ends at {end}"
        )
    found = _rows(answer, exact, scene)
    if isinstance(found, str):
        return Verdict("wrong-rows", found, warned=warned)
    return _compared(scene, record, found, exact, warned)


def _rows(answer, exact, scene):
    """Return the rows (k, 2n) at the times of the truth, or a text on their fault."""
    times, t = exact.motion.times.astype(float), answer.column("t")
    ends = abs(t[-1] - times[-1])
    # `until` is located as well as the motion is known.
    if ends > 1e-8 * scene.duration:
        return f"it ended at {t[-1]!r}, the truth at {times[-1]!r}"
    at = np.searchsorted(t, times[:-1])
    if np.any(at >= len(t)) or np.any(t[at] != times[:-1]):
        return "rows are missing or at other times"
    columns = [*scene.q, *(f"{q}_dot" for q in scene.q)]
    values = np.stack([answer.column(name) for name in columns], axis=1)
    return values[[*at, len(t) - 1]]


def _compared(scene, record, rows, exact, warned):
    n = len(scene.q)
    off = np.abs(rows - exact.state).astype(float)
    if exact.motion.stopped:  # the last row moves with the time at which it stops
        rate = np.hstack([exact.motion.v[-1], exact.motion.a[-1]]).astype(float)
        off[-1] = np.maximum(0.0, off[-1] - 1e-9 * scene.duration * np.abs(rate))
    rounding = (GAIN * exact.known + 8 * 2.0**-52 * np.abs(exact.state)).astype(float)
    told = _told(record, scene, exact)
    over = np.where(off > rounding, off, 0.0)
    # Velocities carry the error of their coordinate at the rate of the scene.
    ratios = over / np.where(told > 0, told, 1e-300)
    ratios[:, n:] /= 10.0
    k, i = np.unravel_index(int(np.argmax(ratios)), ratios.shape)
    worst = float(ratios[k, i])
    name = [*scene.q, *(f"{q}_dot" for q in scene.q)][i]
    text = (
        f"{name} at t = {float(exact.motion.times[k])!r}: lagsim {rows[k, i]!r}, truth "
        f"{float(exact.state[k, i])!r}, off by {off[k, i]:.2e} (range "
        f"{float(exact.range[i]):.2e}, rounding {rounding[k, i]:.1e}), told "
        f"{told[i]:.1e}; method {record['method']}, warned {warned}, error "
        f"{'told' if record['error'] else 'untold'}"
    )
    ratio = _whole_ratio(off[:, :n], over[:, :n], told[:n])
    if worst > SLACK and not warned:
        return Verdict("silent-wrong", text, ratio, warned)
    if worst > MUTE and _far(over, exact):
        return Verdict("told-too-small", text, ratio, warned)
    if "horizon" in warned and not _lost(off[:, :n], told[:n]):
        return Verdict("false-horizon", text, ratio, warned)
    return Verdict("fine", text, ratio, warned)


def _lost(off, told):
    """Return whether a coordinate is off by a large part of its reported error."""
    return bool(np.any(off * MUTE > told))


def _far(over, exact):
    return bool(np.any(over > 1e-6 * (exact.range + 1e-300)))


def _told(record, scene, exact):
    """Return the reported error of each coordinate, and its effect on the velocity."""
    n = len(scene.q)
    spread = exact.range.astype(float)
    if record["error"] is None:
        return UNTOLD * spread / SLACK
    told = record["error"]["coordinates"]
    parts = np.array([told[q]["largest"] for q in scene.q])
    relative = np.divide(parts, spread[:n], out=np.zeros(n), where=spread[:n] > 0)
    speeds = np.maximum(spread[n:], np.max(np.abs(exact.state[:, n:]), axis=0))
    # No error of a velocity is told. Where that of its position averages out (a sleigh
    # that spins), a velocity is still no better than the tolerance of its steps.
    relative = np.maximum(relative, record["rtol"] or 0.0)
    return np.concatenate([parts, relative * speeds.astype(float)])


def _whole_ratio(off, over, told):
    """Return the largest ratio, over coordinates, of true to reported error.

    Possible rounding is subtracted where it makes the reported error too small, and not
    where it makes that too large, since the reported error contains rounding as well.
    """
    seen = np.max(over, axis=0) > 0
    if not np.any(seen):
        return None
    told = np.maximum(told[seen], 1e-300)
    least, most = (np.max(x, axis=0)[seen] / told for x in (over, off))
    return float(np.max(np.maximum(least, np.minimum(most, 1.0))))
