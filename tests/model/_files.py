"""Model texts for tests: missing sections are filled in."""

from __future__ import annotations

import re

from lagsim.errors import InputError, Problem
from lagsim.model.reader import read

SECTIONS = {
    "coordinates": "coordinates: {x: {}, y: {}}",
    "energy": "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}",
    "initial": "initial: {x: 0, y: 0}",
}


def completed(text: str, omit: str = "") -> str:
    """Return `text` with the required sections that it lacks, after it."""
    text = text.lstrip("\n")
    for key, section in SECTIONS.items():
        if key not in omit.split() and not re.search(rf"^{key}:", text, re.MULTILINE):
            text += "\n" * (not text.endswith("\n")) + section + "\n"
    return text


def model(text: str, **arguments):
    return read(completed(text), "model.yaml", **arguments)


def problems(text: str, omit: str = "", **arguments) -> list[Problem]:
    """Return the faults of a text."""
    try:
        read(completed(text, omit), "model.yaml", **arguments)
    except InputError as error:
        return list(error.problems)
    return []
