"""Sums over pairs and springs in the equations that people read.

The expressions of the JSON document are evaluated by a reader of its own, and compared
with the model written out.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import lagsim
from lagsim.language import elements
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive, may_gather
from lagsim.model.reader import read
from tests.language.test_elements import FORMS, PAIRS, SQUARE, text

if TYPE_CHECKING:
    from collections.abc import Mapping

_RANGE = re.compile(r"\bsum\((\w) = ([^.]+)\.\.([^,]+), ")
_INDEX = r"(?:[ijkmn](?:[+-]\d+)?|\d+)"
_NAME = re.compile(
    rf"([^\W\d]\w*)((?:\.\w+)*)(?:\(({_INDEX}(?:, {_INDEX})*)\)((?:\.\w+)*))?"
)


def value(formula: str, values: Mapping[str, float]) -> float:
    """Return the value of a formula of the JSON document at the values of its names."""
    formula = _RANGE.sub(r"total(\2, \3, lambda \1: ", formula).replace("^", "**")
    stems = {name.partition(".")[0] for name in values}
    text, at = "", 0
    for m in _NAME.finditer(formula):
        if m[1] not in stems:
            continue
        whole, parts = m[1] + m[2], [repr(m[1] + m[2])]
        end = m.end(2)
        if m[3] is not None:
            parts = [repr(whole), *m[3].split(", "), repr(m[4][1:])]
            end = m.end(4)
        text += formula[at : m.start()] + f"of({', '.join(parts)})"
        at = end
    text += formula[at:]

    def of(*parts: Any) -> float:
        return values[".".join(str(p) for p in parts if p != "")]

    def total(first: int, last: int, term: Any) -> float:
        return sum(term(k) for k in range(first, last + 1))

    known = {name: getattr(math, name) for name in ("sqrt", "sin", "cos", "exp", "log")}
    known |= {"hypot": math.hypot, "pi": math.pi, "of": of, "total": total}
    return float(eval(text, known))  # noqa: S307  an expression of the test itself


ODD = "sum(i = 1..n, sum(j = i+1..n, "
MORE = {
    "pairs that are not alike": text(ODD + "m(i)*(x(i) - 2*x(j))^4 + y(i)*y(j)^2))"),
    "numbers of indices": text(ODD + "(x(i) - y(j))^2/(j - i)^2 + i*x(j)^3))", n=6),
    "short range": text(
        "sum(i = 1..n, sum(j = i+1..if(i < n-2, i+2, n), (x(i) - x(j))^4))", n=8
    ),
    "all pairs": text("sum(i = 1..n, sum(j = 1..n, sin(x(i) - y(j))))"),
    "but the equal": text(
        f"sum(i = 1..n, sum(j = 1..n, if(i < j or i > j, 1/sqrt({SQUARE} + eps^2), 0)))"
    ),
    "triples": text("sum(i = 1..n, sum(j = 1..n, sum(k = 1..n, x(i)*y(j)*x(k)^2)))"),
    "every other": text("sum(i = 1..2, (x(2*i) - y(2*i+1))^4)"),
    "below": text("sum(i = 1..n, sum(j = 1..i-1, m(j)*cos(x(i) - x(j))))"),
    "with definitions": text(
        ODD + "m(i)*a(i)^2*a(j)^3))", definitions="'a(i = 1..n)': x(i)^2 + y(i)"
    ),
    "parameters called as indices": text(
        PAIRS.replace("G*", "j*k*i*").replace("(i ", "(a ").replace("(j ", "(b ")
        .replace("(i)", "(a)").replace("(j)", "(b)").replace("i+1", "a+1")
    ).replace("  G: 1.3", "  i: 1.3\n  j: 0.7\n  k: 2"),
    "a series in one coordinate": text(
        "sum(i = 1..9, cos(i*x)/i^2)", coordinates="x: {}", kinetic="x_dot^2/2",
        start="x: 0.3",
    ),
}  # fmt: skip


def gather(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elements, "LEAST", 1)
    monkeypatch.setattr(elements, "PER_ARGUMENT", 0)


@pytest.mark.parametrize("name", [*FORMS, *MORE])
def test_equations_with_sums_have_the_values_of_those_written_out(name, monkeypatch):
    gather(monkeypatch)
    model = read((FORMS | MORE)[name], "model.yaml")
    assert may_gather(model)
    d = lagsim.derive(model).json
    written = derive(model.written_out(), chained=False)
    random = np.random.default_rng(len(name))
    accelerations = random.uniform(-1.0, 1.0, len(written.q))
    values = {p.name: p.value for p in model.parameters}
    for state in range(2):
        values |= {x: random.uniform(0.5, 1.5) for x in written.moving}
        values |= dict(zip(written.accelerations, accelerations, strict=True))
        values["t"] = 0.7 * state
        known = dict(values)
        for key, definition in d["definitions"].items():
            known[key] = value(definition, known)
        for part in d["separated"].values():
            for key, formula in part.items():
                known[key] = value(formula, known)
        nodes = [*(x for row in written.M for x in row), *written.f]
        *found, energy = evaluate(
            written.graph, [*nodes, written.model.lagrangian], values
        )
        assert value(d["lagrangian"], known) == pytest.approx(energy, rel=1e-12)
        n = len(written.q)
        M, f = np.reshape(found[: n * n], (n, n)), np.array(found[n * n :])
        expected = M @ accelerations - f
        size = np.abs(M) @ np.abs(accelerations) + np.abs(f)
        got = [
            value(x["left"], known) - value(x["right"], known) for x in d["equations"]
        ]
        assert np.max(np.abs(got - expected) / size) < 1e-11
        of_M = [value(x, known) for x in d["f"]]
        assert np.max(np.abs(of_M - f) / size) < 1e-11


BODIES = """
parameters: {n: 50, G: 1, eps: 0.05, m(i = 1..n): 1/n + 0.1*i/n^2}
coordinates: {x(1..n): {}, y(1..n): {}}
energy:
  kinetic: sum(i = 1..n, m(i)*(x_dot(i)^2 + y_dot(i)^2))/2
  potential: "sum(i = 1..n, sum(j = i+1..n,
    -G*m(i)*m(j)/sqrt((x(i) - x(j))^2 + (y(i) - y(j))^2 + eps^2)))"
initial: {x(i = 1..n): cos(2.4*i), y(i = 1..n): sin(2.4*i)}
simulation: {duration: 1}
"""


def test_bodies_that_attract_have_an_equation_of_the_generic_body():
    shown = lagsim.derive(read(BODIES, "model.yaml")).text
    sum_of_pairs = (
        "V = Σ(j = 1..49, Σ(k = j+1..50, −G mⱼ mₖ/√(eps² + (xⱼ − xₖ)² + (yⱼ − yₖ)²)))"
    )
    assert sum_of_pairs in shown
    assert "for xᵢ, i = 2..49:" in shown
    force = "G mⱼ mᵢ (xᵢ − xⱼ)/(eps² + (xᵢ − xⱼ)² + (yᵢ − yⱼ)²)^(3/2))"
    assert f"Σ(j = 1..i−1, {force}" in shown
    assert f"Σ(j = i+1..50, {force}" in shown
    assert len(shown) < 3000


def test_latex_has_signs_of_sums_over_both_indices():
    found = lagsim.derive(read(BODIES, "model.yaml")).latex
    assert r"\sum_{j = 1}^{49} \sum_{k = j+1}^{50}" in found
    assert r"\sum_{j = 1}^{i-1}" in found
