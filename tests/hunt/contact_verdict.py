"""A run of a contact scene against the referee's."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.hunt.impacts import Equations, Faller
from tests.hunt.integrator import NoTruthError
from tests.hunt.verdict import Verdict

if TYPE_CHECKING:
    from tests.hunt.contacts import ContactScene
    from tests.hunt.lagsim_runs import Answer

# The start of the second motion is this much aside, and what that does is what a state
# that is known so well may do.
NUDGE = 1e-12
# Two motions farther apart than this part are none.
TRUSTED = 1e-7
# What is granted: this part of the size of what moves; and so many times the two
# motions' distance.
GRANTED, GAIN = 1e-8, 30.0
ULP = 2.0**-52


def truth(scene: ContactScene) -> tuple[Any, Any, Any]:
    """Give rows (k, 2n), how far they are known, and the impacts' times."""
    equations = Equations(scene)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        first = Faller(scene, equations, 1e-12, 0.0, 3e-9).path(scene.times)
        second = Faller(scene, equations, 1e-10, NUDGE, 1e-7).path(scene.times)
    a, b = np.array(first.rows), np.array(second.rows)
    size = np.max(np.abs(a), axis=0) + 1e-3
    n = len(scene.q)
    size[n:] = np.maximum(size[n:], np.max(size[n:]) * 1e-3)
    off = np.maximum.accumulate(np.abs(a - b), axis=0)
    near = _beside(scene, first.impacts)
    # At a row beside an impact the velocities are those of before or after.
    off = np.maximum.accumulate(np.where(near[:, None], 0.0, np.abs(a - b)), axis=0)
    if np.max(off / size) > TRUSTED:
        raise NoTruthError(f"the two motions differ by {np.max(off / size):.1e}")
    return a, off / size, first


def _beside(scene: ContactScene, impacts: Any) -> Any:
    times = np.array(scene.times)
    if not impacts:
        return np.zeros(len(times), dtype=bool)
    away = np.min(np.abs(times[:, None] - np.array(impacts)[None, :]), axis=1)
    return away < 1e-6 * scene.duration


def judged(scene: ContactScene, answer: Answer, exact: Any) -> Verdict:
    """Say what a run is worth."""
    rows, known, path = exact
    if answer.code == -1:
        return Verdict("hang", answer.told)
    if answer.code == 70:
        return Verdict("crash", answer.told[-900:])
    record = answer.record
    if answer.code != 0 or record is None or not record["complete"]:
        reason = record.get("reason") if record else answer.told
        return Verdict(f"refused-{answer.code}", str(reason)[-900:])
    told = scene.told
    t = (answer.column("t") - told.start) / told.time
    times = np.array(scene.times)
    at = np.searchsorted(t, times + 1e-7 * scene.step, side="right") - 1
    if np.any(np.abs(t[at] - times) > 1e-7 * scene.step):
        return Verdict("wrong-rows", "rows at other times")
    found = scene.back(answer.header, answer.rows)[at]
    n = len(scene.q)
    size = np.max(np.abs(rows), axis=0) + 1e-3
    size[n:] = np.maximum(size[n:], np.max(size[n:]) * 1e-3)
    far = [abs(told.shifts.get(x, 0.0) / told.length)
           + abs(told.boosts.get(x, 0.0)) * scene.duration * told.time / told.length
           for x in scene.q]  # fmt: skip
    fast = [abs(told.boosts.get(x, 0.0)) * told.time / told.length for x in scene.q]
    rounding = ULP * (max(far) + max(fast) + abs(told.start / told.time)) / NUDGE
    off = np.abs(found - rows) / size
    near = _beside(scene, path.impacts)
    grain = GRANTED + GAIN * known * (1.0 + 10.0 * rounding)
    grain = grain + 1e3 * ULP * (np.array([*far, *fast]) / size)
    over = np.where(near[:, None], 0.0, off / grain)
    k, i = np.unravel_index(int(np.argmax(over)), over.shape)
    name = [*scene.q, *(f"{x}_dot" for x in scene.q)][i]
    warned = tuple(w["code"] for w in record["warnings"])
    text = (
        f"{name} at t = {times[k]!r}: lagsim {found[k, i]!r}, truth {rows[k, i]!r}, "
        f"granted {grain[k, i] * size[i]:.1e}; first off at "
        f"{times[int(np.argmax(np.any(over > 1, axis=1)))]}; method "
        f"{record['method']}, warned {warned}; impacts {path.impacts[:8]}; events "
        f"{[(e['time'], e['kind']) for e in record['events']][:10]}"
    )
    if over[k, i] > 1.0 and "impact-order" in warned:
        # Impacts by turns that accumulate end as the last bits have it, and it is told.
        return Verdict("uncounted", text, None, warned)
    if over[k, i] > 1.0:
        return Verdict("wrong", text, float(over[k, i]), warned)
    return Verdict("fine", text, float(over[k, i]), warned)
