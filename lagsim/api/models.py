"""Model of the Python interface, with its accelerations and derived equations."""

from __future__ import annotations

import contextlib
from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from lagsim.api import float_array, in_python, number_or_text, uncollected
from lagsim.errors import LagsimError
from lagsim.language.evaluate import evaluate_rows
from lagsim.language.names import rate_of
from lagsim.mechanics.algebra import Metric
from lagsim.mechanics.derivation import derive as _derived
from lagsim.mechanics.derivation import may_gather
from lagsim.model.model import Model as Read
from lagsim.model.reader import TEXT, read, read_file
from lagsim.outputs.notebook import (
    heading,
    html_table,
    paragraph,
    paragraphs,
    short_list,
    text_block,
)
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from lagsim.api.exploring import Exploration
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.show import Content


Numbers: TypeAlias = "Sequence[float] | Sequence[Sequence[float]] | Floats"


class Motion(NamedTuple):
    """Accelerations, multipliers and rates of first-order states at one or k states.

    Attributes
    ----------
    accelerations : ndarray, shape (n,) or (k, n)
    multipliers : ndarray, shape (m,) or (k, m)
        One for each constraint row, in the order of the file.
    rates : ndarray, shape (l,) or (k, l)
        Of the first-order states, in the order of `model.states`.
    """

    accelerations: Floats
    multipliers: Floats
    rates: Floats


class Accelerations:
    """The accelerations q'' as a function of time, coordinates and velocities.

    `rhs(t, q, q_dot)` returns q'' of shape (n,) for q and q_dot of shape (n,), in the
    order of `model.coordinates`. For k states, q and q_dot have shape (k, n), t is a
    number or has shape (k,), and q'' has shape (k, n). The values of first-order
    states are a fourth argument, `rhs(t, q, q_dot, s)`, with s of shape (l,) or (k, l)
    in the order of `model.states`. Constraints act by their multipliers; a state that
    violates a constraint is not corrected. Forces are evaluated as they are written:
    `sign(0)` is 0.

    Raises
    ------
    ValueError
        If the shape of an argument does not fit.
    """

    def __init__(self, model: Read) -> None:
        model = model.written_out()
        e = _derived(model, chained=False)
        if e.laws:
            names = dict.fromkeys(f"`{law.name}`" for law in e.laws)
            text = f"{model.name} has no accelerations as a function of the state: "
            text += f"{', '.join(names)} act{'s' * (len(names) == 1)} at times, "
            text += "and when depends on the motion before"
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
        """Return q'', shape (n,) or (k, n)."""
        return self.motion(t, q, q_dot, s).accelerations

    def motion(
        self, t: float | Floats, q: Numbers, q_dot: Numbers, s: Numbers = ()
    ) -> Motion:
        """Return accelerations, multipliers and rates of first-order states.

        Parameters
        ----------
        t : float or ndarray, shape (k,)
        q, q_dot : ndarray, shape (n,) or (k, n)
            In the order of `model.coordinates`.
        s : ndarray, shape (l,) or (k, l)
            Values of first-order states, in the order of `model.states`.
        """
        e, first = self._equations, self._first
        x, v = self._states("q", q, e.q), self._states("q_dot", q_dot, e.q)
        z = self._states("s", s, first) if first else np.empty((*x.shape[:-1], 0))
        for name, other in (("q_dot", v), ("s", z)):
            if other.shape[:-1] != x.shape[:-1]:
                text = f"q has the shape {x.shape} and {name} {other.shape}: "
                raise ValueError(f"{text}they must belong to the same states")
        try:
            times = np.broadcast_to(float_array("t", t), x.shape[:-1])
        except ValueError:
            text = f"t has the shape {np.shape(t)}: a number"
            text += f" or the shape {x.shape[:-1]} is expected"
            raise ValueError(text) from None
        state = np.concatenate([x, v, z], axis=-1)
        found = self._solved(times.reshape(-1), state.reshape(times.size, len(e.state)))
        parts = np.split(found, [len(e.q), len(e.q) + len(e.rows)], axis=1)
        return Motion(*(a.reshape(*x.shape[:-1], a.shape[1]) for a in parts))

    def _states(self, name: str, given: Numbers, of: Sequence[str]) -> Floats:
        x = float_array(name, given)
        if x.ndim == 0 or x.shape[-1] != len(of):
            text = f"{name} has the shape {x.shape}: the last number must be {len(of)}"
            raise ValueError(f"{text}, one for each of {', '.join(of)}")
        return x

    def _solved(self, t: Floats, state: Floats) -> Floats:
        """Solve M q'' - A^T lambda = f, A q'' = b at k states.

        M is the mass matrix, f has the generalized forces, and A and b have the
        constraint rows and their right-hand sides.

        Parameters
        ----------
        t : ndarray, shape (k,)
        state : ndarray, shape (k, 2 n + l)
            Coordinates, velocities and first-order states.

        Returns
        -------
        ndarray, shape (k, n + m + l)
            q'', lambda and s'; q'' and lambda are nan where the two equations do not
            determine q'', as without inertia.
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
        lines = [
            ("takes", takes),
            ("gives", "q''"),
            ("q", short_list(self._equations.q)),
        ]
        lines += [("s", short_list(self._first))] if self._first else []
        return text_block(f"Accelerations of {self._name}", lines)


class Model(Read):
    """Model of a mechanical system, read by `load`.

    A model is an argument of `simulate`, `check`, `derive` and `sweep`, and `bind`
    returns it with other values of its parameters and start values.

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

    Examples
    --------
    >>> import lagsim
    >>> model = lagsim.load('''
    ... name: drop
    ... parameters: {m: 2, g: 9.81}
    ... coordinates: {y: {}}
    ... energy: {kinetic: m*y_dot^2/2, potential: m*g*y}
    ... initial: {y: 1, y_dot: 0}
    ... simulation: {duration: 0.5}
    ... ''')
    >>> model.name, [(p.name, p.value) for p in model.parameters]
    ('drop', [('m', 2.0), ('g', 9.81)])
    >>> model.rhs(0.0, [1.0], [0.0])
    array([-9.81])
    """

    def bind(
        self,
        parameters: Mapping[str, float | str] | None = None,
        initial: Mapping[str, float | str] | None = None,
        /,
        **values: float | str,
    ) -> Model:
        """Return the model with other values of parameters or start values.

        Parameters and start values that are expressions of a replaced name are
        evaluated with its new value.

        Parameters
        ----------
        parameters, initial : mapping, optional
            Numbers or expressions by the name of a parameter or of an entry of
            `initial`. They replace the values of the file.
        **values : float or str
            Numbers or expressions by the name of either kind:
            `model.bind(m=2, theta=0.1)`.

        Raises
        ------
        InputError
            If there is no such name, or its value cannot be used.

        Examples
        --------
        >>> import lagsim
        >>> model = lagsim.load('''
        ... parameters: {k: 4}
        ... coordinates: {x: {}}
        ... energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
        ... initial: {x: 1/k}
        ... ''')
        >>> [start.value for start in model.bind(k=2).initial]
        [0.5, 0.0]
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
        """The accelerations as a function: `model.rhs(t, q, q_dot)` returns q''.

        Raises
        ------
        LagsimError
            If the accelerations depend on the motion before, as with contacts.
        """
        return Accelerations(self)

    def explore(
        self,
        vary: Iterable[str] | Mapping[str, tuple[float, float] | None] = (),
        *,
        height: int = 900,
    ) -> Exploration:
        """Return a page with sliders on which the motion follows the values.

        A notebook shows the page at the end of a cell; it computes the motions itself.
        Where the model has events, contacts, switches or tables, a server in this
        process computes them, and the notebook shows its address on this machine.

        Parameters
        ----------
        vary : sequence of str, or mapping of str to (float, float) or None
            Names with a slider, and the ends of the sliders; by default all plain
            parameters and all start values, as of `lagsim explore`.
        height : int
            The height of the page in a notebook, in pixels.

        Raises
        ------
        InputError
            If there is no such name, or a value cannot be used.
        LagsimError
            If the start is not admissible.
        """
        from lagsim.api.exploring import explored

        return explored(self, vary, height)

    def __repr__(self) -> str:
        named = [_unit(c.name, c.unit, "({})") for c in self.coordinates]
        values = [_unit(f"{p.name} = {p.value:.6g}", p.unit) for p in self.parameters]
        start = [f"{x.name} = {x.value:.6g}" for x in self.initial]
        lines = [
            ("coordinates", short_list(named)),
            *(
                [("states", short_list([s.name for s in self.states]))]
                * bool(self.states)
            ),
            ("parameters", short_list(values)),
            ("constraints", short_list([c.name for c in self.constraints])),
            ("start", short_list(start)),
        ]
        return text_block(f"Model {self.name}", lines)

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
        return paragraphs(
            heading(self.name),
            paragraph(self.description),
            html_table(
                coordinates, ("coordinate", "at the start", "its rate", "unit", "")
            ),
            html_table(values, ("parameter", "value", "unit", "")),
            html_table(rows, ("constraint", "", "")),
        )


def model_of(source: Read | str | Path) -> Model:
    """Return a model from a model, the path of a model file, or the text of one.

    Raises
    ------
    InputError
        If the file has faults; the error lists all of them.
    TypeError
        If `source` is neither a model nor a path or string.
    """
    from pathlib import Path

    if isinstance(source, Model):
        return source
    if isinstance(source, (str, Path)):
        text = str(source)
        source = read(text, TEXT) if "\n" in text else read_file(text)
    if not isinstance(source, Read):
        text = "a model is a result of `lagsim.load`, a path, or the text of a file; "
        raise TypeError(f"{text}this is {source!r:.60}")
    return Model(**{x.name: getattr(source, x.name) for x in fields(Read)})


def _unit(text: str, unit: str, form: str = "{}") -> str:
    return f"{text} {form.format(unit)}" if unit else text


def load(source: str | Path, **values: float | str) -> Model:
    """Read a model from a file or from text.

    Parameters
    ----------
    source : str or Path
        The path of a model file, or the text of one: a string with a line break.
    **values : float or str
        Numbers or expressions that replace the values of parameters or of entries of
        `initial`, see `Model.bind`.

    Returns
    -------
    Model

    Raises
    ------
    InputError
        If the file has faults. `problems` lists all of them, each with file, line,
        column, code, text and hint.

    Examples
    --------
    >>> import lagsim
    >>> text = '''
    ... name: pendulum
    ... parameters: {l: 0.5, g: 9.81}
    ... coordinates: {theta: {}}
    ... energy: {kinetic: l^2*theta_dot^2/2, potential: -g*l*cos(theta)}
    ... initial: {theta: 0.1}
    ... '''
    >>> pendulum = lagsim.load(text, l=2)
    >>> [(p.name, p.value) for p in pendulum.parameters]
    [('l', 2.0), ('g', 9.81)]
    >>> try:
    ...     lagsim.load(text.replace("cos(theta)", "cos(thta)"))
    ... except lagsim.InputError as error:
    ...     [(fault.line, fault.column, fault.code) for fault in error.problems]
    [(5, 58, 'unknown-name')]
    """
    with uncollected():
        model = model_of(source)
    return model.bind(**values) if values else model


# --- Equations: to read, to print, and to compute with


class Derivation:
    """The equations of motion of a model, in each format of `lagsim derive`.

    Each format is derived at the first access of its attribute. An InputError is
    raised if the equations are too long for the format. A notebook shows the
    equations typeset.

    Examples
    --------
    >>> import lagsim
    >>> model = lagsim.load('''
    ... name: drop
    ... parameters: {m: 2, g: 9.81}
    ... coordinates: {y: {}}
    ... energy: {kinetic: m*y_dot^2/2, potential: m*g*y}
    ... initial: {y: 1, y_dot: 0}
    ... simulation: {duration: 0.5}
    ... ''')
    >>> equations = lagsim.derive(model)
    >>> equations
    <Derivation of drop>
    >>> equations.as_text(ascii_only=True).splitlines()[-8:-5]
    ['Accelerations', '-------------', '  y_ddot = -g']
    """

    def __init__(self, model: Read, options: dict[str, bool]) -> None:
        needs = any(options[key] for key in ("with_gauss", "expand"))
        written = needs or not may_gather(model)
        self._model = model.written_out() if written else model
        self._options = options

    @cached_property
    def _equations(self) -> Equations:
        """The equations, with each matrix entry as one expression."""
        return _derived(self._model, chained=False, gathers=True)

    @cached_property
    def _content(self) -> Content:
        """The derivation as data, from which each format is written.

        The matrices of large models are left out unless an option needs them.
        """
        from lagsim.show import has_many_rows
        from lagsim.show.lagrange import derived

        needs = any(self._options[key] for key in ("solve", "with_gauss", "expand"))
        if needs or not has_many_rows(self._model):
            return derived(self._equations, **self._options, matrices=False)
        return derived(
            _derived(self._model, trees=False, gathers=True),
            **self._options,
            matrices=False,
        )

    @cached_property
    def text(self) -> str:
        """The equations as text for a terminal."""
        return self.as_text()

    def as_text(self, *, ascii_only: bool = False) -> str:
        """Return the equations as text for a terminal.

        Parameters
        ----------
        ascii_only : bool
            Write names and operators as in model files, without Greek letters.
        """
        from lagsim.show.text import as_text

        return as_text(self._content, ascii_only=ascii_only)

    @cached_property
    def latex(self) -> str:
        """The equations as a LaTeX document."""
        from lagsim.show.latex import as_latex

        return as_latex(self._content)

    @cached_property
    def markdown(self) -> str:
        """The equations as Markdown with formulas, as notebooks typeset them."""
        from lagsim.show.latex import as_markdown

        return as_markdown(self._content)

    @cached_property
    def json(self) -> dict[str, Any]:
        """The expressions by name, as in `lagsim derive --format json`."""
        from lagsim.show.lagrange import derived
        from lagsim.show.printers import as_json

        return as_json(derived(self._equations, **self._options))

    @cached_property
    def python(self) -> str:
        """Text of a Python module with mass matrix, forces and constraints.

        The module does not import lagsim.
        """
        from lagsim.show.as_python import as_python

        return as_python(_derived(self._model, chained=False), __version__)

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
    model : Model, str or Path
        A model from `load`, the path of a model file, or the text of one: a string
        with a line break.
    substitute : bool
        Replace parameters by their numbers.
    solve : bool
        Include the accelerations in closed form, however long.
    gauss : bool
        Include the function that Gauss's principle of least constraint minimises.
    expand : bool
        Replace the definitions of the file by their expressions, however long.

    Returns
    -------
    Derivation

    Raises
    ------
    InputError
        If the model has faults.

    Examples
    --------
    >>> import lagsim
    >>> equations = lagsim.derive('''
    ... name: pendulum
    ... parameters: {l: 0.5, g: 9.81}
    ... coordinates: {theta: {}}
    ... energy: {kinetic: l^2*theta_dot^2/2, potential: -g*l*cos(theta)}
    ... initial: {theta: 0.1}
    ... ''')
    >>> equations.json["accelerations"]["q_ddot"]
    ['-g*sin(theta)/l']
    """
    options = {"substitute": substitute, "solve": solve, "with_gauss": gauss}
    options["expand"] = expand
    return Derivation(model_of(model), options)
