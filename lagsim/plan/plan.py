"""The choices of a run, and their reasons; `making` makes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from lagsim.mechanics.newton_matrix import newton
from lagsim.methods import method
from lagsim.model.model import DEFAULT_RTOL

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.mechanics.newton_matrix import Newton
    from lagsim.mechanics.reduction import Reduction
    from lagsim.mechanics.switches import Switches
    from lagsim.notes import Choice
    from lagsim.plan.subsystems import Subsystem


def newton_of(name: str, equations: Equations) -> Newton | None:
    """Newton's matrix of a method where its few entries are made use of."""
    if not hasattr(method(name), "SPARSE"):
        return None
    return newton(equations)


# The method that handles everything.
ANY = "dop853"


class Part(NamedTuple):
    """A subsystem that is integrated apart, and its own plan."""

    subsystem: Subsystem
    plan: Plan


@dataclass(frozen=True, slots=True)
class Plan:
    """The choices of a run.

    Attributes
    ----------
    method : str
    formulation : str
        See `lagsim.plan.formulation`.
    reduction : Reduction
        The equations that are integrated.
    projected : bool
        States are projected onto their constraints.
    gain : float
        Of the formulation `baumgarte`; else 0.
    elimination : Elimination or None
        The equations solved on the graph; None where loops solve them.
    tape : bool
        The model's functions are run from tapes, not compiled.
    rank : int
        Of the constraint rows, in general.
    smallest_singular_value : float
        The smallest singular value of the scaled rows, in general; with tapes, what
        the pivots of `elimination` tell at the start.
    set_aside : tuple of bool, length m
        The rows that others imply everywhere.
    lengths : tuple of float, length m
        Of the rows in the metric of M, as they usually are.
    constant : int
        What is factored once in an arc: 2 M and A, 1 only M, 0 neither.
    augmented : bool
        M is singular and is solved together with the constraints.
    rtol, atol, step : float or None
    parts : tuple of Part
        Subsystems that are integrated apart; empty where all is in one piece.
    switches : Switches
    """

    method: str
    formulation: str
    reduction: Reduction
    projected: bool
    gain: float
    elimination: Elimination | None
    tape: bool
    rank: int
    smallest_singular_value: float
    set_aside: tuple[bool, ...]
    lengths: tuple[float, ...]
    constant: int
    augmented: bool
    rtol: float | None
    atol: float | None
    step: float | None
    switches: Switches
    parts: tuple[Part, ...]
    choices: tuple[Choice, ...]

    @property
    def form(self) -> tuple[object, ...]:
        """Key of the functions that are compiled for given equations.

        Of all that a start, or values of parameters, may change.
        """
        reduction, solved = self.reduction, self.elimination
        parts = ((x.subsystem.coordinates, x.plan.form) for x in self.parts)
        return (
            self.method, self.formulation, self.projected, self.tape, self.augmented,
            solved is None or solved.along_links, solved is None, self.rtol,
            reduction.eliminated, reduction.ignored, tuple(parts),
        )  # fmt: skip

    @property
    def newton(self) -> Newton | None:
        """Newton's matrix of an implicit method, where it is sparse."""
        if self.elimination is None:
            return None
        return newton_of(self.method, self.reduction.equations)

    @property
    def tolerance(self) -> float:
        """Relative tolerance of all that controls its error, given or by default."""
        return DEFAULT_RTOL if self.rtol is None else self.rtol
