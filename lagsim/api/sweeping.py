"""Running a model at many values: a row for each run, as arrays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    from lagsim.model.model import Model
    from lagsim.studies.sweep.sweeping import Found


class Sweep:
    """A table with a row for each run: `sweep["theta.end"]` is a column.

    Attributes
    ----------
    columns : tuple of str
        Those of sweep.csv.
    record : dict
        What sweep.json holds.
    """

    def __init__(self, found: Found) -> None:
        from lagsim.studies.sweep.document import cells, document, header

        self._found = found
        self.columns: tuple[str, ...] = tuple(header(found))
        rows = [list(cells(found, found.rows[k])) for k in sorted(found.rows)]
        self._cells = dict(zip(self.columns, zip(*rows, strict=True), strict=True))
        self.record: dict[str, Any] = document(found, [])

    def __len__(self) -> int:
        return len(self._found.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Give a column (runs,): numbers, nan where there is none; words; or truths."""
        if name not in self._cells:
            raise KeyError(f"there is no column `{name}`: {', '.join(self.columns)}")
        cells = self._cells[name]
        if any(isinstance(x, (str, bool)) for x in cells):
            return np.array(cells)
        return np.array(cells, dtype=float)

    def to_dataframe(self) -> Any:
        """Give the table as a pandas DataFrame.

        Raises
        ------
        ImportError
            Where pandas is not installed, which is no part of lagsim.
        """
        try:
            import pandas as pd
        except ImportError:
            text = "a DataFrame needs pandas: pip install pandas"
            raise ImportError(text) from None
        return pd.DataFrame({name: self[name] for name in self.columns})

    def write(self, folder: str | Path, *, plots: bool = True) -> None:
        """Write what `lagsim sweep` writes: sweep.csv, sweep.png, sweep.json.

        Raises
        ------
        InputError
            Where the folder cannot be used.
        OSError
            Where there is no room; then the folder is as it was.
        """
        from lagsim.outputs.manifest import encode
        from lagsim.outputs.results import open_results
        from lagsim.studies.sweep.document import MANIFEST, document, files

        with open_results(Path(folder), MANIFEST) as results:
            for name, content in files(self._found, plots=plots):
                results.write(name, content)
            record = document(self._found, [*results.names, MANIFEST])
            results.commit(encode(record))

    def __repr__(self) -> str:
        name, complete = self.record["model"]["name"], self.record["complete"]
        return f"<Sweep of {name}: {complete} of {len(self)} runs complete>"


def sweep(
    model: Model,
    values: Mapping[str, Iterable[float | str]],
    *,
    ends: bool = False,
    jobs: int | None = None,
    error_bar: Literal["auto", "always", "never"] = "auto",
    **options: float | str,
) -> Sweep:
    """Run a model at all combinations of values; the first name is the slowest.

    Parameters
    ----------
    values
        Of parameters, and of entries of `initial`: numbers, or expressions.
    ends
        Only what each column ends with is asked for: no rows are made, runs of smooth
        scenes go side by side in vector registers, and there is no error bar.
    jobs
        So many runs at a time, in processes of their own; by default one for each core,
        where that is worth it.
    error_bar, options
        As for `simulate`.

    Raises
    ------
    InputError
        Where a name, a value or an option cannot be had. A run that cannot begin or
        finish is a row with its outcome and its reason.
    """
    from lagsim.run.session import wanted
    from lagsim.studies.attempts import ErrorBars
    from lagsim.studies.sweep.grid import grid_of
    from lagsim.studies.sweep.runs import Work
    from lagsim.studies.sweep.sweeping import Found, packed
    from lagsim.studies.sweep.sweeping import sweep as make
    from lagsim.studies.workers import cores

    wanted(model, "sweep", options, hint="add it, or give `duration`")
    given = tuple((name, str(x)) for name, x in options.items())
    bars = ErrorBars.NEVER if ends else ErrorBars(error_bar)
    work = Work(packed(model), given, grid_of(model, values), bars, ends=ends)
    found = Found(model, work)
    make(found, jobs or cores(), wanted=jobs is not None)
    return Sweep(found)
