"""What makes a run doubtful, on rows that are right and then spoilt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lagsim.outputs.table import TableWriter
from lagsim.run.error import ErrorBar
from lagsim.run.observers.monitors import Growth
from tests.small_scenes import held_pendulum
from tests.studies.judged import codes, doubt
from tests.support import run

SWING = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: "1 - cos(x)"}
initial: {x: 1}
simulation: {duration: 10, output_step: 0.01}
"""
ROD = held_pendulum("pi/2", "duration: 10, output_step: 0.01")


def spoilt(found, column, change):
    """Give a run with a function of the time added to a column of its rows."""
    rows = found.rows.copy()
    place = found.system.columns.names.index(column)
    rows[:, place] += change(rows[:, 0])
    return replace(found, rows=rows)


def bar_of(found, error, **more):
    """Give an estimate that is the same for the coordinate and its rate."""
    t = found.rows[:, 0]
    errors = error(t)[:, None]
    scales = np.ptp(found.rows[:, 1:2], axis=0)
    return ErrorBar("dop853", 1e-13, ("x",), t, errors, scales, rates=errors, **more)


def bump(size):
    return lambda t: size * (np.abs(t - 5.0) < 0.25)


def test_a_sound_run_is_not_in_doubt():
    for text in (SWING, ROD):
        found = run(text)
        assert doubt(found) is None
        assert codes(found) == []


@pytest.mark.parametrize("size", [0.3, -0.3, 3e-3])
def test_energy_that_comes_back(size):
    """The first and the last value are the same; the largest deviation counts."""
    found = spoilt(run(SWING), "energy", bump(size))
    told = doubt(found)
    assert told.refutes
    assert told.time == pytest.approx(4.75, abs=0.02)
    assert codes(found) == ["energy-gained" if size > 0 else "energy-lost"]


@pytest.mark.parametrize("size", [1e-5, -1e-4])
def test_a_drift_that_no_estimate_explains_is_a_warning(size):
    """The energy in play is 1 - cos 1 = 0.46."""
    found = spoilt(run(SWING), "energy", bump(size))
    assert codes(found) == ["error-unknown"]
    assert not codes(spoilt(run(SWING, rtol=1e-6), "energy", bump(size)))
    assert not codes(spoilt(found, "energy", bump(-size)))


def test_what_the_estimated_error_explains_is_no_doubt():
    # At a speed of up to 1 an error of 1e-4 is worth no more than 2e-4.
    found = spoilt(run(SWING), "energy", bump(1e-4))
    assert doubt(found, bar_of(found, lambda t: 1e-12 * (1 + t))).refutes
    assert doubt(found, bar_of(found, lambda t: 1e-4 * (t > 4))) is None
    # An error that comes later explains nothing.
    later = doubt(found, bar_of(found, lambda t: 1e-4 * (t > 7)))
    assert later is not None
    assert later.refutes


def test_energy_that_is_far_off_is_in_doubt_whatever_explains_it():
    found = spoilt(run(SWING), "energy", bump(0.3))
    assert doubt(found, bar_of(found, lambda t: 1.0 * (t > 4))).refutes


ONE_SIDED = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: "y^2/2 + POTENTIAL"}
initial: {x: 1, y: 0.3}
simulation: {duration: 10, output_step: 0.01}
"""
CONTINUOUS = [
    "if(x > 0, x^2, 0) + if(x < 0, 3*x^2, 0)",
    "x^2 + max(0, -x)^2",
    "abs(x)",
    "x^2/2 + if(x > 0.5, (x - 0.5)*y, 0)",
    "x^2 + sign(x)*x^3",
    "x^2 + 1e-3*sign(x + y)*(x + y)",
    "x^2 + if(y > 0, 1, 1)*x^2",
]
JUMPING = [
    "x^2 + if(x > 0, 0.01, 0)",
    "x^2/2 + floor(3*x)",
    "x^2 + sign(y)*(1 + y)",
    "x^2 + if(x > 0 and y > 0, x + y, 0)",
    "x^2 + heaviside(x - 0.2)",
]


@pytest.mark.parametrize("potential", CONTINUOUS)
def test_an_energy_with_switches_is_judged_where_it_is_continuous(potential):
    found = run(ONE_SIDED.replace("POTENTIAL", potential))
    assert found.drift < 1e-8
    assert doubt(found) is None
    told = doubt(spoilt(found, "energy", bump(0.3)))
    assert told.refutes
    assert told.time == pytest.approx(4.75, abs=0.02)


@pytest.mark.parametrize("potential", JUMPING)
def test_an_energy_that_jumps_is_not(potential):
    """A jump of the potential makes no impulse, and its energy is another."""
    found = run(ONE_SIDED.replace("POTENTIAL", potential))
    assert found.drift > 1e-3
    assert doubt(found) is None
    assert doubt(spoilt(found, "energy", bump(0.3))) is None


def test_a_jump_that_one_row_alone_shows():
    # At t = 1.01: of the 1001 rows each other one is kept to be looked at.
    potential = "x^2 + if(abs(x - 0.142) < 0.001, 0.01, 0)"
    found = run(ONE_SIDED.replace("POTENTIAL", potential))
    assert found.drift > 1e-3
    assert doubt(found) is None


def test_a_constraint_that_lets_go():
    found = spoilt(run(ROD), "residual_rod", lambda t: 1e-3 * np.maximum(t - 6, 0))
    told = doubt(found)
    assert told.refutes
    assert "`rod`" in told.text
    assert told.time == pytest.approx(6.0, abs=0.05)
    assert "constraint-not-held" in codes(found)


def test_a_constraint_whose_terms_all_vanish_is_held():
    """Off by rounding, and so is all that it is made of; x moves by 1 beside it."""
    text = """
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: x^2/2}
constraints: {flat: y - z = 0}
initial: {x: 1, y: 0, z: 0}
simulation: {duration: 10, method: dop853, formulation: projection}
"""
    found = run(text)
    for name in ("y", "residual_flat", "scale.flat"):
        found = spoilt(found, name, lambda t: 1e-17 * (t > 3))
    assert doubt(found) is None
    assert codes(found) == []
    off = spoilt(found, "residual_flat", lambda t: 1e-3 * (t > 3))
    assert doubt(off).refutes


def test_another_end_is_in_doubt_and_told():
    found = run(SWING)
    bar = bar_of(found, lambda t: 1e-12 * (1 + t), parted="it ended with `done`")
    told = doubt(found, bar)
    assert told is not None
    assert not told.refutes
    assert codes(found, bar) == ["end-in-doubt"]


def test_methods_with_fixed_steps_are_not_judged():
    found = run(SWING, method="rk4", step="0.01")
    assert doubt(spoilt(found, "energy", bump(0.3))) is None
    loose = run(ROD, formulation="drift", method="dop853", rtol="1e-3")
    assert doubt(loose) is None


def test_when_a_value_has_grown():
    grown = Growth()
    t = np.arange(1000.0)
    for block in np.array_split(t, 11):
        grown.add(block[:, np.newaxis], 1e-6 * np.exp(block / 50))
    for bound in (1e-5, 1e-3, 0.1):
        exact = 50 * np.log(bound * 1e6)
        # Noted at steps of 10 %, which is 5 units of time.
        assert exact <= grown.since(bound) <= exact + 6
    assert grown.since(1e9) is None


def test_a_table_begins_anew(tmp_path):
    path = tmp_path / "t.csv"
    writer = TableWriter(path, ["t", "x"])
    writer.add(np.arange(200.0).reshape(100, 2))
    writer.begin_anew()
    assert (writer.rows, writer.last) == (0, None)
    writer.add(np.array([[1.0, 2.0]]))
    writer.close()
    assert path.read_bytes() == b"t,x\r\n1.0,2.0\r\n"
