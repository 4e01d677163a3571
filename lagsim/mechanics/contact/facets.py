"""Friction as a complementarity problem: the sides of a box, or facets for a disc.

Along directions d_i that span the slips of a contact, p = sum of a_i d_i with a >= 0,
and with l for the size of the slip

    a_i >= 0 complements d_i . w + l
    l >= 0 complements bound - sum of a_i

which is copositive for every mu: there is a solution, and Lemke's method finds it. For
one slip, with the directions 1 and -1, that is Coulomb's law; for two it has corners.

Source: D. E. Stewart, J. C. Trinkle, An implicit time-stepping scheme for rigid body
dynamics with inelastic collisions and Coulomb friction, Int. J. Num. Meth. Eng. 39
(1996) 2673.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.closed import Mode
from lagsim.mechanics.contact.pivoting import lemke
from lagsim.mechanics.contact.polish import DEPENDENT, expressed
from lagsim.mechanics.contact.problem import Problem, Role

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats

# Directions in which a disc is replaced by a polygon: to start Newton's method.
CORNERS = 8
SIDES = np.array([[1.0], [-1.0]])
ANGLES = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
POLYGON = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


class Facets:
    """A problem whose unknown rows are signed ones, then groups of boxed ones.

    Attributes
    ----------
    signed : list of int
    groups : list of list of int
        One row, or the two of a disc.
    """

    def __init__(self, problem: Problem) -> None:
        rows = list(enumerate(problem.roles))
        self.problem = problem
        self.signed = [k for k, role in rows if role is Role.SIGNED]
        self.groups = [
            [k] if problem.pairs[k] < 0 else [problem.pairs[k], k]
            for k, role in rows
            if role is Role.BOXED and problem.pairs[k] < k
        ]
        self.directions = [SIDES if len(g) == 1 else POLYGON for g in self.groups]

    def matrix(self) -> tuple[Floats, Floats]:
        """Give M and q of the complementarity problem."""
        problem, signed, n = self.problem, self.signed, len(self.signed)
        unknown = signed + [k for group in self.groups for k in group]
        G, h = _reduced(problem, unknown)
        N = self.spread()
        slopes, m = N.shape[1], len(self.groups)
        M = np.zeros((slopes + m, slopes + m))
        q = np.zeros(slopes + m)
        M[:slopes, :slopes] = N.T @ G @ N
        q[:slopes] = N.T @ h
        place = {k: i for i, k in enumerate(signed)}
        at = n
        for i, (group, d) in enumerate(
            zip(self.groups, self.directions, strict=True), slopes
        ):
            M[at : at + len(d), i] = 1.0
            M[i, at : at + len(d)] = -1.0
            at += len(d)
            k = group[0]
            q[i] = problem.limits[k]
            if problem.normals[k] in place:
                M[i, place[problem.normals[k]]] = problem.mus[k]
        return M, q

    def spread(self) -> Floats:
        """Give N: p of the unknown rows = N a."""
        n = len(self.signed)
        rows = n + sum(d.shape[1] for d in self.directions)
        N = np.zeros((rows, n + sum(map(len, self.directions))))
        N[:n, :n] = np.eye(n)
        i = j = n
        for d in self.directions:
            N[i : i + d.shape[1], j : j + len(d)] = d.T
            i, j = i + d.shape[1], j + len(d)
        return N

    def split(self, basis: Flags) -> tuple[list[list[bool]], list[bool]]:
        """Give which directions of each group, and which of their slips, are basic."""
        at, parts = len(self.signed), []
        for d in self.directions:
            parts.append(basis[at : at + len(d)].tolist())
            at += len(d)
        return parts, basis[at:].tolist()


def with_corners(problem: Problem) -> Floats | None:
    """Give multipliers (r,) where discs are polygons, if there is a solution."""
    facets = Facets(problem)
    M, q = facets.matrix()
    basis = lemke(M, q)
    if basis is None:
        return None
    N = facets.spread()
    a = np.zeros(len(q))
    a[basis] = np.linalg.lstsq(M[np.ix_(basis, basis)], -q[basis], rcond=DEPENDENT)[0]
    p = np.zeros(len(problem.c))
    p[facets.signed + [k for g in facets.groups for k in g]] = N @ a[: N.shape[1]]
    return p


def _reduced(problem: Problem, unknown: list[int]) -> tuple[Floats, Floats]:
    """Give G, h: w = G p + h of the unknown rows, what is given and free put in."""
    if len(unknown) == len(problem.roles):
        return problem.D[unknown][:, unknown], np.array(problem.c)[unknown]
    present = [
        Mode.OFF
        if role is Role.ABSENT
        else Mode.DRIVEN
        if role is Role.GIVEN
        else Mode.HELD
        for role in problem.roles
    ]
    E, p0 = expressed(problem, present, problem.ways)
    G, h = problem.D @ E, problem.c + problem.D @ p0
    free = [k for k, role in enumerate(problem.roles) if role is Role.FREE]
    if free:
        B = np.column_stack([G[np.ix_(free, unknown)], h[free]])
        X = np.linalg.lstsq(G[np.ix_(free, free)], B, rcond=DEPENDENT)[0]
        taken = G[np.ix_(unknown, free)] @ X
        return G[np.ix_(unknown, unknown)] - taken[:, :-1], h[unknown] - taken[:, -1]
    return G[np.ix_(unknown, unknown)], h[unknown]
