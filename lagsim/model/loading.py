"""Read a file, and parse its text into YAML nodes with line and column.

This is the only module that uses yaml. `load` builds the nodes from the parser's
events, without recursion. Implicit types, anchors, merge keys and tags of YAML are not
used: a scalar is a text, and the others are faults. Expressions can collide with YAML's
own signs: a colon, a comma or a sign at the beginning of a value. The diagnosis of a
text that is not valid YAML names the likely mistake; a repair replaces the faulty
value, so that the rest of the file can still be read and all its faults are reported
together.
"""

from __future__ import annotations

import itertools
import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from lagsim import files, limits
from lagsim.codes.known import (
    ALIAS,
    ANCHOR,
    COMPLEX_KEY,
    DUPLICATE_KEY,
    MERGE_KEY,
    MISSING_SPACE,
    NOT_UTF8,
    SEVERAL_DOCUMENTS,
    TAG,
    TOO_DEEP,
    TOO_MANY_VALUES,
    UNREADABLE,
    YAML_CHARACTER,
    YAML_SYNTAX,
    YAML_TAB,
)
from lagsim.errors import Place, Problem, unusable
from lagsim.language.parser import ExpressionError, parse, parse_relation
from lagsim.model.nodes import (
    Broken,
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    SourceText,
)

if TYPE_CHECKING:
    from lagsim.codes.known import ErrorCode

STANDARD_INPUT = "-"
# Its name in messages.
STDIN = "<stdin>"
# Name of a model that comes from no file, and so has no folder.
TEXT = "<model>"

# A shell's `<(command)`: a pipe that is being written.
_OPEN_ALREADY = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")

MAX_DEPTH = 100
# Each repair reads the text again, so a long text gets fewer of them.
MAX_REPAIRS = 20
REPAIRED_CHARACTERS = 2_000_000

_LOADER = getattr(yaml, "CLoader", yaml.Loader)


def model_text(path: str) -> tuple[str, str]:
    """Return the text of a model file, or of standard input, and its name in messages.

    Raises
    ------
    InputError
        If the file cannot be read, is too large, or is not UTF-8.
    """
    file = STDIN if path == STANDARD_INPUT else path
    try:
        if path.startswith(_OPEN_ALREADY):
            with Path(path).open("rb") as stream:
                data = files.all_of(stream, limits.MODEL_BYTES)
        elif path == STANDARD_INPUT:
            data = files.all_of(sys.stdin.buffer, limits.MODEL_BYTES)
        else:
            data = files.content(path, limits.MODEL_BYTES)
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise unusable(UNREADABLE, f"{file}: cannot be read: {reason}") from None
    try:
        return data.decode(), file
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - data.rfind(b"\n", 0, error.start)
        message = f"not UTF-8: byte 0x{data[error.start]:02x} in line {line}"
        raise unusable(NOT_UTF8, message, Place(file, line, column)) from None


class Document(NamedTuple):
    """Root YAML node of a text, and the faults found.

    The root is None for an empty text, or one that is no YAML.
    """

    root: Node | None
    problems: tuple[Problem, ...]


def load(text: str, file: str) -> Document:
    """Parse a YAML text into YAML nodes (see `nodes`) and faults.

    Parameters
    ----------
    text
        The YAML text.
    file
        The file's name in places and messages.
    """
    original = SourceText(file, text.removeprefix("\ufeff"))
    if match := _FORBIDDEN.search(original.text):
        message = f"the character U+{ord(match[0]):04X} is not allowed in YAML"
        shown = SourceText(file, _FORBIDDEN.sub("\ufffd", original.text))
        place = shown.place(match.start())
        return Document(None, (Problem(YAML_CHARACTER, message, place),))
    source, spoilt, found = original, set[tuple[int, int]](), list[Problem]()
    repairs = max(1, min(MAX_REPAIRS, REPAIRED_CHARACTERS // (len(text) + 1)))
    reached = -1
    while True:
        builder, root = _Builder(source, spoilt), None
        try:
            root = builder.run()
            break
        except (yaml.YAMLError, ValueError, OverflowError) as error:
            diagnosis = diagnose(source, error)
        if diagnosis.line <= reached:
            break
        found.append(diagnosis.problem)
        if not diagnosis.repaired or len(found) > repairs:
            break
        reached = diagnosis.line
        spoilt.add(diagnosis.spoilt)
        source = SourceText(file, diagnosis.repaired, original)
    return Document(root, (*found, *builder.problems))


def _span(event: yaml.Event) -> tuple[int, int]:
    start, end = event.start_mark, event.end_mark
    assert start is not None
    assert end is not None
    return start.index, end.index


@dataclass(slots=True)
class _Open:
    """Mapping or list whose end has not been reached, with the YAML nodes read so far.

    `mapping` and `flow`: whether it is a mapping, and whether in brackets; `start` is
    the offset of its beginning.
    """

    mapping: bool
    flow: bool
    start: int
    parts: list[Node]


class _Builder:
    """Builder of YAML nodes from the events of the YAML parser.

    A stack has the mappings and lists whose ends have not been reached.
    """

    def __init__(self, source: SourceText, spoilt: set[tuple[int, int]]) -> None:
        self.source = source
        self.spoilt = spoilt
        self.problems: list[Problem] = []
        self.open: list[_Open] = []
        self.root: Node | None = None
        self.documents = 0
        self.nodes = 0

    def run(self) -> Node | None:
        """Return the root YAML node or None; append faults to `problems`."""
        for event in yaml.parse(self.source.text, Loader=_LOADER):
            if isinstance(event, yaml.DocumentStartEvent):
                self.documents += 1
                if self.documents > 1:
                    text = "a second document begins here"
                    hint = "a model file contains one document"
                    self._fault(SEVERAL_DOCUMENTS, text, event, hint)
                    break
            elif isinstance(event, yaml.CollectionEndEvent):
                self._close(event)
            elif isinstance(event, yaml.NodeEvent) and not self._add(event):
                return None
        return self.root

    def _fault(
        self, code: ErrorCode, text: str, where: Node | yaml.Event, hint: str = ""
    ) -> None:
        if isinstance(where, yaml.Event):
            start, end = _span(where)
            place = self.source.place(start, max(1, end - start))
        else:
            place = where.place
        self.problems.append(Problem(code, text, place, hint))

    def _add(self, event: yaml.NodeEvent) -> bool:
        """Add the YAML node that an event begins; return False past a size limit."""
        hint = "quote the value if it is an expression"
        anchor, tag = event.anchor, getattr(event, "tag", None)
        unused, start = "of YAML, which models do not use", _span(event)[0]
        if isinstance(event, yaml.AliasEvent):
            self._fault(ALIAS, f"`*{anchor}` is an alias {unused}", event)
            self._attach(Broken(self.source.place(start)))
            return True
        self.nodes += 1
        if self.nodes > limits.NODES:
            text = f"the file has more than {limits.NODES:,} values and collections"
            self._fault(TOO_MANY_VALUES, text, event)
            return False
        if anchor is not None:
            self._fault(ANCHOR, f"`&{anchor}` is an anchor {unused}", event, hint)
        if tag is not None:
            written = self.source.text[start : start + 40].split(maxsplit=1)[0]
            text = f"`{written}` is a tag {unused}"
            self._fault(TAG, text, event, f"write `not` for a negation; {hint}")
        if isinstance(event, yaml.ScalarEvent):
            self._attach(self._scalar(event, sound=anchor is None and tag is None))
            return True
        if len(self.open) >= MAX_DEPTH:
            self._fault(TOO_DEEP, f"nested deeper than {MAX_DEPTH} levels", event)
            return False
        mapping = isinstance(event, yaml.MappingStartEvent)
        flow = bool(getattr(event, "flow_style", False))
        self.open.append(_Open(mapping, flow, start, []))
        return True

    def _scalar(self, event: yaml.ScalarEvent, *, sound: bool) -> Node:
        start, end = _span(event)
        place = self.source.place(start, end - start)
        if self.source.position(start) in self.spoilt or not sound:
            return Broken(place)
        style = event.style or ""
        scalar = Scalar(event.value, place, self.source, start, end, style)
        if style in ("|", ">"):  # the text begins on the line below its header
            return scalar._replace(place=scalar.place_of(0, len(scalar.text)))
        return scalar

    def _attach(self, node: Node) -> None:
        if self.open:
            self.open[-1].parts.append(node)
        elif self.root is None:
            self.root = node

    def _close(self, event: yaml.Event) -> None:
        top = self.open.pop()
        place = self.source.place(top.start, _span(event)[1] - top.start)
        parts = self._joined(top.parts, top.mapping) if top.flow else top.parts
        if top.mapping:
            self._attach(Mapping(self._entries(parts), place))
        else:
            self._attach(Sequence(tuple(parts), place))

    def _entries(self, parts: list[Node]) -> tuple[Entry, ...]:
        found: dict[str, Entry] = {}
        for given, below in zip(parts[::2], parts[1::2], strict=True):
            key, value = self._unspaced(given, below)
            if isinstance(key, Broken):
                continue
            if not isinstance(key, Scalar):
                self._fault(COMPLEX_KEY, "a key must be a plain text", key)
            elif key.text == "<<" and not key.style:
                text = "`<<` is a merge key of YAML, which models do not use"
                self._fault(MERGE_KEY, text, key)
            elif key.text in found:
                first, above = found[key.text]
                text = f"the key `{key.text}` is given twice"
                hint = f"the first is in line {first.place.line}"
                self._fault(DUPLICATE_KEY, text, key, hint)
                if isinstance(above, Mapping) and isinstance(value, Mapping):
                    # as one mapping, so that all names in both are known
                    both = Mapping(above.entries + value.entries, above.place)
                    found[key.text] = first, both
            else:
                found[key.text] = key, value
        return tuple(found.values())

    def _unspaced(self, key: Node, value: Node) -> tuple[Node, Node]:
        """Split a key such as `theta:1`, which lacks the space of YAML after the colon.

        Return key and value; unchanged if there is no such colon.
        """
        alone = isinstance(value, Scalar) and value.empty
        if not (alone and isinstance(key, Scalar)) or key.style:
            return key, value
        match = re.match(_NO_SPACE, key.text)
        if match is None:
            return key, value
        name, rest = match["key"], key.text[match.start("value") :]
        text = f"a space is missing after the colon in `{key.text}`"
        self._fault(MISSING_SPACE, text, key, f"write `{name}: {rest}`")
        place = key.place_of(0, len(name))
        return key._replace(text=name, place=place), Broken(key.place)

    # Expressions that a comma has split, between the braces and brackets of YAML

    def _joined(self, parts: list[Node], mapping: bool) -> list[Node]:
        """Return keys and values in turn, or items, with calls joined that YAML split.

        `[min(0,4*N, 1)]` is a list of two items for YAML.

        mapping : whether parts are keys and values.
        """
        whole: list[Node] = []
        step, i = 1 + mapping, 0
        while i < len(parts):
            keys = _keys(parts, i) if mapping else []
            i += max(0, len(keys) - 1) * step
            pieces = _pieces(parts, i + mapping, step)
            whole += [self._in_one(keys)] if len(keys) > 1 else keys
            whole.append(self._in_one(pieces) if len(pieces) > 1 else pieces[0])
            i += step * len(pieces)
        return whole

    def _in_one(self, pieces: list[Scalar]) -> Scalar:
        start, end, text = pieces[0].start, pieces[-1].end, pieces[0].text
        place = self.source.place(start, end - start)
        for before, piece in itertools.pairwise(pieces):
            text += ("," if _is_decimal(before, piece) else ", ") + piece.text
        return Scalar(text, place, self.source, start, end)


def _keys(parts: list[Node], i: int) -> list[Any]:
    """Return the parts of key i that YAML split at commas, up to its parenthesis.

    YAML splits the key `c(i = 1..2, j = 1..3)` at its comma.

    parts : keys and values in turn.
    """
    keys, depth = [parts[i]], _left_open(parts[i])
    while depth > 0 and i + 2 < len(parts):
        value, key = parts[i + 1 : i + 3]
        if not (isinstance(value, Scalar) and value.empty and isinstance(key, Scalar)):
            break
        keys.append(key)
        depth += _left_open(key)
        i += 2
    return keys if depth == 0 else keys[:1]


def _pieces(parts: list[Node], i: int, step: int) -> list[Any]:
    """Return the parts of a call that YAML split at commas, from part i on.

    parts : keys and values in turn (step 2), or items (step 1).
    """
    pieces, depth = [parts[i]], _left_open(parts[i])
    for j in range(i + 1, len(parts), step):
        piece, value = parts[j], parts[j + step - 1]
        if not isinstance(piece, Scalar) or piece.style:
            break
        if step == 2 and not (isinstance(value, Scalar) and value.empty):
            break
        if depth <= 0 and not (step == 2 and _is_decimal(pieces[-1], piece)):
            break
        pieces.append(piece)
        depth += _left_open(piece)
    return pieces


def _is_decimal(before: Node, piece: Scalar) -> bool:
    """Whether the comma between two parts is a decimal comma: between digits.

    before, piece : the parts before and after the comma.
    """
    if not isinstance(before, Scalar) or piece.start != before.end + len(","):
        return False
    return before.text[-1:].isdecimal() and piece.text[:1].isdecimal()


def _left_open(part: Node) -> int:
    if not isinstance(part, Scalar) or part.style:
        return 0
    return part.text.count("(") - part.text.count(")")


# --- Diagnosis of texts that are not YAML, and their repair

_FORBIDDEN = re.compile(
    "[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
)
# Compiled on first use, since only faulty files need these patterns.
_ENTRY = (
    r"(?P<lead>\s*(?:-\s+)*)(?P<key>[^\s:#{}\[\],'\"|>@`%&*!?][^:{}\[\]]*?)\s*:\s+"
    r"(?P<value>\S.*)"
)
_ITEM = r"(?P<lead>\s*(?:-\s+)+)(?P<value>\S.*)"
_NO_SPACE = (
    r"\s*(?:-\s+)*(?P<key>[^\s:#{}\[\],'\"]+):(?P<value>[^\s:](?:\S| (?![#\s]|\w+:))*)"
)
_EQUALS = r"\s*(?:\w+\s+)*(?P<key>\w+)\s*:?=\s*(?P<value>[^:=;]+);?$"
# Meaning of a sign at the beginning of a value; without one it is not allowed there.
_BEGINS = {
    "|": "a block of text", ">": "a block of text", "*": "an alias", "&": "an anchor",
    "!": "a tag", "-": "an item of a list", "?": "a key",
    "%": "", "@": "", "`": "", ",": "",
}  # fmt: skip
_ONE_COLUMN = "the keys of one section begin in the same column"

# Line and column, both counted from 0.
At = tuple[int, int]


class Diagnosis(NamedTuple):
    """Fault that stopped the YAML parser, with its place; `line` counts from 0.

    `repaired` is the text in which a placeholder at `spoilt` (line, column) replaces
    the faulty value; empty where no repair is possible.
    """

    problem: Problem
    line: int
    repaired: str = ""
    spoilt: At = (0, 0)


def diagnose(source: SourceText, error: Exception) -> Diagnosis:
    """Return the diagnosis of a syntax error that the YAML parser raised."""
    case = _Case(source, error)
    for rule in (
        _tab, _joined_dash, _missing_space, _unfinished, _second_colon, _indentation,
        _beginning, _ending,
    ):  # fmt: skip
        found = rule(case)
        if found is not None:
            return found
    return case.fault(f"this is not YAML: {case.problem}")


class _Case:
    """Syntax error: the message of the YAML parser, and where it stopped.

    Attributes
    ----------
    line, character : str
        The line in which the parser stopped, and the character before which it stopped.
    indent : int
        The count of blanks at the beginning of the line.
    above : int
        The number of the last non-blank line above.
    first_key : bool
        Whether the parser stopped at the first colon of its line, and the line is not
        the first one.
    entry : re.Match or None
        The entry or item in whose value the parser stopped.
    """

    def __init__(self, source: SourceText, error: Exception) -> None:
        self.source = source
        self.problem = getattr(error, "problem", None) or str(error)
        self.context = getattr(error, "context", None) or ""
        self.context_at = self._inside(getattr(error, "context_mark", None))
        self.at = self._inside(getattr(error, "problem_mark", None)) or (0, 0)
        number, column = self.at
        self.line = line = source.lines[number]
        self.character = line[column : column + 1]
        self.indent = len(line) - len(line.lstrip())
        self.above = self._filled(number - 1)
        first = ":" not in line[:column] and self.character == ":" and number > 0
        self.first_key = first and "mapping values" in self.problem
        entry = re.match(_ENTRY, line) or re.match(_ITEM, line)
        self.entry = entry if entry and column >= entry.start("value") else None

    def _filled(self, number: int) -> int:
        """Return the index of the last non-blank line up to line `number`."""
        while number > 0 and not self.source.lines[number].strip():
            number -= 1
        return number

    def _inside(self, mark: yaml.Mark | None) -> At | None:
        """Return the position of a YAML mark, moved into a line that is not blank.

        None without a mark.
        """
        if mark is None:
            return None
        last = min(mark.line, len(self.source.lines) - 1)
        number = self._filled(last)
        end = len(self.source.lines[number])
        return number, min(mark.column, end) if number == last else end

    def fault(
        self,
        text: str,
        hint: str = "",
        at: At | None = None,
        *,
        length: int = 1,
        code: ErrorCode = YAML_SYNTAX,
    ) -> Diagnosis:
        """Return a diagnosis with the text of its message and a hint.

        at : line and column; by default where the parser stopped.
        length : the length of the marked text.
        """
        line, column = at or self.at
        place = self.source.place(self.source.starts[line] + column, length)
        return Diagnosis(Problem(code, text, place, hint), line)

    def set_aside(self, text: str, hint: str = "", at: At | None = None) -> Diagnosis:
        """Return a diagnosis; its repaired YAML has a placeholder for the faulty value.

        text, hint, at : the message, its hint and its place, see `fault`.
        """
        found, entry = self.fault(text, hint, at), self.entry
        if entry is None:
            return found
        number, column = self.at[0], entry.start("value")
        lines = [*self.source.lines]
        dropped = [lines[number][column:]]
        lines[number] = lines[number][:column] + "_"
        for i in range(number + 1, len(lines)):
            inside = len(lines[i]) - len(lines[i].lstrip()) > len(entry["lead"])
            if lines[i].strip() and not inside:
                break
            dropped.append(lines[i])
            lines[i] = ""
        if not _is_balanced("\n".join(dropped)):
            return found
        return found._replace(repaired="\n".join(lines), spoilt=(number, column))


def _is_balanced(text: str) -> bool:
    return all(text.count(a) == text.count(b) for a, b in ("{}", "[]"))


def _tab(case: _Case) -> Diagnosis | None:
    blank = case.line[: case.indent]
    if "\t" not in blank and case.character != "\t":
        return None
    at = case.at[0], blank.index("\t") if "\t" in blank else case.at[1]
    text = "a tab is used where YAML expects spaces"
    return case.fault(text, "indent with spaces", at, code=YAML_TAB)


def _joined_dash(case: _Case) -> Diagnosis | None:
    """Diagnose a list item without a space after the dash; else None."""
    found = re.match(r"(\s*)-([^\s\d.-].*:.*)", case.line)
    if found is None:
        return None
    text, at = "a blank is missing after `-`", (case.at[0], len(found[1]))
    hint = f"write `- {found[2].strip()}`"
    return case.fault(text, hint, at, code=MISSING_SPACE)


def _missing_space(case: _Case) -> Diagnosis | None:
    if "simple key" in case.context and case.context_at:
        number = case.context_at[0]
    elif case.first_key:
        number = case.above
    else:
        return None
    line = case.source.lines[number]
    match = re.match(_NO_SPACE, line) or re.match(_EQUALS, line)
    if match is None:
        return None
    key, value = match["key"], match["value"].rstrip()
    found = line[match.start("key") : match.start("value") + len(value)]
    text = f"a space is missing after the colon in `{found}`"
    if "=" in found:
        text = f"a colon is missing in `{found}`"
    at, hint = (number, match.start("key")), f"write `{key}: {value}`"
    fault = case.fault(text, hint, at, length=len(found), code=MISSING_SPACE)
    lines = [*case.source.lines]
    lines[number] = line[: match.end("key")] + ": _"
    spoilt = number, match.end("key") + 2
    return fault._replace(repaired="\n".join(lines), spoilt=spoilt)


def _unfinished(case: _Case) -> Diagnosis | None:
    """Diagnose a key without colon, or a quote or bracket never closed; else None."""
    context, at = case.context, case.context_at
    if at is None:
        return None
    rest = case.source.lines[at[0]][at[1] :]
    if "simple key" in context:
        found, two_words = rest.strip(), re.match(r"(\w+)\s+([^:]+)\Z", rest.strip())
        text = f"expected `key: value`, found `{found[:40]}`"
        hint = (
            f"a colon is missing: `{two_words[1]}: {two_words[2]}`" if two_words else ""
        )
        return case.fault(text, hint, at=at, length=len(found))
    if "quoted scalar" in context:
        if "end of stream" in case.problem or "document" in case.problem:
            return case.fault("this quote is never closed", at=at)
        text = "this is no escape of YAML's double quotes"
        return case.set_aside(text, "use single quotes")
    bracket, closed = rest[:1], at[0] == case.at[0] and _is_balanced(rest)
    if "parsing a flow" not in context or bracket not in ("{", "[") or closed:
        return None
    expected = "`,` or `}`" if bracket == "{" else "`,` or `]`"
    hint = f"line {case.at[0] + 1} has something else where {expected} is expected"
    return case.fault(f"this `{bracket}` is not closed", hint, at)


def _second_colon(case: _Case) -> Diagnosis | None:
    if case.character != ":" or case.entry is None:
        return None
    hint = "give each entry its own line or comma; a text with a colon must be quoted"
    first, *more = re.split(r",\s*(?=\w+:\s)", case.entry["value"].strip(" }"))
    keys = "value|unit|description|guess|relation|restitution|friction|slip|limit|when"
    pairs = [part for part in (first, *more) if re.match(rf"(?:{keys}):\s", part)]
    if more and len(pairs) == len(more) and ":" not in first:
        key = "relation" if re.search("[<>=]", first) else "value"
        pairs = [f"{key}: {first}", *more]
    if len(pairs) == len(more) + 1 and not re.search("[{}]", "".join(pairs)):
        hint = f"write `{case.entry['key']}: {{{', '.join(pairs)}}}`"
    return case.set_aside("a second `:` in one entry", hint)


def _indentation(case: _Case) -> Diagnosis | None:
    if case.first_key:
        line = case.source.lines[case.above]
        above = line.strip()
        if ":" not in above:
            text = f"a colon is missing after `{above[:40]}`"
            hint = f"write `{above[:40]}:`"
            two_words = re.fullmatch(r"(\w+)\s+(\S.*)", above)
            if two_words and case.indent <= len(line) - len(line.lstrip()):
                hint = f"a colon is missing: `{two_words[1]}: {two_words[2]}`"
            at = case.above, line.index(above)
            return case.fault(text, hint, at, length=len(above))
        text = f"this line is indented as if it belonged to `{above[:40]}`, "
        text += "which has a value already"
    else:
        ended = ("expected key", "block end", "document start", "'-' indicator")
        if case.at[1] > case.indent or not any(w in case.problem for w in ended):
            return None
        text = "this line belongs to no section above it"
        number = case.above if "'-' indicator" in case.problem else case.at[0]
        line = case.source.lines[number]
        item = re.fullmatch(r"(\s*)- *(\w+:\s.*)", line)
        if item and ("key" in case.problem or re.match(_ENTRY, case.line)):
            hint = f"write `{item[2].strip()}`, without the `-` of a list"
            return case.fault(text, hint, (number, len(item[1])))
    return case.fault(text, _ONE_COLUMN, (case.at[0], case.indent))


def _beginning(case: _Case) -> Diagnosis | None:
    """Diagnose a value that begins with a sign reserved by YAML; else None."""
    entry, at = case.entry, case.at[1]
    if entry is not None and entry["value"][0] in "|>*&!":
        at = entry.start("value")
    sign = case.line[at : at + 1]
    if sign not in _BEGINS:
        return None
    label, named = _BEGINS[sign], "a backquote" if sign == "`" else f"`{sign}`"
    text = f"{named} cannot begin a value in YAML"
    if label:
        text = f"`{sign}{' ' * (sign in '-?')}` begins {label} in YAML"
    hint = "quote the value"
    if entry is not None and "{" not in entry["value"] and "#" not in entry["value"]:
        quoted = entry["value"].strip().replace('"', "'")
        hint += f': "{quoted}"'
        if quoted[:1] == "|" and quoted.count("|") % 2 == 0:
            hint = "write " + re.sub(r"\|+([^|]+)\|+", r"abs(\1)", quoted)
        elif not _is_expression(quoted):
            hint += f" if it is a text; an expression begins without `{sign}`"
    return case.set_aside(text, hint, (case.at[0], at))


def _is_expression(text: str) -> bool:
    """Whether a text would be an expression or a relation if it were quoted."""
    for parser in (parse, parse_relation):
        with suppress(ExpressionError):
            return bool(parser(text))
    return False


def _ending(case: _Case) -> Diagnosis | None:
    """Diagnose text after the end of a value or collection; else None."""
    if case.entry is not None and case.entry["value"][0] in "'\"":
        text = "something follows the closing quote"
        return case.set_aside(text, "quote the whole value")
    if case.character and case.character in "}]":
        return case.set_aside(f"`{case.character}` closes nothing")
    if "parsing a flow" not in case.context:
        return None
    closer = "]" if "sequence" in case.context else "}"
    hint = "an expression in braces is best quoted"
    return case.set_aside(f"expected `,` or `{closer}`", hint)
