"""`lagsim equilibrium`: positions of rest, and their stability."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lagsim.cli._shared import (
    FORMAT,
    JSON,
    MODEL,
    NO_PLOTS,
    SETS,
    Measured,
    Picture,
    aligned,
    assignments,
    complain,
    experiment,
    option,
    output_folder,
    put_file,
    quiet,
    table,
)
from lagsim.errors import counted
from lagsim.model.reader import read_file
from lagsim.studies import rest

if TYPE_CHECKING:
    from lagsim.cli._shared import Progress
    from lagsim.run.interrupt import Interrupt

    Document = dict[str, Any]

# Largest number of rests, and of numbers, in a report; least number in it.
MOST, MOST_NAMED, TINY = 20, 6, 1e-12
VERDICTS = {True: "stable", False: "unstable", None: ""}


def command(
    model: str = MODEL,
    folder: Path | None = output_folder(
        "Output folder; default results/NAME/equilibrium."
    ),
    sets: list[str] | None = SETS,
    starts: int = typer.Option(
        rest.STARTS, "--starts", metavar="N", min=0,
        help="Number of other starts, beside that of the file.",
    ),
    write: Path | None = option(
        "FILE", "Write the model file with the nearest stable rest as its start.",
        "--write",
    ),
    form: Picture = FORMAT,
    no_plots: bool = NO_PLOTS,
    as_json: bool = JSON,
    quiet: bool = quiet(),
) -> int:  # fmt: skip
    """Find positions of rest, and whether they are stable."""
    given = assignments(sets)
    read = read_file(model, given)
    search = rest.Search(rest.setting_of(read))
    for caution in search.setting.cautions:
        complain(f"warning: {caution.text} [{caution.number}]")

    def measure(interrupt: Interrupt, progress: Progress) -> Measured:
        found = search.all(starts, interrupt, progress)
        document = rest.document_of(search.setting, found, search.tried)
        document["complete"] = not interrupt.asked
        if write is not None:
            put_file(write, rest.written(search.setting, found, given).encode())

        def draw() -> bytes:
            from lagsim.studies.rest_drawing import picture

            return picture(read.name, found, form.value)

        def summary(files: str) -> str:
            return _summary(document, files)

        name = f"equilibrium.{form.value}"
        drawer = None if no_plots else draw
        return Measured(document, rest.tables(found), name, drawer, summary)

    where = folder or Path("results") / read.name / "equilibrium"
    return experiment(
        "equilibrium", measure, where, rest.MANIFEST, quiet=quiet, as_json=as_json
    )


def _summary(document: Document, files: str) -> str:
    """Return the closing lines."""
    found = document["equilibria"]
    name = document["model"]["name"]
    lines = [f"{name}: {counted(len(found), 'position')} of rest"]
    rows: list[tuple[str, ...]] = [("", "", "distance", "energy", "coordinates")]
    for number, one in enumerate(found[:MOST], 1):
        where = {**one["coordinates"], **one.get("states", {})}
        shown = [f"{q} {x if abs(x) > TINY else 0:.6g}" for q, x in where.items()]
        if len(shown) > MOST_NAMED:
            shown[MOST_NAMED:] = [f"... {len(shown) - MOST_NAMED} more"]
        rows.append((
            str(number), VERDICTS[one["stable"]] or one["reason"],
            f"{one['distance']:.4g}", f"{one['energy']:.6g}", ", ".join(shown),
        ))  # fmt: skip
    lines.append(aligned(rows, lefts=len(rows[0])))
    if len(found) > MOST:
        lines.append(f"  ... {len(found) - MOST} more")
    more = []
    if document["free"]:
        more.append(("free", ", ".join(document["free"])))
    if document["continuum"]:
        more.append(("continuum", "friction that sticks holds other positions, too"))
    return "\n".join([*lines, table([*more, ("files", files)])])
