"""Families in formulas: what members have in common is written once.

The rows `x.2 = x.1 + l*sin(q.2)` to `x.9 = x.8 + l*sin(q.9)` are one, and so are the
terms of a sum: formulas whose names differ in the number of the member only, counted
from the row's own, are the same with a letter in its place.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import sympy as sp

from lagsim.show.names import LETTERS_OF_MEMBERS, Name
from lagsim.show.symbols import symbol

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.show.symbols import Translation

# The number of a member is the first in its name: `tip.3.x`, or `x3`.
_NUMBER = re.compile(r"(\.|(?<=[^\W\d]))([0-9]+)(?=\.|\Z)")
# So few names or terms that differ in a number are no family.
FEW = 2
# Expressions are compared multiplied out where that makes no more terms.
MOST_TERMS = 1_000


class Rows(NamedTuple):
    """Rows that are one for all `members` of a family, numbers in order.

    A row alone has no members. `name` and `parts`, expressions, have the letter in
    place of the numbers.
    """

    name: Name
    parts: tuple[Any, ...]
    members: tuple[int, ...]


class Families:
    """Writes rows, and terms of sums, as families.

    Parameters
    ----------
    x
        The symbols of a model; those of members with a letter are added.
    found
        Whether there are families; else each row and each term stands alone.

    Attributes
    ----------
    letter, other : str
        What stands for the number of a member: in rows, and in sums.
    """

    def __init__(self, x: Translation, *, found: bool = True) -> None:
        self.x, self.found = x, found
        free = [c for c in LETTERS_OF_MEMBERS if c not in x.own_names]
        self.letter, self.other = (*free, *LETTERS_OF_MEMBERS)[:2]
        bases = {name.base for name in x.names.values()}
        self._stems = Counter(_NUMBER.sub("", base, count=1) for base in bases)

    def member_of(self, name: Name) -> int | None:
        """Give the number of a member; None of what is in no family."""
        found = _NUMBER.search(name.base)
        if found is None or not self.found:
            return None
        alike = self._stems[_NUMBER.sub("", name.base, count=1)]
        return int(found[2]) if found[1] or alike > FEW else None

    def rows(self, rows: Iterable[tuple[Name, Sequence[Any]]]) -> list[Rows]:
        """Give rows, those of a family together, where the first of them stood."""
        found: dict[Any, list[tuple[int, Name, tuple[Any, ...]]]] = {}
        for place, (name, parts) in enumerate(rows):
            k = self.member_of(name)
            key: Any = place
            if k is not None:
                common = (self._counted(e, k, self.letter) for e in parts)
                # Signs of sums within depend on the order of the names.
                whole = (e if _terms(e) > MOST_TERMS else sp.expand(e) for e in common)
                key = self._name(name, k, self.letter), tuple(whole)
            found.setdefault(key, []).append((k or 0, name, tuple(parts)))
        result = []
        for members in found.values():
            numbers = tuple(sorted(k for k, *_ in members))
            k, name, parts = members[0]
            if len(members) > 1:
                name = self._name(name, k, self.letter)
                parts = tuple(self._counted(e, k, self.letter) for e in parts)
            else:
                numbers = ()
            result.append(Rows(name, tuple(map(self.sums, parts)), numbers))
        return result

    def _name(self, name: Name, k: int, letter: str) -> Name:
        """Give a name whose number is counted from k."""

        def counted(number: re.Match[str]) -> str:
            off = int(number[2]) - k
            return f".{letter}{off:+d}" if off else f".{letter}"

        return replace(name, base=_NUMBER.sub(counted, name.base, count=1))

    def _counted(self, e: Any, k: int, letter: str) -> Any:
        """Give an expression whose members are counted from k."""
        x, new = self.x, {}
        for s in e.free_symbols:
            name = x.names[s]
            if self.member_of(name) is not None:
                name = self._name(name, k, letter)
                parts = (name.kind, name.base, "'" * name.order)
                new[s] = x.add(symbol(" ".join(parts)), name, x.rank[s])
        return e.xreplace(new)

    def sums(self, e: Any) -> Any:
        """Give an expression in which terms of a family are a sum over its members."""
        if e.is_Atom or not self.found:
            return e
        args = tuple(map(self.sums, e.args))
        if not e.is_Add:
            return e if args == e.args else e.func(*args)
        terms: dict[Any, dict[int, Any]] = {}
        for term in args:
            numbers = (self.member_of(self.x.names[s]) for s in term.free_symbols)
            k = min((x for x in numbers if x is not None), default=None)
            key = term if k is None else self._counted(term, k, self.other)
            terms.setdefault(key, {})[k or 0] = term
        sums: dict[tuple[int, int], list[Any]] = {}
        alone: list[Any] = []
        for key, members in terms.items():
            first, last = min(members), max(members)
            if len(members) > FEW and last - first + 1 == len(members):
                sums.setdefault((first, last), []).append(key)
            else:
                alone += members.values()
        j = symbol(self.other)
        made = (sp.Sum(sp.Add(*of), (j, *ends)) for ends, of in sums.items())
        return sp.Add(*alone, *made)


def _terms(e: Any) -> int:
    """Count the terms of an expression multiplied out, up to one more than the most."""
    below = [_terms(a) for a in e.args]
    if e.is_Add:
        count = sum(below)
    elif e.is_Mul:
        count = math.prod(below)
    else:
        powers = e.is_Pow and e.exp.is_Integer and below[0] > 1
        times = min(abs(int(e.exp)), MOST_TERMS) if powers else 1
        count = max(below, default=1) ** times
    return int(min(count, MOST_TERMS + 1))
