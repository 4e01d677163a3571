"""What this scene needs, and why: the structure found, the formulation, the method."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.large import is_large, row_lengths
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import scaled_rows
from lagsim.admissibility.start import metric_of
from lagsim.errors import InputError, Problem
from lagsim.expressions.evaluate import evaluate
from lagsim.formulation import Choice, formulate
from lagsim.kkt.series import MOST_OPERATIONS, series_length
from lagsim.kkt.straight import (
    BUDGET,
    Elimination,
    TooLongError,
    affordable,
    dense_operations,
)
from lagsim.methods import method, names
from lagsim.methods._state import USUAL_RADIUS
from lagsim.structure import structure
from lagsim.subsystems import Subsystem, refusal, saving, subsystems
from lagsim.switches import model_switches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility import Start
    from lagsim.equations import Equations
    from lagsim.model import Simulation
    from lagsim.native.kernel_types import Floats
    from lagsim.reduction import Reduction
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
# How many states tell how long the rows usually are, and how far around the start.
AROUND = 4
NEARBY = 0.1
# Needs of a method that are made from y' as nodes of the graph.
STRAIGHT_ONLY = frozenset(("series", "linear"))


@dataclass(frozen=True, slots=True)
class Part:
    """A subsystem that is integrated apart, and its own plan."""

    subsystem: Subsystem
    plan: Plan


@dataclass(frozen=True, slots=True)
class Plan:
    """The choices of a run.

    Attributes
    ----------
    method : str
    formulation : str
        See `lagsim.formulation`.
    reduction : Reduction
        The equations that are integrated.
    projected : bool
        States are projected onto their constraints.
    gain : float
        Of the formulation `baumgarte`; else 0.
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
    constant : int
        What is factored once in an arc: 2 M and A, 1 only M, 0 neither.
    augmented : bool
        M is singular and is solved together with the constraints.
    rtol, atol, step : float or None
    parts : tuple of Part
        Subsystems that are integrated apart; empty where all is in one piece.
    mass_matrix : str
        `constant`, or what it depends on.
    switches : Switches
    """

    method: str
    formulation: str
    reduction: Reduction
    projected: bool
    gain: float
    elimination: Elimination | None
    tape: bool
    rank: int
    independence: float
    set_aside: tuple[bool, ...]
    lengths: tuple[float, ...]
    constant: int
    augmented: bool
    rtol: float | None
    atol: float | None
    step: float | None
    mass_matrix: str
    switches: Switches
    parts: tuple[Part, ...]
    choices: tuple[Choice, ...]


def make_plan(
    equations: Equations,
    start: Start,
    *,
    loops: bool = False,
    formulation: str | None = None,
) -> Plan:
    """Choose for the model; `loops` insists on solving by loops.

    Parameters
    ----------
    formulation
        Stands for the model's.

    Raises
    ------
    InputError
        Where the method or the formulation asked for is not known or cannot be had, or
        `output` asks for what the model or the method has not.
    """
    if equations.model.output.gauss and start.augmented:
        raise InputError([_no_unconstrained_acceleration()])
    simulation = equations.model.simulation
    if formulation is None:
        formulation = simulation.formulation if simulation else "auto"
    parts = _parts(equations, start, formulation)
    if parts:
        formulation = "full"  # the rows are those of the whole
    found = formulate(equations, start, formulation, partial(_suits, simulation))
    equations, start = found.reduction.equations, found.start
    scene = structure(equations)
    mass = _mass_matrix(scene)
    choices = [Choice(f"mass matrix: {mass}", _mass_reason(equations, scene))]
    choices += found.choices
    choices += _told(parts)
    switches = _switches(equations, choices)
    lengths = usual_lengths(equations, start)
    elimination = _elimination(equations, start, lengths, choices)
    if start.augmented:
        choices.append(
            Choice("mass matrix solved with the constraints", "it is singular alone")
        )
    name = _method(equations, scene, choices)
    entries = len(equations.q) * (len(equations.q) + len(equations.rows))
    tape = elimination is None and entries > MOST_ENTRIES
    tape = tape or (elimination is not None and elimination.operations > BUDGET)
    independence = start.ranks.generic_smallest
    if elimination is not None and tape:
        # As the run will see it: of long chains the smallest singular value is small.
        independence = _independence(equations, start, lengths, elimination)
    if STRAIGHT_ONLY.intersection(method(name).NEEDS):
        solved = None if tape else elimination
        name = _straight_method(name, equations, solved, choices)
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
    plan = Plan(
        method=name,
        formulation=found.name,
        reduction=found.reduction,
        projected=found.projected,
        gain=found.gain,
        elimination=elimination,
        tape=tape,
        rank=start.ranks.generic_rank,
        independence=independence,
        set_aside=_set_aside(equations, start),
        lengths=lengths,
        constant=_constant(scene, start),
        augmented=start.augmented,
        rtol=rtol,
        atol=atol,
        step=step,
        mass_matrix=mass,
        switches=switches,
        parts=parts,
        choices=tuple(choices),
    )
    return by_loops(plan) if loops else plan


def _parts(equations: Equations, start: Start, asked: str) -> tuple[Part, ...]:
    """Give the subsystems to be integrated apart, if there are any and it pays."""
    simulation = equations.model.simulation
    if simulation is None or asked not in ("auto", "apart"):
        return ()
    why = refusal(equations)
    if not why:
        switches = model_switches(equations)
        if switches.modes or switches.sides:
            why = "a switch is met by all of them"
    if why and asked == "apart":
        text = f"formulation `apart` cannot be had: {why}"
        place = simulation.formulation_place
        raise InputError([Problem("formulation-refused", text, place)])
    if why:
        return ()
    found = subsystems(equations, start)
    if asked == "auto" and not saving(equations, found) > 0.0:
        return ()
    return tuple(Part(x, make_plan(x.equations, x.start)) for x in found)


def _told(parts: tuple[Part, ...]) -> list[Choice]:
    if not parts:
        return []
    names = "; ".join(", ".join(x.subsystem.equations.q) for x in parts)
    text = f"they do not touch, and each takes its own steps: {names}"
    return [Choice(f"subsystems: {len(parts)} integrated apart", text)]


def by_loops(plan: Plan) -> Plan:
    """Give the same plan with the equations solved by loops.

    Nobody can be asked on the way: for a method that needs y' as nodes another goes on.
    """
    choices = [c for c in plan.choices if not c.choice.startswith("solve:")]
    choices.append(Choice("solve: loops with QR", "the rows lost their independence"))
    name = plan.method
    if STRAIGHT_ONLY.intersection(method(name).NEEDS):
        choices.append(Choice("method: dop853", f"`{name}` needs straight-line code"))
        name = "dop853"
    return replace(
        plan, method=name, elimination=None, tape=False, choices=tuple(choices)
    )


def _constant(scene: Structure, start: Start) -> int:
    # With the constraints, M is constant where they are.
    found = scene.constant_parts
    return 0 if start.augmented and found < 2 else found


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


def usual_lengths(equations: Equations, start: Start) -> tuple[float, ...]:
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
    if scene.diagonal:
        return f"{kind}, diagonal"
    return f"{kind}, {scene.blocks} blocks" if scene.blocks > 1 else kind


def _mass_reason(equations: Equations, scene: Structure) -> str:
    if scene.constant_mass:
        return "factored once, before the run"
    n = len(equations.q)
    full = len(equations.mass_entries)
    return f"{full} of {n * n} entries are not zero"


def _suits(simulation: Simulation | None, equations: Equations) -> bool:
    """Tell whether the method that is asked for can handle `equations`."""
    asked = simulation.method if simulation else "auto"
    if asked not in names():
        return True
    return not _refusal(asked, equations, structure(equations))


def _refusal(name: str, equations: Equations, scene: Structure) -> str:
    """Say why a method cannot handle equations, or give ""."""
    chosen = method(name)
    if equations.quadratures and not getattr(chosen, "QUADRATURES", False):
        return "it does not integrate ignorable coordinates by quadrature"
    return str(chosen.refusal(scene))


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
        elimination = Elimination(equations, affordable(n, m))
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


def _method(equations: Equations, scene: Structure, choices: list[Choice]) -> str:
    simulation = equations.model.simulation
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
    why = _refusal(asked, equations, scene)
    if why:
        text = f"`{asked}` cannot handle this model: {why}"
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
    choices: list[Choice],
) -> str:
    """Give a method that needs y' as nodes where it has them; refuse it where not."""
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
