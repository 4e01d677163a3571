"""Quantities that must be equal for two forms of a model, with their tolerances."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.invariance import transforms as put
from tests.support import at_outputs, run

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.invariance.transforms import Document

EPS = 2.0**-52
# The start is moved by this part of each range to see what the motion makes of it.
NUDGE = 1e-7
STILL = 1e-6
# Errors of whole runs reach a thousand times the tolerance of a step, 1e-11 by default;
# other words may choose another formulation, so another run's error. A tenth of that.
GLOBAL = 1e-9
# Rounding acts in every step, not at the start alone; a run's error differs by how its
# steps fall.
ROUNDINGS, STEPS = 100.0, 30.0


@dataclass(frozen=True)
class Change:
    """Transformation of a model, and the rounding errors that it adds."""

    put: Callable[[Document, Sizes], Document]
    rounding: float = 1.0


@dataclass(frozen=True)
class Sizes:
    """Sizes of a model's motion: its ranges of positions and of speeds.

    own : the range of each coordinate, where it is known
    """

    length: float
    speed: float
    time: float
    own: dict[str, float] = field(default_factory=dict)

    def far(self, model, part):
        """Return the shift of each coordinate, at most ten times `part` of its range.

        A quaternion is not moved as far as a wheel beside it that turns many times.
        """
        return {
            q: part * min(self.length, 10.0 * self.own.get(q, self.length))
            for q in model.coordinates
        }


FAR, FAST = 1e3, 1e2
CHANGES: dict[str, Change] = {
    "shifted": Change(lambda m, s: put.replaced(m, far=s.far(m, FAR)), FAR),
    "boosted": Change(
        lambda m, s: put.replaced(m, speed=s.far(m, FAST / s.time)), FAST
    ),
    "metres": Change(lambda m, _: put.replaced(m, factor=1e-3)),
    "megametres": Change(lambda m, _: put.replaced(m, factor=1e6)),
    "microseconds": Change(lambda m, _: put.seconds(m, 1e-6)),
    "years": Change(lambda m, _: put.seconds(m, 3e7)),
    "grams": Change(lambda m, _: put.kilograms(m, 1e-3)),
    "tonnes": Change(lambda m, _: put.kilograms(m, 1e12)),
    "beside-a-planet": Change(
        lambda m, s: put.with_bystander(m, 1e24, 1e6 * s.length, 1e3 * s.speed)
    ),
    "beside-a-grain": Change(lambda m, s: put.with_bystander(m, 1e-12, 0.0, s.speed)),
    "beside-a-comet": Change(
        lambda m, s: put.with_bystander(m, 1.0, -1e9 * s.length, 1e6 * s.speed)
    ),
    "reordered": Change(lambda m, _: put.reordered(m)),
    # A clock that shows 1000 times the run rounds what depends on it.
    "later": Change(lambda m, _: put.later(m, 1000.0 * m.duration), 1e3),
}


@dataclass(frozen=True)
class Motion:
    """Rows of a model. q : (k, n); the times are those of the model itself."""

    times: Any
    q: Any


def moved(model, names, **options):
    """Run a model; return the named columns, with the times of the first form."""
    found = run(model.text(), **options)
    assert found.trajectory.outcome.word == "done"
    rows = at_outputs(found["t"], model.start, model.output_step)
    q = np.stack([found[name][rows] for name in names], axis=1)
    return Motion((found["t"][rows] - model.shift) * model.scale, q)


@dataclass(frozen=True)
class Known:
    """A model's motion, its error, and its change by a small perturbation, (k, n).

    `gain` is the change of each coordinate per change of the start by its range.
    """

    model: Document
    motion: Motion
    error: Any
    gain: Any
    range: Any

    @property
    def sizes(self):
        rates = (
            np.abs(np.diff(self.motion.q, axis=0)) / np.diff(self.motion.times)[:, None]
        )
        own = dict(zip(self.model.coordinates, map(float, self.range), strict=True))
        return Sizes(max(own.values()), float(np.max(rates)), self.model.duration, own)


def known(model):
    """Measure a motion: by a tighter tolerance, and by a start moved a little."""
    names = model.coordinates
    motion = moved(model, names)
    tight = moved(model, names, rtol="1e-13")
    spread = np.ptp(tight.q, axis=0)
    # One that should stay where it is has no range but rounding's.
    sizes = np.where(spread > STILL * np.max(spread), spread, np.max(spread))
    rng = np.random.default_rng(11)
    initial = dict(model.initial)
    for name, size in zip(names, sizes, strict=True):
        initial[name] += float(NUDGE * size * rng.choice([-1.0, 1.0]))
    # A start moved off its constraints is brought back onto them.
    free = frozenset(initial) if model.constraints else frozenset()
    nudged = replace(model, initial=initial, guesses=free)
    near = moved(nudged, names, rtol="1e-13")
    growing = np.maximum.accumulate(np.abs(near.q - tight.q)) / NUDGE
    error = np.maximum.accumulate(np.abs(motion.q - tight.q))
    return Known(model, tight, error, np.maximum(growing, sizes), sizes)


def differs(base, change):
    """Return the largest ratio of a difference to its tolerance, and its place."""
    model = change.put(base.model, base.sizes)
    other = moved(model, base.model.coordinates)
    assert np.allclose(
        other.times, base.motion.times, rtol=0, atol=1e-12 * base.model.duration * FAR
    )
    rounding = ROUNDINGS * EPS * change.rounding * base.gain
    # Tolerances are parts of a component's own scale, so the errors agree in size.
    allowed = STEPS * base.error + rounding + GLOBAL * base.range
    ratios = np.abs(other.q - base.motion.q) / allowed
    k, i = np.unravel_index(int(np.argmax(ratios)), ratios.shape)
    told = (
        f"{base.model.coordinates[i]} at t = {base.motion.times[k]:.6g}: "
        f"{other.q[k, i]!r}, was {base.motion.q[k, i]!r}, "
        f"{ratios[k, i]:.3g} times what is allowed"
    )
    return float(ratios[k, i]), told
