"""Faults of the input, each with its code, place and hint, and their exceptions."""

from __future__ import annotations

import contextlib
import re
from typing import TYPE_CHECKING, NamedTuple

from lagsim.codes.known import FAILED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from lagsim.codes import MessageRow
    from lagsim.codes.known import ErrorCode


# A source line longer than this is shown in part, around the fault.
WINDOW = 160
# Control characters of terminals, marks of the direction of text, invisible letters:
# controls but for tab and line feed, marks of direction, blanks without width.
UNSEEN = (
    r"\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b\u200e\u200f"
    r"\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
)
_UNSEEN = re.compile(f"[{UNSEEN}]")


def visible(text: str, *, json: bool = False) -> str:
    r"""Return a text with invisible letters as escape sequences, such as \u202e.

    json : whether in the notation of JSON, else of Python.
    """
    if json:
        return _UNSEEN.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
    return _UNSEEN.sub(lambda found: ascii(found[0])[1:-1], text)


def unseen(text: str) -> str:
    """Return the first invisible character of a text; "" if there is none."""
    found = _UNSEEN.search(text)
    return found[0] if found else ""


def nearest(word: str, known: Iterable[str]) -> str:
    """Return the known word most similar to a word, or an empty text.

    Examples
    --------
    >>> nearest("kinetik", ["kinetic", "potential"])
    'kinetic'
    """
    from difflib import get_close_matches  # only faults need it

    return (get_close_matches(word, list(known), 1) or [""])[0]


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a hint that names the most similar known word, or an empty text.

    Examples
    --------
    >>> did_you_mean("kinetik", ["kinetic", "potential"])
    'did you mean `kinetic`?'
    """
    near = nearest(word, known)
    return f"did you mean `{near}`?" if near else ""


def several(texts: Iterable[str], most: int) -> str:
    """Return texts as a list in words of at most `most` items: `a, b and 4 more`.

    Examples
    --------
    >>> several("abcdef", 2)
    'a, b and 4 more'
    """
    texts = list(texts)
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return ", ".join(texts[:most]) + more


def counted(number: int, noun: str) -> str:
    """Return a count with its noun in singular or plural: `1 row`, `2 switches`.

    Examples
    --------
    >>> counted(3, "degree of freedom")
    '3 degrees of freedom'
    """
    noun, of, rest = noun.partition(" of ")
    ending = "es" if noun.endswith("ch") else "s"
    return f"{number} {noun}{ending if number != 1 else ''}{of}{rest}"


class Place(NamedTuple):
    """Stretch of a file: line and column counted from 1, length in characters.

    `source` is the text of the line.
    """

    file: str
    line: int
    column: int
    length: int = 1
    source: str = ""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


class Problem(NamedTuple):
    """Fault of the input: a stable code, a sentence, its place and a hint.

    The code's row in `lagsim.codes` has its number, expectation and advice.
    """

    code: ErrorCode
    text: str
    place: Place | None = None
    hint: str = ""

    @property
    def number(self) -> str:
        """Number of the fault's code, such as E104."""
        return self._row.number

    @property
    def expected(self) -> str:
        """Description of valid input, from the row of the fault's code."""
        return self._row.expected

    @property
    def whole(self) -> Problem:
        """The fault with a hint: its own, or else the hint of its code."""
        return self if self.hint else self._replace(hint=self._row.hint)

    @property
    def _row(self) -> MessageRow:
        from lagsim.codes import errors

        return errors()[self.code]

    @property
    def file(self) -> str | None:
        """File of the fault, or None."""
        return self.place.file if self.place else None

    @property
    def line(self) -> int | None:
        """Line of the fault, from 1, or None."""
        return self.place.line if self.place else None

    @property
    def column(self) -> int | None:
        """Column of the fault, from 1, or None."""
        return self.place.column if self.place else None

    def __repr__(self) -> str:
        where = (
            f" at {visible(self.place.file)}:{self.place.line}" if self.place else ""
        )
        return f"<Problem {self.number} {self.code}{where}: {visible(self.text):.160}>"

    def __str__(self) -> str:
        """Return the fault as FILE:LINE:COLUMN, the source line, caret and hint."""
        return self.shown()

    def shown(self, window: int = WINDOW) -> str:
        """Return the text of `str`, with at most `window` letters of its line."""
        where = f"{self.place}: " if self.place else ""
        lines = [f"{where}{self.text} [{self.number}]"]
        if self.place and self.place.source:
            lines += pointed(self.place, window)
        if self.hint:
            lines.append(f"  hint: {self.hint}")
        return "\n".join(lines)


def pointed(place: Place, window: int = WINDOW) -> list[str]:
    """Return the source line of a place, cut to `window` letters, and a caret line."""
    column, source = place.column - 1, place.source
    if len(source) > window:
        first = max(0, column - window // 2)
        source, column = source[first : first + window], column - first
    before, rest = visible(source[:column]), visible(source[column:])
    marked = len(visible(source[column : column + max(1, place.length)]))
    # A tab before the caret keeps its width, so the caret stays below.
    pad = "".join("\t" if c == "\t" else " " for c in before)
    return ["  " + before + rest, "  " + pad + "^" * max(1, marked)]


class LagsimError(Exception):
    """Base class of the errors that a user can correct.

    Attributes
    ----------
    exit_code : int
        The exit code of the command.
    code : str
        The stable code of the error.

    Examples
    --------
    >>> import lagsim
    >>> try:
    ...     lagsim.load("no-such-file.yaml")
    ... except lagsim.LagsimError as error:
    ...     error.exit_code, error.code
    (2, 'unreadable')
    """

    exit_code = 2
    code: ErrorCode = FAILED


class InputError(LagsimError):
    """The input cannot be used (exit code 2).

    Attributes
    ----------
    problems : tuple of Problem
        All faults, in the order of the file.

    Examples
    --------
    >>> import lagsim
    >>> text = '''coordinates: {x: {}}
    ... initial: {x: 0}
    ... '''
    >>> try:
    ...     lagsim.load(text)
    ... except lagsim.InputError as error:
    ...     print(error)
    <model>:1:1: the file has no `energy` [E119]
      coordinates: {x: {}}
      ^^^^^^^^^^^^^^^^^^^^
      hint: give `kinetic` and `potential`, or `lagrangian`
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problem.whole for problem in problems)
        self.code = self.problems[0].code
        # pickling restores the exception from its problems
        super().__init__(self.problems)

    def __repr__(self) -> str:
        first, more = self.problems[0], len(self.problems) - 1
        return f"<InputError: {first!r}{f' and {more} more' if more else ''}>"

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))


def unusable(
    code: ErrorCode, text: str, place: Place | None = None, hint: str = ""
) -> InputError:
    """Return an InputError with one fault, whose fields are the arguments."""
    return InputError([Problem(code, text, place, hint)])


class Problems(list[Problem]):
    """List of faults, collected one by one and raised together."""

    def add(
        self, code: ErrorCode, text: str, place: Place | None = None, hint: str = ""
    ) -> None:
        """Append a fault with this code, text, place and hint."""
        self.append(Problem(code, text, place, hint))

    @contextlib.contextmanager
    def gathered(self) -> Iterator[None]:
        """Context manager: append the faults of an InputError that is raised inside."""
        try:
            yield
        except InputError as error:
            self += error.problems

    def refuse(self) -> None:
        """Raise an InputError with all collected faults, if there are any."""
        if self:
            raise InputError(self)
