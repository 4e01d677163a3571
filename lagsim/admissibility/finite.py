"""What has to be finite at the start."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.errors import InputError, Problem
from lagsim.language.derivatives import tangent
from lagsim.mechanics.laws import Kind
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.admissibility.point import Point
    from lagsim.errors import Place
    from lagsim.language.arrays import Floats

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
    problems = []
    for name, node, value in faulty:
        through, place = _source(point, node, sources)
        text = f"{name} is {value} at the start, not finite{through}"
        hint = DIRECTION if e.graph.depends([node]) & resting else NO_VALUE
        problems.append(Problem("not-finite", text, place, hint))
    raise InputError(problems)


# Its multiples are far from each other, less whole numbers (H. Weyl, 1916).
GOLDEN = (5**0.5 - 1) / 2


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
    used = set(e.graph.cone([source.node for source in said]))
    said = [*(d for d in definitions if d.node in used), *said]
    nodes = [source.node for source in said]
    # The slopes in a direction that no difference vanishes along, of all at once.
    moving = [e.graph.variable(name) for name in (*e.q, *e.velocities)]
    along = {
        x: e.graph.constant((k * GOLDEN) % 1.0 + 1.0) for k, x in enumerate(moving)
    }
    slopes = tangent(e.graph, nodes, along)
    values, rates = point.array([*nodes, *slopes], q, v).reshape(2, -1)
    finite = np.isfinite(values) & np.isfinite(rates)
    return [s for s, sound in zip(said, finite, strict=True) if not sound]


def _source(
    point: Point, node: int, sources: list[_Source]
) -> tuple[str, Place | None]:
    """Give by what of the file `node` is not finite, where that is clear."""
    if not sources:
        return "", None
    inside = set(point.e.graph.cone([node]))
    for source in sources:
        if source.node in inside or len(sources) == 1:
            return f", by {source.what}", source.place
    users = [s for s in sources if sources[0].node in point.e.graph.cone([s.node])]
    if users == sources:  # all of them by the first
        return f", by {sources[0].what}", sources[0].place
    return "", None


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
    text = "the start cannot be examined: its numbers lie too far apart for doubles"
    if sizes:
        ends = [f(sizes, key=lambda name: sizes[name]) for f in (min, max)]
        told = [f"`{name}` is {known[name]:.3g}" for name in dict.fromkeys(ends)]
        text += f" ({', '.join(told)})"
    hint = "choose units in which masses and lengths are nearer to 1"
    return InputError([Problem("out-of-scale", text, hint=hint)])
