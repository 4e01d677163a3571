"""Lagrange's equations against an independent derivation by sympy, and closed forms."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import Equations, derive
from lagsim.model.reader import read, read_file
from lagsim.run.session import open_case
from tests.support import MODELS, ready
from tests.sympy_oracle import Numbers, Oracle, random_values

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.mechanics.constraints import Row

NAMES = sorted(path.stem for path in MODELS.glob("*.yaml"))
SEEDS = range(3)


@functools.cache
def equations_of(name: str) -> Equations:
    return derive(read_file(str(MODELS / f"{name}.yaml")))


# Whose equations are solved as they are: no constraint comes into force and goes.
SOLVED = [name for name in NAMES if not equations_of(name).laws]


def rows_of(e: Equations) -> list[Row]:
    """Give the row of each constraint, in the order of the file."""
    rows = {row.name: row for row in (*e.rows, *(law.row for law in e.laws))}
    return [rows[c.name] for c in e.model.constraints]


@functools.cache
def oracle_of(name: str) -> Oracle:
    return Oracle.of(MODELS / f"{name}.yaml")


def state_of(name: str, seed: int) -> tuple[dict[str, float], Numbers]:
    start = {i.name: i.value for i in equations_of(name).model.initial}
    values = random_values(oracle_of(name), start, seed)
    return values, oracle_of(name).at(values)


def small(text: str) -> Equations:
    return derive(read(text, "model.yaml"))


def at(e: Equations, nodes: Sequence[int], **values: float) -> list[float]:
    parameters = {p.name: p.value for p in e.model.parameters}
    return evaluate(e.graph, nodes, {"t": 0.0, **parameters, **values})


def matrix(e: Equations, values: Mapping[str, float]) -> Any:
    nodes = [node for row in e.M for node in row]
    return np.reshape(evaluate(e.graph, nodes, values), (len(e.q), len(e.q)))


def agrees(found: Any, expected: Any) -> None:
    """Hold each array to 1e-12 of its largest entry.

    Single entries may be differences of large terms, of which 1e-16 is what doubles
    leave; 1e-12 allows for some hundreds of operations and cancellation.
    """
    found, expected = np.asarray(found), np.asarray(expected)
    scale = np.max(np.abs(expected), initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", NAMES)
def test_graph_gives_the_numbers_of_an_independent_derivation(
    name: str, seed: int
) -> None:
    e = equations_of(name)
    values, expected = state_of(name, seed)
    agrees(matrix(e, values), expected.M)
    agrees(evaluate(e.graph, e.f, values), expected.f)
    rows = rows_of(e)
    for row, A, b in zip(rows, expected.A, expected.b, strict=True):
        agrees(evaluate(e.graph, [*row.A, row.b], values), [*A, b])
    energies = [e.energy, e.kinetic_form]
    if e.energy_is_sum:  # then T is quadratic in the velocities
        agrees(evaluate(e.graph, energies, values), [expected.energy, expected.kinetic])
    else:
        agrees(evaluate(e.graph, energies[:1], values), [expected.energy])
    residuals = evaluate(e.graph, [row.residual for row in rows], values)
    rates = evaluate(e.graph, [row.rate for row in rows], values)
    for row, g, g_dot, *expected_row in zip(
        rows, residuals, rates, expected.residuals, expected.rates, strict=True
    ):
        scales = [row.residual_scale, row.rate_scale]
        bounds = evaluate(e.graph, scales, values)
        for found, wanted, bound in zip((g, g_dot), expected_row, bounds, strict=True):
            assert abs(found - wanted) <= 1e-13 * bound
    if e.works:
        rest = dict.fromkeys(e.multipliers, 0.0)
        power = sum(evaluate(e.graph, e.powers, {**values, **rest}))
        assert power == pytest.approx(expected.power_without_constraints, rel=1e-11)


class Native:
    """The compiled functions of a shipped model."""

    def __init__(self, name: str, *, loops: bool) -> None:
        session = ready(name, loops=loops, formulation="full")
        self.equations, self.system = session.case.equations, session.system
        assert loops == (self.system.plan.elimination is None)
        self.runner = self.system.link("dop853")

    def motion(self, values: Mapping[str, float]) -> tuple[Any, Any, Any]:
        """Give y', q'' and lambda; the latter two are columns of the rows."""
        e = self.equations
        for k, parameter in enumerate(e.model.parameters):
            self.system.p.fixed[k] = values[parameter.name]
        # On the side of each switch that the state is on.
        for k, side in enumerate(self.system.switches.sides):
            (value,) = evaluate(e.graph, [side.node], values)
            self.system.p.side[k] = math.copysign(1.0, value)
        self.runner.prepare()
        # Random states are off the constraints, and not to be brought onto them.
        self.system.p.reference = 0.0
        y = np.array([values[name] for name in (*e.q, *e.velocities)] + [0.0])
        y = y[: self.system.size]
        rates = self.runner.function("derivative")(values["t"], y)[: self.system.size]
        row = self.runner.function("observe")(values["t"], y)
        columns = self.system.columns.names
        accelerations = [row[columns.index(name)] for name in e.accelerations]
        multipliers = [row[columns.index(name)] for name in e.multipliers]
        return rates, np.array(accelerations), np.array(multipliers)


@functools.cache
def native_of(name: str, loops: bool) -> Native:
    return Native(name, loops=loops)


@pytest.mark.parametrize("loops", [False, True], ids=["straight", "dense"])
@pytest.mark.parametrize("name", SOLVED)
def test_native_motion_satisfies_the_equations(name: str, loops: bool) -> None:
    native = native_of(name, loops)
    for seed in SEEDS:
        values, x = state_of(name, seed)
        rates, q_ddot, lam = native.motion(values)
        n = len(q_ddot)
        assert list(rates[:n]) == [values[v] for v in native.equations.velocities]
        assert list(rates[n : 2 * n]) == list(q_ddot)
        # Backward error: 1e-10 of the sizes of what is added up.
        size = np.abs(x.M) @ np.abs(q_ddot) + np.abs(x.f) + np.abs(x.A.T) @ np.abs(lam)
        balance = x.M @ q_ddot - x.f - x.A.T @ lam
        assert np.all(np.abs(balance) <= 1e-10 * np.max(size))
        size = np.abs(x.A) @ np.abs(q_ddot) + np.abs(x.b)
        assert np.all(np.abs(x.A @ q_ddot - x.b) <= 1e-10 * size)


def test_what_vanishes_identically_is_known_to_be_zero() -> None:
    e = equations_of("chain-cartesian")
    n, zero = len(e.q), e.graph.zero
    off = [e.M[i][j] for i in range(n) for j in range(n) if i != j]
    assert set(off) == {zero}
    assert [sum(node != zero for node in row.A) for row in e.rows] == [2] + [4] * 9
    top = equations_of("heavy-top")
    theta = top.q.index("theta")
    assert [top.M[theta][j] == top.graph.zero for j in range(3)] == [True, False, True]


HEAD = """
parameters: {m: 2, k: 3, c: 0.5, w: 1.5}
coordinates: {x: {}, y: {}}
definitions:
  r: hypot(x, y)
  moving: x*cos(w*t) + y*sin(w*t)
  slip: x*y_dot - y*x_dot + w*t
initial: {x: 1, y: 2}
"""
FREE = "  kinetic: m*(x_dot^2 + y_dot^2)/2\n  potential: 0\n"
STATE = {"x": 0.6, "y": -1.7, "x_dot": 1.1, "y_dot": 0.4, "t": 0.3}


def test_a_magnetic_potential_deflects_and_stores_no_energy() -> None:
    e = small(
        HEAD + "energy:\n  kinetic: m*(x_dot^2 + y_dot^2)/2\n"
        "  potential: k*(y*x_dot - x*y_dot)/2\n"
    )
    g = e.graph
    # L = T + k/2 (x y' - y x'): f = k (y', -x'), the Lorentz force.
    assert at(e, e.f, **STATE) == pytest.approx([3 * 0.4, -3 * 1.1], rel=1e-15)
    assert matrix(e, {"m": 2.0}).tolist() == [[2, 0], [0, 2]]
    assert e.M[0][1] == g.zero
    assert not e.energy_is_sum
    assert at(e, [e.energy], **STATE) == pytest.approx([1.1**2 + 0.4**2], rel=1e-15)
    assert not e.works


def test_a_mass_that_depends_on_time() -> None:
    e = small(
        HEAD + "energy:\n  kinetic: m*exp(-c*t)*(x_dot^2 + y_dot^2)/2\n  potential: 0\n"
    )
    m = 2 * math.exp(-0.5 * 0.3)
    # d(m v)/dt = 0: m q'' = -m' q' = c m q'.
    expected = [0.5 * m * 1.1, 0.5 * m * 0.4]
    assert at(e, e.f, **STATE) == pytest.approx(expected, rel=1e-14)
    assert e.energy_is_sum
    assert [work.name for work in e.works] == ["work.x", "work.y"]
    # dh/dt = -dL/dt = c T, of each coordinate.
    kinetic = m * np.array([1.1, 0.4]) ** 2 / 2
    assert at(e, e.powers, **STATE) == pytest.approx(0.5 * kinetic, rel=1e-14)


def test_an_energy_not_quadratic_in_velocity() -> None:
    e = small(
        """
parameters: {m: 2, c: 3, k: 5}
coordinates: {x: {}, y: {}}
initial: {x: 1, y: 0}
energy:
  lagrangian: -m*c^2*sqrt(1 - (x_dot^2 + y_dot^2)/c^2) - k*x^2/2
"""
    )
    v = np.array([1.1, 0.4])
    gamma = 1 / math.sqrt(1 - v @ v / 9)
    expected = 2 * gamma * (np.eye(2) + gamma**2 * np.outer(v, v) / 9)
    values = {"m": 2.0, "c": 3.0, "k": 5.0, "t": 0.0, **STATE}
    agrees(matrix(e, values), expected)
    assert at(e, e.f, **STATE) == pytest.approx([-5 * 0.6, 0.0], rel=1e-15)
    assert at(e, e.momenta, **STATE) == pytest.approx(2 * gamma * v, rel=1e-14)
    energy = gamma * 2 * 9 + 5 * 0.6**2 / 2
    assert at(e, [e.energy], **STATE) == pytest.approx([energy], rel=1e-14)
    assert not e.energy_is_sum
    choices = open_case(e.model).plan().choices
    assert choices[0].choice == "mass matrix: depends on velocities"


def test_rayleigh_dissipation() -> None:
    e = small(
        HEAD + "energy:\n" + FREE + "  dissipation: c*x_dot^2/2 + k*(x_dot - y_dot)^2\n"
    )
    expected = [-0.5 * 1.1 - 6 * 0.7, 6 * 0.7]
    assert at(e, e.f, **STATE) == pytest.approx(expected, rel=1e-14)
    assert len(e.works) == 1
    power = expected[0] * 1.1 + expected[1] * 0.4
    assert at(e, e.powers, **STATE) == pytest.approx([power], rel=1e-14)


def test_forces_on_coordinates_on_positions_and_on_rates() -> None:
    e = small(
        HEAD + "energy:\n" + FREE + "forces:\n"
        "  x: 7\n  r: -k*r_dot\n  moving: m*t\n  slip: sin(t)\n"
    )
    x, y, vx, vy, t = (STATE[name] for name in ("x", "y", "x_dot", "y_dot", "t"))
    r = math.hypot(x, y)
    radial = -3 * (x * vx + y * vy) / r
    Q = np.array([7.0, 0.0]) + radial * np.array([x, y]) / r
    Q += 2 * t * np.array([math.cos(1.5 * t), math.sin(1.5 * t)])
    Q += math.sin(t) * np.array([-y, x])
    assert at(e, e.f, **STATE) == pytest.approx(Q, rel=1e-14)
    assert len(e.works) == 1
    # Forces on moving definitions work along the virtual displacement, Q.q'.
    assert at(e, e.powers, **STATE) == pytest.approx([Q @ [vx, vy]], rel=1e-13)


@pytest.mark.parametrize(
    ("energy", "is_sum"),
    [
        ("kinetic: m*x_dot^2 + y_dot^2*exp(x)\n  potential: k*x*t", True),
        ("kinetic: (x_dot + y_dot)^2\n  potential: 0", True),
        ("kinetic: m*(x_dot + w)^2\n  potential: 0", False),  # in a moving frame
        ("kinetic: m*x_dot^2 + y_dot^2\n  potential: k*x_dot*y", False),
        ("kinetic: m*x_dot^4 + y_dot^2\n  potential: 0", False),
        ("kinetic: m*hypot(x_dot, y_dot)^2\n  potential: 0", True),
        ("kinetic: sqrt(m*x_dot^2 + y_dot^2)^2\n  potential: 0", False),  # not seen
        ("lagrangian: m*x_dot^2 + y_dot^2", False),  # there are no T and V
    ],
)
def test_energy_is_the_sum_only_where_it_is_known(energy: str, is_sum: bool) -> None:
    e = small(f"{HEAD}energy:\n  {energy}\n")
    assert e.energy_is_sum == is_sum
    if e.model.kinetic is not None and e.model.potential is not None:
        values = dict(STATE, m=2.0, k=3.0, c=0.5, w=1.5)
        T, V, h = evaluate(
            e.graph, [e.model.kinetic, e.model.potential, e.energy], values
        )
        if is_sum or "sqrt" in energy:
            assert h == pytest.approx(T + V, rel=1e-14)
        else:
            assert abs(h - (T + V)) > 0.1


def test_the_energy_function_of_a_moving_frame() -> None:
    e = small(
        f"{HEAD}energy:\n  kinetic: m*((x_dot + w)^2 + y_dot^2)/2\n  potential: 0"
    )
    # h = T2 - T0: without the term linear in the velocity.
    expected = (1.1**2 + 0.4**2) - 1.5**2
    assert at(e, [e.energy], **STATE) == pytest.approx([expected], rel=1e-14)
