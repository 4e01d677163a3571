"""Nodes of a YAML text: scalars, mappings and sequences with their places."""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from lagsim.errors import Place

if TYPE_CHECKING:
    from collections.abc import Iterator

_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")

_WORD = re.compile(r"\w+")
# What stands at these keys is no expression.
_TEXTS = ("name", "description", "source", "title", "unit")

# The letters after a backslash that need more than one character more (YAML 1.2, 5.7).
_LONG_ESCAPES = {"x": 4, "u": 6, "U": 10}
_BLANK_ESCAPES = frozenset(" \ttnvfr_NLP\n\r\x85\u2028\u2029")


class Source:
    """A text by lines: gives the place of any stretch of it.

    Parameters
    ----------
    file
        What the places call it.
    text
        The text.
    shown
        The text whose lines the places show, where it is not `text` itself.
    """

    def __init__(self, file: str, text: str, shown: Source | None = None) -> None:
        self.file = file
        self.text = text
        breaks = list(_BREAK.finditer(text))
        self.starts = [0, *(m.end() for m in breaks)]
        self._ends = [*(m.start() for m in breaks), len(text)]
        self._shown = shown or self
        # Places of one line share its text, which may be long.
        self._line: tuple[int, str] = -1, ""
        self._stretches: tuple[Span | None, list[tuple[int, int]]] = None, []

    @property
    def count(self) -> int:
        """The number of lines."""
        return len(self.starts)

    def line(self, number: int) -> str:
        """Give line `number`, counted from 0, without its end."""
        if self._line[0] != number:
            self._line = number, self.text[self.starts[number] : self._ends[number]]
        return self._line[1]

    def stretches(self, span: Span, text: str) -> list[tuple[int, int]]:
        """Give what `span.stretches(text)` does; asked again for the last, at once."""
        if self._stretches[0] is not span:
            self._stretches = span, span.stretches(text)
        return self._stretches[1]

    def position(self, index: int) -> tuple[int, int]:
        """Give line and column, counted from 0, of the character at `index`."""
        line = bisect_right(self.starts, index) - 1
        return line, index - self.starts[line]

    def place(self, index: int, length: int = 1) -> Place:
        """Give the place of a stretch; it ends with its first line."""
        line, column = self.position(max(0, min(index, len(self.text))))
        room = self._ends[line] - self.starts[line] - column
        return Place(
            self.file,
            line + 1,
            column + 1,
            max(1, min(length, room)),
            self._shown.line(line),
        )


class Span(NamedTuple):
    """Where a scalar stands in its source, and how it is written."""

    source: Source
    start: int
    end: int
    style: str = ""

    def stretches(self, text: str) -> list[tuple[int, int]]:
        """Give begin and end in the source of each character of the value, and its end.

        Blanks may have been folded, so only the other characters are counted off; a
        blank stands just after the character before it.
        """
        found: list[tuple[int, int]] = []
        begin = end = self._first()
        for c in text:
            if c.isspace():
                found.append((end, end + 1))
            else:
                begin, end = self._unit(end)
                found.append((begin, end))
        found.append((end, end + 1))
        return found

    def _first(self) -> int:
        if self.style in ("'", '"'):
            return self.start + 1
        if self.style in ("|", ">"):
            line, _ = self.source.position(self.start)
            return self.source.starts[min(line + 1, self.source.count - 1)]
        return self.start

    def _unit(self, index: int) -> tuple[int, int]:
        """Give begin and end of the next character that is not blank."""
        raw = self.source.text
        last = max(self.start, self.end - 1)
        while index < last:
            if self.style == '"' and raw[index] == "\\":
                length, blank = self._escape(index)
                if not blank:
                    return index, index + length
                index += length
            elif self.style == "'" and raw.startswith("''", index):
                return index, index + 2
            elif raw[index].isspace():
                index += 1
            else:
                return index, index + 1
        return last, last + 1

    def _escape(self, index: int) -> tuple[int, bool]:
        raw = self.source.text
        letter = raw[index + 1]
        length = _LONG_ESCAPES.get(letter)
        if length is None:
            return 2, letter in _BLANK_ESCAPES
        return length, chr(int(raw[index + 2 : index + length], 16)).isspace()


@dataclass(frozen=True, slots=True)
class Scalar:
    """A text; YAML's own types play no part."""

    text: str
    quoted: bool
    place: Place
    span: Span = field(repr=False, compare=False)

    @property
    def empty(self) -> bool:
        """Whether the file gives nothing here, or YAML's null."""
        return not self.quoted and self.text in ("", "~", "null", "Null", "NULL")

    def place_of(self, offset: int, length: int = 1) -> Place:
        """Give the place in the file of `length` characters of the text."""
        stretches = self.span.source.stretches(self.span, self.text)
        offset = max(0, min(offset, len(self.text)))
        last = max(offset, min(offset + length, len(self.text)) - 1)
        start, end = stretches[offset][0], stretches[last][1]
        return self.span.source.place(start, end - start)


class Mapping(NamedTuple):
    """Keys with their values, in the order of the file."""

    entries: tuple[Entry, ...]
    place: Place


class Sequence(NamedTuple):
    """A list."""

    items: tuple[Node, ...]
    place: Place


class Broken(NamedTuple):
    """A value that cannot be read; the fault is reported already."""

    place: Place


Node: TypeAlias = Scalar | Mapping | Sequence | Broken
Entry: TypeAlias = tuple[Scalar, Node]


def argument(option: str, value: str) -> Scalar:
    """Give the value of a command line option, such as `--set g=` and `9.8`."""
    # Bytes that are not UTF-8 reach us as lone surrogates, which nothing can print.
    value = value.encode(errors="replace").decode()
    source = Source(option + value, option + value)
    span = Span(source, len(option), len(source.text))
    place = source.place(len(option), max(1, len(value)))
    return Scalar(value, quoted=True, place=place, span=span)


def leaves(node: Node, name: str = "") -> Iterator[tuple[str, Scalar]]:
    """Give the scalars of a node and below it, each by the keys that lead to it."""
    if isinstance(node, Scalar):
        yield name, node
    elif isinstance(node, Mapping):
        for key, value in node.entries:
            yield from leaves(value, f"{name}.{key.text}")
    elif isinstance(node, Sequence):
        for k, item in enumerate(node.items, 1):
            yield from leaves(item, f"{name}.{k}")


def words(*roots: Node) -> set[str]:
    """Give the words of all expressions below some nodes."""
    return {
        word
        for root in roots
        for name, scalar in leaves(root)
        if name.rpartition(".")[2] not in _TEXTS
        for word in _WORD.findall(scalar.text)
    }
