"""The table of features in pairs: what is refused, and with what message.

Every pair that does not stand here is run against its closed form.
"""

from __future__ import annotations

import itertools
import zlib

from tests.scenes.pairs.physical import BY_NAME, FRAGMENTS

HOLDS_AT_TIMES = (
    "contact", "friction on one slip", "friction on the disc", "limit", "freewheel",
    "when",
)  # fmt: skip
PAIRS = tuple(
    (a.name, b.name) for a, b in itertools.combinations_with_replacement(FRAGMENTS, 2)
)
WAYS = ("beside", "coupled")
# The words of the refusal, which names both features.
REFUSED = {
    ("until", "until"): r"the key `until` is given twice",
    ("redundant", "elimination"): r"`elimination` cannot be used: constraints are "
    r"redundant",
    **dict.fromkeys(
        ((law, "elimination") for law in HOLDS_AT_TIMES),
        "`elimination` cannot be used: the model has constraints that come and go",
    ),
}


def part_of(name: str, parts: int) -> bool:
    """Tell whether a case is in the quick slice: one of so many, by its name alone."""
    return zlib.crc32(name.encode()) % parts == 0


__all__ = ["BY_NAME", "HOLDS_AT_TIMES", "PAIRS", "REFUSED", "WAYS", "part_of"]
