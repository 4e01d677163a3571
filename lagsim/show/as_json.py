"""A derivation as JSON: expressions in the model file's own language."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.show.content import ASCII, conditions, when
from lagsim.show.names import ModelNames, Name
from lagsim.show.printers import ModelPrinter
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.show.content import Condition, Content, Force, Gauss, Line


def as_json(content: Content) -> dict[str, Any]:
    """Give the document; see docs/derive.md."""
    return _Document(content).whole()


class _Document:
    def __init__(self, content: Content) -> None:
        x = content.translation
        self.c, self.x = content, x
        # All digits, so that who reads an expression computes what lagsim computes.
        self.write = ModelPrinter(x, ModelNames(x.own_names), digits=None)

    def whole(self) -> dict[str, Any]:
        c, x = self.c, self.x
        model = x.equations.model
        solved = c.solution
        return {
            "lagsim": __version__,
            "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
            "parameters": {p.name: p.value for p in model.parameters},
            "coordinates": [q.name for q in x.q],
            "definitions": {k.name: self.write(k.value) for k in x.kept},
            "kinetic": self._maybe(c.kinetic),
            "potential": self._maybe(c.potential),
            "lagrangian": self.write(c.lagrangian),
            "dissipation": self._maybe(c.dissipation),
            "forces": [self._force(f) for f in c.forces],
            "equations": [self._line(line) for line in c.lines],
            "M": [self._all(row) for row in c.M],
            "f": self._all(c.f),
            "constraints": [
                self._constraint(k, s)
                for k, s in zip(c.constraints, x.multipliers, strict=True)
            ],
            "accelerations": None
            if solved is None
            else {
                "steps": {s.name: self.write(e) for s, e in solved.steps},
                "q_ddot": self._all(solved.accelerations),
                "lambda": self._all(solved.multipliers),
            },
            "conserved": [
                {
                    "kind": k.kind,
                    "of": list(k.of),
                    "expression": self.write(k.value),
                    "definition": k.definition or None,
                }
                for k in c.conserved
            ],
            "gauss": None if c.gauss is None else self._gauss(c.gauss),
            "notes": list(c.notes),
        }

    def _all(self, parts: Iterable[Any]) -> list[str]:
        return [self.write(e) for e in parts]

    def _maybe(self, e: Any) -> str | None:
        return None if e is None else self.write(e)

    def _force(self, force: Force) -> dict[str, Any]:
        return {
            "on": force.on,
            "force": self.write(force.force),
            "direction": self.write(force.direction),
            "level": "velocity" if force.velocity else "position",
            "Q": self._all(force.shares),
        }

    def _line(self, line: Line) -> dict[str, Any]:
        return {
            "coordinate": line.coordinate,
            "momentum": self.write(line.momentum),
            **{key: self.write(e) for key, e in line.terms.items()},
            "left": self.write(line.left),
            "right": self.write(line.right),
        }

    def _constraint(self, k: Condition, multiplier: Any) -> dict[str, Any]:
        called = ("function", "rate")
        return {
            "name": k.name,
            "kind": k.kind,
            "function": self.write(k.function),
            "rate": self.write(k.rate),
            "acceleration": self.write(k.acceleration),
            "A": self._all(k.A),
            "b": self.write(k.b),
            "restitution": k.law.get("restitution"),
            "friction": self._maybe(k.law.get("friction")),
            "static_friction": self._maybe(k.law.get("static")),
            "slip": self._all(k.law.get("slip", ())),
            "limit": self._maybe(k.law.get("limit")),
            "when": when(k.law["when"], self.write) if "when" in k.law else None,
            "conditions": conditions(k, self.write, multiplier, called, ASCII),
        }

    def _gauss(self, gauss: Gauss) -> dict[str, Any]:
        show = self.write.names.show
        names = [show(Name(q.name, 0, "unconstrained")) for q in self.x.q]
        values = [None] * len(names) if gauss.a is None else self._all(gauss.a)
        return {
            "a": dict(zip(names, values, strict=True)),
            "G": self.write(gauss.G),
            "K": None if gauss.K is None else [self._all(row) for row in gauss.K],
            "Qc": None if gauss.Qc is None else self._all(gauss.Qc),
        }
