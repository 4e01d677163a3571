"""What methods that choose their steps have in common: the step to try, projection."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods._projection import project
from lagsim.methods._singular import clear_of_loss, record_health
from lagsim.methods._state import END, HEADER, SIZE, H, N, T
from lagsim.native.kernel_types import at

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

CONSTRAINED = True

# Below this many units in the last place of t a step makes no progress.
SMALLEST = 8.0 * 2.0**-52


def usable_step(s: Floats) -> float:
    """Give the step to try, with t + h exact; 0 where it would be too small."""
    t = s[T]
    h = s[H]
    if t + 1.01 * h >= s[END]:
        return float(s[END] - t)
    if not h > SMALLEST * max(abs(t), 1e-6 * (s[END] - t)):
        return 0.0
    if CONSTRAINED:
        h = clear_of_loss(s, h)
    return float((t + h) - t)


def settle(s: Floats, p: Floats, h: float, new: Floats) -> int:
    """Project the new state onto the constraints; give 0 where that fails."""
    n = int(s[N])
    size = int(s[SIZE])
    work = at(s, HEADER + 4 * size + 2)
    sizes = at(s, HEADER + size)
    masses = at(s, HEADER + 3 * size + 2)
    if project(n, s[T] + h, h, new, p, sizes, masses, work) == 0:
        return 0
    record_health(s, work[n + 1], h)
    return 1
