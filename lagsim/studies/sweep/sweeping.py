"""A sweep: its runs made by this process, by others beside it, or by other machines."""

from __future__ import annotations

import pickle
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from lagsim.run.interrupt import Interrupt
from lagsim.studies.sweep.runs import NOTHING, Piece, Row, made, rows_of, runs_of
from lagsim.studies.workers import Died, processes, spread

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.model.model import Model
    from lagsim.studies.sweep.grid import Grid
    from lagsim.studies.sweep.journal import Journal
    from lagsim.studies.sweep.runs import Work
    from lagsim.studies.workers import Hired

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
DIED_TEXT = "its process ended before it had a result: was it killed, or out of memory?"


@dataclass(slots=True)
class Found:
    """A sweep, and what is known of it so far.

    Attributes
    ----------
    rows : dict of int to Row
        By the number of the run.
    columns : tuple of str
        Of the runs' tables.
    units : dict of str to str
        Of the columns, where something was run.
    seconds : float
        What it took this time.
    """

    model: Model
    work: Work
    rows: dict[int, Row] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def grid(self) -> Grid:
        """What is swept."""
        return self.work.grid

    @property
    def missing(self) -> list[int]:
        """The numbers of the runs that are still to be made."""
        return [k for k in range(self.grid.runs) if k not in self.rows]


def packed(model: Model) -> bytes:
    """Give a model as it goes to other processes."""
    return pickle.dumps(model)


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
        yield [(number, _died(found.grid, number)) for number in lost]


def _died(grid: Grid, number: int) -> Row:
    values = tuple(grid.values(number))
    return Row(values, DIED, False, None, DIED_TEXT, NOTHING, 0)
