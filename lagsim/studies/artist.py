"""Pictures drawn by a second process, which loads matplotlib while the run is made.

It is a fork of the first, so it has the model; the rows come as declared arrays, and
pictures come back one by one. What does not come back is drawn by the first.
"""

from __future__ import annotations

import contextlib
import gc
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from lagsim.native.link import ahead
from lagsim.notes import Caution
from lagsim.outputs.letters import Letters, letters_of
from lagsim.studies.declared import decoded, encoded

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from lagsim.model.model import Model
    from lagsim.outputs.attempted import Made

    Draw: TypeAlias = "Callable[[Order], Iterator[Made]]"

_CLASSES = (
    "lagsim.run.observers.thinning:Thinning",
    "lagsim.run.observers.thinning:_Envelope",
    "lagsim.run.observers.thinning:_Sample",
)


class Order(NamedTuple):
    """What is to be drawn, and of which model.

    `fields` are those of a `Record`, a class that needs matplotlib; `is_sum`: the
    energy is T + V.
    """

    fields: Mapping[str, Any]
    model: Model
    is_sum: bool


def drawn(order: Order) -> Iterator[Made]:
    """Draw in this process: give the file name and the content of each picture."""
    from lagsim.outputs.plots import pictures
    from lagsim.outputs.record import Record

    yield from pictures(Record(**order.fields), order.model, order.is_sum)


@contextlib.contextmanager
def artist(model: Model) -> Iterator[Draw]:
    """Get ready to draw pictures, in a process that runs nothing but a command."""
    helper = None
    if ahead.is_possible():
        helper = ahead.Helper(_ready, partial(_contents, model))

    def draw(order: Order) -> Iterator[Made]:
        brought = set()
        content = encoded([order.fields, order.is_sum], _CLASSES, _of_model)
        for picture in helper.give(content) if helper else ():
            name, _, file = picture.partition(b"\n")
            brought.add(name.decode())
            yield name.decode(), file
        if helper is None or not helper.done:
            _ready()
            yield from (x for x in drawn(order) if x[0] not in brought)

    try:
        yield draw
    finally:
        if helper is not None:
            helper.end()


def _ready() -> None:
    from lagsim.outputs import lean_matplotlib

    lean_matplotlib.load()
    import lagsim.outputs.plots  # noqa: F401


def _contents(model: Model, content: bytes) -> Iterator[bytes]:
    """Give the name and the content of each picture, up to one that is not drawn."""
    gc.freeze()  # what is loaded stays
    fields, is_sum = decoded(content, _CLASSES, lambda _: letters_of(model))
    with ahead.helped():
        for name, picture in drawn(Order(fields, model, is_sum)):
            if isinstance(picture, Caution):
                # The first draws it again, and tells of it.
                raise RuntimeError(picture.text)  # noqa: TRY004
            yield b"%b\n%b" % (name.encode(), picture)


def _of_model(x: object) -> str | None:
    """Name what the other process makes of the model."""
    return "letters" if isinstance(x, Letters) else None
