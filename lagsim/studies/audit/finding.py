"""Finding of the audit: the reason for which rows are doubtful, or none.

The drift of energy - work and the constraint residuals are errors that the rows of a
run show without a reference. For an adaptive method both must stay within the bound
that its error estimate implies. If either exceeds this bound by far, or if a repeat by
another method follows another motion, the audit has a finding: the run is repeated by
other means, and if these fail as well, its rows are not valid. (Chaotic motions depart
from any repeat and conserve their energy: for these only the horizon is reported.)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.studies.audit.balances import energy_error, energy_jumps
from lagsim.studies.audit.evidence import (
    FAR,
    UNEXPLAINED,
    energy_rounding,
    worst_residual,
)
from lagsim.tolerances import ENERGY_DRIFT, SAME_ROW, SATISFIED

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.session import Session
    from lagsim.studies.audit.balances import Balance
    from lagsim.studies.audit.evidence import Evidence

# Bound of the energy drift, in relative tolerances, for any estimated error: rows with
# a larger drift, which is also above UNEXPLAINED, are not valid.
ACCURATE = 1e6
# The relative tolerance that is assumed for an exact method.
EXACT_RTOL = 1e-12
# A repeat follows another motion if it differs by the part PARTED of a range and by
# TOLERANCES times the tolerance.
PARTED = 1e-3
TOLERANCES = 1e4
# Formulations in which constraints, and with them the energy, drift.
LOOSE = ("baumgarte", "drift")


class Finding(NamedTuple):
    """Reason why rows are doubtful, and the first time at which they are.

    Attributes
    ----------
    text : str
    time : float
    refutes : bool
        Whether the rows are certainly no motion of the model; else a further run
        decides.
    violates_constraint : bool
        Whether a constraint is not satisfied.
    """

    text: str
    time: float
    refutes: bool
    violates_constraint: bool = False


def up_to(session: Session, time: float) -> Session:
    """Return the session with its end at the last output time before `time`."""
    settings = session.case.settings
    start, step = settings.start, settings.output_step
    last = math.ceil((time - start) / step - SAME_ROW) - 1
    end = min(start + max(last, SAME_ROW) * step, settings.end)
    return session._replace(case=session.case.with_settings(end=end))


def audit(run: Evidence) -> Finding | None:
    """Return the finding against a complete run; None if there is none."""
    plan = run.plan
    if (
        plan.rtol is None
        or not run.trajectory.outcome.complete
        or plan.formulation in LOOSE
    ):
        return None
    found = _unsatisfied(run)
    for balance in run.balances:
        found = found or _energy_drift(run, balance)
    return found or _another_motion(run)


def finding_text(run: Evidence) -> str:
    """Return the text of the audit's finding against a run; "" without one."""
    found = audit(run)
    return "" if found is None else f"from t = {found.time:.6g} on, {found.text}"


def _unsatisfied(run: Evidence) -> Finding | None:
    found = worst_residual(run)
    if found is None:
        return None
    name, worst = found
    text = f"constraint `{name}` is off by {worst:.2g} of its scale"
    since = run.residuals.constraint_since(name, SATISFIED)
    return (
        None
        if since is None
        else Finding(text, since, refutes=True, violates_constraint=True)
    )


def _energy_drift(run: Evidence, balance: Balance) -> Finding | None:
    """Return the finding that energy - work drifts too far, or None.

    The drift is too far if it exceeds the error of the energy that the error bar of the
    state implies.

    balance : the energy balance whose drift is judged.
    """
    drift, in_play, row = balance.drift, balance.in_play, balance.worst_row
    if not ENERGY_DRIFT * in_play < drift < math.inf or row is None:
        return None
    text = f"{balance.label} is off by {drift / in_play:.2g} of the energy in play"
    explained = _explained(run, balance, row)
    wrong = max(UNEXPLAINED, ACCURATE * (run.plan.rtol or EXACT_RTOL)) * in_play
    bound = min(FAR * explained, wrong)
    bound = max(bound, energy_rounding(run, balance), ENERGY_DRIFT * in_play)
    since = balance.since(bound)
    if not drift > bound or since is None or energy_jumps(run.equations, balance).any():
        return None
    if drift > FAR * explained:
        text += f", and the estimated error explains {explained / in_play:.1g}"
    return Finding(text, since, refutes=True)


def _explained(run: Evidence, balance: Balance, row: Floats) -> float:
    """Return the error of energy - work that the error bar of the state implies.

    It is inf if the error bar is unknown.

    balance : the energy balance.
    row : time, coordinates, velocities and more.
    """
    bar = run.bar
    if isinstance(bar, str) or bar.rates is None:
        return math.inf
    # Errors up to the first compared row after the time of `row`.
    until = min(int(np.searchsorted(bar.times, row[0])) + 1, len(bar.times))
    q, s = np.split(bar.errors[:until], [bar.rates.shape[1]], axis=1)
    errors = np.max(np.hstack([q, bar.rates[:until], s]), axis=0)
    part = float(np.max(bar.parts[:until], initial=0.0))
    part += FAR * (run.plan.rtol or EXACT_RTOL)
    error = energy_error(run.equations, balance.energy, row, errors)
    return error + part * balance.work_range


def _another_motion(run: Evidence) -> Finding | None:
    """Return the finding that run and repeat are different motions; None if not."""
    bar = run.bar
    if isinstance(bar, str):
        return None
    if bar.parted:
        return Finding(bar.parted, float(bar.times[-1]), refutes=False)
    lost, most = bar.lost, TOLERANCES * run.plan.tolerance
    if not np.max(lost) > max(PARTED, most):
        return None
    text = f"a repeat by {bar.method} gives another motion"
    return Finding(text, float(bar.times[np.argmax(lost > most)]), refutes=False)
