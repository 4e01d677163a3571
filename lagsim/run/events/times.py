"""What depends on t alone: switches at known times, and the sizes of pulses to come.

The branch of each switch in time is fixed in an arc, which ends at the next break
(`breaks`). A smooth pulse, a ramp or a gate of t alone is located within the steps, as
localized terms of the motion are (see `methods.parts.missed`). But a body that rests
until then has no size: the first traces of a pulse, a hundred powers of ten below it,
would be controlled as finely as rounding lets them be. So what pulses will give to the
motion counts from the start.
"""

from __future__ import annotations

import math
from itertools import islice
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate_rows
from lagsim.methods.parts import state as at
from lagsim.methods.parts.missed import distance
from lagsim.notes import Event
from lagsim.run.events.breaks import break_times
from lagsim.run.events.sequence import Sequence
from lagsim.run.system.localized import indicators_in_time
from lagsim.run.trajectory import GO_ON, Decision, Ending, Outcome, Source, Turn

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc
    from lagsim.run.system.localized import Indicator


# Breaks accumulate if, after FEWEST, windows of so many get shorter so fast that all
# that follow would take less than this part of the time since the first.
WINDOW, FEWEST, SHORT = 250, 1000, 1e-3


class TimeBreaks(Source):
    """The breaks in time of a run, found as the run gets to them.

    A run that is resumed finds them anew, past those that it has taken.
    """

    DERIVED = ("_coming",)

    def __init__(self, arc: Arc) -> None:
        self._arc = arc
        self._taken = 0
        self._coming: Iterator[float] | None = None
        self._met = Sequence(arc.settings.start, arc.settings.duration, WINDOW)
        self._first = math.nan
        self._next = self._following()

    def _following(self) -> float:
        """Give the next break; inf after all of them."""
        if self._coming is None:
            arc, settings = self._arc, self._arc.settings
            discrete = [mode.discrete for mode in arc.system.switches.modes]
            ends = settings.start, settings.end
            found = break_times(arc.equations.graph, discrete, arc.parameters, *ends)
            self._coming = islice(found, self._taken, None)
        self._taken += 1
        return next(self._coming, inf)

    def begin(self, arc: Arc) -> Decision:
        """Set the branches up to the next break."""
        switches = arc.system.switches
        if switches.modes:
            end = min(self._next, arc.settings.end)
            arc.system.set_modes(switches.mode_values(arc.t, end, arc.parameters))
        arc.runner.prepare()
        return GO_ON

    def limit(self, arc: Arc) -> float:  # noqa: ARG002
        """Give the next break."""
        return self._next

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Go through a break that has been reached."""
        if code != at.DONE or arc.t < self._next:
            return None
        self._met.add(arc.t, 0)
        self._first = arc.t if self._taken == 1 else self._first
        ending = None
        if self._taken >= FEWEST and self._taken % WINDOW == 0:
            limit = self._met.end()
            if limit is not None and limit - arc.t < SHORT * (arc.t - self._first):
                ending = Ending(Outcome.SWITCHES_ACCUMULATE, "in time")
        self._next = self._following()
        switch = (Event(arc.t, "switch"),)
        return Decision(events=switch, turn=Turn.MODES, ending=ending)


# A term fades by this power of e within its width; one that varies by less than the
# second in a run is localized nowhere.
FADED = 0.5
SHALLOW = 3.0
# Times of a run that it is looked for at, and then in each closer stretch.
COARSE, FINE = 1025, 9
# The part of what a pulse does to a motion that counts as its size before it begins.
FORESEEN = 1e-2


class Pulses(Source):
    """The pulses of a run: when each term of t alone is closest, and for how long."""

    def __init__(self, arc: Arc) -> None:
        found = (closest(arc, x) for x in indicators_in_time(arc.system.equations))
        self._pulses = [pulse for pulse in found if pulse is not None]

    def begin(self, arc: Arc) -> Decision:
        """Let what they will do by the forces of this mode count as sizes (size,)."""
        n, sizes = arc.system.n, arc.sizes
        rates = arc.runner.function("derivative", arc.system.size)
        for time, width in self._pulses:
            for t in (time - width, time, time + width):
                push = FORESEEN * width * np.abs(rates(t, arc.y)[n : 2 * n])
                moved = arc.y.copy()
                moved[n : 2 * n] += push  # a body at rest takes no work
                work = FORESEEN * width * np.abs(rates(t, moved)[2 * n :])
                change = np.concatenate([width * push, push, work])
                if time + width >= arc.t and np.all(np.isfinite(change)):
                    sizes = np.maximum(sizes, change)
        return Decision(sizes=sizes)


def closest(arc: Arc, indicator: Indicator) -> tuple[float, float] | None:
    """Give when a localized term of t is closest to acting in a run, and its width.

    None where it varies too little to hide anything.
    """
    g, values = arc.equations.graph, arc.parameters
    if not g.depends([indicator.node]) <= {"t", *values}:
        return None
    lo, hi, count = arc.settings.start, arc.settings.end, COARSE
    while True:
        times = np.linspace(lo, hi, count)
        (found,) = evaluate_rows(g, [indicator.node], {**values, "t": times}, count)
        away = distances(indicator, found)
        k = int(np.argmin(away))
        varies = float(np.max(away) - away[k])
        if count == COARSE and not varies >= SHALLOW:
            return None
        before, after = float(times[max(k - 1, 0)]), float(times[min(k + 1, count - 1)])
        if not varies >= FADED or not after - before < hi - lo:
            return float(times[k]), hi - lo
        lo, hi, count = before, after, FINE


def distances(indicator: Indicator, found: Floats) -> Floats:
    """Give how far from acting a term is (k,); inf where it has no value."""
    kind, power = indicator.kind, indicator.power
    away = [inf if math.isnan(u) else distance(kind, power, u) for u in found.tolist()]
    return np.array(away)
