"""Scenes whose motion is known exactly, in plain words and in others."""

import numpy as np
import pytest

import lagsim
from tests.choosing import tonight, turn
from tests.scenes.contact.motions import play, scene
from tests.scenes.exact import chains, check, contacts, driven, held, plain, switches
from tests.scenes.exact.switches import two

SCENES = switches.SCENES | driven.SCENES | chains.SCENES | contacts.SCENES
SCENES |= held.SCENES | plain.SCENES
WORDS = 3


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_it_moves_as_it_must(name):
    check(SCENES[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_it_does_so_in_other_words(name):
    for word in SCENES[name].words(name, WORDS):
        check(SCENES[name], word)


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("balanced under 0", "boosted"), ("nearly balanced", "boosted"),
        ("pushed by another's way, -1", "grams"),
        ("balanced under if(t < 1, 0, 1e-3*(t - 1))", "shifted"),
        ("two are pushed by 2.0*sin(3.0*t) beside 0", "shifted"),
        ("pushed at an angle of 2.0", "boosted"),
        ("pushed at an angle of 0.001", "boosted"),
    ],
)  # fmt: skip
def test_rounding_in_other_words_costs_no_steps(name, word):
    """Places and clocks cancel, slips begin by turns, one stops; a body turns back."""
    check(SCENES[name], word)


@pytest.mark.nightly
@pytest.mark.parametrize("name", SCENES)
def test_it_does_so_in_the_words_of_a_commit(name):
    every = SCENES[name].words(name, 100)
    check(SCENES[name], turn(name, tonight(), every))


def test_what_no_value_on_the_switch_lets_stay_is_not_decided():
    """At rest `if(x_dot >= 0, 1, -1)` pushes up, and down below: both go on."""
    text = two("if(x_dot >= 0, 1, -1)", "0")
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert [w.code for w in found.warnings] == ["unresolved-switch"]
    assert abs(found["x"][-1]) == pytest.approx(2.0)


@pytest.mark.parametrize("pair", driven.PAIRS)
def test_where_relations_part_the_reason_names_the_first_row_that_is_none(pair):
    one, other = driven.PAIRS[pair]
    laws = [one, other.format(more="max(0, t - 2.91)")]
    model = lagsim.load(driven.parting(laws))
    found = lagsim.simulate(model, error_bar="never")
    assert "t = 3 " in found.reason
    assert len(found.t) == 30


@pytest.mark.parametrize("mass", [1e-4, 1e-5, 1e-6, 1e-7])
def test_a_light_slider_on_a_driven_spring_starts_from_rest(mass):
    stiff = contacts.STIFF
    found = play(scene(
        "x s", f"x_dot^2/2 + {mass}*s_dot^2/2", f"{stiff / 2}*(x - s)^2",
        {
            "drive": "x = 0.1*sin(2*pi*t)",
            "rest": {"relation": "s_dot = 0", "limit": 0.5},
        },
        {"x": 0, "s": 0, "x_dot": {"guess": 0.6}}, duration=0.05,
    ))  # fmt: skip
    times, s = contacts.hops(mass, 0.05)
    assert len(times) > 1
    assert found.times("slip") == pytest.approx(times, abs=1e-9)
    assert found["s"][-1] == pytest.approx(s, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("v", [1.0, 3e-3, 2e4])
@pytest.mark.parametrize(
    ("start", "at", "on_a_row"),
    [
        (0, "0.3", True), (0, "0.7", True), (0, "0.6", True), (0, "(0.1 + 0.2)", True),
        (0, "(1 - 0.7)", True), (2, "2.3", True), (2, "(2 + 0.1*7)", True),
        (0, "0.35", False), (0, "0.301", False),
    ],
)  # fmt: skip
def test_an_impact_of_a_moving_constraint_has_two_rows(start, at, on_a_row, v):
    """Before and after at one time; where that is an output time, these are its rows.

    Times of rows are start + k*0.1, off 0.3 by its last digit.
    """
    found = play(scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "(x - y)^2/2", {"a": f"x = {v}*abs(t - {at})"},
        {"x": {"guess": 1}, "y": 0, "x_dot": {"guess": -1}}, start=start, duration=1,
        output_step=0.1,
    ))  # fmt: skip
    t, struck = found.t, start + float(eval(at)) - start  # noqa: S307
    near = np.flatnonzero(np.abs(t - struck) < 1e-9)
    assert len(near) == 2
    assert t[near[0]] == t[near[1]]
    assert found["x_dot"][near] == pytest.approx([-v, v])
    assert len(t) == 11 + (1 if on_a_row else 2)
    assert np.all(np.diff(t)[np.arange(len(t) - 1) != near[0]] > 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", held.SCENES)
@pytest.mark.parametrize(
    "options",
    [{"method": "dop853"}, {"rtol": "1e-4"}, {"rtol": "1e-13"}, {"method": "rk4"}],
    ids=lambda x: "-".join(x.values()),
)
def test_what_is_held_stays_by_other_means(name, options):
    found = lagsim.simulate(lagsim.load(held.SCENES[name].text), **options)
    assert found.complete
    assert not found.warnings
    assert found.record["error"]["horizon"] is None
    assert np.max(np.abs(found["x"])) < 1e-9


SMALL = """
parameters: {size: 1, L: 1}
coordinates: {x: {}, z: {}}
energy:
  kinetic: (x_dot^2 + 1e6*z_dot^2)/2
  potential: 200*(x/L + 0.05)^2*L^2 + 1e6*z^2/2
forces: {x: 20*L}
initial: {x: size*L, z: L}
simulation: {duration: 30, output_step: 0.1, method: dop853, rtol: 1e-6}
"""


@pytest.mark.parametrize("length", ["1e-9", "1", "1e6"])
@pytest.mark.parametrize("size", [1e-1, 1e-5, 1e-8])
def test_a_small_motion_about_a_balance_is_told_as_a_part_of_its_own(size, length):
    # cos(20 t), whatever the load: forces that cancel are no scale of what moves.
    model = lagsim.load(SMALL).bind(size=size, L=float(length))
    run = lagsim.simulate(model)
    range_ = size * float(length)
    true = np.max(np.abs(run["x"] - range_ * np.cos(20 * np.asarray(run.t)))) / range_
    told = run.record["error"]["coordinates"]["x"]["relative"] * 2
    assert told > 1e-9
    assert true / 30 < told < 30 * true + 1e-6
