"""Charts of bench and stability, read off their drawing."""

import itertools
import math
import re

import pytest
from matplotlib.colors import to_rgb

from lagsim import methods
from lagsim.methods import names
from lagsim.model.reader import read
from lagsim.run.session import open_case
from lagsim.studies.bench import SCIPY, stamp
from lagsim.studies.bench.chart import (
    MOST,
    VERDICT_COLOURS,
    curves_below,
    figure,
    stability_figure,
    style_of,
    work_precision,
)
from lagsim.studies.bench.stability import VERDICTS, MapOptions, measure
from tests.outputs.drawn import assert_legible, drawn
from tests.small_scenes import spring

FRONT_SECONDS = 1e-3


def row(method, formulation, error, times, *, chosen=False, outcome="done"):
    """A row with the cost `times` that of the front; without error a gap."""
    front = chosen and error is not None
    return {
        "method": method, "formulation": formulation, "setting": "rtol", "value": 1e-6,
        "seconds": times * FRONT_SECONDS, "evaluations": int(1000 * times),
        "error": error, "outcome": outcome, "chosen": chosen,
        "front_seconds": front, "front_evaluations": front,
    }  # fmt: skip


def curve(method, formulation, times, *, decades=range(2, 13), chosen=False):
    return [
        row(method, formulation, 10.0**-k, times * 1.2**k, chosen=chosen)
        for k in decades
    ]


def document(rows, **more):
    reference = {
        "trust": "taylor at rtol 1e-14; dop853 at rtol 1e-14 agrees with it to 1e-12",
        "floor": 1e-12,
    }  # fmt: skip
    return {
        "lagsim": "1.2.3",
        "versions": {"python": "3.13.1", "numpy": "2.4.6", "llvmlite": "0.50.0"},
        "machine": {
            "processor": "Some Processor of 2030", "cores": 4, "system": "Linux",
            "load": 0.4,
        },
        "date": "2030-04-01",
        "model": {"name": "a-scene"},
        "end": 20.0,
        "reference": reference,
        "refused": [{"method": "moreau", "formulation": "auto", "reason": "why"}],
        "rows": rows,
    } | more  # fmt: skip


def crowd():
    """Return rows of all methods and formulations, each curve costlier than before."""
    kinds = ("velocity projection", "elimination", "baumgarte", "drift")
    rows = curve("radau", "elimination", 1.0, chosen=True)
    times = (2.0 + k for k in itertools.count())
    for method in names():
        for kind in kinds:
            if (method, kind) != ("radau", "elimination"):
                rows += curve(method, kind, next(times), decades=range(1, 9))
    for method in SCIPY:
        rows += curve(method, "drift", next(times))
    rows.append(row("rk4", "velocity projection", None, 1.0, outcome="too slow"))
    return rows


DOCUMENTS = {
    "crowd": document(crowd()),
    "one": document(curve("dop853", "none", 1.0, chosen=True)),
    "flat": document(curve("dop853", "none", 1.0, decades=[3, 3], chosen=True)),
    "nothing": document([row("rk4", "none", None, 1.0, outcome="failed")]),
    "long names": document(
        crowd(),
        model={"name": "a very long name " * 20},
        machine=document([])["machine"] | {"processor": "a processor " * 30},
    ),
    "exact": document(curve("exponential", "none", 1.0, decades=[16, 400])),
    "horizon": document(
        curve("taylor", "none", 1.0, decades=range(10), chosen=True),
        reference=document([])["reference"] | {"floor": 1e-3},
    ),
}


@pytest.fixture(scope="module")
def crowded():
    return drawn(work_precision, DOCUMENTS["crowd"])


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_text_lies_on_the_sheet_and_over_no_other(name, request):
    if name == "crowd":
        drawing = request.getfixturevalue("crowded")
    else:
        drawing = drawn(work_precision, DOCUMENTS[name])
    assert len(drawing.panels) == 2
    assert_legible(drawing)
    assert name == "long names" or not any("…" in said for said in drawing.written())


@pytest.mark.slow
def test_at_most_a_dozen_curves_and_the_rest_is_named(crowded):
    rows = crowd()
    found = curves_below(rows, 3.0)
    assert len(found.curves) == MOST
    everything = {(r["method"], r["formulation"]) for r in rows}
    assert {*found.curves, *found.left_out} == everything
    assert not set(found.curves) & set(found.left_out)
    # What `auto` takes, then every method once before any comes twice.
    assert ("radau", "elimination") in found.curves
    methods = [method for method, _ in found.curves]
    assert len(set(methods)) == MOST
    assert sum(method in SCIPY for method in methods) == 2
    said = " ".join(crowded.written()).replace("\n", " ")
    for method, kind in found.left_out:
        assert f"{method} {kind}" in said or f"{method} (" in said


@pytest.mark.slow
def test_what_is_on_the_front_is_shown():
    # A dozen methods with many digits, and a cheap one with hardly any.
    rows = curve("dop853", "none", 1.0, chosen=True)
    for k, method in enumerate([m for m in names() if m not in ("dop853", "euler")]):
        rows += curve(method, "none", 2.0 + k)
    loose = row("euler", "none", 0.5, 0.1)
    rows.append(loose | {"front_seconds": True, "front_evaluations": True})
    assert len({r["method"] for r in rows}) > MOST
    assert ("euler", "none") in curves_below(rows, 3.0).curves
    for panel in drawn(work_precision, document(rows)).panels:
        (front,) = [line for line in panel.lines if line.colour == "#f0e442"]
        assert len(front.x) == 12
        assert panel.box.y0 < front.y.min() < front.y.max() < panel.box.y1


def test_how_much_dearer_is_that_of_equal_errors():
    rows = curve("dop853", "none", 1.0, chosen=True)
    times = {method: 2.0 + k for k, method in enumerate(names()) if method != "dop853"}
    for method, dearer in times.items():
        rows += curve(method, "none", dearer)
    found = curves_below(rows, 3.0)
    assert [method for method, _ in found.curves] == list(names()[:MOST])
    assert found.left_out == {
        (method, "none"): pytest.approx(times[method]) for method in names()[MOST:]
    }


def test_curves_differ_in_colour_and_in_grey():
    kinds = ("none", "elimination", "baumgarte", "drift")
    looks = [style_of(*key) for key in itertools.product(names(), kinds)]
    looks += [style_of(method) for method in SCIPY]
    coloured = {(a.line["color"], a.line.get("dashes"), b) for a, b in marked(looks)}
    grey = {(a.line.get("dashes"), b) for a, b in marked(looks)}
    assert len(coloured) == len(grey) == len(looks)
    # Methods differ in colour or dashes already.
    own = [style_of(method).line for method in names()]
    assert len({(pen["color"], pen.get("dashes")) for pen in own}) == len(own)


def marked(looks):
    return [(look, look.mark["marker"]) for look in looks]


def test_names_stand_beside_a_sample_of_their_curve():
    legend = figure(DOCUMENTS["crowd"]).axes[0].get_legend()
    beside = {
        text.get_text(): (line.get_marker(), line.get_color())
        for text, line in zip(legend.texts, legend.legend_handles, strict=True)
    }
    found = curves_below(crowd(), 3.0).curves
    assert len(beside) == len(found)
    for key in found:
        look = style_of(*key)
        sample = beside.get(" ".join(key)) or beside[key[0]]
        assert sample == (look.mark["marker"], look.line["color"])


@pytest.mark.slow
def test_what_is_better_and_what_it_was_measured_on_is_said():
    drawing = drawn(work_precision, DOCUMENTS["one"])
    for panel in drawing.panels:
        assert panel.labels[1].startswith("← cheaper")
        assert panel.limits[0][0] < panel.limits[0][1]  # errors grow to the right
        assert panel.limits[1][0] < panel.limits[1][1]
    assert drawing.panels[1].labels[0].startswith("← more accurate")
    assert drawing.written().count("↙ better") == 2
    said = " ".join(drawing.written())
    assert stamp(DOCUMENTS["one"]) in said.replace("\n", " ")
    for part in ("Some Processor of 2030", "one of 4 threads", "2030-04-01"):
        assert part in said
    for part in ("lagsim 1.2.3", "python 3.13.1", "numpy 2.4.6", "llvmlite 0.50.0"):
        assert part in said
    assert "busy" not in said
    loaded = document([], machine=document([])["machine"] | {"load": 3.0})
    assert "busy (load 3.0)" in stamp(loaded)


@pytest.mark.slow
def test_what_auto_takes_has_rings(crowded):
    for panel in crowded.panels:
        [rings] = [line for line in panel.of_colour("#000000") if line.marker == "o"]
        assert rings.dots
        assert len(rings.x) == 11


@pytest.mark.slow
def test_errors_below_the_floor_are_shaded():
    [_, panel] = drawn(work_precision, DOCUMENTS["horizon"]).panels
    [(_, corners)] = panel.areas
    low, high = panel.limits[0]
    # From the left edge of the panel to an error of 1e-3, on logarithms.
    share = (corners[:, 0].max() - panel.box.x0) / panel.box.width
    assert share == pytest.approx(math.log(1e-3 / low) / math.log(high / low), abs=1e-3)
    assert corners[:, 0].min() == pytest.approx(panel.box.x0, abs=1.0)


# Maps of stability

SPRING = spring(
    "duration: 10, output_step: 0.1", parameters="k: {value: 4, unit: N/m}",
    unit="unit: m",
)  # fmt: skip


def found(**wish):
    case = open_case(read(SPRING, "spring.yaml"))
    few = {"methods": ("rk4", "verlet"), "strip": 3, "map": (3, 2)}
    return measure(case, MapOptions(**(few | wish)))


@pytest.fixture(scope="module")
def strips():
    return found()


@pytest.fixture(scope="module")
def maps():
    some = ("rk4", "verlet", "dop853", "taylor")
    return found(name="k", between=(1.0, 16.0), methods=some)


def everything(strips):
    """As many methods as there are, and every verdict that a cell can have."""
    fixed = [name for name in names() if not methods.method(name).ADAPTIVE]
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
    drawing = drawn(stability_figure, strips)
    assert_legible(drawing)
    assert re.search(r"Found with lagsim .* numpy ", " ".join(drawing.written()))
    for form, begins in (("pdf", b"%PDF"), ("svg", b"<?xml")):
        assert stability_figure(strips, form).startswith(begins)
    drawing = drawn(stability_figure, everything(strips))
    assert_legible(drawing)
    assert set(VERDICTS) <= set(drawing.written())
    # Each row of regions says what is up.
    first = {panel.box.x0 for panel in drawing.panels if panel.labels[1] == "Im z"}
    assert len(first) == 1
    left = [p for p in drawing.panels if p.labels[2] in names() and p.box.x0 in first]
    assert len(left) == drawing.written().count("Im z") > 1


@pytest.mark.slow
def test_every_text_of_maps_does_and_axes_have_their_units(maps):
    drawing = drawn(stability_figure, maps)
    assert_legible(drawing)
    labels = {label for panel in drawing.panels for label in panel.labels[:2]}
    assert {"k (N/m)", "step h (s)", "evaluations / s"} <= labels
    assert not any("…" in label for label in labels)
    # Between the values of k that were tried: 2 √2 and 2 over the file's ω = 2.
    assert {"h = 1.41 s (border)", "h = 1 s (border)"} <= set(drawing.written())


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
    said = drawn(stability_figure, strips | {"borders": borders}).written()
    marks = ("border found", "predicted", "h·λ")
    assert {text for text in said if text.startswith(marks)} == expected


@pytest.mark.slow
def test_few_panels_fill_the_sheet(strips):
    drawing = drawn(stability_figure, strips)
    assert "step h (s)" in [panel.labels[0] for panel in drawing.panels]
    steps = [text for text in drawing.written() if text.startswith("h = ")]
    assert [" s (" in text for text in steps] == [True, True]
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
