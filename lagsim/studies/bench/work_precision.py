"""Work-precision: the cost of each method for the error it makes, on one model.

First the solvers and their settings, then the solves, all kept as work_precision.json
has them: a row for each solve.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import defaultdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import orjson

from lagsim.errors import InputError, Problem
from lagsim.files import content as content_of
from lagsim.methods import names
from lagsim.outputs.manifest import head
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers.monitors import ResidualMonitor
from lagsim.studies.bench.reference import index_one, make_reference, state_sizes
from lagsim.studies.bench.solving import (
    DRIFT,
    SCIPY,
    GivenUpError,
    Own,
    Patience,
    Scipy,
    asking,
    formulations,
    least,
    scipy_refusal,
)
from lagsim.studies.experiment import machine, today

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from lagsim.run.session import Case
    from lagsim.studies.bench.reference import Reference
    from lagsim.studies.bench.solving import Solver

    Point = tuple[float, float]

# A row of work_precision.json; the method and formulation that it is a point of.
Row = dict[str, Any]
Key = tuple[str, str]

TOLERANCES = (1e-3, 1e-13)
# Fixed steps begin at so many rows, and are halved this often at most.
LARGEST_STEP = 16
MOST_HALVINGS = 20
# Seconds for everything.
BUDGET = 180.0
# A solve may last this long, and what `auto` takes for the tightest may take this many
# times: past it, a curve has left the picture.
PATIENCE_SECONDS = 1.0
PATIENCE_TIMES = 30.0
# Steps are halved until two halvings do not halve an error that is this small: it is
# rounding.
STALLED = 1e-6
# Steps too long for a model may take longest: so many that are too slow end a curve
# that has not begun.
GIVE_UPS = 4
TOO_SLOW, OUT_OF_TIME = "too slow", "out of time"
# Of the seconds for everything the part that the reference may take, how many times
# the share of another curve one that `auto` takes has, the least for a curve and the
# part for a solve.
OF_REFERENCE, OF_AUTO, LEAST_SECONDS, ONE = 0.3, 5.0, 0.2, 0.1

COLUMNS = (
    "method", "formulation", "setting", "value", "seconds", "evaluations", "error",
    "error_lambda", "energy_drift", "constraint_residual", "outcome", "chosen",
)  # fmt: skip
COSTS = ("seconds", "evaluations")
# Without these no chart can be drawn.
NEEDED = (
    "lagsim", "versions", "machine", "date", "model", "end", "reference", "refused",
    "rows",
)  # fmt: skip


class Wish(NamedTuple):
    """The options of a bench.

    Attributes
    ----------
    methods
        Only these, ours or `scipy:NAME`; None for all.
    tolerances, steps
        Loosest and tightest; steps None for a choice from the model.
    budget
        Seconds for everything.
    """

    methods: tuple[str, ...] | None = None
    tolerances: tuple[float, float] = TOLERANCES
    steps: tuple[float, float] | None = None
    budget: float = BUDGET

    def wants(self, name: str) -> bool:
        """Tell whether a method is asked for."""
        return self.methods is None or name in self.methods


def key_of(row: Mapping[str, Any]) -> Key:
    """Give the method and the formulation of a row."""
    return row["method"], row["formulation"]


def curves(rows: Iterable[Row]) -> dict[Key, list[Row]]:
    """Give the rows of each method and formulation, from loose to tight."""
    found = defaultdict(list)
    for row in rows:
        found[key_of(row)].append(row)
    return dict(found)


def is_answer(row: Row) -> bool:
    """Tell whether a row has an answer that others are to be compared with.

    Errors as large as the range are none, and rows that drift off the constraints are
    not one that `auto` might give.
    """
    known = row["error"] is not None and row["error"] < 1.0
    return known and row["formulation"] != DRIFT


def front(rows: Sequence[Row], cost: str, floor: float) -> list[int]:
    """Give the answers that no other beats in error and `seconds` or `evaluations`.

    Errors below `floor`, which the reference cannot tell apart, count as equal.
    """
    found = [k for k, row in enumerate(rows) if is_answer(row)]
    points = [(max(rows[k]["error"], floor), rows[k][cost]) for k in found]
    return [found[k] for k in pareto(points)]


def pareto(points: Sequence[Point]) -> list[int]:
    """Give the points that no other one beats in error and cost, by falling error.

    Of points that are equal in both the first counts.
    """
    order = sorted(range(len(points)), key=lambda k: (points[k], k))
    found = []
    cheapest = math.inf
    for k in order:
        if points[k][1] < cheapest:
            found.append(k)
            cheapest = points[k][1]
    return found[::-1]


def chosen_by_auto(case: Case, tolerances: Sequence[float]) -> dict[Key, list[float]]:
    """Return the settings that `auto` takes, by method and formulation."""
    chosen = defaultdict(list)
    for rtol in tolerances:
        plan = asking(case, rtol=rtol).plan()
        value = plan.rtol if plan.step is None else plan.step
        assert value is not None
        chosen[plan.method, plan.formulation].append(value)
    return dict(chosen)


def longest(case: Case, rtol: float) -> float:
    """Return the seconds that a solve may last, by what `auto` takes at a tolerance."""
    own, seconds = Own(case, "auto", "auto", rtol), PATIENCE_SECONDS
    value = own.plan.rtol if own.plan.step is None else own.plan.step
    assert value is not None
    with contextlib.suppress(GivenUpError):
        seconds = own.solve(value, Patience(10 * PATIENCE_SECONDS)).seconds
    return max(PATIENCE_SECONDS, PATIENCE_TIMES * seconds)


def decades(between: tuple[float, float]) -> list[float]:
    """Give tolerances from the first to the second, both included, ten times apart.

    About ten times, where the ends are not powers of ten from each other.
    """
    first, last = (math.log10(x) for x in between)
    count = round(abs(last - first))
    return [float(f"{10**x:.6g}") for x in np.linspace(first, last, count + 1)]


def halvings(between: tuple[float, float]) -> list[float]:
    """Give steps from the first down to the second, each half the one before."""
    first, last = between
    count = max(0, math.floor(math.log2(first / last) + 1e-9))
    return [first / 2**k for k in range(count + 1)]


def _curves(
    case: Case,
    wish: Wish,
    reference: Reference,
    chosen: Mapping[Key, list[float]],
    refused: list[Row],
) -> Iterator[Curve]:
    """Return all that applies, with its settings; what does not goes to `refused`."""
    tolerances, settings = decades(wish.tolerances), case.settings
    largest = min(LARGEST_STEP * settings.output_step, settings.duration / 2)
    steps = halvings(wish.steps or (largest, largest / 2**MOST_HALVINGS))

    def refuse(name: str, formulation: str, reason: str) -> None:
        refused.append({"method": name, "formulation": formulation, "reason": reason})

    for name in filter(wish.wants, names()):
        solvers, reasons = formulations(case, name)
        for why in reasons.items():
            refuse(name, *why)
        for own in solvers:
            values = tolerances if own.setting == "rtol" else steps
            more = chosen.get((own.method, own.formulation), [])
            yield Curve(own, sorted({*values, *more}, reverse=True), more, reference)
    wanted = list(filter(wish.wants, SCIPY))
    if not wanted:
        return
    own, rows = index_one(case), reference.rows
    for name in wanted:
        if refusal := scipy_refusal(own):
            refuse(name, "auto", refusal)
        else:
            solver = Scipy(own, name, rows[:, 0], state_sizes(own, rows))
            yield Curve(solver, tolerances, [], reference)


class Curve:
    """One solver, from loose to tight settings, until that makes no more sense.

    Attributes
    ----------
    values, chosen : sequence of float
        All settings, and those that `auto` takes: these are tried in any case.
    """

    def __init__(
        self,
        solver: Solver,
        values: Sequence[float],
        chosen: Sequence[float],
        reference: Reference,
    ) -> None:
        self.solver, self.values, self.chosen = solver, values, chosen
        self.reference, self.key = reference, (solver.method, solver.formulation)
        self.errors: list[float] = []
        self._given_up = 0

    def rows(self, patience: Patience) -> Iterator[tuple[float, Row]]:
        """Solve at one setting after the other; give the part done, too."""
        for done, value in enumerate(self.values, start=1):
            if value in self.chosen or not self._is_over(patience):
                yield done / len(self.values), self._row(value, patience)

    def _is_over(self, patience: Patience) -> bool:
        """Tell whether tighter settings show nothing new, or take too long."""
        enough = 1 if self.errors or patience.over else GIVE_UPS
        if self._given_up >= enough:
            return True
        if self.solver.setting != "step" or len(self.errors) < 3:
            return False
        before = min(self.errors[:-2])
        return before < STALLED and 2 * min(self.errors[-2:]) > before

    def _row(self, value: float, patience: Patience) -> Row:
        """Solve at one setting, and measure."""
        row: Row = dict.fromkeys([*COLUMNS, "reason"])
        row["method"], row["formulation"] = self.key
        row |= {"setting": self.solver.setting, "value": value, "reason": ""}
        row["chosen"] = value in self.chosen
        try:
            solved = least(lambda: self.solver.solve(value, patience))
        except GivenUpError:
            self._given_up += 1
            outcome, reason = TOO_SLOW, f"given up after {patience.seconds:.2g} s"
            if patience.over:
                outcome, reason = OUT_OF_TIME, "its share of the time was used up"
            return row | {"outcome": outcome, "reason": reason}
        row |= {key: getattr(solved, key) for key in (*COSTS, "outcome", "reason")}
        if solved.rows is None:
            return row
        error, of_lambda = self.reference.errors(solved.rows, solved.events)
        if not math.isfinite(error):
            return row
        self.errors.append(error)
        residuals = ResidualMonitor(self.reference.columns)
        residuals.add(solved.rows)
        return row | {
            "error": error,
            "error_lambda": of_lambda,
            "energy_drift": residuals.energy_drift,
            "constraint_residual": residuals.constraint_residual,
        }


def measure(
    case: Case,
    wish: Wish,
    *,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Solve the model by everything that applies, at every setting.

    Returns the content of work_precision.json, to which keys are only ever added.
    Where somebody asks for an end, it holds what was measured by then.

    Raises
    ------
    NoReferenceError
    KeyboardInterrupt, Terminated
        Where somebody asked for an end before anything was measured.
    """
    began = time.perf_counter()
    report = progress or (lambda _fraction: None)
    interrupt = interrupt or Interrupt()
    refused: list[Row] = []
    with interrupt.raised():  # there is nothing yet to be kept
        reference = make_reference(
            case, OF_REFERENCE * wish.budget, lambda x: report(OF_REFERENCE * x)
        )
        chosen = chosen_by_auto(case, decades(wish.tolerances))
        report(OF_REFERENCE)
        found = list(_curves(case, wish, reference, chosen, refused))
        most = longest(case, min(wish.tolerances))
        patience = Patience(min(most, ONE * wish.budget))
    # What `auto` takes comes first, with more time: it must be known.
    order = sorted(range(len(found)), key=lambda k: not found[k].chosen)
    shares = [OF_AUTO if found[k].chosen else 1.0 for k in order]
    rows: dict[int, list[Row]] = {}

    def solve() -> None:
        for done, k in enumerate(order):
            now = time.perf_counter()
            share = (began + wish.budget - now) * shares[done] / sum(shares[done:])
            patience.until = now + max(share, LEAST_SECONDS)
            rows[k] = []
            for part, row in found[k].rows(patience):
                rows[k].append(row)
                so_far = (sum(shares[:done]) + part * shares[done]) / sum(shares)
                report(OF_REFERENCE + (1.0 - OF_REFERENCE) * so_far)
                with interrupt.raised():
                    pass  # raises where an end is asked for
        report(1.0)

    complete = interrupt.cut(solve)
    every = [row for k in sorted(rows) for row in rows[k]]
    for cost in COSTS:
        best = set(front(every, cost, reference.floor))
        for k, row in enumerate(every):
            row[f"front_{cost}"] = k in best
    settings, first = case.settings, head(case.equations.model)
    return {
        **first,
        "versions": first["versions"] | {"scipy": version("scipy")},
        "machine": machine(),
        "date": today(),
        "start": settings.start,
        "end": settings.end,
        "output_step": settings.output_step,
        "complete": complete,
        "budget": {"seconds": wish.budget, "spent": time.perf_counter() - began},
        "reference": reference.record(),
        "curves": [
            {
                "method": found[k].key[0],
                "formulation": found[k].key[1],
                "compile_seconds": found[k].solver.compile_seconds,
            }
            for k in sorted(rows)
        ],
        "refused": refused,
        "rows": every,
    }


def read_document(path: str) -> dict[str, Any]:
    """Give the content of a work_precision.json.

    Raises
    ------
    InputError
    """
    try:
        found = orjson.loads(content_of(path))
    except OSError as error:
        why = f"{path} cannot be read: {error.strerror}"
        raise InputError([Problem("unreadable", why)]) from None
    except ValueError as error:
        raise InputError([Problem("not-json", f"{path}: {error}")]) from None
    missing = [key for key in NEEDED if not isinstance(found, dict) or key not in found]
    if missing:
        why = (
            f"{path} is not a document of `lagsim bench`, or an older one: "
            f"`{missing[0]}` is missing"
        )
        hint = "measure again: lagsim bench MODEL"
        raise InputError([Problem("not-a-bench", why, hint=hint)])
    return dict(found)
