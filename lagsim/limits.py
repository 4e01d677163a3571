"""Budgets: the largest input and work that lagsim accepts from a file.

Each limit is far beyond a file written by hand, and bounds memory and time: a file of
100 kB is checked in 10 s and 1 GB, and derived, or refused, within 20 s. Larger input
is refused with a message that names the limit.
"""

from __future__ import annotations

MODEL_BYTES = 16 << 20
"""Of a model file: 10^5 members, a line of 160 letters for each."""

DOCUMENT_BYTES = 256 << 20
"""Of a record, a golden's or a journal, which are read as a whole."""

TABLE_BYTES = 4 << 30
"""Of a table of results; what is read of one takes as much memory."""

TABLE_NUMBERS = 1_000_000
"""Coefficients of a table of a model: of a cubic curve four for each point."""

NODES = 1_000_000
"""Scalars and collections of YAML in a model file, half a kilobyte each."""

EXPRESSION_LETTERS = 1_000_000
"""Of one expression; its tokens take a hundred times as much."""

MEMBERS = 100_000
"""Of all families of a file: numbers, so that a vector counts with its components."""

TERMS = 1_000_000
"""Of all sums over ranges in a file, those in one another multiplied."""

LARGEST_INDEX = 1e15
"""Of subscripts and ends of ranges, which are whole numbers."""

GRAPH_NODES = 3_000_000
"""Operations in a model and its equations, 260 bytes each, ..."""

GRAPH_NODES_PER_BYTE = 30
"""... or this many for each byte of the file, where that is more."""

WORK = 2_500_000
"""Operations made until a model is checked and planned, and shares of them for what is
looked through or evaluated: 4 microseconds each, ..."""

WORK_PER_BYTE = 25
"""... and so many for each byte of the file beyond USUAL_BYTES."""

USUAL_BYTES = 100_000
"""Of a model file, which is checked within 10 s or refused."""

INERTIAS = 1_000_000
"""Of a mass matrix, entries that are not 0: those of 1,000 coordinates, all coupled."""

STEPS = 100_000_000
"""Of a run, unless it is told otherwise: hours."""

EXACT_DIGITS = 4000
"""Of a number that is written out exactly; Python itself writes no more than 4300."""

WRITTEN_OPERATIONS = 100_000
"""Of energies and constraints that are written out; nobody reads as many."""

DERIVED_OPERATIONS = 700_000
"""Of the equations that are written out: those of a chain of 60 rods in angles."""

WRITTEN_DEPTH = 150
"""Of what is written out: sympy recurses into it."""

WRITTEN_TERMS = 1_000
"""Of a sum, and factors of a product: sympy takes milliseconds for each of them."""

TIDYING_PRODUCTS = 400_000
"""Of terms, for making equations short; later they are written as they come."""

DERIVING_SECONDS = 20.0
"""For all of a derivation; what is not done by then is refused."""


def graph_nodes(size_of_file: int) -> int:
    """Return the largest number of operations of a model of this size in bytes."""
    return max(GRAPH_NODES, GRAPH_NODES_PER_BYTE * size_of_file)


def work(size_of_file: int) -> int:
    """Return the largest work of checking a model of this size in bytes."""
    return WORK + WORK_PER_BYTE * max(0, size_of_file - USUAL_BYTES)


def size(amount: int) -> str:
    """Return an amount of bytes in its binary unit, for messages.

    Examples
    --------
    >>> size(16 * 2**20)
    '16 MiB'
    """
    for unit, bits in (("TiB", 40), ("GiB", 30), ("MiB", 20), ("KiB", 10)):
        if amount >= 1 << bits:
            return f"{amount / (1 << bits):.3g} {unit}"
    return f"{amount} bytes"
