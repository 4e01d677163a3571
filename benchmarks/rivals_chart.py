"""docs/speed.png: time against error, a panel for each scene."""

from __future__ import annotations

import numpy as np

from lagsim.outputs.curves import curve, point
from lagsim.outputs.scale import Scale, log_scale
from lagsim.outputs.sheet import DIM, PENS, SMALL, Sheet, in_house_style, mark

WIDTH, LEFT, RIGHT, TOP = 7.6, 0.62, 0.15, 0.78
ACROSS, DOWN, HEIGHT = 0.55, 0.62, 2.1

STYLES = {
    "lagsim": (PENS[0] | {"linewidth": 1.6}, "o"),
    "heyoka": (PENS[2], "s"),
    "scipy DOP853": ({"color": "#777777"}, "x"),
    "IDA, GGL": (PENS[3], "^"),
    "IDA, index 1": (PENS[4], "v"),
}
WORST, LEAST = 3.0, 1e-16


@in_house_style
def chart(results):
    """Draw all scenes; gives a PNG."""
    rows = -(-len(results) // 2)
    sheet = Sheet(WIDTH, TOP + rows * (HEIGHT + DOWN) + 0.1)
    sheet.heading("Time to integrate against the error made", "")
    entries = [(n, mark(kind, 4.0, pen["color"])) for n, (pen, kind) in STYLES.items()]
    sheet.legend(LEFT, 0.46, entries, WIDTH - LEFT - RIGHT)
    width = (WIDTH - LEFT - RIGHT - ACROSS) / 2
    for k, result in enumerate(results):
        row, column = divmod(k, 2)
        left = LEFT + column * (width + ACROSS)
        top = TOP + row * (HEIGHT + DOWN)
        _panel(sheet, (left, top, width, HEIGHT), result)
    return sheet.png()


def _panel(sheet, place, result):
    curves = {}
    for name, points in result["points"].items():
        kept = [p for p in points if p["error"] <= WORST]
        x = np.array([max(p["error"], LEAST) for p in kept])
        curves[name] = x, np.array([p["seconds"] for p in kept])
    errors = Scale(2.0, 5e-15, log=True)
    seconds = log_scale(*(y for _, y in curves.values()), margin=0.0, least=0.15)
    left, top, width, _ = place
    with sheet.panel(
        place, errors, seconds, below=("greatest error against range", ""),
        side=("seconds", "") if left == LEFT else ("", ""), ticks=(8, 6),
    ) as axes:  # fmt: skip
        for name, (x, y) in curves.items():
            pen, kind = STYLES[name]
            curve(axes, x, y, pen)
            for across, up in zip(x, y, strict=True):
                if errors.high <= across <= errors.low:
                    point(axes, across, up, mark(kind, 3.2, pen["color"]))
    sheet.text(left, top - 0.06, result["title"], size=SMALL, bold=True)
    note = f"{result['rows']} rows"
    sheet.text(left + width, top - 0.06, note, size=SMALL, ha="right", color=DIM)
