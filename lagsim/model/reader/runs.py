"""Reader of the sections `simulation` and `output`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.methods import options
from lagsim.model.model import (
    DEFAULT_ROWS,
    Curve,
    Level,
    Output,
    Plot,
    Section,
    Settings,
)
from lagsim.model.nodes import (
    Broken,
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
from lagsim.model.reader.expressions import Kind, check_name
from lagsim.model.reader.fields import (
    AXES,
    MOST_CURVES,
    PLOT,
    RESERVED,
    SECTION,
    Fields,
    entries,
    fields,
    items,
    kind_of,
    listed,
    named,
)
from lagsim.tolerances import SAME_STEP, SHORTEST_RUN

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from collections.abc import Mapping as MappingType

    from lagsim.errors import Place
    from lagsim.model.reader.expressions import Expressions, Names

MAX_ROWS = 10**8
# Keys of one time.
TIMES = ("duration", "end", "output_step", "step")
# What the start is: what `initial` states, with guesses solved for it, or at rest.
BEGIN = ("initial", "rest")

# --- When to start and stop, how finely, and how to integrate


def read_settings(
    section: Fields, instead: MappingType[str, str], x: Expressions
) -> Settings:
    """Give the section `simulation`, with what replaces its keys."""
    given = dict(section.found)
    if "duration" in instead:
        given.pop("end", None)
    for key, text in instead.items():
        value = argument(f"--{key.replace('_', '-')} ", text)
        given[key] = value, value
    return _Simulation(replace(section, found=given), x).read()


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
            self._fault("out-of-range", "`rtol` is 0 without an `atol`", "rtol", hint)
        elif rtol == 0 and atol == 0:
            self._fault("out-of-range", "`rtol` and `atol` are both 0", "atol")
        step, gain = (self._number(key, positive=True) for key in ("step", "gain"))
        own = ((k, self._number(k, o.least, o.most)) for k, (_, o) in options().items())
        places = {key: given.at(key) for key in given.found}
        asked = Settings(
            rtol=rtol, atol=atol, step=step, gain=gain,
            method=self._name("method", "see `lagsim methods`"),
            formulation=self._name("formulation", "see docs/model-file.md"),
            method_place=places.get("method"),
            formulation_place=places.get("formulation"),
            options=tuple((k, v) for k, v in own if v is not None),
            rest=given.choice("begin", BEGIN, "unknown-begin") == "rest",
        )  # fmt: skip
        if start is None or end is None:
            return asked._replace(start=start or 0.0, end=start or 0.0)
        if output_step is None:
            output_step = (end - start) / DEFAULT_ROWS
        self._check_rows(end - start, output_step)
        return asked._replace(start=start, end=end, output_step=output_step)

    def _fault(self, code: str, text: str, key: str, hint: str = "") -> None:
        self.x.faults.add(code, text, self.given.at(key), hint)

    def _number(
        self,
        key: str,
        least: float = -math.inf,
        most: float = math.inf,
        *,
        positive: bool = False,
    ) -> float | None:
        """Give a number that must be from `least` to `most`, or `positive`."""
        node, x, what = self.given.value(key), self.x, f"`{key}`"
        if node and key in TIMES and (hint := quantities.time(node)):
            text = f"{what} must be one time, found {kind_of(node)}"
            self._fault("not-an-expression", text, key, hint)
            return None
        return x.number(node, what, least, most, positive=positive)

    def _end(self, start: float | None) -> float | None:
        key = "duration" if "duration" in self.given else "end"
        if key == "duration" and "end" in self.given:
            text, place = "both `duration` and `end` are", self.given.place_of("end")
            self.x.faults.add("both-given", f"{text} given", place)
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
            self._fault("out-of-range", text, key)
        return None if text else end

    def _name(self, key: str, hint: str) -> str:
        name = self.given.text(key)
        if not name and isinstance(self.given.value(key), Scalar):
            self._fault("empty", f"`{key}` must be a name, found nothing", key, hint)
        return name or "auto"

    def _check_rows(self, length: float, output_step: float) -> None:
        count = length / output_step
        if count < 1 - SAME_STEP:
            text = f"`output_step` is {output_step:g}, longer than the run, {length:g}"
            self._fault("out-of-range", text, "output_step")
        elif count == math.inf or math.ceil(count - SAME_STEP) + 1 > MAX_ROWS:
            rows = "infinitely many"
            if count < math.inf:
                whole = math.ceil(count - SAME_STEP) + 1
                rows = str(whole) if whole < 10**15 else f"{count:.3g}"
            text = f"`output_step` {output_step:g} makes {rows} rows, more than 10^8"
            hint = f"{length / DEFAULT_ROWS:g} makes {DEFAULT_ROWS + 1}"
            self._fault("too-many-rows", text, "output_step", hint)


# --- What to write


def read_output(found: Fields, x: Expressions) -> Output:
    """Give the columns and the plots asked for."""
    columns = tuple(x.names.of(Kind.DEFINITION))
    node = found.value("columns")
    named = items(node, "`columns`", x.faults)
    if isinstance(node, Sequence):
        hint = "coordinates are columns in any case"
        columns = tuple(_definitions(named, "column", hint, x))
    elif isinstance(node, Scalar) and node.empty:
        text = "`columns` must be a list, found nothing"
        hint = "[] means none; without the key there are all"
        x.faults.add("not-a-list", text, node, hint)
    plots = (_plot(p, x) for p in items(found.value("plots"), "`plots`", x.faults))
    return Output(
        columns,
        tuple(plot for plot in plots if plot),
        gauss=found.truth("gauss"),
        action=found.truth("action"),
        reactions=_reactions(found.value("reactions"), x),
        event_marks=found.truth("event_marks", default=True),
        sections=tuple(_sections(found.value("sections"), columns, x)),
    )


DIRECTIONS = ("both", "up", "down")


def _sections(
    node: Node | None, columns: tuple[str, ...], x: Expressions
) -> Iterator[Section]:
    for key, value in entries(node, "`sections`", x.faults):
        what = f"the section `{key.text}`"
        below = fields(value, what, SECTION, x.faults, key.place)
        if not check_name(key, "a section", x.faults) or not below.sound:
            continue
        hint = "write {at: x = 0, direction: up}, or {every: 2*pi/w}"
        if not below.either("at", "every", hint, key.place):
            continue
        relation, equality = read_relation(
            below.value("at"), f"`at` of {what}", x, modes=True
        )
        if equality is False:
            text, hint = f"`at` of {what} must be an equality", "such as x = 0"
            x.faults.add("not-an-equality", text, below.place_of("at"), hint)
        direction = below.choice("direction", DIRECTIONS)
        if "every" in below and "direction" in below:
            text = f"{what} has both `every` and `direction`: times have none"
            x.faults.add("both-given", text, below.place_of("direction"))
        every = x.compile(below.value("every"), f"`every` of {what}", Level.NUMBER)
        plot = tuple(_axes_of(below, columns, x))
        at = None if relation is None else relation.node
        yield Section(key.text, at, every, direction, plot, key.place)


def _axes_of(below: Fields, columns: tuple[str, ...], x: Expressions) -> Iterator[str]:
    """Give the two columns that a picture of a section is asked to show."""
    given = items(below.value("plot"), "`plot`", x.faults)
    if given and len(given) != len(("right", "up")):
        text = f"`plot` of a section names two columns, found {len(given)}"
        x.faults.add("wrong-count", text, below.place_of("plot"), "such as [y, y_dot]")
        return
    for part in named(given, "`plot` names columns", x.faults):
        meaning = x.names.meaning(part.text)
        hidden = meaning is not None and meaning.kind is Kind.DEFINITION
        hidden &= part.text not in columns
        if meaning is None or hidden or meaning.kind in (Kind.PARAMETER, Kind.PI):
            text = f"there is no column `{part.text}`"
            hint = x.faults.did_you_mean(part.text, [*x.names.moving(), *columns])
            x.faults.add("unknown-name", text, part, hint)
        else:
            yield part.text


def asked_reactions(section: Node | None) -> list[str]:
    """Give the names that `reactions` lists, sound or not: definitions may use them."""
    lists = (v for k, v in entries_of(section) if k.text == "reactions")
    return [name for node in lists for name in texts_of(items_of(node))]


def _reactions(node: Node | None, x: Expressions) -> tuple[str, ...]:
    """Give the definitions of positions and time that a list names."""
    given = items(node, "`reactions`", x.faults)
    hint = "what constraints do to a coordinate is Qc_<name>"
    found = []
    for name, place in _definitions(given, "reaction", hint, x).items():
        definition = x.definitions.get(name)
        if definition is None or definition.node is None:
            continue  # faulty itself, and reported
        states = set(x.names.of(Kind.STATE)) & x.graph.depends([definition.node])
        if definition.level is Level.POSITION and not states:
            found.append(name)
            continue
        what = "states" if states else definition.level.text
        text = f"`{name}` has no reaction: it depends on {what}"
        hint = "a reaction holds a definition of positions and time to what it is"
        x.faults.add("no-reaction", text, place, hint)
    return tuple(found)


def _definitions(
    given: Iterable[Node], what: str, hint: str, x: Expressions
) -> dict[str, Place]:
    """Give the definitions that items of a list name; `hint` is for coordinates."""
    names, faults = x.names, x.faults
    found: dict[str, Place] = {}
    for item in named(given, f"a {what} is the name of a definition", x.faults):
        name, place = item.text, item.place
        kind = names.variables.get(name)
        if name in found:
            text = f"the {what} `{name}` is given twice"
            faults.add(f"duplicate-{what}", text, place)
        elif kind is Kind.DEFINITION:
            found[name] = place
        elif kind is not None or names.meaning(name) or name in RESERVED:
            text, more = _no_definition(name, what, hint, names)
            faults.add("not-a-definition", text, place, more)
        elif name not in names.faulty and names.complete:
            near = faults.did_you_mean(name, names.of(Kind.DEFINITION))
            near = near or f"define it in `definitions`: {name}: ..."
            faults.add("unknown-name", f"there is no definition `{name}`", place, near)
    return found


def _no_definition(name: str, what: str, hint: str, names: Names) -> tuple[str, str]:
    """Say that a name of something else is none of a definition, with a hint."""
    meaning = names.meaning(name)
    text = f"`{name}` is {meaning.kind.text if meaning else 'a column of results'}"
    columns = {Kind.VELOCITY, Kind.ENERGY, Kind.TIME, Kind.REACTION}
    columns |= {Kind.STATE, Kind.STATE_RATE}
    if meaning is None or meaning.kind in columns:
        hint = "leave it out: it is a column in any case"
    elif meaning.kind is not Kind.COORDINATE:
        hint = f"define it: {name}_given: {name}, and name that"
    return f"{text}; {what}s are definitions", hint


def _plot(node: Node, x: Expressions) -> Plot | None:
    if isinstance(node, Broken):
        return None
    shown = entries_of(node)
    if 0 < len(shown) < 3 and not any(hints.text_of(value) for _, value in shown):
        node = Sequence(tuple(key for key, _ in shown), node.place)
    found = fields(node, "a plot", PLOT, x.faults, node.place)
    found.needs("x", "write `x: t` for a curve against time")
    found.needs("y", f"such as `y: {next(iter(x.names.moving()), 'theta')}`")
    right, up, other = (_curves(found.value(axis), axis, x) for axis in AXES)
    title, log = found.text("title"), frozenset(_axes(found, x))
    return Plot(right[0], up, other, log, title) if right and up else None


def _curves(node: Node | None, axis: str, x: Expressions) -> tuple[Curve, ...]:
    """Give the expressions of an axis; to the right there is one."""
    nodes: tuple[Node, ...] = () if node is None else (node,)
    if isinstance(node, Sequence) and axis != "x":
        nodes, count = node.items, len(node.items)
        if not 1 <= count <= MOST_CURVES:
            text = f"`{axis}` of a plot has 1 to {MOST_CURVES} curves, found {count}"
            x.faults.add("wrong-count", text, node, "make more plots of them")
    found = []
    for part in nodes:
        compiled = x.compile(part, f"`{axis}` of the plot", Level.OUTPUT)
        if compiled is not None and isinstance(part, Scalar):
            found.append(Curve(compiled, " ".join(part.text.split())))
    return tuple(found)


def _axes(plot: Fields, x: Expressions) -> Iterator[str]:
    """Give the axes that `log` names."""
    for part in items_of(plot.value("log")):
        hint = "write y, or [x, y] for several"
        if isinstance(part, Broken):
            continue
        if not isinstance(part, Scalar) or part.text not in AXES:
            text = f"`log` names axes, {listed(AXES)}, found {kind_of(part)}"
        elif part.text == "y2" and "y2" not in plot:
            text = "`log` names `y2`, and the plot has none"
            hint = "write y, or give `y2`"
        else:
            yield part.text
            continue
        x.faults.add("unknown-axis", text, part, hint)
