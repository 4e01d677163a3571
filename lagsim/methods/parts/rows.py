"""Rows within a step against the motion itself: y' there, and the dense output's slope.

A row shows q'' from the equations beside the state from the dense output. Where the
latter does not move by the former, the step has passed over something that neither its
stages nor its series have seen, whatever that is made of: it is taken back.

No more than APART output steps lie between two places of a step at which that is known;
its ends are such places. So a force that shows in that many rows is seen, at the cost of
some of the rows'; a step of fewer costs nothing, and what is taken back without need
cannot become shorter than that: half of APART, and near a row that differed once, LEAST.
"""

from __future__ import annotations

from lagsim.methods.parts.interface import derivative
from lagsim.methods.parts.looks import PASSED, differs
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import rare

# In output steps.
APART = 16.0
LEAST = 2.0**-4
# Multiples of it, less their whole parts, are spread evenly.
GOLDEN = 0.6180339887498949


def strayed(s: State, p: Parameters) -> float:
    """Give a row at which the last step differs, as a fraction of it, or 0."""
    # A step over a loss of rank has the length that it needs.
    if s.passes > 0.0:
        return 0.0
    reach = min(s.t, s.row_limit)
    if s.doubted >= s.row and time_of(s, s.doubted) < reach:
        x = place(s, s.doubted)
        if x * s.step_h > LEAST * s.row_step and is_off(s, p, x):
            return x
    k = s.row + APART - 1.0
    while time_of(s, k) < reach:
        x = place(s, k)
        if is_off(s, p, x):
            s.doubted = k
            return x
        k += APART
    return 0.0


def time_of(s: State, k: float) -> float:
    """Give the time of row k."""
    return float(s.row_start + k * s.row_step)


def place(s: State, k: float) -> float:
    """Give where row k is, as a fraction of the last step."""
    return (time_of(s, k) - s.step_t) / s.step_h


@rare
def is_off(s: State, p: Parameters, x: float) -> bool:
    """Tell whether y' is not the slope of the dense output, for all that it may err by.

    The state is not known better than y' is asked to be: what a change of it by as many
    tolerances does to y', where that is stiff, close to a loss of rank or all rounding,
    is no sign.
    """
    if not differs(s, p, x):
        return False
    size = s.size
    z = s.look
    rates = s.look_rates
    right = s.asked
    beside = s.spare
    tolerances = s.tolerances
    for i in range(size):
        # By different parts: what is alike in two components may cancel.
        part = GOLDEN * (i + 1)
        part = 0.5 + part - int(part)
        sign = 1.0 - 2.0 * (i % 2)
        z[i] += sign * part * PASSED * tolerances[i]
    derivative(s.step_t + x * s.step_h, z, p, beside)
    for i in range(s.n, size):
        allowed = PASSED * tolerances[i] / s.step_h + abs(beside[i] - right[i])
        if tolerances[i] > 0.0 and not abs(right[i] - rates[i]) <= allowed:
            return True
    return False
