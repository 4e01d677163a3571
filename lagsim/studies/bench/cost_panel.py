"""A panel of what errors cost, as all charts draw it, and how a method looks there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.methods import names
from lagsim.outputs.curves import LOST, curve, point
from lagsim.outputs.scale import Scale, log_scale
from lagsim.outputs.sheet import (
    DIM,
    PENS,
    SAMPLE,
    SMALL,
    Pen,
    Place,
    Sheet,
    mark,
    text_width,
)
from lagsim.studies.bench.scipy_solvers import NAMES as SCIPY

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.run.observers.thinning import Array

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

# Inches: what stands left of a panel, and from one name to the next beside it.
BESIDE, NEXT = 0.8, 0.19
ORDER = "cheapest first"


class Look(NamedTuple):
    """How a curve is drawn: its line, and the mark of its points."""

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


def error_scale(curves: Sequence[Cost], floor: float) -> Scale:
    """Give the scale that holds all errors, and at the left what cannot be told."""
    known = np.concatenate([*(c.errors for c in curves), seen([floor]), [0.1]])
    return Scale(0.4 * float(min(known)), 2.0 * float(max(known)), log=True)


def cost_panel(
    sheet: Sheet,
    place: Place,
    across: Scale,
    curves: Sequence[Cost],
    of: str,
    *,
    floor: float,
    below: bool = True,
    front: tuple[Array, Array] | None = None,
) -> None:
    """Draw curves of cost against error; errors below `floor` are not known."""
    costs = [c.costs for c in curves if len(c.costs)]
    up = log_scale(*costs, margin=0.05, least=0.08)
    name = "← more accurate      error against range"
    axes = sheet.panel(
        place, across, up, below=(name if below else " ", ""),
        side=(f"← faster      {of}", ""), ticks=(9, 7), reach=BESIDE - 0.2,
    )  # fmt: skip
    if floor > across.low:
        axes.axvspan(across.low, floor, facecolor=LOST, alpha=0.45, zorder=0.2)
        axes.axvline(floor, **FLOOR)
    if front is not None:
        curve(axes, *front, FRONT)
    for c in curves:
        curve(axes, c.errors, c.costs, c.look.line)
        for x, y in zip(c.errors, c.costs, strict=True):
            if across.low <= x <= across.high:
                point(axes, x, y, c.look.mark)
        for x, y, ringed in zip(c.errors, c.costs, c.ringed, strict=False):
            if ringed:
                point(axes, x, y, CHOSEN)
    left, top, _, height = place
    # Numbers keep away from the corner where both axes begin.
    corner: dict[str, Any] = {"ha": "right", "bold": True, "color": DIM}
    sheet.text(left - 0.2, top + height + 0.17, "↙ better", size=SMALL, **corner)


def names_beside(
    sheet: Sheet, x: float, y: float, curves: Sequence[Cost], room: float
) -> None:
    """Name curves below each other, each by a piece of its line and its mark.

    They come in the order of what they cost.
    """
    if not curves:
        return
    sheet.text(x, y, ORDER, size=SMALL, color=DIM)
    y += NEXT
    sheet.legend(x, y, [(c.name, c.look.sample) for c in curves], room, NEXT)


def room_beside(curves: Sequence[Cost], most: float) -> float:
    """Give the room that names take, in inches, up to so much."""
    if not curves:
        return 0.0
    names = SAMPLE + max(text_width(c.name, SMALL) for c in curves)
    return min(most, max(names, text_width(ORDER, SMALL)) + 0.02)
