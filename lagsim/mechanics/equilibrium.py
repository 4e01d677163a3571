"""An equilibrium near a state, and the small motions about it.

Newton's iteration on the forces along the free directions. Where they come from an
energy, it goes downhill: a direction of negative stiffness is taken by its size, so
that the equilibrium found is a stable one unless the state is an equilibrium itself.
Source: J. Nocedal, S. Wright, Numerical Optimization (2006), section 3.4.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.linearisation import eigenmodes
from lagsim.mechanics.structure import structure
from lagsim.tolerances import (
    COMPUTED_ZERO,
    ENERGY_ROUNDOFF,
    HALF_OF_DIGITS,
    RESIDUAL_ROUNDOFF,
    SAME_RESULT,
    SATISFIED,
    SETTLED_POSITION,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.linearisation import Linear, Linearisation

MOST_STEPS = 60
MOST_HALVINGS = 12
# A step goes at most so far, against the size of the positions.
REACH = 0.5


class Mode(NamedTuple):
    """Mode of the linearised equations.

    Attributes
    ----------
    eigenvalue : complex
        The one with the imaginary part >= 0.
    shape : ndarray of complex, shape (n,)
        Of the coordinates; the largest is 1.
    """

    eigenvalue: complex
    shape: np.ndarray[tuple[int], np.dtype[np.complex128]]

    @property
    def frequency(self) -> float:
        """Cycles per unit of time; 0 where it does not oscillate."""
        return self.eigenvalue.imag / (2.0 * math.pi)

    @property
    def period(self) -> float | None:
        """The time of a cycle; None where it does not oscillate."""
        return 1.0 / self.frequency if self.frequency > 0.0 else None

    @property
    def damping_ratio(self) -> float:
        """Of critical damping; below 0 where it grows."""
        return -self.eigenvalue.real / abs(self.eigenvalue)


def modes(linear: Linear) -> tuple[Mode, ...]:
    """Modes by rising frequency; neutral directions are left out."""
    moving = eigenmodes(linear.R, lambda x: x > HALF_OF_DIGITS * np.max(x, initial=0.0))
    found = []
    k = linear.Zh.shape[1]
    for value, vector in zip(moving.values, moving.right.T, strict=True):
        if value.imag < 0.0:
            continue
        shape = linear.Zh @ vector[:k].astype(complex)
        top = shape[np.argmax(np.abs(shape))] if len(shape) else 1.0
        if top == 0.0:
            continue  # a velocity alone
        found.append(Mode(complex(value), shape / top))
    return tuple(sorted(found, key=lambda mode: abs(mode.eigenvalue)))


class NoEquilibriumError(Exception):
    """There is none, or none was found; the text says why."""


class _Search:
    def __init__(
        self, equations: Equations, linearisation: Linearisation, t: float, size: float
    ) -> None:
        self.e, self.linearisation, self.t = equations, linearisation, t
        self.size = size or 1.0
        self.reach = 1.0
        self.rest = np.zeros(len(equations.q))
        self.pull = 0.0

    def linear(self, q: Floats) -> Linear:
        try:
            return self.linearisation.at(self.t, q, self.rest, resting=True)
        except (ValueError, np.linalg.LinAlgError):
            text = "on the way to an equilibrium something is not finite"
            raise NoEquilibriumError(text) from None

    def energy(self, q: Floats) -> float:
        e = self.e
        values = {p.name: p.value for p in e.model.parameters} | {"t": self.t}
        values |= dict(zip(e.q, map(float, q), strict=True))
        values |= dict.fromkeys(e.velocities, 0.0)
        return float(evaluate(e.graph, [e.energy], values)[0])

    def settled(self, q: Floats) -> tuple[Floats, Linear]:
        """Meet the constraints."""
        for _ in range(20):
            linear = self.linear(q)
            change = linear.restoring @ linear.residuals
            if np.linalg.norm(linear.lengths @ change) <= RESIDUAL_ROUNDOFF * self.size:
                break
            q = q + change
        return q, linear

    def step(self, linear: Linear, *, downhill: bool) -> Floats:
        """Change of a."""
        K, force = linear.stiffness, linear.force
        if not downhill:
            found = np.linalg.lstsq(K, force, rcond=COMPUTED_ZERO)[0]
            length = float(np.linalg.norm(found))
            return np.asarray(found * min(1.0, REACH * self.size / (length or 1.0)))
        w, U = np.linalg.eigh(0.5 * (K + K.T))
        along = U.T @ force
        least = np.abs(along) / (REACH * self.size)
        bends = np.maximum(np.abs(w), least)
        return np.asarray(U @ (along / np.where(bends > 0.0, bends, 1.0)))

    def whole(self, q: Floats) -> Floats:
        q, linear = self.settled(q)
        K = linear.stiffness
        stiffest = float(np.linalg.norm(K))
        self.pull = max(float(np.linalg.norm(linear.force)), stiffest * self.size)
        if self.at_rest(linear):
            return q
        self.reach = REACH * float(np.max(np.abs(q), initial=0.0) or 1.0)
        square = K.shape[0] == K.shape[1] and not self.e.model.forces
        skew = np.max(np.abs(K - K.T), initial=0.0) if square else np.inf
        downhill = bool(skew <= SAME_RESULT * stiffest)
        for _ in range(MOST_STEPS):
            change = linear.Zh @ self.step(linear, downhill=downhill)
            change *= min(1.0, self.reach / (np.max(np.abs(change)) or 1.0))
            q, linear = self.moved(q, linear, change, downhill=downhill)
            if self.at_rest(linear):
                return q
        text = "the search from the start did not come to rest at one"
        raise NoEquilibriumError(text)

    def moved(
        self, q: Floats, linear: Linear, change: Floats, *, downhill: bool
    ) -> tuple[Floats, Linear]:
        """Go as far as energy, or forces, become smaller."""

        def height(q: Floats, linear: Linear) -> float:
            if downhill:
                return self.energy(q)
            return float(np.linalg.norm(linear.force))

        before = height(q, linear)
        for k in range(MOST_HALVINGS):
            new, there = self.settled(q + change * 0.5**k)
            if height(new, there) <= before + ENERGY_ROUNDOFF * abs(before):
                break
        return new, there

    def at_rest(self, linear: Linear) -> bool:
        """Whether a step would be nothing, in neutral directions too."""
        if not len(linear.force):
            return True
        K, force = linear.stiffness, linear.force
        if np.linalg.norm(force) > SATISFIED * self.pull:
            return False
        U, s, _ = np.linalg.svd(K, full_matrices=True)
        stiffest = float(s[0]) if len(s) else 0.0
        firm = int(np.sum(s > COMPUTED_ZERO * stiffest))
        along = U.T @ force
        change = along[:firm] / s[:firm]
        loose = np.linalg.norm(along[firm:])
        bound = SETTLED_POSITION * self.size
        return bool(np.linalg.norm(change) <= bound and loose <= bound * stiffest)


def find_equilibrium(
    equations: Equations, linearisation: Linearisation, t: float, q: Floats, size: float
) -> Floats:
    """Find where the system can rest, from the positions q (n,).

    Parameters
    ----------
    size
        Of the positions, in the metric of M: what a change is compared with.

    Raises
    ------
    NoEquilibriumError
    """
    if not structure(equations).autonomous:
        raise NoEquilibriumError("the equations depend on time")
    if equations.states:
        raise NoEquilibriumError("the model has first-order states")
    found = _Search(equations, linearisation, t, size).whole(np.array(q, dtype=float))
    linear = linearisation.at(t, found, np.zeros_like(found), resting=True)
    if np.any(np.abs(linear.rates) > SETTLED_POSITION * max(1.0, size)):
        raise NoEquilibriumError("the constraints do not let it rest")
    return found


def named(names: Sequence[str], values: Floats) -> dict[str, float]:
    """Values by the names of the coordinates."""
    return dict(zip(names, map(float, values), strict=True))
