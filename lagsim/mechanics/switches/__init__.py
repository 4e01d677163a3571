"""Which switches a model has, and its expressions with their branches frozen."""

from __future__ import annotations

from lagsim.mechanics.switches.find import (
    Mode,
    StateSwitch,
    Switches,
    find_switches,
    prevailing,
)
from lagsim.mechanics.switches.motion import model_switches
from lagsim.mechanics.switches.surfaces import (
    Side,
    Surface,
    joined_conditions,
    surfaces,
)

__all__ = [
    "Mode",
    "Side",
    "StateSwitch",
    "Surface",
    "Switches",
    "find_switches",
    "joined_conditions",
    "model_switches",
    "prevailing",
    "surfaces",
]
