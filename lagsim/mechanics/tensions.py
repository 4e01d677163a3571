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

import math
from collections import Counter
from heapq import heapify, heappop, heappush
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import rate_of, slopes
from lagsim.language.evaluate import evaluate
from lagsim.language.forms import common_factor, fewer_terms, normal_form
from lagsim.language.sparse import DisjointSets
from lagsim.mechanics.chains import chains, rates_of_places
from lagsim.mechanics.constraints import Flow
from lagsim.model.model import Level
from lagsim.tolerances import TERM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.chains import Chains
    from lagsim.mechanics.equations import Equations


Vector = dict[int, int]  # unknown -> node; what is absent is zero


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
    """Give the laws; None where masses move, couple, or are of no positions."""
    g, model = e.graph, e.model
    if e.q != tuple(c.name for c in model.coordinates):
        return None  # reduced
    flow = Flow(g, e.q, e.velocities)
    moving = (*e.q, "t")
    found = chains(g, model.lagrangian, flow.rates, flow.velocities, moving)
    if found is None:
        return None
    places = rates_of_places(model, flow)
    apart = _Apart(g, flow, found, places)
    forces, dissipation = model.forces, model.dissipation
    nodes = [model.lagrangian, *(force.direction for force in forces)]
    nodes += [] if dissipation is None else [dissipation]
    lagrangian, *directions = g.substitute(nodes, apart.new)

    slope = slopes(g, lagrangian, apart.variables)
    masses = apart.by(slope, rates=True)
    for u, momentum in masses.items():
        mass = slopes(g, momentum, apart.variables)
        variable = apart.rates[u]
        if mass.keys() != {variable} or g.depends([mass[variable]]) & apart.moving:
            return None
        masses[u] = mass[variable]
    if any(k not in apart.places for k in apart.sums.keys() & masses.keys()):
        return None
    total = apart.by(slope, rates=False)
    levels = [force.level is not Level.POSITION for force in forces]
    works = [force.node for force in forces]
    if dissipation is not None:
        levels, works = [*levels, True], [*works, g.constant(-1.0)]
    for direction, by_rates, work in zip(directions, levels, works, strict=True):
        levers = apart.by(slopes(g, direction, apart.variables), rates=by_rates)
        for u, lever in levers.items():
            term = g.call("mul", work, lever)
            total[u] = g.call("add", total.get(u, g.zero), term)
    back = {v: old for old, v in apart.new.items() if v in apart.variables}
    written = g.substitute(total.values(), back)
    total = {u: node for u, node in zip(total, written, strict=True) if node != g.zero}
    sums = dict(enumerate(found.sums, found.size))
    return Newton(sums, masses, total, _drifts(g, flow, apart.sums))


class _Apart:
    """Variables in place of the sums and their positions.

    Attributes
    ----------
    sums : dict
        Sum -> its node.
    new : dict
        The nodes that are variables here.
    rates, places : dict
        Unknown -> the variable of it, and of what it is the rate of.
    """

    def __init__(
        self, g: Graph, flow: Flow, found: Chains, places: dict[int, int]
    ) -> None:
        self.g = g
        self.sums = dict(enumerate(found.rates, found.size))
        self.rates = dict(enumerate(flow.rates))
        self.places = dict(enumerate(flow.positions))
        self.new: dict[int, int] = {}
        for k, rate in self.sums.items():
            self.rates[k] = self.new[rate] = g.variable(f"rate.{k}")
            place = places.get(rate)
            back = places.get(g.call("neg", rate))
            if place is None and back is not None:
                place = g.call("neg", back)  # (-x)^2 is written as x^2
            if place is not None:
                self._place(k, place)
        known = [*self.rates.values(), *self.places.values(), g.variable("t")]
        self.variables = frozenset(known)
        self.moving = g.depends(known)

    def _place(self, k: int, place: int) -> None:
        g = self.g
        self.places[k] = self.new[place] = g.variable(f"place.{k}")
        if g.ops[place] == "neg":  # a + (-b) is written as a - b
            self.new.setdefault(g.args[place][0], g.call("neg", self.places[k]))

    def by(self, found: dict[int, int], *, rates: bool) -> Vector:
        """Values by unknown, of values by variable."""
        variables = self.rates if rates else self.places
        return {u: found[v] for u, v in variables.items() if v in found}


def _drifts(g: Graph, flow: Flow, sums: dict[int, int]) -> Vector:
    """Give the rate of each sum where velocities, and the sums in it, keep theirs."""
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
    """Give the joints; None where there are others than of KINDS."""
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
        """Give the same with other nodes."""
        return Group(
            {i: new[n] for i, n in self.norms.items()},
            {key: new[n] for key, n in self.dots.items()},
            {key: [(w, new[n]) for w, n in x] for key, x in self.areas.items()},
        )


def groups(g: Graph, parts: Mapping[int, Vector], weights: Vector) -> list[Group]:
    """Give the groups of p, t -> u -> p_tu, and w, u -> w_u."""
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


class Squares:
    """S, eliminated in minimum-degree order."""

    def __init__(self, g: Graph, found: list[Group]) -> None:
        self.g = g
        members = {i for group in found for i in group.norms}
        self._groups = dict(enumerate(found))
        # The diagonal and the entries that are in no group (any more).
        self._own = dict.fromkeys(members, g.zero)
        self._rows: dict[int, Vector] = {i: {} for i in members}
        self._in: dict[int, set[int]] = {i: set() for i in members}
        for k, group in enumerate(found):
            if len(group.norms) == 1:
                self._dissolve(k)
            else:
                for i in group.norms:
                    self._in[i].add(k)
        self.columns: dict[int, Vector] = {}
        self.pivots: Vector = {}
        self._depths = dict.fromkeys(members, 0)
        queue = [self._key(t) for t in members]
        heapify(queue)
        while queue:
            key = heappop(queue)
            t = key[-1]
            if t in self.pivots or key != self._key(t):
                continue  # out of date: another entry has its degree
            self._eliminate(t)
            for i in self.columns[t]:
                self._depths[i] = max(self._depths[i], self._depths[t] + 1)
                heappush(queue, self._key(i))

    def _key(self, t: int) -> tuple[int, int, int]:
        """Rank in the elimination: fewest neighbours, then least depth."""
        met = set(self._rows[t]).union(*(self._groups[k].norms for k in self._in[t]))
        return len(met), self._depths[t], t

    def _add(self, i: int, j: int, term: int) -> None:
        g = self.g
        if i == j:
            self._own[i] = g.call("add", self._own[i], term)
        else:
            node = g.call("add", self._rows[i].get(j, g.zero), term)
            self._rows[i][j] = self._rows[j][i] = node

    def _dissolve(self, k: int) -> None:
        """Make entries of a group."""
        group = self._groups.pop(k)
        for i, norm in group.norms.items():
            self._in[i].discard(k)
            self._add(i, i, norm)
        for (i, j), product in group.dots.items():
            self._add(i, j, product)

    def _eliminate(self, t: int) -> None:
        g = self.g
        if len(self._in[t]) == 1 and not self._rows[t]:
            [k] = self._in[t]
            row, pivot, left = self._freed(t, k)
        else:
            for k in sorted(self._in[t]):
                self._dissolve(k)
            row, pivot, left = self._rows[t], self._own[t], {}
            for i in row:
                del self._rows[i][t]
        self.pivots[t] = pivot
        column = {i: g.call("div", node, pivot) for i, node in row.items()}
        self.columns[t] = column
        for i, j in combinations(sorted(row), 2):
            self._add(i, j, g.call("neg", g.call("mul", column[i], row[j])))
        for i in row:
            if i in left:
                self._add(i, i, g.call("div", left[i], pivot))
            else:
                self._add(i, i, g.call("neg", g.call("mul", column[i], row[i])))

    def _freed(self, t: int, k: int) -> tuple[Vector, int, Vector]:
        """Row, pivot, and pivot times the remainders, of t in group k alone."""
        g, group, own = self.g, self._groups.pop(k), self._own[t]
        pivot = g.call("add", own, group.norms[t])
        row, left = {}, {}
        for i, norm in group.norms.items():
            self._in[i].discard(k)
            if i == t:
                continue
            row[i] = group.dots[min(i, t), max(i, t)]
            squares = (
                (w, g.call("mul", area, area))
                for w, area in group.areas[min(i, t), max(i, t)]
            )
            rest = g.call("mul", own, norm)
            left[i] = g.call("add", rest, g.product_sum(squares))
        for (i, j), product in group.dots.items():
            if t not in (i, j):
                self._add(i, j, product)
        return row, pivot, left

    def solve(self, right: Mapping[int, int]) -> Vector:
        """Solution x; absent entries are zero."""
        g, z, x = self.g, dict(right), Vector()
        for t, column in self.columns.items():
            for i, entry in column.items():
                term = g.call("mul", entry, z.get(t, g.zero))
                z[i] = g.call("sub", z.get(i, g.zero), term)
        for t in reversed(self.columns):
            value = g.call("div", z.get(t, g.zero), self.pivots[t])
            for i, entry in self.columns[t].items():
                term = g.call("mul", entry, x.get(i, g.zero))
                value = g.call("sub", value, term)
            if value != g.zero:
                x[t] = value
        return x


def accelerations(e: Equations) -> list[int] | None:
    """Give q'' (n,); None where not all is masses on massless links."""
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
    """Tell whether all masses are positive at the values of the parameters."""
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
        forces[k] = g.call("add", forces.get(k, g.zero), force)
        for i, c in others.items():
            back = g.call("mul", c, force)
            forces[i] = g.call("sub", forces.get(i, g.zero), back)
    forces = {u: node for u, node in forces.items() if node != g.zero}
    return laws._replace(sums=sums, forces=forces), followers


def _commonest(g: Graph, nodes: Iterable[int]) -> int:
    [(node, _)] = Counter(nodes).most_common(1) or [(g.one, 1)]
    return node


def _alike(g: Graph, nodes: Vector) -> Vector:
    """Give nodes whose numbers differ by the rounding of quotients as the same ones."""
    met: dict[int, list[float]] = {}
    found = {}
    for k, node in nodes.items():
        number, rest = _number(g, node)
        numbers = met.setdefault(rest, [])
        same = (x for x in numbers if math.isclose(x, number, rel_tol=TERM_ROUNDOFF))
        number = next(same, number)
        numbers.append(number)
        found[k] = g.call("mul", g.constant(number), rest)
    return found


def _number(g: Graph, n: int) -> tuple[float, int]:
    """Give the number that a product of it and something else starts with."""
    number = 1.0
    while g.value(n) is None and g.args[n]:
        one, other = g.args[n][0], g.args[n][-1]
        if g.ops[n] == "neg":
            number, n = -number, one
        elif g.ops[n] == "div" and (below := g.value(other)):
            number, n = number / below, one
        elif g.ops[n] == "mul" and (factor := g.value(one)) is not None:
            number, n = number * factor, other
        elif g.ops[n] == "mul" and (factor := g.value(other)) is not None:
            number, n = number * factor, one
        else:
            return number, n
    value = g.value(n)
    return (number, n) if value is None else (number * value, g.one)


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
        """Give C^T of forces on sums."""
        g, masses, total = self.g, self.held.masses, dict(parts)
        for k, part in parts.items():
            for i, c in self.held.sums[k].items():
                if i in masses:
                    term = g.call("mul", c, part)
                    total[i] = g.call("sub", total.get(i, g.zero), term)
        return total

    def _fall(self) -> Vector:
        g, held = self.g, self.held
        unit = {u: g.call("mul", m, self.length) for u, m in held.masses.items()}
        pushed = {u: held.forces.get(u, g.zero) for u in held.masses}
        moved = g.dependent(pushed.values(), self.moving)
        still = {u: node for u, node in pushed.items() if node not in moved}
        fall = _alike(g, self._over(still, unit))
        for u in pushed.keys() - still.keys():
            fall[u] = g.variable(f"fall.{u}")
            self.known[fall[u]] = g.call("div", pushed[u], unit[u])
        for t, torque in self.torques.items():
            for u, part in self.turns[t].items():
                force = g.call("mul", g.call("mul", self.weights[u], part), torque)
                fall[u] = g.call("add", fall[u], force)
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
                found[u] = g.call("add", found[u], change)
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
