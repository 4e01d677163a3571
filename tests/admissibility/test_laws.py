"""Constraints that hold at times, at the start: closed forms of their modes."""

import math

import pytest

from tests.admissibility.scenes import codes, judged
from tests.support import refused, run

# A block on an incline: the angle of friction is atan(0.3) = 0.2915.
BLOCK = """
parameters: {g: 9.81, slope: SLOPE, mu: 0.3, e: 0.5}
coordinates: {x: {}, y: {}}
energy:
  kinetic: (x_dot^2 + y_dot^2)/2
  potential: g*(y*cos(slope) - x*sin(slope))
constraints:
  floor: {relation: y >= 0, restitution: e, friction: FRICTION, slip: x_dot}
initial: START
"""
# Two shafts: to hold both together takes half of what pulls at one.
SHAFTS = """
parameters: {F: 2, T: 0.3}
coordinates: {a: {}, b: {}}
energy: {kinetic: (a_dot^2 + b_dot^2)/2, potential: 0}
forces: {a: PULL}
constraints: {c: LAW}
initial: {a: 0, b: 0, a_dot: SPEED, b_dot: 0}
"""
# The disc of friction, mu g = 2.943, not the square around it.
SLIPS = """
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*y - PULL*(x + z)}
constraints:
  floor: {relation: y >= 0, restitution: 0, friction: 0.3, slip: [x_dot, z_dot]}
initial: {x: 0, y: 0, z: 0}
"""
# A wheel that rolls, its rates known to 1e-12 of its motion.
WHEEL = """
coordinates: {x: {}, y: {}, q: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + q_dot^2)/2, potential: 9.81*y}
constraints:
  floor: {relation: y >= 0, restitution: 0, friction: 0.5, slip: x_dot - q_dot}
initial: {x: 0, y: 0, q: 0, x_dot: 3, q_dot: SPEED}
"""
# On a sphere of radius 1 a ball holds while v^2 < g cos(angle).
SPHERE = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {ball: {relation: 'hypot(x, y) >= 1', restitution: 0}}
initial: {x: 0.6, y: 0.8, x_dot: 0.8*SPEED, y_dot: -0.6*SPEED}
"""
# A floor that is taken away; below it nothing is judged when it is.
TAKEN = """
coordinates: {y: {}}
energy: {kinetic: y_dot^2/2, potential: 9.81*y}
constraints: {floor: {relation: y >= 0, restitution: 0, when: LAW}}
initial: {y: START}
"""
SILENT = {
    "SLOPE": "0.1", "START": "{x: 0, y: 0}", "FRICTION": "mu", "PULL": "0", "SPEED": "0"
}  # fmt: skip


def filled(text, **values):
    for name, value in (SILENT | values).items():
        text = text.replace(name, str(value))
    return text


def looked_at(text, **values):
    return judged(filled(text, **values), classify=True)


def only(start):
    (found,) = start.verdicts
    return found


FREEWHEEL, LIMITED = "b_dot >= a_dot", "{relation: a_dot = b_dot, limit: F}"
TIMED = "{relation: a = b, when: t CONDITION T}"
BORDER = math.sqrt(9.81 * 0.8)
# A scene, values, what its law does, and whether it touches and holds, or is in force.
MODES = [
    (BLOCK, {"SLOPE": 0.0}, "sticks", True, True),
    (BLOCK, {"SLOPE": 0.29}, "sticks", True, True),
    (BLOCK, {"SLOPE": 0.293}, "slides", True, True),
    (BLOCK, {"START": "{x: 0, y: 0, x_dot: 1e-3}"}, "slides", True, True),
    (BLOCK, {"START": "{x: 0, y: 0, y_dot: 1e-3}"}, "open", True, False),
    (BLOCK, {"START": "{x: 0, y: 1e-3}"}, "open", False, False),
    (BLOCK, {"START": "{x: 0, y: 0, y_dot: -1}"}, "impact", True, False),  # it bounces
    (BLOCK.replace("e: 0.5", "e: 0"), {"START": "{x: 0, y: 0, y_dot: -1}"}, "impact",
     True, True),
    # tan(0.4) = 0.423 < 0.6: static friction holds more than dynamic
    (BLOCK, {"SLOPE": 0.4, "FRICTION": "{static: 2*mu, dynamic: mu}"}, "sticks",
     True, True),
    (BLOCK, {"SLOPE": 0.4, "FRICTION": "{static: 2*mu, dynamic: mu}",
             "START": "{x: 0, y: 0, x_dot: 0.1}"}, "slides", True, True),
    (SLIPS, {"PULL": 2.0}, "sticks", True, True),
    (SLIPS, {"PULL": 2.2}, "slides", True, True),
    (WHEEL, {"SPEED": 3 * (1 + 1e-13)}, "sticks", True, True),
    (WHEEL, {"SPEED": 3 * (1 + 1e-11)}, "slides", True, True),
    (SPHERE, {"SPEED": 0.999 * BORDER}, "closed", True, True),
    (SPHERE, {"SPEED": 1.001 * BORDER}, "open", True, False),
    (SHAFTS, {"LAW": FREEWHEEL, "PULL": 1.0}, "engaged", True, True),
    (SHAFTS, {"LAW": FREEWHEEL, "PULL": -1.0}, "free", True, False),
    (SHAFTS, {"LAW": FREEWHEEL, "PULL": 1.0, "SPEED": -1.0}, "free", False, False),
    (SHAFTS, {"LAW": LIMITED, "PULL": 3.9}, "sticks", True, True),
    (SHAFTS, {"LAW": LIMITED, "PULL": 4.1}, "slides", True, False),
    (SHAFTS, {"LAW": LIMITED, "PULL": -4.1}, "slides", True, False),
    (SHAFTS, {"LAW": LIMITED, "SPEED": 0.1}, "slides", True, False),
    (SHAFTS, {"LAW": LIMITED.replace("F}", "F, when: t > T}")}, "out of force",
     False, False),
    (SHAFTS, {"LAW": TIMED.replace("CONDITION", "<")}, "in force", True, True),
    (SHAFTS, {"LAW": TIMED.replace("CONDITION", ">"), "SPEED": 1.0}, "out of force",
     False, False),
    (TAKEN, {"LAW": "t < 1", "START": "0"}, "closed", True, True),
    (TAKEN, {"LAW": "t > 1", "START": "0"}, "out of force", False, False),
    (TAKEN, {"LAW": "t > 1", "START": "-1"}, "out of force", False, False),
]  # fmt: skip
# Equalities that hold take a freedom, contacts and freewheels none.
TAKES = {"sticks": (SHAFTS,), "in force": (SHAFTS,)}


@pytest.mark.parametrize(("text", "values", "mode", "active", "holds"), MODES)
def test_what_a_law_does(text, values, mode, active, holds):
    start = looked_at(text, **values)
    found = only(start)
    assert start.admissible
    assert found.satisfied
    assert (found.mode, found.active, found.holds) == (mode, active, holds)
    taken = text in TAKES.get(mode, ())
    assert start.degrees_of_freedom == len(start.state.q) - taken
    # A run begins with the rows that always hold.
    assert (start.rank, start.start.ranks.rank) == (taken, 0)


# A scene, values, and what is changed where that is too much: least in the metric of M.
VIOLATED = [
    # the rate is left to the impact
    (BLOCK, {"START": "{x: 1, y: -0.5, y_dot: -2}"}, {"y": 0.0}),
    (SHAFTS, {"LAW": FREEWHEEL, "SPEED": 1.0}, {"a_dot": 0.5, "b_dot": 0.5}),
    (SHAFTS, {"LAW": TIMED.replace("CONDITION", "<"), "SPEED": 1.0},
     {"a_dot": 0.5, "b_dot": 0.5}),
    (TAKEN, {"LAW": "t < 1", "START": "-1"}, {"y": 0.0}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "values", "repair"), VIOLATED)
def test_what_is_violated_is_repaired(text, values, repair):
    start = looked_at(text, **values)
    assert not start.admissible
    assert start.repair == pytest.approx(repair, rel=1e-14)
    assert not only(start).holds


@pytest.mark.parametrize(
    ("relation", "start", "gap", "rate"),
    [
        ("y >= 0", "{x: 0, y: 0.25, y_dot: -2}", 0.25, -2.0),
        # The floor rises at 3 sin(0) + 1: the gap closes, though the block is at rest.
        ("'y >= t + 3*(1 - cos(t))'", "{x: 0, y: 0}", 0.0, -1.0),
    ],
)
def test_gap_and_its_rate(relation, start, gap, rate):
    found = only(looked_at(BLOCK.replace("y >= 0", relation), START=start))
    assert (found.position.value, found.rate.value) == (gap, rate)
    assert found.scleronomic is (relation == "y >= 0")


def test_a_gap_within_the_bound_is_closed_exactly():
    text = BLOCK.replace("y >= 0,", "y >= 1,")
    start = looked_at(text, START="{x: 0, y: 0.9999999}")
    assert start.admissible
    assert start.state.q[1] == 1.0
    assert only(start).mode == "sticks"


# The nearest point of the circle that is not below y = 0.6.
RING = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
constraints:
  ring: x^2 + y^2 = 1
  floor: {relation: y >= 0.6, restitution: 0}
initial: {x: {guess: 0.9}, y: {guess: 0.1}}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "start", "solved", "warned"),
    [
        (BLOCK, "{x: 0, y: {guess: -1}}", [0.0, 0.0], []),
        (BLOCK, "{x: 0, y: {guess: 1}}", [0.0, 1.0], ["undetermined-guess"]),
        (RING, "", [0.8, 0.6], None),
    ],
)
def test_guesses_satisfy_what_they_would_violate(text, start, solved, warned):
    found = looked_at(text, START=start)
    assert found.admissible
    assert found.state.q == pytest.approx(solved, rel=1e-14)
    assert warned is None or codes(found) == warned


@pytest.mark.slow
@pytest.mark.parametrize("law", [
    "{p: {relation: a_dot = 0, when: t < T}, q: {relation: a_dot = b_dot, when: t<1}}",
    "{p: {relation: b = 0, when: t < T}, q: 3*a_dot + 0.7*b_dot = 0}",
])  # fmt: skip
def test_guessed_velocities_at_rest_are_0_and_no_impact(law):
    text = SHAFTS.replace("{c: LAW}", law).replace(" b: 0,", " b: {guess: 0.3},")
    text = text.replace("SPEED, b_dot: 0", "{guess: 0.5}, b_dot: {guess: 0.2}")
    assert looked_at(text).state.v.tolist() == [0.0, 0.0]
    done = run(filled(text) + "simulation: {duration: 0.2, output_step: 0.1}\n")
    assert not done.trajectory.events


# A mass that starts on its floor, or at rest, but for the rounding of sin(pi).
ROUNDED = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {c: LAW}
initial: {x: 0, y: HEIGHT, x_dot: 1, y_dot: SPEED}
simulation: {duration: 0.2, output_step: 0.1}
"""
FLOOR = "{relation: y >= 0, restitution: 0.5}"


@pytest.mark.parametrize(("law", "height", "speed"), [
    (FLOOR, "sin(pi)", "0"), (FLOOR, "-sin(pi)", "0"), (FLOOR, "0", "sin(pi)"),
    (FLOOR, "sin(pi)", "0.1 + 0.2 - 0.3"),
    ("{relation: y >= 0.1*x, restitution: 0}", "sin(pi)", "0.1 + sin(pi)"),
    ("{relation: y = 0, when: t < 1}", "sin(pi)", "-sin(pi)"),
    ("{relation: y_dot = 0, when: t < 1}", "0", "-sin(pi)"),
    ("{relation: y_dot = 0, limit: 20}", "0", "-sin(pi)"),
    ("y_dot >= 0", "0", "-sin(pi)"),
])  # fmt: skip
def test_a_law_that_holds_but_for_rounding_begins_without_events(law, height, speed):
    text = ROUNDED.replace("LAW", law).replace("HEIGHT", height)
    done = run(text.replace("SPEED", speed))
    assert not done.trajectory.events
    slope = 0.1 if "0.1*x" in law else 0.0
    assert done["y"] == pytest.approx(slope * done["x"], abs=2e-16)


def test_coordinates_without_inertia_are_not_held_by_a_contact():
    text = BLOCK.replace("(x_dot^2 + y_dot^2)/2", "x_dot^2/2")
    with refused("no-inertia", "coordinate y"):
        looked_at(text)


def test_a_timed_equality_beside_rows_that_always_hold():
    law = "{c: {relation: a = b, when: t < T}, d: 2*a = 2*b}"
    start = looked_at(SHAFTS.replace("{c: LAW}", law))
    assert [v.name for v in start.verdicts] == ["c", "d"]
    assert [v.redundant for v in start.verdicts] == [False, True]
    assert start.start.ranks.rank == 1
    assert start.start.ranks.dependences == ()


def test_a_gap_that_is_open_needs_no_rate():
    # hypot has no gradient at the pivot, where a slack string begins.
    text = RING.replace("ring: x^2 + y^2 = 1\n", "")
    text = text.replace(
        "floor: {relation: y >= 0.6", 'floor: {relation: "hypot(x, y) <= 1"'
    )
    text = text.replace("x: {guess: 0.9}, y: {guess: 0.1}", "x: 0, y: 0, x_dot: 0.3")
    assert judged(text).admissible
