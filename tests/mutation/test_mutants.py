"""Whether tests notice small changes of the source; what makes these, by itself.

    pytest -m nightly tests/mutation -n0 -s

tries 50 mutants of this commit; `LAGSIM_MUTANTS=20` that many, and
`LAGSIM_MUTATED=page,run` in these rooms alone.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from tests.mutation.mutants import (
    ROOMS,
    ROOT,
    STARTING,
    Clean,
    Copy,
    Mutant,
    Trial,
    chosen,
    compiles,
    exercising,
    mutants_of,
    over_budget,
)  # fmt: skip

needs_node = pytest.mark.skipif(not shutil.which("node"), reason="no node on PATH")
needs_git = pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a clone")


def made(path, text):
    return [mutant.applied(text) for mutant in mutants_of("page", path, text)]


def test_mutants_of_python():
    text = (
        'def f(a, *b):  # 1 + 1\n    """2 < 3."""\n    return a - 2 if not b else 0.5\n'
    )
    head, _ = text.split("return")
    assert made("zero.py", "x = 0.0\n") == ["x = 1.0\n"]
    assert made("zip.py", "zip(a, b, strict=True)\n") == []
    assert made("f.py", text) == [
        f"{head}return a + 2 if not b else 0.5\n",
        f"{head}return a - 3 if not b else 0.5\n",
        f"{head}return a - 2 if  b else 0.5\n",
        f"{head}return a - 2 if not b else 0.75\n",
    ]


def test_mutants_of_the_script():
    text = 'const f = (x) => x <= 1 && "1 < 2"; // 3 + 4\n'
    text += "y += x === 2 ? Math.min(x) : `-${x}`;"
    line, other = text.split("\n")
    assert made("f.js", text) == [
        f"{line.replace('<= 1', '< 1')}\n{other}",
        f"{line.replace('= 1', '= 2')}\n{other}",
        f"{line.replace('&&', '||')}\n{other}",
        *(f"{line}\n{other.replace(a, b)}" for a, b in (
            ("+=", "-="), ("===", "!=="), ("= 2", "= 3"), ("min", "max"))),
    ]  # fmt: skip


@needs_node
@pytest.mark.parametrize(
    "rooms", [("plan", "api"), pytest.param(tuple(ROOMS), marks=pytest.mark.slow)]
)
def test_the_same_of_a_commit_others_of_another(rooms):
    count = 2 * len(rooms)
    one, again, other = (chosen(name, count, rooms) for name in ("a", "a", "b"))
    assert one == again
    assert len(set(one) & set(other)) < 0.5 * count
    assert {mutant.room for mutant in one} == set(rooms)
    for mutant in one:
        text = (ROOT / mutant.path).read_text("utf-8")
        assert mutant.applied(text) != text
        assert compiles(mutant, text)


def test_rooms_and_all_of_them_over_their_budgets():
    mutant = Mutant("page", "view.js", 1, 0, "+", "-")
    # A quarter of eight and twice their spread, 2.4, are less than five.
    tried = [(mutant, k < 5) for k in range(8)]
    assert over_budget(tried) == ["page: 5 of 8 live", "all: 5 of 8 live"]
    assert over_budget([(mutant, k < 4) for k in range(8)]) == []
    assert over_budget([(mutant, True)]) == []
    # Two of three in each say nothing of it; of all rooms together they do.
    every = [mutant._replace(room=room) for room in ROOMS for _ in range(3)]
    [told] = over_budget([(one, k % 3 < 2) for k, one in enumerate(every)])
    assert told == f"all: {2 * len(ROOMS)} of {3 * len(ROOMS)} live"
    assert over_budget([(one, k % 3 == 0) for k, one in enumerate(every)]) == []


def test_tests_that_may_notice_a_mutant_come_soonest_first_and_not_all():
    long, short, other, named = (f"tests/{name}" for name in (
        "test_a.py::test_x[0]", "test_a.py::test_x[1]", "test_a.py::test_y",
        "test_units.py::test_z"))  # fmt: skip
    seconds = {long: 50.0, other: 8.0, short: 2.0, named: 40.0}
    mutant = Mutant("outputs", "lagsim/outputs/units.py", 7, 0, "+", "-")
    clean = Clean(seconds, {mutant.path: {7: {*seconds}, 8: {long}}})
    # What has a like name, one case of each test; more than 60 s of them are too many.
    assert exercising(mutant, "", [clean]) == ([named, short, other], STARTING + 150.0)
    assert exercising(mutant._replace(line=8), "", [clean]) == (
        [long],
        STARTING + 150.0,
    )
    # No test is known to run its line: all of them may.
    assert exercising(mutant._replace(line=9), "", [clean])[0] == [named, short, other]


@pytest.mark.slow
@needs_git
def test_what_tests_notice(tmp_path):
    copy = Copy(tmp_path)
    path = "lagsim/outputs/units.py"
    text = (ROOT / path).read_text("utf-8")
    tests = ["tests/outputs/test_units.py"]
    # A line that says nothing, one that ends the reading of the file, and no end.
    for line, noticed in (("#", False), ("0 / 0", True), ("while True: pass", True)):
        mutant = Mutant("outputs", path, 1, len(text) - 1, "\n", f"\n{line}\n")
        assert copy.notices(mutant, tests, 10.0) == noticed
        assert (copy.tree / path).read_text("utf-8") == text
    clean = copy.clean(tests[0], "all")
    assert clean.seconds.keys() == set.union(*clean.lines[path].values())


@pytest.mark.nightly
@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="its own night: -n0")
@pytest.mark.timeout(0)
@needs_node
@needs_git
def test_mutants_of_this_commit(tmp_path):
    head = ["git", "rev-parse", "HEAD"]
    commit = subprocess.run(head, cwd=ROOT, capture_output=True, check=True).stdout
    count = int(os.environ.get("LAGSIM_MUTANTS", "50"))
    rooms = tuple(filter(None, os.environ.get("LAGSIM_MUTATED", "").split(",")))
    mutants, tried = sorted(chosen(commit.decode().strip(), count, rooms)), []
    for one in Trial(tmp_path).survivors(mutants):
        tried.append(one)
        sys.stdout.write(f"{'LIVES' if one[1] else 'dies '} {one[0]}\n")
        sys.stdout.flush()
    lives = "\n".join(str(mutant) for mutant, lived in tried if lived)
    assert not over_budget(tried), f"{over_budget(tried)}; living:\n{lives}"
