"""How much an error of the start grows, found without any of lagsim.

sympy derives the equations from the text of the model, numpy solves for accelerations,
scipy integrates.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

from tests.scenes.reference import PROBLEMS, model_text, states
from tests.sympy_oracle import Oracle

# The second is for chaotic motion, where the first does not stay small.
NUDGES = (1e-7, 1e-10)
SEEDS = 3

# What `Motion.condition` gives, for each reference time in order; past 1e9 nudges have
# grown to the size of the motion. Published for the double pendulum: 0.8 digits lost
# in a second.
CONDITIONS = {
    "andrews": (8.0,),
    "caraxis": (22.0,),
    "pendulum_iftomm_a01": (8.8,),
    "bricard": (1.4, 3.7, 8.1),
    "double_pendulum": (1.5, 2.1, 600.0, 9.5e7, 1.3e10, 1.4e10),
    "double_pendulum_cartesian": (3.1, 3.3, 1300.0, 1.2e8, 1.3e10, 1.9e10),
    "kepler_e09": (7900.0,),
    "kepler_e06_100orbits": (2.6e4,),
    "rolling_disk_steady": (140.0,),
    "chaplygin_sleigh": (3.5,),
    "bead_rotating_hoop": (3.1,),
    "bead_rotating_hoop_cartesian": (18.0,),
    "chain10_cartesian": (5.2, 5.2, 9.4),
    "appell_hamel": (1.0,),
    "huygens_cycloid": (1.0,),
    "pendulum_duplicate_constraints": (8.8,),
}


class Motion:
    """The equations of a reference problem as functions of numpy and of mpmath."""

    def __init__(self, name: str) -> None:
        self.problem = PROBLEMS[name]
        assert float(self.problem["t0"]) == 0.0
        self.states = states(name)
        self.oracle = Oracle(model_text(name))
        self.n, self.m = len(self.oracle.q), len(self.oracle.constraints)
        moving = set(self.oracle.v)
        self.holonomic = np.array(
            [not g.free_symbols & moving for g in self.oracle.constraints], dtype=bool
        )

    @cached_property
    def parameters(self) -> dict[str, float]:
        return self.oracle.nominal()

    @cached_property
    def _parts(self) -> Any:
        o = self.oracle
        values = {s: self.parameters[s.name] for s in o.inputs[1 + 2 * self.n :]}
        flat = [*sp.flatten(o.M), *o.f, *sp.flatten(o.A), *o.b]
        flat += [*o.constraints, *o.rates]
        flat = [sp.sympify(e).subs(values) for e in flat]  # noqa: TID251  no text
        return sp.lambdify(o.inputs[: 1 + 2 * self.n], flat, "numpy", cse=True)

    def parts(self, t: float, y: Any) -> list[Any]:
        """Give M, f, A, b, residuals and their rates."""
        n, m = self.n, self.m
        flat = np.array(self._parts(t, *y), dtype=float)
        M, f, A, b, g, rates = np.split(flat, np.cumsum([n * n, n, m * n, m, m]))
        return [M.reshape(n, n), f, A.reshape(m, n), b, g, rates]

    def rate(self, t: float, y: Any) -> Any:
        M, f, A, b, _, _ = self.parts(t, y)
        return np.concatenate([y[self.n :], self._solved(M, f, A, b)[: self.n]])

    def accelerations(self, reference: dict[str, Any]) -> tuple[Any, Any, Any]:
        """Give q'', lambda (of least norm) and A^T lambda at a reference state."""
        values: dict[str, Any] = {"t": reference["t_value"], **self.parameters}
        values |= reference["q"]
        values |= {f"{q}_dot": x for q, x in reference["qdot"].items()}
        x = self.oracle.exactly(values)
        M, f, A, b = (np.array(part, dtype=float) for part in (x.M, x.f, x.A, x.b))
        A = A.reshape(self.m, self.n)
        solved = self._solved(M, f, A, b)
        lam = solved[self.n :]
        return solved[: self.n], lam, A.T @ lam

    def _solved(self, M: Any, f: Any, A: Any, b: Any) -> Any:
        K = np.block([[M, -A.T], [A, np.zeros((self.m, self.m))]])
        # Of least norm: rows may depend on each other.
        size = np.max(np.abs(K), axis=1, initial=1e-300)
        solved = np.linalg.lstsq(
            K / size[:, None], np.concatenate([f, b]) / size, rcond=1e-11
        )
        return solved[0]

    def onto(self, t: float, y: Any) -> Any:
        """Move a state onto the constraints: positions, then velocities."""
        n = self.n
        y = y.copy()
        for _ in range(6):
            _, _, A, _, g, _ = self.parts(t, y)
            some = self.holonomic
            y[:n] -= np.linalg.lstsq(A[some], g[some], rcond=1e-9)[0]
        for _ in range(6):
            _, _, A, _, _, rates = self.parts(t, y)
            y[n:] -= np.linalg.lstsq(A, rates, rcond=1e-9)[0]
        return y

    def start(self) -> Any:
        p = self.problem
        q0 = [float(p["q0_value"][q.name]) for q in self.oracle.q]
        return np.array(q0 + [float(p["qdot0_value"][q.name]) for q in self.oracle.q])

    def path(self, y: Any, times: Any) -> Any:
        solved = solve_ivp(
            self.rate, (0.0, times[-1]), y, "DOP853", times, rtol=1e-12, atol=1e-13
        )
        assert solved.success
        return solved.y.T

    def condition(self) -> list[float]:
        """Give for each reference time by how much nudges of the start have grown.

        Nudges are relative to the start's largest position and velocity, what comes of
        them to the largest of the whole motion.
        """
        y, n = self.start(), self.n
        wanted = np.array([s.t for s in self.states])
        # Rows between the reference times too, for the size of the motion.
        times = np.unique(
            [*wanted, *np.arange(1, 40 * wanted[-1] / wanted[0]) * wanted[0] / 40]
        )
        exact = self.path(y, times)
        sizes = [np.max(np.abs(part)) for part in (exact[:, :n], exact[:, n:])]
        scale = np.repeat(sizes, n)
        own = np.repeat([np.max(np.abs(part)) for part in (y[:n], y[n:])], n)
        grown = np.ones(len(times))
        for nudge in NUDGES:
            for seed in range(SEEDS):
                random = np.random.default_rng(seed)
                moved = y + nudge * own * random.uniform(-1, 1, 2 * n)
                if self.m:
                    moved = self.onto(0.0, moved)
                other = np.abs(self.path(moved, times) - exact) / scale
                grown = np.maximum(grown, np.max(other, axis=1) / nudge)
        grown = np.maximum.accumulate(grown)
        return [float(grown[np.argmin(np.abs(times - t))]) for t in wanted]
