"""`lagsim golden`: models against their stored results."""

from __future__ import annotations

from pathlib import Path  # noqa: TC003  typer looks at it
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import (
    AsJson,
    coloured,
    counted,
    show_json,
)
from lagsim.cli._streams import UnwritableError, complain, say
from lagsim.cli.compare import LISTED, as_mapping, listing

if TYPE_CHECKING:
    from lagsim.model.model import Model
    from lagsim.run.session import Case
    from lagsim.studies.golden.judging import Judgement
    from lagsim.studies.golden.measuring import Golden


def command(
    models: Annotated[
        list[str],
        typer.Argument(metavar="MODEL...", help="Model files; - is standard input."),
    ],
    folder: Annotated[
        Path | None,
        typer.Option(
            "--dir", metavar="DIR", help="Folder; default golden/ beside each model."
        ),
    ] = None,
    update: Annotated[
        bool, typer.Option("--update", help="Store the goldens, in place of old ones.")
    ] = False,
    as_json: AsJson = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Only what differs, and faults.")
    ] = False,
) -> int:
    """Run models and compare them with their goldens."""
    codes, faults = [0], []
    told: list[Any] = []
    job = _Job(folder, update=update, as_json=as_json, quiet=quiet)
    for path in models:
        documents: list[Any] = []
        with faults_shown(documents if as_json else None, file=path) as code:
            code.append(job.run(path))
        for found in documents:
            faults += found.get("errors", [])
            if "errors" not in found:  # an inadmissible start
                name, file = found["model"]["name"], found["model"]["file"]
                job.documents.append(found | {"model": name, "file": file})
        codes += code
    told += job.documents
    code_of_all = max(codes)
    if as_json:
        content: dict[str, Any] = {"pass": code_of_all == 0, "models": told}
        show_json(content | ({"errors": faults} if faults else {}))
    return code_of_all


class _Job:
    """The manners of the command."""

    def __init__(
        self, folder: Path | None, *, update: bool, as_json: bool, quiet: bool
    ) -> None:
        self.folder, self.update = folder, update
        self.as_json, self.quiet = as_json, quiet
        self.documents: list[Any] = []

    def run(self, path: str) -> int:
        """Do it for one model; give the exit code."""
        from lagsim.model.reader import read_file
        from lagsim.run.session import open_case, wanted
        from lagsim.studies.golden.storing import folder_of, load

        model = read_file(path)
        settings = wanted(model, "golden")
        folder = self.folder or folder_of(path)
        stored = None if self.update else load(folder, model.name)
        case = open_case(model, settings)
        if stored is None:
            return self._store(case, folder)
        from lagsim.studies.golden.judging import judge, run

        judgement = judge(case, run(case, stored), stored)
        self.documents.append(document(model, judgement, stored.golden))
        if not self.as_json and not (self.quiet and judgement.passed):
            say(report(model, judgement, stored.golden))
        return 0 if judgement.passed else 1

    def _store(self, case: Case, folder: Path) -> int:
        from lagsim.studies.golden.measuring import measure
        from lagsim.studies.golden.storing import document, names, table

        model = case.equations.model
        golden, base = measure(case)
        if not base.trajectory.outcome.complete:
            complain(f"lagsim: no golden of {model.name}: {base.trajectory.reason}")
            self.documents.append(_name(model) | {"pass": False})
            return UnwritableError.exit_code
        contents = table(golden), document(case, golden, base)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for name, content in zip(names(model.name), contents, strict=True):
                beside = folder / f".{name}.part"
                beside.write_bytes(content)
                beside.replace(folder / name)
        except OSError as error:
            text = f"lagsim: {folder} cannot be written: {error.strerror}"
            raise UnwritableError(text) from None
        found = {"pass": True, "stored": True, "horizon": golden.horizon}
        self.documents.append(_name(model) | found)
        if not self.as_json and not self.quiet:
            size = sum(map(len, contents)) / 1024
            say(
                f"{coloured('stored', '32')}: {model.name}, "
                f"{counted(len(golden.rows), 'row')}, "
                f"{counted(len(golden.columns), 'column')}, {size:.0f} kB"
                f"{_horizon(golden)}"
            )
        return 0


def _name(model: Model) -> dict[str, Any]:
    return {"model": model.name, "file": model.file}


def _horizon(golden: Golden) -> str:
    if golden.horizon is None:
        return ""
    return f"; past t = {golden.horizon:.4g} only what it keeps constant"


def report(model: Model, judgement: Judgement, golden: Golden) -> str:
    """Give what a person reads: the verdict, then the worst columns."""
    passed = judgement.passed
    verdict = coloured("same", "32") if passed else coloured("differs", "31")
    lines = [f"{verdict}: {model.name}, {counted(len(golden.rows), 'row')} compared"]
    lines[0] += _horizon(golden)
    lines += [f"  {fault}" for fault in judgement.faults]
    for what in ("missing", "extra"):
        if names := getattr(judgement, what):
            lines.append(f"  {what}: {', '.join(names)}")
    lines += [f"  note: {note}" for note in judgement.notes]
    failed = [d for d in judgement.worst if not d.passed]
    if failed:
        first = min(failed, key=lambda d: d.first or 0.0)
        lines.append(
            f"  the first to pass its bound: {first.column}, t = {first.first!r}"
        )
        lines += ["  " + line for line in listing(failed[:LISTED])]
    if len(failed) > LISTED:
        lines.append(f"  and {len(failed) - LISTED} more")
    return "\n".join(lines)


def document(model: Model, judgement: Judgement, golden: Golden) -> dict[str, Any]:
    """Give what the JSON document says of one model; keys are only ever added."""
    return {
        **_name(model),
        "pass": judgement.passed,
        "horizon": golden.horizon,
        "rows": len(golden.rows),
        "faults": list(judgement.faults),
        "notes": list(judgement.notes),
        "missing_columns": list(judgement.missing),
        "extra_columns": list(judgement.extra),
        "worst": [as_mapping(d) for d in judgement.worst],
    }
