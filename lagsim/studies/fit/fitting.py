"""Least squares: values of names with which the runs of a model explain data.

Residuals are counted in standard deviations of the measurement. Where none is given, a
column has the noise that remains after a first fit. The Jacobian consists of
`lagsim.studies.sensitivities`; its singular values show which names the data determine.

Source: Y. Bard, Nonlinear Parameter Estimation (1974), chapters 7, 10; for robust
losses P. J. Huber, Robust Statistics (1981), section 7.6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.codes.known import (
    BAD_DATA,
    CHANGES_NOTHING,
    NOT_DIFFERENTIABLE,
    NOT_IDENTIFIABLE,
    RESIDUAL_PATTERN,
    USAGE,
)
from lagsim.errors import (
    InputError,
    LagsimError,
    Problem,
    Problems,
    counted,
    unusable,
)
from lagsim.notes import Caution
from lagsim.studies.fit.data import TIME, check_span, columns_of, matched
from lagsim.studies.fit.estimate import (
    LINEAR,
    SPENT_ROWS,
    determined,
    estimated,
    next_step_length,
    robust_factor,
    undetermined,
)
from lagsim.studies.fit.names import (
    CLOCK,
    Varied,
    concerned,
    drawn_start,
    near_bounds,
    own_values,
    parse_names,
    start_within,
)
from lagsim.studies.fit.recordings import Recording, Setup, Task, Team
from lagsim.studies.fit.restarts import BEGUN, COMPARED, parts_of, patterned
from lagsim.studies.sensitivities import COMMON, RTOL, Sensitivities, difference_scale
from lagsim.studies.trial import INADMISSIBLE
from lagsim.studies.trials import Trials, Variant

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Model, Settings
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.fit.data import Record
    from lagsim.studies.fit.estimate import Estimate
    from lagsim.studies.sensitivities import Derivative

    Progress = Callable[[float], None] | None

# Outcomes.
CONVERGED, SPENT, INTERRUPTED = "converged", "no convergence", "interrupted"
# Relative changes of cost and of values at which iterations end; most evaluations.
SAME_COST, SAME_VALUES, MOST = 1e-10, 1e-10, 200
# Most evaluations of a fit to a part of the records.
MOST_OF_PART = 30
# Options of derivatives before the solution: differences of lower order, with steps
# that need no search; and at the solution.
ROUGH: dict[str, Any] = {"order": 4, "first": 1e-4, "spare": 8}
ACCURATE: dict[str, Any] = {}
# Size of the remaining Newton step, relative to the residuals and to the data, below
# which the fit has converged.
LEFT, LEFT_OF_DATA = 0.05, 1e-9
# Relative change of the data by a name below which the name has no effect.
NO_CHANGE = 1e-9
# Ratio of the standard deviation of normal values to the median of their sizes.
OF_MEDIAN = 1.4826
# Probability of an interval.
LIKELY = 0.95
# Most fits with the noise of the last one, and relative change that ends them.
ROUNDS, SAME_NOISE = 6, 0.02
# Seed of further starts.
SEED = 11
# Part of the time of the data to which steps of the clock are relative.
OF_SPAN = 0.05
# Most minimisations that bring undetermined combinations back to their start, and the
# distance from it, relative to the names, that ends them.
RETURNS, RETURNED = 8, 1e-5


class StoppedError(Exception):
    """Signal that an interrupt has ended an iteration."""


# --- The fit


def _least(results: Sequence[tuple[Floats, float, bool]]) -> tuple[Floats, float, bool]:
    """Return the result of least cost, of tuples (values, cost, convergence)."""
    return min(results, key=lambda one: one[1])


class Jacobian(NamedTuple):
    """Derivatives of residuals by varied names, in units of column / scale of the name.

    Attributes
    ----------
    J : ndarray, shape (n, p)
        The derivatives; 0 in rows that are not differentiable by one of the names.
    lost : dict of str to int
        The number of such rows by name.
    error : float
        Relative error of the derivatives.
    """

    J: Floats
    lost: dict[str, int]
    error: float


@dataclass
class Found:
    """Result of a fit.

    Attributes
    ----------
    x : ndarray, shape (p,)
        Values of the names.
    raw : ndarray, shape (n,)
        Model less data, in the units of the columns.
    noise : ndarray, shape (m,)
        Standard deviation of each column, given or estimated.
    outcome : str
        Whether the fit converged, or why it ended.
    estimate : Estimate or None
        The uncertainties; None after an interrupt.
    bounded : dict of str to str
        Names at a bound: label -> `lower` or `upper`.
    starts, reached : int
        Number of starts, and of starts that led to `x`.
    cautions : list of Caution
    """

    x: Floats
    raw: Floats
    noise: Floats
    outcome: str
    estimate: Estimate | None = None
    bounded: dict[str, str] = field(default_factory=dict)
    starts: int = 1
    reached: int = 1
    cautions: list[Caution] = field(default_factory=list)


class Fit:
    """Fit of a model to records.

    Parameters
    ----------
    model : Model
    records : sequence of Record
    vary : sequence of str
        Names with bounds, see `names.parse_names`.
    match : mapping of str to str, optional
        Expressions by columns, see `data.matched`.
    loss : str
        One of LOSSES.
    own : mapping of str to str, optional
        Values of one record alone, by `NAME@K`.
    options : mapping of str to str, optional
        Options of the runs, such as `duration`.
    jobs : int or None
        The number of processes; None for one on each core, where that saves time.
    interrupt : Interrupt, optional
        Requests of an early end.

    Attributes
    ----------
    names : list of Varied
    matches : list of Match
    runs, iterations : int
        Numbers of runs, and of Jacobians.

    Raises
    ------
    InputError
        If data, a name or an expression cannot be used.
    StartError
        If the start of the file is not admissible.
    """

    def __init__(
        self,
        model: Model,
        records: Sequence[Record],
        vary: Sequence[str],
        match: Mapping[str, str] | None = None,
        loss: str = LINEAR,
        *,
        own: Mapping[str, str] | None = None,
        options: Mapping[str, str] | None = None,
        jobs: int | None = None,
        interrupt: Interrupt | None = None,
    ) -> None:
        self.given, self.records, self.loss = model, records, loss
        self.interrupt, self.runs, self.iterations = interrupt, 0, 0
        # Options of the derivatives in iterations.
        self.how = ROUGH
        self._progress: Progress = None
        self._team = Team(jobs)
        self.own = own_values(model, own or {}, len(records))
        names = parse_names(vary, self.own)
        self.model, self.matches = matched(model, records, match or {})
        self._arrange()
        trials = Trials(self.model, options, "fit")
        session = trials.session(Variant({}, {"rtol": RTOL}))
        self.settings: Settings = session.case.settings
        self.setup = Setup(
            self.model, trials, tuple(columns_of(self.model)), session.plan.method,
            (self.settings.start, self.settings.end),
            clocked=CLOCK not in model.parameter_values,
        )  # fmt: skip
        self.names = self._started(names)
        self.scales = np.array([one.scale for one in self.names])
        self.start = np.array([one.start for one in self.names])
        # Runs at the last values, and their derivatives by accuracy.
        self._known: tuple[bytes, list[Recording]] = (b"", [])
        self._jacobians: dict[int, Jacobian] = {}
        self._best = math.inf, self.start, self.data * np.nan

    def _arrange(self) -> None:
        """Set `data` (n,), all measurements of all records, and their columns."""
        data: list[Floats] = []
        columns: list[Any] = []
        elapsed: list[Floats] = []
        numbers: list[Any] = []
        self.measured: list[Flags] = []
        for record in self.records:
            gaps = np.full(len(record.times), np.nan)
            own = [record.columns.get(x.column, gaps) for x in self.matches]
            cells = np.column_stack(own)
            measured = np.isfinite(cells)
            self.measured.append(measured)
            data.append(cells[measured])
            rows, own_columns = np.nonzero(measured)
            columns.append(own_columns)
            elapsed.append((record.times - record.times[0])[rows])
            numbers.append(np.full(len(rows), len(numbers)))
        self.data = np.concatenate(data)
        # For each measurement: the numbers of its match and record, the time since the
        # begin of the record, and whether the fit includes it now.
        self.of = np.concatenate(columns)
        self.number = np.concatenate(numbers)
        self.elapsed = np.concatenate(elapsed)
        self.counts = np.ones(len(self.data), dtype=bool)

    def _started(self, names: Sequence[Varied]) -> list[Varied]:
        """Return the varied names with start values, scales, and bounds of t0."""
        start = np.array([self.settings.start])
        free = [
            Recording(self.setup, own, start, columns=())
            for own in (self.own if any(self.own) else self.own[:1])
        ]
        found, faults = list[Varied](), Problems()
        for one in names:
            with faults.gathered():
                first = concerned(one, names, self.own)[0]
                found.append(self._begun(one, names, free[first % len(free)]))
        faults.refuse()
        clocks = [self.setup.clock(own) for own in self.own]
        for one in found:
            if self.is_clock(one):
                for k in concerned(one, found, self.own):
                    clocks[k] = one.start
        check_span(self.records, clocks, self.settings)
        if self.model.constraints:
            known = {*free[0].start()}
            others = known - {x.name for x in found} - {x for k in self.own for x in k}
            guesses = self._following(free[0], found, others)
            self.setup = self.setup._replace(guesses=guesses)
        return found

    def is_clock(self, one: Varied) -> bool:
        """Whether a varied name is t0, the difference of the clocks of data and run."""
        return self.setup.clocked and one.name == CLOCK

    def _begun(
        self, one: Varied, names: Sequence[Varied], free: Sensitivities
    ) -> Varied:
        if self.is_clock(one):
            times = [self.records[k].times for k in concerned(one, names, self.own)]
            low = max(float(t[-1]) for t in times) - self.settings.end
            high = min(float(t[0]) for t in times) - self.settings.start
            one = one._replace(low=max(low, one.low), high=min(high, one.high))
            span = max(float(np.ptp(t)) for t in times)
            value, scale = free.values.get(CLOCK, 0.0), OF_SPAN * (span or 1.0)
            if not one.low < one.high:
                span_text = f"{self.settings.start:g} to {self.settings.end:g}"
                text = f"{one.label} cannot vary: the data take all of the run, "
                text += f"t = {span_text}"
                hint = "make the run longer, or leave out rows at the ends of the data"
                raise unusable(USAGE, text, hint=hint)
        else:
            value = free.value_of(one.name)
            scale = difference_scale(self.model, one.name, value)
        if not one.low < value < one.high:
            value = start_within(one.low, one.high, value)
        return one._replace(start=value, scale=scale)

    def _following(
        self, free: Sensitivities, names: Sequence[Varied], others: Collection[str]
    ) -> tuple[str, ...]:
        """Return the start values that constraints change with a varied name.

        These are all of `others` if a small change of a varied name makes the start
        inadmissible; else ().

        free : runs of the model, by which changes are tried.
        names : the varied names.
        others : all start values that are not varied.
        """
        for one in names:
            if self.is_clock(one):
                continue
            steps = (1e-3 * one.scale, -1e-3 * one.scale)
            base = free.value_of(one.name)
            ends = [free.trial(one.name, base + h, False).outcome for h in steps]
            if INADMISSIBLE in ends:
                return tuple(sorted(others))
        return ()

    def unused(self, record: Record) -> list[str]:
        """Return the columns of a record that are not compared with the model."""
        used = {TIME, *(x.column for x in self.matches)}
        return [x for x in record.columns if x not in used]

    # Residuals and their derivatives

    def at(self, x: Floats) -> list[Recording]:
        """Return the runs of all records with the varied names at x (p,).

        The runs at the last x are stored. Raises a LagsimError if a run cannot begin.
        """
        key = x.tobytes()
        if key != self._known[0]:
            made = [self._recording(k, x) for k in range(len(self.records))]
            self._known, self._jacobians = (key, made), {}
        return self._known[1]

    def _values(self, number: int, x: Floats) -> dict[str, float]:
        """Return the values of the names that apply to one record, by name.

        number : the number of the record, from 0.
        x : (p,), the values of all varied names.
        """
        values = dict(self.own[number])
        for one, value in zip(self.names, x.tolist(), strict=True):
            if number in concerned(one, self.names, self.own):
                values[one.name] = value
        return values

    def _recording(
        self, number: int, x: Floats, times: Floats | None = None
    ) -> Recording:
        self.runs += 1
        at = self.records[number].times if times is None else times
        values = self._values(number, x)
        return Recording(self.setup, values, at, interrupt=self.interrupt)

    def _raise_if_interrupted(self) -> None:
        if self.interrupt is not None and self.interrupt.requested:
            raise StoppedError

    def raw(self, x: Floats) -> Floats:
        """Return model less data (n,) in the units of the columns, at x (p,)."""
        runs = self.at(x)
        self._raise_if_interrupted()
        rows = [
            run.rows(run.centre)[measured]
            for run, measured in zip(runs, self.measured, strict=True)
        ]
        return np.asarray(np.concatenate(rows) - self.data)

    def jacobian(self, x: Floats, how: dict[str, Any]) -> Jacobian:
        """Return the derivatives of the residuals by the varied names, at x (p,).

        how : ROUGH or ACCURATE, sets of options of `Sensitivities.by`.
        """
        runs, key = self.at(x), len(how)
        if key not in self._jacobians:
            tasks = [
                Task(self.setup, run.values, run.times, run.centre, one, how, k)
                for k, run in enumerate(runs)
                for one in self.names
                if k in concerned(one, self.names, self.own)
            ]
            found = self._team.derivatives(tasks, runs, self.interrupt)
            self._raise_if_interrupted()
            self._jacobians[key] = self._arranged(tasks, found)
        return self._jacobians[key]

    def _arranged(self, tasks: Sequence[Task], found: Sequence[Derivative]) -> Jacobian:
        """Return the Jacobian of all residuals, composed of the derivatives of tasks.

        found : the derivatives of each of `tasks`: of one record by one name.
        """
        lost: dict[str, int] = {}
        sizes = [int(np.count_nonzero(measured)) for measured in self.measured]
        ends = np.cumsum(sizes).tolist()
        J = np.zeros((len(self.data), len(self.names)))
        for task, one in zip(tasks, found, strict=True):
            k, name = task.number, task.name
            self.runs += one.runs
            rows = slice(ends[k] - sizes[k], ends[k])
            J[rows, self.names.index(name)] = one.values[self.measured[k]] * name.scale
            if one.lost.any():
                count = int(np.count_nonzero(one.lost))
                lost[name.label] = lost.get(name.label, 0) + count
        J[~np.all(np.isfinite(J), axis=1)] = 0.0
        return Jacobian(J, lost, max(one.error for one in found))

    def _cost(self, x: Floats, weights: Floats) -> Floats:
        """Return the residuals at x (p,) in standard deviations, shape (n,).

        Least squares minimise these. They are inf if a run cannot begin or ends early.

        weights : (m,), the inverse standard deviation of each column.
        """
        try:
            raw = self.raw(x)
        except LagsimError:
            return np.full(len(self.data), np.inf)
        if not np.all(np.isfinite(raw)):
            return np.full(len(self.data), np.inf)
        r = raw * self._per_row(weights)
        size = float(r @ r)
        if size < self._best[0] and self.counts.all():
            self._best = size, x, raw
        return np.asarray(r)

    def _per_row(self, weights: Floats) -> Floats:
        """Return the weight of each measurement, shape (n,): the weight of its column.

        It is 0 for measurements that do not count.

        weights : (m,), by columns.
        """
        return np.where(self.counts, weights[self.of], 0.0)

    def _solve(
        self, x: Floats, weights: Floats, loss: str
    ) -> tuple[Floats, float, bool]:
        """Minimise the cost from x (p,); return values, cost, and whether it converged.

        Combinations of names that the data do not determine keep the values of the
        start: their changes are added to the residuals. This is repeated until the
        combinations are those that are undetermined at the solution.

        weights : (m,), the inverse standard deviation of each column.
        loss : one of LOSSES.
        """
        undetermined = self._undetermined(x, weights)
        for _ in range(RETURNS):
            x, cost, ended = self._minimised(x, weights, loss, undetermined)
            last, undetermined = undetermined, self._undetermined(x, weights)
            away = np.abs(undetermined @ ((x - self.start) / self.scales))
            if len(undetermined) == len(last) and np.all(away <= RETURNED):
                break
        return x, cost, ended

    def _undetermined(self, x: Floats, weights: Floats) -> Floats:
        """Return the combinations of names that are undetermined at x, (d, p).

        They are orthonormal, in multiples of the scales of the names.

        weights : (m,), weights of the columns.
        """
        J, _, error = self.jacobian(x, self.how)
        return undetermined(J * self._per_row(weights)[:, None], error)

    def _minimised(
        self, x: Floats, weights: Floats, loss: str, fixed: Floats
    ) -> tuple[Floats, float, bool]:
        """Minimise the cost from x (p,), with some combinations of names held.

        The changes of the combinations `fixed` (d, p) are added to the residuals. The
        other arguments and the result are as in `_solve`.
        """
        from scipy.optimize import least_squares  # slow to load

        s, begin = self.scales, self.start / self.scales
        J = self.jacobian(x, self.how).J * self._per_row(weights)[:, None]
        rows = fixed * (math.sqrt(float(np.mean(np.sum(J**2, axis=0)))) or 1.0)

        def residuals(z: Floats) -> Floats:
            return np.append(self._cost(z * s, weights), rows @ (z - begin))

        def jacobian(z: Floats) -> Floats:
            self.iterations += 1
            if self._progress is not None:
                self._progress(1.0 - 0.85**self.iterations)
            J = self.jacobian(z * s, self.how).J
            return np.vstack([determined(J * self._per_row(weights)[:, None]), rows])

        # A part of a record may determine so few names that values diverge.
        whole = bool(self.counts.all())
        ends = [(x.low, x.high) if whole else near_bounds(x) for x in self.names]
        found = least_squares(
            residuals, x / s, jacobian, np.array(ends).T / s, x_scale="jac",
            loss=loss, ftol=SAME_COST, xtol=SAME_VALUES, gtol=None,
            max_nfev=MOST if whole else MOST_OF_PART,
        )  # fmt: skip
        return np.asarray(found.x * s), float(found.cost), found.status > 0

    # The study

    def found(self, starts: int = 0, progress: Progress = None) -> Found:
        """Return the result of the fit.

        Parameters
        ----------
        starts : int
            Number of starts in addition to the start of the file.
        progress : callable, optional
            Called with the fraction that is done.

        Raises
        ------
        InputError
            If a run ends before the data, or a name changes no column.
        """
        self._progress = progress
        x = self.start
        given = np.array([match.deviation for match in self.matches])
        noise = np.where(given > 0.0, given, self._sizes())
        with self._team:
            try:
                self._check_first(x)
                x, reached, tried, ended = self._from_all(x, 1.0 / noise, starts)
                x, noise, ended = self._again(x, noise, given, ended=ended)
                x, ended = self._polished(x, 1.0 / noise, ended=ended)
                return self._result(x, noise, given, ended, (tried, reached))
            except StoppedError:
                _, x, raw = self._best
                return Found(x, raw, noise, INTERRUPTED)

    def _again(
        self, x: Floats, noise: Floats, given: Floats, *, ended: bool
    ) -> tuple[Floats, Floats, bool]:
        """Fit again with the noise that remained; return values, noise and convergence.

        Where standard deviations are not given, the first fit had only a guess of the
        noise of each column. A linear fit is repeated once, a fit with a robust loss
        until the noise settles, since outliers raise the noise of the linear fit
        before.

        Parameters
        ----------
        x : ndarray, shape (p,)
            Values of the first fit.
        noise, given : ndarray, shape (m,)
            Standard deviations used, and given (0 where not given).
        ended : bool
            Whether the first fit converged.
        """
        if np.all(given > 0.0) or (len(given) == 1 and self.loss == LINEAR):
            return x, noise, ended
        for _ in range(1 if self.loss == LINEAR else ROUNDS):
            estimate = self._estimate(x, noise, self._active(x), ROUGH)
            last, noise = noise, self._noise(self.raw(x), estimate, given)
            if np.all(np.abs(noise - last) <= SAME_NOISE * noise):
                break
            self._best = math.inf, *self._best[1:]
            x, _, ended = self._solve(x, 1.0 / noise, self.loss)
        return x, noise, ended

    def _polished(
        self, x: Floats, weights: Floats, *, ended: bool
    ) -> tuple[Floats, bool]:
        """Fit again with accurate derivatives if rough derivatives have misled the fit.

        Parameters
        ----------
        x : ndarray, shape (p,)
            Values of the fit.
        weights : ndarray, shape (m,)
            The inverse standard deviation of each column.
        ended : bool
            Whether the fit converged.

        Returns
        -------
        x : ndarray, shape (p,)
        ended : bool
            Whether the last fit converged.
        """
        per_row = self._per_row(weights)
        r = self.raw(x) * per_row
        free = [one.label not in self._active(x) for one in self.names]
        J = self.jacobian(x, ACCURATE).J * per_row[:, None]
        left = next_step_length(J[:, free], r, self.loss)
        size = float(np.linalg.norm(r)) / math.sqrt(len(r))
        if left <= max(
            LEFT * size, LEFT_OF_DATA * float(np.linalg.norm(self.data * per_row))
        ):
            return x, ended
        self.how = ACCURATE
        x, _, ended = self._solve(x, weights, self.loss)
        return x, ended

    def _sizes(self) -> Floats:
        """Return the standard deviation of the data of each column, shape (m,).

        It is a first guess of the noise; for constant data their absolute value, or 1.
        """
        sizes = []
        for k in range(len(self.matches)):
            own = self.data[self.of == k]
            spread = float(np.std(own)) if len(own) else 0.0
            sizes.append(spread or float(np.max(np.abs(own), initial=0.0)) or 1.0)
        return np.array(sizes)

    def _check_first(self, x: Floats) -> None:
        """Raise an InputError if a run at x (p,) ends early or a name has no effect."""
        raw = self.raw(x)
        if not np.all(np.isfinite(raw)):
            self._refuse_early()
        J, lost, _ = self.jacobian(x, ROUGH)
        sizes = np.array([
            float(np.max(np.abs((raw + self.data)[self.of == k]), initial=0.0)) or 1.0
            for k in range(len(self.matches))
        ])  # fmt: skip
        change = np.max(np.abs(J) / sizes[self.of][:, None], axis=0, initial=0.0)
        faults = Problems()
        for one, largest in zip(self.names, change.tolist(), strict=True):
            if largest <= NO_CHANGE and one.label not in lost:
                text = f"`{one.label}` changes no column of the data"
                faults.add(CHANGES_NOTHING, text)
        faults.refuse()

    def _refuse_early(self) -> None:
        """Raise an InputError that names the first rows that runs do not reach."""
        faults = []
        for record, run in zip(self.records, self._known[1], strict=True):
            missing = ~np.all(np.isfinite(run.rows(run.centre)), axis=1)
            for row in np.flatnonzero(missing)[:1].tolist():
                text = f"the run has no values at t = {record.times[row]:g}: it ends "
                text += f"at t = {run.centre.end:g} ({run.centre.outcome})"
                if run.centre.reason:
                    text += f": {run.centre.reason}"
                faults.append(Problem(BAD_DATA, text, record.place(row, TIME)))
        raise InputError(faults)

    def _from_all(
        self, x: Floats, weights: Floats, starts: int
    ) -> tuple[Floats, int, int, bool]:
        """Fit from x (p,) and from `starts` random starts; return the best fit.

        Where the residuals of the least cost follow a pattern, other starts are tried.

        weights : (m,), the inverse standard deviation of each column.

        Returns
        -------
        x : ndarray, shape (p,)
            The values of least cost.
        reached, tried : int
            The number of starts that led to these values, and of all starts.
        ended : bool
            Whether the fit with these values converged.
        """
        loss = self.loss if all(x.deviation for x in self.matches) else LINEAR
        results = [self._solve(x, weights, loss)]
        random = np.random.default_rng(SEED)
        for _ in range(starts):
            other = self._drawn(random)
            if np.all(np.isfinite(self._cost(other, weights))):
                try:
                    results.append(self._solve(other, weights, loss))
                except LagsimError:
                    continue
        if self._patterns(_least(results)[0]):
            for begin in self._restarts(weights, loss):
                try:
                    results.append(self._solve(begin, weights, loss))
                except LagsimError:
                    continue
                if not self._patterns(_least(results)[0]):
                    break
        best = _least(results)
        same = [
            one for one in results
            if np.all(np.abs(one[0] - best[0]) <= 1e-4 * self.scales)
        ]  # fmt: skip
        return best[0], len(same), len(results), best[2]

    def _drawn(self, random: np.random.Generator) -> Floats:
        """Return random start values of the varied names, shape (p,).

        random : the generator.
        """
        return np.array([drawn_start(one, random) for one in self.names])

    def _restarts(self, weights: Floats, loss: str) -> Iterator[Floats]:
        """Yield values (p,) from which a fit may leave a local minimum.

        The first values are the result of fits to growing parts of the records; the
        random starts of least cost follow.

        weights : (m,), the inverse standard deviation of each column.
        loss : one of LOSSES.
        """
        x = self.start
        for counts in parts_of(self.elapsed, 2 * len(self.names) + 2):
            self.counts = counts
            try:
                x = self._solve(x, weights, loss)[0]
            except LagsimError:
                continue
            finally:
                self.counts = np.ones(len(self.data), dtype=bool)
        yield x
        random = np.random.default_rng(SEED)
        drawn = [self._drawn(random) for _ in range(COMPARED)]
        costs = [float(np.sum(self._cost(one, weights) ** 2)) for one in drawn]
        for k in np.argsort(costs)[:BEGUN].tolist():
            if math.isfinite(costs[k]):
                yield drawn[k]

    def _patterns(self, x: Floats) -> list[str]:
        """Return the columns whose residuals at x (p,) follow a pattern."""
        raw, records = self.raw(x), range(len(self.records))
        return [
            match.column for k, match in enumerate(self.matches)
            if patterned(
                raw, self.data, ((self.of == k) & (self.number == j) for j in records)
            )
        ]  # fmt: skip

    def _noise(self, raw: Floats, estimate: Estimate, given: Floats) -> Floats:
        """Return the standard deviation of each column (m,), given or estimated.

        raw : residuals (n,), each of which counts with 1 less its leverage as degrees
            of freedom; a robust loss uses the median of |residual|.
        given : (m,), 0 where not given.
        """
        found = given.copy()
        for k in np.flatnonzero(given == 0.0):
            own = self.of == k
            if not own.any():
                found[k] = 1.0
                continue
            # In addition to the rounding errors of the runs.
            least = COMMON * float(np.max(np.abs(self.data[own]))) or COMMON
            spread = math.sqrt(float(np.mean(raw[own] ** 2)))
            if self.loss != LINEAR:
                spread = OF_MEDIAN * float(np.median(np.abs(raw[own])))
            free = float(np.sum(1.0 - estimate.leverages[own]))
            count = float(np.count_nonzero(own))
            found[k] = max(spread * math.sqrt(count / max(free, SPENT_ROWS)), least)
        return found

    def _active(self, x: Floats) -> dict[str, str]:
        """Return the names at a bound at x (p,): label -> `lower` or `upper`."""
        found = {}
        for one, value in zip(self.names, x.tolist(), strict=True):
            close = 1e-8 * one.scale
            if value - one.low <= close:
                found[one.label] = "lower"
            elif one.high - value <= close:
                found[one.label] = "upper"
        return found

    def _estimate(
        self, x: Floats, noise: Floats, active: Collection[str], how: dict[str, Any]
    ) -> Estimate:
        """Return the uncertainties at x (p,).

        noise : (m,), standard deviations of the columns.
        active : names at a bound.
        how : see `jacobian`.
        """
        J, _, error = self.jacobian(x, how)
        return estimated(J / noise[self.of][:, None], x, self.names, active, error)

    def _result(
        self, x: Floats, noise: Floats, given: Floats, ended: bool,
        starts: tuple[int, int],
    ) -> Found:  # fmt: skip
        """Return the result at x (p,), with uncertainties from accurate derivatives.

        Parameters
        ----------
        noise, given : ndarray, shape (m,)
            Standard deviations used, and given (0 where not given).
        ended : bool
            Whether the fit converged.
        starts : tuple of int
            Number of starts, and the number of starts that led to these values.
        """
        raw, active = self.raw(x), self._active(x)
        found = self._estimate(x, noise, active, ACCURATE)
        if not np.all(given > 0.0):
            noise = self._noise(raw, found, given)
            found = self._estimate(x, noise, active, ACCURATE)
        if self.loss != LINEAR:
            r = raw / noise[self.of]
            factor = robust_factor(
                r, self.loss, len(r) - float(np.sum(found.leverages))
            )
            found = found._replace(covariance=found.covariance * factor)
        outcome = CONVERGED if ended else SPENT
        cautions = [
            Caution(
                NOT_DIFFERENTIABLE,
                f"the motion is not differentiable by `{name}` in "
                f"{counted(count, 'row')} of the data: these count in the residuals, "
                "not in the standard errors",
            )
            for name, count in self.jacobian(x, ACCURATE).lost.items()
        ]
        for one in found.combinations:
            parts = ", ".join(f"{name} by {part:+.3g}" for name, part in one.items())
            text = f"the data do not determine {' and '.join(one)}: relative changes "
            text += f"in the ratio of {parts} leave all columns as they are"
            cautions.append(Caution(NOT_IDENTIFIABLE, text))
        for column in self._patterns(x):
            text = f"successive residuals of `{column}` are correlated: the model does "
            text += f"not explain the data with these values, to which {starts[1]} of "
            text += f"{counted(starts[0], 'start')} lead"
            cautions.append(Caution(RESIDUAL_PATTERN, text))
        if self._progress is not None:
            self._progress(1.0)
        return Found(x, raw, noise, outcome, found, active, *starts, cautions)

    def of_file(self, found: Found) -> dict[str, float]:
        """Return the fitted values for the model file.

        Of start values that each record has of its own, those of the first record are
        used.
        """
        values = self._values(0, found.x)
        if self.setup.clocked:
            values.pop(CLOCK, None)
        return values

    def curve(self, x: Floats, number: int, count: int) -> tuple[Floats, Floats]:
        """Return the fitted model as a curve over the times of a record.

        Parameters
        ----------
        x : ndarray, shape (p,)
            Values of the names.
        number : int
            Number of the record, from 0.
        count : int
            Number of points k.

        Returns
        -------
        times : ndarray, shape (k,)
            On the clock of the record.
        columns : ndarray, shape (k, m)
        """
        times = self.records[number].times
        dense = np.linspace(times[0], times[-1], count)
        run = self._recording(number, x, dense)
        return dense, run.rows(run.centre)
