"""Detection of small changes of the source by tests; tests of the generator.

    pytest -m nightly tests/mutation -n0 -s

tries 50 mutants of this commit; `LAGSIM_MUTANTS=20` tries 20, and
`LAGSIM_MUTATED=page,run` in these rooms alone.
"""

import os
import shutil
import subprocess
import sys

import pytest

from tests.mutation.mutants import (
    ROOMS,
    ROOT,
    Copy,
    Mutant,
    Trial,
    chosen,
    compiles,
    over_budget,
)  # fmt: skip
from tests.mutation.table import Kills, summary

needs_node = pytest.mark.skipif(not shutil.which("node"), reason="no node on PATH")
needs_git = pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a clone")


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


@pytest.mark.slow
@needs_git
def test_what_tests_notice(tmp_path):
    copy = Copy(tmp_path)
    path = "lagsim/language/units.py"
    text = (ROOT / path).read_text("utf-8")
    tests = ["tests/outputs/test_units.py"]
    # A line that says nothing, one that ends the reading of the file, and no end.
    for line, noticed in (("#", False), ("0 / 0", True), ("while True: pass", True)):
        mutant = Mutant("language", path, 1, len(text) - 1, "\n", f"\n{line}\n")
        assert copy.notices(mutant, tests, 10.0) == noticed
        assert (copy.tree / path).read_text("utf-8") == text
    clean = copy.clean(tests[0], "all")
    assert clean.seconds.keys() == set.union(*clean.lines[path].values())


def test_the_summary_of_a_table():
    a, b, c = (Mutant("language", "x.py", k, 0, "+", "-") for k in range(3))
    tested = "t.py::one[0]", "t.py::one[1]", "t.py::two", "t.py::idle"
    found = summary(
        [
            Kills(a, tested, frozenset(tested[:2])),  # two cases of one test
            Kills(b, tested, frozenset(tested[1:3])),
            Kills(c, tested, frozenset()),
        ]
    )
    assert (found["mutants"], found["killed"]) == (3, 2)
    assert found["single"] == {"t.py::one": [str(a)]}
    assert found["shared"] == {"t.py::two": 1}
    assert found["none"] == ["t.py::idle"]


@pytest.mark.slow
@needs_git
def test_all_killers_of_a_mutant(tmp_path):
    copy = Copy(tmp_path)
    path = "lagsim/language/units.py"
    text = (ROOT / path).read_text("utf-8")
    mutant = Mutant("language", path, 1, len(text) - 1, "\n", "\n0 / 0\n")
    assert copy.killers(mutant, ["tests/outputs/test_units.py"], 10.0) == {
        "tests/outputs/test_units.py"
    }
    mutant = mutant._replace(new="\n#\n")
    assert copy.killers(mutant, ["tests/outputs/test_units.py"], 10.0) == set()


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
