"""The spectrum of a column: how large a sine of each frequency is in it.

The rows less their mean are weighted by the window of F. J. Harris (Proceedings of the
IEEE 66 (1978), 51, four terms of Blackman and Harris), whose side lobes are below 3e-5
of a peak, so that a small peak beside a large one is one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.errors import unusable
from lagsim.tolerances import SAME_ROW, TINY

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from lagsim.language.arrays import Floats

WINDOW = "blackmanharris"
# Half the breadth of a peak of this window, in parts of 1/duration.
BREADTH = 4
# Frequencies lie closer than the rows tell apart, so that peaks have their height.
FINER = 4
LEAST_ROWS = 16
# Peaks are listed that are this part of the largest and stand out by half their height.
LEAST_PEAK, STANDS_OUT = 1e-4, 0.5
MOST_PEAKS = 8


class Peak(NamedTuple):
    """A sine that is in a column: in Hz, and in the column's unit."""

    frequency: float
    amplitude: float


class Spectrum(NamedTuple):
    """The amplitudes of the sines in a column.

    Attributes
    ----------
    column, unit : str
    rows, step : int, float
        How many there are, and their spacing in s.
    mean : float
    frequency, amplitude : ndarray
        In Hz, up to half of 1/step, and in the column's unit.
    peaks : tuple of Peak
        The largest first.
    model : str
        Its name, where it is known: the title of a picture.
    """

    column: str
    unit: str
    rows: int
    step: float
    mean: float
    frequency: Floats
    amplitude: Floats
    peaks: tuple[Peak, ...]
    model: str = ""

    def __repr__(self) -> str:
        from lagsim.outputs.notebook import block

        return block(f"Spectrum of {self.column}", self._summary())

    def _summary(self) -> list[tuple[str, str]]:
        from lagsim.outputs.notebook import listed

        unit = f" {self.unit}" if self.unit else ""
        peaks = [f"{f:.4g} Hz ({a:.3g}{unit})" for f, a in self.peaks]
        return [
            ("rows", f"{self.rows}, every {self.step:.4g} s"),
            ("mean", f"{self.mean:.4g}{unit}"),
            ("resolution", f"{self.resolution:.3g} Hz"),
            ("peaks", listed(peaks)),
        ]

    def _repr_html_(self) -> str:
        from lagsim.outputs.figure import content
        from lagsim.outputs.notebook import heading, picture, table

        title = f"Spectrum of {self.column}"
        drawn = picture(content(self.plot()), title)
        return "\n".join([heading(title), table(self._summary()), drawn])

    @property
    def window(self) -> str:
        """Its name, as scipy.signal has it."""
        return WINDOW

    @property
    def resolution(self) -> float:
        """Sines whose frequencies are nearer to each other are one peak."""
        return BREADTH / (self.rows * self.step)

    @property
    def record(self) -> dict[str, Any]:
        """What `lagsim spectrum --json` prints."""
        return {
            "column": self.column,
            "unit": self.unit,
            "window": self.window,
            "rows": self.rows,
            "step": self.step,
            "mean": self.mean,
            "resolution": self.resolution,
            "peaks": [peak._asdict() for peak in self.peaks],
        }

    def plot(self, title: str = "") -> Figure:
        """Draw the amplitudes against the frequency; nothing is shown.

        Parameters
        ----------
        title
            What stands before the name of the column; by default the model's name.
        """
        from lagsim.outputs.figure import Column, spectrum_figure
        from lagsim.outputs.letters import Letters, raised

        across = Column("frequency", "Hz", self.frequency)
        name = Letters().name(self.column)
        up = Column(f"amplitude of {name}", raised(self.unit), self.amplitude)
        return spectrum_figure(title or self.model, across, up, self.peaks)


def spectrum(t: Floats, values: Floats, column: str, unit: str = "") -> Spectrum:
    """Give the spectrum of a column.

    Parameters
    ----------
    t, values
        Times and values of the rows (rows,), equally spaced but for the last; of the
        rows of an impact what lies between the others is left out.
    column, unit
        What messages call it, and what its amplitudes are in.

    Raises
    ------
    InputError
        Where the rows are too few, not equally spaced, or not numbers.
    """
    kept, step = _even(t, column)
    x = values[kept]
    if not np.isfinite(x).all():
        bad = float(t[kept][~np.isfinite(x)][0])
        raise unusable("no-spectrum", f"`{column}` is no number at t = {bad!r}")
    from scipy.fft import next_fast_len
    from scipy.signal import get_window

    weights = get_window(WINDOW, len(x))
    mean = float(np.average(x, weights=weights))
    size = next_fast_len(FINER * len(x), real=True)
    # A sine of amplitude A has half of it at each of two frequencies.
    waves = np.fft.rfft(weights * (x - mean), size)
    amplitude = np.asarray(2 * np.abs(waves) / weights.sum(), np.float64)
    frequency = np.asarray(np.fft.rfftfreq(size, step), np.float64)
    apart = BREADTH / (len(x) * step)
    peaks = _peaks(frequency, amplitude, apart)
    return Spectrum(column, unit, len(x), step, mean, frequency, amplitude, peaks)


def _even(t: Floats, column: str) -> tuple[NDArray[np.intp], float]:
    """Give the places of equally spaced rows, and their spacing."""
    apart = np.diff(t)
    if not (apart >= 0.0).all():
        raise unusable("no-spectrum", "the times of the rows do not go forward")
    # Two rows share a time where something strikes.
    struck = np.append(apart == 0.0, False) | np.insert(apart == 0.0, 0, False)
    plain = np.flatnonzero(~struck[:-1])
    if len(plain) < LEAST_ROWS:
        text = f"{len(plain)} rows are too few for a spectrum of `{column}`"
        raise unusable("no-spectrum", f"{text}: {LEAST_ROWS} are the least")
    first, last = float(t[plain[0]]), float(t[plain[-1]])
    usual = float(np.median(np.diff(t[plain])))
    step = (last - first) / max(1, round((last - first) / usual))
    places = (t - first) / step
    numbers = np.rint(places)
    even = np.abs(places - numbers) <= SAME_ROW
    # Of two rows at one of the times the later one; the last row may lie anywhere.
    later = np.append(apart > 0.0, True)
    stray = ~even & ~struck
    stray[-1] = False
    kept = np.flatnonzero(even & later)
    if (np.diff(numbers[kept[-2:]]) == 0.0).any():  # a last row just after another
        kept = kept[:-1]
    gaps = np.flatnonzero(np.diff(numbers[kept]) != 1.0)
    if stray.any() or len(gaps):
        at = t[np.flatnonzero(stray)[0]] if stray.any() else t[kept[gaps[0]]]
        text = f"the rows are not equally spaced: see t = {float(at)!r}"
        raise unusable("no-spectrum", text)
    return kept, step


def _peaks(frequency: Floats, amplitude: Floats, apart: float) -> tuple[Peak, ...]:
    """Give the largest peaks; of those nearer than `apart` to a larger one, none."""
    from scipy.signal import find_peaks

    least = LEAST_PEAK * float(amplitude.max(initial=0.0))
    if not least:
        return ()
    found, seen = find_peaks(amplitude, height=least, prominence=least)
    found = found[seen["prominences"] >= STANDS_OUT * amplitude[found]]
    peaks: list[Peak] = []
    for k in found[np.argsort(-amplitude[found], kind="stable")].tolist():
        peak = _between(frequency, amplitude, k)
        if all(abs(peak.frequency - other.frequency) >= apart for other in peaks):
            peaks.append(peak)
        if len(peaks) == MOST_PEAKS:
            break
    return tuple(peaks)


def _between(frequency: Floats, amplitude: Floats, k: int) -> Peak:
    """Give the top of the parabola through the logarithms of three amplitudes."""
    a, b, c = np.log(np.maximum(amplitude[k - 1 : k + 2], TINY))
    off = 0.5 * (a - c) / (a - 2 * b + c)
    top = b - 0.25 * (a - c) * off
    return Peak(
        float(frequency[k] + off * (frequency[1] - frequency[0])), float(np.exp(top))
    )
