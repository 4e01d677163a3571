"""Random contacts against all edges of their laws, tried one after the other."""

from itertools import product

import numpy as np
import pytest

from lagsim.mechanics.contact import impact
from tests.mechanics.contact._bodies import CONTACT, SLIP, closed, none

# Of a solution that the other method calls one, in parts of the rates.
SOLVED = 1e-9
OFF, STICKS, UP, DOWN = range(4)


def every_solution(D, c, mu):
    """Give all impulses of contacts, each with one slip after it, by trying edges.

    Without friction where mu is None.
    """
    step = 1 if mu is None else 2
    states = (OFF, STICKS) if mu is None else (OFF, STICKS, UP, DOWN)
    for case in product(states, repeat=len(c) // step):
        E, held = np.zeros((len(c), len(c))), []
        for i, state in enumerate(case):
            n = step * i
            if state == OFF:
                continue
            E[n, n] = 1.0
            held.append(n)
            if mu is not None:
                if state == STICKS:
                    E[n + 1, n + 1] = 1.0
                    held.append(n + 1)
                else:
                    E[n + 1, n] = mu if state == UP else -mu
        B = (D @ E)[np.ix_(held, held)]
        if held and np.linalg.cond(B) > 1e9:
            continue
        x = np.zeros(len(c))
        if held:
            x[held] = np.linalg.solve(B, -c[held])
        p = E @ x
        if obeys(D @ p + c, p, step, mu):
            yield p


def obeys(w, p, step, mu):
    """Tell whether impulses and rates after them obey Newton's and Coulomb's laws."""
    slack = SOLVED * max(1.0, np.abs(w).max())
    n = slice(0, None, step)
    if p[n].min() < -slack or w[n].min() < -slack:
        return False
    if mu is None:
        return True
    t, bound = slice(1, None, 2), mu * p[0::2]
    within = (np.abs(p[t]) <= bound + slack).all()
    against = w[t] * np.sign(p[t]) <= slack
    free = (np.abs(w[t]) <= slack) | (np.abs(np.abs(p[t]) - bound) <= slack)
    return bool(within and against.all() and free.all())


def contacts(seed, count, n, e, mu=None, spread=0.0):
    """Give random rows with velocities, and c = rates less the targets of contacts."""
    random = np.random.default_rng(seed)
    masses = 10.0 ** random.uniform(-spread, spread, n)
    step = 1 if mu is None else 2
    rows = random.normal(size=(step * count, n)) * np.sqrt(masses)
    kinds = [CONTACT] * count if mu is None else [CONTACT, SLIP] * count
    normals = [-1 if k % step == 0 else k - 1 for k in range(step * count)]
    body = closed(masses, rows, kinds, normals, mu=mu or 0.0, e=e)
    before = rows @ (random.normal(size=n) / np.sqrt(masses))
    c = before.copy()
    c[::step] += e * np.minimum(before[::step], 0.0)
    return body, before, c


@pytest.mark.parametrize("spread", [0.0, 6.0])
@pytest.mark.parametrize(("count", "n"), [(1, 1), (2, 2), (3, 5), (5, 5), (6, 3)])
def test_without_friction(count, n, spread):
    for seed in range(8):
        body, before, c = contacts(seed, count, n, 0.5, spread=spread)
        solutions = list(every_solution(body.D, c, None))
        found = impact(body, before, none(count))
        if not solutions:
            # Targets of more contacts than freedoms contradict: no rebound then.
            assert count > n
            assert found.open
            solutions = list(every_solution(body.D, before, None))
            c = before
        # Rates after it are unique, impulses of dependent contacts are not.
        w = body.D @ found.impulses + c
        assert w == pytest.approx(body.D @ solutions[0] + c, abs=1e-11)
        assert found.impulses.min() >= 0.0


@pytest.mark.parametrize("spread", [0.0, 6.0])
@pytest.mark.parametrize(("count", "n"), [(1, 2), (2, 4), (3, 6), (3, 9), (4, 9)])
def test_with_friction(count, n, spread):
    for seed in range(6):
        body, before, c = contacts(seed, count, n, 0.3, 0.4, spread)
        found = impact(body, before, none(2 * count))
        scale = np.abs(found.impulses).max() + 1e-300
        away = [
            np.abs(p - found.impulses).max() for p in every_solution(body.D, c, 0.4)
        ]
        assert min(away) <= 1e-10 * scale


@pytest.mark.parametrize(("seed", "count", "n"), [(0, 6, 3), (28, 6, 3), (38, 5, 5)])
@pytest.mark.parametrize("spread", [0.0, 6.0])
def test_what_the_first_pivots_do_not_solve(seed, count, n, spread):
    """So much friction that the pivots end on a ray, where there are solutions.

    With somewhat firmer rows they end at one, or where all slips are taken to go on.
    """
    body, before, c = contacts(seed, count, n, 0.3, 2.0, spread)
    found = impact(body, before, none(2 * count))
    assert found.found
    assert obeys(body.D @ found.impulses + c, found.impulses, 2, 2.0)
