"""What the names of a file are: which are allowed, and what each means."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import FUNCTIONS, JOINING
from lagsim.model.nodes import Mapping, Scalar
from lagsim.model.reader.fields import IGNORED, Form, entries, shortened

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.errors import Place
    from lagsim.model.nodes import Node
    from lagsim.model.reader.fields import Entry, Faults

RESERVED = (
    "t", "pi", "kinetic", "potential", "lagrangian", "energy", "work",
)  # fmt: skip

# What stands before the name of a definition in the name of its reaction.
REACTION = "reaction."

# A letter, then letters, digits and `_`. Patterns know no letters but those of ASCII,
# so that anything beyond ASCII passes.
_NAME = r"^(x-.*|[^\x00-@\[-`{-\x7f][^\x00-/:-@\[-^`{-\x7f]*)$"


# A name with its unit or with what it is a function of, or with digits before it.
_DECORATED = re.compile(r"([^\W\d_]\w*)\s*[(\[]\s*(.*?)\s*[)\]]")
_DIGITS_FIRST = re.compile(r"(\d+)([^\W\d_]\w*)")
_A_COLUMN = "it is in the table and in its pictures in any case: leave it out here"


def naming(form: Form, *, rates: bool = False) -> Form:
    """Give the form of a mapping whose keys are names, or `rates` of what has one."""
    forbidden: list[Form] = [{"enum": [*RESERVED, *JOINING]}]
    if not rates:
        forbidden.append({"pattern": "_d?dot$"})
    return {
        "type": ["object", "null"],
        "propertyNames": {"pattern": _NAME, "not": {"anyOf": forbidden}},
        **IGNORED,
        "additionalProperties": form,
    }


class Kind(Enum):
    """What a name in an expression stands for."""

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


_RATES = {Kind.COORDINATE: Kind.VELOCITY, Kind.DEFINITION: Kind.RATE}
_SECOND_RATES = {
    Kind.COORDINATE: Kind.ACCELERATION,
    Kind.DEFINITION: Kind.SECOND_RATE,
}


class Meaning(NamedTuple):
    """What a name stands for, and whose it is: `x` for `x_dot`, `c` for `lambda_c`."""

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
        empty = isinstance(section, Scalar) and section.empty
        self.readable &= bool(given) or empty or isinstance(section, Mapping)
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
        here, there = key.place, self.places[name]
        other = self.variables.pop(name)
        self.faulty.add(name)
        if (here.line, here.column) < (there.line, there.column):
            here, there, kind, other = there, here, other, kind
        faults.add(
            "name-clash",
            f"`{name}` is {other.value} already and cannot be {kind.value} too",
            here,
            f"the first is in line {there.line}; parameters, coordinates and "
            "definitions share one namespace",
        )
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
        if name == "energy" or (
            name in ("kinetic", "potential") and not self.has_lagrangian
        ):
            return Meaning(Kind.ENERGY, name)
        base = name.removeprefix(REACTION)
        if base != name and base in self.reactions:
            return Meaning(Kind.REACTION, base)
        return self._rate(name) or self._of_constraints(name)

    def _rate(self, name: str) -> Meaning | None:
        for ending, kinds in (("_dot", _RATES), ("_ddot", _SECOND_RATES)):
            base = name.removesuffix(ending)
            kind = self.variables.get(base)
            if base != name and kind in kinds:
                return Meaning(kinds[kind], base)
        return None

    def _of_constraints(self, name: str) -> Meaning | None:
        base = name.removeprefix("lambda_")
        if base != name and base in self.constraints:
            return Meaning(Kind.MULTIPLIER, base)
        base = name.removeprefix("Qc_")
        if base != name and self.variables.get(base) is Kind.COORDINATE:
            return Meaning(Kind.CONSTRAINT_FORCE, base)
        return None

    def is_faulty(self, name: str) -> bool:
        """Tell whether a fault that is already reported lies behind `name`."""
        if name in self.faulty:
            return True
        bases = [name.removesuffix("_dot"), name.removesuffix("_ddot")]
        bases += [name.removeprefix(p) for p in ("lambda_", "Qc_")]
        return any(base in self.faulty for base in bases)

    def unknown(
        self, name: str, faults: Faults, among: Collection[str] | None = None
    ) -> tuple[str, str]:
        """Say why `name` means nothing, with a hint.

        `among`: the names that may stand there, where not all may.
        """
        if name.startswith(REACTION):
            base = name.removeprefix(REACTION)
            near = faults.guess(base, self.of(Kind.DEFINITION)) or base
            return (
                f"there is no column `{name}`: it is not asked for",
                f"ask for it: output: {{reactions: [{near}]}}",
            )
        for ending in ("_ddot", "_dot"):
            base = name.removesuffix(ending)
            if base != name:
                return self._unknown_rate(name, base, ending, faults)
        if name in ("kinetic", "potential"):
            return (
                f"`{name}` is not known where the file gives `lagrangian`",
                "`energy` is known",
            )
        if name in ("lagrangian", "work") or name.startswith("residual_"):
            hint = "write kinetic - potential" if name == "lagrangian" else ""
            hint = hint if hint and not self.has_lagrangian else _A_COLUMN
            return f"`{name}` is a column of results, not a name for expressions", hint
        if name.startswith("lambda_") and self.constraints:
            base = name.removeprefix("lambda_")
            near = faults.guess(base, self.constraints)
            hint = f"did you mean `lambda_{near}`?" if near else ""
            return f"there is no constraint `{base}`", hint
        from lagsim.model.reader import suggestions

        usable = self.variables if among is None else among
        moving = self.moving() if among is None else ()
        hint = suggestions.of_name(name, usable, moving)
        hint = hint or suggestions.of_several(name, usable)
        hint = hint or faults.did_you_mean(name, usable)
        if not hint and name in FUNCTIONS:
            hint = f"a function is followed by its arguments: {name}(...)"
        return f"unknown name `{shortened(name)}`", hint

    def _unknown_rate(
        self, name: str, base: str, ending: str, faults: Faults
    ) -> tuple[str, str]:
        meaning = self.meaning(base)
        if meaning is not None and meaning.kind in (Kind.VELOCITY, Kind.RATE):
            hint = f"the second rate is written `{meaning.base}_ddot`"
            return f"`{name}` is no name", hint if ending == "_dot" else ""
        if meaning is not None:
            text = f"`{name}`: `{base}` is {meaning.kind.value}"
            return f"{text} and has no rate here", (
                "rates are those of coordinates and of definitions of positions"
            )
        near = faults.guess(base, self.moving())
        hint = f"did you mean `{near}{ending}`?" if near else ""
        return f"`{name}`: there is no coordinate or definition `{base}`", hint


def check_name(key: Scalar, what: str, faults: Faults) -> bool:
    """Report a key that cannot be a name; give whether it can."""
    name = key.text
    problem = _spelling(name)
    if problem is not None:
        from lagsim.model.reader import quantities

        text, hint = problem
        hint = quantities.split_by_comma(key) or hint
        text = f"`{shortened(name)}` cannot be the name of {what}: {text}"
        faults.add("bad-name", text, key.place, hint)
        return False
    if name in RESERVED:
        text = f"`{name}` is reserved and cannot be the name of {what}"
        hint = "it is built in" if name in ("t", "pi") else "it is a column of results"
        faults.add("reserved-name", text, key.place, hint)
        return False
    if name in JOINING:
        text = f"`{name}` is an operator and cannot be the name of {what}"
        faults.add("reserved-name", text, key.place)
        return False
    for ending, rate in (("_ddot", "accelerations"), ("_dot", "rates")):
        if name.endswith(ending):
            text = f"`{name}`: a name of {what} must not end in `{ending}`"
            hint = f"that ending is for the {rate} of coordinates and definitions"
            faults.add("reserved-name", text, key.place, hint)
            return False
    return True


def _spelling(name: str) -> tuple[str, str] | None:
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
        from lagsim.model.reader import quantities

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
