"""The chart of stability: read off what is drawn."""

from __future__ import annotations

import itertools
import re

import pytest
from matplotlib.colors import to_rgb

from lagsim.methods import method, names
from lagsim.model.reader import read
from lagsim.run.session import open_case
from lagsim.studies.bench.stability import VERDICTS, Wish, measure
from lagsim.studies.bench.stability_chart import VERDICT_COLOURS, chart
from tests.outputs.drawn import assert_legible, drawn

SPRING = """
parameters: {k: {value: 4, unit: N/m}}
coordinates: {x: {unit: m}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
initial: {x: 1}
simulation: {duration: 10, output_step: 0.1}
"""


def found(**wish):
    case = open_case(read(SPRING, "spring.yaml"))

    def case_at(value):
        return case if value is None else case.bind({"k": value})

    few = {"methods": ("rk4", "verlet"), "strip": 3, "map": (3, 2)}
    return measure(case_at, Wish(**(few | wish)))


@pytest.fixture(scope="module")
def strips():
    return found()


@pytest.fixture(scope="module")
def maps():
    some = ("rk4", "verlet", "dop853", "taylor")
    return found(name="k", between=(1.0, 16.0), methods=some)


def everything(strips):
    """As many methods as there are, and every verdict that a cell can have."""
    fixed = [name for name in names() if not method(name).ADAPTIVE]
    border = strips["borders"]["rk4"] | {"note": "why"}
    verdicts = itertools.cycle(VERDICTS)
    cells = [
        cell | {"method": name, "verdict": next(verdicts)}
        for name in fixed
        for cell in strips["cells"][:3]
    ]
    steps = {name: {"least": 100, "most": 1000} for name in fixed}
    return strips | {
        "model": {"name": "a long name " * 20},
        "methods": {"fixed": fixed, "adaptive": []},
        "borders": dict.fromkeys(fixed, border),
        "runs": strips["runs"] | {"steps": steps},
        "cells": cells,
    }


@pytest.mark.slow
def test_every_text_of_strips_lies_on_the_sheet_and_over_no_other(strips):
    drawing = drawn(chart, strips)
    assert_legible(drawing)
    said = " ".join(drawing.written())
    assert re.search(r"Found with lagsim .* numpy ", said)


@pytest.mark.slow
def test_every_text_of_a_crowd_does(strips):
    drawing = drawn(chart, everything(strips))
    assert_legible(drawing)
    assert set(VERDICTS) <= set(drawing.written())
    # Each row of regions says what is up.
    first = {panel.box.x0 for panel in drawing.panels if panel.labels[1] == "Im z"}
    assert len(first) == 1
    left = [p for p in drawing.panels if p.labels[2] in names() and p.box.x0 in first]
    assert len(left) == drawing.written().count("Im z") > 1


@pytest.mark.slow
def test_every_text_of_maps_does_and_axes_have_their_units(maps):
    drawing = drawn(chart, maps)
    assert_legible(drawing)
    labels = {label for panel in drawing.panels for label in panel.labels[:2]}
    assert {"k (N/m)", "step h (s)", "evaluations / s"} <= labels
    assert not any("…" in label for label in labels)


@pytest.mark.slow
def test_it_is_drawn_for_print(strips):
    assert chart(strips, "pdf").startswith(b"%PDF")
    assert chart(strips, "svg").startswith(b"<?xml")


def test_verdicts_are_told_apart_in_grey():
    weights = (0.299, 0.587, 0.114)
    greys = [
        sum(w * part for w, part in zip(weights, to_rgb(colour), strict=True))
        for colour in VERDICT_COLOURS.values()
    ]
    # A dozen greys from black to white can be told apart side by side.
    assert all(abs(a - b) > 1 / 12 for a, b in itertools.combinations(greys, 2))


# A spring's eigenvalues are those of the start all along: two marks in one place. With
# no border h is the largest step, and h·λ beyond the panels; a prediction beyond the
# steps that were tried is not on the strip.
NOWHERE = dict.fromkeys(("found", "predicted_at_start", "predicted_along"))
LEGENDS = [
    ({}, {"border found", "predicted: start", "predicted: motion", "h·λ: start"}),
    (NOWHERE | {"predicted": None}, set()),
    (NOWHERE | {"predicted_at_start": 1e9, "predicted_along": 1e-9}, {"h·λ: start"}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("border", "expected"), LEGENDS)
def test_the_legend_names_what_is_drawn(strips, border, expected):
    borders = {name: own | border for name, own in strips["borders"].items()}
    said = drawn(chart, strips | {"borders": borders}).written()
    marks = ("border found", "predicted", "h·λ")
    assert {text for text in said if text.startswith(marks)} == expected


def test_few_panels_fill_the_sheet(strips):
    drawing = drawn(chart, strips)
    assert "step h (s)" in [panel.labels[0] for panel in drawing.panels]
    steps = [text for text in drawing.written() if text.startswith("h = ")]
    assert len(steps) == 2
    assert all(" s (" in text for text in steps)
    width = int.from_bytes(drawing.sheet[16:20], "big")
    right = max(panel.box.x1 for panel in drawing.panels)
    assert right > 0.95 * width
    regions = drawing.panels[2:]
    assert max(panel.box.x1 for panel in regions) == pytest.approx(right, rel=0.02)
    # As long across as up.
    for panel in regions:
        (left, far), (low, high) = panel.limits
        across = panel.box.width / (far - left)
        assert across == pytest.approx(panel.box.height / (high - low))
