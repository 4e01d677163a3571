"""Equations of motion of a model, as graph nodes.

    M q'' = f + A^T lambda,      A q'' = b,      Qc = A^T lambda

with M = d2L/dq'2 and f = dL/dq - d/dt(dL/dq') at q'' = 0, plus the generalized forces.
The constraint function of lhs = rhs is lhs - rhs; this fixes the sign of lambda
everywhere. `derivation.derive` derives them from the energies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import wraps
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from lagsim.language.columns import MULTIPLIER
from lagsim.language.derivatives import deciding_cone
from lagsim.language.elements import sizes
from lagsim.language.evaluate import addends
from lagsim.language.functions import OPERATIONS, PART
from lagsim.language.graph import memoize
from lagsim.language.names import rate_of
from lagsim.mechanics.constraints import EQUALITY, Flow, Law, Row, pieces_of
from lagsim.mechanics.pieces import whole

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.language.sparse import SparseVector
    from lagsim.mechanics.chains import ChainedMass, Chains
    from lagsim.mechanics.frames import TreeOfFrames
    from lagsim.model.model import FirstOrderState, Model


@dataclass(frozen=True, slots=True)
class Instant:
    """State at time t: coordinates q (n,), velocities v (n,), first-order states s."""

    t: float
    q: Floats
    v: Floats
    s: Floats


class Work(NamedTuple):
    """The work done on a group of coordinates.

    Attributes
    ----------
    name : str
        The name of the variable: `work` for the only work, else `work.` and the first
        coordinate of the group.
    coordinates : frozenset of str
        The coordinates of the group; empty for the work of a term of L that is a
        function of time alone.
    rate : int
        The power, with the multipliers as variables: a node.
    energy : int
        The share of the group in the energy: a node.
    """

    name: str
    coordinates: frozenset[str]
    rate: int
    energy: int


class Quadrature(NamedTuple):
    """Integral over time that occurs in no equation: the action.

    `rate` is the node of the integrand.
    """

    name: str
    rate: int


class Acted(NamedTuple):
    """Events of the file that have acted together at one instant.

    Attributes
    ----------
    names : tuple of str
        The names of the events that acted, in order.
    chatter : tuple of str
        The names of events that undo each other's assignments without end.
    is_over : bool
        The condition `until` became true by these assignments.
    impulse : tuple of float
        The sum (n,) of their generalized impulses; () for none.
    """

    names: tuple[str, ...] = ()
    chatter: tuple[str, ...] = ()
    is_over: bool = False
    impulse: tuple[float, ...] = ()


NOT_BEGUN = Acted()


@dataclass(frozen=True, slots=True)
class Equations:
    """Equations of motion of a model with n coordinates, as nodes of `graph`.

    Attributes
    ----------
    model : Model
        The model with the values of its parameters.
    graph : Graph
        The expression graph, to which all nodes below belong.
    q, velocities : tuple of str, length n
        The names of the coordinates, and of their velocities.
    M : sequence of SparseVector, shape (n, n)
        The mass matrix, symmetric; entries that vanish identically are `graph.zero`.
        The entries of a ChainedMass are derived on first access.
    f : tuple of int, shape (n,)
        The right-hand side of M q'' = f + A^T lambda.
    rows : tuple of Row, length m
        The equality constraints that always hold.
    laws : tuple of Law
        The rows that hold at times, each with the law of its multiplier.
    momenta : tuple of int, shape (n,)
        dL/dq'.
    energy : int
        The energy function h = sum q' dL/dq' - L.
    energy_is_sum : bool
        h equals kinetic + potential.
    kinetic_form : int
        q'^T M q' / 2, equal to the kinetic energy where the latter is quadratic in q'.
    works : tuple of Work
        The work done on each group of coordinates, with the multipliers as variables
        `lambda_<c>`; empty where the energy is conserved.
    unforced : frozenset of str
        The coordinates without a force on which L does not depend: without
        constraints their momenta are conserved.
    quadratures : tuple of Quadrature
        Quantities integrated beside these equations: the action where the output
        contains it.
    states : tuple of FirstOrderState
        The first-order states, with rates in the variables of these equations.
    begun_by : Acted
        The events that acted at the start of the run, before the first row.
    tree : TreeOfFrames or None
        The tree of frames whose recursions these equations contain, if any.
    """

    model: Model
    graph: Graph
    q: tuple[str, ...]
    velocities: tuple[str, ...]
    M: tuple[SparseVector, ...] | ChainedMass
    f: tuple[int, ...]
    rows: tuple[Row, ...]
    momenta: tuple[int, ...]
    energy: int
    energy_is_sum: bool
    kinetic_form: int
    works: tuple[Work, ...]
    unforced: frozenset[str] = frozenset()
    quadratures: tuple[Quadrature, ...] = ()
    laws: tuple[Law, ...] = ()
    states: tuple[FirstOrderState, ...] = ()
    begun_by: Acted = NOT_BEGUN
    tree: TreeOfFrames | None = None

    def of(self, model: Model, *, begun_by: Acted = NOT_BEGUN) -> Equations:
        """Return these equations for `model`, which has other values of parameters.

        begun_by : the events that have acted at the start of `model`.
        """
        given = {c.name: c.law.restitution for c in model.constraints if c.law}
        laws = self.laws
        if any(law.restitution != given.get(law.name, 0.0) for law in laws):
            laws = tuple(law.bouncing(given.get(law.name, 0.0)) for law in laws)
        return replace(self, model=model, laws=laws, begun_by=begun_by)

    def has_pieces_of(self, model: Model) -> bool:
        """Whether each gap keeps its pieces with the parameter values of `model`.

        If not, the equations of `model` have to be derived anew.
        """
        g, flow, values = self.graph, self.flow, model.parameter_values
        rows = {x.row.name: x.row.residual for x in self.laws if x.one_sided}
        found: dict[str, int] = {}
        for c in (c for c in model.constraints if c.law):
            found |= pieces_of(g, c, flow, values)
        return rows == found

    @property
    def nodes(self) -> tuple[object, ...]:
        """Hashable key of the equations: the names and nodes that determine the motion.

        Equations that differ by the values of parameters alone have one key.
        """
        return (
            self.q,
            self.chains.key
            if self.chains
            else tuple(tuple(row.entries.items()) for row in self.M),
            self.f,
            tuple(
                (x.name, x.residual, x.rate, x.b, *x.A.entries.items())
                for x in self.every_row
            ),
            len(self.rows),
            self.works,
            self.quadratures,
            self.states,
        )

    @property
    def accelerations(self) -> tuple[str, ...]:
        """The names of the variables q''."""
        return tuple(rate_of(q, 2) for q in self.q)

    @property
    def state(self) -> tuple[str, ...]:
        """The names of the state variables: q, q' and the first-order states."""
        return (*self.q, *self.velocities, *(x.name for x in self.states))

    @property
    def state_columns(self) -> list[int]:
        """Indices of t and of the state variables among the columns of the table."""
        n = len(self.q)
        return [*range(1 + 2 * n), *range(1 + 3 * n, 1 + 3 * n + len(self.states))]

    @property
    def moving(self) -> tuple[str, ...]:
        """The names of the variables that change along a motion."""
        return (*self.state, "t")

    @property
    def is_set(self) -> bool:
        """Whether events may change the energy: its expression contains modes."""
        modes = self.model.modes
        return bool(modes) and not modes.isdisjoint(self.graph.depends([self.energy]))

    @property
    def powers(self) -> list[int]:
        """The powers, d/dt of each of `works`, as nodes."""
        return [x.rate for x in self.works]

    @property
    def worked(self) -> list[int]:
        """The index in `works` of the work on each coordinate, length n.

        -1 for a coordinate on which no work is done, or without mass.
        """
        own = {q: k for k, x in enumerate(self.works) for q in x.coordinates}
        massless = {self.q[x.slider.coordinate] for x in self.laws if x.slider}
        return [-1 if q in massless else own.get(q, -1) for q in self.q]

    @property
    def work(self) -> int:
        """The sum of the variables of `works`: a node."""
        return self.graph.sum(self.graph.variable(x.name) for x in self.works)

    @property
    def other_rates(self) -> list[int]:
        """The rates that follow q'' in y', as nodes.

        These are the rates of `states`, `works` and `quadratures`.
        """
        first, rest = (x.rate for x in self.states), (x.rate for x in self.quadratures)
        return [*first, *self.powers, *rest]

    @property
    def flow(self) -> Flow:
        """The variables of the motion, and their rates."""
        turned = self.tree.turned if self.tree else None
        return Flow(self.graph, self.q, self.velocities, self.states, turned)

    def known_roundings(
        self, moving: Collection[str], state: Collection[str] = ()
    ) -> dict[int, int]:
        """Return roundoff bounds of nodes for which general bounds are poor.

        These are the entries of matrices of a tree of frames: node -> node of its
        bound. Empty without a tree.

        moving, state : see `evaluate.roundings`.
        """
        return self.tree.roundings(self.graph, moving, state) if self.tree else {}

    @property
    def relations(self) -> tuple[Law, ...]:
        """All rows with their laws: of the equalities that always hold, then `laws`.

        `normal` and `pair` are indices among the relations here.
        """
        zero, count = self.graph.zero, len(self.rows)
        if not count:
            return self.laws
        own = (
            Law(x, EQUALITY, x.name, MULTIPLIER.of(x.name), bound=zero, static=zero)
            for x in self.rows
        )
        return (*own, *(law.shifted(count) for law in self.laws))

    def is_curved(self, row: Row) -> bool:
        """Whether a row of A depends on velocities, so that impulses change it."""
        return bool(self.graph.depends(list(row.A)) & frozenset(self.velocities))

    @property
    def multipliers(self) -> tuple[str, ...]:
        """The names of the variables lambda, one for each of `relations`."""
        return tuple(x.multiplier for x in self.relations)

    @property
    def slopes(self) -> tuple[SparseVector, ...]:
        """The rows of A, each (n,), in the order of the multipliers."""
        return tuple(x.row.A for x in self.relations)

    @property
    def has_drags(self) -> bool:
        """Whether a row has drags: in the linearisation of rests, and never in runs."""
        return any(row.drags for row in self.rows)

    @property
    def every_row(self) -> tuple[Row, ...]:
        """Row in the linear system of the motion, for each of `relations`."""
        return tuple(x.solved for x in self.relations)

    @property
    def of_motion(self) -> list[int]:
        """The nodes of M, f, all rows and laws, and `other_rates`."""
        return self._with(self.other_rates)

    @property
    def of_accelerations(self) -> list[int]:
        """The nodes on which q'', lambda and the rates of first-order states depend."""
        return self._with(x.rate for x in self.states)

    def _with(self, others: Iterable[int]) -> list[int]:
        nodes = [*self.mass_nodes, *self.f, *others]
        for row in self.every_row:
            nodes += [row.residual, row.rate, row.b, *row.A.entries.values()]
        return nodes + [x for law in self.laws for x in law.given]

    def row(self, name: str) -> Row:
        """Return the row of a constraint by name; of a gap, its first piece's row."""
        return next(row for row in self.every_row if whole(row.name) == name)

    @property
    def mass_entries(self) -> dict[tuple[int, int], int]:
        """The entries of M that do not vanish identically: (i, j) -> node."""
        return {
            (i, j): node
            for i, row in enumerate(self.M)
            for j, node in row.entries.items()
        }

    @property
    def chains(self) -> Chains | None:
        """The chains along which M is factored; None where M is stored as entries."""
        return None if isinstance(self.M, tuple) else self.M.chains

    @property
    def mass_nodes(self) -> list[int]:
        """Nodes of M: its entries, or the factors in its chains."""
        chains = self.chains
        return list(self.mass_entries.values()) if chains is None else chains.nodes

    @property
    def inertias(self) -> list[int]:
        """The diagonal entries M_jj (n,), as nodes."""
        if isinstance(self.M, tuple):
            return [row[j] for j, row in enumerate(self.M)]
        return list(self.M.diagonal)

    @property
    def coupled(self) -> list[tuple[list[int], list[int]]]:
        """Pairs of lists: nodes of M, and the coordinates that these nodes couple.

        Coordinates are given by their indices.
        """
        if (chains := self.chains) is not None:
            return chains.groups()
        rows = (row.entries for row in self.M)
        return [([*x.values()], [i, *x]) for i, x in enumerate(rows)]

    def mass_times(self, x: Sequence[int]) -> list[int]:
        """Return M x (n,) for nodes x (n,)."""
        if (chains := self.chains) is not None:
            return chains.product(self.graph, x)
        return [
            self.graph.product_sum((m, x[j]) for j, m in row.entries.items())
            for row in self.M
        ]

    def constraint_forces(self) -> list[int]:
        """Return Qc = A^T lambda (n,), with the multipliers as variables.

        The result includes the drags of rows.
        """
        g = self.graph
        forces = [g.zero] * len(self.q)
        for own, name in zip(self.relations, self.multipliers, strict=True):
            lam = g.variable(name)
            for j, entry in own.row.force(g).items():
                forces[j] = g.call("add", forces[j], g.call("mul", entry, lam))
        return forces

    def motion_residuals(self) -> list[int]:
        """Return M q'' - f - A^T lambda (n,), followed by A q'' - b (m,).

        q'' and lambda are variables; rows are the constraints that always hold.
        """
        g = self.graph
        accelerations = [g.variable(name) for name in self.accelerations]
        residuals = []
        inertias = self.mass_times(accelerations)
        for inertia, f, force in zip(
            inertias, self.f, self.constraint_forces(), strict=True
        ):
            residuals.append(g.call("sub", inertia, g.call("add", f, force)))
        for row in self.rows:
            moved = g.product_sum(zip(row.A, accelerations, strict=True))
            residuals.append(g.call("sub", moved, row.b))
        return residuals


Found = TypeVar("Found")


def memoized_by_motion(find: Callable[[Equations], Found]) -> Callable[..., Found]:
    """Decorate a function of `Equations` so that its result is memoized.

    The result is computed once for all equations with equal `Equations.nodes`, whatever
    the values of parameters.
    """

    @wraps(find)
    def known(e: Equations) -> Found:
        return memoize(e.graph, (find, e.nodes), lambda: find(e))

    return known


def pushes(e: Equations) -> list[int]:
    """Return, for each node of `f` and `other_rates`, the sum of its |terms| (node).

    The sums are scales of rounding errors. Terms that depend on multipliers or
    accelerations are left out.
    """
    g = e.graph
    rates = (*e.f, *e.other_rates)
    unsolved = g.dependent(rates, (*e.multipliers, *e.accelerations))
    moving = g.dependent(rates, e.moving) if g.of((PART,)) else set()
    return [
        g.sum(_size(g, n, moving) for n in addends(g, slope) if n not in unsolved)
        for slope in rates
    ]


def _size(g: Graph, n: int, moving: set[int]) -> int:
    """Return the node of the magnitude of a term; for elements, of all their terms.

    Factors that do not vary belong to each term.

    moving : nodes that vary with the motion.
    """
    if g.ops[n] == PART:
        return sizes(g, n)
    fixed = [a for a in g.args[n] if a not in moving] if g.ops[n] == "mul" else []
    if len(fixed) == 1 and n in moving:
        one, other = sorted(g.args[n], key=lambda a: a in moving)
        return g.call("mul", g.call("abs", one), _size(g, other, moving))
    return g.call("abs", n)


def may_strike(e: Equations, row: Row) -> bool:
    """Whether the rate of a row may jump: by an impact, which dissipates energy."""
    return may_jump(e, [row.rate])


def has_poles(e: Equations, node: int) -> bool:
    """Whether an expression may have a pole, or the cut of an angle (atan2).

    Poles are found of tan, of quotients and of powers. An expression without these, and
    without switches, is continuous to rounding; the logarithm counts as continuous.
    """
    g, fixed = e.graph, {p.name for p in e.model.parameters}
    for n in g.cone([node]):
        op, args = g.ops[n], g.args[n]
        if op in ("tan", "atan2"):
            return True
        if op == "div" and not g.depends([args[1]]) <= fixed:
            return True
        exponent = g.value(args[1]) if op == "pow" else 0.0
        if exponent is None or exponent < 0.0:
            return True
    return False


def may_jump(e: Equations, nodes: Sequence[int]) -> bool:
    """Whether one of the nodes may jump: by a switch, or by a mode of the file."""
    g, cone = e.graph, deciding_cone(e.graph, nodes)
    if not e.model.modes.isdisjoint(g.depends(nodes)):
        return True
    return any((known := OPERATIONS.get(g.ops[n])) and known.switch for n in cone)
