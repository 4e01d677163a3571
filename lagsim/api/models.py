"""A model as `load` gives it: what people read of it, and its accelerations."""

from __future__ import annotations

from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING

from lagsim.model.model import Model as Read

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from lagsim.api.accelerations import Accelerations


class Model(Read):
    """A model, as `load` reads it.

    `bind` gives it with other values; `simulate`, `check`, `derive` and `sweep` take
    it, and so does every one of them a path or a text instead.

    Attributes
    ----------
    name, description, source, file : str
    parameters : tuple of Parameter
        Each has name, value, unit, description.
    coordinates : tuple of Coordinate
        Each has name, unit, description.
    definitions, constraints, forces : tuple
    initial : tuple of InitialValue
        Each has name and value, among others.
    """

    def bind(
        self,
        parameters: Mapping[str, float | str] | None = None,
        initial: Mapping[str, float | str] | None = None,
        /,
        **values: float | str,
    ) -> Model:
        """Give the model with other values of parameters, or start values.

        Parameters and start values that are expressions of others follow them.

        Parameters
        ----------
        parameters, initial
            Numbers, or expressions, that replace those of the file, by their names.
        **values
            The same, of whichever has the name: `model.bind(m=2, theta=0.1)`.

        Raises
        ------
        InputError
            Where there is no such name, or its value cannot be used.
        """
        from lagsim.api.words import in_python, number_or_text

        given = {**(parameters or {}), **(initial or {}), **values}
        for name, value in given.items():
            number_or_text(name, value)
        starts = {x.name for x in self.initial}
        starts |= {d.name + rate for d in self.definitions for rate in ("", "_dot")}
        begun = {name: x for name, x in given.items() if name in starts}
        others = {name: x for name, x in given.items() if name not in starts}
        with in_python():
            bound = super().bind(others, begun)
        return model_of(bound)

    @cached_property
    def rhs(self) -> Accelerations:
        """The accelerations as a function: `model.rhs(t, q, q_dot)` gives q''.

        Raises
        ------
        LagsimError
            Where the accelerations depend on what happened before: with contacts, say.
        """
        from lagsim.api.accelerations import Accelerations

        return Accelerations(self)

    def __repr__(self) -> str:
        from lagsim.outputs.notebook import block, listed

        named = [_unit(c.name, c.unit, "({})") for c in self.coordinates]
        values = [_unit(f"{p.name} = {p.value:.6g}", p.unit) for p in self.parameters]
        start = [f"{x.name} = {x.value:.6g}" for x in self.initial]
        lines = [
            ("coordinates", listed(named)),
            ("parameters", listed(values)),
            ("constraints", listed([c.name for c in self.constraints])),
            ("start", listed(start)),
        ]
        return block(f"Model {self.name}", lines)

    def _repr_html_(self) -> str:
        from lagsim.outputs.notebook import heading, paragraph, table

        start = {x.name: f"{x.value:.6g}" for x in self.initial}
        coordinates = [
            (c.name, start[c.name], start[f"{c.name}_dot"], c.unit, c.description)
            for c in self.coordinates
        ]
        head = ("coordinate", "at the start", "its rate", "unit", "")
        parts = [heading(self.name), paragraph(self.description)]
        parts.append(table(coordinates, head))
        if self.parameters:
            values = [
                (p.name, f"{p.value:.6g}", p.unit, p.description)
                for p in self.parameters
            ]
            parts.append(table(values, ("parameter", "value", "unit", "")))
        if self.constraints:
            rows = [(c.name, c.relation.text, c.description) for c in self.constraints]
            parts.append(table(rows, ("constraint", "", "")))
        return "\n".join(part for part in parts if part)


def model_of(source: Read | str | Path) -> Model:
    """Give a model from what may be said for one: itself, a path or a text.

    Raises
    ------
    InputError
        With every fault of the file.
    TypeError
        Where it is none of these.
    """
    from pathlib import Path

    if isinstance(source, Model):
        return source
    if isinstance(source, (str, Path)):
        from lagsim.model.reader import TEXT, read, read_file

        text = str(source)
        source = read(text, TEXT) if "\n" in text else read_file(text)
    if not isinstance(source, Read):
        text = "a model is what `lagsim.load` gives, a path, or the text of a file; "
        raise TypeError(f"{text}this is {source!r:.60}")
    return Model(**{x.name: getattr(source, x.name) for x in fields(Read)})


def _unit(text: str, unit: str, form: str = "{}") -> str:
    return f"{text} {form.format(unit)}" if unit else text
