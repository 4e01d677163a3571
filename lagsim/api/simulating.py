"""Examining a start, integrating a model, and what comes of it: a motion as arrays."""

from __future__ import annotations

import contextlib
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

import numpy as np

from lagsim.api import given, in_python, numbers, one_of, with_settings
from lagsim.api.models import Model, model_of
from lagsim.errors import LagsimError, counted
from lagsim.outputs import Format, Made
from lagsim.outputs.animation import NAME, frames_of, nothing_to_draw
from lagsim.outputs.letters import Letters, letters_of, raised
from lagsim.outputs.manifest import encode, examination
from lagsim.outputs.notebook import (
    block,
    heading,
    listed,
    page,
    picture,
    table,
)
from lagsim.outputs.results import MANIFEST, open_results
from lagsim.outputs.table import check_format, table_writer
from lagsim.run import session
from lagsim.run.error import ErrorBar
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers import Keep
from lagsim.run.observers.thinning import picture_thinning
from lagsim.run.session import Clock, StartError, open_case, wanted
from lagsim.studies.attempts import Attempt, Attempts, ErrorBars
from lagsim.studies.drawing import beside
from lagsim.studies.moments import rows_at
from lagsim.studies.spectrum import Spectrum, spectrum
from lagsim.tolerances import SAME_INSTANT

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.figure import Figure

    from lagsim.api import Options
    from lagsim.language.arrays import Floats
    from lagsim.notes import Caution, Event


class Examination:
    """The examination of a start: the keys of `check --json` are attributes.

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
            raise AttributeError(f"an examination has no entry `{name}`")
        return record[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.record]

    def __repr__(self) -> str:
        return f"<Examination of {self.record['model']['name']}: {self._verdict()}>"

    def _verdict(self) -> str:
        word = "admissible" if self.admissible else "not admissible"
        return f"{word}, {counted(self.degrees_of_freedom, 'degree of freedom')}"

    def _repr_html_(self) -> str:
        record = self.record
        rows = [
            (c["name"], c["mode"] or c["kind"], f"{c['residual']:.3g}",
             "yes" if c["satisfied"] else "no")
            for c in record["constraints"]
        ]  # fmt: skip
        values = [(name, f"{x!r}") for name, x in (self.repair or {}).items()]
        notes = [(w["code"], w["text"]) for w in record["warnings"]]
        return page(
            heading(f"{record['model']['name']}: {self._verdict()}"),
            table(rows, ("constraint", "kind", "residual", "satisfied")),
            table(values, ("the nearest start", "")),
            table(notes, ("warning", "")),
        )


class InadmissibleError(LagsimError):
    """No run begins at this start; `examination` says why, and what would do."""

    exit_code = 1
    code = "inadmissible"

    def __init__(self, text: str, examination: Examination) -> None:
        super().__init__(text)
        self.examination = examination


class Error(ErrorBar):
    """The estimated error of a run, from its difference to a repeat.

    Attributes
    ----------
    relative : float
        The largest error, as a part of the coordinate's range.
    horizon : float or None
        From this time on the error is too large for a forecast.
    coordinates : dict
        Of each coordinate its largest error, `largest` in its unit and `relative`, and
        when.
    method, rtol
        Of the repeat.
    times, errors : ndarray, shapes (k,) and (k, n)
        The errors of all coordinates, in their units, at the times compared.
    """

    units: Mapping[str, str]
    model: str

    @classmethod
    def of(cls, bar: ErrorBar, model: str, units: Mapping[str, str]) -> Error:
        """Return an estimate with the names and units of its model."""
        new = cls(*bar)
        new.model, new.units = model, units
        return new

    def _summary(self) -> list[tuple[str, str]]:
        tight = "" if self.rtol is None else f" at rtol {self.rtol:.2g}"
        found = self.coordinates
        worst = sorted(found, key=lambda name: -found[name].relative)
        each = [f"{q} {self._in_unit(q)} at t = {found[q].time:.4g}" for q in worst]
        ends = "none before the end"
        if self.horizon is not None:
            ends = f"no forecast past t = {self.horizon:.6g}"
        return [
            ("error", f"about {self.relative:.1g} of a coordinate's range"),
            ("largest", listed(each)),
            ("horizon", ends),
            ("from", f"a repeat by {self.method}{tight}"),
        ]

    def _in_unit(self, name: str) -> str:
        number = f"{self.coordinates[name].largest:.2g}"
        return f"{number} {self.units.get(name, '')}".rstrip()

    def __repr__(self) -> str:
        return block(f"Error of {self.model}", self._summary())

    def _repr_html_(self) -> str:
        from lagsim.outputs.figure import content

        title = f"Error of {self.model}"
        drawn = picture(content(self.plot()), title)
        return page(heading(title), table(self._summary()), drawn)

    def plot(self) -> Figure:
        """Draw the error of each coordinate against time; nothing is shown."""
        from lagsim.outputs.figure import Column, figure

        letters = Letters(self.names)
        columns = [
            Column(letters.name(q), raised(self.units.get(q, "")), errors, log=True)
            for q, errors in zip(self.names, np.abs(self.errors).T, strict=True)
        ]
        title = f"{self.model}: estimated errors"
        return figure(title, Column("t", "s", self.times), columns)


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Return columns, by their names, as a pandas DataFrame.

    Raises
    ------
    ImportError
        Where pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        text = "a DataFrame needs pandas: pip install pandas"
        raise ImportError(text) from None
    return pd.DataFrame(columns)


# Points of a curve of one column against another, at least; for which a run of so many
# steps or fewer is repeated.
SMOOTH, MOST_REPEATED = 2000, 200_000
# Pixels of an animation: tall enough for a scene, its panel and the controls.
HEIGHT = 640


class Animation:
    """A page that plays a motion; a notebook shows it at the end of a cell.

    Attributes
    ----------
    html : str
        The page: one file that needs nothing else.
    """

    def __init__(self, html: str, name: str, height: int = HEIGHT) -> None:
        self.html, self._name, self._height = html, name, height

    def write(self, path: str | Path) -> None:
        """Write the page to a file, to open it in a browser."""
        Path(path).write_text(self.html, encoding="utf-8")

    def __repr__(self) -> str:
        return f"<Animation of {self._name}: {len(self.html) / 1000:.0f} kB of HTML>"

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self._height}px; border: 0"
        return (
            f'<iframe title="{escape(self._name)}" style="{style}" '
            f'sandbox="allow-scripts allow-downloads" srcdoc="{escape(self.html)}">'
            "</iframe>"
        )


class Result:
    """A motion: `result["theta"]` is a column, an array (rows,).

    Attributes
    ----------
    columns : tuple of str
        Those of trajectory.csv.
    table : ndarray, shape (rows, columns)
    events : sequence of Event
    error : Error or None
        The estimated error, from a repeat of the run; None where there is no estimate.
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
        columns, trajectory = made.session.columns, made.trajectory
        self._made, self._rows = made, rows
        self.columns: tuple[str, ...] = columns.of_table
        self.table: Floats = rows[:, : columns.table]
        self.events: Sequence[Event] = trajectory.events
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
    def error(self) -> Error | None:
        """The estimated error; None where there is no estimate."""
        bar = self._made.bar
        return None if isinstance(bar, str) else Error.of(bar, self._name, self.units)

    @cached_property
    def sections(self) -> dict[str, dict[str, Floats]]:
        """Of each section its columns (crossings,), by name."""
        found = self._made.sections
        return {k: dict(zip(self.columns, x.T, strict=True)) for k, x in found.items()}

    @cached_property
    def units(self) -> dict[str, str]:
        """The unit of each column, where it is known or follows."""
        units: dict[str, str] = self.record["columns"]
        return units

    def __getitem__(self, name: str) -> Floats:
        if name not in self.columns:
            raise KeyError(f"there is no column `{name}`: {', '.join(self.columns)}")
        return self.table[:, self.columns.index(name)]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __reduce__(self) -> str:
        text = "a result holds compiled code, and cannot be pickled or copied: "
        raise TypeError(f"{text}`result.write(folder)` keeps it in files")

    @overload
    def at(self, t: float) -> dict[str, float]: ...

    @overload
    def at(self, t: Sequence[float] | Floats) -> dict[str, Floats]: ...

    def at(
        self, t: float | Sequence[float] | Floats
    ) -> dict[str, float] | dict[str, Floats]:
        """Return all columns at any time of the run, as exactly as in its rows.

        The run is repeated with the same steps, up to the last time that is asked for,
        and the method interpolates within its own steps as it does for rows. One call
        with all times is therefore faster than many calls.

        Parameters
        ----------
        t
            One time, or an array of times in any order. At the time of an event the
            state is the one after it; a time within 4 units in the last place of that
            of an event is that time.

        Returns
        -------
        dict
            Of each column a number, or an array of the shape of `t`.

        Raises
        ------
        ValueError
            Where a time lies outside the run.
        """
        times = numbers("t", t)
        first, last = self._made.trajectory.start, self._made.trajectory.end
        outside = ~((times >= first) & (times <= last))
        if outside.any():
            text = f"t = {float(times[outside][0])!r} lies outside the run, which goes"
            raise ValueError(f"{text} from {first!r} to {last!r}")
        rows = rows_at(self._made.session, self._instants(times.ravel()))
        columns = zip(self.columns, rows.T, strict=False)
        if not times.ndim:
            return {name: float(values[0]) for name, values in columns}
        return {name: values.reshape(times.shape) for name, values in columns}

    def _instants(self, times: Floats) -> Floats:
        """Return times (k,), those close to an event as the time of that event."""
        known = np.unique([event.time for event in self.events])
        if not len(known):
            return times
        above = np.minimum(np.searchsorted(known, times), len(known) - 1)
        sides = known[np.maximum(above - 1, 0)], known[above]
        near = np.where(abs(sides[0] - times) < abs(sides[1] - times), *sides)
        start = abs(self._made.trajectory.start)
        same = abs(near - times) <= SAME_INSTANT * np.maximum(abs(times), start)
        return np.where(same, near, times)

    def to_dataframe(self) -> Any:
        """Return the table as a pandas DataFrame; units are in its `attrs`.

        Raises
        ------
        ImportError
            Where pandas is not installed, which is no part of lagsim.
        """
        frame = data_frame({name: self[name] for name in self.columns})
        frame.attrs["units"] = self.units
        return frame

    def plot(self, *columns: str, against: str = "t") -> Figure:
        """Draw columns against time, or against another; nothing is shown.

        Parameters
        ----------
        columns
            Those of one unit share a panel. By default all coordinates.
        against
            What runs to the right; at equal scales where the units are the same. Where
            the rows are few the curve between them is that of `at`.

        Raises
        ------
        KeyError
            Where there is no such column.
        """
        from lagsim.outputs.figure import Column, figure

        model = self._made.session.case.model
        letters = letters_of(model)
        shown = columns or [x.name for x in model.variables]
        values = {name: self[name] for name in (against, *shown)}
        if against != "t":
            values = self._closer(values)
        drawn = {
            name: Column(letters.name(name), raised(self.units[name]), column)
            for name, column in values.items()
        }
        others = [drawn[name] for name in shown]
        return figure(model.name, drawn[against], others)

    def _closer(self, columns: dict[str, Floats]) -> dict[str, Floats]:
        """Return columns with some values between the rows, where rows are few."""
        t = self.t
        more = -(-SMOOTH // max(len(t), 1))
        if more < 2 or len(t) < 2 or self.record["steps"] > MOST_REPEATED:
            return columns
        parts = np.arange(1, more)[:, np.newaxis] / more
        between = t[:-1] + parts * np.diff(t)
        # Nothing lies between the two rows of an impact.
        apart = np.flatnonzero(np.diff(t) > 0.0)
        found = self.at(between[:, apart].T.ravel())
        places = np.repeat(apart + 1, more - 1)
        return {x: np.insert(own, places, found[x]) for x, own in columns.items()}

    def animate(self, *, height: int = 640) -> Animation:
        """Return the page that plays the motion, as `lagsim run --animate` writes it.

        A notebook shows it at the end of a cell.

        Parameters
        ----------
        height
            Of the page in a notebook, in pixels.

        Raises
        ------
        ValueError
            Where the model has nothing to draw.
        """
        for caution in nothing_to_draw(self._made.session.case.model):
            raise ValueError(caution.text)
        shown = dict(self._beside(animate=True))[NAME]
        if not isinstance(shown, bytes):
            raise RuntimeError(shown.text)  # noqa: TRY004  it says why
        return Animation(shown.decode(), self._name, height)

    def spectrum(self, column: str) -> Spectrum:
        """Return how large a sine of each frequency is in a column.

        Raises
        ------
        KeyError
            Where there is no such column.
        InputError
            Where the rows are too few, or not equally spaced.
        """
        found = spectrum(self.t, self[column], column, self.units[column])
        return found._replace(model=self._name)

    def __repr__(self) -> str:
        outcome, span, *_ = (text for _, text in self._summary())
        return f"<Result of {self._name}: {outcome}, {span}>"

    @property
    def _name(self) -> str:
        name: str = self.record["model"]["name"]
        return name

    def _summary(self) -> list[tuple[str, str]]:
        """Return the outcome in a few lines."""
        record, bar, unit = self.record, self.error, self.units["energy"]
        span = f"t = {record['start']:g} to {record['end']:.9g}"
        kept = "energy - work" if "work" in self.columns else "energy"
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
            ("drift", f"{drift} in {kept}"),
            *(("warning", caution.text) for caution in self.warnings),
        ]

    def _repr_html_(self) -> str:
        drawn, shown = dict(self._beside(plots=True))["trajectory.png"], ""
        if isinstance(drawn, bytes):
            shown = picture(drawn, f"the motion of {self._name}")
        return page(heading(self._name), table(self._summary()), shown)

    def _beside(self, *, plots: bool = False, animate: bool = False) -> Iterator[Made]:
        """Return name and content of the files beside the table."""
        made, session = self._made, self._made.session
        equations, columns = session.equations, session.columns.names
        made.thin = picture_thinning(equations.model, columns) if plots else None
        made.frames = frames_of(equations, columns) if animate else None
        for kept in (made.thin, made.frames):
            if kept is not None:
                kept.add(self._rows)
        return beside(made)

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
        form = one_of("table", table, Format)
        if form is not Format.CSV:
            check_format(form, show_units=units)
        with open_results(Path(folder)) as results:
            path = results.part(form.file)
            writer = table_writer(form, path, self.units, show_units=units)
            with contextlib.closing(writer):
                writer.add(self.table)
                writer.finish()
            beside = self._beside(plots=plots, animate=animate)
            cautions = [c.record for c in (*results.cautions, *results.fill(beside))]
            listed = {
                "warnings": [*self.record["warnings"], *cautions],
                "files": [*results.names, MANIFEST],
                "sha256": results.digests(),
            }
            results.commit(encode(self.record | listed))


def check(model: Model | str | Path) -> Examination:
    """Return whether the start of a model is admissible, and what its constraints are.

    Parameters
    ----------
    model
        What `load` gives, a path, or the text of a model file.

    Raises
    ------
    InputError
        Where the model has faults, or asks for a method or a formulation that cannot be
        had.
    """
    case, choices = session.check(model_of(model))
    return Examination(examination(case.equations, case.examined, choices))


@with_settings
def simulate(
    model: Model | str | Path,
    *,
    error_bar: Literal["auto", "always", "never"] = "auto",
    **options: Unpack[Options],
) -> Result:
    """Integrate a model. Options replace the keys of the model's `simulation`.

    Numbers may be expressions of the model's parameters: `duration="2*pi/w"`.

    Parameters
    ----------
    model
        What `load` gives, a path, or the text of a model file.
    duration
        How long the run lasts, in the model's unit of time.
    output_step
        The time between two rows; a thousandth of the duration where nobody says so.
        Steps do not depend on it where the method chooses them.
    method
        The integrator: `"auto"`, or one of `lagsim methods`.
    rtol
        The relative tolerance of a step, for methods that choose their steps.
    atol
        The absolute tolerance, in the unit of each coordinate; by default each has its
        own, `rtol` times the size of its motion.
    step
        The step of methods with a fixed step; `output_step` by default.
    formulation
        How constraints are met: `"auto"`, or a name in docs/model-file.md.
    gain
        Of the formulation `"baumgarte"`: the rate, per unit of time, at which what is
        off the constraints decays.
    error_bar
        When the run is repeated with a smaller tolerance to estimate its error:
        `"auto"`, where that takes no more than about 2 s.

    Raises
    ------
    InputError
        Where the model has faults, or something asked for cannot be had.
    InadmissibleError
        Where the start is not admissible.
    """
    asked = given(options)
    bars = one_of("error_bar", error_bar, ErrorBars)
    clock, keep = Clock(), Keep()
    with in_python():
        read = model_of(model)
        settings = wanted(read, "simulate", asked, hint="add it, or give `duration`")
        clock.lap("read")
        try:
            ready = open_case(read, settings, clock=clock).ready(clock=clock)
        except StartError as error:
            found = Examination(examination(error.equations, error.examined))
            raise InadmissibleError(str(error), found) from None
    attempts = Attempts(keep, Interrupt(), clock, error_bars=bars, cornered=True)
    made = attempts.best(ready)
    return Result(made, keep.table, clock.timings)
