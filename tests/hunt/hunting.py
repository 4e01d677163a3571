"""The hunt itself: scene after scene, each run and judged; what fails, made small."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from tests.hunt.grammar import admissible
from tests.hunt.grammar import scene as scene_of
from tests.hunt.referee import NoTruthError
from tests.hunt.verdict import Truth, Verdict, judge, truth

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from tests.hunt.lagsim_runs import Lagsim
    from tests.hunt.scene import Item, Scene

# Trials that shrinking one scene may take.
MOST = 80
# How a method that was asked for is refused for its cost.
TOO_LONG = "its series would take about"


@dataclass
class Tally:
    """What came of a hunt. ratios: true over told errors, by scene."""

    counted: int = 0
    uncounted: int = 0
    ratios: list[float] = field(default_factory=list)
    faults: list[tuple[Scene, Verdict]] = field(default_factory=list)

    def add(self, scene: Scene, verdict: Verdict) -> None:
        if verdict.kind == "uncounted":
            self.uncounted += 1
            return
        self.counted += 1
        if verdict.ratio is not None:
            self.ratios.append(verdict.ratio)
        if verdict.is_fault:
            self.faults.append((scene, verdict))


def tried(scene: Scene, lagsim: Lagsim) -> tuple[Verdict, Truth | None]:
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


def hunt(seed: str, count: int, lagsim: Lagsim) -> Tally:
    """Try scenes of a seed until so many have counted."""
    tally = Tally()
    for number in itertools.count():
        if tally.counted >= count:
            break
        scene = scene_of(f"{seed}-{number}")
        tally.add(scene, tried(scene, lagsim)[0])
    return tally


def small(scene: Scene, verdict: Verdict, lagsim: Lagsim, most: int = MOST) -> Scene:
    """Give a smaller scene with the same kind of fault."""
    return shrunk(scene, lambda s: tried(s, lagsim)[0].kind == verdict.kind, most)


def report(scene: Scene, verdict: Verdict, exact: Truth | None, folder: Path) -> Path:
    """Write what is needed to see a failure again; give the folder."""
    kind = re.sub(r"\W+", "-", verdict.kind)
    place = folder / f"{kind}-{scene.seed}"
    place.mkdir(parents=True, exist_ok=True)
    (place / "scene.yaml").write_text(scene.text(), encoding="utf-8")
    document = {"seed": scene.seed, "kind": verdict.kind, "text": verdict.text}
    if exact is not None:
        document["names"] = [*scene.q, *(f"{q}_dot" for q in scene.q)]
        document["truth_at_end"] = exact.state[-1].tolist()
        document["end"] = exact.times[-1]
    (place / "verdict.json").write_text(json.dumps(document, indent=1) + "\n")
    return place


def shrunk(scene: Scene, fails: Callable[[Scene], bool], most: int = MOST) -> Scene:
    """Give a smaller scene that fails as well; each trial asks `fails`."""
    left = most
    while left > 0:
        for smaller in _smaller(scene):
            left -= 1
            if _fails(smaller, fails):
                scene = smaller
                break
            if left <= 0:
                break
        else:
            return scene
    return scene


def _fails(scene: Scene, fails: Callable[[Scene], bool]) -> bool:
    try:
        return fails(admissible(scene))
    except (NoTruthError, ZeroDivisionError):
        return False


def _smaller(scene: Scene) -> Iterator[Scene]:
    """Give scenes that are a step smaller, the boldest first."""
    items = scene.items
    for i in range(len(items) if len(items) > 1 else 0):
        kept = scene.keeping(items[:i] + items[i + 1 :])
        if kept is not None:
            yield kept
    if scene.until:
        yield replace(scene, until="")
    if scene.settings:
        yield replace(scene, settings={})
    if scene.duration > 4 * scene.output_step:
        yield replace(scene, duration=_rounded(scene.duration / 2, 3))
        yield replace(scene, output_step=_rounded(scene.duration / 4, 3))
    yield from _rounder(scene)


def _rounder(scene: Scene) -> Iterator[Scene]:
    for digits in (1, 2):
        numbers = [
            replace(
                item,
                parameters={k: _rounded(v, digits) for k, v in item.parameters.items()},
                coordinates={
                    q: (_rounded(x, digits), _rounded(v, digits))
                    for q, (x, v) in item.coordinates.items()
                },
            )
            for item in scene.items
        ]
        whole = replace(scene, items=tuple(numbers), velocities={})
        if whole.items != scene.items:
            yield whole
        for i, rounder in enumerate(numbers):
            if rounder != scene.items[i]:
                yield _with(scene, i, rounder)


def _with(scene: Scene, i: int, item: Item) -> Scene:
    items = (*scene.items[:i], item, *scene.items[i + 1 :])
    return replace(scene, items=items, velocities={})


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
