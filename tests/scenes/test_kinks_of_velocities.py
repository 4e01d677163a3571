"""Kinks of velocity relations, `y_dot = k*abs(x_dot) + c`, with `when` and without.

Closed forms: under gravity the relation acts on x like dry friction of the bound k*g on
the mass 1 + k^2. With a force r*t along x the motion stops while r*t < k*g, rests until
r*t = k*g, and begins to slide like the third power of the time.
"""

import numpy as np
import pytest

import lagsim

K, C, R, V0, G = 0.3, -0.2, 1.4, 0.9, 9.81
# The force on the mass 1 + k^2, and the times of the stop and of the slip.
BOUND = K * G
END, STEP = 3.0, 0.05
SLOW = pytest.mark.slow

MODEL = """
parameters: {{k: 0.3, m: {m!r}, r: {r!r}, g: {g!r}, U: {U!r}, c: {c!r}, X: {place!r}}}
coordinates: {{{names}}}
energy: {{kinetic: "{kinetic}", potential: "{potential}"}}
forces: {{x: {force}}}
constraints: {{{rows}}}
initial: {{x: {x!r}, y: 0, x_dot: {U!r} + {v!r}, y_dot: k*{v!r} + {c!r}{more}}}
simulation: {{duration: {end!r}, output_step: {step!r}{method}}}
"""
SPELLINGS = (
    "y_dot = k*abs(u) + c", "y_dot - c = max(k*u, -k*u)", "y_dot = c + k*hypot(u, 0)",
    "y_dot = if(u > 0, k*u, -k*u) + c", "y_dot = if(u >= 0, k*u, -k*u) + c",
)  # fmt: skip
WHEN = {"when": "{{relation: '{}', when: t < 100}}", "always": "'{}'"}

# A limit that the forces do not reach holds like an equality.
WAYS = WHEN | {"limited": "{{relation: '{}', limit: 5*g}}"}


def times(mass, bound):
    """Return the times at which the motion stops, and at which it slides again."""
    stop = (bound - np.sqrt(bound**2 - 2 * R * mass * V0)) / R
    return stop, bound / R


def speed_and_place(t, mass, bound):
    """Return x_dot and x (rows,), of the motion from x = 0."""
    stop, slip = times(mass, bound)

    def slid(t):
        v = V0 + (R * t**2 / 2 - bound * t) / mass
        return v, V0 * t + (R * t**3 / 6 - bound * t**2 / 2) / mass

    later = np.maximum(t - slip, 0.0)
    v, x = slid(np.minimum(t, stop))
    v = np.where(t < stop, v, R * later**2 / 2 / mass)
    return v, x + R * later**3 / 6 / mass


def run(relation, when, **changes):
    """Return the run of a relation, in other units, boosted, or beside more rows."""
    own = {
        "names": "x: {}, y: {}", "kinetic": "(x_dot^2 + y_dot^2)/2", "x": 0.0,
        "potential": "g*y", "U": 0.0, "length": 1.0, "time": 1.0, "more": "",
        "method": "", "rows": "h: ROW", "m": 0.0, "force": "r*t", "end": END,
        "v": V0, "c": C, "place": 0.0,
    } | changes  # fmt: skip
    length, time = own.pop("length"), own.pop("time")
    own |= {"c": own["c"] * length / time, "v": own["v"] * length / time}
    own["end"] *= time
    text = relation.replace("u", "(x_dot - U)" if own["U"] else "x_dot")
    own["rows"] = own["rows"].replace("ROW", WAYS[when].format(text))
    model = MODEL.format(
        r=R * length / time**3, g=G * length / time**2, step=STEP * time, **own,
    )  # fmt: skip
    return lagsim.simulate(lagsim.load(model), error_bar="never")


def check(found, mass=1 + K * K, bound=BOUND, U=0.0, x=0.0, length=1.0, time=1.0):
    """Check the motion, lambda, the energy and the events with the closed forms."""
    assert found.complete
    assert {x.code for x in found.warnings} <= {"unused-parameter"}
    t = found.t / time
    v, place = speed_and_place(t, mass, bound)
    speed = length / time
    assert (found["x_dot"] - U) / speed == pytest.approx(v, abs=1e-9)
    moved = (found["x"] - x - U * found.t) / length
    assert moved == pytest.approx(place, abs=1e-9)
    assert found["y_dot"] / speed == pytest.approx(K * v + C, abs=1e-9)
    assert found["y"] / length == pytest.approx(K * (place) + C * t, abs=1e-9)
    stop, slip = times(mass, bound)
    rest = (t > stop) & (t < slip)
    assert rest.sum() > 10
    pull = found["lambda_h"][rest] * time**2 / length
    assert np.abs(pull) == pytest.approx(G, rel=1e-12)
    balance = (found["energy"] - found["work"]) / speed**2
    assert balance == pytest.approx(balance[0], abs=1e-11, rel=1e-14)
    events = [(e.kind, e.time / time) for e in found.events]
    assert [kind for kind, _ in events] == ["stick", "slip"]
    assert [at for _, at in events] == pytest.approx([stop, slip], abs=1e-6)


@pytest.mark.parametrize("when", WAYS)
@pytest.mark.parametrize("relation", SPELLINGS)
def test_the_motion_rests_at_a_kink_like_dry_friction(relation, when):
    check(run(relation, when))


@pytest.mark.parametrize("when", WAYS)
@pytest.mark.parametrize(
    "changes",
    [{"U": 3.0}, {"x": 1e3}, {"length": 1e3}, {"time": 1e-3}],
    ids=["boosted", "far", "millimetres", "milliseconds"],
)
def test_elsewhere(when, changes):
    check(run(SPELLINGS[0], when, **changes), **changes)


METHODS = {
    "when": ["dopri5", pytest.param("rk4, step: 0.002", marks=SLOW)],
    "limited": ["dopri5", pytest.param("rk4, step: 0.002", marks=SLOW)],
    "always": [
        "dopri5", *(pytest.param(x, marks=SLOW) for x in ("taylor", "radau")),
    ],
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("when", "method"), [(when, x) for when, some in METHODS.items() for x in some]
)
def test_by_other_methods(when, method):
    name = getattr(method, "values", [method])[0]
    check(run(SPELLINGS[0], when, method=f", method: {name}"))


@pytest.mark.slow
@pytest.mark.parametrize("order", ["h: ROW, MORE", "MORE, h: ROW"])
@pytest.mark.parametrize("when", WHEN)
def test_beside_other_rows(when, order):
    also = WHEN[when].format("z_dot = m*abs(x_dot) + 0.1*(y_dot - c)")
    m = 0.4
    found = run(
        SPELLINGS[0], when, m=m, rows=order.replace("MORE", f"z: {also}"),
        names="x: {}, y: {}, z: {}", kinetic="(x_dot^2 + y_dot^2 + z_dot^2)/2",
        more=", z: 0, z_dot: (m + 0.1*k)*0.9",
    )  # fmt: skip
    check(found, mass=1 + K**2 + (m + 0.1 * K) ** 2)
    limit = "rub: {relation: x_dot = 0, limit: 0.5}"
    found = run(SPELLINGS[0], when, rows=order.replace("MORE", limit))
    v, x = speed_and_place(found.t, 1 + K**2, BOUND + 0.5)
    assert found["x_dot"] == pytest.approx(v, abs=1e-9)
    assert found["x"] == pytest.approx(x, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("when", WAYS)
def test_beside_a_heavy_body_and_coupled_masses(when):
    heavy = "(x_dot^2 + y_dot^2)/2 + 5e5*z_dot^2"
    names = "x: {}, y: {}, z: {}"
    check(run(SPELLINGS[0], when, names=names, kinetic=heavy, more=", z: 0, z_dot: 1"))
    # With y_dot = k*u + c: (1 + 2 b k + k^2) u_dot = r t - k g on the upper side.
    coupled = "(x_dot^2 + y_dot^2)/2 + 0.2*x_dot*y_dot"
    found = run(SPELLINGS[0], when, kinetic=coupled)
    stop, slip = times(1 + 0.4 * K + K**2, BOUND)
    rest = (found.t > stop) & (found.t < slip)
    assert found["y_dot"][rest] == pytest.approx(C, abs=1e-12)
    assert np.abs(found["lambda_h"][rest]) == pytest.approx(G, rel=1e-12)
    assert [e.time for e in found.events] == pytest.approx([stop, slip], abs=1e-6)


LIMIT = "{{relation: '{} = 0', limit: 1}}"
LIMITED = """
parameters: {{g: 9.81, k: {k}}}
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: g*(y + z)}}
forces: {{x: {force}}}
constraints: {{{rows}}}
initial: {{x: 0, x_dot: {v}, y: 0, y_dot: {w}, z: 0, z_dot: {{guess: 0}}}}
simulation: {{duration: 3, output_step: 0.1}}
"""


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("also", ["k*abs(x_dot), limit: 30", "k*abs(x_dot)", ""])
def test_a_limit_with_a_kink_rests_slides_and_rests_beside_others(also, order):
    # A limit of 5 < g slides: its force on x is dry friction of the bound 5 k; a second
    # relation that holds adds k g.
    rows = ["h: {relation: 'y_dot = k*abs(x_dot)', limit: 5}"]
    if also:
        rows.append(f"s: {{relation: z_dot = {also}}}")
    rows = ", ".join(rows[::order])
    text = LIMITED.format(k=K, force="r*t".replace("r", str(R)), rows=rows, v=0, w=0)
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete, found.reason
    bound, mass = K * (5 + G * bool(also)), 1 + K * K * bool(also)
    t, slip = found.t, bound / R
    later = np.maximum(t - slip, 0.0)
    assert found["x_dot"] == pytest.approx(R * later**2 / 2 / mass, abs=1e-9)
    assert found["x"] == pytest.approx(R * later**3 / 6 / mass, abs=1e-9)
    assert found["y_dot"] == pytest.approx((5 - G) * t, abs=1e-9)
    assert found["lambda_h"] == pytest.approx(5, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, -1])
def test_a_limit_with_a_kink_rests_beside_a_limit_of_its_argument(order):
    # Dry friction of the bounds k g and 1 on one velocity.
    rows = ["h: {relation: 'y_dot = k*abs(x_dot)', limit: 20}"]
    rows = ", ".join([*rows, "s: {relation: x_dot = 0, limit: 1}"][::order])
    text = LIMITED.format(k=K, force="2*t", rows=rows, v=0, w=0)
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete, found.reason
    later = np.maximum(found.t - (K * G + 1) / 2, 0.0)
    assert found["x_dot"] == pytest.approx(later**2 / (1 + K * K), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("relation", [SPELLINGS[0], SPELLINGS[3]])
@pytest.mark.parametrize("when", WHEN)
@pytest.mark.parametrize(
    ("e", "order"), [(0.0, 1), (0.0, -1), (0.2, 1), (-0.4, 1), (-0.4, -1)]
)
def test_an_equality_with_a_kink_rests_beside_a_limit(relation, when, e, order):
    # A limit of 1 on x' + e y'; on the upper side its force 1 + k e acts along x.
    text = relation.replace("u", "x_dot").removesuffix(" + c")
    rows = ["h: " + WHEN[when].format(text), f"s: {LIMIT.format(f'x_dot + {e}*y_dot')}"]
    rows = ", ".join(rows[::order])
    text = LIMITED.format(k=K, force="2*t", rows=rows, v=0, w=0)
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete, found.reason
    slip = (1 + K * (G + e)) / 2
    later = np.maximum(found.t - slip, 0.0)
    assert found["x_dot"] == pytest.approx(later**2 / (1 + K * K), abs=1e-9)
    assert found["y_dot"] == pytest.approx(K * later**2 / (1 + K * K), abs=1e-9)
    assert found.events[-1].time == pytest.approx(slip, abs=1e-9)


@pytest.mark.parametrize("limit", [20, 5])
@pytest.mark.parametrize("when", ["", ", when: t < 9"])
@pytest.mark.parametrize("slope", ["k*sign(x)*x_dot", "k*if(x > 0, x_dot, -x_dot)"])
def test_a_limit_with_a_kink_of_positions_rests_and_slides(limit, when, slope):
    # Dry friction of the bound k min(g, limit), on the mass 1 + k^2 if the limit holds.
    rows = f"h: {{relation: 'y_dot = {slope}', limit: {limit}{when}}}"
    text = LIMITED.format(k=K, force="2*t", rows=rows, v=0, w=0)
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete, found.reason
    pull, mass = min(G, limit), 1 + K * K * (limit > G)
    later = np.maximum(found.t - K * pull / 2, 0.0)
    assert found["x_dot"] == pytest.approx(later**2 / mass, abs=1e-9)


@pytest.mark.parametrize("v", [1.0, -1.0])
def test_a_limit_with_a_kink_stops_a_motion(v):
    # Holding: g k along x, mass 1 + k^2, up to the rest at 0.
    rows = "h: {relation: y_dot = k*abs(x_dot), limit: 20}"
    text = LIMITED.format(k=K, force=0, rows=rows, v=v, w=K)
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete, found.reason
    speed = np.maximum(1 - K * G * found.t / (1 + K * K), 0.0)
    assert found["x_dot"] == pytest.approx(v * speed, abs=1e-9)
    assert found["y_dot"] == pytest.approx(K * speed, abs=1e-9)


def test_both_sides_of_a_ridge_lead_away_from_it():
    # k < 0: the weight pushes away from the kink on both sides, which is reported.
    rows = "h: {relation: y_dot = k*abs(x_dot), limit: 20}"
    text = LIMITED.format(k=-K, force="0.1*t", rows=rows, v=0, w=0)
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete, found.reason
    assert "unresolved-switch" in {x.code for x in found.warnings}
    way = np.sign(found["x_dot"][-1])
    moved = (way * K * G * found.t + 0.05 * found.t**2) / (1 + K * K)
    assert found["x_dot"] == pytest.approx(moved, abs=1e-9)


@pytest.mark.parametrize("force", ["1.2", "r*t"])
@pytest.mark.parametrize("relation", ["y_dot = k*abs(x_dot)", "y = k*abs(x)"])
def test_the_relation_ends_while_the_motion_rests_at_its_kink(relation, force):
    rows = f"h: {{relation: {relation}, when: t < 1.5}}"
    text = {"v": 0.0, "c": 0.0, "rows": rows, "force": force, "end": 2.0}
    found = run(SPELLINGS[0], "when", **text)
    t = found.t
    assert {x.code for x in found.warnings} <= {"unused-parameter"}
    later = np.maximum(t - 1.5, 0.0)
    pushed = {"1.2": 1.2 * later, "r*t": R * (np.maximum(t, 1.5) ** 2 - 1.5**2) / 2}
    assert found["x_dot"] == pytest.approx(pushed[force], abs=1e-9)
    assert found["y_dot"] == pytest.approx(-G * later, abs=1e-9)
    assert np.abs(found["lambda_h"][t < 1.5]) == pytest.approx(G, rel=1e-12)
    assert sum(e.kind in ("switch", "stick", "slip") for e in found.events) <= 3


@pytest.mark.parametrize("when", WHEN)
@pytest.mark.parametrize("force", ["0", "r*t"])
@pytest.mark.parametrize("X", [0.0, 3.0])
def test_a_groove_holds_a_bead_until_the_force_exceeds_its_slope(when, force, X):
    row = WHEN[when].format("y = k*abs(x - X)" if X else "y = k*abs(x)")
    text = {"v": 0.0, "rows": f"h: {row}", "force": force, "x": X, "c": 0.0}
    found = run(SPELLINGS[0], when, place=X, **text)
    assert {x.code for x in found.warnings} <= {"unused-parameter"}
    later = np.maximum(found.t - BOUND / R, 0.0) * (force != "0")
    assert found["x"] - X == pytest.approx(R * later**3 / 6 / (1 + K**2), abs=1e-9)
    assert found["y"] == pytest.approx(K * (found["x"] - X), abs=1e-9)
    rest = later == 0.0
    assert np.abs(found["lambda_h"][rest]) == pytest.approx(G, rel=1e-9)


@pytest.mark.slow
def test_unequal_sides():
    # Upwards like friction of k g; the side below, steeper, is never reached.
    check(run("y_dot = if(u > 0, k*u, -2*k*u) + c", "when"))
    check(run("y_dot = if(u > 0, k*u, -2*k*u) + c", "always"))


GROOVE = """
coordinates: {{x: {{}}, y: {{}}{names}}}
energy: {{kinetic: "(x_dot^2 + y_dot^2)/2{kinetic}", potential: "9.81*y{potential}"}}
constraints: {{h: {h}, {other}}}
initial: {{x: {x}, y: {x}/2{start}}}
forces: {{x: {force}}}
simulation: {{duration: 2.5, output_step: 0.05}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("when", WHEN)
def test_two_relations_with_one_kink(when):
    h, g = (WHEN[when].format(x) for x in ("y = abs(x)/2", "z = 0.2*abs(x) + 0.1*y"))
    text = GROOVE.format(
        names=", z: {}", kinetic=" + z_dot^2/2", potential=" + 3*z", h=h,
        other=f"g: {g}", x=0.3, start=", z: 0.075", force=0,
    )  # fmt: skip
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert not found.warnings
    assert all(np.isfinite(found[name]).all() for name in found.columns)
    # With z = x/4 on the mass 1 + 1/4 + 1/16; each passage shrinks by `ratio`.
    square = 0.25 + 0.0625
    pull, ratio = (9.81 * 0.5 + 3 * 0.25) / (1 + square), (1 - square) / (1 + square)
    first = np.sqrt(2 * 0.3 / pull)
    end = first * (1 + 2 * ratio / (1 - ratio))
    assert found.events[-1].time == pytest.approx(end, abs=1e-6)
    rest = found.t > end + 1e-6
    assert np.max(np.abs(found["x"][rest])) < 1e-12
    assert np.abs(found["lambda_g"][rest]) == pytest.approx(3.0, rel=1e-9)
    assert np.abs(found["lambda_h"][rest]) == pytest.approx(9.81 + 0.3, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("when", WHEN)
def test_a_limit_beside_a_groove(when):
    # Both hold x: the bead rests until the force exceeds the slope and the limit.
    text = GROOVE.format(
        names="", kinetic="", potential="", h=WHEN[when].format("y = abs(x)/2"),
        other="rub: {relation: x_dot = 0, limit: 0.3}", x=0.0, start="", force="6*t",
    )  # fmt: skip
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete
    later = np.maximum(found.t - (9.81 * 0.5 + 0.3) / 6, 0.0)
    assert found["x"] == pytest.approx(later**3 / 1.25, abs=1e-9)
    assert found["y"] == pytest.approx(later**3 / 2.5, abs=1e-9)


WALL = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
constraints:
  h: {h}
  wall: {{relation: x >= 0, restitution: 0.5, restitution_law: {law}}}
initial: {{x: 0.5, x_dot: -1, y: 0, y_dot: {w}}}
simulation: {{duration: 1, output_step: 0.1}}
"""


@pytest.mark.parametrize("c", [-0.2, 0.2])
@pytest.mark.parametrize("when", WHEN)
@pytest.mark.parametrize("law", ["newton", "poisson"])
def test_an_impact_passes_a_kink(law, when, c):
    # The mass along x is 1 + 0.1^2 below x' = c, and 1 + 0.5^2 above. By Poisson's law
    # the impulse of the expansion is half of that of the compression to x' = 0.
    low, high = 1.01, 1.25
    row = WHEN[when].format(f"y_dot = if(x_dot > {c}, 0.5, -0.1)*(x_dot - {c})")
    text = WALL.format(h=row, law=law, w=0.1 * (1 + c))
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete, found.reason
    compression = low * (1 + min(c, 0)) - high * min(c, 0)
    left = compression / 2 - low * max(c, 0)
    right = max(c, 0) + left / high if law == "poisson" else 0.5
    assert found["x_dot"][-1] == pytest.approx(right, rel=1e-12)
    assert found["y_dot"][-1] == pytest.approx(0.5 * (right - c), rel=1e-12)


def test_an_impact_that_leaves_a_curve_of_velocities_ends_the_run():
    # y' = 0.3 x'^2 is smooth: one row gives the impulses, and no kink divides them.
    row = WHEN["when"].format("y_dot = 0.3*x_dot^2")
    text = WALL.format(h=row, law="newton", w=0.3)
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert not found.complete
    assert found.reason.startswith("constraint `h` is not satisfied at t = 0.5")


@pytest.mark.parametrize("relation", ["0.3*x_dot^2", "0.3*abs(x_dot)"])
@pytest.mark.parametrize("when", WHEN)
def test_moreau_has_no_impacts_along_curves_of_velocities(relation, when):
    row = WHEN[when].format(f"y_dot = {relation}")
    text = WALL.format(h=row, law="newton", w=0.3)
    text = text.replace("0.1}", "0.1, method: moreau, step: 0.01}")
    with pytest.raises(lagsim.InputError, match="the curve of velocities of `h`"):
        lagsim.simulate(lagsim.load(text))
