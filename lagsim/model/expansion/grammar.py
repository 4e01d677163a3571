"""Parser of expressions with families and vectors, into postfix steps.

It extends the language's parser: a name before `(` that is no function is a member,
`q(i-1)`; `.x` selects a component; `sum`, `min` and `max` run over `i = a..b`; there
are functions of vectors. A text is parsed once, for any number of members, and
evaluated for each.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from lagsim.codes.known import EXPRESSION_ARITY, EXPRESSION_RANGE
from lagsim.language import parser
from lagsim.language.functions import FUNCTIONS
from lagsim.language.parser import ExpressionError, Parser, Pending, Token

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.parser import Parsed, Steps

_MORE = re.compile(
    parser.TOKEN.pattern.replace(r"[0-9]+\.?[0-9]*", r"[0-9]+(?:\.(?!\.)[0-9]*)?")
    + r"""
  | (?P<range>\.\.)
  | (?P<component>\.\s*[^\W\d_]\w*)""",
    re.VERBOSE,
)

# Operations over a range, and the operation that joins two terms.
OVER_RANGES = {"sum": "add", "min": "min", "max": "max"}
# Functions of vectors, and their numbers of arguments.
OF_VECTORS = {"vec": (2, 3), "dot": (2,), "cross": (2,), "norm": (1,), "unit": (1,)}
# Functions of frames, whose first argument is a frame, and their numbers of arguments.
OF_FRAMES = {"rotate": (2,), "unrotate": (2,), "omega": (1,), "omega_space": (1,)}
OF_VECTORS |= {"spin": (2,), **OF_FRAMES}
# All names that are called.
CALLED = (*FUNCTIONS, *OF_VECTORS, *OVER_RANGES)
NESTED = 16
_RANGE = "such as sum(i = 1..n, m(i))"


class Inner(NamedTuple):
    """Payload of a postfix step that contains other steps.

    `takes` is the number of operands that the step removes from the stack. `word` is
    the name of a component, of the index of a range, or of a family; `steps` are the
    steps of a term over the range, or of the name of a frame in a function of frames.
    """

    takes: int
    word: str
    steps: Steps = ()


@dataclass(slots=True)
class _Over(Pending):
    """Sum, minimum or maximum over a range, while its text is parsed.

    `index` is the name of the index, `begin` the position, in the output, of the first
    step of its terms, and `ranged` whether the range has been read.
    """

    index: str = ""
    ranged: bool = False
    begin: int = -1


@dataclass(slots=True)
class _OfFrame(Pending):
    """Call of a function whose first argument is a frame, while its text is parsed.

    `frame` has the postfix steps of the first argument, `begin` is the index of the
    first of these steps in the parser's output.
    """

    begin: int = 0
    frame: Steps = ()


class _Extended(Parser):
    """Parser of expressions with members, components and ranges."""

    def _function(self, token: Token) -> None:
        name, ahead = token.text, self.part[self.at : self.at + 3]
        if name in OVER_RANGES and [t.kind for t in ahead] == _HEAD:
            if sum(isinstance(p, _Over) for p in self.pending) == NESTED:
                text = f"more than {NESTED} sums in one another"
                raise token.fault(text, "define the inner ones", EXPRESSION_RANGE)
            over = _Over(name, 0, token, call=True, index=ahead[1].text)
            self.at += len(ahead)
            self.pending.append(over)
        elif name == "sum":
            raise token.fault("`sum` needs a range", _RANGE, EXPRESSION_RANGE)
        elif name in FUNCTIONS:
            super()._function(token)
        elif name in OF_FRAMES:
            begin = len(self.output)
            self.pending.append(_OfFrame(name, 0, token, call=True, begin=begin))
        else:
            self.pending.append(Pending(name, 0, token, call=True))

    def _after_operand(self, token: Token) -> bool:
        if token.kind == "component":
            letter = Inner(1, token.text[1:].strip())
            self.output.append(("component", letter, token))
            return False
        if token.kind != "range":
            return super()._after_operand(token)
        self._reduce(1, token)
        top = self.pending[-1] if self.pending else None
        if not isinstance(top, _Over) or top.ranged:
            raise token.fault(
                "`..` has no meaning here", f"a range is {_RANGE}", EXPRESSION_RANGE
            )
        top.ranged = True
        return True

    def _comma(self, token: Token) -> bool:
        top = self.pending[-1] if self.pending else None
        self._name_frame(top)
        if not isinstance(top, _Over):
            return super()._comma(token)
        if not top.ranged or top.begin >= 0:
            text = f"`{top.op}` needs a range and one expression"
            raise token.fault(text, _RANGE, EXPRESSION_RANGE)
        top.begin = len(self.output)
        return True

    def _name_frame(self, top: Pending | None) -> None:
        """Move the steps of a frame's name from the output to its open function.

        top : the innermost open operation; no other operation than a function of frames
            is changed.
        """
        if isinstance(top, _OfFrame) and not top.frame:
            top.frame = self._cut(top.begin)

    def _cut(self, begin: int) -> Steps:
        """Remove the steps from index `begin` on from the output, and return them."""
        cut = tuple(self.output[begin:])
        del self.output[begin:]
        return cut

    def _close(self, token: Token) -> bool:
        top = self.pending[-1] if self.pending else None
        self._name_frame(top)
        known = top is None or (top.op in FUNCTIONS and not isinstance(top, _Over))
        if top is None or known or not top.call:
            return super()._close(token)
        self.pending.pop()
        op = top.op
        payload: int | Inner = top.arity
        if isinstance(top, _Over):
            if top.begin < 0:
                text = f"`{op}` needs a range and an expression"
                raise top.token.fault(text, _RANGE, EXPRESSION_RANGE)
            op, payload = "over", Inner(2, top.index, self._cut(top.begin))
        elif top.op not in OF_VECTORS:
            op = "member"
        elif top.arity not in OF_VECTORS[top.op]:
            text = f"`{op}` takes {self._count(op)}, found {top.arity}"
            raise top.token.fault(text, "", EXPRESSION_ARITY)
        elif isinstance(top, _OfFrame):
            payload = Inner(top.arity - 1, "", top.frame)
        self._check_kinds(top, [False] * (3 if isinstance(top, _Over) else top.arity))
        self._value(top.token, op, payload)
        return False

    def _count(self, function: str) -> str:
        if function in FUNCTIONS:
            return super()._count(function)
        if counts := OF_VECTORS.get(function):
            return " or ".join(map(str, counts)) + " arguments"
        return "a range and a term" if function in OVER_RANGES else "its subscripts"


_HEAD = ["open", "name", "relation"]


def tokens(text: str) -> list[Token]:
    """Return tokens of a text, then one of kind `end`."""
    return list(parser.tokens(text, _MORE))


def parsed(text: str, part: Sequence[Token], *, conditional: bool = False) -> Parsed:
    """Parse the tokens of a text, or of a part of it.

    part : the tokens, the last one of kind `end`.
    conditional : whether the text is a condition.

    Raises
    ------
    ExpressionError
        With the place of the first fault.
    """
    return _Extended(text, [*part]).parse(conditional=conditional)


# Keys of families: `q(1..n)`, `x(i = 2..n)`, `G(3).x`


class Subscript(NamedTuple):
    """Range `index = first..last`, or a single subscript `first`.

    `runs` is the index of a range, "" for a single subscript; `token` its place.
    """

    runs: str
    first: Steps
    last: Steps | None
    token: Token


class Key(NamedTuple):
    """Name with subscripts and a component `letter`, as in a key or a list."""

    name: str
    subscripts: tuple[Subscript, ...] = ()
    letter: str = ""

    @property
    def ranged(self) -> bool:
        """Whether the key denotes several members."""
        return any(s.last is not None for s in self.subscripts)


def parsed_key(text: str) -> Key | None:
    """Return the key of a text; None where the text is not of this form.

    Raises
    ------
    ExpressionError
        Where a range has a fault.
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
            raise end.fault(
                f"the range of `{index}` has no end", hint, EXPRESSION_RANGE
            )
        single = parsed(text, [*part, close]).postfix
        return Subscript("", single, None, (part or [end])[0])
    ends = (
        [*part[:at], close._replace(offset=part[at].offset)],
        [*part[at + 1 :], close],
    )
    first, last = (parsed(text, side).postfix for side in ends)
    return Subscript(index, first, last, part[at])
