"""What a motion does right after it has left a point: by a few short steps.

Where the rates of a surface vanish, its slope (`x*abs(x)`, `x + x_dot*abs(x_dot)` at
rest) or the forces on it, no derivative of first or second order tells to which side
the motion goes. A short step does, whatever the order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats

# The first step is this part of the run, each next one so much longer, and so many.
FIRST = 2.0**-44
LONGER = 4.0
MOST = 22
# Past this many times its rounding a surface has been left.
CLEAR = 16.0


def keeps_to(
    sides: Floats,
    rates: Callable[[float, Floats], Floats],
    values: Callable[[float, Floats], Floats],
    t: float,
    y: Floats,
    span: float,
    noise: Floats,
) -> bool | None:
    """Tell whether the motion from y leaves each surface to its side, -1 or 1.

    None where it leaves none to the wrong side, nor all to the right one.

    Parameters
    ----------
    rates, values
        y' (size,), and by how much each surface is passed (k,).
    span
        The length of the run.
    noise : ndarray, shape (k,)
        The rounding of the values.
    """
    step = FIRST * span
    for _ in range(MOST):
        found = sides * values(t + step, _after(rates, t, y, step))
        if np.any(found < -CLEAR * noise):
            return False
        if np.all(found > CLEAR * noise):
            return True
        step *= LONGER
    return None


def _after(
    rates: Callable[[float, Floats], Floats], t: float, y: Floats, h: float
) -> Floats:
    """Give y after a step of the classical Runge-Kutta method."""
    a = rates(t, y)
    b = rates(t + 0.5 * h, y + 0.5 * h * a)
    c = rates(t + 0.5 * h, y + 0.5 * h * b)
    d = rates(t + h, y + h * c)
    return np.asarray(y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d))
