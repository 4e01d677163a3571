"""A thousand elastic pendula at other starts: lagsim beside heyoka's batches.

Each swings for 36 s from an angular velocity of its own; wanted are the states at the
end. All on one core. heyoka: one by one, in batches of four and eight, and through its
`ensemble_propagate_until` with one thread.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

RUNS, DURATION = 1000, 36.0
FIRST, LAST = 0.3, 0.7
# So many are held against quadruple precision.
JUDGED = 20
TOLERANCES = [float(f"1e-{k}") for k in range(8, 13)]
BATCHES = (4, 8)
TURNS = 3
MODEL = "elastic-pendulum"


def starts():
    """Return all start states (runs, 4): theta, u, theta_dot, u_dot."""
    found = np.zeros((RUNS, 4))
    found[:, 1] = 1.0
    found[:, 2] = np.linspace(FIRST, LAST, RUNS)
    return found


class Equations:
    """The textbook's y' in heyoka's expressions: in doubles, and in quadruple."""

    def __init__(self, parameters):
        import heyoka as hy
        import textbook

        q, v = hy.make_vars("theta", "u"), hy.make_vars("w", "s")
        right = textbook.OF[MODEL](q, v, parameters, hy)
        self.of = list(zip([*q, *v], [*v, *right], strict=True))
        values = {name: hy.real128(x) for name, x in parameters.items()}
        exact = textbook.OF[MODEL](q, v, values, hy)
        self.exact = list(zip([*q, *v], [*v, *exact], strict=True))


def reference(equations, some):
    """Compute end states in quadruple precision."""
    import heyoka as hy

    number = hy.real128
    ta = hy.taylor_adaptive(
        equations.exact, fp_type=number, tol=number(1e-22), compact_mode=True
    )
    found = []
    for start in some:
        ta.time = number(0.0)
        ta.state[:] = [number(x) for x in start]
        ta.propagate_until(number(DURATION))
        found.append([float(x) for x in ta.state])
    return np.array(found)


def one_by_one(equations, rtol):
    import heyoka as hy

    ta = hy.taylor_adaptive(equations.of, tol=rtol)

    def run(states):
        ends = np.empty_like(states)
        for k, start in enumerate(states):
            ta.time = 0.0
            ta.state[:] = start
            ta.propagate_until(DURATION)
            ends[k] = ta.state
        return ends

    return run


def batches(size):
    def make(equations, rtol):
        import heyoka as hy

        ta = hy.taylor_adaptive_batch(
            equations.of, np.zeros((4, size)), time=np.zeros(size), tol=rtol
        )
        until = np.full(size, DURATION)

        def run(states):
            ends = np.empty_like(states)
            for k in range(0, len(states), size):
                ta.set_time(0.0)
                ta.state[:] = states[k : k + size].T
                ta.propagate_until(until)
                ends[k : k + size] = ta.state.T
            return ends

        return run

    return make


def ensemble(equations, rtol):
    import heyoka as hy

    ta = hy.taylor_adaptive(equations.of, tol=rtol)

    def run(states):
        def generate(copied, k):
            copied.time = 0.0
            copied.state[:] = states[k]
            return copied

        found = hy.ensemble_propagate_until(
            ta, DURATION, len(states), generate, algorithm="thread", max_workers=1
        )
        return np.array([one[0].state for one in found])

    return run


def own_one_by_one(case, rtol):
    """Return a function from start states to end states, by separate runs."""
    from lagsim.run.observers import Keep
    from lagsim.run.session import Session
    from lagsim.studies.bench import Own

    own = Own(case, "auto", "auto", rtol)

    def run(states):
        ends = np.empty_like(states)
        for k, start in enumerate(states):
            kept = Keep()
            state = replace(case.start, q=start[:2].copy(), v=start[2:].copy())
            Session(case.at(state), own.plan, own.system).run([kept])
            ends[k] = kept.table[-1, 1:5]
        return ends

    return run


def own_ensemble(case, rtol):
    """Return a function from start states to end states, by a sweep with `--ends`."""
    from lagsim.studies.bench import Own
    from lagsim.studies.sweep.batches import Ensemble, refusal

    session = Own(case, "auto", "auto", rtol).session
    assert not refusal(session), refusal(session)
    ensemble = Ensemble(session)

    def run(states):
        return ensemble.ends({}, states).ended[:, 1:5]

    return run


def measured():
    """Measure all solvers; return a JSON document: name -> points of time and error."""
    from measure import MODELS

    from lagsim.model.reader import read_file
    from lagsim.run.session import open_case

    texts = {"duration": str(DURATION), "output_step": str(DURATION)}
    model = read_file(str(MODELS / f"{MODEL}.yaml"), options=texts)
    case = open_case(model)
    equations = Equations({p.name: p.value for p in model.parameters})
    states = starts()
    some = np.linspace(0, RUNS - 1, JUDGED).astype(int)
    exact = reference(equations, states[some])
    ranges = np.ptp(exact, axis=0)
    makers = {
        "lagsim, ends alone": lambda rtol: own_ensemble(case, rtol),
        "lagsim, one by one": lambda rtol: own_one_by_one(case, rtol),
        "heyoka, one by one": lambda rtol: one_by_one(equations, rtol),
        "heyoka, ensemble_propagate_until": lambda rtol: ensemble(equations, rtol),
    } | {
        f"heyoka, batches of {size}": (lambda rtol, n=size: batches(n)(equations, rtol))
        for size in BATCHES
    }
    points = {name: [] for name in makers}
    for rtol in TOLERANCES:
        ready = {name: make(rtol) for name, make in makers.items()}
        best = dict.fromkeys(ready, math.inf)
        errors = {}
        for _ in range(TURNS):
            for name, run in ready.items():
                began = time.perf_counter()
                ends = run(states)
                best[name] = min(best[name], time.perf_counter() - began)
                apart = np.abs(ends[some] - exact) / ranges
                errors[name] = float(np.median(np.max(apart, axis=1)))
        for name in ready:
            points[name].append(
                {"tolerance": rtol, "seconds": best[name] / RUNS, "error": errors[name]}
            )
    return points
