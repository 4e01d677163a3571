"""`lagsim bench`: what each method costs for the error it makes."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import (
    AsJson,
    Picture,
    PictureForm,
    Quiet,
    Sets,
    assignments,
    coloured,
    counted,
    output_folder,
    show_json,
    table,
)
from lagsim.cli._writing import Measured, experiment
from lagsim.errors import InputError, Problem
from lagsim.methods import names
from lagsim.model.reader import read_file
from lagsim.run.session import open_case, wanted
from lagsim.studies.bench.solving import SCIPY, GivenUpError
from lagsim.studies.bench.work_precision import (
    BUDGET,
    OUT_OF_TIME,
    TOLERANCES,
    Wish,
    document,
    files,
    measure,
    read_document,
)
from lagsim.studies.bench.work_precision import table as rows_table

# Of curves that there was no time for so many are named; the JSON has all.
MOST_NAMES = 4

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lagsim.cli._writing import Experiment
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.bench.work_precision import WorkPrecision

    Progress = Callable[[float], None] | None


# Exit codes above it are those of signals.
SIGNALLED = 128


def command(
    models: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL...",
            help="Model files; - is standard input. A work_precision.json is drawn "
            "again, with --methods only for these.",
        ),
    ],
    folder: Annotated[
        Path | None,
        output_folder(
            "Output folder; default results/NAME/bench; DIR/NAME for several models."
        ),
    ] = None,
    sets: Sets = None,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B",
            help="Only these methods; scipy's solvers are scipy:DOP853 and so on.",
        ),
    ] = None,
    tolerances: Annotated[
        str | None,
        typer.Option(
            metavar="A:B", help="Range of rtol, in decades; default 1e-3:1e-13."
        ),
    ] = None,
    steps: Annotated[
        str | None,
        typer.Option(
            metavar="A:B",
            help="Range of steps of fixed-step methods; each is half of the one "
            "before.",
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Time limit for each model; default 180."),
    ] = None,
    form: PictureForm = Picture.PNG,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Compare the methods: error against computing time."""
    documents: list[Any] = []
    codes = [0]
    faults: list[Any] = []
    with faults_shown(faults if as_json else None) as code:
        wish = _wish(methods, tolerances, steps, budget)
        overrides = assignments(sets)
        code.append(0)
    codes += code
    for path in models if code[-1] == 0 else []:
        with faults_shown(faults if as_json else None, file=path) as code:
            asked = _drawn_again if path.endswith(".json") else _measured
            measure, usual = asked(path, overrides, wish, form.value)
            target = folder / Path(path).stem if folder and models[1:] else folder
            code.append(
                experiment(
                    "bench", measure, target or usual, "work_precision.json",
                    documents, quiet=quiet, as_json=as_json,
                )
            )  # fmt: skip
        codes += code
        documents += [x for x in faults if "errors" not in x]  # inadmissible starts
        faults = [x for x in faults if "errors" in x]
        if codes[-1] > SIGNALLED:
            break
    if as_json:
        problems = [problem for fault in faults for problem in fault["errors"]]
        show_json({"errors": problems} if problems else documents)
    return max(codes)


def _measured(
    path: str, overrides: Mapping[str, str], wish: Wish, form: str
) -> tuple[Experiment, Path]:
    """Give what measures a model, and where that goes by default."""
    model = read_file(path, overrides)
    case = open_case(model, wanted(model, "bench"))

    def measured(interrupt: Interrupt, progress: Progress) -> Measured | None:
        try:
            found = measure(case, wish, interrupt=interrupt, progress=progress)
        except GivenUpError:
            return None
        content = document(model, case.settings, found, files(form))
        summary = partial(_summary, model, found)
        return _written(content, content["rows"], form, summary)

    return measured, Path("results") / model.name / "bench"


def _drawn_again(
    path: str, overrides: Mapping[str, str], wish: Wish, form: str
) -> tuple[Experiment, Path]:
    """Give what draws again what was measured, and where that stands.

    Raises
    ------
    InputError
    """
    if overrides or wish != Wish(wish.methods):
        text = f"{path} holds finished measurements: only --methods can be chosen"
        hint = "measure again: lagsim bench MODEL"
        raise InputError([Problem("usage", text, hint=hint)])
    content = read_document(path) | {"files": files(form)}
    shown = [row for row in content["rows"] if wish.wants(row["method"])]
    drawn = coloured("drawn", "32")
    found = _written(content, shown, form, lambda listed: f"{drawn}: {listed}")
    return lambda *_: found, Path(path).parent


def _written(
    content: dict[str, Any], shown: Any, form: str, summary: Callable[[str], str]
) -> Measured:
    """Give what is written of a document; the chart shows these rows."""

    def draw() -> bytes:
        from lagsim.studies.bench.chart import chart

        return chart(content | {"rows": shown}, form)

    table_name, chart_name, _ = content["files"]
    rows = {table_name: rows_table(content["rows"])}
    return Measured(content, rows, chart_name, draw, summary)


def _wish(
    methods: str | None,
    tolerances: str | None,
    steps: str | None,
    budget: float | None,
) -> Wish:
    """Take the options apart.

    Raises
    ------
    InputError
    """
    problems: list[Problem] = []
    wanted = None
    if methods is not None:
        wanted = tuple(name.strip() for name in methods.split(","))
        problems += _unknown(wanted)
    between = _between("--tolerances", tolerances, problems) or TOLERANCES
    seconds = BUDGET if budget is None else budget
    if not 0.0 < seconds < float("inf"):
        text = f"--budget {seconds:g}: a number of seconds above 0 is expected"
        problems.append(Problem("usage", text))
    wish = Wish(wanted, between, _between("--steps", steps, problems), seconds)
    if problems:
        raise InputError(problems)
    return wish


def _unknown(wanted: tuple[str, ...]) -> list[Problem]:
    known = [*names(), *SCIPY]
    hint = f"of {', '.join(known)}; `lagsim methods` describes those that are ours"
    return [
        Problem("unknown-method", f"there is no method `{name}`", hint=hint)
        for name in wanted
        if name not in known
    ]


def _between(
    option: str, text: str | None, problems: list[Problem]
) -> tuple[float, float] | None:
    """Take A:B apart: two numbers above 0, the larger first."""
    if text is None:
        return None
    try:
        first, last = (float(part) for part in text.split(":"))
    except ValueError:
        first = last = 0.0
    if not (min(first, last) > 0.0 and max(first, last) < float("inf")):
        message = f"{option} {text}: two numbers above 0 are expected"
        problems.append(Problem("usage", message, hint=f"such as {option} 1e-3:1e-9"))
        return None
    return max(first, last), min(first, last)


def _summary(model: Model, found: WorkPrecision, files: str) -> str:
    """Give the closing lines."""
    state, colour = ("interrupted", "31") if found.interrupted else ("done", "32")
    head = (
        f"{coloured(state, colour)}: {model.name}, "
        f"{counted(len(found.entries), 'solve')} by "
        f"{counted(len(found.curves()), 'method')}"
    )
    rows = [("reference", found.reference.trust)]
    rows += [("" if k else "left out", text) for k, text in enumerate(_left_out(found))]
    front = [found.entries[k] for k in found.front("seconds")]
    rows += [("" if k else "best", _point(e)) for k, e in enumerate(front)]
    rows.append(("time", _time(found)))
    rows.append(("files", files))
    return head + "\n" + table(rows)


def _time(found: WorkPrecision) -> str:
    """Say what all took, and what there was no time for."""
    cut = {e.curve: None for e in found.entries if e.outcome == OUT_OF_TIME}
    said = f"{found.seconds:.3g} s of {found.budget:g}"
    if not cut:
        return said
    names = [f"{method} ({formulation})" for method, formulation in cut]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    named = ", ".join(names[:MOST_NAMES]) + more
    return f"{said}: not enough to finish {named}; --budget allows more"


def _left_out(found: WorkPrecision) -> list[str]:
    """Give the methods that do not apply, those with the same reason together."""
    by_reason: dict[str, list[str]] = {}
    for refused in found.refused:
        if refused.formulation == "auto":
            by_reason.setdefault(refused.reason, []).append(refused.method)
    return [f"{', '.join(who)}: {reason}" for reason, who in by_reason.items()]


def _point(entry: Any) -> str:
    auto = ", what auto takes" if entry.chosen else ""
    return (
        f"error {entry.error:.1e} in {entry.seconds * 1e3:.3g} ms: {entry.method} "
        f"({entry.formulation}), {entry.setting} {entry.value:.3g}{auto}"
    )
