"""lagsim against the referees: a few scenes slowly, a hundred and sixty nightly.

HUNT_SEED, HUNT_SCENES (100) and HUNT_CONTACTS (60) choose what a night tries,
HUNT_FOLDER its failures. A scene takes 0.6 s of one core, one with contacts 1.3 s.
"""

import datetime as dt
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.hunt.contact_verdict import tried as tried_contact
from tests.hunt.contact_verdict import truth
from tests.hunt.contacts import contact_scene
from tests.hunt.hunting import hunt, report
from tests.hunt.lagsim_runs import Lagsim
from tests.hunt.scene import Item, Law, Scene

# A told error is to be within this factor of the truth, on this part of the scenes.
FACTOR, MOSTLY = 30.0, 0.95


@pytest.fixture
def lagsim(tmp_path):
    with Lagsim(tmp_path) as process:
        yield process


@pytest.fixture
def folder(tmp_path):
    return Path(os.environ.get("HUNT_FOLDER", tmp_path / "failures"))


@pytest.fixture
def seed():
    today = dt.datetime.now(dt.UTC).date().isoformat()
    return os.environ.get("HUNT_SEED", today)


def hunted(seed, count, lagsim, folder):
    """Hunt; write what fails; give the tally and what is to be said."""
    tally = hunt(seed, count, lagsim)
    told = [f"seed {seed}: {tally.counted} scenes, {tally.uncounted} without a truth"]
    for scene, verdict in tally.faults:
        place = report(scene, verdict, folder)
        told.append(f"{scene.seed}: {verdict.kind}, {place}\n    {verdict.text}")
    return tally, "\n".join(told)


@pytest.mark.slow
def test_a_few_scenes_hold(lagsim, folder):
    tally, told = hunted("few", 3, lagsim, folder)
    assert not tally.faults, told


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_a_nights_scenes_hold(lagsim, folder, seed, capsys):
    count = int(os.environ.get("HUNT_SCENES", "100"))
    tally, told = hunted(seed, count, lagsim, folder)
    ratios = np.array(tally.ratios)
    within = np.mean((ratios < FACTOR) & (ratios > 1 / FACTOR)) if len(ratios) else 1
    with capsys.disabled():
        print(f"\n{told}\ntold errors within a factor {FACTOR:g}: {within:.1%}")  # noqa: T201
    assert not tally.faults, told
    assert tally.uncounted < tally.counted / 4
    assert within >= MOSTLY


# --- contacts -------------------------------------------------------------------------


def hunted_contacts(seed, count, lagsim, folder):
    """Try scenes; write those that fail; give the kinds and what is to be said."""
    kinds, told = [], []
    for k in range(count):
        scene = contact_scene(f"{seed}-{k}")
        verdict = tried_contact(scene, lagsim)
        kinds.append(verdict.kind)
        if not verdict.is_fault:
            continue
        folder.mkdir(parents=True, exist_ok=True)
        place = folder / f"{scene.scene.seed}.yaml"
        place.write_text(scene.told().text(), encoding="utf-8")
        # In plain words it is easier to read, if it fails there too.
        plain = tried_contact(replace(scene, words=()), lagsim).kind
        told.append(
            f"{scene.scene.seed} {scene.words}: {verdict.kind} (plainly: {plain}), "
            f"{place}\n  {verdict.text}"
        )
    return kinds, "\n".join(told)


def ball(e, **law):
    """A ball of mass 2 that is dropped from 1 and slides at 3."""
    item = Item(
        "ball", coordinates={"x": (0.0, 3.0), "y": (1.0, 0.0)}, loose=("x", "y"),
        kinetic=("x_dot^2 + y_dot^2",), potential=("2*9.81*y",),
        laws=(Law("contact", "y", e, slip="x_dot", **law),),
    )  # fmt: skip
    return Scene("ball", (item,), 0.0, 3.0, 0.1)


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


@pytest.mark.slow
def test_a_few_contacts_hold(lagsim, folder):
    _, told = hunted_contacts("few", 8, lagsim, folder)
    assert not told, told


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_a_nights_contacts_hold(lagsim, folder, seed):
    count = int(os.environ.get("HUNT_CONTACTS", "60"))
    kinds, told = hunted_contacts(seed, count, lagsim, folder)
    assert not told, f"seed {seed}\n{told}"
    assert kinds.count("fine") > len(kinds) / 2
