"""Measured data, and the expressions of the model that they measure."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim import files
from lagsim.codes.known import BAD_DATA, UNKNOWN_NAME, USAGE
from lagsim.errors import InputError, Place, Problem, Problems, did_you_mean, unusable
from lagsim.language.names import in_file, rate_of
from lagsim.model.model import DrawnExpression, Level, Plot
from lagsim.model.reader.sheets import read_sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from lagsim.language.arrays import Floats
    from lagsim.model.model import (
        Coordinate,
        Definition,
        FirstOrderState,
        Model,
        Settings,
    )

TIME = "t"
# Texts of a cell without a measurement.
GAPS = ("", "nan", "na", "-")
# The largest number of reported faults of a file.
MOST_FAULTS = 8


class Record(NamedTuple):
    """Data of one file, or of one table in Python.

    Attributes
    ----------
    name : str
        The path, or `data K`.
    columns : dict of str to ndarray, shape (k,)
        Every column by its name in the header; nan in cells without a number.
    place : callable
        (index of a row, name of a column) -> line and column in the file of that cell;
        row -1 is the header. None where there is no file.
    texts : dict of str to list of int
        Rows of the cells of a column that contain a text.
    """

    name: str
    columns: dict[str, Floats]
    place: Callable[[int, str], Place | None]
    texts: Mapping[str, Sequence[int]] = {}

    @property
    def times(self) -> Floats:
        """The times, shape (k,)."""
        return self.columns[TIME]


class Match(NamedTuple):
    """Column of the data with the expression that it measures.

    Attributes
    ----------
    column : str
        The column of the data.
    text : str
        The expression.
    deviation : float
        Standard deviation of the measurement; 0 where it is estimated.
    unit : str
    """

    column: str
    text: str
    deviation: float = 0.0
    unit: str = ""


# --- Reading


def read_record(path: Path) -> Record:
    """Return the data of a CSV file.

    Raises
    ------
    InputError
        If the file cannot be read, or has no usable times.
    """
    name = str(path)
    try:
        text = files.content(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", "") or "it is no text in UTF-8"
        raise unusable(BAD_DATA, f"{name}: {why}") from None
    sheet = read_sheet(text)
    header, rows = sheet.header, sheet.rows[1:]
    first = sheet.rows[0] if sheet.rows else None

    def place(row: int, column: str) -> Place:
        own = rows[row] if row >= 0 else first
        if own is None:
            return Place(name, 1, 1)
        known = column in header
        where, length = sheet.span(own, header.index(column) if known else 0)
        return Place(name, own.number, where, length, own.line)

    faults = Problems()
    for column in dict.fromkeys(x for x in header if header.count(x) > 1):
        faults.add(BAD_DATA, f"two columns are named `{column}`", place(-1, column))
    for k, row in enumerate(rows):
        if excess := sheet.excess(row):
            faults.add(BAD_DATA, excess, place(k, TIME))
    faults[MOST_FAULTS:] = []
    faults.refuse()
    columns: dict[str, Floats] = {}
    texts: dict[str, list[int]] = {}
    for number, column in enumerate(header):
        cells = [row.cells[number] if number < len(row.cells) else "" for row in rows]
        columns[column] = np.array([sheet.number(cell) for cell in cells], dtype=float)
        found = np.flatnonzero(np.isnan(columns[column])).tolist()
        texts[column] = [k for k in found if cells[k].strip().lower() not in GAPS]
    record = Record(name, columns, place, texts)
    _check_times(record)
    return record


def record_of(name: str, columns: Mapping[str, Any]) -> Record:
    """Return the data of a mapping, or of a data frame: arrays by names of columns.

    Raises
    ------
    InputError
        If the columns differ in length, or there are no usable times.
    """
    found: dict[str, Floats] = {}
    for column in columns:
        try:
            values = np.asarray(columns[column], dtype=float).ravel()
        except (TypeError, ValueError):
            continue
        found[str(column)] = np.where(np.isfinite(values), values, np.nan)
    if len({len(x) for x in found.values()}) > 1:
        raise unusable(BAD_DATA, f"{name}: the columns differ in length")
    record = Record(name, found, lambda _row, _column: None)
    _check_times(record)
    return record


def _check_times(record: Record) -> None:
    """Raise an InputError where a time is missing or less than the time before it."""
    faults = Problems()

    def add(row: int, text: str, hint: str = "") -> None:
        place = record.place(row, TIME)
        where = f"{record.name}: row {row + 1}: " * (place is None and row >= 0)
        faults.add(BAD_DATA, where + text, place, hint)

    if TIME not in record.columns:
        near = did_you_mean(TIME, [x for x in record.columns if x.lower() == TIME])
        hint = near or "name the column of times `t` in the header"
        add(-1, f"{record.name}: no column `t`", hint)
        faults.refuse()
    times = record.times
    if not len(times):
        add(-1, f"{record.name} has no rows below its header")
    for row in np.flatnonzero(np.isnan(times)).tolist():
        add(row, "there is no time in this row", "delete the row, or give its time")
    known = np.flatnonzero(~np.isnan(times))
    for row in known[1:][np.diff(times[known]) < 0.0].tolist():
        text = f"the time {times[row]:g} is less than the time before it"
        add(row, text, "sort the rows by t, or give each experiment a file of its own")
    faults[MOST_FAULTS:] = []
    faults.refuse()


# --- Matching


def matched(
    model: Model, records: Sequence[Record], given: Mapping[str, str]
) -> tuple[Model, list[Match]]:
    """Match columns of the data with expressions; return model and matches.

    The model has a column of rows for the expression of each match.

    Parameters
    ----------
    model : Model
    records : sequence of Record
    given : mapping of str to str
        Stated matches: column of the data -> `EXPRESSION` or `EXPRESSION:SD`.

    Raises
    ------
    InputError
        If a column or a name is unknown, or a column has texts or no numbers.
    """
    every = dict.fromkeys(x for record in records for x in record.columns)
    own = _measurable(model)
    faults, matches, nodes = Problems(), list[Match](), list[int]()
    for column in given:
        if column not in every:
            hint = did_you_mean(column, every)
            hint = hint or f"the columns are {', '.join(x for x in every if x != TIME)}"
            text = f"--match {column}: the data have no such column"
            faults.add(UNKNOWN_NAME, text, hint=hint)
    for column in every:
        if column == TIME or not (column in given or column in own):
            continue
        text, deviation = _parsed(column, given.get(column, column), faults)
        with faults.gathered():
            # A member of a family has the name of its column here: `q.1`.
            formula = in_file(text) if text in own else text
            nodes.append(model.stated.compiled(formula, f"--match {column}="))
            matches.append(Match(column, text, deviation, own.get(text, "")))
        _check_cells(column, records, faults)
    if not matches and not faults:
        text = "no column of the data is a coordinate, rate or definition of the model"
        named = ", ".join(x for x in every if x != TIME) or "none beside t"
        hint = f"`--match COLUMN=EXPRESSION` says what a column measures: {named}"
        place = records[0].place(-1, TIME)
        faults.add(BAD_DATA, text, place, hint)
    faults.refuse()
    curves = tuple(
        DrawnExpression(node, one.text)
        for node, one in zip(nodes, matches, strict=True)
    )
    time = DrawnExpression(model.graph.variable(TIME), TIME)
    plots = (*model.output.plots, Plot(time, curves))
    return replace(model, output=model.output._replace(plots=plots)), matches


def columns_of(model: Model) -> list[str]:
    """Return the names of the columns that `matched` has added to the model's rows."""
    number = len(model.output.plots) - 1
    return [*model.output.plots[number].curves(number)][1:]


def _measurable(model: Model) -> dict[str, str]:
    """Return the quantities to which columns of data with their names are matched.

    The result maps the name of each quantity to its unit.
    """
    every: list[Coordinate | FirstOrderState | Definition] = [*model.coordinates]
    every += [*model.states, *model.definitions]
    moving = [d.name for d in model.definitions if d.level is Level.POSITION]
    moving += [c.name for c in model.coordinates]
    found = {x.name: x.unit for x in every}
    return found | {rate_of(x): found[x] and f"{found[x]}/s" for x in moving}


def _parsed(column: str, text: str, faults: Problems) -> tuple[str, float]:
    """Return the expression and the standard deviation in a text `EXPRESSION[:SD]`.

    column : the column, for messages.
    faults : to which faults are added.
    """
    expression, colon, after = text.partition(":")
    if not colon:
        return expression.strip(), 0.0
    try:
        deviation = float(after)
    except ValueError:
        deviation = math.nan
    if not 0.0 < deviation < math.inf:
        message = f"--match {column}={text}: after `:` a standard deviation is expected"
        faults.add(USAGE, message, hint=f"such as --match {column}={column}:0.01")
    return expression.strip(), deviation


def _check_cells(column: str, records: Iterable[Record], faults: Problems) -> None:
    """Report cells of a column that are no finite numbers; or that it has no numbers.

    At most `MOST_FAULTS` cells of each record are reported.

    faults : the list to which the faults are added.
    """
    for record in records:
        if column not in record.columns:
            continue
        for row in record.texts.get(column, ())[:MOST_FAULTS]:
            text = f"a cell of `{column}` is no finite number"
            hint = "an empty cell, or nan, is a gap"
            faults.add(BAD_DATA, text, record.place(row, column), hint)
        if np.all(np.isnan(record.columns[column])) and not record.texts.get(column):
            text = f"{record.name}: the column `{column}` has no numbers"
            faults.add(BAD_DATA, text, record.place(-1, column))


def check_span(
    records: Sequence[Record], clocks: Sequence[float], settings: Settings
) -> None:
    """Raise an InputError where times of the data lie outside the run.

    Parameters
    ----------
    clocks : sequence of float
        For each record, the time on its clock less the time of the run.
    """
    faults = []
    for record, clock in zip(records, clocks, strict=True):
        before_start = np.flatnonzero(record.times - clock < settings.start)
        after_end = np.flatnonzero(record.times - clock > settings.end)
        span = f"the run is from {settings.start:g} to {settings.end:g}"
        for rows, hint in (
            (before_start[:1], "leave out the rows before the start, or set `start`"),
            (after_end[:1], "make the run longer: `duration`"),
        ):
            for row in rows.tolist():
                text = f"t = {record.times[row]:g} is outside the run: {span}"
                place = record.place(row, TIME)
                where = "" if place else f"{record.name}: row {row + 1}: "
                faults.append(Problem(BAD_DATA, where + text, place, hint))
    if faults:
        raise InputError(faults)
