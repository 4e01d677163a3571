"""Sums of elements as sums with indices, for people.

A node `elements.part` is shown as sums over the members that contribute to it, such as
sum(j = 1..4, ...) + sum(j = 6..50, ...) for the force on body 5. The term is translated
and tidied once; in each sum the slots become names with indices. Members whose names
follow no such rule are added up one by one.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import sympy as sp

from lagsim import limits
from lagsim.language.elements import payload
from lagsim.language.graph import VARIABLE
from lagsim.show.names import LETTERS_OF_MEMBERS, PrintedName
from lagsim.show.symbols import TWINS, number, symbol, to_sympy
from lagsim.show.tidy import too_long

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Ints
    from lagsim.language.elements import Elements, Slot
    from lagsim.show.symbols import Translation

# Up to this number of members are added up one by one.
FEW = 2
# Largest number of ranges into which the members of a sum are divided.
_MOST_RANGES = 4
_NUMBERS = re.compile(r"(?<=\.)([0-9]+)(?=\.|\Z)")
_LETTER = re.compile(r"\.[ijkmn]([+-][0-9]+)?(?=\.|\Z)")


class _NoRuleError(Exception):
    """Signal that members follow no rule by which they could have indices."""


class _Share(NamedTuple):
    """Members that contribute to one sum.

    Attributes
    ----------
    term : sympy expression
        The term, with indices in its names.
    values : dict
        For each letter of an index, outer ones first, its value in each member.
    members : list of (sympy expression, ndarray)
        The term with slots as symbols, and the members that have this term.
    """

    term: Any
    values: dict[str, Ints]
    members: list[tuple[Any, Ints]]


class _Rule(NamedTuple):
    """Names of a slot in all members.

    Attributes
    ----------
    name : PrintedName
        The name in the last member.
    subscripts : list of (str, int)
        For each number in the name an index of the file, or "", and the number that is
        added to the index.
    rank : (int, int)
        Rank of the name, see `symbols.Translation`.
    """

    name: PrintedName
    subscripts: list[tuple[str, int]]
    rank: tuple[int, int]

    @property
    def words(self) -> set[str]:
        """The indices of the file on which the names depend."""
        return {word for word, _ in self.subscripts}


class MemberSums:
    """The sums of elements of a model as expressions of sympy.

    Parameters
    ----------
    x
        The symbols of the model; symbols with an index letter are added to it.
    """

    def __init__(self, x: Translation) -> None:
        self.x = x
        # The first letter is that of rows, see `text.Families`: the last choice.
        free = [c for c in LETTERS_OF_MEMBERS if c not in x.own_names]
        taken = {name.partition(".")[0] for name in x.own_names}
        self.letters = [c for c in (*free[1:], *free[:1]) if c not in taken]
        self._terms: dict[tuple[str, int], Any] = {}
        self._members: dict[tuple[str, int], tuple[Ints, Ints]] = {}
        self._rules: dict[tuple[int, int], _Rule | None] = {}
        self._varying: dict[tuple[str, int], list[str]] = {}
        self._expressions: dict[Any, Any] = {}

    def inserted(self, part: Any) -> Any:
        """Return a part of a document with sums in place of their symbols."""
        if isinstance(part, dict):
            return {key: self.inserted(value) for key, value in part.items()}
        if isinstance(part, list | tuple):
            return type(part)(self.inserted(value) for value in part)
        if not isinstance(part, sp.Basic):
            return part
        found = part.free_symbols & self.x.sums.keys()
        for s in found - self._expressions.keys():
            self._expressions[s] = self.expression(self.x.sums[s])
        return part.xreplace({s: self._expressions[s] for s in found})

    def expression(self, node: int) -> Any:
        """Return the sum that a node `elements.part` selects.

        Raises
        ------
        InputError
            If its members follow no rule and are too many to be written one by one.
        """
        g = self.x.g
        vector, which = g.args[node]
        of, args = payload(g, vector), g.args[vector][1:]
        k = int(g.value(which) or 0.0)
        shares, alone = list[_Share](), list[Any]()
        for o, output in enumerate(of.outputs):
            rows = self._rows(of, o, k)
            term = self._term(of, output.node)
            try:
                shares.append(self._share(vector, term, rows, self._free(of, o)))
            except _NoRuleError:
                alone += self._one_by_one(of, args, term, rows)
        for share in _joined(shares):
            if sum(len(rows) for _, rows in share.members) > FEW:
                alone.append(self._sums(share))
                continue
            for term, rows in share.members:
                alone += self._one_by_one(of, args, term, rows)
        return sp.Add(*alone)

    def _free(self, of: Elements, o: int) -> list[str]:
        """Return the indices that vary among the members of a component of output o."""
        key = of.digest, o
        if key not in self._varying:
            order, starts = self._starts(of, o)
            inner = starts[(starts > 0) & (starts < len(order))]
            self._varying[key] = []
            for word, column in of.indices.items():
                steps = np.diff(column[order]) != 0
                steps[inner - 1] = False  # from one component to the next
                if steps.any():
                    self._varying[key].append(word)
        return self._varying[key]

    def _rows(self, of: Elements, o: int, k: int) -> Ints:
        """Return the members that add output o to component k."""
        order, starts = self._starts(of, o)
        return order[starts[k] : starts[k + 1]]

    def _starts(self, of: Elements, o: int) -> tuple[Ints, Ints]:
        """Return the members by component of output o, and the first of each."""
        key = of.digest, o
        if key not in self._members:
            where = of.targets(of.outputs[o])
            order = np.argsort(where, kind="stable")
            starts = np.searchsorted(where[order], np.arange(of.size + 1))
            self._members[key] = order, starts
        return self._members[key]

    def _term(self, of: Elements, node: int) -> Any:
        """Return a node of the term, with the slots as symbols."""
        key = of.digest, node
        if key not in self._terms:
            (e,) = to_sympy(of.graph, [node])
            self._terms[key] = self.x.tidy(e)
        return self._terms[key]

    def _shown(self, node: int) -> Any:
        """Return the expression of an argument."""
        x = self.x
        return x.known[node] if node in x.known else to_sympy(x.g, [node])[0]

    def _name(self, node: int) -> tuple[PrintedName, tuple[int, int]] | None:
        """Return name and rank of an argument; None without a name."""
        x = self.x
        variable = x.g.ops[node] == VARIABLE
        s = symbol(str(x.g.payload(node))) if variable else x.known.get(node)
        return (x.names[s], x.rank[s]) if s in x.names else None

    def _one_by_one(
        self, of: Elements, args: Sequence[int], term: Any, rows: Ints
    ) -> list[Any]:
        """Return the terms of some members."""
        if len(rows) > limits.WRITTEN_TERMS:
            raise too_long(
                f"a sum of {len(rows):,} terms has no indices in its names, and the "
                f"limit of a sum that is written out is {limits.WRITTEN_TERMS:,} terms"
            )
        found = []
        for row in rows.tolist():
            new = {}
            for slot in of.slots:
                k = 0 if slot.column < 0 else int(of.table[row, slot.column])
                new[_variable(of, slot)] = (
                    number(float(slot.numbers[k]))
                    if len(slot.numbers)
                    else self._shown(args[int(slot.places[k])])
                )
            found.append(self._signed(term.xreplace(new)))
        return found

    def _share(
        self,
        vector: int,
        term: Any,
        rows: Ints,
        varying: Sequence[str],
    ) -> _Share:
        """Return members with indices in the names of their term.

        varying : the indices of the file that become indices of the sum.
        """
        of = payload(self.x.g, vector)
        columns = {word: column[rows] for word, column in of.indices.items()}
        if not (len(rows) and varying) or len(varying) > len(self.letters):
            raise _NoRuleError
        letters = dict(zip(varying, self.letters, strict=False))
        used, new = term.free_symbols, {}
        for slot in of.slots:
            if (s := _variable(of, slot)) in used:
                new[s] = self._indexed(vector, slot, rows, letters)
        values = {letters[word]: columns[word] for word in varying}
        _forms(values)  # has a rule
        return _Share(self._signed(term.xreplace(new)), values, [(term, rows)])

    def _indexed(
        self, vector: int, slot: Slot, rows: Ints, letters: Mapping[str, str]
    ) -> Any:
        """Return a slot of some members as an expression with indices.

        letters : letter of each index that varies.
        """
        g = self.x.g
        of, args = payload(g, vector), g.args[vector][1:]
        k = 0 if slot.column < 0 else int(of.table[rows[0], slot.column])
        columns = {word: int(column[rows[0]]) for word, column in of.indices.items()}
        if len(slot.numbers):
            if slot.column < 0:
                return number(float(slot.numbers[k]))
            return self._of_indices(slot.rule, columns, letters)
        rule = self._rule(vector, slot)
        if rule.words.isdisjoint(letters):
            return self._shown(args[int(slot.places[k])])
        texts = iter([
            f"{letters[word]}{off:+d}".removesuffix("+0")
            if word in letters
            else str(off + columns.get(word, 0))
            for word, off in rule.subscripts
        ])  # fmt: skip
        base = _NUMBERS.sub(lambda _: next(texts), rule.name.base)
        name = replace(rule.name, base=base)
        made = symbol(" ".join((name.kind, base, "'" * name.order)))
        return self.x.add(made, name, rule.rank)

    def _rule(self, vector: int, slot: Slot) -> _Rule:
        """Return the rule by which the names of a slot depend on the indices."""
        if (vector, slot.node) not in self._rules:
            self._rules[vector, slot.node] = self._found_rule(vector, slot)
        rule = self._rules[vector, slot.node]
        if rule is None:
            raise _NoRuleError
        return rule

    def _found_rule(self, vector: int, slot: Slot) -> _Rule | None:
        g = self.x.g
        of, args = payload(g, vector), g.args[vector][1:]
        nodes = [args[int(p)] for p in slot.places]
        first, rank = self._name(nodes[-1]) or (PrintedName(""), (0, 0))
        if slot.column < 0:
            return _Rule(first, [], rank)
        names = [found[0] for found in map(self._name, nodes) if found]
        stems = {(_NUMBERS.sub("#", x.base), x.order, x.kind) for x in names}
        if len(names) < len(nodes) or len(stems) > 1:
            return None
        numbers = np.array([[int(k) for k in _NUMBERS.findall(x.base)] for x in names])
        subscripts: list[tuple[str, int]] = []
        for values in numbers[of.table[:, slot.column]].T:
            offs = {word: values - column for word, column in of.indices.items()}
            offs[""] = values
            found = [(w, int(x[0])) for w, x in offs.items() if x.min() == x.max()]
            if not found:
                return None
            subscripts.append(found[-1])  # a number, if it is one
        return _Rule(first, subscripts, rank)

    def _of_indices(
        self, rule: Any, columns: Mapping[str, int], letters: Mapping[str, str]
    ) -> Any:
        """Return an expression of indices, as parsed, as one of sympy.

        columns : values of the indices without a letter.
        """
        if rule is None:
            raise _NoRuleError
        if not rule.args:
            if rule.value in letters:
                return self._letter(letters[rule.value])
            return number(float(columns.get(rule.value, rule.value)))
        args = [self._of_indices(a, columns, letters) for a in rule.args]
        return TWINS[rule.op](*args)

    def _letter(self, letter: str) -> Any:
        """Return the symbol of an index."""
        return self.x.add(symbol(letter), PrintedName(letter, 0, "index"), (1, -1))

    def _sums(self, share: _Share) -> Any:
        """Return the sum of one share as nested sums of sympy."""
        made = []
        for form in _forms(share.values):
            e = share.term
            for letter, first, last in reversed(form):
                ends = (
                    end if outer is None else self._letter(outer) + end
                    for outer, end in (first, last)
                )
                e = sp.Sum(e, (self._letter(letter), *ends))
            made.append(e)
        return sp.Add(*made)

    # Signs

    def _signed(self, e: Any) -> Any:
        """Return e with sums turned so that equal terms of two members look alike.

        (x_j - x_3)^2 is (x_3 - x_j)^2, and x_j - x_3 is -(x_3 - x_j).
        """
        if e.is_Atom:
            return e
        args = [self._signed(a) for a in e.args]
        if e.is_Pow and args[0].is_Add and args[1].is_Integer:
            sign, base = self._turned(args[0])
            return sign ** args[1] * base ** args[1]
        if e.is_Mul:
            args = [p for a in args for p in (self._turned(a) if a.is_Add else (a,))]
        return e.func(*args)

    def _turned(self, e: Any) -> tuple[Any, Any]:
        """Return a sign, and the sum that e is, times this sign.

        The first of the symbols, names with an index last, has no minus.
        """
        names, rank = self.x.names, self.x.rank

        def place(term: Any) -> tuple[Any, ...]:
            own = [
                (bool(_LETTER.search(names[s].base)), rank[s], s.name)
                for s in term.free_symbols
            ]
            return (not own, *min(own, default=()))

        coefficient, _ = min(sp.Add.make_args(e), key=place).as_coeff_Mul()
        if coefficient < 0:
            return sp.S.NegativeOne, sp.Add(*(-a for a in e.args))
        return sp.S.One, e


def _variable(of: Elements, slot: Slot) -> Any:
    return symbol(str(of.graph.payload(slot.node)))


def _joined(shares: Sequence[_Share]) -> list[_Share]:
    """Return shares; those of one term and one index are joined."""
    found: dict[Any, _Share] = {}
    for share in shares:
        key = share.term, *share.values
        if key in found and len(share.values) == 1:
            ((letter, own),) = share.values.items()
            both = np.concatenate([found[key].values[letter], own])
            try:
                _forms({letter: both})
            except _NoRuleError:
                key = (*key, len(found))
            else:
                members = [*found[key].members, *share.members]
                found[key] = _Share(share.term, {letter: both}, members)
                continue
        elif key in found:
            key = (*key, len(found))
        found[key] = share
    return list(found.values())


# An end of a range: a number, after the letter of an outer index or None.
_End = tuple[str | None, int]
_Range = tuple[str, _End, _End]


def _forms(values: Mapping[str, Ints]) -> list[list[_Range]]:
    """Return nested ranges that together run over all members, outer ones first.

    values : values (members,) of each index, by letter, outer ones first.
    """
    (outer, own), *inner = values.items()
    different, counts = np.unique(own, return_counts=True)
    if not inner:
        if counts.max() > 1:
            raise _NoRuleError
        cuts = np.flatnonzero(np.diff(different) > 1) + 1
        runs = np.split(different, cuts)
        found = [[(outer, _at(x[0]), _at(x[-1]))] for x in runs]
    elif len(inner) == 1:
        found = _pairs(outer, own, *inner[0])
    else:
        found = [[(x, _at(v.min()), _at(v.max())) for x, v in values.items()]]
        size = np.prod([int(np.ptp(v)) + 1 for v in values.values()])
        rows = np.unique(np.array([*values.values()]), axis=1)
        if not size == rows.shape[1] == len(own):
            raise _NoRuleError
    if len(found) > _MOST_RANGES:
        raise _NoRuleError
    return found


def _at(k: Any) -> _End:
    return None, int(k)


def _pairs(outer: str, own: Ints, letter: str, other: Ints) -> list[list[_Range]]:
    """Return the nested ranges of two indices, see `_forms`.

    The ends of the inner range are numbers, or the outer index and a number.

    own, other : the values (members,) of the outer and of the inner index.
    """
    order = np.lexsort((other, own))
    a, b = own[order], other[order]
    first = np.flatnonzero(np.diff(a, prepend=a[0] - 1))
    last = np.append(first[1:], len(a)) - 1
    if not (b[last] - b[first] == last - first).all():
        raise _NoRuleError
    if not (np.diff(b)[np.diff(a) == 0] == 1).all():
        raise _NoRuleError
    found: list[list[_Range]] = []
    begin, ends = 0, list[set[_End]]()
    numbers = a[first]
    steps = [
        [{_at(x), (outer, int(x - v))} for v, x in zip(numbers, b[k], strict=True)]
        for k in (first, last)
    ]
    for place, v in enumerate(numbers):
        own_ends = [step[place] for step in steps]
        ends = [e & x for e, x in zip(ends or own_ends, own_ends, strict=True)]
        if not place or v - numbers[place - 1] > 1 or not all(ends):
            ends, begin = own_ends, place
            found.append([])
        low, high = (min(e, key=lambda x: (x[0] is not None, x[1])) for e in ends)
        found[-1] = [(outer, _at(numbers[begin]), _at(v)), (letter, low, high)]
    return found
