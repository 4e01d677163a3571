"""work_precision.png: time and evaluations against the error they bought.

Drawn from work_precision.json alone, so that it can be drawn again. At most a dozen
curves are shown, those that matter, cheapest first.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import math
from itertools import groupby
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from lagsim.methods import names
from lagsim.outputs.curves import LOST, curve, point
from lagsim.outputs.figure import (
    DIM,
    PENS,
    SAMPLE,
    SMALL,
    Pen,
    Picture,
    content,
    fitted,
    in_house_style,
    mark,
)
from lagsim.outputs.scale import Scale, log_scale
from lagsim.studies.bench.solving import DRIFT, PREFIX, SCIPY, stamp
from lagsim.studies.bench.work_precision import COSTS, Key, Row, curves

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from matplotlib.axes import Axes

    from lagsim.run.observers.thinning import Array

MOST = 12
# Of them at most so many of scipy's, where there are others.
OF_SCIPY = 2
# A point that is further off than this costs what it does for no digits.
AN_ANSWER = 0.1


class Shown(NamedTuple):
    """Curves by method and formulation; of those left out, how many times costlier."""

    curves: dict[Key, list[Row]]
    left_out: dict[Key, float]


def shown(rows: Sequence[Row], worst: float) -> Shown:
    """Choose among the rows of work_precision.json that have an error up to `worst`.

    First come the curves that `auto` takes, then those on the front, then of each
    method the formulation that comes closest to it, two of scipy's among them, then
    other formulations; of them first those that stay on the constraints. They are given
    cheapest first.
    """
    found = curves(r for r in rows if r["error"] is not None and r["error"] <= worst)
    times = {key: _times(entries, rows) for key, entries in found.items()}
    ranked = sorted(times, key=lambda key: times[key])
    held = sorted(ranked, key=lambda key: key[1] == DRIFT)
    best = [key for key in ranked if any(row["chosen"] for row in found[key])]
    best += [key for key in held if any(row["front_seconds"] for row in found[key])]
    known, others = {method for method, _ in best}, []
    for key in held:
        if key[0] not in known:
            known.add(key[0])
            others.append(key)
    scipy = [key for key in others if key[0].startswith(PREFIX)]
    own = [key for key in others if key not in scipy]
    later = [key for key in held if key not in scipy]
    order = dict.fromkeys([*best, *scipy[:OF_SCIPY], *own, *later, *scipy])
    taken = list(order)[:MOST]
    return Shown(
        {key: found[key] for key in ranked if key in taken},
        {key: times[key] for key in ranked if key not in taken},
    )


def _times(entries: Sequence[Row], rows: Sequence[Row]) -> float:
    """Return how many times a curve costs what the front does, on the average."""
    front = [(row["error"], row["seconds"]) for row in rows if row["front_seconds"]]
    found = []
    for row in entries:
        beside = [cost for error, cost in front if error <= row["error"]]
        if beside and row["error"] <= AN_ANSWER:
            found.append(math.log(row["seconds"] / min(beside)))
    return math.exp(sum(found) / len(found)) if found else math.inf


# An error above this is no answer; one below that is 0.
WORST, LEAST = 3.0, 1e-18

CHOSEN = mark("o", 8.0, fill="none")
FRONT: Pen = {"color": "#F0E442", "linewidth": 6.0}
FLOOR: Pen = {"color": "#888888", "dashes": (3.0, 2.0), "linewidth": 0.8}

# Colour and dashes say the method: in each round of colours they meet others. The mark
# says the round, a row, and the formulation, a column.
MARKERS = (("o", "D", "P", "<"), ("s", "^", "X", ">"), ("v", "p", "h", "*"))
SHIFT = 2
FORMULATIONS = {"ignorable": 1, "elimination": 1, "baumgarte": 2, "drift": 3}
SCIPY_MARKERS = ("x", "+", "1", "2", "3")
GREY = "#777777"

ERROR = "← more accurate      error against range"
# Inches: a panel with its scales, what is below all of them, names beside.
HEIGHT, REST, NAMES = 3.3, 0.3, 2.4


class Look(NamedTuple):
    """The line of a curve, and the mark of its points."""

    line: Pen
    mark: Pen

    @property
    def sample(self) -> Pen:
        """Both, as a legend shows them."""
        return self.mark | {"linestyle": "-", "markevery": [1]} | self.line


class Cost(NamedTuple):
    """A curve: errors, what they cost, and which of its points have a ring."""

    name: str
    look: Look
    errors: Array
    costs: Array
    ringed: Sequence[bool] = ()


def look_of(method: str, formulation: str = "none") -> Look:
    """Give how a method looks: the same in every chart, and no two alike."""
    if method in SCIPY:
        line: Pen = {"color": GREY, "linewidth": 0.7}
        return Look(line, mark(SCIPY_MARKERS[SCIPY.index(method)], 4.5, GREY))
    turn, colour = divmod(names().index(method), len(PENS))
    return look(colour, turn, FORMULATIONS.get(formulation, 0))


def look(colour: int, turn: int = 0, kind: int = 0) -> Look:
    """Give the look of a colour of the house, in a round, of a kind."""
    pen = PENS[(colour + SHIFT * turn) % len(PENS)] | {"color": PENS[colour]["color"]}
    return Look(pen, mark(MARKERS[turn][kind], 3.6, pen["color"]))


def seen(errors: Iterable[float]) -> Array:
    """Give errors as they are drawn: none is 0 on logarithms."""
    return np.fromiter((max(error, LEAST) for error in errors), float)


def error_scale(costs: Sequence[Cost], floor: float) -> Scale:
    """Give the scale that holds all errors, and at the left what cannot be resolved."""
    known = np.concatenate([*(c.errors for c in costs), seen([floor]), [0.1]])
    return Scale(0.4 * float(min(known)), 2.0 * float(max(known)), log=True)


def cost_panel(
    axes: Axes,
    across: Scale,
    costs: Sequence[Cost],
    of: str,
    *,
    floor: float,
    front: tuple[Array, Array] | None = None,
) -> None:
    """Draw curves of cost against error; errors below `floor` are not known."""
    known = [c.costs for c in costs if len(c.costs)]
    across.put(axes, "x", 9)
    log_scale(*known, margin=0.05, least=0.08).put(axes, "y", 7)
    axes.grid(visible=True)
    axes.set_ylabel(f"← faster      {of}")
    if floor > across.low:
        axes.axvspan(across.low, floor, facecolor=LOST, alpha=0.45, zorder=0.2)
        axes.axvline(floor, **FLOOR)
    if front is not None:
        curve(axes, *front, FRONT)
    for c in costs:
        curve(axes, c.errors, c.costs, c.look.line)
        for x, y in zip(c.errors, c.costs, strict=True):
            if across.low <= x <= across.high:
                point(axes, x, y, c.look.mark)
        for x, y, ringed in zip(c.errors, c.costs, c.ringed, strict=False):
            if ringed:
                point(axes, x, y, CHOSEN)
    # Numbers keep away from the corner where both axes begin.
    axes.annotate(
        "↙ better", (0.0, 0.0), (-15.0, -12.0), "axes fraction", "offset points",
        size=SMALL, weight="bold", color=DIM, ha="right",
    )  # fmt: skip


@in_house_style
def chart(document: Mapping[str, Any], form: str = "png") -> bytes:
    """Draw what work_precision.json says. Returns a PNG, SVG or PDF."""
    return content(figure(document), form)


@in_house_style
def figure(document: Mapping[str, Any]) -> Picture:
    """Draw seconds and evaluations against the error that they bought."""
    found = shown(document["rows"], WORST)
    legend = [
        ("Pareto front", FRONT | {"linewidth": 4.0}),
        ("what `auto` takes", CHOSEN),
        ("the reference is known to this", FLOOR),
    ]
    drawing = Picture(
        2 * HEIGHT + REST, document["model"]["name"], "what an error costs",
        legend=legend, notes=_notes(document, found), layout="constrained",
    )  # fmt: skip
    panels = drawing.subplots(2)
    floor = float(seen([document["reference"]["floor"]])[0])
    across = error_scale(_costs(found, COSTS[0]), floor)
    for axes, of in zip(panels, COSTS, strict=True):
        rows = [r for own in found.curves.values() for r in own if r[f"front_{of}"]]
        points = sorted((r["error"], r[of]) for r in rows)
        front = seen(x for x, _ in points), seen(y for _, y in points)
        cost_panel(axes, across, _costs(found, of), of, floor=floor, front=front)
    panels[1].set_xlabel(ERROR)
    if beside := _costs(found, COSTS[0]):
        panels[0].legend(
            [Line2D([], [], **c.look.sample) for c in beside],
            [fitted(c.name, NAMES - SAMPLE, SMALL) for c in beside],
            loc="upper left", bbox_to_anchor=(1.02, 1.0), title="cheapest first",
            title_fontproperties={"size": SMALL}, alignment="left", labelspacing=0.8,
        ).get_title().set_color(DIM)  # fmt: skip
    return drawing


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


def _name(key: Key, keys: Iterable[Key]) -> str:
    """Return a method's name, with its formulation where there are several."""
    method, formulation = key
    alone = sum(name == method for name, _ in keys) == 1
    return method if alone else f"{method} {formulation}"


def _notes(document: Mapping[str, Any], found: Shown) -> list[str]:
    lines = [f"Reference: {document['reference']['trust']}."]
    rows = curves(document["rows"])
    if gaps := list(_gaps(rows, found)):
        lines.append(f"No result: {'; '.join(gaps)}.")
    if found.left_out:
        text = ", ".join(
            f"{_name(key, rows)} ({_rounded(times)})"
            for key, times in found.left_out.items()
        )
        lines.append(f"Not drawn (time relative to the fastest): {text}.")
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


def _gaps(rows: Mapping[Key, Sequence[Row]], found: Shown) -> Iterator[str]:
    """Return settings without an answer, with reasons, those next to each other joined.

    Of the curves that are shown, and of those that would have nothing to show.
    """
    for key in (x for x in rows if x not in found.left_out):
        for outcome, group in groupby(rows[key], _without_answer):
            if outcome is not None:
                gap = list(group)
                values = dict.fromkeys(f"{x['value']:.3g}" for x in (gap[0], gap[-1]))
                where = f"{_name(key, rows)} at {gap[0]['setting']}"
                yield f"{where} {' to '.join(values)}: {outcome}"


def _without_answer(row: Row) -> str | None:
    return str(row["outcome"]) if row["error"] is None else None
