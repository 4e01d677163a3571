"""Energies, forces, masses and constraints that must be finite at the start."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.errors import InputError, Problem
from lagsim.language.derivatives import tangent
from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.surfaces import expression_text
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.errors import Place
    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.model.model import Constraint, Model

# So many of what is not finite by one expression are named.
MOST_NAMES = 4
NO_VALUE = (
    "check the initial values against what it divides by and the arguments of its "
    "roots and logarithms; the point of a cone, as that of hypot(x, y) at 0, has no "
    "gradient: start, or guess, beside it"
)
DIRECTION = (
    "a velocity that is 0 has no direction: friction in a plane by "
    "x_dot/hypot(x_dot, y_dot) is written x_dot/hypot(c, hypot(x_dot, y_dot)), c a "
    "speed far below those that matter, under which it creeps; along a line sign(x_dot)"
)


def refuse_infinite(
    point: Point, q: Floats, v: Floats, off: Collection[str], *, rows: bool
) -> None:
    """Refuse a state at which energies, forces or constraints are not finite.

    The `rows` of constraints need not be where they are only guessed, nor those of
    constraints that are `off`.

    Raises
    ------
    InputError
    """
    e = point.e
    named: list[tuple[str, int | None]] = [
        ("kinetic", e.model.kinetic),
        ("potential", e.model.potential),
        ("the energy function", e.energy),
    ]
    named += [(f"the force on {q}", f) for q, f in zip(e.q, e.f, strict=True)]
    if rows:
        more = [law.row for law in e.laws if law.constraint not in off]
        held = {row.name: row for row in (*e.rows, *more)}
        named += [(f"constraint {name}", row.residual) for name, row in held.items()]
        apart = _open(point, q, v)
        named += [
            (f"the rate of {name}", row.rate)
            for name, row in held.items()
            if name not in apart
        ]
        named += [
            (f"the bound of {law.multiplier}", law.bound)
            for law in e.laws
            if law.constraint not in off
        ]
    named += [
        (f"the inertia of {q}", node) for q, node in zip(e.q, e.inertias, strict=True)
    ]
    found = [(name, node) for name, node in named if node is not None]
    values = point.array([node for _, node in found], q, v)
    resting = {name for name, rate in zip(e.velocities, v, strict=True) if not rate}
    faulty = [
        (name, node, value)
        for (name, node), value in zip(found, values, strict=True)
        if not np.isfinite(value)
    ]
    if not faulty:
        return
    sources = _sources(point, q, v)
    by: dict[_Source | None, list[int]] = {}
    for k, (_, node, _) in enumerate(faulty):
        by.setdefault(_source(point, node, sources), []).append(k)
    if len(by) > 1:
        by.pop(None, None)  # by several of those that are reported
    state = _State(point, q, v, resting, _home(e.model, sources))
    raise InputError(
        [state.problem(s, [faulty[k] for k in ks]) for s, ks in by.items()]
    )


# Its multiples are far from each other, less whole numbers (H. Weyl, 1916).
GOLDEN = (5**0.5 - 1) / 2


def _along(g: Graph, moving: Sequence[int]) -> dict[int, int]:
    """Give a direction that no difference vanishes along."""
    return {x: g.constant((k * GOLDEN) % 1.0 + 1.0) for k, x in enumerate(moving)}


class _Source(NamedTuple):
    """What the file says that has no value, or no slope, at the start."""

    what: str
    node: int
    place: Place | None


def _sources(point: Point, q: Floats, v: Floats) -> list[_Source]:
    """Give these, each definition and energy before what uses it."""
    e, model = point.e, point.e.model
    definitions = [
        _Source(f"the definition `{d.name}`", d.node, model.places.get(d.name))
        for d in sorted(model.definitions, key=lambda d: d.node)
        if d.level is not Level.OUTPUT
    ]
    energies = {
        "kinetic": model.kinetic,
        "potential": model.potential,
        "dissipation": model.dissipation,
    }
    if model.kinetic is None:
        energies["lagrangian"] = model.lagrangian
    said = [
        _Source(f"`{name}`", node, model.places.get(name))
        for name, node in energies.items()
        if node is not None
    ]
    said += [_Source(f"the force on `{f.on}`", f.node, f.place) for f in model.forces]
    said += [
        _Source(f"the constraint `{c.name}`", c.relation.node, c.relation.place)
        for c in model.constraints
    ]
    said += [source for c in model.constraints for source in _law(c)]
    used = set(e.graph.cone([source.node for source in said]))
    said = [*(d for d in definitions if d.node in used), *said]
    nodes = [source.node for source in said]
    moving = [e.graph.variable(name) for name in (*e.q, *e.velocities)]
    slopes = tangent(e.graph, nodes, _along(e.graph, moving))
    values, rates = point.array([*nodes, *slopes], q, v).reshape(2, -1)
    finite = np.isfinite(values) & np.isfinite(rates)
    return [s for s, sound in zip(said, finite, strict=True) if not sound]


def _law(c: Constraint) -> Iterator[_Source]:
    """Give what bounds the force of a constraint."""
    bounds = {"limit": c.limit}
    if c.law is not None:
        bounds |= {"friction": c.law.friction, "static friction": c.law.static}
    for what, node in bounds.items():
        if node is not None:
            text = f"the {what} of `{c.name}`"
            yield _Source(text, node, c.relation.place)


def _home(model: Model, sources: list[_Source]) -> Place | None:
    """Give the place of what is not finite by several things, or by none alone."""
    places = [source.place for source in sources]
    places += [model.places.get(x) for x in ("kinetic", "potential", "lagrangian")]
    return next((place for place in places if place is not None), None)


def _source(point: Point, node: int, sources: list[_Source]) -> _Source | None:
    """Give by what of the file `node` is not finite, where that is clear."""
    if not sources:
        return None
    inside = set(point.e.graph.cone([node]))
    for source in sources:
        if source.node in inside or len(sources) == 1:
            return source
    users = [s for s in sources if sources[0].node in point.e.graph.cone([s.node])]
    return sources[0] if users == sources else None  # all of them by the first


class _State(NamedTuple):
    """A state at which something is not finite.

    Attributes
    ----------
    resting : set of str
        The velocities that are 0.
    home : Place or None
        Of what is not finite by nothing that the file says alone.
    """

    point: Point
    q: Floats
    v: Floats
    resting: set[str]
    home: Place | None

    def problem(
        self, source: _Source | None, faulty: list[tuple[str, int, float]]
    ) -> Problem:
        """Give the fault of what the file says, and of all that is not finite by it."""
        g = self.point.e.graph
        names = [name for name, _, _ in faulty]
        more = f" and {len(names) - MOST_NAMES} more" if names[MOST_NAMES:] else ""
        depend = f"{', '.join(names[:MOST_NAMES])}{more}"
        node = source.node if source else faulty[0][1]
        found = self._innermost(node)
        if found is None:
            name, node, value = faulty[0]
            by = f", by {source.what}" if source else ""
            text = f"{name} is {value} at the start, not finite{by}"
            if names[1:]:
                text += f"; so are {', '.join(names[1:MOST_NAMES])}{more}"
            hint = DIRECTION if g.depends([node]) & self.resting else NO_VALUE
            return Problem(
                "not-finite", text, source.place if source else self.home, hint
            )
        inner, said = found
        where = f" in {source.what}" if source else ""
        arguments = self._arguments(inner)
        text = f"`{expression_text(g, inner)}`{where} {said} at the start"
        text += f", where {arguments}" if arguments else ""
        if source is None or names != [source.what.strip("`")]:
            text += f"; it makes {depend} not finite"
        place = source.place if source else self.home
        return Problem("not-finite", text, place, self._hint(inner))

    def _innermost(self, node: int) -> tuple[int, str] | None:
        """Give the first expression below a node without a value or a slope.

        And what it has instead: its arguments have both.
        """
        g = self.point.e.graph
        cone = g.cone([node])
        moving = [g.variable(n) for n in (*self.point.e.q, *self.point.e.velocities)]
        slopes = tangent(g, cone, _along(g, moving))
        values, rates = self.point.array([*cone, *slopes], self.q, self.v).reshape(
            2, -1
        )
        for told, numbers in (("is {:g}", values), ("has no finite slope", rates)):
            for n, number in zip(cone, numbers, strict=True):
                if not np.isfinite(number):
                    return n, told.format(number)
        return None

    def _arguments(self, node: int) -> str:
        """Give the values of the arguments of an expression that are no numbers."""
        g = self.point.e.graph
        args = [a for a in dict.fromkeys(g.args[node]) if g.value(a) is None]
        values = self.point.array(args, self.q, self.v)
        return " and ".join(
            f"{expression_text(g, a)} is {value:g}"
            for a, value in zip(args, values, strict=True)
        )

    def _hint(self, node: int) -> str:
        g = self.point.e.graph
        op, args = g.ops[node], g.args[node]
        if g.depends([node]) & self.resting:
            return DIRECTION
        values = self.point.array(args, self.q, self.v)
        if op in ("sqrt", "log", "log10") and values[0] < 0.0:
            return f"start, or guess, where {expression_text(g, args[0])} is positive"
        if op == "div" and values[1] == 0.0:
            return f"start, or guess, where {expression_text(g, args[1])} is not 0"
        return NO_VALUE


def _open(point: Point, q: Floats, v: Floats) -> set[str]:
    """Give the contacts whose gaps are open: of them no rate is asked."""
    contacts = [law for law in point.e.laws if law.kind is Kind.CONTACT]
    gaps = point.array([law.row.residual for law in contacts], q, v)
    return {law.row.name for law, gap in zip(contacts, gaps, strict=True) if gap > 0.0}


def out_of_scale(point: Point) -> InputError:
    """Give what tells that doubles do not hold what the start asks for.

    LAPACK fails for nothing else: what it is given has overflowed on the way.
    """
    model = point.e.model
    stated = {value.name: value.value for value in model.initial}
    known = stated | {p.name: p.value for p in model.parameters}
    sizes = {name: abs(x) for name, x in known.items() if x}
    text = (
        "the start cannot be examined: its numbers differ by more orders of magnitude "
        "than double precision has"
    )
    if sizes:
        ends = [f(sizes, key=lambda name: sizes[name]) for f in (min, max)]
        told = [f"`{name}` is {known[name]:.3g}" for name in dict.fromkeys(ends)]
        text += f" ({', '.join(told)})"
    hint = "choose units in which masses and lengths are nearer to 1"
    return InputError([Problem("out-of-scale", text, hint=hint)])
