"""The array that carries a run, with room for every method that may come to use it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import _state as at
from lagsim.methods import method
from lagsim.methods._looks import looks_size

if TYPE_CHECKING:
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
    ranges = sizes + 3 * system.size
    count, noted = len(system.inertias), ranges + at.extents_size(system.size)
    watched = noted + 3 * count
    looks = looks_size(system.size, len(system.sleepers))
    state = np.zeros(watched + looks)
    state[at.SIGNALS], state[at.LOOKS_AT] = len(system.sleepers), watched
    for k, sleeper in enumerate(system.sleepers):
        state[watched + k] = sleeper.kind
        state[watched + len(system.sleepers) + k] = sleeper.power
    state[at.LANES_AT], state[at.SIZES_BEFORE] = used, sizes
    state[at.EXTENTS_AT] = ranges
    state[ranges : ranges + system.size] = np.inf
    state[ranges + system.size : ranges + 2 * system.size] = -np.inf
    state[at.INERTIAS], state[at.INERTIAS_AT] = count, noted
    state[noted + count :][:count] = np.inf  # the smallest so far
    return state


def extents(state: Floats) -> Floats:
    """Give the least and the greatest value of each component: a view (2, size)."""
    size, first = int(state[at.SIZE]), int(state[at.EXTENTS_AT])
    return state[first : first + 2 * size].reshape(2, size)


def taken_over(state: Floats, runner: Runner) -> Floats:
    """Give a state as that of another method or system, at the start of an arc."""
    new = empty_state(runner)
    own = [at.INERTIAS, at.INERTIAS_AT, at.LANES_AT, at.SIZES_BEFORE, at.EXTENTS_AT]
    own += [at.SIGNALS, at.LOOKS_AT]
    kept = new[own]
    common = at.HEADER + 6 * runner.system.size + 6
    new[:common] = state[:common]
    here, size = int(kept[4]), runner.system.size
    length = at.extents_size(size)
    new[here : here + length] = state[int(state[at.EXTENTS_AT]) :][:length]
    if state[at.INERTIAS] == kept[0]:
        noted = 3 * int(kept[0])
        here, there = int(kept[1]), int(state[at.INERTIAS_AT])
        new[here : here + noted] = state[there : there + noted]
    new[own] = kept
    new[at.FRESH] = 1.0
    return new
