"""Content of a model file: the model, and the settings of its integration.

Both are frozen and complete.

Expressions are node numbers of `Model.graph`. Its variables are named as in the model
file: `t`, a parameter, a coordinate `q`, a velocity `q_dot`, and for definitions of
output also `q_ddot`, `lambda_<c>`, `Qc_<q>` and `energy`. Expressions contain the
expressions of definitions, not their names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple, Protocol

from lagsim.language.functions import ELEMENTS
from lagsim.language.tables import called

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.language.parser import Parsed
    from lagsim.language.tables import Data
    from lagsim.model.nodes import Scalar


# Defaults of a model file.
DEFAULT_RTOL = 1e-11
DEFAULT_ROWS = 1000
# With Baumgarte's formulation, constraint residuals decrease by a factor e over this
# many rows. A fast decay is resolved like a fast motion (the elastic pendulum on its
# curve at 1e-11: 7,400 evaluations at a gain of 1, 9,600 at 5, 19,000 at 10 and 110,000
# at 50).
ROWS_TO_DECAY = 10


# Formulations of earlier versions: a file or a command that names one gets `auto`.
RETIRED_FORMULATIONS = ("apart", "ignorable")


class Settings(NamedTuple):
    """Start, end, spacing of the rows, and integration options of a run.

    A field is None where the file and the options do not set it; the properties return
    the value used then.

    Attributes
    ----------
    start, end : float
        Times; equal where no length of the run is given.
    output_step : float
        Spacing of the rows in time.
    rest : bool
        Whether the start values marked as guesses are solved for a state at rest.
    retired : tuple of (str, str)
        Keys and names of a retired method or formulation, in place of which `auto` is
        set.
    method, formulation : str
        Names, or `auto`.
    method_place, formulation_place : Place or None
        Places of these names in the file.
    rtol, atol : float or None
        Tolerances of methods with error control.
    step : float or None
        Step of fixed-step methods.
    gain : float or None
        Gain of Baumgarte's formulation, per unit of time.
    options : tuple of (str, float)
        Options of methods that are set, see `methods.options`.
    moments : tuple of float
        Further times of states, ascending, beside the rows.
    measured_from : float or None
        Time from which on the measures of a sweep count rows.
    """

    start: float = 0.0
    end: float = 0.0
    output_step: float = 1.0
    method: str = "auto"
    formulation: str = "auto"
    rtol: float | None = None
    atol: float | None = None
    step: float | None = None
    gain: float | None = None
    options: tuple[tuple[str, float], ...] = ()
    method_place: Place | None = None
    formulation_place: Place | None = None
    moments: tuple[float, ...] = ()
    rest: bool = False
    retired: tuple[tuple[str, str], ...] = ()
    measured_from: float | None = None

    @property
    def duration(self) -> float:
        """Length of the run in time; 0 where it is not given."""
        return self.end - self.start

    @property
    def tolerance(self) -> float:
        """Relative tolerance of methods with error control."""
        return DEFAULT_RTOL if self.rtol is None else self.rtol

    @property
    def fixed_step(self) -> float:
        """Step of fixed-step methods, at most the length of the run."""
        return min(self.step or self.output_step, self.duration or math.inf)

    @property
    def decay(self) -> float:
        """Rate at which Baumgarte's formulation reduces constraint residuals."""
        return self.gain or 1.0 / (ROWS_TO_DECAY * self.output_step)


class Parameter(NamedTuple):
    """Parameter of the model; an input of every compiled function.

    Attributes
    ----------
    value : float
        The value; of a mode the value at the start.
    follows : bool
        Whether the expression in the file contains other parameters.
    mode : bool
        Whether events change the value.
    uncertainty : float
        One standard deviation of the value.
    range : tuple of float, optional
        The least and the greatest value of its slider on a page.
    """

    name: str
    value: float
    unit: str = ""
    description: str = ""
    follows: bool = False
    mode: bool = False
    uncertainty: float = 0.0
    range: tuple[float, float] | None = None


class Coordinate(NamedTuple):
    """Generalized coordinate."""

    name: str
    unit: str = ""
    description: str = ""


class Level(IntEnum):
    """Quantities on which an expression depends, each level including the ones before.

    NUMBER: numbers and parameters alone. POSITION: also time, coordinates, first-order
    states and modes. VELOCITY: also velocities and rates. OUTPUT: also accelerations,
    multipliers, energies and reactions, known only with the solution.
    """

    NUMBER = 0
    POSITION = 1
    VELOCITY = 2
    OUTPUT = 3

    @property
    def text(self) -> str:
        """Description of the quantities, for messages."""
        found = "positions and time", "velocities"
        return ("numbers", *found, "accelerations, multipliers or energies")[self]


class Definition(NamedTuple):
    """Named scalar expression: its graph node, and the level of its quantities."""

    name: str
    node: int
    level: Level
    unit: str = ""
    description: str = ""


class Force(NamedTuple):
    """Generalized force or impulse p along a direction u; its power is p u' or p u.

    `on` is the coordinate or definition u that the file names; `node` and `direction`
    are the graph nodes of p and u. With `level` POSITION, u depends on positions and
    time, Q_j = p du/dq_j, and the power is p u'. With VELOCITY, u is affine in the
    velocities, Q_j = p du/dq_j', and the power is p u. `place` is that of the value in
    the file.
    """

    on: str
    node: int
    direction: int
    level: Level
    place: Place


class Relation(NamedTuple):
    """Relation of a constraint: `node` = 0 for an `equality`, else the gap `node` >= 0.

    `node` is a graph node; `text` is the relation as the file writes it. `multiple`:
    whether the file's expression has a multiple root, in place of which `node` has a
    simple one.
    """

    node: int
    equality: bool
    text: str
    place: Place
    multiple: bool = False


# Names allowed only in a friction, and only in a restitution.
SLIP_SPEED, APPROACH_SPEED = "slip_speed", "approach_speed"


class OneSided(NamedTuple):
    """Law of a one-sided relation, whose multiplier is never negative.

    `restitution` is Newton's coefficient or, with `poisson`, Poisson's; a coefficient
    that depends on the state, or on `APPROACH_SPEED`, is the graph node `bounce`
    instead. Coulomb's friction acts on the sliding velocities `slips` (graph nodes, one
    or two), with the coefficient `friction` while the contact slides and `static` while
    it sticks (graph nodes; None: no friction, or one coefficient for both). A relation
    between velocities has restitution 0 and no friction.
    """

    restitution: float
    friction: int | None = None
    slips: tuple[int, ...] = ()
    static: int | None = None
    bounce: int | None = None
    poisson: bool = False


class Constraint(NamedTuple):
    """Relation with the law of its multiplier; `law` is None for an equality.

    `limit` is the graph node of the largest |multiplier| of an equality of velocities;
    `static` is the limit while the equality holds, where it differs from the limit
    while it slides. For two equalities that share a limit, it bounds the norm of both
    multipliers, and `pair` is the index of the other equality in the list of
    constraints less the index of this one. `when` is the graph node of a condition of
    t, parameters and modes: the constraint is in force while it is not 0.
    """

    name: str
    relation: Relation
    law: OneSided | None = None
    description: str = ""
    limit: int | None = None
    when: int | None = None
    pair: int = 0
    static: int | None = None

    @property
    def called(self) -> str:
        """Name of the constraint in the file."""
        return self.name[:-2] if self.pair else self.name

    @property
    def ends(self) -> str:
        """Last letters of the names of two relations with a shared limit: `12` or `xy`.

        They are `12` for a list of relations (`.1`, `.2`), `xy` for components of a
        vector.
        """
        return "12" if self.name[-1] in "12" else "xy"

    @property
    def always(self) -> bool:
        """Whether the constraint is an equality that always holds."""
        return self.law is None and self.limit is None and self.when is None


class InitialValue(NamedTuple):
    """Start value of a coordinate, velocity, first-order state or definition.

    `error` bounds the rounding error of the value; `guess`: whether the value is a
    guess, which is solved for; `text` is the expression in the file. `node` is the
    graph node of a definition, or of its total rate, and None for other names.
    """

    name: str
    value: float
    error: float
    guess: bool
    text: str
    place: Place
    node: int | None = None


class Shape(NamedTuple):
    """Shape that is drawn and has no mechanical effect: body, ground, curve or arrow.

    Attributes
    ----------
    kind : str
        One of `SHAPES`.
    sizes : tuple of int
        Nodes that depend on parameters alone: the lengths of a body; the height of a
        ground in space; the ends of the parameter `CURVE` of a curve; the scale of an
        arrow.
    corners : tuple of tuple of int
        Nodes, in the shape's own axes, of the corners of a polygon or a ground, of
        the point on a curve, or of the vector of an arrow.
    at : tuple of int
        Nodes of the position of the shape's origin; empty for the origin of the scene.
    axes : tuple of int
        Entries of the shape's rotation matrix, 2 x 2 or 3 x 3, row by row; or empty.
    point : str
        Name of the scene's point at the shape's origin, or at a corner; or empty.
    places : tuple of Place
        Places of `sizes` in the file.
    """

    name: str
    kind: str
    sizes: tuple[int, ...] = ()
    corners: tuple[tuple[int, ...], ...] = ()
    at: tuple[int, ...] = ()
    axes: tuple[int, ...] = ()
    point: str = ""
    places: tuple[Place, ...] = ()

    @property
    def nodes(self) -> list[int]:
        """All graph nodes of the shape: sizes, corners, origin and axes."""
        corners = [node for corner in self.corners for node in corner]
        return [*self.sizes, *corners, *self.at, *self.axes]

    @property
    def dimension(self) -> int:
        """Dimension of the shape's points, 2 or 3; 3 for a body of space."""
        own = SHAPES[self.kind]
        space = own.space or (own.sizes and len(self.sizes) > min(own.sizes))
        space = space or (self.kind == "ground" and not self.corners)
        parts = max(map(len, (self.at, *self.corners)), default=0)
        return max(parts, 3 if space or len(self.axes) > 4 else 2)


class ShapeKind(NamedTuple):
    """Kind of shape: permitted numbers of sizes, keys, and whether it needs space.

    `space` : the kind exists in three dimensions only.
    """

    sizes: tuple[int, ...]
    keys: tuple[str, ...] = ("at", "frame")
    space: bool = False


SHAPES = {
    "disk": ShapeKind((1,)),
    "ring": ShapeKind((1,)),
    "box": ShapeKind((2, 3)),
    "polygon": ShapeKind(()),
    "sphere": ShapeKind((1,), space=True),
    "cylinder": ShapeKind((2,), space=True),
    "cone": ShapeKind((2,), space=True),
    "ground": ShapeKind((), ()),
    "curve": ShapeKind((), ("at", "frame", "s")),
    "arrow": ShapeKind((), ("at", "scale")),
}
# The variable of the graph that runs along a curve; no name of a file is like it.
CURVE = "s of a curve"
# Appearances of a link, as a file states them.
LINKS = ("rod", "spring", "damper", "string", "line")


class StringLength(NamedTuple):
    """Length of a drawn string: node of its expression, and its place in the file."""

    node: int
    place: Place


class Scene(NamedTuple):
    """Points (2 or 3 expressions each), links between points, and shapes.

    `looks` has, for each link, the form in which it is drawn (one of `LINKS`), or is
    empty: then the changes of lengths decide; `lengths` has, for each link, the length
    of a string, or None where the motion determines it.
    """

    points: dict[str, tuple[int, ...]]
    links: tuple[tuple[str, str], ...] = ()
    looks: tuple[str, ...] = ()
    shapes: tuple[Shape, ...] = ()
    lengths: tuple[StringLength | None, ...] = ()

    @property
    def dimension(self) -> int:
        """Dimension of the scene: 2 in a plane, 3 in space, 0 if it is empty."""
        of_shapes = [shape.dimension for shape in self.shapes]
        return max([*map(len, self.points.values()), *of_shapes], default=0)


class DrawnExpression(NamedTuple):
    """Expression that is plotted or drawn: its graph node, and its text in the file."""

    node: int
    text: str


class Plot(NamedTuple):
    """Entry of `output.plots`: the expressions of its horizontal and vertical axes.

    `y` belongs to the left axis, `y2` to the right one; `log` has the logarithmic axes
    among `x`, `y` and `y2`; `title` is the title in pictures.
    """

    x: DrawnExpression
    y: tuple[DrawnExpression, ...]
    y2: tuple[DrawnExpression, ...] = ()
    log: frozenset[str] = frozenset()
    title: str = ""

    def curves(self, number: int) -> dict[str, DrawnExpression]:
        """Return the expression of each column of the plot, such as `plot:0.y.1`.

        number : index of the plot in `output.plots`, from 0.
        """
        found = {f"plot:{number}.x": self.x}
        for axis, curves in (("y", self.y), ("y2", self.y2)):
            for k, curve in enumerate(curves, 1):
                found[f"plot:{number}.{axis}.{k}"] = curve
        return found


class Section(NamedTuple):
    """Section of the phase space, at which states are recorded for a picture.

    States are recorded where the graph node `at` crosses 0 in the `direction`, or at
    times a constant interval apart, the graph node `every`; one of `at` and `every` is
    None. `plot` has the names of the two columns of the picture.
    """

    name: str
    at: int | None
    every: int | None
    direction: str
    plot: tuple[str, ...]
    place: Place


class Output(NamedTuple):
    """Definitions that become columns, extra plots, and optional columns.

    `columns` are the definitions with a column. `gauss` and `action` are whether there
    are columns of Gauss's principle and of the action. `reactions` are the definitions
    with a column for their reactions; `event_marks` is whether pictures mark events.
    `sensitivities` are the parameters and start values by which columns are
    differentiated.
    """

    columns: tuple[str, ...]
    plots: tuple[Plot, ...] = ()
    gauss: bool = False
    action: bool = False
    reactions: tuple[str, ...] = ()
    event_marks: bool = True
    sections: tuple[Section, ...] = ()
    sensitivities: tuple[str, ...] = ()


class Mismatch(NamedTuple):
    """Inconsistent units: the place, and a description."""

    place: Place
    text: str


class NumberPlaces(NamedTuple):
    """Places of numbers in the text of a model file.

    Attributes
    ----------
    text : str
    spans : dict of str to (int, int)
        Begin and end of the number of each parameter and start value in the text. A
        number that members of a family share has one place.
    added : (int, str) or None
        Where further start values are written, and the text that separates them; None
        if the file has no start value.
    """

    text: str
    spans: Mapping[str, tuple[int, int]]
    added: tuple[int, str] | None


class Stated(Protocol):
    """Interface to a model file: evaluates its expressions for other values.

    Implemented by `reader.File`.
    """

    def bound(
        self, model: Model, parameters: Mapping[str, str], initial: Mapping[str, str]
    ) -> Model:
        """Return `model`, of this file, with other values; see `Model.bind`."""

    def shifted(self, model: Model, table: str, point: int, part: float) -> Model:
        """Return `model`, of this file, with one value of a table changed.

        Parameters
        ----------
        point
            The number of the point, from 0 on.
        part
            The change, as a fraction of the range of the table's values.
        """

    def written_out(self, model: Model) -> Model:
        """Return `model`, of this file, without elements; see `Model.written_out`."""

    def settings(self, options: Mapping[str, str]) -> Settings:
        """Return the settings of the file's run; see `Model.settings`."""

    def depends_on(self, names: Collection[str]) -> bool:
        """Whether another number of the file can change when `names` change.

        Such a number is a parameter, a start value or a setting whose expression
        contains one of `names`.

        names : parameters or start values.
        """

    def rewritten(self, values: Mapping[str, float]) -> str:
        """Return the text of the file with other values of parameters and start values.

        Comments are kept.

        Raises
        ------
        InputError
            If values of a family cannot be written where the file has one number.
        """

    def places(self) -> NumberPlaces:
        """Return where the file has the numbers of parameters and start values."""

    def formulas(self) -> Mapping[str, Parsed]:
        """Return the expressions of parameters, start values and settings, by name.

        A setting has a name such as `simulation.duration`.
        """

    def structural(self) -> Collection[str]:
        """Return the parameters on which ranges and subscripts depend."""

    def compiled(self, text: str, option: str) -> int:
        """Return the graph node of an expression of columns of the table of a run.

        Parameters
        ----------
        text
            The expression.
        option
            The command line option, which precedes the expression in messages.

        Raises
        ------
        InputError
            As for an expression of the file.
        """

    def texts(self) -> dict[str, Scalar]:
        """Return the texts of the model's expressions, by keys such as `forces.x`.

        The sections are definitions, states, energies, forces, constraints and events.
        """

    def numbers(self) -> list[str]:
        """Return the texts of the expressions of parameters and start values."""

    def mismatches(self, model: Model) -> list[Mismatch]:
        """Return the inconsistent units of the file, with their places."""

    def separated(self, model: Model) -> tuple[Model, dict[str, int]]:
        """Return `model` with the definitions in `output.reactions` as coordinates.

        The new model is on the graph of `model`. In it no constraint relates these
        definitions to their expressions. The second result has these expressions by
        name; they may depend on each other.

        Raises
        ------
        InputError
            If a relation with a multiple root, which is replaced by one with a simple
            root, has another multiplier in the new model, so that it gives the
            definitions no reaction.
        """


class Table(NamedTuple):
    """Function given by points, of the model file or of a `file` with this `sha256`.

    axes, pieces : see `language.tables`.
    interpolation, outside : how values between, and beyond, the points are computed.
    """

    name: str
    axes: tuple[Data, ...]
    pieces: Data
    interpolation: str
    outside: str
    file: str = ""
    sha256: str = ""

    def __call__(self, g: Graph, args: list[int]) -> int:
        """Return the graph node of the table's value.

        args : graph nodes of its arguments, one or two.
        """
        return called(g, self.axes, self.pieces, args)


class FirstOrderState(NamedTuple):
    """First-order state s with s' = `rate`.

    `rate` is the graph node of a function of t, q, q' and all states.
    """

    name: str
    rate: int
    unit: str = ""
    description: str = ""


class Transition(NamedTuple):
    """Event of the file, which sets modes or states and gives impulses.

    `sets` has pairs of a name and the graph node of its new value. `impulses` act along
    their directions like forces, in N s. The event acts when the relation `at` becomes
    true or, where `at` is None, at the start and at intervals `every`; with `once` only
    the first time.
    """

    name: str
    sets: tuple[tuple[str, int], ...]
    at: Relation | None
    every: float
    once: bool
    place: Place
    impulses: tuple[Force, ...] = ()


class Gimbal(NamedTuple):
    """Frame turned by three angles: its name, and the graph nodes of its angles.

    `node`, the sine or the cosine of the second angle, is 0 at gimbal lock, where the
    first and the last rotation have one axis.
    """

    frame: str
    node: int
    angles: tuple[int, ...]


class TurningFrame(NamedTuple):
    """Frame in space that turns relative to its parent; all fields but one are nodes.

    Attributes
    ----------
    parent : int
        Index of the parent among the frames in space; -1 for space.
    rows, turn : tuple of tuple of int, shape (3, 3)
        The matrix R of the frame, and the matrix E of its rotation, R = P E.
    own, omega : tuple of int, shape (3,)
        The angular velocities relative to the parent, and to space, in the components
        of the frame.
    """

    parent: int
    rows: tuple[tuple[int, ...], ...]
    turn: tuple[tuple[int, ...], ...]
    own: tuple[int, ...]
    omega: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Model:
    """Mechanical model: all content of the file but the settings of its integration.

    Expressions are nodes of `graph`. Start values and settings are evaluated by `bind`
    and `settings`.

    Attributes
    ----------
    name : str
        The name of the model, by default that of its file.
    file : str
        The path of the file, as given.
    sha256 : str
        The digest of the text of the file.
    graph : Graph
        The graph of all expressions.
    parameters : tuple of Parameter
        Parameters with their values; the last are the modes, which `events` set.
    coordinates : tuple of Coordinate
    definitions : tuple of Definition
    lagrangian : int
        Node of the Lagrangian: `kinetic - potential`, or `lagrangian` of the file.
    kinetic, potential : int or None
        Nodes of the energies; None where the file has `lagrangian`.
    dissipation : int or None
        Node of Rayleigh's function; None where the file has none.
    forces : tuple of Force
        Generalised forces on coordinates and definitions.
    constraints : tuple of Constraint
        Equality constraints, contacts, limits and friction, in the order of the file.
    initial : tuple of InitialValue
        An entry for every coordinate and every velocity, in the order of the
        coordinates, positions first, then of `states` and of the start values of
        definitions.
    until : Relation or None
        The condition that ends a run; None where the file has none.
    scene : Scene
        Points, lines and shapes to draw.
    output : Output
        Requests for columns, plots and sections.
    stated : Stated
        The expressions of values as in the file, from which other values are bound.
    description, source : str
        Texts for readers.
    unused : tuple of str
        Parameters that no expression uses.
    states : tuple of FirstOrderState
    events : tuple of Transition
        Events of the file, which set modes or states, or give impulses.
    gimbals : tuple of Gimbal
        Frames by three angles.
    frames : tuple of TurningFrame
        Frames in space, parents first.
    quaternions : frozenset of str
        Names of the constraints on the lengths of quaternions.
    unused_keys : tuple of str
        Texts on parts of the file without effect.
    tables : tuple of Table
    hidden : tuple of Definition
        Definitions that the file implies, such as the entries of a frame's matrix
        `frame.arm.2.xy`.
    places : mapping of str to Place
        Places in the file of parameters, coordinates, definitions and energies.
    """

    name: str
    file: str
    sha256: str
    graph: Graph
    parameters: tuple[Parameter, ...]
    coordinates: tuple[Coordinate, ...]
    definitions: tuple[Definition, ...]
    lagrangian: int
    kinetic: int | None
    potential: int | None
    dissipation: int | None
    forces: tuple[Force, ...]
    constraints: tuple[Constraint, ...]
    initial: tuple[InitialValue, ...]
    until: Relation | None
    scene: Scene
    output: Output
    stated: Stated = field(repr=False, compare=False)
    description: str = ""
    source: str = ""
    unused: tuple[str, ...] = ()
    states: tuple[FirstOrderState, ...] = ()
    events: tuple[Transition, ...] = ()
    gimbals: tuple[Gimbal, ...] = ()
    frames: tuple[TurningFrame, ...] = field(default=(), repr=False)
    quaternions: frozenset[str] = frozenset()
    unused_keys: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    hidden: tuple[Definition, ...] = field(default=(), repr=False)
    places: Mapping[str, Place] = field(default_factory=dict, repr=False, compare=False)

    @property
    def content(self) -> str:
        """Digests of the file and of the files of its tables, joined by dots."""
        return ".".join([self.sha256, *(t.sha256 for t in self.tables if t.file)])

    @property
    def variables(self) -> tuple[Coordinate | FirstOrderState, ...]:
        """The coordinates, then the first-order states."""
        return (*self.coordinates, *self.states)

    @property
    def parameter_values(self) -> dict[str, float]:
        """Values of the parameters, by name."""
        return {p.name: p.value for p in self.parameters}

    @property
    def modes(self) -> frozenset[str]:
        """Names of the modes."""
        return frozenset(p.name for p in self.parameters if p.mode)

    @property
    def kicks(self) -> bool:
        """Whether events of the file have impulses."""
        return any(event.impulses for event in self.events)

    @property
    def located(self) -> tuple[Relation, ...]:
        """Relations whose zeros a run locates: conditions of events, then `until`."""
        conditions = (*(event.at for event in self.events), self.until)
        return tuple(x for x in conditions if x is not None)

    @property
    def relations(self) -> tuple[int, ...]:
        """Nodes of the relations that a run searches: of conditions and sections."""
        sections = (x.at for x in self.output.sections if x.at is not None)
        return (*(x.node for x in self.located), *sections)

    def bind(
        self,
        parameters: Mapping[str, float | str] | None = None,
        initial: Mapping[str, float | str] | None = None,
        /,
        **values: float | str,
    ) -> Model:
        """Return the model with other values of parameters or start values.

        The graph is shared, so that equations derived for one model hold for the other.
        Parameters and start values whose expressions use the changed ones change, too.

        Parameters
        ----------
        parameters, initial
            Numbers, or expressions, used instead of the file's. A start value
            marked as a guess remains a guess.
        **values
            Parameters or start values by name.

        Raises
        ------
        InputError
            As for a file with these values.
        """
        known = {p.name for p in self.parameters}
        own = {k: v for k, v in values.items() if k in known}
        others = {k: v for k, v in values.items() if k not in known}
        return self.stated.bound(
            self,
            _texts({**(parameters or {}), **own}),
            _texts({**(initial or {}), **others}),
        )

    def written_out(self) -> Model:
        """Return the model with every sum as the terms of its members.

        The result has a graph of its own where this model has elements, see
        `language.elements`; else it is this model.
        """
        if not self.graph.of((ELEMENTS,)):
            return self
        return self.stated.written_out(self)

    def settings(self, options: Mapping[str, float | str] | None = None) -> Settings:
        """Return the settings of the file's run, at the values of the parameters.

        Parameters
        ----------
        options
            Values that replace keys of `simulation`; `duration` replaces `end` too.

        Raises
        ------
        InputError
            As for a file with these values.
        """
        return self.stated.settings(_texts(options or {}))


def _texts(values: Mapping[str, float | str]) -> dict[str, str]:
    return {
        name: value if isinstance(value, str) else repr(float(value))
        for name, value in values.items()
    }
