"""Which constraints are independent, and what the dependent ones say.

Rows are compared in the metric of M and scaled to length 1, so that neither units nor
the scale of a relation count. A nearly parallel row is a real constraint: only what
vanishes against RANK is dependent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.newton import RANK, reach

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility.point import Point
    from lagsim.native.kernel_types import Floats

# What dependent rows ask for may differ by this part of its size: rounding, and starts
# that were typed.
CONTRADICTION = 1e-8
# Bounds of rounding errors are to first order; this keeps them bounds.
CAUTION = 100.0
# How far, against the state, and how often generic states are looked for nearby.
NEARBY = 0.05
SAMPLES = 3
# Newton's method leaves such states a little off, and dependent rows a little less so.
GENERIC_RANK = 1e-8
LEVELS = ("position", "velocity", "acceleration")


@dataclass(frozen=True, slots=True)
class Dependence:
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
        return (
            text.removeprefix(" + ").replace(" - ", "-", 1)
            if (text.startswith(" - "))
            else text.removeprefix(" + ") or "0"
        )


@dataclass(frozen=True, slots=True)
class RankReport:
    """The rank of the rows at a state.

    Attributes
    ----------
    smallest : float
        The smallest singular value of the scaled rows that is not zero (1 if none).
    generic_rank, generic_smallest : int, float
        The same at generic admissible states nearby.
    dependences : tuple of Dependence
        One for each row that the earlier ones span, in the order of the file.
    not_unique : tuple of str
        The constraints whose multipliers are not determined.
    """

    rank: int
    smallest: float
    generic_rank: int
    generic_smallest: float
    dependences: tuple[Dependence, ...] = ()
    not_unique: tuple[str, ...] = ()

    @property
    def contradictory(self) -> bool:
        """Whether dependent rows contradict each other, on any level."""
        return any(d.contradictions for d in self.dependences)


def analyse(point: Point, q: Floats, v: Floats, metric: Floats) -> RankReport:
    """Find the rank of the constraint rows, and the dependent ones by name."""
    rows = point.e.rows
    if not rows:
        return RankReport(0, 1.0, 0, 1.0)
    Y, lengths = scaled_rows(point, q, v, metric)
    sizes = np.linalg.svd(Y, compute_uv=False)
    rank = int(np.sum(sizes > RANK))
    smallest = float(sizes[rank - 1]) if rank else 1.0
    flags = redundant_rows(Y)
    if not any(flags):
        return RankReport(rank, smallest, rank, smallest)
    independent = [i for i, flag in enumerate(flags) if not flag]
    generic = _generic(point, q, v, metric)
    everywhere = None if generic is None else generic[0] == rank
    asked = _Asked(point, q, v)
    dependences = []
    for i in [i for i, flag in enumerate(flags) if flag]:
        coefficients = _coefficients(Y, lengths, i, independent)
        dependences.append(
            Dependence(
                rows[i].name,
                tuple((rows[j].name, c) for j, c in coefficients.items()),
                everywhere,
                asked.contradictions(i, coefficients),
            )
        )
    left = np.linalg.svd(Y.T)[2][rank:]
    loose = np.any(np.abs(left) > 1e-9, axis=0)
    names = tuple(
        row.name for row, is_loose in zip(rows, loose, strict=True) if is_loose
    )
    generic_rank, generic_smallest = generic or (rank, smallest)
    return RankReport(
        rank, smallest, generic_rank, generic_smallest, tuple(dependences), names
    )


def scaled_rows(
    point: Point, q: Floats, v: Floats, metric: Floats
) -> tuple[Floats, Floats]:
    """Give the rows (m, n) in the metric, scaled to length 1, and their lengths."""
    A = np.nan_to_num(point.jacobian(point.e.rows, q, v))
    Y = np.linalg.solve(np.linalg.cholesky(metric), A.T).T
    lengths = np.linalg.norm(Y, axis=1)
    return Y / np.where(lengths > 0, lengths, 1.0)[:, None], lengths


def redundant_rows(Y: Floats) -> list[bool]:
    """Tell of each scaled row whether the earlier ones already span it."""
    basis: list[Floats] = []
    flags = []
    for row in Y:
        left = row.copy()
        for _ in range(2):  # twice is enough (Kahan)
            for b in basis:
                left -= (b @ left) * b
        length = float(np.linalg.norm(left))
        flags.append(length <= RANK)
        if not flags[-1]:
            basis.append(left / length)
    return flags


def _coefficients(
    Y: Floats, lengths: Floats, i: int, independent: Sequence[int]
) -> dict[int, float]:
    """Give row i as a combination of the independent rows before it."""
    before = [j for j in independent if j < i]
    if not before or lengths[i] == 0:
        return {}
    k = np.linalg.lstsq(Y[before].T, Y[i], rcond=RANK)[0]
    return {
        j: float(c * lengths[i] / lengths[j])
        for j, c in zip(before, k, strict=True)
        if abs(c) > 1e-9
    }


class _Asked:
    """What each row asks for on each level, with scales and rounding errors."""

    def __init__(self, point: Point, q: Floats, v: Floats) -> None:
        rows = point.e.rows
        levels = {
            "position": [r.residual if r.holonomic else point.g.zero for r in rows],
            "velocity": [r.rate for r in rows],
            "acceleration": [r.b for r in rows],
        }
        scales = {
            "position": [r.residual_scale for r in rows],
            "velocity": [r.rate_scale for r in rows],
        }
        self.values = {level: point.array(n, q, v) for level, n in levels.items()}
        self.errors = {
            level: point.rounding(n, q, v, {}) for level, n in levels.items()
        }
        self.scales = {level: point.array(n, q, v) for level, n in scales.items()}
        self.scales["acceleration"] = np.abs(self.values["acceleration"])

    def contradictions(self, i: int, others: dict[int, float]) -> dict[str, float]:
        """Give the levels on which row i differs from the combination of others."""
        found = {}
        for level in LEVELS:
            values, errors = self.values[level], self.errors[level]
            scales = self.scales[level]
            gap, scale, error = values[i], scales[i], errors[i]
            for j, c in others.items():
                gap = gap - c * values[j]
                scale, error = scale + abs(c) * scales[j], error + abs(c) * errors[j]
            if abs(gap) > CONTRADICTION * scale + CAUTION * error:
                found[level] = float(abs(gap))
        return found


def _generic(
    point: Point, q: Floats, v: Floats, metric: Floats
) -> tuple[int, float] | None:
    """Give rank and smallest singular value at generic admissible states nearby."""
    random = np.random.default_rng(1)  # the same states each time
    L = np.linalg.cholesky(metric)
    held = [row for row in point.e.rows if row.holonomic]
    everything = range(point.n)
    found: list[tuple[int, float]] = []
    for _ in range(SAMPLES):
        state = []
        for x in (q, v):
            size = np.sqrt(x @ metric @ x) or 1.0
            kick = np.linalg.solve(L.T, random.standard_normal(point.n))
            state.append(x + NEARBY * size * kick / np.sqrt(point.n))
        if held:
            equations = point.equations_for(
                [row.residual for row in held], np.zeros(len(held)), everything,
                state[0], state[1], velocities=False,
            )  # fmt: skip
            reached = reach(equations, state[0], metric)
            if not reached.met:
                continue
            state[0] = reached.x
        Y, _ = scaled_rows(point, state[0], state[1], metric)
        sizes = np.linalg.svd(Y, compute_uv=False)
        rank = int(np.sum(sizes > GENERIC_RANK))
        found.append((rank, float(sizes[rank - 1]) if rank else 1.0))
    return max(found, default=None)


def weakest_rows(point: Point, q: Floats, v: Floats) -> tuple[list[str], float]:
    """Give the constraints that are closest to dependent, and how close they are."""
    metric = np.diag(np.maximum(np.diag(point.mass(q, v)), 0.0))
    metric[metric.diagonal() == 0, metric.diagonal() == 0] = 1.0
    Y, _ = scaled_rows(point, q, v, metric)
    left, sizes, _ = np.linalg.svd(Y)
    weights = np.abs(left[:, len(sizes) - 1])
    names = [row.name for row in point.e.rows]
    chosen = [n for n, w in zip(names, weights, strict=True) if w > 1e-3]
    return chosen, float(sizes[-1])
