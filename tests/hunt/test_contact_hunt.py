"""Contacts against the referee: a few scenes slowly, 60 nightly.

HUNT_SEED and HUNT_CONTACTS (60) choose what a night tries, HUNT_FOLDER its failures. A
scene takes 1.3 s of one core: a night's a minute and a half, and eleven minutes 500.
"""

from __future__ import annotations

import datetime as dt
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.hunt.contact_parts import Law
from tests.hunt.contact_verdict import judged, truth
from tests.hunt.contacts import ContactScene, Told, contact_scene
from tests.hunt.integrator import NoTruthError
from tests.hunt.lagsim_runs import Lagsim


@pytest.fixture
def lagsim(tmp_path):
    with Lagsim(tmp_path) as process:
        yield process


def tried(scene, lagsim):
    """Give what a run is worth, or that there is no truth."""
    try:
        exact = truth(scene)
    except NoTruthError as fault:
        return "uncounted", str(fault)
    verdict = judged(scene, lagsim.run(scene.text()), exact)
    return verdict.kind, verdict.text


def hunted(seed, count, lagsim, folder):
    """Try scenes; write those that fail; give the kinds and what is to be said."""
    kinds, told = [], []
    for k in range(count):
        scene = contact_scene(f"{seed}-{k}")
        kind, text = tried(scene, lagsim)
        kinds.append(kind)
        if kind in ("fine", "uncounted"):
            continue
        folder.mkdir(parents=True, exist_ok=True)
        place = folder / f"{scene.seed}.yaml"
        place.write_text(scene.text(), encoding="utf-8")
        # In plain words it is easier to read, if it fails there too.
        plain = tried(scene.plain(), lagsim)[0]
        told.append(f"{scene.seed}: {kind} (plainly told: {plain}), {place}\n  {text}")
    return kinds, "\n".join(told)


def folder_of(tmp_path):
    return Path(os.environ.get("HUNT_FOLDER", tmp_path / "failures"))


def ball(e, **law):
    """A ball of mass 2 that is dropped from 1 and slides at 3."""
    floor = Law("contact", "y", e, slip="x_dot", **law)
    return ContactScene(
        "ball", ["x", "y"], "x_dot^2 + y_dot^2", "2*9.81*y", {}, [floor], [0.0, 1.0],
        [3.0, 0.0], [True, True], 3.0, 0.1, Told({}, {}),
    )  # fmt: skip


@pytest.mark.slow
def test_the_referee_knows_bounces_rest_and_friction():
    rows, known, path = truth(ball(0.5, mu=0.1))
    first = np.sqrt(2 / 9.81)
    times = first * (1 + 2 * (1 - 0.5 ** np.arange(4)))
    assert path.impacts[:4] == pytest.approx(times, abs=1e-10)
    # Once it lies the floor has pushed as much as its weight, and a tenth along.
    # Bounces that take 3e-9 of the run are left out.
    assert rows[-1][1:] == pytest.approx([0, 3 - 0.981 * 3, 0], abs=2e-8)
    assert np.max(known) < 1e-7
    stopped, _, _ = truth(ball(0.0, mu=0.5))
    assert stopped[-1][2] == pytest.approx(0.0, abs=1e-9)


def test_a_scene_in_other_words_comes_back():
    told = Told({"x": 5.0}, {"y": -2.0}, length=1e3, time=10.0, start=7.0)
    shifted = replace(ball(0.5), told=told)
    t = np.array([7.0, 17.0])
    x, y = 1e3 * 2.0 + 5.0, 1e3 * 0.25 - 2.0 * (t - 7.0)
    rows = np.column_stack([t, [x, x], y, [0.0, 0.0], [-2.0, -2.0]])
    back = shifted.back(["t", "x", "y", "x_dot", "y_dot"], rows)
    assert back == pytest.approx(np.array([[2, 0.25, 0, 0], [2, 0.25, 0, 0]]))


@pytest.mark.slow
def test_a_few_contacts_hold(lagsim, tmp_path):
    _, told = hunted("few", 8, lagsim, folder_of(tmp_path))
    assert not told, told


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_a_nights_contacts_hold(lagsim, tmp_path):
    today = dt.datetime.now(dt.UTC).date().isoformat()
    seed = os.environ.get("HUNT_SEED", today)
    count = int(os.environ.get("HUNT_CONTACTS", "60"))
    kinds, told = hunted(seed, count, lagsim, folder_of(tmp_path))
    assert not told, f"seed {seed}\n{told}"
    assert kinds.count("fine") > len(kinds) / 2
