"""Switches that come ever faster: whether they do, and to what limit."""

from __future__ import annotations

import itertools
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
# Or so many of one surface, each within this part of the run after the last.
HURRIES = 1e-12
# So many are remembered.
MOST = 4000
# What bounces is judged by so many of its last flights: three of them have a ratio.
FLIGHTS = 4
# A ratio this near 1 is none. What has not struck for so many flights does not bounce.
STEADY = 0.999
LATE = 10.0
# What comes to rest so often, in this part of a run, and never stays so: its laws are
# beyond what doubles hold.
RESTS = 200
NO_PART = 1e-4


class Sequence:
    """The last switches of a run, which lasts for `span`.

    They are compared by stretches of `window`.
    """

    def __init__(self, start: float, span: float, window: int = WINDOW) -> None:
        self.last = start
        self.span = span
        self.window = window
        self.longest = 0.0
        self.recent: deque[tuple[float, int]] = deque(maxlen=MOST)
        self.own: dict[int, deque[float]] = {}  # times of each surface, the last few

    def add(self, time: float, surface: int) -> None:
        """Take one more switch."""
        self.longest = max(self.longest, time - self.last)
        self.last = time
        self.recent.append((time, surface))
        self.own.setdefault(surface, deque(maxlen=STUCK)).append(time)

    def lately(self) -> list[int]:
        """Surfaces of the last switches."""
        return sorted({k for _, k in list(self.recent)[-2 * self.window :]})

    def ratio(self) -> float:
        """Ratio of intervals between the last switches to those before; else inf."""
        if len(self.recent) <= 2 * self.window:
            return math.inf
        last, former = self._stretch(0), self._stretch(1)
        return last / former if former > 0.0 else math.inf

    def _stretch(self, k: int) -> float:
        """How long one stretch of switches took, k stretches ago."""
        first = -1 - k * self.window
        return self.recent[first][0] - self.recent[first - self.window][0]

    def limit(self) -> float | None:
        """Time at which switches accumulate, if they do so right now."""
        end = self.end()
        if end is None:
            return None
        left = end - self.recent[-1][0]
        ratio = self.ratio()
        if left > SHORT * self.longest or left > SHORT * self._since(ratio):
            return None
        return end

    def end(self) -> float | None:
        """Limit that the last switches would have if they went on so."""
        ratio = self.ratio()
        if ratio >= 1.0 or ratio == 0.0:
            return None
        return self.recent[-1][0] + self._stretch(0) * ratio / (1.0 - ratio)

    def _since(self, ratio: float) -> float:
        """Longest stretch since they come ever faster, at about one ratio."""
        longest = self._stretch(0)
        for k in range(1, (len(self.recent) - 1) // self.window):
            former = self._stretch(k)
            if not longest < former <= REGULAR / ratio * longest:
                break
            longest = former
        return longest

    def is_stuck(self, part: float = NO_TIME) -> bool:
        """Whether the last switches took no time: this part of the run at most.

        Or those of one surface follow each other in hardly any.
        """
        if len(self.recent) < STUCK:
            return False
        own = self.own[self.recent[-1][1]]
        if len(own) == STUCK and own[-1] - own[0] <= STUCK * HURRIES * self.span:
            return True
        took = self.recent[-1][0] - self.recent[-STUCK][0]
        return took <= max(part * self.span, NO_TIME * abs(self.last))


class Flights:
    """The last flights of one contact: when it struck, and how fast."""

    def __init__(self) -> None:
        self.strikes: deque[tuple[float, float]] = deque(maxlen=FLIGHTS + 1)
        self.rests: deque[float] = deque(maxlen=RESTS)  # when it came to rest

    def add(self, time: float, speed: float) -> None:
        """Take one more strike."""
        self.strikes.append((time, speed))

    def is_restless(self, span: float) -> bool:
        """Whether it comes to rest again and again, and gets nowhere."""
        full = len(self.rests) == RESTS
        return full and self.rests[-1] - self.rests[0] < NO_PART * span

    def end(self, time: float, speed: float, least: float) -> float | None:
        """Return when it will have bounced, if what is left is no motion; else None.

        Either its flights get shorter at a ratio, and all ways that are left, up and
        down, are together no longer than `least`; or none of the last was (contacts
        that strike by turns have no one ratio).

        Parameters
        ----------
        speed
            That it has now.
        least
            A length.
        """
        if len(self.strikes) < FLIGHTS:
            return None
        lasted = self.strikes[-1][0] - self.strikes[-2][0]
        far = speed * lasted
        if far > least or time - self.strikes[-1][0] > LATE * lasted:
            return None
        times = [strike[0] for strike in self.strikes]
        speeds = [strike[1] for strike in self.strikes]
        took = [b - a for a, b in itertools.pairwise(times)]
        if min(took) <= 0.0:
            return None
        ratio = max(took[-1] / took[-2], took[-2] / took[-3])
        # What strikes by turns with a neighbour in ever less time, hardly slower, does
        # not fly between: that is one impact, whose order is open.
        slower = speeds[-1] <= REGULAR * ratio * speeds[-2]
        shrinks = ratio < STEADY and slower
        ways = [d * v for d, v in zip(took, speeds[1:], strict=True)]
        short = len(took) == FLIGHTS and max(*ways, far) <= least
        # A flight leaves as fast as it comes down: up and down it goes `far` / 2.
        ways_left = far / 2.0 * ratio**2 / (1.0 - ratio**2) if shrinks else math.inf
        if not short and ways_left > least:
            return None
        left = took[-1] * ratio / (1.0 - ratio) if shrinks else 0.0
        return max(time, times[-1] + left)
