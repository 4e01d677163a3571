"""Motions of models with sums over pairs and springs: as elements, and written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lagsim
from lagsim.codes.known import METHOD_REFUSED
from lagsim.language import elements
from lagsim.language.functions import ELEMENTS
from lagsim.mechanics.derivation import may_gather
from lagsim.methods import method as method_named
from lagsim.model.model import Model
from lagsim.model.reader import read

MODEL = """
parameters:
  n: {n}
  G: 1.3
  eps: 0.4
  m(i = 1..n): 1 + 0.1*i
coordinates: {{x(1..n): {{}}, y(1..n): {{}}}}
energy:
  kinetic: sum(i = 1..n, m(i)*(x_dot(i)^2 + y_dot(i)^2))/2
  potential: "sum(i = 1..n, sum(j = i+1..n, {term}))"
{more}
initial:
  x(i = 1..n): cos(2.4*i)*i/3
  y(i = 1..n): sin(2.4*i)*i/3
  x_dot(i = 1..n): 0.3*cos(i)
simulation: {{duration: 1, output_step: 0.1}}
"""
SQUARE = "(x(i) - x(j))^2 + (y(i) - y(j))^2"
SOFT = f"-G*m(i)*m(j)/sqrt({SQUARE} + eps^2)"
DAMPERS = """
  dissipation: >-
    0.2*sum(i = 1..n-1, ((x(i+1) - x(i))*(x_dot(i+1) - x_dot(i)) +
    (y(i+1) - y(i))*(y_dot(i+1) - y_dot(i)))^2)
"""
TERMS = {
    "attraction": (SOFT, ""),
    "springs": (f"(sqrt({SQUARE} + 0.01) - 0.2*j)^2", ""),
    "time": (f"-(G + sin(t))/sqrt({SQUARE} + eps^2)", ""),
    "repulsion": (f"0.1*exp(-({SQUARE})/0.01) + ({SQUARE})/5", ""),
    "row": ("if(j < i+2, 20*(hypot(x(i) - x(j), y(i) - y(j)) - 0.4)^2, 0)", DAMPERS),
    "driven": (
        SOFT,
        "  dissipation: 0.1*sum(i = 1..n, x_dot(i)^2)\nforces: {x(1): sin(3*t)}",
    ),
}


def gather(monkeypatch: pytest.MonkeyPatch, least: int) -> None:
    monkeypatch.setattr(elements, "LEAST", least)
    monkeypatch.setattr(elements, "PER_ARGUMENT", 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"),
    [
        (name, method)
        for name in TERMS
        for method in ("dop853", "verlet", "rk4", "taylor", "radau")
        if method != "verlet" or name not in ("driven", "row")  # no forces of rates
    ],
)
def test_motion_is_that_of_the_terms(
    name: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    term, more = TERMS[name]
    text, step = MODEL.format(n=6, term=term, more=more), {"step": 0.01}
    given = step if method in ("verlet", "rk4") else {}
    found = []
    for least in (1, 10**9):
        gather(monkeypatch, least)
        model = lagsim.load(text)
        found.append(lagsim.simulate(model, method=method, error_bar="never", **given))
    one, other = found
    assert one.columns == other.columns
    for column in one.columns:
        scale = max(1.0, np.abs(other[column]).max())
        # Both have rounding errors, and tolerances of 1e-11, of their own.
        assert np.abs(one[column] - other[column]).max() <= 1e-9 * scale
    steps = [x.record["steps"] for x in found]
    assert abs(steps[0] - steps[1]) <= 0.05 * steps[1]


PAIRS = f"definitions: {{V: 'sum(i = 1..n, sum(j = i+1..n, {SQUARE}))'}}\n"
VALUE = "sum(i = 1..n, sum(j = i+1..n, (i^2 + j^2 - 2*i*j*cos(2.4*(i - j)))/9))"
# Rows, events and switches beside the sum. Each moves otherwise than without it.
BESIDE = {
    "floor": 'constraints: {f(i = 1..n): {relation: "y(i) >= -0.9", restitution: 0.5}}',
    "friction": """constraints:
  d(i = 1..n): {relation: "x_dot(i) = 0", limit: 0.4}
  f: {relation: "y(3) >= y0", restitution: 0.3, friction: 0.4, slip: x_dot(3)}""",
    "rods": """constraints:
  r(i = 1..n-1): (x(i+1) - x(i))^2 + (y(i+1) - y(i))^2 = l(i)^2
  line: y(1) = sin(2.4)/3 + 0.3*sin(t) + (x(n) - cos(2.4*n)*n/3)/4""",
    "event": """modes: {k: 0}
events:
  hit: {at: "x(2) >= 0.15", set: {k: k + 1}, impulse: {y(4): 0.7}}
  tick: {every: 0.3, set: {k: 2 - k}}
forces: {x(2): -3*k}""",
    "until": "",
    "state": """states: {s: {rate: "x(1)*y(2) - 2*s"}}
forces: {x(1): -5*s}""",
    "switches": """forces:
  x(1): -0.5*sign(x_dot(1)) + if(t > 0.33, 1, 0)
  y(2): abs(y(2)) - max(x(3), 0.1)*y_dot(2)""",
    "action": "output: {action: true, gauss: true}",
    "sum in a condition": PAIRS
    + """modes: {k: 0}
events: {e: {at: V <= 20.6, set: {k: 1}, impulse: {y(2): 0.02*V}}}
forces: {x(2): -k}""",
    "sum in a row": f"""{PAIRS}constraints: {{c: 'V = {VALUE}'}}""",
    "sum in a bound": PAIRS
    + """constraints:
  d: {relation: "x_dot(2) = 0", limit: V/150}""",
}
STARTS = """  y0: sin(7.2)
  l(i = 1..n-1): >-
    hypot(cos(2.4*i + 2.4)*(i + 1)/3 - cos(2.4*i)*i/3,
    sin(2.4*i + 2.4)*(i + 1)/3 - sin(2.4*i)*i/3)
"""


def beside(name: str, n: int) -> str:
    """Return the model of n bodies that attract, with a feature of BESIDE."""
    text = MODEL.format(n=n, term=SOFT, more=BESIDE[name])
    if name == "sum in a row":
        text = text.replace("0.3*cos(i)", "0")
    if name in ("friction", "rods"):
        text = text.replace("coordinates:", STARTS + "coordinates:")
    if name == "rods":
        text = text.replace("0.3*cos(i)", "0").replace(
            "simulation", "  y_dot(1..n): 0.3\nsimulation"
        )
    if name == "until":
        text = text.replace("duration: 1,", "duration: 1, until: x(2) >= 0.15,")
    if name == "state":
        text = text.replace("initial:\n", "initial:\n  s: 0.4\n")
    return text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"),
    [
        *((name, "dop853") for name in BESIDE),
        *((name, "rk4") for name in BESIDE if name != "action"),
        *((name, "moreau") for name in ("floor", "friction", "rods", "sum in a row")),
    ],
)
def test_motion_beside_rows_and_switches_is_that_of_the_terms(
    name: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, given = beside(name, 6), {} if method == "dop853" else {"step": 0.01}
    found = []
    for least in (1, 10**9):
        gather(monkeypatch, least)
        model = lagsim.load(text)
        assert may_gather(read(text, "model.yaml"), method_named(method).NEEDS) is (
            least == 1
        )
        found.append(lagsim.simulate(model, method=method, error_bar="never", **given))
    one, other = found
    assert one.columns == other.columns
    assert [x.kind for x in one.events] == [x.kind for x in other.events]
    for column in one.columns:
        scale = max(1.0, np.abs(other[column]).max())
        assert np.abs(one[column] - other[column]).max() <= 1e-9 * scale, column
    steps = [x.record["steps"] for x in found]
    assert abs(steps[0] - steps[1]) <= 0.05 * steps[1]


# Features with a sum over pairs in a kink, or with reactions.
WRITTEN_OUT = (
    "constraints: {c: abs(V) = 3}",
    "constraints: {c: {relation: x_dot(1) = 0, limit: 'max(V, 1)'}}",
    "modes: {k: 0}\nevents: {e: {at: floor(V) >= 3, set: {k: 1}}}",
    "forces: {x(1): abs(V - 3)}",
    "forces: {x(1): cbrt(V)}",
    "output: {reactions: [V]}",
)


@pytest.mark.slow
def test_terms_stay_elements_where_nothing_needs_them_written_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gather(monkeypatch, 1)
    plain = (beside(name, 4) for name in BESIDE)
    pairs = (MODEL.format(n=4, term=SOFT, more=PAIRS + more) for more in WRITTEN_OUT)
    for gathers, texts in ((True, plain), (False, pairs)):
        for text in texts:
            model = read(text, "model.yaml")
            assert elements.gathered(model.graph)
            assert may_gather(model) is gathers, text
            assert not may_gather(model, ("jacobian",))  # of a method


@pytest.mark.parametrize(("method", "n"), [("taylor", 100), ("radau", 151)])
def test_method_for_fewer_terms_is_refused_before_they_are_written_out(
    method: str, n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(Model, "written_out")
    text = MODEL.format(n=n, term=SOFT, more="")
    with pytest.raises(lagsim.InputError) as fault:
        lagsim.simulate(text, method=method)
    (problem,) = fault.value.problems
    assert problem.code == METHOD_REFUSED
    assert str(2 * n) in problem.text or method == "taylor"


@pytest.mark.slow
def test_cluster_moves_as_scipy_has_it() -> None:
    n = 48
    result = lagsim.simulate(MODEL.format(n=n, term=SOFT, more=""), error_bar="never")
    i = np.arange(1, n + 1)
    m = 1 + 0.1 * i

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        x, y, u, v = state.reshape(4, n)
        dx, dy = x[:, None] - x, y[:, None] - y
        pull = -1.3 * m / (dx**2 + dy**2 + 0.16) ** 1.5
        return np.concatenate([u, v, (pull * dx).sum(1), (pull * dy).sum(1)])

    r = i / 3
    start = [np.cos(2.4 * i) * r, np.sin(2.4 * i) * r, 0.3 * np.cos(i), 0.0 * i]
    expected = solve_ivp(
        rates, (0.0, 1.0), np.concatenate(start), "DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]
    names = [f"{q}.{k}" for q in ("x", "y") for k in i]
    found = np.array([result[name][-1] for name in names])
    assert result.record["energy_drift"] < 1e-9 * abs(result["energy"][0])
    assert np.abs(found - expected[: 2 * n]).max() < 1e-8


NET = """
parameters: {n: 21, l0: 0.9}
coordinates:
  "r(i = 1..n, j = 1..n)": {components: xyz}
energy:
  kinetic: sum(i = 1..n, sum(j = 1..n, dot(r_dot(i, j), r_dot(i, j))))/2
  potential: >-
    sum(i = 1..n-1, sum(j = 1..n, 50*(norm(r(i+1, j) - r(i, j)) - l0)^2 +
    50*(norm(r(j, i+1) - r(j, i)) - l0)^2))
initial:
  "r(i = 1..n, j = 1..n)": vec(i, j, sin(0.3*i)*cos(0.2*j))
simulation: {duration: 0.2, output_step: 0.1}
"""


@pytest.mark.slow
def test_net_moves_as_scipy_has_it() -> None:
    n = 21
    assert read(NET, "net.yaml").graph.of((ELEMENTS,))
    result = lagsim.simulate(NET, error_bar="never")

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        r, v = state.reshape(2, n, n, 3)
        force = np.zeros_like(r)
        for axis in (0, 1):
            d = np.diff(r, axis=axis)
            length = np.sqrt((d * d).sum(-1, keepdims=True))
            pull = 100.0 * (length - 0.9) * d / length
            before, after = [slice(None)] * 2, [slice(None)] * 2
            before[axis], after[axis] = slice(None, -1), slice(1, None)
            force[tuple(before)] += pull
            force[tuple(after)] -= pull
        return np.concatenate([v.ravel(), force.ravel()])

    i, j = np.meshgrid(np.arange(1.0, n + 1), np.arange(1.0, n + 1), indexing="ij")
    start = np.stack([i, j, np.sin(0.3 * i) * np.cos(0.2 * j)], axis=-1).ravel()
    expected = solve_ivp(
        rates, (0.0, 0.2), np.append(start, 0 * start), "DOP853", rtol=1e-13, atol=1e-13
    ).y[:, -1]
    found = [
        result[f"r.{a}.{b}.{c}"][-1]
        for a in range(1, n + 1)
        for b in range(1, n + 1)
        for c in "xyz"
    ]
    # Both with tolerances of 1e-11 and less, over a few steps.
    assert np.abs(np.array(found) - expected[: 3 * n * n]).max() < 1e-10
    energy = result["energy"]
    assert np.abs(energy - energy[0]).max() < 1e-11 * energy[0]


@pytest.mark.slow
def test_sweep_over_a_parameter_of_the_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    gather(monkeypatch, 1)
    model = lagsim.load(MODEL.format(n=6, term=SOFT, more=""))
    values = [0.5, 1.3, 2.0]
    sweep = lagsim.sweep(model, {"G": values}, jobs=1)
    for k, G in enumerate(values):
        alone = lagsim.simulate(model.bind(G=G), error_bar="never")
        assert sweep["x.3.end"][k] == alone["x.3"][-1]


@pytest.mark.slow
@pytest.mark.parametrize("damped", [True, False])
def test_stiff_motion_is_reported_where_it_may_have_died_out(
    damped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    gather(monkeypatch, 1)
    losses = "sum(i = 1..n, sum(j = i+1..n, 1e3*(x_dot(i) - x_dot(j))^2))"
    text = f"""
parameters: {{n: 5}}
coordinates: {{x(1..n): {{}}}}
energy:
  kinetic: sum(i = 1..n, x_dot(i)^2)/2
  potential: "sum(i = 1..n, sum(j = i+1..n, 1e5*(x(i) - x(j) - i + j)^2))"
  dissipation: "{losses if damped else 0}"
initial:
  x(i = 1..n): i + 1e-3*cos(i)
simulation: {{duration: 5, output_step: 0.1, rtol: 1e-4}}
"""
    result = lagsim.simulate(text, error_bar="never", method="dop853")
    codes = [x.code for x in result.warnings]
    assert codes.count("step-at-stability-bound") == damped
    if damped:  # the advice holds
        stiff = lagsim.simulate(text, error_bar="never", method="radau")
        assert not stiff.warnings


@pytest.mark.slow
def test_close_encounter_is_not_stepped_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short-ranged wall acts on two of five bodies that pass each other."""
    text = """
parameters: {n: 5}
coordinates: {x(1..n): {}}
energy:
  kinetic: sum(i = 1..n, x_dot(i)^2)/2
  potential: "sum(i = 1..n, sum(j = i+1..n, 0.3*exp(-((x(i) - x(j))/1e-3)^2)))"
initial:
  x(i = 1..n): 10*i
  x_dot(1): 1
simulation: {duration: 30, output_step: 10}
"""
    gather(monkeypatch, 1)
    result = lagsim.simulate(text, error_bar="never", method="dop853")
    # 1/4 of the energy, that of relative motion, is less than 0.3: equal bodies
    # exchange their velocities, so that each one stops where the next one was.
    ends = [result[f"x.{k}"][-1] for k in range(1, 6)]
    assert ends == pytest.approx([20, 30, 40, 40, 50], abs=0.01)
