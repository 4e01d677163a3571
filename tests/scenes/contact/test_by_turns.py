"""Two bodies that strike the ground and each other in turn, at ever shorter intervals.

The lower one bounces, the upper one does not: after its impact they go down together, a
weak spring parts them by the square of the time that this takes, and so the next
impacts follow in the square of that time, at speeds that fall by one ratio only. That
is one impact, whose order is undetermined.
"""

from itertools import pairwise

import pytest

from tests.scenes.contact.motions import G, contact, play, scene
from tests.support import run

LOW, HIGH, E, SPRING = 0.4, 1.3, 0.8, 2.0


def pair(unit, shift):
    """Bodies a little apart, in metres over `unit`, from a ground at `shift`."""
    masses = LOW * unit**2, HIGH * unit**2
    return scene(
        "x z",
        f"{masses[0]}*x_dot^2/2 + {masses[1]}*z_dot^2/2",
        f"{masses[0]}*g*(x - {shift}) + {masses[1]}*g*(z - {shift})"
        f" + {SPRING * unit**2}*(z - x - {1 / unit})^2/2",
        {
            "ground": contact(f"x - {shift} >= 0", E),
            "between": contact(f"z - x - {0.5 / unit} >= 0", 0),
        },
        {
            "x": shift + 0.1 / unit, "z": shift + 0.62 / unit,
        },
        parameters={"g": G / unit}, duration=0.4, output_step=0.05,
    )  # fmt: skip


@pytest.mark.parametrize("shift", [0.0, 1e4, 1e7])
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_strikes_in_no_time_are_one_impact_in_all_words(unit, shift):
    found = play(pair(unit, shift / unit))
    assert "impact-order" in [w.code for w in found.result.warnings]
    strikes = [e for e in found.result.events if e.kind == "impact"]
    one = next(a.time for a, b in pairwise(strikes) if a.time == b.time)
    rates = {
        e.constraint: (e.rate_before, e.rate_after) for e in strikes if e.time == one
    }
    # By turns, each time at the rate that is left to both together.
    former = [
        e.rate_before for e in strikes if e.constraint == "ground" and e.time < one
    ]
    ratio = (HIGH - E * LOW) / (LOW + HIGH)
    assert rates["ground"][0] == pytest.approx(ratio * former[-1], rel=1e-2)
    # In the end as one: the lower one bounces, with the upper one on it.
    assert rates["ground"][1] == pytest.approx(-E * rates["ground"][0])
    assert rates["between"][1] == pytest.approx(0.0, abs=1e-9 / unit)
    assert not [
        e for e in found.result.events if e.kind == "zeno" and e.time < one + 1e-3
    ]


@pytest.mark.slow
def test_what_bounces_hardly_faster_than_it_turns_comes_to_rest():
    """A ball on one that bounces without loss: a push parts them slowly, in turn."""
    found = run("""
coordinates: {x: {}, z: {}}
energy: {kinetic: 0.814*x_dot^2 + 1.265*z_dot^2, potential: 3.256*x + 5.06*z}
forces: {x: "2.643*sin(4.42*t)"}
constraints:
  floor: {relation: x >= 0.25, restitution: 1}
  between: {relation: z - x >= 0.5, restitution: 0}
initial: {x: 0.516, z: 1.341, x_dot: -1.112, z_dot: -0.063}
simulation: {duration: 2, output_step: 0.1}
""")
    assert found.trajectory.event_counts["impact"] < 100


@pytest.mark.slow
def test_impacts_that_accumulate_beside_dry_friction_come_to_rest():
    """A pushes B (a freewheel), B a ball that bounces on a table.

    The push of at most 3.832 and the spring's 0.3 do not lift the ball of 6.337.
    """
    found = play(scene(
        "a b x", "(0.802*a_dot^2 + 0.482*b_dot^2 + 0.646*x_dot^2)/2",
        "1.952*b^2/2 + 6.33726*x",
        {
            "drive": {"relation": "b_dot - a_dot >= 0"},
            "table": contact("x >= 0", 0.618),
            "push": contact("x - b - 0.155 >= 0", 0),
        },
        {"a": 0, "b": 0, "x": 0.437, "a_dot": -1.053, "b_dot": -0.936, "x_dot": 1.145},
        forces={"a": "3.832*sin(3.886*t) - 2.27768*sign(a_dot)"}, duration=2,
    ))  # fmt: skip
    assert [found[f"{q}_dot"][-1] for q in "abx"] == pytest.approx([0, 0, 0], abs=1e-9)
    assert [found[q][-1] for q in "bx"] == pytest.approx([-0.155, 0.0], abs=1e-9)
