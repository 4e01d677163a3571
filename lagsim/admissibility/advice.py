"""Warnings about a start: angles in degrees, digits, dependent rows, unused names."""

from __future__ import annotations

import re
from contextlib import suppress
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, NamedTuple

from lagsim.codes.known import (
    DEGREES,
    MULTIPLE_ROOT,
    MULTIPLIERS_NOT_UNIQUE,
    NO_EFFECT,
    REACTION_ZERO,
    REDUNDANT,
    ROUGH_START,
    UNIT_MISMATCH,
    UNUSED_PARAMETER,
    VANISHING_GRADIENT,
)
from lagsim.language.graph import CONSTANT, VARIABLE, Graph
from lagsim.language.names import in_file
from lagsim.language.parser import ExpressionError, parse
from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from lagsim.admissibility.rank import Dependence, RankReport
    from lagsim.admissibility.verdict import RelationResiduals, Residual
    from lagsim.language.parser import Parsed
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model

# --- Angles in degrees where radians are expected: by their units, or their values

IN_DEGREES = ("deg", "degree", "degrees", "°")
RADIANS = ("", "1", "rad", "radian", "radians")
_OF_ANGLES = ("sin", "cos", "tan")
_NAMED = re.compile("|".join(_OF_ANGLES))
# Typical values of angles in degrees: multiples of these, from the least to a turn.
# Angles in radians of this size are of bodies that have turned several times, and are
# seldom such multiples.
_WHOLE = (5.0, 12.0, 22.5)
_LEAST, _TURN = 10.0, 360.0


class _Term(NamedTuple):
    """A term of a sum that seems to be in degrees.

    Attributes
    ----------
    name, subject : str
        The text of the term, and the beginning of a sentence about the term.
    value : float or None
        The value; None if the unit of the term shows that it is in degrees.
    sure : bool
        Whether the unit of the term is that of an angle.
    """

    name: str
    subject: str
    value: float | None
    sure: bool = False

    def text(self, op: str) -> str:
        """Return the warning that the term, in function `op`, is in degrees."""
        if self.value is None:
            return (
                f"`{self.name}` has the unit deg, and the argument of {op} is in "
                f"radians: units never scale numbers; write {self.name}*pi/180 "
                "there, or give it in rad"
            )
        return (
            f"{self.subject} {self.value:g} and enters {op}, whose argument is in "
            f"radians: {self.value:g} degrees are written {self.value:g}*pi/180"
        )


def about_angles(model: Model) -> Iterator[Caution]:
    """Yield a warning for each angle in degrees in sin, cos or tan, once per name.

    The expressions of the model are examined, and also the expressions of the file for
    the values of parameters and the start, which are in no graph.
    """
    numbers, reported = Graph(), set[str]()
    given = list(model.stated.numbers())
    for parsed in _parsed(given):
        parsed.build(numbers, numbers.variable)
    defined = {d.node: (d.name, d.unit) for d in model.definitions if d.unit}
    found: list[tuple[str, _Term]] = []
    for g, own in ((model.graph, defined), (numbers, {})):
        functions = g.of(_OF_ANGLES)
        terms = _terms(g, [g.args[n][0] for n in functions], model, own)
        entering = ((g.ops[n], terms.get(g.args[n][0])) for n in functions)
        found += [(op, term) for op, term in entering if term]
    texts = [scalar.text for scalar in model.stated.texts().values()]
    for parsed in _parsed([*given, *texts]):
        # sin(20), of which the graph has only the value
        signless = (x for x in parsed.postfix if x[0] != "neg")
        for (kind, value, _), (op, *_) in pairwise(signless):
            if kind == "number" and op in _OF_ANGLES and _is_of_degrees(float(value)):
                found.append((op, _Term(str(value), "an angle is", float(value))))
    for op, term in found:
        if term.name not in reported:
            reported.add(term.name)
            yield Caution(DEGREES, term.text(op))


def _parsed(texts: Iterable[str]) -> Iterator[Parsed]:
    """Yield the parsed expressions of texts that contain sin, cos or tan.

    Of a relation both sides are yielded.
    """
    for text in texts:
        for side in re.split("[<>]?=", text) if _NAMED.search(text) else ():
            # the other value of the name has a fault itself
            with suppress(ExpressionError):
                yield parse(side)


def _terms(
    g: Graph,
    arguments: Sequence[int],
    model: Model,
    defined: Mapping[int, tuple[str, str]],
) -> dict[int, _Term]:
    """Find the terms of arguments of sin, cos and tan that seem to be in degrees.

    Return a dict: node at or below `arguments` -> the term in it that seems to be in
    degrees. A number that is added to a time or a length is not in degrees.

    arguments : nodes of the arguments.

    defined : node of a definition -> its name and unit.
    """
    units = {p.name: p.unit for p in model.parameters}
    units |= {q.name: q.unit for q in model.coordinates} | {"t": "s"}
    starts = model.initial[: len(model.coordinates)]
    values = {p.name: (p.value, "is") for p in model.parameters}
    values |= {start.name: (start.value, "starts at") for start in starts}
    terms: dict[int, _Term] = {}
    others: set[int] = set()  # nodes that are no angles
    for node in g.cone(arguments):  # in topological order
        leaf = str(g.payload(node)) if g.ops[node] == VARIABLE else ""
        own = leaf, units.get(leaf, "")
        name, unit = own if own[1] in IN_DEGREES else defined.get(node, own)
        value, verb = values.get(leaf, (g.value(node) or 0.0, ""))
        args = _summed(g, node)
        found = [terms[a] for a in args if a in terms]
        if unit in IN_DEGREES:
            terms[node] = _Term(name, "", None, sure=True)
        elif unit not in RADIANS or not others.isdisjoint(args):
            others.add(node)
        elif leaf and _is_of_degrees(value):
            terms[node] = _Term(name, f"`{name}` {verb}", value, sure=bool(unit))
        elif g.ops[node] == CONSTANT and _is_of_degrees(value):
            terms[node] = _Term(f"{value}", "a term is", value)
        if found and node not in terms:
            terms[node] = max(found, key=lambda x: (x.value is None, x.sure))
    return {n: term for n, term in terms.items() if term.sure or n not in others}


def _is_of_degrees(value: float) -> bool:
    """Whether a number looks like an angle in degrees, such as 30 or 90."""
    size = abs(value)
    return _LEAST <= size <= _TURN and not all(size % whole for whole in _WHOLE)


def _summed(g: Graph, node: int) -> Sequence[int]:
    """Return the terms of a sum, or of a multiple of a sum, as nodes.

    node : the sum.
    """
    op, args = g.ops[node], g.args[node]
    if op == "mul":
        factors = [g.value(a) for a in args]
        whole = any(f is not None and f.is_integer() for f in factors)
        return [a for a, f in zip(args, factors, strict=True) if whole and f is None]
    return args if op in ("add", "sub", "neg") else ()


# --- Digits, multiple roots, dependent rows

# Largest number of listed names of possible guesses.
MOST_GUESSES = 4


def rough_starts(
    equations: Equations,
    verdicts: Sequence[RelationResiduals],
    starts: Sequence[RelationResiduals],
) -> Iterator[Caution]:
    """Yield warnings on relations that the start satisfies to a few digits only.

    Each warning has advice.

    verdicts, starts : on the constraints, and on start values of definitions.
    """
    rows = {row.name: row for row in equations.rows}
    relations = {c.name: c.relation.text for c in equations.model.constraints}
    for verdict in verdicts:
        row = rows[verdict.name]
        if verdict.position.digits is not None:
            line = suggestion(equations.model, relations[verdict.name])
            advice = line or _guess(equations, row, velocities=not row.holonomic)
            yield _rough(f"`{verdict.name}`", verdict.position, advice)
        if verdict.velocity is not None and verdict.velocity.digits is not None:
            label = f"the rate of `{verdict.name}`"
            advice = _guess(equations, row, velocities=True)
            yield _rough(label, verdict.velocity, advice)
    for verdict in starts:
        if verdict.position.digits is not None:
            label = f"the start value `{verdict.name}`"
            yield _rough(label, verdict.position, "mark a value as {guess: ...}")


def _rough(label: str, residual: Residual, advice: str) -> Caution:
    return Caution(
        ROUGH_START,
        f"{label} is off by {abs(residual.value):.1g}, as if the start had been "
        f"typed with {residual.digits} digits; {advice}",
    )


def _guess(equations: Equations, row: Row, *, velocities: bool) -> str:
    """Return the advice to mark a start value as a guess that `row` determines.

    velocities : whether it is a velocity, or a position.
    """
    names = equations.velocities if velocities else equations.q
    free = [in_file(names[j]) for j in row.A.entries]
    if len(free) == 1:
        return f"mark {free[0]} as {{guess: ...}}"
    if not free or len(free) > MOST_GUESSES:
        return "mark a value as {guess: ...}"
    return f"mark {', '.join(free[:-1])} or {free[-1]} as {{guess: ...}}"


def suggestion(model: Model, relation: str) -> str:
    """Return a line of `initial` that makes a relation exact; "" if there is none.

    There is such a line if one side of `=` is a coordinate or a velocity, and the other
    side contains only parameters and start values that are stated above the line.
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


def beyond_state(equations: Equations) -> Iterator[Caution]:
    """Yield warnings on the model that do not depend on the state.

    They concern unused parameters, angles in degrees, inconsistent units, relations
    that are powers and are replaced by their simple roots, and reactions that are 0.
    """
    model, g = equations.model, equations.graph
    for stem, found in groupby(model.unused, lambda name: name.partition(".")[0]):
        name, *others = found
        text = f"the {'mode' if name in model.modes else 'parameter'} `{name}` is"
        if others:
            many = "s" * (len(others) > 1)
            text = f"`{name}` and {len(others)} other member{many} of `{stem}` are"
        yield Caution(UNUSED_PARAMETER, f"{text} given and used nowhere")
    for text in model.unused_keys:
        yield Caution(NO_EFFECT, text)
    yield from about_angles(model)
    for one in model.stated.mismatches(model):
        yield Caution(UNIT_MISMATCH, f"{one.place}: {one.text}", one.place)
    for constraint in model.constraints:
        if constraint.relation.multiple:
            name = constraint.name
            yield Caution(
                MULTIPLE_ROOT,
                f"`{name}` is a power, so that its gradient vanishes wherever it "
                f"holds: its simple root is used instead, and lambda_{name} "
                f"and residual_{name} refer to the root",
            )
    if not model.output.reactions:
        return
    from lagsim.mechanics.derivation import reactions

    for name, node in reactions(equations).items():
        if node == g.zero:
            # A reaction that is 0 throughout is not written with the definition.
            text = f"`reaction.{name}` is 0 throughout: no energy, no force and no "
            yield Caution(REACTION_ZERO, f"{text}constraint uses `{name}`")


def about_ranks(
    equations: Equations, ranks: RankReport, thin: Collection[str], *, sound: bool
) -> Iterator[Caution]:
    """Yield warnings on dependent rows and, if `sound`, on nonunique multipliers.

    thin : rows with a multiple root on their whole solution set, see `rank.ThinSet`;
        they are reported elsewhere.
    sound : whether the start is admissible.
    """
    for d in ranks.dependences:
        if d.name not in thin:
            yield _about(d)
    if ranks.not_unique and sound:
        unique = [r.name for r in equations.rows if r.name not in ranks.not_unique]
        rest = f"; unique are {', '.join(unique)}" if unique else ""
        yield Caution(
            MULTIPLIERS_NOT_UNIQUE,
            f"the multipliers of {', '.join(ranks.not_unique)} are not unique "
            f"(the ones of least norm are used){rest}; the constraint forces Qc are",
        )


def _about(d: Dependence) -> Caution:
    if not d.combination:
        here = " (only here: a singular configuration)"
        where = here if d.everywhere is False else ""
        return Caution(
            VANISHING_GRADIENT,
            f"the gradient of `{d.name}` vanishes at the start{where}: the "
            "constraint has no effect there, and its multiplier is not unique",
        )
    where = "everywhere: one constraint too many"
    if d.everywhere is False:
        where = "only here: a singular configuration, where motions branch"
    elif d.everywhere is None:
        where = "here"
    return Caution(REDUNDANT, f"{d}, {where}")
