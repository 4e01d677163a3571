"""`lagsim golden`: models against their stored results."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from lagsim.cli._faults import plain_text, reported
from lagsim.cli._several import Done, alone, each
from lagsim.cli._shared import (
    ERROR,
    JSON,
    UnwritableError,
    annotate,
    coloured,
    flag,
    option,
    print_stderr,
    print_stdout,
    print_warning,
    quiet,
    show_json,
    write_file,
    write_picture,
    writing,
)
from lagsim.cli.compare import differing, judgement, notes, verdict_line
from lagsim.codes import failure, number
from lagsim.codes.known import (
    BUG,
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
from lagsim.run.interrupt import Interrupt, exception_of
from lagsim.run.session import Case, open_case, settings_of
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
from lagsim.studies.trial import Compiled
from lagsim.studies.workers import cores

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.model.model import Model
    from lagsim.studies.comparison import Verdict

    Document = dict[str, Any]

SUITE = "lagsim golden"
# The start of a process takes as long as the comparison of about so many models.
MODELS_EACH = 4


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
    jobs: int | None = option(
        "N", "Number of processes; default up to one for each core.", "-j", "--jobs",
        min=1,
    ),
    as_json: bool = JSON,
    quiet: bool = quiet("Print only differences and faults."),
) -> int:  # fmt: skip
    """Run models and compare the results with their goldens."""
    answers: list[_Answer] = []
    outcomes: list[CaseResult] = []
    interrupt = Interrupt()
    try:
        tasks = [_task(path, folder, plots, as_json, update) for path in models]
        _refuse_twins(tasks)
        # Errors are reported by this process.
        pieces = {
            k: _compared(x, interrupt) if isinstance(x.model, LagsimError) else x
            for k, x in enumerate(tasks)
        }
        with interrupt.noted():
            most = jobs or min(cores(), math.ceil(len(models) / MODELS_EACH))
            for k, found in each(_compared, pieces, models, most, interrupt):
                if printed := found.printed.rstrip("\n"):
                    print_stderr(printed, again=True)
                answer = _answer_in(found)
                answers.append(answer)
                name, path = tasks[k].name, tasks[k].path
                outcomes.append(CaseResult(name, path, answer.seconds, *answer.why))
                if answer.lines and not as_json and not (quiet and not answer.code):
                    print_stdout("\n".join(answer.lines))
        if interrupt.requested:
            raise exception_of(interrupt.signal)
        if junit is not None:
            write_file(junit, junit_document(SUITE, outcomes), folders=True)
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
    """Model to be compared with its golden, with the options of the comparison.

    Attributes
    ----------
    path : str
        The model file.
    model : Model or LagsimError
        The model, or the reason why it cannot be read.
    folder : Path
        The folder of its golden.
    plots : Path or None
        The folder of pictures of failures.
    as_json : bool
        Whether errors are stored in documents, and not printed.
    update : bool
        Whether a new golden is stored.
    """

    path: str
    model: Model | LagsimError
    folder: Path
    plots: Path | None
    as_json: bool
    update: bool

    @property
    def name(self) -> str:
        """The name of the model, or that of its file."""
        return getattr(self.model, "name", Path(self.path).stem)


class _Answer(NamedTuple):
    """Result of the comparison of one model.

    Attributes
    ----------
    code : int
        The exit code.
    document : dict or None
        The entry in the document of the command.
    lines : sequence of str
        The lines of the report.
    why : tuple of str
        Kind, code and text of a failure, for JUnit; empty texts for none.
    faults : sequence
        The errors of a model that cannot be run, as in a document.
    seconds : float
        The duration, in s.
    """

    code: int
    document: Document | None
    lines: Sequence[str] = ()
    why: tuple[str, str, str] = ("", "", "")
    faults: Sequence[Any] = ()
    seconds: float = 0.0


def _compared(task: _Task, interrupt: Interrupt) -> Done:
    """Compare a model with its golden; the document of the result is an `_Answer`."""
    answers: list[_Answer] = []
    began = time.perf_counter()

    def work() -> int:
        try:
            with interrupt.raised():
                answer = _answer(task)
        except LagsimError as error:
            answer = _failed(error, task.path, as_json=task.as_json)
        answers.append(answer._replace(seconds=time.perf_counter() - began))
        return answer.code

    return alone(work, task.path, answers, as_json=task.as_json)


def _answer_in(found: Done) -> _Answer:
    """Return the `_Answer` in the documents of a result.

    If a process has ended without one, it is an answer with an error.
    """
    for answer in found.documents:
        if isinstance(answer, _Answer):
            return answer
    faults = [fault for document in found.documents for fault in document["errors"]]
    text = found.printed.rstrip("\n").rpartition("\n")[2]
    return _Answer(found.code, None, (), ("error", BUG, text), faults)


def _failed(error: LagsimError, path: str | None, *, as_json: bool) -> _Answer:
    found: list[Document] = []
    code = reported(error, found if as_json else None, path)
    document = next((x for x in found if "errors" not in x), None)
    if document is not None:  # of an inadmissible start
        model = document["model"]
        document |= {"model": model["name"], "file": model["file"]}
    faults = [fault for x in found for fault in x.get("errors", ())]
    return _Answer(code, document, (), ("error", error.code, plain_text(error)), faults)


def _task(
    path: str, folder: Path | None, plots: Path | None, as_json: bool, update: bool
) -> _Task:
    model: Model | LagsimError
    try:
        model = read_file(path)
    except LagsimError as error:
        model = error
    folder = folder or Path(path).parent / FOLDER
    return _Task(path, model, folder, plots, as_json, update)


def _refuse_twins(tasks: Sequence[_Task]) -> None:
    """Raise an error if the goldens of two models would be one file."""
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


def _answer(task: _Task) -> _Answer:
    """Compare a model with its golden, and return the answer.

    With `task.update` a new golden is stored instead.
    """
    model = task.model
    if isinstance(model, LagsimError):
        raise model
    settings = settings_of(model, "golden")
    stored = None if task.update else load(task.folder, model.name)
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
        found["unseen"] = known.undetected
        lines += [f"  note: {_unseen(known)}"] if known.undetected else []
    lines += differing(verdict)
    if not verdict.passed and task.plots is not None:
        path = task.plots / f"{model.name}.png"
        if write_picture(path, partial(picture, case, verdict), folders=True):
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
        print_stderr(f"lagsim: {text} [{failed['number']}]")
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
    lines.append(
        f"  it detects changes of {counted(known.detected, 'number')} of the model"
    )
    if known.unresponsive:
        names = several(known.unresponsive, 8)
        lines.append(f"  the motion does not respond to: {names}")
    found |= {"pass": True, "stored": True, "horizon": golden.horizon}
    found |= {"rows": len(golden.rows), "unseen": known.undetected}
    found |= {"warnings": [c.record for c in cautions]} if cautions else {}
    return _Answer(0, found, lines)


def _rows(golden: Golden) -> str:
    """Return a text on the number of rows of a golden, out of all rows of its run."""
    count = len(golden.rows)
    every = golden.about.get("run_rows", count)
    return f"{count} of {every:,} rows" if count < every else counted(count, "row")


def _horizon(golden: Golden) -> str:
    if golden.horizon is None:
        return ""
    passed = f"; past t = {golden.horizon:.4g} of {golden.about['end']:.4g}"
    return f"{passed} only conserved quantities"


def _unseen(known: Summary) -> str:
    names = several(known.undetected, 8)
    return f"small changes that alter the motion, but would not be detected: {names}"


def _doubts(golden: Golden, known: Summary) -> list[Caution]:
    """Return warnings that a golden is a weak test: few rows, or changes not detected.

    known : the stored summary of the changes of numbers, and of their detection.
    """
    model, found = golden.about["model"], []
    if len(golden.rows) < min(LEAST_ROWS, golden.about["run_rows"]):
        text = f"the golden of {model} has {_rows(golden)} only"
        if golden.horizon is not None:
            text += (
                f": past t = {golden.horizon:.4g} the motion is that of rounding errors"
            )
        found.append(Caution(FEW_ROWS, text))
    if known.undetected:
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
