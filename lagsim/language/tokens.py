"""Text of the expression language -> tokens, with every fault in its place."""

from __future__ import annotations

import math
import re
import unicodedata
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import JOINING

if TYPE_CHECKING:
    from collections.abc import Iterator


class ExpressionError(Exception):
    """A fault in an expression: where in the text, what, and what to write instead."""

    def __init__(
        self, offset: int, length: int, text: str, hint: str = "", code: str = "syntax"
    ) -> None:
        super().__init__(text)
        self.offset = offset
        self.length = max(1, length)
        self.text = text
        self.hint = hint
        self.code = code


class Token(NamedTuple):
    """A piece of text: its kind, and where it begins."""

    kind: str  # number, name, function, operator, open, close, comma, relation, end
    text: str
    offset: int


# Of the columns with a point in their names those that expressions may name.
DOTTED = r"(?:reaction\.)?"
_TOKEN = re.compile(
    rf"""(?P<space>\s+)
  | (?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)
  | (?P<name>{DOTTED}[^\W\d_]\w*)
  | (?P<operator>\*\*|<=|>=|==|!=|<>|&&|\|\||[-+*/^<>=])
  | (?P<open>\()
  | (?P<close>\))
  | (?P<comma>,)""",
    re.VERBOSE,
)

_CALL = re.compile(r"\s*\(")
_WORD = re.compile(r"\w+")

_WRONG = {
    "==": "numbers are compared by <, <=, > and >=, in `if`",
    "!=": "numbers are compared by <, <=, > and >=, in `if`",
    "<>": "numbers are compared by <, <=, > and >=, in `if`",
    "&&": "write `and`",
    "||": "write `or`",
    "−": "write `-`, a plain minus",
    "–": "write `-`, a plain minus",
    "×": "write `*`",
    "·": "write `*`",
    "÷": "write `/`",
    "≤": "write `<=`",
    "≥": "write `>=`",
    "!": "write `not`",
    "⋅": "write `*`",
    "%": "there is no remainder; `x - y*floor(x/y)` is one",
    "[": "group with parentheses",
    "{": "group with parentheses",
    ";": "write `,` between entries, and nothing at the end of one",
    "~": "write `not`",
    "¬": "write `not`",
    "∧": "write `and`",
    "∨": "write `or`",
    "'": "an expression contains no quotes; a rate is written q_dot",
    '"': "an expression contains no quotes",
}


def tokens(text: str) -> Iterator[Token]:
    """Give the tokens of `text`, then one of kind `end`."""
    offset = 0
    while offset < len(text):
        match = _TOKEN.match(text, offset)
        if match is None:
            raise _bad_character(text, offset)
        kind, word = match.lastgroup or "", match.group()
        end = match.end()
        if kind == "number":
            _check_number(text, offset, word, end)
        elif kind == "name":
            _check_name(offset, word)
            if word in JOINING:
                kind = "operator"
            elif _CALL.match(text, end):
                kind = "function"
        elif word in _WRONG:
            raise ExpressionError(
                offset, len(word), f"`{word}` is no operator here", _WRONG[word]
            )
        elif word in ("=", "<=", ">="):
            kind = "relation" if word == "=" else "operator"
        if kind != "space":
            yield Token(kind, word, offset)
        offset = end
    yield Token("end", "", len(text))


def _bad_character(text: str, offset: int) -> ExpressionError:
    c = text[offset]
    if c == "_":
        message = "a name begins with a letter, not with `_`"
        return ExpressionError(offset, 1, message, code="name")
    plain = unicodedata.normalize("NFKC", c)
    hint = _WRONG.get(c, "")
    if not hint and plain != c:
        hint = f"write its plain form, {plain!r}" if plain.isprintable() else ""
    return ExpressionError(offset, 1, f"unexpected character {c!r}", hint)


def _check_number(text: str, offset: int, word: str, end: int) -> None:
    tail = _WORD.match(text, end)
    if tail:
        whole = word + tail.group()
        hint = f"a product is written with `*`, {word}*{tail.group()}"
        if re.fullmatch(r"[0-9][0-9_]*", whole):
            hint = f"write {whole.replace('_', '')}"
        elif whole[:2].lower() in ("0x", "0b", "0o"):
            hint = "numbers are decimal"
        raise ExpressionError(
            offset, len(whole), f"`{whole}` is not a number", hint, "number"
        )
    if not math.isfinite(float(word)):
        raise ExpressionError(
            offset, len(word), f"the number {_short(word)} is too large to be finite",
            "the largest is about 1.8e308", "not-finite",
        )  # fmt: skip


def _short(word: str) -> str:
    return word if len(word) < 30 else f"{word[:24]}..."


def _check_name(offset: int, word: str) -> None:
    plain = unicodedata.normalize("NFKC", word)
    if plain == word:
        return
    hint = f"write `{plain}`"
    if "²" in word or "³" in word:
        hint = f"write `{word.replace('²', '^2').replace('³', '^3')}`"
    raise ExpressionError(
        offset, len(word), f"the name `{word}` is not in its plain (NFKC) form",
        hint, "name",
    )  # fmt: skip
