"""Sums of a motion's power series: c = [order, y_0 (size,), ..., y_order]."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


def sum_bend(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give the sum of y_k h^k from k = 2, even and odd powers apart: they overlap."""
    order = int(c[0])
    square = h * h
    for i in range(size):
        high = c[1 + order * size + i]
        low = c[1 + (order - 1) * size + i]
        for back in range(1, (order - 1) // 2):
            k = order - 2 * back
            high = high * square + c[1 + k * size + i]
            low = low * square + c[1 + (k - 1) * size + i]
        if order % 2 == 0:
            low = low * h + c[1 + 2 * size + i]
            out[i] = (high * square + low) * square
        else:
            out[i] = (high * h + low) * square


def sum_rates(size: int, first: int, c: Floats, h: float, out: Floats) -> None:
    """Give the sum of k y_k h^(k - 1) in the same way, from component `first` on."""
    order = int(c[0])
    square = h * h
    for i in range(first, size):
        high = order * c[1 + order * size + i]
        low = (order - 1) * c[1 + (order - 1) * size + i]
        for back in range(1, order // 2):
            k = order - 2 * back
            high = high * square + k * c[1 + k * size + i]
            low = low * square + (k - 1) * c[1 + (k - 1) * size + i]
        out[i] = high * h + low
        if order % 2 == 1:
            out[i] = out[i] * h + c[1 + size + i]


def lead(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give how far off (size,) the terms of a series may lead in a step."""
    order = int(c[0])
    for i in range(size):
        far = 0.0
        for back in range(order):
            far = (far + abs(c[1 + (order - back) * size + i])) * h
        out[i] = c[1 + i] + far
