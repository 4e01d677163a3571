"""Andrews' mechanism against scipy's DOP853 on the same KKT system in numpy."""

from __future__ import annotations

import json

import numpy as np
import sympy as sp
from measure import HERE, MODELS, Table, alternate, ms, ratio
from scipy.integrate import solve_ivp

from lagsim.model.reader import read_file
from lagsim.run.session import open_case

PROBLEMS = HERE.parent / "tests" / "data" / "problems.json"
WANTED = 1e-9
# Tolerances tried, four to a decade.
TRIED = [10 ** (-k / 4) for k in range(20, 57)]


def problem():
    """Return the entry of Andrews' mechanism in the list of problems."""
    listed = json.loads(PROBLEMS.read_text())["problems"]
    return next(p for p in listed if p["id"] == "andrews")


class Numpy:
    """M q'' = f + A^T lambda, A q'' = b, derived by sympy and solved by numpy."""

    def __init__(self, given):
        names = given["coordinates"]
        self.n, self.m = len(names), len(given["holonomic"])
        q = sp.Matrix(sp.symbols(names))
        v = sp.Matrix(sp.symbols([f"{name}_dot" for name in names]))
        values = {k: sp.Float(x, 20) for k, x in given["parameters"].items()}
        scope = {str(s): s for s in [*q, *v]} | values

        def expression(text):
            return sp.lambdify(list(scope), text, "sympy")(*scope.values())

        T, V = expression(given["T"]), expression(given["V"])
        g = sp.Matrix([expression(text) for text in given["holonomic"]])
        Q = sp.Matrix([expression(given["Q"].get(name, "0")) for name in names])
        momenta = sp.Matrix([T]).jacobian(v).T
        M = momenta.jacobian(v)
        f = Q + sp.Matrix([T - V]).jacobian(q).T - momenta.jacobian(q) * v
        A = g.jacobian(q)
        b = -(A * v).jacobian(q) * v
        kkt = sp.Matrix(sp.BlockMatrix([[M, -A.T], [A, sp.zeros(self.m, self.m)]]))
        self.system = sp.lambdify([*q, *v], [kkt, f.col_join(b)], "numpy", cse=True)
        self.start = [float(given[k][name]) for k in ("q0", "qdot0") for name in names]
        self.end = float(given["t_end"])
        self.times = np.linspace(0.0, self.end, 1001)

    def rhs(self, _t, y):
        """Return y' (14,) of y = (q, q')."""
        kkt, right = self.system(*y)
        return np.concatenate(
            [y[self.n :], np.linalg.solve(kkt, right[:, 0])[: self.n]]
        )

    def run(self, rtol):
        """Integrate with 1001 rows; return last state and count of evaluations."""
        result = solve_ivp(
            self.rhs, (0.0, self.end), self.start, "DOP853",
            t_eval=self.times, rtol=rtol, atol=rtol,
        )  # fmt: skip
        return result.y[:, -1], result.nfev


class Ours:
    """The shipped model at one tolerance, ready to be run again and again."""

    def __init__(self, rtol):
        path = str(MODELS / "andrews.yaml")
        options = {"rtol": repr(rtol), "duration": "0.03", "output_step": "3e-5"}
        self.session = open_case(read_file(path, options=options)).ready()
        # Linking is part of preparing a model, not of integrating it.
        system = self.session.system
        runner = system.link(self.session.plan.method)
        system.link = lambda _name: runner

    def add(self, rows):
        """Store the last of the rows (k, columns); an observer of the run."""
        self.last = rows[-1]

    def run(self):
        """Run the model; return the last state and the number of evaluations."""
        done = self.session.run([self])
        return self.last[1:15].copy(), done.statistics.evaluations


def loosest(run, exact):
    """Return the loosest tolerance at which the error of the angles is at most WANTED.

    The tuple also has the errors of angles and rates at that tolerance, and the number
    of evaluations.

    run : rtol -> last state and evaluations.
    exact : the reference state.
    """
    for rtol in TRIED:
        y, evaluations = run(rtol)
        if (angles := errors(y, exact)[0]) <= WANTED:
            return rtol, angles, errors(y, exact)[1], evaluations
    raise RuntimeError("the error is not reached")


def errors(y, exact):
    """Return the largest error of an angle (rad), and of a rate (rad/s)."""
    found = np.abs(y - exact)
    return float(found[:7].max()), float(found[7:].max())


def tables(turns):
    """Measure both programs; return the table of the report in a list."""
    given = problem()
    end = given["reference"][-1]
    names = given["coordinates"]
    exact = np.array([float(end[k][name]) for k in ("q", "qdot") for name in names])
    theirs = Numpy(given)
    rtol, angle, rate, count = loosest(theirs.run, exact)
    own = loosest(lambda rtol: Ours(rtol).run(), exact)
    ours, default = Ours(own[0]), Ours(1e-11)

    def plainly(run, *arguments):
        def call():
            run(*arguments)

        return call

    def batch(run):
        return lambda: alternate({"": plainly(run)}, 20)[""].median

    times = alternate(
        {
            "scipy": plainly(theirs.run, rtol),
            "lagsim": batch(ours.run),
            "default": batch(default.run),
        },
        turns,
    )
    y, evaluations = default.run()
    shown = [
        ("scipy's DOP853, KKT in numpy", "scipy", rtol, angle, rate, count),
        ("lagsim", "lagsim", *own),
        ("lagsim at its default", "default", 1e-11, *errors(y, exact), evaluations),
    ]
    rows = [
        [
            what,
            f"{tolerance:.2g}",
            f"{angle:.1e}",
            f"{rate:.1e}",
            str(count),
            *ms(times[name]),
            f"{ratio(times['scipy'], times[name])}" if name != "scipy" else "",
        ]
        for what, name, tolerance, angle, rate, count in shown
    ]
    rows[1][-1] += "; goal 50"
    head = ["0.03 s, 1001 rows", "rtol", "angles, rad", "rates, rad/s", "evaluations"]
    head += ["least, ms", "median, ms", "times faster"]
    notes = [
        (
            "Errors at the end against tests/data/problems.json; of four tolerances to "
            f"a decade the loosest with which every angle is right to {WANTED:g}."
        ),
        (
            "lagsim projects every step and every row and computes every column; "
            "scipy's solution drifts from the constraints and its rows hold the state "
            "alone."
        ),
    ]
    return [Table("Andrews' mechanism", head, rows, notes)]
