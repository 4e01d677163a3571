"""A model as `load` gives it: its texts, its accelerations, its equations."""

from __future__ import annotations

import contextlib
from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from lagsim.api import in_python, number_or_text, numbers, uncollected
from lagsim.errors import LagsimError
from lagsim.language.evaluate import evaluate_rows
from lagsim.language.names import rate_of
from lagsim.mechanics.algebra import Metric
from lagsim.mechanics.equations import Equations
from lagsim.mechanics.equations import derive as _derived
from lagsim.model.model import Model as Read
from lagsim.model.reader import TEXT, read, read_file
from lagsim.outputs.notebook import block, heading, listed, page, paragraph, table
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from lagsim.language.arrays import Floats
    from lagsim.show import Content


Numbers: TypeAlias = "Sequence[float] | Sequence[Sequence[float]] | Floats"


class Motion(NamedTuple):
    """Accelerations, multipliers and rates of the first-order states at a state.

    Attributes
    ----------
    accelerations : ndarray, shape (n,) or (k, n)
    multipliers : ndarray, shape (m,) or (k, m)
        Of the constraints, in their order.
    rates : ndarray, shape (l,) or (k, l)
        Of the first-order states, in their order.
    """

    accelerations: Floats
    multipliers: Floats
    rates: Floats


class Accelerations:
    """The accelerations as a function of time, coordinates and velocities.

    `rhs(t, q, q_dot)` gives q'' (n,), in the order of `model.coordinates`. With several
    states, q and q_dot of shape (k, n) and t a number or (k,), it gives (k, n). A model
    with first-order states takes their values, too: `rhs(t, q, q_dot, s)`, s (l,) or
    (k, l) in the order of `model.states`. Constraints act by their multipliers; nothing
    pulls a state back that does not meet them. Forces are evaluated as they are
    written: `sign(0)` is 0.

    Raises
    ------
    ValueError
        Where a shape does not fit.
    """

    def __init__(self, model: Read) -> None:
        e = _derived(model, chained=False)
        if e.laws:
            names = dict.fromkeys(f"`{law.name}`" for law in e.laws)
            text = f"{model.name} has no accelerations as a function of the state: "
            text += f"{', '.join(names)} act{'s' * (len(names) == 1)} at times, "
            text += "and when depends on what happened before"
            raise LagsimError(text)
        self._equations, self._name = e, model.name
        self._numbers = model.parameter_values
        entries = dict(e.mass_entries)
        for r, row in enumerate(e.rows, len(e.q)):
            entries |= {(r, i): node for i, node in row.A.entries.items()}
        self._places = np.array([*entries], int).reshape(-1, 2).T
        self._nodes = [*entries.values()]
        self._nodes += [*e.f, *(row.b for row in e.rows)]
        self._first = [s.name for s in e.states]
        self._nodes += [s.rate for s in e.states]

    def __call__(
        self, t: float | Floats, q: Numbers, q_dot: Numbers, s: Numbers = ()
    ) -> Floats:
        """Return q'' (n,) or (k, n)."""
        return self.motion(t, q, q_dot, s).accelerations

    def motion(
        self, t: float | Floats, q: Numbers, q_dot: Numbers, s: Numbers = ()
    ) -> Motion:
        """Return the accelerations, the multipliers and the rates of the states."""
        e, first = self._equations, self._first
        x, v = self._states("q", q, e.q), self._states("q_dot", q_dot, e.q)
        z = self._states("s", s, first) if first else np.empty((*x.shape[:-1], 0))
        for name, other in (("q_dot", v), ("s", z)):
            if other.shape[:-1] != x.shape[:-1]:
                text = f"q has the shape {x.shape} and {name} {other.shape}: "
                raise ValueError(f"{text}they must belong to the same states")
        try:
            times = np.broadcast_to(numbers("t", t), x.shape[:-1])
        except ValueError:
            text = f"t has the shape {np.shape(t)}: a number"
            text += f" or the shape {x.shape[:-1]} is expected"
            raise ValueError(text) from None
        state = np.concatenate([x, v, z], axis=-1)
        found = self._solved(times.reshape(-1), state.reshape(times.size, len(e.state)))
        parts = np.split(found, [len(e.q), len(e.q) + len(e.rows)], axis=1)
        return Motion(*(a.reshape(*x.shape[:-1], a.shape[1]) for a in parts))

    def _states(self, name: str, given: Numbers, of: Sequence[str]) -> Floats:
        x = numbers(name, given)
        if x.ndim == 0 or x.shape[-1] != len(of):
            text = f"{name} has the shape {x.shape}: the last number must be {len(of)}"
            raise ValueError(f"{text}, one for each of {', '.join(of)}")
        return x

    def _solved(self, t: Floats, state: Floats) -> Floats:
        """Solve M q'' - A^T lambda = f, A q'' = b: q'', lambda, s' (k, n + m + l).

        nan where q'' does not follow from them, as without inertia.
        """
        e, k, (i, j) = self._equations, len(t), self._places
        n, size = len(e.q), len(e.q) + len(e.rows)
        values: dict[str, float | Floats] = {**self._numbers, "t": t}
        values |= dict(zip(e.state, state.T, strict=True))
        rows = evaluate_rows(e.graph, self._nodes, values, k).T
        K, found = np.zeros((k, size, n)), rows[:, len(i) :].copy()
        K[:, i, j] = rows[:, : len(i)]
        f, b = found[:, :n].copy(), found[:, n:size].copy()
        found[:, :size] = np.nan
        for row in np.flatnonzero(np.isfinite(rows).all(axis=1)):
            with contextlib.suppress(np.linalg.LinAlgError):
                metric = Metric(K[row, :n], K[row, n:])
                found[row, :size] = np.concatenate(metric.motion(f[row], b[row]))
        return found

    def __repr__(self) -> str:
        takes = "t, q, q_dot" + (", s" if self._first else "")
        lines = [("takes", takes), ("gives", "q''"), ("q", listed(self._equations.q))]
        lines += [("s", listed(self._first))] if self._first else []
        return block(f"Accelerations of {self._name}", lines)


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
    states : tuple of State
        The first-order states: each has name, unit, description.
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
        """Return the model with other values of parameters, or start values.

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
        given = {**(parameters or {}), **(initial or {}), **values}
        for name, value in given.items():
            number_or_text(name, value)
        starts = {x.name for x in self.initial}
        starts |= {rate_of(d.name, k) for d in self.definitions for k in (0, 1)}
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
        return Accelerations(self)

    def __repr__(self) -> str:
        named = [_unit(c.name, c.unit, "({})") for c in self.coordinates]
        values = [_unit(f"{p.name} = {p.value:.6g}", p.unit) for p in self.parameters]
        start = [f"{x.name} = {x.value:.6g}" for x in self.initial]
        lines = [
            ("coordinates", listed(named)),
            *([("states", listed([s.name for s in self.states]))] * bool(self.states)),
            ("parameters", listed(values)),
            ("constraints", listed([c.name for c in self.constraints])),
            ("start", listed(start)),
        ]
        return block(f"Model {self.name}", lines)

    def _repr_html_(self) -> str:
        start = {x.name: f"{x.value:.6g}" for x in self.initial}
        coordinates = [
            (c.name, start[c.name], start.get(rate_of(c.name), ""), c.unit,
             c.description) for c in self.variables
        ]  # fmt: skip
        values = [
            (p.name, f"{p.value:.6g}", p.unit, p.description) for p in self.parameters
        ]
        rows = [(c.name, c.relation.text, c.description) for c in self.constraints]
        return page(
            heading(self.name),
            paragraph(self.description),
            table(coordinates, ("coordinate", "at the start", "its rate", "unit", "")),
            table(values, ("parameter", "value", "unit", "")),
            table(rows, ("constraint", "", "")),
        )


def model_of(source: Read | str | Path) -> Model:
    """Return a model from what may denote one: itself, a path or a text.

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
        text = str(source)
        source = read(text, TEXT) if "\n" in text else read_file(text)
    if not isinstance(source, Read):
        text = "a model is what `lagsim.load` gives, a path, or the text of a file; "
        raise TypeError(f"{text}this is {source!r:.60}")
    return Model(**{x.name: getattr(source, x.name) for x in fields(Read)})


def _unit(text: str, unit: str, form: str = "{}") -> str:
    return f"{text} {form.format(unit)}" if unit else text


def load(source: str | Path, **values: float | str) -> Model:
    """Read a model.

    Parameters
    ----------
    source
        A path, or the text of a model file: a string with a line break in it.
    **values
        Numbers, or expressions, instead of those of parameters or of start values, see
        `Model.bind`.

    Raises
    ------
    InputError
        With every fault, each with file, line, column, code, text and hint.
    """
    with uncollected():
        model = model_of(source)
    return model.bind(**values) if values else model


# --- Equations, to read, to print and to compute with


class Derivation:
    """The equations of a model, in each format of `lagsim derive`.

    Made when they are asked for, or refused by an InputError where they are too long. A
    notebook shows them typeset.
    """

    def __init__(self, model: Read, options: dict[str, bool]) -> None:
        self._model, self._options = model, options

    @cached_property
    def _equations(self) -> Equations:
        """Those of matrices that are written out."""
        return _derived(self._model, chained=False)

    @cached_property
    def _content(self) -> Content:
        """What people read: of large models no matrices, unless they are needed."""
        from lagsim.show import has_many_rows
        from lagsim.show.lagrange import content

        needs = any(self._options[key] for key in ("solve", "with_gauss", "expand"))
        if needs or not has_many_rows(self._model):
            return content(self._equations, **self._options, matrices=False)
        return content(_derived(self._model), **self._options, matrices=False)

    @cached_property
    def text(self) -> str:
        """Text for a terminal."""
        return self.as_text()

    def as_text(self, *, ascii_only: bool = False) -> str:
        """Return text for a terminal; in ASCII, as in model files, if so asked."""
        from lagsim.show.text import as_text

        return as_text(self._content, ascii_only=ascii_only)

    @cached_property
    def latex(self) -> str:
        """A document that LaTeX compiles."""
        from lagsim.show.latex import as_latex

        return as_latex(self._content)

    @cached_property
    def markdown(self) -> str:
        """Text with formulas, as notebooks typeset them."""
        from lagsim.show.latex import as_markdown

        return as_markdown(self._content)

    @cached_property
    def json(self) -> dict[str, Any]:
        """The expressions, by name."""
        from lagsim.show.lagrange import content
        from lagsim.show.printers import as_json

        return as_json(content(self._equations, **self._options))

    @cached_property
    def python(self) -> str:
        """A module with mass matrix, forces and constraints, without lagsim."""
        from lagsim.show.as_python import as_python

        return as_python(self._equations, __version__)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"<Derivation of {self._model.name}>"

    def _repr_markdown_(self) -> str:
        return self.markdown


def derive(
    model: Read | str | Path,
    *,
    substitute: bool = False,
    solve: bool = False,
    gauss: bool = False,
    expand: bool = False,
) -> Derivation:
    """Derive the equations of motion of a model.

    Parameters
    ----------
    model
        What `load` gives, a path, or the text of a model file.
    substitute
        Put the numbers of the parameters in.
    solve
        Give the accelerations in closed form, however long.
    gauss
        Give Gauss's principle, too.
    expand
        Write the definitions of the file out, however long the equations are.

    Raises
    ------
    InputError
        Where the model has faults.
    """
    options = {"substitute": substitute, "solve": solve, "with_gauss": gauss}
    options["expand"] = expand
    return Derivation(model_of(model), options)
