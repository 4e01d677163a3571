"""What the facts of a function need: of the graph, and of series on it.

`Graph` and `Series` are both made with the table of functions, so its rows name them by
what they can do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


class Builder(Protocol):
    """A graph; see `Graph`."""

    ops: list[str]
    args: list[tuple[int, ...]]
    zero: int
    one: int

    def constant(self, x: float) -> int:
        """Give the node of a number."""

    def value(self, node: int) -> float | None:
        """Give the number that a node is, or None."""

    def payload(self, node: int) -> float | str | bool:
        """Give the number, the name or the truth value of a leaf."""

    def call(self, op: str, *args: int) -> int:
        """Give the node of an operation, simplified."""

    def kept(self, op: str, args: tuple[int, ...]) -> int:
        """Give the node of an operation as it is."""

    def product_sum(self, pairs: Iterable[tuple[int, int]]) -> int:
        """Give the sum of a * b over `pairs`."""


class Coefficients(Protocol):
    """Taylor coefficients of one order k along a motion; see `series.Recurrences`.

    Those of order 0 are the nodes themselves.
    """

    @property
    def g(self) -> Builder:
        """The graph that they are made on."""

    def __call__(self, n: int) -> int:
        """Give the coefficient of order k of a node."""

    def inner(self, a: int, b: int) -> int:
        """Give the sum of a_j b_(k-j), j from 1 to k - 1."""

    def inner_rate(self, a: int, b: int) -> int:
        """Give the sum of j/k a_j b_(k-j), j from 1 to k - 1."""

    def moves(self, n: int) -> bool:
        """Tell whether a node changes along the motion."""

    def twin(self, n: int, made: Callable[[], int | None]) -> int | None:
        """Give an expression with the series of `n`, made once; None if it has none."""
