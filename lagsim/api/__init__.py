"""Public Python interface (`import lagsim`), one file for each task."""

from __future__ import annotations

import gc
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from enum import Enum
from textwrap import fill, indent
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar

import numpy as np

from lagsim.errors import InputError, Place, Problem, unusable
from lagsim.methods import WIDTH, options

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.methods import generalized_alpha


# --- Arguments and their faults in Python's words: `step=0`, not `--step 0`


class Settings(TypedDict, total=False):
    """The keys of `simulation` that `simulate` and `sweep` take."""

    duration: float | str | None
    output_step: float | str | None
    method: str | None
    rtol: float | str | None
    atol: float | str | None
    step: float | str | None
    formulation: str | None
    gain: float | str | None


if TYPE_CHECKING:

    class Options(Settings, generalized_alpha.Options, total=False):
        """Settings and the options of methods, for type checkers."""


E = TypeVar("E", bound=Enum)
F = TypeVar("F", bound=Callable[..., Any])
_OPTION = re.compile(r"--([a-z-]+) ")


@contextmanager
def uncollected() -> Iterator[None]:
    """Look for no garbage: a graph is many objects and none, see `cli.entry`."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextmanager
def in_python() -> Iterator[None]:
    """Let faults name the arguments that they are in as Python does."""
    try:
        with uncollected():
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


def with_settings(function: F) -> F:
    """Show the settings that `options` stands for, in signature and docstring.

    Those of methods come from their tables.
    """
    own = inspect.signature(function)
    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None)
        for name in settings()
    ]
    shown = own.replace(parameters=[*list(own.parameters.values())[:-1], *more])
    function.__signature__ = shown  # type: ignore[attr-defined]
    about = ""
    for key, (name, x) in options().items():
        text = f"Of the method `{name}`, {x.least:g} to {x.most:g}: {x.about}."
        about += f"\n{key}\n{indent(fill(text, WIDTH - 4), '    ')}"
    before, gain, after = inspect.cleandoc(function.__doc__ or "").partition(
        "\nerror_bar\n"
    )
    function.__doc__ = before + about * bool(gain) + gain + after
    return function


def settings() -> list[str]:
    """Return the keys of `simulation` that functions take."""
    return [*Settings.__annotations__, *options()]


def given(options: Mapping[str, Any]) -> dict[str, float | str]:
    """Return the options that are not None.

    Raises
    ------
    TypeError
        Where one is not known, or neither a number nor a text.
    """
    found = {name: x for name, x in options.items() if x is not None}
    known = settings()
    for name, value in found.items():
        if name not in known:
            raise TypeError(f"unexpected keyword argument {name!r}")
        if name in ("method", "formulation") and not isinstance(value, str):
            raise TypeError(f"{name}={value!r:.60}: a name is expected, in quotes")
        number_or_text(name, value)
    return found


def number_or_text(name: str, value: object) -> None:
    """See that a value is a number, or an expression.

    Raises
    ------
    TypeError
    ValueError
        If it is an integer too large for a double.
    """
    given = None if isinstance(value, (bool, np.bool_)) else value
    try:
        isinstance(value, str) or float(given)  # type: ignore[arg-type]
    except OverflowError:
        raise ValueError(f"{name}: the largest number is about 1.8e308") from None
    except (TypeError, ValueError):
        text = f"{name}={value!r:.60}: a number is expected, or an expression in quotes"
        raise TypeError(text) from None


def numbers(name: str, value: object) -> Floats:
    """Return a number, or numbers in lists or arrays, as an array.

    Raises
    ------
    TypeError
    """
    try:
        found = np.asarray(value)
        if found.dtype.kind in "iufO" and None not in found.ravel().tolist():
            return found.astype(float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise TypeError(f"{name}={value!r:.60}: a number is expected, or numbers")


def one_of(name: str, value: str, known: type[E]) -> E:
    """Return the member that a word denotes.

    Raises
    ------
    ValueError
    """
    words = [member.value for member in known]
    if value not in words:
        expected = ", ".join(map(repr, words))
        raise ValueError(f"{name}={value!r:.60}: one of {expected} is expected")
    return known(value)


def lists(values: Mapping[str, object]) -> dict[str, list[float | str]]:
    """Return the values to sweep, each a list of numbers and texts.

    Raises
    ------
    TypeError, InputError
    """
    found: dict[str, list[float | str]] = {}
    if not isinstance(values, Mapping):
        text = "names with lists of values are expected, such as {'l': [1, 2]}"
        raise TypeError(f"values={values!r:.60}: {text}")
    for name, several in values.items():
        if not isinstance(name, str):
            raise TypeError(f"values: {name!r:.60}: a name is expected, in quotes")
        if isinstance(several, str) or not isinstance(several, Iterable):
            text = f"{name}: {several!r:.60}: a list of values is expected"
            raise TypeError(text)
        found[name] = list(several)
        if not found[name]:
            hint = "a list with one value or more is expected"
            raise unusable("usage", f"{name} has no values", hint=hint)
        for value in found[name]:
            number_or_text(name, value)
    return found
