"""The quarter car, fitted to a synthetic response whose values are known."""

import importlib.util
import math

import numpy as np
import pytest

from tests.cli.conftest import lagsim as command  # noqa: F401
from tests.support import MODELS, ROOT, simulate

CAR, DATA = MODELS / "quarter-car.yaml", MODELS / "synthetic_quarter_car.csv"


def made():
    """Load the program that writes the response."""
    path = ROOT / "benchmarks" / "quarter_car.py"
    spec = importlib.util.spec_from_file_location("quarter_car", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_header_has_the_values_of_the_run():
    found, header = simulate(str(CAR)), CAR.read_text().partition("name:")[0]
    assert f"{np.sqrt(np.mean(found['felt'] ** 2)):.3f} m/s^2" in header
    for name in ("z", "z1"):
        assert f"{name} = {found[name][-1]:.10f}" in header
    # (m s^2 + c s + k)(m1 s^2 + c s + k + kt) = (c s + k)^2
    spring, wheel = np.array([1200, 16e3]), np.array([42, 1200, 216e3])
    product = np.polymul([320, *spring], wheel)
    for root in np.roots(np.polysub(product, np.polymul(spring, spring))):
        assert f"{abs(root) / (2 * math.pi):.4f} Hz" in header


@pytest.mark.slow
def test_the_response_is_that_of_its_program():
    written = np.loadtxt(DATA, delimiter=",", skiprows=1)
    # The last digit may be rounded otherwise.
    assert written == pytest.approx(np.array(made().rows()), abs=0.00101)


@pytest.mark.slow
def test_a_fit_finds_the_values_of_the_response(command):  # noqa: F811
    module = made()
    varied = [x for name in module.TRUE for x in ("--vary", name)]
    found = command("fit", CAR, DATA, *varied, "--no-plots", "--json", code=0).json
    for name, value in module.TRUE.items():
        one = found["parameters"][name]
        assert abs(one["value"] - value) < 3.5 * one["standard_error"]
        low, high = one["interval"]
        assert high - low == pytest.approx(3.93 * one["standard_error"], rel=0.01)
        assert one["standard_error"] < 0.01 * value
    for name, size in module.NOISE.items():
        # Four standard errors of the deviation of 401 numbers.
        assert found["noise"][name] == pytest.approx(size, rel=4 / math.sqrt(2 * 401))
    assert found["identifiable"]
