"""Constraint rows on the graph: equalities, and those that hold at times.

Holonomic g(q, t) = 0: A = dg/dq, its rate is A q' + g_t, and A q'' = b with
b = -d^2 g/dt^2 at constant q'. Nonholonomic phi(q, q', t) = 0: A = dphi/dq'
(Chetaev's rule where phi is not linear), its rate is phi, b = -(phi_q q' + phi_t).

A contact's gap g >= 0 has the row of g = 0, with a multiplier >= 0; each of its slips s
that of s = 0, with a multiplier of at most mu times that of the contact, which opposes
s while it slides. A limited equality has its own bound. Where a row is out of force its
multiplier is 0.
"""

from __future__ import annotations

from enum import Enum
from math import inf
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import gradient, slopes, tangent
from lagsim.language.evaluate import addends
from lagsim.language.sparse import SparseVector
from lagsim.mechanics.pieces import MARK, named, pieces, whole
from lagsim.methods.parts import parameters as kept
from lagsim.model.model import APPROACH_SPEED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.model.model import Constraint, OneSided, State

    Words = tuple[str, str]


class Row(NamedTuple):
    """Constraint that holds as an equality, as nodes.

    Attributes
    ----------
    residual : int
        g, or phi.
    rate : int
        What must vanish on the level of velocities: A q' + g_t, or phi.
    A : SparseVector, shape (n,)
    b : int
    transport : int
        A q' on the constraint: -g_t, or A q' for phi not homogeneous in q', else 0.
        Its product with lambda is the constraint's power.
    residual_scale, rate_scale : int
        The largest of the terms and of |q_i dg/dq_i| (of |q'_i d rate/d q'_i|): what a
        residual is compared with, so that units do not matter.
    """

    name: str
    holonomic: bool
    residual: int
    rate: int
    A: SparseVector
    b: int
    transport: int
    residual_scale: int
    rate_scale: int
    scleronomic: bool
    pfaffian: bool


class Flow:
    """The variables of motion, as nodes, by which rows are differentiated.

    Attributes
    ----------
    positions, rates : tuple of int, shape (n,)
    velocities : frozenset of str
        The names of the rates.
    forward : dict
        The total time derivative at constant q': variable -> rate.
    states : dict
        The part of it that is the first-order states': variable -> rate.
    """

    def __init__(
        self,
        g: Graph,
        q: Sequence[str],
        velocities: Sequence[str],
        states: Iterable[State] = (),
    ) -> None:
        self.positions = tuple(g.variable(name) for name in q)
        self.rates = tuple(g.variable(name) for name in velocities)
        self.velocities = frozenset(velocities)
        self.forward = dict(zip(self.positions, self.rates, strict=True))
        self.forward[g.variable("t")] = g.one
        self.states = {g.variable(x.name): x.rate for x in states}
        self.forward |= self.states
        self.indices = [
            {v: j for j, v in enumerate(group)}
            for group in (self.positions, self.rates)
        ]

    def gradient(self, g: Graph, node: int, *, by_rates: bool) -> SparseVector:
        """Return d node / d q, or d node / d q'."""
        index = self.indices[by_rates]
        here = frozenset(v for v in g.cone([node]) if v in index)
        found = slopes(g, node, here)
        entries = {index[v]: slope for v, slope in found.items()}
        return SparseVector(g, len(index), entries)


def constraint_row(g: Graph, name: str, node: int, flow: Flow) -> Row:
    """Derive the row of an equality constraint `node` = 0."""
    names = g.depends([node])
    holonomic = not names & flow.velocities
    A = flow.gradient(g, node, by_rates=not holonomic)
    moved = g.product_sum((slope, flow.rates[j]) for j, slope in A.entries.items())
    if holonomic:
        drift = gradient(g, node, [g.variable("t")])[0]
        # Forward, common differences stay as they are: d^2 + ... has 2*d*d' + ...
        rate = tangent(g, [node], flow.forward)[0]
        transport = g.call("neg", drift)
        residual_scale = scale_of(g, node, flow.positions, A.entries)
    else:
        rate = node
        degrees = g.degree(node, flow.velocities)
        homogeneous = degrees is not None and degrees.least == degrees.most
        transport = g.zero if homogeneous else moved
        residual_scale = scale_of(g, node, flow.rates, A.entries)
    degrees = g.degree(rate, flow.velocities)
    return Row(
        name=name,
        holonomic=holonomic,
        residual=node,
        rate=rate,
        A=A,
        b=g.call("neg", tangent(g, [rate], flow.forward)[0]),
        transport=transport,
        residual_scale=residual_scale,
        rate_scale=scale_of(g, rate, flow.rates, A.entries),
        scleronomic="t" not in names,
        pfaffian=degrees is not None and degrees.most <= 1,
    )


def scale_of(
    g: Graph, node: int, variables: Sequence[int], entries: Mapping[int, int]
) -> int:
    """Return the largest of the terms of `node` and of |variable * slope|."""
    sizes = [g.call("abs", term) for term in addends(g, node)]
    sizes += [
        g.call("abs", g.call("mul", variables[j], slope))
        for j, slope in entries.items()
    ]
    largest = g.zero
    for size in sizes:
        largest = g.call("max", largest, size)
    return largest


class Slider(NamedTuple):
    """Motion of a limited relation on a coordinate without mass, see `reduction`.

    Attributes
    ----------
    coordinate : int
    force : int
        Its multiplier, as a node of the state.
    way : str
        The variable that tells how it moves: 0 where it sticks, else the sign of its
        multiplier, or 1 of two relations.
    row : Row
        The one that holds as it moves now.
    limit, left : int
        What its force is below its limit by; its event function: nodes.
    first : bool
        It is no second relation of two.
    """

    coordinate: int
    force: int
    way: str
    row: Row
    limit: int
    left: int
    first: bool


class Kind(Enum):
    """Role of a row that holds at times: what it may transmit, and what ends that.

    Its multiplier is between `low` and `high` times its bound (of a slip: times that of
    its contact too). In force it is off, held, or slides at an end of a finite bound.

    ============ ============= ==================================================
    role         bounds        ends
    ============ ============= ==================================================
    CONTACT      0, inf        off: its gap closes; held: it would pull
    FREEWHEEL    0, inf        off: its rate falls to 0; held: it would pull
    SLIP         -mu, mu       with its contact; held: at its bound; slides: at rest
    LIMITED      -L, L         held: at its bound; slides: at rest
    TIMED        -inf, inf     at times known ahead
    SLIDER       -L, L         never: its row is that of how it moves
    ============ ============= ==================================================

    Attributes
    ----------
    code : float
        Its number in kernels.
    low, high : float
    strikes : bool
        An impact gives it an impulse: what is bounded gives none in no time, but
        friction goes with that of its contact.
    words : tuple of str
        What users read of it where it holds, and where it does not.
    one_sided, bounded : bool
        The multiplier pushes and does not pull; it is bounded in both directions.
    """

    CONTACT = (kept.CONTACT, 0.0, inf, True, ("closed", "open"))
    FREEWHEEL = (kept.FREEWHEEL, 0.0, inf, True, ("engaged", "free"))
    SLIP = (kept.SLIP, -1.0, 1.0, True, ("sticks", "slides"))
    LIMITED = (kept.LIMITED, -1.0, 1.0, False, ("sticks", "slides"))
    TIMED = (kept.TIMED, -inf, inf, True, ("closed", "open"))
    SLIDER = (kept.SLIDER, -1.0, 1.0, False, ("sticks", "slides"))

    def __init__(
        self, code: float, low: float, high: float, strikes: bool, words: Words
    ) -> None:
        self.code, self.low, self.high, self.strikes = code, low, high, strikes
        self.words = words
        self.one_sided, self.bounded = low == 0.0, high < inf


class Law(NamedTuple):
    """Constraint row with the law of its multiplier.

    Attributes
    ----------
    row : Row
        Where it holds as an equality.
    constraint : str
        The name in the file, or of a piece of it; a slip has that of its contact.
    multiplier : str
        The name of its variable, and column.
    restitution : float
        Newton's, of a contact, or Poisson's.
    bounce : int or None
        The node of a restitution that is no number.
    poisson : bool
    bound, static : int
        The friction coefficient while it slides and while it sticks, or the largest
        size of the multiplier: nodes. Zero where there is none.
    normal, pair : int
        The number of the law of its contact, and of the other slip, or limited
        equality, of two; or -1.
    when : int or None
        The condition of t and parameters under which it is in force: a node.
    slider : Slider or None
        Of a limited relation on a coordinate without mass.
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
    bounce: int | None = None
    poisson: bool = False
    slider: Slider | None = None

    @property
    def name(self) -> str:
        """The name in the file of its constraint, also of a piece, or of one of two."""
        two = self.pair >= 0 and self.kind is not Kind.SLIP
        return self.constraint[:-2] if two else whole(self.constraint)

    @property
    def solved(self) -> Row:
        """The row that the motion is solved with."""
        return self.slider.row if self.slider else self.row

    @property
    def given(self) -> tuple[int, ...]:
        """Nodes of what the file gives of it: bounds, and restitution."""
        bounce = () if self.bounce is None else (self.bounce,)
        return (self.bound, self.static, *bounce)

    def bouncing(self, restitution: float) -> Law:
        """Return the same with another restitution, where it is a contact's."""
        return self._replace(restitution=restitution) if self.kind.one_sided else self

    def moved(self, g: Graph, rates: Sequence[int]) -> int:
        """Factor of the multiplier in its power.

        What slides does work, whatever else it is.
        """
        if self.kind.bounded:
            entries = self.row.A.entries.items()
            return g.product_sum((slope, rates[j]) for j, slope in entries)
        return self.row.transport


def laws_of(
    g: Graph, constraints: Sequence[Constraint], flow: Flow, values: Mapping[str, float]
) -> Iterator[Law]:
    """Derive the laws of all constraints but plain equalities, slips after contacts.

    values : of the parameters, which decide what pieces a gap has.
    """
    count = 0
    for c in constraints:
        if c.always:
            continue
        zero = g.zero
        if c.law is None:
            row = constraint_row(g, c.name, c.relation.node, flow)
            kind = Kind.TIMED if c.limit is None else Kind.LIMITED
            limit = zero if c.limit is None else c.limit
            static = limit if c.static is None else c.static
            pair = count + c.pair if c.pair else -1
            yield Law(
                row, kind, c.name, f"lambda_{c.name}", bound=limit, static=static,
                when=c.when, pair=pair,
            )  # fmt: skip
            count += 1
            continue
        for name, node in pieces_of(g, c, flow, values).items():
            row = constraint_row(g, name, node, flow)
            kind = Kind.CONTACT if row.holonomic else Kind.FREEWHEEL
            bounce = c.law.bounce
            if bounce is not None:
                approach = {g.variable(APPROACH_SPEED): g.call("neg", row.rate)}
                bounce = g.substitute([bounce], approach)[0]
            yield Law(
                row, kind, name, f"lambda_{name}", c.law.restitution, zero, zero,
                when=c.when, bounce=bounce, poisson=c.law.poisson,
            )  # fmt: skip
            yield from _slips(g, name, c.law, flow, count)
            count += 1 + len(c.law.slips)


def pieces_of(
    g: Graph, c: Constraint, flow: Flow, values: Mapping[str, float]
) -> dict[str, int]:
    """Gaps whose least is that of a contact, by their names; most have just one."""
    node = c.relation.node
    if c.law is None or flow.velocities & g.depends([node]):
        return {c.name: node}
    moving = [str(g.payload(x)) for x in (*flow.positions, g.variable("t"))]
    found = pieces(g, node, values, moving)
    if len(found) == 1:
        return {c.name: found[0]}
    return {named(c.name, k): piece for k, piece in enumerate(found, 1)}


def _slips(
    g: Graph, name: str, law: OneSided, flow: Flow, normal: int
) -> Iterator[Law]:
    """Derive the slips of the contact that is the law of number `normal`."""
    count = len(law.slips)
    if not count or law.friction is None:
        return
    static = law.friction if law.static is None else law.static
    own, mark, piece = name.partition(MARK)
    for k, slip in enumerate(law.slips, 1):
        column = f"friction.{own}" if count == 1 else f"friction.{own}.{k}"
        column += mark + piece
        other = normal + 3 - k if count == 2 else -1
        yield Law(
            constraint_row(g, column, slip, flow), Kind.SLIP, name, column,
            bound=law.friction, static=static, normal=normal, pair=other,
        )  # fmt: skip
