"""Trials: runs in variants, whose faults are results, alike in one process and two."""

import os
import time

import numpy as np
import pytest

import lagsim
from lagsim.model.reader import read
from lagsim.run.interrupt import Interrupt
from lagsim.run.session import Case
from lagsim.studies.trial import INADMISSIBLE, TOO_SLOW, UNUSABLE, Patience, tried
from lagsim.studies.trials import Trials, Variant
from lagsim.studies.workers import completed_pieces, shared_processes
from tests.small_scenes import CONTACT, PENDULUM, spring

SPRING = spring("duration: 3, output_step: 0.5", parameters="k: 4, w: sqrt(k)")
ROD = """
parameters: {l: 1}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.8*y}
constraints: {rod: x^2 + y^2 = l^2}
initial: {x: 0.6, y: -0.8}
simulation: {duration: 1}
"""
# The speed of free fall into a centre has no bound.
CENTRE = """
parameters: {mu: 1}
coordinates: {r: {}}
energy: {kinetic: r_dot^2/2, potential: -mu/r}
initial: {r: 1}
simulation: {duration: 3}
"""


def trials(text, **options):
    return Trials(read(text, "<model>"), options)


@pytest.mark.parametrize("method", ["dop853", "taylor", "radau"])
@pytest.mark.parametrize("k", [1.0, "2*2", 9])
def test_values_settings_and_times_of_a_variant(k, method):
    times = np.array([2.9, 0.1, 0.1, 3.0, 0.0])
    variant = Variant({"k": k, "x": 2}, {"method": method, "rtol": 1e-13}, times)
    found = trials(SPRING).run(variant)
    w = np.sqrt(eval(str(k)))  # noqa: S307
    assert found.complete
    assert found.column("t").tolist() == times.tolist()
    # A hundred tolerances, of a motion of size 2.
    assert found.column("x") == pytest.approx(2 * np.cos(w * times), abs=2e-11)


@pytest.mark.slow
def test_the_rows_of_a_variant_are_those_of_a_run_with_the_values():
    some = trials(CONTACT)
    for value in (0.5, 1.5):
        found = some.run(Variant({"y": value}))
        alone = lagsim.simulate(lagsim.load(CONTACT).bind(y=value), error_bar="never")
        columns = [found.columns.index(name) for name in alone.columns]
        assert np.array_equal(found.rows[:, columns], alone.table, equal_nan=True)
        assert [*found.events] == [*alone.events]


def test_times_change_no_step():
    some = trials(SPRING)
    whole = some.run()
    found = some.run(Variant(times=np.array([0.25, 1.0, 3.0, 4.0])))
    assert np.array_equal(found.rows[1:3], whole.rows[[2, 6]])
    assert np.isnan(found.rows[3]).all()
    assert found.statistics.steps == whole.statistics.steps


def test_functions_are_compiled_once_for_all_values_that_they_fit(monkeypatch):
    compiled, ready = [], Case.ready

    def counted(self, *given, **more):
        compiled.append(self.settings.method)
        return ready(self, *given, **more)

    monkeypatch.setattr(Case, "ready", counted)
    some = trials(PENDULUM)
    for method in ("auto", "rk4"):
        for length in (1.0, 2.0, 3.0):
            some.session(Variant({"l": length}, {"method": method}))
    assert compiled == ["auto", "rk4"]


REFUSED = [
    (ROD, {"l": 2.0}, {}, INADMISSIBLE, "inadmissible"),
    (ROD, {"l": "1/0"}, {}, UNUSABLE, "not-finite"),
    (ROD, {"r": 1.0}, {}, UNUSABLE, "unknown-name"),
    (ROD, {}, {"method": "verlet"}, UNUSABLE, "method-refused"),
    (CENTRE, {}, {}, "failed", "step-too-small"),
]


@pytest.mark.parametrize(("text", "values", "settings", "outcome", "code"), REFUSED)
def test_faults_are_results(text, values, settings, outcome, code):
    found = trials(text).run(Variant(values, settings))
    assert not found.complete
    assert (found.outcome, found.code) == (outcome, code)
    assert found.reason


def test_a_column_that_is_not_there_is_named_with_the_reason():
    some = trials(SPRING)
    with pytest.raises(KeyError, match="no column `z`"):
        some.run().column("z")
    with pytest.raises(KeyError, match="unusable"):
        some.run(Variant({"k": "1/0"})).column("x")


def test_a_failed_run_has_the_rows_before_its_end():
    # A fall from r = 1 takes pi/sqrt(8 mu); the time at radius r has a closed form.
    times = np.array([0.5, 1.0, 2.0])
    found = trials(CENTRE).run(Variant(times=times))
    r = found.column("r")[:2]
    t = (np.sqrt(r * (1 - r)) + np.arccos(np.sqrt(r))) / np.sqrt(2)
    assert t == pytest.approx(times[:2], abs=1e-9)
    assert np.isnan(found.rows[2]).all()
    assert found.end == pytest.approx(np.pi / np.sqrt(8), abs=1e-6)


def test_a_run_beyond_its_time_is_given_up():
    session = trials(SPRING, method="euler", step=1e-5).session()
    found = tried(session, patience=Patience(0.0))
    assert (found.outcome, found.complete) == (TOO_SLOW, False)
    assert len(found.rows) == 0


@pytest.mark.slow
def test_start_values_follow_as_guesses_do():
    some = trials(ROD)
    variant = Variant({"x": 0.61}, times=np.zeros(1), guesses=("y", "x_dot", "y_dot"))
    assert some.run(variant._replace(guesses=())).outcome == INADMISSIBLE
    [y] = some.run(variant).column("y")
    assert y == pytest.approx(-np.sqrt(1 - 0.61**2), rel=1e-15)
    assert some.run(Variant(times=np.zeros(1))).column("y") == [-0.8]


def number_of_process(_item, _interrupt):
    """Wait, so that no process has two of two pieces."""
    time.sleep(0.2)
    return os.getpid()


@pytest.mark.slow
def test_a_standing_crew_is_hired_again():
    with shared_processes(2) as hired:
        first, second = (
            dict(completed_pieces(number_of_process, range(2), 2, Interrupt(), hired))
            for _ in range(2)
        )
    assert {*first.values()} == {*second.values()}
    assert os.getpid() not in first.values()


def trial_of(piece, interrupt):
    """Return the result of a variant, of a pair of trials and variant."""
    some, variant = piece
    return some.run(variant, interrupt=interrupt)


@pytest.mark.slow
def test_two_processes_have_the_bits_of_one():
    some = trials(CONTACT, rtol=1e-9)
    pieces = [(some, Variant({"y": 1.0 + k / 8})) for k in range(9)]
    one, two = (
        dict(completed_pieces(trial_of, pieces, most, Interrupt())) for most in (1, 2)
    )
    assert one.keys() == two.keys() == {*range(9)}
    for k, trial in one.items():
        assert np.array_equal(trial.rows, two[k].rows, equal_nan=True)
        assert trial.events == two[k].events
