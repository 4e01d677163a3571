"""Sweeps: runs of a model at many values, as a table with a row for each run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np

from lagsim.api import (
    given,
    in_python,
    lists,
    number_or_text,
    one_of,
    whole_number,
    with_settings,
)
from lagsim.api.models import Model, model_of
from lagsim.api.simulating import data_frame
from lagsim.model.reader.runs import FROM
from lagsim.outputs.manifest import encode
from lagsim.outputs.notebook import (
    heading,
    html_table,
    paragraphs,
    picture,
    short_list,
    text_block,
)
from lagsim.outputs.results import open_results
from lagsim.run.session import settings_of
from lagsim.studies.attempts import ErrorBars
from lagsim.studies.sweep.grid import SweepRows, grid_of
from lagsim.studies.sweep.sweeping import (
    MANIFEST,
    cells,
    document,
    header,
    of_file,
    sampled,
    sweep_files,
)
from lagsim.studies.sweep.sweeping import sweep as make
from lagsim.studies.workers import cores

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from lagsim.api import SimulationOptions


class Sweep:
    """Table with a row for each run: `sweep["theta.end"]` is a column.

    Attributes
    ----------
    columns : tuple of str
        Names of the columns, as in sweep.csv.
    record : dict
        The content of sweep.json.

    Examples
    --------
    >>> import lagsim
    >>> model = lagsim.load('''
    ... name: drop
    ... parameters: {m: 2, g: 9.81}
    ... coordinates: {y: {}}
    ... energy: {kinetic: m*y_dot^2/2, potential: m*g*y}
    ... initial: {y: 1, y_dot: 0}
    ... simulation: {duration: 0.5}
    ... ''')
    >>> swept = lagsim.sweep(model, {"g": [1.62, 9.81]})
    >>> len(swept), swept.columns[:6]
    (2, ('g', 'outcome', 'complete', 'error', 't.end', 'y.end'))
    >>> swept["y_dot.end"].round(9)
    array([-0.81 , -4.905])
    """

    def __init__(self, found: SweepRows) -> None:
        self._found = found
        self.columns: tuple[str, ...] = tuple(header(found))
        rows = zip(*cells(found), strict=True)
        self._cells = dict(zip(self.columns, rows, strict=True))
        self.record: dict[str, Any] = document(found) | {"files": []}

    def __len__(self) -> int:
        return len(self._found.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column (runs,) of floats (nan if unknown), strings or booleans."""
        if name not in self._cells:
            raise KeyError(f"there is no column `{name}`: {', '.join(self.columns)}")
        cells = self._cells[name]
        if any(isinstance(x, (str, bool)) for x in cells):
            return np.array(cells)
        return np.array(cells, dtype=float)

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def to_dataframe(self) -> Any:
        """Return the table as a pandas DataFrame.

        Raises
        ------
        ImportError
            If pandas is not installed (lagsim does not depend on pandas).
        """
        return data_frame({name: self[name] for name in self.columns})

    def write(self, folder: str | Path, *, plots: bool = True) -> None:
        """Write the files of `lagsim sweep`: sweep.csv, sweep.png, sweep.json.

        Parameters
        ----------
        folder : str or Path
        plots : bool
            Whether pictures are written, too.

        Raises
        ------
        InputError
            If the folder cannot be used.
        OSError
            If the disk is full; the folder is then left unchanged.
        """
        with open_results(Path(folder), MANIFEST) as results:
            made = sweep_files(self._found, plots=plots)
            cautions = [c.record for c in (*results.cautions, *results.fill(made))]
            more: dict[str, Any] = {"files": [*results.names, MANIFEST]}
            more |= {"warnings": cautions} if cautions else {}
            results.commit(encode(document(self._found) | more))

    def plot(self, *columns: str) -> Figure:
        """Return a matplotlib figure of columns against the swept values.

        With one swept name each column is a curve. With more, each column is a map over
        the first two names, with the others at the middle of their lists.

        Parameters
        ----------
        *columns : str
            Such as `theta.end` or `theta.max`; by default all coordinates at the end.

        Raises
        ------
        KeyError
            If there is no such column.
        """
        from lagsim.studies.sweep.chart import sweep_figure

        shown = columns or [f"{x.name}.end" for x in self._found.model.variables]
        return sweep_figure(self._found, {name: self[name] for name in shown})

    def __repr__(self) -> str:
        name, complete = self.record["model"]["name"], self.record["complete"]
        head = f"Sweep of {name}: {complete} of {len(self)} runs complete"
        return text_block(head, self._summary())

    def _summary(self) -> list[tuple[str, str]]:
        """Return the lines of the summary as (label, text).

        The lines list the swept values, the runs without a result, and the columns.
        """
        lines = []
        for axis in self._found.grid.axes:
            unit = f" {axis.unit}" if axis.unit else ""
            values = short_list([f"{x:.6g}" for x in axis.values], 40)
            lines.append((axis.name, f"{values}{unit}"))
        others = [
            f"{count} {word}"
            for word, count in self.record["outcomes"].items()
            if word not in ("done", "until")
        ]
        lines += [("without a result", short_list(others))] if others else []
        return [*lines, ("columns", short_list(self.columns))]

    def _repr_html_(self) -> str:
        from lagsim.studies.sweep.chart import chart

        name, complete = self.record["model"]["name"], self.record["complete"]
        return paragraphs(
            heading(f"{name}: {complete} of {len(self)} runs complete"),
            html_table(self._summary()),
            picture(chart(self._found), f"the runs of {name}"),
        )


@with_settings()
def sweep(
    model: Model | str | Path,
    values: Mapping[str, Iterable[float | str]] | None = None,
    *,
    points: str | Path | Mapping[str, Iterable[float | str]] | None = None,
    sample: Mapping[str, str] | None = None,
    N: int | None = None,
    seed: int = 0,
    ends: bool = False,
    from_: float | str | None = None,
    jobs: int | None = None,
    error_bar: Literal["auto", "always", "never"] = "auto",
    **options: Unpack[SimulationOptions],
) -> Sweep:
    """Run a model at all combinations of values, at points, or at a random sample.

    A run that cannot begin or finish is a row with its outcome and its reason.

    Parameters
    ----------
    model : Model, str or Path
        A model from `load`, the path of a model file, or the text of one: a string
        with a line break.
    values : mapping, optional
        A list of numbers or expressions for each name of a parameter or of an entry of
        `initial`. `{"k": [1, 4], "x": [0.1, 0.2]}` makes four runs; the last name
        varies fastest.
    points : str, Path or mapping, optional
        In place of `values`: the path of a CSV file with a column for each name, or a
        list for each name, all of one length. `{"k": [1, 4], "x": [0.1, 0.2]}` makes
        two runs.
    sample : mapping, optional
        In place of `values`: a distribution for each name, such as
        `{"k": "normal(4, 0.1)", "x": "uniform(0, 1)"}`.
    N : int, optional
        The number of runs drawn from `sample`.
    seed : int
        The seed of the sample; a seed determines the sample on every machine.
    ends : bool
        Compute only the last value of each column: no rows are stored, runs without
        constraints and events take a sixth of the time, and there is no error bar.
    from_ : float or str, optional
        A time, as a number or an expression: `.min` and `.max` of each column, and
        further columns `.mean`, `.rms` (of the deviation from the mean) and
        `.peak_to_peak`, count the rows from this time on.
    jobs : int, optional
        The number of processes; by default one for each core, where that saves time.
    error_bar
        As for `api.simulating.simulate`; this and the options above apply to all runs.

    Returns
    -------
    Sweep

    Raises
    ------
    InputError
        If the model has faults, or a name, a value or an option cannot be used.
    TypeError, ValueError
        If an argument has the wrong type, or `jobs` or `seed` is out of range.

    Examples
    --------
    >>> import lagsim
    >>> model = lagsim.load('''
    ... name: drop
    ... parameters: {m: 2, g: 9.81}
    ... coordinates: {y: {}}
    ... energy: {kinetic: m*y_dot^2/2, potential: m*g*y}
    ... initial: {y: 1, y_dot: 0}
    ... simulation: {duration: 0.5}
    ... ''')
    >>> swept = lagsim.sweep(model, {"g": [1.62, 9.81], "y": [1, 2]}, jobs=1)
    >>> swept["y.end"].round(9)
    array([ 0.7975 ,  1.7975 , -0.22625,  0.77375])
    """
    if jobs is not None:
        whole_number("jobs", jobs, 1)
    settings = given(options)
    if from_ is not None:
        number_or_text("from_", from_)
        settings[FROM] = from_
    if ends and from_ is not None:
        raise TypeError("`from_` is a time of rows, and `ends` computes no rows")
    bars = one_of("error_bar", error_bar, ErrorBars)
    with in_python():
        read = model_of(model)
        settings_of(read, "sweep", settings, hint="add it, or give `duration`")
        if (values is None) + (points is None) + (sample is None) != 2:
            raise TypeError("values, points or sample: one of these is expected")
        if (sample is None) is not (N is None):
            raise TypeError("`N`, the number of samples, is used with `sample`")
        if not (type(seed) is int and 0 <= seed < 2**64):
            raise ValueError(f"seed={seed!r:.60}: 0 to 2^64 - 1 is expected")
        if sample is not None and N is not None:
            grid = sampled(read, sample.items(), N, seed)
        elif isinstance(points, (str, Path)):
            grid = of_file(read, Path(points))
        else:
            several = lists((values if points is None else points) or {})
            grid = grid_of(read, several, together=points is not None)
    found = SweepRows.of(read, grid, settings, bars, ends=ends)
    make(found, jobs or cores(), requested=jobs is not None)
    return Sweep(found)
