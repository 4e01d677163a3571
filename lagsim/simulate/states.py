"""The array that carries a run, with room for every method that may come to use it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import _state as at
from lagsim.methods import method

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.native.kernel_types import Floats
    from lagsim.system.runner import Runner

# The method where the motion slides along a surface and the method of the run needs
# more of the model than y'.
SLIDING = "dop853"
# A method whose steps may fail for other reasons than stiffness: of them nothing is
# said, and it is looked at after so many steps, some ten milliseconds.
SERIES = "taylor"
LONG = 20_000
# More than any run makes, unless it is told otherwise.
MOST_STEPS = 100_000_000


def empty_state(runner: Runner) -> Floats:
    """Give a state of zeros for a method, and for the one that slides."""
    system = runner.system
    methods = [runner.method, *([method(SLIDING)] if system.surfaces else [])]
    used = max(int(m.state_size(system.size)) for m in methods)
    # And room for rows side by side, for what `_driver.keep_sizes` and
    # `_driver.note_inertias` note.
    sizes = used + at.lanes_size(system.size)
    # `note_extents` needs room for two more.
    count, noted = len(system.inertias), sizes + 3 * system.size
    state = np.zeros(noted + 3 * count)
    state[at.LANES_AT], state[at.SIZES_BEFORE] = used, sizes
    state[at.INERTIAS], state[at.INERTIAS_AT] = count, noted
    state[noted + count :][:count] = np.inf  # the smallest so far
    return state


def note_extents(state: Floats) -> None:
    """Have the ranges over the steps noted from now on."""
    state[at.EXTENTS_AT] = state[at.INERTIAS_AT] - 2 * state[at.SIZE]
    extents(state)[:] = [[np.inf], [-np.inf]]


def extents(state: Floats) -> Floats:
    """Give the least and the greatest value of each component: a view (2, size)."""
    size, first = int(state[at.SIZE]), int(state[at.EXTENTS_AT])
    return state[first : first + 2 * size].reshape(2, size)


def named_extents(
    state: Floats, names: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Give them by the names of the components, where they were noted."""
    if not state[at.EXTENTS_AT]:
        return {}
    low, high = extents(state).tolist()
    return dict(zip(names, zip(low, high, strict=True), strict=True))


def taken_over(state: Floats, runner: Runner) -> Floats:
    """Give a state as that of another method or system, at the start of an arc."""
    new = empty_state(runner)
    own = [at.INERTIAS, at.INERTIAS_AT, at.LANES_AT, at.SIZES_BEFORE, at.EXTENTS_AT]
    if state[at.EXTENTS_AT]:
        new[at.SIZE] = state[at.SIZE]
        note_extents(new)
        extents(new)[:] = extents(state)
    kept = new[own]
    common = at.HEADER + 6 * runner.system.size + 6
    new[:common] = state[:common]
    if state[at.INERTIAS] == kept[0]:
        new[int(kept[1]) :] = state[int(state[at.INERTIAS_AT]) :]
    new[own] = kept
    new[at.FRESH] = 1.0
    return new
