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
# Keys whose values are no expressions.
_TEXTS = ("name", "description", "source", "title", "unit")

# The letters after a backslash that need more than one character more (YAML 1.2, 5.7).
_LONG_ESCAPES = {"x": 4, "u": 6, "U": 10}
_BLANK_ESCAPES = frozenset(" \ttnvfr_NLP\n\r\x85\u2028\u2029")


class SourceText:
    """Text with its lines; converts offsets to places.

    Parameters
    ----------
    file
        The file's name in places.
    text
        The text.
    shown
        Source whose lines messages show, where these are not the lines of `text`.

    Attributes
    ----------
    lines : list of str
        Lines without their ends.
    starts : list of int
        Offset of the first character of each line.
    """

    def __init__(self, file: str, text: str, shown: SourceText | None = None) -> None:
        self.file = file
        self.text = text
        self.lines = _BREAK.split(text)
        self.starts = [0, *(m.end() for m in _BREAK.finditer(text))]
        self._shown = self.lines if shown is None else shown.lines

    def position(self, index: int) -> tuple[int, int]:
        """Return line and column, counted from 0, of the character at `index`."""
        line = bisect_right(self.starts, index) - 1
        return line, index - self.starts[line]

    def place(self, index: int, length: int = 1) -> Place:
        """Return the place of `length` characters from `index`, within one line."""
        line, column = self.position(max(0, min(index, len(self.text))))
        length = max(1, min(length, len(self.lines[line]) - column))
        return Place(self.file, line + 1, column + 1, length, self._shown[line])


class Reading(Protocol):
    """Evaluation of a scalar's text for one member of a family and one component.

    component : the index, from 0, of the component that is read; None for a number.
    size : the number of components.
    """

    component: int | None
    size: int

    def parsed(self, text: str, parser: Callable[[str], Any]) -> Any:
        """Return a text as postfix for this member: its names are single variables.

        For the member i = 2, `q(i) + 1` is `q.2 + 1`.

        parser : the function that parses the text as an expression or as a relation.
        """

    def words(self, text: str) -> Collection[str]:
        """Return the names of variables in the text's expression for this member."""

    def member(self) -> str:
        """Return the member for messages, such as ` for i = 2`, or an empty text."""


class Scalar(NamedTuple):
    """Text of a YAML scalar; YAML's own types are not used.

    `start` and `end` are the offsets of the scalar in `source`; `style` is YAML's sign
    of its notation (a quote, `|` or `>`), `=` for a command line option, or empty for
    plain text. `reading` evaluates the text for one member, in a file with families or
    vectors; else None.
    """

    text: str
    place: Place
    source: SourceText
    start: int
    end: int
    style: str = ""
    reading: Reading | None = None

    @property
    def empty(self) -> bool:
        """Whether the scalar is an empty text or YAML's null."""
        return not self.style and self.text in ("", "~", "null", "Null", "NULL")

    def place_of_name(self, name: str, offset: int) -> Place:
        """Return the place in the file of a name in this scalar's expression.

        name : the variable in the model, such as `q.2`.
        offset : offset in the text at which the file writes it, such as `q(i)`.
        """
        if self.text.startswith(name, offset):
            return self.place_of(offset, len(name))
        word = _WORD.match(self.text, offset)
        return self.place_of(offset, len(word[0]) if word else 1)

    def place_of(self, offset: int, length: int = 1) -> Place:
        """Return the place in the file of `length` characters of the text.

        offset : the offset of the first character in the text.
        """
        stretches = _stretches(self)
        offset = max(0, min(offset, len(self.text)))
        last = max(offset, min(offset + length, len(self.text)) - 1)
        start, end = stretches[offset][0], stretches[last][1]
        return self.source.place(start, end - start)


@functools.lru_cache(maxsize=1)  # called for each name of a long expression
def _stretches(scalar: Scalar) -> list[tuple[int, int]]:
    """Return the position in the file of each character of a scalar's text.

    The positions are pairs of begin and end offsets; one more pair is the end of the
    text. Quotes, escapes and folded lines make a text differ from the file.
    """
    source, begin = scalar.source, scalar.start
    if scalar.style in ("'", '"'):
        begin += 1
    elif scalar.style in ("|", ">"):  # the text begins on the line below its header
        line = source.position(begin)[0] + 1
        begin = source.starts[min(line, len(source.lines) - 1)]
    # Blanks may have been folded: each is placed directly after the character before
    # it.
    found, end = list[tuple[int, int]](), begin
    for c in scalar.text:
        if c.isspace():
            found.append((end, end + 1))
        else:
            begin, end = _next(scalar, end)
            found.append((begin, end))
    return [*found, (end, end + 1)]


def _next(scalar: Scalar, index: int) -> tuple[int, int]:
    """Return begin and end, in the file, of the next character that is not blank.

    index : the offset from which on it is searched.
    """
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
    """Return the length of an escape in double quotes, and whether it is a blank.

    raw : the text of the file.
    index : the offset of the backslash.
    """
    letter = raw[index + 1]
    length = _LONG_ESCAPES.get(letter)
    if length is None:
        return 2, letter in _BLANK_ESCAPES
    return length, chr(int(raw[index + 2 : index + length], 16)).isspace()


class Mapping(NamedTuple):
    """YAML node of a mapping: pairs of key and value, in the order of the file."""

    entries: tuple[Entry, ...]
    place: Place


class Sequence(NamedTuple):
    """YAML node of a list: its items, which are nodes."""

    items: tuple[Node, ...]
    place: Place


class Broken(NamedTuple):
    """Value that cannot be read; its fault is already reported."""

    place: Place


Node: TypeAlias = Scalar | Mapping | Sequence | Broken
Entry: TypeAlias = tuple[Scalar, Node]


def argument(option: str, value: str) -> Scalar:
    """Return the scalar of a command line option.

    option, value : the option's beginning, such as `--set g=`, and the text after it.

    Examples
    --------
    >>> argument("--set g=", "9.8").text
    '9.8'
    """
    # Bytes that are not UTF-8 arrive as lone surrogates, which cannot be printed.
    value = value.encode(errors="replace").decode()
    source = SourceText(option + value, option + value)
    place = source.place(len(option), max(1, len(value)))
    return Scalar(value, place, source, len(option), len(source.text), "=")


def entries_of(node: Node | None) -> tuple[Entry, ...]:
    """Return the entries of a mapping; an empty tuple for other YAML nodes."""
    return node.entries if isinstance(node, Mapping) else ()


def items_of(node: Node | None) -> tuple[Node, ...]:
    """Return the items of a list; another YAML node is a list of one item."""
    if isinstance(node, Sequence):
        return node.items
    return () if node is None else (node,)


def texts_of(nodes: Iterable[Node]) -> list[str]:
    """Return the texts of the YAML nodes that are scalars."""
    return [node.text for node in nodes if isinstance(node, Scalar)]


def leaves(node: Node, name: str = "") -> Iterator[tuple[str, Scalar]]:
    """Yield the scalars at and below a YAML node, each with its path: `forces.x`.

    name : the path of the node.
    """
    if isinstance(node, Scalar):
        yield name, node
    elif isinstance(node, Sequence):
        for k, item in enumerate(node.items, 1):
            yield from leaves(item, f"{name}.{k}")
    else:
        for key, value in entries_of(node):
            yield from leaves(value, f"{name}.{key.text}")


def words_below(*roots: Node) -> set[str]:
    """Return the words of all expressions at and below some YAML nodes."""
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


def value_of(node: Node, keys: tuple[str, ...]) -> Node:
    """Return the value of the first of `keys` that a mapping has; else the node itself.

    node : a mapping, such as {value: 2, unit: m}, or a value without further keys.
    """
    below = {key.text: value for key, value in entries_of(node)}
    return next((below[key] for key in keys if key in below), node)


def with_value(node: Node, keys: tuple[str, ...], new: Node) -> Node:
    """Return a mapping with the value that `value_of` returns replaced by `new`.

    node, keys : see `value_of`; a node that is its own value is replaced.
    """
    if not isinstance(node, Mapping) or value_of(node, keys) is node:
        return new
    entries = ((k, new if k.text in keys else v) for k, v in node.entries)
    return node._replace(entries=tuple(entries))
