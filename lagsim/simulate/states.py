"""The array of state of a run: how long it is, and what of it outlasts a method.

After the arrays of the method lie the largest sizes before the last step (size), then,
for each inertia that is followed, its largest and smallest value and the time of that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import _state as at
from lagsim.methods import method

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.native.kernel_types import Floats
    from lagsim.system import System


def state_length(methods: Iterable[str], system: System) -> int:
    """Give the length for any of the methods, without the inertias."""
    longest = max(int(method(name).state_size(system.size)) for name in methods)
    return longest + system.size


def followed(state: Floats, system: System) -> Floats:
    """Give a state of that length with its tail in place."""
    count = len(system.inertias)
    state[at.SIZES_BEFORE] = len(state) - system.size
    state[at.INERTIAS], state[at.INERTIAS_AT] = count, len(state)
    kept = np.concatenate([np.zeros(count), np.full(count, np.inf), np.zeros(count)])
    return np.concatenate([state, kept])


def converted(old: Floats, length: int, system: System) -> Floats:
    """Give a state of that length for another method, at the start of an arc."""
    new = np.zeros(length)
    common = at.HEADER + 6 * system.size + 6
    new[:common] = old[:common]
    new = followed(new, system)
    if old[at.INERTIAS] == new[at.INERTIAS]:
        new[length:] = old[int(old[at.INERTIAS_AT]) :]
    new[at.FRESH] = 1.0
    return new
