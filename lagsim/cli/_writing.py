"""The table of a run while it is written, and what is said where the disk is full."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.outputs.results import Results
    from lagsim.outputs.table import TableWriter
    from lagsim.run.interrupt import Interrupt


def open_table(
    results: Results, columns: Sequence[str]
) -> contextlib.closing[TableWriter]:
    """Open the table for its rows."""
    from lagsim.outputs import table

    try:
        return contextlib.closing(table.TableWriter(results.part(table.NAME), columns))
    except OSError as error:
        raise results.unusable(error) from None


def cut_short(output: Output, full: OSError, start: float) -> dict[str, Any]:
    """Give what run.json says of a run whose results did not fit on the disk."""
    found: dict[str, Any] = {"outcome": "failed", "complete": False}
    if output.fault is None:
        found["reason"] = (
            f"a picture could not be written: {full.strerror}; the table is whole"
        )
        return found
    end = start if output.writer.last is None else output.writer.last
    found["reason"] = (
        f"the table could not be written beyond t = {end!r}: {full.strerror}; the rows "
        "up to there were kept"
    )
    return found | {"end": end, "rows": output.writer.rows}


class Output:
    """Hands rows on, and keeps the time that takes; a full disk ends the run."""

    def __init__(
        self,
        consumers: Sequence[Any],
        writer: TableWriter,
        interrupt: Interrupt,
    ) -> None:
        self.consumers = consumers
        self.writer = writer
        self.interrupt = interrupt
        self.seconds = 0.0
        self.fault: OSError | None = None

    def add(self, rows: Floats) -> None:
        """Take rows; all consumers get those that the disk could hold."""
        if self.fault is not None:
            return
        began = time.perf_counter()
        before = self.writer.rows
        try:
            self.writer.add(rows)
        except OSError as error:
            self.fault = error
            self.interrupt.stop()
        kept = rows[: self.writer.rows - before]
        if len(kept):
            for consumer in self.consumers:
                consumer.add(kept)
        self.seconds += time.perf_counter() - began
