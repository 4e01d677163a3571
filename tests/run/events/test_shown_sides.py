"""Steps of arguments that equalities hold at the step, or that leave it slowly."""

import pytest

import lagsim

MODEL = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
forces: {{x: "{fx}", y: "{fy}"}}
modes: {{n: 0}}
constraints: {{{rows}}}
events: {{e: {{at: "{at}", set: {{n: n + 1}}}}}}
initial: {{{start}}}
simulation: {{duration: {duration}, output_step: 0.05{method}}}
"""
# A relation, an expression that it keeps at 0, and a start.
LINE = "x - {far} = 0.3*(y - 7)", "10*(x - {far}) - 3*(y - 7)"
HELD = {
    "line": (*LINE, "x: {far}, y: 7, x_dot: 0.3, y_dot: 1"),
    "rates": (LINE[0], "10*x_dot - 3*y_dot", "x: {far}, y: 7, x_dot: 0.3, y_dot: 1"),
    "circle": ("x^2 + y^2 = 1", "x^2 + y^2 - 1", "x: 1, y: 0, x_dot: 0, y_dot: 0.5"),
    "distance": (
        "(x - {far})^2 + (y + 30)^2 = 1", "hypot(x - {far}, y + 30) - 1",
        "x: 1 + {far}, y: -30, x_dot: 0, y_dot: 0.5",
    ),
    "circle's rate": (
        "x^2 + y^2 = 1", "x*x_dot + y*y_dot", "x: 1, y: 0, x_dot: 0, y_dot: 0.5",
    ),
    "prescribed": (
        "x + y^3 = 0.7*sin(1.3*t)", "3*(x + y^3) - 2.1*sin(1.3*t)",
        "x: 0, y: 0, x_dot: 0.91, y_dot: 0",
    ),
    "of rates": (
        "x_dot = 0.3*y_dot*(1 + y)", "10*x_dot - 3*y_dot*(1 + y)",
        "x: 0, y: 0, x_dot: 0.3, y_dot: 1",
    ),
}  # fmt: skip
# Steps at 0: none of these conditions is true at the level, or becomes true.
STEPS = (
    "sign({u}) >= 0.5", "sign({u}) <= -0.5", "heaviside({u}) <= 0.5",
    "if({u} > 0, 1, 0) >= 0.5", "if({u} < 0, 1, 0) + floor({u}) >= 0.5",
)  # fmt: skip


def acts(fx, fy, rows, at, start, *, duration=0.5, method=""):
    found = lagsim.simulate(
        MODEL.format(
            fx=fx, fy=fy, rows=rows, at=at, start=start, duration=duration,
            method=method and f", method: {method}",
        ),
        error_bar="never",
    )  # fmt: skip
    return [e.time for e in found.events if e.kind == "event"]


@pytest.mark.slow
@pytest.mark.parametrize("when", ["", ", when: t >= -1"], ids=["always", "when"])
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("held", HELD)
def test_no_step_of_a_held_expression_acts(held, step, when):
    relation, u, start = (x.format(far=3) for x in HELD[held])
    row = f"g: {{relation: {relation}{when}}}"
    assert acts("-0.3*sin(t)", "cos(t)", row, step.format(u=u), start) == []


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dopri5", "rk4, step: 0.01"])
@pytest.mark.parametrize("held", ["line", "distance"])
def test_no_step_of_a_held_expression_acts_far_from_the_origin(held, method):
    relation, u, start = (x.format(far=1e5) for x in HELD[held])
    row, at = f"g: {{relation: {relation}}}", f"sign({u}) >= 0.5"
    found = acts("-0.3*sin(t)", "cos(t)", row, at, start, method=method)
    assert found == []


@pytest.mark.slow
@pytest.mark.parametrize("begin", [0.0, 0.7])
@pytest.mark.parametrize("power", [1, 2, 5])
@pytest.mark.parametrize(
    "method", ["taylor", "dopri5", "radau", "rk4, step: 0.01", "verlet, step: 0.01"]
)
def test_a_step_acts_where_a_body_leaves_it_as_a_power_of_the_time(
    method, power, begin
):
    force = f"if(t > {begin}, (t - {begin})^{power}, 0)"
    for at in ("sign(x_dot) >= 0.5", "sign(x - 3) >= 0.5", "if(x > 3, 1, 0) >= 0.5"):
        start = "x: 3, y: 1, x_dot: 0, y_dot: 0"
        found = acts(force, "-y", "", at, start, duration=1.0, method=method)
        assert found == pytest.approx([begin], abs=2e-9), at
    assert acts(force, "-y", "", "sign(x_dot) <= -0.5", start, method=method) == []


def test_a_combination_that_a_constraint_releases_leaves_its_step():
    # From t = 0.2 on the force 1 moves x alone: 10 x - 3 y grows.
    row = "g: {relation: x - 3 = 0.3*(y - 7), when: t < 0.2}"
    at, start = "sign(10*(x - 3) - 3*(y - 7)) >= 0.5", "x: 3, y: 7, x_dot: 0, y_dot: 0"
    assert acts("1", "0", row, at, start) == pytest.approx([0.2], abs=1e-9)
    assert acts("-1", "0", row, at, start) == []


# Forces that begin at t = 0.75 with the fourth act, the first of which is at 0.
PUSHES = {
    "force": ("n*(n - 1)*(n - 2)*(n - 3)", ""),
    "force of t": ("n*(n - 1)*(n - 2)*(n - 3)*(t - 0.75)^3", ""),
    "force by a state": ("s", "states: {s: {rate: n*(n - 1)*(n - 2)*(n - 3)}}"),
}


@pytest.mark.parametrize("argument", ["x", "x_dot"])
@pytest.mark.parametrize("push", PUSHES)
def test_a_body_at_rest_acts_at_the_instant_of_its_push(push, argument):
    force, states = PUSHES[push]
    found = lagsim.simulate(
        f"""
coordinates: {{x: {{}}}}
{states}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: "{force}"}}
modes: {{n: 0, k: 0}}
events:
  e: {{at: "sign({argument}) >= 0.5", set: {{k: k + 1}}}}
  c: {{every: 0.25, set: {{n: n + 1}}}}
initial: {{x: 0, x_dot: 0{", s: 0" if states else ""}}}
simulation: {{duration: 1.4, output_step: 0.05}}
""",
        error_bar="never",
    )
    assert [e.time for e in found.events if e.name == "e"] == [0.75]


@pytest.mark.parametrize("method", ["auto", "dop853", "rk4"])
@pytest.mark.parametrize("shift", [0.0, 7.0])
@pytest.mark.parametrize("rate", [0.7, -0.7])
@pytest.mark.parametrize(
    ("condition", "low", "high"),
    [
        ("sign(mod(X, 2) - 1) >= 0.5", 1, 2),
        ("sign(mod(X, 2) - 1) <= -0.5", 0, 1),
        ("if(mod(X, 2) > 1, 1, -1) >= 0.5", 1, 2),
        ("abs(mod(X, 2) - 1) - sign(mod(X, 2) - 1) <= 0", 1, 2),
        ("floor(2*mod(-X/4, 0.5)) + floor(mod(-X, 2)) <= 0.5", 1, 2),
    ],
)
def test_steps_of_steps_have_the_side_past_the_inner_step(
    condition, low, high, rate, shift, method
):
    # True while mod(x, 2) is between low and high: a falling x enters at high.
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
modes: {{n: 0}}
events: {{e: {{at: "{condition.replace("X", f"(x - {shift})")}", set: {{n: n + 1}}}}}}
initial: {{x: {shift} - 1.1, x_dot: {rate}}}
simulation: {{duration: 9, output_step: 0.1}}
"""
    fixed = {"step": 0.1} if method == "rk4" else {}
    result = lagsim.simulate(text, error_bar="never", method=method, **fixed)
    enters = low if rate > 0 else high
    times = [(enters + 2 * k + 1.1) / rate for k in range(-9, 9)]
    expected = sorted(t for t in times if 0 < t < 9)
    found = [e.time for e in result.events if e.kind == "event"]
    assert found == pytest.approx(expected, abs=1e-11)
