"""The model file -> Model; the only place that knows the file format.

`read` goes through the sections in the order in which they need each other. Each
reports its faults and gives what is sound; at the end all faults are raised at once.
What rests on something faulty is passed over in silence, so that one fault is told
once.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import PurePath
from typing import TYPE_CHECKING

from lagsim import limits
from lagsim.errors import UNSEEN, unseen
from lagsim.language.graph import Graph
from lagsim.model.model import Level, Model
from lagsim.model.nodes import Broken, Scalar, load
from lagsim.model.reader import (
    drawing,
    dynamics,
    initial,
    parameters,
    relations,
    simulation,
)
from lagsim.model.reader.definitions import Definitions
from lagsim.model.reader.expressions import Expressions
from lagsim.model.reader.faults import Faults
from lagsim.model.reader.fields import (
    PLAIN,
    described,
    fields,
    is_odd,
    keyed,
    shortened,
)
from lagsim.model.reader.names import Kind, Names, check_columns, naming
from lagsim.model.reader.stated import Sections, Stated
from lagsim.model.text import STDIN, text_of, unusable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.model.nodes import Node

__all__ = ["FORMAT_VERSION", "REQUIRED", "SECTIONS", "read", "read_file"]

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
        naming(parameters.VALUE),
    ),
    "coordinates": described(
        "name: {unit: ..., description: ...}; their order is that of the table.",
        parameters.COORDINATES,
    ),
    "definitions": described(
        "name: expression, in any order; each is a column.",
        naming(parameters.VALUE),
    ),
    "energy": described("Energies, taken literally.", dynamics.ENERGY),
    "forces": described("Forces that no energy gives.", dynamics.FORCES),
    "constraints": described("name: relation, or a mapping.", relations.FORM),
    "initial": described(
        "A start value for each coordinate; velocities that are not named are 0.",
        initial.FORM,
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
    overrides: Mapping[str, str] | None = None,
    options: Mapping[str, str] | None = None,
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
    overrides: Mapping[str, str] | None = None,
    options: Mapping[str, str] | None = None,
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
    overrides: Mapping[str, str],
    options: Mapping[str, str],
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
            from lagsim.model.reader.misplaced import in_place

            root = in_place(root, SECTIONS, faults)
        self.root, self.node = root.place, root
        self.top = fields(root, "the file", SECTIONS, faults, self.root)
        if not self.top.sound:
            faults.raise_if_any()
        self.energy = dynamics.energy_fields(
            self.top.found.get("energy"), faults, self.root
        )
        self.names = Names("lagrangian" in self.energy)
        self.x = Expressions(graph, self.names, faults)

    def read(
        self, overrides: Mapping[str, str], options: Mapping[str, str], data: bytes
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
        constraints = relations.declared_constraints(top.value("constraints"), x)
        self._check_names()
        self.names.reactions += drawing.asked_reactions(top.found.get("output"))

        asked = simulation.simulation_fields(top.found.get("simulation"), x, self.root)
        sections = Sections(
            given["parameters"], given["definitions"], self.energy,
            top.value("forces"), constraints, top.found.get("initial"), asked,
            self.root,
        )  # fmt: skip
        stated = Stated.of(self.file, sections, x, overrides, options)
        values, known = stated.parameters()
        coordinates = parameters.read_coordinates(given["coordinates"], x)
        definitions = Definitions(given["definitions"], x)
        definitions.build(Level.POSITION, Level.VELOCITY)
        energies = dynamics.read_energies(self.energy, x)
        definitions.build(Level.OUTPUT)
        forces = dynamics.read_forces(top.value("forces"), x)
        laws = relations.read_constraints(constraints, x)
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
            parameters=values,
            unused=parameters.unused(self.node, known),
            places={**self.names.places, **dynamics.places(self.energy)},
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
