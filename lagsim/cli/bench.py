"""`lagsim bench`: the cost of each method for the error it makes."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lagsim.cli._faults import reported
from lagsim.cli._shared import (
    FORMAT,
    JSON,
    SETS,
    Measured,
    PictureFormat,
    aligned_pairs,
    assignments,
    coloured,
    csv,
    experiment,
    headline,
    left_out,
    methods_of,
    option,
    output_folder,
    parse_range,
    quiet,
    show_json,
    titled_rows,
)
from lagsim.codes.known import UNKNOWN_METHOD, USAGE
from lagsim.errors import LagsimError, Problem, Problems, several, unusable
from lagsim.methods import names
from lagsim.model.reader import read_file
from lagsim.run.session import open_case, settings_of
from lagsim.studies.bench import SCIPY
from lagsim.studies.bench.work_precision import (
    BUDGET,
    COLUMNS,
    OUT_OF_TIME,
    TOLERANCES,
    BenchOptions,
    curves,
    front,
    measure,
    read_document,
)
from lagsim.studies.options import TOLERANCE_RANGE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.cli._shared import Measure, Progress
    from lagsim.run.interrupt import Interrupt

    Document = dict[str, Any]

TABLE, MANIFEST = "work_precision.csv", "work_precision.json"
# The largest number of curves named for lack of time; the JSON lists all.
MOST_NAMES = 4
# Exit codes above it are those of signals.
SIGNALLED = 128


def command(
    models: list[str] = typer.Argument(
        metavar="MODEL...",
        help="Model files; - is standard input. A work_precision.json is drawn again, "
        "with --methods only for these.",
    ),
    folder: Path | None = output_folder(
        "Output folder; default results/NAME/bench; DIR/NAME for several models."
    ),
    sets: list[str] | None = SETS,
    methods: str | None = option(
        "A,B", "Only these methods; scipy's solvers are scipy:DOP853 and so on."
    ),
    tolerances: str | None = option(
        "A:B", "Range of rtol, in decades; default 1e-3:1e-13."
    ),
    steps: str | None = option(
        "A:B", "Range of steps of fixed-step methods; each is half of the one before."
    ),
    budget: float | None = option("SECONDS", "Time limit for each model; default 180."),
    form: PictureFormat = FORMAT,
    as_json: bool = JSON,
    quiet: bool = quiet(),
) -> int:  # fmt: skip
    """Compare the methods: error against computing time."""
    options = _parsed_options(methods, tolerances, steps, budget)
    overrides = assignments(sets)
    documents, faults, codes = list[Any](), list[Any](), [0]
    for path in models:
        try:
            read = _drawn_again if path.endswith(".json") else _opened
            measure, usual = read(path, overrides, options, form.value)
            target = folder / Path(path).stem if folder and models[1:] else folder
            code = experiment(
                "bench", measure, target or usual, MANIFEST, documents, quiet=quiet,
                as_json=as_json,
            )  # fmt: skip
        except LagsimError as error:
            found: list[Any] = []
            code = reported(error, found if as_json else None, path)
            for x in found:  # of an inadmissible start, or of faults
                (faults if "errors" in x else documents).append(x)
        codes.append(code)
        if code > SIGNALLED:
            break
    if as_json:
        problems = [problem for fault in faults for problem in fault["errors"]]
        show_json({"errors": problems} if problems else documents)
    return max(codes)


def _opened(
    path: str, overrides: Mapping[str, str], options: BenchOptions, form: str
) -> tuple[Measure, Path]:
    """Return the function that measures a model, and the folder of its results.

    The function is an argument of `experiment`.

    path : the model file.
    overrides : values of `--set`.
    options : options of the bench.
    form : format of pictures.
    """
    model = read_file(path, overrides)
    # Every method is tried, and some need derivatives of the forces.
    model = model.written_out()
    case = open_case(model, settings_of(model, "bench"))

    def measured(interrupt: Interrupt, progress: Progress) -> Measured:
        document = measure(case, options, interrupt=interrupt, progress=progress)
        return _written(document, document["rows"], form, partial(_summary, document))

    return measured, Path("results") / model.name / "bench"


def _drawn_again(
    path: str, overrides: Mapping[str, str], options: BenchOptions, form: str
) -> tuple[Measure, Path]:
    """Return the function that draws a stored measurement again, and its folder.

    path : a work_precision.json. Other arguments as for `_opened`.
    """
    if overrides or options != BenchOptions(options.methods):
        text = f"{path} holds finished measurements: only --methods can be chosen"
        hint = "measure again: lagsim bench MODEL"
        raise unusable(USAGE, text, hint=hint)
    document = read_document(path)
    shown = [row for row in document["rows"] if options.is_requested(row["method"])]
    drawn = coloured("drawn", "32")
    found = _written(document, shown, form, lambda files: f"{drawn}: {files}")
    return lambda *_: found, Path(path).parent


def _written(
    document: Document,
    shown: Sequence[Document],
    form: str,
    summary: Callable[[str], str],
) -> Measured:
    """Return a measurement as `experiment` writes it: files, document and summary.

    shown : the rows that the chart shows.
    """

    def draw() -> bytes:
        from lagsim.studies.bench.chart import work_precision

        return work_precision(document | {"rows": shown}, form)

    tables = {TABLE: csv(COLUMNS, document["rows"])}
    return Measured(document, tables, f"work_precision.{form}", draw, summary)


def _parsed_options(
    methods: str | None, tolerances: str | None, steps: str | None, budget: float | None
) -> BenchOptions:
    """Parse the options of the command into `BenchOptions`."""
    problems = Problems()
    chosen = methods_of(methods)
    if chosen is not None:
        known = [*names(), *SCIPY]
        hint = f"of {', '.join(known)}; `lagsim methods` describes lagsim's own"
        problems += [
            Problem(UNKNOWN_METHOD, f"there is no method `{name}`", hint=hint)
            for name in chosen
            if name not in known
        ]
    between = _between("--tolerances", tolerances, problems) or TOLERANCES
    seconds = BUDGET if budget is None else budget
    if not 0.0 < seconds < float("inf"):
        text = f"--budget {seconds:g}: a number of seconds above 0 is expected"
        problems.add(USAGE, text)
    options = BenchOptions(
        chosen, between, _between("--steps", steps, problems), seconds
    )
    problems.refuse()
    return options


def _between(
    option: str, text: str | None, problems: Problems
) -> tuple[float, float] | None:
    """Return the two numbers above 0 of a text A:B, the larger first.

    None without a text, or after a problem, which is added to `problems`.
    """
    if text is None:
        return None
    expected = TOLERANCE_RANGE._replace(example=f"{option} 1e-3:1e-9")
    found = parse_range(problems, option, text, expected)
    return found and (found[1], found[0])


def _summary(document: Document, files: str) -> str:
    """Return the summary that the command prints at its end.

    files : text on the files that were written.
    """
    rows, reference = document["rows"], document["reference"]
    counts = (len(rows), "solve"), (len(curves(rows)), "method")
    refused = [x for x in document["refused"] if x["formulation"] == "auto"]
    best = front(rows, "seconds", reference["floor"])
    lines = [
        ("reference", reference["trust"]), *left_out(refused),
        *titled_rows("best", (_point(rows[k]) for k in best)),
        ("time", _time(document)), ("files", files),
    ]  # fmt: skip
    return headline(document, *counts) + "\n" + aligned_pairs(lines)


def _time(document: Document) -> str:
    """Return a line on the time spent, and on curves left out for lack of time."""
    cut = curves(row for row in document["rows"] if row["outcome"] == OUT_OF_TIME)
    budget = document["budget"]
    text = f"{budget['spent']:.3g} s of {budget['seconds']:g}"
    if not cut:
        return text
    named = several((f"{method} ({form})" for method, form in cut), MOST_NAMES)
    return f"{text}: not enough to finish {named}; --budget allows more"


def _point(row: Document) -> str:
    auto = " (selected by auto)" if row["chosen"] else ""
    return (
        f"error {row['error']:.1e} in {row['seconds'] * 1e3:.3g} ms: {row['method']} "
        f"({row['formulation']}), {row['setting']} {row['value']:.3g}{auto}"
    )
