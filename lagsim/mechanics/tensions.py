"""Accelerations of masses on massless links, by the forces in the links.

With the sums of `chains` as velocities of their own beside q', where L has constant
masses, Newton's law of what is squared in L, each mass by itself, is

    M_u u'' = force_u + what holds u to the others,    s_k'' = sum c_ki u_i'' + drift_k

Joints without inertia hand forces on. Of the forces F on sums in which velocities v
without inertia stand, c_v F = 0 for each v leaves E with c_v E = 0: along the link,
where there is one sum more than velocities; nothing, where there are as many. What
moves v alone is N_v with c_v N_v = 1, across E and the c of all others. So

    u'' = (force + C^T F) / m,    F = E x + N torque,    c E = 0,    c N = 1,
    E^T C u'' = E^T drift,    theta'' = N^T (C u'' - drift).

M is never made, and S x = r for the tensions x is a sum of squares of what pulls at
each mass, x^T S x = sum over u of w_u (sum over t of p_tu x_t)^2. What meets in the
same x is a group, and as long as an x_t stands in one group alone, Lagrange's identity

    |p_i|^2 |p_t|^2 - (p_i p_t)^2 = sum over u < v of (p_iu p_tv - p_iv p_tu)^2

gives what eliminating it leaves as sums of positive terms: nothing cancels. Of equal
links in the plane S is the tridiagonal matrix of textbooks, 2 on the diagonal and
-cos(a_k - a_k+1) beside it.

Source: A. Fijany, I. Sharf and G. M. T. D'Eleuterio, IEEE Transactions on Robotics and
Automation 11 (1995) 389: the constraint force algorithm.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import rate_of, slopes
from lagsim.language.evaluate import evaluate
from lagsim.language.forms import common_factor, fewer_terms, normal_form
from lagsim.language.sparse import Budget, DisjointSets
from lagsim.mechanics.chains import chains, rates_of_places
from lagsim.mechanics.constraints import Flow
from lagsim.mechanics.factorisation import Factorisation, Vector, add_to
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.chains import Chains
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model


class Newton(NamedTuple):
    """The law of each unknown: velocities 0 to n - 1, and the sums.

    Attributes
    ----------
    sums : dict
        Sum k: its factor of each unknown in it.
    masses, forces : dict
        Of each unknown that has one.
    drifts : dict
        Of each sum: its rate where all unknowns keep theirs.
    """

    sums: dict[int, Vector]
    masses: Vector
    forces: Vector
    drifts: Vector


def newton(e: Equations) -> Newton | None:
    """Laws; None where masses move, couple, or are of no positions."""
    g, model = e.graph, e.model
    if e.q != tuple(c.name for c in model.coordinates):
        return None  # reduced
    flow = Flow(g, e.q, e.velocities)
    moving = (*e.q, "t")
    found = chains(g, model.lagrangian, flow.rates, flow.velocities, moving)
    if found is None:
        return None
    # In place of the sums, and of what they are the rates of, stand variables.
    rates, places = dict(enumerate(flow.rates)), dict(enumerate(flow.positions))
    new, back = Vector(), Vector()
    for k, rate in enumerate(found.rates, found.size):
        rates[k] = new[rate] = g.variable(f"rate.{k}")
        back[rates[k]] = rate
    for k, (place, sign) in _places(g, model, flow, found).items():
        places[k] = g.variable(f"place.{k}")
        new[place] = g.call("mul", sign, places[k])
        back[places[k]] = g.call("mul", sign, place)
    variables = frozenset((*rates.values(), *places.values(), g.variable("t")))
    [lagrangian] = g.substitute([model.lagrangian], new)
    slope = slopes(g, lagrangian, variables)
    momenta = {u: slope[v] for u, v in rates.items() if v in slope}
    masses = _masses(g, momenta, rates, variables)
    if masses is None or any(u not in places for u in masses):
        return None
    forces = {u: slope[v] for u, v in places.items() if v in slope}
    works = [(x.direction, x.level, x.node) for x in model.forces]
    if model.dissipation is not None:
        works.append((model.dissipation, Level.VELOCITY, g.constant(-1.0)))
    for direction, level, work in works:
        [written] = g.substitute([direction], new)
        lever = slopes(g, written, variables)
        for u, v in (places if level is Level.POSITION else rates).items():
            if v in lever:
                add_to(g, forces, u, g.call("mul", work, lever[v]))
    pushes = g.substitute(forces.values(), back)
    forces = {u: x for u, x in zip(forces, pushes, strict=True) if x != g.zero}
    sums = dict(enumerate(found.rates, found.size))
    return Newton(found.named, masses, forces, _drifts(g, flow, sums))


def _masses(
    g: Graph, momenta: Vector, rates: Vector, variables: frozenset[int]
) -> Vector | None:
    """Constant by which each momentum is its rate; None for others."""
    masses, moving = Vector(), g.depends(variables)
    for u, momentum in momenta.items():
        mass = slopes(g, momentum, variables)
        if mass.keys() != {rates[u]} or g.depends(mass.values()) & moving:
            return None
        masses[u] = mass[rates[u]]
    return masses


def _places(
    g: Graph, model: Model, flow: Flow, found: Chains
) -> dict[int, tuple[int, int]]:
    """Return the integral of each sum, if it is known: a node, and its sign."""
    known, minus = rates_of_places(model, flow), g.constant(-1.0)
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


def _drifts(g: Graph, flow: Flow, sums: dict[int, int]) -> Vector:
    """Return the rate of each sum where velocities, and the sums in it, keep theirs."""
    of = {node: k for k, node in sums.items()}
    moving = dict(flow.forward)
    drifts: Vector = {}
    for n in g.cone(of):
        if n in moving or not any(a in moving for a in g.args[n]):
            continue
        rate = rate_of(g, n, moving)
        if n in of:
            drifts[of[n]] = rate
        else:
            moving[n] = rate
    return drifts


# How many velocities without inertia may stand together in how many sums: along lines,
# in a plane and in space; on rigid links, or with what these may stretch by.
KINDS = {(1, 1), (1, 2), (2, 2), (2, 3), (3, 3)}


class Turn(NamedTuple):
    """A velocity without inertia.

    Attributes
    ----------
    factors : dict
        Its factor in each sum, over `length`.
    across : dict
        N, times `length` and `factors` times this.
    length : int
        What the factors have in common.
    """

    velocity: int
    factors: Vector
    across: Vector
    length: int


class Joints(NamedTuple):
    """Joints: E of the links, the massless velocities, constant lengths by sum."""

    along: list[Vector]
    turns: list[Turn]
    lengths: Vector


def joints(
    g: Graph, held: Newton, free: Collection[int], moving: frozenset[str]
) -> Joints | None:
    """Joints; None where there are others than of KINDS."""
    moved = g.dependent((c for x in held.sums.values() for c in x.values()), moving)
    found, places = Joints([], [], {}), {u: j for j, u in enumerate(free)}
    sets = DisjointSets(len(places))
    sums_of: dict[int, list[int]] = {u: [] for u in free}
    for k, form in held.sums.items():
        massless = [i for i in form if i not in held.masses]
        if k not in held.masses or any(i not in places for i in massless):
            return None
        if any(form[i] in moved for i in form if i in held.masses):
            return None  # of little inertia, it would take digits
        for i in massless:
            sums_of[i].append(k)
            sets.merge(places[massless[0]], places[i])
        if not massless:
            found.along.append({k: g.one})
    names = list(places)
    for group in sets.sets():
        velocities = sorted(names[j] for j in group)
        sums = sorted({k for u in velocities for k in sums_of[u]})
        if not _join(g, found, held, velocities, sums, moving):
            return None
    return found


def _join(
    g: Graph,
    found: Joints,
    held: Newton,
    velocities: Sequence[int],
    sums: Sequence[int],
    moving: frozenset[str],
) -> bool:
    """Add a joint of `velocities` that stand in `sums`, if it is of a known kind."""
    kind = len(velocities), len(sums)
    if kind not in KINDS:
        return False
    rows, lengths = [], []
    for u in velocities:
        factors = [held.sums[k].get(u, g.zero) for k in sums]
        length, rest = common_factor(g, factors)
        lengths.append(length)
        rows.append(rest)
    along: list[int] = []
    if kind[0] == 1:
        across = rows
        along = _normal(g, rows[0]) if kind == (1, 2) else []
    elif kind == (2, 2):
        across = [_normal(g, rows[1]), _normal(g, rows[0])]
    else:
        third = rows[2] if kind == (3, 3) else _across(g, rows[0], rows[1], moving)
        along = third if kind == (2, 3) else []
        pairs = ((rows[1], third), (third, rows[0]), (rows[0], rows[1]))
        across = [_across(g, a, b, moving) for a, b in pairs[: kind[0]]]
    if along:
        found.along.append(dict(zip(sums, along, strict=True)))
    for u, row, turned, length in zip(velocities, rows, across, lengths, strict=True):
        both = [dict(zip(sums, x, strict=True)) for x in (row, turned)]
        found.turns.append(Turn(u, both[0], both[1], length))
    still = [x for x in lengths if not g.depends([x]) & moving]
    if still:
        found.lengths.update(dict.fromkeys(sums, still[0]))
    return True


def _normal(g: Graph, a: Sequence[int]) -> list[int]:
    return [g.call("neg", a[1]), a[0]]


def _across(
    g: Graph, a: Sequence[int], b: Sequence[int], moving: frozenset[str]
) -> list[int]:
    """Cross product without the common factor of its components."""
    product = [
        g.call("sub", g.call("mul", a[i], b[j]), g.call("mul", a[j], b[i]))
        for i, j in ((1, 2), (2, 0), (0, 1))
    ]
    return common_factor(g, fewer_terms(g, product, moving))[1]


Pair = tuple[int, int]


class Group(NamedTuple):
    """The squares in which the same x stand.

    Attributes
    ----------
    norms : dict
        i -> |p_i|^2.
    dots : dict
        (i, j), i < j -> p_i p_j.
    areas : dict
        (i, j), i < j -> for each u < v: w_u w_v, and p_iu p_jv - p_iv p_ju.
    """

    norms: Vector
    dots: dict[Pair, int]
    areas: dict[Pair, list[Pair]]

    @property
    def nodes(self) -> list[int]:
        """All but weights."""
        areas = (area for found in self.areas.values() for _, area in found)
        return [*self.norms.values(), *self.dots.values(), *areas]

    def written(self, new: Mapping[int, int]) -> Group:
        """Return the same with other nodes."""
        return Group(
            {i: new[n] for i, n in self.norms.items()},
            {key: new[n] for key, n in self.dots.items()},
            {key: [(w, new[n]) for w, n in x] for key, x in self.areas.items()},
        )


def groups(g: Graph, parts: Mapping[int, Vector], weights: Vector) -> list[Group]:
    """Return the groups of p, t -> u -> p_tu, and w, u -> w_u."""
    members: dict[int, list[int]] = {}
    for t in sorted(parts):
        for u in parts[t]:
            members.setdefault(u, []).append(t)
    alike: dict[tuple[int, ...], list[int]] = {}
    for u, met in members.items():
        alike.setdefault(tuple(met), []).append(u)
    found = []
    for those, us in alike.items():
        p = {t: {u: parts[t][u] for u in us} for t in those}
        pairs = list(combinations(those, 2))
        norms = {i: weighted(g, p[i], p[i], weights) for i in those}
        dots = {(i, j): weighted(g, p[i], p[j], weights) for i, j in pairs}
        areas = {(i, j): _areas(g, p[i], p[j], weights) for i, j in pairs}
        found.append(Group(norms, dots, areas))
    return found


def weighted(g: Graph, one: Vector, other: Vector, weights: Vector) -> int:
    """Weighted inner product: the sum of w a b over common entries."""
    terms = (
        (weights[u], g.call("mul", a, other[u])) for u, a in one.items() if u in other
    )
    return g.product_sum(terms)


def _areas(g: Graph, one: Vector, other: Vector, weights: Vector) -> list[Pair]:
    found = []
    for u, v in combinations(one, 2):
        weight = g.call("mul", weights[u], weights[v])
        terms = (g.call("mul", one[x], other[y]) for x, y in ((u, v), (v, u)))
        found.append((weight, g.call("sub", *terms)))
    return found


class Squares(Factorisation):
    """S of groups of squares: what stands in one group alone is left of as squares."""

    def __init__(self, g: Graph, found: Sequence[Group]) -> None:
        size = 1 + max((i for group in found for i in group.norms), default=-1)
        rows = [Vector() for _ in range(size)]
        self.groups: dict[int, Group] = {}
        self.those = [set[int]() for _ in range(size)]  # the groups of each unknown
        for k, group in enumerate(found):
            if len(group.norms) > 1:
                self.groups[k] = group
            for i, norm in group.norms.items():
                if len(group.norms) > 1:
                    self.those[i].add(k)
                else:
                    add_to(g, rows[i], i, norm)
        self.after = [0] * size
        super().__init__(g, rows, Budget(), some={i for x in found for i in x.norms})

    def _rank(self, k: int) -> tuple[int, int, int, int]:
        """Rank in the elimination: fewest neighbours, then least depth."""
        met = {k, *self.rows[k]}.union(*(self.groups[x].norms for x in self.those[k]))
        return 0, len(met), self.after[k], k

    def _leave(self, group: int) -> Group:
        """Take a group apart."""
        found = self.groups.pop(group)
        for i in found.norms:
            self.those[i].discard(group)
        return found

    def _eliminate(self, k: int) -> Iterable[int]:
        g, left = self.g, Vector()
        if len(self.those[k]) == 1 and not self.rows[k].keys() - {k}:
            left = self._alone(k, *self.those[k])
        for group in sorted(self.those[k]):
            found = self._leave(group)
            for i, norm in found.norms.items():
                self._add(i, i, norm)
            for (i, j), dot in found.dots.items():
                self._add(i, j, dot)
        pivot, row = self._taken(k)
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

    def _alone(self, k: int, group: int) -> Vector:
        """Take apart the group that k stands in alone; give what is left, by pivot."""
        g, own = self.g, self.rows[k].get(k, self.g.zero)
        found, left = self._leave(group), Vector()
        self._add(k, k, found.norms[k])
        for (i, j), dot in found.dots.items():
            self._add(i, j, dot)
        for i, norm in found.norms.items():
            if i != k:
                areas = found.areas[min(i, k), max(i, k)]
                squares = ((w, g.call("mul", area, area)) for w, area in areas)
                rest = g.call("mul", own, norm)
                left[i] = g.call("add", rest, g.product_sum(squares))
        return left

    def _over_pivot(self, node: int, k: int) -> int:
        return self.g.call("div", node, self.pivots[k][0])


def accelerations(e: Equations) -> list[int] | None:
    """Return q'' (n,); None where not all is masses on massless links."""
    g, n = e.graph, len(e.q)
    laws = None if e.rows or e.laws else newton(e)
    if laws is None or not _heavy(e, laws):
        return None
    moving = frozenset((*e.q, *e.velocities, "t"))
    held, followers = _led(g, laws, n)
    given = {*range(n), *laws.sums} - held.sums.keys()
    free = given - held.masses.keys() - {x.velocity for x in followers}
    met = joints(g, held, sorted(free), moving)
    if met is None:
        return None
    found = _Motion(g, held, met, moving).accelerations()
    for x in followers:
        others = ((c, found[i]) for i, c in x.others.items())
        rest = g.call("add", g.product_sum(others), x.drift)
        found[x.velocity] = g.call("sub", found[x.leader], rest)
    return [found[j] for j in range(n)]


def _heavy(e: Equations, laws: Newton) -> bool:
    """Whether all masses are positive at the values of the parameters."""
    values = {p.name: p.value for p in e.model.parameters}
    return all(m > 0.0 for m in evaluate(e.graph, [*laws.masses.values()], values))


class _Follower(NamedTuple):
    """A velocity that stands in one sum alone: `leader` less `others` and `drift`."""

    velocity: int
    leader: int
    others: Vector
    drift: int


def _led(g: Graph, laws: Newton, size: int) -> tuple[Newton, list[_Follower]]:
    """Take sums for velocities in place of those that stand in them alone."""
    users = Counter(i for form in laws.sums.values() for i in form)
    sums, forces, followers = dict(laws.sums), dict(laws.forces), []
    for k, form in laws.sums.items():
        alone = (i for i in form if i < size and users[i] == 1 and form[i] == g.one)
        velocity = next((i for i in alone if i not in laws.masses), None)
        if velocity is None:
            continue
        others = {i: c for i, c in sums.pop(k).items() if i != velocity}
        followers.append(_Follower(velocity, k, others, laws.drifts.get(k, g.zero)))
        force = forces.pop(velocity, g.zero)
        add_to(g, forces, k, force)
        for i, c in others.items():
            add_to(g, forces, i, g.call("neg", g.call("mul", c, force)))
    forces = {u: node for u, node in forces.items() if node != g.zero}
    return laws._replace(sums=sums, forces=forces), followers


def _commonest(g: Graph, nodes: Iterable[int]) -> int:
    [(node, _)] = Counter(nodes).most_common(1) or [(g.one, 1)]
    return node


class _Motion:
    """The equations of the tensions, in units of the commonest mass and length.

    Attributes
    ----------
    pulls, turns : dict
        Link -> C^T E, and C^T c of it: masses -> nodes.
    fall : dict
        u'' of masses without tensions.
    missing : dict
        Sum -> (drift - C fall): what tensions have to change.
    """

    def __init__(
        self, g: Graph, held: Newton, met: Joints, moving: frozenset[str]
    ) -> None:
        self.g, self.held, self.moving = g, held, moving
        self.along, self.joints, self.lengths = met
        self.mass = _commonest(g, held.masses.values())
        self.length = _commonest(g, met.lengths.values())
        self.weights = self._over(dict.fromkeys(held.masses, self.mass), held.masses)
        self.pulls = dict(enumerate(map(self._back, met.along)))
        self.turns = {t: self._back(x.across) for t, x in enumerate(met.turns)}
        # Forces over the units, and over N's: variables until all is joined.
        self.known: Vector = {}
        self.torques = {
            t: g.variable(f"torque.{t}")
            for t, x in enumerate(met.turns)
            if x.velocity in held.forces
        }
        self.fall = self._fall()
        self.missing = self._missing()

    def _over(self, tops: Vector, bottoms: Vector) -> Vector:
        """Quotients, with common factors cancelled."""
        g = self.g
        nodes = [g.call("div", node, bottoms[k]) for k, node in tops.items()]
        found = normal_form(g, nodes, set(g.cone(nodes)))
        return dict(zip(tops, found, strict=True))

    def _back(self, parts: Vector) -> Vector:
        """C^T of forces on sums."""
        g, masses, total = self.g, self.held.masses, dict(parts)
        for k, part in parts.items():
            for i, c in self.held.sums[k].items():
                if i in masses:
                    add_to(g, total, i, g.call("neg", g.call("mul", c, part)))
        return total

    def _fall(self) -> Vector:
        g, held = self.g, self.held
        unit = {u: g.call("mul", m, self.length) for u, m in held.masses.items()}
        pushed = {u: held.forces.get(u, g.zero) for u in held.masses}
        moved = g.dependent(pushed.values(), self.moving)
        still = {u: node for u, node in pushed.items() if node not in moved}
        fall = self._over(still, unit)
        for u in pushed.keys() - still.keys():
            fall[u] = g.variable(f"fall.{u}")
            self.known[fall[u]] = g.call("div", pushed[u], unit[u])
        for t, torque in self.torques.items():
            for u, part in self.turns[t].items():
                force = g.call("mul", g.call("mul", self.weights[u], part), torque)
                add_to(g, fall, u, force)
        return fall

    def _missing(self) -> Vector:
        g, held = self.g, self.held
        drifts = {k: held.drifts.get(k, g.zero) for k in held.sums}
        lengths = dict.fromkeys(drifts, self.length)
        lengths |= self.lengths
        drifts = self._over(drifts, lengths)
        scales = self._over(lengths, dict.fromkeys(drifts, self.length))
        found = {k: g.call("mul", scales[k], drift) for k, drift in drifts.items()}
        for k, form in held.sums.items():
            along = ((c, self.fall[i]) for i, c in form.items() if i in held.masses)
            fallen = g.call("sub", self.fall[k], g.product_sum(along))
            found[k] = g.call("sub", found[k], fallen)
        return found

    def accelerations(self) -> Vector:
        """Accelerations u'' of masses and of massless velocities."""
        g, turns = self.g, dict(enumerate(self.joints))
        right = {t: self._dot(x, self.missing) for t, x in enumerate(self.along)}
        rest = {t: self._dot(x.across, self.missing) for t, x in turns.items()}
        squares = {t: self._dot(x.factors, x.across) for t, x in turns.items()}
        levers = self._levers()
        met = groups(g, self.pulls, self.weights)
        nodes = [*right.values(), *rest.values(), *squares.values()]
        nodes += [n for lever in levers.values() for n in lever.values()]
        nodes += [n for group in met for n in group.nodes]
        forces = g.depends([*self.known, *self.torques.values()])
        joined = fewer_terms(g, nodes, self.moving | forces)
        new = dict(zip(nodes, joined, strict=True))
        known = self._known({t: new[n] for t, n in squares.items()})
        new = dict(zip(nodes, g.substitute(joined, known), strict=True))

        solved = Squares(g, [group.written(new) for group in met])
        x = solved.solve({t: new[n] for t, n in right.items()})
        units = dict.fromkeys(turns, self.length)
        scales = self._over(units, {t: x.length for t, x in turns.items()})
        found = {}
        for t, lever in levers.items():
            moved = g.product_sum((new[n], x[i]) for i, n in lever.items() if i in x)
            moved = g.call("sub", moved, new[rest[t]])
            scale = g.call("div", scales[t], new[squares[t]])
            found[turns[t].velocity] = g.call("mul", scale, moved)
        fall = g.substitute(self.fall.values(), known)
        found |= dict(zip(self.fall, fall, strict=True))
        for t, tension in x.items():
            for u, part in self.pulls[t].items():
                change = g.call("mul", self.weights[u], g.call("mul", part, tension))
                add_to(g, found, u, change)
        masses = self.fall.keys()
        return found | {u: g.call("mul", self.length, found[u]) for u in masses}

    def _dot(self, one: Vector, other: Vector) -> int:
        return weighted(self.g, one, other, dict.fromkeys(one, self.g.one))

    def _known(self, squares: Vector) -> Vector:
        """Expressions of the variables in place of forces and torques."""
        g, known = self.g, dict(self.known)
        unit = g.call("mul", self.mass, self.length)
        for t, variable in self.torques.items():
            joint = self.joints[t]
            force = self.held.forces[joint.velocity]
            force = g.call("div", force, g.call("mul", unit, joint.length))
            known[variable] = g.call("div", force, squares[t])
        return known

    def _levers(self) -> dict[int, Vector]:
        """Angular accelerations of each angle per unit of the tensions."""
        pulled: dict[int, list[int]] = {}
        for t, pull in self.pulls.items():
            for u in pull:
                pulled.setdefault(u, []).append(t)
        found = {}
        for t, turn in self.turns.items():
            near = sorted({i for u in turn for i in pulled.get(u, ())})
            found[t] = {
                i: weighted(self.g, turn, self.pulls[i], self.weights) for i in near
            }
        return found
