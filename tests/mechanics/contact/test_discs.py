"""Friction on a disc: it opposes the slip, whatever the directions are called."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.mechanics.contact import Mode, impact, modes
from tests.mechanics.contact._bodies import CONTACT, SLIP, closed, none

# Newton's steps end within a few roundings of terms near 1.
ROUNDING = 1e-13
POINT = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


def point(mass, mu, e=0.0):
    """Give a point on the floor z = 0."""
    return closed(
        [mass] * 3, POINT, [CONTACT, SLIP, SLIP], [-1, 0, 0], [-1, 2, 1], mu, e=e
    )


def turned(rows, angle):
    """Give rows with the two slips of each contact in other directions."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return np.kron(np.eye(len(rows) // 3), turn) @ rows


@pytest.mark.parametrize("mass", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, 4.5])
def test_a_point_that_slips_is_slowed_against_its_slip(mass, angle):
    slip = 3.0 * np.array([np.cos(angle), np.sin(angle)])
    found = impact(point(mass, 0.5, 0.2), np.array([-2.0, *slip]), none(3))
    fall = 2.0 * 1.2
    assert found.impulses[0] == pytest.approx(mass * fall, rel=ROUNDING)
    assert found.impulses[1:] == pytest.approx(
        -mass * 0.5 * fall * slip / 3.0, rel=ROUNDING
    )
    assert found.residual <= ROUNDING
    assert np.hypot(*found.after[1:]) == pytest.approx(3.0 - 0.5 * fall, rel=ROUNDING)


def test_a_point_sticks_inside_the_disc_though_outside_the_square_in_it():
    # 0.9 in both directions is 1.27 in all: less than the bound 1.3.
    found = impact(point(1.0, 1.3), np.array([-1.0, 0.9, -0.9]), none(3))
    assert found.impulses == pytest.approx([1.0, -0.9, 0.9], rel=ROUNDING)
    assert found.after == pytest.approx(none(3), abs=ROUNDING)


def test_a_sphere_with_spin_askew_rolls_or_slips():
    # Slip u = v + w x r: what rolling takes is 2/7 of u, against mu times the fall.
    r, inertia = 0.1, 0.4 * 0.01
    rows = [[0, 0, 1, 0, 0], [1, 0, 0, 0, -r], [0, 1, 0, r, 0]]
    masses = np.array([1.0, 1.0, 1.0, inertia, inertia])
    before = np.array([1.0, -0.5, -2.0, 8.0, 5.0])
    u = np.array([1.0 - 5.0 * r, -0.5 + 8.0 * r])
    for mu in (0.05, 0.2):
        body = closed(masses, rows, [CONTACT, SLIP, SLIP], [-1, 0, 0], [-1, 2, 1], mu)
        found = impact(body, np.asarray(rows) @ before, none(3))
        p = -u * min(2 / 7, mu * 2.0 / np.hypot(*u))
        assert found.impulses == pytest.approx([2.0, *p], rel=ROUNDING)


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
        assert found.residual <= ROUNDING
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


@pytest.mark.parametrize("angle", [0.0, 1.0, 3.5])
def test_a_point_rests_slides_or_begins_to(angle):
    way = np.array([np.cos(angle), np.sin(angle)])
    body, weight = point(2.0, 0.5), -10.0
    for pull, slip, mode, force in (
        (4.9, 0.0, Mode.HELD, -2.0 * 4.9),
        (5.1, 0.0, Mode.DRIVEN, -10.0),
        (0.1, 0.3, Mode.DRIVEN, -10.0),
    ):
        found = modes(
            body,
            np.array([weight, *(pull * way)]),
            np.array([0.0, *(slip * way)]),
            none(3),
            none(3),
        )
        assert found.mode[0] is Mode.HELD
        # A slip whose way is across the motion has no force to slide with.
        assert found.mode[1] is mode
        assert found.multipliers == pytest.approx([20.0, *(force * way)], abs=1e-12)
        if mode is Mode.DRIVEN:
            assert found.way[1:] == pytest.approx(-way, abs=ROUNDING)


CUBE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 2 / 3])


def box_on_legs(mu):
    """Give a cube of side 2, half as high, on its four corners."""
    rows, normals, pairs = [], [], []
    for corner in ((-1, -1, -0.5), (-1, 1, -0.5), (1, -1, -0.5), (1, 1, -0.5)):
        k = len(rows)
        rows += [[*way, *np.cross(corner, way)] for way in np.eye(3)[[2, 0, 1]]]
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
    assert set(found.mode[::3]) <= {Mode.HELD, Mode.IMPLIED}
    assert found.mode.count(Mode.HELD) == 6
    assert not found.unique
    assert rows.T @ found.multipliers == pytest.approx(-force, abs=1e-12)
    p = found.multipliers.reshape(-1, 3)
    assert p[:, 0].min() >= 0.0
    assert (np.hypot(p[:, 1], p[:, 2]) <= 0.5 * p[:, 0] + 1e-12).all()
    for k, mode in enumerate(found.mode):
        if mode is Mode.IMPLIED:
            n = body.normals[k]
            bound = 0.5 * found.multipliers[n] if n >= 0 else 0.0
            assert found.multipliers[k] == pytest.approx(found.way[k] * bound)


@pytest.mark.parametrize("pull", [(4.0, 3.2), (5.1, 0.0), (0.0, -9.0)])
def test_a_box_slides_off_as_one(pull):
    rows, body = box_on_legs(0.5)
    force = np.array([*pull, -10.0, 0.0, 0.0, 0.0])
    found = modes(body, rows @ (force / CUBE), none(12), none(12), none(12))
    moved = (force + rows.T @ found.multipliers) / CUBE
    size = np.hypot(*pull)
    assert moved[:2] == pytest.approx(np.array(pull) * (1 - 5.0 / size), abs=1e-12)
    assert moved[2:] == pytest.approx(none(4), abs=1e-12)
    assert Mode.DRIVEN in found.mode[1::3]
