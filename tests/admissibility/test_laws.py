"""Constraints that hold at times, at the start: closed forms say what each does."""

from __future__ import annotations

import math

import pytest

from lagsim.errors import InputError
from tests.admissibility.scenes import codes, judged

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


def block(slope=0.1, start="{x: 0, y: 0}", friction="mu", **values):
    text = BLOCK.replace("SLOPE", repr(slope)).replace("START", start)
    for name, value in values.items():
        text = text.replace(f"{name}: 0.5", f"{name}: {value}")
    return text.replace("FRICTION", friction)


def looked_at(text):
    return judged(text, classify=True)


def only(start):
    (found,) = start.verdicts
    return found


class TestContacts:
    """A block on an incline: the angle of friction is atan(0.3) = 0.2915."""

    @pytest.mark.parametrize(
        ("slope", "mode"), [(0.0, "sticks"), (0.29, "sticks"), (0.293, "slides")]
    )
    def test_at_rest(self, slope, mode):
        found = only(looked_at(block(slope)))
        assert (found.active, found.holds, found.mode) == (True, True, mode)

    @pytest.mark.parametrize(
        ("start", "mode", "holds"),
        [
            ("{x: 0, y: 0, x_dot: 1e-3}", "slides", True),
            ("{x: 0, y: 0, y_dot: 1e-3}", "open", False),
            ("{x: 0, y: 1e-3}", "open", False),
            ("{x: 0, y: 0, y_dot: -1}", "impact", False),  # it bounces
        ],
    )
    def test_on_the_move(self, start, mode, holds):
        found = only(looked_at(block(start=start)))
        assert found.satisfied
        assert (found.mode, found.holds) == (mode, holds)
        assert found.active is ("y: 0," in start or "y: 0}" in start)

    def test_what_is_struck_without_a_rebound_stays(self):
        found = only(looked_at(block(start="{x: 0, y: 0, y_dot: -1}", e=0)))
        assert (found.mode, found.holds) == ("impact", True)

    def test_static_friction_holds_more_than_dynamic(self):
        text = block(0.4, friction="{static: 2*mu, dynamic: mu}")
        assert only(looked_at(text)).mode == "sticks"  # tan(0.4) = 0.423 < 0.6
        moving = text.replace("y: 0}", "y: 0, x_dot: 0.1}")
        assert only(looked_at(moving)).mode == "slides"

    def test_gap_and_its_rate(self):
        text = block(start="{x: 0, y: 0.25, y_dot: -2}")
        found = only(looked_at(text))
        assert (found.position.value, found.rate.value) == (0.25, -2.0)

    # The disc of friction, mu g = 2.943, not the square around it.
    @pytest.mark.parametrize(("pull", "mode"), [(2.0, "sticks"), (2.2, "slides")])
    def test_two_slips(self, pull, mode):
        text = """
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*y - F*(x + z)}
constraints:
  floor: {relation: y >= 0, restitution: 0, friction: 0.3, slip: [x_dot, z_dot]}
initial: {x: 0, y: 0, z: 0}
""".replace("F", repr(pull))
        assert only(looked_at(text)).mode == mode

    def test_a_moving_obstacle_counts_in_the_rate(self):
        # The floor rises at 3 sin(0) + 1: the gap closes, though the block is at rest.
        text = block().replace("y >= 0,", "'y >= t + 3*(1 - cos(t))',")
        found = only(looked_at(text))
        assert (found.rate.value, found.mode, found.scleronomic) == (
            -1.0, "impact", False,
        )  # fmt: skip

    @pytest.mark.parametrize(("off", "mode"), [(1e-13, "sticks"), (1e-11, "slides")])
    def test_a_slip_of_numbers_computed_elsewhere_is_none(self, off, mode):
        """A wheel that rolls, its rates known to 1e-12 of its motion."""
        text = """
coordinates: {x: {}, y: {}, q: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + q_dot^2)/2, potential: 9.81*y}
constraints:
  floor: {relation: y >= 0, restitution: 0, friction: 0.5, slip: x_dot - q_dot}
initial: {x: 0, y: 0, q: 0, x_dot: 3, q_dot: SPIN}
"""
        found = only(looked_at(text.replace("SPIN", repr(3 * (1 + off)))))
        assert found.mode == mode

    def test_contacts_take_no_freedom(self):
        assert looked_at(block()).degrees_of_freedom == 2

    def test_a_top_heavy_ball_leaves_the_sphere(self):
        """On a sphere of radius 1 it holds while v^2 < g cos(angle)."""
        text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {ball: {relation: 'hypot(x, y) >= 1', restitution: 0}}
initial: {x: 0.6, y: 0.8, x_dot: 0.8*SPEED, y_dot: -0.6*SPEED}
"""
        border = math.sqrt(9.81 * 0.8)
        for speed, holds in ((0.999 * border, True), (1.001 * border, False)):
            found = only(looked_at(text.replace("SPEED", repr(speed))))
            assert (found.active, found.holds) == (True, holds)

    def test_contact_beside_an_equality(self):
        """A bead of a vertical rod at rest: the other end is pressed to the floor."""
        text = """
coordinates: {x: {}, y: {}, u: {}, v: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + u_dot^2 + v_dot^2)/2, potential: 9.81*(y + v)}
constraints:
  rod: (x - u)^2 + (y - v)^2 = 1
  floor: {relation: y >= 0, restitution: 0}
initial: {x: 0, y: 0, u: 0, v: 1}
"""
        found = looked_at(text)
        assert [v.name for v in found.verdicts] == ["rod", "floor"]
        assert found.verdicts[1].mode == "closed"
        assert found.degrees_of_freedom == 3

    def test_four_legs_all_touch(self):
        text = """
coordinates: {z: {}, a: {}, b: {}}
energy: {kinetic: (z_dot^2 + a_dot^2 + b_dot^2)/2, potential: 9.81*z}
constraints:
  one: {relation: z + a + b >= 0, restitution: 0}
  two: {relation: z + a - b >= 0, restitution: 0}
  three: {relation: z - a + b >= 0, restitution: 0}
  four: {relation: z - a - b >= 0, restitution: 0}
initial: {z: 0, a: 0, b: 0}
"""
        assert {v.mode for v in looked_at(text).verdicts} == {"closed"}

    def test_the_paradox_is_told(self):
        """A rod that slides on its end: where tan(q) = 1/2, no solution past mu = 4/3.

        Its centre is at distance 1 above the end, its J is 1/3: pressing on the end,
        with friction, pushes it away at 1 + 3 sin(q)^2 -+ 3 mu sin(q) cos(q).
        """
        text = """
parameters: {mu: MU, angle: atan(0.5)}
coordinates: {x: {}, y: {}, q: {}}
definitions: {end: x - sin(q)}
energy: {kinetic: (x_dot^2 + y_dot^2 + q_dot^2/3)/2, potential: 9.81*y}
constraints:
  tip: {relation: y >= cos(q), restitution: 0, friction: mu, slip: end_dot}
initial: {x: 0, y: cos(angle), q: angle, x_dot: SPEED}
"""
        for mu, speed, jams in ((1.3, -1, False), (1.4, -1, True), (1.4, 1, False)):
            start = text.replace("MU", repr(mu)).replace("SPEED", repr(speed))
            assert ("painleve" in codes(looked_at(start))) == jams, (mu, speed)


class TestViolations:
    def test_repair_leaves_the_rate_to_the_impact(self):
        start = looked_at(block(start="{x: 1, y: -0.5, y_dot: -2}"))
        assert not start.admissible
        assert start.repair == {"y": 0.0}
        assert only(start).holds is None

    def test_a_gap_within_the_bound_is_closed_exactly(self):
        text = block(start="{x: 0, y: 0.9999999}").replace("y >= 0,", "y >= 1,")
        start = looked_at(text)
        assert start.admissible
        assert start.state.q[1] == 1.0
        assert only(start).mode == "sticks"

    def test_guesses_meet_what_they_would_violate(self):
        start = looked_at(block(start="{x: 0, y: {guess: -1}}"))
        assert start.admissible
        assert list(start.state.q) == [0.0, 0.0]
        assert not start.warnings
        # Above the floor a guess is free.
        free = looked_at(block(start="{x: 0, y: {guess: 1}}"))
        assert free.state.q[1] == 1.0
        assert codes(free) == ["undetermined-guess"]

    def test_a_guess_beside_an_equality(self):
        """The nearest point of the circle that is not below y = 0.6."""
        text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
constraints:
  ring: x^2 + y^2 = 1
  floor: {relation: y >= 0.6, restitution: 0}
initial: {x: {guess: 0.9}, y: {guess: 0.1}}
"""
        start = looked_at(text)
        assert start.admissible
        assert start.state.q == pytest.approx([0.8, 0.6], rel=1e-14)

    def test_coordinates_without_inertia_are_not_held_by_a_contact(self):
        text = block().replace("(x_dot^2 + y_dot^2)/2", "x_dot^2/2")
        with pytest.raises(InputError, match="no constraint that always holds"):
            looked_at(text)


SHAFTS = """
parameters: {F: 2, T: 0.3}
coordinates: {a: {}, b: {}}
energy: {kinetic: (a_dot^2 + b_dot^2)/2, potential: 0}
forces: {a: PULL}
constraints: {c: LAW}
initial: {a: 0, b: 0, a_dot: SPEED, b_dot: 0}
"""


def shafts(law, pull=0.0, speed=0.0):
    text = SHAFTS.replace("LAW", law).replace("PULL", repr(pull))
    return looked_at(text.replace("SPEED", repr(speed)))


class TestFreewheels:
    LAW = "b_dot >= a_dot"

    @pytest.mark.parametrize(
        ("pull", "speed", "mode"),
        [(1.0, 0.0, "engaged"), (-1.0, 0.0, "free"), (1.0, -1.0, "free")],
    )
    def test_modes(self, pull, speed, mode):
        start = shafts(self.LAW, pull, speed)
        found = only(start)
        assert start.admissible
        assert (found.kind, found.mode) == ("one-sided", mode)
        assert (found.active, found.holds) == (speed == 0.0, mode == "engaged")
        assert start.degrees_of_freedom == 2

    def test_a_negative_rate_is_not_admissible(self):
        start = shafts(self.LAW, 0.0, 1.0)
        assert not start.admissible
        # The least change in the metric of M: both take half of it.
        assert start.repair == pytest.approx({"a_dot": 0.5, "b_dot": 0.5}, rel=1e-14)


class TestLimits:
    LAW = "{relation: a_dot = b_dot, limit: F}"

    # To hold both together takes half of what pulls at one.
    @pytest.mark.parametrize(
        ("pull", "speed", "mode"),
        [
            (3.9, 0.0, "sticks"),
            (4.1, 0.0, "slides"),
            (-4.1, 0.0, "slides"),
            (0.0, 0.1, "slides"),
        ],
    )
    def test_a_slip_is_admissible_and_not_in_the_rank(self, pull, speed, mode):
        start = shafts(self.LAW, pull, speed)
        found = only(start)
        assert start.admissible
        assert (found.mode, found.holds) == (mode, mode == "sticks")
        assert found.position.value == speed
        assert start.degrees_of_freedom == (1 if mode == "sticks" else 2)
        assert (start.rank, start.start.ranks.rank) == (mode == "sticks", 0)

    def test_out_of_force(self):
        start = shafts("{relation: a_dot = b_dot, limit: F, when: t > T}")
        assert only(start).mode == "out of force"
        assert start.degrees_of_freedom == 2


class TestTimes:
    def law(self, condition, relation="a = b"):
        return f"{{relation: {relation}, when: {condition}}}"

    def test_in_force_it_is_judged(self):
        start = shafts(self.law("t < T"), speed=1.0)
        assert not start.admissible
        assert start.repair == pytest.approx({"a_dot": 0.5, "b_dot": 0.5}, rel=1e-14)
        met = shafts(self.law("t < T"))
        assert only(met).mode == "in force"
        assert met.degrees_of_freedom == 1
        # A run begins with the rows that always hold.
        assert met.start.ranks.rank == 0

    def test_out_of_force_it_is_not(self):
        start = shafts(self.law("t >= T"), speed=1.0)
        found = only(start)
        assert start.admissible
        assert (found.mode, found.active, found.holds) == ("out of force", False, False)
        assert found.velocity.value == 1.0
        assert start.degrees_of_freedom == 2

    @pytest.mark.parametrize(("condition", "mode"), [("<", "closed"), (">", "")])
    def test_contacts(self, condition, mode):
        """A floor that is taken away; below it nothing is judged when it is."""
        text = """
coordinates: {y: {}}
energy: {kinetic: y_dot^2/2, potential: 9.81*y}
constraints: {floor: {relation: y >= 0, restitution: 0, when: t < 1}}
initial: {y: START}
"""
        text = text.replace("t <", f"t {condition}")
        touching = only(looked_at(text.replace("START", "0")))
        assert touching.mode == (mode or "out of force")
        assert touching.active is bool(mode)
        below = looked_at(text.replace("START", "-1"))
        assert below.admissible is not bool(mode)

    def test_beside_rows_that_always_hold(self):
        text = SHAFTS.replace(
            "{c: LAW}", "{c: {relation: a = b, when: t < T}, d: 2*a = 2*b}"
        )
        start = looked_at(text.replace("PULL", "0").replace("SPEED", "0"))
        assert [v.name for v in start.verdicts] == ["c", "d"]
        assert [v.redundant for v in start.verdicts] == [False, True]
        assert start.start.ranks.rank == 1
        assert start.start.ranks.dependences == ()


def test_a_gap_that_is_open_needs_no_rate():
    # hypot has no gradient at the pivot, where a slack string begins.
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {string: {relation: "hypot(x, y) <= 1", restitution: 0.5}}
initial: {x: 0, y: 0, x_dot: 0.3}
simulation: {duration: 1}
"""
    assert judged(text).admissible
