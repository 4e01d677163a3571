"""Options, printing and writing that commands share."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import sys
import textwrap
import time
from enum import Enum
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

import typer

from lagsim.codes.known import EXISTS, NO_ROOM, RETIRED, USAGE
from lagsim.errors import LagsimError, Problem, Problems, counted, visible
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from lagsim.model.model import Model
    from lagsim.notes import Caution
    from lagsim.outputs.results import Results
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.options import RangeOption

    Progress = Callable[[float], None] | None
    Measure = Callable[[Interrupt, Progress], "Measured | list[str]"]


class PictureFormat(Enum):
    """Formats of pictures."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


def flag(name: str, text: str) -> Any:
    """Return the declaration for typer of an option without a value.

    name : the name of the option.
    text : its help.
    """
    return typer.Option(False, name, help=text)


def option(metavar: str, text: str, *names: str, **more: Any) -> Any:
    """Return the declaration for typer of an option with a value, None by default.

    metavar : placeholder of the value in the help.
    text : the help.
    names : names of the option, if not that of the parameter.
    """
    return typer.Option(None, *names, metavar=metavar, help=text, **more)


# Arguments and options of several commands, each with its default.
NO_LIMITS: Any = flag(
    "--no-limits", "Derive your own file, however many operations its equations take."
)
MODEL: Any = typer.Argument(metavar="MODEL", help="Model file; - is standard input.")
MODELS: Any = typer.Argument(metavar="MODEL...", help="Model files; - is stdin.")
SETS: Any = option(
    "NAME=EXPR",
    "Another value of a parameter, or another start value; may be repeated.",
    "--set",
)
JOBS: Any = option(
    "N", "Number of processes; default one for each core.", "-j", "--jobs", min=1
)
FORMAT: Any = typer.Option(
    PictureFormat.PNG, "--format", help="Format of pictures; svg and pdf for print."
)
NO_PLOTS: Any = flag("--no-plots", "No pictures.")
JSON: Any = flag("--json", "Print one JSON document on stdout.")
STRICT: Any = flag("--strict", "Exit 1 if there are warnings.")


def quiet(text: str = "Print messages only if the command fails.") -> Any:
    """Return the declaration of the option `-q`; `text` is its help."""
    return typer.Option(False, "-q", "--quiet", help=text)


def output_folder(text: str) -> Any:
    """Return the declaration of the option `-o DIR`; `text` is its help."""
    return option("DIR", text, "-o", "--output")


def _show_version(requested: bool) -> None:
    if requested:
        print_stdout(f"lagsim {__version__}")
        raise typer.Exit


def ask_version(
    version: bool = typer.Option(
        False, "--version", help="Show the version and stop.", callback=_show_version,
        is_eager=True,
    ),
    traceback: bool = flag("--traceback", "Print the traceback of a bug in lagsim."),
) -> None:  # fmt: skip
    """From energies to motion: simulate a system written down as T and V."""


def assignments(sets: Iterable[str] | None) -> dict[str, str]:
    """Return the expressions of `--set NAME=EXPR` by their names.

    Raises
    ------
    InputError
        Where there is no `=`, or a name is given twice.
    """
    found: dict[str, str] = {}
    problems = Problems()
    for text in sets or ():
        name, equals, expression = text.partition("=")
        name = name.strip()
        if not equals or not name:
            message = f"--set {text}: a name and an expression are expected"
            problems.add(USAGE, message, hint="such as --set g=1.62")
        elif name in found:
            problems.add(USAGE, f"--set {name} is given twice")
        found[name] = expression
    problems.refuse()
    return found


def strict_line(name: str, codes: Iterable[str]) -> str:
    """Return the closing line of a command that fails by `--strict`.

    name : the name of the model.
    codes : codes of the warnings.
    """
    codes = list(codes)
    named = ", ".join(dict.fromkeys(codes))
    return f"lagsim: {name}: {counted(len(codes), 'warning')} ({named}), and --strict"


def show_json(document: Any) -> None:
    """Print a JSON document on stdout."""
    from lagsim.outputs.manifest import encode

    content = encode(document)
    if sys.stdout.isatty():
        content = visible(content.decode(), json=True).encode()
    if on_github():  # no line of it begins with `::`
        content = content.replace(b"##[", rb"#\u0023[")
    write_stdout(lambda: sys.stdout.buffer.write(content))


def coloured(text: str, code: str) -> str:
    """Return `text` in a colour if stdout is a terminal with colours, else unchanged.

    code : number of the colour in control sequences, such as 32.
    """
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    if plain or not sys.stdout.isatty():
        return text
    return colour(text, code)


def aligned_pairs(rows: Iterable[tuple[str, str]]) -> str:
    """Return rows of a name and a text, aligned."""
    return aligned(list(rows), lefts=2)


def titled_rows(name: str, texts: Iterable[str]) -> list[tuple[str, str]]:
    """Return one row (name, text) for each text; the name is "" after the first row."""
    return [("" if k else name, text) for k, text in enumerate(texts)]


def aligned(rows: Sequence[Sequence[str]], *, lefts: int) -> str:
    """Return rows of texts in aligned columns.

    Rows may have fewer cells than others. The first `lefts` columns are aligned to the
    left, all others to the right.
    """
    widths = [max(map(len, column)) for column in zip_longest(*rows, fillvalue="")]
    lines = []
    for row in rows:
        cells = [
            text.ljust(width) if k < lefts else text.rjust(width)
            for k, (text, width) in enumerate(zip(row, widths, strict=False))
        ]
        lines.append(("  " + "  ".join(cells)).rstrip())
    return "\n".join(lines)


# Runs that last longer than this show a progress bar on a terminal.
PATIENCE_SECONDS = 1.0


@contextlib.contextmanager
def progress_bar(
    label: str, *, quiet: bool
) -> Iterator[Callable[[float], None] | None]:
    """Context manager: show a bar on stderr while the fraction of work done grows.

    It yields the function to be called with that fraction; None, and no bar, if stderr
    is no terminal or with `quiet`. The bar stays at its last value: at 100 % if the
    function was called with 1.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    began = time.perf_counter()
    shown: list[Any] = []

    def update(fraction: float) -> None:
        if not shown and time.perf_counter() - began > PATIENCE_SECONDS:
            shown.append(typer.progressbar(length=1000, label=label, file=sys.stderr))
            shown[0].__enter__()
        if shown:
            shown[0].update(int(1000 * fraction) - shown[0].pos)

    try:
        yield update
    finally:
        if shown:
            shown[0].__exit__(None, None, None)


# --- Files, and what is reported where the disk is full


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Context manager: turn an OSError while writing `path` into an UnwritableError.

    Raises
    ------
    UnwritableError
    """
    try:
        yield
    except OSError as error:
        where = path if path.parent.is_dir() else path.parent
        text = f"lagsim: {where} cannot be written: {error.strerror}"
        raise UnwritableError(text) from None


def write_file(path: Path, content: bytes, *, folders: bool = False) -> None:
    """Write a file atomically; with `folders` create its missing folders.

    Raises
    ------
    UnwritableError
        If the file cannot be written.
    """
    from lagsim.outputs.results import write_atomically

    with writing(path):
        if folders:
            path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content)


def check_replaced(path: Path, model: Model) -> None:
    """Refuse to replace a file of `--write` that is no version of a model.

    A version is a model with equal names of parameters, coordinates and states.

    Raises
    ------
    InputError
        If the file is no version of `model`.
    """
    from lagsim.errors import unusable
    from lagsim.model.reader import read_file

    if not path.is_file():
        return
    try:
        there = _named_in(read_file(str(path)))
    except LagsimError:
        there = []
    if there != _named_in(model):
        text = f"--write {path}: this file is no version of {model.file}"
        hint = "give another name, or remove the file"
        raise unusable(EXISTS, text, hint=hint)


def _named_in(model: Model) -> list[set[str]]:
    named = model.parameters, model.coordinates, model.states
    return [{one.name for one in each} for each in named]


def write_picture(
    path: Path, draw: Callable[[], bytes], *, folders: bool = False
) -> bool:
    """Write a picture to a file; return whether it could be drawn.

    Raises
    ------
    UnwritableError
        Where it cannot be written.
    """
    content = drawn_or_reported(path.name, draw, [])
    if content is not None:
        write_file(path, content, folders=folders)
    return content is not None


def drawn_or_reported(
    name: str, draw: Callable[[], bytes], warnings: list[Any]
) -> bytes | None:
    """Return the content of a picture; None, with a printed warning, if drawing fails.

    name : the name of the file.
    draw : returns the content.
    warnings : list to which the record of the warning is appended.
    """
    from lagsim.outputs import attempted

    content = attempted(name, draw)
    if isinstance(content, bytes):
        return content
    print_warning(content)
    warnings.append(content.record)
    return None


def commit(results: Results, document: Any, files: Mapping[str, bytes]) -> None:
    """Write files and the document that lists these; rename all to their final names.

    results : the folder of results.

    Raises
    ------
    UnwritableError
        If the disk is full.
    """
    from lagsim.outputs.manifest import encode

    with writing(results.folder):
        for name, content in files.items():
            results.write(name, content)
        results.commit(encode(document))


# --- Commands that run one model in many ways: their job, options and closing lines


class Measured(NamedTuple):
    """Result of an experiment: the contents of its files, and its summary.

    Attributes
    ----------
    document : dict
        The manifest, to which the list of files is added.
    tables : mapping of str to bytes
        The contents of the other files, by name.
    chart : str
        The name of the file of the chart.
    draw : callable or None
        Returns the content of the chart; None without a chart.
    summary : callable
        Returns the lines printed at the end, from a text that lists the files.
    remarks : sequence of str
        Lines for stderr.
    code : int
        The exit code, unless a signal ends the command.
    """

    document: dict[str, Any]
    tables: Mapping[str, bytes]
    chart: str
    draw: Callable[[], bytes] | None
    summary: Callable[[str], str]
    remarks: Sequence[str] = ()
    code: int = 0


def experiment(
    command: str,
    measure: Measure,
    folder: Path,
    manifest: str,
    documents: list[Any] | None = None,
    *,
    quiet: bool,
    as_json: bool,
) -> int:
    """Run a study by a call of `measure`, write its files, and return the exit code.

    After an interrupt `measure` ends early. If it returns remarks in place of a result,
    no file is written. The chart is left out after a signal, or if drawing fails. With
    `as_json` the document is printed; it is appended to `documents` if that is given.

    command : the name of the command.
    folder : the folder of the results.
    manifest : the file name of the document.
    """
    from lagsim.outputs.results import open_results
    from lagsim.run.interrupt import Interrupt

    interrupt = Interrupt()
    with open_results(folder, manifest) as results, interrupt.noted():
        with progress_bar(command, quiet=quiet) as progress:
            found = measure(interrupt, progress)
        if isinstance(found, list):
            print_stderr("\n".join(found))
            return 128 + (interrupt.signal or 0)
        files = dict(found.tables)
        warnings = list[Any](found.document.get("warnings", ()))
        warnings += (caution.record for caution in results.cautions)
        for warning in warnings:
            print_stderr(f"warning: {warning['text']} [{warning['number']}]")

        def draw() -> None:
            content = found.draw and drawn_or_reported(
                found.chart, found.draw, warnings
            )
            if content:
                files[found.chart] = content

        interrupt.cut(draw)
        document = found.document | {"files": [*files, manifest]}
        document |= {"warnings": warnings} if warnings else {}
        commit(results, document, files)
    for remark in found.remarks:
        print_stderr(remark)
    if documents is not None:
        documents.append(document)
    elif as_json:
        show_json(document)
    if not quiet and not as_json:
        print_stdout(found.summary(f"{folder}: {', '.join(document['files'])}"))
    return found.code if interrupt.signal is None else 128 + interrupt.signal


def csv(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> bytes:
    """Return rows, mappings of columns to values, as CSV."""
    from lagsim.outputs.table import table_of

    return table_of(columns, ([row[name] for name in columns] for row in rows))


def methods_of(text: str | None) -> tuple[str, ...] | None:
    """Return the methods that an option A,B names; None without the option.

    Retired methods are left out with a warning; None also if no other methods are
    named.
    """
    if text is None:
        return None
    from lagsim import methods
    from lagsim.notes import Caution

    found = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    for name in found:
        if name in methods.RETIRED:
            caution = Caution(RETIRED, f"the method `{name}` is retired: left out")
            print_warning(caution)
    return tuple(name for name in found if name not in methods.RETIRED) or None


def parse_range(
    problems: Problems, option: str, text: str, expected: RangeOption
) -> tuple[float, float] | None:
    """Parse a range A:B; return its ends, the smaller first, or None after a problem.

    problems : to which a problem is added.
    option : name of the option in the message.
    text : the range.
    expected : the permitted ranges.
    """
    found = expected.ends(text.split(":"))
    if found is None:
        message = f"{option} {text}: two {expected.values} are expected"
        problems.add(USAGE, message, hint=f"such as {expected.example}")
    return found


def headline(document: Mapping[str, Any], *counts: tuple[int, str]) -> str:
    """Return the first line of the summary of a study: its state, model and counts.

    document : the content of the study's JSON file, with `complete` and `model`.
    counts : pairs of a number and a noun.
    """
    state, colour = ("done", "32") if document["complete"] else ("interrupted", "31")
    counted_up = " by ".join(counted(*count) for count in counts)
    return f"{coloured(state, colour)}: {document['model']['name']}, {counted_up}"


def left_out(refused: Iterable[Mapping[str, str]]) -> list[tuple[str, str]]:
    """Return lines of a summary on methods that do not apply, grouped by reason.

    refused : mappings with the keys `method` and `reason`.
    """
    by_reason: dict[str, list[str]] = {}
    for one in refused:
        by_reason.setdefault(one["reason"], []).append(one["method"])
    return titled_rows(
        "left out", (f"{', '.join(m)}: {r}" for r, m in by_reason.items())
    )


# --- Standard streams that may be closed, full, narrow, or closed by their reader
#
# GitHub's runner interprets a line that begins with `::`, also after blanks, as a
# command, and `##[` anywhere in a line; both are made harmless in printed text.

# The label of a line: an indent, and a name with two blanks after it.
_LABEL = re.compile(r"\s*(?:\S+(?: \S+)?\s{2,})?")
# Prefix of lagsim's own colours; it is random, so that no file can contain it.
_OWN = f"\x1b{os.urandom(8).hex()}"
_COLOUR = re.compile(rf"{_OWN}(\[\d+m)")
# Characters without width, which Python does not count as blanks.
_NO_WIDTH = dict.fromkeys(map(ord, "\ufeff\u200b\u180e"))


class UnwritableError(LagsimError):
    """Results cannot be written (exit 3), as when a disk fills up."""

    exit_code = 3
    code = NO_ROOM


def prepare() -> None:
    """Replace closed standard streams, and let all write letters they cannot encode."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(handle, mode, encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def print_stdout(text: str) -> None:
    """Print text for a person on stdout, with lines wrapped at the terminal width."""
    write_stdout(lambda: print(without_controls(text, sys.stdout)))


def width_of(stream: TextIO) -> int | None:
    """Return the width of a terminal in letters; None if the stream is no terminal."""
    return shutil.get_terminal_size().columns if stream.isatty() else None


def colour(text: str, code: str) -> str:
    """Return a text between the control sequences of a colour, such as "32"."""
    return f"{_OWN}[{code}m{text}{_OWN}[0m"


def without_controls(text: str, stream: TextIO, *, again: bool = False) -> str:
    """Return a text without control sequences, except lagsim's own colours.

    Parameters
    ----------
    again : bool
        Whether a worker process has already printed the text, so that it contains
        annotations of GitHub Actions, which must stay.
    """
    parts = _COLOUR.split(text)
    parts[::2] = map(visible, parts[::2])
    parts[1::2] = [f"\x1b{code}" * stream.isatty() for code in parts[1::2]]
    lines = fitted("".join(parts), stream)
    return lines if again else harmless(lines)


def on_github() -> bool:
    """Whether the process runs in a workflow of GitHub Actions."""
    return os.environ.get("GITHUB_ACTIONS") == "true"


def harmless(text: str) -> str:
    """Return a text in which the runner of GitHub Actions recognises no command.

    A mark replaces the first blank of a line, so that columns stay aligned.
    """
    if not on_github():
        return text
    return "".join(map(_marked, re.split("([\r\n])", unmarked(text))))


def unmarked(text: str) -> str:
    """Return a text in which `##[`, an old mark of GitHub Actions, is broken."""
    return text.replace("##[", "## [")


def _marked(line: str) -> str:
    at = line.find("::")
    if at < 0 or line[:at].translate(_NO_WIDTH).strip():
        return line
    return f"| {line[min(2, at) :]}"


def fitted(text: str, stream: TextIO) -> str:
    """Break lines wider than the terminal; continued lines begin below the text."""
    width = width_of(stream)
    return text if width is None else "\n".join(_broken(text.split("\n"), width))


def _broken(lines: Iterable[str], width: int) -> Iterator[str]:
    for line in lines:
        label = _LABEL.match(line)
        indent = len(label[0]) if label else 0
        if len(line) <= width or indent > width // 2:
            yield line
            continue
        yield from textwrap.wrap(
            line[indent:], width, initial_indent=line[:indent],
            subsequent_indent=" " * (indent or 2), break_on_hyphens=False,
            break_long_words=False,
        )  # fmt: skip


def write_stdout(write: Callable[[], object]) -> None:
    """Call `write`, a function that writes to stdout, and flush stdout.

    A closed pipe (`| head`) is no error: the remaining output is discarded.
    """
    try:
        write()
        sys.stdout.flush()
    except BrokenPipeError:
        _mute(sys.stdout)
    except OSError as error:
        raise typer.Exit(report_stdout_failure(error)) from None


def report_stdout_failure(error: OSError) -> int:
    """Report that writing to stdout failed; return the exit code."""
    from lagsim.codes import number

    _mute(sys.stdout)
    text = f"lagsim: standard output cannot be written: {error.strerror}"
    print_stderr(f"{text} [{number(UnwritableError.code)}]")
    return UnwritableError.exit_code


def print_stderr(text: str, *, again: bool = False) -> None:
    """Print text for a person on stderr.

    again : whether a worker process has already printed it, see `without_controls`.
    """
    _report(without_controls(text, sys.stderr, again=again))


def print_warning(caution: Caution) -> None:
    """Print a warning with its number on stderr."""
    print_stderr(f"warning: {caution.text} [{caution.number}]")


def _report(text: str) -> None:
    """Print on stderr; discard all further output there if that fails."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        _mute(sys.stderr)


def _mute(stream: TextIO) -> None:
    """Redirect a stream to a null device, so that the flush at exit does not fail."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


# --- Annotations: messages that GitHub Actions shows beside a line of a file
#
# They are written to stderr, which the runner reads like stdout, so that stdout is the
# same for all readers.

ERROR, WARNING = "error", "warning"


def annotate(
    level: str, text: str, file: str | None, line: int | None = None,
    column: int | None = None, number: str | None = None,
) -> None:  # fmt: skip
    """Annotate a line of a file in GitHub Actions; without effect elsewhere.

    level : `error`, `warning` or `notice`.
    number : the number of the message.
    """
    if not on_github():
        return
    place = {"file": _within(file), "line": line, "col": column, "title": number}
    named = ",".join(f"{k}={_property(str(v))}" for k, v in place.items() if v)
    start = f"::{level} {named}".rstrip()
    _report(visible(f"{start}::{_data(unmarked(text))}"))


def annotate_problem(problem: Problem, file: str | None = None) -> None:
    """Annotate the line of a fault in GitHub Actions.

    file : the file, if the fault has none.
    """
    hint = f"\nhint: {problem.whole.hint}"
    annotate(
        ERROR, problem.text + hint, problem.file or file, problem.line, problem.column,
        problem.number,
    )  # fmt: skip


def _within(file: str | None) -> str | None:
    """Return the path of a file for annotations, relative to the repository.

    A path outside of the repository is returned unchanged. None for standard input, and
    without a file.
    """
    if file is None or file == "-" or file.startswith("<"):  # standard input
        return None
    root = os.environ.get("GITHUB_WORKSPACE")
    path = Path(file).absolute()
    if root and path.is_relative_to(root):
        return path.relative_to(root).as_posix()
    return file


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
