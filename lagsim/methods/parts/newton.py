"""When a Newton iteration with kept derivatives is done, slow, or lost.

For methods with a fixed step, which have no tolerance: they go on to rounding.
"""

from __future__ import annotations

# What is left is rounding below this, against the size of what is solved for.
ROUNDING = 2.0**-53
# Steps that no longer shrink are rounding if smaller than this.
STALLED = 1e-9
# At a slower rate the derivatives are evaluated anew.
SLOW = 0.05
MOST = 30

GO_ON = 0
RENEW = 1
CONVERGED = 2
LOST = 3


def progress(iteration: int, change: float, previous: float) -> int:
    """Judge by the size of a step and of the one before, relative to the whole."""
    if not change < 1e300:
        return LOST
    if change == 0.0:
        return CONVERGED
    if iteration == 0:
        return GO_ON
    rate = change / previous
    if change * min(1.0, rate) <= ROUNDING or (rate >= 0.5 and change <= STALLED):
        return CONVERGED
    if iteration == MOST - 1:
        return LOST
    return RENEW if rate > SLOW else GO_ON
