"""From energies to motion: a simulator for systems written down as T and V.

`load` reads a model, `check` tells whether its start is admissible, and `simulate`
gives its motion as arrays: see docs/python.md. Nothing is printed, and nothing written
unless a result is asked to.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from lagsim.errors import InputError, LagsimError
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model
    from lagsim.notes import Caution, Event
    from lagsim.run.error import ErrorBar
    from lagsim.studies.attempts import Attempt

__all__ = [
    "Examination",
    "InadmissibleError",
    "InputError",
    "LagsimError",
    "Result",
    "__version__",
    "check",
    "load",
    "simulate",
]


class Examination:
    """What there is to say of a start: the keys of `check --json` are attributes.

    Attributes
    ----------
    record : dict
        All of them.
    """

    admissible: bool
    degrees_of_freedom: int
    repair: dict[str, float] | None

    def __init__(self, record: Mapping[str, Any]) -> None:
        self.record = dict(record)

    def __getattr__(self, name: str) -> Any:
        record: dict[str, Any] = self.__dict__.get("record", {})
        if name not in record:
            raise AttributeError(f"an examination says nothing of `{name}`")
        return record[name]


class InadmissibleError(LagsimError):
    """No run begins at this start; `examination` says why, and what would do."""

    exit_code = 1

    def __init__(self, text: str, examination: Examination) -> None:
        super().__init__(text)
        self.examination = examination


class Result:
    """A motion: `result["theta"]` is a column, an array (rows,).

    Attributes
    ----------
    columns : tuple of str
        Those of trajectory.csv.
    table : ndarray, shape (rows, columns)
    events : sequence of Event
    error : ErrorBar or None
        What a repeat says; None where none was made, or it says nothing.
    warnings : sequence of Caution
    outcome, reason : str
        How the run ended, and where it did not come to its end, why.
    complete : bool
        Whether all that was asked for has been computed.
    record : dict
        What run.json holds.
    """

    def __init__(
        self, made: Attempt, rows: Floats, timings: Mapping[str, float]
    ) -> None:
        columns, trajectory = made.session.system.columns, made.trajectory
        self._made, self._rows = made, rows
        self.columns: tuple[str, ...] = columns.names[: columns.table]
        self.table: Floats = rows[:, : columns.table]
        self.events: Sequence[Event] = trajectory.events
        self.error: ErrorBar | None = None if isinstance(made.bar, str) else made.bar
        self.warnings: Sequence[Caution] = made.cautions()
        self.outcome: str = trajectory.outcome.word
        self.reason: str = trajectory.reason
        self.complete: bool = trajectory.outcome.complete
        self.record: dict[str, Any] = made.record(self.warnings, timings, [])

    @property
    def t(self) -> Floats:
        """The times of the rows (rows,)."""
        return self["t"]

    def __getitem__(self, name: str) -> Floats:
        if name not in self.columns:
            raise KeyError(f"there is no column `{name}`: {', '.join(self.columns)}")
        return self.table[:, self.columns.index(name)]

    def to_dataframe(self) -> Any:
        """Give the table as a pandas DataFrame (pandas is no part of lagsim)."""
        import pandas as pd

        return pd.DataFrame(self.table, columns=list(self.columns))

    def write(
        self,
        folder: str | Path,
        *,
        plots: bool = True,
        table: Literal["csv", "npz", "parquet"] = "csv",
        units: bool = False,
        animate: bool = False,
    ) -> None:
        """Write what `lagsim run` writes: table, events, pictures, page, run.json.

        Parameters
        ----------
        plots
            The pictures, too.
        table
            How the table is kept.
        units
            A line of units below the header of CSV.
        animate
            The page that shows the motion.

        Raises
        ------
        InputError
            Where the folder cannot be used.
        OSError
            Where there is no room; then the folder is as it was.
        """
        from lagsim.outputs import Format
        from lagsim.outputs.manifest import encode
        from lagsim.outputs.results import MANIFEST, open_results
        from lagsim.outputs.table import table_writer
        from lagsim.run.observers.thinning import picture_thinning

        made, form = self._made, Format(table)
        known = made.session.system.units()
        with open_results(Path(folder)) as results:
            path = results.part(form.file)
            writer = table_writer(form, path, known, show_units=units)
            with contextlib.closing(writer):
                writer.add(self.table)
                writer.finish()
            thin = frames = None
            equations, names = (
                made.session.case.equations,
                made.session.system.columns.names,
            )
            if plots:
                thin = picture_thinning(equations.model, names)
                thin.add(self._rows)
            if animate:
                from lagsim.outputs.animation import frames_of

                frames = frames_of(equations, names)
                frames.add(self._rows)
            for name, content in made.files(thin, frames):
                results.write(name, content)
            files = [*results.names, MANIFEST]
            results.commit(encode(self.record | {"files": files}))


def load(source: str | Path, **values: float | str) -> Model:
    """Read a model.

    Parameters
    ----------
    source
        A path, or the text of a model file: what has a line break in it.
    **values
        Numbers, or expressions, instead of those of parameters or of start values, see
        `Model.bind`.

    Raises
    ------
    InputError
        With every fault, each with file, line, column, code, text and hint.
    """
    from lagsim.model.reader import TEXT, read, read_file

    text = str(source)
    model = read(text, TEXT) if "\n" in text else read_file(text)
    return model.bind(**values) if values else model


def check(model: Model) -> Examination:
    """Tell whether the start of a model is admissible, and what its constraints are.

    Raises
    ------
    InputError
        Where the file asks for a method or a formulation that cannot be had.
    """
    from lagsim.outputs.examined import document
    from lagsim.run.session import check

    case, choices = check(model)
    return Examination(document(case.equations, case.examined, choices))


def simulate(
    model: Model,
    *,
    duration: float | str | None = None,
    output_step: float | str | None = None,
    method: str | None = None,
    rtol: float | str | None = None,
    atol: float | str | None = None,
    step: float | str | None = None,
    formulation: str | None = None,
    gain: float | str | None = None,
    spectral_radius: float | str | None = None,
    error_bar: Literal["auto", "always", "never"] = "auto",
) -> Result:
    """Integrate a model; what is given stands for the keys of its `simulation`.

    Parameters
    ----------
    error_bar
        When the run is repeated more tightly to estimate its error; `auto`: where that
        takes no more than about 2 s.

    Raises
    ------
    InputError
        Where something asked for cannot be had.
    InadmissibleError
        Where the start is not admissible.
    """
    options = {
        "duration": duration, "output_step": output_step, "method": method,
        "rtol": rtol, "atol": atol, "step": step, "formulation": formulation,
        "gain": gain, "spectral_radius": spectral_radius,
    }  # fmt: skip
    given = {name: x for name, x in options.items() if x is not None}
    from lagsim.outputs.examined import document
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Keep
    from lagsim.run.session import Clock, StartError, open_case, wanted
    from lagsim.studies.attempts import Attempts, ErrorBars

    clock, keep = Clock(), Keep()
    settings = wanted(model, "simulate", given, hint="add it, or give `duration`")
    clock.lap("read")
    try:
        session = open_case(model, settings, clock=clock).ready(clock=clock)
    except StartError as error:
        found = Examination(document(error.equations, error.examined))
        raise InadmissibleError(str(error), found) from None
    attempts = Attempts(keep, Interrupt(), clock, error_bars=ErrorBars(error_bar))
    made = attempts.best(session)
    return Result(made, keep.table, clock.timings)
