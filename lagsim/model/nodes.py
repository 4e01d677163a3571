"""Nodes of a YAML text: scalars, mappings and sequences with their places."""

from __future__ import annotations

import functools
import re
from bisect import bisect_right
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

from lagsim.errors import Place

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

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

    Attributes
    ----------
    lines : list of str
        Without their ends.
    starts : list of int
        Where each of them begins.
    """

    def __init__(self, file: str, text: str, shown: Source | None = None) -> None:
        self.file = file
        self.text = text
        self.lines = _BREAK.split(text)
        self.starts = [0, *(m.end() for m in _BREAK.finditer(text))]
        self._shown = self.lines if shown is None else shown.lines

    def position(self, index: int) -> tuple[int, int]:
        """Give line and column, counted from 0, of the character at `index`."""
        line = bisect_right(self.starts, index) - 1
        return line, index - self.starts[line]

    def place(self, index: int, length: int = 1) -> Place:
        """Give the place of a stretch; it ends with its first line."""
        line, column = self.position(max(0, min(index, len(self.text))))
        length = max(1, min(length, len(self.lines[line]) - column))
        return Place(self.file, line + 1, column + 1, length, self._shown[line])


class Reading(Protocol):
    """How the text of a scalar is read that an expansion has made: for one member.

    component, size : the number of a component of a vector, or None, of so many
    """

    component: int | None
    size: int

    def parsed(self, text: str, parser: Callable[[str], Any]) -> Any:
        """Give what the parser would give for a file without families."""

    def words(self, text: str) -> Collection[str]:
        """Give the names in the expression."""

    def member(self) -> str:
        """Give the values of the indices, such as ` for i = 2`; empty without any."""


class Scalar(NamedTuple):
    """A text; YAML's own types play no part.

    From `start` to `end` it stands in its source; `style` is the sign of YAML that it
    begins with there, `=` on a command line, or empty. `reading`: of a file with
    families or vectors.
    """

    text: str
    place: Place
    source: Source
    start: int
    end: int
    style: str = ""
    reading: Reading | None = None

    @property
    def empty(self) -> bool:
        """Whether the file gives nothing here, or YAML's null."""
        return not self.style and self.text in ("", "~", "null", "Null", "NULL")

    def place_of_name(self, name: str, offset: int) -> Place:
        """Give the place of a name: of that in the text, where it is a member's."""
        if self.text.startswith(name, offset):
            return self.place_of(offset, len(name))
        word = _WORD.match(self.text, offset)
        return self.place_of(offset, len(word[0]) if word else 1)

    def place_of(self, offset: int, length: int = 1) -> Place:
        """Give the place in the file of `length` characters of the text."""
        stretches = _stretches(self)
        offset = max(0, min(offset, len(self.text)))
        last = max(offset, min(offset + length, len(self.text)) - 1)
        start, end = stretches[offset][0], stretches[last][1]
        return self.source.place(start, end - start)


@functools.lru_cache(maxsize=1)  # each name of a long expression may be asked for
def _stretches(scalar: Scalar) -> list[tuple[int, int]]:
    """Give begin and end in the source of each character of the text, and its end."""
    source, begin = scalar.source, scalar.start
    if scalar.style in ("'", '"'):
        begin += 1
    elif scalar.style in ("|", ">"):  # the text begins below its header
        line = source.position(begin)[0] + 1
        begin = source.starts[min(line, len(source.lines) - 1)]
    # Blanks may have been folded: each stands just after the character before it.
    found, end = list[tuple[int, int]](), begin
    for c in scalar.text:
        if c.isspace():
            found.append((end, end + 1))
        else:
            begin, end = _next(scalar, end)
            found.append((begin, end))
    return [*found, (end, end + 1)]


def _next(scalar: Scalar, index: int) -> tuple[int, int]:
    """Give begin and end of the next character that is not blank."""
    raw, style = scalar.source.text, scalar.style
    last = max(scalar.start, scalar.end - 1)
    while index < last:
        length, blank = 1, raw[index].isspace()
        if style == '"' and raw[index] == "\\":
            length, blank = _escape(raw, index)
        elif style == "'" and raw.startswith("''", index):
            length = 2
        if not blank:
            return index, index + length
        index += length
    return last, last + 1


def _escape(raw: str, index: int) -> tuple[int, bool]:
    """Give the length of an escape of double quotes, and whether it is a blank."""
    letter = raw[index + 1]
    length = _LONG_ESCAPES.get(letter)
    if length is None:
        return 2, letter in _BLANK_ESCAPES
    return length, chr(int(raw[index + 2 : index + length], 16)).isspace()


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
    place = source.place(len(option), max(1, len(value)))
    return Scalar(value, place, source, len(option), len(source.text), "=")


def entries_of(node: Node | None) -> tuple[Entry, ...]:
    """Give the entries of a mapping; none of anything else."""
    return node.entries if isinstance(node, Mapping) else ()


def items_of(node: Node | None) -> tuple[Node, ...]:
    """Give the items of a list, or the one that stands for a list of it."""
    if isinstance(node, Sequence):
        return node.items
    return () if node is None else (node,)


def texts_of(nodes: Iterable[Node]) -> list[str]:
    """Give the texts of those nodes that are scalars."""
    return [node.text for node in nodes if isinstance(node, Scalar)]


def leaves(node: Node, name: str = "") -> Iterator[tuple[str, Scalar]]:
    """Give the scalars of a node and below it, each by the keys that lead to it."""
    if isinstance(node, Scalar):
        yield name, node
    elif isinstance(node, Sequence):
        for k, item in enumerate(node.items, 1):
            yield from leaves(item, f"{name}.{k}")
    else:
        for key, value in entries_of(node):
            yield from leaves(value, f"{name}.{key.text}")


def words(*roots: Node) -> set[str]:
    """Give the words of all expressions below some nodes."""
    return {
        word
        for root in roots
        for name, scalar in leaves(root)
        if name.rpartition(".")[2] not in _TEXTS
        for word in (
            scalar.reading.words(scalar.text)
            if scalar.reading
            else _WORD.findall(scalar.text)
        )
    }
