"""Work-precision: what each method costs for the error it makes, on one model.

First which solvers are run and at which settings, then the runs, then what
work_precision.csv and work_precision.json say of them.
"""

from __future__ import annotations

import math
import sys
import time
from collections import defaultdict
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import orjson

from lagsim.errors import InputError, Problem
from lagsim.files import content as content_of
from lagsim.methods import names
from lagsim.outputs.manifest import head
from lagsim.outputs.table import table_of
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

    from lagsim.model.model import Model, Settings
    from lagsim.run.session import Case
    from lagsim.studies.bench.reference import Reference
    from lagsim.studies.bench.solving import Solved, Solver

    Point = tuple[float, float]


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


TOLERANCES = (1e-3, 1e-13)
# Fixed steps begin at so many rows, and are halved this often at most.
LARGEST_STEP = 16
MOST_HALVINGS = 20
# Seconds for everything.
BUDGET = 180.0


@dataclass(frozen=True)
class Wish:
    """What is asked for.

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


class Curve(NamedTuple):
    """A solver and the settings it is to be swept over."""

    solver: Solver
    values: list[float]

    @property
    def key(self) -> tuple[str, str]:
        """Method and formulation."""
        return self.solver.method, self.solver.formulation


class Refused(NamedTuple):
    """A method, in a formulation, that does not apply; `auto` denotes all."""

    method: str
    formulation: str
    reason: str


class Auto:
    """What `auto` takes at each tolerance."""

    def __init__(self, case: Case, tolerances: Sequence[float]) -> None:
        self.case = case
        self.tolerances = tolerances
        self.chosen: dict[tuple[str, str], dict[float, float]] = defaultdict(dict)
        for rtol in tolerances:
            plan = asking(case, rtol=rtol).plan()
            value = plan.rtol if plan.step is None else plan.step
            assert value is not None
            self.chosen[plan.method, plan.formulation][value] = rtol
        self._solvers: dict[tuple[str, str], Own] = {}

    def solver(self, curve: tuple[str, str], value: float) -> Own | None:
        """Give what `auto` makes of the model, where that is this; None elsewhere."""
        rtol = self.chosen.get(curve, {}).get(value)
        if rtol is None:
            return None
        if curve not in self._solvers:
            self._solvers[curve] = Own(self.case, "auto", "auto", rtol)
        return self._solvers[curve]


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


def curves_of(
    case: Case, wish: Wish, reference: Reference, auto: Auto, refused: list[Refused]
) -> Iterator[Curve]:
    """Give everything that applies; what does not goes to `refused`."""
    tolerances = decades(wish.tolerances)
    largest = LARGEST_STEP * case.settings.output_step
    largest = min(largest, case.settings.duration / 2)
    steps = halvings(wish.steps or (largest, largest / 2**MOST_HALVINGS))
    for name in names():
        if not wish.wants(name):
            continue
        solvers, reasons = formulations(case, name)
        refused += [Refused(name, *why) for why in reasons.items()]
        for own in solvers:
            values = tolerances if own.setting == "rtol" else steps
            more = auto.chosen.get((own.method, own.formulation), {})
            yield Curve(own, sorted({*values, *more}, reverse=True))
    wanted = [name for name in SCIPY if wish.wants(name)]
    if not wanted:
        return
    own = index_one(case)
    if refusal := scipy_refusal(own):
        refused += [Refused(name, "auto", refusal) for name in wanted]
        return
    rows = reference.rows
    sizes = state_sizes(own, rows)
    for name in wanted:
        yield Curve(Scipy(own, name, rows[:, 0], sizes), tolerances)


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


@dataclass(frozen=True, slots=True)
class Entry:
    """One solve: a row of the table."""

    method: str
    formulation: str
    setting: str
    value: float
    outcome: str
    chosen: bool
    seconds: float | None = None
    evaluations: int | None = None
    error: float | None = None
    error_lambda: float | None = None
    energy_drift: float | None = None
    constraint_residual: float | None = None
    reason: str = ""

    @property
    def curve(self) -> tuple[str, str]:
        """What it is a point of."""
        return self.method, self.formulation

    @property
    def counts(self) -> bool:
        """Whether it is an answer that others are to be compared with."""
        known = self.error is not None and self.error < 1.0
        return known and self.formulation != DRIFT

    def cost(self, of: str) -> float:
        """Give `seconds` or `evaluations` of a solve that has an answer."""
        cost = self.seconds if of == "seconds" else self.evaluations
        assert cost is not None
        return float(cost)


@dataclass(frozen=True)
class WorkPrecision:
    """Everything measured on one model.

    Attributes
    ----------
    refused : list of Refused
    compile_seconds : dict
        What making each curve's solver ready took.
    interrupted : bool
        The user ended it; the curves measured so far are whole.
    seconds : float
        What all took, of those that it might have taken.
    """

    reference: Reference
    entries: list[Entry]
    refused: list[Refused]
    compile_seconds: dict[tuple[str, str], float]
    interrupted: bool
    seconds: float
    budget: float

    def solved(self) -> list[int]:
        """Give the entries that have an answer."""
        return [k for k, e in enumerate(self.entries) if e.error is not None]

    def front(self, of: str) -> list[int]:
        """Give the entries that none beats in error and `seconds` or `evaluations`.

        Errors that the reference cannot tell apart count as equal. Those as large as
        the range are no answer, and rows that drift off the constraints are not one
        that `auto` might give.
        """
        solved = [k for k in self.solved() if self.entries[k].counts]
        floor = self.reference.floor
        points = [
            (max(e.error or 0.0, floor), e.cost(of))
            for e in (self.entries[k] for k in solved)
        ]
        return [solved[k] for k in pareto(points)]

    def curves(self) -> dict[tuple[str, str], list[Entry]]:
        """Give the entries of each method and formulation, from loose to tight."""
        found = defaultdict(list)
        for entry in self.entries:
            found[entry.curve].append(entry)
        return dict(found)


def measure(
    case: Case,
    wish: Wish,
    *,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> WorkPrecision:
    """Solve the model by everything that applies, at every setting.

    Raises
    ------
    NoReferenceError
    GivenUpError
        Interrupted before anything was measured.
    """
    began = time.perf_counter()
    told = progress or (lambda _fraction: None)
    interrupt = interrupt or Interrupt()
    refused: list[Refused] = []
    with interrupt.raised():  # there is nothing yet to be kept
        reference = make_reference(
            case, interrupt, OF_REFERENCE * wish.budget,
            lambda x: told(OF_REFERENCE * x),
        )  # fmt: skip
        auto = Auto(case, decades(wish.tolerances))
        told(OF_REFERENCE)
        curves = list(curves_of(case, wish, reference, auto, refused))
        longest = min(_patience(auto), ONE * wish.budget)
    # What `auto` takes comes first, with more time: it must be known.
    order = sorted(range(len(curves)), key=lambda k: curves[k].key not in auto.chosen)
    shares = [OF_AUTO if curves[k].key in auto.chosen else 1.0 for k in order]
    patience = Patience(longest, interrupt)
    entries: dict[int, list[Entry]] = {}
    for done, k in enumerate(order):
        if patience.pressed:
            break
        now = time.perf_counter()
        share = (began + wish.budget - now) * shares[done] / sum(shares[done:])
        patience.until = now + max(share, LEAST_SECONDS)
        sweep = _Sweep(curves[k], auto, reference, patience)
        entries[k] = []

        def swept(sweep: _Sweep = sweep, own: list[Entry] = entries[k]) -> None:
            for part, entry in sweep.entries():
                own.append(entry)
                so_far = sum(shares[:done]) + part * shares[done]  # noqa: B023  (called at once)
                told(OF_REFERENCE + (1.0 - OF_REFERENCE) * so_far / sum(shares))

        interrupt.cut(swept)
    if not patience.pressed:
        told(1.0)
    return WorkPrecision(
        reference=reference,
        entries=[entry for k in sorted(entries) for entry in entries[k]],
        refused=refused,
        compile_seconds={
            curves[k].key: curves[k].solver.compile_seconds for k in sorted(entries)
        },
        interrupted=patience.pressed,
        seconds=time.perf_counter() - began,
        budget=wish.budget,
    )


def _patience(auto: Auto) -> float:
    """Give the seconds that a solve may last."""
    curve, values = next(reversed(auto.chosen.items()))
    value = min(values)
    own = auto.solver(curve, value)
    assert own is not None
    try:
        seconds = own.solve(value, Patience(10 * PATIENCE_SECONDS)).seconds
    except GivenUpError:
        seconds = PATIENCE_SECONDS
    return max(PATIENCE_SECONDS, PATIENCE_TIMES * seconds)


class _Sweep:
    """One solver, from loose to tight, until that makes no more sense."""

    def __init__(
        self, curve: Curve, auto: Auto, reference: Reference, patience: Patience
    ) -> None:
        self.curve, self.auto = curve, auto
        self.solver = curve.solver
        self.reference, self.patience = reference, patience
        self.errors: list[float] = []
        self._given_up = 0

    def entries(self) -> Iterator[tuple[float, Entry]]:
        """Solve at one setting after the other; give the part done, too."""
        chosen = self.auto.chosen.get(self.curve.key, {})
        for done, value in enumerate(self.curve.values, start=1):
            if self.patience.pressed:
                return
            if value in chosen or not self.over:
                yield done / len(self.curve.values), self.entry(value)

    @property
    def over(self) -> bool:
        """Whether tighter settings would show nothing new, or would take too long."""
        if self._given_up and self.patience.over:
            return True
        if self._given_up >= (1 if self.errors else GIVE_UPS):
            return True
        if self.solver.setting != "step" or len(self.errors) < 3:
            return False
        before = min(self.errors[:-2])
        return before < STALLED and 2 * min(self.errors[-2:]) > before

    def entry(self, value: float) -> Entry:
        """Solve at one setting, and measure."""
        own = self.auto.solver(self.curve.key, value)
        solver, patience = own or self.solver, self.patience
        made = partial(
            Entry, *self.curve.key, self.solver.setting, value, chosen=own is not None
        )
        try:
            solved = least(lambda: solver.solve(value, patience))
        except GivenUpError:
            self._given_up += 1
            if patience.over:
                return made(
                    outcome=OUT_OF_TIME, reason="its share of the time was used up"
                )
            reason = f"given up after {patience.seconds:.2g} s"
            return made(outcome=TOO_SLOW, reason=reason)
        measured = self._measured(solved)
        if measured:
            self.errors.append(measured["error"])
        return made(
            seconds=solved.seconds, evaluations=solved.evaluations,
            outcome=solved.outcome, reason=solved.reason, **measured,
        )  # fmt: skip

    def _measured(self, solved: Solved) -> dict[str, Any]:
        """Give what the rows of an answer are off by; nothing without one."""
        if solved.rows is None:
            return {}
        error, of_lambda = self.reference.errors(solved.rows, solved.events)
        if not math.isfinite(error):
            return {}
        residuals = ResidualMonitor(self.reference.columns)
        residuals.add(solved.rows)
        return {
            "error": error,
            "error_lambda": of_lambda,
            "energy_drift": residuals.energy_drift,
            "constraint_residual": residuals.constraint_residual,
        }


TABLE = "work_precision.csv"
MANIFEST = "work_precision.json"

COLUMNS = (
    "method", "formulation", "setting", "value", "seconds", "evaluations", "error",
    "error_lambda", "energy_drift", "constraint_residual", "outcome", "chosen",
)  # fmt: skip


# Without these no chart can be drawn.
NEEDED = (
    "lagsim", "versions", "machine", "date", "model", "end", "reference", "refused",
    "rows",
)  # fmt: skip


def files(form: str) -> list[str]:
    """Give the files, with the chart as PNG, SVG or PDF in the middle."""
    return [TABLE, f"work_precision.{form}", MANIFEST]


def table(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """Give the content of work_precision.csv; the rows are those of the JSON."""
    return table_of(COLUMNS, ([row[name] for name in COLUMNS] for row in rows))


def read_document(path: str) -> dict[str, Any]:
    """Give what `bench` has measured and kept in work_precision.json.

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
            f"`{missing[0]}` is "
        )
        hint = "measure again: lagsim bench MODEL"
        raise InputError([Problem("not-a-bench", f"{why}missing", hint=hint)])
    return dict(found)


def document(
    model: Model, settings: Settings, found: WorkPrecision, files: Sequence[str]
) -> dict[str, Any]:
    """Give the content of work_precision.json; keys are only ever added."""
    fronts = {of: set(found.front(of)) for of in ("seconds", "evaluations")}
    rows = []
    for k, entry in enumerate(found.entries):
        row = {name: getattr(entry, name) for name in COLUMNS}
        row["reason"] = entry.reason
        row |= {f"front_{of}": k in front for of, front in fronts.items()}
        rows.append(row)
    curves = [
        {"method": method, "formulation": formulation, "compile_seconds": seconds}
        for (method, formulation), seconds in found.compile_seconds.items()
    ]
    known = head(model)
    return {
        **known,
        "versions": known["versions"] | {"scipy": _scipy_version()},
        "machine": machine(),
        "date": today(),
        "start": settings.start,
        "end": settings.end,
        "output_step": settings.output_step,
        "complete": not found.interrupted,
        "budget": {"seconds": found.budget, "spent": found.seconds},
        "reference": _reference(found.reference),
        "curves": curves,
        "refused": [refused._asdict() for refused in found.refused],
        "rows": rows,
        "files": list(files),
    }


def _reference(reference: Reference) -> dict[str, Any]:
    named = [*reference.state, *reference.multipliers]
    return {
        "made": reference.made,
        "verified": reference.verified,
        "trust": reference.trust,
        "floor": reference.floor,
        "horizon": reference.horizon,
        "rows": len(reference.rows),
        "known_rows": reference.known,
        "agreement": {
            reference.columns[c]: float(reference.agreement[c]) for c in named
        },
        "scales": {
            reference.columns[c]: float(reference.scales[c])
            for c in named
            if np.isfinite(reference.scales[c])
        },
    }


def _scipy_version() -> str:
    if "scipy" in sys.modules:
        return str(sys.modules["scipy"].__version__)
    from importlib.metadata import version

    return version("scipy")
