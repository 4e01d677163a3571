"""What many tests need: running a model in this process and keeping its rows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.admissibility import Examination, Start, examine
from lagsim.mechanics.equations import Equations, derive
from lagsim.model.reader import read, read_file
from lagsim.plan import Plan, make_plan
from lagsim.run.simulate import simulate
from lagsim.run.system import System

if TYPE_CHECKING:
    from lagsim.model.settings import Settings
    from lagsim.run.trajectory import Trajectory

ROOT = Path(__file__).parent.parent
MODELS = ROOT / "models"
DATA = Path(__file__).parent / "data"


class Keep:
    """A consumer that keeps all rows."""

    def __init__(self) -> None:
        self.blocks: list[Any] = []

    def add(self, rows: Any) -> None:
        self.blocks.append(rows.copy())


@dataclass(frozen=True)
class Run:
    """A finished run; `run["theta"]` is a column."""

    equations: Equations
    examined: Examination
    settings: Settings
    plan: Plan
    system: System
    trajectory: Trajectory
    rows: Any

    def __getitem__(self, name: str) -> Any:
        return self.rows[:, self.system.columns.names.index(name)]

    @property
    def start(self) -> Start:
        """What it began with."""
        return self.examined.start

    @property
    def drift(self) -> float:
        """Greatest |energy - work - first value|."""
        names = self.system.columns.names
        balance = self["energy"] - (self["work"] if "work" in names else 0.0)
        return float(np.max(np.abs(balance - balance[0])))


def run(model: Any, *, loops: bool = False, **keywords: Any) -> Run:
    """Run a Model, the text of one, or the name of a shipped one.

    `loops` insists on the dense solve; other keywords are those of `simulate`, or
    options of `simulation` such as rtol="1e-12".
    """
    passed = {"interrupt", "progress", "most_steps"}
    options = {k: str(v) for k, v in keywords.items() if k not in passed}
    rest = {k: v for k, v in keywords.items() if k in passed}
    if isinstance(model, str):
        if "\n" in model:
            model = read(model, "model.yaml", options=options)
        else:
            model = read_file(str(MODELS / f"{model}.yaml"), options=options)
    equations = derive(model)
    settings = model.settings()
    examined = examine(equations, settings.start)
    assert examined.admissible, examined.verdicts
    start = examined.start
    plan = make_plan(equations, start, settings, loops=loops)
    system = System(equations, plan)
    keep = Keep()
    trajectory = simulate(equations, start, plan, system, settings, [keep], **rest)
    rows = np.concatenate(keep.blocks)
    return Run(equations, examined, settings, plan, system, trajectory, rows)
