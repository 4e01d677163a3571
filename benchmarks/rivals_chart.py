"""docs/speed.png: time against error, a panel for each scene."""

from __future__ import annotations

import math

import numpy as np

from lagsim.outputs.axis import DecadeAxis
from lagsim.outputs.panel import Panel, legend
from lagsim.outputs.sheet import DIM, HEADING, PENS, SMALL, Pen, Sheet, in_house_style

WIDTH, LEFT, RIGHT, TOP = 7.6, 0.62, 0.15, 0.78
ACROSS, DOWN, HEIGHT = 0.55, 0.62, 2.1

STYLES = {
    "lagsim": (Pen(PENS[0].colour, width=1.6), "o"),
    "heyoka": (Pen(PENS[2].colour), "s"),
    "scipy DOP853": (Pen("#777777"), "x"),
    "IDA, GGL": (Pen(PENS[3].colour), "^"),
    "IDA, index 1": (Pen(PENS[4].colour), "v"),
}
WORST, LEAST = 3.0, 1e-16


@in_house_style
def chart(results):
    """Draw all scenes; gives a PNG."""
    rows = -(-len(results) // 2)
    sheet = Sheet(WIDTH, TOP + rows * (HEIGHT + DOWN) + 0.1)
    title = "Time to integrate against the error made"
    sheet.text(0.12, 0.22, title, size=HEADING, bold=True)
    entries = [
        (name, Pen(pen.colour, marker=mark, size=4.0))
        for name, (pen, mark) in STYLES.items()
    ]
    legend(sheet, LEFT, 0.46, entries, WIDTH - LEFT - RIGHT)
    width = (WIDTH - LEFT - RIGHT - ACROSS) / 2
    for k, result in enumerate(results):
        row, column = divmod(k, 2)
        left = LEFT + column * (width + ACROSS)
        top = TOP + row * (HEIGHT + DOWN)
        _panel(sheet, (left, top, width, HEIGHT), result)
        if column == 0:
            sheet.text(
                0.16, top + HEIGHT / 2, "seconds", size=SMALL, align="center",
                turned=True,
            )  # fmt: skip
    return sheet.png()


def _panel(sheet, place, result):
    curves = {}
    for name, points in result["points"].items():
        kept = [p for p in points if p["error"] <= WORST]
        x = np.array([math.log10(max(p["error"], LEAST)) for p in kept])
        y = np.array([math.log10(p["seconds"]) for p in kept])
        curves[name] = x, y
    low = min(y.min() for _, y in curves.values() if len(y))
    high = max(y.max() for _, y in curves.values() if len(y))
    panel = Panel(
        sheet, place, DecadeAxis(0.3, -14.3), DecadeAxis(low - 0.15, high + 0.15)
    )
    for name, (x, y) in curves.items():
        pen, mark = STYLES[name]
        panel.curve(x, y, pen)
        for across, down in zip(x, y, strict=True):
            if abs(across) <= 14.3:
                panel.mark(across, down, Pen(marker=mark, size=3.2), pen.colour)
    panel.frame((8, 6))
    left, top, width, height = place
    sheet.text(left, top - 0.06, result["title"], size=SMALL, bold=True)
    note = f"{result['rows']} rows"
    sheet.text(left + width, top - 0.06, note, size=SMALL, align="right", colour=DIM)
    label = "greatest error against range"
    sheet.text(left + width / 2, top + height + 0.29, label, size=SMALL, align="center")
