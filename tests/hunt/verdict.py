"""lagsim's run against the referee's: what a silent wrong answer is."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.hunt.referee import EPS, Effort, Equations, NoTruthError, Referee

if TYPE_CHECKING:
    from tests.hunt.contacts import ContactScene
    from tests.hunt.lagsim_runs import Answer, Lagsim
    from tests.hunt.referee import Motion
    from tests.hunt.scene import Scene

# A told error may be this much too small before the rows count as wrong; past MUTE
# no warning excuses it.
SLACK, MUTE = 100.0, 1000.0
# The second motion starts this far away, and is known less well: what rounding may do
# is what that does, times GAIN, since rounding acts in every step.
GAIN = 30.0
SMOOTH = Effort(3e-14), Effort(2e-13, nudge=8.0 * EPS)
STRUCK = Effort(1e-12, over=3e-9), Effort(1e-10, nudge=1e-12, over=1e-7)
# Two motions of the referee that differ by more than this part of the range are no
# truth: the scene is not counted.
TRUSTED = 1e-8
TRUSTED_STRUCK = 1e-7
# What is granted to a run that tells no error, as a part of the range.
UNTOLD = 1e-6
# What is granted to a run with contacts, as a part of the size of what moves.
GRANTED = 1e-8
# Warnings that say nothing about the rows.
IDLE = {
    "redundant", "multipliers-not-unique", "start-changed", "step-unused",
    "tolerance-unused", "undetermined-guess", "unit-mismatch", "disguised",
}  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """The motion, and how far it is known. state, known : (k, 2n), at each row."""

    motion: Motion
    times: Any
    state: Any
    known: Any
    range: Any


@dataclass(frozen=True)
class Verdict:
    """What is to be said. kind: fine, uncounted, or a fault; ratio: true over told."""

    kind: str
    text: str = ""
    ratio: float | None = None
    warned: tuple[str, ...] = field(default=())

    @property
    def is_fault(self) -> bool:
        return self.kind not in ("fine", "uncounted")


def truth(scene: Scene) -> Truth:
    """Give the referee's motion of a scene.

    Raises
    ------
    NoTruthError
        Its two motions differ, by method or because the scene magnifies rounding.
    """
    equations, struck = Equations(scene), bool(scene.terms("laws"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        motion, other = (
            Referee(equations, effort).motion()
            for effort in (STRUCK if struck else SMOOTH)
        )
    if len(motion.times) != len(other.times) or motion.stopped != other.stopped:
        raise NoTruthError("the two motions stop at different rows")
    state, again = np.array(motion.rows), np.array(other.rows)
    if not np.all(np.isfinite(state)):
        raise NoTruthError("not finite")
    times = np.array(motion.times)
    # At a row beside an impact the velocities are those of before or after.
    near = beside(scene, times, motion.impacts)[:, None]
    known = np.maximum.accumulate(np.where(near, 0.0, np.abs(state - again)))
    spread = sizes(state) if struck else motion.range
    size = spread + (0.0 if struck else 1e-6) * np.max(np.abs(state), axis=0)
    parts = np.max(known, axis=0) / np.where(size > 0, size, 1)
    if not np.max(parts) <= (TRUSTED_STRUCK if struck else TRUSTED):
        raise NoTruthError(f"the two motions differ: {parts}")
    return Truth(motion, times, state, known, spread)


def sizes(rows: Any) -> Any:
    """Give the size of each column (2n,): positions, and velocities among others."""
    size = np.max(np.abs(rows), axis=0) + 1e-3
    n = len(size) // 2
    size[n:] = np.maximum(size[n:], np.max(size[n:]) * 1e-3)
    return size


def beside(scene: Scene, times: Any, impacts: Any) -> Any:
    """Tell which times (k,) are those of impacts, as well as these are known."""
    away = np.abs(times[:, None] - np.array([*impacts])[None, :])
    return np.min(away, axis=1, initial=np.inf) < 1e-6 * scene.duration


def broken(answer: Answer) -> Verdict | None:
    """Say what is wrong with a run that has no rows to compare."""
    if answer.code == -1:
        return Verdict("hang", answer.told)
    if answer.code == 70:
        return Verdict("crash", answer.told[-900:])
    record = answer.record
    if answer.code != 0 or record is None or not record["complete"]:
        reason = record.get("reason") if record else answer.told
        return Verdict(f"refused-{answer.code}", str(reason)[-900:])
    return None


def judge(scene: Scene, answer: Answer, exact: Truth) -> Verdict:
    """Say what a run is worth, by the error that it tells."""
    if fault := broken(answer):
        return fault
    record = answer.record
    assert record is not None
    warned = tuple(w["code"] for w in record["warnings"] if w["code"] not in IDLE)
    if record["outcome"] != ("until" if exact.motion.stopped else "done"):
        return Verdict(
            "wrong-rows", f"{record['outcome']}, the truth ends at {exact.times[-1]}"
        )
    found = _rows(answer, exact, scene)
    if isinstance(found, str):
        return Verdict("wrong-rows", found, warned=warned)
    return _compared(scene, record, found, exact, warned)


def _rows(answer: Answer, exact: Truth, scene: Scene) -> Any:
    """Give the rows (k, 2n) at the times of the truth, or what is wrong with them."""
    times, t = exact.times, answer.column("t")
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


def _compared(
    scene: Scene, record: dict[str, Any], rows: Any, exact: Truth, warned: Any
) -> Verdict:
    n = len(scene.q)
    off = np.abs(rows - exact.state)
    if exact.motion.stopped:  # the last row moves with the time at which it stops
        moved = 1e-9 * scene.duration * np.abs(exact.motion.rate)
        off[-1] = np.maximum(0.0, off[-1] - moved)
    rounding = GAIN * exact.known + 8 * EPS * np.abs(exact.state)
    told = _told(record, scene, exact)
    over = np.where(off > rounding, off, 0.0)
    # Velocities carry the error of their coordinate at the rate of the scene.
    ratios = over / np.where(told > 0, told, 1e-300)
    ratios[:, n:] /= 10.0
    k, i = np.unravel_index(int(np.argmax(ratios)), ratios.shape)
    worst = float(ratios[k, i])
    name = [*scene.q, *(f"{q}_dot" for q in scene.q)][i]
    text = (
        f"{name} at t = {exact.times[k]!r}: lagsim {rows[k, i]!r}, truth "
        f"{exact.state[k, i]!r}, off by {off[k, i]:.2e} (range "
        f"{exact.range[i]:.2e}, rounding {rounding[k, i]:.1e}), told "
        f"{told[i]:.1e}; method {record['method']}, warned {warned}, error "
        f"{'told' if record['error'] else 'untold'}"
    )
    ratio = _whole_ratio(over[:, :n], told[:n])
    if worst > SLACK and not warned:
        return Verdict("silent-wrong", text, ratio, warned)
    if worst > MUTE and np.any(over > 1e-6 * (exact.range + 1e-300)):
        return Verdict("told-too-small", text, ratio, warned)
    # A horizon is told where some coordinate is off by a fair part of what was told.
    if "horizon" in warned and not np.any(off[:, :n] * MUTE > told[:n]):
        return Verdict("false-horizon", text, ratio, warned)
    return Verdict("fine", text, ratio, warned)


def _told(record: dict[str, Any], scene: Scene, exact: Truth) -> Any:
    """Give the told error of each coordinate, and what it means for its velocity."""
    n, spread = len(scene.q), exact.range
    if record["error"] is None:
        return UNTOLD * spread / SLACK
    told = record["error"]["coordinates"]
    parts = np.array([told[q]["largest"] for q in scene.q])
    relative = np.divide(parts, spread[:n], out=np.zeros(n), where=spread[:n] > 0)
    speeds = np.maximum(spread[n:], np.max(np.abs(exact.state[:, n:]), axis=0))
    # No error of a velocity is told. Where that of its position averages out (a sleigh
    # that spins), a velocity is still no better than the tolerance of its steps.
    relative = np.maximum(relative, record["rtol"] or 0.0)
    return np.concatenate([parts, relative * speeds])


def _whole_ratio(over: Any, told: Any) -> float | None:
    """Give the true error over the told one, of the coordinate where it is largest."""
    true = np.max(over, axis=0)
    seen = true > 0
    if not np.any(seen):
        return None
    return float(np.max(true[seen] / np.maximum(told[seen], 1e-300)))


# --- contacts -------------------------------------------------------------------------


def tried_contact(told: ContactScene, lagsim: Lagsim) -> Verdict:
    """Run a scene with contacts on both sides and judge."""
    try:
        exact = truth(told.scene)
    except NoTruthError as fault:
        return Verdict("uncounted", str(fault))
    scene, rows, path = told.scene, exact.state, exact.motion
    model = told.told()
    answer = lagsim.run(model.text())
    if fault := broken(answer):
        return fault
    t = (answer.column("t") - model.shift) * model.scale
    step = scene.output_step
    at = np.searchsorted(t, exact.times + 1e-7 * step, side="right") - 1
    if np.any(np.abs(t[at] - exact.times) > 1e-7 * step):
        return Verdict("wrong-rows", "rows at other times")
    names = [*scene.q, *(f"rate_{x}" for x in scene.q)]
    found = np.stack([answer.column(name)[at] for name in names], axis=1)
    size, rounding = exact.range, EPS * told.rounding
    grain = GRANTED * size + 1e3 * rounding
    grain = grain + GAIN * exact.known * (1.0 + 10.0 * rounding / STRUCK[1].nudge)
    near = beside(scene, exact.times, path.impacts)[:, None]
    over = np.where(near, 0.0, np.abs(found - rows) / grain)
    k, i = np.unravel_index(int(np.argmax(over)), over.shape)
    record = answer.record
    assert record is not None
    warned = tuple(w["code"] for w in record["warnings"])
    text = (
        f"{names[i]} at t = {exact.times[k]!r}: lagsim {found[k, i]!r}, truth "
        f"{rows[k, i]!r}, granted {grain[k, i]:.1e}; first off at "
        f"{exact.times[int(np.argmax(np.any(over > 1, axis=1)))]}; method "
        f"{record['method']}, warned {warned}; impacts {path.impacts[:8]}; events "
        f"{[(e['time'], e['kind']) for e in record['events']][:10]}"
    )
    kind = "wrong" if over[k, i] > 1.0 else "fine"
    if kind == "wrong" and "impact-order" in warned:
        # Impacts by turns that accumulate end as the last bits have it, and it is told.
        return Verdict("uncounted", text, None, warned)
    return Verdict(kind, text, float(over[k, i]), warned)
