"""Impulses of equalities, contacts and events at one instant, by closed forms.

A jump of velocities is the least change in the metric of M onto the equalities, as if
these were eliminated. Contacts answer the velocities after it.
"""

import pytest

import lagsim

AFTER = "simulation: {duration: 1.25, output_step: 0.25}"


def after(text, *names, t=1.0):
    """Return the columns `names` in the second of the two rows at a jump at t."""
    found = lagsim.simulate(text + AFTER, error_bar="never")
    assert found.outcome == "done", found.reason
    at = abs(found.t - t) < 1e-9
    assert at.sum() == 2
    return [float(found[name][at][-1]) for name in names]


def plane(constraints, start):
    return f"""
    coordinates: {{x: {{}}, y: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}}
    constraints: {{{constraints}}}
    initial: {{{start}}}
    """


AT_REST = "x: 0, x_dot: 0, y: 0, y_dot: {guess: 0}"


@pytest.mark.parametrize(
    ("e", "sign", "x", "y"),
    [(0, "+", 0.5, 0.5), (0, "-", 1, 0), (0.5, "-", 1.25, 0.25)],
)
def test_a_floor_answers_the_jump_of_a_rate_and_does_not_hold_down(e, sign, x, y):
    # (0, 0) is projected onto x' + y' = 1, or x' - y' = 1: (1/2, 1/2) leaves the floor;
    # (1/2, -1/2) strikes it, where y' becomes e/2 and x' follows by the equality.
    floor = f"floor: {{relation: y >= 0, restitution: {e}}}"
    text = plane(f'{floor}, drive: "x_dot {sign} y_dot = if(t < 1, 0, 1)"', AT_REST)
    assert after(text, "x_dot", "y_dot") == pytest.approx([x, y], abs=1e-9)


@pytest.mark.parametrize("e", [0, 0.5])
@pytest.mark.parametrize("drive", ["z_dot = if(t < 1, 0, 1)", "z = max(0, t - 1)", ""])
def test_a_ball_on_a_piston_whose_speed_jumps(e, drive):
    # The piston as a coordinate that is driven, or as a term of t in the gap.
    law = f"restitution: {e}"
    text = f"""
    coordinates: {{x: {{}}, z: {{}}}}
    energy: {{kinetic: (x_dot^2 + z_dot^2)/2, potential: 9.81*x}}
    constraints: {{head: {{relation: x >= z, {law}}}, drive: "{drive}"}}
    initial: {{x: 0, x_dot: 0, z: {{guess: 0}}, z_dot: {{guess: 0}}}}
    """
    if not drive:
        text = f"""
        coordinates: {{x: {{}}}}
        energy: {{kinetic: x_dot^2/2, potential: 9.81*x}}
        constraints: {{head: {{relation: "x >= max(0, t - 1)", {law}}}}}
        initial: {{x: 0, x_dot: 0}}
        """
    assert after(text, "x_dot") == pytest.approx([1 + e], abs=1e-9)


@pytest.mark.parametrize("e", [0, 0.5])
def test_an_impact_at_the_time_of_a_jump_of_a_rate(e):
    # y' = -1 strikes first: e, and x' = -1 - e; then x' + y' jumps from -1 to 0.
    text = f"""
    coordinates: {{x: {{}}, y: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
    constraints:
      floor: {{relation: y >= 0, restitution: {e}}}
      drive: "x_dot + y_dot = if(t < 1, -1, 0)"
    initial: {{x: 0, x_dot: 0, y: 1, y_dot: {{guess: -1}}}}
    """
    right = [-0.5 - e, 0.5 + e]
    assert after(text, "x_dot", "y_dot") == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("wall", ["x >= 0", "2*x + x^2 >= 0"])
def test_a_wall_in_the_corner_of_a_wire_turns_the_bead_back(wall):
    text = f"""
    coordinates: {{x: {{}}, y: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
    constraints: {{wire: y = abs(x)/2, wall: {{relation: "{wall}", restitution: 0.5}}}}
    initial: {{x: 1, x_dot: -1, y: 0.5, y_dot: {{guess: -0.5}}}}
    """
    assert after(text, "x_dot", "y_dot") == pytest.approx([0.5, 0.25], abs=1e-9)


def wire(k, more, start):
    """Return a bead at rest in the corner of y = k*abs(x), and a second body z."""
    return f"""
    coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*y}}
    constraints: {{wire: y = {k}*abs(x){more}
    initial: {{{AT_REST}, {start}}}
    """


@pytest.mark.slow
@pytest.mark.parametrize("k", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("e", [0, 0.5, 1])
@pytest.mark.parametrize("side", [1, -1])
def test_a_ball_strikes_a_bead_in_the_corner_of_its_wire(k, e, side):
    # Along x the bead has the mass 1 + k^2, on either side.
    m = 1 + k * k
    ball = (1 - e * m) / (1 + m)
    gap = "x - z >= 0" if side > 0 else "z - x >= 0"
    more = f', ball: {{relation: "{gap}", restitution: {e}}}}}'
    found = after(
        wire(k, more, f"z: {-side}, z_dot: {side}"), "x_dot", "y_dot", "z_dot"
    )
    right = [side * (ball + e), k * (ball + e), side * ball]
    assert found == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize(
    ("k", "kick", "x"),
    [
        (0.5, "{x: 1}", 0.8),
        (1, "{x: -1}", -0.5),
        (2, "{x: 1}", 0.2),
        (2, "{x: -1}", -0.2),
        (1, "{x: 0.3, y: -1}", 0.0),
    ],
)
def test_a_kick_of_a_bead_in_the_corner_of_its_wire(k, kick, x):
    more = f"}}\n    events: {{kick: {{at: z = 0, impulse: {kick}}}}}"
    found = after(wire(k, more, "z: -1, z_dot: 1"), "x_dot", "y_dot")
    assert found == pytest.approx([x, k * abs(x)], abs=1e-9)


@pytest.mark.parametrize("e", [0, 0.5])
def test_a_bead_is_pushed_through_the_corner_of_its_wire(e):
    # The corner leaves (1 - k^2)/(1 + k^2) of the bead's -1; then the block strikes.
    m, bead = 1.25, -0.6
    p = (1 + e) * (bead + 1) / (1 / m + 1)
    text = f"""
    coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 0}}
    constraints:
      wire: y = abs(x)/2
      push: {{relation: z - x >= 0, restitution: {e}}}
    initial: {{x: 1, x_dot: -1, y: 0.5, y_dot: {{guess: -0.5}}, z: 1, z_dot: -1}}
    """
    found = after(text, "x_dot", "z_dot")
    assert found == pytest.approx([bead - p / m, -1 + p], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("sign", "x"), [("-", -0.5), ("+", 0.5)])
def test_of_two_ways_off_a_ridge_an_impulse_takes_the_faster(sign, x):
    """Slopes 2 and 1 fall off either side of a ridge, which moves with speed 3.

    An impulse -1 along y leads onto either slope: with (0.4, -0.8) m/s onto the steep
    one, with (0.5, -0.5) m/s onto the other. The faster departure is the one that the
    run reports, to the left and to the right alike.
    """
    text = f"""
    modes: {{t1: 1}}
    coordinates: {{x: {{}}, y: {{}}}}
    energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
    constraints: {{ridge: "y = -1.5*abs(x - 3*t) {sign} 0.5*(x - 3*t)"}}
    events: {{kick: {{at: t >= t1, impulse: {{y: -1}}}}}}
    initial: {{x: 0, x_dot: 3, y: {{guess: 0}}, y_dot: {{guess: 0}}}}
    """
    assert after(text, "x_dot", "y_dot") == pytest.approx([3 + x, -0.5], abs=1e-9)
