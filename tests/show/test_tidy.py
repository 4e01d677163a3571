"""Tidying: what is drawn together, what stays, what a spent budget leaves."""

import pytest
import sympy as sp

from lagsim.errors import InputError
from lagsim.mechanics.equations import derive
from lagsim.model.reader import read
from lagsim.show.lagrange import content
from lagsim.show.tidy import Tidier
from tests.show.cases import s

sin, cos = sp.sin, sp.cos
m, a, b, u, v, w = s.m, s.a, s.b, s.u, s.v, s.w
l = s.l  # noqa: E741  a length


def tidier():
    return Tidier(frozenset((m, l)), frozenset((v, w)))


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
def test_what_a_person_would_do(given, expected):
    assert tidier()(given) == expected


def test_what_nobody_can_read_is_refused():
    definitions = "  d0: x^2 + x\n"
    definitions += "".join(f"  d{k}: d{k - 1}*d{k - 1} + x\n" for k in range(1, 40))
    text = f"""
coordinates: {{x: {{}}}}
definitions:
{definitions}
energy: {{kinetic: x_dot^2/2, potential: d39}}
initial: {{x: 0}}
"""
    found = content(derive(read(text, "model.yaml")))
    assert str(found.document["definitions"]["d39"]) == "d38**2 + x"
    with pytest.raises(InputError, match="written out"):
        content(derive(read(text, "model.yaml")), expand=True)
