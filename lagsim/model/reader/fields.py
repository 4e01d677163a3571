"""Faults of a file, access to its mappings, lists and texts, and its sections.

A function with the argument `faults` adds the faults that it finds to this list.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from lagsim.codes.known import (
    BOTH_GIVEN,
    EXPRESSION_UNKNOWN_FUNCTION,
    MISSING_KEY,
    MORE_FAULTS,
    NOT_A_LIST,
    NOT_A_MAPPING,
    NOT_A_TEXT,
    NOT_A_TRUTH,
    UNKNOWN_KEY,
    UNKNOWN_NAME,
)
from lagsim.errors import InputError, Place, Problem, nearest, several
from lagsim.language.functions import FUNCTIONS, JOINING
from lagsim.language.names import in_file
from lagsim.methods import options
from lagsim.model.nodes import Broken, Entry, Mapping, Node, Scalar, Sequence
from lagsim.model.reader import hints

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator
    from collections.abc import Mapping as MappingType
    from collections.abc import Sequence as SequenceType

    from lagsim.codes.known import ErrorCode


# Comparing a name with all others is slow where both are many; past these bounds a
# file is no longer one that a person mistyped.
MAX_GUESSES = 200
MAX_CANDIDATES = 2000
MAX_GUESSED_LENGTH = 80
# More faults are not reported: each carries its source line.
MAX_FAULTS = 1000
# Faults that are reported once for all uses of an unknown name.
UNKNOWN = (EXPRESSION_UNKNOWN_FUNCTION, UNKNOWN_NAME)
# Largest number of names in a list of a message.
LISTED = 12

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")


class Faults:
    """Faults found so far; hints are searched for a limited number of faults."""

    def __init__(self, file: str, found: Iterable[Problem] = ()) -> None:
        self._file = file
        self._problems = list(found)
        self._guesses = 0
        self.once: set[object] | None = None

    def add(
        self, code: ErrorCode, text: str, at: Place | Node | None, hint: str = ""
    ) -> None:
        """Add a fault at a node or place; once for members that share the place.

        code, text, hint : see `lagsim.errors.Problem`.
        """
        place = at if at is None or isinstance(at, Place) else at.place
        if self.is_known(code, place):
            return
        if self.once is not None:
            self.once.add((code, place))
        self._problems.append(Problem(code, text, place, hint))

    def __len__(self) -> int:
        return len(self._problems)

    def is_known(self, code: ErrorCode, place: Place | None) -> bool:
        """Whether this fault is already reported at the place, for another member."""
        return self.once is not None and (code, place) in self.once

    def may_guess(self) -> bool:
        """Whether a further hint may be searched; each call counts towards a limit."""
        self._guesses += 1
        return self._guesses <= MAX_GUESSES

    def guess(self, word: str, candidates: Iterable[str]) -> str:
        """Return the candidate most similar to `word`, or an empty text."""
        among = list(candidates)
        several = len(among) > MAX_CANDIDATES or len(word) > MAX_GUESSED_LENGTH
        if not self.may_guess() or several:
            return ""
        plain = hints.spelt_out(word)
        similar = (other for other in among if hints.spelt_out(other) == plain)
        return next(similar, "") or nearest(word, among)

    def did_you_mean(self, word: str, candidates: Iterable[str]) -> str:
        """Return a hint that names the candidate most similar to a word; else "".

        The hint is "" too where no further hint may be searched, see `may_guess`.
        """
        near = self.guess(word, candidates)
        return f"did you mean `{in_file(near)}`?" if near else ""

    def raise_if_any(self) -> None:
        """Raise the faults in the order of the file, the command line's first.

        Of more than MAX_FAULTS faults the rest is only counted.

        Raises
        ------
        InputError
            If any fault was added.
        """
        if not self._problems:
            return
        problems = _once(sorted(self._problems, key=self._order))
        more = len(problems) - MAX_FAULTS
        if more > 0:
            last = Problem(MORE_FAULTS, f"{more} more faults are not shown")
            problems = [*problems[:MAX_FAULTS], last]
        raise InputError(problems)

    def _order(self, problem: Problem) -> tuple[bool, int, int]:
        place = problem.place
        return (place.file == self._file, *place[1:3]) if place else (False, 0, 0)


def _once(problems: Iterable[Problem]) -> list[Problem]:
    """Return faults, with all faults on one unknown name merged into the first.

    The text of the merged fault has the number of further places.
    """
    uses: dict[tuple[str, str], list[Problem]] = {}
    for problem in problems:
        key = (problem.code, problem.text)
        own = key if problem.code in UNKNOWN else (str(id(problem)), "")
        uses.setdefault(own, []).append(problem)
    found = []
    for first, *others in uses.values():
        places = f", and {len(others)} more place{'s' * (len(others) > 1)}"
        found.append(first._replace(text=first.text + places) if others else first)
    return found


# Section -> keys that each of its entries may have and that no other section has.
KEYS_OF_ENTRIES = {
    "constraints": ("friction", "limit", "relation", "restitution", "slip", "when"),
    "events": ("at", "every", "impulse", "once", "set"),
    "states": ("rate",),
}


def belongs(key: str) -> str:
    """Return a hint on the section to which a key belongs, or an empty text."""
    if key in SECTIONS:
        return f"`{key}` belongs at the top of the file, without indentation"
    if found := next((section for section in SECTIONS if has_key(section, key)), ""):
        return f"`{key}` belongs below `{found}:`, indented"
    of = next((x for x, keys in KEYS_OF_ENTRIES.items() if key in keys), "")
    return (
        of and f"`{key}` belongs to an entry of `{of}`: {of}: {{name: {{{key}: ...}}}}"
    )


def kind_of(node: Node) -> str:
    """Return words for the kind of a YAML node in messages, such as `a list`."""
    if isinstance(node, Mapping):
        return "a mapping"
    if isinstance(node, Sequence):
        return "a list"
    if isinstance(node, Scalar) and not node.empty:
        return f"`{in_one_line(node.text)}`"
    return "nothing"


def in_one_line(text: str) -> str:
    r"""Return a text on one line, cut if it is long.

    Examples
    --------
    >>> in_one_line("a line\nbreak")
    'a line break'
    """
    words = " ".join(text.split())
    return words if len(words) <= 40 else words[:39] + "…"


def quoted_list(names: Iterable[str]) -> str:
    """Return names as a text: `a`, `b`, `c`.

    Examples
    --------
    >>> quoted_list(["a", "b"])
    '`a`, `b`'
    """
    return several((f"`{n}`" for n in names), LISTED)


def _is_given(node: Node | None) -> TypeGuard[Scalar | Mapping | Sequence]:
    """Whether a YAML node exists and could be read."""
    if isinstance(node, Scalar):
        return not node.empty
    return node is not None and not isinstance(node, Broken)


def is_mapping(node: Node) -> bool:
    """Whether a YAML node is a mapping, or empty, which counts as `{}`."""
    return isinstance(node, Mapping) or (isinstance(node, Scalar) and node.empty)


def entries(node: Node | None, label: str, faults: Faults) -> list[Entry]:
    """Return the entries of a mapping, except keys `x-...`; [] for an empty YAML node.

    Other nodes are reported.

    label : name in messages.
    """
    if isinstance(node, Mapping):
        return [e for e in node.entries if not e[0].text.startswith("x-")]
    if _is_given(node):
        text = f"{label} must be a mapping (lines `key: value`), found {kind_of(node)}"
        faults.add(NOT_A_MAPPING, text, node, hints.of_lines(node, label))
    return []


def items(node: Node | None, label: str, faults: Faults) -> list[Node]:
    """Return the items of a list; [] for an empty node; other nodes are reported.

    label : name of the list in messages.
    """
    if isinstance(node, Sequence):
        return list(node.items)
    if _is_given(node):
        text = f"{label} must be a list, found {kind_of(node)}"
        faults.add(NOT_A_LIST, text, node, hints.as_list(node, label))
    return []


def scalar_items(nodes: Iterable[Node], label: str, faults: Faults) -> Iterator[Scalar]:
    """Yield the items of a list that are scalars; other items are reported.

    label : the list's name in messages.
    """
    for node in nodes:
        if isinstance(node, Scalar):
            yield node
        elif not isinstance(node, Broken):
            faults.add(NOT_A_TEXT, f"{label}, found {kind_of(node)}", node)


@dataclass(frozen=True, slots=True)
class Fields:
    """Mapping of the file with its known and unknown keys; `label` is its name.

    `place` is its place, and `faults` the list to which faults are added.
    `found` has the entries with known keys, by key, `unknown` the other entries;
    `sound` is False where the node is no mapping.
    """

    label: str
    found: dict[str, Entry]
    place: Place
    sound: bool
    faults: Faults
    unknown: tuple[Entry, ...] = ()

    def __contains__(self, key: str) -> bool:
        """Whether the mapping has `key`."""
        return key in self.found

    def value(self, key: str) -> Node | None:
        """Return the value of `key`, or None."""
        return self.found[key][1] if key in self.found else None

    def place_of(self, key: str) -> Place:
        """Return the place of `key`, or that of the mapping."""
        return self.found[key][0].place if key in self.found else self.place

    def at(self, key: str) -> Place:
        """Return the place of the value of `key`; if absent, that of the mapping."""
        return self.found[key][1].place if key in self.found else self.place

    def needs(self, key: str, hint: str = "") -> None:
        """Report a fault, with a hint, if the mapping lacks `key`."""
        if self.sound and key not in self.found:
            text = f"{self.label} has no `{key}`"
            self.faults.add(MISSING_KEY, text, self.place, hint)

    def either(
        self, one: str, other: str, hint: str, place: Place | None = None
    ) -> bool:
        """Whether exactly one of two keys is present; else a fault is reported.

        one, other : the keys.
        hint, place : the hint and the place of the fault.
        """
        both = one in self and other in self
        if both or not (one in self or other in self):
            code: ErrorCode = BOTH_GIVEN if both else MISSING_KEY
            pair = "both `{}` and `{}`" if both else "neither `{}` nor `{}`"
            if self.sound:
                text = f"{self.label} has {pair.format(one, other)}"
                self.faults.add(code, text, place or self.place_of(other), hint)
            return False
        return True

    def choice(
        self, key: str, known: SequenceType[str], code: ErrorCode = UNKNOWN_NAME
    ) -> str:
        """Return the text of `key`, which must be one of `known`; by default the first.

        A fault with the code is reported for other texts.
        """
        name = self.text(key) or known[0]
        if name in known:
            return name
        text = f"`{key}` of {self.label} cannot be `{in_one_line(name)}`"
        near = self.faults.did_you_mean(name, known)
        hint = f"{near} known are {quoted_list(filter(None, known))}".strip()
        self.faults.add(code, text, self.at(key), hint)
        return known[0]

    def below(self, key: str, known: Collection[str]) -> Fields:
        """Return the mapping at `key`, see `fields`; an empty one without the key.

        known : the keys that the mapping may have.
        """
        node = self.value(key)
        if node is None:
            return Fields(f"`{key}`", {}, self.place, True, self.faults)
        return fields(node, f"`{key}`", known, self.faults, self.place_of(key))

    def text(self, key: str) -> str:
        """Return the plain text of `key`; an empty text by default."""
        node = self.value(key)
        if not _is_given(node):
            return ""
        if not isinstance(node, Scalar):
            text = f"`{key}` must be a text, found {kind_of(node)}"
            self.faults.add(NOT_A_TEXT, text, node)
            return ""
        if control := _CONTROL.search(node.text):
            code = f"U+{ord(control[0]):04X}"
            text = f"`{key}` contains the control character {code}"
            self.faults.add(NOT_A_TEXT, text, node.place_of(control.start()))
            return ""
        if key == "unit" and "\n" in node.text.strip():
            self.faults.add(NOT_A_TEXT, "`unit` has a line break", node)
        return node.text.strip()

    def truth(self, key: str, *, default: bool = False) -> bool:
        """Whether the value of `key` is `true`; `default` if it is absent."""
        node = self.value(key)
        if node is None or isinstance(node, Broken):
            return default
        if isinstance(node, Scalar) and node.text in ("true", "false"):
            return node.text == "true"
        text = f"`{key}` must be `true` or `false`, found {kind_of(node)}"
        self.faults.add(NOT_A_TRUTH, text, node)
        return default


def fields(
    node: Node, label: str, known: Collection[str], faults: Faults, place: Place
) -> Fields:
    """Read a mapping with known keys; unknown keys are reported.

    An unknown key similar to a known one is read as the known key, so that the known
    key is not also reported as missing.

    node, known : the mapping, and its keys.
    label : name of the mapping in messages.
    place : place of the mapping's key, for faults of the mapping as a whole.
    """
    given = entries(node, label, faults)
    found = {key.text: (key, value) for key, value in given if key.text in known}
    unknown: list[Entry] = []
    for key, value in given:
        name = key.text
        if name in known:
            continue
        hint = hints.of_key(key, value, given, known)
        given_by = value if hints.node_text(value) or not hint else Broken(key.place)
        if (
            isinstance(given_by, Broken)
            and (first := re.split(r"\W", name)[0]) in known
        ):
            near = first
        elif (written := re.match(r"write [`{](\w+): ", hint)) and written[1] in known:
            near, given_by = written[1], Broken(key.place)
        elif "relation" in known and re.search("[<>=]", name):
            near, given_by, hint = "relation", key, f"write `relation: {name}`"
        elif not (near := _called(name, value, known)):
            hint = hint or belongs(name)
            counted = name.casefold() in (*hints.COUNTS, *hints.SPANS)
            near = "" if counted else faults.guess(name, known)
        if near:
            hint = hint or f"did you mean `{near}`?"
            found.setdefault(near, (key, given_by))
        elsewhere = map(belongs, hints.KEYS.get(name.casefold(), ()))
        hint = hint or next(filter(None, elsewhere), f"known are {quoted_list(known)}")
        text = f"unknown key `{in_one_line(name)}` in {label}"
        faults.add(UNKNOWN_KEY, text, key, hint)
        unknown += [] if near else [(key, value)]
    return Fields(label, found, place, is_mapping(node), faults, tuple(unknown))


def _called(key: str, value: Node, known: Collection[str]) -> str:
    """Return the key of lagsim that a key of other programs corresponds to; else "".

    key, value : as in the file.
    known : the valid keys.
    """
    several = isinstance(value, Mapping)
    relation = isinstance(value, Scalar) and re.search("[<>=]", value.text)
    unfit = {"forces": not several, "dissipation": several, "until": not relation}
    elsewhere = hints.KEYS.get(key.casefold().replace(" ", "_"), ())
    fitting = (other for other in elsewhere if not unfit.get(other))
    return next((other for other in fitting if other in known), "")


# --- The sections of a model file: each key, its meaning, and its permitted values
#
# The table is the JSON Schema (draft-07) that editors use, `lagsim/lagsim.schema.json`.
# The reader takes the keys from it, and so do hints on misplaced keys. The options of
# methods are declared with the methods and are added to it.

Form = dict[str, Any]

FILE = Path(__file__).parents[2] / "lagsim.schema.json"
_SCHEMA: Form = json.loads(FILE.read_text(encoding="utf-8"))
SECTIONS: dict[str, Form] = _SCHEMA["properties"]


def _keys(form: Form) -> dict[str, Form]:
    """Return the known keys of a mapping in the schema, each with its form.

    Where the form permits an expression as well, the keys are those of the mapping.
    """
    forms: list[Form] = form.get("anyOf", [form])
    found: dict[str, Form] = forms[-1]["properties"]
    return found


def _keys_below(section: str) -> dict[str, Form]:
    """Return the keys, each with its form, of the entries of a section."""
    return _keys(SECTIONS[section]["additionalProperties"])


COORDINATE, VALUE = _keys_below("coordinates"), _keys_below("parameters")
DEFINITION = {key: VALUE[key] for key in VALUE if key not in ("uncertainty", "range")}
START, CONSTRAINT = _keys_below("initial"), _keys_below("constraints")
STATE, EVENT = _keys_below("states"), _keys_below("events")
FRAME, BODY = _keys_below("frames"), _keys_below("bodies")
TABLE = _keys_below("tables")
FRICTION, LIMIT = (_keys(CONSTRAINT[key]) for key in ("friction", "limit"))
# Keys of contacts alone.
CONTACT = ("restitution", "restitution_law", "friction", "slip")
ENERGY, SCENE, OUTPUT_KEYS = (
    _keys(SECTIONS[section]) for section in ("energy", "scene", "output")
)
LINK = _keys(SCENE["links"]["items"])
SHAPE = _keys(SCENE["shapes"]["additionalProperties"])
SECTION = _keys(OUTPUT_KEYS["sections"]["additionalProperties"])
PLOT = _keys(OUTPUT_KEYS["plots"]["items"])
AXES = ("x", "y", "y2")
MOST_CURVES: int = PLOT["y"]["anyOf"][1]["maxItems"]
SIMULATION = _keys(SECTIONS["simulation"]) | {
    key: {
        "type": ["number", "string"],
        "description": f"Only for the method {name}, {x.least:g} to {x.most:g}: "
        f"{x.about}.",
    }
    for key, (name, x) in options().items()
}
# The keys of `simulation` that are options of commands and arguments in Python, each
# with the placeholder of its value. Their descriptions are those of the schema.
OPTIONS = {
    "method": "M", "rtol": "X", "atol": "X", "step": "H", "formulation": "F",
    "gain": "X", **dict.fromkeys(options(), "X"), "duration": "T", "output_step": "H",
}  # fmt: skip
# Names that nothing else in a file may have; operators are none in any case.
_REFUSED: Form = SECTIONS["definitions"]["propertyNames"]["not"]["anyOf"][0]
RESERVED = tuple(name for name in _REFUSED["enum"] if name not in JOINING)


def has_key(section: str, key: str) -> bool:
    """Whether a section may have an entry with the key `key`."""
    return key in SECTIONS[section].get("properties", ())


def schema(choices: MappingType[str, Iterable[str]]) -> Form:
    """Return the JSON Schema of the model file.

    Parameters
    ----------
    choices
        For keys of `simulation` that are names, the valid names.
    """
    chosen = {
        key: {**SIMULATION[key], "enum": list(names)} for key, names in choices.items()
    }
    simulation = {**SECTIONS["simulation"], "properties": {**SIMULATION, **chosen}}
    # A table is called as a function is, and so has none of the functions' names.
    names = SECTIONS["tables"]["propertyNames"]
    refused = [*names["not"]["anyOf"][:-1], {"enum": sorted(FUNCTIONS)}]
    names = {**names, "not": {"anyOf": refused}}
    tables = {**SECTIONS["tables"], "propertyNames": names}
    sections = {**SECTIONS, "simulation": simulation, "tables": tables}
    return {**_SCHEMA, "properties": sections}
