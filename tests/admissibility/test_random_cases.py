"""The certificate on random systems built with known rank, kernel and scaling."""

from __future__ import annotations

import numpy as np
import pytest

from tests.admissibility.scenes import judged, scene

# How far rows, and units, are scaled: powers of ten.
ROWS, UNITS = 8.0, 6.0


def dependent(rows):
    """Return each row in the span of earlier rows, by number, with the coefficients."""
    held, found = [], {}
    for k, row in enumerate(rows):
        if np.linalg.matrix_rank(rows[[*held, k]]) > len(held):
            held.append(k)
            continue
        parts = np.linalg.lstsq(rows[held].T, row, rcond=None)[0]
        known = zip(held, parts.tolist(), strict=True)
        found[k] = {j: c for j, c in known if abs(c) > 1e-9}
    return found


def check(seed: int) -> None:
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 7))
    r, extra = int(random.integers(1, n + 1)), int(random.integers(0, 4))
    base = random.integers(-4, 5, (r, n))
    mix = random.integers(-3, 4, (extra, r)) * (random.random((extra, r)) < 0.7)
    mix = np.vstack([np.eye(r, dtype=int), mix])[random.permutation(r + extra)]
    mix = mix[np.any(mix @ base, axis=1)]
    rows = mix @ base
    spanned = dependent(rows)
    scale = 10.0 ** random.uniform(-ROWS, ROWS, len(rows))
    unit = 10.0 ** random.uniform(-UNITS, UNITS, n)
    at = (random.integers(-3, 4, n) * unit).tolist()
    # Curved, unless the base rows would depend on each other only here.
    whole = np.linalg.matrix_rank(base) == r
    bend = mix @ random.integers(-2, 3, (r, n)) * (whole and random.random() < 0.5)
    wrong = -1
    if spanned and random.random() < 0.3:
        wrong = int(random.choice([*spanned]))

    def relation(k):
        """Return scale * (combination of base functions) = 0, or its contradiction."""
        terms = []
        for j, x in enumerate(at):
            for power, table in enumerate((rows, bend), 1):
                if slope := float(scale[k] * table[k, j] / unit[j] ** power):
                    terms.append(f"{slope!r}*(x{j} - {x!r})^{power}")
        return f"{' + '.join(terms)} = {float(0.5 * (k == wrong) * scale[k])!r}"

    half = random.standard_normal((n, n))
    M = (half @ half.T + np.eye(n)) / np.outer(unit, unit)
    energy = " + ".join(
        f"{float(x) / 2!r}*x{i}_dot*x{j}_dot" for (i, j), x in np.ndenumerate(M)
    )
    relations = {f"c{k}": relation(k) for k in range(len(rows))}
    start = {f"x{j}": x for j, x in enumerate(at)}
    found = judged(scene(relations, start, kinetic=energy))
    ranks, rank = found.ranks, len(rows) - len(spanned)
    assert ranks.rank == rank
    assert found.degrees_of_freedom == n - rank
    redundant = {k for k, v in enumerate(found.verdicts) if v.redundant}
    assert redundant == spanned.keys()
    loose = {k for k, c in spanned.items() for k in (k, *c)}
    assert set(ranks.not_unique) == {f"c{k}" for k in loose}
    assert len(ranks.dependences) == len(spanned)
    for d, (k, known) in zip(ranks.dependences, spanned.items(), strict=True):
        # The condition of some integer rows of length 6, times rounding.
        expected = {f"c{j}": c * scale[k] / scale[j] for j, c in known.items()}
        assert (d.name, dict(d.combination)) == (f"c{k}", pytest.approx(expected, 1e-9))
    assert found.admissible is (wrong < 0)
    if wrong >= 0:
        assert found.repair is None
        named = [{d.name, *dict(d.combination)} for d in found.contradictions]
        assert f"c{wrong}" in set().union(*named)
    else:
        assert all(d.everywhere for d in ranks.dependences)
        assert ranks.generic_rank == rank


@pytest.mark.parametrize(
    "block", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))]
)
def test_rank_combinations_and_consistency(block):
    for seed in range(10 * block, 10 * block + 10):
        check(seed)


@pytest.mark.nightly(one_in=2)
@pytest.mark.parametrize("block", range(20))
def test_rank_combinations_and_consistency_of_2000(block):
    for seed in range(1000 + 100 * block, 1100 + 100 * block):
        check(seed)
