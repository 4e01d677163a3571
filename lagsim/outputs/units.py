"""Units: of all columns of a table, of what pictures show, of forces and energies.

A file gives units to coordinates, parameters and definitions. What follows from these
by sums, products and powers has a unit, too. A parameter without a unit is a number
where all energies and forces agree with that. Where a factor may stand for a quantity,
or two terms differ, there is no unit. All who show units ask here.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, TypeAlias

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import once
from lagsim.mechanics.equations import ACTION
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

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

# A part of something that is written in so many hundredths is no conversion of units.
LEAST_PART = 0.02

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
    `texts` are units as they are written, which sums and numbers in front keep.
    """

    def __init__(
        self,
        graph: Graph,
        given: Mapping[int, Unit],
        texts: Mapping[int, str] | None = None,
        numbers: Iterable[int] = (),
    ) -> None:
        self.graph = graph
        self.known: dict[int, Unit | None] = dict(given)
        self.free: set[int] = set()
        self.texts = dict(texts or {})
        self.known |= {node: PURE for node in numbers if node not in self.known}

    def of(self, node: int) -> Unit | None:
        """Give the unit of a node, None where none follows."""
        graph = self.graph
        if node not in self.known:
            cone = graph.cone([node], self.known)
            if len(cone) > MOST_NODES:
                self.known[node] = None
                return None
            for k in cone:
                if k not in self.known:
                    self.known[k] = self._made(k)
        return None if node in self.free else self.known[node]

    def text(self, node: int) -> str:
        """Give the unit of a node as it is written; "" where none follows."""
        unit = self.of(node)
        return "" if node in self.free else self.texts.get(node) or written(unit)

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
            self._keep(node, self._scaled(op, args))
            return times(one, other, 1.0 if op == "mul" else -1.0)
        if op == "pow":
            return self._powered(*args)
        if op in _SAME:
            self._keep(node, args)
            return known[args[0]]
        if op in _ALIKE or op == "if":
            self._keep(node, args[-2:])
            return self._agreed(args[-2:])
        if op in _ROOTS:
            base = known[args[0]]
            return None if base is None else times(PURE, base, _ROOTS[op])
        return PURE  # of sines and logarithms, and of conditions

    def _keep(self, node: int, parts: Iterable[int]) -> None:
        """Write the unit of a node as that of its parts, where they have one text."""
        texts = {self.texts.get(k, "") for k in parts if k not in self.free}
        if len(texts) == 1 and (text := texts.pop()):
            self.texts[node] = text

    def _scaled(self, op: str, args: Sequence[int]) -> Sequence[int]:
        """Give the factor whose unit a product has, the other being a number."""
        one, other = args
        if self.known[other] == PURE and not self.texts.get(other):
            return (one,)
        pure = self.known[one] == PURE and not self.texts.get(one)
        return (other,) if pure and op == "mul" else ()

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
    """Tell whether a number in a product is none that stands for a quantity."""
    size, hundredths = abs(value), abs(value) * 100.0
    return (
        any(value * k % 1 == 0.0 and size * k <= SMALL for k in range(1, SMALL + 1))
        or any(size == k * math.pi for k in (0.25, 0.5, 1.0, 2.0, 4.0))
        or (LEAST_PART <= size < 1.0 and abs(hundredths - round(hundredths)) < 1e-9)
    )


def stated_units(equations: Equations, columns: Iterable[str]) -> dict[str, str]:
    """Give the unit of each column as the file has it; "" where it has none."""
    model = equations.model
    found = {"t": "s"}
    for c in model.coordinates:
        if c.unit:
            found[c.name] = c.unit
            found[f"{c.name}_dot"] = f"{c.unit}/s"
            found[f"{c.name}_ddot"] = found[f"gauss.a_{c.name}"] = f"{c.unit}/s^2"
    found |= {d.name: d.unit for d in model.definitions if d.unit}
    return {name: found.get(name, "") for name in columns}


def units(equations: Equations, columns: Sequence[str]) -> dict[str, str]:
    """Give the unit of each of these columns, and of what pictures show besides.

    Those that have none are left out.
    """
    key = ("units", equations.model.sha256, tuple(equations.q), tuple(columns))
    return once(equations.graph, key, lambda: _units(equations, columns))


def of_table(equations: Equations, columns: Sequence[str]) -> dict[str, str]:
    """Give the unit of each column of the table, "" where none is known or follows."""
    found = units(equations, columns)
    return {name: found.get(name, "") for name in columns}


def _units(equations: Equations, columns: Sequence[str]) -> dict[str, str]:
    model, graph = equations.model, equations.graph
    rates = [*equations.q, *equations.velocities, *equations.accelerations]
    stated = stated_units(equations, dict.fromkeys((*columns, *rates, "t")))
    named = {p.name: p.unit for p in model.parameters} | stated
    nodes = {graph.variable(name): text for name, text in named.items()}
    nodes |= {d.node: d.unit for d in model.definitions if d.unit}
    texts = {k: text for k, text in nodes.items() if text and graph.value(k) is None}
    given = {k: unit for k, text in texts.items() if (unit := parsed(text)) is not None}
    found = {name: text for name, text in stated.items() if text and name in columns}
    dimensions, energy = _consistent(equations, given, texts)
    if energy:
        for name in ENERGIES:
            _follow(dimensions, found, name, energy, ("J",))
        for name, unit in _forces(equations, dimensions, energy):
            _follow(dimensions, found, name, unit, _FORCES)
        _follow(dimensions, found, ACTION, times(energy, {"s": 1.0}), ("J s",))
        _follow(dimensions, found, "gauss.G", times(energy, {"s": -2.0}), ("J/s^2",))
        for one in model.forces:
            along = dimensions.of(one.direction)
            if along == PURE and dimensions.of(one.node) == energy:
                dimensions.texts.setdefault(one.node, "N m")
    for name, node in _shown(equations):
        text = dimensions.text(node)
        if text:
            found.setdefault(name, text)
    return {name: text for name, text in found.items() if text}


def _follow(
    dimensions: Dimensions,
    found: dict[str, str],
    name: str,
    unit: Unit,
    names: Iterable[str],
) -> None:
    """Give a column a unit, where it has none, and what is made of it."""
    text = written(unit, names)
    found.setdefault(name, text)
    node = dimensions.graph.variable(name)
    if dimensions.known.get(node) is None:
        dimensions.known[node] = unit
        dimensions.texts[node] = text


def _consistent(
    equations: Equations, given: Mapping[int, Unit], texts: Mapping[int, str]
) -> tuple[Dimensions, Unit]:
    """Give the units of nodes, and that of all energies; none where these disagree.

    Parameters without units are numbers, unless an energy or a force speaks against it.
    """
    model, graph = equations.model, equations.graph
    bare = {
        graph.variable(p.name): p.name
        for p in model.parameters
        if not p.unit and not p.follows
    }
    while True:
        dimensions = Dimensions(graph, given, texts, bare)
        energy = _energy(equations, dimensions)
        wanted: list[tuple[int, Unit]] = []
        if energy:
            for one in model.forces:
                along = dimensions.of(one.direction)
                if along is not None:
                    wanted.append((one.node, _per(energy, along, one.level)))
            if model.dissipation is not None:
                wanted.append((model.dissipation, times(energy, {"s": -1.0})))
        wrong = [] if energy else _energies(equations)
        for node, unit in wanted:
            wrong += _against(dimensions, node, unit)
        doubtful = graph.depends(wrong) if wrong else frozenset()
        left = {node: name for node, name in bare.items() if name not in doubtful}
        if len(left) == len(bare):
            return dimensions, energy
        bare = left


def _against(dimensions: Dimensions, node: int, wanted: Unit) -> list[int]:
    """Give the terms of a sum that have another unit than the one wanted."""
    graph, below, terms = dimensions.graph, [node], list[int]()
    while below:
        k = below.pop()
        if graph.ops[k] in ("add", "sub", "neg"):
            below += graph.args[k]
        elif dimensions.of(k) not in (None, wanted):
            terms.append(k)
    return terms


def _per(energy: Unit, along: Unit, level: Level) -> Unit:
    """Give the unit of a force that works on something; on a rate, it is a power's."""
    force = times(energy, along, -1.0)
    return force if level is Level.POSITION else times(force, {"s": 1.0}, -1.0)


def _energies(equations: Equations) -> list[int]:
    model = equations.model
    found = (model.kinetic, model.potential, model.lagrangian)
    return [node for node in found if node is not None]


def _energy(equations: Equations, dimensions: Dimensions) -> Unit:
    """Give the one unit of all energies that have one."""
    known = [u for node in _energies(equations) if (u := dimensions.of(node))]
    # Without a mass, what is called an energy is that of one that has no unit.
    if not known or any(set(unit) <= MOTION for unit in known):
        return PURE
    return known[0] if all(unit == known[0] for unit in known) else PURE


def _shown(equations: Equations) -> Iterator[tuple[str, int]]:
    """Give name and expression of columns that no rule names, and of what is drawn."""
    for d in equations.model.definitions:
        yield d.name, d.node
    rows = [*equations.rows, *(law.row for law in equations.laws)]
    for row in rows:
        yield f"residual_{row.name}", row.residual
    for k, plot in enumerate(equations.model.output.plots):
        for name, curve in plot.curves(k).items():
            yield name, curve.node
    for name, parts in equations.model.scene.points.items():
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
