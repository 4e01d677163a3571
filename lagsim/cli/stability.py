"""`lagsim stability`: where each method holds and where it fails."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.cli._shared import (
    FORMAT,
    JSON,
    MODEL,
    SETS,
    Measured,
    PictureFormat,
    aligned,
    aligned_pairs,
    assignments,
    csv,
    experiment,
    headline,
    left_out,
    methods_of,
    option,
    output_folder,
    parse_range,
    quiet,
    titled_rows,
)
from lagsim.codes.known import UNKNOWN_PARAMETER, USAGE
from lagsim.errors import Problems, counted, unusable
from lagsim.language.names import member_hint
from lagsim.methods import method_problems
from lagsim.model.reader import read_file
from lagsim.run.session import open_case, settings_of
from lagsim.studies.bench import stability
from lagsim.studies.bench.stability import MapOptions
from lagsim.studies.options import STEP_RANGE, VARIED_RANGE
from lagsim.tolerances import COMPUTED_ZERO, NEGLIGIBLE_RATE

if TYPE_CHECKING:
    from lagsim.cli._shared import Progress
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt

    Document = dict[str, Any]


TABLE, MANIFEST = "stability.csv", "stability.json"
# The largest numbers of coordinates named for an equilibrium, and for a mode.
MOST_NAMED, MOST_OF_A_MODE = 8, 6


def command(
    model: str = MODEL,
    folder: Path | None = output_folder(
        "Output folder; default results/NAME/stability."
    ),
    sets: list[str] | None = SETS,
    methods: str | None = option("A,B", "Only these methods; default all that apply."),
    steps: str | None = option(
        "A:B", "Range of steps; default around the predicted stability limits."
    ),
    vary: list[str] | None = option(
        "NAME=A:B",
        "Vary a parameter: maps over it and the step; for methods that choose their "
        "steps, their work."
    ),
    form: PictureFormat = FORMAT,
    as_json: bool = JSON,
    quiet: bool = quiet(),
) -> int:  # fmt: skip
    """Map where each method is stable and where it fails."""
    options = _parsed_options(methods, steps, vary)
    read = read_file(model, assignments(sets)).written_out()
    settings = settings_of(read, "stability")
    _check_parameter(read, options.name)
    usual = open_case(read, settings)
    stability.methods_for(usual, options)

    def measure(interrupt: Interrupt, progress: Progress) -> Measured:
        document = stability.measure(
            usual, options, interrupt=interrupt, progress=progress
        )

        def draw() -> bytes:
            from lagsim.studies.bench import chart

            return chart.stability_figure(document, form.value)

        cells = csv(stability.csv_columns(options.name), document["cells"])
        summary, picture = partial(_summary, document), f"stability.{form.value}"
        return Measured(document, {TABLE: cells}, picture, draw, summary)

    where = folder or Path("results") / read.name / "stability"
    return experiment(
        "stability", measure, where, MANIFEST, quiet=quiet, as_json=as_json
    )


def _check_parameter(model: Model, name: str | None) -> None:
    known = [p.name for p in model.parameters]
    if name is None:
        return
    if name not in known:
        text = f"--vary {name}: the model has no such parameter"
        hint = f"of {', '.join(known)}" if known else "it has no parameters"
        hint = member_hint(name, known) or hint
        raise unusable(UNKNOWN_PARAMETER, text, hint=hint)
    if name in model.stated.structural():
        text = f"--vary {name}: members of families are counted or named by it"
        hint = f"map each of its values by itself: --set {name}=3"
        raise unusable(USAGE, text, hint=hint)
    if name in stability.csv_columns(None):
        text = f"`{name}` cannot be varied: {TABLE} has a column of that name"
        raise unusable(USAGE, text, hint="give it another name")


def _parsed_options(
    methods: str | None, steps: str | None, vary: list[str] | None
) -> MapOptions:
    """Parse the options of the command."""
    problems = Problems()
    names = methods_of(methods)
    for method in names or ():
        problems += method_problems(method, auto=False)
    between = None
    if steps is not None:
        between = parse_range(problems, "--steps", steps, STEP_RANGE)
    name: str | None = None
    values = None
    if vary:
        if vary[1:]:
            text = "--vary is given more than once: one parameter varies at a time"
            problems.add(USAGE, text)
        name, _, after = vary[0].partition("=")
        name = name.strip()
        values = parse_range(problems, f"--vary {name}", after, VARIED_RANGE)
    problems.refuse()
    return MapOptions(names, between, name, values)


def _summary(document: Document, files: str) -> str:
    """Return the summary that the command prints at its end.

    files : text on the files that were written.
    """
    methods = sum(map(len, document["methods"].values()))
    head = headline(document, (methods, "method"))
    lines = [f"{head}, {counted(len(document['cells']), 'run')}"]
    lines += _over_parameter(document) if document["vary"] else _borders(document)
    lines.append(aligned_pairs(left_out(document["refused"]) + _eigenvalues(document)))
    lines += [*_modes(document), aligned_pairs([("files", files)])]
    return "\n".join(line for line in lines if line)


def _aligned(rows: list[tuple[str, ...]]) -> list[str]:
    """Return rows of cells as lines with aligned columns, all left-justified."""
    return aligned(rows, lefts=len(rows[0])).splitlines()


def _values(document: Document) -> list[np.ndarray[Any, np.dtype[np.complex128]]]:
    """Return the eigenvalues in a document: at the start, and along the motion."""
    found = document["eigenvalues"]
    pairs = (np.array(found[key], float) for key in ("at_start", "along"))
    return [x.reshape(-1, 2) @ [1.0, 1j] for x in pairs]


def _borders(document: Document) -> list[str]:
    """Return lines with the stability border of each method.

    A border is given as a step h, and relative to the fastest period.
    """
    borders, span = document["borders"], document["runs"]["duration"]
    if not borders:
        return []
    fastest = (np.max(abs(x.imag), initial=0.0) for x in _values(document))
    rate = next((x for x in fastest if x * span > NEGLIGIBLE_RATE), 0.0)
    rows: list[tuple[str, ...]] = [
        ("method", "holds below (s)", "of the fastest period", "predicted (s)", "")
    ]
    for method, border in borders.items():
        step = border["found"]
        part = f"{step * rate / (2.0 * np.pi):.3g}" if step and rate else ""
        shown = "-" if step is None else f"{step:.3g}"
        rows.append((method, shown, part, _predicted(border), border["note"]))
    return _aligned(rows)


def _predicted(border: Document) -> str:
    """Return the predicted border of a method as text.

    The prediction is by eigenvalues at the start and along the motion: one number if
    both agree.
    """
    first, second = (
        "none" if x is None else "every step grows" if x == 0.0 else f"{x:.3g}"
        for x in (border["predicted_at_start"], border["predicted_along"])
    )
    return first if first == second else f"{first} at the start, {second} on the way"


def _over_parameter(document: Document) -> list[str]:
    """Return lines with the borders at both ends of the varied parameter's range.

    Lines on the work of methods with step control follow.
    """
    name, values = document["vary"]["name"], document["vary"]["values"]
    borders = {
        (method, x[name]): f"{x['found']:.3g}"
        for method, found in document["borders"].items()
        for x in found
        if x["found"] is not None
    }
    work = {
        (cell["method"], cell[name]): f"{cell['evaluations']}, {cell['rejections']}"
        for cell in document["cells"]
        if cell["step"] is None and cell["evaluations"] is not None
    }
    ends = values[0], values[-1]
    fixed, adaptive = document["methods"].values()
    rows: list[tuple[str, ...]] = []
    for head, quantity, methods, texts in (
        ("method", "holds below (s)", fixed, borders),
        ("", "evaluations, rejections", adaptive, work),
    ):
        if methods:
            rows.append((head, *(f"{quantity}, {name} = {v:.4g}" for v in ends)))
        rows += [(m, *(texts.get((m, v), "-") for v in ends)) for m in methods]
    return _aligned(rows)


def _eigenvalues(document: Document) -> list[tuple[str, str]]:
    """Return a summary of eigenvalues: fastest, slowest, damping."""
    if unknown := document["eigenvalues"]["unknown"]:
        return [("eigenvalues", f"none: {unknown}")]
    texts = []
    for where, values in zip(("start", "motion"), _values(document), strict=True):
        known = values[abs(values) * document["runs"]["duration"] > NEGLIGIBLE_RATE]
        if not len(known):
            texts.append(f"{where}: all are 0")
            continue
        damping = -known.real / abs(known)
        ends = known[abs(known).argmin()], known[abs(known).argmax()]
        ratios = dict.fromkeys(map(_number, (min(damping), max(damping))))
        texts.append(
            f"{where}: {' to '.join(dict.fromkeys(map(_complex, ends)))} 1/s, damping "
            f"ratio {' to '.join(ratios)}"
        )
    return titled_rows("eigenvalues", texts)


def _number(value: float) -> str:
    """Return a number as text with three digits; a value within rounding as 0."""
    return f"{value:.3g}" if abs(value) > COMPUTED_ZERO else "0"


def _complex(value: complex) -> str:
    """Return the text of a complex number, or of a conjugate pair of numbers."""
    if abs(value.imag) <= COMPUTED_ZERO * abs(value):
        return f"{value.real:.4g}"
    if abs(value.real) <= COMPUTED_ZERO * abs(value):
        return f"±{abs(value.imag):.4g}i"
    return f"{value.real:.4g} ± {abs(value.imag):.4g}i"


def _modes(document: Document) -> list[str]:
    """Return lines on the equilibrium, and on the modes about it."""
    at = document["equilibrium"]
    if at is None:
        where = f"none: {document['equilibrium_reason']}"
    elif document["equilibrium_is_start"]:
        where = "the start"
    else:
        named = [f"{q} = {x:.6g}" for q, x in at.items()]
        if len(named) > MOST_NAMED:
            named[MOST_NAMED:] = [f"... {len(named) - MOST_NAMED} more"]
        where = ", ".join(named)
    lines = [aligned_pairs([("equilibrium", where)])]
    rows: list[tuple[str, ...]] = [
        ("frequency (Hz)", "period (s)", "damping ratio", "shape")
    ]
    for mode in document["modes"]:
        period = "-" if mode["period"] is None else f"{mode['period']:.5g}"
        shape = [f"{q} {_number(x)}" for q, x in mode["shape"].items()]
        if len(shape) > MOST_OF_A_MODE:
            shape = [*shape[:MOST_OF_A_MODE], "..."]
        ratio = _number(mode["damping_ratio"])
        rows.append((f"{mode['frequency']:.5g}", period, ratio, ", ".join(shape)))
    return lines + _aligned(rows) if rows[1:] else lines
