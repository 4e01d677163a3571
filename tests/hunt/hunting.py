"""The hunt itself: scene after scene, each run and judged; failures to a folder."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from tests.hunt.grammar import scene as scene_of
from tests.hunt.integrator import NoTruthError
from tests.hunt.verdict import Verdict, judge, truth

if TYPE_CHECKING:
    from tests.hunt.scene import Scene

# How a method that was asked for is refused for its cost.
TOO_LONG = "its series would take about"


@dataclass
class Tally:
    """What came of a hunt. ratios: true over told errors, by scene."""

    counted: int = 0
    uncounted: int = 0
    ratios: list[float] = field(default_factory=list)
    faults: list[tuple[Scene, Verdict]] = field(default_factory=list)

    def add(self, scene, verdict):
        if verdict.kind == "uncounted":
            self.uncounted += 1
            return
        self.counted += 1
        if verdict.ratio is not None:
            self.ratios.append(verdict.ratio)
        if verdict.is_fault:
            self.faults.append((scene, verdict))


def tried(scene, lagsim):
    """Run a scene on both sides and judge."""
    try:
        exact = truth(scene)
    except NoTruthError as fault:
        return Verdict("uncounted", str(fault)), None
    answer = lagsim.run(scene.text())
    if TOO_LONG in answer.told and scene.settings.get("method") == "taylor":
        # The series of a large scene is refused; the scene itself must not be.
        answer = lagsim.run(replace(scene, settings={}).text())
    return judge(scene, answer, exact), exact


def hunt(seed, count, lagsim):
    """Try scenes of a seed until so many have counted."""
    tally = Tally()
    for number in itertools.count():
        if tally.counted >= count:
            break
        scene = scene_of(f"{seed}-{number}")
        tally.add(scene, tried(scene, lagsim)[0])
    return tally


def report(scene, verdict, folder):
    """Write what is needed to see a failure again; give the folder."""
    kind = re.sub(r"\W+", "-", verdict.kind)
    place = folder / f"{kind}-{scene.seed}"
    place.mkdir(parents=True, exist_ok=True)
    (place / "scene.yaml").write_text(scene.text(), encoding="utf-8")
    document = {"seed": scene.seed, "kind": verdict.kind, "text": verdict.text}
    (place / "verdict.json").write_text(json.dumps(document, indent=1) + "\n")
    return place
