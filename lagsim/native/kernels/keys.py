"""Digest of the sources of kernels, computed without translation.

A warm run finds cached object code by this digest, and never imports the translator.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import sys
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeGuard

from lagsim.native.kernels import words
from lagsim.native.layout import Memory

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

Static: TypeAlias = "bool | int | float | tuple[Static, ...]"


class KernelError(Exception):
    """A kernel leaves the subset of Python; the message has file, line and advice."""


class Reached(NamedTuple):
    """A kernel as it enters a digest.

    Attributes
    ----------
    text : str
        Its name, its static globals, and digests of the layouts of its parameters.
    file : str
        Digest of the file that defines it.
    calls : list of function
        The kernels that it uses.
    """

    text: str
    file: str
    calls: list[FunctionType]


class Digests:
    """Digests of the sources of kernels, each kernel read once.

    Files, globals and layouts must not change while an instance is in use.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[object, ...], str] = {}
        self._reached = functools.cache(self._read)
        self._layouts: dict[type[Memory], str] = {}
        self._file = functools.cache(_file_digest)

    def fingerprint(
        self,
        functions: Sequence[Callable[..., Any]],
        statics: Mapping[str, object] | None = None,
    ) -> str:
        """Return a digest of all inputs that determine the text written by `translate`.

        The digest covers the files of the translator and of the modules of all kernels
        reached, and the values of the static globals that the kernels use, also values
        computed from other modules.

        functions, statics : see `translation.translate`.
        """
        chosen = repr(sorted((statics or {}).items()))
        if (*functions, chosen) not in self._known:
            self._known[*functions, chosen] = self._computed(functions, chosen)
        return self._known[*functions, chosen]

    def _computed(self, functions: Sequence[Callable[..., Any]], chosen: str) -> str:
        # Minor versions of Python may parse the same text differently.
        parts = [repr(sys.version_info[:2]), chosen, text_beside(__file__)]
        waiting = dict.fromkeys(map(as_kernel, functions))
        parts += [f"exported {x.__module__}.{x.__qualname__}" for x in waiting]
        reached: dict[FunctionType, None] = {}
        while waiting:
            function, _ = waiting.popitem()
            reached[function] = None
            found = self._reached(function)
            parts += [found.text, found.file]
            waiting |= dict.fromkeys(x for x in found.calls if x not in reached)
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def _read(self, function: FunctionType) -> Reached:
        plain = inspect.unwrap(function)
        parts = [f"{plain.__module__}.{plain.__qualname__}"]
        for memory in memories(function).values():
            if memory not in self._layouts:
                self._layouts[memory] = _layout_digest(memory)
            parts.append(self._layouts[memory])
        calls = []
        if not words.is_external(function):
            for name, value in _globals(function):
                if is_static(value):
                    parts.append(f"{name} = {value!r}")
                elif is_own(value):
                    calls.append(value)
        file = self._file(plain.__code__.co_filename)
        return Reached("\n".join(parts), file, calls)


def _layout_digest(memory: type[Memory]) -> str:
    fields = memory.fields.items()
    text = "\n".join(f"{name} {field.kind} {field.word}" for name, field in fields)
    return hashlib.sha256(text.encode()).hexdigest()


def _file_digest(file: str) -> str:
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


@functools.cache
def text_beside(file: str) -> str:
    """Return a digest of all modules in the folder of `file`."""
    digest = hashlib.sha256()
    for module in sorted(Path(file).parent.glob("*.py")):
        digest.update(module.read_bytes())
    return digest.hexdigest()


def _globals(function: FunctionType) -> Iterator[tuple[str, object]]:
    """Yield (name, value) of the globals that a function uses.

    Attributes of modules are included if their names occur in the function.
    """
    used = names_in(function.__code__)
    for name in used:
        value = function.__globals__.get(name)
        yield name, value
        if isinstance(value, ModuleType):
            yield from ((n, vars(value)[n]) for n in used if n in vars(value))


def is_own(value: object) -> TypeGuard[FunctionType]:
    """Whether a global is a function defined outside `words`, and so a kernel."""
    return isinstance(value, FunctionType) and value.__module__ != words.__name__


def as_kernel(function: Callable[..., Any]) -> FunctionType:
    """Return `function` if it is a plain function.

    Raises
    ------
    KernelError
        If it is another callable.
    """
    if not isinstance(function, FunctionType):
        raise KernelError(f"{function!r}: a kernel is a function made by `def`")
    return function


def names_in(code: CodeType) -> list[str]:
    """Return the global and attribute names in a function and its nested code."""
    found = list(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            found += names_in(constant)
    return found


def memories(function: FunctionType) -> dict[str, type[Memory]]:
    """Return the `Memory` class of each parameter of a kernel that has one."""
    plain = inspect.unwrap(function)
    found = {}
    for name, annotation in plain.__annotations__.items():
        meaning = plain.__globals__.get(str(annotation))
        if isinstance(meaning, type) and issubclass(meaning, Memory):
            found[name] = meaning
    return found


def is_static(value: object) -> TypeGuard[Static]:
    """Whether a value is a number, a bool or a tuple of static values.

    Examples
    --------
    >>> is_static((0.5, (1, 2))), is_static([0.5])
    (True, False)
    """
    if isinstance(value, tuple):
        return all(map(is_static, value))
    return type(value) in (bool, int, float)
