"""Scenes whose motion is known in closed form, for what a run tells of its error."""

from __future__ import annotations

import math

import numpy as np

from tests.small_scenes import swing


def text(coordinates, energy, initial, simulation, more=""):
    names = ", ".join(f"{q}: {{}}" for q in coordinates)
    return (
        f"coordinates: {{{names}}}\nenergy: {{{energy}}}\n{more}\n"
        f"initial: {{{initial}}}\nsimulation: {{{simulation}}}\n"
    )


def kepler(t, e):
    """Give x, y of an ellipse with axis 1 and period 2 pi from its pericentre."""
    anomaly = np.array(t, dtype=float)
    for _ in range(60):
        anomaly -= (anomaly - e * np.sin(anomaly) - t) / (1 - e * np.cos(anomaly))
    return np.column_stack(
        [np.cos(anomaly) - e, math.sqrt(1 - e * e) * np.sin(anomaly)]
    )


def _column(f):
    return lambda t: np.asarray(f(t))[:, None]


def _orbit(e, duration, step):
    start = f"x: {1 - e!r}, y: 0, x_dot: 0, y_dot: {math.sqrt((1 + e) / (1 - e))!r}"
    energy = "kinetic: (x_dot^2 + y_dot^2)/2, potential: -1/sqrt(x^2 + y^2)"
    return text("xy", energy, start, f"duration: {duration}, output_step: {step}")


def _one(potential, initial, simulation, force=None):
    more = f'forces: {{x: "{force}"}}' if force else ""
    energy = f"kinetic: x_dot^2/2, potential: {potential}"
    return text("x", energy, initial, simulation, more)


def _pulled(t, w=30.0):
    """Give x'' = -w^2 (x - sin t) from x = 0 at the speed that it goes on with."""
    return w * w / (w * w - 1.0) * np.sin(t)


def _relaxed(t, k=1e4, c=2e4):
    """Give x'' = -k (x - 1) - c x' from rest at 0: one fast and one slow root."""
    root = math.sqrt(c * c / 4.0 - k)
    slow, fast = -k / (c / 2.0 + root), -c / 2.0 - root
    return 1.0 - (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow)


# Name: the text, and the coordinates (k, n) at times (k,).
KNOWN = {
    "oscillator": (
        _one("x^2/2", "x: 1", "duration: 50, output_step: 0.1"),
        _column(np.cos),
    ),
    "oscillator in few rows": (
        _one("x^2/2", "x: 1", "duration: 20, output_step: 19"),
        _column(np.cos),
    ),
    "oscillator once a period": (
        _one("2*pi^2*x^2", "x: 0, x_dot: 1", "duration: 30, output_step: 1.5"),
        _column(lambda t: np.sin(2 * np.pi * t) / (2 * np.pi)),
    ),
    "fall": (
        _one("9.81*x", "x: 0, x_dot: 3", "duration: 2, output_step: 0.3"),
        _column(lambda t: 3 * t - 9.81 * t * t / 2),
    ),
    "drag": (
        _one("9.81*x", "x: 0", "duration: 4, output_step: 0.1", "0.3*x_dot^2"),
        _column(
            lambda t: -np.log(np.cosh(math.sqrt(9.81 * 0.3) * t)) / 0.3,
        ),
    ),
    "pendulum": (
        _one("-cos(x)", "x: 2", "duration: 30, output_step: 0.1"),
        _column(lambda t: swing(t, 2.0)),
    ),
    "slow pendulum": (
        _one("-cos(x)", "x: 3.1", "duration: 30, output_step: 0.5"),
        _column(lambda t: swing(t, 3.1)),
    ),
    "orbit": (_orbit(0.3, 60, 0.1), lambda t: kepler(t, 0.3)),
    "eccentric orbit": (_orbit(0.9, 20, 0.05), lambda t: kepler(t, 0.9)),
    "orbit in few rows": (_orbit(0.5, 40, 13), lambda t: kepler(t, 0.5)),
    "escape": (
        _one("-x^2/2", "x: 1, x_dot: 1", "duration: 10, output_step: 0.5"),
        _column(np.exp),
    ),
    "quartic escape": (
        _one("-x^4/2", "x: 1, x_dot: 1", "duration: 0.9, output_step: 0.05"),
        _column(lambda t: 1.0 / (1.0 - t)),
    ),
    "forced oscillator": (
        _one("x^2/2", "x: 0, x_dot: 0", "duration: 40, output_step: 0.2", "sin(2*t)"),
        _column(lambda t: (2 * np.sin(t) - np.sin(2 * t)) / 3),
    ),
    "resonance": (
        _one("x^2/2", "x: 0, x_dot: 0", "duration: 60, output_step: 0.5", "cos(t)"),
        _column(lambda t: t * np.sin(t) / 2),
    ),
    "pulled along": (
        _one(
            "450*(x - sin(t))^2",
            f"x: 0, x_dot: {900 / 899!r}",
            "duration: 30, output_step: 0.3",
        ),
        _column(_pulled),
    ),
    "relaxation": (
        _one("1e4*(x - 1)^2/2", "x: 0", "duration: 3, output_step: 0.05", "-2e4*x_dot"),
        _column(_relaxed),
    ),
    "growing mass": (
        text(
            "x",
            "kinetic: (1 + t)*x_dot^2/2, potential: 0",
            "x: 0, x_dot: 1",
            "duration: 50, output_step: 0.5",
        ),
        _column(np.log1p),
    ),
    "parametric": (
        _one(
            "(1 - 2/cosh(t - 5)^2)*-x^2/2",
            f"x: {1 / math.cosh(5)!r}, x_dot: {math.tanh(5) / math.cosh(5)!r}",
            "duration: 8, output_step: 0.1",
        ),
        _column(lambda t: 1.0 / np.cosh(t - 5)),
    ),
}
CONSTRAINED = {
    "rod": (
        text(
            "xy",
            "kinetic: (x_dot^2 + y_dot^2)/2, potential: y",
            f"x: {math.sin(2)!r}, y: {-math.cos(2)!r}",
            "duration: 30, output_step: 0.1",
            "constraints: {rod: x^2 + y^2 = 1}",
        ),
        lambda t: np.column_stack([np.sin(swing(t, 2.0)), -np.cos(swing(t, 2.0))]),
    ),
}
