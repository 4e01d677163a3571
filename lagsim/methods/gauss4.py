"""Gauss collocation with two stages: order 4, symplectic for any Lagrangian.

The method uses positions and momenta, so the mass matrix may vary with the positions.
For more than two digits it is better than `midpoint`. Forces and damping are allowed.

- **Order** 4 for motion that is not stiff, and 2 for stiff motion. The method is
  symmetric.
- **Energy.** Errors, of size (step * frequency)^4, do not grow. Quadratic invariants,
  such as angular momentum, are kept to rounding.
- **Stability.** Stable at any step on the imaginary axis, but fast motion past step *
  frequency of about 2 has the wrong phase, and Newton's method must converge.

Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
sections II.1.3, VI.4 and VIII.6.
"""

from __future__ import annotations

from math import inf, sqrt

from lagsim.language.arrays import Floats
from lagsim.methods import Structure
from lagsim.methods.parts import newton
from lagsim.methods.parts import state as at
from lagsim.methods.parts.constraints import is_finite, largest_part
from lagsim.methods.parts.control import add
from lagsim.methods.parts.fixed import Fixed, Tableau, interpolate, judge, step
from lagsim.methods.parts.fixed import start as begin
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import (
    derivative,
    inertia,
    lagrangian,
    lagrangian_slopes,
)
from lagsim.native.layout import array
from lagsim.tolerances import SAME_STEP

__all__ = ["interpolate", "step"]

NAME = "gauss4"
TITLE = "Gauss collocation, 2 stages"
ORDER = 4
DENSE_ORDER = 3
ADAPTIVE = False
IMAGINARY_LIMIT = inf
HANDLES = "any model without constraints"

A = ((1 / 4, 1 / 4 - sqrt(3.0) / 6), (1 / 4 + sqrt(3.0) / 6, 1 / 4))
B = (1 / 2, 1 / 2)
C = (1 / 2 - sqrt(3.0) / 6, 1 / 2 + sqrt(3.0) / 6)
TABLEAU = Tableau(A, B, C, ORDER)
amplification = TABLEAU.amplification

NEEDS = ("lagrangian",)

CONSTRAINED = False  # for code shared with methods that support constraints


# --- Gauss collocation in q and p = dL/dq', for any Lagrangian ------------------------
#     P_i = p0 + h sum a_ij F_j,   Q_i = q0 + h sum a_ij V_j,
#     dL/dq'(Q_i, V_i) = P_i,      F = dL/dq and the generalized forces,
#
# solved for the stages' velocities V_i by Newton's method with the derivatives from the
# graph. The velocities at the end belong to the momenta there. Sums of positions,
# momenta and work are compensated.
#
# Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
# sections II.1.3, VI.4 and VIII.5, VIII.6.


class Gauss(Fixed):
    """Memory of Gauss methods: stages, momenta, and the factors of Newton's matrix."""

    stages: int
    due: float  # 1 if the matrix is to be factored
    factored_h: float  # the step size for which it was factored
    nodes: Floats = array("stages")  # the tableau: c, b, A
    weights: Floats = array("stages")
    coefficients: Floats = array(lambda s: s.stages * s.stages)
    z: Floats = array("size")  # working state for evaluations
    momenta: Floats = array("n")
    # Of each stage: the velocities, the velocities of the step before, the values of
    # `lagrangian` and of `lagrangian_slopes`.
    V: Floats = array(lambda s: s.stages * s.n)
    V_before: Floats = array(lambda s: s.stages * s.n)
    found: Floats = array(lambda s: s.stages * s.size)
    slopes: Floats = array(lambda s: s.stages * 4 * s.n * s.n)
    # The Newton matrix, its pivots, the right side.
    K: Floats = array(lambda s: (s.stages * s.n) ** 2)
    pivots: Floats = array(lambda s: s.stages * s.n)
    right: Floats = array(lambda s: s.stages * s.n)
    M: Floats = array(lambda s: s.n * s.n)
    M_pivots: Floats = array("n")
    change: Floats = array("n")


def refusal(scene: Structure) -> str:
    """Return the reason why the method cannot handle a model, or "" if it can.

    The method cannot handle constraints, where momenta cannot replace the velocities,
    and models too large for the dense matrices of Newton's method.

    scene : the structure of the model.
    """
    if scene.constraints == "holonomic":
        return (
            "it has constraints (`rattle` is symplectic on holonomic ones, `dop853` "
            "projects onto constraints)"
        )
    if scene.constraints != "none":
        return (
            "it has constraints between velocities (`dop853` projects onto constraints)"
        )
    return newton.too_large(scene)


def start(s: Gauss, p: Parameters) -> None:
    """Begin an arc: compute the momenta, and a first guess of the stages' velocities.

    The guess is the velocity at the start of the arc.
    """
    begin(s, p)
    n = s.n
    lagrangian(s.t, s.y, p, s.found)
    s.momenta[:] = s.found[:n]
    for stage in range(s.stages):
        s.V[stage * n : (stage + 1) * n] = s.y[s.velocities]
    s.due = 1.0


def make(s: Gauss, p: Parameters, after: float, h: float) -> int:
    """Compute the state s.new (size,) after a step h, at the time `after`.

    Return DONE, or the code of a failure. See `fixed.make`.
    """
    predict(s)
    if solve_stages(s, p, h) == 0:
        return at.NEWTON_FAILED
    conclude(s, h)
    if not is_finite(s.size, s.new):
        return at.NOT_FINITE
    if solve_velocities(s, p, after, h) == 0:
        return at.NEWTON_FAILED
    derivative(after, s.new, p, s.slope)
    s.evaluations += 1.0
    return at.DONE


def predict(s: Gauss) -> None:
    """Extrapolate the stages' velocities as a first guess for the next step.

    The polynomial through the velocities at the stages and at the end of the last step
    is evaluated; without a last step the present guess stays.
    """
    n, nodes, stages, v = s.n, s.nodes, s.stages, s.y[s.velocities]
    s.V_before[:] = s.V
    if s.step_h == 0.0:
        return
    for stage in range(stages):
        x = 1.0 + nodes[stage]
        for i in range(n):
            # Lagrange's polynomials on the nodes and 1.
            value = 0.0
            for j in range(stages + 1):
                node = nodes[j] if j < stages else 1.0
                part = s.V_before[j * n + i] if j < stages else v[i]
                for k in range(stages + 1):
                    if k != j:
                        other = nodes[k] if k < stages else 1.0
                        part *= (x - other) / (node - other)
                value += part
            s.V[stage * n + i] = value


def solve_stages(s: Gauss, p: Parameters, h: float) -> int:
    """Solve for the stages' velocities V of a step h by Newton's method.

    Return 0 if the method fails, else 1.
    """
    n = s.n
    unknowns = s.stages * n
    right = s.right
    if abs(s.factored_h - h) > SAME_STEP * h:
        s.due = 1.0
    previous = 0.0
    for iteration in range(newton.MOST):
        if s.due > 0.0 and renew(s, p, h) == 0:
            return 0
        s.due = 0.0
        residual(s, p, h)
        newton.solve(1, unknowns, unknowns, s.K, s.pivots, right)
        moved = 0.0
        worst = 0
        for stage in range(s.stages):
            part = largest_part(1, s, h, s.V[stage * n :], right[stage * n :])
            if part > moved:
                worst = stage * n
                moved = part
        s.V[:] += right
        state = judge(s, p, h, s.V[worst:], right[worst:], iteration, moved, previous)
        if state == newton.SOLVED:
            return 1
        if state == newton.LOST:
            return 0
        if state == newton.RENEW:
            s.due = 1.0
        previous = moved
    return 0


def residual(s: Gauss, p: Parameters, h: float) -> None:
    """Store the residuals p0 + h sum_j a_ij F_j - dL/dq'(Q_i, V_i) of all stages i.

    The residuals (stages n,), stored in `right`, are the right side of Newton's method;
    p0 (n,) are the momenta at the start of the step.
    """
    n, stages = s.n, s.stages
    out, width = s.found, s.size
    for stage in range(stages):
        place(s, stage, h, s.z)
        lagrangian(s.t + s.nodes[stage] * h, s.z, p, out[stage * width :])
    s.evaluations += stages
    for stage in range(stages):
        for i in range(n):
            value = s.momenta[i] - out[stage * width + i]
            for j in range(stages):
                a = s.coefficients[stage * stages + j]
                value += h * a * out[j * width + n + i]
            s.right[stage * n + i] = value


def place(s: Gauss, stage: int, h: float, z: Floats) -> None:
    """Write the state of a stage, positions Q and velocities V, to z (size,).

    stage : the index of the stage, from 0.
    h : the length of the step.
    """
    n, v = s.n, z[s.velocities]
    for i in range(n):
        moved = 0.0
        for j in range(s.stages):
            moved += s.coefficients[stage * s.stages + j] * s.V[j * n + i]
        z[i] = s.y[i] + h * moved
        v[i] = s.V[stage * n + i]
    z[s.quadratures] = s.y[s.quadratures]


def renew(s: Gauss, p: Parameters, h: float) -> int:
    """Factor Newton's matrix at the present stages of a step h.

    Return 0 if the matrix is singular, else 1.
    """
    n, stages = s.n, s.stages
    unknowns = stages * n
    block = 4 * n * n
    for stage in range(stages):
        place(s, stage, h, s.z)
        t = s.t + s.nodes[stage] * h
        lagrangian_slopes(t, s.z, p, s.slopes[stage * block :])
    newton.zero_nonfinite(stages * block, s.slopes)
    s.factorisations += 1.0
    s.factored_h = h
    for i in range(stages):
        for k in range(stages):
            for r in range(n):
                for c in range(n):
                    s.K[(i * n + r) * unknowns + k * n + c] = entry(
                        s, h, i, k, r * n + c
                    )
    return newton.decompose(1, unknowns, unknowns, s.K, s.pivots)


def entry(s: Gauss, h: float, i: int, k: int, rc: int) -> float:
    """Return an entry of Newton's matrix, d(dL/dq'(Q_i, V_i) - h sum_j a_ij F_j)/dV_k.

    i, k : indices of stages.
    rc : index of the entry in the block (n, n) of both, row by row.
    """
    square = s.n * s.n
    stages, slopes, a = s.stages, s.slopes, s.coefficients
    value = h * a[stages * i + k] * slopes[i * 4 * square + rc]
    if i == k:
        value += slopes[i * 4 * square + square + rc]
    for j in range(stages):
        slope = h * a[stages * j + k] * slopes[j * 4 * square + 2 * square + rc]
        if j == k:
            slope += slopes[j * 4 * square + 3 * square + rc]
        value -= h * a[stages * i + j] * slope
    return float(value)


def conclude(s: Gauss, h: float) -> None:
    """Compute positions, momenta and works after the step h from the stages.

    The velocities of the new state are set to those of the last stage, as a first guess
    for `solve_velocities`.
    """
    n, new, compensation = s.n, s.new, s.compensation
    stages, works, lost = s.stages, new[s.quadratures], compensation[s.quadratures]
    s.new[:] = s.y
    for stage in range(stages):
        weight = h * s.weights[stage]
        forces = s.found[stage * s.size + n :]
        add(n, new, compensation, weight, s.V[stage * n :])
        add(n, s.momenta, compensation[s.velocities], weight, forces)
        add(s.size - s.quadratures.start, works, lost, weight, forces[n:])
    new[s.velocities] = s.V[(stages - 1) * n :]


def solve_velocities(s: Gauss, p: Parameters, t: float, h: float) -> int:
    """Solve dL/dq'(q', q, t) = p for the velocities q' of the new state at time t.

    The momenta p (n,) are those of the new state. Newton's method is used. Return 0 on
    failure, else 1.

    h : the length of the step.
    """
    n, new, M, change = s.n, s.new, s.M, s.change
    v = new[s.velocities]
    previous = 0.0
    renewing = newton.RENEW
    for iteration in range(newton.MOST):
        if renewing == newton.RENEW:
            inertia(t, new, p, M)
            s.factorisations += 1.0
            if newton.decompose(1, n, n, M, s.M_pivots) == 0:
                return 0
        lagrangian(t, new, p, s.found)
        s.evaluations += 1.0
        s.change[:] = s.momenta - s.found[:n]
        newton.solve(1, n, n, M, s.M_pivots, change)
        moved = largest_part(1, s, h, v, change)
        new[s.velocities] += change
        renewing = judge(s, p, h, v, change, iteration, moved, previous)
        if renewing == newton.SOLVED:
            return 1
        if renewing == newton.LOST:
            return 0
        previous = moved
    return 0


class Gauss4(Gauss):
    """Memory of `gauss4`, with the tableau of the method."""

    stages: int = 2
    nodes: Floats = array("stages", C)
    weights: Floats = array("stages", B)
    coefficients: Floats = array(lambda s: s.stages**2, (*A[0], *A[1]), replaces=True)


STATE = Gauss4
