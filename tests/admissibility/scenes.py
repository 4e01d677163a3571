"""Scenes as text, and the results of the examination of their starts."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING, Any

import pytest

from lagsim.admissibility.examination import examine
from lagsim.mechanics.reduction import equations_of_motion
from lagsim.model.reader import read

if TYPE_CHECKING:
    from lagsim.admissibility.examination import StartReport


def judged(
    text: str, *, classify: bool = False, file: str = "model.yaml"
) -> StartReport:
    """Examine the start of a model's text; `file` has its tables beside it."""
    return examine(equations_of_motion(read(text, file)), classify=classify)


def scene(
    relations: dict[str, str] | str,
    initial: dict[str, Any],
    *,
    kinetic: str = "",
    potential: str = "0",
    parameters: str = "",
    definitions: str = "",
    more: str = "",
) -> str:
    """Return a model whose coordinates are the plain names in `initial`.

    Without `kinetic` each has mass 1. A single relation is called `a`.
    """
    if isinstance(relations, str):
        relations = {"a": relations}
    names = set()
    if definitions:
        names = {line.split(":")[0].strip() for line in definitions.splitlines()}
    coordinates = [q for q in initial if not q.endswith("_dot") and q not in names]
    kinetic = kinetic or " + ".join(f"{q}_dot^2/2" for q in coordinates)
    lines = []
    if parameters:
        lines.append(f"parameters: {{{parameters}}}")
    lines.append(f"coordinates: {{{', '.join(f'{q}: ' for q in coordinates)}}}")
    if definitions:
        lines += ["definitions:", *(f"  {x}" for x in definitions.splitlines())]
    lines.append(f'energy: {{kinetic: "{kinetic}", potential: "{potential}"}}')
    if relations:
        lines.append("constraints:")
        lines += [f'  {name}: "{relation}"' for name, relation in relations.items()]
    lines += ["initial:", *(f"  {name}: {value}" for name, value in initial.items())]
    return "\n".join([*lines, more or "simulation: {duration: 1}"]) + "\n"


def codes(start: StartReport) -> list[str]:
    """Return the codes of the warnings."""
    return [w.code for w in start.warnings]


def warning(start: StartReport, code: str) -> str:
    """Return the text of the only warning of this code."""
    [text] = [w.text for w in start.warnings if w.code == code]
    return text


PARALLELOGRAM = {
    "p1": "x - cos(c)/2 = cos(a)",
    "p2": "y - sin(c)/2 = sin(a)",
    "p3": "x + cos(c)/2 = 1 + cos(b)",
    "p4": "y + sin(c)/2 = sin(b)",
}


# What is asked of a report beside its attributes.
ASKED = {
    "codes": codes,
    "redundant": lambda start: [v.name for v in start.verdicts if v.redundant],
    "everywhere": lambda start: [d.everywhere for d in start.ranks.dependences],
    "rows": lambda start: {
        d.name: dict(d.combination) for d in start.ranks.dependences
    },
    "texts": lambda start: [str(d) for d in start.ranks.dependences],
    "against": lambda start: {d.name: d.contradictions for d in start.contradictions},
    "ranks": lambda start: (start.ranks.rank, start.ranks.generic_rank),
    "thin": lambda start: start.thin and start.thin.names,
}


def check(start: StartReport, **expected: Any) -> None:
    """Compare a report with expected values: texts as parts, numbers to rounding."""
    for key, value in expected.items():
        found = ASKED.get(key, attrgetter(key.replace("__", ".")))(start)
        if isinstance(value, str):
            assert value in found, key
        elif isinstance(value, dict):
            assert found.keys() == value.keys(), key
            for name, part in value.items():
                assert found[name] == pytest.approx(part, rel=1e-9), key
        else:
            assert found == value, key
