"""Corrections of the state at an instant for errors of the step that has ended.

An error of a step may leave a contact that has just opened below its ground. It may
turn the direction of a slip that stops. It may leave a small rate where a law has held
the rate at 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods.parts import parameters as kept
from lagsim.run.modes import EqualitiesAlone
from lagsim.tolerances import HALF_OF_DIGITS, SUM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.language.arrays import Floats, Ints
    from lagsim.run.arc import Arc
    from lagsim.run.events.kinematics import Kinematics

# Velocities off a curve by this part of the largest one have left the curve.
OFF_CURVE = 1e-8


def corrected_state(here: Kinematics, law: int) -> Floats | None:
    """Return the state (size,) corrected for errors of the step just ended, or None.

    None where there is nothing to correct.

    law : the index of the law whose mode has ended, or -1.
    here : all laws at the end of the step.
    """
    if here.arc.system.p.law_opens.any():
        return _raised_state(here)
    if law >= 0 and _is_stopping(here, law):
        return _straightened_state(here, law)
    return None


def _raised_state(here: Kinematics) -> Floats:
    """Return the state (size,) in which contacts just opened have gap and rate >= 0.

    Errors of a step may leave such contacts below ground, or approaching.

    here : all laws at the end of the step.
    """
    state, p = here.arc.state, here.arc.system.p
    y, held = here.y.copy(), np.flatnonzero(p.law_mode == kept.HELD)
    levels = (state.positions, here.residuals), (state.velocities, here.rates)
    for level, values in levels:
        low = np.flatnonzero((p.law_opens > 0.0) & (values < 0.0))
        if len(low):
            residuals = np.append(values[low], np.zeros(len(held)))
            y[level] -= here.shape.lift([*low, *held], residuals)
    return y


def _is_stopping(here: Kinematics, k: int) -> bool:
    """Whether the slip of law k stops before a position changes by more than rounding.

    It has to be straight: a force across its direction turns a slip until it stops.

    k : the index of the law whose mode has ended; False if it is no slip with two
        directions.
    here : all laws at the end of the step.
    """
    pair, p = [k, here.laws[k].pair], here.arc.system.p
    if pair[1] < 0 or p.law_mode[k] != kept.SLIDING:
        return False
    speed = float(np.linalg.norm(here.rates[pair]))
    places = here.shape.slopes[pair] @ here.magnitudes[here.arc.state.positions]
    back = float(np.linalg.norm(here.present[pair]))
    short = speed**2 <= 2.0 * back * SUM_ROUNDOFF * float(places.max())
    pull = here.accelerations[pair]
    across = _across(pull, p.law_direction[pair])
    turns = np.linalg.norm(across) > HALF_OF_DIGITS * np.linalg.norm(pull)
    return short and speed > p.law_still[k] and not turns


def _straightened_state(here: Kinematics, k: int) -> Floats:
    """Return the state (size,) with a stopping slip in its direction before the step.

    The slip is that of a contact in two directions. In the step in which it stops,
    rounding errors turn the direction of its friction, and thus of the slip.

    Parameters
    ----------
    here : Kinematics
        All laws at the end of the step.
    k : int
        The number of one of the two laws of the slip.
    """
    y, pair = here.y.copy(), [k, here.laws[k].pair]
    across = _across(here.rates[pair], here.arc.system.p.law_direction[pair])
    y[here.arc.velocities] -= here.shape.lift(pair, across)
    return y


def _across(x: Floats, along: Floats) -> Floats:
    """Return the component of x (2,) across the unit vector `along`."""
    return np.asarray(x - along * (along @ x))


def kept_at_rest(here: Kinematics, stopped: Ints) -> Kinematics:
    """Set the rates of stopped laws to 0 in `here.y`; return the laws at this state.

    Corrections of gaps may have changed these rates. The velocities in `here.y` get the
    least change, in place.

    stopped : ndarray of int, shape (r,), the indices of the laws.
    """
    rates = here.rates[stopped]
    if not (np.abs(rates) > here.still[stopped]).any():
        return here
    here.y[here.arc.velocities] -= here.shape.lift(stopped.tolist(), rates)
    return here.at(here.y)


def stop(here: Kinematics, y: Floats, stopped: Collection[int]) -> None:
    """Set the velocities in y at which laws hold from now on to exact values, in place.

    This is done for laws whose row has a single entry, so that the law determines one
    component of the velocity. A switch of the model at velocity 0 is then decided by
    exactly 0, and not by the rounding error of the time at which the motion stopped.

    Parameters
    ----------
    here : Kinematics
        All laws at the state y, before the correction.
    y : ndarray, shape (size,)
        The state, changed in place.
    stopped : collection of int
        Laws that slid until now and hold from now on.
    """
    v = y[here.arc.velocities]
    for k in stopped:
        row, rate = here.rows[k], here.rates[k]
        [*places] = np.flatnonzero(row)
        if len(places) == 1 and abs(rate) <= here.still[k]:
            [j] = places
            moves = rate != row[j] * v[j]  # the surface on which it rests moves
            v[j] = v[j] - rate / row[j] if moves else 0.0
    y[here.arc.velocities] = v


def leaves_curves(arc: Arc, before: Floats, y: Floats) -> bool:
    """Whether the velocities in y are off the equalities that always hold.

    A relation that is a curve of velocities has one row in an impact, along which its
    rate changes: a large jump of velocities leads off the curve.

    before, y : states (size,) just before and after an impact.
    """
    with EqualitiesAlone(arc):
        step = arc.runner.function("velocity_step")(arc.t, y)[: arc.system.n]
    speeds = np.abs([before[arc.velocities], y[arc.velocities]])
    return bool(np.max(np.abs(step)) > OFF_CURVE * np.max(speeds))
