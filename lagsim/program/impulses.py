"""The function `impulses` of models whose events give impulses.

It evaluates the mass matrix, the constraint rows, the momenta and the generalized
impulses of all coordinates, also of coordinates that a reduction eliminates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.sparse import DisjointSets
from lagsim.mechanics.forces import generalized_impulses, without_momentum

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Flags, Floats, Ints
    from lagsim.mechanics.equations import Equations


class JumpData(NamedTuple):
    """Data of the jumps of velocities at a state, for all n coordinates.

    Attributes
    ----------
    M : ndarray, shape (n, n)
        The mass matrix, with 1 on the diagonal of coordinates without momentum that no
        row holds.
    rows : ndarray, shape (R, n)
        The rows of the equalities that always hold, then of the laws.
    holds : ndarray of bool, shape (R,)
        The rows that transmit impulses of either sign: equalities in force.
    momenta, velocities : ndarray, shape (n,)
        dL/dq', and q'.
    impulses : ndarray, shape (E, n)
        The generalized impulses of the E events.
    """

    M: Floats
    rows: Floats
    holds: Flags
    momenta: Floats
    velocities: Floats
    impulses: Floats


class ImpulseFunction:
    """The nodes of the function `impulses`, and the meaning of its values.

    Parameters
    ----------
    e : Equations
        The full equations.
    recovered : mapping of int to int
        Variables that a reduction removed -> their expressions.

    Attributes
    ----------
    nodes : list of int
        The expressions whose values `data` sorts.
    first_condition : int
        The index of the first node of conditions and impulses, which are evaluated as
        the file states them; the nodes before it are evaluated on the present sides of
        switches.
    is_curved : bool
        Whether M or a row depends on velocities, so that the jump of the velocities is
        not proportional to the impulse.
    always : list of str
        The names of the equalities that always hold.
    groups : list of (ndarray of int, ndarray of int)
        Decoupled groups of coordinates, by their indices, each with the indices of the
        rows of equalities that act on them.
    """

    def __init__(self, e: Equations, recovered: Mapping[int, int]) -> None:
        g, self.n = e.graph, len(e.q)
        self.always = [row.name for row in e.rows]
        self._equal = np.array([x.equal for x in e.relations], dtype=bool)
        mass, rows = e.mass_entries, [A.entries for A in e.slopes]
        kicks = generalized_impulses(e)
        self._mass = [*mass]
        self._slopes = [(k, j) for k, A in enumerate(rows) for j in A]
        slopes = [node for A in rows for node in A.values()]
        self._free = without_momentum(e)
        self.groups = _groups(e)
        fast = frozenset(e.velocities)
        self.is_curved = bool(g.dependent([*mass.values(), *slopes], fast))
        self._events = len(kicks)
        nodes = [*mass.values(), *slopes, *e.momenta, *map(g.variable, e.velocities)]
        self.first_condition = len(nodes)
        nodes += [
            *(g.one if x.when is None else x.when for x in e.relations),
            *(node for kick in kicks for node in kick),
        ]  # fmt: skip
        self.nodes = list(g.substitute(nodes, recovered))

    def data(self, values: Floats) -> JumpData:
        """Return the values (len(nodes),) of the function, sorted by their meaning."""
        n, count = self.n, len(self._equal)
        sizes = len(self._mass), len(self._slopes), n, n, count
        parts = np.split(values, np.cumsum(sizes))
        M, rows = np.zeros((n, n)), np.zeros((count, n))
        if self._mass:
            M[tuple(np.transpose(self._mass))] = parts[0]
        if self._slopes:
            rows[tuple(np.transpose(self._slopes))] = parts[1]
        M[self._free, self._free] = 1.0
        holds = self._equal & (parts[4] != 0.0)
        return JumpData(M, rows, holds, parts[2], parts[3], parts[5].reshape(-1, n))


def _groups(e: Equations) -> list[tuple[Ints, Ints]]:
    """Return the groups of coordinates that masses or equalities couple.

    See `ImpulseFunction.groups`.
    """
    sets = DisjointSets(len(e.q))
    for i, j in e.mass_entries:
        sets.unite([i, j])
    equalities = {k: x.row.A.entries for k, x in enumerate(e.relations) if x.equal}
    for A in equalities.values():
        sets.unite([*A])
    found = []
    for group in sets.sets():
        rows = [k for k, A in equalities.items() if not A.keys().isdisjoint(group)]
        found.append((np.array(group, dtype=int), np.array(rows, dtype=int)))
    return found
