"""Pictures for print: SVG and PDF files, the same bytes each time."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from lagsim.outputs.figure import NOBODY, content
from tests.outputs import test_plots
from tests.outputs.drawn import noted

SVG = "{http://www.w3.org/2000/svg}"
VECTORS = [form for form in NOBODY if form != "png"]


def sheets():
    run = test_plots.record(test_plots.swing(), horizon=9.0)
    return list(test_plots.all_sheets(run))


def made(form):
    return [content(sheet, form) for sheet in sheets()]


@pytest.mark.slow
@pytest.mark.parametrize("form", VECTORS)
def test_the_same_bytes_again_and_after_a_picture_in_pixels(form):
    first = made(form)
    pixels = made("png")
    assert made(form) == first
    assert made("png") == pixels


def test_an_svg_has_the_size_of_the_sheet_and_is_white():
    [sheet, *_] = sheets()
    root = ET.fromstring(content(sheet, "svg"))
    size = [72 * sheet.width, 72 * sheet.height]
    told = [float(root.get(x).removesuffix("pt")) for x in ("width", "height")]
    assert told == pytest.approx(size, abs=1e-3)
    first = next(root.iter(f"{SVG}path"))
    assert "#ffffff" in first.get("style")
    numbers = np.array(re.findall(r"[\d.]+", first.get("d")), float).reshape(-1, 2)
    assert numbers.min(0).tolist() == [0.0, 0.0]
    assert numbers.max(0).tolist() == pytest.approx(size, abs=1e-3)


@pytest.mark.parametrize("form", [pytest.param("svg", marks=pytest.mark.slow), "pdf"])
def test_files_tell_no_date_and_nobody(form):
    told = re.compile(rb"Date|Producer|Creator|<dc:|[Mm]atplotlib( v|.org)")
    for file in made(form):
        assert not told.search(file)


def test_a_pdf_is_one_page_of_the_size_of_the_sheet():
    for file, sheet in zip(made("pdf"), sheets(), strict=True):
        assert file.startswith(b"%PDF-")
        assert file.rstrip().endswith(b"%%EOF")
        [box] = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", file)
        expected = [72 * sheet.width, 72 * sheet.height]
        assert [float(x) for x in box] == pytest.approx(expected, abs=0.01)


def test_a_line_stands_where_it_stands_in_pixels():
    """The frame of the first panel, from both: inches from the upper left corner."""
    places = {}
    for form, dpi in (("png", 200), ("svg", 72)):
        with noted() as drawing:
            content(sheets()[0], form)
        box = drawing.panels[0].box
        places[form] = [box.x0 / dpi, box.y0 / dpi, box.x1 / dpi, box.y1 / dpi]
    assert places["svg"] == pytest.approx(places["png"], abs=1e-6)
