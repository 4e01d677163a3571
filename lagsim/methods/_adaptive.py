"""What methods that choose their steps have in common: the step to try."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods._singular import clear_of_loss
from lagsim.methods._state import END, LONGEST, H, T

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

CONSTRAINED = True

# Below this many units in the last place of t a step makes no progress.
SMALLEST = 8.0 * 2.0**-52


def usable_step(s: Floats) -> float:
    """Give the step to try, with t + h exact; 0 where it would be too small."""
    t = s[T]
    h = s[H]
    if s[LONGEST] > 0.0 and h > s[LONGEST]:
        h = s[LONGEST]
    if t + 1.01 * h >= s[END]:
        return float(s[END] - t)
    if not h > SMALLEST * max(abs(t), 1e-6 * (s[END] - t)):
        return 0.0
    if CONSTRAINED:
        h = clear_of_loss(s, h)
    return float((t + h) - t)
