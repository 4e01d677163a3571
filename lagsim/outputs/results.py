"""The folder of a run's results, which a run replaces as a whole or leaves unchanged.

Every file is written under a temporary name and synced. When all files are complete the
old run.json is removed, the files are renamed, and the new run.json is renamed last:
wherever there is a run.json, the files that it lists are complete. A table and its
run.json may be placed before pictures are drawn, which are added later.

A folder may be somebody else's. Symbolic links in it are not followed for writing,
pipes are not waited for, and of the files listed by its run.json only files with names
that lagsim uses are removed.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lagsim.codes.known import (
    EXISTS,
    NO_ROOM,
    NOT_LOCKED,
    OUTPUT_FOLDER,
    RESULT_REPLACED,
)

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]

import orjson

from lagsim import files, limits
from lagsim.errors import InputError, several, unusable
from lagsim.notes import Caution
from lagsim.outputs import TableFormat

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from lagsim.model.model import Settings
    from lagsim.outputs import Made

MANIFEST = "run.json"
# Room kept on the disk for a run.json that says that the disk is full.
RESERVE_BYTES = 1 << 16
PART, NEW = ".lagsim-{}.part", ".lagsim-{}.new"
# Seconds after which a temporary file counts as abandoned.
ABANDONED_SECONDS = 60.0
# Lock file of the process that fills a folder, removed afterwards. A file, since on a
# network file system a lock of the folder itself does not exclude other machines.
LOCK = PART.format("lock")
# Saved state of an unfinished run; its tables so far, by name, for a run that continues
# it.
RESTART, RESTART_TABLE = ".lagsim-restart", ".lagsim-restart.{}"
# Names of lagsim's files, which a later run may remove.
_OWN = re.compile(
    r"(trajectory|events|energy|constraint_forces|plot_\d+|animation|overlay|spectrum"
    r"|reactions|work_precision|stability|sweep|section_\w+|modes|response|equilibrium"
    r"|fit)"
    r"\.(csv|npz|parquet|json|png|svg|pdf|html)"
)
# Names of model files that a command writes beside its results. A later run may remove
# or replace these as long as they are as the manifest has them: users edit such files.
_FITTED = re.compile(r"[^/\\]+-fitted\.yaml")
# Seconds between two attempts to lock a folder.
_GLANCE_SECONDS = 0.02


class Results:
    """Folder of results during a run, with temporary files; created by `open_results`.

    Attributes
    ----------
    names : list of str
        The files that `commit` will rename to their places, without the manifest.
    manifest : str
        Name of the file that lists the others.
    cautions : list of Caution
        The warning that the folder could not be locked, if so.
    """

    def __init__(self, folder: Path, manifest: str = MANIFEST) -> None:
        self.folder = folder
        self.manifest = manifest
        self.names: list[str] = []
        self.cautions: list[Caution] = []
        self._placed: set[str] = set()
        self._digests: dict[str, str] = {}

    def reserve(self) -> None:
        """Reserve disk space for the manifest."""
        self._begun(self.manifest, bytes(RESERVE_BYTES))

    def part(self, name: str) -> Path:
        """Return the temporary path of the file `name`, until `commit` renames it."""
        if name in self.names:
            return self._part(name)
        self.names.append(name)
        return self._begun(name)

    def write(self, name: str, content: bytes) -> None:
        """Write the file `name` at its temporary path; if this fails, remove it."""
        try:
            _write(self.part(name), content)
        except BaseException:
            self.drop(name)
            raise

    def drop(self, name: str) -> None:
        """Remove the temporary file of `name`, which `commit` then does not place."""
        self._digests.pop(name, None)
        if name in self.names:
            self.names.remove(name)
        files.drop(self._part(name))

    def fill(self, contents: Iterable[Made]) -> Iterator[Caution]:
        """Write files; yield a warning for each that could not be drawn.

        contents : pairs of name and content.
        """
        for name, content in contents:
            if isinstance(content, bytes):
                self.write(name, content)
            else:
                yield content

    def digests(self) -> dict[str, str]:
        """Return the sha256 of each file by name, which run.json lists.

        Raises
        ------
        OSError
            If a file cannot be read.
        """
        for name in self.names:
            if name not in self._digests:
                stands = name in self._placed
                path = self.folder / name if stands else self._part(name)
                self._digests[name] = files.digest(path)
        return {name: self._digests[name] for name in self.names}

    def publish(self, manifest: bytes) -> None:
        """Move a manifest and the files written so far to their names in the folder.

        Later files are moved by `commit`.

        manifest : the content of run.json.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        self._place(self._begun("first", manifest))

    def commit(self, manifest: bytes) -> None:
        """Place all files, remove obsolete files of the last run, place the manifest.

        A file is obsolete if the earlier run.json lists it and this run has not written
        it.

        Raises
        ------
        OSError
            If a file cannot be written; then the folder is unchanged.
        """
        part = self._part(self.manifest)
        _write(part, manifest)
        self._place(part)

    def _place(self, manifest: Path) -> None:
        new = [name for name in self.names if name not in self._placed]
        for name in new:
            _sync(self._part(name))
        obsolete = self._listed() - set(self.names)
        (self.folder / self.manifest).unlink(missing_ok=True)
        for name in new:
            files.place(self._part(name), self.folder / name)
            self._placed.add(name)
        for name in sorted(obsolete):
            with contextlib.suppress(OSError):  # a folder has taken the name
                (self.folder / name).unlink()
        files.place(manifest, self.folder / self.manifest)
        with contextlib.suppress(OSError):  # not every system syncs folders
            _sync(self.folder, os.O_RDONLY)

    def discard(self) -> None:
        """Remove the temporary files of this run, or of a killed run."""
        for path in self.folder.glob(PART.format("*")):
            if path.name != LOCK:
                with contextlib.suppress(OSError):
                    files.drop(path)

    def forget(self) -> None:
        """Remove the checkpoint of an unfinished run."""
        for path in self.folder.glob(f"{RESTART}*"):
            with contextlib.suppress(OSError):
                path.unlink()

    def unusable(self, error: OSError) -> InputError:
        """Return the InputError that the folder cannot be written, from an OSError."""
        return _unusable(self.folder, f"cannot be written: {error.strerror}")

    def _begun(self, name: str, content: bytes = b"") -> Path:
        part = self._part(name)
        os.close(files.begin(part))
        _write(part, content)
        return part

    def _part(self, name: str) -> Path:
        target = self.folder / name
        if target.is_dir() and not target.is_symlink():
            raise _unusable(self.folder, f"has a folder where {name} belongs")
        return self.folder / PART.format(name)

    def before(self) -> dict[str, Any]:
        """Return the manifest of an earlier run in the folder; {} without one."""
        try:
            found = orjson.loads(files.content(self.folder / self.manifest))
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _listed(self) -> set[str]:
        """Return the names of lagsim's files that the earlier manifest lists."""
        names = self.before().get("files")
        names = names if isinstance(names, list) else []
        own = {
            name for name in names
            if isinstance(name, str) and (is_own(name) or self._unchanged(name))
        }  # fmt: skip
        return own - {self.manifest}

    def _unchanged(self, name: str) -> bool:
        """Whether the model file `name` is as an earlier command has written it."""
        digests = self.before().get("digests")
        if not (isinstance(digests, dict) and _FITTED.fullmatch(name)):
            return False
        try:
            return digests.get(name) == files.digest(self.folder / name)
        except OSError:
            return False

    def refuse_changed(self, name: str) -> None:
        """Refuse to replace a model file that the user has changed.

        name : the name of the file, which an earlier command has written.

        Raises
        ------
        InputError
            If the file has been changed since it was written.
        """
        if (self.folder / name).is_file() and not self._unchanged(name):
            text = f"{self.folder / name} is not as `lagsim fit` has written it"
            hint = "rename it to keep it, or give another folder: -o DIR"
            raise unusable(EXISTS, text, hint=hint)


def is_own(name: str) -> bool:
    """Whether `name` is a name of lagsim's files, which a later run may remove.

    Examples
    --------
    >>> is_own("trajectory.csv"), is_own("thesis.csv")
    (True, False)
    """
    return _OWN.fullmatch(name) is not None


@contextlib.contextmanager
def open_results(
    folder: Path,
    manifest: str = MANIFEST,
    *,
    patience: float = 0.0,
    first: Callable[[], None] | None = None,
) -> Iterator[Results]:
    """Context manager: create the folder, and lock it against other runs.

    Parameters
    ----------
    folder : Path
    manifest : str
        The file that lists the others and is placed last.
    patience : float
        Seconds to wait for a lock of another process.
    first : callable, optional
        Called before the temporary files of a killed run are removed.

    Raises
    ------
    InputError
        If the folder cannot be created or written, or another run is writing into it.
    """
    results = Results(folder, manifest)
    with contextlib.ExitStack() as stack:
        try:
            if folder.exists() and not folder.is_dir():
                raise _unusable(folder, "is not a folder")
            folder.mkdir(parents=True, exist_ok=True)
            stack.enter_context(_held(results, time.monotonic() + patience))
        except OSError as error:
            raise results.unusable(error) from None
        (first or results.forget)()
        stack.callback(results.discard)
        results.discard()
        try:
            results.reserve()
        except OSError as error:
            raise results.unusable(error) from None
        yield results


@contextlib.contextmanager
def _held(results: Results, until: float) -> Iterator[None]:
    """Context manager: lock a folder against other processes.

    until : time, by the monotonic clock, up to which the lock is waited for.

    Raises
    ------
    InputError
        If another process holds the lock for longer.
    OSError
        If the lock file cannot be opened.
    """
    if fcntl is None:  # Windows: renaming over an open file fails by itself
        yield
        return
    path = results.folder / LOCK
    while (handle := _locked(path, results)) is None:
        if time.monotonic() > until:
            text = "is in use: another run is writing into it"
            raise _unusable(results.folder, text)
        time.sleep(_GLANCE_SECONDS)

    def unlock() -> None:
        path.unlink(missing_ok=True)
        # Processes that were started meanwhile have it open, too.
        fcntl.flock(handle, fcntl.LOCK_UN)

    files.passes(path, unlock)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            unlock()
        files.stays(path)
        # Once only, and only here: another file may have this number next.
        os.close(handle)


def _locked(path: Path, results: Results) -> int | None:
    """Create and lock a file; return its handle, None if another process holds it."""
    handle = _opened(path)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        kept = False
    except OSError as error:  # a file system without locks
        text = (
            f"{results.folder} cannot be locked ({error.strerror}): another run that "
            "writes into it at the same time is not noticed"
        )
        results.cautions = [Caution(NOT_LOCKED, text)]
        kept = True
    else:  # the process that had it may have removed it
        kept = os.fstat(handle).st_nlink > 0
    if kept:
        return handle
    files.stays(path)
    os.close(handle)
    return None


def _opened(path: Path) -> int:
    """Open the lock file; replace an entry of that name that is no regular file."""
    try:
        return files.begin(path)
    except FileExistsError:  # of a run that was killed, or is still running
        pass
    try:
        # locks of a network file system need write access
        return files.open_regular(path, os.O_RDWR)
    except PermissionError:  # a file of another user
        return files.open_regular(path, os.O_RDONLY)
    except OSError:
        files.drop(path)
        return files.begin(path)


def _unusable(folder: Path, why: str) -> InputError:
    return unusable(OUTPUT_FOLDER, f"the output folder {folder} {why}")


def _write(path: Path, content: bytes) -> None:
    """Write a file over its old content, so that disk space reserved for it is used."""
    handle = files.open_regular(path, os.O_RDWR)
    try:
        files.write(handle, content)
    finally:
        os.close(handle)


def _sync(path: Path, flags: int = os.O_RDWR) -> None:
    """Flush a file, or the list of entries of a folder, to the disk."""
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_atomically(path: Path, content: bytes, *, locked: bool = False) -> None:
    """Write one file atomically.

    A symbolic link in its place is replaced, not followed; pipes and terminals receive
    the bytes. A temporary file that a killed process has left is removed by the next
    holder of the folder's lock if `locked`, else by the next call for the folder after
    a minute.

    Parameters
    ----------
    path : Path
    content : bytes
    locked : bool
        Whether this process has locked the folder.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    import secrets

    if path.is_relative_to("/dev") or (path.exists() and not path.is_file()):
        files.write_irregular(path, content)
        return
    for old in () if locked else path.parent.glob(NEW.format("*")):
        with contextlib.suppress(OSError):
            if time.time() - old.stat().st_mtime > ABANDONED_SECONDS:
                old.unlink()
    unique = NEW.format(secrets.token_hex(8))
    part = path.with_name(PART.format(path.name) if locked else unique)
    try:
        os.close(files.begin(part))
        _write(part, content)
        files.place(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            files.drop(part)
        raise


# --- Before a run

# Bytes per number: in CSV about 16 digits, a sign and a comma, in packed formats a
# double; Parquet may compress to half.
USUAL = {TableFormat.CSV: 19.0, TableFormat.NPZ: 8.0, TableFormat.PARQUET: 8.0}
# Least size of a table relative to `USUAL`, except for columns of zeros.
LEAST = 0.5
# Numbers in a table above which the free disk space is checked: 20 megabytes.
MANY = 1_000_000


def refuse_without_room(
    folder: Path, form: TableFormat, settings: Settings, columns: int, *, ends: bool
) -> str:
    """Refuse a table that exceeds the free disk space; warn if it may exceed it.

    Parameters
    ----------
    folder : Path
        Folder of the table; it need not exist.
    form : TableFormat
    settings : Settings
    columns : int
        Number of columns.
    ends : bool
        Whether the run may end long before its duration, by `until`.

    Returns
    -------
    str
        The warning, or "".

    Raises
    ------
    InputError
        If the table does not fit.
    """
    rows = math.floor(settings.duration / settings.output_step) + 1
    if rows * columns < MANY:
        return ""
    needed = rows * columns * USUAL[form]
    free = _free(folder)
    if needed <= free:
        return ""
    room = limits.bytes_text(int(needed))
    about = (
        f"{rows:,} rows of {columns} columns need about {room}, "
        f"and the disk of {folder} has {limits.bytes_text(free)} free"
    )
    if ends or LEAST * needed <= free:
        return f"the disk may fill up: {about}"
    hint = "a larger output_step, fewer `output.columns`, --table npz, or another -o"
    raise unusable(NO_ROOM, f"there is no room: {about}", hint=hint)


def _free(folder: Path) -> int:
    for place in (folder, *folder.absolute().parents):
        with contextlib.suppress(OSError):
            return shutil.disk_usage(place).free
    return 1 << 62


# Keys of the options in a record; largest number of differences in a warning.
OPTIONS = ("method", "formulation", "rtol", "atol", "step")
MOST_LISTED = 3


def replaced(
    before: Mapping[str, Any], now: Mapping[str, Any], folder: Path
) -> Caution | None:
    """Return a warning if a result of other parameters or of another file is replaced.

    None if there is no need for a warning, as where the model file was edited in
    between.

    Parameters
    ----------
    before, now : mapping
        The contents of two run.json; `before` may be any JSON object.
    folder : Path
    """
    old, new = before.get("model"), now["model"]
    if not isinstance(old, dict):
        return None
    if old.get("sha256") == new["sha256"]:
        found = several(_differences(before, now), MOST_LISTED)
        detail = f"with {found}" if found else ""
    else:
        file = str(old.get("file"))
        detail = f"of {file}" if Path(file) != Path(new["file"]) else ""
    if not detail:
        return None
    text = f"this replaces the result {detail} in {folder}; with -o DIR both are kept"
    return Caution(RESULT_REPLACED, text)


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    values = before.get("parameters")
    if isinstance(values, dict):
        for name, value in now["parameters"].items():
            if name in values and values[name] != value:
                yield f"{name} = {values[name]!r}"
    for name in OPTIONS:
        if name in before and before[name] != now[name]:
            yield f"{name} {before[name]}" if before[name] is not None else f"no {name}"
    whole = before.get("outcome") == now["outcome"] == "done"
    if whole and before.get("end") != now["end"]:
        yield f"end {before.get('end')}"
