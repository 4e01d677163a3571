"""The systems of the lecture notes, with the figures of issue and notes.

H. P. Gavin, "Generalized Coordinates, Lagrange's Equations, and Constraints", CEE 541.
"""

import math

import numpy as np
import pytest

from tests.support import run

TIGHT = {"rtol": "1e-12", "atol": "1e-12"}
G, K = 9.8, 25.6


def last(found):
    return [found[name][-1] for name in ("theta", "u", "theta_dot", "u_dot")]


@pytest.fixture(scope="module")
def free():
    return run("elastic-pendulum")


@pytest.fixture(scope="module")
def curve():
    return run("elastic-pendulum-curve")


@pytest.fixture(scope="module")
def steered():
    return run("elastic-pendulum-steered")


def test_free_elastic_pendulum(free):
    assert free["t"][-1] == 36.0
    assert len(free.rows) == 1801
    # The figures have eight digits behind the point: 5e-9 of rounding within 2e-8.
    expected = [-0.85986286, 0.31695478, -0.95768952, 0.28479442]
    assert last(free) == pytest.approx(expected, rel=0, abs=2e-8)
    energy = free["kinetic"] + free["potential"]
    assert np.max(np.abs(energy - 3.5)) < 2e-9
    assert np.array_equal(energy, free["energy"])


@pytest.mark.slow
def test_free_elastic_pendulum_at_tight_tolerances(free):
    tight = run("elastic-pendulum", **TIGHT)
    assert np.max(np.abs(tight["energy"] - 3.5)) < 2e-10
    # The bound on the default run holds against this one in every row, too.
    for name in ("theta", "u", "theta_dot", "u_dot"):
        assert np.max(np.abs(free[name] - tight[name])) < 2e-8


def test_free_elastic_pendulum_obeys_the_equations_of_the_notes(free):
    theta, u, theta_dot, u_dot = (
        free[name] for name in ("theta", "u", "theta_dot", "u_dot")
    )
    # Eqs 44 and 45, of terms up to 60 in size: a few hundred units in the last place.
    expected = -(2.0 * u_dot * theta_dot + G * np.sin(theta)) / (1.0 + u)
    assert np.max(np.abs(free["theta_ddot"] - expected)) < 1e-12
    expected = (1.0 + u) * theta_dot**2 - K * u + G * np.cos(theta)
    assert np.max(np.abs(free["u_ddot"] - expected)) < 1e-12


def test_on_the_curve(curve):
    assert curve["t"][-1] == 20.0
    assert np.max(np.abs(curve["energy"] - G * (1.0 - math.cos(1.0)))) < 2e-9
    assert G * (1.0 - math.cos(1.0)) == pytest.approx(4.505037, abs=5e-7)
    assert np.max(np.abs(curve["residual_path"])) <= 1e-12
    # The rate of the constraint, on rows, is projected as well.
    rate = curve["u_dot"] + 2.0 * curve["theta"] * curve["theta_dot"]
    assert np.max(np.abs(rate)) <= 1e-12


def test_on_the_curve_lambda_meets_both_equations_of_motion(curve):
    theta, u, theta_dot, u_dot, lam = (
        curve[name] for name in ("theta", "u", "theta_dot", "u_dot", "lambda_path")
    )
    left = (1.0 + u) ** 2 * curve["theta_ddot"] + 2.0 * (1.0 + u) * u_dot * theta_dot
    left = left + G * (1.0 + u) * np.sin(theta)
    assert np.max(np.abs(left - 2.0 * theta * lam)) < 1e-10
    left = curve["u_ddot"] - (1.0 + u) * theta_dot**2 - G * np.cos(theta) + K * u
    assert np.max(np.abs(left - lam)) < 1e-10
    # Eq. 55: the constraint, differentiated twice.
    left = 2.0 * theta * curve["theta_ddot"] + curve["u_ddot"]
    assert np.max(np.abs(left + 2.0 * theta_dot**2)) < 1e-10
    assert np.max(np.abs(curve["Qc_theta"] - 2.0 * theta * lam)) < 1e-12
    assert np.array_equal(curve["Qc_u"], lam)


def quarter_period():
    """Return the time from theta = 1 to 0 by quadrature: one degree of freedom.

    T = I(theta) theta_dot^2/2, so dt = dtheta sqrt(I/(2 (E - V))); theta = cos(s) takes
    the root out of the integrand's end.
    """
    from scipy.integrate import quad

    def potential(a):
        u = 1.0 - a * a
        return G * (1.0 - (1.0 + u) * math.cos(a)) + K * u * u / 2.0

    def integrand(s):
        a = math.cos(s)
        inertia = (2.0 - a * a) ** 2 + 4.0 * a * a
        room = 2.0 * (potential(1.0) - potential(a))
        return math.sin(s) * math.sqrt(inertia / room)

    return quad(integrand, 1e-7, math.pi / 2.0, epsabs=1e-10)[0]


def test_on_the_curve_the_period():
    # theta_dot falls through zero once a period, at its highest point.
    found = run("elastic-pendulum-curve", duration="4.6", output_step="0.0001")
    theta_dot, t = found["theta_dot"], found["t"]
    falls = np.flatnonzero((theta_dot[1:-1] > 0.0) & (theta_dot[2:] <= 0.0)) + 1
    k = falls[0]
    part = theta_dot[k] / (theta_dot[k] - theta_dot[k + 1])
    period = t[k] + part * (t[k + 1] - t[k])
    assert period == pytest.approx(4.5181, abs=5e-5)
    # The integrand ends at 1e-7: the time left out is of that size.
    assert period == pytest.approx(4.0 * quarter_period(), abs=2e-6)


def test_steered(steered):
    assert steered["t"][-1] == 40.0
    assert steered["u_dot"][0] == pytest.approx(-0.472728, abs=5e-7)
    p = 0.2 + 5.0 * 0.5
    assert steered["u_dot"][0] == pytest.approx(math.tan(p), rel=1e-14)
    expected = [0.28562567, 0.45173488, -0.91177635, 0.62016249]
    assert last(steered) == pytest.approx(expected, rel=0, abs=1e-7)
    # Energy within 2e-9, as for the free pendulum.
    energy = steered["energy"]
    assert np.max(np.abs(energy - energy[0])) < 2e-9
    assert energy[0] == pytest.approx(-0.170242989, abs=5e-10)


def test_steered_keeps_its_invariant(steered):
    theta, u = steered["theta"], steered["u"]
    p = theta + 5.0 * u
    C = theta - (p + 5.0 * np.log(np.abs(np.cos(p) + 5.0 * np.sin(p)))) / 26.0
    assert C[0] == pytest.approx(0.055901901, abs=5e-10)
    # No projection holds it; the constraint is on velocities. Error as of the state.
    assert np.max(np.abs(C - C[0])) < 1e-7
    assert np.max(np.abs(steered["residual_steering"])) <= 1e-12


def test_steered_obeys_the_equations_of_the_notes(steered):
    theta, u, theta_dot, u_dot, lam = (
        steered[name]
        for name in ("theta", "u", "theta_dot", "u_dot", "lambda_steering")
    )
    p = theta + 5.0 * u
    right = -G * (1.0 + u) * np.sin(theta) - 2.0 * (1.0 + u) * u_dot * theta_dot
    # Eqs 66 and 67 with the sign of eq. 47, and the third (errata).
    left = (1.0 + u) ** 2 * steered["theta_ddot"] + np.sin(p) * lam
    assert np.max(np.abs(left - right)) < 1e-10
    right = (1.0 + u) * theta_dot**2 - K * u + G * np.cos(theta)
    left = steered["u_ddot"] - np.cos(p) * lam
    assert np.max(np.abs(left - right)) < 1e-10
    left = -np.sin(p) * steered["theta_ddot"] + np.cos(p) * steered["u_ddot"]
    p_dot = theta_dot + 5.0 * u_dot
    right = (u_dot * np.sin(p) + theta_dot * np.cos(p)) * p_dot
    assert np.max(np.abs(left - right)) < 1e-10


def test_forced_and_damped_oscillator():
    found = run("forced-oscillator")
    M, C, spring, F0, w = 2.0, 0.4, 8.0, 3.0, 1.5
    t = found["t"]
    # Particular solution Re(z e^(iwt)), and a free decay from -z; written apart from
    # the definition u_exact in the model.
    z = F0 / (spring - M * w * w + 1j * C * w)
    root = (-C + np.emath.sqrt(C * C - 4.0 * M * spring)) / (2.0 * M)
    # c e^(root t) with Re(c + z) = 0 and Re(root c + i w z) = 0.
    real = -z.real
    imag = (root.real * real + (1j * w * z).real) / root.imag
    c = real + 1j * imag
    u = (z * np.exp(1j * w * t) + c * np.exp(root * t)).real
    u_dot = (1j * w * z * np.exp(1j * w * t) + c * root * np.exp(root * t)).real
    assert np.max(np.abs(found["u"] - u)) < 1e-9
    assert np.max(np.abs(found["u_dot"] - u_dot)) < 1e-9
    assert found.drift < 1e-9
    assert np.max(np.abs(found["energy"])) > 1.0


def test_forced_elastic_pendulum_balances():
    found = run("elastic-pendulum-forced")
    assert found.drift < 1e-9 * np.max(np.abs(found["potential"]))
    assert np.ptp(found["work"]) > 1.0
