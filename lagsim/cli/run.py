"""`lagsim run`: check, derive, integrate, write."""

from __future__ import annotations

import errno
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._shared import (
    AsJson,
    ModelPath,
    Sets,
    assignments,
    coloured,
    faults_shown,
    show_json,
    table,
)
from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lagsim.admissibility import Start
    from lagsim.equations import Equations
    from lagsim.model import Model
    from lagsim.native.kernel_types import Floats
    from lagsim.outputs.ledger import Ledger
    from lagsim.outputs.results import Results
    from lagsim.outputs.thinning import Thinning
    from lagsim.plan import Plan
    from lagsim.simulate import Interrupt
    from lagsim.system import System
    from lagsim.trajectory import Caution, Trajectory

# Runs that last longer than this show a progress bar on a terminal.
PATIENCE_SECONDS = 1.0


def command(
    model: ModelPath,
    folder: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder; default results/NAME."),
    ] = None,
    sets: Sets = None,
    method: Annotated[
        str | None, typer.Option(help="Integration method; see `lagsim methods`.")
    ] = None,
    rtol: Annotated[str | None, typer.Option(help="Relative tolerance.")] = None,
    atol: Annotated[str | None, typer.Option(help="Absolute tolerance.")] = None,
    step: Annotated[
        str | None, typer.Option(help="Step of fixed-step methods.")
    ] = None,
    duration: Annotated[str | None, typer.Option(help="How long to run.")] = None,
    output_step: Annotated[str | None, typer.Option(help="Spacing of rows.")] = None,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="No pictures.")] = False,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing.")] = False,
) -> int:
    """Check the start, derive the equations, integrate, write table and pictures."""
    options = {
        "method": method,
        "rtol": rtol,
        "atol": atol,
        "step": step,
        "duration": duration,
        "output_step": output_step,
    }
    given = {name: text for name, text in options.items() if text is not None}
    job = _Job(folder, plots=not no_plots, as_json=as_json, quiet=quiet)
    with faults_shown(as_json=as_json) as code:
        code.append(job.run(model, assignments(sets), given))
    return code[-1]


class _Job:
    """One run of one model, with its clock and its manners."""

    def __init__(
        self, folder: Path | None, *, plots: bool, as_json: bool, quiet: bool
    ) -> None:
        self.folder = folder
        self.plots = plots
        self.as_json = as_json
        self.quiet = quiet
        # The processor time so far is close to what starting and importing took.
        self.timings = {"import": time.process_time()}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Record the time since the last lap."""
        now = time.perf_counter()
        self.timings[name] = self.timings.get(name, 0.0) + now - self._last
        self._last = now

    def run(
        self, path: str, overrides: Mapping[str, str], options: Mapping[str, str]
    ) -> int:
        """Do it; give the exit code."""
        from lagsim.admissibility import examine
        from lagsim.cli import check
        from lagsim.equations import derive
        from lagsim.plan import make_plan
        from lagsim.reader import read_file
        from lagsim.system import System

        self.timings["import"] += time.perf_counter() - self._last
        self._last = time.perf_counter()
        model = read_file(path, overrides, options)
        _refuse(model)
        self.lap("read")
        equations = derive(model)
        start = examine(equations)
        if not start.admissible:
            return check.show(model, equations, start, as_json=self.as_json)
        plan = make_plan(equations, start)
        self.lap("derive")
        system = System(equations, plan)
        self.lap("compile")
        from lagsim.outputs.results import open_results

        folder = self.folder or Path("results") / model.name
        with open_results(folder) as results:
            return self._integrate(equations, start, plan, system, results)

    def _integrate(
        self,
        equations: Equations,
        start: Start,
        plan: Plan,
        system: System,
        results: Results,
    ) -> int:
        from lagsim.outputs import table as table_file
        from lagsim.outputs.ledger import Ledger
        from lagsim.simulate import Interrupt, simulate

        names = system.columns.names
        ledger = Ledger(names)
        thin = self._thinning(equations.model, names)
        writer = table_file.TableWriter(
            results.part(table_file.NAME), names[: system.columns.table]
        )
        timed = _Timed([ledger, writer, *([thin] if thin else [])])
        interrupt = Interrupt()
        with interrupt.noted():
            with _progress(quiet=self.quiet) as progress:
                trajectory = simulate(
                    equations, start, plan, system, [timed],
                    interrupt=interrupt, progress=progress,
                )  # fmt: skip
            self.lap("integrate")
            self.timings["integrate"] -= timed.seconds
            self.timings["output"] = timed.seconds
            writer.close()
            full = timed.fault
            if thin and not full:
                self._draw(system, trajectory, thin, results)
        cautions = [*start.warnings, *_cautions(start, system), *trajectory.warnings]
        document = self._document(system, plan, trajectory, ledger, cautions, results)
        if full:
            document |= {
                "outcome": "failed",
                "complete": False,
                "reason": f"the table could not be written: {full.strerror}; the rows "
                f"up to there were kept",
            }
        from lagsim.outputs.manifest import encode

        results.commit(encode(document))
        self._report(equations, trajectory, document, results, cautions)
        if full:
            return 3
        return _exit_code(trajectory, interrupt)

    def _thinning(self, model: Model, names: Sequence[str]) -> Thinning | None:
        if not self.plots:
            return None
        from lagsim.outputs.thinning import picture_thinning

        return picture_thinning(model, names)

    def _draw(
        self,
        system: System,
        trajectory: Trajectory,
        thin: Thinning,
        results: Results,
    ) -> None:
        from lagsim.outputs.plots import pictures
        from lagsim.outputs.time_panels import Record

        model = system.equations.model
        marked = [e.time for e in trajectory.events if e.kind != "until"]
        complete = trajectory.outcome.complete
        note = "" if complete else f"incomplete: {trajectory.reason}"
        record = Record(model.name, thin, system.units(), marked[:200], note)
        is_sum = system.equations.energy_is_sum
        for name, content in pictures(record, model, energy_is_sum=is_sum):
            results.write(name, content)
        self.lap("plots")

    def _document(
        self,
        system: System,
        plan: Plan,
        trajectory: Trajectory,
        ledger: Ledger,
        cautions: Sequence[Caution],
        results: Results,
    ) -> dict[str, Any]:
        from lagsim.outputs.manifest import manifest
        from lagsim.outputs.results import MANIFEST

        self.lap("output")
        files = [*results.names, MANIFEST]
        timings = {name: round(t, 6) for name, t in self.timings.items()}
        return manifest(system, plan, trajectory, ledger, cautions, timings, files)

    def _report(
        self,
        equations: Equations,
        trajectory: Trajectory,
        document: Mapping[str, Any],
        results: Results,
        cautions: Sequence[Caution],
    ) -> None:
        complete = document["complete"]
        if not complete:
            print(f"lagsim: {document['reason']}", file=sys.stderr)
        if not self.quiet:
            for caution in cautions:
                print(f"warning: {caution.text}", file=sys.stderr)
        if self.as_json:
            show_json(document)
        elif not self.quiet:
            print(_summary(equations, trajectory, document, results.folder))


def _summary(
    equations: Equations,
    trajectory: Trajectory,
    document: Mapping[str, Any],
    folder: Path,
) -> str:
    """Give the closing lines."""
    word = document["outcome"]
    colour = "32" if document["complete"] else "31"
    head = (
        f"{coloured(word, colour)}: {document['model']['name']}, "
        f"t = {trajectory.start:g} to {trajectory.end:.9g}, {trajectory.rows} rows"
    )
    n, m = len(equations.q), len(equations.rows)
    held = f", {m} constraint{'s' * (m != 1)}" if m else ""
    rows = [("system", f"{n} coordinate{'s' * (n != 1)}{held}")]
    rows += [("", f"{c['choice']} ({c['reason']})") for c in document["plan"]]
    rows[1] = ("plan", rows[1][1])
    if word == "until":
        rows.append(("ended", trajectory.reason))
    counts = trajectory.statistics
    seconds = document["timings"]
    spent = sum(seconds.values())
    done = (
        f"{counts.steps} steps, {counts.rejections} rejected, "
        f"{counts.evaluations} evaluations; "
        f"{seconds['integrate'] * 1e3:.3g} ms of {spent:.2g} s"
    )
    rows.append(("work done", done))
    rows.append(("energy drift", f"{document['energy_drift']:.2g}"))
    if m:
        residual = f"{document['constraint_residual']:.2g} of its scale"
        rows.append(("residual", f"largest {residual}"))
    rows.append(("files", f"{folder}: {', '.join(document['files'])}"))
    return head + "\n" + table(rows)


def _refuse(model: Model) -> None:
    """Refuse what this version cannot run."""
    problems = [
        Problem(
            "one-sided",
            f"constraint `{c.name}` is one-sided, and `run` has no contact yet",
            c.relation.place,
            "`check` reads it; an equality `=` holds both ways",
        )
        for c in model.constraints
        if c.law is not None
    ]
    if model.simulation is None:
        problems.append(
            Problem(
                "missing-key",
                f"{model.file}: `run` needs to know how long: there is no "
                "`simulation.duration` (or `end`)",
                hint="add it, or give --duration",
            )
        )
    if problems:
        raise InputError(problems)


def _cautions(start: Start, system: System) -> list[Caution]:
    from lagsim.trajectory import Caution

    found = []
    if start.changes:
        moved = ", ".join(
            f"{name} from {old!r} to {new!r}"
            for name, (old, new) in start.changes.items()
        )
        text = f"the run starts from the nearest exact state: {moved}"
        found.append(Caution("start-changed", text))
    for switch in system.switches.state:
        text = (
            f"{switch} depends on the state: its jumps are stepped over, not located, "
            "which costs accuracy"
        )
        found.append(Caution("switch-not-located", text))
    return found


def _exit_code(trajectory: Trajectory, interrupt: Interrupt) -> int:
    if interrupt.signal is not None:
        return 128 + interrupt.signal
    return 0 if trajectory.outcome.complete else 3


class _Timed:
    """Hands rows on, and keeps the time that takes; a full disk ends the writing."""

    def __init__(self, consumers: Sequence[Any]) -> None:
        self.consumers = consumers
        self.seconds = 0.0
        self.fault: OSError | None = None

    def add(self, rows: Floats) -> None:
        began = time.perf_counter()
        for consumer in self.consumers:
            if self.fault is None:
                try:
                    consumer.add(rows)
                except OSError as error:
                    if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                        raise
                    self.fault = error
        self.seconds += time.perf_counter() - began


def _progress(*, quiet: bool) -> Any:
    """Give a context whose value is called with the fraction done."""
    import contextlib

    @contextlib.contextmanager
    def bar() -> Iterator[Callable[[float], None] | None]:
        if quiet or not sys.stderr.isatty():
            yield None
            return
        began = time.perf_counter()
        shown: list[Any] = []

        def update(fraction: float) -> None:
            if not shown and time.perf_counter() - began > PATIENCE_SECONDS:
                shown.append(typer.progressbar(length=1000, file=sys.stderr))
                shown[0].__enter__()
            if shown:
                shown[0].update(int(1000 * fraction) - shown[0].pos)

        try:
            yield update
        finally:
            if shown:
                shown[0].__exit__(None, None, None)

    return bar()
