"""The coefficients against all conditions of their orders, in exact arithmetic."""

from __future__ import annotations

from fractions import Fraction

import pytest

from lagsim.methods import dop853, rk4
from lagsim.methods.dop853 import DENSE, ERROR3, ERROR5, A, B, C
from lagsim.methods.parts.fixed import Tableau
from tests.methods.trees import Weights, density, trees, vertices

# The rounding of the coefficients themselves explains a defect of one unit to first
# order; the published digits may end a unit in the last place off.
UNITS = 2


def exact(coefficients):
    return [Fraction(c) for c in coefficients]


def up_to(order):
    return [tree for k in range(1, order + 1) for tree in trees(k)]


def test_the_trees_are_counted_as_known():
    # A. Cayley; Hairer, Norsett, Wanner I, table II.2.1, and OEIS A000081.
    assert [len(trees(k)) for k in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]
    assert all(vertices(tree) == k for k in range(1, 9) for tree in trees(k))
    # Bushy and tall trees: gamma = 4 and 4!.
    assert density(((), (), ())) == 4
    assert density(((((),),),)) == 24


@pytest.mark.parametrize("method", [dop853, rk4])
def test_all_conditions_of_the_order_and_not_of_the_next(method):
    tableau = method.TABLEAU
    weights = Weights(tableau.A)
    b = exact(tableau.B)
    for tree in up_to(tableau.order):
        assert weights.defect(b, tree, Fraction(1, density(tree))) < UNITS, tree
    beyond = trees(tableau.order + 1)
    assert any(
        weights.defect(b, tree, Fraction(1, density(tree))) > 1e6 for tree in beyond
    )
    assert tableau.order == method.ORDER


@pytest.mark.parametrize(("error", "order"), [(ERROR5, 5), (ERROR3, 3)])
def test_the_estimators_vanish_to_their_order(error, order):
    weights = Weights(A[:12])
    e = exact(error)
    for tree in up_to(order):
        assert weights.defect(e, tree, Fraction(0)) < UNITS, tree
    assert any(weights.defect(e, t, Fraction(0)) > 1e6 for t in trees(order + 1))


def dense_weights(x):
    """Give b_i(x) of the continuous solution y0 + h sum b_i(x) k_i, and their sizes."""
    first, last = ([Fraction(int(i == j)) for i in range(16)] for j in (0, 12))
    change = [*exact(B), *[Fraction(0)] * 4]
    bend = [k - c for k, c in zip(first, change, strict=True)]
    third = [c - k - s for c, k, s in zip(change, last, bend, strict=True)]
    value = size = [Fraction(0)] * 16
    rows = [change, bend, third, *map(exact, DENSE)]
    for m, row in enumerate(reversed(rows)):
        factor = x if m % 2 == 0 else 1 - x
        value = [(v + r) * factor for v, r in zip(value, row, strict=True)]
        size = [(s + abs(r)) * factor for s, r in zip(size, row, strict=True)]
    return value, size


@pytest.mark.slow
def test_the_dense_output_meets_all_conditions_of_order_7():
    # A polynomial of degree 7 in x that is right at 8 points is right everywhere.
    weights = Weights(A)
    for k in range(1, 9):
        x = Fraction(k, 8)
        b, sizes = dense_weights(x)
        for tree in up_to(7):
            expected = x ** vertices(tree) / density(tree)
            assert weights.defect(b, tree, expected, sizes) < UNITS, (x, tree)
    b, sizes = dense_weights(Fraction(1, 2))
    expected = {tree: Fraction(1, 2**8 * density(tree)) for tree in trees(8)}
    assert any(weights.defect(b, t, x, sizes) > 1e6 for t, x in expected.items())
    assert dop853.DENSE_ORDER == 7


def test_the_last_stage_is_the_first_of_the_next_step():
    assert C[12] == 1.0
    for row, c in zip(A, C, strict=True):
        assert sum(exact(row)) == pytest.approx(c, rel=0, abs=1e-14)


def mistyped(number, digit):
    """Give `number` with one significant digit raised by one, 9 becoming 0."""
    text = list(f"{abs(number):.16e}")
    place = [i for i, c in enumerate(text) if c.isdigit()][digit]
    text[place] = str((int(text[place]) + 1) % 10)
    return float("".join(text)) * (1 if number > 0 else -1)


# What is below 1e-14 of the largest terms is left to the conditions above.
@pytest.mark.parametrize("digit", range(9))
def test_a_mistyped_digit_is_refused(digit):
    def wrong(row):
        for j, x in enumerate(row):
            if x:
                yield (*row[:j], mistyped(x, digit), *row[j + 1 :])

    good = dop853.TABLEAU
    A, B, C = good.A, good.B, good.C
    tables = [
        ((*A[:i], new, *A[i + 1 :]), B, C)
        for i, row in enumerate(A)
        for new in wrong(row)
    ]
    tables += [(A, new, C) for new in wrong(B)]
    tables += [(A, B, new) for new in wrong(C)]
    assert len(tables) > 60
    for table in tables:
        with pytest.raises(ValueError, match=r"adds up|quadrature"):
            Tableau(*table, good.order)


def test_a_tableau_that_claims_too_high_an_order_is_refused():
    good = rk4.TABLEAU
    with pytest.raises(ValueError, match="order 5"):
        Tableau(good.A, good.B, good.C, 5)
