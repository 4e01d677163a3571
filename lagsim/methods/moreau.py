"""Moreau's time stepping: for hundreds of contacts, impulses in fixed steps, order 1.

No impact is located. In each step the velocities change by the forces and by the
impulses of all contacts at once: M (v+ - v) = h f + A^T p. The positions in the middle,
q + h/2 v, decide which contacts act (gap <= 0), and forces and M are evaluated there;
the step ends at q + h/2 (v + v+). After it each active contact has Newton's rate, at
least -e times the one before; friction is on its cone, a limited multiplier within its
limit. Equalities are treated like contacts, and their residuals are corrected in the
next step. The impulses are found by projected relaxation: a sweep over the active rows
costs as much as these have elements. A step whose relaxation does not converge is
counted and reported.

The result is of order 1 in the step. A contact is found up to one step late and keeps a
penetration of about h |v|; times of impact, and all that follows from them, are of
order 1, whatever the motion between them. The residual of an equality is up to h^2
times the acceleration along it, and of one between velocities h times it. Bounces
shorter than a few steps count as rest. A row has the mean multiplier of its step,
lambda = p/h, so that an impact is a high value; columns `impulse.<c>` are 0 and there
are no events. Smooth motion is that of `verlet`. The work of impulses is p times the
mean of the velocities before and after, so that `energy - work` is the same before and
after each of them.

For few contacts, or for many digits, methods that locate impacts are better.

Sources: J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics,
CISM 302 (1988) 1-82; M. Jean, Comput. Methods Appl. Mech. Eng. 177 (1999) 235-257.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.controller import record_extents
from lagsim.methods.parts.fixed import is_finite, next_time, step_length
from lagsim.methods.parts.impulses import factor, gather, rate, relax, respond
from lagsim.methods.parts.interface import balance, effort
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import DONE, NOT_FINITE, State
from lagsim.native.kernels.words import at
from lagsim.native.layout import array

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.structure import Structure

NAME = "moreau"
TITLE = "Moreau's time stepping"
ORDER = 1
DENSE_ORDER = 1
ADAPTIVE = False
IMAGINARY_LIMIT = 2.0
HANDLES = "any model with a regular M; contacts by hundreds"

NEEDS = ("balance",)
EVENTS = False


class Moreau(State):
    """The last step, and room for the one it makes."""

    multipliers: float  # where they begin in y
    old: Floats = array(lambda s: s.size)
    new: Floats = array(lambda s: s.size)
    z: Floats = array(lambda s: s.size)
    w: Floats = array(lambda s: s.n)
    room: Floats = array(lambda s: s.size)


STATE = Moreau


def refusal(_scene: Structure) -> str:
    """Give "": it handles everything."""
    return ""


def amplification(z: complex) -> float:
    """Give the spectral radius of a step on q'' = 2 Re(z) q' - |z|^2 q, h = 1."""
    import numpy as np

    square, damping = abs(z) ** 2, 2.0 * z.real
    slope = np.array([-square, 1.0 + damping - 0.5 * square])
    matrix = np.array([[1.0, 0.5] + 0.5 * slope, slope])
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))


def start(s: Moreau, p: Parameters) -> None:
    """Begin an arc: multipliers at its start are those of the step to come."""
    y = s.y
    new = s.new
    s.step_h = 0.0
    s.multipliers = s.size - p.met
    attempt(s, p, min(float(s.fixed_step), s.end - s.t))
    for i in range(s.size - p.met, s.size):
        if abs(new[i]) < 1e300:
            y[i] = new[i]
    record_extents(s)


def step(s: Moreau, p: Parameters) -> int:
    """Make one step, or give a code other than 0."""
    y = s.y
    old = s.old
    new = s.new
    size = s.size
    after = next_time(s)
    if attempt(s, p, step_length(s, after)) == 0:
        s.unsettled += 1.0
    if not is_finite(size, new):
        return NOT_FINITE
    for i in range(size):
        old[i] = y[i]
        y[i] = new[i]
    s.step_t = s.t
    s.step_h = after - s.t
    s.t = after
    s.steps += 1.0
    record_extents(s)
    return DONE


def attempt(s: Moreau, p: Parameters, h: float) -> int:
    """Leave the state after a step h; give 0 if the impulses are not quite right."""
    n = s.n
    y = s.y
    z = s.z
    w = s.w
    new = s.new
    room = s.room
    pushes = p.pushes
    middle = s.t + 0.5 * h
    for i in range(s.size):
        z[i] = y[i]
        new[i] = y[i]
    for i in range(n):
        z[i] += 0.5 * h * y[n + i]
        room[i] = y[n + i]
    balance(middle, z, p, p.balance)
    s.evaluations += 1.0
    factor(p)
    for i in range(n):
        w[i] = pushes[i]
    respond(p, w)
    for i in range(n):
        w[i] = room[i] + h * w[i]
    sweeps = meet_rows(s, p, h)
    for i in range(n):
        new[i] = z[i] + 0.5 * h * w[i]
        new[n + i] = w[i]
    if p.works > 0:
        add_work(s, p, middle, h)
    return sweeps


def meet_rows(s: Moreau, p: Parameters, h: float) -> int:
    """Find the impulses, and the multipliers that they are in the mean.

    The last ones are the guess.
    """
    n = s.n
    first = s.size - p.met
    y = s.y
    z = s.z
    new = s.new
    acting = p.acting
    struck = p.struck
    count = gather(p, at(z, n), s.w, h, s.room)
    for k in range(p.met):
        new[first + k] = 0.0
    for i in range(count):
        struck[i] = h * y[first + int(acting[i])]
    sweeps = relax(p, count, h, at(z, n), s.w)
    for i in range(count):
        new[first + int(acting[i])] = struck[i] / h
    return sweeps


def add_work(s: Moreau, p: Parameters, middle: float, h: float) -> None:
    """Add the works of the forces, and of the impulses at the mean velocities."""
    n = s.n
    works = p.works
    worked = p.worked
    starts = p.slope_starts
    columns = p.slope_columns
    y = s.y
    z = s.z
    new = s.new
    room = s.room
    for i in range(n):
        z[n + i] = 0.5 * (y[n + i] + new[n + i])
    effort(middle, z, p, room)
    for i in range(works):
        new[2 * n + i] = y[2 * n + i] + h * room[i]
    for k in range(p.met):
        impulse = h * new[s.size - p.met + k]
        if impulse != 0.0:
            own = int(worked[int(columns[int(starts[k])])])
            moved = rate(p, k, at(z, n)) - p.met_offsets[k]
            new[2 * n + own] += impulse * moved


def interpolate(s: Moreau, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step: on the chord.

    Multipliers are those of the step.
    """
    y = s.y
    old = s.old
    for i in range(s.size):
        out[i] = old[i] + x * (y[i] - old[i])
    for i in range(int(s.multipliers), s.size):
        out[i] = y[i]
