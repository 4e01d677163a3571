"""Content of a model file: the model, and the settings of its integration.

Both are frozen and complete, nothing half-built.

Expressions are node numbers of `Model.graph`. Its variables are named as in the
model file: `t`, a parameter, a coordinate `q`, a velocity `q_dot`, and for
definitions of output also `q_ddot`, `lambda_<c>`, `Qc_<q>` and `energy`.
Definitions are already written into the expressions that use them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple, Protocol

from lagsim.language.derivatives import tangent
from lagsim.language.tables import called, met

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.language.tables import Data
    from lagsim.model.nodes import Scalar


# What holds where the file is silent.
DEFAULT_RTOL = 1e-11
DEFAULT_ROWS = 1000
# With Baumgarte's formulation, what is off the constraints falls by e over this many
# rows. A fast decay is resolved like a fast motion (the elastic pendulum on its curve
# at 1e-11: 7,400 evaluations at a gain of 1, 9,600 at 5, 19,000 at 10 and 110,000 at
# 50).
ROWS_TO_DECAY = 10


class Settings(NamedTuple):
    """Start, end, spacing of the rows, and integration of a run.

    None where nothing was asked for; the properties say what holds then.

    Attributes
    ----------
    start, end : float
        The same where no length of the run is given.
    output_step : float
        Spacing of the rows.
    rest : bool
        Guesses of the start are solved for a state at rest.
    step : float or None
        Of fixed-step methods.
    gain : float or None
        Of Baumgarte's formulation, per unit of time.
    options : tuple of (str, float)
        Of methods, those that are asked for, see `methods.options`.
    moments : tuple of float
        Times, in order, at which states are asked for beside the rows.
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

    @property
    def duration(self) -> float:
        """Length of the run in time; 0 where it is not given."""
        return self.end - self.start

    @property
    def tolerance(self) -> float:
        """The relative tolerance of methods that control their error."""
        return DEFAULT_RTOL if self.rtol is None else self.rtol

    @property
    def fixed_step(self) -> float:
        """The step of methods that do not; at most the run is one step."""
        return min(self.step or self.output_step, self.duration or math.inf)

    @property
    def decay(self) -> float:
        """The rate at which Baumgarte's formulation returns to the constraints."""
        return self.gain or 1.0 / (ROWS_TO_DECAY * self.output_step)


class Parameter(NamedTuple):
    """A number of the model; an input of every compiled function.

    `follows`: its expression in the file names others. A `mode` is set by events: its
    value is that at the start.
    """

    name: str
    value: float
    unit: str = ""
    description: str = ""
    follows: bool = False
    mode: bool = False


class Coordinate(NamedTuple):
    """A generalized coordinate."""

    name: str
    unit: str = ""
    description: str = ""


class Level(IntEnum):
    """Quantities on which an expression may depend, in ascending order."""

    NUMBER = 0
    POSITION = 1
    VELOCITY = 2
    OUTPUT = 3

    @property
    def text(self) -> str:
        """Description of these quantities, for messages."""
        found = "positions and time", "velocities"
        return ("numbers", *found, "accelerations, multipliers or energies")[self]


class Definition(NamedTuple):
    """A named scalar expression."""

    name: str
    node: int
    level: Level
    unit: str = ""
    description: str = ""


class Force(NamedTuple):
    """A force `node` that works on a coordinate, or on a definition.

    Q_j = node * d direction/d q_j for a direction of positions (and time), and
    node * d direction/d q_j_dot for one that is affine in the velocities.
    """

    on: str
    node: int
    direction: int
    level: Level
    place: Place


class Relation(NamedTuple):
    """`node` = 0, an `equality`, or the gap `node` >= 0; `text` is that of the file.

    `multiple`: the relation of the file is a power of `node`, or its size.
    """

    node: int
    equality: bool
    text: str
    place: Place
    multiple: bool = False


# Names that may stand in a friction, and in a restitution, alone.
SLIP_SPEED, APPROACH_SPEED = "slip_speed", "approach_speed"


class OneSided(NamedTuple):
    """The law of a relation that pushes and does not pull.

    Newton's restitution, or Poisson's, and Coulomb's friction: `friction` while it
    slides, `static` while it sticks, both on the velocities `slips`. A restitution that
    follows the state, or `APPROACH_SPEED`, is the node `bounce`. A relation between
    velocities has restitution 0 and no friction.
    """

    restitution: float
    friction: int | None = None
    slips: tuple[int, ...] = ()
    static: int | None = None
    bounce: int | None = None
    poisson: bool = False


class Constraint(NamedTuple):
    """A relation and its law; `law` is None for an equality.

    `limit`: an equality of velocities holds while its multiplier is no larger; of two
    that share one, while their norm is, `pair` tells where the other follows. `static`:
    the limit while it holds, where that is another. `when`: it is in force while this
    condition of t, parameters and modes is not 0.
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
        """Its name in the file."""
        return self.name[:-2] if self.pair else self.name

    @property
    def ends(self) -> str:
        """How the names of two relations end that share a limit: of a list, or not."""
        return "12" if self.name[-1] in "12" else "xy"

    @property
    def always(self) -> bool:
        """Whether it is an equality that holds all the time."""
        return self.law is None and self.limit is None and self.when is None


class InitialValue(NamedTuple):
    """A start value; `error` bounds the rounding of the expression that gave it.

    `node` is the expression of a definition, or its total rate, and None for
    coordinates and velocities.
    """

    name: str
    value: float
    error: float
    guess: bool
    text: str
    place: Place
    node: int | None = None


class Shape(NamedTuple):
    """A body, a ground, a curve or an arrow that is drawn and is no more than that.

    Attributes
    ----------
    kind : str
        One of `SHAPES`.
    sizes : tuple of int
        Lengths, all of parameters: of a body; the height of a ground in space; the ends
        of the parameter `CURVE` of a curve; the scale of an arrow.
    corners : tuple of tuple of int
        Of a polygon or a ground; the one place on a curve; the vector of an arrow. In
        the shape's own axes.
    at : tuple of int
        Its origin, which that of the scene is without any.
    axes : tuple of int
        Entries of its rotation matrix, 2 x 2 or 3 x 3, row by row; or none.
    point : str
        The point of the scene that lies at its origin, or at a corner; or none.
    places : tuple of Place
        Of `sizes` in the file.
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
        """All that it is made of."""
        corners = [node for corner in self.corners for node in corner]
        return [*self.sizes, *corners, *self.at, *self.axes]

    @property
    def dimension(self) -> int:
        """How many components its places have; 3 of a body of space."""
        own = SHAPES[self.kind]
        space = own.space or (own.sizes and len(self.sizes) > min(own.sizes))
        space = space or (self.kind == "ground" and not self.corners)
        parts = max(map(len, (self.at, *self.corners)), default=0)
        return max(parts, 3 if space or len(self.axes) > 4 else 2)


class ShapeKind(NamedTuple):
    """How many sizes a shape has, other keys that it takes, whether in space alone."""

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
# Looks of a link that a file may ask for.
LINKS = ("rod", "spring", "damper", "string", "line")


class StringLength(NamedTuple):
    """Length of a string, an expression of parameters, with its place in the file."""

    node: int
    place: Place


class Scene(NamedTuple):
    """Points (2 or 3 expressions each), links between them, and shapes.

    `looks` are of `LINKS`, one a link, or empty where its length says it; `lengths`,
    one a link, those of strings, None where the motion says it.
    """

    points: dict[str, tuple[int, ...]]
    links: tuple[tuple[str, str], ...] = ()
    looks: tuple[str, ...] = ()
    shapes: tuple[Shape, ...] = ()
    lengths: tuple[StringLength | None, ...] = ()

    @property
    def dimension(self) -> int:
        """2 in a plane, 3 in space; 0 of nothing."""
        of_shapes = [shape.dimension for shape in self.shapes]
        return max([*map(len, self.points.values()), *of_shapes], default=0)


class Curve(NamedTuple):
    """An expression that is drawn, and what the file calls it."""

    node: int
    text: str


class Plot(NamedTuple):
    """An entry of `output.plots`: what runs right, and what runs up at both sides.

    `log` are the axes, `x`, `y` and `y2`, that show powers of ten.
    """

    x: Curve
    y: tuple[Curve, ...]
    y2: tuple[Curve, ...] = ()
    log: frozenset[str] = frozenset()
    title: str = ""

    def curves(self, number: int) -> dict[str, Curve]:
        """Give the column of each expression, of the plot counted from 0."""
        found = {f"plot:{number}.x": self.x}
        for axis, curves in (("y", self.y), ("y2", self.y2)):
            for k, curve in enumerate(curves, 1):
                found[f"plot:{number}.{axis}.{k}"] = curve
        return found


class Section(NamedTuple):
    """States at which `at` vanishes in a direction, or at times `every` so much.

    `plot` are the columns of its picture; empty: the first two that vary.
    """

    name: str
    at: int | None
    every: int | None
    direction: str
    plot: tuple[str, ...]
    place: Place


class Output(NamedTuple):
    """Definitions that become columns, extra plots, and optional columns.

    `reactions` are definitions whose reactions are asked for; `event_marks`, whether
    pictures mark events.
    """

    columns: tuple[str, ...]
    plots: tuple[Plot, ...] = ()
    gauss: bool = False
    action: bool = False
    reactions: tuple[str, ...] = ()
    event_marks: bool = True
    sections: tuple[Section, ...] = ()


class Mismatch(NamedTuple):
    """Units that do not fit: where, and in words."""

    place: Place
    text: str


class Stated(Protocol):
    """The numbers that a file states, and what replaces them: see `reader.File`."""

    def bound(
        self, model: Model, parameters: Mapping[str, str], initial: Mapping[str, str]
    ) -> Model:
        """Give `model`, of this file, with other values; see `Model.bind`."""

    def shifted(self, model: Model, table: str, point: int, part: float) -> Model:
        """Give `model`, of this file, with the value of a table at one point moved.

        Parameters
        ----------
        point
            The number of the point, from 0 on.
        part
            By this part of the range of the values of the table.
        """

    def settings(self, options: Mapping[str, str]) -> Settings:
        """Give how the file wants to be run; see `Model.settings`."""

    def depends_on(self, names: Collection[str]) -> bool:
        """Tell whether any other number of the file may follow these.

        A parameter, a start value or a setting whose expression names one of these
        parameters, or start values.
        """

    def structural(self) -> Collection[str]:
        """Give the parameters on which ranges and subscripts depend."""

    def texts(self) -> dict[str, Scalar]:
        """Give the expressions of energies, forces and constraints, as `forces.x`."""

    def numbers(self) -> list[str]:
        """Give the expressions that parameters and start values are given by."""

    def mismatches(self, model: Model) -> list[Mismatch]:
        """Give the units of the file that do not fit, with their places."""

    def separated(self, model: Model) -> tuple[Model, dict[str, int]]:
        """Give `model`, of this file, with `output.reactions` as coordinates.

        On the same graph; nothing holds these definitions to what defines them, which
        is the second result: an expression each, in terms of each other, too.

        Raises
        ------
        InputError
            Where a constraint is satisfied as the root of another relation then.
        """


class Table(NamedTuple):
    """Function given by points, those of a `file` with this `sha256`, or of the model.

    axes, pieces : see `language.tables`; constants : the parameters and modes.
    """

    name: str
    axes: tuple[Data, ...]
    pieces: Data
    interpolation: str
    outside: str
    file: str = ""
    sha256: str = ""
    constants: frozenset[str] = frozenset()

    def __call__(self, g: Graph, args: list[int]) -> int:
        """Give the node of its value."""
        pairs = zip(self.axes, args, strict=True)
        axes = tuple(met(a) if self._is_clock(g, x) else a for a, x in pairs)
        return called(g, axes, self.pieces, args)

    def _is_clock(self, g: Graph, x: int) -> bool:
        """Whether an argument is a t + b."""
        if not g.depends([x]) <= {"t", *self.constants}:
            return False
        (rate,) = tangent(g, [x], {g.variable("t"): g.one})
        return "t" not in g.depends([rate])


class State(NamedTuple):
    """First-order state s with s' = `rate`, a node of t, q, q' and all states."""

    name: str
    rate: int
    unit: str = ""
    description: str = ""


class Transition(NamedTuple):
    """An event of the file, which sets modes: `sets` are pairs of a mode and a node.

    It acts when `at` becomes true, or at the start and `every` so much time.
    """

    name: str
    sets: tuple[tuple[str, int], ...]
    at: Relation | None
    every: float
    once: bool
    place: Place


class Gimbal(NamedTuple):
    """Three angles of a frame, whose nodes are `angles`.

    `node`, the sine or the cosine of the second, is 0 at gimbal lock, where the first
    and the last turn about one axis.
    """

    frame: str
    node: int
    angles: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Model:
    """Mechanical model: all that the file holds but the settings of its integration.

    `kinetic` and `potential` are None where the file gives `lagrangian`, which is
    `kinetic - potential` otherwise. `initial` has one entry for every coordinate and
    every velocity, in the order of the coordinates, positions first, then of `states`
    and the start values of definitions. Modes are the last of `parameters`, which
    `events` set; `until` ends a run. `stated` is what `bind` and
    `settings` evaluate. `unused` are parameters that nothing names. `places` are those
    of parameters, coordinates, definitions and energies in the file. `gimbals` are the
    frames by three angles, `quaternions` the constraints that hold their lengths;
    `idle` says what of the file has no effect. `hidden` are definitions that the file
    implies, such as the entries of a frame's matrix `frame.arm.2.xy`.
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
    states: tuple[State, ...] = ()
    events: tuple[Transition, ...] = ()
    gimbals: tuple[Gimbal, ...] = ()
    quaternions: frozenset[str] = frozenset()
    idle: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    hidden: tuple[Definition, ...] = field(default=(), repr=False)
    places: Mapping[str, Place] = field(default_factory=dict, repr=False, compare=False)

    @property
    def content(self) -> str:
        """Digest of the file, and of those of its tables."""
        return ".".join([self.sha256, *(t.sha256 for t in self.tables if t.file)])

    @property
    def variables(self) -> tuple[Coordinate | State, ...]:
        """The coordinates, then the first-order states."""
        return (*self.coordinates, *self.states)

    @property
    def parameter_values(self) -> dict[str, float]:
        """The values of the parameters, by name."""
        return {p.name: p.value for p in self.parameters}

    @property
    def modes(self) -> frozenset[str]:
        """The names of the modes."""
        return frozenset(p.name for p in self.parameters if p.mode)

    @property
    def located(self) -> tuple[Relation, ...]:
        """The conditions that are located: those of events, then `until`."""
        conditions = (*(event.at for event in self.events), self.until)
        return tuple(x for x in conditions if x is not None)

    def bind(
        self,
        parameters: Mapping[str, float | str] | None = None,
        initial: Mapping[str, float | str] | None = None,
        /,
        **values: float | str,
    ) -> Model:
        """Give the model with other values of parameters, or start values.

        On the same graph: equations derived from one are those of the other. Parameters
        and start values that are expressions of others follow them.

        Parameters
        ----------
        parameters, initial
            Numbers, or expressions, that stand for those of the file. A start value
            that is a guess stays one.
        **values
            The same, of whichever has the name.

        Raises
        ------
        InputError
            As where the file has these.
        """
        known = {p.name for p in self.parameters}
        own = {k: v for k, v in values.items() if k in known}
        others = {k: v for k, v in values.items() if k not in known}
        return self.stated.bound(
            self,
            _texts({**(parameters or {}), **own}),
            _texts({**(initial or {}), **others}),
        )

    def settings(self, options: Mapping[str, float | str] | None = None) -> Settings:
        """Give how the file wants to be run, at the values of the parameters.

        Parameters
        ----------
        options
            Stand for keys of `simulation`; `duration` replaces `end` too.

        Raises
        ------
        InputError
            As where the file has these.
        """
        return self.stated.settings(_texts(options or {}))


def _texts(values: Mapping[str, float | str]) -> dict[str, str]:
    return {
        name: value if isinstance(value, str) else repr(float(value))
        for name, value in values.items()
    }
