"""A derivation as JSON: expressions in the model file's own language."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.show.content import ASCII, conditions, when
from lagsim.show.names import Name
from lagsim.show.printers import exact_printer
from lagsim.version import __version__

if TYPE_CHECKING:
    from lagsim.show.content import Condition, Content, Gauss


def as_json(c: Content) -> dict[str, Any]:
    """Give the document; see docs/derive.md."""
    x, write = c.translation, exact_printer(c.translation)

    def written(part: Any) -> Any:
        """Write all expressions in a part of the document."""
        if isinstance(part, dict):
            return {key: written(value) for key, value in part.items()}
        if isinstance(part, list | tuple):
            return [written(value) for value in part]
        return part if part is None or isinstance(part, str | float) else write(part)

    def constraint(k: Condition, multiplier: Any) -> dict[str, Any]:
        law = k.law
        return {
            "name": k.name,
            "kind": k.kind,
            "function": k.function,
            "rate": k.rate,
            "acceleration": k.acceleration,
            "A": k.A,
            "b": k.b,
            "restitution": law.get("restitution"),
            "friction": law.get("friction"),
            "static_friction": law.get("static"),
            "slip": law.get("slip", ()),
            "limit": law.get("limit"),
            "when": when(law["when"], write) if "when" in law else None,
            "conditions": conditions(k, write, multiplier, ("function", "rate"), ASCII),
        }

    def gauss(principle: Gauss) -> dict[str, Any]:
        names = (write.names.show(Name(q.name, 0, "unconstrained")) for q in x.q)
        a = principle.a or (None,) * len(x.q)
        values = {"G": principle.G, "K": principle.K, "Qc": principle.Qc}
        return {"a": dict(zip(names, a, strict=True)), **values}

    model, solved = x.equations.model, c.solution
    document = {
        "lagsim": __version__,
        "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
        "parameters": {p.name: p.value for p in model.parameters},
        "coordinates": [q.name for q in x.q],
        "definitions": {k.name: k.value for k in x.kept},
        "kinetic": c.kinetic,
        "potential": c.potential,
        "lagrangian": c.lagrangian,
        "dissipation": c.dissipation,
        "forces": [
            {
                "on": force.on,
                "force": force.force,
                "direction": force.direction,
                "level": "velocity" if force.velocity else "position",
                "Q": force.shares,
            }
            for force in c.forces
        ],
        "equations": [
            {
                "coordinate": line.coordinate,
                "momentum": line.momentum,
                **line.terms,
                "left": line.left,
                "right": line.right,
            }
            for line in c.lines
        ],
        "M": c.M,
        "f": c.f,
        "constraints": list(map(constraint, c.constraints, x.multipliers)),
        "accelerations": solved
        and {
            "steps": {s.name: e for s, e in solved.steps},
            "q_ddot": solved.accelerations,
            "lambda": solved.multipliers,
        },
        "conserved": [
            {
                "kind": k.kind,
                "of": k.of,
                "expression": k.value,
                "definition": k.definition or None,
            }
            for k in c.conserved
        ],
        "gauss": c.gauss and gauss(c.gauss),
        "notes": c.notes,
    }
    found: dict[str, Any] = written(document)
    return found
