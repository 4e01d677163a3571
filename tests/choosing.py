"""Which tests have their turn: by their names and the commit, not by their places."""

from __future__ import annotations

import hashlib
import os
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Sequence

One = TypeVar("One")

COMMIT = os.environ.get("LAGSIM_TEST_COMMIT", "")


def chosen(test: str, commit: str, one_in: int) -> bool:
    """Tell whether a test is among the one in `one_in` of this commit.

    The same at every place and in every order; a test more or less changes nothing for
    the others.
    """
    return _number(test, commit) % one_in == 0


def turn(test: str, commit: str, of: Sequence[One]) -> One:
    """Give which of several cases a test tries at this commit: in time all of them."""
    return of[_number(test, commit) % len(of)]


def _number(test: str, commit: str) -> int:
    digest = hashlib.sha256(f"{test}\0{commit}".encode()).digest()
    return int.from_bytes(digest[:8], "big")


def slices(text: str) -> dict[str, int]:
    """Read `slow=4,nightly=100`."""
    pairs = (pair.split("=") for pair in text.split(",") if pair)
    return {mark: int(one_in) for mark, one_in in pairs}
