"""Constraint rows as graph nodes: equalities, and rows that hold at times.

Holonomic g(q, t) = 0: A = dg/dq, its rate is A q' + g_t, and A q'' = b with
b = -d^2 g/dt^2 at constant q'. Nonholonomic phi(q, q', t) = 0: A = dphi/dq'
(Chetaev's rule where phi is not linear), its rate is phi, b = -(phi_q q' + phi_t).

The gap g >= 0 of a contact has the row of g = 0, with a multiplier >= 0. Each slip s of
the contact has the row of s = 0, with a multiplier of at most mu times the multiplier
of the contact; while it slides, the multiplier opposes s. A limited equality has a
bound of its own. The multiplier of a row that is not in force is 0.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.columns import FRICTION, MULTIPLIER
from lagsim.language.derivatives import gradient, pulled, slopes, tangent
from lagsim.language.evaluate import addends
from lagsim.language.sparse import SparseVector
from lagsim.mechanics.pieces import MARK, piece_name, pieces, whole
from lagsim.model.model import APPROACH_SPEED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.model.model import Constraint, FirstOrderState, OneSided

    Words = tuple[str, str]


class Row(NamedTuple):
    """One scalar equality constraint A q'' = b; all integers are graph nodes.

    Attributes
    ----------
    name : str
        Name of the constraint in the file.
    holonomic : bool
        The constraint is g(q, t) = 0; otherwise phi(q, q', t) = 0.
    residual : int
        g, or phi.
    rate : int
        The residual on the level of velocities: A q' + g_t, or phi.
    A : SparseVector, shape (n,)
        The gradient dg/dq, or dphi/dq'.
    b : int
        The right-hand side of A q'' = b.
    transport : int
        A q' on the constraint: -g_t, or A q' for phi not homogeneous in q', else 0.
        Its product with lambda is the power of the constraint force.
    residual_scale, rate_scale : int
        The scale of the residual, and of the rate: the largest of the magnitudes of
        its terms and of |q_i dg/dq_i| (|q'_i d rate/dq'_i|), in its own unit.
    scleronomic : bool
        The residual does not depend on t.
    pfaffian : bool
        The rate is a polynomial of at most first degree in q'.
    drags : tuple of Drag
        Forces along other rows, in proportion to the multiplier of this row: friction
        of a contact that slides while its body rests. Empty in runs.
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
    drags: tuple[Drag, ...] = ()

    def force(self, g: Graph) -> dict[int, int]:
        """Return the generalized force per unit of the multiplier, by coordinate.

        Without drags it is A. The result has index of a coordinate -> node.
        """
        found = dict(self.A.entries)
        for drag in self.drags:
            for j, entry in drag.slip.A.entries.items():
                push = g.call("mul", drag.part, entry)
                found[j] = g.call("add", found.get(j, g.zero), push)
        return found


class Drag(NamedTuple):
    """Force along a row, in proportion to the multiplier of another row.

    Attributes
    ----------
    slip : Row
        The row of the slip, along which the force acts.
    part : int
        The force along the slip, per unit of the multiplier of the contact: a node.
    """

    slip: Row
    part: int


class Flow:
    """The variables of the motion, as graph nodes, and their rates at constant q'.

    Attributes
    ----------
    positions, rates : tuple of int, shape (n,)
        The variables q and q'.
    velocities : frozenset of str
        The names of the variables q'.
    forward : dict
        Variable -> its total time derivative at constant q': q -> q', t -> 1,
        `states` and `turned`.
    states : dict
        Variable of a first-order state -> its rate.
    turned : mapping
        Entry of the matrix of a frame -> its rate, linear in q', see `frames`.
    indices : list of dict
        Variable -> its index, for q and for q'.
    """

    def __init__(
        self,
        g: Graph,
        q: Sequence[str],
        velocities: Sequence[str],
        states: Iterable[FirstOrderState] = (),
        turned: Mapping[int, int] | None = None,
    ) -> None:
        self.positions = tuple(g.variable(name) for name in q)
        self.rates = tuple(g.variable(name) for name in velocities)
        self.velocities = frozenset(velocities)
        self.forward = dict(zip(self.positions, self.rates, strict=True))
        self.forward[g.variable("t")] = g.one
        self.states = {g.variable(x.name): x.rate for x in states}
        self.forward |= self.states
        self.turned = turned or {}
        self.forward |= self.turned
        self.indices = [
            {v: j for j, v in enumerate(group)}
            for group in (self.positions, self.rates)
        ]

    def gradient(self, g: Graph, node: int, *, by_rates: bool) -> SparseVector:
        """Return d node/dq (n,) or, `by_rates`, d node/dq' (n,)."""
        index = self.indices[by_rates]
        turned = {} if by_rates else self.turned
        cone = g.cone([node], turned)
        found = slopes(g, node, frozenset(v for v in cone if v in index or v in turned))
        entries = {index[v]: slope for v, slope in found.items() if v in index}
        weights = {turned[v]: x for v, x in found.items() if v in turned}
        if weights:  # dR/dq = dR'/dq'
            for v, slope in pulled(g, weights, frozenset(self.rates)).items():
                j = self.indices[True][v]
                entries[j] = g.call("add", entries.get(j, g.zero), slope)
        return SparseVector(g, len(index), entries)


def constraint_row(g: Graph, name: str, node: int, flow: Flow) -> Row:
    """Derive the row of an equality constraint `node` = 0.

    The constraint is holonomic where `node` does not depend on a velocity.

    name : the name of the constraint.
    flow : the variables of the motion and their rates.
    """
    names = g.depends([node])
    holonomic = not names & flow.velocities
    A = flow.gradient(g, node, by_rates=not holonomic)
    transport_rate = g.product_sum(
        (slope, flow.rates[j]) for j, slope in A.entries.items()
    )
    if holonomic:
        drift = gradient(g, node, [g.variable("t")])[0]
        # Forward mode preserves common differences: d^2 + ... has the rate 2*d*d' + ...
        rate = tangent(g, [node], flow.forward)[0]
        transport = g.call("neg", drift)
        residual_scale = scale_of(g, node, flow.positions, A.entries)
    else:
        rate = node
        degrees = g.degree(node, flow.velocities)
        homogeneous = degrees is not None and degrees.least == degrees.most
        transport = g.zero if homogeneous else transport_rate
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
    """Return the scale of `node`: the largest of |terms| and |variable * slope|.

    Parameters
    ----------
    variables : sequence of int, length n
        The nodes of the variables.
    entries : mapping
        Index of a variable -> d node / d variable.

    Returns
    -------
    int
        A node in the unit of `node`.
    """
    sizes = [g.call("abs", term) for term in addends(g, node)]
    sizes += [
        g.call("abs", g.call("mul", variables[j], slope))
        for j, slope in entries.items()
    ]
    largest = g.zero
    for size in sizes:
        largest = g.call("max", largest, size)
    return largest


class MasslessSlider(NamedTuple):
    """Limited relation on a coordinate without mass, see `reduction`.

    Attributes
    ----------
    coordinate : int
        The index of the coordinate.
    force : int
        The multiplier of the relation as a function of the state: a node.
    way : str
        The name of the variable that holds the mode of the relation: 0 where it
        sticks; else the sign of its multiplier or, with two relations, 1.
    row : Row
        The row that holds in the present mode.
    limit, left : int
        Nodes: the limit less |force|, and the event function that ends the mode.
    first : bool
        False for the second of two relations.
    """

    coordinate: int
    force: int
    way: str
    row: Row
    limit: int
    left: int
    first: bool


class Role(NamedTuple):
    """Type of a constraint row: bounds of the multiplier, gap, and words for messages.

    The multiplier lies between `low` and `high` times the bound of the law; for a slip,
    these are multiplied by the multiplier of the contact. A row is off, held, or slides
    with its multiplier at a finite bound; the column `ends` states when a mode ends.

    ============ ============= ==================================================
    role         bounds        ends
    ============ ============= ==================================================
    EQUALITY     -inf, inf     at times known ahead, by `when`; or never
    CONTACT      0, inf        off: its gap closes; held: it would pull
    FREEWHEEL    0, inf        off: its rate falls to 0; held: it would pull
    SLIP         -mu, mu       with its contact; held: at its bound; slides: at rest
    LIMITED      -L, L         held: at its bound; slides: at rest
    ============ ============= ==================================================

    Attributes
    ----------
    low, high : float
        The bounds of the multiplier, as multiples of the bound of the law.
    gapped : bool
        The row has a gap that closes, and bounces.
    words : tuple of str
        The words shown to users for a row that holds, and for one that does not.
    phrase : str
        The words for the relation in messages, with a place for its name.
    """

    low: float
    high: float
    gapped: bool
    words: Words
    phrase: str


EQUALITY = Role(-inf, inf, False, ("closed", "open"), "the `when` of `{}`")
CONTACT = Role(0.0, inf, True, ("closed", "open"), "the contact `{}`")
FREEWHEEL = Role(0.0, inf, False, ("engaged", "free"), "the freewheel `{}`")
SLIP = Role(-1.0, 1.0, False, ("sticks", "slides"), "the friction of the contact `{}`")
LIMITED = Role(-1.0, 1.0, False, ("sticks", "slides"), "the `limit` of `{}`")


class Law(NamedTuple):
    """Constraint row with the law of its multiplier.

    Other modules distinguish laws by the attributes of `role` and by the properties
    below; `RowTable` has these as arrays. A massless slider keeps its role in all of
    its modes: the row in force changes instead.

    Attributes
    ----------
    row : Row
        The row of the relation as an equality.
    role : Role
        The bounds and words of the row.
    constraint : str
        The name of the constraint in the file, or of a piece of its gap; for a slip,
        the name of the contact.
    multiplier : str
        The name of the multiplier's variable and of its column in the table.
    restitution : float
        The coefficient of restitution of a contact: Newton's, or Poisson's.
    bounce : int or None
        The node of a coefficient of restitution that is an expression.
    poisson : bool
        Restitution is of impulses (Poisson), not of rates (Newton).
    bound, static : int
        The friction coefficient while the slip slides and while it sticks, or the
        limit of the multiplier: nodes. Zero where the law has neither.
    normal, pair : int
        The index, among the laws, of the contact of a slip, and of the other law of a
        pair of slips or of limited equalities; -1 where there is none.
    when : int or None
        The condition on t and parameters under which the row is in force: a node.
    slider : MasslessSlider or None
        Present for a limited relation on a coordinate without mass.
    """

    row: Row
    role: Role
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
    slider: MasslessSlider | None = None

    @property
    def equal(self) -> bool:
        """Whether the multiplier has no bounds, as that of an equality."""
        return self.role.low == -inf

    @property
    def always(self) -> bool:
        """Whether the row is an equality that is always in force."""
        return self.equal and self.when is None

    @property
    def one_sided(self) -> bool:
        """Whether the multiplier is nonnegative, as that of a contact or freewheel."""
        return self.role.low == 0.0

    @property
    def gapped(self) -> bool:
        """Whether the row has a gap that closes, and bounces, as a contact."""
        return self.role.gapped

    @property
    def bounded(self) -> bool:
        """Whether the multiplier is bounded in both directions."""
        return self.role.high < inf

    @property
    def slips(self) -> bool:
        """Whether the row is the slip of a contact."""
        return self.bounded and self.normal >= 0

    @property
    def limited(self) -> bool:
        """Whether the multiplier has two bounds that depend on no other multiplier."""
        return self.bounded and self.normal < 0

    @property
    def by_forces(self) -> bool:
        """Whether forces decide if the row holds.

        False for equalities, and for sliders without mass, whose force is known.
        """
        return not self.equal and self.slider is None

    @property
    def name(self) -> str:
        """The name of the constraint in the file.

        Suffixes of the pieces of a gap and of the two relations of a pair are removed.
        """
        two = self.pair >= 0 and not self.slips
        return self.constraint[:-2] if two else whole(self.constraint)

    @property
    def solved(self) -> Row:
        """The row in the linear system of the motion: the slider's row, else `row`."""
        return self.slider.row if self.slider else self.row

    @property
    def given(self) -> tuple[int, ...]:
        """The nodes of bounds and restitution, as the model file states these."""
        bounce = () if self.bounce is None else (self.bounce,)
        return (self.bound, self.static, *bounce)

    def shifted(self, count: int) -> Law:
        """Return the law as a row after `count` others: `normal`, `pair` increased."""
        normal, pair = (k + count if k >= 0 else k for k in (self.normal, self.pair))
        return self._replace(normal=normal, pair=pair)

    def bouncing(self, restitution: float) -> Law:
        """Return the law with another restitution; unchanged if not one-sided."""
        return self._replace(restitution=restitution) if self.one_sided else self

    def conjugate_rate(self, g: Graph, rates: Sequence[int]) -> int:
        """Return the node whose product with the multiplier is the constraint's power.

        This is A q' of a bounded row, which does work while it slides, and the
        transport of any other row.

        Parameters
        ----------
        rates : sequence of int, length n
            The nodes of q'.
        """
        if self.bounded:
            entries = self.row.A.entries.items()
            return g.product_sum((slope, rates[j]) for j, slope in entries)
        return self.row.transport


def laws_of(
    g: Graph, constraints: Sequence[Constraint], flow: Flow, values: Mapping[str, float]
) -> Iterator[Law]:
    """Derive the laws of all constraints that hold at times only.

    The slips of a contact follow it.

    Parameters
    ----------
    constraints : sequence of Constraint
        All constraints of the model.
    flow : Flow
        The variables of the motion, and their rates.
    values : mapping
        The values of the parameters, which determine the pieces of a gap.
    """
    count = 0
    for c in constraints:
        if c.always:
            continue
        zero = g.zero
        if c.law is None:
            row = constraint_row(g, c.name, c.relation.node, flow)
            role = EQUALITY if c.limit is None else LIMITED
            limit = zero if c.limit is None else c.limit
            static = limit if c.static is None else c.static
            pair = count + c.pair if c.pair else -1
            yield Law(
                row, role, c.name, MULTIPLIER.of(c.name), bound=limit, static=static,
                when=c.when, pair=pair,
            )  # fmt: skip
            count += 1
            continue
        for name, node in pieces_of(g, c, flow, values).items():
            row = constraint_row(g, name, node, flow)
            role = CONTACT if row.holonomic else FREEWHEEL
            bounce = c.law.bounce
            if bounce is not None:
                approach = {g.variable(APPROACH_SPEED): g.call("neg", row.rate)}
                bounce = g.substitute([bounce], approach)[0]
            yield Law(
                row, role, name, MULTIPLIER.of(name), c.law.restitution, zero, zero,
                when=c.when, bounce=bounce, poisson=c.law.poisson,
            )  # fmt: skip
            yield from _slips(g, name, c.law, flow, count)
            count += 1 + len(c.law.slips)


def pieces_of(
    g: Graph, c: Constraint, flow: Flow, values: Mapping[str, float]
) -> dict[str, int]:
    """Return the pieces of a gap by their names; the gap is the least of its pieces.

    A gap without pieces, and a relation that depends on velocities, is its own only
    piece.

    Parameters
    ----------
    c : Constraint
        The constraint that has the gap.
    flow : Flow
        The variables of the motion, and their rates.
    values : mapping
        The values of the parameters, which determine the pieces.
    """
    node = c.relation.node
    if c.law is None or flow.velocities & g.depends([node]):
        return {c.name: node}
    moving = [str(g.payload(x)) for x in (*flow.positions, g.variable("t"))]
    found = pieces(g, node, values, moving)
    if len(found) == 1:
        return {c.name: found[0]}
    return {piece_name(c.name, k): piece for k, piece in enumerate(found, 1)}


def _slips(
    g: Graph, name: str, law: OneSided, flow: Flow, normal: int
) -> Iterator[Law]:
    """Derive the laws of the slips of a contact.

    name, law : the contact, and its law in the model.
    normal : its index among the laws.
    flow : the variables of the motion and their rates.
    """
    count = len(law.slips)
    if not count or law.friction is None:
        return
    static = law.friction if law.static is None else law.static
    own, mark, piece = name.partition(MARK)
    for k, slip in enumerate(law.slips, 1):
        column = FRICTION.of(own if count == 1 else f"{own}.{k}")
        column += mark + piece
        other = normal + 3 - k if count == 2 else -1
        yield Law(
            constraint_row(g, column, slip, flow), SLIP, name, column,
            bound=law.friction, static=static, normal=normal, pair=other,
        )  # fmt: skip
