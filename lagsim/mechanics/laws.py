"""Rows that hold at times: contacts, friction, limits, freewheels, and their laws.

A contact's gap g >= 0 has the row of g = 0, with a multiplier >= 0; each of its slips s
that of s = 0, with a multiplier of at most mu times that of the contact, which opposes
s while it slides. A limited equality has its own bound. Where a row is out of force its
multiplier is 0.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from lagsim.mechanics.constraints import Flow, Row, constraint_row

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lagsim.language.graph import Graph
    from lagsim.model.model import Constraint, OneSided


class Kind(Enum):
    """What ends the time for which a row holds."""

    CONTACT = "a gap that stays >= 0"
    FREEWHEEL = "a rate that stays >= 0"
    SLIP = "a sliding velocity that the friction of a contact opposes"
    LIMITED = "an equality whose multiplier is bounded"
    TIMED = "an equality that is in force at times"


class Law(NamedTuple):
    """One such row.

    Attributes
    ----------
    row : Row
        Where it holds as an equality.
    constraint : str
        The name in the file; a slip has that of its contact.
    multiplier : str
        The name of its variable, and column.
    restitution : float
        Newton's, of a contact.
    bound, static : int
        The friction coefficient while it slides and while it sticks, or the largest
        size of the multiplier: nodes. Zero where there is none.
    normal, pair : int
        The number of the law of its contact, and of the other slip of two; or -1.
    when : int or None
        The condition of t and parameters under which it is in force: a node.
    """

    row: Row
    kind: Kind
    constraint: str
    multiplier: str
    restitution: float = 0.0
    bound: int = 0
    static: int = 0
    normal: int = -1
    pair: int = -1
    when: int | None = None

    def bouncing(self, restitution: float) -> Law:
        """Give the same with another restitution, where it is a contact's."""
        bounces = self.kind in (Kind.CONTACT, Kind.FREEWHEEL)
        return self._replace(restitution=restitution) if bounces else self

    def moved(self, g: Graph, rates: Sequence[int]) -> int:
        """Give what times the multiplier is its power.

        What slides does work, whatever else it is.
        """
        if self.kind in (Kind.SLIP, Kind.LIMITED):
            entries = self.row.A.entries.items()
            return g.product_sum((slope, rates[j]) for j, slope in entries)
        return self.row.transport


def laws_of(g: Graph, constraints: Sequence[Constraint], flow: Flow) -> Iterator[Law]:
    """Derive the laws of all constraints but plain equalities, slips after contacts."""
    count = 0
    for c in constraints:
        if c.always:
            continue
        row = constraint_row(g, c.name, c.relation.node, flow)
        name, zero = f"lambda_{c.name}", g.zero
        if c.law is None:
            kind = Kind.TIMED if c.limit is None else Kind.LIMITED
            limit = zero if c.limit is None else c.limit
            yield Law(row, kind, c.name, name, bound=limit, static=limit, when=c.when)
            count += 1
            continue
        kind = Kind.CONTACT if row.holonomic else Kind.FREEWHEEL
        e = c.law.restitution
        yield Law(row, kind, c.name, name, e, zero, zero, when=c.when)
        yield from _slips(g, c.name, c.law, flow, count)
        count += 1 + len(c.law.slips)


def _slips(
    g: Graph, name: str, law: OneSided, flow: Flow, normal: int
) -> Iterator[Law]:
    """Derive the slips of the contact that is the law of number `normal`."""
    count = len(law.slips)
    if not count or law.friction is None:
        return
    static = law.friction if law.static is None else law.static
    for k, slip in enumerate(law.slips, 1):
        column = f"friction.{name}" if count == 1 else f"friction.{name}.{k}"
        other = normal + 3 - k if count == 2 else -1
        yield Law(
            constraint_row(g, column, slip, flow), Kind.SLIP, name, column,
            bound=law.friction, static=static, normal=normal, pair=other,
        )  # fmt: skip
