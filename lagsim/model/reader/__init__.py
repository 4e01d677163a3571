"""Read a model file into a Model; the only package that knows the file format.

`read` processes the sections in the order of their dependences. Each section reports
its faults and returns its sound entries; at the end all faults are raised together. An
entry that depends on a faulty one is skipped without a message, so that each fault is
reported once.
"""

from __future__ import annotations

import hashlib
import re
from contextlib import nullcontext
from copy import copy
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

from lagsim import limits
from lagsim.codes.known import (
    BAD_MODEL_NAME,
    EMPTY_FILE,
    EXPRESSION_RANGE,
    FORMAT_VERSION,
    MISPLACED_KEY,
    MISSING_KEY,
    MULTIPLE_ROOT,
    UNKNOWN_KEY,
    UNUSED_TABLE,
    USAGE,
    VELOCITY_NOT_ALLOWED,
)
from lagsim.errors import InputError, unseen, unusable
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.model.loading import STDIN, TEXT, load, model_text
from lagsim.model.model import (
    APPROACH_SPEED,
    SLIP_SPEED,
    Coordinate,
    Gimbal,
    Level,
    Model,
    TurningFrame,
)
from lagsim.model.nodes import (
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    argument,
    entries_of,
    leaves,
    words_below,
)
from lagsim.model.reader import equations, runs, values
from lagsim.model.reader.constraints import (
    declared_constraints,
    laws_at_values,
    read_constraints,
)
from lagsim.model.reader.expressions import Expressions
from lagsim.model.reader.fields import (
    BODY,
    FRAME,
    OUTPUT_KEYS,
    RESERVED,
    SCENE,
    SECTIONS,
    SIMULATION,
    Faults,
    belongs,
    entries,
    fields,
    has_key,
    in_one_line,
    is_mapping,
    schema,
)
from lagsim.model.reader.names import NameKind, Names, check_columns
from lagsim.model.reader.quantities import is_unit
from lagsim.model.reader.runs import check_sizes, read_scene
from lagsim.model.reader.values import STARTED, Definitions

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable
    from collections.abc import Mapping as MappingType
    from contextlib import AbstractContextManager

    from lagsim.language.parser import Parsed
    from lagsim.model.expansion import Expansion
    from lagsim.model.expansion.frames import TurnedFrame
    from lagsim.model.model import Mismatch, NumberPlaces, Settings, Table

__all__ = ["TEXT", "read", "read_file", "schema"]

VERSION = "1"
_NO_FILE_NAMES = ("", ".", "..")
# The sections that give names of variables, in the order in which they are read.
NAMED = {
    "parameters": NameKind.PARAMETER,
    "modes": NameKind.MODE,
    "coordinates": NameKind.COORDINATE,
    "states": NameKind.STATE,
    "definitions": NameKind.DEFINITION,
    "tables": NameKind.TABLE,
}


def read_file(
    path: str,
    overrides: MappingType[str, str] | None = None,
    options: MappingType[str, str] | None = None,
) -> Model:
    """Read a model file, or standard input for the path `-`.

    Parameters
    ----------
    path, overrides, options
        See `read`.

    Raises
    ------
    InputError
        If the file cannot be read, or with every fault in it.
    """
    text, file = model_text(path)
    return read(text, file, overrides, options)


def read(
    text: str,
    file: str,
    overrides: MappingType[str, str] | None = None,
    options: MappingType[str, str] | None = None,
) -> Model:
    """Read the text of a model file and return its model.

    Parameters
    ----------
    text
        The text of the file.
    file
        The file's name in messages; its stem is the model's name by default.
    overrides
        Expressions that replace those of parameters and start values in the file
        (`--set name=expression`).
    options
        Expressions that replace those of keys of `simulation`, such as `{"output_step":
        "0.1"}` (`--output-step 0.1`). `duration` replaces `end` too.

    Raises
    ------
    InputError
        With every fault, in the order of the file.
    """
    document = load(text, file)
    faults = Faults(file, document.problems)
    if document.root is None:
        faults.raise_if_any()
        raise unusable(EMPTY_FILE, f"{file}: the file is empty")
    data = text.encode(errors="surrogatepass")
    graph = Graph(limits.graph_nodes(len(data)), limits.work(len(data)))
    root = document.root
    found = File(root, file, faults, graph, overrides or {}, options or {})
    return found.read(hashlib.sha256(data).hexdigest())


class File:
    """Binding of a model file: the file with expressions that replace some of its own.

    The graph and its expressions, built of names alone, are shared with the other
    bindings of the file; only the numbers are evaluated again.

    Parameters
    ----------
    root : Node
        The root YAML node of the file.
    file : str
        The name of the file in messages.
    faults : Faults
        Receives the faults.
    graph : Graph
        The graph on which expressions are built.
    overrides, options
        See `read`.
    gathers : bool
        Whether long sums may become elements, see `language.elements`.

    Attributes
    ----------
    x : Expressions
        Expressions of the file: graph, definitions, and this binding's values.
    instead, starting, options : dict of str to str
        Expressions that replace those of the file, for parameters, start values and
        keys of `simulation`.
    """

    def __init__(
        self,
        root: Node,
        file: str,
        faults: Faults,
        graph: Graph,
        overrides: MappingType[str, str],
        options: MappingType[str, str],
        *,
        gathers: bool = True,
    ) -> None:
        self.file, self.gathers = file, gathers
        self._given = node = _in_place(root, faults)
        self.expansion: Expansion | None = None
        reading, broken = None, set[str]()
        top = fields(node, "the file", SECTIONS, faults, node.place)
        if not top.sound:
            faults.raise_if_any()
        if has_members(node):
            from lagsim.model.expansion import Expansion

            faults.once = set()
            meant = ((k._replace(text=name), v) for name, (k, v) in top.found.items())
            node = Mapping(tuple(meant), node.place)
            built_in = (*RESERVED, SLIP_SPEED, APPROACH_SPEED)
            written = Expansion(
                node, overrides, faults.add, is_unit, graph, built_in, gathers=gathers
            )
            node, reading, broken = written.node, written.plain, written.broken
            self.expansion = written
            top = replace(top, found={k.text: (k, v) for k, v in entries_of(node)})
        self.node, self.root, self.top = node, node.place, top
        for section, one, keys in (
            ("frames", "frame", FRAME),
            ("bodies", "body", BODY),
        ):
            for key, below in entries(top.value(section), f"`{section}`", faults):
                if one == "body" or not isinstance(below, Scalar):
                    fields(below, f"the {one} `{key.text}`", keys, faults, key.place)
        self.energy = equations.energy_fields(top)
        self.names = names = Names("lagrangian" in self.energy)
        names.faulty |= broken
        names.broken = broken
        for _, value in top.unknown:
            names.faulty |= {name.text for name, _ in entries_of(value)}
        self.x = x = Expressions(graph, names, faults)
        x.reading = reading
        # All expressions, until their units are checked; shared by all bindings.
        self._expressions = x.read
        self._units: list[list[Mismatch]] = []
        self.options = options
        self.shifts: MappingType[str, tuple[int, float]] = {}
        version = top.text("lagsim")
        if "lagsim" in top and version != VERSION:
            text = f"the format version must be {VERSION}, found `{version}`"
            faults.add(FORMAT_VERSION, text, top.at("lagsim"))
        self.name = self._name()
        sections = (
            names.section(top.value(key), f"`{key}`", kind, faults)
            for key, kind in NAMED.items()
        )
        self.parameters, self.modes, self.coordinates, *others = sections
        if broken:  # definitions with faults
            given = entries(top.value("coordinates"), "`coordinates`", faults)
            values.read_coordinates([e for e in given if e[0].text in broken], x)
        self.states, self.definitions, self.tables = others
        self.constraints = declared_constraints(top.value("constraints"), x)
        self._check_names()
        names.reactions += runs.listed_reactions(top.value("output"))
        self.initial = top.found.get("initial")
        names.started |= {key.text for key, _ in entries_of(top.value("initial"))}
        self.simulation = top.below("simulation", SIMULATION)
        meanings = {name: names.meaning(name) for name in overrides}
        starting = {k for k, m in meanings.items() if m and m.kind in STARTED}
        self.starting = {k: t for k, t in overrides.items() if k in starting}
        self.instead = {k: t for k, t in overrides.items() if k not in starting}

    def rewritten(self, values: MappingType[str, float]) -> str:
        """Return the text of the file with other values, see `model.model.Stated`."""
        from lagsim.model.reader.rewriting import rewritten

        for text in rewritten(self.node, values):
            try:
                model = read(text, self.file)
            except InputError:
                continue
            numbers = model.parameter_values
            numbers |= {x.name: x.value for x in model.initial}
            if all(numbers.get(name, x) == x for name, x in values.items()):
                return text
        text = "the values of its families cannot be written one by one"
        raise unusable(USAGE, f"{self.file}: {text}")

    def read(self, sha256: str) -> Model:
        """Return the model of the file.

        sha256 : digest of the text of the file.

        Raises
        ------
        InputError
            With every fault.
        """
        top, x, made = self.top, self.x, self.expansion
        functions: tuple[Table, ...] = ()
        if self.tables:
            from lagsim.model.reader.tables import read_tables

            functions = read_tables(self.tables, x, self.file, self.shifts)
        read = values.ParameterReader(x, self.instead).read
        parameters = read(self.parameters, self.modes)
        coordinates = values.read_coordinates(self.coordinates, x)
        with self._gathering():
            definitions = Definitions(self.definitions, x)
        for name, at in (made.moving if made else {}).items():
            if name in x.definitions and x.definitions[name].level > Level.POSITION:
                text = "the place of a body, or an angle, must not depend on "
                text += x.definitions[name].level.text
                place = at.place_of(0, len(at.text))
                x.faults.add(VELOCITY_NOT_ALLOWED, text, place)
        definitions.build(Level.POSITION, Level.VELOCITY)
        states = equations.read_states(self.states, x)
        energies = equations.read_energies(self.energy, x, self._gathering)
        definitions.build(Level.OUTPUT)
        forces = equations.read_forces(top.value("forces"), x)
        constraints = read_constraints(self.constraints, x)
        initial = values.Initial(x, self.starting).read(self.initial, self.root)
        runs.read_settings(self.simulation, self.options, x)
        until = self.simulation.value("until")
        relation, _ = equations.read_relation(until, "`until`", x, modes=True)
        events = equations.read_events(self.top.value("events"), x)
        scene = read_scene(top.below("scene", SCENE), x)
        output = runs.read_output(top.below("output", OUTPUT_KEYS), x)
        description, source = top.text("description"), top.text("source")
        if made and made.silent and not len(x.faults):
            key = made.silent[0]
            text = f"the range of `{key.text}` depends on itself"
            x.faults.add(EXPRESSION_RANGE, text, key)
        x.faults.raise_if_any()
        for name in self.names.tables.keys() - self.names.called:
            text = f"the table `{name}` is not used"
            hint = f"call it as `{name}(...)`, or delete it"
            x.faults.add(UNUSED_TABLE, text, self.names.places[name], hint)
        x.faults.raise_if_any()
        assert energies.lagrangian is not None
        x.read = []
        places = {name: node.place for name, (_, node) in self.energy.found.items()}
        named = made.scope.used | self.structural() if made else words_below(self.node)
        recorded = {mode for event in events for mode, _ in event.sets}  # columns
        return Model(
            name=self.name,
            file=self.file,
            sha256=sha256,
            graph=x.graph,
            parameters=parameters,
            unused=tuple(p for p in (*x.known, *x.modes) if p not in named | recorded),
            events=events,
            gimbals=tuple(
                Gimbal(frame, x.build(lock), tuple(map(x.build, angles)))
                for frame, lock, angles in (made.gimbals if made else ())
            ),
            frames=_frames(made.turned, x) if made else (),
            quaternions=frozenset(key.text for key, _ in (made.units if made else ())),
            unused_keys=tuple(made.unused_keys) if made else (),
            places={**self.names.places, **places},
            coordinates=coordinates,
            states=states,
            tables=functions,
            definitions=definitions.read(),
            hidden=definitions.read(hidden=True),
            **energies._asdict(),
            forces=forces,
            constraints=constraints,
            initial=initial,
            until=relation,
            scene=scene,
            output=output,
            stated=self,
            description=description,
            source=source,
        )

    def mismatches(self, model: Model) -> list[Mismatch]:
        """Return the inconsistent units of the file, computed once."""
        if not self._units:
            self._units.append([])
            if any(key.endswith(".unit") for key, _ in leaves(self._given)):
                from lagsim.model.reader.units import mismatches

                self._units[0] += mismatches(model, self._expressions)
            self._expressions.clear()
        return self._units[0]

    def _check_names(self) -> None:
        faults = self.x.faults
        check_columns(self.names, faults)
        if self.names.complete or not self.names.readable:
            return
        if "coordinates" not in self.top or not self.names.faulty:
            place = self.top.place_of("coordinates")
            hint = "such as coordinates: {theta: {unit: rad}}"
            faults.add(MISSING_KEY, "the file has no coordinates", place, hint)

    def _name(self) -> str:
        node, faults = self.top.value("name"), self.x.faults
        if node is None:
            stem = PurePath(self.file).stem
            if self.file == STDIN:
                return "stdin"
            if unseen(stem) or "\n" in stem:
                text = f"the name of the file has {_letter(stem)}"
                hint = "add a `name`, which names the folder of the results"
                faults.add(BAD_MODEL_NAME, text, self.root, hint)
            return stem if stem not in _NO_FILE_NAMES else "model"
        name, fault = self.top.text("name"), ""
        if not isinstance(node, Scalar):
            return name
        if unseen(name):
            fault = f"it has {_letter(name)}, which is not seen"
        elif re.search(r"[/\\]", name):
            fault = "it has a path separator"
        elif re.search(r"[\n\t]", name):
            fault = f"it has {_letter(name)}"
        elif name in _NO_FILE_NAMES and (node.empty or node.text.strip() == name):
            fault = "it is no name of a file"
        if fault:
            text = f"`{in_one_line(name)}` cannot be a name: {fault}"
            hint = "it is used for files: no path separators, such as elastic-pendulum"
            faults.add(BAD_MODEL_NAME, text, node, hint)
        return name

    def bound(
        self,
        model: Model,
        parameters: MappingType[str, str],
        initial: MappingType[str, str],
    ) -> Model:
        """Return a model of this file with other values, see `model.Model.bind`."""
        faults = Faults(self.file)
        old = {name: self.instead.get(name) for name in parameters}
        if any(old[name] != parameters[name] for name in self.structural() & {*old}):
            return self._read_again({**parameters, **initial}).read(model.sha256)
        new = copy(self)
        x = new.x = self.x.over(faults, {})
        new.instead = {**self.instead, **parameters}
        new.starting = {**self.starting, **initial}
        read = values.ParameterReader(x, new.instead).read
        numbers = read(self.parameters, self.modes)
        laws = laws_at_values(model.constraints, self.constraints, x)
        starts = values.Initial(x, new.starting).read(self.initial, self.root)
        check_sizes(model.scene, x)
        events = equations.read_events(self.top.value("events"), x)
        faults.raise_if_any()
        return replace(
            model, parameters=numbers, constraints=laws, initial=starts, events=events,
            stated=new,
        )  # fmt: skip

    def formulas(self) -> dict[str, Parsed]:
        """Return the expressions of parameters, start values and settings, by name.

        See `model.model.Stated`.
        """
        x = self.x.over(Faults(self.file), {})
        parameters = values.ParameterReader(x, self.instead)
        parameters.read(self.parameters, self.modes)
        starts = values.Initial(x, self.starting)
        starts.read(self.initial, self.root)
        found = {**parameters.formulas, **starts.formulas}
        for key in runs.NUMBERS:
            read = x.text(self.simulation.value(key), f"`{key}`", parse)
            if read is not None:
                found[f"simulation.{key}"] = read[1]
        return found

    def places(self) -> NumberPlaces:
        """Return where the file has its numbers, see `model.model.Stated`."""
        from lagsim.model.reader.rewriting import places

        return places(self.node)

    def compiled(self, text: str, option: str) -> int:
        """Return the node of an expression of columns, see `model.model.Stated`."""
        faults = Faults(self.file)
        x = self.x.over(faults, self.x.known)
        found = x.compile(argument(option, text), "the expression", Level.OUTPUT)
        faults.raise_if_any()
        assert found is not None
        return found

    def shifted(self, model: Model, table: str, point: int, part: float) -> Model:
        """Return a model of this file with one value of a table changed.

        See `model.model.Stated`.
        """
        again = self._read_again({})
        again.shifts = {table: (point, part)}
        return again.read(model.sha256)

    def written_out(self, model: Model) -> Model:
        """Return a model of this file without elements, see `model.model.Stated`."""
        again = self._read_again({}, gathers=False)
        again.shifts = self.shifts
        return again.read(model.sha256)

    def _gathering(self, energy: str = "") -> AbstractContextManager[None]:
        """Context manager: read long sums of expressions as elements.

        energy : the key of the energy whose expression is read; "" for definitions.
        """
        if self.expansion is None:
            return nullcontext()
        from lagsim.model.expansion.gathering import DEFINED, OF_ENERGIES

        permitted = OF_ENERGIES.get(energy) if energy else DEFINED
        return self.expansion.scope.gathering(permitted)

    def _read_again(
        self, given: MappingType[str, str], *, gathers: bool | None = None
    ) -> File:
        """Return the file read anew on a new graph, with more expressions replaced.

        given : expressions of parameters by name.
        gathers : whether sums may be elements; by default as in this file.
        """
        gathers = self.gathers if gathers is None else gathers
        graph = Graph(limits.graph_nodes(0), limits.work(0))
        every = {**self.instead, **self.starting, **given}
        faults = Faults(self.file)
        return File(
            self._given, self.file, faults, graph, every, self.options, gathers=gathers
        )

    def structural(self) -> set[str]:
        """Return the parameters on which ranges and subscripts depend."""
        return self.expansion.scope.structural if self.expansion else set()

    def settings(self, options: MappingType[str, str]) -> Settings:
        """Return the settings of the run, see `Model.settings`."""
        faults = Faults(self.file)
        x = self.x.over(faults, self.x.known)
        options_given = {**self.options, **options}
        found = runs.read_settings(self.simulation, options_given, x)
        faults.raise_if_any()
        return found

    # The expressions in the file

    def _numbers(self) -> dict[str, Node]:
        """Return the YAML nodes of the values of parameters, modes and start values.

        The result maps each name to its node; expressions that replace the expressions
        of the file are included.
        """
        starts = entries_of(self.top.value("initial"))
        own = (*self.parameters, *self.modes, *starts)
        given = {key.text: node for key, node in own}
        instead = {**self.instead, **self.starting}
        return given | {name: argument("", text) for name, text in instead.items()}

    def numbers(self) -> list[str]:
        """Return the texts of the expressions of parameters and start values."""
        found = (leaf for node in self._numbers().values() for leaf in leaves(node))
        return [n.text for name, n in found if name in ("", ".value", ".guess")]

    def depends_on(self, names: Collection[str]) -> bool:
        """Whether further numbers depend on some names, see `Stated.depends_on`."""
        settings = {key: node for key, (_, node) in self.simulation.found.items()}
        settings |= {key: argument("", text) for key, text in self.options.items()}
        if not self.structural().isdisjoint(names):
            return True
        given = {**self._numbers(), **settings}
        others = (node for name, node in given.items() if name not in names)
        return not words_below(*others).isdisjoint(names)

    def texts(self) -> dict[str, Scalar]:
        """Return the texts of the model's expressions, by keys such as `forces.x`.

        The sections are definitions, states, energies, forces, constraints and events.
        """
        below = {
            "definitions": self.definitions,
            "states": self.states,
            "energy": self.energy.found.values(),
            "forces": entries_of(self.top.value("forces")),
            "constraints": self.constraints,
            "events": entries_of(self.top.value("events")),
        }
        return {
            f"{section}.{key.text}{name}": text
            for section, found in below.items()
            for key, node in found
            for name, text in leaves(node)
        }

    # The model read again with some of its definitions as coordinates of their own
    #
    # Definitions are separated by name: where the file has `x`, so has the separated
    # model, and where it has the expression of `x`, so has the separated model.

    def separated(self, model: Model) -> tuple[Model, dict[str, int]]:
        """Return `model` with definitions as coordinates, see `Stated.separated`."""
        old = self.x
        of_names = dict.fromkeys(model.output.reactions, NameKind.COORDINATE)
        names = replace(old.names, variables={**old.names.variables, **of_names})
        faults = Faults(model.file)
        x = Expressions(old.graph, names, faults)
        x.known, x.reading = old.known, old.reading
        Definitions(self.definitions, x).build(Level.POSITION, Level.VELOCITY)
        states = equations.read_states(self.states, x)
        energies = equations.read_energies(self.energy, x)
        forces = equations.read_forces(self.top.value("forces"), x)
        constraints = read_constraints(self.constraints, x)
        faults.raise_if_any()
        units = {d.name: d.unit for d in model.definitions}
        assert energies.lagrangian is not None
        found = replace(
            model,
            coordinates=(
                *model.coordinates,
                *(Coordinate(n, units[n]) for n in of_names),
            ),
            forces=forces,
            constraints=constraints,
            states=states,
            frames=(),
            **energies._asdict(),
        )
        _check_roots(model, found)
        nodes = ((name, x.definitions[name].node) for name in of_names)
        return (found, {k: n for k, n in nodes if n is not None})


def _frames(given: Iterable[TurnedFrame], x: Expressions) -> tuple[TurningFrame, ...]:
    """Return the frames `given` with graph nodes in place of their expressions."""

    def built(vector: tuple[Parsed, ...]) -> tuple[int, ...]:
        return tuple(map(x.build, vector))

    return tuple(
        TurningFrame(
            f.parent,
            tuple(map(built, f.rows)),
            tuple(map(built, f.turn)),
            built(f.own),
            built(f.omega),
        )
        for f in given
    )


# A range, a vector, or a section with families, anywhere in a file.
_OF_MEMBERS = re.compile(
    r"[\w)]\s*\.\.\s*[\w(-]|\b(?:vec|spin)\s*\(|\bcomponents\s*:"
    r"|^(?:frames|bodies|gravity)\s*:",
    re.MULTILINE,
)
# Lengths of a list that is a vector; six numbers are a matrix of inertia.
_SIZES = (2, 3, 6)


def has_members(root: Node) -> bool:
    """Whether a file has families or vectors."""
    top = {key.text: node for key, node in entries_of(root)}
    for section in ("parameters", "definitions", "forces"):
        for _, node in entries_of(top.get(section)):
            value = next((v for k, v in entries_of(node) if k.text == "value"), node)
            if isinstance(value, Sequence) and len(value.items) in _SIZES:
                return True
    first = next(iter(entries_of(root)), None)
    return first is not None and bool(_OF_MEMBERS.search(first[0].source.text))


def _letter(name: str) -> str:
    """Return the description of the first invisible letter in a text, for messages."""
    if letter := unseen(name):
        return f"the letter U+{ord(letter):04X}"
    return "a line break" if "\n" in name else "a tab"


def _check_roots(model: Model, found: Model) -> None:
    """Refuse constraints whose multipliers differ in the separated model.

    model : the model.
    found : the separated model, see `Stated.separated`.
    """
    g = model.graph
    new = {g.variable(d.name): d.node for d in model.definitions}
    for one, other in zip(model.constraints, found.constraints, strict=True):
        if not one.relation.multiple and not other.relation.multiple:
            continue
        if g.substitute([other.relation.node], new) != [one.relation.node]:
            text = f"`{one.name}` vanishes as a power, with its gradient; its "
            text += "multiplier does not give the definitions in `output.reactions` "
            text += "a reaction"
            hint = "write the relation with a simple zero"
            raise unusable(MULTIPLE_ROOT, text, one.relation.place, hint)


# --- Sections in sections, keys of sections beside them: wrong indentation
#
# A misplaced key is reported once, and read as if it were in its right place, so that
# it is not also reported as missing or unknown.

# Keys of the mapping of a name, whose name may be that of a section.
_OWN = {"value", "unit", "description", "guess", "relation"}


def _in_place(root: Node, faults: Faults) -> Node:
    """Return the file with misplaced keys moved to their sections; each is reported."""
    if not isinstance(root, Mapping):
        return root
    top = {key.text: (key, value) for key, value in root.entries}
    _move_to_top(top, faults)
    for name in filter(_is_stranger, [*top]):
        key, value = top[name]
        section = next((section for section in SECTIONS if has_key(section, name)), "")
        if (
            section
            and not isinstance(value, Mapping)
            and _move_to_section(top, [name], section)
        ):
            text = f"unknown key `{name}` in the file"
            faults.add(UNKNOWN_KEY, text, key, belongs(name))
    for section, names in _unindented(top, faults).items():
        first = top[names[0]][0]
        more = f", and {len(names) - 1} more," if len(names) > 1 else ""
        text = f"`{first.text}`{more} below `{section}:` must be indented"
        hint = f"two blanks before each line that belongs to `{section}`"
        if _move_to_section(top, names, section):
            faults.add(MISPLACED_KEY, text, first.place, hint)
    return root._replace(entries=tuple(top.values()))


def _is_stranger(name: str) -> bool:
    return name not in SECTIONS and not name.startswith("x-")


def _move_to_top(top: dict[str, Entry], faults: Faults) -> None:
    """Move sections that are inside other sections to the top."""
    for section, (head, value) in [*top.items()]:
        for entry in entries_of(value) if section in SECTIONS else ():
            key, node = entry
            own = _OWN.isdisjoint(name.text for name, _ in entries_of(node))
            nested = key.text in SECTIONS.keys() - top.keys() and own
            if not (nested and isinstance(node, Mapping)) or has_key(section, key.text):
                continue
            text = f"the section `{key.text}` is inside `{section}`"
            faults.add(MISPLACED_KEY, text, key, belongs(key.text))
            top[key.text] = entry
            kept = (e for e in entries_of(top[section][1]) if e is not entry)
            top[section] = head, Mapping(tuple(kept), value.place)


def _move_to_section(top: dict[str, Entry], names: list[str], section: str) -> bool:
    """Move the entries `names` of the file into a section, created if it is absent.

    Return False if the section is no mapping, or already has one of the names.

    top : the entries of the file by key.
    """
    first = top[names[0]][0]
    new = first._replace(text=section, style=""), Mapping((), first.place)
    head, value = top.get(section, new)
    old = value if isinstance(value, Mapping) else new[1]
    if not is_mapping(value) or {key.text for key, _ in old.entries} & {*names}:
        return False
    moved = [top.pop(name) for name in names]
    top[section] = head, old._replace(entries=(*old.entries, *moved))
    return True


def _unindented(top: dict[str, Entry], faults: Faults) -> dict[str, list[str]]:
    """Return the keys that follow an empty section without indentation, by section.

    top : the entries of the file by key.
    """
    section = ""
    found: dict[str, list[str]] = {}
    for name, (_, value) in top.items():
        if name in SECTIONS:
            empty = isinstance(value, Scalar) and value.empty
            text = SECTIONS[name].get("type") == "string"
            section = name if empty and not text else ""
        elif section and _is_stranger(name):
            if faults.guess(name, SECTIONS):
                section = ""
            else:
                found.setdefault(section, []).append(name)
    return found
