"""Inertia of every direction, or a constraint that determines it; many starts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.algebra import null_space, sizes_of
from lagsim.errors import InputError, Problem
from lagsim.language.evaluate import evaluate_rows
from lagsim.tolerances import DEPENDENT_ROWS, UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations


# Inertia below this part of the largest is rounding, where M varies with the positions:
# a motion passes it (angles near gimbal lock), and its rounding is seen in every step.
# Of a constant M it would be the same in all steps, which no repeat sees.
PASSING = 1e-13


def needs_constraints(point: Point) -> bool:
    """Tell whether M is singular alone but positive where the constraints let it move.

    Raises
    ------
    InputError
        Where a direction that the constraints admit has no inertia, or any direction a
        negative one.
    """
    if (point.is_large or point.e.chains) and point.is_safely_positive:
        return False
    size, scaled, rows = _scaled(point)
    inertia, directions = np.linalg.eigh(scaled)
    varies = not point.g.depends(point.e.mass_nodes).isdisjoint(point.e.q)
    least = PASSING if varies else DEPENDENT_ROWS
    if inertia[0] > least:
        return False
    if inertia[0] < -DEPENDENT_ROWS:
        direction = directions[:, 0] / size
        raise InputError([_problem(point, direction, negative=True)])
    kernel = _admissible(rows)
    if not kernel.shape[1]:
        return True
    inertia, directions = np.linalg.eigh(kernel.T @ scaled @ kernel)
    if inertia[0] > least:
        return True
    direction = (kernel @ directions[:, 0]) / size
    always = " that always holds" if point.e.laws else ""
    raise InputError([_problem(point, direction, negative=False, which=always)])


def admitted_inertia(point: Point, i: int) -> float:
    """Give the inertia that a force on coordinate i acts on; inf: constraints hold it.

    That is 1 over its acceleration by a unit force along the admissible directions.
    """
    size, scaled, rows = _scaled(point)
    kernel = _admissible(rows)
    inertia, directions = np.linalg.eigh(kernel.T @ scaled @ kernel)
    along = (kernel[i] @ directions) ** 2
    moved = float(np.sum(along / np.maximum(inertia, UNIT_ROUNDOFF)))
    return float(size[i] ** 2 / moved) if moved > 0.0 else math.inf


def _scaled(point: Point) -> tuple[Floats, Floats, Floats]:
    """Give sizes of coordinates (n,), and scaled by them M (n, n) and A (m, n).

    What is only rounding in A is zero.
    """
    M, A = point.mass_matrix, point.jacobian(point.e.rows, rounded=True)
    size = sizes_of(np.sqrt(np.abs(np.diag(M))), A)
    return size, M / np.outer(size, size), A / size


def _admissible(rows: Floats) -> Floats:
    """Give the directions (n, k) that rows (m, n) leave."""
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return null_space(rows / np.where(lengths > 0, lengths, 1.0))


def _factor(c: float) -> str:
    if abs(abs(c) - 1) < 1e-6:
        return "-" if c < 0 else ""
    return f"{c:.4g} "


def _problem(
    point: Point, direction: Floats, *, negative: bool, which: str = ""
) -> Problem:
    names, places = point.e.q, point.e.model.places
    place = places.get("kinetic", places.get("lagrangian"))
    direction = direction / direction[np.argmax(np.abs(direction))]
    parts = [
        f"{_factor(c)}{name}"
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
            place,
            "look for a negative mass or a wrong sign in `kinetic`",
        )
    return Problem(
        "no-inertia",
        f"the {what} {along} has no inertia at the start, and no constraint"
        f"{which} determines its acceleration",
        place,
        "give it a mass in `kinetic`, a constraint, or make it a definition",
    )


# --- Many starts of one scene at once: those that need no closer examination
#
# Of a scene without constraints a start is admissible where energies and forces are
# finite there and every direction has inertia. What may fail that is left to `examine`,
# which says why.

# More than any bound asks for: what is closer to one is looked at by itself.
CLEAR = 2.0 * max(DEPENDENT_ROWS, PASSING)


def needs_no_solve(equations: Equations) -> bool:
    """Tell whether a start is what it is stated to be, and has nothing to satisfy."""
    values = equations.model.initial
    return not (
        equations.rows
        or equations.laws
        or any(x.guess or x.node is not None for x in values)
    )


def clear_starts(
    equations: Equations, values: Mapping[str, float | Floats], count: int
) -> Flags:
    """Tell which of `count` starts are admissible, as far as that is clear (count,).

    Parameters
    ----------
    values
        t, parameters, coordinates and velocities: numbers, or arrays (count,).
    """
    e, model, n = equations, equations.model, len(equations.q)
    energies = (model.kinetic, model.potential, e.energy)
    named = [node for node in energies if node is not None]
    named += [*e.f, *e.inertias]
    M = [node for row in e.M for node in row]
    found = evaluate_rows(e.graph, [*named, *M], values, count)
    finite = np.all(np.isfinite(found), axis=0)
    mass = found[len(named) :].T.reshape(count, n, n)
    diagonal = np.diagonal(mass, axis1=1, axis2=2)
    clear: Flags = finite & np.all(diagonal > 0.0, axis=1)
    sizes = np.sqrt(diagonal[clear])
    scaled = mass[clear] / (sizes[:, :, None] * sizes[:, None, :])
    # LAPACK fails for what has overflowed on the way.
    sound = np.all(np.isfinite(scaled), axis=(1, 2))
    least = np.zeros(len(scaled))
    least[sound] = np.linalg.eigvalsh(scaled[sound])[:, 0]
    clear[clear] = least > CLEAR
    return clear
