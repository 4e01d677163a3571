"""heyoka on a scene of lagsim: with a textbook's equations, or those of the graph."""

from __future__ import annotations

import math
import time

import heyoka as hy
import numpy as np
import textbook

from lagsim.studies.bench import solved

# Ten times what any of the scenes takes; at loose tolerances some would never end.
MOST_STEPS = 50_000

CALLS = {
    "neg": lambda a: -a,
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "sin": hy.sin,
    "cos": hy.cos,
    "tan": hy.tan,
    "sqrt": hy.sqrt,
    "hypot": lambda a, b: hy.sqrt(a * a + b * b),
    "exp": hy.exp,
    "log": hy.log,
}


def equations_by_textbook(model, e, parameters, number=float):
    """Return y' = f(t, y) of textbook.py for heyoka; `number` converts parameters."""
    q, v = ([hy.make_vars(name) for name in part] for part in (e.q, e.velocities))
    values = {name: number(value) for name, value in parameters.items()}
    return list(zip([*q, *v], [*v, *textbook.OF[model](q, v, values, hy)], strict=True))


def equations_of(scene, plan, parameters):
    """Return heyoka's y' = f(t, y) from lagsim's graph, unconstrained or of index 1."""
    e, g = scene.equations, scene.equations.graph
    accelerations, _ = plan.elimination.motion()
    velocities = [g.variable(v) for v in e.velocities]
    nodes = converted(g, [*velocities, *accelerations], parameters)
    names = (*e.q, *e.velocities)
    variables = [hy.make_vars(name) for name in names]
    return list(zip(variables, nodes, strict=True))


def converted(g, nodes, parameters):
    """Return expressions of heyoka for nodes of a graph; parameters become numbers."""
    found = {}
    for n in g.cone(nodes):
        op = g.ops[n]
        if op == "variable":
            name = g.payload(n)
            if name == "t":
                found[n] = hy.time
            elif name in parameters:
                found[n] = hy.expression(parameters[name])
            else:
                found[n] = hy.make_vars(name)
        elif op == "constant":
            found[n] = hy.expression(g.payload(n))
        elif op == "pow":
            base, power = (found[a] for a in g.args[n])
            found[n] = base**power
        else:
            found[n] = CALLS[op](*(found[a] for a in g.args[n]))
    return [found[n] for n in nodes]


class Heyoka:
    """heyoka's Taylor integrator at one tolerance; rows hold the state alone.

    Attributes
    ----------
    compile_seconds : float
    """

    def __init__(self, equations, times, tolerance, *, compact=False, quadruple=False):
        began = time.perf_counter()
        kind = {"fp_type": hy.real128} if quadruple else {}
        self.number = hy.real128 if quadruple else float
        self.times = np.array([self.number(t) for t in times])
        self.integrator = hy.taylor_adaptive(
            equations,
            time=self.times[0],
            tol=self.number(tolerance),
            compact_mode=compact,
            **kind,
        )
        self.compile_seconds = time.perf_counter() - began

    @property
    def counts(self):
        """Return the order of the series, and the number of its expressions."""
        ta = self.integrator
        return {"order": ta.order, "expressions": len(ta.decomposition)}

    def solve(self, start):
        """Integrate once from a start; return rows, seconds and steps."""
        ta = self.integrator
        ta.time = self.times[0]
        ta.state[:] = [self.number(x) for x in start]
        began = time.perf_counter()
        outcome, _, _, steps, *_, states = ta.propagate_grid(
            self.times, max_steps=MOST_STEPS
        )
        seconds = time.perf_counter() - began
        good = outcome == hy.taylor_outcome.time_limit
        rows = np.column_stack([self.times, states]).astype(float) if good else None
        if rows is not None and not math.isfinite(float(np.sum(rows))):
            rows = None
        return solved(rows, seconds, int(steps))
