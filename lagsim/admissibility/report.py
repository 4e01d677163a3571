"""Records of a start: its state, verdicts, rank and repair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from lagsim.mechanics.equations import Instant

if TYPE_CHECKING:
    from lagsim.admissibility.dependence import Dependence, ThinSet
    from lagsim.admissibility.integrability import Reach
    from lagsim.admissibility.verdict import Verdict
    from lagsim.notes import Caution


class RankReport(NamedTuple):
    """The rank of the rows at a state.

    Attributes
    ----------
    smallest : float
        The smallest singular value of the scaled rows that is not zero (1 if none).
    generic_rank, generic_smallest : int, float
        The same at generic admissible states nearby.
    dependences : tuple of Dependence
        One for each row that the earlier ones span, in the order of the file.
    not_unique : tuple of str
        The constraints whose multipliers are not determined.
    """

    rank: int
    smallest: float
    generic_rank: int
    generic_smallest: float
    dependences: tuple[Dependence, ...] = ()
    not_unique: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Start(Instant):
    """A state, which rows depend on others there, and whether M needs them.

    Attributes
    ----------
    augmented : bool
        M alone is singular, but with the constraints every acceleration is determined.
    """

    ranks: RankReport
    augmented: bool


class StartReport(NamedTuple):
    """Verdicts, rank and repair of an initial state.

    Attributes
    ----------
    state : Instant
        The nearest exact state where the start is admissible, else the stated one.
    verdicts : tuple of Verdict
        The constraints, then the start values of definitions that are not met.
    ranks : RankReport
        Which equalities in force depend on others; at the nearest admissible state
        where the start is not admissible and one was found.
    lasting : RankReport
        The same of those that are always in force.
    sticking : int
        By how much the limited equalities that hold raise the rank.
    augmented : bool
        M alone is singular, but with the constraints every acceleration is determined.
    reach : Reach or None
        What velocity constraints let the motion reach; None without any.
    repair : dict or None
        The initial names that would change, and to what, where the start is not
        admissible and a nearest admissible state was found.
    contradictions : tuple of Dependence
        Rows that contradict others, at the state or, where no admissible one was found,
        at the point of least residuals.
    thin : ThinSet or None
        The rows that no multiplier keeps, at the state or at the nearest one that meets
        them.
    unsolved : str
        Why no admissible state was found, where none was; or why the guesses alone
        did not suffice.
    changes : dict
        What the exact state changes by more than rounding: name -> (stated, exact).
    """

    state: Instant
    verdicts: tuple[Verdict, ...]
    ranks: RankReport
    augmented: bool
    reach: Reach | None
    repair: dict[str, float] | None
    contradictions: tuple[Dependence, ...]
    unsolved: str
    changes: dict[str, tuple[float, float]]
    warnings: tuple[Caution, ...]
    lasting: RankReport
    thin: ThinSet | None = None
    sticking: int = 0

    @property
    def start(self) -> Start:
        """What a run begins with."""
        at = self.state
        return Start(at.t, at.q, at.v, self.lasting, self.augmented)

    @property
    def admissible(self) -> bool:
        """Whether a run may begin here."""
        if self.contradictions or self.thin is not None:
            return False
        return all(v.satisfied for v in self.verdicts)

    @property
    def degrees_of_freedom(self) -> int:
        """Coordinates minus the rank of the two-sided rows that hold.

        On a set on which they lose their rank all over, its dimension, where known.
        """
        if self.thin is not None and self.thin.degrees_of_freedom is not None:
            return self.thin.degrees_of_freedom
        return len(self.state.q) - self.rank

    @property
    def rank(self) -> int:
        """The rank of the two-sided rows that hold."""
        return self.ranks.rank + self.sticking
