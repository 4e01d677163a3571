"""Units that follow: of energies, multipliers, forces and of what plots show.

A file gives units to coordinates, parameters and definitions. What follows from these
by sums, products and powers is told on axes. Where a factor has none, or two terms
differ, nothing is told: a number may stand for what has a unit that nobody wrote.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, TypeAlias

from lagsim.language.functions import OPERATIONS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations

# Powers of what is not taken apart any further: {"kg": 1, "m": 1, "s": -2}.
Unit: TypeAlias = dict[str, float]

PURE: Unit = {}
NEWTON: Unit = {"kg": 1.0, "m": 1.0, "s": -2.0}
JOULE: Unit = {"kg": 1.0, "m": 2.0, "s": -2.0}
_KNOWN: dict[str, Unit] = {
    "N": NEWTON,
    "J": JOULE,
    "W": {"kg": 1.0, "m": 2.0, "s": -3.0},
    "Pa": {"kg": 1.0, "m": -1.0, "s": -2.0},
    "Hz": {"s": -1.0},
    "C": {"A": 1.0, "s": 1.0},
    "V": {"kg": 1.0, "m": 2.0, "s": -3.0, "A": -1.0},
    "T": {"kg": 1.0, "s": -2.0, "A": -1.0},
    "rad": PURE,
    "1": PURE,
}
# What forces come as, beside the newton.
_FORCES = ("N", "N m", "N s", "N m s", "N/m", "J", "W")

ENERGIES = ("kinetic", "potential", "lagrangian", "energy", "work")
# What motion alone is measured in.
MOTION = {"m", "mm", "cm", "km", "s", "ms", "min", "h", "deg"}

_FACTOR = re.compile(r"\s*([*·/]?)\s*([^\W\d_]+|1)(?:\s*(?:\^|\*\*)\s*(-?\d+))?\s*")

# Expressions with more nodes than this cost more to look through than to draw.
MOST_NODES = 4000
# A number in a product is taken for no more than one if it is a fraction of such
# numbers; 9.8 may be metres per second squared.
SMALL = 12

_SAME = frozenset(("neg", "abs", "floor", "ceil"))
_ALIKE = frozenset(("add", "sub", "min", "max", "hypot"))
_ROOTS = {"sqrt": 0.5, "cbrt": 1.0 / 3.0}


def parsed(text: str) -> Unit | None:
    """Take a unit apart: `N s/m` into powers; None where it is none."""
    found: Unit = PURE
    at = 0
    while at < len(text):
        factor = _FACTOR.match(text, at)
        if factor is None:
            return None
        sign, symbol, power = factor.groups()
        exponent = float(power or 1) * (-1.0 if sign == "/" else 1.0)
        found = times(found, _KNOWN.get(symbol, {symbol: 1.0}), exponent)
        at = factor.end()
    return found if text.strip() else None


def times(one: Unit, other: Unit, power: float = 1.0) -> Unit:
    """Give one unit times a power of another."""
    found = dict(one)
    for symbol, exponent in other.items():
        found[symbol] = found.get(symbol, 0.0) + power * exponent
    return {symbol: e for symbol, e in found.items() if e}


def written(unit: Unit | None, names: Iterable[str] = ("N", "J", "W")) -> str:
    """Write a unit, by one of these names where one fits; "" for none."""
    if not unit:
        return ""
    for name in names:
        if parsed(name) == unit:
            return name
    if any(e % 1 for e in unit.values()):
        return ""
    over = " ".join(_power(s, e) for s, e in unit.items() if e > 0.0)
    under = "/".join(_power(s, -e) for s, e in unit.items() if e < 0.0)
    return (over or "1") + (f"/{under}" if under else "")


def _power(symbol: str, exponent: float) -> str:
    return symbol if exponent == 1.0 else f"{symbol}^{exponent:.0f}"


class Dimensions:
    """The units of the nodes of a graph, as far as they follow from some.

    A number fits everything in a sum: it is in `free`, and so is what is made of such.
    """

    def __init__(self, graph: Graph, given: Mapping[int, Unit]) -> None:
        self.graph = graph
        self.known: dict[int, Unit | None] = dict(given)
        self.free: set[int] = set()

    def of(self, node: int) -> Unit | None:
        """Give the unit of a node, None where none follows."""
        graph = self.graph
        cone = graph.cone([node], self.known)
        if len(cone) > MOST_NODES:
            return None
        for k in cone:
            if k not in self.known:
                self.known[k] = self._made(k)
        return None if node in self.free else self.known[node]

    def _made(self, node: int) -> Unit | None:
        graph, known = self.graph, self.known
        value = graph.value(node)
        if value is not None:
            self.free.add(node)
            return PURE if _is_pure(value) else None
        op, args = graph.ops[node], graph.args[node]
        if op not in OPERATIONS:  # a variable without a unit
            return None
        if all(a in self.free for a in args):
            self.free.add(node)
        if op in ("mul", "div"):
            one, other = known[args[0]], known[args[1]]
            if one is None or other is None:
                return None
            return times(one, other, 1.0 if op == "mul" else -1.0)
        if op == "pow":
            return self._powered(*args)
        if op in _SAME:
            return known[args[0]]
        if op in _ALIKE or op == "if":
            return self._agreed(args[-2:])
        if op in _ROOTS:
            base = known[args[0]]
            return None if base is None else times(PURE, base, _ROOTS[op])
        return PURE  # of sines and logarithms, and of conditions

    def _powered(self, base: int, exponent: int) -> Unit | None:
        unit, power = self.known[base], self.graph.value(exponent)
        if unit is None or not unit:
            return unit
        return None if power is None else times(PURE, unit, power)

    def _agreed(self, nodes: Iterable[int]) -> Unit | None:
        """Give the one unit of terms; a number has that of what it is added to."""
        units = [self.known[k] for k in nodes if k not in self.free]
        units = [unit for unit in units if unit is not None]
        return units[0] if units and all(u == units[0] for u in units) else None


def _is_pure(value: float) -> bool:
    return any(
        value * k % 1 == 0.0 and abs(value * k) <= SMALL for k in range(1, SMALL + 1)
    ) or any(abs(value) == k * 3.141592653589793 for k in (0.25, 0.5, 1.0, 2.0, 4.0))


def units(equations: Equations, told: Mapping[str, str]) -> dict[str, str]:
    """Give the unit of each column that pictures show, where it is known.

    Parameters
    ----------
    told : the units of the columns of the table, as run.json has them.
    """
    model, graph = equations.model, equations.graph
    named = {p.name: p.unit for p in model.parameters} | dict(told)
    nodes = {graph.variable(name): text for name, text in named.items()}
    nodes |= {d.node: d.unit for d in model.definitions if d.unit}
    texts = {k: text for k, text in nodes.items() if text and graph.value(k) is None}
    given = {k: unit for k, text in texts.items() if (unit := parsed(text)) is not None}
    dimensions = Dimensions(graph, given)
    found = {name: text for name, text in told.items() if text}
    energies = (model.kinetic, model.potential, model.lagrangian)
    known = [u for e in energies if e is not None and (u := dimensions.of(e))]
    # Without a mass, what is called an energy is that of one that is not told.
    known = [] if any(set(unit) <= MOTION for unit in known) else known
    if known and all(unit == known[0] for unit in known):
        follow = [(name, known[0]) for name in ENERGIES]
        follow += _forces(equations, dimensions, known[0])
        for name, unit in follow:
            text = written(unit, _FORCES if name not in ENERGIES else ("J",))
            found.setdefault(name, text)
            node = graph.variable(name)
            if dimensions.known.get(node) is None:
                dimensions.known[node] = unit
                texts[node] = text
    for name, node in _drawn(equations):
        follows = texts.get(node) or written(dimensions.of(node))
        if follows:
            found.setdefault(name, follows)
    return {name: text for name, text in found.items() if text}


def of_table(equations: Equations, told: Mapping[str, str]) -> dict[str, str]:
    """Give the unit of each column of the table, those that follow too."""
    found = units(equations, told)
    return {name: found.get(name, "") for name in told}


def _drawn(equations: Equations) -> Iterator[tuple[str, int]]:
    """Give name and expression of what pictures draw besides columns."""
    model = equations.model
    for k, plot in enumerate(model.output.plots):
        for name, curve in plot.curves(k).items():
            yield name, curve.node
    for name, parts in model.scene.points.items():
        for k, node in enumerate(parts, 1):
            yield f"point.{name}.{k}", node


def _forces(
    equations: Equations, dimensions: Dimensions, energy: Unit
) -> Iterator[tuple[str, Unit]]:
    """Give constraint forces, multipliers and reactions: they work on what is known."""
    for q in equations.q:
        along = dimensions.of(equations.graph.variable(q))
        if along is not None:
            yield f"Qc_{q}", times(energy, along, -1.0)
    defined = {d.name: d.node for d in equations.model.definitions}
    for name in equations.model.output.reactions:
        along = dimensions.of(defined[name])
        if along is not None:
            yield f"reaction.{name}", times(energy, along, -1.0)
    rows = {f"lambda_{row.name}": row for row in equations.rows}
    rows |= {law.multiplier: law.row for law in equations.laws}
    for name, row in rows.items():
        along = dimensions.of(row.residual)
        if along is None:
            continue
        force = times(energy, along, -1.0)
        if not row.holonomic:
            force = times(force, {"s": 1.0}, -1.0)
        yield name, force
        if name.startswith("lambda_"):
            impulse = name.replace("lambda_", "impulse.", 1)
            yield impulse, times(force, {"s": 1.0})
