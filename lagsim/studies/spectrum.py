"""Amplitude spectrum of a column.

The rows less their mean are weighted by the four-term window of Blackman and Harris (F.
J. Harris, Proceedings of the IEEE 66 (1978), 51). Its side lobes are below 3e-5 of a
peak, so that a small peak near a large one is not mistaken for a side lobe.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.codes.known import NO_SPECTRUM
from lagsim.errors import unusable
from lagsim.tolerances import SAME_ROW, TINY

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from lagsim.language.arrays import Floats

WINDOW = "blackmanharris"
# Half the breadth of a peak of this window, in parts of 1/duration.
BREADTH = 4
# Frequencies are closer than the resolution of the rows, so that peaks are sampled at
# their height.
FINER = 4
LEAST_ROWS = 16
# Listed peaks have this part of the height of the largest one, and exceed their
# surroundings by this part of their own height.
LEAST_PEAK, STANDS_OUT = 1e-4, 0.5
MOST_PEAKS = 8


class Peak(NamedTuple):
    """Peak of a spectrum: frequency in Hz, amplitude in the unit of the column."""

    frequency: float
    amplitude: float


class Spectrum(NamedTuple):
    """Amplitude spectrum of a column.

    Attributes
    ----------
    column, unit : str
        Name and unit of the column.
    rows : int
        The number of equally spaced rows.
    step : float
        The spacing of the rows, in s.
    mean : float
        The mean of the column.
    frequency : ndarray
        Frequencies in Hz, up to half of 1/step.
    amplitude : ndarray
        The amplitude at each frequency, in the unit of the column.
    peaks : tuple of Peak
        The peaks, by falling amplitude.
    model : str
        The name of the model, if known; the title of a picture.
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
        from lagsim.outputs.notebook import text_block

        return text_block(f"Spectrum of {self.column}", self._summary())

    def _summary(self) -> list[tuple[str, str]]:
        from lagsim.outputs.notebook import short_list

        unit = f" {self.unit}" if self.unit else ""
        peaks = [f"{f:.4g} Hz ({a:.3g}{unit})" for f, a in self.peaks]
        return [
            ("rows", f"{self.rows}, every {self.step:.4g} s"),
            ("mean", f"{self.mean:.4g}{unit}"),
            ("resolution", f"{self.resolution:.3g} Hz"),
            ("peaks", short_list(peaks)),
        ]

    def _repr_html_(self) -> str:
        from lagsim.outputs.figure import encoded_figure
        from lagsim.outputs.notebook import heading, html_table, picture

        title = f"Spectrum of {self.column}"
        drawn = picture(encoded_figure(self.plot()), title)
        return "\n".join([heading(title), html_table(self._summary()), drawn])

    @property
    def window(self) -> str:
        """Name of the window in scipy.signal."""
        return WINDOW

    @property
    def resolution(self) -> float:
        """Least difference of the frequencies of two separate peaks, in Hz."""
        return BREADTH / (self.rows * self.step)

    @property
    def record(self) -> dict[str, Any]:
        """The document that `lagsim spectrum --json` prints."""
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
        """Return a matplotlib figure of the amplitudes against the frequency.

        Parameters
        ----------
        title : str, optional
            The text before the name of the column; by default the name of the model.
        """
        from lagsim.outputs.figure import PlottedColumn, spectrum_figure
        from lagsim.outputs.letters import Letters, raised_powers

        across = PlottedColumn("frequency", "Hz", self.frequency)
        name = Letters().name(self.column)
        up = PlottedColumn(
            f"amplitude of {name}", raised_powers(self.unit), self.amplitude
        )
        return spectrum_figure(title or self.model, across, up, self.peaks)


def spectrum(t: Floats, values: Floats, column: str, unit: str = "") -> Spectrum:
    """Return the amplitude spectrum of a column.

    Parameters
    ----------
    t, values : ndarray, shape (rows,)
        Times and values. The times must be equally spaced except for the last; rows of
        impacts between them are left out.
    column : str
        The name of the column in messages.
    unit : str
        The unit of the column.

    Raises
    ------
    InputError
        If the rows are too few, not equally spaced, or not finite.

    Examples
    --------
    >>> t = np.linspace(0.0, 20.0, 1001)
    >>> found = spectrum(t, 3.0 * np.sin(2.0 * np.pi * 1.5 * t), "x", "m")
    >>> [(round(p.frequency, 3), round(p.amplitude, 2)) for p in found.peaks]
    [(1.5, 3.0)]
    """
    kept, step = _even(t, column)
    x = values[kept]
    if not np.isfinite(x).all():
        bad = float(t[kept][~np.isfinite(x)][0])
        raise unusable(NO_SPECTRUM, f"`{column}` is no number at t = {bad!r}")
    from scipy.fft import next_fast_len
    from scipy.signal import get_window

    weights = get_window(WINDOW, len(x))
    mean = float(np.average(x, weights=weights))
    size = next_fast_len(FINER * len(x), real=True)
    # A sine of amplitude A has A/2 at each of two frequencies.
    waves = np.fft.rfft(weights * (x - mean), size)
    amplitude = np.asarray(2 * np.abs(waves) / weights.sum(), np.float64)
    frequency = np.asarray(np.fft.rfftfreq(size, step), np.float64)
    resolution = BREADTH / (len(x) * step)
    peaks = _peaks(frequency, amplitude, resolution)
    return Spectrum(column, unit, len(x), step, mean, frequency, amplitude, peaks)


def _even(t: Floats, column: str) -> tuple[NDArray[np.intp], float]:
    """Return the indices of equally spaced rows, and their spacing.

    t : (rows,), the times.
    column : name of the column, for messages.
    """
    steps = np.diff(t)
    if not (steps >= 0.0).all():
        raise unusable(NO_SPECTRUM, "the times of the rows do not increase")
    # Two rows have one time at an impact.
    struck = np.append(steps == 0.0, False) | np.insert(steps == 0.0, 0, False)
    plain = np.flatnonzero(~struck[:-1])
    if len(plain) < LEAST_ROWS:
        text = f"{len(plain)} rows are too few for a spectrum of `{column}`"
        raise unusable(NO_SPECTRUM, f"{text}: {LEAST_ROWS} are the least")
    first, last = float(t[plain[0]]), float(t[plain[-1]])
    usual = float(np.median(np.diff(t[plain])))
    step = (last - first) / max(1, round((last - first) / usual))
    places = (t - first) / step
    numbers = np.rint(places)
    even = np.abs(places - numbers) <= SAME_ROW
    # Of two rows at one of the times the later one; the last row may lie anywhere.
    later = np.append(steps > 0.0, True)
    irregular = ~even & ~struck
    irregular[-1] = False
    kept = np.flatnonzero(even & later)
    if (np.diff(numbers[kept[-2:]]) == 0.0).any():  # a last row just after another
        kept = kept[:-1]
    gaps = np.flatnonzero(np.diff(numbers[kept]) != 1.0)
    if irregular.any() or len(gaps):
        at = t[np.flatnonzero(irregular)[0]] if irregular.any() else t[kept[gaps[0]]]
        text = f"the rows are not equally spaced: see t = {float(at)!r}"
        raise unusable(NO_SPECTRUM, text)
    return kept, step


def _peaks(frequency: Floats, amplitude: Floats, resolution: float) -> tuple[Peak, ...]:
    """Return the largest peaks, except peaks nearer than `resolution` to a larger one.

    frequency, amplitude : (k,).
    resolution : a difference of frequencies in Hz.
    """
    from scipy.signal import find_peaks

    least = LEAST_PEAK * float(amplitude.max(initial=0.0))
    if not least:
        return ()
    found, properties = find_peaks(amplitude, height=least, prominence=least)
    found = found[properties["prominences"] >= STANDS_OUT * amplitude[found]]
    peaks: list[Peak] = []
    for k in found[np.argsort(-amplitude[found], kind="stable")].tolist():
        peak = _between(frequency, amplitude, k)
        if all(abs(peak.frequency - other.frequency) >= resolution for other in peaks):
            peaks.append(peak)
        if len(peaks) == MOST_PEAKS:
            break
    return tuple(peaks)


def _between(frequency: Floats, amplitude: Floats, k: int) -> Peak:
    """Return the peak near index k, between the frequencies of the spectrum.

    It is the maximum of the parabola through the logarithms of the amplitudes k - 1, k
    and k + 1.

    frequency, amplitude : (n,).
    """
    a, b, c = np.log(np.maximum(amplitude[k - 1 : k + 2], TINY))
    off = 0.5 * (a - c) / (a - 2 * b + c)
    top = b - 0.25 * (a - c) * off
    return Peak(
        float(frequency[k] + off * (frequency[1] - frequency[0])), float(np.exp(top))
    )
