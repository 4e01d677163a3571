"""Several models in one command: each as if it were run alone, over processes."""

from __future__ import annotations

import contextlib
import gc
import io
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.cli._faults import BUG, errors_document, reported, unforeseen
from lagsim.cli._shared import aligned, assignments, coloured, progress_bar, show_json
from lagsim.cli._streams import complain, say
from lagsim.errors import LagsimError, Problem, unusable
from lagsim.model.loading import text_of
from lagsim.model.reader import read
from lagsim.run.interrupt import Interrupt, Terminated
from lagsim.studies.workers import Died, cores, spread

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

HEADS = ("model", "outcome", "end", "rows", "error", "drift", "seconds")
# Outcomes of models without a run.json, by their exit codes.
REFUSED = {1: "inadmissible", 2: "unusable"}
INTERRUPTED = 130


class Piece(NamedTuple):
    """A model that is to be run into a folder; `job` makes a `run.Job` of it."""

    text: str
    file: str
    folder: Path
    overrides: Mapping[str, str]
    options: Mapping[str, str]
    job: Callable[..., Any]
    as_json: bool


class Done(NamedTuple):
    """The exit code of a model, its documents, and what was printed on stderr.

    Of `documents` the first is run.json, where the code is not one of REFUSED.
    """

    code: int
    documents: Sequence[Any]
    printed: str


def done(piece: Piece, interrupt: Interrupt) -> Done:
    """Run one model."""
    documents: list[Any] = []

    def work() -> int:
        job = piece.job(piece.folder, documents=documents, interrupt=interrupt)
        asked = piece.text, piece.file, piece.overrides, piece.options
        try:
            return int(job.run(*asked))
        except LagsimError:
            raise
        except (KeyboardInterrupt, Terminated):
            return INTERRUPTED
        except Exception:  # noqa: BLE001  the others are run all the same
            return unforeseen()

    found = _heard(work, piece.file, documents, as_json=piece.as_json)
    if not gc.isenabled():  # see `cli.entry`
        gc.collect()
    return found


def _heard(
    work: Callable[[], int], file: str, documents: list[Any], *, as_json: bool
) -> Done:
    """Return the exit code of some work, and what it prints on stderr."""
    with contextlib.redirect_stderr(io.StringIO()) as printed:
        try:
            code = work()
        except LagsimError as error:
            code = reported(error, documents if as_json else None, file)
    return Done(code, documents, printed.getvalue())


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
        job: Callable[..., Any],
        *,
        as_json: bool,
        quiet: bool,
    ) -> None:
        self.paths, self.folder, self.job = paths, folder or Path("results"), job
        self.as_json, self.quiet = as_json, quiet
        self.names = [Path(path).name for path in paths]
        self.found: dict[int, Done] = {}
        self._reported = 0

    def run(
        self, sets: Sequence[str] | None, options: Mapping[str, str], jobs: int | None
    ) -> int:
        """Run them; return the worst exit code.

        Raises
        ------
        InputError
            Where two would write into one folder.
        """
        pieces = self._pieces(assignments(sets), options)
        interrupt, numbers = Interrupt(), list(pieces)
        with interrupt.noted(), progress_bar("models", quiet=self.quiet) as progress:
            for k, found in spread(done, pieces.values(), jobs or cores(), interrupt):
                number, kept = numbers[k], found
                if isinstance(kept, Died):
                    died = Problem("failed", kept.reason, hint=self.paths[number])
                    kept = Done(BUG, [errors_document([died])], kept.reason)
                self._keep(number, kept)
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
        """Read the models, for their names; of those with faults that is all."""
        pieces, first = dict[int, Piece](), dict[str, str]()
        for k, path in enumerate(self.paths):

            def work(k: int = k, path: str = path) -> int:
                text, file = text_of(path)
                name = self.names[k] = read(text, file, overrides, options).name
                pieces[k] = Piece(
                    text, file, self.folder / name, overrides, options, self.job,
                    self.as_json,
                )  # fmt: skip
                return 0

            found = _heard(work, path, [], as_json=self.as_json)
            if found.code:
                self._keep(k, found)
                continue
            name = self.names[k]
            if name in first:
                one = f"{first[name]} and {path} have one name, `{name}`, and so one"
                hint = "give one of them another `name`, or run them one by one with -o"
                raise unusable("one-name", f"{one} folder", hint=hint)
            first[name] = path
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
        """Return a line for each model, and how many are done."""
        rows: list[tuple[str, ...]] = [HEADS]
        for k, name in enumerate(self.names):
            rows.append((name, *_row(self.found.get(k))))
        complete = sum(x.code == 0 for x in self.found.values())
        head = coloured("done", "32" if complete == len(self.names) else "31")
        head += f": {complete} of {len(self.names)} models, in {self.folder}/NAME"
        return f"{head}\n{aligned(rows, lefts=2)}"


def _row(found: Done | None) -> tuple[str, ...]:
    """Return what the summary has of a model."""
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
