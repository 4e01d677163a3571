"""The report on the start of a model, for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.admissibility.verdict import (
    AT_REST,
    ONE_SIDED,
    START_VALUE,
    RelationResiduals,
)
from lagsim.cli._shared import ERROR, WARNING, aligned_pairs, annotate, coloured
from lagsim.codes import number
from lagsim.codes.known import INADMISSIBLE
from lagsim.errors import counted, pointed
from lagsim.language.names import in_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.examination import StartReport
    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Choice


def report(
    equations: Equations,
    start: StartReport,
    choices: Sequence[Choice] = (),
    *,
    repair: bool = False,
) -> str:
    """Return the report on a start as text; its first line is the verdict.

    start : the examination.
    choices : choices of the plan.
    repair : whether an admissible start is included.
    """
    name = equations.model.name
    rows: Sequence[object] = equations.rows
    if equations.laws:
        rows = equations.model.constraints
    others = (ONE_SIDED, START_VALUE, AT_REST)
    two_sided = any(v.kind not in others for v in start.verdicts)
    rank = f" of rank {start.rank}" if two_sided else ""
    freedom = counted(start.degrees_of_freedom, "degree")
    if start.admissible:
        head = coloured("admissible", "32") + f": {name}"
    else:
        head = coloured("inadmissible", "31") + f": {name}: {'; '.join(faults(start))}"
        head += f" [{number(INADMISSIBLE)}]"
    lines = [
        head,
        (
            f"  {counted(len(equations.q), 'coordinate')}, "
            f"{counted(len(rows), 'constraint')}{rank}, {freedom} of freedom"
        ),
    ]
    if start.verdicts:
        lines.append(aligned_pairs((v.name, _described(v)) for v in start.verdicts))
    lines += _reached(equations, start)
    lines += [f"  {c.choice} ({c.reason})" for c in choices]
    for w in start.warnings:
        lines.append(f"  warning: {w.text} [{w.number}]")
        lines += [f"  {x}" for x in pointed(w.place)] if w.place else []
    if not start.admissible or repair:
        lines += _repair(start)
    return "\n".join(lines)


def faults(start: StartReport) -> list[str]:
    """Return the reasons why a start is not admissible."""
    found = [d.contradiction() for d in start.contradictions]
    if start.thin is not None:
        found.append(str(start.thin))
    named = {d.name for d in start.contradictions}
    named |= {name for d in start.contradictions for name, _ in d.combination}
    found += [
        _violation(v) for v in start.verdicts if not v.satisfied and v.name not in named
    ]
    return found


def _violation(verdict: RelationResiduals) -> str:
    position, velocity = verdict.position, verdict.velocity
    if verdict.kind == AT_REST:
        return f"no rest: {verdict.name} is {position.value:.6g}"
    if verdict.kind == START_VALUE:
        return f"the start value `{verdict.name}` is missed by {position.value:.6g}"
    if velocity is not None and position.satisfied:
        text = f"the rate of constraint `{verdict.name}` is {velocity.value:.6g}"
        return f"{text} (bound {velocity.bound:.2g}, {velocity.why})"
    if verdict.limit is not None:
        over = f"the force of `{verdict.name}` is {-verdict.limit.value:.6g} over its"
        return f"{over} limit (bound {verdict.limit.bound:.2g}, {verdict.limit.why})"
    text = f"constraint `{verdict.name}` has the residual {position.value:.6g}"
    if verdict.kind == ONE_SIDED:
        text = f"the {_sided(verdict)} of `{verdict.name}` is {position.value:.6g}"
    return f"{text} (bound {position.bound:.2g}, {position.why})"


def _described(verdict: RelationResiduals) -> str:
    residual = verdict.position.value + 0.0  # no -0
    if verdict.kind == START_VALUE:
        return f"start value, missed by {residual:.3g}"
    if verdict.kind == AT_REST:
        return f"{residual:.3g}, at rest it is 0"
    words = [verdict.kind, "scleronomic" if verdict.scleronomic else "rheonomic"]
    if verdict.pfaffian is not None:
        words.append("Pfaffian" if verdict.pfaffian else "not Pfaffian")
    if verdict.integrable is not None:
        words.append("integrable" if verdict.integrable else "not integrable")
    if verdict.redundant:
        words.append("redundant")
    text = f"{', '.join(words)}; residual {residual:.3g}"
    if verdict.velocity is not None:
        text += f", of its rate {verdict.velocity.value + 0.0:.3g}"
    if verdict.active is not None:
        text = f"{', '.join(words)}; {_status(verdict, residual)}"
    return text + ("" if verdict.satisfied else "  <- violated")


def _sided(verdict: RelationResiduals) -> str:
    return "gap" if verdict.pfaffian is None else "rate"


def _status(verdict: RelationResiduals, residual: float) -> str:
    """Return the state of a constraint that holds only at times, as text.

    verdict : the judgement on the constraint.
    residual : its gap or residual of positions, as shown in the report.
    """
    quantity = _sided(verdict) if verdict.kind == ONE_SIDED else "residual"
    text = f"{quantity} {residual:.3g}"
    if quantity == "gap" and verdict.rate is not None:
        text += f", its rate {verdict.rate.value + 0.0:.3g}"
        text += "; touches" if verdict.active else ""
    return f"{text}; {verdict.mode}" if verdict.mode else text


def _reached(equations: Equations, start: StartReport) -> list[str]:
    """Return lines on a singular mass matrix, and on the dimension of the motion.

    The latter is the number of dimensions of the positions that the motion can reach.
    """
    lines = []
    if start.augmented:
        lines.append(
            "  the mass matrix is singular; together with the constraints it is not"
        )
    reach = start.reach
    if reach is None:
        return lines
    if reach.dimension is None:
        lines.append(
            f"  how many dimensions the motion can reach is not known: {reach.reason}"
        )
        return lines
    text = f"  the motion can reach {reach.dimension} of {len(equations.q)} dimensions"
    if reach.hidden:
        names = ", ".join(reach.entering)
        count = counted(reach.hidden, "hidden holonomic combination")
        text += f"; {count} of {names}"
    return [*lines, text]


def _repair(start: StartReport) -> list[str]:
    """Return lines for `initial:` with an admissible start.

    If none was found, the lines are the reason.
    """
    if start.admissible:
        if start.rest:
            return ["  the rest, for `initial:`", *_pasteable(start.rest)]
        if not start.changes:
            return ["  nothing to repair"]
        exact = {name: new for name, (_, new) in start.changes.items()}
        return ["  the exact state, for `initial:`", *_pasteable(exact)]
    if not start.repair:
        return [f"  no admissible state was found: {start.unsolved}"]
    lines = []
    if start.unsolved:
        lines.append(f"  changing the guesses is not enough: {start.unsolved}")
    lines += ["  the nearest admissible state, for `initial:`"]
    lines += _pasteable(start.repair)
    guesses = ", ".join(f"{in_file(name)}: {{guess: ...}}" for name in start.repair)
    lines.append(f"  or solve for some of these values: {guesses}")
    return lines


def _pasteable(values: Mapping[str, float]) -> list[str]:
    return [f"    {in_file(name)}: {value!r}" for name, value in values.items()]


def annotate_start(equations: Equations, start: StartReport) -> None:
    """Annotate the constraint that a start violates, and all warnings on the start."""
    model = equations.model
    if not start.admissible:
        wrong = {v.name for v in start.verdicts if not v.satisfied}
        places = [c.relation.place for c in model.constraints if c.name in wrong]
        places += [v.place for v in model.initial]
        line, column = (places[0].line, places[0].column) if places else (None, None)
        text = f"inadmissible: {model.name}: {'; '.join(faults(start))}"
        annotate(ERROR, text, model.file, line, column, number(INADMISSIBLE))
    for caution in start.warnings:
        text = f"{model.name}: {caution.text}"
        at = caution.place
        line, column = (at.line, at.column) if at else (None, None)
        annotate(WARNING, text, model.file, line, column, caution.number)
