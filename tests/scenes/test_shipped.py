"""Shipped models: published eigenvalues, and Newton's law for their sums."""

import functools

import numpy as np
import pytest

import lagsim
from lagsim.language.names import rate_of
from tests.support import MODELS

# --- the bicycle, against table 2 of Meijaard, Papadopoulos, Ruina and Schwab (2007)

BICYCLE = ["x", "y", "yaw", "lean", "pitch", "steer", "rear", "front"]


LATERAL = ("lean", "steer", "lean_dot", "steer_dot")


@functools.cache
def bicycle():
    return lagsim.load(MODELS / "bicycle.yaml")


def eigenvalues(v):
    """Return the eigenvalues (1/s) of the lateral motion at a speed.

    Its state has lean, steer and their rates.
    """
    model = bicycle().bind(v=v, lean_dot=0)
    start = lagsim.simulate(model, duration=0.01, output_step=0.01, error_bar="never")
    names = [q + dot for dot in ("", "_dot") for q in BICYCLE]
    z = np.array([start[name][0] for name in names])
    n = len(BICYCLE)

    def rate(z):
        return np.concatenate([z[n:], model.rhs(0.0, z[:n], z[n:])])

    def derivative(direction):  # by central differences of the fourth order
        step = 1e-4 * direction
        near = rate(z + step) - rate(z - step)
        return (8 * near - rate(z + 2 * step) + rate(z - 2 * step)) / 12e-4

    # Without slip steering turns the frame: yaw' = (v steer + c steer') cos(tilt)/w.
    yaw = np.cos(np.pi / 10) / 1.02 * np.array([0.0, v, 0.0, 0.08])
    places = [names.index(name) for name in LATERAL]
    directions = np.eye(2 * n)[places]
    directions[:, names.index("yaw_dot")] = yaw
    return np.linalg.eigvals(np.array([derivative(e)[places] for e in directions]).T)


@pytest.mark.slow
def test_the_bicycle_is_stable_at_5_m_s():
    weave = -0.7753419 + 4.4648677j
    published = np.array([-14.0783897, weave.conjugate(), weave, -0.3228664])
    found = np.sort_complex(eigenvalues(5.0))
    assert np.max(np.abs(found - published)) < 1e-7


@pytest.mark.slow
def test_the_bicycle_loses_its_stability_by_weave_and_by_capsize():
    for v, weaves in ((4.292382536, True), (6.024262015, False)):
        found = eigenvalues(v)
        critical = found[np.argmax(found.real)]
        assert abs(critical.real) < 1e-7
        assert (abs(critical.imag) > 3.0) == weaves


# --- the quadruped, against Newton's law for all of it

LEGS = range(1, 5)


def centre(q):
    """Centre of mass, (rows, 2), of columns by name."""

    def turned(angle, x, y):
        s, c = np.sin(angle), np.cos(angle)
        return np.stack([x * c - y * s, x * s + y * c], axis=-1)

    trunk = np.stack([q["x"], q["y"]], axis=-1)
    total = 12 * trunk
    for i in LEGS:
        thigh = q["pitch"] + q[f"hip.{i}"]
        shank = thigh + q[f"knee.{i}"]
        hip = trunk + turned(q["pitch"], 0.25 if i % 2 == 0 else -0.25, 0)
        knee = hip + turned(thigh, 0, -0.2)
        total = total + 0.4 * (hip + turned(thigh, 0, -0.1))
        total = total + 0.4 * (knee + turned(shank, 0, -0.1))
    return total / 15.2


@pytest.mark.slow
def test_the_quadruped_is_carried_by_its_feet():
    r = lagsim.simulate(MODELS / "quadruped.yaml", error_bar="never")
    names = ["x", "y", "pitch", *(f"{q}.{i}" for q in ("hip", "knee") for i in LEGS)]

    def moved(h):
        v, a = ({n: r[rate_of(n, order)] for n in names} for order in (1, 2))
        return centre({n: r[n] + v[n] * h + a[n] * h * h / 2 for n in names})

    h = 2e-5  # of second differences, good to 1e-5 of the largest force
    acceleration = (moved(h) - 2 * moved(0) + moved(-h)) / h**2
    feet = np.stack(
        [
            sum(r[f"friction.ground.{i}"] for i in LEGS),
            sum(r[f"lambda_ground.{i}"] for i in LEGS) - 15.2 * 9.81,
        ],
        axis=-1,
    )
    away = np.abs(15.2 * acceleration - feet)
    assert np.max(away) < 1e-5 * np.max(np.abs(feet))
    assert np.max(np.abs(r["x"][r.t < 1.0])) < 0.015  # it stands
    # The trot repeats itself, as the header says.
    before, after = (np.searchsorted(r.t, t - 1e-9) for t in (4.6, 5.0))
    assert r["x"][after] - r["x"][before] == pytest.approx(0.2728, abs=1e-4)
    for name in names[1:]:
        assert r[name][after] == pytest.approx(r[name][before], abs=1e-4)


@pytest.mark.slow
def test_feet_that_come_to_rest_gain_no_energy():
    # Damped so, two feet end their series of impacts at one time, 1.308 s. Each impact
    # of a series has about a hundredth of the speed of the last, so that rounding
    # decides whether a series ends as an accumulation: in most runs it does.
    model = lagsim.load(MODELS / "quadruped.yaml", d=4)
    kinds = set()
    for rtol in (1e-9, 1e-10, 1e-11, 1e-12):
        r = lagsim.simulate(model, duration=1.4, error_bar="never", rtol=rtol)
        kinds.update(e.kind for e in r.events)
        assert "impact-energy" not in [w.code for w in r.warnings]
    assert "zeno" in kinds
