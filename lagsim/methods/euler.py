"""Euler: the oldest method, one evaluation per step, order 1.

Each step follows the tangent at its start. For lessons on accuracy and stability:

- **Error.** Halving the step halves the error, so each further digit costs ten times
  the work.
- **Energy.** The energy of an undamped oscillation of frequency w grows by the factor
  1 + (h w)^2 in every step h. At h w = 0.01 and w = 1 it has grown e-fold after 100
  units of time.
- **Stability.** No step is short enough on the imaginary axis, where undamped
  oscillations lie; an oscillation of damping ratio d is stable for h w < 2 d.

Source: L. Euler, Institutionum calculi integralis I (1768), section II, chapter VII;
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd
ed., sections I.7 and II.1.
"""

from __future__ import annotations

from lagsim.language.arrays import Floats
from lagsim.methods import unrestricted
from lagsim.methods.parts.fixed import Fixed, Tableau, conclude, start, step
from lagsim.methods.parts.parameters import Parameters

__all__ = ["start", "step"]

NAME = "euler"
TITLE = "explicit Euler"
ORDER = 1
DENSE_ORDER = 1
ADAPTIVE = False
IMAGINARY_LIMIT = 0.0
HANDLES = "any model; equality constraints by projection"
TABLEAU = Tableau(((),), (1.0,), (0.0,), ORDER)
amplification = TABLEAU.amplification

refusal = unrestricted
NEEDS = ()
QUADRATURES = True
STATES = True

CONSTRAINED = True
STATE = Fixed


def make(s: Fixed, p: Parameters, after: float, h: float) -> int:
    """Compute `new` a step h later, at the time `after`; return DONE or a code.

    See `fixed.make`.
    """
    s.new[:] = s.y + h * s.k
    return conclude(s, p, after, h)


def interpolate(s: Fixed, p: Parameters, x: float, out: Floats) -> None:  # noqa: ARG001
    """Write the state (size,) at the fraction x of the last step: on the chord."""
    out[: s.size] = s.old + x * (s.y - s.old)
