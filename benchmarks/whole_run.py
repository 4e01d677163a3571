"""The whole of a run against the script a user would write, and against imports."""

from __future__ import annotations

import sys

import by_hand
import numpy as np
from measure import (
    HERE,
    LAGSIM,
    MODELS,
    Table,
    alternate,
    ms,
    process,
    ratio,
    read_rows,
    workspace,
)
from scipy.integrate import solve_ivp

from lagsim.methods.parts import state as at
from lagsim.model.reader import read_file
from lagsim.run.arc import empty_state
from lagsim.run.observers import Keep
from lagsim.run.session import open_case

MODEL = MODELS / "elastic-pendulum.yaml"
# Tolerances tried for scipy, four to a decade.
TRIED = [10 ** (-k / 4) for k in range(36, 55)]
BARE = "import numpy, yaml, typer"


class Pendulum:
    """The elastic pendulum in this process, ready to be integrated again and again."""

    def __init__(self, **options):
        texts = {name: str(value) for name, value in options.items()}
        self.session = open_case(read_file(str(MODEL), options=texts)).ready()
        system, plan = self.session.system, self.session.plan
        start, settings = self.session.case.start, self.session.case.settings
        self.runner = system.link(plan.method)
        self.first = empty_state(self.runner)
        self.first.end = settings.end
        self.first.row_step = settings.output_step
        self.first.row_limit = settings.end * (1 + 1e-12)
        self.first.rtol, self.first.atol = plan.rtol, -1.0
        self.first.fresh = self.first.health = 1.0
        y = np.concatenate([start.q, start.v])
        self.first.y[:] = y

    def integrate(self):
        """Integrate from start to end; the rows are left in the runner."""
        self.runner.prepare()
        state = self.first.copy()
        code = self.runner.advance(state, len(self.runner.block), 10**9)
        assert code == at.DONE, code
        self.rows = int(state.emitted)

    def tabulate(self):
        """Integrate, and compute the columns."""
        self.integrate()
        return self.runner.shown(self.rows)

    def simulate(self):
        """Run the loop over arcs; return theta, u and rates in all rows, (rows, 4)."""
        keep = Keep()
        self.session.run([keep])
        return keep.table[:, 1:5]


def error(y, exact):
    """Return the largest difference in any row, relative to ranges of components."""
    spans = np.ptp(exact, axis=0)
    return float(np.max(np.abs(y - exact) / spans))


def exact_rows(accelerations):
    """Return accurate rows, and the largest difference to an independent solution."""

    def rhs(_t, y):
        return [y[2], y[3], *accelerations(*y)]

    tight = Pendulum(rtol=1e-14, atol=1e-16).simulate()
    times = np.arange(len(tight)) * by_hand.STEP
    other = solve_ivp(
        rhs, (0, by_hand.END), by_hand.START, "DOP853",
        t_eval=times, rtol=3e-14, atol=1e-16,
    ).y.T  # fmt: skip
    return tight, error(other, tight)


def matched(accelerations, exact, wanted):
    """Return the loosest tolerance with an error of scipy of at most `wanted`.

    The error is the second result.
    """
    for rtol in TRIED:
        found = error(by_hand.integrate(accelerations, rtol)[1].T, exact)
        if found <= wanted:
            return rtol, found
    raise RuntimeError("scipy does not reach the error")


def integration(turns):
    """Measure the integration alone."""
    accelerations, shown = by_hand.derived()
    exact, trusted = exact_rows(accelerations)
    pendulum = Pendulum()
    wanted = error(pendulum.simulate(), exact)
    rtol, reached = matched(accelerations, exact, wanted)

    def by_scipy():
        by_hand.integrate(accelerations, rtol)

    def rows_by_scipy():
        solution = by_hand.integrate(accelerations, rtol)
        by_hand.tabulate(*solution, accelerations, shown)

    def by_lagsim():
        pendulum.integrate()

    def rows_by_lagsim():
        pendulum.tabulate()

    # Hundreds of ours last as long as one of theirs: the median of each batch.
    def often(call):
        return lambda: alternate({"": call}, 100)[""].median

    times = alternate(
        {
            "scipy": by_scipy,
            "lagsim": often(by_lagsim),
            "scipy rows": rows_by_scipy,
            "lagsim rows": often(rows_by_lagsim),
        },
        turns,
    )
    rows = [
        ["scipy's `solve_ivp` over `lambdify`", *ms(times["scipy"]), ""],
        [
            "`Runner.advance`",
            *ms(times["lagsim"]),
            f"{ratio(times['scipy'], times['lagsim'])}; goal 200",
        ],
        ["scipy, and the columns by numpy", *ms(times["scipy rows"]), ""],
        [
            "`Runner.advance` and `tabulate`",
            *ms(times["lagsim rows"]),
            ratio(times["scipy rows"], times["lagsim rows"]),
        ],
    ]
    notes = [
        (
            f"Largest error in any of {len(exact)} rows, against its range: "
            f"lagsim {wanted:.1e} at its default tolerances, scipy {reached:.1e} at "
            f"rtol = atol = {rtol:.2g}, the loosest of four to a decade that is no "
            f"worse. Against lagsim at rtol 1e-14, with which scipy at 3e-14 agrees "
            f"to {trusted:.1e}."
        )
    ]
    head = [
        "elastic pendulum, 36 s, in one process",
        "least, ms",
        "median, ms",
        "ratio",
    ]
    return rtol, Table("The integration alone", head, rows, notes)


def processes(rtol, turns):
    """Measure whole processes."""
    with workspace() as folder:
        script = [sys.executable, HERE / "by_hand.py", folder / "script"]
        script += ["--rtol", repr(rtol)]
        ours = [LAGSIM, "run", MODEL, "-o", folder / "ours"]
        commands = {
            "script": script,
            "run": ours,
            "script, no plots": [*script, "--no-plots"],
            "run, no plots": [*ours, "--no-plots"],
            "check": [LAGSIM, "check", MODEL],
            "bare": [sys.executable, "-c", BARE],
            "python": [sys.executable, "-c", ""],
        }
        cache = folder / "cache"
        times = alternate(
            {
                name: lambda command=command: (
                    process(command, LAGSIM_CACHE=cache).seconds
                )
                for name, command in commands.items()
            },
            turns,
        )
        rows = [read_rows(folder / n / "trajectory.csv") for n in ("script", "ours")]
    # All but the energy, whose range is its error.
    apart = error(rows[0][:, 1:-1], rows[1][:, 1:-1])

    def row(text, name, against="", goal=""):
        compared = ""
        if against.startswith("script"):
            compared = f"{ratio(times[against], times[name])} times faster; {goal}"
        elif against:
            compared = f"{ratio(times[name], times[against])} times as long; {goal}"
        return [text, *ms(times[name]), compared]

    bare = f'python -c "{BARE}"'
    table = [
        row("the script, with plots", "script"),
        row("`lagsim run`", "run", "script", "goal 3"),
        row("the script, without plots", "script, no plots"),
        row("`lagsim run --no-plots`", "run, no plots", "script, no plots", "goal 7"),
        row("the same, against imports", "run, no plots", "bare", "goal at most 2.2"),
        row("`lagsim check`", "check", "bare", "goal at most 3"),
        row(f"`{bare}`", "bare"),
        row('`python -c ""`', "python"),
    ]
    notes = [
        (
            "The two tables agree, all columns but the constant energy, to "
            f"{apart:.1e} of their ranges."
        )
    ]
    head = ["whole process, warm", "least, ms", "median, ms", "ratio"]
    return Table("The whole run", head, table, notes)


def tables(turns):
    """Return the tables of the report."""
    rtol, alone = integration(min(turns, 10))
    return [processes(rtol, turns), alone]
