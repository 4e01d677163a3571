"""What is swept: names, values, and their combinations."""

from __future__ import annotations

import itertools
import math

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.studies.sweep.runs import MOST_RUNS, grid_of, parsed

TEXT = """\
parameters: {l: 2, g: {value: 9.8, unit: m/s^2}, reason: 1}
coordinates: {theta: {unit: rad}}
definitions: {x: {value: l*sin(theta), unit: m}}
energy: {kinetic: l^2*theta_dot^2/2, potential: -g*l*cos(theta)}
initial: {theta: 1, theta_dot: 0}
simulation: {duration: 2, output_step: 0.1}
"""


@pytest.fixture
def model():
    return read(TEXT, "<model>")


def test_all_combinations_the_first_name_slowest(model):
    grid = parsed(model, ["g=1,2", "theta=0:1:3", "l=5,6"])
    expected = list(itertools.product([1, 2], [0, 0.5, 1], [5, 6]))
    assert grid.runs == 12
    assert [tuple(grid.values(k)) for k in range(12)] == expected
    assert [axis.starts for axis in grid.axes] == [False, True, False]
    assert [axis.unit for axis in grid.axes] == ["m/s^2", "rad", ""]


def test_numbers_between_round_ends_are_round(model):
    [axis] = parsed(model, ["g=0:1:11"]).axes
    assert axis.values == tuple(k / 10 for k in range(11))
    assert [float(text) for text in axis.texts] == list(axis.values)


def test_values_are_expressions(model):
    grid = parsed(model, ["theta=-pi/2:pi:4", "g=atan2(1, 2), 3*l,1e-3"])
    first, second = grid.axes
    assert first.values == pytest.approx([-math.pi / 2, 0.0, math.pi / 2, math.pi])
    assert second.texts == ("atan2(1, 2)", "3*l", "1e-3")
    assert second.values == pytest.approx([math.atan2(1, 2), 6.0, 1e-3])


def test_start_values_of_rates_and_definitions(model):
    grid = parsed(model, ["theta_dot=1,2", "x=0.1,0.2"])
    assert [axis.unit for axis in grid.axes] == ["rad/s", "m"]
    assert all(axis.starts for axis in grid.axes)


def test_python_gives_numbers_or_expressions(model):
    [axis] = grid_of(model, {"g": [1, 2.5, "pi"]}).axes
    assert axis.texts == ("1.0", "2.5", "pi")
    assert axis.values == (1.0, 2.5, math.pi)


FAULTS = {
    "no values": (["g"], "a name and its values"),
    "no name": (["=1,2"], "a name and its values"),
    "twice": (["g=1", "g=2"], "g is given twice"),
    "one value between": (["g=1:2:1"], "two ends and how many"),
    "no count": (["g=1:2"], "two ends and how many"),
    "a count that is none": (["g=1:2:x"], "two ends and how many"),
    "four parts": (["g=1:2:3:4"], "two ends and how many"),
    "no such name": (["gg=1"], "`gg` is no parameter of"),
    "no such value": (["g=1,nothing"], "nothing"),
    "an empty value": (["g=1,"], ""),
    "not finite": (["g=1/0,1"], "not a finite number"),
    "a column": (["reason=1,2"], "sweep.csv has a column of that name"),
    "too many of one": (["g=0:1:123456789"], f"more than {MOST_RUNS}"),
    "too many": (["g=0:1:2000", "l=0:1:2000"], f"more than {MOST_RUNS}"),
}


@pytest.mark.parametrize(("arguments", "told"), FAULTS.values(), ids=FAULTS)
def test_faults_are_told(model, arguments, told):
    with pytest.raises(InputError) as fault:
        parsed(model, arguments)
    assert told in str(fault.value)


def test_all_faults_are_told_at_once_with_what_was_meant(model):
    with pytest.raises(InputError) as fault:
        grid_of(model, {"thetta": [1], "g": ["+"]})
    assert "did you mean `theta`?" in str(fault.value)
    assert len(fault.value.problems) == 2
