"""RK4: the classic Runge-Kutta method of order 4, with a fixed step.

For comparison with lecture notes and older programs, and for lessons on accuracy and
stability: there is no error control. Rows between steps come from cubic Hermite
interpolation. Stable on the imaginary axis for step * frequency below 2.83.

Source: W. Kutta, Z. Math. Phys. 46 (1901); E. Hairer, S. P. Norsett and G. Wanner,
Solving Ordinary Differential Equations I, 2nd ed., sections II.1 and II.6.
"""

from __future__ import annotations

from lagsim.language.arrays import Floats
from lagsim.methods import unrestricted
from lagsim.methods.parts.control import add_change, keep_compensation
from lagsim.methods.parts.fixed import (
    Fixed,
    Tableau,
    conclude,
    interpolate,
    start,
    step,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import derivative
from lagsim.native.kernels.words import total, unrolled
from lagsim.native.layout import array

__all__ = ["interpolate", "start", "step"]

NAME = "rk4"
TITLE = "classic Runge-Kutta"
ORDER = 4
DENSE_ORDER = 3
ADAPTIVE = False
IMAGINARY_LIMIT = 2.83
HANDLES = "any model; equality constraints by projection"

A = ((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0))
B = (1 / 6, 1 / 3, 1 / 3, 1 / 6)
C = (0.0, 1 / 2, 1 / 2, 1.0)
TABLEAU = Tableau(A, B, C, ORDER)
amplification = TABLEAU.amplification

refusal = unrestricted
NEEDS = ()
QUADRATURES = True
STATES = True

CONSTRAINED = True
SWITCHES = True


class Rk4(Fixed):
    """Memory of RK4: the stages' slopes, and the state of a stage."""

    stages: Floats = array(lambda s: 4 * s.size)
    z: Floats = array("size")


STATE = Rk4


def make(s: Rk4, p: Parameters, after: float, h: float) -> int:
    """Compute `new` a step h later, at the time `after`; return DONE or a code.

    See `fixed.make`.
    """
    size, k, t = s.size, s.stages, s.t
    k[:size] = s.k
    for stage in unrolled(1, 4):
        for i in range(size):
            rate = total(A[stage][j] * k[j * size + i] for j in unrolled(stage))
            s.z[i] = s.y[i] + h * rate
        derivative(t + C[stage] * h, s.z, p, k[stage * size :])
    s.evaluations += 3.0
    s.new[:] = s.y
    for i in range(size):
        s.remainder[i] = h * total(B[j] * k[j * size + i] for j in unrolled(4))
    add_change(s, p, s.k, h, s.new)
    keep_compensation(s)
    return conclude(s, p, after, h)
