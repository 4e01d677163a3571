"""Rows at events between output times, for pictures."""

import numpy as np
import pytest

import lagsim
from lagsim.run.observers import MOST, Corners
from lagsim.run.observers.thinning import Thinning
from tests.support import simulate

# Pushed until 0.503, between two rows, then pulled.
PUSHED = """\
coordinates: {x: {unit: m}}
definitions: {push: "if(t < 0.503, 2, -1)"}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: push}
initial: {x: 0}
simulation: {duration: 1, output_step: 0.01}
"""
# A block on a belt: held by friction from the time on at which it has the belt's speed.
BELT = """\
definitions: {friction: -5*sign(x_dot - 1.0148)}
coordinates: {x: }
energy: {kinetic: x_dot^2/2, potential: x}
forces: {x: friction}
initial: {x: 0}
simulation: {duration: 1, output_step: 0.01}
"""


def shown(text):
    """A function that gives times and values of a column as pictures show it."""
    result = simulate(lagsim.load(text))
    made = result._attempt
    names = made.session.system.columns.names
    thin = Thinning(names)
    thin.add(result._rows)
    thin.meet(made.corners.rows())
    return thin.series


def at(time, t, values):
    return values[np.abs(t - time) < 1e-9].tolist()


def test_a_jump_is_upright_and_a_kink_where_it_is():
    series = shown(PUSHED)
    t, push = series("push")
    assert at(0.503, t, push) == [2.0, -1.0]
    assert np.all(np.diff(t) >= 0.0)
    assert set(push[t < 0.503 - 1e-9]) == {2.0}
    assert set(push[t > 0.503 + 1e-9]) == {-1.0}
    # v = 2 t up to there.
    assert at(0.503, *series("x_dot")) == pytest.approx([1.006, 1.006], rel=1e-9)


def test_a_sign_has_the_value_of_its_side_at_the_event():
    # It slips at x'' = 5 - 1 until 0.2537 s; held, friction bears the slope 1.
    series = shown(BELT)
    assert at(0.2537, *series("friction")) == pytest.approx([5.0, 1.0], abs=1e-6)
    _, friction = series("friction")
    assert set(np.round(friction, 6)) == {5.0, 1.0}


def test_a_slip_on_a_disc_stops_without_a_spike():
    """Until the stop the force has its limit against the slip, then that of the spring.

    The slip turns often on the last 1e-11 s, and about a stop it has no direction.
    """
    series = shown("models/planar-brake.yaml")
    (t, x), (_, y) = (series(f"lambda_table.{k}") for k in (1, 2))
    late = t > 3.7
    before = t[late] < 3.76539826
    for values, stuck in (x[late], 0.2173356), (y[late], 0.0127790):
        assert np.abs(np.diff(values[before])).max() < 1e-3
        assert values[~before][1:] == pytest.approx(stuck, abs=1e-6)
    assert np.hypot(x, y).max() < 0.08 * 0.5 * 9.81 + 1e-9


def test_the_first_and_the_last_of_one_time_are_kept_and_not_too_many():
    corners = Corners()
    for time, value in ((1.0, 5.0), (1.0, 7.0), (2.0, 9.0)):
        before, after = np.array([[time, value]]), np.array([[time, value + 1.0]])
        corners.add(before, after)
    kept = corners.rows()[:, 0]
    assert kept.tolist() == [[1.0, 5.0], [1.0, 8.0], [2.0, 9.0], [2.0, 10.0]]
    for k in range(MOST):
        assert bool(corners) == (k < MOST - 2)
        corners.add(np.array([[3.0 + k, 0.0]]), np.array([[3.0 + k, 0.0]]))


def test_rows_at_events_do_not_count_nor_move_others():
    thin = Thinning(("t", "x"))
    thin.add(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]))
    # Of two variants the one nearer to the row beside the event on the same side.
    events = [
        [[0.5, 7.0], [0.5, 0.4]], [[0.5, 0.6], [0.5, -9.0]],
        [[1.5, 0.9], [1.5, -0.1]], [[1.5, 0.2], [1.5, 3.0]],
    ]  # fmt: skip
    thin.meet(np.array(events))
    assert thin.row_count == 3
    t, x = thin.series("x")
    assert t.tolist() == [0.0, 0.5, 0.5, 1.0, 1.5, 1.5, 2.0]
    assert x.tolist() == [0.0, 0.4, 0.6, 1.0, 0.9, 0.2, 0.0]
    assert [p.tolist() for p in thin.path("t", "x")] == [t.tolist(), x.tolist()]
