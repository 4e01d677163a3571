"""Keys of families as they stand in a file: `q(1..n)`, `x(i = 2..n)`, `G(3).x`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.parser import ExpressionError
from lagsim.model.expansion.grammar import parsed, tokens

if TYPE_CHECKING:
    from lagsim.language.parser import Steps, Token


class Subscript(NamedTuple):
    """A range `index = first..last`, or a single subscript."""

    runs: str
    first: Steps
    last: Steps | None
    token: Token


class Key(NamedTuple):
    """A name with subscripts and a component, as they stand in a key or in a list."""

    name: str
    subscripts: tuple[Subscript, ...] = ()
    letter: str = ""

    @property
    def ranged(self) -> bool:
        """Return whether it denotes several members."""
        return any(s.last is not None for s in self.subscripts)


def parsed_key(text: str) -> Key | None:
    """Return key of a text; None where it is not of this form.

    Raises
    ------
    ExpressionError
        With the fault of a range.
    """
    if not ("(" in text or "." in text):
        return Key(text)
    try:
        found = tokens(text)
    except ExpressionError:
        return None
    letter = ""
    if len(found) > 1 and found[-2].kind == "component":
        letter = found.pop(-2).text[1:].strip()
    if [t.kind for t in found] == ["name", "end"]:
        return Key(found[0].text, (), letter)
    kinds = [found[0].kind, *(t.kind for t in found[-2:])]
    if kinds != ["function", "close", "end"]:
        return None
    parts: list[list[Token]] = [[]]
    depth = 0
    for token in found[2:-2]:
        depth += (token.kind == "open") - (token.kind == "close")
        if token.kind == "comma" and depth == 0:
            parts.append([])
        else:
            parts[-1].append(token)
    return Key(
        found[0].text, tuple(_subscript(text, p, found[-2]) for p in parts), letter
    )


def _subscript(text: str, part: list[Token], end: Token) -> Subscript:
    index = ""
    if [t.kind for t in part[:2]] == ["name", "relation"]:
        index, part = part[0].text, part[2:]
    at = next((k for k, t in enumerate(part) if t.kind == "range"), None)
    close = end._replace(kind="end", text="")
    if at is None:
        if index:
            hint = f"write {index} = 1..n"
            raise end.fault(f"the range of `{index}` has no end", hint, "range")
        single = parsed(text, [*part, close]).postfix
        return Subscript("", single, None, (part or [end])[0])
    ends = (
        [*part[:at], close._replace(offset=part[at].offset)],
        [*part[at + 1 :], close],
    )
    first, last = (parsed(text, side).postfix for side in ends)
    return Subscript(index, first, last, part[at])
