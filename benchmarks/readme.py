"""Numbers of README.md, which `regenerate.py` writes.

They are the numbers of results-rivals.md and results.md with two significant digits.
"""

from __future__ import annotations

import re
import textwrap
from decimal import Decimal
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README, FOLDER = ROOT / "README.md", ROOT / "benchmarks"
BEGIN, END = "<!-- Written by benchmarks/readme.py. -->", "<!-- To here. -->"

TABLE = """\
| model | error | lagsim, ms | best other, ms |
|---|---|---|---|
{}
"""
TEXT = (
    "lagsim, from energies, and the others, from given equations, are about equally "
    "fast. The ratio of the best other's time to lagsim's is {tight} in this "
    "table, and {loose} at an error of 1e-8; for runs that begin with the data of "
    "other solvers in the processor's caches, {first}. lagsim's times include every "
    "row with all columns, projected onto the constraints. The others give states "
    "only; they neither derive equations nor handle contacts. This was measured on an "
    "{rivals} ([all results](benchmarks/results-rivals.md)). A whole process with "
    "pictures takes {run}, a script for sympy, scipy and pyplot that does the same "
    "{script}, on an {whole} ([all results](benchmarks/results.md))."
)
WIDTH = 125


def rows_below(text: str, heading: str) -> list[list[str]]:
    """Return the cells of the first table below a heading, without the table's head."""
    part = text.partition(f"\n## {heading}\n")[2]
    lines = re.search(r"(?m)(?:^\|.*\n)+", part)[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def digits(text: str | Decimal) -> str:
    """Return a number as text with two significant digits, without an exponent."""
    rounded = Decimal(f"{Decimal(text):.1e}")
    return f"{rounded:.{max(0, 1 - rounded.adjusted())}f}"


def duration(milliseconds: str) -> str:
    """Return a time of whole processes as text in seconds."""
    return f"{digits(Decimal(milliseconds) / 1000)} s"


def span(rows: list[list[str]], column: int = 5) -> str:
    """Return the range of the ratios in a column as text.

    column : its index, by default that of `times faster`.
    """
    ratios = [Decimal(row[column]) for row in rows]
    return f"{digits(min(ratios))} to {digits(max(ratios))}"


def numbers(rivals: str, whole: str) -> str:
    """Return the part of README.md that results-rivals.md and results.md determine."""
    equal = rows_below(rivals, "At equal errors")
    loose = [row for row in equal if float(row[1]) == 1e-8]
    tight = {row[0]: row for row in equal}  # the last of each model
    table = []
    for model, error, own, best, *_ in tight.values():
        name, _, time = best.partition(": ")
        cells = (model, error, digits(own), f"{name}: {digits(time)}")
        table.append("| " + " | ".join(cells) + " |")
    processes = {row[0]: row[1] for row in rows_below(whole, "The whole run")}
    text = TEXT.format(
        tight=span([*tight.values()]),
        loose=span(loose),
        first=span(loose, 7),
        rivals=" and an ".join(
            dict.fromkeys(re.findall(r"Measured \S+ on (.*?),", rivals))
        ).replace("(R)", ""),
        run=duration(processes["`lagsim run`"]),
        script=duration(processes["the script, with plots"]),
        whole=re.search(r"(?m)^- (.*?) \(.*, Linux$", whole)[1],
    )
    return TABLE.format("\n".join(table)) + "\n" + textwrap.fill(text, WIDTH) + "\n"


def page(text: str) -> str:
    """Return README.md with the numbers of the results."""
    head, _, rest = text.partition(BEGIN)
    tail = rest.partition(END)[2]
    read = (FOLDER / name for name in ("results-rivals.md", "results.md"))
    found = numbers(*(path.read_text(encoding="utf-8") for path in read))
    return f"{head}{BEGIN}\n{found}{END}{tail}"
