"""`lagsim golden`: models against their stored results."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from lagsim.cli._faults import plain_text, reported
from lagsim.cli._shared import (
    ERROR,
    JSON,
    UnwritableError,
    annotate,
    coloured,
    complain,
    flag,
    option,
    print_warning,
    put_file,
    put_picture,
    quiet,
    say,
    show_json,
    writing,
)
from lagsim.cli.compare import differing, judgement, notes, verdict_line
from lagsim.codes import failure, number
from lagsim.codes.known import (
    CHANGE_UNSEEN,
    DIFFERS,
    FEW_ROWS,
    INCOMPLETE,
    ONE_NAME,
)
from lagsim.errors import LagsimError, Problems, counted, several
from lagsim.model.reader import read_file
from lagsim.notes import Caution
from lagsim.outputs.junit import CaseResult
from lagsim.outputs.junit import document as junit_document
from lagsim.run.session import Case, open_case, wanted
from lagsim.studies.golden import (
    CHANGES,
    FOLDER,
    LEAST_ROWS,
    Golden,
    Summary,
    judge,
    load,
    new_golden,
    picture,
    run,
    store,
    summary,
)
from lagsim.studies.trials import Compiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.model.model import Model
    from lagsim.studies.comparison import Verdict

    Document = dict[str, Any]

SUITE = "lagsim golden"


def command(
    models: list[str] = typer.Argument(
        metavar="MODEL...", help="Model files; - is standard input."
    ),
    folder: Path | None = option(
        "DIR", "Folder of the goldens; default golden/ beside each model.", "--dir"
    ),
    update: bool = flag("--update", "Store new goldens, and replace old ones."),
    plots: Path | None = option(
        "DIR", "Draw the columns that differ most: DIR/NAME.png."
    ),
    junit: Path | None = option("FILE", "Write a report in JUnit XML for CI servers."),
    as_json: bool = JSON,
    quiet: bool = quiet("Print only differences and faults."),
) -> int:  # fmt: skip
    """Run models and compare the results with their goldens."""
    answers: list[_Answer] = []
    outcomes: list[CaseResult] = []
    try:
        tasks = [_task(path, folder) for path in models]
        _refuse_twins(tasks)
        for task in tasks:
            began = time.perf_counter()
            try:
                answer = _answer(task, plots, update=update)
            except LagsimError as error:
                answer = _failed(error, task.path, as_json=as_json)
            answers.append(answer)
            seconds = time.perf_counter() - began
            outcomes.append(CaseResult(task.name, task.path, seconds, *answer.why))
            if answer.lines and not as_json and not (quiet and not answer.code):
                say("\n".join(answer.lines))
        if junit is not None:
            put_file(junit, junit_document(SUITE, outcomes), folders=True)
    except LagsimError as error:
        answers.append(_failed(error, None, as_json=as_json))
    code = max(answer.code for answer in answers)
    if as_json:
        documents = [answer.document for answer in answers if answer.document]
        faults = [fault for answer in answers for fault in answer.faults]
        content: Document = {"pass": code == 0, "models": documents}
        show_json(content | ({"errors": faults} if faults else {}))
    return code


class _Task(NamedTuple):
    """Model to be compared with its golden, and the folder of the golden.

    If the model cannot be read, the error takes its place.
    """

    path: str
    model: Model | LagsimError
    folder: Path

    @property
    def name(self) -> str:
        """The name of the model, or that of its file."""
        return getattr(self.model, "name", Path(self.path).stem)


class _Answer(NamedTuple):
    """Result of one model: exit code, document, and lines of the report.

    `why` has kind, code and text of a failure for JUnit, `faults` the faults of the
    model.
    """

    code: int
    document: Document | None
    lines: Sequence[str] = ()
    # Kind, code and text of a failure, for JUnit.
    why: tuple[str, str, str] = ("", "", "")
    # The errors of a model that cannot be run.
    faults: Sequence[Any] = ()


def _failed(error: LagsimError, path: str | None, *, as_json: bool) -> _Answer:
    found: list[Document] = []
    code = reported(error, found if as_json else None, path)
    document = next((x for x in found if "errors" not in x), None)
    if document is not None:  # of an inadmissible start
        model = document["model"]
        document |= {"model": model["name"], "file": model["file"]}
    faults = [fault for x in found for fault in x.get("errors", ())]
    return _Answer(code, document, (), ("error", error.code, plain_text(error)), faults)


def _task(path: str, folder: Path | None) -> _Task:
    model: Model | LagsimError
    try:
        model = read_file(path)
    except LagsimError as error:
        model = error
    return _Task(path, model, folder or Path(path).parent / FOLDER)


def _refuse_twins(tasks: Sequence[_Task]) -> None:
    """Raise an error if two models would have one golden file."""
    first: dict[tuple[Path, str], str] = {}
    problems = Problems()
    for task in tasks:
        path, name, folder = task.path, task.name, task.folder
        if isinstance(task.model, LagsimError):
            continue
        other = first.setdefault((folder.resolve(), name), path)
        if Path(other).resolve() != Path(path).resolve():
            text = f"{other} and {path} are both named `{name}`, and would share "
            text += f"one golden in {folder}"
            hint = "change the `name` of one model; no model was run"
            problems.add(ONE_NAME, text, hint=hint)
    problems.refuse()


def _answer(task: _Task, plots: Path | None, *, update: bool) -> _Answer:
    """Compare a model with its golden, or store a new golden with `update`.

    plots : folder of pictures of failures.
    """
    model = task.model
    if isinstance(model, LagsimError):
        raise model
    settings = wanted(model, "golden")
    stored = None if update else load(task.folder, model.name)
    case = open_case(model, settings)
    if stored is None:
        return _store(case, task.folder)
    verdict = judge(case, run(case, stored), stored)
    found = judgement(verdict) | {
        "model": model.name,
        "file": model.file,
        "horizon": stored.horizon,
        "rows": len(stored.rows),
        "faults": verdict.faults,
        "notes": verdict.notes,
    }
    lines = [f"  {note}" for note in notes(verdict)]
    lines += [f"  note: {note}" for note in verdict.notes]
    known = summary(stored)
    if known is not None:
        found["unseen"] = known.blind
        lines += [f"  note: {_unseen(known)}"] if known.blind else []
    lines += differing(verdict)
    if not verdict.passed and plots is not None:
        path = plots / f"{model.name}.png"
        if put_picture(path, partial(picture, case, verdict), folders=True):
            lines.append(f"  picture: {path}")
            found["picture"] = str(path)
    compared = f"{model.name}, {_rows(stored)} compared{_horizon(stored)}"
    shown = [verdict_line(verdict, "differs", compared), *lines]
    if verdict.passed:
        return _Answer(0, found, shown)
    text = f"{model.name} differs from its golden: {_worst(verdict)}"
    line, column = (p.line, p.column) if (p := verdict.place) else (1, 1)
    annotation = "; ".join([text, *verdict.changed])
    annotate(ERROR, annotation, model.file, line, column, number(DIFFERS))
    return _Answer(1, found, shown, ("failure", DIFFERS, "\n".join([text, *lines])))


def _store(case: Case, folder: Path) -> _Answer:
    model = case.model
    compiled = Compiled()
    golden, base = new_golden(case, compiled)
    found: Document = {"model": model.name, "file": model.file}
    if not base.trial.complete:
        text = f"no golden of {model.name}: {base.trial.reason}"
        failed = failure(INCOMPLETE)
        complain(f"lagsim: {text} [{failed['number']}]")
        found |= {"pass": False, "failure": failed}
        return _Answer(
            UnwritableError.exit_code, found, (), ("error", INCOMPLETE, text)
        )
    from lagsim.studies.responses import responses

    changes = responses(case, golden, base, compiled)
    golden = replace(golden, about=golden.about | {CHANGES: changes})
    known = summary(golden)
    assert known is not None
    with writing(folder):
        size, cautions = store(model.name, golden, folder)
    cautions += _doubts(golden, known)
    for caution in cautions:
        print_warning(caution)
    counts = f"{_rows(golden)}, "
    counts += f"{counted(len(golden.columns), 'column')}, {size / 1024:.0f} kB"
    lines = [f"{coloured('stored', '32')}: {model.name}, {counts}{_horizon(golden)}"]
    lines.append(f"  it sees changes of {counted(known.seen, 'number')} of the model")
    if known.unresponsive:
        names = several(known.unresponsive, 8)
        lines.append(f"  the motion does not respond to: {names}")
    found |= {"pass": True, "stored": True, "horizon": golden.horizon}
    found |= {"rows": len(golden.rows), "unseen": known.blind}
    found |= {"warnings": [c.record for c in cautions]} if cautions else {}
    return _Answer(0, found, lines)


def _rows(golden: Golden) -> str:
    """Return a text on the number of rows that are compared, out of all rows."""
    count = len(golden.rows)
    every = golden.about.get("run_rows", count)
    return f"{count} of {every:,} rows" if count < every else counted(count, "row")


def _horizon(golden: Golden) -> str:
    if golden.horizon is None:
        return ""
    passed = f"; past t = {golden.horizon:.4g} of {golden.about['end']:.4g}"
    return f"{passed} only conserved quantities"


def _unseen(known: Summary) -> str:
    names = several(known.blind, 8)
    return f"small changes that alter the motion, and would not be seen: {names}"


def _doubts(golden: Golden, known: Summary) -> list[Caution]:
    """Return warnings on numbers whose changes the golden does not detect.

    known : the stored summary of such changes.
    """
    model, found = golden.about["model"], []
    if len(golden.rows) < min(LEAST_ROWS, golden.about["run_rows"]):
        text = f"the golden of {model} has {_rows(golden)} only"
        if golden.horizon is not None:
            text += (
                f": past t = {golden.horizon:.4g} the motion is that of rounding errors"
            )
        found.append(Caution(FEW_ROWS, text))
    if known.blind:
        found.append(Caution(CHANGE_UNSEEN, f"{model}: {_unseen(known)}"))
    return found


def _worst(verdict: Verdict) -> str:
    """Return a short text on the largest difference of a verdict."""
    failed, parts = verdict.failed, [*verdict.faults]
    if verdict.missing:
        parts.append(f"{counted(len(verdict.missing), 'column')} missing")
    if failed:
        parts.append(
            f"{counted(len(failed), 'column')} beyond the bound, the worst "
            f"{failed[0].column} at t = {failed[0].t:.9g}"
        )
    return "; ".join(parts)
