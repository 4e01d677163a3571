"""Parser of the expression language: text, tokens, postfix, nodes; faults with place.

A precedence parser with an explicit stack returns a `Parsed` (postfix, with the names
used), so that definitions can be sorted before they are built. There is no recursion,
and Python or sympy never evaluate any text.
"""

from __future__ import annotations

import functools
import math
import re
import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from lagsim.codes.known import (
    EXPRESSION_ARITY,
    EXPRESSION_NAME,
    EXPRESSION_NOT_FINITE,
    EXPRESSION_NUMBER,
    EXPRESSION_PARENTHESIS,
    EXPRESSION_SYNTAX,
    EXPRESSION_UNKNOWN_FUNCTION,
)
from lagsim.errors import nearest
from lagsim.language.functions import FUNCTIONS, JOINING, OPERATIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
    from typing import Literal

    from lagsim.codes.known import ErrorCode
    from lagsim.language.graph import Graph

    # Of the tables of a file: names and arities; names and what makes their nodes.
    Arities = tuple[tuple[str, int], ...]
    Tables = Mapping[str, Any]
    # That of a row of `lagsim.codes`, or SILENT.
    ExpressionCode = ErrorCode | Literal["silent"]


# Code of a fault that is reported elsewhere.
SILENT: Final = "silent"


class ExpressionError(Exception):
    """Fault in an expression: its place in the text, a message, and a hint."""

    def __init__(
        self,
        offset: int,
        length: int,
        text: str,
        hint: str = "",
        code: ExpressionCode = EXPRESSION_SYNTAX,
    ) -> None:
        super().__init__(text)
        self.offset = offset
        self.length = max(1, length)
        self.text = text
        self.hint = hint
        self.code: ExpressionCode = code

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        """Return constructor and arguments for pickle, used for stored models."""
        given = self.offset, self.length, self.text, self.hint, self.code
        return ExpressionError, given


def silent() -> ExpressionError:
    """Return an error without a message, for a text whose fault is reported elsewhere.

    Raising it ends the evaluation of the text without a second report.
    """
    return ExpressionError(0, 1, "", code=SILENT)


class Token(NamedTuple):
    """Token of a text: kind, text and offset."""

    kind: str  # number, name, function, operator, open, close, comma, relation, end
    text: str
    offset: int

    def fault(
        self, text: str, hint: str = "", code: ExpressionCode = EXPRESSION_SYNTAX
    ) -> ExpressionError:
        """Return an ExpressionError at the place of this token.

        text, hint, code : message, hint and code of the fault.
        """
        return ExpressionError(self.offset, len(self.text), text, hint, code)


# Operations on a stack: each with a number, a name or its number of operands, and with
# its token.
Steps: TypeAlias = tuple[tuple[str, Any, Token], ...]

# Columns with a point in their names that are allowed in expressions.
DOTTED = r"(?:reaction\.)?"
TOKEN = re.compile(
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
    "%": "the remainder is mod(x, y)",
    "[": "group with parentheses",
    "{": "group with parentheses",
    ";": "write `,` between entries, and no sign after the last",
    "~": "write `not`",
    "¬": "write `not`",
    "∧": "write `and`",
    "∨": "write `or`",
    "'": "an expression contains no quotes; a rate is written q_dot",
    '"': "an expression contains no quotes",
}


def tokens(text: str, pattern: re.Pattern[str] = TOKEN) -> Iterator[Token]:
    """Yield the tokens of `text`, then one of kind `end`."""
    offset = 0
    while offset < len(text):
        match = pattern.match(text, offset)
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
        return ExpressionError(offset, 1, message, code=EXPRESSION_NAME)
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
            offset, len(whole), f"`{whole}` is not a number", hint, EXPRESSION_NUMBER
        )
    if not math.isfinite(float(word)):
        raise ExpressionError(
            offset, len(word), f"the number {_short(word)} is too large to be finite",
            "the largest is about 1.8e308", EXPRESSION_NOT_FINITE,
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
        hint, EXPRESSION_NAME,
    )  # fmt: skip


class Name(NamedTuple):
    """Variable in an expression, with its offset."""

    text: str
    offset: int


class Parsed(NamedTuple):
    """Expression in postfix: numbers, names and operations with their arity."""

    text: str
    postfix: Steps

    @property
    def names(self) -> tuple[Name, ...]:
        """Variables in the order of the text."""
        named = (step for step in self.postfix if step[0] == "name")
        return tuple(Name(name, token.offset) for _, name, token in named)

    def build(
        self, g: Graph, scope: Callable[[str], int], tables: Tables | None = None
    ) -> int:
        """Return the node of the expression in the graph `g`.

        scope : function that maps each name to its node.
        tables : functions by name that build the node of a table's value.

        Examples
        --------
        >>> from lagsim.language.evaluate import evaluate
        >>> from lagsim.language.graph import Graph
        >>> g = Graph()
        >>> node = parse("2*x + 1").build(g, g.variable)
        >>> evaluate(g, [node], {"x": 3.0})
        [7.0]
        """
        stack: list[int] = []
        for kind, payload, _ in self.postfix:
            if kind == "number":
                stack.append(g.constant(payload))
            elif kind == "name":
                stack.append(scope(payload))
            elif kind == "data":
                stack.append(g.data(payload))
            else:
                args = stack[-payload:]
                del stack[-payload:]
                table = (tables or {}).get(kind)
                stack.append(table(g, args) if table else g.call(kind, *args))
        return stack.pop()


class ParsedRelation(NamedTuple):
    """Left side, right side (None for a bare expression) and `=`, `<=` or `>=`.

    The sign is `sense`, and `at` its offset in the text.
    """

    left: Parsed
    right: Parsed | None
    sense: str
    at: int = 0

    @property
    def names(self) -> tuple[Name, ...]:
        """Variables of both sides."""
        return self.left.names + (self.right.names if self.right else ())


# Binding powers. Unary minus binds weaker than `^` and tighter than `*`.
# End of the operand before a missing operator.
_LAST = re.compile(r"[\w.]+$")
_BINARY = {
    row.sign.strip(): (row.binds, name)
    for name, row in OPERATIONS.items()
    if row.sign and row.arity == 2
}
_BINARY["**"] = _BINARY["^"]
_NOT, _COMPARES, _UNARY, _POWER = (
    OPERATIONS[name].binds for name in ("not", "lt", "neg", "pow")
)


@dataclass(slots=True)
class Pending:
    """Operator, parenthesis or call whose arguments are not complete yet.

    `op` is the operation, `token` its place, `arity` the number of its
    arguments so far, and `power` its binding power.
    """

    op: str  # an operation, "(" or "+" (unary plus)
    power: int
    token: Token
    arity: int = 1
    call: bool = False


class Parser:
    """Parser of tokens into postfix, by precedence, with a stack of open operations.

    Parameters
    ----------
    text : str
        The text.
    part : sequence of Token
        Its tokens, or the tokens of a part of it.
    tables
        Names of the tables of the file, each with its number of arguments.

    Attributes
    ----------
    output : list of (op, payload, token)
        The postfix steps so far.
    kinds : list of (bool, Token)
        For each value on the evaluation stack: whether it is a condition, and its first
        token.
    pending : list of Pending
        Operations whose arguments are not complete.
    """

    def __init__(self, text: str, part: list[Token], tables: Arities = ()) -> None:
        self.text = text
        self.arities = dict(tables)
        self.part = part
        self.at = 0
        self.output: list[tuple[str, Any, Token]] = []
        self.kinds: list[tuple[bool, Token]] = []  # (is a condition, begins at)
        self.pending: list[Pending] = []

    def parse(self, *, conditional: bool = False) -> Parsed:
        """Parse all tokens into an expression, or a condition if `conditional`."""
        operand_next = True
        while self.at < len(self.part):
            token = self.part[self.at]
            self.at += 1
            step = self._operand if operand_next else self._after_operand
            operand_next = step(token)
        condition, at = self.kinds[-1]
        if condition != conditional:
            raise _wrong_kind("a comparison is expected here", at, conditional)
        return Parsed(self.text, tuple(self.output))

    def _operand(self, token: Token) -> bool:
        """Process a token where an operand is expected.

        Return whether an operand is still expected, as after a sign.
        """
        if token.kind == "number":
            self._value(token, "number", float(token.text))
            return False
        if token.kind == "name":
            self._value(token, "name", token.text)
            return False
        if token.kind == "function":
            self._function(token)
        elif token.kind == "open":
            # The parenthesis of a function that has just been named is its own.
            name = self.pending[-1].token if self.pending else token
            between = self.text[name.offset + len(name.text) : token.offset]
            if not self.pending or not self.pending[-1].call or between.strip():
                self.pending.append(Pending("(", 0, token))
        elif token.kind == "operator" and token.text in ("+", "-", "not"):
            op, power = {
                "+": ("+", _UNARY),
                "-": ("neg", _UNARY),
                "not": ("not", _NOT),
            }[token.text]
            self.pending.append(Pending(op, power, token))
        else:
            raise self._missing_operand(token)
        return True

    def _missing_operand(self, token: Token) -> ExpressionError:
        if token.kind == "end":
            if not self.part[:-1]:
                return token.fault("an expression is expected, found nothing")
            hint = f"leave `{self.part[-2].text}` out, or write the operand after it"
            return token.fault("the expression ends where a value is expected", hint)
        if token.kind == "relation":
            return _relation_inside(token, self.text)
        hint = ""
        if token.kind == "close" and self.pending and self.pending[-1].call:
            op = self.pending[-1].op
            hint = f"`{op}` takes {self._count(op)}"
        return token.fault(f"a value is expected before `{token.text}`", hint)

    def _function(self, token: Token) -> None:
        known = {**FUNCTIONS, **self.arities}
        if token.text not in known:
            text = f"there is no function `{token.text}`"
            hint = _similar(token.text, known)
            raise token.fault(text, hint, EXPRESSION_UNKNOWN_FUNCTION)
        self.pending.append(Pending(token.text, 0, token, call=True))

    def _value(self, token: Token, op: str, payload: Any) -> None:
        self.output.append((op, payload, token))
        self.kinds.append((False, token))

    def _after_operand(self, token: Token) -> bool:
        """Process a token after an operand.

        Return whether an operand is expected next.
        """
        if token.kind == "operator" and token.text in _BINARY:
            power, op = _BINARY[token.text]
            # `^` is right-associative; `2^-1` leaves its unary minus on the stack.
            self._reduce(power + 1 if power == _POWER else power, token)
            self.pending.append(Pending(op, power, token, arity=2))
            return True
        if token.kind in ("close", "comma"):
            self._reduce(1, token)
            return self._close(token) if token.kind == "close" else self._comma(token)
        if token.kind == "end":
            self._reduce(1, token)
            if self.pending:
                left = self.pending[-1].token
                raise left.fault(
                    "this parenthesis is never closed", "", EXPRESSION_PARENTHESIS
                )
            return False
        raise self._missing_operator(token)

    def _missing_operator(self, token: Token) -> ExpressionError:
        if token.kind == "relation":
            return _relation_inside(token, self.text)
        before = self.text[: token.offset].rstrip()
        left = _LAST.search(before)
        hint = "there is no implicit product: write `*`"
        if left is not None and token.kind != "open":
            hint += f", {left[0]}*{token.text}"
            if token.text[0] == "." and not left[0][0].isdigit():  # a column's name
                hint = f"a member of a family is {left[0]}({token.text[1:]})"
        if token.text == "not":
            hint = ""
        text = f"an operator is expected between `{before[-12:]}` and `{token.text}`"
        return token.fault(text, hint)

    def _reduce(self, power: int, token: Token) -> None:
        """Apply pending operators that bind at least as tightly as `power`.

        token : the operator of that power, which follows their last argument.
        """
        while self.pending and self.pending[-1].power >= power:
            top = self.pending.pop()
            if top.power == _COMPARES == power and token.text in _BINARY:
                raise token.fault("comparisons do not chain", "write a < b and b < c")
            self._apply(top)

    def _apply(self, top: Pending) -> None:
        first = self.kinds[-top.arity][1] if top.arity == 2 else top.token
        condition = top.op in JOINING
        self._check_kinds(top, [condition] * top.arity)
        self.kinds.append((condition or top.power == _COMPARES, first))
        if top.op != "+":
            self.output.append((top.op, top.arity, top.token))

    def _check_kinds(self, top: Pending, expects_condition: Sequence[bool]) -> None:
        """Check the kinds of an operation's arguments; remove these from `kinds`.

        top : the operation.
        expects_condition : for each argument, whether it must be a condition.
        """
        args = self.kinds[-len(expects_condition) :]
        for (condition, at), conditional in zip(args, expects_condition, strict=True):
            if condition != conditional:
                expected = f"`{top.token.text}` expects a comparison here"
                raise _wrong_kind(expected, at, conditional)
        del self.kinds[-len(expects_condition) :]

    def _comma(self, token: Token) -> bool:
        if not self.pending or not self.pending[-1].call:
            text = "a comma is allowed only between a function's arguments"
            raise token.fault(text, "a decimal point is written `.`")
        self.pending[-1].arity += 1
        return True

    def _close(self, token: Token) -> bool:
        if not self.pending:
            raise token.fault(
                "this parenthesis was never opened", "", EXPRESSION_PARENTHESIS
            )
        top = self.pending.pop()
        if not top.call:
            return False
        if top.arity != self._arity(top.op):
            text = f"`{top.op}` takes {self._count(top.op)}, found {top.arity}"
            raise top.token.fault(text, "", EXPRESSION_ARITY)
        self._check_kinds(top, [top.op == "if", *(False,) * (top.arity - 1)])
        self._value(top.token, top.op, top.arity)
        return False

    def _arity(self, function: str) -> int:
        found = self.arities.get(function)
        return FUNCTIONS[function].arity if found is None else found

    def _count(self, function: str) -> str:
        arity = self._arity(function)
        if function == "if":
            return "3 arguments, if(condition, a, b)"
        return "1 argument" if arity == 1 else f"{arity} arguments"


def _wrong_kind(expected: str, at: Token, conditional: bool) -> ExpressionError:
    if conditional:
        return at.fault(f"{expected}, found a number", "such as x > 0")
    return at.fault("a comparison is allowed only in `if`", "write if(condition, a, b)")


def _similar(name: str, known: Collection[str]) -> str:
    """Return a hint that names the function most similar to a name, or "".

    A function of three letters is within many longer words, as `sin` in `spring`.
    """
    near = nearest(name, known) if name[1:] else ""
    if len(near) <= 3 and len(name) > len(near) + 1 and not name.startswith(near):
        return ""
    return f"did you mean `{near}`?" if near else ""


def _relation_inside(token: Token, text: str) -> ExpressionError:
    hint = "relations are allowed only in constraints and `until`, one each"
    if not text[: token.offset].strip():
        hint = "leave `=` out"
    elif text[: token.offset].strip().isidentifier():
        hint = f"write only its right side, or elsewhere: {hint}"
    return token.fault("`=` has no meaning here", hint)


@functools.lru_cache(maxsize=1024)
def parse(text: str, tables: Arities = ()) -> Parsed:
    """Parse an expression; the result is cached.

    tables : names of the file's tables, each with its number of arguments.

    Raises
    ------
    ExpressionError
        With the place of the first fault in `text`.

    Examples
    --------
    >>> [name.text for name in parse("k*(x - l0)").names]
    ['k', 'x', 'l0']
    """
    return Parser(text, list(tokens(text)), tables).parse()


def parse_condition(text: str, tables: Arities = ()) -> Parsed:
    """Parse a condition, such as that of `if`; see `parse`."""
    return Parser(text, list(tokens(text)), tables).parse(conditional=True)


def parse_relation(text: str, tables: Arities = ()) -> ParsedRelation:
    """Parse a relation, `lhs = rhs` or with `<=` or `>=`, or a bare expression."""
    return relation(
        text, list(tokens(text)), lambda part: Parser(text, part, tables).parse()
    )


def relation(
    text: str, found: list[Token], parsed: Callable[[list[Token]], Parsed]
) -> ParsedRelation:
    """Return the relation that the tokens of a text form; report faults as errors.

    found : the tokens.
    parsed : function that parses the tokens of one side.
    """
    left, right, sense = _sides(text, found)
    other = parsed(right) if right else None
    return ParsedRelation(parsed(left), other, sense, left[-1].offset)


def _sides(
    text: str, found: list[Token]
) -> tuple[list[Token], list[Token] | None, str]:
    """Return the tokens of the left and the right side of a relation, and its sign.

    The right side is None for a bare expression.
    """
    depth, at, joined = 0, [], False
    for i, token in enumerate(found):
        joined |= depth == 0 and token.text in ("and", "or")
        depth += (token.kind == "open") - (token.kind == "close")
        if depth == 0 and token.text in ("=", "<=", ">="):
            at.append(i)
        elif depth == 0 and token.text in ("<", ">"):
            text = f"a relation is not strict: found `{token.text}`"
            raise token.fault(text, f"write `{token.text}=`")
    if len(at) > 1:
        text = "a relation has one `=`, `<=` or `>=`"
        hint = "a condition is one relation, such as if(x >= 0 and y >= 0, 1, 0) >= 1"
        raise found[at[1]].fault(text, hint if joined else "write two constraints")
    if not at:
        return found, None, "="
    middle = found[at[0]]
    left = [*found[: at[0]], Token("end", "", middle.offset)]
    return left, found[at[0] + 1 :], middle.text
