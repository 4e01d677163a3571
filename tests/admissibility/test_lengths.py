"""Verdicts on starts do not depend on place, motion, units or other bodies."""

import math

import pytest

from lagsim.admissibility.point import Point
from tests.admissibility.scenes import check, codes, judged, scene, warning

SHIFTS = (0.0, 1e3, 1e6)
RELATIVE = (
    "(x2 - x1)^2 + (y2 - y1)^2 = 1",
    "hypot(x2 - x1, y2 - y1) = 1",
    "1 - sqrt((x1 - x2)^2 + (y1 - y2)^2) = 0",
)


def rod(shift, miss, form=RELATIVE[0], unit=1.0):
    """Return a rod of 1 m whose far end is off by `miss` of its length."""
    places = {
        "x1": shift * unit,
        "y1": -shift * unit,
        "x2": f"{shift * unit!r} + {(0.6 + miss) * unit!r}",
        "y2": f"{-shift * unit!r} + {0.8 * unit!r}",
    }
    return scene(form, places)


def flying(speed, miss):
    at = {
        "x1": 0, "y1": 0, "x2": 0.6, "y2": 0.8, "x1_dot": speed, "y1_dot": -speed,
        "x2_dot": speed - 0.8 + miss, "y2_dot": -speed + 0.6,
    }  # fmt: skip
    return scene(RELATIVE[0], at)


def pinned(shift, miss):
    return scene(
        {"pin": f"x = {shift!r}", "rod": "(b - x)^2 + y^2 = 0.01"},
        {"x": shift + miss, "b": f"{shift + miss!r} + 0.06", "y": -0.08},
        kinetic="(1000*x_dot^2 + 0.1*(b_dot^2 + y_dot^2))/2",
    )


def turned(turns, miss):
    return scene(
        {"across": "x = X + l*sin(a)", "down": "y = -l*cos(a)"},
        {"X": 0, "a": f"0.5 + 2*pi*{turns}", "x": f"sin(a) + {miss}", "y": "-cos(a)"},
        parameters="l: 1",
    )


SKATE = "y_dot*cos(p) = x_dot*sin(p)"
# A car: the rear wheels do not slip sideways, nor the front ones, which are turned.
CAR = {
    "rear": SKATE,
    "front": "y_dot*cos(p + d) = x_dot*sin(p + d) - l*p_dot*cos(d)",
    "wheel": "r*w_dot = x_dot*cos(p) + y_dot*sin(p)",
}


def car(yaw, name, miss):
    at = {
        "x": 0, "y": 0, "p": yaw, "d": 0, "w": 0, "x_dot": f"2*cos({yaw})",
        "y_dot": f"2*sin({yaw})", "p_dot": "0", "w_dot": 2 / 0.3,
    }  # fmt: skip
    at[name] = f"{at[name]} + {miss!r}"
    return scene(CAR, at, parameters="l: 1.1, r: 0.3")


# A text, and whether its start is admissible: up to a millionth of a length, or of the
# motion, and far away within rounding (sums lose 20 bits).
JUDGED = [
    *[(rod(s, miss, form), miss < 1e-6)
      for s in SHIFTS for form in RELATIVE for miss in (0.0, 1e-7)],
    *[(rod(s, miss, RELATIVE[0].replace("= 1", f"= {u!r}^2"), u), miss < 1e-6)
      for s in SHIFTS for u in (1e-3, 1e3) for miss in (1e-7, 1e-5)],
    *[(flying(v, miss), miss < 1e-6)
      for v in (0.0, 1e3, 2.0**20) for miss in (0.0, 1e-7, 1e-3, 0.5)],
    # pins have the lengths of what hangs on them
    *[(pinned(s, miss), miss == 0.0) for s in SHIFTS for miss in (0.0, 0.3)],
    *[(scene("x2 - x1 = 1", {"x1": s, "x2": s + gap}), gap == 1.0)
      for s in SHIFTS for gap in (1.0, 1.3, 1.00001)],
    *[(turned(n, miss), miss == 0.0)
      for n in (0, 800, 160_000) for miss in (0.0, 1e-2)],
    *[(car(yaw, name, miss), miss < 1e-6)
      for yaw in ("0", "pi/2", "pi") for name in ("y_dot", "p_dot")
      for miss in (0.0, 1e-14, 1e-3)],
]  # fmt: skip


@pytest.mark.parametrize(("text", "sound"), JUDGED)
def test_what_is_near_enough(text, sound):
    assert judged(text).admissible is sound


@pytest.mark.slow
@pytest.mark.parametrize("form", RELATIVE)
@pytest.mark.parametrize("shift", SHIFTS)
def test_a_rod_is_repaired_along_its_length(form, shift):
    assert "rough-start" in codes(judged(rod(shift, 1e-7, form)))
    # 0.57 m of 1 m, and what is just past a millionth.
    for miss in (0.57, 1e-2, 1e-5):
        start = judged(rod(shift, miss, form))
        # The nearest state moves both ends along the rod by half of what it is off.
        off = (math.hypot(0.6 + miss, 0.8) - 1.0) / 2.0
        along = (0.6 + miss) / math.hypot(0.6 + miss, 0.8)
        assert start.repair["x1"] - shift == pytest.approx(off * along, abs=1e-9)


@pytest.mark.slow
def test_ten_digits_far_away_do_not_make_a_rod():
    # 0.1 mm of 1 m: told, with the nearest state.
    at = {"x1": "1000000.123", "y1": 0, "x2": "1000000.7231", "y2": "0.8"}
    start = judged(scene(RELATIVE[0], at))
    check(start, admissible=False)
    assert start.verdicts[0].position.why == "1e-06 of the lengths that it relates"
    assert set(start.repair) == {"x1", "y1", "x2", "y2"}


@pytest.mark.slow
@pytest.mark.parametrize("shift", SHIFTS)
def test_other_roots_are_found_far_away(shift):
    rods = {
        "left": f"hypot(x - {shift!r}, y) = 1",
        "right": f"hypot(x - {shift!r} - 1, y) = 1",
    }
    at = {"x": f"{{guess: {shift + 0.3!r}}}", "y": "{guess: 0.1}"}
    start = judged(scene(rods, at))
    assert start.state.q[0] - shift == pytest.approx(0.5, abs=1e-9)
    assert start.state.q[1] == pytest.approx(math.sqrt(0.75), abs=1e-9)
    assert "y = -0.866025" in warning(start, "other-roots")


@pytest.mark.parametrize("mass", [1.0, 1e30])
@pytest.mark.parametrize("place", [1.0, 1e11])
@pytest.mark.parametrize(
    "x", ["0.6", "0.7", "0.6000001", "{guess: 0.7}", "0.6 + 1e-15"]
)
def test_a_bystander_changes_nothing(mass, place, x):
    at = {"x1": 0, "y1": 0, "x2": x, "y2": 0.8}
    alone = judged(scene(RELATIVE[0], at))
    kinetic = f"(x1_dot^2 + y1_dot^2 + x2_dot^2 + y2_dot^2 + {mass!r}*s_dot^2)/2"
    start = judged(scene(RELATIVE[0], at | {"s": place}, kinetic=kinetic))
    check(start, admissible=alone.admissible, codes=codes(alone))
    assert start.changes.keys() == alone.changes.keys()
    assert (start.repair or {}) == pytest.approx(alone.repair or {}, abs=1e-12)
    assert start.state.q[:4] == pytest.approx(alone.state.q, abs=1e-14)


@pytest.mark.parametrize("speed", [1.0, 1e3])
@pytest.mark.parametrize("miss", [1e-15, 1e-14, 1e-13, 1e-5, -0.3])
def test_a_rate_whose_terms_vanish_is_judged_by_the_motion(speed, miss):
    at = {"x": 0, "y": 0, "p": 0, "x_dot": speed, "y_dot": miss * speed}
    start, admissible = judged(scene(SKATE, at)), 0.0 < miss < 1e-6
    assert start.admissible is admissible
    if admissible:
        assert not start.changes or abs(start.state.v[1]) <= abs(miss * speed)
        assert "rough-start" not in codes(start)
    else:
        assert start.repair == pytest.approx({"y_dot": 0.0}, abs=1e-15)
    # Another body that moves fast does not count.
    at = {**at, "s": 0, "s_dot": 1e9 * speed}
    assert judged(scene(SKATE, at)).admissible is admissible


# Guesses of relations that only rounding satisfies, and of relations with far roots


@pytest.mark.slow
@pytest.mark.parametrize("other", [None, "1", "1e9"])
@pytest.mark.parametrize("guess", ["-1", "0.3", "1", "40"])
@pytest.mark.parametrize(
    "relation",
    [
        "x = sqrt(1 + x^2)",
        "x - 3 = hypot(0.01, x - 3)",
        "0.001*x = sqrt(1e-6 + 1e-6*x^2)",
        "x + 5 = sqrt(1 + (x + 5)^2)",
        "sqrt(x^2 + 1) - sqrt(x^2) = 0",
        "1/(1 + x^2) = 0",
    ],
)
def test_a_guess_that_runs_away_is_no_answer(relation, guess, other):
    """No number meets any of these, though all do so at infinity.

    Nor does it with a heavy bystander, or one far from the origin.
    """
    initial = {"x": f"{{guess: {guess}}}"} | ({"z": other} if other else {})
    kinetic = "x_dot^2/2 + 1e9*z_dot^2/2" if other == "1" else ""
    check(judged(scene(relation, initial, kinetic=kinetic)), admissible=False)


@pytest.mark.parametrize(
    "relation", ["exp(x) = exp(x) + exp(-x)", "exp(2*x) - exp(-x) = exp(2*x)"]
)
def test_a_guess_runs_away_by_steps_of_one_length(relation):
    check(judged(scene(relation, {"x": "{guess: 1}"})), admissible=False)


@pytest.mark.parametrize(
    ("relation", "guess", "root"),
    [
        ("x = 1e7", "1", 1e7),
        ("x/1e9 = 3", "1", 3e9),
        ("x = sqrt(1 + x^2) - 1e-3", "1", (1.0 - 1e-6) / 2e-3),
        ("(x - 1)^2 = 0", "2", 1.0),
        ("x*exp(-x) = 0", "0.4", 0.0),
        ("(x + 1e9) - 1e9 = 3", "0", 3.0),
        ("log(x) = 12", "1", 162754.79141900392),
    ],
)
def test_a_root_however_far_is_one(relation, guess, root):
    start = judged(scene(relation, {"x": f"{{guess: {guess}}}"}))
    assert start.admissible
    assert start.state.q[0] == pytest.approx(root, rel=1e-6, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("guess", ["1", "3e4", "1e5", "3e5"])
@pytest.mark.parametrize("least", [Point.LARGE, 1])
def test_a_guess_that_runs_away_from_afar(guess, least, monkeypatch):
    """Few steps lead to values that satisfy the relation by rounding alone.

    The relation has no root. Dense and sparse matrices are used.
    """
    monkeypatch.setattr(Point, "LARGE", least)
    start = judged(scene("x = sqrt(1 + x^2)", {"x": f"{{guess: {guess}}}"}))
    check(start, unsolved="diverges")
    assert "other-roots" not in codes(start)


@pytest.mark.parametrize("speed", [1, 0.5])
@pytest.mark.parametrize("length", ["1e100", "1e160"])
def test_a_relation_may_have_a_length_whose_square_is_no_number(length, speed):
    text = scene(f"(1 - y/{length})*x_dot = 1", {"x": 0, "y": 0, "x_dot": speed})
    assert judged(text).admissible is (speed == 1)
