"""Fewer equations for the same motion: what is left out is recovered for the rows.

*Elimination.* A holonomic constraint a q_e + r(q, t) = 0 with a constant a gives
q_e = Q(q, t) of the coordinates left, q_e' = J q' + Q_t and q_e'' = J q'' + c. With
q'_full = (1, J) q' the equations left are

    (1, J)^T M (1, J) q'' = (1, J)^T (f - M c) + ...,      A (1, J) q'' = b - A c

and row e of the full ones gives the multiplier: a lambda = M q'' - f - A^T lambda_rest.

*Ignorable coordinates.* A coordinate in which neither L nor the constraints stand, and
on which no force acts, keeps its momentum dL/dq_c'. The velocity follows from it, the
acceleration from row c, and the coordinate is a quadrature, integrated beside `work`.

Sources: H. Goldstein, Classical Mechanics, 2nd ed., section 8-3 (Routh's procedure);
E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, section VII.1
(state-space form).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.equations import Equations, Quadrature
from lagsim.expressions.derivatives import gradient, tangent
from lagsim.expressions.evaluate import evaluate
from lagsim.expressions.functions import OPERATIONS
from lagsim.kkt.straight import Factorisation, Meter
from lagsim.model import Parameter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.admissibility import Start
    from lagsim.constraints import Row
    from lagsim.native.kernel_types import Floats


@dataclass(frozen=True, slots=True)
class Reduction:
    """The equations that are integrated, and what they leave out.

    Attributes
    ----------
    equations : Equations
        On the graph of the full ones.
    recovered : dict of int to int
        Variables that are left out (q_e, its rates, its multiplier) -> expressions of
        those that are integrated, their accelerations and multipliers.
    eliminated : tuple of (str, str)
        Coordinates, and the constraints that give them.
    ignored : tuple of str
        The ignorable coordinates.
    momenta : dict of str to int
        The parameter that each of their momenta is -> its node in the full state.
    """

    equations: Equations
    recovered: Mapping[int, int] = field(default_factory=dict)
    eliminated: tuple[tuple[str, str], ...] = ()
    ignored: tuple[str, ...] = ()
    momenta: Mapping[str, int] = field(default_factory=dict)

    def eliminate(self, row: int, coordinate: int) -> Reduction:
        """Express a coordinate by the others, by means of a constraint that `gives`."""
        e = self.equations
        names = (e.q[coordinate], e.rows[row].name)
        equations, recovered = _eliminated(e, row, coordinate)
        return replace(
            self._followed_by(equations, recovered),
            eliminated=(*self.eliminated, names),
        )

    def ignore(self, coordinates: Sequence[int], start: Start) -> Reduction:
        """Integrate `coordinates`, which are `ignorable`, by quadrature.

        Of the full equations only: first of all.
        """
        e = self.equations
        momenta = {momentum_of(e.q[c]): e.momenta[c] for c in coordinates}
        equations, recovered = _ignored(e, coordinates)
        reduction = replace(
            self._followed_by(equations, recovered),
            ignored=tuple(e.q[c] for c in coordinates),
            momenta=momenta,
        )
        model = equations.model
        added = tuple(Parameter(*x) for x in reduction.constants(start).items())
        model = replace(model, parameters=(*model.parameters, *added))
        return replace(reduction, equations=replace(equations, model=model))

    def kept(self, full: Floats) -> Floats:
        """Give the values (n,) of the coordinates left, or of their rates."""
        names = [c.name for c in self.equations.model.coordinates]
        return full[[names.index(name) for name in self.equations.q]]

    def constants(self, start: Start) -> dict[str, float]:
        """Give the values of the momenta at a full start."""
        model = self.equations.model
        values = {p.name: p.value for p in model.parameters} | {"t": start.t}
        for k, c in enumerate(model.coordinates):
            values |= {c.name: start.q[k], f"{c.name}_dot": start.v[k]}
        found = evaluate(model.graph, list(self.momenta.values()), values)
        return dict(zip(self.momenta, found, strict=True))

    def state(self, start: Start) -> Floats:
        """Give y at a full start: q, q', work, the ignorable coordinates."""
        e = self.equations
        names = [c.name for c in e.model.coordinates]
        ignored = [start.q[names.index(x.name)] for x in e.quadratures]
        work = [] if e.power is None else [0.0]
        parts = (self.kept(start.q), self.kept(start.v), work, ignored)
        return np.concatenate(parts)

    def _followed_by(
        self, equations: Equations, recovered: Mapping[int, int]
    ) -> Reduction:
        g = equations.graph
        earlier = g.substitute(self.recovered.values(), recovered)
        whole = dict(zip(self.recovered, earlier, strict=True)) | dict(recovered)
        return replace(self, equations=equations, recovered=whole)


def momentum_of(coordinate: str) -> str:
    """Give the name of the parameter that the momentum of a coordinate becomes."""
    return f"momentum.{coordinate}"


def given_by(equations: Equations, row: Row) -> list[int]:
    """Give the coordinates in which `row` is affine with a constant factor, not 0.

    Relations with switches are left alone: where their rate jumps, all velocities do.
    """
    g = equations.graph
    if not row.holonomic or _switches(equations, row.residual):
        return []
    moving = frozenset((*equations.q, *equations.velocities, "t"))
    found = [
        c
        for c, factor in enumerate(row.A)
        if factor != g.zero and not g.depends([factor]) & moving
    ]
    values = {p.name: p.value for p in equations.model.parameters}
    factors = evaluate(g, [row.A[c] for c in found], values)
    return [
        c
        for c, factor in zip(found, factors, strict=True)
        if factor and math.isfinite(factor)
    ]


def _switches(equations: Equations, node: int) -> bool:
    g = equations.graph
    rows = (OPERATIONS.get(g.ops[n]) for n in g.cone([node]))
    return any(row is not None and (row.switch or row.condition) for row in rows)


def ignorable(equations: Equations) -> list[int]:
    """Give the coordinates whose momentum is conserved, as far as the graph shows it.

    At least one other coordinate is left.
    """
    e, g = equations, equations.graph
    nodes = [node for row in e.M for node in row]
    nodes += [*e.f, e.energy, *e.momenta]
    nodes += [] if e.power is None else [e.power]
    for row in e.rows:
        nodes += [row.residual, row.rate, row.b, *row.A]
    seen = g.depends(nodes)
    found = [
        c
        for c, name in enumerate(e.q)
        if name not in seen
        and all(row.A[c] == g.zero for row in e.rows)
        and e.M[c][c] != g.zero
    ]
    if not found:
        return []
    # f = -(d/dt dL/dq' at q'' = 0) there, and nothing else.
    flow = _flow(e)
    flows = tangent(g, [e.momenta[c] for c in found], flow)
    free = [
        c
        for c, rate in zip(found, flows, strict=True)
        if e.f[c] == g.call("sub", g.zero, rate)
    ]
    among = frozenset(e.velocities[c] for c in free)
    if g.depends([e.M[c][d] for c in free for d in free]) & among:
        return []
    return free if len(free) < len(e.q) else free[1:]


def _flow(e: Equations) -> dict[int, int]:
    """Give the rate of each variable that moves, but for the velocities."""
    g = e.graph
    flow = dict(zip(map(g.variable, e.q), map(g.variable, e.velocities), strict=True))
    flow[g.variable("t")] = g.one
    return flow


def _eliminated(e: Equations, k: int, c: int) -> tuple[Equations, dict[int, int]]:
    g, row = e.graph, e.rows[k]
    left = [j for j in range(len(e.q)) if j != c]
    at_zero = g.substitute([row.residual], {g.variable(e.q[c]): g.zero})[0]
    value = g.call("neg", g.call("div", at_zero, row.A[c]))
    J = gradient(g, value, [g.variable(e.q[j]) for j in left])
    flow = _flow(e)
    [rate] = tangent(g, [value], flow)
    [bend] = tangent(g, [rate], flow)
    new = {g.variable(e.q[c]): value, g.variable(e.velocities[c]): rate}
    accelerations = [g.variable(f"{e.q[j]}_ddot") for j in left]
    acceleration = g.call(
        "add", g.product_sum(zip(J, accelerations, strict=True)), bend
    )
    full = _substituted(e, new)
    rows = tuple(
        replace(
            other,
            A=tuple(_plus(e, other.A[j], J[i], other.A[c]) for i, j in enumerate(left)),
            b=_minus(e, other.b, other.A[c], bend),
        )
        for other in full.rows
        if other.name != row.name
    )
    multiplier = _multiplier(full, rows, k, c, acceleration)
    recovered = new | {
        g.variable(f"{e.q[c]}_ddot"): acceleration,
        g.variable(f"lambda_{row.name}"): multiplier,
    }
    force = _minus(e, full.f[c], full.M[c][c], bend)
    f = [
        _plus(e, _minus(e, full.f[j], full.M[j][c], bend), J[i], force)
        for i, j in enumerate(left)
    ]
    power = full.power
    if power is not None:
        power = g.substitute([power], recovered)[0]
    reduced = replace(
        full,
        q=tuple(e.q[j] for j in left),
        velocities=tuple(e.velocities[j] for j in left),
        M=_symmetric(len(left), lambda i, j: _mass(full, left, c, J, i, j)),
        f=tuple(f),
        rows=rows,
        momenta=tuple(
            _plus(e, full.momenta[j], J[i], full.momenta[c]) for i, j in enumerate(left)
        ),
        power=power,
    )
    return reduced, recovered


def _mass(
    e: Equations, left: Sequence[int], c: int, J: Sequence[int], i: int, j: int
) -> int:
    """Give an entry of (1, J)^T M (1, J)."""
    a, b = left[i], left[j]
    across = _plus(e, e.M[c][b], e.M[c][c], J[j])
    return _plus(e, _plus(e, e.M[a][b], e.M[a][c], J[j]), J[i], across)


def _multiplier(
    full: Equations, others: Sequence[Row], k: int, c: int, acceleration: int
) -> int:
    """Give lambda from row c of the full equations, where `others` are not reduced."""
    g, row = full.graph, full.rows[k]
    known = {c: acceleration}
    moved = g.product_sum(
        (full.M[c][j], known.get(j, g.variable(f"{q}_ddot")))
        for j, q in enumerate(full.q)
        if full.M[c][j] != g.zero
    )
    left = g.call("sub", moved, full.f[c])
    kept = {other.name for other in others}
    for other in full.rows:
        if other.name in kept:
            lam = g.variable(f"lambda_{other.name}")
            left = _minus(full, left, other.A[c], lam)
    return g.call("div", left, row.A[c])


def _ignored(
    e: Equations, coordinates: Sequence[int]
) -> tuple[Equations, dict[int, int]]:
    g = e.graph
    left = [j for j in range(len(e.q)) if j not in coordinates]
    speeds = [g.variable(e.velocities[c]) for c in coordinates]
    names = [momentum_of(e.q[c]) for c in coordinates]
    count = range(len(coordinates))
    at_rest = g.substitute(
        [e.momenta[c] for c in coordinates], dict.fromkeys(speeds, g.zero)
    )
    solved = _factored(e, coordinates).solve(
        {k: g.call("sub", g.variable(names[k]), at_rest[k]) for k in count}
    )
    rates = [solved.get(k, g.zero) for k in count]
    full = _substituted(e, dict(zip(speeds, rates, strict=True)))
    factors = _factored(full, coordinates)
    Z = {
        j: factors.forward({k: full.M[c][j] for k, c in enumerate(coordinates)})
        for j in left
    }
    F = factors.forward({k: full.f[c] for k, c in enumerate(coordinates)})

    def without(node: int, z: Mapping[int, int], other: Mapping[int, int]) -> int:
        for k in sorted(z.keys() & other.keys()):
            part = g.call("mul", g.call("mul", z[k], factors.inverse[k]), other[k])
            node = g.call("sub", node, part)
        return node

    right = {k: _sum_less(full, full.f[c], c, left) for k, c in enumerate(coordinates)}
    bends = factors.solve(right)
    recovered = dict(zip(speeds, rates, strict=True)) | {
        g.variable(f"{e.q[c]}_ddot"): bends.get(k, g.zero)
        for k, c in enumerate(coordinates)
    }
    quadratures = tuple(
        Quadrature(e.q[c], rate, full.M[c][c])
        for c, rate in zip(coordinates, rates, strict=True)
    )
    reduced = replace(
        full,
        q=tuple(e.q[j] for j in left),
        velocities=tuple(e.velocities[j] for j in left),
        M=_symmetric(
            len(left),
            lambda i, j: without(full.M[left[i]][left[j]], Z[left[i]], Z[left[j]]),
        ),
        f=tuple(without(full.f[j], Z[j], F) for j in left),
        rows=tuple(replace(r, A=tuple(r.A[j] for j in left)) for r in full.rows),
        momenta=tuple(full.momenta[j] for j in left),
        quadratures=(*full.quadratures, *quadratures),
    )
    return reduced, recovered


def _factored(e: Equations, coordinates: Sequence[int]) -> Factorisation:
    entries = {
        (i, j): e.M[coordinates[i]][coordinates[j]]
        for i in range(len(coordinates))
        for j in range(i + 1)
        if e.M[coordinates[i]][coordinates[j]] != e.graph.zero
    }
    return Factorisation(e.graph, len(coordinates), entries, Meter())


def _sum_less(e: Equations, node: int, c: int, left: Sequence[int]) -> int:
    """Give `node` less the inertia of row c with the accelerations left."""
    for j in left:
        node = _minus(e, node, e.M[c][j], e.graph.variable(f"{e.q[j]}_ddot"))
    return node


def _plus(e: Equations, node: int, x: int, y: int) -> int:
    return e.graph.call("add", node, e.graph.call("mul", x, y))


def _minus(e: Equations, node: int, x: int, y: int) -> int:
    return e.graph.call("sub", node, e.graph.call("mul", x, y))


def _symmetric(n: int, entry: Callable[[int, int], int]) -> tuple[tuple[int, ...], ...]:
    lower = [[entry(i, j) for j in range(i + 1)] for i in range(n)]
    return tuple(tuple(lower[max(i, j)][min(i, j)] for j in range(n)) for i in range(n))


def _substituted(e: Equations, new: Mapping[int, int]) -> Equations:
    """Give the same equations with variables replaced in every expression."""
    g, n = e.graph, len(e.q)
    simulation = e.model.simulation
    until = simulation.until if simulation else None
    nodes = [node for row in e.M for node in row]
    nodes += [*e.f, *e.momenta, e.energy, e.kinetic_form]
    nodes += [e.power if e.power is not None else g.zero]
    nodes += [until.node if until else g.zero]
    nodes += [node for x in e.quadratures for node in (x.rate, x.mass)]
    for row in e.rows:
        nodes += [row.residual, row.rate, row.b, row.transport, *row.A]
        nodes += [row.residual_scale, row.rate_scale]
    found = iter(g.substitute(nodes, new))

    def take(count: int) -> tuple[int, ...]:
        return tuple(next(found) for _ in range(count))

    M = tuple(take(n) for _ in range(n))
    f, momenta = take(n), take(n)
    energy, kinetic_form, power, until_node = take(4)
    quadratures = tuple(
        replace(x, rate=next(found), mass=next(found)) for x in e.quadratures
    )
    rows = []
    for row in e.rows:
        residual, rate, b, transport = take(4)
        A = take(len(row.A))
        residual_scale, rate_scale = take(2)
        rows.append(
            replace(
                row, residual=residual, rate=rate, A=A, b=b, transport=transport,
                residual_scale=residual_scale, rate_scale=rate_scale,
            )
        )  # fmt: skip
    model = e.model
    if simulation and until:
        seen = replace(simulation, until=replace(until, node=until_node))
        model = replace(model, simulation=seen)
    return replace(
        e, model=model, M=M, f=f, rows=tuple(rows), momenta=momenta, energy=energy,
        kinetic_form=kinetic_form, power=None if e.power is None else power,
        quadratures=quadratures,
    )  # fmt: skip
