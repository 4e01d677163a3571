"""Guesses, repair, and states that must not be harmed."""

import math

import numpy as np
import pytest

from tests.admissibility.scenes import check, codes, judged, scene, warning
from tests.scenes.reference import model_text
from tests.support import MODELS

CIRCLE = "x^2 + y^2 = 1"
ELLIPSE = "x^2/4 + y^2 = 1"


def repaired(text):
    start = judged(text)
    assert not start.admissible
    assert start.repair is not None, start.unsolved
    return start.repair


def replaced(text, repair):
    """Paste a repair into `initial`."""
    lines = text.splitlines()
    at = lines.index("initial:")
    rest = [x for x in lines[at + 1 :] if x.split(":")[0].strip() not in repair]
    return "\n".join(
        [*lines[: at + 1], *(f"  {k}: {v!r}" for k, v in repair.items()), *rest]
    )


@pytest.mark.slow
@pytest.mark.parametrize("mass", [1.0, 9.0, 1e-4])
@pytest.mark.parametrize("place", [(3.0, 0.5), (0.2, 0.1), (-1.0, 4.0), (30.0, 20.0)])
def test_repair_is_the_nearest_state_in_the_metric_of_inertia(mass, place):
    x0, y0 = place
    text = scene(ELLIPSE, {"x": x0, "y": y0}, kinetic=f"({mass}*x_dot^2 + y_dot^2)/2")
    found = repaired(text)
    x, y = ({"x": x0, "y": y0} | found).values()
    # No point of the ellipse is nearer, and the slope of the distance vanishes there.
    angles = np.linspace(-math.pi, math.pi, 2001)
    others = mass * (2 * np.cos(angles) - x0) ** 2 + (np.sin(angles) - y0) ** 2
    assert mass * (x - x0) ** 2 + (y - y0) ** 2 <= (1 + 1e-12) * np.min(others)
    slope = mass * (x - x0) * (-2 * y) + (y - y0) * (x / 2)
    assert abs(slope) < 1e-8 * max(1.0, mass) * (abs(x0) + abs(y0))
    check(judged(replaced(text, found)), admissible=True, warnings=(), changes={})


@pytest.mark.parametrize("radius", [1e-9, 1.0, 1e9])
def test_a_start_where_the_gradient_vanishes(radius):
    # From the centre every direction is as good; one is taken, the same each time.
    text = scene(f"x^2 + y^2 = {radius}^2", {"x": 0, "y": 0})
    found = [repaired(text) for _ in range(2)]
    assert found[0] == found[1]
    assert math.hypot(*found[0].values()) == pytest.approx(radius, rel=1e-12)


FLOOR = "floor:\n    relation: y >= {}\n    restitution: 0.5"
ROW, WEIGHTS = np.array([math.sin(0.2), -math.cos(0.2)]), np.array([1.0, 0.25])
MOVED = 1 - WEIGHTS * ROW * (ROW.sum() / (ROW @ (WEIGHTS * ROW)))
SPEED, GUESSED = math.hypot(3, 0.4), math.hypot(2, 0.5)
# A scene, and the nearest admissible values.
NEAREST = [
    # From (0, 0.1) Newton's method stays on the axis: (0, 1) is 0.9 away and nearest.
    (scene(CIRCLE, {"x": 0, "y": 0.1}), {"y": 1.0}),
    *[(scene(CIRCLE, {"x": far, "y": 2 * far}),
       {"x": 1 / math.sqrt(5), "y": 2 / math.sqrt(5)}) for far in (1e2, 1e4, 1e6)],
    (scene("x_dot*sin(p) = y_dot*cos(p)",
           {"x": 0, "y": 0, "p": 0.2, "x_dot": 1, "y_dot": 1, "p_dot": 3},
           kinetic="(x_dot^2 + 4*y_dot^2 + p_dot^2)/2"),
     {"x_dot": MOVED[0], "y_dot": MOVED[1]}),
    # on the ray from the origin
    (scene("x_dot^2 + y_dot^2 = 4", {"x": 0, "y": 0, "x_dot": 3, "y_dot": 0.4}),
     {"x_dot": 6 / SPEED, "y_dot": 0.8 / SPEED}),
    # No y satisfies it with x = 2: the guess does not suffice, both must move.
    (scene(CIRCLE, {"x": 2, "y": "{guess: 0.5}"}),
     {"x": 2 / GUESSED, "y": 0.5 / GUESSED}),
    # What is below a floor touches it: at the foot of the perpendicular from (1, 0).
    (scene(CIRCLE, {"x": 1, "y": 0}).replace(f'a: "{CIRCLE}"', FLOOR.format("x/2")),
     {"x": 0.8, "y": 0.4}),
    (scene(CIRCLE, {"x": 0.6, "y": -0.8}).replace(
        "initial:", f"  {FLOOR.format(0)}\ninitial:"), {"x": 1, "y": 0}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "repair"), NEAREST)
def test_repair_in_closed_form(text, repair):
    found = repaired(text)
    assert found == pytest.approx(repair, rel=1e-9, abs=1e-12)
    assert judged(replaced(text, found)).admissible


@pytest.mark.slow
def test_a_ridge_is_left():
    # On the flat ellipse's short axis it is a minimum, on its long one from near the
    # centre it is not: (2, 0) is 1.9 away, (0, 1) only 1.
    found = repaired(scene(ELLIPSE, {"x": 0.1, "y": 0}))
    # By Lagrange: x (1 - 1/4) ... = 0.1, y != 0.
    x = 0.1 / (1 - 0.25)
    assert found["x"] == pytest.approx(x, rel=1e-9)
    assert abs(found["y"]) == pytest.approx(math.sqrt(1 - x * x / 4), rel=1e-9)


@pytest.mark.slow
def test_repair_of_a_massless_coordinate():
    text = scene("y = x^2", {"x": 1, "y": 3}, kinetic="x_dot^2/2", potential="y")
    x, y = (repaired(text)[name] for name in "xy")
    assert y == pytest.approx(x * x, rel=1e-12)
    # Euclid's metric, for M is singular.
    assert (x - 1) + 2 * x * (y - 3) == pytest.approx(0, abs=1e-9)


# Guesses

ARM = scene(
    {},
    {"a": "{guess: 0.2}", "b": "{guess: 1}", "x": 0.7, "y": 0.3},
    definitions="x: l*cos(a) + l*cos(a + b)\ny: l*sin(a) + l*sin(a + b)",
    kinetic="(x_dot^2 + y_dot^2 + a_dot^2)/2",
    parameters="l: 0.5",
)


def elbow(sign):
    """Return the arm's angles with the tip at (0.7, 0.3)."""
    b = sign * 2 * math.acos(math.hypot(0.7, 0.3))
    return {"a": math.atan2(0.3, 0.7) - b / 2, "b": b}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sign", "a", "b"),
    [
        (1, "0.2", "1"),
        (-1, "0.9", "-1"),
        (1, "0.2", "1 + 2*pi"),
        (1, "0.4", "0.05"),
        (-1, "0.5", "-0.2"),
    ],
)
def test_start_values_of_definitions_are_reached_through_guesses(sign, a, b):
    """Of a crank and a rod that hold each other there are two, but for turns.

    The mirror image is reported where it is about as near.
    """
    start = judged(ARM.replace("0.2", a).replace("guess: 1}", f"guess: {b}}}"))
    assert start.admissible
    found = dict(zip("ab", start.state.q, strict=True))
    found["b"] -= 2 * math.pi * ("pi" in b)
    assert found == pytest.approx(elbow(sign))
    if abs(float(b.partition(" ")[0])) == 1.0:
        assert "other-roots" not in codes(start)
        return
    told, other = warning(start, "other-roots"), elbow(-sign)
    assert told.count("a = ") == 1
    assert f"a = {other['a']:.6g}, b = {other['b']:.6g}" in told


def test_turns_that_a_relation_counts_are_other_roots():
    rack = scene("x = tan(y) + y/10", {"x": 0.3, "y": "{guess: 1.7}"})
    assert warning(judged(rack), "other-roots").count("y = ") == 1


# Roots that differ by a period are one, however near they are to the guess.
@pytest.mark.parametrize("relation", ["x = tan(y)", "x = sin(2*y)/cos(y)^2/2"])
def test_a_root_half_a_turn_away_is_no_other(relation):
    start = judged(scene(relation, {"x": 0.3, "y": "{guess: 1.8}"}))
    assert "other-roots" not in codes(start)
    assert math.tan(start.state.q[1]) == pytest.approx(0.3, rel=1e-14)


@pytest.mark.slow
def test_a_tip_out_of_reach():
    start = judged(ARM.replace("0.7", "1.7"))
    check(start, admissible=False, unsolved="cannot be satisfied")
    assert "x: 1.7" in start.unsolved


@pytest.mark.parametrize(("guess", "root"), [(0.1, 0.8), (-0.1, -0.8), (5, 0.8)])
def test_the_nearest_root_is_taken(guess, root):
    start = judged(scene(CIRCLE, {"x": 0.6, "y": f"{{guess: {guess}}}"}))
    check(start, admissible=True, changes={})
    assert start.state.q[0] == 0.6  # it is no guess
    assert start.state.q[1] == pytest.approx(root, rel=1e-15)
    assert f"y = {-root:g}" in warning(start, "other-roots")


def test_a_guess_that_nothing_determines():
    start = judged(scene("x = 1", {"x": 1, "y": "{guess: 7}"}))
    check(start, codes=["undetermined-guess"])
    assert start.state.q[1] == 7.0


# Never harm

EXACT = [
    (CIRCLE, {"x": 0.6, "y": 0.8}),
    (CIRCLE, {"x": "cos(0.3)", "y": "sin(0.3)"}),
    ("y = x^3 + x", {"x": 0.1, "y": "x^3 + x"}),
    ("y = sin(x)/(1 + x^2)", {"x": 0.7, "y": "sin(x)/(1 + x^2)"}),
    ("x = 0", {"x": "cos(pi/2)", "y": 3}),
    (
        "x_dot*sin(y) = z_dot*cos(y)",
        {"x": 1, "y": 0.3, "z": 2, "z_dot": 0.1, "x_dot": "z_dot/tan(y)"},
    ),
]


@pytest.mark.parametrize(("relation", "initial"), EXACT)
@pytest.mark.parametrize("guessed", [False, True])
def test_an_exact_start_comes_back_bit_for_bit(relation, initial, guessed):
    stated = judged(scene({}, initial))
    if guessed:
        initial = {name: f"{{guess: {value}}}" for name, value in initial.items()}
    start = judged(scene(relation, initial))
    check(start, admissible=True, changes={})
    assert np.array_equal(start.state.q, stated.state.q)
    assert np.array_equal(start.state.v, stated.state.v)


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_models_start_exactly_where_they_say(path):
    start = judged(path.read_text(), file=str(path))
    check(start, admissible=True, changes={})
    assert not {"rough-start", "redundant", "vanishing-gradient"} & set(codes(start))


@pytest.mark.slow
def test_a_repaired_mechanism_pastes_back():
    # 20 coordinates, 24 rows of rank 23.
    stated = model_text("bricard")
    at = stated.index("initial:")
    lines = (stated[:at] + stated[at:].replace('"', "")).splitlines()
    lines[lines.index("initial:") + 1] += " + 0.07"
    text = "\n".join(lines)
    again = judged(replaced(text, repaired(text)))
    check(again, admissible=True, ranks__rank=23, changes={})
    assert set(codes(again)) == {"redundant", "multipliers-not-unique"}


@pytest.mark.parametrize("guess", ["3", "1e-8", "1e8"])
def test_a_speed_of_zero_found_but_for_underflow_is_one_root(guess):
    # x' = 2 t is 0 at the start; Newton's method leaves 1e-60 of where it came from.
    at = dict.fromkeys(("x", "y", "x_dot", "y_dot"), "{guess: 0}")
    text = scene(
        {"sum": "x + y = 1", "drive": "x_dot = 2*t"},
        at | {"x_dot": f"{{guess: {guess}}}"},
        kinetic="(1e6*x_dot^2 + 1e-6*y_dot^2)/2",
    )
    start = judged(text)
    assert start.admissible
    assert "other-roots" not in codes(start)
