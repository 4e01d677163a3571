"""docs/speed.png: time against error, a panel for each scene."""

from __future__ import annotations

from lagsim.outputs.figure import DIM, SMALL, Picture, encoded_figure, in_house_style
from lagsim.studies.bench import stamp
from lagsim.studies.bench.chart import (
    ERROR,
    WORST,
    CostCurve,
    cost_panel,
    curve_style,
    drawable_errors,
    error_scale,
    style_of,
)

# Inches: a panel with its scales, what is below all of them.
HEIGHT, REST = 2.7, 0.2
LOOKS = {
    "lagsim": curve_style(0),
    "heyoka": curve_style(2, 1),
    "CVODE Adams": curve_style(5, 2, 0),
    "scipy DOP853": style_of("scipy:DOP853"),
    "scipy LSODA": style_of("scipy:LSODA"),
    "IDA, GGL": curve_style(3, 0, 1),
    "IDA, index 1": curve_style(4, 1, 1),
}
WHAT = (
    "Rivals have a textbook's equations, or lagsim's where those are shorter. Least of "
    "several, warm, compiling apart; of several starts the median. lagsim writes every "
    "row with all its columns, rivals the states of the same rows alone. Error: the "
    "greatest of any coordinate or velocity in any row, against heyoka's in quadruple "
    "precision."
)


@in_house_style
def chart(document):
    """Draw all scenes of results-rivals.json; return a PNG."""
    scenes = document["scenes"]
    rows = -(-len(scenes) // 2)
    used = [name for name in LOOKS if any(name in s["points"] for s in scenes)]
    drawing = Picture(
        HEIGHT * rows + REST, "Time to integrate against the error made",
        legend=[(name, LOOKS[name].sample) for name in used],
        notes=[WHAT, f"{stamp(document)}."],
    )  # fmt: skip
    panels = drawing.subplots(rows, 2, squeeze=False).flat
    costs = [costs_of(scene) for scene in scenes]
    floor = max(scene["agreement"] for scene in scenes)
    across = error_scale([c for panel in costs for c in panel], floor)
    for axes, scene, own in zip(panels, scenes, costs, strict=False):
        cost_panel(axes, across, own, "seconds", floor=scene["agreement"])
        axes.set_xlabel(ERROR)
        axes.set_title(scene["title"], weight="bold")
        axes.set_title(f"{scene['rows']} rows", loc="right", color=DIM, size=SMALL)
    for axes in panels[len(scenes) :]:
        axes.remove()
    drawing.get_layout_engine().set(h_pad=0.12)
    return encoded_figure(drawing)


def costs_of(scene):
    """Return the curves of a scene."""
    found = []
    for name, points in scene["points"].items():
        kept = [p for p in points if p["error"] <= WORST]
        errors = drawable_errors(p["error"] for p in kept)
        seconds = drawable_errors(p["seconds"] for p in kept)
        found.append(CostCurve(name, LOOKS[name], errors, seconds))
    return found
