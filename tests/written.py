"""Model file without families and vectors, from lagsim's expansion of another file.

Each member of a family has a scalar name: dots become underscores (`q_dot.3.x` is
`q_3_x_dot`). Start values are the values of the first row, and tables are written out
as lists of their points.
"""

from __future__ import annotations

import csv
from typing import Any

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import Graph
from lagsim.language.names import ENDINGS, HIDDEN, rate_of, rated
from lagsim.language.parser import parse, parse_condition, parse_relation
from lagsim.model.loading import load
from lagsim.model.nodes import Mapping, Scalar, entries_of
from lagsim.model.reader import File, has_members, read_file
from lagsim.model.reader.fields import Faults
from tests.support import run

SECTIONS = (
    "parameters", "modes", "states", "coordinates", "definitions", "energy", "forces",
    "constraints", "initial", "simulation", "events", "tables",
)  # fmt: skip
RELATIONS = ("relation", "until", "at")
# What is no expression: texts for people, keys that are chosen from a list.
WORDS = ("unit", "description", "restitution_law", "method", "formulation", "once")


def flat(name):
    """Return the name without dots."""
    base, order = rated(name)
    return base.replace(HIDDEN, "hidden_").replace(".", "_") + ENDINGS[order]


def text_of(parsed):
    """Return the text of an expression in postfix."""
    stack: list[str] = []
    for kind, payload, *_ in parsed.postfix:
        if kind == "number":
            stack.append(repr(payload))
        elif kind == "name":
            stack.append(flat(payload))
        else:
            args = stack[-payload:]
            del stack[-payload:]
            sign = OPERATIONS[kind].sign if kind in OPERATIONS else ""
            stack.append(
                f"{kind}({', '.join(args)})" if not sign
                else f"({sign.join(args) if payload > 1 else sign + args[0]})"
            )  # fmt: skip
    return stack.pop()


def _scalar(key, scalar):
    if scalar.reading is None or key in WORDS:
        return scalar.text
    if key in RELATIONS:
        found = scalar.reading.parsed(scalar.text, parse_relation)
        right = f" {found.sense} {text_of(found.right)}" if found.right else " = 0"
        return text_of(found.left) + right
    parser = parse_condition if key == "when" else parse
    return text_of(scalar.reading.parsed(scalar.text, parser))


def _written(key, node):
    if isinstance(node, Scalar):
        return _scalar(key, node)
    if isinstance(node, Mapping):
        return {flat(k.text): _written(k.text, x) for k, x in node.entries}
    return [_written(key, x) for x in node.items]


def _section(name, node):
    found = {}
    for key, below in entries_of(node):
        if name == "tables":  # apart from points, words
            found[key.text] = {
                k.text: _written("", x) if k.text == "points" else x.text
                for k, x in entries_of(below)
            }
            continue
        # What stands for a whole entry is what its main key has.
        alone = "relation" if name == "constraints" else key.text
        found[flat(key.text)] = _written(
            alone if isinstance(below, Scalar) else "", below
        )
    return found


def _root(path):
    root = load(path.read_text(encoding="utf-8"), str(path)).root
    assert root is not None
    return root


def is_expanded(path):
    """Return whether a file has families, vectors, frames or bodies."""
    return has_members(_root(path))


def written(path):
    """Return the document of a model file, with texts as its scalars."""
    root = _root(path)
    node = File(root, str(path), Faults(str(path)), Graph(10**7), {}, {}).node
    top = {key.text: below for key, below in entries_of(node)}
    found: dict[str, Any] = {s: _section(s, top[s]) for s in SECTIONS if s in top}
    for table in found.get("tables", {}).values():
        if file := table.pop("file", None):
            text = (path.parent / file).read_text("utf-8")
            lines = [x for x in text.splitlines() if not x.startswith("#")]
            rows = csv.DictReader(lines)
            keys = [table.pop(axis) for axis in "xyz" if axis in table]
            table["points"] = [[row[key] for key in keys] for row in rows]
    if has_members(root):
        found["initial"] = _start(path)
    return found


def _start(path):
    """Return the start of a motion: positions, velocities and states, as numbers."""
    model = read_file(str(path))
    row = run(path.stem, duration=1e-6, output_step=1e-6)
    names = [q.name for q in model.coordinates]
    names += [*(rate_of(name) for name in names), *(s.name for s in model.states)]
    return {flat(name): repr(float(row[name][0])) for name in names}
