"""The chart of stability: what is on it, read off what is drawn."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from matplotlib.colors import to_rgb

from lagsim.methods import method, names
from lagsim.model.reader import read
from lagsim.run.session import open_case
from lagsim.studies.bench.stability import Wish, measure
from lagsim.studies.bench.stability_chart import VERDICT_COLOURS, chart
from lagsim.studies.bench.trial import VERDICTS
from tests.outputs.drawn import assert_legible, drawn

SPRING = """
parameters: {k: {value: 4, unit: N/m}}
coordinates: {x: {unit: m}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
initial: {x: 1}
simulation: {duration: 10, output_step: 0.1}
"""


def found(**wish):
    case = open_case(read(SPRING, "model.yaml"))

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
    (border,) = [b for b in strips.borders if b.method == "rk4"]
    cells = strips.of("rk4")
    verdicts = itertools.cycle(VERDICTS)
    return replace(
        strips,
        methods=tuple(fixed),
        borders=[replace(border, method=name, note="why") for name in fixed],
        runs=dict.fromkeys(fixed, (100, 1000)),
        cells=[
            replace(cell, method=name, verdict=next(verdicts))
            for name in fixed
            for cell in cells
        ],
    )


@pytest.mark.slow
def test_every_text_of_strips_lies_on_the_sheet_and_over_no_other(strips):
    assert_legible(drawn(chart, "spring", strips, None))


@pytest.mark.slow
def test_every_text_of_a_crowd_does(strips):
    drawing = drawn(chart, "a long name " * 20, everything(strips), None)
    assert_legible(drawing)
    assert set(VERDICTS) <= set(drawing.written())


@pytest.mark.slow
def test_every_text_of_maps_does_and_axes_have_their_units(maps):
    drawing = drawn(chart, "spring", maps, "k")
    assert_legible(drawing)
    labels = {label for panel in drawing.panels for label in panel.labels[:2]}
    assert {"k (N/m)", "step h (s)", "evaluations / s"} <= labels
    assert not any("…" in label for label in labels)


def test_it_is_drawn_for_print(strips):
    assert chart("spring", strips, None, "pdf").startswith(b"%PDF")
    assert chart("spring", strips, None, "svg").startswith(b"<?xml")


def test_what_it_was_found_with_is_said(strips):
    said = " ".join(drawn(chart, "spring", strips, None).written())
    assert "Found with lagsim " in said
    assert "numpy " in said


def test_verdicts_are_told_apart_in_grey():
    weights = (0.299, 0.587, 0.114)
    greys = [
        sum(w * part for w, part in zip(weights, to_rgb(colour), strict=True))
        for colour in VERDICT_COLOURS.values()
    ]
    # A dozen greys from black to white can be told apart side by side.
    assert all(abs(a - b) > 1 / 12 for a, b in itertools.combinations(greys, 2))


def named_in_legend(drawing):
    names = ("border found", "predicted: start", "predicted: motion", "predicted",
             "h·λ: start", "h·λ: motion")  # fmt: skip
    return {text for text in drawing.written() if text in names}


@pytest.mark.slow
def test_the_legend_names_what_is_drawn(strips):
    # A spring's eigenvalues are those of the start all along: two marks in one place.
    drawing = drawn(chart, "spring", strips, None)
    whole = {"border found", "predicted: start", "predicted: motion", "h·λ: start"}
    assert named_in_legend(drawing) == whole
    nowhere = [
        replace(b, found=None, at_start=None, along=None) for b in strips.borders
    ]
    drawing = drawn(chart, "spring", replace(strips, borders=nowhere), None)
    # h is then the largest step, and h·λ beyond the panels.
    assert named_in_legend(drawing) == set()
    # A prediction beyond the steps that were tried is not on the strip.
    beyond = [replace(b, at_start=1e9, along=1e-9) for b in nowhere]
    drawing = drawn(chart, "spring", replace(strips, borders=beyond), None)
    assert not any("predicted" in name for name in named_in_legend(drawing))


def test_steps_have_units_and_few_panels_fill_the_sheet(strips):
    drawing = drawn(chart, "spring", strips, None)
    assert "step h (s)" in [panel.labels[0] for panel in drawing.panels]
    steps = [text for text in drawing.written() if text.startswith("h = ")]
    assert len(steps) == len(strips.methods)
    assert all(" s (" in text for text in steps)
    width = drawing.sheet[16:20]
    right = max(panel.box.x1 for panel in drawing.panels)
    assert right > 0.95 * int.from_bytes(width, "big")
    regions = drawing.panels[len(strips.methods) :]
    assert max(panel.box.x1 for panel in regions) == pytest.approx(right, rel=0.02)
    # As long across as up.
    for panel in regions:
        (left, far), (low, high) = panel.limits
        across = panel.box.width / (far - left)
        assert across == pytest.approx(panel.box.height / (high - low))
