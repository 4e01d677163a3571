"""Golden, resume, animation, bench, stability, derive: beside each feature."""

import base64
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from lagsim.model.reader import read
from lagsim.outputs.animation import recorded
from lagsim.run.session import open_case, settings_of
from lagsim.studies.bench.stability import Subject
from lagsim.studies.bench.work_precision import make_reference
from lagsim.studies.restart import RESTART
from tests.cli.test_resume import content, ended
from tests.scenes.pairs.commands import (
    CHANGED,
    COMMANDS,
    EIGENVALUES,
    MODES,
    OTHER,
    OUTSIDE,
)
from tests.scenes.pairs.physical import BY_NAME
from tests.scenes.pairs.scene import STEP, motion, part_of, scene

SMOOTH = BY_NAME["smooth"]


def each(parts):
    """Return all features, of which one in `parts` is in the quick slice."""
    return [
        pytest.param(x, marks=[] if part_of(x, parts) else [pytest.mark.slow])
        for x in BY_NAME
    ]


def coupled(name, extra=""):
    """Return a feature whose first coordinate is mixed with that of another."""
    return scene(BY_NAME[name], SMOOTH, coupled=True, extra=extra)


def by(text, method):
    """Set a method with fixed steps, or another tolerance."""
    more = f"output_step: {STEP}, {method}"
    return text.replace(f"output_step: {STEP}", more)


@pytest.mark.slow
@pytest.mark.parametrize("name", each(23))
def test_a_golden_is_met_by_other_means_and_sees_a_change(name, lagsim, write):
    text = coupled(name)
    file = write(text)
    assert lagsim("golden", file, "--update", "-q").code == 0
    write(by(text, OTHER.get(name, "rtol: 1e-12")))
    met = lagsim("golden", file)
    assert met.code == 0, met.out
    old, new = CHANGED[name]
    changed = text.replace(old, new)
    assert changed != text
    write(changed)
    assert lagsim("golden", file).code == 1


@pytest.mark.skipif(os.name == "nt", reason="processes are killed")
@pytest.mark.usefixtures("heeded_signals")
@pytest.mark.slow
@pytest.mark.parametrize("name", BY_NAME)
def test_what_was_killed_goes_on_to_the_same_bits(name, lagsim, write, begun):
    model = write(by(coupled(name), "method: rk4, step: 0.001"))
    asked = ("run", model, "-q", "--no-plots", "--error-bar", "never")
    assert lagsim(*asked, "-o", "whole").code == 0
    ended((*asked, "-o", "cut"), 15, signal.SIGKILL)
    assert Path("cut", RESTART).exists()
    assert lagsim(*asked, "-o", "cut", "--resume").code == 0
    assert len(begun) == 1
    assert 0.1 < begun[0] < 1.2
    assert content("cut") == content("whole")


@pytest.mark.parametrize("name", each(11))
def test_a_page_plays_the_motion(name, lagsim, write):
    model = write(coupled(name, "scene: {points: {both: [x1, x2]}}"))
    asked = ("run", model, "-q", "--no-plots", "--error-bar", "never", "--animate")
    assert lagsim(*asked, "-o", "out").code == 0
    [run] = recorded(Path("out", "animation.html").read_text("utf-8"))
    t = np.frombuffer(base64.b64decode(run["t"]), "<f8")
    rows = np.loadtxt("out/trajectory.csv", delimiter=",", skiprows=1)
    assert t.tolist() == rows[:, 0].tolist()
    (both,) = run["points"]
    place = np.frombuffer(base64.b64decode(both["place"]), "<f4").reshape(-1, 2)
    expected = motion(BY_NAME[name], SMOOTH, t=t)
    for k, x in enumerate((expected["x1"], expected["x2"])):
        assert place[:, k] == pytest.approx(x, abs=1e-6)
    # Rates: what the closed form does within 1e-6 of a frame, on its either side.
    rate = np.frombuffer(base64.b64decode(both["rate"]), "<f4").reshape(-1, 2)
    expected = -2.0 * np.sin(2.0 * t)
    assert rate[:, 1] == pytest.approx(expected, abs=1e-5)


@pytest.mark.slow  # a case takes up to 11 s
@pytest.mark.parametrize("name", each(13))
def test_the_reference_of_a_chart_is_the_closed_form(name):
    model = read(coupled(name), "model.yaml")
    reference = make_reference(open_case(model, settings_of(model, "bench")))
    assert reference.horizon is None
    assert reference.floor < 1e-6
    t = reference.rows[:, 0]
    assert t[-1] == pytest.approx(BY_NAME[name].end, abs=1e-9)
    x = motion(BY_NAME[name], SMOOTH, t=t)
    for q, sign in (("u", 1.0), ("w", -1.0)):
        found = reference.rows[:, reference.columns.index(q)]
        both = (x["x1"] + sign * x["x2"]) / np.sqrt(2.0)
        assert found == pytest.approx(both, abs=1e-9)


@pytest.mark.parametrize("name", COMMANDS["stability"])
def test_stability_refuses_what_holds_at_times(name, lagsim, write):
    called = lagsim("stability", write(coupled(name)), "-o", "out", code=2)
    assert called.reports("E406")


@pytest.mark.parametrize("name", EIGENVALUES)
def test_stability_has_the_eigenvalues_of_the_closed_form(name):
    model = read(coupled(name), "model.yaml")
    subject = Subject(open_case(model, settings_of(model, "stability")))
    found = [complex(z) for z in subject.at_start]
    expected = [*EIGENVALUES[name], 2j, -2j]
    assert len(found) == len(expected)
    for z in expected:
        nearest = min(found, key=lambda x: abs(x - z))
        assert abs(nearest - z) < 1e-5
        found.remove(nearest)


def moving(name, t):
    """Return q, q', q'' at a time, of (u, w, ...) by differences of the closed form."""
    h = 1e-3
    at = t + h * np.arange(-2, 3)
    x = motion(BY_NAME[name], SMOOTH, t=at)
    q = {k: values for k, values in x.items() if k not in ("x1", "x2")}
    q["u"] = (x["x1"] + x["x2"]) / np.sqrt(2.0)
    q["w"] = (x["x1"] - x["x2"]) / np.sqrt(2.0)
    first = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * h)
    second = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / (12.0 * h * h)
    return {k: (v[2], first @ v, second @ v) for k, v in q.items()}


@pytest.mark.parametrize("name", BY_NAME)
def test_derived_equations_are_met_by_the_closed_form(name, lagsim, write):
    called = lagsim("derive", write(coupled(name)), "--format", "python", code=0)
    module = {}
    exec(compile(called.out, name, "exec"), module)
    names = module["COORDINATES"]
    for t in (0.3, 1.2):
        found = moving(name, t)
        q, v, a = np.array([found[k] for k in names]).T
        module["PARAMETERS"].update(MODES.get((name, t), {}))
        left = module["mass_matrix"](t, q, v) @ a - module["force"](t, q, v)
        force, held = OUTSIDE.get((name, t), ({}, True))
        for coordinate, x in force.items():
            parts = {"u": x / np.sqrt(2.0), "w": x / np.sqrt(2.0)}
            if coordinate != "x1":
                parts = {coordinate: x}
            for k, part in parts.items():
                left[names.index(k)] -= part
        if module["CONSTRAINTS"] and held:
            A = module["constraint_matrix"](t, q, v)
            lam = np.linalg.lstsq(A.T, left, rcond=None)[0]
            left = left - A.T @ lam
            assert A @ a == pytest.approx(module["constraint_rhs"](t, q, v), abs=1e-7)
        assert left == pytest.approx(0.0, abs=1e-7)
