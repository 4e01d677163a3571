"""Modules of runs by another engine, bit by bit against native portable runs."""

from __future__ import annotations

import numpy as np
import pytest
import wasmtime

from lagsim.api.models import model_of
from lagsim.language.functions import ELEMENTS
from lagsim.native.link import wasm
from lagsim.native.link.engine import NativeError
from lagsim.program import webassembly
from lagsim.run.arcs import Run
from lagsim.run.observers import Keep
from lagsim.run.session import open_case
from tests.support import MODELS

PENDULUM = MODELS / "double-pendulum.yaml"
# Between them they call nearly all that models and kernels may.
RUNS = [
    ("elastic-pendulum", "auto"), ("double-pendulum", "dop853"), ("kepler", "gauss4"),
    ("andrews", "auto"), ("rolling-disk", "dop853"), ("moving-pivot", "radau"),
    ("coupled-oscillators", "auto"), ("chain-cartesian", "auto"),
    ("car-axis", "generalized-alpha"), ("bead-hoop-cartesian", "rattle"),
    ("kepler", "kahan-li8"), ("charged-particle", "rk4"),
]  # fmt: skip
FUNCTIONS = """
name: functions
coordinates: {x: {}, v: {}}
initial: {x: 0.4, v: -0.7, x_dot: 1, v_dot: 0.2}
parameters: {a: 0.3, far: 2.5e6}
energy:
  kinetic: (x_dot^2 + v_dot^2)/2
  potential: >-
    cosh(a*x) + x^4*hypot(x, v + 2)/9 + exp(-v^2) + (1.5 + tanh(v))^(2 + a)
    + cbrt(x + 9) + log(3 + x^2) + log10(4 + v^2) + asinh(x) + atan2(x, 2 + v^2)
    + asin(x/(9 + x^2)) + acos(v/(9 + v^2)) + atanh(x/(3 + x^2)) + acosh(2 + v^2)
    + sinh(a*v)^2 + tan(x/(2 + x^2)) + atan(v) + sin(far + x)
simulation: {duration: 30, output_step: 0.1, until: v = -2.4}
"""


@pytest.fixture(autouse=True)
def _portable(monkeypatch):
    monkeypatch.setenv("LAGSIM_CPU", "portable")


def made(source, method="auto", **values):
    """Return a module, and the rows of the run from which it was made."""
    model = model_of(source).bind(**values)
    session = open_case(model, model.settings({"method": method})).ready()
    keep = Keep()
    run = Run(session.first_arc(), [keep])
    run.begin()
    module = webassembly.module(run.arc.runner, run.arc.state)
    run.whole(10**7)
    return module, keep.table


@pytest.fixture(scope="module")
def pendulum():
    """Return the module and the portable rows of the double pendulum."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LAGSIM_CPU", "portable")
        return made(PENDULUM)


def by_wasmtime(module, **values):
    """Run a module, with values of parameters; return its rows and its last code."""
    about = wasm.described(module)
    store = wasmtime.Store(wasmtime.Engine())
    instance = wasmtime.Instance(store, wasmtime.Module(store.engine, module), [])
    prepare, advance, tabulate = (
        instance.exports(store)[x] for x in webassembly.EXPORTS
    )
    memory, at = instance.exports(store)["memory"], about["places"]

    def numbers(place, count):
        data = memory.get_buffer_ptr(store, memory.data_len(store) - place, place)
        return np.frombuffer(data, count=count)

    size, width = len(about["state"]), len(about["columns"])
    s = numbers(at["state"], (at["parameters"] - at["state"]) // 8)
    p = numbers(at["parameters"], (at["rows"] - at["parameters"]) // 8)
    words, found = about["words"], []
    for name, value in values.items():
        p[about["parameters"][name]["word"]] = value
    prepare(store, 0.0, 0, at["parameters"], 0)

    def tabulated(count):
        places = at["parameters"], at["columns"]
        tabulate(store, at["rows"], count, size, *places, width)
        shown = numbers(at["columns"], count * width)
        found.append(shown.reshape(count, width).copy())

    code = "BLOCK_FULL"
    while code in ("BLOCK_FULL", "PAUSED", "STIFF"):
        given = at["state"], at["parameters"], at["rows"], about["block"]
        code = about["codes"][str(advance(store, *given, 1000))]
        tabulated(int(s[words["emitted"]]))
        if code == "STIFF":
            s[words["pause_at"]] = 0.0
    last = numbers(at["rows"], 1 + size)
    last[0], last[1:] = s[words["t"]], s[words["y"] :][:size]
    tabulated(1)
    return np.concatenate(found), code


def same(rows, others):
    return np.array_equal(rows.view(np.int64), others.view(np.int64))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "method"), RUNS)
def test_rows_equal_native_ones_in_all_bits(name, method):
    module, native = made(MODELS / f"{name}.yaml", method)
    rows, code = by_wasmtime(module)
    assert code == "DONE"
    assert len(native) > 900
    assert same(rows, native)


@pytest.mark.slow
def test_loops_over_pairs():
    text = """
parameters: {n: 48}
coordinates: {x(1..n): {}, y(1..n): {}}
energy:
  kinetic: sum(i = 1..n, x_dot(i)^2 + y_dot(i)^2)/2
  potential: >-
    sum(i = 1..n, sum(j = i+1..n, -i/sqrt((x(i) - x(j))^2 + (y(i) - y(j))^2 + 0.1)))
initial: {x(i = 1..n): cos(2.4*i)*i, y(i = 1..n): sin(2.4*i)*i}
simulation: {duration: 0.5, output_step: 0.01}
"""
    assert model_of(text).graph.of((ELEMENTS,))
    module, native = made(text)
    rows, code = by_wasmtime(module)
    assert code == "DONE"
    assert same(rows, native)


@pytest.mark.slow
def test_every_function_and_a_condition_that_ends_the_run():
    module, native = made(FUNCTIONS)
    rows, code = by_wasmtime(module)
    assert code == "EVENT_FOUND"
    assert same(rows, native)
    v = wasm.described(module)["columns"].index("v")
    assert rows[-1, v] == pytest.approx(-2.4, abs=1e-14)


@pytest.mark.slow
def test_parameters_are_set_in_the_module(pendulum):
    module, former = pendulum
    _, native = made(PENDULUM, m2=2.0)
    rows, _ = by_wasmtime(module, m2=2.0)
    assert same(rows, native)
    assert not same(rows, former)


@pytest.mark.slow
def test_a_module_describes_itself(pendulum):
    module, native = pendulum
    about = wasm.described(module)
    assert about["version"] == 1
    assert about["columns"][:3] == ["t", "theta1", "theta2"]
    assert len(about["columns"]) == native.shape[1]
    values = {name: x["value"] for name, x in about["parameters"].items()}
    # As the file has them.
    assert values == dict.fromkeys(("m1", "m2", "l1", "l2"), 1.0) | {"g": 9.81}
    parsed = wasmtime.Module(wasmtime.Engine(), module)
    assert parsed.imports == []
    assert [x.name for x in parsed.exports] == [*webassembly.EXPORTS, "memory"]


@pytest.mark.parametrize(
    "name",
    ["stick-slip", *(pytest.param(x, marks=pytest.mark.slow)
                     for x in ("bouncing-ball", "dc-motor"))],
)  # fmt: skip
def test_runs_that_python_leads_have_none(monkeypatch, name):
    # Refused before a module is compiled: no portable kernels are needed.
    monkeypatch.setenv("LAGSIM_CPU", "host")
    with pytest.raises(NativeError, match="they have no module"):
        made(MODELS / f"{name}.yaml")


def test_the_portable_target_differs_from_the_host_by_rounding_alone(
    monkeypatch, pendulum
):
    monkeypatch.setenv("LAGSIM_CPU", "host")
    (_, portable), (_, host) = pendulum, made(PENDULUM)
    early = portable[:, 0] < 3.0  # chaos multiplies a difference by ten in 2 s
    assert np.allclose(portable[early], host[early], rtol=1e-9, atol=1e-9)
