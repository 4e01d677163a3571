"""The live page in a browser, against runs of its model."""

import contextlib
import math
import os
import re
import signal
import subprocess
import sys
import time

import pytest

import lagsim
from tests.outputs.browser import RefusedError, Tab, needs_browser
from tests.patience import PATIENCE
from tests.studies.explore.test_explorer import OSCILLATOR
from tests.support import MODELS, ROOT

pytestmark = [needs_browser, pytest.mark.slow]


@contextlib.contextmanager
def served(model, *options):
    """Run the command; return its process and the address that it prints."""
    command = [sys.executable, "-m", "lagsim", "explore", str(model), "--no-browser"]
    found = subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
    )
    try:
        [address] = re.findall(rb"http://\S+", found.stdout.readline())
        yield found, address.decode()
    finally:
        found.kill()
        found.communicate()


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    with Tab(tmp_path_factory.mktemp("browser")) as made:
        yield made


def same(found, run, t):
    """Whether a state is that of a run at a time, to 1e-9 of the ranges."""
    expected = run.at(t)
    for name, value in found.items():
        column = run[name]
        extent = max(float(column.max() - column.min()), 1e-300)
        assert abs(value - expected[name]) <= 1e-9 * extent, name


EVERY = sorted(path.name for path in MODELS.glob("*.yaml"))
# Chaos past some time multiplies rounding errors; times within their horizons.
EARLY = {"bouncing-ball.yaml": 0.3}


@pytest.mark.parametrize("name", EVERY)
def test_a_shipped_model_moves_as_its_run_does(tab, name):
    model = lagsim.load(MODELS / name)
    run = lagsim.simulate(model, error_bar="never")
    t = float(run["t"][0] + EARLY.get(name, 0.1) * (run["t"][-1] - run["t"][0]))
    with served(MODELS / name) as (_, address):
        tab.open(address)
        assert not tab.error
        found = tab.run(f"lagsim.advance({t!r})")
        assert found == tab.state
        assert found["t"] == t
        same(found, run, t)
        assert float(tab.run("document.body.dataset.t")) == t
        assert not tab.messages


def test_set_gives_the_run_with_these_values(tab):
    with served(MODELS / "elastic-pendulum.yaml") as (_, address):
        tab.open(address)
        tab.run("lagsim.advance(2)")
        tab.run("lagsim.set({K: 30, theta: 'pi/5'})")
        run = lagsim.simulate(
            lagsim.load(MODELS / "elastic-pendulum.yaml", K=30, theta="pi/5"),
            error_bar="never",
        )
        # The time that was shown is kept.
        assert tab.state["t"] == 2.0
        same(tab.state, run, 2.0)
        same(tab.run("lagsim.advance(1e9)"), run, run["t"][-1])
        assert "K=30" in tab.run("location.hash")


def test_what_is_refused_leaves_the_state_and_does_not_stick(tab):
    with served(MODELS / "elastic-pendulum.yaml") as (_, address):
        tab.open(address)
        tab.run("lagsim.advance(1)")
        before = tab.state
        for values in (
            "{nothing: 1}", "{K: '1/0'}", "{K: NaN}", "{K: 'alert(1)'}", "{K: null}",
            "{K: ''}", "{K: {}}", "{K: 1e308}", "{K: '1,5'}",
        ):  # fmt: skip
            with pytest.raises(RefusedError):
                tab.run(f"lagsim.set({values})")
            assert tab.error
            assert tab.state == before
        tab.run("lagsim.set({K: 25})")
        assert not tab.error
        assert tab.run("location.hash") == "#K=25&t=1"


def test_the_address_holds_settings_and_time(tab):
    with served(MODELS / "elastic-pendulum.yaml") as (_, address):
        tab.open(f"{address}#K=30&theta=pi%2F5&t=1.5")
        run = lagsim.simulate(
            lagsim.load(MODELS / "elastic-pendulum.yaml", K=30, theta="pi/5"),
            error_bar="never",
        )
        tab.wait("JSON.parse(document.body.dataset.state).t === 1.5")
        same(tab.run("lagsim.advance(1.5)"), run, 1.5)
        tab.run("document.getElementById('reset').click()")
        tab.wait("location.hash === '#t=1.5'")
        tab.run("lagsim.advance(1.5)")
        same(tab.state, lagsim.simulate(MODELS / "elastic-pendulum.yaml"), 1.5)


def test_sliders_and_fields_have_names_ends_and_set_values(tab):
    with served(MODELS / "elastic-pendulum.yaml", "--vary", "K=5:50") as (_, address):
        tab.open(address)
        inputs = "[...document.querySelectorAll('input')]"
        assert tab.run(f"{inputs}.map((x) => [x.name, x.type])") == [
            ["K", "text"], ["K", "range"]
        ]  # fmt: skip
        slider = "document.querySelector('input[type=range]')"
        assert tab.run(f"[{slider}.min, {slider}.max]") == ["5", "50"]
        tab.run(f"{slider}.value = 40, {slider}.dispatchEvent(new Event('input'))")
        tab.wait("location.hash === '#K=40'")
        assert tab.run("document.querySelector('input[type=text]').value") == "40"
        buttons = tab.run(
            "[...document.querySelectorAll('button')].map((x) => x.textContent)"
        )
        assert {"Reset", "Model file"} <= set(buttons)


# The first pixel of the picture at which the mouse says that a point can be taken.
FOUND = """(() => {
  const canvas = document.querySelector(".stage canvas");
  const box = canvas.getBoundingClientRect();
  for (let y = box.top; y < box.bottom; y += 6)
    for (let x = box.left; x < box.right; x += 6) {
      canvas.dispatchEvent(new PointerEvent(
        "pointermove", {clientX: x, clientY: y, bubbles: true}));
      if (canvas.style.cursor === "move") return [x, y];
    }
  return null;
})()"""


def test_a_dragged_point_chooses_a_start_on_the_constraint(tab):
    with served(MODELS / "pendulum-cartesian.yaml") as (_, address):
        tab.open(address)
        before = tab.run("lagsim.advance(0)")
        x, y = tab.run(FOUND)
        tab.mouse("press", x, y)
        tab.mouse("move", x + 40, y + 60)
        tab.mouse("release", x + 40, y + 60)
        tab.wait("location.hash.includes('x=')")
        found = tab.run("lagsim.advance(0)")
        length = math.hypot(before["x"], before["y"])
        assert math.hypot(found["x"], found["y"]) == pytest.approx(length, rel=1e-12)
        assert found["y"] < before["y"] - 0.01
        # The velocity is along the circle.
        radial = found["x"] * found["x_dot"] + found["y"] * found["y_dot"]
        assert radial == pytest.approx(0.0, abs=1e-12)
        assert not tab.error


def test_a_saved_file_shows_its_new_motion_and_its_faults(tab, tmp_path):
    text = (MODELS / "elastic-pendulum.yaml").read_text("utf-8")
    path = tmp_path / "edited.yaml"
    path.write_text(text)
    with served(path) as (_, address):
        tab.open(address)
        tab.run("lagsim.set({theta: 0.4})")
        tab.run("lagsim.advance(1)")
        path.write_text(text.replace("potential:", "potentail:"))
        tab.wait("document.body.dataset.error")
        assert "potentail" in tab.error
        assert tab.run("document.body.classList.contains('stale')")
        path.write_text(re.sub(r"(?m)^(\s*duration:.*)$", r"\1 # longer", text))
        tab.wait("!document.body.dataset.error")
        # Settings that still exist are kept.
        assert "theta=0.4" in tab.run("location.hash")


def test_graphs_follow_a_coordinate_that_is_renamed_in_the_file(tab, tmp_path):
    path = tmp_path / "edited.yaml"
    path.write_text(OSCILLATOR)
    with served(path) as (_, address):
        tab.open(address)
        tab.run("lagsim.advance(1)")
        path.write_text(re.sub(r"\bx(?=\b|_)", "z", OSCILLATOR))
        tab.wait("JSON.parse(document.body.dataset.state).z")
        tab.wait("document.querySelector('#chosen').textContent.startsWith('z')")
        assert not tab.messages


def test_a_page_plays_when_it_opens_unless_motion_is_to_be_reduced(tab):
    with served(MODELS / "elastic-pendulum.yaml") as (_, address):
        for still in (False, True):
            tab.size(1280, 900, still=still)
            tab.open(address)
            label = tab.run(
                "document.getElementById('play').getAttribute('aria-label')"
            )
            assert label == ("Play" if still else "Pause")
            if still:
                assert float(tab.run("document.body.dataset.t")) == 0.0
            else:
                tab.wait("Number(document.body.dataset.t) > 0")


@pytest.mark.skipif(os.name == "nt", reason="a shell's script")
def test_the_address_that_is_printed_is_opened_in_the_browser(tmp_path):
    script, seen = tmp_path / "browser", tmp_path / "seen"
    script.write_text(f'#!/bin/sh\nprintf %s "$1" > {seen}.new; mv {seen}.new {seen}\n')
    script.chmod(0o755)
    found = subprocess.Popen(
        [sys.executable, "-m", "lagsim", "explore", str(MODELS / "kepler.yaml")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT,
        env=os.environ | {"BROWSER": str(script)},
    )  # fmt: skip
    try:
        [address] = re.findall(rb"http://\S+", found.stdout.readline())
        for _ in range(int(200 * PATIENCE)):
            if seen.exists():
                break
            time.sleep(0.1)
        assert seen.read_bytes() == address
    finally:
        found.kill()
        found.communicate()


def test_two_pages_move_apart(tab, tmp_path_factory):
    with served(MODELS / "elastic-pendulum.yaml") as (_, address):
        tab.open(address)
        with Tab(tmp_path_factory.mktemp("second")) as other:
            other.open(address)
            other.run("lagsim.set({K: 40})")
            tab.run("lagsim.set({K: 15})")
            one, two = (x.run("lagsim.advance(3)") for x in (tab, other))
            for k, found in ((15, one), (40, two)):
                model = lagsim.load(MODELS / "elastic-pendulum.yaml", K=k)
                same(found, lagsim.simulate(model, error_bar="never"), 3.0)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.usefixtures("heeded_signals")
def test_ctrl_c_ends_it_with_code_0_and_pages_say_so(tab):
    with served(MODELS / "elastic-pendulum.yaml") as (process, address):
        tab.open(address)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=20 * PATIENCE)
        assert process.returncode == 0
        assert b"Traceback" not in said
        with pytest.raises(RefusedError):
            tab.run("lagsim.set({K: 15})")


def test_equations_are_shown(tab):
    with served(MODELS / "elastic-pendulum.yaml") as (_, address):
        tab.open(address)
        tab.run("document.querySelector('#equations').open = true, 1")
        tab.wait("document.querySelectorAll('math').length >= 2")
        high = tab.run("document.querySelector('math').getBoundingClientRect().height")
        assert high > 10
        # Terms of a sum stand beside each other.
        terms = tab.run(
            "[...document.querySelector('math mrow').children]"
            ".map((x) => x.getBoundingClientRect().left)"
        )
        assert len(set(terms)) > 2
        assert terms == sorted(terms)


def input_of(name, value, kind="range"):
    """Return a script that moves a slider, or types into a field and leaves it."""
    event = "input" if kind == "range" else "change"
    return f"""(() => {{
      const one = document.querySelector("input[type={kind}][name='{name}']");
      one.focus();
      one.value = "{value}";
      one.dispatchEvent(new Event("{event}", {{bubbles: true}}));
      return 1;
    }})()"""


def test_a_start_value_slides_on_the_constraint_and_is_typed_as_it_is(tab):
    with served(MODELS / "pendulum-cartesian.yaml") as (_, address):
        tab.open(address)
        tab.run("lagsim.advance(0)")
        tab.run(input_of("x", 0.6))
        tab.wait("JSON.parse(document.body.dataset.state).x > 0.59")
        assert math.hypot(tab.state["x"], tab.state["y"]) == pytest.approx(1, rel=1e-9)
        assert not tab.error
        before = tab.state
        tab.run(input_of("x", 0.5, "text"))
        tab.wait("document.body.dataset.error")
        assert "rod" in tab.error
        assert tab.state == before
        field = "document.querySelector('input[type=text][name=x]')"
        assert tab.run(f"{field}.getAttribute('aria-invalid')") == "true"


def test_graphs_take_the_colours_of_the_theme(tab):
    def corner():
        """Return colours of the graph, darkest to lightest."""
        return tab.run("""(() => {
          const {width, height} = document.querySelector("#graph");
          const pen = document.querySelector("#graph").getContext("2d");
          const {data} = pen.getImageData(0, 0, width, height), found = new Set();
          for (let k = 0; k < data.length; k += 4)
            if (data[k + 3] === 255) found.add(data.slice(k, k + 3).join());
          return [...found].sort();
        })()""")

    with served(MODELS / "bouncing-ball.yaml") as (_, address):
        tab.size(1280, 900)
        tab.open(address)
        tab.run("lagsim.advance(1)")
        light = corner()
        tab.size(1280, 900, dark=True)
        tab.wait("document.documentElement.dataset.theme === 'dark'")
        dark = corner()
        tab.size(1280, 900)
        tab.wait("document.documentElement.dataset.theme === 'light'")
        assert set(corner()) == set(light)
        assert not set(dark) & set(light)


def test_a_page_on_a_phone_fits_and_keeps_the_motion_in_sight(tab):
    with served(MODELS / "bicycle.yaml") as (_, address):
        tab.size(390, 844)
        tab.open(address)
        assert tab.run("document.documentElement.scrollWidth") <= 390
        # Many sliders are closed at first.
        assert tab.run("document.documentElement.scrollHeight") < 2400
        tab.run("document.querySelector('#sliders details').open = true, 1")
        tab.run("scrollTo(0, 1500), 1")
        top = tab.run(
            "document.querySelector('.stage canvas').getBoundingClientRect().top"
        )
        assert -1 <= top <= 60
        tab.size(1280, 900)


def test_the_keyboard_suffices(tab):
    def press(name, code):
        for kind in ("rawKeyDown", "keyUp"):
            tab.send(
                "Input.dispatchKeyEvent", type=kind, key=name, code=name,
                windowsVirtualKeyCode=code,
            )  # fmt: skip

    with served(MODELS / "elastic-pendulum.yaml") as (_, address):
        tab.size(1280, 900)
        tab.open(address)
        reached, outlined = [], True
        for _ in range(40):
            press("Tab", 9)
            name, style = tab.run("""(() => {
              const one = document.activeElement;
              return [`${one.type || one.tagName} ${one.name || one.id}`,
                getComputedStyle(one).outlineStyle];
            })()""")
            reached.append(name)
            outlined &= name.startswith("BODY") or style != "none"
        assert {
            "range K", "text K", "range theta", "button reset", "button file",
            "select-one column", "SUMMARY ", "button play",
        } <= set(reached)  # fmt: skip
        assert outlined
        tab.run("document.querySelector('input[type=range][name=K]').focus(), 1")
        press("ArrowRight", 39)
        tab.wait("location.hash.includes('K=')")
        # The arrow moved the slider, and not the time.
        assert tab.state["t"] == 0.0
        assert not tab.error
