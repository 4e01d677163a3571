"""Picture of the positions of rest of a model in its scene."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.figure import PENS, content
from lagsim.outputs.stills import Still, bars, film_at, stills

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.outputs.figure import Pen
    from lagsim.studies.rest import Equilibrium

# Pens and words by the verdict on stability.
LOOKS: dict[bool | None, tuple[str, Pen]] = {
    True: ("stable", {**PENS[0], "linewidth": 1.1}),
    False: ("unstable", {**PENS[2], "linewidth": 1.0}),
    None: ("not decided", {**PENS[4], "linewidth": 1.0}),
}


def picture(name: str, found: Sequence[Equilibrium], form: str = "png") -> bytes:
    """Return the picture of all rests, the nearest first: equilibrium.png."""
    panels = []
    for number, one in enumerate(found, 1):
        steady = one.steady
        word, pen = LOOKS[one.stable]
        title = f"{number}:  {word},  distance {one.distance:.3g}"
        film = film_at(steady.equations.model, steady.values, 1)
        panels.append(Still(title, film, (pen,)))
    subject = "positions of rest"
    if panels and panels[0].film is None:
        curves = [
            (still.title, np.asarray(one.steady.state.q))
            for still, one in zip(panels, found, strict=True)
        ]
        return content(bars(name, f"{subject}, by coordinates", curves), form)
    used = dict.fromkeys(one.stable for one in found)
    return content(stills(name, subject, panels, [LOOKS[x] for x in used]), form)
