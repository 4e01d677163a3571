"""Errors of scenes with closed forms, and what is measured against."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from lagsim.model.reader import read, read_file
from lagsim.run.interrupt import Interrupt
from lagsim.run.session import open_case
from lagsim.studies.bench.reference import Solution, _compared, make_reference
from lagsim.studies.bench.solving import GivenUpError, Own, Patience
from lagsim.studies.bench.work_precision import (
    OF_REFERENCE,
    Wish,
    decades,
    halvings,
    measure,
)
from tests.small_scenes import fall, oscillator
from tests.support import MODELS

ROWS = "duration: 20, output_step: 0.1"


def scene(text):
    return open_case(read(text, "model.yaml"))


@pytest.fixture(scope="module")
def measured():
    some = ("dop853", "exponential", "rk4", "scipy:LSODA")
    wish = Wish(some, (1e-4, 1e-8), (0.1, 0.025))
    return measure(scene(oscillator(ROWS)), wish)


def entries(found, method):
    return [e for e in found.entries if e.method == method]


@pytest.mark.slow
def test_the_error_of_rk4_is_that_of_its_amplification(measured):
    for entry in entries(measured, "rk4"):
        h, turns = entry.value, round(0.1 / entry.value)
        z = 1j * h
        one = 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
        rows = [(one ** (k * turns), cmath.exp(1j * 0.1 * k)) for k in range(201)]
        # x = Re, -x_dot = Im; over whole turns both go from -1 to 1.
        expected = max(
            max(abs(part(a) - part(b)) for a, b in rows) / 2.0
            for part in (lambda w: w.real, lambda w: w.imag)
        )
        assert entry.error == pytest.approx(expected, rel=1e-4)
        # |R|^2 - 1 = -h^6/72 + ... per step, of the energy 1/2.
        decay = 0.5 * (1 - abs(one) ** (2 * 200 * turns))
        assert entry.energy_drift == pytest.approx(decay, rel=1e-4)
        assert entry.evaluations == 4 * 200 * turns + 1


@pytest.mark.slow
def test_tighter_tolerances_give_smaller_errors(measured):
    for method in ("dop853", "scipy:LSODA"):
        errors = [e.error for e in entries(measured, method)]
        assert len(errors) == 5
        # Global errors are some times the tolerance, never a thousand times here.
        for error, rtol in zip(errors, decades((1e-4, 1e-8)), strict=True):
            assert error < 1e3 * rtol
        assert errors[-1] < 1e-2 * errors[0]


@pytest.mark.slow
def test_the_rows_of_what_auto_takes_are_marked(measured):
    # The oscillator is linear: one exponential from row to row.
    taken = [e for e in measured.entries if e.chosen]
    assert [(e.method, e.value) for e in taken] == [("exponential", 0.1)]
    assert {e.outcome for e in measured.entries} == {"done"}


@pytest.mark.slow
def test_both_references_agree_on_what_is_known(measured):
    reference = measured.reference
    assert reference.horizon is None
    assert reference.floor < 1e-11
    exact = np.cos(reference.rows[:, 0])
    assert np.max(np.abs(reference.rows[:, 1] - exact)) < 4e-12


@pytest.mark.slow
def test_the_front_holds_nothing_that_is_beaten(measured):
    for of in ("seconds", "evaluations"):
        front = [measured.entries[k] for k in measured.front(of)]
        assert front
        for entry in front:
            assert not any(
                e.error < entry.error and e.cost(of) < entry.cost(of)
                for e in measured.entries
            )


def test_constraints_have_their_own_errors():
    text = (MODELS / "pendulum-cartesian.yaml").read_text()
    found = measure(
        scene(text.replace("duration: 10", "duration: 1")),
        Wish(("dop853", "scipy:DOP853"), (1e-5, 1e-5)),
    )
    [ours] = [e for e in found.entries if e.formulation == "projection"]
    [theirs] = entries(found, "scipy:DOP853")
    assert theirs.formulation == "drift"
    # Rows of ours are on the constraint, to rounding; scipy's are where they got to.
    assert ours.constraint_residual < 1e-14 < 1e-9 < theirs.constraint_residual
    for entry in (ours, theirs):
        assert 0 < entry.error_lambda < 1e3 * 1e-5
    # What drifts is no answer to compare with.
    assert found.entries.index(theirs) not in found.front("seconds")


def test_what_does_not_apply_is_left_out_with_its_reason():
    forced = oscillator(ROWS, force="sign(sin(t))")
    found = measure(scene(forced), Wish(("scipy:RK45", "rk4"), steps=(0.1, 0.1)))
    assert [e.method for e in found.entries] == ["rk4"]
    why = "they would step over the model's switches"
    assert ("scipy:RK45", "auto", why) in found.refused


@pytest.mark.slow
def test_solves_that_end_at_an_event_are_compared_before_it():
    found = measure(scene(fall("y <= 0")), Wish(("rk4",), steps=(0.1, 0.1)))
    [entry] = found.entries
    assert entry.outcome == "until"
    assert entry.error < 1e-12  # a parabola is exact for order 4


@pytest.mark.slow
def test_a_solve_that_takes_too_long_leaves_a_gap(monkeypatch):
    monkeypatch.setattr("lagsim.studies.bench.work_precision.PATIENCE_SECONDS", 0.0)
    monkeypatch.setattr("lagsim.studies.bench.work_precision.PATIENCE_TIMES", 0.0)
    names = ("scipy:DOP853", "scipy:Radau", "scipy:LSODA")
    found = measure(scene(oscillator(ROWS)), Wish(names, (1e-3, 1e-9)))
    # What is looser may take longest: after four gaps no tighter one is tried.
    assert [e.method for e in found.entries] == [
        name for name in names for _ in range(4)
    ]
    for entry in found.entries:
        assert (entry.outcome, entry.error, entry.seconds) == ("too slow", None, None)
        assert "given up" in entry.reason
    assert found.front("seconds") == []


@pytest.mark.slow
def test_an_interrupt_keeps_what_was_measured():
    interrupt = Interrupt()

    def progress(fraction):
        interrupt.signal = 2 if fraction > OF_REFERENCE else None

    wish = Wish(("dop853", "rk4"), (1e-3, 1e-9))
    found = measure(
        scene(oscillator(ROWS)), wish, interrupt=interrupt, progress=progress
    )
    assert found.interrupted
    assert [e.method for e in found.entries] == ["dop853"]
    with pytest.raises(GivenUpError):
        Patience(1.0, interrupt).check()


def parting(size):
    """Give how two solutions compare that part as size * exp(t); the range is 2."""
    scene_ = scene(oscillator("duration: 20, output_step: 0.1"))
    own = Own(scene_, "dop853")
    rows, names = own.solve(1e-13, Patience(10.0)).rows, own.names
    other = rows.copy()
    other[:, 1] += size * np.exp(rows[:, 0])
    first = Solution("a", "a", 1e-13, names, rows)
    second = Solution("b", "b", 1e-13, names, other)
    return rows, _compared(scene_.equations, first, second)


def test_what_only_one_solution_says_is_not_known():
    # They agree to 1e-10 of the range while t < log(2e2) = 5.3.
    rows, found = parting(1e-12)
    assert found.horizon == pytest.approx(math.log(2e2), abs=0.11)
    assert found.floor == pytest.approx(1e-10, rel=0.11)
    assert f"up to t = {found.horizon:.4g} of 20" in found.trust
    # Errors past the horizon are not errors.
    wrong = rows.copy()
    wrong[found.known :, 1] += 1.0
    assert found.errors(wrong)[0] == 0.0
    wrong[found.known - 1, 1] += 1e-3
    assert found.errors(wrong)[0] == pytest.approx(5e-4, rel=1e-2)


@pytest.mark.parametrize("size", [1e-16, 3e-16])
def test_where_all_agree_to_less_all_is_known_to_less(size):
    _, found = parting(size)
    assert found.horizon is None
    assert found.floor == pytest.approx(size * math.exp(20) / 2, rel=1e-3)
    assert "smaller errors cannot be resolved" in found.trust


def test_where_motion_parts_early_errors_are_those_before():
    # 1e-10 of the range is passed at t = log(2e-10/1e-11) = 3, with 30 rows of 201: a
    # tenth of them; ten times as far apart nothing is left of that.
    _, found = parting(1e-11)
    assert found.horizon == pytest.approx(math.log(20), abs=0.11)
    _, found = parting(1e-9)
    assert found.horizon == pytest.approx(math.log(20), abs=0.11)
    assert found.floor == pytest.approx(1e-8, rel=0.11)


def test_what_parts_at_once_still_gives_a_chart():
    # One per cent apart from the first step on, and by 1e6 in the end.
    _, found = parting(0.02)
    assert found.horizon is None
    assert found.floor == pytest.approx(0.01 * math.exp(20), rel=1e-3)
    assert "the two disagree" in found.trust


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
    wish = Wish(("dop853", "euler", "rk4", "scipy:BDF"), budget=0.5)
    found = measure(scene(oscillator(ROWS)), wish)
    assert found.budget == 0.5
    cut = {e.method for e in found.entries if e.outcome == "out of time"}
    assert "euler" in cut
    assert {e.method for e in found.entries} == {"dop853", "euler", "rk4", "scipy:BDF"}
    for entry in found.entries:
        if entry.outcome == "out of time":
            assert (entry.error, entry.seconds) == (None, None)
            assert "share of the time" in entry.reason


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


def test_settings():
    assert decades((1e-3, 1e-6)) == [1e-3, 1e-4, 1e-5, 1e-6]
    assert decades((1e-9, 1e-9)) == [1e-9]
    assert halvings((0.4, 0.1)) == [0.4, 0.2, 0.1]
    assert halvings((0.4, 0.11)) == [0.4, 0.2]
