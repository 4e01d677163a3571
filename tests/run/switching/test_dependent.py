"""Switches whose arguments jump at other switches, against sums over their pieces.

The argument q grows at the rate 1 from 0, and the force F(q) acts on another body. All
pieces of F are linear and end at multiples of a twentieth, so that sums of the values
in the middle of twentieths are exact.
"""

import math

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import lagsim
from tests.run.switching.scenes import one_quick

END, PIECE = 12.0, 0.05
# Rounding of the rows, and of a hundred crossings that are located to the double.
BOUND = 1e-11
SCENE = """
coordinates: {{q: {{}}, w: {{}}}}
{tables}
energy: {{kinetic: q_dot^2/2 + w_dot^2/2, potential: 0}}
forces: {{w: "{force}"}}
initial: {{q: 0, q_dot: 1, w: 0}}
simulation: {{duration: {end}, output_step: 0.25, {more}}}
"""
POINTS = [[0.0, 3.0], [1.0, 3.0], [1.5, 0.0], [4.0, 1.0]]
AGAIN = [*POINTS[:-1], [4.0, 3.0]]
TABLES = {
    "T": f"tables: {{T: {{points: {POINTS}, outside: hold}}}}",
    "R": f"tables: {{R: {{points: {AGAIN}, outside: repeat}}}}",
    "G": "tables: {G: {points: [[0, 0, 0], [0, 1, 1], [3, 0, 2], [3, 1, 5]], "
    "outside: hold}}",
}


def mod(x, period):
    return x - period * math.floor(x / period)


def step(x):
    return float(x >= 0.0)


def table(x):
    return float(np.interp(x, *zip(*POINTS, strict=True)))


def again(x):
    return float(np.interp(mod(x, 4), *zip(*AGAIN, strict=True)))


def plane(x, y):
    x = min(max(x / 3, 0.0), 1.0)
    return (1 - y) * 2 * x + y * (1 + 4 * x)


# The force, as text and as a function of q.
FORCES = {
    "if of mod": ("if(mod(q, 4) < 1, 3, 0)", lambda x: 3.0 * (mod(x, 4) < 1)),
    "wrap": (
        "if(mod(q + 1.5, 3) - 1.5 > 0, 1, 0)",
        lambda x: mod(x + 1.5, 3) > 1.5,
    ),
    "step in step": (
        "if(q < 3 + 5*heaviside(q - 5), 1, 0)",
        lambda x: x < 3 + 5 * step(x - 5),
    ),
    "table": ("T(mod(q, 5))", lambda x: table(mod(x, 5))),
    "repeat of step": (
        "R(1.3*floor(q) + 0.4*q)",
        lambda x: again(1.3 * math.floor(x) + 0.4 * x),
    ),
    "table of if": (
        "T(0.5*q + if(q < 5, 0, -2.2))",
        lambda x: table(0.5 * x - (0.0 if x < 5 else 2.2)),
    ),
    "table of a table of if": (
        "T(0.5*q - 0.4*T(if(q < 5, 0.5, 1.25)))",
        lambda x: table(0.5 * x - 0.4 * table(0.5 if x < 5 else 1.25)),
    ),
    "two arguments": (
        "G(mod(q, 2.5), heaviside(mod(q, 0.8) - 0.3))",
        lambda x: plane(mod(x, 2.5), step(mod(x, 0.8) - 0.3)),
    ),
    "floor": ("floor(mod(q, 4)/1.5)", lambda x: math.floor(mod(x, 4) / 1.5)),
    "ceil": ("ceil(mod(q, 4) - 1.5)", lambda x: math.ceil(mod(x, 4) - 1.5)),
    "sign": ("sign(mod(q, 4) - 1.5)", lambda x: math.copysign(1, mod(x, 4) - 1.5)),
    "abs": ("abs(mod(q, 4) - 1.5)", lambda x: abs(mod(x, 4) - 1.5)),
    "max": ("max(mod(q, 4), 1.5)", lambda x: max(mod(x, 4), 1.5)),
    "min": ("min(mod(q, 4), mod(q, 3))", lambda x: min(mod(x, 4), mod(x, 3))),
    "mod of mod": ("mod(mod(q, 4), 1.5)", lambda x: mod(mod(x, 4), 1.5)),
    "parity": ("mod(floor(q), 2)", lambda x: mod(math.floor(x), 2)),
    "three deep": (
        "if(abs(mod(mod(q, 4), 1.5) - 0.7) < 0.3 + 0.2*floor(mod(q, 2)), 2, -1)",
        lambda x: (
            2.0
            if abs(mod(mod(x, 4), 1.5) - 0.7) < 0.3 + 0.2 * math.floor(mod(x, 2))
            else -1.0
        ),
    ),
    "joined": (
        "if(mod(q, 4) < 1 or mod(q, 3) > 2 and not sign(mod(q, 5) - 2) > 0, 2, -1)",
        lambda x: 2.0 if mod(x, 4) < 1 or (mod(x, 3) > 2 and mod(x, 5) <= 2) else -1.0,
    ),
}
# What the argument is: q, the time, or both.
ARGUMENTS = {"state": "q", "time": "t", "mixed": "(0.5*q + 0.5*t)"}
METHODS = {
    name: f"method: {name}" + ("" if adaptive else ", step: 0.0625")
    for name, adaptive in {
        "dop853": True, "taylor": True, "radau": True, "rk4": False, "euler": False,
        "gauss4": False, "verlet": False, "midpoint": False, "kahan-li6": False,
        "kahan-li8": False, "generalized-alpha": False, "rattle": False,
    }.items()
}  # fmt: skip


def sums(force):
    """Return w_dot at the ends of all pieces."""
    middles = PIECE * (np.arange(round(END / PIECE)) + 0.5)
    return np.append(0.0, np.cumsum([PIECE * force(x) for x in middles]))


def pushed(name, argument="q", more="method: dop853"):
    """Compare the velocity in all rows with the sums."""
    text, force = FORCES[name]
    tables = next((x for key, x in TABLES.items() if f"{key}(" in text), "")
    model = SCENE.format(
        force=text.replace("q", argument), tables=tables, end=END, more=more
    )
    result = lagsim.simulate(lagsim.load(model), error_bar="never")
    assert result.complete, result.reason
    rows = np.round(result.t / PIECE).astype(int)
    return np.abs(result["w_dot"] - sums(force)[rows])


@pytest.mark.parametrize("name", one_quick(*FORCES))
@pytest.mark.parametrize("argument", ARGUMENTS)
def test_sides_follow_those_that_they_depend_on(name, argument):
    assert np.max(pushed(name, ARGUMENTS[argument])) < BOUND


# What changes linearly is integrated exactly by order 2.
@pytest.mark.slow
@pytest.mark.parametrize("method", [m for m in METHODS if m != "euler"])
@pytest.mark.parametrize("name", ["table", "three deep"])
def test_every_method_has_them(name, method):
    assert np.max(pushed(name, more=METHODS[method])) < 1e-10


@pytest.mark.slow
def test_euler_has_them():
    assert np.max(pushed("three deep", more=METHODS["euler"])) < BOUND


# --- while the motion slides along the switch that the argument jumps at --------------

# Along y' = 0, where 0.5 pushes up and 2 back, the share of the side above is 5/8.
ABOVE = 0.625
SLIDING = """
coordinates: {{x: {{}}, y: {{}}, w: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + w_dot^2)/2, potential: 0}}
forces: {{y: "0.5 - 2*sign(y_dot)", w: "{force}"}}
initial: {{x: -4, x_dot: 1, y: 0, w: 0}}
simulation: {{duration: 10, output_step: 0.25, {more}}}
"""
# The force, and it as a function of x and of the sign of y'.
CARRIED = {
    "if": (
        "if(x + 5*heaviside(y_dot) < 3, 1, 0)",
        lambda x, side: float(x + 5 * (side > 0) < 3),
    ),
    "branch": (
        "if(x + 5*heaviside(y_dot) < 3, 1, 0.2*sign(y_dot))",
        lambda x, side: 1.0 if x + 5 * (side > 0) < 3 else 0.2 * side,
    ),
    "mod": ("mod(x + 0.7*sign(y_dot), 2)", lambda x, side: mod(x + 0.7 * side, 2)),
    "floor": (
        "floor(x + 0.7*sign(y_dot))",
        lambda x, side: math.floor(x + 0.7 * side),
    ),
    "abs of mod": (
        "abs(mod(x + 0.7*sign(y_dot), 2) - 1)",
        lambda x, side: abs(mod(x + 0.7 * side, 2) - 1),
    ),
}


@pytest.mark.parametrize("method", ["dop853", "rk4", "radau"])
@pytest.mark.parametrize("name", one_quick(*CARRIED))
def test_both_sides_of_what_it_slides_along_are_watched(name, method):
    text, force = CARRIED[name]
    model = SLIDING.format(force=text, more=METHODS[method])
    result = lagsim.simulate(lagsim.load(model), error_bar="never")
    assert result.complete, result.reason
    middles = PIECE * (np.arange(200) + 0.5) - 4.0
    each = [ABOVE * force(x, 1) + (1 - ABOVE) * force(x, -1) for x in middles]
    rows = np.round(result.t / PIECE).astype(int)
    pushed = np.append(0.0, np.cumsum(PIECE * np.array(each)))[rows]
    assert result["w_dot"] == pytest.approx(pushed, abs=BOUND)


# --- conditions -----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "rk4"])
def test_what_ends_by_a_jump_is_not_true_again_by_rounding(method):
    # True at the start, false from the jump on, for the rest of the run;
    # rounding decides on which side of it a state beside it is.
    model = lagsim.load(
        f"""
coordinates: {{q: {{}}}}
modes: {{n: 0}}
parameters: {{a: 1.366, b: 0.756, c: 0.289}}
events: {{e: {{at: "mod(a*q - b*t + c, 1.818) >= 0.662", set: {{n: n + 1}}}}}}
energy: {{kinetic: q_dot^2/2, potential: 1.892*q^2/2}}
initial: {{q: -0.225, q_dot: 2.414}}
simulation: {{duration: 0.1, output_step: 0.05, {METHODS[method]}}}
"""
    )
    for k in range(8):
        result = lagsim.simulate(model.bind(q=-0.225 + 3e-4 * k), error_bar="never")
        assert [e.time for e in result.events if e.name == "e"] == []


# --- wherever an expression may stand -------------------------------------------------

# The argument q grows at the rate 1; in 20 it is in the first quarter of a turn for 5.
IN, OUT = 5.0, 15.0
BESIDE = "initial: {q: 0, q_dot: 1, w: 0}\nenergy: {kinetic: q_dot^2/2 + w_dot^2/2, "
# s' is 1, 2, 3, 4 in the quarters of a turn of s, which takes 25/12.
TURN = 25.0 / 12.0
# Model, column and its value at 20.
PLACES = {
    "limit": (
        f"""coordinates: {{q: {{}}, w: {{}}}}
{BESIDE}potential: 0}}
forces: {{w: 10}}
constraints: {{c: {{relation: w_dot = 0, limit: "if(mod(q, 4) < 1, 2, 5)"}}}}""",
        "w_dot",
        8 * IN + 5 * OUT,
    ),
    "limit that lets go": (
        f"""coordinates: {{q: {{}}, w: {{}}}}
{BESIDE}potential: 0}}
forces: {{w: 3}}
constraints: {{c: {{relation: w_dot = 0, limit: "if(mod(q, 4) < 1, 2, 5)"}}}}""",
        "w",
        5 * (1.0 / 2 + 1.0 / 2 / 2),
    ),
    "friction": (
        """coordinates: {q: {}, w: {}, z: {}}
initial: {q: 0, q_dot: 1, w: 0, w_dot: 1, z: 0}
energy: {kinetic: (q_dot^2 + w_dot^2 + z_dot^2)/2, potential: 10*z}
forces: {w: 10}
constraints:
  c: {relation: z >= 0, restitution: 0, slip: w_dot,
      friction: "if(mod(q, 4) < 1, 0.2, 0.5)"}""",
        "w_dot",
        1 + 8 * IN + 5 * OUT,
    ),
    "dissipation": (
        """coordinates: {q: {}, w: {}}
initial: {q: 0, q_dot: 1, w: 0, w_dot: 1}
energy:
  kinetic: (q_dot^2 + w_dot^2)/2
  potential: 0
  dissipation: if(mod(q, 4) < 1, 0.3, 0.05)*w_dot^2/2""",
        "w_dot",
        math.exp(-0.3 * IN - 0.05 * OUT),
    ),
    # It jumps in q, too, which makes no impulse.
    "potential": (
        f"""coordinates: {{q: {{}}, w: {{}}}}
{BESIDE}potential: "w*if(mod(q, 4) < 1, 3, 0)"}}
forces: {{q: 0}}""",
        "w_dot",
        -3 * IN,
    ),
    "rate of a state": (
        """coordinates: {q: {}}
initial: {q: 0, q_dot: 1, s: 0}
states: {s: {rate: "if(mod(q, 4) < 1, 3, 0)"}}
energy: {kinetic: q_dot^2/2, potential: 0}""",
        "s",
        3 * IN,
    ),
    "of a state whose rate steps": (
        """coordinates: {w: {}}
initial: {w: 0, s: 0}
states: {s: {rate: 1 + floor(mod(s, 4))}}
energy: {kinetic: w_dot^2/2, potential: 0}
forces: {w: "if(mod(s, 4) < 1, 3, 0)"}""",
        "w_dot",
        3 * (20 // TURN + min(20 % TURN, 1.0)),
    ),
    "family": (
        """parameters: {n: 3}
coordinates: {q: {}, w(1..n): {}}
initial: {q: 0, q_dot: 1, "w(i = 1..n)": 0}
energy: {kinetic: "q_dot^2/2 + sum(i = 1..n, w_dot(i)^2)/2", potential: 0}
forces: {"w(i = 1..n)": "if(mod(q + i - 3, 4) < 1, 3, 0)"}""",
        "w_dot.3",
        3 * IN,
    ),
    # From 5.2 on the argument is 0.5 ahead, from 9.9 on 1.2.
    "modes": (
        f"""coordinates: {{q: {{}}, w: {{}}}}
{BESIDE}potential: 0}}
modes: {{n: 0}}
events: {{a: {{at: q >= 5.2, set: {{n: 0.5}}}}, b: {{at: q >= 9.9, set: {{n: 1.2}}}}}}
forces: {{w: "if(mod(q + n, 4) < 1, 3, 0)"}}""",
        "w_dot",
        3 * (1.0 + 1.0 + 1.0 + 1.0 + 1.0 + 1.0),
    ),
    # What else acts at an instant at which the argument jumps.
    "mode at a jump": (
        f"""coordinates: {{q: {{}}, w: {{}}}}
{BESIDE}potential: 0}}
modes: {{n: 0}}
events: {{a: {{at: q >= 4, set: {{n: 2}}}}}}
forces: {{w: "if(mod(q + n, 4) < 1, 3, 0)"}}""",
        "w_dot",
        3 * 5.0,
    ),
    "break at a jump": (
        f"""coordinates: {{q: {{}}, w: {{}}}}
{BESIDE}potential: 0}}
forces: {{w: "if(mod(q + 2*heaviside(t - 4), 4) < 1, 3, 0)"}}""",
        "w_dot",
        3 * 5.0,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("place", one_quick(*PLACES))
def test_they_are_right_wherever_an_expression_may_stand(place):
    text, column, expected = PLACES[place]
    # A step of 1/64 is exact in the sums of times.
    for method in ("dop853", "rk4, step: 0.015625"):
        model = f"{text}\nsimulation: {{duration: 20, method: {method}}}\n"
        result = lagsim.simulate(lagsim.load(model), error_bar="never")
        assert result.complete, result.reason
        assert result[column][-1] == pytest.approx(expected, abs=1e-9)
        assert not result.warnings


@pytest.mark.slow
def test_a_continuous_sawtooth_keeps_its_energy():
    model = """
coordinates: {q: {}}
energy: {kinetic: q_dot^2/2, potential: "0.5*max(0, 0.25 - abs(mod(q, 1) - 0.5))"}
initial: {q: 0.1, q_dot: 1}
simulation: {duration: 20}
"""
    result = lagsim.simulate(lagsim.load(model), error_bar="never")
    assert result.complete, result.reason
    assert result["energy"] == pytest.approx(0.5, abs=1e-12)
    # Half of a period is flat; up and down a speed changes linearly to its least.
    least = math.sqrt(1.0 - 2.0 * 0.125)
    period = 0.5 + 2.0 * 0.25 / (0.5 * (1.0 + least))
    through = (result.t[-1] - (0.25 - 0.1)) / period
    # Where a period begins, at 0.25, the speed is 1 again.
    assert np.floor(result["q"][-1] - 0.25) == math.floor(through)


# Torque of a four-stroke engine over its crank angle, in two turns.
STROKES = [
    [0.0, 0.0], [0.3, 90.0], [1.2, 60.0], [3.1, 5.0], [4.5, -8.0], [6.3, -3.0],
    [7.9, -4.0], [9.6, -6.0], [11.2, -20.0], [4 * math.pi, 0.0],
]  # fmt: skip
INERTIA, LOAD = 0.15, 0.12


def crank(end):
    """Return the speed of the engine at the end, from point to point of the table.

    Between two points the torque is linear, and the motion that of a linear equation.
    """
    t, angle, speed, k = 0.0, 0.0, 20.0, 0
    while True:
        (a, first), (b, last) = STROKES[k], STROKES[k + 1]
        slope = (last - first) / (b - a)
        A = np.array([[0.0, 1.0], [slope / INERTIA, -LOAD / INERTIA]])
        push = np.array([0.0, (first + slope * (angle - a)) / INERTIA])

        def after(time, A=A, push=push, speed=speed):
            """State from (0, speed), by the exponential of the extended matrix."""
            whole = np.zeros((3, 3))
            whole[:2, :2], whole[:2, 2] = A, push
            return (scipy.linalg.expm(time * whole) @ [0.0, speed, 1.0])[:2]

        far = b - angle
        passed = scipy.optimize.brentq(
            lambda x, after=after, far=far: after(x)[0] - far,
            0.0, 4.0 * far / speed, xtol=1e-16, rtol=1e-15,
        )  # fmt: skip
        if t + passed >= end:
            return after(end - t)[1]
        t, speed = t + passed, after(passed)[1]
        k = (k + 1) % (len(STROKES) - 1)
        angle = STROKES[k][0]


@pytest.mark.slow
@pytest.mark.parametrize("method", one_quick("dop853", "taylor", "radau"))
def test_an_engine_runs_by_its_crank_angle(method):
    model = f"""
coordinates: {{theta: {{unit: rad}}}}
tables: {{torque: {{points: {STROKES}}}}}
energy: {{kinetic: {INERTIA}*theta_dot^2/2, potential: 0}}
forces: {{theta: "torque(mod(theta, 4*pi)) - {LOAD}*theta_dot"}}
initial: {{theta: 0, theta_dot: 20}}
simulation: {{duration: 2, {METHODS[method]}}}
"""
    result = lagsim.simulate(lagsim.load(model), error_bar="never")
    assert result.complete, result.reason
    # Over nine turns; the tolerance is 1e-11 a step.
    assert result["theta_dot"][-1] == pytest.approx(crank(2.0), rel=1e-9)


# The velocity x' grows by 0.4 from -2 on. The force, and it as a function of x', of the
# time and of the sign of y'. Its pieces end at multiples of a twentieth of the time.
AT_SPEEDS = {
    "if": (
        "if(x_dot + sign(y_dot) < 0, 1, 0)",
        lambda v, _t, side: float(v + side < 0),
    ),
    "mod": (
        "mod(x_dot + 0.3*sign(y_dot), 1)",
        lambda v, _t, side: mod(v + 0.3 * side, 1),
    ),
    "levels of both sides at once": (
        "floor(x_dot + sign(y_dot))",
        lambda v, _t, side: math.floor(v + side),
    ),
    "slopes": (
        "mod(x_dot*(1.5 + 0.5*sign(y_dot)), 1)",
        lambda v, _t, side: mod(v * (1.5 + 0.5 * side), 1),
    ),
    "three deep": (
        "if(mod(x_dot + 0.3*sign(y_dot), 1) < 0.5 + 0.2*sign(x_dot*sign(y_dot)), 1, 0)",
        lambda v, _t, side: float(
            mod(v + 0.3 * side, 1) < 0.5 + 0.2 * np.sign(v * side)
        ),
    ),
    "time": (
        "if(mod(t + 0.5*sign(y_dot), 2) < 1, 1, 0)",
        lambda _v, t, side: float(mod(t + 0.5 * side, 2) < 1),
    ),
}


@pytest.mark.parametrize("method", ["dop853", "rk4"])
@pytest.mark.parametrize("name", one_quick(*AT_SPEEDS))
def test_surfaces_of_velocities_are_watched_on_both_sides(name, method):
    text, force = AT_SPEEDS[name]
    model = SLIDING.format(force=text, more=METHODS[method])
    model = model.replace("x_dot: 1", "x_dot: -2").replace(
        "forces: {", "forces: {x: 0.4, "
    )
    result = lagsim.simulate(lagsim.load(model), error_bar="never")
    assert result.complete, result.reason
    t = PIECE * (np.arange(200) + 0.5)
    each = [
        ABOVE * force(0.4 * x - 2, x, 1) + (1 - ABOVE) * force(0.4 * x - 2, x, -1)
        for x in t
    ]
    rows = np.round(result.t / PIECE).astype(int)
    pushed = np.append(0.0, np.cumsum(PIECE * np.array(each)))[rows]
    assert result["w_dot"] == pytest.approx(pushed, abs=BOUND)


# The slide along sign(x_dot) = 0 while q falls from 1 at the rate 1: on both sides
# another function of S = sign(x_dot) and q jumps at one time, at another level or at
# the same one. The place of x at t = 2.9.
SLIDES = {
    # -0.05, then -0.55 above; 0.95, then 0.45 below: both push back for ever.
    "0.5*ceil(0.5*q - S) - 0.05": 0.0,
    "0.5*floor(0.5*q - S) + 0.25": 0.0,
    "-0.5*floor(S - 0.5*q) - 0.05": 0.0,
    "0.5*mod(0.5*q - S, 8) - 2 - S*(3 - if(q > 0, 0, 1))": 0.0,
    "-S + 0.5*sign(0.5*q - 0.01*S) + 0.2*if(q < 0.5*(1 + S) - 0.5*S - 0.5, 1, 0)": 0.0,
    # Above, the force jumps from -0.9 to 0.1 - 0.5 (t - 1.5) at t = 1.5.
    "0.5*mod(0.5*mod(S, 2) + q, 2) - 0.9*S": 0.05 * 0.4**2 - 0.4**3 / 12.0,
    # From t = 1 on 0.45 below and 0.05 above, which both push up.
    "-0.5*S + 0.25 - 0.5*floor(0.5*q + 0.5*abs(S) - 0.5)*heaviside(S)": (
        0.125 * 1.9**2
    ),
}
ON = {
    "coordinate": ("x: {}, q: {}", "", "q: 1, q_dot: -1", "x_dot^2/2 + q_dot^2/2"),
    "state": ("x: {}", "states: {q: {rate: -1}}", "q: 1", "x_dot^2/2"),
    "definition": ("x: {}", "definitions: {q: 1 - t}", "", "x_dot^2/2"),
}
ALONG = """
coordinates: {{{coordinates}}}
{more}
energy: {{kinetic: {kinetic}, potential: 0}}
forces: {{x: "{force}"}}
initial: {{x: 0, x_dot: 0, {initial}}}
simulation: {{duration: 2.9, output_step: 0.1, {method}}}
"""


@pytest.mark.parametrize("force", one_quick(*SLIDES))
@pytest.mark.parametrize("on", ON)
@pytest.mark.parametrize("method", one_quick("dop853", "taylor", "radau", "rk4"))
def test_a_slide_goes_on_where_steps_jump_on_both_of_its_sides(force, on, method):
    coordinates, more, initial, kinetic = ON[on]
    model = ALONG.format(
        coordinates=coordinates, more=more, kinetic=kinetic, initial=initial,
        force=force.replace("S", "sign(x_dot)"), method=METHODS[method],
    )  # fmt: skip
    result = lagsim.simulate(lagsim.load(model), error_bar="never")
    assert result.complete, result.reason
    assert result["x"][-1] == pytest.approx(SLIDES[force], abs=BOUND)
