"""Conditions that end, and others that become true, at one jump."""

import pytest

import lagsim

MODEL = """
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
modes: {{n: 0}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 10*z^2}}
events:
{events}
initial: {{x: 0.3, x_dot: 0.4, y: 0.1, y_dot: 0.05, z: 1}}
simulation: {{duration: 3, output_step: 0.125, method: {method}}}
"""
# Conditions that end where x reaches 1.
ENDS = (
    "sign(x - 1) <= -0.5", "floor(x) <= 0.5", "if(2*x - 2 > 0, 1, -1) + y <= 0",
    "ceil(1 - x) - y >= 0.5",
)  # fmt: skip
# Conditions that become true there, and conditions that are true there for an instant.
BEGINS = {
    "jumps": (
        "sign(1 - x) <= -0.5", "floor(2 - 2*x) + y <= -0.5",
        "heaviside(x - 1) - y >= 0.3", "floor(0.3*x - 0.3) + y >= 0",
    ),
    "instants": ("mod(x, 1) = 0", "mod(x, 1) + 0.0*y <= 0"),
}  # fmt: skip
METHODS = (
    "auto", "dop853", "dopri5", "taylor", "radau", "rk4, step: 0.1",
    "verlet, step: 0.07",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("ending", ENDS)
@pytest.mark.parametrize("kind", BEGINS)
@pytest.mark.parametrize("is_first", [True, False], ids=["first", "last"])
def test_a_condition_becomes_true_at_the_jump_at_which_another_ends(
    is_first, kind, ending, method
):
    begins = BEGINS[kind]
    events = [ending, *begins] if is_first else [*begins, ending]
    text = "\n".join(
        f"  e{k}: {{at: '{at}', set: {{n: n + 1}}}}" for k, at in enumerate(events)
    )
    result = lagsim.simulate(
        MODEL.format(events=text, method=method), error_bar="never"
    )
    acts = [(e.name, e.time) for e in result.events if e.kind == "event"]
    names = [f"e{k}" for k, at in enumerate(events) if at != ending]
    assert sorted(name for name, _ in acts) == names
    assert [time for _, time in acts] == pytest.approx([1.75] * len(acts), abs=1e-13)


# Conditions that become true where x reaches 1, whose values at the level itself are
# those before it, between both, and after it.
TOGETHER = (
    "floor(1 - x) <= -0.5", "mod(x, 1) + y <= 0.3", "ceil(2*x) + y >= 2.6",
    "sign(3*x - 3) - y >= 0", "if(x > 1, 1, 0) >= 0.5",
)  # fmt: skip


@pytest.mark.parametrize("method", [*METHODS, "rk4, step: 0.125", "verlet, step: 0.25"])
@pytest.mark.parametrize("turns", range(5))
def test_events_of_one_jump_act_in_the_order_of_the_file(turns, method):
    events = [*TOGETHER[turns:], *TOGETHER[:turns]]
    text = "\n".join(
        f"  e{k}: {{at: '{at}', set: {{n: 10*n + {k + 1}}}}}"
        for k, at in enumerate(events)
    )
    model = MODEL.format(events=text, method=method) + "definitions: {seen: n}\n"
    result = lagsim.simulate(model, error_bar="never")
    acts = [(e.name, e.time) for e in result.events if e.kind == "event"]
    assert [name for name, _ in acts] == [f"e{k}" for k in range(5)]
    assert [time for _, time in acts] == pytest.approx([1.75] * 5, abs=1e-12)
    assert result["seen"][-1] == 12345
