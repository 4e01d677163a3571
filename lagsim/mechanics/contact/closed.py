"""The rows that could act at a state, and how they answer to multipliers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.laws import Kind


class Mode(IntEnum):
    """What a row does."""

    OFF = 0  # no multiplier
    HELD = 1  # an equality with its multiplier
    DRIVEN = 2  # not held: the multiplier has the size of its bound
    IMPLIED = 3  # it holds because others do


@dataclass(frozen=True, slots=True)
class Closed:
    """Contacts that touch with their slips, and other rows in force: r of them.

    Attributes
    ----------
    D : ndarray, shape (r, r)
        The Delassus matrix: the accelerations of the rows (or rates, of impulses) that
        multipliers of one give. Zero in the diagonal: a row on which nothing acts.
    kinds : tuple of Kind
    normals : tuple of int
        Of a slip: the row of its contact; else -1.
    pairs : tuple of int
        Of one of two slips: the row of the other; else -1.
    bounds, statics : ndarray, shape (r,)
        The friction coefficient while it slides and while it sticks, or the limit.
    restitutions : ndarray, shape (r,)
    factor : ndarray, shape (k, r), optional
        D = factor^T factor, from which rows at a small angle are still told apart.
    """

    D: Floats
    kinds: tuple[Kind, ...]
    normals: tuple[int, ...]
    pairs: tuple[int, ...]
    bounds: Floats
    statics: Floats
    restitutions: Floats
    factor: Floats | None = None
