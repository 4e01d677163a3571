"""Table of mutants and the tests that kill them.

    python -m tests.mutation.table mechanics --mutants 40 --seed 7

tries mutants of a room (a key of `ROOMS`; `--files` selects some files of it) against
the tests of the room (`--tests` selects others), and prints the tests that fail with
each. The last lines have the detection power, and the tests that no mutant needs: those
that exercise a mutated line, and are never the only test that kills a mutant.
"""

from __future__ import annotations

import argparse
import collections
import json
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from tests.mutation.mutants import ROOMS, Copy, Mutant, chosen, exercising

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


class Kills(NamedTuple):
    """A mutant, the tests that exercise its line, and those that kill it."""

    mutant: Mutant
    tested: tuple[str, ...]
    killers: frozenset[str]


def family(test: str) -> str:
    """Return the name of a test without its case."""
    return test.partition("[")[0]


def rows(
    mutants: Sequence[Mutant], tests: Sequence[str], most: float, cases: str
) -> Iterator[Kills]:
    """Try mutants one after the other; yield the kills of each.

    Parameters
    ----------
    tests : sequence of str
        Files or folders of tests.
    most : float
        The largest time of the tests of one mutant, in s without the mutant.
    cases : str
        The value of LAGSIM_TEST_CASES.
    """
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder))
        clean = [copy.clean(one, cases) for one in tests]
        for mutant in mutants:
            text = (copy.tree / mutant.path).read_text("utf-8")
            some, limit = exercising(mutant, text, clean, most)
            found = frozenset(copy.killers(mutant, some, limit))
            yield Kills(mutant, tuple(some), found)


def summary(found: Sequence[Kills]) -> dict[str, object]:
    """Return the detection power, the single killers, and the tests without a kill.

    single : mutants by the test that alone kills them
    shared : the numbers of mutants of tests that kill some, but none alone
    none : tests that exercise mutated lines and kill no mutant
    """
    single = collections.defaultdict(list)
    shared: collections.Counter[str] = collections.Counter()
    tested: set[str] = set()
    for row in found:
        tested |= {family(test) for test in row.tested}
        families = {family(test) for test in row.killers}
        shared.update(families)
        if len(families) == 1:
            single[families.pop()].append(str(row.mutant))
    return {
        "mutants": len(found),
        "killed": sum(bool(row.killers) for row in found),
        "single": dict(sorted(single.items())),
        "shared": {test: n for test, n in sorted(shared.items()) if test not in single},
        "none": sorted(tested - shared.keys()),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of a room."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", choices=ROOMS)
    parser.add_argument("--mutants", type=int, default=20)
    parser.add_argument("--seed", default="")
    parser.add_argument("--files", default="", help="part of the paths of files")
    parser.add_argument("--tests", nargs="*", help="default: the tests of the room")
    parser.add_argument("--most", type=float, default=60.0, help="seconds a mutant")
    parser.add_argument("--cases", default="", help="all: also cases that are slow")
    given = parser.parse_args(arguments)
    mutants = chosen(given.seed, given.mutants, (given.room,), given.files)
    found = []
    tests = given.tests or ROOMS[given.room].tests
    for row in rows(mutants, tests, given.most, given.cases):
        found.append(row)
        sys.stdout.write(f"{row.mutant}: {len(row.tested)} tests\n")
        sys.stdout.writelines(f"    {test}\n" for test in sorted(row.killers))
        sys.stdout.flush()
    sys.stdout.write(json.dumps(summary(found), indent=1) + "\n")


if __name__ == "__main__":
    main()
