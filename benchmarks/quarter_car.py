"""Write a synthetic response for `lagsim fit` of models/quarter-car.yaml.

The response is no measurement. It is a run with the values in TRUE, and noise: sums of
twelve uniform numbers, less 6, which are nearly normal.

    python benchmarks/quarter_car.py [SEED]
"""

import sys
from pathlib import Path

import lagsim

MODELS = Path(__file__).parents[1] / "models"
FILE = MODELS / "synthetic_quarter_car.csv"
# Values that the fit is to find; standard deviations of the noise (m/s^2).
TRUE = {"k": 17500.0, "c": 1380.0, "kt": 182000.0}
NOISE = {"felt": 0.03, "hub": 0.3}
SEED = 48


def noise(seed: int, count: int) -> list[float]:
    """Return nearly normal numbers of standard deviation 1.

    Source of the generator: D. E. Knuth, MMIX: x -> 6364136223846793005 x +
    1442695040888963407 modulo 2^64, whose leading 32 bits are used.
    """
    found = []
    for _ in range(count):
        total = -6.0
        for _ in range(12):
            seed = (6364136223846793005 * seed + 1442695040888963407) % 2**64
            total += (seed >> 32) / 2**32
        found.append(total)
    return found


def rows(seed: int = SEED) -> list[tuple[float, ...]]:
    """Return times (s), and the accelerations of body and wheel (m/s^2)."""
    model = lagsim.load(str(MODELS / "quarter-car.yaml"), **TRUE)
    found = lagsim.simulate(model, error_bar="never")
    columns = [[round(float(t), 2) for t in found.t]]
    for k, (name, size) in enumerate(NOISE.items()):
        drawn = noise(seed + k, len(found.t))
        pairs = zip(found[name].tolist(), drawn, strict=True)
        columns.append([round(x + size * y, 3) + 0.0 for x, y in pairs])
    return list(zip(*columns, strict=True))


def text(seed: int = SEED) -> str:
    """Return the content of the CSV file."""
    lines = [f"{t:.2f},{felt:.3f},{hub:.3f}" for t, felt, hub in rows(seed)]
    return "\n".join([",".join(("t", *NOISE)), *lines]) + "\n"


if __name__ == "__main__":
    FILE.write_text(text(*map(int, sys.argv[1:])), encoding="utf-8")
