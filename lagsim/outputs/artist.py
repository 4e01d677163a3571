"""Who draws the pictures of a run: this process, or one that gets ready meanwhile.

To load matplotlib takes as long as all else that a warm run does. On a second core it
is loaded while the run is made; what is to be drawn is handed over then, and pictures
come back one by one. What does not come back is drawn here.
"""

from __future__ import annotations

import contextlib
import io
import pickle
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from lagsim.native.link import ahead

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from lagsim.model.model import Model
    from lagsim.outputs.attempted import Made

    Draw: TypeAlias = "Callable[[Order], Iterator[Made]]"


class Order(NamedTuple):
    """What is to be drawn: the fields of a `Record`, and whose run it was."""

    fields: Mapping[str, Any]
    model: Model
    energy_is_sum: bool


def drawn(order: Order) -> Iterator[Made]:
    """Draw in this process: give the file name and the content of each picture."""
    from lagsim.outputs.plots import pictures
    from lagsim.outputs.record import Record

    record = Record(**order.fields)
    yield from pictures(record, order.model, energy_is_sum=order.energy_is_sum)


@contextlib.contextmanager
def artist() -> Iterator[Draw]:
    """Get ready to draw pictures in pixels, in a process that is nobody else's."""
    helper = ahead.Helper(_ready, _drawn_for_another) if ahead.is_possible() else None

    def draw(order: Order) -> Iterator[Made]:
        brought = set()
        for content in helper.give(_bytes(order)) if helper else ():
            name, picture = pickle.loads(content)
            brought.add(name)
            yield name, picture
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


def _drawn_for_another(content: bytes) -> Iterator[bytes]:
    order: Order = _Reader(io.BytesIO(content)).load()
    with ahead.helped():
        for picture in drawn(order):
            yield pickle.dumps(picture)


def _bytes(order: Order) -> bytes:
    content = io.BytesIO()
    _Writer(content, order.model).dump(order)
    return content.getvalue()


class _Writer(pickle.Pickler):
    """Leaves out what is large and never drawn: the graph, and what the file says."""

    def __init__(self, file: io.BytesIO, model: Model) -> None:
        super().__init__(file, protocol=5)
        self._left_out = model.graph, model.stated

    def persistent_id(self, what: object) -> str | None:
        """Tell it from all else."""
        left_out = any(what is x for x in self._left_out)
        return "left out" if left_out and what is not None else None


class _Reader(pickle.Unpickler):
    def persistent_load(self, _: object) -> None:
        """Give nothing for what was left out."""
