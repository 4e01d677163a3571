"""docs/speed.png: time against error, a panel for each scene."""

from __future__ import annotations

from itertools import islice

from lagsim.outputs.sheet import (
    DIM,
    EDGE,
    LINE,
    SMALL,
    Sheet,
    in_house_style,
    wrapped,
)
from lagsim.studies.bench.chart import (
    BESIDE,
    WORST,
    Cost,
    cost_panel,
    error_scale,
    look,
    look_of,
    seen,
)
from lagsim.studies.experiment import stamp

WIDTH, RIGHT, TOP = 7.6, 0.15, 0.98
# Names beside each other; the rest stand below.
NAMED, LEGEND, LOWER = 4, 0.46, 0.2
DOWN, HEIGHT = 0.72, 2.1

LOOKS = {
    "lagsim": look(0),
    "heyoka": look(2, 1),
    "CVODE Adams": look(5, 2, 0),
    "scipy DOP853": look_of("scipy:DOP853"),
    "scipy LSODA": look_of("scipy:LSODA"),
    "IDA, GGL": look(3, 0, 1),
    "IDA, index 1": look(4, 1, 1),
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
    """Draw all scenes of results-rivals.json; gives a PNG."""
    scenes = document["scenes"]
    rows = -(-len(scenes) // 2)
    notes = wrapped([WHAT, f"{stamp(document)}."], WIDTH - 2 * EDGE)
    under = TOP + rows * (HEIGHT + DOWN)
    sheet = Sheet(WIDTH, under + LINE * len(notes) + 0.1)
    sheet.heading("Time to integrate against the error made", "")
    used = [name for name in LOOKS if any(name in s["points"] for s in scenes)]
    named = [(name, LOOKS[name].sample) for name in used]
    for row, some in enumerate(in_rows(named)):
        top = LEGEND + LOWER * row
        sheet.legend(BESIDE, top, some, WIDTH - BESIDE - RIGHT)
    width = (WIDTH - RIGHT) / 2 - BESIDE
    curves = [costs(scene) for scene in scenes]
    floor = max(scene["agreement"] for scene in scenes)
    across = error_scale([c for panel in curves for c in panel], floor)
    for k, scene in enumerate(scenes):
        row, column = divmod(k, 2)
        left = BESIDE + column * (width + BESIDE)
        top = TOP + row * (HEIGHT + DOWN)
        place = (left, top, width, HEIGHT)
        floor = scene["agreement"]
        cost_panel(sheet, place, across, curves[k], "seconds", floor=floor)
        sheet.text(left, top - 0.06, scene["title"], size=SMALL, bold=True)
        note = f"{scene['rows']} rows"
        sheet.text(left + width, top - 0.06, note, size=SMALL, ha="right", color=DIM)
    sheet.notes(under + 0.04, notes)
    return sheet.content()


def in_rows(names):
    """Give names in rows of the legend."""
    left = iter(names)
    while row := list(islice(left, NAMED)):
        yield row


def costs(scene):
    """Give the curves of a scene."""
    found = []
    for name, points in scene["points"].items():
        kept = [p for p in points if p["error"] <= WORST]
        errors = seen(p["error"] for p in kept)
        seconds = seen(p["seconds"] for p in kept)
        found.append(Cost(name, LOOKS[name], errors, seconds))
    return found
