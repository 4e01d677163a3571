"""Steps of coordinates that are prescribed by t alone, at their levels to rounding."""

import pytest

import lagsim

# The prescribed coordinate, k times it as another expression of t, x and its rate at 0.
DRIVES = {
    "sine": ("0.7*sin(1.3*t)", "2.1*sin(1.3*t)", 3, 0, 0.91),
    "exponential": ("0.1*exp(-0.7*t)", "0.3*exp(-0.7*t)", 3, 0.1, -0.07),
    "root": ("1.1*sqrt(1 + 2*t)", "7.7*sqrt(1 + 2*t)", 7, 1.1, 1.1),
    "product": ("-0.3*sin(2*t)*cos(t)", "0.66*cos(t)*sin(2*t)", -2.2, 0, -0.6),
}
# Forces, their values where U is 0, and conditions that are false or true for ever.
FORCES = {
    "2*sign(U)": 0, "floor(1 + U)": 1, "if(U > 0, 2, 0)": 0, "if(U >= 0, 3, 0)": 3,
    "if(U < 0, 2, 1)": 1, "heaviside(U)": 1, "ceil(U)": 0, "abs(sign(U))": 0,
}  # fmt: skip
CONDITIONS = (
    "sign(U) <= -0.5", "sign(U) >= 0.5", "abs(sign(U)) >= 0.5", "floor(U) <= -0.5",
    "ceil(U) >= 0.5", "if(U > 0, 1, 0) >= 0.5", "if(U >= 0, 1, 0) <= 0.5",
    "sign(U)*(1 + y^2) >= 0.3", "floor(1.5*U + 2) <= 1.5",
)  # fmt: skip


def run(drive, force, conditions, method):
    x, same, k, x0, v0 = DRIVES[drive]
    u = f"({k}*x - {same})".replace("*x - -", "*x + ")
    events = "".join(
        f"  e{i}: {{at: '{text.replace('U', u)}', set: {{n: n + 1}}}}\n"
        for i, text in enumerate(conditions)
    )
    fixed = ", step: 0.02" if method == "rk4" else ""
    return lagsim.simulate(
        lagsim.load(
            "coordinates: {x: {}, y: {}}\nmodes: {n: 0}\n"
            "energy: {kinetic: x_dot^2/2 + y_dot^2/2, potential: 0}\n"
            f"constraints: {{drive: 'x = {x}'}}\n"
            f"forces: {{y: '{force.replace('U', u)}'}}\n"
            f"events:\n{events}"
            f"initial: {{x: {x0}, x_dot: {v0}, y: 0, y_dot: 1}}\n"
            f"simulation: {{duration: 2, output_step: 0.1, method: {method}{fixed}}}\n"
        ),
        error_bar="never",
    )


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("force", FORCES)
def test_a_force_has_the_value_at_the_level_of_a_driven_step(drive, force):
    result = run(drive, force, ["y >= 1e9"], "auto")
    assert result["y"][-1] == pytest.approx(2 + 2 * FORCES[force], abs=1e-9)
    assert result.events == ()


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("method", ["auto", "radau", "dop853", "rk4"])
def test_no_condition_on_a_driven_step_acts_by_rounding(drive, method):
    result = run(drive, "2*sign(U)", CONDITIONS, method)
    assert result.events == ()
    assert result["y"][-1] == pytest.approx(2, abs=1e-9)


@pytest.mark.parametrize(
    "method", ["auto", pytest.param("dopri5", marks=pytest.mark.slow)]
)
def test_a_driven_step_acts_where_its_argument_leaves_the_level(method):
    text = """\
coordinates: {x: {}, y: {}}
modes: {n: 0}
energy: {kinetic: x_dot^2/2 + y_dot^2/2, potential: 0}
constraints: {drive: "x = 0.7*sin(1.3*t)"}
forces: {y: "sign(3*x - 2.1*sin(1.3*t) + max(t - 1, 0))"}
events: {e: {at: "sign(3*x - 2.1*sin(1.3*t) + max(t - 1, 0)) >= 0.5", set: {n: 1}}}
initial: {x: 0, x_dot: 0.91, y: 0, y_dot: 0}
simulation: {duration: 2, output_step: 0.1, method: METHOD}
"""
    result = lagsim.simulate(text.replace("METHOD", method), error_bar="never")
    (act,) = [e for e in result.events if e.kind == "event"]
    assert act.time == pytest.approx(1, abs=1e-12)
    assert result["y"][-1] == pytest.approx(0.5, abs=1e-9)
