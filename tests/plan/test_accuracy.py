"""The setting on which the error of a plan depends, and plans with other values."""

import pytest

from tests.small_scenes import spring
from tests.support import case_of


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"method": "dop853", "rtol": 1e-7, "atol": 1e-9}, ("rtol", 1e-7)),
        ({"method": "rk4", "step": 0.01}, ("step", 0.01)),
    ],
)
def test_a_plan_with_another_accuracy(options, expected):
    plan = case_of(spring(), **options).plan()
    assert plan.accuracy == expected
    other = plan.at(0.5 * expected[1])
    assert other.accuracy == (expected[0], 0.5 * expected[1])
    # The absolute tolerance of the file belongs to its own rtol.
    assert other.atol is None
    assert (other.method, other.form[:-2]) == (plan.method, plan.form[:-2])
