"""The folder of a run's results: replaced as a whole, or left as it was.

Every file is written beside its place and synced. When all are complete the old
run.json goes, the files take their places, and the new run.json comes last: who finds a
run.json finds the files that it lists, whatever happened in between. A table and its
run.json may do so before pictures are drawn, which come to them later.

A folder may come from a stranger. Nothing is written through a link that was put there,
no pipe is waited for, and of what its run.json lists only files with names that lagsim
gives are removed.
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

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]

import orjson

from lagsim import files, limits
from lagsim.errors import InputError, several, unusable
from lagsim.notes import Caution
from lagsim.outputs import Format

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from lagsim.model.model import Settings
    from lagsim.outputs import Made

MANIFEST = "run.json"
# Room kept on the disk for a run.json that says that the disk is full.
RESERVE_BYTES = 1 << 16
PART, NEW = ".lagsim-{}.part", ".lagsim-{}.new"
# So long after a file was begun nobody writes to it any more.
ABANDONED_SECONDS = 60.0
# Locked by who fills a folder, and gone when it is filled. A file, for on a network
# file system a lock of the folder itself holds back no other machine.
LOCK = PART.format("lock")
# A run on its way, and the rows that one which goes on with it begins with.
RESTART, RESTART_ROWS = ".lagsim-restart", ".lagsim-restart.rows"
# What lagsim calls what it leaves, so that a later run may remove it.
_OWN = re.compile(
    r"(trajectory|events|energy|constraint_forces|plot_\d+|animation|overlay|spectrum"
    r"|reactions|work_precision|stability|sweep|section_\w+)"
    r"\.(csv|npz|parquet|json|png|svg|pdf|html)"
)
# How often one who waits for a folder looks whether it is free.
_GLANCE_SECONDS = 0.02


class Results:
    """A folder being filled; use `open_results`.

    Attributes
    ----------
    names : list of str
        The files that `commit` will put in their places, the manifest aside.
    manifest : str
        The file that lists the others.
    cautions : list of Caution
        That the folder could not be locked, where it could not.
    """

    def __init__(self, folder: Path, manifest: str = MANIFEST) -> None:
        self.folder = folder
        self.manifest = manifest
        self.names: list[str] = []
        self.cautions: list[Caution] = []
        self._placed: set[str] = set()
        self._digests: dict[str, str] = {}

    def reserve(self) -> None:
        """Keep room for the manifest."""
        self._begun(self.manifest, bytes(RESERVE_BYTES))

    def part(self, name: str) -> Path:
        """Return the path to write file `name` to until `commit`."""
        if name in self.names:
            return self._part(name)
        self.names.append(name)
        return self._begun(name)

    def write(self, name: str, content: bytes) -> None:
        """Write a whole file, or, where that fails, nothing."""
        try:
            _write(self.part(name), content)
        except BaseException:
            self.drop(name)
            raise

    def drop(self, name: str) -> None:
        """Do without a file that was begun."""
        self._digests.pop(name, None)
        if name in self.names:
            self.names.remove(name)
        files.drop(self._part(name))

    def fill(self, made: Iterable[Made]) -> Iterator[Caution]:
        """Write files; give the warnings of those that could not be drawn."""
        for name, content in made:
            if isinstance(content, bytes):
                self.write(name, content)
            else:
                yield content

    def digests(self) -> dict[str, str]:
        """Return the sha256 of each file, by which readers know them for one set.

        Raises
        ------
        OSError
            If one cannot be read.
        """
        for name in self.names:
            if name not in self._digests:
                stands = name in self._placed
                path = self.folder / name if stands else self._part(name)
                self._digests[name] = files.digest(path)
        return {name: self._digests[name] for name in self.names}

    def stand(self, manifest: bytes) -> None:
        """Put in its place what there is so far; `commit` adds what comes later.

        Raises
        ------
        OSError
            If something cannot be written.
        """
        self._place(self._begun("first", manifest))

    def commit(self, manifest: bytes) -> None:
        """Put all files in their places, remove what the last run left, then run.json.

        Removed is what an earlier run.json lists and this run has not written.

        Raises
        ------
        OSError
            If something cannot be written; then the folder is as it was.
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
        """Remove what was begun, by this run or by one that was killed."""
        for path in self.folder.glob(PART.format("*")):
            if path.name != LOCK:
                with contextlib.suppress(OSError):
                    files.drop(path)

    def forget(self) -> None:
        """Remove what a run on its way has kept of itself."""
        for name in (RESTART, RESTART_ROWS):
            with contextlib.suppress(OSError):
                (self.folder / name).unlink()

    def unusable(self, error: OSError) -> InputError:
        """Return what tells that nothing can be written here."""
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
        """Return what an earlier run's manifest says; nothing where there is none."""
        try:
            found = orjson.loads(files.content(self.folder / self.manifest))
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _listed(self) -> set[str]:
        """Return the files of the run before."""
        names = self.before().get("files")
        names = names if isinstance(names, list) else []
        own = {n for n in names if isinstance(n, str) and is_own(n)}
        return own - {self.manifest}


def is_own(name: str) -> bool:
    """Return whether lagsim gives a file that name, and may remove it."""
    return _OWN.fullmatch(name) is not None


@contextlib.contextmanager
def open_results(
    folder: Path,
    manifest: str = MANIFEST,
    *,
    patience: float = 0.0,
    first: Callable[[], None] | None = None,
) -> Iterator[Results]:
    """Make the folder and hold it against other runs.

    Parameters
    ----------
    manifest
        The file that lists the others and comes last.
    patience
        So many seconds another may take until it has left the folder.
    first
        Called before what was left by a killed run is removed.

    Raises
    ------
    InputError
        If the folder cannot be made or written, or another run is writing into it.
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
    """Hold a folder as soon as no other process does; it is free when this one ends.

    Raises
    ------
    InputError
        Where another does for too long.
    OSError
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

    def leave() -> None:
        path.unlink(missing_ok=True)
        # Processes that were begun since have it open, too.
        fcntl.flock(handle, fcntl.LOCK_UN)

    files.passes(path, leave)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            leave()
        files.stays(path)
        # Once only, and by nobody else: another file may have its number next.
        os.close(handle)


def _locked(path: Path, results: Results) -> int | None:
    """Lock a file, made if need be; give its handle, or None where another has."""
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
        results.cautions = [Caution("not-locked", text)]
        kept = True
    else:  # who had it may have removed it
        kept = os.fstat(handle).st_nlink > 0
    if kept:
        return handle
    files.stays(path)
    os.close(handle)
    return None


def _opened(path: Path) -> int:
    """Open the file that is locked; what else has its name is replaced."""
    try:
        return files.begin(path)
    except FileExistsError:  # of a run that was killed, or goes on
        pass
    try:
        return files.held(path, os.O_RDWR)  # a network's locks are for those who write
    except PermissionError:  # another user's
        return files.held(path, os.O_RDONLY)
    except OSError:
        files.drop(path)
        return files.begin(path)


def _unusable(folder: Path, why: str) -> InputError:
    return unusable("output-folder", f"the output folder {folder} {why}")


def _write(path: Path, content: bytes) -> None:
    """Write a file over what is there, so that room kept there is used."""
    handle = files.held(path, os.O_RDWR)
    try:
        files.write(handle, content)
    finally:
        os.close(handle)


def _sync(path: Path, flags: int = os.O_RDWR) -> None:
    """Have the system put a file, or a folder's list of files, on the disk."""
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def put(path: Path, content: bytes, *, held: bool = False) -> None:
    """Write one file as a whole or not at all.

    A link in its place is replaced, not followed. A pipe that is read and a terminal
    get the bytes. `held`: into a folder that is held; who holds it next removes what
    a process that is killed here has begun, elsewhere who writes there after a minute.

    Raises
    ------
    OSError
        Where that fails.
    """
    import secrets

    if path.is_relative_to("/dev") or (path.exists() and not path.is_file()):
        files.pour(path, content)
        return
    for old in () if held else path.parent.glob(NEW.format("*")):
        with contextlib.suppress(OSError):
            if time.time() - old.stat().st_mtime > ABANDONED_SECONDS:
                old.unlink()
    unique = NEW.format(secrets.token_hex(8))
    part = path.with_name(PART.format(path.name) if held else unique)
    try:
        os.close(files.begin(part))
        _write(part, content)
        files.place(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            files.drop(part)
        raise


# --- Before a run

# Bytes of a number and its comma, as people's scenes have them: 16 digits and a sign.
# Packed, each is a double; Parquet and its kin may do with half.
USUAL = {Format.CSV: 19.0, Format.NPZ: 8.0, Format.PARQUET: 8.0}
# Below this it never is, but for columns of zeros.
LEAST = 0.5
# Numbers in a table from which on it is asked whether the disk has room: 20 megabytes.
MANY = 1_000_000


def refuse_without_room(
    folder: Path, form: Format, settings: Settings, columns: int, *, ends: bool
) -> str:
    """Refuse a table that the disk has no room for; warn of one that it may not have.

    Parameters
    ----------
    folder
        Where it comes; it need not be there yet.
    ends
        The run may end long before its time, by `until`.

    Returns
    -------
    str
        The warning, or nothing.

    Raises
    ------
    InputError
    """
    rows = math.floor(settings.duration / settings.output_step) + 1
    if rows * columns < MANY:
        return ""
    needed = rows * columns * USUAL[form]
    free = _free(folder)
    if needed <= free:
        return ""
    about = (
        f"{rows:,} rows of {columns} columns take about {limits.size(int(needed))}, "
        f"and where {folder} is, {limits.size(free)} are free"
    )
    if ends or LEAST * needed <= free:
        return f"the disk may fill up: {about}"
    hint = "a larger output_step, fewer `output.columns`, --table npz, or another -o"
    raise unusable("no-room", f"there is no room: {about}", hint=hint)


def _free(folder: Path) -> int:
    for place in (folder, *folder.absolute().parents):
        with contextlib.suppress(OSError):
            return shutil.disk_usage(place).free
    return 1 << 62


# How a result was made, by the keys of a record; so many differences are listed.
OPTIONS = ("method", "formulation", "rtol", "atol", "step")
MOST_LISTED = 3


def replaced(
    before: Mapping[str, Any], now: Mapping[str, Any], folder: Path
) -> Caution | None:
    """Warn of a result of the same file with other parameters, or of another file.

    There is no warning of a file that was edited since.

    Parameters
    ----------
    before, now
        The contents of two run.json; the first may be anything.
    """
    old, new = before.get("model"), now["model"]
    if not isinstance(old, dict):
        return None
    if old.get("sha256") == new["sha256"]:
        found = several(_differences(before, now), MOST_LISTED)
        what = f"with {found}" if found else ""
    else:
        file = str(old.get("file"))
        what = f"of {file}" if Path(file) != Path(new["file"]) else ""
    if not what:
        return None
    text = f"this replaces the result {what} in {folder}; with -o DIR both are kept"
    return Caution("result-replaced", text)


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
