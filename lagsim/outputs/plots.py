"""The pictures of a run: energy, trajectory, constraint forces, the model's plots."""

from __future__ import annotations

import gc
from functools import partial
from typing import TYPE_CHECKING

from lagsim.native.link import ahead
from lagsim.outputs.attempted import attempted
from lagsim.outputs.curves import series
from lagsim.outputs.plot_panel import PlotPanel
from lagsim.outputs.record import LEFT, REACH, RIGHT, Record, header, header_height
from lagsim.outputs.scale import NOISE, noise_scale, power_of_ten, spread_scale
from lagsim.outputs.scene_panel import ScenePanel
from lagsim.outputs.sheet import (
    BLACK,
    LINE,
    PENS,
    SMALL,
    WIDTH,
    Place,
    Sheet,
    in_house_style,
)
from lagsim.outputs.time_panels import (
    IMPULSE,
    MOST_PANELS,
    Panels,
    chosen,
    grouped,
    height_of,
    tell,
)
from lagsim.run.observers.thinning import DRIFT

# Panels are above each other up to so many; the least that they take with a view of the
# scene beside them, in inches.
STACKED, BESIDE = 5, 3.3
# The picture that takes longest.
LONG = "trajectory"

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.model.model import Model, Plot, Scene
    from lagsim.outputs.attempted import Made


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
    sheet = record.sheet(WIDTH, top + 2.2 + 0.36 + 1.1 + 0.45)
    header(sheet, record, "energy")
    total = "energy T + V" if is_sum else "energy function h = Σ q̇ ∂L/∂q̇ − L"
    named = {"kinetic": "kinetic T", "potential": "potential V"}
    named |= {"lagrangian": "lagrangian L", "energy": total}
    names = [name for name in named if name in record.rows]
    pens = dict(zip(names, (*PENS[: len(names) - 1], BLACK), strict=True))
    drawn = {name: record.rows.series(name) for name in names}
    values = spread_scale(*drawn.values())
    side = ("energy", record.unit("energy"))
    place = (LEFT, top, width, 2.2)
    axes = sheet.panel(place, record.time(), values, side=side, reach=REACH)
    record.mark(axes)
    for name in names:
        series(axes, *drawn[name], pens[name])
    tell(sheet, place, values, list(drawn.values()))
    entries = [(named[name], pens[name]) for name in names]
    sheet.legend(LEFT, top - 0.06, entries, width)
    _drift(sheet, record, (LEFT, top + 2.56, width, 1.1))
    return sheet


def _drift(sheet: Sheet, record: Record, place: Place) -> None:
    ledger = DRIFT if DRIFT in record.rows else "energy"
    t, values = record.rows.series(ledger)
    drift = values - (values[0] if len(values) else 0.0)
    size = max(height_of(record.rows.series("energy")[1]), height_of(values))
    unit = record.unit("energy")
    axes = sheet.panel(
        place, record.time(), noise_scale(drift, size), below=record.named("t"),
        side=("drift", unit), reach=REACH,
    )  # fmt: skip
    record.mark(axes)
    series(axes, t, drift, BLACK)
    what = "energy − work" if ledger == DRIFT else "energy"
    worst = height_of(drift)
    most = f"at most {_written(worst)} {unit}" if worst else "0 in every row"
    text = f"{what} minus its first value: {most}".rstrip()
    sheet.text(LEFT, place[1] - 0.06, text, size=SMALL, room=place[2])


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
    views = ScenePanel(record, scene, narrow=len(groups) <= STACKED)
    panels = Panels(record, groups, BESIDE if views.beside else 0.0)
    if views.beside:
        panels.leave(views.width_for(panels.tall))
    top = header_height(record)
    sheet = record.sheet(WIDTH, top + panels.total + views.height)
    header(sheet, record, _counted("coordinates", len(shown), len(coordinates)))
    panels.draw(sheet, top)
    if not views.empty:
        views.draw(sheet, top + panels.total, top + panels.gap)
    return sheet


@in_house_style
def constraint_forces(
    record: Record, coordinates: Sequence[str], constraints: Sequence[str]
) -> Sheet:
    """Draw the constraint force on each coordinate, each multiplier and impulse."""
    forces = [f"Qc_{name}" for name in coordinates]
    multipliers = [f"lambda_{name}" for name in constraints]
    columns = record.rows.columns
    multipliers += [name for name in columns if name.startswith("friction.")]
    impulses = [name for name in columns if name.startswith(IMPULSE)]
    total = len(forces) + len(multipliers) + len(impulses)
    families = _acting(record, (forces, multipliers, impulses))
    acting = sum(len(names) for names in families)
    left = sum(len(names) for names in families)
    shown: list[str] = []
    for names in families:
        room = MOST_PANELS - len(shown)
        shown += chosen(
            names, room if left <= room else max(1, room * len(names) // left)
        )
        left -= len(names)
    panels = Panels(record, [(name,) for name in shown], paired=True)
    top = header_height(record)
    sheet = record.sheet(WIDTH, top + panels.total)
    subject = "constraint forces Qc and multipliers λ"
    if families[2]:
        subject = "constraint forces and impulses"
    if acting < total:
        header(sheet, record, f"{subject}; {total - acting} more are 0")
    else:
        header(sheet, record, _counted(subject, len(shown), total))
    panels.draw(sheet, top)
    return sheet


def _acting(
    record: Record, families: Sequence[Sequence[str]]
) -> Sequence[Sequence[str]]:
    """Return the columns that are not 0 beside others of their unit, else the first."""
    sizes: dict[str, dict[str, float]] = {}
    for name in (name for names in families for name in names):
        of_unit = sizes.setdefault(record.unit(name), {})
        of_unit[name] = height_of(record.rows.series(name)[1])
    acting = {
        name
        for own in sizes.values()
        for name, size in own.items()
        if size > NOISE * max(own.values())
    }
    found = [[name for name in names if name in acting] for names in families]
    return found if acting else [families[0][:1], [], []]


def _counted(subject: str, shown: int, total: int) -> str:
    return subject if shown == total else f"{subject}: {shown} of {total} are shown"


@in_house_style
def plot(record: Record, number: int, wanted: Plot, scene: Scene) -> Sheet:
    """Draw one entry of the model's `output.plots`, `number` counted from 0."""
    panel = PlotPanel(record, number, wanted, scene)
    top = header_height(record, timed=panel.timed)
    lines = [LINE for shown in (wanted.title, len(panel.pens()) > 1) if shown]
    top += 0.06 + sum(lines)
    sheet = record.sheet(panel.width, top + panel.height)
    header(sheet, record, "", timed=panel.timed)
    if wanted.title:
        at = top - 0.06 - (LINE if len(lines) > 1 else 0.0)
        sheet.text(LEFT, at, wanted.title, size=SMALL, room=panel.width - LEFT - RIGHT)
    panel.draw(sheet, top)
    return sheet


def pictures(record: Record, model: Model, is_sum: bool) -> Iterator[Made]:
    """Give file name and content of every picture of a run, one after the other."""
    files = dict(_files(record, model, is_sum=is_sum))
    if ahead.may_send():
        # The one that takes as long as all others.
        files[LONG] = ahead.bring(files[LONG])
    for key, file in files.items():
        name = f"{key}.{record.form}"
        yield name, attempted(name, file)
        # A figure holds the pixels that it was drawn on, some megabytes, and itself.
        if not gc.isenabled():  # see `cli.entry`
            gc.collect(0)


def _files(
    record: Record, model: Model, *, is_sum: bool
) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Give what makes the file of each picture, by its name."""
    for name, draw in _drawings(record, model, is_sum=is_sum):
        yield name, partial(_file, draw)


def _file(draw: Callable[[], Sheet]) -> bytes:
    return draw().content()


def _drawings(
    record: Record, model: Model, *, is_sum: bool
) -> Iterator[tuple[str, Callable[[], Sheet]]]:
    """Give what draws each picture, by its name."""
    coordinates = [coordinate.name for coordinate in model.coordinates]
    yield "energy", partial(energy, record, is_sum=is_sum)
    yield LONG, partial(trajectory, record, coordinates, model.scene)
    if model.constraints:
        names = [constraint.name for constraint in model.constraints]
        forces = partial(constraint_forces, record, coordinates, names)
        yield "constraint_forces", forces
    for number, wanted in enumerate(model.output.plots):
        one = partial(plot, record, number, wanted, model.scene)
        yield f"plot_{number + 1}", one
