"""Rows for moving pictures: at an even stride, and both rows of each impact.

Between two frames a motion is smooth, so that positions there follow from those of the
frames and from their rates; across an impact they do not. Where there are more frames
than wanted, every other one goes; where there are too many impacts, some of these do,
and the stretch in which one is missing says so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Flags, Floats

# Of what is kept for a row, beside its columns: its number, how many impacts there were
# up to it, and, of the two rows of an impact, which one that is.
NUMBER, STRUCK, PAIR = range(3)
OWN = 3


class Frames:
    """Keeps the columns `names` of at most `most` rows, but for the last one.

    Parameters
    ----------
    columns
        Those of the rows; the first is the time.

    Attributes
    ----------
    stride : int
        Of how many rows one is kept.
    """

    def __init__(self, columns: Sequence[str], names: Sequence[str], most: int) -> None:
        place = {name: k for k, name in enumerate(columns)}
        self.names = tuple(names)
        self._chosen = np.array([place[name] for name in names], dtype=np.intp)
        self._most = max(4, most)
        self.stride = self._of_impacts = 1
        self._kept: list[Floats] = []
        self._count = self._rows = self._struck = 0
        self._last = np.empty((0, OWN + len(names)))

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        if not len(rows):
            return
        fresh = np.empty((len(rows), OWN + len(self._chosen)))
        fresh[:, OWN:] = rows[:, self._chosen]
        fresh[:, NUMBER] = self._rows + np.arange(len(rows))
        # The row before belongs to these: it may be the first of two at an impact.
        block = np.concatenate((self._last, fresh))
        t = np.append(self._last[:, OWN], rows[:, 0])
        second = np.append(False, t[1:] == t[:-1])
        block[:, STRUCK] = self._struck + np.cumsum(second)
        known = len(self._last)
        block[known:, PAIR] = np.where(second, block[:, STRUCK], 0.0)[known:]
        first = np.append(second[1:], False)
        block[first, PAIR] = block[first, STRUCK] + 1.0
        self._rows += len(rows)
        self._struck = int(block[-1, STRUCK])
        self._last = block[-1:].copy()
        # What comes last is looked at again, when it is known what follows.
        done = block[:-1]
        self._keep(done[self._wanted(done)])

    def _struck_in(self, block: Floats) -> Flags:
        """Which rows are kept for their impact."""
        pair = block[:, PAIR]
        found: Flags = (pair > 0) & (pair % self._of_impacts == 0)
        return found

    def _wanted(self, block: Floats) -> Flags:
        even: Flags = block[:, NUMBER] % self.stride == 0
        return even | self._struck_in(block)

    def _keep(self, rows: Floats) -> None:
        self._kept.append(rows)
        self._count += len(rows)
        if self._count > 2 * self._most:
            self._thin()

    def _thin(self) -> None:
        """Keep fewer, until there are no more than wanted."""
        table = np.concatenate(self._kept) if self._kept else self._last[:0]
        while len(table) > self._most:
            if np.count_nonzero(self._struck_in(table)) > self._most // 2:
                self._of_impacts *= 2
            else:
                self.stride *= 2
            table = table[self._wanted(table)]
        self._kept, self._count = [table], len(table)

    def _whole(self) -> Floats:
        self._thin()
        return np.concatenate((self._kept[0], self._last))

    @property
    def table(self) -> Floats:
        """What is kept (k, names), in order of time."""
        return self._whole()[:, OWN:]

    @property
    def broken(self) -> Flags:
        """Whether an impact is missing between a frame and the next one (k,)."""
        whole = self._whole()
        struck, t = whole[:, STRUCK], whole[:, OWN]
        missing = (np.diff(struck) > 0) & (np.diff(t) > 0)
        return np.append(missing, False)
