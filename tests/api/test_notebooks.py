"""Output in notebooks: figures, small pages, formulas."""

import base64
import json
import re
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure

import lagsim
from tests.cli.conftest import lagsim as command  # noqa: F401
from tests.small_scenes import escape
from tests.support import MODELS, ROOT, simulate

SWING = """
name: swing <1> & 2
coordinates: {a: {unit: rad}, z: {unit: m}}
definitions: {x: {value: sin(a), unit: m}, y: {value: -cos(a), unit: m}}
energy: {kinetic: a_dot^2/2 + z_dot^2, potential: -9*cos(a)}
initial: {a: 1, z: 0, z_dot: 1}
simulation: {duration: 2, output_step: 0.01}
"""


@pytest.fixture(scope="module")
def result():
    return lagsim.simulate(lagsim.load(SWING), error_bar="never")


class Texts(HTMLParser):
    """The texts of a page, and that all that is opened is closed."""

    def __init__(self, page):
        super().__init__()
        self.open, self.texts, self.sources = [], [], []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.sources.append(dict(attrs)["src"])
        else:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts += [data] if data.strip() else []


def lines_of(axes):
    return {line.get_label(): line for line in axes.lines}


def test_columns_are_drawn_to_the_bit(result):
    figure = result.plot("a", "x", "z", "kinetic", "energy")
    assert isinstance(figure, Figure)
    first, second, third = figure.axes
    assert [list(lines_of(axes)) for axes in figure.axes] == [
        ["a"], ["x", "z"], ["kinetic", "energy"],
    ]  # fmt: skip
    for axes in figure.axes:
        for name, line in lines_of(axes).items():
            t, values = line.get_data()
            assert np.array_equal(t, result.t)
            assert np.array_equal(values, result[name])
    assert first.get_ylabel() == "a (rad)"
    assert (second.get_ylabel(), third.get_xlabel()) == ("m", "t (s)")
    assert [text.get_text() for text in second.get_legend().get_texts()] == ["x", "z"]
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_without_names_it_is_the_coordinates(result):
    assert [list(lines_of(a)) for a in result.plot().axes] == [["a"], ["z"]]


def test_a_path_is_drawn_at_equal_scales(result):
    [axes] = result.plot("y", against="x").axes
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")
    [axes] = result.plot("y", against="a").axes
    assert axes.get_aspect() == "auto"


ORBIT = """
name: orbit
coordinates: {x: {unit: m}, y: {unit: m}, z: {}}
definitions: {r: "hypot(x, y)"}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: (x^2 + y^2)/2 + 10*z}
constraints: {floor: {relation: z >= 0, restitution: 0.5}}
initial: {x: 1, y: 0, y_dot: 1, z: 5}
simulation: {duration: 1.9, output_step: 0.25}
"""


@pytest.mark.slow
def test_a_path_of_few_rows_is_smooth_and_passes_through_them():
    orbit = simulate(lagsim.load(ORBIT))
    [axes] = orbit.plot("y", against="x").axes
    x, y = axes.lines[0].get_data()
    # A circle, of which the rows are ten corners.
    assert len(orbit.t) < 12 < 1500 < len(x)
    assert np.hypot(x, y) == pytest.approx(1.0, abs=1e-9)
    assert np.max(np.hypot(np.diff(x), np.diff(y))) < 0.01
    for a, b in zip(orbit["x"], orbit["y"], strict=True):
        assert np.any((x == a) & (y == b))
    # An impact at t = 1 keeps both of its rows, with nothing between them.
    [axes] = orbit.plot("z_dot", against="z").axes
    z, speed = axes.lines[0].get_data()
    (k,) = np.flatnonzero(np.diff(speed) > 5.0)
    assert (z[k], z[k + 1]) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert (speed[k], speed[k + 1]) == pytest.approx((-10.0, 5.0))
    # Against the time rows are rows.
    [axes] = orbit.plot("z").axes
    assert np.array_equal(axes.lines[0].get_data()[1], orbit["z"])


@pytest.mark.slow
def test_a_spectrum_is_titled_by_model_and_column():
    found = simulate(lagsim.load(ORBIT), output_step=0.01).spectrum("x")
    for title, wanted in (
        ("", "orbit: spectrum of x"),
        ("mine", "mine: spectrum of x"),
    ):
        figure = found.plot(title) if title else found.plot()
        assert figure.legends[0].get_title().get_text() == wanted
    figure = found._replace(model="").plot()
    assert figure.legends[0].get_title().get_text() == "spectrum of x"


def test_constants_are_level():
    steady = simulate(lagsim.load(ORBIT))
    [axes] = steady.plot("r").axes
    low, high = axes.get_ylim()
    assert low < 0.95 < 1.05 < high


def test_columns_that_are_not_there_are_told(result):
    for call in (lambda: result.plot("q"), lambda: result.plot("a", against="q")):
        with pytest.raises(KeyError, match="there is no column `q`"):
            call()


@pytest.mark.slow
@pytest.mark.drawn
def test_a_result_in_a_line_and_on_a_page(result, tmp_path):
    assert repr(result) == "<Result of swing <1> & 2: done, t = 0 to 2, 201 rows>"
    page = Texts(result._repr_html_())
    assert page.texts[:3] == ["swing <1> & 2", "outcome", "done"]
    said = dict(zip(page.texts[1::2], page.texts[2::2], strict=True))
    assert said["rows"] == "t = 0 to 2, 201 rows"
    assert said["error"] == "not estimated"
    [source] = page.sources
    result.write(tmp_path)
    drawn = base64.b64decode(source.removeprefix("data:image/png;base64,"))
    assert drawn == (tmp_path / "trajectory.png").read_bytes()


def test_warnings_and_failures_stand_on_the_page():
    failed = lagsim.simulate(escape("duration: 2, output_step: 0.05"))
    page = Texts(failed._repr_html_())
    assert page.texts[2] == "failed"
    assert failed.reason in page.texts
    assert all(caution.text in page.texts for caution in failed.warnings)


def test_a_frame_has_columns_and_units(result):
    pytest.importorskip("pandas", reason="needs pandas")
    frame = result.to_dataframe()
    assert tuple(frame.columns) == result.columns
    assert np.array_equal(frame.to_numpy(), result.table)
    assert frame.attrs["units"]["a_dot"] == "rad/s"


def test_a_frame_says_what_it_needs(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        result.to_dataframe()


def test_an_examination_in_a_line_and_on_a_page():
    path = MODELS / "pendulum-cartesian.yaml"
    good, bad = lagsim.check(lagsim.load(path)), lagsim.check(lagsim.load(path, x=2))
    name = "pendulum-cartesian"
    assert repr(good) == f"<Examination of {name}: admissible, 1 degree of freedom>"
    assert "not admissible" in repr(bad)
    page = Texts(bad._repr_html_())
    at = page.texts.index("rod")
    assert page.texts[at : at + 4] == ["rod", "holonomic", "3", "no"]
    [(moved, value)] = bad.repair.items()
    at = page.texts.index("the nearest start")
    assert page.texts[at + 1 :] == [moved, repr(value)]
    assert "the nearest start" not in Texts(good._repr_html_()).texts
    assert {"admissible", "rank"} <= set(dir(good))


def test_a_derivation_is_that_of_the_command(command):  # noqa: F811
    path = str(MODELS / "elastic-pendulum-curve.yaml")
    found = lagsim.derive(lagsim.load(path), substitute=True)
    assert repr(found) == "<Derivation of elastic-pendulum-curve>"
    told = {form: command("derive", path, "--substitute", "--format", form).out
            for form in ("text", "latex", "json")}  # fmt: skip
    assert (str(found), found.latex) == (told["text"], told["latex"])
    assert found.json == json.loads(told["json"])
    assert found.python == command("derive", path, "--format", "python").out


FORMULA = re.compile(r"\\begin\{align\*\}.*?\\end\{align\*\}|\\\[(.*?)\\\]", re.DOTALL)


@pytest.mark.parametrize("name", ["elastic-pendulum-curve", "heavy-top"])
def test_a_notebook_typesets_all_formulas(name):
    found = lagsim.derive(lagsim.load(MODELS / f"{name}.yaml"))
    markdown = found._repr_markdown_()
    rest = markdown
    for formula in FORMULA.finditer(found.latex):
        shown = formula[0] if formula[1] is None else f"$$\n{formula[1].strip()}\n$$"
        before, once, rest = rest.partition(shown)
        assert once
        # Text has no LaTeX left but within single dollars.
        assert not re.search(r"\\[a-z]", re.sub(r"\$[^$]+\$", "", before))
    heads = re.findall(r"\\subsection\*\{(.*)\}", found.latex)
    assert re.findall(r"^#### (.*)$", markdown, re.MULTILINE) == heads
    assert markdown.startswith(f"### {name}\n")


def test_stars_and_signs_in_texts_are_no_markup():
    text = SWING.replace("name: swing <1> & 2", "name: a\ndescription: r*s*t_u `x`")
    markdown = lagsim.derive(lagsim.load(text)).markdown
    assert r"r\*s\*t\_u" in markdown


def test_the_names_are_there_before_they_are_loaded():
    assert {*lagsim.__all__} <= {x for x in dir(lagsim) if getattr(lagsim, x)}
    assert not {path.stem for path in (ROOT / "lagsim").iterdir()} & {*lagsim.__all__}
    with pytest.raises(AttributeError, match="no attribute `simulat`"):
        _ = lagsim.simulat
