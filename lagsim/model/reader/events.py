"""Reader of the section `events`: when each acts, and what it sets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.model.model import Level, Transition
from lagsim.model.nodes import Broken, Mapping
from lagsim.model.reader.equations import read_relation
from lagsim.model.reader.expressions import Kind, check_name
from lagsim.model.reader.fields import Fields, entries, fields, listed
from lagsim.model.reader.sections import EVENT

if TYPE_CHECKING:
    from lagsim.model.nodes import Node, Scalar
    from lagsim.model.reader.expressions import Expressions

_BY_IMPACTS = "velocities jump by impacts alone: a constraint with `when: {} > 0` "
_BY_IMPACTS += "comes into force where an event sets a mode"
_HINTS = {
    Kind.COORDINATE: "no event moves a body; " + _BY_IMPACTS.format("held"),
    Kind.VELOCITY: _BY_IMPACTS.format("held"),
    Kind.STATE: "its rate may depend on a mode, or make it a mode",
    Kind.PARAMETER: "write it in `modes` instead of `parameters`",
}


def read_events(node: Node | None, x: Expressions) -> tuple[Transition, ...]:
    """Give the events, in the order of the file; faults are reported."""
    found = (
        _event(key, value, x)
        for key, value in entries(node, "`events`", x.faults)
        if check_name(key, "an event", x.faults)
    )
    return tuple(event for event in found if event is not None)


def _event(key: Scalar, node: Node, x: Expressions) -> Transition | None:
    what, faults = f"the event `{key.text}`", x.faults
    below = fields(node, what, EVENT, faults, key.place)
    given = [name for name in ("at", "every") if name in below]
    if below.sound and len(given) != 1:
        code, both = ("both-given", "both") if given else ("missing-key", "neither")
        text = f"{what} has {both} `at` {'and' if given else 'nor'} `every`"
        hint = "`at` is a condition that is located, `every` a period"
        faults.add(code, text, below.place_of(given[-1]) if given else key.place, hint)
    at, _ = read_relation(below.value("at"), f"the `at` of {what}", x, modes=True)
    every = _period(below.value("every"), f"the period of {what}", x)
    once = below.truth("once")
    sets = _sets(below, what, key, x)
    if sets is None or len(given) != 1 or (at is None and every is None):
        return None
    return Transition(key.text, sets, at, every or 0.0, once, key.place)


def _period(node: Node | None, what: str, x: Expressions) -> float | None:
    value = x.number(node, what)
    if node is not None and value is not None and value <= 0:
        text = f"{what} is {value:g}; it must be positive"
        x.faults.add("out-of-range", text, node.place)
        return None
    return value


def _sets(
    below: Fields, what: str, key: Scalar, x: Expressions
) -> tuple[tuple[str, int], ...] | None:
    """Give the modes that an event sets, each with its node; None after a fault."""
    node, faults = below.value("set"), x.faults
    pairs = entries(node, f"the `set` of {what}", faults)
    if (node is None or (isinstance(node, Mapping) and not pairs)) and below.sound:
        hint = "write set: {mode: expression}"
        faults.add("missing-key", f"{what} sets nothing", key.place, hint)
    found: list[tuple[str, int]] = []
    for name, value in pairs:
        is_mode = _is_mode(name, what, x)
        to = x.compile(value, f"`{name.text}` in {what}", Level.VELOCITY)
        if is_mode and to is not None:
            found.append((name.text, to))
    sound = pairs and len(found) == len(pairs) and not isinstance(node, Broken)
    return tuple(found) if sound else None


def _is_mode(key: Scalar, what: str, x: Expressions) -> bool:
    """Tell whether a key is a mode; else that is reported."""
    name, names = key.text, x.names
    meaning, modes = names.meaning(name), names.of(Kind.MODE)
    if meaning is not None and meaning.kind is Kind.MODE:
        return True
    if meaning is None and (names.is_faulty(name) or not names.readable):
        return False
    code, text = "unknown-name", f"{what} sets `{name}`, and there is no such mode"
    hint = x.faults.did_you_mean(name, modes)
    hint = hint or (f"modes are {listed(modes)}" if modes else f"modes: {{{name}: 0}}")
    if meaning is not None:
        code, text = "not-a-mode", f"{what} sets `{name}`, {meaning.kind.text}"
        hint = _HINTS.get(meaning.kind, hint)
    x.faults.add(code, text, key.place, hint)
    return False
