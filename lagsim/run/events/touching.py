"""What the laws of a run are at a state, in numbers: which could act, and how.

Gaps and rates count as zero within rounding: of their terms, and of the time at which
a step was cut.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact import Closed, delassus
from lagsim.mechanics.laws import Kind
from lagsim.methods.parts import parameters as kept
from lagsim.run.arc import MOMENTS

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc

# How far a state is moved, by parts, to see what its rounding does; and these parts.
PROBE = 2.0**-26
APART = 0.618033988749895
# What rounding leaves of a sum of terms of this size.
ROUNDED = 2.0**-46
# A flight this many times higher than rounding is one.
HIGHER = 16.0


class Touching:
    """The laws of a run at one state.

    Attributes
    ----------
    gaps, rates, accelerations : ndarray, shape (L,)
        Of the rows: the gap of a contact, else the speed; its rate, or the speed; and
        the rate of that as it would be without any law.
    forces : ndarray, shape (L,)
        The size of the terms of `accelerations`.
    bounds, statics : ndarray, shape (L,)
    slack : ndarray, shape (L,)
        Gaps, or speeds, that are rounding.
    still : ndarray, shape (L,)
        Rates that are rounding.
    reach : ndarray, shape (L,)
        How far the motion so far has moved each row's residual, and its rate.
    """

    def __init__(self, arc: Arc, y: Floats, t: float | None = None) -> None:
        system, n = arc.system, arc.system.n
        self.arc, self.y, self.laws = arc, y, system.laws
        self.t = t = arc.t if t is None else t
        self.count, first = len(system.laws), system.m - len(system.laws)
        m, L = system.m, self.count
        found = arc.runner.function("geometry", (n + m) * n + 4 * m)(t, y)
        self.M = found[: n * n].reshape(n, n)
        rows = found[n * n : (n + m) * n].reshape(m, n)
        self.equalities, self.rows = rows[:first], rows[first:]
        residuals, rates, gap_scales, rate_scales = found[(n + m) * n :].reshape(4, m)
        self.residuals, self.rates = residuals[first:], rates[first:]
        gapped = system.p.law_kind == kept.CONTACT
        self.gaps = np.where(gapped, self.residuals, self.rates)
        self.in_force = np.ones(L, dtype=bool)
        if any(law.when is not None for law in self.laws):
            self.in_force = arc.runner.function("conditions", L)(t, y) != 0.0
        slopes, seen, ranges = np.abs(self.rows), arc.seen, arc.ranges
        moment = MOMENTS * np.spacing(abs(t))
        sizes = np.maximum(rate_scales[first:], slopes @ seen[n : 2 * n])
        self.still = ROUNDED * sizes
        # Of what has not moved yet: by where it will soon be.
        soon = seen[:n] + arc.settings.output_step * np.abs(y[n : 2 * n])
        held = np.maximum(gap_scales[first:], slopes @ soon)
        self.slack = ROUNDED * held + moment * np.abs(self.rates)
        self.reach = slopes @ ranges[:n], slopes @ ranges[n : 2 * n]
        self.scales = held, sizes
        self._let_go()
        # What rounds in the forces has moved what they balance, since the last step.
        self.still = np.maximum(self.still, ROUNDED * self.forces * arc.state.step_h)

    def _let_go(self) -> None:
        """Find the accelerations that there would be without any law."""
        n = self.arc.system.n
        a, b, self.bounds, self.statics = self._free(self.y)
        self.accelerations = self.rows @ a - b
        # What forces do to each row, or have done in the last step: where they balance,
        # or vanish, rounding is that of their terms.
        pushed = np.maximum(np.abs(a), self.arc.state.parts[:n])
        self.forces = np.abs(self.rows) @ pushed + np.abs(b)

    @cached_property
    def noise(self) -> Floats:
        """What is rounding of `accelerations` (L,): their terms, and the state."""
        # Each component by another part, or what cancels would stay hidden.
        aside = 0.5 + np.modf(APART * np.arange(1.0, len(self.y) + 1.0))[0]
        a, b, *_ = self._free(self.y + PROBE * aside * self._known())
        stirred = np.abs(self.rows @ a - b - self.accelerations) / PROBE
        return np.asarray(ROUNDED * np.maximum(self.forces, stirred))

    def _known(self) -> Floats:
        """Give the sizes (size,) by which a state is rounded: also those of its rows.

        Rows that hold do so within the rounding of their own terms.
        """
        n, sizes = self.arc.system.n, self.arc.seen.copy()
        slopes = np.abs(self.rows)
        squares = np.sum(slopes**2, axis=1)
        per = slopes / np.where(squares > 0.0, squares, 1.0)[:, None]
        for first, scales in zip((0, n), self.scales, strict=True):
            moved = np.max(scales[:, None] * per, axis=0, initial=0.0)
            sizes[first : first + n] = np.maximum(sizes[first : first + n], moved)
        return sizes

    def _free(self, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Give q'' without any law, b of the laws, and their bounds and statics."""
        arc, p = self.arc, self.arc.system.p
        n, m, L = arc.system.n, arc.system.m, self.count
        mode = p.law_mode.copy()
        p.law_mode[:] = kept.OFF
        field = arc.runner.function("field", arc.system.size + m)(self.t, y)
        p.law_mode[:] = mode
        # Left there by `field`.
        b, bounds, statics = p.b[m - L :], p.law_bounds, p.law_statics
        return field[n : 2 * n], b.copy(), bounds.copy(), statics.copy()

    def is_closed(self, also: Collection[int] = ()) -> list[bool]:
        """Tell which laws could act: a slip with its contact.

        also : those that are closed whatever their gaps are.
        """
        mode = self.arc.system.p.law_mode
        closed: list[bool] = []
        for k, law in enumerate(self.laws):
            if law.kind is Kind.SLIP:
                closed.append(closed[law.normal])
            elif law.kind in (Kind.LIMITED, Kind.TIMED):
                closed.append(bool(self.in_force[k]))
            else:
                holds = mode[k] in (kept.HELD, kept.IMPLIED) or k in also
                near = self.gaps[k] <= self.slack[k]
                closed.append(bool((holds or near) and self.in_force[k]))
        return closed

    def strikes(self, k: int) -> bool:
        """Tell whether a closed law's rate must change at once."""
        kind, rate = self.laws[k].kind, self.rates[k]
        if kind is Kind.TIMED:
            return bool(abs(rate) > self.still[k])
        return kind is not Kind.SLIP and bool(rate < -self.still[k])

    def is_below(self, k: int) -> bool:
        """Tell whether rounding has left a contact's gap below 0."""
        return self.laws[k].kind is Kind.CONTACT and bool(self.gaps[k] < 0.0)

    def is_off(self, k: int, part: float) -> bool:
        """Tell whether a residual is off by more than a part of how it has moved."""
        residual = self.residuals[k]
        return bool(abs(residual) > part * self.reach[0][k] + self.slack[k])

    def rest(self, k: int, restitution: float) -> float | None:
        """Give the time for which a contact goes on to bounce if that is no motion.

        Its next flight is no higher than the tolerance of how far it has moved, or than
        rounding.
        """
        speed, fall = -restitution * self.rates[k], -self.accelerations[k]
        if not fall > 0.0:
            return None
        height = speed * speed / (2.0 * fall)
        told = self.arc.plan.tolerance * self.reach[0][k]
        if height > max(told, HIGHER * self.slack[k]):
            return None
        left = 2.0 * speed / fall
        return float(left / (1.0 - restitution)) if restitution < 1.0 else 0.0

    def is_spent(self, k: int) -> bool:
        """Tell whether a contact, or a slip, could go no farther than the tolerance.

        With all the speed that it has, against the forces that there are.
        """
        kind, force = self.laws[k].kind, self.forces[k]
        least = self.arc.plan.tolerance * self.reach[0][k]
        near = kind is Kind.SLIP or self.gaps[k] <= max(least, self.slack[k])
        way = self.rates[k] ** 2 / (2.0 * force) if force > 0.0 else 0.0
        return bool(kind in (Kind.CONTACT, Kind.SLIP) and near and way <= least)

    def problem(
        self, some: Sequence[int], restitutions: Floats
    ) -> tuple[Closed, Floats]:
        """Give the rows of some laws as a problem, and what they do (n, r)."""
        some = list(some)
        laws = [self.laws[k] for k in some]
        places = {k: i for i, k in enumerate(some)}
        found = delassus(self.M, self.equalities, self.rows[some])
        closed = Closed(
            D=found.D,
            kinds=tuple(law.kind for law in laws),
            normals=tuple(places.get(law.normal, -1) for law in laws),
            pairs=tuple(places.get(law.pair, -1) for law in laws),
            bounds=self.bounds[some],
            statics=self.statics[some],
            restitutions=restitutions,
            factor=found.factor,
        )
        return closed, found.response
