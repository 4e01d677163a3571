"""The sections of a model file: every key, what it is for, and what may stand there.

One table, the JSON Schema (draft-07) that editors use: `lagsim/lagsim.schema.json`.
Reading takes the keys from it, and hints where a key belongs. The options of methods
stand with these, and are entered into it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lagsim.language.functions import JOINING
from lagsim.methods import options

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Form = dict[str, Any]

FILE = Path(__file__).parents[2] / "lagsim.schema.json"
_SCHEMA: Form = json.loads(FILE.read_text(encoding="utf-8"))
SECTIONS: dict[str, Form] = _SCHEMA["properties"]


def _keys(form: Form) -> dict[str, Form]:
    """Give the keys of a mapping, which may stand for an expression."""
    forms: list[Form] = form.get("anyOf", [form])
    found: dict[str, Form] = forms[-1]["properties"]
    return found


def _keys_below(section: str) -> dict[str, Form]:
    """Give the keys of what each name of a section is given by."""
    return _keys(SECTIONS[section]["additionalProperties"])


COORDINATE, VALUE = _keys_below("coordinates"), _keys_below("parameters")
START, CONSTRAINT = _keys_below("initial"), _keys_below("constraints")
STATE, EVENT = _keys_below("states"), _keys_below("events")
FRAME, BODY = _keys_below("frames"), _keys_below("bodies")
TABLE = _keys_below("tables")
FRICTION = _keys(CONSTRAINT["friction"])
# What only contacts have.
CONTACT = ("restitution", "restitution_law", "friction", "slip")
ENERGY, SCENE, OUTPUT_KEYS = (
    _keys(SECTIONS[section]) for section in ("energy", "scene", "output")
)
LINK = _keys(SCENE["links"]["items"])
SHAPE = _keys(SCENE["shapes"]["additionalProperties"])
SECTION = _keys(OUTPUT_KEYS["sections"]["additionalProperties"])
PLOT = _keys(OUTPUT_KEYS["plots"]["items"])
AXES = ("x", "y", "y2")
MOST_CURVES: int = PLOT["y"]["anyOf"][1]["maxItems"]
SIMULATION = _keys(SECTIONS["simulation"]) | {
    key: {
        "type": ["number", "string"],
        "description": f"Only for the method {name}, {x.least:g} to {x.most:g}: "
        f"{x.about}.",
    }
    for key, (name, x) in options().items()
}
# Names that nothing else in a file may have; operators are none in any case.
_REFUSED: Form = SECTIONS["definitions"]["propertyNames"]["not"]["anyOf"][0]
RESERVED = tuple(name for name in _REFUSED["enum"] if name not in JOINING)


def has_key(section: str, key: str) -> bool:
    """Tell whether a section has a key of this name."""
    return key in SECTIONS[section].get("properties", ())


def schema(choices: Mapping[str, Iterable[str]]) -> Form:
    """Give the JSON Schema of the model file.

    Parameters
    ----------
    choices
        Of keys of `simulation` that are names, those that there are.
    """
    chosen = {
        key: {**SIMULATION[key], "enum": list(names)} for key, names in choices.items()
    }
    asked = {**SECTIONS["simulation"], "properties": {**SIMULATION, **chosen}}
    return {**_SCHEMA, "properties": {**SECTIONS, "simulation": asked}}
