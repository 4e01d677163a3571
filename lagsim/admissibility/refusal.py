"""Refusal of starts that are not finite or lack inertia.

Many starts of one scene are separated into admissible starts and starts that need a
closer examination.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.codes.known import (
    NEGATIVE_INERTIA,
    NO_INERTIA,
    NOT_FINITE,
    OUT_OF_RANGE,
    OUT_OF_SCALE,
)
from lagsim.errors import InputError, Problem, unusable
from lagsim.language.derivatives import tangent
from lagsim.language.elements import payload
from lagsim.language.evaluate import evaluate_rows
from lagsim.language.functions import ELEMENTS
from lagsim.language.graph import DATA
from lagsim.language.tables import FIRST, arguments, written
from lagsim.mechanics.algebra import null_space, sizes_of
from lagsim.mechanics.pieces import whole
from lagsim.mechanics.surfaces import expression_text
from lagsim.model.model import Level
from lagsim.tolerances import (
    COMPUTED_ZERO,
    DEPENDENT_ROWS,
    HALF_OF_DIGITS,
    LEAST_PIVOT,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.errors import Place
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.constraints import Law
    from lagsim.mechanics.equations import Equations


# --- Energies, forces, masses and constraints must be finite

# A slip below this multiple of its rounding bound is 0.
STILL = 4.0
# Largest number of names in a message.
MOST_NAMES = 4
NO_VALUE = (
    "at the initial values its divisors must not be 0, and the arguments of its roots "
    "and logarithms must be positive; the point of a cone, as that of hypot(x, y) at "
    "0, has no gradient: start, or guess, beside it"
)
BEYOND = (
    "start, or guess, between the first and the last point of the table `{}`, or "
    "set `outside`"
)
# Largest distance of a start from a table's end, in units of rounding, and its hint.
ROUNDED = 64.0
PAST_END = (
    "{0} = {1!r} is past the end {2!r} of the table `{3}` by {4:.2g}, a rounding: "
    "start at {2!r}, or set `outside: extend`"
)
DIRECTION = (
    "a velocity of 0 has no direction: write friction in a plane not as "
    "x_dot/hypot(x_dot, y_dot) but as x_dot/hypot(c, hypot(x_dot, y_dot)), with c a "
    "speed far below the speeds of interest; along a line, write sign(x_dot)"
)


def refuse_infinite(point: Point, off: Collection[str], *, rows: bool) -> None:
    """Refuse a state at which energies, forces or constraints are not finite.

    Parameters
    ----------
    point : Point
    off : collection of str
        Constraints out of force, which are not checked.
    rows : bool
        Whether rows of constraints are checked; not at a guess.

    Raises
    ------
    InputError
        If an energy, a force or a checked row is not finite.
    """
    e = point.e
    named = [("kinetic", e.model.kinetic), ("potential", e.model.potential)]
    named += [("the energy function", e.energy)]
    named += [(f"the force on {q}", f) for q, f in zip(e.q, e.f, strict=True)]
    if rows:
        laws = [law for law in e.laws if law.constraint not in off]
        checked = {row.name: row for row in (*e.rows, *(law.row for law in laws))}
        named += [(f"constraint {name}", row.residual) for name, row in checked.items()]
        # Rates of open gaps are not checked.
        contacts = [x.row for x in point.e.laws if x.gapped]
        gaps = point.array([row.residual for row in contacts])
        for row, gap in zip(contacts, gaps, strict=True):
            if gap > 0.0:
                checked.pop(row.name, None)
        named += [(f"the rate of {name}", row.rate) for name, row in checked.items()]
        named += [(f"the bound of {law.multiplier}", law.bound) for law in laws]
    named += [
        (f"the inertia of {q}", node) for q, node in zip(e.q, e.inertias, strict=True)
    ]
    found = [(name, node) for name, node in named if node is not None]
    values = point.array([node for _, node in found]).tolist()
    faulty = [
        (name, node, value)
        for (name, node), value in zip(found, values, strict=True)
        if not math.isfinite(value)
    ]
    if not faulty:
        return
    sources = _sources(point)
    by: dict[_Source | None, list[tuple[str, int, float]]] = {}
    for one in faulty:
        by.setdefault(_source(point, one[1], sources), []).append(one)
    if len(by) > 1:
        by.pop(None, None)  # several of the reported expressions
    # Place of a value that is not finite because of several expressions, or of none
    # alone.
    places = [source.place for source in sources]
    places += [e.model.places.get(x) for x in ("kinetic", "potential", "lagrangian")]
    home = next((place for place in places if place is not None), None)
    raise InputError([_problem(point, s, own, home) for s, own in by.items()])


class _Source(NamedTuple):
    """Expression of the file whose value or slope is not finite at the start.

    Attributes
    ----------
    label : str
        Name of the expression in messages.
    node : int
    place : Place or None
    """

    label: str
    node: int
    place: Place | None


def _sources(point: Point) -> list[_Source]:
    """Return the expressions of the file that are not finite, in order of their use."""
    e, model = point.e, point.e.model
    energies = {
        "kinetic": model.kinetic,
        "potential": model.potential,
        "dissipation": model.dissipation,
    }
    if model.kinetic is None:
        energies["lagrangian"] = model.lagrangian
    stated = [
        _Source(f"`{name}`", node, model.places.get(name))
        for name, node in energies.items()
        if node is not None
    ]
    stated += [_Source(f"the force on `{f.on}`", f.node, f.place) for f in model.forces]
    stated += [
        _Source(f"the constraint `{c.name}`", c.relation.node, c.relation.place)
        for c in model.constraints
    ]
    for c in model.constraints:  # the names in the bound of each force
        bounds = {"limit": c.limit, "static limit": c.static}
        if c.law is not None:
            bounds |= {"friction": c.law.friction, "static friction": c.law.static}
        stated += [
            _Source(f"the {bound} of `{c.name}`", node, c.relation.place)
            for bound, node in bounds.items()
            if node is not None
        ]
    used = set(e.graph.cone([source.node for source in stated]))
    definitions = [
        _Source(f"the definition `{d.name}`", d.node, model.places.get(d.name))
        for d in sorted(model.definitions, key=lambda d: d.node)
        if d.level is not Level.OUTPUT and d.node in used
    ]
    stated = [*definitions, *stated]
    values, slopes = _values_and_slopes(point, [source.node for source in stated])
    finite = np.isfinite(values) & np.isfinite(slopes)
    return [s for s, sound in zip(stated, finite, strict=True) if not sound]


# The fractional parts of its multiples are well distributed (H. Weyl, 1916).
GOLDEN = (5**0.5 - 1) / 2


def _values_and_slopes(point: Point, nodes: Sequence[int]) -> Floats:
    """Return the values of nodes, and their derivatives in one direction, shape (2, k).

    The direction has no component 0.
    """
    g = point.g
    moving = [g.variable(name) for name in point.e.state]
    along = {x: g.constant((k * GOLDEN) % 1.0 + 1.0) for k, x in enumerate(moving)}
    return point.array([*nodes, *tangent(g, nodes, along)]).reshape(2, -1)


def _source(point: Point, node: int, sources: list[_Source]) -> _Source | None:
    """Return the expression of the file because of which `node` is not finite.

    None if several expressions could be the cause.
    """
    if not sources:
        return None
    inside = set(point.e.graph.cone([node]))
    for source in sources:
        if source.node in inside or len(sources) == 1:
            return source
    users = [s for s in sources if sources[0].node in point.e.graph.cone([s.node])]
    # the first source alone explains all of them
    return sources[0] if users == sources else None


def _problem(
    point: Point,
    source: _Source | None,
    faulty: list[tuple[str, int, float]],
    home: Place | None,
) -> Problem:
    """Return the fault of an expression that is not finite, with its consequences.

    source : the expression; None if it is unknown.
    faulty : quantities that are not finite: name, node and value.
    home : the place of the fault if `source` has none.
    """
    g, names = point.g, [name for name, _, _ in faulty]
    more = f" and {len(names) - MOST_NAMES} more" if names[MOST_NAMES:] else ""
    place = source.place if source else home
    inner, instead = _innermost(point, source.node if source else faulty[0][1])
    where = f" in {source.label}" if source else ""
    text = f"`{expression_text(g, inner)}`{where} {instead} at the start"
    args = [a for a in dict.fromkeys(arguments(g, inner)) if g.value(a) is None]
    values = zip(args, point.array(args), strict=True)
    texts = [f"{expression_text(g, a)} is {value:g}" for a, value in values]
    text += f", where {' and '.join(texts)}" if texts else ""
    if source is None or names != [source.label.strip("`")]:
        text += f"; it makes {', '.join(names[:MOST_NAMES])}{more} not finite"
    return Problem(NOT_FINITE, text, place, _hint(point, inner))


def _innermost(point: Point, node: int) -> tuple[int, str]:
    """Return the innermost expression without finite value or slope, and a text on it.

    The arguments of that expression have finite values and slopes.
    """
    if (member := _member(point, node)) is not None:
        return _innermost(point, member)
    cone = [n for n in point.g.cone([node]) if point.g.ops[n] not in (DATA, ELEMENTS)]
    values, slopes = np.isfinite(_values_and_slopes(point, cone))
    if not np.all(values):
        inner = cone[int(np.argmin(values))]
        return inner, f"is {point.array([inner])[0]:g}"
    return cone[int(np.argmin(slopes))], "has no finite slope"


def _member(point: Point, node: int) -> int | None:
    """Return the first term of the elements below `node` that is not finite.

    The term of each member is tested for a finite value and finite slopes. The result
    is its node, written out for this member; None if all terms are finite.
    """
    g = point.g
    vectors = [n for n in g.cone([node]) if g.ops[n] == ELEMENTS]
    for n in vectors:
        of, args = payload(g, n), g.args[n][1:]
        if of.size == 1:
            k = of.without_value(point.array(args).tolist())
            if k is not None:
                return of.written(g, args, k)
    return None


def _past_end(point: Point, node: int) -> str:
    """Return the hint on a start past an end of a table by rounding; "" elsewhere.

    node : the operation of the table.
    """
    g, of = point.g, written(point.g, node)
    for k, x in enumerate(of.args):
        axis = g.payload(g.args[node][k]).values
        ends = axis[FIRST], axis[-1]
        (value,) = point.array([x]).tolist()
        for end in ends:
            if 0.0 < abs(value - end) <= ROUNDED * UNIT_ROUNDOFF * abs(end):
                return PAST_END.format(
                    expression_text(g, x), value, end, of.name, value - end
                )
    return ""


def _hint(point: Point, node: int) -> str:
    g = point.g
    op, args = g.ops[node], g.args[node]
    rates = zip(point.e.velocities, point.v, strict=True)
    still = {name for name, rate in rates if not rate}
    if g.depends([node]) & still and not op.startswith("table."):
        return DIRECTION
    if op.startswith("table."):
        return _past_end(point, node) or BEYOND.format(written(g, node).name)
    values = point.array(args)
    if not g.depends([node]):
        return "it has no finite value at any state: correct the expression"
    divided = op == "div" and values[1] == 0.0
    if divided or (op in ("sqrt", "log", "log10") and values[0] < 0.0):
        of, why = (args[1], "not 0") if divided else (args[0], "positive")
        given = g.depends([of]) <= {x.name for x in point.e.model.parameters}
        how = "choose parameters with which" if given else "start, or guess, where"
        return f"{how} {expression_text(g, of)} is {why}"
    return NO_VALUE


def refuse_negative(point: Point, active: Collection[str]) -> None:
    """Refuse frictions and limits of active laws that are out of their range.

    Frictions and limits must not be negative, and static values must not be less than
    dynamic ones. Static and dynamic values are compared at slip 0 only, since friction
    may increase with the slip.

    Raises
    ------
    InputError
        If a friction or a limit is out of its range.
    """
    laws = point.e.laws
    bounded = [
        law
        for k, law in enumerate(laws)
        if law.bounded and law.constraint in active and not 0 <= law.pair < k
    ]
    places = {c.name: c.relation.place for c in point.e.model.constraints}
    found = []
    bounds, statics = (
        point.array(x)
        for x in ([x.bound for x in bounded], [x.static for x in bounded])
    )
    for law, value, static in zip(bounded, bounds, statics, strict=True):
        noun, why = "friction" if law.slips else "limit", ""
        if value < 0.0:
            why = f"is {value:.6g} at the start, which is negative"
        elif static < 0.0:
            why = f"at rest is {static:.6g} at the start, which is negative"
        elif static < value * (1.0 - COMPUTED_ZERO) and _is_at_rest(point, law):
            why = f"at rest is {static:.6g} at the start, less than the dynamic one, "
            why += f"{value:.6g}"
        if why:
            text = f"the {noun} of the constraint `{law.name}` {why}"
            place = places[whole(law.constraint)]
            found.append(Problem(OUT_OF_RANGE, text, place))
    if found:
        raise InputError(found)


def _is_at_rest(point: Point, law: Law) -> bool:
    """Whether the slip on which a friction acts is 0, in both components if it has two.

    law : the law of one component; its `pair` is that of the other.
    """
    pair = [point.e.laws[law.pair]] if law.pair >= 0 else []
    nodes = [x.row.rate for x in (law, *pair)]
    return bool((np.abs(point.array(nodes)) <= STILL * point.rounding(nodes)).all())


def out_of_scale(equations: Equations) -> InputError:
    """Return the error that the numbers of the start exceed the range of doubles.

    It is raised where LAPACK fails: the only cause of such failures is overflow in the
    arguments. The message contains the least and the largest number in energies, forces
    and constraints.
    """
    g, model = equations.graph, equations.model
    energies = (model.kinetic, model.potential, model.lagrangian, model.dissipation)
    nodes = [node for node in energies if node is not None]
    nodes += [force.node for force in model.forces]
    nodes += [c.relation.node for c in model.constraints]
    cone = g.cone(nodes)
    sizes = {f"{x:.3g}": abs(x) for n in cone if (x := g.value(n)) is not None}
    known = model.parameter_values | {x.name: x.value for x in model.initial}
    used = g.depends(nodes) & known.keys()
    sizes |= {f"`{x}` is {known[x]:.3g}": abs(known[x]) for x in sorted(used)}
    sizes = {text: size for text, size in sizes.items() if size}
    text = (
        "the start cannot be examined: its numbers differ by more orders of magnitude "
        "than double precision has"
    )
    if sizes:
        ends = dict.fromkeys(f(sizes, key=lambda x: sizes[x]) for f in (min, max))
        text += f" ({', '.join(ends)})"
    return unusable(OUT_OF_SCALE, text)


# --- Inertia of every direction, or a constraint that determines it


def needs_constraints(point: Point) -> bool:
    """Whether the mass matrix is singular, but positive on admissible velocities.

    Raises
    ------
    InputError
        If an admissible direction has no inertia, or any direction has a negative
        inertia.
    """
    if (point.is_large or point.e.chains) and point.is_safely_positive:
        return False
    size, scaled, rows = _scaled(point)
    inertia, directions = np.linalg.eigh(scaled)
    # If M varies with the positions, a motion passes such a place (angles near gimbal
    # lock), and its rounding shows in every step. The rounding of a constant M is equal
    # in all steps, so that no repeat shows it.
    varies = not point.g.depends(point.e.mass_nodes).isdisjoint(point.e.q)
    least = LEAST_PIVOT if varies else DEPENDENT_ROWS
    if inertia[0] > least:
        return False
    if inertia[0] < -DEPENDENT_ROWS:
        direction = directions[:, 0] / size
        raise InputError([_of_inertia(point, direction, negative=True)])
    kernel = _admissible(rows)
    if not kernel.shape[1]:
        return True
    inertia, directions = np.linalg.eigh(kernel.T @ scaled @ kernel)
    if inertia[0] > least:
        return True
    direction = (kernel @ directions[:, 0]) / size
    always = " that always holds" if point.e.laws else ""
    raise InputError([_of_inertia(point, direction, negative=False, which=always)])


def admitted_inertia(point: Point, i: int) -> float:
    """Return the effective inertia of coordinate i; inf if constraints fix it.

    It is 1 over the acceleration by a unit force along the admissible directions.
    """
    size, scaled, rows = _scaled(point)
    kernel = _admissible(rows)
    inertia, directions = np.linalg.eigh(kernel.T @ scaled @ kernel)
    along = (kernel[i] @ directions) ** 2
    moved = float(np.sum(along / np.maximum(inertia, UNIT_ROUNDOFF)))
    return float(size[i] ** 2 / moved) if moved > 0.0 else math.inf


# A gimbal counts as locked if the sine between its outer axes is below this.
LOCKED = 3e-3


def gimbal_lock(point: Point, names: Collection[str]) -> str:
    """Return the frame in gimbal lock whose angles depend on `names`; "" if none."""
    g = point.g
    for gimbal in point.e.model.gimbals:
        if not g.depends(gimbal.angles) & {*names}:
            continue
        known = g.depends([gimbal.node]) <= point.values.keys()
        if known and abs(point.array([gimbal.node])[0]) < LOCKED:
            return gimbal.frame
    return ""


def _scaled(point: Point) -> tuple[Floats, Floats, Floats]:
    """Return sizes of coordinates (n,), and M (n, n) and A (m, n) scaled by them.

    M is the mass matrix, and A has the constraint rows, with 0 for entries within
    rounding.
    """
    M, A = point.mass_matrix, point.jacobian(point.e.rows, rounded=True)
    size = sizes_of(np.sqrt(np.abs(np.diag(M))), A)
    return size, M / np.outer(size, size), A / size


def _admissible(rows: Floats) -> Floats:
    """Return directions (n, k), as columns, that span the null space of rows (m, n)."""
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return null_space(rows / np.where(lengths > 0, lengths, 1.0))


def _factor(c: float) -> str:
    if abs(abs(c) - 1) < HALF_OF_DIGITS:
        return "-" if c < 0 else ""
    return f"{c:.4g} "


def _of_inertia(
    point: Point, direction: Floats, *, negative: bool, which: str = ""
) -> Problem:
    names, places = point.e.q, point.e.model.places
    place = places.get("kinetic", places.get("lagrangian"))
    direction = direction / direction[np.argmax(np.abs(direction))]
    parts = [
        f"{_factor(c)}{name}"
        for name, c in zip(names, direction, strict=True)
        if abs(c) > HALF_OF_DIGITS
    ]
    along = " + ".join(parts).replace("+ -", "- ")
    noun = "coordinate" if len(parts) == 1 else "combination of coordinates"
    if negative:
        return Problem(
            NEGATIVE_INERTIA,
            f"the kinetic energy falls with the speed of the {noun} {along} at the "
            "start: the mass matrix is indefinite",
            place,
        )
    moving = [q for q, c in zip(names, direction, strict=True) if abs(c) > 0.0]
    hint = "give it a mass in `kinetic`, a constraint, or make it a definition; where "
    hint += "dampers balance other forces on it, it is one of `states`, with its rate"
    timed = [law for law in point.e.laws if law.when is not None and law.pair >= 0]
    if any(x.row.A[point.e.q.index(q)] != point.g.zero for x in timed for q in moving):
        hint = "`when` is not possible for a slider without mass that has two relations"
    drops = [law for law in point.e.laws if law.static != law.bound]
    if any(x.row.A[point.e.q.index(q)] != point.g.zero for x in drops for q in moving):
        hint = "a slider that has no mass has one limit: static and dynamic need a mass"
    text = f"the {noun} {along} has no inertia at the start, and no constraint"
    text += f"{which} determines its acceleration"
    if frame := gimbal_lock(point, moving):
        text += f": the angles of the frame `{frame}` are in gimbal lock"
        hint = "use other `axes`, put it `on` a turned frame, or give a `quaternion`"
    return Problem(NO_INERTIA, text, place, hint)


# --- Many starts of one model at once: a fast check without diagnosis
#
# Without constraints a start is admissible if energies and forces are finite there and
# every direction has inertia. Starts that fail this check are examined by `examine`,
# which reports the reason.

# Larger than any bound: starts with less inertia are examined one by one.
CLEAR = 2.0 * DEPENDENT_ROWS


def needs_no_solve(equations: Equations) -> bool:
    """Whether a start has no guesses and no constraints or start values to satisfy."""
    values = equations.model.initial
    return not (
        equations.rows
        or equations.laws
        or any(x.guess or x.node is not None for x in values)
    )


def clear_starts(
    equations: Equations, values: Mapping[str, float | Floats], count: int
) -> Flags:
    """Mark the starts that are admissible without closer examination, shape (count,).

    Parameters
    ----------
    equations : Equations
    values : mapping of str to float or ndarray, shape (count,)
        t, parameters, coordinates and velocities.
    count : int
    """
    e, model, n = equations, equations.model, len(equations.q)
    energies = (model.kinetic, model.potential, e.energy)
    named = [node for node in energies if node is not None]
    named += [*e.f, *e.inertias]
    M = [node for row in e.M for node in row]
    found = evaluate_rows(e.graph, [*named, *M], values, count)
    finite = np.all(np.isfinite(found), axis=0)
    mass = found[len(named) :].T.reshape(count, n, n)
    diagonal = np.diagonal(mass, axis1=1, axis2=2)
    clear: Flags = finite & np.all(diagonal > 0.0, axis=1)
    sizes = np.sqrt(diagonal[clear])
    scaled = mass[clear] / (sizes[:, :, None] * sizes[:, None, :])
    # LAPACK fails for matrices that have overflowed.
    sound = np.all(np.isfinite(scaled), axis=(1, 2))
    least = np.zeros(len(scaled))
    least[sound] = np.linalg.eigvalsh(scaled[sound])[:, 0]
    clear[clear] = least > CLEAR
    return clear
