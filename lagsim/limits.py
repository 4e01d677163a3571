"""Budgets: the largest input and work that lagsim accepts from a file.

Each limit is far beyond a file written by hand, and bounds memory and time: a file of
100 kB is checked in 10 s and 1 GB, and derived, or refused, within 20 s. Larger input
is refused with a message that names the limit. `lifted` removes the limits on derived
equations, for files of the machine's own user (`--no-limits`).
"""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

MODEL_BYTES = 16 << 20
"""Largest model file: 10^5 members with a line of 160 letters each."""

DOCUMENT_BYTES = 256 << 20
"""Largest record, golden or journal, which are read as a whole."""

TABLE_BYTES = 4 << 30
"""Largest table of results that is read; it needs as much memory."""

TABLE_NUMBERS = 1_000_000
"""Largest number of coefficients of a table of a model: a cubic curve has four per
point."""

NODES = 1_000_000
"""Largest number of scalars and collections of YAML in a model file; half a kilobyte
each."""

EXPRESSION_LETTERS = 1_000_000
"""Longest expression; its tokens need a hundred times as much memory."""

MEMBERS = 100_000
"""Largest number of members of all families of a file; each component of a vector
counts."""

TERMS = 1_000_000
"""Largest number of terms of all sums over ranges in a file; nested sums are
multiplied."""

LARGEST_INDEX = 1e15
"""Largest magnitude of subscripts and ends of ranges, which are integers."""

GRAPH_NODES = 3_000_000
"""Largest number of operations in a model and its equations, 260 bytes each, ..."""

GRAPH_NODES_PER_BYTE = 30
"""... or this number for each byte of the file, if that is more."""

WORK = 2_500_000
"""Largest work until a model is checked and planned, in operations created (4
microseconds each); an operation that is traversed or evaluated counts as a fraction
..."""

WORK_PER_BYTE = 25
"""... plus this number for each byte of the file beyond USUAL_BYTES."""

USUAL_BYTES = 100_000
"""Size of a model file that is checked, or refused, within 10 s."""

INERTIAS = 1_000_000
"""Largest number of nonzero entries of a mass matrix: 1,000 coordinates, all
coupled."""

STEPS = 100_000_000
"""Largest number of steps of a run without another limit: hours."""

EXACT_DIGITS = 4000
"""Largest number of digits of an exact number; Python writes at most 4300."""

WRITTEN_OPERATIONS = 100_000
"""Largest number of operations of energies and constraints that are written out."""

DERIVED_OPERATIONS = 700_000
"""Largest number of operations of written-out equations: a chain of 60 rods in
angles."""

WRITTEN_DEPTH = 150
"""Deepest nesting of written-out expressions: sympy is recursive."""

WRITTEN_TERMS = 1_000
"""Largest number of terms of a sum, or factors of a product: sympy needs milliseconds
for each."""

TIDYING_PRODUCTS = 400_000
"""Largest number of products of terms for simplification; further expressions are not
simplified."""

DERIVING_SECONDS = 20.0
"""Processor time of a derivation, after which it is refused."""


def without(hint: str) -> str:
    """Return a hint on a limit, with the option `--no-limits` that removes it."""
    option = "for a file of your own `lagsim run --no-limits` removes this limit"
    return f"{hint}; {option}" if hint else option


@contextmanager
def lifted(*, really: bool = True) -> Iterator[None]:
    """Context manager: read files without limits on members, terms and operations.

    really : False to keep the limits.
    """
    names = ("MEMBERS", "TERMS", "GRAPH_NODES", "WORK", "INERTIAS")
    given = {name: globals()[name] for name in names}
    if really:
        globals().update(dict.fromkeys(names, sys.maxsize))
    try:
        yield
    finally:
        globals().update(given)


def graph_nodes(size_of_file: int) -> int:
    """Return the largest number of graph nodes of a model of this size in bytes."""
    return max(GRAPH_NODES, GRAPH_NODES_PER_BYTE * size_of_file)


def work(size_of_file: int) -> int:
    """Return the budget of operations for checking a model of this size in bytes."""
    return WORK + WORK_PER_BYTE * max(0, size_of_file - USUAL_BYTES)


def bytes_text(amount: int) -> str:
    """Return an amount of bytes in its binary unit, for messages.

    Examples
    --------
    >>> bytes_text(16 * 2**20)
    '16 MiB'
    """
    for unit, bits in (("TiB", 40), ("GiB", 30), ("MiB", 20), ("KiB", 10)):
        if amount >= 1 << bits:
            return f"{amount / (1 << bits):.3g} {unit}"
    return f"{amount} bytes"
