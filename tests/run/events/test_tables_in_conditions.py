"""Tables of the state in conditions and sections alone: each peak is located.

The motion is free, x = x0 + t, so that methods take steps far longer than the peaks.
"""

import numpy as np
import pytest

import lagsim

MODEL = """
coordinates: {{x: {{}}}}
tables: {{z: {{points: {points}, interpolation: {interpolation}}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
modes: {{n: 0}}
events: {{e: {{at: "{at}", set: {{n: n + 1}}}}}}
initial: {{x: {x}, x_dot: 1}}
simulation: {{duration: {duration}, output_step: 0.5}}
output: {{sections: {{s: {{at: "{section}", direction: both}}}}}}
"""


def simulated(points, at, section="x = -100", *, duration=5.0, x=0.3, **options):
    interpolation = options.pop("interpolation", "linear")
    text = MODEL.format(
        points=[[float(a), float(b)] for a, b in points], at=at, section=section,
        duration=duration, x=x, interpolation=interpolation,
    )  # fmt: skip
    found = lagsim.simulate(lagsim.load(text), error_bar="never", **options)
    assert found.complete
    return [e.time for e in found.events if e.kind == "event"], found.sections["s"]["t"]


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau", "rk4"])
@pytest.mark.parametrize("width", [0.1, 1e-2, 1e-4])
@pytest.mark.parametrize("argument", ["x", "x + 0.1*n"])
@pytest.mark.parametrize("interpolation", ["linear", "monotone"])
def test_a_narrow_peak_is_located(interpolation, argument, width, method):
    points = [[0, 0], [1, 0], [1 + width, 1], [1 + 2 * width, 0], [9, 0]]
    fixed = {"step": 0.5} if method == "rk4" else {}
    times, crossings = simulated(
        points, f"z({argument}) >= 0.5", "z(x) = 0.5", method=method,
        interpolation=interpolation, **fixed,
    )  # fmt: skip
    assert times == pytest.approx([0.7 + width / 2], abs=1e-12)
    both = [0.7 + width / 2, 0.7 + 3 * width / 2]
    assert crossings == pytest.approx(both, abs=1e-12)


@pytest.mark.parametrize("at", [
    "z(x) >= 1", "z(x) = 1", "1 - z(x) <= 0", "0.9*z(x) >= 0.9", "z(z(x)) >= 1",
    "z(x) - z(1) = 0", "z(x) - abs(x - 1) >= 1", "z(2 - x) >= 1",
])  # fmt: skip
@pytest.mark.parametrize("method", ["taylor", "radau"])
def test_a_peak_that_touches_the_level_counts(at, method):
    times, _ = simulated([[0, 0], [1, 1], [2, 0]], at, duration=1.5, method=method)
    assert times == pytest.approx([0.7], abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("at", ["z(x) >= 0.5", "z(x) >= 0.4", "x >= 100"])
def test_all_peaks_of_a_rough_table(at):
    x = np.linspace(0.0, 10.0, 2001)
    z = np.sin(3.0 * x) + 0.3 * np.random.default_rng(5).standard_normal(len(x))
    points = np.stack([x, z], axis=1).tolist()
    times, crossings = simulated(points, at, "z(x) = 0.5", x=0.0, duration=9.99)
    k = np.flatnonzero(np.diff(np.sign(z - 0.5)))
    exact = x[k] + (0.5 - z[k]) / (z[k + 1] - z[k]) * (x[k + 1] - x[k])
    assert crossings == pytest.approx(exact, abs=1e-11)
    if at == "z(x) >= 0.5":
        assert times == pytest.approx(exact[z[k] < 0.5], abs=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_section_is_crossed_again_soon_after_an_event_on_it(method):
    x = np.array([0.0, 1.0, 1.6, 2.0, 2.1, 2.3, 2.305, 2.31, 9.0])
    z = np.array([0.0, 0.3, 0.7, 0.4, 0.6, 0.4, 2.0, 0.1, 0.1])
    times, crossings = simulated(
        np.stack([x, z], axis=1).tolist(), "z(x) >= 0.5", "z(x) = 0.5", x=0.0,
        duration=8.0, method=method,
    )  # fmt: skip
    k = np.flatnonzero(np.diff(np.sign(z - 0.5)))
    exact = x[k] + (0.5 - z[k]) / (z[k + 1] - z[k]) * (x[k + 1] - x[k])
    assert times == pytest.approx(exact[::2], abs=1e-12)
    assert crossings == pytest.approx(exact, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("points", [300, 1000])
@pytest.mark.parametrize("interpolation", ["monotone", "cubic"])
@pytest.mark.parametrize("at", ["z(x) = 0.1", "x >= 100"])
def test_all_crossings_of_a_rough_smooth_table(at, interpolation, points):
    random = np.random.default_rng(points)
    x = np.cumsum(random.uniform(0.5, 1.5, points))
    x, z = 10.0 * (x - x[0]) / (x[-1] - x[0]), random.standard_normal(points)
    times, crossings = simulated(
        np.stack([x, z], axis=1), at, "z(x) = 0.1", x=0.0, duration=9.99,
        interpolation=interpolation,
    )  # fmt: skip
    k = np.flatnonzero((z[1:] > 0.1) != (z[:-1] > 0.1))
    inside = np.searchsorted(x, crossings) - 1
    k, inside = k[k < points - 9], inside[inside < points - 9]
    if interpolation == "monotone":  # one crossing between points on both sides
        assert inside.tolist() == k.tolist()
    else:  # an odd number between such points, an even one between others
        number = np.bincount(inside, minlength=points)
        assert np.flatnonzero(number % 2).tolist() == k.tolist()
    if at != "x >= 100":
        assert times == pytest.approx(crossings, abs=1e-12)
