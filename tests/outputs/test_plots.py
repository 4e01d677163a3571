"""The pictures of a run: what they say, where it stands, and that it is repeatable."""

from __future__ import annotations

import hashlib
import io
import itertools
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from lagsim.model.model import Curve, Plot, Scene
from lagsim.outputs import plots
from lagsim.outputs.curves import BAND, ink
from lagsim.outputs.figure import DPI, content, fitted, text_width
from lagsim.outputs.plots import chosen, grouped
from lagsim.outputs.scale import value_scale
from lagsim.run.observers.thinning import DRIFT
from tests.outputs import drawn as kit
from tests.outputs.drawn import against, drawn, finite, pixels

UNITS = {"t": "s", "theta": "rad", "u": "m", "energy": "J"}
SWING = Scene({"pivot": (0, 0), "bob": (0, 0)}, (("pivot", "bob"),))
STRANGE = "$x_1^2$ \\frac{a}{b} {%}"


def record(columns, differences=None, **fields):
    return kit.record(columns, differences, **({"units": UNITS} | fields))


def swing(count=600, **more):
    """A pendulum's columns, near enough: the pictures do not care."""
    t = np.linspace(0.0, 12.0, count)
    theta, u = np.sin(2 * t), 0.3 * np.cos(5 * t)
    return {
        "t": t,
        "theta": theta,
        "u": u,
        "kinetic": 1 + np.cos(4 * t),
        "potential": 2 - np.cos(4 * t),
        "energy": 3 + 1e-11 * np.sin(t),
        "Qc_theta": np.cos(t),
        "Qc_u": 1e-7 * t,
        "lambda_path": t**2,
        "point.pivot.1": 0.0,
        "point.pivot.2": 0.0,
        "point.bob.1": (1 + u) * np.sin(theta),
        "point.bob.2": -(1 + u) * np.cos(theta),
        "plot.0.x": theta,
        "plot.0.y.1": u,
        **more,
    }


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
    return record(columns, units={"t": "s"} | dict.fromkeys(names, "rad")), names, scene


def helix():
    t = np.linspace(0.0, 9.0, 500)
    x, y, z = np.cos(3 * t), np.sin(3 * t), 0.2 * t
    points = {"point.bead.1": x, "point.bead.2": y, "point.bead.3": z}
    ground = {"point.o.1": 0.0, "point.o.2": 0.0}
    run = record({"t": t, "x": x, "y": y, "z": z, **points, **ground})
    return run, Scene({"bead": (0, 0, 0), "o": (0, 0)}, (("o", "bead"),))


def all_sheets(run):
    yield energies(run)
    yield plots.trajectory(run, ["theta", "u"], SWING)
    yield plots.constraint_forces(run, ["theta", "u"], ["path"])
    yield plots.plot(run, 0, against("theta", "u", "Path"), Scene({}))


def all_drawings(run):
    yield drawn(energies, run)
    yield drawn(plots.trajectory, run, ["theta", "u"], SWING)
    yield drawn(plots.constraint_forces, run, ["theta", "u"], ["path"])
    yield drawn(plots.plot, run, 0, against("theta", "u", "Path"), Scene({}))


def energies(run, *, is_sum=True):
    return plots.energy(replace(run, is_sum=is_sum))


def written(draw, *args, **kwargs):
    return drawn(draw, *args, **kwargs).written()


def test_a_picture_is_a_png_of_the_drawn_pixels():
    for sheet in all_sheets(record(swing())):
        image = Image.open(io.BytesIO(content(sheet)))
        assert image.info.keys() == {"dpi"}  # and no text
        assert image.size == pytest.approx((7 * DPI, sheet.height * DPI), abs=1)
        assert image.info["dpi"] == pytest.approx((DPI, DPI), abs=0.1)


def test_the_style_of_the_user_does_not_show():
    run = record(swing())
    theirs = {
        "text.usetex": True,
        "font.size": 30,
        "lines.linewidth": 9,
        "axes.unicode_minus": False,
        "path.sketch": (3, 30, 3),
        "text.color": "red",
        "figure.dpi": 30,
    }
    plain = [hashlib.sha256(content(sheet)).digest() for sheet in all_sheets(run)]
    with mpl.rc_context(theirs):
        styled = [hashlib.sha256(content(sheet)).digest() for sheet in all_sheets(run)]
    assert styled == plain


def test_names_units_and_titles_are_written_as_they_are():
    t = np.linspace(0, 1, 20)
    columns = {"t": t, "ab": t, "$x$": t**2, "角": t**3}
    columns |= {"plot.0.x": t, "plot.0.y.1": t, "energy": t}
    run = record(columns, title=STRANGE, units={"ab": "$m$", "$x$": "m^2"})
    sheet = drawn(plots.trajectory, run, ["ab", "$x$", "角"], Scene({}))
    assert {STRANGE, "ab ($m$)", "$x$ (m²)", "角", "t"} <= set(sheet.written())
    own = drawn(
        plots.plot, run, 0, against("$x$^2", "ab*c", f"../{STRANGE}"), Scene({})
    )
    assert {"$x$^2", "ab*c", f"../{STRANGE}"} <= set(own.written())
    for drawing in (sheet, own):
        assert not any(text.typeset for text in drawing.texts)


def drawings_of_every_kind():
    events = record(
        swing(), events={"switch": (1.0, 2.0, 5.5)}, note="step size too small " * 20
    )
    yield from all_drawings(events)
    yield from all_drawings(record(swing(), title="a very long name " * 20))
    yield drawn(energies, record({"t": [0.0, 1.0], "energy": [1.0, 2.0]}), is_sum=False)
    for links in (2, 7, 10, 20, 45):
        run, names, scene = chain(links)
        yield drawn(plots.trajectory, run, names, scene)
        yield drawn(plots.constraint_forces, run, names, [])
    run, scene = helix()
    yield drawn(plots.trajectory, run, ["x", "y", "z"], scene)
    t = np.linspace(1e6, 1e6 + 1e-3, 30)
    scales = {f"{'long_name_' * 9}{k}": 7e6 + 10.0**k * t for k in range(-9, 9)}
    run = record({"t": t, **scales}, units=dict.fromkeys(scales, "kg m^2/s^2"))
    yield drawn(plots.trajectory, run, list(scales), Scene({}))
    yield drawn(plots.trajectory, run, list(scales)[:2], Scene({}))


@pytest.mark.slow
def test_nothing_written_lies_over_data_or_over_other_text():
    for drawing in drawings_of_every_kind():
        width, height = DPI * drawing.sheet.get_size_inches()
        assert drawing.panels
        boxes = [(text.box, text.said) for text in drawing.texts]
        for box, text in boxes:
            assert box.x0 >= 0, text
            assert box.x1 <= width, text
            assert box.y0 >= 0, text
            assert box.y1 <= height, text
            for panel in drawing.panels:
                # Of a view from aside the axes are named where they end.
                aside = not panel.x and not panel.y and text in ("x", "y", "z")
                assert aside or not box.overlaps(panel.box), text
        for (one, text), (other, text2) in itertools.combinations(boxes, 2):
            # The frame of a letter is wider than its ink.
            assert not one.padded(-2).overlaps(other.padded(-2)), (text, text2)


def test_energy_says_which_energy_it_is():
    run = record(swing())
    assert "energy T + V" in written(energies, run)
    said = written(energies, run, is_sum=False)
    assert "energy function h = Σ q̇ ∂L/∂q̇ − L" in said
    t = np.linspace(0, 1, 9)
    other = record({"t": t, "lagrangian": t, "energy": t * 0 + 1})
    said = written(energies, other, is_sum=False)
    assert "lagrangian L" in said
    assert not any(text.startswith(("kinetic", "potential")) for text in said)


@pytest.mark.parametrize(
    ("size", "said"),
    [(1e-6, "1.5 × 10⁻¹²"), (1.0, "1.5 × 10⁻⁶"), (1e6, "1.5")],
)
def test_drift_is_of_energy_minus_work_from_its_start(size, said):
    t = np.linspace(0, 5, 200_001)
    work = size * 100 * np.sin(50 * t)
    columns = {"t": t, "energy": size * (4 - 3e-7 * t) + work, "work": work}
    run = record(columns, differences={DRIFT: ("energy", "work")})
    told = written(energies, run)
    assert f"energy − work minus its first value: at most {said} J" in told
    still = written(energies, record({"t": t, "energy": 0 * t + 2}))
    assert "energy minus its first value: 0 in every row" in still


def test_coordinates_share_a_panel_only_where_it_stays_readable():
    t = np.linspace(0, 1, 50)
    columns = {"t": t, "a": t, "b": 2 * t, "c": 1000 * t, "d": t, "e": t, "f": 9 * t}
    units = {"a": "m", "b": "m", "c": "s", "d": "s"}
    groups = grouped(record(columns, units=units), list("abcdef"))
    assert [" ".join(group) for group in groups] == ["a b", "c", "d", "e", "f"]


@pytest.mark.slow
def test_too_many_coordinates_are_chosen_and_counted():
    run, names, scene = chain(90)
    said = written(plots.trajectory, run, names, scene)
    assert "coordinates: 40 of 90 are shown" in said
    assert {"θ₀ (rad)", "θ₈₉ (rad)"} <= set(said)
    assert chosen(list("abcdefg"), 3) == ["a", "d", "g"]
    forces = written(plots.constraint_forces, run, names, [])
    assert "constraint forces Qc and multipliers λ: 40 of 90 are shown" in forces


def test_scenes_have_equal_scales():
    run, space = helix()
    for drawing, count in (
        (drawn(plots.trajectory, run, ["x"], space), 3),
        (drawn(plots.trajectory, record(swing()), ["u"], SWING), 1),
    ):
        named = [(p, {label[:1] for label in p.labels[:2]}) for p in drawing.panels]
        views = [p for p, axes in named if axes < set("xyz") and len(axes) == 2]
        assert len(views) == count
        units = set()
        for view in views:
            (left, right), (low, high) = view.limits
            units |= {(right - left) / view.box.width, (high - low) / view.box.height}
        # All of them: the views stand side by side, to be measured with one ruler.
        assert max(units) == pytest.approx(min(units))


def test_a_scene_in_space_is_seen_from_aside_too():
    run, space = helix()
    aside = drawn(plots.trajectory, run, ["x"], space).panels[-1]
    assert aside.x == aside.y == []
    (left, right), (low, high) = aside.limits
    scale = (right - left) / aside.box.width
    assert (high - low) / aside.box.height == pytest.approx(scale)
    # A full turn from +x over +y and back, seen from the right of ahead and above.
    [path] = [line for line in aside.lines if len(line.x) == 500]
    x, y, z = (run.rows.sampled(f"point.bead.{k}") for k in (1, 2, 3))
    right = x * np.cos(np.pi / 6) + y * np.sin(np.pi / 6)
    behind = y * np.cos(np.pi / 6) - x * np.sin(np.pi / 6)
    up = z * np.cos(np.pi / 6) + behind * np.sin(np.pi / 6)
    for found, expected in ((path.x, right), (path.y, up)):
        offset = found - expected / scale
        assert np.ptp(offset) < 1.0


@pytest.mark.parametrize(("across", "up"), [(0.2, 1.0), (1.0, 1.0), (3.0, 1.0)])
def test_views_of_scenes_fill_the_sheet(across, up):
    t = np.linspace(0, 6, 300)
    columns = {"t": t, "q": t, "point.a.1": across * np.cos(t)}
    columns["point.a.2"] = up * np.sin(t)
    drawing = drawn(plots.trajectory, record(columns), ["q"], Scene({"a": (0, 0)}))
    _, view = drawing.panels
    assert view.box.x1 > 6.5 * DPI
    path = max(view.lines, key=lambda line: len(line.x))
    sides = np.ptp(path.x) / view.box.width, np.ptp(path.y) / view.box.height
    assert 0.85 < max(sides) < 1.0


def test_a_circle_is_round_in_the_picture():
    t = np.linspace(0, 2 * np.pi, 400)
    columns = {"t": t, "q": t, "point.a.1": 5 + np.cos(t), "point.a.2": np.sin(t)}
    scene = Scene({"a": (0, 0)})
    drawing = drawn(plots.trajectory, record(columns), ["q"], scene)
    seen = pixels(drawing.sheet)
    box = drawing.panels[-1].box
    top = int(len(seen) - box.y1)
    inside = seen[top : int(len(seen) - box.y0), int(box.x0) : int(box.x1)]
    blue = np.argwhere(np.abs(inside - (0x00, 0x72, 0xB2)).sum(axis=2) < 60)
    rows, columns = blue.T
    top_at = columns[rows == rows.min()].mean()
    bottom_at = columns[rows == rows.max()].mean()
    diameter = np.ptp(rows)
    assert diameter > 200
    assert top_at == pytest.approx(bottom_at, abs=2)
    # To the left only: the mark of the start stands at the right.
    assert top_at - columns.min() == pytest.approx(diameter / 2, abs=2)


def test_fast_oscillations_become_bands_that_keep_spikes():
    t = np.arange(100_000) * 0.01
    q = np.cos(t * 3)
    q[54_321] = 4.0
    drawing = drawn(plots.trajectory, record({"t": t, "q": q}), ["q"], Scene({}))
    [panel] = drawing.panels
    [(_, corners)] = panel.areas
    assert not panel.lines
    assert value_scale(np.array([-1.0, 4.0])).high == pytest.approx(4.3)
    # Two hundred pixels are an inch.
    top = panel.box.y1 - panel.box.height * 0.3 / 5.6
    assert corners[:, 1].max() == pytest.approx(top, abs=2.0)
    assert ink(np.linspace(0, 6, 99), np.sin(np.arange(99.0))) < BAND


def test_bands_end_at_gaps():
    t = np.arange(100_000) * 0.01
    q = np.where((t > 400) & (t < 600), np.nan, np.cos(t * 3))
    drawing = drawn(plots.trajectory, record({"t": t, "q": q}), ["q"], Scene({}))
    [panel] = drawing.panels
    assert len(panel.areas) == 2
    across = [(c[:, 0] - panel.box.x0) / panel.box.width for _, c in panel.areas]
    # To a pixel, and to one of the buckets of rows.
    assert across[0].max() == pytest.approx(0.4, abs=2e-3)
    assert across[1].min() == pytest.approx(0.6, abs=2e-3)


def test_gaps_and_single_values_are_drawn():
    t = np.linspace(0, 1, 40)
    gaps = np.where((t > 0.3) & (t < 0.6), np.nan, t)
    alone = np.full(40, np.nan)
    alone[7] = np.inf
    alone[20] = 3.0
    columns = {"t": t, "a": gaps, "b": alone, "c": np.full(40, np.nan)}
    columns |= {"d": 1e308 * np.cos(9 * t), "e": 1e-310 * t, "f": 1e200 * t}
    points = {f"point.p.{k}": alone for k in (1, 2)}
    run = record(columns | points)
    drawing = drawn(plots.trajectory, run, list("abcdef"), Scene({"p": (0, 0)}))
    named = {panel.labels[2][:1]: panel for panel in drawing.panels}
    assert not any(line.marker == "o" for line in named["a"].lines)
    [dot] = [line for line in named["b"].lines if line.marker == "o"]
    (x,), (y,) = finite(dot.x, dot.y)
    box = named["b"].box
    assert (x - box.x0) / box.width == pytest.approx(t[20])
    assert box.y0 < y < box.y1


@pytest.mark.parametrize("count", [0, pytest.param(1, marks=pytest.mark.slow), 2])
def test_runs_that_hardly_began_are_drawn(count):
    columns = {name: np.resize(c, 600)[:count] for name, c in swing().items()}
    for sheet in all_sheets(record(columns, note="stopped at the start")):
        content(sheet)


def test_long_text_is_cut_in_the_middle():
    name = "".join(chr(97 + k % 26) for k in range(300))
    cut = fitted(name, 2.0)
    head, tail = cut.split("…")
    assert name.startswith(head)
    assert name.endswith(tail)
    assert 1.8 < text_width(cut) <= 2.0
    assert fitted("a\nb\tc", 2.0) == "a b c"


def test_a_name_too_long_for_the_side_of_its_panel_stands_above_it():
    t = np.linspace(0, 1, 9)
    names = ["near", "far", "wide", "high", "distancefromtheotherendofthelongerrod"]
    run = record({"t": t} | {n: (k + 1) * t for k, n in enumerate(names)}, units={})
    labels = [p.labels for p in drawn(plots.trajectory, run, names, Scene({})).panels]
    assert [side for _, side, _ in labels] == [*names[:-1], ""]
    assert labels[-1][2] == names[-1]


def test_long_names_share_a_legend():
    texts = ["+".join([letter] * 90) for letter in "uv"]
    t = np.linspace(0, 1, 9)
    run = record({"t": t, "plot.0.x": t, "plot.0.y.1": t, "plot.0.y.2": 2 * t})
    wanted = Plot(Curve(0, "t"), tuple(Curve(0, text) for text in texts))
    found = drawn(plots.plot, run, 0, wanted, Scene({}))
    one, other = [x for x in found.texts if x.said[0] in "uv" and x.said[-1] in "uv"
                  and len({*x.said} & {*"uv"}) == 1]  # fmt: skip
    assert one.box.x1 < other.box.x0 < other.box.x1 < 7 * DPI


def test_paths_are_pale_past_the_horizon():
    run = record(swing())
    coloured = []
    for part in (0.1, 0.5, 1.0):
        seen = replace(run, horizon=part * run.rows.last("t"))
        found = pixels(plots.plot(seen, 0, against("theta", "u"), Scene({})))
        blue = found[:, :, 2] - found[:, :, 0] > 60
        coloured.append(np.sum(blue))
    assert 0 < coloured[0] < 0.5 * coloured[1] < 0.7 * coloured[2]
