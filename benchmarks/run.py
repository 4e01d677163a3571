"""Measure everything and write results.md: python benchmarks/run.py

Without options it makes a clean environment in a temporary folder, installs this
checkout there (not editable) and measures that. With --here it measures the lagsim
of the Python that runs it.
"""

from __future__ import annotations

import argparse
import importlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PARTS = (
    "whole_run", "first_run", "chains", "rods", "many", "andrews", "structure",
    "million_rows", "compare", "contacts", "laws", "analyses", "sweeps",
)  # fmt: skip


def in_clean_environment(arguments):
    """Run this script again under a Python that has this checkout installed."""
    with tempfile.TemporaryDirectory(prefix="lagsim-benchmarks-") as folder:
        base = Path(folder)
        # Building leaves files beside the source: build a copy.
        source = base / "source"
        source.mkdir()
        for name in ("pyproject.toml", "README.md", "LICENSE"):
            shutil.copy(HERE.parent / name, source)
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(HERE.parent / "lagsim", source / "lagsim", ignore=ignored)
        subprocess.run([sys.executable, "-m", "venv", base / "env"], check=True)
        scripts = base / "env" / ("Scripts" if os.name == "nt" else "bin")
        pip = [scripts / "python", "-m", "pip", "install", "-q", "--compile"]
        subprocess.run([*pip, source], check=True)
        again = [scripts / "python", Path(__file__), "--here", *arguments]
        return subprocess.run(again, check=False).returncode


def measure(parts, turns, results):
    """Measure the parts, print each table when it is complete, and write all tables.

    If some parts are measured alone, their tables replace stored tables of equal title
    or are appended, and the other stored tables remain.
    """
    from measure import machine

    pages = []
    for part in parts:
        for table in importlib.import_module(part).tables(turns):
            pages.append(table.markdown())
            print(pages[-1], flush=True)
    about = "\n".join(f"- {line}" for line in machine(turns))
    head = f"# Measured\n\n{about}\n"
    if len(parts) < len(PARTS) and results.exists():
        head, *kept = results.read_text(encoding="utf-8").split("\n## ")
        head = head.rstrip("\n") + "\n"
        pages = [f"{page}\nThis part by itself:\n\n{about}\n" for page in pages]
        pages = list(_merged([f"## {page}\n" for page in kept], pages).values())
    results.write_text("\n".join([head, *pages]).rstrip("\n") + "\n", encoding="utf-8")


def _merged(kept, pages):
    """Return the stored pages by title, updated by `pages`."""
    return {page.partition("\n")[0]: page.rstrip("\n") + "\n" for page in kept + pages}


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("parts", nargs="*", choices=[*PARTS, []], metavar="PART")
    options.add_argument("--here", action="store_true")
    options.add_argument("--turns", type=int, default=20)
    options.add_argument("--results", type=Path, default=HERE / "results.md")
    given = options.parse_args()
    if not given.here:
        return in_clean_environment(sys.argv[1:])
    # A warm process finds its modules compiled and its own cache.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    measure(given.parts or PARTS, given.turns, given.results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
