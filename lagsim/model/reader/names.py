"""Names of a file: their kinds and meanings, and clashes with columns of the table."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.codes.known import (
    BAD_NAME,
    COLUMN_CLASH,
    NAME_CLASH,
    RESERVED_NAME,
)
from lagsim.language import columns
from lagsim.language.columns import FORCE, MULTIPLIER, REACTION, RESIDUAL, Owner
from lagsim.language.functions import FUNCTIONS, JOINING
from lagsim.language.names import HIDDEN, rate_of
from lagsim.model.model import Level
from lagsim.model.reader import hints, quantities
from lagsim.model.reader.fields import (
    RESERVED,
    entries,
    in_one_line,
    is_mapping,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from lagsim.errors import Place
    from lagsim.language.parser import Name
    from lagsim.model.model import Table
    from lagsim.model.nodes import Entry, Node, Scalar
    from lagsim.model.reader.fields import Faults

    # Predicate: whether a name is allowed in an expression; reports it if not.
    Rule = Callable[[Name, Scalar], bool]
    from lagsim.codes.known import ErrorCode

# A name with its unit or its argument in brackets, or with digits before it.
_DECORATED = re.compile(r"([^\W\d_]\w*)\s*[(\[]\s*(.*?)\s*[)\]]")
_DIGITS_FIRST = re.compile(r"(\d+)([^\W\d_]\w*)")
_A_COLUMN = "it is in the table and in its pictures in any case: leave it out here"


class NameKind(Enum):
    """Kinds of names in expressions.

    `text` describes the kind in messages; `level` is the level of quantities on which
    an expression with such a name depends, see `model.model.Level`.
    """

    PI = "the number pi", Level.NUMBER
    PARAMETER = "a parameter", Level.NUMBER
    MODE = "a mode", Level.POSITION  # not a constant
    TIME = "the time", Level.POSITION
    COORDINATE = "a coordinate", Level.POSITION
    VELOCITY = "a velocity", Level.VELOCITY
    STATE = "a state", Level.POSITION
    STATE_RATE = "the rate of a state", Level.VELOCITY
    ACCELERATION = "an acceleration", Level.OUTPUT
    DEFINITION = "a definition", Level.POSITION  # or what is defined depends on
    RATE = "the rate of a definition", Level.VELOCITY
    SECOND_RATE = "the second rate of a definition", Level.OUTPUT
    MULTIPLIER = "a constraint multiplier", Level.OUTPUT
    CONSTRAINT_FORCE = "a constraint force", Level.OUTPUT
    ENERGY = "an energy", Level.OUTPUT
    REACTION = "a reaction", Level.OUTPUT
    TABLE = "a table", Level.NUMBER

    def __init__(self, text: str, level: Level) -> None:
        self.text = text
        self.level = level


# Derived names: prefix and suffix, and the derived kind for each kind of the base.
_Kinds = dict[NameKind | None, NameKind]


_DERIVED: tuple[tuple[str, str, _Kinds], ...] = (
    ("", "_dot",
     {NameKind.COORDINATE: NameKind.VELOCITY, NameKind.DEFINITION: NameKind.RATE,
      NameKind.STATE: NameKind.STATE_RATE}),
    ("", "_ddot",
     {NameKind.COORDINATE: NameKind.ACCELERATION,
      NameKind.DEFINITION: NameKind.SECOND_RATE}),
    (MULTIPLIER.prefix, "", {}),  # of constraints
    (FORCE.prefix, "", {NameKind.COORDINATE: NameKind.CONSTRAINT_FORCE}),
)  # fmt: skip


class Meaning(NamedTuple):
    """Meaning of a name: its kind and base (`x` for `x_dot`, `c` for `lambda_c`)."""

    kind: NameKind
    base: str


@dataclass(slots=True)
class Names:
    """Names of a file, with their kinds, places and faults.

    Attributes
    ----------
    has_lagrangian
        Whether the file has a Lagrangian, so that its energies are not known.
    variables, places
        Kind and place of each parameter, coordinate, state and definition.
    faulty
        Names with a reported fault; their use is not reported again.
    constraints
        Name and place of each constraint; a namespace of its own.
    reactions
        Definitions listed in `output.reactions`, as far as the list is readable.
    readable
        False where a section that declares names could not be read.
    started
        Names with an entry in `initial`.
    broken
        Names of families whose ranges have a fault.
    tables
        Tables without faults, by name.
    called
        Names of tables that expressions call.
    """

    has_lagrangian: bool
    readable: bool = True
    variables: dict[str, NameKind] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)
    constraints: dict[str, Place] = field(default_factory=dict)
    reactions: list[str] = field(default_factory=list)
    faulty: set[str] = field(default_factory=set)
    started: set[str] = field(default_factory=set)
    broken: set[str] = field(default_factory=set)
    tables: dict[str, Table] = field(default_factory=dict)
    called: set[str] = field(default_factory=set)
    _known: dict[object, Any] = field(default_factory=dict, init=False)
    _meanings: dict[str, Meaning] = field(default_factory=dict, init=False)

    @property
    def complete(self) -> bool:
        """Whether all declared names are known, so that any other name is a fault."""
        return self.readable and bool(self.of(NameKind.COORDINATE) or self.broken)

    def section(
        self, section: Node | None, label: str, kind: NameKind, faults: Faults
    ) -> list[Entry]:
        """Declare the names in a section, all of one kind; return the valid entries.

        label : name of the section in messages.
        """
        if section is None:
            return []
        given = entries(section, label, faults)
        self.readable &= is_mapping(section)
        return [entry for entry in given if self.declare(entry[0], kind, faults)]

    def declare(self, key: Scalar, kind: NameKind, faults: Faults) -> bool:
        """Declare a key as a variable of the given kind; return whether it is valid.

        A name that is not valid, or declared already, is reported.
        """
        name, self._known, self._meanings = key.text, {}, {}
        if not check_name(key, kind.text, faults):
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
        text = f"`{name}` is {first.text} already and cannot be {second.text} too"
        hint = f"the first is in line {there.line}; parameters, coordinates, states, "
        hint += "modes and definitions share one namespace"
        faults.add(NAME_CLASH, text, here, hint)
        return False

    def of(self, kind: NameKind) -> list[str]:
        """Return the names of a kind, in the order of the file."""
        if not self._known:
            kinds: dict[object, list[str]] = {k: [] for k in NameKind}
            for name, k in self.variables.items():
                if name[:1] != HIDDEN:
                    kinds[k].append(name)
            velocities = frozenset(map(rate_of, kinds[NameKind.COORDINATE]))
            self._known = {**kinds, "velocities": velocities}
        found: list[str] = self._known[kind]
        return found

    def velocities(self) -> frozenset[str]:
        """Return the names of the velocities."""
        self.of(NameKind.COORDINATE)
        found: frozenset[str] = self._known["velocities"]
        return found

    def moving(self) -> list[str]:
        """Return the names that have rates: coordinates and definitions."""
        return self.of(NameKind.COORDINATE) + self.of(NameKind.DEFINITION)

    def meaning(self, name: str) -> Meaning | None:
        """Return kind and base of a name in an expression: (velocity, `x`) for `x_dot`.

        None if it has no meaning.
        """
        if name not in self._meanings:
            found = self._meaning(name)
            if found is None:  # it may be declared later
                return None
            self._meanings[name] = found
        return self._meanings[name]

    def _meaning(self, name: str) -> Meaning | None:
        if self.variables.get(name, NameKind.TABLE) is not NameKind.TABLE:
            return Meaning(self.variables[name], name)
        if name in ("t", "pi"):
            return Meaning(NameKind.TIME if name == "t" else NameKind.PI, name)
        known = ["energy", *([] if self.has_lagrangian else ("kinetic", "potential"))]
        if name in known:
            return Meaning(NameKind.ENERGY, name)
        base = name.removeprefix(REACTION.prefix)
        if base != name and base in self.reactions:
            return Meaning(NameKind.REACTION, base)
        for base, kinds in _parted(name):
            if kind := kinds.get(self.variables.get(base)):
                return Meaning(kind, base)
        base = name.removeprefix(MULTIPLIER.prefix)
        constraint = base != name and base in self.constraints
        return Meaning(NameKind.MULTIPLIER, base) if constraint else None

    def is_faulty(self, name: str) -> bool:
        """Whether a fault of `name`, or of its base or family, is reported.

        The base of `x_dot` is `x`.
        """
        names = [name, *(base for base, _ in _parted(name))]
        families = [n.partition(".")[0] for n in names]
        return not self.faulty.isdisjoint([*names, *families])

    def unknown(
        self, name: str, faults: Faults, among: Collection[str] | None = None
    ) -> tuple[str, str]:
        """Return the text of a fault on an unknown name, and a hint.

        among : the names that are permitted here, if not all.
        """
        base = name.removeprefix(REACTION.prefix)
        if base != name:
            near = faults.guess(base, self.of(NameKind.DEFINITION)) or base
            hint = f"add output: {{reactions: [{near}]}}"
            return f"there is no column `{name}`: `reactions` does not list it", hint
        for ending in ("_ddot", "_dot"):
            base = name.removesuffix(ending)
            if base != name:
                return self._unknown_rate(name, base, ending, faults)
        if name in ("kinetic", "potential"):
            text = f"`{name}` is not known where the file gives `lagrangian`"
            return text, "`energy` is known"
        if name in ("lagrangian", "work") or columns.is_of_kind(name, RESIDUAL):
            hint = _A_COLUMN
            if name == "lagrangian" and not self.has_lagrangian:
                hint = "write kinetic - potential"
            return f"`{name}` is a column of results, not a name for expressions", hint
        base = name.removeprefix(MULTIPLIER.prefix)
        if base != name and self.constraints:
            near = faults.guess(base, self.constraints)
            hint = f"did you mean `lambda_{near}`?" if near else ""
            return f"there is no constraint `{base}`", hint
        if name in self.started and among is None:
            self.faulty.add(name)  # reported once
            hint = f"it has a start value: write `{name}: {{}}` in `coordinates`"
            return f"unknown name `{name}`", hint
        usable = self.variables if among is None else among
        hint = hints.of_name(name, usable, self.moving() if among is None else ())
        hint = hint or faults.did_you_mean(name, usable)
        if not hint and name in FUNCTIONS:
            hint = f"a function is followed by its arguments: {name}(...)"
        return f"unknown name `{in_one_line(name)}`", hint

    def _unknown_rate(
        self, name: str, base: str, ending: str, faults: Faults
    ) -> tuple[str, str]:
        meaning = self.meaning(base)
        if meaning is None:
            near = faults.guess(base, self.moving())
            near = near and f"did you mean `{near}{ending}`?"
            hint = near or f"define `{base}` in `coordinates` or `definitions`"
            return f"`{name}`: there is no coordinate or definition `{base}`", hint
        if meaning.kind.level is Level.VELOCITY:
            hint = f"the second rate is written `{meaning.base}_ddot`"
            return f"`{name}` is no name", hint if ending == "_dot" else ""
        text = f"`{name}`: `{base}` is {meaning.kind.text} and has no rate here"
        return text, "rates exist of coordinates and of definitions of positions"


def _parted(name: str) -> Iterator[tuple[str, _Kinds]]:
    """Yield each name from which `name` can be derived, such as `x` for `x_dot`.

    Items are pairs: the original name, and a mapping from its kind to the kind of the
    derived name. For `x` and `x_dot` it maps a coordinate to a velocity, and a state to
    the rate of a state.
    """
    head, dot, tail = name.partition(".")
    for before, after, kinds in _DERIVED:
        base = head.removeprefix(before).removesuffix(after)
        if base != head:
            yield f"{base}{dot}{tail}", kinds


def check_name(key: Scalar, label: str, faults: Faults) -> bool:
    """Whether a key is valid as a name; if not, a fault is reported.

    label : the kind of thing that it names, such as `a point`, for the message.
    """
    name = key.text
    if key.reading is not None:  # of a member: the name of its family
        name = name.removeprefix(HIDDEN).partition(".")[0]
    code: ErrorCode = RESERVED_NAME
    if problem := _spelling(name):
        text, hint = problem
        text = f"`{in_one_line(name)}` cannot be the name of {label}: {text}"
        code = BAD_NAME
    elif name in RESERVED:
        text = f"`{name}` is reserved and cannot be the name of {label}"
        hint = "it is built in" if name in ("t", "pi") else "it is a column of results"
    elif label == NameKind.TABLE.text and name in FUNCTIONS:
        text, hint = f"`{name}` is a function already and cannot be {label} too", ""
    elif name in JOINING:
        text, hint = f"`{name}` is an operator and cannot be the name of {label}", ""
    elif ending := re.search("_d?dot$", name):
        text = f"`{name}`: a name of {label} must not end in `{ending[0]}`"
        rate = "rates" if ending[0] == "_dot" else "accelerations"
        hint = f"that ending is for the {rate} of coordinates and definitions"
    else:
        return True
    faults.add(code, text, key, hint)
    return False


def _spelling(name: str) -> tuple[str, str] | None:
    """Return the reason why a text cannot be a name, and a hint; None if it can be."""
    plain = unicodedata.normalize("NFKC", name)
    if plain != name:
        return "it is not in its plain (NFKC) form", f"write `{in_one_line(plain)}`"
    if not name:
        return "it is empty", ""
    rest_fits = all(c == "_" or c.isalpha() or c.isdecimal() for c in name)
    if name[0].isalpha() and rest_fits:
        return None
    fault = "a name is a letter, then letters, digits and `_`"
    if "\n" in name:
        fault = "it has a line break"
    if found := _DECORATED.fullmatch(name):
        return fault, _undecorated(*found.groups(), called=name.endswith(")"))
    if found := _DIGITS_FIRST.fullmatch(name):
        return fault, f"write `{found[2]}{found[1]}`"
    if equals := re.fullmatch(r"(\w+)\s*:?=\s*([^=]+)", name):
        return fault, f"write `{equals[1]}: {equals[2]}`"
    fitting = re.sub(r"[\W_]+", "_", name).strip("_")
    if fitting and fitting[0].isalpha() and fitting != name and len(fitting) < 40:
        return fault, f"write `{fitting}`"
    return fault, ""


def _undecorated(name: str, decoration: str, *, called: bool) -> str:
    """Return a hint for a name with a unit or an argument attached.

    decoration : the attached text.
    called : whether that text is in parentheses.
    """
    if ends := re.fullmatch(r"([^:]+):([^:]+)", decoration):
        first, last = ends[1].strip(), ends[2].strip()
        return f"write {name}({first}..{last}): a range contains both ends"
    hint = f"write `{name}`"
    if quantities.is_unit(decoration):
        beside = f"{{value: ..., unit: {quantities.unit_spelling(decoration)}}}"
        return f"{hint}; a unit is written beside the value: {beside}"
    if called:
        hint += ": a definition has no arguments, its expression names variables"
    return hint


# The kinds of names with a column; a parameter has none, but its name is an expression.
_SHOWN = (NameKind.COORDINATE, NameKind.STATE, NameKind.MODE, NameKind.DEFINITION)


def _owner(name: str, names: Names) -> tuple[str, Place | None]:
    """Return the meaning of the column with this name, and the place of its owner.

    The meaning is "" where no such column exists. Columns that exist only in files with
    contacts, impulses, sensitivities or uncertainties count in every file, so that a
    file to which these are added later can keep its names.
    """
    found = columns.parsed(name)
    if found is None:
        return "", None
    made, of = found
    if made.owner is Owner.RUN:
        return made.meaning, None
    if made.owner is Owner.PAIR:
        pairs = columns.halves(of)
        both = [x for x in pairs if all(one in names.places for one in x)]
        if not both:
            return "", None
        return made.meaning.format(*both[0]), names.places[both[0][0]]
    place = _place_of(of, made.owner, names)
    return (made.meaning.format(of) if place else ""), place


def _place_of(of: str, owner: Owner, names: Names) -> Place | None:
    """Return the place at which a name with columns is declared; None if there is none.

    of : the name.
    owner : the kind of name that the columns belong to.
    """
    if owner is Owner.CONSTRAINT:
        whole = re.sub(r"\.[12]$", "", of)  # of two relations, or two slips
        return names.constraints.get(of, names.constraints.get(whole))
    of = of if of in names.variables else of.replace("_dot", "")
    kinds = _SHOWN if owner is Owner.COLUMN else (NameKind.COORDINATE,)
    return names.places.get(of) if names.variables.get(of) in kinds else None


def check_columns(names: Names, faults: Faults) -> None:
    """Report names that equal a column which the file makes of its other names."""
    for name, place in names.places.items():
        if "." in name and names.variables.get(name) not in _SHOWN:
            continue
        meaning, other = _owner(name, names)
        if meaning:
            text = f"`{name}` is the column of {meaning} in this file"
            hint = f"the first is in line {other.line}" if other else ""
            faults.add(COLUMN_CLASH, text, place, hint)
