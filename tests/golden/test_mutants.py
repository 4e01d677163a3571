"""Detection by goldens: a table of 200 mutants, and variants without detection.

The variants are runs with other tolerances, processors, and libraries of functions.
"""

import functools
import platform
import re
from dataclasses import replace

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.native.graph import straight_line, tapes
from lagsim.native.graph.lines import BOTH, LANES, SINCOS, VECTOR
from lagsim.studies.golden import judge, new_golden, run
from lagsim.studies.motions import METHODS, motion_of, perturbed
from tests.choosing import share, tonight
from tests.golden.scenes import judged, replaced, scene, stored, told
from tests.support import SHIPPED

SEEN = 200
# A range below this part of the size is that of rounding errors.
NOISE = 1e-9


@functools.cache
def whole(name):
    """Return the unchanged motion in all rows, and the indices of the golden's rows."""
    golden = stored(name)
    other = scene(name)
    motion = motion_of(other, 1)
    place = np.searchsorted(motion.rows[:, 0], golden.rows[:, 0] - 1e-9)
    return other, motion, place


def ranges(name):
    """Return the columns that move, with their ranges in the golden."""
    golden = stored(name)
    wide = np.ptp(golden.rows, axis=0)
    size = np.max(np.abs(golden.rows), axis=0)
    return {
        column: wide[k]
        for k, column in enumerate(golden.columns)
        if column != "t" and wide[k] > NOISE * size[k] and not noisy(column)
    }


def noisy(column):
    """Return whether a column consists of errors only in the shipped models."""
    return column.startswith(("residual_", "error", "perihelion"))


# Bodies that only strike each other, and never press: their multipliers are 0.
STRIKING = ("ball-on-a-vibrating-table", "newtons-cradle")
# Polynomials of t, between impacts that are located: rk4 solves them exactly.
POLYNOMIAL = ("appell-hamel", "ball-on-a-vibrating-table", "bouncing-ball")
# What a motion does not depend on: a block whose friction holds it, whatever it is; the
# masses of bodies whose centres rest; the length of springs in the drawing alone.
UNFELT = {
    ("jenkins-element", "l"), ("rocking-block", "mu"), ("spacecraft", "M"),
    ("spacecraft", "m"),
}  # fmt: skip


def lambda_sign(name, _random):
    if name in STRIKING:
        return
    other, motion, _ = whole(name)
    # The length of a quaternion takes no force.
    forceless = {f"lambda_{row}" for row in other.equations.model.quaternions}
    pushing = [c for c in motion.columns if c.startswith("lambda_")]
    for column in [c for c in pushing if c not in forceless][:2]:
        k = motion.columns.index(column)
        yield column, other, replaced(motion, column, -motion.rows[:, k])


def parameters(name, random):
    model = scene(name).equations.model
    some = [p for p in model.parameters if p.value and (name, p.name) not in UNFELT]
    for k in random.permutation(len(some))[:2]:
        changed = {some[k].name: some[k].value * (1 + 1e-6)}
        try:
            other = scene(name, **changed)
        except InputError:  # a number of members, which is whole
            continue
        yield some[k].name, other, None


def gravity(name, _random):
    for p in scene(name).equations.model.parameters:
        if p.name == "g":
            changed = p.value + 10.0 ** (np.floor(np.log10(p.value)) - 6)
            yield f"{changed:.7g}", scene(name, g=float(changed)), None


def row_shifted(name, random):
    other, motion, place = whole(name)
    k = int(random.choice(place[1:]))
    rows = motion.rows.copy()
    rows[k, 1:] = rows[k - 1, 1:]
    yield f"row {k}", other, replace(motion, rows=rows)


def columns_swapped(name, random):
    other, motion, place = whole(name)
    wide = ranges(name)
    names = list(wide)
    while True:
        a, b = (names[k] for k in random.choice(len(names), 2, replace=False))
        one, two = (motion.rows[:, motion.columns.index(c)] for c in (a, b))
        # Equal columns, as a force and its constraint's, may change places.
        if np.max(np.abs(one - two)[place]) > 1e-5 * max(wide[a], wide[b]):
            break
    yield f"{a}, {b}", other, replaced(replaced(motion, a, two), b, one)


def coarse_rk4(name, _random):
    if name in POLYNOMIAL:
        return
    other = scene(name)
    step = other.settings.duration / 100
    yield f"step {step:.2g}", other.with_settings(method="rk4", step=step), None


def cell(name, random):
    other, motion, place = whole(name)
    wide = ranges(name)
    golden = stored(name)
    known = place[golden.rows[:, 0] < KNOWN_UNTIL.get(name, np.inf)]
    for _ in range(3):
        column = str(random.choice(list(wide)))
        k = int(random.choice(known))
        values = motion.rows[:, motion.columns.index(column)].copy()
        values[k] += 1e-6 * wide[column] * random.choice([-1, 1])
        yield f"{column}, row {k}", other, replaced(motion, column, values)


# Times until which a run at 100 times the tolerance, which a golden accepts, knows each
# column to a millionth of its range: later a change of this size cannot be seen. For
# Kepler and for Henon and Heiles: scipy's DOP853 at rtol 1e-9 against rtol 3e-14.
KNOWN_UNTIL = {"double-pendulum": 6.0, "henon-heiles": 573.0, "kepler": 31.0}
MUTANTS = (
    lambda_sign, parameters, gravity, row_shifted, columns_swapped, coarse_rk4, cell,
)  # fmt: skip


# A model that came later leaves the draws of those before as they were.
LATER = (
    "bicycle", "car-on-a-road", "dc-motor", "henon-heiles", "jenkins-element",
    "quadruped",
)  # fmt: skip


def mutants():
    """Return kind, model, change, scene and motion of each mutant, reproducibly."""
    for number, name in enumerate(sorted(SHIPPED, key=LATER.count)):
        random = np.random.default_rng(number)
        for kind in MUTANTS:
            yield from ((kind.__name__, name, *m) for m in kind(name, random))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameter"), sorted(UNFELT))
def test_no_motion_depends_on_what_is_unfelt(name, parameter):
    values = {p.name: p.value for p in scene(name).equations.model.parameters}
    changed = {parameter: 1.1 * values[parameter]}
    assert judged(name, scene(name, **changed), None).passed


@pytest.mark.slow
def test_mutants_are_seen():
    table, missed = [], []
    for kind, name, what, other, motion in mutants():
        try:
            found = judged(name, other, motion)
        except InputError:  # a method that cannot handle the model
            continue
        line = f"{kind:16} {name:24} {what:28} {told(found)}"
        table.append(line)
        if found.passed:
            missed.append(line)
    assert len(table) >= SEEN
    assert len(missed) <= 1, "\n" + "\n".join(missed)


def variants(name):
    """Return label and scene of each variant that must not be detected."""
    other = scene(name)
    for seed in (101, 102):
        yield f"one ulp, seed {seed}", perturbed(other, seed)
    plan = motion_of(other, 1).plan
    # What has no tolerance is solved by a method that has.
    method = plan.method if plan.rtol else "dop853"
    for rtol in (1e-12, 1e-10):
        yield f"rtol {rtol:.0e}", other.with_settings(method=method, rtol=rtol)
    for method in METHODS:
        if method != plan.method:
            yield method, other.with_settings(method=method)


@pytest.mark.nightly
def test_nothing_else_is_flagged():
    flagged, count = [], 0
    models = share(SHIPPED, tonight(), 2)
    for name in models:
        for label, other in variants(name):
            try:
                found = judged(name, other)
            except InputError:
                continue
            count += 1
            line = f"{name:24} {label:20} {told(found)}"
            if not found.passed:
                flagged.append(line)
    assert count > 5 * len(models)
    assert not flagged, "\n" + "\n".join(flagged)


def test_a_run_is_judged_at_the_goldens_times():
    found = judged("kepler", scene("kepler").with_settings(output_step=0.1))
    assert found.passed
    assert any("rows every" in note for note in found.notes)
    assert run(scene("kepler"), stored("kepler")).rows.shape[1] == 14


# Other machines

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
    """Generate all code with functions that are off in the last place."""
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
    """Return test parameters: some are slow, the others nightly."""
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
    """Return processors whose code this one can run."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return ["generic", "portable"]
    from llvmlite.binding import get_host_cpu_features

    has = get_host_cpu_features()
    v3 = all(has.get(f) for f in ("avx2", "fma", "bmi2", "lzcnt", "movbe", "f16c"))
    return ["generic", "portable", "x86-64", *(["x86-64-v3"] if v3 else [])]


@pytest.mark.parametrize("target", some_nightly(other_targets(), ["generic"]))
def test_other_processors(target, monkeypatch):
    monkeypatch.setenv("LAGSIM_CPU", target)
    for name in SHIPPED:
        found = judged(name, scene(name))
        assert found.passed, f"{name}: {told(found)}"


@pytest.mark.slow
def test_the_horizon_of_chaos(monkeypatch, request):
    monkeypatch.delenv("LAGSIM_CPU", raising=False)
    long = scene("double-pendulum").with_settings(end=60.0)
    golden, base = new_golden(long)
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
