"""Lagrange's equations and rows against an independent derivation by sympy."""

import functools
import math

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from tests.choosing import tonight, turn
from tests.support import MODELS, SHIPPED, has_laws, ready, shipped
from tests.sympy_oracle import Oracle, random_values, reads

NAMES = [name for name in SHIPPED if reads(MODELS / f"{name}.yaml")]
SEEDS = range(3)
HEAD = """
parameters: {m: 2, k: 3, c: 0.5, w: 1.5, l: 1.3}
coordinates: {x: {}, y: {}, z: {}}
definitions:
  r: hypot(x, y)
  moving: x*cos(w*t) + y*sin(w*t)
  slip: x*y_dot - y*x_dot + w*t
initial: {x: 1, y: 2, z: -1}
"""
FREE = "kinetic: m*(x_dot^2 + y_dot^2 + z_dot^2)/2"
# Whether the energy is seen to be the sum of kinetic and potential.
ENERGIES = {
    "weight": (f"{FREE}, potential: k*x*t", True),
    "coupled": ("kinetic: (x_dot + y_dot)^2 + z_dot^2*exp(x), potential: 0", True),
    "hypot": ("kinetic: 'm*hypot(x_dot, y_dot)^2 + z_dot^2', potential: 0", True),
    "loss": (f"{FREE}, potential: 0, dissipation: c*x_dot^2 + (x_dot - y_dot)^4", True),
    "rocket": ("kinetic: m*exp(-t)*(x_dot^2 + y_dot^2 + z_dot^2), potential: 0", True),
    "magnetic": (f"{FREE}, potential: k*(y*x_dot - x*y_dot)/2", False),
    "frame": ("kinetic: m*((x_dot + w)^2 + y_dot^2 + z_dot^2)/2, potential: 0", False),
    "quartic": ("kinetic: m*x_dot^4 + y_dot^2 + z_dot^2, potential: 0", False),
    "root": (  # which is not seen to be quadratic
        "kinetic: sqrt(m*x_dot^2 + y_dot^2 + z_dot^2)^2, potential: 0", False
    ),
    "relativistic": (
        "lagrangian: -m*k^2*sqrt(1 - x_dot^2/(1 + x_dot^2)/k^2) + y_dot^2 + z_dot^2",
        False,
    ),
}  # fmt: skip
FORCES = "forces: {x: 7, r: -k*r_dot, moving: m*t, slip: sin(t)}"
# Whether a relation leaves out t, is linear in velocities, and may exchange energy.
RELATIONS = {
    "sphere": ("x^2 + y^2 + z^2 = l^2", True, True, False),
    "plane": ("x - 2*y = l", True, True, False),
    "curve": ("y = l*sin(k*x)*exp(-z)", True, True, False),
    "moving": ("x*cos(w*t) + y*sin(w*t) = l*t^2", False, True, True),
    "driven": ("x = l*sin(w*t)", False, True, True),
    "branch": ("if(x > 0, x^2, -x) + y = l", True, True, False),
    "distance": ("hypot(x - y, z - t) = l", False, True, True),
    "skate": ("x_dot*sin(z) - y_dot*cos(z) = 0", True, True, False),
    "affine": ("x_dot*y - k*z_dot + w = 0", True, True, True),
    "affine_t": ("x_dot - t*y_dot = sin(w*t)", False, True, True),
    "speed": ("x_dot^2 + y_dot^2 = k^2", True, False, True),
    "cone": ("x_dot^2 + y_dot^2 - l^2*z_dot^2 = 0", True, False, False),
    "cubic": ("x_dot^3 + y*y_dot*z_dot = x*t", False, False, True),
    "roll": ("sqrt(x_dot^2 + y_dot^2 + k) = l*z_dot", True, False, True),
}


def constrained(*relations):
    rows = ", ".join(f"c{k}: '{text}'" for k, text in enumerate(relations))
    return f"{HEAD}energy: {{{FREE}, potential: 0}}\nconstraints: {{{rows}}}\n"


SMALL = {name: f"{HEAD}energy: {{{x}}}\n" for name, (x, _) in ENERGIES.items()}
SMALL["forces"] = f"{HEAD}energy: {{{FREE}, potential: 0}}\n{FORCES}\n"
SMALL["relations"] = constrained(*(row[0] for row in RELATIONS.values()))


@functools.cache
def equations_of(name):
    if name in SMALL:
        return derive(read(SMALL[name], "model.yaml"))
    return derive(shipped(name))


# Whose equations are solved as they are: no constraint comes into force and goes.
SOLVED = [name for name in NAMES if not has_laws(name)]


def rows_of(e):
    """Return the row of each constraint, in the order of the file."""
    rows = {row.name: row for row in (*e.rows, *(law.row for law in e.laws))}
    return [rows[c.name] for c in e.model.constraints]


@functools.cache
def oracle_of(name):
    return Oracle(SMALL[name]) if name in SMALL else Oracle.of(MODELS / f"{name}.yaml")


def state_of(name, seed):
    start = {i.name: i.value for i in equations_of(name).model.initial}
    values = random_values(oracle_of(name), start, seed)
    return values, oracle_of(name).at(values)


def matrix(e, values):
    nodes = [node for row in e.M for node in row]
    return np.reshape(evaluate(e.graph, nodes, values), (len(e.q), len(e.q)))


def agrees(found, expected, part=1e-12):
    """Assert that arrays agree to 1e-12 of their largest entries.

    Single entries may be differences of large terms, which doubles represent to 1e-16;
    1e-12 allows for some hundreds of operations and cancellation.
    """
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    scale = np.max(np.abs(expected), initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=part * scale)


def solves(x, q_ddot, lam):
    """Assert that a motion satisfies the equations: backward errors up to 1e-10."""
    size = np.abs(x.M) @ np.abs(q_ddot) + np.abs(x.f) + np.abs(x.A.T) @ np.abs(lam)
    balance = x.M @ q_ddot - x.f - x.A.T @ lam
    assert np.all(np.abs(balance) <= 1e-10 * np.max(size))
    size = np.abs(x.A) @ np.abs(q_ddot) + np.abs(x.b)
    assert np.all(np.abs(x.A @ q_ddot - x.b) <= 1e-10 * size)


# What sympy derives of ten links takes seconds.
def derived_again(names):
    slow = [pytest.mark.slow]
    return [pytest.param(x, marks=slow * (x == "chain-angles")) for x in names]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", derived_again([*NAMES, *SMALL]))
def test_graph_gives_the_numbers_of_an_independent_derivation(name, seed):
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

    def __init__(self, name, *, loops):
        session = ready(name, loops=loops, formulation="full")
        self.equations, self.system = session.case.equations, session.system
        assert loops == (self.system.plan.elimination is None)
        self.runner = self.system.link("dop853")

    def motion(self, values):
        """Return y', q'' and lambda; the latter two are columns of the rows."""
        e = self.equations
        for parameter in e.model.parameters:
            self.system.p.flat[self.system.place(parameter.name)] = values[
                parameter.name
            ]
        # On the side of each switch that the state is on.
        for k, side in enumerate(self.system.switches.sides):
            (value,) = evaluate(e.graph, [side.node], values)
            self.system.p.side[k] = math.copysign(1.0, value)
        for mode in self.system.switches.modes:
            (value,) = evaluate(e.graph, [mode.discrete], values)
            self.system.p.flat[self.system.place(mode.variable)] = value
        self.runner.prepare()
        # Random states are off the constraints, and not to be brought onto them.
        self.system.p.reference = 0.0
        y = np.array([values[name] for name in e.state] + [0.0])
        y = y[: self.system.size]
        rates = self.runner.function("derivative")(values["t"], y)[: self.system.size]
        row = self.runner.function("observe")(values["t"], y)
        columns = self.system.columns.names
        accelerations = [row[columns.index(name)] for name in e.accelerations]
        multipliers = [row[columns.index(name)] for name in e.multipliers]
        return rates, np.array(accelerations), np.array(multipliers)


@pytest.mark.parametrize("name", derived_again(SOLVED))
def test_native_motion_satisfies_the_equations(name):
    """Solved straight or by loops, in turn as commits go by."""
    native = Native(name, loops=turn(name, tonight(), (False, True)))
    for seed in SEEDS:
        values, x = state_of(name, seed)
        rates, q_ddot, lam = native.motion(values)
        n = len(q_ddot)
        assert list(rates[:n]) == [values[v] for v in native.equations.velocities]
        # Columns compute sines of sums of angles from the sines of the angles, with a
        # few units of rounding more.
        assert rates[n : 2 * n] == pytest.approx(q_ddot, rel=1e-13)
        solves(x, q_ddot, lam)


@pytest.mark.parametrize("name", ENERGIES)
def test_energy_is_the_sum_only_where_it_is_known(name):
    e = equations_of(name)
    assert e.energy_is_sum == ENERGIES[name][1]
    assert bool(e.works) == (name in ("weight", "loss", "rocket"))


@pytest.mark.slow
@pytest.mark.parametrize("name", RELATIONS)
def test_what_is_inferred_of_a_relation(name):
    relation, scleronomic, pfaffian, moved = RELATIONS[name]
    e = derive(read(constrained(relation), "model.yaml"))
    g, [row] = e.graph, e.rows
    assert row.holonomic == ("_dot" not in relation)
    assert (row.scleronomic, row.pfaffian) == (scleronomic, pfaffian)
    assert (row.transport != g.zero) == moved
    assert bool(e.works) == (moved or name == "branch")  # whose impacts do work
    # The power of its force is lambda A q', and that is -g_t on the relation.
    along = g.product_sum(zip(row.A, map(g.variable, e.velocities), strict=True))
    values, _ = state_of("relations", 1)
    rate, whole, transport = evaluate(g, [row.rate, along, row.transport], values)
    expected = whole - rate if row.holonomic else whole * moved
    assert transport == pytest.approx(expected, rel=1e-12, abs=1e-12)
