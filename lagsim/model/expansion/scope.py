"""Families and vectors of a file, and values of their expressions for a member.

A `Family` is the meaning of one name of the file: members by their subscripts, each a
number or a vector. `Scope.value` evaluates the steps of an expression at given indices
and returns trees of scalars. An expanded scalar has a `MemberReading`, which returns
the expression of its member, with offsets in the text of the file.
"""

from __future__ import annotations

import math
import sys
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim import limits
from lagsim.codes.known import (
    EXPRESSION_COMPONENT,
    EXPRESSION_FRAME,
    EXPRESSION_MEMBER,
    EXPRESSION_RANGE,
    EXPRESSION_SIZE,
    EXPRESSION_SUBSCRIPT,
    EXPRESSION_TOO_MANY,
    EXPRESSION_UNKNOWN_FUNCTION,
)
from lagsim.errors import did_you_mean
from lagsim.language.columns import FORCE, MULTIPLIER, REACTION
from lagsim.language.functions import OPERATIONS
from lagsim.language.names import ENDINGS
from lagsim.language.parser import (
    SILENT,
    ExpressionError,
    Parsed,
    ParsedRelation,
    parse,
    parse_condition,
    parse_relation,
    relation,
    silent,
)
from lagsim.model.expansion import gathering, grammar, trees
from lagsim.model.expansion.grammar import CALLED, OF_FRAMES, OVER_RANGES, tokens
from lagsim.model.expansion.trees import EMPTY, Tree, UnfitError, Value

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    from lagsim.codes.known import ErrorCode
    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.language.parser import ExpressionCode, Steps, Token
    from lagsim.model.expansion.grammar import Inner, Key
    from lagsim.model.expansion.trees import Frame
    from lagsim.model.nodes import Node, Scalar

    # Numbers, or what the word `bodies` denotes.
    Indices = dict[str, Tree]
    Member = tuple[int, ...]
    Members = list[tuple[Indices, Member]]
    Parser = Callable[[str], Any]

# Letters of a file's text that count for each operation.
_LETTERS = 3
# Number of rows of a table of members whose time is that of creating one node.
_GATHERED = 5
# Tolerance within which a subscript is a whole number, in units in the last place.
_WHOLE = 4 * sys.float_info.epsilon


class Family:
    """Meaning of a name: its members by subscripts, and their components.

    Attributes
    ----------
    name : str
        The name.
    section : str
        Section of the file that declares it.
    place : Place
        Place of its first declaration.
    indexed : bool
        Whether it has subscripts; else it has one member, ().
    members : set of tuple of int
        Subscripts of the members.
    letters : tuple of str
        Names of components; empty for numbers.
    resolved : bool
        Whether `letters` are determined.
    broken : bool
        Whether a fault in its declaration is reported.
    """

    __slots__ = (
        "broken", "indexed", "letters", "members", "name", "place", "resolved",
        "section",
    )  # fmt: skip

    def __init__(self, name: str, section: str, place: Place, indexed: bool) -> None:
        self.name, self.section, self.place = name, section, place
        self.indexed = indexed
        self.members: set[Member] = set()
        self.letters: tuple[str, ...] = ()
        self.resolved = section != "definitions"
        self.broken = False

    def missing(self, name: str, members: Iterable[tuple[object, Member]]) -> str:
        """Return a text on the first of `members` that the family lacks; "" if none.

        name : the name of the family, or of its rate.
        members : pairs, whose second element has the subscripts.
        """
        missing = (m for _, m in members if m not in self.members)
        found = next(missing, None)
        if found is None:
            return ""
        return f"there is no `{dotted(name, found)}`: {self.described()}"

    def described(self) -> str:
        """Return a phrase for messages that names the first and the last member."""
        if not self.members:
            return f"`{self.name}` has no members"
        ends = (min(self.members), max(self.members))
        first, last = (_called(self.name, m) for m in ends)
        return f"`{self.name}` has the members {first} to {last}"


class FamilyEntry(NamedTuple):
    """Entry of a section whose key declares or names members of a family.

    Fields: key and value of the entry, the family, the parsed key, and the members as
    pairs of index values and subscripts.
    """

    key: Scalar
    node: Node
    family: Family
    parsed: Key
    members: Members


def dotted(name: str, member: Member = (), letter: str = "") -> str:
    """Return the column name of a member, or of its component `letter`: `G.3.x`."""
    return ".".join([name, *map(str, member), *([letter] if letter else [])])


def _called(name: str, member: Member) -> str:
    return f"`{name}({', '.join(map(str, member))})`"


class UnresolvedError(Exception):
    """Signal that the size of a definition is needed before it has been determined."""


class Scope:
    """Families of a file and values of its parameters, with which expressions evaluate.

    An evaluation yields trees of scalars, see `trees`; it raises an ExpressionError
    with the place of the first fault. Names in `built_in` need no declaration.

    Attributes
    ----------
    variables, constraints : dict of str to Family
        The families by name; those of constraints have a namespace of their own.
    numbers : dict of str to float
        Values of the parameters that ranges and subscripts may contain.
    uses : dict of str to set of str
        The names in the expression of each parameter.
    used : set of str
        The names that expressions contain.
    """

    def __init__(self, graph: Graph, built_in: Collection[str]) -> None:
        self._graph, self._built_in = graph, built_in
        self.variables: dict[str, Family] = {}
        self.constraints: dict[str, Family] = {}
        self.numbers = {"pi": math.pi}
        self.uses: dict[str, set[str]] = {}
        self.used: set[str] = set()
        self.frame: Callable[[Steps, Indices], Frame] | None = None
        self.tables: frozenset[str] = frozenset()
        # parameters whose values depend on such parameters
        self.of_tables: set[str] = set()
        self._asked: set[str] = set()
        self._terms = 0
        self._faulty: set[str] = set()
        self.failed: ExpressionError | None = None  # fault found by `size`
        # Whether sums may become elements: in this file, and in this expression;
        # whether the indices of a sum are symbols.
        self.may_gather = self.gathers = self._generic = False
        self._permitted = gathering.DEFINED
        self.full = False
        self._sources: dict[tuple[str, object], Any] = {}
        # The terms of sums are counted once for all components of a value.
        self._last: tuple[object, ...] = (None,) * 3
        self._value: tuple[Value, Value | None, str] = EMPTY, None, ""

    @property
    def structural(self) -> set[str]:
        """Return the parameters on which ranges and subscripts of the file depend."""
        found, new = set[str](), set(self._asked)
        while new:
            found |= new
            new = {use for name in new for use in self.uses.get(name, ())} - found
        return found

    def noted(self, found: Parsed | ParsedRelation) -> Parsed | ParsedRelation:
        """Mark the names in an expression as used; return the expression."""
        for side in (
            (found,) if isinstance(found, Parsed) else (found.left, found.right)
        ):
            if side is not None:
                self.used.update([name for op, name, _ in side.postfix if op == "name"])
                self._graph.allow(_LETTERS * len(side.postfix))
        return found

    @contextmanager
    def gathering(
        self, permitted: gathering.Permitted | None = gathering.DEFINED
    ) -> Iterator[None]:
        """Context manager: read long sums of expressions as elements.

        permitted : conditions for such sums; None where no sum may be elements.
        """
        self.gathers = permitted is not None and self.may_gather
        self._permitted = permitted or gathering.DEFINED
        try:
            yield
        finally:
            self.gathers = False

    # Texts

    def source(self, text: str, parser: Parser) -> Any:
        """Return a text parsed by `parser`, which is called once for each text."""
        key = text, parser
        if key not in self._sources:
            try:
                self._sources[key] = _parsed(text, parser)
            except ExpressionError as fault:
                self._sources[key] = fault
        found = self._sources[key]
        if isinstance(found, ExpressionError):
            raise found
        return found

    def values(
        self, text: str, parser: Parser, indices: Indices
    ) -> tuple[Value, Value | None, str]:
        """Return the values of both sides of a relation, and its sign, for a member.

        For a text that is an expression, the left side is its value, the right side is
        None and the sign "".

        text, parser : the text, and the function that parses it.
        indices : values of the member's indices.
        """
        last = self._last
        if last[:2] != (text, parser) or last[2] is not indices:
            source = self.source(text, parser)
            if isinstance(source, Parsed):
                source = ParsedRelation(source, None, "")
            left, right = self.value(source.left.postfix, indices), None
            if source.right is not None:
                right = self.value(source.right.postfix, indices)
                sizes = trees.size(left), trees.size(right)
                if len({*sizes}) > 1 and left is not EMPTY and right is not EMPTY:
                    about = f"both sides must have one size, found {sizes[0]} and "
                    about += str(sizes[1])
                    raise ExpressionError(source.at, 1, about, "", EXPRESSION_SIZE)
            self._last, self._value = (
                (text, parser, indices),
                (left, right, source.sense),
            )
        return self._value

    def size(self, text: str, parser: Parser, indices: Indices) -> int:
        """Return the number of components of an expression or relation for a member.

        The result is 0 where the expression has a fault of its own, which is reported
        when the expression is read, and -1 where it depends on a faulty name.

        text, parser : the text, and the function that parses it.
        indices : values of the member's indices.

        Raises
        ------
        UnresolvedError
            Where the size depends on a definition whose size is not determined yet.
        """
        known, terms, full = set(self._faulty), self._terms, self.full
        try:
            left, right, _ = self.values(text, parser, indices)
        except ExpressionError as fault:
            self._faulty, self.full, self.failed = known, full, fault
            return -(fault.code == SILENT)
        finally:
            self._terms = terms
        return max(trees.size(left), 1 if right is None else trees.size(right))

    # Steps

    def value(self, steps: Steps, indices: Indices) -> Value:
        """Return the value of an expression, parsed into `steps`, for a member.

        The value is a tree or, for a vector, a tuple of trees.

        indices : values of the member's indices.
        """
        return self.run(steps, indices).pop()

    def run(self, steps: Steps, indices: Indices) -> list[Value]:
        """Return the stack of values after the postfix `steps`, for a member.

        indices : values of the member's indices.
        """
        stack: list[Value] = []
        for op, payload, token in steps:
            if op == "number":
                stack.append(trees.number(payload))
            elif op == "name":
                stack.append(indices.get(payload) or self._named(token))
            else:
                takes = payload if isinstance(payload, int) else payload.takes
                at = len(stack) - takes
                args = stack[at:]
                del stack[at:]
                stack.append(self._applied(op, payload, token, args, indices))
        return stack

    def _applied(
        self, op: str, payload: Any, token: Token, args: list[Value], indices: Indices
    ) -> Value:
        try:
            if op == "member" and token.text in self.tables:
                about = f"an argument of `{token.text}`"
                return trees.call(token.text, *(trees.scalar(a, about) for a in args))
            if op == "member":
                return self._member(token, args)
            if op in OF_FRAMES:
                return trees.OF_A_FRAME[op](
                    self._frame_of(payload.steps, indices), *args
                )
            if op == "over":
                return self._over(payload, token, args, indices)
            if op == "component":
                return _component(args[0], payload.word)
            return _operation(op, args, token)
        except UnfitError as fault:
            if unknown := [a for a in args if self._is_unknown(a)]:
                return unknown[0]  # the reader reports it
            by_index = op == "component"
            code: ExpressionCode = EXPRESSION_COMPONENT if by_index else EXPRESSION_SIZE
            raise token.fault(fault.text, fault.hint, code) from None

    def _is_unknown(self, value: Value) -> bool:
        """Whether a value is a single name that the file does not declare."""
        if not isinstance(value, Tree) or value.op != "name":
            return False
        name = str(value.value)
        return not ("." in name or name in self._built_in or self.reference(name))

    def _frame_of(self, named: Steps, indices: Indices) -> Frame:
        if self.frame is None:
            token = named[-1][2]
            text = f"there is no frame `{token.text}`: the file has no `frames`"
            raise token.fault(text, "", EXPRESSION_FRAME)
        return self.frame(named, indices)

    def reference(self, name: str) -> Family | None:
        """Return the family that a name denotes, as itself or in the name of a column.

        For the family q these are `q`, `q_dot`, `q_ddot`, and the columns of its
        forces, reactions or multipliers. None for a name that is not declared.
        """
        if family := self.variables.get(name):
            return family
        forms = [
            ("", ENDINGS[2]),
            ("", ENDINGS[1]),
            (FORCE.prefix, ""),
            (REACTION.prefix, ""),
        ]
        for before, after in forms:
            base = name.removeprefix(before).removesuffix(after)
            if len(base) + len(before + after) == len(name) and base in self.variables:
                return self.variables[base]
        base = name.removeprefix(MULTIPLIER.prefix)
        return self.constraints.get(base) if base != name else None

    def _named(self, token: Token) -> Value:
        """Return the value, a tree or a vector, of a name without subscripts.

        A family that has subscripts is a fault.

        token : the name in the text.
        """
        family = self.reference(token.text)
        if family is None:
            return trees.name(token.text, token.offset)
        _check(family)
        if family.indexed:
            hint = f"{family.described()}; or write sum(i = ..., {token.text}(i))"
            text = f"`{token.text}` is a family: a subscript is missing"
            raise token.fault(text, hint, EXPRESSION_SUBSCRIPT)
        return _of(family, token.text, (), token.offset)

    def _member(self, token: Token, args: list[Value]) -> Value:
        """Return the value of a name with subscripts: of a member or a component.

        token : the name in the text.
        args : trees of the subscripts.
        """
        name, family = token.text, self.reference(token.text)
        if family is None:
            known = [*CALLED, *(f.name for f in self.variables.values() if f.indexed)]
            hint = did_you_mean(name, known) if name[1:] else ""
            text = f"there is no function or family `{name}`"
            raise token.fault(text, hint, EXPRESSION_UNKNOWN_FUNCTION)
        _check(family)
        numbers = all(isinstance(x, Tree) and x.op == "number" for x in args)
        if not (family.indexed or family.letters or numbers):
            text = f"there is no function `{name}`"
            raise token.fault(text, "", EXPRESSION_UNKNOWN_FUNCTION)
        if self._generic and any(
            isinstance(x, Tree) and gathering.has(x, gathering.INDEX) for x in args
        ):
            return _referred(family, token, args)
        member = tuple(self.whole(arg, token) for arg in args)
        if not family.indexed:
            return _numbered(family, token, member)
        if member not in family.members:
            count = len(next(iter(family.members), member))
            text = f"there is no {_called(name, member)}: {family.described()}"
            if len(member) != count:
                text = f"`{name}` has {count} subscripts, found {len(member)}"
            hint = ""
            if family.section == "definitions" and len(member) == 1:
                hint = f"give it beside the range: {name}({member[0]}): ..."
            elif family.section == "coordinates" and len(member) == count == 1:
                hint = (
                    f"definitions may have other members, too: `x({member[0]}): 0` and "
                )
                hint += f"`x(i = 1..n): {name}(i)`"
            raise token.fault(text, hint, EXPRESSION_MEMBER)
        return _of(family, name, member, token.offset)

    def _over(
        self, of: Inner, token: Token, args: list[Value], indices: Indices
    ) -> Value:
        """Return a sum, minimum or maximum of terms over a range.

        of : the index and the steps of the terms.
        token : the name `sum`, `min` or `max` in the text.
        args : first and last value of the index.
        indices : values of the other indices.
        """
        if self._generic:
            return self._symbolic(of, token, args, indices)
        if self.gathers:
            return self._gathered(of, token, args, indices)
        first, last = (self.whole(arg, token) for arg in args)
        count = max(0, last - first + 1)
        self._terms += count
        if self._terms > limits.TERMS:
            text = f"the sums of this file have more than {limits.TERMS:,} terms"
            code: ExpressionCode = SILENT if self.full else EXPRESSION_TOO_MANY
            self.full = True
            hint = limits.without(f"this one has {count:,}")
            raise token.fault(text, hint, code)
        op = OVER_RANGES[token.text]
        if not count and op != "add":
            text = f"`{token.text}` over an empty range, {first}..{last}"
            hint = "it needs at least one member; only `sum` may have none"
            raise token.fault(text, hint, EXPRESSION_RANGE)
        total: Value = EMPTY
        inner = dict(indices)
        for k in range(first, last + 1):
            inner[of.word] = trees.number(k)
            term = self.value(of.steps, inner)
            total = term if k == first else _operation(op, [total, term], token)
        return total

    def _symbolic(
        self, of: Inner, token: Token, args: list[Value], indices: Indices
    ) -> Tree:
        """Return the tree of a sum whose indices are symbols, see `gathering`.

        Arguments as for `_over`. UnlikeError is raised for other operations than sums
        of numbers.
        """
        first, last = args
        if token.text != "sum" or not (
            isinstance(first, Tree) and isinstance(last, Tree)
        ):
            raise gathering.UnlikeError
        word = f"{of.word}.{len(indices)}"
        term = self.value(of.steps, indices | {of.word: gathering.index(word)})
        if not isinstance(term, Tree):
            raise gathering.UnlikeError
        return gathering.over(word, first, last, term)

    def _gathered(
        self, of: Inner, token: Token, args: list[Value], indices: Indices
    ) -> Value:
        """Return a sum as elements; written out where it cannot be elements.

        Arguments as for `_over`.
        """
        before = self._terms, set(self._faulty), self.full
        self._generic, self.gathers = True, False
        try:
            tree = self._symbolic(of, token, args, indices)
            known = gathering.Lookup(self._value_of, self._has, dotted, self._permitted)
            found, terms = gathering.gathered(tree, known)
            self._terms += terms
            if self._terms <= limits.TERMS:
                self._graph.count(terms / _GATHERED)
                return found
        except (gathering.UnlikeError, ExpressionError, UnfitError):
            pass
        finally:
            self._generic = False
            self.gathers = True
        # An inner sum is gathered by itself only if it is not part of another sum.
        self._terms, self._faulty, self.full = before
        self.gathers = False
        try:
            return self._over(of, token, args, indices)
        finally:
            self.gathers = True

    def _value_of(self, name: str, offset: int) -> float:
        """Return the value of a parameter that subscripts or ranges contain.

        offset : the offset of the name in the text, for messages.
        """
        self._check_number(name, offset)
        self._asked.add(name)
        return self.numbers[name]

    def _has(self, name: str, member: Member) -> bool:
        family = self.reference(name)
        return family is not None and member in family.members

    # Numbers

    def whole(self, value: Value, token: Token) -> int:
        """Return the integer value of a subscript, or of an end of a range.

        value : a tree: a number, or an expression of parameters.
        token : its place, for messages.
        """
        if not isinstance(value, Tree):
            text = f"a subscript is one number, found {trees.described(value)}"
            raise token.fault(text, "", EXPRESSION_SUBSCRIPT)
        names: set[str] = set()
        if value.op == "number":
            found = float(value.value)
        else:
            parsed = trees.parsed(value, "")
            names = {name.text for name in parsed.names}
            found = self.number(parsed)
            self._asked |= names
        nearest = round(found) if abs(found) < limits.LARGEST_INDEX else None
        if nearest is None or abs(found - nearest) > _WHOLE * abs(found):
            text = f"a subscript must be a whole number, found {found:g}"
            hint = "it counts, or names, the members of a family"
            raise token.fault(text, hint, self._once(names, EXPRESSION_SUBSCRIPT))
        return nearest

    def _once(self, names: set[str], code: ErrorCode) -> ExpressionCode:
        """Return the code of a fault of parameters, so that it is reported only once.

        It is `code` unless an earlier fault concerned one of the parameters; then it is
        SILENT, the code of faults that are not printed.

        names : the parameters.
        """
        known = not names.isdisjoint(self._faulty)
        self._faulty |= names
        return SILENT if known else code

    def note_structural(self, *values: Tree) -> None:
        """Record that the form of the equations depends on parameters in `values`.

        values : trees, such as the subscripts of a family.
        """
        parsed = (trees.parsed(value, "") for value in values)
        self._asked |= {name.text for found in parsed for name in found.names}

    def number(self, found: Parsed) -> float:
        """Return the value of a parsed expression of numbers and parameters.

        Raises
        ------
        ExpressionError
            If a parameter has no value for ranges and subscripts.
        """
        for name in found.names:
            self._check_number(name.text, name.offset)
        stack: list[float] = []
        for op, payload, _ in found.postfix:
            if op == "number":
                stack.append(float(payload))
            elif op == "name":
                stack.append(self.numbers[str(payload)])
            else:
                args = stack[-int(payload) :]
                del stack[-int(payload) :]
                if op in self.tables:
                    raise _follows_table(op, 0)
                stack.append(OPERATIONS[op](*args))
        return stack.pop()

    def _check_number(self, name: str, offset: int) -> None:
        """Raise an ExpressionError if a parameter has no value for ranges.

        offset : the offset of the name in the text.
        """
        if name in self.numbers:
            return
        if name in self.of_tables:
            raise _follows_table(name, offset)
        family = self.variables.get(name.partition(".")[0])
        if family and family.section == "parameters":
            raise ExpressionError(offset, len(name), "", code=SILENT)
        text = "ranges and subscripts contain only indices and parameters above; "
        about = f"`{name}` is none"
        code = self._once({name}, EXPRESSION_SUBSCRIPT)
        hint = "there are no delays: q(3) is a member, at the present time"
        hint *= name == "t"
        raise ExpressionError(offset, len(name), text + about, hint, code)


def _follows_table(name: str, offset: int) -> ExpressionError:
    about = f"a range, a subscript or an axis cannot follow a table: `{name}` does"
    hint = "write the number itself"
    return ExpressionError(offset, len(name), about, hint, EXPRESSION_RANGE)


def _parsed(text: str, parser: Parser) -> Any:
    found = tokens(text)
    if parser is parse_relation:
        return relation(text, found, lambda part: grammar.parsed(text, part))
    return grammar.parsed(text, found, conditional=parser is parse_condition)


def _check(family: Family) -> None:
    if family.broken:
        raise silent()
    if not family.resolved:
        raise UnresolvedError


def _of(family: Family, name: str, member: Member, offset: int) -> Value:
    """Return the tree of a member of a family; for a vector, a tuple of trees.

    name : the name of the family, or of its rate.
    member : the subscripts.
    offset : the offset of the name in the text.
    """
    if not family.letters:
        return trees.name(dotted(name, member), offset)
    return tuple(trees.name(dotted(name, member, c), offset) for c in family.letters)


def _referred(family: Family, token: Token, args: list[Value]) -> Value:
    """Return the tree of a member of a family in a long sum over its subscripts.

    The subscripts are trees, which contain the indices of the sum. For a family of
    vectors, return a tuple with the tree of each component.

    family : the family.
    token : the name in the text.
    args : the subscripts.
    """
    subscripts = [x for x in args if isinstance(x, Tree)]
    if not family.indexed or len(subscripts) < len(args):
        raise gathering.UnlikeError
    found = tuple(
        gathering.reference(token.text, letter, token.offset, subscripts)
        for letter in family.letters or ("",)
    )
    return found if family.letters else found[0]


def _numbered(family: Family, token: Token, member: Member) -> Value:
    """Return a component of a vector by its number: `G(2)` is the second one of G.

    family : the vector, which has no subscripts.
    token : its name in the text.
    member : (k,), the number of the component, k >= 1.
    """
    count = len(family.letters)
    if not count:
        text = f"`{token.text}` is no family, and has no subscripts"
        raise token.fault(text, "a product is written with `*`", EXPRESSION_SUBSCRIPT)
    if len(member) != 1 or not 1 <= member[0] <= count:
        text = f"`{token.text}` has the components 1 to {count}, found "
        raise token.fault(text + ", ".join(map(str, member)), "", EXPRESSION_MEMBER)
    found = _of(family, token.text, (), token.offset)
    return found[member[0] - 1] if not isinstance(found, Tree) else found


def _component(value: Value, letter: str) -> Tree:
    if isinstance(value, Tree):
        raise UnfitError(f"a number has no component `.{letter}`")
    letters = trees.components(len(value))
    if letter not in letters:
        raise UnfitError(f"{trees.described(value)} has no component `.{letter}`")
    return value[letters.index(letter)]


_HINTS = {"pow": "write dot(a, a)", "abs": "write norm(a)", "sqrt": "write norm(a)"}
_RULES: dict[str, Callable[..., Value]] = {
    "add": partial(trees.plus, "add"),
    "sub": partial(trees.plus, "sub"),
    "mul": partial(trees.times, "mul"),
    "div": partial(trees.times, "div"),
    "neg": trees.negative,
    "if": trees.choice,
    "vec": lambda *args: tuple(trees.scalar(a, "a component") for a in args),
    "dot": trees.dot,
    "cross": trees.cross,
    "norm": trees.norm,
    "unit": trees.unit,
    "spin": trees.spin,
}


def _operation(op: str, args: list[Value], token: Token) -> Value:
    """Return the tree or vector of the operation `op` on the values `args`.

    token : the operator or function in the text, for messages.
    """
    if op in _RULES:
        return _RULES[op](*args)
    if vectors := [a for a in args if trees.size(a) > 1]:
        text = f"`{token.text}` takes numbers, found {trees.described(vectors[0])}"
        raise UnfitError(text, _HINTS.get(op, ""))
    return Tree(op, args=tuple(a for a in args if isinstance(a, Tree)))


class MemberReading:
    """Evaluation of an expression for one member of a family.

    `indices` are the values of the member's indices. Of an expression whose value is a
    vector, component number `component` of `size` is read; `component` is None where
    the value must be a number.
    """

    __slots__ = ("_last", "component", "indices", "scope", "size")

    def __init__(
        self,
        scope: Scope,
        indices: Indices,
        component: int | None = None,
        size: int = 1,
    ) -> None:
        self.scope, self.indices = scope, indices
        self.component, self.size = component, size
        self._last: tuple[str | None, Any, Any] = None, None, None

    def parsed(self, text: str, parser: Parser) -> Any:
        """Return a text as postfix for this member: its names are single variables.

        For the member i = 2, `q(i) + 1` is `q.2 + 1`.

        parser : the function that parses `text`: of an expression, or of a relation.
        """
        if self._last[:2] != (text, parser):
            left, right, sense = self.scope.values(text, parser, self.indices)
            found: Any = self._part(left, text)
            if parser is parse_relation:
                other = None if right is None else self._part(right, text)
                found = ParsedRelation(found, other, sense)
            self._last = text, parser, found
        return self.scope.noted(self._last[2])

    def _part(self, value: Value, text: str) -> Parsed:
        if self.component is not None and not isinstance(value, Tree):
            if len(value) == self.size:
                value = value[self.component]
        elif self.component is not None and value is not EMPTY:
            about = f"a vector of {self.size} is expected here, found a number"
            raise ExpressionError(
                0, len(text), about, "write vec(a, b)", EXPRESSION_SIZE
            )
        if not isinstance(value, Tree):
            expected = f"a vector of {self.size}" if self.size > 1 else "a number"
            about = f"{expected} is expected here, found {trees.described(value)}"
            hint = "" if self.size > 1 else "write a component, `.x`, or `norm(...)`"
            raise ExpressionError(0, len(text), about, hint, EXPRESSION_SIZE)
        return trees.parsed(value, text)

    def words(self, text: str) -> set[str]:
        """Return the names in the expression of this member; empty after a fault."""
        for parser in (parse, parse_relation, parse_condition):
            try:
                return {name.text for name in self.parsed(text, parser).names}
            except ExpressionError:
                continue
        return set()

    def member(self) -> str:
        """Return the values of the indices, such as ` for i = 2`."""
        values = [f"{i} = {x.value:g}" for i, x in self.indices.items()]
        return f" for {', '.join(values)}" if values else ""


class HiddenReading(MemberReading):
    """Reading of a hidden definition (see `trees`), from its stored expression."""

    __slots__ = ("_parsed",)

    def __init__(self, scope: Scope, parsed: Parsed | ParsedRelation) -> None:
        super().__init__(scope, {})
        self._parsed = parsed

    def parsed(self, text: str, parser: Parser) -> Parsed | ParsedRelation:  # noqa: ARG002
        """Return the hidden definition's expression; both arguments are ignored."""
        return self.scope.noted(self._parsed)
