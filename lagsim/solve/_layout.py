"""Where the loops of `dense` find things in p."""

from __future__ import annotations

from lagsim.methods.parts.interface import PER_SURFACE

COUNT = 0  # n
ROWS = 1  # m
MOTION = 2  # offset of q'' (n) and lambda (m), then working memory
QUADRATURES = 3  # components of y after q and q'
AUGMENTED = 4
EXPECTED = 5  # the rank that the rows have in general
REFERENCE = 6  # the largest health so far: what is small is small against it
HEALTH = 7  # size of the last independent column, now
# 8 to 11: see methods._interface.
GAIN = 12  # of what pulls the state to the constraints
CONSTANT = 13  # what does not change in an arc: 1 what is factored of M, 2 A as well
FACTORED = 14  # what of that has been factored
RANKED = 15  # the rank that was found then
HEADER = 16


def workspace(n: int, m: int) -> int:
    """Give the length from MOTION on.

    q'', lambda, the rows' largest lengths, which rows are set aside, terms, L, Y, the
    columns' order, u, v, what `per_row` has, and the directions of the rows.
    """
    return slopes_at(n, m)


def slopes_at(n: int, m: int) -> int:
    """Give where `jacobian` has its own room, from MOTION on."""
    return directions(n, m) + 1 + n + 2 * n * min(n, m)


def jacobian_workspace(n: int, m: int) -> int:
    """Give the length from MOTION on: slopes, q'' and lambda of a column besides."""
    return slopes_at(n, m) + (n + m + 1) * 2 * n + 2 * (n + m)


def directions(n: int, m: int) -> int:
    """Give where their number lies, room (n,), z and M z of each, from MOTION on."""
    terms = n * n + n * m + n + 3 * m + 2
    return (n + 3 * m) + terms + n * n + n * m + 3 * n + 7 * m + m * m


def switching(m: int, size: int, surfaces: int, elements: int) -> int:
    """Give the length from SWITCHING on, with so many surfaces and elements of J.

    What `methods._interface` names; where the rows of J begin, and the columns of its
    elements; what `surface_rows` gives; the fields on both sides; the equations for the
    shares; a state.
    """
    if not surfaces:
        return 0
    rows = surfaces + 1 + elements + 4 * surfaces + elements
    fields = (surfaces + 1) * (size + m)
    shares = surfaces * (surfaces + 3)
    return 1 + surfaces * PER_SURFACE + rows + fields + shares + size
