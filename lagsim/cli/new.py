"""`lagsim new`: a commented model file to begin from.

A template is a file in `templates/`, and known by being there.
"""

from __future__ import annotations

from pathlib import Path

import typer

from lagsim.cli._shared import print_stdout
from lagsim.codes.known import EXISTS, UNKNOWN_TEMPLATE, UNWRITABLE, USAGE
from lagsim.errors import unusable

TEMPLATES = {p.stem: p for p in Path(__file__).with_name("templates").glob("*.yaml")}
ENDING = ".yaml"
KNOWN = ", ".join(sorted(TEMPLATES))


def command(
    name: str = typer.Argument(
        metavar="NAME", help="NAME.yaml is written; may be a path."
    ),
    template: str = typer.Option(
        "pendulum", metavar="T", help=f"Template to begin with: {KNOWN}.",
        autocompletion=lambda: sorted(TEMPLATES),
    ),
) -> int:  # fmt: skip
    """Write a commented model file to begin from."""
    if template not in TEMPLATES:
        text = f"there is no template `{template}`"
        raise unusable(UNKNOWN_TEMPLATE, text, hint=f"one of {KNOWN}")
    path = Path(name if name.endswith(ENDING) else name + ENDING)
    if path.name == ENDING:
        raise unusable(USAGE, f"`{name}` names no file")
    try:
        with path.open("xb") as file:
            file.write(TEMPLATES[template].read_bytes())
    except FileExistsError:
        text = f"{path} is there already and stays as it is"
        raise unusable(EXISTS, text) from None
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        reason = getattr(error, "strerror", None) or str(error)
        text = f"{path} cannot be written: {reason}"
        raise unusable(UNWRITABLE, text) from None
    print_stdout(
        f"{path}: a start from the template {template}; next: lagsim run {path}"
    )
    return 0
