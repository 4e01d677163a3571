"""The model file -> Model; the only place that knows the file format.

`read` goes through the sections in the order in which they need each other. Each
reports its faults and gives what is sound; at the end all faults are raised at once.
What depends on something faulty is passed over in silence, so that one fault is
reported once.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from lagsim import limits
from lagsim.errors import UNSEEN, unseen
from lagsim.language.graph import Graph
from lagsim.model.loading import load
from lagsim.model.model import Level, Model
from lagsim.model.nodes import Broken, Mapping, Node, Scalar
from lagsim.model.reader import drawing, equations, simulation, values
from lagsim.model.reader.expressions import Expressions
from lagsim.model.reader.fields import (
    PLAIN,
    Faults,
    Form,
    described,
    fields,
    is_odd,
    keyed,
    shortened,
)
from lagsim.model.reader.names import Kind, Names, check_columns, naming
from lagsim.model.reader.stated import Sections, Stated
from lagsim.model.reader.values import Definitions
from lagsim.model.text import STDIN, text_of, unusable

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from collections.abc import Mapping as MappingType

    from lagsim.model.reader.fields import Entry


FORMAT_VERSION = "1"
SECTIONS = {
    "lagsim": described("Version of the format; default 1.", {"enum": [1, "1"]}),
    "name": described(
        "What the results are called; default: the file's stem.",
        {**PLAIN, "pattern": rf"^[^/\\\n\t{UNSEEN}]+$", "not": {"enum": [".", ".."]}},
    ),
    "description": described("Plain text.", PLAIN),
    "source": described("Where the model comes from, plain text.", PLAIN),
    "parameters": described(
        "name: expression of the parameters above, or a mapping with `value`.",
        naming(values.VALUE),
    ),
    "coordinates": described(
        "name: {unit: ..., description: ...}; their order is that of the table.",
        values.COORDINATES,
    ),
    "definitions": described(
        "name: expression, in any order; each is a column.",
        naming(values.VALUE),
    ),
    "energy": described("Energies, taken literally.", equations.ENERGY),
    "forces": described("Forces that no energy gives.", equations.FORCES),
    "constraints": described("name: relation, or a mapping.", equations.FORM),
    "initial": described(
        "A start value for each coordinate; velocities that are not named are 0.",
        values.FORM,
    ),
    "simulation": described("When to stop, how finely, and how.", simulation.FORM),
    "scene": described("What to draw.", keyed(drawing.SCENE_KEYS)),
    "output": described("What to write.", keyed(drawing.OUTPUT_KEYS)),
}
REQUIRED = ("coordinates", "energy", "initial")

# What a model is called that comes from no file.
TEXT = "<model>"
_NO_FILE_NAMES = ("", ".", "..")
_NAMING = {
    "parameters": Kind.PARAMETER,
    "coordinates": Kind.COORDINATE,
    "definitions": Kind.DEFINITION,
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
    text, file = text_of(path)
    return read(text, file, overrides, options)


def read(
    text: str,
    file: str,
    overrides: MappingType[str, str] | None = None,
    options: MappingType[str, str] | None = None,
) -> Model:
    """Read the text of a model file.

    Parameters
    ----------
    text
        The text.
    file
        What messages call it; its stem is the model's name if the file gives none.
    overrides
        Expressions instead of those of parameters and of start values
        (`--set name=expression`).
    options
        Expressions instead of those of keys of `simulation`, such as
        `{"output_step": "0.1"}` (`--output-step 0.1`). `duration` replaces `end` too.

    Raises
    ------
    InputError
        With every fault, in the order of the file.
    """
    data = text.encode(errors="surrogatepass")
    return _read(text, file, overrides or {}, options or {}, data)


def _read(
    text: str,
    file: str,
    overrides: MappingType[str, str],
    options: MappingType[str, str],
    data: bytes,
) -> Model:
    document = load(text, file)
    faults = Faults(file, document.problems, SECTIONS)
    if document.root is None:
        if not document.problems:
            raise unusable("empty-file", "the file is empty", file)
        faults.raise_if_any()
    assert document.root is not None
    graph = Graph(limits.graph_nodes(len(data)), limits.work(len(data)))
    return _File(document.root, file, faults, graph).read(overrides, options, data)


def _unfit(name: str, node: Scalar) -> str:
    """Say why a name cannot be that of files; nothing of what is told already."""
    if letter := unseen(name):
        return f"it has the letter U+{ord(letter):04X}, which is not seen"
    if re.search(r"[/\\]", name):
        return "it has a path separator"
    for letter, what in (("\n", "line break"), ("\t", "tab")):
        if letter in name:
            return f"it has a {what}"
    if name in _NO_FILE_NAMES and (node.empty or node.text.strip() == name):
        return "it is no name of a file"
    return ""


class _File:
    """The sections of one file."""

    def __init__(self, root: Node, file: str, faults: Faults, graph: Graph) -> None:
        self.file = file
        self.faults = faults
        if is_odd(root, SECTIONS):
            root = in_place(root, SECTIONS, faults)
        self.root, self.node = root.place, root
        self.top = fields(root, "the file", SECTIONS, faults, self.root)
        if not self.top.sound:
            faults.raise_if_any()
        self.energy = equations.energy_fields(
            self.top.found.get("energy"), faults, self.root
        )
        self.names = Names("lagrangian" in self.energy)
        self.x = Expressions(graph, self.names, faults)

    def read(
        self,
        overrides: MappingType[str, str],
        options: MappingType[str, str],
        data: bytes,
    ) -> Model:
        """Give the model.

        Raises
        ------
        InputError
            With every fault.
        """
        top, x, faults = self.top, self.x, self.faults
        self._check_version()
        name = self._name()
        given = {
            key: self.names.section(top.value(key), f"`{key}`", kind, faults)
            for key, kind in _NAMING.items()
        }
        constraints = equations.declared_constraints(top.value("constraints"), x)
        self._check_names()
        self.names.reactions += drawing.asked_reactions(top.found.get("output"))

        asked = simulation.simulation_fields(top.found.get("simulation"), x, self.root)
        sections = Sections(
            given["parameters"], given["definitions"], self.energy,
            top.value("forces"), constraints, top.found.get("initial"), asked,
            self.root,
        )  # fmt: skip
        stated = Stated.of(self.file, sections, x, overrides, options)
        numbers, known = stated.parameters()
        coordinates = values.read_coordinates(given["coordinates"], x)
        definitions = Definitions(given["definitions"], x)
        definitions.build(Level.POSITION, Level.VELOCITY)
        energies = equations.read_energies(self.energy, x)
        definitions.build(Level.OUTPUT)
        forces = equations.read_forces(top.value("forces"), x)
        laws = equations.read_constraints(constraints, x)
        starts = stated.initial(known)
        stated.asked(x, {})
        until = simulation.read_until(asked, x)
        scene = drawing.read_scene(top.found.get("scene"), x)
        output = drawing.read_output(top.found.get("output"), x)
        description, source = (top.text(k, faults) for k in ("description", "source"))

        faults.raise_if_any()
        assert energies.lagrangian is not None
        return Model(
            name=name,
            file=self.file,
            sha256=hashlib.sha256(data).hexdigest(),
            graph=x.graph,
            parameters=numbers,
            unused=values.unused(self.node, known),
            places={**self.names.places, **equations.places(self.energy)},
            coordinates=coordinates,
            definitions=definitions.read(),
            lagrangian=energies.lagrangian,
            kinetic=energies.kinetic,
            potential=energies.potential,
            dissipation=energies.dissipation,
            forces=forces,
            constraints=laws,
            initial=starts,
            until=until,
            scene=scene,
            output=output,
            stated=stated,
            description=description,
            source=source,
        )

    def _check_names(self) -> None:
        check_columns(self.names, self.faults)
        if self.names.complete or not self.names.readable:
            return
        if "coordinates" in self.top and self.names.faulty:
            return
        text = "the file has no coordinates"
        place = self.top.place_of("coordinates")
        hint = "such as coordinates: {theta: {unit: rad}}"
        self.faults.add("missing-key", text, place, hint)

    def _check_version(self) -> None:
        node = self.top.value("lagsim")
        if node is None or isinstance(node, Broken):
            return
        version = self.top.text("lagsim", self.faults)
        if version != FORMAT_VERSION:
            text = f"the format version must be {FORMAT_VERSION}, found `{version}`"
            self.faults.add("format-version", text, node.place)

    def _name(self) -> str:
        node = self.top.value("name")
        if node is None:
            if self.file in (STDIN, PLAIN):
                return self.file.strip("<>")
            stem = PurePath(self.file).stem
            found = unseen(stem)
            if found or "\n" in stem:
                what = f"the letter U+{ord(found):04X}" if found else "a line break"
                text = f"the name of the file has {what}"
                hint = "give a `name`: results are called by it"
                self.faults.add("bad-model-name", text, self.root, hint)
            return stem if stem not in _NO_FILE_NAMES else "model"
        name = self.top.text("name", self.faults)
        if isinstance(node, Scalar) and (fault := _unfit(name, node)):
            text = f"`{shortened(name)}` cannot be a name: {fault}"
            hint = "it is used for files: no path separators, such as elastic-pendulum"
            self.faults.add("bad-model-name", text, node.place, hint)
        return name


# --- Sections in sections, keys of sections beside them: wrong indentation
#
# What stands in a wrong place is reported once, and read as if it stood in the right
# one, so that nothing of it is reported as missing or unknown, too.

Forms = dict[str, dict[str, Any]]


def in_place(root: Node, forms: Forms, faults: Faults) -> Node:
    """Give the file with what is misplaced where it belongs, each reported.

    Parameters
    ----------
    forms
        The sections: what may stand in each.
    """
    if not isinstance(root, Mapping):
        return root
    entries = [*root.entries]
    entries += _taken_out(entries, forms, faults)
    _put_below(entries, forms, faults)
    _indented(entries, forms, faults)
    return root._replace(entries=tuple(entries))


def _is_open(node: Node) -> bool:
    """Tell whether keys can be put below a section's key."""
    return isinstance(node, Mapping) or (isinstance(node, Scalar) and node.empty)


def _joined(node: Node, more: list[Entry]) -> Node:
    if isinstance(node, Mapping):
        return node._replace(entries=(*node.entries, *more))
    return Mapping(tuple(more), more[0][0].place)


def _taken_out(entries: list[Entry], forms: Forms, faults: Faults) -> list[Entry]:
    """Take sections out of sections; give them."""
    found: list[Entry] = []
    present = {key.text for key, _ in entries}
    for k, (section, value) in enumerate(entries):
        form = forms.get(section.text)
        if form is None or not isinstance(value, Mapping):
            continue
        kept = []
        for key, inside in value.entries:
            name = key.text
            nested = _is_section(name, inside, forms) and not _has(form, name)
            if not nested or name in present:
                kept.append((key, inside))
                continue
            text = f"the section `{name}` is inside `{section.text}`"
            faults.add("misplaced-key", text, key.place, faults.belongs(name))
            present.add(name)
            found.append((key, inside))
        entries[k] = section, value._replace(entries=tuple(kept))
    return found


def _is_section(name: str, node: Node, forms: Forms) -> bool:
    """Tell whether what stands at `name` is what a section holds.

    A parameter may be called as a section is: it has keys of a parameter then.
    """
    if name not in forms or not isinstance(node, Mapping):
        return False
    own = {"value", "unit", "description", "guess", "relation"}
    return not any(key.text in own for key, _ in node.entries)


def _has(form: MappingType[str, Any], key: str) -> bool:
    return key in form.get("properties", ())


def _put_below(entries: list[Entry], forms: Forms, faults: Faults) -> None:
    """Put keys of one section, found beside the sections, below it."""
    for entry in _strangers(entries, forms):
        key = entry[0]
        for section, form in forms.items():
            if _has(form, key.text) and not isinstance(entry[1], Mapping):
                text = f"unknown key `{key.text}` in the file"
                if _add(entries, section, [entry], key):
                    faults.add("unknown-key", text, key.place, faults.belongs(key.text))
                break


def _strangers(entries: list[Entry], forms: Forms) -> Iterator[Entry]:
    for entry in [*entries]:
        name = entry[0].text
        if name not in forms and not name.startswith("x-"):
            yield entry


def _add(entries: list[Entry], section: str, more: list[Entry], at: Scalar) -> bool:
    """Move entries below a section, which may not be there; tell whether they fit."""
    for k, (key, value) in enumerate(entries):
        if key.text == section:
            taken = value.entries if isinstance(value, Mapping) else ()
            names = {name.text for name, _ in taken}
            if not _is_open(value) or any(e[0].text in names for e in more):
                return False
            entries[k] = key, _joined(value, more)
            break
    else:
        head = Scalar(section, False, at.place, at.span)
        entries.append((head, _joined(head, more)))
    for entry in more:
        entries.remove(entry)
    return True


def _indented(entries: list[Entry], forms: Forms, faults: Faults) -> None:
    """Put lines that follow an empty section, and are none, below it."""
    section: Scalar | None = None
    runs: dict[str, list[Entry]] = {}
    for key, value in entries:
        if key.text in forms:
            empty = isinstance(value, Scalar) and value.empty
            section = key if empty and forms[key.text].get("type") != "string" else None
        elif section is not None and not key.text.startswith("x-"):
            if faults.guess(key.text, forms):
                section = None
            else:
                runs.setdefault(section.text, []).append((key, value))
    for name, run in runs.items():
        first = run[0][0]
        more = f", and {len(run) - 1} more," if len(run) > 1 else ""
        text = f"`{first.text}`{more} below `{name}:` must be indented"
        hint = f"two blanks before each line that belongs to `{name}`"
        if _add(entries, name, run, first):
            faults.add("misplaced-key", text, first.place, hint)


# --- The JSON Schema (draft-07) of the model file, from the tables of keys


def schema(choices: MappingType[str, Iterable[str]]) -> Form:
    """Give the schema.

    Parameters
    ----------
    choices
        Of keys of `simulation` that are names, those that there are.
    """
    asked = SECTIONS["simulation"]
    chosen = {
        key: {**asked["properties"][key], "enum": list(names)}
        for key, names in choices.items()
    }
    asked = {**asked, "properties": {**asked["properties"], **chosen}}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "lagsim model",
        "description": "A system by its energies, its start, and how to run it.",
        **keyed({**SECTIONS, "simulation": asked}, REQUIRED),
    }
