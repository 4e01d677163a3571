"""Steps of a slip that begins and ends: how often, and when, conditions act.

A force on x, a sine of t, overcomes the friction of the slip a x_dot - b y_dot. The
slip stops, and begins again on the other side. Just after it has begun it grows as the
square of the time, below its rounding for the first 1e-8 s.
"""

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import brentq

import lagsim

M, N = 0.68, 1.77  # the masses of x and y
W, LIMIT = 1.465, 0.67
SLIPS = {  # the slip, its coefficients a and b, and the slip as the rate of a place
    "2.1*x_dot - 0.7*y_dot": (2.1, 0.7, "2.1*x - 0.7*y"),
    "0.3*x_dot + 0.9*y_dot": (0.3, -0.9, "0.3*x + 0.9*y"),
    "x_dot": (1.0, 0.0, "x"),
}
# A condition on the slip S, and the signs of S for which it is true.
CONDITIONS = {
    "sign(S) = 0": (0,), "abs(sign(S)) <= 0.5": (0,), "abs(sign(S)) >= 0.5": (-1, 1),
    "sign(S) >= 0.5": (1,), "sign(S) - 1 = 0": (1,), "sign(S) <= 0.5": (-1, 0),
    "sign(S)*(2 + cos(t)) >= 0.5": (1,),
    "heaviside(S) >= 0.3": (0, 1), "heaviside(S) <= 0.2": (-1,),
    "if(S > 0, 1, 0) >= 0.5": (1,), "if(S > 0, 1, 0) <= 0.5": (-1, 0),
    "if(S >= 0, 1, 0) <= 0.5": (-1,), "if(S > 0 or S < 0, 1, 0) >= 0.5": (-1, 1),
}  # fmt: skip
HOLDS = {
    "limit": """coordinates: {x: {}, y: {}}
energy: {kinetic: KINETIC, potential: 0}
forces: {x: PUSH}
constraints: {rub: {relation: SLIP = 0, limit: LIMIT}}
""",
    "friction": """coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: KINETIC + UNIT*z_dot^2/2, potential: 'LIMIT*z'}
forces: {x: PUSH}
constraints: {rub: {relation: z >= 0, restitution: 0, friction: 1, slip: [SLIP]}}
""",
    "force": """coordinates: {x: {}, y: {}}
energy: {kinetic: KINETIC, potential: 0}
definitions: {r: PLACE}
forces: {x: PUSH, r: '-LIMIT*sign(r_dot)'}
""",
}


# The largest acceleration of the slip by the force, relative to that by friction.
LARGER = 1.4


def friction(a, b):
    """Return the acceleration of the slip by friction alone."""
    return LIMIT * (a * a / M + b * b / N)


def turns(a, b):
    """Return the times at which the slip begins or stops, with its sign since."""
    bound = friction(a, b)
    size = LARGER * bound
    found = [(0.0, 0)]
    while True:
        start, sign = found[-1]

        def excess(t, start=start, sign=sign):
            if sign == 0:  # of the acceleration without friction
                return abs(size * math.sin(W * t)) - bound
            speed = size * (math.cos(W * start) - math.cos(W * t)) / W
            return bound * (t - start) - sign * speed  # of friction's impulse

        grid = np.linspace(start + 1e-6, 4.0, 4001).tolist()
        over = next((k for k, t in enumerate(grid) if excess(t) > 0.0), None)
        if over is None:
            return found
        t = brentq(excess, grid[over - 1], grid[over], xtol=1e-15)
        found.append((t, 0 if sign else int(np.sign(math.sin(W * t)))))


def run(hold, slip, conditions, *, unit=1.0, boost=0.0, simulation=""):
    """Return the result of a scene, in lengths of 1/unit m and masses of unit kg."""
    a, b, place = SLIPS[slip]
    mass = 1.0 / unit
    words = {
        "KINETIC": f"({M * mass!r}*x_dot^2 + {N * mass!r}*y_dot^2)/2",
        "PUSH": f"{LARGER * friction(a, b) * M / a!r}*sin({W!r}*t)",
        "PLACE": place,
        "SLIP": slip,
        "LIMIT": repr(LIMIT),
        "UNIT": repr(mass),
    }
    text = HOLDS[hold] + "modes: {n: 0}\nevents:\n"
    for k, x in enumerate(conditions):
        text += f"  e{k}: {{at: '{x.replace('S', f'({slip})')}', set: {{n: n + 1}}}}\n"
    for word, value in words.items():
        text = text.replace(word, value)
    height = ", z: 0" if hold == "friction" else ""
    start = f"x: 0, y: 0{height}, y_dot: {boost * unit!r}"
    text += f"initial: {{{start}, x_dot: {b / a * boost * unit!r}}}\n"
    text += f"simulation: {{duration: 4{simulation}}}\n"
    return lagsim.simulate(lagsim.load(text), error_bar="never")


def check(result, slip, conditions, bound):
    """Compare the acts of all conditions with the turns of the slip."""
    a, b, _ = SLIPS[slip]
    known = turns(a, b)
    for k, text in enumerate(conditions):
        true = CONDITIONS[text]
        times = [
            t
            for (_, before), (t, after) in itertools.pairwise(known)
            if before not in true and after in true
        ]
        found = [e.time for e in result.events if e.name == f"e{k}"]
        assert found == pytest.approx(times, abs=bound), text


@pytest.mark.slow
@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize(
    ("method", "unit"),
    [("auto", 1.0), ("dopri5", 1000.0), ("rk4, step: 0.01", 0.001)],
    ids=["auto", "dopri5", "rk4"],
)
def test_conditions_on_the_step_of_a_slip_act_where_it_begins_or_stops(
    hold, slip, method, unit
):
    simulation = f", method: {method}"
    result = run(hold, slip, CONDITIONS, unit=unit, simulation=simulation)
    check(result, slip, CONDITIONS, 1e-9 if "step" not in method else 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("hold", HOLDS)
def test_conditions_on_a_slip_of_moving_bodies(hold):
    # The slip is 0 at the start but for rounding, and no condition acts there.
    slip = "2.1*x_dot - 0.7*y_dot"
    result = run(hold, slip, CONDITIONS, boost=13.7)
    check(result, slip, CONDITIONS, 1e-9)


def test_two_conditions_that_end_where_the_slip_stops():
    # The second is false at the level alone: past it, it is true again.
    slip, two = "2.1*x_dot - 0.7*y_dot", ["sign(S) >= 0.5", "abs(sign(S)) >= 0.5"]
    result = run("friction", slip, two, boost=-0.7, simulation=", method: dopri5")
    check(result, slip, two, 1e-9)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)], ids=["toggle first", "reset first"])
def test_conditions_that_act_where_a_slip_stops_act_in_the_order_of_the_file(order):
    # One condition is met exactly where the slip is 0, the other by a jump.
    events = [
        "  toggle: {at: 'sign(x_dot - y_dot/3) = 0', set: {a: 1 - a}}\n",
        "  reset: {at: 'if(x_dot - y_dot/3 > 0, 1, 0) <= 0.5', set: {a: 0}}\n",
    ]
    text = f"""coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (3.1*x_dot^2 + y_dot^2)/2, potential: 0}}
forces: {{x: '4.43*sin(2.53*t)'}}
constraints: {{rub: {{relation: x_dot - y_dot/3 = 0, limit: 2}}}}
modes: {{a: 0}}
events:
{events[order[0]]}{events[order[1]]}initial: {{x: 0, y: 0, x_dot: 0.1, y_dot: 0.3}}
simulation: {{duration: 1.49}}
"""
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    names = [("toggle", "reset")[k] for k in order]
    assert [e.name or e.kind for e in result.events] == ["slip", "stick", *names]
    assert result["a"][-1] == order[0]
    # It begins where 9 F/12.1 is the limit.
    begins = math.asin(2 * 12.1 / 9 / 4.43) / 2.53
    assert result.events[0].time == pytest.approx(begins, abs=1e-12)


@pytest.mark.parametrize("method", ["dop853", "taylor", "radau", "rk4, step: 0.01"])
@pytest.mark.parametrize(
    "at",
    ["sign(x + 0.5) <= -0.5", "if(x > -0.5, 1, 0) <= 0.5", "floor(2*x + 2) <= 0.5"],
)
def test_a_condition_on_a_step_of_a_position_beside_a_switch_at_its_level(at, method):
    # A body at rest keeps the switch of its velocity at the level for ever.
    text = f"""coordinates: {{x: {{}}, rests: {{}}}}
energy: {{kinetic: (x_dot^2 + rests_dot^2)/2, potential: 0}}
states: {{z: {{rate: "if(rests_dot < 0, 0, 1)"}}}}
forces: {{x: -abs(x - 5)/5}}
modes: {{u: 0}}
events: {{e: {{at: "{at}", set: {{u: 1}}}}}}
initial: {{x: 0, rests: 0, x_dot: 1, rests_dot: 0, z: 0}}
simulation: {{duration: 5, output_step: 0.125, method: {method}}}
"""
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    # With w^2 = 1/5 the distance from 5 is 5 cosh(w t) - sinh(w t)/w, and becomes 5.5.
    growth = (5.5 + math.sqrt(5.5**2 - 4 * 5)) / (5 - math.sqrt(5))
    [event] = result.events
    assert event.time == pytest.approx(math.sqrt(5) * math.log(growth), abs=1e-8)
