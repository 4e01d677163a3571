"""`lagsim run`: check, derive, integrate, write."""

from __future__ import annotations

import contextlib
import functools
import inspect
import math
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, cast

import typer

from lagsim import limits
from lagsim.cli import is_watched
from lagsim.cli._shared import (
    ERROR,
    FORMAT,
    JOBS,
    JSON,
    MODELS,
    NO_LIMITS,
    NO_PLOTS,
    SETS,
    STRICT,
    PictureFormat,
    UnwritableError,
    aligned_pairs,
    annotate,
    assignments,
    coloured,
    commit,
    flag,
    output_folder,
    print_stderr,
    print_stdout,
    progress_bar,
    quiet,
    show_json,
    strict_line,
    titled_rows,
)
from lagsim.codes import failure
from lagsim.codes.known import USAGE
from lagsim.errors import Place, counted, pointed, unusable
from lagsim.methods import names
from lagsim.model.loading import model_text
from lagsim.model.reader import read
from lagsim.model.reader.fields import OPTIONS, SIMULATION
from lagsim.outputs import TableFormat
from lagsim.outputs.manifest import encode
from lagsim.outputs.results import (
    MANIFEST,
    RESTART,
    Results,
    open_results,
    refuse_without_room,
    replaced,
)
from lagsim.outputs.table import (
    EVENTS,
    EventsWriter,
    TableWriter,
    Writer,
    check_format,
    table_writer,
)
from lagsim.outputs.units import of_table
from lagsim.run.interrupt import Interrupt
from lagsim.run.session import Session, Stopwatch, open_case, settings_of
from lagsim.studies.attempts import Attempt, Attempts, ErrorBars, Records

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.notes import Event
    from lagsim.run.arcs import Run
    from lagsim.run.error import ErrorBar as Estimate
    from lagsim.run.observers import Relay, Store
    from lagsim.run.observers.appended import Appended
    from lagsim.run.trajectory import Trajectory
    from lagsim.studies.drawing import Draw
    from lagsim.studies.restart import Restart

    Document = dict[str, Any]


ERROR_BAR: Any = typer.Option(
    ErrorBars.AUTO,
    help="Repeat the run with a smaller tolerance to estimate its error; auto: if the "
    "repeat lasts at most about 2 s.",
)


def with_settings(
    keys: Mapping[str, str] = OPTIONS,
) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Return a decorator that adds an option to a command for each key of `simulation`.

    The command receives the options of the command line in its argument `options`, by
    key.

    keys : keys of `simulation` -> placeholder of the value in the help.
    """
    settings = []
    for key, metavar in keys.items():
        known = (lambda: ["auto", *names()]) if key == "method" else None
        about = SIMULATION[key]["description"]
        option = typer.Option(metavar=metavar, help=about, autocompletion=known)
        kind, annotation = inspect.Parameter.KEYWORD_ONLY, Annotated[str | None, option]
        settings.append(
            inspect.Parameter(key, kind, default=None, annotation=annotation)
        )

    def decorated(command: Callable[..., int]) -> Callable[..., int]:
        @functools.wraps(command)
        def called(**words: Any) -> int:
            settings = {key: words.pop(key) for key in keys}
            given = {key: text for key, text in settings.items() if text is not None}
            return command(**words, options=given)

        own = inspect.signature(command, eval_str=True)
        each: list[inspect.Parameter] = []
        for name, x in own.parameters.items():
            each += settings if name == "options" else [x]
        shown = own.replace(parameters=each)
        called.__signature__ = shown  # type: ignore[attr-defined]
        return called

    return decorated


@with_settings()
def command(
    models: list[str] = MODELS,
    folder: Path | None = output_folder(
        "Output folder; default results/NAME; DIR/NAME for several models."
    ),
    jobs: int | None = JOBS,
    sets: list[str] | None = SETS,
    *,
    options: dict[str, str],
    error_bar: ErrorBars = ERROR_BAR,
    table: TableFormat = typer.Option(
        TableFormat.CSV, help="Format of the table: trajectory.csv and so on."
    ),
    units: bool = flag("--units", "A line of units below the header of CSV."),
    no_plots: bool = NO_PLOTS,
    form: PictureFormat = FORMAT,
    animate: bool = flag("--animate", "Write the page animation.html."),
    resume: bool = flag("--resume", "Continue an interrupted run."),
    sensitivities: str = typer.Option(
        "", metavar="NAMES",
        help="Add derivatives of columns by these parameters and start values, such "
        "as l,theta_dot.",
    ),
    no_limits: bool = NO_LIMITS,
    as_json: bool = JSON,
    quiet: bool = quiet(),
    strict: bool = STRICT,
) -> int:  # fmt: skip
    """Check the start, integrate, write a table and pictures."""
    varied = tuple(x.strip() for x in sensitivities.split(",") if x.strip())
    request = RunRequest(
        error_bar, table, units, None if no_plots else form, animate, resume, quiet,
        strict, varied, no_limits,
    )  # fmt: skip
    if len(models) > 1:
        from lagsim.cli._several import run_all

        return run_all(
            models, folder or RESULTS, partial(Job, request), sets, options, jobs,
            as_json=as_json, quiet=quiet,
        )  # fmt: skip
    documents: list[Any] | None = [] if as_json else None
    job = Job(request, folder, documents=documents)
    # The processor time so far is close to the time of start and imports.
    job.clock.timings["import"] = time.process_time()
    code = job.run(*model_text(models[0]), assignments(sets), options)
    for document in documents or ():
        show_json(document)
    return code


# Where results go by default.
RESULTS = Path("results")
# After this time the state of a run is saved for `--resume`; shorter runs begin again.
KEPT_AFTER_SECONDS = 3.0


class RunRequest(NamedTuple):
    """Options of a run and of its files, see the help of the command.

    Attributes
    ----------
    error_bars : ErrorBars
        When a repeat with a tighter tolerance estimates the error.
    table : TableFormat
        The format of the table of rows.
    show_units : bool
        Whether the table has a row of units.
    plots : PictureFormat or None
        The format of pictures; None for no pictures.
    animate : bool
        Whether a page that plays the motion is written.
    resume : bool
        Whether an interrupted run is continued from its last checkpoint.
    quiet : bool
        Whether no summary is printed.
    strict : bool
        Whether a warning is exit code 1.
    varied : sequence of str
        Names by which sensitivities are computed.
    no_limits : bool
        Whether limits on the size of models are lifted.
    """

    error_bars: ErrorBars
    table: TableFormat
    show_units: bool
    plots: PictureFormat | None
    animate: bool
    resume: bool
    quiet: bool
    strict: bool
    varied: Sequence[str] = ()
    no_limits: bool = False


class Job:
    """Run of one model, with its clock.

    Parameters
    ----------
    request : RunRequest
        The options of the run.
    folder : Path or None
        The folder of the results; None for the default.
    documents : list or None
        The list to which the content of run.json is appended, in place of the printed
        summary; None to print the summary.
    """

    def __init__(
        self,
        request: RunRequest,
        folder: Path | None,
        *,
        documents: list[Any] | None = None,
        interrupt: Interrupt | None = None,
    ) -> None:
        self.request, self.folder, self.documents = request, folder, documents
        self.interrupt = interrupt or Interrupt()
        self.clock = Stopwatch()
        self._draw: Draw | None = None

    def run(
        self,
        text: str,
        file: str,
        overrides: Mapping[str, str],
        options: Mapping[str, str],
    ) -> int:
        """Run a model; return the exit code.

        text, file : the text and the name of the model file.
        overrides : values of `--set`.
        options : options of the run by key of `simulation`.

        Raises
        ------
        InputError, StartError
        """
        with limits.lifted(really=self.request.no_limits):
            return self._read_and_run(text, file, overrides, options)

    def _read_and_run(
        self,
        text: str,
        file: str,
        overrides: Mapping[str, str],
        options: Mapping[str, str],
    ) -> int:
        request = self.request
        if request.table is not TableFormat.CSV:
            if request.resume:
                text = "--resume needs --table csv, which is written row by row"
                raise unusable(USAGE, text)
            check_format(request.table, show_units=request.show_units)
        self.clock.lap("import")
        with self.interrupt.raised():
            model = read(text, file, overrides, options)
        aside: Any = contextlib.nullcontext()
        if request.plots and is_watched():
            from lagsim.studies.drawing import artist

            aside = artist(model)
        with aside as self._draw:
            with self.interrupt.raised():
                settings = settings_of(model, "run", hint="add it, or give --duration")
                self.clock.lap("read")
                case = open_case(model, settings, clock=self.clock)
                session = case.ready(clock=self.clock, quick=True)
            return self._execute(session, {**options, "set": {**overrides}})

    def _execute(self, session: Session, inputs: Document) -> int:
        """Open the folder of results, run a session into it, and return the exit code.

        inputs : options of the run and its files as a document, by which `--resume`
            recognises an equal request.
        """
        request, model = self.request, session.case.model
        folder = self.folder or RESULTS / model.name
        warning = refuse_without_room(
            folder, request.table, session.case.settings, session.columns.table,
            ends=model.until is not None,
        )  # fmt: skip
        if warning and not request.quiet:
            print_stderr(f"warning: {warning}")

        @functools.cache
        def restart() -> Restart:
            from lagsim.studies.restart import Restart

            more = (
                request.error_bars,
                request.show_units,
                request.plots,
                request.animate,
            )
            options = f"{sorted(inputs.items())} {more}"
            identity = {"model text": model.content, "set of options": options}
            return Restart(folder, identity)

        first = restart().load_checkpoint if request.resume else None
        with open_results(folder, first=first) as results:
            if request.resume and restart().stand is None and not request.quiet:
                print_stderr(f"lagsim: {folder} holds no interrupted run to continue")
            return self._integrate(session, results, restart)

    def _integrate(
        self, session: Session, results: Results, restart: Callable[[], Restart]
    ) -> int:
        """Run a session, write all files to `results`, and return the exit code.

        The files are table, events, run.json and pictures.

        restart : creates the storage of checkpoints.
        """
        request, interrupt = self.request, self.interrupt
        with interrupt.noted():
            more = self._appended(session)
        columns = session.columns.of_table + (more.names if more else ())
        units = of_table(session.equations, columns)
        try:
            path = results.part(request.table.file)
            writer = table_writer(
                request.table, path, units, show_units=request.show_units
            )
            listed = None
            if session.lists_events:
                named = bool(session.case.model.events)
                listed = EventsWriter(results.part(EVENTS), named=named)
        except OSError as error:
            raise results.unusable(error) from None
        store: Store = writer
        if more is not None:
            from lagsim.run.observers.appended import Widened

            store = Widened(writer, session.columns.table, more)
        with contextlib.ExitStack() as stack:
            stack.callback(writer.close)
            if listed is not None:
                stack.callback(listed.table.close)
            stack.enter_context(interrupt.noted())
            joined = None
            if request.table is TableFormat.CSV:
                joined = partial(
                    _store_checkpoints, writer=writer, listed=listed, restart=restart,
                    at_once=request.resume,
                )  # fmt: skip
            found = Attempts(
                store, interrupt, self.clock, error_bars=request.error_bars,
                replaces=request.error_bars is not ErrorBars.NEVER,
                records=Records(
                    thinned=request.plots is not None, animated=request.animate,
                    appended=more,
                ),
                progress=partial(progress_bar, quiet=request.quiet), joined=joined,
                listed=listed,
            ).best(session)  # fmt: skip
            document, full = self._write(found, results, writer)
        self._report(found, document, results.folder)
        return self._code(found, document, full)

    def _appended(self, session: Session) -> Appended | None:
        """Return the columns of sensitivities and standard deviations; None if none."""
        model = session.case.model
        names = *model.output.sensitivities, *self.request.varied
        uncertain = any(p.uncertainty for p in model.parameters)
        if not names and not uncertain:
            return None
        from lagsim.studies.sensitivities import appended

        with progress_bar("sensitivities", quiet=self.request.quiet) as progress:
            return appended(
                model, session.case.settings, [*dict.fromkeys(names)],
                interrupt=self.interrupt, progress=progress,
            )  # fmt: skip

    def _write(
        self, found: Attempt, results: Results, writer: Writer
    ) -> tuple[Document, OSError | None]:
        """Write all files of a run; return the content of run.json, and an error.

        The error is the OSError of a disk that is full, or None.

        found : the run.
        results : the folder.
        writer : the writer of the table.
        """
        request, lost, full = self.request, False, found.fault
        try:
            writer.finish()
        except OSError as error:
            results.drop(request.table.file)
            lost, full = True, error
        if not full and (found.session.lists_events or found.sections):
            from lagsim.studies.drawing import event_tables

            try:
                list(results.fill(event_tables(found)))
            except OSError as error:
                full = error
        written = found.trajectory.listed
        if isinstance(written, EventsWriter):
            full = full or written.fault
            if written.fault or not found.session.lists_events:
                results.drop(EVENTS)
        cautions = [*results.cautions, *found.cautions()]
        self.clock.lap("output")
        files = [*results.names, MANIFEST]
        document = found.record(cautions, self.clock.timings, files)
        if results.folder == RESULTS / document["model"]["name"]:
            before = results.before()
            caution = before and replaced(before, document, results.folder)
            document["warnings"] += [caution.record] if caution else []
        if not full and (request.plots or request.animate):
            full = self._draw_all(found, results, document)
        if full:
            document |= _cut_short(writer, found, full, lost=lost)
        document["sha256"] = results.digests()
        commit(results, document, {})
        if not full and document["outcome"] != "interrupted":
            results.forget()
        return document, full

    def _draw_all(
        self, found: Attempt, results: Results, document: Document
    ) -> OSError | None:
        """Write the page and the pictures; return the OSError of a failure, or None.

        The table and run.json are written before, so that a failure here loses no rows.
        A signal ends the drawing, since pictures can be drawn later.
        """
        from lagsim.studies.drawing import drawings

        form = (self.request.plots or PictureFormat.PNG).value
        made = drawings(found, form, self._draw)
        # If the disk is too full for this, the pictures report it.
        with contextlib.suppress(OSError):
            results.publish(encode(document | {"sha256": results.digests()}))
        try:
            self.interrupt.cut(
                lambda: document["warnings"].extend(
                    caution.record for caution in results.fill(made)
                )
            )
        except OSError as error:
            return error
        finally:
            self.clock.lap("plots")
            document["timings"] = self.clock.rounded()
            document["files"] = [*results.names, MANIFEST]
        return None

    def _code(self, found: Attempt, document: Document, full: OSError | None) -> int:
        """Return the exit code; report missing pictures, or a failure by `--strict`.

        full : the OSError of writing, or None.
        """
        interrupt = self.interrupt
        if full:
            return UnwritableError.exit_code
        if interrupt.signal is not None:
            if document["complete"]:
                print_stderr(
                    "lagsim: interrupted: all rows are there, some pictures not"
                )
            return 128 + interrupt.signal
        if not found.trajectory.outcome.complete:
            return 3
        cautions = document["warnings"]
        if not (self.request.strict and cautions):
            return 0
        model = found.session.case.model
        line = strict_line(model.name, [caution["code"] for caution in cautions])
        print_stderr(line)
        annotate(ERROR, line.removeprefix("lagsim: "), model.file)
        return 1

    def _report(self, found: Attempt, document: Document, folder: Path) -> None:
        if not document["complete"]:
            failed = document["failure"]
            numbered = f" [{failed['number']}]" if failed else ""
            print_stderr(f"lagsim: {document['reason']}{numbered}")
            if (folder / RESTART).exists():
                print_stderr("lagsim: the same command with --resume continues the run")
        if not self.request.quiet or self.request.strict:
            for caution in document["warnings"]:
                print_stderr(f"warning: {caution['text']} [{caution['number']}]")
                if "line" in caution:
                    keys = ("line", "column", "length", "source")
                    at = Place("", *(caution[key] for key in keys))
                    print_stderr("\n".join(pointed(at)))
        if self.documents is not None:
            self.documents.append(document)
        elif not self.request.quiet:
            print_stdout(summary(found, document, folder))


def _store_checkpoints(
    run: Run,
    *,
    relay: Relay,
    session: Session,
    writer: Writer,
    listed: EventsWriter | None,
    restart: Callable[[], Restart],
    at_once: bool,
) -> None:
    """Store checkpoints of a run, at the earliest after KEPT_AFTER_SECONDS.

    Until then the modules for checkpoints are not loaded.

    Parameters
    ----------
    relay : Relay
        The observers of the run.
    writer, listed : Writer, EventsWriter or None
        Writers of the table of rows, and of the table of events.
    restart : callable
        Creates the storage of checkpoints.
    at_once : bool
        Whether the run itself continues from a checkpoint: checkpoints are then stored
        from the beginning.
    """
    due = time.monotonic() + KEPT_AFTER_SECONDS

    def tick(run: Run) -> None:
        if at_once or time.monotonic() > due:
            tables = {TableFormat.CSV.file: cast("TableWriter", writer)}
            if listed is not None:
                tables[EVENTS] = listed.table
            restart().join(run, session, relay, tables)

    if at_once:
        tick(run)
    else:
        run.tick = tick


def _cut_short(
    writer: Writer, attempt: Attempt, full: OSError, *, lost: bool
) -> Document:
    """Return the entries of run.json that change if results did not fit on the disk.

    Parameters
    ----------
    writer : Writer
        The writer of the table.
    attempt : Attempt
        The run.
    full : OSError
        The error of writing.
    lost : bool
        Whether the table is missing as well.
    """
    lost_part, rest = "events or a picture", "the table is whole"
    kept = dict[str, Any]()
    if lost:
        lost_part = "the table"
        rest = "a CSV table is written row by row, and would keep its rows"
    elif attempt.fault is not None:
        end = attempt.trajectory.start if writer.last is None else writer.last
        kept = {"end": end, "rows": writer.rows}
        lost_part, rest = "the table", "the rows up to there were kept"
    beyond = f" beyond t = {kept['end']!r}" if kept else ""
    return {
        "outcome": "failed",
        "complete": False,
        "failure": failure(UnwritableError.code),
        "reason": f"{lost_part} could not be written{beyond}: {full.strerror}; {rest}",
        **kept,
    }


# --- The closing lines

# Kinds of events that are counted, in this order.
COUNTED = (
    "impact", "corner", "contact", "release", "stick", "slip", "switch", "event",
)  # fmt: skip
# More names of constraints than this are reported by their number.
MOST_NAMES = 2


def summary(attempt: Attempt, document: Document, folder: Path) -> str:
    """Return the summary of a run that is printed at its end.

    attempt : the run.
    document : the content of run.json.
    folder : the folder of the results.
    """
    colour = "32" if document["complete"] else "31"
    head = (
        f"{coloured(document['outcome'], colour)}: {document['model']['name']}, "
        f"t = {document['start']:g} to {document['end']:.9g}, "
        f"{counted(document['rows'], 'row')}"
    )
    equations = attempt.session.equations
    constraints = len(equations.model.constraints)
    contacts = len({law.name for law in equations.laws if law.gapped})
    parts = {
        "coordinate": len(equations.q), "state": len(equations.states),
        "constraint": constraints - contacts, "contact": contacts,
    }  # fmt: skip
    system = ", ".join(counted(n, noun) for noun, n in parts.items() if n)
    plan = (f"{c['choice']} ({c['reason']})" for c in document["plan"])
    rows = [("system", system), *titled_rows("plan", plan), _accuracy(document)]
    if document["outcome"] == "until":
        rows.append(("ended", document["reason"]))
    if attempt.session.lists_events:
        rows += titled_rows("events", _happened(attempt.trajectory))
    rows.append(("work done", _work(document)))
    unit = document["columns"]["energy"]
    drift = document["energy_drift"]
    drift = f"{drift:.2g} {unit}".rstrip() if math.isfinite(drift) else "not known"
    kept = "energy - work" if "work" in document["columns"] else "energy"
    energy = f"{attempt.residuals.first_energy:.7g} {unit}".rstrip()
    start = f"(energy {energy} at the start)"
    rows.append(("error", _error(attempt.bar)))
    rows.append(("energy drift", f"{drift} in {kept} {start}"))
    if constraints:
        residual = document["constraint_residual"]
        rows.append(("residual", f"largest {residual:.2g} of its scale"))
    rows.append(("files", f"{folder}: {', '.join(document['files'])}"))
    return head + "\n" + aligned_pairs(rows)


def _happened(trajectory: Trajectory) -> list[str]:
    """Return lines of the summary on the numbers of events, and on accumulations."""
    counts = [(kind, trajectory.event_counts.get(kind, 0)) for kind in COUNTED]
    parts = [counted(number, kind) for kind, number in counts if number]
    named = _named([e for e in trajectory.events if e.kind in COUNTED])
    where = f" at {named}" if named else ""
    lines = [", ".join(parts) + where] if parts else []
    for word, own in (("at rest from", True), ("switches accumulate until", False)):
        ends = [
            e for e in trajectory.events
            if e.kind == "zeno" and (e.constraint is not None) is own
        ]  # fmt: skip
        if ends:
            times = {e.time for e in ends}
            last = max(times)
            named = _named([e for e in ends if e.time == last])
            often = f", {len(times)} times in all" if len(times) > 1 else ""
            lines.append(f"{word} t = {last:.9g}: {named}{often}")
    return lines or ["none"]


def _named(events: Sequence[Event]) -> str:
    """Return a text with the names of the events' constraints.

    If the names are too many, their number takes their place.
    """
    own = dict.fromkeys(f"`{e.name}`" for e in events if e.name)
    constraints = dict.fromkeys(f"`{e.constraint}`" for e in events if e.constraint)
    switches = dict.fromkeys(f"`{e.switch}`" for e in events if e.switch)
    if len(constraints) + len(switches) + len(own) <= MOST_NAMES:
        return ", ".join((*constraints, *switches, *own))
    counts = map(len, (constraints, switches, own))
    numbers = zip(counts, ("constraint", "switch", "name"), strict=True)
    return ", ".join(counted(number, noun) for number, noun in numbers if number)


def _accuracy(document: Document) -> tuple[str, str]:
    if document["step"] is not None:
        return "step", f"{document['step']:g}"
    atol = document["atol"]
    scale = "relative to the range of each variable"
    floor = scale if atol is None else f"and atol {atol:g}"
    return "tolerance", f"rtol {document['rtol']:g} {floor}"


def _error(bar: Estimate | str) -> str:
    """Return the text on the error bar: worst coordinate, its growth, the horizon."""
    if isinstance(bar, str):
        return f"not estimated: {bar}"
    name, worst = max(bar.coordinates.items(), key=lambda item: item[1].relative)
    by = bar.method if bar.rtol is None else f"{bar.method} at rtol {bar.rtol:.2g}"
    if bar.rests:
        apart = max(error.largest for error in bar.coordinates.values())
        text = "no coordinate moves; a repeat by " + by
        return f"{text} agrees to {apart:.1g}" if apart else f"{text} agrees"
    t, reached = bar.growth[(len(bar.growth) - 1) // 2]
    text = (
        f"about {worst.relative:.1g} of the range of {name} ({reached:.1g} by "
        f"t = {t:.4g}), from a repeat by {by}"
    )
    if bar.horizon is not None:
        text += f"; no forecast past t = {bar.horizon:.4g}"
    return text


def _work(document: Document) -> str:
    seconds = document["timings"]
    return (
        f"{counted(document['steps'], 'step')}, {document['rejections']} rejected, "
        f"{counted(document['evaluations'], 'evaluation')}; integrated in "
        f"{_duration(seconds['integrate'])}, {_duration(sum(seconds.values()))} in all"
    )


def _duration(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds >= 1 else f"{seconds * 1e3:.3g} ms"
