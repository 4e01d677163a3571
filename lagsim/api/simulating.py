"""Examination of a start, and simulation of a model: a motion as arrays."""

from __future__ import annotations

import contextlib
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

import numpy as np

from lagsim.api import float_array, given, in_python, one_of, with_settings
from lagsim.api.models import Model, model_of
from lagsim.codes.known import INADMISSIBLE
from lagsim.errors import LagsimError, counted
from lagsim.outputs import Made, TableFormat
from lagsim.outputs.animation import NAME, frames_of, nothing_to_draw
from lagsim.outputs.letters import Letters, letters_of, raised_powers
from lagsim.outputs.manifest import encode, examination
from lagsim.outputs.notebook import (
    framed,
    heading,
    html_table,
    paragraphs,
    picture,
    short_list,
    text_block,
)
from lagsim.outputs.results import MANIFEST, open_results
from lagsim.outputs.table import check_format, table_writer
from lagsim.run import session
from lagsim.run.error import ErrorBar
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers import Keep
from lagsim.run.observers.thinning import picture_thinning
from lagsim.run.session import StartError, Stopwatch, open_case, settings_of
from lagsim.studies.attempts import Attempt, Attempts, ErrorBars, Records
from lagsim.studies.drawing import other_files
from lagsim.studies.spectrum import Spectrum, spectrum
from lagsim.studies.trial import tried
from lagsim.tolerances import SAME_INSTANT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from matplotlib.figure import Figure

    from lagsim.api import SimulationOptions
    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model as Read
    from lagsim.model.model import Settings
    from lagsim.notes import Caution, Event
    from lagsim.run.observers.appended import Appended


class Examination:
    """Examination of a start. The keys of `lagsim check --json` are attributes.

    Attributes
    ----------
    admissible : bool
        Whether a run can begin at the start.
    degrees_of_freedom : int
        The number of coordinates less the rank of the constraint Jacobian.
    repair : dict or None
        The nearest admissible start: by name, values of entries of `initial`.
    record : dict
        The document of `lagsim check --json`.

    Examples
    --------
    >>> import lagsim
    >>> found = lagsim.check('''
    ... coordinates: {x: {}, y: {}}
    ... energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
    ... constraints: {line: x = y}
    ... initial: {x: 1, y: 1}
    ... ''')
    >>> found.admissible, found.degrees_of_freedom
    (True, 1)
    >>> [constraint["name"] for constraint in found.constraints]
    ['line']
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
        return paragraphs(
            heading(f"{record['model']['name']}: {self._verdict()}"),
            html_table(rows, ("constraint", "kind", "residual", "satisfied")),
            html_table(values, ("the nearest start", "")),
            html_table(notes, ("warning", "")),
        )


class InadmissibleError(LagsimError):
    """The start of a model is not admissible.

    Attributes
    ----------
    examination : Examination
        The reason, and the nearest admissible start if one was found.

    Examples
    --------
    >>> import lagsim
    >>> rod = '''
    ... name: rod
    ... parameters: {l: 1, g: 9.81}
    ... coordinates: {x: {}, y: {}}
    ... energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: g*y}
    ... constraints: {length: sqrt(x^2 + y^2) = l}
    ... initial: {x: 0.6, y: -0.6}
    ... simulation: {duration: 0.5}
    ... '''
    >>> try:
    ...     lagsim.simulate(rod)
    ... except lagsim.InadmissibleError as error:
    ...     print({k: round(x, 6) for k, x in error.examination.repair.items()})
    {'x': 0.707107, 'y': -0.707107}
    """

    exit_code = 1
    code = INADMISSIBLE

    def __init__(self, text: str, examination: Examination) -> None:
        super().__init__(text)
        self.examination = examination


class Error(ErrorBar):
    """Estimated error of a run: its difference to a repeat with a smaller tolerance.

    Attributes
    ----------
    relative : float
        The largest error relative to the range of its coordinate.
    horizon : float or None
        The time from which on the error is too large for a forecast; None where that
        time lies past the end.
    coordinates : dict
        For each coordinate its largest error, `largest` in its unit and `relative` to
        its range, and the `time` of that error.
    method, rtol : str, float or None
        The method of the repeat and its tolerance.
    times, errors : ndarray, shapes (k,) and (k, n)
        The times compared, and the errors of all coordinates there, in their units.
    """

    units: Mapping[str, str]
    model: str

    @classmethod
    def of(cls, bar: ErrorBar, model: str, units: Mapping[str, str]) -> Error:
        """Return the estimate of an error bar, with the name and units of its model."""
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
            ("largest", short_list(each)),
            ("horizon", ends),
            ("from", f"a repeat by {self.method}{tight}"),
        ]

    def _in_unit(self, name: str) -> str:
        number = f"{self.coordinates[name].largest:.2g}"
        return f"{number} {self.units.get(name, '')}".rstrip()

    def __repr__(self) -> str:
        return text_block(f"Error of {self.model}", self._summary())

    def _repr_html_(self) -> str:
        from lagsim.outputs.figure import encoded_figure

        title = f"Error of {self.model}"
        drawn = picture(encoded_figure(self.plot()), title)
        return paragraphs(heading(title), html_table(self._summary()), drawn)

    def plot(self) -> Figure:
        """Return a matplotlib figure of the error of each coordinate against time."""
        from lagsim.outputs.figure import PlottedColumn, figure

        letters = Letters(self.names)
        columns = [
            PlottedColumn(
                letters.name(q), raised_powers(self.units.get(q, "")), errors, log=True
            )
            for q, errors in zip(self.names, np.abs(self.errors).T, strict=True)
        ]
        title = f"{self.model}: estimated errors"
        return figure(title, PlottedColumn("t", "s", self.times), columns)


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Return columns, given by name, as a pandas DataFrame.

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        text = "a DataFrame needs pandas: pip install pandas"
        raise ImportError(text) from None
    return pd.DataFrame(columns)


# The least number of points of a curve of one column against another, and the largest
# number of steps of a run that is repeated to compute them.
SMOOTH, MOST_REPEATED = 2000, 200_000
# Pixels of an animation: tall enough for a scene, its panel and the controls.
HEIGHT = 640


class Animation:
    """HTML page that plays a motion; a notebook shows the page at the end of a cell.

    Attributes
    ----------
    html : str
        The text of the page, which loads no other file.
    """

    def __init__(self, html: str, name: str, height: int = HEIGHT) -> None:
        self.html, self._name, self._height = html, name, height

    def write(self, path: str | Path) -> None:
        """Write the page to a file, for a browser."""
        Path(path).write_text(self.html, encoding="utf-8")

    def __repr__(self) -> str:
        return f"<Animation of {self._name}: {len(self.html) / 1000:.0f} kB of HTML>"

    def _repr_html_(self) -> str:
        return framed(self.html, self._name, self._height)


class Result:
    """Motion of a model: `result["theta"]` is a column, an array of shape (rows,).

    Attributes
    ----------
    columns : tuple of str
        Names of the columns, as in trajectory.csv.
    table : ndarray, shape (rows, columns)
        All columns.
    events : sequence of Event
        Impacts, switches and other events, in the order of time.
    error : Error or None
        The estimated error, from a repeat of the run; None if there is no estimate.
    warnings : sequence of Caution
    outcome, reason : str
        How the run ended, and the reason if it ended early.
    complete : bool
        Whether the run computed the whole motion.
    record : dict
        The content of run.json.

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
    >>> result = lagsim.simulate(model, output_step=0.1)
    >>> result
    <Result of drop: done, t = 0 to 0.5, 6 rows>
    >>> result.t
    array([0. , 0.1, 0.2, 0.3, 0.4, 0.5])
    >>> result.columns
    ('t', 'y', 'y_dot', 'y_ddot', 'kinetic', 'potential', 'energy')
    >>> result["y"].round(6)
    array([ 1.     ,  0.95095,  0.8038 ,  0.55855,  0.2152 , -0.22625])
    """

    def __init__(
        self,
        made: Attempt,
        rows: Floats,
        timings: Mapping[str, float],
        appended: Callable[[Floats], Appended | None] = lambda _: None,
    ) -> None:
        columns, trajectory = made.session.columns, made.trajectory
        self._attempt, self._rows, self._appended = made, rows, appended
        self.columns: tuple[str, ...] = columns.of_table
        self.table: Floats = rows[:, : columns.table]
        if made.appended is not None:
            self.columns += made.appended.names
            self.table = np.hstack([self.table, made.appended.at(rows[:, 0])])
        self.events: Sequence[Event] = trajectory.events
        self.warnings: Sequence[Caution] = made.cautions()
        self.outcome: str = trajectory.outcome.word
        self.reason: str = trajectory.reason
        self.complete: bool = trajectory.outcome.complete
        self.record: dict[str, Any] = made.record(self.warnings, timings, [])

    @property
    def t(self) -> Floats:
        """The times of the rows, shape (rows,)."""
        return self["t"]

    @cached_property
    def error(self) -> Error | None:
        """The estimated error; None if there is no estimate."""
        bar = self._attempt.bar
        return None if isinstance(bar, str) else Error.of(bar, self._name, self.units)

    @cached_property
    def sections(self) -> dict[str, dict[str, Floats]]:
        """For each section, by name, its columns by name, shape (crossings,).

        Sensitivities and standard deviations, the last columns, are left out.
        """
        found, names = self._attempt.sections, self.columns
        return {k: dict(zip(names, x.T, strict=False)) for k, x in found.items()}

    @cached_property
    def units(self) -> dict[str, str]:
        """The unit of each column; the empty string for an unknown unit."""
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
        """Return all columns at given times of the run, with the accuracy of its rows.

        Sensitivities and standard deviations are computed by further runs; at the time
        of an impact these are nan.

        The run is repeated with its own steps up to the last of the times, and the
        dense output of the method is evaluated within the steps, as for rows. One call
        with all times is therefore faster than many calls.

        Parameters
        ----------
        t : float or ndarray
            One time, or an array of times in any order. At the time of an event the
            state is that after the event; a time within 4 units in the last place of
            the time of an event counts as that time.

        Returns
        -------
        dict
            By column, a number or an array of the shape of `t`.

        Raises
        ------
        ValueError
            If a time lies outside the run.

        Examples
        --------
        >>> import lagsim
        >>> result = lagsim.simulate('''
        ... coordinates: {y: {}}
        ... energy: {kinetic: y_dot^2/2, potential: 10*y}
        ... initial: {y: 1}
        ... simulation: {duration: 0.4}
        ... ''')
        >>> round(result.at(0.3)["y"], 9)
        0.55
        """
        times = float_array("t", t)
        first, last = self._attempt.trajectory.start, self._attempt.trajectory.end
        outside = ~((times >= first) & (times <= last))
        if outside.any():
            text = f"t = {float(times[outside][0])!r} lies outside the run, which goes"
            raise ValueError(f"{text} from {first!r} to {last!r}")
        instants = self._instants(times.ravel())
        rows = tried(self._attempt.session, instants).rows
        names = self._attempt.session.columns.of_table
        columns = dict(zip(names, rows.T, strict=False))
        if self._attempt.appended is not None and (more := self._appended(instants)):
            columns |= zip(more.names, more.values.T, strict=True)
        if not times.ndim:
            return {name: float(values[0]) for name, values in columns.items()}
        return {name: values.reshape(times.shape) for name, values in columns.items()}

    def _instants(self, times: Floats) -> Floats:
        """Return times (k,) in which a time close to an event is that of the event."""
        known = np.unique([event.time for event in self.events])
        if not len(known):
            return times
        above = np.minimum(np.searchsorted(known, times), len(known) - 1)
        sides = known[np.maximum(above - 1, 0)], known[above]
        near = np.where(abs(sides[0] - times) < abs(sides[1] - times), *sides)
        start = abs(self._attempt.trajectory.start)
        same = abs(near - times) <= SAME_INSTANT * np.maximum(abs(times), start)
        return np.where(same, near, times)

    def to_dataframe(self) -> Any:
        """Return the table as a pandas DataFrame, with the units in its `attrs`.

        Raises
        ------
        ImportError
            If pandas is not installed (lagsim does not depend on pandas).
        """
        frame = data_frame({name: self[name] for name in self.columns})
        frame.attrs["units"] = self.units
        return frame

    def plot(self, *columns: str, against: str = "t") -> Figure:
        """Return a matplotlib figure of columns against time or another column.

        Parameters
        ----------
        *columns : str
            Names of columns, by default all coordinates. Columns of one unit share a
            panel.
        against : str
            The column of the horizontal axis. Both axes have one scale if the units
            agree. Where the rows are few, points from `at` are added between them.

        Raises
        ------
        KeyError
            If there is no such column.
        """
        from lagsim.outputs.figure import PlottedColumn, figure

        model = self._attempt.session.case.model
        letters = letters_of(model)
        shown = columns or [x.name for x in model.variables]
        values = {name: self[name] for name in (against, *shown)}
        if against != "t":
            values = self._closer(values)
        drawn = {
            name: PlottedColumn(
                letters.name(name), raised_powers(self.units[name]), column
            )
            for name, column in values.items()
        }
        others = [drawn[name] for name in shown]
        return figure(model.name, drawn[against], others)

    def _closer(self, columns: dict[str, Floats]) -> dict[str, Floats]:
        """Return columns for a plot; between few rows, values of `at` are inserted."""
        t = self.t
        more = -(-SMOOTH // max(len(t), 1))
        if more < 2 or len(t) < 2 or self.record["steps"] > MOST_REPEATED:
            return columns
        parts = np.arange(1, more)[:, np.newaxis] / more
        between = t[:-1] + parts * np.diff(t)
        # There is no time between the two rows of an impact.
        apart = np.flatnonzero(np.diff(t) > 0.0)
        found = self.at(between[:, apart].T.ravel())
        places = np.repeat(apart + 1, more - 1)
        return {x: np.insert(own, places, found[x]) for x, own in columns.items()}

    def animate(self, *, height: int = 640) -> Animation:
        """Return the page that plays the motion, as `lagsim run --animate` writes it.

        A notebook shows the page at the end of a cell.

        Parameters
        ----------
        height : int
            The height of the page in a notebook, in pixels.

        Raises
        ------
        ValueError
            If the model has neither a scene nor coordinates that can be drawn.
        """
        for caution in nothing_to_draw(self._attempt.session.case.model):
            raise ValueError(caution.text)
        shown = dict(self._other_files(animate=True))[NAME]
        if not isinstance(shown, bytes):
            raise RuntimeError(shown.text)  # noqa: TRY004  it says why
        return Animation(shown.decode(), self._name, height)

    def spectrum(self, column: str) -> Spectrum:
        """Return the amplitude spectrum of a column.

        Raises
        ------
        KeyError
            If there is no such column.
        InputError
            If the rows are too few, or not equally spaced.
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
        """Return the lines of the summary as (label, text)."""
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
        drawn, shown = dict(self._other_files(plots=True))["trajectory.png"], ""
        if isinstance(drawn, bytes):
            shown = picture(drawn, f"the motion of {self._name}")
        return paragraphs(heading(self._name), html_table(self._summary()), shown)

    def _other_files(
        self, *, plots: bool = False, animate: bool = False
    ) -> Iterator[Made]:
        """Yield name and content of each file of the result other than the table.

        plots, animate : whether the pictures, and the page, are included.
        """
        made, session = self._attempt, self._attempt.session
        equations, columns = session.equations, session.columns.names
        made.thin = picture_thinning(equations.model, columns) if plots else None
        made.frames = frames_of(equations, columns) if animate else None
        for kept in (made.thin, made.frames):
            if kept is not None:
                kept.add(self._rows)
        return other_files(made)

    def write(
        self,
        folder: str | Path,
        *,
        plots: bool = True,
        table: Literal["csv", "npz", "parquet"] = "csv",
        units: bool = False,
        animate: bool = False,
    ) -> None:
        """Write the files of `lagsim run` to a folder.

        The files are the table, events, pictures, the page and run.json.

        Parameters
        ----------
        folder : str or Path
        plots : bool
            Whether pictures are written, too.
        table : {"csv", "npz", "parquet"}
            The format of the table.
        units : bool
            Write a line of units below the header of the CSV table.
        animate : bool
            Write the page that plays the motion.

        Raises
        ------
        InputError
            If the folder cannot be used.
        OSError
            If the disk is full; the folder is then left unchanged.
        """
        form = one_of("table", table, TableFormat)
        if form is not TableFormat.CSV:
            check_format(form, show_units=units)
        with open_results(Path(folder)) as results:
            path = results.part(form.file)
            writer = table_writer(form, path, self.units, show_units=units)
            with contextlib.closing(writer):
                writer.add(self.table)
                writer.finish()
            beside = self._other_files(plots=plots, animate=animate)
            cautions = [c.record for c in (*results.cautions, *results.fill(beside))]
            listed = {
                "warnings": [*self.record["warnings"], *cautions],
                "files": [*results.names, MANIFEST],
                "sha256": results.digests(),
            }
            results.commit(encode(self.record | listed))


def check(model: Model | str | Path) -> Examination:
    """Examine the start of a model: its constraints, their rank, its admissibility.

    Parameters
    ----------
    model : Model, str or Path
        A model from `load`, the path of a model file, or the text of one: a string
        with a line break.

    Returns
    -------
    Examination

    Raises
    ------
    InputError
        If the model has faults, or names a method or a formulation that cannot handle
        the model.

    Examples
    --------
    >>> import lagsim
    >>> rod = '''
    ... name: rod
    ... parameters: {l: 1, g: 9.81}
    ... coordinates: {x: {}, y: {}}
    ... energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: g*y}
    ... constraints: {length: sqrt(x^2 + y^2) = l}
    ... initial: {x: 0.6, y: -0.8}
    ... simulation: {duration: 0.5}
    ... '''
    >>> found = lagsim.check(rod)
    >>> found
    <Examination of rod: admissible, 1 degree of freedom>
    >>> found.admissible, found.rank
    (True, 1)
    """
    case, choices = session.check(model_of(model))
    return Examination(examination(case.equations, case.examined, choices))


@with_settings()
def simulate(
    model: Model | str | Path,
    *,
    error_bar: Literal["auto", "always", "never"] = "auto",
    **options: Unpack[SimulationOptions],
) -> Result:
    """Integrate a model. Options replace the keys of the model's `simulation`.

    Options that are numbers can also be expressions of the model's parameters:
    `duration="2*pi/w"`.

    Parameters
    ----------
    model : Model, str or Path
        A model from `load`, the path of a model file, or the text of one: a string
        with a line break.
    error_bar
        When the run is repeated with a smaller tolerance to estimate its error:
        `"always"`, `"never"`, or `"auto"`: if the repeat takes no more than about 2 s.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the model has faults, or an option does not fit the model.
    InadmissibleError
        If the start is not admissible.

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
    >>> result = lagsim.simulate(model, duration=0.25, method="dop853")
    >>> result
    <Result of drop: done, t = 0 to 0.25, 1001 rows>
    >>> round(float(result["y"][-1]), 9)
    0.6934375
    >>> result.error.relative < 1e-9
    True
    """
    given_options = given(options)
    bars = one_of("error_bar", error_bar, ErrorBars)
    clock, keep = Stopwatch(), Keep()
    with in_python():
        read = model_of(model)
        settings = settings_of(
            read, "simulate", given_options, hint="add it, or give `duration`"
        )
        clock.lap("read")
        try:
            ready = open_case(read, settings, clock=clock).ready(clock=clock)
        except StartError as error:
            found = Examination(examination(error.equations, error.examined))
            raise InadmissibleError(str(error), found) from None
        more = _appended(read, settings, given_options, None)
    attempts = Attempts(
        keep, Interrupt(), clock, error_bars=bars,
        replaces=bars is not ErrorBars.NEVER,
        records=Records(cornered=True, appended=more),
    )  # fmt: skip
    made = attempts.best(ready)
    again = partial(_appended, read, settings, given_options)
    return Result(made, keep.table, clock.timings, again)


def _appended(
    model: Read,
    settings: Settings,
    options: Mapping[str, float | str],
    times: Floats | None,
) -> Appended | None:
    """Return the columns of sensitivities and standard deviations; None if none.

    settings : settings of the run.
    options : options that replace settings of the file.
    times : (k,), times of the values, by default the output times.
    """
    names = model.output.sensitivities
    if not names and not any(p.uncertainty for p in model.parameters):
        return None
    from lagsim.studies.sensitivities import appended

    return appended(model, settings, names, options, times=times, caller="simulate")
