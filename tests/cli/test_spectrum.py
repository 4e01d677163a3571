"""`lagsim spectrum`: its output, its files, its refusals."""

import csv
from pathlib import Path

import numpy as np
import pytest

SPRING = """
name: spring
coordinates: {x: {unit: m}}
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
initial: {x: 1}
simulation: {duration: 60, output_step: 0.05}
"""


@pytest.fixture
def result(lagsim, write):
    path = write(SPRING)
    assert lagsim("run", path, "--no-plots", "--error-bar", "never").code == 0
    return "results/spring"


@pytest.mark.drawn
def test_peaks_are_told_and_files_written(lagsim, result):
    called = lagsim(
        "spectrum", result, "x", "-o", "x.svg", "-o", "x.csv", code=0, err=""
    )
    head, _, titles, peak = called.out.splitlines()
    assert head.startswith("x: 1201 rows 0.05 s apart, mean ")
    assert head.endswith(" m, window blackmanharris")
    assert titles.split() == ["Hz", "amplitude", "(m)", "period", "(s)"]
    told = [float(word) for word in peak.split()]
    assert told == pytest.approx([1 / np.pi, 1.0, np.pi], rel=1e-3)
    assert Path("x.svg").read_text().startswith("<?xml")
    with Path("x.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["frequency", "amplitude"]
    largest = max(rows, key=lambda row: float(row[1]))
    assert float(largest[0]) == pytest.approx(1 / np.pi, abs=0.005)


def test_json_is_one_document(lagsim, result):
    document = lagsim("spectrum", result, "x", "--json").json
    assert (document["result"], document["unit"]) == (result, "m")
    assert document["window"] == "blackmanharris"
    [peak] = document["peaks"]
    assert peak["amplitude"] == pytest.approx(1.0, rel=1e-3)
    refused = lagsim("spectrum", result, "y", "--json", code=2)
    assert refused.json["errors"][0]["code"] == "unknown-name"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("x_dit",), "did you mean `x_dot`?"),
        (("speed",), "hint: its columns are t, x, x_dot, "),
    ],
)
def test_what_cannot_be_is_refused(lagsim, result, words, told):
    called = lagsim("spectrum", result, *words, code=2)
    assert told in called.err


def test_a_file_that_cannot_be_written(lagsim, result):
    called = lagsim("spectrum", result, "x", "-o", "nowhere/x.csv", code=3)
    assert called.reports("E705", "nowhere")
