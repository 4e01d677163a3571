"""Faults of a file, and its sections: known keys, names of the user's, texts.

What a key is for and what may stand there is said once, as its part of a JSON Schema:
a table of keys is a mapping of each to that. Reading asks it for the keys alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from lagsim.errors import InputError, Problem
from lagsim.model.nodes import Broken, Mapping, Node, Scalar, Sequence

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable
    from collections.abc import Mapping as MappingType

    from lagsim.errors import Place
    from lagsim.language.parser import ExpressionError


# Comparing a name with all others is slow where both are many; past these bounds a
# file is no longer one that a person mistyped.
MAX_GUESSES = 200
MAX_CANDIDATES = 2000
MAX_GUESSED_LENGTH = 80

# Nobody reads more, and each carries its source line.
MAX_FAULTS = 1000


def _argument(text: str) -> str:
    """Give what stands in the parentheses that a text begins with."""
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if letter == ")" and depth <= 0:
            return text[:k].strip().removeprefix("(").strip()
    return text.strip().removeprefix("(").strip()


class Faults:
    """The faults found so far; `sections` tells which keys stand where."""

    def __init__(
        self,
        file: str,
        found: Iterable[Problem] = (),
        sections: MappingType[str, dict[str, Any]] | None = None,
    ) -> None:
        self._file = file
        self._sections = sections or {}
        self._problems = list(found)
        self._guesses = 0

    def add(self, code: str, text: str, place: Place | None, hint: str = "") -> None:
        """Add a fault."""
        self._problems.append(Problem(code, text, place, hint))

    def add_expression(
        self,
        fault: ExpressionError,
        scalar: Scalar,
        known: Collection[str],
        *,
        beside: bool = False,
        relation: bool = False,
    ) -> None:
        """Add a fault of the expression in `scalar`.

        Parameters
        ----------
        fault
            The fault.
        scalar
            The text.
        known
            The variables of the file.
        beside
            A unit may stand beside this expression.
        relation
            It is a relation.
        """
        from lagsim.model.reader import suggestions

        place = scalar.place_of(fault.offset, fault.length)
        text, end = scalar.text, fault.offset + fault.length
        token = text[fault.offset : end]
        hint = ""
        if relation:
            hint = suggestions.IN_RELATIONS.get(token, "")
            if text.rstrip().endswith("="):
                hint = f"write {text.strip()} 0"
        hint = hint or self.meant(scalar, fault.offset, known, beside=beside)
        if not hint and fault.code == "unknown-function":
            argument = _argument(text[end:])
            hint = suggestions.of_function(token, argument, known)
            hint = hint or fault.hint or "a function of your own is a definition"
        if not hint and "a comparison is" in fault.text:
            hint = suggestions.of_comparison(text, fault.offset)
        hint = hint or suggestions.without_guesses(fault.hint, token, known)
        self.add(f"expression-{fault.code}", fault.text, place, hint)

    def meant(
        self,
        scalar: Scalar,
        offset: int,
        known: Collection[str],
        *,
        beside: bool = False,
    ) -> str:
        """Give a hint from what stands around a fault; `known` are the variables."""
        from lagsim.model.reader import suggestions

        self._guesses += 1
        if self._guesses > MAX_GUESSES:
            return ""
        return suggestions.of_text(scalar.text, offset, known, beside=beside)

    def belongs(self, key: str, *, otherwise: bool = False) -> str:
        """Give a hint where in the file a key stands, if it does elsewhere.

        `otherwise`: or one that it is a name for elsewhere.
        """
        if otherwise:
            from lagsim.model.reader.suggestions import KEYS

            found = (self.belongs(other) for other in KEYS.get(key.casefold(), ()))
            return next(filter(None, found), "")
        if key in self._sections:
            return f"`{key}` belongs at the top of the file, without indentation"
        for name, form in self._sections.items():
            if key in form.get("properties", ()):
                return f"`{key}` belongs below `{name}:`, indented"
        return ""

    def guess(self, word: str, candidates: Iterable[str]) -> str:
        """Give the candidate most like `word`, or an empty text."""
        candidates = list(candidates)
        self._guesses += 1
        if (
            self._guesses > MAX_GUESSES
            or len(candidates) > MAX_CANDIDATES
            or len(word) > MAX_GUESSED_LENGTH
        ):
            return ""
        from lagsim.model.reader import suggestions

        plain = suggestions.spelt_out(word)
        for candidate in candidates:
            if suggestions.spelt_out(candidate) == plain:
                return candidate
        return (get_close_matches(word, candidates, 1) or [""])[0]

    def called(self, key: str, known: Collection[str]) -> str:
        """Give the key that is called otherwise elsewhere, or is most like this one."""
        from lagsim.model.reader.suggestions import COUNTS, KEYS, SPANS

        if key.casefold() in (*COUNTS, *SPANS):
            return ""
        for other in KEYS.get(key.casefold().replace(" ", "_"), ()):
            if other in known:
                return other
        return self.guess(key, known)

    def did_you_mean(self, word: str, candidates: Iterable[str]) -> str:
        """Give a hint that names the candidate most like `word`, or no hint."""
        near = self.guess(word, candidates)
        return f"did you mean `{near}`?" if near else ""

    def raise_if_any(self) -> None:
        """Raise them all, in the order of the file; those of the command line first.

        Raises
        ------
        InputError
            If any fault was added.
        """
        if not self._problems:
            return
        problems = sorted(self._problems, key=self._order)
        more = len(problems) - MAX_FAULTS
        if more > 0:
            last = Problem("more-faults", f"{more} more faults are not shown")
            problems = [*problems[:MAX_FAULTS], last]
        raise InputError(problems)

    def _order(self, problem: Problem) -> tuple[bool, int, int]:
        place = problem.place
        if place is None:
            return False, 0, 0
        return place.file == self._file, place.line, place.column


Entry = tuple[Scalar, Node]
Form = dict[str, Any]

EXPRESSION: Form = {"type": ["number", "string"]}
PLAIN: Form = {"type": ["string", "number", "boolean", "null"]}
TRUTH: Form = {"type": "boolean"}
IGNORED: Form = {"patternProperties": {"^x-": {}}}

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_EQUALS = re.compile(r"(\w+)\s*=\s*([^=\s].*)")
_NUMBER = re.compile(r"\d[\d.]*")
_NO_COLON = re.compile(r"([^\W\d_]\w*)\s+([^\s:=]+)")
_LISTED = re.compile(r"[^\W\d_]\w*(?:\s*,\s*[^\W\d_]\w*)*")
_VERSUS = re.compile(r"(\w+) (?:vs\.?|versus|over|against) (\w+)")
_NO_SPACE = re.compile(r"([^\s:]+):([^\s:]\S*)")

# Of a list of names a message shows so many.
LISTED = 12


def described(about: str, form: Form) -> Form:
    """Give the form of what stands at a key, with what it is for."""
    return {**form, "description": about}


def either(*forms: Form) -> Form:
    """Give the form of what has one of these."""
    return {"anyOf": list(forms)}


def listing(form: Form, least: int = 0, most: int | None = None) -> Form:
    """Give the form of a list of so many."""
    bound = {} if most is None else {"maxItems": most}
    return {"type": "array", "items": form, "minItems": least, **bound}


def keyed(keys: MappingType[str, Form], required: Collection[str] = ()) -> Form:
    """Give the form of a mapping with known keys."""
    return {
        "type": "object" if required else ["object", "null"],
        "properties": dict(keys),
        **IGNORED,
        "additionalProperties": False,
        "required": list(required),
    }


def kind_of(node: Node) -> str:
    """Say what a node is, for messages."""
    if isinstance(node, Mapping):
        return "a mapping"
    if isinstance(node, Sequence):
        return "a list"
    if isinstance(node, Scalar) and not node.empty:
        return f"`{shortened(node.text)}`"
    return "nothing"


def shortened(text: str) -> str:
    """Give a text in one short line."""
    words = " ".join(text.split())
    return words if len(words) <= 40 else words[:39] + "…"


def entries(node: Node, what: str, faults: Faults) -> list[Entry]:
    """Give the entries of a mapping without the `x-` ones; nothing counts as `{}`."""
    if isinstance(node, Mapping):
        return [e for e in node.entries if not e[0].text.startswith("x-")]
    if isinstance(node, Broken) or (isinstance(node, Scalar) and node.empty):
        return []
    hint = _of_lines(node, what)
    faults.add(
        "not-a-mapping",
        f"{what} must be a mapping (lines `key: value`), found {kind_of(node)}",
        node.place,
        hint,
    )
    return []


def _of_lines(node: Node, what: str) -> str:
    """Give a hint where something else stands for a mapping."""
    if what == "`coordinates`" and (names := _names_of(node)):
        return f"write {{{', '.join(f'{name}: {{}}' for name in names)}}}"
    if what == "a plot" and len(names := _names_of(node)) in (1, 2):
        return f"write {{x: {names[0] if names[1:] else 't'}, y: {names[-1]}}}"
    if what == "a plot" and (shown := _VERSUS.fullmatch(kind_text(node))):
        return f"write {{x: {shown[2]}, y: {shown[1]}}}"
    if what.startswith("the coordinate") and len(unit := _names_of(node)) == 1:
        return f"write {{unit: {unit[0]}}}"
    if isinstance(node, Sequence):
        return "write lines `name: value`, without the `-` or brackets of a list"
    text = node.text if isinstance(node, Scalar) else ""
    if what == "`constraints`" and "=" in text:
        return f"write `name: {text}`, with a name of your own"
    if match := _EQUALS.match(text):
        return f"a colon is missing: `{match[1]}: {match[2]}`"
    if match := _NO_SPACE.match(text):
        return f"a space is missing after the colon: `{match[1]}: {match[2]}`"
    if match := _NO_COLON.fullmatch(text):
        return f"a colon is missing: `{match[1]}: {match[2]}`"
    return ""


def _names_of(node: Node) -> list[str]:
    """Give the names of a list, with brackets or without; none where it is another."""
    text = node.text if isinstance(node, Scalar) else ""
    if isinstance(node, Sequence):
        text = ",".join(i.text if isinstance(i, Scalar) else "?" for i in node.items)
    found = text.split(",") if _LISTED.fullmatch(text) else []
    return [name.strip() for name in found]


def as_list(node: Node, what: str = "") -> str:
    """Say how what stands for a list is written as one."""
    if isinstance(node, Mapping):
        pairs = [(key.text, kind_text(value)) for key, value in node.entries]
        if not any(text for _, text in pairs):
            return f"write [{', '.join(key for key, _ in pairs)}]"
        if "link" in what:
            links = ", ".join(f"[{a}, {b}]" for a, b in pairs)
            return f"write [{links}]" if what == "`links`" else f"write {links}"
        return f"write [{{{', '.join(f'{a}: {b}' for a, b in pairs)}}}]"
    text = node.text.strip() if isinstance(node, Scalar) else ""
    if text == "all":
        return "delete it: all are there without it"
    if text[:1] + text[-1:] in ("()", "[]"):
        text = text[1:-1]
    return f"write [{' '.join(text.split())}]" if text else "a list is written [a, b]"


def kind_text(node: Node) -> str:
    """Give the text of a scalar, of a list of them, or dots."""
    if isinstance(node, Sequence):
        return ", ".join(map(kind_text, node.items))
    return node.text if isinstance(node, Scalar) else "..."


def items(node: Node, what: str, faults: Faults) -> list[Node]:
    """Give the items of a list; nothing counts as an empty one."""
    if isinstance(node, Sequence):
        return list(node.items)
    if isinstance(node, Broken) or (isinstance(node, Scalar) and node.empty):
        return []
    text = f"{what} must be a list, found {kind_of(node)}"
    faults.add("not-a-list", text, node.place, as_list(node, what))
    return []


def text_of(node: Node, what: str, faults: Faults) -> str:
    """Give a plain text; an empty one where there is none."""
    if isinstance(node, Broken) or (isinstance(node, Scalar) and node.empty):
        return ""
    if not isinstance(node, Scalar):
        text = f"{what} must be a text, found {kind_of(node)}"
        faults.add("not-a-text", text, node.place)
        return ""
    control = _CONTROL.search(node.text)
    if control is not None:
        code = f"U+{ord(control.group()):04X}"
        text = f"{what} contains the control character {code}"
        faults.add("not-a-text", text, node.place_of(control.start()))
        return ""
    return node.text.strip()


@dataclass(frozen=True, slots=True)
class Fields:
    """A mapping whose keys are known; `sound` is False where it could not be read."""

    found: dict[str, Entry]
    place: Place
    sound: bool

    def __contains__(self, key: str) -> bool:
        """Tell whether the key is there."""
        return key in self.found

    def value(self, key: str) -> Node | None:
        """Give the value of `key`, or None."""
        entry = self.found.get(key)
        return entry[1] if entry else None

    def place_of(self, key: str) -> Place:
        """Give the place of `key`, or that of the mapping."""
        entry = self.found.get(key)
        return entry[0].place if entry else self.place

    def text(self, key: str, faults: Faults) -> str:
        """Give the plain text of `key`."""
        node = self.value(key)
        if node is None:
            return ""
        text = text_of(node, f"`{key}`", faults)
        if key == "unit" and "\n" in text:
            faults.add("not-a-text", "`unit` has a line break", node.place)
        return text

    def truth(self, key: str, faults: Faults, *, default: bool = False) -> bool:
        """Give whether the value of `key` is `true`; `default` where there is none."""
        node = self.value(key)
        if node is None or isinstance(node, Broken):
            return default
        if isinstance(node, Scalar) and node.text in ("true", "false"):
            return node.text == "true"
        text = f"`{key}` must be `true` or `false`, found {kind_of(node)}"
        faults.add("not-a-truth", text, node.place)
        return default


def fields(
    node: Node, what: str, known: Iterable[str], faults: Faults, place: Place
) -> Fields:
    """Read a mapping whose keys are known; an unknown one is a fault.

    An unknown key that looks like a known one is read as that, so that what it says
    is not also reported as missing.

    Parameters
    ----------
    node, what
        The mapping, and how messages call it.
    known
        The keys it may have.
    faults
        Where faults go.
    place
        Where faults of the mapping as a whole are reported: its key.
    """
    known = tuple(known)
    given = entries(node, what, faults)
    found = {key.text: (key, value) for key, value in given if key.text in known}
    for key, value in given:
        if key.text in known:
            continue
        near = faults.called(key.text, known)
        hint = f"did you mean `{near}`?" if near else f"known are {listed(known)}"
        hint = faults.belongs(key.text) or hint
        if not near:
            hint = faults.belongs(key.text, otherwise=True) or hint
        if _NUMBER.fullmatch(key.text):
            hint = _of_number(key, given)
        if "output_step" in known:
            hint = _of_times(key.text, value, given) or hint
        text = f"unknown key `{shortened(key.text)}` in {what}"
        faults.add("unknown-key", text, key.place, hint)
        if near:
            found.setdefault(near, (key, value))
    sound = isinstance(node, Mapping) or (isinstance(node, Scalar) and node.empty)
    return Fields(found, place, sound)


def _of_times(key: str, value: Node, given: list[Entry]) -> str:
    """Give a hint where a count, or a pair of times, stands for a key of times."""
    from lagsim.model.reader import quantities, suggestions

    if key.casefold() in suggestions.SPANS:
        return quantities.span(value) or "write `start: ...` and `end: ...`"
    if key.casefold() not in suggestions.COUNTS:
        return ""
    texts = {k.text: v.text for k, v in given if isinstance(v, Scalar)}
    length = texts.get("duration", texts.get("end", "duration"))
    if "start" in texts and "duration" not in texts:
        length = f"({length} - {texts['start']})"
    length = "1" if key.casefold() == "fps" else length
    return f"write `output_step: {length}/{kind_text(value)}`: the spacing of the rows"


def is_odd(root: Node, sections: Collection[str]) -> bool:
    """Tell whether keys stand beside sections that are none, or sections in them."""
    entries = root.entries if isinstance(root, Mapping) else ()
    return any(
        key.text not in sections
        or (
            isinstance(value, Mapping)
            and any(k.text in sections for k, _ in value.entries)
        )
        for key, value in entries
    )


def _of_number(key: Scalar, given: list[Entry]) -> str:
    """Give a hint where a number stands for a key: 1,5 or {1, unit: m}."""
    place = [entry[0] for entry in given].index(key)
    from lagsim.model.reader import quantities

    if hint := quantities.split_by_comma(key):
        return hint
    after = given[place + 1][0].text if place + 1 < len(given) else ""
    unit = after if quantities.is_unit(after) else "..."
    return f"write {{value: {key.text}, unit: {unit}}}"


def listed(names: Iterable[str]) -> str:
    """Give names as a text: `a`, `b`, `c`."""
    names = list(names)
    text = ", ".join(f"`{n}`" for n in names[:LISTED])
    return text + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")
