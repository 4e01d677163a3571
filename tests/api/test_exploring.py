"""`Model.explore`: the page in a notebook, and the server of models that need one."""

import base64
import hashlib
import json
import urllib.request
import zlib

import pytest

import lagsim
from tests.outputs.browser import Tab, needs_browser
from tests.patience import PATIENCE
from tests.support import MODELS, refused

SWING = """
name: swing
parameters: {g: 9.81, l: {value: 2, unit: m}}
coordinates: {theta: {unit: rad}}
energy: {kinetic: l^2*theta_dot^2/2, potential: -g*l*cos(theta)}
initial: {theta: 0.3}
simulation: {duration: 4, output_step: 0.01}
"""
STOP = "constraints: {stop: {relation: theta >= -0.1, restitution: 0.5}}\n"


@pytest.mark.slow
def test_a_notebook_shows_a_page_that_computes_the_motion():
    page = lagsim.load(SWING).explore()
    shown = page._repr_html_()
    assert shown.startswith('<iframe title="swing"')
    assert "allow-same-origin" not in shown
    assert page.html.startswith("<!DOCTYPE html>")
    assert page.address == page.reason == ""
    assert "swing" in repr(page)


@pytest.mark.slow
def test_the_page_is_written_to_a_file(tmp_path):
    page = lagsim.load(SWING).explore(["l"])
    page.write(tmp_path / "swing.html")
    text = (tmp_path / "swing.html").read_text("utf-8")
    assert text == page.html
    packed = text.split('id="page">')[1].split("</script>")[0].replace(".", "<")
    model = json.loads(zlib.decompress(base64.b85decode(packed)))
    assert [x["name"] for x in model["sliders"]] == ["l"]


def test_a_model_with_a_contact_has_a_server_and_its_address():
    page = lagsim.load(SWING + STOP).explore({"l": (1.0, 3.0)})
    try:
        assert page.html == ""
        assert "`stop`" in page.reason
        assert page.address in page._repr_html_()
        assert page.address in repr(page)
        with urllib.request.urlopen(f"{page.address}model", timeout=20 * PATIENCE) as x:
            [slider] = json.load(x)["sliders"]
        assert (slider["low"], slider["high"]) == (1.0, 3.0)
        with pytest.raises(ValueError, match="stop"):
            page.write("never.html")
    finally:
        page.end()


def test_unknown_names_and_inadmissible_starts_are_errors():
    with refused("unknown-name", "`ll`", kind=lagsim.InputError):
        lagsim.load(SWING).explore(["ll"])
    with refused("inadmissible", "half"):
        lagsim.load(SWING + "constraints: {half: theta = 0.5}\n").explore()


@needs_browser
@pytest.mark.slow
def test_the_page_runs_in_the_frame_of_a_notebook(tmp_path):
    model = lagsim.load(MODELS / "elastic-pendulum.yaml").bind(K=31, theta="pi/8")
    run = lagsim.simulate(model.bind(theta=0.25), error_bar="never")
    script = """<script>addEventListener("message", ({data}) => {
      document.body.dataset.state = data; });</script>"""
    page = model.explore()
    # A script of the frame says what the page shows: nothing else reaches into it.
    report = """setInterval(() => {
      const {state, error} = document.body.dataset;
      if (state) parent.postMessage(error || state, '*');
      const slider = document.querySelector('input[type=range][name=theta]');
      if (!state || slider.done) return;
      slider.done = true;
      document.dispatchEvent(new KeyboardEvent("keydown", {key: "Home"}));
      slider.value = 0.25;
      slider.dispatchEvent(new Event("input"));
    }, 50);"""
    digest = base64.b64encode(hashlib.sha256(report.encode()).digest()).decode()
    page.html = page.html.replace("script-src ", f"script-src 'sha256-{digest}' ", 1)
    page.html = page.html.replace("</body>", f"<script>{report}</script></body>")
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<body>{script}{page._repr_html_()}</body>", encoding="utf-8")
    with Tab(tmp_path / "browser") as tab:
        tab.open(notebook.as_uri())
        tab.wait("JSON.parse(document.body.dataset.state).theta === 0.25")
        assert not tab.messages
        found = tab.state
    for name, value in run.at(found["t"]).items():
        if name in found:
            assert found[name] == pytest.approx(value, rel=1e-12, abs=1e-12)
