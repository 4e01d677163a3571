"""The memory that carries a run from arc to arc, and from method to method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.methods.parts.driver import State
    from lagsim.run.system.runner import Runner

    Options = Sequence[tuple[str, float]]

# The method where the motion slides along a surface and the method of the run needs
# more of the model than y'.
SLIDING = "dop853"
# A method whose steps may fail for other reasons than stiffness: of them nothing is
# said, and it is looked at after so many steps, some ten milliseconds.
SERIES = "taylor"
LONG = 20_000
# A state that slides is pulled back by what a step errs: a few times the tolerance
# by a method that has one, and this part of the motion by any other.
MOST_PULLED = 1e-2
LEAST_PULLED = 1e-9
ERRED = 1e4


def pulled(masses: Floats, change: Floats, reach: Floats, sizes: Floats) -> float:
    """Give how far a change goes, against the reach of what it moves.

    As `methods.parts.driver.pulled`: each coordinate counts by the push that it gets.
    """
    from lagsim.methods.parts.driver import ROUNDED

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


def empty_state(runner: Runner, options: Options = ()) -> State:
    """Give a state of a method that nothing but its own options has been put into."""
    state = runner.empty.copy()
    for name, value in options:
        if name in state.fields:
            setattr(state, name, value)
    return state


def named_extents(state: State, names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Give the least and the greatest values by the names of the components."""
    low, high = state.low.tolist(), state.high.tolist()
    return dict(zip(names, zip(low, high, strict=True), strict=True))


def taken_over(state: State, runner: Runner, options: Options = ()) -> State:
    """Give a state as that of another method or system, at the start of an arc."""
    new = empty_state(runner, options)
    own = (new.kinds, new.powers, new.joined, new.linked)
    kept = [values.copy() for values in own]
    new.take(state)
    for values, before in zip(own, kept, strict=True):
        values[:] = before
    new.fresh = 1.0
    return new
