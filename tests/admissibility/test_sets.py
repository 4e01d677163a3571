"""Sets on which constraints lose their rank all over, multiple roots, cones."""

import math

import numpy as np
import pytest

from tests.admissibility.scenes import check, codes, judged, scene, warning
from tests.support import refused, run

# relations, a point of the set, its dimension, the names that must be told
THIN = {
    "two squares": ("x^2 + y^2 = 0", {"x": 0, "y": 0, "z": 1}, 1),
    "two squares elsewhere": (
        "(x - 3e4)^2 + 4*(y + 2e4)^2 = 0", {"x": 3e4, "y": -2e4, "z": 1}, 1,
    ),
    "a square that is written out": (
        "x^2 - 2*x*y + y^2 = 0", {"x": 1, "y": 1, "z": 0}, 2,
    ),
    "the root of two squares": ("sqrt(x^2 + y^2) = 0", {"x": 0, "y": 0}, 0),
    "fourth powers": ("x^4 + y^4 = 0", {"x": 0, "y": 0, "z": 1}, 1),
    "a crest": ("cos(x) = 1", {"x": 0, "y": 2}, 1),
    "spheres that touch": (
        {"a": "(x - 1)^2 + y^2 + z^2 = 1", "b": "(x + 1)^2 + y^2 + z^2 = 1"},
        {"x": 0, "y": 0, "z": 0}, 0,
    ),
    "a sphere in another": (
        {"a": "(x - 1)^2 + y^2 + z^2 = 1", "b": "sqrt((x - 2)^2 + y^2 + z^2) = 2"},
        {"x": 0, "y": 0, "z": 0}, 0,
    ),
    "a cylinder on a plane": (
        {"a": "z = 0", "b": "x^2 + (z - 1)^2 = 1"}, {"x": 0, "y": 3, "z": 0}, 1,
    ),
    "a plane and a cubic": (
        {"a": "z = 0", "b": "z = x^3"}, {"x": 0, "y": 0, "z": 0}, 1,
    ),
    "rods that are stretched": (
        {"a": "hypot(x, y) = 1", "b": "hypot(x - 2.5, y) = 1.5"}, {"x": 1, "y": 0}, 0,
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", THIN)
def test_thin_sets_are_named_with_their_dimension(name):
    relations, at, dimension = THIN[name]
    start = judged(scene(relations, at))
    assert not start.admissible
    assert start.thin is not None
    assert start.thin.names == ("a" if isinstance(relations, str) else "b",)
    assert start.thin.dimension == start.degrees_of_freedom == dimension
    assert "multiple root" in start.unsolved
    assert not {"redundant", "vanishing-gradient"} & set(codes(start))


SLOW = pytest.param("spheres that touch", marks=pytest.mark.slow)


@pytest.mark.parametrize("name", ["two squares", SLOW, "a crest"])
def test_thin_sets_that_are_guessed(name):
    relations, at, _ = THIN[name]
    near = {k: f"{{guess: {x + 0.01}}}" for k, x in at.items()}
    start = judged(scene(relations, near))
    assert not start.admissible
    assert start.thin is not None


@pytest.mark.slow
@pytest.mark.parametrize("speed", ["0", "{guess: 0.1}"])
def test_velocities_that_satisfy_a_multiple_root(speed):
    at = {"x": 0, "y": 0, "z": 0, "x_dot": speed, "y_dot": speed, "z_dot": 1}
    start = judged(scene("x_dot^2 + y_dot^2 = 0", at))
    check(start, admissible=False, thin=("a",), degrees_of_freedom=1)


@pytest.mark.slow
def test_stretched_rods_between_three_bodies():
    rods = {
        "a": "hypot(x1 - x0, y1 - y0) = 1",
        "b": "hypot(x2 - x1, y2 - y1) = 1",
        "c": "hypot(x2 - x0, y2 - y0) = 2",
    }
    at = {"x0": 0, "y0": 0, "x1": 1, "y1": 0, "x2": 2, "y2": 0}
    for middle in ({}, {"x1": "{guess: 0.9}", "y1": "{guess: 0.1}"}):
        start = judged(scene(rods, at | middle))
        assert not start.admissible
        # The three lie on a line, which moves freely in the plane.
        assert start.degrees_of_freedom == 3


# Multiple roots

SIMPLE = {
    "(x - y)^2 = 0": "x = y", "(x - y)^3 = 0": "x = y", "-2*(y - x)^2/3 = 0": "x = y",
    "abs(x - y) = 0": "x = y", "sqrt(x - y) = 0": "x = y",
    "(x - y)*(x - y) = 0": "x = y", "(x^2 + y^2 - 2)^2 = 0": "x^2 + y^2 = 2",
    "(x*y)^2 = 1 - 1": "x*y = 0", "x^2*(y + 3) = 0": "x*(y + 3) = 0",
}  # fmt: skip
MORE = "simulation: {duration: 1, output_step: 0.25}"


@pytest.mark.parametrize("relation", SIMPLE)
def test_a_multiple_root_runs_as_a_simple_one(relation):
    at = {"x": 1, "y": 1, "x_dot": 0.5, "y_dot": 0.5}
    if "(x^2" in relation:
        at["y_dot"] = -0.5
    elif "x*y" in relation or "x^2*" in relation:
        at = {"x": 0, "y": 1, "y_dot": 0.5}

    def rows(text):
        return run(scene(text, at, potential="9.81*y + x", more=MORE))

    found, expected = rows(relation), rows(SIMPLE[relation])
    for name in ("x", "y", "Qc_x", "Qc_y"):
        # Both at the default tolerance of 1e-11 of values up to 10.
        assert np.max(np.abs(found[name] - expected[name])) < 1e-9
    start = judged(scene(relation, at))
    assert codes(start) == ["multiple-root"]
    assert start.degrees_of_freedom == 1


@pytest.mark.parametrize(("speed", "sound"), [(1, True), (1.1, False)])
def test_velocities_of_a_multiple_root(speed, sound):
    at = {"x": 0, "y": 0, "x_dot": 1, "y_dot": speed}
    assert judged(scene("(x_dot - y_dot)^2 = 0", at)).admissible is sound


# Cones

CONES = [
    "z = hypot(x - 1e3, y)",
    "z^2 = (x - 1e3)^2 + y^2",
    "z = sqrt((x - 1e3)^2 + y^2)",
]


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize(
    "height", [1e-6, 1.0, pytest.param(1e3, marks=pytest.mark.slow)]
)
def test_guesses_at_the_point_of_a_cone_are_solved(cone, height):
    at = {"x": "{guess: 1000}", "y": "{guess: 0}", "z": height}
    start = judged(scene(cone, at))
    assert start.admissible
    far = math.hypot(start.state.q[0] - 1e3, start.state.q[1])
    # x has 1e-13 of rounding; every direction is as good, and that is told.
    assert far == pytest.approx(height, abs=1e-12 + 1e-12 * height)
    assert "no slope" in warning(start, "other-roots")
    assert "undetermined-guess" not in codes(start)


@pytest.mark.parametrize("cone", ["z = hypot(x, y)", "z = sqrt(x^2 + y^2)"])
@pytest.mark.parametrize("value", ["0", "{guess: 0}"])
def test_the_point_of_a_cone_is_told(cone, value):
    with refused("not-finite", "`a`"):
        judged(scene(cone, dict.fromkeys("xyz", value)))


@pytest.mark.slow
def test_what_is_said_of_guesses_is_the_first_row():
    text = scene(
        "z^2 = x^2 + y^2", {"x": "{guess: 0}", "y": "{guess: 0}", "z": 1}, more=MORE
    )
    start, found = judged(text), run(text)
    said = warning(start, "other-roots")
    assert f"x = {found['x'][0]:.6g}, y = {found['y'][0]:.6g}" in said
    stays = judged(scene("x^2 = 4 + y^2", {"x": 2, "y": "{guess: 0}"}))
    assert stays.state.q[1] == 0.0
    assert "to first order no relation determines the guess `y`" in warning(
        stays, "undetermined-guess"
    )
