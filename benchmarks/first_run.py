"""The first run on a machine, and runs where the cache cannot help."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import numpy as np
from measure import (
    LAGSIM,
    MODELS,
    Table,
    alternate,
    ms,
    process,
    ratio,
    read_rows,
    workspace,
)
from whole_run import BARE

MODEL = MODELS / "elastic-pendulum.yaml"

# Another version of llvmlite, as far as the cache can tell.
UPGRADED = """
import sys
import llvmlite
llvmlite.__version__ = "999.0.0"
from lagsim.cli import main
sys.exit(main())
"""


def start_times(folder, turns):
    """Time first and warm runs, without and with plots, and imports alone."""
    cache, fonts = folder / "cache", folder / "fonts"

    def run(*options, first):
        if first:
            shutil.rmtree(cache, ignore_errors=True)
            shutil.rmtree(fonts, ignore_errors=True)
            fonts.mkdir()
        return process(
            [LAGSIM, "run", MODEL, "-o", folder / "out", *options],
            LAGSIM_CACHE=cache,
            MPLCONFIGDIR=fonts,
        ).seconds

    return alternate(
        {
            "first, no plots": lambda: run("--no-plots", first=True),
            "warm, no plots": lambda: run("--no-plots", first=False),
            "first": lambda: run(first=True),
            "warm": lambda: run(first=False),
            "bare": lambda: process([sys.executable, "-c", BARE]).seconds,
        },
        turns,
    )


def odd_cases(folder):
    """Run with unusable or outdated caches; return (case, largest deviation)."""
    number = 0
    cache = folder / "odd-cache"

    def rows(command=(LAGSIM,), options=("--no-plots",), **environment):
        nonlocal number
        number += 1
        out = folder / f"odd{number}"
        environment.setdefault("LAGSIM_CACHE", cache)
        command = [*command, "run", MODEL, "-o", out, *options]
        process(command, **environment)
        return read_rows(out / "trajectory.csv")

    def compiled_anew(**case):
        """Return the rows of a run; raise an error if it used objects of the cache."""
        before = len(list(cache.rglob("*.object")))
        result = rows(**case)
        if len(list(cache.rglob("*.object"))) != 2 * before:
            raise RuntimeError(f"the cache served the wrong objects: {case}")
        shutil.rmtree(cache)
        rows()
        return result

    usual = rows()

    def apart(found):
        return float(np.max(np.abs(found - usual) / np.ptp(usual, axis=0).clip(1e-6)))

    below_a_file = folder / "a-file"
    below_a_file.write_text("")
    locked = folder / "locked"
    locked.mkdir(mode=0o500)
    upgraded = (sys.executable, "-c", UPGRADED)
    found = [
        ("a cache folder that cannot be made", rows(LAGSIM_CACHE=below_a_file / "c")),
        ("a read-only cache folder", rows(LAGSIM_CACHE=locked)),
        (
            "no home and no cache, with plots",
            rows(
                options=(),
                HOME=below_a_file / "home",
                XDG_CACHE_HOME="",
                XDG_CONFIG_HOME="",
                LAGSIM_CACHE="",
                MPLCONFIGDIR="",
            ),
        ),
        (
            "another version of llvmlite, the old one's cache",
            compiled_anew(command=upgraded),
        ),
        (
            "`LAGSIM_CPU=generic`, the host's cache",
            compiled_anew(LAGSIM_CPU="generic"),
        ),
    ]
    return [(what, apart(r)) for what, r in found] + _together(folder, apart)


def _together(folder, apart):
    """Run two processes at once with one empty cache."""
    environment = {**os.environ, "LAGSIM_CACHE": str(folder / "shared-cache")}
    outs = [folder / f"together{k}" for k in range(2)]
    children = [
        subprocess.Popen(
            [LAGSIM, "run", str(MODEL), "--no-plots", "-q", "-o", str(out)],
            env=environment,
        )
        for out in outs
    ]
    codes = [child.wait() for child in children]
    if any(codes):
        raise RuntimeError(f"two at once: exit codes {codes}")
    worst = max(apart(read_rows(out / "trajectory.csv")) for out in outs)
    return [("two processes at once, the cache empty", worst)]


def tables(turns):
    """Return the tables of start times and of unusable or outdated caches."""
    with workspace() as folder:
        times = start_times(folder, turns)
        odd = odd_cases(folder)

    more_by = times["warm"].least - times["warm, no plots"].least

    def row(text, first, warm, judged):
        more = times[first].least - times[warm].least
        return [
            text,
            *(
                f"{x} / {y}"
                for x, y in zip(ms(times[first]), ms(times[warm]), strict=True)
            ),
            f"{more * 1e3:.3g} ms; goal at most 350",
            judged,
        ]

    first = Table(
        "The first run on a machine",
        [
            "first / warm",
            "least, ms",
            "median, ms",
            "first costs more by",
            "warm",
        ],
        [
            row(
                "`lagsim run --no-plots`",
                "first, no plots",
                "warm, no plots",
                f"{ratio(times['warm, no plots'], times['bare'])} as long as imports; "
                "goal at most 2.2",
            ),
            row(
                "`lagsim run`",
                "first",
                "warm",
                f"{more_by * 1e3:.3g} ms more for three plots; goal at most 500",
            ),
        ],
        [
            "First: empty `LAGSIM_CACHE`, and an empty folder of matplotlib's (fonts).",
            (
                f'Imports: `python -c "{BARE}"`, in its turn: '
                f"{' / '.join(ms(times['bare']))} ms."
            ),
        ],
    )
    rows = [[what, f"{difference:.1e}"] for what, difference in odd]
    head = ["`lagsim run` with", "largest difference of any row, against its range"]
    notes = ["Every one of them ended with exit code 0."]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        notes.append("Measured as root, to whom a read-only folder is not read-only.")
    return [first, Table("Where the cache cannot help", head, rows, notes)]
