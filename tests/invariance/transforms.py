"""Models rewritten to equivalent ones: elsewhere, moving, in other units, ...

Each transformation maps a Document to one whose columns `q` keep their meaning: a
coordinate q that is replaced becomes a definition of that name, so that no other text
changes. It works on texts alone; start values are evaluated by sympy.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import Any

import sympy as sp
import yaml

from tests.sympy_oracle import expression

_T = re.compile(r"\bt\b")
_RATE = re.compile(r"\b([^\W\d]\w*_dot)\b")
_WORD = re.compile(r"[^\W\d]\w*")
# What a constraint may have besides its relation.
LAWS = ("restitution", "friction", "slip", "when", "limit")


@dataclass(frozen=True)
class Document:
    """A model's texts, its start as numbers, and its times.

    laws : the entries of each constraint besides its relation, as in the file
    states : the rate of each first-order state
    events, sections : entries of the file, in times of the first model
    scale : factor from columns of t to the times of the first model
    shift : subtracted from t before multiplication by `scale`
    """

    parameters: dict[str, str]
    coordinates: tuple[str, ...]
    definitions: dict[str, str]
    energy: dict[str, str]
    forces: dict[str, str]
    constraints: dict[str, str | list[str]]
    initial: dict[str, float]
    guesses: frozenset[str]
    start: float
    duration: float
    output_step: float
    until: str = ""
    laws: dict[str, dict[str, Any]] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)
    scale: float = 1.0
    shift: float = 0.0
    states: dict[str, str] = field(default_factory=dict)
    modes: dict[str, str] = field(default_factory=dict)
    events: dict[str, dict[str, Any]] = field(default_factory=dict)
    tables: dict[str, Any] = field(default_factory=dict)
    sections: dict[str, dict[str, Any]] = field(default_factory=dict)

    def text(self):
        """Write the model file."""
        simulation: dict[str, Any] = {
            "start": repr(self.start), "duration": repr(self.duration),
            "output_step": repr(self.output_step), **self.settings,
        }  # fmt: skip
        if self.until:
            simulation["until"] = self.until
        initial: dict[str, Any] = {
            name: {"guess": repr(x)} if name in self.guesses else repr(x)
            for name, x in self.initial.items()
        }
        constraints = {
            name: {"relation": relation} | self.laws.get(name, {})
            for name, relation in self.constraints.items()
        }
        document = {
            "name": "same", "parameters": self.parameters,
            "coordinates": {q: {} for q in self.coordinates},
            "definitions": self.definitions, "energy": self.energy,
            "forces": self.forces, "constraints": constraints,
            "initial": initial, "simulation": simulation,
        }  # fmt: skip
        if self.states:
            document["states"] = {s: {"rate": rate} for s, rate in self.states.items()}
        if self.tables:
            document["tables"] = self.tables
        if self.events:
            document |= {"modes": self.modes, "events": self._in_time(self.events)}
        if self.sections:
            document["output"] = {"sections": self._in_time(self.sections)}
        return yaml.safe_dump(document, sort_keys=False, width=10**6)

    def _in_time(self, asked):
        """Return events or sections in this document's times."""
        return {
            name: {**x, "every": f"({x['every']})/({self.scale!r})"}
            if "every" in x
            else x
            for name, x in asked.items()
        }

    def everywhere(self, change):
        """Return the document with all texts of the motion changed."""

        def each(texts):
            return {name: _in_all(change, text) for name, text in texts.items()}

        return replace(
            self, definitions=each(self.definitions), energy=each(self.energy),
            forces=each(self.forces), constraints=each(self.constraints),
            laws={name: each(law) for name, law in self.laws.items()},
            until=change(self.until), states=each(self.states),
            events={
                name: {key: x if key == "every" else _in_all(change, x)
                       for key, x in event.items()}
                for name, event in self.events.items()
            },
            sections={
                name: {**section, "at": change(section["at"])}
                if "at" in section
                else section
                for name, section in self.sections.items()
            },
        )  # fmt: skip


def _in_all(change, text):
    """Return a text, or each text of a list or mapping, after a change."""
    if isinstance(text, dict):
        return {name: change(x) for name, x in text.items()}
    return [change(x) for x in text] if isinstance(text, list) else change(text)


def document(given, keep=()):
    """Read a model's text, or its document, without parts that only outputs need.

    keep : names that are kept all the same
    """
    # BaseLoader keeps all scalars text.
    raw = yaml.load(given, Loader=yaml.BaseLoader) if isinstance(given, str) else given  # noqa: S506
    parameters = _texts(raw.get("parameters"), "value")
    values: dict[str, sp.Expr] = {"pi": sp.pi}
    for name, given in parameters.items():
        values[name] = expression(given, values.__getitem__)
    simulation = raw["simulation"]

    def number(given):
        return float(expression(given, values.__getitem__))

    initial, guesses = {}, set()
    for name, entry in raw["initial"].items():
        if isinstance(entry, dict):
            guesses.add(name)
        given = entry["guess"] if isinstance(entry, dict) else entry
        values[name] = expression(given, values.__getitem__)
        initial[name] = float(values[name])
    for q in raw["coordinates"]:
        initial.setdefault(f"{q}_dot", 0.0)
    energy, forces = raw["energy"], raw.get("forces") or {}
    constraints = _texts(raw.get("constraints"), "relation")
    laws = {
        name: {k: text for k, text in entry.items() if k in LAWS}
        for name, entry in (raw.get("constraints") or {}).items()
        if isinstance(entry, dict)
    }
    states = _texts(raw.get("states"), "rate")
    used = [*keep, *energy.values(), *forces, *forces.values(), *states.values()]
    for text in (
        *constraints.values(),
        *(x for law in laws.values() for x in law.values()),
    ):
        several = text.values() if isinstance(text, dict) else text
        used += [text] if isinstance(text, str) else several
    used.append(simulation.get("until", ""))
    modes, events = raw.get("modes") or {}, raw.get("events") or {}
    for event in events.values():
        given = event.get("impulse", {})
        used += [event.get("at", ""), *event.get("set", {}).values()]
        used += [*given, *given.values()]
    sections = {
        name: {key: x for key, x in section.items() if key != "plot"}
        for name, section in (raw.get("output") or {}).get("sections", {}).items()
    }
    used += [section.get("at", "") for section in sections.values()]
    duration = number(simulation["duration"])
    asked = ("method", "rtol", "step", "formulation")
    kept = {k: v for k, v in simulation.items() if k in asked}
    return Document(
        parameters, tuple(raw["coordinates"]),
        _needed(_texts(raw.get("definitions"), "value"), used),
        energy, forces, constraints, initial, frozenset(guesses),
        number(simulation.get("start", "0")), duration,
        number(simulation.get("output_step", repr(duration / 1000))),
        simulation.get("until", ""), laws, kept, states=states, modes=modes,
        events=events, tables=raw.get("tables") or {}, sections=sections,
    )  # fmt: skip


def _texts(mapping, key):
    entries = (mapping or {}).items()
    return {k: v[key] if isinstance(v, dict) else v for k, v in entries}


def _needed(definitions, used):
    """Return the definitions that the motion needs, by name or by rate."""
    names: set[str] = set()
    pending = list(used)
    while pending:
        words = {w.removesuffix("_dot") for w in _WORD.findall(pending.pop())}
        fresh = (words & definitions.keys()) - names
        names |= fresh
        pending += [definitions[name] for name in fresh]
    return {k: v for k, v in definitions.items() if k in names}


def fresh(model, name):
    """Return a name of a parameter that is not used in the model."""
    count = sum(known.startswith(f"new_{name}") for known in model.parameters)
    return f"new_{name}{count or ''}"


def replaced(model, factor=1.0, far=None, speed=None):
    """Replace q by factor*Q - far[q] - speed[q]*(t - start) for each coordinate.

    far, speed : of each coordinate, or one number for all
    """
    definitions, initial = {}, {s: model.initial[s] for s in model.states}
    L, X, V, begin = (fresh(model, name) for name in ("L", "X", "V", "t"))
    parameters = model.parameters | {L: repr(factor)}
    far, speed = (
        x if isinstance(x, dict) else dict.fromkeys(model.coordinates, x or 0.0)
        for x in (far, speed)
    )
    names: dict[tuple[str, float], str] = {}
    for letter, values in ((X, far), (V, speed)):
        for x in filter(None, dict.fromkeys(values.values())):
            names[letter, x] = f"{letter}_{len(names)}" if names else letter
    parameters |= {name: repr(x) for (_, x), name in names.items()}
    if any(speed.values()):
        parameters[begin] = repr(model.start)
    for q in model.coordinates:
        text = f"{L}*{q}_new"
        text += f" - {names[X, far[q]]}" if far[q] else ""
        text += f" - {names[V, speed[q]]}*(t - {begin})" if speed[q] else ""
        definitions[q] = text
        initial[f"{q}_new"] = (model.initial[q] + far[q]) / factor
        initial[f"{q}_new_dot"] = (model.initial[f"{q}_dot"] + speed[q]) / factor
    return replace(
        model, parameters=parameters,
        coordinates=tuple(f"{q}_new" for q in model.coordinates),
        definitions=definitions | model.definitions, initial=initial,
        guesses=frozenset(_new(name) for name in model.guesses),
    )  # fmt: skip


def _new(name):
    if name.endswith("_dot"):
        return name.removesuffix("_dot") + "_new_dot"
    return name + "_new"


def _with_impulses(events, factor):
    """Return events with impulses multiplied by a factor, a text."""
    return {
        name: {
            key: {on: f"{factor}*({x})" for on, x in value.items()}
            if key == "impulse"
            else value
            for key, value in event.items()
        }
        for name, event in events.items()
    }


def seconds(model, factor):
    """Count time in units of `factor`."""
    changed = model.everywhere(
        lambda text: _T.sub(f"(t*{factor!r})", _RATE.sub(rf"(\1/{factor!r})", text))
    )
    energy = dict(changed.energy)
    if "dissipation" in energy:  # a power: its derivative is a force per new speed
        energy["dissipation"] = f"{factor!r}*({energy['dissipation']})"
    initial = {
        name: x * factor if name.endswith("_dot") else x
        for name, x in model.initial.items()
    }
    # Slips are in metres per new second, as the gaps are in metres; what a limit is to
    # hold up against is a force, and its relation a speed.
    laws = {
        name: {
            k: _in_all(lambda text: f"{factor!r}*({text})", x)
            if k in ("slip", "limit")
            else x
            for k, x in law.items()
        }
        for name, law in changed.laws.items()
    }
    states = {s: f"{factor!r}*({rate})" for s, rate in changed.states.items()}
    settings = dict(changed.settings)
    if "step" in settings:
        settings["step"] = f"({settings['step']})/{factor!r}"
    return replace(
        changed, energy=energy, laws=laws, initial=initial, settings=settings,
        states=states, events=_with_impulses(changed.events, f"1/{factor!r}"),
        start=model.start / factor,
        duration=model.duration / factor, output_step=model.output_step / factor,
        scale=model.scale * factor, shift=model.shift / factor,
    )  # fmt: skip


def kilograms(model, factor):
    """Count masses, and so energies, forces and impulses, in units of 1/factor."""

    unit = fresh(model, "M")

    def heavier(texts):
        return {name: f"{unit}*({text})" for name, text in texts.items()}

    laws = {
        name: {
            k: _in_all(lambda text: f"{unit}*({text})", x) if k == "limit" else x
            for k, x in law.items()
        }
        for name, law in model.laws.items()
    }
    return replace(
        model, parameters=model.parameters | {unit: repr(factor)},
        energy=heavier(model.energy), forces=heavier(model.forces), laws=laws,
        events=_with_impulses(model.events, unit),
    )  # fmt: skip


def with_bystander(model, mass, place, speed):
    """Add a body that no contact or force joins to the others."""
    energy = dict(model.energy)
    key = "lagrangian" if "lagrangian" in energy else "kinetic"
    m = fresh(model, "m")
    q = m.replace("new_m", "bystander")
    energy[key] = f"{energy[key]} + {m}*{q}_dot^2/2"
    return replace(
        model, parameters=model.parameters | {m: repr(mass)},
        coordinates=(*model.coordinates, q), energy=energy,
        initial=model.initial | {q: place, f"{q}_dot": speed},
    )  # fmt: skip


def reordered(model):
    """Return the model with its coordinates and constraints in reversed order."""
    return replace(
        model, coordinates=model.coordinates[::-1],
        constraints=dict(reversed(model.constraints.items())),
    )  # fmt: skip


def later(model, by):
    """Return the model with a later start, and t - `by` in place of t in all texts."""
    changed = model.everywhere(lambda text: _T.sub(f"(t - {by!r})", text))
    return replace(changed, start=model.start + by, shift=model.shift + by)
