"""results-rivals.md: tables of the results of rivals.py."""

from __future__ import annotations

import math

from measure import Table, cost_at

from lagsim.studies.bench import stamp

REPORTED = (1e-8, 1e-12)
ENDS = (1e-9, 1e-11)
HOW = """\
- Equations: a textbook's (`textbook.py`, written by hand, equal to lagsim's at random
  states), or lagsim's own where those are shorter. For links, rods and Andrews'
  mechanism the multipliers are eliminated by hand along the mechanism, which is shorter
  than what textbooks print. heyoka takes them as its expressions, CVODE and scipy as a
  function compiled from them.
- Least of several, all solvers taking turns at each tolerance; compiling apart. In its
  turn a solver makes three runs. "First in a turn" compares the first ones, which begin
  with the data of other solvers in the processor's caches.
- lagsim: every row with all its columns (accelerations, energies, lambda), and on the
  constraints to rounding; as a sweep makes its runs, in one memory, as those of heyoka.
  Rivals: the states of the same rows alone.
- heyoka: batch size 1, compact mode off (on, it compiles faster and runs slower), no
  SLP vectoriser (slower on the pendula and Kepler, not tried on the others);
  constrained models as index 1, unprojected.
- CVODE: Adams' methods with functional iteration, in C from the first row to the last.
- IDA: residual and Jacobian compiled from lagsim's graph, called through Python.
- scipy: the right-hand side through ctypes, steps in Python (DOP853) or compiled (LSODA
  of odeint).
- Errors: the greatest of any coordinate or velocity in any row, against its range, and
  against heyoka's solution in quadruple precision.
- Double pendulum: ten starts, the angles moved by 0, 0.01 ... 0.09; medians."""
ENSEMBLE = """\
Angular velocities at the start from 0.3 to 0.7; 36 s, the state at the end; one core.
  Errors: median of twenty runs' greatest, against the range of the ends."""
BOUNCES = """\
`models/bouncing-ball.yaml`, 3 s, 301 rows; the greatest error of any height against the
  closed form. MuJoCo's contacts are springs and dampers, made for many bodies of any
  shape in real time; a bounce lasts as long as the stiffness says. Of four of these the
  one is shown that comes closest, with the damper that leaves 0.8 of the speed. lagsim
  locates each impact; each contact is a relation in the model file"""
LEAST = "Where lagsim or heyoka does not reach an error: the least that both reach."


def page(found):
    """Return the page as Markdown."""
    results = found["scenes"]
    dates = {}
    for r in results:
        dates.setdefault(r.get("measured", stamp(found)), []).append(r["title"])
    about = [f"{', '.join(titles)}: {date}." for date, titles in dates.items()]
    worst = max((r["agreement"] for r in results), default=0.0)
    about.append(f"At two tolerances the reference agrees with itself to {worst:.0e}.")
    lines = "\n".join(f"- {line}" for line in about)
    tables = [by_error(results), by_tolerance(results), counts(results)]
    tables += [of(found) for key, of in OTHERS.items() if key in found]
    return "\n".join([f"# Rivals\n\n{HOW}\n{lines}\n", *(t.markdown() for t in tables)])


def by_tolerance(results):
    """Return the table of times and errors at the tolerances reported."""
    head = ["model", "solver"]
    for tolerance in REPORTED:
        head += [f"ms at {tolerance:.0e}", "error"]
    rows = []
    for result in results:
        for name, points in result["points"].items():
            row = [result["title"], name]
            for tolerance in REPORTED:
                at = [p for p in points if p["tolerance"] == tolerance]
                row += (
                    [f"{at[0]['seconds'] * 1e3:.3g}", f"{at[0]['error']:.1e}"]
                    if at
                    else ["-", "-"]
                )
            rows.append(row)
    return Table("At equal tolerances", head, rows, [])


def by_error(results):
    """Return the table of times at equal errors, and the ratios."""
    head = ["model", "error", "lagsim, ms", "best rival, ms", "lagsim / rival"]
    head += ["times faster", "without columns", "first in a turn"]
    compared = [
        Compared(result, error)
        for result in results
        for error in sorted({max(e, tightest(result)) for e in REPORTED}, reverse=True)
    ]
    notes = [LEAST, *(mean_of(compared, bare) for bare in (False, True))]
    return Table("At equal errors", head, [c.row() for c in compared], notes)


def tightest(result):
    """Return the least error that both lagsim and heyoka reach."""
    return max(
        min((p["error"] for p in result["points"][name]), default=0.0)
        for name in ("lagsim", "heyoka")
    )


def mean_of(compared, bare):
    """Return a note on the geometric mean of the factors by which lagsim is faster."""
    factors = [f for c in compared if (f := c.faster(bare)) is not None]
    mean = math.exp(sum(map(math.log, factors)) / len(factors)) if factors else 0.0
    which = "the same without lagsim's columns" if bare else "geometric mean"
    return f"Times faster than the best rival, {which}: {mean:.2f}."


class Compared:
    """A scene at an error: lagsim's cost, and the best rival's."""

    def __init__(self, result, error):
        self.result, self.error = result, error
        costs = self._costs("seconds")
        self.own = costs.pop("lagsim", None)
        self.name = min(costs, key=costs.get) if costs else None
        self.best = costs.get(self.name)

    def _costs(self, kind):
        """Return the cost of each solver that reaches the error.

        kind : the key of the cost in a point.
        """
        costs = {}
        for name, points in self.result["points"].items():
            curve = [(p["error"], p[kind]) for p in points if kind in p]
            if (cost := cost_at(curve, self.error)) is not None:
                costs[name] = cost
        return costs

    def first(self):
        """Return the factor by which lagsim's first run is faster, or None."""
        costs = self._costs("first_seconds")
        own = costs.pop("lagsim", None)
        return min(costs.values()) / own if own and costs else None

    def faster(self, bare=False):
        """Return the factor by which lagsim is faster; `bare` excludes its columns."""
        if self.own is None or self.best is None:
            return None
        saved = self.result["columns_seconds"] if bare else 0.0
        return self.best / (self.own - saved)

    def row(self):
        shown = [self.result["title"], f"{self.error:.0e}"]
        shown.append(f"{self.own * 1e3:.3g}" if self.own else "never")
        if self.best is None:
            return [*shown, "none gets there", "", "", "", ""]
        shown.append(f"{self.name}: {self.best * 1e3:.3g}")
        if self.own is None:
            return [*shown, "", "", "", ""]
        ratios = [1 / self.faster(), self.faster(), self.faster(bare=True)]
        ratios.append(self.first())
        return shown + ["-" if x is None else f"{x:.2f}" for x in ratios]


def counts(results, tolerance=1e-12):
    """Return the table of operations, steps and times a step of lagsim and heyoka."""
    head = ["model", "operations: textbook", "lagsim", "method", "steps", "ns a step"]
    head += ["heyoka's order", "expressions", "steps", "ns a step"]
    rows = []
    for result in results:
        row = [result["title"], *(str(n) for n in result["nodes"].values())]
        for name, told in (("lagsim", ("how",)), ("heyoka", ("order", "expressions"))):
            at = [p for p in result["points"][name] if p["tolerance"] == tolerance]
            if not at:
                row += ["-"] * (len(told) + 2)
                continue
            saved = result["columns_seconds"] if name == "lagsim" else 0.0
            step = (at[0]["seconds"] - saved) / at[0]["steps"] * 1e9
            row += [*(str(at[0][key]) for key in told), str(at[0]["steps"])]
            row.append(f"{step:.0f}")
        rows.append(row)
    note = (
        f"At a tolerance of {tolerance:.0e}; a step's time is that of whole runs with "
    )
    note += "their rows, lagsim's without its columns."
    title = "What a step is made of"
    return Table(title, head, rows, [note])


def of_ensemble(found):
    """Return the table of the cost of one of many runs at given errors of its end."""
    rows = []
    for name, curve in found["ensemble"].items():
        row = [name]
        for error in ENDS:
            cost = cost_at([(p["error"], p["seconds"]) for p in curve], error)
            row.append("never" if cost is None else f"{cost * 1e6:.3g}")
        rows.append(row)
    head = ["solver", *(f"µs a run at {error:.0e}" for error in ENDS)]
    return Table("A thousand elastic pendula", head, rows, [ENSEMBLE])


def of_bounces(found):
    """Return the table of times and errors for the bouncing ball."""
    rows = [
        [x["solver"], f"{x['seconds'] * 1e3:.3g}", f"{x['error']:.1e}"]
        for x in found["bounces"]
    ]
    notes = [f"{BOUNCES}; MuJoCo {found['versions']['mujoco']}."]
    return Table("A ball that bounces", ["solver", "ms", "error, m"], rows, notes)


OTHERS = {"ensemble": of_ensemble, "bounces": of_bounces}
