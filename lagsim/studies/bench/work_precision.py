"""Work-precision: the cost of each method against its error, on one model.

Errors are measured against a reference: two solutions by different means, as accurate
as double precision allows. Errors below the difference of both are not reported. If the
motion diverges exponentially, the two agree only up to a horizon, and errors are
measured before it.

The rest of the module selects solvers and settings, and makes the solves. The results
are stored as in work_precision.json, with a row for each solve.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections import defaultdict
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import orjson

from lagsim.codes.known import NO_REFERENCE, NOT_A_BENCH, NOT_JSON, UNREADABLE
from lagsim.errors import InputError, LagsimError, unusable
from lagsim.files import content as content_of
from lagsim.methods import names
from lagsim.outputs.manifest import head
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers.monitors import ResidualMonitor
from lagsim.studies.audit.evidence import UNEXPLAINED
from lagsim.studies.bench import (
    DRIFT,
    LEAST_RTOL,
    PREFIX,
    SCIPY,
    Own,
    Scipy,
    Solver,
    fastest,
    formulation_solvers,
    index_one,
    machine,
    scipy_refusal,
    today,
    with_method,
)
from lagsim.studies.comparison import IMPACT, paired_times, range_or_size, within
from lagsim.studies.trial import TOO_SLOW, Patience
from lagsim.tolerances import COMPUTED_ZERO, SAME_STEP

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Event
    from lagsim.run.session import Case

    Point = tuple[float, float]

    Document = dict[str, Any]

# The reference is computed by the first of these methods that can handle the model ...
FIRST = ("taylor", "dop853")
# ... and verified by the method of these whose result is closest to it.
SECOND = ("taylor", "dop853", "kahan-li8", "gauss4", "radau", "rk4")
TIGHT = (1e-14, 1e-13, 1e-12, 1e-10, 1e-8, 1e-6)
# Fixed steps are halved this often, from a quarter of a row's spacing on, ...
HALVINGS = 10
# Rows from which ranges are computed, since output rows may lie a period apart.
MOMENTS = 4001
# An agreement below this ends the search for a better one.
GOOD = 1e-12
# Limit of one solve: a part of the total time, or a number of seconds if the total is
# short; the number of solves for the verification.
OF_ONE, ONE_SECONDS = 0.25, 5.0
SECONDS = 40.0

# Rows count as known while both solutions agree to this part of each coordinate's
# range: to the first of these levels that holds for all rows ...
WHOLE = (1e-10, 1e-8, 1e-7)
# ... or else to the first level that holds for more than a few rows: a number, or a
# part if rows are few.
LEVELS = (*WHOLE, 1e-6, 1e-4, 1e-2)
MANY, FEW = 50, 0.1


class NoReferenceError(LagsimError):
    """There is no reference solution to measure errors against (exit code 3)."""

    exit_code = 3
    code = NO_REFERENCE


class ReferenceSolution(NamedTuple):
    """Rows of a solution with their columns and events.

    `how` is a text on method and setting, `value` the tolerance or the step.
    """

    how: str
    method: str
    value: float
    columns: tuple[str, ...]
    rows: Floats
    events: Sequence[Event] = ()


def _solved(
    solver: Solver, values: Sequence[float], patience: Patience
) -> Iterator[ReferenceSolution]:
    """Yield solutions by a solver, for use as a reference solution.

    A solver with error control yields one solution, at the first of the tolerances
    `values` with which it succeeds; a solver with fixed steps yields one for each step
    in `values`. If a tighter tolerance has failed, for example at a singularity, a step
    at a looser one may have passed over it. A solution at a looser tolerance is used
    only if it keeps its energy.
    """
    fixed, left, failed = solver.setting == "step", iter(values), False
    for value in left:
        solved = solver.solve(value, patience)
        if solved.outcome == TOO_SLOW:
            if fixed:
                return
            next(left, None)  # a slightly looser tolerance takes as long
        elif not len(solved.rows):
            failed = not fixed
        elif not (failed and _drifts(solver.names, solved.rows)):
            how = f"{solver.method} at {solver.setting} {value:.3g}"
            yield ReferenceSolution(
                how, solver.method, value, solver.names, solved.rows, solved.events
            )
            if not fixed:
                return


def _drifts(columns: Sequence[str], rows: Floats) -> bool:
    """Whether energy less work drifts in rows by more than UNEXPLAINED.

    The drift is relative to the largest kinetic energy of the rows, or to the largest
    energy if there is no column of the kinetic energy.

    rows : (k, columns), the rows of a run.
    """
    residuals = ResidualMonitor(columns)
    residuals.add(rows)
    name = "kinetic" if "kinetic" in columns else "energy"
    size = float(np.max(np.abs(rows[:, columns.index(name)])))
    return not residuals.drift.size <= UNEXPLAINED * size


def _by_own(
    case: Case, names: Iterable[str], patience: Patience
) -> Iterator[ReferenceSolution]:
    """Yield solutions by methods of lagsim, as far as these can handle the model.

    names : the names of the methods.
    """
    steps = [case.settings.output_step / 4 / 2**k for k in range(HALVINGS)]
    for name in names:
        with contextlib.suppress(InputError):
            own = Own(case, name)
            values = TIGHT if own.setting == "rtol" else steps
            yield from _solved(own, values, patience)


def _independent_solutions(
    case: Case, first: ReferenceSolution, patience: Patience
) -> Iterator[ReferenceSolution]:
    """Yield solutions independent of the solution `first`, for comparison.

    They are by other methods; if none succeeds, by the method of `first` at looser
    tolerances.
    """
    found = _by_own(case, (x for x in SECOND if x != first.method), patience)
    own = index_one(case)
    if not scipy_refusal(own):
        solver = Scipy(own, f"{PREFIX}DOP853", first.rows)
        found = itertools.chain(found, _solved(solver, (LEAST_RTOL,), patience))
    looser = [x for x in TIGHT if x > first.value]
    best = next(found, None)
    if best is None:
        yield from _solved(Own(case, first.method), looser, patience)
    else:
        yield from (best, *found)


@dataclass(frozen=True)
class Reference:
    """Reference solution: rows, and an error estimate for each column.

    Attributes
    ----------
    columns : tuple of str
        Names of the columns.
    origin : str
        Method and setting of the rows.
    rows : ndarray, shape (k, columns)
    state, multipliers : list of int
        Indices of the columns of q and q', and of lambda.
    scales : ndarray, shape (columns,)
        The range of each column; inf for a column that is not compared.
    events : sequence of Event
    verified : str
        Method and setting of the second solution.
    known : int
        The number of rows before the horizon.
    agreement : ndarray, shape (columns,)
        The largest difference of both solutions over these rows, relative to the range.
    """

    columns: tuple[str, ...]
    origin: str
    rows: Floats
    state: list[int]
    multipliers: list[int]
    scales: Floats
    events: Sequence[Event] = ()
    verified: str = ""
    known: int = 0
    agreement: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def horizon(self) -> float | None:
        """The time past which the two solutions differ; None if all rows agree."""
        last = self.known - 1
        return float(self.rows[last, 0]) if self.known < len(self.rows) else None

    @property
    def floor(self) -> float:
        """The smallest error that can be resolved, relative to the range."""
        return float(np.max(self.agreement[self.state]))

    @property
    def trust(self) -> str:
        """Text on the accuracy of the reference, and on its horizon."""
        text = f"{self.origin}; {self.verified} agrees with it to {self.floor:.1g}"
        if self.horizon is not None:
            end = self.rows[-1, 0]
            text += (
                f" up to t = {self.horizon:.4g} of {end:.4g}, after which the motion "
                "is not known: errors are computed from the rows before"
            )
        elif self.floor > LEVELS[-1]:
            text += ": the two solutions disagree, so that the errors are not reliable"
        elif self.floor > WHOLE[0]:
            text += ": smaller errors cannot be resolved"
        return text

    @property
    def rank(self) -> tuple[bool, int, float]:
        """Sort key of references: larger for a better one.

        Compared first: whether all rows agree to within one of the errors `WHOLE`; then
        the number of rows before the horizon, divided by the level of their error
        (`LEVELS`); then the smallest error that can be resolved.
        """
        level = next((x for x in LEVELS if self.floor <= x), 1.0)
        whole = self.horizon is None and level in WHOLE
        return whole, int(self.known / level), -self.floor

    def differences(self, rows: Floats, count: int, events: Sequence[Event]) -> Floats:
        """Return the differences between a run and the reference, relative to ranges.

        The shape is (count, columns). Velocities jump at impacts, and multipliers at
        all events: in rows between the times of one event in both runs, the difference
        of these columns is set to 0.

        rows : the rows of the run, of which the first `count` are compared.
        events : the events of the run.
        """
        differences = np.abs(rows[:count] - self.rows[:count]) / self.scales
        velocities = self.state[len(self.state) // 2 :]
        for columns, only in ((velocities, (IMPACT,)), (self.multipliers, ())):
            own, other = (
                [e for e in run if e.kind in only or not only]
                for run in (self.events, events)
            )
            same = within(rows[:count, 0], paired_times(own, other))
            differences[np.ix_(np.flatnonzero(same), np.array(columns, int))] = 0.0
        return differences

    def against(self, second: ReferenceSolution) -> Reference:
        """Return the reference with the field `agreement` set by a second solution."""
        count = min(len(self.rows), len(second.rows))
        differences = self.differences(second.rows, count, second.events)
        known = _rows_before_horizon(np.max(differences[:, self.state], axis=1))
        agreement = np.max(differences[:known], axis=0)
        return replace(self, verified=second.how, known=known, agreement=agreement)

    def errors(
        self, rows: Floats, events: Sequence[Event] = ()
    ) -> tuple[float, float | None]:
        """Return the largest relative errors of state and lambda before the horizon.

        The error is nan if the times of the rows differ from the times of the
        reference.

        Parameters
        ----------
        rows : ndarray, shape (k, columns)
        events : sequence of Event
            The events of the run that made the rows.
        """
        count = min(self.known, len(rows))
        spacing = float(self.rows[min(1, len(self.rows) - 1), 0] - self.rows[0, 0])
        delays = np.abs(rows[:count, 0] - self.rows[:count, 0])
        same = delays <= SAME_STEP * abs(spacing)
        if count < self.known - 1 or not np.all(same[:-1]):
            return float("nan"), None
        found = np.max(self.differences(rows, count, events)[same], axis=0)
        error, lam = float(np.max(found[self.state])), found[self.multipliers]
        return error, float(np.max(lam)) if len(lam) else None

    def record(self) -> Document:
        """Return the entry of work_precision.json."""
        named = {self.columns[c]: c for c in (*self.state, *self.multipliers)}
        scales = {name: float(self.scales[c]) for name, c in named.items()}
        return {
            "made": self.origin,
            "verified": self.verified,
            "trust": self.trust,
            "floor": self.floor,
            "horizon": self.horizon,
            "rows": len(self.rows),
            "known_rows": self.known,
            "agreement": {name: float(self.agreement[c]) for name, c in named.items()},
            "scales": {name: x for name, x in scales.items() if np.isfinite(x)},
        }


def make_reference(
    case: Case,
    seconds: float = SECONDS,
    progress: Callable[[float], None] | None = None,
) -> Reference:
    """Compute a reference by two solutions of different means, as accurate as possible.

    Parameters
    ----------
    seconds : float
        The time limit for all solutions, which is exceeded only until two are found.
    progress : callable, optional
        Called with the part of the time that has passed.

    Raises
    ------
    NoReferenceError
        If fewer than two solutions are found.
    """
    began = time.perf_counter()
    patience = Patience(max(OF_ONE * seconds, ONE_SECONDS))
    first = next(_by_own(case, FIRST, patience), None)
    if first is None:
        text = "no reference for errors: the motion cannot be solved to its "
        text += f"end at any tolerance in {patience.seconds:.3g} s"
        hint = "; `lagsim run` shows where it fails, --budget allows more time"
        raise NoReferenceError(text + hint)
    patience.until = max(began + seconds, time.perf_counter() + ONE_SECONDS)
    # Ranges include rows between the output rows, at an equal tolerance.
    own = Own(
        case.with_settings(output_step=case.settings.duration / MOMENTS), first.method
    )
    between = next(_solved(own, (first.value,), patience), first)
    alone = unverified(case.equations, first, between.rows)
    best: Reference | None = None
    for second in _independent_solutions(case, first, patience):
        found = alone.against(second)
        if best is None or found.rank > best.rank:
            best = found
        if progress is not None:
            progress(min(1.0, (time.perf_counter() - began) / seconds))
        if best.horizon is None and best.floor <= GOOD:
            break
        patience.until = began + seconds
    if best is None:
        text = f"no reference for errors: {first.how} is the only solution found"
        raise NoReferenceError(text)
    return best


def unverified(e: Equations, first: ReferenceSolution, between: Floats) -> Reference:
    """Return a solution as a reference that no second solution has confirmed.

    first : the solution.
    between : further rows (k, columns) of it, from which the ranges of columns are
        determined too.
    """
    state = [first.columns.index(name) for name in e.state]
    multipliers = [first.columns.index(name) for name in e.multipliers]
    scales = _scales(e, np.concatenate((first.rows, between)), state, multipliers)
    return Reference(
        first.columns, first.how, first.rows, state, multipliers, scales, first.events
    )


def _rows_before_horizon(differences: Floats) -> int:
    """Return the number of rows before the horizon of two solutions.

    It is the number of all rows if no horizon can be found.

    differences : (rows,), the largest difference of both solutions up to each row.
    """
    count = len(differences)
    known = [int(np.argmax([*~(differences <= level), True])) for level in LEVELS]
    if count in known[: len(WHOLE)]:
        return count
    enough = max(2.0, min(MANY, FEW * count))
    otherwise = known[-1] if known[-1] > 1 else count
    return next((k for k in known if k >= enough), otherwise)


def _scales(
    e: Equations, rows: Floats, state: list[int], multipliers: list[int]
) -> Floats:
    """Return the range of each column; inf for a column that is not compared.

    The scale of a column that is constant to rounding is the largest |value| of columns
    of its unit. If that is 0, the scale of a position follows from that of its
    velocity, and vice versa.

    rows : (k, columns), the rows of a run.
    state, multipliers : indices of columns that are compared.
    """
    ranges = np.ptp(rows, axis=0)
    sizes = np.maximum(np.max(np.abs(rows), axis=0), ranges)
    scales = np.full(len(sizes), np.inf)
    q, v, s = np.split(np.array(state, int), [len(e.q), 2 * len(e.q)])
    units = [np.array([x.unit for x in of]) for of in (e.model.coordinates, e.states)]
    parts = (q, units[0]), (v, units[0]), (s, units[1])
    of_unit = [of[names == unit] for of, names in parts for unit in set(names)]
    for columns in (*of_unit, *([column] for column in multipliers)):
        largest = np.max(sizes[columns]) or np.inf
        scales[columns] = range_or_size(ranges[columns], largest, COMPUTED_ZERO)
    duration = float(np.ptp(rows[:, 0])) or 1.0
    at, rates = scales[q], scales[v]
    scales[q] = np.where(np.isinf(at), rates * duration, at)
    scales[v] = np.where(np.isinf(rates), at / duration, rates)
    return scales


# A row of work_precision.json; the method and formulation that it is a point of.
Row = dict[str, Any]
Key = tuple[str, str]

TOLERANCES = (1e-3, 1e-13)
# The longest fixed step, in output steps, and the largest number of halvings.
LARGEST_STEP = 16
MOST_HALVINGS = 20
# Time limit of the whole study, in s.
BUDGET = 180.0
# Time limit of a solve in s, and relative to the time of `auto` at the tightest
# tolerance: a slower curve lies outside the chart.
PATIENCE_SECONDS = 1.0
PATIENCE_TIMES = 30.0
# Steps are halved until two halvings do not halve an error below this: it is rounding.
STALLED = 1e-6
# Steps that are too long for a model can take the longest time. This number of slow
# solves ends a curve without an answer.
GIVE_UPS = 4
OUT_OF_TIME = "out of time"
# Part of the time limit for the reference; ratio of the time of a curve that `auto`
# selects to that of another curve; least time of a curve, in s; part of a curve's time
# for one solve.
OF_REFERENCE, OF_AUTO, LEAST_SECONDS, ONE = 0.3, 5.0, 0.2, 0.1

COLUMNS = (
    "method", "formulation", "setting", "value", "seconds", "evaluations", "error",
    "error_lambda", "energy_drift", "constraint_residual", "outcome", "chosen",
)  # fmt: skip
COSTS = ("seconds", "evaluations")
# Columns that a chart needs.
NEEDED = (
    "lagsim", "versions", "machine", "date", "model", "end", "reference", "refused",
    "rows",
)  # fmt: skip


class BenchOptions(NamedTuple):
    """Options of a bench.

    Attributes
    ----------
    methods : tuple of str or None
        Methods of lagsim, or `scipy:NAME`; None for all.
    tolerances : tuple of float
        The loosest and the tightest tolerance.
    steps : tuple of float or None
        The longest and the shortest step; None for a range derived from the model.
    budget : float
        The time limit of the bench, in s.
    """

    methods: tuple[str, ...] | None = None
    tolerances: tuple[float, float] = TOLERANCES
    steps: tuple[float, float] | None = None
    budget: float = BUDGET

    def is_requested(self, name: str) -> bool:
        """Whether a method is requested."""
        return self.methods is None or name in self.methods


def curves(rows: Iterable[Row]) -> dict[Key, list[Row]]:
    """Return the rows of work_precision.json by (method, formulation).

    The rows of each are sorted from loose to tight settings.
    """
    found = defaultdict(list)
    for row in rows:
        found[row["method"], row["formulation"]].append(row)
    return dict(found)


def is_answer(row: Row) -> bool:
    """Whether a row is an answer, with which other rows are compared.

    Rows with an error as large as the range are no answers, and neither are rows with
    drift off the constraints, which `auto` does not select.
    """
    known = row["error"] is not None and row["error"] < 1.0
    return known and row["formulation"] != DRIFT


def front(rows: Sequence[Row], cost: str, floor: float) -> list[int]:
    """Return the indices of rows that are Pareto-optimal in error and a cost.

    Only answers count, see `is_answer`. The cost is `seconds` or `evaluations`. Errors
    below `floor`, which the reference cannot resolve, count as equal.
    """
    found = [k for k, row in enumerate(rows) if is_answer(row)]
    points = [(max(rows[k]["error"], floor), rows[k][cost]) for k in found]
    return [found[k] for k in pareto(points)]


def pareto(points: Sequence[Point]) -> list[int]:
    """Return the Pareto-optimal points (error, cost) by falling error.

    Of points that are equal in both the first is kept.
    """
    order = sorted(range(len(points)), key=lambda k: (points[k], k))
    found, cheapest = list[int](), math.inf
    for k in order:
        if points[k][1] < cheapest:
            found.append(k)
            cheapest = points[k][1]
    return found[::-1]


def chosen_by_auto(case: Case, tolerances: Sequence[float]) -> dict[Key, list[float]]:
    """Return the settings that `auto` selects, by method and formulation.

    tolerances : the tolerances requested, for each of which a setting is selected.
    """
    chosen = defaultdict(list)
    for rtol in tolerances:
        plan = with_method(case, rtol=rtol).plan()
        chosen[plan.method, plan.formulation].append(plan.accuracy[1])
    return dict(chosen)


def longest(case: Case, rtol: float) -> float:
    """Return the time limit of a solve in s, a multiple of the time that `auto` needs.

    rtol : the tolerance of `auto`.
    """
    own, seconds = Own(case, "auto", "auto", rtol), PATIENCE_SECONDS
    solved = own.solve(own.value, Patience(10 * PATIENCE_SECONDS))
    if solved.outcome != TOO_SLOW:
        seconds = solved.seconds
    return max(PATIENCE_SECONDS, PATIENCE_TIMES * seconds)


def decades(between: tuple[float, float]) -> list[float]:
    """Return tolerances between two ends, both included, with a ratio of about ten.

    Examples
    --------
    >>> decades((1e-3, 1e-5))
    [0.001, 0.0001, 1e-05]
    """
    first, last = (math.log10(x) for x in between)
    count = round(abs(last - first))
    return [float(f"{10**x:.6g}") for x in np.linspace(first, last, count + 1)]


def halvings(between: tuple[float, float]) -> list[float]:
    """Return steps from the first down to the second, each half of the previous one."""
    first, last = between
    count = max(0, math.floor(math.log2(first / last) + 1e-9))
    return [first / 2**k for k in range(count + 1)]


def _curves(
    case: Case,
    options: BenchOptions,
    reference: Reference,
    chosen: Mapping[Key, list[float]],
    refused: list[Row],
) -> Iterator[PrecisionCurve]:
    """Yield the curves of a bench, each with a solver and its settings.

    options : options of the bench.
    reference : the solution for errors.
    chosen : settings that `auto` selects.
    refused : list to which the solvers are added that cannot handle the model.
    """
    tolerances, settings = decades(options.tolerances), case.settings
    largest = min(LARGEST_STEP * settings.output_step, settings.duration / 2)
    steps = halvings(options.steps or (largest, largest / 2**MOST_HALVINGS))
    for name in filter(options.is_requested, names()):
        solvers, reasons = formulation_solvers(case, name)
        refused += [
            {"method": name, "formulation": formulation, "reason": reason}
            for formulation, reason in reasons.items()
        ]
        for own in solvers:
            values = tolerances if own.setting == "rtol" else steps
            more = chosen.get((own.method, own.formulation), [])
            yield PrecisionCurve(
                own, sorted({*values, *more}, reverse=True), more, reference
            )
    wanted = list(filter(options.is_requested, SCIPY))
    if not wanted:
        return
    own = index_one(case)
    refusal = scipy_refusal(own)
    for name in wanted:
        if refusal:
            refused.append({"method": name, "formulation": "auto", "reason": refusal})
        else:
            yield PrecisionCurve(
                Scipy(own, name, reference.rows), tolerances, [], reference
            )


@dataclass
class PrecisionCurve:
    """Work-precision curve of a solver, from loose to tight settings.

    Attributes
    ----------
    values, chosen : sequence of float
        All settings, and the settings that `auto` selects, which are always solved.
    reference : Reference
        The solution that errors are measured against.
    errors : list of float
        Errors of the settings solved so far.
    given_up : int
        Number of solves that have exceeded their time limit.
    """

    solver: Solver
    values: Sequence[float]
    chosen: Sequence[float]
    reference: Reference
    errors: list[float] = field(default_factory=list)
    given_up: int = 0

    def rows(self, patience: Patience) -> Iterator[tuple[float, Row]]:
        """Yield a row for each setting, with the fraction of the settings done.

        patience : time limits of the solves.
        """
        for done, value in enumerate(self.values, start=1):
            if value in self.chosen or not self._is_over(patience):
                yield done / len(self.values), self._row(value, patience)

    def _is_over(self, patience: Patience) -> bool:
        """Whether to skip tighter settings: errors stall, or solves take too long."""
        enough = 1 if self.errors or patience.over else GIVE_UPS
        if self.given_up >= enough:
            return True
        if self.solver.setting != "step" or len(self.errors) < 3:
            return False
        before = min(self.errors[:-2])
        return before < STALLED and 2 * min(self.errors[-2:]) > before

    def _row(self, value: float, patience: Patience) -> Row:
        """Solve at the setting `value`; return the row of work_precision.json."""
        solver, row = self.solver, dict[str, Any].fromkeys(COLUMNS)
        row |= {"method": solver.method, "formulation": solver.formulation}
        row |= {"setting": solver.setting, "value": value, "reason": ""}
        row["chosen"] = value in self.chosen
        solved = fastest(lambda: solver.solve(value, patience))
        row |= {"outcome": solved.outcome, "reason": solved.reason}
        if solved.outcome == TOO_SLOW:
            self.given_up += 1
            if patience.over:
                reason = "its share of the time was used up"
                row |= {"outcome": OUT_OF_TIME, "reason": reason}
            return row
        row |= {key: getattr(solved, key) for key in COSTS}
        if not len(solved.rows):
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
            "energy_drift": residuals.drift.size,
            "constraint_residual": residuals.constraint_residual,
        }


def measure(
    case: Case,
    options: BenchOptions,
    *,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> Document:
    """Solve the model by every applicable solver, at every setting.

    Parameters
    ----------
    case : Case
        The case of the file.
    options : BenchOptions
        Methods, tolerances, steps and time limit.

    Returns
    -------
    dict
        The content of work_precision.json. Later versions of lagsim add keys and remove
        none. After an interrupt it has the rows measured until then.

    Raises
    ------
    NoReferenceError
        If there is no reference.
    KeyboardInterrupt, Terminated
        If the bench is interrupted before the first row.
    """
    began = time.perf_counter()
    report = progress or (lambda _fraction: None)
    interrupt = interrupt or Interrupt()
    refused: list[Row] = []
    with interrupt.raised():  # there is no result yet that could be lost
        reference = make_reference(
            case, OF_REFERENCE * options.budget, lambda x: report(OF_REFERENCE * x)
        )
        chosen = chosen_by_auto(case, decades(options.tolerances))
        report(OF_REFERENCE)
        found = list(_curves(case, options, reference, chosen, refused))
        most = longest(case, min(options.tolerances))
        patience = Patience(min(most, ONE * options.budget))
    # Solvers that `auto` selects come first, with more time, since their curves are
    # needed.
    order = sorted(range(len(found)), key=lambda k: not found[k].chosen)
    shares = [OF_AUTO if found[k].chosen else 1.0 for k in order]
    rows: dict[int, list[Row]] = {}

    def solve() -> None:
        for done, k in enumerate(order):
            now = time.perf_counter()
            share = (began + options.budget - now) * shares[done] / sum(shares[done:])
            patience.until = now + max(share, LEAST_SECONDS)
            rows[k] = []
            for part, row in found[k].rows(patience):
                rows[k].append(row)
                so_far = (sum(shares[:done]) + part * shares[done]) / sum(shares)
                report(OF_REFERENCE + (1.0 - OF_REFERENCE) * so_far)
                with interrupt.raised():
                    pass  # raises if an interrupt was requested
        report(1.0)

    complete = interrupt.cut(solve)
    every = [row for k in sorted(rows) for row in rows[k]]
    for cost in COSTS:
        best = set(front(every, cost, reference.floor))
        for k, row in enumerate(every):
            row[f"front_{cost}"] = k in best
    settings, first = case.settings, head(case.model)
    return {
        **first,
        "versions": first["versions"] | {"scipy": version("scipy")},
        "machine": machine(),
        "date": today(),
        "start": settings.start,
        "end": settings.end,
        "output_step": settings.output_step,
        "complete": complete,
        "budget": {"seconds": options.budget, "spent": time.perf_counter() - began},
        "reference": reference.record(),
        "curves": [
            {
                "method": solver.method,
                "formulation": solver.formulation,
                "compile_seconds": solver.compile_seconds,
            }
            for solver in (found[k].solver for k in sorted(rows))
        ],
        "refused": refused,
        "rows": every,
    }


def read_document(path: str) -> Document:
    """Read a work_precision.json.

    Raises
    ------
    InputError
        If the file cannot be read, or lacks a key that charts need.
    """
    try:
        found = orjson.loads(content_of(path))
    except OSError as error:
        why = f"{path} cannot be read: {error.strerror}"
        raise unusable(UNREADABLE, why) from None
    except ValueError as error:
        raise unusable(NOT_JSON, f"{path}: {error}") from None
    missing = [key for key in NEEDED if not isinstance(found, dict) or key not in found]
    if missing:
        why = (
            f"{path} is not a document of `lagsim bench`, or an older one: "
            f"`{missing[0]}` is missing"
        )
        hint = "measure again: lagsim bench MODEL"
        raise unusable(NOT_A_BENCH, why, hint=hint)
    return dict(found)
