"""Linear algebra of fits: what the data determine, steps, and covariances."""

import numpy as np
import pytest

from lagsim.studies.fit.estimate import (
    LOSSES,
    determined,
    next_step_length,
    robust_factor,
    undetermined,
)

# The derivatives of the losses rho by the squares z of residuals.
SLOPES = {
    "linear": np.ones_like,
    "soft_l1": lambda z: 1.0 / np.sqrt(1.0 + z),
    "huber": lambda z: np.where(z > 1.0, 1.0 / np.sqrt(np.maximum(z, 1.0)), 1.0),
}


def dependent(seed):
    """Return J (12, 3) in columns of unequal size, and x with J x = 0 to rounding."""
    random, sizes = np.random.default_rng(seed), np.array([1e4, 1e-2, 3.0])
    B = random.normal(size=(12, 3))
    B[:, 2] = B[:, 0] + B[:, 1]
    return B * sizes, np.array([1.0, 1.0, -1.0]) / sizes


@pytest.mark.parametrize("seed", range(3))
def test_a_combination_that_the_data_do_not_determine(seed):
    J, x = dependent(seed)
    kept = determined(J)
    sizes = np.linalg.norm(J, axis=0)
    assert kept / sizes == pytest.approx(J / sizes, abs=1e-12)
    assert np.linalg.matrix_rank(kept / sizes) == 2
    [basis] = undetermined(J, 0.0)
    assert abs(basis @ x) == pytest.approx(np.linalg.norm(x), rel=1e-9)
    # Where all is determined nothing is taken away.
    whole = J[:, :2]
    assert np.array_equal(determined(whole), whole)
    assert undetermined(whole, 0.0).shape == (0, 2)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_length_of_the_step_that_is_left(loss):
    """The weighted least-squares problem of a step, solved by numpy."""
    random = np.random.default_rng(3)
    J, r = random.normal(size=(20, 3)) * [1.0, 1e3, 1e-3], 2.0 * random.normal(size=20)
    weights = SLOPES[loss](r**2)
    roots = np.sqrt(weights)
    step = np.linalg.lstsq(roots[:, None] * J, -roots * r, rcond=None)[0]
    length = float(np.linalg.norm(roots * (J @ step)))
    assert next_step_length(J, r, loss) == pytest.approx(length, rel=1e-9)


@pytest.mark.parametrize("loss", LOSSES[1:])
def test_the_factor_of_a_robust_covariance(loss):
    """Huber's factor: the sum of psi^2 over the square of the mean of psi'."""

    def psi(r):
        return r * SLOPES[loss](r**2)

    r = np.linspace(-3.07, 2.93, 41)  # none at the kink of psi
    bend = np.mean((psi(r + 1e-5) - psi(r - 1e-5)) / 2e-5)
    expected = np.sum(psi(r) ** 2) / 38.0 / bend**2
    assert robust_factor(r, loss, 38.0) == pytest.approx(expected, rel=1e-8)


def test_values_without_an_effect_and_more_values_than_residuals():
    [basis] = undetermined(np.array([[1.0, 0.0, 2.0], [2.0, 0.0, 1.0]]), 0.0)
    assert np.abs(basis) == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)
    J = np.array([[3.0, -1.0, 2e5]])
    basis = undetermined(J, 0.0)
    assert basis.shape == (2, 3)
    assert basis @ basis.T == pytest.approx(np.eye(2), abs=1e-14)
    assert basis @ J[0] / 2e5 == pytest.approx([0.0, 0.0], abs=1e-14)
    # A column within the relative error of the derivatives has no effect either.
    J = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-6]])
    assert len(undetermined(J, 1e-9)) == 0
    assert len(undetermined(J, 1e-3)) == 1
