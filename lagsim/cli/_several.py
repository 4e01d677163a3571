"""Several models in one command: each as if it were run alone, over processes."""

from __future__ import annotations

import contextlib
import gc
import io
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from lagsim.cli._faults import BUG_EXIT, errors_document, reported, unforeseen
from lagsim.cli._shared import (
    aligned,
    assignments,
    coloured,
    print_stderr,
    print_stdout,
    progress_bar,
    show_json,
)
from lagsim.codes.known import FAILED, ONE_NAME
from lagsim.errors import LagsimError, Problem, unusable
from lagsim.model.loading import model_text
from lagsim.model.reader import read
from lagsim.run.interrupt import Interrupt, Terminated
from lagsim.studies.workers import Died, completed_pieces, cores

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

Piece = TypeVar("Piece")

HEADS = ("model", "outcome", "end", "rows", "error", "drift", "seconds")
# Outcomes of models without a run.json, by their exit codes.
REFUSED = {1: "inadmissible", 2: "unusable"}
INTERRUPTED = 130


class PendingRun(NamedTuple):
    """Model that is to be run into a folder, with the options of the run.

    Attributes
    ----------
    text, file : str
        Text of the model file, and its name.
    folder : Path
        Folder of the results.
    overrides : mapping of str to str
        Values of `--set`.
    options : mapping of str to str
        Options of the run by key of `simulation`.
    job : callable
        Creates the `run.Job` from the folder, the documents and the interrupt.
    as_json : bool
        Whether errors are stored in documents, and not printed.
    """

    text: str
    file: str
    folder: Path
    overrides: Mapping[str, str]
    options: Mapping[str, str]
    job: Callable[..., Any]
    as_json: bool


class Done(NamedTuple):
    """Result of the run of one model.

    Attributes
    ----------
    code : int
        The exit code.
    documents : sequence
        The documents of the run; the first is run.json, unless the code is in REFUSED.
    printed : str
        The text printed on stderr.
    """

    code: int
    documents: Sequence[Any]
    printed: str


def done(piece: PendingRun, interrupt: Interrupt) -> Done:
    """Run one model into its folder, and return the result, even of a failure."""
    documents: list[Any] = []

    def work() -> int:
        job = piece.job(piece.folder, documents=documents, interrupt=interrupt)
        arguments = piece.text, piece.file, piece.overrides, piece.options
        return int(job.run(*arguments))

    return alone(work, piece.file, documents, as_json=piece.as_json)


def alone(
    work: Callable[[], int], file: str, documents: list[Any], *, as_json: bool
) -> Done:
    """Return the result of `work` for one of several models.

    An unforeseen exception becomes a result, so that it does not end the other models.

    work, file, documents, as_json : see `captured`.
    """

    def guarded() -> int:
        try:
            return work()
        except LagsimError:
            raise
        except (KeyboardInterrupt, Terminated):
            return INTERRUPTED
        except Exception:  # noqa: BLE001  the results of other models are of use
            return unforeseen()

    found = captured(guarded, file, documents, as_json=as_json)
    if not gc.isenabled():  # see `cli.entry`
        gc.collect()
    return found


def captured(
    work: Callable[[], int], file: str, documents: list[Any], *, as_json: bool
) -> Done:
    """Call `work`; return its exit code, its documents, and the text printed on stderr.

    Parameters
    ----------
    work : callable
        Returns the exit code. A LagsimError that it raises is reported: printed, or
        appended to `documents` with `as_json`.
    file : str
        The model file.
    documents : list
        The list that `work` fills.
    """
    with contextlib.redirect_stderr(io.StringIO()) as printed:
        try:
            code = work()
        except LagsimError as error:
            code = reported(error, documents if as_json else None, file)
    return Done(code, documents, printed.getvalue())


def each(
    work: Callable[[Piece, Interrupt], Done],
    pieces: Mapping[int, Piece | Done],
    paths: Sequence[str],
    jobs: int,
    interrupt: Interrupt,
) -> Iterator[tuple[int, Done]]:
    """Compute the results of several models; yield (number, result) by number.

    A result is yielded as soon as it and all before it exist. After an interrupt, the
    models without a result are left out.

    Parameters
    ----------
    work : callable
        Function at the top level of a module, which does not raise, see `alone`.
    pieces : mapping of int to Piece or Done
        Argument of `work`, or the result if it is known, by the index of the model.
    paths : sequence of str
        The model files.
    jobs : int
        The number of processes; with 1 this process computes all results.
    interrupt : Interrupt
    """
    found = {k: x for k, x in pieces.items() if isinstance(x, Done)}
    left = {k: x for k, x in pieces.items() if not isinstance(x, Done)}
    numbers, models = [*left], [*left.values()]
    with contextlib.closing(completed_pieces(work, models, jobs, interrupt)) as made:
        for k in sorted(pieces):
            while k not in found and (new := next(made, None)):
                number = numbers[new[0]]
                found[number] = _as_done(new[1], paths[number])
            if k in found:
                yield k, found[k]


def _as_done(result: Done | Died, path: str) -> Done:
    if isinstance(result, Done):
        return result
    died = Problem(FAILED, result.reason, hint=path)
    return Done(BUG_EXIT, [errors_document([died])], result.reason)


def run_all(
    paths: Sequence[str],
    folder: Path,
    job: Callable[..., Any],
    sets: Sequence[str] | None,
    options: Mapping[str, str],
    jobs: int | None,
    *,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run several models, each into its folder; return the worst exit code.

    Parameters
    ----------
    paths : sequence of str
        The model files.
    folder : Path
        The folder in which each model has a folder of results.
    job : callable
        Creates the `run.Job` of one model from its folder, documents and interrupt.
    sets : sequence of str or None
        Values of `--set`.
    options : mapping of str to str
        Options of the runs by key of `simulation`.
    jobs : int or None
        The number of processes.
    as_json : bool
        Whether the results are printed as one JSON document.
    quiet : bool
        Whether no summary is printed.

    Raises
    ------
    InputError
        Where two models would write into one folder.
    """
    overrides, names = assignments(sets), [Path(path).name for path in paths]
    pieces, first = dict[int, PendingRun | Done](), dict[str, str]()
    for k, path in enumerate(paths):

        def prepare(k: int = k, path: str = path) -> int:
            text, file = model_text(path)
            name = names[k] = read(text, file, overrides, options).name
            into = folder / name
            pieces[k] = PendingRun(text, file, into, overrides, options, job, as_json)
            return 0

        fault = captured(prepare, path, [], as_json=as_json)
        if fault.code:
            pieces[k] = fault
        elif names[k] in first:
            _report(pieces, paths)
            one = f"{first[names[k]]} and {path} have one name, `{names[k]}`, and so"
            hint = (
                "change the `name` of one model, or run the models one by one with -o"
            )
            raise unusable(ONE_NAME, f"{one} one folder", hint=hint)
        else:
            first[names[k]] = path
    interrupt, found = Interrupt(), dict[int, Done]()
    with interrupt.noted(), progress_bar("models", quiet=quiet) as progress:
        for k, result in each(done, pieces, paths, jobs or cores(), interrupt):
            found[k] = result
            _report({k: result}, paths)
            if progress is not None:
                progress(len(found) / len(paths))
    if as_json:
        show_json([x for k in sorted(found) for x in found[k].documents[:1]])
    elif not quiet:
        print_stdout(_summary(found, names, folder))
    if interrupt.signal is not None:
        return 128 + interrupt.signal
    return max(x.code for x in found.values())


def _report(found: Mapping[int, PendingRun | Done], paths: Sequence[str]) -> None:
    """Print the texts of runs for stderr, each below the path of its model."""
    for k, result in found.items():
        if isinstance(result, Done) and (printed := result.printed.rstrip("\n")):
            print_stderr(f"{paths[k]}:")
            print_stderr(textwrap.indent(printed, "  "), again=True)


def _summary(found: Mapping[int, Done], names: Sequence[str], folder: Path) -> str:
    """Return the summary of several runs: a line for each model, and a closing line.

    The closing line has the number of complete runs.

    names : the names of the models.
    """
    rows = [HEADS, *((name, *_row(found.get(k))) for k, name in enumerate(names))]
    complete = sum(x.code == 0 for x in found.values())
    head = coloured("done", "32" if complete == len(names) else "31")
    head += f": {complete} of {len(names)} models, in {folder}/NAME"
    return f"{head}\n{aligned(rows, lefts=2)}"


def _row(found: Done | None) -> tuple[str, ...]:
    """Return the cells of a model in the summary.

    found : the result; None for a model that has not been run.
    """
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
