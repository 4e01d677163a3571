"""Several contacts at once: one law, where another could say otherwise."""

import math

import numpy as np
import pytest

from tests.scenes.contact import scenes
from tests.scenes.contact.motions import GLOBAL, G, close, contact, play, scene


def speeds(found, count):
    return [found[f"x{k}_dot"][-1] for k in range(1, count + 1)]


def warned(found):
    return [w for w in found.result.warnings if w.code == "impact-order"]


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
def test_two_balls_close_on_a_heavier_one(e):
    found = play(scenes.balls(3, [1, 0, -1], [1, 2, 1], e))
    assert speeds(found, 3) == pytest.approx([-e, 0, e], abs=1e-14)


def test_unlike_balls_close_on_one_between():
    # Both gaps open at e times the rate at which they closed; momentum is kept.
    v, m, e = [2.0, 0.5, -1.0], [1.0, 2.0, 3.0], 0.5
    found = play(scenes.balls(3, v, m, e))
    apart = [-e * (v[1] - v[0]), -e * (v[2] - v[1])]
    rows = np.array([[-1, 1, 0], [0, -1, 1], m])
    after = np.linalg.solve(rows, [*apart, np.dot(m, v)])
    assert speeds(found, 3) == pytest.approx(after, abs=1e-14)


def test_one_impact_of_one_contact_is_no_matter_of_opinion():
    found = play(scenes.balls(2, [1, 0], [1, 3], 1))
    assert speeds(found, 2) == pytest.approx([-0.5, 0.5], abs=1e-14)
    assert warned(found) == []


@pytest.mark.parametrize("where", [(0.0, 0.0), (0.1, -0.2), (0.5, 0.25)])
def test_four_legs_share_the_weight_with_the_least_norm(where):
    # N_i = m g/4 (1 +- x +- y): of all that carry the weight the shortest.
    found = play(scenes.legs(*where))
    x, y = where
    signs = {"ne": (1, 1), "nw": (-1, 1), "se": (1, -1), "sw": (-1, -1)}
    for leg, (a, b) in signs.items():
        expected = 2 * G / 4 * (1 + a * x + b * y)
        close(found[f"lambda_{leg}"], np.full(len(found.t), expected), 1e-12)
    # Once, though each arc finds it: the shares are a choice, the motion is not.
    assert [warning.code for warning in found.result.warnings] == ["shared-contact"]
    for q in ("z", "a", "b"):
        assert np.max(np.abs(found[q])) < 1e-14


BESIDE = contact("y >= 0", 0, slip="x_dot")


@pytest.mark.parametrize(
    ("beside", "code"),
    [
        (BESIDE | {"friction": 0.1}, "shared-contact"),
        (BESIDE | {"friction": 0.5}, "shared-friction"),
        ({"relation": "y_dot = 0", "limit": 5.0}, "shared-friction"),
    ],
)
def test_friction_by_forces_that_are_shared_leaves_the_motion_open(beside, code):
    # Each may bear all of the weight: it slides back by 0.1 g or by 0.5 g; beside what
    # holds the height by up to 5 N, by 0.1 (g - 5) to 0.1 (g + 5).
    one = contact("y >= 0", 0, friction=0.1, slip="x_dot")
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "g*y", {"one": one, "beside": beside},
        {"x": 0, "x_dot": 3, "y": 0}, duration=0.1, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    assert [warning.code for warning in found.result.warnings] == [code]


def test_where_the_shortest_would_pull_three_legs_carry():
    # x = 0.9, y = 0.3: a leg would get m g/4 (1 - 1.2) < 0. It gets nothing, and the
    # others what is then the only answer.
    found = play(scenes.legs(0.9, 0.3))
    weight = 2 * G
    rows = [[1, 1, 1], [1, -1, 1], [1, 1, -1]]  # force, a and b of ne, nw, se
    expected = np.linalg.solve(rows, weight * np.array([1, 0.9, 0.3]))
    assert np.all(expected > 0)
    found_now = [found[f"lambda_{leg}"][-1] for leg in ("ne", "nw", "se", "sw")]
    assert found_now == pytest.approx([*expected, 0.0], abs=1e-12 * weight)


def test_a_load_wanders_over_three_supports():
    # At -1, 0 and 1, the load at x: N_i = W (1/3 + x x_i/2) as long as no one pulls;
    # past x = 2/3 the left one has nothing, and the others W (1 - x) and W x.
    supports = {
        name: contact(f"z {place} >= 0", 0)
        for name, place in (("left", "- a"), ("middle", "+ 0*a"), ("right", "+ a"))
    }
    text = scene(
        "z a", "z_dot^2/2 + a_dot^2/8", "g*(z + 0.9*t*a)", supports, {"z": 0, "a": 0},
        duration=1, output_step=0.05,
    )  # fmt: skip
    found = play(text)
    x = 0.9 * found.t
    early = x < 2 / 3
    close(found["lambda_left"], G * np.where(early, 1 / 3 - x / 2, 0))
    close(found["lambda_middle"], G * np.where(early, 1 / 3, 1 - x))
    close(found["lambda_right"], G * np.where(early, 1 / 3 + x / 2, x))
    assert found.times("release") == []


def test_a_table_tips_over_its_edge():
    # Weight past the legs: x = 1.5. It turns about two of them: with z = -a on these,
    # (m + J) z'' = -m g + 1.5 m g for z upwards.
    found = play(scenes.legs(1.5, 0.0), duration=0.1, output_step=0.01)
    rise = 2 * G * 0.5 / (2 + 0.5)
    close(found["z"], rise * found.t**2 / 2)
    close(found["a"], -rise * found.t**2 / 2)
    assert np.max(np.abs(found["b"])) < 1e-14
    assert np.all(found["lambda_nw"] == 0.0)


def test_a_stack_falls_onto_a_floor():
    # Two blocks one on the other, both inelastic: all stops at once, and each floor
    # carries what is above.
    laws = {"floor": contact("a >= 0", 0), "joint": contact("b >= a + 1", 0)}
    text = scene(
        "a b", "a_dot^2/2 + b_dot^2", "g*(a + 2*b)", laws, {"a": 1, "b": 2},
        duration=1, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    t = math.sqrt(2 / G)
    assert found.instants("impact") == pytest.approx([t], abs=GLOBAL)
    lies = found.t > t + GLOBAL
    close(found["lambda_floor"][lies], np.full(np.sum(lies), 3 * G))
    close(found["lambda_joint"][lies], np.full(np.sum(lies), 2 * G))
    impulse = math.sqrt(2 * G)
    assert np.max(found["impulse.floor"]) == pytest.approx(3 * impulse, rel=GLOBAL)
    assert np.max(found["impulse.joint"]) == pytest.approx(2 * impulse, rel=GLOBAL)


@pytest.mark.slow
def test_the_order_of_the_file_does_not_matter():
    text = scenes.block()
    head, laws, tail = text.partition("constraints:\n")
    body, key, rest = tail.partition("initial:")
    left, right = body.split("  right:")
    turned = head + laws + "  right:" + right + left + key + rest
    one, other = play(text, duration=2), play(turned, duration=2)
    assert one.instants("impact") == pytest.approx(other.instants("impact"), abs=GLOBAL)
    close(other["th"], one["th"])


@pytest.mark.parametrize("order", ["abcd", "dcba", "cadb"])
def test_limits_that_inertia_couples_or_not(order):
    """Body a, at rest, feels c, which slides; b rests and d slides, each by itself."""
    forces = {"a": 0.2, "b": 0.3, "c": 4.0, "d": 5.0}
    laws = {
        f"rub_{x}": {"relation": f"{x}_dot = 0", "limit": 2 if x == "a" else 1}
        for x in order
    }
    found = play(scene(
        " ".join(order), "a_dot^2 + (b_dot^2 + c_dot^2 + a_dot*c_dot + 3*d_dot^2)/2",
        "0", laws, dict.fromkeys(order, 0), forces=forces, duration=1,
    ))  # fmt: skip
    for name, held in {"a": 0.5 * (4 - 1) - 0.2, "b": -0.3, "c": -1, "d": -1}.items():
        assert found[f"lambda_rub_{name}"] == pytest.approx(held, abs=1e-13)
    for name, a in {"a": 0, "b": 0, "c": 4 - 1, "d": (5 - 1) / 3}.items():
        assert found[name][-1] == pytest.approx(a / 2, abs=1e-11)
