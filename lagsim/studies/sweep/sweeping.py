"""Sweep: runs made by this process, by further processes, or by other machines.

Rows of an incomplete sweep are stored in a file with a line of JSON for each row, after
a line that identifies the sweep. A truncated line is ignored, and its row computed
again. A complete sweep has sweep.csv and sweep.json.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
import time
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim import files
from lagsim.codes.known import ANOTHER_SWEEP, BAD_POINTS, USAGE
from lagsim.errors import InputError, Problem, Problems, unusable
from lagsim.model.reader.sheets import read_sheet
from lagsim.native.elementary import log
from lagsim.outputs import Made, attempted
from lagsim.outputs.manifest import head
from lagsim.outputs.results import write_atomically
from lagsim.outputs.table import table_of
from lagsim.run.interrupt import Interrupt
from lagsim.studies.sweep.grid import (
    COMPLETE,
    ERROR,
    OUTCOME,
    REASON,
    Axis,
    Grid,
    SweepRow,
    SweepRows,
    grid_of,
    refuse_many,
)
from lagsim.studies.sweep.runs import runs_of
from lagsim.studies.trial import DIED
from lagsim.studies.workers import Died, Workers, in_batches, processes
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model


TABLE, CHART, MANIFEST = "sweep.csv", "sweep.png", "sweep.json"
JOURNAL = "sweep.rows.jsonl"
# Interval between two calls that force rows to the disk, whose time is then negligible.
SYNC_SECONDS = 1.0


class Journal:
    """File of the rows of an incomplete sweep, to which rows are appended.

    Parameters
    ----------
    path : Path
        The file.
    found : SweepRows
        The sweep to which the rows belong.
    """

    def __init__(self, path: Path, found: SweepRows) -> None:
        self.path = path
        self._identity = json.loads(json.dumps(identity(found)))
        self._file: int | None = None
        self._synced = time.monotonic()

    def resume(self) -> dict[int, SweepRow]:
        """Return the stored rows by the index of the run; further rows are appended.

        Raises
        ------
        InputError
            If the rows belong to another sweep.
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
            raise unusable(ANOTHER_SWEEP, text)
        self._replace(content)
        rows = {}
        for number, values, *known, numbers, form in map(json.loads, lines):
            cells = np.array(numbers, dtype=float)
            rows[number] = SweepRow._make((tuple(values), *known, cells, form))
        return rows

    def begin(self) -> None:
        """Create the file without rows."""
        self._replace(b"")
        self._write([self._identity])

    def add(self, rows: Iterable[tuple[int, SweepRow]]) -> None:
        """Append rows with their indices."""
        self._write(
            [[k, *row._replace(numbers=row.numbers.tolist())] for k, row in rows]
        )

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def remove(self) -> None:
        """Remove the file, after the rows have been written to sweep.csv."""
        self.close()
        with contextlib.suppress(OSError):
            self.path.unlink()

    def _replace(self, content: bytes) -> None:
        """Replace the file by a new file with this content.

        The old file is not modified, since it may have another hard link.
        """
        self.close()
        write_atomically(self.path, content, locked=True)
        self._file = files.open_regular(self.path, os.O_RDWR | os.O_APPEND)

    def _write(self, lines: Iterable[Any]) -> None:
        assert self._file is not None
        view = memoryview("".join(json.dumps(x) + "\n" for x in lines).encode())
        while view:
            view = view[os.write(self._file, view) :]
        if time.monotonic() - self._synced > SYNC_SECONDS:
            os.fsync(self._file)
            self._synced = time.monotonic()


def sweep(
    found: SweepRows,
    most: int,
    *,
    requested: bool,
    workers: Workers = processes,
    interrupt: Interrupt | None = None,
    progress: Callable[[float], None] | None = None,
    journal: Journal | None = None,
) -> None:
    """Compute the missing rows of a sweep; fewer after an interrupt.

    Parameters
    ----------
    most : int
        The largest number of pieces at a time.
    requested : bool
        Whether this number was requested; else further processes start only if these
        save time.
    workers : callable
        Function that returns a context manager of a crew, such as `workers.processes`.
    journal : Journal, optional
        Stores the rows on the way.
    """
    began = time.perf_counter()
    own = runs_of(found.work)
    found.columns = own.columns
    interrupt = interrupt or Interrupt()
    requested |= workers is not processes
    for results in in_batches(
        own.rows,
        found.missing,
        most,
        interrupt,
        requested=requested,
        workers=workers,
    ):
        rows = [
            (k, SweepRow(found.grid.values(k), DIED, reason=x.reason))
            if isinstance(x, Died) else (k, x) for k, x in results
        ]  # fmt: skip
        found.rows.update(rows)
        if journal is not None:
            journal.add(rows)
        if progress is not None:
            progress(len(found.rows) / found.grid.runs)
    found.units = own.units()
    found.seconds = time.perf_counter() - began


def header(found: SweepRows) -> list[str]:
    """Return the columns of sweep.csv; the time has only its last value."""
    time, *columns = found.columns
    names = [axis.name for axis in found.grid.axes]
    reported = [f"{name}.{part}" for name in columns for part in found.work.parts]
    return [*names, OUTCOME, COMPLETE, ERROR, f"{time}.end", *reported, REASON]


def cells(found: SweepRows) -> Iterator[list[object]]:
    """Yield the rows of sweep.csv in the order of the grid; None in an empty cell."""
    nothing = [None] * (len(header(found)) - len(found.grid.axes) - 4)
    for _, row in sorted(found.rows.items()):
        numbers: list[Any] = nothing
        if row.numbers.size:
            time, *columns = row.numbers.T.tolist()
            numbers = [time[0], *(x for column in columns for x in column)]
        known = row.outcome, row.complete, row.error
        yield [*row.values, *known, *numbers, row.reason]


def table(found: SweepRows) -> bytes:
    """Return the content of sweep.csv."""
    return table_of(header(found), cells(found))


def identity(found: SweepRows) -> dict[str, Any]:
    """Return the data by which a sweep is recognised: all that determine its rows."""
    model, work = found.model, found.work
    return {
        "lagsim": __version__,
        "model": {"name": model.name, "sha256": model.content},
        "parameters": model.parameter_values,
        "grid": [[axis.name, list(axis.texts)] for axis in work.grid.axes],
        "options": dict(work.options) | {"error_bar": work.error_bars.value},
        "kept": [work.folder is not None, work.plots],
        **({"ends": True} if work.ends else {}),
        **({"together": True} if work.grid.together else {}),
    }


def digest_of(found: SweepRows) -> str:
    """Return the sha256 of `identity`, in hexadecimal."""
    return hashlib.sha256(json.dumps(identity(found)).encode()).hexdigest()


def document(found: SweepRows) -> dict[str, Any]:
    """Return the content of sweep.json without its list of files.

    Later versions of lagsim add keys and remove none.
    """
    rows = found.rows.values()
    forms = len({row.form for row in rows if row.numbers.size})
    note = f"the swept values change the equations: {forms} forms were "
    note += "compiled, which needs longer than one"
    seed = found.grid.seed
    return {
        **head(found.model),
        "identity": digest_of(found),
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


def draw_chart(found: SweepRows) -> bytes:
    """Draw sweep.png."""
    from lagsim.studies.sweep.chart import chart

    return chart(found)


def sweep_files(found: SweepRows, *, plots: bool) -> Iterator[Made]:
    """Yield name and content of each file of a sweep other than sweep.json.

    plots : whether sweep.png is among these.
    """
    yield TABLE, table(found)
    if plots:
        yield CHART, attempted(CHART, partial(draw_chart, found))


# --- Points of a sweep that are no grid: rows of a table, and random samples
#
# A sample is the same on every machine. The 53 bits of each draw come from Philox, a
# counter-based generator whose stream numpy promises not to change (J. K. Salmon et
# al., Parallel random numbers, 2011); its key is the seed and the position of the name,
# so that an added name does not change the draws of the names before it. A distribution
# is computed from the draws by sums, products and roots, which IEEE 754 rounds alike
# everywhere, and by a logarithm of lagsim's own.

EXAMPLE = "such as --sample K=normal(25.6, 0.5) --sample theta=uniform(0, 1) -N 500"
_DRAWN = re.compile(r"(normal|uniform)\s*\((.*),(.*)\)", re.DOTALL)


def of_file(model: Model, path: Path) -> Grid:
    """Read points from a CSV file with a column for each name and a row for each run.

    Raises
    ------
    InputError
        With the line of each fault.
    """
    try:
        text = files.content(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", "") or "it is no text in UTF-8"
        raise unusable(BAD_POINTS, f"{path}: {why}") from None
    sheet = read_sheet(text)
    names, rows = sheet.header, sheet.rows[1:]
    first = sheet.rows[0].number if sheet.rows else 1
    faults = []
    if len({*names}) < len(names) or not all(names):
        faults.append((first, "the header has an empty name, or one twice"))
    if not rows:
        faults.append((first, "no points: a header and a row for each run expected"))
    points = []
    for row in rows:
        if len(row.cells) != len(names):
            many = f"{len(row.cells)} values for {len(names)} names"
            faults.append((row.number, sheet.excess(row) or many))
            continue
        points.append([sheet.number(cell) for cell in row.cells])
        faults += [
            (row.number, f"`{cell.strip()}` of {name} is no finite number")
            for name, cell, x in zip(names, row.cells, points[-1], strict=True)
            if not math.isfinite(x)
        ]
    if faults:
        raise InputError(
            [Problem(BAD_POINTS, f"{path}:{line}: {text}") for line, text in faults]
        )
    refuse_many(len(rows))
    given = dict(zip(names, zip(*points, strict=True), strict=True))
    try:
        return grid_of(model, given, together=True)
    except InputError as error:
        where = f"{path}:{first}: "
        raise InputError(
            [x if x.place else x._replace(text=where + x.text) for x in error.problems]
        ) from None


def sampled(
    model: Model, given: Iterable[tuple[str, str]], runs: int, seed: int = 0
) -> Grid:
    """Draw `runs` values of each name from its distribution; return these as points.

    given : pairs of a name and a distribution.
    seed : the seed of the random numbers.

    Raises
    ------
    InputError
        If a name or a distribution cannot be used.
    """
    problems, values = Problems(), dict[str, list[float | str]]()
    distributions = {}
    refuse_many(runs)
    for place, (name, text) in enumerate(given):
        if name in values:
            problems.add(USAGE, f"{name} is given twice", hint=EXAMPLE)
        distributions[name] = text
        with problems.gathered():
            uniform = _uniform(seed, place, runs)
            values[name] = [*_distributed(model, name, text, uniform).tolist()]
    problems.refuse()
    grid = grid_of(model, values, together=True)
    axes = (axis._replace(drawn=distributions[axis.name]) for axis in grid.axes)
    return grid._replace(axes=tuple(axes), seed=seed)


def _uniform(seed: int, place: int, count: int) -> Floats:
    """Return uniform random numbers in the open interval (0, 1), shape (count,).

    The numbers depend on seed and axis alone, and are equal on every machine.

    place : index of the axis.
    """
    raw = np.random.Philox(key=seed + (place << 64)).random_raw(count)
    return np.asarray(((raw >> np.uint64(11)) + 0.5) * 2.0**-53)


def _distributed(model: Model, name: str, text: str, uniform: Floats) -> Floats:
    """Return values (count,) of a distribution, from uniform random numbers (count,).

    name : the swept name.
    text : the distribution, such as `normal(4, 0.1)`, whose numbers may be expressions.
    """
    found = _DRAWN.fullmatch(text)
    if found is None:
        wrong = f"{name}={text}: normal(mean, deviation) or uniform(low, high) expected"
        raise unusable(USAGE, wrong, hint=EXAMPLE)
    a, b = Axis.of(model, name, [part.strip() for part in found.groups()[1:]]).values
    normal = found[1] == "normal"
    if not (b > 0.0 if normal else a < b):
        rule = "the deviation is more than 0" if normal else "low is less than high"
        raise unusable(USAGE, f"{name}={text}: {rule}", hint=EXAMPLE)
    return a + b * _normal(uniform) if normal else a + (b - a) * uniform


# Rational functions of the inverse normal distribution, to 1e-16: numerator, then
# denominator, highest power first, in the middle, at its sides, and far out.
# Source: M. J. Wichura, Algorithm AS 241, Applied Statistics 37 (1988), 477.
_MIDDLE = (
    (2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4,
     4.5921953931549871457e4, 1.3731693765509461125e4, 1.9715909503065514427e3,
     1.3314166789178437745e2, 3.3871328727963666080e0),
    (5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4,
     2.1213794301586595867e4, 5.3941960214247511077e3, 6.8718700749205790830e2,
     4.2313330701600911252e1, 1.0),
)  # fmt: skip
_SIDES = (
    (7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1,
     1.27045825245236838258e0, 3.64784832476320460504e0, 5.76949722146069140550e0,
     4.63033784615654529590e0, 1.42343711074968357734e0),
    (1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2,
     1.48103976427480074590e-1, 6.89767334985100004550e-1, 1.67638483018380384940e0,
     2.05319162663775882187e0, 1.0),
)  # fmt: skip
_FAR = (
    (2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3,
     2.65321895265761230930e-2, 2.96560571828504891230e-1, 1.78482653991729133580e0,
     5.46378491116411436990e0, 6.65790464350110377720e0),
    (2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5,
     7.86869131145613259100e-4, 1.48753612908506148525e-2, 1.36929880922735805310e-1,
     5.99832206555887937690e-1, 1.0),
)  # fmt: skip


def _normal(uniform: Floats) -> Floats:
    """Transform uniform random numbers (count,) to the standard normal distribution."""
    q = uniform - 0.5
    r = 0.180625 - q * q
    found = q * np.polyval(_MIDDLE[0], r) / np.polyval(_MIDDLE[1], r)
    for k in np.flatnonzero(r < 0.0).tolist():
        p = float(min(uniform[k], 1.0 - uniform[k]))
        root = math.sqrt(-log(p))
        (above, below), shift = (_SIDES, 1.6) if root <= 5.0 else (_FAR, 5.0)
        size = np.polyval(above, root - shift) / np.polyval(below, root - shift)
        found[k] = math.copysign(size, q[k])
    return np.asarray(found)
