"""Which tests have their turn: by their names and the commit, not by their places."""

from __future__ import annotations

import hashlib


def chosen(test: str, commit: str, one_in: int) -> bool:
    """Tell whether a test is among the one in `one_in` of this commit.

    The same at every place and in every order; a test more or less changes nothing for
    the others.
    """
    digest = hashlib.sha256(f"{test}\0{commit}".encode()).digest()
    return int.from_bytes(digest[:8], "big") % one_in == 0


def slices(text: str) -> dict[str, int]:
    """Read `slow=4,nightly=100`."""
    pairs = (pair.split("=") for pair in text.split(",") if pair)
    return {mark: int(one_in) for mark, one_in in pairs}
