"""Objects as JSON and arrays: of declared classes alone, so that reading runs no code.

A document is a line of JSON and the bytes of the arrays. The JSON is a list of nodes: a
container, an array, or an object of a declared class with its attributes. A value in a
node is a number, a string, null, `[k]` for node k, or `{"given": name}` for an object
that the reader has already. Objects are made without their constructors; the attributes
that a class lists in `DERIVED` are None, and the object makes them again.
"""

from __future__ import annotations

import importlib
import json
from collections import deque
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.native.layout import Memory

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

_PLAIN = (type(None), bool, int, float, str)
_NUMBERS = "biufc"  # kinds of numpy's types: no objects
_CONTAINERS = {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}


class UndeclaredError(TypeError):
    """An object of a class that is not declared."""


def encoded(what: Any, classes: Iterable[str], name: Callable[[Any], Any]) -> bytes:
    """Give an object as a document.

    Parameters
    ----------
    classes
        The declared classes, each as `module:name`.
    name
        Gives the name (of JSON) of an object that the reader has, or None.

    Raises
    ------
    UndeclaredError
        If it holds an object of another class.
    """
    writer = _Encoder(frozenset(classes), name)
    text = json.dumps([writer.value(what), writer.nodes], separators=(",", ":"))
    return b"".join([text.encode(), b"\n", *writer.blocks])


def decoded(content: bytes, classes: Iterable[str], given: Callable[[Any], Any]) -> Any:
    """Give the object of a document of `encoded`.

    Parameters
    ----------
    given
        Gives an object by its name.

    Raises
    ------
    UndeclaredError
        If the document names a class that is not declared.
    ValueError
        If it is no document, or damaged.
    """
    head, _, blocks = content.partition(b"\n")
    root, nodes = json.loads(head)
    return _Decoder(nodes, blocks, frozenset(classes), given).value(root)


class _Encoder:
    """Writes nodes; each object once."""

    def __init__(self, classes: frozenset[str], name: Callable[[Any], Any]) -> None:
        self.nodes: list[Any] = []
        self.blocks: list[bytes] = []
        self._size = 0  # of the blocks, in bytes
        self._classes, self._name = classes, name
        # With the objects, lest another gets the address of one that is gone.
        self._found: dict[int, tuple[int, Any]] = {}

    def value(self, x: Any) -> Any:
        if type(x) in _PLAIN:
            return x
        name = self._name(x)
        if name is not None:
            return {"given": name}
        if id(x) not in self._found:
            k = len(self.nodes)
            self._found[id(x)] = k, x
            self.nodes.append(None)
            self.nodes[k] = self._node(x)
        return [self._found[id(x)][0]]

    def _node(self, x: Any) -> list[Any]:
        kind = type(x)
        if kind in _CONTAINERS.values():
            return [kind.__name__, *map(self.value, x)]
        if kind is dict:
            return ["dict", *([self.value(k), self.value(v)] for k, v in x.items())]
        if kind is deque:
            return ["deque", x.maxlen, *map(self.value, x)]
        if isinstance(x, np.ndarray | np.generic) and x.dtype.kind in _NUMBERS:
            place = self._size
            self.blocks.append(np.ascontiguousarray(x).tobytes())
            self._size += x.nbytes
            what = "array" if isinstance(x, np.ndarray) else "number"
            return [what, x.dtype.str, list(x.shape), place]
        name = f"{kind.__module__}:{kind.__qualname__}"
        if name not in self._classes:
            raise UndeclaredError(f"{name} is not declared")
        if isinstance(x, Enum):
            return ["member", name, x.name]
        if isinstance(x, Memory):  # views and address follow
            return ["memory", name, self.value(x.flat)]
        if isinstance(x, tuple):
            return ["named tuple", name, *map(self.value, x)]
        slots = [s for base in kind.__mro__ for s in getattr(base, "__slots__", ())]
        held = {slot: getattr(x, slot) for slot in slots if hasattr(x, slot)}
        held |= getattr(x, "__dict__", {})
        held |= dict.fromkeys(getattr(x, "DERIVED", ()))
        return ["object", name, *([k, self.value(v)] for k, v in held.items())]


class _Decoder:
    """Makes objects of nodes; each once."""

    def __init__(
        self,
        nodes: Sequence[Any],
        blocks: bytes,
        classes: frozenset[str],
        given: Callable[[Any], Any],
    ) -> None:
        self._nodes, self._blocks = nodes, blocks
        self._classes, self._given = classes, given
        self._made: dict[int, Any] = {}

    def value(self, x: Any) -> Any:
        if type(x) in _PLAIN:
            return x
        if isinstance(x, dict):
            return self._given(x["given"])
        (k,) = x
        if k not in self._made:
            self._make(k, *self._nodes[k])
        return self._made[k]

    def _make(self, k: int, kind: str, *rest: Any) -> None:
        # What may hold itself is there before its content.
        if kind == "list":
            self._made[k] = []
            self._made[k].extend(map(self.value, rest))
        elif kind == "dict":
            self._made[k] = {}
            self._made[k].update((self.value(a), self.value(b)) for a, b in rest)
        elif kind == "object":
            cls = self._class(rest[0])
            self._made[k] = made = cls.__new__(cls)
            for name, x in rest[1:]:
                object.__setattr__(made, name, self.value(x))
        else:
            self._made[k] = self._whole(kind, rest)

    def _whole(self, kind: str, rest: Sequence[Any]) -> Any:
        if kind in _CONTAINERS:
            return _CONTAINERS[kind](map(self.value, rest))
        if kind == "deque":
            return deque(map(self.value, rest[1:]), rest[0])
        if kind in ("array", "number"):
            code, shape, place = rest
            dtype = np.dtype(code)
            if dtype.kind not in _NUMBERS:
                raise ValueError(f"{code} is no type of numbers")
            count = int(np.prod(shape, dtype=np.int64))
            flat = np.frombuffer(self._blocks, dtype, count, place)
            return flat.reshape(shape).copy() if kind == "array" else flat[0]
        cls, *content = self._class(rest[0]), *rest[1:]
        if kind == "member":
            return cls[content[0]]
        if kind == "memory":
            return cls(self.value(content[0]))
        if kind == "named tuple":
            return tuple.__new__(cls, map(self.value, content))
        raise ValueError(f"{kind} is no kind of node")

    def _class(self, name: str) -> Any:
        if name not in self._classes:
            raise UndeclaredError(f"{name} is not declared")
        module, _, word = name.partition(":")
        return getattr(importlib.import_module(module), word)
