"""The array that carries a run, with room for every method that may come to use it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import _state as at
from lagsim.methods import method

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
# A state that slides is pulled back by what a step errs: a few times the tolerance
# by a method that has one, and this part of the motion by any other.
MOST_PULLED = 1e-2
LEAST_PULLED = 1e-9
ERRED = 1e4


def most_pulled(rtol: float | None) -> float:
    """Give how far a state may be pulled, against the motion, before it jumps."""
    if rtol is None:
        return MOST_PULLED
    return min(MOST_PULLED, max(LEAST_PULLED, ERRED * rtol))


def empty_state(runner: Runner) -> Floats:
    """Give a state of zeros for a method, and for the one that slides."""
    system = runner.system
    methods = [runner.method, *([method(SLIDING)] if system.surfaces else [])]
    used = max(int(m.state_size(system.size)) for m in methods)
    # And room for rows side by side, for what `_driver.keep_sizes` and
    # `_driver.note_inertias` note.
    sizes = used + at.lanes_size(system.size)
    count, noted = len(system.inertias), sizes + system.size
    state = np.zeros(noted + 3 * count)
    state[at.LANES_AT], state[at.SIZES_BEFORE] = used, sizes
    state[at.INERTIAS], state[at.INERTIAS_AT] = count, noted
    state[noted + count :][:count] = np.inf  # the smallest so far
    return state


def taken_over(state: Floats, runner: Runner) -> Floats:
    """Give a state as that of another method or system, at the start of an arc."""
    new = empty_state(runner)
    own = [at.INERTIAS, at.INERTIAS_AT, at.LANES_AT, at.SIZES_BEFORE]
    kept = new[own]
    common = at.HEADER + 6 * runner.system.size + 6
    new[:common] = state[:common]
    if state[at.INERTIAS] == kept[0]:
        new[int(kept[1]) :] = state[int(state[at.INERTIAS_AT]) :]
    new[own] = kept
    new[at.FRESH] = 1.0
    return new
