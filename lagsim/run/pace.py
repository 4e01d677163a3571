"""How long a kernel works at a time, and whether it will ever come to the end."""

from __future__ import annotations

import math

# More steps than any run makes, unless it is told otherwise.
MOST_STEPS = 100_000_000
# Steps of a call: so few at first, then as many as take about this long, in seconds.
# Where a kernel pauses changes nothing in what it computes.
FIRST = 16
MOST = 4000
MOMENT = 0.02
# Room for so many rows of each step.
ROWS = 128


class Pace:
    """The steps and rows that a kernel is asked for at a time, run after run.

    Attributes
    ----------
    steps : int
    """

    def __init__(self) -> None:
        self.steps = FIRST

    @property
    def rows(self) -> int:
        """The rows that a call may write."""
        return ROWS * self.steps

    def lasted(self, seconds: float) -> None:
        """Choose the next call by how long one of so many steps has lasted."""
        if seconds > 2.0 * MOMENT:
            self.steps = max(1, int(self.steps * MOMENT / seconds))
        elif seconds < MOMENT:
            self.steps = min(2 * self.steps, MOST)


# Steps at which it is first asked whether a run comes to its end, then twice as many.
ASKED = 1 << 17
# Twice the steps bring less than this part of the time that half of them brought.
SLOWER = 0.75


class Horizon:
    """Where the time converges as steps are made: no number of them passes it.

    Near t0, steps through sin(1/(t - t0)) are proportional to (t - t0)^2, so that each
    doubling of their number brings half of the time that the one before has brought.
    """

    def __init__(self) -> None:
        self._ask_at = ASKED
        self._times: list[float] = []

    def before(self, end: float, t: float, steps: int, most: int) -> float | None:
        """Give the time before `end` that `most` steps will not pass, if there is one.

        Parameters
        ----------
        t, steps
            The time reached, and the steps made.
        """
        if steps < self._ask_at:
            return None
        self._ask_at *= 2
        self._times = [*self._times[-3:], t]
        if len(self._times) < 4:
            return None
        a, b, c, _ = self._times
        if not (0.0 < t - c < SLOWER * (c - b) and c - b < SLOWER * (b - a)):
            return None
        share = (t - c) / (c - b)
        doublings = max(0.0, math.log2(most / steps))
        passed = t + (t - c) * share * (1.0 - share**doublings) / (1.0 - share)
        return passed if passed < end else None
