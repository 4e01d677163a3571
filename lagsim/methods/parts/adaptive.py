"""What methods that choose their steps have in common: the step to try."""

from __future__ import annotations

from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.singular import clear_of_loss
from lagsim.methods.parts.state import State

CONSTRAINED = True

# Steps towards what happens at its own time are this part of the way to it.
CLOSER = 0.25

# Below this many units in the last place of t a step makes no progress.
SMALLEST = 8.0 * 2.0**-52

# What is closer than so many of the smallest steps has been reached.
REACHED = 4.0


def usable_step(s: State, p: Parameters) -> float:
    """Give the step to try, with t + h exact; 0 where it would be too small."""
    t = s.t
    h = s.h
    if s.most_step > 0.0:
        h = min(h, s.most_step)
    if s.feature_width > 0.0:
        h = up_to_feature(s, h)
    rest = s.end - t
    passes = False
    if CONSTRAINED:
        # A step over a loss of rank has the length that it needs, whatever is asked.
        h = clear_of_loss(s, p, h, rest)
        passes = s.passes > 0.0
    if s.longest > 0.0 and not passes:
        h = min(h, s.longest)
    # Not t + 1.01 h >= END: rounded, that holds for ever at the last digit of t.
    if 1.01 * h >= rest:
        return float(rest)
    if not h > SMALLEST * max(abs(t), 1e-6 * rest):
        return 0.0
    return float((t + h) - t)


def up_to_feature(s: State, h: float) -> float:
    """Give the step, no longer than what happens at its own time lets it be.

    It ends where that begins; from there steps shrink with the way left to it.
    """
    away = s.feature - s.t
    before = away - s.feature_reach - s.feature_width
    if before > REACHED * SMALLEST * abs(s.t):
        return float(min(h, before))
    if away < -s.feature_reach:
        return h
    return float(min(h, max(s.feature_width, CLOSER * abs(away))))
