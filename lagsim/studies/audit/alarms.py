"""Warnings on a run (inputs, steps, energy, constraints, error).

A warning is a `Caution`: a stable code, and a text that names a part of the model and a
remedy. The loop over arcs raises the warnings `rank`, `unresolved-switch`,
`coordinate-singularity`, and `step-at-stability-bound` of methods with step control.
This module raises the other ones, from the rows of the run: on inputs without effect,
violated constraints, energy that no force explains, the horizon of a forecast, and
steps (`step_bounds`). docs/failing.md explains each code. The argument `run` of the
functions is the evidence on the run.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.codes.known import (
    COLUMN_NOT_FINITE,
    CONSTRAINT_NOT_HELD,
    END_IN_DOUBT,
    ENERGY_DRIFTS,
    ENERGY_GAINED,
    ENERGY_LOST,
    ERROR_UNKNOWN,
    GAIN_UNUSED,
    HORIZON,
    OPTION_UNUSED,
    START_CHANGED,
    STEP_UNUSED,
    TOLERANCE_UNUSED,
)
from lagsim.methods import method, options_of
from lagsim.notes import Caution
from lagsim.run.error import Failed
from lagsim.run.observers.monitors import gained
from lagsim.run.trajectory import Outcome
from lagsim.studies.audit.balances import energy_jumps, without_jumps
from lagsim.studies.audit.evidence import (
    UNEXPLAINED,
    energy_rounding,
    worst_residual,
)
from lagsim.tolerances import ENERGY_DRIFT, SAME_ROW, SATISFIED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.codes.known import WarningCode
    from lagsim.run.observers.monitors import Gap
    from lagsim.studies.audit.balances import Balance
    from lagsim.studies.audit.evidence import Evidence


def about_inputs(run: Evidence) -> list[Caution]:
    """Return warnings on inputs without effect, and on a start that was changed."""
    case, plan = run.session.case, run.plan
    changes, settings, name = case.examined.changes, case.settings, plan.method
    moved = (f"{x} from {old!r} to {new!r}" for x, (old, new) in changes.items())
    others = [key for key, _ in settings.options if key not in options_of(name)]
    tolerances = (settings.rtol, settings.atol) != (None, None)
    penalty = plan.formulation == "baumgarte"
    found: list[tuple[bool, WarningCode, str]] = [
        (bool(changes), START_CHANGED,
         f"the run starts from the nearest exact state: {', '.join(moved)}"),
        (plan.step is None and settings.step is not None, STEP_UNUSED,
         f"`step` has no effect: {name} chooses its steps"),
        *((True, OPTION_UNUSED,
           f"`{key}` has no effect: {name} has no such parameter") for key in others),
        (plan.rtol is None and tolerances, TOLERANCE_UNUSED,
         f"tolerances have no effect: {name} has fixed steps"),
        (settings.gain is not None and not penalty, GAIN_UNUSED,
         f"`gain` has no effect: the formulation is {plan.formulation}"),
    ]  # fmt: skip
    return [Caution(code, text) for applies, code, text in found if applies]


# The largest number of columns that a message names; further columns are counted.
MOST = 12


def about_gaps(found: Mapping[str, Gap]) -> Caution:
    """Return the warning on columns with values that are not finite.

    found : the first such value of each of these columns, by the name of the column.
    """
    described = [
        f"`{name}` is {gap.value} at t = {gap.time:.9g}"
        + (f", the first of {gap.rows} rows" if gap.rows > 1 else "")
        for name, gap in found.items()
    ]
    text = f"not all values of the table are finite: {'; '.join(described[:MOST])}"
    if len(described) > MOST:
        text += f"; and {len(described) - MOST} more columns"
    if "energy" in found or "work" in found:
        text += "; so the energy drift is not known"
    return Caution(COLUMN_NOT_FINITE, text)


# Steps until a method without location of events corrects a residual: it detects a
# contact up to one step late, and stops the penetration within the next step.
LATE = 2.0
# Energy drift that counts, in relative tolerances (the shipped models reach 20).
MANY = 1e3
# Factor of the rounding error of an energy difference between two rows.
BOTH = 4.0


def _drift(run: Evidence) -> str:
    """Return a text on an energy drift beyond the tolerance; "" if there is none.

    The bound is the larger of `ENERGY_DRIFT` and MANY times rtol, relative to the
    energy in play. Only methods with step control are considered. A drift of more than
    `UNEXPLAINED` is reported by `about_energy`.
    """
    equations, plan = run.equations, run.plan
    if plan.rtol is None:
        return ""
    least = max(ENERGY_DRIFT, MANY * (plan.rtol or 0.0))
    for balance in sorted(run.balances, key=lambda x: x.part, reverse=True):
        if not balance.part > least:
            break
        if balance.part > UNEXPLAINED or balance.worst_row is None:
            continue
        rounded = energy_rounding(run, balance, BOTH)
        since = balance.since(max(least * balance.in_play, rounded))
        if since is not None and not energy_jumps(equations, balance).any():
            of = f"{balance.label} is off by {balance.part:.2g} of the energy in play"
            return f"{of} from t = {since:.6g} on"
    return ""


def about_error(run: Evidence) -> list[Caution]:
    """Return warnings on an unknown error, an uncertain end, the horizon, and drift.

    The drift of the energy is compared with the tolerance, whatever the error bar is.
    """
    bar, plan, drift = run.bar, run.plan, _drift(run)
    if isinstance(bar, str):
        if not drift and not isinstance(bar, Failed):
            return []
        text = f"the error of the rows is not known: {bar}"
        return [Caution(ERROR_UNKNOWN, f"{text}; {drift}" if drift else text)]
    found = []
    if bar.parted:
        text = f"{bar.parted}: it is not known which is right"
        found.append(Caution(END_IN_DOUBT, f"how the run ends is uncertain: {text}"))
    if bar.horizon is not None:
        less = "a shorter step" if plan.rtol is None else "a tighter rtol"
        text = (
            f"past t = {bar.horizon:.6g} the estimated error exceeds a tenth of a "
            "coordinate's range: later rows show one possible motion of many "
            f"({less} moves this time)"
        )
        found.append(Caution(HORIZON, text))
    if drift and plan.atol is None:
        text = (
            f"{drift}, more than the tolerance allows: the error of the rows is "
            f"about {bar.relative:.2g} of a coordinate's range (far from the "
            "origin, positions have few digits left for small motions)"
        )
        found.append(Caution(ENERGY_DRIFTS, text))
    return found


def about_constraints(run: Evidence) -> list[Caution]:
    """Return the warning on a constraint that rows do not satisfy; [] if all do.

    For a method that does not locate impacts, the bound of a residual is the change of
    the constraint in `LATE` steps: such a method is no more accurate.
    """
    plan, trajectory = run.plan, run.trajectory
    coarse = None
    if plan.step is not None and not getattr(method(plan.method), "EVENTS", True):
        extents = trajectory.extents
        speeds = [
            max(map(abs, extents.get(v, (0.0,)))) for v in run.equations.velocities
        ]
        coarse = LATE * plan.step, np.array(speeds)
    found = worst_residual(run, coarse)
    if found is None:
        return []
    name, worst = found
    if trajectory.outcome is Outcome.CONSTRAINT_JUMPS:
        since = run.residuals.constraint_since(name, SATISFIED)
        length = trajectory.end - trajectory.start
        if since is not None and trajectory.end - since <= SAME_ROW * length:
            return []  # the last row shows the jump that has ended the run
    why = "the constraints do not determine this motion, and the rows are not valid"
    loose = not plan.projected or plan.formulation in ("baumgarte", "drift")
    if loose and not plan.reduction.eliminated:
        why = (
            f"the formulation {plan.formulation} does not enforce it; `projection` does"
        )
    text = (
        f"constraint `{name}` is not satisfied in all rows (off by {worst:.2g} of "
        f"its scale): {why}"
    )
    return [Caution(CONSTRAINT_NOT_HELD, text)]


def about_energy(run: Evidence) -> list[Caution]:
    """Return warnings on energy that is gained or lost without a force.

    There is a warning for each decoupled group, or one for the whole system. With step
    control the largest deviation of energy - work counts. With a fixed step its trend
    counts, since the energy of a symplectic method oscillates without a trend.
    """
    found: list[Caution] = []
    for balance in run.balances:
        if balance.names or not found:
            found += _gained(run, balance)
    return found


def _gained(run: Evidence, balance: Balance) -> list[Caution]:
    plan, settings = run.plan, run.session.case.settings
    least, change = UNEXPLAINED * balance.in_play, balance.farthest
    if plan.rtol is None or not math.isfinite(change):
        change = gained(balance.conserved)
    if not abs(change) > least or abs(change) <= energy_rounding(run, balance):
        return []
    since = balance.since(least)
    rest = without_jumps(run.equations, balance)
    if rest is not None:
        drifts = rest - rest[0]
        change = float(drifts[np.argmax(np.abs(drifts))])
        if plan.rtol is None:
            change = gained(rest)
        if not abs(change) > least:
            return []
        since = float(balance.rows[np.argmax(np.abs(drifts) > least), 0])
    when = run.monitor.end if plan.rtol is None or since is None else since
    way = "gained" if change > 0.0 else "lost"
    reached, how = "from", "a tighter rtol"
    if plan.rtol is None:
        reached, how = "by", "a shorter step"
    text = (
        f"the motion{balance.of} has {way} energy that no force explains, "
        f"{abs(change) / balance.in_play:.2g} of the energy in play {reached} t = "
        f"{when:.6g}"
    )
    if rest is not None:
        text += ", besides jumps of its expression, which are no error"
    elif run.trajectory.outcome.complete:
        whose = plan.method
        if plan.formulation == "drift":
            whose += " and of the formulation drift"
        # Advise only settings that have not been tried.
        how += " keeps" if settings.method == "auto" else ", or `--method auto`, keeps"
        text += f": that is an error of {whose}; {how} it"
    return [Caution(ENERGY_GAINED if change > 0.0 else ENERGY_LOST, text)]


# Least mean step of a run whose steps resolve the motion, times the fastest rate of the
# rows (a series has 0.5 to 1.5). Shorter steps are limited by stability.
FOLLOWS = 0.05


def alarms(run: Evidence) -> list[Caution]:
    """Return all warnings on a run, in the order of its stages."""
    return [
        *run.session.case.examined.warnings,
        *about_inputs(run),
        *run.trajectory.warnings,
        *_about_steps(run),
        *about_energy(run),
        *about_constraints(run),
        *about_error(run),
        *([about_gaps(run.gaps.found)] if run.gaps.found else []),
    ]


def _about_steps(run: Evidence) -> list[Caution]:
    """Return warnings on steps that eigenvalues show to be too long."""
    plan, trajectory, monitor = run.plan, run.trajectory, run.monitor
    steps = trajectory.statistics.steps
    chosen = plan.step is None and plan.formulation != "baumgarte"
    module = method(plan.method)
    # Explicit pairs detect steps at the bound themselves.
    if not steps or (chosen and hasattr(module, "PAIR")):
        return []
    if chosen and math.isfinite(module.IMAGINARY_LIMIT):
        h = (trajectory.end - trajectory.start) / steps
        if h * monitor.fastest_rate > FOLLOWS:
            return []
    from lagsim.studies.step_bounds import about_steps

    return about_steps(run.equations, plan, trajectory, monitor)
