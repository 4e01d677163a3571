"""Reader of the sections `simulation`, `output` and `scene`."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

from lagsim.codes.known import (
    BOTH_GIVEN,
    DUPLICATE_COLUMN,
    DUPLICATE_REACTION,
    EMPTY,
    MISSING_KEY,
    NO_REACTION,
    NOT_A_DEFINITION,
    NOT_A_LIST,
    NOT_AN_EQUALITY,
    NOT_AN_EXPRESSION,
    OUT_OF_RANGE,
    SHAPE_OF_SPACE,
    TOO_MANY_ROWS,
    UNKNOWN_AXIS,
    UNKNOWN_BEGIN,
    UNKNOWN_KEY,
    UNKNOWN_NAME,
    WRONG_COUNT,
)
from lagsim.language.evaluate import evaluate
from lagsim.language.names import rate_of
from lagsim.limits import STEPS
from lagsim.methods import RETIRED as RETIRED_METHODS
from lagsim.methods import options
from lagsim.model.model import (
    CURVE,
    DEFAULT_ROWS,
    LINKS,
    RETIRED_FORMULATIONS,
    SHAPES,
    DrawnExpression,
    Level,
    Output,
    Plot,
    Scene,
    Section,
    Settings,
    Shape,
    StringLength,
)
from lagsim.model.nodes import (
    Broken,
    Mapping,
    Node,
    Scalar,
    Sequence,
    argument,
    entries_of,
    items_of,
    texts_of,
)
from lagsim.model.reader import hints, quantities
from lagsim.model.reader.equations import read_relation
from lagsim.model.reader.fields import (
    AXES,
    LINK,
    MOST_CURVES,
    PLOT,
    RESERVED,
    SECTION,
    SHAPE,
    Fields,
    entries,
    fields,
    items,
    kind_of,
    quoted_list,
    scalar_items,
)
from lagsim.model.reader.fields import scalar_items as texts_among
from lagsim.model.reader.names import NameKind, check_name
from lagsim.tolerances import SAME_STEP, SHORTEST_RUN

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from collections.abc import Mapping as MappingType
    from collections.abc import Sequence as SequenceType

    from lagsim.codes.known import ErrorCode
    from lagsim.errors import Place
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.names import Names


MAX_ROWS = 10**8
# Keys of one time.
NUMBERS = ("start", "duration", "end", "output_step", "rtol", "atol", "step", "gain")
TIMES = ("duration", "end", "output_step", "step")
# Option of sweeps, no key of files: the time from which on measures count rows.
FROM = "from"
# Kinds of start: the values in `initial`, guesses solved for, or at rest.
BEGIN = ("initial", "rest")

# --- When to start and stop, how finely, and how to integrate


def read_settings(
    section: Fields, instead: MappingType[str, str], x: Expressions
) -> Settings:
    """Return the settings of the section `simulation`, with some keys replaced.

    instead : expressions that replace those of keys.
    """
    given = dict(section.found)
    if "duration" in instead:
        given.pop("end", None)
    for key, text in instead.items():
        value = argument(f"--{key.replace('_', '-')} ", text)
        given[key] = value, value
    return _Simulation(replace(section, found=given), x).read()


# Names of earlier versions, by key.
RETIRED = {"method": RETIRED_METHODS, "formulation": RETIRED_FORMULATIONS}


class _Simulation:
    def __init__(self, given: Fields, x: Expressions) -> None:
        self.given, self.x = given, x

    def read(self) -> Settings:
        given = self.given
        start = self._number("start") if "start" in given else 0.0
        end = self._end(start)
        output_step = self._number("output_step", positive=True)
        rtol, atol = self._number("rtol", 0.0, 1.0), self._number("atol", 0.0)
        if rtol == 0 and "atol" not in given:
            hint = "`atol` is rtol times a scale where it is not given"
            self._fault(OUT_OF_RANGE, "`rtol` is 0 without an `atol`", "rtol", hint)
        elif rtol == 0 and atol == 0:
            self._fault(OUT_OF_RANGE, "`rtol` and `atol` are both 0", "atol")
        step, gain = (self._number(key, positive=True) for key in ("step", "gain"))
        own = ((k, self._number(k, o.least, o.most)) for k, (_, o) in options().items())
        places = {key: given.at(key) for key in given.found}
        names = {
            "method": self._name("method", "see `lagsim methods`"),
            "formulation": self._name("formulation", "see docs/model-file.md"),
        }
        retired = tuple((k, name) for k, name in names.items() if name in RETIRED[k])
        names |= dict.fromkeys(dict(retired), "auto")
        settings = Settings(
            rtol=rtol, atol=atol, step=step, gain=gain, retired=retired,
            method=names["method"], formulation=names["formulation"],
            method_place=places.get("method"),
            formulation_place=places.get("formulation"),
            options=tuple((k, v) for k, v in own if v is not None),
            rest=given.choice("begin", BEGIN, UNKNOWN_BEGIN) == "rest",
        )  # fmt: skip
        if start is None or end is None:
            return settings._replace(start=start or 0.0, end=start or 0.0)
        if output_step is None:
            output_step = (end - start) / DEFAULT_ROWS
        self._check_rows(end - start, output_step)
        since = self._number(FROM)
        if since is not None and since > end:
            text = f"`{FROM}` is {since:g}, after the end of the run, {end:g}"
            self._fault(OUT_OF_RANGE, text, FROM)
        if step and "until" not in given and not (end - start) / step <= STEPS:
            text = f"`step` {step:g} makes {(end - start) / step:.3g} steps, more than "
            self._fault(OUT_OF_RANGE, f"{text}{STEPS:,}", "step")
        return settings._replace(
            start=start, end=end, output_step=output_step, measured_from=since
        )

    def _fault(self, code: ErrorCode, text: str, key: str, hint: str = "") -> None:
        self.x.faults.add(code, text, self.given.at(key), hint)

    def _number(
        self,
        key: str,
        least: float = -math.inf,
        most: float = math.inf,
        *,
        positive: bool = False,
    ) -> float | None:
        """Return the number at a key; None without the key, or after a fault.

        least, most : the permitted range.
        positive : whether 0 is excluded.
        """
        node, x, label = self.given.value(key), self.x, f"`{key}`"
        if node and key in TIMES and (hint := quantities.time(node)):
            text = f"{label} must be one time, found {kind_of(node)}"
            self._fault(NOT_AN_EXPRESSION, text, key, hint)
            return None
        return x.number(node, label, least, most, positive=positive)

    def _end(self, start: float | None) -> float | None:
        key = "duration" if "duration" in self.given else "end"
        if key == "duration" and "end" in self.given:
            text, place = "both `duration` and `end` are", self.given.place_of("end")
            self.x.faults.add(BOTH_GIVEN, f"{text} given", place)
        end = self._number(key, positive=key == "duration")
        if end is None or start is None:
            return None
        end += start if key == "duration" else 0.0
        length, text = end - start, ""
        if not (start < end < math.inf and math.isfinite(length)):
            text = f"the run from {start:g} to {end:g} has no positive, finite length"
        elif length < SHORTEST_RUN:
            text = f"the run is {length:g} long; at least {SHORTEST_RUN:g} is expected"
        if text:
            self._fault(OUT_OF_RANGE, text, key)
        return None if text else end

    def _name(self, key: str, hint: str) -> str:
        name = self.given.text(key)
        if not name and isinstance(self.given.value(key), Scalar):
            self._fault(EMPTY, f"`{key}` must be a name, found nothing", key, hint)
        return name or "auto"

    def _check_rows(self, length: float, output_step: float) -> None:
        count = length / output_step
        if count < 1 - SAME_STEP:
            text = f"`output_step` is {output_step:g}, longer than the run, {length:g}"
            self._fault(OUT_OF_RANGE, text, "output_step")
        elif count == math.inf or math.ceil(count - SAME_STEP) + 1 > MAX_ROWS:
            rows = "infinitely many"
            if count < math.inf:
                whole = math.ceil(count - SAME_STEP) + 1
                rows = str(whole) if whole < 10**15 else f"{count:.3g}"
            text = f"`output_step` {output_step:g} makes {rows} rows, more than 10^8"
            hint = f"{length / DEFAULT_ROWS:g} makes {DEFAULT_ROWS + 1}"
            self._fault(TOO_MANY_ROWS, text, "output_step", hint)


# --- The section `output`


def read_output(found: Fields, x: Expressions) -> Output:
    """Return the columns, plots and options of the section `output`, in `found`."""
    columns = tuple(x.names.of(NameKind.DEFINITION))
    node = found.value("columns")
    named = items(node, "`columns`", x.faults)
    if isinstance(node, Sequence):
        hint = "coordinates are columns in any case"
        columns = tuple(_definitions(named, "column", hint, x))
    elif isinstance(node, Scalar) and node.empty:
        text = "`columns` must be a list, found nothing"
        hint = "[] means no columns; without the key there are all"
        x.faults.add(NOT_A_LIST, text, node, hint)
    plots = (_plot(p, x) for p in items(found.value("plots"), "`plots`", x.faults))
    return Output(
        columns,
        tuple(plot for plot in plots if plot),
        gauss=found.truth("gauss"),
        action=found.truth("action"),
        reactions=_reactions(found.value("reactions"), x),
        event_marks=found.truth("event_marks", default=True),
        sections=tuple(_sections(found.value("sections"), columns, x)),
        sensitivities=_varied(found.value("sensitivities"), x),
    )


def _varied(node: Node | None, x: Expressions) -> tuple[str, ...]:
    """Return the parameters and start values named in the list `sensitivities`."""
    moving, found = x.names.moving(), dict[str, None]()
    known = [*x.names.of(NameKind.PARAMETER), *moving, *x.names.of(NameKind.STATE)]
    known += map(rate_of, moving)
    given = items(node, "`sensitivities`", x.faults)
    for part in scalar_items(given, "`sensitivities` lists names", x.faults):
        if part.text in known:
            found[part.text] = None
        else:
            text = f"there is no parameter or start value `{part.text}`"
            hint = x.faults.did_you_mean(part.text, known)
            x.faults.add(UNKNOWN_NAME, text, part, hint)
    return tuple(found)


DIRECTIONS = ("both", "up", "down")


def _sections(
    node: Node | None, columns: tuple[str, ...], x: Expressions
) -> Iterator[Section]:
    for key, value in entries(node, "`sections`", x.faults):
        label = f"the section `{key.text}`"
        below = fields(value, label, SECTION, x.faults, key.place)
        if not check_name(key, "a section", x.faults) or not below.sound:
            continue
        hint = "write {at: x = 0, direction: up}, or {every: 2*pi/w}"
        if not below.either("at", "every", hint, key.place):
            continue
        relation, equality = read_relation(
            below.value("at"), f"`at` of {label}", x, modes=True
        )
        if equality is False:
            text, hint = f"`at` of {label} must be an equality", "such as x = 0"
            x.faults.add(NOT_AN_EQUALITY, text, below.place_of("at"), hint)
        direction = below.choice("direction", DIRECTIONS)
        if "every" in below and "direction" in below:
            text = f"{label} has both `every` and `direction`: times have none"
            x.faults.add(BOTH_GIVEN, text, below.place_of("direction"))
        every = x.compile(below.value("every"), f"`every` of {label}", Level.NUMBER)
        plot = tuple(_axes_of(below, columns, x))
        at = None if relation is None else relation.node
        yield Section(key.text, at, every, direction, plot, key.place)


def _axes_of(below: Fields, columns: tuple[str, ...], x: Expressions) -> Iterator[str]:
    """Yield the names of the two columns on the axes of a section's picture.

    below : the entry of the section.
    columns : columns of definitions.
    """
    given = items(below.value("plot"), "`plot`", x.faults)
    if given and len(given) != len(("right", "up")):
        text = f"`plot` of a section names two columns, found {len(given)}"
        x.faults.add(WRONG_COUNT, text, below.place_of("plot"), "such as [y, y_dot]")
        return
    for part in scalar_items(given, "`plot` names columns", x.faults):
        meaning = x.names.meaning(part.text)
        hidden = meaning is not None and meaning.kind is NameKind.DEFINITION
        hidden &= part.text not in columns
        if (
            meaning is None
            or hidden
            or meaning.kind in (NameKind.PARAMETER, NameKind.PI)
        ):
            text = f"there is no column `{part.text}`"
            hint = x.faults.did_you_mean(part.text, [*x.names.moving(), *columns])
            x.faults.add(UNKNOWN_NAME, text, part, hint)
        else:
            yield part.text


def listed_reactions(section: Node | None) -> list[str]:
    """Return the names in the list `reactions` of `output`, valid or not.

    The names are needed before definitions are read.

    section : the section `output`.
    """
    lists = (v for k, v in entries_of(section) if k.text == "reactions")
    return [name for node in lists for name in texts_of(items_of(node))]


def _reactions(node: Node | None, x: Expressions) -> tuple[str, ...]:
    """Return the valid names in the list `reactions`.

    They are names of definitions of positions and time.
    """
    given = items(node, "`reactions`", x.faults)
    hint = "the force of constraints on a coordinate is Qc_<name>"
    found = []
    for name, place in _definitions(given, "reaction", hint, x).items():
        definition = x.definitions.get(name)
        if definition is None or definition.node is None:
            continue  # faulty itself, and reported
        states = set(x.names.of(NameKind.STATE)) & x.graph.depends([definition.node])
        if definition.level is Level.POSITION and not states:
            found.append(name)
            continue
        label = "states" if states else definition.level.text
        text = f"`{name}` has no reaction: it depends on {label}"
        hint = "reactions exist of definitions of positions and time"
        x.faults.add(NO_REACTION, text, place, hint)
    return tuple(found)


_TWICE: dict[str, ErrorCode] = {
    "column": DUPLICATE_COLUMN,
    "reaction": DUPLICATE_REACTION,
}


def _definitions(
    given: Iterable[Node], label: str, hint: str, x: Expressions
) -> dict[str, Place]:
    """Return the definitions that a list names, with their places.

    label : for messages.
    hint : the hint for a name that is a coordinate.
    given : the items of the list.
    """
    names, faults = x.names, x.faults
    found: dict[str, Place] = {}
    for item in scalar_items(given, f"a {label} is the name of a definition", x.faults):
        name, place = item.text, item.place
        kind = names.variables.get(name)
        if name in found:
            text = f"the {label} `{name}` is given twice"
            faults.add(_TWICE[label], text, place)
        elif kind is NameKind.DEFINITION:
            found[name] = place
        elif kind is not None or names.meaning(name) or name in RESERVED:
            text, more = _no_definition(name, label, hint, names)
            faults.add(NOT_A_DEFINITION, text, place, more)
        elif name not in names.faulty and names.complete:
            near = faults.did_you_mean(name, names.of(NameKind.DEFINITION))
            near = near or f"define it in `definitions`: {name}: ..."
            faults.add(UNKNOWN_NAME, f"there is no definition `{name}`", place, near)
    return found


def _no_definition(name: str, label: str, hint: str, names: Names) -> tuple[str, str]:
    """Return text and hint of the fault that a name is no definition.

    label : `reaction` or `column`, for the text.
    hint : for a coordinate.
    """
    meaning = names.meaning(name)
    text = f"`{name}` is {meaning.kind.text if meaning else 'a column of results'}"
    columns = {NameKind.VELOCITY, NameKind.ENERGY, NameKind.TIME, NameKind.REACTION}
    columns |= {NameKind.STATE, NameKind.STATE_RATE}
    if meaning is None or meaning.kind in columns:
        hint = "leave it out: it is a column in any case"
    elif meaning.kind is not NameKind.COORDINATE:
        hint = f"define it: {name}_given: {name}, and name that"
    return f"{text}; {label}s are definitions", hint


def _plot(node: Node, x: Expressions) -> Plot | None:
    if isinstance(node, Broken):
        return None
    shown = entries_of(node)
    if 0 < len(shown) < 3 and not any(hints.node_text(value) for _, value in shown):
        node = Sequence(tuple(key for key, _ in shown), node.place)
    found = fields(node, "a plot", PLOT, x.faults, node.place)
    found.needs("x", "write `x: t` for a curve against time")
    found.needs("y", f"such as `y: {next(iter(x.names.moving()), 'theta')}`")
    right, up, other = (_curves(found.value(axis), axis, x) for axis in AXES)
    title, log = found.text("title"), frozenset(_axes(found, x))
    return Plot(right[0], up, other, log, title) if right and up else None


def _curves(
    node: Node | None, axis: str, x: Expressions
) -> tuple[DrawnExpression, ...]:
    """Return the expressions of an axis of a plot; a horizontal axis has only one.

    axis : `x`, `y` or `y2`.
    """
    nodes: tuple[Node, ...] = () if node is None else (node,)
    if isinstance(node, Sequence) and axis != "x":
        nodes, count = node.items, len(node.items)
        if not 1 <= count <= MOST_CURVES:
            text = f"`{axis}` of a plot has 1 to {MOST_CURVES} curves, found {count}"
            x.faults.add(
                WRONG_COUNT, text, node, "divide the curves among several plots"
            )
    found = []
    for part in nodes:
        compiled = x.compile(part, f"`{axis}` of the plot", Level.OUTPUT)
        if compiled is not None and isinstance(part, Scalar):
            found.append(DrawnExpression(compiled, " ".join(part.text.split())))
    return tuple(found)


def _axes(plot: Fields, x: Expressions) -> Iterator[str]:
    """Yield the axes that the key `log` of a plot names; other names are reported."""
    for part in items_of(plot.value("log")):
        hint = "write y, or [x, y] for several"
        if isinstance(part, Broken):
            continue
        if not isinstance(part, Scalar) or part.text not in AXES:
            text = f"`log` names axes, {quoted_list(AXES)}, found {kind_of(part)}"
        elif part.text == "y2" and "y2" not in plot:
            text = "`log` names `y2`, and the plot has none"
            hint = "write y, or give `y2`"
        else:
            yield part.text
            continue
        x.faults.add(UNKNOWN_AXIS, text, part, hint)


# --- The section `scene`: points, links between them, and shapes

# Of a polygon, and of a ground.
MOST_CORNERS = 1000
STRING_LENGTH = "the length of a string"
_Link: TypeAlias = "tuple[tuple[str, str], str, StringLength | None]"


def read_scene(found: Fields, x: Expressions) -> Scene:
    """Return the points, links and shapes of the section `scene`, in `found`."""
    return _SceneReader(found, x).read()


class _SceneReader:
    """Reader of a scene.

    points : the graph nodes of the coordinates of each point without faults, by name.
    named : the names of all points.
    whole : whether all names of points were readable, so that any other name is a
        fault.
    """

    def __init__(self, found: Fields, x: Expressions) -> None:
        self.found, self.x, self.faults = found, x, x.faults
        self.points: dict[str, tuple[int, ...]] = {}
        self.named: list[str] = []
        section = found.value("points")
        self.whole = not isinstance(section, Broken) and not found.unknown
        for key, node in entries(section, "`points`", x.faults):
            self.named.append(key.text)
            if check_name(key, "a point", x.faults):
                self.points[key.text] = self._point(f"the point `{key.text}`", node)
        # The first point at each place.
        self.lying = {nodes: name for name, nodes in reversed(self.points.items())}

    def read(self) -> Scene:
        shapes = self._shapes()
        section, given = self.found.value("links"), list[Node]()
        if section and (pair := self._pair(section)):
            text = f"`links` is a list of links, each a list, found {kind_of(section)}"
            hint = f"write [[{', '.join(pair)}]]"
            self.faults.add(NOT_A_LIST, text, section, hint)
        else:
            given = items(section, "`links`", self.faults)
        links = [link for node in given for link in self._looking(node)]
        ends, kinds, lengths = zip(*links, strict=True) if links else ((), (), ())
        scene = Scene(self.points, ends, kinds, shapes, lengths)
        check_sizes(scene, self.x)
        return scene

    def _point(
        self, label: str, node: Node, most: Level = Level.VELOCITY
    ) -> tuple[int, ...]:
        if isinstance(node, Broken):
            return ()
        if not isinstance(node, Sequence):
            text = (
                f"{label} must be a list of 2 or 3 expressions, found {kind_of(node)}"
            )
            hint = hints.as_list(node)
            if isinstance(node, Scalar) and not re.search(r"[,(]|\w\s+\w", node.text):
                hint = f"write [{node.text}, 0]"
            if isinstance(node, Mapping):
                hint = (
                    f"write [{', '.join(hints.node_text(v) for _, v in node.entries)}]"
                )
            self.faults.add(NOT_A_LIST, text, node, hint)
            return ()
        count, words = len(node.items), " ".join(texts_of(node.items)).split()
        text = f"{label} must have 2 or 3 components, found {count}"
        hint = "a point in a plane is [x, y], one in space [x, y, z]"
        if count == 1 < len(words) < 4 and all(map(self.x.names.meaning, words)):
            self.faults.add(WRONG_COUNT, text, node, f"write [{', '.join(words)}]")
            return ()
        compiled = [self.x.compile(part, label, most) for part in node.items]
        if count not in (2, 3) and None not in compiled:
            self.faults.add(WRONG_COUNT, text, node, hint)
        return tuple(c for c in compiled if c is not None)

    # Links

    def _pair(self, node: Node) -> list[str]:
        """Return two points written without brackets, `a - b`; [] for other texts."""
        found = texts_of(items_of(node))
        if isinstance(node, Scalar):
            found = re.split(r"\s*(?:,|->?|–|\s)\s*", node.text)
        return found if len(found) == 2 and set(found) <= set(self.named) else []

    def _looking(self, node: Node) -> list[_Link]:
        """Return the links of an entry: each has two points, a kind and a length.

        The kind is one of `LINKS`, or "" where the changes of its length in the motion
        determine the kind; the length is None except for a string of given length.
        """
        if not isinstance(node, Mapping):
            return [(pair, "", None) for pair in self._link(node)]
        found = fields(node, "a link", LINK, self.faults, node.place)
        points = found.value("points")
        found.needs("points", "such as points: [pivot, bob]")
        pairs = self._link(points) if points else []
        kind, length = found.choice("as", ("", *LINKS)), self._length(found)
        if "length" in found and kind not in ("", "string"):
            text = f"`length` is that of a string, and this link is a {kind}"
            hint = "write as: string, or leave `length` out"
            self.faults.add(BOTH_GIVEN, text, found.place_of("length"), hint)
        kind = kind or ("string" if "length" in found else "")
        return [(pair, kind, length) for pair in pairs]

    def _length(self, found: Fields) -> StringLength | None:
        """Return the length of a string, an expression of parameters, or None.

        found : the entry of the link.
        """
        node = found.value("length")
        if node is None:
            return None
        length = self.x.compile(node, STRING_LENGTH, Level.NUMBER)
        return None if length is None else StringLength(length, node.place)

    def _link(self, node: Node) -> list[tuple[str, str]]:
        """Return the pairs of consecutive points that a link joins."""
        if isinstance(node, Scalar) and not node.empty and (pair := self._pair(node)):
            text = f"a link must be a list, found {kind_of(node)}"
            self.faults.add(NOT_A_LIST, text, node, f"write [{', '.join(pair)}]")
            return []
        ends = items(node, "a link", self.faults)
        if isinstance(node, Sequence) and len(ends) < 2:
            pair = self._pair(ends[0]) if ends else []
            text = f"a link joins 2 points or more, found {len(ends)}"
            hint = f"write [{', '.join(pair)}]" if pair else "such as [pivot, bob]"
            self.faults.add(WRONG_COUNT, text, node, hint)
            return []
        named = list(texts_among(ends, "a link names points", self.faults))
        known = [end.text for end in named if self._is_point(end)]
        return [*pairwise(known)] if len(known) == len(ends) else []

    def _is_point(self, name: Scalar) -> bool:
        """Whether a point has this name; an unknown name is reported."""
        named = self.named
        if name.text not in named and self.whole:
            hint = self.faults.did_you_mean(name.text, named)
            hint = hint or f"the points are {quoted_list(named)}"
            if not named:
                hint = f"give it a place: points: {{{name.text}: [0, 0]}}"
            text = f"there is no point `{name.text}`"
            self.faults.add(UNKNOWN_NAME, text, name, hint)
        return name.text in named

    # Shapes

    def _shapes(self) -> tuple[Shape, ...]:
        x, found = self.x, list[Shape]()
        dimension = max(map(len, self.points.values()), default=0)
        for key, node in entries(self.found.value("shapes"), "`shapes`", x.faults):
            if not check_name(key, "a shape", x.faults) or isinstance(node, Broken):
                continue
            label = f"the shape `{key.text}`"
            known = fields(node, label, SHAPE, x.faults, key.place)
            shape = self._shape(key, known) if known.sound else None
            if shape is None:
                continue
            found.append(shape)
            if 0 < dimension < shape.dimension and () not in self.points.values():
                text = f"the {shape.kind} `{key.text}` lies in space, and the points "
                text += "of the scene in a plane"
                x.faults.add(SHAPE_OF_SPACE, text, key)
        return tuple(found)

    def _shape(self, key: Scalar, known: Fields) -> Shape | None:
        faults, label = self.faults, f"the shape `{key.text}`"
        kinds = [kind for kind in SHAPES if kind in known]
        if len(kinds) > 1:
            second = max(map(known.place_of, kinds), key=lambda at: at[1:3])
            faults.add(BOTH_GIVEN, f"{label} is given as {quoted_list(kinds)}", second)
        elif not kinds and not known.unknown:
            hint = f"the kinds of shapes are {quoted_list(SHAPES)}"
            faults.add(MISSING_KEY, f"{label} has no kind", key, hint)
        if len(kinds) != 1:
            return None
        kind, own = kinds[0], SHAPES[kinds[0]]
        label = f"the {kind} `{key.text}`"
        for other in known.found.keys() - {kind, *own.keys}:
            of = [k for k, other_kind in SHAPES.items() if other in other_kind.keys]
            hint = f"`{other}` belongs to {quoted_list(of)}" if of else ""
            text = f"unknown key `{other}` in {label}"
            faults.add(UNKNOWN_KEY, text, known.place_of(other), hint)
        return self._entry(label, key.text, kind, known)

    def _entry(self, label: str, name: str, kind: str, known: Fields) -> Shape | None:
        node, x = known.found[kind][1], self.x
        if isinstance(node, Broken):
            return None
        corners: tuple[tuple[int, ...], ...] = ()
        sized = list[Node]()
        if counts := SHAPES[kind].sizes:
            sized = self._sized(label, node, counts)
        elif kind == "ground" and isinstance(node, Scalar):
            sized = [node]
        elif kind in ("polygon", "ground"):
            corners = self._corners(label, node, 3 if kind == "polygon" else 2)
        elif kind == "curve":
            if "s" in known:
                sized = self._sized(f"`s` of {label}", known.found["s"][1], (2,))
            else:
                hint = "such as s: [0, 2*pi]"
                self.faults.add(MISSING_KEY, f"{label} has no `s`", node, hint)
            x.bound = {"s": x.graph.variable(CURVE)}
            corners = (self._point(label, node),)
            x.bound = {}
        else:
            corners = (self._point(label, node, Level.OUTPUT),)
            sized = [n for n in [known.value("scale")] if n is not None]
        sizes = [x.compile(n, f"a size of {label}", Level.NUMBER) for n in sized]
        if () in corners or None in sizes:
            return None
        at, point = self._at(label, known.value("at"))
        near = (self.lying.get(place, "") for place in ((at,) if at else corners))
        return Shape(
            name, kind, tuple(n for n in sizes if n is not None), corners, at,
            self._axes(label, known.value("frame")),
            point or next(filter(None, near), ""), tuple(n.place for n in sized),
        )  # fmt: skip

    def _sized(self, label: str, node: Node, counts: tuple[int, ...]) -> list[Node]:
        """Return the YAML nodes of a shape's sizes, one per number; [] after a fault.

        A single size may be written without a list.

        label : name in messages.
        node : the value of the key in the file.
        counts : the permitted numbers of sizes.
        """
        if counts == (1,):
            return [node]
        given, expected = items(node, label, self.faults), " or ".join(map(str, counts))
        if isinstance(node, Sequence) and len(given) not in counts:
            text = f"{label} has {expected} numbers, found {len(given)}"
            self.faults.add(WRONG_COUNT, text, node)
            return []
        if isinstance(node, Scalar) and node.empty:
            text = f"{label} must be a list, found nothing"
            self.faults.add(NOT_A_LIST, text, node, "such as [1, 2]")
        return given

    def _corners(
        self, label: str, node: Node, least: int
    ) -> tuple[tuple[int, ...], ...]:
        given = items(node, label, self.faults)
        if not least <= len(given) <= MOST_CORNERS and isinstance(node, Sequence):
            text = f"{label} has {least} to {MOST_CORNERS} corners, found {len(given)}"
            hint = "each corner is a list [x, y]"
            self.faults.add(WRONG_COUNT, text, node, hint)
            given = []
        return tuple(self._point(f"a corner of {label}", n) for n in given) or ((),)

    def _at(self, label: str, node: Node | None) -> tuple[tuple[int, ...], str]:
        """Return the graph nodes of a shape's origin, and its point's name or "".

        label : the shape's name in messages.
        node : the value of `at`, a point of the scene or a list of expressions.
        """
        if node is None or isinstance(node, Broken):
            return (), ""
        if not isinstance(node, Scalar) or re.search(r"[^\w. ]", node.text):
            return self._point(f"`at` of {label}", node), ""
        if self._is_point(node) and node.text in self.points:
            return self.points[node.text], node.text
        return (), ""

    def _axes(self, label: str, node: Node | None) -> tuple[int, ...]:
        """Return the graph nodes of a shape's rotation matrix, row by row.

        node : the value of `frame`, an angle or rows of a matrix.
        """
        x, label = self.x, f"`frame` of {label}"
        if isinstance(node, Sequence):
            rows = [items(row, f"a row of {label}", x.faults) for row in node.items]
            if len(rows) not in (2, 3) or any(len(row) != len(rows) for row in rows):
                text = f"{label} is an angle, or 2 or 3 rows of as many entries each"
                hint = "such as [[cos(a), -sin(a)], [sin(a), cos(a)]]"
                x.faults.add(WRONG_COUNT, text, node, hint)
                return ()
            found = [x.compile(n, label, Level.VELOCITY) for row in rows for n in row]
            return () if None in found else tuple(n for n in found if n is not None)
        angle = x.compile(node, label, Level.VELOCITY)
        if angle is None:
            return ()
        cos, sin = x.graph.call("cos", angle), x.graph.call("sin", angle)
        return cos, x.graph.call("neg", sin), sin, cos


def check_sizes(scene: Scene, x: Expressions) -> None:
    """Report sizes of shapes, and lengths of strings, that are negative or not finite.

    They are evaluated at the present values of parameters.
    """
    numbers = {name: value for name, (value, _) in x.known.items()}

    def check(
        nodes: SequenceType[int], places: SequenceType[Place], label: str, *, size: bool
    ) -> None:
        if not x.graph.depends(nodes) <= numbers.keys():
            return  # a parameter without a value is reported
        values = evaluate(x.graph, nodes, numbers)
        for value, place in zip(values, places, strict=True):
            if x.is_finite(value, label, place) and size:
                x.within(value, label, place, 0.0)

    for shape in scene.shapes:
        label, size = (
            f"a size of the {shape.kind} `{shape.name}`",
            SHAPES[shape.kind].sizes,
        )
        check(shape.sizes, shape.places, label, size=bool(size))
    for length in filter(None, dict.fromkeys(scene.lengths)):
        check([length.node], [length.place], STRING_LENGTH, size=True)
