"""What a derivation gives, as sympy expressions: the same for every format.

With what the law of a constraint asks of its gap, rate and multiplier, in signs: the
same statements in every style, which says how gap and rate are called there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from lagsim.model.model import Constraint
    from lagsim.show.printers import Printer
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
    order, where the elimination is written step by step.
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
    """A derivation. M : (n, n), f : (n,)."""

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


UNICODE = {
    "complementarity": "0 ≤ {g} ⊥ {lam} ≥ 0",
    "impact": "{rate}⁺ = −{e} {rate}⁻",
    "inelastic": "{rate}⁺ = 0",
    "friction": "|f| ≤ {bound}, against the slip",
    "sticking": "|f| ≤ {most} while it sticks; |f| = {bound} against the slip",
    "limit": "|{lam}| ≤ {limit} while it holds; |{lam}| = {limit} against the slip",
    "when": "{lam} = 0 unless {when}",
}
_PLAIN = {
    "−": "-", "≥": ">=", "≤": "<=", "⊥": "_|_", "∂": "d", "Σ": "sum", "q̇": "q'",
    "q̈": "q''", "⁻¹": "^-1", "⁺": "+", "⁻": "-", "ᵀ": "^T", "²": "^2", "λ": "lambda",
}  # fmt: skip


def in_ascii(signs: Mapping[str, str]) -> dict[str, str]:
    """Give how signs are written in ASCII."""
    found = dict(signs)
    for sign, letters in _PLAIN.items():
        found = {k: text.replace(sign, letters) for k, text in found.items()}
    return found


ASCII = in_ascii(UNICODE)
LATEX = {
    "complementarity": r"0 \le {g} \perp {lam} \ge 0",
    "impact": r"{rate}^{{+}} = -{e} \, {rate}^{{-}}",
    "inelastic": r"{rate}^{{+}} = 0",
    "friction": r"|f| \le {bound} \text{{, against the slip}}",
    "sticking": r"|f| \le {most} \text{{ while it sticks; }} |f| = {bound} "
    r"\text{{ against the slip}}",
    "limit": r"|{lam}| \le {limit} \text{{ while it holds; }} |{lam}| = {limit} "
    r"\text{{ against the slip}}",
    "when": r"{lam} = 0 \text{{ unless }} {when}",
}
# What a statement is about, where that is not its key.
ABOUT = {"inelastic": "impact", "sticking": "friction"}


# How the module in Python calls what it does not write out.
_WORDS = {
    "g": "g", "rate": "g'", "lam": "lambda", "bound": "mu lambda",
    "most": "mu_s lambda", "limit": "F", "when": "its condition holds",
}  # fmt: skip


def conditions(
    k: Condition,
    write: Printer,
    multiplier: Any,
    called: tuple[str, str],
    signs: Mapping[str, str],
) -> dict[str, str]:
    """Give what the law asks: what a statement is about -> the statement.

    Parameters
    ----------
    multiplier
        Its symbol.
    called
        How the gap and its rate are.
    signs
        Those of the style, above.
    """
    law, words = k.law, {"lam": write(multiplier)}
    words["g"], words["rate"] = called
    for word, key in (("bound", "friction"), ("most", "static")):
        if key in law:
            words[word] = write(law[key] * multiplier)
    if "limit" in law:
        words["limit"] = write(law["limit"])
    if "when" in law:
        words["when"] = when(law["when"], write)
    return _written(law, words, signs)


def in_words(constraint: Constraint) -> tuple[str, ...]:
    """Give the same with letters for what has an expression of its own."""
    law = constraint.law
    given: dict[str, Any] = {"limit": constraint.limit, "when": constraint.when}
    if law is not None:
        given |= {"friction": law.friction, "static": law.static}
    given = {key: node for key, node in given.items() if node is not None}
    if law is not None:
        given["restitution"] = law.restitution
    return tuple(_written(given, _WORDS, ASCII).values())


def when(choice: Any, write: Printer) -> str:
    """Give the condition that `if(condition, 1, 0)` asks for."""
    return write(choice.args[0][1] if choice.is_Piecewise else choice)


def _written(
    law: Mapping[str, Any], words: Mapping[str, str], signs: Mapping[str, str]
) -> dict[str, str]:
    e = f"{law.get('restitution', 0.0):g}"
    found = _statements(law)
    return {ABOUT.get(s, s): signs[s].format(e=e, **words) for s in found}


def _statements(law: Mapping[str, Any]) -> Iterator[str]:
    if "restitution" in law:
        yield "complementarity"
        yield "impact" if law["restitution"] else "inelastic"
    if "friction" in law:
        yield "sticking" if "static" in law else "friction"
    for key in ("limit", "when"):
        if key in law:
            yield key
