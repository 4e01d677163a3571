"""Scenes whose motion is known exactly, by name, and how a run is held against it.

Each is written once, in plain form; `tests/invariance` rewrites it far away, in a
moving frame, in other units, later, or beside other bodies.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import lagsim
from tests.invariance.same import CHANGES, EPS, Sizes
from tests.invariance.transforms import document

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

SIZES = Sizes(length=1.0, speed=2.0, time=2.0)
GLOBAL = 1e-9
# Of forces that begin at 0 the time itself is rounding, in other words than its own.
ROUNDED, AT_ONCE = 1e-3, 1e-12


def _unknown(_t):
    return {}


@dataclass(frozen=True)
class Exact:
    """A model with its exact motion and events.

    text : the model file
    motion : t (rows,) -> coordinate -> (rows,), nan where the motion is not known
    also : the exact motion of other columns, which other forms change
    events : kind -> times of all events after the start, and of impacts at the start
    fails : the code and the time of a run that cannot go on
    still : coordinates that rest to the last bit
    balanced : the size of the forces of both sides of a switch whose balance decides
        their shares. Other forms of the model round these forces differently, and a
        step adds half of its square times the rounding error
    within : tolerance as a part of the largest coordinate, or of 1 where none moves
    steps : the run takes fewer steps, and rejects fewer than a tenth of this number
    error : the error bar, as a part of the range, is less
    warned : codes of the warnings of the run
    unlike : changes of form that make another scene of the model
    """

    text: str
    motion: Callable[[Any], Mapping[str, Any]] = _unknown
    also: Callable[[Any], Mapping[str, Any]] = _unknown
    events: Mapping[str, Sequence[float]] | None = None
    fails: tuple[str, float] | None = None
    still: str = ""
    balanced: float = 0.0
    within: float = GLOBAL
    steps: int | None = None
    error: float | None = None
    warned: frozenset[str] = frozenset()
    unlike: tuple[str, ...] = ()

    def words(self, name, count):
        """Return `count` changes of form that keep the motion, others for each name."""
        known = [word for word in CHANGES if word not in self.unlike]
        first = zlib.crc32(name.encode())
        return [known[(first + 5 * k) % len(known)] for k in range(count)]


def check(scene, word=""):
    """Compare a run with its scene, in plain form or in another."""
    text, shift, scale, rounding = scene.text, 0.0, 1.0, 0.0
    if word:
        changed = CHANGES[word].put(document(text), SIZES)
        text, shift, scale = changed.text(), changed.shift, changed.scale
        rounding = 100.0 * EPS * CHANGES[word].rounding
    asked = "never" if scene.error is None else "auto"
    found = lagsim.simulate(lagsim.load(text), error_bar=asked)
    t = (found.t - shift) * scale
    within = max(scene.within, GLOBAL) if word else scene.within
    assert {w.code for w in found.warnings} == scene.warned
    if scene.fails:
        failure = found.record["failure"]["code"], t[-1]
        assert failure == (scene.fails[0], pytest.approx(scene.fails[1], abs=GLOBAL))
    else:
        assert found.complete, found.reason
    _compared(found, scene.motion(t), within, rounding)
    for name in scene.still.split():
        rest = 2.0 * EPS * scene.balanced * t[-1] ** 2 / 2.0 if word else 0.0
        assert np.ptp(found[name]) <= rest, name
    if scene.events is not None:
        _happened(found, scene, (t[0], shift, scale), within + rounding, word)
    shared = found.t[1:][np.diff(found.t) == 0.0]
    assert [*shared] == sorted({e.time for e in found.events if e.kind == "impact"})
    if scene.steps is not None:
        assert found.record["steps"] < scene.steps
        assert found.record["rejections"] < scene.steps / 10
    if scene.error is not None:
        assert found.record["error"]["horizon"] is None
        assert found.record["error"]["relative"] < scene.error
    if not word:
        _compared(found, scene.also(t), within, 0.0)
        work = found["work"] if "work" in found.columns else 0.0
        size = max(1.0, np.max(np.abs(found["energy"])))
        assert np.ptp(found["energy"] - work) < max(within, GLOBAL) * size


def _compared(found, exact, within, rounding):
    largest = [np.nanmax(np.abs(x), initial=0.0) for x in exact.values()]
    size = max(largest, default=0.0) or 1.0
    for name, x in exact.items():
        known = np.isfinite(x)
        bound = within * size + rounding
        assert found[name][known] == pytest.approx(x[known], abs=bound), name


def _happened(found, scene, clock, bound, word):
    """Compare all events after the start with the known ones."""
    start, shift, scale = clock
    first = start + (ROUNDED if word else AT_ONCE)
    times: dict[str, set[float]] = {}
    for event in found.events:
        at = (event.time - shift) * scale
        if at > first or event.kind == "impact":
            times.setdefault(event.kind, set()).add(at)
    expected = {k: [*x] for k, x in scene.events.items() if len(x)}  # type: ignore[union-attr]
    assert times.keys() == expected.keys()
    for kind, some in times.items():
        assert sorted(some) == pytest.approx(expected[kind], abs=10.0 * bound), kind
