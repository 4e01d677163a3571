"""Accumulations of events: infinitely many in a finite time, and their limits.

There is one `Accumulation` for switches of surfaces, and one for impacts and ends of
modes of laws. If intervals shrink at a ratio r, the time to the limit is the
sum of a geometric series (`series_left`). The motion is replaced by its limit where the
remaining paths are below the resolution of the motion:

- for switches, the paths across their surfaces. Surfaces may switch in turn, so that
  the intervals between events of all surfaces are compared, in windows of several;
- for impacts, the paths of each contact, by its own flights.

Without a limit the run ends where events leave no time for a motion (`run.progress`).
"""

from __future__ import annotations

import itertools
import math
from collections import deque

WINDOW = 4
# Halves of a window shrink like the windows if the square of the ratio of the halves is
# at most EVEN times the ratio of the windows.
EVEN = 2.0
# Largest increase of the speed of a flight, relative to that predicted by the ratio.
REGULAR = 16.0
# Number of events that are stored.
MOST = 4000
# Number of the last flights of a contact from which its limit is extrapolated.
FLIGHTS = 4
# Largest ratio that counts as a decrease. A contact without a strike for LATE times the
# duration of its last flight no longer bounces.
STEADY = 0.999
LATE = 10.0
# A contact that comes to rest RESTS times within this part of the duration, and leaves
# rest each time, cannot be resolved in double precision.
RESTS = 200
NO_PART = 1e-4


def series_left(last: float, ratio: float) -> float:
    """Return the sum of all terms after `last` of a geometric series with a ratio."""
    return last * ratio / (1.0 - ratio)


class History:
    """The last strikes and rests of one contact.

    Attributes
    ----------
    strikes : deque of (float, float)
        Times and speeds of the last strikes.
    rests : deque of float
        Times at which the contact came to rest.
    impacts : int
        Number of impacts of the contact since it was at rest.
    """

    def __init__(self) -> None:
        self.strikes: deque[tuple[float, float]] = deque(maxlen=FLIGHTS + 1)
        self.rests: deque[float] = deque(maxlen=RESTS)
        self.impacts = 0

    def end(self, time: float, speed: float, least: float) -> float | None:
        """Return the time at which bouncing ends if the motion left is negligible.

        The motion left is negligible where the durations of flights decrease at a ratio
        and the lengths of all remaining paths, up and down, sum to at most `least`; or
        where none of the last flights was longer than `least` (contacts that strike in
        turn have no single ratio). Otherwise None is returned.

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
        # nearly constant speeds, does not fly: the strikes are one impact, whose order
        # is not unique.
        slower = speeds[-1] <= REGULAR * ratio * speeds[-2]
        shrinks = ratio < STEADY and slower
        ways = [d * v for d, v in zip(took, speeds[1:], strict=True)]
        short = len(took) == FLIGHTS and max(*ways, far) <= least
        # A flight lands at its initial speed: its path up and down is `far` / 2 long.
        ways_left = series_left(far / 2.0, ratio**2) if shrinks else math.inf
        if not short and ways_left > least:
            return None
        left = series_left(took[-1], ratio) if shrinks else 0.0
        return max(time, times[-1] + left)


class Accumulation:
    """The last events of several rows, and the limit to which they accumulate.

    Parameters
    ----------
    span
        The duration of the run.
    window
        Number of intervals between events in each of the windows that are compared.

    Attributes
    ----------
    recent : deque of (float, int)
        Times and rows of the last events.
    own : dict of int to History
        The last strikes of each contact.
    """

    def __init__(self, span: float, window: int = WINDOW) -> None:
        self.span = span
        self.window = window
        self.recent: deque[tuple[float, int]] = deque(maxlen=MOST)
        self.own: dict[int, History] = {}

    def of(self, row: int) -> History:
        """Return the history of a contact, an empty one before its first strike."""
        found = self.own.get(row)
        if found is None:
            found = self.own[row] = History()
        return found

    def add(self, time: float, row: int) -> None:
        """Store an event of a row (surface, law, break of t) at a time."""
        self.recent.append((time, row))

    def recent_rows(self, least: int = 1) -> list[int]:
        """Return rows, sorted, with at least `least` events in the last two windows."""
        recent = [k for _, k in list(self.recent)[-2 * self.window :]]
        return sorted(k for k in set(recent) if recent.count(k) >= least)

    def ratio(self) -> float:
        """Return the ratio of the lengths of the last two windows, later over earlier.

        Infinity where there are too few events, or the earlier window has length 0.
        """
        if len(self.recent) <= 2 * self.window:
            return math.inf
        last, former = self._stretch(0), self._stretch(1)
        return last / former if former > 0.0 else math.inf

    def _stretch(self, k: int) -> float:
        """Return the duration of the last window of events, or of an earlier one.

        k : the number of windows after it.
        """
        first = -1 - k * self.window
        return self.recent[first][0] - self.recent[first - self.window][0]

    def limit(self) -> float | None:
        """Return the time at which events accumulate, or None.

        None where the intervals within the last window do not shrink, or shrink less
        than the last two windows: a long window before a short one, as of a motion that
        meets several surfaces close to each other, is not an accumulation. None also
        where the limit is farther ahead than the duration of the run: windows of a
        periodic motion differ by rounding.
        """
        end = self.end()
        near = end is not None and end - self.recent[-1][0] <= self.span
        return end if near and self._shrinks() else None

    def _shrinks(self) -> bool:
        """Whether the second half of the last window is shorter than its first half.

        The square of the ratio of the halves must not exceed EVEN times the ratio of
        the windows.
        """
        first, half, last = (
            self.recent[-1 - k][0] for k in (self.window, self.window // 2, 0)
        )
        former, latter = half - first, last - half
        regular = latter**2 <= EVEN * self.ratio() * former**2
        return latter < former and regular

    def end(self) -> float | None:
        """Return the limit of the event times, extrapolated as a geometric series.

        None where the lengths of the windows do not decrease.
        """
        ratio = self.ratio()
        if ratio >= 1.0 or ratio == 0.0:
            return None
        return self.recent[-1][0] + series_left(self._stretch(0), ratio)

    def restless(self) -> list[int]:
        """Return the indices of contacts that came to rest `RESTS` times in short time.

        The short time is `NO_PART` times the duration of the run.
        """
        most = NO_PART * self.span
        return [
            k
            for k, x in self.own.items()
            if len(x.rests) == RESTS and x.rests[-1] - x.rests[0] < most
        ]
