"""One-sided constraints with `when`: they are judged while they are in force."""

import numpy as np
import pytest

from lagsim import check, load, simulate
from tests.support import run

# A ball dropped from 5 cm onto a floor that is there for a while (g = 10).
TRAP = """
name: trap
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: 10*y}}
constraints:
  floor: {{relation: y >= 0, restitution: 0, when: {when}}}
initial: {{y: 0.05}}
simulation: {{duration: 1, output_step: 0.1}}
"""


@pytest.mark.parametrize("when", ["t < 0.5", "t < 0.5 and t >= 0", "not (t >= 0.5)"])
def test_a_trapdoor_opens(when):
    found = simulate(TRAP.format(when=when))
    assert not found.warnings
    assert found.error is not None
    t = found["t"]
    expected = np.where(t < 0.1, 0.05 - 5 * t**2, 0.0)
    expected = np.where(t > 0.5, -5 * (t - 0.5) ** 2, expected)
    assert found["y"] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    "method",
    ["method: dop853", pytest.param("method: rk4, step: 0.01", marks=pytest.mark.slow)],
)
def test_a_latch_holds_where_its_event_acted(method):
    # x - z = d goes up to 0.6 and stays there, within rounding; x + z swings on.
    text = f"""
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + z_dot^2)/2, potential: (x + z)^2}}
modes: {{h: 0, n: 0}}
events: {{grab: {{at: x - z >= 0.6, set: {{h: 1, n: n + 1}}}}}}
constraints: {{hook: {{relation: x - z = 0.6, when: h > 0}}}}
initial: {{x: 0.5, x_dot: 1.2, z: 0.5, z_dot: 0}}
simulation: {{duration: 20, output_step: 0.1, {method}}}
"""
    result = simulate(text, error_bar="never")
    t = result.t
    d, s = np.minimum(1.2 * t, 0.6), np.cos(2.0 * t) + 0.6 * np.sin(2.0 * t)
    bound = 1e-9 if "dop853" in method else 1e-5
    assert result["x"] == pytest.approx((s + d) / 2.0, abs=bound)
    assert result["n"][-1] == 1.0
    assert result.record["steps"] < 2100


# Two links hang on a hook until it lets go.
HOOKED = """
coordinates: {{p(1..2): {{components: xy}}}}
energy: {{kinetic: "(dot(p_dot(1), p_dot(1)) + dot(p_dot(2), p_dot(2)))/2",
         potential: "9.81*(p(1).y + p(2).y)"}}
constraints:
  upper: norm(p(1)) = 0.5
  lower: norm(p(2) - p(1)) = 0.5
  hook: {{relation: "{relation} = vec(0, 0)", when: t < 0.5}}
initial: {{p(i = 1..2): {{guess: "vec({guess})"}}}}
simulation: {{duration: 0.6, output_step: 0.01}}
"""


# Newton's method solves p.2.y = 0 to 1e-63 from some of these guesses, and to 0 from
# others: no size of a coordinate is there to compare the residual with.
@pytest.mark.slow
@pytest.mark.parametrize("guess", [
    "0.353*i, -0.398*sin(pi*i/2)",
    "0.330*i, -0.185*sin(pi*i/2)",
    "0.209*i, -0.219*sin(pi*i/2)",
])  # fmt: skip
@pytest.mark.parametrize(
    "relation", ["p(2) - vec(0.6, 0)", "vec(p(2).x - 0.6, tan(p(2).y))"]
)
def test_a_relation_that_guesses_satisfy_by_rounding_holds_from_the_start(
    relation, guess
):
    model = load(HOOKED.format(relation=relation, guess=guess))
    assert check(model).admissible
    found = simulate(model, error_bar="never")
    held = found["t"] <= 0.5
    # The rounding of a projection onto links of 0.5.
    assert found["p.2.x"][held] == pytest.approx(0.6, abs=1e-15)
    assert found["p.2.y"][held] == pytest.approx(0.0, abs=1e-15)
    assert found["p.2.y"][-1] < -0.01


@pytest.mark.parametrize("relation", ["x >= 0", "x_dot >= 0"])
def test_a_gap_passes_0_while_its_condition_is_false(relation):
    """It ends no arc, however often it does; in force the constraint holds."""
    law = "restitution: 0, " if relation == "x >= 0" else ""
    text = f"""
modes: {{on: 0}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: x^2/2}}
events: {{catch: {{at: y >= 30.3, set: {{on: 1}}}}}}
constraints: {{floor: {{relation: {relation}, {law}when: on > 0}}}}
initial: {{x: 1, y: 0, y_dot: 1}}
simulation: {{duration: 40, output_step: 0.5}}
"""
    found = run(text, error_bar="never").trajectory
    # x = cos(t) is 0 ten times before; at 30.3 it rises to 1 at 10 pi, where a ratchet
    # holds it, and falls onto the floor.
    assert found.statistics.arcs < 6
    x = simulate(text, error_bar="never")
    before = x.t < 30
    assert x["x"][before] == pytest.approx(np.cos(x.t[before]), abs=1e-9)
    end = 0.0 if relation == "x >= 0" else 1.0
    assert x["x"][-1] == pytest.approx(end, abs=1e-9)
