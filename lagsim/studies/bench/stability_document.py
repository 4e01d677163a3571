"""stability.csv and stability.json."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.outputs.manifest import versions
from lagsim.outputs.table import table_of
from lagsim.studies.bench.trial import KICK, SEED
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.mechanics.equilibrium import Mode
    from lagsim.studies.bench.scope import Wish
    from lagsim.studies.bench.stability import Border, Rest, Stability
    from lagsim.studies.bench.trial import Cell, Subject

TABLE = "stability.csv"
MANIFEST = "stability.json"

MEASURED = ("verdict", "growth", "evaluations", "rejections", "smallest_step")


def table(cells: Iterable[Cell], name: str | None) -> bytes:
    """Give the content of stability.csv."""
    varied = [] if name is None else ["value"]
    shown = ["method", "step", *varied, *MEASURED, "duration"]
    rows = ([getattr(cell, key) for key in shown] for cell in cells)
    return table_of([name or key if key == "value" else key for key in shown], rows)


def document(found: Stability, wish: Wish, files: Sequence[str]) -> dict[str, Any]:
    """Give the content of stability.json; keys are only ever added."""
    subject = found.subject
    model = subject.equations.model
    return {
        "lagsim": __version__,
        "versions": versions(),
        "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
        "parameters": {p.name: p.value for p in model.parameters},
        "complete": not found.interrupted,
        "vary": None
        if wish.name is None
        else {"name": wish.name, "values": found.values},
        "steps": found.steps,
        "runs": {
            "steps": {m: {"least": a, "most": b} for m, (a, b) in found.runs.items()},
            "duration": subject.span,
            "perturbation": {
                "energy": KICK,
                "of": "the energy of the motion, put into the velocities so that every "
                "mode takes part",
                "seed": SEED,
            },
            "energy": subject.energy,
        },
        "borders": _borders(found, wish.name),
        "eigenvalues": _eigenvalues(subject),
        **_rest(found.rest, subject.equations.q),
        "refused": [refused._asdict() for refused in found.refused],
        "cells": [_entry(cell, wish.name) for cell in found.cells],
        "files": list(files),
    }


def _entry(cell: Cell, name: str | None) -> dict[str, Any]:
    row: dict[str, Any] = {"method": cell.method, "step": cell.step}
    if name is not None:
        row[name] = cell.value
    row |= {key: getattr(cell, key) for key in MEASURED}
    return row | {"duration": cell.duration, "reason": cell.reason}


def prediction(border: Border) -> float | None:
    """Give the smaller of the borders at the start and along the motion."""
    known = [x for x in (border.at_start, border.along) if x is not None]
    return min(known) if known else None


def _borders(found: Stability, name: str | None) -> dict[str, Any]:
    """Give them by method: one mapping, or a list over the parameter's values."""
    by_method: dict[str, Any] = {}
    for border in found.borders:
        entry: dict[str, Any] = {} if name is None else {name: border.value}
        entry |= {
            "found": None if border.found is None else float(f"{border.found:.4g}"),
            "predicted": prediction(border),
            "predicted_at_start": border.at_start,
            "predicted_along": border.along,
            "note": border.note,
        }
        if name is None:
            by_method[border.method] = entry
        else:
            by_method.setdefault(border.method, []).append(entry)
    return by_method


def _eigenvalues(subject: Subject) -> dict[str, Any]:
    def pairs(values: Any) -> list[list[float]]:
        return [[float(x.real), float(x.imag)] for x in values]

    return {
        "at_start": pairs(subject.at_start),
        "along": pairs(subject.along),
        "states": subject.states,
        "unknown": subject.unknown or None,
    }


def _rest(rest: Rest, names: Sequence[str]) -> dict[str, Any]:
    equilibrium: dict[str, Any] = {
        "coordinates": rest.at,
        "is_start": rest.is_start,
        "reason": rest.reason or None,
    }
    return {
        "equilibrium": rest.at,
        "equilibrium_is_start": equilibrium["is_start"],
        "equilibrium_reason": equilibrium["reason"],
        "modes": [_mode(mode, names) for mode in rest.modes],
    }


def _mode(mode: Mode, names: Sequence[str]) -> dict[str, Any]:
    return {
        "frequency": mode.frequency,
        "angular_frequency": mode.eigenvalue.imag,
        "period": mode.period,
        "damping_ratio": mode.damping_ratio + 0.0,
        "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
        "shape": dict(zip(names, map(float, mode.shape.real + 0.0), strict=True)),
        "shape_imaginary": dict(
            zip(names, map(float, mode.shape.imag + 0.0), strict=True)
        ),
    }


def fastest_period(subject: Subject) -> float | None:
    """Give the period of the fastest oscillation, at the start or along the motion."""
    for values in (subject.at_start, subject.along):
        fastest = float(np.max(np.abs(values.imag), initial=0.0))
        if fastest * subject.span > 1e-3:
            return 2.0 * math.pi / fastest
    return None
