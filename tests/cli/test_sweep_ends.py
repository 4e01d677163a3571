"""`lagsim sweep --ends`: last values alone, the same as those of whole runs."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

# An orbit with next to no angular momentum falls into the centre, by steps of no size.
FALL = """\
parameters: {mu: 1}
coordinates: {r: , phi: }
energy: {kinetic: r_dot^2/2 + r^2*phi_dot^2/2, potential: -mu/r}
initial: {r: 1, phi: 0, phi_dot: 1}
simulation: {duration: 3, output_step: 0.1, rtol: 1e-9, formulation: full}
"""
SWEPT = ("phi_dot=0:1.2:7", "mu=0.9,1.1")


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "fall.yaml"
    path.write_text(f"name: fall\n{FALL}")
    return str(path)


def rows(folder):
    with Path(folder, "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_they_are_the_ends_of_whole_runs(model, lagsim, tmp_path):
    ends, whole = tmp_path / "ends", tmp_path / "whole"
    quick = ("--no-plots", "-j", "1", "-q")
    assert lagsim("sweep", model, *SWEPT, *quick, "--ends", "-o", str(ends)).code == 3
    never = (*quick, "--error-bar", "never", "-o", str(whole))
    assert lagsim("sweep", model, *SWEPT, *never).code == 3
    one, other = rows(ends), rows(whole)
    assert len(one) == len(other) == 14
    # Without any turn it falls into the centre, whoever makes the run.
    assert [row["outcome"] for row in one] == ["failed"] * 2 + ["done"] * 12
    for row, full in zip(one, other, strict=True):
        kept = {k: v for k, v in full.items() if not k.endswith((".min", ".max"))}
        assert row == kept
    assert json.loads((ends / "sweep.json").read_bytes())["compiled"] == 1


@pytest.mark.slow
def test_processes_and_what_follows_give_the_same(model, lagsim, tmp_path):
    text = Path(model).read_text().replace("phi_dot: 1}", "phi_dot: mu}")
    Path(model).write_text(text)
    for jobs in ("1", "2"):
        folder = str(tmp_path / jobs)
        done = lagsim(
            "sweep", model, "mu=0.7:1.2:12", "--ends", "-j", jobs, "-o", folder
        )
        assert done.code == 0
    assert rows(tmp_path / "1") == rows(tmp_path / "2")
    alone = ("--error-bar", "never", "--no-plots", "-o", str(tmp_path / "whole"))
    lagsim("sweep", model, "mu=0.7:1.2:12", *alone)
    for row, full in zip(rows(tmp_path / "1"), rows(tmp_path / "whole"), strict=True):
        assert row == {k: full[k] for k in row}
