"""The error of a run, estimated by the difference from a repeat by other means.

A local error says little of the motion: the estimate is the difference of two whole
runs, so that it knows how errors grow on the way (`repeats` makes the second). The
error of a coordinate is measured by its range; where it rests but for rounding, by its
value, by the motion of what constraints link with it, or by how far the forces on it
would take it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import BALANCED, evaluate
from lagsim.run.error import LOST, ErrorBar
from lagsim.run.system.functions import in_groups, joined, largest_beside
from lagsim.tolerances import (
    FLAT_RANGE,
    MOTION_ROUNDOFF,
    NO_MOTION,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.plan.plan import Plan
    from lagsim.run.observers.monitors import Checkpoints
    from lagsim.run.session import Case
    from lagsim.run.trajectory import Trajectory

# What moves by a million times its error does not rest.
RESOLVED_BY = 1e-6


def beside(equations: Equations, start: Instant, found: Floats) -> Floats:
    """Return the largest range (n,) of other coordinates, each in the unit of its own.

    As far as its inertia may be moved by it: of a heavier body no more than that body's
    own range, so that what is light does not hide behind it; of a lighter one less, as
    the roots of the masses. Where units differ, whichever is less.
    """
    return largest_beside(_roots(equations, start), found)


def _roots(equations: Equations, start: Instant) -> Floats:
    """Return the roots of the diagonal of M at the start (n,)."""
    values = {p.name: p.value for p in equations.model.parameters} | {"t": start.t}
    values |= dict(zip(equations.q, start.q, strict=True))
    values |= dict(zip(equations.velocities, start.v, strict=True))
    diagonal = evaluate(equations.graph, equations.inertias, values)
    return np.sqrt(np.fmax(diagonal, 0.0))


def _scales(
    found: Floats, moving: Floats, linked: Floats, largest: Floats, held: Floats
) -> tuple[Floats, Floats]:
    """Return the scales of errors (n,), and the ranges below which there is no horizon.

    Parameters
    ----------
    found, moving, linked, largest, held
        Of each coordinate the range, the motion beside it, that of what it is linked
        with, the largest value, and how far it would move if nothing held it.
    """
    scales = np.fmax(found, FLAT_RANGE * moving)
    for size in (largest, linked):
        scales = np.where(found > MOTION_ROUNDOFF * size, scales, np.fmax(scales, size))
    scales = np.where(found <= BALANCED * held, np.fmax(scales, held), scales)
    still = np.fmax(NO_MOTION * moving, BALANCED * held / LOST)
    return scales, np.fmax(still, MOTION_ROUNDOFF * largest / LOST)


def compared(
    case: Case,
    runs: tuple[Trajectory, Trajectory],
    plan: Plan,
    checkpoints: Checkpoints,
    again: Checkpoints,
) -> ErrorBar:
    """Return the error bar of a run by a repeat: rows of the same numbers, and ends.

    Parameters
    ----------
    runs, checkpoints, again
        The run and its repeat, and the rows of each.
    plan
        Of the repeat.
    """
    equations, start, n = case.equations, case.start, len(case.equations.q)
    run, repeated = runs
    repeats = again.numbered
    pairs = [(x, repeats[k]) for k, x in checkpoints.numbered.items() if k in repeats]
    apart = abs(run.end - repeated.end)
    alike = run.outcome is repeated.outcome and apart < case.settings.output_step
    assert checkpoints.last is not None
    assert again.last is not None
    if alike and checkpoints.last[0] > pairs[-1][0][0]:
        pairs.append((checkpoints.last, again.last))
    mine, theirs = np.array(pairs).swapaxes(0, 1)
    errors = np.abs(theirs[:, 1:] - mine[:, 1:])
    errors = np.fmax(errors, UNIT_ROUNDOFF * _largest(mine[:, 1:]))
    # Times are rounded, too, also those at which forces step.
    late = UNIT_ROUNDOFF * _largest(mine[:, :1] * mine[:, 1 + n :])
    errors[:, :n] = np.fmax(errors[:, :n], late)
    own, worst = checkpoints.high - checkpoints.low, np.max(errors[:, :n], axis=0)
    sizes = _ranges(equations.q, repeated, checkpoints, again)
    # Where the two are apart, the repeat's motion is another one; it counts only where
    # the run has hardly moved.
    sizes = np.where((worst > LOST * sizes) & (own > LOST * sizes), own, sizes)
    roots = _roots(equations, start)
    labels = joined(n, [row.A.entries for row in equations.rows])
    moving, linked = largest_beside(roots, sizes), in_groups(labels, roots, sizes)
    largest, held = np.max(np.abs(mine[:, 1 : 1 + n]), axis=0), np.zeros(n)
    scales, still = _scales(sizes, moving, linked, largest, held)
    # All else moves by far more than its error, or than a part of what moves beside it.
    slow = (sizes <= NO_MOTION * moving) | (worst > RESOLVED_BY * scales)
    if slow.any():
        from lagsim.run.held import could_push

        which = np.flatnonzero(slow).tolist()
        held = could_push(equations, mine, which, case.settings.output_step).reach
        scales, still = _scales(sizes, moving, linked, largest, held)
    rounding = np.fmax(MOTION_ROUNDOFF * largest, BALANCED * held)
    return ErrorBar(
        method=plan.method,
        rtol=plan.rtol,
        names=equations.q,
        times=mine[:, 0],
        errors=errors[:, :n],
        scales=scales,
        still=still,
        rates=errors[:, n:],
        repeated=repeats,
        parted="" if alike else _parted(run, repeated, plan),
        rests=bool(np.all(sizes <= rounding)),
    )


def _ranges(
    names: tuple[str, ...],
    repeated: Trajectory,
    checkpoints: Checkpoints,
    again: Checkpoints,
) -> Floats:
    """Return the ranges (n,) over all rows of both runs, and over the repeat's steps.

    Rows may be few, or show an oscillation always in the same phase.
    """
    nothing = np.nan, np.nan
    steps = np.array([repeated.extents.get(name, nothing) for name in names]).T
    low = np.fmin.reduce([checkpoints.low, again.low, steps[0]])
    high = np.fmax.reduce([checkpoints.high, again.high, steps[1]])
    return np.asarray(high - low)


def _largest(values: Floats) -> Floats:
    """Return the largest sizes up to each row (k, n)."""
    return np.asarray(np.maximum.accumulate(np.abs(values), axis=0))


def _parted(run: Trajectory, repeated: Trajectory, plan: Plan) -> str:
    """Return the text on two runs that ended differently, or ""."""
    if not (run.outcome.complete and repeated.outcome.complete):
        return ""
    return (
        f"it ended with `{run.outcome.word}` at t = {run.end:.9g}, and a repeat by "
        f"{plan.method} with `{repeated.outcome.word}` at t = {repeated.end:.9g}"
    )
