"""What is said about a start beyond the verdict: digits, dependent rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.admissibility.angles import about_angles
from lagsim.language.parser import parse
from lagsim.language.tokens import ExpressionError
from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from lagsim.admissibility.dependence import Dependence
    from lagsim.admissibility.report import RankReport
    from lagsim.admissibility.verdict import Residual, Verdict
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model

# As many names are told of which one could be a guess.
MOST_NAMES = 4


def rough_starts(
    equations: Equations, verdicts: Sequence[Verdict], starts: Sequence[Verdict]
) -> Iterator[Caution]:
    """Say of relations that are met only roughly how the start could be exact."""
    rows = {row.name: row for row in equations.rows}
    relations = {c.name: c.relation.text for c in equations.model.constraints}
    for verdict in verdicts:
        row = rows[verdict.name]
        if verdict.position.digits is not None:
            line = suggestion(equations.model, relations[verdict.name])
            advice = line or _guess(equations, row, velocities=not row.holonomic)
            yield _rough(f"`{verdict.name}`", verdict.position, advice)
        if verdict.velocity is not None and verdict.velocity.digits is not None:
            what = f"the rate of `{verdict.name}`"
            advice = _guess(equations, row, velocities=True)
            yield _rough(what, verdict.velocity, advice)
    for verdict in starts:
        if verdict.position.digits is not None:
            what = f"the start value `{verdict.name}`"
            yield _rough(what, verdict.position, "mark a value as {guess: ...}")


def _rough(what: str, residual: Residual, advice: str) -> Caution:
    return Caution(
        "rough-start",
        f"{what} is off by {abs(residual.value):.1g}, as if the start had been "
        f"typed with {residual.digits} digits; {advice}",
    )


def _guess(equations: Equations, row: Row, *, velocities: bool) -> str:
    """Name the values of which one could be a guess."""
    names = equations.velocities if velocities else equations.q
    free = [names[j] for j in row.A.entries]
    if len(free) == 1:
        return f"mark {free[0]} as {{guess: ...}}"
    if not free or len(free) > MOST_NAMES:
        return "mark a value as {guess: ...}"
    return f"mark {', '.join(free[:-1])} or {free[-1]} as {{guess: ...}}"


def suggestion(model: Model, relation: str) -> str:
    """Give the line of `initial` that would make a relation exact, where one is plain.

    That is where one side of `=` is a coordinate or a velocity, and the other can stand
    in `initial`: it uses parameters and the start values above that line.
    """
    left, equals, right = relation.partition("=")
    if not equals:
        return ""
    places = {
        value.name: (value.place.line, value.place.column) for value in model.initial
    }
    usable = {p.name for p in model.parameters} | {"pi"}
    moving = {value.name for value in model.initial if value.node is None}
    left, right = left.strip(), right.strip()
    for name, other in ((left, right), (right, left)):
        if name not in moving:
            continue
        try:
            used = {n.text for n in parse(other).names}
        except ExpressionError:
            continue
        earlier = {n for n, place in places.items() if place < places[name]}
        if used <= usable | earlier:
            return f"write {name}: {other}"
    return ""


def about_names(model: Model) -> Iterator[Caution]:
    """Say which parameters nothing names, and which angles are not in radians."""
    for name in model.unused:
        text = f"the parameter `{name}` is given and used nowhere"
        yield Caution("unused-parameter", text)
    yield from about_angles(model)


def multiple_roots(equations: Equations) -> Iterator[Caution]:
    """Say which relations are met as simple roots of what they are written as."""
    for constraint in equations.model.constraints:
        if constraint.relation.multiple:
            name = constraint.name
            yield Caution(
                "multiple-root",
                f"`{name}` is a power, so that its gradient vanishes wherever it "
                f"holds: its simple root is taken in its place, and lambda_{name} "
                f"and residual_{name} are those of the root",
            )


def about_reactions(equations: Equations) -> Iterator[Caution]:
    """Say which reactions are 0 because nothing is written with their definitions."""
    if not equations.model.output.reactions:
        return
    from lagsim.mechanics.reactions import reactions

    for name, node in reactions(equations).items():
        if node == equations.graph.zero:
            text = f"`reaction.{name}` is 0 throughout: no energy, no force and no "
            text += f"constraint uses `{name}`"
            yield Caution("reaction-zero", text)


def about_ranks(
    equations: Equations, ranks: RankReport, thin: Collection[str], *, sound: bool
) -> Iterator[Caution]:
    """Say which rows depend on others and, of `sound` ones, which lambda are unique.

    Of rows that make a thin set more is said elsewhere.
    """
    for d in ranks.dependences:
        if d.name not in thin:
            yield _about(d)
    if ranks.not_unique and sound:
        unique = [r.name for r in equations.rows if r.name not in ranks.not_unique]
        rest = f"; unique are those of {', '.join(unique)}" if unique else ""
        yield Caution(
            "multipliers-not-unique",
            f"the multipliers of {', '.join(ranks.not_unique)} are not unique "
            f"(those of least norm are given){rest}; the constraint forces Qc are",
        )


def _about(d: Dependence) -> Caution:
    if not d.combination:
        here = " (only here: a singular configuration)"
        where = here if d.everywhere is False else ""
        return Caution(
            "vanishing-gradient",
            f"the gradient of `{d.name}` vanishes at the start{where}: the "
            "constraint has no effect there, and its multiplier is not unique",
        )
    where = "everywhere: one constraint too many"
    if d.everywhere is False:
        where = "only here: a singular configuration, where motions branch"
    elif d.everywhere is None:
        where = "here"
    return Caution("redundant", f"{d}, {where}")
