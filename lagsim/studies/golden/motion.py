"""A model's motion at chosen rows, and its variants, which measure its bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.errors import InputError
from lagsim.methods import method as method_named
from lagsim.model.settings import DEFAULT_RTOL
from lagsim.plan import make_plan
from lagsim.run.simulate import simulate
from lagsim.run.system import System

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.admissibility import Start
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.model.settings import Settings
    from lagsim.plan import Plan
    from lagsim.run.trajectory import Trajectory

# Rows are kept at every so-many-th, and these are the most that are kept.
MOST_ROWS = 200
LEAST_ROWS = 40
MOST_CELLS = 2400

# Of the variants: what the tolerance is multiplied by, how often the start and the
# parameters are perturbed, and the methods that are tried besides.
LOOSER, TIGHTER = 100.0, 0.1
# No tolerance below this means anything (see `error_bar`).
TIGHTEST = 1e-14
SEEDS = 4
METHODS = ("dop853", "taylor", "radau")


@dataclass(frozen=True, slots=True)
class Motion:
    """Rows of a run, one of each `stride`, with the first and the last.

    Attributes
    ----------
    columns : tuple of str
    rows : ndarray, shape (k, columns)
    scales : ndarray
        The largest scale of each residual, by its column; nan for other columns.
    """

    columns: tuple[str, ...]
    rows: Floats
    scales: dict[str, float]
    trajectory: Trajectory
    plan: Plan

    def at(self, times: Floats, near: float, *, ends: bool) -> Floats:
        """Give the rows (k, columns) at some times; nan where there is none.

        Parameters
        ----------
        near
            Between times that are the same.
        ends
            The last of the times is an end, and goes with the end of this motion: where
            an event ends a run, its time is a result.
        """
        found = np.full((len(times), len(self.columns)), np.nan)
        t = self.rows[:, 0]
        place = np.minimum(np.searchsorted(t, times - near), len(t) - 1)
        same = np.abs(t[place] - times) <= near
        found[same] = self.rows[place[same]]
        if ends and len(times) and not same[-1]:
            found[-1] = self.rows[-1]
        return found


class Few:
    """A consumer that keeps one row of each `stride`, and the last."""

    def __init__(self, stride: int) -> None:
        self._stride = stride
        self._seen = 0
        self._kept: list[Floats] = []
        self._last: Floats | None = None
        self.largest: Floats | None = None

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        first = -self._seen % self._stride
        self._kept.append(rows[first :: self._stride].copy())
        self._seen += len(rows)
        self._last = rows[-1:].copy()
        largest = np.max(np.abs(rows), axis=0)
        self.largest = (
            largest if self.largest is None else np.maximum(largest, self.largest)
        )

    def rows(self) -> Floats:
        """Give them."""
        kept = np.concatenate(self._kept)
        assert self._last is not None
        return (
            kept if kept[-1, 0] == self._last[0, 0] else np.append(kept, self._last, 0)
        )


@dataclass(frozen=True, slots=True)
class Scene:
    """A model with an admissible start."""

    equations: Equations
    start: Start
    settings: Settings

    def asking(self, **other: Any) -> Scene:
        """Give the scene with other settings."""
        return replace(self, settings=replace(self.settings, **other))

    def perturbed(self, seed: int) -> Scene:
        """Give the scene with start and parameters moved by one unit in the last place.

        What is zero stays, since its neighbours are no rounding errors.
        """
        random = np.random.default_rng(seed)

        def moved(x: Floats) -> Floats:
            other = np.nextafter(
                x, np.where(random.random(x.shape) < 0.5, -1, 1) * np.inf
            )
            return np.where(x == 0.0, 0.0, other)

        model = self.equations.model
        values = moved(np.array([p.value for p in model.parameters]))
        parameters = tuple(
            replace(p, value=float(v))
            for p, v in zip(model.parameters, values, strict=True)
        )
        model = replace(model, parameters=parameters)
        start = replace(self.start, q=moved(self.start.q), v=moved(self.start.v))
        return replace(self, equations=self.equations.of(model), start=start)

    def motion(self, stride: int) -> Motion:
        """Run it.

        Raises
        ------
        InputError
            Where the method cannot handle the scene.
        """
        plan = make_plan(self.equations, self.start, self.settings)
        system = System(self.equations, plan)
        few = Few(stride)
        trajectory = simulate(
            self.equations, self.start, plan, system, self.settings, [few]
        )
        names = system.columns.names
        assert few.largest is not None
        scales = {
            "residual_" + name.removeprefix("scale."): float(few.largest[k])
            for k, name in enumerate(names)
            if name.startswith("scale.")
        }
        table = system.columns.table
        return Motion(names[:table], few.rows()[:, :table], scales, trajectory, plan)


def variants(scene: Scene, base: Motion, stride: int) -> Iterator[tuple[str, Motion]]:
    """Give runs that differ from the golden one as far as one may, with their kinds.

    The kinds are `looser`, `tighter`, `perturbed` and `method`. One that does not come
    to the end is left out.
    """
    for kind, other in _asked(scene, base.plan):
        try:
            motion = other.motion(stride)
        except InputError:
            continue
        if motion.trajectory.outcome is base.trajectory.outcome:
            yield kind, motion


def _asked(scene: Scene, plan: Plan) -> Iterator[tuple[str, Scene]]:
    name = plan.method
    if method_named(name).ADAPTIVE:
        assert plan.rtol is not None
        for kind, factor in (("looser", LOOSER), ("tighter", TIGHTER)):
            rtol = max(plan.rtol * factor, TIGHTEST)
            atol = None if plan.atol is None else plan.atol * factor
            yield kind, scene.asking(method=name, rtol=rtol, atol=atol)
    else:
        assert plan.step is not None
        # An error of order p becomes 2^p times larger, one of order 4 16 times.
        yield "looser", scene.asking(method=name, step=2.0 * plan.step)
        yield "tighter", scene.asking(method=name, step=0.5 * plan.step)
        # Some are exact at any step: what a method with a tolerance may err by.
        rtol = LOOSER * DEFAULT_RTOL
        yield "looser", scene.asking(method=METHODS[0], rtol=rtol, atol=None)
    for seed in range(SEEDS):
        yield "perturbed", scene.perturbed(seed)
    for other in METHODS:
        if other != name:
            yield "method", scene.asking(method=other, formulation="auto")
