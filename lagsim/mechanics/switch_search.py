"""The search for the switches of expressions and of models.

A switch has a side where the motion, a condition or an output depends on it; see
`lagsim.mechanics.switches` for the kinds of switches.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.language.functions import JOINING, OPERATIONS, SMOOTH, STEPS
from lagsim.language.graph import memoized
from lagsim.language.names import rate_of
from lagsim.language.tables import at_ends, cell_of, continuous, highest_orders
from lagsim.mechanics.surfaces import WHOLE, Side, oriented, surfaces
from lagsim.mechanics.switches import Roots, Switches, TimeSwitch, switch_text

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model

# Operations that can be a switch.
SWITCHING = ("cbrt", *(op for op, x in OPERATIONS.items() if x.switch or x.condition))


def find_switches(
    g: Graph,
    nodes: Iterable[int],
    moving: Collection[str],
    dynamics: Sequence[int] = (),
    speeds: Collection[str] = (),
    ignored: frozenset[int] = frozenset(),
    accelerations: Sequence[int] = (),
    rates: Sequence[int] | None = None,
    conditions: Sequence[int] = (),
    output: Sequence[int] = (),
    constrained: Collection[str] = (),
    cuts: frozenset[int] = frozenset(),
    driving: tuple[str, ...] = (),
) -> Switches:
    """Find the switches of expressions, `nodes`, and the sides of their surfaces.

    Parameters
    ----------
    g, nodes
        The graph and the expressions, with their derivatives, which may have switches
        of their own.
    moving
        The names of variables, other than t, that change along the motion.
    dynamics
        The expressions that determine the motion: their state switches have sides.
    speeds
        The names of velocities: roots of velocities are switches, see `Roots`.
    ignored
        Switches (nodes) that have no sides, as they step only where a mode ends.
    accelerations, rates
        The expressions on which y' depends, except quadratures; and the residuals and
        rates of rows (None if velocities may jump by forces too). Kernels pass levels
        at which no jump occurs, see `_smooth` and `_passed`.
    conditions, output
        The expressions of conditions, and of columns and sections. A step function that
        these alone contain has a side, see `Side.shown`: in a condition always, in
        output if laws or surfaces may hold all variables on which it depends.
    constrained
        The names of variables that laws may hold; variables of surfaces are added.
    cuts
        The nodes atan2(y, x) that are switches: they jump by 2 pi at y = 0, x < 0.
    driving
        ("t",) where eliminated coordinates may be functions of t alone: steps of t in
        `conditions` then have sides, too, as their arguments may be 0 but for rounding.
    """
    finder = _Finder(g, list(nodes), moving, speeds, cuts)
    orders = highest_orders(g, accelerations) if accelerations else {}
    modes = {
        d: TimeSwitch(f"mode.{k}", d, _smooth(g, d, orders))
        for k, d in enumerate(sorted(set(finder.time.values())))
    }
    modes_of = {n: g.variable(modes[d].variable) for n, d in finder.time.items()}
    state = dict(sorted(finder.state.items()))
    among = frozenset(g.cone(dynamics) if finder.decided else ()) - ignored
    watched = sorted({d for n, d in finder.decided.items() if n in among})
    beside = _shown_steps(g, conditions, (*moving, *driving), speeds)
    if output:
        levels = (surface.node for d in watched for surface in surfaces(g, d))
        held = {*constrained} | (g.depends(levels) & {*moving})
        of_output = _shown_steps(g, output, held, speeds)
        free = {*moving} - held
        beside |= {
            n: x for n, x in of_output.items() if free.isdisjoint(g.depends([n]))
        }
    while True:
        sides, sides_of = _sides(g, {d: state[d] for d in watched}, beside)
        roots = Roots.among(g, dynamics, sides, speeds)
        sides = tuple(s._replace(floor=roots.floors.get(s.node, "")) for s in sides)
        known = tuple(modes.values()), state, sides
        found = Switches(g, *known, modes_of, sides_of, roots, cuts=cuts)
        moves = found.moving(watched, (*moving, "t"))
        own = dict.fromkeys(found.moving([*beside], (*moving, *driving)))
        if len(moves) == len(watched) and len(own) == len(beside):
            return _passed(g, found, orders, rates, speeds) if accelerations else found
        watched, beside = moves, {d: beside[d] for d in own}


def _shown_steps(
    g: Graph, nodes: Sequence[int], moving: Collection[str], speeds: Collection[str]
) -> dict[int, str]:
    """Return the step functions (nodes) of the state in `nodes`, with their texts.

    moving, speeds : see `find_switches`.
    """
    finder = _Finder(g, [*nodes], moving, speeds, frozenset())
    steps = sorted(n for n, d in finder.decided.items() if n == d)
    return {n: finder.state[n] for n in steps}


def _sides(
    g: Graph, switches: Mapping[int, str], shown: Mapping[int, str]
) -> tuple[tuple[Side, ...], dict[int, tuple[int, int]]]:
    """Return one side for each surface, and the side of each discrete function.

    The second result maps discrete functions to pairs: the mode variable (a node), and
    the sign of `oriented`.

    switches, shown : discrete function (node) -> its text; a side of a function that
        `shown` alone contains has `Side.shown`.
    """
    sides: dict[tuple[int, bool], Side] = {}
    sides_of = {}
    # First the surfaces of the motion: a step that is shown may be on one of these.
    for discrete, text in (*switches.items(), *shown.items()):
        (surface,) = surfaces(g, discrete)
        node, sign = oriented(g, surface)
        key = node, surface.op in WHOLE
        k = len(sides)
        sliding, slack, departed = f"sliding.{k}", f"slack.{k}", f"departed.{k}"
        new = Side(f"side.{k}", sliding, slack, departed, *key, text)
        side = sides.setdefault(key, new._replace(shown=discrete not in switches))
        sides_of[discrete] = g.variable(side.variable), sign
    return tuple(sides.values()), sides_of


def _smooth(g: Graph, discrete: int, orders: Mapping[int, int]) -> tuple[float, float]:
    """Return the open interval of a table's cell numbers at which y' is continuous.

    At its knots the table has continuous derivatives up to the order in which y'
    contains it (`orders`). No event occurs there: an impact, the end of a contact, or
    sliding along the knot needs a jump. Sliding needs vector fields of both sides that
    point to the knot (Filippov), but both are equal: a motion crosses the knot, turns
    back where it only touches, or stays at rest. (0, 0) for other functions.

    discrete : the node of the cell's number.
    orders : cell -> the order of derivatives of the table in y'.
    """
    cell = cell_of(g, discrete)
    return continuous(cell[0], orders.get(discrete, 0)) if cell else (0.0, 0.0)


def _passed(
    g: Graph,
    found: Switches,
    orders: Mapping[int, int],
    rates: Sequence[int] | None,
    speeds: Collection[str],
) -> Switches:
    """Return the switches with the levels that kernels pass without an event.

    These levels are the intervals `smooth` and `continuous` of each side. A level of a
    function of positions is met at a rate that forces do not change instantaneously:
    where the rate is not 0 the motion crosses the level, even if y' jumps, unless a
    velocity jumps because the rate of a row, or the expression of another side, does,
    or the argument of a table jumps past its end.

    orders : cell of a table -> order of its derivatives in y'.
    rates : residuals and rates of rows, or None.
    speeds : the names of velocities.
    found : the switches, without these levels.
    """
    others = [*(rates or ()), *(s.node for s in found.sides if not s.shown)]
    others += [n for n in found.state if (x := cell_of(g, n)) and x[0].values[3]]
    jumps, decisive = highest_orders(g, others), frozenset(g.cone(others))
    fast = g.dependent([s.node for s in found.sides], speeds)
    sides = []
    for side in found.sides:
        cell = g.call("floor", side.node)
        smooth = continuous = _smooth(g, cell, orders)
        if rates is not None and side.node not in fast:
            continuous = _smooth(g, cell, jumps)
            steps = {cell, g.call("ceil", side.node)}
            if cell_of(g, cell) is None and decisive.isdisjoint(steps):
                continuous = (-math.inf, math.inf)
        sides.append(
            side._replace(smooth=smooth, continuous=continuous) if side.whole else side
        )
    return replace(found, sides=tuple(sides))


class _Finder:
    """Search for switches in expressions; conditions of time switches are not searched.

    Parameters
    ----------
    g, nodes
        The graph, and the expressions.
    moving, speeds
        The names of variables that change along the motion, and of velocities.
    cuts
        The nodes atan2(y, x) that are switches.
    """

    def __init__(
        self,
        g: Graph,
        nodes: list[int],
        moving: Collection[str],
        speeds: Collection[str],
        cuts: frozenset[int],
    ) -> None:
        self.g, self.cuts = g, cuts
        nodes = nodes if cuts or g.of(SWITCHING) else []
        found = g.dependents(nodes, moving, speeds, ("t",))
        self.moving, self.fast, timed = found
        self.timed = timed - self.moving
        self.time: dict[int, int] = {}  # switch or condition -> discrete function
        self.state: dict[int, str] = {}  # discrete function -> text
        self.decided: dict[int, int] = {}  # state switch -> discrete function
        seen = set(nodes)
        stack = sorted(seen)
        while stack:
            below = [a for a in self._below(stack.pop()) if a not in seen]
            seen.update(below)
            stack += dict.fromkeys(below)

    def _below(self, n: int) -> tuple[int, ...]:
        """Record node n if it is a switch; return its arguments for the search."""
        g = self.g
        op, args = g.ops[n], g.args[n]
        row = OPERATIONS.get(op)
        if op == SMOOTH:
            return args[1:]
        if n in self.cuts and n in self.moving:
            self.decided[n] = discrete = g.call("sign", args[0])
            self.state.setdefault(discrete, switch_text(g, n))
            return args
        rooted = op == "cbrt" and args[0] in self.fast
        if row is None or not (row.switch or row.condition or rooted):
            return args
        if op == "if":
            return args
        plain, timed = row.condition or op in STEPS, n in self.timed
        if not timed and (n not in self.moving or op in JOINING):
            return args
        discrete = n if plain else g.call(row.decided_by, *args)
        if timed:
            self.time[n] = discrete
            return () if plain else args
        self.decided[n] = discrete
        # abs, min and max keep their name where their derivative is a switch too.
        if not plain or discrete not in self.state:
            self.state[discrete] = switch_text(g, n)
        return args


def model_switches(
    equations: Equations,
    *,
    located: bool = True,
    cuts: bool = False,
    shown: bool = False,
) -> Switches:
    """Find the switches of the equations of motion.

    State switches that are only in outputs, or in the energy but not in its
    derivatives, have no influence on the motion. If not `located`, state switches have
    no sides, and only time switches are frozen.

    cuts : whether to locate the jumps of `atan2` in forces, for fixed steps. A method
        with step control shortens its steps at such a jump instead, and is not stopped
        where y = 0 and x > 0, without a jump.
    shown : whether steps of conditions and output have sides too, see `Side.shown`.
    """
    e = equations
    beside = [row.transport for row in e.every_row]
    beside += [law.when for law in e.laws if law.when is not None]
    conditions = tuple(x.node for x in e.model.located) if located and shown else ()
    dynamics = (*e.of_motion, *beside)
    dynamics += tuple(_table_ends(e, dynamics)) if shown and e.model.tables else ()
    works = (x.name for x in e.works)
    # Output is as written: with eliminated coordinates, which have no value here.
    q = [c.name for c in e.model.coordinates]
    stated = [rate_of(name, order) for order in range(3) for name in q]
    own = (*e.state, *works, *e.accelerations, *e.multipliers)
    moving = tuple(dict.fromkeys([*own, *stated]))
    # The friction of a slip depends on its size, and a slip that vanishes has ended.
    sizes = frozenset(e.graph.call("abs", x.row.rate) for x in e.laws if x.normal >= 0)
    known = (*dynamics, e.energy), moving, dynamics if located else (), e.velocities
    driving = () if {*q} <= {*e.state} else ("t",)
    output = tuple(_output(e.model)) if located and shown else ()
    of_rows = tuple(x for row in e.every_row for x in (row.residual, row.rate))
    constrained = frozenset({*e.state} & e.graph.depends(of_rows if e.laws else ()))
    jumping = _cuts(e) if located and cuts else frozenset()
    if not e.model.tables and not e.graph.of(WHOLE):
        return _found(
            e.graph, *known, sizes, conditions=conditions, output=output,
            constrained=constrained, cuts=jumping, driving=driving,
        )  # fmt: skip
    rates = None
    if not e.states and not any(law.slider for law in e.laws):
        rates = of_rows
    accelerations = (*e.of_accelerations, *beside)
    return _found(
        e.graph, *known, sizes, accelerations, rates, conditions, output, constrained,
        jumping, driving,
    )  # fmt: skip


def _table_ends(e: Equations, dynamics: Sequence[int]) -> Iterator[int]:
    """Yield nodes that step at the ends of tables which the motion does not contain.

    The tables are those in conditions and sections that have no values beyond their
    ends. An argument may jump (`mod(x, 4)`), and a table may stand in a branch of `if`.
    The steps in arguments and conditions of `if` decide whether the run ends, so they
    have sides like the switches of the motion.

    dynamics : the expressions that determine the motion.
    """
    g, known = e.graph, frozenset(e.graph.cone(dynamics))
    shown = [n for n in g.cone(e.model.relations) if n not in known]
    cells = {n: x for n in shown if (x := cell_of(g, n)) and x[0].values[3]}
    for cell in cells.values():
        yield at_ends(g, *cell)
    for n in shown:
        if cells and g.ops[n] == "if" and not cells.keys().isdisjoint(g.cone([n])):
            yield g.args[n][0]


def _output(model: Model) -> Iterator[int]:
    """Yield the nodes of definitions that are columns, and of sections."""
    columns = {*model.output.columns}
    yield from (x.node for x in model.definitions if x.name in columns)
    yield from (x.at for x in model.output.sections if x.at is not None)


def _cuts(e: Equations) -> frozenset[int]:
    """Return the nodes `atan2` in expressions of forces that no row contains."""
    g = e.graph
    if not (found := g.of(("atan2",))):
        return frozenset()
    rows = [x for row in e.every_row for x in (row.residual, row.rate, row.transport)]
    of_rows = frozenset(g.cone(rows))
    return frozenset(found) & frozenset(g.cone(e.of_accelerations)) - of_rows


_found = memoized(find_switches)
