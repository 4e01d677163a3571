"""Energies, states, forces, relations, and events."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, Literal, NamedTuple

from lagsim.codes.known import (
    BOTH_GIVEN,
    CYCLE,
    MISSING_KEY,
    NO_COORDINATE,
    NOT_A_DIRECTION,
    NOT_A_MODE,
    NOT_AFFINE,
    OUTPUT_ONLY,
    UNKNOWN_NAME,
)
from lagsim.language.names import in_file, rate_of, rated
from lagsim.language.parser import parse_relation
from lagsim.model.model import (
    FirstOrderState,
    Force,
    Level,
    Relation,
    Transition,
)
from lagsim.model.nodes import (
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    entries_of,
)
from lagsim.model.reader import hints
from lagsim.model.reader.fields import (
    ENERGY,
    EVENT,
    STATE,
    Fields,
    entries,
    fields,
    quoted_list,
)
from lagsim.model.reader.names import NameKind, check_name

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from contextlib import AbstractContextManager

    from lagsim.codes.known import ErrorCode
    from lagsim.language.graph import Degrees
    from lagsim.model.reader.expressions import Expressions

SUM_OF_VELOCITIES = "write a sum of velocities with factors that depend on positions"


class Energies(NamedTuple):
    """Graph nodes of the energies; None for an energy that is missing or faulty."""

    lagrangian: int | None
    kinetic: int | None
    potential: int | None
    dissipation: int | None


def energy_fields(top: Fields) -> Fields:
    """Return the section `energy` with its keys checked.

    top : the sections of the file.
    """
    found, faults = top.below("energy", ENERGY), top.faults
    given = [k for k in ("kinetic", "potential") if k in found]
    if "energy" not in top:
        hint = "give `kinetic` and `potential`, or `lagrangian`"
        faults.add(MISSING_KEY, "the file has no `energy`", top.place, hint)
    elif "lagrangian" in found and given:
        both = " and ".join(f"`{k}`" for k in given)
        text = f"both {both} and `lagrangian` are given"
        hint = "`lagrangian` replaces `kinetic` and `potential`"
        faults.add(BOTH_GIVEN, text, found.place_of("lagrangian"), hint)
    elif given:
        for missing in ("kinetic", "potential"):
            found.needs(missing, f"if there is none, write `{missing}: 0`")
    elif found.sound and "lagrangian" not in found:
        text = "`energy` has neither `kinetic` and `potential` nor `lagrangian`"
        faults.add(MISSING_KEY, text, found.place)
    return found


def read_energies(
    found: Fields,
    x: Expressions,
    gathering: Callable[[str], AbstractContextManager[None]] = lambda _: nullcontext(),
) -> Energies:
    """Return the graph nodes of the section `energy`; faults are reported.

    gathering : for the key of an energy, the context manager within which its sums may
        be elements, see `language.elements`.
    """
    nodes: dict[str, int | None] = {}
    called = {"dissipation": "the dissipation", "lagrangian": "the Lagrangian"}
    for key in ENERGY:
        node, label = found.value(key), called.get(key, f"the {key} energy")
        with gathering(key):
            nodes[key] = x.compile(node, label, Level.VELOCITY)
        x.refuse_rates(node, label)
    kinetic, potential, lagrangian, dissipation = (nodes[k] for k in ENERGY)
    if kinetic is not None and potential is not None:
        lagrangian = x.graph.call("sub", kinetic, potential)
    x.energies.update(kinetic=kinetic, potential=potential)
    return Energies(lagrangian, kinetic, potential, dissipation)


def read_states(given: list[Entry], x: Expressions) -> tuple[FirstOrderState, ...]:
    """Return the first-order states with their rates; faults are reported.

    Rates of states within a rate, also in definitions, are replaced by their
    expressions.

    given : the entries of the section `states`.
    """
    found: dict[str, FirstOrderState] = {}
    for key, node in given:
        name, label = key.text, f"the state `{key.text}`"
        below = fields(node, label, STATE, x.faults, key.place)
        below.needs(
            "rate", f"write {name}: {{rate: ...}}, the expression for `{rate_of(name)}`"
        )
        built = x.compile(below.value("rate"), f"the rate of {label}", Level.VELOCITY)
        unit, about = below.text("unit"), below.text("description")
        if built is not None:
            found[name] = FirstOrderState(name, built, unit, about)
    g, rates = x.graph, {name: s.rate for name, s in found.items()}
    for _ in found:
        new = {g.variable(rate_of(s)): node for s, node in rates.items()}
        rates = dict(zip(rates, g.substitute(rates.values(), new), strict=True))
    for key, _ in given:
        if rate_of(key.text) in g.depends([rates.get(key.text, g.zero)]):
            text = f"the rate of the state `{key.text}` depends on itself"
            x.faults.add(CYCLE, text, key)
    if given:
        x.replace_rates(rates)
    return tuple(s._replace(rate=rates[name]) for name, s in found.items())


def read_forces(node: Node | None, x: Expressions) -> tuple[Force, ...]:
    """Return the generalized forces of the section `forces`; faults are reported."""
    pair = entries_of(node)
    if len(pair) == 2 and not any(hints.node_text(value) for _, value in pair):
        node = Sequence(tuple(key for key, _ in pair), pair[0][0].place)  # {x, F}
    return tuple(_along(entries(node, "`forces`", x.faults), "force", "", x))


def _along(
    given: Iterable[Entry], noun: str, of: str, x: Expressions
) -> Iterator[Force]:
    """Yield the forces, or impulses, of entries whose keys name their directions.

    given : entries of a coordinate or definition and a force.
    noun : `force` or `impulse`, for messages.
    of : the event of an impulse, or "".
    """
    for key, value in given:
        direction = _direction(key, noun, x)
        label = f"the {noun} on `{key.text}`{of}"
        compiled = x.compile(value, label, Level.VELOCITY)
        if direction is not None and direction[1] is Level.VELOCITY:
            x.refuse_rates(key, f"the definition `{key.text}`")
        if direction is not None and compiled is not None:
            yield Force(key.text, compiled, *direction, value.place)


def _direction(key: Scalar, noun: str, x: Expressions) -> tuple[int, Level] | None:
    """Return the node of the coordinate or definition on which a force acts.

    The second result is its level of differentiation, see `model.model.Force`. The
    result is None if the name cannot be used; the fault is then added to `x.faults`.

    key : the name of the coordinate or the definition, with its place.
    noun : `force` or `impulse`, for messages.
    """
    name, place, faults = key.text, key.place, x.faults
    meaning = x.names.meaning(name)
    one = f"{'an' if noun == 'impulse' else 'a'} {noun}"
    if meaning is None:
        if not x.names.is_faulty(name) and x.names.complete:
            names = x.names.moving()
            hint = faults.did_you_mean(name, names)
            hint = hint or f"{one} acts along one of {quoted_list(map(in_file, names))}"
            text = f"`{name}` is neither a coordinate nor a definition"
            faults.add(UNKNOWN_NAME, text, place, hint)
        return None
    kind, base = meaning
    if kind is NameKind.COORDINATE:
        return x.graph.variable(name), Level.POSITION
    text, hint = f"{one} cannot work on `{name}`", ""
    code: ErrorCode | Literal[""] = ""
    node, level = x.definitions.get(name, (None, Level.POSITION))
    if kind is not NameKind.DEFINITION:
        code, text = NOT_A_DIRECTION, f"{text}, {kind.text}"
        hint = "it works on a coordinate or on a definition"
        if kind in (NameKind.VELOCITY, NameKind.RATE):
            hint = f"write `{base}`: a force on `{base}` has the power p*{name}"
            if noun == "impulse":
                hint = f"write `{base}`: an impulse on `{base}` changes `{name}`"
    elif level is Level.OUTPUT:
        code, text = OUTPUT_ONLY, f"{text}: it uses {level.text}"
        hint = "work on positions or velocities"
    elif node is not None and level > 1 and not is_affine(node, x):
        code, text = NOT_AFFINE, f"{text}: it is not linear in the velocities"
        hint = SUM_OF_VELOCITIES
    if code:
        faults.add(code, text, place, hint)
    return None if code or node is None else (node, level)


def degrees(node: int, x: Expressions) -> Degrees | None:
    """Return the least and greatest degree in the velocities of a graph node's terms.

    None if the node is no polynomial in the velocities.
    """
    return x.graph.degree(node, x.names.velocities())


def has_velocity(node: int, x: Expressions) -> bool:
    """Whether a graph node depends on velocities."""
    return not x.names.velocities().isdisjoint(x.graph.depends([node]))


def is_affine(node: int, x: Expressions) -> bool:
    """Whether a graph node is a polynomial of degree 1 or 0 in the velocities."""
    found = degrees(node, x)
    return found is not None and found.most <= 1


# --- Relations: constraints, and `until`


def read_relation(
    node: Node | None, label: str, x: Expressions, *, modes: bool = False
) -> tuple[Relation | None, bool | None]:
    """Build a relation, and determine whether it is an equality.

    node, label : the relation in the file, and its name in messages.
    modes : whether it may depend on modes alone; otherwise it must contain a
        coordinate, velocity or state.

    Returns
    -------
    relation : Relation or None
        None without a relation, or after a fault.
    equality : bool or None
        Whether it is an equality; None if it could not be parsed.
    """
    found = x.text(node, label, parse_relation)
    if found is None:
        return None, None
    scalar, parsed = found
    equality = parsed.sense == "="
    if not x.check(parsed.names, scalar, label, Level.VELOCITY):
        return None, equality
    gap = x.build(parsed.left)
    if parsed.right is not None:
        sides = (gap, x.build(parsed.right))
        gap = x.graph.call("sub", *(sides[::-1] if parsed.sense == "<=" else sides))
    moving = {NameKind.COORDINATE, NameKind.STATE, *([NameKind.MODE] if modes else ())}
    if not named(gap, moving, x):
        text = f"{label} depends on no coordinate and no velocity"
        hint = _AT_A_TIME if modes else ""
        if label == "`until`":
            hint = "a time to stop at is `end` or `duration`"
        elif "section" in label:
            hint = "a section with rows at regular times has `every`"
        x.faults.add(NO_COORDINATE, text, scalar, hint)
        return None, equality
    text = " ".join(scalar.text.split())
    text += scalar.reading.member() if scalar.reading else ""
    return Relation(gap, equality, text, scalar.place), equality


_AT_A_TIME = (
    "an event at regular times has `every`; one at a single time compares t with a "
    "mode: `modes: {t1: 1}` and `at: t >= t1`"
)


def named(node: int, kinds: Collection[NameKind], x: Expressions) -> set[str]:
    """Return the variables of given kinds on which a graph node depends.

    A rate, such as `s_dot`, counts as of the kind of `s`.
    """
    known, used = x.names.variables, x.graph.depends([node])
    return {name for name in used if known.get(rated(name)[0]) in kinds}


# --- Events: the time of each, its assignments and its impulses

_BY_IMPULSES = "an event changes a velocity by an impulse: write impulse: {name: "
_BY_IMPULSES += "expression}, in N s, with a coordinate or a definition as its name"
_HINTS = {
    NameKind.COORDINATE: "no event moves a body; " + _BY_IMPULSES,
    NameKind.VELOCITY: _BY_IMPULSES,
    NameKind.RATE: _BY_IMPULSES,
    NameKind.STATE: "its rate may depend on a mode, or make it a mode",
    NameKind.PARAMETER: "write it in `modes` instead of `parameters`",
}


def read_events(node: Node | None, x: Expressions) -> tuple[Transition, ...]:
    """Return the events, in the order of the file; faults are reported."""
    found = (
        _event(key, value, x)
        for key, value in entries(node, "`events`", x.faults)
        if check_name(key, "an event", x.faults)
    )
    return tuple(event for event in found if event is not None)


def _event(key: Scalar, node: Node, x: Expressions) -> Transition | None:
    label = f"the event `{key.text}`"
    below = fields(node, label, EVENT, x.faults, key.place)
    hint = "`at` is a condition that is located, `every` a period"
    one = below.either("at", "every", hint)
    at, _ = read_relation(below.value("at"), f"the `at` of {label}", x, modes=True)
    of = f"the period of {label}"
    every = x.number(below.value("every"), of, positive=True)
    once = below.truth("once")
    given = [below.value(name) for name in ("set", "impulse")]
    sets, impulses = (
        entries(part, f"the `{name}` of {label}", x.faults)
        for name, part in zip(("set", "impulse"), given, strict=True)
    )
    empty = all(
        part is None or (isinstance(part, Mapping) and not entries_of(part))
        for part in given
    )
    if empty and below.sound:
        text = f"{label} has no assignments and no impulse"
        hint = "write set: {mode: expression} or impulse: {coordinate: expression}"
        x.faults.add(MISSING_KEY, text, key, hint)
    found: list[tuple[str, int]] = []
    for name, value in sets:
        is_mode = _is_mode(name, label, x)
        to = x.compile(value, f"`{name.text}` in {label}", Level.VELOCITY)
        if is_mode and to is not None:
            found.append((name.text, to))
    kicks = tuple(_along(impulses, "impulse", f" by {label}", x))
    sound = one and len(found) == len(sets) and len(kicks) == len(impulses)
    if not sound or not (sets or impulses) or (at is None and every is None):
        return None
    return Transition(key.text, tuple(found), at, every or 0.0, once, key.place, kicks)


def _is_mode(key: Scalar, label: str, x: Expressions) -> bool:
    """Whether a key is the name of a mode; if not, a fault is reported."""
    name, names = key.text, x.names
    meaning, modes = names.meaning(name), names.of(NameKind.MODE)
    if meaning is not None and meaning.kind is NameKind.MODE:
        return True
    if meaning is None and (names.is_faulty(name) or not names.readable):
        return False
    code: ErrorCode = UNKNOWN_NAME
    text = f"{label} sets `{name}`, and there is no such mode"
    hint = x.faults.did_you_mean(name, modes)
    hint = hint or (
        f"modes are {quoted_list(modes)}" if modes else f"modes: {{{name}: 0}}"
    )
    if meaning is not None:
        code, text = NOT_A_MODE, f"{label} sets `{name}`, {meaning.kind.text}"
        hint = _HINTS.get(meaning.kind, hint)
    x.faults.add(code, text, key, hint)
    return False
