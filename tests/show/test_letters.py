"""Greek letters by their names, in text and in LaTeX, from Unicode's own tables."""

import unicodedata

import pytest

from lagsim.show.latex import as_latex
from lagsim.show.names import LatexNames, PrintedName, UnicodeNames
from lagsim.show.text import as_text
from tests.show.cases import small

LETTERS = [
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota",
    "kappa", "lambda", "mu", "nu", "xi", "omicron", "pi", "rho", "sigma", "tau",
    "upsilon", "phi", "chi", "psi", "omega",
]  # fmt: skip
# Those that plain TeX has not look like Latin letters, by Unicode's names.
ALIKE = {name: name[0] for name in ("Alpha", "Beta", "Epsilon", "Zeta", "Iota")}
ALIKE |= {name: name[0] for name in ("Kappa", "Mu", "Nu", "Omicron", "Tau", "omicron")}
ALIKE |= {"Eta": "H", "Rho": "P", "Chi": "X"}


@pytest.mark.parametrize("name", [*LETTERS, *map(str.capitalize, LETTERS)])
def test_a_letter(name):
    size = "CAPITAL" if name[0].isupper() else "SMALL"
    spelled = {"lambda": "LAMDA"}.get(name.lower(), name.upper())
    letter = unicodedata.lookup(f"GREEK {size} LETTER {spelled}")
    text, latex = UnicodeNames([name, letter + "_x"]), LatexNames([name])
    for order, dots in enumerate(("", "\u0307", "\u0308")):
        assert text.show(PrintedName(name, order)) == letter + dots
    command = rf"\mathrm{{{ALIKE[name]}}}" if name in ALIKE else f"\\{name}"
    for shown in (name, letter):
        assert latex.show(PrintedName(shown)) == command
        assert LatexNames([shown]).show(PrintedName(f"{shown}3")) == f"{command}_{{3}}"


NUMBERS = """
parameters: {a: 0.123456789, b: 1234567.89, c: 1e-9, d: 0.3333333333333333}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: a*x + b*x^2 + c*x^3 + d*x^4}
initial: {x: 1}
"""


def test_decimals_have_six_digits():
    c = small(NUMBERS, substitute=True)
    for shown in ("0.123457 x", "1.23457e+06 x²", "1e-09 x³", "x⁴/3"):
        assert shown in as_text(c)
    for shown in (r"0.123457 \, x", r"1.23457 \cdot 10^{6}", r"10^{-9} \, x^{3}"):
        assert shown in as_latex(c)
