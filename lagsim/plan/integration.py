"""Which method integrates a scene, and why."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.errors import InputError, Problem
from lagsim.mechanics.structure import structure
from lagsim.methods import method, names, options_of
from lagsim.notes import Choice
from lagsim.plan.cost import step_parts
from lagsim.plan.newton import newton_of
from lagsim.plan.plan import ANY
from lagsim.solve.series import MOST_OPERATIONS, motion_rates, series_cost

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.methods import Structure
    from lagsim.model.model import Settings

# Needs of a method that are made from y' as nodes of the graph.
STRAIGHT_ONLY = frozenset(("series", "linear"))
# The exponential's matrices are dense: measured, 40 states take half of DOP853's time,
# 120 nine times as much.
MOST_STATES = 50
# With more operations of y' that move no series pays, and nobody looks at it: what an
# order keeps leaves the processor's nearest memory.
MOST_MOVING = 1500
# What a step takes, in ns (measured on six scenes of 4 to 40 components, within a third
# but for ten rods at 1e-8): DOP853's for itself and each operation, a series' likewise.
DOP853_STEP, DOP853_OPERATION = 450.0, 0.22
SERIES_STEP, SERIES_OPERATION = 150.0, 0.18
# DOP853 makes so many steps for one of the series at 1e-8 (measured: 1.0 to 1.3), and
# so many times as many at a tenth of a tolerance (2.6 to 3.4 at 1e-12).
MORE_STEPS, PER_DECADE = 1.2, 1.23
# What gains less than this is not worth the time that a series takes to compile.
PAYS = 1.25
# At looser tolerances a tenth and more of its steps are made in vain.
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
    """Choose the method: what was asked for, or what suits the scene.

    Parameters
    ----------
    solved
        The equations as nodes of the graph; None where there are none to compile.
    switching
        The motion has switches that depend on the state.

    Raises
    ------
    InputError
        Where the method asked for is not known or cannot handle the model.
    """
    if settings.method == "auto":
        plain = solved is not None and not switching and not equations.quadratures
        chosen = _automatic(
            equations, scene, solved if plain else None, settings.tolerance
        )
        choices.append(chosen)
        return chosen.choice.removeprefix("method: ")
    name = _asked(equations, scene, settings, choices)
    if STRAIGHT_ONLY.intersection(method(name).NEEDS):
        _check_straight(name, equations, solved, settings, choices)
    return name


def _automatic(
    equations: Equations, scene: Structure, solved: Elimination | None, rtol: float
) -> Choice:
    if solved is not None:
        if scene.linear_time_invariant and 2 * len(equations.q) <= MOST_STATES:
            return Choice(
                "method: exponential", ("linear equations, and constant in time")
            )
        gain = _gain(equations, solved, rtol)
        if gain >= PAYS:
            reason = f"estimated {gain:.1f} times as fast as {ANY}"
            return Choice("method: taylor", reason)
    return Choice(f"method: {ANY}", "order 8, accurate for smooth motion")


def _gain(equations: Equations, solved: Elimination, rtol: float) -> float:
    """Estimate DOP853's time in units of that of a series; 0 where it is too long."""
    names = (*equations.q, *equations.velocities, "t")
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


def _asked(
    equations: Equations, scene: Structure, settings: Settings, choices: list[Choice]
) -> str:
    asked, place = settings.method, settings.method_place
    if asked not in names():
        known = ", ".join(names())
        hint = f"one of auto, {known}; `lagsim methods` describes them"
        text = f"there is no method `{asked}`"
        raise InputError([Problem("unknown-method", text, place, hint)])
    refuse(asked, refusal(asked, equations, scene), settings)
    choices.append(Choice(f"method: {asked}", "asked for"))
    given = dict(settings.options)
    for key, option in options_of(asked).items():
        value = f"{key.replace('_', ' ')}: {given.get(key, option.default):g}"
        choices.append(Choice(value, "asked for" if key in given else "as usual"))
    return asked


def refuse(name: str, why: str, settings: Settings) -> None:
    """Raise InputError where there is a reason why a method cannot handle a scene."""
    if why:
        text = f"`{name}` cannot handle this model: {why}"
        hint = "`lagsim methods` lists what each handles; `auto` chooses one that suits"
        place = settings.method_place
        raise InputError([Problem("method-refused", text, place, hint)])


def refusal(name: str, equations: Equations, scene: Structure) -> str:
    """Say why a method cannot handle equations, or give ""."""
    chosen = method(name)
    if equations.quadratures and not getattr(chosen, "QUADRATURES", False):
        if equations.model.output.action:
            return "it does not integrate the action, which `output` asks for"
        return "it does not integrate ignorable coordinates by quadrature"
    if equations.laws and chosen.NEEDS and locates(name):
        return "constraints that come and go need a method that evaluates y' only"
    why = str(chosen.refusal(scene))
    return "" if why and newton_of(name, equations) is not None else why


def locates(name: str) -> bool:
    """Tell whether a method stops at switches and contacts; `auto` chooses such."""
    return name not in names() or bool(getattr(method(name), "EVENTS", True))


def suits(asked: str, equations: Equations) -> bool:
    """Tell whether the method that is asked for can handle `equations`."""
    if asked not in names():
        return True
    return not refusal(asked, equations, structure(equations))


def _check_straight(
    name: str,
    equations: Equations,
    elimination: Elimination | None,
    settings: Settings,
    choices: list[Choice],
) -> None:
    """Refuse a method that needs y' as nodes where there are none."""
    text = "its equations are solved by loops, not by straight-line code"
    hint = "`--method dop853` handles it"
    if elimination is not None:
        if "series" not in method(name).NEEDS:
            return
        cost = series_cost(equations, elimination, settings.tolerance)
        operations = cost.operations
        if operations <= MOST_OPERATIONS:
            form = "a loop over the order" if cost.loop else "straight-line code"
            reason = f"about {operations} operations per step"
            choices.append(Choice(f"series: {form}", reason))
            return
        text = (
            f"its series would take about {operations} operations a step, more than "
            f"{MOST_OPERATIONS}"
        )
        hint += "; a larger --rtol makes the series shorter"
    text = f"`{name}` cannot handle this model: {text}"
    raise InputError([Problem("method-refused", text, settings.method_place, hint)])
