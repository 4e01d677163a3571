"""A derivation as JSON: expressions in the model file's own language."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.show import ASCII, conditions
from lagsim.show.names import Name
from lagsim.show.printers import exact_printer
from lagsim.version import __version__

if TYPE_CHECKING:
    from lagsim.show import Content


def as_json(content: Content) -> dict[str, Any]:
    """Give the document; see docs/derive.md."""
    x, found = content
    write = exact_printer(x)

    def written(part: Any) -> Any:
        """Write all expressions in a part of the document."""
        if isinstance(part, dict):
            return {key: written(value) for key, value in part.items()}
        if isinstance(part, list | tuple):
            return [written(value) for value in part]
        plain = part is None or isinstance(part, str | float | bool)
        return part if plain else write(part)

    model, gauss, called = x.equations.model, found["gauss"], ("function", "rate")
    if gauss is not None:
        names = [write.names.show(Name(q.name, 0, "unconstrained")) for q in x.q]
        a = gauss["a"] or (None,) * len(names)
        gauss = {**gauss, "a": dict(zip(names, a, strict=True))}
    document: dict[str, Any] = written({
        "lagsim": __version__,
        "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
        "parameters": {p.name: p.value for p in model.parameters},
        "coordinates": [q.name for q in x.q],
        **found,
        "constraints": [
            {**k, "conditions": conditions(k, write, multiplier, called, ASCII)}
            for k, multiplier in zip(found["constraints"], x.multipliers, strict=True)
        ],
        "gauss": gauss,
    })  # fmt: skip
    return document
