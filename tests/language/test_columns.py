"""The registry of columns: names, units and clashes follow from its rows."""

import pytest

import lagsim
from lagsim.errors import InputError
from lagsim.language.columns import (
    DEVIATION,
    IMPULSE,
    KINDS,
    SENSITIVITY,
    Owner,
    base,
    is_of_kind,
    parsed,
)
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from lagsim.outputs.units import units

SCENE = """
parameters: {m: {value: 1, unit: kg}, l: {value: 2, unit: m}}
coordinates: {x: {unit: m}, y: {unit: m}}
definitions: {h: {value: 2*y, unit: m}, DEFINED}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: 9.8*m*y}
constraints:
  x: {relation: y >= 0, restitution: 0, friction: 0.1, slip: x_dot}
initial: {x: 0, y: 1}
output: {gauss: true, action: true, reactions: [h]}
simulation: {duration: 0.1, output_step: 0.1, method: dop853}
"""
PLAIN = SCENE.replace(", DEFINED", "")


def test_every_column_that_the_file_does_not_declare_is_a_row_of_the_registry():
    result = lagsim.simulate(lagsim.load(PLAIN), error_bar="never")
    declared = {"t", "h", "kinetic", "potential", "energy", "work"}
    declared |= {q + rate for q in "xy" for rate in ("", "_dot", "_ddot")}
    rest = [x for x in result.columns if x not in declared]
    found = [parsed(x)[0] for x in rest]
    # Sensitivities and deviations are of several runs.
    assert {x.prefix for x in found} == {
        x.prefix for x in KINDS if x not in (SENSITIVITY, DEVIATION)
    }
    assert {base(x) for x in rest} == {"x", "y", "h", "gauss.G", "action.S"}
    assert all(parsed(x) is None for x in declared)


def test_no_two_kinds_have_one_beginning():
    for one in KINDS:
        others = [x for x in KINDS if x is not one]
        assert not any(x.prefix.startswith(one.prefix) for x in others)


def test_a_kind_without_an_owner_is_its_whole_name():
    assert parsed("gauss.G")[1] == ""
    assert parsed("gauss.G2") is None
    assert parsed("impulse.") is None
    assert is_of_kind("impulse.floor.1", IMPULSE)


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("lambda_x", "N"), ("Qc_x", "N"), ("residual_x", "m"), ("impulse.x", "N s"),
        ("friction.x", "N"), ("gauss.a_x", "m/s^2"), ("gauss.G", "J/s^2"),
        ("action.S", "J s"), ("reaction.h", "N"), ("sd.x_dot", "m/s"),
        ("d.x_dot.l", "1/s"), ("d.x_dot.m", "m/s/kg"), ("d.y.l", ""),
    ],
)  # fmt: skip
def test_units_follow_from_the_rows(column, unit):
    columns = ["x", "y", "x_dot", "y_dot", "h", column]
    equations = derive(read(PLAIN, "scene.yaml"))
    assert units(equations, columns).get(column, "") == unit


# A declaration of each kind that a name can have; the others have letters after the
# point, where names have digits, x, y or z.
CLASHES = {
    "lambda_": "lambda_x: x", "Qc_": "Qc_x: x", "residual_": "residual_x: x",
    "impulse.": "impulse: [5*x, y]", "friction.": "friction: [5*x, y]",
    "reaction.": "reaction: [x, y]", "sd.": "sd: [5*x, y]",
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS, ids=[x.prefix for x in KINDS])
def test_a_name_equal_to_a_column_is_refused_with_both_places(kind):
    if kind.prefix not in CLASHES:
        assert kind.owner in (Owner.RUN, Owner.PAIR) or kind.prefix == "gauss.a_"
        return
    with pytest.raises(InputError) as refused:
        read(SCENE.replace("DEFINED", CLASHES[kind.prefix]), "scene.yaml")
    [problem] = refused.value.problems
    assert problem.code == "column-clash"
    assert problem.place.line == 4
    owner = {Owner.COORDINATE: 3, Owner.COLUMN: 3, Owner.CONSTRAINT: 7}[kind.owner]
    assert problem.hint == f"the first is in line {owner}"
