"""Whether the matrices of an implicit method are sparse."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods import method

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations
    from lagsim.solve.newton import Newton


def newton_of(name: str, equations: Equations) -> Newton | None:
    """Give Newton's matrix of a method where its few entries are made use of."""
    if not hasattr(method(name), "SPARSE"):
        return None
    from lagsim.solve.newton import newton  # of one method

    return newton(equations)
