"""What fails, made small: parts left out, times shortened, numbers rounded."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tests.hunt.grammar import admissible
from tests.hunt.integrator import NoTruthError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tests.hunt.scene import Item, Scene

# Trials that shrinking one scene may take.
MOST = 80


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
