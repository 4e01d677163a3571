"""Several results in one picture with common axes, and on one page with one clock.

The pictures show columns of the tables in the folders, and the page plays the pages in
the folders. For a run without a page, the point (x, y) or (x, y, z) is played if its
table has these columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import orjson

from lagsim import files
from lagsim.codes.known import NO_COLUMN, NO_RESULTS
from lagsim.errors import Problems, did_you_mean, unusable
from lagsim.language.columns import DEVIATION
from lagsim.language.names import member_hint, rate_of, rated
from lagsim.notes import Event
from lagsim.outputs import animation
from lagsim.outputs.animation import film_of_columns, page_units
from lagsim.outputs.letters import raised_powers
from lagsim.outputs.results import MANIFEST
from lagsim.studies.tables import StoredTable, of_another_run, read_results, thinned

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from lagsim.outputs.plot_data import Band
    from lagsim.run.observers.thinning import Thinning

    Document = dict[str, Any]


# Largest numbers of columns that are shown by default, and of parameters that a name
# shows.
MOST_COLUMNS, MOST_NAMED = 4, 2
# Models that a title names.
MOST_MODELS = 3


class OverlaidRun(NamedTuple):
    """Result of a run: its label, its folder, `record` (run.json), and its table."""

    label: str
    folder: Path
    record: Document
    table: StoredTable

    @property
    def model(self) -> str:
        """Name of the model; the name of the folder without a run.json."""
        named = self.record.get("model")
        name = named.get("name") if isinstance(named, dict) else None
        return str(name or self.folder.resolve().name)

    @property
    def horizon(self) -> float:
        """The horizon of the run: the time past which the rows are no forecast."""
        found = (self.record.get("error") or {}).get("horizon")
        return np.inf if found is None else float(found)


def read(folders: Sequence[Path]) -> list[OverlaidRun]:
    """Read results, and label each with a distinct name.

    Raises
    ------
    InputError
        With a problem for each folder that holds no results.
    """
    records: list[Document] = []
    tables: list[StoredTable] = []
    problems = Problems()
    for folder in folders:
        with problems.gathered():
            records.append(_record(folder))
            tables.append(read_results(folder))
    problems.refuse()
    labels = _labels(folders, records)
    found = zip(labels, folders, records, tables, strict=True)
    return [OverlaidRun(*each) for each in found]


def _record(folder: Path) -> Document:
    try:
        record = orjson.loads(files.content(folder / MANIFEST))
    except FileNotFoundError:
        text = f"{folder} is not there"
        if folder.exists():
            text = f"{folder} contains no results: there is no {MANIFEST} in it"
        hint = f"`lagsim run MODEL -o {folder}` makes it"
        raise unusable(NO_RESULTS, text, hint=hint) from None
    except OSError as error:
        why = f"{folder / MANIFEST} cannot be read: {error.strerror}"
        raise unusable(NO_RESULTS, why) from None
    except ValueError:
        record = None
    if not isinstance(record, dict) or "columns" not in record:
        why = f"{folder / MANIFEST} is not a run.json of lagsim"
        raise unusable(NO_RESULTS, why)
    return record


def _labels(folders: Sequence[Path], records: Sequence[Document]) -> list[str]:
    """Return a label for each result: its folder, with the parameters that differ.

    records : the contents of run.json.
    """
    names = [folder.resolve().name for folder in folders]
    if len(set(names)) < len(names):
        names = [str(folder) for folder in folders]
    every = [r.get("parameters") or {} for r in records]
    differ = _differing(every)
    labels = []
    for name, each in zip(names, every, strict=True):
        varied = [f"{p} = {each[p]:.6g}" for p in differ[:MOST_NAMED]]
        labels.append(f"{name} ({', '.join(varied)})" if varied else name)
    # A folder may be given twice.
    return [
        label if labels.index(label) == k else f"{label} #{k + 1}"
        for k, label in enumerate(labels)
    ]


def _common(runs: Sequence[OverlaidRun]) -> list[str]:
    """Return the columns that all results have."""
    others = [set(run.table.columns) for run in runs]
    return [c for c in runs[0].table.columns if all(c in x for x in others)]


def _differing(every: Sequence[Mapping[str, float]]) -> list[str]:
    """Return the parameters that all results have and that differ between them.

    every : the parameters of each result, by name.
    """
    common = set.intersection(*(set(each) for each in every))
    return [
        name
        for name in every[0]
        if name in common and len({each[name] for each in every}) > 1
    ]


def title(runs: Sequence[OverlaidRun]) -> str:
    """Return the title: the names of the models, shortened if there are many."""
    models = list(dict.fromkeys(run.model for run in runs))
    named = ", ".join(models[:MOST_MODELS])
    return f"{named} and others" if len(models) > MOST_MODELS else named


def _order(runs: Sequence[OverlaidRun]) -> tuple[str, list[float]]:
    """Return name and values, one for each run, of the quantity that colours show.

    It is the only parameter that differs, or the only start value that differs, or else
    the number of the run.
    """
    every = [run.record.get("parameters") or {} for run in runs]
    differ = _differing(every)
    if len(differ) == 1:
        return differ[0], [float(each[differ[0]]) for each in every]
    common = _common(runs)
    moving = [c for c in common if rate_of(c) in common]
    starts = {
        name: [float(run.table[name][0]) for run in runs]
        for c in moving
        for name in (c, rate_of(c))
    }
    varied = [name for name, values in starts.items() if len(set(values)) > 1]
    if not differ and len(varied) == 1 and np.isfinite(starts[varied[0]]).all():
        unit = raised_powers(runs[0].table.units.get(varied[0], ""))
        label = f"{varied[0]} at the start" + f" ({unit})" * bool(unit)
        return label, starts[varied[0]]
    return "run", [float(k + 1) for k in range(len(runs))]


def shown_columns(
    runs: Sequence[OverlaidRun], names: Sequence[str] | None = None
) -> list[str]:
    """Return the columns to show: named ones, or the coordinates that all runs have.

    Raises
    ------
    InputError
        With a problem for each run that lacks a named column, or if the runs have no
        column in common.
    """
    if names is None:
        found = [c for c in _common(runs) if rate_of(c) in runs[0].table.columns]
        found = [c for c in found if not rated(c)[1]]
        if found:
            return found[:MOST_COLUMNS]
        text = "these results have no coordinate in common"
        raise unusable(NO_COLUMN, text, hint="name columns: --columns x")
    problems = Problems()
    for run in runs:
        for name in names:
            if name == "t" or name not in run.table.columns:
                others = run.table.columns[1:]
                hint = member_hint(name, others) or did_you_mean(name, others)
                if name == "t" or not hint:
                    hint = f"there are {', '.join(others)}"
                text = f"{run.folder} has no column `{name}`"
                if name == "t":
                    text = "the column `t` is the axis of the others"
                problems.add(NO_COLUMN, text, hint=hint)
    problems.refuse()
    return list(dict.fromkeys(names))


def picture(
    runs: Sequence[OverlaidRun], columns: Sequence[str], form: str = "png"
) -> bytes:
    """Draw columns of all runs on common axes; return a PNG, SVG or PDF."""
    from lagsim.outputs.figure import encoded_figure
    from lagsim.outputs.plots import overlay

    names = ("t", *columns)
    rows = {x.label: thinned({name: x.table[name] for name in names}) for x in runs}
    units = {}
    for name in names:
        known = {run.table.units.get(name, "") for run in runs} - {""}
        units[name] = " or ".join(sorted(known))
    remarks = [remark for run in runs for remark in run.table.remarks]
    bands = {run.label: _bands(run.table, columns, rows[run.label]) for run in runs}
    drawn = overlay(title(runs), rows, units, remarks, _order(runs), bands)
    return encoded_figure(drawn, form)


def _bands(
    table: StoredTable, columns: Sequence[str], rows: Thinning
) -> dict[str, Band]:
    """Return the bands of one standard deviation of columns, by name.

    A column without standard deviations has none.

    rows : the thinned rows of the table.
    """
    found = {}
    for name in columns:
        if DEVIATION.of(name) in table.columns:
            t, values = rows.series(name)
            # Both rows of an impact are unknown.
            deviation = table[DEVIATION.of(name)][np.searchsorted(table.t, t)]
            found[name] = t, values - deviation, values + deviation
    return found


def motions(runs: Sequence[OverlaidRun]) -> tuple[list[Document], list[str]]:
    """Return the motions of all runs as data for a page, and notes on runs without one.

    Each motion is a document as of `animation.record`, with the label of the run.
    """
    found: list[Document] = []
    notes: list[str] = []
    for run in runs:
        pages = _recorded(run)
        if not pages:
            film = _film(run)
            pages = [] if film is None else [animation.record(film)]
        if not pages:
            notes.append(
                f"{run.folder} has nothing to draw: neither {animation.NAME} "
                "(`lagsim run --animate` adds it) nor columns x and y"
            )
        found += [page | {"name": run.label} for page in pages[:1]]
    return found, notes


def _recorded(run: OverlaidRun) -> list[Document]:
    """Return the motions in the animation.html of a run; [] if there is none.

    Each is a document as of `animation.record`.
    """
    if animation.NAME not in run.record.get("files", ()):
        return []
    try:
        if of_another_run(run.folder, animation.NAME, run.record):
            return []
        content = files.content(run.folder / animation.NAME).decode()
    except (OSError, ValueError, AttributeError):
        return []
    return animation.recorded(content) or []


def _film(run: OverlaidRun) -> animation.Film | None:
    table = run.table
    columns = dict(zip(table.columns, table.data, strict=True))
    known = table.units
    lengths = {known.get(axis, "") for axis in "xyz"}
    events = [
        Event(float(e["time"]), str(e["kind"]), e.get("constraint"))
        for e in run.record.get("events", ())
    ]
    return film_of_columns(
        run.label, columns, events, horizon=run.horizon,
        units=page_units(lengths, known.get("energy", "")), notes=table.remarks,
    )  # fmt: skip
