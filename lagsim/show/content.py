"""What a derivation says, as sympy expressions: the same for every format."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lagsim.show.symbols import Translation


@dataclass(frozen=True)
class Force:
    """A force and what it gives: Q_j by virtual work.

    `velocity` tells that it works on a rate, Q_j = p ds/dq_j'; `shares` has (n,).
    """

    on: str
    force: Any
    direction: Any
    velocity: bool
    shares: tuple[Any, ...]


@dataclass(frozen=True)
class Line:
    """The equation of a coordinate, term by term.

    Attributes
    ----------
    momentum
        dL/dq'.
    terms
        What is worked out, by key: `ddt_dT_dqdot`, `dT_dq`, `ddt_dV_dqdot`, `dV_dq`
        (or `ddt_dL_dqdot`, `dL_dq` where the file gives a Lagrangian), `Q`.
    left, right
        The equation.
    """

    coordinate: str
    momentum: Any
    terms: dict[str, Any]
    left: Any
    right: Any


@dataclass(frozen=True)
class Condition:
    """A constraint, its derivatives, its row of A and its b.

    Attributes
    ----------
    kind
        `holonomic`, `nonholonomic` or `one-sided`.
    function
        g, or phi.
    rate
        What vanishes on the level of velocities.
    acceleration
        The rate of that: A q'' - b.
    law
        What the file gives of `restitution`, `friction` (while it slides), `static`,
        `slip`, `limit` and `when`; nothing of an equality that always holds.
    """

    name: str
    kind: str
    function: Any
    rate: Any
    acceleration: Any
    A: tuple[Any, ...]
    b: Any
    law: dict[str, Any] = field(default_factory=dict)

    @property
    def moving(self) -> bool:
        """Whether it is between velocities: what vanishes is the function itself."""
        return self.rate is self.function


@dataclass(frozen=True)
class Conserved:
    """A quantity that does not change; `definition` is the file's name for it."""

    kind: str
    of: tuple[str, ...]
    value: Any
    definition: str = ""


@dataclass(frozen=True)
class Solution:
    """Accelerations and multipliers in closed form.

    Accelerations may hold multipliers; these hold neither. `steps` come first, in
    order, where the elimination is told step by step.
    """

    accelerations: tuple[Any, ...]
    multipliers: tuple[Any, ...]
    steps: tuple[tuple[Any, Any], ...] = ()


@dataclass(frozen=True)
class Gauss:
    """Gauss's principle: G = (q'' - a)^T M (q'' - a)/2 is least, subject to A q'' = b.

    a : (n,), K : (n, m), Qc : (n,); Qc = K (A a - b). None where it is too long.
    """

    a: tuple[Any, ...] | None
    G: Any
    K: tuple[tuple[Any, ...], ...] | None
    Qc: tuple[Any, ...] | None


@dataclass(frozen=True)
class Content:
    """Everything that is told. M : (n, n), f : (n,)."""

    translation: Translation
    kinetic: Any
    potential: Any
    lagrangian: Any
    dissipation: Any
    forces: tuple[Force, ...]
    lines: tuple[Line, ...]
    M: tuple[tuple[Any, ...], ...]
    f: tuple[Any, ...]
    constraints: tuple[Condition, ...]
    conserved: tuple[Conserved, ...]
    solution: Solution | None
    gauss: Gauss | None
    notes: tuple[str, ...]

    @property
    def has_forces(self) -> bool:
        """The file has forces, or dissipation."""
        return bool(self.forces) or self.dissipation is not None
