"""Sliders without mass between springs and dampers: Jenkins and Iwan elements.

A coordinate z without inertia, on which a limited relation r = a z' + ... = 0 acts,
has the equation 0 = f_z + a lambda. It gives the multiplier as a function of the state,
lambda = -f_z/a, and other coordinates on which the relation acts have it as a force.
What is left of z is its own motion, by one row at a time:

    sticks    r = 0                          while |lambda| <= F
    slides    |lambda| = F, of two relations also r parallel to lambda
                                             while -lambda r >= 0

The row that slides is one of positions, or of velocities where dampers act on z, and
z' jumps where it begins to. Both act on z alone: it has the inertia 1, and its row a
multiplier of its own, so that neither changes the motion of what has mass.

Sources: G. Jenkin, Engineering 114 (1922) 603; W. D. Iwan, J. Appl. Mech. 33 (1966)
893, section 2; J. J. Moreau, Evolution problem associated with a moving convex set,
J. Diff. Eq. 26 (1977) 347.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.language.sparse import SparseVector
from lagsim.mechanics.constraints import Kind, Row, Slider, constraint_row
from lagsim.mechanics.equations import derive

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Law
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model


def equations_of_motion(model: Model) -> Equations:
    """Derive the equations of motion of a model, to be integrated.

    Multipliers of sliders without mass are in them as functions of the state.

    Each slider has a coordinate of its own: it is in no other relation, or in one of a
    slider whose own coordinate is found before, as in a chain. Others stay as they are,
    and have no inertia.
    """
    e = derive(model)
    if all(law.kind is not Kind.LIMITED for law in e.laws):
        return e
    multipliers, f = _multipliers(e)
    g, laws, M = e.graph, list(e.laws), list(e.M)
    for k, (j, _) in multipliers.items():
        law, pair = laws[k], laws[k].pair
        if pair >= 0 and pair not in multipliers:
            return e
        if law.when is not None:  # out of force it has the limit 0
            limit = g.call("mul", law.when, law.bound)
            law = law._replace(bound=limit, static=limit, when=None)
        made = _slider(e, law, k, j, multipliers)
        if made is None:
            return e
        laws[k] = law._replace(kind=Kind.SLIDER, slider=made)
    for j, _ in multipliers.values():
        M[j] = SparseVector(g, len(M), {j: g.one})
        f[j] = g.zero
    new = {g.variable(e.laws[k].multiplier): x for k, (_, x) in multipliers.items()}
    powers = g.substitute(e.powers, new)
    works = (x._replace(rate=rate) for x, rate in zip(e.works, powers, strict=True))
    return replace(e, M=tuple(M), f=tuple(f), laws=tuple(laws), works=tuple(works))


def at_limit(g: Graph, law: Law, force: float) -> int:
    """Node that vanishes where a slider's force is at its limit, on that side of 0."""
    slider = law.slider
    assert slider is not None
    if law.pair >= 0:
        return slider.limit
    way = g.constant(math.copysign(1.0, force))
    return g.call("sub", g.call("mul", way, slider.force), law.bound)


def _multipliers(e: Equations) -> tuple[dict[int, tuple[int, int]], list[int]]:
    """Laws of sliders -> their coordinates, and multipliers as nodes; all forces."""
    g, f = e.graph, list(e.f)
    found: dict[int, tuple[int, int]] = {}
    held = {j for row in e.rows for j in row.A.entries}
    left = {j for j, row in enumerate(e.M) if not row.entries} - held
    open_laws = dict(enumerate(e.laws))
    going = True
    while going:
        going = False
        for j in sorted(left):
            users = [k for k, law in open_laws.items() if j in law.row.A.entries]
            law = e.laws[users[0]] if len(users) == 1 else None
            if law is None or law.kind is not Kind.LIMITED:
                continue
            if law.when is not None and law.pair >= 0:
                continue  # a force of 0 in a plane has no direction to slide in
            A = law.row.A.entries
            force = g.call("neg", g.call("div", f[j], A[j]))
            for i, a in A.items():
                f[i] = g.call("add", f[i], g.call("mul", a, force))
            found[users[0]] = j, force
            del open_laws[users[0]]
            left.remove(j)
            going = True
    return found, f


def _slider(
    e: Equations, law: Law, k: int, j: int, multipliers: Mapping[int, tuple[int, int]]
) -> Slider | None:
    """Slider of law k on coordinate j; None where it hangs on no spring or damper."""
    g = e.graph
    slip, force, first = law.row.rate, multipliers[k][1], not 0 <= law.pair < k
    way = g.variable(f"slides.{e.laws[k if first else law.pair].constraint}")
    if law.pair < 0:
        size = g.call("abs", force)
        missed = g.call("sub", g.call("mul", way, force), law.bound)
        lost = g.call("mul", way, slip)
    else:
        beside, also = multipliers[law.pair][1], e.laws[law.pair].row.rate
        size = g.call("hypot", force, beside)
        missed = g.call("sub", size, law.bound)
        lost = g.call("div", g.product_sum([(force, slip), (beside, also)]), size)
        if not first:
            across = g.call("mul", beside, slip)
            missed = g.call("sub", g.call("mul", force, also), across)
    row = constraint_row(g, law.row.name, missed, e.flow)
    if row.holonomic:  # states may follow velocities: their rates stand in its rate
        row = row._replace(A=e.flow.gradient(g, row.rate, by_rates=True))
    if row.A.entries.keys().isdisjoint(i for i, _ in multipliers.values()):
        return None
    slides = g.call("gt", g.call("mul", way, way), g.zero)
    limit = g.call("sub", law.bound, size)
    ends = g.call("neg", lost)
    if law.bound in g.dependent([law.bound], e.moving):
        ends = g.call("min", ends, law.bound)  # it may not become negative
    left = g.call("if", slides, ends, limit) if first else g.one
    name, solved = str(g.payload(way)), _one_of(g, slides, row, law.row)
    return Slider(j, force, name, solved, limit, left, first)


def _one_of(g: Graph, slides: int, row: Row, sticks: Row) -> Row:
    """Row that is one of two by a condition; that which sticks is of velocities."""

    def either(a: int, b: int) -> int:
        return g.call("if", slides, a, b)

    columns = row.A.entries.keys() | sticks.A.entries.keys()
    return sticks._replace(
        holonomic=row.holonomic,
        pfaffian=row.pfaffian and sticks.pfaffian,
        residual=either(row.residual if row.holonomic else g.zero, g.zero),
        rate=either(row.rate, sticks.rate),
        A=SparseVector(
            g, len(row.A), {j: either(row.A[j], sticks.A[j]) for j in columns}
        ),
        b=either(row.b, sticks.b),
        residual_scale=either(row.residual_scale, g.zero),
        rate_scale=either(row.rate_scale, sticks.rate_scale),
    )
