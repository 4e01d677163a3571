"""Pictures of positions of rest in the scene, and of their branches."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.outputs.figure import (
    INK,
    PENS,
    SMALL,
    Picture,
    encoded_figure,
    in_house_style,
    marker_pen,
    stack_height,
)
from lagsim.outputs.letters import letters_of, mathtext, raised_powers
from lagsim.outputs.scale import name_axis, read_off
from lagsim.outputs.stills import Still, bars, film_at, stills

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.model.model import Model
    from lagsim.outputs.figure import Pen
    from lagsim.studies.rest import Equilibrium

# Height of a diagram of branches, in inches.
HIGH = 3.4
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
        return encoded_figure(bars(name, f"{subject}, by coordinates", curves), form)
    used = dict.fromkeys(one.stable for one in found)
    return encoded_figure(stills(name, subject, panels, [LOOKS[x] for x in used]), form)


# Dashes of branches by the verdict on stability.
DASHES: dict[bool | None, Pen] = {
    True: {"linewidth": 1.3},
    False: {"linewidth": 0.9, "dashes": (4.0, 2.0)},
    None: {"linewidth": 0.9, "dashes": (1.0, 1.2)},
}
# Longest path over a special point, relative to the distance between its neighbours.
DETOUR = 1.5
MARKERS = {"fold": "o", "branch": "s", "hopf": "^", "contact": "D"}


def diagram(
    model: Model, record: dict[str, Any], shown: str | None = None, form: str = "png"
) -> bytes:
    """Return the picture of branches: a coordinate, `shown`, against the varied name.

    record : the result of `Branches.record`.
    """
    return encoded_figure(_diagram(model, record, shown), form)


@in_house_style
def _diagram(model: Model, record: dict[str, Any], shown: str | None) -> Picture:
    branches, name, letters = (
        record["branches"],
        record["vary"]["name"],
        letters_of(model),
    )
    every = [x for places in branches for x in places]
    spread = {q: np.ptp([x["coordinates"][q] for x in every]) for q in _names(every)}
    up = shown or max(spread, key=lambda q: float(spread[q]), default="")
    verdicts = dict.fromkeys(x["stable"] for x in every)
    legend = [(LOOKS[x][0], DASHES[x] | {"color": INK}) for x in verdicts]
    kinds = dict.fromkeys(x["kind"] for x in record["points"])
    legend += [(kind, marker_pen(MARKERS[kind], 4.0, INK, "white")) for kind in kinds]
    picture = Picture(
        stack_height(1, HIGH), model.name, "branches of rest", legend=legend
    )
    axes = picture.subplots()
    for number, places in enumerate(branches):
        colour = PENS[number % len(PENS)]["color"]
        whole = with_specials(places, record["points"], name_of=up)
        for verdict, group in groupby(pairwise(whole), lambda pair: pair[1]["stable"]):
            pairs = list(group)
            points = [pairs[0][0], *(pair[1] for pair in pairs)]
            x = [point["value"] for point in points]
            y = [point["coordinates"][up] for point in points]
            axes.plot(x, y, color=colour, **DASHES[verdict])
    for point in record["points"]:
        at = point["value"], point["coordinates"][up]
        axes.plot(
            *at, **marker_pen(MARKERS[point["kind"]], 4.0, INK, "white"), zorder=4.0
        )
        axes.annotate(
            mathtext(read_off(at[0])), at, (4.0, 4.0), textcoords="offset points",
            size=SMALL,
        )  # fmt: skip
    axes.set_xlim(record["vary"]["from"], record["vary"]["to"])
    axes.margins(y=0.08)
    units = {p.name: p.unit for p in model.parameters}
    units |= {c.name: c.unit for c in model.coordinates}
    name_axis(axes.xaxis, letters.name(name), raised_powers(units.get(name, "")))
    name_axis(axes.yaxis, letters.name(up), raised_powers(units.get(up, "")))
    return picture


def with_specials(
    places: Sequence[dict[str, Any]], specials: Sequence[dict[str, Any]], name_of: str
) -> list[dict[str, Any]]:
    """Return the points of a branch with special points inserted, for drawing.

    A special point is inserted where stability changes, between two points whose
    distance over the special point is hardly longer.

    name_of : the coordinate that is drawn.
    places, specials : points of the branch and special points, as in documents.
    """

    def at(point: dict[str, Any]) -> complex:
        return complex(point["value"] / width, point["coordinates"][name_of] / height)

    if len(places) < 2:
        return list(places)
    values = [x["value"] for x in places]
    drawn = [x["coordinates"][name_of] for x in places]
    width, height = (float(np.ptp(x)) or 1.0 for x in (values, drawn))
    found = list(places[:1])
    for here, there in pairwise(places):
        if here["stable"] != there["stable"]:
            a, b = at(here), at(there)
            ways = [(abs(at(x) - a) + abs(b - at(x)), x) for x in specials]
            way, one = min(ways, key=lambda pair: pair[0], default=(np.inf, here))
            if way <= DETOUR * abs(b - a):
                found.append({**one, "stable": here["stable"]})
        found.append(there)
    return found


def _names(every: Sequence[dict[str, Any]]) -> list[str]:
    return list(every[0]["coordinates"]) if every else []
