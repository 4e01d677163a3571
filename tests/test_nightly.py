"""Long fuzzing of all parts with random input, and charts of all models in turn."""

import csv
import importlib
import os
import random
import re
import secrets
import shutil
import sys
from pathlib import Path

import pytest

from lagsim.model.reader import read_file
from tests.cli.conftest import lagsim  # noqa: F401
from tests.support import MODELS, SHIPPED

pytestmark = pytest.mark.timeout(7200)

# Within half a minute of each: a try takes 0.3 to 2.7 ms.
TRIES = int(os.environ.get("LAGSIM_TRIES", "10000"))
FUZZED = {
    "language.test_parser": ("test_any_text_parses_or_is_refused_in_its_place",),
    "language.test_evaluate": ("test_the_bound_bounds",),
    "language.test_graph": (
        "test_simplification_keeps_values",
        "test_substituting_is_evaluating_at_the_new_value",
    ),
}  # fmt: skip
# Errors of the double pendulum grow tenfold in 2 s: in 20 s none keeps nine digits.
SHORTER = {"double-pendulum": 5}
CASES = [(module, name) for module, names in FUZZED.items() for name in names]


def fuzzed(module, name):
    return getattr(importlib.import_module(f"tests.{module}"), name)


@pytest.mark.parametrize(("module", "name"), CASES, ids=[name for _, name in CASES])
def test_what_the_night_fuzzes_exists(module, name):
    fuzzed(module, name).hypothesis.fuzz_one_input(b"")


@pytest.mark.nightly
@pytest.mark.parametrize(("module", "name"), CASES, ids=[name for _, name in CASES])
def test_long_fuzzing(module, name, record_property):
    test = fuzzed(module, name)
    seed = secrets.randbits(32)
    record_property("seed", seed)
    print(f"seed {seed}")  # noqa: T201  shown where it fails
    source = random.Random(seed)
    for _ in range(TRIES):
        test.hypothesis.fuzz_one_input(source.randbytes(source.choice((64, 512, 4096))))


@pytest.mark.nightly(one_in=2)
@pytest.mark.parametrize("name", SHIPPED)
def test_every_chart(name, lagsim):  # noqa: F811
    text = (MODELS / f"{name}.yaml").read_text(encoding="utf-8")
    if name in SHORTER:
        text, one = re.subn(r"duration: \S+", f"duration: {SHORTER[name]}", text)
        assert one == 1
    model = Path(f"{name}.yaml")
    model.write_text(text, encoding="utf-8")
    for table in MODELS.glob("*.csv"):
        shutil.copy(table, table.name)
    row = read_file(str(model)).settings().output_step
    # Bounded by the work asked for, not by the seconds of a clock.
    few = ("--tolerances", "1e-6:1e-13", "--steps", f"{4 * row!r}:{row!r}")
    called = lagsim("bench", model, "-o", "out", *few, "--budget", "3600")
    assert called.code == 0, called.err
    table = Path("out/work_precision.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(table.splitlines()))
    assert Path("out/work_precision.png").stat().st_size > 10_000
    # A stone that is thrown lands before the time is over.
    ends = "until" if name == "trebuchet" else "done"
    assert {row["outcome"] for row in rows if row["chosen"] == "true"} == {ends}
    # Some method reaches nine digits on every shipped model.
    best = min(float(row["error"]) for row in rows if row["error"])
    assert best < 1e-9
    print(name, best, file=sys.stderr)  # noqa: T201  for the night's record


@pytest.mark.nightly(one_in=2)
@pytest.mark.parametrize("name", SHIPPED)
def test_every_map_of_stability(name, lagsim):  # noqa: F811
    called = lagsim("stability", MODELS / f"{name}.yaml", "-o", "out")
    assert called.code in (0, 2), called.err
    if called.code == 2:  # nothing to linearise, and says so
        assert re.search(r"\[E\d{3}\]", called.err), called.err
        assert "hint: " in called.err
    else:
        assert any(p.suffix == ".png" for p in Path("out").iterdir())
