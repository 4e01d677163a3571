"""Formulations: enforcement of the constraints, and reduction of the equations.

- `none`: no constraints; the equations are integrated unchanged.
- `projection`: q'' and lambda from the full equations; after each step the state is
  projected onto the constraints.
- `velocity projection`: projection of models all of whose constraints are on
  velocities.
- `elimination`: a constraint that determines one coordinate eliminates this
  coordinate; the state is projected onto the remaining constraints.
- `baumgarte`: in the rows A q'' = b of holonomic constraints g = 0, b is replaced by
  b - 2 a (A q' + g_t) - a^2 g, where g_t is the derivative by time at fixed q, and in
  rows of velocity constraints phi = 0 by b - a phi: residuals decay at the rate a.
  There is no projection. The output shows q'' and lambda without these terms.
- `drift`: the constraint residuals are neither projected nor stabilised.
- `full`: `none`, `projection` or `velocity projection`, by the constraints of the
  model, without reduction.

`auto` selects the formulation with the fewest operations per step; each other name
fixes the formulation.

Source: J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972), of `baumgarte`; of the
others see `reduction` and `methods._projection`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from lagsim.admissibility.examination import start_at
from lagsim.admissibility.point import Point
from lagsim.codes.known import FORMULATION_REFUSED, UNKNOWN_FORMULATION
from lagsim.errors import Problem, unusable
from lagsim.mechanics.equations import Instant, may_strike
from lagsim.mechanics.ldl import dense_operations, elimination_of
from lagsim.mechanics.reduction import Reduction
from lagsim.model.model import RETIRED_FORMULATIONS
from lagsim.notes import Choice

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.admissibility.examination import Start
    from lagsim.errors import Place
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.model.model import Settings


GAIN = "baumgarte.gain"
# Number of eliminated coordinates that a choice names.
SHOWN = 4
# With more coordinates than this `auto` does not try elimination: M fills, and little
# is saved (10 rods in Cartesian coordinates: 0.85 of the time).
LARGEST = 24
# A reduction is chosen where the cost of a step falls below this ratio to that of the
# full equations.
PAYS = 0.8


class Formulation(NamedTuple):
    """The equations that are integrated, and how their constraints are enforced.

    Attributes
    ----------
    name : str
    reduction : Reduction
        The equations that are integrated, with the map to the full equations.
    start : Start
        The start of the reduced equations.
    projected : bool
        Whether states are projected onto the remaining constraints.
    gain : float
        The rate a of `baumgarte`, per unit of time; 0 for other formulations.
    choices : tuple of Choice
        The decisions, each with its reason.
    """

    name: str
    reduction: Reduction
    start: Start
    projected: bool
    gain: float
    choices: tuple[Choice, ...]


def formulate(
    equations: Equations,
    start: Start,
    settings: Settings,
    suits: Callable[[Equations], bool],
) -> Formulation:
    """Select the formulation that the settings name, or the cheapest one for `auto`.

    Parameters
    ----------
    equations : Equations
        The full equations.
    start : Start
        The start of the full equations.
    settings : Settings
    suits : function
        Whether the method can integrate given equations; always true for `auto`.

    Raises
    ------
    InputError
        If the formulation named by the settings is impossible for these equations.
    """
    name, place = settings.formulation, settings.formulation_place
    if name == "auto":
        return _chosen(equations, start, suits)
    try:
        return _requested(name, equations, start, settings.decay)
    except _CannotError as error:
        text = f"formulation `{name}` cannot be used: {error}"
        raise unusable(FORMULATION_REFUSED, text, place) from None


def formulations() -> list[str]:
    """Return the names of the formulations, as in `--formulation`.

    Examples
    --------
    >>> formulations()[:4]
    ['auto', 'full', 'none', 'projection']
    """
    return [
        "auto", "full", "none", "projection", "velocity projection", "elimination",
        "baumgarte", "drift",
    ]  # fmt: skip


def formulation_problems(name: str, place: Place | None = None) -> list[Problem]:
    """Return a list with one fault if there is no formulation `name`, else [].

    place : the place of the name in the file, or None.

    Examples
    --------
    >>> formulation_problems("projection")
    []
    >>> [problem] = formulation_problems("projektion")
    >>> problem.text
    'there is no formulation `projektion`'
    """
    known = formulations()
    if name in known:
        return []
    if name in RETIRED_FORMULATIONS:
        text, hint = (
            f"the formulation `{name}` is retired",
            "`auto` chooses another one",
        )
        return [Problem(UNKNOWN_FORMULATION, text, place, hint)]
    hint = f"one of {', '.join(known)}; docs/model-file.md describes each"
    text = f"there is no formulation `{name}`"
    return [Problem(UNKNOWN_FORMULATION, text, place, hint)]


class _CannotError(Exception):
    """The formulation is impossible for these equations; the message is the reason."""


def _whole(
    equations: Equations,
    start: Start,
    name: str,
    reason: str,
    *,
    projected: bool = False,
    gain: float = 0.0,
) -> Formulation:
    """Return a formulation named `name` of the full equations, without reduction.

    reason : text of the choice for the user.
    projected : whether states are projected.
    gain : the rate of `baumgarte`, else 0.
    """
    choices = (Choice(f"formulation: {name}", reason),)
    return Formulation(name, Reduction(equations), start, projected, gain, choices)


def _full(equations: Equations, start: Start) -> Formulation:
    """Return the formulation of the full equations that fits their constraints."""
    rows, laws = equations.rows, {law.name for law in equations.laws}
    name, holonomic = _projection(rows), sum(row.holonomic for row in rows)
    if laws:
        name = "projection"
        one = len(laws) == 1
        noun = "constraint that holds" if one else "constraints that hold"
        reason = f"{len(laws)} {noun} at times"
    elif holonomic:
        reason = f"{holonomic} of {len(rows)} constraints are on positions"
    else:
        reason = "the constraints are of velocities" if rows else "no constraints"
    return _whole(equations, start, name, reason, projected=bool(rows or laws))


def _projection(rows: Sequence[Row]) -> str:
    """Return the name of the formulation that projects onto `rows`."""
    if not rows:
        return "none"
    holonomic = any(row.holonomic for row in rows)
    return "projection" if holonomic else "velocity projection"


def _requested(
    name: str, equations: Equations, start: Start, gain: float
) -> Formulation:
    """Return the formulation called `name`.

    gain : the rate of `baumgarte`.

    Raises
    ------
    _CannotError
        If the formulation is impossible for these equations.
    """
    e = equations
    if e.laws:
        if name not in ("full", "projection"):
            raise _CannotError("the model has constraints that hold at times")
        return _full(e, start)
    if name == "full":
        return _full(e, start)
    if name == "none":
        if e.rows:
            why = "the model has constraints; `drift` integrates without enforcement"
            raise _CannotError(why)
        return _full(e, start)
    if not e.rows:
        raise _CannotError("the model has no constraints")
    return _constrained(name, e, start, gain)


def _constrained(name: str, e: Equations, start: Start, gain: float) -> Formulation:
    """Return the formulation called `name`, of a model whose constraints always hold.

    gain : the rate of `baumgarte`.

    Raises
    ------
    _CannotError
        If the formulation is impossible for these equations.
    """
    if name == "elimination":
        reduction, why = _eliminated(e, start)
        if not reduction.eliminated:
            raise _CannotError(why)
        return _reduced(reduction, start, "requested")
    if name == "baumgarte":
        reason = f"requested; gain {gain:g} per unit of time"
        found = _whole(e, start, name, reason, gain=gain)
        return _with_quaternions(found._replace(reduction=Reduction(_stabilised(e))))
    if name == "drift":
        reason = "requested; the constraints are not enforced"
        return _with_quaternions(_whole(e, start, name, reason))
    found = _full(e, start)
    if name == "velocity projection" and name != found.name:
        raise _CannotError(found.choices[0].reason)
    return found


def _with_quaternions(found: Formulation) -> Formulation:
    """Return the formulation with projection onto |quaternion| = 1 alone.

    Lengths of quaternions are not constraints of the model file, so states are
    projected onto |quaternion| = 1 even by `drift` and `baumgarte`; in the projection,
    residual and rate of all other rows are replaced by 0. Where the rate of a row may
    jump, `found` is returned unchanged: a projection would hide the error of the
    impact.
    """
    e = found.reduction.equations
    quaternions = e.model.quaternions
    if not quaternions or any(may_strike(e, row) for row in e.rows):
        return found
    zero = e.graph.zero
    rows = tuple(
        row if row.name in quaternions else row._replace(residual=zero, rate=zero)
        for row in e.rows
    )
    reduction = Reduction(replace(e, rows=rows))
    return found._replace(reduction=reduction, projected=True)


def _stabilised(equations: Equations) -> Equations:
    """Return equations with Baumgarte's stabilising terms in the right-hand sides."""
    g = equations.graph
    a = g.variable(GAIN)
    rows = []
    for row in equations.rows:
        pull = g.call("mul", a, row.rate)
        if row.holonomic:
            square = g.call("mul", g.call("mul", a, a), row.residual)
            pull = g.call("add", g.call("mul", g.constant(2.0), pull), square)
        rows.append(row._replace(b=g.call("sub", row.b, pull)))
    return replace(equations, rows=tuple(rows))


def _chosen(
    equations: Equations, start: Start, suits: Callable[[Equations], bool]
) -> Formulation:
    """Return the cheapest formulation that the method can integrate.

    Elimination is chosen where a step costs less than PAYS of that of the full
    equations, or where the method cannot integrate the full equations.

    suits : see `formulate`.
    """
    whole = _full(equations, start)
    if equations.laws or not equations.rows or len(equations.q) > LARGEST:
        return whole
    reduction, _ = _eliminated(equations, start)
    if not reduction.eliminated or not suits(reduction.equations):
        return whole
    cost, full = step_cost(reduction.equations), step_cost(equations)
    if cost < PAYS * full or not suits(equations):
        reason = f"{cost:.0f} operations a step instead of {full:.0f}"
        return _reduced(reduction, start, reason)
    return whole


def _reduced(reduction: Reduction, start: Start, reason: str) -> Formulation:
    """Return the formulation of a reduction, with its start and its choices.

    start : the start of the full equations.
    reason : the reason of the choice.
    """
    rows = reduction.equations.rows
    given = [f"{q} from {row}" for q, row in reduction.eliminated]
    more = [f"{len(given) - SHOWN} more"] if len(given) > SHOWN else []
    why = f"{', '.join([*given[:SHOWN], *more])}: {reason}"
    if rows:
        many = "constraint is" if len(rows) == 1 else "constraints are"
        why += f"; {len(rows)} {many} left and projected"
    choices = (Choice("formulation: elimination", why),)
    q, v = reduction.independent(start.q), reduction.independent(start.v)
    independent = Instant(start.t, q, v, start.s)
    began = start_at(reduction.equations, independent)
    return Formulation("elimination", reduction, began, bool(rows), 0.0, choices)


def _eliminated(equations: Equations, start: Start) -> tuple[Reduction, str]:
    """Return (the reduction that eliminates all eliminable coordinates, "").

    If there are none: the unreduced equations, and the reason.
    """
    reduction = Reduction(equations)
    if start.ranks.rank < len(equations.rows):
        many, rank = len(equations.rows), start.ranks.rank
        return reduction, f"constraints are redundant ({many} of rank {rank})"
    point = Point(equations, start)
    sizes = dict(zip(equations.q, point.sizes, strict=True))
    reduced = reduction.eliminate(point.values, sizes)
    if reduced.eliminated:
        return reduced, ""
    names = ", ".join(f"`{row.name}`" for row in equations.rows)
    why = f"no coordinate has in {names} a factor that is constant and not 0"
    return reduction, why


# --- Operation counts of an evaluation of the rates, and of a step

# Evaluations in a step of order 8, and solves for its projection.
STAGES = 12
SOLVES = 4
# Operations of a step on each component of the state, per evaluation.
PER_COMPONENT = 16


def evaluation_cost(equations: Equations, nodes: Sequence[int], *, loops: bool) -> int:
    """Return the number of operations of one evaluation of graph nodes.

    Expressions of parameters alone are not counted, since they are computed once.

    loops : whether the operations of a dense solve are added.
    """
    moving = {*equations.moving}
    solve = dense_operations(len(equations.q), len(equations.rows)) if loops else 0
    return solve + equations.graph.cost(nodes, moving)


def step_cost(equations: Equations) -> float:
    """Return the number of operations of one step of order 8, with its projection."""
    solved = elimination_of(equations)
    if solved is not None:
        return sum(step_parts(equations, solved))
    nodes = [*equations.mass_nodes, *equations.f, *_rates(equations)]
    nodes += [a for row in equations.rows for a in row.A.entries.values()]
    return sum(_parts(equations, evaluation_cost(equations, nodes, loops=True)))


def step_parts(equations: Equations, solved: Elimination) -> tuple[float, float]:
    """Return the numbers of operations of a step's projection and of its stages.

    The step has order 8; the equations are solved on the graph (`solved`).
    """
    q, lam = solved.motion()
    nodes = [*q, *lam, *_rates(equations)]
    return _parts(equations, evaluation_cost(equations, nodes, loops=False))


def _parts(equations: Equations, evaluation: float) -> tuple[float, float]:
    size = len(equations.state) + len(equations.quadratures)
    solves = SOLVES if equations.rows else 0
    return solves * evaluation, STAGES * (evaluation + PER_COMPONENT * size)


def _rates(equations: Equations) -> list[int]:
    first = [x.rate for x in equations.states]
    return first + [x.rate for x in equations.quadratures]
