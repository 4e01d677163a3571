"""Which tests have their turn: by their names and the commit, not by their places."""

from __future__ import annotations

import functools
import hashlib
import os
import subprocess
from pathlib import Path
from typing import TypeVar

One = TypeVar("One")

COMMIT = os.environ.get("LAGSIM_TEST_COMMIT", "")


def chosen(test, commit, one_in):
    """Return whether a test is in the share of one in `one_in` of a commit.

    The result is equal at every place and in every order, and does not depend on other
    tests.
    """
    return _number(test, commit) % one_in == 0


def turn(test, commit, of):
    """Return the number of the case that a test tries at this commit.

    In time all `of` cases are tried.
    """
    return of[_number(test, commit) % len(of)]


@functools.cache
def tonight():
    """Return the commit of nightly tests: from the environment, else the tree's."""
    head = ["git", "rev-parse", "HEAD"]
    try:
        done = subprocess.run(head, cwd=Path(__file__).parent, capture_output=True)
    except FileNotFoundError:
        return COMMIT
    return COMMIT or done.stdout.decode().strip()


def share(tests, commit, one_in):
    """Return one in `one_in` of some tests, at least one; others for each commit."""
    count = -(-len(tests) // one_in)
    return sorted(tests, key=lambda test: _number(test, commit))[:count]


def _number(test, commit):
    digest = hashlib.sha256(f"{test}\0{commit}".encode()).digest()
    return int.from_bytes(digest[:8], "big")


def slices(text):
    """Read `slow=4,nightly=100`."""
    pairs = (pair.split("=") for pair in text.split(",") if pair)
    return {mark: int(one_in) for mark, one_in in pairs}
