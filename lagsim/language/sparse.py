"""Vectors of graph nodes, most of them zero."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from lagsim.language.graph import Graph


class SparseVector(Sequence[int]):
    """A tuple of nodes that keeps only those which do not vanish identically.

    It reads like a tuple, in time proportional to its length; what must not take that
    long reads `entries`.

    Attributes
    ----------
    entries : dict of int to int
        Index -> node, in ascending order, without zeros.
    """

    __slots__ = ("_length", "_zero", "entries")

    def __init__(self, g: Graph, length: int, entries: Mapping[int, int]) -> None:
        self._length = length
        self._zero = g.zero
        self.entries = {j: entries[j] for j in sorted(entries) if entries[j] != g.zero}

    def __len__(self) -> int:
        return self._length

    @overload
    def __getitem__(self, j: int) -> int: ...
    @overload
    def __getitem__(self, j: slice) -> tuple[int, ...]: ...
    def __getitem__(self, j: int | slice) -> int | tuple[int, ...]:
        if isinstance(j, slice):
            return tuple(self)[j]
        k = j + self._length if j < 0 else j
        if not 0 <= k < self._length:
            raise IndexError(j)
        return self.entries.get(k, self._zero)

    def __iter__(self) -> Iterator[int]:
        entries, zero = self.entries, self._zero
        return (entries.get(j, zero) for j in range(self._length))
