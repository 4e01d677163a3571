"""The coefficients of Runge-Kutta methods: no digit of them may be mistyped.

A tableau checks itself; what its orders are is seen in `order`.
"""

import numpy as np
import pytest

from lagsim.methods import dop853, rk4
from lagsim.methods.dop853 import DENSE, ERROR3, ERROR5, A, B, C
from lagsim.methods.parts.fixed import Tableau

ROUNDING = 1e-14


def moments(weights, order):
    """Give sum b c^(k-1), k = 1 ... order, against the sizes of their terms."""
    nodes = np.power(np.array(C[: len(weights)])[:, None], np.arange(order))
    return weights @ nodes, 1.0 + np.abs(weights) @ nodes


def dense_weights(x):
    """Give b_i(x) of the continuous solution y0 + h sum b_i(x) k_i."""
    first, last = np.eye(16)[[0, 12]]
    change = np.pad(B, (0, 4))
    bend = first - change
    rows = [change, bend, change - last - bend, *map(np.array, DENSE)]
    value = np.zeros(16)
    for m, row in enumerate(reversed(rows)):
        value = (value + row) * (x if m % 2 == 0 else 1 - x)
    return value


def test_the_estimators_vanish_to_their_order():
    for error, order in ((ERROR5, 5), (ERROR3, 3)):
        found, sizes = moments(np.array(error), order + 1)
        assert np.all(np.abs(found[:order]) < ROUNDING * sizes[:order])
        assert abs(found[order]) > 1e-4


def test_the_dense_output_is_of_order_7():
    # A polynomial of degree 7 in x that is right at 8 points is right everywhere.
    for x in np.arange(1, 9) / 8:
        found, sizes = moments(dense_weights(x), 7)
        exact = x ** np.arange(1, 8) / np.arange(1, 8)
        assert np.all(np.abs(found - exact) < 20 * ROUNDING * sizes)
    assert dop853.DENSE_ORDER == 7


def mistyped(number, digit):
    """Give `number` with one significant digit raised by one, 9 becoming 0."""
    text = list(f"{abs(number):.16e}")
    place = [i for i, c in enumerate(text) if c.isdigit()][digit]
    text[place] = str((int(text[place]) + 1) % 10)
    return float("".join(text)) * (1 if number > 0 else -1)


@pytest.mark.parametrize("digit", range(9))
def test_a_mistyped_digit_is_refused(digit):
    def wrong(row):
        for j, x in enumerate(row):
            if x:
                yield (*row[:j], mistyped(x, digit), *row[j + 1 :])

    good = dop853.TABLEAU
    tables = [
        ((*good.A[:i], new, *good.A[i + 1 :]), good.B, good.C)
        for i, row in enumerate(good.A)
        for new in wrong(row)
    ]
    tables += [(good.A, new, good.C) for new in wrong(good.B)]
    tables += [(good.A, good.B, new) for new in wrong(good.C)]
    assert len(tables) > 60
    for table in tables:
        with pytest.raises(ValueError, match=r"adds up|quadrature"):
            Tableau(*table, good.order)


def test_the_stages_of_the_dense_output_add_up():
    assert C[12] == 1.0
    for row, c in zip(A[12:], C[12:], strict=True):
        assert sum(row) == pytest.approx(c, rel=0, abs=ROUNDING)


def test_a_tableau_that_claims_too_high_an_order_is_refused():
    good = rk4.TABLEAU
    with pytest.raises(ValueError, match="order 5"):
        Tableau(good.A, good.B, good.C, 5)
