"""Texts of docs/methods.md and docs/gallery.md, and tables of two further pages.

They are derived from the methods' modules, from the headers of models/, from the JSON
Schema (the keys in docs/model-file.md), and from the rows of warnings (the alarms in
docs/failing.md). `regenerate.py` writes them.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from lagsim.codes import cautions, errors
from lagsim.errors import InputError
from lagsim.mechanics.derivation import derive
from lagsim.methods import method, method_page, names
from lagsim.model.reader import read, read_file

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

ROOT = Path(__file__).resolve().parent.parent
DOCS, MODELS = ROOT / "docs", ROOT / "models"
PICTURES = DOCS / "gallery"

METHODS = """\
# Methods

`auto` chooses a method, and a run reports the choice and the reason; `--method NAME`
overrules it. `lagsim methods NAME` prints the sections of this page. `lagsim bench`
measures the time of each method for its error ([Charts](charts.md)). [Failing
models](failing.md) shows where each method fails.

"""

GALLERY = """\
# Gallery

The models in `models/`. Each runs as it is; its header has the source and the expected
values. Copy the most similar one to begin a model of your own. A picture shows the
paths of the points in the section `scene`, with links and shapes at the end, or
coordinates against time.

"""
GROUPS = (
    "Free motion",
    "Held by constraints",
    "Rolling and steering",
    "Contact and friction",
)


def methods_page() -> str:
    """Return the page on all methods."""
    rows = ["| name | order | step | handles |", "|---|---|---|---|"]
    parts = []
    for name in names():
        m = method(name)
        step = "adaptive" if m.ADAPTIVE else "fixed"
        rows.append(f"| [{name}](#{name}) | {m.ORDER} | {step} | {m.HANDLES} |")
        text = method_page(m.NAME)
        parts.append(f"## {name}\n\n{text}\n")
    return METHODS + "\n".join([*rows, "", *parts])


def shipped() -> list[Path]:
    """Return the files of the models, by name."""
    return sorted(MODELS.glob("*.yaml"))


def gallery_page() -> str:
    """Return the page on all models, in groups by their subject."""
    entries: dict[str, list[str]] = {group: [] for group in GROUPS}
    for path in shipped():
        entries[group_of(path)].append(_entry(path))
    head = "| | |\n|---|---|"
    parts = [
        f"## {group}\n\n{head}\n" + "\n".join(entries[group]) + "\n" for group in GROUPS
    ]
    return GALLERY + "\n".join(parts)


def group_of(path: Path) -> str:
    """Return the gallery's group of a model, by its constraints and their laws."""
    model = read_file(str(path))
    text = path.read_text(encoding="utf-8")
    if not all(c.always for c in model.constraints) or "sign(" in text:
        return GROUPS[3]
    if not model.constraints:
        return GROUPS[0]
    return GROUPS[1 if all(row.holonomic for row in derive(model).rows) else 2]


def _entry(path: Path) -> str:
    name = path.stem
    picture = f"[![{name}](gallery/{name}.png)](../models/{path.name})"
    told = first_lines(path.read_text(encoding="utf-8"))
    command = f"`lagsim run models/{path.name}`"
    return f"| {picture} | [**{name}**](../models/{path.name})<br>{told}<br>{command} |"


def first_lines(text: str) -> str:
    """Return the first paragraph of a header, up to its source or an empty line."""
    lines = []
    for line in text.splitlines():
        said = line.removeprefix("#").strip()
        if not line.startswith("#") or not said or re.match(r"[A-Z]\w+:", said):
            break
        lines.append(said)
    return re.sub(r"([\\*_<|])", r"\\\1", " ".join(lines))


# --- the keys of a model file

BEGIN = "<!-- From here on derived from lagsim.schema.json. -->\n"
END = "<!-- To here. -->\n"
SCHEMA = ROOT / "lagsim/lagsim.schema.json"
# Of what a name is given to; `unit` and `description` are the same everywhere.
NAMED, SAME = "NAME", ("unit", "description", "title")
TYPES = {
    "number": "expression", "string": "expression", "boolean": "true, false",
    "null": "text",
}  # fmt: skip


def model_page() -> str:
    """Return docs/model-file.md with its table of keys."""
    return with_table("model-file", BEGIN, keys_table())


def with_table(name: str, begin: str, table: str) -> str:
    """Return a page with a table below its mark."""
    text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    before, mark, rest = text.partition(begin)
    assert mark, f"docs/{name}.md has no line {begin}"
    return before + begin + table + END + rest.partition(END)[2]


def keys_table() -> str:
    """Return the table of all keys of the schema: type, meaning, numbers of errors."""
    schemas = dict(keys(json.loads(SCHEMA.read_text(encoding="utf-8"))))
    found = faults_by_key(schemas)
    rows = ["| key | is | meaning | errors |", "|---|---|---|---|"]
    for path, schema in schemas.items():
        meaning = re.sub(r"([*<|])", r"\\\1", schema["description"])
        numbers = " ".join(found.get(path, []))
        *outer, key = path.replace(f".{NAMED}", "").split(".")
        name = "· " * len(outer) + f"`{key}`"
        kind = "" if (kind := _type(schema)) == TYPES["number"] else kind
        rows.append(f"| {name} | {kind} | {meaning} | {numbers} |")
    return "\n".join(rows) + "\n"


def keys(schema: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and the schema of each key; keys that are names appear as NAME."""
    for part in [schema, *schema.get("anyOf", ())]:
        for key, value in part.get("properties", {}).items():
            if not (path and key in SAME):
                yield f"{path}{key}", value
                yield from keys(value, f"{path}{key}.")
        below = part.get("additionalProperties")
        if isinstance(below, dict):
            yield from keys(below, f"{path}{NAMED}.")
        if "items" in part:
            yield from keys(part["items"], path)


def _type(schema: dict[str, Any]) -> str:
    """Return the permitted types of a value as text."""
    if "enum" in schema:
        return ", ".join(dict.fromkeys(f"`{x}`" for x in schema["enum"]))
    found = [_type(x) for x in schema.get("anyOf", ())]
    kinds = schema.get("type", [])
    for kind in [kinds] if isinstance(kinds, str) else kinds:
        if kind == "array":
            found.append("list")
        elif kind == "object":
            found.append("mapping")
        elif kind != "null" or "boolean" in kinds:
            found.append("text" if kinds == "string" else TYPES[kind])
    if "boolean" in kinds and "string" in kinds:
        return "text"
    return " or ".join(dict.fromkeys(found))


def faults_by_key(known: Collection[str]) -> dict[str, list[str]]:
    """Return the numbers of errors by the key at which their examples have a fault."""
    found: dict[str, list[str]] = defaultdict(list)
    for row in errors().values():
        try:
            read(row.model, "model.yaml")
        except InputError as error:
            for problem in error.problems:
                if problem.code == row.code and problem.place is not None:
                    at = problem.place.line - 1, problem.place.column - 1
                    found[_key_at(row.model, at, known)].append(row.number)
    return {path: sorted(set(numbers)) for path, numbers in found.items()}


def _key_at(text: str, at: tuple[int, int], known: Collection[str]) -> str:
    """Return the innermost key of the table whose value contains a place in a text."""
    with contextlib.suppress(yaml.YAMLError):
        node = yaml.compose(text)
        found = path = ""
        while below := [x for x in _below(node) if _begin(x[0]) <= at < _end(x[1])]:
            key, node = below[0]
            if key is not node:
                fixed = f"{path}{key.value}"
                name = fixed if fixed in known else f"{path}{NAMED}"
                found = name if name in known else found
                path = f"{name}."
        return found
    return ""


def _below(node: yaml.Node | None) -> list[tuple[yaml.Node, yaml.Node]]:
    """Return the pairs of key and value of a mapping; for a list, each item twice."""
    if isinstance(node, yaml.MappingNode):
        return list(node.value)
    return [(x, x) for x in node.value] if isinstance(node, yaml.SequenceNode) else []


def _begin(node: yaml.Node) -> tuple[int, int]:
    return node.start_mark.line, node.start_mark.column


def _end(node: yaml.Node) -> tuple[int, int]:
    return node.end_mark.line, node.end_mark.column


# --- the alarms of docs/failing.md

ALARMS = "<!-- From here on derived from lagsim/codes/warnings.py. -->\n"


def failing_page() -> str:
    """Return docs/failing.md with its table of alarms."""
    rows = ["| code | number | meaning |", "|---|---|---|"]
    for code, row in sorted(cautions().items()):
        rows.append(f"| `{code}` | {row.number} | {row.happened} |")
    return with_table("failing", ALARMS, "\n".join(rows) + "\n")
