"""Numbers of steps and rows of a call of a kernel.

A call is short, so that Python handles a signal soon after it. The pauses between calls
do not change the results.
"""

# Steps of the first call, their limit, and the duration of a call, in seconds.
FIRST = 16
MOST = 4000
MOMENT = 0.02

# Greatest number of rows for each step.
ROWS = 128


class Pace:
    """Numbers of steps and rows of the next call of a kernel, adapted to its duration.

    Attributes
    ----------
    steps : int
        Number of steps of the next call.
    """

    def __init__(self) -> None:
        self.steps = FIRST

    @property
    def rows(self) -> int:
        """Greatest number of rows of a call."""
        return ROWS * self.steps

    def lasted(self, seconds: float) -> None:
        """Set the number of steps of the next call from the duration of the last.

        seconds : that duration.
        """
        if seconds > 2.0 * MOMENT:
            self.steps = max(1, int(self.steps * MOMENT / seconds))
        elif seconds < MOMENT:
            self.steps = min(2 * self.steps, MOST)
