"""The memory of a kernel: one declaration for native code, CPython and numpy."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

import pytest

from lagsim.native.kernels.keys import Digests, KernelError
from lagsim.native.kernels.translation import translate
from lagsim.native.layout import Block, Memory, after, array, block, part

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


def stores_a_size(s: Walk) -> None:
    s.size = 3  # type: ignore[misc]


def takes_a_block(s: Walk) -> float:
    return s.half  # type: ignore[return-value]


def asks_for_more(s: Walk) -> float:
    return s.count  # type: ignore[attr-defined, no-any-return]


def test_the_flat_array_is_all_there_is_to_it() -> None:
    s = Longer.allocate(size=4)
    # Four words, two for each of six arrays and a block, and 4 + 4 + 12 + 3 elements:
    # what is a part has none of its own.
    assert len(s.flat) == 4 + 2 * 7 + 23
    assert s.low.tolist() == [inf] * 4
    s.last[:] = 7.0
    again = s.copy()
    assert again.slopes.tolist() == [0.0] * 4 + [7.0] * 4 + [0.0] * 4
    again.y[1] = 6.0
    assert s.y[1] == 0.0


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


def counts(s: Longer) -> float:
    return s.count


def test_another_declaration_is_another_fingerprint(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = Digests().fingerprint([counts])
    monkeypatch.setattr(Longer.fields["count"], "word", 20)
    assert Digests().fingerprint([counts]) != before


def test_an_array_of_a_base_class_is_not_replaced_unawares() -> None:
    """Kernels of the base class would write past its end."""
    with pytest.raises(TypeError, match="y: a base class has another array"):

        class _Other(Walk):
            y: Floats = array(lambda _: 0)

    class Replaced(Walk):
        y: Floats = array(lambda _: 0, replaces=True)

    assert len(Replaced.allocate().y) == 0
