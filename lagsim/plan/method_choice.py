"""Choice of the method: structure of the equations, refusals, estimated speed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.codes.known import METHOD_REFUSED
from lagsim.errors import unusable
from lagsim.language.elements import payload
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import ELEMENTS
from lagsim.language.sparse import joined
from lagsim.mechanics.derivation import OF_ELEMENTS, may_gather
from lagsim.mechanics.equations import memoized_by_motion
from lagsim.mechanics.motion_series import MOST_OPERATIONS, motion_rates, series_cost
from lagsim.mechanics.reduction import equations_of_motion
from lagsim.methods import Structure, method, options_of
from lagsim.methods.taylor import order_for
from lagsim.notes import Choice
from lagsim.plan.formulation import step_parts

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.mechanics.linearisation import NewtonMatrix
    from lagsim.model.model import Model, Settings


def newton_of(name: str, equations: Equations) -> NewtonMatrix | None:
    """Return the sparse Newton matrix of an implicit method, or None.

    None if the method has no sparse solver, or if a dense matrix is cheaper.

    name : the name of the method.
    """
    if not hasattr(method(name), "SPARSE"):
        return None
    from lagsim.mechanics.linearisation import newton_matrix

    return newton_matrix(equations)


# The method that handles everything.
ANY = "dop853"


@memoized_by_motion
def structure(equations: Equations) -> Structure:
    """Return the structure of `equations`: mass matrix, constraints, linearity.

    The structure is decided from the expressions alone: a property that holds only at
    some values of the parameters is not found.
    """
    g, entries = equations.graph, equations.mass_nodes
    coupled = [together for _, together in equations.coupled]
    rows = equations.rows
    A = [node for row in rows for node in row.A.entries.values()]
    right = [*equations.f, *(row.b for row in rows)]
    right += [x.rate for x in equations.states]
    state = frozenset(equations.state)
    moving = state | {"t"}
    everything = [*entries, *A, *right, *(row.rate for row in rows)]
    levels = {row.holonomic for row in rows}
    kinds = {(): "none", (True,): "holonomic", (False,): "nonholonomic"}
    constants = g.dependent([*entries, *A], moving)
    degrees = g.degrees(right, state)
    power = equations.powers
    # Multipliers are affine where all else is.
    of_power = g.degrees(power, state.union(equations.multipliers))
    return Structure(
        mass_varies_with=_varies(equations, entries),
        diagonal=all(len(set(together)) == 1 for together in coupled),
        blocks=len(set(joined(len(equations.q), coupled))),
        constant_rows=not g.dependent(A, moving),
        constraints=kinds.get(tuple(levels), "mixed"),
        forces_free_of_velocities=not g.dependent(equations.f, equations.velocities),
        autonomous=not g.dependent([*everything, *power], ("t",)),
        linear=not constants
        and all(d is not None and d.most <= 1 for d in degrees)
        and all(d is not None and d.most <= 2 for d in of_power),
        unknowns=len(equations.q) + len(rows),
    )


def law_rows_vary(equations: Equations) -> bool:
    """Whether a row of a law depends on the state or on the time."""
    g, moving = equations.graph, frozenset(equations.state) | {"t"}
    rows = equations.every_row[len(equations.rows) :]
    return bool(g.dependent([x for r in rows for x in r.A.entries.values()], moving))


def _varies(equations: Equations, entries: list[int]) -> str:
    names = equations.graph.depends(entries)
    if names & frozenset(equations.velocities):
        return "velocities"
    if names & frozenset(equations.q):
        return "positions"
    return "time" if "t" in names else "nothing"


def coupled(e: Equations) -> list[int]:
    """Return, for each coordinate, the least index in its group of coordinates.

    Coordinates that the mass matrix or a constraint row couples, directly or through
    others, are a group.

    Returns
    -------
    list of int, length n
    """
    slopes = (row.entries for row in e.slopes)
    return joined(len(e.q), [*slopes, *(together for _, together in e.coupled)])


# M is full, and assembled in the place where it is read
STRAIGHT_ONLY = frozenset(("series",))

# With more operations of y' that depend on the state no series pays, and none is tried:
# the coefficients of an order exceed the processor's first-level cache.
MOST_MOVING = 1500

# Time of a step in ns (measured on six scenes of 4 to 40 components, within a third but
# for ten rods at 1e-8): fixed part and part per operation, of DOP853 and of a series.
DOP853_STEP, DOP853_OPERATION = 450.0, 0.22

SERIES_STEP, SERIES_OPERATION = 150.0, 0.18

# Steps of DOP853, with those rejected, for one step of the series at 1e-8 (the least of
# six scenes: 1.41 to 1.8), and the factor of this ratio for a tenth of the tolerance
# (measured at 1e-12: 3.1 to 3.6 steps).
MORE_STEPS, PER_DECADE = 1.41, 1.23

# Smallest gain in speed that is worth the time that a series takes to compile (ten rods
# at 1e-8: estimated 1.21, measured 1.7).
PAYS = 1.2

# At looser tolerances up to a tenth of the steps of a series is rejected.
SERIES_RTOL = 1e-6


def choose(
    equations: Equations,
    scene: Structure,
    solved: Elimination | None,
    settings: Settings,
    choices: list[Choice],
    *,
    switching: bool,
) -> str:
    """Select the method of the settings, or for `auto` the one estimated to be fastest.

    Parameters
    ----------
    equations : Equations
        The equations that are integrated.
    scene : Structure
        Their structure.
    solved : Elimination or None
        Symbolic solution for q'' and lambda; None where kernels solve by loops.
    settings : Settings
    choices : list of Choice
        The choice of the method is appended.
    switching : bool
        Whether the motion has switches that depend on the state.

    Returns
    -------
    str
        Name of the method.

    Raises
    ------
    InputError
        If the method of the settings cannot integrate the model.
    """
    if settings.method == "auto":
        plain = solved is not None and not switching and not equations.quadratures
        chosen = _automatic(equations, solved if plain else None, settings.tolerance)
        choices.append(chosen)
        return chosen.choice.removeprefix("method: ")
    name = _requested(equations, scene, settings, choices)
    if STRAIGHT_ONLY.intersection(method(name).NEEDS):
        _check_straight(name, equations, solved, settings, choices)
    return name


def _automatic(equations: Equations, solved: Elimination | None, rtol: float) -> Choice:
    if solved is not None:
        curved = any(t.interpolation != "linear" for t in equations.model.tables)
        gain = 0.0 if curved else _gain(equations, solved, rtol)
        if gain >= PAYS:
            reason = f"estimated {gain:.1f} times as fast as {ANY}"
            return Choice("method: taylor", reason)
    return Choice(f"method: {ANY}", "order 8, accurate for smooth motion")


def _gain(equations: Equations, solved: Elimination, rtol: float) -> float:
    """Return the estimated time of DOP853 divided by that of a Taylor series.

    0 where the series is too long, or the tolerance is too loose for a series.

    solved : the solution for q'' and lambda.
    rtol : the relative tolerance.
    """
    names = equations.moving
    moving = equations.graph.dependent(motion_rates(equations, solved), names)
    if not 0.0 < rtol <= SERIES_RTOL or len(moving) > MOST_MOVING:
        return 0.0
    solves, stages = step_parts(equations, solved)
    operations = solves + series_cost(equations, solved, rtol).operations
    series = SERIES_STEP + SERIES_OPERATION * operations
    dop853 = DOP853_STEP + DOP853_OPERATION * (solves + stages)
    decades = math.log10(1e-8 / rtol)
    steps = MORE_STEPS * math.pow(PER_DECADE, decades)
    return steps * dop853 / series


def _requested(
    equations: Equations, scene: Structure, settings: Settings, choices: list[Choice]
) -> str:
    name = settings.method
    refuse(name, method_refusal(name, equations, scene), settings)
    choices.append(Choice(f"method: {name}", "requested"))
    given = dict(settings.options)
    for key, option in options_of(name).items():
        value = f"{key.replace('_', ' ')}: {given.get(key, option.default):g}"
        choices.append(Choice(value, "requested" if key in given else "as usual"))
    return name


def refuse(name: str, why: str, settings: Settings, hint: str = "") -> None:
    """Raise InputError with the reason `why`, unless this is "".

    The message states that the method `name` cannot handle the model.

    hint : advice for the message.
    """
    if why:
        text = f"`{name}` cannot handle this model: {why}"
        raise unusable(METHOD_REFUSED, text, settings.method_place, hint)


def method_refusal(name: str, equations: Equations, scene: Structure) -> str:
    """Return the reason why the method `name` cannot integrate `equations`, or "".

    scene : the structure of the equations.
    """
    chosen = method(name)
    if equations.quadratures and not getattr(chosen, "QUADRATURES", False):
        if equations.model.output.action:
            return "it does not integrate the action, which `output` requires"
        return "it does not integrate the action"
    if equations.states and not getattr(chosen, "STATES", False):
        names = ", ".join(f"`{x.name}`" for x in equations.states[:4])
        return f"it does not integrate first-order states ({names})"
    if equations.graph.of((ELEMENTS,)) and not OF_ELEMENTS.issuperset(chosen.NEEDS):
        return "it needs derivatives of forces, which long sums do not have"
    if equations.laws and chosen.NEEDS and locates(name):
        return "constraints that hold at times need a method that evaluates y' only"
    follow = [x.name for x in equations.laws if x.bounce is not None or x.poisson]
    alone = [x.name for x in equations.laws if x.slider]
    if alone and not locates(name):
        return f"`{alone[0]}` acts on a coordinate without mass, which no impulse moves"
    if follow and not locates(name):
        return f"it has only Newton's constant restitution (`{follow[0]}`)"
    struck = any(x.gapped for x in equations.laws) and not locates(name)
    curved = [x.row for x in equations.relations if struck and not x.gapped]
    if row := next(filter(equations.is_curved, curved), None):
        return f"its impacts do not follow the curve of velocities of `{row.name}`"
    if struck and (met := _met_at_contact(equations)):
        text = (
            "its contacts close up to one step below 0, where `{}` is met once more as "
        )
        return text.format(met[0]) + f"`{met[1]}` opens: write it with <= or >="
    why = str(chosen.refusal(scene))
    return "" if why and newton_of(name, equations) is not None else why


# Number of random states, and the relative error, by which functions are proportional.
STATES, PROPORTIONAL = 3, 1e-9


def _met_at_contact(e: Equations) -> tuple[str, str] | None:
    """Return an equation of an event that is met where a contact is closed, or None.

    The results are the text of the equation and the name of the contact, whose gap is
    in proportion to the difference of both sides of the equation.
    """
    g, random = e.graph, np.random.default_rng(5)
    equations = [x.at for x in e.model.events if x.at is not None and x.at.equality]
    gaps = [(x.name, x.row.residual) for x in e.laws if x.gapped]
    nodes = [x.node for x in equations] + [node for _, node in gaps]
    if not (equations and gaps):
        return None
    fixed, found = e.model.parameter_values, []
    for _ in range(STATES):
        names = g.depends(nodes).difference(fixed)
        drawn = dict(
            zip(sorted(names), random.uniform(0.5, 1.5, len(names)), strict=True)
        )
        found.append(evaluate(g, nodes, {**fixed, **drawn}))
    values, ways = np.split(np.array(found).T, [len(equations)])
    for x, value in zip(equations, values, strict=True):
        for (name, _), gap in zip(gaps, ways, strict=True):
            off = value * gap[0] - gap * value[0]
            least = PROPORTIONAL * np.abs(value[0] * gap)
            if value[0] and np.all(np.abs(off) <= least):
                return x.text, name
    return None


def needs_regular_mass(name: str) -> bool:
    """Whether a method needs a mass matrix that is regular without constraints."""
    straight = name != "auto" and STRAIGHT_ONLY.intersection(method(name).NEEDS)
    return bool(straight) or not locates(name)


def locates(name: str) -> bool:
    """Whether a method locates events of switches and contacts; true for `auto`.

    Examples
    --------
    >>> locates("dop853"), locates("auto")
    (True, True)
    """
    return name == "auto" or bool(getattr(method(name), "EVENTS", True))


def suits(method: str, equations: Equations) -> bool:
    """Whether the method `method` can integrate `equations`; true for `auto`."""
    if method == "auto":
        return True
    return not method_refusal(method, equations, structure(equations))


def refuse_elements(model: Model, settings: Settings) -> None:
    """Refuse a method for elements whose terms, written out, would be too many.

    Methods that need all terms written out are refused here, before the terms are
    written out and derived.

    Raises
    ------
    InputError
        If a series would be too long, or dense matrices too large.
    """
    name, g = settings.method, model.graph
    if name == "auto" or not may_gather(model):
        return
    vectors = g.of((ELEMENTS,))
    if STRAIGHT_ONLY.intersection(method(name).NEEDS):
        # Forces have more operations than energies, and a series those of each order.
        operations = sum(payload(g, n).operations for n in vectors)
        operations *= order_for(settings.tolerance)
        if operations > MOST_OPERATIONS:
            refuse(name, _too_long(operations), settings, _SHORTER)
    elif any(payload(g, n).couples_most for n in vectors):
        scene = structure(equations_of_motion(model, gathers=True))
        refuse(name, str(method(name).refusal(scene)), settings)


_HANDLED = "`--method dop853` handles it"

_SHORTER = f"{_HANDLED}; a larger --rtol makes the series shorter"


def _too_long(operations: int) -> str:
    return (
        f"its series would need about {operations} operations per step, more than "
        f"{MOST_OPERATIONS}"
    )


def _check_straight(
    name: str,
    equations: Equations,
    elimination: Elimination | None,
    settings: Settings,
    choices: list[Choice],
) -> None:
    """Refuse a method that needs y' as graph nodes if loops of a kernel solve for q''.

    The method is also refused if its Taylor series would be too long; else the form of
    the series is appended to `choices`.

    name : the name of the method.
    elimination : the solution for q'' on the graph; None where loops of a kernel solve
        the equations numerically.
    """
    text = "its equations are solved by loops, not by straight-line code"
    hint = _HANDLED
    if elimination is not None:
        cost = series_cost(equations, elimination, settings.tolerance)
        operations = cost.operations
        if operations <= MOST_OPERATIONS:
            form = "a loop over the order" if cost.loop else "straight-line code"
            reason = f"about {operations} operations per step"
            choices.append(Choice(f"series: {form}", reason))
            return
        text, hint = _too_long(operations), _SHORTER
    refuse(name, text, settings, hint)
