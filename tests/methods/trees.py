"""Rooted trees and the order conditions of Runge-Kutta methods, in exact arithmetic.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I,
2nd ed., section II.2. A tree is the sorted tuple of the trees below its root.
"""

from __future__ import annotations

import functools
from fractions import Fraction
from math import prod
from typing import TypeAlias

Tree: TypeAlias = "tuple[Tree, ...]"
Rows: TypeAlias = "tuple[tuple[float, ...], ...]"


@functools.cache
def trees(order: int) -> tuple[Tree, ...]:
    """Give the trees of `order` vertices."""
    return tuple(sorted(_forests(order - 1, order - 1)))


@functools.cache
def _forests(vertices: int, largest: int) -> tuple[Tree, ...]:
    """Give the multisets of trees of `vertices` in all, none above `largest`."""
    if vertices == 0:
        return ((),)
    found = set()
    for size in range(1, min(vertices, largest) + 1):
        for tree in trees(size):
            for rest in _forests(vertices - size, size):
                found.add(tuple(sorted((tree, *rest))))
    return tuple(found)


def vertices(tree: Tree) -> int:
    return 1 + sum(map(vertices, tree))


def density(tree: Tree) -> int:
    """Give gamma: the product of the sizes of all subtrees."""
    return vertices(tree) * prod(map(density, tree))


class Weights:
    """Elementary weights: phi_i of each stage, and the same with |a_ij|."""

    def __init__(self, A: Rows) -> None:
        self.A = [[Fraction(a) for a in row] for row in A]
        self.known: dict[tuple[Tree, bool], list[Fraction]] = {}

    def of_stages(self, tree: Tree, *, absolute: bool = False) -> list[Fraction]:
        key = tree, absolute
        if key not in self.known:
            below = [self._slopes(t, absolute) for t in tree]
            self.known[key] = [
                prod((b[i] for b in below), start=Fraction(1))
                for i in range(len(self.A))
            ]
        return self.known[key]

    def _slopes(self, tree: Tree, absolute: bool) -> list[Fraction]:
        phi = self.of_stages(tree, absolute=absolute)
        size = abs if absolute else Fraction
        return [
            sum((size(a) * x for a, x in zip(row, phi, strict=False)), Fraction(0))
            for row in self.A
        ]

    def defect(
        self,
        b: list[Fraction],
        tree: Tree,
        expected: Fraction,
        b_sizes: list[Fraction] | None = None,
    ) -> Fraction:
        """Give the defect of a condition in units of its own rounding.

        A product of as many coefficients as the tree has vertices, each rounded to a
        double, is right to `vertices` * 2^-53 of its size. `b_sizes` are those of what
        b was summed up from, if it was.
        """
        phi = self.of_stages(tree)
        sizes = self.of_stages(tree, absolute=True)
        value = sum((x * y for x, y in zip(b, phi, strict=False)), Fraction(0))
        b_sizes = b_sizes or [abs(x) for x in b]
        size = sum((x * y for x, y in zip(b_sizes, sizes, strict=False)), Fraction(0))
        unit = vertices(tree) * Fraction(1, 2**53) * size
        return abs(value - expected) / unit if unit else abs(value - expected)
