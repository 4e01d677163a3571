"""Runs `lagsim run` again and again in one process: a line in, a line out."""

from __future__ import annotations

import contextlib
import gc
import io
import json
import os
import sys


def main() -> None:
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
