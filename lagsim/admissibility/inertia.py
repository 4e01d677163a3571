"""Whether every direction has inertia, or a constraint that determines it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.newton import RANK, null_space
from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from lagsim.admissibility.point import Point
    from lagsim.native.kernel_types import Floats


def needs_constraints(point: Point, q: Floats, v: Floats) -> bool:
    """Tell whether M is singular alone but positive where the constraints let it move.

    Raises
    ------
    InputError
        Where a direction that the constraints admit has no inertia, or a negative one.
    """
    M = point.mass(q, v)
    size = np.sqrt(np.abs(np.diag(M)))
    size[size == 0] = np.max(size, initial=0.0) or 1.0
    scaled = M / np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] > RANK:
        return False
    kernel = null_space(point.jacobian(point.e.rows, q, v) / size)
    if not kernel.shape[1]:
        return True
    inertia, directions = np.linalg.eigh(kernel.T @ scaled @ kernel)
    if inertia[0] > RANK:
        return True
    direction = (kernel @ directions[:, 0]) / size
    problem = _problem(point.e.q, direction, negative=bool(inertia[0] < -RANK))
    raise InputError([problem])


def _problem(names: tuple[str, ...], direction: Floats, *, negative: bool) -> Problem:
    direction = direction / direction[np.argmax(np.abs(direction))]
    parts = [
        name if abs(c - 1) < 1e-6 else f"{c:.4g} {name}"
        for name, c in zip(names, direction, strict=True)
        if abs(c) > 1e-6
    ]
    along = " + ".join(parts).replace("+ -", "- ")
    what = "coordinate" if len(parts) == 1 else "combination of coordinates"
    if negative:
        return Problem(
            "negative-inertia",
            f"the kinetic energy falls with the speed of the {what} {along} at the "
            "start: the mass matrix is indefinite",
            hint="look for a negative mass or a wrong sign in `kinetic`",
        )
    return Problem(
        "no-inertia",
        f"the {what} {along} has no inertia at the start, and no constraint "
        "determines its acceleration",
        hint="give it a mass in `kinetic`, a constraint, or make it a definition",
    )
