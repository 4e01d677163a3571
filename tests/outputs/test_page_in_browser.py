"""Drawing of the page in a real browser, against closed forms."""

import math

import numpy as np
import pytest

import lagsim
from lagsim.outputs import animation
from tests.outputs import node
from tests.outputs.browser import Tab, needs_browser, said, shown
from tests.support import MODELS

pytestmark = needs_browser

# Numbers of a page have 24 bits.
ROUNDED = 2.0**-23
# Rows so far apart that a straight line between them would be off by step^2/8 = 0.03.
SPRING = """\
coordinates: {q: {unit: m}}
definitions: {x: q, y: 2*q}
energy: {kinetic: q_dot^2/2, potential: q^2/2}
initial: {q: 1}
simulation: {duration: 10, output_step: 0.5}
"""


def written(text, folder):
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    result.write(folder, plots=False, animate=True)
    assert "animation.html" in result_files(folder)
    return folder / "animation.html"


def result_files(folder):
    return {path.name for path in folder.iterdir()}


# How far the last bar reaches below the upper edge of the controls, before anyone
# scrolls, and how far names and numbers of bars are apart.
MEASURED = """<script>
addEventListener("load", () => {
  const box = (node) => node.getBoundingClientRect();
  const controls = box(document.querySelector("footer")).top;
  const last = [...document.querySelectorAll(".bar")].at(-1);
  document.body.dataset.below = String(box(last).bottom - controls);
  let least = Infinity;
  for (const side of document.querySelectorAll(".side")) {
    const texts = [...side.querySelectorAll("b, span")].map((node) => {
      const range = document.createRange();
      range.selectNodeContents(node);
      return box(range);
    });
    for (const one of texts) for (const other of texts) {
      const across = Math.max(other.left - one.right, one.left - other.right);
      const down = Math.max(other.top - one.bottom, one.top - other.bottom);
      if (one !== other && down < 0) least = Math.min(least, across);
    }
  }
  document.body.dataset.apart = String(least);
});
</script></body>"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [500, 900])
@pytest.mark.parametrize("count", [1, 2])
def test_bars_are_in_the_page_and_their_names_apart(tmp_path, width, count):
    t = np.linspace(0.0, 8.0, 81)
    energies = dict.fromkeys(("kinetic", "lagrangian", "energy", "work"), 0 * t - 1e-9)
    track = ([np.sin(t), 0 * t], [np.cos(t), 0 * t])
    film = node.film(t, {"bob": track}, energies=energies, units={"energy": "J"})
    content = animation.page([animation.record(film)] * count, "film").decode()
    page = tmp_path / "page.html"
    page.write_text(content.replace("</body>", MEASURED), "utf-8")
    found = said(page, tmp_path / "home", "#t=1", f"--window-size={width},940")
    assert float(found["below"]) <= 0
    assert float(found["apart"]) >= 5


@pytest.mark.slow
def test_it_plays_by_itself(tmp_path):
    page = written(SPRING, tmp_path / "results")
    t, points = shown(page, tmp_path / "home", "", "--virtual-time-budget=3000")
    assert 0.0 < t < 10.0
    assert math.isclose(points["point"][0], math.cos(t), abs_tol=0.5**4 / 384)


@pytest.mark.slow
@pytest.mark.parametrize("moment", [1.5, 3.0])
def test_every_model_with_a_scene(tmp_path, moment):
    """All on one page: small enough each, and where their rows say."""
    runs, expected = [], {}
    for path in sorted(MODELS.glob("*.yaml")):
        model = lagsim.load(path)
        if not animation.stage(model).points:
            continue
        result = lagsim.simulate(model, error_bar="never")
        result.write(tmp_path / model.name, plots=False, animate=True)
        content = (tmp_path / model.name / "animation.html").read_text("utf-8")
        assert len(content.encode()) < 3e6
        runs += animation.recorded(content)
        expected |= places(result, model, moment)
    assert len(runs) >= 27
    page = tmp_path / "all.html"
    page.write_bytes(animation.page(runs, "all"))
    t, points = shown(page, tmp_path / "home", f"#t={moment!r}")
    assert t == moment
    moved = {name: place for name, place in expected.items() if place is not None}
    assert len(moved) > 60
    for name, place in moved.items():
        size = max(1e-3, *map(abs, place))
        assert np.allclose(points[name], place, rtol=0, atol=4 * ROUNDED * size), name


def places(result, model, t):
    """Return the places of points of a result at t, or at its end."""
    rows = result._rows
    row = min(np.searchsorted(rows[:, 0], t - 1e-9), len(rows) - 1)
    there = rows[row, 0] >= t or row == len(rows) - 1
    near = abs(rows[row, 0] - t) < 1e-9 or row == len(rows) - 1
    names = result._attempt.session.system.columns.names
    found = {}
    for name, parts in animation.stage(model).points.items():
        columns = [f"point.{name}.{k + 1}" for k in range(len(parts))]
        known = near and there and set(columns) <= set(names)
        place = [float(rows[row, names.index(c)]) for c in columns] if known else None
        found[f"{model.name}/{name}"] = place
    return found


def test_a_picture_keeps_its_proportions_where_numbers_beside_it_grow(tmp_path):
    page = written(f"{SPRING}scene: {{points: {{a: [x, y]}}}}\n", tmp_path / "page")
    canvas = "document.querySelector('.stage canvas')"
    longer = ".forEach((x) => x.append(' of a long unit'))"
    drawn = f"Math.round({canvas}.clientWidth * devicePixelRatio)"
    with Tab(tmp_path / "browser") as tab:
        tab.send("Page.navigate", url=f"{page.as_uri()}#t=1")
        tab.wait(f"document.body?.dataset.t && {canvas}")
        before = tab.run(f"{canvas}.clientWidth")
        tab.run(f"document.querySelectorAll('.bar b'){longer}")
        tab.wait(f"{canvas}.clientWidth < {before} && {canvas}.width === {drawn}")
