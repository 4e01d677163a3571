"""Friction on a disc: it opposes the slip, whatever the directions are called."""

import numpy as np
import pytest

from lagsim.mechanics.contact import Mode, impact, modes
from tests.mechanics.contact._bodies import CONTACT, SLIP, closed, none

# Newton's steps end within a few roundings of terms near 1.
ROUNDING = 1e-13


def turned(rows, angle):
    """Give rows with the two slips of each contact in other directions."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return np.kron(np.eye(len(rows) // 3), turn) @ rows


def bodies(seed, count, n):
    """Give rows of contacts of one scene with masses, and rates."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=(3 * count, n))
    return rows, rows @ random.normal(size=n)


def with_discs(rows, mu):
    count = len(rows) // 3
    firsts = 3 * np.arange(count)
    normals = [int(k) for n in firsts for k in (-1, n, n)]
    pairs = [int(k) for n in firsts for k in (-1, n + 2, n + 1)]
    kinds = [CONTACT, SLIP, SLIP] * count
    return closed(np.ones(rows.shape[1]), rows, kinds, normals, pairs, mu)


@pytest.mark.parametrize(("count", "n"), [(1, 4), (2, 8), (4, 12), (12, 50)])
def test_laws_hold_in_all_directions(count, n):
    for seed in range(3):
        rows, before = bodies(seed, count, n)
        body = with_discs(rows, 0.3)
        found = impact(body, before, none(3 * count))
        p, after = found.impulses.reshape(-1, 3), (body.D @ found.impulses + before)
        w = after.reshape(-1, 3)
        scale = np.abs(w).max() + np.abs(p).max()
        assert min(p[:, 0].min(), w[:, 0].min()) >= -ROUNDING * scale
        assert np.abs(p[:, 0] * w[:, 0]).max() <= ROUNDING * scale**2
        size = np.hypot(p[:, 1], p[:, 2])
        bound, slip = 0.3 * p[:, 0], np.hypot(w[:, 1], w[:, 2])
        assert (size <= bound + ROUNDING * scale).all()
        # The power is -bound * slip: the greatest that the disc can take.
        power = np.einsum("ij,ij->i", p[:, 1:], w[:, 1:])
        assert power == pytest.approx(-bound * slip, abs=10 * ROUNDING * scale**2)


def test_directions_of_the_slips_do_not_count():
    rows, before = bodies(7, 3, 12)
    found = impact(with_discs(rows, 0.3), before, none(9))
    other = turned(rows, 0.7)
    again = impact(with_discs(other, 0.3), turned(before[:, None], 0.7)[:, 0], none(9))
    assert other.T @ again.impulses == pytest.approx(rows.T @ found.impulses, abs=1e-12)


CUBE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 2 / 3])


def box_on_legs(mu):
    """Give a cube of side 2, half as high, on its four corners."""
    rows, normals, pairs = [], [], []
    for corner in ((-1, -1, -0.5), (-1, 1, -0.5), (1, -1, -0.5), (1, 1, -0.5)):
        k = len(rows)
        rows += [
            [*direction, *np.cross(corner, direction)]
            for direction in np.eye(3)[[2, 0, 1]]
        ]
        normals += [-1, k, k]
        pairs += [-1, k + 2, k + 1]
    kinds = [CONTACT, SLIP, SLIP] * 4
    return np.array(rows), closed(CUBE, rows, kinds, normals, pairs, mu)


@pytest.mark.parametrize(
    "pull",
    [
        # Its weight is 10 and mu 0.5: it rests while |(x, y)| < 5, and does not tilt.
        (0.0, 0.0, 0.0),
        (3.0, 2.0, 0.0),
        (4.0, 2.9, 0.0),
        (-2.0, 4.5, 0.0),
        # Turned about its middle, each leg bears 2.5 and has an arm of sqrt 2.
        (0.0, 0.0, 3.0),
        (0.0, 0.0, 7.0),
        (1.0, 1.0, 3.0),
    ],
)
def test_a_box_rests_on_four_legs(pull):
    rows, body = box_on_legs(0.5)
    force = np.array([*pull[:2], -10.0, 0.0, 0.0, pull[2]])
    found = modes(body, rows @ (force / CUBE), none(12), none(12), none(12))
    assert not found.paradox
    assert set(found.mode[::3]) <= {Mode.HELD, Mode.REDUNDANT}
    assert found.mode.count(Mode.HELD) == 6
    assert Mode.REDUNDANT in found.mode
    assert rows.T @ found.multipliers == pytest.approx(-force, abs=1e-12)
    p = found.multipliers.reshape(-1, 3)
    assert p[:, 0].min() >= 0.0
    assert (np.hypot(p[:, 1], p[:, 2]) <= 0.5 * p[:, 0] + 1e-12).all()
    for k, mode in enumerate(found.mode):
        if mode is Mode.REDUNDANT:
            n = body.normals[k]
            bound = 0.5 * found.multipliers[n] if n >= 0 else 0.0
            assert found.multipliers[k] == pytest.approx(found.direction[k] * bound)


@pytest.mark.parametrize("seed", [55, 193, 197, 381])
def test_where_sweeps_end_nowhere_discs_with_corners_show_where_to_begin(seed):
    random = np.random.default_rng(seed)
    count, n = int(random.integers(1, 7)), int(random.integers(2, 10))
    mu = random.choice([0.1, 0.5, 1.0, 2.0, 5.0])
    rows = random.normal(size=(3 * count, n))
    found = impact(with_discs(rows, mu), rows @ random.normal(size=n), none(3 * count))
    assert found.found
