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
# More than any run makes, unless it is told otherwise.
MOST_STEPS = 100_000_000


def empty_state(runner: Runner) -> Floats:
    """Give a state of zeros for a method, and for the one that slides."""
    system = runner.system
    methods = [runner.method, *([method(SLIDING)] if system.surfaces else [])]
    used = max(int(m.state_size(system.size)) for m in methods)
    # And room for what `_driver.keep_sizes` notes.
    state = np.zeros(used + system.size)
    state[at.SIZES_BEFORE] = used
    return state


def taken_over(state: Floats, runner: Runner) -> Floats:
    """Give a state as that of another method or system, at the start of an arc."""
    new = empty_state(runner)
    kept = new[at.SIZES_BEFORE]
    common = at.HEADER + 6 * runner.system.size + 6
    new[:common] = state[:common]
    new[at.SIZES_BEFORE] = kept
    new[at.FRESH] = 1.0
    return new
