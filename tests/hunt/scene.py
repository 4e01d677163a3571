"""A scene: texts, as a model file has them, in items that can be omitted."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Law:
    """Contact, freewheel, limited equality, or equality that ends at a time.

    kind : "contact" and "wheel" mean gap >= 0, "limit" and "equality" gap = 0
    e : restitution
    mu, static : coefficients of friction while sliding and at rest
    until : the time up to which the constraint is in force
    """

    kind: str
    gap: str
    e: float = 0.0
    mu: float = 0.0
    static: float = 0.0
    slip: str = ""
    limit: str = ""
    until: float = math.inf

    def text(self):
        """Return the text of the law in a model file."""
        sign = "=" if self.kind in ("limit", "equality") else ">="
        found: dict[str, Any] = {"relation": f"{self.gap} {sign} 0"}
        if self.kind == "contact":
            found["restitution"] = self.e
        if self.kind == "limit":
            found["limit"] = self.limit
        if self.slip:
            both = {"static": self.static, "dynamic": self.mu}
            found |= {"friction": both if self.static else self.mu, "slip": self.slip}
        if self.until < math.inf:
            found["when"] = f"t < {self.until!r}"
        return json.dumps(found)


@dataclass(frozen=True)
class Item:
    """Part of a scene, kept or omitted as a whole; texts are as in model files.

    coordinates : name -> (position, velocity) at the start, floats
    parameters : name -> float
    definitions, constraints : name -> text
    kinetic, potential, dissipation : terms
    forces : (key, text)
    breaks : times at which an expression in the texts jumps
    features : (text of an argument, its width) of terms that a large step would miss
    loose : coordinates with an arbitrary start that the laws admit
    """

    tag: str
    coordinates: dict[str, tuple[float, float]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    constraints: dict[str, str] = field(default_factory=dict)
    kinetic: tuple[str, ...] = ()
    potential: tuple[str, ...] = ()
    dissipation: tuple[str, ...] = ()
    forces: tuple[tuple[str, str], ...] = ()
    breaks: tuple[float, ...] = ()
    features: tuple[tuple[str, float], ...] = ()
    laws: tuple[Law, ...] = ()
    loose: tuple[str, ...] = ()


@dataclass(frozen=True)
class Scene:
    """Items, and how long they are run.

    stated : whether velocities are stated where constraints act, or guessed
    """

    seed: str
    items: tuple[Item, ...]
    start: float
    duration: float
    output_step: float
    until: str = ""
    stated: bool = True
    settings: dict[str, str] = field(default_factory=dict)
    velocities: dict[str, float] = field(default_factory=dict)

    def gathered(self, name):
        """Return a mapping of all items: coordinates, parameters, ..."""
        return {k: v for item in self.items for k, v in getattr(item, name).items()}

    def terms(self, name):
        """Return a list of all items: kinetic, forces, ..."""
        return [term for item in self.items for term in getattr(item, name)]

    @property
    def q(self):
        return list(self.gathered("coordinates"))

    @property
    def times(self):
        """Times of the rows, both ends included."""
        end, rows, k = self.start + self.duration, [], 0
        while (t := self.start + k * self.output_step) < end - 1e-9 * self.output_step:
            rows.append(t)
            k += 1
        return [*rows, end]

    def start_velocity(self, name):
        return self.velocities.get(name, self.gathered("coordinates")[name][1])

    def text(self):
        """Write the model file."""
        lines = [f"# hunt: {self.seed}", "name: scene"]
        parameters = self.gathered("parameters")
        if parameters:
            lines += ["parameters:"]
            lines += [f"  {k}: {v!r}" for k, v in parameters.items()]
        lines += ["coordinates:", *(f"  {q}: {{}}" for q in self.q)]
        lines += _mapping("definitions", self.gathered("definitions"))
        lines += ["energy:", f"  kinetic: {_sum(self.terms('kinetic'))}"]
        lines += [f"  potential: {_sum(self.terms('potential'))}"]
        if self.terms("dissipation"):
            lines += [f"  dissipation: {_sum(self.terms('dissipation'))}"]
        forces: dict[str, list[str]] = {}
        for key, text in self.terms("forces"):
            forces.setdefault(key, []).append(text)
        lines += _mapping("forces", {k: _sum(v) for k, v in forces.items()})
        constraints = self.gathered("constraints")
        lines += _mapping("constraints", constraints)
        if laws := self.terms("laws"):
            lines += ["constraints:"]
            lines += [f"  c{k}: {law.text()}" for k, law in enumerate(laws)]
        lines += ["initial:"]
        for name, (q, _) in self.gathered("coordinates").items():
            v = self.start_velocity(name)
            free = constraints and not self.stated
            lines += [f"  {name}: {q!r}"]
            lines += [f"  {name}_dot: " + (f"{{guess: {v!r}}}" if free else repr(v))]
        lines += ["simulation:", f"  start: {self.start!r}"]
        lines += [f"  duration: {self.duration!r}"]
        lines += [f"  output_step: {self.output_step!r}"]
        lines += [f"  until: {self.until}"] if self.until else []
        lines += [f"  {k}: {v}" for k, v in self.settings.items()]
        return "\n".join(lines) + "\n"


def _sum(terms):
    return " + ".join(f"({term})" for term in terms) if terms else "0"


def _mapping(name, entries):
    if not entries:
        return []
    return [f"{name}:", *(f'  {k}: "{v}"' for k, v in entries.items())]
