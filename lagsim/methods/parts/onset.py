"""Scales of components at rest that the motion of others reaches.

The range of a component so far is its scale, and at the front of a wave this range
begins far below the ranges of neighbours: a chain at rest, struck at one end, would be
integrated to the digits of displacements of 1e-100. An error there does not matter if
it is much smaller than the effect of the errors that neighbours may have.

Where components that begin to move limit a step, and the others would not, the scale of
a component becomes at least 1 % of its displacement by the motions of its neighbours,
each for the time in which the neighbour's own motion lasts, and at most of the
displacement at which its own force balances theirs. With this displacement it has at
most the kinetic energy of the component that moves most. The displacement acts on
components farther away in turn. All are found from y' at displaced states.
"""

from __future__ import annotations

from math import inf, sqrt

from lagsim.language.arrays import Floats
from lagsim.methods.parts.control import Control, pseudorandom
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.search_table import SearchTable
from lagsim.methods.parts.state import derivative, event_functions
from lagsim.tolerances import OVERFLOW, UNDERFLOW

SWITCHES = True

# A component begins to move if its range grows by more than this factor beyond its
# motion at the rates at the start of the step.
GROWN = 1.25
# Error of a step, in tolerances, from which on it may limit the next one.
LIMITING = 1e-2
# Other components would allow a step, or its error, of this multiple.
LIMITED = 2.0
# Displacements of the state, in parts of scales: forces are nearly linear.
SMALL = 2.0**-13
# A scale is replaced by one that is larger by this factor.
MUCH = 8.0
# A component that is reached counts in this pass if the work of the others' forces on
# it exceeds this part of the largest such work. It then does not answer to neighbours
# that move farther than it does.
ENOUGH = 0.0625
# Longest time for which a motion lasts, in steps.
LASTS = 256.0
# Number of components in a row that are reached at first, more than a step reaches: a
# Taylor series of order 18 reaches 9. The number doubles each time.
FEWEST = 12.0


def forget_onsets(s: Control) -> None:
    """Set the sizes by the motion of others to 0: unknown."""
    s.onset[:] = 0.0
    s.hops = FEWEST


def sides_are_clear(s: SearchTable, p: Parameters, t: float, y: Floats) -> bool:
    """Whether all event functions of surfaces and laws are clear of their levels.

    At a level the smallest displacement decides which side holds, and a scale by the
    motion of others would permit an error larger than that displacement.

    y : (size,), the state at time t.
    """
    if SWITCHES:
        event_functions(t, y, p, s.values)
        for k in range(s.surfaces):
            if p.slack[k] < inf and s.values[k] <= p.slack[k]:
                return False
    return True


def set_aside(s: Control, h: float, new: Floats, k: Floats, resting: float) -> int:
    """Set the tolerances of components that begin to move to 0; return their number.

    Components whose size by the motion of others is known are left out.

    h : the step.
    new : (size,), the state at its end.
    k : (size,), y' at its start.
    resting : 0 if components at rest count as well, else less than 0.
    """
    count = 0
    accelerations = k[s.velocities]
    for i in range(s.velocities.stop):
        before = s.high[i] - s.low[i]
        width = width_with(s, i, new)
        moved = h * abs(k[i])
        if i < s.n:
            moved += 0.5 * h * h * abs(accelerations[i])
        begins = width > GROWN * (before + moved) or width + moved <= resting
        if begins and s.onset[i] == 0.0:
            s.tolerances[i] = 0.0
            count += 1
    return count


def spread_scales(
    s: Control, p: Parameters, t: float, y: Floats, k: Floats, new: Floats, h: float
) -> None:
    """Set the sizes of components by the motion of others, `onset`.

    A tolerance of 0 marks a component at its onset.

    y, k : (size,), a state at time t, and y' there.
    new : (size,), a state to which ranges are extended.
    h : a step that all components allow that are not at their onset.
    """
    n, own, moves, forces, found = s.n, s.reach, s.point, s.point_rates, s.exact_rates
    longest = (LASTS * h) * (LASTS * h)
    energy = 0.0
    forces[:n] = 0.0
    found[:n] = 0.0
    for i in range(s.velocities.stop):
        own[i] = s.onset[i]
        if s.tolerances[i] > 0.0:
            own[i] = max(own[i], width_with(s, i, new))
        moves[i] = own[i]
    for i in range(n):
        speed = max(own[n + i], abs(k[i])) + LASTS * h * abs(k[n + i])
        energy = max(energy, s.masses[i] * speed * speed)
    for signs in range(2):
        raise_to_changes(s, p, t, y, k, signs, forces)
    for i in range(n):
        lasting = part_of(own[i], longest * forces[i])
        if 0.0 < own[i] <= s.onset[i]:
            pace = s.onset[i] / s.onset[n + i]
            lasting = max(lasting, part_of(pace * pace, longest))
        moves[i] = lasting * own[i]
        moves[n + i] = lasting * own[n + i]
    raise_to_changes(s, p, t, y, k, 0, found)
    for hop in range(int(s.hops)):
        if spread_once(s, p, t, y, k, longest, energy, hop % 2) == 0:
            # The others are known not to be reached. If none is, the step may be too
            # long, and the component that moves others counts as one at its onset.
            for i in range(s.velocities.stop):
                s.onset[i] = max(s.onset[i], UNDERFLOW if hop > 0 else 0.0)
            return
    s.hops *= 2.0


def spread_once(
    s: Control,
    p: Parameters,
    t: float,
    y: Floats,
    k: Floats,
    longest: float,
    energy: float,
    signs: int,
) -> int:
    """Raise the sizes `onset` of components that others reach; return their number.

    Of each component, `point_rates` is the acceleration by the displacement of others,
    and `exact_rates` that by their displacements times the square of the time for which
    each lasts, in units of `longest`. The components with most work by these forces are
    raised; the effects of their own displacements are added for the next call.

    longest : the square of the longest time.
    energy : twice the largest kinetic energy of a component, at the speed that it may
        reach in the longest time. No component that is reached has more: if two
        displace each other and no force balances (x'' = -y, y'' = x), their sizes would
        grow with each call.
    t, y, k, signs : see `raise_to_changes`.
    """
    n, own, moves, back = s.n, s.reach, s.point, s.far_before
    forces, found = s.point_rates, s.exact_rates
    most = 0.0
    for i in range(n):
        if not MUCH * own[i] < longest * found[i] < OVERFLOW:
            found[i] = 0.0
        most = max(most, s.masses[i] * forces[i] * found[i])
        back[i] = 0.0
    if most == 0.0:
        return 0
    for i in range(n):
        counts = s.masses[i] * forces[i] * found[i] >= ENOUGH * most
        size = longest * found[i] if counts else 0.0
        moves[i] = size
        moves[n + i] = sqrt(size) * sqrt(forces[i])
    raise_to_changes(s, p, t, y, k, signs, back)
    most = 0.0
    raised = 0
    for i in range(n):
        balanced = part_of(forces[i], back[i])
        speed = balanced * moves[n + i]
        slower = sqrt(part_of(energy, s.masses[i] * speed * speed))
        size = slower * balanced * moves[i]
        speed = slower * speed
        lasting = part_of(found[i], forces[i])
        if moves[i] > 0.0:
            forces[i] = 0.0
            found[i] = 0.0
            back[i] = 0.0
        moves[i] = 0.0
        moves[n + i] = 0.0
        if size > MUCH * own[i]:
            raised += 1
            most = max(most, balanced)
            own[i] = size
            own[n + i] = max(own[n + i], speed)
            s.onset[i] = own[i]
            s.onset[n + i] = own[n + i]
            moves[i] = lasting * size
            moves[n + i] = lasting * speed
    for i in range(n):
        forces[i] = max(forces[i], most * back[i])
    raise_to_changes(s, p, t, y, k, signs, found)
    for i in range(n):
        found[i] = 0.0 if moves[i] > 0.0 else found[i]
    return 1


def width_with(s: Control, i: int, y: Floats) -> float:
    """Return the range of component i so far, extended to the state y (size,)."""
    return float(max(s.high[i], y[i]) - min(s.low[i], y[i]))


def part_of(part: float, whole: float) -> float:
    """Return the quotient of two numbers >= 0, at most 1; 1 if the second one is 0."""
    return part / whole if part < whole else 1.0


def raise_to_changes(
    s: Control, p: Parameters, t: float, y: Floats, k: Floats, signs: int, out: Floats
) -> None:
    """Raise out (n,) to the sizes of the changes of q'' by displacements `s.point`.

    The displacements of positions and velocities are multiplied by pseudorandom factors
    of size 3/4 to 5/4 and either sign, so that effects of neighbours do not cancel.

    y, k : (size,), a state at time t, and y' there.
    signs : the set of factors, 0 or 1.
    """
    s.evaluations += 1.0
    s.work[: s.size] = y[: s.size]
    for i in range(s.velocities.stop):
        part = pseudorandom(i, signs) - 0.5
        part += 0.75 if part > 0.0 else -0.75
        s.work[i] += SMALL * s.point[i] * part
    derivative(t, s.work, p, s.spare)
    for i in range(s.n):
        change = abs(s.spare[s.n + i] - k[s.n + i]) / SMALL
        if change < OVERFLOW:
            out[i] = max(out[i], change)
