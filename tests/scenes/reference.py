"""The reference problems as model files, and what they should give."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from tests.support import DATA

PROBLEMS: dict[str, dict[str, Any]] = {
    p["id"]: p for p in json.loads((DATA / "problems.json").read_text())["problems"]
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


def states(name: str) -> list[State]:
    """Give the reference states of a problem, in order of time."""
    found = []
    for r in PROBLEMS[name]["reference"]:
        floats = {k: float(x) for k, x in r["q"].items()}
        rates = {k: float(x) for k, x in r["qdot"].items()}
        lam = tuple(map(float, r["lambda"])) if "lambda" in r else None
        a = {k: float(x) for k, x in r["qddot"].items()} if "qddot" in r else None
        found.append(State(float(r["t_value"]), floats, rates, lam, a))
    return sorted(found, key=lambda s: s.t)


def model_text(name: str, end: str | None = None) -> str:
    """Give the YAML of a problem.

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
