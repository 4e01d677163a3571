"""Reading and writing of regular files alone, whatever stands in their place.

A pipe or a device is not read: it would keep a program waiting for ever. A new file is
made where nothing is, so that no link leads elsewhere.

Files on their way to their places are known before they are made, so that whatever ends
this process, between any two instructions, can remove them.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import os
import stat
from typing import TYPE_CHECKING

from lagsim import limits

if TYPE_CHECKING:
    from collections.abc import Callable
    from io import BufferedReader
    from pathlib import Path
    from typing import BinaryIO

# Absent on Windows, which has no such links and no such pipes.
_BINARY = getattr(os, "O_BINARY", 0)
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_NO_WAITING = getattr(os, "O_NONBLOCK", 0)

IRREGULAR = "it is a pipe or a device, and no regular file"

# What removes each file that is not to outlive this process.
_passing: dict[object, Callable[[], object]] = {}


def opened(path: Path | str) -> BufferedReader:
    """Open a regular file for reading.

    Raises
    ------
    OSError
        If there is none, it cannot be read, or it is something else.
    """
    return os.fdopen(_regular(path, os.O_RDONLY), "rb")


def content(path: Path | str, most: int | None = None) -> bytes:
    """Read the whole of a regular file, of so many bytes at most: of a document's.

    Raises
    ------
    OSError
        As `opened` does, or where there are more.
    """
    with opened(path) as file:
        return all_of(file, limits.DOCUMENT_BYTES if most is None else most)


def all_of(file: BinaryIO, most: int) -> bytes:
    """Read a stream to its end, if it has one.

    Raises
    ------
    OSError
        Where there are more bytes than `most`, or it cannot be read.
    """
    found = file.read(most + 1)
    if len(found) > most:
        text = f"it has more than {limits.size(most)}, which is the limit"
        raise OSError(errno.EFBIG, text)
    return found


def digest(path: Path | str) -> str:
    """Give the sha256 of a regular file.

    Raises
    ------
    OSError
        As `opened` does.
    """
    import hashlib

    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def held(path: Path | str, flags: int, rights: int = 0o666) -> int:
    """Open a regular file through no link; give its handle.

    Parameters
    ----------
    flags
        As for `os.open`.
    rights
        Of a file that is made; by default those of any new one.

    Raises
    ------
    OSError
        If it is something else, or as `os.open` does.
    """
    try:
        return _regular(path, flags | _NO_LINK, rights)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO):  # a link; a pipe nobody reads
            text = f"{os.fspath(path)} is a link or a pipe, and no regular file"
            raise OSError(error.errno, text) from None
        raise


def begin(path: Path, rights: int = 0o666) -> int:
    """Make a file that goes with this process until it is placed; give its handle.

    Raises
    ------
    OSError
        As `held` does, or where there is one.
    """
    passes(path, lambda: path.unlink(missing_ok=True))
    try:
        return held(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, rights)
    except OSError:
        stays(path)  # it is another's
        raise


def place(part: Path, path: Path) -> None:
    """Put a file that was begun in the place of what is there.

    Raises
    ------
    OSError
    """
    part.replace(path)
    stays(part)


def drop(path: Path) -> None:
    """Remove a file that was begun, here or by a process that was killed.

    Raises
    ------
    OSError
    """
    path.unlink(missing_ok=True)
    stays(path)


def passes(key: object, remove: Callable[[], object]) -> None:
    """Have something removed when this process ends, should it be there yet."""
    _passing[key] = remove


def stays(key: object) -> None:
    """Leave it to others from now on."""
    _passing.pop(key, None)


@atexit.register
def remove_passing() -> None:
    """Remove what does not outlive this process; `os._exit` does not ask for it."""
    while _passing:
        _, remove = _passing.popitem()
        with contextlib.suppress(OSError):
            remove()


def write(handle: int, content: bytes) -> None:
    """Write the whole content of an open file, and have it on the disk."""
    view = memoryview(content)
    while view:
        view = view[os.write(handle, view) :]
    os.ftruncate(handle, len(content))
    os.fsync(handle)


def pour(path: Path | str, content: bytes) -> None:
    """Write to what keeps nothing: a pipe that somebody reads, a terminal.

    Raises
    ------
    OSError
        Where that fails, or nobody reads the pipe.
    """
    handle = os.open(path, os.O_WRONLY | _BINARY | _NO_WAITING)
    with os.fdopen(handle, "wb") as file:
        os.set_blocking(handle, True)
        file.write(content)


def _regular(path: Path | str, flags: int, rights: int = 0o666) -> int:
    """Open a regular file, and nothing else; give its handle."""
    handle = os.open(path, flags | _BINARY | _NO_WAITING, rights)
    mode = os.fstat(handle).st_mode
    if stat.S_ISREG(mode):
        return handle
    os.close(handle)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, IRREGULAR, str(path))
