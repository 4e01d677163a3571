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
from lagsim.errors import InputError, Problem
from lagsim.outputs.attempted import attempted
from lagsim.outputs.manifest import head
from lagsim.outputs.results import put
from lagsim.outputs.table import table_of
from lagsim.run.interrupt import Interrupt
from lagsim.studies.sweep.grid import COMPLETE, ERROR, OUTCOME, REASON
from lagsim.studies.sweep.runs import Found, Piece, Row, made, rows_of, runs_of
from lagsim.studies.workers import Died, processes, spread
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from lagsim.outputs.attempted import Made
    from lagsim.studies.workers import Hired

JOURNAL = "sweep.rows.jsonl"
# How often the system is asked to put rows on the disk itself: what it takes then is a
# part of nothing.
SYNC_SECONDS = 1.0


class Journal:
    """The rows of a sweep that is not complete, in a file that grows.

    Parameters
    ----------
    what
        What is swept and how; equal for the same rows.
    """

    def __init__(self, path: Path, what: Mapping[str, Any]) -> None:
        self.path = path
        self._what = json.loads(json.dumps(what))
        self._file: int | None = None
        self._synced = time.monotonic()

    def resumed(self) -> dict[int, Row]:
        """Give the rows that are there, and go on after them.

        Raises
        ------
        InputError
            Where they are rows of another sweep.
        """
        try:
            content = files.content(self.path)
        except FileNotFoundError:
            self.begin()
            return {}
        lines = content[: content.rfind(b"\n") + 1].splitlines()
        if not lines:
            self.begin()
            return {}
        self._compare(lines[0])
        self._replace(b"".join(line + b"\n" for line in lines))
        return dict(map(_row, lines[1:]))

    def begin(self) -> None:
        """Begin again."""
        self._replace(b"")
        self._write([self._what])

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
        put(self.path, content)
        self._file = files.held(self.path, os.O_RDWR | os.O_APPEND)

    def _write(self, lines: Iterable[Any]) -> None:
        assert self._file is not None
        text = "".join(json.dumps(line) + "\n" for line in lines).encode()
        view = memoryview(text)
        while view:
            view = view[os.write(self._file, view) :]
        if time.monotonic() - self._synced > SYNC_SECONDS:
            os.fsync(self._file)
            self._synced = time.monotonic()

    def _compare(self, line: bytes) -> None:
        """Refuse rows of another sweep."""
        try:
            there = dict(json.loads(line))
        except (ValueError, TypeError):
            there = {}
        other = [key for key, x in self._what.items() if there.get(key) != x]
        if other:
            text = f"{self.path} cannot be resumed: it has another {other[0]}"
            hint = "leave --resume out to start again, or choose another folder with -o"
            raise InputError([Problem("another-sweep", text, hint=hint)])


def _row(line: bytes) -> tuple[int, Row]:
    number, values, outcome, complete, error, reason, numbers, form = json.loads(line)
    cells = np.array(numbers, dtype=float)
    return number, Row(tuple(values), outcome, complete, error, reason, cells, form)


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
    alone = most == 1 and hired is processes
    for rows in _made(found, 0 if alone else most, wanted, hired, interrupt):
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
    missing, work = found.missing, found.work
    # What this process works, whatever others do beside it.
    done, began, lasted = 0, time.process_time(), 0.0
    for rows in made(Piece(work, tuple(missing)), interrupt):
        yield rows
        done += len(rows)
        lasted = max(time.process_time() - began, SHORTEST_SECONDS)
        to_come = (len(missing) - done) * lasted / done
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
    work = found.work
    parts = [tuple(numbers[k : k + size]) for k in range(0, len(numbers), size)]
    pieces = [Piece(work, part) for part in parts]
    lost: list[int] = []
    for k, rows in spread(rows_of, pieces, most, interrupt, hired):
        if isinstance(rows, Died):
            lost += parts[k]
        else:
            yield rows
    if size > 1 and lost:
        yield from _shared(found, lost, 1, most, hired, interrupt)
    else:
        values = {number: tuple(found.grid.values(number)) for number in lost}
        yield [(k, Row(own, DIED, reason=Died.reason)) for k, own in values.items()]


TABLE = "sweep.csv"
CHART = "sweep.png"
MANIFEST = "sweep.json"
# What is reported of each column, in this order.
TOLD = ("end", "min", "max")


def header(found: Found) -> list[str]:
    """Give the columns of sweep.csv."""
    names = [axis.name for axis in found.grid.axes]
    told = [f"{column}.{x}" for column in found.columns[1:] for x in _told(found)]
    return [*names, OUTCOME, COMPLETE, ERROR, f"{found.columns[0]}.end", *told, REASON]


def _told(found: Found) -> tuple[str, ...]:
    return TOLD[:1] if found.work.ends else TOLD


def cells(found: Found, row: Row) -> Iterator[object]:
    """Give a row of sweep.csv; None is what there is not."""
    yield from (*row.values, row.outcome, row.complete, row.error)
    numbers = row.numbers.T.tolist()
    if not numbers:
        yield from [None] * (1 + len(_told(found)) * (len(found.columns) - 1))
    else:
        yield numbers[0][0]
        for column in numbers[1:]:
            yield from column
    yield row.reason


def table(found: Found) -> bytes:
    """Give the content of sweep.csv: a row for each run, in the order of the grid."""
    rows = (cells(found, found.rows[k]) for k in sorted(found.rows))
    return table_of(header(found), rows)


def identity(found: Found) -> dict[str, Any]:
    """Give what decides on the rows: equal for equal ones."""
    model, work = found.model, found.work
    return {
        "lagsim": __version__,
        "model": {"name": model.name, "sha256": model.sha256},
        "parameters": {p.name: p.value for p in model.parameters},
        "grid": [[axis.name, list(axis.texts)] for axis in work.grid.axes],
        "options": dict(work.options) | {"error_bar": work.error_bars.value},
        "kept": [work.kept is not None, work.plots],
        **({"ends": True} if work.ends else {}),
    }


def mark(found: Found) -> str:
    """Give a word for the same."""
    return hashlib.sha256(json.dumps(identity(found)).encode()).hexdigest()


def document(found: Found, files: Sequence[str]) -> dict[str, Any]:
    """Give the content of sweep.json; keys are only ever added."""
    rows = found.rows.values()
    columns = {name: found.units.get(name, "") for name in found.columns}
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
            }
            for axis in found.grid.axes
        ],
        "runs": found.grid.runs,
        "complete": sum(row.complete for row in rows),
        "outcomes": dict(Counter(row.outcome for row in rows)),
        "compiled": _forms(found),
        "notes": notes(found),
        "columns": columns,
        "timings": {"runs": round(found.seconds, 6)},
        "files": list(files),
    }


def made_of(found: Found, *, plots: bool) -> Iterator[Made]:
    """Give name and content of what stands beside sweep.json."""
    yield TABLE, table(found)
    if plots:
        from lagsim.studies.sweep.chart import chart

        yield CHART, attempted(CHART, partial(chart, found))


def notes(found: Found) -> list[str]:
    """Say what there is to know."""
    forms = _forms(found)
    if forms < 2:
        return []
    text = f"the swept values change the equations: {forms} forms were "
    return [text + "compiled, which takes longer than one"]


def _forms(found: Found) -> int:
    return len({row.form for row in found.rows.values() if row.numbers.size})
