"""`lagsim overlay`: several results on the same axes, and playing side by side."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lagsim.cli._shared import option, print_stdout, print_warning, quiet, write_picture
from lagsim.codes.known import NOTHING_TO_DRAW, USAGE
from lagsim.errors import InputError, Problem, counted, unusable
from lagsim.notes import Caution
from lagsim.outputs import animation
from lagsim.studies import overlay
from lagsim.studies.overlay import OverlaidRun, read

if TYPE_CHECKING:
    from collections.abc import Sequence


# Without -o there is one of each.
DEFAULT = (Path("results/overlay.png"), Path("results/overlay.html"))
PAGE = ".html"
PICTURES = (".png", ".svg", ".pdf")


def command(
    folders: list[Path] = typer.Argument(metavar="DIR...", help="Folders of results."),
    output: Path | None = option(
        "FILE",
        "A page (.html) or a picture (.png, .svg, .pdf); default results/overlay.html "
        "and .png.",
        "-o", "--output"
    ),
    columns: str | None = option(
        "A,B", "Columns of the picture; default the coordinates."
    ),
    quiet: bool = quiet(),
) -> int:  # fmt: skip
    """Draw several results in one picture, and play the motions on one page."""
    paths = DEFAULT if output is None else (output,)
    for path in paths:
        if path.suffix.lower() not in (PAGE, *PICTURES):
            kinds = f"{', '.join(PICTURES)} or {PAGE}"
            text = f"-o {path}: a name that ends in {kinds} is expected"
            raise unusable(USAGE, text, hint=f"such as -o overlay{PAGE}")
    runs = read(folders)
    names = None
    if columns is not None:
        names = [name.strip() for name in columns.split(",") if name.strip()]
        if not names:
            text = f"--columns {columns}: names of columns are expected"
            raise unusable(USAGE, text, hint="such as --columns x,y")
    written = [str(path) for path in paths if _wrote(path, runs, names, output is None)]
    if written and not quiet:
        print_stdout(f"{counted(len(runs), 'run')}: {', '.join(written)}")
    return 0


def _wrote(
    path: Path, runs: Sequence[OverlaidRun], names: Sequence[str] | None, also: bool
) -> bool:
    """Write a page or a picture if it can be drawn; return whether it was written.

    Parameters
    ----------
    path : Path
        The file; its ending determines the kind.
    runs : sequence of OverlaidRun
    names : sequence of str or None
        Columns of the picture.
    also : bool
        Whether the file is a default output, not requested by name.
    """
    form = path.suffix.lower()
    if form in PICTURES:
        draw = partial(
            overlay.picture, runs, overlay.shown_columns(runs, names), form[1:]
        )
        return write_picture(path, draw, folders=True)
    found, reasons = overlay.motions(runs)
    if not found and not also:
        raise InputError([Problem(NOTHING_TO_DRAW, text) for text in reasons])
    for text in reasons:
        print_warning(Caution(NOTHING_TO_DRAW, text))
    if not found:
        return False
    title = f"{overlay.title(runs)}: {counted(len(found), 'run')}"
    return write_picture(path, lambda: animation.page(found, title), folders=True)
