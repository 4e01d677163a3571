"""Values of the start that are solved for: guesses, exact states, the nearest state."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility import large
from lagsim.admissibility.lengths import Form, Lengths
from lagsim.admissibility.metric import metric_of
from lagsim.admissibility.newton import Found, Trouble, nearest, reach
from lagsim.admissibility.point import Asked
from lagsim.language.derivatives import slopes
from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.point import AtState, Point
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row

# Other roots are looked for from this many starts around the guess, this far away.
OTHER_STARTS = 16
AROUND = 1.0
# A whole turn of an angle.
TURN = 2.0 * math.pi
# The rows that share in a least residual: their distances, against the largest.
SHARES = 1e-6


class Solver:
    """Solves for values of the start, and keeps what there is to say about that."""

    def __init__(
        self, point: Point, q: Floats, v: Floats, errors: Mapping[str, float]
    ) -> None:
        self.point, self.e = point, point.e
        self.stated, self.errors = (q, v), errors
        self.warnings: list[Caution] = []
        # Positions were found as a double root, and are known to half of the digits.
        self.double = False
        # One-sided relations that are to be met as equalities.
        self.touching: dict[str, Row] = {}

    def metric(self, free: Sequence[int]) -> Floats:
        """Give the metric of least change on the values `free`: M as it was stated."""
        M = self.point.mass(*self.stated, free)
        return metric_of(M, range(len(free)))

    def _nearest(self, relations: AtState, x: Floats, *, far: bool = True) -> Found:
        """Give the point nearest to x that meets the relations."""
        free = relations.free
        if len(free) >= large.LARGE and self._is_positive:
            entries = self.point.mass_entries(*self.stated, free)
            M = large.matrix(entries, len(free), len(free))
            found = large.nearest(relations, x, M)
            if found is not None:
                return found
        return nearest(relations, x, self.metric(free), far=far)

    @cached_property
    def _is_positive(self) -> bool:
        return large.is_positive(self.point, *self.stated)

    def asked(self, *, velocities: bool, definitions: bool = True) -> Asked:
        """Give what is asked of positions, or of velocities."""
        asked, g = Asked(), self.e.graph
        for row in (*self.e.rows, *self.touching.values()):
            if not velocities and row.holonomic:
                asked.add(row.name, row.residual, row.residual_scale)
            elif velocities and (not row.holonomic or row.name not in self.touching):
                asked.add(row.name, row.rate, row.rate_scale)
        names = frozenset(self.e.velocities)
        for wanted in self.e.model.initial if definitions else ():
            node = wanted.node
            if node is None or bool(g.depends([node]) & names) is not velocities:
                continue
            size = g.call("abs", node)
            asked.add(
                f"{wanted.name}: {wanted.text}", node, size, wanted.value, wanted.error
            )
        return asked

    def touch(self, rows: Mapping[str, Row]) -> None:
        """Ask of one-sided relations that they just hold."""
        self.touching |= rows

    def relations(
        self,
        free: Sequence[int],
        q: Floats,
        v: Floats,
        *,
        velocities: bool,
        definitions: bool = True,
    ) -> AtState:
        """Give what is asked of the values `free`."""
        asked = self.asked(velocities=velocities, definitions=definitions)
        return self.point.relations(
            asked, free, q, v, self.errors, velocities=velocities
        )

    def names(self, free: Sequence[int], *, velocities: bool) -> list[str]:
        """Give the names of the values `free`."""
        return [(self.e.velocities if velocities else self.e.q)[j] for j in free]

    def nearest(
        self, free: Sequence[int], q: Floats, v: Floats, *, velocities: bool
    ) -> Found:
        """Solve for the values `free`, from where they are."""
        asked = self.asked(velocities=velocities)
        x = (v if velocities else q)[list(free)]
        if not asked.nodes:
            return Found(x, met=True)
        relations = self.relations(free, q, v, velocities=velocities)
        found = self._nearest(relations, x)
        return self._noted(found, relations, asked.names, free, velocities)

    def guesses(
        self, free: Sequence[int], q: Floats, v: Floats, *, velocities: bool
    ) -> Found:
        """Solve for guesses: the nearest of several roots, and a hint that there are.

        A guess that nothing determines stays as given.
        """
        found = self.nearest(free, q, v, velocities=velocities)
        if not found.met:
            return found
        x0 = (v if velocities else q)[list(free)]
        names = self.names(free, velocities=velocities)
        if not self.asked(velocities=velocities).nodes:
            self._undetermined(names, "nothing determines")
            return found
        relations = self.relations(free, q, v, velocities=velocities)
        found = self._closest_root(relations, x0, found, free, velocities)
        named = {k for row in relations.slopes for k in row}
        flat, still = (
            np.all(np.nan_to_num(relations(x)[1]) == 0.0, axis=0) for x in (x0, found.x)
        )
        still = flat & still
        stays = [k for k in named if still[k] and found.x[k] == x0[k]]
        self._undetermined(
            [x for k, x in enumerate(names) if k not in named], "nothing determines"
        )
        self._undetermined(
            [names[k] for k in sorted(stays)], "to first order nothing determines"
        )
        moved = found.x != x0
        if np.any(moved) and np.all(flat[moved]):
            self._warn(
                "other-roots",
                "at the guess the relations have no slope: other solutions are as "
                f"near, such as {_listed(names, found.x)}",
            )
        return found

    def _undetermined(self, names: Sequence[str], what: str) -> None:
        for name in names:
            text = f"{what} the guess `{name}`: it stays as given"
            self._warn("undetermined-guess", text)

    def _closest_root(
        self,
        relations: AtState,
        x0: Floats,
        found: Found,
        free: Sequence[int],
        velocities: bool,
    ) -> Found:
        """Look for other roots around a guess; take the nearest, and say so."""
        J = relations(found.x)[1]
        double = found.trouble is Trouble.DOUBLE_ROOT
        if double or not np.all(np.isfinite(J)) or np.linalg.matrix_rank(J) < len(free):
            return found  # a family of roots: the nearest of them has been found
        random = np.random.default_rng(3)  # the same starts each time
        size = self._spread(relations, x0, found.x, velocities=velocities)
        size = np.maximum(size, np.abs(x0 - found.x))
        size[size == 0] = 1.0
        metric = self.metric(free)
        roots = [found.x if velocities else _unwound(relations, found.x, x0)]
        for _ in range(OTHER_STARTS):
            start = x0 + AROUND * size * random.standard_normal(len(free))
            other = reach(relations, start, metric, x0)
            if not other.met:
                continue
            x = other.x if velocities else _unwound(relations, other.x, x0)
            if all(np.max(np.abs(x - r) / size) > 1e-6 for r in roots):
                roots.append(x)
        if len(roots) == 1:
            return found
        roots.sort(key=lambda r: float((r - x0) @ metric @ (r - x0)))
        names = self.names(free, velocities=velocities)
        listed = "; ".join(_listed(names, root) for root in roots[1:3])
        self._warn(
            "other-roots",
            f"the guesses have other solutions too, such as {listed}; the nearest to "
            "the guess is taken",
        )
        return Found(roots[0], met=True)

    def _spread(
        self, relations: AtState, x0: Floats, x: Floats, *, velocities: bool
    ) -> Floats:
        """Give how far around a root x, found from x0, others are looked for."""
        if velocities:  # 0 may be found as 1e-60
            return np.full(len(x), np.max(np.abs([x0, x]), initial=0.0))
        q, v = relations.state(x)
        g, places = self.e.graph, {}
        for j, name in enumerate(self.e.q):
            places[g.variable(name)] = j
        forms = []
        for node in relations.asked.nodes:
            found = slopes(g, node, frozenset(places))
            forms.append(Form(node, {places[x]: slope for x, slope in found.items()}))
        spread = Lengths(self.point, forms, q, v).spread
        return np.asarray(spread[relations.free])

    def _noted(
        self,
        found: Found,
        relations: AtState,
        asked: Sequence[str],
        free: Sequence[int],
        velocities: bool,
    ) -> Found:
        """Say what was odd about a root, or why there is none."""
        where = _listed(self.names(free, velocities=velocities), found.x)
        residual, J = relations(found.x)
        worst = int(np.argmax(np.abs(residual)))
        name = asked[worst]
        if found.met:
            if found.trouble is Trouble.DOUBLE_ROOT:
                self.double |= not velocities
                self._warn(
                    "double-root",
                    f"Newton's method converges only linearly, to {where}: a "
                    f"double root of `{name}`, or a singular configuration; the "
                    "multiplier there is not reliable",
                )
            return found
        least = f"the least |residual| is {abs(residual[worst]):.6g}, at {where}"
        if found.trouble is Trouble.MINIMUM:
            lengths = np.linalg.norm(J, axis=1)
            lengths[lengths == 0] = 1.0
            far = np.abs(residual) / lengths
            shared = far > SHARES * np.max(far)
            named = [f"`{x}`" for x, is_in in zip(asked, shared, strict=True) if is_in]
            what = " and ".join(named)
            together = " together" if len(named) > 1 else ""
            reason = f"{what} cannot be satisfied{together} near there: {least}"
        elif found.trouble is Trouble.RUNS_AWAY:
            reason = f"the guess diverges: no finite value satisfies `{name}`: {least}"
        elif found.trouble is Trouble.RANK_LOSS:
            reason = (
                f"the constraints become dependent before `{name}` is satisfied: "
                f"{least}"
            )
        else:
            reason = f"`{name}` has no finite value near {where}"
        return found._replace(reason=reason, least=least)

    def _warn(self, code: str, text: str) -> None:
        self.warnings.append(Caution(code, text))

    def exact(
        self, free: Sequence[int], q: Floats, v: Floats, *, velocities: bool
    ) -> Floats:
        """Give the nearest exact values; those that are exact to rounding stay."""
        x = v if velocities else q
        if not self.asked(velocities=velocities, definitions=False).nodes:
            return x
        relations = self.relations(free, q, v, velocities=velocities, definitions=False)
        found = self._nearest(relations, x, far=False)
        return found.x if found.met else x


def _unwound(relations: AtState, x: Floats, near: Floats) -> Floats:
    """Give a root without the whole turns of its angles that lead away from a guess.

    An angle is a component whose turn changes no relation: at the root, and beside it.
    """
    turns = np.rint((x - near) / TURN)
    for k in np.flatnonzero(turns):
        turn = np.zeros(len(x))
        turn[k] = TURN
        for at in (x, near + 0.1 * (x - near)):
            (r, J), (turned, slopes) = relations(at), relations(at + turn)
            size = 1e-9 * (np.abs(r) + TURN * np.linalg.norm(J, axis=1))
            same = np.all(np.abs(turned - r) <= size)
            if not (same and np.all(np.abs(slopes - J) <= size[:, None])):
                turns[k] = 0.0
    return np.asarray(x - TURN * turns)


def _listed(names: Sequence[str], values: Floats) -> str:
    return ", ".join(f"{n} = {x:.6g}" for n, x in zip(names, values, strict=True))
