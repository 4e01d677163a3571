"""The pictures of a run: their content, its place, and that it is repeatable."""

import functools
import io
import itertools
import re
from dataclasses import replace
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from lagsim.model.model import Scene
from lagsim.outputs import figure, plots
from lagsim.outputs.figure import DPI, encoded_figure
from lagsim.outputs.letters import cut_text
from lagsim.run.observers.thinning import DRIFT
from tests.outputs.drawn import (
    NOWHERE,
    against,
    assert_legible,
    coordinates,
    drawn,
    finite,
    noted,
    pixels,
    plotted,
    record,
)

SWING = Scene({"pivot": (0, 0), "bob": (0, 0)}, (("pivot", "bob"),))
STRANGE = "$x_1^2$ \\frac{a}{b} {%}"
PICTURES = [
    (plots.energy,),
    (plots.trajectory, ["theta", "u"], SWING),
    (plots.constraint_forces, ["theta", "u"], ["path"]),
    (plots.plot, 0, against("theta", "u", title="Path"), NOWHERE),
]


def swing(count=600):
    """A pendulum's columns, near enough: the pictures do not care."""
    t = np.linspace(0.0, 12.0, 600)
    theta, u = np.sin(2 * t), 0.3 * np.cos(5 * t)
    columns = {
        "t": t, "theta": theta, "u": u, "kinetic": 1 + np.cos(4 * t),
        "potential": 2 - np.cos(4 * t), "energy": 3 + 1e-11 * np.sin(t),
        "Qc_theta": np.cos(t), "Qc_u": 1e-7 * t, "lambda_path": t**2,
        "point.pivot.1": 0.0 * t, "point.pivot.2": 0.0 * t,
        "point.bob.1": (1 + u) * np.sin(theta), "plot:0.x": theta,
        "point.bob.2": -(1 + u) * np.cos(theta), "plot:0.y.1": u,
    }  # fmt: skip
    return {name: column[:count] for name, column in columns.items()}


def chain(links, count=300):
    t = np.linspace(0.0, 5.0, count)
    columns = {"t": t, "point.p0.1": 0.0, "point.p0.2": 0.0}
    names = [f"theta_{k}" for k in range(links)]
    x = y = 0.0
    for k, name in enumerate(names):
        columns[name] = np.sin((1 + k / links) * t + k)
        columns[f"Qc_{name}"] = 10.0 ** (k % 9 - 4) * np.cos(k * t)
        x, y = x + np.sin(columns[name]), y - np.cos(columns[name])
        columns[f"point.p{k + 1}.1"], columns[f"point.p{k + 1}.2"] = x, y
    points = {f"p{k}": (0, 0) for k in range(links + 1)}
    scene = Scene(points, tuple(itertools.pairwise(points)))
    run = record(columns, units={"t": "s"} | dict.fromkeys(names, "rad"))
    yield drawn(plots.trajectory, run, names, scene)
    yield drawn(plots.constraint_forces, run, names, [])


def helix():
    t = np.linspace(0.0, 9.0, 500)
    x, y, z = np.cos(3 * t), np.sin(3 * t), 0.2 * t
    columns = {"t": t, "x": x, "point.bead.1": x, "point.bead.2": y, "point.bead.3": z}
    columns |= {"point.o.1": 0.0, "point.o.2": 0.0}
    scene = Scene({"bead": (0, 0, 0), "o": (0, 0)}, (("o", "bead"),))
    return (x, y, z), coordinates(columns, ["x"], scene)


def one_sheet(k, **fields):
    draw, *more = PICTURES[k]
    return draw(record(swing(), **fields), *more)


def drawings(**fields):
    run = record(swing(), **fields)
    return [drawn(draw, run, *more) for draw, *more in PICTURES]


# --- Files


def made_anew(form, count=None):
    few = range(len(PICTURES))[:count]
    return [encoded_figure(one_sheet(k, horizon=9.0), form) for k in few]


made = functools.cache(made_anew)


@pytest.mark.slow
def test_a_picture_is_a_png_of_the_drawn_pixels():
    for k, file in enumerate(made("png", 2)):
        sheet = one_sheet(k, horizon=9.0)
        image = Image.open(io.BytesIO(file))
        assert image.info.keys() == {"dpi"}  # and no text
        size = sheet.get_size_inches() * DPI
        assert image.size == pytest.approx(tuple(size), abs=1)
        assert image.info["dpi"] == pytest.approx((DPI, DPI), abs=0.1)


@pytest.mark.slow
def test_an_svg_has_the_size_of_the_sheet_and_is_white():
    sheet = one_sheet(0)
    root = ET.fromstring(encoded_figure(sheet, "svg"))
    size = pytest.approx(list(72 * sheet.get_size_inches()), abs=1e-3)
    assert [float(root.get(x).removesuffix("pt")) for x in ("width", "height")] == size
    first = next(root.iter("{http://www.w3.org/2000/svg}path"))
    assert "#ffffff" in first.get("style")
    numbers = np.array(re.findall(r"[\d.]+", first.get("d")), float).reshape(-1, 2)
    assert numbers.min(0).tolist() == [0.0, 0.0]
    assert numbers.max(0).tolist() == size


@pytest.mark.slow
def test_a_pdf_is_one_page_of_the_size_of_the_sheet():
    pairs = zip(made("pdf", 2), (0, 1), strict=True)
    for file, sheet in ((file, one_sheet(k, horizon=9.0)) for file, k in pairs):
        assert file.startswith(b"%PDF-")
        assert file.rstrip().endswith(b"%%EOF")
        [box] = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", file)
        expected = list(72 * sheet.get_size_inches())
        assert [float(x) for x in box] == pytest.approx(expected, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "count"),
    [("pdf", 2), *(pytest.param(x, 4, marks=pytest.mark.slow) for x in ("pdf", "svg"))],
)
def test_files_for_print_are_the_same_again_and_tell_no_date_and_nobody(form, count):
    first, _ = made(form, count), encoded_figure(one_sheet(0), "png")
    assert made_anew(form, count) == first
    told = re.compile(rb"Date|Producer|Creator|<dc:|[Mm]atplotlib( v|.org)")
    assert not any(told.search(file) for file in first)


@pytest.mark.slow
def test_a_line_stands_where_it_stands_in_pixels():
    """The frame of the first panel, from both: inches from the upper left corner."""
    places = []
    for form, dpi in (("png", DPI), ("svg", 72)):
        with noted() as drawing:
            encoded_figure(one_sheet(0), form)
        box = drawing.panels[0].box
        places.append(np.array([box.x0, box.y0, box.x1, box.y1]) / dpi)
    assert np.allclose(*places, rtol=0, atol=1e-6)


def test_a_level_curve_is_level_between_two_pixels():
    axes = (sheet := figure.Picture(2.0, "level")).subplots()
    axes.set_axis_off()
    sheet.settle()
    x = np.linspace(0, 1, 50)
    low, high = axes.transAxes.transform([[0, 0], [0, 1]])[:, 1]
    middle = (np.floor(0.5 * (low + high)) + 0.5 - low) / (high - low)
    figure.curve(axes, x, middle + 1e-13 * np.cos(9 * np.arange(50)), figure.BLACK)
    seen = pixels(sheet)[150:, 200:500, 0]
    assert (seen < 128).any()
    assert not np.ptp(seen, axis=1).any()


@pytest.mark.slow
def test_numbers_of_charts_count_in_the_power_at_their_axis():
    t = np.arange(5.0)
    across, up = (
        figure.PlottedColumn("t", "s", t),
        figure.PlottedColumn("x", "m", 1e-10 * t),
    )
    [axes] = (sheet := figure.figure("x", across, [up])).axes
    encoded_figure(sheet)
    assert axes.get_ylabel() == "x (10⁻¹⁰ m)"
    assert not axes.yaxis.get_offset_text().get_visible()


@pytest.mark.slow
def test_a_part_of_the_energy_that_is_the_whole_is_seen():
    t = np.linspace(0, 1, 9)
    whole, none = np.ones_like(t), np.zeros_like(t)
    parts = {"t": t, "kinetic": whole, "potential": none, "energy": whole}
    seen = pixels(plots.energy(record(parts)))
    blue = np.abs(seen - [0, 0x72, 0xB2]).max(axis=2) < 24
    assert blue.sum(axis=0).astype(bool).mean() > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_the_style_of_the_user_does_not_show(count):
    theirs = {
        "text.usetex": True, "font.size": 30, "lines.linewidth": 9, "figure.dpi": 30,
        "axes.unicode_minus": False, "path.sketch": (3, 30, 3), "text.color": "red",
    }  # fmt: skip
    plain = made("png", count)
    with mpl.rc_context(theirs):
        assert made_anew("png", count) == plain


# --- Words


@pytest.mark.slow
def test_names_units_and_titles_are_written_as_they_are():
    t = np.linspace(0, 1, 20)
    columns = {"t": t, "ab": t, "$x$": t**2, "角": t**3}
    columns |= {"plot:0.x": t, "plot:0.y.1": t}
    fields = {"title": STRANGE, "units": {"ab": "$m$", "$x$": "m^2"}}
    sheet = coordinates(columns, ["ab", "$x$", "角"], **fields)
    assert {"ab ($m$)", "$x$ (m²)", "角", "t"} <= set(sheet.written())
    assert sheet.title == f"{STRANGE}: coordinates"
    wanted = against("$x$^2", "ab*c", title=f"../{STRANGE}")
    own = plotted(columns, wanted, **fields)
    assert {"$x$^2", "ab*c"} <= set(own.written())
    assert own.title == f"{STRANGE}: ../{STRANGE}"
    assert not any(text.typeset for text in (*sheet.texts, *own.texts))


def drawings_of_every_kind():
    events = {"switch": (1.0, 2.0, 5.5)}
    yield from drawings(events=events, note="step size too small " * 20)
    yield from drawings(title="a very long name " * 20)
    short = record({"t": [0.0, 1.0], "energy": [1.0, 2.0]}, is_sum=False)
    yield drawn(plots.energy, short)
    for links in (2, 7, 10, 20, 45):
        yield from chain(links)
    yield helix()[1]
    t = np.linspace(1e6, 1e6 + 1e-3, 30)
    scales = {f"{'long_name_' * 9}{k}": 7e6 + 10.0**k * t for k in range(-9, 9)}
    for names in (list(scales), list(scales)[:2]):
        units = dict.fromkeys(scales, "kg m^2/s^2")
        yield coordinates({"t": t, **scales}, names, units=units)


@pytest.mark.slow
def test_nothing_written_lies_over_data_or_over_other_text():
    for drawing in drawings_of_every_kind():
        assert_legible(drawing)


@pytest.mark.slow
def test_energy_says_which_energy_it_is():
    run = record(swing())
    assert "energy T + V" in drawn(plots.energy, run).written()
    said = drawn(plots.energy, replace(run, is_sum=False)).written()
    assert "energy function h = Σ q̇ ∂L/∂q̇ − L" in said
    t = np.linspace(0, 1, 9)
    other = record({"t": t, "lagrangian": t, "energy": t * 0 + 1}, is_sum=False)
    said = drawn(plots.energy, other).written()
    assert "lagrangian L" in said
    assert not any(text.startswith(("kinetic", "potential")) for text in said)
    assert "energy minus its first value: 0 in every row" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "said"), [(1e-6, "1.5 × 10⁻¹²"), (1.0, "1.5 × 10⁻⁶"), (1e6, "1.5")]
)
def test_drift_is_of_energy_minus_work_from_its_start(size, said):
    t = np.linspace(0, 5, 200_001)
    work = size * 100 * np.sin(50 * t)
    columns = {"t": t, "energy": size * (4 - 3e-7 * t) + work, "work": work}
    run = record(columns, differences={DRIFT: ("energy", "work")})
    told = drawn(plots.energy, run).written()
    assert f"energy − work minus its first value: at most {said} J" in told


@pytest.mark.slow
def test_too_many_coordinates_are_chosen_and_counted():
    shown, forces = chain(90)
    assert shown.title == "swing: coordinates: 40 of 90 are shown"
    assert {"θ₀ (rad)", "θ₈₉ (rad)"} <= set(shown.written())
    assert forces.title.endswith("multipliers λ: 40 of 90 are shown")


def test_long_text_is_cut_in_the_middle():
    name = "".join(chr(97 + k % 26) for k in range(300))
    cut = cut_text(name, 30)
    head, tail = cut.split("…")
    assert name.startswith(head)
    assert name.endswith(tail)
    assert len(cut) == 30
    assert cut_text("a\nb\tc", 30) == "a b c"


@pytest.mark.slow
def test_a_name_too_long_for_the_side_of_its_panel_stands_above_it():
    t = np.linspace(0, 1, 9)
    names = ["near", "far", "wide", "high", "distancefromtheotherendofthelongerrod"]
    columns = {"t": t} | {n: (k + 1) * t for k, n in enumerate(names)}
    labels = [p.labels for p in coordinates(columns, names, units={}).panels]
    assert [side for _, side, _ in labels] == [*names[:-1], ""]
    assert labels[-1][2] == names[-1]


@pytest.mark.parametrize(
    "count", [4, *(pytest.param(n, marks=pytest.mark.slow) for n in (16, 40))]
)
def test_numbers_of_panels_side_by_side_have_room(count):
    t = np.linspace(0, 1, 9)
    sizes = [0.0515, 0.1285, 12.4, -0.41, 1e3, 1e5, 3e-3, 0.9995]
    names = [f"x{k}" for k in range(count)]
    columns = {"t": t} | {
        name: sizes[k % len(sizes)] * (1 + 2e-3 * t) for k, name in enumerate(names)
    }
    found = coordinates(columns, names, units=dict.fromkeys(names, "m"))
    assert not any("…" in text.said for text in found.texts)
    for text in found.texts:
        assert text.box.x1 < 7 * DPI
        assert not any(panel.box.overlaps(text.box) for panel in found.panels), text


@pytest.mark.slow
def test_long_names_share_a_legend():
    t = np.linspace(0, 1, 9)
    columns = {"t": t, "plot:0.x": t, "plot:0.y.1": t, "plot:0.y.2": 2 * t}
    found = plotted(columns, against("t", *("+".join([x] * 90) for x in "uv")))
    one, other = [x for x in found.texts if x.said[0] in "uv" and x.said[-1] in "uv"
                  and len({*x.said} & {*"uv"}) == 1]  # fmt: skip
    assert not one.box.overlaps(other.box)
    assert max(one.box.x1, other.box.x1) < 7 * DPI
    assert_legible(found)


# --- Scenes


def scales_of(panel):
    """Return the units per pixel of both axes."""
    (left, right), (low, high) = panel.limits
    return (right - left) / panel.box.width, (high - low) / panel.box.height


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3])
def test_scenes_have_equal_scales(count):
    drawing = helix()[1] if count == 3 else drawings()[1]
    named = [(p, {label[:1] for label in p.labels[:2]}) for p in drawing.panels]
    views = [p for p, axes in named if axes < set("xyz") and len(axes) == 2]
    assert len(views) == count
    # All of them: the views stand side by side, to be measured with one ruler.
    units = [unit for view in views for unit in scales_of(view)]
    assert max(units) == pytest.approx(min(units))


@pytest.mark.slow
def test_a_scene_in_space_is_seen_from_aside_too():
    (x, y, z), drawing = helix()
    aside = drawing.panels[-1]
    assert aside.x == aside.y == []
    scale, other = scales_of(aside)
    assert other == pytest.approx(scale)
    # A full turn from +x over +y and back, seen from the right of ahead and above.
    [path] = [line for line in aside.lines if len(line.x) == 500]
    right = x * np.cos(np.pi / 6) + y * np.sin(np.pi / 6)
    behind = y * np.cos(np.pi / 6) - x * np.sin(np.pi / 6)
    up = z * np.cos(np.pi / 6) + behind * np.sin(np.pi / 6)
    for found, expected in ((path.x, right), (path.y, up)):
        assert np.ptp(found - expected / scale) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("across", [0.2, 1.0, 3.0])
def test_views_of_scenes_fill_the_sheet(across):
    t = np.linspace(0, 6, 300)
    columns = {"t": t, "q": t, "point.a.1": across * np.cos(t), "point.a.2": np.sin(t)}
    _, view = coordinates(columns, ["q"], Scene({"a": (0, 0)})).panels
    assert view.box.x1 > 6.5 * DPI
    path = max(view.lines, key=lambda line: len(line.x))
    sides = np.ptp(path.x) / view.box.width, np.ptp(path.y) / view.box.height
    assert 0.85 < max(sides) < 1.0


@pytest.mark.slow
def test_a_path_along_an_axis_is_a_line_however_often_it_is_gone():
    t = np.linspace(0.0, 40.0, 4000)
    height = np.abs(np.sin(t))
    columns = {"t": t, "y": height, "point.b.1": 0.0 * t, "point.b.2": height}
    view = coordinates(columns, ["y"], Scene({"b": (0, 0)})).panels[1]
    paths = [line for line in view.lines if len(line.x) == len(t)]
    assert [line.dots for line in paths] == [False]


@pytest.mark.slow
def test_paths_are_pale_past_the_horizon():
    coloured = []
    for part in (0.1, 0.5, 1.0):
        found = pixels(one_sheet(3, horizon=part * 12.0))
        coloured.append(np.sum(found[:, :, 2] - found[:, :, 0] > 60))
    assert 0 < coloured[0] < 0.5 * coloured[1] < 0.7 * coloured[2]


# --- Bands, gaps, few rows


def test_fast_oscillations_become_bands_that_keep_spikes():
    t = np.arange(100_000) * 0.01
    q = np.cos(t * 3)
    q[54_321] = 4.0
    [panel] = coordinates({"t": t, "q": q}, ["q"]).panels
    [(_, corners)] = panel.areas
    assert not panel.lines
    # From -1 to 4, and a margin of 0.3 to both sides.
    top = panel.box.y1 - panel.box.height * 0.3 / 5.6
    assert corners[:, 1].max() == pytest.approx(top, abs=2.0)


@pytest.mark.slow
def test_bands_end_at_gaps():
    t = np.arange(100_000) * 0.01
    q = np.where((t > 400) & (t < 600), np.nan, np.cos(t * 3))
    [panel] = coordinates({"t": t, "q": q}, ["q"]).panels
    (_, one), (_, other) = panel.areas
    # To a pixel, and to one of the buckets of rows.
    near = 2e-3 * panel.box.width
    assert one[:, 0].max() == pytest.approx(panel.at(400), abs=near)
    assert other[:, 0].min() == pytest.approx(panel.at(600), abs=near)


@pytest.mark.slow
def test_fast_swings_are_the_band_that_they_fill():
    """Of a steady amplitude: level, without a pattern of pixels and turns."""
    t = np.linspace(0.0, 1.0, 40_000)
    for swings in (150, 333, 999):
        [panel] = coordinates({"t": t, "y": np.sin(2 * np.pi * swings * t)}, "y").panels
        [(_, corners)] = panel.areas
        top = corners[corners[:, 1] > panel.box.y0 + 0.5 * panel.box.height]
        assert np.ptp(top[:, 1]) < 0.02 * panel.box.height


@pytest.mark.slow
def test_gaps_and_single_values_are_drawn():
    t = np.linspace(0, 1, 40)
    alone = np.full(40, np.nan)
    alone[7], alone[20] = np.inf, 3.0
    columns = {"t": t, "a": np.where((t > 0.3) & (t < 0.6), np.nan, t), "b": alone}
    columns |= {"c": np.full(40, np.nan), "d": 1e308 * np.cos(9 * t)}
    columns |= {"e": 1e-310 * t, "f": 1e200 * t, "point.p.1": alone, "point.p.2": alone}
    drawing = coordinates(columns, "abcdef", Scene({"p": (0, 0)}))
    named = {panel.labels[2][:1]: panel for panel in drawing.panels}
    assert not any(line.marker == "o" for line in named["a"].lines)
    panel = named["b"]
    [dot] = [line for line in panel.lines if line.marker == "o"]
    (x,), (y,) = finite(dot.x, dot.y)
    assert x == pytest.approx(panel.at(t[20]))
    assert panel.box.y0 < y < panel.box.y1


@pytest.mark.slow
@pytest.mark.parametrize(
    "count", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))]
)
def test_runs_that_hardly_began_are_drawn(count):
    run = record(swing(count), note="stopped at the start")
    for draw, *more in PICTURES:
        assert encoded_figure(draw(run, *more)).startswith(b"\x89PNG")
