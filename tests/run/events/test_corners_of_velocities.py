"""Jumps of velocities onto relations of velocities with kinks, `y_dot = k*abs(x_dot)`.

A jump is the limit of a large force in a short time: on each side of the kink a mass m
along x has the mass m (1 + k^2), and the kink holds like dry friction of the bound
k*abs(P) under an impulse P along y. The expected values are sums of such pieces.
"""

import pytest

import lagsim

K = 0.3
M = 1 + K * K
WHEN = {"when": "{{relation: '{}', when: t < 9}}", "always": "'{}'"}
TABLE = "tables: {f: {points: [[-5, 1.5], [0, 0], [1, 0.3], [2, 1.5], [5, 5.1]]}}\n"


def after(text, *names, t=0.5):
    """Return the columns `names` just after a jump at t, and the run."""
    found = lagsim.simulate(text, error_bar="never")
    assert found.outcome == "done", found.reason
    known = {"unused-parameter", "undetermined-guess"}
    assert {x.code for x in found.warnings} <= known
    at = abs(found.t - t) < 1e-9 * max(1.0, t)
    assert at.sum() == 2
    last = [float(found[name][-1]) for name in names]
    first = [float(found[name][at][-1]) for name in names]
    assert last == pytest.approx(first, abs=1e-9 * max(1.0, *map(abs, first)))
    return first, found


def scene(row, more="", *, start=0.5, force="{}", potential="0", unit=1.0, c=0.0,
          method="", kinetic="(x_dot^2 + y_dot^2)/2", y=None):  # fmt: skip
    y = (K * abs(start - c)) if y is None else y
    return f"""
parameters: {{k: {K}, c: {c * unit!r}}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: {kinetic}, potential: {potential}}}
forces: {force}
{more.format(row=row)}
initial: {{x: 0, y: 0, x_dot: {start * unit!r}, y_dot: {{guess: {y * unit!r}}}}}
simulation: {{duration: 1, output_step: 0.1{method}}}
"""


KICK = """constraints: {{g: {row}}}
modes: {{t1: 0.5}}
events: {{kick: {{at: t >= t1, impulse: {{x: X, y: Y}}}}}}
"""


@pytest.mark.parametrize("when", WHEN)
@pytest.mark.parametrize(
    ("kick", "right"),
    [
        ((-2, 0), 0.5 - 2 / M),  # past the kink
        ((-0.3, 0), 0.5 - 0.3 / M),  # not as far
        ((-2, -10), 0.0),  # the kink stops it: 2 < 10 k
        ((-4, -10), -(1 - 0.5 * M / 7) / M),  # -4 - 10 k = -7 up to the kink, then -1
        ((2, 0), 0.5 + 2 / M),
    ],
)
@pytest.mark.parametrize("kink", ["abs(u)", "max(u, -u)", "if(u >= 0, u, -u)"])
def test_a_kick_past_a_kink(when, kick, right, kink):
    row = WHEN[when].format(f"y_dot = k*({kink.replace('u', 'x_dot')})")
    text = scene(row, KICK.replace("X", str(kick[0])).replace("Y", str(kick[1])))
    assert after(text, "x_dot", "y_dot")[0] == pytest.approx([right, K * abs(right)])


@pytest.mark.slow
@pytest.mark.parametrize("when", WHEN)
@pytest.mark.parametrize("unit", [1e3, 1e-3])
def test_a_kick_past_a_kink_away_from_zero_in_other_units(when, unit):
    row = WHEN[when].format("y_dot = k*abs(x_dot - c)")
    more = KICK.replace("X", repr(-2 * unit)).replace("Y", "0")
    right = 0.5 - 2 / M
    found, _ = after(scene(row, more, unit=unit, c=0.2), "x_dot", "y_dot")
    assert found == pytest.approx([right * unit, K * abs(right - 0.2) * unit])


@pytest.mark.parametrize(
    "method", ["", "rk4, step: 0.01", pytest.param("dopri5", marks=pytest.mark.slow)]
)
def test_a_kick_past_several_knots_of_a_table_of_velocities(method):
    # Slopes 0.3 up to 1, then 1.2: 4 = (1 - 0.5) 1.09 + (2 - 1) 2.44 + (v - 2) 2.44.
    more = KICK.replace("X", "4").replace("Y", "0")
    method = method and f", method: {method}"
    text = TABLE + scene(WHEN["when"].format("y_dot = f(x_dot)"), more, method=method)
    v = 1 + (4 - 0.5 * 1.09) / 2.44
    assert after(text, "x_dot", "y_dot")[0] == pytest.approx([v, 0.3 + 1.2 * (v - 1)])


@pytest.mark.parametrize("force", [1.0, -1.0])
def test_a_relation_that_begins_to_hold_stops_the_motion_at_its_kink(force):
    # (v, -4.905), |v| = 0.5: the nearest point of y' = 0.3 abs(x') is 0.
    row = "constraints: {{g: {{relation: y_dot = k*abs(x_dot), when: t >= 0.5}}}}"
    text = scene("", row, start=0.0, force=f"{{x: {force}}}", potential="9.81*y")
    (x, y), found = after(text, "x_dot", "y_dot")
    assert x == pytest.approx(0, abs=1e-12)
    assert y == pytest.approx(0, abs=1e-12)
    assert found["x"][-1] == pytest.approx(0.125 * force, abs=1e-12)
    assert sum(e.kind in ("corner", "impact") for e in found.events) == 1


@pytest.mark.parametrize("when", WHEN)
@pytest.mark.parametrize("jump", [1.0, 3.0, -0.5, -3.0])
def test_a_prescribed_rate_jumps(when, jump):
    # An impulse along the row changes x' by -k/M times the jump, up to the kink, which
    # holds: the row of its other side leads back.
    row = WHEN[when].format(f"y_dot = k*abs(x_dot) + if(t < 0.5, 0, {jump})")
    more = "constraints: {{g: {row}}}"
    v = max(0.5 - K * jump / M, 0.0)
    found, _ = after(scene(row, more), "x_dot", "y_dot")
    assert found == pytest.approx([v, K * v + jump], abs=1e-12)


@pytest.mark.parametrize("when", WHEN)
@pytest.mark.parametrize("e", [0, 0.5, 1])
@pytest.mark.parametrize("order", ["g: {row}, WALL", "WALL, g: {row}"])
def test_a_wall_turns_the_motion_past_its_kink(when, e, order):
    row = WHEN[when].format("y_dot = k*abs(x_dot)")
    wall = f"w: {{{{relation: x >= -0.5, restitution: {e}}}}}"
    more = "constraints: {{" + order.replace("WALL", wall) + "}}"
    text = scene(row, more, start=-1.0)
    found, run = after(text, "x_dot", "y_dot")
    assert found == pytest.approx([e, K * e], abs=1e-12)
    at = run.t > 0.55
    assert run["energy"][at] == pytest.approx(e * e * M / 2, abs=1e-12)
