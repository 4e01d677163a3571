"""`lagsim stability`: the command and its files."""

import csv
import json
import math
import re
from pathlib import Path

import pytest

from tests.cli._results import document as read
from tests.cli._results import names
from tests.small_scenes import spring

OSCILLATOR = spring("duration: 10, output_step: 0.1", parameters="k: 4, step: 1")
FILES = ["stability.csv", "stability.json", "stability.png"]
SOME = ("--methods", "rk4,verlet", "--steps", "0.5:2")


def rows(folder):
    text = (Path(folder) / "stability.csv").read_text()
    return list(csv.DictReader(text.splitlines()))


@pytest.mark.slow
@pytest.mark.drawn
def test_the_files_the_table_and_the_document(lagsim, write):
    called = lagsim("stability", write(OSCILLATOR), *SOME, code=0, err="")
    folder = Path("results/model/stability")
    assert names(folder) == FILES
    lines = (folder / "stability.csv").read_bytes().split(b"\r\n")
    assert lines[0] == (
        b"method,step,verdict,growth,evaluations,rejections,smallest_step,duration"
    )
    found = rows(folder)
    assert [r["method"] for r in found] == 48 * ["rk4"] + 48 * ["verlet"]
    steps = [float(r["step"]) for r in found[:48]]
    assert (steps[0], steps[-1]) == (0.5, 2.0)
    assert steps == sorted(steps)
    for row in found[48:]:
        # Verlet's limit is h w = 2, at w = 2.
        stable = row["verdict"] in ("holds", "decays")
        assert stable == (float(row["step"]) < 1.0)
        assert int(row["evaluations"]) > 100
    assert (folder / "stability.png").read_bytes().startswith(b"\x89PNG")
    assert called.out.startswith("done: model, 2 methods, 96 runs\n")
    assert re.search(r"verlet +1 +0\.318 +1\b", called.out)
    assert "equilibrium  x = 0" in called.out
    # One pair of eigenvalues is no range, and steps, modes, eigenvalues have units.
    assert "start: ±2i 1/s, damping ratio 0\n" in called.out
    assert "motion: ±2i 1/s, damping ratio 0\n" in called.out
    for head in ("holds below (s)", "predicted (s)", "frequency (Hz)", "period (s)"):
        assert head in called.out
    document = json.loads((folder / "stability.json").read_bytes())
    border = document["borders"]["verlet"]
    assert border["found"] == pytest.approx(1.0, rel=0.01)
    assert border["predicted"] == pytest.approx(1.0, rel=1e-6)
    for real, imaginary in document["eigenvalues"]["at_start"]:
        assert (real, abs(imaginary)) == pytest.approx((0.0, 2.0))
    assert document["equilibrium"] == {"x": 0.0}
    (mode,) = document["modes"]
    assert mode["frequency"] == pytest.approx(1.0 / math.pi)
    assert mode["shape"] == {"x": 1.0}
    assert document["runs"]["perturbation"]["energy"] > 0.0
    assert document["complete"] is True
    assert len(document["cells"]) == 96
    assert sorted(document["files"]) == FILES


@pytest.mark.slow
def test_a_parameter_varies(lagsim, write):
    some = ("--methods", "verlet,dop853", "--vary", "k=1:16")
    called = lagsim("stability", write(OSCILLATOR), *some, "-o", "out", code=0, err="")
    assert "holds below (s), k = 16" in called.out
    found = rows("out")
    assert list(found[0])[:4] == ["method", "step", "k", "verdict"]
    adaptive = [(r["step"], float(r["k"])) for r in found if r["method"] == "dop853"]
    assert (adaptive[0], adaptive[-1]) == (("", 1.0), ("", 16.0))
    document = read("out/stability.json")
    for border in document["borders"]["verlet"]:
        expected = 2.0 / math.sqrt(border["k"])
        assert border["found"] == pytest.approx(expected, rel=0.01)
        assert border["predicted"] == pytest.approx(expected, rel=1e-6)
