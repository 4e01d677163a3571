"""Error bar of a run: the difference of its rows and the rows of a repeat.

Local errors do not bound the error of the motion. The error bar is therefore the
difference of two complete runs, which includes the growth of errors. The scale of an
error is the range of the coordinate. For a coordinate at rest to rounding the scale is
its value, the motion of coordinates linked with it by constraints, or the distance that
the forces on it would move it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.sparse import joined
from lagsim.run.error import (
    LOST,
    ErrorBar,
    could_follow,
    could_push,
    in_groups,
    largest_beside,
)
from lagsim.run.trajectory import Outcome
from lagsim.studies.audit.evidence import inertia_roots
from lagsim.tolerances import (
    COMPUTED_ZERO,
    NO_MOTION,
    SUM_ROUNDOFF,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.studies.audit.evidence import Evidence

# A coordinate with an error of less than this part of its scale is not at rest.
RESOLVED_BY = 1e-6
# Ratio of the range of a motion at rest to the rounding of a sum, at most. It was 1.5
# for a string that hangs, with series of order 15, whose steps damp oscillations.
NOISE = 4.0


def _scales(
    found: Floats, moving: Floats, linked: Floats, largest: Floats, by_forces: Floats
) -> tuple[Floats, Floats]:
    """Return the scale of errors, and the largest range at rest, of each coordinate.

    Parameters
    ----------
    found, moving, linked, largest, by_forces : ndarray, shape (n,)
        For each coordinate its range, the motion of the other coordinates scaled by
        inertia, the range of coordinates linked with it by constraints, its largest
        absolute value, and the distance that the forces on it would move it without
        constraints.

    Returns
    -------
    scales, still : ndarray, shape (n,)
        The scale of errors of each coordinate, and the range below which the coordinate
        counts as at rest, so that its error determines no horizon.
    """
    scales = np.fmax(found, COMPUTED_ZERO * moving)
    for size in (largest, linked):
        scales = np.where(found > SUM_ROUNDOFF * size, scales, np.fmax(scales, size))
    scales = np.where(
        found <= SUM_ROUNDOFF * by_forces, np.fmax(scales, by_forces), scales
    )
    still = np.fmax(NO_MOTION * moving, SUM_ROUNDOFF * by_forces / LOST)
    return scales, np.fmax(still, SUM_ROUNDOFF * largest / LOST)


def error_bar_of(evidence: Evidence, repeat: Evidence) -> ErrorBar:
    """Return the error bar of a run, from its rows and the rows of a repeat.

    Output rows with equal row numbers are compared, and the last rows if both runs end
    alike.
    """
    case, checkpoints, again = (
        evidence.session.case,
        evidence.checkpoints,
        repeat.checkpoints,
    )
    equations, start, n = case.equations, case.start, len(case.equations.q)
    run, repeated, plan = evidence.trajectory, repeat.trajectory, repeat.plan
    repeats = again.numbered
    pairs = [(x, repeats[k]) for k, x in checkpoints.numbered.items() if k in repeats]
    delay = abs(run.end - repeated.end)
    same_end = run.outcome is repeated.outcome and delay < case.settings.output_step
    assert checkpoints.last is not None
    assert again.last is not None
    if same_end and checkpoints.last[0] > pairs[-1][0][0]:
        pairs.append((checkpoints.last, again.last))
    rows, repeated_rows = np.array(pairs).swapaxes(0, 1)
    every = np.abs(repeated_rows - rows)
    every = np.fmax(every, UNIT_ROUNDOFF * _largest(rows))
    # Times are rounded, too, including the times at which forces jump.
    by_time = UNIT_ROUNDOFF * _largest(rows[:, :1] * rows[:, 1 + n : 1 + 2 * n])
    every[:, 1 : 1 + n] = np.fmax(every[:, 1 : 1 + n], by_time)
    errors = checkpoints.valued(every)
    own, worst = checkpoints.high - checkpoints.low, np.max(errors, axis=0)
    names = *equations.q, *(x.name for x in equations.states)
    # Ranges of rows and of steps: rows may be few, or all at one phase of an
    # oscillation.
    nothing = np.nan, np.nan
    steps = np.array([repeated.extents.get(name, nothing) for name in names]).T
    low = np.fmin.reduce([checkpoints.low, again.low, steps[0]])
    high = np.fmax.reduce([checkpoints.high, again.high, steps[1]])
    sizes = np.asarray(high - low)
    # Where the error is large, the repeat follows another motion. Its range counts only
    # where the run itself has hardly moved.
    sizes = np.where((worst > LOST * sizes) & (own > LOST * sizes), own, sizes)
    roots = inertia_roots(equations, start)
    labels = joined(n, [row.A.entries for row in equations.rows])
    moving, linked, by_forces = np.zeros((3, len(names)))
    moving[:n] = largest_beside(roots, sizes[:n])
    linked[:n] = in_groups(labels, roots, sizes[:n])
    largest = np.max(np.abs(checkpoints.valued(rows)), axis=0)
    # Coordinates linked by constraints share the rounding of their positions.
    largest[:n] = np.fmax(largest[:n], in_groups(labels, roots, largest[:n]))
    scales, still = _scales(sizes, moving, linked, largest, by_forces)
    # The other coordinates move by far more than their errors.
    slow = (sizes <= NO_MOTION * moving) | (worst > RESOLVED_BY * scales)
    # Where a run blows up, its last forces could push a coordinate past all ranges.
    if slow[:n].any() and run.outcome is not Outcome.NOT_FINITE:
        which, step = np.flatnonzero(slow[:n]).tolist(), case.settings.output_step
        reach = could_push(equations, rows, which, step).reach
        # Along the constraints a force moves all coordinates that are linked with its
        # own.
        by_forces[:n] = np.fmax(reach, in_groups(labels, roots, reach))
        if equations.states:
            by_forces[n:] = could_follow(equations, rows, by_forces[:n])
        scales, still = _scales(sizes, moving, linked, largest, by_forces)
    rounding = NOISE * SUM_ROUNDOFF * np.fmax(largest, by_forces)
    parted = ""
    if run.outcome.complete and repeated.outcome.complete and not same_end:
        parted = (
            f"it ended with `{run.outcome.word}` at t = {run.end:.9g}, and a repeat by "
            f"{plan.method} with `{repeated.outcome.word}` at t = {repeated.end:.9g}"
        )
    return ErrorBar(
        method=plan.method,
        rtol=plan.rtol,
        names=names,
        times=rows[:, 0],
        errors=errors,
        scales=scales,
        still=still,
        rates=every[:, 1 + n : 1 + 2 * n],
        repeated=repeats,
        parted=parted,
        rests=bool(np.all(sizes <= rounding)),
    )


def _largest(values: Floats) -> Floats:
    """Return, for each row, the largest |value| up to that row, shape (k, n).

    values : (k, n).
    """
    return np.asarray(np.maximum.accumulate(np.abs(values), axis=0))
