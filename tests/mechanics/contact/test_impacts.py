"""Impulses of impacts against closed forms."""

import numpy as np
import pytest

from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import Closed, impact
from tests.mechanics.contact._bodies import CONTACT, SLIP, closed, none

# A few operations on numbers near 1.
ROUNDING = 1e-14


def after(masses, rows, before, found):
    """Give the velocities after the impulses found."""
    return before + np.asarray(rows).T @ found.impulses / np.asarray(masses)


def test_a_rod_that_falls_flat_without_rebound_is_not_open():
    # Its ends rest both, whichever comes first.
    rows = [[1.0, -0.5], [1.0, 0.5]]
    for e, is_open in ((0.0, False), (0.5, True)):
        body = closed([1.0, 1 / 12], rows, [CONTACT] * 2, e=e)
        found = impact(body, np.array([-1.0, -1.0]), none(2))
        assert found.impulses == pytest.approx([0.5 * (1 + e)] * 2, abs=ROUNDING)
        assert found.open is is_open


def test_limits_give_no_impulse_and_timed_rows_stop():
    body = closed([2.0, 3.0], np.eye(2), [Kind.LIMITED, Kind.TIMED], mu=[5.0, 0.0])
    found = impact(body, np.array([1.0, -1.0]), none(2))
    assert found.impulses == pytest.approx([0.0, 3.0])
    assert found.after == pytest.approx([1.0, 0.0])


def test_targets_that_contradict_give_no_rebound():
    # Between two walls without clearance.
    body = closed([1.0], [[1.0], [-1.0]], [CONTACT] * 2, e=0.5)
    found = impact(body, np.array([-1.0, 1.0]), none(2))
    assert found.found
    assert found.open
    assert found.after == pytest.approx([0.0, 0.0], abs=ROUNDING)


@pytest.mark.parametrize("tilt", [0.0, 1e-8, 1e-3])
@pytest.mark.parametrize("direction", [-1.0, 1.0])
@pytest.mark.parametrize("speed", [1e-2, 1.0, 40.0, 1e4, 1e8])
def test_a_box_that_slides_fast_is_struck_at_one_of_two_corners(speed, direction, tilt):
    """Friction is mu times each impulse against the slip; the other corner may lift."""
    a, h, m, mu, e, v = 0.4, 0.5, 2.0, 0.05, 0.3, 0.9
    rows = []
    for side in (-a, a):
        x, y = side * np.cos(tilt) + h * np.sin(tilt), side * np.sin(tilt) - h
        rows += [[0.0, 1.0, x], [1.0, 0.0, -y]]
    J, M = np.array(rows), np.diag([m, m, m * (a**2 + h**2) / 3])
    D = J @ np.linalg.inv(M) @ J.T
    rates = np.array([-v, direction * speed, 0.0, direction * speed])
    kinds = (CONTACT, SLIP, CONTACT, SLIP)
    problem = Closed(
        D=D, kinds=kinds, normals=(-1, 0, -1, 2), pairs=(-1,) * 4,
        bounds=np.array([0, mu, 0, mu]), statics=np.array([0, mu, 0, mu]),
        restitutions=np.array([e, 0, e, 0]), factor=np.linalg.solve(np.sqrt(M), J.T),
    )  # fmt: skip
    found = impact(problem, rates, np.full(4, 1e-14))
    assert found.found
    if speed >= 1.0:
        pushed = D[::2, ::2] - direction * mu * D[::2, 1::2]
        asked = np.array([(1 + e) * v, 0.0])
        p = np.array([asked[0] / pushed[0, 0], 0.0])
        if pushed[1, 0] < 0.0:  # no lift: it is pressed down
            p = np.linalg.solve(pushed, asked)
        assert found.impulses[::2] == pytest.approx(p, abs=1e-9)
        assert found.impulses[1::2] == pytest.approx(-direction * mu * p, abs=1e-9)


@pytest.mark.parametrize("speed", [40.0, 1.0, -1e-3])
@pytest.mark.parametrize("turn", [None, 0.0, 0.6])
def test_friction_of_contacts_that_are_stopped_is_in_proportion(speed, turn):
    """One corner of a box strikes; the other, which rests, is kept from leaving.

    What slides loses mu times the sum of all impulses; what would turn back is stopped.
    On a plane the slip is at an angle to the edge.
    """
    a, h, m, mu, v = 0.4, 0.5, 2.0, 0.3, 0.9
    slips = [[1.0, 0.0, h, 0.0], [0.0, 0.0, 0.0, 1.0]][: 1 if turn is None else 2]
    k = 1 + len(slips)
    rows = np.array([[0.0, 1.0, -a, 0.0], *slips, [0.0, 1.0, a, 0.0], *slips])
    kinds = [Kind.TIMED, *[SLIP] * len(slips)] * 2
    normals = [-1, *[0] * len(slips), -1, *[k] * len(slips)]
    pairs = [-1] * 4 if k == 2 else [-1, 2, 1, -1, 5, 4]
    masses = [m, m, m * (a**2 + h**2) / 3, m]
    direction = np.array([np.cos(turn or 0.0), np.sin(turn or 0.0)])
    slip = speed * direction
    before = np.array([slip[0] + h * v / 2 / a, -v / 2, -v / 2 / a, slip[1]])
    body = closed(masses, rows, kinds, normals, pairs, mu)
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
    body = closed([1.0], [[1.0], [-1.0]], [CONTACT] * 2)
    assert not impact(body, np.array([-1.0, -1.0]), none(2)).found


@pytest.mark.parametrize("small", [1e-13, 1e-30, 1e13])
def test_what_strikes_slowly_strikes_beside_what_is_fast(small):
    """Of bodies that nothing couples none knows how fast another is, or how heavy."""
    masses = np.array([2.0, 2.0, 3.0, 3.0, 5.0, 5.0])
    kinds, normals = [CONTACT, SLIP] * 3, [-1, 0, -1, 2, -1, 4]
    body = closed(masses, np.eye(6), kinds, normals, mu=0.3)
    rates = np.array([-small, 0.1 * small, 1.2e-5, 0.7, -1.0, 0.2])
    found = impact(body, rates, none(6))
    expected = [2 * small, -0.2 * small, 0.0, 0.0, 5.0, -1.0]
    assert found.found
    assert found.impulses == pytest.approx(expected, rel=1e-14, abs=0.0)
