"""Public Python interface (`import lagsim`), one file for each task."""

from __future__ import annotations

import gc
import inspect
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from enum import Enum
from keyword import iskeyword
from textwrap import fill, indent
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar

import numpy as np

from lagsim.codes.known import USAGE
from lagsim.errors import InputError, Place, Problem, unusable
from lagsim.methods import WIDTH
from lagsim.model.reader.fields import OPTIONS, SIMULATION

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.methods import generalized_alpha
    from lagsim.studies.options import RangeOption


# --- Arguments, and their faults in the notation of Python: `step=0`, not `--step 0`


class SimulationKeys(TypedDict, total=False):
    """Keys of `simulation` in `OPTIONS` that are no options of methods, with types."""

    duration: float | str | None
    output_step: float | str | None
    method: str | None
    rtol: float | str | None
    atol: float | str | None
    step: float | str | None
    formulation: str | None
    gain: float | str | None


if TYPE_CHECKING:

    class SimulationOptions(SimulationKeys, generalized_alpha.Options, total=False):
        """`SimulationKeys` and the options of methods, for type checkers."""


E = TypeVar("E", bound=Enum)
F = TypeVar("F", bound=Callable[..., Any])
_OPTION = re.compile(r"--([a-z-]+) ")


@contextmanager
def uncollected() -> Iterator[None]:
    """Context manager: switch the cyclic garbage collector off, see `cli.entry`.

    A graph consists of many objects, of which none is garbage.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextmanager
def in_python() -> Iterator[None]:
    """Context manager: name arguments in an InputError as in Python (`step=0`).

    Messages of the command line name the option, `--step 0`.
    """
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
    # `--set k=2` sets a name of the model, `--step 2` an argument of a function here.
    word = found[1].replace("-", "_")
    name = "" if word == "set" else f"{word}{'_' * iskeyword(word)}="
    moved = len(name) - found.end()
    file, source = (name + x[found.end() :] for x in (place.file, place.source))
    new = Place(file, place.line, place.column + moved, place.length, source)
    return problem._replace(place=new)


def with_settings(
    keys: Iterable[str] = OPTIONS, before: str = "error_bar"
) -> Callable[[F], F]:
    """Return a decorator that documents the settings in `**options` of a function.

    The signature and the docstring of the function then list the settings with their
    descriptions in the schema of the model file.

    Parameters
    ----------
    keys : iterable of str
        The accepted keys of `simulation`.
    before : str
        The parameter that follows the settings in the docstring.
    """
    texts = {key: fill(SIMULATION[key]["description"], WIDTH - 4) for key in keys}
    about = "".join(f"\n{key}\n{indent(text, '    ')}" for key, text in texts.items())
    keyword = inspect.Parameter.KEYWORD_ONLY
    more = [inspect.Parameter(name, keyword, default=None) for name in texts]

    def decorated(function: F) -> F:
        own = inspect.signature(function)
        shown = own.replace(parameters=[*list(own.parameters.values())[:-1], *more])
        function.__signature__ = shown  # type: ignore[attr-defined]
        mark = f"\n{before}"
        head, _, after = inspect.cleandoc(function.__doc__ or "").partition(mark)
        function.__doc__ = head + about + mark + after
        return function

    return decorated


def given(
    options: Mapping[str, Any], keys: Collection[str] = OPTIONS
) -> dict[str, float | str]:
    """Return the options that are not None, after a check of their names and types.

    keys : the accepted names.

    Raises
    ------
    TypeError
        If the name of an option is unknown, or its value is neither a number nor a
        string.

    Examples
    --------
    >>> given({"rtol": 1e-9, "step": None, "duration": "2*pi"})
    {'rtol': 1e-09, 'duration': '2*pi'}
    """
    found = {name: x for name, x in options.items() if x is not None}
    for name, value in found.items():
        if name not in keys:
            raise TypeError(f"unexpected keyword argument {name!r}")
        if name in ("method", "formulation") and not isinstance(value, str):
            raise TypeError(f"{name}={value!r:.60}: a name is expected, in quotes")
        number_or_text(name, value)
    return found


def number_or_text(name: str, value: object) -> None:
    """Check that a value is a number or a string (an expression).

    Raises
    ------
    TypeError
        If the value is neither; the message begins with `name`.
    ValueError
        If the value is an integer too large for a double.
    """
    given = None if isinstance(value, (bool, np.bool_)) else value
    try:
        isinstance(value, str) or float(given)  # type: ignore[arg-type]
    except OverflowError:
        raise ValueError(f"{name}: the largest number is about 1.8e308") from None
    except (TypeError, ValueError):
        text = f"{name}={value!r:.60}: a number is expected, or an expression in quotes"
        raise TypeError(text) from None


def whole_number(name: str, value: object, least: int = 0) -> None:
    """Check that a value is a whole number, and at least `least`.

    Raises
    ------
    ValueError
        If it is not; the message begins with `name`.
    """
    if type(value) is not int or value < least:
        text = f"{name}={value!r:.60}: {least} or more is expected, a whole number"
        raise ValueError(text)


def number_range(
    name: str, value: Iterable[float | str], expected: RangeOption
) -> tuple[float, float]:
    """Return the smaller and the larger end of a range of numbers.

    name : the name of the argument.
    value : two numbers or texts of numbers.
    expected : the permitted ranges.

    Raises
    ------
    ValueError
        If the value is no such range; the message begins with `name`.

    Examples
    --------
    >>> from lagsim.studies.options import FREQUENCY_RANGE
    >>> number_range("frequencies", (10, 0.1), FREQUENCY_RANGE)
    (0.1, 10.0)
    """
    found = expected.ends(value)
    if found is None:
        raise ValueError(f"{name}={value!r:.60}: two {expected.values} are expected")
    return found


def float_array(name: str, value: object) -> Floats:
    """Return a number, nested lists of numbers or an array as an array of floats.

    Raises
    ------
    TypeError
        If an entry is not a number; the message begins with `name`.

    Examples
    --------
    >>> float_array("q", [[1, 2], [3, 4]])
    array([[1., 2.],
           [3., 4.]])
    """
    try:
        found = np.asarray(value)
        if found.dtype.kind in "iufO" and None not in found.ravel().tolist():
            return found.astype(float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise TypeError(f"{name}={value!r:.60}: a number is expected, or numbers")


def one_of(name: str, value: str, known: type[E]) -> E:
    """Return the member of the enumeration `known` whose value is `value`.

    Raises
    ------
    ValueError
        If there is no such member; the message begins with `name` and lists all values.
    """
    words = [member.value for member in known]
    if value not in words:
        expected = ", ".join(map(repr, words))
        raise ValueError(f"{name}={value!r:.60}: one of {expected} is expected")
    return known(value)


def lists(values: Mapping[str, object]) -> dict[str, list[float | str]]:
    """Return values to sweep as lists of numbers and strings, by name.

    Raises
    ------
    TypeError
        If `values` is no mapping of names to iterables of numbers and strings.
    InputError
        If the list of a name is empty.
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
            raise unusable(USAGE, f"{name} has no values", hint=hint)
        for value in found[name]:
            number_or_text(name, value)
    return found
