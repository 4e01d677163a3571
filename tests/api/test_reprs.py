"""Texts of objects at a prompt, and their pages in a notebook."""

import re

import numpy as np
import pytest

import lagsim
from lagsim.outputs.figure import PlottedColumn, map_figure
from lagsim.outputs.notebook import short_list
from tests.api.test_notebooks import SWING, Texts
from tests.small_scenes import ball

# A chain with many names, each long.
COUNT = 12
NAMES = [f"a_rather_long_name_{k}" for k in range(COUNT)]
MANY = "\n".join(
    [
        "name: many", "coordinates:", *(f"  {q}: {{unit: m}}" for q in NAMES),
        "parameters:", *(f"  p{k}: {k}.5" for k in range(COUNT)), "energy:",
        f"  kinetic: {' + '.join(f'{q}_dot^2' for q in NAMES)}",
        f"  potential: {' + '.join(f'{q}^2' for q in NAMES)}", "initial:",
        *(f"  {q}: 0.1" for q in NAMES), "simulation: {duration: 1}", "",
    ]
)  # fmt: skip


@pytest.fixture(scope="module")
def shown():
    """One of each: of a model that swings, and of one with a great many names."""
    found = {}
    for name, text, swept in (("swing", SWING, "a"), ("many", MANY, "p1")):
        model = lagsim.load(text)
        result = lagsim.simulate(model, error_bar="always", output_step=0.01)
        column = model.coordinates[0].name
        found[name] = {
            "model": model,
            "result": result,
            "error": result.error,
            "spectrum": result.spectrum(column),
            "sweep": lagsim.sweep(model, {swept: np.linspace(1, 2, 3)}, ends=True),
            "examination": lagsim.check(model),
            "derivation": lagsim.derive(model),
            "accelerations": model.rhs,
        }
    found["swing"]["animation"] = found["swing"]["result"].animate()
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["swing", "many"])
def test_each_is_a_few_short_lines(shown, name):
    for kind, thing in shown[name].items():
        lines = repr(thing).split("\n")
        assert len(lines) <= 8, kind
        assert max(map(len, lines)) <= 80, kind
        head = "accelerations" if kind == "accelerations" else kind
        assert lines[0].lower().startswith(f"<{head} of ") or kind == "model"
        assert lines[-1].endswith(">")


def test_a_model_shows_names_values_and_start():
    model = lagsim.load(SWING.replace("name: swing", "parameters: {k: 2.5}\nname: one"))
    assert repr(model).split("\n") == [
        "<Model one <1> & 2",
        "  coordinates  a (rad), z (m)",
        "  parameters   k = 2.5",
        "  constraints  none",
        "  start        a = 1, z = 0, a_dot = 0, z_dot = 1>",
    ]
    assert "k = 9" in repr(model.bind(k=9))


def test_an_error_says_how_large_and_of_what(shown):
    error = shown["swing"]["error"]
    text = repr(error)
    worst = max(error.coordinates, key=lambda q: error.coordinates[q].relative)
    assert text.split("\n")[2].split()[1] == worst
    assert "rad" in text
    assert "at rtol" in text
    assert "horizon  none before the end" in text


def test_a_spectrum_names_its_peaks(shown):
    spectrum = shown["swing"]["spectrum"]
    assert f"{spectrum.rows}, every 0.01 s" in repr(spectrum)
    for peak in spectrum.peaks[:1]:
        assert f"{peak.frequency:.4g} Hz" in repr(spectrum)


def test_a_sweep_shows_what_was_swept(shown):
    lines = repr(shown["swing"]["sweep"]).split("\n")
    assert lines[0] == "<Sweep of swing <1> & 2: 3 of 3 runs complete"
    assert lines[1].split() == ["a", "1,", "1.5,", "2", "rad"]


def test_faults_are_a_line():
    text = MANY.replace("initial:", "initials:").replace("energy:", "energies:")
    with pytest.raises(lagsim.InputError) as raised:
        lagsim.load(text)
    assert len(raised.value.problems) > 1
    assert len(repr(raised.value)) < 320
    assert repr(raised.value).startswith("<InputError: <Problem E")
    for problem in raised.value.problems:
        assert len(repr(problem)) < 250
        assert "\n" not in repr(problem)


def test_an_event_shows_what_is_known_of_it():
    (event, *_) = lagsim.simulate(ball("duration: 1"), error_bar="never").events
    assert "constraint='floor'" in repr(event)
    assert "None" not in repr(event)


def test_what_is_listed_fits():
    names = [f"n{k}" for k in range(1000)]
    for most in (30, 63):
        text = short_list(names, most)
        assert len(text) <= most
        shown, rest = re.fullmatch(r"(.*) and (\d+) more", text).groups()
        assert len(shown.split(", ")) + int(rest) == 1000
    assert short_list([]) == "none"
    assert short_list(["a", "b"]) == "a, b"


PICTURED = {"result", "error", "spectrum", "sweep"}


@pytest.mark.slow
def test_each_has_a_page_and_a_picture_where_there_is_one(shown):
    for kind, thing in shown["swing"].items():
        if kind in ("derivation", "accelerations", "animation"):
            continue
        page = Texts(thing._repr_html_())
        assert ("swing <1> & 2" in " ".join(page.texts)) or kind == "spectrum"
        assert len(page.sources) == (kind in PICTURED)


def test_an_animation_is_the_page_of_the_command_in_a_frame(shown, tmp_path):
    result = shown["swing"]["result"]
    found = result.animate(height=333)
    result.write(tmp_path / "run", animate=True, plots=False)
    page = (tmp_path / "run" / "animation.html").read_text("utf-8")
    assert found.html == page
    found.write(tmp_path / "motion.html")
    assert (tmp_path / "motion.html").read_text("utf-8") == page

    class Frames(Texts):
        def handle_starttag(self, tag, attrs):
            super().handle_starttag(tag, attrs)
            self.attributes = dict(attrs)

    frame = Frames(found._repr_html_())
    assert frame.attributes["srcdoc"] == page
    assert frame.attributes["title"] == "swing <1> & 2"
    assert "height: 333px" in frame.attributes["style"]
    # Scripts run; nothing reaches the notebook.
    assert "allow-scripts" in frame.attributes["sandbox"]
    assert "allow-same-origin" not in frame.attributes["sandbox"]


def test_without_a_scene_there_is_nothing_to_play(shown):
    with pytest.raises(ValueError, match="nothing to draw"):
        shown["many"]["result"].animate()


def test_an_error_is_drawn_of_each_coordinate(shown):
    error = shown["swing"]["error"]
    figure = error.plot()
    assert [axes.get_ylabel() for axes in figure.axes] == ["a (rad)", "z (m)"]
    for axes, errors in zip(figure.axes, error.errors.T, strict=True):
        assert axes.get_yscale() == "log"
        t, values = axes.lines[0].get_data()
        assert np.array_equal(t, error.times)
        assert np.array_equal(values, np.abs(errors))


def test_a_sweep_over_one_name_is_drawn_as_curves():
    found = lagsim.sweep(lagsim.load(SWING), {"a": [3.0, 1, 2]}, ends=True)
    first, second = found.plot("a.end", "z.end").axes
    assert first.get_ylabel() == "a, at the end (rad)"
    assert second.get_xlabel() == "a at the start (rad)"
    x, y = first.lines[0].get_data()
    assert x.tolist() == [1, 2, 3]
    assert y.tolist() == found["a.end"][[1, 2, 0]].tolist()
    assert len(found.plot().axes) == 2
    with pytest.raises(KeyError, match=r"no column `b\.end`"):
        found.plot("b.end")


@pytest.mark.slow
def test_maps_of_constants_are_of_one_colour():
    # What a does not depend on: maps of rounding errors would have patterns.
    text = SWING.replace("name:", "parameters: {u: 1, w: 1}\nname:")
    values = {"u": [1, 2], "w": [1, 2, 3]}
    found = lagsim.sweep(lagsim.load(text), values, ends=True, duration=0.1)
    noise = 1e-13 * np.arange(6)
    figure = map_figure(
        "m", PlottedColumn("u", "", np.arange(3.0)),
        PlottedColumn("w", "", np.arange(4.0)),
        [PlottedColumn("a", "m", (0.3 + noise).reshape(3, 2)),
         PlottedColumn("b", "m", noise.reshape(3, 2) * 1e-3),
         PlottedColumn("c", "m", np.arange(6.0).reshape(3, 2))],
    )  # fmt: skip
    colours = []
    for axes in figure.axes[:3]:
        cells = axes.collections[0]
        cells.update_scalarmappable()
        colours.append(len({tuple(c) for c in cells.get_facecolor()}))
    assert colours == [1, 1, 6]
    low, high = figure.axes[0].collections[0].get_clim()
    assert low < 0.28 < 0.32 < high
    drawn = found.plot("a.end").axes[0].collections[0]
    drawn.update_scalarmappable()
    assert len({tuple(c) for c in drawn.get_facecolor()}) == 1


@pytest.mark.slow
def test_a_sweep_over_two_names_is_drawn_as_maps():
    text = SWING.replace("-9*cos(a)", "-k*cos(a)").replace(
        "name:", "parameters: {k: 9}\nname:"
    )
    values = {"k": [1.0, 10, 1000, 1e5], "a": [0.3, 0.1]}
    found = lagsim.sweep(lagsim.load(text), values, ends=True, duration=0.1)
    figure = found.plot("a.end")
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("k", "a at the start (rad)")
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert bar.get_ylabel() == "a, at the end (rad)"
    cells = axes.collections[0].get_array()
    assert np.array_equal(cells, found["a.end"].reshape(4, 2)[:, ::-1].T)
