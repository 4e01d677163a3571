"""Accelerations of masses on massless links, by the tensions of the links.

Treat the sums of `chains` as additional velocities s beside q'. Where L has constant
masses, Newton's law of each velocity u that is squared in L is

    m_u u'' = force_u + constraint forces on u,    s_k'' = sum c_ki u_i'' + drift_k

Joints without inertia transmit forces. The forces F on sums that contain massless
velocities v satisfy c_v F = 0 for each v. With one sum more than velocities, they have
one direction E, c_v E = 0, along the link; with as many sums as velocities they are 0.
The force that acts on v alone has the direction N_v, c_v N_v = 1, orthogonal to E and
to the c of the other velocities. With the tensions x of the links, the matrix C of all
c_ki, and the massless velocities theta' on which the forces `torque` act,

    u'' = (force + C^T F) / m,    F = E x + N torque,    c E = 0,    c N = 1,
    E^T C u'' = E^T drift,    theta'' = N^T (C u'' - drift).

M is never formed. The matrix S of S x = r for the tensions x is a sum of squares of the
forces on each mass, x^T S x = sum over u of w_u (sum over t of p_tu x_t)^2, where p_tu
is the force on mass u by a unit tension x_t, and w_u = 1/m_u up to units. Squares in
the same x_t form a group, and while an x_t is in one group alone, Lagrange's identity

    |p_i|^2 |p_t|^2 - (p_i p_t)^2 = sum over u < v of (p_iu p_tv - p_iv p_tu)^2

yields the Schur complement of x_t as sums of positive terms, without cancellation. For
equal links in the plane S is the tridiagonal matrix of textbooks, 2 on the diagonal and
-cos(a_k - a_k+1) beside it.

Source: A. Fijany, I. Sharf and G. M. T. D'Eleuterio, IEEE Transactions on Robotics and
Automation 11 (1995) 389: the constraint force algorithm.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations, combinations_with_replacement, product
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import rate_of, slopes, tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.forms import common_factor, fewer_terms, normal_form
from lagsim.language.graph import memoize
from lagsim.language.sparse import Budget, DisjointSets
from lagsim.mechanics.chains import (
    Factorisation,
    Vector,
    add_to,
    chains,
    rates_of_places,
)
from lagsim.mechanics.constraints import Flow
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.chains import Chains
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model


class NewtonsLaws(NamedTuple):
    """Newton's law of each unknown: velocities 0 to n - 1, then the sums.

    Attributes
    ----------
    sums : dict
        Sum k -> unknown i -> factor c_ki (node).
    masses, forces : dict
        Unknown -> its mass, and its force (nodes), if not 0.
    drifts : dict
        Sum -> its rate (node) for constant velocities.
    """

    sums: dict[int, Vector]
    masses: Vector
    forces: Vector
    drifts: Vector


def newtons_laws(e: Equations) -> NewtonsLaws | None:
    """Return Newton's laws of all unknowns.

    None if masses vary, are coupled, or belong to sums that are not rates of positions.
    """
    g, model = e.graph, e.model
    if e.q != tuple(c.name for c in model.coordinates):
        return None  # reduced
    flow = Flow(g, e.q, e.velocities)
    moving = (*e.q, "t")
    found = chains(g, model.lagrangian, flow.rates, flow.velocities, moving)
    if found is None:
        return None
    # Variables replace the sums and their integrals.
    rates, places = dict(enumerate(flow.rates)), dict(enumerate(flow.positions))
    new, back = Vector(), Vector()
    for k, rate in enumerate(found.rates, found.size):
        rates[k] = new[rate] = g.variable(f"rate.{k}")
        back[rates[k]] = rate
    for k, (place, sign) in _places(g, model, flow, found).items():
        places[k] = g.variable(f"place.{k}")
        new[place] = g.call("mul", sign, places[k])
        back[places[k]] = g.call("mul", sign, place)
    works = [(x.node, x.level, x.direction) for x in model.forces]
    if model.dissipation is not None:
        works.append((g.constant(-1.0), Level.VELOCITY, model.dissipation))
    written = g.substitute([model.lagrangian, *(x for _, _, x in works)], new)
    variables = frozenset((*rates.values(), *places.values(), g.variable("t")))
    slope, *directions = (slopes(g, x, variables) for x in written)
    momenta = {u: slope[v] for u, v in rates.items() if v in slope}
    inertias = {u: slopes(g, x, variables) for u, x in momenta.items()}
    masses = {u: x.get(rates[u], g.zero) for u, x in inertias.items()}
    alone = all(len(x) == 1 and masses[u] != g.zero for u, x in inertias.items())
    varying = g.depends(masses.values()) & g.depends(variables)
    if not alone or varying or not masses.keys() <= places.keys():
        return None
    forces = {u: slope[v] for u, v in places.items() if v in slope}
    for (force, level, _), direction in zip(works, directions, strict=True):
        for u, v in (places if level is Level.POSITION else rates).items():
            if v in direction:
                add_to(g, forces, u, g.call("mul", force, direction[v]))
    pushes = g.substitute(forces.values(), back)
    forces = {u: x for u, x in zip(forces, pushes, strict=True) if x != g.zero}
    return NewtonsLaws(found.named, masses, forces, _drifts(g, flow, found))


def _places(
    g: Graph, model: Model, flow: Flow, found: Chains
) -> dict[int, tuple[int, int]]:
    """Return the sums that are rates of known positions, up to sign.

    The result maps a sum to its position and the sign, 1 or -1, as nodes.

    found : the chains, whose sums they are.
    flow : the variables of the motion and their rates.
    """
    known, minus = rates_of_places(model, model.lagrangian, flow), g.constant(-1.0)
    places = {}
    for k, rate in enumerate(found.rates, found.size):
        place, sign = known.get(rate), g.one
        if place is None:  # (-x)^2 is written as x^2
            place, sign = known.get(g.call("neg", rate)), minus
        if place is not None and g.ops[place] == "neg":  # a + (-b) is written as a - b
            place, sign = g.args[place][0], g.call("neg", sign)
        if place is not None:
            places[k] = place, sign
    return places


def _drifts(g: Graph, flow: Flow, found: Chains) -> Vector:
    """Return the rate (node) of each sum at constant velocities and inner sums.

    found : the chains, whose sums they are.
    flow : the variables of the motion and their rates.
    """
    below = {a for node in found.rates for a in g.args[node]}
    rates = tangent(g, below, flow.forward | dict.fromkeys(found.rates, g.zero))
    known = dict(zip(below, rates, strict=True))
    moved = (rate_of(g, node, known) for node in found.rates)
    return dict(enumerate(moved, found.size))


class MasslessVelocity(NamedTuple):
    """Velocity without inertia.

    Attributes
    ----------
    velocity : int
        The index of the velocity.
    across : dict
        Sum -> component of N times `length` and `square`.
    square : int
        Inner product of `across` with the factors c of the velocity, over `length`.
    length : int
        The common factor of the factors c.
    """

    velocity: int
    across: Vector
    square: int
    length: int


class Joints(NamedTuple):
    """Joints of massless links.

    Attributes
    ----------
    along : list of dict
        The unit direction E in which each link transmits its tension: sum -> component.
    turns : list of MasslessVelocity
        The massless velocities.
    lengths : dict
        Sum -> its constant length.
    """

    along: list[Vector]
    turns: list[MasslessVelocity]
    lengths: Vector


def joints(
    g: Graph, laws: NewtonsLaws, free: Iterable[int], moving: frozenset[str]
) -> Joints | None:
    """Return the joints of massless links; None where a joint is not supported.

    laws : Newton's laws.
    free : the massless velocities.
    moving : the names of variables that change along a motion.
    """
    moved = g.dependent((c for x in laws.sums.values() for c in x.values()), moving)
    found = Joints([], [], {})
    sums_of: dict[int, list[int]] = {u: [] for u in free}
    sets = DisjointSets(1 + max(sums_of, default=-1))
    for k, form in laws.sums.items():
        massless = [i for i in form if i not in laws.masses]
        if k not in laws.masses or any(i not in sums_of for i in massless):
            return None
        if any(form[i] in moved for i in form if i in laws.masses):
            return None  # digits would cancel for a small inertia
        for i in massless:
            sums_of[i].append(k)
            sets.merge(massless[0], i)
        if not massless:
            found.along.append({k: g.one})
    for velocities in sets.sets():
        if velocities[0] in sums_of:
            sums = sorted({k for u in velocities for k in sums_of[u]})
            if not _join(g, found, laws, velocities, sums, moving):
                return None
    return found


def _join(
    g: Graph,
    found: Joints,
    laws: NewtonsLaws,
    velocities: Sequence[int],
    sums: Sequence[int],
    moving: frozenset[str],
) -> bool:
    """Add the joint of massless `velocities` to `found`; return whether there is one.

    There is one if these velocities occur in at most 3 sums of `laws`, and in as many
    sums as there are velocities or one more. In fewer than 3 dimensions, fixed unit
    vectors replace the missing velocities.

    laws : Newton's laws, as sums of products of forces and factors.
    sums : indices of the sums of `laws` in which the velocities occur.
    moving : names of variables that change along a motion.
    """
    flat = 3 - len(sums)
    if flat < 0 or flat + len(velocities) not in (2, 3):
        return False
    factors = [[laws.sums[k].get(u, g.zero) for k in sums] for u in velocities]
    lengths, rests = zip(*(common_factor(g, row) for row in factors), strict=True)
    rows = [[g.zero] * 3 for _ in range(flat)]
    for k, row in enumerate(rows):
        row[len(sums) + k] = g.one
    rows += [[*rest, *[g.zero] * flat] for rest in rests]
    third = rows[2] if len(rows) == 3 else _across(g, rows[0], rows[1], moving)
    if len(rows) == 2:
        found.along.append(dict(zip(sums, third, strict=False)))
    pairs = ((rows[1], third), (third, rows[0]), (rows[0], rows[1]))
    across = [_across(g, a, b, moving) for a, b in pairs[flat : len(rows)]]
    for u, row, turned, length in zip(velocities, rests, across, lengths, strict=True):
        square = g.product_sum(zip(row, turned, strict=False))
        both = dict(zip(sums, turned, strict=False))
        found.turns.append(MasslessVelocity(u, both, square, length))
    still = [x for x in lengths if not g.depends([x]) & moving]
    if still:
        found.lengths.update(dict.fromkeys(sums, still[0]))
    return True


def _across(
    g: Graph, a: Sequence[int], b: Sequence[int], moving: frozenset[str]
) -> list[int]:
    """Return the cross product a x b, divided by its components' common factor.

    moving : names of variables that change along a motion.
    """
    found = [
        g.call("sub", g.call("mul", a[i], b[j]), g.call("mul", a[j], b[i]))
        for i, j in ((1, 2), (2, 0), (0, 1))
    ]
    return common_factor(g, fewer_terms(g, found, moving))[1]


Pair = tuple[int, int]


class Group(NamedTuple):
    """Squares of S that contain one set of unknowns x_i.

    S = sum over u of w_u (sum over i of p_iu x_i)^2, with weights w_u.

    Attributes
    ----------
    members : tuple of int
        The indices i, ascending.
    dots : dict
        (i, j), i <= j -> weighted inner product p_i p_j.
    areas : dict
        (i, j), i < j -> for each u < v: w_u w_v, and p_iu p_jv - p_iv p_ju.
    """

    members: tuple[int, ...]
    dots: dict[Pair, int]
    areas: dict[Pair, list[Pair]]

    @property
    def nodes(self) -> list[int]:
        """All nodes of the group, except weights."""
        areas = (area for found in self.areas.values() for _, area in found)
        return [*self.dots.values(), *areas]


def square_groups(
    g: Graph, pulls: Mapping[int, Vector], weights: Vector
) -> list[Group]:
    """Return the squares of S, grouped by the unknowns that they contain.

    pulls : tension t -> mass u -> coefficient p_tu.
    weights : mass u -> w_u; all nodes.
    """
    groups: dict[tuple[int, ...], Vector] = {}
    for u, tensions in _holders(pulls).items():
        groups.setdefault(tuple(tensions), {})[u] = weights[u]
    found = []
    for members, w in groups.items():
        p = {t: {u: pulls[t][u] for u in w} for t in members}
        pairs = combinations_with_replacement(members, 2)
        dots = {(i, j): weighted(g, p[i], p[j], w) for i, j in pairs}
        areas: dict[Pair, list[Pair]] = {}
        for (i, j), (u, v) in product(combinations(members, 2), combinations(w, 2)):
            terms = g.call("mul", p[i][u], p[j][v]), g.call("mul", p[i][v], p[j][u])
            area = g.call("mul", w[u], w[v]), g.call("sub", *terms)
            areas.setdefault((i, j), []).append(area)
        found.append(Group(members, dots, areas))
    return found


def _holders(pulls: Mapping[int, Vector]) -> dict[int, list[int]]:
    """Return, for each mass u, the tensions t whose pulls act on it: u -> list of t."""
    found: dict[int, list[int]] = {}
    for t, pull in pulls.items():
        for u in pull:
            found.setdefault(u, []).append(t)
    return found


def weighted(g: Graph, one: Vector, other: Vector, weights: Vector) -> int:
    """Return the weighted inner product: the sum of w a b over common entries."""
    terms = (
        (weights[u], g.call("mul", a, other[u])) for u, a in one.items() if u in other
    )
    return g.product_sum(terms)


class Squares(Factorisation):
    """Factorisation of S, a sum of groups of squares.

    The Schur complement of an unknown that is in one group alone is a sum of squares.

    Parameters
    ----------
    found
        The groups.
    new
        Node of the groups -> the node that replaces it.
    """

    def __init__(
        self, g: Graph, found: Sequence[Group], new: Mapping[int, int]
    ) -> None:
        unknowns = {i for group in found for i in group.members}
        rows = [Vector() for _ in range(1 + max(unknowns, default=-1))]
        self.groups, self.new = dict[int, Group](), new
        self.groups_of = [set[int]() for _ in rows]
        for k, group in enumerate(found):
            if len(group.members) == 1:
                [((i, _), norm)] = group.dots.items()
                add_to(g, rows[i], i, new[norm])
                continue
            self.groups[k] = group
            for i in group.members:
                self.groups_of[i].add(k)
        self.after = [0] * len(rows)
        super().__init__(g, rows, Budget(), unknowns=unknowns)

    def _rank(self, k: int) -> tuple[int, int, int, int]:
        """Return the sort key of unknown k; unknowns are eliminated in ascending order.

        The key is the number of neighbours of k in S, then `after[k]`, then k.
        """
        neighbours = {k, *self.rows[k]}.union(
            *(self.groups[x].members for x in self.groups_of[k])
        )
        return 0, len(neighbours), self.after[k], k

    def _eliminate(self, k: int) -> Iterable[int]:
        g, left = self.g, self._alone(k)
        for group in sorted(self.groups_of[k]):
            found = self.groups.pop(group)
            for i in found.members:
                self.groups_of[i].discard(group)
            for (i, j), dot in found.dots.items():
                if i != j or i not in left:
                    self._add(i, j, self.new[dot])
        pivot, row = self._removed(k)
        self.pivots[k] = pivot, pivot
        column = {i: g.call("div", node, pivot) for i, node in row.items()}
        self.columns[k] = column
        for i, j in combinations(sorted(row), 2):
            self._add(i, j, g.call("neg", g.call("mul", column[i], row[j])))
        for i in row:
            rest = g.call("neg", g.call("mul", column[i], row[i]))
            self._add(i, i, g.call("div", left[i], pivot) if i in left else rest)
            self.after[i] = max(self.after[i], self.after[k] + 1)
        return row

    def _alone(self, k: int) -> Vector:
        """Return the diagonal of the Schur complement of unknown k, times its pivot.

        The result maps other unknowns i to nodes, computed without cancellation; it is
        empty if k is in several groups.
        """
        g, own = self.g, self.rows[k].get(k, self.g.zero)
        if len(self.groups_of[k]) != 1 or self.rows[k].keys() - {k}:
            return {}
        [group] = (self.groups[x] for x in self.groups_of[k])
        left: Vector = {}
        for i in group.members:
            if i != k:
                areas = group.areas.get((min(i, k), max(i, k)), ())
                found = ((w, self.new[area]) for w, area in areas)
                squares = g.product_sum((w, g.call("mul", x, x)) for w, x in found)
                norm = g.call("mul", own, self.new[group.dots[i, i]])
                left[i] = g.call("add", norm, squares)
        return left

    def _over_pivot(self, node: int, k: int) -> int:
        return self.g.call("div", node, self.pivots[k][0])


def _laws(e: Equations) -> NewtonsLaws | None:
    """Return Newton's laws of equations without constraints; memoized.

    None with constraints, where L depends on modes or first-order states, and where
    `newtons_laws` has none.
    """
    g = e.graph
    changing = e.model.modes.union(x.name for x in e.states)
    if e.rows or e.laws or changing & g.depends([e.model.lagrangian]):
        return None
    return memoize(
        g, (newtons_laws, e.nodes, e.model.lagrangian), lambda: newtons_laws(e)
    )


def has_masses(e: Equations) -> bool:
    """Whether all masses of Newton's laws are positive; True without such laws."""
    laws = _laws(e)
    given = {p.name: p.value for p in e.model.parameters}
    masses = [] if laws is None else [*laws.masses.values()]
    return min(evaluate(e.graph, masses, given), default=1) > 0


def accelerations(e: Equations) -> list[int] | None:
    """Return q'' (n,) as nodes; None if the model is not masses on massless links."""
    g, n = e.graph, len(e.q)
    laws = _laws(e)
    if laws is None or not has_masses(e):
        return None
    moving = frozenset(e.moving)
    reduced, leaders = _without_massless(g, laws, n)
    free = {*range(n), *laws.sums} - reduced.sums.keys()
    links = joints(
        g, reduced, sorted(free - reduced.masses.keys() - leaders.keys()), moving
    )
    if links is None:
        return None
    found = _solution(g, reduced, links, moving)
    for velocity, k in leaders.items():
        others = ((c, found[i]) for i, c in laws.sums[k].items() if i != velocity)
        rest = g.call("add", g.product_sum(others), laws.drifts[k])
        found[velocity] = g.call("sub", found[k], rest)
    return [found[j] for j in range(n)]


def _without_massless(
    g: Graph, laws: NewtonsLaws, size: int
) -> tuple[NewtonsLaws, dict[int, int]]:
    """Eliminate massless velocities that occur in one sum each.

    The sums replace these velocities as unknowns. Return the laws without these sums,
    and the sum of each eliminated velocity.

    size : the number of velocities.
    """
    users = Counter(i for form in laws.sums.values() for i in form)
    sums, forces, leaders = dict(laws.sums), dict(laws.forces), dict[int, int]()
    for k, form in laws.sums.items():
        alone = (i for i in form if i < size and users[i] == 1 and form[i] == g.one)
        velocity = next((i for i in alone if i not in laws.masses), None)
        if velocity is None:
            continue
        leaders[velocity] = k
        force = forces.pop(velocity, g.zero)
        add_to(g, forces, k, force)
        for i, c in sums.pop(k).items():
            if i != velocity:
                add_to(g, forces, i, g.call("neg", g.call("mul", c, force)))
    forces = {u: node for u, node in forces.items() if node != g.zero}
    return laws._replace(sums=sums, forces=forces), leaders


def _solution(
    g: Graph, laws: NewtonsLaws, joints: Joints, moving: frozenset[str]
) -> Vector:
    """Return the accelerations of masses and the rates of massless velocities.

    The result maps each unknown (node) to the node of its value.

    Internal units are the commonest mass and length. Products of sines and cosines are
    combined to sines and cosines of differences of angles in the drifts and in the
    inner products of links and joints; forces are not rewritten.

    laws : Newton's laws.
    joints : the joints of massless links.
    moving : names of variables that change along a motion.
    """
    mass, length = (_commonest(g, x.values()) for x in (laws.masses, joints.lengths))
    weights = _quotients(g, dict.fromkeys(laws.masses, mass), laws.masses)
    drifts, fall = _drifts_over(g, laws, joints, length), _fall(g, laws, length, moving)
    remaining = {}
    for k, form in laws.sums.items():
        parts = ((c, fall[i]) for i, c in form.items() if i in fall)
        remaining[k] = g.call("sub", fall[k], g.product_sum(parts))
    # E of each link, N of each joint; and the forces on the masses by these.
    forces = dict(enumerate((*joints.along, *(x.across for x in joints.turns))))
    turns = dict(enumerate(joints.turns, len(joints.along)))
    pulls = {t: _back(g, laws, x) for t, x in forces.items()}
    links = {t: pulls[t] for t in pulls.keys() - turns.keys()}
    torques = {t: x for t, x in turns.items() if x.velocity in laws.forces}

    changes = {t: _dot(g, x, drifts) for t, x in forces.items()}
    gram = _products(g, {t: pulls[t] for t in turns}, links, weights)
    torque_gram = _products(g, pulls, {t: pulls[t] for t in torques}, weights)
    groups = square_groups(g, links, weights)
    nodes = [*changes.values(), *(x.square for x in joints.turns)]
    nodes += [
        n for x in (gram, torque_gram) for row in x.values() for n in row.values()
    ]
    nodes += [n for group in groups for n in group.nodes]
    new = dict(zip(nodes, fewer_terms(g, nodes, moving), strict=True))

    known: Vector = {}
    for t, turn in torques.items():
        unit = g.call("mul", g.call("mul", mass, length), turn.length)
        torque = g.call("div", laws.forces[turn.velocity], unit)
        known[t] = g.call("div", torque, new[turn.square])
    missing: Vector = {}
    for t, x in forces.items():
        change = g.call("sub", new[changes[t]], _dot(g, x, remaining))
        turned = g.product_sum((new[n], known[j]) for j, n in torque_gram[t].items())
        missing[t] = g.call("sub", change, turned)
    known |= Squares(g, groups, new).solve({t: missing[t] for t in links})
    found: Vector = {}
    scales = dict.fromkeys(turns, length), {t: x.length for t, x in turns.items()}
    for t, scale in _quotients(g, *scales).items():
        pulled = ((new[n], known[i]) for i, n in gram[t].items() if i in known)
        resolved = g.call("sub", g.product_sum(pulled), missing[t])
        factor = g.call("div", scale, new[turns[t].square])
        found[turns[t].velocity] = g.call("mul", factor, resolved)
    for t, force in known.items():
        for u, part in pulls[t].items():
            add_to(g, fall, u, g.call("mul", weights[u], g.call("mul", part, force)))
    return found | {u: g.call("mul", length, x) for u, x in fall.items()}


def _commonest(g: Graph, nodes: Iterable[int]) -> int:
    [(node, _)] = Counter(nodes).most_common(1) or [(g.one, 1)]
    return node


def _quotients(g: Graph, tops: Vector, bottoms: Vector) -> Vector:
    """Return quotients tops[k] / bottoms[k] by key, with common factors cancelled."""
    nodes = [g.call("div", node, bottoms[k]) for k, node in tops.items()]
    found = normal_form(g, nodes, set(g.cone(nodes)))
    return dict(zip(tops, found, strict=True))


def _fall(g: Graph, laws: NewtonsLaws, length: int, moving: frozenset[str]) -> Vector:
    """Return force / (mass * length) of each mass: its acceleration without tensions.

    Accelerations are in units of `length`; torques on massless links are left out.

    laws : Newton's laws.
    length : node of the unit.
    moving : names of variables that change along a motion.
    """
    pushed = {u: laws.forces.get(u, g.zero) for u in laws.masses}
    moved = g.dependent(pushed.values(), moving)
    # Divide by mass first: weights yield one common quotient. Most are -m g, where m
    # may be a number.
    still = {u: g.call("neg", x) for u, x in pushed.items() if x not in moved}
    still = _quotients(g, still, laws.masses)
    still = _quotients(g, still, dict.fromkeys(still, length))
    return {
        u: g.call("neg", still[u])
        if u in still
        else g.call("div", x, g.call("mul", laws.masses[u], length))
        for u, x in pushed.items()
    }


def _drifts_over(g: Graph, laws: NewtonsLaws, joints: Joints, length: int) -> Vector:
    """Return the drifts of sums divided by `length`, the internal unit of length.

    A drift is first divided by the constant length of its sum, if there is one, so that
    common factors cancel.

    laws : Newton's laws.
    joints : the joints.
    """
    own = dict.fromkeys(laws.sums, length) | joints.lengths
    drifts = _quotients(g, {k: laws.drifts[k] for k in own}, own)
    scales = _quotients(g, own, dict.fromkeys(own, length))
    return {k: g.call("mul", scales[k], drifts[k]) for k in laws.sums}


def _back(g: Graph, laws: NewtonsLaws, parts: Vector) -> Vector:
    """Return the forces C^T F on the masses due to forces F on sums: mass -> node.

    parts : sum -> node of F.
    laws : Newton's laws.
    """
    total = dict(parts)
    for k, part in parts.items():
        for i, c in laws.sums[k].items():
            if i in laws.masses:
                add_to(g, total, i, g.call("neg", g.call("mul", c, part)))
    return total


def _dot(g: Graph, one: Vector, other: Vector) -> int:
    return g.product_sum((a, other[k]) for k, a in one.items())


def _products(
    g: Graph, rows: Mapping[int, Vector], columns: Mapping[int, Vector], weights: Vector
) -> dict[int, Vector]:
    """Return weighted inner products of rows and columns that act on a common mass.

    The result maps each key t of `rows` to a mapping: key of `columns` -> node.

    rows, columns : t -> mass u -> coefficient.
    weights : mass u -> node.
    """
    holders = _holders(columns)
    found = {}
    for t, row in rows.items():
        near = sorted({i for u in row for i in holders.get(u, ())})
        found[t] = {i: weighted(g, row, columns[i], weights) for i in near}
    return found
