"""DOPRI5: the explicit Runge-Kutta method of order 5 by Dormand and Prince.

The method of `ode45` in MATLAB and `RK45` in scipy, with their dense output. For
comparison with these programs, and for loose tolerances; from about 1e-6 on `dop853` is
faster.

- **Error.** An estimate of order 4, and PI step control.
- **Rows** between steps are of order 4.
- **Stability.** The interval on the imaginary axis, where undamped oscillations lie, is
  0.997, and that on the real axis 3.3.

Sources: J. R. Dormand and P. J. Prince, J. Comput. Appl. Math. 6 (1980) 19-26; E.
Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd ed.,
sections II.4 (control), II.5 (table 5.2) and II.6 (dense output).
"""

from __future__ import annotations

from lagsim.methods import unrestricted
from lagsim.methods.parts.embedded import (
    BETA,
    Embedded,
    EmbeddedPair,
    interpolate,
    interpolate_rates,
    start,
    step,
)

__all__ = ["interpolate", "interpolate_rates", "start", "step"]

NAME = "dopri5"
TITLE = "Dormand-Prince 5(4)"
ORDER = 5
DENSE_ORDER = 4
ADAPTIVE = True
IMAGINARY_LIMIT = 0.997
HANDLES = "any model; equality constraints by projection"
refusal = unrestricted
NEEDS = ()
QUADRATURES = True
STATES = True

CONSTRAINED = True
SWITCHES = True

C = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
A = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
ERROR = (
    71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40
)  # fmt: skip
# The fifth term of the dense output, with the factor x^2 (1 - x)^2 (II.6; L. F.
# Shampine, Math. Comp. 46 (1986) 135-150, has the same polynomial).
DENSE = (
    -12715105075 / 11282082432, 0.0, 87487479700 / 32700410799,
    -10690763975 / 1880347072, 701980252875 / 199316789632,
    -1453857185 / 822651844, 69997945 / 29380423,
)  # fmt: skip
# A step with h w = 0.9 of an oscillation has an estimate of 5e-4 of its amplitude:
# accuracy seldom allows it.
PAIR = EmbeddedPair(
    A,
    C,
    (ERROR,),
    (DENSE,),
    ORDER,
    exponent=0.2 - 0.75 * BETA,
    stability_bound=0.9,
    early=0.1,
)
TABLEAU = PAIR.tableau
amplification = TABLEAU.amplification


class Dopri5(Embedded):
    """Memory of DOPRI5: 7 slopes, and a dense output of degree 4."""

    stages: int = 7
    terms: int = 5


STATE = Dopri5
