"""Measures of sweeps from a time on: closed forms, and which rows count."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import lagsim
from lagsim.run.observers import SUMMED, Measures
from tests.cli.conftest import lagsim as command  # noqa: F401
from tests.support import refused, simulate

# From the state of the steady motion, and, `x0` and `v0` added, with a transient.
DRIVEN = """
parameters: {m: 1.5, k: 20, c: 2, F: 3, w: 4, x0: 0, v0: 0, T: 2*pi/w,
  a: k - m*w^2, b: c*w, s: F/(a^2 + b^2)}
coordinates: {x: {unit: m}}
energy: {kinetic: m*x_dot^2/2, potential: k*x^2/2, dissipation: c*x_dot^2/2}
forces: {x: F*cos(w*t)}
initial: {x: a*s + x0, x_dot: b*s*w + v0}
simulation: {duration: 12*T, output_step: T/50}
"""
PARTS = ("min", "max", "mean", "rms", "peak_to_peak")


def measures(rows):
    """Return the measures of rows by their definitions, in order of PARTS."""
    mean = math.fsum(rows) / len(rows)
    rms = math.sqrt(math.fsum((x - mean) ** 2 for x in rows) / len(rows))
    return [min(rows), max(rows), mean, rms, max(rows) - min(rows)]


def driven(w, t):
    """Return the steady motion of DRIVEN, and its rate."""
    a, b = 20 - 1.5 * w**2, 2 * w
    size, phase = 3 / math.hypot(a, b), math.atan2(b, a)
    return size * np.cos(w * t - phase), -size * w * np.sin(w * t - phase)


def of(found, column, k=0):
    return [found[f"{column}.{part}"][k] for part in PARTS]


@pytest.mark.slow
def test_a_steady_motion_has_the_measures_of_its_closed_form():
    swept = {"w": [2, 3.5, 6]}
    found = lagsim.sweep(lagsim.load(DRIVEN), swept, from_="7*T", error_bar="never")
    for k, w in enumerate(found["w"]):
        period = 2 * math.pi / w
        rows = driven(w, period * np.arange(350, 601) / 50)
        assert of(found, "x", k) == pytest.approx(measures(rows[0]), abs=1e-9)
        assert of(found, "x_dot", k) == pytest.approx(measures(rows[1]), abs=1e-9)
        size = 3 / math.hypot(20 - 1.5 * w**2, 2 * w)
        # 50 rows a period miss the crest by at most 1 - cos(pi/50).
        assert 2 * size * math.cos(math.pi / 50) <= found["x.peak_to_peak"][k]
        assert found["x.peak_to_peak"][k] <= 2 * size + 1e-9
        # One row more than five periods: the first and the last are alike.
        assert found["x.rms"][k] == pytest.approx(size / math.sqrt(2), rel=1 / 250)


def test_a_transient_before_the_time_does_not_count():
    model = lagsim.load(DRIVEN, x0=2, v0=-5)
    whole, late = (
        lagsim.sweep(model, {"w": [4]}, from_=t, error_bar="never") for t in (0, "9*T")
    )
    # It decays by exp(-c t/(2 m)) from an amplitude of at most 5.
    left = 5 * math.exp(-2 / 3 * 9 * math.pi / 2)
    t = math.pi / 2 * np.arange(450, 601) / 50
    expected = measures(driven(4, t)[0])
    assert of(late, "x") == pytest.approx(expected, abs=2 * left)
    assert whole["x.max"] >= 2 + driven(4, 0)[0] - 1e-15
    assert whole["x.rms"] > 1.2 * late["x.rms"]
    # The end is that of the whole run.
    assert late["x.end"] == whole["x.end"]


def test_without_a_time_there_are_extremes_of_the_whole_run_alone():
    model = lagsim.load(DRIVEN, x0=2)
    plain = lagsim.sweep(model, {"w": [4]}, error_bar="never")
    assert not [x for x in plain.columns if x.endswith(("mean", "rms", "peak"))]
    whole = lagsim.sweep(model, {"w": [4]}, from_=0, error_bar="never")
    for name in plain.columns:
        np.testing.assert_array_equal(plain[name], whole[name])


def test_columns_stand_after_the_extremes():
    found = lagsim.sweep(lagsim.load(DRIVEN), {"w": [4]}, from_=1, error_bar="never")
    told = [f"x.{x}" for x in ("end", *PARTS)]
    assert [*found.columns[5:11]] == told
    assert found.plot("x.rms", "x.peak_to_peak").axes


FALLING = """
parameters: {g: 10, low: 9}
coordinates: {y: {unit: m}}
definitions: {level: 0.1, x: y - 3e9}
energy: {kinetic: y_dot^2/2, potential: g*y}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
initial: {y: 1}
simulation: {start: 0.1, duration: 1, output_step: 0.1}
"""


@pytest.mark.parametrize(
    "since", ["0.1", "0.3", "0.4 + 0.3", "0.8", "1.1", "-5", "g/20"]
)
def test_all_rows_count_alike_from_the_time_on(since):
    """Both rows of an impact, too; and a row that is below the time by rounding."""
    model = lagsim.load(FALLING)
    single = simulate(model)
    found = lagsim.sweep(model, {"g": [10]}, from_=since, error_bar="never")
    time = eval(since, {"g": 10})  # noqa: S307
    kept = single.t >= time - 1e-12
    impact = math.sqrt(2 / 10) + 0.1
    assert np.sum(np.abs(single.t - impact) < 1e-9) == 2
    for column in single.columns[1:]:
        rows = single[column][kept]
        expected = measures(rows)
        scale = np.max(np.abs(rows))
        assert of(found, column) == pytest.approx(
            expected, rel=1e-12, abs=1e-15 * scale
        )
    assert found["level.mean"][0] == 0.1
    assert found["level.rms"][0] == 0.0


def test_a_deviation_far_from_zero_keeps_its_digits():
    """Rows are rounded to 2^-22 there; sums of their squares would lose the rest."""
    model = lagsim.load(FALLING)
    found = lagsim.sweep(model, {"g": [10]}, from_=0.2, error_bar="never")
    assert found["x.rms"][0] == pytest.approx(found["y.rms"][0], abs=2**-21)


def test_values_that_are_not_a_number_do_not_count():
    rng = np.random.default_rng(5)
    rows = rng.normal(np.array([0, 1e6, 0, 0]), size=(1000, 4))
    rows[:, 0] = np.arange(1000)
    rows[::3, 1] = rows[:, 2] = np.nan
    rows[::7, 3] = np.nan
    whole = Measures(4, 500.0)
    whole.add(rows)
    for column in (1, 3):
        kept = rows[500:, column]
        expected = measures(kept[~np.isnan(kept)])
        # The rounding error of a mean near 10^6.
        within = np.spacing(np.nanmax(kept))
        assert whole.stacked[1:, column] == pytest.approx(expected, rel=0, abs=within)
    assert np.isnan(whole.stacked[:, 2]).all()


def test_sums_do_not_depend_on_how_rows_are_divided():
    """The rows of a run with progress are divided otherwise; its bytes are equal."""
    rng = np.random.default_rng(6)
    rows = rng.normal(size=(3 * SUMMED + 7, 3)) + 1e3
    rows[:, 0] = np.arange(len(rows))
    whole, parts = Measures(3, 20.0), Measures(3, 20.0)
    parts.add(rows[:40])
    parts.begin_anew()
    whole.add(rows)
    cuts = np.sort(rng.integers(0, len(rows), 30))
    for block in np.split(rows, cuts):
        parts.add(block)
    assert parts.stacked.tobytes() == whole.stacked.tobytes()
    assert (parts.rows, parts.last) == (len(rows), rows[-1, 0])


def test_a_run_that_ends_before_the_time_has_no_measures():
    model = lagsim.load(FALLING.replace("{start", "{until: y_dot <= -g*low, start"))
    found = lagsim.sweep(model, {"low": [0.2, 2]}, from_=0.5, error_bar="never")
    assert found["outcome"].tolist() == ["until", "done"]
    assert found["t.end"] == pytest.approx([0.3, 1.1])
    for part in PARTS:
        assert np.isnan(found[f"y.{part}"]).tolist() == [True, False]
    assert found["y.end"][0] == pytest.approx(1 - 0.2)


def test_a_time_after_the_end_is_refused_or_a_row():
    model = lagsim.load(DRIVEN)
    with refused("out-of-range", "from_=13*T"):
        lagsim.sweep(model, {"w": [4]}, from_="13*T")
    found = lagsim.sweep(model, {"w": [4, 8]}, from_=15, error_bar="never")
    assert found["outcome"].tolist() == ["done", "unusable"]
    assert "from" in found["reason"][1]
    with refused("unknown-name", "from_=q"):
        lagsim.sweep(model, {"w": [4]}, from_="q")
    with pytest.raises(TypeError, match="from_"):
        lagsim.sweep(model, {"w": [4]}, from_=[1])
    with pytest.raises(TypeError, match="rows"):
        lagsim.sweep(model, {"w": [4]}, from_=1, ends=True)


@pytest.mark.slow
def test_the_command(command):  # noqa: F811
    Path("driven.yaml").write_text(DRIVEN, encoding="utf-8")
    line = (
        "sweep",
        "driven.yaml",
        "w=3,4",
        "--from",
        "7*T",
        "--error-bar",
        "never",
        "--no-plots",
    )
    called = command(*line, "-j", 1, "--json")
    assert called.code == 0
    assert called.json["options"]["from"] == "7*T"
    folder = Path("results/driven/sweep")
    content = (folder / "sweep.csv").read_bytes()
    [first, _] = csv.DictReader(content.decode().splitlines())
    model = lagsim.load("driven.yaml")
    found = lagsim.sweep(model, {"w": [3, 4]}, from_="7*T", error_bar="never")
    assert [float(first[f"x.{part}"]) for part in PARTS] == of(found, "x")
    assert command(*line, "-j", 1, "--keep", "-o", "kept", "-q").code == 0
    assert Path("kept/sweep.csv").read_bytes() == content
    # A sweep from another time is another sweep.
    assert "already contains" in command(*line, "--resume").out
    again = [*(x.replace("7*T", "6*T") for x in line), "--resume"]
    assert "already contains" not in command(*again).out
    refused = command(*line, "--ends")
    assert (refused.code, "--ends stores no rows" in refused.err) == (2, True)
    for text, fault in (("13*T", "E129"), ("3*q", "E209")):
        refused = command("sweep", "driven.yaml", "w=3", "--from", text)
        assert (refused.code, f"--from {text}:1:" in refused.err) == (2, True)
        assert fault in refused.err
