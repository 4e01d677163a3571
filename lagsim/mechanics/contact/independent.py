"""Which rows hold by themselves, and which because others do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact.closed import Closed

# Rows that leave less than this part of themselves are spanned by the others; where
# all that is known is D, a square, half of the digits are.
DEPENDENT = 1e-10
DEPENDENT_SQUARED = 1e-7


def columns(closed: Closed) -> Floats:
    """Give Y (k, r): D = Y^T Y."""
    if closed.factor is not None:
        return closed.factor
    sizes, V = np.linalg.eigh(closed.D)
    return np.asarray(np.sqrt(np.maximum(sizes, 0.0))[:, None] * V.T)


class Span:
    """What the rows taken so far span."""

    def __init__(self, closed: Closed) -> None:
        Y = columns(closed)
        self.least = DEPENDENT_SQUARED if closed.factor is None else DEPENDENT
        lengths = np.linalg.norm(Y, axis=0)
        self.units = Y / np.where(lengths > 0.0, lengths, 1.0)
        self.taken: list[Floats] = []

    def takes(self, row: int) -> bool:
        """Take a row unless it is spanned already."""
        rest = self._rest(row)
        size = float(np.linalg.norm(rest))
        if size <= self.least:
            return False
        self.taken.append(rest / size)
        return True

    def has(self, row: int) -> bool:
        """Tell whether a row is spanned."""
        return float(np.linalg.norm(self._rest(row))) <= self.least

    def _rest(self, row: int) -> Floats:
        rest = self.units[:, row]
        if self.taken:
            Q = np.array(self.taken)
            for _ in range(2):
                rest = rest - (Q @ rest) @ Q
        return rest
