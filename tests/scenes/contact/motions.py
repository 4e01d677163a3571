"""Construction of scenes of contact, runs, and reading of their events."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

import lagsim
from tests.support import dumped

# Errors of whole runs reach a hundred times the tolerance of a step, 1e-11 by default.
GLOBAL = 1e-9
G = 9.81


def scene(
    coordinates,
    kinetic,
    potential,
    constraints,
    initial,
    *,
    parameters=None,
    forces=None,
    **simulation,
):
    """Write a model file; `coordinates` are names with spaces between.

    Gravity `g` is a parameter where a text has it.
    """
    texts = str([kinetic, potential, constraints, initial, parameters, forces])
    weight = {"g": G} if re.search(r"\bg\b", texts) else {}
    document: dict[str, Any] = {
        "parameters": weight | (parameters or {}),
        "coordinates": {q: {} for q in coordinates.split()},
        "energy": {"kinetic": kinetic, "potential": potential},
        "constraints": constraints,
        "initial": initial,
        "simulation": simulation,
    }
    if forces:
        document["forces"] = forces
    return dumped(document)


def contact(relation, restitution, **friction):
    return {"relation": relation, "restitution": restitution} | friction


@dataclass(frozen=True)
class Motion:
    """A run; `motion["x"]` is a column."""

    result: lagsim.Result

    def __getitem__(self, name):
        return self.result[name]

    @property
    def t(self):
        return self.result.t

    def times(self, kind, constraint=None):
        """Return the times of events of a kind, of one constraint or of any."""
        return [
            e.time
            for e in self.result.events
            if e.kind == kind and constraint in (None, e.constraint)
        ]

    def instants(self, kind):
        """Return the times of events of a kind, once where several are simultaneous."""
        return sorted(set(self.times(kind)))

    def shared(self):
        """Return a mask of the rows whose time equals that of the row before."""
        return np.concatenate(([False], np.diff(self.t) == 0.0))

    def pair(self, name, t):
        """Return a column before and after the impact at t."""
        rows = np.flatnonzero(np.abs(self.t - t) <= 1e-9 * max(1.0, abs(t)))
        assert len(rows) == 2, (t, self.t[rows])
        assert self.t[rows[0]] == self.t[rows[1]]
        return float(self[name][rows[0]]), float(self[name][rows[1]])

    def at(self, name, t):
        """Return a column at an output time; at an impact, the value after it."""
        row = np.flatnonzero(np.abs(self.t - t) <= 1e-9 * max(1.0, abs(t)))[-1]
        return float(self[name][row])


@functools.cache
def play(text, **options):
    """Run a scene to its end."""
    found = tried(text, **options)
    assert found.result.complete, found.result.reason
    return found


def tried(text, **options):
    """Run a scene; the run may end early."""
    model = lagsim.load(text)
    return Motion(lagsim.simulate(model, error_bar="never", **options))


def close(found, expected, within=GLOBAL):
    """Demand equality within a part of the largest expected, or of one if that is 0."""
    expected = np.asarray(expected, dtype=float)
    size = float(np.max(np.abs(expected), initial=0.0)) or 1.0
    np.testing.assert_allclose(found, expected, rtol=0, atol=within * size)
