"""A start is judged the same wherever it stands, however it moves, beside whatever."""

from __future__ import annotations

import math

import pytest

from lagsim.admissibility.point import Point
from tests.admissibility.scenes import PARALLELOGRAM, codes, judged, scene, warning

SHIFTS = [0.0, pytest.param(1e3, marks=pytest.mark.slow), 1e6]


def rod(shift, miss, form="(x2 - x1)^2 + (y2 - y1)^2 = 1", unit=1.0):
    """Give a rod of 1 m, its far end off by `miss` of that."""
    places = {
        "x1": shift * unit,
        "y1": -shift * unit,
        "x2": f"{shift * unit!r} + {(0.6 + miss) * unit!r}",
        "y2": f"{-shift * unit!r} + {0.8 * unit!r}",
    }
    return scene(form, places)


RELATIVE = [
    "(x2 - x1)^2 + (y2 - y1)^2 = 1",
    "hypot(x2 - x1, y2 - y1) = 1",
    "1 - sqrt((x1 - x2)^2 + (y1 - y2)^2) = 0",
]


@pytest.mark.parametrize("form", RELATIVE)
@pytest.mark.parametrize("shift", SHIFTS)
def test_a_rod_is_judged_by_its_length(form, shift):
    assert judged(rod(shift, 0.0, form)).admissible
    rough = judged(rod(shift, 1e-7, form))
    assert rough.admissible
    assert "rough-start" in codes(rough)
    # 0.57 m of 1 m, and what is just past a millionth.
    for miss in (0.57, 1e-2, 1e-5):
        start = judged(rod(shift, miss, form))
        assert not start.admissible
        # The nearest state moves both ends along the rod by half of what it is off.
        off = (math.hypot(0.6 + miss, 0.8) - 1.0) / 2.0
        along = (0.6 + miss) / math.hypot(0.6 + miss, 0.8)
        assert start.repair["x1"] - shift == pytest.approx(off * along, abs=1e-9)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_units_do_not_matter_far_away(shift, unit):
    form = f"(x2 - x1)^2 + (y2 - y1)^2 = {unit!r}^2"
    assert judged(rod(shift, 1e-7, form, unit)).admissible
    assert not judged(rod(shift, 1e-5, form, unit)).admissible


def test_ten_digits_far_away_do_not_make_a_rod():
    # 0.1 mm of 1 m: told, with the nearest state.
    at = {"x1": "1000000.123", "y1": 0, "x2": "1000000.7231", "y2": "0.8"}
    start = judged(scene(RELATIVE[0], at))
    assert not start.admissible
    assert start.verdicts[0].position.why == "1e-06 of the lengths that it relates"
    assert set(start.repair) == {"x1", "y1", "x2", "y2"}


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("miss", [0.0, 0.3])
def test_pins_have_the_lengths_of_what_hangs_on_them(shift, miss):
    text = scene(
        {"pin": f"x = {shift!r}", "rod": "(b - x)^2 + y^2 = 0.01"},
        {"x": shift + miss, "b": f"{shift + miss!r} + 0.06", "y": -0.08},
        kinetic="(1000*x_dot^2 + 0.1*(b_dot^2 + y_dot^2))/2",
    )
    assert judged(text).admissible is (miss == 0.0)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize(
    ("gap", "sound"), [(1.0, True), (1.3, False), (1.00001, False)]
)
def test_a_relation_of_differences_alone(shift, gap, sound):
    at = {"x1": shift, "x2": shift + gap}
    assert judged(scene("x2 - x1 = 1", at)).admissible is sound


@pytest.mark.parametrize("turns", [0, 800, 160_000])
@pytest.mark.parametrize("miss", [0.0, 1e-2])
def test_a_wheel_that_has_turned(turns, miss):
    text = scene(
        {"across": "x = X + l*sin(a)", "down": "y = -l*cos(a)"},
        {"X": 0, "a": f"0.5 + 2*pi*{turns}", "x": f"sin(a) + {miss}", "y": "-cos(a)"},
        parameters="l: 1",
    )
    assert judged(text).admissible is (miss == 0.0)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("angle", ["0", "0.5", "pi"])
def test_ranks_far_away(shift, angle):
    here = judged(linkage(0.0, angle))
    there = judged(linkage(shift, angle))
    assert there.admissible
    singular = angle != "0.5"
    assert there.ranks.rank == 4 - singular
    assert there.ranks.generic_rank == 4
    assert there.ranks.smallest == pytest.approx(here.ranks.smallest, rel=1e-6)
    assert there.ranks.generic_smallest > 1e-3
    assert [d.everywhere for d in there.ranks.dependences] == [False] * singular


def linkage(shift, angle):
    """Give the parallelogram with its pivots at (shift, shift)."""
    at = {"a": angle, "b": "a", "c": "0"}
    at |= {"x": f"{shift!r} + 0.5 + cos(a)", "y": f"{shift!r} + sin(a)"}
    return scene({k: f"{r} + {shift!r}" for k, r in PARALLELOGRAM.items()}, at)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize(
    ("square", "against"), [(2.0, {}), (2.001, {"position": 1e-3})]
)
def test_contradictions_far_away(shift, square, against):
    first = f"(x - {shift!r})^2 + y^2 = 1"
    second = f"2*(x - {shift!r})^2 + 2*y^2 = {square!r}"
    at = {"x": f"{shift!r} + 0.6", "y": 0.8}
    start = judged(scene({"a": first, "b": second}, at))
    assert start.admissible is not bool(against)
    [d] = start.ranks.dependences if not against else start.contradictions
    assert d.contradictions == pytest.approx(against)
    assert d.everywhere or against


@pytest.mark.parametrize("shift", SHIFTS)
def test_other_roots_are_found_far_away(shift):
    rods = {
        "left": f"hypot(x - {shift!r}, y) = 1",
        "right": f"hypot(x - {shift!r} - 1, y) = 1",
    }
    at = {"x": f"{{guess: {shift + 0.3!r}}}", "y": "{guess: 0.2}"}
    start = judged(scene(rods, at))
    assert start.state.q[0] - shift == pytest.approx(0.5, abs=1e-9)
    assert start.state.q[1] == pytest.approx(math.sqrt(0.75), abs=1e-9)
    assert "y = -0.866025" in warning(start, "other-roots")


@pytest.mark.parametrize("mass", [pytest.param(1.0, marks=pytest.mark.slow), 1e30])
@pytest.mark.parametrize("place", [pytest.param(1.0, marks=pytest.mark.slow), 1e11])
def test_a_bystander_changes_nothing(mass, place):
    def beside(x, more):
        at = {"x1": 0, "y1": 0, "x2": x, "y2": 0.8}
        kinetic = "(x1_dot^2 + y1_dot^2 + x2_dot^2 + y2_dot^2)/2"
        if more:
            at["s"], kinetic = place, f"{kinetic} + {mass!r}*s_dot^2/2"
        return judged(scene(RELATIVE[0], at, kinetic=kinetic))

    for x in ("0.6", "0.7", "0.6000001", "{guess: 0.7}", "0.6 + 1e-15"):
        alone, start = beside(x, more=False), beside(x, more=True)
        assert start.admissible is alone.admissible
        assert codes(start) == codes(alone)
        assert start.changes.keys() == alone.changes.keys()
        assert (start.repair or {}) == pytest.approx(alone.repair or {}, abs=1e-12)
        assert start.state.q[:4] == pytest.approx(alone.state.q, abs=1e-14)


# Rates

SKATE = "y_dot*cos(p) = x_dot*sin(p)"
# A car: the rear wheels do not slip sideways, nor the front ones, which are turned.
CAR = {
    "rear": SKATE,
    "front": ("y_dot*cos(p + d) = x_dot*sin(p + d) - l*p_dot*cos(d)"),
    "wheel": "r*w_dot = x_dot*cos(p) + y_dot*sin(p)",
}


@pytest.mark.parametrize("speed", [pytest.param(1.0, marks=pytest.mark.slow), 1e3])
@pytest.mark.parametrize(
    ("miss", "admissible"),
    [(1e-15, True), (1e-14, True), (1e-13, True), (1e-5, False), (-0.3, False)],
)
def test_a_rate_whose_terms_vanish_is_judged_by_the_motion(speed, miss, admissible):
    at = {"x": 0, "y": 0, "p": 0, "x_dot": speed, "y_dot": miss * speed}
    start = judged(scene(SKATE, at))
    assert start.admissible is admissible
    if admissible:
        assert not start.changes or abs(start.state.v[1]) <= abs(miss * speed)
        assert "rough-start" not in codes(start)
    else:
        assert start.repair == pytest.approx({"y_dot": 0.0}, abs=1e-15)
    # Another body that moves fast does not count.
    at = {**at, "s": 0, "s_dot": 1e9 * speed}
    assert judged(scene(SKATE, at)).admissible is admissible


@pytest.mark.parametrize("name", ["y_dot", "p_dot"])
@pytest.mark.parametrize("yaw", ["0", "pi/2", "pi"])
def test_a_car_at_special_yaws(name, yaw):
    def car(miss):
        at = {
            "x": 0, "y": 0, "p": yaw, "d": 0, "w": 0,
            "x_dot": f"2*cos({yaw})", "y_dot": f"2*sin({yaw})", "p_dot": "0",
            "w_dot": 2 / 0.3,
        }  # fmt: skip
        at[name] = f"{at[name]} + {miss!r}"
        return judged(scene(CAR, at, parameters="l: 1.1, r: 0.3"))

    assert car(0.0).admissible
    assert car(1e-14).admissible
    assert not car(1e-3).admissible


@pytest.mark.parametrize("speed", [0.0, 1e3, 2.0**20])  # sums lose 20 bits
@pytest.mark.parametrize(
    ("miss", "admissible"), [(0.0, True), (1e-7, True), (1e-3, False), (0.5, False)]
)
def test_a_rod_that_flies_past(speed, miss, admissible):
    at = {
        "x1": 0, "y1": 0, "x2": 0.6, "y2": 0.8, "x1_dot": speed, "y1_dot": -speed,
        "x2_dot": speed - 0.8 + miss, "y2_dot": -speed + 0.6,
    }  # fmt: skip
    assert judged(scene(RELATIVE[0], at)).admissible is admissible


# Guesses of relations that only rounding satisfies, and of relations with far roots


@pytest.mark.parametrize("other", ["", "m", "far"])
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
    initial = {"x": f"{{guess: {guess}}}"}
    if other:
        initial["z"] = "1e9" if other == "far" else "1"
    kinetic = "x_dot^2/2 + 1e9*z_dot^2/2" if other == "m" else ""
    start = judged(scene(relation, initial, kinetic=kinetic))
    assert not start.admissible


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


@pytest.mark.parametrize("guess", ["1", "3e4", "1e5", "3e5"])
@pytest.mark.parametrize("least", [Point.LARGE, 1])
def test_a_guess_that_runs_away_from_afar(guess, least, monkeypatch):
    """Where few steps lead to what rounding meets; in sparse matrices, too."""
    monkeypatch.setattr(Point, "LARGE", least)
    start = judged(scene("x = sqrt(1 + x^2)", {"x": f"{{guess: {guess}}}"}))
    assert "diverges" in start.unsolved
    assert "other-roots" not in codes(start)
