"""Modes of contacts with small whole numbers, full of ties and of dependent rows."""

import numpy as np
import pytest

from lagsim.mechanics.contact import Mode, modes
from tests.mechanics.contact._bodies import CONTACT, SLIP, closed, none

OFF, HELD, SLIDING, REDUNDANT = Mode
MU = 0.5
# Of whole numbers below 100, after a few solves with condition numbers below 100.
ROUNDING = 1e-11


def scene(seed, friction):
    """Give rows, forces and rates of contacts."""
    random = np.random.default_rng(seed)
    count, n = random.integers(1, 7), random.integers(2, 8)
    step = 2 if friction else 1
    rows = random.integers(-1, 2, size=(step * count, n)).astype(float)
    kinds = [CONTACT, SLIP] * count if friction else [CONTACT] * count
    normals = [-1 if k % step == 0 else k - 1 for k in range(len(rows))]
    body = closed(np.ones(n), rows, kinds, normals, mu=MU)
    rates = none(len(rows))
    if friction and seed % 2:
        rates[1::2] = random.integers(-1, 2, size=count)
    return rows, body, rows @ random.integers(-3, 4, size=n), rates


def wrong_contact(mode, p, w):
    """Tell how a contact breaks Signorini's law, if it does."""
    if min(p, w) < -ROUNDING or p * w > ROUNDING:
        return "law"
    if mode in (HELD, REDUNDANT) and w > ROUNDING:
        return "does not hold"
    return "pushes" if mode is OFF and p else None


def wrong_slip(mode, direction, p, w, bound, rate):
    """Tell how a slip breaks Coulomb's law, if it does."""
    if abs(p) > bound + ROUNDING:
        return "bound"
    if mode in (HELD, REDUNDANT):
        return "slides" if rate or abs(w) > ROUNDING else None
    if mode is SLIDING:
        against = direction == -np.sign(rate) if rate else direction * w <= ROUNDING
        full = abs(p - direction * bound) <= ROUNDING
        return None if against and full else "not against it"
    return "pushes" if p else None


@pytest.mark.parametrize("friction", [False, True])
def test_laws_hold_on_every_edge(friction):
    dependent = 0
    for seed in range(200):
        rows, body, free, rates = scene(seed, friction)
        found = modes(body, free, rates, none(len(rows)), none(len(rows)))
        if found.paradox:
            # One of them has a solution, which pivots find at the third attempt.
            assert rates.any()
            assert seed != 73
            continue
        p = found.multipliers
        w = body.D @ p + free
        for k, (mode, n) in enumerate(zip(found.mode, body.normals, strict=True)):
            wrong = (
                wrong_contact(mode, p[k], w[k])
                if n < 0
                else wrong_slip(
                    mode, found.direction[k], p[k], w[k], MU * p[n], rates[k]
                )
            )
            assert wrong is None, (seed, k)
        held = [k for k, mode in enumerate(found.mode) if mode is HELD]
        assert not held or np.linalg.matrix_rank(rows[held]) == len(held)
        dependent += REDUNDANT in found.mode
    # The scenes are what they are meant to be.
    assert dependent > 40


def test_static_friction_that_is_more_than_dynamic():
    # In two of these scenes what begins to slide would be pushed back at once.
    static, dynamic = 0.6, 0.2
    for seed in [*range(40), 73, 133]:
        random = np.random.default_rng(seed)
        count, n = int(random.integers(2, 4)), int(random.integers(3, 7))
        rows = random.normal(size=(2 * count, n))
        normals = [-1 if k % 2 == 0 else k - 1 for k in range(2 * count)]
        kinds = [CONTACT, SLIP] * count
        body = closed(np.ones(n), rows, kinds, normals, mu=dynamic, static=static)
        quiet = none(2 * count)
        free = rows @ random.normal(size=n)
        found = modes(body, free, quiet, quiet, quiet)
        p, w = found.multipliers, body.D @ found.multipliers + free
        for k in range(1, 2 * count, 2):
            mode = found.mode[k]
            mu = dynamic if mode is SLIDING else static
            assert wrong_contact(found.mode[k - 1], p[k - 1], w[k - 1]) is None
            assert (
                wrong_slip(mode, found.direction[k], p[k], w[k], mu * p[k - 1], 0.0)
                is None
            )


def column(count):
    """Give rows of flat boxes on each other: two corners each, with slips."""
    rows, kinds, normals = [], [], []
    for box in range(count):
        for side in (-1.0, 1.0):
            normal, slip = np.zeros((count, 3)), np.zeros((count, 3))
            normal[box], slip[box] = (0.0, 1.0, side), (1.0, 0.0, 0.5)
            if box:
                normal[box - 1], slip[box - 1] = (0.0, -1.0, -side), (-1.0, 0.0, 0.5)
            normals += [-1, len(rows)]
            rows += [normal.ravel(), slip.ravel()]
            kinds += [CONTACT, SLIP]
    masses = np.tile([1.0, 1.0, 5.0 / 12.0], count)
    return np.array(rows), closed(masses, rows, kinds, normals, mu=MU)


@pytest.mark.parametrize("count", [1, 12, pytest.param(50, marks=pytest.mark.slow)])
def test_a_column_of_boxes_rests_under_its_weight(count):
    rows, body = column(count)
    quiet = none(len(rows))
    free = rows @ np.tile([0.0, -1.0, 0.0], count)
    found = modes(body, free, quiet, quiet, quiet)
    above = np.repeat(np.arange(count, 0, -1), 2)
    # A column that tilts: the condition of D grows as the fourth power of its length.
    known = 2.0**-53 * count**4 + 1e-14
    assert found.multipliers[::2] == pytest.approx(above / 2.0, abs=known)
    # Each body is held by two normals and one slip; the other slip is the same row.
    assert found.mode.count(HELD) == 3 * count
    assert found.mode.count(REDUNDANT) == count
