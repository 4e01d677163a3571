"""The pictures of a run: energy, trajectory, constraint forces, the model's plots."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.outputs.axis import noise_axis, power_of_ten, value_axis
from lagsim.outputs.panel import Panel
from lagsim.outputs.scene_panel import Paths, ScenePanel, dotted
from lagsim.outputs.sheet import BLACK, PENS, WIDTH, Sheet, fitted, in_house_style, png
from lagsim.outputs.time_panels import (
    LEFT,
    MOST_PANELS,
    RIGHT,
    Record,
    above,
    chosen,
    grouped,
    header,
    header_height,
    height_of,
    layout,
    legend_above,
    marks,
    panels,
    side_label,
    single,
    ticks,
    time_label,
)
from lagsim.run.observers.thinning import DRIFT

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lagsim.model.model import Model, Plot, Scene


@in_house_style
def energy(record: Record, *, is_sum: bool) -> Sheet:
    """Draw the energies, and below them how far energy - work strays from its start.

    Parameters
    ----------
    record : its rows have `energy` and `kinetic`, `potential` or `lagrangian`, and
        the difference `DRIFT` where there is a column `work`.
    is_sum : whether the energy is T + V, and not another energy function.
    """
    top = header_height(record) + 0.26
    width = WIDTH - LEFT - RIGHT
    sheet = Sheet(WIDTH, top + 2.2 + 0.36 + 1.1 + 0.45)
    header(sheet, record, "energy")
    total = "energy T + V" if is_sum else "energy function h = Σ q′ ∂L/∂q′ − L"
    named = {"kinetic": "kinetic T", "potential": "potential V"}
    named |= {"lagrangian": "lagrangian L", "energy": total}
    names = [name for name in named if name in record.rows]
    pens = [*PENS[: len(names) - 1], BLACK]
    series = [record.rows.series(name) for name in names]
    time = record.time()
    upper = Panel(
        sheet, (LEFT, top, width, 2.2), time, value_axis(*(v for _, v in series))
    )
    marks(upper, record)
    for (t, values), pen in zip(series, pens, strict=True):
        upper.series(t, values, pen)
    upper.frame(ticks(width, 2.2), numbers_below=False)
    side_label(upper, upper.y.label("energy", record.unit("energy")))
    legend_above(upper, [(named[n], p) for n, p in zip(names, pens, strict=True)])
    _drift(sheet, record, upper)
    return sheet


def _drift(sheet: Sheet, record: Record, upper: Panel) -> None:
    ledger = DRIFT if DRIFT in record.rows else "energy"
    t, values = record.rows.series(ledger)
    drift = values - (values[0] if len(values) else 0.0)
    size = max(height_of(record.rows.series("energy")[1]), height_of(values))
    place = (upper.left, upper.bottom + 0.36, upper.width, 1.1)
    lower = Panel(sheet, place, upper.x, noise_axis(drift, size))
    marks(lower, record)
    lower.series(t, drift, BLACK)
    lower.frame(ticks(place[2], place[3]))
    side_label(lower, lower.y.label("drift", record.unit("energy")))
    what = "energy − work" if ledger == DRIFT else "energy"
    worst = height_of(drift)
    most = f"at most {_written(worst)}" if worst else "0 in every row"
    unit = record.unit("energy") if worst else ""
    above(lower, f"{what} minus its first value: {most} {unit}".rstrip())
    time_label(lower, record)


def _written(value: float) -> str:
    """Return a size in two digits, as one writes it by hand."""
    digits, exponent = f"{value:.1e}".split("e")
    power = int(exponent)
    return f"{digits} × {power_of_ten(power)}" if power else digits


@in_house_style
def trajectory(record: Record, coordinates: Sequence[str], scene: Scene) -> Sheet:
    """Draw the coordinates against time, and the paths of the scene's points."""
    shown = chosen(coordinates, MOST_PANELS)
    groups = grouped(record, shown)
    paths = Paths.of(record, scene)
    views = ScenePanel(paths) if paths else None
    top = header_height(record)
    below = top + layout(groups).total
    sheet = Sheet(WIDTH, below + (views.height if views else 0.0))
    header(sheet, record, _counted("coordinates", len(shown), len(coordinates)))
    panels(sheet, top, record, groups)
    if views:
        views.draw(sheet, below)
    return sheet


@in_house_style
def constraint_forces(
    record: Record, coordinates: Sequence[str], constraints: Sequence[str]
) -> Sheet:
    """Draw the constraint force on each coordinate, and each multiplier."""
    forces = [f"Qc_{name}" for name in coordinates]
    multipliers = [f"lambda_{name}" for name in constraints]
    total = len(forces) + len(multipliers)
    most = max(1, MOST_PANELS * len(forces) // total)
    shown = chosen(forces, MOST_PANELS if total <= MOST_PANELS else most)
    shown += chosen(multipliers, max(1, MOST_PANELS - len(shown)))
    groups = [single(record, name) for name in shown]
    top = header_height(record)
    sheet = Sheet(WIDTH, top + layout(groups).total)
    subject = "constraint forces Qc and multipliers lambda"
    header(sheet, record, _counted(subject, len(shown), total))
    panels(sheet, top, record, groups)
    return sheet


def _counted(subject: str, shown: int, total: int) -> str:
    return subject if shown == total else f"{subject}, {shown} of {total}"


@in_house_style
def plot(record: Record, number: int, wanted: Plot) -> Sheet:
    """Draw one entry of the model's `output.plots`, `number` counted from 0."""
    x_name, y_name = f"plot.{number}.x", f"plot.{number}.y"
    against_time = wanted.x_text.strip() == "t"
    # Against time the envelope keeps spikes; other curves need both values of a row.
    x, y = (
        record.rows.series(y_name) if against_time else record.rows.path(x_name, y_name)
    )
    top = header_height(record) + (0.2 if wanted.title else 0.06)
    size = (WIDTH - LEFT - RIGHT, 3.6)
    sheet = Sheet(WIDTH, top + size[1] + 0.45)
    header(sheet, record, "", timed=against_time)
    x_axis = record.time() if against_time else value_axis(x, margin=0.03)
    panel = Panel(sheet, (LEFT, top, *size), x_axis, value_axis(y))
    if against_time:
        marks(panel, record)
        panel.series(x, y, PENS[0])
    elif dotted(panel.across(x), panel.down(y)):
        panel.path(x, y, replace(PENS[0], marker="."), record.trusted())
    else:
        panel.path(x, y, PENS[0], record.trusted())
    panel.frame(ticks(*size))
    if wanted.title:
        above(panel, wanted.title)
    side_label(panel, panel.y.label(wanted.y_text, record.unit(y_name)))
    unit = record.unit("t" if against_time else x_name)
    label = fitted(panel.x.label(wanted.x_text, unit), panel.width)
    sheet.text(LEFT + size[0] / 2, panel.bottom + 0.31, label, align="center")
    return sheet


def pictures(
    record: Record, model: Model, *, energy_is_sum: bool
) -> Iterator[tuple[str, bytes]]:
    """Give file name and content of every picture of a run, one after the other."""
    # While one is drawn, the one before it is packed: zlib needs no interpreter.
    with ThreadPoolExecutor(1) as packer:
        before: tuple[str, Future[bytes]] | None = None
        for name, sheet in _sheets(record, model, is_sum=energy_is_sum):
            packing = packer.submit(png, sheet.pixels())
            if before:
                yield before[0], before[1].result()
            before = name, packing
        if before:
            yield before[0], before[1].result()


def _sheets(
    record: Record, model: Model, *, is_sum: bool
) -> Iterator[tuple[str, Sheet]]:
    coordinates = [coordinate.name for coordinate in model.coordinates]
    yield "energy.png", energy(record, is_sum=is_sum)
    yield "trajectory.png", trajectory(record, coordinates, model.scene)
    if model.constraints:
        names = [constraint.name for constraint in model.constraints]
        yield "constraint_forces.png", constraint_forces(record, coordinates, names)
    for number, wanted in enumerate(model.output.plots):
        yield f"plot_{number + 1}.png", plot(record, number, wanted)
