"""Which tests are run: by name and commit, in turn, and none that is not there."""

import importlib
import re
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.choosing import chosen, share, slices, turn
from tests.conftest import QUICK_ONE_IN, waiting
from tests.patience import PATIENCE, finished
from tests.support import ROOT

NAMES = [f"tests/test_x.py::test_y[{k}]" for k in range(2000)]
# What is asserted of a clock fails where others use the machine.
CLOCK = r"time\.(?:time|monotonic|perf_counter)(?:_ns)?\("
NAMED = re.compile(rf"(\w+)(?:, \w+)* = .*{CLOCK}")
# A bound of time that no `PATIENCE` moves.
IMPATIENT = re.compile(
    r"(?:timeout[= ]*|process_time\(\) - \w+ < |alarm\()[1-9.](?!.*PATIENCE)"
)

# An import of ours within a function, or for types alone.
INNER = re.compile(r"(?m)^ +from ((?:lagsim|tests)[\w.]*) import (\([^)]*\)|.*)")


def test_a_slice_is_the_same_at_every_place_and_about_its_part():
    kept = {name for name in NAMES if chosen(name, "abc", 5)}
    assert 320 < len(kept) < 480  # 400 expected, 18 the spread
    assert {name for name in NAMES[::-1] if chosen(name, "abc", 5)} == kept
    assert all(chosen(name, "abc", 1) for name in NAMES)


@pytest.mark.slow
def test_in_time_all_have_their_turn():
    left = set(NAMES)
    for commit in range(60):  # 2000 * (4/5)^60 = 0.003
        left -= {name for name in NAMES if chosen(name, str(commit), 5)}
    assert not left
    words = "abcdefghijklm"  # 13*(12/13)^100 = 0.004
    assert {turn(NAMES[0], str(commit), words) for commit in range(100)} == {*words}


def test_a_share_has_one_at_least():
    some = NAMES[:20]
    assert [len(share(some, "abc", one_in)) for one_in in (1, 3, 30)] == [20, 7, 1]
    assert share(some[::-1], "abc", 3) == share(some, "abc", 3)
    assert {*share(some, "abc", 3)} != {*share(some, "abd", 3)}


NIGHTS = """\
import pytest
@pytest.mark.nightly(one_in=3)
@pytest.mark.parametrize("k", range(7))
def test_a(k): pass
@pytest.mark.nightly
def test_b(): pass
"""


SLICED = """\
import pytest
@pytest.mark.parametrize("k", range(4))
@pytest.mark.parametrize("j", range(100))
def test_a(j, k): pass
@pytest.mark.slow
@pytest.mark.parametrize("k", range(400))
def test_b(k): pass
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "expected"),
    [("quick", "test_a"), ("slow", "test_b")],
)
def test_a_slice_has_a_part_of_its_kind(tmp_path, kind, expected):
    options = {"LAGSIM_TEST_SLICE": f"{kind}=10", "LAGSIM_TEST_CASES": "all"}
    marked = kind if kind == "slow" else "not slow and not nightly"
    done = pytest_of(tmp_path, SLICED, marked, LAGSIM_TEST_COMMIT="abc", **options)
    found = re.search(r"(\d+) passed", done.stdout)
    # The items are those whose names have their turn.
    grid = [f"{k}-{j}" for k in range(100) for j in range(4)]
    ids = grid if kind == "quick" else [str(k) for k in range(400)]
    names = [f"test_one.py::{expected}[{one}]" for one in ids]
    assert int(found[1]) == sum(chosen(name, "slice abc", 10) for name in names)


@pytest.mark.slow
@pytest.mark.parametrize(("cases", "count"), [("", 4), ("all", 8)])
def test_a_night_has_a_part_of_each_family(tmp_path, cases, count):
    done = pytest_of(tmp_path, NIGHTS, "nightly", LAGSIM_TEST_CASES=cases)
    assert f"{count} passed" in done.stdout, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("marked", ["", pytest.param("slow", marks=pytest.mark.slow)])
def test_of_many_cases_some_are_quick(tmp_path, marked):
    many = '@pytest.mark.parametrize("k", range(60))\ndef test_a(k): pass\n'
    names = [f"test_one.py::test_a[{k}]" for k in range(60)]
    quick = len(share(names, "", QUICK_ONE_IN))
    done = pytest_of(tmp_path, f"import pytest\n{many}", marked)
    assert 0 < quick < 60
    assert f" {60 - quick if marked else quick} passed" in done.stdout, done.stdout


def test_of_few_runs_one_is_quick():
    for cases in ([1], [1, 2], [1, 2, 3]):
        left = waiting("tests/run/test_one.py::test_a", cases, many=False)
        assert len(left) == len(cases) - 1
        assert not waiting("tests/model/test_one.py::test_a", cases, many=False)


def test_slices_are_read():
    assert slices("") == {}
    assert slices("slow=4,nightly=100") == {"slow": 4, "nightly": 100}


@pytest.mark.slow
def test_no_test_asserts_how_late_it_is():
    found = []
    for path, text in sources():
        since = {rf"- {one[1]}\b" for one in NAMED.finditer(text)}
        asked = re.compile(rf"assert .*(?:{'|'.join([CLOCK, *since])})")
        found += [f"{path}: {line}" for line in text.splitlines() if asked.search(line)]
    assert not found, found


def test_every_bound_of_time_has_patience():
    found = [
        f"{path}: {line.strip()}"
        for path, text in sources()
        for line in text.splitlines()
        if IMPATIENT.search(line)
    ]
    assert not found, found


@cache
def sources():
    paths = sorted({*(ROOT / "tests").rglob("*.py")} - {Path(__file__)})
    return [(path.relative_to(ROOT), path.read_text("utf-8")) for path in paths]


def pytest_of(folder, text, marked="", **environment):
    """Run a test file with this project's settings and conftest."""
    (folder / "test_one.py").write_text(text)
    command = ["-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "--rootdir", folder]
    command += ["-m", marked] if marked else []
    command += ["-n", "0", "-p", "no:cacheprovider", "-p", "tests.conftest"]
    return subprocess.run(
        [sys.executable, *map(str, command), str(folder)],
        cwd=folder, capture_output=True, text=True, timeout=120 * PATIENCE,
        env={"PATH": "", "PYTHONPATH": str(ROOT), **environment},
    )  # fmt: skip


def test_imports_within_functions_find_what_they_name():
    # What stands at the head of a test file is imported as all are collected.
    for path, text in sources():
        for source, names in INNER.findall(text):
            module = importlib.import_module(source)
            for name in re.findall(r"(\w+)(?: as \w+)?", names):
                there = hasattr(module, name) or find_spec(f"{source}.{name}")
                assert there, f"{path}: {name} of {source}"


@pytest.mark.slow
def test_a_slow_test_without_its_fixture_fails_a_quick_run(tmp_path):
    text = "import pytest\n@pytest.mark.slow\ndef test_a(nowhere): pass\n"
    done = pytest_of(tmp_path, f"{text}def test_b(): pass\n")
    assert done.returncode != 0
    assert "nowhere of test_one.py::test_a" in done.stdout + done.stderr


TWO = """\
import time, pytest
@pytest.mark.skip(reason='none')
def test_a(): pass
def test_b(): time.sleep(1.0)
"""


@pytest.mark.parametrize(
    ("variables", "fails", "shown"),
    [
        pytest.param(
            {"LAGSIM_TEST_SKIPS": "0"}, True, "1 tests are skipped, 0 may be",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"LAGSIM_TEST_SKIPS": "1"}, False, "1 passed, 1 skipped",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"LAGSIM_TEST_PATIENCE": "0.001"}, True, "in test_b", marks=pytest.mark.slow
        ),
    ],
    ids=str,
)  # fmt: skip
def test_skips_are_counted_and_timeouts_are_moved(tmp_path, variables, fails, shown):
    done = pytest_of(tmp_path, TWO, **variables)
    assert bool(done.returncode) == fails
    assert shown in done.stdout + done.stderr


def test_a_process_that_hangs_shows_where():
    code = "import time\ndef hangs(): time.sleep(1000)\n"
    code += "print('begun', flush=True)\nhangs()"
    run = subprocess.Popen(
        [sys.executable, "-X", "faulthandler", "-c", code],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with pytest.raises(AssertionError, match=r"(?s)begun.*in hangs"):
        finished(run, 2.0)


def test_each_variable_of_the_tests_is_told():
    asked = re.compile(r"environ\.get\(\s*\"(LAGSIM_\w+)\"")
    names = {one[1] for _, text in sources() for one in asked.finditer(text)}
    told = (ROOT / "docs" / "adding.md").read_text("utf-8")
    assert {"LAGSIM_TEST_PATIENCE", "LAGSIM_TEST_SLICE"} <= names
    assert [name for name in sorted(names) if f"`{name}`" not in told] == []
