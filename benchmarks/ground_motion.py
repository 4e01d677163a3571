"""Write a synthetic record of ground acceleration, for models/frame-in-an-earthquake.

The record is no measurement. It is a sum of cosines with the spectrum of Kanai and
Tajimi and random phases, within an envelope that rises, stays and decays; the whole is
scaled to the peak PEAK and rounded to a tenth of a millimetre per second squared.

Sources: H. Tajimi, A statistical method of determining the maximum response of a
building structure during an earthquake, Proc. 2nd World Conf. Earthquake Engineering
(1960), 781; M. Shinozuka and Y. Sato, Simulation of nonstationary random process,
J. Eng. Mech. Div. ASCE 93 (1967), 11.

    python benchmarks/ground_motion.py [SEED]
"""

import math
import sys
from pathlib import Path

FILE = Path(__file__).parents[1] / "models" / "synthetic_ground_motion.csv"
# Duration and spacing in s; peak in m/s^2.
DURATION, STEP, PEAK = 20.0, 0.02, 3.0
# Frequency (rad/s) and damping of the ground, as of firm soil.
GROUND, DAMPING = 15.6, 0.6
# Number and spacing (Hz) of the cosines.
COSINES, SPACING = 200, 0.05
# The envelope rises up to the first time and decays from the second one on (s).
RISES, DECAYS, RATE = 3.0, 9.0, 0.35
SEED = 48


def phases(seed: int) -> list[float]:
    """Return COSINES phases from 0 to 2 pi, by a linear congruential generator.

    Source: D. E. Knuth, MMIX: x -> 6364136223846793005 x + 1442695040888963407 modulo
    2^64, whose leading 32 bits are used.
    """
    found = []
    for _ in range(COSINES):
        seed = (6364136223846793005 * seed + 1442695040888963407) % 2**64
        found.append(2.0 * math.pi * (seed >> 32) / 2**32)
    return found


def envelope(t: float) -> float:
    """Return the factor of the cosines at a time (s), between 0 and 1."""
    if t < RISES:
        return (t / RISES) ** 2
    return math.exp(-RATE * max(0.0, t - DECAYS))


def spectrum(w: float) -> float:
    """Return the power of the acceleration at an angular frequency (rad/s)."""
    ratio = (w / GROUND) ** 2
    soft = 4.0 * DAMPING**2 * ratio
    return (1.0 + soft) / ((1.0 - ratio) ** 2 + soft)


def record(seed: int = SEED) -> list[tuple[float, float]]:
    """Return times (s) and accelerations (m/s^2)."""
    shifts = phases(seed)
    rates = [2.0 * math.pi * SPACING * (k + 1) for k in range(COSINES)]
    sizes = [math.sqrt(spectrum(w)) for w in rates]
    times = [round(STEP * k, 2) for k in range(round(DURATION / STEP) + 1)]
    values = [
        envelope(t)
        * math.fsum(
            size * math.cos(w * t + shift)
            for size, w, shift in zip(sizes, rates, shifts, strict=True)
        )
        for t in times
    ]
    scale = PEAK / max(map(abs, values))
    return [(t, round(scale * x, 4) + 0.0) for t, x in zip(times, values, strict=True)]


def text(seed: int = SEED) -> str:
    """Return the content of the CSV file."""
    rows = [f"{t:.2f},{x:.4f}" for t, x in record(seed)]
    return "\n".join(["t,acceleration", *rows]) + "\n"


if __name__ == "__main__":
    FILE.write_text(text(*map(int, sys.argv[1:])), encoding="utf-8")
