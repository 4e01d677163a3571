"""Values that run away: relations that nothing but rounding meets, ever farther out.

`x = sqrt(1 + x^2)` has no solution; its residual falls as 1/(2 x), and its terms grow,
until at some 1e7 the one is rounding of the other. A root is where a relation begins to
be met: on the way to it, it is not. There its slope tells the root from its neighbours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats

# Not a root: that part of the way before it, the relation is met as well.
BACK = 0.1
# And what its slope there makes of the whole way is no more than so many times its
# residual, or than the rounding of its slopes along the way.
FLAT = 8.0
ROUNDING = 2.0**-50


class Missed(Protocol):
    """Residuals, of which some are not met."""

    def missed(self, x: Floats, errors: Floats) -> Any:
        """Tell of each of r whether it is not met (m,)."""


def runs_away(
    relations: Missed,
    at: Callable[[Floats], tuple[Floats, Any]],
    x0: Floats,
    x: Floats,
    errors: Floats,
) -> bool:
    """Tell whether a relation that x0 misses is met at x by rounding alone.

    at : x -> r (m,) and dr/dx (m, k), dense or sparse.
    """
    way = x - x0
    if not np.any(way):
        return False
    back = x - BACK * way
    r, J = at(x)
    first, slopes = at(x0)
    told = np.abs(J @ way)
    if not np.all(np.isfinite(told)):
        return False
    noise = np.maximum(np.abs(r), ROUNDING * (abs(slopes) @ np.abs(way)))
    gone = ~(told > FLAT * np.maximum(noise, ROUNDING * np.abs(first)))
    if not np.any(gone):
        return False
    missed = relations.missed(x0, errors) & ~relations.missed(back, errors)
    return bool(np.any(gone & missed))
