"""What is to be measured on one scene: which solvers, at which settings."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods import names
from lagsim.studies.bench.scipy_solvers import NAMES as SCIPY
from lagsim.studies.bench.scipy_solvers import Scipy
from lagsim.studies.bench.scipy_solvers import refusal as scipy_refusal
from lagsim.studies.bench.solutions import index_one, state_sizes
from lagsim.studies.bench.solving import Own, asking, formulations

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lagsim.run.session import Case
    from lagsim.studies.bench.reference import Reference
    from lagsim.studies.bench.solving import Solver

TOLERANCES = (1e-3, 1e-13)
# Fixed steps begin at so many rows, and are halved this often at most.
LARGEST_STEP = 16
MOST_HALVINGS = 20
# Seconds for everything.
BUDGET = 180.0


@dataclass(frozen=True)
class Wish:
    """What is asked for.

    Attributes
    ----------
    methods
        Only these, ours or `scipy:NAME`; None for all.
    tolerances, steps
        Loosest and tightest; steps None for a choice from the scene.
    budget
        Seconds for everything.
    """

    methods: tuple[str, ...] | None = None
    tolerances: tuple[float, float] = TOLERANCES
    steps: tuple[float, float] | None = None
    budget: float = BUDGET

    def wants(self, name: str) -> bool:
        """Tell whether a method is asked for."""
        return self.methods is None or name in self.methods


class Curve(NamedTuple):
    """A solver and the settings it is to be swept over."""

    solver: Solver
    values: list[float]

    @property
    def key(self) -> tuple[str, str]:
        """Method and formulation."""
        return self.solver.method, self.solver.formulation


class Refused(NamedTuple):
    """A method, in a formulation, that does not apply; `auto` stands for all."""

    method: str
    formulation: str
    reason: str


class Auto:
    """What `auto` takes at each tolerance."""

    def __init__(self, case: Case, tolerances: Sequence[float]) -> None:
        self.case = case
        self.tolerances = tolerances
        self.chosen: dict[tuple[str, str], dict[float, float]] = defaultdict(dict)
        for rtol in tolerances:
            plan = asking(case, rtol=rtol).plan()
            value = plan.rtol if plan.step is None else plan.step
            assert value is not None
            self.chosen[plan.method, plan.formulation][value] = rtol
        self._solvers: dict[tuple[str, str], Own] = {}

    def solver(self, curve: tuple[str, str], value: float) -> Own | None:
        """Give what `auto` makes of the scene, where that is this; None elsewhere."""
        rtol = self.chosen.get(curve, {}).get(value)
        if rtol is None:
            return None
        if curve not in self._solvers:
            self._solvers[curve] = Own(self.case, "auto", "auto", rtol)
        return self._solvers[curve]


def decades(between: tuple[float, float]) -> list[float]:
    """Give tolerances from the first to the second, both included, ten times apart.

    About ten times, where the ends are not powers of ten from each other.
    """
    first, last = (math.log10(x) for x in between)
    count = round(abs(last - first))
    return [float(f"{10**x:.6g}") for x in np.linspace(first, last, count + 1)]


def halvings(between: tuple[float, float]) -> list[float]:
    """Give steps from the first down to the second, each half the one before."""
    first, last = between
    count = max(0, math.floor(math.log2(first / last) + 1e-9))
    return [first / 2**k for k in range(count + 1)]


def curves_of(
    case: Case, wish: Wish, reference: Reference, auto: Auto, refused: list[Refused]
) -> Iterator[Curve]:
    """Give everything that applies; what does not goes to `refused`."""
    tolerances = decades(wish.tolerances)
    largest = LARGEST_STEP * case.settings.output_step
    largest = min(largest, case.settings.duration / 2)
    steps = halvings(wish.steps or (largest, largest / 2**MOST_HALVINGS))
    for name in names():
        if not wish.wants(name):
            continue
        solvers, reasons = formulations(case, name)
        refused += [Refused(name, *why) for why in reasons.items()]
        for own in solvers:
            values = tolerances if own.setting == "rtol" else steps
            more = auto.chosen.get((own.method, own.formulation), {})
            yield Curve(own, sorted({*values, *more}, reverse=True))
    wanted = [name for name in SCIPY if wish.wants(name)]
    if not wanted:
        return
    own = index_one(case)
    if refusal := scipy_refusal(own):
        refused += [Refused(name, "auto", refusal) for name in wanted]
        return
    rows = reference.rows
    sizes = state_sizes(own, rows)
    for name in wanted:
        yield Curve(Scipy(own, name, rows[:, 0], sizes), tolerances)
