"""What holds, slides and lets go, against closed forms."""

import numpy as np
import pytest

from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import Mode, modes
from tests.mechanics.contact._bodies import CONTACT, SLIP, G, closed, none

OFF, HELD, SLIDING, REDUNDANT = Mode

LEGS = np.array([[1, y, -x] for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1))], float)


def rates(*values):
    """Rates of accelerations to come, known to 1e-6."""
    return lambda _: (np.array(values), np.full(len(values), 1e-6))


@pytest.mark.parametrize(("rate", "mode"), [(-1.0, HELD), (0.0, HELD), (1.0, OFF)])
def test_a_contact_on_the_edge_goes_where_its_forces_lead(rate, mode):
    body = closed([2.0], [[1.0]], [CONTACT])
    free, roundoff = np.array([1e-13]), np.array([1e-12])
    found = modes(body, free, none(1), roundoff, none(1), rates(rate))
    assert found.mode == (mode,)


def rod(angle, mu):
    """Give a sliding rod of mass 1 and half-length 1 on its end; x, y, angle."""
    s, c = np.sin(angle), np.cos(angle)
    rows = [[0.0, 1.0, -c], [1.0, 0.0, s]]
    return closed([1.0, 1.0, 1 / 3], rows, [CONTACT, SLIP], [-1, 0], mu=mu)


@pytest.mark.parametrize("weight", [0.0, G])
def test_no_effective_mass_at_all_is_a_paradox(weight):
    body, rates = rod(np.arctan(2.0), 4 / 3), np.array([0.0, -1.0])
    found = modes(body, np.array([-weight, 0.0]), rates, none(2), none(2))
    assert found.paradox


def test_what_could_lift_off_or_jam_lifts_off():
    body, rates = rod(np.arctan(2.0), 2.0), np.array([0.0, -1.0])
    found = modes(body, np.array([1.0, 0.0]), rates, none(2), none(2))
    assert found.mode == (OFF, OFF)
    assert not found.paradox


def test_a_box_on_two_corners_shares_its_friction():
    # Both slips are the same row: the bounds add up, and each keeps to its own.
    rows = [[0.0, 1.0, -1.0], [1.0, 0.0, 0.5], [0.0, 1.0, 1.0], [1.0, 0.0, 0.5]]
    kinds, normals = [CONTACT, SLIP] * 2, [-1, 0, -1, 2]
    body = closed([1.0, 1.0, 0.4], rows, kinds, normals, mu=0.5)
    for pull, mode in ((4.9, REDUNDANT), (5.1, SLIDING)):
        free = np.asarray(rows) @ [pull, -10.0, 0.0]
        found = modes(body, free, none(4), none(4), none(4))
        p = found.multipliers
        assert found.mode.count(mode) == (1 if mode is REDUNDANT else 2)
        assert p[1] + p[3] == pytest.approx(-min(pull, 5.0), rel=1e-14)
        assert p[0] + p[2] == pytest.approx(10.0, rel=1e-14)
        # Moments about the centre.
        assert p[2] - p[0] + 0.5 * (p[1] + p[3]) == pytest.approx(0.0, abs=1e-13)
        assert (np.abs(p[1::2]) <= 0.5 * p[::2] + 1e-14).all()


def test_a_bound_within_rounding_holds_unless_forces_grow():
    body = closed([1.0, 1.0], [[0, 1], [1, 0]], [CONTACT, SLIP], [-1, 0], mu=0.5)
    free = np.array([-10.0, 5.0 + 1e-13])
    # The weight may grow as well: by twice as much as the pull, it holds.
    for weight, mode in ((0.0, SLIDING), (1.9, SLIDING), (2.1, HELD)):
        ahead = rates(-weight, 1.0)
        found = modes(body, free, none(2), np.full(2, 1e-12), none(2), ahead)
        assert found.mode == (HELD, mode)
    assert modes(body, free, none(2), np.full(2, 1e-12), none(2)).mode == (HELD, HELD)


def test_what_is_tied_goes_on_to_bear_where_others_give_way():
    """Two blocks that rub on the ground, the second also on a wall; it is pushed.

    Each of its two rows rests at its bound: the third, of the blocks, takes the rest.
    """
    rows = [[0.0, 1.0], [0.0, 1.0], [-1.0, 1.0], [1.0, 0.0]]
    body = closed([1.0, 1.0], rows, [Kind.LIMITED] * 4, mu=1.0)
    free = np.array([2.5, 2.5, 2.5, 0.0])
    found = modes(body, free, none(4), none(4), none(4), rates(1.0, 1.0, 1.0, 0.0))
    assert sorted(found.mode) == [HELD, HELD, REDUNDANT, REDUNDANT]
    assert found.multipliers[0] + found.multipliers[1] + found.multipliers[2] == -2.5


def test_rows_at_a_small_angle_both_hold():
    # 1e-8 apart: a second row of its own, which D alone could not tell.
    rows = [[1.0, 0.0], [1.0, 1e-8]]
    body = closed([1.0, 1.0], rows, [Kind.TIMED] * 2)
    found = modes(body, np.array([-1.0, -1.0 - 1e-8]), none(2), none(2), none(2))
    assert found.mode == (HELD, HELD)
    twice = closed([1.0, 1.0], [rows[0], rows[0]], [Kind.TIMED] * 2)
    found = modes(twice, np.array([-1.0, -1.0]), none(2), none(2), none(2))
    assert found.mode == (HELD, REDUNDANT)
    assert found.multipliers == pytest.approx([1.0, 0.0])


def test_a_row_on_which_nothing_acts_is_off():
    # The contact is along what an equality holds.
    body = closed([1.0, 1.0], [[1.0, 0.0]], [CONTACT], A=[[2.0, 0.0]])
    assert body.D.tolist() == [[0.0]]
    found = modes(body, none(1), none(1), none(1), none(1))
    assert found.multipliers.tolist() == [0.0]


def test_two_rows_that_contradict_are_no_motion():
    body = closed([1.0], [[1.0], [1.0]], [Kind.TIMED] * 2)
    found = modes(body, np.array([1.0, 2.0]), none(2), none(2), none(2))
    assert found.paradox
