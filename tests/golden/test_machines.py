"""One golden for all machines: other processors, other libraries of functions."""

from __future__ import annotations

import platform
import re
from dataclasses import replace

import pytest

from lagsim.native.graph import straight_line, tapes
from lagsim.native.graph.lines import BOTH, LANES, SINCOS, VECTOR
from lagsim.studies.golden import judge, measure, motion_of, run
from tests.golden.scenes import SHIPPED, judged, scene, told

# What a library of functions may round otherwise; roots, `floor` and the like are exact
# everywhere.
ROUNDED = (
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh",
    "asinh", "acosh", "atanh", "exp", "log", "log10", "cbrt", "hypot", "pow",
)  # fmt: skip
CALL = re.compile(rf"call double @((?:llvm\.)?(?:{'|'.join(ROUNDED)})(?:\.f64)?)\(")

# One unit in the last place up or down, as a bit of the result has it; 0 stays 0.
NUDGED = """
define internal double @nudged.{name}({parameters}) {{
  %y = call double @{name}({arguments})
  %bits = bitcast double %y to i64
  %third = and i64 %bits, 4
  %up = icmp eq i64 %third, 0
  %change = select i1 %up, i64 1, i64 -1
  %other = add i64 %bits, %change
  %moved = bitcast i64 %other to double
  %some = fcmp une double %y, 0.0
  %r = select i1 %some, double %moved, double %y
  ret double %r
}}
"""

# lagsim's own are the same on all machines, but may be improved one day.
UP = f"<{', '.join(LANES * ['double 0x3FF0000000000001'])}>"
SEVERAL = f"""
define internal {BOTH} @{SINCOS}({VECTOR} %x) noinline {{
  %exact = call {BOTH} @exact.{SINCOS}({VECTOR} %x)
  %sines = extractvalue {BOTH} %exact, 0
  %cosines = extractvalue {BOTH} %exact, 1
  %s = fmul {VECTOR} %sines, {UP}
  %c = fmul {VECTOR} %cosines, {UP}
  %first = insertvalue {BOTH} undef, {VECTOR} %s, 0
  %both = insertvalue {BOTH} %first, {VECTOR} %c, 1
  ret {BOTH} %both
}}
"""


@pytest.fixture
def rounding_otherwise(monkeypatch, tmp_path):
    """Make all code that is generated use functions that are off in the last place."""
    # The usual code of a graph is in the usual cache.
    monkeypatch.setenv("LAGSIM_CACHE", str(tmp_path / "otherwise"))
    for module in (straight_line, tapes):
        monkeypatch.setattr(module, "generate", nudging(module.generate))


def nudging(generate):
    def generated(*arguments, **named):
        code = generate(*arguments, **named)
        return code._replace(ir=nudged(code.ir))

    return generated


def nudged(ir):
    for name in sorted(set(CALL.findall(ir))):
        two = any(word in name for word in ("atan2", "hypot", "pow"))
        parameters = ", ".join(f"double {x}" for x in ("%a", "%b")[: 1 + two])
        ir = ir.replace(f"call double @{name}(", f"call double @nudged.{name}(")
        ir += NUDGED.format(name=name, parameters=parameters, arguments=parameters)
    definition = f"define internal {BOTH} @{SINCOS}("
    if definition in ir:
        ir = ir.replace(definition, definition.replace("@", "@exact.")) + SEVERAL
    return ir


def some_nightly(every, slow):
    """Give test parameters: some are slow, the others wait for the night."""
    marks = {True: pytest.mark.slow, False: pytest.mark.nightly}
    return [pytest.param(one, marks=marks[one in slow]) for one in every]


FEW = ["andrews", "bouncing-ball", "double-pendulum", "elastic-pendulum", "kepler"]


@pytest.mark.parametrize("name", some_nightly(SHIPPED, FEW))
@pytest.mark.usefixtures("rounding_otherwise")
def test_functions_that_round_otherwise(name):
    found = judged(name, scene(name))
    assert found.passed, told(found)


@pytest.mark.slow
def test_functions_do_round_otherwise(request):
    usual = motion_of(scene("double-pendulum"), 1).rows
    request.getfixturevalue("rounding_otherwise")
    other = motion_of(scene("double-pendulum"), 1).rows
    assert 0.0 < abs(other[1, 5] - usual[1, 5]) < 1e-13


def other_targets():
    """Give processors that this one can run code for."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return ["generic"]
    from llvmlite.binding import get_host_cpu_features

    has = get_host_cpu_features()
    v3 = all(has.get(f) for f in ("avx2", "fma", "bmi2", "lzcnt", "movbe", "f16c"))
    return ["generic", "x86-64", *(["x86-64-v3"] if v3 else [])]


@pytest.mark.parametrize("target", some_nightly(other_targets(), ["generic"]))
def test_other_processors(target, monkeypatch):
    monkeypatch.setenv("LAGSIM_CPU", target)
    for name in SHIPPED:
        found = judged(name, scene(name))
        assert found.passed, f"{name}: {told(found)}"


@pytest.mark.slow
def test_the_horizon_of_chaos(monkeypatch, request):
    monkeypatch.delenv("LAGSIM_CPU", raising=False)
    long = scene("double-pendulum").asking(end=60.0)
    golden, base = measure(long)
    # Errors grow tenfold in 2 s (the header): 1e-11 becomes 1 in about 22 s, and
    # a run at a hundred times that, which passes ten times over, 6 s earlier.
    assert 14.0 < golden.horizon < 20.0
    assert golden.rows[-1, 0] < golden.horizon < base.rows[-1, 0] == 60.0
    about = {"output_step": 0.01, "end": 60.0, "outcome": "done"}
    kept = replace(golden, about=about)
    for target in other_targets():
        monkeypatch.setenv("LAGSIM_CPU", target)
        assert judge(long, run(long, kept), kept).passed
    monkeypatch.delenv("LAGSIM_CPU")
    # Past the horizon what is kept is still compared.
    drifting = base.rows.copy()
    drifting[-1, base.columns.index("energy")] += 1e-5
    found = judge(long, replace(base, rows=drifting), kept)
    assert [d.column for d in found.worst if not d.passed] == ["energy (constant)"]
    # A library that rounds otherwise ends elsewhere, and passes too.
    request.getfixturevalue("rounding_otherwise")
    motion = run(long, kept)
    assert judge(long, motion, kept).passed
    assert abs(motion.rows[-1] - base.rows[-1]).max() > 0.1
