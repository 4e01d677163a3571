"""`lagsim modes`: small motions about a rest or a steady motion."""

from __future__ import annotations

from enum import Enum
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
    drawn_or_reported,
    experiment,
    flag,
    option,
    output_folder,
    parse_range,
    quiet,
    write_file,
)
from lagsim.codes.known import USAGE
from lagsim.errors import Problem, Problems, counted
from lagsim.model.reader import read_file
from lagsim.outputs.animation import NAME as PAGE
from lagsim.studies.modes import (
    MANIFEST,
    REST,
    START,
    SmallMotions,
    matrices_of,
    pair_of,
    tables,
)
from lagsim.studies.options import FREQUENCY_RANGE

if TYPE_CHECKING:
    from lagsim.cli._shared import Progress
    from lagsim.mechanics.state_space import StateSpace
    from lagsim.run.interrupt import Interrupt

    Document = dict[str, Any]

# Numbers and names of a report.
MOST_MODES, MOST_NAMED = 20, 6
# Values below this size are not reported.
TINY = 1e-12


class About(Enum):
    """States about which small motions are considered."""

    REST = REST
    START = START


def command(
    model: str = MODEL,
    folder: Path | None = output_folder("Output folder; default results/NAME/modes."),
    sets: list[str] | None = SETS,
    at: About = typer.Option(
        About.REST, "--at",
        help="About the nearest rest, or about the start, at rest or in steady motion.",
    ),
    responses: list[str] | None = option(
        "IN:OUT",
        "Frequency response: IN is a force, a parameter or a constraint, OUT a "
        "coordinate, rate, acceleration, definition or multiplier; may be repeated.",
        "--response",
    ),
    frequencies: str | None = option("A:B", "Frequencies of responses, in Hz."),
    matrices: Path | None = option(
        "FILE", "Write A, B, C, D with names; .json or .npz.", "--matrices"
    ),
    animate: bool = flag("--animate", "A page that plays each mode."),
    form: PictureFormat = FORMAT,
    no_plots: bool = NO_PLOTS,
    as_json: bool = JSON,
    quiet: bool = quiet(),
) -> int:  # fmt: skip
    """Frequencies, damping and shapes of small motions."""
    pairs, between = _parsed_options(responses, frequencies, matrices)
    read = read_file(model, assignments(sets))
    small = SmallMotions(read, at.value)
    space, response = small.response(pairs, between) if pairs else (None, None)
    if matrices is not None:
        _write_matrices(matrices, space or small.matrices())

    def measure(_interrupt: Interrupt, _progress: Progress) -> Measured:
        document, found = small.document, tables(small, response)
        if not no_plots or animate:
            from lagsim.studies.modes_drawing import drawings

            makers = drawings(small, response, form.value, plots=not no_plots)
            if not animate:
                del makers[PAGE]
            pictures = {
                name: drawn_or_reported(name, draw, []) for name, draw in makers.items()
            }
            found |= {name: x for name, x in pictures.items() if x is not None}

        def summary(files: str) -> str:
            return _summary(document, files)

        return Measured(document, found, "", None, summary)

    where = folder or Path("results") / read.name / "modes"
    return experiment("modes", measure, where, MANIFEST, quiet=quiet, as_json=as_json)


def _parsed_options(
    responses: list[str] | None, frequencies: str | None, matrices: Path | None
) -> tuple[list[tuple[str, str]], tuple[float, float] | None]:
    """Parse the options of the command.

    Returns
    -------
    pairs : list of (str, str)
        Inputs and outputs of frequency responses.
    between : (float, float) or None
        The range of frequencies in Hz.
    """
    problems, pairs = Problems(), []
    for text in responses or ():
        pair = pair_of(text)
        if pair is None:
            message = f"--response {text}: an input and an output are expected"
            problems.add(USAGE, message, hint="such as --response F:x")
        else:
            pairs.append(pair)
    between = None
    if frequencies is not None:
        option = "--frequencies"
        between = parse_range(problems, option, frequencies, FREQUENCY_RANGE)
    if matrices is not None and matrices.suffix not in (".json", ".npz"):
        hint = "the ending of the name gives the format: .json or .npz"
        problems.append(Problem(USAGE, f"{matrices}: no such format", hint=hint))
    problems.refuse()
    return pairs, between


def _write_matrices(path: Path, space: StateSpace) -> None:
    if path.suffix == ".json":
        from lagsim.outputs.manifest import encode

        write_file(path, encode(matrices_of(space)))
        return
    import io

    import numpy as np

    file = io.BytesIO()
    arrays = {name: np.array(x) for name, x in space._asdict().items()}
    np.savez(file, allow_pickle=False, **arrays)
    write_file(path, file.getvalue())


def _summary(document: Document, files: str) -> str:
    """Return the summary that the command prints at its end.

    files : text on the files that were written.
    """
    about = {k: x for k, x in document["about"].items() if abs(x) > TINY and k != "t"}
    where = [f"{name} = {x:.6g}" for name, x in about.items()]
    if len(where) > MOST_NAMED:
        where[MOST_NAMED:] = [f"... {len(where) - MOST_NAMED} more"]
    found, zero = document["modes"], document["zero"]
    head = f"{document['model']['name']}: {counted(len(found), 'mode')}"
    head += f", {counted(zero, 'eigenvalue')} 0" if zero else ""
    rows: list[tuple[str, ...]] = [
        ("", "natural (Hz)", "frequency (Hz)", "damping", "shape")
    ]
    for number, mode in enumerate(found[:MOST_MODES], 1):
        largest = sorted(mode["shape"].items(), key=lambda x: -abs(complex(*x[1])))
        shape = [f"{q} {_written(complex(*x))}" for q, x in largest[:MOST_NAMED]]
        mark = "" if mode["stable"] else "  grows"
        rows.append((
            str(number), f"{mode['natural_frequency']:.6g}",
            f"{mode['frequency']:.6g}", _small(mode["damping"]),
            ", ".join(shape) + mark,
        ))  # fmt: skip
    if len(found) > MOST_MODES:
        rows.append((f"... {len(found) - MOST_MODES} more",))
    lines = [head, aligned_pairs([("about", ", ".join(where) or "0")])]
    lines += [aligned(rows, lefts=len(rows[0]))] if found else []
    return "\n".join([*lines, aligned_pairs([("files", files)])])


def _small(value: float) -> str:
    return f"{value:.4g}" if abs(value) > 1e-9 else "0"


def _written(value: complex) -> str:
    """Return a complex amplitude as text; without imaginary part if it is real."""
    if abs(value.imag) <= 1e-6 * max(abs(value), 1e-6):
        return _small(value.real)
    return f"{value.real:.3g}{value.imag:+.3g}i"
