"""Arguments and their faults in Python's words: `step=0`, not `--step 0`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from lagsim.errors import InputError, Place, Problem

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


T = TypeVar("T")
_OPTION = re.compile(r"--([a-z-]+) ")


@contextmanager
def in_python() -> Iterator[None]:
    """Let faults name the arguments that they are in as Python does."""
    try:
        yield
    except InputError as error:
        raise InputError(map(_renamed, error.problems)) from None


def _renamed(problem: Problem) -> Problem:
    place = problem.place
    found = _OPTION.match(place.file) if place else None
    if place is None or found is None:
        return problem
    # `--set k=2` gives a name of the model, `--step 2` an argument of ours.
    name = "" if found[1] == "set" else f"{found[1].replace('-', '_')}="
    moved = len(name) - found.end()
    file, source = (name + x[found.end() :] for x in (place.file, place.source))
    new = Place(file, place.line, place.column + moved, place.length, source)
    return problem._replace(place=new)


def given(**options: float | str | None) -> dict[str, float | str]:
    """Give the options that are not None.

    Raises
    ------
    TypeError
        Where one is neither a number nor a text.
    """
    found = {name: x for name, x in options.items() if x is not None}
    for name, value in found.items():
        if name in ("method", "formulation") and not isinstance(value, str):
            raise TypeError(f"{name}={value!r:.60}: a name is expected, in quotes")
        number_or_text(name, value)
    return found


def number_or_text(name: str, value: object) -> None:
    """See that a value is a number, or an expression.

    Raises
    ------
    TypeError
    """
    try:
        isinstance(value, str) or float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        text = f"{name}={value!r:.60}: a number is expected, or an expression in quotes"
        raise TypeError(text) from None


def one_of(name: str, value: str, known: Sequence[str]) -> str:
    """Give a word that must be one of some.

    Raises
    ------
    ValueError
    """
    if value not in known:
        words = ", ".join(map(repr, known))
        raise ValueError(f"{name}={value!r:.60}: one of {words} is expected")
    return value


def lists(values: Mapping[str, object]) -> dict[str, list[float | str]]:
    """Give the values to sweep, each a list of numbers and texts.

    Raises
    ------
    TypeError, InputError
    """
    found: dict[str, list[float | str]] = {}
    for name, several in values.items():
        if isinstance(several, str) or not isinstance(several, Iterable):
            text = f"{name}: {several!r:.60}: a list of values is expected"
            raise TypeError(text)
        found[name] = list(several)
        if not found[name]:
            hint = "a list with one value or more is expected"
            raise InputError([Problem("usage", f"{name} has no values", hint=hint)])
        for value in found[name]:
            number_or_text(name, value)
    return found
