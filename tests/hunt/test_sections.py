"""Sections of random flights with impacts, events and modes against closed forms."""

import numpy as np
import pytest

from lagsim import load, simulate
from tests.hunt.sections import expected, random_scene, text_of

STATE = ("a", "x_dot", "b", "y_dot", "z")


def check(seed, **options):
    """Compare all sections of a model, up to where the ball hardly bounces."""
    scene, sections = random_scene(seed)
    model = load(text_of(scene, sections))
    result = simulate(model, error_bar="never", **options)
    assert result.complete, result.reason
    # Positions far away round, and so do times.
    near = 1e-9 + 1e-11 * (abs(scene.origin) + abs(scene.start))
    for k, (kind, numbers, way) in enumerate(sections):
        instants, last = expected(scene, kind, numbers, way)
        found = result.sections[f"s{k}"]
        here = found["t"] < last - near
        rows = np.array([x[1:] for x in instants if x.t < last - near]).reshape(-1, 5)
        times = [x.t for x in instants if x.t < last - near]
        about = f"seed {seed}: {kind} {numbers} {way}"
        assert found["t"][here] == pytest.approx(times, abs=near), about
        states = np.stack([found[name][here] for name in STATE], axis=1)
        assert states == pytest.approx(rows, abs=30.0 * near), about


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_sections_of_flights(seed):
    check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "rk4", "rattle"])
@pytest.mark.parametrize("seed", range(10, 20))
def test_sections_of_flights_by_methods(seed, method):
    check(seed, method=method, **({} if method == "dop853" else {"step": 0.01}))


@pytest.mark.nightly
@pytest.mark.parametrize("first", range(100, 300, 20))
def test_sections_of_many_flights(first):
    for seed in range(first, first + 20):
        check(seed)
