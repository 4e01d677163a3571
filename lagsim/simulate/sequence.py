"""Switches that come ever faster: whether they do, and to what limit."""

from __future__ import annotations

import math
from collections import deque

# Switches accumulate where this many take less than this part of the longest arc, and
# come ever faster. What is left of the motion then is about the square of that, and a
# few times its rounding.
WINDOW = 4
SHORT = 2e-6
# So many switches in no time, as a part of the run: no motion leads on from there.
STUCK = 40
NO_TIME = 1e-12


class Sequence:
    """The last switches of a run, which lasts for `span`."""

    def __init__(self, start: float, span: float) -> None:
        self.last = start
        self.span = span
        self.longest = 0.0
        self.recent: deque[tuple[float, int]] = deque(maxlen=STUCK)

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
        times = [t for t, _ in self.recent]
        if len(times) <= 2 * WINDOW:
            return math.inf
        last = times[-1] - times[-1 - WINDOW]
        former = times[-1 - WINDOW] - times[-1 - 2 * WINDOW]
        return last / former if former > 0.0 else math.inf

    def limit(self) -> float | None:
        """Give the time at which switches accumulate, if they do so right now."""
        ratio = self.ratio()
        if ratio >= 1.0:
            return None
        times = [t for t, _ in self.recent]
        if times[-1] - times[-1 - 2 * WINDOW] > SHORT * self.longest:
            return None
        last = times[-1] - times[-1 - WINDOW]
        return times[-1] + last * ratio / (1.0 - ratio)

    def is_stuck(self) -> bool:
        """Tell whether the last switches took no time."""
        if len(self.recent) < STUCK:
            return False
        return self.recent[-1][0] - self.recent[0][0] <= NO_TIME * self.span
