"""What methods that choose their steps have in common: the step to try."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods._singular import clear_of_loss, planned_step
from lagsim.methods._state import END, H, T

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

CONSTRAINED = True

# Below this many units in the last place of t a step makes no progress.
SMALLEST = 8.0 * 2.0**-52


def usable_step(s: Floats, p: Floats) -> float:
    """Give the step to try, with t + h exact; 0 where it would be too small."""
    t = s[T]
    h = s[H]
    if CONSTRAINED:
        h = planned_step(s)
    rest = s[END] - t
    # Not t + 1.01 h >= END: rounded, that holds for ever at the last digit of t.
    last = 1.01 * h >= rest
    if last:
        h = rest
    elif not h > SMALLEST * max(abs(t), 1e-6 * rest):
        return 0.0
    if CONSTRAINED:
        clear = clear_of_loss(s, p, h)
        if clear < rest:
            h = clear
            last = False
    if last:
        return float(rest)
    return float((t + h) - t)
