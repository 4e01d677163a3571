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
    from collections.abc import Callable, Collection, Iterable, Sequence

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
    declared, nodes, blocks = frozenset(classes), list[Any](), bytearray()
    # With the objects, lest another gets the address of one that is gone.
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

    text = json.dumps([value(what), nodes], separators=(",", ":"))
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
        place, what = len(blocks), "array" if kind is np.ndarray else "number"
        blocks.extend(np.ascontiguousarray(x).tobytes())
        return [what, x.dtype.str, list(x.shape), place]
    named = f"{kind.__module__}:{kind.__qualname__}"
    if named not in declared:
        raise UndeclaredError(f"{named} is not declared")
    if isinstance(x, Enum):
        return ["member", named, x.name]
    if isinstance(x, Memory):  # views and address follow
        return ["memory", named, value(x.flat)]
    if isinstance(x, tuple):
        return ["named tuple", named, *map(value, x)]
    slots = [s for base in kind.__mro__ for s in getattr(base, "__slots__", ())]
    held = {slot: getattr(x, slot) for slot in slots if hasattr(x, slot)}
    held |= getattr(x, "__dict__", {})
    held |= dict.fromkeys(getattr(x, "DERIVED", ()))
    return ["object", named, *([k, value(v)] for k, v in held.items())]


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
        # What may hold itself is there before its content.
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
    cls, *held = _class(rest[0], declared), *rest[1:]
    if kind == "member":
        return cls[held[0]]
    if kind == "memory":
        return cls(value(held[0]))
    if kind == "named tuple":
        return tuple.__new__(cls, map(value, held))
    raise ValueError(f"{kind} is no kind of node")


def _class(name: str, declared: Collection[str]) -> Any:
    if name not in declared:
        raise UndeclaredError(f"{name} is not declared")
    module, _, word = name.partition(":")
    return getattr(importlib.import_module(module), word)
