"""Multipliers as the solution of equations, once it is known which rows hold."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.closed import Mode

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact.problem import Problem

# Singular values that are smaller belong to dependent rows. D is a square, so that this
# is an angle of 1e-7.
DEPENDENT = 1e-14


def expressed(
    problem: Problem, modes: list[Mode], ways: list[float]
) -> tuple[Floats, Floats]:
    """Give E (r, r), p0 (r,): p = E x + p0, where x are multipliers of held rows."""
    r = len(modes)
    E, p0 = np.zeros((r, r)), np.zeros(r)
    for k, mode in enumerate(modes):
        if mode is Mode.HELD:
            E[k, k] = 1.0
        elif ways[k] and mode is not Mode.OFF:
            p0[k] = ways[k] * problem.limits[k]
            n = problem.normals[k]
            if n >= 0 and modes[n] is Mode.HELD:
                E[k, n] = ways[k] * problem.mus[k]
    return E, p0


def polished(
    problem: Problem,
    modes: list[Mode],
    ways: list[float],
    factor: Floats | None = None,
) -> Floats:
    """Give the multipliers (r,) for which the held rows hold.

    With the factor (k, r) of D, nearly dependent rows cost only the digits they must.
    """
    E, p0 = expressed(problem, modes, ways)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    if not held:
        return p0
    D = problem.D[held]
    B, h = (D @ E)[:, held], np.array(problem.c)[held] + D @ p0
    solve = _by_factor(factor, E, held) if factor is not None else _by_square(B)
    x = -solve(h)
    x -= solve(B @ x + h)
    return E[:, held] @ x + p0


def _by_square(B: Floats) -> Callable[[Floats], Floats]:
    return lambda rhs: np.asarray(np.linalg.lstsq(B, rhs, rcond=DEPENDENT)[0], float)


def _by_factor(Y: Floats, E: Floats, held: list[int]) -> Callable[[Floats], Floats]:
    """Solve with B = Y_H^T Y E_H as R^T (Q^T Y E_H), where Y_H = Q R."""
    Q, R = np.linalg.qr(Y[:, held])
    forces = Q.T @ (Y @ E)[:, held]
    return lambda rhs: np.asarray(
        np.linalg.lstsq(forces, np.linalg.solve(R.T, rhs), rcond=DEPENDENT)[0], float
    )
