"""`lagsim run`: check, derive, integrate, write."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._closing import summary
from lagsim.cli._shared import (
    AsJson,
    ModelPath,
    Sets,
    assignments,
    faults_shown,
    show_json,
    unknown_names,
)
from lagsim.cli._streams import UnwritableError, complain, say
from lagsim.cli._writing import cut_short, open_table
from lagsim.errors import InputError, Problem
from lagsim.model.settings import DEFAULT_ROWS, DEFAULT_RTOL, ROWS_TO_DECAY
from lagsim.studies.attempts import ErrorBars

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility import Examination
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model
    from lagsim.model.settings import Settings
    from lagsim.notes import Caution
    from lagsim.outputs.results import Results
    from lagsim.plan import Plan
    from lagsim.run.error import ErrorBar
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers.ledger import Ledger
    from lagsim.run.observers.thinning import Thinning
    from lagsim.run.system import System
    from lagsim.run.trajectory import Trajectory

LAPS = (
    "import", "read", "derive", "compile", "integrate", "error_bar", "output", "plots",
)  # fmt: skip


def command(
    model: ModelPath,
    folder: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder; default results/NAME."
        ),
    ] = None,
    sets: Sets = None,
    method: Annotated[
        str | None,
        typer.Option(metavar="M", help="Integration method; see `lagsim methods`."),
    ] = None,
    rtol: Annotated[
        str | None,
        typer.Option(
            metavar="X", help=f"Relative tolerance; default {DEFAULT_RTOL:g}."
        ),
    ] = None,
    atol: Annotated[
        str | None,
        typer.Option(
            metavar="X",
            help="Absolute tolerance; default rtol times each component's scale.",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            metavar="H", help="Step of fixed-step methods; default the output step."
        ),
    ] = None,
    formulation: Annotated[
        str | None,
        typer.Option(
            metavar="F",
            help="How constraints are met: projection, elimination, baumgarte, "
            "drift; full: nothing is reduced.",
        ),
    ] = None,
    gain: Annotated[
        str | None,
        typer.Option(
            metavar="X",
            help="Of baumgarte, per unit of time; "
            f"default {1 / ROWS_TO_DECAY:g}/output step.",
        ),
    ] = None,
    spectral_radius: Annotated[
        str | None,
        typer.Option(metavar="X", help="Of generalized-alpha, from 0 to 1."),
    ] = None,
    duration: Annotated[
        str | None, typer.Option(metavar="T", help="How long to run.")
    ] = None,
    output_step: Annotated[
        str | None,
        typer.Option(
            metavar="H", help=f"Spacing of rows; default duration/{DEFAULT_ROWS}."
        ),
    ] = None,
    error_bar: Annotated[
        ErrorBars,
        typer.Option(
            help="Repeat the run more tightly to estimate its error; auto: where that "
            "takes no more than about 2 s."
        ),
    ] = ErrorBars.AUTO,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="No pictures.")] = False,
    as_json: AsJson = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Say nothing unless it fails.")
    ] = False,
) -> int:
    """Check the start, derive the equations, integrate, write table and pictures."""
    options = {
        "method": method,
        "rtol": rtol,
        "atol": atol,
        "step": step,
        "formulation": formulation,
        "gain": gain,
        "spectral_radius": spectral_radius,
        "duration": duration,
        "output_step": output_step,
    }
    given = {name: text for name, text in options.items() if text is not None}
    job = _Job(folder, error_bar, plots=not no_plots, as_json=as_json, quiet=quiet)
    documents: list[Any] = []
    with faults_shown(documents if as_json else None, file=model) as code:
        code.append(job.run(model, assignments(sets), given))
    for faults in documents:
        show_json(faults)
    return code[-1]


class _Job:
    """One run of one model, with its clock and its manners."""

    def __init__(
        self,
        folder: Path | None,
        error_bars: ErrorBars,
        *,
        plots: bool,
        as_json: bool,
        quiet: bool,
    ) -> None:
        self.folder = folder
        self.error_bars = error_bars
        self.plots = plots
        self.as_json = as_json
        self.quiet = quiet
        # The processor time so far is close to what starting and importing took.
        self.timings = dict.fromkeys(LAPS, 0.0) | {"import": time.process_time()}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Record the time since the last lap."""
        now = time.perf_counter()
        self.timings[name] += now - self._last
        self._last = now

    def run(
        self, path: str, overrides: Mapping[str, str], options: Mapping[str, str]
    ) -> int:
        """Do it; give the exit code."""
        from lagsim.admissibility import examine
        from lagsim.cli import check
        from lagsim.mechanics.equations import derive
        from lagsim.model.reader import read_file
        from lagsim.plan import make_plan
        from lagsim.run.system import System

        self.lap("import")
        model = read_file(path, overrides, options)
        settings = wanted(model)
        self.lap("read")
        equations = derive(model)
        examined = examine(equations, settings.start)
        if not examined.admissible:
            if self.as_json:
                show_json(check.document(equations, examined))
            else:
                complain(check.report(equations, examined))
            return 1
        plan = make_plan(equations, examined.start, settings)
        self.lap("derive")
        system = System(equations, plan)
        system.link(plan.method)
        self.lap("compile")
        from lagsim.outputs.results import open_results

        folder = self.folder or Path("results") / model.name
        with open_results(folder) as results:
            return self._integrate(equations, examined, settings, plan, system, results)

    def _integrate(
        self,
        equations: Equations,
        examined: Examination,
        settings: Settings,
        plan: Plan,
        system: System,
        results: Results,
    ) -> int:
        from lagsim.outputs.manifest import encode, manifest
        from lagsim.outputs.results import MANIFEST
        from lagsim.run.interrupt import Interrupt
        from lagsim.studies.alarms import alarms
        from lagsim.studies.attempts import Attempts, Means

        names = system.columns.names
        interrupt = Interrupt()
        with open_table(results, names[: system.columns.table]) as writer, (
            interrupt.noted()
        ):  # fmt: skip
            attempts = Attempts(
                self, equations, examined.start, settings, writer, interrupt
            )
            found = attempts.best(Means(plan, system))
            plan, system, trajectory = found.plan, found.system, found.trajectory
            ledger, bar, full = found.ledger, found.bar, found.output.fault
            if found.thin and not full:
                full = self._draw(system, trajectory, found.thin, bar, results)
            cautions = alarms(
                equations, examined, settings, plan, trajectory, ledger, found.witness,
                bar,
            )  # fmt: skip
            self.lap("output")
            timings = {name: round(t, 6) for name, t in self.timings.items()}
            document = manifest(
                system, plan, trajectory, ledger, bar, cautions, timings,
                [*results.names, MANIFEST],
            )  # fmt: skip
            if full:
                document |= cut_short(found.output, full, trajectory.start)
            try:
                results.commit(encode(document))
            except OSError as error:
                text = f"lagsim: {results.folder} cannot be written: {error.strerror}"
                raise UnwritableError(text) from None
        self._report(equations, document, results.folder, cautions, ledger, bar)
        if full:
            return UnwritableError.exit_code
        return _exit_code(trajectory, interrupt)

    def _draw(
        self,
        system: System,
        trajectory: Trajectory,
        thin: Thinning,
        bar: ErrorBar | str,
        results: Results,
    ) -> OSError | None:
        """Draw the pictures; give what kept one from being written."""
        import logging

        # It tells on stderr of a home that it cannot write to, which is no news.
        logging.getLogger("matplotlib").setLevel(logging.ERROR)
        from lagsim.outputs.plots import pictures
        from lagsim.outputs.time_panels import Record

        model = system.equations.model
        marked = [e.time for e in trajectory.events if e.kind != "until"]
        complete = trajectory.outcome.complete
        note = "" if complete else f"incomplete: {trajectory.reason}"
        horizon = None if isinstance(bar, str) else bar.horizon
        record = Record(
            model.name, thin, system.units(), marked[:200], note,
            math.inf if horizon is None else horizon,
        )  # fmt: skip
        is_sum = system.equations.energy_is_sum
        try:
            for name, content in pictures(record, model, energy_is_sum=is_sum):
                results.write(name, content)
        except OSError as error:
            return error
        finally:
            self.lap("plots")
        return None

    def _report(
        self,
        equations: Equations,
        document: Mapping[str, Any],
        folder: Path,
        cautions: Sequence[Caution],
        ledger: Ledger,
        bar: ErrorBar | str,
    ) -> None:
        if not document["complete"]:
            complain(f"lagsim: {document['reason']}")
        if not self.quiet:
            for caution in cautions:
                complain(f"warning: {caution.text}")
        if self.as_json:
            show_json(document)
        elif not self.quiet:
            say(summary(equations, document, folder, ledger.first_energy, bar))


def wanted(model: Model, command: str = "run") -> Settings:
    """Give how the file wants to be run; refuse what this version cannot run.

    Raises
    ------
    InputError
    """
    settings = model.settings()
    problems = [
        Problem(
            "one-sided",
            f"constraint `{c.name}` is one-sided, and `{command}` has no contact yet",
            c.relation.place,
            "`check` reads it; an equality `=` holds both ways",
        )
        for c in model.constraints
        if c.law is not None
    ]
    if not settings.duration:
        problems.append(
            Problem(
                "missing-key",
                f"{model.file}: `{command}` needs to know how long: there is no "
                "`simulation.duration` (or `end`)",
                hint="add it, or give --duration" if command == "run" else "add it",
            )
        )
    else:
        problems += unknown_names(settings)
    if problems:
        raise InputError(problems)
    return settings


def _exit_code(trajectory: Trajectory, interrupt: Interrupt) -> int:
    if interrupt.signal is not None:
        return 128 + interrupt.signal
    return 0 if trajectory.outcome.complete else 3
