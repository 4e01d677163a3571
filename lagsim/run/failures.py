"""Failures of a method: another method goes on, or the run ends with its reason.

A series has no finite coefficients where an expression has a value and no derivative
(drag that grows with the speed, from rest; a root of the time); an implicit step may
find no solution. What handles everything then takes over, and where it fails as well,
the motion itself is at an end. So it is for the method of `auto`, and for a series that
was asked for: that it does not exist says nothing about the motion. An implicit step
over a loss of rank finds a false solution: that too is left to what passes it even
where the implicit method was asked for.

Constraints that are not satisfied, however long projection goes on, end a run too.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.tables import ended
from lagsim.mechanics.surfaces import expression_text
from lagsim.methods.moreau import MOST_SWEEPS
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Choice
from lagsim.plan.plan import ANY
from lagsim.run.arc import SERIES
from lagsim.run.trajectory import Decision, Ending, Outcome, Source
from lagsim.tolerances import BROKEN_CONSTRAINT, TINY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc


# What a kernel gives that cannot go on.
FAILED = {
    at.NOT_FINITE: Outcome.NOT_FINITE,
    at.STEP_TOO_SMALL: Outcome.STEP_TOO_SMALL,
    at.PROJECTION_FAILED: Outcome.PROJECTION_FAILED,
    at.NEWTON_FAILED: Outcome.NEWTON_FAILED,
}
WHY = {
    Outcome.NOT_FINITE: "{} finds no finite values there",
    Outcome.STEP_TOO_SMALL: "{} finds no step from there on",
    Outcome.PROJECTION_FAILED: "{} does not satisfy the constraints from there on",
    Outcome.NEWTON_FAILED: "{} cannot solve its equations there",
}
LOSS = "the constraints become dependent there, which {} cannot integrate through"
# What a method has noted of a loss of rank ahead of it is not another's.
NO_LOSS = {"passes": 0.0, "planned": 0.0, "tried": 0.0}


class Fallback(Source):
    """Another method, for one that fails, or does not pass what is ahead."""

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Go on with it, if there is one."""
        name = arc.runner.method.NAME
        if code == at.LOSS_AHEAD:
            return handed_over(arc, LOSS.format(name), NO_LOSS)
        if code not in FAILED or name == ANY:
            return None
        if arc.settings.method != "auto" and name != SERIES:
            return None
        return handed_over(arc, WHY[FAILED[code]].format(name), {})


def handed_over(arc: Arc, reason: str, numbers: Mapping[str, float]) -> Decision:
    """Go on with the method that handles everything."""
    arc = arc.by(replace(arc.plan, method=ANY), arc.system)
    return by_method(arc, reason, {"h": 0.0, **numbers})


def by_method(arc: Arc, reason: str, numbers: Mapping[str, float]) -> Decision:
    """Go on with an arc by another method than before."""
    choice = Choice(f"method: {arc.plan.method} from t = {arc.t:.9g} on", reason)
    return Decision(choices=(choice,), arc=arc, numbers={"at_bound": 0.0, **numbers})


# What kept a run from its end; a place or a cause follows.
FAILURES = {
    Outcome.TOO_MANY_STEPS: "too many steps ({steps}{about})",
    Outcome.NOT_FINITE: "values that are not finite{about}",
    Outcome.EVENTS_CHATTER: "the events {about} chatter, and no time passes",
    Outcome.CONSTRAINT_JUMPS: "the position that constraint `{about}` prescribes jumps",
    Outcome.SWITCHES_ACCUMULATE: "the switches {about} accumulate",
    Outcome.PARADOX: "no contact forces satisfy the laws of {about}",
    Outcome.LAW_OUT_OF_RANGE: "{about}",
    Outcome.STATE_JUMPS: "the state would have jumped",
    Outcome.TABLE_ENDS: "the table {about}",
    Outcome.UNDETERMINED_SLIDERS: "no velocities keep the forces of {about} in limits",
    Outcome.PROJECTION_FAILED: "the constraints could not be satisfied",
    Outcome.NO_ANSWER: "constraint `{about}` is not satisfied",
    Outcome.NEWTON_FAILED: "the equations of an implicit step could not be solved",
    Outcome.STEP_TOO_SMALL: "the step size became too small",
}


def reason_of(arc: Arc, ending: Ending, row: Floats | None = None) -> str:
    """Say why a run ended so, in its last arc: at the state reached, or at `row`."""
    outcome, until = ending.outcome, arc.equations.model.until
    if outcome is Outcome.DONE:
        return f"the end was reached at t = {arc.t!r}"
    if outcome is Outcome.UNTIL and until is not None:
        return f"`{until.text}` at t = {arc.t!r}"
    if outcome is Outcome.INTERRUPTED:
        return f"interrupted at t = {arc.t!r}; the rows up to there were kept"
    shown = arc.observed() if row is None else row
    what = FAILURES[outcome].format(steps=arc.steps, about=ending.about)
    text = f"{what} at t = {float(shown[0])!r} ({_described_state(arc, shown)})"
    if outcome is Outcome.STEP_TOO_SMALL:
        text += f"; {_fastest(arc)}"
    return f"{text}: {outcome.advice}{_other_means(arc, outcome)}"


def _other_means(arc: Arc, outcome: Outcome) -> str:
    """Name a method that may go on, where it is not the one that failed."""
    if outcome not in WHY or arc.runner.method.NAME == ANY:
        return ""
    if arc.plan.step is not None:
        return f", take a smaller step, or `--method {ANY}`, which chooses its own"
    return (
        f"; `--method {ANY}` needs no Taylor series of the expressions, and may get "
        "farther"
    )


def _described_state(arc: Arc, row: Floats) -> str:
    known = dict(zip(arc.system.columns.names, row, strict=False))
    shown = [f"{name} = {known[name]:.6g}" for name in arc.equations.state]
    if len(shown) > 12:
        shown = [*shown[:12], f"... {len(shown) - 12} more"]
    return ", ".join(shown)


def _fastest(arc: Arc) -> str:
    """Name the coordinate or velocity that grows fastest for its size."""
    moving = arc.state.dynamic
    rates = np.abs(arc.rates(arc.t, arc.y))[moving]
    sizes = np.abs(arc.y[moving])
    ratio = rates / np.maximum(sizes, TINY)
    ratio[~np.isfinite(rates)] = np.inf
    # A component near zero changes fast for its size without any singularity.
    k = int(np.argmax(np.where(sizes > 1e-3 * np.max(sizes), ratio, -1.0)))
    name = arc.system.state[k]
    return f"`{name}` grows fastest, at {rates[k]:.3g} per unit of time"


def end_of_table(arc: Arc) -> Ending | None:
    """End of a run in a mode beyond the points of a table that does not go on."""
    g, p, switches = arc.equations.graph, arc.system.p, arc.system.switches
    cells = [
        (g.args[x.discrete], p.flat[arc.system.place(x.variable)])
        for x in switches.modes
    ]
    cells += [
        ((s.node,), math.ceil(v))
        for s, v in zip(switches.sides, p.side, strict=False)
        if s.whole
    ]
    for args, cell in cells:
        found = ended(g, args[0], cell) if args else None
        if found is not None:
            table, knot = found
            of = expression_text(g, *table.args)
            about = f"`{table.name}` ends at {knot:.9g}, which `{of}` has reached,"
            return Ending(Outcome.TABLE_ENDS, about)
    return None


# A state that is projected is off its constraints by rounding. One that is far off,
# looked at so often and each time so many steps later, never meets them.
CHECKS = 8
APART = 10_000


class Unmet(Source):
    """Periodic check that the constraints are satisfied."""

    def __init__(self) -> None:
        self._looks = 0

    def ask_at(self, arc: Arc) -> int:
        """Return the step of the next check."""
        return (arc.steps // APART + 1) * APART

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """End a run whose constraints have long not been satisfied."""
        held = arc.system.m and arc.plan.projected
        if code != at.PAUSED or arc.steps % APART or not held:
            return None
        shown = arc.observed().tolist()
        columns = dict(zip(arc.system.columns.names, shown, strict=True))
        unmet = []
        for row in arc.equations.rows:
            off, scale = (columns[x + row.name] for x in ("residual_", "scale."))
            unmet += [row.name] if abs(off) > BROKEN_CONSTRAINT * scale else []
        self._looks = self._looks + 1 if unmet else 0
        if self._looks < CHECKS:
            return None
        return Decision(ending=Ending(Outcome.NO_ANSWER, unmet[0]))


def unsettled(arc: Arc) -> tuple[Caution, ...]:
    """Report steps whose impulses did not converge."""
    count = int(getattr(arc.state, "unsettled", 0))
    if not count:
        return ()
    text = (
        f"in {count} of {arc.steps} steps the impulses did not converge within "
        f"{MOST_SWEEPS} sweeps: contacts overlap a little; shorter steps need "
        "fewer sweeps"
    )
    return (Caution("unsettled-impulses", text),)
