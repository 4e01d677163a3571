"""Corners of several equalities at one place, struck, kicked and passed.

Beads run on wires y = k*f(x) with a kink f, and rods connect their x. Along x a bead of
mass m on a wire of slope k has the mass m (1 + k^2). The expected values are sums of
such masses.
"""

import pytest

import lagsim

# Kinks abs(s), in other words.
KINKS = {
    "abs": "abs({s})",
    "max": "max({s}, -({s}))",
    "two": "max({s}, 0) + max(-({s}), 0)",
    "if": "if({s} < 0, -({s}), {s})",
    "mod": "abs(mod({s} + 100, 200) - 100)",
    "floor": "({s})*(1 + 2*floor(({s})/1000))",
    "table": "corner({s})",
}
TABLE = "tables: {corner: {points: [[-9, 9], [0, 0], [9, 9]], outside: extend}}\n"


def after(text, *names, t=1.0, **options):
    """Return the columns `names` just after a jump at t."""
    found = lagsim.simulate(text, error_bar="never", **options)
    assert found.outcome == "done", found.reason
    at = abs(found.t - t) < 1e-9
    return [float(found[name][at][-1]) for name in names]


def beads(masses, slopes, kinks, more, start, *, far=0.0, rod=3.0, unit=1.0, order=1):
    """Return beads with rods at rest in the corners of their wires, and a body z.

    far : of the first corner from the origin.
    rod : the length of each rod, along x.
    unit : a length of 1, in the unit of the file.
    order : 1, or -1 for the opposite order of the constraints.
    """
    n = range(len(masses))
    places = [far + rod * unit * i for i in n]
    wires = [
        f"  wire{i}: y{i} = {slopes[i]}*"
        f"({KINKS[kinks[i]].format(s=f'(x{i} - {places[i]})/{unit}')})*{unit}"
        for i in n
    ]
    rods = [f"  rod{i}: x{i + 1} - x{i} = {rod * unit}" for i in n[:-1]]
    constraints = "\n".join([*wires, *rods, *more.get("constraints", [])][::order])
    kinetic = "+".join(f"{masses[i]}*(x{i}_dot^2 + y{i}_dot^2)/2" for i in n)
    own = "".join(
        f", x{i}: {{guess: {places[i]}}}, x{i}_dot: {{guess: 0}}"
        f", y{i}: {{guess: 0}}, y{i}_dot: {{guess: 0}}"
        for i in n[1:]
    )
    tables = TABLE if "table" in kinks else ""
    return f"""{tables}
coordinates: {{{"".join(f"x{i}: {{}}, y{i}: {{}}, " for i in n)}z: {{}}}}
energy:
  kinetic: {kinetic} + z_dot^2/2
  potential: {0.1 * unit}*({"+".join(f"{masses[i]}*y{i}" for i in n)})
constraints:
{constraints}
{more.get("events", "")}
initial: {{x0: {far}, x0_dot: 0, y0: 0, y0_dot: {{guess: 0}}{own}, {start}}}
simulation: {{duration: 1.25, output_step: 0.25}}
"""


PAIRS = [
    ((1, 0.5), ("abs", "abs")),
    ((0.5, 0.5), ("max", "abs")),
    ((2, 0.3), ("two", "if")),
    ((1, 0.5), ("two", "two")),
    ((1, 1), ("mod", "abs")),
    ((1, 0.5), ("table", "abs")),
    ((0.5, 1), ("table", "mod")),
    ((1, 0.5), ("floor", "abs")),
    ((0.5, 1, 0.3), ("abs", "max", "abs")),
]
PLACES = [
    {},
    {"order": -1},
    {"unit": 1000.0},
    {"far": 1e5},
    {"far": 1e5, "order": -1},
    {"rod": 1e4},
]


@pytest.mark.slow
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("slopes", "kinks"), PAIRS)
@pytest.mark.parametrize("place", PLACES)
def test_a_ball_strikes_beads_in_corners_at_one_place(place, slopes, kinks, side):
    masses = (1, 2, 0.5)[: len(slopes)]
    along = sum(m * (1 + k * k) for m, k in zip(masses, slopes, strict=True))
    far, unit = place.get("far", 0.0), place.get("unit", 1.0)
    gap = "x0 - z" if side > 0 else "z - x0"
    more = {"constraints": [f'  ball: {{relation: "{gap} >= 0", restitution: 0.5}}']}
    start = f"z: {far - side * unit}, z_dot: {side * unit}"
    text = beads(masses, slopes, kinks, more, start, **place)
    speed = side * unit * 1.5 / (1 + along)
    right = [speed, slopes[0] * abs(speed), slopes[1] * abs(speed)]
    found = after(text, "x0_dot", "y0_dot", "y1_dot")
    assert found == pytest.approx(right, abs=1e-9 * unit)


@pytest.mark.slow
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("slopes", "kinks"), PAIRS)
@pytest.mark.parametrize("place", PLACES)
def test_a_kick_of_beads_in_corners_at_one_place(place, slopes, kinks, side):
    masses = (1, 2, 0.5)[: len(slopes)]
    along = sum(m * (1 + k * k) for m, k in zip(masses, slopes, strict=True))
    unit = place.get("unit", 1.0)
    kick = f"events: {{kick: {{at: z = 0, impulse: {{x1: {side * unit}}}}}}}"
    start = f"z: {-unit}, z_dot: {unit}"
    text = beads(masses, slopes, kinks, {"events": kick}, start, **place)
    speed = side * unit / along
    right = [speed, slopes[0] * abs(speed), slopes[1] * abs(speed)]
    found = after(text, "x0_dot", "y0_dot", "y1_dot")
    assert found == pytest.approx(right, abs=1e-9 * unit)


def kicked(impulses):
    """Return the x_dot of beads without rods just after impulses in their corners."""
    n = range(len(impulses))
    own = (f"x{i}: {i}, x{i}_dot: 0, y{i}: 0, y{i}_dot: {{guess: 0}}" for i in n)
    kicks = ", ".join(f"x{i}: {impulse}" for i, impulse in enumerate(impulses))
    text = f"""
coordinates: {{{"".join(f"x{i}: {{}}, y{i}: {{}}, " for i in n)}z: {{}}}}
energy:
  kinetic: {"+".join(f"(x{i}_dot^2 + y{i}_dot^2)/2" for i in n)} + z_dot^2/2
  potential: 9.81*({"+".join(f"y{i}" for i in n)})
constraints: {{{", ".join(f"wire{i}: y{i} = abs(x{i} - {i})" for i in n)}}}
events: {{kick: {{at: z = 0, impulse: {{{kicks}}}}}}}
initial: {{{", ".join(own)}, z: -1, z_dot: 1}}
simulation: {{duration: 1.25, output_step: 0.25}}
"""
    return after(text, *(f"x{i}_dot" for i in n))


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 1, 2])
@pytest.mark.parametrize("count", [2, 3, 8])
def test_a_kick_of_one_of_several_beads_leaves_the_others_in_their_corners(
    count, which
):
    # The other beads have no speed on either side of their corners.
    impulses = [-1.0 * (i == min(which, count - 1)) for i in range(count)]
    assert kicked(impulses) == pytest.approx([0.5 * x for x in impulses], abs=1e-9)


@pytest.mark.parametrize("count", [3, 7, 12])
def test_kicks_of_several_beads_lead_each_to_its_own_side(count):
    # More corners than those whose sides are all combined are decided by turns.
    impulses = [(-1.0) ** (i // 2) * (1 + i) for i in range(count)]
    assert kicked(impulses) == pytest.approx([0.5 * x for x in impulses], abs=1e-9)
