"""Files of a run other than its table: events, a page of the motion, pictures.

A second process can draw the pictures. It loads matplotlib while the run is under way.
It is a fork of the first process, so it has the model; rows are sent to it pickled, and
pictures are returned one by one. The first process draws every picture that the second
did not return.
"""

from __future__ import annotations

import contextlib
import gc
import math
import pickle
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from lagsim.native.link import ahead
from lagsim.notes import Caution
from lagsim.outputs import Made, attempted
from lagsim.outputs.table import EVENTS, events_table
from lagsim.run.event_store import EventStore

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lagsim.model.model import Model
    from lagsim.outputs.plot_data import PlotData
    from lagsim.run.observers.thinning import Frames, Thinning
    from lagsim.studies.attempts import Attempt

    Draw: TypeAlias = "Callable[[PlotData, Model], Iterator[Made]]"


def event_tables(attempt: Attempt) -> Iterator[Made]:
    """Yield name and content of the tables of events and sections of a run.

    A table of events that was written during the run is left out.
    """
    events = attempt.trajectory.listed
    if attempt.session.lists_events and isinstance(events, EventStore):
        named = bool(attempt.session.case.model.events)
        yield EVENTS, events_table(events, named=named)
    if attempt.sections:
        from lagsim.outputs.sections import RecordedSections, tables

        yield from tables(
            RecordedSections(attempt.session.columns.of_table, attempt.sections)
        )


def drawings(
    attempt: Attempt, form: str = "png", draw: Draw | None = None
) -> Iterator[Made]:
    """Yield name and content of the page and the pictures of the run `attempt`.

    Parameters
    ----------
    form : str
        The file format of pictures, as its extension.
    draw : callable, optional
        Draws the pictures; by default this process does.
    """
    if attempt.frames is not None:
        from lagsim.outputs.animation import NAME

        shown = attempted(NAME, partial(_page, attempt, attempt.frames))
        if shown is not None:
            yield NAME, shown
    if attempt.thin is None:
        return
    model = attempt.session.case.model
    data = attempted("pictures", partial(_plot_data, attempt, attempt.thin, form))
    if isinstance(data, Caution):
        yield "pictures", data
    else:
        yield from (draw or drawn_here)(data, model)
    if attempt.extremes is not None:
        from lagsim.outputs.sections import RecordedSections, pictures

        found = RecordedSections(attempt.session.columns.of_table, attempt.sections)
        ranges = attempt.extremes.stacked[1:]
        yield from pictures(attempt.session.equations, found, ranges, form)


def other_files(attempt: Attempt) -> Iterator[Made]:
    """Yield name and content of all files of a run other than its table."""
    yield from event_tables(attempt)
    yield from drawings(attempt)


def _plot_data(attempt: Attempt, rows: Thinning, form: str) -> PlotData:
    """Return the data that all pictures of a run share.

    rows : the thinned rows.
    form : the file format.
    """
    from lagsim.outputs.letters import letters_of
    from lagsim.outputs.plot_data import PlotData, marked
    from lagsim.outputs.units import units

    equations, trajectory = attempt.session.equations, attempt.trajectory
    if attempt.corners is not None:
        rows.meet(attempt.corners.rows())
    model = equations.model
    happened = marked(trajectory.events) if model.output.event_marks else {}
    listed, count = len(trajectory.events), sum(trajectory.event_counts.values())
    note = f"marks: the first {listed} of {count} events"
    note = note if happened and listed < count else ""
    if not trajectory.outcome.complete:
        note = f"incomplete: {trajectory.reason}"
    return PlotData(
        model.name, rows, units(equations, attempt.session.columns.of_table),
        happened, note, _horizon(attempt), letters_of(model), form,
        equations.energy_is_sum, attempt.appended,
    )  # fmt: skip


def _page(attempt: Attempt, frames: Frames) -> bytes | None:
    """Return the page that plays a motion; None if the model has nothing to draw.

    frames : the observer that has stored the frames of the run `attempt`.
    """
    from lagsim.outputs.animation import film, page, record
    from lagsim.outputs.units import units

    equations, trajectory = attempt.session.equations, attempt.trajectory
    complete = trajectory.outcome.complete
    shown = film(
        equations, frames, trajectory.events, horizon=_horizon(attempt),
        units=units(equations, attempt.session.columns.of_table),
        notes=[] if complete else [f"incomplete: {trajectory.reason}"],
    )  # fmt: skip
    return None if shown is None else page([record(shown)], shown.name)


def _horizon(attempt: Attempt) -> float:
    """Return the horizon of the run; inf if there is none."""
    horizon = None if isinstance(attempt.bar, str) else attempt.bar.horizon
    return math.inf if horizon is None else horizon


def drawn_here(data: PlotData, model: Model) -> Iterator[Made]:
    """Draw in this process, and yield the file name and the content of each picture."""
    from lagsim.outputs.plots import pictures

    yield from pictures(data, model)


@contextlib.contextmanager
def artist(model: Model) -> Iterator[Draw]:
    """Context manager: start a second process for drawing; return a draw function.

    It may be used only in a process whose single task is a command, since the second
    process is a fork.
    """
    helper = None
    if ahead.is_possible():
        helper = ahead.Helper(_ready, partial(_contents, model))

    def draw(data: PlotData, model: Model) -> Iterator[Made]:
        brought = set()
        for picture in helper.send(pickle.dumps(data)) if helper else ():
            name, _, file = picture.partition(b"\n")
            brought.add(name.decode())
            yield name.decode(), file
        if helper is None or not helper.done:
            _ready()
            yield from (x for x in drawn_here(data, model) if x[0] not in brought)

    try:
        yield draw
    finally:
        if helper is not None:
            helper.end()


def _ready() -> None:
    from lagsim.outputs import bare_matplotlib

    bare_matplotlib.without_docstrings()
    import lagsim.outputs.plots  # noqa: F401


def _contents(model: Model, content: bytes) -> Iterator[bytes]:
    """Yield each picture as bytes: name, line break, content; in the second process.

    content : the pickled data of the pictures.

    Raises
    ------
    RuntimeError
        If a picture cannot be drawn; the first process then draws it and reports why.
    """
    gc.freeze()  # loaded objects are never collected
    data: PlotData = pickle.loads(content)
    with ahead.second_processes():
        for name, picture in drawn_here(data, model):
            if isinstance(picture, Caution):
                # The calling process draws it again, and reports the failure.
                raise RuntimeError(picture.text)  # noqa: TRY004
            yield b"%b\n%b" % (name.encode(), picture)
