"""Reduced equations of motion, by elimination.

A holonomic constraint a q_c + r(q, t) = 0 with constant a determines q_c = Q(q, t) from
the other coordinates q, with q_c' = J q' + Q_t and q_c'' = J q'' + b_c. With B = (1, J)
the full q'' is B q'' + (0, b_c), and the reduced equations are

    B^T M B q'' = B^T (f - M (0, b_c)) + (A B)^T lambda,    A B q'' = b - A (0, b_c)

Row c of the full equations determines the multiplier of the constraint. Constraints are
eliminated one by one, as an elimination may bring another constraint into this form.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, section
VII.1 (state-space form).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.language.columns import MULTIPLIER
from lagsim.language.derivatives import deciding_cone, local_slopes, tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import OPERATIONS
from lagsim.language.intervals import Enclosures
from lagsim.language.names import UNIT_LENGTH, rate_of
from lagsim.language.sparse import SparseVector
from lagsim.mechanics.constraints import MasslessSlider, Row, constraint_row
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.equations import Quadrature, Work
from lagsim.model.model import FirstOrderState, Force, Relation, Transition

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Law
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.methods.parts.parameters import Blocks
    from lagsim.model.model import Model


# The fields of each type that are nodes (a row has slopes A as well).
NODES = {
    Row: ("residual", "rate", "b", "transport", "residual_scale", "rate_scale"),
    Work: ("rate", "energy"),
    Quadrature: ("rate",),
    Force: ("node", "direction"),
    Relation: ("node",),
    FirstOrderState: ("rate",),
}


def substituted(e: Equations, new: Mapping[int, int]) -> Equations:
    """Return the equations with variables replaced in every expression.

    new : node of a variable -> node that replaces it.
    """
    nodes: list[int] = []

    def noted(node: int) -> int:
        nodes.append(node)
        return node

    _mapped(e, noted)
    found = dict(zip(nodes, e.graph.substitute(nodes, new), strict=True))
    return _mapped(e, found.__getitem__)


def _mapped(e: Equations, f: Callable[[int], int]) -> Equations:
    """Return the equations with f(node) in place of each node."""

    def vector_of(x: SparseVector) -> SparseVector:
        entries = {j: f(node) for j, node in x.entries.items()}
        return SparseVector(e.graph, len(x), entries)

    def mapped(x: Any) -> Any:
        return x._replace(**{name: f(getattr(x, name)) for name in NODES[type(x)]})

    def acting(x: Transition) -> Transition:
        sets = tuple((mode, f(node)) for mode, node in x.sets)
        return x._replace(sets=sets, at=x.at and mapped(x.at))

    model, loss, until = e.model, e.model.dissipation, e.model.until
    return replace(
        e,
        model=replace(
            model,
            lagrangian=f(model.lagrangian),
            dissipation=None if loss is None else f(loss),
            forces=tuple(map(mapped, model.forces)),
            until=mapped(until) if until else None,
            events=tuple(map(acting, model.events)),
        ),
        M=tuple(map(vector_of, e.M)),
        f=tuple(map(f, e.f)),
        rows=tuple(mapped(row)._replace(A=vector_of(row.A)) for row in e.rows),
        momenta=tuple(map(f, e.momenta)),
        energy=f(e.energy),
        kinetic_form=f(e.kinetic_form),
        works=tuple(map(mapped, e.works)),
        quadratures=tuple(map(mapped, e.quadratures)),
        states=tuple(map(mapped, e.states)),
        tree=None,
    )


def restricted_equations(
    e: Equations,
    left: Sequence[int],
    M: Mapping[tuple[int, int], int],
    f: Sequence[int],
    momenta: Sequence[int],
) -> Equations:
    """Return equations of the remaining coordinates, with new M, f and momenta.

    Parameters
    ----------
    e
        The equations of all coordinates.
    left
        The indices in e.q of the remaining coordinates.
    M, f, momenta
        The new nodes, by indices in e.q: entries of M, forces, and momenta.
    """
    rows: dict[int, dict[int, int]] = {i: {} for i in left}
    for (i, j), node in M.items():
        if i in rows:
            rows[i][j] = node
    return replace(
        e,
        q=tuple(e.q[j] for j in left),
        velocities=tuple(e.velocities[j] for j in left),
        M=tuple(reduced_vector(e.graph, left, rows[i]) for i in left),
        f=tuple(f[j] for j in left),
        momenta=tuple(momenta[j] for j in left),
    )


def reduced_vector(
    g: Graph, left: Sequence[int], entries: Mapping[int, int]
) -> SparseVector:
    """Return the sparse vector of the entries at the coordinates `left`.

    left : indices of the remaining coordinates among all.
    entries : index among all coordinates -> node.
    """
    place = {j: i for i, j in enumerate(left)}
    kept = {place[j]: node for j, node in entries.items() if j in place}
    return SparseVector(g, len(left), kept)


def plus_product(g: Graph, node: int, x: int, y: int) -> int:
    """Return the node of node + x y."""
    return g.call("add", node, g.call("mul", x, y))


def minus(g: Graph, node: int, x: int, y: int) -> int:
    """Return the node of node - x y."""
    return g.call("sub", node, g.call("mul", x, y))


# Largest ratio, in the metric of M, of the change of an eliminated coordinate to the
# changes of the coordinates that determine it: their errors grow by this ratio.
STEEPEST = 1e3


def eliminable(
    e: Equations, values: Mapping[str, float], sizes: Mapping[str, float]
) -> tuple[int, int] | None:
    """Return the row and the coordinate whose elimination has the least fill.

    None if there is no such pair.

    Parameters
    ----------
    values
        The values of all variables at the start, with which factors are evaluated.
    sizes
        Coordinate -> square root of its diagonal entry of M, or a substitute for it.
    """
    g, moving, modes = e.graph, frozenset(e.moving), e.model.modes
    row_counts = Counter(c for row in e.rows for c in row.A.entries)
    mass = Counter(j for row in e.M for j in row.entries)
    keys = []
    for k, row in enumerate(e.rows):
        still = modes.isdisjoint(g.depends([row.residual]))
        A = row.A.entries if still and usable(g, row, values, moving) else {}
        numbers = evaluate(g, A.values(), values)
        slopes = {c: abs(x) / sizes[e.q[c]] for c, x in zip(A, numbers, strict=True)}
        most = max(slopes.values(), default=0.0)
        # Coordinates of one relation only come first: other relations stay unchanged.
        keys += [
            (
                row_counts[c],
                (len(A) - 1) * (row_counts[c] + mass[c] - 2),
                -x / most,
                k,
                c,
            )
            for c, x in slopes.items()
            if x * STEEPEST > most
            and math.isfinite(most)
            and not g.depends([A[c]]) & moving
        ]
    return min(keys)[3:] if keys else None


# Functions with a value but no slope at an end of their domain, or at 0.
ROOTS = ("sqrt", "cbrt", "pow", "asin", "acos", "acosh")


def usable(
    g: Graph, row: Row, values: Mapping[str, float], moving: Collection[str]
) -> bool:
    """Whether a row can be used to eliminate a coordinate: holonomic, without kinks.

    A jump of the rate of a relation is an impact, at which all velocities jump. At an
    edge (x = 1 of y = sqrt(1 - x)) the relation ends, and the motion of the remaining
    coordinates would rebound.

    values : the values of all variables at the start.
    moving : names of variables that change.
    """
    cone = deciding_cone(g, [row.residual])
    rows = (OPERATIONS.get(g.ops[n]) for n in cone)
    if not row.holonomic or any(x and (x.switch or x.condition) for x in rows):
        return False
    roots = sorted(n for n in g.dependent(cone, moving) if g.ops[n] in ROOTS)
    slopes = [local_slopes(g, n)[0][1] for n in roots]
    line = np.array([[-math.inf], [math.inf]])
    found = zip(roots, Enclosures(g, slopes, values, moving)(*line), strict=True)
    return not any(
        x.partial.any() or (g.ops[n] != "pow" and x.unbounded.any()) for n, x in found
    )


def eliminate_coordinate(
    e: Equations, k: int, c: int
) -> tuple[Equations, dict[int, int]]:
    """Eliminate coordinate c by row k.

    Returns
    -------
    reduced : Equations
        The equations without row k and coordinate c.
    recovered : dict
        Variables q_c, q_c', q_c'' and the multiplier of the row -> their expressions.
    """
    g, flow = e.graph, e.flow
    q = g.variable(e.q[c])
    [rest] = g.substitute([e.rows[k].residual], {q: g.zero})
    value = g.call("neg", g.call("div", rest, e.rows[k].A[c]))
    [rate] = tangent(g, [value], flow.forward)
    [bend] = tangent(g, [rate], flow.forward)
    J = flow.gradient(g, value, by_rates=False).entries
    given = {q: value, g.variable(e.velocities[c]): rate}
    full = substituted(e, given)
    eliminated = bend
    for j, slope in J.items():
        eliminated = plus_product(g, eliminated, slope, g.variable(rate_of(e.q[j], 2)))
    acceleration = g.variable(rate_of(e.q[c], 2))
    lam = g.variable(MULTIPLIER.of(e.rows[k].name))
    # The equation of c without the multiplier, divided by the factor of the multiplier.
    without = {acceleration: eliminated, lam: g.zero}
    [force] = g.substitute([full.motion_residuals()[c]], without)
    multiplier = g.call("div", force, full.rows[k].A[c])
    recovered = given | {acceleration: eliminated, lam: multiplier}
    powers = g.substitute(full.powers, recovered)
    works = (x._replace(rate=rate) for x, rate in zip(full.works, powers, strict=True))

    left = [j for j in range(len(e.q)) if j != c]
    M, f, momenta = full.mass_entries, list(full.f), list(full.momenta)
    own = full.M[c].entries
    for j, x in own.items():
        f[j] = minus(g, f[j], x, bend)
    across = {j: x for j, x in own.items() if j != c}
    _add_products(g, M, across, J)
    for j, slope in J.items():
        across[j] = plus_product(g, across.get(j, g.zero), own.get(c, g.zero), slope)
        f[j] = plus_product(g, f[j], f[c], slope)
        momenta[j] = plus_product(g, momenta[j], momenta[c], slope)
    _add_products(g, M, J, across)
    rows = []
    for row in full.rows[:k] + full.rows[k + 1 :]:
        A = dict(row.A.entries)
        factor = A.pop(c, g.zero)
        for j, slope in J.items():
            A[j] = plus_product(g, A.get(j, g.zero), factor, slope)
        b = minus(g, row.b, factor, bend)
        rows.append(row._replace(A=reduced_vector(g, left, A), b=b))
    unforced = full.unforced - {e.q[j] for j in J}
    reduced = restricted_equations(full, left, M, f, momenta)
    return replace(
        reduced, rows=tuple(rows), works=tuple(works), unforced=unforced
    ), recovered  # fmt: skip


def _add_products(
    g: Graph, M: dict[tuple[int, int], int], x: Mapping[int, int], y: Mapping[int, int]
) -> None:
    """Add the lower triangle of x y^T to M, and its transpose to the upper one."""
    for i, a in x.items():
        for j, b in y.items():
            if j <= i:
                M[i, j] = M[j, i] = plus_product(g, M.get((i, j), g.zero), a, b)


def augmented(e: Equations, rows: Sequence[Row]) -> Equations:
    """Return equations with M + A^T W A and f + A^T W b in place of M and f.

    A is the matrix of the rows `rows`. W is diagonal, of the magnitude of M. q'' and
    lambda are unchanged. The new M is regular if M is positive definite on the null
    space of A; M itself may be singular, for example since the length of a quaternion
    has no inertia.
    """
    g, M, f = e.graph, e.mass_entries, list(e.f)
    inertias = {i: node for (i, j), node in M.items() if i == j}
    for row in rows:
        A = row.A.entries
        own = [inertias[j] for j in A if j in inertias] or list(inertias.values())
        square = g.product_sum((a, a) for a in A.values())
        weight = g.call("div", g.sum(own), square)
        weighted = {j: g.call("mul", weight, a) for j, a in A.items()}
        _add_products(g, M, weighted, A)
        for j, a in weighted.items():
            f[j] = plus_product(g, f[j], a, row.b)
    return restricted_equations(e, range(len(e.q)), M, f, e.momenta)


def with_lengths(e: Equations) -> Equations:
    """Return equations in which the constant lengths of quaternions have inertia.

    Without inertia along these lengths M would be singular.
    """
    rows = [row for row in e.rows if row.name.startswith(UNIT_LENGTH)]
    return augmented(e, rows) if rows else e


# Prefix of the parameter, or column, of a momentum; the coordinate's name follows.
MOMENTUM = "momentum."


def conserved(equations: Equations) -> list[int]:
    """Return the indices of coordinates whose momentum is constant by the equations."""
    e, g = equations, equations.graph
    if e.is_set or e.model.kicks:
        return []  # momenta jump where events set an inertia, or give an impulse
    seen = g.depends([*e.of_motion, e.energy, *e.momenta]) if e.unforced else ()
    inertias = e.inertias
    constrained = {c for A in e.slopes for c in A.entries}
    return [
        c
        for c, name in enumerate(e.q)
        if name in e.unforced
        and name not in seen
        and c not in constrained
        and inertias[c] != g.zero
    ]


class Reduction(NamedTuple):
    """Equations that are integrated, and expressions for all other variables.

    Attributes
    ----------
    equations : Equations
        The reduced equations, on the graph of the full equations.
    recovered : dict of int to int
        Eliminated variables (q_e, its rates, its multiplier) -> expressions of the
        integrated variables, with their accelerations and multipliers.
    eliminated : tuple of (str, str)
        The eliminated coordinates, each with the constraint that determines it.
    """

    equations: Equations
    recovered: Mapping[int, int] = {}
    eliminated: tuple[tuple[str, str], ...] = ()

    def eliminate(
        self, values: Mapping[str, float], sizes: Mapping[str, float]
    ) -> Reduction:
        """Return a reduction without coordinates that are `eliminable`.

        At least one coordinate remains. See `eliminable` for the parameters.
        """
        reduction, names = self, []
        while len(reduction.equations.q) > 1:
            e = reduction.equations
            best = eliminable(e, values, sizes)
            if best is None:
                break
            k, c = best
            names.append((e.q[c], e.rows[k].name))
            reduction = reduction._followed_by(*eliminate_coordinate(e, k, c))
        return reduction._replace(eliminated=tuple(names))

    def independent(self, full: Floats) -> Floats:
        """Return the entries of the remaining coordinates in a vector of all.

        A vector with the length of the remaining coordinates is returned unchanged.

        full : coordinates or velocities, (all coordinates,).
        """
        if len(full) == len(self.equations.q):
            return full
        names = (c.name for c in self.equations.model.coordinates)
        places = {name: k for k, name in enumerate(names)}
        return full[[places[name] for name in self.equations.q]]

    def state(self, start: Instant, blocks: Blocks) -> Floats:
        """Return y, shape (size,), at a full initial state; the works start at 0.

        blocks : the places of the parts of y.
        """
        y = np.zeros(blocks.size)
        y[blocks.positions] = self.independent(start.q)
        y[blocks.velocities], y[blocks.first_order] = self.independent(start.v), start.s
        return y

    def _followed_by(
        self, equations: Equations, recovered: Mapping[int, int]
    ) -> Reduction:
        g = equations.graph
        earlier = g.substitute(self.recovered.values(), recovered)
        whole = dict(zip(self.recovered, earlier, strict=True)) | dict(recovered)
        return self._replace(equations=equations, recovered=whole)


# --- Sliders without mass between springs and dampers: Jenkins and Iwan elements
#
# A coordinate z without inertia, on which a limited relation r = a z' + ... = 0 acts,
# has the equation 0 = f_z + a lambda. This determines the multiplier as a function of
# the state, lambda = -f_z/a, a force on the other coordinates of the relation. The
# motion of z itself follows from one row at a time:
#
#     sticks    r = 0                          while |lambda| <= F
#     slides    |lambda| = F, of two relations also r parallel to lambda
#                                              while -lambda r >= 0
#
# The sliding row is one of positions, or of velocities where dampers act on z; z' jumps
# where sliding begins. Both rows act on z alone: z has inertia 1, and its row a
# separate multiplier, so that neither changes the motion of coordinates with mass.
#
# Sources: G. Jenkin, Engineering 114 (1922) 603; W. D. Iwan, J. Appl. Mech. 33 (1966)
# 893, section 2; J. J. Moreau, Evolution problem associated with a moving convex set,
# J. Diff. Eq. 26 (1977) 347.


def equations_of_motion(model: Model, *, gathers: bool = False) -> Equations:
    """Derive the equations of motion of a model, to be integrated.

    Multipliers of sliders without mass are functions of the state in these equations.

    A slider has a coordinate that is in no other relation, or else only in relations of
    sliders whose coordinate was found before, as in a chain. Other massless coordinates
    remain without inertia, also with a static limit that differs from the dynamic one.

    gathers : whether the equations keep the elements of the model, see
        `derivation.may_gather`.
    """
    e = derive(model, gathers=gathers)
    if not any(law.limited for law in e.laws):
        return e
    multipliers, f = _multipliers(e)
    g, laws, M = e.graph, list(e.laws), list(e.M)
    for k, (j, _) in multipliers.items():
        law, pair = laws[k], laws[k].pair
        if (pair >= 0 and pair not in multipliers) or law.static != law.bound:
            return e  # a massless slider has no motion for a dropping force
        if law.when is not None:  # while not in force, the limit is 0
            limit = g.call("mul", law.when, law.bound)
            law = law._replace(bound=limit, static=limit, when=None)
        made = _slider(e, law, k, j, multipliers)
        if made is None:
            return e
        laws[k] = law._replace(slider=made)
    for j, _ in multipliers.values():
        M[j] = SparseVector(g, len(M), {j: g.one})
        f[j] = g.zero
    new = {g.variable(e.laws[k].multiplier): x for k, (_, x) in multipliers.items()}
    powers = g.substitute(e.powers, new)
    works = (x._replace(rate=rate) for x, rate in zip(e.works, powers, strict=True))
    return replace(e, M=tuple(M), f=tuple(f), laws=tuple(laws), works=tuple(works))


def at_limit(g: Graph, law: Law, force: float) -> int:
    """Return a node that is 0 where the force of a slider reaches its limit.

    force : the present value of the force, whose sign selects one of the two limits.
    """
    slider = law.slider
    assert slider is not None
    if law.pair >= 0:
        return slider.limit
    way = g.constant(math.copysign(1.0, force))
    return g.call("sub", g.call("mul", way, slider.force), law.bound)


def _multipliers(e: Equations) -> tuple[dict[int, tuple[int, int]], list[int]]:
    """Return coordinates and multipliers of sliders without mass, and all forces.

    Returns
    -------
    found : dict
        Index of a law -> its massless coordinate, and the node of its multiplier, which
        the balance of forces on this coordinate determines.
    f : list of int, length n
        Forces with these multipliers inserted.
    """
    g, f = e.graph, list(e.f)
    found: dict[int, tuple[int, int]] = {}
    constrained = {j for row in e.rows for j in row.A.entries}
    left = {j for j, row in enumerate(e.M) if not row.entries} - constrained
    open_laws = dict(enumerate(e.laws))
    going = True
    while going:
        going = False
        for j in sorted(left):
            users = [k for k, law in open_laws.items() if j in law.row.A.entries]
            law = e.laws[users[0]] if len(users) == 1 else None
            if law is None or not law.limited:
                continue
            if law.when is not None and law.pair >= 0:
                continue  # a force of 0 in a plane has no direction to slide in
            A = law.row.A.entries
            force = g.call("neg", g.call("div", f[j], A[j]))
            for i, a in A.items():
                f[i] = g.call("add", f[i], g.call("mul", a, force))
            found[users[0]] = j, force
            del open_laws[users[0]]
            left.remove(j)
            going = True
    return found, f


def _slider(
    e: Equations, law: Law, k: int, j: int, multipliers: Mapping[int, tuple[int, int]]
) -> MasslessSlider | None:
    """Describe law k, on the massless coordinate j, as a slider.

    None if no spring or damper acts between the slider and the rest of the model.

    multipliers : the multipliers of sliders found before, by the index of the law, see
        `_multipliers`.
    """
    g = e.graph
    slip, force, first = law.row.rate, multipliers[k][1], not 0 <= law.pair < k
    way = g.variable(f"slides.{e.laws[k if first else law.pair].constraint}")
    if law.pair < 0:
        size = g.call("abs", force)
        missed = g.call("sub", g.call("mul", way, force), law.bound)
        lost = g.call("mul", way, slip)
    else:
        beside, also = multipliers[law.pair][1], e.laws[law.pair].row.rate
        size = g.call("hypot", force, beside)
        missed = g.call("sub", size, law.bound)
        lost = g.call("div", g.product_sum([(force, slip), (beside, also)]), size)
        if not first:
            across = g.call("mul", beside, slip)
            missed = g.call("sub", g.call("mul", force, also), across)
    row = constraint_row(g, law.row.name, missed, e.flow)
    if row.holonomic:  # states may follow velocities: their rates stand in its rate
        row = row._replace(A=e.flow.gradient(g, row.rate, by_rates=True))
    if row.A.entries.keys().isdisjoint(i for i, _ in multipliers.values()):
        return None
    slides = g.call("gt", g.call("mul", way, way), g.zero)
    limit = g.call("sub", law.bound, size)
    ends = g.call("neg", lost)
    if law.bound in g.dependent([law.bound], e.moving):
        ends = g.call("min", ends, law.bound)  # the limit may not become negative
    left = g.call("if", slides, ends, limit) if first else g.one
    name, solved = str(g.payload(way)), _one_of(g, slides, row, law.row)
    return MasslessSlider(j, force, name, solved, limit, left, first)


def _one_of(g: Graph, slides: int, row: Row, sticks: Row) -> Row:
    """Combine two rows: the result is `row` while `slides` is true, else `sticks`.

    slides : the node of a condition.
    """

    def either(a: int, b: int) -> int:
        return g.call("if", slides, a, b)

    columns = row.A.entries.keys() | sticks.A.entries.keys()
    return sticks._replace(
        holonomic=row.holonomic,
        pfaffian=row.pfaffian and sticks.pfaffian,
        residual=either(row.residual if row.holonomic else g.zero, g.zero),
        rate=either(row.rate, sticks.rate),
        A=SparseVector(
            g, len(row.A), {j: either(row.A[j], sticks.A[j]) for j in columns}
        ),
        b=either(row.b, sticks.b),
        residual_scale=either(row.residual_scale, g.zero),
        rate_scale=either(row.rate_scale, sticks.rate_scale),
    )
