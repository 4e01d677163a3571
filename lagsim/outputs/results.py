"""The folder of a run's results: replaced as a whole, or left as it was.

Every file is written beside its place, synced, and renamed when all are complete, the
manifest last: who finds run.json finds the files that it lists.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import orjson

from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Iterator

MANIFEST = "run.json"
_LOCK = ".lagsim.lock"


class Results:
    """A folder being filled; use `open_results`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: list[str] = []

    def part(self, name: str) -> Path:
        """Give the path to write file `name` to until `commit`."""
        if name not in self.names:
            self.names.append(name)
        return self.folder / f".{name}.part"

    def write(self, name: str, content: bytes) -> None:
        """Write a whole file."""
        self.part(name).write_bytes(content)

    def commit(self, manifest: bytes) -> None:
        """Put all files in their places, remove what the last run left, then run.json.

        Removed is what an earlier run.json lists and this run has not written.
        """
        obsolete = self._listed() - set(self.names)
        for name in self.names:
            _sync(self.part(name))
            self.part(name).replace(self.folder / name)
        for name in sorted(obsolete):
            (self.folder / name).unlink(missing_ok=True)
        self.write(MANIFEST, manifest)
        _sync(self.part(MANIFEST))
        self.part(MANIFEST).replace(self.folder / MANIFEST)
        _sync(self.folder)

    def discard(self) -> None:
        """Remove what was begun."""
        for name in self.names:
            with contextlib.suppress(OSError):
                self.part(name).unlink(missing_ok=True)

    def _listed(self) -> set[str]:
        """Give the files of the run before: plain names in this folder only."""
        try:
            manifest: Any = orjson.loads((self.folder / MANIFEST).read_bytes())
            files = manifest["files"]
        except (OSError, ValueError, KeyError, TypeError):
            return set()
        plain = (
            {f for f in files if isinstance(f, str)}
            if isinstance(files, list)
            else set()
        )
        return {f for f in plain if Path(f).name == f and f != MANIFEST}


@contextlib.contextmanager
def open_results(folder: Path) -> Iterator[Results]:
    """Make the folder and hold it against other runs.

    Raises
    ------
    InputError
        If the folder cannot be made or written, or another run is writing into it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise _unusable(folder, f"cannot be written: {error.strerror}") from None
    try:
        _hold(lock, folder)
        results = Results(folder)
        try:
            yield results
        finally:
            results.discard()
            with contextlib.suppress(OSError):
                (folder / _LOCK).unlink()
    finally:
        os.close(lock)


def _hold(lock: int, folder: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows: renaming over an open file fails by itself
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        raise _unusable(folder, "another run is writing into it") from None


def _unusable(folder: Path, why: str) -> InputError:
    text = f"the output folder {folder} {why}"
    return InputError([Problem("output-folder", text, hint="choose one with -o DIR")])


def _sync(path: Path) -> None:
    """Have the system put a file, or a folder's list of files, on the disk."""
    with contextlib.suppress(OSError):  # not every file system syncs folders
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
