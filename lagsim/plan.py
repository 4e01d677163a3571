"""What this scene needs, and why: the structure found, the formulation, the method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.large import is_large, row_lengths
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import scaled_rows
from lagsim.admissibility.start import metric_of
from lagsim.errors import InputError, Problem
from lagsim.expressions.evaluate import evaluate
from lagsim.kkt.series import MOST_OPERATIONS, series_length
from lagsim.kkt.straight import BUDGET, Elimination, TooLongError, dense_operations
from lagsim.methods import method, names
from lagsim.methods._state import USUAL_RADIUS
from lagsim.structure import structure
from lagsim.switches import model_switches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility import Start
    from lagsim.equations import Equations
    from lagsim.model import Simulation
    from lagsim.native.kernel_types import Floats
    from lagsim.structure import Structure
    from lagsim.switches import Switches

DEFAULT_RTOL = 1e-11
# Normal equations square the condition of the rows: below this the loops with their QR
# decomposition take over (numerics: S loses half of the digits of lambda).
WELL_CONDITIONED = 1e-2
# Loops of so many multiplications take a millisecond: that is no reason to do without
# their QR decomposition.
CHEAP = 10**6
# Code that fills in more entries of M and A than these compiles for long.
MOST_ENTRIES = 10_000
# A multiplication of a sparse elimination costs as much as these of a dense one.
WORTH = 4
# How many states tell how long the rows usually are, and how far around the start.
AROUND = 4
NEARBY = 0.1
# Needs of a method that are made from y' as nodes of the graph.
STRAIGHT_ONLY = frozenset(("series", "linear"))


@dataclass(frozen=True, slots=True)
class Choice:
    """One thing chosen, and why."""

    choice: str
    reason: str


@dataclass(frozen=True, slots=True)
class Plan:
    """The choices of a run.

    Attributes
    ----------
    method : str
    formulation : str
        `none`, `projection` or `velocity projection`.
    elimination : Elimination or None
        The equations solved on the graph; None where loops solve them.
    tape : bool
        The model's functions are run from tapes, not compiled.
    rank : int
        Of the constraint rows, in general.
    independence : float
        The smallest singular value of the scaled rows, in general; with tapes, what
        `Elimination.health` is at the start.
    set_aside : tuple of bool, length m
        The rows that others imply everywhere.
    lengths : tuple of float, length m
        Of the rows in the metric of M, as they usually are.
    augmented : bool
        M is singular and is solved together with the constraints.
    rtol, atol, step : float or None
    mass_matrix : str
        `constant`, or what it depends on.
    switches : Switches
    """

    method: str
    formulation: str
    elimination: Elimination | None
    tape: bool
    rank: int
    independence: float
    set_aside: tuple[bool, ...]
    lengths: tuple[float, ...]
    augmented: bool
    rtol: float | None
    atol: float | None
    step: float | None
    mass_matrix: str
    switches: Switches
    choices: tuple[Choice, ...]


def make_plan(equations: Equations, start: Start, *, loops: bool = False) -> Plan:
    """Choose for the model; `loops` insists on solving by loops.

    Raises
    ------
    InputError
        Where the method asked for is not known, or `output` asks for what the model or
        the method has not.
    """
    if equations.model.output.gauss and start.augmented:
        raise InputError([_no_unconstrained_acceleration()])
    choices: list[Choice] = []
    scene = structure(equations)
    mass = _mass_matrix(scene)
    choices.append(Choice(f"mass matrix: {mass}", _mass_reason(equations, scene)))
    formulation = _formulation(equations, choices)
    switches = _switches(equations, choices)
    lengths = _usual_lengths(equations, start)
    elimination = None if loops else _elimination(equations, start, lengths, choices)
    if loops:
        choices.append(
            Choice("solve: loops with QR", "the rows lost their independence")
        )
    if start.augmented:
        choices.append(
            Choice("mass matrix solved with the constraints", "it is singular alone")
        )
    simulation = equations.model.simulation
    name = _method(simulation, scene, choices)
    if STRAIGHT_ONLY.intersection(method(name).NEEDS):
        name = _straight_method(name, equations, elimination, loops, choices)
    independence = start.ranks.generic_smallest
    entries = len(equations.q) * (len(equations.q) + len(equations.rows))
    tape = elimination is None and entries > MOST_ENTRIES
    if elimination is not None and elimination.operations > BUDGET:
        tape = True
        # As the run will see it: of long chains the smallest singular value is small.
        independence = _independence(equations, start, lengths, elimination)
    quadratures = getattr(method(name), "QUADRATURES", False)
    if equations.model.output.action and not quadratures:
        raise InputError([_no_action(name)])
    adaptive = bool(method(name).ADAPTIVE)
    rtol = atol = step = None
    if simulation is not None:
        if adaptive:
            rtol = DEFAULT_RTOL if simulation.rtol is None else simulation.rtol
            atol = simulation.atol
        else:
            step = simulation.step or simulation.output_step
    return Plan(
        method=name,
        formulation=formulation,
        elimination=elimination,
        tape=tape,
        rank=start.ranks.generic_rank,
        independence=independence,
        set_aside=_set_aside(equations, start),
        lengths=lengths,
        augmented=start.augmented,
        rtol=rtol,
        atol=atol,
        step=step,
        mass_matrix=mass,
        switches=switches,
        choices=tuple(choices),
    )


def _no_unconstrained_acceleration() -> Problem:
    return Problem(
        "singular-mass",
        "`output.gauss` asks for the accelerations without constraints, M^-1 f, and "
        "the mass matrix of this model is singular: the constraints complete it",
        hint="leave `gauss` out, or give every coordinate some mass",
    )


def _no_action(name: str) -> Problem:
    return Problem(
        "no-action",
        f"`output.action` is not integrated by {name}",
        hint="dop853 does it under its error control, or leave `action` out",
    )


def _switches(equations: Equations, choices: list[Choice]) -> Switches:
    found = model_switches(equations)
    if found.sides:
        reason = "forces step or bend there: each ends an arc, where it is met"
        choices.append(Choice(f"switches: {len(found.sides)} located", reason))
    return found


def _set_aside(equations: Equations, start: Start) -> tuple[bool, ...]:
    implied = {d.name for d in start.ranks.dependences if d.everywhere is not False}
    return tuple(row.name in implied for row in equations.rows)


def _usual_lengths(equations: Equations, start: Start) -> tuple[float, ...]:
    """Give the largest length of each row at the start and around it."""
    if not equations.rows:
        return ()
    point = Point(equations)
    random = np.random.default_rng(4)  # the same states each time
    longest = np.zeros(len(equations.rows))
    for nearby in range(AROUND):
        q, v = start.q, start.v
        if nearby:
            q, v = (_kicked(x, random) for x in (start.q, start.v))
        if is_large(point):
            found = row_lengths(point, q, v)
            if np.all(np.isfinite(found)):
                longest = np.fmax(longest, found)
                continue
        M = point.mass(q, v)
        if np.all(np.isfinite(M)):
            metric = metric_of(M, range(len(q)))
            longest = np.fmax(longest, scaled_rows(point, q, v, metric)[1])
    return tuple(map(float, longest))


def _kicked(x: Floats, random: np.random.Generator) -> Floats:
    size = np.abs(x) + (np.max(np.abs(x), initial=0.0) or 1.0)
    return x + NEARBY * size * random.standard_normal(len(x))


def _mass_matrix(scene: Structure) -> str:
    varies = scene.mass_varies_with
    kind = "constant" if scene.constant_mass else f"depends on {varies}"
    return f"{kind}, diagonal" if scene.diagonal else kind


def _mass_reason(equations: Equations, scene: Structure) -> str:
    if scene.constant_mass:
        return "factored once, before the run"
    n = len(equations.q)
    full = len(equations.mass_entries)
    return f"{full} of {n * n} entries are not zero"


def _formulation(equations: Equations, choices: list[Choice]) -> str:
    rows = equations.rows
    if not rows:
        choices.append(Choice("formulation: none", "no constraints"))
        return "none"
    held = [row for row in rows if row.holonomic]
    if held:
        reason = f"{len(held)} of {len(rows)} constraints hold positions"
        choices.append(Choice("formulation: projection", reason))
        return "projection"
    choices.append(
        Choice("formulation: velocity projection", "the constraints hold velocities")
    )
    return "velocity projection"


def _elimination(
    equations: Equations,
    start: Start,
    lengths: Sequence[float],
    choices: list[Choice],
) -> Elimination | None:
    if start.augmented:
        return None
    if start.ranks.rank < len(equations.rows):
        reason = f"{len(equations.rows)} constraints have rank {start.ranks.rank}"
        choices.append(Choice("solve: loops with QR, least-norm lambda", reason))
        return None
    n, m = len(equations.q), len(equations.rows)
    dense = dense_operations(n, m)
    close = start.ranks.smallest < WELL_CONDITIONED
    reason = f"the rows are nearly dependent ({start.ranks.smallest:.1e})"
    if close and dense <= CHEAP:
        choices.append(Choice("solve: loops with QR", reason))
        return None
    try:
        elimination = Elimination(equations, max(BUDGET, dense // WORTH))
    except TooLongError:
        text = f"elimination saves too little of their {dense} multiplications"
        choices.append(Choice("solve: loops", text))
        return None
    if close:
        independence = _independence(equations, start, lengths, elimination)
        if independence < WELL_CONDITIONED:
            slow = f"{reason}, at the price of {dense} multiplications"
            choices.append(Choice("solve: loops with QR", slow))
            return None
    count = elimination.operations
    many = f"{count} multiplication{'s' * (count != 1)}"
    if count <= BUDGET:
        choices.append(Choice("solve: straight-line code", many))
    else:
        reason = f"{many} on what is not zero; loops would make {dense}"
        choices.append(Choice("solve: sparse elimination", reason))
    return elimination


def _independence(
    equations: Equations,
    start: Start,
    lengths: Sequence[float],
    elimination: Elimination,
) -> float:
    """Give how independent the rows are at the start by the pivots of `elimination`."""
    values = Point(equations).values(start.q, start.v)
    for row, length in zip(equations.rows, lengths, strict=True):
        values[f"length.{row.name}"] = length
    return float(evaluate(equations.graph, [elimination.health()], values)[0])


def _method(
    simulation: Simulation | None, scene: Structure, choices: list[Choice]
) -> str:
    asked = simulation.method if simulation else "auto"
    if asked == "auto":
        choices.append(
            Choice("method: dop853", "order 8, the most digits for smooth motion")
        )
        return "dop853"
    place = simulation.method_place if simulation else None
    if asked not in names():
        known = ", ".join(names())
        hint = f"one of auto, {known}; `lagsim methods` describes them"
        text = f"there is no method `{asked}`"
        raise InputError([Problem("unknown-method", text, place, hint)])
    refusal = method(asked).refusal(scene)
    if refusal:
        text = f"`{asked}` cannot handle this model: {refusal}"
        hint = "`lagsim methods` says what each handles; `auto` chooses one that can"
        raise InputError([Problem("method-refused", text, place, hint)])
    choices.append(Choice(f"method: {asked}", "asked for"))
    if asked == "generalized-alpha":
        given = simulation.spectral_radius if simulation else None
        radius = USUAL_RADIUS if given is None else given
        reason = "as usual" if given is None else "asked for"
        choices.append(Choice(f"spectral radius: {radius:g}", reason))
    return asked


def _straight_method(
    name: str,
    equations: Equations,
    elimination: Elimination | None,
    loops: bool,
    choices: list[Choice],
) -> str:
    """Give a method that needs y' as nodes where it has them; refuse it where not.

    On the way, where `loops` take over, no user can be asked: another method goes on.
    """
    if loops:
        choices.append(Choice("method: dop853", f"`{name}` needs straight-line code"))
        return "dop853"
    simulation = equations.model.simulation
    assert simulation is not None
    text = "its equations are solved by loops, not by straight-line code"
    hint = "`--method dop853` handles it"
    if elimination is not None:
        if "series" not in method(name).NEEDS:
            return name
        rtol = DEFAULT_RTOL if simulation.rtol is None else simulation.rtol
        length = series_length(equations, elimination, rtol)
        if length <= MOST_OPERATIONS:
            reason = f"about {length} operations per step"
            choices.append(Choice("series: straight-line code", reason))
            return name
        text = f"its series takes about {length} operations, over {MOST_OPERATIONS}"
        hint += "; a larger --rtol makes the series shorter"
    text = f"`{name}` cannot handle this model: {text}"
    raise InputError([Problem("method-refused", text, simulation.method_place, hint)])
