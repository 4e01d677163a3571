"""Table of all messages: number, expectation, advice and an example of each.

Messages find their numbers in it; `docs/errors.md` and `lagsim explain` are generated
from it. A number is never reused: where a message is retired, its number is, too.
"""

from __future__ import annotations

import functools
import re
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from lagsim.codes.known import ErrorCode

# The model of the examples; each example replaces some of its sections.
EXAMPLE = """\
name: pendulum
parameters: {m: 1, g: 9.81, l: 1}
coordinates: {theta: {unit: rad}}
definitions:
  x: l*sin(theta)
  y: -l*cos(theta)
energy: {kinetic: m*l^2*theta_dot^2/2, potential: m*g*y}
initial: {theta: 1}
simulation: {duration: 1}
"""
MODEL = "pendulum.yaml"

# A mass in a plane.
PLANE = """\
coordinates: {x: {unit: m}, y: {unit: m}}
definitions: {}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*g*y}
"""
# A rod that slides on a rough floor: Painlevé's paradox.
PAINLEVE = """\
parameters: {mu: 1.4, angle: atan(0.5)}
coordinates: {x: {}, y: {}, q: {}}
definitions: {end: x - sin(q)}
energy: {kinetic: (x_dot^2 + y_dot^2 + q_dot^2/3)/2, potential: 9.81*y}
constraints:
  tip: {relation: y >= cos(q), restitution: 0, friction: mu, slip: end_dot}
initial: {x: 0, y: cos(angle), q: angle, x_dot: -1}
"""
CHECK = (f"lagsim check {MODEL}",)


class MessageRow(NamedTuple):
    """Message: number, expectation, advice and example of a code.

    Attributes
    ----------
    number, code : str
        `E104`, and its word in documents. Neither ever changes.
    happened : str
        The fault found, or the event reported.
    expected : str
        Rule that an error breaks; empty for a warning.
    hint : str
        Advice, used where the message itself has no better hint.
    change : str
        Sections of the example that differ from EXAMPLE, or the whole example where
        it has other sections.
    commands : tuple of str
        Commands to run on the example; the last one prints the message.
    """

    number: str
    code: str
    happened: str
    expected: str
    hint: str
    change: str = ""
    commands: tuple[str, ...] = CHECK

    @property
    def model(self) -> str:
        """Text of the model file of the example."""
        found = _sections(EXAMPLE)
        for name, text in _sections(self.change).items():
            found[name] = text
        return "".join(found.values())


def _sections(text: str) -> dict[str, str]:
    """Return the sections of a model file as texts by key, in the order of the file."""
    parts = re.split(r"(?m)^(?=\w+:)", text)
    return {part.partition(":")[0]: part for part in parts if part}


def warning(
    number: str,
    code: str,
    happened: str,
    hint: str,
    change: str = "",
    commands: tuple[str, ...] = CHECK,
) -> MessageRow:
    """Return the row of a warning, which breaks no rule: `expected` is empty.

    Arguments : see `MessageRow`.
    """
    return MessageRow(number, code, happened, "", hint, change, commands)


@functools.cache
def errors() -> dict[str, MessageRow]:
    """Return the rows of all errors by code."""
    from lagsim.codes import models, runs

    return {row.code: row for row in models.ROWS + runs.ROWS}


@functools.cache
def cautions() -> dict[str, MessageRow]:
    """Return the rows of all warnings by code."""
    from lagsim.codes import warnings

    return {row.code: row for row in warnings.ROWS}


class Retired(NamedTuple):
    """Message that is no longer used; its number and code are never used again.

    Attributes
    ----------
    number, code : str
        As they were published.
    happened : str
        The fault that was found, or the event that was reported.
    instead : str
        Reason for which the message is no longer needed.
    """

    number: str
    code: str
    happened: str
    instead: str


RETIRED = (
    Retired("E109", "split-by-comma",
        "A comma within `{}` or `[]` ended a value too early.",
        "a comma within parentheses does not end a value"),
    Retired("W205", "spectral-radius-unused",
        "`spectral_radius` had no effect, since the method of the run does not use it.",
        "W206 (`option-unused`) reports this for the options of all methods"),
    Retired("W316", "short-times",
        "An argument of time had too many extrema for all of them to be checked, so "
        "that the run could step over a short pulse.",
        "pulses of t are located within the steps, whatever their number"),
    Retired("W322", "mixed-friction",
        "Constraints and switches, such as `sign` of a velocity, held a body by forces "
        "that were not unique.",
        "friction of several constraints and switches holds a body together; the body "
        "slips when they cannot hold it, however the load is divided among them"),
)  # fmt: skip


def number(code: ErrorCode) -> str:
    """Return the number of an error, such as E104.

    Examples
    --------
    >>> number("yaml-syntax")
    'E105'
    """
    return errors()[code].number


def failure(code: ErrorCode) -> dict[str, Any]:
    """Return the entry `failure` in the document of a failed run or a negative answer.

    code : the code of the error.
    """
    row = errors()[code]
    return {
        "code": code,
        "number": row.number,
        "expected": row.expected,
        "hint": row.hint,
    }


def every() -> list[MessageRow]:
    """Return the rows of all messages, errors first."""
    return [*errors().values(), *cautions().values()]


def found(word: str) -> list[MessageRow | Retired]:
    """Return the rows of messages with this number or code, retired ones included.

    word : number or code; an error and a warning may share a code.
    """
    rows: list[MessageRow | Retired] = [*every(), *RETIRED]
    return [r for r in rows if word.upper() == r.number or word.lower() == r.code]
