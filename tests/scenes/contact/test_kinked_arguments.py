"""Kinks in velocity relations, products with a kink, and tables of kinked arguments."""

import numpy as np
import pytest
import yaml

from tests.support import simulate

G = 9.81
TABLE = {"points": [[-2, 2], [0, 0], [1, 0.25], [3, 2]], "interpolation": "linear"}


def bead(relation, initial, *, potential="0", duration=2):
    """Simulate a unit mass in the plane with one relation."""
    model = {
        "coordinates": {"x": {}, "y": {}},
        "energy": {"kinetic": "(x_dot^2 + y_dot^2)/2", "potential": potential},
        "constraints": {"c": relation},
        "initial": {"x": 0, "y": 0} | initial,
        "simulation": {"duration": duration, "output_step": 0.25},
    }
    if "tl(" in relation:
        model["tables"] = {"tl": TABLE}
    found = simulate(yaml.safe_dump(model, sort_keys=False))
    assert found.outcome == "done"
    return found


def arc(y):
    """Integrate sqrt(1 + y^2) from 0 to y."""
    return (y * np.sqrt(1 + y * y) + np.arcsinh(y)) / 2


def test_a_rate_by_the_absolute_value_of_a_position():
    found = bead("x_dot = abs(y)*0.5", {"x_dot": 0.5, "y": 1, "y_dot": -1})
    assert found["x"][-1] == pytest.approx(0.5, abs=1e-10)  # y = 1 - t


@pytest.mark.parametrize("slope", ["abs(y)", "max(0, y)", "tl(y)"])
def test_a_kinked_slope_of_a_velocity_relation_keeps_the_energy(slope):
    # x' = s(y) y': the length sqrt(1 + s^2) dy is passed at a constant speed.
    s = {"abs(y)": (1, 1), "max(0, y)": (1, 0), "tl(y)": (0.25, 1)}[slope]
    start = {"y": 1, "y_dot": -1, "x_dot": -s[0]}
    found = bead(f"x_dot = {slope}*y_dot", start)
    speed = np.sqrt(1 + s[0] ** 2)

    def length(y):
        k = s[0] if y > 0 else s[1]
        return arc(k * y) / k if k else y

    for t, y in zip(found.t, found["y"], strict=True):
        assert length(1.0) - length(y) == pytest.approx(speed * t, abs=1e-9)


@pytest.mark.parametrize(
    ("rate", "x", "y"), [("abs(y_dot)", 1.25, 0.75), ("max(0, y_dot)", 1.0, 0.5)]
)
def test_a_kink_in_a_velocity_is_passed_at_rest(rate, x, y):
    # y'' = -1/2 up to t = 2; then -1/2 where x' = |y'|, -1 where x' = 0.
    start = {"x_dot": 1, "y_dot": 1}
    found = bead(f"x_dot = {rate}", start, potential="y", duration=3)
    assert found["x"][-1] == pytest.approx(x, abs=1e-9)
    assert found["y"][-1] == pytest.approx(y, abs=1e-9)


def test_a_rate_whose_slope_jumps_acts_as_an_inelastic_impact():
    # (-1, -1) is projected onto (1, -1).
    found = bead("x_dot = sign(y)*y_dot", {"x_dot": -1, "y": 1, "y_dot": -1})
    assert found["x"][-1] == pytest.approx(-1.0, abs=1e-10)
    assert found["energy"][-1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "curve", ["0.5*abs(x)*cos(x)", "0.5*abs(x)*(1 + x)", "0.5*abs(x)*exp(x)"]
)
def test_a_product_with_a_kink_is_its_pieces(curve):
    start = {"x": -0.5, "x_dot": 1.5, "y": {"guess": 0.2}, "y_dot": {"guess": 0}}
    found = bead(f"y = {curve}", start, potential="9.81*y", duration=0.5)
    before, after = found["energy"][0], found["energy"][-1]
    # Slopes -1/2 and 1/2 in the corner, which is at y = 0: speed times 0.6.
    assert after == pytest.approx(0.36 * before, rel=1e-9)
    assert [e.time for e in found.events if e.kind == "corner"]


@pytest.mark.slow
def test_a_table_of_a_kinked_argument_is_its_pieces():
    start = {"x": -1.5, "x_dot": 3, "y": {"guess": 0.2}, "y_dot": {"guess": 0}}
    found = bead("y = tl(abs(x))", start, potential="9.81*y")
    # Straight pieces: exact between corners, projected in each.
    pieces = [(-9, -1, -0.875), (-1, 0, -0.25), (0, 1, 0.25), (1, 9, 0.875)]
    t, x, v, k = 0.0, -1.5, 3.0, 0
    while True:
        low, high, s = pieces[k]
        a = -G * s / (1 + s * s)
        roots = [(r.real, e) for e in (low, high) for r in np.roots([a / 2, v, x - e])
                 if abs(r.imag) < 1e-12 and r.real > 1e-9]  # fmt: skip
        span, end = min(roots)
        if t + span > 2:
            break
        t, x, v, k = t + span, end, v + a * span, k + (1 if end == high else -1)
        after = pieces[k][2]
        v *= (1 + s * after) / (1 + after**2)
    x += v * (2 - t) + a * (2 - t) ** 2 / 2
    assert found["x"][-1] == pytest.approx(x, abs=1e-9)
