"""Sums over pairs and springs as elements, compared with the model written out.

Models are small, so that they can be written out, and the number of terms from which a
sum becomes elements is set to 1.
"""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.language import elements
from lagsim.language.evaluate import evaluate, evaluate_with_error, roundings
from lagsim.language.functions import ELEMENTS
from lagsim.mechanics.derivation import derive, may_gather
from lagsim.mechanics.equations import Equations, pushes
from lagsim.model.reader import read
from lagsim.program.localized import indicators
from lagsim.run.session import check, open_case, suited

SQUARE = "(x(i) - x(j))^2 + (y(i) - y(j))^2"
SOFT = f"sqrt({SQUARE} + eps^2)"
PLANE = "x(1..n): {}, y(1..n): {}"
KINETIC = "sum(i = 1..n, m(i)*(x_dot(i)^2 + y_dot(i)^2))/2"
TEXT = """
parameters:
  n: {n}
  G: 1.3
  eps: 0.4
  m(i = 1..n): 1 + 0.1*i
  l(i = 1..n): 0.2*i
coordinates: {{{coordinates}}}
definitions: {{{definitions}}}
energy:
  kinetic: {kinetic}
  potential: "{potential}"
{more}
initial: {{{start}}}
simulation: {{duration: 1, output_step: 0.1}}
"""
START = "x(i = 1..n): cos(2.4*i)*i/3, y(i = 1..n): sin(2.4*i)*i/3"


def text(potential: str, n: int = 5, **more: str) -> str:
    given = {
        "coordinates": PLANE,
        "definitions": "",
        "kinetic": KINETIC,
        "start": START,
        "more": "",
    }
    return TEXT.format(n=n, potential=potential, **(given | more))


PAIRS = f"sum(i = 1..n, sum(j = i+1..n, -G*m(i)*m(j)/{SOFT}))"
VECTORS = {
    "coordinates": "r(1..n): {components: xyz}",
    "kinetic": "sum(i = 1..n, m(i)*dot(r_dot(i), r_dot(i)))/2",
    "start": "r(i = 1..n): 'vec(cos(2.4*i)*i/3, sin(2.4*i)*i/3, i/5)'",
}
LENGTH = "hypot(x(i+1) - x(i), y(i+1) - y(i))"
FORMS: dict[str, str] = {
    "springs in a row": text(f"sum(i = 1..n-1, m(i)*({LENGTH} - l(i))^2/2)"),
    "a chain with cubic forces": text(
        "sum(i = 1..n-1, (x(i+1) - x(i))^2/2 + G*(x(i+1) - x(i))^3/3) + y(n)^4"
    ),
    "a beam of lumped masses": text(
        "sum(i = 2..n-1, G*(y(i-1) - 2*y(i) + y(i+1))^2/2) + sum(i = 1..n, x(i)^2)"
    ),
    "a net": text(
        "sum(i = 1..n-1, sum(j = 1..n, (norm(r(i+1, j) - r(i, j)) - l(j))^2)) + "
        "sum(i = 1..n, sum(j = 1..n-1, (norm(r(i, j+1) - r(i, j)) - l(i))^2))",
        coordinates="'r(i = 1..n, j = 1..n)': {components: xyz}",
        kinetic="sum(i = 1..n, sum(j = 1..n, dot(r_dot(i, j), r_dot(i, j))))/2",
        start="'r(i = 1..n, j = 1..n)': 'vec(i, j, cos(i*j))'",
    ),
    "dampers along springs": text(
        f"sum(i = 1..n-1, ({LENGTH} - G)^2)",
        more="  dissipation: 'sum(i = 1..n-1, l(i)*((x(i+1) - x(i))*(x_dot(i+1) - "
        "x_dot(i)) + (y(i+1) - y(i))*(y_dot(i+1) - y_dot(i)))^2/"
        f"(2*{LENGTH}^2))'",
    ),
    "pairs": text(PAIRS),
    "a factor before an inner sum": text(
        f"-G*sum(i = 1..n, m(i)*sum(j = i+1..n, m(j)/{SOFT}))"
    ),
    "pairs counted twice": text(
        f"sum(i = 1..n, sum(j = 1..n, if(i < j or i > j, log({SQUARE} + eps^2), 0)))/2"
    ),
    "the second index outside": text(
        f"sum(j = 2..n, sum(i = 1..j-1, -m(i)*m(j)*exp(-({SQUARE})/4)))"
    ),
    "a condition on indices": text(
        f"sum(i = 1..n, sum(j = i+1..n, if(j <= i+1, 2*({SQUARE}), -G/{SOFT})))"
    ),
    "indices as numbers": text(
        f"sum(i = 1..n, sum(j = i+1..n, (-1)^(i + j)*i*G/({SOFT} + j/n)))"
    ),
    "three indices": text(
        "sum(i = 1..n, sum(j = i+1..n, sum(k = j+1..n, cos(x(i) + x(j) - y(k))*l(k))))"
    ),
    "springs in a net, and other terms": text(
        f"sum(i = 1..n-1, sum(j = i+1..n, (sqrt({SQUARE} + 0.01) - l(j))^2)) - "
        "sum(i = 1..n, sum(j = i+1..n, x(i)*y(j)))/20 + sum(i = 1..n, x(i)^4)"
    ),
    "vectors": text(
        "sum(i = 1..n, sum(j = i+1..n, G*(norm(r(i) - r(j)) - 0.3*abs(i - j))^2))",
        **VECTORS,
    ),
    "components by an index": text(
        "sum(i = 1..n, sum(j = i+1..n, -G/sqrt(sum(c = 1..2, (q(i, c) - q(j, c))^2) + "
        "eps^2)))",
        coordinates="'q(i = 1..n, c = 1..2)': {}",
        kinetic="sum(i = 1..n, sum(c = 1..2, m(i)*q_dot(i, c)^2))/2",
        start="'q(i = 1..n, c = 1..2)': cos(2.4*i + c)*i/3",
    ),
    "definitions": text(
        "sum(i = 1..n, sum(j = i+1..n, -G/sqrt((X(i)-X(j))^2 + Y(i)*Y(j) + 9)))",
        definitions="X(i = 1..n): (2 + x(i))*cos(y(i)), Y(i = 1..n): x(i)*sin(y(i))",
        kinetic="sum(i = 1..n, m(i)*(X_dot(i)^2 + Y_dot(i)^2 + x_dot(i)^2))/2",
    ),
    "fixed places": text("sum(i = 1..n, sum(j = 1..n, 1/((x(i) - j)^2 + l(j)^2)))"),
    "time": text(f"sum(i = 1..n, sum(j = i+1..n, -(G + sin(t))/({SOFT} + t)))"),
    "a definition": text(
        "2*U + U^2", definitions=f"U: '{PAIRS}'", more="output: {columns: [U]}"
    ),
    "dampers between all": text(
        PAIRS,
        more="  dissipation: 'sum(i = 1..n, sum(j = i+1..n, "
        "l(j)*(x_dot(i) - x_dot(j))^2/(1 + y(i)^2)))'",
    ),
    "forces and dissipation": text(
        PAIRS,
        more="  dissipation: 0.1*sum(i = 1..n, x_dot(i)^2)\nforces: {x(1): sin(3*t)}",
    ),
}


@pytest.fixture(autouse=True)
def _small_sums(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elements, "LEAST", 1)
    monkeypatch.setattr(elements, "PER_ARGUMENT", 0)


def both(model: str) -> tuple[Equations, Equations]:
    """Return the equations with elements, and the equations written out."""
    gathered = read(model, "a.yaml")
    assert gathered.graph.of((ELEMENTS,))
    apart = gathered.written_out()
    assert not apart.graph.of((ELEMENTS,))
    return derive(gathered, gathers=True), derive(apart)


def values_of(e: Equations) -> dict[str, float]:
    """Return a random state with the values of the parameters."""
    random = np.random.default_rng(1)
    state = dict(zip(e.moving, random.normal(size=len(e.moving)), strict=True))
    return {**e.model.parameter_values, **{k: float(x) for k, x in state.items()}}


@pytest.mark.parametrize("form", FORMS)
def test_equations_are_those_of_the_terms(form: str) -> None:
    found = []
    for e in both(FORMS[form]):
        nodes = [*e.f, e.energy, e.kinetic_form, *e.momenta, *e.powers]
        nodes += list(e.mass_entries.values())
        found.append(evaluate(e.graph, nodes, values_of(e)))
    assert found[0] == pytest.approx(found[1], rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("form", FORMS)
def test_sizes_of_terms_are_those_of_the_terms(form: str) -> None:
    one, other = (
        np.array(evaluate(e.graph, pushes(e), values_of(e))) for e in both(FORMS[form])
    )
    # A coordinate that is an addend of two neighbours' terms counts twice.
    twice = 2.0 if form == "a chain with cubic forces" else 1.0
    assert np.all(other * (1.0 - 1e-12) - 1e-13 <= one)
    assert np.all(one <= twice * other * (1.0 + 1e-12) + 1e-13)


@pytest.mark.parametrize("form", FORMS)
def test_roundoff_is_bounded_as_that_of_the_terms(form: str) -> None:
    found = []
    for e in both(FORMS[form]):
        nodes = roundings(e.graph, e.f, (*e.state, "t"), e.state)
        found.append(evaluate(e.graph, nodes, values_of(e)))
    # Sums are added up in another order, which a bound by partial sums shows.
    for one, other in zip(*found, strict=True):
        assert 0.4 * other <= one <= 2.5 * other


def test_errors_of_values_are_bounded() -> None:
    found = []
    for e in both(FORMS["pairs"]):
        state = {x: (value, 1e-9) for x, value in values_of(e).items()}
        found.append(evaluate_with_error(e.graph, [e.energy, *e.f], state))
    for (one, error), (other, apart) in zip(*found, strict=True):
        assert one == pytest.approx(other, rel=1e-13)
        assert error == pytest.approx(apart, rel=1e-3)


def test_force_of_a_pair_has_its_closed_form() -> None:
    e, _ = both(text(PAIRS, n=2))
    values = values_of(e)
    dx, dy = values["x.1"] - values["x.2"], values["y.1"] - values["y.2"]
    cube = (dx**2 + dy**2 + 0.4**2) ** 1.5
    expected = -1.3 * 1.1 * 1.2 * dx / cube
    assert evaluate(e.graph, e.f[:2], values) == pytest.approx([expected, -expected])


@pytest.mark.parametrize("form", ["pairs", "vectors", "definitions", "time"])
def test_each_term_has_its_indicators(form: str) -> None:
    found = []
    for e in both(FORMS[form]):
        some = indicators(e, e.of_motion, [])
        numbers = evaluate(e.graph, [x.node for x in some], values_of(e))
        rows = [
            (x.kind, x.power, float(u))
            for x, several in zip(some, numbers, strict=True)
            for u in np.atleast_1d(several)
        ]
        assert len(rows) == sum(x.members for x in some)
        found.append(np.array(sorted(rows)))
    assert found[0] == pytest.approx(found[1], rel=1e-12)


@pytest.mark.parametrize(
    "potential",
    [
        "sum(i = 1..n, sum(j = i+1..n, max(0, x(i) - x(j))^2))",
        "sum(i = 1..n, sum(j = i+1..n, if(x(i) > x(j), x(i)*y(j), 0)))",
        "sum(i = 1..n, sum(j = i+1..n, abs(x(i))*y(j)))",
        "sum(i = 1..n, sum(j = i+1..n, (1 + x(i)^2)^l(j)))",
    ],
)
def test_terms_that_are_not_smooth_are_written_out(potential: str) -> None:
    assert not read(text(potential), "a.yaml").graph.of((ELEMENTS,))


@pytest.mark.parametrize(
    ("potential", "more", "gathered"),
    [
        ("sum(i = 1..n, sum(j = i+1..n, x_dot(i)*y(j)))", "", False),
        ("U", "constraints: {c: 'x(1) = abs(U)'}", True),
        ("U", "events: {e: {at: 'floor(U) >= 9', impulse: {x(1): 1}}}", True),
        ("U", "forces: {x(1): -sign(U)}", True),
    ],
)
def test_equations_of_other_models_are_written_out(
    potential: str, more: str, gathered: bool
) -> None:
    defined = "" if potential != "U" else f"U: '{PAIRS}'"
    model = read(text(potential, definitions=defined, more=more), "a.yaml")
    assert bool(model.graph.of((ELEMENTS,))) is gathered
    assert not may_gather(model)
    e = derive(suited(model, model.settings()))
    assert not e.graph.of((ELEMENTS,))


@pytest.mark.parametrize(
    ("method", "gathers"),
    [("auto", True), ("verlet", True), ("rk4", True), ("kahan-li8", True),
     ("radau", False), ("taylor", False), ("gauss4", False)],
)  # fmt: skip
def test_methods_that_need_derivatives_have_the_terms(
    method: str, gathers: bool
) -> None:
    model = read(FORMS["pairs"], "a.yaml")
    case = open_case(model, model.settings({"method": method}))
    assert bool(case.equations.graph.of((ELEMENTS,))) is gathers


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("x(i) - x(j)", "x(i) - x(j+1)"),
        ("m(j)", "mass(j)"),
        ("m(j)", "q*m(j)"),
        ("m(j)", "m(j)*x_ddot(j)"),
        ("j = i+1..n", "j = i+1..n/2"),
        ("sqrt(", "sqrt(t, "),
    ],
)
def test_faults_are_those_of_the_terms(
    old: str, new: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = text(PAIRS.replace(old, new))
    with pytest.raises(InputError) as found:
        read(wrong, "a.yaml")
    monkeypatch.setattr(elements, "LEAST", 10**9)
    with pytest.raises(InputError) as expected:
        read(wrong, "a.yaml")
    assert found.value.problems == expected.value.problems


def test_a_member_without_a_value_is_named() -> None:
    model = read(
        text(
            f"sum(i = 1..n, sum(j = i+1..n, -G*m(i)*m(j)/sqrt({SQUARE})))",
            start="x(i = 1..n): 'max(i, 2)', y(i = 1..n): 0",
        ),
        "a.yaml",
    )
    problems = []
    for one in (model, model.written_out()):
        with pytest.raises(InputError) as refused:
            check(one)
        problems.append(refused.value.problems)
    assert problems[0] == problems[1]
    assert "(x.1 - x.2)^2" in problems[0][0].text


def test_units_of_one_term_stand_for_all() -> None:
    units = "x(1..n): {unit: m}, y(1..n): {unit: m}"
    wrong = read(text(PAIRS.replace("+ eps^2", "+ t"), coordinates=units), "a.yaml")
    assert wrong.graph.of((ELEMENTS,))
    places = [
        [x.place for x in one.stated.mismatches(one)]
        for one in (wrong, wrong.written_out())
    ]
    assert len(places[0]) == 1
    assert places[0] == places[1]


def test_other_values_of_parameters_have_the_same_equations() -> None:
    model = read(FORMS["pairs"], "a.yaml")
    bound = model.bind({"G": 2.0, "m.3": 7.0})
    assert bound.graph is model.graph
    more = model.bind({"n": 7})
    (vector,) = more.graph.of((ELEMENTS,))
    assert elements.payload(more.graph, vector).members == 7 * 6 // 2
    assert not model.written_out().bind({"n": 7}).graph.of((ELEMENTS,))


@pytest.mark.slow
def test_graph_and_table_grow_as_the_bodies_and_pairs() -> None:
    sizes = []
    for n in (40, 80):
        model = read(text(PAIRS, n=n), "a.yaml")
        e = derive(model, gathers=True)
        pushes(e)
        sizes.append(len(e.graph))
        (vector, *_) = e.graph.of((ELEMENTS,))
        of = elements.payload(e.graph, vector)
        assert of.members == n * (n - 1) // 2
        assert of.table.nbytes == 8 * of.members
    assert sizes[1] < 2.1 * sizes[0]


@pytest.mark.slow
def test_sums_of_few_terms_are_written_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert not read(text(PAIRS, n=20), "a.yaml").graph.of((ELEMENTS,))
    assert read(text(PAIRS, n=60), "a.yaml").graph.of((ELEMENTS,))
    half = KINETIC.removesuffix("/2")
    lagrangian = f"  lagrangian: '0.5*{half} - {PAIRS}'"
    whole = text(PAIRS, n=60).splitlines()
    energies = [x for x in whole if not x.startswith(("  kinetic", "  potential"))]
    energies.insert(energies.index("energy:") + 1, lagrangian)
    assert may_gather(read("\n".join(energies), "a.yaml"))
    chain = "sum(i = 1..n-1, (x(i+1) - x(i))^2)"
    assert not read(text(chain, n=300), "a.yaml").graph.of((ELEMENTS,))
    assert read(text(chain, n=500), "a.yaml").graph.of((ELEMENTS,))
    # A definition has more uses than in forces.
    defined = text("U", n=500, definitions=f"U: '{chain}'")
    assert not read(defined, "a.yaml").graph.of((ELEMENTS,))
