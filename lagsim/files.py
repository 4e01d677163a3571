"""Reading and writing of regular files; pipes, devices and links are refused.

A pipe or a device is not read, since the program could wait for its data for ever. A
new file is created only where no file or link exists, so that no link leads elsewhere.

Temporary files are registered before they are created, so that they can be removed when
this process ends, between any two instructions.
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

# Removals to carry out when this process ends, by key.
_passing: dict[object, Callable[[], object]] = {}


def opened(path: Path | str) -> BufferedReader:
    """Open a regular file for reading.

    Raises
    ------
    OSError
        If there is no such file, it cannot be read, or it is not a regular file.
    """
    return os.fdopen(_regular(path, os.O_RDONLY), "rb")


def content(path: Path | str, most: int | None = None) -> bytes:
    """Return the whole content of a regular file of at most `most` bytes.

    By default `most` is the limit of documents, `limits.DOCUMENT_BYTES`.

    Raises
    ------
    OSError
        If the file cannot be opened (see `opened`), or is larger than `most`.
    """
    with opened(path) as file:
        return all_of(file, limits.DOCUMENT_BYTES if most is None else most)


def all_of(file: BinaryIO, most: int) -> bytes:
    """Read a stream to its end, up to `most` bytes.

    Raises
    ------
    OSError
        If the stream has more bytes than `most`, or cannot be read.
    """
    found = file.read(most + 1)
    if len(found) > most:
        text = f"it has more than {limits.bytes_text(most)}, which is the limit"
        raise OSError(errno.EFBIG, text)
    return found


def digest(path: Path | str) -> str:
    """Return the sha256 of a regular file, in hexadecimal digits.

    Raises
    ------
    OSError
        If the file cannot be opened, see `opened`.
    """
    import hashlib

    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def open_regular(path: Path | str, flags: int, rights: int = 0o666) -> int:
    """Open a regular file without following links; return its file descriptor.

    Parameters
    ----------
    flags
        Flags of `os.open`.
    rights
        Permissions of a file that is created; by default the usual ones of a new file.

    Raises
    ------
    OSError
        If the path is a link, a pipe, a folder or a device, or as `os.open` does.
    """
    try:
        return _regular(path, flags | _NO_LINK, rights)
    except OSError as error:
        # a link, or a pipe without a reader
        if error.errno in (errno.ELOOP, errno.ENXIO):
            text = f"{os.fspath(path)} is a link or a pipe, and no regular file"
            raise OSError(error.errno, text) from None
        raise


def begin(path: Path, rights: int = 0o666) -> int:
    """Create a temporary file, removed at exit unless placed; return its descriptor.

    Raises
    ------
    OSError
        If the file cannot be created (see `open_regular`), or exists.
    """
    passes(path, lambda: path.unlink(missing_ok=True))
    try:
        return open_regular(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, rights)
    except OSError:
        stays(path)  # another process owns the path
        raise


def place(part: Path, path: Path) -> None:
    """Rename a temporary file of `begin` to its final path, replacing a file there.

    Raises
    ------
    OSError
        As `os.replace` does.
    """
    part.replace(path)
    stays(part)


def drop(path: Path) -> None:
    """Remove a temporary file of `begin`, also one that a killed process has left.

    Raises
    ------
    OSError
        If the file exists and cannot be removed.
    """
    path.unlink(missing_ok=True)
    stays(path)


def passes(key: object, remove: Callable[[], object]) -> None:
    """Register the removal of a file, which is carried out when this process ends.

    key : identifies the removal, so that `stays` can cancel it.
    remove : function that removes the file.
    """
    _passing[key] = remove


def stays(key: object) -> None:
    """Cancel the removal registered for a key."""
    _passing.pop(key, None)


@atexit.register
def remove_passing() -> None:
    """Carry out all removals of files that `passes` has registered.

    It has to be called before `os._exit`, which calls no exit functions.
    """
    while _passing:
        _, remove = _passing.popitem()
        with contextlib.suppress(OSError):
            remove()


def write(handle: int, content: bytes) -> None:
    """Write the whole content of an open file and flush it to the disk."""
    view = memoryview(content)
    while view:
        view = view[os.write(handle, view) :]
    os.ftruncate(handle, len(content))
    os.fsync(handle)


def write_irregular(path: Path | str, content: bytes) -> None:
    """Write to a file that is not regular: a pipe with a reader, or a terminal.

    Raises
    ------
    OSError
        Where writing fails, or the pipe has no reader.
    """
    handle = os.open(path, os.O_WRONLY | _BINARY | _NO_WAITING)
    with os.fdopen(handle, "wb") as file:
        os.set_blocking(handle, True)
        file.write(content)


def _regular(path: Path | str, flags: int, rights: int = 0o666) -> int:
    """Open a regular file; return its descriptor, or raise OSError for other kinds.

    flags, rights : see `open_regular`.
    """
    handle = os.open(path, flags | _BINARY | _NO_WAITING, rights)
    mode = os.fstat(handle).st_mode
    if stat.S_ISREG(mode):
        return handle
    os.close(handle)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, IRREGULAR, str(path))
