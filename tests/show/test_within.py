"""Derivations have their time; numbers that sympy keeps exactly have their digits."""

import math

import pytest
import sympy as sp

import lagsim
from benchmarks.link_chain import chain
from lagsim import limits
from lagsim.errors import InputError
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read, read_file
from lagsim.show.lagrange import derived
from lagsim.show.symbols import number, symbol, to_sympy
from tests.support import MODELS, refused


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.0, 1e-3])
def test_what_is_not_derived_in_time_is_refused(monkeypatch, seconds):
    monkeypatch.setattr(limits, "DERIVING_SECONDS", seconds)
    equations = derive(read(chain(12, 1.0), "model.yaml"), chained=False)
    with refused("too-long", f" {seconds:.3g} s"):
        derived(equations)


def digits(text, numbers=None):
    """Return whether an expression of x is refused for its digits."""
    g = Graph()
    node = parse(text).build(g, g.variable)
    given = (numbers or {}).items()
    known = {g.variable(name): number(value) for name, value in given}
    try:
        to_sympy(g, [node], known=known)
    except InputError as error:
        return "digits" in str(error)
    return False


@pytest.mark.parametrize(
    "text",
    [
        "(x/2)^10000000000", "(2*x)^-20000", "((x/2)^200)^100", "(x/3 + 1/2)^20000",
        "sqrt(x/7)^50000", "exp(20000*log(x/2))", "exp(-2*(10000*log(x/2) + x))",
        "10^10^10*x", "x^(10^10^10)", "sin(1 + (x/2)^20000)",
    ],
)  # fmt: skip
def test_exact_numbers_without_end_are_seen(text):
    assert digits(text)


@pytest.mark.parametrize(
    "text",
    [
        "x^10000000000", "exp(10000000000*x)", "(x/2)^1000", "2^x", "(x + 1)^20000",
        "1e300*x + 1e-300*x^2", "9.81*x^2.5", "exp(2*log(x/2))", "(x/2)^0.001",
    ],
)  # fmt: skip
def test_others_are_not(text):
    assert not digits(text)


def test_numbers_that_are_put_in_count():
    assert not digits("(x/2)^n")
    assert digits("(x/2)^n", {"n": 20000.0})


def test_the_largest_that_is_taken_is_written_out_in_full():
    power = int((limits.EXACT_DIGITS - 10) / math.log10(2))
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: (x/2)^{power}}}
initial: {{x: 1}}
"""
    found = derived(derive(read(text, "model.yaml"), chained=False))
    x = found.translation.q[0]
    slope = sp.Rational(power, 2**power) * x ** (power - 1)
    assert sp.expand(found.document["equations"][0]["dV_dq"] - slope) == 0


def test_without_a_budget_expressions_are_as_they_come(monkeypatch):
    equations = derive(read_file(str(MODELS / "elastic-pendulum.yaml")), chained=False)
    short = derived(equations).document
    monkeypatch.setattr(limits, "TIDYING_PRODUCTS", 0)
    long = derived(equations).document
    assert any("or 0 in all" in note for note in long["notes"])
    assert not any("cut after" in note for note in short["notes"])
    for one, other in zip(short["f"], long["f"], strict=True):
        assert sp.simplify(one - other) == 0


@pytest.mark.slow
def test_forty_links_are_derived_in_their_closed_form():
    n = 40
    e = derive(read(chain(n, 1.0), "model.yaml"), chained=False)
    found = derived(e, expand=True)
    assert not any(
        "longer than they might be" in note for note in found.document["notes"]
    )
    m, g, l = (symbol(name) for name in "mgl")  # noqa: E741  a length
    a, v, rate = (
        [symbol(f"a{k}{end}") for k in range(1, n + 1)] for end in ("", "_dot", "_ddot")
    )
    for i in (0, 11, n - 1):
        expected = (n - i) * m * g * l * sp.sin(a[i])
        for j in range(n):
            hung = (n - max(i, j)) * m * l**2
            expected += hung * sp.cos(a[i] - a[j]) * rate[j]
            expected += hung * sp.sin(a[i] - a[j]) * v[j] ** 2
        assert sp.expand(found.document["equations"][i]["left"] - expected) == 0


@pytest.mark.slow
def test_products_of_sums_are_not_multiplied_out():
    # Each of the constraints has 2^24 terms; no clock is asked while they are compared.
    names = [f"q{k}" for k in range(24)]
    held = (" * ".join(f"({q} + {j})" for q in names) for j in (1, 2, 3))
    text = f"""
coordinates: {{{", ".join(f"{q}: {{}}" for q in names)}}}
energy: {{kinetic: {" + ".join(f"{q}_dot^2" for q in names)}, potential: 0}}
constraints: {{{", ".join(f"c{j}: {x} = 1" for j, x in enumerate(held))}}}
initial: {{{", ".join(f"{q}: 0" for q in names)}}}
"""
    assert "c₂ = (3 + q₀) (3 + q₁)" in lagsim.derive(text).text
