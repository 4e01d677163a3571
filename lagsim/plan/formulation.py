"""Formulations: enforcement of the constraints, and reduction of the equations.

- `none`: no constraints; the equations are integrated unchanged.
- `projection`: q'' and lambda from the full equations; after each step the state is
  projected onto the constraints.
- `velocity projection`: projection of models all of whose constraints are on
  velocities.
- `elimination`: a constraint that determines one coordinate eliminates this
  coordinate; the state is projected onto the remaining constraints.
- `baumgarte`: b is replaced by b - 2 a (A q' + g_t) - a^2 g for holonomic rows, and by
  b - a phi for velocity constraints phi = 0, so that residuals decay at the rate a.
  There is no projection. The output shows q'' and lambda without these terms.
- `drift`: the constraint residuals are neither projected nor stabilised.
- `apart`: decoupled subsystems are integrated separately, see `subsystems`.
- `ignorable`: coordinates with a conserved momentum are integrated by quadrature.
- `full`: `none`, `projection` or `velocity projection`, by the constraints of the
  model, without reduction.

`auto` selects the formulation with the fewest operations per step; each other name
fixes the formulation.

Source: J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972), of `baumgarte`; of the
others see `reduction` and `methods._projection`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.examination import start_at
from lagsim.admissibility.point import Point
from lagsim.errors import Problem, unusable
from lagsim.language.sparse import TooLongError
from lagsim.mechanics.equations import (
    Instant,
    coordinates_of,
    groups,
    may_strike,
    shared,
)
from lagsim.mechanics.ldl import dense_operations, eliminated
from lagsim.mechanics.linearisation import Linearisation
from lagsim.mechanics.reduction import Reduction, ignorable, of_those_left, vector
from lagsim.model.model import Output, Parameter, Scene
from lagsim.notes import Choice

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from lagsim.admissibility.examination import Start
    from lagsim.errors import Place
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.model.model import Model, Settings


GAIN = "baumgarte.gain"
# Number of eliminated coordinates that a choice names.
SHOWN = 4
# With more coordinates than this `auto` does not try elimination: M fills, and little
# is saved (10 rods in Cartesian coordinates: 0.85 of the time).
LARGEST = 24
# A reduction is chosen where the cost of a step falls below this ratio to that of the
# full equations. Without constraints time falls less than operations (the heavy top,
# two of three coordinates ignorable: 0.7 of the operations, 0.95 of the time).
PAYS = 0.8
PAYS_IGNORING = 0.6
# Multiplications to solve for ignorable velocities: about 50 coordinates, all coupled.
LONGEST = 20_000


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
        Their start.
    settings : Settings
    suits : function
        Whether the method can integrate given equations; always true for `auto`.

    Raises
    ------
    InputError
        If the formulation named by the settings is impossible for these equations.
    """
    asked, place = settings.formulation, settings.formulation_place
    if asked == "auto":
        return _chosen(equations, start, suits)
    try:
        return _asked(asked, equations, start, settings.decay)
    except _CannotError as error:
        text = f"formulation `{asked}` cannot be used: {error}"
        raise unusable("formulation-refused", text, place) from None


def formulations() -> list[str]:
    """Return the names of the formulations, as in `--formulation`.

    Examples
    --------
    >>> formulations()[:4]
    ['auto', 'full', 'apart', 'none']
    """
    return [
        "auto", "full", "apart", "none", "projection", "velocity projection",
        "elimination", "baumgarte", "drift", "ignorable",
    ]  # fmt: skip


def formulation_problems(asked: str, place: Place | None = None) -> list[Problem]:
    """Return a fault, in a list, if there is no formulation `asked`, else [].

    Examples
    --------
    >>> formulation_problems("projection")
    []
    >>> [problem] = formulation_problems("projektion")
    >>> problem.text
    'there is no formulation `projektion`'
    """
    known = formulations()
    if asked in known:
        return []
    hint = f"one of {', '.join(known)}; docs/model-file.md describes each"
    text = f"there is no formulation `{asked}`"
    return [Problem("unknown-formulation", text, place, hint)]


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

    gain : the rate of `baumgarte`.
    """
    choices = (Choice(f"formulation: {name}", reason),)
    return Formulation(name, Reduction(equations), start, projected, gain, choices)


def _full(equations: Equations, start: Start) -> Formulation:
    """Return the formulation of the full equations that fits their constraints."""
    rows, laws = equations.rows, {law.name for law in equations.laws}
    name, held = _projection(rows), sum(row.holonomic for row in rows)
    if laws:
        name = "projection"
        one = len(laws) == 1
        what = "constraint that holds" if one else "constraints that hold"
        reason = f"{len(laws)} {what} at times"
    elif held:
        reason = f"{held} of {len(rows)} constraints are on positions"
    else:
        reason = "the constraints are of velocities" if rows else "no constraints"
    return _whole(equations, start, name, reason, projected=bool(rows or laws))


def _projection(rows: Sequence[Row]) -> str:
    """Return the name of the formulation that projects onto `rows`."""
    if not rows:
        return "none"
    held = any(row.holonomic for row in rows)
    return "projection" if held else "velocity projection"


def _asked(name: str, equations: Equations, start: Start, gain: float) -> Formulation:
    """Return the formulation called `name`.

    Raises
    ------
    _CannotError
        If it is impossible for these equations.
    """
    e = equations
    if e.laws:
        if name not in ("full", "projection"):
            raise _CannotError("the model has constraints that hold at times")
        return _full(e, start)
    if name in ("full", "apart"):
        return _full(e, start)
    if name == "ignorable":
        found = ignorable(e)
        if not found:
            raise _CannotError("no coordinate is ignorable with a conserved momentum")
        return _reduced(Reduction(e).ignore(found, start), start, "requested")
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

    Raises
    ------
    _CannotError
        If it is impossible for these equations.
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

    Lengths of quaternions are not constraints of the model file, so they are projected
    even by `drift` and `baumgarte`; in the projection, residual and rate of all other
    rows are replaced by 0. Where the rate of a row may jump, `found` is returned
    unchanged: a projection would hide the error of the impact.
    """
    e = found.reduction.equations
    held = e.model.quaternions
    if not held or any(may_strike(e, row) for row in e.rows):
        return found
    zero = e.graph.zero
    rows = tuple(
        row if row.name in held else row._replace(residual=zero, rate=zero)
        for row in e.rows
    )
    reduction = Reduction(replace(e, rows=rows))
    return found._replace(reduction=reduction, projected=True)


def _stabilised(equations: Equations) -> Equations:
    """Return equations with Baumgarte's stabilising terms in b."""
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
    """Return the cheapest formulation that the method can integrate."""
    whole = _full(equations, start)
    candidates = [] if equations.laws else _candidates(equations, start)
    if not candidates:
        return whole
    full = step_cost(equations)
    best, least, fits = whole, full, suits(equations)
    for reduction, part in candidates:
        cost = step_cost(reduction.equations)
        pays = cost < least and cost < part * full
        if suits(reduction.equations) and (pays or not fits):
            reason = f"{cost:.0f} operations a step instead of {full:.0f}"
            best, least, fits = _reduced(reduction, start, reason), cost, True
    return best


def _candidates(equations: Equations, start: Start) -> list[tuple[Reduction, float]]:
    """Return the possible reductions, each with the largest cost ratio that selects it.

    The ratio of operations per step, of the reduced to the full equations.
    """
    found: list[tuple[Reduction, float]] = []
    if equations.chains is not None and len(equations.q) > LARGEST:
        return found  # M would be written out
    cyclic = ignorable(equations)
    ignoring = None
    if cyclic:
        with suppress(TooLongError):
            ignoring = Reduction(equations).ignore(cyclic, start, LONGEST)
            found.append((ignoring, PAYS_IGNORING))
    if equations.rows and len(equations.q) <= LARGEST:
        eliminated, _ = _eliminated(equations, start)
        if eliminated.eliminated:
            found.append((eliminated, PAYS))
            if ignoring is not None:
                both, _ = _eliminated(ignoring.equations, start, ignoring)
                found.append((both, PAYS_IGNORING))
    return found


def _reduced(reduction: Reduction, start: Start, reason: str) -> Formulation:
    """Return the formulation of a reduction, with its start and its choices."""
    rows = reduction.equations.rows
    name = _projection(rows)
    if reduction.eliminated:
        name = "elimination"
        given = [f"{q} from {row}" for q, row in reduction.eliminated]
        more = [f"{len(given) - SHOWN} more"] if len(given) > SHOWN else []
        why = f"{', '.join([*given[:SHOWN], *more])}: {reason}"
        if rows:
            many = "constraint is" if len(rows) == 1 else "constraints are"
            why += f"; {len(rows)} {many} left and projected"
    else:
        why = "for the constraints" if rows else "no constraints"
    choices = [Choice(f"formulation: {name}", why)]
    if reduction.ignored:
        what = f"ignorable: {', '.join(reduction.ignored)}"
        choices.append(Choice(what, f"momentum is conserved: a quadrature; {reason}"))
    q, v = reduction.kept(start.q), reduction.kept(start.v)
    kept = Instant(start.t, q, v, start.s)
    began = start_at(reduction.equations, kept)
    return Formulation(name, reduction, began, bool(rows), 0.0, tuple(choices))


def _eliminated(
    equations: Equations, start: Start, base: Reduction | None = None
) -> tuple[Reduction, str]:
    """Return the reduction that eliminates all eliminable coordinates, and "".

    If there are none: `base`, or the unreduced equations, and the reason.
    """
    reduction = base or Reduction(equations)
    if start.ranks.rank < len(equations.rows):
        many, rank = len(equations.rows), start.ranks.rank
        return reduction, f"constraints are redundant ({many} of rank {rank})"
    e = reduction.equations
    q, v = reduction.kept(start.q), reduction.kept(start.v)
    point = Point(e, Instant(start.t, q, v, start.s))
    reduced = reduction.eliminate(
        point.values, dict(zip(e.q, point.sizes, strict=True))
    )
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
    """Return the number of operations of one evaluation of `nodes`.

    `loops` adds the operations of a dense solve. Expressions of parameters alone are
    not counted, since they are computed once.
    """
    moving = {*equations.moving}
    solve = dense_operations(len(equations.q), len(equations.rows)) if loops else 0
    return solve + equations.graph.cost(nodes, moving)


def step_cost(equations: Equations) -> float:
    """Return the number of operations of one step of order 8, with its projection."""
    solved = eliminated(equations)
    if solved is not None:
        return sum(step_parts(equations, solved))
    nodes = [*equations.mass_nodes, *equations.f, *_rates(equations)]
    nodes += [a for row in equations.rows for a in row.A.entries.values()]
    return sum(_parts(equations, evaluation_cost(equations, nodes, loops=True)))


def step_parts(equations: Equations, solved: Elimination) -> tuple[float, float]:
    """Return the numbers of operations of a step's projection and of its stages.

    Of a step of order 8 with the equations solved on the graph (`solved`).
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


# --- Subsystems that do not touch: groups of coordinates with equations of their own
#
# Two coordinates touch where one stands in an entry of M, a force or a constraint of
# the other. Groups of coordinates that do not touch are integrated separately, each
# with its own steps.

# With more coordinates than this `auto` does not estimate the pace of subsystems.
LARGEST_APART = 40
# Compiling and linking a subsystem takes as long as this many operations.
COMPILING = 1e8
# Radians of its fastest motion that a step of order 8 takes at the default tolerance.
RADIANS = 1.0


class Subsystem(NamedTuple):
    """A group of coordinates that is decoupled from the others, with its equations.

    Attributes
    ----------
    coordinates : tuple of int
        Indices of its coordinates in the full equations.
    equations : Equations
        Its equations, on the graph of the full equations. Their output has only columns
        of this group.
    start : Start
        The start of its equations.
    """

    coordinates: tuple[int, ...]
    equations: Equations
    start: Start

    def at(self, whole: Instant) -> Instant:
        """Return the state of this subsystem from a state of the full equations."""
        return part_of(whole, self.coordinates)


def part_of(whole: Instant, coordinates: Iterable[int]) -> Instant:
    """Return positions and velocities of some coordinates at the time of a state."""
    chosen = list(coordinates)
    return Instant(whole.t, whole.q[chosen], whole.v[chosen], whole.s)


def why_not_apart(equations: Equations) -> str:
    """Return the reason why subsystems cannot be integrated separately, else ""."""
    if equations.works or equations.quadratures:
        return "work and action depend on all subsystems"
    if equations.model.until:
        return "`until` depends on all subsystems"
    if equations.model.events:
        return "events depend on all subsystems"
    if len(groups(equations)) < 2:
        return "all coordinates are coupled"
    return ""


def subsystems(equations: Equations, start: Instant) -> list[Subsystem]:
    """Return the decoupled subsystems of equations that can be integrated separately.

    For these `why_not_apart` returns "". `start` is that of the full equations.
    """
    found = groups(equations)
    energies, _ = shared(equations, found, equations.energy)
    forms, _ = shared(equations, found, equations.kinetic_form)
    group_of = {j: i for i, group in enumerate(found) for j in group}
    rows: list[list[Row]] = [[] for _ in found]
    for row in equations.rows:
        if row.A.entries:
            rows[group_of[min(row.A.entries)]].append(row)
    names = coordinates_of(equations)
    return [
        _part(replace(equations, energy=h, kinetic_form=form), start, own, names, group)
        for group, own, h, form in zip(found, rows, energies, forms, strict=True)
    ]


def _part(
    e: Equations,
    start: Instant,
    rows: Iterable[Row],
    names: Mapping[str, int],
    group: Sequence[int],
) -> Subsystem:
    g = e.graph
    # Variables of other groups in its energies only add constants: use start values.
    fixed: dict[str, float] = {}
    for name in sorted(g.depends([e.energy, e.kinetic_form]) & names.keys()):
        j = names[name]
        if j not in group:
            value = start.q[j] if name == e.q[j] else start.v[j]
            fixed[name] = float(value)
    new = {g.variable(name): g.variable(f"start.{name}") for name in fixed}
    energy, kinetic_form = g.substitute([e.energy, e.kinetic_form], new)
    added = [Parameter(f"start.{name}", value) for name, value in fixed.items()]
    part = replace(
        of_those_left(e, group, e.mass_entries, e.f, e.momenta),
        model=_model(e.model, group, added, g.zero),
        rows=tuple(x._replace(A=vector(g, group, x.A.entries)) for x in rows),
        energy=energy,
        kinetic_form=kinetic_form,
    )
    return Subsystem(tuple(group), part, start_at(part, part_of(start, group)))


def _model(
    model: Model, group: Sequence[int], added: Sequence[Parameter], zero: int
) -> Model:
    """Return the model of one group, without outputs that depend on other groups."""
    return replace(
        model,
        parameters=(*model.parameters, *added),
        coordinates=tuple(model.coordinates[j] for j in group),
        definitions=(),
        lagrangian=zero,
        kinetic=None,
        potential=None,
        scene=Scene({}),
        output=Output(()),
    )


def saving(equations: Equations, parts: Sequence[Subsystem], duration: float) -> float:
    """Estimate the operations that separate integration saves in a run of `duration`.

    Negative where separate integration of the subsystems `parts` is more expensive.
    """
    steps = duration / RADIANS
    paces = [pace(part) for part in parts]
    whole = steps * max(paces) * step_cost(equations) - COMPILING * len(parts)
    if not whole > 0.0:  # even if the parts cost no time
        return float(whole)
    apart = sum(
        p * step_cost(part.equations) for p, part in zip(paces, parts, strict=True)
    )
    return float(whole - steps * apart)


def pace(part: Subsystem) -> float:
    """Return the largest |eigenvalue| at the start, in radians per unit of time.

    Of the equations linearised at the start; 0 if there are no eigenvalues or they
    overflow.
    """
    start = part.start
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            linear = Linearisation(part.equations).at(start.t, start.q, start.v)
        values = linear.eigenvalues()
    except (ValueError, np.linalg.LinAlgError):
        return 0.0
    return float(np.max(np.abs(values), initial=0.0))
