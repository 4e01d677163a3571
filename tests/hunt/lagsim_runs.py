"""lagsim, seen from outside: a model file in; exit code, table and record out."""

from __future__ import annotations

import contextlib
import gc
import io
import json
import os
import select
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.cli._results import manifest, table
from tests.patience import PATIENCE

ROOT = Path(__file__).parent.parent.parent
# Processor seconds after which a run counts as hanging, and the clock's.
HANGING = 40.0 * PATIENCE
LONGEST = 20 * HANGING
_TICKS = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Answer:
    """Result of a run; code -1 is a hang or a crash of the process."""

    code: int
    told: str
    record: dict[str, Any] | None = None
    header: list[str] | None = None
    rows: Any = None

    def column(self, name):
        assert self.header is not None
        return self.rows[:, self.header.index(name)]


class Lagsim:
    """A process that runs models, and is replaced if a model kills it."""

    def __init__(self, folder):
        self.folder = folder
        self.process: subprocess.Popen[str] | None = None

    def run(self, text, *options):
        model, out = self.folder / "scene.yaml", self.folder / "out"
        model.write_text(text, encoding="utf-8")
        for old in out.glob("*"):
            old.unlink()
        answer = self._ask(["run", str(model), "-o", str(out), "--no-plots", *options])
        code, told = answer["code"], answer["err"]
        if not (out / "run.json").exists():
            return Answer(code, told)
        header, rows = table(out)
        return Answer(code, told, manifest(out), header, np.atleast_2d(rows))

    def _ask(self, arguments):
        if self.process is None or self.process.poll() is not None:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.hunt.lagsim_runs"], cwd=ROOT, text=True,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            )  # fmt: skip
        process = self.process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(arguments) + "\n")
        process.stdin.flush()
        begun, spent = time.monotonic(), _processor(process.pid)
        while not select.select([process.stdout], [], [], 1.0)[0]:
            hanging = _processor(process.pid) - spent > HANGING
            if hanging or time.monotonic() - begun > LONGEST:
                self.close()
                return {"code": -1, "err": f"no answer after {HANGING:g} s"}
        line = process.stdout.readline()
        if not line:
            return {"code": -1, "err": f"the process died: {process.wait()}"}
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self):
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
        self.process = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def _processor(number):
    """Return the processor seconds that a process has used."""
    try:
        fields = Path(f"/proc/{number}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:  # no such system, or no such process: the clock decides
        return 0.0
    return (int(fields[11]) + int(fields[12])) / _TICKS


def main():
    """Run `lagsim run` again and again in this process: a line in, a line out."""
    from lagsim.cli import main as lagsim

    # What libraries print themselves must not come between the answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for line in sys.stdin:
        sys.argv = ["lagsim", *json.loads(line)]
        out, err = io.StringIO(), io.StringIO()
        code = 70
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = lagsim()
            except SystemExit as end:
                code = end.code
        gc.collect()
        answer = {"code": code, "err": err.getvalue()[-4000:]}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
