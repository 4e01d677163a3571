"""Several models in one command: each as if it were run alone, over processes."""

from __future__ import annotations

import contextlib
import gc
import io
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from lagsim.cli._faults import BUG, errors_document, faults_shown, unforeseen
from lagsim.cli._shared import (
    aligned,
    assignments,
    coloured,
    progress_bar,
    show_json,
)
from lagsim.cli._streams import complain, say
from lagsim.errors import InputError, Problem
from lagsim.run.interrupt import Interrupt, Terminated
from lagsim.studies.workers import Died, cores, spread

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

HEADS = ("model", "outcome", "end", "rows", "error", "drift", "seconds")
# What a model is called that gave no run.json, by its exit code.
REFUSED = {1: "inadmissible", 2: "unusable"}
INTERRUPTED = 130


class Job(Protocol):
    """A run of one model, see `cli.run`."""

    def run(
        self,
        text: str,
        file: str,
        overrides: Mapping[str, str],
        options: Mapping[str, str],
    ) -> int:
        """Run it; give the exit code."""


class Piece(NamedTuple):
    """A model that is to be run into a folder; `job` makes the job of it."""

    text: str
    file: str
    folder: Path
    overrides: Mapping[str, str]
    options: Mapping[str, str]
    job: Callable[..., Job]
    as_json: bool


class Done(NamedTuple):
    """What came of a model: exit code, documents, and what was printed on stderr.

    Of `documents` the first is run.json, where the code is not one of REFUSED.
    """

    code: int
    documents: Sequence[Any]
    printed: str


def done(piece: Piece, interrupt: Interrupt) -> Done:
    """Run one model."""
    documents: list[Any] = []
    faults = documents if piece.as_json else None
    with contextlib.redirect_stderr(io.StringIO()) as heard:
        try:
            with faults_shown(faults, file=piece.file) as code:
                job = piece.job(piece.folder, documents=documents, interrupt=interrupt)
                code.append(
                    job.run(piece.text, piece.file, piece.overrides, piece.options)
                )
        except (KeyboardInterrupt, Terminated):
            code = [INTERRUPTED]
        except Exception:  # noqa: BLE001  the others are run all the same
            code = [unforeseen()]
    if not gc.isenabled():  # see `cli.entry`
        gc.collect()
    return Done(code[-1], documents, heard.getvalue())


class Batch:
    """Several models, and what comes of them.

    Parameters
    ----------
    job
        Makes the job of one model: of its folder, documents and interrupt.
    """

    def __init__(
        self,
        paths: Sequence[str],
        folder: Path | None,
        job: Callable[..., Job],
        *,
        as_json: bool,
        quiet: bool,
    ) -> None:
        self.paths, self.job = paths, job
        self.folder = folder or Path("results")
        self.as_json, self.quiet = as_json, quiet
        self.names = [Path(path).name for path in paths]
        self.found: dict[int, Done] = {}
        self._reported = 0

    def run(
        self, sets: Sequence[str] | None, options: Mapping[str, str], jobs: int | None
    ) -> int:
        """Run them; give the worst exit code."""
        refused: list[Any] = []
        with faults_shown(refused if self.as_json else None) as code:
            pieces = self._pieces(assignments(sets), options)
            code.append(0)
        if code[-1]:
            for document in refused:
                show_json(document)
            return code[-1]
        interrupt, numbers = Interrupt(), list(pieces)
        with interrupt.noted(), progress_bar("models", quiet=self.quiet) as progress:
            for k, found in spread(done, pieces.values(), jobs or cores(), interrupt):
                number = numbers[k]
                if isinstance(found, Died):
                    died = Problem("failed", found.reason, hint=self.paths[number])
                    lost = Done(BUG, [errors_document([died])], found.reason)
                    self._keep(number, lost)
                else:
                    self._keep(number, found)
                if progress is not None:
                    progress(len(self.found) / len(self.paths))
        self._report(len(self.paths))
        if self.as_json:
            listed = [self.found[k].documents for k in sorted(self.found)]
            show_json([document for own in listed for document in own[:1]])
        elif not self.quiet:
            say(self._summary())
        if interrupt.signal is not None:
            return 128 + interrupt.signal
        return max(x.code for x in self.found.values())

    def _pieces(
        self, overrides: Mapping[str, str], options: Mapping[str, str]
    ) -> dict[int, Piece]:
        """Read the models, for their names; of those with faults that is all.

        Raises
        ------
        InputError
            Where two would write into one folder.
        """
        from lagsim.model.loading import text_of
        from lagsim.model.reader import read

        pieces, first = {}, dict[str, str]()
        for k, path in enumerate(self.paths):
            documents: list[Any] = []
            with contextlib.redirect_stderr(io.StringIO()) as heard, faults_shown(
                documents if self.as_json else None, file=path
            ) as code:  # fmt: skip
                text, file = text_of(path)
                name = self.names[k] = read(text, file, overrides, options).name
                code.append(0)
            if code[-1]:
                self._keep(k, Done(code[-1], documents, heard.getvalue()))
                continue
            if name in first:
                one = f"{first[name]} and {path} have one name, `{name}`, and so one"
                hint = "give one of them another `name`, or run them one by one with -o"
                raise InputError([Problem("one-name", f"{one} folder", hint=hint)])
            first[name] = path
            pieces[k] = Piece(
                text, file, self.folder / name, overrides, options, self.job,
                self.as_json,
            )  # fmt: skip
        return pieces

    def _keep(self, number: int, found: Done) -> None:
        """Keep what came of a model; report what is known of the first of them."""
        self.found[number] = found
        known = self._reported
        while known in self.found:
            known += 1
        self._report(known)

    def _report(self, end: int) -> None:
        """Print what models before `end` have printed, each with its name, in order."""
        for k in range(self._reported, end):
            if k in self.found and self.found[k].printed:
                text = textwrap.indent(self.found[k].printed.rstrip("\n"), "  ")
                complain(f"{self.paths[k]}:")
                complain(text, again=True)
        self._reported = end

    def _summary(self) -> str:
        """Give a line for each model, and how many are done."""
        rows: list[tuple[str, ...]] = [HEADS]
        for k, name in enumerate(self.names):
            rows.append((name, *_row(self.found.get(k))))
        complete = sum(x.code == 0 for x in self.found.values())
        head = coloured("done", "32" if complete == len(self.names) else "31")
        head += f": {complete} of {len(self.names)} models, in {self.folder}/NAME"
        return f"{head}\n{aligned(rows, lefts=2)}"


def _row(found: Done | None) -> tuple[str, ...]:
    """Give what the summary says of a model."""
    if found is None:
        return ("not begun",)
    record = found.documents[0] if found.documents else {}
    if "outcome" not in record:
        return (REFUSED.get(found.code, "no result"),)
    bar = record["error"]
    return (
        record["outcome"],
        f"{record['end']:.6g}",
        str(record["rows"]),
        "-" if bar is None else f"{bar['relative']:.1g}",
        f"{record['energy_drift']:.1g}",
        f"{sum(record['timings'].values()):.2f}",
    )
