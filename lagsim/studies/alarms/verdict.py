"""Whether the rows of a run are an answer: its ledger against its error estimate.

What energy - work and the constraints are off by is an error that the run itself shows.
An adaptive method is to be off by no more than its error estimate explains. Where it is
by far, or where a repeat by other means comes to another motion, the run is in doubt:
it is made anew by other means, and where these fail, too, the rows are no answer.
(Chaotic motions part from any repeat and keep their energy: the horizon is told, and
that is all.)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods import method
from lagsim.studies.alarms.groups import account_of, worth
from lagsim.studies.alarms.rows import FAR, HELD, UNEXPLAINED, not_held, rounding

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.instant import Instant
    from lagsim.plan.plan import Plan
    from lagsim.run.error import ErrorBar
    from lagsim.run.observers.ledger import Ledger
    from lagsim.run.observers.witness import Witness
    from lagsim.run.session import Session
    from lagsim.run.trajectory import Trajectory
    from lagsim.studies.alarms.groups import Balance, Whole

# And by more than this part of the energy in play; the default tolerance leaves 1e-9.
LEAST = 1e-6
# Whatever explains it: energy off by so many tolerances, and by what raises an alarm,
# is not that of the motion.
ACCURATE = 1e6
# What an exact method counts as.
EXACT_RTOL = 1e-12
# A repeat has come to another motion where it is off by that part of a range, and by so
# many tolerances.
PARTED = 1e-3
TOLERANCES = 1e4
# Formulations that let constraints, and with them the energy, go.
LOOSE = ("baumgarte", "drift")


class Doubt(NamedTuple):
    """Why the rows of a run may be no answer, and from which time on.

    `refutes` where they cannot be one; else another run has to tell. `parts` where a
    constraint is not met.
    """

    text: str
    time: float
    refutes: bool
    parts: bool = False


# A row stands no earlier than this part of a row's spacing before its time.
SAME_ROW = 1e-6


def up_to(session: Session, time: float) -> Session:
    """Give a session that ends with the last row before a time."""
    settings = session.case.settings
    start, step = settings.start, settings.output_step
    last = math.ceil((time - start) / step - SAME_ROW) - 1
    end = min(start + max(last, SAME_ROW) * step, settings.end)
    return session._replace(case=session.case.asking(end=end))


def doubt_about(
    session: Session,
    trajectory: Trajectory,
    ledger: Ledger,
    witness: Witness,
    balances: Sequence[Balance | Whole],
    bar: ErrorBar | str,
) -> Doubt | None:
    """Give why a run that came to its end is in doubt, if it is."""
    plan, equations = session.plan, session.case.equations
    judged = plan.rtol is not None or math.isinf(method(plan.method).ORDER)
    if not judged or not trajectory.outcome.complete or plan.formulation in LOOSE:
        return None
    return (
        _about_constraints(equations, session.case.examined.state, ledger, witness)
        or _about_energy(equations, plan, balances, witness, bar)
        or _about_repeat(plan, bar)
    )


def _about_constraints(
    equations: Equations, start: Instant, ledger: Ledger, witness: Witness
) -> Doubt | None:
    found = not_held(equations, start, ledger, witness)
    if found is None:
        return None
    name, worst = found
    text = f"constraint `{name}` is off by {worst:.2g} of its scale"
    since = ledger.constraint_since(name, HELD)
    return None if since is None else Doubt(text, since, refutes=True, parts=True)


def _about_energy(
    equations: Equations,
    plan: Plan,
    each: Sequence[Balance | Whole],
    witness: Witness,
    bar: ErrorBar | str,
) -> Doubt | None:
    """Hold drifts against what the errors of the state are worth in energy.

    Of the whole, and of each group that touches no other.
    """
    for balance in each:
        found = _off(equations, plan, balance, witness, bar)
        if found is not None:
            return found
    return None


def _off(
    equations: Equations,
    plan: Plan,
    balance: Balance | Whole,
    witness: Witness,
    bar: ErrorBar | str,
) -> Doubt | None:
    """Tell why one account is in doubt, if it is."""
    drift, in_play, row = balance.drift, balance.in_play, balance.worst_row
    if not LEAST * in_play < drift < math.inf or row is None:
        return None
    from lagsim.studies.alarms.jumps import jumps

    text = (
        f"{account_of(balance)} is off by {drift / in_play:.2g} of the energy in play"
    )
    explained = _explained(equations, plan, balance, row, bar)
    wrong = max(UNEXPLAINED, ACCURATE * (plan.rtol or EXACT_RTOL)) * in_play
    rounded = rounding(equations, balance, witness)
    bound = max(min(FAR * explained, wrong), rounded, LEAST * in_play)
    since = balance.since(bound)
    if not drift > bound or since is None or jumps(equations, balance):
        return None
    if drift > FAR * explained:
        text += f", and the estimated error explains {explained / in_play:.1g}"
    return Doubt(text, since, refutes=True)


def _explained(
    equations: Equations,
    plan: Plan,
    balance: Balance | Whole,
    row: Floats,
    bar: ErrorBar | str,
) -> float:
    """Give what the errors of a row make of its energy - work; inf: not known."""
    if isinstance(bar, str) or bar.rates is None:
        return math.inf
    # Up to the row that was compared next.
    until = min(int(np.searchsorted(bar.times, row[0])) + 1, len(bar.times))
    errors = np.max(np.hstack([bar.errors[:until], bar.rates[:until]]), axis=0)
    part = float(np.max(bar.parts[:until], initial=0.0))
    part += FAR * (plan.rtol or EXACT_RTOL)
    return worth(equations, balance.energy, row, errors) + part * balance.work_range


def _about_repeat(plan: Plan, bar: ErrorBar | str) -> Doubt | None:
    """Look for a time from which a repeat shows another motion."""
    if isinstance(bar, str):
        return None
    if bar.parted:
        return Doubt(bar.parted, float(bar.times[-1]), refutes=False)
    rtol = plan.tolerance
    lost = bar.lost
    if not np.max(lost) > max(PARTED, TOLERANCES * rtol):
        return None
    off = int(np.argmax(lost > TOLERANCES * rtol))
    text = f"a repeat by {bar.method} gives another motion"
    return Doubt(text, float(bar.times[off]), refutes=False)
