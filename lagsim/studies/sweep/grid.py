"""The grid of a sweep: names with their values, and all combinations of these."""

from __future__ import annotations

import difflib
import math
import re
from typing import TYPE_CHECKING, NamedTuple

from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from lagsim.model.model import Model

# More runs than this are refused.
MOST_RUNS = 10**6
# A comma that separates values, not arguments of a function.
_COMMA = re.compile(r",(?![^()]*\))")
_NUMBER = re.compile(r"-?\d+\.?\d*(e[-+]?\d{1,2})?", re.ASCII)
_WORD = re.compile(r"\w+")
EXAMPLE = "such as K=10:40:7 (from, to, how many) or K=10,20,40"
# The other columns of sweep.csv that have no dot in their names.
OUTCOME, COMPLETE, ERROR, REASON = "outcome", "complete", "error", "reason"


class Axis(NamedTuple):
    """A name that is swept.

    Attributes
    ----------
    starts : bool
        It is an entry of `initial`, not a parameter.
    texts : tuple of str
        Its values, as expressions.
    values : tuple of float
        The same as numbers, where all else is as in the file.
    """

    name: str
    starts: bool
    texts: tuple[str, ...]
    values: tuple[float, ...]
    unit: str = ""

    @classmethod
    def of(cls, model: Model, name: str, texts: Sequence[str]) -> Axis:
        """Give the axis of a name of `model`.

        Raises
        ------
        InputError
        """
        starts = name not in {p.name for p in model.parameters}
        unit = next((p.unit for p in model.parameters if p.name == name), "")
        if starts:
            _check_start(model, name)
            units = {c.name: c.unit for c in model.coordinates}
            units |= {d.name: d.unit for d in model.definitions}
            base = name.removesuffix("_dot")
            unit = units.get(name) or (f"{u}/s" if (u := units.get(base, "")) else "")
        values: list[float] = []
        for text in texts:
            # The first one shows that the name can be bound.
            x = _plain(text) if values else None
            if x is None:
                x = value_of(bound(model, {name: text}), name)
            values.append(x)
        return cls(name, starts, tuple(texts), tuple(values), unit)

    def says(self, names: Collection[str]) -> bool:
        """Tell whether a value is an expression of any of these names."""
        return any(not set(_WORD.findall(x)).isdisjoint(names) for x in self.texts)


class Grid(NamedTuple):
    """All combinations of the values of axes; the first axis is the slowest."""

    axes: tuple[Axis, ...]

    @property
    def runs(self) -> int:
        """The number of combinations."""
        return math.prod(len(axis.texts) for axis in self.axes)

    def at(self, number: int) -> list[int]:
        """Give which value each axis has in a run."""
        places = []
        for axis in reversed(self.axes):
            number, place = divmod(number, len(axis.texts))
            places.append(place)
        return places[::-1]

    def texts(self, number: int) -> dict[str, str]:
        """Give the value of each name in a run."""
        places = zip(self.axes, self.at(number), strict=True)
        return {axis.name: axis.texts[place] for axis, place in places}

    def values(self, number: int) -> list[float]:
        """Give the same as numbers, where all else is as in the file."""
        places = zip(self.axes, self.at(number), strict=True)
        return [axis.values[place] for axis, place in places]


def bound(model: Model, texts: Mapping[str, str]) -> Model:
    """Give the model with these parameters, and start values."""
    known = {p.name for p in model.parameters}
    own = {name: text for name, text in texts.items() if name in known}
    return model.bind(own, {k: text for k, text in texts.items() if k not in known})


def value_of(model: Model, name: str) -> float:
    """Give the value of a parameter, or the start value, of that name."""
    values = {x.name: x.value for x in model.initial}
    values |= {p.name: p.value for p in model.parameters}
    return values.get(name, math.nan)


def grid_of(model: Model, given: Mapping[str, Iterable[float | str]]) -> Grid:
    """Give the grid of names and values.

    Raises
    ------
    InputError
    """
    problems: list[Problem] = []
    axes = []
    for name, values in given.items():
        texts = [x if isinstance(x, str) else repr(float(x)) for x in values]
        try:
            axes.append(Axis.of(model, name, texts))
        except InputError as error:
            problems += error.problems
        if not texts:
            problems.append(Problem("usage", f"{name} has no values", hint=EXAMPLE))
        if name in (OUTCOME, COMPLETE, ERROR, REASON):
            text = f"`{name}` cannot be swept: sweep.csv has a column of that name"
            problems.append(Problem("usage", text, hint="give it another name"))
    grid = Grid(tuple(axes))
    if not problems and grid.runs > MOST_RUNS:
        problems.append(_too_many(grid.runs))
    if problems:
        raise InputError(problems)
    return grid


def _too_many(runs: int) -> Problem:
    text = f"these are {runs} runs, more than {MOST_RUNS}"
    return Problem("usage", text, hint="sweep them in parts")


def parsed(model: Model, arguments: Iterable[str]) -> Grid:
    """Give the grid of arguments `name=a:b:n` and `name=v1,v2,...`.

    Raises
    ------
    InputError
    """
    given: dict[str, list[str]] = {}
    problems = []
    for argument in arguments:
        name, equals, values = (part.strip() for part in argument.partition("="))
        if not (name and equals and values):
            text = f"{argument}: a name and its values are expected"
            problems.append(Problem("usage", text, hint=EXAMPLE))
        elif name in given:
            problems.append(Problem("usage", f"{name} is given twice"))
        else:
            try:
                given[name] = _values(model, name, values)
            except InputError as error:
                problems += error.problems
    if problems:
        raise InputError(problems)
    return grid_of(model, given)


def _values(model: Model, name: str, text: str) -> list[str]:
    """Take the values of a name apart."""
    if ":" not in text:
        return [part.strip() for part in _COMMA.split(text)]
    first, _, rest = text.partition(":")
    last, _, many = rest.rpartition(":")
    if not (many.strip().isdecimal() and int(many) >= 2 and last and ":" not in last):
        found = f"{name}={text}: two ends and how many values, 2 or more, are expected"
        raise InputError([Problem("usage", found, hint=EXAMPLE)])
    if int(many) > MOST_RUNS:
        raise InputError([_too_many(int(many))])
    a, b = Axis.of(model, name, (first, last)).values
    return [repr(x) for x in between(a, b, int(many))]


def between(a: float, b: float, count: int) -> list[float]:
    """Give `count` numbers from a to b: of round ends they are round."""
    steps = count - 1
    return [*((a + (b - a) * k / steps) for k in range(steps)), b]


def _plain(text: str) -> float | None:
    """Give the number that a text is, if it is nothing else."""
    return float(text) if _NUMBER.fullmatch(text) else None


def _check_start(model: Model, name: str) -> None:
    moving = [c.name for c in model.coordinates] + [d.name for d in model.definitions]
    known = [*moving, *(f"{q}_dot" for q in moving), *(x.name for x in model.initial)]
    if name in known:
        return
    near = difflib.get_close_matches(
        name, [*(p.name for p in model.parameters), *known], 1
    )
    names = ", ".join(p.name for p in model.parameters) or "none"
    hint = f"did you mean `{near[0]}`?" if near else f"its parameters are {names}"
    text = f"`{name}` is no parameter of {model.name}, and has no start value"
    raise InputError([Problem("unknown-name", text, hint=hint)])
