"""The certificate on random systems built with known rank, kernel and scaling."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from tests.admissibility.scenes import judged

# How far rows, and units, are scaled.
ROWS, UNITS = 8.0, 6.0


def reduced(rows: list[list[int]]) -> list[list[Fraction]]:
    """Give the coefficients of each dependent row in the independent ones before it.

    Exactly; None in the place of independent rows.
    """
    basis: list[tuple[list[Fraction], list[Fraction], int]] = []
    found: list[Any] = []
    for i, row in enumerate(rows):
        left = [Fraction(x) for x in row]
        made = [Fraction(0)] * len(rows)  # row - left, in the rows
        for reduced_row, combination, pivot in basis:
            k = left[pivot] / reduced_row[pivot]
            left = [a - k * b for a, b in zip(left, reduced_row, strict=True)]
            made = [a + k * b for a, b in zip(made, combination, strict=True)]
        pivot = next((j for j, x in enumerate(left) if x), None)
        if pivot is None:
            found.append(made)
            continue
        found.append(None)
        combination = [-a for a in made]
        combination[i] += 1
        basis.append((left, combination, pivot))
    return found


@dataclass
class Case:
    """A model text, and what is true of it."""

    text: str
    rank: int
    flags: list[bool]
    coefficients: list[dict[str, float]]
    not_unique: set[str]
    contradictory: str


def case(seed: int) -> Case:
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 7))
    r = int(random.integers(1, n + 1))
    extra = int(random.integers(0, 4))
    base = random.integers(-4, 5, (r, n))
    combine = random.integers(-3, 4, (extra, r)) * (random.random((extra, r)) < 0.7)
    order = random.permutation(r + extra)
    mixed = np.vstack([np.eye(r, dtype=int), combine])[order]
    rows = (mixed @ base).tolist()
    keep = [k for k, row in enumerate(rows) if any(row)]
    mixed, rows = mixed[keep], [rows[k] for k in keep]
    names = [f"c{k}" for k in range(len(rows))]
    scale = 10.0 ** random.uniform(-ROWS, ROWS, len(rows))
    unit = 10.0 ** random.uniform(-UNITS, UNITS, n)
    start = random.integers(-3, 4, n) * unit
    bend = random.integers(-2, 3, (r, n)) * int(random.random() < 0.5)
    if np.linalg.matrix_rank(base) < r:
        bend *= 0  # or the base rows would depend on each other only here
    made = reduced(rows)
    flags = [m is not None for m in made]
    contradictory = ""
    offset = np.zeros(len(rows))
    if any(flags) and random.random() < 0.3:
        k = int(random.choice(np.flatnonzero(flags)))
        offset[k], contradictory = 0.5, names[k]
    lines = [
        relation(mixed[k], base, bend, start, unit, scale[k], offset[k])
        for k in range(len(rows))
    ]
    half = random.standard_normal((n, n))
    M = (half @ half.T + np.eye(n)) / np.outer(unit, unit)
    coefficients = []
    loose = set()
    for k, m in enumerate(made):
        if m is None:
            continue
        used = {j: float(c) * scale[k] / scale[j] for j, c in enumerate(m) if c}
        coefficients.append({names[j]: c for j, c in used.items()})
        loose |= {names[k], *coefficients[-1]}
    return Case(
        model(names, lines, M, start),
        flags.count(False), flags, coefficients, loose, contradictory,
    )  # fmt: skip


def relation(mix, base, bend, start, unit, scale, offset) -> str:
    """Give scale * (combination of the base functions) = offset of that size."""
    terms = []
    for j in range(len(start)):
        shifted = f"(x{j} - {float(start[j])!r})"
        slope = float(scale * (mix @ base[:, j]) / unit[j])
        if slope:
            terms.append(f"{slope!r}*{shifted}")
        curve = float(scale * (mix @ bend[:, j]) / unit[j] ** 2)
        if curve:
            terms.append(f"{curve!r}*{shifted}^2")
    return f"{' + '.join(terms)} = {float(offset * scale)!r}"


def model(names, lines, M, start) -> str:
    n = len(start)
    energy = " + ".join(
        f"{float(M[i, j]) / 2!r}*x{i}_dot*x{j}_dot" for i in range(n) for j in range(n)
    )
    return "\n".join(
        [
            "coordinates: {" + ", ".join(f"x{j}: " for j in range(n)) + "}",
            f'energy: {{kinetic: "{energy}", potential: 0}}',
            "constraints:",
            *(f'  {k}: "{x}"' for k, x in zip(names, lines, strict=True)),
            "initial:",
            *(f"  x{j}: {float(start[j])!r}" for j in range(n)),
        ]
    )


def check(seed: int) -> None:
    known = case(seed)
    found = judged(known.text)
    ranks = found.ranks
    assert ranks.rank == known.rank
    assert found.degrees_of_freedom == len(found.state.q) - known.rank
    assert [v.redundant for v in found.verdicts] == known.flags
    assert set(ranks.not_unique) == known.not_unique
    assert [set(dict(d.combination)) for d in ranks.dependences] == [
        set(c) for c in known.coefficients
    ]
    for d, expected in zip(ranks.dependences, known.coefficients, strict=True):
        # The condition of some integer rows of length 6, times rounding.
        assert dict(d.combination) == pytest.approx(expected, rel=1e-9)
    assert found.admissible is not bool(known.contradictory)
    if known.contradictory:
        assert found.repair is None
        assert known.contradictory in {
            name
            for d in found.contradictions
            for name in (d.name, *dict(d.combination))
        }
    else:
        assert all(d.everywhere for d in ranks.dependences)
        assert ranks.generic_rank == known.rank


@pytest.mark.parametrize(
    "block", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))]
)
def test_rank_combinations_and_consistency(block):
    for seed in range(20 * block, 20 * block + 20):
        check(seed)


@pytest.mark.parametrize(
    "block",
    [pytest.param(k, marks=pytest.mark.nightly) for k in range(20)],
)
def test_rank_combinations_and_consistency_of_2000(block):
    for seed in range(1000 + 100 * block, 1100 + 100 * block):
        check(seed)
