"""Rows that may be in force: bounds of multipliers, and accelerations by multipliers.

The multiplier p of a row lies between two multiples of the bound of the row. The roles
of rows (`constraints.Role`) differ only in these columns of `RowTable`:

    ================== ========= == ======= ==== ==================================
    row                low, high of pair    gap  ends
    ================== ========= == ======= ==== ==================================
    equality           -inf, inf                 at times known ahead; or never
    contact            0, inf               yes  off: gap 0; held: p = 0
    freewheel          0, inf                    off: rate 0; held: p = 0
    slip of contact n  -1, 1     n  of two       held: at its bound; slides: stops
    limited equality   -1, 1        of two       held: at its bound; slides: stops
    surface            -1, 1                     held: at its bound
    ================== ========= == ======= ==== ==================================

The bound is the friction coefficient or limit of the row, and 1 for unbounded
multipliers; "of n" multiplies it by the multiplier of the contact n. A row with a gap
bounces. In an impact a bounded multiplier has no impulse unless the impulse of a
contact bounds it.

The accelerations of all rows due to unit multipliers are the Delassus matrix, with the
equalities in force eliminated. This module uses neither the graph nor the state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.algebra import Metric, cholesky, whitened_rows
from lagsim.mechanics.complementarity import ComplementarityProblem
from lagsim.tolerances import DEPENDENT_ROWS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Flags, Floats, Ints
    from lagsim.mechanics.constraints import Law


class Mode(IntEnum):
    """Mode of a row; see the module docstring for the ends of modes."""

    OFF = 0  # the multiplier is 0
    HELD = 1  # in force as an equality
    SLIDING = 2  # the multiplier is at its bound
    REDUNDANT = 3  # implied by held rows


class RowTable:
    """Table of the constant data of r rows: bounds, contacts, pairs, and masks.

    Attributes
    ----------
    low, high : ndarray, shape (r,)
        The bounds of each multiplier, as multiples of the bound of its row.
    normals, pairs : ndarray of int, shape (r,)
        The index of the row of the contact of a slip; the index of the other row of a
        pair of slips or of limited rows; -1 where there is none.
    gapped, poisson : ndarray of bool, shape (r,)
        Rows with a gap, which bounce; those with restitution of impulses (Poisson), not
        of rates (Newton).
    equal, one_sided, bounded, slips : ndarray of bool, shape (r,)
        Masks by `low` and `high`: rows without bounds; with one bound, 0; with two
        bounds; with two bounds and a contact.
    has_slips : bool
        Whether a row is the slip of a contact.
    strikes : ndarray of bool, shape (r,)
        Rows with an impulse in an impact.
    normal_of, is_one_sided : list of int, of bool
        `normals` and `one_sided` as lists, whose elements are read faster.
    """

    def __init__(
        self, low: Floats, high: Floats, normals: Ints, pairs: Ints, gapped: Flags,
        poisson: Flags,
    ) -> None:  # fmt: skip
        self.low, self.high, self.normals, self.pairs = low, high, normals, pairs
        self.gapped, self.poisson = gapped, poisson
        self.equal, self.one_sided = np.isneginf(low), low == 0.0
        self.bounded = np.isfinite(high)
        self.slips = self.bounded & (normals >= 0)
        self.has_slips = bool(self.slips.any())
        self.strikes = self.slips | ~self.bounded
        self.normal_of: list[int] = normals.tolist()
        self.is_one_sided: list[bool] = self.one_sided.tolist()
        self._parts: dict[tuple[int, ...], RowTable] = {}

    def __len__(self) -> int:
        return len(self.low)

    @cached_property
    def coupled_rows(self) -> list[list[int]]:
        """For each row, the indices of rows that its bounds or a disc couple with it.

        They are the contact of a slip, the slips of a contact, and the other row of a
        disc.
        """
        found = [list[int]() for _ in self.normal_of]
        for others in (self.normals, self.pairs):
            for k, j in enumerate(others.tolist()):
                if j >= 0:
                    found[k].append(j)
                    found[j].append(k)
        return found

    @cached_property
    def discs(self) -> list[list[int]]:
        """Pairs of indices of the rows of a disc: two slips, or two limited rows."""
        return [[k, j] for k, j in enumerate(self.pairs.tolist()) if j > k]

    @classmethod
    def of(cls, laws: Sequence[Law]) -> RowTable:
        """Return the table of the rows of laws."""
        return cls(
            np.array([law.role.low for law in laws]),
            np.array([law.role.high for law in laws]),
            np.array([law.normal for law in laws], dtype=int),
            np.array([law.pair for law in laws], dtype=int),
            np.array([law.role.gapped for law in laws], dtype=bool),
            np.array([law.poisson for law in laws], dtype=bool),
        )

    def part(self, indices: Sequence[int]) -> RowTable:
        """Return the table of the rows at `indices`; memoized.

        A slip whose contact is not among these rows loses its contact.
        """
        key = tuple(indices)
        found = self._parts.get(key)
        if found is None:
            at, place = np.array(key, dtype=int), np.full(len(self) + 1, -1)
            place[at] = np.arange(len(at))  # the last entry is for index -1
            if len(self._parts) >= MOST_PARTS:
                self._parts.clear()
            found = self._parts[key] = RowTable(
                self.low[at], self.high[at], place[self.normals[at]],
                place[self.pairs[at]], self.gapped[at], self.poisson[at],
            )  # fmt: skip
        return found

    def with_equalities(self, rows: Sequence[int]) -> RowTable:
        """Return the table with the rows `rows` as equalities, without bounds."""
        if not len(rows):
            return self
        low, high, gapped = self.low.copy(), self.high.copy(), self.gapped.copy()
        low[rows], high[rows], gapped[rows] = -np.inf, np.inf, False
        return RowTable(low, high, self.normals, self.pairs, gapped, self.poisson)

    def with_rows(self, count: int, most: float) -> RowTable:
        """Return the table with `count` rows appended, without gaps or friction.

        most : the bound of the multipliers in both directions, as a multiple of the
            bound of the row; infinity for equalities.
        """
        alone, none = np.full(count, -1), np.zeros(count, dtype=bool)
        size = np.full(count, most)
        return RowTable(
            np.append(self.low, -size), np.append(self.high, size),
            np.append(self.normals, alone), np.append(self.pairs, alone),
            np.append(self.gapped, none), np.append(self.poisson, none),
        )  # fmt: skip


# Largest number of parts that a table keeps.
MOST_PARTS = 64


@dataclass(frozen=True)
class Closed:
    """The r rows that may be in force: closed contacts, their slips, and other laws.

    Attributes
    ----------
    table : RowTable
        The constant data of the rows.
    D : ndarray, shape (r, r)
        The Delassus matrix: D_ij is the acceleration of row i due to a multiplier 1
        of row j (or its change of rate due to an impulse 1). A zero diagonal entry
        marks a row that no multiplier accelerates.
    bounds, statics : ndarray, shape (r,)
        The friction coefficient, or limit, while the row slides and while it sticks.
    restitutions : ndarray, shape (r,)
        The coefficients of restitution.
    factor : ndarray, shape (k, r)
        D = factor^T factor. Rows at a small angle are independent in the factor even
        where they are dependent in D to rounding.
    pushes : ndarray, shape (k, r), optional
        Present where shares of switching surfaces are rows, too:
        D = factor^T pushes.
    """

    table: RowTable
    D: Floats
    bounds: Floats
    statics: Floats
    restitutions: Floats
    factor: Floats
    pushes: Floats | None = None

    def __len__(self) -> int:
        return len(self.table)

    @cached_property
    def columns(self) -> Floats:
        """Matrix C (k, r) with D = factor^T C: `pushes`, or `factor` without these."""
        return self.factor if self.pushes is None else self.pushes

    def with_shares(self, D: Floats, bounds: Floats) -> Closed:
        """Return the rows with s further ones, for the shares w of switching surfaces.

        The share w in [0, 1] is the part of the upper side in the forces along a
        surface. The multiplier of its row is proportional to 1/2 - w, and thus bounded
        in both directions. The jump of the forces need not be along the row, so that D
        need not be symmetric.

        Parameters
        ----------
        D : ndarray, shape (r + s, r + s)
            The Delassus matrix of all rows.
        bounds : ndarray, shape (s,)
            The bounds of the further multipliers.
        """
        if not len(bounds):
            return self
        return replace(
            self, table=self.table.with_rows(len(bounds), 1.0), D=D,
            factor=np.eye(len(D)), pushes=D, bounds=np.append(self.bounds, bounds),
            statics=np.append(self.statics, bounds),
        )  # fmt: skip

    def with_equalities(self, D: Floats) -> Closed:
        """Return the rows with e further ones, which are equalities.

        D : the Delassus matrix (r + e, r + e) of all rows.
        """
        more = np.zeros(len(D) - len(self))
        bounds, statics, restitutions = (
            np.append(x, more) for x in (self.bounds, self.statics, self.restitutions)
        )
        table, unit = self.table.with_rows(len(more), math.inf), np.eye(len(D))
        return Closed(table, D, bounds, statics, restitutions, unit, pushes=D)

    def problem(
        self, c: Floats, sizes: Floats, directions: Floats, *, given: Flags
    ) -> ComplementarityProblem:
        """Return the complementarity problem of r rows with accelerations or rates c.

        Parameters
        ----------
        c : ndarray, shape (r,)
            Accelerations or rates at multipliers 0.
        sizes : ndarray, shape (r,)
            Bounds of bounded multipliers; of slips, as parts of the multiplier of the
            contact.
        directions : ndarray, shape (r,)
            For rows that slide: the multiplier as a part of its bound, in [-1, 1].
        given : ndarray of bool, shape (r,)
            The rows that slide.
        """
        table, pairs = self.table, self.table.pairs
        size = np.where(table.bounded, sizes, 1.0)
        low, high = (
            np.where([~table.slips, table.slips], x * size, 0.0)
            for x in (table.low, table.high)
        )
        if given.any():
            low[:, given] = high[:, given] = high[:, given] * directions[given]
            pairs = np.where(given, -1, pairs)
        return ComplementarityProblem(self.D, c, low, high, table.normals, pairs)


class Delassus(NamedTuple):
    """Accelerations of r rows, and of n coordinates, due to multipliers of the rows.

    Attributes
    ----------
    D : ndarray, shape (r, r)
        The Delassus matrix rows K rows^T, where K f is the acceleration (n,) due to
        forces f (n,).
    response : ndarray, shape (n, r)
        K rows^T.
    factor : ndarray, shape (k, r)
        D = factor^T factor, with k the number of free directions.
    """

    D: Floats
    response: Floats
    factor: Floats


def delassus(M: Floats, A: Floats, rows: Floats) -> Delassus:
    """Compute the Delassus matrix of constraint rows under equalities.

    Rows that the equalities determine, and which no multiplier accelerates, have zero
    columns in the factor.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        The mass matrix, positive definite on the null space of A. Massless coordinates
        are admissible.
    A : ndarray, shape (e, n)
        The rows of the equalities; may be linearly dependent.
    rows : ndarray, shape (r, n)
        The rows whose mutual accelerations are computed.
    """
    diagonal = M.diagonal()
    if not len(A) and np.count_nonzero(M) == len(M) and diagonal.min() > 0.0:
        factor = (rows / np.sqrt(diagonal)).T
        return Delassus(factor.T @ factor, (rows / diagonal).T, factor)
    if not len(A):
        back = np.linalg.inv(cholesky(M).T)
        factor = back.T @ rows.T
        return Delassus(factor.T @ factor, back @ factor, factor)
    metric = Metric(M, A)
    factor = metric.free.T @ rows.T
    _, lengths = whitened_rows(rows, metric.L)
    factor[:, np.linalg.norm(factor, axis=0) <= DEPENDENT_ROWS * lengths] = 0.0
    return Delassus(factor.T @ factor, metric.free @ factor, factor)
