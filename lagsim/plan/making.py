"""From a scene to its plan: the structure found, the formulation, the method."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from lagsim.errors import InputError, Problem
from lagsim.mechanics.structure import structure
from lagsim.mechanics.switches import model_switches
from lagsim.methods import method
from lagsim.notes import Choice
from lagsim.plan.formulation import formulate
from lagsim.plan.integration import STRAIGHT_ONLY, choose, locates, refuse, suits
from lagsim.plan.lengths import usual_lengths
from lagsim.plan.plan import ANY, Part, Plan
from lagsim.plan.solve import (
    eliminate,
    from_tape,
    independence_of,
    many_slopes,
    set_aside,
)
from lagsim.plan.subsystems import LARGEST, refusal, saving, subsystems

if TYPE_CHECKING:
    from lagsim.admissibility.report import Start
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.switches import Switches
    from lagsim.methods import Structure
    from lagsim.model.model import Settings


def make_plan(equations: Equations, start: Start, settings: Settings) -> Plan:
    """Choose for the model.

    Raises
    ------
    InputError
        Where the method or the formulation asked for is not known or cannot be had, or
        `output` asks for what the model or the method has not.
    """
    if equations.model.output.gauss and start.augmented:
        raise InputError([_no_unconstrained_acceleration()])
    parts = _parts(equations, start, settings)
    if parts:  # the rows are those of the whole
        settings = settings._replace(formulation="full")
    found = formulate(equations, start, settings, partial(suits, settings.method))
    equations, start = found.reduction.equations, found.start
    scene = structure(equations)
    choices = [
        Choice(f"mass matrix: {_mass_matrix(scene)}", _mass_reason(equations, scene))
    ]
    choices += found.choices
    choices += _told(parts)
    switches = _switches(equations, settings, choices)
    lengths = usual_lengths(equations, start, settings.output_step)
    if not locates(settings.method):
        elimination = None
        choices.append(Choice("solve: impulses in steps", "by projected relaxation"))
    elif equations.laws:
        elimination = None
        choices.append(Choice("solve: loops", "constraints come and go"))
    else:
        elimination = eliminate(equations, start, lengths, choices)
    if start.augmented:
        choices.append(
            Choice(
                "mass matrix solved with the constraints",
                ("it is singular without them"),
            )
        )
    if start.augmented and not locates(settings.method):
        raise InputError([_no_impulses(settings)])
    tape = from_tape(equations, elimination)
    independence = start.ranks.generic_smallest
    if elimination is not None and tape:
        # As the run will see it: of long chains the smallest singular value is small.
        independence = independence_of(equations, start, lengths, elimination)
    solved = None if tape else elimination
    switching = bool(switches.sides or equations.laws)
    name = choose(equations, scene, solved, settings, choices, switching=switching)
    if elimination is None:
        refuse(name, method(name).refusal(scene), settings)
    adaptive = bool(method(name).ADAPTIVE)
    tape = tape or many_slopes(name, equations, elimination, choices)
    return Plan(
        method=name,
        formulation=found.name,
        reduction=found.reduction,
        projected=found.projected,
        gain=found.gain,
        elimination=elimination,
        tape=tape,
        rank=start.ranks.generic_rank,
        independence=independence,
        set_aside=set_aside(equations, start),
        lengths=lengths,
        constant=_constant(scene, start),
        augmented=start.augmented,
        rtol=settings.tolerance if adaptive else None,
        atol=settings.atol if adaptive else None,
        step=None if adaptive else settings.fixed_step,
        switches=switches,
        parts=parts,
        choices=tuple(choices),
    )


def _parts(equations: Equations, start: Start, settings: Settings) -> tuple[Part, ...]:
    """Give the subsystems to be integrated apart, if there are any and it pays."""
    asked = settings.formulation
    if asked != "apart" and (asked != "auto" or len(equations.q) > LARGEST):
        return ()
    why = refusal(equations)
    if equations.laws:
        why = "a contact or a limit can stop the step of any of them"
    if not why:
        switches = model_switches(equations)
        if switches.modes or switches.sides:
            why = "a switch can stop the step of any of them"
    if why and asked == "apart":
        text = f"formulation `apart` cannot be used: {why}"
        place = settings.formulation_place
        raise InputError([Problem("formulation-refused", text, place)])
    if why:
        return ()
    found = subsystems(equations, start)
    if asked == "auto" and not saving(equations, found, settings.duration) > 0.0:
        return ()
    own = settings._replace(formulation="auto")
    return tuple(Part(x, make_plan(x.equations, x.start, own)) for x in found)


def _told(parts: tuple[Part, ...]) -> list[Choice]:
    if not parts:
        return []
    names = "; ".join(", ".join(x.subsystem.equations.q) for x in parts)
    text = f"nothing couples them, and each takes its own steps: {names}"
    return [Choice(f"subsystems: {len(parts)} integrated apart", text)]


def by_loops(plan: Plan) -> Plan:
    """Give the same plan with the equations solved by loops.

    Nobody can be asked on the way: for a method that needs y' as nodes another goes on.
    """
    choices = [c for c in plan.choices if not c.choice.startswith("solve:")]
    choices.append(Choice("solve: loops with QR", "the constraints became dependent"))
    name = plan.method
    why = method(name).refusal(structure(plan.reduction.equations))
    if STRAIGHT_ONLY.intersection(method(name).NEEDS):
        why = f"`{name}` needs straight-line code"
    if why:
        choices.append(Choice(f"method: {ANY}", why))
        name = ANY
    tape = from_tape(plan.reduction.equations, None)
    return replace(
        plan, method=name, elimination=None, tape=tape, choices=tuple(choices)
    )


def _constant(scene: Structure, start: Start) -> int:
    # With the constraints, M is constant where they are.
    found = scene.constant_parts
    return 0 if start.augmented and found < 2 else found


def _no_unconstrained_acceleration() -> Problem:
    return Problem(
        "singular-mass",
        (
            "`output.gauss` asks for the accelerations without constraints, M^-1 f, "
            "and the mass matrix of this model is singular without the constraints"
        ),
        hint="leave `gauss` out, or give every coordinate some mass",
    )


def _no_impulses(settings: Settings) -> Problem:
    return Problem(
        "method-refused",
        f"`{settings.method}` cannot handle this model: its mass matrix is singular, "
        "and impulses would be infinite there",
        settings.method_place,
        hint="`--method dop853` handles it",
    )


def _switches(
    equations: Equations, settings: Settings, choices: list[Choice]
) -> Switches:
    found = model_switches(equations, located=locates(settings.method))
    if found.sides:
        reason = (
            "forces jump or have a kink there: each is located, and the integration "
            "restarts"
        )
        choices.append(Choice(f"switches: {len(found.sides)} located", reason))
    return found


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
    if equations.chains is not None:
        return f"kept as {len(equations.chains.sums)} sums along chains"
    full = len(equations.mass_entries)
    return f"{full} of {n * n} entries are not zero"
