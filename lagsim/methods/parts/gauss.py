"""Gauss collocation in positions and momenta p = dL/dq', for any Lagrangian.

    P_i = p0 + h sum a_ij F_j,   Q_i = q0 + h sum a_ij V_j,
    dL/dq'(Q_i, V_i) = P_i,      F = dL/dq and the generalized forces,

solved for the stages' velocities V_i by Newton's method with the derivatives from the
graph. The velocities at the end belong to the momenta there. Positions, momenta and
work carry what rounding has cut off.

Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
sections II.1.3, VI.4 and VIII.5, VIII.6.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.fixed import begin, is_finite, next_time, step_length, take
from lagsim.methods.parts.interface import (
    derivative,
    inertia,
    lagrangian,
    lagrangian_slopes,
)
from lagsim.methods.parts.lu import decompose, solve, too_large
from lagsim.methods.parts.newton import CONVERGED, LOST, MOST, RENEW, progress
from lagsim.methods.parts.projection import relative_size
from lagsim.methods.parts.state import (
    DONE,
    EVALUATIONS,
    FACTORISATIONS,
    HEADER,
    NEWTON_FAILED,
    NOT_FINITE,
    SIZE,
    STEP_H,
    N,
    T,
)
from lagsim.methods.parts.symplectic import add
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.structure import Structure

CONSTRAINED = False  # for what is shared with methods that can be

# The method's own arrays after those of `_fixed` (3 size): y' after the step (size),
# the new state (size), a state to ask at (size), what rounding has cut off of q, p and
# work (size), momenta (n); then these words, and what belongs to stages.
OWN = 7
COUNT = 0  # of stages
DUE = 1  # whether the factors are
FACTORED_H = 2  # the step they belong to
NODES = 3  # c (2)
WEIGHTS = 5  # b (2)
COEFFICIENTS = 7  # A (2, 2)
WORDS = 11


def refusal(scene: Structure) -> str:
    """Say why momenta do not tell the motion, or give ""."""
    if scene.constraints == "holonomic":
        return (
            "it has constraints (`rattle` is symplectic on holonomic ones, `dop853` "
            "projects onto them)"
        )
    if scene.constraints != "none":
        return "it has constraints between velocities (`dop853` projects onto them)"
    return too_large(scene)


def state_size(size: int, stages: int) -> int:
    """Give the length of the array of state for `size` components."""
    n = size // 2
    return HEADER + 6 * size + 6 + OWN * size + n + WORDS + stage_room(n, stages)


def stage_room(n: int, stages: int) -> int:
    """Give the length of what belongs to stages.

    V (s, n), V of the step before (s, n), momenta, forces and power (s, 2 n + 1), the
    slopes of each stage (s, 4 n n), the Newton matrix (s n, s n), its pivots and right
    side (2 s n); inertia (n, n), pivots and change (2 n).
    """
    unknowns = stages * n
    per_stage = 2 * unknowns + stages * (2 * n + 1 + 4 * n * n)
    return per_stage + unknowns * unknowns + 2 * unknowns + n * n + 2 * n


def begin_stages(s: Floats, p: Floats) -> None:
    """Begin an arc: momenta from velocities; the stages begin at the velocities."""
    begin(s, p)
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    rest = at(s, HEADER + 12 * size + 6)
    momenta = at(rest, size)
    words = at(momenta, n)
    V = at(words, WORDS)
    stages = int(words[COUNT])
    out = at(V, 2 * stages * n)
    lagrangian(s[T], y, p, out)
    for i in range(n):
        momenta[i] = out[i]
    for i in range(size):
        rest[i] = 0.0
    for stage in range(stages):
        for i in range(n):
            V[stage * n + i] = y[n + i]
    words[DUE] = 1.0


def gauss_step(s: Floats, p: Floats) -> int:
    """Make one step, or give a code other than 0."""
    size = int(s[SIZE])
    slope = at(s, HEADER + 9 * size + 6)
    new = at(slope, size)
    after = next_time(s)
    h = step_length(s, after)
    predict(s)
    if solve_stages(s, p, h) == 0:
        return NEWTON_FAILED
    conclude(s, h)
    if not is_finite(size, new):
        return NOT_FINITE
    if solve_velocities(s, p, after, h) == 0:
        return NEWTON_FAILED
    derivative(after, new, p, slope)
    s[EVALUATIONS] += 1.0
    take(s, p, after, new, slope)
    return DONE


def predict(s: Floats) -> None:
    """Extend the polynomial through the stages' velocities and the last one."""
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    words = at(s, HEADER + 13 * size + 6 + n)
    V = at(words, WORDS)
    stages = int(words[COUNT])
    old = at(V, stages * n)
    for k in range(stages * n):
        old[k] = V[k]
    if s[STEP_H] == 0.0:
        return
    for stage in range(stages):
        x = 1.0 + words[NODES + stage]
        for i in range(n):
            # Lagrange's polynomials on the nodes and 1.
            value = 0.0
            for j in range(stages + 1):
                node = words[NODES + j] if j < stages else 1.0
                part = old[j * n + i] if j < stages else y[n + i]
                for k in range(stages + 1):
                    if k != j:
                        other = words[NODES + k] if k < stages else 1.0
                        part *= (x - other) / (node - other)
                value += part
            V[stage * n + i] = value


def solve_stages(s: Floats, p: Floats, h: float) -> int:
    """Solve for the stages' velocities; give 0 where Newton's method fails."""
    size = int(s[SIZE])
    n = int(s[N])
    words = at(s, HEADER + 13 * size + 6 + n)
    V = at(words, WORDS)
    stages = int(words[COUNT])
    unknowns = stages * n
    out = at(V, 2 * unknowns)
    K = at(out, stages * (2 * n + 1 + 4 * n * n))
    right = at(K, unknowns * unknowns + unknowns)
    sizes = at(s, HEADER + size + n)
    masses = at(s, HEADER + 3 * size + 2)
    if abs(words[FACTORED_H] - h) > 1e-9 * h:
        words[DUE] = 1.0
    previous = 0.0
    for iteration in range(MOST):
        if words[DUE] > 0.0 and renew(s, p, h) == 0:
            return 0
        words[DUE] = 0.0
        residual(s, p, h)
        solve(unknowns, K, at(K, unknowns * unknowns), right)
        moved = 0.0
        for stage in range(stages):
            part = at(right, stage * n)
            moved = max(
                moved,
                relative_size(
                    n, part, masses, at(V, stage * n), sizes, h * h * masses[n]
                ),
            )
        for k in range(unknowns):
            V[k] += right[k]
        state = progress(iteration, moved, previous)
        if state == CONVERGED:
            return 1
        if state == LOST:
            return 0
        if state == RENEW:
            words[DUE] = 1.0
        previous = moved
    return 0


def residual(s: Floats, p: Floats, h: float) -> None:
    """Leave p0 + h sum a_ij F_j - dL/dq'(Q_i, V_i) as the right side."""
    size = int(s[SIZE])
    n = int(s[N])
    momenta = at(s, HEADER + 13 * size + 6)
    words = at(momenta, n)
    stages = int(words[COUNT])
    out = at(words, WORDS + 2 * stages * n)
    right = at(out, stages * (2 * n + 1 + 4 * n * n) + (stages * n + 1) * stages * n)
    z = at(s, HEADER + 11 * size + 6)
    width = 2 * n + 1
    for stage in range(stages):
        place(s, stage, h, z)
        lagrangian(s[T] + words[NODES + stage] * h, z, p, at(out, stage * width))
    s[EVALUATIONS] += stages
    for stage in range(stages):
        for i in range(n):
            value = momenta[i] - out[stage * width + i]
            for j in range(stages):
                a = words[COEFFICIENTS + 2 * stage + j]
                value += h * a * out[j * width + n + i]
            right[stage * n + i] = value


def place(s: Floats, stage: int, h: float, z: Floats) -> None:
    """Give the state (Q, V) of a stage."""
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    words = at(s, HEADER + 13 * size + 6 + n)
    V = at(words, WORDS)
    for i in range(n):
        moved = 0.0
        for j in range(int(words[COUNT])):
            moved += words[COEFFICIENTS + 2 * stage + j] * V[j * n + i]
        z[i] = y[i] + h * moved
        z[n + i] = V[stage * n + i]
    if size > 2 * n:
        z[2 * n] = y[2 * n]


def renew(s: Floats, p: Floats, h: float) -> int:
    """Factor the Newton matrix at the present stages; give 0 where it is singular."""
    size = int(s[SIZE])
    n = int(s[N])
    words = at(s, HEADER + 13 * size + 6 + n)
    stages = int(words[COUNT])
    unknowns = stages * n
    slopes = at(words, WORDS + 2 * unknowns + stages * (2 * n + 1))
    K = at(slopes, stages * 4 * n * n)
    z = at(s, HEADER + 11 * size + 6)
    block = 4 * n * n
    for stage in range(stages):
        place(s, stage, h, z)
        t = s[T] + words[NODES + stage] * h
        lagrangian_slopes(t, z, p, at(slopes, stage * block))
    s[FACTORISATIONS] += 1.0
    words[FACTORED_H] = h
    for i in range(stages):
        for k in range(stages):
            for r in range(n):
                for c in range(n):
                    K[(i * n + r) * unknowns + k * n + c] = entry(
                        n, words, slopes, h, i, k, r * n + c
                    )
    return decompose(unknowns, K, at(K, unknowns * unknowns))


def entry(
    n: int, words: Floats, slopes: Floats, h: float, i: int, k: int, rc: int
) -> float:
    """Give d(dL/dq'(Q_i, V_i) - h sum a_ij F_j)/dV_k, one of its entries."""
    square = n * n
    a = at(words, COEFFICIENTS)
    value = h * a[2 * i + k] * slopes[i * 4 * square + rc]
    if i == k:
        value += slopes[i * 4 * square + square + rc]
    for j in range(int(words[COUNT])):
        slope = h * a[2 * j + k] * slopes[j * 4 * square + 2 * square + rc]
        if j == k:
            slope += slopes[j * 4 * square + 3 * square + rc]
        value -= h * a[2 * i + j] * slope
    return float(value)


def conclude(s: Floats, h: float) -> None:
    """Give the new positions, momenta and work; the velocities go on for a start."""
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    new = at(s, HEADER + 10 * size + 6)
    rest = at(s, HEADER + 12 * size + 6)
    momenta = at(rest, size)
    words = at(momenta, n)
    stages = int(words[COUNT])
    V = at(words, WORDS)
    out = at(V, 2 * stages * n)
    width = 2 * n + 1
    for i in range(size):
        new[i] = y[i]
    for stage in range(stages):
        weight = h * words[WEIGHTS + stage]
        forces = at(out, stage * width + n)
        add(n, new, rest, weight, at(V, stage * n))
        add(n, momenta, at(rest, n), weight, forces)
        if size > 2 * n:
            add(1, at(new, 2 * n), at(rest, 2 * n), weight, at(forces, n))
    for i in range(n):
        new[n + i] = V[(stages - 1) * n + i]


def solve_velocities(s: Floats, p: Floats, t: float, h: float) -> int:
    """Solve dL/dq' = p for the velocities; give 0 where Newton's method fails."""
    size = int(s[SIZE])
    n = int(s[N])
    new = at(s, HEADER + 10 * size + 6)
    momenta = at(s, HEADER + 13 * size + 6)
    words = at(momenta, n)
    stages = int(words[COUNT])
    out = at(words, WORDS + 2 * stages * n)
    M = at(words, WORDS + stage_room(n, stages) - n * n - 2 * n)
    change = at(M, n * n + n)
    sizes = at(s, HEADER + size + n)
    masses = at(s, HEADER + 3 * size + 2)
    previous = 0.0
    renewing = RENEW
    for iteration in range(MOST):
        if renewing == RENEW:
            inertia(t, new, p, M)
            s[FACTORISATIONS] += 1.0
            if decompose(n, M, at(M, n * n)) == 0:
                return 0
        lagrangian(t, new, p, out)
        s[EVALUATIONS] += 1.0
        for i in range(n):
            change[i] = momenta[i] - out[i]
        solve(n, M, at(M, n * n), change)
        moved = relative_size(n, change, masses, at(new, n), sizes, h * h * masses[n])
        for i in range(n):
            new[n + i] += change[i]
        renewing = progress(iteration, moved, previous)
        if renewing == CONVERGED:
            return 1
        if renewing == LOST:
            return 0
        previous = moved
    return 0
