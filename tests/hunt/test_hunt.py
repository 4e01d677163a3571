"""lagsim against the referee: a few scenes slowly, a hundred nightly.

HUNT_SEED and HUNT_SCENES (100) choose what a night tries, HUNT_FOLDER its failures. A
scene takes 0.6 s of one core: a night's a minute, and ten minutes 1,000.
"""

from __future__ import annotations

import datetime as dt
import os
from pathlib import Path

import numpy as np
import pytest

from tests.hunt.hunting import hunt, report, small, tried
from tests.hunt.lagsim_runs import Lagsim

# A told error is to be within this factor of the truth, on this part of the scenes.
FACTOR, MOSTLY = 30.0, 0.95


@pytest.fixture
def lagsim(tmp_path):
    with Lagsim(tmp_path) as process:
        yield process


def hunted(seed, count, lagsim, folder):
    """Hunt; shrink and write what fails; give the tally and what is to be said."""
    tally = hunt(seed, count, lagsim, lambda *_: None)
    told = [f"seed {seed}: {tally.counted} scenes, {tally.uncounted} without a truth"]
    for scene, verdict in tally.faults:
        least = small(scene, verdict, lagsim)
        found, exact = tried(least, lagsim)
        place = report(least, found, exact, folder)
        told.append(f"{scene.seed}: {found.kind}, {place}\n    {found.text}")
    return tally, "\n".join(told)


def folder_of(tmp_path):
    return Path(os.environ.get("HUNT_FOLDER", tmp_path / "failures"))


@pytest.mark.slow
def test_a_few_scenes_hold(lagsim, tmp_path):
    tally, told = hunted("few", 3, lagsim, folder_of(tmp_path))
    assert not tally.faults, told


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_a_nights_scenes_hold(lagsim, tmp_path, capsys):
    today = dt.datetime.now(dt.UTC).date().isoformat()
    seed = os.environ.get("HUNT_SEED", today)
    count = int(os.environ.get("HUNT_SCENES", "100"))
    tally, told = hunted(seed, count, lagsim, folder_of(tmp_path))
    ratios = np.array(tally.ratios)
    within = np.mean((ratios < FACTOR) & (ratios > 1 / FACTOR)) if len(ratios) else 1
    with capsys.disabled():
        print(f"\n{told}\ntold errors within a factor {FACTOR:g}: {within:.1%}")  # noqa: T201
    assert not tally.faults, told
    assert tally.uncounted < tally.counted / 4
    assert within >= MOSTLY
