"""Shipped models, and some with switches, in other forms: their motion is unchanged.

Elsewhere, moving, in other units, later, beside other bodies, in another order.
"""

import functools
from dataclasses import replace

import numpy as np
import pytest

from tests.invariance import transforms as put
from tests.invariance.same import (
    CHANGES,
    EPS,
    GLOBAL,
    ROUNDINGS,
    STEPS,
    Change,
    differs,
    known,
)
from tests.invariance.transforms import document
from tests.support import MODELS, SHIPPED, at_outputs, run, shipped
from tests.written import is_expanded, written

# A million ranges from the origin: 2^-53 of that is 1e-10 of a range.
FAR = 1e6
HARDER = CHANGES | {
    "far": Change(lambda m, s: put.replaced(m, far=s.far(m, FAR)), FAR),
    "beside-two": Change(
        lambda m, s: put.with_bystander(m, 1e12, -1e6 * s.length, 1e4 * s.speed)
    ),
}
SCENES = {
    # Play of a spring, and rubbing.
    "dead-zone": """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: "-4*(x - max(-0.3, min(0.3, x))) - 0.05*sign(x_dot)"}
initial: {x: 1, x_dot: 0.2}
simulation: {duration: 20, output_step: 0.05}
""",
    # To the origin in the least time, and rest there.
    "bang-bang": """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: "-sign(x + x_dot*abs(x_dot)/2)"}
initial: {x: 1, x_dot: 0.5}
simulation: {duration: 4, output_step: 0.02}
""",
    # A block on a belt that runs evenly, on a spring, with friction that weakens.
    "belt": """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
forces: {x: "-(0.4 + 0.6/(1 + abs(x_dot - 0.5)))*sign(x_dot - 0.5)"}
initial: {x: 0.1, x_dot: 0}
simulation: {duration: 12, output_step: 0.05}
""",
    # A ball falls onto an elastic floor that damps.
    "floor": """
coordinates: {y: {}}
energy: {kinetic: y_dot^2/2, potential: 9.81*y}
forces: {y: "if(y < 0, -4000*y - 20*y_dot, 0)"}
initial: {y: 0.5, y_dot: 0.3}
simulation: {duration: 2, output_step: 0.01}
""",
    # A block on a block on the ground: both rub.
    "two-blocks": """
coordinates: {x: {}, y: {}}
energy: {kinetic: "(2*x_dot^2 + y_dot^2)/2", potential: "8*x^2"}
forces: {x: "-0.9*sign(x_dot) + 0.7*sign(y_dot - x_dot)",
  y: "-0.7*sign(y_dot - x_dot)"}
initial: {x: 1, y: 0, x_dot: 0, y_dot: 0.4}
simulation: {duration: 8, output_step: 0.02}
""",
    # A pendulum whose cart rubs: friction beside a constraint.
    "crane": """
coordinates: {c: {}, x: {}, y: {}}
energy: {kinetic: "5*c_dot^2/2 + (x_dot^2 + y_dot^2)/2", potential: 9.81*y}
forces: {c: -1.5*sign(c_dot)}
constraints: {rod: "(x - c)^2 + y^2 = 1"}
initial: {c: 0, x: 0.8, y: -0.6, c_dot: 0, x_dot: 0, y_dot: 0}
simulation: {duration: 4, output_step: 0.02}
""",
    # A sphere with spin that bounces, slips, rolls and comes to rest.
    "bounces": """
coordinates: {x: {}, y: {}, phi: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2 + 0.002*phi_dot^2, potential: 9.81*y}
constraints:
  floor: {relation: y >= 0.1, restitution: 0.6, friction: 0.2, slip: x_dot + phi_dot/10}
initial: {x: 0, y: 1, phi: 0, phi_dot: 50}
simulation: {duration: 2, output_step: 0.02}
""",
}
QUICK = [
    ("pendulum-cartesian", "shifted"), ("elastic-pendulum", "boosted"),
    ("elastic-pendulum", "beside-a-planet"), ("dry-friction", "microseconds"),
    ("chaplygin-sleigh", "metres"), ("charged-particle", "later"),
    # What needs more than a name in common with the change.
    ("belt", "beside-a-planet"), ("two-blocks", "far"), ("crane", "beside-a-planet"),
    ("bang-bang", "boosted"), ("floor", "beside-two"), ("dead-zone", "later"),
    ("bounces", "far"), ("bounces", "boosted"), ("bounces", "microseconds"),
    ("bounces", "tonnes"), ("bounces", "later"),
]  # fmt: skip
# The whole motion is the same; a part of it shows that as well.
LONGEST = 500  # rows


@functools.cache
def measured(name):
    if name in SCENES:
        return known(document(SCENES[name]))
    model = document(written(MODELS / f"{name}.yaml"))
    duration = min(model.duration, LONGEST * model.output_step)
    return known(replace(model, duration=duration))


def holds(name, change):
    ratio, told = differs(measured(name), HARDER[change])
    assert ratio < 1.0, told


@pytest.mark.slow
@pytest.mark.parametrize(("name", "change"), QUICK)
def test_the_same_motion_in_other_words(name, change):
    holds(name, change)


# Of all pairs each twelfth is slow, so that each model and each change comes up, and
# the rest is for the night.
PAIRS = [
    pytest.param(
        name, change, marks=pytest.mark.nightly if (i + j) % 12 else pytest.mark.slow
    )
    for i, name in enumerate(SHIPPED)
    for j, change in enumerate(CHANGES)
]
PAIRS += [
    pytest.param(name, change, marks=pytest.mark.slow)
    for name in SCENES
    for change in HARDER
]


@pytest.mark.parametrize(("name", "change"), PAIRS)
def test_every_model_moves_the_same_in_other_words(name, change):
    holds(name, change)


FAMILIES = [name for name in SHIPPED if is_expanded(MODELS / f"{name}.yaml")]


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_a_file_written_out_moves_as_the_file_does(name):
    base = measured(name)
    model = shipped(name)
    found = run(name, duration=base.model.duration)
    rows = at_outputs(found["t"], base.model.start, base.model.output_step)
    q = np.stack([found[x.name][rows] for x in model.coordinates], axis=1)
    allowed = STEPS * base.error + ROUNDINGS * EPS * base.gain + GLOBAL * base.range
    assert np.all(np.abs(q - base.motion.q) < allowed)


@pytest.mark.parametrize(
    "unit",
    ["1e14", *(pytest.param(k, marks=pytest.mark.slow) for k in ("1e-14", "1e30"))],
)
def test_a_surface_in_units_of_its_own(unit):
    # Both blocks stick in the end: shares of rows that differ by the unit.
    slip = "sign(y_dot - x_dot)"
    other = SCENES["two-blocks"].replace(slip, f"sign({unit}*y_dot - {unit}*x_dot)")
    base, found = run(SCENES["two-blocks"]), run(other)
    kinds = [[e.kind for e in r.trajectory.events] for r in (base, found)]
    assert kinds[0] == kinds[1]
    assert found.trajectory.outcome.complete
    # Some rounding of places of size 1.
    assert np.max(np.abs(found["y"] - base["y"])) < 1e-13


SECONDS = [3e7, pytest.param(1e-9, marks=pytest.mark.slow)]


@pytest.mark.slow
@pytest.mark.parametrize("second", SECONDS)
@pytest.mark.parametrize("metre", [1.0, 1e16])
def test_no_unit_weighs_a_slider_without_mass(second, metre):
    # In years and light years, too, what its row could do to the body is no rounding.
    base = document("""
coordinates: {x: {}, s: {}}
energy: {kinetic: 0.3*x_dot^2, potential: 9*x^2 + 40*(x - s)^2}
forces: {x: "-20*min(0.1, max(-0.1, x)) - 0.2*x_dot"}
constraints: {slides: {relation: s_dot = 0, limit: 3}}
initial: {x: 0, x_dot: 2, s: 0}
simulation: {duration: 1, output_step: 0.025}
""")
    other = put.seconds(put.replaced(base, factor=metre), second)
    ours, its = run(base.text()), run(other.text())
    events, found = ours.trajectory.events, its.trajectory.events
    assert {x.kind for x in events} == {"slip", "stick", "switch"}
    assert [x.kind for x in found] == [x.kind for x in events]
    times = [x.time for x in events]
    assert [x.time * second for x in found] == pytest.approx(times, rel=1e-9)
    steps = ours.trajectory.statistics.steps
    assert abs(its.trajectory.statistics.steps - steps) <= 0.1 * steps
    rows = at_outputs(ours["t"], base.start, base.output_step)
    at = at_outputs(its["t"], other.start, other.output_step)
    for name in ("x", "s"):
        assert np.max(np.abs(its[name][at] - ours[name][rows])) < GLOBAL


@pytest.mark.slow
@pytest.mark.parametrize("second", SECONDS)
def test_a_speed_is_no_place_in_any_unit(second):
    # A block that a belt carries, and rails guide, slips where its spring pulls enough.
    base = document("""
coordinates: {x: {}, w: {}}
energy: {kinetic: 0.7*(x_dot^2 + w_dot^2), potential: 20*x^2 + 9*w^2}
constraints:
  disc: {relation: [x_dot = 0, w_dot - 0.4 = 0], limit: 2}
  brake: {relation: x_dot = 0, limit: 5}
initial: {x: -0.003, x_dot: 0, w: 0, w_dot: 0.4}
simulation: {duration: 1, output_step: 0.05}
""")
    other = put.seconds(base, second)
    ours, its = run(base.text()), run(other.text())
    slips = [x.time * second for x in its.trajectory.events if x.kind == "slip"]
    # The brake alone can bear the pull across the belt, 40 * 0.003: so the disc holds
    # until the other reaches its bound.
    assert slips == pytest.approx([2 / (18 * 0.4)], rel=1e-9)
    rows = at_outputs(ours["t"], base.start, base.output_step)
    at = at_outputs(its["t"], other.start, other.output_step)
    assert np.max(np.abs(its["w"][at] - ours["w"][rows])) < GLOBAL
