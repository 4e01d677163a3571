"""The derivative of the accelerations with respect to the state, exactly.

With the residuals r = M q'' - f - A^T lambda and s = A q'' - b, in which q'' and lambda
stand as variables, d(q'', lambda)/dy solves the equations of motion themselves with
-dr/dy for f and -ds/dy for b: one factorisation serves all of its columns. dr/dy and
ds/dy come from the graph. lambda is that of the rows which the decomposition chose.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters
from lagsim.native.kernels.words import at, external
from lagsim.solve._cholesky import augment_force, backward, factor, forward
from lagsim.solve._rows import (
    from_places,
    mirror,
    reflect,
    spread,
    to_places,
    unscaled_backward,
)
from lagsim.solve.dense import dynamics

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


@external
def slopes(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give dr/dy (n, 2 n), ds/dy (m, 2 n) and, for each work, dpower/dy (2 n,).

    y = (q, q'); at the q'' and lambda that p holds. Last dpower/d(q'', lambda). What is
    zero identically is not written: the room for it holds zeros from the start.
    """


def jacobian(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give dq''/d(q, q') (n, 2 n) and, for each work, that of its rate (2 n,)."""
    n, m, f, b, slope, by_motion = p.n, p.m, p.f, p.b, p.slopes, p.by_motion
    column = p.column
    dynamics(t, y, p, p.terms)
    factor(p)
    spread(p)
    rank = reflect(p)
    solve_again(p, rank, p.motion)
    slopes(t, y, p, slope)
    width = 2 * n
    for c in range(width):
        for j in range(n):
            f[j] = -slope[j * width + c]
        for i in range(m):
            b[i] = -slope[(n + i) * width + c]
        solve_again(p, rank, column)
        for j in range(n):
            out[j * width + c] = column[j]
        for k in range(p.works):
            rate = slope[(n + m + k) * width + c]
            for i in range(n + m):
                rate += by_motion[k * (n + m) + i] * column[i]
            out[(n + k) * width + c] = rate


def solve_again(p: Parameters, rank: int, out: Floats) -> None:
    """Give q'' (n,) and lambda (m,) for the f and b in the terms, which are used up.

    With what `factor` and `reflect` left: L^T q'' = Q w + (1 - Q Q^T) L^-1 f, where
    R^T w = b, and R lambda = w - Q^T L^-1 f.
    """
    n, f, b, L, Y, places, scales, w = p.n, p.f, p.b, p.L, p.Y, p.places, p.scales, p.w
    diagonal, factors, order, x = p.diagonal, p.factors, p.order, p.x
    if p.augmented > 0.0:
        augment_force(p)
    forward(n, L, f)
    to_places(n, places, f)
    for k in range(rank):
        mirror(n, k, at(Y, k * n), factors[k], f)
    for k in range(rank):
        w[k] = b[int(order[k])] * scales[k]
        for j in range(k):
            w[k] -= Y[k * n + j] * w[j]
        w[k] /= diagonal[k]
        x[k] = w[k] - f[k]
        f[k] = w[k]
    for back in range(rank):
        k = rank - 1 - back
        mirror(n, k, at(Y, k * n), factors[k], f)
    from_places(n, places, f)
    backward(n, L, f, out)
    unscaled_backward(p, rank, x)
    for i in range(p.m):
        out[n + i] = 0.0
    for k in range(rank):
        out[n + int(order[k])] = x[k]
