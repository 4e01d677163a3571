"""Runs of random cases in this process, and storage of failures: the hunt itself.

    python -m tests.hunt.soup_runs SEED FIRST COUNT FOLDER

hunts from the command line, without pytest, and prints the faults with their number.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import re
import shutil
import signal
import sys
import warnings
from collections import Counter
from pathlib import Path

from lagsim.cli import main
from tests.hunt.soup import MODEL, OPTIONS, case
from tests.patience import PATIENCE

# 0: done, 1: no, 2: unusable, 3: unfinished. A bug is 70.
CALM = (0, 1, 2, 3)
# No file of this size takes longer, on a machine that does something else as well;
# `derive` refuses after 45 s what it cannot finish.
SECONDS = math.ceil(60 * PATIENCE)
# As many failures of one sort are kept; more of them say nothing new.
ENOUGH = 3


class TooLongError(BaseException):
    """A case exceeds the limit of time."""


def prepared(folder):
    """Create the files that command lines name, and change into their folder."""
    inner = folder / "a" / "b"
    inner.mkdir(parents=True, exist_ok=True)
    os.chdir(inner)
    Path("bad.yaml").write_bytes(b"energy: {kinetic: \xff\n\t")
    Path("table.csv").write_text("t,x\n0,1\n1,2\n")
    Path("m.yaml").write_text(MODEL)
    sys.argv = ["lagsim", "run", "m.yaml", "-o", "out", "--no-plots", "-q"]
    main()
    shutil.copytree(inner, folder / "kept", dirs_exist_ok=True)


def wrong(case):
    """Call the command; return a text on a fault of its behaviour, or ""."""
    if case.line[1:2] != ("m.yaml",) or case.text == MODEL:
        _tidy()
    Path("m.yaml").write_text(case.text, encoding="utf-8", errors="surrogatepass")
    sys.argv = ["lagsim", *case.line]
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()
    before = signal.signal(signal.SIGALRM, _late)
    signal.alarm(SECONDS)
    stdin, sys.stdin = sys.stdin, io.TextIOWrapper(io.BytesIO(case.text.encode()))
    try:
        with (
            contextlib.redirect_stdout(out), contextlib.redirect_stderr(err),
            warnings.catch_warnings(),
        ):  # fmt: skip
            warnings.simplefilter("ignore")  # as the process of the command does
            code = main()
            out.flush()
    except TooLongError:
        return f"takes longer than {SECONDS} s"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        sys.stdin = stdin
    return judged(case, code, out.buffer.getvalue().decode(), err.getvalue())  # type: ignore[attr-defined]


def judged(case, code, out, err):
    """Return a text on the fault of an answer, or ""."""
    if code > 128:
        raise KeyboardInterrupt
    if code not in CALM or "Traceback" in err:
        last = [line for line in err.splitlines() if line.strip()][-3:]
        return f"exit {code}: {' | '.join(last)}"
    if code == 2 and "[E" not in err and '"number"' not in out:
        return "refused without a number"
    # What follows an option that takes a value is its value.
    takes = {option for option, value in OPTIONS.get(case.line[0], ()) if value}
    pairs = zip(case.line, case.line[1:], strict=False)
    asked = [word for before, word in pairs if before not in takes]
    if "--json" in asked and "--help" not in case.line:
        try:
            json.loads(out)
        except ValueError:
            return f"exit {code}: stdout is no JSON"
    lines = case.text.splitlines() or [""]
    for line, column in re.findall(r"^m\.yaml:(\d+):(\d+): ", err, re.MULTILINE):
        source = lines[min(int(line), len(lines)) - 1]
        if "UTF-8" not in err and not 1 <= int(column) <= len(source) + 1:
            return f"names column {column} of line {line}"
    raw = next((c for c in out + err if ord(c) < 32 and c not in "\n\t"), "")
    return f"prints {raw!r}" if raw else ""


def hunt(seed, numbers, folder):
    """Try cases; write failures to files of the folder."""
    sorts: Counter[str] = Counter()
    tried = 0
    for number in numbers:
        tried += 1
        why = wrong(found := case(seed, number))
        if not why:
            continue
        sort = _sort(why)
        sorts[sort] += 1
        if sorts[sort] <= ENOUGH:
            told = f"# seed {seed}, case {number}: {why}\n# lagsim {list(found.line)}\n"
            path = folder / f"found-{seed}-{number}.yaml"
            path.write_text(told + found.text, encoding="utf-8", errors="replace")
    return {"seed": seed, "cases": tried, "found": dict(sorts)}


def _tidy():
    """Restore the working directory, which a command line may have changed."""
    here = Path.cwd()
    kept = here.parent.parent / "kept"
    assert here.parts[-2:] == ("a", "b")
    assert kept.is_dir()
    for path in here.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
    shutil.copytree(kept, here, dirs_exist_ok=True)


def _sort(why):
    """Return the part of a failure's text that does not depend on the case."""
    return "".join(c for c in why if not c.isdigit())[:160]


def _late(_number, _frame):
    raise TooLongError


if __name__ == "__main__":
    seed, first, count = map(int, sys.argv[1:4])
    folder = Path(sys.argv[4]).absolute()
    prepared(folder)
    for begin in range(first, first + count, 1000):
        numbers = range(begin, min(begin + 1000, first + count))
        print(begin, hunt(seed, numbers, folder), file=sys.__stdout__, flush=True)
