"""Rest at the first or the last point of a table that ends the run beyond it.

A wall or friction holds a body there against the table's force. Without motion the
forces are known: that of the wall is the table's value, and nothing moves.
"""

import numpy as np
import pytest

import lagsim

POINTS = "[{a}, {f}], [{b}, 0.3], [{c}, -0.2], [{d}, {g}]"
MODEL = """
coordinates: {{x: {{}}, y: {{}}}}
tables: {{push: {{points: [{points}], interpolation: {how}}}}}
energy: {{kinetic: x_dot^2/2 + y_dot^2/2, potential: 0}}
forces: {{x: "push(x){more}", y: "push(x)"}}
constraints: {{{hold}}}
initial: {{x: {x}, y: 0{start}}}
simulation: {{duration: 1, output_step: 0.05}}
"""
ENDS = {"first": -1, "last": 1}  # the direction that leads out of the table
HOLDS = {
    "wall": "w: {relation: %s, restitution: 0.5}",
    "rough wall": "w: {relation: %s, restitution: 0, friction: 0.5, slip: 'x_dot'}",
    "limit": "b: {relation: x_dot = 0, limit: 0.5}",
    "static": "b: {relation: x_dot = 0, limit: {static: 0.5, dynamic: 0.3}}",
    "sign": "",
}


def text(end, hold, force, how="linear", **start):
    """Return the model of a body at an end of a table, where `force` acts outwards."""
    way, knots = ENDS[end], 0.3 + 0.7 * np.arange(4)
    x = knots[-1 if way > 0 else 0]
    f, g = (0.1, way * force) if way > 0 else (way * force, 0.1)
    a, b, c, d = knots.tolist()
    points = POINTS.format(a=a, b=b, c=c, d=d, f=f, g=g)
    relation = f"{float(x)!r} >= x" if way > 0 else f"x >= {float(x)!r}"
    more = " - 0.5*sign(x_dot)" if hold == "sign" else ""
    held = HOLDS[hold] % relation if "wall" in hold else HOLDS[hold]
    given = {"x": repr(float(x)), "start": ""} | start
    return MODEL.format(points=points, how=how, more=more, hold=held, **given), x, way


@pytest.mark.parametrize("how", ["linear", "cubic", "monotone"])
@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("end", ENDS)
def test_a_body_is_held_at_the_end_of_a_table(end, hold, how):
    model, x, way = text(end, hold, 0.4, how)
    result = lagsim.simulate(model, error_bar="never")
    assert result.outcome == "done", result.reason
    assert result["x"] == pytest.approx(np.full(21, x), abs=1e-14)
    # The other coordinate shows the table's value at its end.
    assert result["y"] == pytest.approx(way * 0.2 * result["t"] ** 2, abs=1e-12)


@pytest.mark.parametrize("hold", ["limit", "sign"])
@pytest.mark.parametrize("end", ENDS)
def test_a_force_that_exceeds_friction_ends_the_run_there(end, hold):
    model, x, _ = text(end, hold, 0.6)
    result = lagsim.simulate(model, error_bar="never")
    assert result.outcome == "failed"
    assert f"`push` ends at {x:.9g}" in result.reason


@pytest.mark.parametrize("end", ENDS)
def test_a_body_rebounds_from_a_wall_at_the_end_of_a_table(end):
    # The force is 0 at the end, and w^2 u away from it at a distance u.
    way = ENDS[end]
    model, x, _ = text(end, "wall", 0.0)
    given = f"x: {float(x - way * 0.1)!r}, y: 0, x_dot: {way * 0.2}"
    result = lagsim.simulate(
        model.replace(f"x: {float(x)!r}, y: 0", given), error_bar="never"
    )
    assert result.outcome == "done", result.reason
    t, w = result["t"], np.sqrt(0.3 / 0.7 if way < 0 else 0.2 / 0.7)
    struck = np.arctanh(w * 0.5) / w
    speed = 0.2 * np.cosh(w * struck) - 0.1 * w * np.sinh(w * struck)
    before = 0.1 * np.cosh(w * t) - 0.2 / w * np.sinh(w * t)
    after = 0.5 * speed / w * np.sinh(w * (t - struck))
    expected = np.where(t < struck, before, after)
    assert way * (x - result["x"]) == pytest.approx(expected, abs=1e-11)
