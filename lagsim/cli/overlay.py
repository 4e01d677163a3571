"""`lagsim overlay`: several results on the same axes, and playing side by side."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import Quiet, counted
from lagsim.cli._streams import complain, say
from lagsim.cli._writing import put_picture
from lagsim.errors import InputError, Problem
from lagsim.outputs import animation
from lagsim.studies import overlay
from lagsim.studies.overlay import read

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.studies.overlay import Shown

# Without -o there is one of each.
DEFAULT = (Path("results/overlay.png"), Path("results/overlay.html"))
PAGE = ".html"
PICTURES = (".png", ".svg", ".pdf")


def command(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Folders of results.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="A page (.html) or a picture (.png, .svg, .pdf); default "
            "results/overlay.html and .png.",
        ),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="A,B", help="Columns of the picture; default the coordinates."
        ),
    ] = None,
    quiet: Quiet = False,
) -> int:
    """Draw several results in one picture, and play them on one page."""
    with faults_shown() as code:
        wanted = DEFAULT if output is None else (output,)
        for path in wanted:
            _known(path)

        runs = read(folders)
        names = None if columns is None else _names(columns)
        written = [
            str(path) for path in wanted if _wrote(path, runs, names, output is None)
        ]
        if written and not quiet:
            say(f"{counted(len(runs), 'run')}: {', '.join(written)}")
        code.append(0)
    return code[-1]


def _known(path: Path) -> None:
    if path.suffix.lower() not in (PAGE, *PICTURES):
        kinds = f"{', '.join(PICTURES)} or {PAGE}"
        text = f"-o {path}: a name that ends in {kinds} is expected"
        raise InputError([Problem("usage", text, hint=f"such as -o overlay{PAGE}")])


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        told = f"--columns {text}: names of columns are expected"
        raise InputError([Problem("usage", told, hint="such as --columns x,y")])
    return names


def _wrote(
    path: Path, runs: Sequence[Shown], names: Sequence[str] | None, also: bool
) -> bool:
    """Write a file, if it can be drawn; `also`: it was not asked for by name."""
    if path.suffix.lower() in PICTURES:
        form = path.suffix.lower()[1:]
        columns = overlay.chosen(runs, names)
        draw = partial(overlay.picture, runs, columns, form)
        return put_picture(path, draw, folders=True)
    found, told = overlay.motions(runs)
    if not found and not also:
        raise InputError([Problem("nothing-to-draw", text) for text in told])
    for text in told:
        complain(f"warning: {text}")
    if not found:
        return False

    title = f"{overlay.title(runs)}: {counted(len(found), 'run')}"
    return put_picture(path, lambda: animation.page(found, title), folders=True)
