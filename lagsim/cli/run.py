"""`lagsim run`: check, derive, integrate, write."""

from __future__ import annotations

import contextlib
import inspect
import time
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from lagsim.cli._closing import progress_bar, summary
from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import (
    AsJson,
    Jobs,
    Picture,
    PictureForm,
    Quiet,
    Sets,
    Strict,
    assignments,
    output_folder,
    refused,
    show_json,
)
from lagsim.cli._signals import is_watched
from lagsim.cli._streams import ERROR, UnwritableError, annotate, complain, say
from lagsim.cli._writing import (
    Later,
    ask_for_room,
    commit,
    cut_short,
    draw_all,
    filled,
    finish,
    open_table,
    tell_of_replaced,
)
from lagsim.errors import InputError, Problem
from lagsim.methods import names, options
from lagsim.model.model import DEFAULT_ROWS, DEFAULT_RTOL, ROWS_TO_DECAY
from lagsim.model.reader import read
from lagsim.native.link.ahead import helped
from lagsim.outputs import Format
from lagsim.outputs.packed import check_format
from lagsim.outputs.results import MANIFEST, RESTART, open_results
from lagsim.outputs.units import of_table
from lagsim.run.interrupt import Interrupt
from lagsim.run.session import Clock, open_case, wanted
from lagsim.studies.attempts import Attempts, ErrorBars

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lagsim.model.model import Model
    from lagsim.outputs.results import Results
    from lagsim.run.session import Session
    from lagsim.studies.attempts import Attempt
    from lagsim.studies.drawing import Draw
    from lagsim.studies.restart import Restart


# The keys of `simulation` that commands take: what stands for the value, and the help.
_HELP = {
    "method": "M Integration method; see `lagsim methods`.",
    "rtol": f"X Relative tolerance; default {DEFAULT_RTOL:g}.",
    "atol": "X Absolute tolerance; default rtol times each component's scale.",
    "step": "H Step of fixed-step methods; default the output step.",
    "formulation": "F How constraints are satisfied: projection, elimination, "
    "baumgarte, drift; full: nothing is reduced.",
    "gain": "X Gain of baumgarte, per unit of time; "
    f"default {1 / ROWS_TO_DECAY:g}/output step.",
    **{
        key: f"X Of {name}, from {x.least:g} to {x.most:g}."
        for key, (name, x) in options().items()
    },
    "duration": "T Duration of the run.",
    "output_step": f"H Time between rows; default duration/{DEFAULT_ROWS}.",
}


def _setting(key: str) -> Any:
    metavar, _, text = _HELP[key].partition(" ")
    known = (lambda: ["auto", *names()]) if key == "method" else None
    option = typer.Option(metavar=metavar, help=text, autocompletion=known)
    return Annotated[str | None, option]


SETTINGS = {key: _setting(key) for key in _HELP}
ErrorBar = Annotated[
    ErrorBars,
    typer.Option(
        help="Repeat the run with a tighter tolerance to estimate its error; auto: if "
        "that takes at most about 2 s."
    ),
]


def with_settings(command: Callable[..., int]) -> Callable[..., int]:
    """Replace the parameter `options` of a command by the keys of `simulation`.

    The command gets those that are given, as a mapping.
    """

    @wraps(command)
    def called(**words: Any) -> int:
        asked = {key: words.pop(key) for key in SETTINGS}
        given = {key: text for key, text in asked.items() if text is not None}
        return command(**words, options=given)

    own = inspect.signature(command, eval_str=True)
    each: list[inspect.Parameter] = []
    for name, x in own.parameters.items():
        more = [
            x.replace(name=k, annotation=a, default=None) for k, a in SETTINGS.items()
        ]
        each += more if name == "options" else [x]
    called.__signature__ = own.replace(parameters=each)  # type: ignore[attr-defined]
    return called


@with_settings
def command(
    models: Annotated[
        list[str], typer.Argument(metavar="MODEL...", help="Model files; - is stdin.")
    ],
    folder: Annotated[
        Path | None,
        output_folder(
            "Output folder; default results/NAME; DIR/NAME for several models."
        ),
    ] = None,
    jobs: Jobs = None,
    sets: Sets = None,
    *,
    options: dict[str, str],
    error_bar: ErrorBar = ErrorBars.AUTO,
    table: Annotated[
        Format, typer.Option(help="Format of the table: trajectory.csv and so on.")
    ] = Format.CSV,
    units: Annotated[
        bool, typer.Option("--units", help="A line of units below the header of CSV.")
    ] = False,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="No pictures.")] = False,
    form: PictureForm = Picture.PNG,
    animate: Annotated[
        bool, typer.Option("--animate", help="Write the page animation.html.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue an interrupted run.")
    ] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
    strict: Strict = False,
) -> int:
    """Check the start, integrate, write a table and pictures."""
    wish = Wish(
        error_bar, table, units, None if no_plots else form, animate, resume, quiet,
        strict,
    )  # fmt: skip
    if len(models) > 1:
        from lagsim.cli._several import Batch

        batch = Batch(models, folder, partial(Job, wish), as_json=as_json, quiet=quiet)
        return batch.run(sets, options, jobs)
    documents: list[Any] | None = [] if as_json else None
    job = Job(wish, folder, documents=documents)
    # The processor time so far is close to what starting and importing took.
    job.clock.timings["import"] = time.process_time()
    with faults_shown(documents, file=models[0]) as code:
        from lagsim.model.loading import text_of

        code.append(job.run(*text_of(models[0]), assignments(sets), options))
    for document in documents or ():
        show_json(document)
    return code[-1]


# Where results go by default.
RESULTS = Path("results")


class Wish(NamedTuple):
    """How a run is made and written, see the options of the command."""

    error_bars: ErrorBars
    table: Format
    show_units: bool
    plots: Picture | None
    animate: bool
    resume: bool
    quiet: bool
    strict: bool


class Job:
    """One run of one model, with its clock.

    Parameters
    ----------
    documents
        Gets run.json, which nobody is told of then; None where a person reads.
    """

    def __init__(
        self,
        wish: Wish,
        folder: Path | None,
        *,
        documents: list[Any] | None = None,
        interrupt: Interrupt | None = None,
    ) -> None:
        self.wish, self.folder, self.documents = wish, folder, documents
        self.interrupt = interrupt or Interrupt()
        self.clock = Clock()
        self._draw: Draw | None = None

    def run(
        self,
        text: str,
        file: str,
        overrides: Mapping[str, str],
        options: Mapping[str, str],
    ) -> int:
        """Do it; give the exit code."""
        wish = self.wish
        if wish.table is not Format.CSV:
            if wish.resume:
                text = "--resume needs --table csv, which is written row by row"
                raise InputError([Problem("usage", text)])
            check_format(wish.table, show_units=wish.show_units)
        self.clock.lap("import")

        with self.interrupt.raised():
            model = read(text, file, overrides, options)
        aside: Any = contextlib.nullcontext()
        if wish.plots and is_watched():
            from lagsim.studies.drawing import artist

            aside = artist(model)
        with aside as self._draw:
            return self._do(model, {**options, "set": {**overrides}})

    def _do(self, model: Model, wishes: Mapping[str, Any]) -> int:
        with self.interrupt.raised():
            session, quiet = self._ready(model), self.wish.quiet
        model = session.case.equations.model
        folder = self.folder or RESULTS / model.name
        ask_for_room(session, folder, self.wish.table, quiet=quiet)
        restart = partial(self._restart, folder, model.sha256, wishes)
        known = restart() if self.wish.resume else None
        first = None if known is None else known.rescue
        with open_results(folder, first=first) as results:
            if known is not None and known.stand is None and not quiet:
                complain(f"lagsim: {folder} holds no interrupted run to continue")
            made = restart if known is None else lambda: known
            return self._integrate(session, results, made)

    def _ready(self, model: Model) -> Session:
        """Derive, examine, plan and compile."""
        settings = wanted(model, "run", hint="add it, or give --duration")
        self.clock.lap("read")

        with helped() if is_watched() else contextlib.nullcontext():
            return open_case(model, settings, clock=self.clock).ready(clock=self.clock)

    def _restart(self, folder: Path, sha256: str, wishes: Mapping[str, Any]) -> Restart:
        """Give what keeps a run of these wishes, and goes on with it."""
        from lagsim.studies.restart import Restart

        wish = self.wish
        more = wish.error_bars, wish.show_units, wish.plots, wish.animate
        options = f"{sorted(wishes.items())} {more}"
        identity = {"model text": sha256, "set of options": options}
        return Restart(folder, wish.table.file, identity)

    def _integrate(
        self, session: Session, results: Results, restart: Callable[[], Restart]
    ) -> int:
        wish, interrupt = self.wish, self.interrupt
        units = of_table(session.case.equations, session.system.columns.of_table)
        table = open_table(results, wish.table, units, show_units=wish.show_units)
        with table as writer, interrupt.noted():
            joined = None
            if wish.table is Format.CSV:
                joined = partial(Later(writer, restart), at_once=wish.resume)
            found = Attempts(
                writer, interrupt, self.clock, error_bars=wish.error_bars,
                thinned=wish.plots is not None, animated=wish.animate,
                progress=partial(progress_bar, quiet=wish.quiet), joined=joined,
            ).best(session)  # fmt: skip
            lost = finish(writer, results, wish.table)
            full = lost or found.fault
            if not full and session.lists_events:
                from lagsim.studies.drawing import events

                full = filled(results, events(found))
            cautions = found.cautions()
            self.clock.lap("output")
            files = [*results.names, MANIFEST]
            document = found.record(cautions, self.clock.timings, files)
            if results.folder == RESULTS / document["model"]["name"]:
                tell_of_replaced(results, document)
            if not full and (wish.plots or wish.animate):
                from lagsim.studies.drawing import drawings

                form = (wish.plots or Picture.PNG).value
                more = drawings(found, found.thin, found.frames, form, self._draw)
                full = draw_all(results, document, more, interrupt, self.clock)
            if full:
                document |= cut_short(writer, found, full, lost=lost is not None)
            document["sha256"] = results.digests()
            commit(results, document, {})
            if not full and document["outcome"] != "interrupted":
                results.forget()
        self._report(found, document, results.folder)
        return self._code(found, document, full)

    def _code(
        self, found: Attempt, document: Mapping[str, Any], full: OSError | None
    ) -> int:
        """Give the exit code, and say what a signal or `--strict` has cost."""
        interrupt = self.interrupt
        if full:
            return UnwritableError.exit_code
        if interrupt.signal is not None:
            if document["complete"]:
                complain("lagsim: interrupted: all rows are there, some pictures not")
            return 128 + interrupt.signal
        if not found.trajectory.outcome.complete:
            return 3
        cautions = document["warnings"]
        if not (self.wish.strict and cautions):
            return 0
        model = found.session.case.equations.model
        told = refused(model.name, [caution["code"] for caution in cautions])
        complain(told)
        annotate(ERROR, told.removeprefix("lagsim: "), model.file)
        return 1

    def _report(
        self, found: Attempt, document: Mapping[str, Any], folder: Path
    ) -> None:
        if not document["complete"]:
            failed = document["failure"]
            numbered = f" [{failed['number']}]" if failed else ""
            complain(f"lagsim: {document['reason']}{numbered}")
            if (folder / RESTART).exists():
                complain("lagsim: the same command with --resume continues the run")
        if not self.wish.quiet or self.wish.strict:
            for caution in document["warnings"]:
                complain(f"warning: {caution['text']} [{caution['number']}]")
        if self.documents is not None:
            self.documents.append(document)
        elif not self.wish.quiet:
            say(summary(found, document, folder))
