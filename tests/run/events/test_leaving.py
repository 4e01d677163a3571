"""Values that leave 0 from rest like a power of the time, with each method.

The first steps have errors larger than the motion: no condition, section, side of a
switch or direction of a slip may change by them. A motion that returns to 0 does.
"""

import pytest

import lagsim

FIXED = (
    "euler", "verlet", "rattle", "rk4", "midpoint", "gauss4", "kahan-li6", "kahan-li8",
    "generalized-alpha", "moreau",
)  # fmt: skip
METHODS = (*FIXED, "radau", "dop853", "dopri5", "taylor")
CONDITIONS = ("d = 0", "d <= 0", "d >= 0", "x_dot = 0", "x_dot <= 0", "x_dot >= 0")
MODEL = """
parameters: {{far: {far}}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: {m}*(x_dot^2 + y_dot^2)/2, potential: 0}}
forces: {{x: "{m}*({force})", y: {m}}}
{laws}
initial: {{x: far + {x}, x_dot: {v}, y: 0, y_dot: 0}}
modes: {{n: 0, on: 0}}
definitions: {{d: x - far}}
events:
{events}
simulation: {{duration: {duration}, output_step: 0.5, method: {method}}}
output: {{sections: {{place: {{at: d = 0, direction: both}},
                     rate: {{at: x_dot = 0, direction: both}}}}}}
"""
BEGIN = 1.25


def run(method, force, *, step=0.1, **other):
    """Return the times of located events and of crossings, and the result."""
    given = {"far": 0.0, "m": 1.0, "laws": "", "x": 0.0, "v": 0.0, "duration": 3.0}
    given |= other
    events = [
        f"  e{k}: {{at: {at}, set: {{n: n + 1}}}}" for k, at in enumerate(CONDITIONS)
    ]
    events += [f"  begin: {{at: y >= {BEGIN**2 / 2}, set: {{on: 1}}}}"]
    if method in FIXED:
        method += f", step: {step}"
    text = MODEL.format(force=force, method=method, events="\n".join(events), **given)
    found = lagsim.simulate(text, error_bar="never")
    acts = [(x.name, x.time) for x in found.events if x.kind == "event"]
    acts = [x for x in acts if x[0] != "begin"]
    crossed = [(k, float(t)) for k, x in found.sections.items() for t in x["t"]]
    return acts, crossed, found


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("force", ["t", "-t^2", "t^3", "t^6"])
def test_a_motion_that_leaves_0_crosses_nothing(force, method):
    assert run(method, force)[:2] == ([], [])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("other", [{"far": 1e3}, {"m": 1e-3}])
def test_far_from_the_origin_and_in_other_units(other, method):
    assert run(method, "t^2", **other)[:2] == ([], [])


LATER = {
    "set": "{sign}*on*max(t - 1.25, 0)^{n}",
    "break": "if(t < 1.25, 0, {sign}*(t - 1.25)^{n})",
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize(("kind", "sign"), [("set", 1), ("break", -1)])
def test_at_a_later_instant(kind, sign, n, method):
    force = LATER[kind].format(sign=sign, n=n)
    assert run(method, force)[:2] == ([], [])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rattle", "rk4", "dop853", "dopri5"])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_off_a_wall_at_which_a_body_rests(n, method):
    """The value x falls to 0 at the wall, and rises off it: `x >= 0` becomes true."""
    acts, crossed, _ = run(
        method, f"if(t < 1.25, -2, (t - 1.25)^{n})", x=0.5,
        laws="constraints: {wall: {relation: x >= far, restitution: 0}}",
    )  # fmt: skip
    late = [name for name, time in acts if time > BEGIN - 1e-6]
    assert late in ([], ["e2"])
    assert [x for x in crossed if x[1] > BEGIN - 1e-6] == []


@pytest.mark.slow
@pytest.mark.parametrize("method", ["euler", "rattle", "rk4", "dop853", "dopri5"])
@pytest.mark.parametrize("n", [1, 2, 3, 5])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_block_at_rest_slips_once(sign, n, method):
    _, _, found = run(
        method, f"{sign}*if(t < 1.25, 0, 1 + (t - 1.25)^{n})", v=1.0,
        laws="constraints: {rub: {relation: x_dot = 0, limit: 1}}",
    )  # fmt: skip
    kinds = [x.kind for x in found.events if x.kind in {"stick", "slip"}]
    assert kinds == ["stick", "slip"]


@pytest.mark.slow
@pytest.mark.parametrize("method", [x for x in METHODS if x not in {"euler", "moreau"}])
def test_a_motion_that_returns_to_0_crosses_it(method):
    """The position is t^3 - t^4: it is 0 at 1, and its rate is 0 at 3/4."""
    acts, crossed, _ = run(method, "6*t - 12*t^2", step=0.01, duration=2.0)
    turns, returns = [0.75] * 2, [1.0] * 2
    assert [x for x, _ in acts] == ["e3", "e4", "e0", "e1"]
    assert [t for _, t in acts] == pytest.approx([*turns, *returns], abs=1e-3)
    assert crossed == [
        ("place", pytest.approx(1.0, abs=1e-3)),
        ("rate", pytest.approx(0.75, abs=1e-3)),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("method", [x for x in METHODS if x != "moreau"])
@pytest.mark.parametrize("force", ["t - abs(x)/9", "t^2 - if(x < 0, 5, 0)"])
def test_a_switch_at_the_place_of_rest_stays_on_its_side(force, method):
    _, _, found = run(method, force)
    assert [x.kind for x in found.events if x.kind == "switch"] == []


STEPS = {  # each condition, and the sign of the force that makes it true
    "sign(x_dot) >= 0.5": 1, "if(x_dot > 0, 1, 0) >= 0.5": 1, "sign(x_dot) <= -0.5": -1,
    "if(x_dot < 0, 1, 0) >= 0.5": -1, "if(x_dot >= 0, 1, 0) <= 0.5": -1,
}  # fmt: skip
RELEASED = """
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: "{sign}*max(t - 1.25, 0)^{n}"}}
constraints: {{rub: {{relation: x_dot = 0, limit: 0.5, when: t < 1.25}}}}
initial: {{x: 0, x_dot: 0}}
modes: {{m: 0}}
events:
{events}
simulation: {{duration: 2, output_step: 0.5, method: {method}}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rattle", "rk4", "moreau", "dop853", "dopri5"])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 12])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_released_slip_has_the_sign_of_its_force(sign, n, method):
    events = "\n".join(
        f'  e{k}: {{at: "{at}", set: {{m: m + 1}}}}' for k, at in enumerate(STEPS)
    )
    if method in FIXED:
        method += ", step: 0.05"
    found = lagsim.simulate(
        RELEASED.format(sign=sign, n=n, method=method, events=events),
        error_bar="never",
    )
    acts = [(x.name, x.time) for x in found.events if x.kind == "event"]
    right = [f"e{k}" for k, way in enumerate(STEPS.values()) if way == sign]
    assert acts == [(name, 1.25) for name in right]


# Conditions at places and rates below the error of the first step: true for a force > 0
# never, for a force < 0 once.
TINY = ("x <= -1e-30", "x_dot <= -1e-20", "x = -1e-25", "x >= -1e-30")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("force", ["1", "t", "t^2", "t^5", "t^12", "-t^2", "-1"])
def test_levels_below_the_error_of_a_step(force, method):
    events = "\n".join(
        f"  e{k}: {{at: {at}, set: {{n: n + 1}}}}" for k, at in enumerate(TINY)
    )
    if method in FIXED:
        method += ", step: 0.1"
    found = lagsim.simulate(
        MODEL.format(
            far=0.0, m=1.0, laws="", x=0.0, v=0.0, duration=2.0, force=force,
            method=method, events=events,
        ),
        error_bar="never",
    )  # fmt: skip
    acts = {x.name: x.time for x in found.events if x.kind == "event"}
    right = {"e0", "e1", "e2"} if force.startswith("-") else set()
    assert acts.keys() == right
    assert found["n"][-1] == len(right)
    assert all(time <= 0.11 for time in acts.values())


# An instant within the first or the second step, by a condition of t alone; or that at
# which the side of a step is selected anew. It decides nothing about small values.
INSTANTS = {
    "set": "{at: t >= late, set: {on: 1}}",
    "step": "{at: sign(x) <= -0.5, set: {on: 1}}",
    "steps": "{at: sign(x) + on >= 1, set: {on: 1}}",
}  # fmt: skip


@pytest.mark.parametrize("method", [x for x in FIXED if x != "moreau"])
@pytest.mark.parametrize("force", ["t", "t^2", "7*t^3", "-t^2", "-1"])
@pytest.mark.parametrize("late", [0.03, 0.07, 0.13])
@pytest.mark.parametrize("other", INSTANTS)
def test_an_instant_makes_no_small_value_true(other, late, force, method):
    events = "\n".join(
        f"  e{k}: {{at: {at}, set: {{n: n + 1}}}}" for k, at in enumerate(TINY[:3])
    )
    found = lagsim.simulate(
        MODEL.replace("on: 0}}", f"on: 0, late: {late}}}}}").format(
            far=0.0, m=1.0, laws="", x=0.0, v=0.0, duration=1.0, force=force,
            method=f"{method}, step: 0.1",
            events=f"{events}\n  other: {INSTANTS[other]}",
        ),
        error_bar="never",
    )  # fmt: skip
    acts = [x.name for x in found.events if x.kind == "event" and x.name != "other"]
    assert sorted(acts) == (["e0", "e1", "e2"] if force.startswith("-") else [])


# Conditions that the act of an event makes nearly true or false, and the sign of the
# motion x(t) that makes them true from then on; 0 if none does.
JUMPS = {
    "x + on >= 1": 1, "x*(1 + y) + on^2 - 1 >= 0": 1, "x + on = 1": 1,
    "2*x - on <= -1": -1, "on - x >= 1": -1, "x + on <= 1": 0,
}  # fmt: skip


@pytest.mark.parametrize("method", [x for x in FIXED if x not in {"euler", "moreau"}])
@pytest.mark.parametrize("force", ["t^2", "7*t^3", "-t^2", "-3*t"])
@pytest.mark.parametrize("late", [0.05, 0.1, 0.13])
@pytest.mark.parametrize("is_first", [True, False], ids=["first", "last"])
def test_an_act_makes_no_small_value_true(is_first, late, force, method):
    acts = [f"  e{k}: {{at: {at}, set: {{n: n + 1}}}}" for k, at in enumerate(JUMPS)]
    acts.insert(
        0 if is_first else len(JUMPS),
        f"  other: {{at: 2*y >= {late}^2, set: {{on: 1}}}}",
    )
    found = lagsim.simulate(
        MODEL.format(
            far=0.0, m=1.0, laws="", x=0.0, v=0.0, duration=1.0, force=force,
            method=f"{method}, step: 0.1", events="\n".join(acts),
        ),
        error_bar="never",
    )  # fmt: skip
    found = [x for x in found.events if x.kind == "event" and x.name != "other"]
    sign = -1 if force.startswith("-") else 1
    names = [f"e{k}" for k, way in enumerate(JUMPS.values()) if way == sign]
    assert sorted(x.name for x in found) == names
    assert [x.time for x in found] == pytest.approx([late] * len(names), abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rattle", "rk4", "dop853", "dopri5"])
@pytest.mark.parametrize("n", [1, 3, 5, 12])
@pytest.mark.parametrize("v", [0.5, 0.3, 0.7 / 3])
@pytest.mark.parametrize("rate", [True, False])
def test_a_place_at_which_friction_stops_is_met_once(rate, v, n, method):
    """The block reaches d = 0 as its rate vanishes, to rounding, and goes on later."""
    events = "  place: {at: d = 0, set: {n: n + 1}}\n"
    events += "  rate: {at: x_dot = 0, set: {n: n + 1}}\n" * rate
    if method in FIXED:
        method += ", step: 0.1"
    found = lagsim.simulate(
        MODEL.format(
            far=0.0, m=1.0, x=-v * v, v=v, duration=3.0, method=method, events=events,
            force=f"if(t < 1.25, 0, 0.5 + (t - 1.25)^{n})",
            laws="constraints: {rub: {relation: x_dot = 0, limit: 0.5}}",
        ),
        error_bar="never",
    )  # fmt: skip
    acts = [x.name for x in found.events if x.kind == "event"]
    assert sorted(acts) == ["place"] + ["rate"] * rate


# Steps of a body at rest beside a mode, a switch of t, and t itself: each becomes true
# once, at a time that has nothing to do with the body.
AT_REST = {
    "t >= late": 0.33, "sign(x) + on >= 1": 0.33, "x + on >= 1": 0.33,
    "sign(x) + if(t > 0.5, 1, 0) >= 1": 0.5, "sign(x) + 2*t >= 1": 0.5,
    "sign(x_dot)*(t - 5) + 2*t >= 1.2": 0.6,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("force", ["0", "max(t - 0.7, 0)^3"])
def test_steps_of_a_body_at_rest_do_not_hide_times(force, method):
    events = "\n".join(
        f'  e{k}: {{at: "{at}", set: {{{"n: n + 1" if k else "on: 1"}}}}}'
        for k, at in enumerate(AT_REST)
    )
    if method in FIXED:
        method += ", step: 0.1"
    found = lagsim.simulate(
        MODEL.replace("on: 0}}", "on: 0, late: 0.33}}").format(
            far=0.0, m=1.0, laws="", x=0.0, v=0.0, duration=1.0, force=force,
            method=method, events=events,
        ),
        error_bar="never",
    )  # fmt: skip
    times = {x.name: x.time for x in found.events if x.kind == "event"}
    right = {f"e{k}": time for k, time in enumerate(AT_REST.values())}
    assert times == pytest.approx(right, abs=1e-9)
    assert found["n"][-1] == len(right) - 1
