"""Tidying: what is drawn together, what stays, what a spent budget leaves."""

from __future__ import annotations

import random

import pytest
import sympy as sp

from lagsim.errors import InputError
from lagsim.mechanics.equations import derive
from lagsim.model.reader import read
from lagsim.show.lagrange import _Derivation, content
from lagsim.show.symbols import Translation
from lagsim.show.text import as_text
from lagsim.show.tidy import Tidier, cost
from tests.show.cases import equations_of, s

sin, cos = sp.sin, sp.cos
m, a, b, u, v, w = s.m, s.a, s.b, s.u, s.v, s.w
l = s.l  # noqa: E741  a length


def tidier(**budget: int) -> Tidier:
    return Tidier(frozenset((m, l)), frozenset((v, w)), **budget)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (m * sin(a) ** 2 + m * cos(a) ** 2, m), (m - m * cos(a) ** 2, m * sin(a) ** 2),
        (cos(a) * cos(b) + sin(a) * sin(b), cos(a - b)),
        (cos(a) * cos(b) - sin(a) * sin(b), cos(a + b)),
        (sin(a) * cos(b) - cos(a) * sin(b), sin(a - b)),
        (sin(a) * cos(b) + cos(a) * sin(b), sin(a + b)),
        (v**2 * sin(a + b) ** 2 * m + v**2 * cos(a + b) ** 2 * m, m * v**2),
        (l * m * v + m * u * v, m * v * (l + u)),
        (m * (l + u) * sin(a) / (l + u), m * sin(a)),
        ((2 * l + 2 * u) * m * v, 2 * m * (l + u) * v),
        (m * (l + u) ** 2 * v**2, m * (l + u) ** 2 * v**2),
    ],
)  # fmt: skip
def test_what_a_person_would_do(given: sp.Expr, expected: sp.Expr) -> None:
    assert tidier()(given) == expected


@pytest.mark.slow
def test_tidy_forms_are_equal_to_what_they_came_from() -> None:
    dice = random.Random(8)
    atoms = [m, l, u, v, w, sin(a), cos(a), sin(b), cos(b), l + u, l - v * cos(a)]
    for _ in range(25):
        terms = []
        for _ in range(dice.randint(2, 6)):
            factors = [dice.choice(atoms) for _ in range(dice.randint(1, 4))]
            terms.append(sp.Rational(dice.randint(-4, 4), 2) * sp.Mul(*factors))
        e = sp.Add(*terms) / dice.choice([1, l + u, m, 2 * l + 2 * u])
        at = {x: sp.Rational(dice.randint(1, 99), 37) for x in e.free_symbols}
        for factored in (False, True):
            found = tidier()(e, factored=factored)
            assert abs((found - e).subs(at).evalf(40)) < 1e-30
            assert cost(found) <= 2 * cost(e)


def test_a_spent_budget_leaves_the_expression_and_says_so() -> None:
    given = (v * cos(a) + w * cos(b)) ** 2 + (v * sin(a) + w * sin(b)) ** 2
    for tidy in (tidier(most=5), tidier(left=5)):
        assert tidy(given) == given
        assert tidy.cut
    assert not tidier().cut


def test_the_text_tells_that_it_was_cut() -> None:
    x = Translation(equations_of("double-pendulum"))
    x.tidy.most = 10
    found = _Derivation(x).content(solve=False, with_gauss=False)
    told = " ".join(as_text(found).split())
    assert "simplification was cut after 10 products of terms in one" in told


def test_what_nobody_can_read_is_refused() -> None:
    definitions = "  d0: x^2 + x\n"
    definitions += "".join(f"  d{k}: d{k - 1}*d{k - 1} + x\n" for k in range(1, 40))
    text = f"""
coordinates: {{x: {{}}}}
definitions:
{definitions}
energy: {{kinetic: x_dot^2/2, potential: d39}}
initial: {{x: 0}}
"""
    with pytest.raises(InputError, match="written out"):
        content(derive(read(text, "model.yaml")))
