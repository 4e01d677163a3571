"""Units of table columns, of quantities in pictures, of forces and energies.

A file states units of coordinates, parameters and definitions. Sums, products and
powers of quantities with units have units, too. A parameter without a unit is a pure
number if all energies and forces are consistent with that. If a factor may represent a
quantity, or two terms differ, the unit is unknown. All other modules get units here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.columns import (
    DEVIATION,
    IMPULSE,
    KINDS,
    MULTIPLIER,
    REACTION,
    RESIDUAL,
    SENSITIVITY,
    Owner,
    halves,
)
from lagsim.language.columns import parsed as parsed_column
from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import memoize
from lagsim.language.units import (
    PURE,
    Quantity,
    Unit,
    combined,
    is_pure,
    parsed,
    times,
    written,
)
from lagsim.mechanics.pieces import whole
from lagsim.model.model import Level
from lagsim.outputs import ENERGIES
from lagsim.program.output_row import stated_units

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lagsim.language.columns import ColumnKind
    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations

# Units of kinematic quantities.
MOTION = {"m", "mm", "cm", "km", "s", "ms", "min", "h", "deg"}

# Largest number of nodes of an expression whose unit is derived: with more, the
# derivation takes longer than the drawing.
MOST_NODES = 4000


class Dimensions:
    """The units of the nodes of a graph, as far as they follow from known units.

    Parameters
    ----------
    graph : Graph
    given : mapping of int to str
        Units of nodes, as in the file.
    numbers : iterable of int
        Nodes that are pure numbers.
    """

    def __init__(
        self, graph: Graph, given: Mapping[int, str], numbers: Iterable[int] = ()
    ) -> None:
        self.graph, self._texts = graph, given
        self.known = dict.fromkeys(numbers, Quantity(PURE))
        for node, text in given.items():
            if (unit := parsed(text)) is not None:
                self.known[node] = Quantity(unit, text)

    def of(self, node: int) -> Quantity:
        """Return the quantity of a node: its unit, unknown if it does not follow."""
        if node not in self.known:
            cone = self.graph.cone([node], self.known)
            if len(cone) > MOST_NODES:
                self.known[node] = Quantity()
                return self.known[node]
            for k in cone:
                if k not in self.known:
                    self.known[k] = self._computed(k)
        return self.known[node]

    def unit(self, node: int) -> Unit | None:
        """Return the unit of a node; None if it is unknown."""
        found = self.of(node)
        return None if found.free else found.unit

    def text(self, node: int) -> str:
        """Return the unit of a node as text; "" if it is unknown."""
        found = self.of(node)
        return "" if found.free else found.text or written(found.unit)

    def _computed(self, node: int) -> Quantity:
        graph = self.graph
        value = graph.value(node)
        if value is not None:
            return Quantity(PURE if is_pure(value) else None, free=True)
        given = self._texts.get(node, "")
        if graph.ops[node] not in OPERATIONS:  # a variable without a unit
            return Quantity(None, given)
        args = graph.args[node]
        parts = [self.known[a] for a in args]
        unit, text = combined(graph.ops[node], parts, graph.value(args[-1]))
        return Quantity(unit, given or text, all(part.free for part in parts))


def of_table(equations: Equations, columns: Sequence[str]) -> dict[str, str]:
    """Return the unit of each column of the table; "" if it is unknown."""
    found = units(equations, columns)
    return {name: found.get(name, "") for name in columns}


def units(equations: Equations, columns: Sequence[str]) -> dict[str, str]:
    """Return the known units of columns, and of other quantities in pictures, by name.

    Names without a known unit are omitted.
    """
    key = ("units", equations.model.sha256, tuple(equations.q), tuple(columns))
    return memoize(equations.graph, key, lambda: _units(equations, columns))


def _units(equations: Equations, columns: Sequence[str]) -> dict[str, str]:
    model, graph = equations.model, equations.graph
    rates = [*equations.state, *equations.accelerations]
    all_stated = stated_units(equations)
    stated = {name: all_stated.get(name, "") for name in (*columns, *rates, "t")}
    named = {p.name: p.unit for p in model.parameters} | stated
    nodes = {graph.variable(name): text for name, text in named.items()}
    nodes |= {d.node: d.unit for d in model.definitions if d.unit}
    given = {k: text for k, text in nodes.items() if text and graph.value(k) is None}
    found = {name: text for name, text in stated.items() if text and name in columns}
    dimensions, energy = _consistent(equations, given)
    if energy:
        following: list[tuple[str, Unit, Sequence[str]]]
        following = [(name, energy, ("J",)) for name in ENERGIES]
        following += _following(equations, dimensions, energy)
        for name, unit, names in following:
            text = written(unit, names)
            found.setdefault(name, text)
            node = graph.variable(name)
            if dimensions.known.get(node, Quantity()).unit is None:
                dimensions.known[node] = Quantity(unit, text)
        for one in model.forces:
            torque = dimensions.unit(one.direction) == PURE
            force = dimensions.of(one.node)
            if torque and dimensions.unit(one.node) == energy and not force.text:
                dimensions.known[one.node] = force._replace(text="N m")
    for name, node in _shown(equations):
        text = dimensions.text(node)
        if text:
            found.setdefault(name, text)
    for name in columns:
        if text := _of_differences(name, found, named):
            found.setdefault(name, text)
    return {name: text for name, text in found.items() if text}


def _of_differences(
    name: str, columns: Mapping[str, str], named: Mapping[str, str]
) -> str:
    """Return the unit of a sensitivity or of a standard deviation; "" if unknown.

    name : the name of a column `d.<column>.<name>`, or of a standard deviation.
    columns : units of columns by name.
    named : units of parameters, coordinates and states by name.
    """
    kind, rest = parsed_column(name) or (RESIDUAL, "")
    if kind is DEVIATION:
        return columns.get(rest, "")
    if kind is SENSITIVITY:
        for column, of in halves(rest):
            above, below = parsed(columns.get(column, "")), parsed(named.get(of, ""))
            if above is not None and below is not None and column in columns:
                return written(times(above, below, -1.0))
    return ""


def _consistent(
    equations: Equations, given: Mapping[int, str]
) -> tuple[Dimensions, Unit]:
    """Return the units of nodes, and the unit of all energies.

    The latter is PURE if the units of energies disagree. Parameters without units are
    pure numbers, unless an energy or a force contradicts.

    given : node -> unit in the file.
    """
    model, graph = equations.model, equations.graph
    bare = [
        graph.variable(p.name) for p in model.parameters if not p.unit and not p.follows
    ]
    names = {graph.variable(p.name): p.name for p in model.parameters}
    while True:
        dimensions = Dimensions(graph, given, bare)
        energy = _energy(equations, dimensions)
        wrong = [] if energy else _energies(equations)
        if energy:
            for one in model.forces:
                along = dimensions.unit(one.direction)
                if along is not None:
                    force = _per(energy, along, one.level)
                    wrong += _against(dimensions, one.node, force)
            if model.dissipation is not None:
                power = times(energy, {"s": -1.0})
                wrong += _against(dimensions, model.dissipation, power)
        doubtful = graph.depends(wrong) if wrong else frozenset()
        left = [node for node in bare if names[node] not in doubtful]
        if len(left) == len(bare):
            return dimensions, energy
        bare = left


def _against(dimensions: Dimensions, node: int, unit: Unit) -> list[int]:
    """Return the terms of the sum `node` with a known unit other than `unit`.

    dimensions : the units of nodes.
    """
    graph, below, terms = dimensions.graph, [node], list[int]()
    while below:
        k = below.pop()
        if graph.ops[k] in ("add", "sub", "neg"):
            below += graph.args[k]
        elif dimensions.unit(k) not in (None, unit):
            terms.append(k)
    return terms


def _per(energy: Unit, along: Unit, level: Level) -> Unit:
    """Return the unit of a generalized force or multiplier: energy / along.

    On the level of velocities it is power / along.

    along : the unit of the coordinate, or of the relation.
    level : its level.
    """
    force = times(energy, along, -1.0)
    return force if level is Level.POSITION else times(force, {"s": 1.0}, -1.0)


def _energies(equations: Equations) -> list[int]:
    model = equations.model
    found = (model.kinetic, model.potential, model.lagrangian)
    return [node for node in found if node is not None]


def _energy(equations: Equations, dimensions: Dimensions) -> Unit:
    """Return the common unit of all energies with a known unit, or PURE."""
    known = [u for node in _energies(equations) if (u := dimensions.unit(node))]
    # A unit without a mass: the mass is 1 and has no unit, and energies have none.
    if not known or any(set(unit) <= MOTION for unit in known):
        return PURE
    return known[0] if all(unit == known[0] for unit in known) else PURE


def _shown(equations: Equations) -> Iterator[tuple[str, int]]:
    """Yield name and node of each column whose unit is the unit of its node."""
    for d in equations.model.definitions:
        yield d.name, d.node
    rows = equations.every_row
    for row in rows:
        yield RESIDUAL.of(whole(row.name)), row.residual
    for k, plot in enumerate(equations.model.output.plots):
        for name, curve in plot.curves(k).items():
            yield name, curve.node
    for name, parts in equations.model.scene.points.items():
        for k, node in enumerate(parts, 1):
            yield f"point.{name}.{k}", node


def _following(
    equations: Equations, dimensions: Dimensions, energy: Unit
) -> Iterator[tuple[str, Unit, Sequence[str]]]:
    """Yield columns whose unit follows from the unit of energies.

    Each item has name, unit, and preferred names of the unit. The unit follows from the
    unit `energy` and from that of the column's owner, see
    `language.columns.ColumnKind`.
    """
    for kind, name, node, level in _owners(equations):
        along = PURE if node is None else dimensions.unit(node)
        if along is None:
            continue
        unit = times(PURE, energy, kind.energy)
        unit = times(times(unit, along, kind.along), {"s": 1.0}, kind.seconds)
        if level is Level.VELOCITY:
            unit = times(unit, {"s": 1.0}, -1.0)
        yield name, unit, kind.names


def _owners(
    equations: Equations,
) -> Iterator[tuple[ColumnKind, str, int | None, Level]]:
    """Yield columns of the table with the quantities to which these belong, the owners.

    Each item has the kind and name of the column, the node of the owner (None for a
    column of the run as a whole), and the level of the owner: of positions or of
    velocities. The owners are the run, coordinates, definitions with reactions, and
    relations with multipliers, impulses and friction.
    """
    for kind in KINDS:
        if kind.owner is Owner.RUN:
            yield kind, kind.of(), None, Level.POSITION
        elif kind.owner is Owner.COORDINATE:
            for q in equations.q:
                yield kind, kind.of(q), equations.graph.variable(q), Level.POSITION
    defined = {d.name: d.node for d in equations.model.definitions}
    for name in equations.model.output.reactions:
        yield REACTION, REACTION.of(name), defined[name], Level.POSITION
    rows = {MULTIPLIER.of(row.name): row for row in equations.rows}
    rows |= {whole(law.multiplier): law.row for law in equations.laws}
    for name, row in rows.items():
        level = Level.POSITION if row.holonomic else Level.VELOCITY
        kind, owner = parsed_column(name) or (MULTIPLIER, name)
        yield kind, name, row.residual, level
        if kind is MULTIPLIER:
            yield IMPULSE, IMPULSE.of(owner), row.residual, level
