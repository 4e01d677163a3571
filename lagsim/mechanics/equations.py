"""Energies -> the equations of motion, as nodes of the model's graph.

    M q'' = f + A^T lambda,      A q'' = b,      Qc = A^T lambda

with M = d2L/dq'2 and f = dL/dq - d/dt(dL/dq') at q'' = 0, plus the generalized forces.
For lhs = rhs the constraint function is lhs - rhs; this sign of lambda holds all over.
Source: H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints,
eqs 47 and 61; Arnold, Mathematical Methods of Classical Mechanics, sections 12 and 15.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import gradient, tangent
from lagsim.mechanics.constraints import Flow, Row, constraint_row
from lagsim.mechanics.laws import Law, laws_of
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph
    from lagsim.language.sparse import SparseVector
    from lagsim.mechanics.articulated import ChainedMass
    from lagsim.mechanics.chains import Chains
    from lagsim.mechanics.works import Work
    from lagsim.model.model import Model


# The column, and the variable, of the integral of L.
ACTION = "action.S"
# Of so few coordinates the entries of M always take fewer operations than chains.
FEW = 5


class Quadrature(NamedTuple):
    """What stands in no equation: only its rate is integrated.

    A coordinate, or the action. `rate` and `mass` (its entry of M's diagonal; zero for
    the action) are nodes.
    """

    name: str
    rate: int
    mass: int


@dataclass(frozen=True, slots=True)
class Equations:
    """Everything a run needs, as nodes of `graph`.

    Attributes
    ----------
    M : sequence of SparseVector, shape (n, n)
        Symmetric; entries that vanish identically are `graph.zero`. Of a ChainedMass
        they are only made where they are read.
    f : tuple of int, shape (n,)
    rows : tuple of Row, length m
        The equality constraints that always hold.
    laws : tuple of Law
        The rows that hold at times, each with its law.
    momenta : tuple of int, shape (n,)
        dL/dq'.
    energy : int
        The energy function h = sum q' dL/dq' - L.
    energy_is_sum : bool
        h is kinetic + potential.
    kinetic_form : int
        q'^T M q' / 2, which is `kinetic` where that is quadratic.
    works : tuple of Work
        The work done on each group of coordinates, with the multipliers as variables
        `lambda_<c>`; none where the model has nothing that could do work.
    unforced : frozenset of str
        The coordinates on which no force acts and that L does not name: without
        constraints they keep their momenta.
    quadratures : tuple of Quadrature
        What is integrated beside these equations: the action where it is asked for,
        and coordinates, see `reduction`.
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

    def of(self, model: Model) -> Equations:
        """Give the same equations of the model bound to other values."""
        given = {c.name: c.law.restitution for c in model.constraints if c.law}
        laws = self.laws
        if any(law.restitution != given.get(law.constraint, 0.0) for law in laws):
            laws = tuple(law.bouncing(given.get(law.constraint, 0.0)) for law in laws)
        return replace(self, model=model, laws=laws)

    @property
    def nodes(self) -> tuple[object, ...]:
        """The names and nodes of the motion, the same for all values of parameters."""
        rows = (*self.rows, *(law.row for law in self.laws))
        return (
            self.q,
            self.chains.key
            if self.chains
            else tuple(tuple(row.entries.items()) for row in self.M),
            self.f,
            tuple(
                (x.name, x.residual, x.rate, x.b, *x.A.entries.items()) for x in rows
            ),
            len(self.rows),
            self.works,
            self.quadratures,
        )

    @property
    def accelerations(self) -> tuple[str, ...]:
        """The names of the variables q''."""
        return tuple(f"{q}_ddot" for q in self.q)

    @property
    def moving(self) -> tuple[str, ...]:
        """The names of the variables that change along a motion."""
        return (*self.q, *self.velocities, "t")

    @property
    def powers(self) -> list[int]:
        """The rates of the works."""
        return [x.rate for x in self.works]

    @property
    def worked(self) -> list[int]:
        """The work that is done on each coordinate, by its number; or -1."""
        own = {q: k for k, x in enumerate(self.works) for q in x.coordinates}
        return [own.get(q, -1) for q in self.q]

    @property
    def work(self) -> int:
        """Their sum: a node."""
        return self.graph.sum(self.graph.variable(x.name) for x in self.works)

    @property
    def quadrature_rates(self) -> list[int]:
        """The rates of what follows the velocities in y: works, then `quadratures`."""
        return [*self.powers, *(x.rate for x in self.quadratures)]

    @property
    def multipliers(self) -> tuple[str, ...]:
        """The names of the variables lambda: of the rows, then of the laws."""
        names = (f"lambda_{row.name}" for row in self.rows)
        return (*names, *(law.multiplier for law in self.laws))

    @property
    def slopes(self) -> tuple[SparseVector, ...]:
        """A of all rows, in the order of the multipliers."""
        return tuple(row.A for row in (*self.rows, *(law.row for law in self.laws)))

    def row(self, name: str) -> Row:
        """Give the row of a constraint."""
        rows = (*self.rows, *(law.row for law in self.laws))
        return next(row for row in rows if row.name == name)

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
        """The chains that M is solved along; None where its entries are."""
        return None if isinstance(self.M, tuple) else self.M.chains

    @property
    def mass_nodes(self) -> list[int]:
        """What M is made of: its entries, or the factors in its chains."""
        chains = self.chains
        return list(self.mass_entries.values()) if chains is None else chains.nodes

    @property
    def inertias(self) -> list[int]:
        """The diagonal of M."""
        if isinstance(self.M, tuple):
            return [row[j] for j, row in enumerate(self.M)]
        return list(self.M.diagonal)

    @property
    def coupled(self) -> list[tuple[list[int], list[int]]]:
        """Coordinates that M couples, in sets that may overlap: its nodes, and they."""
        if (chains := self.chains) is not None:
            return chains.groups()
        rows = (row.entries for row in self.M)
        return [([*x.values()], [i, *x]) for i, x in enumerate(rows)]

    def mass_times(self, x: Sequence[int]) -> list[int]:
        """Give M x (n,)."""
        if (chains := self.chains) is not None:
            return chains.product(self.graph, x)
        return [
            self.graph.product_sum((m, x[j]) for j, m in row.entries.items())
            for row in self.M
        ]

    def constraint_forces(self) -> list[int]:
        """Give Qc = A^T lambda, with the multipliers as variables."""
        g = self.graph
        forces = [g.zero] * len(self.q)
        for A, name in zip(self.slopes, self.multipliers, strict=True):
            lam = g.variable(name)
            for j, entry in A.entries.items():
                forces[j] = g.call("add", forces[j], g.call("mul", entry, lam))
        return forces

    def motion_residuals(self) -> list[int]:
        """Give M q'' - f - A^T lambda (n,) and A q'' - b (m,).

        With q'' and lambda as variables.
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


def derive(model: Model, *, chained: bool = True) -> Equations:
    """Derive the equations of motion of `model`.

    Parameters
    ----------
    chained
        M may stay in the chains that bodies hang in, where these take fewer operations.
    """
    from lagsim.mechanics.mass import mass_matrix
    from lagsim.mechanics.works import works_of

    g = model.graph
    q = tuple(c.name for c in model.coordinates)
    velocities = tuple(f"{name}_dot" for name in q)
    flow = Flow(g, q, velocities)
    positions, rates = flow.positions, flow.rates
    time = g.variable("t")

    slopes = gradient(g, model.lagrangian, [*rates, *positions, time])
    momenta, dL_dq, dL_dt = slopes[: len(q)], slopes[len(q) : -1], slopes[-1]
    chains = None
    if chained and len(q) > FEW and all(c.always for c in model.constraints):
        from lagsim.mechanics import articulated, bias  # of many links

        chains = articulated.shorter_chains(g, model.lagrangian, rates, velocities)
    entries = partial(mass_matrix, g, momenta, rates)
    M = articulated.ChainedMass(g, chains, entries) if chains else entries()
    Q = generalized_forces(g, model, flow)
    if chains:
        pushes = bias.inertial_forces(model, flow)
    else:
        convective = tangent(g, momenta, flow.forward)
        pushes = [g.call("sub", a, c) for a, c in zip(dL_dq, convective, strict=True)]
    f = [g.call("add", a, force) for a, force in zip(pushes, Q, strict=True)]
    if isinstance(M, tuple) and _turns(g, model):
        from lagsim.mechanics.inertia import in_fewer_terms

        M, f = in_fewer_terms(g, model, flow, M, f, convective, Q)
    plain = [c for c in model.constraints if c.always]
    rows = tuple(constraint_row(g, c.name, c.relation.node, flow) for c in plain)
    laws = tuple(laws_of(g, model.constraints, flow))
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
        quadratures=_action(g, model),
        laws=laws,
    )
    found = replace(found, works=works_of(found, Q, dL_dt))
    if chains and is_sum:
        return found
    form = g.product_sum(zip(rates, found.mass_times(rates), strict=True))
    return replace(found, kinetic_form=g.call("mul", g.constant(0.5), form))


def _turns(g: Graph, model: Model) -> bool:
    """Tell whether sines and cosines stand in the kinetic energy."""
    cone = [] if model.kinetic is None else g.cone([model.kinetic])
    return any(g.ops[node] in ("sin", "cos") for node in cone)


def _action(g: Graph, model: Model) -> tuple[Quadrature, ...]:
    if not model.output.action:
        return ()
    return (Quadrature(ACTION, model.lagrangian, g.zero),)


def generalized_forces(g: Graph, model: Model, flow: Flow) -> list[int]:
    """Give Q_j: virtual work of the forces, and -dF/dq' of the dissipation."""
    Q = [g.zero] * len(flow.rates)
    for force in model.forces:
        by_rates = force.level is not Level.POSITION
        levers = flow.gradient(g, force.direction, by_rates=by_rates)
        for j, lever in levers.entries.items():
            Q[j] = g.call("add", Q[j], g.call("mul", force.node, lever))
    if model.dissipation is not None:
        losses = flow.gradient(g, model.dissipation, by_rates=True)
        for j, loss in losses.entries.items():
            Q[j] = g.call("sub", Q[j], loss)
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
        if quadratic is not None and quadratic <= frozenset((2,)):
            static = not g.depends([model.potential]) & velocities
            if static:
                return g.call("add", model.kinetic, model.potential), True
    moved = g.product_sum(zip(rates, momenta, strict=True))
    return g.call("sub", moved, model.lagrangian), False
