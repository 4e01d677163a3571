"""How long a kernel works at a time, so that interrupts are seen soon."""

from __future__ import annotations

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
