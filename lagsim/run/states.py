"""The array that carries a run, with room for every method that may come to use it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import method
from lagsim.methods.parts import state as at
from lagsim.methods.parts.driver import ROUNDED
from lagsim.methods.parts.looks import looks_size
from lagsim.methods.parts.switching import search_size

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.system.runner import Runner

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


def pulled(masses: Floats, change: Floats, reach: Floats, sizes: Floats) -> float:
    """Give how far a change goes, against the reach of what it moves.

    As `methods.parts.driver.pulled`: each coordinate counts by the push that it gets.
    """
    more = np.abs(change) > ROUNDED * sizes
    moved = float(masses @ np.where(more, change, 0.0) ** 2)
    if moved == 0.0:
        return 0.0
    whole = float(np.linalg.norm(masses * change * reach))
    return moved / whole if whole > 0.0 else 1.0


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
    # And room for rows side by side, for what `driver.keep_sizes` notes, for the
    # extents of the motion, for looks into steps, for what ends them early, and for
    # what `driver.note_inertias` notes.
    sizes = used + at.lanes_size(system.size)
    ranges = sizes + 3 * system.size
    looks = ranges + at.extents_size(system.size)
    watched = len(system.sleepers)
    searched = looks + looks_size(system.size, watched)
    noted = searched + search_size(system.surfaces)
    count = len(system.inertias)
    state = np.zeros(noted + 3 * count)
    state[at.LANES_AT], state[at.SIZES_BEFORE] = used, sizes
    state[at.EXTENTS_AT] = ranges
    state[ranges : ranges + system.size] = np.inf
    state[ranges + system.size : ranges + 2 * system.size] = -np.inf
    state[at.LOOKS_AT], state[at.SIGNALS] = looks, watched
    for k, sleeper in enumerate(system.sleepers):
        state[looks + k] = sleeper.kind
        state[looks + watched + k] = sleeper.power
    state[at.SEARCH_AT] = searched
    state[at.INERTIAS], state[at.INERTIAS_AT] = count, noted
    state[noted + count :][:count] = np.inf  # the smallest so far
    return state


def extents(state: Floats) -> Floats:
    """Give the least and the greatest value of each component: a view (2, size)."""
    size, first = int(state[at.SIZE]), int(state[at.EXTENTS_AT])
    return state[first : first + 2 * size].reshape(2, size)


def named_extents(
    state: Floats, names: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Give them by the names of the components."""
    low, high = extents(state).tolist()
    return dict(zip(names, zip(low, high, strict=True), strict=True))


def taken_over(state: Floats, runner: Runner) -> Floats:
    """Give a state as that of another method or system, at the start of an arc."""
    new = empty_state(runner)
    own = [at.INERTIAS, at.INERTIAS_AT, at.LANES_AT, at.SIZES_BEFORE, at.EXTENTS_AT]
    own += [at.SIGNALS, at.LOOKS_AT, at.SEARCH_AT]
    kept = new[own]
    common = at.HEADER + 6 * runner.system.size + 6
    new[:common] = state[:common]
    here, size = int(kept[4]), runner.system.size
    length = at.extents_size(size)
    new[here : here + length] = state[int(state[at.EXTENTS_AT]) :][:length]
    if state[at.INERTIAS] == kept[0]:
        new[int(kept[1]) :] = state[int(state[at.INERTIAS_AT]) :]
    new[own] = kept
    new[at.FRESH] = 1.0
    return new
