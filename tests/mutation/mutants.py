"""Small changes of the source, one at a time, that a test should detect.

A mutant is another operator, number or word at one place of a file. Mutants are taken
from a few rooms in turn, by a commit's hash: each commit has others, and the same ones
again. A mutant that no test of its room detects has survived.

mutmut and cosmic-ray change Python alone. The first puts its switches into functions,
whose text is translated here; neither knows the page's script.
"""

from __future__ import annotations

import compileall
import contextlib
import hashlib
import io
import math
import os
import py_compile
import queue
import re
import shutil
import signal
import subprocess
import sys
import tokenize
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from coverage import CoverageData

from tests.patience import PATIENCE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

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
# Tests in pytest's summary that fail, with the reason behind their names.
_FAILED = re.compile(r"(?m)^(?:FAILED|ERROR) (\S.*)$")
# In place of the tests that fail, where pytest does not say which these are.
NO_RESULT = "(no result)"
# What pytest says of how long tests took.
_DURATION = re.compile(r"(?m)^(\d+\.\d+)s (?:setup|call) +(\S.*)$")


class Room(NamedTuple):
    """Folder of mutants, its tests, and the number of mutants that may survive."""

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
    "mechanics": Room("mechanics/**/*.py", ("tests/mechanics", "tests/program"), 0.5),
    "admissibility": Room("admissibility/**/*.py", ("tests/admissibility",), 0.4),
    "show": Room("show/**/*.py", ("tests/show",), 0.35),
    "native": Room("native/**/*.py", ("tests/native", "tests/program"), 0.35),
    "methods": Room("methods/**/*.py", ("tests/methods",), 0.5),
    "plan": Room(
        "plan/**/*.py", ("tests/plan", "tests/cli/test_formulations.py"), 0.5
    ),
    "program": Room(
        "program/**/*.py", ("tests/program", "tests/mechanics", "tests/run"), 0.35
    ),
    "run": Room("run/**/*.py", ("tests/run",), 0.35),
    "outputs": Room("outputs/**/*.py", ("tests/outputs",), 0.35),
    "studies": Room("studies/**/*.py", ("tests/studies", "tests/golden"), 0.35),
    "api": Room("api/**/*.py", ("tests/api",), 0.25),
    "cli": Room("cli/**/*.py", ("tests/cli",), 0.25),
}  # fmt: skip
# So many rooms a night, beside the page.
A_NIGHT = 4
# Tests that a mutant meets in its room, and elsewhere, take so many seconds at most
# without it; to start them, and to compile what is native, takes less than so many.
MOST = 60.0
STARTING = 30.0
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
    """Return each word of Python that is code, and where it begins."""
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
    """Return each word of JavaScript, and where it begins."""
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
    """Return all mutants of a file; those that do not compile are among them."""
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
    """Return whether a mutant of a file can be compiled."""
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
    """Return the rooms of a commit; each has to be run once without a mutant."""
    others = [name for name in ROOMS if name != "page"]
    first = int(hashlib.sha256(commit.encode()).hexdigest(), 16) % len(others)
    return ("page", *(2 * others)[first : first + A_NIGHT])


def chosen(
    commit: str, count: int, rooms: tuple[str, ...] = (), part: str = ""
) -> list[Mutant]:
    """Return `count` mutants by the hash of a commit, from some rooms in turn.

    part : a text in the paths of all files that are changed.
    """
    names = rooms or rooms_of(commit)
    every: dict[str, list[Mutant]] = {}
    found: list[Mutant] = []
    draw = 0
    first = int(hashlib.sha256(commit.encode()).hexdigest(), 16)
    while len(found) < count:
        room = names[(first + len(found)) % len(names)]
        if room not in every:
            paths = sorted((ROOT / "lagsim").glob(ROOMS[room].files))
            paths = [path for path in paths if part in path.as_posix()]
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


class Clean(NamedTuple):
    """Tests without a mutant: seconds of each, and those that run a line of a file."""

    seconds: dict[str, float]
    lines: dict[str, dict[int, set[str]]]


class Copy:
    """A copy of the tree in which tests run, with native code of its own.

    Byte code is checked by the source's content: a mutant compiles its own file alone.
    """

    def __init__(self, folder: Path) -> None:
        self.tree, self.cache = folder / "tree", folder / "cache"
        self.used, self.lines = folder / "used", folder / "lines"
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True
        )
        for name in filter(None, listed.stdout.decode().split("\0")):
            (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, self.tree / name)
        checked = py_compile.PycInvalidationMode.CHECKED_HASH
        compileall.compile_dir(self.tree / "lagsim", quiet=2, invalidation_mode=checked)
        self.cache.mkdir()

    def _pytest(
        self, options: Sequence[str], cases: str, cache: Path, limit: float
    ) -> tuple[int | None, str]:
        """Return pytest's exit code and text; None past a limit of processor time.

        The limit holds for each process; a process that waits for others ends at four
        times the limit, later on a busy machine.
        """
        line = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
        # With the settings' `--dist` coverage waits for workers, and names no test.
        line += ["--no-header", "-n0", "--dist=no", *options]
        limited = ["sh", "-c", f'ulimit -t {math.ceil(limit)}; exec "$@"', "sh"]
        known = dict(os.environ, PYTHONPATH=str(self.tree), LAGSIM_CACHE=str(cache))
        known |= {"COVERAGE_FILE": str(self.lines), "LAGSIM_TEST_CASES": cases}
        known.pop("PYTEST_XDIST_WORKER", None)
        known["PYTHONDONTWRITEBYTECODE"] = "1" if cache == self.used else ""
        with subprocess.Popen(
            [*limited, *line], cwd=self.tree, env=known, start_new_session=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        ) as process:  # fmt: skip
            try:
                out, _ = process.communicate(timeout=4.0 * PATIENCE * limit)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                out, _ = process.communicate()
            # A browser or node that a test has left.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        code = process.returncode
        return None if code < 0 else code, out.decode(errors="replace")

    def clean(self, tests: str, cases: str) -> Clean:
        """Run tests without a mutant."""
        cover = [tests, "--cov=lagsim", "--cov-context=test", "--cov-report="]
        shown = ["--durations=0", "--durations-min=0"]
        code, text = self._pytest(
            ["-x", *cover, *shown], cases, self.cache, 3600.0 * PATIENCE
        )
        assert code == 0, f"{tests} fail without a mutant:\n{text[-2000:]}"
        seconds: dict[str, float] = {}
        for one in _DURATION.finditer(text):
            seconds[one[2]] = seconds.get(one[2], 0.0) + float(one[1])
        data = CoverageData(str(self.lines))
        data.read()
        lines = {
            Path(path).relative_to(self.tree).as_posix(): {
                # `file::test[case]|run`; empty where a module is read.
                line: {one.rpartition("|")[0] for one in contexts} - {""}
                for line, contexts in data.contexts_by_lineno(path).items()
            }
            for path in data.measured_files()
        }
        self.lines.unlink()
        return Clean(seconds, lines)

    def notices(self, mutant: Mutant, tests: Sequence[str], limit: float) -> bool:
        """Return whether a test fails, crashes or hangs with a mutant."""
        return bool(self.killers(mutant, tests, limit, ["-x"]))

    def killers(
        self,
        mutant: Mutant,
        tests: Sequence[str],
        limit: float,
        options: Sequence[str] = (),
    ) -> set[str]:
        """Return the tests that fail where a mutant is in, or that have no result.

        With the option `-x` only the first of them. If pytest crashes, is ended at its
        limit, or cannot read a file of tests, the set is {NO_RESULT}.
        """
        # What a broken mutant leaves in the cache is not for the next one.
        shutil.rmtree(self.used, ignore_errors=True)
        shutil.copytree(self.cache, self.used)
        path, chosen = self.tree / mutant.path, self.tree / "chosen.txt"
        chosen.write_text("\n".join(tests), "utf-8")
        text = path.read_text("utf-8")
        path.write_text(mutant.applied(text), "utf-8")
        try:
            options = [*options, "-rfE", f"@{chosen}"]
            code, said = self._pytest(options, "all", self.used, limit)
        finally:
            path.write_text(text, "utf-8")
        # 4: the file of a test that is named cannot be read.
        assert code in (None, 0, 1, 2, 3, 4), said[-2000:]
        if not code:
            return set() if code == 0 else {NO_RESULT}
        lines = _FAILED.findall(said)
        found = {
            max((x for x in tests if line.startswith(x)), key=len, default=line)
            for line in lines
        }
        return found or {NO_RESULT}


def exercising(
    mutant: Mutant, text: str, clean: Sequence[Clean], most: float = MOST
) -> tuple[list[str], float]:
    """Return tests that may detect a mutant, the soonest first, and their time limit.

    Tests of a file with a similar name come first, then one case of each test, then the
    fastest. The limit is in seconds of processor time.
    """
    seconds = {test: took for one in clean for test, took in one.seconds.items()}
    running: set[str] = set()
    for one in clean:
        running |= one.lines.get(mutant.path, {}).get(mutant.line, set())
    if _KERNELS.search(text) or not running:
        running |= seconds.keys()
    stem, known = Path(mutant.path).stem, set()
    ranked = []
    for test in sorted(running, key=lambda test: (seconds.get(test, 0.0), test)):
        family = test.partition("[")[0]
        file = family.partition("::")[0]
        ranked.append((stem not in Path(file).stem, family in known, len(ranked), test))
        known.add(family)
    found, total = [], 0.0
    for *_, test in sorted(ranked):
        if total + seconds.get(test, 0.0) <= most or not found:
            found.append(test)
            total += seconds.get(test, 0.0)
    return found, STARTING + 3.0 * total


class Trial:
    """Mutants against the tests of their rooms, and against all tests of behaviour.

    A mutant is run with the tests of its room, all cases of these, and if it survives
    with the quick tests of all that describes behaviour. Coverage without a mutant
    selects the tests that run its line, the soonest first, as many as take `MOST`
    seconds. Kernels are translated and leave no lines: a mutant in a file with kernels
    is run with the other tests, too. It has three times the processor time of these
    tests without the mutant, and the time to start them.
    """

    def __init__(self, folder: Path) -> None:
        self.side = os.cpu_count() or 1
        self.copies: queue.SimpleQueue[Copy] = queue.SimpleQueue()
        for k in range(self.side):
            self.copies.put(Copy(folder / str(k)))
        self.clean: dict[str, Clean] = {}

    @contextlib.contextmanager
    def _copy(self) -> Iterator[Copy]:
        copy = self.copies.get()
        try:
            yield copy
        finally:
            self.copies.put(copy)

    def _measure(self, tests: str, cases: str) -> None:
        with self._copy() as copy:
            self.clean[tests] = copy.clean(tests, cases)

    def _survives(self, mutant: Mutant) -> bool:
        # Its own tests alone run the page's script.
        stages = [ROOMS[mutant.room].tests, *[WAISTS] * (mutant.room != "page")]
        with self._copy() as copy:
            text = (copy.tree / mutant.path).read_text("utf-8")
            for stage in stages:
                clean = [self.clean[tests] for tests in stage]
                if copy.notices(mutant, *exercising(mutant, text, clean)):
                    return False
        return True

    def survivors(self, mutants: Sequence[Mutant]) -> Iterator[tuple[Mutant, bool]]:
        """Return each mutant, and whether no test detects it."""
        rooms = {tests for one in mutants for tests in ROOMS[one.room].tests}
        runs = dict.fromkeys(WAISTS, "") | dict.fromkeys(sorted(rooms), "all")
        with ThreadPoolExecutor(self.side) as pool:
            list(pool.map(self._measure, runs, runs.values()))
            yield from zip(mutants, pool.map(self._survives, mutants), strict=True)


def over_budget(tried: list[tuple[Mutant, bool]]) -> list[str]:
    """Return texts on rooms in which more mutants survive than the table permits.

    The excess is more than two standard deviations of the number at these rates.
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
