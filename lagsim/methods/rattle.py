"""RATTLE: Verlet's method with constraints, order 2.

For rods, chains, and molecules with rigid bonds. In each step the positions are
corrected by constraint forces along the gradients at the *start* of the step; then the
velocities are made tangent by forces along the gradients at its *end*. This makes the
method symplectic and reversible on the constrained motion. A Verlet step with a mere
projection is neither, and its energy drifts. The error of the energy of RATTLE, of size
(h w)^2, oscillates and does not grow.

Positions and velocities satisfy the constraints to rounding after every step. A step
takes one evaluation of the forces (two if the model has `work`), and some ten solves
with the constraint matrix. It is stable for h w < 2, w the fastest frequency. In each
step the gradients of the constraints must turn by well less than a right angle.

RATTLE needs a constant mass matrix and forces that depend on positions and time only;
without constraints it is `verlet`. The friction of contacts is exact along a straight
path, and of order 1 along a curved one.

Source: H. C. Andersen, J. Comput. Phys. 52 (1983) 24-34; E. Hairer, C. Lubich and G.
Wanner, Geometric Numerical Integration, 2nd ed., section VII.1.4.
"""

from __future__ import annotations

from lagsim.language.arrays import Floats
from lagsim.methods import Structure
from lagsim.methods.parts import state as at
from lagsim.methods.parts.constraints import (
    is_finite,
    is_small,
    largest_part,
    project_level,
    record_sigma,
)
from lagsim.methods.parts.fixed import Fixed, interpolate, step
from lagsim.methods.parts.fixed import start as begin
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import derivative, position_step, velocity_step
from lagsim.methods.verlet import amplification, inseparable
from lagsim.native.layout import array
from lagsim.tolerances import OVERFLOW, RESIDUAL_ROUNDOFF, UNIT_ROUNDOFF

__all__ = ["amplification", "interpolate", "start", "step"]

NAME = "rattle"
TITLE = "RATTLE"
ORDER = 2
DENSE_ORDER = 2
ADAPTIVE = False
IMAGINARY_LIMIT = 2.0
HANDLES = "constant M, forces f(q, t); holonomic constraints"

NEEDS = ()

CONSTRAINED = True

# The iteration ends at this residual against its terms, or at this change against the
# positions, or where rounding keeps the residual from falling.
EXACT = 2.0 * UNIT_ROUNDOFF
MOST = 30


class Rattle(Fixed):
    """Memory of RATTLE: the steps of Newton's method for the constraint forces."""

    probe: Floats = array("size")  # working state for evaluations
    change: Floats = array(lambda s: s.size + 4)  # the result of a Newton step
    history: Floats = array(lambda s: MOST * s.n)  # the Newton steps so far


STATE = Rattle


def refusal(scene: Structure) -> str:
    """Return the reason why the method cannot handle a model, or "" if it can.

    scene : the structure of the model.
    """
    if scene.constraints not in ("none", "holonomic"):
        return (
            "it has constraints between velocities that fix no positions (`dop853` "
            "projects onto constraints)"
        )
    return inseparable(scene)


def start(s: Rattle, p: Parameters) -> None:
    """Begin an arc with velocities that satisfy the constraints to rounding.

    An impact may leave a larger residual, since the gap is then put to 0; the forces
    along the old gradients could not balance it.
    """
    if CONSTRAINED:
        project_level(1, s, p, s.t, s.fixed_step, s.y, s.change)
    begin(s, p)


def make(s: Rattle, p: Parameters, after: float, h: float) -> int:
    """Compute `new` a step h later, at the time `after`; return DONE or a code.

    See `fixed.make`.
    """
    n, y, slope, new = s.n, s.y, s.slope, s.new
    v = new[s.velocities]
    new[s.velocities] = y[s.velocities] + 0.5 * h * s.k[s.velocities]
    new[:n] = y[:n] + h * v[:n]
    # The constraint forces in k are those of y''; the missing or excess part is along
    # the same gradients.
    if CONSTRAINED and move_onto(s, p, after, h) == 0:
        return at.PROJECTION_FAILED
    derivative(after, new, p, slope)
    s.evaluations += 1.0
    new[s.velocities] += 0.5 * h * slope[s.velocities]
    if CONSTRAINED:
        if project_level(1, s, p, after, h, new, s.change) == 0:
            return at.PROJECTION_FAILED
        record_sigma(s, s.change[n + 1], h)
    if s.size > s.quadratures.start:
        derivative(after, new, p, slope)
        s.evaluations += 1.0
        for i in range(s.quadratures.start, s.size):
            new[i] = y[i] + 0.5 * h * (s.k[i] + slope[i])
    if not is_finite(s.size, new):
        return at.NOT_FINITE
    slope[:n] = v[:n]
    return at.DONE


def move_onto(s: Rattle, p: Parameters, after: float, h: float) -> int:
    """Move the new positions onto the constraints, along the gradients at the old ones.

    Return 0 on failure, else 1. A Newton step would be along the gradients at the new
    positions; projected onto the span of the old gradients, the step leaves an error
    that grows with the angle between both, and Broyden's method corrects the steps for
    the projection (C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations,
    SIAM 1995, section 7.3: only the steps are stored).

    after, h : the time after the step, and its length.
    """
    n, new, work = s.n, s.new, s.change
    v = new[s.velocities]
    previous = OVERFLOW
    for made in range(MOST):
        position_step(after, new, p, work)
        residual = work[n]
        if residual <= EXACT or largest_part(0, s, h, new, work) <= EXACT:
            return 1
        stalled = residual > 0.5 * previous
        if stalled and (
            residual <= RESIDUAL_ROUNDOFF or is_small(0, s, h, new, work) > 0
        ):
            return 1
        if not residual < OVERFLOW:
            return 0
        previous = residual
        moved = s.history[made * n :]
        along_old(s, p, h, moved)
        improve_by_broyden(n, made, s.masses, s.history)
        v[:n] += moved[:n]
        new[:n] = s.y[:n] + h * v[:n]
    return 0


def along_old(s: Rattle, p: Parameters, h: float, projection: Floats) -> None:
    """Project a correction of the positions onto the span of the old gradients.

    The gradients are those of the constraints at the start of the step, multiplied by
    M^-1. The correction (n,) is in `change`, which is overwritten.

    h : the length of the step.
    projection : (n,), on return the projection divided by h.
    """
    n, probe, work = s.n, s.probe, s.change
    probe[:n] = s.y[:n]
    probe[s.velocities] = s.y[s.velocities] + work[:n] / h
    # The old velocities are tangent: the removed part is the solution.
    velocity_step(s.t, probe, p, work)
    projection[:n] = -work[:n]


def improve_by_broyden(n: int, made: int, masses: Floats, steps: Floats) -> None:
    """Replace the last of `steps` (made + 1, n), a plain step, by Broyden's step.

    The `made` steps before it, of the same iteration, give the correction.

    masses : (n,), the diagonal of the metric in which steps are compared.
    """
    last = steps[made * n :]
    for j in range(made):
        step = steps[j * n :]
        square = 0.0
        share = 0.0
        for i in range(n):
            square += masses[i] * step[i] * step[i]
            share += masses[i] * step[i] * last[i]
        if square > 0.0:
            share /= square
        if j + 1 < made:
            following = steps[(j + 1) * n :]
            last[:n] += share * following[:n]
        else:
            last[:n] /= 1.0 - share
