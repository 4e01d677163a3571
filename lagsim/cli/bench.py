"""`lagsim bench`: what each method costs for the error it makes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._closing import progress_bar
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
from lagsim.cli._streams import say
from lagsim.cli._writing import commit_with_chart
from lagsim.errors import InputError, Problem
from lagsim.methods import names

# Of curves that there was no time for so many are named; the JSON has all.
MOST_NAMES = 4

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.model.model import Model
    from lagsim.outputs.results import Results
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case
    from lagsim.studies.bench.work_precision import Wish, WorkPrecision


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
            target = folder / Path(path).stem if folder and models[1:] else folder
            job = _Job(target, form.value, as_json=as_json, quiet=quiet)
            code.append(job.run(path, overrides, wish))
            documents += job.documents
        codes += code
        documents += [x for x in faults if "errors" not in x]  # inadmissible starts
        faults = [x for x in faults if "errors" in x]
        if codes[-1] > SIGNALLED:
            break
    if as_json:
        problems = [problem for fault in faults for problem in fault["errors"]]
        show_json({"errors": problems} if problems else documents)
    return max(codes)


class _Job:
    """One model, and the manners of the command."""

    def __init__(
        self, folder: Path | None, form: str, *, as_json: bool, quiet: bool
    ) -> None:
        self.folder, self.as_json, self.quiet = folder, as_json, quiet
        self.form = form
        self.documents: list[Any] = []

    def run(self, path: str, overrides: Mapping[str, str], wish: Wish) -> int:
        """Do it; give the exit code."""
        if path.endswith(".json"):
            return self._draw(path, overrides, wish)
        from lagsim.model.reader import read_file
        from lagsim.run.session import open_case, wanted

        model = read_file(path, overrides)
        case = open_case(model, wanted(model, "bench"))
        from lagsim.outputs.results import open_results
        from lagsim.studies.bench.work_precision import MANIFEST

        folder = self.folder or Path("results") / model.name / "bench"
        with open_results(folder, MANIFEST) as results:
            return self._measure(case, wish, results)

    def _measure(self, case: Case, wish: Wish, results: Results) -> int:
        from lagsim.run.interrupt import Interrupt
        from lagsim.studies.bench.solving import GivenUpError
        from lagsim.studies.bench.work_precision import document, files, measure

        interrupt = Interrupt()
        with interrupt.noted():
            with progress_bar("bench", quiet=self.quiet) as progress:
                try:
                    found = measure(case, wish, interrupt=interrupt, progress=progress)
                except GivenUpError:
                    return 128 + (interrupt.signal or 0)
            model = case.equations.model
            content = document(model, case.settings, found, files(self.form))
            self._commit(content, content["rows"], results, interrupt)
        if not self.quiet and not self.as_json:
            listed = ", ".join(self.documents[-1]["files"])
            say(_summary(model, found, f"{results.folder}: {listed}"))
        return 128 + interrupt.signal if interrupt.signal is not None else 0

    def _draw(self, path: str, overrides: Mapping[str, str], wish: Wish) -> int:
        """Draw again what was measured."""
        from lagsim.outputs.results import open_results
        from lagsim.run.interrupt import Interrupt
        from lagsim.studies.bench.work_precision import (
            MANIFEST,
            Wish,
            files,
            read_document,
        )

        if overrides or wish != Wish(wish.methods):
            text = f"{path} holds finished measurements: only --methods can be chosen"
            hint = "measure again: lagsim bench MODEL"
            raise InputError([Problem("usage", text, hint=hint)])
        content = read_document(path) | {"files": files(self.form)}
        shown = [row for row in content["rows"] if wish.wants(row["method"])]
        with open_results(self.folder or Path(path).parent, MANIFEST) as results:
            self._commit(content, shown, results, Interrupt())
        if not self.quiet and not self.as_json:
            listed = ", ".join(content["files"])
            say(f"{coloured('drawn', '32')}: {results.folder}: {listed}")
        return 0

    def _commit(
        self,
        content: dict[str, Any],
        shown: Any,
        results: Results,
        interrupt: Interrupt,
    ) -> None:
        """Write everything; the chart shows these rows."""
        from lagsim.studies.bench.work_precision import table as rows_table

        def drawn() -> bytes:
            from lagsim.studies.bench.chart import chart

            return chart(content | {"rows": shown}, self.form)

        table_name, chart_name, _ = content["files"]
        document = commit_with_chart(
            results, content, {table_name: rows_table(content["rows"])},
            chart_name, drawn, interrupt,
        )  # fmt: skip
        self.documents.append(document)


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
    from lagsim.studies.bench.work_precision import BUDGET, TOLERANCES, Wish

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
    from lagsim.studies.bench.solving import SCIPY

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
    from lagsim.studies.bench.work_precision import OUT_OF_TIME

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
