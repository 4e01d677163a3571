"""lagsim against the referees: a few scenes slowly, three hundred nightly.

HUNT_SEED, HUNT_SCENES, HUNT_CONTACTS, HUNT_FEATURES, HUNT_INSTANTS and HUNT_STEPS set
the seed and the numbers of scenes of a night, HUNT_FOLDER the folder of its failures. A
scene takes 0.6 s of one core, others a little more. All but smooth scenes, whose
reported errors are judged, run without the repeat that estimates the error: the first
integration must be right. Of smooth scenes a repeat that has replaced the run is a
fault.
"""

import itertools
import os
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.hunt import (
    fixed_steps,
    grammar,
    hybrid_verdict,
    instants_verdict,
    verdict,
)
from tests.hunt.contacts import contact_scene
from tests.hunt.features import feature_scene
from tests.hunt.integrator import NoTruthError

# A told error is to be within this factor of the truth, on this part of the scenes.
FACTOR, MOSTLY = 30.0, 0.95
# Without the repeat by which a run's error is estimated.
ONCE = ("--error-bar", "never")
# How a method that was asked for is refused for its cost.
TOO_LONG = "its series would need about"


def tried_scene(seed, lagsim):
    """Return the text of a smooth scene, and the verdict on its run."""
    scene = grammar.scene(seed)
    try:
        exact = verdict.truth(scene)
    except NoTruthError as fault:
        return scene.text(), verdict.Verdict("uncounted", str(fault))
    answer = lagsim.run(scene.text())
    if TOO_LONG in answer.told and scene.settings.get("method") == "taylor":
        # The series of a large scene is refused; the scene itself must not be.
        answer = lagsim.run(replace(scene, settings={}).text())
    return scene.text(), verdict.judge(scene, answer, exact)


def tried_contact(seed, lagsim):
    scene = contact_scene(seed)
    told = scene.told()
    found = hybrid_verdict.tried(told, lagsim, *ONCE)
    if found.is_fault:
        # In plain words it is easier to read, if it fails there too.
        plain = hybrid_verdict.tried(replace(scene, words=()).told(), lagsim, *ONCE)
        found = replace(
            found, text=f"{scene.words}, plainly {plain.kind}: {found.text}"
        )
    return told.text, found


def tried_feature(seed, lagsim):
    told = feature_scene(seed)
    return told.text, hybrid_verdict.tried(told, lagsim, *ONCE)


def tried_instant(seed, lagsim):
    return instants_verdict.tried(seed, lagsim, *ONCE)


def tried_steps(seed, lagsim):
    return fixed_steps.tried(seed, lagsim, *ONCE)


class Hunt(NamedTuple):
    """How scenes are tried: a few slowly, many nightly; how few have no truth then."""

    tried: Any
    few: int
    many: int
    unknown: float


HUNTS = {
    "scenes": Hunt(tried_scene, 3, 100, 1 / 4),
    "contacts": Hunt(tried_contact, 8, 60, 1),
    "features": Hunt(tried_feature, 5, 60, 1),
    "instants": Hunt(tried_instant, 6, 80, 1 / 20),
    "steps": Hunt(tried_steps, 4, 60, 1),
}


@dataclass
class Tally:
    """Results of a hunt. ratios : true over reported errors, by scene."""

    counted: int = 0
    uncounted: int = 0
    ratios: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


def hunted(tried, seed, count, lagsim, folder):
    """Try scenes of a seed until `count` of them have counted; write failing ones."""
    tally = Tally()
    for number in itertools.count():
        if tally.counted >= count:
            return tally
        text, found = tried(f"{seed}-{number}", lagsim)
        if found.kind == "uncounted":
            tally.uncounted += 1
            continue
        tally.counted += 1
        if found.ratio is not None:
            tally.ratios.append(found.ratio)
        if found.is_fault:
            folder.mkdir(parents=True, exist_ok=True)
            place = folder / f"{found.kind}-{seed}-{number}.yaml"
            place.write_text(text, encoding="utf-8")
            place.with_suffix(".txt").write_text(f"{found.kind}: {found.text}\n")
            tally.faults.append(f"{place}: {found.kind}\n    {found.text}")
    return tally


@pytest.mark.slow
@pytest.mark.parametrize("hunt", HUNTS)
def test_a_few_hold(hunt, lagsim, folder):
    tally = hunted(HUNTS[hunt].tried, "few", HUNTS[hunt].few, lagsim, folder)
    assert not tally.faults, "\n".join(tally.faults)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("hunt", HUNTS)
def test_a_night_holds(hunt, lagsim, folder, seed, capsys):
    tried, _, many, unknown = HUNTS[hunt]
    count = int(os.environ.get(f"HUNT_{hunt.upper()}", many))
    tally = hunted(tried, seed, count, lagsim, folder)
    assert not tally.faults, "\n".join([f"seed {seed}", *tally.faults])
    assert tally.uncounted < unknown * tally.counted
    if hunt == "scenes":
        ratios = np.array(tally.ratios)
        within = (ratios < FACTOR) & (ratios > 1 / FACTOR)
        with capsys.disabled():
            print(f"\ntold errors within {FACTOR:g}: {np.mean(within):.1%}")  # noqa: T201
        assert not len(ratios) or np.mean(within) >= MOSTLY
