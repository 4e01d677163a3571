"""A run of a contact scene against the referee's."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import yaml

from tests.hunt.hybrid import Equations, Hybrid, Law, Plain
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
ULP = 2.0**-52


def sizes(rows):
    """Give the size of each column (2n,): positions, and velocities among others."""
    size = np.max(np.abs(rows), axis=0) + 1e-3
    n = len(size) // 2
    size[n:] = np.maximum(size[n:], np.max(size[n:]) * 1e-3)
    return size


def plain_of(scene):
    """Give a scene in the words of the hybrid referee."""
    items = tuple(replace(item, laws=()) for item in scene.items)
    text = replace(scene, items=items).text()
    laws: list[Law] = []
    times = [law.until for law in scene.terms("laws") if law.until < math.inf]
    for law in scene.terms("laws"):
        kind = {"equality": "hold", "wheel": "ratchet"}.get(law.kind, law.kind)
        when = f"t < {law.until!r}" if law.until < math.inf else "1 > 0"
        if law.slip:
            rubs = repr(law.mu), repr(law.static or law.mu)
            laws.append(Law("slip", law.slip, when, mu=rubs[0], static=rubs[1],
                            normal=len(laws) + 1))  # fmt: skip
        laws.append(Law(kind, law.gap, when, e=repr(law.e), mu=law.limit or "0"))
    # BaseLoader keeps all scalars text.
    document = yaml.load(text, Loader=yaml.BaseLoader)  # noqa: S506
    return Plain(document, tuple(laws), times=tuple(times))


def truth(scene):
    """Give rows (k, 2n), how far they are known, and the impacts' times."""
    equations = Equations(plain_of(scene))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        first = Hybrid(equations).path(scene.start, scene.times)
        second = Hybrid(equations, 1e-10, 2e-9, NUDGE).path(scene.start, scene.times)
    a, b = (np.array([row[1] for row in path.rows]) for path in (first, second))
    # At a row beside an impact the velocities are those of before or after.
    near = _beside(scene, first.impacts)[:, None]
    off = np.maximum.accumulate(np.where(near, 0.0, np.abs(a - b)), axis=0) / sizes(a)
    if np.max(off) > TRUSTED:
        raise NoTruthError(f"the two motions differ by {np.max(off):.1e}")
    return a, off, first


def _beside(scene, impacts):
    times = np.array(scene.times)
    if not impacts:
        return np.zeros(len(times), dtype=bool)
    away = np.min(np.abs(times[:, None] - np.array(impacts)[None, :]), axis=1)
    return away < 1e-6 * scene.duration


def tried(told, lagsim):
    """Run a scene on both sides and judge."""
    try:
        exact = truth(told.scene)
    except NoTruthError as fault:
        return Verdict("uncounted", str(fault))
    return judged(told, lagsim, exact)


def judged(told, lagsim, exact):
    """Say what a run is worth."""
    scene, (rows, known, path) = told.scene, exact
    model = told.told()
    answer = lagsim.run(model.text())
    if fault := broken(answer):
        return fault
    t = (answer.column("t") - model.shift) * model.scale
    times = np.array(scene.times)
    step = scene.output_step
    at = np.searchsorted(t, times + 1e-7 * step, side="right") - 1
    if np.any(np.abs(t[at] - times) > 1e-7 * step):
        return Verdict("wrong-rows", "rows at other times")
    names = [*scene.q, *(f"rate_{x}" for x in scene.q)]
    found = np.stack([answer.column(name)[at] for name in names], axis=1)
    size, rounding = sizes(rows), ULP * told.rounding
    off = np.abs(found - rows) / size
    near = _beside(scene, path.impacts)
    grain = GRANTED + GAIN * known * (1.0 + 10.0 * rounding / NUDGE)
    grain = grain + 1e3 * rounding / size
    over = np.where(near[:, None], 0.0, off / grain)
    k, i = np.unravel_index(int(np.argmax(over)), over.shape)
    record = answer.record
    assert record is not None
    warned = tuple(w["code"] for w in record["warnings"])
    text = (
        f"{names[i]} at t = {times[k]!r}: lagsim {found[k, i]!r}, truth "
        f"{rows[k, i]!r}, granted {grain[k, i] * size[i]:.1e}; first off at "
        f"{times[int(np.argmax(np.any(over > 1, axis=1)))]}; method "
        f"{record['method']}, warned {warned}; impacts {path.impacts[:8]}; events "
        f"{[(e['time'], e['kind']) for e in record['events']][:10]}"
    )
    kind = "wrong" if over[k, i] > 1.0 else "fine"
    if kind == "wrong" and "impact-order" in warned:
        # Impacts by turns that accumulate end as the last bits have it, and it is told.
        return Verdict("uncounted", text, None, warned)
    return Verdict(kind, text, float(over[k, i]), warned)
