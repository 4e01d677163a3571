"""Runs of models in this process with their rows, for many tests."""

from __future__ import annotations

import contextlib
import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml

import lagsim
from lagsim.model.reader import read, read_file
from lagsim.plan.plan import by_loops
from lagsim.run.observers import Keep
from lagsim.run.session import Session, open_case

if TYPE_CHECKING:
    from lagsim.run.trajectory import Trajectory

ROOT = Path(__file__).parent.parent
MODELS = ROOT / "models"
DATA = Path(__file__).parent / "data"
LIMITS = {"most_steps", "arc_steps", "longest_step"}
HEARD = {"interrupt", "progress"}


@contextlib.contextmanager
def refused(code, *names, kind=lagsim.LagsimError):
    """Expect an error with a code, whose message and hint have these names and numbers.

    The wording is free. Yield pytest's record of the error.
    """
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    found = [p for p in getattr(error, "problems", ()) if p.code == code]
    assert found or error.code == code, repr(error)
    text = "\n".join(map(str, found)) or str(error)
    assert all(name in text for name in names), text


def simulate(model, **options):
    """Simulate a model without the repeat by which a run's error is estimated."""
    return lagsim.simulate(model, **{"error_bar": "never"} | options)


@dataclass(frozen=True)
class Run:
    """A finished run; `run["theta"]` is a column."""

    session: Session
    trajectory: Trajectory
    rows: Any

    def __getitem__(self, name):
        return self.rows[:, self.system.columns.names.index(name)]

    @property
    def equations(self):
        return self.session.case.equations

    @property
    def start(self):
        """Start of the run."""
        return self.session.case.start

    @property
    def plan(self):
        return self.session.plan

    @property
    def system(self):
        return self.session.system

    @property
    def drift(self):
        """Greatest |energy - work - first value|."""
        names = self.system.columns.names
        balance = self["energy"] - (self["work"] if "work" in names else 0.0)
        return float(np.max(np.abs(balance - balance[0])))


def at_outputs(t, start, step):
    """Return the rows (k,) at output times, not those of impacts between them.

    Of two rows at one time the second, after the impact.
    """
    steps = (t - start) / step
    near = np.abs(steps - np.round(steps)) <= 1e-6
    near[-1] = True
    later = np.append(t[1:] > t[:-1], True)
    return np.flatnonzero(near & later)


SHIPPED = sorted(path.stem for path in MODELS.glob("*.yaml"))


@functools.cache
def shipped(name):
    """Read a shipped model, once."""
    return read_file(str(MODELS / f"{name}.yaml"))


@functools.cache
def constraints_of(name):
    """Return the text of the constraints of a shipped model, without its comments.

    Cases are chosen by this text: to read all models takes two seconds in each process.
    """
    text = (MODELS / f"{name}.yaml").read_text("utf-8")
    found = re.search(r"(?ms)^constraints:.*?(?=^[^\s#]|\Z)", text)
    return re.sub("#.*", "", found[0]) if found else ""


def has_laws(name):
    """Return whether a shipped model has constraints that hold at times."""
    return bool(re.search(r"[<>]=|\b(when|limit):", constraints_of(name)))


def dumped(document):
    """Return a document as YAML; libyaml takes a tenth of the time of Python."""
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return yaml.dump(document, Dumper=dumper, sort_keys=False, width=10**6)


def case_of(model, **options):
    """Open a Model, the text of one, or the name of a shipped one."""
    options = {k: str(v) for k, v in options.items()}
    if isinstance(model, str):
        if "\n" in model:
            model = read(model, "model.yaml", options=options)
        else:
            model = read_file(str(MODELS / f"{model}.yaml"), options=options)
    return open_case(model)


def ready(model, *, loops=False, **options):
    """Plan and compile the argument of `case_of`; `loops` selects the dense solver."""
    case = case_of(model, **options)
    return case.ready(by_loops(case.plan()) if loops else None)


def run(model, *, loops=False, **keywords):
    """Run the argument of `ready`.

    Other keywords are those of `Session`, or of its run, or options of `simulation`
    such as rtol="1e-12".
    """
    limits = {k: keywords.pop(k) for k in LIMITS & keywords.keys()}
    heard = {k: keywords.pop(k) for k in HEARD & keywords.keys()}
    session = ready(model, loops=loops, **keywords)._replace(**limits)
    keep = Keep()
    trajectory = session.run([keep], **heard)
    return Run(session, trajectory, keep.table)
