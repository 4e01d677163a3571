"""Impulses of impacts: closed forms, the laws, and all edges of these in turn."""

from itertools import product

import numpy as np
import pytest

from lagsim.mechanics.constraints import EQUALITY
from lagsim.mechanics.impacts import impact
from tests.mechanics.contact._bodies import broken, none, touching

# A few operations on numbers near 1; Newton's steps end within a few roundings.
ROUNDING, NEWTON = 1e-14, 1e-13
# Of a solution that the other method calls one, in parts of the rates.
SOLVED = 1e-9


def after(masses, rows, before, found):
    """Return the velocities after the impulses found."""
    return before + np.asarray(rows).T @ found.impulses / np.asarray(masses)


def test_a_rod_that_falls_flat_without_rebound_is_not_open():
    # Its ends rest both, whichever comes first.
    rows = [[1.0, -0.5], [1.0, 0.5]]
    for e, is_open in ((0.0, False), (0.5, True)):
        found = impact(touching([1.0, 1 / 12], rows, e=e), np.full(2, -1.0), none(2))
        assert found.impulses == pytest.approx([0.5 * (1 + e)] * 2, abs=ROUNDING)
        assert found.open is is_open


@pytest.mark.parametrize("speed", [40.0, 1.0, -1e-3])
@pytest.mark.parametrize("turn", [None, 0.0, 0.6])
def test_friction_of_contacts_that_are_stopped_is_in_proportion(speed, turn):
    """One corner of a box strikes; the other, at rest, is kept from leaving.

    A sliding contact loses mu times the sum of all impulses; a slip that would turn
    back is stopped. On a plane the slip is at an angle to the edge.
    """
    a, h, m, mu, v = 0.4, 0.5, 2.0, 0.3, 0.9
    slips = [[1.0, 0.0, h, 0.0], [0.0, 0.0, 0.0, 1.0]][: 1 if turn is None else 2]
    k = 1 + len(slips)
    rows = np.array([[0.0, 1.0, -a, 0.0], *slips, [0.0, 1.0, a, 0.0], *slips])
    masses = [m, m, m * (a**2 + h**2) / 3, m]
    direction = np.array([np.cos(turn or 0.0), np.sin(turn or 0.0)])
    slip = speed * direction
    before = np.array([slip[0] + h * v / 2 / a, -v / 2, -v / 2 / a, slip[1]])
    body = touching(masses, rows, len(slips), kind=EQUALITY, mu=mu)
    found = impact(body, rows @ before, none(2 * k))
    assert found.found
    then = rows @ after(masses, rows, before, found)
    assert then[::k] == pytest.approx([0.0, 0.0], abs=1e-12)
    pushes = found.impulses[::k]
    if speed < 0.0:
        assert then == pytest.approx([0.0] * 2 * k, abs=1e-12)
        return
    assert pushes[0] < 0.0 < pushes[1]
    for first, push in zip((1, k + 1), pushes, strict=True):
        friction = found.impulses[first : first + k - 1]
        assert friction == pytest.approx(-mu * push * direction[: k - 1], abs=1e-12)


def test_a_body_that_is_crushed_has_no_solution():
    # Both walls come nearer.
    body = touching([1.0], [[1.0], [-1.0]])
    assert not impact(body, np.array([-1.0, -1.0]), none(2)).found


def test_a_single_contact():
    body = touching([2.0], [[1.0]], e=0.5)
    for rate, roundoff, impulse, then in (
        (-1.0, 0.0, 3.0, 0.5),  # (1 + e) times the momentum
        (-1e-3, 1e-3, 0.0, 0.0),  # a rate of the size of roundoff is none
        (0.0, 0.0, 0.0, 0.0),
        (0.25, 0.0, 0.0, 0.25),  # the contact opens
    ):
        found = impact(body, np.array([rate]), np.array([roundoff]))
        assert found.found
        assert not found.open
        assert found.impulses == pytest.approx([impulse], abs=ROUNDING)
        assert found.after == pytest.approx([then], abs=ROUNDING)
        # The change of m v^2/2.
        before = 0.0 if roundoff else rate
        assert found.energy == pytest.approx(then**2 - before**2, abs=ROUNDING)


@pytest.mark.parametrize("small", [1e-13, 1e-30, 1e13])
def test_what_strikes_slowly_strikes_beside_what_is_fast(small):
    """Uncoupled bodies have no effect on each other's tolerances, by speed or mass."""
    masses = np.array([2.0, 2.0, 3.0, 3.0, 5.0, 5.0])
    rates = np.array([-small, 0.1 * small, 1.2e-5, 0.7, -1.0, 0.2])
    found = impact(touching(masses, np.eye(6), 1, mu=0.3), rates, none(6))
    expected = [2 * small, -0.2 * small, 0.0, 0.0, 5.0, -1.0]
    assert found.found
    assert found.impulses == pytest.approx(expected, rel=1e-14, abs=0.0)


# --- random contacts ------------------------------------------------------------------


def contacts(seed, count, n, slips=0, *, e=0.3, mu=0.0, spread=0.0):
    """Return random rows with velocities, and c = rates less contacts' targets."""
    random = np.random.default_rng(seed)
    masses = 10.0 ** random.uniform(-spread, spread, n)
    step = 1 + slips
    rows = random.normal(size=(step * count, n)) * np.sqrt(masses)
    body = touching(masses, rows, slips, mu=mu, e=e)
    before = rows @ (random.normal(size=n) / np.sqrt(masses))
    c = before.copy()
    c[::step] += e * np.minimum(before[::step], 0.0)
    return rows, body, before, c


def every_solution(body, c):
    """Return all impulses of contacts, each with a slip or none, by trial of edges.

    An edge is a list of columns: the impulses that are free, of a contact alone or with
    its friction up or down, and the slips that are held.
    """
    unit, each = np.eye(len(c)), []
    for n in (k for k, normal in enumerate(body.table.normals) if normal < 0):
        states = [[], [(n, unit[n])]]
        if n + 1 in range(len(c)) and body.table.normals[n + 1] == n:
            slip, bound = unit[n + 1], body.bounds[n + 1]
            states[1].append((n + 1, slip))
            states += [[(n, unit[n] + sign * bound * slip)] for sign in (1, -1)]
        each.append(states)
    for case in product(*each):
        pairs = [pair for state in case for pair in state]
        held = [k for k, _ in pairs]
        E = np.array([column for _, column in pairs]).reshape(-1, len(c)).T
        B = (body.D @ E)[held]
        if held and np.linalg.cond(B) > 1e9:
            continue
        p = E @ np.linalg.solve(B, -c[held])
        w = body.D @ p + c
        if not broken(body, p, w, SOLVED * max(1.0, np.abs(w).max())):
            yield p


@pytest.mark.parametrize("spread", [0.0, 6.0])
@pytest.mark.parametrize(("count", "n"), [(1, 1), (2, 2), (3, 5), (5, 5), (6, 3)])
def test_without_friction(count, n, spread):
    for seed in range(8):
        _, body, before, c = contacts(seed, count, n, e=0.5, spread=spread)
        solutions = list(every_solution(body, c))
        found = impact(body, before, none(count))
        if not solutions:
            # Targets of more contacts than freedoms contradict: no rebound then.
            assert count > n
            assert found.open
            solutions, c = list(every_solution(body, before)), before
        # Rates after it are unique, impulses of dependent contacts are not.
        w = body.D @ found.impulses + c
        assert w == pytest.approx(body.D @ solutions[0] + c, abs=1e-11)
        assert found.impulses.min() >= 0.0


@pytest.mark.parametrize("spread", [0.0, 6.0])
@pytest.mark.parametrize(("count", "n"), [(1, 2), (2, 4), (3, 6), (3, 9), (4, 9)])
def test_with_friction(count, n, spread):
    for seed in range(6):
        _, body, before, c = contacts(seed, count, n, 1, mu=0.4, spread=spread)
        found = impact(body, before, none(2 * count))
        scale = np.abs(found.impulses).max() + 1e-300
        away = [np.abs(p - found.impulses).max() for p in every_solution(body, c)]
        assert min(away) <= 1e-10 * scale


@pytest.mark.parametrize(("seed", "count", "n"), [(0, 6, 3), (28, 6, 3), (38, 5, 5)])
@pytest.mark.parametrize("spread", [0.0, 6.0])
def test_what_the_first_pivots_do_not_solve(seed, count, n, spread):
    """So much friction that the pivots end on a ray, where there are solutions.

    With somewhat firmer rows they end at one, or where all slips are taken to go on.
    """
    _, body, before, c = contacts(seed, count, n, 1, mu=2.0, spread=spread)
    found = impact(body, before, none(2 * count))
    assert found.found
    w = body.D @ found.impulses + c
    assert not broken(body, found.impulses, w, SOLVED * max(1.0, np.abs(w).max()))


@pytest.mark.parametrize(("count", "n"), [(1, 4), (2, 8), (4, 12), (12, 50)])
def test_laws_hold_on_discs(count, n):
    for seed in range(3):
        _, body, before, c = contacts(seed, count, n, 2, e=0.0, mu=0.3)
        p = impact(body, before, none(3 * count)).impulses
        w = body.D @ p + c
        assert not broken(body, p, w, NEWTON * (np.abs(w).max() + np.abs(p).max()))


@pytest.mark.parametrize("seed", [55, 193, 197, 381])
def test_where_sweeps_end_nowhere_discs_with_corners_show_where_to_begin(seed):
    random = np.random.default_rng(seed)
    count, n = int(random.integers(1, 7)), int(random.integers(2, 10))
    mu = random.choice([0.1, 0.5, 1.0, 2.0, 5.0])
    rows = random.normal(size=(3 * count, n))
    before = rows @ random.normal(size=n)
    assert impact(touching(np.ones(n), rows, 2, mu=mu), before, none(3 * count)).found
