"""IDA of SUNDIALS on a scene of ours: residual and Jacobian from the graph, compiled.

Two forms: index 1 (accelerations, drifting) and that of Gear, Gupta and Leimkuhler
(stabilised index 2: positions and velocities both meet the constraints).
"""

from __future__ import annotations

import ctypes
import time

import numpy as np
from sksundae.ida import IDA

from lagsim.language.derivatives import gradient
from lagsim.native.graph.keys import Layout
from lagsim.native.graph.straight_line import generate
from lagsim.native.link.engine import Engine, compile_object
from lagsim.program.signatures import FUNCTION
from lagsim.studies.bench import solved

FORMS = ("GGL", "index 1")
# Multipliers are not controlled, as SUNDIALS recommends for index 2.
UNCONTROLLED = 1e6


class Problem:
    """F(t, y, y') = 0 of a constrained scene, compiled, with its start."""

    def __init__(self, scene, form, first_row, names):
        e = scene.equations
        self.n, self.m = len(e.q), len(e.rows)
        mu = [f"mu.{row.name}" for row in e.rows] if form == "GGL" else []
        y = [*e.q, *e.velocities, *e.multipliers, *mu]
        rates = [f"rate.{name}" for name in y]
        rates[self.n : 2 * self.n] = e.accelerations
        self.size = len(y)
        nodes = (_stabilised if form == "GGL" else _index_one)(e, mu)
        self._compile(e, nodes, y, rates)
        columns = dict(zip(names, first_row, strict=True))
        self.y = np.array([columns.get(name, 0.0) for name in y])
        self.yp = np.zeros(self.size)
        self.yp[: self.n] = self.y[self.n : 2 * self.n]
        self.yp[self.n : 2 * self.n] = [columns[name] for name in e.accelerations]
        self.algebraic = list(range(2 * self.n, self.size))

    def _compile(self, e, nodes, y, rates):
        g = e.graph
        cj = g.variable("cj")
        jacobian = []
        for node in nodes:
            by_y = gradient(g, node, [g.variable(name) for name in y])
            by_rate = gradient(g, node, [g.variable(name) for name in rates])
            for a, b in zip(by_y, by_rate, strict=True):
                jacobian.append(g.call("add", a, g.call("mul", cj, b)))
        places = {name: k for k, name in enumerate([*y, *rates, "cj"])}
        parameters = e.model.parameters
        layout = Layout(
            y=places,
            p={p.name: k for k, p in enumerate(parameters)},
            fixed=frozenset(p.name for p in parameters),
            size=len(parameters),
        )
        code = generate(g, {"residual": nodes, "jacobian": jacobian}, layout)
        self.engine = Engine([compile_object(code.ir, optimise=False)])
        self.p = np.zeros(code.p_size)
        self.p[: len(parameters)] = [p.value for p in parameters]
        self.engine.function("prepare", *FUNCTION)(0.0, None, self.p.ctypes.data, None)
        self._residual = self.engine.function("residual", *FUNCTION)
        self._jacobian = self.engine.function("jacobian", *FUNCTION)
        self._in = np.zeros(2 * self.size + 1)
        self._res = np.zeros(self.size)
        self._jac = np.zeros((self.size, self.size))
        addresses = [self._in, self.p, self._res, self._jac]
        self._at = [ctypes.c_void_p(a.ctypes.data) for a in addresses]
        self.evaluations = 0

    def residual(self, t, y, yp, res):
        self.evaluations += 1
        self._in[: self.size] = y
        self._in[self.size : -1] = yp
        self._residual(t, self._at[0], self._at[1], self._at[2])
        res[:] = self._res

    def jacobian(self, t, y, yp, _res, cj, JJ):
        self._in[: self.size] = y
        self._in[self.size : -1] = yp
        self._in[-1] = cj
        self._jacobian(t, self._at[0], self._at[1], self._at[3])
        JJ[:] = self._jac


def _index_one(e, _mu):
    """Return the residuals q' - v, M v' - f - A^T lambda and A v' - b as nodes."""
    g = e.graph
    v = [g.variable(name) for name in e.velocities]
    a = [g.variable(name) for name in e.accelerations]
    found = [g.call("sub", g.variable(f"rate.{q}"), v[k]) for k, q in enumerate(e.q)]
    found += _momentum(e, a)
    for row in e.rows:
        found.append(g.call("sub", g.product_sum(zip(row.A, a, strict=True)), row.b))
    return found


def _stabilised(e, mu):
    """Return the residuals of q' = v + A^T mu, M v' = f + A^T lambda, g = 0, g' = 0."""
    g = e.graph
    v = [g.variable(name) for name in e.velocities]
    a = [g.variable(name) for name in e.accelerations]
    extra = [g.variable(name) for name in mu]
    found = []
    for k, q in enumerate(e.q):
        columns = [row.A[k] for row in e.rows]
        moved = g.call("add", v[k], g.product_sum(zip(columns, extra, strict=True)))
        found.append(g.call("sub", g.variable(f"rate.{q}"), moved))
    found += _momentum(e, a)
    found += [row.residual for row in e.rows]
    return found + [row.rate for row in e.rows]


def _momentum(e, a):
    g = e.graph
    forces = e.constraint_forces()
    return [
        g.call(
            "sub",
            g.product_sum(zip(row, a, strict=True)),
            g.call("add", f, force),
        )
        for row, f, force in zip(e.M, e.f, forces, strict=True)
    ]


class Ida:
    """IDA at one tolerance; rows have the shape (k, 1 + state)."""

    def __init__(self, problem, times, sizes, rtol):
        self.problem, self.times = problem, times
        atol = np.full(problem.size, UNCONTROLLED)
        atol[: 2 * problem.n] = rtol * sizes[: 2 * problem.n]
        self.solver = IDA(
            problem.residual,
            jacfn=problem.jacobian,
            algebraic_idx=problem.algebraic,
            rtol=rtol,
            atol=atol,
            max_num_steps=1_000_000,
        )

    def solve(self, _start):
        """Integrate once, from the consistent start of the scene."""
        problem = self.problem
        problem.evaluations = 0
        began = time.perf_counter()
        found = self.solver.solve(self.times, problem.y, problem.yp)
        seconds = time.perf_counter() - began
        rows = None
        if found.success:
            rows = np.column_stack([found.t, found.y[:, : 2 * problem.n]])
        return solved(rows, seconds, problem.evaluations, found.message)
