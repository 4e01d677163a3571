"""Small changes of the source, one at a time, that some test should notice.

A mutant is another operator, number or word at one place of a file. Mutants are taken
from a few rooms in turn, by a commit's hash: each commit has others, and the same ones
again. One that no test of its room notices has survived.

mutmut and cosmic-ray change Python alone. The first puts its switches into functions,
whose text is translated here; neither knows the page's script.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import time
import tokenize
from pathlib import Path
from typing import NamedTuple

from coverage import CoverageData

from tests.patience import PATIENCE

ROOT = Path(__file__).parents[2]
PAGE = "outputs/animation/*.js"
# What is put in place of what; numbers besides.
PLAIN = {
    "+": "-", "-": "+", "*": "/", "/": "*", "<": "<=", "<=": "<", ">": ">=", ">=": ">",
    "==": "!=", "!=": "==", "+=": "-=", "-=": "+=",
}  # fmt: skip
PYTHON = PLAIN | {
    "and": "or", "or": "and", "not": "", "True": "False", "False": "True",
    "min": "max", "max": "min", "any": "all", "all": "any", "break": "continue",
}  # fmt: skip
SCRIPT = PLAIN | {
    "&&": "||", "||": "&&", "===": "!==", "!==": "===", "true": "false",
    "false": "true", "min": "max", "max": "min", "sin": "cos", "cos": "sin",
    "floor": "ceil", "ceil": "floor", "some": "every", "every": "some",
    "moveTo": "lineTo", "fill": "stroke", "stroke": "fill",
}  # fmt: skip
# Comments, texts and patterns are passed over as a whole; `=>` and the like as well.
_SCRIPT = re.compile(
    r"""//[^\n]*|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|`(?:\\.|[^`\\])*`"""
    r"""|(?<=[=(]\s)/[^/\n]+/|\(/[^/\n]+/|===|!==|=>|\+\+|--|>>|<<|\*\*|\?\.|\|\||&&"""
    r"""|[-+<>=!*/]=?|\d+(?:\.\d+)?(?:e-?\d+)?|\.\d+|[A-Za-z_$][\w$]*|\S"""
)
# What says so raises where there is a fault, and changes nothing where there is none.
_CHECKS = re.compile(r"\b(strict|slots|frozen)=$")
# How a file of kernels says so: by its words, or by what a kernel takes.
_KERNELS = re.compile(r"native\.kernels\.words import|\bs: \w+, p: Parameters")


class Room(NamedTuple):
    """Where mutants are made, which tests should notice, how many may survive."""

    files: str
    tests: tuple[str, ...]
    budget: float


# Budgets are parts of the mutants of a room, as they were found to live in a whole run
# (some do the same by other means). Three or four of a room say little: its budget is
# passed where chance explains no such number, and so is that of all together. Budgets
# go down, not up.
ROOMS = {
    "page": Room(PAGE, (
        "tests/outputs/test_page_drawing.py", "tests/outputs/test_page_panel.py",
    ), 0.25),
    "language": Room("language/**/*.py", ("tests/language",), 0.25),
    "model": Room("model/**/*.py", ("tests/model", "tests/codes"), 0.35),
    "mechanics": Room("mechanics/**/*.py", ("tests/mechanics", "tests/solve"), 0.5),
    "admissibility": Room("admissibility/**/*.py", ("tests/admissibility",), 0.4),
    "show": Room("show/**/*.py", ("tests/show",), 0.35),
    "native": Room("native/**/*.py", ("tests/native", "tests/solve"), 0.35),
    "methods": Room("methods/**/*.py", ("tests/methods",), 0.5),
    "solve": Room("solve/**/*.py", ("tests/solve", "tests/mechanics"), 0.35),
    "plan": Room(
        "plan/**/*.py", ("tests/plan", "tests/cli/test_formulations.py"), 0.5
    ),
    "run": Room("run/**/*.py", ("tests/run",), 0.35),
    "outputs": Room("outputs/**/*.py", ("tests/outputs",), 0.35),
    "studies": Room("studies/**/*.py", ("tests/studies", "tests/golden"), 0.35),
    "api": Room("api/**/*.py", ("tests/api",), 0.25),
    "cli": Room("cli/**/*.py", ("tests/cli",), 0.25),
}  # fmt: skip
# So many rooms a night, beside the page.
A_NIGHT = 4
# Where behaviour is held: what the tests of its room let live meets these, too.
WAISTS = (
    "tests/golden", "tests/scenes", "tests/invariance", "tests/hunt", "tests/cli",
    "tests/api", "tests/run", "tests/studies",
)  # fmt: skip


class Mutant(NamedTuple):
    """A change of one word of a file; `line` counts from 1."""

    room: str
    path: str
    line: int
    start: int
    old: str
    new: str

    def __str__(self) -> str:
        place = f"{self.path}:{self.line}"
        return f"{self.room:13} {place}: {self.old!r} -> {self.new!r}"

    def applied(self, text: str) -> str:
        end = self.start + len(self.old)
        assert text[self.start : end] == self.old
        return text[: self.start] + self.new + text[end:]


def words_of_python(text: str) -> list[tuple[int, str]]:
    """Give each word of Python that is code, and where it begins."""
    begins = [0]
    for line in text.splitlines(keepends=True):
        begins.append(begins[-1] + len(line))
    kinds = (tokenize.OP, tokenize.NAME, tokenize.NUMBER)
    return [
        (begins[token.start[0] - 1] + token.start[1], token.string)
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type in kinds
    ]


def words_of_script(text: str) -> list[tuple[int, str]]:
    """Give each word of JavaScript, and where it begins."""
    return [(found.start(), found[0]) for found in _SCRIPT.finditer(text)]


def _other(word: str, table: dict[str, str]) -> str | None:
    if word[0].isdigit():
        if not re.fullmatch(r"\d+(\.\d+)?(e-?\d+)?", word):
            return None
        if word.isdigit():
            return str(int(word) + 1)
        return repr(1.5 * float(word) or 1.0)
    return table.get(word)


def mutants_of(room: str, path: str, text: str) -> list[Mutant]:
    """Give all mutants of a file; those that do not compile are among them."""
    script = path.endswith(".js")
    words = words_of_script(text) if script else words_of_python(text)
    table = SCRIPT if script else PYTHON
    found = []
    for (_, before), (start, word) in zip([(0, ""), *words], words, strict=False):
        # A star before an argument is no product.
        if word in "*/" and not (before[-1:].isalnum() or before[-1:] in ")]_"):
            continue
        new = _other(word, table)
        if new is not None and not _CHECKS.search(text[start - 8 : start]):
            line = text.count("\n", 0, start) + 1
            found.append(Mutant(room, path, line, start, word, new))
    return found


def compiles(mutant: Mutant, text: str) -> bool:
    """Tell whether a mutant of a file can be read at all."""
    changed = mutant.applied(text)
    if mutant.path.endswith(".js"):
        node = ["node", "--check", "-"]
        return not subprocess.run(
            node, input=changed.encode(), capture_output=True
        ).returncode
    try:
        compile(changed, mutant.path, "exec")
    except SyntaxError:
        return False
    return True


def rooms_of(commit: str) -> tuple[str, ...]:
    """Give the rooms whose turn it is: each has to be run once without a mutant."""
    others = [name for name in ROOMS if name != "page"]
    first = int(hashlib.sha256(commit.encode()).hexdigest(), 16) % len(others)
    return ("page", *(2 * others)[first : first + A_NIGHT])


def chosen(commit: str, count: int, rooms: tuple[str, ...] = ()) -> list[Mutant]:
    """Give so many mutants by the hash of a commit, from some rooms in turn."""
    names = rooms or rooms_of(commit)
    every: dict[str, list[Mutant]] = {}
    found: list[Mutant] = []
    draw = 0
    first = int(hashlib.sha256(commit.encode()).hexdigest(), 16)
    while len(found) < count:
        room = names[(first + len(found)) % len(names)]
        if room not in every:
            paths = sorted((ROOT / "lagsim").glob(ROOMS[room].files))
            every[room] = [
                mutant
                for path in paths
                for mutant in mutants_of(
                    room, path.relative_to(ROOT).as_posix(), path.read_text("utf-8")
                )
            ]
        seed = hashlib.sha256(f"{commit} {draw}".encode()).hexdigest()
        mutant = every[room][int(seed, 16) % len(every[room])]
        draw += 1
        text = (ROOT / mutant.path).read_text("utf-8")
        if mutant not in found and compiles(mutant, text):
            found.append(mutant)
    return found


class Copy:
    """A copy of the tree in which mutants are tried, with native code of its own.

    A mutant meets the tests of its room, all cases of them, and where these let it live
    the quick ones of all that holds behaviour. Coverage without a mutant tells which of
    them run a line: it is shown to these alone. Kernels are translated and leave no
    lines, but those of the few tests that run them as Python: a mutant in a file with
    kernels meets all tests.
    """

    def __init__(self, folder: Path) -> None:
        self.tree, self.cache = folder / "tree", folder / "cache"
        self.used, self.lines = folder / "used", folder / "lines"
        self.said = ""
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True
        )
        for name in filter(None, listed.stdout.decode().split("\0")):
            (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, self.tree / name)
        self.limits: dict[tuple[str, ...], float] = {}
        self.covered: dict[tuple[str, ...], dict[str, dict[int, list[str]]]] = {}

    def _passes(
        self, options: list[str], cache: Path, limit: float | None, *, quick: bool
    ) -> bool | None:
        """Tell whether tests pass; None where they have not ended in time."""
        line = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
        line += ["--no-header", "-nauto" if quick else "-n0", *options]
        known = dict(os.environ, PYTHONPATH=str(self.tree), LAGSIM_CACHE=str(cache))
        known |= {"PYTHONDONTWRITEBYTECODE": "1", "COVERAGE_FILE": str(self.lines)}
        known["LAGSIM_TEST_CASES"] = "" if quick else "all"
        known.pop("PYTEST_XDIST_WORKER", None)
        try:
            done = subprocess.run(
                line, cwd=self.tree, env=known, capture_output=True, timeout=limit
            )
        except subprocess.TimeoutExpired:
            return None
        self.said = done.stdout[-2000:].decode()
        # 4: the file of a test that is named cannot be read.
        assert done.returncode in (0, 1, 2, 3, 4), self.said
        return done.returncode == 0

    def _begin(self, tests: tuple[str, ...]) -> None:
        """Run tests without a mutant: how long they take, and which lines each runs."""
        self.cache.mkdir(exist_ok=True)
        began = time.monotonic()
        cover = [*tests, "--cov=lagsim", "--cov-context=test", "--cov-report="]
        passed = self._passes(cover, self.cache, None, quick=tests == WAISTS)
        assert passed, f"{tests} fail without a mutant:\n{self.said}"
        self.limits[tests] = 60.0 * PATIENCE + 3.0 * (time.monotonic() - began)
        data = CoverageData(str(self.lines))
        data.read()
        paths = data.measured_files()
        self.covered[tests] = {path: data.contexts_by_lineno(path) for path in paths}
        self.lines.unlink()

    def exercising(self, mutant: Mutant, tests: tuple[str, ...]) -> list[str]:
        """Give those of some tests that run the line of a mutant, or all of them."""
        if _KERNELS.search((ROOT / mutant.path).read_text("utf-8")):
            return list(tests)
        contexts = self.covered[tests].get(str(self.tree / mutant.path), {})
        # `file::test[case]|run`; empty where a module is read.
        found = {one.rpartition("|")[0] for one in contexts.get(mutant.line, [])} - {""}
        return sorted(found) or list(tests)

    def survives(self, mutant: Mutant, tests: tuple[str, ...] = ()) -> bool:
        """Tell whether no test notices a mutant; of `tests` alone where given."""
        every = (tests,) if tests else (ROOMS[mutant.room].tests, WAISTS)
        return all(self._survives(mutant, some) for some in every)

    def _survives(self, mutant: Mutant, tests: tuple[str, ...]) -> bool:
        if tests not in self.limits:
            self._begin(tests)
        # What a broken mutant leaves in the cache is not for the next one.
        shutil.rmtree(self.used, ignore_errors=True)
        cache = Path(shutil.copytree(self.cache, self.used))
        path, chosen = self.tree / mutant.path, self.tree / "chosen.txt"
        chosen.write_text("\n".join(self.exercising(mutant, tests)), "utf-8")
        text = path.read_text("utf-8")
        path.write_text(mutant.applied(text), "utf-8")
        try:
            limit, quick = self.limits[tests], tests == WAISTS
            return self._passes([f"@{chosen}"], cache, limit, quick=quick) is True
        finally:
            path.write_text(text, "utf-8")


def over_budget(tried: list[tuple[Mutant, bool]]) -> list[str]:
    """Say where more mutants live than the table allows: in a room, or in all.

    By more than two standard deviations of as many that live at these rates.
    """
    found = []
    rooms = sorted({mutant.room for mutant, _ in tried})
    for name in (*rooms, "all"):
        some = [one for one in tried if name in (one[0].room, "all")]
        rates = [ROOMS[mutant.room].budget for mutant, _ in some]
        spread = sum(rate * (1.0 - rate) for rate in rates) ** 0.5
        lives = sum(lived for _, lived in some)
        if lives > max(1.0, sum(rates) + 2.0 * spread):
            found.append(f"{name}: {lives} of {len(some)} live")
    return found
