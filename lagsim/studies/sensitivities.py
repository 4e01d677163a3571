"""Derivatives of columns by parameters and start values, from differences of runs.

A derivative is a central difference of order 8 of runs at a relative tolerance of
1e-13; where values on one side cannot be used (a restitution above 1, a coefficient of
friction below 0) it is one-sided, of order 6. Differences of lower orders of the same
runs estimate the error and select the step. Rows at which the orders differ are not
differentiable: an event crosses the time of the row, or the sequence of events changes.
Runs with constraints, switches, impacts and friction have derivatives like others, and
no equations of their own are derived.

Examples
--------
The amplitude of an oscillator enters its motion linearly:

>>> from lagsim.model.reader import read
>>> model = read('''
... parameters: {k: 4}
... coordinates: {x: {}}
... energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
... initial: {x: 1}
... simulation: {duration: 1}
... ''', "<model>")
>>> study = Sensitivities(model, times=np.array([0.25, 0.5, 1.0]), columns=("x",))
>>> found = study.by("x")
>>> np.allclose(found.values[:, 0], np.cos(2.0 * study.times), rtol=0, atol=1e-11)
True
>>> found.runs, found.error < 1e-9
(8, True)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.codes.known import FAILED, NOT_DIFFERENTIABLE, UNKNOWN_NAME
from lagsim.errors import InputError, LagsimError, Problem, counted, did_you_mean
from lagsim.language.columns import DEVIATION, SENSITIVITY
from lagsim.language.names import rate_of
from lagsim.notes import Caution
from lagsim.run.observers.appended import Appended
from lagsim.studies.trial import INADMISSIBLE, UNUSABLE
from lagsim.studies.trials import Trials, Variant
from lagsim.tolerances import SAME_INSTANT, SAME_STEP

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Model, Settings
    from lagsim.notes import Event
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.trial import Trial

# Relative tolerance of the runs.
RTOL = 1e-13
# First step, relative to the scale of the name, and the factor between steps.
FIRST, FACTOR = 1e-3, 3.0
# Relative error at which the step of a derivative is accepted.
ENOUGH = 1e-10
# Difference of two orders, relative to the largest value of a derivative, above which a
# row is not differentiable, by the highest order. Low orders are for rough derivatives,
# and have a truncation error if the step changes the phase of the motion much.
MOST_APART = {8: 1e-6, 4: 1e-2}
# Rows that are not differentiable at the best step are computed again at a step smaller
# by FACTOR**NEAR, by differences of order NEAR_ORDER at most. There the difference of
# two orders may be larger: where only the second derivative jumps (a knot of a linear
# table of a parameter), it is in proportion to the step.
NEAR, NEAR_ORDER, NEAR_APART = -4, 6, 1e-4
# The error of order 6 at a jump of the second derivative, in differences of orders 6
# and 4: 9 where the jump is at the value itself.
NEAR_ERROR = 12.0
# Number of runs of the first step, of each further one at most, and of all steps of a
# name on average.
FIRST_RUNS, MORE_RUNS, MOST_RUNS = 8, 6, 14
# Weights of (f(jh) - f(-jh))/(2h), j = 1, 2, ..., by order.
CENTRAL = {
    8: (8 / 5, -2 / 5, 8 / 105, -1 / 140),
    6: (3 / 2, -3 / 10, 1 / 30),
    4: (4 / 3, -1 / 6),
    2: (1.0,),
}
# Weights of f(jh)/h, j = 0, 1, ..., by order.
ONE_SIDED = {
    6: (-49 / 20, 6.0, -15 / 2, 20 / 3, -15 / 4, 6 / 5, -1 / 6),
    5: (-137 / 60, 5.0, -5.0, 10 / 3, -5 / 4, 1 / 5),
    4: (-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4),
    3: (-11 / 6, 3.0, -3 / 2, 1 / 3),
}
# The rounding error of a difference relative to its deviation from the next lower
# order: the ratio of the norms of their weights. Where the differences of three
# successive orders do not fall by like factors, the last one is rounding.
ROUNDING, FALLS = 12.0, 1.5
# Differences that are rounding alone deviate from the next lower order by more than
# this part of their size: 0.09 times, by the norms of the weights.
NOISE = 0.01
# Factor by which a motion may amplify rounding errors that are to be recognised, and
# the ratio of deviations of successive orders above which these are rounding: 0.7 and
# 0.6 by the norms of the weights.
AMPLIFIED, SLOWLY = 100.0, 0.3
# Relative error that all runs have in common, which no difference of them shows.
COMMON = 10.0 * RTOL


class Derivative(NamedTuple):
    """Derivatives of columns by one name.

    Attributes
    ----------
    name : str
        The parameter or start value.
    values : ndarray, shape (k, columns)
        The derivatives, in the unit of the column divided by the unit of the name; nan
        in rows that are not differentiable, or that a run does not reach.
    lost : ndarray of bool, shape (k,)
        Rows that are not differentiable.
    step : float
        The step of the differences, in the unit of the name.
    error : float
        Estimated error, the largest over rows, relative to the largest value of each
        column.
    runs : int
        Number of runs.
    """

    name: str
    values: Floats
    lost: Flags
    step: float
    error: float
    runs: int


class _Difference(NamedTuple):
    """Derivatives by differences of highest order at one step, with their errors.

    Attributes
    ----------
    values : ndarray, shape (k, columns)
        The derivatives; nan in rows marked in `lost`.
    best : ndarray, shape (k, columns)
        The differences of the highest order in all rows.
    lost : ndarray of bool, shape (k,)
        Rows that are not differentiable.
    apart : ndarray, shape (k, columns)
        Differences of the two highest orders.
    unsure : ndarray of bool, shape (k, columns)
        Cells at which these differ by more than a differentiable motion does.
    truncation, rounding : ndarray, shape (columns,)
        Errors of each column, relative to its largest value.
    """

    values: Floats
    best: Floats
    lost: Flags
    apart: Floats
    unsure: Flags
    # By column, relative: errors by truncation and by rounding.
    truncation: Floats
    rounding: Floats

    @property
    def error(self) -> float:
        """The largest error of a column."""
        return COMMON + float(np.max(self.truncation + self.rounding, initial=0.0))

    @property
    def score(self) -> tuple[int, float]:
        """The number of rows not differentiable, then the error; less is better."""
        return int(np.count_nonzero(self.lost)), self.error


@dataclass
class _Runs:
    """Runs at values of a name that differ by multiples of a step, each computed once.

    Attributes
    ----------
    study : Sensitivities
        Makes the runs.
    name : str
    value : float
        The value of the name in the file.
    unit : float
        The first step.
    solved : bool
        See `Sensitivities.trial`.
    order : int
        The order of central differences.
    known : dict of (int, int) to Trial
        Runs by their offset: (j, power) for j steps of size unit*FACTOR**power.
    """

    study: Sensitivities
    name: str
    value: float
    unit: float
    solved: bool = False
    order: int = 8
    known: dict[tuple[int, int], Trial] = field(default_factory=dict)

    def trial(self, j: int, power: int) -> Trial:
        """Return the run at j steps of size unit*FACTOR**power from the value."""
        while j and j % int(FACTOR) == 0:
            j, power = j // int(FACTOR), power + 1
        key = (j, power) if j else (0, 0)
        if j == 0:
            return self.study.centre
        if key not in self.known:
            shift = j * self.unit * FACTOR**power
            self.known[key] = self.study.trial(
                self.name, self.value + shift, self.solved
            )
        return self.known[key]

    def rows(self, offsets: Sequence[int], power: int) -> Floats:
        """Return the rows of the runs at several offsets, shape (offsets, k, columns).

        offsets : numbers of steps.
        power : the exponent of FACTOR in the step, see `trial`.
        """
        return np.array([self.study.rows(self.trial(j, power)) for j in offsets])

    def usable(self, side: int) -> bool:
        """Whether runs can begin at the nearest and the farthest offset on a side.

        side : 1 above the value, or -1 below.
        """
        found = [self.trial(side * j, 0) for j in (self.order // 2, 1)]
        return all(x.outcome not in (INADMISSIBLE, UNUSABLE) for x in found)


def _judged(
    estimates: Sequence[Floats], rows: Sequence[Floats], step: float, apart_at: float
) -> _Difference:
    """Return the derivatives of the highest order, with errors by comparison of orders.

    Parameters
    ----------
    estimates : sequence of ndarray, shape (k, columns)
        The derivatives by differences of two to four orders, the highest first.
    rows : sequence of ndarray, shape (k, columns)
        The rows of all runs.
    step : float
        The step of the differences.
    apart_at : float
        Rows at which two orders differ by more than this part of the scale are not
        differentiable.
    """
    best = estimates[0]
    with np.errstate(invalid="ignore", over="ignore"):
        differences = [np.abs(x - y) for x, y in pairwise(estimates)]
        first, second, third = (*differences, differences[-1], differences[-1])[:3]
        missing = ~np.all(np.isfinite(best), axis=1)
        # Rounding of the runs, in columns that do not depend on the name at all, too.
        floor = COMMON * np.nanmax(np.abs(rows), axis=(0, 1), initial=0.0) / abs(step)
        lost, scale = missing.copy(), floor
        while True:
            kept = ~lost
            scale = np.max(np.abs(best[kept]), axis=0, initial=0.0)
            large = first > apart_at * scale + floor
            more = kept & np.any(large, axis=1)
            if not more.any():
                break
            lost |= more
    e1, e2, e3 = (np.max(x[kept], axis=0, initial=0.0) for x in (first, second, third))
    falls = np.minimum(1.0, np.divide(e2, e3, out=np.ones_like(e2), where=e3 > 0.0))
    beyond = np.maximum(0.0, e1 - FALLS * e2 * falls)
    # Differences that are rounding have no meaningful relative error. A motion with
    # many impacts amplifies the rounding; differences of two orders then decrease
    # slowly.
    slow = (e1 > SLOWLY * e2) & (e2 > SLOWLY * e3)
    noise = (scale <= floor) | (slow & (scale <= AMPLIFIED * floor))
    size = np.where(noise & (e1 >= NOISE * scale), np.inf, scale)
    values = np.where(lost[:, np.newaxis], np.nan, best)
    errors = e1 * falls / size, ROUNDING * beyond / size
    unsure = large | ~np.isfinite(best)
    return _Difference(values, best, lost, first, unsure, *errors)


class Sensitivities:
    """Derivatives of a run of a model by names, at given times.

    Parameters
    ----------
    model : Model
    options : mapping of str to float or str, optional
        Options of the run.
    times : ndarray, shape (k,)
        Times of the rows.
    columns : sequence of str, optional
        Columns of the rows to differentiate, by default the coordinates, their rates,
        first-order states and definitions of the table.
    values : mapping of str to float, optional
        Values of names that differ from the file.
    guesses : collection of str
        Start values that follow as the constraints require.
    trials : Trials, optional
        Runs of the model, by default new ones.
    method : str
        The method of all runs; by default that of the run itself.
    caller : str
        The name of the command, for messages.
    centre : Trial, optional
        The run itself, if it is known.
    interrupt : Interrupt, optional
        Requests of an early end.
    """

    def __init__(
        self,
        model: Model,
        options: Mapping[str, float | str] | None = None,
        *,
        times: Floats,
        columns: Sequence[str] | None = None,
        values: Mapping[str, float] | None = None,
        guesses: Collection[str] = (),
        trials: Trials | None = None,
        method: str = "",
        caller: str = "run",
        centre: Trial | None = None,
        interrupt: Interrupt | None = None,
    ) -> None:
        self.model, self.times, self.interrupt = model, times, interrupt
        self.trials = trials or Trials(model, options, caller)
        self.values, self.guesses = dict(values or {}), guesses
        self.settings: dict[str, Any] = {"rtol": RTOL}
        if method:
            self.settings["method"] = method
        self.columns = tuple(columns if columns is not None else motion_columns(model))
        self.centre = centre or self.trials.run(self._variant({}))
        if not self.centre.columns:
            raise InputError([Problem(self.centre.code or FAILED, self.centre.reason)])
        # All runs have the method of the run itself, which `auto` selects once.
        if not method:
            plan = self.trials.session(self._variant({})).plan
            self.settings["method"] = plan.method
        self._which = [self.centre.columns.index(x) for x in self.columns]
        self._start: dict[str, float] | None = None

    def _variant(
        self, values: Mapping[str, float], guesses: Collection[str] = ()
    ) -> Variant:
        at, guessed = {**self.values, **values}, guesses or self.guesses
        return Variant(at, self.settings, self.times, guessed)

    def rows(self, trial: Trial) -> Floats:
        """Return the columns to differentiate of a run, shape (k, columns).

        All are nan for a run that could not begin.
        """
        if not trial.columns:
            return np.full((len(self.times), len(self.columns)), np.nan)
        return np.asarray(trial.rows[:, self._which])

    def start(self) -> dict[str, float]:
        """Return the solved start: positions, rates and first-order states by name."""
        if self._start is None:
            case = self.trials.session(self._variant({})).case
            state, equations = case.start, case.equations
            solved = np.concatenate([state.q, state.v, state.s]).tolist()
            self._start = dict(zip(equations.state, solved, strict=True))
        return self._start

    def trial(self, name: str, value: float, solved: bool) -> Trial:
        """Return the run in which the parameter or start value `name` is `value`.

        Parameters
        ----------
        solved : bool
            Whether all start values but `name` are guesses, which follow as the
            constraints require.
        """
        variant = self._variant({name: value})
        if solved:
            at, guesses = {**self.start(), name: value}, {*self.start()} - {name}
            variant = self._variant(at, guesses)
        return self.trials.run(variant, interrupt=self.interrupt)

    def by(
        self,
        name: str,
        *,
        scale: float | None = None,
        first: float = FIRST,
        spare: int = MOST_RUNS,
        order: int = 8,
    ) -> Derivative:
        """Return the derivatives of all columns by a parameter or start value.

        Parameters
        ----------
        scale : float, optional
            Size of the name to which steps are relative, by default `difference_scale`.
        first : float
            The first step relative to the scale.
        spare : int
            Number of runs beyond which no further step is tried.
        order : int
            Order of central differences, 8 or 4; the latter need half of the runs.

        Raises
        ------
        InputError
            If the name is unknown, or constraints determine it.
        """
        search = self._first_search(name, scale, first, order)
        while search.open and search.count + MORE_RUNS <= spare:
            search.improve()
        return search.derivative()

    def by_each(
        self, names: Sequence[str], progress: Callable[[float], None] | None = None
    ) -> list[Derivative]:
        """Return the derivatives of the rows by each name.

        There are MOST_RUNS runs for a name on average: runs that a name does not need
        serve the name with the largest error. After an interrupt the derivatives by
        some of the names are left out.

        progress : called with the fraction that is done.
        """
        most = MOST_RUNS * len(names) - 1  # in addition to the run itself
        searches = list[_StepSearch]()
        for name in names:
            if self._stopped():
                break
            searches.append(self._first_search(name))
            if self._stopped():
                searches.pop()
            elif progress is not None:
                progress(sum(one.count for one in searches) / most)
        while (
            (unfinished := [one for one in searches if one.open])
            and sum(one.count for one in searches) + MORE_RUNS <= most
            and not self._stopped()
        ):
            max(unfinished, key=lambda one: one.found.score).improve()
            if progress is not None:
                progress(sum(one.count for one in searches) / most)
        return [one.derivative() for one in searches]

    def _stopped(self) -> bool:
        return self.interrupt is not None and self.interrupt.requested

    def _first_search(
        self, name: str, scale: float | None = None, first: float = FIRST,
        order: int = 8,
    ) -> _StepSearch:  # fmt: skip
        """Return a search for the step size of differences by a name, after first runs.

        Arguments : see `by`.
        """
        value = self.value_of(name)
        size = scale if scale is not None else difference_scale(self.model, name, value)
        runs = _Runs(self, name, value, first * size, order=order)
        sides = runs.usable(1), runs.usable(-1)
        if not any(sides) and self._determined(runs):
            runs = _Runs(self, name, value, first * size, True, order)
            sides = runs.usable(1), runs.usable(-1)
        if not any(sides):
            raise _not_free(name, runs.trial(1, 0))
        return _StepSearch(runs, sides)

    @property
    def reached(self) -> Flags:
        """Return a mask (k,) of the rows that the run itself reaches."""
        return np.asarray(np.all(np.isfinite(self.rows(self.centre)), axis=1))

    def _determined(self, runs: _Runs) -> bool:
        """Whether a change of the name of `runs` makes the start inadmissible.

        Constraints then determine the name from other start values.
        """
        return any(runs.trial(j, 0).outcome == INADMISSIBLE for j in (1, -1))

    def value_of(self, name: str) -> float:
        """Return the value of a parameter or start value.

        Raises
        ------
        InputError
            If the model has no such name.
        """
        known = self.model.parameter_values
        if name in self.values:
            return self.values[name]
        if name in known:
            return known[name]
        if name in (start := self.start()):
            return start[name]
        text = f"there is no parameter or start value `{name}`"
        hint = did_you_mean(name, [*known, *start])
        raise InputError([Problem(UNKNOWN_NAME, text, hint=hint)])


class _StepSearch:
    """Search for the step with which the differences by a name have the least error.

    Parameters
    ----------
    runs : _Runs
    sides : tuple of bool
        Whether runs above, and below, the value of the name can be used.

    Attributes
    ----------
    found : _Difference
        The best difference so far.
    """

    def __init__(self, runs: _Runs, sides: tuple[bool, bool]) -> None:
        self.runs, self.sides = runs, sides
        self.found, self._power = _difference(runs, sides, 0), 0
        # Steps are divided by FACTOR as long as this helps, then multiplied by it.
        self._left = [-1, 1]

    @property
    def count(self) -> int:
        """The number of runs made so far."""
        return len(self.runs.known)

    @property
    def open(self) -> bool:
        """Whether a further step is to be tried: its error may be smaller."""
        found = self.found
        wanted = -1 if found.lost.any() or _truncated(found) else 1
        while self._left and self._left[0] != wanted:
            self._left.pop(0)
        return bool(self._left) and found.score > (0, ENOUGH)

    def improve(self) -> None:
        """Try the next step of the difference; keep the result if its error is less."""
        power = self._power + self._left[0]
        other = _difference(self.runs, self.sides, power)
        if other.score >= self.found.score:
            self._left.pop(0)
        else:
            self.found, self._power = other, power

    def derivative(self) -> Derivative:
        """Return the derivatives from the best difference so far, with step and error.

        Rows that are not differentiable are computed again at a far smaller step.
        Rows that the run does not reach are nan in `values`, and False in `lost`.
        """
        runs = self.runs
        if np.any(self.found.lost & runs.study.reached):
            near = _difference(runs, self.sides, self._power + NEAR, NEAR_ORDER)
            self.found = _filled(self.found, near)
        found = self.found
        return Derivative(
            runs.name, found.values, found.lost & runs.study.reached,
            runs.unit * FACTOR**self._power, found.error, self.count,
        )  # fmt: skip


def _truncated(found: _Difference) -> bool:
    return bool(np.max(found.truncation) > np.max(found.rounding))


def _filled(found: _Difference, near: _Difference) -> _Difference:
    """Return a difference, with the rows that it lacks from one at a smaller step."""
    unsure = found.unsure & found.lost[:, np.newaxis]
    lost = found.lost & np.any(unsure & near.unsure, axis=1)
    new = unsure & ~lost[:, np.newaxis]
    if not new.any():
        return found
    values = np.where(new, near.best, found.best)
    values[lost] = np.nan
    size = np.max(np.abs(values[~lost]), axis=0)
    error = NEAR_ERROR * np.max(np.where(new, near.apart, 0.0), axis=0)
    relative = np.divide(error, size, out=np.zeros_like(size), where=size > 0.0)
    worst = np.maximum(found.truncation, relative)
    return found._replace(values=values, lost=lost, truncation=worst)


def _difference(
    runs: _Runs, sides: tuple[bool, bool], power: int, most: int = 8
) -> _Difference:
    """Return the derivatives by differences of the step unit * FACTOR**power.

    Central differences, or differences on the side that can be used, of order 6 at
    most.

    Parameters
    ----------
    sides : tuple of bool
        Whether runs above, and below, can be used.
    most : int
        The highest order of central differences.
    """
    order = min(most, runs.order)
    apart_at = max(MOST_APART[runs.order], NEAR_APART * (power <= NEAR))
    if all(sides):
        return _central(runs, power, order, apart_at)
    return _aside(runs, power, sides, apart_at)


def _central(runs: _Runs, power: int, most: int, apart_at: float) -> _Difference:
    """Return the derivatives by central differences, step unit * FACTOR**power.

    most : the highest order.
    apart_at : see `_judged`.
    """
    h = runs.unit * FACTOR**power
    offsets = range(1, most // 2 + 1)
    above, below = (runs.rows([s * j for j in offsets], power) for s in (1, -1))
    odd = (above - below) / (2.0 * h)
    estimates = [
        np.tensordot(weights, odd[: order // 2], axes=1)
        for order, weights in CENTRAL.items()
        if order <= most
    ]
    return _judged(estimates, [*above, *below], h, apart_at)


def _aside(
    runs: _Runs, power: int, sides: tuple[bool, bool], apart_at: float
) -> _Difference:
    """Return the derivatives by differences on the side that can be used.

    The order is 6, or that of the central differences if lower.

    sides : whether runs above, and below, can be used.
    power : see `_Runs.trial`.
    apart_at : see `_judged`.
    """
    side = 1 if sides[0] else -1
    h = side * runs.unit * FACTOR**power
    used = {k: weights for k, weights in ONE_SIDED.items() if k <= runs.order}
    rows = runs.rows([side * j for j in range(max(used) + 1)], power)
    estimates = [
        np.tensordot(weights, rows[: order + 1], axes=1) / h
        for order, weights in used.items()
    ]
    return _judged(estimates, [*rows], h, apart_at)


def _not_free(name: str, trial: Trial) -> LagsimError:
    text = f"`{name}` cannot be varied: {trial.reason}"
    return InputError([Problem(trial.code or FAILED, text)])


def motion_columns(model: Model) -> list[str]:
    """Return the names of coordinates, rates, first-order states and definitions."""
    own = [x.name for x in model.coordinates]
    rates = [rate_of(x) for x in own]
    return [*own, *rates, *(x.name for x in model.states), *model.output.columns]


def difference_scale(model: Model, name: str, value: float) -> float:
    """Return the size of a parameter or start value, for the step of differences.

    It is the |value| or, for 0, the largest |value| of parameters and start values of
    the same unit, or 1.
    """
    if value:
        return abs(value)
    units = {p.name: p.unit for p in model.parameters}
    units |= {x.name: x.unit for x in model.coordinates}
    own: Callable[[str], str | None] = units.get
    values = model.parameter_values | {x.name: x.value for x in model.initial}
    others = [
        abs(x) for k, x in values.items() if own(k) is not None and own(k) == own(name)
    ]
    return max(others, default=0.0) or 1.0


# --- Columns of a run


def output_times(settings: Settings) -> Floats:
    """Return the output times of a run, and its end, shape (k,)."""
    s = settings
    count = int(np.floor(s.duration / s.output_step + SAME_STEP))
    times = s.start + s.output_step * np.arange(count + 1)
    return np.append(times[times < s.end], s.end)


def appended(
    model: Model,
    settings: Settings,
    names: Sequence[str],
    options: Mapping[str, float | str] | None = None,
    *,
    times: Floats | None = None,
    caller: str = "run",
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> Appended | None:
    """Return the columns of derivatives and standard deviations of a run.

    None if there is no such column: no names, and no parameter with an uncertainty.

    Parameters
    ----------
    settings : Settings
        Settings of the run.
    names : sequence of str
        Parameters and start values with columns `d.<column>.<name>`.
    options : mapping of str to float or str, optional
        Options that replace settings of the file.
    times : ndarray, shape (k,), optional
        Times of the values, by default the output times and the end of the run.
    caller : str
        The name of the command, for messages.
    progress : callable, optional
        Called with the part of the names that is done.

    Raises
    ------
    InputError
        If a name is unknown, or constraints determine it.
    """
    deviations = {p.name: p.uncertainty for p in model.parameters if p.uncertainty}
    varied = [*dict.fromkeys((*names, *deviations))]
    if not varied:
        return None
    times = output_times(settings) if times is None else times
    study = Sensitivities(
        model, options, times=times, caller=caller, interrupt=interrupt
    )
    square = np.zeros((len(times), len(study.columns)))
    blocks = {name: np.full_like(square, np.nan) for name in names}
    record, cautions, done = dict[str, dict[str, float]](), list[Caution](), 0
    for found in study.by_each(varied, progress):
        name = found.name
        square += (found.values * deviations.get(name, 0.0)) ** 2
        if name in blocks:
            blocks[name] = found.values
        record[name] = {"step": found.step, "error": found.error, "runs": found.runs}
        cautions += _not_differentiable(found, times)
        done += 1
    if progress is not None:
        progress(1.0)
    if done < len(varied):
        square[:] = np.nan
    heads = [f"{SENSITIVITY.prefix}{x}.{k}" for k in names for x in study.columns]
    columns = [*blocks.values()]
    if deviations:
        heads += [DEVIATION.of(x) for x in study.columns]
        columns.append(np.sqrt(square))
    values = np.hstack(columns)
    values[_at_impacts(study.centre.events, times, settings)] = np.nan
    return Appended((*heads,), settings, values, record, cautions)


def _at_impacts(events: Sequence[Event], times: Floats, settings: Settings) -> Flags:
    """Return a mask of the times (k,) of impacts, at which a state has two values.

    events : the events of the run.
    """
    struck = np.array([e.time for e in events if e.jumps])
    distances = np.abs(times[:, np.newaxis] - struck)
    within = SAME_STEP * settings.output_step + SAME_INSTANT * np.abs(struck)
    return np.asarray(np.any(distances <= within, axis=1))


def _not_differentiable(found: Derivative, times: Floats) -> list[Caution]:
    at = times[found.lost]
    if not len(at):
        return []
    rows = counted(len(at), "row")
    text = f"the motion is not differentiable by `{found.name}` in {rows}"
    span = f"at t = {at[0]:.6g}"
    if len(at) > 1:
        span = f"from t = {at[0]:.6g} to {at[-1]:.6g}"
    return [Caution(NOT_DIFFERENTIABLE, f"{text}, {span}: these cells are empty")]
