"""Failures of a method, and stiffness: the method is changed, or the run ends.

A Taylor series has no finite coefficients where an expression has a value but no
derivative (drag that grows with the speed, from rest; a root of the time); an implicit
step may have no solution. The method `ANY`, which handles every model, then replaces
the failed one; if it fails as well, the run ends. This change applies to the method of
`auto`, and to a requested Taylor series, whose failure implies nothing about the
motion. An implicit step over a loss of rank finds a false solution: there the method is
replaced even if the implicit method was requested.

A run also ends if its constraints stay unsatisfied in spite of repeated projection.
"""

from __future__ import annotations

import math
from dataclasses import replace
from math import inf, isinf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.codes.known import STEP_AT_STABILITY_BOUND, UNSETTLED_IMPULSES
from lagsim.errors import several
from lagsim.language.columns import RESIDUAL
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import ELEMENTS
from lagsim.language.tables import PIECES, cell_of, ended, last_level, written
from lagsim.mechanics.constraints import CONTACT
from lagsim.mechanics.pieces import whole
from lagsim.mechanics.surfaces import expression_text
from lagsim.methods import method
from lagsim.methods.moreau import MOST_SWEEPS
from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Choice
from lagsim.plan.formulation import STAGES
from lagsim.plan.method_choice import ANY, structure
from lagsim.program.system import System
from lagsim.run.arc import LONG, NO_LOSS, SERIES
from lagsim.run.interrupt import MOST_STEPS
from lagsim.run.modes import TrialModes
from lagsim.run.trajectory import GO_ON, Decision, Ending, Outcome, Source
from lagsim.tolerances import BROKEN_CONSTRAINT, TINY

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.methods.parts.driver import State
    from lagsim.run.arc import Arc


# Codes of kernels that cannot continue, and the outcomes.
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


class Fallback(Source):
    """Change of the method where it fails, or cannot pass a loss of rank."""

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the decision to change to `ANY` after a failure or before a rank loss.

        Without a loss of rank ahead, the result is None if the code is no failure, if
        the method `ANY` itself has failed, or if the failed method was requested and is
        no Taylor series.
        """
        name = arc.runner.method.NAME
        if code == at.LOSS_AHEAD:
            return handed_over(arc, LOSS.format(name), NO_LOSS)
        if code not in FAILED or name == ANY:
            return None
        if arc.settings.method != "auto" and name != SERIES:
            return None
        return handed_over(arc, WHY[FAILED[code]].format(name), {})


def handed_over(arc: Arc, reason: str, numbers: Mapping[str, float]) -> Decision:
    """Return the decision to continue by the method `ANY`, which handles every model.

    reason : the reason of the change, for the reader.
    numbers : new values of numbers in the method's memory, by their names in
        `methods.parts.driver.State`.
    """
    arc = arc.by(replace(arc.plan, method=ANY), arc.system)
    return by_method(arc, reason, {"h": 0.0, **numbers})


def by_method(arc: Arc, reason: str, numbers: Mapping[str, float]) -> Decision:
    """Return the decision to continue with `arc`, the present arc with another method.

    reason : the reason of the change, for the reader.
    numbers : new values of numbers in the method's memory, by their names in
        `methods.parts.driver.State`.
    """
    choice = Choice(f"method: {arc.plan.method} from t = {arc.t:.9g} on", reason)
    return Decision(choices=(choice,), arc=arc, numbers={"at_bound": 0.0, **numbers})


# Advice where a contact comes to rest at a kink of its gap.
KINKED = (
    "the slope of the gap of `{name}` jumps at the switch of `{switch}`; where a body "
    "may lie between both sides, write one relation for each side, such as `y >= k*x` "
    "and `y >= -k*x` for `y >= k*abs(x)`"
)
# Advice where a contact strikes a body that a curve of velocities holds.
CURVED = (
    "an impact leads off `{name}`, a curve of velocities, and no law of impacts is "
    "known there: write the contact as a stiff force, such as `if(x > 1, -k*(x - 1), "
    "0)`, or the relation as linear in velocities"
)
# Reasons of failed runs; the state at the end follows.
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
    """Return the reason of an ending as text, with the state at the end.

    arc : last arc of the run.
    row : output columns of the state to report, by default of the current state.
    """
    outcome, until = ending.outcome, arc.equations.model.until
    if outcome is Outcome.DONE:
        return f"the end was reached at t = {arc.t!r}"
    if outcome is Outcome.UNTIL and until is not None:
        return f"`{until.text}` at t = {arc.t!r}"
    if outcome is Outcome.INTERRUPTED:
        return f"interrupted at t = {arc.t!r}; the rows up to there were kept"
    shown = arc.observed() if row is None else row
    cause = FAILURES[outcome].format(steps=arc.steps, about=ending.about)
    text = f"{cause} at t = {float(shown[0])!r} ({_described_state(arc, shown)})"
    if outcome is Outcome.STEP_TOO_SMALL:
        text += f"; {_fastest(arc)}"
    advice = _on_rows(arc, ending) or outcome.advice
    return f"{text}: {advice}{_other_means(arc, outcome)}"


def _on_rows(arc: Arc, ending: Ending) -> str:
    """Return advice on rows that change where a contact acts; "" if there are none.

    A gap has a kink that could not be divided into pieces, or an equality is a curve of
    velocities, which an impact leaves.
    """
    e = arc.equations
    if ending.outcome is Outcome.NO_ANSWER:
        rows = {x.row.name: x.row for x in e.relations}
        on_curve = ending.about in rows and e.is_curved(rows[ending.about])
        struck = any(x.gapped for x in e.laws)
        return CURVED.format(name=ending.about) if on_curve and struck else ""
    if ending.outcome is not Outcome.SWITCHES_ACCUMULATE:
        return ""
    g, switches = e.graph, arc.system.switches
    sides = {g.variable(x.variable): x.text for x in switches.sides}
    for law in arc.equations.laws:
        if law.role is not CONTACT or f"`{law.name}`" not in ending.about:
            continue
        for n in g.cone(switches.freeze(list(law.row.A))):
            if n in sides:
                return KINKED.format(name=whole(law.name), switch=sides[n])
    return ""


def _other_means(arc: Arc, outcome: Outcome) -> str:
    """Return advice to use `ANY`, the method for any model; "" if it would not help.

    outcome : the outcome of the run.
    """
    if outcome not in WHY or arc.runner.method.NAME == ANY:
        return ""
    if arc.plan.step is not None:
        return f", use a smaller step, or `--method {ANY}`, which controls its step"
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
    """Return a sentence on the component that changes fastest, relative to its size."""
    moving = arc.state.dynamic
    rates = np.abs(arc.rates(arc.t, arc.y))[moving]
    sizes = np.abs(arc.y[moving])
    ratio = rates / np.maximum(sizes, TINY)
    ratio[~np.isfinite(rates)] = np.inf
    # A component near zero changes fast relative to its size without any singularity.
    k = int(np.argmax(np.where(sizes > 1e-3 * np.max(sizes), ratio, -1.0)))
    name = arc.system.state[k]
    return f"`{name}` grows fastest, at {rates[k]:.3g} per unit of time"


def has_ends(arc: Arc) -> bool:
    """Whether the model has tables that end the run beyond their points."""
    g, switches = arc.equations.graph, arc.system.switches
    cells = (*(x.discrete for x in switches.modes), *switches.state)
    knots = [s.node for s in switches.sides] + [n for k in cells for n in g.args[k]]
    return any(last_level(g, n) < inf for n in knots)


def end_of_table(arc: Arc, given: Sequence[int] = ()) -> Ending | None:
    """Return the ending if a table without extrapolation is past its last point.

    None if no table is, or if such tables have no effect at this time on the motion or
    on a condition.

    arc : the arc; its modes are those in force.
    given : nodes to which the search is limited, of bounds and restitutions at an
        impact. By default: all but restitutions, and bounds of laws that do not act.
    """
    g, p, switches = arc.equations.graph, arc.system.p, arc.system.switches
    acting = zip(switches.sides[: switches.acting], p.side, strict=False)
    cells = {s.node: math.ceil(v) for s, v in acting if s.whole}
    cells |= {
        inner[0]: p.flat[arc.system.place(x.variable)]
        for x in switches.modes
        if (inner := g.args[x.discrete])
    }
    cells |= _constant_cells(arc, cells)
    past = [x for node, cell in cells.items() if (x := ended(g, node, cell))]
    if not past:
        return None
    # The arguments as they are in the expressions of `_effective`.
    frozen = switches.decided.freeze([table.args[0] for table, _ in past])
    ends = {(x[0].name, n): x for x, n in zip(past, frozen, strict=True)}
    pieces = [n for n in sorted(_effective(arc, given)) if g.ops[n] in PIECES]
    for name, _, args in (written(g, n) for n in pieces):
        for table, knot in (ends[name, x] for x in args if (name, x) in ends):
            of = expression_text(g, *table.args)
            about = f"`{name}` ends at {knot:.9g}, which `{of}` has reached,"
            return Ending(Outcome.TABLE_ENDS, about)
    return None


def _constant_cells(arc: Arc, located: Collection[int]) -> dict[int, float]:
    """Return knot number (a node) -> cell, for tables of arguments constant in arcs.

    Such an argument changes only where another switch jumps: `1 + 3*heaviside(x)`.

    located : nodes of the knot numbers that have a side, or are switches of t alone.
    """
    g, switches = arc.equations.graph, arc.system.switches
    cells = (cell_of(g, n) and g.args[n][0] for n in switches.state)
    knots = [n for n in cells if n and n not in located and not isinf(last_level(g, n))]
    if not knots:
        return {}
    known = _decided(arc)
    constant = known.keys() - {"t", *arc.equations.state}
    frozen = zip(knots, switches.decided.freeze(knots), strict=True)
    return {
        n: math.floor(evaluate(g, [x], known)[0])
        for n, x in frozen
        if g.depends([x]) <= constant
    }


def _decided(arc: Arc) -> dict[str, float]:
    """Return the values of t, the state, modes of switches and file, and parameters.

    They decide conditions of frozen expressions; switches that conditions alone contain
    have the values of the present state.
    """
    p, system, model = arc.system.p, arc.system, arc.equations.model
    switches = system.switches
    names = [x.variable for x in switches.modes]
    names += [x.variable for x in switches.sides[: switches.acting]]
    names += [*model.modes, *(x.name for x in model.parameters)]
    found = {name: float(p.flat[system.place(name)]) for name in names}
    state = dict(zip(arc.equations.state, arc.y.tolist(), strict=False))
    return {"t": arc.t, **state, **found}


def _effective(arc: Arc, given: Sequence[int]) -> list[int]:
    """Return the nodes that have an effect on motion, conditions and sections.

    Where the sides of switches, modes of the file and parameters decide a condition,
    the branch not taken has no effect. Other output does not count.

    given : see `end_of_table`.
    """
    e, p = arc.equations, arc.system.p
    g, roots = e.graph, [*given]
    if not given:
        of_laws = sum(len(law.given) for law in e.laws)
        roots = e.of_motion[: len(e.of_motion) - of_laws]
        acting = [
            x for x, mode in zip(e.laws, p.law_mode, strict=True) if mode != kept.OFF
        ]
        roots += [n for law in acting for n in (law.bound, law.static)]
        roots += e.model.relations
    decided = _decided(arc)
    waiting = arc.system.switches.decided.freeze(roots)
    seen = set(waiting)
    for n in waiting:  # the list grows during the loop
        args = g.args[n]
        if g.ops[n] == "if" and decided.keys() >= g.depends(args[:1]):
            [condition] = evaluate(g, args[:1], decided)
            args = (args[0], args[1] if condition else args[2])
        waiting += {*args} - seen
        seen.update(args)
    return waiting


# A projected state satisfies its constraints to rounding. Constraints count as never
# satisfied if this number of checks fails, each after this number of further steps.
CHECKS = 8
APART = 10_000


class Unmet(Source):
    """Periodic check that the constraints are satisfied."""

    def __init__(self) -> None:
        self._looks = 0

    def pause_at(self, arc: Arc) -> int:
        """Return the number of steps at which the next check is due."""
        return (arc.steps // APART + 1) * APART

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the ending if constraints are violated at `CHECKS` successive checks.

        None otherwise.

        code : the kernel's return code; a check takes place at PAUSED.
        """
        projects = arc.system.m and arc.plan.projected
        if code != at.PAUSED or arc.steps % APART or not projects:
            return None
        shown = arc.observed().tolist()
        columns = dict(zip(arc.system.columns.names, shown, strict=True))
        unmet = []
        for row in arc.equations.rows:
            off, scale = (columns[x + row.name] for x in (RESIDUAL.prefix, "scale:"))
            unmet += [row.name] if abs(off) > BROKEN_CONSTRAINT * scale else []
        self._looks = self._looks + 1 if unmet else 0
        if self._looks < CHECKS:
            return None
        return Decision(ending=Ending(Outcome.NO_ANSWER, unmet[0]))


def unsettled(arc: Arc) -> tuple[Caution, ...]:
    """Return a caution on steps whose impulses did not converge; () if all did."""
    count = int(getattr(arc.state, "unsettled", 0))
    if not count:
        return ()
    text = (
        f"in {count} of {arc.steps} steps the impulses did not converge within "
        f"{MOST_SWEEPS} sweeps: contacts overlap a little; shorter steps need "
        "fewer sweeps"
    )
    return (Caution(UNSETTLED_IMPULSES, text),)


# --- A step limited by the stability bound: a caution, or a change to the stiff method
#
# The cost decides: the stiff method is selected where its step is several times larger
# and its operations are fewer in a trial. It would damp an excited fast oscillation
# that is smaller than the tolerance, so the explicit method is kept for excited ones.
# From time to time a trial shows whether the explicit method has become cheaper again.
#
# Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# section IV.2, for the detection of stiffness.

STIFF = "radau"
DIED_OUT = f"`--method {STIFF}` has longer steps where fast motion has died out"
EXPLICIT = "dop853"
# Factor of the number of steps at the bound from one test for stiffness to the next.
CHECK_GROWTH = 4.0
# The eigenvalues confirm the bound if they reach this part of it.
CLOSE = 0.25
# An eigenvalue is fast if it exceeds this part of the largest, and oscillates if its
# damping ratio is below the next number.
FAST = 0.5
OSCILLATING = 0.1
# A fast oscillation with more than this part of the energy is excited. A component that
# follows slow motion quasi-statically has the fourth power of the ratio of frequencies.
EXCITED = 1e-10
# The energy of a body moved by another one is at most this factor times its coupled
# energy, which has the square of the dependence of its acceleration on the other body,
# in units of the fast motion.
FOLLOWS = 1e2
# Steps of the trial, first for the growth of the step, then for the measurement.
TRIAL = 25
WORTH = 5.0
# Number of steps of the stiff method before the first trial of the explicit method,
# doubled each time; the explicit method is selected below this part of the cost.
REVIEWED = 100
CHEAPER = 0.5


class Fast(NamedTuple):
    """Fastest motion of the linearised equations.

    `rate` is the largest |eigenvalue|, `where` holds the names of the coordinates and
    states in its motion; `excited` is true if the motion oscillates with energy that a
    stiff method would damp. `slower`, of an excited motion, is the largest |eigenvalue|
    of motions that are slower by the factor FAST.
    """

    rate: float
    where: tuple[str, ...]
    excited: bool
    slower: float = 0.0


class Stiffness(Source):
    """Change of the method where the stability bound limits the steps.

    Later, repeated trials show whether the new method is still the cheaper one.
    """

    def __init__(self, arc: Arc) -> None:
        # The number of steps at which the current method is reviewed next, and the
        # state at the last review.
        series = arc.settings.method == "auto" and arc.plan.method == SERIES
        self._review_at = LONG if series else MOST_STEPS
        self._reviewed = arc.state

    def pause_at(self, arc: Arc) -> int:
        """Return the number of steps at which the current method is reviewed next."""
        another = arc.plan.method in (SERIES, STIFF)
        return self._review_at if another else MOST_STEPS

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the decision on a change of the method, or on a warning; else None.

        code : the kernel's return code, STIFF where steps are limited by stability.
        """
        if code == at.STIFF:
            return self._considered(arc)
        if code != at.PAUSED or arc.steps < self.pause_at(arc):
            return None
        if arc.plan.method == SERIES:
            return self._series_reviewed(arc)
        return self._stiff_reviewed(arc)

    def _considered(self, arc: Arc) -> Decision:
        """Return the decision after many steps at the stability bound.

        The decision is a change of the method, a caution, or `GO_ON`.
        """
        numbers = {"at_bound": 0.0, "pause_at": CHECK_GROWTH * arc.state.pause_at}
        # Forces of elements have no Jacobian.
        gathers = bool(arc.system.equations.graph.of((ELEMENTS,)))
        considered = self._of_elements if gathers else self._considered_once
        return considered(arc)._replace(numbers=numbers)

    def _of_elements(self, arc: Arc) -> Decision:
        """Return a caution that a stiff method may be faster; GO_ON if no work is done.

        Forces of elements have no Jacobian, from which eigenvalues could be computed.
        In a model in which work is done, fast motion may have died out, and a stiff
        method has longer steps.
        """
        if not arc.system.equations.works:
            return GO_ON
        return self._warning(arc, (), DIED_OUT)

    def _considered_once(self, arc: Arc) -> Decision:
        scene = arc.system.equations
        # Sliding is integrated by a separate method.
        alone = arc.slides or scene.quadratures or scene.laws
        if scene.laws and _turns_on_disc(arc):
            return GO_ON
        if alone or method(STIFF).refusal(structure(scene)):
            return GO_ON if arc.plan.method == SERIES else self._warning(arc, (), "")
        stiff = _compiled_for(arc, STIFF)
        fast = _fastest_motion(stiff)
        if fast is None:
            return self._warning(arc, (), "")
        limit = arc.runner.method.IMAGINARY_LIMIT
        if fast.rate * arc.state.step_h < CLOSE * limit:
            return GO_ON  # limited by another cause, such as a loss of rank
        is_requested = arc.settings.method != "auto"
        if arc.plan.method == SERIES and (is_requested or fast.excited):
            return GO_ON
        if is_requested:
            return self._warning(arc, fast.where, DIED_OUT)
        if fast.excited:
            # Without the fast motion the next slower one would bound the steps.
            if fast.rate < WORTH * fast.slower:
                return GO_ON
            advice = (
                f"this motion has energy, which {STIFF} would damp; make it rigid "
                "by a constraint, or model its damping"
            )
            return self._warning(arc, fast.where, advice)
        gained = _gain(arc, stiff)
        if gained < WORTH:
            return GO_ON
        self._reviewed, self._review_at = stiff.state.copy(), arc.steps + REVIEWED
        reason = (
            f"the step was held at the stability bound by {_named(fast.where)}, at "
            f"{fast.rate:.3g} per unit of time; the step of {STIFF} is {gained:.0f} "
            "times larger"
        )
        return by_method(stiff, reason, {})

    def _warning(self, arc: Arc, where: tuple[str, ...], advice: str) -> Decision:
        h, rate = arc.state.step_h, arc.state.speed
        text = (
            f"at t = {arc.t:.9g} the step ({h:.3g}) is held at the stability bound of "
            f"{arc.runner.method.NAME}, not by accuracy: {_named(where)} at about "
            f"{rate:.3g} per unit of time"
        )
        text = f"{text}; {advice}" if advice else text
        return Decision(cautions=self.once(STEP_AT_STABILITY_BOUND, text))

    def _series_reviewed(self, arc: Arc) -> Decision:
        """Return the decision on a change to the stiff method, for a Taylor series.

        The decision is that of `_considered` (the stiff method or a caution) if the
        fastest eigenvalues are damped, else `GO_ON`. The step of a Taylor series for
        accuracy is close to its stability bound, so the steps do not show whether the
        bound limits them.
        """
        from lagsim.mechanics.linearisation import Linearisation

        self._review_at = int(CHECK_GROWTH) * arc.steps
        state, equations = arc.state, arc.system.equations
        if equations.quadratures:
            return GO_ON
        try:
            blocks = state.positions, state.velocities, state.first_order
            linear = Linearisation(equations).at(arc.t, *(arc.y[x] for x in blocks))
        except ValueError:  # values are not finite there
            return GO_ON
        values = linear.eigenvalues()
        speeds = np.abs(values)
        fast = _fast(speeds)
        damped = np.any(values.real[fast] < -OSCILLATING * speeds[fast])
        return self._considered(arc) if damped else GO_ON

    def _stiff_reviewed(self, arc: Arc) -> Decision:
        """Return the decision to return to the explicit method if it is cheaper.

        `GO_ON` if it is not.
        """
        state, before = arc.state, self._reviewed
        made = state.steps - before.steps
        self._review_at, self._reviewed = int(arc.steps + 2 * made), state.copy()
        fast = None if arc.slides else _fastest_motion(arc)
        if fast is None:
            return GO_ON
        enough = CHEAPER * _cost(arc, before, state)
        shortest = method(EXPLICIT).IMAGINARY_LIMIT / max(fast.rate, TINY)
        if arc.system.operations * STAGES / shortest > enough:
            return GO_ON
        explicit = _compiled_for(arc, EXPLICIT)
        cost = _cost(arc, *_trial(explicit))
        if cost > enough:
            return GO_ON
        times = enough / CHEAPER / cost
        reason = f"no longer stiff: {STIFF} needs {times:.1f} times the operations"
        return by_method(explicit, reason, {})


def _turns_on_disc(arc: Arc) -> bool:
    """Whether a contact slips in a plane, with two directions of friction.

    At the start of such a slip friction turns the direction fast: steps are short for a
    while with every method.
    """
    p = arc.system.p
    return bool(np.any((p.law_mode == kept.SLIDING) & (p.law_pair >= 0.0)))


def _compiled_for(arc: Arc, name: str) -> Arc:
    """Return the arc with the method `name`, on a copy of the state.

    The system is compiled anew for that method.
    """
    plan = replace(arc.plan, method=name)
    return arc.by(plan, System(arc.equations, plan, quick=arc.system.quick))


def _fastest_motion(arc: Arc) -> Fast | None:
    """Return the fastest motion of q' = v, (v', s') = J (q, v, s).

    None if J is not finite.
    """
    from lagsim.mechanics.linearisation import eigenmodes

    n = arc.system.n
    size, sparse = arc.system.size, arc.system.newton
    length = (size - n) * arc.state.dynamic.stop
    length = length if sparse is None else len(sparse.entries)
    J = arc.runner.function("jacobian", length)(arc.t, arc.y)
    if sparse is None:
        J = J.reshape(size - n, -1)[: arc.state.dynamic.stop - n]
    else:
        J = sparse.jacobian(n, J)
    if not np.all(np.isfinite(J)):
        return None
    whole = np.vstack([np.eye(n, J.shape[1], n), J])
    modes = eigenmodes(whole, _fast)
    masses, equations = arc.masses, arc.system.equations
    parts = modes.parts(modes.right[:n], masses, len(equations.states))
    heavy = np.max(parts, axis=1, initial=0.0) > 0.5
    names = *equations.q, *(x.name for x in equations.states)
    where = tuple(q for q, is_in in zip(names, heavy, strict=True) if is_in)
    # Amplitudes of y', the rate of the state along each eigenvector.
    rates = arc.rates(arc.t, arc.y)[arc.state.dynamic]
    swinging = np.abs(modes.amplitudes(rates)) * modes.are_slowly_damped(OSCILLATING)
    moving = np.abs(modes.right[:n]) @ swinging
    rate = float(np.max(np.abs(modes.values)))
    excited = rate > 0.0 and _is_excited(arc, masses * moving**2, masses, J, rate)
    speeds = np.abs(np.linalg.eigvals(whole)) if excited else np.zeros(1)
    slower = float(np.max(speeds[~_fast(speeds)], initial=0.0))
    return Fast(rate, where, excited, slower)


def _is_excited(
    arc: Arc, fast: Floats, masses: Floats, J: Floats, speed: float
) -> bool:
    """Whether fast motion has energy that a stiff method would damp.

    The energy is compared with the energy of all bodies that depend on each other,
    weighted by their coupling; the energy of uncoupled bodies, and of a common speed,
    is excluded.

    Parameters
    ----------
    fast : ndarray, shape (n,)
        Twice the energy of the fast motion of each coordinate.
    masses : ndarray, shape (n,)
        Diagonal of the mass matrix.
    J : ndarray, shape (n + l, 2 n + l)
        Jacobian of (v', s') by (q, v, s).
    speed : float
        Rate of the fast motion.
    """
    n = len(masses)
    by_q, by_v = J[:n, :n], J[:n, n : 2 * n]
    depends = np.abs(by_q) / speed**2 + np.abs(by_v) / speed
    roots = np.sqrt(masses)
    ratios = np.divide(
        roots[:, None], roots, out=np.full((n, n), inf), where=roots > 0.0
    )
    coupling = np.where(depends > 0.0, ratios * depends, 0.0)
    # Part of a body's energy in another body that follows it quasi-statically.
    linked = np.minimum(FOLLOWS / EXCITED * np.maximum(coupling, coupling.T) ** 2, 1.0)
    linked = np.maximum(linked, np.eye(n))
    for _ in range(n.bit_length()):
        linked = np.minimum(linked @ linked, 1.0)
    each = masses * arc.ranges[arc.velocities] ** 2
    whole = np.minimum(linked @ each, 2.0 * arc.state.energy)
    return bool(np.any(linked @ fast > EXCITED * whole))


def _fast(speeds: Floats) -> Flags:
    """Return a mask (k,) of the speeds (k,) above the part FAST of the largest speed.

    All are True if all speeds are 0.
    """
    fast: Flags = speeds >= FAST * np.max(speeds, initial=0.0)
    return fast


def _trial(arc: Arc) -> tuple[State, State]:
    """Integrate `TRIAL` steps of an arc on a copy; return the states before and after.

    Both are copies of the memory of the method, from which `_cost` follows. The first
    `TRIAL` steps, in which the step size grows, are excluded, unless the arc ends in
    them.
    """
    state, p = arc.state.copy(), arc.system.p
    state.row_limit = state.arc_rows = -np.inf
    state.extras = state.pause_at = 0.0
    before, passed = state.copy(), p.passed
    with TrialModes(arc):  # the kernel passes knots and levels of tables
        if arc.runner.advance(state, 1, TRIAL) == at.PAUSED:
            before = state.copy()
            arc.runner.advance(state, 1, TRIAL)
    p.passed = passed
    return before, state


def _cost(arc: Arc, before: State, after: State) -> float:
    """Return the number of operations per unit of simulated time between two states.

    inf if no time has passed between them.

    before, after : the memory of the method at both times, as returned by `_trial`.
    """
    n = arc.system.n + len(arc.system.equations.states)
    passed = after.t - before.t
    if passed == 0.0:
        return inf
    # Half of the factorisations are real (n^3/3), half complex, counted as real of 2 n.
    factorisation = 0.5 * (n**3 / 3 + (2 * n) ** 3 / 3)
    if (sparse := arc.system.newton) is not None:
        factorisation = 0.5 * sparse.operations
    evaluations = after.evaluations - before.evaluations
    factorisations = after.factorisations - before.factorisations
    spent = arc.system.operations * evaluations + factorisation * factorisations
    return float(spent / passed)


def _gain(arc: Arc, stiff: Arc) -> float:
    """Return the ratio of the stiff method's step to the present step.

    0 if the stiff method costs more.

    arc, stiff : the arc by the present method and by the stiff one.
    """
    before, after = _trial(stiff)
    h = arc.state.step_h
    if _cost(stiff, before, after) > stiff.system.operations * STAGES / h:
        return 0.0
    steps = after.steps - before.steps
    return float((after.t - before.t) / steps / h)


def _named(where: tuple[str, ...]) -> str:
    shown = several((f"`{name}`" for name in where), 4)
    return f"fast motion of {shown}" if where else "fast motion"
