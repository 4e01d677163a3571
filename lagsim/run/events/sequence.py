"""Switches that come ever faster: whether they do, and to what limit."""

from __future__ import annotations

import math
from collections import deque

# Switches accumulate where what is left of them, at the ratio at which they come ever
# faster, is less than this part of the time since they do. What is left of the motion
# then is about the square of that.
WINDOW = 4
SHORT = 4e-6
# A stretch this many times longer than the ratio has it is none of theirs.
REGULAR = 16.0
# So many switches in no time, a few units in the last place of times of this size: no
# motion leads on from there.
STUCK = 40
NO_TIME = 2.0**-47
# So many are remembered.
MOST = 4000


class Sequence:
    """The last switches of a run, which lasts for `span`."""

    def __init__(self, start: float, span: float) -> None:
        self.last = start
        self.span = span
        self.longest = 0.0
        self.recent: deque[tuple[float, int]] = deque(maxlen=MOST)

    def add(self, time: float, surface: int) -> None:
        """Take one more switch."""
        self.longest = max(self.longest, time - self.last)
        self.last = time
        self.recent.append((time, surface))

    def lately(self) -> list[int]:
        """Give the surfaces of the last switches."""
        return sorted({k for _, k in list(self.recent)[-2 * WINDOW :]})

    def ratio(self) -> float:
        """Give how much faster the last switches came than those before; else inf."""
        if len(self.recent) <= 2 * WINDOW:
            return math.inf
        last, former = self._stretch(0), self._stretch(1)
        return last / former if former > 0.0 else math.inf

    def _stretch(self, k: int) -> float:
        """Give how long WINDOW switches took, k such stretches ago."""
        first = -1 - k * WINDOW
        return self.recent[first][0] - self.recent[first - WINDOW][0]

    def limit(self) -> float | None:
        """Give the time at which switches accumulate, if they do so right now."""
        end = self.end()
        if end is None:
            return None
        left = end - self.recent[-1][0]
        ratio = self.ratio()
        if left > SHORT * self.longest or left > SHORT * self._since(ratio):
            return None
        return end

    def end(self) -> float | None:
        """Give the limit that the last switches would have if they went on so."""
        ratio = self.ratio()
        if ratio >= 1.0 or ratio == 0.0:
            return None
        return self.recent[-1][0] + self._stretch(0) * ratio / (1.0 - ratio)

    def _since(self, ratio: float) -> float:
        """Give the longest stretch since they come ever faster, at about one ratio."""
        longest = self._stretch(0)
        for k in range(1, (len(self.recent) - 1) // WINDOW):
            former = self._stretch(k)
            if not longest < former <= REGULAR / ratio * longest:
                break
            longest = former
        return longest

    def is_stuck(self) -> bool:
        """Tell whether the last switches took no time."""
        if len(self.recent) < STUCK:
            return False
        took = self.recent[-1][0] - self.recent[-STUCK][0]
        return took <= NO_TIME * max(self.span, abs(self.last))
