"""Text of docs/errors.md, which `regenerate.py` writes.

Its texts are derived from `lagsim/codes`; the messages are the output of the examples,
which are run.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from lagsim.cli import main
from lagsim.codes import CHECK, EXAMPLE, MODEL, RETIRED, every

if TYPE_CHECKING:
    from lagsim.codes import MessageRow

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs/errors.md"
# What stands above it is written by hand.
MARK = "<!-- From here on derived from lagsim/codes. -->\n"
# A message may be long; its beginning is shown.
MOST_LINES = 12
_LONGEST = 160

HEAD = f"""
## All messages

Each message has a number and a code, which never change: `E104` and
`several-documents`. `lagsim explain E104` shows its entry. Examples change lines of
this model,
`{MODEL}`:

```text
{EXAMPLE}```
"""
TITLES = {
    "E1": "E1: files, YAML, sections",
    "E2": "E2: expressions, names, relations",
    "E3": "E3: starts",
    "E4": "E4: methods and settings",
    "E5": "E5: runs that could not finish",
    "E6": "E6: results that are compared or drawn",
    "E7": "E7: files that are written",
    "E8": "E8: the command line",
    "E9": "E9: lagsim and the machine",
    "W": "W: warnings",
}


def told(row: MessageRow, folder: Path) -> str:
    """Run the example of a message in a folder; return the last command's output."""
    (folder / MODEL).write_text(row.model, encoding="utf-8")
    if row.commands == CHECK:
        return checked(folder)
    if not (folder / "models").exists():
        (folder / "models").symlink_to(ROOT / "models")
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    around = {k: v for k, v in os.environ.items() if k != "GITHUB_ACTIONS"}
    said = ""
    for command in row.commands:
        done = subprocess.run(
            command, shell=True, cwd=folder, capture_output=True, text=True,
            env=around | {"PATH": programs, "COLUMNS": "100"}, check=False,
        )  # fmt: skip
        said = done.stdout + done.stderr
    return said


def checked(folder: Path) -> str:
    """Return the output of `lagsim check` on a folder's model, run in this process."""
    said, before = io.StringIO(), sys.argv
    github = os.environ.pop("GITHUB_ACTIONS", None)
    columns = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "100"
    try:
        sys.argv = shlex.split(CHECK[0])
        with (
            contextlib.chdir(folder), contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
        ):  # fmt: skip
            main()
    finally:
        sys.argv = before
        os.environ |= {"GITHUB_ACTIONS": github} if github is not None else {}
        os.environ.pop("COLUMNS")
        os.environ |= {"COLUMNS": columns} if columns is not None else {}
    return said.getvalue()


def line_of(row: MessageRow, said: str) -> str:
    """Return the message itself, out of all output of a command.

    Raises
    ------
    ValueError
        If the output does not contain the message.
    """
    parts = said.rstrip("\n").split("\n")
    at = [k for k, line in enumerate(parts) if f"[{row.number}]" in line]
    if not at:
        raise ValueError(f"{row.number} {row.code}: {said}")
    end = at[0] + 1
    while end < len(parts) and re.match(r"  (?!.*\[[EW]\d+\]$)", parts[end]):
        end += 1
    return "\n".join(map(_cut, parts[at[0] : end][:MOST_LINES]))


def _cut(line: str) -> str:
    if len(line) <= _LONGEST:
        return line
    number = re.search(r"( \[[EW]\d+\])?$", line)
    end = f" ...{number[0] if number else ''}"
    return line[: _LONGEST - len(end)] + end


def entry(row: MessageRow, message: str) -> str:
    """Return the page's entry for one message, as Markdown."""
    lines = [f"#### {row.number} {row.code}", "", row.happened]
    if row.expected:
        lines += ["", f"Expected: {row.expected}"]
    if f"  hint: {row.hint}" not in message:
        lines += ["", f"Try: {row.hint}."]
    if row.commands:
        lines += ["", "```text", *example_of(row), "", message, "```"]
    return "\n".join(lines)


def example_of(row: MessageRow) -> list[str]:
    """Return the lines of an example: changed sections of the model, and commands."""
    lines = [_cut(line) for line in row.change.replace("\x07", "\\a").splitlines()]
    return [*lines, *[""][: len(lines)], *row.commands]


def made(messages: dict[str, str]) -> str:
    """Return the generated part of the page, from the messages by number."""
    parts = [MARK + HEAD]
    for first, title in TITLES.items():
        rows = [row for row in every() if row.number.startswith(first)]
        parts.append(f"### {title}\n")
        parts += [f"{entry(r, messages.get(r.number, ''))}\n" for r in rows]
    parts.append("### Retired\n\nThese messages are retired; their numbers stay.\n")
    parts += [
        f"- `{r.number} {r.code}`: {r.happened} Retired: {r.instead}." for r in RETIRED
    ]
    return "\n".join(parts) + "\n"


def message(row: MessageRow) -> str:
    """Run the example of a message; return the message."""
    with tempfile.TemporaryDirectory() as folder:
        return line_of(row, told(row, Path(folder)))


def shown(page: str) -> dict[str, tuple[str, str]]:
    """Return the example and the message that a page shows, by number."""
    found = {}
    for text in re.split(r"(?m)^#### ", page)[1:]:
        fence = re.search(r"(?s)```text\n(.*?)\n```", text)
        if fence:
            example, _, message = fence[1].rpartition("\n\n")
            found[text.split()[0]] = example, message
    return found


def page(old: str, *, anew: bool = False) -> str:
    """Return the page; of slow examples, only changed ones are run again.

    anew : whether all examples are run.
    """
    known, messages = shown(old), {}
    for row in every():
        example, kept = known.get(row.number, ("", ""))
        if not row.commands:
            continue
        same = example == "\n".join(example_of(row)) and row.commands != CHECK
        messages[row.number] = kept if same and not anew else message(row)
    return old.partition(MARK)[0] + made(messages)
