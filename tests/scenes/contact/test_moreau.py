"""Moreau's time stepping: first order in impacts, many contacts, friction, laws."""

import math

import numpy as np
import pytest

from lagsim import InputError
from tests.scenes.contact.motions import contact, scene
from tests.scenes.contact.scenes import ball, balls, dry, incline, sphere
from tests.small_scenes import bounced
from tests.support import run, simulate

MOREAU = {"method": "moreau", "step": 0.001}


def column(count, restitution=0.0, duration=0.2):
    """Boxes of height 1 on each other, and on the ground."""
    names = [f"y{k}" for k in range(1, count + 1)]
    touching = {"c1": contact("y1 >= 0", restitution)}
    touching |= {
        f"c{k}": contact(f"y{k} >= y{k - 1} + 1", restitution)
        for k in range(2, count + 1)
    }
    return scene(
        " ".join(names),
        " + ".join(f"{y}_dot^2/2" for y in names),
        " + ".join(f"10*{y}" for y in names),
        touching, {y: k for k, y in enumerate(names)},
        duration=duration, output_step=duration / 4,
    )  # fmt: skip


def box(count, restitution, **simulation):
    """Discs of diameter 1 without friction in a square box, thrown at random."""
    side = math.ceil(math.sqrt(count))
    size, random = 1.5 * side, np.random.default_rng(1)
    names = [f"{a}{k}" for k in range(count) for a in "xy"]
    touching = {}
    for k in range(count):
        for a in "xy":
            touching[f"low_{a}{k}"] = contact(f"{a}{k} >= 1/2", restitution)
            touching[f"high_{a}{k}"] = contact(f"{a}{k} <= {size} - 1/2", restitution)
        for j in range(k):
            far = f"(x{k} - x{j})^2 + (y{k} - y{j})^2 >= 1"
            touching[f"pair_{j}_{k}"] = contact(far, restitution)
    initial = {}
    for k in range(count):
        row, col = divmod(k, side)
        for a, place in (("x", col), ("y", row)):
            initial[f"{a}{k}"] = 0.75 + 1.5 * place
            initial[f"{a}{k}_dot"] = float(random.uniform(-2.0, 2.0))
    return scene(
        " ".join(names), " + ".join(f"{x}_dot^2/2" for x in names),
        " + ".join(f"y{k}" for k in range(count)), touching, initial, **simulation,
    )  # fmt: skip


def test_the_error_of_a_bouncing_ball_goes_with_the_step():
    errors = []
    for step in (1e-2, 1e-3, 1e-4):
        text = ball(0.8, duration=1.6, output_step=0.01)
        found = run(text, method="moreau", step=step)
        errors.append(np.max(np.abs(found["y"] - bounced(found["t"], 0.8))))
        # Each of three impacts comes up to a step late, and the speed changes by 8 m/s.
        assert errors[-1] < 30 * step
        # What impacts take is in `work`; M and the force are constant, so that what is
        # left is the rounding of 20 J in up to 16000 steps.
        assert found.drift < 16000 * 20 * 2.0**-53
    # Order 1, but for where in a step an impact happens to fall.
    assert 30 < errors[0] / errors[2] < 300


@pytest.mark.parametrize("at", ["y_dot >= 0", "y <= 0", "y <= 0.1"])
def test_an_event_within_the_step_of_an_impact_does_not_stop_the_ball(at):
    text = ball(0.8, duration=1.6, output_step=0.01)
    text += f"modes: {{n: 0}}\nevents: {{hit: {{at: {at}, set: {{n: n + 1}}}}}}\n"
    found = run(text, **MOREAU)
    # Each of two impacts comes up to a step late, and the speed changes by 8 m/s.
    error = np.max(np.abs(found["y"] - bounced(found["t"], 0.8)))
    assert error < 30 * MOREAU["step"]
    assert found["n"][-1] == 2.0


def test_a_pile_at_rest_stays_and_bears_its_weight():
    found = run(column(10), **MOREAU)
    for k in range(1, 11):
        # Velocities are left at 1e-10 of h g, or as many of what it bears.
        assert np.max(np.abs(found[f"y{k}"] - (k - 1))) < 1e-10
        assert found[f"lambda_c{k}"] == pytest.approx(10.0 * (11 - k), rel=1e-6)


@pytest.mark.slow
def test_a_high_pile_is_told_where_relaxation_does_not_end():
    found = run(column(400, duration=0.002), **MOREAU)
    assert [w.code for w in found.trajectory.warnings] == ["unsettled-impulses"]
    assert not run(column(20), **MOREAU).trajectory.warnings


def test_a_cradle_is_struck_at_once():
    # All rates of gaps turn, and momentum stays: 5 u - 1 = 1.
    found = run(balls(5, [1, 0, 0, 0, 0], [1] * 5, 1.0), **MOREAU)
    rates = [found[f"x{k}_dot"][-1] for k in range(1, 6)]
    assert rates == pytest.approx([-0.6, 0.4, 0.4, 0.4, 0.4], abs=1e-8)
    assert np.ptp(found["energy"]) < 1e-8


@pytest.mark.parametrize(("angle", "mu"), [(0.3, 0.4), (0.5, 0.4)])
def test_a_block_on_an_incline_stays_or_slides(angle, mu):
    found = run(incline(angle, mu), **MOREAU)
    pull = 9.81 * max(math.sin(angle) - mu * math.cos(angle), 0.0)
    # A constant acceleration is met without error.
    assert found["s_dot"] == pytest.approx(pull * found["t"], abs=1e-9)
    normal = 3 * 9.81 * math.cos(angle)
    assert found["lambda_floor"] == pytest.approx(normal, rel=1e-9)


@pytest.mark.parametrize(("spin", "rolls"), [(50, False), (10, True)])
def test_a_spinning_ball_lands_and_rolls(spin, rolls):
    found = run(sphere(spin, duration=0.6), **MOREAU)
    # The friction of the impact is at most mu m v, and a later one at most mu m g t.
    speed = 0.2 * math.sqrt(2.0 * 9.81 * 0.9)
    late = found["t"] > math.sqrt(2.0 * 0.9 / 9.81)
    slid = speed + 0.2 * 9.81 * (found["t"][late] - math.sqrt(2.0 * 0.9 / 9.81))
    exact = -np.minimum(slid, 0.1 * spin * 2.0 / 7.0)
    assert np.max(np.abs(found["x_dot"][late][1:] - exact[1:])) < 5 * MOREAU["step"]
    assert (abs(found["x_dot"][-1] + 0.1 * found["phi_dot"][-1]) < 1e-9) == rolls


def test_dry_friction_as_a_limit_stops_for_good():
    found = run(dry(True), **MOREAU)
    exact = run(dry(True))
    assert found["x"][-1] == pytest.approx(exact["x"][-1], abs=0.1)
    assert abs(found["x_dot"][-1]) < 1e-9
    assert np.max(np.abs(found["lambda_floor"])) <= 1.0 + 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9])
def test_energy_never_grows(restitution):
    text = box(5, restitution, duration=3, output_step=0.05)
    found = run(text, method="moreau", step=0.002)
    # Five discs in 25 steps to a row: what parts more slowly than h g (g = 1) is
    # pressed back by its weight, h g, and that is all that an impulse may add.
    assert np.max(np.diff(found["energy"])) < 5 * 25 * 0.002**2 / 2
    assert found["energy"][-1] < found["energy"][0] - 0.5
    # A gap is past its end by what a step goes at most: speeds stay below 6.
    assert min(np.min(found[f"y{k}"]) for k in range(5)) > 0.5 - 6 * 0.002


def test_a_coordinate_without_mass_follows_what_it_is_tied_to():
    """It falls by both weights, x = 1 - t^2, and the ground carries both."""
    text = scene(
        "x y", "x_dot^2/2", "x + y", {"c": contact("x >= 0", 0)}, {"x": 1, "y": 1},
        duration=2, output_step=0.1,
    ).replace("constraints:", "constraints:\n  tie: {relation: y = x}", 1)  # fmt: skip
    found = run(text, **MOREAU)
    rests = found["t"] > 1.05
    assert found["x"] == pytest.approx(np.maximum(1 - found["t"] ** 2, 0), abs=0.001001)
    assert found["y"] == pytest.approx(found["x"], abs=1e-15)
    assert found["lambda_tie"] == pytest.approx(1.0)
    assert found["lambda_c"][rests] == pytest.approx(2.0)


@pytest.mark.slow
def test_hundreds_of_contacts():
    text = box(25, 0.7, duration=2, output_step=0.05)
    found = run(text, method="moreau", step=0.002)
    assert found.trajectory.outcome.word == "done"
    assert not found.trajectory.warnings
    assert np.max(np.diff(found["energy"])) < 25 * 25 * 0.002**2 / 2
    assert np.max(np.abs(found["energy"] - found["work"] - found["energy"][0])) < 1e-9


# Rows on one velocity, the least norm of whose multipliers is known: each bears in
# proportion to its factor, up to its limit; beside an equality no limit bears.
SHARED = [
    ({"a": ("x_dot = 0", 1), "b": ("x_dot = 0", 2)}, 1.2, {"a": 0.6, "b": 0.6}),
    ({"a": ("x_dot = 0", 0.4), "b": ("x_dot = 0", 2)}, 1.2, {"a": 0.4, "b": 0.8}),
    ({"a": ("x_dot = 0", 1), "b": ("-2*x_dot = 0", 2)}, 1, {"a": 0.2, "b": -0.4}),
    ({"a": ("x_dot = 0", 1), "b": ("x_dot = 0", None)}, 1.2, {"a": 0, "b": 1.2}),
    ({"a": ("x_dot = 0", None), "b": ("3*x = 0", None)}, 1, {"a": 0.1, "b": 0.3}),
    (
        {"a": ("x_dot = 0", 1), "b": ("x_dot = 0", 0.3), "c": ("x_dot = 0", 2)},
        1.3,
        {"a": 0.5, "b": 0.3, "c": 0.5},
    ),
]


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(("rows", "force", "expected"), SHARED)
def test_parallel_rows_share_a_load_by_least_norm(rows, force, expected, order):
    relations = [
        f"  {name}: {{relation: {relation}, limit: {most}}}".replace(
            ", limit: None", ""
        )
        for name, (relation, most) in rows.items()
    ][::order]
    written = "\n".join(relations)
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: {force}}}
constraints:
{written}
initial: {{x: 0}}
simulation: {{duration: 1, output_step: 0.1, method: moreau, step: 0.01}}
"""
    found = simulate(text, error_bar="never")
    for name, share in expected.items():
        assert found[f"lambda_{name}"] == pytest.approx(-share, abs=1e-9)
    assert np.max(np.abs(found["x"])) < 1e-12


HIT = """
parameters: {{h: 0.1}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*x}}
constraints: {{wall: {{relation: {gap}, restitution: 0.5}}}}
modes: {{n: 0}}
events: {{hit: {{at: {at}, set: {{n: n + 1}}}}}}
initial: {{x: 1, y: 0, y_dot: 0.1}}
simulation: {{duration: 1, output_step: 0.1, method: moreau, step: 0.01}}
"""


@pytest.mark.parametrize(
    ("at", "gap"),
    [("x = 0", "x >= 0"), ("0 = 3*h - 3*x", "x >= h"), ("x - h*y = h", "x - h*y >= h")],
)
def test_an_event_where_a_contact_closes_is_an_inequality(at, gap):
    # The body is up to one step below 0 and rises to 0 again: it is met twice.
    with pytest.raises(InputError, match="write it with <= or >="):
        simulate(HIT.format(at=at, gap=gap))


@pytest.mark.parametrize(("at", "acts"), [("x <= 0", 2), ("x = 0.3", 1), ("x = y", 3)])
def test_other_events_beside_a_contact(at, acts):
    # Falls of 1 under 9.81 end at 0.45, 0.90 (after a bounce to 0.25) and 1.13.
    found = simulate(HIT.format(at=at, gap="x >= 0"), error_bar="never")
    assert found["n"][-1] == acts
