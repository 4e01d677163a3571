"""The JSON Schema (draft-07) of the model file, of the reader's own tables of keys."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.model.reader import REQUIRED, SECTIONS
from lagsim.model.reader.fields import Form, keyed

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


def schema(choices: Mapping[str, Iterable[str]]) -> Form:
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
