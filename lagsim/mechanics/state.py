"""A state of a scene: time, coordinates, velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


@dataclass(frozen=True, slots=True)
class State:
    """Where a scene is at a time. q, v : (n,)."""

    t: float
    q: Floats
    v: Floats
