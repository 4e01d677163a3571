"""The memory of a kernel: one declaration for native code, CPython and numpy."""

from __future__ import annotations

import ctypes
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lagsim.methods import method, names
from lagsim.methods.moreau import Impulses
from lagsim.methods.parts.newton import SparseNewton
from lagsim.methods.parts.parameters import Parameters
from lagsim.native.kernels.keys import KernelError, fingerprint
from lagsim.native.kernels.translation import translate
from lagsim.native.layout import ARRAY, SIZE, Block, Memory, after, array, block, part
from lagsim.native.link.engine import Engine, compile_object
from tests.kernels import bind

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


class Walk(Memory):
    """A little of everything."""

    t: float
    size: int
    stages: int = 2
    half: Block = block("size", lambda s: s.size // 2)
    y: Floats = array("size")
    low: Floats = array("size", inf)
    slopes: Floats = array(lambda s: s.stages * s.size)
    first: Floats = part("slopes", "size")
    last: Floats = after("first", "size")


class Longer(Walk):
    """The same with more stages, and memory of its own."""

    stages: int = 3
    weights: Floats = array(lambda s: s.stages, (0.5, 0.25, 0.25))
    count: float


def move(s: Longer, p: Walk, h: float) -> int:
    rest = s.y[s.half]
    s.y[:] += h * s.weights * p.last[: s.stages]
    s.y[s.half] += s.low[s.half]
    rest[s.half.stop - s.half.start - 1] *= 2.0
    s.t += h
    s.count = s.count + 1.0
    p.t = s.t
    return s.size + p.stages


def stores_a_size(s: Walk) -> None:
    s.size = 3  # type: ignore[misc]


def takes_a_block(s: Walk) -> float:
    return s.half  # type: ignore[return-value]


def asks_for_more(s: Walk) -> float:
    return s.count  # type: ignore[attr-defined, no-any-return]


def memories() -> tuple[Longer, Walk]:
    s, p = Longer.made(size=3), Walk.made(size=3)
    s.y[:] = 1.0, 2.0, 3.0
    s.low[:] = 5.0, 6.0, 7.0
    p.slopes[:] = np.arange(6.0)
    return s, p


def test_the_flat_array_is_all_there_is_to_it() -> None:
    s = Longer.made(size=4)
    # Four words, two for each of six arrays and a block, and 4 + 4 + 12 + 3 elements:
    # what is a part has none of its own.
    assert len(s.flat) == 4 + 2 * 7 + 23
    assert s.low.tolist() == [inf] * 4
    s.last[:] = 7.0
    again = s.copy()
    assert again.slopes.tolist() == [0.0] * 4 + [7.0] * 4 + [0.0] * 4
    again.y[1] = 6.0
    assert s.y[1] == 0.0


def test_another_memory_takes_what_both_have() -> None:
    short, long = Walk.made(size=2), Longer.made(size=2)
    short.t = 3.0
    short.y[:] = 1.0, 2.0
    short.slopes[:] = 9.0
    long.take(short)
    assert (long.t, long.stages) == (3.0, 3)
    assert long.y.tolist() == [1.0, 2.0]
    assert not long.slopes.any()  # of another length here


def test_a_kernel_writes_names_natively_and_in_python() -> None:
    expected = [1.0 + 0.5 * 0.5 * 3.0, 2.0 + 0.5 * 0.25 * 4.0, 3.0 + 0.5 * 0.25 * 5.0]
    expected[1:] = expected[1] + 6.0, 2.0 * (expected[2] + 7.0)
    engine = Engine([compile_object(translate([move]))])
    pointer = ctypes.c_void_p
    native = engine.function(
        "move", ctypes.c_int64, (pointer, pointer, ctypes.c_double)
    )
    compiled, plain = memories(), memories()
    assert native(*(m.flat.ctypes.data for m in compiled), 0.5) == 3 + 2
    assert bind(move, {})(*plain, 0.5) == 3 + 2
    for s, p in (compiled, plain):
        assert s.y.tolist() == expected
        assert (s.t, s.count, p.t) == (0.5, 1.0, 0.5)
    for one, other in zip(compiled, plain, strict=True):
        assert np.array_equal(one.flat, other.flat)


@pytest.mark.parametrize(
    ("kernel", "message"),
    [
        (stores_a_size, "`s.size` takes no value"),
        (takes_a_block, "is a block, of which arrays have a stretch"),
        (asks_for_more, "Walk has no `count`"),
    ],
)
def test_faults_of_memories(kernel: Any, message: str) -> None:
    with pytest.raises(KernelError, match=message):
        translate([kernel])


def test_another_declaration_is_another_fingerprint(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = fingerprint([move])
    monkeypatch.setattr(Longer.fields["count"], "word", 20)
    assert fingerprint([move]) != before


MEMORIES = [method(name).STATE for name in names()]
MEMORIES += [Parameters, Impulses, SparseNewton]


@pytest.mark.parametrize("memory", MEMORIES)
def test_no_array_lies_in_another(memory: type[Memory]) -> None:
    every = {
        name: 1 for name, f in memory.fields.items() if f.kind == SIZE and not f.value
    }
    s = memory.made(**every | {"n": 3, "size": 7, "surfaces": 2})
    end = s.words
    arrays = {key: f for key, f in s.fields.items() if f.kind == ARRAY}
    wholes = [key for key, field in arrays.items() if not field.within]
    for key in wholes:
        assert s.place(key) == end, key
        end = s.place_after(key)
    assert end == len(s.flat)
    for key in arrays.keys() - {*wholes}:
        assert any(
            s.place(whole) <= s.place(key) <= s.place_after(key) <= s.place_after(whole)
            for whole in wholes
        ), key
