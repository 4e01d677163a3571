"""The names of a file: which are allowed, and what each means."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import FUNCTIONS, JOINING
from lagsim.model.reader import hints, quantities
from lagsim.model.reader.fields import entries, is_mapping, shortened
from lagsim.model.reader.sections import RESERVED

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from lagsim.errors import Place
    from lagsim.model.nodes import Entry, Node, Scalar
    from lagsim.model.reader.fields import Faults

# What stands before the name of a definition in the name of its reaction.
REACTION = "reaction."
# A name with its unit or with what it is a function of, or with digits before it.
_DECORATED = re.compile(r"([^\W\d_]\w*)\s*[(\[]\s*(.*?)\s*[)\]]")
_DIGITS_FIRST = re.compile(r"(\d+)([^\W\d_]\w*)")
_A_COLUMN = "it is in the table and in its pictures in any case: leave it out here"


class Kind(Enum):
    """What a name in an expression denotes."""

    PI = "the number pi"
    TIME = "the time"
    PARAMETER = "a parameter"
    COORDINATE = "a coordinate"
    VELOCITY = "a velocity"
    ACCELERATION = "an acceleration"
    DEFINITION = "a definition"
    RATE = "the rate of a definition"
    SECOND_RATE = "the second rate of a definition"
    MULTIPLIER = "a constraint multiplier"
    CONSTRAINT_FORCE = "a constraint force"
    ENERGY = "an energy"
    REACTION = "a reaction"


# Names made of others: what stands before and after these, and kinds by those of these.
_Kinds = dict[Kind | None, Kind]
_DERIVED: tuple[tuple[str, str, _Kinds], ...] = (
    ("", "_dot", {Kind.COORDINATE: Kind.VELOCITY, Kind.DEFINITION: Kind.RATE}),
    ("", "_ddot",
     {Kind.COORDINATE: Kind.ACCELERATION, Kind.DEFINITION: Kind.SECOND_RATE}),
    ("lambda_", "", {}),  # of constraints
    ("Qc_", "", {Kind.COORDINATE: Kind.CONSTRAINT_FORCE}),
)  # fmt: skip


class Meaning(NamedTuple):
    """What a name denotes, and of what: `x` for `x_dot`, `c` for `lambda_c`."""

    kind: Kind
    base: str


@dataclass(slots=True)
class Names:
    """All names of a file.

    Attributes
    ----------
    has_lagrangian
        Whether the file gives one, so that its energies are not known.
    variables, places
        Kind and place of each parameter, coordinate and definition.
    faulty
        Names given where a fault was reported; using them is no second fault.
    constraints
        Names of the constraints; a namespace of their own.
    reactions
        The definitions whose reactions are asked for, as far as that can be read.
    readable
        False where a section that gives names could not be read.
    """

    has_lagrangian: bool
    readable: bool = True
    variables: dict[str, Kind] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)
    constraints: list[str] = field(default_factory=list)
    reactions: list[str] = field(default_factory=list)
    faulty: set[str] = field(default_factory=set)

    @property
    def complete(self) -> bool:
        """False where an unknown name may well be one that could not be read."""
        return self.readable and bool(self.of(Kind.COORDINATE))

    def section(
        self, section: Node | None, what: str, kind: Kind, faults: Faults
    ) -> list[Entry]:
        """Give the entries of a section that gives names, and declare these."""
        if section is None:
            return []
        given = entries(section, what, faults)
        self.readable &= is_mapping(section)
        return [entry for entry in given if self.declare(entry[0], kind, faults)]

    def declare(self, key: Scalar, kind: Kind, faults: Faults) -> bool:
        """Add a parameter, coordinate or definition; give whether its name is good."""
        name = key.text
        if not check_name(key, kind.value, faults):
            self.faulty |= {name, *(f[1] for f in _DECORATED.finditer(name))}
            return False
        if name in self.faulty:
            return False
        if name not in self.variables:
            self.variables[name], self.places[name] = kind, key.place
            return True
        self.faulty.add(name)
        both = [(self.places[name], self.variables.pop(name)), (key.place, kind)]
        (there, first), (here, second) = sorted(both, key=lambda one: one[0][1:3])
        text = f"`{name}` is {first.value} already and cannot be {second.value} too"
        hint = f"the first is in line {there.line}; parameters, coordinates and "
        hint += "definitions share one namespace"
        faults.add("name-clash", text, here, hint)
        return False

    def of(self, kind: Kind) -> list[str]:
        """Give the names of one kind, in the order of the file."""
        return [name for name, k in self.variables.items() if k is kind]

    def moving(self) -> list[str]:
        """Give the names that have rates: coordinates and definitions."""
        return self.of(Kind.COORDINATE) + self.of(Kind.DEFINITION)

    def meaning(self, name: str) -> Meaning | None:
        """Give what `name` means in an expression, or None."""
        if name in self.variables:
            return Meaning(self.variables[name], name)
        if name in ("t", "pi"):
            return Meaning(Kind.TIME if name == "t" else Kind.PI, name)
        known = ["energy", *([] if self.has_lagrangian else ("kinetic", "potential"))]
        if name in known:
            return Meaning(Kind.ENERGY, name)
        base = name.removeprefix(REACTION)
        if base != name and base in self.reactions:
            return Meaning(Kind.REACTION, base)
        for base, kinds in _parted(name):
            if kind := kinds.get(self.variables.get(base)):
                return Meaning(kind, base)
        base = name.removeprefix("lambda_")
        constraint = base != name and base in self.constraints
        return Meaning(Kind.MULTIPLIER, base) if constraint else None

    def is_faulty(self, name: str) -> bool:
        """Tell whether a fault that is already reported lies behind `name`."""
        return not self.faulty.isdisjoint((name, *(base for base, _ in _parted(name))))

    def unknown(
        self, name: str, faults: Faults, among: Collection[str] | None = None
    ) -> tuple[str, str]:
        """Say why `name` means nothing, with a hint.

        `among`: the names that may stand there, where not all may.
        """
        base = name.removeprefix(REACTION)
        if base != name:
            near = faults.guess(base, self.of(Kind.DEFINITION)) or base
            hint = f"ask for it: output: {{reactions: [{near}]}}"
            return f"there is no column `{name}`: it is not asked for", hint
        for ending in ("_ddot", "_dot"):
            base = name.removesuffix(ending)
            if base != name:
                return self._unknown_rate(name, base, ending, faults)
        if name in ("kinetic", "potential"):
            text = f"`{name}` is not known where the file gives `lagrangian`"
            return text, "`energy` is known"
        if name in ("lagrangian", "work") or name.startswith("residual_"):
            hint = _A_COLUMN
            if name == "lagrangian" and not self.has_lagrangian:
                hint = "write kinetic - potential"
            return f"`{name}` is a column of results, not a name for expressions", hint
        base = name.removeprefix("lambda_")
        if base != name and self.constraints:
            near = faults.guess(base, self.constraints)
            hint = f"did you mean `lambda_{near}`?" if near else ""
            return f"there is no constraint `{base}`", hint
        usable = self.variables if among is None else among
        hint = hints.of_name(name, usable, self.moving() if among is None else ())
        hint = hint or faults.did_you_mean(name, usable)
        if not hint and name in FUNCTIONS:
            hint = f"a function is followed by its arguments: {name}(...)"
        return f"unknown name `{shortened(name)}`", hint

    def _unknown_rate(
        self, name: str, base: str, ending: str, faults: Faults
    ) -> tuple[str, str]:
        meaning = self.meaning(base)
        if meaning is None:
            near = faults.guess(base, self.moving())
            hint = f"did you mean `{near}{ending}`?" if near else ""
            return f"`{name}`: there is no coordinate or definition `{base}`", hint
        if meaning.kind in (Kind.VELOCITY, Kind.RATE):
            hint = f"the second rate is written `{meaning.base}_ddot`"
            return f"`{name}` is no name", hint if ending == "_dot" else ""
        text = f"`{name}`: `{base}` is {meaning.kind.value} and has no rate here"
        return text, "rates are those of coordinates and of definitions of positions"


def _parted(name: str) -> Iterator[tuple[str, _Kinds]]:
    """Give the names that one is made of, and kinds by those of these."""
    for before, after, kinds in _DERIVED:
        base = name.removeprefix(before).removesuffix(after)
        if base != name:
            yield base, kinds


def check_name(key: Scalar, what: str, faults: Faults) -> bool:
    """Report a key that cannot be a name; give whether it can."""
    name = key.text
    code = "reserved-name"
    if problem := _spelling(name):
        text, hint = problem
        text = f"`{shortened(name)}` cannot be the name of {what}: {text}"
        hint = quantities.split_by_comma(key) or hint
        code = "bad-name"
    elif name in RESERVED:
        text = f"`{name}` is reserved and cannot be the name of {what}"
        hint = "it is built in" if name in ("t", "pi") else "it is a column of results"
    elif name in JOINING:
        text, hint = f"`{name}` is an operator and cannot be the name of {what}", ""
    elif ending := re.search("_d?dot$", name):
        text = f"`{name}`: a name of {what} must not end in `{ending[0]}`"
        rate = "rates" if ending[0] == "_dot" else "accelerations"
        hint = f"that ending is for the {rate} of coordinates and definitions"
    else:
        return True
    faults.add(code, text, key.place, hint)
    return False


def _spelling(name: str) -> tuple[str, str] | None:
    """Say why a text cannot be a name, with a hint."""
    plain = unicodedata.normalize("NFKC", name)
    if plain != name:
        return "it is not in its plain (NFKC) form", f"write `{shortened(plain)}`"
    if not name:
        return "it is empty", ""
    rest_fits = all(c == "_" or c.isalpha() or c.isdecimal() for c in name)
    if name[0].isalpha() and rest_fits:
        return None
    fault = "a name is a letter, then letters, digits and `_`"
    if "\n" in name:
        fault = "it has a line break"
    if found := _DECORATED.fullmatch(name):
        hint = f"write `{found[1]}`"
        if quantities.is_unit(found[2]):
            beside = f"{{value: ..., unit: {quantities.unit(found[2])}}}"
            hint += f"; its unit goes beside its value: {beside}"
        return fault, hint
    if found := _DIGITS_FIRST.fullmatch(name):
        return fault, f"write `{found[2]}{found[1]}`"
    fitting = re.sub(r"\W+", "_", name.strip()).strip("_")
    if fitting and fitting[0].isalpha() and fitting != name and len(fitting) < 40:
        return fault, f"write `{fitting}`"
    return fault, ""


def check_columns(names: Names, faults: Faults) -> None:
    """Report names that equal a column which the file makes of its constraints."""
    columns = {}
    for c in names.constraints:
        columns[f"lambda_{c}"] = f"the multiplier of the constraint `{c}`"
        columns[f"residual_{c}"] = f"the residual of the constraint `{c}`"
    for q in names.of(Kind.COORDINATE):
        columns[f"Qc_{q}"] = f"the constraint force on `{q}`"
    for name, place in names.places.items():
        if name in columns:
            text = f"`{name}` is the column of {columns[name]} in this file"
            faults.add("column-clash", text, place, "choose another name")
