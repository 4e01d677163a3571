"""Rest and modes of models with sums over pairs, as elements and written out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.optimize import fsolve

import lagsim
from lagsim.language import elements
from lagsim.language.elements import gathered
from lagsim.mechanics.linearisation import Linearisation
from lagsim.model.reader import read
from lagsim.studies.setting import setting_of
from tests.language.test_elements import FORMS

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

N, K, C, SOFT = 30, 1.0, 0.3, 0.2
IONS = f"""
parameters: {{n: {N}, k: {K}, c: {C}, eps: {SOFT}}}
coordinates: {{x(1..n): {{}}}}
energy:
  kinetic: sum(i = 1..n, x_dot(i)^2)/2
  potential: "sum(i = 1..n, k*(x(i) - i)^2)/2 +
    sum(i = 1..n, sum(j = i+1..n, c/sqrt((x(i) - x(j))^2 + eps^2)))"
initial: {{x(i = 1..n): i + 0.01*sin(i)}}
simulation: {{duration: 1}}
"""


def force(x: Floats) -> Floats:
    d = x[:, None] - x[None, :]
    return np.asarray(
        -K * (x - np.arange(1, N + 1)) + np.sum(C * d / (d**2 + SOFT**2) ** 1.5, axis=1)
    )


def stiffness(x: Floats) -> Floats:
    square = (x[:, None] - x[None, :]) ** 2
    off = C * (2.0 * square - SOFT**2) / (square + SOFT**2) ** 2.5
    np.fill_diagonal(off, 0.0)
    return np.asarray(np.diag(K + off.sum(axis=1)) - off)


def test_ions_in_a_row_have_the_frequencies_of_their_matrix() -> None:
    model = read(IONS, "model.yaml")
    assert gathered(setting_of(model).equations.graph)
    x = fsolve(force, np.arange(1.0, N + 1.0), xtol=1e-13)
    expected = np.sqrt(np.linalg.eigvalsh(stiffness(x))) / (2.0 * np.pi)
    found = lagsim.modes(model)
    frequencies = sorted(mode["frequency"] for mode in found.modes)
    assert frequencies == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("form", FORMS)
def test_slopes_of_elements_are_those_of_the_terms(
    form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(elements, "LEAST", 1)
    monkeypatch.setattr(elements, "PER_ARGUMENT", 0)
    model = read(FORMS[form], "model.yaml")
    settings = [setting_of(x) for x in (model, model.written_out())]
    assert [gathered(x.equations.graph) for x in settings] == [True, False]
    random = np.random.default_rng(len(form))
    n = len(model.coordinates)
    q, v = random.uniform(0.5, 1.5, n), random.normal(size=n)
    one, other = (Linearisation(x.equations).values(0.3, q, v) for x in settings)
    size = np.max(np.abs(other.slopes))
    assert one.slopes == pytest.approx(other.slopes, rel=1e-11, abs=1e-12 * size)
