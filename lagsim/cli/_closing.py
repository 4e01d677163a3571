"""What a person reads during a run and after it."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from typing import TYPE_CHECKING, Any

import typer

from lagsim.cli._shared import coloured, counted, table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from lagsim.notes import Event
    from lagsim.run.error import ErrorBar
    from lagsim.run.trajectory import Trajectory
    from lagsim.studies.attempts import Attempt

# Kinds of events that are counted, in this order.
COUNTED = ("impact", "contact", "release", "stick", "slip", "switch")
# More names of constraints than this are reported by their number.
MOST_NAMES = 2
# Runs that last longer than this show a progress bar on a terminal.
PATIENCE_SECONDS = 1.0


def summary(made: Attempt, document: Mapping[str, Any], folder: Path) -> str:
    """Give the closing lines of the run that `document`, its run.json, records."""
    from lagsim.mechanics.constraints import Kind

    colour = "32" if document["complete"] else "31"
    head = (
        f"{coloured(document['outcome'], colour)}: {document['model']['name']}, "
        f"t = {document['start']:g} to {document['end']:.9g}, "
        f"{counted(document['rows'], 'row')}"
    )
    equations = made.session.case.equations
    held = len(equations.model.constraints)
    contacts = sum(law.kind is Kind.CONTACT for law in equations.laws)
    parts = [counted(len(equations.q), "coordinate")]
    parts += [counted(held - contacts, "constraint")] if held > contacts else []
    parts += [counted(contacts, "contact")] if contacts else []
    rows = [("system", ", ".join(parts))]
    plan = [f"{c['choice']} ({c['reason']})" for c in document["plan"]]
    rows += [("" if k else "plan", text) for k, text in enumerate(plan)]
    rows.append(_accuracy(document))
    if document["outcome"] == "until":
        rows.append(("ended", document["reason"]))
    if made.session.lists_events:
        happened = _happened(made.trajectory)
        rows += [("" if k else "events", text) for k, text in enumerate(happened)]
    rows.append(("work done", _work(document)))
    unit = document["columns"]["energy"]
    drift = document["energy_drift"]
    drift = f"{drift:.2g} {unit}".rstrip() if math.isfinite(drift) else "not known"
    kept = "energy - work" if "work" in document["columns"] else "energy"
    energy = f"{made.monitors.residuals.first_energy:.7g} {unit}".rstrip()
    start = f"(energy {energy} at the start)"
    rows.append(("error", _error(made.bar)))
    rows.append(("energy drift", f"{drift} in {kept} {start}"))
    if held:
        residual = document["constraint_residual"]
        rows.append(("residual", f"largest {residual:.2g} of its scale"))
    rows.append(("files", f"{folder}: {', '.join(document['files'])}"))
    return head + "\n" + table(rows)


def _happened(trajectory: Trajectory) -> list[str]:
    """Report what happened to constraints that hold at times, and to switches."""
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
    """Give the constraints and switches of events, or their number where many."""
    held = dict.fromkeys(f"`{e.constraint}`" for e in events if e.constraint)
    switches = dict.fromkeys(f"`{e.switch}`" for e in events if e.switch)
    if len(held) + len(switches) <= MOST_NAMES:
        return ", ".join((*held, *switches))
    numbers = ((len(held), "constraint"), (len(switches), "switch"))
    return ", ".join(counted(number, noun) for number, noun in numbers if number)


def _accuracy(document: Mapping[str, Any]) -> tuple[str, str]:
    if document["step"] is not None:
        return "step", f"{document['step']:g}"
    atol = document["atol"]
    floor = "of each component's own scale" if atol is None else f"and atol {atol:g}"
    return "tolerance", f"rtol {document['rtol']:g} {floor}"


def _error(bar: ErrorBar | str) -> str:
    """Give the estimate: the worst coordinate, how it grew, the horizon."""
    if isinstance(bar, str):
        return f"not estimated: {bar}"
    name, worst = max(bar.coordinates.items(), key=lambda item: item[1].relative)
    by = bar.method if bar.rtol is None else f"{bar.method} at rtol {bar.rtol:.2g}"
    if bar.rests:
        apart = max(error.largest for error in bar.coordinates.values())
        text = "nothing moves; a repeat by " + by
        return f"{text} agrees to {apart:.1g}" if apart else f"{text} agrees"
    t, reached = bar.growth[(len(bar.growth) - 1) // 2]
    text = (
        f"about {worst.relative:.1g} of the range of {name} ({reached:.1g} by "
        f"t = {t:.4g}), from a repeat by {by}"
    )
    if bar.horizon is not None:
        text += f"; no forecast past t = {bar.horizon:.4g}"
    return text


def _work(document: Mapping[str, Any]) -> str:
    seconds = document["timings"]
    return (
        f"{counted(document['steps'], 'step')}, {document['rejections']} rejected, "
        f"{counted(document['evaluations'], 'evaluation')}; integrated in "
        f"{_duration(seconds['integrate'])}, {_duration(sum(seconds.values()))} in all"
    )


def _duration(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds >= 1 else f"{seconds * 1e3:.3g} ms"


@contextlib.contextmanager
def progress_bar(
    label: str, *, quiet: bool
) -> Iterator[Callable[[float], None] | None]:
    """Give what is to be called with the fraction done; None without a terminal.

    It ends where it stands: at 100 % if that was called with 1.
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
