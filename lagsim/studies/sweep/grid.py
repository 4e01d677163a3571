"""Grid of a sweep: axes with their values, from arguments; and the rows of its runs."""

from __future__ import annotations

import math
import pickle
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.codes.known import UNKNOWN_NAME, USAGE
from lagsim.errors import Problems, did_you_mean, unusable
from lagsim.language.names import member_hint, rate_of, rated
from lagsim.model.reader.runs import FROM
from lagsim.studies.attempts import ErrorBars

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model

# More runs than this are refused.
MOST_RUNS = 10**6
# A comma that separates values, not arguments of a function.
_COMMA = re.compile(r",(?![^()]*\))")
_NUMBER = re.compile(r"-?\d+\.?\d*(e[-+]?\d{1,2})?", re.ASCII)
EXAMPLE = "such as K=10:40:7 (from, to, how many) or K=10,20,40"
# The other columns of sweep.csv that have no dot in their names.
OUTCOME, COMPLETE, ERROR, REASON = "outcome", "complete", "error", "reason"


class Axis(NamedTuple):
    """Swept name with its values.

    Attributes
    ----------
    name : str
    starts : bool
        Whether the name is an entry of `initial`, not a parameter.
    texts : tuple of str
        The values as expressions.
    values : tuple of float
        The values as numbers, with all other names as in the file.
    unit : str
    drawn : str
        The distribution from which the values were drawn, or "".
    """

    name: str
    starts: bool
    texts: tuple[str, ...]
    values: tuple[float, ...]
    unit: str = ""
    drawn: str = ""

    @classmethod
    def of(cls, model: Model, name: str, texts: Sequence[str]) -> Axis:
        """Return the axis of a name of `model`, with values by their expressions.

        texts : the expressions.

        Raises
        ------
        InputError
            If there is no such name, or a value cannot be used.
        """
        units = {p.name: p.unit for p in model.parameters}
        starts = name not in units
        unit = units.get(name, "")
        if starts:
            _check_start(model, name)
            units = {x.name: x.unit for x in (*model.variables, *model.definitions)}
            rated_unit = units.get(rated(name)[0])
            unit = units.get(name) or (f"{rated_unit}/s" if rated_unit else "")
        values: list[float] = []
        for text in texts:
            # The first one shows that the name can be bound.
            plain = values and _NUMBER.fullmatch(text)
            x = float(text) if plain else value_of(model.bind(**{name: text}), name)
            values.append(x)
        return cls(name, starts, tuple(texts), tuple(values), unit)


class Grid(NamedTuple):
    """Combinations of the values of axes; the first axis varies most slowly.

    Attributes
    ----------
    together : bool
        Whether run k has value k of every axis, in place of all combinations.
    seed : int or None
        The seed of a sample.
    """

    axes: tuple[Axis, ...]
    together: bool = False
    seed: int | None = None

    @property
    def runs(self) -> int:
        """The number of runs."""
        return self.shape[0] if self.together else math.prod(self.shape)

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values of each axis."""
        return tuple(len(axis.texts) for axis in self.axes)

    def at(self, numbers: Any) -> Iterator[tuple[Axis, Any]]:
        """Yield each axis with the index of its value in each of some runs.

        numbers : the index of a run, or an array of such indices.
        """
        places: Any = [numbers] * len(self.axes)
        if not self.together:
            places = np.unravel_index(numbers, self.shape)
        return zip(self.axes, places, strict=True)

    def texts(self, number: int) -> dict[str, str]:
        """Return the values of all names in the run with an index, as texts by name."""
        return {axis.name: axis.texts[place] for axis, place in self.at(number)}

    def values(self, number: int) -> tuple[float, ...]:
        """Return the values of all axes in the run with an index, as numbers."""
        return tuple(axis.values[place] for axis, place in self.at(number))


def value_of(model: Model, name: str) -> float:
    """Return the value of a parameter or the start value with a name."""
    values = {x.name: x.value for x in model.initial}
    values |= model.parameter_values
    return values.get(name, math.nan)


def grid_of(
    model: Model,
    given: Mapping[str, Iterable[float | str]],
    *,
    together: bool = False,
) -> Grid:
    """Return the grid of names and values, or points with `together`.

    given : values by name.
    together : whether run k has value k of every name, in place of all combinations.

    Raises
    ------
    InputError
        If a name or a value cannot be used, or the grid has too many runs.
    """
    problems = Problems()
    axes = []
    for name, values in given.items():
        texts = [x if isinstance(x, str) else repr(float(x)) for x in values]
        with problems.gathered():
            axes.append(Axis.of(model, name, texts))
        if not texts:
            problems.add(USAGE, f"{name} has no values", hint=EXAMPLE)
        if name in (OUTCOME, COMPLETE, ERROR, REASON):
            text = f"`{name}` cannot be swept: sweep.csv has a column of that name"
            problems.add(USAGE, text, hint="give it another name")
    problems.refuse()
    grid = Grid(tuple(axes), together)
    if together and len({*grid.shape}) > 1:
        text = f"the names have {', '.join(map(str, grid.shape))} values"
        hint = "points have as many values of each name"
        raise unusable(USAGE, text, hint=hint)
    refuse_many(grid.runs)
    return grid


def refuse_many(runs: int) -> None:
    """Raise an InputError for a sweep of more than MOST_RUNS runs."""
    if runs > MOST_RUNS:
        text = f"these are {runs} runs, more than {MOST_RUNS}"
        raise unusable(USAGE, text, hint="sweep them in parts")


def parse_axes(model: Model, arguments: Iterable[str]) -> Grid:
    """Parse arguments `name=a:b:n` and `name=v1,v2,...` into a grid.

    Raises
    ------
    InputError
        If an argument is malformed, or a name or a value cannot be used.
    """
    given: dict[str, list[str]] = {}
    problems = Problems()
    for argument in arguments:
        name, equals, values = (part.strip() for part in argument.partition("="))
        if not (name and equals and values):
            text = f"{argument}: a name and its values are expected"
            problems.add(USAGE, text, hint=EXAMPLE)
        elif name in given:
            problems.add(USAGE, f"{name} is given twice")
        else:
            with problems.gathered():
                given[name] = _values(model, name, values)
    problems.refuse()
    return grid_of(model, given)


def _values(model: Model, name: str, text: str) -> list[str]:
    """Parse the values of a swept name, `a:b:n` or `v1,v2,...`, into expressions."""
    if ":" not in text:
        return [part.strip() for part in _COMMA.split(text)]
    first, _, rest = text.partition(":")
    last, _, many = rest.rpartition(":")
    if not (many.strip().isdecimal() and int(many) >= 2 and last and ":" not in last):
        found = f"{name}={text}: two ends and how many values, 2 or more, are expected"
        raise unusable(USAGE, found, hint=EXAMPLE)
    refuse_many(int(many))
    a, b = Axis.of(model, name, (first, last)).values
    steps = int(many) - 1  # between round ends they are round
    return [repr(a + (b - a) * k / steps) for k in range(steps)] + [repr(b)]


def _check_start(model: Model, name: str) -> None:
    moving = [c.name for c in model.coordinates] + [d.name for d in model.definitions]
    known = [*moving, *map(rate_of, moving), *(x.name for x in model.initial)]
    if name not in known:
        parameters = [p.name for p in model.parameters]
        among = [*parameters, *known]
        hint = member_hint(name, among) or did_you_mean(name, among)
        hint = hint or f"its parameters are {', '.join(parameters) or 'none'}"
        text = f"`{name}` is no parameter of {model.name}, and has no start value"
        raise unusable(UNKNOWN_NAME, text, hint=hint)


NOTHING = np.empty((3, 0))
# Values of each column of a run, in the order of sweep.csv.
EXTREMES = ("end", "min", "max")
MEASURES = (*EXTREMES, "mean", "rms", "peak_to_peak")


class SweepInput(NamedTuple):
    """Input that all runs of a sweep share.

    Attributes
    ----------
    model : bytes
        The pickled Model.
    options : tuple of (str, str)
        Options of runs by name.
    grid : Grid
    error_bars : ErrorBars
    folder : str or None
        The folder in which each run has a folder; None if only rows are stored.
    plots : bool
        Whether pictures of the runs are drawn.
    ends : bool
        Whether only the last value of each column is requested.
    """

    model: bytes
    options: tuple[tuple[str, str], ...]
    grid: Grid
    error_bars: ErrorBars
    folder: str | None = None
    plots: bool = False
    ends: bool = False

    @property
    def parts(self) -> tuple[str, ...]:
        """The kinds of values that a row of the sweep has for each column.

        These are `end`, `min` and `max`; `end` alone with `ends`; with the option
        `from` also `mean`, `rms` and `peak_to_peak`.
        """
        if self.ends:
            return EXTREMES[:1]
        return MEASURES if FROM in dict(self.options) else EXTREMES


class SweepRow(NamedTuple):
    """Result of a run: a row of the sweep.

    Attributes
    ----------
    values : tuple of float
        The swept values of the run.
    outcome : str
    complete : bool
    error : float or None
        The estimated error, relative to the range of a coordinate.
    reason : str
        The reason of an incomplete run.
    numbers : ndarray, shape (parts, columns)
        Values of each column, one row for each of `SweepInput.parts`. There are no
        columns if the run could not begin.
    form : int
        A number shared by runs with equal compiled functions; 0 if there was no run.
    """

    values: tuple[float, ...]
    outcome: str
    complete: bool = False
    error: float | None = None
    reason: str = ""
    numbers: Floats = NOTHING
    form: int = 0


@dataclass(slots=True)
class SweepRows:
    """Sweep with the rows computed so far.

    Attributes
    ----------
    model : Model
    work : SweepInput
        The input of all runs.
    rows : dict of int to SweepRow
        Rows by the index of the run.
    columns : tuple of str
        Columns of the tables of the runs.
    units : dict of str to str
        Units of the columns, known after the first run.
    seconds : float
        The time of this session of the sweep.
    """

    model: Model
    work: SweepInput
    rows: dict[int, SweepRow] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0

    @classmethod
    def of(
        cls,
        model: Model,
        grid: Grid,
        options: Mapping[str, object],
        error_bars: ErrorBars,
        **more: Any,
    ) -> SweepRows:
        """Return a sweep without rows; the arguments are fields of `SweepInput`."""
        texts = tuple((name, str(x)) for name, x in options.items())
        work = SweepInput(pickle.dumps(model), texts, grid, error_bars, **more)
        return cls(
            model, work._replace(error_bars=ErrorBars.NEVER) if work.ends else work
        )

    @property
    def grid(self) -> Grid:
        """The grid of the sweep."""
        return self.work.grid

    @property
    def missing(self) -> list[int]:
        """The indices of the runs without a row."""
        return [k for k in range(self.grid.runs) if k not in self.rows]
