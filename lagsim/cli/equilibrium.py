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
    PictureFormat,
    aligned,
    aligned_pairs,
    assignments,
    check_replaced,
    experiment,
    option,
    output_folder,
    parse_range,
    print_warning,
    quiet,
    titled_rows,
    write_file,
)
from lagsim.codes.known import UNKNOWN_NAME
from lagsim.errors import Problems, counted, did_you_mean
from lagsim.model.reader import read_file
from lagsim.studies import branches as branching
from lagsim.studies import rest
from lagsim.studies.options import VARIED_RANGE
from lagsim.studies.setting import setting_of

if TYPE_CHECKING:
    from lagsim.cli._shared import Progress
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.branches import Branches

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
    vary: str | None = option(
        "NAME=A:B", "Follow the branches over a parameter or a start value.", "--vary"
    ),
    plot: str | None = option(
        "NAME", "The coordinate in the picture of branches.", "--plot"
    ),
    form: PictureFormat = FORMAT,
    no_plots: bool = NO_PLOTS,
    as_json: bool = JSON,
    quiet: bool = quiet(),
) -> int:  # fmt: skip
    """Find positions of rest, and whether they are stable."""
    given = assignments(sets)
    read = read_file(model, given)
    if write is not None:
        check_replaced(write, read)
    search = rest.Search(setting_of(read))
    branches = _branches(read, vary, plot)

    def measure(interrupt: Interrupt, progress: Progress) -> Measured:
        found = _found(search, branches, starts, interrupt, progress)
        document = rest.document_of(search.setting, found, search.tried or starts)
        document["complete"] = not interrupt.requested
        cells = rest.tables(found)
        if branches is not None:
            document |= branches.record
            cells = branching.tables(document)
        if write is not None:
            write_file(write, rest.with_start(search.setting, found, given).encode())

        def draw() -> bytes:
            from lagsim.studies.rest_drawing import diagram, picture

            if branches is not None:
                return diagram(read, document, plot, form.value)
            return picture(read.name, found, form.value)

        def summary(files: str) -> str:
            return _summary(document, files)

        name = f"equilibrium.{form.value}"
        drawer = None if no_plots else draw
        return Measured(document, cells, name, drawer, summary)

    where = folder or Path("results") / read.name / "equilibrium"
    return experiment(
        "equilibrium", measure, where, rest.MANIFEST, quiet=quiet, as_json=as_json
    )


def _found(
    search: rest.Search,
    branches: Branches | None,
    starts: int,
    interrupt: Interrupt,
    progress: Progress,
) -> list[rest.Equilibrium]:
    """Return the rests; print the warnings of a search that finds none."""
    try:
        if branches is None:
            return search.all(starts, interrupt, progress)
        return branches.follow(starts, interrupt, progress)
    except rest.NoRestError:
        for caution in search.setting.cautions:
            print_warning(caution)
        raise


def _branches(read: Model, vary: str | None, plot: str | None) -> Branches | None:
    """Return the branches that `--vary` and `--plot` request; None without `--vary`.

    read : the model.
    """
    problems = Problems()
    coordinates = [c.name for c in read.coordinates]
    if plot is not None and plot not in coordinates:
        hint = did_you_mean(plot, coordinates) or f"one of {', '.join(coordinates)}"
        text = f"--plot {plot}: the model has no such coordinate"
        problems.add(UNKNOWN_NAME, text, hint=hint)
    if vary is None:
        problems.refuse()
        return None
    name, _, after = (part.strip() for part in vary.partition("="))
    ends = parse_range(problems, f"--vary {name}", after, VARIED_RANGE)
    problems.refuse()
    assert ends is not None
    return branching.varied(read, name, ends)


def _rounded(value: float) -> str:
    return f"{value if abs(value) > TINY else 0:.6g}"


def _summary(document: Document, files: str) -> str:
    """Return the summary that the command prints at its end.

    files : text on the files that were written.
    """
    found = document["equilibria"]
    name = document["model"]["name"]
    lines = [f"{name}: {counted(len(found), 'position')} of rest"]
    rows: list[tuple[str, ...]] = [("", "", "distance", "energy", "coordinates")]
    for number, one in enumerate(found[:MOST], 1):
        where = {**one["coordinates"], **one.get("states", {})}
        shown = [f"{q} {_rounded(x)}" for q, x in where.items()]
        if len(shown) > MOST_NAMED:
            shown[MOST_NAMED:] = [f"... {len(shown) - MOST_NAMED} more"]
        rows.append((
            str(number), VERDICTS[one["stable"]] or one["reason"],
            f"{one['distance']:.4g}", _rounded(one["energy"]), ", ".join(shown),
        ))  # fmt: skip
    lines.append(aligned(rows, lefts=len(rows[0])))
    if len(found) > MOST:
        lines.append(f"  ... {len(found) - MOST} more")
    more = list[tuple[str, str]]()
    if "vary" in document:
        counts = [len(x) for x in document["branches"]]
        count = f"{counted(len(counts), 'branch')} of {sum(counts)} points"
        more.append(("branches", count))
        name = document["vary"]["name"]
        points = (
            f"{x['kind']} at {name} = {x['value']:.9g}" for x in document["points"]
        )
        more += titled_rows("points", points)
        if document["skipped"]:
            more.append(("skipped", "rests in corners and in continuous families"))
    if document["free"]:
        more.append(("free", ", ".join(document["free"])))
    if document["continuum"]:
        more.append(("continuum", "friction that sticks holds other positions, too"))
    return "\n".join([*lines, aligned_pairs([*more, ("files", files)])])
