"""The motion of a run on a page that opens by itself, see docs/animation.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.notes import Caution
from lagsim.outputs.animation.film import Film, film, frames_of, stage
from lagsim.outputs.animation.page import NAME, page, record, recorded

if TYPE_CHECKING:
    from lagsim.model.model import Model

__all__ = [
    "NAME",
    "Film",
    "film",
    "frames_of",
    "nothing_to_draw",
    "page",
    "record",
    "recorded",
    "stage",
]


def nothing_to_draw(model: Model) -> list[Caution]:
    """Say that a model gives no page."""
    if stage(model).points:
        return []
    text = (
        f"there is no {NAME}: {model.name} has nothing to draw; give it a `scene` with "
        "points, or definitions x and y (and z)"
    )
    return [Caution("nothing-to-draw", text)]
