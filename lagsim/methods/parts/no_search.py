"""Kernels without effect, in place of searches in models with nothing to search."""

from __future__ import annotations

from lagsim.language.arrays import Floats
from lagsim.methods.parts.crossings import Crossings
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.search_table import SearchTable


def find_crossings(_s: Crossings, _p: Parameters) -> int:
    """Return 1: no crossing is stored, and the buffer is not full."""
    return 1


def find_end(_s: Crossings, _p: Parameters) -> None:
    """Leave the last step as it is: no surface, law or condition may end it."""


def missed_feature(_s: Crossings, _p: Parameters) -> float:
    """Return 0: no localized term is missed."""
    return 0.0


def check_features(
    _s: SearchTable,
    _p: Parameters,
    _h: float,
    _old: Floats,
    _old_rates: Floats,
    _new: Floats,
    _new_rates: Floats,
) -> None:
    """Leave `feature_possible` at 0: no term is localized."""
