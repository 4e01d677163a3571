"""Pictures of modes and of frequency responses."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.animation import NAME, record
from lagsim.outputs.animation import page as written
from lagsim.outputs.figure import (
    INK,
    PENS,
    SMALL,
    Picture,
    encoded_figure,
    in_house_style,
    line,
    marker_pen,
    stack_height,
)
from lagsim.outputs.letters import letters_of, mathtext
from lagsim.outputs.scale import log_scale, name_axis, read_off
from lagsim.outputs.stills import (
    EXTREMES,
    MIDDLE,
    Still,
    bars,
    displaced,
    film_at,
    stills,
)
from lagsim.studies.modes import logarithms, peaks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from matplotlib.axes import Axes

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.linearisation import EigenMode
    from lagsim.studies.modes import FrequencyResponse, SmallMotions

# Frames of a cycle on a page, cycles, duration of a cycle in s; largest number of
# modes.
FRAMES, CYCLES, SECONDS, MOST_PLAYED = 48, 4, 2.0, 12
# Phases of a mode that are drawn: at its two extremes.
PHASES = np.array([0.0, np.pi])
# Damping below which a peak is at the frequency of its mode.
UNDAMPED = 1e-3
AMPLITUDE, PHASE = 2.4, 1.3


def drawings(
    small: SmallMotions,
    response: FrequencyResponse | None,
    form: str = "png",
    *,
    plots: bool = True,
) -> dict[str, Callable[[], bytes]]:
    """Return the functions that draw the pictures and the page, by file name.

    Each returns the content of its file.

    plots : whether there are pictures.
    """
    found: dict[str, Callable[[], bytes]] = {}
    if plots:
        found[f"modes.{form}"] = partial(picture, small, form)
    if plots and response is not None:
        found[f"response.{form}"] = partial(bode, small, response, form)
    return {**found, NAME: partial(page, small)}


def titled(number: int, mode: EigenMode) -> str:
    """Return the title of a mode: its number, frequency and damping."""
    if mode.frequency > 0.0:
        text = f"{number}:  {mode.frequency:.4g} Hz"
        ratio = mode.damping_ratio
        text += f",  ζ = {ratio:.3g}" if abs(ratio) > 1e-9 else ""
    else:
        text = f"{number}:  {mode.eigenvalue.real:.4g} 1/s"
    return text + ("" if mode.stable else ",  grows")


def picture(small: SmallMotions, form: str = "png") -> bytes:
    """Return the picture of the shapes of all modes: modes.png."""
    model, steady = small.setting.model, small.steady
    e, values = steady.equations, steady.values
    panels = []
    for number, mode in enumerate(small.modes, 1):
        shape = dict(zip(e.q, mode.shape.tolist(), strict=True))
        displacements = displaced(model, values, shape, PHASES)
        with_rest = {
            name: np.append(x, values[name]) if isinstance(x, np.ndarray) else x
            for name, x in displacements.items()
        }
        film = film_at(model, with_rest, len(PHASES) + 1)
        panels.append(Still(titled(number, mode), film, (*EXTREMES, MIDDLE)))
    subject = "modes" if panels else "no modes"
    if panels and panels[0].film is None:
        curves = [
            (still.title, np.real(mode.shape))
            for still, mode in zip(panels, small.modes, strict=True)
        ]
        names = letters_of(model)
        listed = ", ".join(map(names.name, e.q[:6])) + (", …" if len(e.q) > 6 else "")
        return encoded_figure(bars(model.name, f"{subject}, by {listed}", curves), form)
    legend = [("one extreme", EXTREMES[0]), ("the other", EXTREMES[1])]
    found = stills(model.name, subject, panels, [*legend, ("at rest", MIDDLE)])
    return encoded_figure(found, form)


def bode(small: SmallMotions, response: FrequencyResponse, form: str = "png") -> bytes:
    """Return the picture of amplitudes and phases against frequency: response.png."""
    modes = [x.frequency for x in small.modes if abs(x.damping_ratio) < UNDAMPED]
    return encoded_figure(_bode(small.setting.model.name, response, modes), form)


@in_house_style
def _bode(name: str, response: FrequencyResponse, undamped: Sequence[float]) -> Picture:
    f, pairs = response.frequencies, response.pairs
    pens = {key: PENS[k % len(PENS)] for k, key in enumerate(pairs)}
    legend = [(key.replace(":", " → "), pen) for key, pen in pens.items()]
    height = stack_height(1, AMPLITUDE) + stack_height(1, PHASE)
    picture = Picture(height, name, "frequency response", legend=legend)
    above, below = picture.subplots(2, height_ratios=[AMPLITUDE, PHASE], sharex=True)
    amplitudes = {key: np.abs(x) for key, x in pairs.items()}
    known = [a[a > 0.0] for a in amplitudes.values() if np.any(a > 0.0)]
    above.set_xscale("log")
    if known:
        log_scale(*known, margin=0.15).apply(above, "y")
    for key, pen in pens.items():
        line(above, f, amplitudes[key], pen)
        degrees = np.degrees(np.angle(pairs[key]))
        jumps = np.abs(np.diff(degrees, prepend=degrees[:1])) > 270.0
        line(below, f, np.where(jumps, np.nan, degrees), pen)
    below.set_ylim(-195.0, 195.0)
    below.set_yticks([-180, -90, 0, 90, 180])
    above.set_xlim(f[0], f[-1])
    _label_peaks(above, f, [amplitudes[key] for key in pens], undamped)
    name_axis(above.yaxis, "amplitude", "")
    name_axis(below.yaxis, "phase", "°")
    name_axis(below.xaxis, "frequency", "Hz")
    return picture


def _label_peaks(
    axes: Axes, f: Floats, curves: Sequence[Floats], undamped: Sequence[float]
) -> None:
    """Label the largest peaks, and the deepest valleys, with their frequencies.

    The peak at an undamped mode is infinite; its label has the frequency of the mode.
    Labels of several curves are stacked where they would overlap, equal ones written
    once. The limits of the axes are known.

    f : (k,), frequencies.
    curves : of amplitudes (k,).
    undamped : frequencies of undamped modes.
    """
    width, height = 0.6 * SMALL, 1.25 * SMALL  # of a letter, in points
    points = 72.0 / axes.figure.dpi
    placed: list[tuple[float, float, float, str]] = []
    found = [x for amplitude in curves for x in _peaks(f, amplitude, undamped)]
    for x, y, label, below in sorted(found, key=lambda peak: -peak[1]):
        axes.plot(x, y, **marker_pen("o", 2.6, INK))
        across, up = axes.transData.transform((x, y)) * points
        offset, step = (-9.0, -height) if below else (4.0 + height / 2, height)
        half = width * len(label) / 2
        beside = [p for p in placed if abs(p[0] - across) < p[2] + half]
        if any(text == label for *_, text in beside):
            continue
        while any(abs(at - up - offset) < height for _, at, _, _ in beside):
            offset += step
        placed.append((across, up + offset, half, label))
        axes.annotate(
            mathtext(label), (x, y), (0.0, offset), textcoords="offset points",
            size=SMALL, ha="center", va="center",
        )  # fmt: skip


def _peaks(
    f: Floats, amplitude: Floats, undamped: Sequence[float]
) -> Iterator[tuple[float, float, str, bool]]:
    """Yield frequency, amplitude and label of peaks, and whether each is a valley.

    f, amplitude : (k,), frequencies and amplitudes.
    undamped : frequencies of undamped modes.
    """
    logs = logarithms(amplitude)
    for values, below in ((logs, False), (-logs, True)):
        for k in peaks(values):
            own = (x for x in undamped if f[k - 1] <= x <= f[k + 1] and not below)
            label = f"{read_off(next(own, float(f[k])))} Hz"
            yield float(f[k]), float(amplitude[k]), label, below


def page(small: SmallMotions) -> bytes:
    """Return the page that plays all modes, with one cycle of each in two seconds."""
    model, steady = small.setting.model, small.steady
    t = np.linspace(0.0, CYCLES * SECONDS, CYCLES * FRAMES + 1)
    films = []
    for number, mode in enumerate(small.modes[:MOST_PLAYED], 1):
        shape = dict(zip(steady.equations.q, mode.shape.tolist(), strict=True))
        phases = 2.0 * np.pi * t / SECONDS
        displacements = displaced(model, steady.values, shape, phases)
        film = film_at(model, displacements, len(t), t, titled(number, mode))
        if film is not None:
            films.append(record(film))
    title = f"{model.name}: modes, each at one cycle in {SECONDS:g} s"
    return written(films, title)
