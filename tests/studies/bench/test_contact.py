"""Charts of scenes with impacts: orders are kept; what cannot handle laws says so."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.notes import Event
from lagsim.run.session import open_case
from lagsim.studies.bench.reference import Reference
from lagsim.studies.bench.stability import Wish as Scope
from lagsim.studies.bench.stability import methods_for
from lagsim.studies.bench.work_precision import Wish, measure
from tests.scenes.contact import scenes

STOP = scenes.oscillator("x >= -0.5", 0.8, duration=6, output_step=0.05)


def case(text):
    return open_case(read(text, "m.yaml"))


@pytest.fixture(scope="module")
def charted():
    methods = ("dop853", "euler", "rk4", "taylor", "scipy:BDF")
    return measure(case(STOP), Wish(methods, (1e-4, 1e-9), (0.025, 0.003125)))


def slope(found, method):
    solves = [e for e in found.entries if e.method == method and not e.chosen]
    sizes = np.log([e.value for e in solves])
    assert len(sizes) == 4
    return np.polyfit(sizes, np.log([e.error for e in solves]), 1)[0]


@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("rk4", 4)])
def test_located_impacts_keep_the_order(charted, method, order):
    # Three impacts move, for `euler` over rows: what jumps there is in no error.
    assert slope(charted, method) == pytest.approx(order, abs=0.2)


def test_tighter_tolerances_give_smaller_errors(charted):
    errors = [e.error for e in charted.entries if e.method == "dop853"]
    assert len(errors) == 6
    assert errors[-1] < 1e-7
    assert errors[-1] < 1e-3 * errors[0]


def test_the_whole_motion_is_known(charted):
    assert charted.reference.horizon is None
    assert charted.reference.floor < 1e-11


def test_the_reference_is_that_of_the_closed_form(charted):
    rows = charted.reference.rows
    struck = math.acos(-0.5)
    after = (rows[:, 0] > struck) & (rows[:, 0] < struck + 2)
    s = rows[after, 0] - struck
    expected = -0.5 * np.cos(s) + 0.8 * math.sin(struck) * np.sin(s)
    assert np.max(np.abs(rows[after, 1] - expected)) < 1e-12


def test_what_knows_nothing_of_laws_is_left_out_with_the_reason(charted):
    reasons = {r.method: r.reason for r in charted.refused}
    assert "constraints that come and go" in reasons["taylor"]
    assert "constraints that come and go" in reasons["scipy:BDF"]


@pytest.mark.slow
def test_a_ball_at_rest_after_other_numbers_of_bounces_is_compared():
    ball = scenes.ball(0.5, duration=2, output_step=0.02)
    found = measure(case(ball), Wish(("dop853",), (1e-3, 1e-9)))
    assert found.reference.horizon is None
    assert all(e.error is not None and e.error < 0.1 for e in found.entries)


def reference(t, x, v, lam, struck):
    rows = np.column_stack([t, x, v, lam])
    return Reference(
        ("t", "x", "x_dot", "lambda_c"), "", "", rows, [1, 2], [3], np.ones(4),
        len(rows), np.zeros(4), [Event(struck, "impact", "c")],
    )  # fmt: skip


def test_an_impact_that_moves_is_an_error_of_the_place_alone():
    """A point turns at t = 1, and again at 1.3: by 0.6 it is off from there on."""
    t = np.linspace(0, 2, 21)
    known = reference(t, -np.abs(t - 1), np.where(t < 1, 1.0, -1.0), 0 * t, 1.0)
    late = np.column_stack([t, 0.3 - np.abs(t - 1.3), np.where(t < 1.3, 1.0, -1.0)])
    rows = np.column_stack([late, 0 * t])
    off = float(np.max(np.abs(late[:, 1] - known.rows[:, 1])))
    error, _ = known.errors(rows, [Event(1.3, "impact", "c")])
    assert error == pytest.approx(off)
    assert off < 2.0
    # One that happens to another constraint is none of this one's: velocities count.
    error, _ = known.errors(rows, [Event(1.3, "impact", "other")])
    assert error == pytest.approx(2.0)


def test_there_is_no_map_of_stability_and_a_reason():
    with pytest.raises(InputError, match="come and go"):
        methods_for(case(STOP), Scope())
