"""A sweep: its runs made by this process, by others beside it, or by other machines.

On their way rows stand in a file, whatever happens then: a line of JSON for each, after
one that says what is swept. A line that was cut off is not one; the row is made again.
In the end there are sweep.csv and sweep.json.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import time
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim import files
from lagsim.errors import unusable
from lagsim.outputs import Made, attempted
from lagsim.outputs.manifest import head
from lagsim.outputs.results import put
from lagsim.outputs.table import table_of
from lagsim.run.interrupt import Interrupt
from lagsim.studies.sweep.runs import (
    COMPLETE,
    ERROR,
    OUTCOME,
    REASON,
    Found,
    Row,
    made,
    rows_of,
    runs_of,
)
from lagsim.studies.workers import Died, Hired, processes, spread
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path


TABLE, CHART, MANIFEST = "sweep.csv", "sweep.png", "sweep.json"
JOURNAL = "sweep.rows.jsonl"
# How often the system is asked to put rows on the disk itself: what it takes then is a
# part of nothing.
SYNC_SECONDS = 1.0
# This process begins alone: for so long, to learn how long a run takes, and to compile
# what the others then find.
ALONE_SECONDS = 0.5
# Others are worth beginning where so much is left to do.
WORTH_SECONDS = 5.0
# A piece takes about so long; each process gets some.
PIECE_SECONDS = 0.5
PIECES = 4
# A clock may stand still for so long.
SHORTEST_SECONDS = 1e-6
DIED = "died"


class Journal:
    """The rows of a sweep that is not complete, in a file that grows."""

    def __init__(self, path: Path, found: Found) -> None:
        self.path = path
        self._identity = json.loads(json.dumps(identity(found)))
        self._file: int | None = None
        self._synced = time.monotonic()

    def resume(self) -> dict[int, Row]:
        """Return the rows that are there, and go on after them.

        Raises
        ------
        InputError
            Where they are rows of another sweep.
        """
        content = b""
        with contextlib.suppress(FileNotFoundError):
            content = files.content(self.path)
        content = content[: content.rfind(b"\n") + 1]
        if not content:
            self.begin()
            return {}
        first, *lines = content.splitlines()
        there: Any = {}
        with contextlib.suppress(ValueError, TypeError):
            there = dict(json.loads(first))
        other = [key for key, x in self._identity.items() if there.get(key) != x]
        if other:
            text = f"{self.path} cannot be resumed: it has another {other[0]}"
            hint = "leave --resume out to start again, or choose another folder with -o"
            raise unusable("another-sweep", text, hint=hint)
        self._replace(content)
        rows = {}
        for number, values, *known, numbers, form in map(json.loads, lines):
            cells = np.array(numbers, dtype=float)
            rows[number] = Row._make((tuple(values), *known, cells, form))
        return rows

    def begin(self) -> None:
        """Begin again."""
        self._replace(b"")
        self._write([self._identity])

    def add(self, rows: Iterable[tuple[int, Row]]) -> None:
        """Keep rows, by their numbers."""
        self._write(
            [[k, *row._replace(numbers=row.numbers.tolist())] for k, row in rows]
        )

    def close(self) -> None:
        """Leave it as it is."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def remove(self) -> None:
        """Remove it: the rows stand elsewhere now."""
        self.close()
        with contextlib.suppress(OSError):
            self.path.unlink()

    def _replace(self, content: bytes) -> None:
        """Put a file of this content in the place of the one that there is.

        That one is not written to: it may have another name elsewhere.
        """
        self.close()
        put(self.path, content, held=True)
        self._file = files.held(self.path, os.O_RDWR | os.O_APPEND)

    def _write(self, lines: Iterable[Any]) -> None:
        assert self._file is not None
        view = memoryview("".join(json.dumps(x) + "\n" for x in lines).encode())
        while view:
            view = view[os.write(self._file, view) :]
        if time.monotonic() - self._synced > SYNC_SECONDS:
            os.fsync(self._file)
            self._synced = time.monotonic()


def sweep(
    found: Found,
    most: int,
    *,
    wanted: bool,
    hired: Hired = processes,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
    journal: Journal | None = None,
) -> None:
    """Make the runs that are missing; fewer where an end is asked for.

    Parameters
    ----------
    most
        So many at a time.
    wanted
        So many in any case; else where it is worth it.
    hired
        Gives who makes them, such as `workers.processes`.
    """
    began = time.perf_counter()
    own = runs_of(found.work)
    found.columns = own.columns
    interrupt = interrupt or Interrupt()
    wanted |= hired is not processes
    others = 0 if most == 1 and hired is processes else most
    for rows in _made(found, others, wanted, hired, interrupt):
        found.rows.update(rows)
        if journal is not None:
            journal.add(rows)
        if progress is not None:
            progress(len(found.rows) / found.grid.runs)
    found.units = own.units()
    found.seconds = time.perf_counter() - began


def _made(
    found: Found, others: int, wanted: bool, hired: Hired, interrupt: Interrupt
) -> Iterator[Sequence[tuple[int, Row]]]:
    """Give rows as they are made: the first ones, or all, by this process."""
    missing = found.missing
    # What this process works, whatever others do beside it.
    done, began, lasted = 0, time.process_time(), 0.0
    for rows in made(found.work, missing, interrupt):
        yield rows
        done += len(rows)
        lasted = max(time.process_time() - began, SHORTEST_SECONDS)
        to_come = (len(missing) - done) * lasted / max(1, done)
        worth = lasted > ALONE_SECONDS and to_come > WORTH_SECONDS
        if others and (worth or wanted):
            break
    left = missing[done:]
    if left and not interrupt.asked:
        size = min(PIECE_SECONDS * done / lasted, len(left) / (PIECES * others))
        yield from _shared(found, left, max(1, int(size)), others, hired, interrupt)


def _shared(
    found: Found,
    numbers: list[int],
    size: int,
    most: int,
    hired: Hired,
    interrupt: Interrupt,
) -> Iterator[Sequence[tuple[int, Row]]]:
    """Give rows that others make, in pieces of a size."""
    parts = [tuple(numbers[k : k + size]) for k in range(0, len(numbers), size)]
    lost: list[int] = []
    work = partial(rows_of, found.work)
    for k, rows in spread(work, parts, most, interrupt, hired):
        if isinstance(rows, Died):
            lost += parts[k]
        else:
            yield rows
    if size > 1 and lost:
        yield from _shared(found, lost, 1, most, hired, interrupt)
    else:
        why = Died.reason
        yield [(k, Row(found.grid.values(k), DIED, reason=why)) for k in lost]


def header(found: Found) -> list[str]:
    """Return the columns of sweep.csv: of the time its end alone."""
    time, *columns = found.columns
    names = [axis.name for axis in found.grid.axes]
    parts = ("end",) if found.work.ends else ("end", "min", "max")
    reported = [f"{column}.{part}" for column in columns for part in parts]
    return [*names, OUTCOME, COMPLETE, ERROR, f"{time}.end", *reported, REASON]


def cells(found: Found) -> Iterator[list[object]]:
    """Return the rows of sweep.csv in the order of the grid; None where nothing is."""
    nothing = [None] * (len(header(found)) - len(found.grid.axes) - 4)
    for _, row in sorted(found.rows.items()):
        numbers: list[Any] = nothing
        if row.numbers.size:
            time, *columns = row.numbers.T.tolist()
            numbers = [time[0], *(x for column in columns for x in column)]
        known = row.outcome, row.complete, row.error
        yield [*row.values, *known, *numbers, row.reason]


def table(found: Found) -> bytes:
    """Return the content of sweep.csv."""
    return table_of(header(found), cells(found))


def identity(found: Found) -> dict[str, Any]:
    """Give what decides on the rows: equal for equal ones."""
    model, work = found.model, found.work
    return {
        "lagsim": __version__,
        "model": {"name": model.name, "sha256": model.content},
        "parameters": model.parameter_values,
        "grid": [[axis.name, list(axis.texts)] for axis in work.grid.axes],
        "options": dict(work.options) | {"error_bar": work.error_bars.value},
        "kept": [work.kept is not None, work.plots],
        **({"ends": True} if work.ends else {}),
        **({"together": True} if work.grid.together else {}),
    }


def mark(found: Found) -> str:
    """Give a word for the same."""
    return hashlib.sha256(json.dumps(identity(found)).encode()).hexdigest()


def document(found: Found) -> dict[str, Any]:
    """Give the content of sweep.json, but for its files; keys are only ever added."""
    rows = found.rows.values()
    forms = len({row.form for row in rows if row.numbers.size})
    note = f"the swept values change the equations: {forms} forms were "
    note += "compiled, which takes longer than one"
    seed = found.grid.seed
    return {
        **head(found.model),
        "identity": mark(found),
        "options": identity(found)["options"],
        "grid": [
            {
                "name": axis.name,
                "of": "initial" if axis.starts else "parameters",
                "unit": axis.unit,
                "expressions": list(axis.texts),
                "values": list(axis.values),
                **({"drawn": axis.drawn} if axis.drawn else {}),
            }
            for axis in found.grid.axes
        ],
        **({"points": True} if found.grid.together else {}),
        **({} if seed is None else {"seed": seed}),
        "runs": found.grid.runs,
        "complete": sum(row.complete for row in rows),
        "outcomes": dict(Counter(row.outcome for row in rows)),
        "compiled": forms,
        "notes": [note] if forms > 1 else [],
        "columns": {name: found.units.get(name, "") for name in found.columns},
        "timings": {"runs": round(found.seconds, 6)},
    }


def drawn(found: Found) -> bytes:
    """Draw sweep.png."""
    from lagsim.studies.sweep.chart import chart

    return chart(found)


def made_of(found: Found, *, plots: bool) -> Iterator[Made]:
    """Give name and content of what stands beside sweep.json."""
    yield TABLE, table(found)
    if plots:
        yield CHART, attempted(CHART, partial(drawn, found))
