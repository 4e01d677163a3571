"""Running a model: its motion as arrays."""

from __future__ import annotations

import contextlib
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model
    from lagsim.notes import Caution, Event
    from lagsim.run.error import ErrorBar
    from lagsim.run.observers.thinning import Thinning
    from lagsim.studies.attempts import Attempt
    from lagsim.studies.spectrum import Spectrum


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

    @cached_property
    def units(self) -> dict[str, str]:
        """The unit of each column, where it is known or follows."""
        from lagsim.outputs.units import of_table

        return of_table(self._made.session.case.equations, self.record["columns"])

    def __getitem__(self, name: str) -> Floats:
        if name not in self.columns:
            raise KeyError(f"there is no column `{name}`: {', '.join(self.columns)}")
        return self.table[:, self.columns.index(name)]

    def to_dataframe(self) -> Any:
        """Give the table as a pandas DataFrame; units are in its `attrs`.

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
        frame = pd.DataFrame(self.table, columns=list(self.columns))
        frame.attrs["units"] = self.units
        return frame

    def plot(self, *columns: str, against: str = "t") -> Figure:
        """Draw columns against time, or against another; nothing is shown.

        Parameters
        ----------
        columns
            Those of one unit share a panel. By default all coordinates.
        against
            What runs to the right; at equal scales where the units are the same.

        Raises
        ------
        KeyError
            Where there is no such column.
        """
        from lagsim.outputs.figure import Column, figure
        from lagsim.outputs.letters import Letters, raised

        model = self._made.session.case.equations.model
        coordinates = [c.name for c in model.coordinates]
        letters = Letters([*coordinates, *(d.name for d in model.definitions)])
        values = {name: self[name] for name in (against, *(columns or coordinates))}
        drawn = {
            name: Column(letters.name(name), raised(self.units[name]), column)
            for name, column in values.items()
        }
        others = [drawn[name] for name in columns or coordinates]
        return figure(model.name, drawn[against], others)

    def spectrum(self, column: str) -> Spectrum:
        """Give how large a sine of each frequency is in a column.

        Raises
        ------
        KeyError
            Where there is no such column.
        InputError
            Where the rows are too few, or not equally spaced.
        """
        from lagsim.studies.spectrum import spectrum

        return spectrum(self.t, self[column], column, self.units[column])

    def __repr__(self) -> str:
        outcome, span, *_ = (text for _, text in self._summary())
        return f"<Result of {self._name}: {outcome}, {span}>"

    @property
    def _name(self) -> str:
        name: str = self.record["model"]["name"]
        return name

    def _summary(self) -> list[tuple[str, str]]:
        """Say in a few lines what came of it."""
        from lagsim.api.pages import counted

        record, bar, unit = self.record, self.error, self.units["energy"]
        span = f"t = {record['start']:g} to {record['end']:.9g}"
        ledger = "energy - work" if "work" in self.columns else "energy"
        error = "not estimated"
        if bar is not None:
            error = f"about {bar.relative:.1g} of a coordinate's range"
            if bar.horizon is not None:
                error += f"; no forecast past t = {bar.horizon:.4g}"
        method = record["method"]
        if record["formulation"] != "none":
            method += f", {record['formulation']}"
        drift = f"{record['energy_drift']:.2g} {unit}".rstrip()
        return [
            ("outcome", self.outcome),
            ("rows", f"{span}, {counted(record['rows'], 'row')}"),
            *([] if self.outcome == "done" else [("reason", self.reason)]),
            ("method", method),
            ("error", error),
            ("drift", f"{drift} in {ledger}"),
            *(("warning", caution.text) for caution in self.warnings),
        ]

    def _repr_html_(self) -> str:
        from lagsim.api.pages import heading, picture, table

        drawn = dict(self._made.files(self._thinned()))["trajectory.png"]
        parts = [heading(self._name), table(self._summary())]
        return "\n".join([*parts, picture(drawn, f"the motion of {self._name}")])

    def _thinned(self) -> Thinning:
        """Give the rows for pictures."""
        from lagsim.run.observers.thinning import picture_thinning

        session = self._made.session
        model = session.case.equations.model
        thin = picture_thinning(model, session.system.columns.names)
        thin.add(self._rows)
        return thin

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

        made, form = self._made, Format(table)
        if form is not Format.CSV:
            from lagsim.outputs.packed import check_format

            check_format(form, show_units=units)
        with open_results(Path(folder)) as results:
            path = results.part(form.file)
            writer = table_writer(form, path, self.units, show_units=units)
            with contextlib.closing(writer):
                writer.add(self.table)
                writer.finish()
            thin = self._thinned() if plots else None
            frames = None
            if animate:
                from lagsim.outputs.animation import frames_of

                session = made.session
                frames = frames_of(session.case.equations, session.system.columns.names)
                frames.add(self._rows)
            for name, content in made.files(thin, frames):
                results.write(name, content)
            files = [*results.names, MANIFEST]
            listed = {"files": files, "sha256": results.digests()}
            results.commit(encode(self.record | listed))


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
    from lagsim.api.examining import Examination, InadmissibleError
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
    attempts = Attempts(
        keep, Interrupt(), clock, error_bars=ErrorBars(error_bar), cornered=True
    )
    made = attempts.best(session)
    return Result(made, keep.table, clock.timings)
