"""Errors of scenes with closed forms, and the reference for the errors.

With impacts, too: orders are kept, and methods that cannot handle laws are refused.
"""

import cmath
import itertools
import math
import random

import numpy as np
import pytest

from lagsim.model.reader import read, read_file
from lagsim.notes import Event
from lagsim.run.interrupt import Interrupt
from lagsim.run.session import open_case
from lagsim.studies.bench import Own
from lagsim.studies.bench.work_precision import (
    OF_REFERENCE,
    BenchOptions,
    Reference,
    ReferenceSolution,
    decades,
    front,
    is_answer,
    make_reference,
    measure,
    pareto,
    unverified,
)
from lagsim.studies.trial import Patience
from tests.scenes.contact import scenes
from tests.small_scenes import fall, oscillator
from tests.support import MODELS

ROWS = "duration: 20, output_step: 0.1"
STOP = scenes.oscillator("x >= -0.5", 0.8, duration=6, output_step=0.05)


def scene(text):
    return open_case(read(text, "model.yaml"))


@pytest.fixture(scope="module")
def measured():
    some = ("dop853", "taylor", "rk4", "scipy:LSODA")
    wish = BenchOptions(some, (1e-4, 1e-8), (0.1, 0.025))
    return measure(scene(oscillator(ROWS)), wish)


@pytest.fixture(scope="module")
def struck():
    methods = ("dop853", "euler", "rk4", "taylor", "scipy:BDF")
    return measure(scene(STOP), BenchOptions(methods, (1e-4, 1e-9), (0.025, 0.003125)))


def rows(found, method):
    return [row for row in found["rows"] if row["method"] == method]


@pytest.mark.slow
def test_the_error_of_rk4_is_that_of_its_amplification(measured):
    for row in rows(measured, "rk4"):
        h, turns = row["value"], round(0.1 / row["value"])
        z = 1j * h
        one = 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
        exact = [(one ** (k * turns), cmath.exp(1j * 0.1 * k)) for k in range(201)]
        # x = Re, -x_dot = Im; over whole turns both go from -1 to 1.
        expected = max(
            max(abs(part(a) - part(b)) for a, b in exact) / 2.0
            for part in (lambda w: w.real, lambda w: w.imag)
        )
        assert row["error"] == pytest.approx(expected, rel=1e-4)
        # |R|^2 - 1 = -h^6/72 + ... per step, of the energy 1/2.
        decay = 0.5 * (1 - abs(one) ** (2 * 200 * turns))
        assert row["energy_drift"] == pytest.approx(decay, rel=1e-4)
        assert row["evaluations"] == 4 * 200 * turns + 1


@pytest.mark.slow
def test_tighter_tolerances_give_smaller_errors_and_rows_of_auto_are_marked(measured):
    for method in ("dop853", "scipy:LSODA"):
        errors = [row["error"] for row in rows(measured, method)]
        assert len(errors) == 5
        # Global errors are some times the tolerance, never a thousand times here.
        for error, rtol in zip(errors, decades((1e-4, 1e-8)), strict=True):
            assert error < 1e3 * rtol
        assert errors[-1] < 1e-2 * errors[0]
    # A series pays from 1e-6 on.
    taken = {(r["method"], r["value"]) for r in measured["rows"] if r["chosen"]}
    assert taken == {
        *(("dop853", rtol) for rtol in (1e-4, 1e-5)),
        *(("taylor", rtol) for rtol in (1e-6, 1e-7, 1e-8)),
    }
    assert {row["outcome"] for row in measured["rows"]} == {"done"}


@pytest.mark.slow
def test_constraints_have_their_own_errors():
    text = (MODELS / "pendulum-cartesian.yaml").read_text()
    found = measure(
        scene(text.replace("duration: 10", "duration: 1")),
        BenchOptions(("dop853", "scipy:DOP853"), (1e-5, 1e-5)),
    )
    [ours] = [row for row in found["rows"] if row["formulation"] == "projection"]
    [theirs] = rows(found, "scipy:DOP853")
    assert theirs["formulation"] == "drift"
    # Rows of ours are on the constraint, to rounding; scipy's are where they got to.
    residuals = [row["constraint_residual"] for row in (ours, theirs)]
    assert residuals[0] < 1e-14 < 1e-9 < residuals[1]
    for row in (ours, theirs):
        assert 0 < row["error_lambda"] < 1e3 * 1e-5
    # What drifts is no answer to compare with.
    assert is_answer(ours)
    assert not is_answer(theirs)
    assert not theirs["front_seconds"]
    cheaper = theirs | {"seconds": 0.0, "error": 0.0}
    assert front([cheaper, ours], "seconds", 0.0) == [1]


@pytest.mark.slow
def test_what_does_not_apply_is_left_out_with_its_reason():
    forced = oscillator("duration: 4, output_step: 0.5", force="sign(sin(t))")
    found = measure(
        scene(forced), BenchOptions(("scipy:RK45", "rk4"), steps=(0.1, 0.1))
    )
    assert [row["method"] for row in found["rows"]] == ["rk4"]
    why = "they would step over the model's switches"
    refused = {"method": "scipy:RK45", "formulation": "auto", "reason": why}
    assert refused in found["refused"]


@pytest.mark.slow
def test_solvers_of_scipy_take_states_and_quadratures_and_no_events():
    text = oscillator("duration: 4, output_step: 0.5", force="-0.1*s")
    text += "states: {s: {rate: x - s}}\noutput: {action: true}\n"
    text = text.replace("initial: {", "initial: {s: 0.5, ")
    wish = BenchOptions(("scipy:RK45",), (1e-6, 1e-6))
    [row] = measure(scene(text), wish)["rows"]
    assert row["outcome"] == "done"
    assert 1e-9 < row["error"] < 1e-4
    text += "modes: {u: 0}\nevents: {tick: {every: 1, set: {u: x}}}\n"
    [left_out] = measure(scene(text), wish)["refused"]
    assert left_out["reason"] == "they do not set modes at events"


@pytest.mark.slow
def test_solves_that_end_at_an_event_are_compared_before_it():
    found = measure(scene(fall("y <= 0")), BenchOptions(("rk4",), steps=(0.1, 0.1)))
    [row] = found["rows"]
    assert row["outcome"] == "until"
    assert row["error"] < 1e-12  # a parabola is exact for order 4


@pytest.mark.slow
def test_a_solve_that_takes_too_long_leaves_a_gap(monkeypatch):
    monkeypatch.setattr("lagsim.studies.bench.work_precision.PATIENCE_SECONDS", 0.0)
    monkeypatch.setattr("lagsim.studies.bench.work_precision.PATIENCE_TIMES", 0.0)
    names = ("scipy:DOP853", "scipy:Radau", "scipy:LSODA")
    found = measure(scene(oscillator(ROWS)), BenchOptions(names, (1e-3, 1e-9)))["rows"]
    # What is looser may take longest: after four gaps no tighter one is tried.
    assert [row["method"] for row in found] == [n for n in names for _ in range(4)]
    for row in found:
        gap = (row["outcome"], row["error"], row["seconds"])
        assert gap == ("too slow", None, None)
        assert "given up" in row["reason"]
    assert front(found, "seconds", 0.0) == []


@pytest.mark.slow
def test_an_interrupt_keeps_what_was_measured():
    interrupt = Interrupt()

    def progress(fraction):
        interrupt.signal = 2 if fraction > OF_REFERENCE else None

    wish = BenchOptions(("dop853", "rk4"), (1e-3, 1e-9))
    case = scene(oscillator(ROWS))
    found = measure(case, wish, interrupt=interrupt, progress=progress)
    assert not found["complete"]
    assert [row["method"] for row in found["rows"]] == ["dop853"]
    with pytest.raises(KeyboardInterrupt):  # there is nothing to be kept
        measure(case, wish, interrupt=interrupt)


def parting(size):
    """Return the comparison of two solutions with the difference size * exp(t).

    The range is 2.
    """
    own = Own(scene(oscillator(ROWS)), "dop853")
    known, names = own.solve(1e-13, Patience(10.0)).rows, own.names
    other = known.copy()
    other[:, 1] += size * np.exp(known[:, 0])
    first = ReferenceSolution("a", "a", 1e-13, names, known)
    second = ReferenceSolution("b", "b", 1e-13, names, other)
    return known, unverified(own.case.equations, first, known).against(second)


def test_errors_past_the_horizon_are_none():
    known, found = parting(1e-12)
    wrong = known.copy()
    wrong[found.known :, 1] += 1.0
    assert found.errors(wrong)[0] == 0.0
    wrong[found.known - 1, 1] += 1e-3
    assert found.errors(wrong)[0] == pytest.approx(5e-4, rel=1e-2)


# 1e-10 of the range is passed at t = log(2e-10/1e-11) = 3, with 30 rows of 201: a tenth
# of them; ten times as far apart nothing is left of that, and 1e-8 is passed there. Of
# what parts at once all is compared: by one per cent first, by 1e6 in the end.
@pytest.mark.parametrize(
    ("size", "horizon", "floor", "told"),
    [
        (1e-16, None, 0.5e-16 * math.exp(20), "smaller errors cannot be resolved"),
        (3e-16, None, 1.5e-16 * math.exp(20), "smaller errors cannot be resolved"),
        (1e-12, math.log(200), 1e-10, "up to t ="),
        (1e-11, math.log(20), 1e-10, "up to t ="),
        (1e-9, math.log(20), 1e-8, "up to t ="),
        (0.02, None, 0.01 * math.exp(20), "the two solutions disagree"),
    ],
)
def test_how_much_is_known_is_what_solutions_agree_on(size, horizon, floor, told):
    _, found = parting(size)
    assert found.horizon == (horizon and pytest.approx(horizon, abs=0.11))
    assert found.floor == pytest.approx(floor, rel=0.11 if horizon else 1e-3)
    assert told in found.trust


@pytest.mark.slow
def test_ranges_are_those_of_the_motion_between_rows():
    # Rows a whole period apart see a planet that stands still at (0.4, 0).
    text = (MODELS / "kepler.yaml").read_text()
    text = text.replace("output_step: pi/100", "output_step: 2*pi")
    reference = make_reference(scene(text))
    ranges = dict(zip(reference.columns, reference.scales, strict=True))
    # The ellipse of e = 0.6: 2 a along x, 2 b = 2 sqrt(1 - e^2) along y; at the
    # perihelion y_dot = 2, at the aphelion -0.5.
    assert ranges["x"] == pytest.approx(2.0, rel=1e-4)
    assert ranges["y"] == pytest.approx(1.6, rel=1e-4)
    assert ranges["y_dot"] == pytest.approx(2.5, rel=1e-4)
    assert reference.horizon is None
    assert reference.floor < 1e-11


@pytest.mark.slow
def test_what_stands_still_has_no_range_between_rows_either():
    # The lean, and the heading's rate, stay what they are but for rounding.
    reference = make_reference(scene((MODELS / "rolling-disk-steady.yaml").read_text()))
    assert reference.horizon is None
    assert reference.floor < 1e-11


@pytest.mark.slow
def test_the_time_for_all_is_bounded_and_what_it_cuts_is_said():
    names = ("dop853", "euler", "rk4", "scipy:BDF")
    found = measure(scene(oscillator(ROWS)), BenchOptions(names, budget=0.5))
    assert found["budget"]["seconds"] == 0.5
    cut = [row for row in found["rows"] if row["outcome"] == "out of time"]
    assert "euler" in {row["method"] for row in cut}
    assert {row["method"] for row in found["rows"]} == {*names}
    for row in cut:
        assert (row["error"], row["seconds"]) == (None, None)
        assert "share of the time" in row["reason"]


@pytest.mark.nightly
def test_the_reference_of_chaos_ends_where_solutions_part():
    options = {"duration": "40"}
    model = read_file(str(MODELS / "double-pendulum.yaml"), options=options)
    reference = make_reference(open_case(model))
    # Growth by about e^1.2 each second from rounding leaves 1e-10 somewhere before 15
    # s, and nothing at 40.
    assert reference.horizon is not None
    assert 4.0 < reference.horizon < 15.0
    assert reference.floor <= 1e-10


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("rk4", 4)])
def test_located_impacts_keep_the_order(struck, method, order):
    # Three impacts move, for `euler` over rows: what jumps there is in no error.
    solves = [row for row in rows(struck, method) if not row["chosen"]]
    assert len(solves) == 4
    sizes, errors = (np.log([r[key] for r in solves]) for key in ("value", "error"))
    assert np.polyfit(sizes, errors, 1)[0] == pytest.approx(order, abs=0.2)


def test_tolerances_bound_errors_of_impacts_and_what_knows_no_laws_says_so(struck):
    errors = [row["error"] for row in rows(struck, "dop853")]
    assert len(errors) == 6
    assert errors[-1] < min(1e-7, 1e-3 * errors[0])
    reasons = {x["method"]: x["reason"] for x in struck["refused"]}
    for method in ("taylor", "scipy:BDF"):
        assert "constraints that hold at times" in reasons[method]


@pytest.mark.slow
def test_a_ball_at_rest_after_other_numbers_of_bounces_is_compared():
    ball = scenes.ball(0.5, duration=2, output_step=0.02)
    found = measure(scene(ball), BenchOptions(("dop853",), (1e-3, 1e-9)))
    assert found["reference"]["horizon"] is None
    assert all(row["error"] is not None for row in found["rows"])
    assert max(row["error"] for row in found["rows"]) < 0.1


def test_an_impact_that_moves_is_an_error_of_the_place_alone():
    """A point turns at t = 1, and again at 1.3: by 0.6 it is off from there on."""
    t = np.linspace(0, 2, 21)
    v = np.where(t < 1, 1.0, -1.0)
    known = Reference(
        ("t", "x", "x_dot", "lambda_c"), "",
        np.column_stack([t, -np.abs(t - 1), v, 0 * t]), [1, 2], [3], np.ones(4),
        [Event(1.0, "impact", "c")], known=len(t),
    )  # fmt: skip
    late = 0.3 - np.abs(t - 1.3), np.where(t < 1.3, 1.0, -1.0)
    other = np.column_stack([t, *late, 0 * t])
    off = float(np.max(np.abs(other[:, 1] - known.rows[:, 1])))
    error, _ = known.errors(other, [Event(1.3, "impact", "c")])
    assert error == pytest.approx(off)
    assert off < 2.0
    # One that happens to another constraint is none of this one's: velocities count.
    error, _ = known.errors(other, [Event(1.3, "impact", "other")])
    assert error == pytest.approx(2.0)


def beaten(point, others):
    return any(
        all(a <= b for a, b in zip(other, point, strict=True)) and other != point
        for other in others
    )


def test_the_front_is_what_no_other_point_beats():
    random.seed(5)
    for _ in range(200):
        points = [(random.randrange(1, 9), random.randrange(1, 9)) for _ in range(12)]
        best = [points[k] for k in pareto(points)]
        assert set(best) == {p for p in points if not beaten(p, points)}
        assert all(a[0] > b[0] for a, b in itertools.pairwise(best))
        assert all(a[1] < b[1] for a, b in itertools.pairwise(best))
    # Of equal points the first counts.
    assert pareto([(1, 2), (1, 2), (3, 2)]) == [0]
    assert pareto([]) == []
