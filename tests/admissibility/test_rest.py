"""Starts at rest, against closed forms and independent root finding."""

import math
import re

import numpy as np
import pytest
from scipy.optimize import brentq

import lagsim
from benchmarks.rod_chain import rod_chain
from lagsim.admissibility.examination import examine
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from tests.admissibility.scenes import codes, scene
from tests.support import simulate

M, G = 1.3, 9.81


def at_rest(text, time=0.0):
    return examine(derive(read(text, "model.yaml")), time, rest=True, classify=True)


def coordinates(start):
    return np.array([*start.rest.values()])


def acceleration(start, name):
    [found] = [v.position.value for v in start.verdicts if v.name == f"{name}_ddot"]
    return found


# --- A chain of n rods between two posts, a distance d apart


def chain(guesses, d=0.8, shift=0.0, length=1.0, mass=1.0, time=1.0, more="0"):
    """Return a hanging chain, in units of `length` m, `mass` kg and `time` s."""
    n = len(guesses)
    lines = [f"parameters: {{m: {M / n / mass!r}, l: {1 / n / length!r}}}"]
    lines += [f"coordinates: {{{', '.join(f'q{i}: ' for i in range(1, n + 1))}, z: }}"]
    lines += ["definitions:", f"  x0: {shift!r}", "  y0: 0"]
    for i in range(1, n + 1):
        x, y = f"x{i - 1} + l*cos(q{i})", f"y{i - 1} + l*sin(q{i})"
        lines += [f"  x{i}: {x}", f"  y{i}: {y}"]
        lines += [f"  a{i}: {x}/2", f"  b{i}: {y}/2"]
    own = range(1, n + 1)
    T = "+".join(f"m*(a{i}_dot^2 + b{i}_dot^2 + (l*q{i}_dot)^2/12)/2" for i in own)
    V = "+".join(f"m*{G * time**2 / length!r}*b{i}" for i in own)
    lines += [f"energy: {{kinetic: {T} + 1e6*z_dot^2/2, potential: {V} + {more}}}"]
    end = f"x{n} = {shift!r} + {d / length!r}"
    lines += [f"constraints: {{px: {end}, py: y{n} = 0}}", "initial:", "  z: 1e7"]
    lines += [f"  q{i}: {{guess: {x!r}}}" for i, x in enumerate(guesses, 1)]
    return "\n".join([*lines, "simulation: {duration: 1, begin: rest}"])


def catenary(n, d):
    """Angles (n,) and H, the same in all: the vertical force jumps at each rod."""
    loads = M * G / n * (np.arange(1, n + 1) - (n + 1) / 2)
    span = brentq(lambda H: np.sum(np.cos(np.arctan(loads / H))) / n - d, 1e-6, 1e6)
    return np.arctan(loads / span), span


def guess(n, how):
    k = np.arange(n)
    return {
        "sagging": np.linspace(-1, 1, n), "straight": 0.01 * (k + 1),
        "arch": np.linspace(0.8, -0.8, n), "zigzag": 0.6 * (-1.0) ** k,
    }[how].tolist()  # fmt: skip


@pytest.mark.parametrize(
    ("n", "how"),
    [(2, "sagging"), (5, "zigzag"), (8, "straight"), (8, "arch"), (20, "zigzag"),
     (40, "straight")],
)  # fmt: skip
def test_a_chain_between_posts_is_a_discrete_catenary(n, how):
    start = at_rest(chain(guess(n, how)))
    assert start.admissible
    angles = catenary(n, 0.8)[0] * (-1 if how == "arch" else 1)
    assert coordinates(start) == pytest.approx(angles, abs=1e-12)


@pytest.mark.parametrize("n", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_rods_let_go_level_hang_down(n):
    text, start = rod_chain(n, 1.0).split("initial:\n")
    start = re.sub(r"(?m)^  (\w+): (.*)$", r"  \1: {guess: \2}", start)
    found = at_rest(f"{text}initial:\n{start}").state.q
    x, y, a = found.reshape(n, 3).T
    assert x == pytest.approx(0, abs=1e-12)
    assert y == pytest.approx(-(np.arange(n) + 0.5) / n, abs=1e-12)
    assert np.sin(a) == pytest.approx(-1)


OTHERWISE = {
    "shifted": ({"shift": 1e6}, 1e-9), "in mm": ({"length": 1e-3}, 1e-12),
    "in g and ms": ({"mass": 1e-3, "time": 1e-3}, 1e-12),
    "in tonnes and days": ({"mass": 1e3, "time": 86400.0}, 1e-12),
}  # fmt: skip


@pytest.mark.parametrize(("change", "bound"), OTHERWISE.values(), ids=OTHERWISE)
@pytest.mark.parametrize("how", ["sagging", "straight"])
def test_units_and_origin_do_not_matter(change, bound, how):
    start = at_rest(chain(guess(6, how), **change))
    assert start.admissible
    assert coordinates(start) == pytest.approx(catenary(6, 0.8)[0], abs=bound)


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("radau", "taylor")]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", *SLOW])
def test_the_run_begins_there_and_stays(tmp_path, method):
    path = tmp_path / "chain.yaml"
    path.write_text(chain(guess(3, "straight")))
    q, span = catenary(3, 0.8)
    found = simulate(path, method=method, duration=2)
    ends = [[found[f"q{i}"][k] for i in range(1, 4)] for k in (0, -1)]
    assert ends == pytest.approx(np.array([q, q]), abs=1e-9)
    assert np.abs(found["lambda_px"]) == pytest.approx(span, rel=1e-9)
    assert lagsim.check(path).rest == pytest.approx(
        {f"q{i + 1}": q[i] for i in range(3)}
    )


# --- One and two coordinates: name: relations, start, what else, the rest

SPIN = "th_dot^2/2 + w^2*sin(th)^2/2"
WHIRL = math.acos(9.81 / 25)
TURNING = (
    "x: sin(th)*cos(w*t)\ny: sin(th)*sin(w*t)",
    "(x_dot^2+y_dot^2+(sin(th)*th_dot)^2)/2",
)
CASES = {
    "down": ({}, {"th": "{guess: 1.5}"}, {"potential": "-cos(th)"}, [0.0]),
    "upright": ({}, {"th": "{guess: 2.5}"}, {"potential": "-cos(th)"}, [math.pi]),
    "whirling": ({}, {"th": "{guess: 0.9}"}, {
        "kinetic": SPIN, "potential": "-9.81*cos(th)", "parameters": "w: 5"}, [WHIRL]),
    "whirling with t": ({}, {"th": "{guess: 0.9}"}, {
        "definitions": TURNING[0], "kinetic": TURNING[1], "parameters": "w: 5",
        "potential": "-9.81*cos(th)"}, [WHIRL]),
    "forced": ({}, {"x": "{guess: 0}"}, {
        "potential": "2*x^2", "more": "forces: {x: 3*cos(t) - x_dot}"}, [0.75]),
    "follower": ({}, {"x": "{guess: 0.5}", "y": "{guess: 0}"}, {
        "potential": "x^2 + y^2", "more": "forces: {x: 1 - y, y: x}"}, [0.4, 0.2]),
    "car": ({}, {"z": "{guess: 0}", "p": "{guess: 0}"}, {
        "potential": "9*z + 8*(z - 2*p)^2/2 + 4*(z + p)^2/2"}, [-1.125, -0.375]),
    "a place": ({}, {"s": "{guess: 1}", "th": "0"}, {
        "kinetic": "s_dot^2/2 + (s^2 + 3)*th_dot^2/2",
        "potential": "9.81*(s - 2)*sin(th)"}, [2.0]),
    "two wells": ({}, {"x": "{guess: 0.5}"}, {"potential": "x^4 - 2*x^2"}, [1.0]),
    "free": ({}, {"x": "{guess: 4}"}, {}, [4.0]),
    "one too many": ({"r": "x^2 + y^2 = 1", "s": "2*x^2 + 2*y^2 = 2"},
                     {"x": "{guess: 0.3}", "y": "{guess: -0.8}"},
                     {"potential": "y"}, [0.0, -1.0]),
    "no mass": ({"h": "u = 0.5"}, {"x": "{guess: 0}", "u": "{guess: 1}"}, {
        "kinetic": "x_dot^2/2", "potential": "3*(x - u)^2 + 6*x"}, [-0.5, 0.5]),
    "a definition": ({}, {"e": "3", "x": "{guess: 0}", "u": "{guess: 0}"}, {
        "definitions": "e: x - u", "potential": "(x - u - 3)^2 + (x + u)^2"},
        [1.5, -1.5]),
    "a blade": ({"k": "x_dot*sin(a) = y_dot*cos(a)"},
                {"x": "{guess: 1}", "y": "0", "a": "{guess: 0.5}"},
                {"potential": "(x - 2)^2"}, [2.0, 0.5]),
}  # fmt: skip


def text_of(relations, initial, more):
    more = dict(more)
    text = scene(relations, initial, **{k: v for k, v in more.items() if k != "more"})
    return text + more.get("more", "")


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_a_rest(case):
    start = at_rest(text_of(*case[:3]))
    assert start.admissible, start.unsolved
    assert coordinates(start) == pytest.approx(case[3], abs=1e-12)
    assert ("undetermined-guess" in codes(start)) is (case[3] == [4.0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("walls", "rest"),
    [("x >= 0, x <= 2, y >= 0, y <= 3", [2, 3]), ("x >= 0, x >= -0.5, x <= 2", [2])],
)
def test_pushed_away_from_the_nearest_walls(walls, rest):
    relations = enumerate(walls.split(","))
    laws = [f"w{k}: {{relation: {x}, restitution: 0}}" for k, x in relations]
    text = text_of({}, dict.fromkeys("xy"[: len(rest)], "{guess: 0.1}"), {
        "potential": "-3*x - 2*y" if "y" in walls else "-3*x",
        "more": f"constraints: {{{', '.join(laws)}}}\n"})  # fmt: skip
    assert coordinates(at_rest(text)) == pytest.approx(rest, abs=1e-12)


def test_time_is_that_of_the_start():
    for name, rest in (("whirling with t", WHIRL), ("forced", 0.75 * math.cos(2.0))):
        assert coordinates(at_rest(text_of(*CASES[name][:3]), 2.0)) == pytest.approx(
            [rest]
        )


REGULATOR = """
coordinates: {x: }
states: {i: {rate: 1 - x}, j: {rate: i - 3*j}}
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
forces: {x: 3*i - x_dot}
initial: {x: {guess: 0}, i: {steady: 0}, j: START}
"""


@pytest.mark.parametrize(("j", "more"), [("{steady: 0}", [4 / 9]), ("5", [])])
def test_steady_states_are_solved_with_the_positions(j, more):
    start = at_rest(REGULATOR.replace("START", j))
    assert start.admissible
    assert coordinates(start) == pytest.approx([1.0, 4 / 3, *more], abs=1e-14)


# --- What is no rest

NONE = {
    "falls": ({}, {"y": "{guess: 3}"}, {"potential": "9.81*y"}, {"y_ddot": -9.81}),
    "stated": ({}, {"th": "1"}, {"potential": "-cos(th)"}, {"th_ddot": -math.sin(1)}),
    "moves": ({}, {"th": "0", "th_dot": "2"}, {"potential": "-cos(th)"}, {"th_dot": 2}),
    "is moved": ({"c": "x = 2*t"}, {"x": "{guess: 1}", "x_dot": "{guess: 0}"}, {},
                 {"x_dot": 2}),
    "by a line": ({"c": "x = y"}, {"x": "{guess: 1}", "y": "1"}, {"potential": "6*y"},
                  {"x_ddot": -3, "y_ddot": -3}),
    "half stated": ({}, {"x": "{guess: 0}", "u": "2"}, {"potential": "x^2 + (x - u)^2"},
                    {"x_ddot": 4, "u_ddot": -4}),
    "at infinity": ({}, {"x": "{guess: 1}"}, {"potential": "-1/x"}, {"x_ddot": -1}),
}  # fmt: skip


@pytest.mark.parametrize("case", NONE.values(), ids=NONE)
def test_no_rest_is_told_with_what_remains(case):
    start = at_rest(text_of(*case[:3]))
    assert not start.admissible
    assert start.rest is None
    left = {v.name: v.position.value for v in start.verdicts if v.kind == "at rest"}
    assert left == pytest.approx(case[3])


@pytest.mark.slow
def test_the_nearest_rest_is_offered():
    assert at_rest(text_of(*NONE["stated"][:3])).repair == {"th": 0.0}
    found = at_rest(text_of(*NONE["half stated"][:3]))
    assert found.repair == pytest.approx({"u": 0.0}, abs=1e-15)
    assert at_rest(text_of(*NONE["falls"][:3])).repair is None


# --- Contacts that hold

INCLINE = (
    "coordinates: {x: , y: }\n"
    "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}\n"
    "parameters: {mu: MU, a: 0.3}\nconstraints: {f: {relation: y*cos(a) >= x*sin(a), "
    "restitution: 0.5, friction: mu, slip: x_dot*cos(a) + y_dot*sin(a)}}\n"
    "initial: {x: {guess: 1}, y: {guess: 2}}\n"
)
LADDER = """
parameters: {m: 2, g: 9.81, L: 3, mu: MU, k: SPRING}
coordinates: {x: , y: , a: }
definitions: {foot: x + L*cos(a)/2, low: y - L*sin(a)/2, top: x - L*cos(a)/2}
energy:
  kinetic: m*(x_dot^2 + y_dot^2)/2 + m*L^2*a_dot^2/24
  potential: m*g*y + k*foot^2/2
constraints:
  floor: {relation: low >= 0, restitution: 0, friction: mu, slip: foot_dot}
  wall: {relation: top >= 0, restitution: 0}
initial: {x: {guess: 0.7}, y: {guess: 1.4}, a: {guess: 1.1}}
simulation: {duration: 1, begin: rest}
"""
BOX = """
parameters: {w: 1, h: 0.5}
coordinates: {x: , y: , a: }
definitions: {left: y - w*sin(a) - h*cos(a), right: y + w*sin(a) - h*cos(a)}
energy: {kinetic: (x_dot^2 + y_dot^2 + a_dot^2)/2, potential: 9.81*y}
constraints:
  l: {relation: left >= 0, restitution: 0.3}
  r: {relation: right >= 0, restitution: 0.3}
  m: {relation: left + right >= 0, restitution: 0.3}
initial: {x: 3, y: {guess: 1.6}, a: {guess: 0.2}}
"""


def modes(start):
    return {v.name: v.mode for v in start.verdicts}


@pytest.mark.slow
def test_a_block_rests_on_a_rough_slope_that_is_not_too_steep():
    start = at_rest(INCLINE.replace("MU", "0.32"))  # tan(0.3) = 0.309
    assert modes(start) == {"f": "sticks"}
    # The nearest point of the plane to the guess.
    along = math.cos(0.3) + 2 * math.sin(0.3)
    expected = [along * math.cos(0.3), along * math.sin(0.3)]
    assert coordinates(start) == pytest.approx(expected, abs=1e-9)
    assert not at_rest(INCLINE.replace("MU", "0.3")).admissible


@pytest.mark.slow
def test_friction_that_does_not_suffice_lets_it_slide_to_the_lowest_point():
    bowl = INCLINE.replace("MU", "0.2").replace("y*cos(a) >= x*sin(a)", "y >= x^2")
    bowl = bowl.replace("x_dot*cos(a) + y_dot*sin(a)", "x_dot + 2*x*y_dot")
    assert coordinates(at_rest(bowl)) == pytest.approx([0, 0], abs=1e-12)
    near = bowl.replace("guess: 2", "guess: 0.003").replace("guess: 1", "guess: 0.05")
    start = at_rest(near)  # slope 0.1 < 0.2
    assert modes(start) == {"f": "sticks"}
    assert coordinates(start)[0] == pytest.approx(0.05, abs=1e-3)


@pytest.mark.slow
def test_a_ladder_between_two_contacts():
    start = at_rest(LADDER.replace("MU", "0.6").replace("SPRING", "0"))
    assert modes(start) == {"floor": "sticks", "wall": "closed"}
    x, y, a = coordinates(start)
    assert [x, y] == pytest.approx([1.5 * math.cos(a), 1.5 * math.sin(a)], abs=1e-9)
    assert abs(a - 1.1) < 0.1
    # Without friction a cord holds it: sin(a) = m g/(2 k L), from the torques.
    text = LADDER.replace("MU", "0").replace("SPRING", "4").replace("1.1", "0.97")
    start = at_rest(text)
    assert coordinates(start)[2] == pytest.approx(math.asin(2 * 9.81 / 24), abs=1e-9)
    found = simulate(lagsim.load(text))
    assert found["lambda_floor"] == pytest.approx(2 * 9.81, rel=1e-6)
    foot = 3 * math.cos(math.asin(2 * 9.81 / 24))
    assert found["lambda_wall"] == pytest.approx(4 * foot, rel=1e-6)


@pytest.mark.slow
def test_a_box_falls_flat_on_more_contacts_than_it_needs():
    start = at_rest(BOX)
    assert coordinates(start) == pytest.approx([0.5, 0], abs=1e-12)
    assert {*modes(start).values()} == {"closed"}


@pytest.mark.parametrize(("x", "rest"), [(0.15, 0.15), (0.25, 0.0)])
def test_a_brake_holds_up_to_its_limit(x, rest):
    text = text_of({}, {"x": f"{{guess: {x}}}"}, {
        "potential": "5*x^2",
        "more": "constraints: {b: {relation: x_dot = 0, limit: 2}}\n"})  # fmt: skip
    start = at_rest(text)
    assert coordinates(start) == pytest.approx([rest], abs=1e-14)


# Springs to 0.5 and to each other: alone both rest at 0.5.
WALL = """
coordinates: {x: , y: }
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: (x - 0.5)^2/2 + (y - x)^2/2}
constraints: {wall: {relation: RELATION, restitution: E}}
initial: {x: {guess: 1}, y: {guess: 0.9}}
simulation: {duration: 1, begin: rest}
"""


@pytest.mark.parametrize("e", ["0", "0.7"])
@pytest.mark.parametrize(
    ("relation", "time", "rests"),
    [
        ("x >= 1", 0, True),
        ("x >= 1 + t^3", 0, True),
        ("x >= 0.4 + 0.1*t", 0, True),
        ("x >= 0.5 - 0.1*t", 0, True),  # nothing leans on it
        ("x >= 1 - 0.1*t", 0, False),
        ("x >= 0.5 + 0.1*t", 0, False),
        ("x >= 0.8 + 0.1*t", 2, False),
        ("500*x >= 500 + 50*t", 0, False),
        ("x >= 1 + 1e-7*t", 0, False),
        ("x >= 1 + 0.05*t^2", 0, False),
    ],
)
def test_nothing_rests_at_a_wall_that_comes(relation, time, rests, e):
    found = at_rest(WALL.replace("RELATION", relation).replace("E}", f"{e}}}"), time)
    assert found.admissible == rests
    assert found.repair is None or rests


@pytest.mark.parametrize("e", [0, 0.7])
def test_a_wall_that_comes_is_told_by_what_it_sets_in_motion(e):
    text = WALL.replace("RELATION", "x >= 1 + 0.1*t").replace("E}", f"{e}}}")
    start = at_rest(text.replace("{guess: 1}", "1").replace("{guess: 0.9}", "1"))
    left = {v.name: v.position.value for v in start.verdicts if v.kind == "at rest"}
    assert left == pytest.approx({"x_dot": 0.1 * (1 + e)})  # by Newton's law


# --- On the command line, and in Python

CAR = """
parameters: {m: 2, g: 9.81, k: 50}
coordinates: {z: {unit: m}}
energy: {kinetic: m*z_dot^2/2, potential: m*g*z + k*z^2/2}
initial: {z: {guess: 0}}
simulation: {duration: 1, begin: rest, start: 3}
"""


@pytest.mark.slow
def test_sweep_and_bind(tmp_path):
    path = tmp_path / "car.yaml"
    path.write_text(CAR)
    stiff = [10.0, 20.0, 40.0]
    for ends in (False, True):
        found = lagsim.sweep(path, {"k": stiff}, ends=ends)
        assert found["z.end"] == pytest.approx(-19.62 / np.array(stiff), rel=1e-12)
    bound = lagsim.load(path).bind(k=100)
    assert simulate(bound)["z"] == pytest.approx(-0.1962, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "code", "text"),
    [
        (("rest", "rest"), 0, r"the rest, for `initial:`\n    z: -0\.3924"),
        (("k: 50", "k: 0"), 1, r"no rest: z_ddot is -9\.81"),
        (("rest", "still"), 2, r":6:34: .*still.*\n.*\n +\^\^\^\^\^\n.*`rest`"),
        (("rest", ""), 0, "nothing to repair"), (("rest", "initial"), 0, "nothing"),
        (("rest", "[rest]"), 2, "must be a text"),
    ],
)  # fmt: skip
def test_the_command(change, code, text, lagsim, write):
    path = write(CAR.replace(*change))
    for command in (["check", "--repair"], ["run", "--no-plots", "-o", "out"]):
        called = lagsim(command[0], path, *command[1:], code=code)
        if code or command[0] == "check":
            assert re.search(text, called.out + called.err)


@pytest.mark.slow
@pytest.mark.parametrize("names", ["Z: {}, x: {}, y: {}", "x: {}, y: {}, Z: {}"])
def test_a_heavy_body_at_rest_beside_a_pendulum_rests_wherever_it_stands(names):
    # The pendulum of length 0.4 hangs where a spring to x = 0.3 balances its weight:
    # 20*(0.3 - x) = 9.81*x/sqrt(0.16 - x^2). Nothing joins the heavy body to it.
    found = simulate(f"""
coordinates: {{{names}}}
energy:
  kinetic: (x_dot^2 + y_dot^2)/2 + 1e6*Z_dot^2/2
  potential: 9.81*y + 4.5e6*Z^2 + 10*(x - 0.3)^2
constraints: {{rod: x^2 + y^2 = 0.16}}
initial: {{Z: 0, x: {{guess: 0.24}}, y: {{guess: -0.32}}}}
simulation: {{begin: rest, duration: 1, output_step: 0.5}}
""")
    x = brentq(lambda x: 20 * (0.3 - x) - 9.81 * x / math.sqrt(0.16 - x * x), 0, 0.3)
    assert found["x"] == pytest.approx(x, abs=1e-12)
    assert found["Z"] == pytest.approx(0.0, abs=1e-18)


BELT = """
parameters: {{mu: 0.3, r: 0.2}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: x_dot^2 + y_dot^2/2, potential: 10*x^2 + 5*y^2 + {load}*y}}
constraints: {{{limits}}}
initial: {{x: {{guess: 0}}, y: {{guess: 0}}}}
simulation: {{duration: 1, begin: rest}}
"""


# At rest 20 x = f_x and 10 y + load = f_y, with the forces f of the limits.
@pytest.mark.parametrize(
    ("limits", "load", "x", "y"),
    [
        ("belt: {relation: x_dot = 3, limit: 4*mu}", 0, 0.06, 0.0),
        ("belt: {relation: -x_dot = 3, limit: 4*mu}", 0, -0.06, 0.0),
        # The bound follows from the deflection of a spring: y = -1.
        ("belt: {relation: x_dot = 3, limit: -10*mu*y}", 10, 0.15, -1.0),
        ("belt: {relation: x_dot = 3, limit: {static: 9, dynamic: 2}}", 0, 0.1, 0.0),
        ("belt: {relation: x_dot = 3, limit: 2 + x}", 0, 2 / 19, 0.0),
        ("belt: {relation: x_dot - r*y_dot = 3, limit: 2}", 0, 0.1, -0.04),
        ("belt: {relation: [x_dot = 3, y_dot = -4], limit: 5}", 0, 0.15, -0.4),
        (
            ("belt: {relation: x_dot = 3, limit: 1},"
            " other: {relation: x_dot = -2, limit: 3}"),
            0, -0.1, 0.0,
        ),
    ],
)  # fmt: skip
def test_a_start_at_rest_on_a_limit_that_slides(limits, load, x, y):
    text = BELT.format(limits=limits, load=load)
    result = lagsim.simulate(text, error_bar="never")
    assert result.complete
    for name, value in (("x", x), ("y", y)):
        assert result[name] == pytest.approx(value + 0 * result.t, abs=1e-12)
