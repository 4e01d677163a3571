"""A file -> its text -> nodes of YAML with line and column; the only user of yaml.

`load` builds the nodes from the parser's events, without recursion. What YAML would
guess (types, anchors, merge keys, tags) is not guessed: a scalar is a text, and the
rest are faults. Common mistakes with expressions are diagnosed; where the line
can be set aside the rest of the file is still read, so that all faults come at once.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import yaml

from lagsim import files, limits
from lagsim.errors import InputError, Place, Problem
from lagsim.model.diagnosis import bad_character, diagnose, unspaced
from lagsim.model.nodes import (
    Broken,
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    Source,
    Span,
)

STANDARD_INPUT = "-"
# What it is called.
STDIN = "<stdin>"

# Where a shell's `<(command)` is: a pipe, and somebody writes into it.
_OPEN_ALREADY = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")

MAX_DEPTH = 100
# Each repair reads the text again, so a long text gets fewer of them.
MAX_REPAIRS = 20
REPAIRED_CHARACTERS = 2_000_000

_LOADER = getattr(yaml, "CLoader", yaml.Loader)


def text_of(path: str) -> tuple[str, str]:
    """Give the text of a model file, or of standard input, and what to call it.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    file = STDIN if path == STANDARD_INPUT else path
    try:
        if path == STANDARD_INPUT:
            data = files.all_of(sys.stdin.buffer, limits.MODEL_BYTES)
        elif path.startswith(_OPEN_ALREADY):
            with Path(path).open("rb") as stream:
                data = files.all_of(stream, limits.MODEL_BYTES)
        else:
            data = files.content(path, limits.MODEL_BYTES)
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise unusable("unreadable", f"cannot be read: {reason}", file) from None
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - (data.rfind(b"\n", 0, error.start) + 1)
        place = Place(file, line, column + 1)
        message = f"not UTF-8: byte 0x{data[error.start]:02x} in line {line}"
        raise unusable("not-utf8", message, file, place) from None
    return text, file


def unusable(code: str, text: str, file: str, place: Place | None = None) -> InputError:
    """Give what tells that a text cannot be used."""
    return InputError([Problem(code, f"{file}: {text}" if not place else text, place)])


class Document(NamedTuple):
    """The nodes of a text (None: empty, or not YAML) and the faults found."""

    root: Node | None
    problems: tuple[Problem, ...]


def load(text: str, file: str) -> Document:
    """Read a YAML text.

    Parameters
    ----------
    text
        The text.
    file
        What places call it.
    """
    original = Source(file, text.removeprefix("\ufeff"))
    if bad := bad_character(original):
        return Document(None, (bad,))
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
        if diagnosis.repair is None or len(found) > repairs:
            break
        reached = diagnosis.line
        spoilt.add(diagnosis.repair.spoilt)
        source = Source(file, diagnosis.repair.text, original)
    return Document(root, (*found, *builder.problems))


def _span(event: yaml.Event) -> tuple[int, int]:
    start, end = event.start_mark, event.end_mark
    assert start is not None
    assert end is not None
    return start.index, end.index


@dataclass(slots=True)
class _Open:
    """A collection whose end has not been seen."""

    mapping: bool
    flow: bool
    start: int
    parts: list[Node]


class _Builder:
    """Nodes from events, with a stack of its own."""

    def __init__(self, source: Source, spoilt: set[tuple[int, int]]) -> None:
        self.source = source
        self.spoilt = spoilt
        self.problems: list[Problem] = []
        self.open: list[_Open] = []
        self.root: Node | None = None
        self.documents = 0
        self.nodes = 0

    def run(self) -> Node | None:
        """Give the root, or None; faults that do not stop it go to `problems`."""
        for event in yaml.parse(self.source.text, Loader=_LOADER):
            if isinstance(event, yaml.DocumentStartEvent):
                self.documents += 1
                if self.documents > 1:
                    text = "a second document begins here"
                    hint = "a model file holds one document"
                    self._fault("several-documents", text, event, hint)
                    break
            elif isinstance(event, yaml.CollectionEndEvent):
                self._close(event)
            elif isinstance(event, yaml.NodeEvent) and not self._take(event):
                return None
        return self.root

    def _fault(
        self, code: str, text: str, where: Place | yaml.Event, hint: str = ""
    ) -> None:
        if isinstance(where, yaml.Event):
            start, end = _span(where)
            where = self.source.place(start, max(1, end - start))
        self.problems.append(Problem(code, text, where, hint))

    def _take(self, event: yaml.NodeEvent) -> bool:
        """Take the beginning of a node; give False where that goes too far."""
        hint = "quote the value if it is an expression"
        anchor, tag = event.anchor, getattr(event, "tag", None)
        if isinstance(event, yaml.AliasEvent):
            text = f"`*{anchor}` is an alias of YAML, which models do not use"
            self._fault("alias", text, event, hint)
            self._attach(Broken(self.source.place(_span(event)[0])))
            return True
        self.nodes += 1
        if self.nodes > limits.NODES:
            text = f"the file has more than {limits.NODES:,} values and collections"
            self._fault("too-many-values", text, event)
            return False
        if anchor is not None:
            text = f"`&{anchor}` is an anchor of YAML, which models do not use"
            self._fault("anchor", text, event, hint)
        if tag is not None:
            start = _span(event)[0]
            written = self.source.text[start : start + 40].split(maxsplit=1)[0]
            text = f"`{written}` is a tag of YAML, which models do not use"
            self._fault("tag", text, event, f"write `not` for a negation; {hint}")
        if isinstance(event, yaml.ScalarEvent):
            self._attach(self._scalar(event, sound=anchor is None and tag is None))
            return True
        if len(self.open) >= MAX_DEPTH:
            self._fault("too-deep", f"nested deeper than {MAX_DEPTH} levels", event)
            return False
        mapping = isinstance(event, yaml.MappingStartEvent)
        flow = bool(getattr(event, "flow_style", False))
        self.open.append(_Open(mapping, flow, _span(event)[0], []))
        return True

    def _scalar(self, event: yaml.ScalarEvent, *, sound: bool) -> Node:
        start, end = _span(event)
        span = Span(self.source, start, end, event.style or "")
        place = self.source.place(start, end - start)
        if self.source.position(start) in self.spoilt or not sound:
            return Broken(place)
        scalar = Scalar(event.value, bool(event.style), place, span)
        if span.style in ("|", ">"):  # the text begins below its header
            place = scalar.place_of(0, len(scalar.text))
            return Scalar(event.value, quoted=True, place=place, span=span)
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
            key, value, problem = unspaced(given, below)
            if problem is not None:
                self.problems.append(problem)
            if isinstance(key, Broken):
                continue
            if not isinstance(key, Scalar):
                self._fault("complex-key", "a key must be a plain text", key.place)
            elif key.text == "<<" and not key.quoted:
                text = "`<<` is a merge key of YAML, which models do not use"
                self._fault("merge-key", text, key.place, "write the entries out")
            elif key.text in found:
                first, above = found[key.text]
                text = f"the key `{key.text}` is given twice"
                hint = f"the first is in line {first.place.line}"
                self._fault("duplicate-key", text, key.place, hint)
                if isinstance(above, Mapping) and isinstance(value, Mapping):
                    # as one, so that no name in them is missed
                    both = Mapping(above.entries + value.entries, above.place)
                    found[key.text] = first, both
            else:
                found[key.text] = key, value
        return tuple(found.values())

    # Expressions that a comma has split, between the braces and brackets of YAML

    def _joined(self, parts: list[Node], mapping: bool) -> list[Node]:
        """Give the parts of a collection with `Broken` for what a comma has split.

        In `{relation: atan2(y, x) = 0}` YAML sees the keys `relation` and `x) = 0`.
        """
        whole: list[Node] = []
        step = 2 if mapping else 1
        i = 0
        while i < len(parts):
            whole += parts[i : i + step]
            last = _end_of_split(parts, i + step - 1, step)
            if last is not None:
                whole[-1] = self._split(whole[-1], parts[last])
                i = last
            i += step
        return whole

    def _split(self, first: Node, last: Node) -> Broken:
        assert isinstance(first, Scalar)
        assert isinstance(last, Scalar)
        start, stop = first.span.start, last.span.end
        place = self.source.place(start, stop - start)
        written = " ".join(self.source.text[start:stop].split())
        text = "the comma inside the parentheses ends the value here"
        self._fault("split-by-comma", text, place, f'quote the expression: "{written}"')
        return Broken(place)


# A call has no more arguments than this, so a longer search is in vain (and slow).
_MOST_PIECES = 20


def _end_of_split(parts: list[Node], i: int, step: int) -> int | None:
    """Give the index of the piece that closes the parenthesis left open by part i."""
    depth = _left_open(parts[i])
    if depth <= 0:
        return None
    for j in range(i + 1, min(len(parts), i + 1 + step * _MOST_PIECES), step):
        piece, value = parts[j], parts[j + step - 1]
        if not isinstance(piece, Scalar) or piece.quoted:
            return None
        if step == 2 and not (isinstance(value, Scalar) and value.empty):
            return None
        depth += _left_open(piece)
        if depth <= 0:
            return j
    return None


def _left_open(part: Node) -> int:
    if not isinstance(part, Scalar) or part.quoted:
        return 0
    return part.text.count("(") - part.text.count(")")
