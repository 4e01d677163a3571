"""Dependent rows: their combinations, contradictions, and the sets that they make."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.large import is_large
from lagsim.admissibility.lengths import of_rows
from lagsim.admissibility.newton import (
    SOLVED,
    cholesky,
    least_squares,
    null_space,
    rank_metric,
    reach,
)
from lagsim.admissibility.point import Asked

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.admissibility.point import AtState, Point
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row


# What dependent rows ask for may differ by this part of its size: rounding, and starts
# that were typed.
CONTRADICTION = 1e-8
# Bounds of rounding errors are to first order; this keeps them bounds.
CAUTION = 100.0
LEVELS = ("position", "velocity", "acceleration")


class Dependence(NamedTuple):
    """A row that others span: row = sum of coefficient times row.

    Attributes
    ----------
    combination : tuple of (name, coefficient)
        Empty where the row itself vanishes.
    everywhere : bool or None
        Whether it is so at generic admissible states nearby, or only here; None where
        no such state was found.
    contradictions : dict
        Level -> by how much what the row asks for differs from what the others imply.
    """

    name: str
    combination: tuple[tuple[str, float], ...]
    everywhere: bool | None
    contradictions: dict[str, float]

    def __str__(self) -> str:
        return f"{self.name} = {self.right_side()}"

    def right_side(self) -> str:
        """Give the combination as text, `2 c1 - c2`."""
        text = ""
        for name, c in self.combination:
            sign = " - " if c < 0 else " + "
            size = "" if abs(abs(c) - 1) < 1e-9 else f"{abs(c):.6g} "
            text += f"{sign}{size}{name}"
        if text.startswith(" - "):
            return "-" + text.removeprefix(" - ")
        return text.removeprefix(" + ") or "0"

    def contradiction(self) -> str:
        """Name what contradicts what, on the first level that does; empty if none."""
        for level, size in self.contradictions.items():
            if not self.combination:
                return (
                    f"`{self.name}` cannot be satisfied on the level of {level}: "
                    f"its gradient vanishes, and it is off by {size:.6g}"
                )
            others = " and ".join(f"`{name}`" for name, _ in self.combination)
            return (
                f"`{self.name}` contradicts {others} on the level of {level}, "
                f"by {size:.6g}"
            )
        return ""


class Demands:
    """What each row asks for on each level, with scales and rounding errors."""

    def __init__(
        self,
        point: Point,
        q: Floats,
        v: Floats,
        errors: Mapping[str, float],
        levels: Sequence[str],
    ) -> None:
        rows = point.e.rows
        nodes = {
            "position": [r.residual if r.holonomic else point.g.zero for r in rows],
            "velocity": [r.rate for r in rows],
            "acceleration": [r.b for r in rows],
        }
        sizes = {
            "position": [r.residual_scale for r in rows],
            "velocity": [r.rate_scale for r in rows],
            "acceleration": nodes["acceleration"],
        }
        self.levels = levels
        self.values = {k: point.array(nodes[k], q, v) for k in levels}
        self.errors = {k: point.rounding(nodes[k], q, v, errors) for k in levels}
        self.scales = {k: abs(point.array(sizes[k], q, v)) for k in levels}
        # Not with terms that only the distance from the origin makes large.
        lengths = of_rows(point, rows, q, v)
        for level, own in (("position", lengths.scales), ("velocity", lengths.motions)):
            if level in levels:
                self.scales[level] = np.fmin(self.scales[level], own())

    def contradictions(self, i: int, others: dict[int, float]) -> dict[str, float]:
        """Give the levels on which row i differs from the combination of others."""
        found = {}
        for level in self.levels:
            # That a vanishing row is not met is no contradiction yet: states elsewhere
            # may meet it.
            if level == "position" and not others:
                continue
            values, errors = self.values[level], self.errors[level]
            scales = self.scales[level]
            gap, scale, error = values[i], scales[i], errors[i]
            for j, c in others.items():
                gap = gap - c * values[j]
                scale, error = scale + abs(c) * scales[j], error + abs(c) * errors[j]
            if abs(gap) > CONTRADICTION * scale + CAUTION * error:
                found[level] = float(abs(gap))
        return found


# --- The set of admissible positions that a dependent constraint makes
#
# A row that others span may be one relation too many: then all states that the others
# admit meet it, too. It may be dependent only at a singular configuration, where
# motions branch. Or it is dependent all over the set that it makes, as that of x^2 +
# y^2 = 0, of two spheres that touch, or of a plane and a cylinder that touch along a
# line: the relation holds there as a multiple root. No multiplier keeps a motion on
# such a set.
#
# The first is tried on states that the other rows admit; of the others `rank` tells
# where it finds states nearby, else second derivatives do: where what the row adds to
# the others has one sign all around, the set is thin.

# How far, against their lengths, states are varied, and how often.
NEARBY = 1e-2
SAMPLES = 8
# What a state misses a row by is rounding below this part of what the way changes.
TRACE = 1e-10
# Second derivatives below this part of what they cancel from are none; of the greatest.
FLAT = 1e-9
ONE_SIGN = 1e-7
# Coordinates up to which the dimension of a set is measured; points that lie apart by
# less than this part of the way that they were sent do not span it.
MOST = 60
THIN = 0.05


class ThinSet(NamedTuple):
    """A set of admissible positions on which rows lose their rank all over.

    Attributes
    ----------
    names : tuple of str
        The rows that are dependent there, and are met nowhere around it.
    dimension : int or None
        Of the set; None where it was not found.
    degrees_of_freedom : int or None
        The dimension less the independent relations between velocities.
    """

    names: tuple[str, ...]
    dimension: int | None
    degrees_of_freedom: int | None = None

    def __str__(self) -> str:
        named = " and ".join(f"`{name}`" for name in self.names)
        text = (
            f"{named} has only a multiple root: the constraints lose rank at every "
            "admissible state, and no multiplier keeps a motion admissible"
        )
        if self.dimension is None:
            return text
        if self.dimension == 0:
            return f"{text}; there is one admissible state, an isolated point"
        return f"{text}; the admissible states have dimension {self.dimension}"


class Varied:
    """States around an admissible one that some of its rows admit."""

    def __init__(self, point: Point, q: Floats, v: Floats, *, velocities: bool) -> None:
        self.point, self.state, self.velocities = point, (q, v), velocities
        self.x = v if velocities else q
        rows = point.e.rows
        self.metric = rank_metric(point.mass(q, v), point.jacobian(rows, q, v))
        if velocities:
            speed = float(np.sqrt(v @ self.metric @ v)) or 1.0
            own = speed / np.sqrt(np.diag(self.metric))
            self.spread = np.where(v != 0.0, np.abs(v), own)
        else:
            self.spread = of_rows(point, rows, q, v).spread

    def at_least(self, way: Floats) -> None:
        """Go as far as `way` where any way is gone."""
        self.spread = np.where(self.spread > 0.0, np.fmax(self.spread, way), 0.0)

    def relations(self, rows: Sequence[Row]) -> AtState:
        """Give what `rows` ask of all positions, or of all velocities."""
        asked = Asked()
        for row in rows:
            if self.velocities:
                asked.add(row.name, row.rate, row.rate_scale)
            else:
                asked.add(row.name, row.residual, row.residual_scale)
        return self.point.relations(
            asked, range(self.point.n), *self.state, {}, velocities=self.velocities
        )

    def states(self, rows: Sequence[Row], count: int) -> list[Floats]:
        """Give states around, of those that `rows` admit."""
        random = np.random.default_rng(7)  # the same each time
        found = []
        relations = self.relations(rows)
        for _ in range(count):
            kick = np.clip(random.standard_normal(self.point.n), -1.0, 1.0)
            x = self.x + NEARBY * self.spread * kick
            if rows:
                reached = reach(relations, x, self.metric)
                if not reached.met:
                    continue
                x = reached.x
            found.append(x)
        return found

    def traces(self, asked: AtState, states: Sequence[Floats]) -> Floats:
        """Give what rounding may leave in rows at the states, (states, rows)."""
        L = cholesky(self.metric)
        slopes = np.linalg.norm(np.linalg.solve(L, asked(self.x)[1].T), axis=0)
        ways = [np.linalg.norm(L.T @ (x - self.x)) for x in states]
        return np.asarray(TRACE * np.outer(ways, slopes))

    def dimension(self, rows: Sequence[Row]) -> int | None:
        """Give the dimension of the set that `rows` admit around here."""
        n = self.point.n
        if n > MOST:
            return None
        self.spread = np.where(self.spread > 0.0, self.spread, self._sizes())
        states = self.states(rows, n + 2)
        if len(states) < n + 1:
            return None
        ways = (np.array(states) - self.x) / (NEARBY * self.spread)
        return int(np.sum(np.linalg.svd(ways, compute_uv=False) > THIN))

    def _sizes(self) -> Floats:
        weights = np.sqrt(np.diag(self.metric))
        known = self.spread * weights
        return np.asarray((np.max(known, initial=0.0) or 1.0) / weights)


def thin_set(
    point: Point,
    q: Floats,
    v: Floats,
    dependences: Sequence[Dependence],
    ways: tuple[Floats, Floats],
) -> tuple[ThinSet | None, tuple[str, ...]]:
    """Find the rows that hold as multiple roots on the whole set through q.

    Parameters
    ----------
    ways
        How far positions and velocities were moved to get here: that far around a
        double root lengths are not known.

    Returns
    -------
    thin : ThinSet or None
    real : tuple of str
        Dependent rows that states admitted by the others do not meet.
    """
    suspects = [d for d in dependences if d.everywhere is not False]
    if not suspects or is_large(point):
        return None, ()
    dependent = {d.name for d in dependences}
    held = [row for row in point.e.rows if row.holonomic]
    varied = Varied(point, q, v, velocities=False)
    varied.at_least(ways[0])
    thin, real = _thin_rows(varied, held, suspects, dependent)
    if thin:
        dimension = varied.dimension(held)
        free = {row.name for row in point.e.rows if not row.holonomic} - dependent
        freedom = None if dimension is None else dimension - len(free)
        return ThinSet(thin, dimension, freedom), real
    names = frozenset(point.e.velocities)
    bent = {
        row.name
        for row in point.e.rows
        if not row.holonomic and point.g.depends(row.A.entries.values()) & names
    }
    suspects = [d for d in suspects if d.name in bent]
    if not suspects:
        return None, real
    varied = Varied(point, q, v, velocities=True)
    varied.at_least(ways[1])
    thin, more = _thin_rows(varied, point.e.rows, suspects, dependent)
    if not thin:
        return None, real + more
    freedom = varied.dimension(point.e.rows)
    return ThinSet(thin, None, freedom), real + more


def _thin_rows(
    varied: Varied,
    rows: Sequence[Row],
    dependences: Sequence[Dependence],
    dependent: Collection[str],
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Give the dependent rows that make the set thin, and those that others miss."""
    known = {row.name: row for row in rows}
    suspects = [d for d in dependences if d.name in known]
    independent = [row for row in rows if row.name not in dependent]
    # Where they leave no way but the state itself, no other state tells anything.
    if not suspects or len(independent) >= varied.point.n:
        return (), ()
    states = varied.states(independent, SAMPLES)
    if not states:
        return (), ()
    asked = varied.relations([known[d.name] for d in suspects])
    values = np.array([asked(x)[0] for x in states])
    missed = np.array([asked.missed(x, SOLVED * np.abs(x)) for x in states])
    missed &= np.abs(values) > varied.traces(asked, states)
    thin, real = [], []
    for i, d in enumerate(suspects):
        if not np.any(missed[:, i]):
            continue
        real.append(d.name)
        signs = np.sign(values[:, i])
        one_sign = bool(np.all(missed[:, i]) and np.all(signs == signs[0]))
        if d.everywhere or _is_extreme(varied, independent, known[d.name], one_sign):
            thin.append(d.name)
    return tuple(thin), tuple(real)


def _is_extreme(
    varied: Varied, independent: Sequence[Row], row: Row, one_sign: bool
) -> bool:
    """Tell whether what a row adds to others has one sign all around the state."""
    relations = varied.relations([*independent, row])
    x = varied.x
    J = relations(x)[1]
    shares = least_squares(J[:-1].T, J[-1], None) if len(J) > 1 else np.zeros(0)
    weights = np.append(-shares, 1.0)
    L = cholesky(varied.metric)
    scaled = np.asarray(np.linalg.solve(L, J[:-1].T).T, dtype=float)
    kernel = np.asarray(np.linalg.solve(L.T, null_space(scaled)), dtype=float)
    bends = np.linalg.eigvalsh(kernel.T @ relations.curvature(x, weights) @ kernel)
    parts = [
        abs(w) * np.linalg.norm(relations.curvature(x, e))
        for w, e in zip(weights, np.eye(len(weights)), strict=True)
    ]
    size = float(np.max(np.abs(bends), initial=0.0))
    if size <= FLAT * sum(parts):
        return one_sign
    return bool(bends[0] > -ONE_SIGN * size or bends[-1] < ONE_SIGN * size)
