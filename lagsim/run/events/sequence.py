"""Detection of accumulating switches and impacts, and estimates of their limit."""

from __future__ import annotations

import itertools
import math
from collections import deque

# The intervals between accumulating switches shrink at a ratio. Switches count as
# accumulated where the time left to their limit, extrapolated at this ratio, is at most
# the part SHORT of the longest interval so far, and of the longest window since they
# began to accumulate. The remaining motion is then about SHORT squared of the motion in
# that window.
WINDOW = 4
SHORT = 4e-6
# A window that is longer, by this factor, than the ratio predicts does not belong to
# the accumulation.
REGULAR = 16.0
# The motion cannot continue past STUCK switches within NO_TIME, a few units in the last
# place relative to the time.
STUCK = 40
NO_TIME = 2.0**-47
# Nor past STUCK switches of one surface at an average interval of at most this
# part of the duration.
HURRIES = 1e-12
# Number of switches that are stored.
MOST = 4000
# Number of the last flights of a contact from which its limit is extrapolated.
FLIGHTS = 4
# Largest ratio that counts as a decrease. A contact without a strike for LATE times its
# last flight no longer bounces.
STEADY = 0.999
LATE = 10.0
# A contact that comes to rest RESTS times within this part of the duration, and leaves
# rest each time, cannot be resolved in double precision.
RESTS = 200
NO_PART = 1e-4


class SwitchSequence:
    """The last switches of a run, and the limit to which they accumulate.

    Parameters
    ----------
    start
        The time at which the run starts.
    span
        The duration of the run.
    window
        Number of intervals between switches in each of the windows that are compared.

    Attributes
    ----------
    last : float
        The time of the last switch.
    longest : float
        The longest interval between two successive switches so far.
    recent : deque of (float, int)
        Times and surfaces of the last switches.
    """

    def __init__(self, start: float, span: float, window: int = WINDOW) -> None:
        self.last = start
        self.span = span
        self.window = window
        self.longest = 0.0
        self.recent: deque[tuple[float, int]] = deque(maxlen=MOST)
        self.own: dict[int, deque[float]] = {}  # last times of each surface

    def add(self, time: float, surface: int) -> None:
        """Store a switch of a surface at a time."""
        self.longest = max(self.longest, time - self.last)
        self.last = time
        self.recent.append((time, surface))
        self.own.setdefault(surface, deque(maxlen=STUCK)).append(time)

    def lately(self, least: int = 1) -> list[int]:
        """Return sorted indices of surfaces that switched in the last two windows.

        least : how often they have switched in these windows at least.
        """
        some = [k for _, k in list(self.recent)[-2 * self.window :]]
        return sorted(k for k in set(some) if some.count(k) >= least)

    def ratio(self) -> float:
        """Return the ratio of the lengths of the last two windows, the later on top.

        It is infinite where there are too few switches or the earlier window has length
        zero.
        """
        if len(self.recent) <= 2 * self.window:
            return math.inf
        last, former = self._stretch(0), self._stretch(1)
        return last / former if former > 0.0 else math.inf

    def _stretch(self, k: int) -> float:
        """Return the duration of the k-th last window of switches, k = 0, 1, ..."""
        first = -1 - k * self.window
        return self.recent[first][0] - self.recent[first - self.window][0]

    def limit(self) -> float | None:
        """Return the time at which switches accumulate, or None.

        None where this time is not close enough to the last switch (`SHORT`), and where
        the intervals of the last window do not shrink.
        """
        end = self.end()
        if end is None or not self._shrinks():
            return None
        left = end - self.recent[-1][0]
        ratio = self.ratio()
        if left > SHORT * self.longest or left > SHORT * self._since(ratio):
            return None
        return end

    def _shrinks(self) -> bool:
        """Whether the second half of the last window is shorter than its first half.

        Where surfaces switch in turn at unequal intervals, it is so for some of them.
        """
        first, half, last = (
            self.recent[-1 - k][0] for k in (self.window, self.window // 2, 0)
        )
        return last - half < half - first

    def end(self) -> float | None:
        """Return the limit of the switch times, extrapolated as a geometric series.

        None where the lengths of the windows do not decrease.
        """
        ratio = self.ratio()
        if ratio >= 1.0 or ratio == 0.0:
            return None
        return self.recent[-1][0] + self._stretch(0) * ratio / (1.0 - ratio)

    def _since(self, ratio: float) -> float:
        """Return the length of the longest window since the lengths began to decrease.

        Windows count from the last one back, while their lengths grow by at most
        REGULAR / ratio.
        """
        longest = self._stretch(0)
        for k in range(1, (len(self.recent) - 1) // self.window):
            former = self._stretch(k)
            if not longest < former <= REGULAR / ratio * longest:
                break
            longest = former
        return longest

    def is_stuck(self, part: float = NO_TIME) -> bool:
        """Whether the last switches prevent the motion from continuing.

        True where the last `STUCK` switches took at most `part` of the duration, or
        where the last `STUCK` switches of one surface are on average at most `HURRIES`
        of the duration apart.
        """
        if len(self.recent) < STUCK:
            return False
        own = self.own[self.recent[-1][1]]
        if len(own) == STUCK and own[-1] - own[0] <= STUCK * HURRIES * self.span:
            return True
        took = self.recent[-1][0] - self.recent[-STUCK][0]
        return took <= max(part * self.span, NO_TIME * abs(self.last))


class Flights:
    """The last flights of one contact.

    Attributes
    ----------
    strikes : deque of (float, float)
        Times and speeds of the last strikes.
    rests : deque of float
        Times at which the contact came to rest.
    """

    def __init__(self) -> None:
        self.strikes: deque[tuple[float, float]] = deque(maxlen=FLIGHTS + 1)
        self.rests: deque[float] = deque(maxlen=RESTS)

    def add(self, time: float, speed: float) -> None:
        """Store the time and the speed of a strike."""
        self.strikes.append((time, speed))

    def is_restless(self, span: float) -> bool:
        """Whether the contact came to rest `RESTS` times in a small part of the run.

        span : the duration of the run; the part is `NO_PART`.
        """
        full = len(self.rests) == RESTS
        return full and self.rests[-1] - self.rests[0] < NO_PART * span

    def end(self, time: float, speed: float, least: float) -> float | None:
        """Return the time at which bouncing ends, if the motion left is negligible.

        The motion left is negligible where the durations of flights decrease at a ratio
        and the lengths of all remaining paths, up and down, sum to at most `least`; or
        where none of the last flights was longer than `least` (contacts that strike in
        turn have no single ratio). Else None.

        Parameters
        ----------
        time
            The present time.
        speed
            The present speed of the contact.
        least
            The length of a path that counts as no motion.
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
        # A contact that strikes in turn with a neighbour, at decreasing intervals and
        # nearly constant speeds, has no flights: that is one impact, of open order.
        slower = speeds[-1] <= REGULAR * ratio * speeds[-2]
        shrinks = ratio < STEADY and slower
        ways = [d * v for d, v in zip(took, speeds[1:], strict=True)]
        short = len(took) == FLIGHTS and max(*ways, far) <= least
        # A flight lands at its initial speed: its path up and down is `far` / 2 long.
        ways_left = far / 2.0 * ratio**2 / (1.0 - ratio**2) if shrinks else math.inf
        if not short and ways_left > least:
            return None
        left = took[-1] * ratio / (1.0 - ratio) if shrinks else 0.0
        return max(time, times[-1] + left)
