"""Equations with a chosen side of each surface of positions, for rests in corners.

Forces step, and rows of equalities turn, at surfaces u(q, s) = level: the kink of
`abs(x)`, the knots of a linear table, the condition of `if`. Beside a surface one side
acts. At rest on a surface both sides act together, with shares that add up to 1
(A. F. Filippov, Differential Equations with Discontinuous Righthand Sides, 1988,
section 4): the force is (1 - w) f_low + w f_high, and the row of an equality that is
continuous at the surface is (1 - w) A_low + w A_high. The share w of the upper side is
then one more unknown, and u = level one more relation. The body stays there if w lies
between 0 and 1 and the step of the forces drives u towards its level.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.point import Point, gradient_of
from lagsim.admissibility.verdict import CAUTION, accelerations, verdicts_on
from lagsim.language.derivatives import slopes
from lagsim.language.functions import CHOOSING, STEPS
from lagsim.mechanics.constraints import Drag, constraint_row
from lagsim.mechanics.switch_search import model_switches
from lagsim.mechanics.switches import mixed
from lagsim.tolerances import RESIDUAL_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations

# Begins the names of rows that hold a state on a surface; in no name of a file.
CORNER = "corner#"
# Operations with sides, of which relations of positions may have corners.
SIDED = frozenset(("abs", "if", "table.piece", *CHOOSING, *STEPS))
# Shares within this distance outside of [0, 1] count as 0 or 1.
ROUNDED = 1e-9
# Halvings of the way on which a surface is located, to order surfaces.
BISECTIONS = 20


class Pin(NamedTuple):
    """Level of a surface on which a state is held, and the share of its upper side.

    Attributes
    ----------
    level : float
        0, or the whole number at which `floor` steps.
    share : int
        The node of the share: a variable while it is unknown, else a number.
    """

    level: float
    share: int


class Step(Enum):
    """Direction in which the forces of both sides of a surface drive a state.

    TOWARDS the surface, AWAY from it, or NONE: the forces do not differ.
    """

    TOWARDS, NONE, AWAY = range(3)


class KinkCrossing(NamedTuple):
    """Surface that a path from one state to another meets first.

    Attributes
    ----------
    side : int
        The index of the surface in the list of switches.
    level : float
    part : float
        The fraction of the path up to the surface.
    """

    side: int
    level: float
    part: float


class Kinks:
    """Surfaces of positions and first-order states at which the equations step.

    Parameters
    ----------
    e : Equations

    Attributes
    ----------
    sides : dict of int to Side
        The surfaces that depend on no velocity, by their index among all switches.
    """

    def __init__(self, e: Equations) -> None:
        self.e, self.g = e, e.graph
        switches = model_switches(e)
        self.sides = {
            k: side
            for k, side in enumerate(switches.sides)
            if self._is_of_positions(side.node)
        }
        self._switches = switches.among(self.sides)
        nodes = self._switches.freeze([x.node for x in self.sides.values()])
        self.surfaces = dict(zip(self.sides, nodes, strict=True))

    def _is_of_positions(self, node: int) -> bool:
        e = self.e
        fast = {*e.velocities, *e.accelerations, *e.multipliers}
        return fast.isdisjoint(self.g.depends([node]))

    @property
    def positions(self) -> list[int]:
        """Node of u - level for each surface, in the order of `sides`.

        If a surface has a level at each whole number, the level is the next one below
        u.
        """
        return [
            self.g.call("sub", x.node, self.g.call("floor", x.node))
            if x.whole
            else x.node
            for x in self.sides.values()
        ]

    def share(self, k: int) -> str:
        """Return the name of the variable for the share of surface k's upper side."""
        return f"share.{k}"

    def ends(self, k: int, level: float) -> tuple[float, float]:
        """Return the values of surface k's mode variable below and above a level."""
        return (level - 1.0, level) if self.sides[k].whole else (-1.0, 1.0)

    def frozen(
        self, sides: Mapping[int, float], pins: Mapping[int, Pin]
    ) -> Callable[[Sequence[int]], list[int]]:
        """Return a function from nodes to nodes without switches at the given surfaces.

        At a surface in `sides` a node has the branch of the given side. At a surface in
        `pins` it is the mean of both branches, weighted by the share of the upper side.

        Parameters
        ----------
        sides : mapping of int to float
            The values of the mode variables of surfaces, by index.
        pins : mapping of int to Pin
            Surfaces on which the state is held, by index.
        """
        g = self.g
        variable = {k: g.variable(x.variable) for k, x in self.sides.items()}
        fixed = {variable[k]: g.constant(x) for k, x in sides.items() if k not in pins}

        def of(nodes: Sequence[int]) -> list[int]:
            found = g.substitute(self._switches.freeze(nodes), fixed)
            for k, pin in pins.items():
                low, high = (
                    g.substitute(found, {variable[k]: g.constant(x)})
                    for x in self.ends(k, pin.level)
                )
                found = [
                    a if a == b else mixed(g, pin.share, a, b)
                    for a, b in zip(low, high, strict=True)
                ]
            return found

        return of

    def rows(
        self,
        rows: Iterable[Row],
        sides: Mapping[int, float],
        pins: Mapping[int, Pin],
    ) -> list[Row]:
        """Return rows with each surface on a fixed side, or held at its level.

        sides, pins : see `frozen`.
        """
        rows, e, of = list(rows), self.e, self.frozen(sides, pins)
        nodes = of([x.residual for x in rows])
        found = [
            x if x.residual == node else constraint_row(self.g, x.name, node, e.flow)
            for x, node in zip(rows, nodes, strict=True)
        ]
        for k, row in enumerate(rows):
            if row.drags:
                slips = self.rows([x.slip for x in row.drags], sides, pins)
                parts = of([x.part for x in row.drags])
                drags = tuple(map(Drag, slips, parts))
                found[k] = found[k]._replace(drags=drags)
        return found

    def on(self, sides: Mapping[int, float], pins: Mapping[int, Pin]) -> Equations:
        """Return the equations with each surface on a fixed side, or held at its level.

        sides, pins : see `frozen`.
        """
        e, of = self.e, self.frozen(sides, pins)
        rates = of([x.rate for x in e.states])
        bounds = of([x.bound for x in e.laws]), of([x.static for x in e.laws])
        laws = zip(
            e.laws,
            self.rows((x.row for x in e.laws), sides, pins),
            *bounds,
            strict=True,
        )
        return replace(
            e,
            f=tuple(of(e.f)),
            rows=tuple(self.rows(e.rows, sides, pins)),
            states=tuple(
                x._replace(rate=rate) for x, rate in zip(e.states, rates, strict=True)
            ),
            laws=tuple(
                law._replace(row=row, bound=bound, static=static)
                for law, row, bound, static in laws
            ),
            energy=of([e.energy])[0],
        )

    def distance(self, k: int, level: float, sides: Mapping[int, float]) -> int:
        """Return the node u - level of surface k, other surfaces on fixed sides.

        sides : the values of the mode variables of surfaces, by index.
        """
        g = self.g
        fixed = {
            g.variable(self.sides[i].variable): g.constant(x) for i, x in sides.items()
        }
        (u,) = g.substitute([self.surfaces[k]], fixed)
        return g.call("sub", u, g.constant(level)) if level else u

    # Sides of a state

    def at(self, point: Point) -> tuple[dict[int, float], dict[int, float]]:
        """Return the side of each surface at a state, and the levels the state is on.

        Both are mappings by the index of the surface. A surface whose expression has
        the value of its level on an interval has no side: its mode variable is 0, or
        lies between two whole numbers.
        """
        nodes = [x.node for x in self.sides.values()]
        values, errors = point.array(nodes), CAUTION * point.rounding(nodes)
        sides, levels = {}, dict[int, float]()
        pairs = zip(self.sides.items(), values.tolist(), errors.tolist(), strict=True)
        for (k, side), u, error in pairs:
            level = float(np.rint(u)) if side.whole else 0.0
            if abs(u - level) > error:
                sides[k] = float(np.floor(u) if side.whole else np.sign(u))
                continue
            sides[k] = level - 0.5 if side.whole else 0.0
            levels[k] = level
        flat = [k for k in levels if not self._moves(k, sides)]
        for k in flat:
            del levels[k]
        for k, level in levels.items():
            sides[k] = self.ends(k, level)[1]
        return sides, levels

    def _moves(self, k: int, sides: Mapping[int, float]) -> bool:
        e = self.e
        names = {*e.q, *(x.name for x in e.states)}
        return not names.isdisjoint(self.g.depends([self.distance(k, 0.0, sides)]))

    def first_crossing(
        self,
        points: tuple[Point, Point],
        sides: Mapping[int, float],
        pinned: Mapping[int, float],
        *,
        beyond: bool,
    ) -> KinkCrossing | None:
        """Return the first surface that a straight path crosses, or None.

        Parameters
        ----------
        points : tuple of Point
            The ends of the path.
        sides : mapping of int to float
            The sides of the start of the path, by the index of a surface: -1 or 1, or a
            whole number.
        pinned : mapping of int to float
            Surfaces that are left out, with their levels.
        beyond : bool
            Whether the path continues beyond its end; surfaces are then expanded
            linearly from its start.
        """
        start, end = points
        among = [k for k in self.sides if k not in pinned]
        nodes = [self.distance(k, 0.0, sides) for k in among]
        u, there = start.array(nodes), end.array(nodes)
        slopes = self._along(nodes, start, end) if beyond else there - u
        errors = CAUTION * end.rounding(nodes)
        found = None
        for i, k in enumerate(among):
            change, side = float(slopes[i]), self.sides[k]
            if side.whole:
                level = sides[k] + (change > 0.0)
            elif change * sides[k] < 0.0:
                level = 0.0
            else:
                continue
            if not change or not np.isfinite(u[i] + change):
                continue
            part = max((level - float(u[i])) / change, 0.0)
            if not beyond and part > 1.0 + float(errors[i]) / abs(change):
                continue
            if not beyond and 0.0 < part < 1.0:
                part = _root(nodes[i], level, start, end)
            if found is None or part < found.part:
                found = KinkCrossing(k, level, part)
        return found

    def _along(self, nodes: Sequence[int], start: Point, end: Point) -> Floats:
        """Return the derivatives of nodes along the straight path between two states.

        The derivatives are taken at `start`, by the fraction of the path.
        """
        g, e = self.g, self.e
        names = [*e.q, *(x.name for x in e.states)]
        displacement = np.concatenate([end.q - start.q, end.state.s - start.state.s])
        change = {
            g.variable(x): d for x, d in zip(names, displacement.tolist(), strict=True)
        }
        found = []
        for node in nodes:
            own = slopes(g, node, frozenset(change))
            values = start.array([*own.values()])
            found.append(float(values @ [change[x] for x in own]))
        return np.array(found)

    # Whether a rest lasts

    def steps(
        self,
        point: Point,
        sides: Mapping[int, float],
        pins: Mapping[int, Pin],
        active: Sequence[Row],
    ) -> dict[int, Step]:
        """Return, for each pinned surface, the direction of the forces on both sides.

        The direction is TOWARDS the surface, AWAY from it, or NONE if the forces on
        both sides are equal. It is AWAY as well if an equality jumps at the surface,
        since no rest is then possible on it.

        Parameters
        ----------
        point : Point
            A state at rest, with values of the shares.
        sides, pins : mapping
            See `frozen`.
        active : sequence of Row
            Rows in force beside the equalities.
        """
        found = {}
        for k, pin in pins.items():
            ends, jumps = [], False
            for share in (self.g.zero, self.g.one):
                there = self.with_rows(
                    point, active, sides, {**pins, k: Pin(pin.level, share)}
                )
                jumps |= not all(x.satisfied for x in verdicts_on(there))
                ends.append(self._away(there, k, sides))
            (low, size), (high, other) = ends
            small = RESIDUAL_ROUNDOFF * max(size, other)
            found[k] = Step.TOWARDS if high - low < -small else Step.NONE
            if jumps or high - low > small:
                found[k] = Step.AWAY
        return found

    def with_rows(
        self,
        point: Point,
        active: Iterable[Row],
        sides: Mapping[int, float],
        pins: Mapping[int, Pin],
    ) -> Point:
        """Return `point` with the equations of the given sides, and more rows in force.

        active : the rows that are added to the rows in force.
        sides, pins : see `frozen`.
        """
        e, more = self.on(sides, pins), self.rows(active, sides, pins)
        return point.of(replace(e, rows=(*e.rows, *more)))

    def _away(
        self, point: Point, k: int, sides: Mapping[int, float]
    ) -> tuple[float, float]:
        """Return d^2 u/dt^2 of surface k's expression u, and the sum of its |terms|.

        If u depends on first-order states, du/dt is returned in place of d^2 u/dt^2.

        sides : see `frozen`.
        """
        u, e, g = self.distance(k, 0.0, sides), point.e, self.g
        places = {g.variable(x.name): x.rate for x in e.states}
        by_states = slopes(g, u, frozenset(places))
        if by_states:
            parts = [g.call("mul", a, places[x]) for x, a in by_states.items()]
            terms = point.array(parts)
            return float(np.sum(terms)), float(np.sum(np.abs(terms)))
        J = np.zeros(point.n)
        for j, node in gradient_of(point, u).items():
            J[j] = point.array([node])[0]
        a, terms, _ = accelerations(point)
        return float(J @ a), float(np.abs(J) @ terms)

    def row(self, k: int, level: float, sides: Mapping[int, float]) -> Row:
        """Return the constraint row u = level, which holds a state on surface k.

        sides : see `frozen`.
        """
        name = f"{CORNER}{k}"
        node = self.distance(k, level, sides)
        return constraint_row(self.g, name, node, self.e.flow)


def _root(node: int, level: float, start: Point, end: Point) -> float:
    """Return the fraction of the straight path at which a node has the value `level`.

    The fraction is computed by bisection.

    start, end : the ends of the path.
    """

    def off(part: float) -> float:
        q = start.q + part * (end.q - start.q)
        s = start.state.s + part * (end.state.s - start.state.s)
        return float(start.at(q, s=s).array([node])[0]) - level

    low, high, first = 0.0, 1.0, off(0.0)
    for _ in range(BISECTIONS):
        part = 0.5 * (low + high)
        low, high = (part, high) if off(part) * first > 0.0 else (low, part)
    return 0.5 * (low + high)


def on_leaving_sides(point: Point, unknown: Collection[int]) -> Equations:
    """Return equations in which equalities at a corner are on the side of the motion.

    At the corner of a wire, y = k*abs(x), the derivative of the relation belongs to
    neither side; the velocities lead onto one side, whose row they satisfy. If they
    lead along a corner, or if that is not known, all equations are as written.

    unknown : indices of velocities that are not known.
    """
    e = point.e
    kinked = {e.graph.ops[n] for n in e.graph.cone([x.residual for x in e.rows])}
    if kinked.isdisjoint(SIDED):
        return e
    kinks = Kinks(e)
    sides, levels = kinks.at(point)
    for k, level in levels.items():
        across = kinks.row(k, level, sides)
        nodes = [across.rate]
        (rate,), (error,) = point.array(nodes), CAUTION * point.rounding(nodes)
        if abs(rate) <= error or not across.A.entries.keys().isdisjoint(unknown):
            return e
        sides[k] = kinks.ends(k, level)[int(rate > 0.0)]
    rows = tuple(kinks.rows(e.rows, sides, {})) if levels else e.rows
    return e if rows == e.rows else replace(e, rows=rows)


def drift(point: Point, rows: Sequence[Row]) -> tuple[Floats, Floats]:
    """Return accelerations (n,) and rates of first-order states (s,) at a point.

    Accelerations within rounding are 0.

    rows : further rows in force, beside the rows of the point's equations.
    """
    e = replace(point.e, rows=(*point.e.rows, *rows))
    a, terms, _ = accelerations(point.of(e))
    a[np.abs(a) <= RESIDUAL_ROUNDOFF * terms] = 0.0
    return a, point.array([x.rate for x in e.states])
