"""Mode selection at a state on switching surfaces: crossing, sliding, or rest.

A surface reached with a nonzero rate is crossed. Where the rate vanishes, or is a rate
of velocities, which depends on the side, the forces decide (`filippov`). A surface that
steps together with another one, as `abs(x_dot) > 0` does with `sign(x_dot)`, has no
mode of its own: its side is a function of the other surface's side. A surface whose
expression is at its level on a whole interval, as that of
`sign(x - max(-1, min(1, x)))`, is on neither side.

Where the rate of a surface, its slope (`x*abs(x)`, `x + x_dot*abs(x_dot)` at rest) or
the forces on it vanish, the derivatives of first and second order do not determine the
side to which the motion leads. A few short integration steps determine this side,
whatever the order.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.algebra import multiple_of
from lagsim.run.events.curve_ends import REACH
from lagsim.run.events.filippov import Beside, FilippovCone, SideSolution
from lagsim.run.events.kinematics import Acting, Kinematics
from lagsim.run.events.law_modes import (
    Chosen,
    ahead_of,
    chosen_modes,
    that_could_act,
    write_modes,
)
from lagsim.run.events.surface_modes import (
    ABOVE,
    BELOW,
    LEVEL,
    REDUNDANT,
    SLIDING,
    Carried,
)
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    COMPUTED_ZERO,
    HALF_OF_DIGITS,
    RESIDUAL_ROUNDOFF,
    SUM_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.row_modes import RowModes
    from lagsim.run.events.records import LawsAt
    from lagsim.run.events.surface_modes import Rows, SurfaceModes


# Least rate of a surface, in the largest speeds of its terms so far, at which its time
# is known well.
SLOWEST = 2.0**-10
# Largest number of surfaces all of whose corners are evaluated for scales of rates.
FEW_CORNERS = 3


@dataclass(slots=True)
class Crossing:
    """Selection of the sides and modes of all K surfaces at a state.

    The expression of a surface may jump at another surface. Therefore sides are
    selected in the order of dependence: each from the value of its expression, after
    the sides on which this expression depends. `decide` stores the selected modes in
    `modes`.

    A surface at its level is open if the forces decide its side, and loose if the sides
    of the open surfaces determine it. An open surface is hanging if its expression
    depends on the side of another open one, and is at its level on some sides only.

    Attributes
    ----------
    modes : SurfaceModes
        The modes of all surfaces, changed in place.
    known : mapping of int to float
        For each surface known to be at its level, the largest distance of its
        expression from the level; negative for one that has jumped past its level.
    levels : dict of int to float
        Level of each surface that the state is on.
    sizes : ndarray, shape (K,)
        Magnitudes of the terms of all surfaces.
    values : ndarray, shape (K,)
        The expressions of all surfaces, with the sides selected so far.
    rows : Rows
        The rows of all surfaces, with the sides selected so far.
    """

    modes: SurfaceModes
    known: Mapping[int, float]
    at_rest: Collection[int]  # surfaces whose rate is zero
    left: float  # time until the motion comes to rest on the surfaces `at_rest`
    hit: int  # the surface that has ended the last arc, or -1
    resting: Collection[int]  # surfaces at whose level constraints hold the motion
    beside: LawsAt | None  # the laws at the instant, or None without laws
    shared: tuple[list[int], RowModes, list[int]] | None = None  # see `LawsAt`
    # indices of the laws that could act, except equalities in force that are in `held`
    laws: list[int] = field(default_factory=list)
    # indices of the laws that are equalities in force, and no rows of the problem
    held: list[int] = field(default_factory=list)
    # indices of the equalities that are rows of the problem, beside the laws
    released: list[int] = field(default_factory=list)
    # indices of the open surfaces at which these rows or laws have kinks
    kinks: list[int] = field(default_factory=list)
    # surfaces whose side the forces decide
    open: list[int] = field(default_factory=list)
    # surfaces whose side open surfaces decide
    loose: list[int] = field(default_factory=list)
    # surfaces that are open on some sides of others only
    hanging: list[int] = field(default_factory=list)
    undecided: list[int] = field(default_factory=list)  # surfaces without a decision
    # surfaces that are constant at their levels
    constant: list[int] = field(default_factory=list)
    # surfaces at whose levels the motion stays by itself
    kept: list[int] = field(default_factory=list)
    # surfaces at whose levels the motion is at rest, while it could also follow them
    rests: list[int] = field(default_factory=list)
    levels: dict[int, float] = field(default_factory=dict)
    # surfaces whose sides have changed since `rows`
    stale: set[int] = field(default_factory=set)
    roundoff: Floats = field(init=False)  # roundoff bounds of open surfaces' rates (K,)
    led: Floats = field(init=False)  # see `_rounding_beside`
    values: Floats = field(init=False)
    sizes: Floats = field(init=False)
    rows: Rows = field(init=False)

    def find(self) -> None:
        """Store in `levels` the level of each surface that the state is on.

        All other surfaces are set to the sides of their expressions' values.
        """
        modes = self.modes
        self.led = np.zeros(modes.count)
        self._evaluate()
        for k in modes.order:
            if not modes.depends[k].isdisjoint(self.stale):
                self._evaluate()
            if k not in self.levels:
                self._set_by_value(k)

    def decide(self) -> None:
        """Select the modes of all surfaces.

        The rate of a surface selects its side, if the rate is not 0; otherwise the
        forces do, by Filippov's conditions.
        """
        modes = self.modes
        self.roundoff = np.zeros(modes.count)
        value, whole = modes.value.copy(), modes.whole
        if self.beside is not None:
            modes.write()  # gaps are those of the sides selected so far
            self._sort_laws(self.beside)
        for k in modes.order:
            if not modes.depends[k].isdisjoint(self.stale):
                self._evaluate()
            self._sort(k)
        if self.open:
            edges = [self.levels[k] if whole[k] else 0.5 for k in self.open]
            pairs = zip(self.open, edges, strict=True)
            now = [ABOVE if value[k] >= x else BELOW for k, x in pairs]
            self._release()
            self._by_forces(now)
        if modes.nested:
            self._evaluate()

    def _sort_laws(self, beside: LawsAt) -> None:
        """Store the laws that could act in `laws`, and equalities in force in `held`.

        Equalities get modes with which evaluations of forces include their rows: they
        hold on each side of each surface, with the row and the multiplier of this side.
        """
        arc = self.modes.arc
        here = Kinematics(arc, arc.y)
        closed, equal = that_could_act(here, beside.closed), here.table.equal
        self.laws = [k for k in closed if not equal[k]]
        self.held = [k for k in closed if equal[k]]
        if self.held:
            found, p = chosen_modes(here, self.held, {}), arc.system.p
            p.law_mode[self.held] = found.mode[self.held]
            p.law_direction[self.held] = found.direction[self.held]

    def _release(self) -> None:
        """Make equalities with a kink at an open surface rows of the problem of modes.

        The force of such a row depends on the share of the surface. Without further
        laws the equality holds on each side, with the row and the multiplier there.
        """
        if not self.laws:
            return
        arc = self.modes.arc
        known, laws, m = arc.system.switches.corners, arc.system.laws, arc.system.m
        names = {name for k in self.open if k in known for name in known[k].rows}
        bent = [k for k in self.held if laws[k].row.name in names]
        self.held = [k for k in self.held if k not in bent]
        self.laws = sorted([*self.laws, *bent])
        equalities = arc.system.equations.relations[: m - len(laws)]
        self.released = [i for i, row in enumerate(equalities) if row.row.name in names]
        if self.released or any(laws[k].row.name in names for k in self.laws):
            self.kinks = [i for i, k in enumerate(self.open) if k in known]

    def _here(self, y: Floats | None = None) -> Kinematics:
        """Return the laws at y (size,), beside the equalities that are not released.

        y : by default the state reached.
        """
        arc, y = self.modes.arc, self.modes.arc.y if y is None else y
        return Kinematics(arc, y, held=self.held, released=self.released)

    def _evaluate(self) -> None:
        """Compute `values`, `rows`, `sizes` and `levels` with the present sides."""
        modes, arc = self.modes, self.modes.arc
        modes.write()
        self.values = modes.values(arc.t, arc.y)
        self.rows = modes.rows()
        self.sizes = modes.sizes()
        self.stale.clear()
        self.levels = self._levels()
        if 0 < len(self.levels) < len(modes.order):
            self.led = np.fmax(self.led, self._rounding_beside())
            self.levels = self._levels()

    def _levels(self) -> dict[int, float]:
        """Return the levels of the surfaces whose `values` equal them to rounding."""
        values = self.values.tolist()
        found = ((k, self._level(k, values[k])) for k in sorted(self.modes.order))
        return {k: level for k, level in found if level is not None}

    def _level(self, k: int, value: float) -> float | None:
        """Return the level of surface k that `value` equals to rounding, or None."""
        level, known = self.modes.level(k, value), self.known.get(k, 0.0)
        least = max(RESIDUAL_ROUNDOFF * self.sizes[k], self.led[k], known)
        return level if known >= 0.0 and abs(value - level) <= least else None

    def _rounding_beside(self) -> Floats:
        """Return errors (K,) of expressions due to the location of other surfaces.

        A surface is located to the rounding of its own expression. The error of the
        state, across this surface or along the motion, changes the expressions of all
        other surfaces. Two examples: a surface at x = 0 that is a knot of a long table
        is located to the rounding of the table's range, although `abs(x)` at this place
        has no rounding of its own; and a surface that is reached slowly is located
        earlier or later than one that is reached fast at the same time. Where the time
        alone changes an expression, as in `cos(t)*(1 + x)` at cos(t) = 0, the state has
        no such error, although the slope, 0 but for rounding, is not 0.
        """
        modes, J, rates = self.modes, self.rows.J, np.abs(self.rows.rates)
        found, moving = np.zeros(modes.count), np.array(modes.on_rates)
        speeds = np.abs(J) @ modes.arc.magnitudes[modes.arc.state.driven]
        # the expression of one surface depends on the side of another
        nested = any(modes.depends)
        by_motion = self._parts_of_motion(speeds)
        for k, level in self.levels.items():
            if modes.may_cancel[k] and modes.is_constant_around(k):
                continue  # its slopes may be 0 but for rounding
            beside, square = moving == moving[k], float(J[k] @ J[k])
            off = 2.0 * abs(float(self.values[k]) - level)
            least = max(RESIDUAL_ROUNDOFF * float(self.sizes[k]), off)
            if nested and not moving[k] and rates[k] > SLOWEST * speeds[k] > 0.0:
                along = np.where(beside, least / rates[k] * rates, 0.0)
                found = np.fmax(found, along)
            if not square > 0.0:
                continue
            least *= by_motion[k]
            change = modes.along_rows(least / square * J[k])
            own = abs(float(J[k] @ change))
            if own > HALF_OF_DIGITS * least:  # not determined by the rows
                change *= least / own
            found = np.fmax(found, np.where(beside, np.abs(J @ change), 0.0))
        return np.asarray(found)

    def _parts_of_motion(self, speeds: Floats) -> Floats:
        """Return the part (K,) of each surface's rate that is due to the motion.

        The remainder is due to the time in its expression. At most 1.

        speeds : the largest rates (K,) due to the motion, of surfaces of positions.
        """
        modes, rows, moving = self.modes, self.rows, np.array(self.modes.on_rates)
        whole = np.abs(rows.rates)
        if moving.any():
            a = modes.accelerations(modes.arc.y)
            with np.errstate(invalid="ignore"):  # undefined accelerations
                speeds = np.where(moving, np.abs(rows.J) @ np.abs(a), speeds)
                whole = np.where(moving, np.abs(rows.J @ a - rows.b), whole)
        parts = np.ones(modes.count)
        np.divide(speeds, whole, out=parts, where=whole > speeds)
        return parts

    def _set_by_value(self, k: int) -> None:
        """Set surface k, off its levels, to the side of its expression's value."""
        before = self.modes.value[k]
        self.modes.set_by_value(k, self.values[k])
        if self.modes.value[k] != before:
            self.stale.add(k)

    def _set_mode(self, k: int, mode: int) -> None:
        """Set surface k to a mode: BELOW, ABOVE, or LEVEL (at rest at its level)."""
        before = self.modes.value[k]
        self.modes.set_mode(k, self.levels[k], mode)
        if self.modes.value[k] != before:
            self.stale.add(k)

    def _sort(self, k: int) -> None:
        """Select the side of surface k, at its level, by its own rate if that is not 0.

        Otherwise k is appended to `open`, to be decided by forces, or to `loose`, if it
        steps together with open surfaces. Surfaces whose expressions are constant at
        their level, or which constraints hold there, get the mode LEVEL.
        """
        modes = self.modes
        rows = self.rows
        is_hanging = not modes.depends[k].isdisjoint([*self.open, *self.loose])
        if is_hanging:
            if self._follows(k):
                self.loose.append(k)
                return
            rows = modes.rows()
        elif k not in self.levels:
            self._set_by_value(k)
            return
        elif modes.is_constant_around(k, rows):
            self._set_mode(k, LEVEL)
            self._watch(k)
            return
        elif k in self.resting and self.beside is None:
            self._set_mode(k, LEVEL)
            return
        rate = self._rate(rows, k)
        if rate != 0.0:
            self._set_mode(k, ABOVE if rate > 0.0 else BELOW)
        elif not is_hanging and modes.is_kept(k, self.levels[k]):
            self._set_mode(k, LEVEL)
            self.kept.append(k)
        elif self._parallel(rows, k):
            self.loose.append(k)
        else:
            self.hanging += [k] * is_hanging
            self.open.append(k)

    def _rest_if_constant(self, surfaces: Collection[int]) -> None:
        """Set surfaces whose expressions are constant around the state to rest.

        surfaces : the surfaces that are examined, all at their levels.
        """
        modes = self.modes
        modes.write()
        for k in surfaces:
            if modes.is_constant_around(k):
                modes.set_mode(k, modes.levels[k], LEVEL)
                self._watch(k)

    def _watch(self, k: int) -> None:
        """Let the arc end where surface k, constant at its level, leaves it.

        The arc does not end at the rounding of an expression that cannot leave, unless
        another surface on which it depends is at its level: its side may change first.
        """
        modes = self.modes
        if not modes.lasting[k] or modes.kind[[*modes.depends[k]]].any():
            modes.watched.append(k)
            self.constant.append(k)

    def _rate(self, rows: Rows, k: int) -> float:
        """Return the rate of surface k; 0 where it is below rounding.

        Also 0 for a surface that depends on velocities or whose rate is known to be 0,
        as where constraints and laws hold the motion at its level.

        rows : the rows of all surfaces.
        """
        modes, arc = self.modes, self.modes.arc
        if modes.on_rates[k] or k in self.at_rest or k in self.resting:
            return 0.0
        v = arc.y[arc.state.driven]
        rate = float(rows.rates[k])
        terms = np.abs(rows.J[k]) @ arc.magnitudes[arc.state.driven]
        terms += abs(rate - float(rows.J[k] @ v))
        return rate if abs(rate) > RESIDUAL_ROUNDOFF * terms else 0.0

    def _follows(self, k: int) -> bool:
        """Whether the sides of the open surfaces determine the side of surface k.

        All combinations of sides of the open surfaces are examined, and the combination
        of all their levels, at which laws may hold the motion. The result is false

        - if, for one combination, the expression of k is at a level with the rate 0
          (unless it is constant there, or k is parallel to an open surface);
        - if it is at the same level, with a rate of the same sign, for all
          combinations: then the side of k does not depend on the open surfaces.
        """
        modes, arc = self.modes, self.modes.arc
        self.levels.pop(k, None)
        found = set()
        for corner in [*self._corners(), (LEVEL,) * len(self.open)]:
            self._settle(corner)
            modes.write()
            value = float(modes.values(arc.t, arc.y)[k])
            level, sign = self._level(k, value), 0.0
            if level is not None:
                self.levels[k] = level
                rows = modes.rows()
                sign = float(np.sign(self._rate(rows, k)))
                if not (sign or modes.is_constant_around(k) or self._parallel(rows, k)):
                    return False
            found.add((level, sign))
        # With one level and one rate, its side does not depend on the open surfaces.
        return len(found) > 1 or next(iter(found))[1] == 0.0

    def _corners(self) -> list[tuple[int, ...]]:
        """Return the combinations of open surfaces' sides at which rates are compared.

        Each is a tuple of BELOW or ABOVE, one per open surface; where many surfaces are
        open, only all lower and all upper sides.
        """
        count, sides = len(self.open), (BELOW, ABOVE)
        if count > FEW_CORNERS:
            return [(side,) * count for side in sides]
        return list(product(sides, repeat=count))

    def _parallel(self, rows: Rows, k: int) -> tuple[int, float] | None:
        """Return an open surface with gradient parallel to that of surface k, or None.

        The result is (j, factor): the number j of that surface, and the gradient of
        surface k divided by the gradient of surface j.

        rows : the rows of all surfaces.
        """
        J, b = rows.J, rows.b
        for j in self.open:
            if j == k or self.modes.on_rates[j] != self.modes.on_rates[k]:
                continue
            factor = multiple_of(J[j], J[k])
            if factor and abs(b[k] - factor * b[j]) <= COMPUTED_ZERO * abs(b[k]):
                return j, factor
        return None

    def _settle(self, corner: Sequence[int]) -> set[int]:
        """Store given sides of open surfaces, and the sides that follow from these.

        Loose and hanging surfaces are set to the sides of their expressions' values. So
        is an open surface whose expression leaves its level because of the sides of
        other open surfaces.

        Parameters
        ----------
        corner : sequence of int
            Side of each open surface.

        Returns
        -------
        set of int
            Surfaces whose expressions do not determine their side, because they stay at
            their level, or step together with an open surface.
        """
        modes, arc = self.modes, self.modes.arc
        for k, side in zip(self.open, corner, strict=True):
            modes.set_mode(k, self.levels[k], side)
        free = set()
        for k in sorted([*self.loose, *self.hanging], key=modes.order.index):
            modes.write()
            value = float(modes.values(arc.t, arc.y)[k])
            level = self._level(k, value)
            if level is None:
                modes.set_by_value(k, value)
                continue
            rows = modes.rows()
            if k in self.open:
                modes.set_mode(k, level, corner[self.open.index(k)])
                if modes.is_constant_around(k) or self._parallel(rows, k):
                    free.add(k)
                continue
            rate = self._rate(rows, k)
            if rate != 0.0:
                modes.set_mode(k, level, ABOVE if rate > 0.0 else BELOW)
                continue
            free.add(k)
            found = None if modes.is_constant_around(k) else self._parallel(rows, k)
            if found is not None:
                leader, factor = found
                side = corner[self.open.index(leader)]
                turned = factor < 0.0 and side != LEVEL
                modes.set_mode(k, level, 1 - side if turned else side)
            elif modes.is_constant_around(k):
                modes.set_mode(k, level, LEVEL)
        modes.write()
        return free

    def _by_forces(self, now: list[int]) -> bool:
        """Select the modes of the open surfaces by the forces on each side.

        Return whether modes satisfy the conditions.

        now : the present side of each open surface, kept where no solution is found.
        """
        cone = self._cone()
        # The surface just reached starts from its side, not from rest at its level,
        # unless constraints hold the motion there, and rounding has reached it.
        still = [
            i for i, k in enumerate(self.open) if k != self.hit or k in self.resting
        ]
        found = cone.select(now, still)
        if self.beside is not None and cone.modes is not None:
            self._store_laws(cone.modes)
            self.shared = self.laws, cone.modes, self.held
        if found is None and self.at_rest:  # the motion spirals into its rest
            found = [SLIDING] * len(now)
        if found is None or cone.is_fork:
            self.undecided = self.open
        before = self.modes.value.copy(), self.modes.kind.copy()
        self._store_modes(found or now, cone.shares)
        if found is not None and cone.resting is not None:
            self._select_rest(cone.resting, *before)
        return found is not None

    def _select_rest(self, rest: SideSolution, value: Floats, kind: Floats) -> None:
        """Select rest at levels in place of the modes found, if output columns change.

        At rest a switch has its value at the level; sliding, a combination of both
        sides. The motion is equal, but columns that contain the switch differ. If
        all columns agree, or are undefined at the levels, the modes found are restored.

        Parameters
        ----------
        rest : SideSolution
            The modes of the open surfaces, at rest at their levels.
        value, kind : ndarray, shape (K,)
            The sides and modes of all surfaces before the open ones were decided.
        """
        modes, arc = self.modes, self.modes.arc
        modes.write()
        shown = arc.observed()
        sides, kinds = modes.value.copy(), modes.kind.copy()
        carried, watched = modes.carried, modes.watched
        held = np.flatnonzero(modes.holds).tolist()
        modes.carried, modes.watched = {}, []
        modes.restore(value, kind)
        self._store_modes(rest.mode, rest.w)
        modes.write()
        found = arc.observed()
        # Rows of equalities may be dependent at the level: their solution is nan.
        undefined = bool((np.isnan(found) & ~np.isnan(shown)).any())
        if undefined or np.array_equal(found, shown, equal_nan=True):
            modes.carried, modes.watched = carried, watched
            modes.restore(sides, kinds)
            return
        self.rests = held
        if self.beside is not None:
            self._store_laws(rest.modes)
            self.shared = self.laws, rest.modes, self.held

    def _leaves(self, w: Floats, i: int, chosen: RowModes) -> int | None:
        """Return the side to which short steps leave an open surface: BELOW or ABOVE.

        None where the motion stays on the surface.

        Parameters
        ----------
        w : ndarray, shape (k,)
            Shares of the open surfaces.
        i : int
            Index of the surface among the open ones.
        chosen : RowModes
            Modes of all rows, the rows of the laws first.
        """
        modes = self.modes
        along = (w > BELOW) & (w < ABOVE)
        along[i] = False
        if not along.any():
            self._share(w)
        else:  # shares of followed surfaces change in time
            former = modes.value.copy(), modes.kind.copy()
            self._store_modes(np.where(along, SLIDING, w).astype(int).tolist(), w)
            modes.write()
        if self.beside is not None:
            self._store_laws(chosen)
        k = self.open[i]
        clear = CLEAR_OF_ROUNDING * RESIDUAL_ROUNDOFF * self.sizes[k]
        if (
            modes.arc.system.m
        ):  # rows may hold the motion, to the rounding of their forces
            clear = max(clear, modes.drifts()[k])
        way = modes.leads({k: clear})[k]
        if along.any():
            modes.carried, modes.watched = {}, []
            modes.restore(*former)
            modes.write()
        return None if way == 0.0 else (ABOVE if way > 0.0 else BELOW)

    def _store_modes(self, sides: Sequence[int], shares: Floats) -> None:
        """Store the modes of open surfaces, and of the surfaces carried along.

        Loose and hanging surfaces are carried by open surfaces that the motion follows.

        Parameters
        ----------
        sides : sequence of int
            Mode of each open surface.
        shares : ndarray, shape (k,)
            Share of each open surface.
        """
        modes = self.modes
        base = [BELOW if side in (SLIDING, REDUNDANT) else side for side in sides]
        below = self._settle(base)
        low, kind = modes.value.copy(), modes.kind.copy()
        along = [i for i, side in enumerate(sides) if side in (SLIDING, REDUNDANT)]
        followed = [self.open[i] for i in along]
        beside_open = [*self.loose, *(k for k in self.hanging if k not in followed)]
        carried = {}
        for i in along:
            above = self._settle([*base[:i], ABOVE, *base[i + 1 :]])
            for k in beside_open:
                steps = modes.value[k] != low[k]
                beside = k in self.levels or self._depends(k, self.open[i])
                if steps or (beside and k not in carried):
                    ends = k not in below, k not in above
                    carried[k] = Carried(self.open[i], float(modes.value[k]), *ends)
        modes.restore(low, kind)
        for k, each in carried.items():
            modes.carry(k, each)
        for i in along:
            k = self.open[i]
            modes.set_mode(k, self.levels[k], sides[i], float(shares[i]))
        for k, side, share in zip(self.open, sides, shares, strict=True):
            if side == LEVEL == share:
                modes.watched.append(k)
        self._rest_if_constant(below.intersection(beside_open).difference(carried))

    def _depends(self, k: int, leader: int) -> bool:
        """Whether the expression of surface k depends on the side of `leader`."""
        own = self.modes.depends[k]
        others = own.intersection([*self.loose, *self.hanging])
        return leader in own or any(self._depends(j, leader) for j in others)

    def _cone(self) -> FilippovCone:
        """Return the Filippov cone of the open surfaces, with the laws that could act.

        Open surfaces are those whose sides the forces decide.
        """
        modes, arc = self.modes, self.modes.arc

        def terms(corner: Sequence[int], y: Floats) -> tuple[Floats, ...]:
            self._settle(corner)
            rows, others = modes.rows(y), np.zeros(0)
            if self.beside is None:
                a = modes.accelerations(y)
            else:  # without the laws
                here = self._here(y)
                a, own = here.free[arc.state.driven], here.accelerations[self.laws]
                others = np.append(own, here.of_released)
            J, b = rows.J[self.open], rows.b[self.open]
            if whole.any():
                # The slope of a table's cell number differs from cell to cell.
                size = np.max(np.abs(J), axis=1, initial=0.0)
                known = whole & (size > 0.0)
                scale = np.divide(lengths, size, out=np.ones(len(J)), where=known)
                J, b = J * scale[:, None], b * scale
            return J, b, a, others

        whole = modes.whole[self.open]
        lengths = np.max(np.abs(modes.rows().J[self.open]), axis=1, initial=0.0)

        def rates_of(J: Floats, b: Floats, a: Floats, others: Floats) -> Floats:
            # An undefined rate counts as 0.
            found = np.append(J @ a - b, others)
            return np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0)

        def rates(corner: Sequence[int], y: Floats = arc.y) -> Floats:
            return rates_of(*terms(corner, y))

        scale, least = np.zeros((2, len(self.open)))
        reach = REACH * self.left * np.abs(modes.rates(arc.t, arc.y))
        for corner in self._corners():
            J, b, a, others = terms(corner, arc.y)
            scale = np.fmax(scale, np.abs(J) @ np.abs(a) + np.abs(b))
            here = rates_of(J, b, a, others)
            for aside in modes.nearby_states(reach):
                change = np.abs(rates(corner, aside) - here)[: len(scale)]
                least = np.fmax(least, change)
        self.roundoff[self.open] = least
        cone = FilippovCone(rates, scale, self._leaves, self._ahead, roundoff=least)
        if self.beside is not None and self.laws:
            cone.laws = cache(partial(self._acting, self.beside.left))
            cone.kinks = self.kinks
        return cone

    def _store_laws(self, found: RowModes) -> None:
        """Store modes of the laws, so that the next evaluations include their forces.

        found : the modes of rows, the rows of the laws first.
        """
        here = Kinematics(self.modes.arc, self.modes.arc.y, held=self.held)
        write_modes(here.arc, Chosen.of(here, self.laws, found, self.held))

    def _acting(self, left: Mapping[int, int], corner: Sequence[int]) -> Beside:
        """Return the laws that could act at a corner, then the released equalities.

        Parameters
        ----------
        left : mapping of int to int
            How often each law has reached the limit of its multiplier at this time.
        corner : sequence of int
            Side of each open surface.
        """
        self._settle(corner)
        here = self._here()
        laws = here.acting(self.laws, left)
        J = self.modes.rows().J[self.open, : self.modes.arc.system.n]
        if not self.kinks:
            return Beside(laws, J @ laws.response)
        equalities = here.shape.equalities[self.released]
        rows, free = (
            np.vstack([here.rows[self.laws], equalities]),
            here.free[here.levels[1]],
        )
        r, found = len(rows), here.delassus_of(np.vstack([rows, J]))
        closed = laws.closed.with_equalities(found.D[:r, :r])
        closed = replace(closed, factor=found.factor[:, :r], pushes=None)
        none = np.zeros(len(equalities))
        rounding = SUM_ROUNDOFF * np.abs(equalities) @ np.abs(free)
        response, across = found.response[:, :r], found.response[:, r:]
        acting = Acting(
            closed, np.append(laws.rates, none), np.append(laws.roundoff, rounding),
            np.append(laws.slow, none), np.append(laws.left, none.astype(int)),
            response,
        )  # fmt: skip
        return Beside(acting, J @ response, rows, free, J, across)

    def _share(self, w: Floats) -> None:
        """Combine the sides of open surfaces by shares w (k,) of their upper sides.

        w = LEVEL leaves a surface at its level. Sides that depend on the open surfaces
        are set first, with w rounded.
        """
        self._settle(np.round(w).astype(int).tolist())
        for k, share in zip(self.open, w.tolist(), strict=True):
            if share not in (BELOW, ABOVE, LEVEL):
                self.modes.set_mode(k, self.levels[k], REDUNDANT, share)
        self.modes.write()

    def _ahead(self, w: Floats, p: Floats) -> tuple[float, Floats]:
        """Return a short time, and the derivatives of all rates (k + r,) by time.

        The derivatives are difference quotients over that time: the rates of the k open
        surfaces, then the accelerations of the r laws.

        Parameters
        ----------
        w : ndarray, shape (k,)
            Shares of the open surfaces.
        p : ndarray, shape (r,)
            Multipliers of the laws, then of the released equalities.
        """
        modes, arc, moment = self.modes, self.modes.arc, self.modes.arc.short_time
        self._share(w)
        if self.beside is None:
            forced = partial(modes.forced, combined=True)
            y = arc.y + moment * arc.rates(arc.t, arc.y)
            change = forced(y, arc.t + moment) - forced(arc.y)
            return moment, np.asarray(change)[self.open] / moment

        def others(here: Kinematics, forced: Floats) -> Floats:
            a, rows = here.free[arc.state.driven].copy(), modes.rows(here.y, here.t)
            a[: arc.system.n] += forced
            return np.asarray(rows.J @ a - rows.b)[self.open]

        here, r = Kinematics(arc, arc.y, held=self.held), len(self.laws)
        change = ahead_of(here, self.laws, others)(p[:r])[0]
        return moment, np.append(change, np.zeros(len(p) - r))
