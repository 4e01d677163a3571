"""The reference problems as model files, and their expected results."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.support import DATA
from tests.sympy_oracle import Oracle

PROBLEMS: dict[str, dict[str, Any]] = {
    p["id"]: p for p in json.loads((DATA / "problems.json").read_text())["problems"]
}
# By how much an error of the start has grown at each reference time, in order: nudges
# of 1e-7 and 1e-10 of its largest position and velocity, six at random, brought onto
# the constraints and integrated by scipy's DOP853 at 1e-12 from equations that sympy
# derives; the largest deviation over that of the whole motion, to a factor of 1.5. Past
# 1e9 nudges have grown to the size of the motion. Published for the double pendulum:
# 0.8 digits lost in a second.
CONDITIONS = {
    "andrews": (8.0,),
    "caraxis": (22.0,),
    "pendulum_iftomm_a01": (8.8,),
    "bricard": (1.4, 3.7, 8.1),
    "double_pendulum": (1.5, 2.1, 600.0, 9.5e7, 1.3e10, 1.4e10),
    "double_pendulum_cartesian": (3.1, 3.3, 1300.0, 1.2e8, 1.3e10, 1.9e10),
    "kepler_e09": (7900.0,),
    "kepler_e06_100orbits": (2.6e4,),
    "rolling_disk_steady": (140.0,),
    "chaplygin_sleigh": (3.5,),
    "bead_rotating_hoop": (3.1,),
    "bead_rotating_hoop_cartesian": (18.0,),
    "chain10_cartesian": (5.2, 5.2, 9.4),
    "appell_hamel": (1.0,),
    "huygens_cycloid": (1.0,),
    "pendulum_duplicate_constraints": (8.8,),
}
TWO_SIDED = [name for name, p in PROBLEMS.items() if not p["unilateral"]]


@dataclass(frozen=True)
class State:
    """Positions and velocities at a time."""

    t: float
    q: dict[str, float]
    v: dict[str, float]
    lam: tuple[float, ...] | None = None
    a: dict[str, float] | None = None


def states(name):
    """Return the reference states of a problem, in order of time."""
    found = []
    for r in PROBLEMS[name]["reference"]:
        floats = {k: float(x) for k, x in r["q"].items()}
        rates = {k: float(x) for k, x in r["qdot"].items()}
        lam = tuple(map(float, r["lambda"])) if "lambda" in r else None
        a = {k: float(x) for k, x in r["qddot"].items()} if "qddot" in r else None
        found.append(State(float(r["t_value"]), floats, rates, lam, a))
    return sorted(found, key=lambda s: s.t)


def model_text(name, end=None):
    """Return the YAML of a problem.

    Rows are spaced by the first reference time, of which the others are multiples.
    """
    p = PROBLEMS[name]
    first = min(p["reference"], key=lambda r: float(r["t_value"]))["t"]
    lines = ["parameters:"]
    lines += [f'  {k}: "{v}"' for k, v in p["parameters"].items()]
    lines += ["coordinates:", *(f"  {q}: {{}}" for q in p["coordinates"])]
    lines += ["energy:", f'  kinetic: "{p["T"]}"', f'  potential: "{p["V"]}"']
    if p["Q"]:
        lines += ["forces:", *(f'  {k}: "{v}"' for k, v in p["Q"].items())]
    relations = [*p["holonomic"], *p["nonholonomic"]]
    laws = [f'"{g} = 0"' for g in relations]
    laws += [
        f'{{relation: "{c["g"]} <= 0", restitution: {c["e"]}}}' for c in p["unilateral"]
    ]
    if laws:
        lines.append("constraints:")
        lines += [f"  c{k}: {law}" for k, law in enumerate(laws, 1)]
    lines.append("initial:")
    for q in p["coordinates"]:
        lines.append(f'  {q}: "{p["q0"][q]}"')
        lines.append(f'  {q}_dot: "{p["qdot0"][q]}"')
    lines += ["simulation:", f'  start: "{p["t0"]}"']
    lines += [f'  end: "{end or p["t_end"]}"', f'  output_step: "{first}"']
    return "\n".join(lines) + "\n"


@functools.cache
def oracle_of(name):
    return Oracle(model_text(name))


def accelerations(name, reference):
    """Return q'', lambda (of least norm) and A^T lambda at a state, by sympy."""
    oracle = oracle_of(name)
    values: dict[str, Any] = {"t": reference["t_value"], **oracle.nominal()}
    values |= reference["q"]
    values |= {f"{q}_dot": x for q, x in reference["qdot"].items()}
    x = oracle.exactly(values)
    n, m = len(oracle.q), len(oracle.constraints)
    M, f, A, b = (np.array(part, dtype=float) for part in (x.M, x.f, x.A, x.b))
    A = A.reshape(m, n)
    K = np.block([[M, -A.T], [A, np.zeros((m, m))]])
    # Of least norm: rows may depend on each other.
    size = np.max(np.abs(K), axis=1, initial=1e-300)
    right = np.concatenate([f, b]) / size
    solved = np.linalg.lstsq(K / size[:, None], right, rcond=1e-11)[0]
    return solved[:n], solved[n:], A.T @ solved[n:]
