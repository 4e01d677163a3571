"""`lagsim golden`: models against their stored results."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from lagsim.cli._faults import faults_shown, plain
from lagsim.cli._shared import (
    AsJson,
    coloured,
    counted,
    show_json,
)
from lagsim.cli._streams import ERROR, UnwritableError, annotate, complain, say
from lagsim.cli._writing import put_file, put_picture, writing
from lagsim.cli.compare import DIFFERS, LISTED, as_mapping, differing
from lagsim.codes import failure, number
from lagsim.errors import InputError, LagsimError, Problem
from lagsim.model.reader import read_file
from lagsim.outputs.junit import Outcome
from lagsim.outputs.junit import document as written
from lagsim.run.session import open_case, wanted
from lagsim.studies.golden import (
    folder_of,
    judge,
    load,
    measure,
    picture,
    run,
    store,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.model.model import Model
    from lagsim.run.session import Case
    from lagsim.studies.comparison import Verdict
    from lagsim.studies.golden import Golden

SUITE = "lagsim golden"


def command(
    models: Annotated[
        list[str],
        typer.Argument(metavar="MODEL...", help="Model files; - is standard input."),
    ],
    folder: Annotated[
        Path | None,
        typer.Option(
            "--dir",
            metavar="DIR",
            help="Folder of the goldens; default golden/ beside each model.",
        ),
    ] = None,
    update: Annotated[
        bool, typer.Option("--update", help="Store new goldens, and replace old ones.")
    ] = False,
    plots: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Draw the columns that differ most: DIR/NAME.png."
        ),
    ] = None,
    junit: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write a report in JUnit XML for CI servers."
        ),
    ] = None,
    as_json: AsJson = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Print only differences and faults.")
    ] = False,
) -> int:
    """Run models and compare them with their goldens."""
    job = _Job(plots, update=update, as_json=as_json, quiet=quiet)
    with faults_shown(job.faults if as_json else None) as codes:
        wanted = [_wanted(path, folder) for path in models]
        _refuse_twins(wanted)
        codes += [job.run(one) for one in wanted]
        if junit is not None:
            put_file(junit, written(SUITE, job.outcomes), folders=True)
    code = max(codes)
    if as_json:
        faults = [error for found in job.faults for error in found["errors"]]
        content: dict[str, Any] = {"pass": code == 0, "models": job.documents}
        show_json(content | ({"errors": faults} if faults else {}))
    return code


class _Wanted(NamedTuple):
    """A model, or why it cannot be read, and the folder of its golden."""

    path: str
    model: Model | LagsimError
    folder: Path


def _wanted(path: str, folder: Path | None) -> _Wanted:

    folder = folder or folder_of(path)
    try:
        return _Wanted(path, read_file(path), folder)
    except LagsimError as error:
        return _Wanted(path, error, folder)


def _refuse_twins(wanted: Sequence[_Wanted]) -> None:
    """Refuse models whose goldens would be the same files.

    Raises
    ------
    InputError
        That names both files.
    """
    first: dict[tuple[Path, str], str] = {}
    problems = []
    for path, model, folder in wanted:
        if isinstance(model, LagsimError):
            continue
        other = first.setdefault((folder.resolve(), model.name), path)
        if Path(other).resolve() != Path(path).resolve():
            text = (
                f"{other} and {path} are both named `{model.name}`, and would share "
                f"one golden in {folder}"
            )
            hint = "give one of them another `name`; nothing was run"
            problems.append(Problem("one-name", text, hint=hint))
    if problems:
        raise InputError(problems)


@dataclass
class _Job:
    """The options of the command, and what it has found."""

    plots: Path | None
    update: bool
    as_json: bool
    quiet: bool
    documents: list[Any] = field(default_factory=list)
    faults: list[Any] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)

    def run(self, wanted: _Wanted) -> int:
        """Do it for one model; give the exit code."""
        path, model, folder = wanted
        began = time.perf_counter()
        told: list[Any] = []
        raised: list[LagsimError] = []
        why = ("", "", "")
        with faults_shown(
            told if self.as_json else None, file=path, raised=raised
        ) as codes:
            if isinstance(model, LagsimError):
                raise model
            code, why = self._judged(model, folder)
            codes.append(code)
        for found in told:
            if "errors" in found:
                self.faults.append(found)
            else:  # an inadmissible start
                name, file = found["model"]["name"], found["model"]["file"]
                self.documents.append(found | {"model": name, "file": file})
        for error in raised:
            why = "error", error.code, plain(error)
        name = Path(path).stem if isinstance(model, LagsimError) else model.name
        seconds = time.perf_counter() - began
        self.outcomes.append(Outcome(name, path, seconds, *why))
        return codes[-1]

    def _judged(self, model: Model, folder: Path) -> tuple[int, tuple[str, str, str]]:
        """Give the exit code, and what `Outcome` says of why."""
        settings = wanted(model, "golden")
        stored = None if self.update else load(folder, model.name)
        case = open_case(model, settings)
        if stored is None:
            return self._store(case, folder)

        motion = run(case, stored)
        judgement = judge(case, motion, stored)
        found = document(model, judgement, stored.golden)
        lines = report(judgement)
        if not judgement.passed and self.plots is not None:
            path = self.plots / f"{model.name}.png"
            draw = partial(picture, case, judgement)
            if put_picture(path, draw, folders=True):
                lines.append(f"  picture: {path}")
                found["picture"] = str(path)
        self.documents.append(found)
        if not self.as_json and not (self.quiet and judgement.passed):
            say("\n".join([headline(model, judgement, stored.golden), *lines]))
        if judgement.passed:
            return 0, ("", "", "")
        text = f"{model.name} differs from its golden: {worst(judgement)}"
        told = "; ".join([text, *judgement.changed])
        line, column = (p.line, p.column) if (p := judgement.place) else (1, 1)
        annotate(ERROR, told, model.file, line, column, number(DIFFERS))
        return 1, ("failure", DIFFERS, "\n".join([text, *lines]))

    def _store(self, case: Case, folder: Path) -> tuple[int, tuple[str, str, str]]:

        model = case.equations.model
        golden, base = measure(case)
        if not base.trajectory.outcome.complete:
            text = f"no golden of {model.name}: {base.trajectory.reason}"
            failed = failure("incomplete")
            complain(f"lagsim: {text} [{failed['number']}]")
            told = {"pass": False, "failure": failed}
            self.documents.append(_name(model) | told)
            return UnwritableError.exit_code, ("error", "incomplete", text)
        with writing(folder):
            size = store(case, golden, base, folder)
        found = {"pass": True, "stored": True, "horizon": golden.horizon}
        self.documents.append(_name(model) | found)
        if not self.as_json and not self.quiet:
            say(
                f"{coloured('stored', '32')}: {model.name}, "
                f"{counted(len(golden.rows), 'row')}, "
                f"{counted(len(golden.columns), 'column')}, {size / 1024:.0f} kB"
                f"{_horizon(golden)}"
            )
        return 0, ("", "", "")


def _name(model: Model) -> dict[str, Any]:
    return {"model": model.name, "file": model.file}


def _horizon(golden: Golden) -> str:
    if golden.horizon is None:
        return ""
    return f"; past t = {golden.horizon:.4g} only conserved quantities"


def headline(model: Model, judgement: Verdict, golden: Golden) -> str:
    """Give the verdict on a line."""
    passed = judgement.passed
    verdict = coloured("same", "32") if passed else coloured("differs", "31")
    rows = counted(len(golden.rows), "row")
    numbered = "" if passed else f" [{number(DIFFERS)}]"
    return f"{verdict}: {model.name}, {rows} compared{_horizon(golden)}{numbered}"


def worst(judgement: Verdict) -> str:
    """Say what differs, in a few words."""
    failed, said = judgement.failed, [*judgement.faults]
    if judgement.missing:
        said.append(f"{counted(len(judgement.missing), 'column')} missing")
    if failed:
        said.append(
            f"{counted(len(failed), 'column')} beyond the bound, the worst "
            f"{failed[0].column} at t = {failed[0].t:.9g}"
        )
    return "; ".join(said)


def report(judgement: Verdict) -> list[str]:
    """Give what a person reads below the verdict: notes, and the worst columns."""
    lines = [f"  {fault}" for fault in judgement.faults]
    columns = {"missing": judgement.missing, "extra": judgement.extra}
    lines += [f"  {what}: {', '.join(c)}" for what, c in columns.items() if c]
    lines += [f"  note: {note}" for note in judgement.notes]
    lines += differing(judgement) if judgement.failed else []
    more = len(judgement.failed) - LISTED
    return [*lines, f"  and {more} more"] if more > 0 else lines


def document(model: Model, judgement: Verdict, golden: Golden) -> dict[str, Any]:
    """Give what the JSON document says of one model; keys are only ever added."""
    return {
        **_name(model),
        "pass": judgement.passed,
        "failure": None if judgement.passed else failure(DIFFERS),
        "horizon": golden.horizon,
        "rows": len(golden.rows),
        "faults": list(judgement.faults),
        "notes": list(judgement.notes),
        "missing_columns": list(judgement.missing),
        "extra_columns": list(judgement.extra),
        "worst": [as_mapping(d) for d in judgement.worst],
    }
