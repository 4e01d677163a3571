"""What stands beside the table of a run: events, a page of the motion, pictures."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from lagsim.notes import Caution
from lagsim.outputs.attempted import attempted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.outputs.attempted import Made
    from lagsim.run.observers.frames import Frames
    from lagsim.run.observers.thinning import Thinning
    from lagsim.studies.artist import Draw, Order
    from lagsim.studies.attempts import Attempt


def events(made: Attempt) -> Iterator[Made]:
    """Give name and content of the table of events, of a model that has one."""
    if made.session.lists_events:
        from lagsim.outputs import events

        yield events.NAME, events.table(made.trajectory.events)


def drawings(
    made: Attempt,
    rows: Thinning | None,
    frames: Frames | None = None,
    form: str = "png",
    draw: Draw | None = None,
) -> Iterator[Made]:
    """Give name and content of a page, of `frames`, and of pictures, of `rows`.

    Pictures have the format `form`. What is None is not made. `draw` draws them, by
    default in this process.
    """
    if frames is not None:
        from lagsim.outputs.animation import NAME

        shown = attempted(NAME, partial(_page, made, frames))
        if shown is not None:
            yield NAME, shown
    if rows is None:
        return
    from lagsim.studies.artist import drawn

    order = attempted("pictures", partial(_order, made, rows, form))
    if isinstance(order, Caution):
        yield "pictures", order
    else:
        yield from (draw or drawn)(order)


def beside(
    made: Attempt, rows: Thinning | None, frames: Frames | None = None
) -> Iterator[Made]:
    """Give name and content of all that stands beside the table of a run."""
    yield from events(made)
    yield from drawings(made, rows, frames)


def _order(made: Attempt, rows: Thinning, form: str) -> Order:
    """Give what is to be drawn."""
    from lagsim.outputs.events import marked, unmarked
    from lagsim.outputs.letters import letters_of
    from lagsim.outputs.units import units
    from lagsim.studies.artist import Order

    equations, trajectory = made.session.case.equations, made.trajectory
    if made.corners is not None:
        rows.meet(made.corners.rows())
    model = equations.model
    happened = marked(trajectory.events) if model.output.event_marks else {}
    note = unmarked(trajectory) if happened else ""
    if not trajectory.outcome.complete:
        note = f"incomplete: {trajectory.reason}"
    fields = {
        "title": model.name, "rows": rows, "note": note, "form": form,
        "units": units(equations, made.session.system.columns.of_table),
        "horizon": _horizon(made), "letters": letters_of(model), "events": happened,
    }  # fmt: skip
    return Order(fields, model, equations.energy_is_sum)


def _page(made: Attempt, frames: Frames) -> bytes | None:
    """Give the page that plays the motion, if there is something to play."""
    from lagsim.outputs.animation import film, page, record
    from lagsim.outputs.units import units

    equations, trajectory = made.session.case.equations, made.trajectory
    complete = trajectory.outcome.complete
    shown = film(
        equations, frames, trajectory.events, horizon=_horizon(made),
        units=units(equations, made.session.system.columns.of_table),
        notes=[] if complete else [f"incomplete: {trajectory.reason}"],
    )  # fmt: skip
    return None if shown is None else page([record(shown)], shown.name)


def _horizon(made: Attempt) -> float:
    """Give where a forecast ends."""
    horizon = None if isinstance(made.bar, str) else made.bar.horizon
    return math.inf if horizon is None else horizon
