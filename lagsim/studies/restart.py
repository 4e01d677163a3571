"""Checkpoints of a run under way, so that a killed run can be continued.

A checkpoint is stored every few seconds, between two calls of the kernels. It contains
the arcs, the sources of events, records and observers, and the memories of kernels.
Everything that follows from the model (equations, plan, compiled functions) is
regenerated and referred to by name. The rows and the events are the beginnings of their
tables, identified by their sha256. While a run is in a state that cannot be stored
(with another method than its plan's, for example), the previous checkpoint stays: from
there the steps are repeated, with identical bits.

The file contains JSON and arrays, and no code. Memories of kernels contain indices into
themselves, which native code trusts. A file is therefore read only if its seal was made
with the key in this user's cache.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import json
import os
import platform
import secrets
import sys
import time
from collections import deque
from enum import Enum
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from lagsim import files
from lagsim.codes.known import ANOTHER_RUN
from lagsim.errors import InputError, unusable
from lagsim.methods import method, names
from lagsim.native.layout import Memory
from lagsim.native.link import cache
from lagsim.native.link.engine import target
from lagsim.outputs.results import PART, RESTART, RESTART_TABLE, write_atomically
from lagsim.program.system import Runner, System
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import (
        Callable,
        Collection,
        Iterable,
        Iterator,
        Mapping,
        Sequence,
    )
    from pathlib import Path

    from lagsim.outputs.table import TableWriter
    from lagsim.run.arcs import Run
    from lagsim.run.observers import Relay
    from lagsim.run.session import Session


# Shorter runs are repeated; and writing a checkpoint may take this part of the run's
# time.
EVERY_SECONDS = 3.0
MOST_OF_THE_TIME = 0.05
_KEY = "restart.key"
_KEY_BYTES = 32
_BLOCK = 1 << 20
# Modules whose classes are declared, besides the modules of methods: objects of a run
# that are not regenerated.
_MODULES = (
    "language.sparse", "mechanics.constraints", "mechanics.surfaces",
    "methods.parts.fixed", "notes", "run.arc", "run.arcs",
    "run.events.constraints", "run.events.contacts", "run.events.surface_modes",
    "run.events.accumulation", "run.events.records", "run.events.sections",
    "run.events.shown_sides", "run.events.switching", "run.events.times",
    "run.events.transitions", "run.failures", "run.instant", "run.interrupt",
    "run.progress", "run.settle", "run.trajectory",
    "run.observers", "run.observers.monitors", "run.observers.thinning",
)  # fmt: skip
CLASSES = frozenset(
    f"{module.__name__}:{name}"
    for module in (
        *(import_module(f"lagsim.{name}") for name in _MODULES),
        *map(method, names()),
    )
    for name, x in vars(module).items()
    if isinstance(x, type) and x.__module__ == module.__name__
)


class TablePart(NamedTuple):
    """The beginning of a table: its rows at a checkpoint.

    Attributes
    ----------
    name : str
        The name of the table.
    rows : int
        Number of rows.
    last : float or None
        Time of the last row, if the writer knows it.
    size, digest : int, str
        Size of the rows in bytes, header included, and their sha256.
    """

    name: str
    rows: int
    last: float | None
    size: int
    digest: str


class RunCheckpoint(NamedTuple):
    """Checkpoint of a run.

    Attributes
    ----------
    tables : tuple of TablePart
        The tables as far as they were written.
    objects : bytes
        The encoded state of the run, see `encoded`.
    """

    tables: tuple[TablePart, ...]
    objects: bytes


class Digest:
    """The sha256 of the beginning of a file that grows, and the size of this part."""

    def __init__(self) -> None:
        self.sha, self.size = hashlib.sha256(), 0

    def grow(self, path: Path, size: int) -> bool:
        """Extend the part to `size` bytes of a file.

        path : the file; whether it has that many bytes is returned.
        """
        with files.opened(path) as file:
            file.seek(self.size)
            for block in _blocks(file, size - self.size):
                self.sha.update(block)
                self.size += len(block)
        return self.size == size


class Restart:
    """Storage of checkpoints of a run, and continuation from a checkpoint.

    Parameters
    ----------
    folder : Path
        The folder of the results.
    identity : mapping of str to str
        Properties of the request by name. A run is continued only by a request with
        equal properties, by the same versions, on the same machine.
    """

    def __init__(self, folder: Path, identity: Mapping[str, str]) -> None:
        self.folder = folder
        self.identity = {**_machine(), **identity}
        self.stand: RunCheckpoint | None = None
        self._key = _key()
        self._digests: dict[str, Digest] = {}
        self._due = time.monotonic()

    # Loading of a checkpoint

    def load_checkpoint(self) -> None:
        """Load the checkpoint of the folder, if there is one, and save its tables.

        The tables are moved to places where the new run does not overwrite them.

        Raises
        ------
        InputError
            If the checkpoint belongs to another request.
        """
        stand = self._read(self.folder / RESTART)
        if stand is None:
            return
        places = [self._found(table) for table in stand.tables]
        if not all(places):
            self._digests = {}
            return
        for table, path in zip(stand.tables, places, strict=True):
            assert path is not None
            aside = self.folder / RESTART_TABLE.format(table.name)
            _move_aside(path, aside, table.size, path.name == table.name)
        self.stand = stand

    def _found(self, table: TablePart) -> Path | None:
        """Return the path of a file that begins with a part of a table, or None."""
        for name in (PART, RESTART_TABLE, "{}"):
            path, digest = self.folder / name.format(table.name), Digest()
            with contextlib.suppress(OSError):
                whole = digest.grow(path, table.size)
                if whole and digest.sha.hexdigest() == table.digest:
                    self._digests[table.name] = digest
                    return path
        return None

    def _read(self, path: Path) -> RunCheckpoint | None:
        try:
            content = files.content(path)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise _refused(path, f"cannot be read: {error.strerror}") from None
        seal, _, rest = content.partition(b"\n")
        if self._key is None or not hmac.compare_digest(seal, _seal(self._key, rest)):
            raise _refused(path, "is damaged, or not written by you on this machine")
        head, _, objects = rest.partition(b"\n")
        there, tables = json.loads(head)
        other = [x for x, own in self.identity.items() if there.get(x) != own]
        if other:
            raise _refused(path, f"is that of a run with another {', '.join(other)}")
        return RunCheckpoint(tuple(TablePart(*x) for x in tables), objects)

    # A run

    def join(
        self,
        run: Run,
        session: Session,
        relay: Relay,
        writers: Mapping[str, TableWriter],
    ) -> None:
        """Restore the checkpoint, if there is one; store later ones of this run.

        relay : the observers of rows.
        writers : the writers of the tables, by the names of the tables.
        """
        self._things = _regenerated(run, session, relay)
        self._names = {id(x): name for name, x in self._things.items()}
        self._relay, self._writers = relay, writers
        run.tick = self.tick
        if self.stand is None:
            return
        for table in self.stand.tables:
            with files.opened(self.folder / RESTART_TABLE.format(table.name)) as file:
                rows = _blocks(file, table.size)
                writers[table.name].go_on(rows, table.rows, table.last)
        states, memories, others = decoded(
            self.stand.objects, CLASSES, lambda name: _given(name, self._things)
        )
        run.__dict__.update(states)
        for name, memory in memories.items():
            self._things[name].p.flat[:] = memory
        for other, state in zip(_observers(run, relay), others, strict=True):
            other.__dict__.update(state)
        self._due = time.monotonic() + EVERY_SECONDS
        self.stand = None

    def tick(self, run: Run) -> None:
        """Store a checkpoint if the interval since the last one has passed."""
        began = time.monotonic()
        if began < self._due or self._key is None or self._relay.fault is not None:
            return
        # A state that cannot be stored now may be storable later; a full disk is
        # reported when the table is written.
        with contextlib.suppress(UndeclaredError, OSError):
            self._store_run(run, self._key)
        ended = time.monotonic()
        self._due = ended + max(EVERY_SECONDS, (ended - began) / MOST_OF_THE_TIME)

    def _store_run(self, run: Run, key: bytes) -> None:
        run.recorder.pass_on()
        systems = {k: x for k, x in self._things.items() if isinstance(x, System)}
        states = {k: x for k, x in run.__dict__.items() if k != "tick"}
        memories = {k: x.p.flat for k, x in systems.items()}
        others = [x.__dict__ for x in _observers(run, self._relay)]
        objects = encoded(
            [states, memories, others], CLASSES, lambda x: _name(x, self._names)
        )
        tables = [self._synced(name, x) for name, x in self._writers.items()]
        rest = json.dumps([self.identity, tables]).encode() + b"\n" + objects
        write_atomically(
            self.folder / RESTART, _seal(key, rest) + b"\n" + rest, locked=True
        )
        for name in self._writers:
            with contextlib.suppress(OSError):
                (self.folder / RESTART_TABLE.format(name)).unlink()

    def _synced(self, name: str, writer: TableWriter) -> TablePart:
        """Flush a table to the disk; return its part up to now, for a checkpoint."""
        size = writer.synced()
        digest = self._digests.setdefault(name, Digest())
        digest.grow(self.folder / PART.format(name), size)
        return TablePart(name, writer.rows, writer.last, size, digest.sha.hexdigest())


def _refused(path: Path, why: str) -> InputError:
    return unusable(ANOTHER_RUN, f"{path} {why}")


def _machine() -> dict[str, str]:
    """Return the versions and machine data, beside the request, that rows depend on."""
    import numpy as np

    return {
        "version of lagsim": __version__,
        "Python": sys.version,
        "version of numpy": np.__version__,
        "machine": " ".join((platform.machine(), *map(str, target()))),
    }


def _key() -> bytes | None:
    """Return this user's key, created at first use; None if there is no cache."""
    where = cache.folder("keys")
    if where is None:
        return None
    path = where / _KEY
    with contextlib.suppress(OSError):
        found = _own_key(path)
        if found is None:
            path.unlink(missing_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
            with os.fdopen(os.open(path, flags, 0o600), "wb") as file:
                file.write(secrets.token_bytes(_KEY_BYTES))
            found = _own_key(path)
        return found
    return None


def _own_key(path: Path) -> bytes | None:
    """Return the key stored in a file; None if other users can access the file.

    None also if the file cannot be read, or has another length than a key.
    """
    try:
        handle = files.open_regular(path, os.O_RDONLY)
    except OSError:
        return None
    with os.fdopen(handle, "rb") as file:
        known = os.fstat(handle)
        if sys.platform != "win32" and (
            known.st_uid != os.getuid() or known.st_mode & 0o077 or known.st_nlink != 1
        ):
            return None
        found = file.read(_KEY_BYTES + 1)
    return found if len(found) == _KEY_BYTES else None


def _seal(key: bytes, content: bytes) -> bytes:
    return hmac.new(key, content, "sha256").hexdigest().encode()


# Rows


def _blocks(file: BinaryIO, size: int) -> Iterator[bytes]:
    while size > 0 and (block := file.read(min(size, _BLOCK))):
        size -= len(block)
        yield block


def _move_aside(path: Path, aside: Path, size: int, whole: bool) -> None:
    """Move or copy the first rows of a table to `aside`, where no run overwrites it.

    The first `size` bytes of the table of a complete result (`whole`) are copied; any
    other table is renamed.
    """
    if path == aside:
        return
    if not whole:
        path.replace(aside)
        return
    aside.unlink(missing_ok=True)
    handle = files.open_regular(aside, os.O_RDWR | os.O_CREAT | os.O_EXCL)
    with os.fdopen(handle, "wb") as file, files.opened(path) as rows:
        for block in _blocks(rows, size):
            file.write(block)


# Parts of a run


def _name(x: Any, names: Mapping[int, str]) -> Any:
    """Return the name of an object that is regenerated, not stored; None for others.

    names : identity of an object -> its name.
    """
    name = names.get(id(x))
    if name is None and isinstance(x, Runner) and id(x.system) in names:
        return [names[id(x.system)], x.method.__name__.rpartition(".")[-1]]
    return name


def _given(name: Any, things: Mapping[str, Any]) -> Any:
    """Return the regenerated object with a name.

    things : the regenerated objects by name.
    """
    if isinstance(name, str):
        return things[name]
    system, method = name
    return things[system].link(method)


def _observers(run: Run, relay: Relay) -> list[Any]:
    """Return the objects of a run whose state is stored in a checkpoint.

    These are the observers of rows, which `relay` has, and the recorders of events and
    sections.
    """
    noted = run.corners, run.sections
    return [*relay.others, *(x for x in noted if x is not None)]


# Attributes of a run that are equal in all runs of a session.
_OF_RUN = (
    "first", "first.equations", "first.equations.model", "first.equations.graph",
    "first.start", "first.plan", "first.settings", "first.system",
    "first.system.equations", "first.system.equations.model", "first.system.plan",
    "first.runner", "pace", "interrupt", "progress",
)  # fmt: skip


def _regenerated(run: Run, session: Session, relay: Relay) -> dict[str, Any]:
    """Return, by name, the objects of a run that are regenerated and not stored.

    Every run of a session creates these objects alike.

    relay : the observers of rows.
    """
    case = session.case
    found = {"session": session, "relay": relay, "listed": run.recorder.listed}
    found |= {name: attrgetter(name)(run) for name in _OF_RUN}
    found |= {"case": case, "equations": case.equations, "plan": session.plan}
    found |= {f"other {k}": x for k, x in enumerate(_observers(run, relay))}
    return {name: x for name, x in found.items() if x is not None}


# --- Objects as JSON and arrays
#
# They are of declared classes alone, so that reading runs no code.
#
# A document is a line of JSON and the bytes of the arrays. The JSON is a list of nodes:
# a container, an array, or an object of a declared class with its attributes. A value
# in a node is a number, a string, null, `[k]` for node k, or `{"given": name}` for an
# object that the reader has already. Objects are made without their constructors; the
# attributes that a class lists in `DERIVED` are None, and the object makes them again.

_PLAIN = (type(None), bool, int, float, str)
_NUMBERS = "biufc"  # kinds of numpy's numeric types
_CONTAINERS = {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}


class UndeclaredError(TypeError):
    """The class of an object is not declared for storage."""


def encoded(whole: Any, classes: Iterable[str], name: Callable[[Any], Any]) -> bytes:
    """Return the object `whole` as bytes: JSON and arrays, which `decoded` reads.

    Parameters
    ----------
    classes : iterable of str
        The classes whose objects may be stored, each as `module:name`.
    name : callable
        Maps an object to the name (a JSON value) under which the reader has it, or to
        None.

    Raises
    ------
    UndeclaredError
        If the object contains an object of an undeclared class.
    """
    declared, nodes, blocks = frozenset(classes), list[Any](), bytearray()
    # With the objects, so that no other object can get the address of a deleted one.
    found: dict[int, tuple[int, Any]] = {}

    def value(x: Any) -> Any:
        if type(x) in _PLAIN:
            return x
        if (known := name(x)) is not None:
            return {"given": known}
        if id(x) not in found:
            k = len(nodes)
            found[id(x)] = k, x
            nodes.append(None)
            nodes[k] = _node(x, value, declared, blocks)
        return [found[id(x)][0]]

    text = json.dumps([value(whole), nodes], separators=(",", ":"))
    return b"".join([text.encode(), b"\n", blocks])


def _node(
    x: Any, value: Callable[[Any], Any], declared: Collection[str], blocks: bytearray
) -> list[Any]:
    kind = type(x)
    if kind in _CONTAINERS.values():
        return [kind.__name__, *map(value, x)]
    if kind is dict:
        return ["dict", *([value(k), value(v)] for k, v in x.items())]
    if kind is deque:
        return ["deque", x.maxlen, *map(value, x)]
    if isinstance(x, np.ndarray | np.generic) and x.dtype.kind in _NUMBERS:
        place, kind_name = len(blocks), "array" if kind is np.ndarray else "number"
        blocks.extend(np.ascontiguousarray(x).tobytes())
        return [kind_name, x.dtype.str, list(x.shape), place]
    named = f"{kind.__module__}:{kind.__qualname__}"
    if named not in declared:
        raise UndeclaredError(f"{named} is not declared")
    if isinstance(x, Enum):
        return ["member", named, x.name]
    if isinstance(x, Memory):  # views and the address are derived from it
        return ["memory", named, value(x.flat)]
    if isinstance(x, tuple):
        return ["named tuple", named, *map(value, x)]
    slots = [s for base in kind.__mro__ for s in getattr(base, "__slots__", ())]
    values = {slot: getattr(x, slot) for slot in slots if hasattr(x, slot)}
    values |= getattr(x, "__dict__", {})
    values |= dict.fromkeys(getattr(x, "DERIVED", ()))
    return ["object", named, *([k, value(v)] for k, v in values.items())]


def decoded(content: bytes, classes: Iterable[str], given: Callable[[Any], Any]) -> Any:
    """Return the object that the bytes of `encoded` describe.

    Parameters
    ----------
    content : bytes
        The result of `encoded`.
    classes : iterable of str
        See `encoded`.
    given : callable
        Maps a name to the reader's object.

    Raises
    ------
    UndeclaredError
        If the document names an undeclared class.
    ValueError
        If the document is malformed.
    """
    head, _, blocks = content.partition(b"\n")
    root, nodes = json.loads(head)
    declared, made = frozenset(classes), dict[int, Any]()

    def value(x: Any) -> Any:
        if type(x) in _PLAIN:
            return x
        if isinstance(x, dict):
            return given(x["given"])
        (k,) = x
        if k not in made:
            make(k, *nodes[k])
        return made[k]

    def make(k: int, kind: str, *rest: Any) -> None:
        # A container that may contain itself is created before its content.
        if kind == "list":
            made[k] = []
            made[k].extend(map(value, rest))
        elif kind == "dict":
            made[k] = {}
            made[k].update((value(a), value(b)) for a, b in rest)
        elif kind == "object":
            cls = _class(rest[0], declared)
            made[k] = new = cls.__new__(cls)
            for name, x in rest[1:]:
                object.__setattr__(new, name, value(x))
        else:
            made[k] = _whole(kind, rest, value, declared, blocks)

    return value(root)


def _whole(
    kind: str, rest: Sequence[Any], value: Any, declared: Collection[str], blocks: bytes
) -> Any:
    if kind in _CONTAINERS:
        return _CONTAINERS[kind](map(value, rest))
    if kind == "deque":
        return deque(map(value, rest[1:]), rest[0])
    if kind in ("array", "number"):
        code, shape, place = rest
        dtype = np.dtype(code)
        if dtype.kind not in _NUMBERS:
            raise ValueError(f"{code} is no type of numbers")
        count = int(np.prod(shape, dtype=np.int64))
        flat = np.frombuffer(blocks, dtype, count, place)
        return flat.reshape(shape).copy() if kind == "array" else flat[0]
    cls, *values = _class(rest[0], declared), *rest[1:]
    if kind == "member":
        return cls[values[0]]
    if kind == "memory":
        return cls(value(values[0]))
    if kind == "named tuple":
        return tuple.__new__(cls, map(value, values))
    raise ValueError(f"{kind} is no kind of node")


def _class(name: str, declared: Collection[str]) -> Any:
    if name not in declared:
        raise UndeclaredError(f"{name} is not declared")
    module, _, word = name.partition(":")
    return getattr(import_module(module), word)
