"""WebAssembly module from a single LLVM object and initial contents of memory.

In a single object LLVM has set every index and every address, from 0 on, and its
relocations may be dropped. A linker's other work is done here: memory, stack pointer
and exports replace the imports, and further data is placed after the object's data.

Sources: WebAssembly Core Specification 2.0, chapter 5 (binary format);
WebAssembly/tool-conventions, Linking.md, version 2 (section "linking").
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from lagsim.native.link.engine import NativeError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

PAGE = 2**16
STACK = 2**16
# The object's first data, so that the stack ends at address 0: an overflow is a trap.
STACK_IR = f"@stack = global [{STACK} x i8] zeroinitializer, align 16\n"
ALIGNMENT = 64

# Data that are the instructions of a tape, see `graph.tapes`.
TAPE = b"tape."

# Numbers of sections, and of kinds of symbols.
TYPE, IMPORT, FUNCTION, MEMORY, GLOBAL, EXPORT = 1, 2, 3, 5, 6, 7
CODE, DATA, DATA_COUNT = 10, 11, 12
ORDER = TYPE, IMPORT, FUNCTION, MEMORY, GLOBAL, EXPORT, DATA_COUNT, CODE, DATA
SEGMENTS, SYMBOLS = 5, 8  # subsections of "linking"
A_FUNCTION, A_DATUM, A_SECTION = 0, 1, 3
UNDEFINED, NAMED = 0x10, 0x40
IMPORTED = b"__linear_memory", b"__stack_pointer"
# An active segment, and the constant that its address is.
ACTIVE = b"\0\x41"
I32_CONST, END, VARIABLE_I32 = b"\x41", b"\x0b", b"\x7f\1"


class Reader:
    """Sequential reader of the bytes of a section."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, count: int) -> bytes:
        """Return the next `count` bytes."""
        self.at += count
        return self.data[self.at - count : self.at]

    def number(self) -> int:
        """Return the next LEB128 number, unsigned or signed but not negative."""
        [byte] = self.take(1)
        return byte if byte < 128 else byte - 128 + (self.number() << 7)

    def sized(self) -> bytes:
        """Return the next bytes, whose count precedes them."""
        return self.take(self.number())

    @property
    def rest(self) -> bytes:
        """The bytes that have not been read."""
        return self.data[self.at :]


def number(x: int) -> bytes:
    """Return x < 2^31 as LEB128 of 5 bytes, valid both as unsigned and as signed.

    Examples
    --------
    >>> number(200).hex()
    'c881808000'
    >>> Reader(number(200)).number()
    200
    """
    return bytes([x >> 7 * k & 127 | 128 * (k < 4) for k in range(5)])


def sized(data: bytes) -> bytes:
    """Return `data`, preceded by its length."""
    return number(len(data)) + data


def vector(entries: Collection[bytes]) -> bytes:
    """Return the entries, preceded by their count."""
    return number(len(entries)) + b"".join(entries)


def module(
    code: bytes,
    exports: Collection[str],
    images: Mapping[str, bytes | int],
    described: Mapping[str, Any],
) -> bytes:
    """Return a WebAssembly module with the code of an object.

    Parameters
    ----------
    code : bytes
        An object from `engine.link_object`, whose IR begins with STACK_IR.
    exports : collection of str
        Names of the exported functions; the memory is exported as "memory".
    images : mapping of str to bytes or int
        Data placed after the object's data: bytes, or a number of zero bytes.
    described : mapping
        Written to the section "lagsim" as JSON in UTF-8, with the address of each image
        as `places`, and of each tape as `tapes`.

    Raises
    ------
    NativeError
        If the object needs other imports, or has data without a constant address.
    """
    found = _sections(code)
    data = Reader(found[DATA])
    segments: dict[int, bytes] = {}
    tapes = []
    data.number()  # of segments
    for name in _segments(found["linking"]):
        if data.take(2) != ACTIVE:
            raise NativeError("a segment of a wasm object has no constant address")
        place = data.number()
        data.take(1)
        segments[place] = data.sized()
        if TAPE in name:
            tapes.append(place)
    if len(segments.pop(0, b"")) != STACK:
        raise NativeError("the stack is not the first of a wasm object's data")
    end = max([STACK, *(place + len(content) for place, content in segments.items())])
    places = {}
    for key, content in images.items():
        places[key] = end = -(-end // ALIGNMENT) * ALIGNMENT
        if isinstance(content, bytes):
            segments[end] = content
            end += len(content)
        else:
            end += content
    written = [
        ACTIVE + number(place) + END + sized(content)
        for place, content in segments.items()
    ]
    # Memory and stack pointer are imported, and replaced.
    known = sum(name in found[IMPORT] for name in IMPORTED)
    if found[IMPORT][:1] != bytes([known]):
        raise NativeError(f"a wasm object imports more than {IMPORTED}")
    indices = _functions(found["linking"])
    seen = [sized(x.encode()) + b"\0" + number(indices[x]) for x in exports]
    found |= {
        IMPORT: vector([]),
        MEMORY: vector([b"\0" + number(-(-end // PAGE))]),
        GLOBAL: vector([VARIABLE_I32 + I32_CONST + number(STACK) + END]),
        EXPORT: vector([*seen, sized(b"memory") + b"\2\0"]),
        DATA_COUNT: number(len(written)),
        DATA: vector(written),
    }
    text = json.dumps({**described, "places": places, "tapes": tapes}).encode()
    parts = [code[:8], *(bytes([key]) + sized(found[key]) for key in ORDER)]
    return b"".join(parts) + b"\0" + sized(sized(b"lagsim") + text)


def described(module: bytes) -> dict[str, Any]:
    """Return the content of the section "lagsim" of a module."""
    found: dict[str, Any] = json.loads(_sections(module)["lagsim"])
    return found


def tapes(module: bytes) -> list[tuple[int, int]]:
    """Return the first byte and the number of bytes of each tape in a module."""
    indices, found = described(module)["tapes"], []
    content = _sections(module)[DATA]
    first = module.index(content)
    data = Reader(content)
    for _ in range(data.number()):
        data.take(2)
        place = data.number()
        data.take(1)
        size = len(data.sized())
        if place in indices:
            found.append((first + data.at - size, size))
    return found


def _sections(code: bytes) -> dict[int | str, bytes]:
    """Return the content of each section of a module, by number.

    A custom section has its name in place of the number.
    """
    reader, found = Reader(code[8:]), dict[int | str, bytes]()
    while reader.rest:
        [key] = reader.take(1)
        content = Reader(reader.sized())
        name = content.sized().decode() if key == 0 else key
        found[name] = content.rest
    return found


def _segments(linking: bytes) -> list[bytes]:
    """Return the names of an object's segments of data, in order.

    linking : the content of its section "linking".
    """
    reader, found = Reader(linking), list[bytes]()
    reader.number()  # version
    while reader.rest:
        [subsection] = reader.take(1)
        table = Reader(reader.sized())
        for _ in range(table.number() if subsection == SEGMENTS else 0):
            found.append(table.sized())
            table.number()  # alignment
            table.number()  # flags
    return found


def _functions(linking: bytes) -> dict[str, int]:
    """Return the index of each function that an object defines, by name.

    linking : the content of its section "linking", which has the symbol table.
    """
    reader, found = Reader(linking), dict[str, int]()
    reader.number()  # version
    while reader.rest:
        [subsection] = reader.take(1)
        table = Reader(reader.sized())
        for _ in range(table.number() if subsection == SYMBOLS else 0):
            [kind] = table.take(1)
            flags = table.number()
            if kind == A_DATUM:
                table.sized()
                for _ in range(0 if flags & UNDEFINED else 3):
                    table.number()
                continue
            index = table.number()
            if kind != A_SECTION and (flags & NAMED or not flags & UNDEFINED):
                name = table.sized().decode()
                if kind == A_FUNCTION:
                    found[name] = index
    return found
