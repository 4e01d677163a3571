"""Derivation of the equations of motion from the energies, as graph nodes.

    M q'' = f + A^T lambda,      A q'' = b,      Qc = A^T lambda

with M = d2L/dq'2 and f = dL/dq - d/dt(dL/dq') at q'' = 0, plus the generalized forces.
The constraint function of lhs = rhs is lhs - rhs; this fixes the sign of lambda
everywhere.

Reactions are computed by virtual separation: with a definition x as a coordinate of its
own, held by the constraint x = r(q, t), the equation of x is

    d/dt dL/dx' - dL/dx = Q_x + sum_c lambda_c dg_c/dx + R_x,

and the known motion, inserted, yields R_x without solving a system. R_x is the
multiplier of x - r = 0: the force on all parts of the model that are written with x.

Sources: H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints,
eqs 47 and 61; Arnold, Mathematical Methods of Classical Mechanics, sections 12 and 15;
C. Lanczos, The Variational Principles of Mechanics, section III.5.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial, wraps
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from lagsim import limits
from lagsim.errors import InputError, Problem
from lagsim.language.columns import ACTION, MULTIPLIER
from lagsim.language.derivatives import deciding_cone, gradient, slopes, tangent
from lagsim.language.elements import sizes
from lagsim.language.evaluate import addends, evaluate
from lagsim.language.forms import fewer_terms
from lagsim.language.functions import ELEMENTS, OPERATIONS, PART
from lagsim.language.graph import VARIABLE, memoize
from lagsim.language.names import rate_of
from lagsim.language.sparse import DisjointSets, SparseVector
from lagsim.mechanics.chains import ChainedMass, inertial_forces, shorter_chains
from lagsim.mechanics.constraints import (
    Flow,
    Kind,
    Law,
    Row,
    constraint_row,
    laws_of,
    pieces_of,
)
from lagsim.mechanics.pieces import whole
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.mechanics.chains import Chains
    from lagsim.model.model import FirstOrderState, Force, Model


@dataclass(frozen=True, slots=True)
class Instant:
    """State at time t: coordinates q (n,), velocities v (n,), first-order states s."""

    t: float
    q: Floats
    v: Floats
    s: Floats


def mass_matrix(
    g: Graph, momenta: Sequence[int], rates: Sequence[int]
) -> tuple[SparseVector, ...]:
    """Return the mass matrix d momenta/d rates (n, n), symmetric, as sparse rows.

    The lower triangle is differentiated and mirrored.

    Parameters
    ----------
    momenta : sequence of int, length n
        dL/dq': nodes.
    rates : sequence of int, length n
        q': nodes.

    Raises
    ------
    InputError
        Where more than `limits.INERTIAS` entries may differ from 0.
    """
    variables = frozenset(rates)
    entries = _entries(g, momenta, rates) if len(rates) ** 2 > limits.INERTIAS else 0
    if entries > limits.INERTIAS:
        text = (
            f"the mass matrix has {entries:,} entries that are not 0, and the limit is "
            f"{limits.INERTIAS:,}"
        )
        hint = "fewer velocities in one product or square of the energies couple less"
        raise InputError([Problem("too-large", text, None, hint)])
    places = {v: j for j, v in enumerate(rates)}
    M: list[dict[int, int]] = [{} for _ in rates]
    for i, momentum in enumerate(momenta):
        for v, node in slopes(g, momentum, variables).items():
            if places[v] <= i:
                M[i][places[v]] = M[places[v]][i] = node
    return tuple(SparseVector(g, len(rates), row) for row in M)


def _entries(g: Graph, momenta: Iterable[int], rates: Iterable[int]) -> int:
    """Return the count of entries of M that may differ from 0.

    That is the number of pairs of a momentum and a velocity on which it depends.
    """
    below = {v: 1 << j for j, v in enumerate(rates)}  # node -> bit set of velocities
    momenta = list(momenta)
    for n in g.cone(momenta):
        if n not in below:
            below[n] = 0
            for a in g.args[n]:
                below[n] |= below[a]
    return sum(below[p].bit_count() for p in momenta)


def in_fewer_terms(
    g: Graph,
    model: Model,
    flow: Flow,
    M: tuple[SparseVector, ...],
    f: list[int],
    convective: Sequence[int],
    Q: Sequence[int],
) -> tuple[tuple[SparseVector, ...], list[int]]:
    """Return M and f with inertial terms rewritten in fewer terms, where possible.

    The terms of the potential and of the applied forces stay as they are: they may
    contain small differences, which would cancel if multiplied out.

    Parameters
    ----------
    M : tuple of SparseVector, shape (n, n)
    f : list of int, length n
        The right-hand side of M q'' = f.
    convective : sequence of int, length n
        d/dt(dL/dq') at q'' = 0.
    Q : sequence of int, length n
        The generalized forces.
    """
    T, V = model.kinetic, model.potential
    if T is None or V is None or flow.velocities & g.depends([V]):
        return M, f
    n = len(f)
    inertial = [
        g.call("sub", a, c)
        for a, c in zip(gradient(g, T, flow.positions), convective, strict=True)
    ]
    entries = [(i, j) for i, row in enumerate(M) for j in row.entries if i <= j]
    moving = {*(x.name for x in model.variables), *flow.velocities, "t"}
    before = [*(M[i][j] for i, j in entries), *inertial]
    after = fewer_terms(g, before, moving)
    if after == before:
        return M, f
    rows: list[dict[int, int]] = [{} for _ in range(n)]
    for (i, j), node in zip(entries, after, strict=False):
        rows[i][j] = rows[j][i] = node
    forces = [
        g.call("add", g.call("sub", a, b), c)
        for a, b, c in zip(
            after[len(entries) :], gradient(g, V, flow.positions), Q, strict=True
        )
    ]
    return tuple(SparseVector(g, n, row) for row in rows), forces


WORK = "work"
# The column, and the variable, of the integral of L.
# Up to this number of coordinates the entries of M take fewer operations than chains.
FEW = 5


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
    """Quantity that occurs in no equation and is integrated from its rate: the action.

    `rate` is the node of its rate.
    """

    name: str
    rate: int


class Begun(NamedTuple):
    """Events that acted at the start of a run, before the first row of the table.

    Attributes
    ----------
    acts : tuple of str
        The names of the events that acted, in order.
    chatter : tuple of str
        The names of events that undo each other's assignments without end.
    is_over : bool
        The condition `until` became true by these assignments.
    impulses : tuple of float
        The sum (n,) of their generalized impulses, which act in the run; () for none.
    """

    acts: tuple[str, ...] = ()
    chatter: tuple[str, ...] = ()
    is_over: bool = False
    impulses: tuple[float, ...] = ()


NOT_BEGUN = Begun()


@dataclass(frozen=True, slots=True)
class Equations:
    """Equations of motion of a model with n coordinates, as nodes of `graph`.

    Attributes
    ----------
    model : Model
    graph : Graph
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
    begun_by : Begun
        The events that acted at the start.
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
    begun_by: Begun = NOT_BEGUN

    def of(self, model: Model, *, begun_by: Begun = NOT_BEGUN) -> Equations:
        """Return these equations for `model`, which differs in parameter values.

        begun_by : the events that have acted at the start of `model`.
        """
        given = {c.name: c.law.restitution for c in model.constraints if c.law}
        laws = self.laws
        if any(law.restitution != given.get(law.name, 0.0) for law in laws):
            laws = tuple(law.bouncing(given.get(law.name, 0.0)) for law in laws)
        return replace(self, model=model, laws=laws, begun_by=begun_by)

    def has_pieces_of(self, model: Model) -> bool:
        """Whether gaps have the same pieces with the parameter values of `model`."""
        g, flow, values = self.graph, self.flow, model.parameter_values
        rows = {x.row.name: x.row.residual for x in self.laws if x.kind.one_sided}
        found: dict[str, int] = {}
        for c in (c for c in model.constraints if c.law):
            found |= pieces_of(g, c, flow, values)
        return rows == found

    def begun(self, state: Instant) -> Equations:
        """Return the equations after the events that act at the start `state`.

        Events without a located condition (periodic ones) act first, then the events
        whose conditions become true by their assignments.
        """
        model, numbers = self.model, [state.t, *state.q, *state.v, *state.s]
        values = {p.name: p.value for p in model.parameters}
        values |= zip(("t", *self.state), map(float, numbers), strict=True)
        begun = _begin(self, values)
        new = tuple(x._replace(value=values[x.name]) for x in model.parameters)
        if not begun.acts:
            return self
        return self.of(replace(model, parameters=new), begun_by=begun)

    @property
    def nodes(self) -> tuple[object, ...]:
        """Hashable key of the motion.

        Names and nodes, equal for all values of parameters.
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
        """Whether events change the energy: whether its expression contains modes."""
        modes = self.model.modes
        return bool(modes) and not modes.isdisjoint(self.graph.depends([self.energy]))

    @property
    def powers(self) -> list[int]:
        """The powers, d/dt of each of `works`, as nodes."""
        return [x.rate for x in self.works]

    @property
    def worked(self) -> list[int]:
        """The index in `works` of the work on each coordinate (n,).

        -1 for a coordinate without work, or without mass.
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

        Of `states`, `works`, `quadratures`.
        """
        first, rest = (x.rate for x in self.states), (x.rate for x in self.quadratures)
        return [*first, *self.powers, *rest]

    @property
    def flow(self) -> Flow:
        """The variables of the motion, and their rates."""
        return Flow(self.graph, self.q, self.velocities, self.states)

    @property
    def multipliers(self) -> tuple[str, ...]:
        """The names of the variables lambda: of the rows, then of the laws."""
        names = (MULTIPLIER.of(row.name) for row in self.rows)
        return (*names, *(law.multiplier for law in self.laws))

    @property
    def slopes(self) -> tuple[SparseVector, ...]:
        """The rows of A, each (n,), in the order of the multipliers."""
        return tuple(row.A for row in (*self.rows, *(law.row for law in self.laws)))

    @property
    def every_row(self) -> tuple[Row, ...]:
        """The rows that always hold, then the row `solved` of each law."""
        return (*self.rows, *(law.solved for law in self.laws))

    @property
    def of_motion(self) -> list[int]:
        """The nodes of the equations of motion, and of the rates after q'' in y'."""
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
        """Return the row of a constraint by name.

        Of a gap with pieces that of the first.
        """
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
        """The chains that M is factored along; None where M is stored as entries."""
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
        """Pairs of nodes of M and of the indices of coordinates that these couple."""
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
        """Return Qc = A^T lambda (n,), with the multipliers as variables."""
        g = self.graph
        forces = [g.zero] * len(self.q)
        for A, name in zip(self.slopes, self.multipliers, strict=True):
            lam = g.variable(name)
            for j, entry in A.entries.items():
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
        for inertia, f, held in zip(
            inertias, self.f, self.constraint_forces(), strict=True
        ):
            residuals.append(g.call("sub", inertia, g.call("add", f, held)))
        for row in self.rows:
            moved = g.product_sum(zip(row.A, accelerations, strict=True))
            residuals.append(g.call("sub", moved, row.b))
        return residuals


Found = TypeVar("Found")


def memoized_by_motion(find: Callable[[Equations], Found]) -> Callable[..., Found]:
    """Decorate a function of `Equations` so that its result is stored.

    It is computed once for all equations with equal `Equations.nodes`, whatever the
    values of parameters.
    """

    @wraps(find)
    def known(e: Equations) -> Found:
        return memoize(e.graph, (find, e.nodes), lambda: find(e))

    return known


# What methods use besides y' in models with elements, see `language.elements`.
OF_ELEMENTS = frozenset(("power",))


def may_gather(model: Model, needs: Collection[str] = ()) -> bool:
    """Whether equations of motion with the elements of a model can be integrated.

    needs : names of functions that the method uses besides y'.
    """
    g, output = model.graph, model.output
    if not g.of((ELEMENTS,)) or not OF_ELEMENTS.issuperset(needs):
        return False
    if model.constraints or model.states or model.located or model.events:
        return False
    if output.reactions or output.gauss or output.action or output.sections:
        return False
    nodes = [model.lagrangian, *(x.node for x in model.forces)]
    nodes += [] if model.dissipation is None else [model.dissipation]
    if may_branch(g, nodes):
        return False
    # Of sums of velocities M has no entries.
    velocities = {rate_of(c.name) for c in model.coordinates}
    of_energies = set(g.of((ELEMENTS,))).intersection(g.cone([model.lagrangian]))
    return velocities.isdisjoint(g.depends(of_energies))


def may_branch(g: Graph, nodes: Iterable[int]) -> bool:
    """Whether an expression has a jump or a kink."""
    rows = (OPERATIONS.get(g.ops[n]) for n in g.cone(nodes))
    return any(row is not None and (row.switch or row.branches) for row in rows)


def derive(model: Model, *, chained: bool = True, gathers: bool = False) -> Equations:
    """Derive the equations of motion of `model`.

    Parameters
    ----------
    model : Model
    chained : bool
        Keep M as a ChainedMass where factors along chains take fewer operations than
        its entries.
    gathers : bool
        Keep sums that are elements, see `may_gather`; else they are written out.
    """
    if not gathers:
        model = model.written_out()
    g = model.graph
    q = tuple(c.name for c in model.coordinates)
    velocities = tuple(map(rate_of, q))
    flow = Flow(g, q, velocities, model.states)
    positions, rates = flow.positions, flow.rates
    time = g.variable("t")

    *by_state, dL_dt = gradient(g, model.lagrangian, [*rates, *positions, time])
    dL_dt = g.call("add", dL_dt, *tangent(g, [model.lagrangian], flow.states))
    momenta, dL_dq = by_state[: len(q)], by_state[len(q) :]
    chains = None
    if chained and len(q) > FEW and all(c.always for c in model.constraints):
        chains = shorter_chains(g, model.lagrangian, rates, velocities)
    entries = partial(mass_matrix, g, momenta, rates)
    M = ChainedMass(g, chains, entries) if chains else entries()
    Q = generalized_forces(g, model, flow)
    if chains:
        pushes = inertial_forces(model, flow)
    else:
        convective = tangent(g, momenta, flow.forward)
        pushes = [g.call("sub", a, c) for a, c in zip(dL_dq, convective, strict=True)]
    f = [g.call("add", a, force) for a, force in zip(pushes, Q, strict=True)]
    if isinstance(M, tuple) and has_angles(g, model.kinetic):
        M, f = in_fewer_terms(g, model, flow, M, f, convective, Q)
    plain = [c for c in model.constraints if c.always]
    rows = tuple(constraint_row(g, c.name, c.relation.node, flow) for c in plain)
    laws = tuple(laws_of(g, model.constraints, flow, model.parameter_values))
    energy, is_sum = _energy(g, model, momenta, rates, flow.velocities)
    found = Equations(
        model=model,
        graph=g,
        q=q,
        velocities=velocities,
        M=M,
        f=tuple(f),
        rows=rows,
        momenta=tuple(momenta),
        energy=energy,
        energy_is_sum=is_sum,
        kinetic_form=model.kinetic or g.zero,
        works=(),
        unforced=frozenset(
            name
            for name, *pushes in zip(q, dL_dq, Q, strict=True)
            if set(pushes) == {g.zero}
        ),
        quadratures=(Quadrature(ACTION.of(), model.lagrangian),)
        if model.output.action
        else (),
        laws=laws,
        states=model.states,
    )
    found = replace(found, works=works_of(found, Q, dL_dt))
    if chains and is_sum:
        return found
    form = g.product_sum(zip(rates, found.mass_times(rates), strict=True))
    return replace(found, kinetic_form=g.call("mul", g.constant(0.5), form))


def has_angles(g: Graph, node: int | None) -> bool:
    """Whether an expression contains a sine or cosine."""
    circular = g.of(("sin", "cos"))
    if node is None or not circular:
        return False
    return not set(circular).isdisjoint(g.cone([node]))


def generalized_forces(g: Graph, model: Model, flow: Flow) -> list[int]:
    """Return the generalized forces Q (n,): nodes.

    Q_j is the virtual work of the applied forces per unit of q_j, less dF/dq_j' for a
    dissipation function F.
    """
    Q = _components(g, model.forces, flow)
    if model.dissipation is not None:
        losses = flow.gradient(g, model.dissipation, by_rates=True)
        for j, loss in losses.entries.items():
            Q[j] = g.call("sub", Q[j], loss)
    return Q


def generalized_impulses(e: Equations) -> list[list[int]]:
    """Return the generalized impulses (events, n) of the events of the file: nodes.

    The momentum of q_j jumps by sum_i J_i d r_i/d q_j.
    """
    return [_components(e.graph, x.impulses, e.flow) for x in e.model.events]


def without_momentum(e: Equations) -> list[int]:
    """Return the indices of coordinates that no impulse can move.

    They have no momentum, and no equality determines their velocities.
    """
    held = {j for row in e.rows for j in row.A.entries}
    timed = (law for law in e.laws if law.kind is Kind.TIMED)
    held |= {j for law in timed for j in law.row.A.entries}
    return [j for j, p in enumerate(e.momenta) if p == e.graph.zero and j not in held]


def lost_impulses(e: Equations) -> list[Problem]:
    """Return a problem for each event with an impulse on a coordinate without inertia.

    These are the coordinates of `without_momentum`.
    """
    still, found = without_momentum(e) if e.model.kicks else [], []
    for event in e.model.events if still else ():
        kick = _components(e.graph, event.impulses, e.flow)
        for j in (j for j in still if kick[j] != e.graph.zero):
            text = f"the event `{event.name}` gives an impulse to `{e.q[j]}`, which "
            text += "has no inertia, and no equality determines its velocity"
            hint = "give it a mass in `kinetic`, or the impulse another direction"
            found.append(Problem("no-inertia", text, event.impulses[0].place, hint))
    return found


def _components(g: Graph, forces: Iterable[Force], flow: Flow) -> list[int]:
    """Return the components (n,) of forces, or impulses, along the coordinates."""
    Q = [g.zero] * len(flow.rates)
    for force in forces:
        by_rates = force.level is not Level.POSITION
        levers = flow.gradient(g, force.direction, by_rates=by_rates)
        for j, lever in levers.entries.items():
            Q[j] = g.call("add", Q[j], g.call("mul", force.node, lever))
    return Q


def _energy(
    g: Graph,
    model: Model,
    momenta: Sequence[int],
    rates: Sequence[int],
    velocities: frozenset[str],
) -> tuple[int, bool]:
    if model.kinetic is not None and model.potential is not None:
        quadratic = g.degree(model.kinetic, velocities)
        if quadratic is not None and quadratic.least >= 2 >= quadratic.most:
            static = not g.depends([model.potential]) & velocities
            if static:
                return g.call("add", model.kinetic, model.potential), True
    moved = g.product_sum(zip(rates, momenta, strict=True))
    return g.call("sub", moved, model.lagrangian), False


def pushes(e: Equations) -> list[int]:
    """Return the sums of magnitudes of the terms of `f` and `other_rates`, as nodes.

    Terms that depend on multipliers or accelerations are left out.
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
    """Return the magnitude of a term; of a sum of elements that of all its terms.

    moving : nodes that vary with the motion; other factors belong to each term.
    """
    if g.ops[n] == PART:
        return sizes(g, n)
    fixed = [a for a in g.args[n] if a not in moving] if g.ops[n] == "mul" else []
    if len(fixed) == 1 and n in moving:
        one, other = sorted(g.args[n], key=lambda a: a in moving)
        return g.call("mul", g.call("abs", one), _size(g, other, moving))
    return g.call("abs", n)


def reactions(e: Equations) -> dict[str, int]:
    """Return the reaction R_x of each definition named in `output.reactions`.

    Each R_x is that of the model in which x alone is separated.

    Returns
    -------
    dict
        Name of the definition -> node of the state, q'' and lambda.
    """
    g = e.graph
    separated, expressions = e.model.stated.separated(e.model)
    apart = derive(separated)
    own = dict(zip(apart.q, apart.motion_residuals(), strict=False))
    # All definitions are separated at once: a part written with x through another
    # definition y acts on x through the reaction of y.
    users = {
        name: [
            other for other, node in expressions.items() if name in g.depends([node])
        ]
        for name in expressions
    }
    held: dict[str, int] = {}
    for name in TopologicalSorter(users).static_order():
        x = g.variable(name)
        rest = (
            (held[other], gradient(g, expressions[other], [x])[0])
            for other in users[name]
        )
        held[name] = g.call("add", own[name], g.product_sum(rest))
    nodes = g.substitute((held[name] for name in expressions), _motion(e))
    return dict(zip(expressions, nodes, strict=True))


def _motion(e: Equations) -> dict[int, int]:
    """Return definitions and their derivatives along the motion, to be substituted.

    The definitions are those in `output.reactions`; variable x, x' or x'' -> node of t,
    q, q' and q''.
    """
    g = e.graph
    seed = {**e.flow.forward}
    for q in e.q:
        seed[g.variable(q)] = g.variable(rate_of(q))
        seed[g.variable(rate_of(q))] = g.variable(rate_of(q, 2))
    found = {d.name: d.node for d in e.model.definitions}
    names = e.model.output.reactions
    new: dict[int, int] = {}
    nodes = [found[name] for name in names]
    for order in range(3):
        variables = (g.variable(rate_of(n, order)) for n in names)
        new |= dict(zip(variables, nodes, strict=True))
        nodes = tangent(g, nodes, seed)
    return new


# Owner of a node that depends on coordinates of no group, or of several groups.
NOBODY, SEVERAL = -1, -2


@memoized_by_motion
def groups(e: Equations) -> list[list[int]]:
    """Return the decoupled groups of coordinates, as lists of their indices.

    Two coordinates are coupled where one occurs in an entry of M, a force, a constraint
    or a law of the other. Each group on which forces, dissipation, moving constraints,
    laws or impacts do work has an energy balance of its own,

        d(energy)/dt = power of the forces on its coordinates - dL/dt of the group,

    whose accuracy is not limited by rounding errors of the energies of other groups.
    A model with first-order states, or whose energy events change, is one group.
    """
    g = e.graph
    if e.states or e.is_set:
        return [list(range(len(e.q)))]
    together = [([*nodes, *(e.f[i] for i in own)], own) for nodes, own in e.coupled]
    together += [
        ([row.residual, row.rate, row.b, *row.A.entries.values()], [*row.A.entries])
        for row in e.rows
    ]
    for law in e.laws:
        row, held = law.row, [*law.row.A.entries]
        if law.normal >= 0:  # friction has the contact's multiplier
            held += e.laws[law.normal].row.A.entries
        nodes = [row.residual, row.rate, row.b, *law.given]
        together.append(([*nodes, *row.A.entries.values()], held))
    names = coordinates_of(e)
    found = DisjointSets(len(e.q))
    # Node -> one of the coordinates that it depends on; the others are in its set.
    touched: dict[int, int] = {}

    for node in g.cone(node for nodes, _ in together for node in nodes):
        leaf = g.ops[node] == VARIABLE
        below = map(touched.get, g.args[node])
        j = names.get(str(g.payload(node))) if leaf else found.unite(below)
        if j is not None:
            touched[node] = j
    for nodes, own in together:
        found.unite([*own, *map(touched.get, nodes)])
    return found.sets()


def coordinates_of(e: Equations) -> dict[str, int]:
    """Return the index of each coordinate by its variables' names, q_j and q_j'."""
    return {name: j for names in (e.q, e.velocities) for j, name in enumerate(names)}


def shared(
    e: Equations, found: Sequence[Sequence[int]], node: int
) -> tuple[list[int], int]:
    """Divide a sum among decoupled groups of coordinates.

    A term that depends on several groups and cannot be expanded into a sum is added to
    the share of each of these groups.

    Parameters
    ----------
    found : sequence of sequence of int
        The coordinates of each group, by their indices.
    node : int
        The sum.

    Returns
    -------
    shares : list of int
        A node for each group.
    rest : int
        The terms that depend on t and on no group; constants are left out.
    """
    g = e.graph
    group_of = {j: i for i, group in enumerate(found) for j in group}
    names = {name: group_of[j] for name, j in coordinates_of(e).items()}
    given, factors = [g.zero] * len(found), {node: g.one}
    rest = g.zero
    cone = g.cone([node])
    owners = owners_of(g, cone, names)
    for n in reversed(cone):
        factor = factors.get(n)
        if factor is None:
            continue
        if owners[n] == NOBODY:
            if "t" in g.depends([factor, n]):
                rest = g.call("add", rest, g.call("mul", factor, n))
            continue
        if owners[n] == SEVERAL and (addends := _addends(g, n, factor, owners)):
            for a, c in addends:
                factors[a] = g.call("add", factors.get(a, g.zero), c)
            continue
        term = g.call("mul", factor, n)
        own = {owners[n]}
        if owners[n] == SEVERAL:
            own = {names[name] for name in g.depends([n]) if name in names}
        for i in own:
            given[i] = g.call("add", given[i], term)
    return given, rest


def owners_of(
    g: Graph, cone: Iterable[int], names: Mapping[str, int]
) -> dict[int, int]:
    """Return the group that each node depends on, or NOBODY or SEVERAL.

    Parameters
    ----------
    cone : iterable of int
        The nodes, arguments before the operations on them.
    names : mapping
        The index of the group of each variable, by the variable's name.
    """
    found: dict[int, int] = {}
    for n in cone:
        if g.ops[n] == VARIABLE:
            found[n] = names.get(str(g.payload(n)), NOBODY)
        else:
            below = {found[a] for a in g.args[n]} - {NOBODY}
            found[n] = SEVERAL if len(below) > 1 else below.pop() if below else NOBODY
    return found


def _addends(
    g: Graph, n: int, factor: int, owners: Mapping[int, int]
) -> list[tuple[int, int]]:
    """Return the terms of `factor * n` as pairs (node, factor); [] where n is no sum.

    Factors that depend on no group are moved into `factor`; owners : see `owners_of`.
    """
    op, args = g.ops[n], g.args[n]
    if op in ("add", "sub"):
        other = factor if op == "add" else g.call("neg", factor)
        return [(args[0], factor), (args[1], other)]
    if op == "neg":
        return [(args[0], g.call("neg", factor))]
    if op == "mul" and NOBODY in (owners[args[0]], owners[args[1]]):
        fixed, one = sorted(args, key=lambda a: owners[a] != NOBODY)
        return [(one, g.call("mul", factor, fixed))]
    if op == "div" and owners[args[1]] == NOBODY:
        return [(args[0], g.call("div", factor, args[1]))]
    return []


def works_of(e: Equations, Q: Sequence[int], dL_dt: int) -> tuple[Work, ...]:
    """Return the work on each decoupled group of coordinates, or the total work.

    Parameters
    ----------
    e : Equations
        The equations, still without works.
    Q : sequence of int, length n
        The generalized forces.
    dL_dt : int
        The partial derivative of L by t.

    Returns
    -------
    tuple of Work
        Empty where neither forces, constraints, events nor impacts can change the
        energy.
    """
    g, model = e.graph, e.model
    acts = bool(model.forces) or model.dissipation is not None or dL_dt != g.zero
    acts = acts or any(row.transport != g.zero for row in e.rows) or bool(e.laws)
    acts = acts or e.is_set or any(may_strike(e, row) for row in e.rows)
    acts = acts or model.kicks
    # L may depend on time in each group and not as a whole: seen from a moving frame.
    timed = bool(g.dependent([model.lagrangian], ("t",)))
    found = groups(e)
    if len(found) > 1 and (acts or timed):
        several = _of_groups(e, Q, timed, found)
        if several:
            return several
    if not acts:
        return ()
    everything = list(range(len(e.q)))
    return (Work(WORK, frozenset(e.q), _power(e, Q, dL_dt, everything), e.energy),)


def may_strike(e: Equations, row: Row) -> bool:
    """Whether the rate of a constraint may jump: an impact, which takes energy."""
    return may_jump(e, [row.rate])


def may_jump(e: Equations, nodes: Sequence[int]) -> bool:
    """Whether a node may jump: by a switch, or by a mode of the file."""
    g, cone = e.graph, deciding_cone(e.graph, nodes)
    if not e.model.modes.isdisjoint(g.depends(nodes)):
        return True
    return any((known := OPERATIONS.get(g.ops[n])) and known.switch for n in cone)


def _of_groups(
    e: Equations, Q: Sequence[int], timed: bool, found: Sequence[list[int]]
) -> tuple[Work, ...]:
    """Return the work of each group with power or impacts.

    () where terms mix groups.
    """
    g = e.graph
    energies, _ = shared(e, found, e.energy)
    rates, left = [g.zero] * len(found), g.zero
    if timed:
        parts, rest = shared(e, found, e.model.lagrangian)
        *rates, left = (
            gradient(g, part, [g.variable("t")])[0] for part in (*parts, rest)
        )
    # Impacts may do work on the coordinates of these rows.
    met = [law.row for law in e.laws] + [x for x in e.rows if may_strike(e, x)]
    struck = {j for row in met for j in row.A.entries}
    if e.model.kicks:
        kicks = generalized_impulses(e)
        struck |= {j for kick in kicks for j, x in enumerate(kick) if x != g.zero}
    made: list[Work] = []
    for group, energy, late in zip(found, energies, rates, strict=True):
        own = {names[j] for names in (e.q, e.velocities) for j in group}
        others = {*e.state} - own
        power = _power(e, Q, late, group)
        if g.depends([energy, power]) & others:
            return ()
        if power != g.zero or not struck.isdisjoint(group):
            name = f"{WORK}.{e.q[group[0]]}"
            coordinates = frozenset(e.q[j] for j in group)
            made.append(Work(name, coordinates, power, energy))
    if left != g.zero:
        rate = g.call("neg", left)
        made.append(Work(f"{WORK}.t", frozenset(), rate, g.zero))
    return (made[0]._replace(name=WORK),) if len(made) == 1 else tuple(made)


def _power(e: Equations, Q: Sequence[int], dL_dt: int, some: Sequence[int]) -> int:
    """Return the node of the power of all forces on the coordinates `some`.

    The partial derivative dL_dt is subtracted: d(energy)/dt is this power.
    """
    g, among = e.graph, {*some}
    rates = [g.variable(name) for name in e.velocities]
    power = g.product_sum((Q[j], rates[j]) for j in some)
    power = g.call("sub", power, dL_dt)
    for row in e.rows:
        if row.transport != g.zero and row.A.entries.keys() <= among:
            term = g.call("mul", g.variable(MULTIPLIER.of(row.name)), row.transport)
            power = g.call("add", power, term)
    for law in e.laws:
        if law.row.A.entries.keys() <= among:
            term = g.call("mul", g.variable(law.multiplier), law.moved(g, rates))
            power = g.call("add", power, term)
    return power


# A condition that is false by less than this part of its change by an act counts as
# true: the difference is rounding.
FALSE = 1e-9
# Greatest number of acts of events at a start.
MOST_ACTS = 1000


def _begin(e: Equations, values: dict[str, float]) -> Begun:
    """Execute the events that act at a start.

    values : the values of all names at the start, changed in place.
    """
    g, model = e.graph, e.model
    impulses = generalized_impulses(e) if model.kicks else []
    given = [0.0] * len(e.q)
    located = [k for k, x in enumerate(model.events) if x.at is not None]
    due = [k for k, x in enumerate(model.events) if x.at is None]
    modes = {mode for x in model.events for mode, _ in x.sets}
    acts: list[str] = []
    rounds: list[tuple[list[str], dict[str, float]]] = []
    spent: set[int] = set()
    is_over = False
    while due:
        before = evaluate(g, [x.node for x in model.located], values)
        events = [model.events[k] for k in due]
        former = {mode: values[mode] for mode in modes}
        for k, event in zip(due, events, strict=True):
            if event.impulses:
                one = evaluate(g, impulses[k], values)
                given = [a + float(b) for a, b in zip(given, one, strict=True)]
            found = evaluate(g, [node for _, node in event.sets], values)
            values |= zip((mode for mode, _ in event.sets), found, strict=True)
        acts += [event.name for event in events]
        spent.update(k for k in due if model.events[k].once)
        now, seen = {mode: values[mode] for mode in modes}, [x for _, x in rounds]
        rounds.append(([event.name for event in events], former))
        if any(event.at is None or event.once for event in events):
            rounds.clear()  # they act once, so no cycle contains this round
        elif (now != former and now in seen) or len(acts) > MOST_ACTS:
            cycle = rounds[seen.index(now) if now in seen else 0 :]
            return Begun(tuple(acts), tuple(x for names, _ in cycle for x in names))
        after = evaluate(g, [x.node for x in model.located], values)
        rows = zip(model.located, before, after, strict=True)
        true = [k for k, (x, a, b) in enumerate(rows) if _comes(x.equality, a, b)]
        is_over |= len(located) in true
        # An event's own act does not make its condition true.
        spared = spent.union(due)
        due = [located[k] for k in true if k < len(located)]
        due = [k for k in due if k not in spared]
    kicked = tuple(given) if any(given) else ()
    return Begun(tuple(acts), is_over=is_over, impulses=kicked)


def _comes(equality: bool, before: float, after: float) -> bool:
    """Whether a condition changed from false to true between two values.

    equality : whether it is an equation, true where its value crosses 0.
    """
    least = FALSE * abs(after - before)
    if equality and before > 0.0:
        before, after = -before, -after
    return before < -least and after >= -least
