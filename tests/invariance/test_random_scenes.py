"""Random scenes of the hunt's grammar in other words, against the hunt's referee."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from tests.hunt.grammar import scene as scene_of
from tests.hunt.integrator import NoTruthError
from tests.hunt.verdict import GAIN, truth
from tests.invariance.same import CHANGES, EPS, STEPS, STILL, Sizes
from tests.invariance.transforms import document
from tests.support import run

COUNT = 8
# The default tolerance leaves a hundredth of this, as a part of the range.
WITHIN = 1e-7


@functools.cache
def known(number):
    """Return a scene for which the referee has a reference motion, and this motion."""
    while True:
        scene = replace(scene_of(f"same-{number}"), until="", settings={})
        try:
            return scene, truth(scene)
        except NoTruthError:
            number += COUNT


def drowned(spread, name):
    """Return the error of coordinates by rounding, if it hides one of them; else 0.

    All coordinates are shifted alike, by many times the largest range. Where a body has
    moved 1e9 times as far as an angle has turned, fewer than six digits of the angle
    remain. The rounding error of such an angle acts in each of some 30 steps.
    """
    if name not in ("shifted", "boosted"):
        return 0.0
    unit = EPS * CHANGES[name].rounding * np.max(spread)
    lost = unit > 30.0 * WITHIN * np.min(spread[spread > 0.0])
    return STEPS * unit if lost else 0.0


def judged(scene, exact, name):
    """Return a text on the fault of a scene in another form, or None."""
    change = CHANGES[name]
    n, spread = len(scene.q), exact.range.astype(float)
    rates = np.max(np.abs(exact.state[:, n:].astype(float)))
    sizes = Sizes(float(np.max(spread[:n])), float(rates), scene.duration)
    model = change.put(document(scene.text()), sizes)
    found = run(model.text())
    if found.trajectory.outcome.word != "done":
        return f"{name}: {found.trajectory.reason}"
    times = (found["t"] - model.shift) * model.scale
    at = [int(np.argmin(np.abs(times - t))) for t in exact.motion.times.astype(float)]
    off = np.stack([found[q][at] for q in scene.q], axis=1) - exact.motion.q
    still = spread[:n] <= STILL * np.max(spread[:n])
    moving = np.where(still, np.max(spread[:n]), spread[:n])
    magnified = np.max(exact.known[:, :n] / moving, axis=1, keepdims=True)
    allowed = (WITHIN + GAIN * change.rounding * magnified) * moving
    allowed = allowed + drowned(spread[:n], name)
    ratios = (np.abs(off) / allowed).astype(float)
    k, i = np.unravel_index(int(np.argmax(ratios)), ratios.shape)
    if ratios[k, i] < 1.0:
        return None
    return f"{name}: {scene.q[i]} at {exact.motion.times[k]} off by {off[k, i]:.3g}"


@pytest.mark.slow
@pytest.mark.parametrize("number", range(COUNT))
def test_random_scenes_move_the_same_in_other_words(number):
    scene, exact = known(number)
    wrong = [told for name in CHANGES if (told := judged(scene, exact, name))]
    assert not wrong, "\n".join([scene.text(), *wrong])
