"""Sweeps at points and samples: draws against Philox and its quantiles, and faults."""

import json
import math

import numpy as np
import pytest
from scipy.special import ndtri

import lagsim
from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.studies.sweep.sweeping import _normal, of_file, sampled
from tests.cli.conftest import lagsim as command  # noqa: F401
from tests.small_scenes import PENDULUM
from tests.support import refused, simulate

MASK = 2**64 - 1


def philox(counter, key):
    """Philox-4x64-10, by the paper of J. K. Salmon et al. (2011): four numbers."""
    x, k = [counter, 0, 0, 0], list(key)
    for _ in range(10):
        a, b = x[0] * 0xD2E7470EE14C6C93, x[2] * 0xCA5A826395121157
        x = [(b >> 64) ^ x[1] ^ k[0], b & MASK, (a >> 64) ^ x[3] ^ k[1], a & MASK]
        k = [(k[0] + 0x9E3779B97F4A7C15) & MASK, (k[1] + 0xBB67AE8584CAA73B) & MASK]
    return x


def uniform(seed, place, count):
    """Draws from 0 to 1: 53 bits of each number."""
    raw = [x for k in range(1, count // 4 + 2) for x in philox(k, (seed, place))]
    return np.array([((x >> 11) + 0.5) / 2**53 for x in raw[:count]])


def sample(given, count=50, seed=0):
    grid = sampled(read(PENDULUM, "<model>"), given.items(), count, seed)
    return {axis.name: np.array(axis.values) for axis in grid.axes}


TWO = {"g": "normal(9.81, 0.5)", "theta": "uniform(-1, pi/2)"}


@pytest.mark.parametrize("seed", [0, 7, 2**64 - 1])
def test_draws_are_those_of_philox(seed):
    found = sample(TWO, 50, seed)
    z = ndtri(uniform(seed, 0, 50))
    assert found["g"] == pytest.approx(9.81 + 0.5 * z, rel=1e-14)
    expected = -1 + (math.pi / 2 + 1) * uniform(seed, 1, 50)
    assert found["theta"].tolist() == expected.tolist()


@pytest.mark.slow
def test_normal_draws_far_out():
    z = sample({"theta": "normal(0, 1)"}, 5_000)["theta"]
    # The stream itself is that of the test before.
    raw = np.random.Philox(key=0).random_raw(5_000)
    expected = ndtri(((raw >> np.uint64(11)) + 0.5) / 2**53)
    assert z == pytest.approx(expected, rel=1e-14, abs=1e-15)
    assert abs(np.mean(z)) < 4 / math.sqrt(len(z))
    assert abs(np.var(z) - 1) < 4 * math.sqrt(2 / len(z))
    # As far out as the smallest and the largest number that can be drawn.
    far = np.array([2.0**-54, 1e-15, 1e-11, 1e-3, 1 - 2.0**-53])
    assert _normal(far) == pytest.approx(ndtri(far), rel=1e-14)


def test_another_name_or_more_runs_do_not_change_draws():
    alone, more = sample({"g": TWO["g"]}, 20), sample(TWO, 30)
    assert alone["g"].tolist() == more["g"][:20].tolist()
    assert abs(np.corrcoef(*sample(TWO, 10_000).values())[0, 1]) < 0.04


@pytest.mark.slow
def test_rows_are_those_of_single_runs(tmp_path):
    points = {"l": [1.0, 2.0, 1.5], "theta": [0.5, 0.25, 1.0]}
    lines = ["l,theta", *(f"{a}, {b}" for a, b in zip(*points.values(), strict=True))]
    (tmp_path / "points.csv").write_text("\ufeff" + "\r\n".join([*lines, "", ""]))
    model = lagsim.load(PENDULUM)
    of_table = lagsim.sweep(model, points=tmp_path / "points.csv")
    for k in range(3):
        bound = model.bind(l=points["l"][k], theta=points["theta"][k])
        assert of_table["theta.end"][k] == simulate(bound)["theta"][-1]
    of_values = lagsim.sweep(model, points=points, jobs=1)
    assert of_values["theta.end"].tolist() == of_table["theta.end"].tolist()
    assert of_table.record["points"] is True
    ends = lagsim.sweep(model, points=points, ends=True)
    assert ends["theta.end"].tolist() == of_table["theta.end"].tolist()
    assert of_table.plot("theta.end").axes


@pytest.mark.slow
def test_the_command(command, tmp_path):  # noqa: F811
    (tmp_path / "pendulum.yaml").write_text(PENDULUM)
    given = [x for name, text in TWO.items() for x in ("--sample", f"{name}={text}")]
    line = ["sweep", "pendulum.yaml", *given, "-N", "2", "--seed", "3", "-o", "out"]
    assert command(*line).code == 0
    record = json.loads((tmp_path / "out" / "sweep.json").read_text())
    assert [x["drawn"] for x in record["grid"]] == [*TWO.values()]
    assert (record["seed"], record["runs"]) == (3, 2)
    assert record["grid"][0]["values"] == sample(TWO, 2, 3)["g"].tolist()
    assert (tmp_path / "out" / "sweep.png").exists()
    assert "already contains" in command(*line, "--resume").out
    model = lagsim.load(tmp_path / "pendulum.yaml")
    there = lagsim.sweep(model, sample=TWO, N=2, seed=3)
    rows = (tmp_path / "out" / "sweep.csv").read_text().splitlines()
    assert [float(row.split(",")[0]) for row in rows[1:]] == there["g"].tolist()


FILES = {
    "": ["1: no points"], "l,theta\n": ["1: no points"],
    "l,l\n1,2\n": ["1: the header has"], "l\n1,2\n\n3\nx\n": ["2: 2 cells", "5: `x`"],
    "l\nnan\n1_0\n": ["2: `nan`", "3: `1_0`"], "\nlength\n1\n": ["2: `length` is no"],
}  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), FILES.items())
def test_faults_of_a_file_have_lines(text, expected, tmp_path):
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises(InputError) as found:
        of_file(read(PENDULUM, "<model>"), path)
    texts = [x.text for x in found.value.problems]
    assert len(texts) == len(expected)
    for one, part in zip(texts, expected, strict=True):
        assert one.startswith(f"{path}:{part}")


def test_python_wants_one_of_them():
    for given in ({}, {"values": {"g": [1]}, "points": {"g": [1]}}, {"sample": TWO}):
        with pytest.raises(TypeError):
            lagsim.sweep(PENDULUM, **given)
    with refused("usage", "2, 1 "):
        lagsim.sweep(PENDULUM, points={"g": [1, 2], "l": [1]})
