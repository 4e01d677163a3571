"""Sections: mappings with known keys, mappings with names of the user's, texts.

What a key is for and what may stand there is said once, as its part of a JSON Schema:
a table of keys is a mapping of each to that. Reading asks it for the keys alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lagsim.model.nodes import Broken, Mapping, Node, Scalar, Sequence

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable
    from collections.abc import Mapping as MappingType

    from lagsim.errors import Place
    from lagsim.model.reader.faults import Faults

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
        return "" if node is None else text_of(node, f"`{key}`", faults)

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
    from lagsim.model.reader import quantities, spellings

    if key.casefold() in spellings.SPANS:
        return quantities.span(value) or "write `start: ...` and `end: ...`"
    if key.casefold() not in spellings.COUNTS:
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
