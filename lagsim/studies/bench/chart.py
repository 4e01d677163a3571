"""work_precision.png: time and evaluations against the error they bought.

Drawn from work_precision.json alone, so that it can be drawn again.
"""

from __future__ import annotations

import itertools
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.outputs.sheet import EDGE, LINE, Sheet, in_house_style, wrapped
from lagsim.studies.bench.cost_panel import (
    BESIDE,
    CHOSEN,
    FLOOR,
    FRONT,
    WORST,
    Cost,
    cost_panel,
    error_scale,
    look_of,
    names_beside,
    room_beside,
    seen,
)
from lagsim.studies.bench.machine import stamp
from lagsim.studies.bench.shown import Key, Row, Shown, shown

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

# Inches: the sheet, its margins, the panels and what is between them; names beside.
WIDTH, TOP, HEIGHT, GAP, BELOW = 7.6, 0.62, 3.0, 0.42, 0.5
NAMES, BETWEEN = 2.7, 0.16


@in_house_style
def chart(document: Mapping[str, Any], form: str = "png") -> bytes:
    """Draw what work_precision.json says. Returns a PNG, SVG or PDF."""
    rows = document["rows"]
    found = shown(rows, WORST)
    by_cost = {of: _costs(found, of) for of in ("seconds", "evaluations")}
    beside = room_beside(by_cost["seconds"], NAMES)
    width = WIDTH - BESIDE - BETWEEN - beside - EDGE
    notes = wrapped(_notes(document, found), WIDTH - 2 * EDGE)
    under = TOP + 2 * HEIGHT + GAP + BELOW
    sheet = Sheet(WIDTH, under + LINE * len(notes) + 0.1, form)
    sheet.heading(document["model"]["name"], "what an error costs")
    floor = float(seen([document["reference"]["floor"]])[0])
    across = error_scale(by_cost["seconds"], floor)
    for k, (of, curves) in enumerate(by_cost.items()):
        place = (BESIDE, TOP + k * (HEIGHT + GAP), width, HEIGHT)
        front = _front(found, of)
        cost_panel(
            sheet, place, across, curves, of, floor=floor, below=k == 1, front=front
        )
    right = BESIDE + width + BETWEEN
    names_beside(sheet, right, TOP + 0.08, by_cost["seconds"], beside)
    named = [
        ("Pareto front", FRONT | {"linewidth": 4.0}),
        ("what `auto` takes", CHOSEN),
        ("the reference is known to this", FLOOR),
    ]
    sheet.legend(BESIDE, TOP - 0.1, named, WIDTH - BESIDE - EDGE)
    sheet.notes(under + 0.1, notes)
    return sheet.content()


def _costs(found: Shown, of: str) -> list[Cost]:
    keys = [*found.curves, *found.left_out]
    return [
        Cost(
            _name(key, keys),
            look_of(*key),
            seen(row["error"] for row in rows),
            seen(row[of] for row in rows),
            [row["chosen"] for row in rows],
        )
        for key, rows in found.curves.items()
    ]


def _front(found: Shown, of: str) -> tuple[Any, Any]:
    rows = itertools.chain.from_iterable(found.curves.values())
    front = sorted((r["error"], r[of]) for r in rows if r[f"front_{of}"])
    points = np.array(front, float).reshape(-1, 2)
    return seen(points[:, 0]), seen(points[:, 1])


def _name(key: Key, keys: Iterable[Key]) -> str:
    """Give a method's name, with its formulation where there are several."""
    method, formulation = key
    alone = sum(name == method for name, _ in keys) == 1
    return method if alone else f"{method} {formulation}"


def _notes(document: Mapping[str, Any], found: Shown) -> list[str]:
    lines = [f"Reference: {document['reference']['trust']}."]
    keys = {(row["method"], row["formulation"]): None for row in document["rows"]}
    gaps = _gaps(document["rows"], found, list(keys))
    if gaps:
        lines.append(f"No result: {'; '.join(gaps)}.")
    if found.left_out:
        said = ", ".join(
            f"{_name(key, keys)} ({_rounded(times)})"
            for key, times in found.left_out.items()
        )
        lines.append(f"Not drawn (time relative to the fastest): {said}.")
    others = {r["method"] for r in document["refused"] if r["formulation"] == "auto"}
    if others:
        lines.append(f"Not for this model: {', '.join(sorted(others))}.")
    lines.append(
        "Error: the greatest of any coordinate or velocity in any row. Seconds: the "
        "integration with all its rows and columns (scipy's without), warm, least of "
        f"several. {stamp(document)}."
    )
    return lines


def _rounded(times: float) -> str:
    return f"{float(f'{times:.2g}'):g}" if np.isfinite(times) else "no digits"


def _gaps(rows: Sequence[Row], found: Shown, keys: Sequence[Key]) -> list[str]:
    """Say which settings gave nothing, and why, those next to each other together.

    Of the curves that are shown, and of those that would have nothing to show.
    """
    said = []
    for key in keys:
        if key in found.left_out:
            continue
        entries = [r for r in rows if (r["method"], r["formulation"]) == key]
        for outcome, group in groupby(entries, _without_answer):
            if outcome is not None:
                missing = list(group)
                ends = (missing[0], missing[-1])
                values = dict.fromkeys(f"{e['value']:.3g}" for e in ends)
                where = f"{_name(key, keys)} at {missing[0]['setting']}"
                said.append(f"{where} {' to '.join(values)}: {outcome}")
    return said


def _without_answer(row: Row) -> str | None:
    return str(row["outcome"]) if row["error"] is None else None
