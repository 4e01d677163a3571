"""Kernels that decide where the motion leads from the levels of surfaces.

The expression of a surface at its level differs from the level by rounding alone, which
the magnitude of its terms bounds. Its side is decided by its rate, where this exceeds
the rounding of the rate, else by short steps of the motion.
"""

from __future__ import annotations

from math import floor, inf
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import LEVEL, Parameters
from lagsim.methods.parts.state import derivative, rounding, surface_rows, surfaces
from lagsim.program.sliding import extent, product
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    RESIDUAL_ROUNDOFF,
    SOLUTION_ROUNDOFF,
    VALUE_ROUNDOFF,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Largest number of steps of `departures`, and the ratio of successive steps.
MOST_STEPS = 22
LONGER = 4.0
# Number of directions in which a state is changed to compute the effect of rounding.
DIRECTIONS = 3


def departures(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store signed distances of expressions from levels after short steps from (t, y).

    The steps are classical Runge-Kutta steps from the same state. The first is followed
    by longer ones until each expression has left its level clearly. The result is 0 for
    an expression that does not leave its level.

    out : the results (surfaces,); the levels (surfaces,); the distances from which on
        an expression has left its level clearly (surfaces,), inf for expressions that
        are not examined; the first step; then working memory (6 size,).
    """
    count = p.surfaces
    size = p.size
    clear = out[2 * count :]
    work = out[3 * count + 1 :]
    rates = work[size:]
    first = work[5 * size :]
    step = out[3 * count]
    left = 0
    for k in range(count):
        out[k] = 0.0
        if clear[k] < inf:
            left += 1
    derivative(t, y, p, first)
    for _trial in range(MOST_STEPS):
        if left == 0:
            return
        rates[:size] = first[:size]
        for stage in range(1, 4):
            part = step if stage == 3 else 0.5 * step
            for i in range(size):
                work[i] = y[i] + part * rates[(stage - 1) * size + i]
            derivative(t + part, work, p, rates[stage * size :])
        for i in range(size):
            inner = 2.0 * rates[size + i] + 2.0 * rates[2 * size + i]
            outer = rates[i] + rates[3 * size + i]
            work[i] = y[i] + step / 6.0 * (outer + inner)
        surfaces(t + step, work, p, p.rows)
        for k in range(count):
            off = p.rows[k] - out[count + k]
            if out[k] == 0.0 and abs(off) > clear[k]:
                out[k] = off
                left -= 1
        step *= LONGER


def term_sizes(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the magnitude of the terms of each surface's expression.

    A magnitude is at least the change of the expression by rounding of the state,
    divided by the unit of rounding, since slopes may vanish.

    out : the magnitudes (surfaces,); the sums of the magnitudes of the slopes
        (surfaces,); the values of the expressions (surfaces,); then the input: whether
        an expression contains rates that jump (surfaces,), and the largest magnitudes
        of the components so far (size,); and working memory (size + surfaces,).
    """
    count = p.surfaces
    size = p.size
    here = out[2 * count :]
    on_rates = out[3 * count :]
    sizes = out[4 * count :]
    work = sizes[size:]
    nearby = work[size:]
    # In the places of velocities, the magnitudes of positions.
    work[: p.n] = sizes[p.positions]
    for i in range(p.velocities.stop, p.dynamic.stop):
        work[i - p.driven.start] = sizes[i]
    surface_rows(t, y, p, p.rows)
    for k in range(count):
        out[count + k] = 0.0
        for e in range(int(p.row_starts[k]), int(p.row_starts[k + 1])):
            out[count + k] += abs(p.J[e])
        terms = extent(k, p, work)
        if on_rates[k] > 0.0:
            terms = extent(k, p, sizes[p.driven])
        scale = p.surface_scales[k]
        # Not a number at a pole, where the values beside it count alone.
        known = terms == terms and scale == scale
        out[k] = max(scale, terms) if known else 0.0
    surfaces(t, y, p, here)
    period = 1.0
    for _direction in range(DIRECTIONS):
        for i in range(size):
            step = RESIDUAL_ROUNDOFF * sizes[i]
            odd = floor(i / period) - 2.0 * floor(i / (2.0 * period))
            work[i] = y[i] - step if odd > 0.0 else y[i] + step
        period *= 2.0
        surfaces(t, work, p, nearby)
        for k in range(count):
            change = abs(nearby[k] - here[k]) / RESIDUAL_ROUNDOFF
            out[k] = max(out[k], or_zero(change))


def deciding_rates(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the rates that decide on which side of its level each expression will be.

    A deciding rate is the rate of the expression. Where the rate is 0 to rounding it is
    the second derivative, by the forces, as is the rate of an expression of velocities.

    out : the rates (surfaces,); bounds of their rounding (surfaces,); the magnitude of
        the part of each rate that the motion of the state causes, without the part of
        the time t (surfaces,); the sums of the magnitudes of slopes times ranges
        (surfaces,); then the input: whether an expression contains rates that jump
        (surfaces,), the largest magnitudes (size,) and the ranges (size,) of the
        components so far; and working memory (3 size + 4,).
    """
    count = p.surfaces
    size = p.size
    on_rates = out[4 * count :]
    sizes = out[5 * count :]
    ranges = sizes[size:]
    a = ranges[size:]
    bounds = a[size:]
    derivative(t, y, p, a)
    rounding(t, y, p, bounds)
    for i in range(p.dynamic.stop - p.driven.start):
        bounds[i] = or_zero(abs(bounds[i])) if i < p.n else 0.0
    surface_rows(t, y, p, p.rows)
    for k in range(count):
        by_motion = product(k, p, y[p.driven])
        slow = extent(k, p, sizes[p.driven]) + abs(p.rates[k] - by_motion)
        slow *= CLEAR_OF_ROUNDING * RESIDUAL_ROUNDOFF
        if on_rates[k] == 0.0 and abs(p.rates[k]) > slow:
            out[k] = p.rates[k]
            out[count + k] = slow
            out[2 * count + k] = abs(by_motion)
        else:
            by_forces = product(k, p, a[p.driven])
            weak = or_zero(extent(k, p, a[p.driven]) + abs(p.required[k]))
            weak *= SOLUTION_ROUNDOFF
            weak += CLEAR_OF_ROUNDING * VALUE_ROUNDOFF * extent(k, p, bounds)
            out[k] = or_zero(by_forces - p.required[k])
            out[count + k] = weak
            out[2 * count + k] = abs(by_forces)
        out[3 * count + k] = extent(k, p, ranges[p.driven])


def shown_are_decided(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store in `p.shown_decided` whether no side of a shown surface need be selected.

    1 if each shown surface is off its levels, by more than `p.far`; 2 if some are at
    the level where they stay while the motion rests; 0 if a side is to be selected, as
    where a component of the state exceeds the magnitude up to which `p.far` is valid.

    out : the largest magnitudes of the components so far (size,), which stay unchanged.
    """
    p.shown_decided = 0.0
    for i in range(p.size):
        if max(abs(y[i]), out[i]) > p.far_up_to[i]:
            return
    surfaces(t, y, p, p.shown_values)
    decided = 1.0
    for k in range(p.surfaces):
        if p.far[k] < 0.0:
            continue
        value = p.shown_values[k]
        level = 0.0
        if p.is_whole[k] > 0.0:
            level += floor(value + 0.5)
        off = abs(value - level)
        if p.slides[k] == 0.0 and p.slack[k] == 0.0 and p.least[k] == -inf:
            if not off > p.far[k]:
                return
        elif p.slides[k] == LEVEL and p.least[k] == level and off <= p.slack[k]:
            decided = 2.0
        else:
            return
    p.shown_decided = decided


def or_zero(x: float) -> float:
    """Return x, or 0 where it is not a number."""
    return x if x == x else 0.0


KERNELS = [departures, term_sizes, deciding_rates, shown_are_decided]
