"""Object code, stored by its inputs in the user's cache.

Stored code is found by a digest of its inputs: the graph, or the text and the tables of
kernels, with the versions, the CPU and its features. So no object is ever out of date,
only unused, and the oldest are removed when the folder grows too large.

The folder holds code that will be executed, so it must belong to this user and be
writable by nobody else. Without such a folder nothing is stored, and code is compiled
in each process.
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
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lagsim import files
from lagsim.native.kernels import keys
from lagsim.native.link import ahead, engine

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

CACHE_VARIABLE = "LAGSIM_CACHE"
"""Environment variable naming the folder to use in place of the platform's."""

LIMIT_BYTES = 256 * 2**20
"""Size of the folder above which the objects unused for longest are removed."""

_FORMAT = "4"  # of files and keys; a change leaves all stored objects unused
_MAGIC = b"lagsim object " + _FORMAT.encode() + b"\n"
_SUFFIX = ".object"
_SIZE = struct.Struct("<q")  # the length of p, before an object
_USED_AGAIN_SECONDS = 86400.0  # how fine the age of a file is kept, to spare writes
_ABANDONED_SECONDS = 3600.0  # after which a file half written has no writer

_digests = keys.Digests()


class ProgramPart:
    """A part of a program: functions that are generated and compiled together.

    Parameters
    ----------
    made_from : sequence of str
        Kind and digest of the inputs, by which IR and object code are stored.
    write : function
        Returns the IR, and the length of p that its functions need.
    optimise : bool
        See `engine.compile_object`.
    gradual : bool
        Whether the part may be linked as quick code first, see `gradual`.
    """

    def __init__(
        self,
        made_from: Sequence[str],
        write: Callable[[], tuple[str, int]],
        *,
        optimise: bool,
        gradual: bool = True,
    ) -> None:
        self.made_from, self.optimise, self.gradual = made_from, optimise, gradual
        self._write = write
        self._written: tuple[str, int] | None = None  # kept beside quick code

    @cached_property
    def content(self) -> bytes:
        """`p_size`, and `object`.

        Raises
        ------
        KernelError, NativeError
            As for `object`.
        """
        return _kept(self._key, self._compiled)

    @property
    def _key(self) -> list[object]:
        return [*self.made_from, *engine.target()]

    def _compiled(self) -> bytes:
        ir, p_size = self._written or self._write()
        self._written = None
        return _SIZE.pack(p_size) + engine.compile_object(ir, optimise=self.optimise)

    @property
    def is_compiled(self) -> bool:
        """Whether `object` is known, or in the cache, from which it is then read."""
        return self.is_known("content")

    def is_known(self, name: str) -> bool:
        """Whether `content` or `quick_content` (`name`) is known, or in the cache."""
        if name not in self.__dict__:
            key = self._key if name == "content" else self._quick_key
            found = _stored(*_place(key))
            if found is not None:
                self.keep(name, found)
        return name in self.__dict__

    def keep(self, name: str, code: bytes) -> None:
        """Set `content` or `quick_content` (`name`), compiled elsewhere."""
        self.__dict__[name] = code
        if name == "content":
            self._written = None

    @cached_property
    def quick_content(self) -> bytes:
        """`p_size`, and each of `quick_objects` with its length before it.

        Raises
        ------
        KernelError, NativeError
            As for `object`.
        """
        return _kept(self._quick_key, self._quickly_compiled)

    def _quickly_compiled(self) -> bytes:
        self._written = self._written or self._write()
        ir, p_size = self._written
        objects = engine.quick_objects(ir, optimise=self.optimise)
        framed = (_SIZE.pack(len(x)) + x for x in objects)
        return _SIZE.pack(p_size) + b"".join(framed)

    @property
    def quick_objects(self) -> list[bytes]:
        """Object code that is compiled soon and runs longer, with the bits of `object`.

        Raises
        ------
        KernelError, NativeError
            As for `object`.
        """
        objects, at, content = [], _SIZE.size, self.quick_content
        while at < len(content):
            begin = at + _SIZE.size
            at = begin + _SIZE.unpack_from(content, at)[0]
            objects.append(content[begin:at])
        return objects

    @property
    def _quick_key(self) -> list[object]:
        return [*self._key, "quick objects"]

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
        return self.content[_SIZE.size :]

    @property
    def p_size(self) -> int:
        """Length of the array p that the functions read; 0 for kernels."""
        for name in ("content", "quick_content"):
            if self.is_known(name):
                return int(_SIZE.unpack_from(getattr(self, name))[0])
        self._written = self._written or self._write()
        return self._written[1]

    @property
    def ir(self) -> str:
        """LLVM IR, equal for all targets; stored in the cache once it has been read."""
        key = [*self.made_from, "ir"]
        return _kept(key, lambda: str.encode(self._write()[0])).decode()


def compile_parts(
    parts: Sequence[ProgramPart],
    quick: Collection[ProgramPart],
    *,
    alone: bool = False,
) -> list[ProgramPart]:
    """Compile the parts that are not in the cache; return these parts.

    A second process compiles half of them where possible.

    quick : the parts whose quick code is wanted, see `ProgramPart.quick_objects`.
    alone : see `ahead.shared`.
    """
    names = [(x, "quick_content" if x in quick else "content") for x in parts]
    missing = [(x, name) for x, name in names if not x.is_known(name)]
    tasks = [partial(getattr, *wanted) for wanted in missing]
    made = ahead.shared(tasks, alone=alone)
    for (part, name), code in zip(missing, made, strict=True):
        part.keep(name, code)
    return [part for part, _ in missing]


def graph_part(
    made_from: str, generate: Callable[[], tuple[str, int]], *, gradual: bool = True
) -> ProgramPart:
    """Return the `ProgramPart` of functions that are generated from a graph.

    Parameters
    ----------
    made_from : str
        Digest of the graph, see `graph.keys`.
    generate : function
        Returns the IR, and the length of p that the functions need.
    gradual : bool
        See `ProgramPart`.
    """
    made = ["graph", made_from]
    return ProgramPart(made, generate, optimise=False, gradual=gradual)


def kernel_part(
    functions: Sequence[Callable[..., Any]], statics: Mapping[str, object] | None = None
) -> ProgramPart:
    """Return the `ProgramPart` of kernels.

    The kernels are translated unless the cache has the code.

    functions, statics : see `translation.translate`.
    """
    digest = _digests.fingerprint(functions, statics)

    def translated() -> tuple[str, int]:
        from lagsim.native.kernels import translation  # only first runs translate

        return translation.translate(functions, statics), 0

    return ProgramPart(["kernel", digest], translated, optimise=True)


def linked(
    parts: Sequence[ProgramPart],
    first: str,
    exports: Sequence[str],
    chosen: engine.Target,
) -> bytes:
    """Return the object code of all parts as one object, see `engine.link_object`.

    Parameters
    ----------
    parts : sequence of ProgramPart
    first : str
        IR that is linked before the parts.
    exports : sequence of str
        Symbols that stay visible.
    chosen : Target
        Any target, not only this machine.
    """
    parts = [*parts, *runtime(chosen)]

    def made() -> bytes:
        irs = [(first, False), *((part.ir, part.optimise) for part in parts)]
        return engine.link_object(irs, exports, chosen)

    sources = [word for part in parts for word in part.made_from]
    return _kept(["linked", *sources, first, *exports, *chosen], made)


def runtime(chosen: engine.Target) -> list[ProgramPart]:
    """Return the parts that a target needs besides a program: elementary functions.

    [] for a target that is not portable.
    """
    if not chosen.portable:
        return []
    from lagsim.native import elementary

    return [kernel_part(elementary.FUNCTIONS)]


def folder(name: str = "objects") -> Path | None:
    """Return the folder of the cache, created if need be; None if it is not trusted.

    The folder `name` lies in $LAGSIM_CACHE, or in the platform's folder for caches. A
    trusted folder belongs to this user, and nobody else may write into it or rename one
    of its parents.
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
    """Create a folder and its parents, for this user alone."""
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
    """Whether other users cannot rename or remove entries of the folder `above`.

    A group may write, since it may have this user only; others may not.
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
    """Return the key of given inputs, and the path of their object.

    The path is None where there is no trusted folder.

    made_from : kind and digest of the inputs.
    """
    where = folder()
    key = _digest([_FORMAT, *made_from])
    return key, None if where is None else where / f"{key}{_SUFFIX}"


def _kept(made_from: Sequence[object], make: Callable[[], bytes]) -> bytes:
    key, path = _place(made_from)
    code = _stored(key, path)
    if code is None:
        code = make()
        if path is not None:
            _write(path, key, code)
    return code


def _stored(key: str, path: Path | None) -> bytes | None:
    return None if path is None else _read(path, key)


def _digest(parts: Iterable[object]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        text = str(part).encode()
        digest.update(b"%d:" % len(text))
        digest.update(text)
    return digest.hexdigest()


def _seal(key: str, code: bytes) -> bytes:
    """Return the header of a stored object: a digest of its key and its code."""
    return _MAGIC + hashlib.sha256(key.encode() + code).digest()


def _read(path: Path, key: str) -> bytes | None:
    """Return a stored object; None if it is missing, incomplete or of another key."""
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
    """Store `code` under a key, by renaming a temporary file to `path`.

    Other processes find the complete file or none.
    """
    beside = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}")
    try:
        with os.fdopen(files.begin(beside, 0o600), "wb") as file:
            file.write(_seal(key, code) + code)
            files.place(beside, path)
    except OSError:  # no room, or on Windows another process is reading the file
        with contextlib.suppress(OSError):
            files.drop(beside)
    # Keys are evenly distributed: the folder is pruned after one new object in sixteen.
    if path.name.startswith("0"):
        prune(path.parent)


def prune(where: Path, limit: int = LIMIT_BYTES) -> None:
    """Remove the files unused for longest if a folder is larger than `limit` bytes.

    Afterwards it has at most half of `limit` bytes.
    """
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
