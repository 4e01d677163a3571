"""A sum over ranges as elements: the term is read once, the members are a table.

The term is evaluated with a symbol (`index`) for each index. In the result, a member of
a family is a *reference* with subscripts made of indices, and an inner sum is an
operation `over`. The sum is then brought into the form of plain sums: products are
multiplied into inner sums, sums that cannot be taken out are written out, and a
condition on indices alone divides the members. The ranges become columns of whole
numbers, one row for each member; subscripts, and numbers made of indices, are evaluated
on these columns. Where anything else is found, `UnlikeError` is raised, and the sum is
written out as usual, which reports any fault with its place.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim import limits
from lagsim.language import elements
from lagsim.language.elements import SHARED, TOTAL, ElementOutput, Elements, Slot
from lagsim.language.functions import ELEMENTS, JOINING, OPERATIONS, PART
from lagsim.language.graph import Graph
from lagsim.language.names import rated
from lagsim.model.expansion import trees
from lagsim.model.expansion.trees import Tree

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Ints

    Columns = dict[str, Ints]

# Operations of trees of this module.
INDEX, REFERENCE, OVER = "index", "reference", "over range"
# Tolerance within which a subscript is a whole number, in units in the last place.
_WHOLE = 4 * sys.float_info.epsilon


class UnlikeError(Exception):
    """Signal that a sum cannot be written as elements, and has to be written out."""


class Permitted(NamedTuple):
    """Conditions under which a sum may become elements.

    Attributes
    ----------
    few : bool
        Whether the sum may have fewer than `elements.PER_ARGUMENT` members for each
        argument.
    rates : bool
        Whether terms may contain rates.
    """

    few: bool
    rates: bool


# A definition may be used where its sum has to be written out.
DEFINED = Permitted(few=False, rates=True)
# By energy. M has no entries of sums of rates; a dissipation contributes none.
OF_ENERGIES = {
    "potential": Permitted(few=True, rates=False),
    "lagrangian": Permitted(few=True, rates=False),
    "dissipation": Permitted(few=True, rates=True),
}


class Lookup(NamedTuple):
    """Functions by which a sum reads parameters and members of families.

    `scope.Scope` makes them.

    Attributes
    ----------
    number : callable
        (name, offset in the expression, for messages) -> value of the parameter;
        records the name as used.
    has : callable
        (name, subscripts) -> whether the family has this member.
    dotted : callable
        (name, subscripts, component) -> name of the variable.
    permitted : Permitted
    """

    number: Callable[[str, int], float]
    has: Callable[[str, tuple[int, ...]], bool]
    dotted: Callable[..., str]
    permitted: Permitted


class Range(NamedTuple):
    """Index `word` of a sum, and the trees of its first and last values."""

    word: str
    first: Tree
    last: Tree


class Sum(NamedTuple):
    """Sum of a term over ranges, outer ones first."""

    ranges: tuple[Range, ...]
    term: Tree


class GatheredTerms(NamedTuple):
    """Term of a sum, with the number of its members and their indices.

    `columns` has, for each index, the value of the index in each member, (members,).
    """

    term: Tree
    columns: Columns
    members: int


def index(word: str) -> Tree:
    """Return the tree of the index of a range.

    word : its name.
    """
    return Tree(INDEX, word)


def over(word: str, first: Tree, last: Tree, term: Tree) -> Tree:
    """Return the tree of the sum of `term` over the index `word`.

    first, last : trees of the ends of the range.
    """
    return Tree(OVER, word, 0, (first, last, term))


def reference(name: str, letter: str, offset: int, subscripts: Sequence[Tree]) -> Tree:
    """Return the tree of a member of a family whose subscripts contain indices.

    name, letter : the family, and a component or "".
    offset : the offset of the name in the text.
    """
    return Tree(REFERENCE, f"{name}\0{letter}", offset, tuple(subscripts))


def has(tree: Tree, *ops: str) -> bool:
    """Whether a tree contains an operation with one of the given names."""
    return tree.op in ops or any(has(a, *ops) for a in tree.args)


def gathered(tree: Tree, known: Lookup) -> tuple[Tree, int]:
    """Return a sum as a tree with elements, and the number of its terms.

    See `language.elements`.

    Raises
    ------
    UnlikeError
        Where the sum has to be written out.
    """
    groups: list[GatheredTerms] = []
    terms = 0
    for one in _sums(tree):
        columns: Columns = {}
        members = 1
        for part in one.ranges:
            columns, members = _extended(columns, members, part, known)
            terms += members
        if members:
            groups += _divided(one.term, columns, members, known)
    if not groups or sum(x.members for x in groups) < elements.LEAST:
        raise UnlikeError
    made = [_ElementBuilder(x, known).tree() for x in groups]
    found = made[0]
    for other in made[1:]:
        found = trees.call("add", found, other)
    return found, terms


# --- The form of a sum


def _sums(tree: Tree) -> list[Sum]:
    """Return sums over ranges that add up to the tree.

    A term without a range is a Sum with no ranges; inner sums that cannot be taken out
    are written out.
    """
    if tree.op == OVER:
        first, last, term = tree.args
        own = Range(str(tree.value), first, last)
        return [x._replace(ranges=(own, *x.ranges)) for x in _sums(term)]
    if not has(tree, OVER):
        return [Sum((), tree)]
    if tree.op == "add":
        return [x for a in tree.args for x in _sums(a)]
    if tree.op in ("sub", "neg"):
        negative = [
            x._replace(term=trees.call("neg", x.term)) for x in _sums(tree.args[-1])
        ]
        return [x for a in tree.args[:-1] for x in _sums(a)] + negative
    inner = [has(a, OVER) for a in tree.args]
    if tree.op == "mul" and sum(inner) == 1:
        a, b = tree.args
        if inner[0]:
            return [_times(x, lambda t: trees.call("mul", t, b)) for x in _sums(a)]
        return [_times(x, lambda t: trees.call("mul", a, t)) for x in _sums(b)]
    if tree.op == "div" and inner == [True, False]:
        a, b = tree.args
        return [_times(x, lambda t: trees.call("div", t, b)) for x in _sums(a)]
    return [Sum((), _unrolled(tree))]


def _times(one: Sum, scaled: Callable[[Tree], Tree]) -> Sum:
    return one._replace(term=scaled(one.term))


# Terms of an inner sum that is written out within the term.
_MOST_INNER = 16


def _unrolled(tree: Tree) -> Tree:
    """Return a tree with sums over short ranges between numbers written out."""
    if tree.op == OVER:
        first, last, term = tree.args
        if not first.op == last.op == "number":
            raise UnlikeError
        a, b = int(float(first.value)), int(float(last.value))
        if not 0 <= b - a < _MOST_INNER:
            raise UnlikeError
        term = _unrolled(term)
        word = str(tree.value)
        terms = [_with(term, word, trees.number(k)) for k in range(a, b + 1)]
        found = terms[0]
        for other in terms[1:]:
            found = trees.call("add", found, other)
        return found
    return tree._replace(args=tuple(map(_unrolled, tree.args)))


def _with(tree: Tree, word: str, value: Tree) -> Tree:
    """Return a tree with each use of the index `word` replaced by the tree `value`."""
    if tree.op == INDEX and tree.value == word:
        return value
    return tree._replace(args=tuple(_with(a, word, value) for a in tree.args))


# --- Members


def _extended(
    columns: Columns, members: int, part: Range, known: Lookup
) -> tuple[Columns, int]:
    """Return the columns of all indices, and their length, for one more inner range.

    columns : values (members,) of each outer index.
    part : the inner range.
    """
    first, last = (_wholes(x, columns, members, known) for x in (part.first, part.last))
    counts = np.maximum(last - first + 1, 0)
    total = int(counts.sum())
    if total > limits.TERMS:
        raise UnlikeError
    found = {word: np.repeat(x, counts) for word, x in columns.items()}
    starts = np.cumsum(counts) - counts
    found[part.word] = np.arange(total) + np.repeat(first - starts, counts)
    return found, total


def _wholes(tree: Tree, columns: Columns, members: int, known: Lookup) -> Ints:
    """Return the values (members,) of a tree of indices, as whole numbers.

    Values that are not whole raise UnlikeError.

    columns : values (members,) of each index.
    """
    found = np.broadcast_to(_numbers(tree, columns, known), (members,))
    nearest = np.rint(found)
    if not (np.abs(found - nearest) <= _WHOLE * np.abs(found)).all():
        raise UnlikeError
    if not (np.abs(nearest) < limits.LARGEST_INDEX).all():
        raise UnlikeError
    return np.asarray(nearest, np.int64)


def _numbers(tree: Tree, columns: Columns, known: Lookup | None) -> Any:
    """Return the values of a tree of numbers, indices and parameters.

    The values are an array, or a number if no index occurs.

    columns : values (members,) of each index.
    known : source of parameters; without it parameters are not permitted.
    """
    if tree.op == "number":
        return float(tree.value)
    if tree.op == INDEX:
        return columns[str(tree.value)].astype(float)
    if tree.op == "name" and known is not None:
        return known.number(str(tree.value), tree.offset)
    if tree.op not in OPERATIONS or not tree.args:
        raise UnlikeError
    args = [_numbers(a, columns, known) for a in tree.args]
    with np.errstate(all="ignore"):
        return elements.value_of(tree.op, args)


def _of_indices(tree: Tree) -> bool:
    """Whether a tree consists of numbers and indices, at least one of these."""
    return has(tree, INDEX) and _is_numeric(tree)


def _is_numeric(tree: Tree) -> bool:
    if not tree.args:
        return tree.op in ("number", INDEX)
    return tree.op in OPERATIONS and all(map(_is_numeric, tree.args))


def _divided(
    term: Tree, columns: Columns, members: int, known: Lookup
) -> list[GatheredTerms]:
    """Return groups of members, in each of which conditions on indices have one value.

    Each group has the term with the branches of `if` that its members take.

    columns : values (members,) of each index.
    known : parameters of the file.
    """
    condition = _condition(term)
    if condition is None:
        if term.op == "number" and term.value == 0.0:
            return []
        return [GatheredTerms(term, columns, members)]
    true = np.broadcast_to(_numbers(condition, columns, None), (members,)).astype(bool)
    found = []
    for k, chosen in enumerate((true, ~true)):
        own = {word: x[chosen] for word, x in columns.items()}
        if count := int(chosen.sum()):
            found += _divided(_selected(term, condition, k), own, count, known)
    return found


def _condition(tree: Tree) -> Tree | None:
    """Return the condition of the first `if` that depends on indices alone, or None."""
    if tree.op == "if" and _of_indices(tree.args[0]):
        return tree.args[0]
    return next((x for x in map(_condition, tree.args) if x is not None), None)


def _selected(tree: Tree, condition: Tree, k: int) -> Tree:
    """Return a tree with branch k in place of each `if` that has the condition."""
    if tree.op == "if" and tree.args[0] == condition:
        return _selected(tree.args[1 + k], condition, k)
    args = tuple(_selected(a, condition, k) for a in tree.args)
    if tree.op == "mul" and any(a.op == "number" and a.value == 0.0 for a in args):
        return trees.ZERO
    return tree._replace(args=args)


# --- The term and its table


class _ElementBuilder:
    """Converter of a group of members with one term to elements.

    Elements are the term in a graph of its own, slots, and a table of the members.
    """

    def __init__(self, group: GatheredTerms, known: Lookup) -> None:
        self.group, self.known = group, known
        self.graph = Graph()
        self.names: dict[str, tuple[int, int]] = {}  # name -> argument, offset
        self.slots: dict[object, Slot] = {}
        self.table: dict[object, tuple[int, Ints, list[tuple[int, ...]]]] = {}

    def tree(self) -> Tree:
        """Return the tree of the group's sum, as an operation on its elements."""
        node = self._node(self.group.term)
        g = self.graph
        for n in g.cone([node]):
            row = OPERATIONS.get(g.ops[n])
            if row is not None and not _is_plain(g, n):
                raise UnlikeError
        count, group = len(self.names), self.group
        few = group.members < elements.PER_ARGUMENT * count
        if few and not self.known.permitted.few:
            raise UnlikeError
        columns = [x for _, x, _ in self.table.values()]
        table: Ints = np.zeros((group.members, len(columns)), np.int32)
        for k, column in enumerate(columns):
            table[:, k] = column
        example = trees.parsed(self._example(group.term), "")
        of = Elements(
            g, list(self.slots.values()), [ElementOutput(node, TOTAL)], table, count, 1,
            example, group.columns,
        )  # fmt: skip
        args = [trees.name(x, offset) for x, (_, offset) in self.names.items()]
        data = Tree("data", of)  # type: ignore[arg-type]
        vector = trees.call(ELEMENTS, data, *args)
        return trees.call(PART, vector, trees.ZERO)

    def _node(self, tree: Tree) -> int:
        """Return the node of a tree in the elements' own graph; leaves become slots."""
        if tree.op == "number":
            return self.graph.constant(float(tree.value))
        if tree.op in ("name", REFERENCE) or _of_indices(tree):
            if tree.op == "name" and tree.value == "pi":
                return self.graph.constant(np.pi)
            key = tree._replace(offset=0)
            if key not in self.slots:
                self.slots[key] = self._slot(tree)
            return self.slots[key].node
        if tree.op not in OPERATIONS or not tree.args or tree.op in JOINING:
            raise UnlikeError
        return self.graph.call(tree.op, *map(self._node, tree.args))

    def _slot(self, tree: Tree) -> Slot:
        node = self.graph.variable(f"slot.{len(self.slots)}")
        none = np.zeros(0)
        if tree.op == "name":
            places = np.array([self._argument(str(tree.value), tree.offset)])
            return Slot(node, SHARED, places, none)
        if tree.op != REFERENCE:
            words = sorted(_words(tree))
            k, _, positions = self._column(tuple(map(index, words)))
            each = map(np.array, zip(*positions, strict=True))
            arrays = dict(zip(words, each, strict=True))
            numbers = np.broadcast_to(_numbers(tree, arrays, None), (len(positions),))
            numbers = np.array(numbers, float)
            return Slot(node, k, np.zeros(0, np.int64), numbers, tree)
        name, letter = str(tree.value).split("\0")
        k, _, positions = self._column(tree.args)
        if not all(self.known.has(name, x) for x in positions):
            raise UnlikeError
        names = [self.known.dotted(name, x, letter) for x in positions]
        places = np.array([self._argument(x, tree.offset) for x in names])
        return Slot(node, k, places, none)

    def _argument(self, name: str, offset: int) -> int:
        if not self.known.permitted.rates and rated(name)[1]:
            raise UnlikeError
        return self.names.setdefault(name, (len(self.names), offset))[0]

    def _column(
        self, subscripts: tuple[Tree, ...]
    ) -> tuple[int, Ints, list[tuple[int, ...]]]:
        """Return the column of the table for subscripts that contain indices.

        Returns
        -------
        number : int
            Number of the column.
        positions : ndarray, shape (members,)
            For each member, an index of `values`.
        values : list of tuple of int
            The different values of the subscripts.
        """
        key = tuple(x._replace(offset=0) for x in subscripts)
        if key not in self.table:
            group, known = self.group, self.known
            wholes = [_wholes(x, group.columns, group.members, known) for x in key]
            code = np.zeros(group.members, np.int64)
            for x in wholes:
                low, span = int(x.min()), int(np.ptp(x)) + 1
                if span * (int(code.max()) + 1) > 2**62:
                    raise UnlikeError
                code = code * span + (x - low)
            _, first, positions = np.unique(
                code, return_index=True, return_inverse=True
            )
            found = list(zip(*(x[first].tolist() for x in wholes), strict=True))
            self.table[key] = len(self.table), positions.reshape(-1), found
        return self.table[key]

    def _example(self, tree: Tree) -> Tree:
        """Return the term with the indices of the first member, as a tree."""
        if tree.op == INDEX:
            return trees.number(float(self.group.columns[str(tree.value)][0]))
        if tree.op == REFERENCE:
            name, letter = str(tree.value).split("\0")
            _, column, positions = self._column(tree.args)
            dotted = self.known.dotted(name, positions[int(column[0])], letter)
            return trees.name(dotted, tree.offset)
        return tree._replace(args=tuple(map(self._example, tree.args)))


def _words(tree: Tree) -> set[str]:
    """Return the names of the indices in a tree."""
    if tree.op == INDEX:
        return {str(tree.value)}
    return set().union(*map(_words, tree.args)) if tree.args else set()


def _is_plain(g: Graph, n: int) -> bool:
    """Whether an operation of a term is smooth, with constant exponents of powers."""
    row = OPERATIONS[g.ops[n]]
    if row.partials is None or row.branches or row.condition or row.switch or row.data:
        return False
    return g.ops[n] != "pow" or g.value(g.args[n][1]) is not None
