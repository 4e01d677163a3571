"""The registry of columns: a row for each kind of column named after another name.

`lambda_rod` is the multiplier of the constraint `rod`: it consists of the prefix of its
kind and the name of its owner. Clashes of names, units, letters in pictures and the
choice of columns for pictures and comparisons follow from these rows. All other columns
have the names of coordinates, their rates, states, modes, definitions and energies.
"""

from __future__ import annotations

import re
from enum import Enum
from typing import NamedTuple


class Owner(Enum):
    """Kind of the name that follows the prefix in the name of a column."""

    CONSTRAINT = "a constraint"
    COORDINATE = "a coordinate"
    COLUMN = "another column"
    PAIR = "another column, a point, and a parameter or start value"
    RUN = "none"


class ColumnKind(NamedTuple):
    """Kind of columns whose names consist of a prefix and the name of an owner.

    Attributes
    ----------
    prefix : str
        Beginning of its names; the whole name where the owner is the run.
    owner : Owner
        Kind of name that follows the prefix.
    meaning : str
        The meaning in messages, with {} for the rest of the name.
    energy, along, seconds : int
        Exponents of the unit: of energy, of the owner's unit, and of the second. The
        owner's unit of a constraint is that of its residual.
    names : tuple of str
        Preferred names of the unit.
    letter : str
        The letter or word of which the rest of the name is a subscript in pictures.
    """

    prefix: str
    owner: Owner
    meaning: str
    energy: int = 0
    along: int = 0
    seconds: int = 0
    names: tuple[str, ...] = ()
    letter: str = ""

    def of(self, name: str = "") -> str:
        """Return the column of the owner `name`.

        Examples
        --------
        >>> MULTIPLIER.of("rod"), ACTION.of()
        ('lambda_rod', 'action.S')
        """
        return f"{self.prefix}{name}"


# Names of units of generalized forces, impulses, stiffness and power.
FORCES = ("N", "N m", "N s", "N m s", "N/m", "J", "W")

MULTIPLIER = ColumnKind(
    "lambda_", Owner.CONSTRAINT, "the multiplier of the constraint `{}`",
    energy=1, along=-1, names=FORCES, letter="λ",
)  # fmt: skip
FORCE = ColumnKind(
    "Qc_", Owner.COORDINATE, "the constraint force on `{}`",
    energy=1, along=-1, names=FORCES, letter="Qc",
)  # fmt: skip
RESIDUAL = ColumnKind(
    "residual_", Owner.CONSTRAINT, "the residual of the constraint `{}`",
    along=1, letter="residual",
)  # fmt: skip
IMPULSE = ColumnKind(
    "impulse.", Owner.CONSTRAINT, "the impulse of the constraint `{}`",
    energy=1, along=-1, seconds=1, names=FORCES,
)  # fmt: skip
FRICTION = ColumnKind(
    "friction.", Owner.CONSTRAINT, "the friction of the constraint `{}`",
    energy=1, along=-1, names=FORCES,
)  # fmt: skip
FREE = ColumnKind(
    "gauss.a_", Owner.COORDINATE, "the acceleration of `{}` without constraints",
    along=1, seconds=-2,
)  # fmt: skip
GAUSS = ColumnKind(
    "gauss.G", Owner.RUN, "Gauss's constraint", energy=1, seconds=-2, names=("J/s^2",)
)
ACTION = ColumnKind(
    "action.S", Owner.RUN, "the action", energy=1, seconds=1, names=("J s",)
)
REACTION = ColumnKind(
    "reaction.", Owner.COLUMN, "the reaction of `{}`", energy=1, along=-1, names=FORCES
)
SENSITIVITY = ColumnKind("d.", Owner.PAIR, "the sensitivity of `{}` to `{}`", along=1)
DEVIATION = ColumnKind("sd.", Owner.COLUMN, "the standard deviation of `{}`", along=1)

KINDS = (
    MULTIPLIER, FORCE, RESIDUAL, IMPULSE, FRICTION, FREE, GAUSS, ACTION, REACTION,
    SENSITIVITY, DEVIATION,
)  # fmt: skip
# Columns of constraints, which pictures of a motion leave to those of forces.
OF_CONSTRAINTS = (MULTIPLIER, FORCE, RESIDUAL)
_BEGINS = re.compile("|".join(f"({re.escape(kind.prefix)})" for kind in KINDS))


class Column(NamedTuple):
    """A column of the table of a run.

    Attributes
    ----------
    name : str
    node : int
        The graph node of the column's value, which depends on the state, q'',
        multipliers and impulses.
    unit : str
        The unit as the file states it; "" where the unit follows from others, or is
        unknown.
    """

    name: str
    node: int
    unit: str = ""


def parsed(name: str) -> tuple[ColumnKind, str] | None:
    """Return the kind of a column, and the rest of its name after the prefix.

    None for other columns. Whether the rest is the name of an owner is not checked.

    Examples
    --------
    >>> parsed("impulse.floor.2")[1], parsed("theta_dot")
    ('floor.2', None)
    """
    found = _BEGINS.match(name)
    if found is None:
        return None
    kind = KINDS[found.lastindex - 1] if found.lastindex else KINDS[0]
    rest = name[found.end() :]
    return None if bool(rest) is (kind.owner is Owner.RUN) else (kind, rest)


def is_of_kind(name: str, *kinds: ColumnKind) -> bool:
    """Whether a column is of one of the given kinds, by the prefix of its name."""
    found = parsed(name)
    return found is not None and found[0] in kinds


def base(name: str) -> str:
    """Return the owner's name in the name of a column, as `rod` for `lambda_rod`.

    Other columns have no owner: the result is the name of the column.
    """
    found = parsed(name)
    return name if found is None else found[1] or name


def halves(rest: str) -> list[tuple[str, str]]:
    """Return all ways to split the text `column.name` at a dot in two parts.

    rest : the end of the name of a sensitivity's column: the column that is
        differentiated, and the parameter. Both may contain dots.
    """
    parts = rest.split(".")
    return [(".".join(parts[:k]), ".".join(parts[k:])) for k in range(1, len(parts))]
