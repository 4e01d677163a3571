"""`lagsim new`: a commented model file to begin from.

A template is a file in `templates/`, and known by being there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lagsim.cli._faults import faults_shown
from lagsim.cli._streams import say
from lagsim.errors import InputError, Problem

TEMPLATES = {p.stem: p for p in Path(__file__).with_name("templates").glob("*.yaml")}

_ENDING = ".yaml"


def command(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="NAME.yaml is written; may be a path.")
    ],
    template: Annotated[
        str,
        typer.Option(
            metavar="T",
            help=f"Template to begin with: {', '.join(sorted(TEMPLATES))}.",
            autocompletion=lambda: sorted(TEMPLATES),
        ),
    ] = "pendulum",
) -> int:
    """Write a commented model file to begin from."""
    with faults_shown() as code:
        if template not in TEMPLATES:
            text = f"there is no template `{template}`"
            hint = f"one of {', '.join(sorted(TEMPLATES))}"
            raise InputError([Problem("unknown-template", text, hint=hint)])
        path = _written(name, TEMPLATES[template].read_bytes())
        say(f"{path}: a start from the template {template}; next: lagsim run {path}")
        code.append(0)
    return code[-1]


def _written(name: str, content: bytes) -> Path:
    """Write NAME.yaml where nothing is yet; give its path."""
    path = Path(name if name.endswith(_ENDING) else name + _ENDING)
    if path.name == _ENDING:
        raise InputError([Problem("usage", f"`{name}` names no file")])
    try:
        with path.open("xb") as file:
            file.write(content)
    except FileExistsError:
        text = f"{path} is there already and stays as it is"
        raise InputError(
            [Problem("exists", text, hint="choose another name")]
        ) from None
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        reason = getattr(error, "strerror", None) or str(error)
        text = f"{path} cannot be written: {reason}"
        raise InputError([Problem("unwritable", text)]) from None
    return path
