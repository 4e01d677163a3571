"""Modes of the switching surfaces, at an instant and in an arc."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.tables import last_level
from lagsim.methods.parts import parameters as kept
from lagsim.program.functions import may_cancel, on_rates
from lagsim.tolerances import (
    RESIDUAL_ROUNDOFF,
    SOLUTION_ROUNDOFF,
    SUM_ROUNDOFF,
    TINY,
    VALUE_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.surfaces import Side
    from lagsim.run.arc import Arc


BELOW, ABOVE, SLIDING = 0, 1, 2
LEVEL = 3  # on its level, which is no boundary here: the expression is constant
REDUNDANT = 4  # on its level because other surfaces are: its share is constant
KINDS = {SLIDING: kept.FOLLOWED, LEVEL: kept.LEVEL, REDUNDANT: kept.REDUNDANT_SIDE}
# First step of `leads` in parts of the run.
FIRST = 2.0**-44
# Number of directions in which a state is changed to compute the effect of rounding.
DIRECTIONS = 3
# Change of a state, relative to its ranges, from which constancy is tested.
ASIDE = 1e-3
# Parts of this change at which the rounding of a constant expression is sampled: a few
# values may be exact by chance.
PARTS = (1.0, 0.83, 0.61, 0.47, 0.31, 0.19)
# Parts of this change far from the state: a polynomial is not constant there.
FAR = (0.331, -0.173)
# Operations whose value is constant everywhere if it is constant around one state: it
# does not saturate or underflow, and has no pieces but those of frozen switches.
ANALYTIC = frozenset(
    ("add", "sub", "mul", "div", "neg", "pow", "sqrt", "cbrt", "sin", "cos", "if")
)
# Parts of the time left at which the rounding of forces is sampled.
LATER = (0.01, 0.13, 0.47, 0.83)


class Rows(NamedTuple):
    """The linear relations of K surfaces at a state, J (q'', s') = b for sliding.

    Attributes
    ----------
    residuals, rates : ndarray, shape (K,)
        The residuals of the surfaces, and their rates.
    b : ndarray, shape (K,)
        The right-hand sides of J (q'', s') = b.
    scales : ndarray, shape (K,)
        The magnitude of the terms of each expression.
    J : ndarray, shape (K, n + l)
        The Jacobian rows of q'' (n,) and of the rates s' (l,) of first order.
    """

    residuals: Floats
    rates: Floats
    b: Floats
    scales: Floats
    J: Floats


class Carried(NamedTuple):
    """A carried surface: its side depends on that of a followed surface, its leader.

    Attributes
    ----------
    leader
        The index of the leader.
    high
        The side of the carried surface on the upper side of the leader.
    ends_below, ends_above
        Whether the expression of the carried surface can leave its side, below and
        above the leader. It cannot where it is at its level because the leader is.
    """

    leader: int
    high: float
    ends_below: bool = False
    ends_above: bool = False


class Selected(NamedTuple):
    """Data on the selected modes of K surfaces that are not in the kernels' memory.

    Attributes
    ----------
    levels : ndarray, shape (K,)
        The level at which each surface was put.
    carried : mapping of int to Carried
        The carried surfaces.
    watched : tuple of int
        The surfaces whose mode ends off their level.
    """

    levels: Floats
    carried: Mapping[int, Carried]
    watched: tuple[int, ...]


class SurfaceModes:
    """The modes of the switching surfaces of a run, at an instant.

    `begin` reads the modes from the memory of the arc, and `write` writes them there,
    within a selection (`run.modes`).

    Attributes
    ----------
    arc : Arc
        The arc that `begin` was called with.
    value : ndarray, shape (K,)
        The side of each surface: -1 or 1, or the integer below the expression of a
        floor; while sliding, that of the lower side. A value between the sides where
        the expression stays at its level.
    slides : ndarray of bool, shape (K,)
        Whether the motion follows each surface.
    depends : list of set of int
        For each surface, the surfaces on whose sides its expression depends.
    may_cancel : list of bool
        Whether the expression of each surface depends on other sides or on branches of
        t, on one of which its terms may cancel.
    lasting : list of bool
        Whether an expression that is constant around a state is constant in the arc.
    may_be_kept : list of bool
        Whether the motion may stay at the level of each surface by itself: the surface
        has no influence on forces on its coordinates, and no force changes but there.
    continued : bool
        Whether `write` continues tables beyond their ends by the first and last cell.
        A table that ends the run has no values there, with which the forces on both
        sides of its end could be compared: a body may rest at the end, held by a wall.
    """

    def __init__(self, arc: Arc) -> None:
        system = arc.system
        self.sides: tuple[Side, ...] = system.switches.sides
        self.count = len(self.sides)
        self.whole = np.array([s.whole for s in self.sides])
        self.shown = np.array([s.shown for s in self.sides], dtype=bool)
        self.has_whole = bool(self.whole.any())
        self.heights = np.where(self.whole, 1.0, 2.0)
        g = arc.equations.graph
        self._last = [
            last_level(g, s.node) if s.whole else math.inf for s in self.sides
        ]
        # The first and the last cell of a table that ends the run beyond its points.
        last = np.array(self._last)
        self._cells = np.where(last < math.inf, 0.0, -math.inf), last - 1.0
        self._has_ends = bool(np.any(last < math.inf))
        self.continued = False
        self.is_corner = np.zeros(self.count, dtype=bool)
        self.is_corner[[*system.switches.corners]] = True
        self.on_rates = np.array(on_rates(arc.equations, system.switches), dtype=bool)
        numbers = {s.variable: k for k, s in enumerate(self.sides)}
        nodes = system.switches.freeze([s.node for s in self.sides])
        self.depends = [
            {numbers[name] for name in g.depends([node]) & numbers.keys()}
            for node in nodes
        ]
        self.may_cancel = may_cancel(system.switches)
        moving = g.dependent(nodes, (*arc.equations.state, "t"))
        self.lasting = [
            all(g.ops[m] in ANALYTIC for m in g.cone([n]) if m in moving and g.args[m])
            for n in nodes
        ]
        self.may_be_kept = self._may_be_kept(arc, nodes)
        order = self._ordered()
        self.order = [k for k in order if not self.shown[k]]
        self.shown_order = [k for k in order if self.shown[k]]
        self.nested = any(self.depends[k] for k in self.order)
        self.shown_nested = any(self.depends[k] for k in self.shown_order)
        self.begin(arc)

    def begin(self, arc: Arc, selected: Selected | None = None) -> None:
        """Read the modes from the memory of the arc.

        selected : the parts of the modes that the memory lacks, if modes have been
            selected at this instant; else no surface is carried or watched.
        """
        self.arc, p = arc, arc.system.p
        self.kind = p.slides.copy()
        # Before the first selection all surfaces count as on their upper sides.
        none = (p.least == p.most) & (self.kind == 0.0)
        self.value = np.where(none, 1.0, p.side)
        if self.kind.any():
            mixed = (self.kind == kept.REDUNDANT_SIDE) & ~self.is_corner
            self.value[mixed] += (p.part_above * (p.high - p.low))[mixed]
        self.levels = np.zeros(self.count)
        self.carried: dict[int, Carried] = {}
        self.watched: list[int] = []  # surfaces whose mode ends off their level
        if selected is not None:
            self.levels[:] = selected.levels
            self.carried, self.watched = {**selected.carried}, [*selected.watched]

    def selected(self) -> Selected:
        """Return the parts of the modes that are not in the memory of the arc."""
        return Selected(self.levels.copy(), {**self.carried}, (*self.watched,))

    def _ordered(self) -> list[int]:
        """Return the indices of the surfaces, each after all on which it depends."""
        found: list[int] = []
        left = list(range(self.count))
        while left:
            ready = [k for k in left if self.depends[k] <= {*found, k}] or left[:1]
            found += ready
            left = [k for k in left if k not in ready]
        return found

    @property
    def slides(self) -> Flags:
        """Mask (K,) of the surfaces that the motion follows."""
        return np.asarray(self.kind == kept.FOLLOWED)

    @property
    def holds(self) -> Flags:
        """Mask (K,) of the surfaces whose modes keep the motion on them.

        They are followed or redundant. Surfaces at whose level constraints keep the
        motion: see `constrained`.
        """
        return np.asarray(self.slides | (self.kind == kept.REDUNDANT_SIDE))

    @property
    def bound(self) -> Floats:
        """Mask (K,) of surfaces whose side their expression's value does not decide.

        Such surfaces are followed, at rest at their level, or carried.
        """
        return np.asarray((self.kind != 0.0) & (self.kind != kept.CHOSEN))

    @property
    def p(self) -> kept.Parameters:
        """The parameters (memory) from which compiled functions read the modes."""
        return self.arc.system.p

    def store(self, **numbers: Floats) -> None:
        """Store arrays (K,) in the parameters p, by the names of their fields.

        Further elements of these fields, which belong to laws and `until`, stay
        unchanged.
        """
        for name, each in numbers.items():
            getattr(self.p, name)[: self.count] = each

    def restore(self, value: Floats, kind: Floats) -> None:
        """Restore `value` (K,) and `kind` (K,), the codes of the modes, from copies."""
        self.value[:], self.kind[:] = value, kind

    def _parts(self, value: Floats) -> tuple[Floats, Floats]:
        """Return the share of its upper side (K,), and the side (K,), of each surface.

        A share is the position of `value` between the lower (0) and the upper side (1).
        A redundant surface has its lower side, except at a corner of an equality, where
        the result is `value`.

        value : (K,), as the attribute; for redundant surfaces between both sides.
        """
        low = np.where(self.whole, np.floor(value), -1.0)
        part = (value - low) / self.heights
        if not self.kind.any():
            return part, value
        mixed = (self.kind == kept.REDUNDANT_SIDE) & ~self.is_corner
        return part, np.where(mixed, low, value)

    def forget(self) -> None:
        """Set the surfaces of the motion to be neither followed, carried nor watched.

        They are the surfaces on whose sides the motion depends, not only output.
        """
        self.kind[self.order] = 0.0
        self.carried = {}
        self.watched = []

    def set_mode(self, k: int, level: float, mode: int, share: float = 0.5) -> None:
        """Set the mode of surface k: a side, sliding along its level, or rest at it.

        level : the level of the surface.
        mode : BELOW, ABOVE, SLIDING, LEVEL or REDUNDANT.
        share : the share w of the upper side in the value at LEVEL and for REDUNDANT.
            At a table's last point it is 0 at LEVEL, as the table has a value there.
        """
        share = 0.0 if mode == LEVEL and level == self._last[k] else share
        below, above = (level - 1.0, level) if self.whole[k] else (-1.0, 1.0)
        self.levels[k] = level
        self.kind[k] = KINDS.get(mode, 0.0)
        between = below + share * (above - below)
        values = {ABOVE: above, LEVEL: between, REDUNDANT: between}
        self.value[k] = values.get(mode, below)

    def way(self, k: int, level: float) -> float:
        """Return 1 where surface k is on the upper side of `level`, else -1."""
        above = self.value[k] >= level if self.whole[k] else self.value[k] > 0.0
        return 1.0 if above else -1.0

    def set_by_value(self, k: int, value: float) -> None:
        """Set the side of surface k by the value of its expression, off its levels."""
        self.kind[k] = 0.0
        sign = 1.0 if value > 0.0 else -1.0
        self.value[k] = math.floor(value) if self.whole[k] else sign

    def carry(self, k: int, carried: Carried) -> None:
        """Set surface k to be carried along by its leader, a followed surface."""
        self.kind[k] = kept.CARRIED
        self.carried[k] = carried

    def level(self, k: int, value: float) -> float:
        """Return the level of surface k that is closest to `value`."""
        return float(np.round(value)) if self.whole[k] else 0.0

    def off_levels(self) -> Floats:
        """Return the distances (K,) of expressions now from their closest levels."""
        values = self.values(self.arc.t, self.arc.y)
        return np.abs(values - np.where(self.whole, np.round(values), 0.0))

    def write(self) -> None:
        """Write the modes to the parameters of the compiled functions."""
        p, free = self.p, self.shown.copy()
        p.part_above[:], value = self._parts(self.value)
        p.side[:] = value
        p.slides[:] = self.kind
        p.high[:] = np.where(self.whole, value + 1.0, 1.0)
        p.leader[:] = p.ends_above = p.sliding = 0.0
        least, most = self.ends(value)
        if self.kind.any():
            free |= self.bound
            p.sliding = float(np.count_nonzero(self.holds))
            bent = self.is_corner & (self.kind == kept.REDUNDANT_SIDE)
            p.high[bent] = value[bent]
        p.low[:] = np.where(self.whole | free, value, -1.0)
        for k, carried in self.carried.items():
            p.leader[k] = carried.leader + 1
            p.high[k] = carried.high
            free[k] = not carried.ends_below
            p.ends_above += carried.ends_above
        if p.ends_above:
            p.least_above[:], p.most_above[:] = self.ends(p.high)
            fixed = [k for k, x in self.carried.items() if not x.ends_above]
            p.least_above[fixed], p.most_above[fixed] = -math.inf, math.inf
        least[free], most[free] = -math.inf, math.inf
        if self.watched:
            least[self.watched] = most[self.watched] = self.levels[self.watched]
        if p.sliding:
            slides = self.slides
            least[slides] = np.where(self.on_rates, 0.0, self.levels)[slides]
            most[slides] = np.where(self.on_rates, self.levels, 0.0)[slides]
        p.least[:] = least
        p.most[:] = most
        if self.continued and self._has_ends:
            for sides in (p.side, p.low, p.high):
                sides[:] = np.clip(sides, *self._cells)

    def write_shown(self, k: int) -> None:
        """Write the mode of shown surface k alone to the parameters.

        No other mode depends on it.
        """
        p, value, level, whole = self.p, self.value[k], self.levels[k], self.whole[k]
        at_level = self.kind[k] == kept.LEVEL
        p.slides[k] = self.kind[k]
        p.side[k] = p.low[k] = value
        p.high[k] = value + 1.0 if whole else 1.0
        p.part_above[k] = value - math.floor(value) if whole else (value + 1.0) / 2.0
        p.departed[k] = level
        p.least[k] = level if at_level else -math.inf
        p.most[k] = level if at_level else math.inf

    def ends(self, sides: Floats) -> tuple[Floats, Floats]:
        """Return the least and the largest value (K,) of each expression on its side.

        sides : ndarray, shape (K,), as in `value`.
        """
        up, whole = sides > 0.0, self.whole
        least, most = np.where(up, 0.0, -math.inf), np.where(up, math.inf, 0.0)
        if self.has_whole:
            least = np.where(whole, sides, least)
            most = np.where(whole, sides + 1.0, most)
        return least, most

    def rows(self, y: Floats | None = None, t: float | None = None) -> Rows:
        """Return the rows of the surfaces at y (size,) and t; by default now."""
        arc = self.arc
        y, t = arc.y if y is None else y, arc.t if t is None else t
        (residuals, rates, b, scales), J = arc.surface_rows(t, y)
        return Rows(residuals, rates, b, scales, J)

    def is_constant_around(self, k: int, here: Rows | None = None) -> bool:
        """Whether surface k's expression is constant at nearby states and later on.

        On one side of each other switch, the expression may be constant but for the
        rounding of its terms, and so are its slopes: `x + min(0.1*y - x, 0)` where the
        minimum is not 0. See `may_cancel`.

        here : the rows of the surfaces at the state reached, if they are known.
        """
        here = self.rows() if here is None else here
        if self.may_cancel[k]:
            return self._is_constant_to_rounding(k)
        if here.b[k] != 0.0 or np.any(here.J[k]):
            return False
        there = self.rows(*self.displaced())
        if self.on_rates[k]:
            still = abs(here.rates[k] - there.rates[k]) <= RESIDUAL_ROUNDOFF * abs(
                here.rates[k]
            )
        else:
            still = here.rates[k] == there.rates[k] == 0.0
        constant = here.b[k] == there.b[k] == 0.0
        return bool(still and constant and not np.any(there.J[k]))

    def _is_constant_to_rounding(self, k: int) -> bool:
        """Whether surface k's expression has one value, to rounding, at several states.

        A state far off counts only if the expression has a value there.
        """
        here = float(self.values(self.arc.t, self.arc.y)[k])
        for part in (*PARTS, *FAR):
            far = part in FAR
            y, t = self.displaced(part, far=far)
            value = float(self.values(t, y)[k])
            if value == here or (far and math.isnan(value)):
                continue
            scale = float(self.rows(y, t).scales[k])
            if not abs(value - here) <= RESIDUAL_ROUNDOFF * scale:
                return False
        return True

    def _may_be_kept(self, arc: Arc, nodes: list[int]) -> list[bool]:
        """Return `may_be_kept`; nodes : the expressions, with sides frozen."""
        e, g, switches = arc.equations, arc.equations.graph, arc.system.switches
        if e.laws or e.rows or not nodes:
            return [False] * self.count
        forces = switches.freeze(e.of_accelerations)
        moving = g.dependent(forces, (*e.state, "t"))
        if any(g.ops[m] not in ANALYTIC for m in moving if g.args[m]):
            return [False] * self.count
        terms = zip(e.q, e.velocities, switches.freeze(e.f), strict=True)
        acting = [({q, v}, g.depends([f])) for q, v, f in terms]
        found = []
        for side, node, lasting in zip(self.sides, nodes, self.lasting, strict=True):
            own = g.depends([node])
            free = not any(
                side.variable in by for names, by in acting if not names.isdisjoint(own)
            )
            found.append(lasting and free and not side.shown)
        return found

    def is_kept(self, k: int, level: float) -> bool:
        """Whether the motion stays at the level of surface k, whatever rounding says.

        The rate of the expression is 0. Its second derivative is 0 on both sides, to
        rounding, at this state and at others at which value and rate are 0. (Case:
        `y - 3*x`, where x' = 0.1 and y' = 0.3.)
        """
        if not self.may_be_kept[k]:
            return False
        former, kept_level = (self.value.copy(), self.kind.copy()), self.levels[k]
        found = True
        for side in (BELOW, ABOVE):
            self.set_mode(k, level, side)
            self.write()
            found = found and self._is_unforced(k, self.arc.y, self.arc.t)
            for part in FAR:
                if found:
                    y, t = self.displaced(part, far=True)
                    self._put_on(k, level, y, t)
                    found = self._is_unforced(k, y, t)
        self.restore(*former)
        self.levels[k] = kept_level
        self.write()
        return found

    def _is_unforced(self, k: int, y: Floats, t: float) -> bool:
        """Whether the derivative of the rate of surface k is 0 to rounding."""
        arc, rows = self.arc, self.rows(y, t)
        J, a, v = np.abs(rows.J[k]), self.accelerations(y, t), y[arc.state.driven]
        bounds = arc.runner.function("rounding")(t, y)[: arc.system.n]
        rounding = SOLUTION_ROUNDOFF * (J @ np.abs(a) + abs(rows.b[k]))
        rounding += VALUE_ROUNDOFF * (J[: arc.system.n] @ np.abs(bounds))
        speed = float(rows.rates[k])
        terms = J @ np.abs(v) + abs(speed - float(rows.J[k] @ v))
        still = self.on_rates[k] or abs(speed) <= SUM_ROUNDOFF * terms
        return bool(still and abs(rows.J[k] @ a - rows.b[k]) <= rounding)

    def _put_on(self, k: int, level: float, y: Floats, t: float) -> None:
        """Put the state y (size,), in place, on surface k at rate 0: a Newton step."""
        arc, n = self.arc, self.arc.system.n
        rows = self.rows(y, t)
        J = rows.J[k]
        if self.on_rates[k]:
            y[arc.state.driven] -= (rows.rates[k] - level) * J / max(J @ J, TINY)
            return
        off = (rows.residuals[k] - level) * J / max(J @ J, TINY)
        y[arc.state.positions] -= off[:n]
        y[arc.state.first_order] -= off[n:]
        rows = self.rows(y, t)
        J = rows.J[k]
        y[arc.state.driven] -= rows.rates[k] * J / max(J @ J, TINY)

    def roundoff_around(self, k: int) -> float:
        """Return the roundoff of an expression that is constant around the state.

        The expression is that of surface k. The result is the largest distance of the
        expression from its level at nearby states: `phi - (abs(phi + b) - abs(phi -
        b))/2` is 0 exactly at phi = 0, and 1e-17 beside it; `max(t - 1, 0)^3` is 0
        exactly.
        """
        values = [self.values(t, y)[k] for y, t in map(self.displaced, PARTS)]
        return float(np.max(np.abs(np.array(values) - self.levels[k])))

    def displaced(
        self, part: float = 1.0, *, far: bool = False
    ) -> tuple[Floats, float]:
        """Return a nearby state y (size,) and a later time, as a test point.

        part : factor of the distance from the present state and time.
        far : whether the distance is of the size of the ranges, at least 1.
        """
        arc, magnitudes, reach = self.arc, self.arc.magnitudes, self.arc.ranges
        reach = np.where(
            reach > 0.0,
            np.maximum(reach, RESIDUAL_ROUNDOFF**0.5 * magnitudes),
            magnitudes,
        )
        aside, parts = ASIDE, ASIDE + ASIDE**2 * np.arange(len(magnitudes))
        if far:
            aside, parts = 1.0, np.linspace(1.0, 2.0, len(magnitudes))
            reach = np.maximum(reach, 1.0)  # a body in a corner has a range of 1e-17
        shift = parts * np.where(reach > 0.0, reach, 1.0)
        later = arc.t + part * aside * (arc.settings.end - arc.t)
        return arc.y + part * shift, later

    def leads(self, clear: Mapping[int, float]) -> Floats:
        """Return how far short steps lead surfaces away from their levels (K,), or 0.

        The steps grow until the expression of each surface differs from its level by
        more than its value in `clear`; 0 if it does not, and for all other surfaces.

        clear : by index, the distances of the surfaces that are examined.
        """
        arc, least = self.arc, np.full(self.count, math.inf)
        least[[*clear]] = [*clear.values()]
        step = np.array([FIRST * arc.settings.duration])
        given = self.levels, least, step
        (found,) = arc.runner.at_levels("departures", 1, arc.t, arc.y, *given)
        return np.asarray(found)

    def deciding_rates(self) -> Floats:
        """Return the results (4, K) of the kernel `departures.deciding_rates` now."""
        arc = self.arc
        given = self.on_rates, arc.magnitudes, arc.ranges
        return arc.runner.at_levels("deciding_rates", 4, arc.t, arc.y, *given)

    def term_sizes(self, y: Floats | None = None) -> Floats:
        """Return magnitudes of terms, sums of slopes, and values (3, K) at y (size,).

        They are the results of the kernel `departures.term_sizes`.

        y : by default the state reached.
        """
        arc = self.arc
        given = self.on_rates, arc.magnitudes
        y = arc.y if y is None else y
        return arc.runner.at_levels("term_sizes", 3, arc.t, y, *given)

    def decisive(self) -> Floats:
        """Mark surfaces on whose sides the rest of another surface depends, shape (K,).

        The result is 1 for such a surface, else 0.

        The expression of a surface at rest at its level may depend on the side of
        another surface: beside a knot of a linear table, the expression `abs(table(q))`
        may leave the value 0 that it has at the knot.
        """
        found = np.zeros(self.count)
        for k in np.flatnonzero(self.kind == kept.LEVEL).tolist():
            found[list(self.depends[k])] = 1.0
        return found

    def constrained(self) -> dict[int, float]:
        """Return, by index, the surfaces at whose level constraints keep the motion.

        The value of each is a bound: the largest distance from its level that rounding
        causes in the duration of the run. The rates of these surfaces are rounding on
        both sides, at other states and at later times. Unlike the surfaces of `holds`
        they need no mode.
        """
        arc, span = self.arc, self.arc.settings.duration
        if not arc.system.m:
            return {}
        values = self.values(arc.t, arc.y)
        levels = [self.level(k, value) for k, value in enumerate(values)]
        off = np.abs(values - levels)
        off = np.where(self.on_rates, off, span * np.abs(self.rows().rates) + off)
        most = np.where(self.on_rates, span, span * span)
        most *= self._roundoff_of_rates(arc.y)
        found = (off <= most) & ~self.shown
        if not found.any():
            return {}
        later = arc.t + ASIDE * span
        former = self.value.copy(), self.kind.copy()
        # Surfaces at rest at their levels have values between those of their sides.
        part = np.where(self.whole, self.value % 1.0, np.abs(self.value) - 1.0)
        between = part != 0.0
        for side in (BELOW, ABOVE):
            for k in np.flatnonzero(found | between).tolist():
                self.set_mode(k, levels[k], side)
            self.write()
            # The rate of a surface may depend on the sides of others.
            moved = np.where(self.on_rates, 0.0, span * np.abs(self.rows().rates))
            found &= moved <= most
            aside = self._nearby_state(later)
            for t, y in ((arc.t, arc.y), (arc.t, aside), (later, aside)):
                found &= self._roundoff_of_rates(y, t) >= 0.0
        self.restore(*former)
        self.write()
        return {k: float(most[k]) for k in np.flatnonzero(found).tolist()}

    def drifts(self) -> Floats:
        """Return bounds (K,) of the changes of expressions by the rounding of forces.

        The rounding of an acceleration acts for the duration of the run: if laws hold
        the motion at rest, all positions and velocities so far may be 0, and have no
        rounding of their own. Forces that are 0 now may grow with t and the motion.
        """
        arc, n, span = self.arc, self.arc.system.n, self.arc.settings.duration
        rounding, left = arc.runner.function("rounding"), arc.settings.end - arc.t
        moved = self._nearby_state(arc.settings.end)
        states = [(arc.t, arc.y)]
        states += [(arc.t + part * left, moved) for part in LATER]
        found = (np.abs(rounding(t, y)[:n]) for t, y in states)
        bounds = np.max([np.where(np.isfinite(x), x, 0.0) for x in found], axis=0)
        reach = np.zeros(len(arc.y))
        reach[arc.velocities] = span * VALUE_ROUNDOFF * bounds
        reach[arc.state.positions] = span * reach[arc.velocities]
        return self._largest_changes_within(reach)

    def changes(self, time: float) -> Floats:
        """Return the largest changes (K,) of the surfaces' expressions in a short time.

        The changes are computed from the present rates and from the terms of the
        forces. `time` is the length of that time.
        """
        arc, n = self.arc, self.arc.system.n
        reach = time * np.nan_to_num(np.abs(self.rates(arc.t, arc.y)))
        reach[arc.velocities] += time * arc.state.parts[:n]
        reach[arc.state.positions] += time * reach[arc.velocities]
        here = self.values(arc.t, arc.y)
        found = np.abs(self.values(arc.t + time, arc.y) - here)
        return np.fmax(found, self._largest_changes_within(reach))

    def _largest_changes_within(self, reach: Floats) -> Floats:
        """Return bounds (K,) of the changes of expressions at states within a distance.

        The states of `nearby_states` change several components in proportion, and the
        effects on an expression may cancel; the magnitudes of slopes do not.

        reach : the distance in each component (size,).
        """
        found = self.changes_by_slopes(self.rows(), reach)
        return np.fmax(found, self._largest_changes(self.nearby_states(reach)))

    def changes_by_slopes(self, rows: Rows, reach: Floats) -> Floats:
        """Return bounds (K,) of the changes of expressions by their slopes.

        rows : the rows of the surfaces.
        reach : the change of each component (size,).
        """
        arc, slopes = self.arc, np.abs(rows.J)
        moved = reach[arc.state.driven].copy()
        moved[: arc.system.n] = reach[arc.state.positions]
        levels = (slopes @ x for x in (reach[arc.state.driven], moved))
        return np.asarray(np.where(self.on_rates, *levels))

    def _largest_changes(self, states: Iterable[Floats]) -> Floats:
        """Return the largest changes (K,) of the expressions at nearby states.

        states : the states (size,).
        """
        arc, found = self.arc, np.zeros(self.count)
        here = self.values(arc.t, arc.y)
        for state in states:
            found = np.fmax(found, np.abs(self.values(arc.t, state) - here))
        return np.asarray(found)

    def _nearby_state(self, t: float) -> Floats:
        """Return a state (size,) slightly off the state reached, in every component.

        Each component is changed by a part of its range so far. A component with the
        range 0, as at the start of a run, is changed by its expected motion up to time
        t; the computation is iterated, since components at rest are set in motion by
        others, or by forces that begin at 0.
        """
        arc, state = self.arc, self.arc.state
        parts = ASIDE + ASIDE**2 * np.arange(len(arc.y))
        reach, time = arc.ranges, t - arc.t
        for _ in range(len(arc.y)):
            rates = np.abs(self.rates(t, arc.y + parts * reach))
            displacement = time * np.where(np.isfinite(rates), rates, 0.0)
            displacement[state.positions] += time * displacement[state.velocities]
            if not np.any(displacement[reach == 0.0]):
                break
            reach = np.where(reach == 0.0, displacement, reach)
        return np.asarray(arc.y + parts * reach)

    def _roundoff_of_rates(self, y: Floats, t: float | None = None) -> Floats:
        """Return bounds (K,) of rounding in d/dt of the surfaces' rates at y and t.

        -1 where such a derivative exceeds its bound, so that it is not rounding alone.
        """
        arc, rates = self.arc, self.forced(y, t)
        now = arc.t if t is None else t
        bounds = arc.runner.function("rounding")(now, y)[: arc.system.n]
        slopes = np.abs(self.rows(y, t).J[:, : arc.system.n])
        roundoff = VALUE_ROUNDOFF * (slopes @ np.abs(bounds))
        return np.where(np.abs(rates) <= roundoff, roundoff, -1.0)

    def values(self, t: float, y: Floats) -> Floats:
        """Return the expressions of the surfaces (K,) at t and y (size,)."""
        return self.arc.runner.function("surfaces", self.count)(t, y)

    def rates(self, t: float, y: Floats) -> Floats:
        """Return y' (size,) at t and y (size,), on the sides that were last written."""
        return self.arc.field(t, y)

    def accelerations(self, y: Floats, t: float | None = None) -> Floats:
        """Return q'' and s' (n + l,) at y and t, on the sides that were last written.

        t : the time, by default the present time.
        """
        rates = self.rates(self.arc.t if t is None else t, y)
        return rates[self.arc.state.driven]

    def forced(
        self, y: Floats, t: float | None = None, *, combined: bool = False
    ) -> Floats:
        """Return J (q'', s') - b (K,) of the surfaces at y and t (default: now).

        combined : whether the accelerations of both sides are combined on surfaces with
            shares, see `Arc.rates`.
        """
        rows, a = self.rows(y, t), self.accelerations(y, t)
        if combined:
            a = self.arc.rates(self.arc.t if t is None else t, y)[self.arc.state.driven]
        return np.asarray(rows.J @ a - rows.b)

    def sizes(self, y: Floats | None = None) -> Floats:
        """Return the magnitude of each surface's terms (K,), at the sizes so far.

        Equalities transmit the rounding of one coordinate to others: on a rod
        u - x = 1e5 the coordinate x has the rounding of 1e5, however small it is.

        y : the state (size,) of the terms, by default the state reached.
        """
        return self.including_rows(self.term_sizes(y)[0])

    def including_rows(self, sizes: Floats) -> Floats:
        """Return the magnitudes (K,) `sizes`, increased by the rounding along rows."""
        if not self.arc.system.m:
            return sizes
        moved = self._largest_changes(self._nearby_admissible_states())
        return np.asarray(np.fmax(sizes, moved / RESIDUAL_ROUNDOFF))

    def _nearby_admissible_states(self) -> list[Floats]:
        """Return nearby states (size,) that satisfy the rows in force to rounding.

        Each state is the state reached plus the difference of two Newton steps onto the
        rows, from a state of `nearby_states` and from the state reached.
        """
        arc = self.arc
        if not arc.system.m:
            return []
        here, found = self._step(arc.y), []
        for state in self.nearby_states():
            state[arc.state.positions] += self._step(state) - here
            found.append(state)
        return found

    def sizes_along_rows(self) -> Floats:
        """Return magnitudes (size,), including rounding along rows in force.

        A row gives a coordinate the rounding of other coordinates, however small its
        own value is, as y at the kink of y = abs(x - 1e5).
        """
        found = self.arc.magnitudes
        for aside in self._nearby_admissible_states():
            off = np.abs(aside - self.arc.y)
            found = np.fmax(found, off / RESIDUAL_ROUNDOFF)
        return found

    def _step(self, y: Floats) -> Floats:
        """Return the Newton step (n,) of the positions in y (size,) onto the rows."""
        arc = self.arc
        step = arc.runner.function("position_step")
        return step(arc.t, y)[: arc.system.n].copy()

    def along_rows(self, change: Floats) -> Floats:
        """Return a small change (n + l,) of q and s, projected along the rows in force.

        change : shape (n + l,).
        """
        arc, n = self.arc, self.arc.system.n
        if not arc.system.m:
            return change
        state, change = arc.y.copy(), change.copy()
        state[arc.state.positions] += change[:n]
        change[:n] += self._step(state) - self._step(arc.y)
        return change

    def nearby_states(self, reach: Floats | float = 0.0) -> Iterator[Floats]:
        """Yield states (size,) close to the state reached, to test its neighbourhood.

        Each component is changed by its rounding plus `reach`, a number or an array
        (size,).
        """
        step = RESIDUAL_ROUNDOFF * self.arc.magnitudes + reach
        i = np.arange(len(step))
        for k in range(DIRECTIONS):
            yield self.arc.y + np.where(i >> k & 1, -step, step)
