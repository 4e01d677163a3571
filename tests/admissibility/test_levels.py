"""Admissibility in three levels: residuals, bounds, reasons, contradictions."""

from __future__ import annotations

import pytest

from tests.admissibility.scenes import (
    codes,
    judged,
    parallelogram,
    scene,
    slider_crank,
    warning,
)

CURVE = scene(
    {"path": "u = l - l*theta^2"},
    {"theta": "THETA", "u": "U", "theta_dot": "TD", "u_dot": "UD"},
    kinetic="((l + u)^2*theta_dot^2 + u_dot^2)/2",
    potential="9.8*(l - (l + u)*cos(theta)) + 12.8*u^2",
    parameters="l: 1",
)


def curve(theta="1", u="l - l*theta^2", theta_dot="0", u_dot="0"):
    text = CURVE.replace("THETA", theta).replace("TD", theta_dot)
    return text.replace("UD", u_dot).replace("U", u)


def test_velocities_off_the_curve():
    start = judged(curve(theta="0.5", theta_dot="1"))
    [path] = start.verdicts
    assert path.position.satisfied
    assert path.velocity.value == 1.0  # 2 l theta theta' + u'
    assert path.velocity.scale == 1.0
    assert path.velocity.bound == 1e-6
    assert "largest term" in path.velocity.why
    assert not path.satisfied
    # theta' and u' alone change; least change in the metric diag((l + u)^2, 1) along
    # the row (1, 1) of their relation.
    weight = 1.0 / 1.75**2
    moved = 1.0 / (weight + 1.0)
    assert start.repair == pytest.approx(
        {"theta_dot": 1.0 - weight * moved, "u_dot": -moved}, rel=1e-12
    )


def test_a_start_within_the_rounding_of_its_expressions():
    start = judged(scene("x = 0", {"x": "l*cos(pi/2)", "y": 0}, parameters="l: 1e6"))
    [a] = start.verdicts
    assert start.admissible
    assert 0 < abs(a.position.value) < a.position.bound < 1e-8
    assert a.position.why == "the rounding error of the start"
    assert start.state.q[0] == a.position.value  # not moved
    assert not start.warnings
    assert not judged(scene("x = 0", {"x": 1e-10, "y": 0})).admissible


@pytest.mark.parametrize(
    ("relations", "level", "size"),
    [
        ({"a": "x^2 + y^2 = 1", "b": "x^2 + y^2 = 2"}, "position", 1.0),
        ({"a": "x = -1", "b": "x = -1 + t"}, "velocity", 1.0),
        ({"a": "x = -1", "b": "x = -1 + t^2"}, "acceleration", 2.0),
        ({"a": "x_dot = y_dot", "b": "2*x_dot = 2*y_dot + 3"}, "velocity", 3.0),
        ({"a": "x = -1", "b": "x_dot = 1"}, "velocity", 1.0),
    ],
)
def test_contradictory_rows(relations, level, size):
    start = judged(scene(relations, {"x": -1, "y": 0}))
    assert not start.admissible
    [d] = start.contradictions
    assert (d.name, [name for name, _ in d.combination]) == ("b", ["a"])
    assert d.contradictions == pytest.approx({level: size})
    text = f"`b` contradicts `a` on the level of {level}, by {size:g}"
    assert d.contradiction() == text
    assert start.unsolved.startswith(text)
    assert start.repair is None
    assert "multipliers-not-unique" not in codes(start)


def test_rows_that_only_seem_to_contradict_away_from_the_constraints():
    # At x = 2 the second is a quarter of the first in its row, and not in its value.
    start = judged(
        scene({"a": "x^2 + y^2 = 1", "b": "sqrt(x^2 + y^2) = 1"}, {"x": 2, "y": 0})
    )
    assert not start.admissible
    assert not start.contradictions
    assert start.repair == {"x": 1.0}
    [d] = start.ranks.dependences
    assert dict(d.combination) == pytest.approx({"a": 0.5})


def test_a_vanishing_row_that_asks_for_an_acceleration():
    start = judged(scene("x^2 + y^2 = 0", {"x": 0, "y": 0, "x_dot": 3}))
    [d] = start.contradictions
    assert d.contradictions == {"acceleration": 18.0}
    assert "`a` cannot be satisfied on the level of acceleration" in d.contradiction()


def test_velocities_that_belong_to_no_branch():
    # Collinear, the parallelogram may open both ways, but not at rates between.
    assert judged(parallelogram("0")).admissible
    start = judged(parallelogram("0", b_dot="0.5"))
    assert not start.admissible


@pytest.mark.parametrize("at", ["pi/2", "3*pi/2", "-pi/2"])
def test_a_gradient_of_rounding_vanishes(at):
    # At the dead centre the row of `across` is (cos a, cos b, 0): 6e-17.
    start = judged(slider_crank(at))
    assert start.admissible
    assert start.ranks.rank == 1
    assert start.ranks.generic_rank == 2
    [d] = start.ranks.dependences
    assert (d.name, d.combination, d.everywhere) == ("across", (), False)
    assert "only here" in warning(start, "vanishing-gradient")
    assert start.ranks.not_unique == ("across",)
    near = judged(slider_crank(f"{at} + 1e-6"))
    assert near.ranks.rank == 2


def test_a_gradient_that_is_small_but_exact_is_real():
    start = judged(scene("1e-30*x + 1e-31*y = 0", {"x": 0, "y": 0}))
    assert start.ranks.rank == 1
    start = judged(scene("x^2 = 1e-40", {"x": 1e-20, "y": 1}))
    assert start.ranks.rank == 1


def test_typed_digits_of_positions():
    start = judged(curve(theta="0.7", u="0.5100003", theta_dot="1", u_dot="-1.4"))
    assert start.admissible
    text = warning(start, "rough-start")
    assert text == (
        "`path` is off by 3e-07, as if the start had been typed with 6 digits; "
        "write u: l - l*theta^2"
    )
    assert set(start.changes) == {"theta", "u", "theta_dot", "u_dot"}


def test_typed_digits_of_velocities():
    start = judged(curve(theta="0.7", theta_dot="1", u_dot="-1.4000003"))
    text = warning(start, "rough-start")
    assert text == (
        "the rate of `path` is off by 3e-07, as if the start had been typed with 6 "
        "digits; mark theta_dot or u_dot as {guess: ...}"
    )


def test_typed_digits_of_a_start_value():
    text = scene(
        {},
        {"a": "pi/6", "h": "0.8660253"},
        definitions="h: cos(a)",
    )
    start = judged(text)
    assert start.admissible
    assert warning(start, "rough-start").startswith(
        "the start value `h: 0.8660253` is off by 1e-07, as if"
    )


@pytest.mark.parametrize(
    ("initial", "advice"),
    [
        ({"x": 0.3, "y": 0.0900000001}, "write y: k*x^2"),
        ({"y": 0.0900000001, "x": 0.3}, "mark y or x as {guess: ...}"),
    ],
)
def test_advice_that_can_stand_in_the_file(initial, advice):
    start = judged(scene("y = k*x^2", initial, parameters="k: 1"))
    assert warning(start, "rough-start").endswith(advice)


def test_advice_does_not_use_time():
    start = judged(scene("y = x + t", {"x": 0.3, "y": 0.30000001, "y_dot": 1}))
    assert "write" not in warning(start, "rough-start")


@pytest.mark.parametrize("factor", [1e-8, 1.0, 1e8])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e3])
def test_verdicts_depend_on_neither_scale_nor_units(factor, unit):
    def curve_in(u_start, u_rate):
        relation = f"{factor!r}*(u/{unit!r} - 1 + theta^2) = 0"
        return judged(
            scene(
                {"path": relation},
                {
                    "theta": 0.5,
                    "u": u_start * unit,
                    "theta_dot": 1,
                    "u_dot": u_rate * unit,
                },
                kinetic=f"(theta_dot^2 + u_dot^2/{unit!r}^2)/2",
            )
        )

    assert curve_in(0.75, -1.0).admissible
    assert curve_in(0.75 + 2e-7, -1.0).admissible
    assert not curve_in(0.75 + 3e-6, -1.0).admissible
    assert not curve_in(0.75, -1.0 + 3e-6).admissible
    far = curve_in(2.0, 5.0)
    theta, u = far.repair["theta"], far.repair["u"] / unit
    # Least (theta - 1/2)^2 + (u - 2)^2 on u = 1 - theta^2: its gradient vanishes.
    assert u == pytest.approx(1 - theta**2, rel=1e-12)
    assert (theta - 0.5) - 2 * theta * (u - 2) == pytest.approx(0, abs=1e-9)
