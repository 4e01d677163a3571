"""How to integrate: numbers and names, and what holds where the file is silent."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from lagsim.errors import Place

DEFAULT_RTOL = 1e-11
DEFAULT_ROWS = 1000
# With Baumgarte's formulation, what is off the constraints falls by e over this many
# rows. A fast decay is resolved like a fast motion (the elastic pendulum on its curve
# at 1e-11: 7,400 evaluations at a gain of 1, 9,600 at 5, 19,000 at 10 and 110,000 at
# 50).
ROWS_TO_DECAY = 10


class Settings(NamedTuple):
    """When to start and end, how finely to show the motion, and how to integrate.

    None where nothing was asked for; the properties say what holds then.

    Attributes
    ----------
    start, end : float
        The same where nobody has said how long to run.
    output_step : float
        Spacing of the rows.
    step : float or None
        Of fixed-step methods.
    gain : float or None
        Of Baumgarte's formulation, per unit of time.
    spectral_radius : float or None
        Of the generalized-alpha method.
    moments : tuple of float
        Times, in order, at which states are asked for beside the rows.
    """

    start: float = 0.0
    end: float = 0.0
    output_step: float = 1.0
    method: str = "auto"
    formulation: str = "auto"
    rtol: float | None = None
    atol: float | None = None
    step: float | None = None
    gain: float | None = None
    spectral_radius: float | None = None
    method_place: Place | None = None
    formulation_place: Place | None = None
    moments: tuple[float, ...] = ()

    @property
    def duration(self) -> float:
        """How long the run lasts; 0 where nobody has said so."""
        return self.end - self.start

    @property
    def tolerance(self) -> float:
        """The relative tolerance of methods that control their error."""
        return DEFAULT_RTOL if self.rtol is None else self.rtol

    @property
    def fixed_step(self) -> float:
        """The step of methods that do not."""
        return self.step or self.output_step

    @property
    def decay(self) -> float:
        """The rate at which Baumgarte's formulation returns to the constraints."""
        return self.gain or 1.0 / (ROWS_TO_DECAY * self.output_step)
