"""A start is judged the same wherever it stands, however it moves, beside whatever."""

from __future__ import annotations

import math

import pytest

from tests.admissibility.scenes import PARALLELOGRAM, codes, judged, scene, warning

SHIFTS = [0.0, pytest.param(1e3, marks=pytest.mark.slow), 1e6]
FAR = 2.0**20  # sums with it lose 20 bits


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
    text = scene(
        RELATIVE[0],
        {"x1": "1000000.123", "y1": 0, "x2": "1000000.7231", "y2": "0.8"},
    )
    start = judged(text)
    assert not start.admissible
    [a] = start.verdicts
    assert a.position.why == "1e-06 of the lengths that it relates"
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
def test_a_relation_of_differences_alone(shift):
    def apart(gap):
        return judged(scene("x2 - x1 = 1", {"x1": shift, "x2": shift + gap}))

    assert apart(1.0).admissible
    assert not apart(1.3).admissible
    assert not apart(1.00001).admissible


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
    relations = {k: f"{r} + {shift!r}" for k, r in PARALLELOGRAM.items()}
    return scene(
        relations,
        {
            "a": angle,
            "b": "a",
            "c": "0",
            "x": f"{shift!r} + 0.5 + cos(a)",
            "y": f"{shift!r} + sin(a)",
        },
    )


@pytest.mark.parametrize("shift", SHIFTS)
def test_contradictions_far_away(shift):
    def twice(square):
        first = f"(x - {shift!r})^2 + y^2 = 1"
        second = f"2*(x - {shift!r})^2 + 2*y^2 = {square!r}"
        at = {"x": f"{shift!r} + 0.6", "y": 0.8}
        return judged(scene({"a": first, "b": second}, at))

    start = twice(2.0)
    assert start.admissible
    assert [d.everywhere for d in start.ranks.dependences] == [True]
    start = twice(2.001)
    assert not start.admissible
    [d] = start.contradictions
    assert d.contradictions == pytest.approx({"position": 1e-3})


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


def moving_rod(speed, miss):
    return scene(
        RELATIVE[0],
        {
            "x1": 0, "y1": 0, "x2": 0.6, "y2": 0.8,
            "x1_dot": speed, "y1_dot": -speed,
            "x2_dot": speed - 0.8 + miss, "y2_dot": -speed + 0.6,
        },
    )  # fmt: skip


@pytest.mark.parametrize("speed", [0.0, 1e3, FAR])
def test_a_rod_that_flies_past(speed):
    assert judged(moving_rod(speed, 0.0)).admissible
    assert judged(moving_rod(speed, 1e-7)).admissible
    assert not judged(moving_rod(speed, 1e-3)).admissible
    assert not judged(moving_rod(speed, 0.5)).admissible
