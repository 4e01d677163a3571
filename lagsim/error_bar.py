"""The error of a run, estimated: what a repeat at a tighter tolerance gives instead.

A local error says little of the motion: the estimate is the difference of two whole
runs, so that it knows how errors grow on the way. The repeat is made by the same method
at a hundredth of the tolerance; a method without error control is repeated by DOP853.
At the level of rounding both runs err alike, and the difference is the size of either
error.

The repeat costs about twice the run. It is made while that stays within a number of
operations, never of seconds, so that a rerun gives the same result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.expressions.evaluate import evaluate
from lagsim.plan import make_plan
from lagsim.plan.integration import ANY
from lagsim.simulate import simulate
from lagsim.simulate.states import MOST_STEPS
from lagsim.system import System
from lagsim.trajectory import Outcome

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.admissibility import Start
    from lagsim.equations import Equations
    from lagsim.interrupt import Interrupt
    from lagsim.native.kernel_types import Floats
    from lagsim.plan import Plan
    from lagsim.trajectory import Trajectory

# How much tighter the repeat's tolerance is, and the least that means anything: below
# it a repeat is made more loosely instead, since an equal one would say nothing.
TIGHTER = 100.0
TIGHTEST = 1e-14
LOOSER = 10.0**-0.5
# That of the repeat of a method without error control.
FREE_RTOL = 1e-13
# Operations that a repeat may take without being asked for: about 2 s.
BUDGET = 2e9
# Evaluations and columns of a row cost about this much besides their operations.
OVERHEAD = 20
# Rows that are compared, at most.
MOST_ROWS = 4096
# Past the horizon the estimate exceeds this part of a coordinate's range.
LOST = 0.1
# The range of a coordinate counts as no less than this part of the whole motion, in the
# metric of the diagonal of M: one that should stay zero has no range to speak of.
STILL = 1e-6
# How many times the growth is told at.
TIMES = 20


@dataclass(frozen=True, slots=True)
class CoordinateError:
    """The estimated error of one coordinate, in its unit and as a part of its range."""

    largest: float
    relative: float
    time: float


@dataclass(frozen=True, slots=True)
class ErrorBar:
    """What a repeat says of a run.

    Attributes
    ----------
    method, rtol
        Of the repeat.
    names
        Of the coordinates.
    times : ndarray, shape (k,)
        Of the rows that were compared.
    errors : ndarray, shape (k, n)
        The estimates, in the units of the coordinates.
    scales : ndarray, shape (n,)
        The range of each coordinate, or what counts as one.
    """

    method: str
    rtol: float | None
    names: tuple[str, ...]
    times: Floats
    errors: Floats
    scales: Floats

    @property
    def parts(self) -> Floats:
        """The estimates as parts of the ranges (k, n)."""
        return np.divide(
            self.errors,
            self.scales,
            out=np.zeros_like(self.errors),
            where=self.scales > 0.0,
        )

    @property
    def coordinates(self) -> dict[str, CoordinateError]:
        """The largest error of each coordinate, and when."""
        worst = np.argmax(self.errors, axis=0)
        largest, parts = self.errors, self.parts
        return {
            name: CoordinateError(
                float(largest[k, i]), float(parts[k, i]), float(self.times[k])
            )
            for i, (name, k) in enumerate(zip(self.names, worst, strict=True))
        }

    @property
    def relative(self) -> float:
        """The largest part of a range that any error reaches."""
        return float(np.max(self.parts, initial=0.0))

    @property
    def growth(self) -> list[tuple[float, float]]:
        """Times, and the largest part of a range that any error has reached by then."""
        reached = np.maximum.accumulate(np.max(self.parts, axis=1))
        last = len(self.times) - 1
        told = sorted({-(-last * k // TIMES) for k in range(1, TIMES + 1)})
        return [(float(self.times[k]), float(reached[k])) for k in told]

    @property
    def horizon(self) -> float | None:
        """The first time at which an error exceeds the part LOST of its range."""
        lost = np.flatnonzero(np.max(self.parts, axis=1) > LOST)
        return float(self.times[lost[0]]) if len(lost) else None


class Checkpoints:
    """Keeps the coordinates of some rows, evenly spaced, and their ranges.

    Parameters
    ----------
    count : int
        Of the coordinates, the columns after the time.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._kept: list[Floats] = []
        self._seen = 0
        self.stride = 1
        self.low = np.full(count, np.inf)
        self.high = np.full(count, -np.inf)

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        q = rows[:, : 1 + self._count]
        self.low = np.fmin(self.low, np.min(q[:, 1:], axis=0))
        self.high = np.fmax(self.high, np.max(q[:, 1:], axis=0))
        first = -self._seen % self.stride
        self._kept += list(q[first :: self.stride].copy())
        self._seen += len(rows)
        while len(self._kept) > MOST_ROWS:
            self._kept = self._kept[::2]
            self.stride *= 2

    @property
    def rows(self) -> Floats:
        """Time and coordinates (k, 1 + n)."""
        return np.array(self._kept).reshape(-1, 1 + self._count)


def repeat(
    equations: Equations,
    start: Start,
    plan: Plan,
    system: System,
    trajectory: Trajectory,
    checkpoints: Checkpoints,
    *,
    always: bool = False,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
) -> ErrorBar | str:
    """Give the error bar of a run, or why there is none.

    Parameters
    ----------
    plan, system, trajectory, checkpoints
        Of the run.
    always
        Whatever it costs.
    progress
        Called with the fraction of the repeat that is done.
    """
    if len(checkpoints.rows) < 2:
        return "there are too few rows to compare"
    tighter = _tighter(equations, start, plan)
    cost = system.operations + OVERHEAD
    counts = trajectory.statistics
    expected = 2.0 * counts.evaluations * cost
    if expected > BUDGET and not always:
        return (
            f"a repeat would take about {expected:.1e} operations "
            "(--error-bar always makes it)"
        )
    if plan.rtol is None:
        system = System(equations, tighter)
    sparse = _thinned(equations, checkpoints.stride)
    again = Checkpoints(len(equations.model.coordinates))
    per_step = max(1.0, counts.evaluations / max(counts.steps, 1))
    repeated = simulate(
        sparse, start, tighter, system, [again], interrupt=interrupt,
        progress=progress,
        most_steps=MOST_STEPS if always else int(BUDGET / (cost * per_step)),
    )  # fmt: skip
    if repeated.outcome is Outcome.INTERRUPTED:
        return "the repeat was interrupted"
    if repeated.end < trajectory.end - 1e-6 * (trajectory.end - trajectory.start):
        return f"a repeat at a tighter tolerance did not finish: {repeated.reason}"
    rows, others = _same_times(checkpoints.rows, again.rows)
    return ErrorBar(
        method=tighter.method,
        rtol=tighter.rtol,
        names=equations.q,
        times=rows[:, 0],
        errors=np.abs(others[:, 1:] - rows[:, 1:]),
        scales=_scales(equations, start, checkpoints),
    )


def _tighter(equations: Equations, start: Start, plan: Plan) -> Plan:
    if plan.rtol is None:
        simulation = equations.model.simulation
        assert simulation is not None
        free = replace(
            simulation, method=ANY, formulation="auto", rtol=FREE_RTOL, atol=None
        )
        model = replace(equations.model, simulation=free)
        return make_plan(replace(equations, model=model), start)
    factor = TIGHTER if plan.rtol / TIGHTER >= TIGHTEST else LOOSER
    atol = None if plan.atol is None else plan.atol / factor
    return replace(plan, rtol=plan.rtol / factor, atol=atol)


def _thinned(equations: Equations, stride: int) -> Equations:
    """Give the equations with rows `stride` times farther apart."""
    simulation = equations.model.simulation
    assert simulation is not None
    sparse = replace(simulation, output_step=stride * simulation.output_step)
    return replace(equations, model=replace(equations.model, simulation=sparse))


def _scales(equations: Equations, start: Start, checkpoints: Checkpoints) -> Floats:
    """Give the range of each coordinate, or what counts as one."""
    ranges = checkpoints.high - checkpoints.low
    values = {p.name: p.value for p in equations.model.parameters} | {"t": start.t}
    values |= dict(zip(equations.q, start.q, strict=True))
    values |= dict(zip(equations.velocities, start.v, strict=True))
    diagonal = [equations.M[i][i] for i in range(len(ranges))]
    masses = np.fmax(evaluate(equations.graph, diagonal, values), 0.0)
    whole = np.sqrt(np.sum(masses * ranges**2))
    inert = masses > 0.0
    still = np.zeros_like(ranges)
    still[inert] = STILL * whole / np.sqrt(masses[inert])
    return np.asarray(np.fmax(ranges, still))


def _same_times(rows: Floats, again: Floats) -> tuple[Floats, Floats]:
    """Give the rows of both that have the same times."""
    near = 0.25 * float(np.min(np.diff(rows[:, 0])[:-1], initial=np.inf))
    at = np.searchsorted(again[:, 0], rows[:, 0] - near)
    at = np.minimum(at, len(again) - 1)
    same = np.abs(again[at, 0] - rows[:, 0]) < near
    return rows[same], again[at[same]]
