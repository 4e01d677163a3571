"""Where a scene is at a time: coordinates and velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


@dataclass(frozen=True, slots=True)
class Instant:
    """A time and the state there. q, v : (n,)."""

    t: float
    q: Floats
    v: Floats
