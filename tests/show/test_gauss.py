"""Gauss's principle by numbers, at single states; optional columns."""

import re

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.names import rate_of
from lagsim.show.lagrange import derived
from lagsim.show.printers import as_json
from tests.show.cases import known, numbers
from tests.support import (
    MODELS,
    SHIPPED,
    case_of,
    constraints_of,
    has_laws,
    ready,
    refused,
    run,
)

# Without the constraint of its length a quaternion has directions without inertia.
CONSTRAINED = [name for name in SHIPPED if constraints_of(name) and not has_laws(name)]
QUICK = ("elastic-pendulum-curve", "rolling-disk", "appell-hamel", "car-axis")
EACH = [
    pytest.param(n, marks=[] if n in QUICK else [pytest.mark.slow]) for n in CONSTRAINED
]


def asking(name, **wanted):
    """Return the text of a shipped model with keys of `output` added."""
    text = (MODELS / f"{name}.yaml").read_text(encoding="utf-8")
    text = re.sub(r"(?m)^output: \{(.*)\}$", r"output:\n  \1", text)
    lines = "".join(f"  {key}: true\n" for key in wanted)
    if "\noutput:\n" not in text:
        return f"{text}output:\n{lines}"
    return text.replace("\noutput:\n", f"\noutput:\n{lines}")


def observed(name, *, loops):
    """Return the equations, the columns at the start and the system."""
    session = ready(asking(name, gauss=True), loops=loops)
    start, system = session.case.start, session.system
    runner = system.link("dop853")
    y = system.begin(start)
    runner.prepare()
    row = runner.function("observe")(start.t, y)
    columns = dict(zip(system.columns.names, row, strict=False))
    return session.case.equations, columns, system


@pytest.mark.slow
@pytest.mark.parametrize("loops", [False, True], ids=["straight", "dense"])
@pytest.mark.parametrize("name", EACH)
def test_accelerations_make_it_least_among_admissible_ones(name, loops):
    e, row, system = observed(name, loops=loops)
    values = {**row, **{p.name: p.value for p in e.model.parameters}}
    n = len(e.q)
    M = np.reshape(evaluate(e.graph, [x for r in e.M for x in r], values), (n, n))
    A = np.array([evaluate(e.graph, r.A, values) for r in e.rows])
    f = np.array(evaluate(e.graph, e.f, values))
    a = np.array([row[f"gauss.a_{q}"] for q in e.q])
    q_ddot = np.array([row[rate_of(q, 2)] for q in e.q])
    # M a = f, to the backward error of a Cholesky factorisation.
    size = np.abs(M) @ np.abs(a) + np.abs(f)
    assert np.all(np.abs(M @ a - f) <= 1e-12 * (size + np.max(size)))
    least = (q_ddot - a) @ M @ (q_ddot - a) / 2
    assert row["gauss.G"] == pytest.approx(least, rel=1e-12, abs=1e-300)
    # It is least where no admissible direction is a slope of it: M is definite.
    _, sizes, right = np.linalg.svd(A)
    free = right[int(np.sum(sizes > 1e-9 * sizes[0])) :]
    assert len(free) == n - np.linalg.matrix_rank(A)
    size = np.abs(M) @ (np.abs(q_ddot) + np.abs(a))
    assert np.all(np.abs(free @ M @ (q_ddot - a)) <= 1e-9 * np.max(size))
    b = np.array([evaluate(e.graph, [r.b], values)[0] for r in e.rows])
    size = np.abs(A) @ np.abs(q_ddot) + np.abs(b)
    # Where the terms of a row vanish, as of a bicycle upright, the accelerations in it
    # have the rounding of the largest one.
    rounding = 4 * np.finfo(float).eps * np.max(np.abs(A)) * np.max(np.abs(q_ddot))
    assert np.all(np.abs(A @ q_ddot - b) <= 1e-9 * size + rounding)
    assert list(system.columns.names[: system.columns.table][-n - 1 :]) == [
        *(f"gauss.a_{q}" for q in e.q), "gauss.G",
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", ["elastic-pendulum-curve", "chaplygin-sleigh"])
def test_symbolic_and_numeric_gauss_agree(name):
    e, row, _ = observed(name, loops=False)
    d = as_json(derived(e, with_gauss=True))
    values = known(d, {**{p.name: p.value for p in e.model.parameters}, **row})
    found = numbers(list(d["gauss"]["a"].values()), values)
    a = [row[f"gauss.a_{q}"] for q in e.q]
    assert found == pytest.approx(a, rel=1e-12, abs=1e-12)
    values |= dict(zip(d["gauss"]["a"], a, strict=True))
    assert numbers([d["gauss"]["G"]], values) == pytest.approx(
        [row["gauss.G"]], rel=1e-12
    )
    Qc = [row[f"Qc_{q}"] for q in e.q]
    assert numbers(d["gauss"]["Qc"], values) == pytest.approx(Qc, rel=1e-11, abs=1e-12)


MASSLESS = """
parameters: {m: 2, k: 3}
coordinates: {x: {}, y: {}}
energy: {kinetic: m*x_dot^2/2, potential: k*x^2/2}
constraints: {tie: y = x}
initial: {x: 1, y: 1}
simulation: {duration: 1}
output: {gauss: true}
"""


def test_a_singular_mass_matrix_has_no_unconstrained_acceleration():
    case = case_of(MASSLESS)
    e = case.equations
    with refused("singular-mass", "`output.gauss`"):
        case.plan()
    with refused("singular-mass"):
        derived(e, with_gauss=True)
    derived(e)


@pytest.mark.slow
def test_without_constraints_it_is_zero():
    r = run(asking("double-pendulum", gauss=True), duration=0.1)
    assert np.all(r["gauss.G"] < 1e-20)
    assert np.array_equal(r["gauss.a_theta1"], r["theta1_ddot"])


def test_methods_that_would_leave_the_action_out_are_refused():
    text = asking("pendulum-cartesian", action=True)
    for name in ("rattle", "radau"):
        with refused("method-refused", f"`{name}`", "`output`"):
            run(text, method=name)
