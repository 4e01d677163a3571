"""Accelerations of masses on massless links, by the forces in the links.

What has no inertia hands forces on: of the forces F on two sums that have an angle
theta without inertia in common, c F = torque leaves one unknown, along the link (see
`joints`). With the laws of `newton`, in which C u'' = drift holds the sums together,

    u'' = (force + C^T F) / m,    F = E x + N torque,    c E = 0,    c N = 1,
    E^T C u'' = E^T drift,    theta'' = N^T (C u'' - drift),

M is never made, and S x = r for the tensions x is a sum of squares of what pulls at
each mass: see `squares`. Of equal links in the plane it is the tridiagonal matrix of
textbooks, 2 on the diagonal and -cos(a_k - a_k+1) beside it.
Source: A. Fijany, I. Sharf and G. M. T. D'Eleuterio, IEEE Transactions on Robotics and
Automation 11 (1995) 389: the constraint force algorithm.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.evaluate import UNIT_ROUNDOFF, evaluate
from lagsim.language.normal_form import normal_form
from lagsim.language.trigonometry import fewer_terms
from lagsim.mechanics.joints import Joints, joints
from lagsim.mechanics.newton import Newton, newton
from lagsim.mechanics.squares import Squares, groups, weighted

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations

# Of a few operations: what numbers in a file may differ by.
ROUNDED = 8 * UNIT_ROUNDOFF

Vector = dict[int, int]  # unknown, sum or link -> node; what is absent is zero


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
        same = (x for x in numbers if math.isclose(x, number, rel_tol=ROUNDED))
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
        """Give quotients, with what both have in common cancelled."""
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
        """Give u'' of all that has a mass, and of what has none."""
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
        """Give what variables stand for."""
        g, known = self.g, dict(self.known)
        unit = g.call("mul", self.mass, self.length)
        for t, variable in self.torques.items():
            joint = self.joints[t]
            force = self.held.forces[joint.velocity]
            force = g.call("div", force, g.call("mul", unit, joint.length))
            known[variable] = g.call("div", force, squares[t])
        return known

    def _levers(self) -> dict[int, Vector]:
        """Give for each angle what tensions turn it by."""
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
