"""Every message that lagsim has: its number, what is expected, what to try, an example.

One table. Messages take their numbers from it, and
`docs/errors.md` and `lagsim explain` all that they say. A number is given once: where a
message goes, its number goes with it.
"""

from __future__ import annotations

import functools
import re
from typing import Any, NamedTuple

# What the examples change: each replaces the sections that it names.
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


class Row(NamedTuple):
    """Message: number, expectation, advice and example of a code.

    Attributes
    ----------
    number, code : str
        `E104`, and the word that documents have for it. Neither ever changes.
    happened : str
        What has been found, or has happened.
    expected : str
        Of an error, the rule that is broken.
    hint : str
        What to try, where the message itself has no better hint.
    change : str
        The sections of the example that differ from EXAMPLE, or the whole of it where
        it is not made of these.
    commands : tuple of str
        What is called then; the last one gives the message.
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
        """The whole model of the example."""
        found = _sections(EXAMPLE)
        for name, text in _sections(self.change).items():
            found[name] = text
        return "".join(found.values())


def _sections(text: str) -> dict[str, str]:
    """Give the sections of a model, by their keys and in their order."""
    parts = re.split(r"(?m)^(?=\w+:)", text)
    return {part.partition(":")[0]: part for part in parts if part}


def warning(
    number: str,
    code: str,
    happened: str,
    hint: str,
    change: str = "",
    commands: tuple[str, ...] = CHECK,
) -> Row:
    """Give the row of a warning, which breaks no rule: it has no `expected`."""
    return Row(number, code, happened, "", hint, change, commands)


@functools.cache
def errors() -> dict[str, Row]:
    """Give all that can go wrong, by code."""
    from lagsim.codes import models, runs

    return {row.code: row for row in models.ROWS + runs.ROWS}


@functools.cache
def cautions() -> dict[str, Row]:
    """Give all warnings, by code."""
    from lagsim.codes import warnings

    return {row.code: row for row in warnings.ROWS}


def number(code: str) -> str:
    """Give the number of an error, such as E104."""
    return errors()[code].number


def failure(code: str) -> dict[str, Any]:
    """Give what documents say of an answer that is no, or of a run that failed."""
    row = errors()[code]
    return {
        "code": code,
        "number": row.number,
        "expected": row.expected,
        "hint": row.hint,
    }


def every() -> list[Row]:
    """Give all messages, errors first, by number."""
    return [*errors().values(), *cautions().values()]


def found(word: str) -> list[Row]:
    """Give the messages with this number or this code, an error and a warning maybe."""
    return [r for r in every() if word.upper() == r.number or word.lower() == r.code]
