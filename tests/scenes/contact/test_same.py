"""The same bounces, told from elsewhere, from a train, in other units, later on."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pytest

from tests.scenes.contact.motions import GLOBAL, G, contact, play, scene

END = 2.0


@dataclass(frozen=True)
class Told:
    """In which words: units, an origin, a moving observer, and who else is there."""

    length: float = 1.0
    time: float = 1.0
    mass: float = 1.0
    x: float = 0.0
    y: float = 0.0
    u: float = 0.0
    w: float = 0.0
    start: float = 0.0
    beside: float = 0.0

    def text(self) -> str:
        """A sphere with spin that bounces, slips, rolls and comes to rest."""
        later = f"(t - {self.start!r})"
        law = contact(
            f"y - w*{later} - {self.y * self.length!r} >= r", 0.6,
            friction=0.2, slip="x_dot - u + r*phi_dot",
        )  # fmt: skip
        speed = self.length / self.time
        more = {}
        kinetic, potential = "m*(x_dot^2 + y_dot^2)/2 + I*phi_dot^2/2", "m*g*y"
        if self.beside:
            more = {"z": 1, "z_dot": 0}
            kinetic += f" + {self.beside!r}*m*z_dot^2/2"
            potential += f" + {self.beside!r}*m*z^2"
        return scene(
            "x y phi z" if more else "x y phi", kinetic, potential, {"floor": law},
            {
                "x": self.x * self.length, "y": (self.y + 1) * self.length, "phi": 0,
                "x_dot": "u", "y_dot": "w", "phi_dot": 50 / self.time,
            } | more,
            parameters={
                "m": self.mass, "r": 0.1 * self.length, "I": "2*m*r^2/5",
                "g": G * self.length / self.time**2,
                "u": self.u * speed, "w": self.w * speed,
            },
            start=self.start, duration=END * self.time, output_step=0.02 * self.time,
        )  # fmt: skip

    def seen(self):
        """Give events and rows as who stands beside the plain scene sees them."""
        found = play(self.text())
        t = (found.t - self.start) / self.time
        rows = np.abs(t / 0.02 - np.round(t / 0.02)) < 1e-6
        x = found["x"] / self.length - self.x - self.u * t
        y = found["y"] / self.length - self.y - self.w * t
        v = found["y_dot"] * self.time / self.length - self.w
        push = found["lambda_floor"] * self.time**2 / (self.mass * self.length)
        events = {
            kind: (np.array(found.times(kind)) - self.start) / self.time
            for kind in ("impact", "stick", "zeno")
        }
        table = np.column_stack([x, y, found["phi"], v, push])[rows]
        return events, t[rows], table


# Rounding grows by distance over length and by speed over speed; a tenth of GLOBAL is
# left for how steps fall.
CHANGES = {
    "far away": Told(x=1e3, y=-1e4),
    "from a train": Told(u=100.0, w=-30.0),
    "millimetres": Told(length=1e3),
    "megametres": Told(length=1e-6),
    "microseconds": Told(time=1e6),
    "grams": Told(mass=1e3),
    "beside a planet": Told(beside=1e12),
    "beside a grain": Told(beside=1e-12),
    "later": Told(start=64.0),
    "earlier": Told(start=-64.0),
}


@functools.cache
def plain():
    return Told().seen()


@pytest.mark.parametrize("change", CHANGES)
def test_the_same_bounces(change):
    events, times, rows = plain()
    changed, t, table = CHANGES[change].seen()
    assert len(t) == len(times)
    # The last flights before rest have 1e-5 of the speed: a place known to 1e-12 of
    # where it is makes their time uncertain.
    told = CHANGES[change]
    place = 1e-12 * max(abs(told.x), abs(told.y), abs(told.u), abs(told.w))
    assert changed["stick"] == pytest.approx(events["stick"], abs=GLOBAL)
    assert changed["zeno"] == pytest.approx(events["zeno"], abs=GLOBAL + place / 1e-5)
    assert changed["impact"][:6] == pytest.approx(events["impact"][:6], abs=GLOBAL)
    for column, expected in zip(table.T, rows.T, strict=True):
        close = 10 * GLOBAL * np.max(np.abs(expected))
        assert np.max(np.abs(column - expected)) < close
