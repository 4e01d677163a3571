"""Gauss's principle and the action, by numbers, along runs and at single states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.language.evaluate import evaluate
from lagsim.model.reader import read
from lagsim.show.as_json import as_json
from lagsim.show.lagrange import content
from tests.show.cases import NAMES, equations_of, known, numbers
from tests.support import MODELS, Run, case_of, ready, run

if TYPE_CHECKING:
    from lagsim.run.system import System

CONSTRAINED = [name for name in NAMES if equations_of(name).rows]
QUICK = ("elastic-pendulum-curve", "rolling-disk", "appell-hamel", "car-axis")
EACH = [
    pytest.param(n, marks=[] if n in QUICK else [pytest.mark.slow]) for n in CONSTRAINED
]


def asking(name: str, **wanted: bool) -> str:
    """Give the text of a shipped model with keys of `output` added."""
    text = (MODELS / f"{name}.yaml").read_text(encoding="utf-8")
    lines = "".join(f"  {key}: true\n" for key in wanted)
    if "\noutput:\n" not in text:
        return f"{text}output:\n{lines}"
    return text.replace("\noutput:\n", f"\noutput:\n{lines}")


def observed(name: str, *, loops: bool) -> tuple[Any, dict[str, float], System]:
    """Give the equations, the columns at the start and the system."""
    session = ready(asking(name, gauss=True), loops=loops)
    start, system = session.case.start, session.system
    runner = system.link("dop853")
    runner.prepare()
    y = system.begin(start)
    row = runner.function("observe")(start.t, y)
    columns = dict(zip(system.columns.names, row, strict=False))
    return session.case.equations, columns, system


@pytest.mark.parametrize("loops", [False, True], ids=["straight", "dense"])
@pytest.mark.parametrize("name", EACH)
def test_accelerations_make_it_least_among_admissible_ones(
    name: str, loops: bool
) -> None:
    e, row, system = observed(name, loops=loops)
    parameters = {p.name: p.value for p in e.model.parameters}
    values = {**row, **parameters}
    n = len(e.q)
    M = np.reshape(evaluate(e.graph, [x for r in e.M for x in r], values), (n, n))
    A = np.array([evaluate(e.graph, r.A, values) for r in e.rows])
    f = np.array(evaluate(e.graph, e.f, values))
    b = np.array([evaluate(e.graph, [r.b], values)[0] for r in e.rows])
    a = np.array([row[f"gauss.a_{q}"] for q in e.q])
    q_ddot = np.array([row[f"{q}_ddot"] for q in e.q])
    # M a = f, to the backward error of a Cholesky factorisation.
    size = np.abs(M) @ np.abs(a) + np.abs(f)
    assert np.all(np.abs(M @ a - f) <= 1e-12 * (size + np.max(size)))

    def gauss(x: Any) -> float:
        return float((x - a) @ M @ (x - a) / 2)

    least = gauss(q_ddot)
    assert row["gauss.G"] == pytest.approx(least, rel=1e-12, abs=1e-300)
    _, sizes, right = np.linalg.svd(A)
    free = right[int(np.sum(sizes > 1e-9 * sizes[0])) :]
    assert len(free) == n - np.linalg.matrix_rank(A)
    random = np.random.default_rng(11)
    scale = np.max(np.abs(q_ddot)) + np.max(np.abs(a)) or 1.0
    for size in (1e-3, 1.0, 1e3):
        for _ in range(5):
            step = size * scale * random.standard_normal(len(free)) @ free
            assert np.allclose(A @ (q_ddot + step), b, rtol=0, atol=1e-9 * (
                np.max(np.abs(A)) * (scale + np.max(np.abs(step)))))  # fmt: skip
            other = gauss(q_ddot + step)
            # G grows by the square of the step; only rounding of G itself may hide it.
            assert other - least >= 0.999 * (step @ M @ step) / 2 - 1e-11 * least
            assert other > least or step @ M @ step < 1e-11 * least
    # A step that is not admissible can make it less: the test can fail.
    if least > 1e-9 * gauss(0 * q_ddot):
        assert gauss(q_ddot + 0.01 * (a - q_ddot)) < least
    assert list(system.columns.names[: system.columns.table][-n - 1 :]) == [
        *(f"gauss.a_{q}" for q in e.q), "gauss.G",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["elastic-pendulum-curve", "chaplygin-sleigh"])
def test_symbolic_and_numeric_gauss_agree(name: str) -> None:
    e, row, _ = observed(name, loops=False)
    d = as_json(content(e, with_gauss=True))
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


def test_a_singular_mass_matrix_has_no_unconstrained_acceleration() -> None:
    case = case_of(MASSLESS)
    e = case.equations
    with pytest.raises(InputError, match="mass matrix of this model is singular"):
        case.plan()
    with pytest.raises(InputError, match="direction has no inertia"):
        content(e, with_gauss=True)
    content(e)


def test_without_constraints_it_is_zero() -> None:
    r = run(asking("double-pendulum", gauss=True), duration=0.1)
    assert np.all(r["gauss.G"] < 1e-20)
    assert np.array_equal(r["gauss.a_theta1"], r["theta1_ddot"])


# The action


def lagrangian_at(r: Run, columns: dict[str, Any]) -> Any:
    """Give L along a path (k,): columns of positions and velocities."""
    e = r.equations
    parameters = {p.name: p.value for p in e.model.parameters}
    rows = zip(*columns.values(), strict=True)
    return np.array(
        [
            evaluate(
                e.graph,
                [e.model.lagrangian],
                {**parameters, **dict(zip(columns, row, strict=True))},
            )[0]
            for row in rows
        ]
    )


def integral(values: Any, h: float) -> float:
    """Integrate by Boole's rule (error h^6): a multiple of four intervals."""
    weights = np.tile([32.0, 12.0, 32.0, 14.0], (len(values) - 1) // 4)
    return float(2 * h / 45 * (7 * values[0] + weights @ values[1:] - 7 * values[-1]))


@pytest.mark.parametrize("name", ["elastic-pendulum", "elastic-pendulum-curve"])
def test_a_path_beside_the_motion_changes_the_action_in_second_order(name: str) -> None:
    r = run(asking(name, action=True), duration=0.8, output_step=0.002)
    t, h = r["t"], 0.002
    assert len(t) == 401
    theta, u = r["theta"], r["u"]
    swing = np.pi / 0.8
    bump, slope = np.sin(swing * t) ** 2, swing * np.sin(2 * swing * t)

    def action(size: float) -> float:
        """Give S of a path with the same ends, on the curve where there is one."""
        path, rate = theta + size * bump, r["theta_dot"] + size * slope
        if name == "elastic-pendulum":
            stretch, stretching = u + 2 * size * bump, r["u_dot"] + 2 * size * slope
        else:
            stretch, stretching = 1 - path**2, -2 * path * rate
        columns = {"t": t, "theta": path, "u": stretch, "theta_dot": rate}
        return integral(lagrangian_at(r, {**columns, "u_dot": stretching}), h)

    # Boole's rule leaves 1e-10 here, the run 1e-11.
    assert r["action.S"][0] == 0.0
    assert action(0.0) == pytest.approx(r["action.S"][-1], abs=1e-9)
    eps = 1e-3
    first = (action(eps) - action(-eps)) / (2 * eps)
    second = (action(eps) - 2 * action(0.0) + action(-eps)) / eps**2
    assert abs(second) > 0.1
    # What is left of the first order is third order, eps^2, and rounding.
    assert abs(first) < 1e-4 * abs(second)
    wide = (action(10 * eps) - 2 * action(0.0) + action(-10 * eps)) / (10 * eps) ** 2
    assert wide == pytest.approx(second, rel=0.02)
    # The same beside a path that is no motion: of first order. The test can fail.
    theta = theta + 0.1 * bump
    assert abs(action(eps) - action(-eps)) / (2 * eps) > 100 * abs(first)


SPAN = {"duration": 2, "output_step": 0.002}


@pytest.mark.slow
@pytest.mark.parametrize("loops", [False, True], ids=["straight", "dense"])
def test_the_action_stands_beside_the_work(loops: bool) -> None:
    r = run(asking("elastic-pendulum-forced", action=True), loops=loops, **SPAN)
    plain = run("elastic-pendulum-forced", loops=loops, **SPAN)
    assert r["work"][-1] == pytest.approx(plain["work"][-1], rel=1e-9)
    assert r.drift < 1e-9
    L = r["kinetic"] - r["potential"]
    # Boole's rule leaves less than 1e-9 at this spacing.
    assert integral(L, 0.002) == pytest.approx(r["action.S"][-1], abs=1e-8)


def test_methods_that_would_leave_the_action_out_are_refused() -> None:
    text = asking("pendulum-cartesian", action=True)
    for name in ("rattle", "radau"):
        with pytest.raises(InputError, match="does not integrate the action"):
            run(text, method=name)


@pytest.mark.parametrize("value", ["maybe", "1", "[true]", "{a: b}", "yes"])
def test_keys_of_output_are_true_or_false(value: str) -> None:
    text = MASSLESS.replace("gauss: true", f"action: {value}")
    with pytest.raises(InputError, match="`action` must be `true` or `false`"):
        read(text, "model.yaml")
    off = read(MASSLESS.replace("true", "false"), "model.yaml").output
    assert (off.gauss, off.action) == (False, False)
