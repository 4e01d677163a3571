"""The coefficients of Runge-Kutta methods: no digit may be mistyped.

A tableau checks itself; `order` tests the orders.
"""

import numpy as np
import pytest

from lagsim.methods import dop853, dopri5, rk4
from lagsim.methods.parts.fixed import Tableau

ROUNDING = 1e-14
PAIRS = {"dop853": dop853, "dopri5": dopri5}
# Orders of the error estimates.
ESTIMATES = {"dop853": (5, 3), "dopri5": (4,)}


def moments(pair, weights, order):
    """Return sum b c^(k-1), k = 1 ... order, against the sizes of their terms."""
    nodes = np.power(np.array(pair.C[: len(weights)])[:, None], np.arange(order))
    return weights @ nodes, 1.0 + np.abs(weights) @ nodes


def dense_weights(pair, x):
    """Return b_i(x) of the continuous solution y0 + h sum b_i(x) k_i."""
    stages = len(pair.C)
    first, last = np.eye(stages)[[0, pair.last]]
    change = np.pad(pair.weights, (0, stages - pair.last))
    bend = first - change
    rows = [change, bend, change - last - bend, *map(np.array, pair.dense)]
    value = np.zeros(stages)
    for j, row in reversed(list(enumerate(rows, 1))):
        value = (value + row) * (x if j % 2 == 1 else 1 - x)
    return value


@pytest.mark.parametrize("name", PAIRS)
def test_the_estimators_vanish_to_their_order(name):
    pair = PAIRS[name].PAIR
    for error, order in zip(pair.estimates, ESTIMATES[name], strict=True):
        found, sizes = moments(pair, np.array(error), order + 1)
        assert np.all(np.abs(found[:order]) < ROUNDING * sizes[:order])
        assert abs(found[order]) > 1e-4


@pytest.mark.parametrize("name", PAIRS)
def test_the_dense_output_is_of_its_order(name):
    pair, order = PAIRS[name].PAIR, PAIRS[name].DENSE_ORDER
    # A polynomial of degree 7 in x that is right at 8 points is right everywhere.
    for x in np.arange(1, 9) / 8:
        found, sizes = moments(pair, dense_weights(pair, x), order)
        exact = x ** np.arange(1, order + 1) / np.arange(1, order + 1)
        assert np.all(np.abs(found - exact) < 20 * ROUNDING * sizes)
    assert pair.terms == order + 1


def test_dopri5_is_rk45_of_scipy():
    from scipy.integrate import RK45

    pair = dopri5.PAIR
    for row, theirs in zip(pair.A[:6], RK45.A, strict=True):
        assert np.allclose(row, theirs[: len(row)], rtol=1e-15, atol=0)
    assert np.allclose(pair.weights, RK45.B, rtol=1e-15, atol=0)
    # The sign of the error does not matter; it is the difference of both orders.
    assert np.allclose(np.abs(pair.estimates[0]), np.abs(RK45.E), rtol=1e-13, atol=0)
    for x in np.arange(1, 6) / 5:
        theirs = RK45.P @ x ** np.arange(1, 5)
        assert np.allclose(dense_weights(pair, x), theirs, rtol=0, atol=20 * ROUNDING)


def mistyped(number, digit):
    """Return `number` with one significant digit raised by one, 9 becoming 0."""
    text = list(f"{abs(number):.16e}")
    place = [i for i, c in enumerate(text) if c.isdigit()][digit]
    text[place] = str((int(text[place]) + 1) % 10)
    return float("".join(text)) * (1 if number > 0 else -1)


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("digit", range(9))
def test_a_mistyped_digit_is_refused(digit, name):
    def wrong(row):
        for j, x in enumerate(row):
            if x:
                yield (*row[:j], mistyped(x, digit), *row[j + 1 :])

    good = PAIRS[name].TABLEAU
    tables = [
        ((*good.A[:i], new, *good.A[i + 1 :]), good.B, good.C)
        for i, row in enumerate(good.A)
        for new in wrong(row)
    ]
    tables += [(good.A, new, good.C) for new in wrong(good.B)]
    tables += [(good.A, good.B, new) for new in wrong(good.C)]
    assert len(tables) > 20
    for table in tables:
        with pytest.raises(ValueError, match=r"adds up|quadrature"):
            Tableau(*table, good.order)


def test_the_stages_of_the_dense_output_add_up():
    pair = dop853.PAIR
    assert pair.last == 12
    for row, c in zip(pair.A[12:], pair.C[12:], strict=True):
        assert sum(row) == pytest.approx(c, rel=0, abs=ROUNDING)


def test_a_tableau_that_claims_too_high_an_order_is_refused():
    good = rk4.TABLEAU
    with pytest.raises(ValueError, match="order 5"):
        Tableau(good.A, good.B, good.C, 5)
