"""A bead at rest in the corner of its wire, however the kink of the wire is written.

The reaction of one side of y = k*abs(x) holds a force F = t along x up to t = k g.
Afterwards (1 + k^2) x'' = t - k g.
"""

import pytest

import lagsim

S = "(x - {far})/{unit}"
# abs(s), in other words; tb is a table of abs. The term of z has no effect.
WORDS = [
    "max({s}, 0) + abs(min({s}, 0))",
    "abs(max({s}, 0)) - min({s}, 0)",
    "abs({s}) + abs({s} + z) - abs(z + {s})",
    "abs({s} + min(z, 0)) + abs({s}) - abs(min(z, 0) + {s})",
    "abs(abs({s}) + abs(z)) - abs(z)",
    "abs({s}) + abs(z) - max(z, -z)",
    "abs(if({s} > 0, {s}, 2*({s}))) + min({s}, 0)",
    "max({s}, abs(min({s}, 0)))",
    "2*tb({s}) - abs(abs({s}))",
    "(({s})*sign({s}) + tb(abs({s})))/2",
    "(tb({s}) + max({s}, 0) + abs(min({s}, 0)))/2",
    "abs(mod({s} + 50, 100) - 50)",
]
TABLE = "tables: {tb: {points: [[-9, 9], [0, 0], [9, 9]], outside: extend}}"


def slow(value):
    return pytest.param(value, marks=pytest.mark.slow)


@pytest.mark.parametrize("words", WORDS)
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("k", [slow(0.5), 1.0, slow(2.0)])
@pytest.mark.parametrize(
    "place",
    [
        {},
        {"unit": 1000.0, "z": (0.5, -1.0)},
        {"far": 1e5, "mass": 30.0},
        {"z": (0.3, 0.1), "heavy": True},
        slow({"options": {"method": "dopri5"}}),
        slow({"options": {"method": "rk4", "step": 0.01}}),
        slow({"options": {"method": "taylor"}, "z": (0.0, 1.0)}),
    ],
)
def test_a_kink_of_kinks_holds_a_bead_up_to_its_reaction(place, k, side, words):
    unit, far, mass = (place.get(*x) for x in (("unit", 1), ("far", 0), ("mass", 1)))
    z, speed = place.get("z", (0.0, 0.0))
    options = place.get("options", {})
    kink = words.format(s=f"({S.format(far=far, unit=unit)})")
    beside = place.get("heavy", False)
    text = f"""
{TABLE if "tb(" in kink else ""}
coordinates: {{x: {{}}, y: {{}}, z: {{}}{", h: {}" if beside else ""}}}
energy:
  kinetic: {mass}*(x_dot^2 + y_dot^2)/2 + z_dot^2/2{" + 1e6*h_dot^2" if beside else ""}
  potential: {mass * unit}*y
constraints: {{wire: "y = {k * unit}*({kink})"}}
forces: {{x: {side * mass * unit}*t}}
initial:
  {{x: {far}, x_dot: 0, y: 0, y_dot: {{guess: 0}}, z: {z}, z_dot: {speed}
  {", h: 0, h_dot: 1" if beside else ""}}}
simulation: {{duration: {k + 1}, output_step: {(k + 1) / 8}}}
"""
    found = lagsim.simulate(text, error_bar="never", **options)
    assert found.outcome == "done", found.reason
    # A step of 0.01 has an error of 1e-10; 1e5 has a rounding of 1.5e-11.
    near = {"abs": 1e-8 * unit}
    own, mass_along = found["x"][-1] - far, 1 + k * k
    assert own == pytest.approx(side * unit / 6 / mass_along, **near)
    right = side * unit / 2 / mass_along
    assert found["x_dot"][-1] == pytest.approx(right, **near)
    assert found["y"][-1] == pytest.approx(k * abs(own), **near)
