"""Object code, kept by content in the user's cache.

A kept object is found by a digest of what it was made from: the graph, or the text and
the tables of kernels, with the versions, the CPU and its features. Nothing is ever
out of date, only unused, and the oldest goes when the folder grows too large.

The folder holds code that will be run, so it must belong to this user and be writable
by nobody else. Where there is none like that, all works without, only slower.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import struct
import sys
import threading
import time
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lagsim import files
from lagsim.native.kernels import keys
from lagsim.native.link import ahead, engine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

CACHE_VARIABLE = "LAGSIM_CACHE"
"""Environment variable naming the folder to use in place of the platform's."""

LIMIT_BYTES = 256 * 2**20
"""Size at which the objects that were not used for longest are removed."""

_FORMAT = "4"  # of files and keys; a change leaves all that is kept unused
_MAGIC = b"lagsim object " + _FORMAT.encode() + b"\n"
_SUFFIX = ".object"
_SIZE = struct.Struct("<q")  # the length of p, before an object
_USED_AGAIN_SECONDS = 86400.0  # how fine the age of a file is kept, to spare writes
_ABANDONED_SECONDS = 3600.0  # after which a file half written has no writer

# What another process is making, by key.
_coming: dict[str, Callable[[], bytes]] = {}
_fingerprints: dict[tuple[object, ...], str] = {}


class Part:
    """A part of a program: functions that are written, and compiled, together.

    Parameters
    ----------
    made_from : sequence of str
        Its kind and a digest, by which IR and object code are kept.
    write : function
        Gives its IR, and the length of p that its functions need.
    optimise : bool
        See `engine.compile_object`.
    """

    def __init__(
        self,
        made_from: Sequence[str],
        write: Callable[[], tuple[str, int]],
        *,
        optimise: bool,
    ) -> None:
        self.made_from, self.optimise, self._write = made_from, optimise, write

    @cached_property
    def _content(self) -> bytes:
        return _kept([*self.made_from, *engine.target()], self._compiled)

    def _compiled(self) -> bytes:
        ir, p_size = self._write()
        return _SIZE.pack(p_size) + engine.compile_object(ir, optimise=self.optimise)

    @property
    def object(self) -> bytes:
        """Object code for `engine.target()`.

        Raises
        ------
        KernelError
            If a kernel leaves the subset.
        NativeError
            If LLVM refuses the IR.
        """
        return self._content[_SIZE.size :]

    @property
    def p_size(self) -> int:
        """Length of p that its functions need; 0 for kernels."""
        return int(_SIZE.unpack_from(self._content)[0])

    @property
    def ir(self) -> str:
        """LLVM IR, the same for all targets; kept once it has been asked for."""
        key = [*self.made_from, "ir"]
        return _kept(key, lambda: str.encode(self._write()[0])).decode()

    def begin(self) -> None:
        """Have a second process make the object code, where there may be one."""
        key, path = _place([*self.made_from, *engine.target()])
        if path is None or not path.exists():
            _coming[key] = ahead.bring(self._compiled)


def graph_part(made_from: str, generate: Callable[[], tuple[str, int]]) -> Part:
    """Functions of a graph: its digest, see `graph.keys`, and what writes the code."""
    return Part(["graph", made_from], generate, optimise=False)


def kernel_part(
    functions: Sequence[Callable[..., Any]], statics: Mapping[str, object] | None = None
) -> Part:
    """Kernels; they are translated where they are not kept.

    functions, statics : as for `translation.translate`.
    """
    # The digest is made once in a process: a short run takes little longer.
    known = *functions, repr(statics)
    if known not in _fingerprints:
        _fingerprints[known] = keys.fingerprint(functions, statics)

    def translated() -> tuple[str, int]:
        from lagsim.native.kernels import translation  # only first runs translate

        return translation.translate(functions, statics), 0

    return Part(["kernel", _fingerprints[known]], translated, optimise=True)


def linked(
    parts: Sequence[Part], first: str, exports: Sequence[str], chosen: engine.Target
) -> bytes:
    """Object code of all parts as one, for any target, see `engine.link_object`.

    first : IR that is linked before theirs.
    """
    parts = [*parts, *runtime(chosen)]

    def made() -> bytes:
        irs = [(first, False), *((part.ir, part.optimise) for part in parts)]
        return engine.link_object(irs, exports, chosen)

    sources = [word for part in parts for word in part.made_from]
    return _kept(["linked", *sources, first, *exports, *chosen], made)


def runtime(chosen: engine.Target) -> list[Part]:
    """Parts that a target asks for besides those of a program."""
    if not chosen.portable:
        return []
    from lagsim.native import elementary

    return [kernel_part(elementary.FUNCTIONS)]


def folder(name: str = "objects") -> Path | None:
    """Folder of the cache, made if need be; None if there is none to trust.

    It is in $LAGSIM_CACHE, or in the platform's folder for caches. It belongs to this
    user, and nobody else may write into it, or rename a folder on the way to it.
    """
    try:
        base = _base()
        if base is None:
            return None
        path = base / name
        _make(path)
        trusted = _is_own(path.lstat()) and all(map(_is_kept, path.resolve().parents))
    except (OSError, RuntimeError):  # RuntimeError: there is no home
        return None
    return path if trusted else None


def _make(path: Path) -> None:
    """Make a folder, and those above it, for this user alone."""
    if not path.is_dir():
        _make(path.parent)
        path.mkdir(mode=0o700, exist_ok=True)


def _is_own(found: os.stat_result) -> bool:
    if not stat.S_ISDIR(found.st_mode):
        return False
    if sys.platform == "win32":  # access lists, inherited from the user's profile
        return True
    return found.st_uid == os.getuid() and not found.st_mode & 0o022


def _is_kept(above: Path) -> bool:
    """Whether what is in a folder stays there, whoever else may write into it.

    A group may be this user's alone; everybody is not.
    """
    mode = above.stat().st_mode
    return sys.platform == "win32" or not mode & 0o002 or bool(mode & stat.S_ISVTX)


def _base() -> Path | None:
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen).expanduser().absolute()
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "lagsim"
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA")
        return Path(local) / "lagsim" / "cache" if local else None
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    # The XDG base directory specification has relative paths ignored.
    return (given if given.is_absolute() else Path.home() / ".cache") / "lagsim"


def _place(made_from: Sequence[object]) -> tuple[str, Path | None]:
    """Key of what is made from that, and where it is kept, if it can be."""
    where = folder()
    key = _digest([_FORMAT, *made_from])
    return key, None if where is None else where / f"{key}{_SUFFIX}"


def _kept(made_from: Sequence[object], make: Callable[[], bytes]) -> bytes:
    key, path = _place(made_from)
    code = None if path is None else _read(path, key)
    coming = _coming.pop(key, make)
    if code is None:
        code = coming()
        if path is not None:
            _write(path, key, code)
    return code


def _digest(parts: Iterable[object]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        text = str(part).encode()
        digest.update(b"%d:" % len(text))
        digest.update(text)
    return digest.hexdigest()


def _seal(key: str, code: bytes) -> bytes:
    """Return what stands before an object: it is whole, and that of its key."""
    return _MAGIC + hashlib.sha256(key.encode() + code).digest()


def _read(path: Path, key: str) -> bytes | None:
    """Read an object; None if there is none, not the whole of one, or another."""
    try:
        content = files.content(path)
    except OSError:
        return None
    start = len(_MAGIC) + hashlib.sha256().digest_size
    code = content[start:]
    if content[:start] != _seal(key, code):
        return None
    with contextlib.suppress(OSError):
        if time.time() - path.stat().st_mtime > _USED_AGAIN_SECONDS:
            os.utime(path)
    return code


def _write(path: Path, key: str, code: bytes) -> None:
    """Keep an object: written beside and renamed, so that readers find all or none."""
    beside = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}")
    try:
        with os.fdopen(files.begin(beside, 0o600), "wb") as file:
            file.write(_seal(key, code) + code)
            files.place(beside, path)
    except OSError:  # no room, or on Windows another process is reading the file
        with contextlib.suppress(OSError):
            files.drop(beside)
    # Keys are evenly spread: one new object in sixteen has the folder looked through.
    if path.name.startswith("0"):
        prune(path.parent)


def prune(where: Path, limit: int = LIMIT_BYTES) -> None:
    """Remove the files not used for longest, down to half the limit if over it."""
    there = []
    with contextlib.suppress(OSError):
        for path in where.iterdir():
            found = path.stat()
            age = time.time() - found.st_mtime
            if path.suffix == _SUFFIX or age > _ABANDONED_SECONDS:
                there.append((found.st_mtime, found.st_size, path))
    size = sum(s for _, s, _ in there)
    if size <= limit:
        return
    for _, removed, path in sorted(there):
        with contextlib.suppress(OSError):
            path.unlink()
        size -= removed
        if size <= limit // 2:
            return
