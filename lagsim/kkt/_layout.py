"""Where the loops of `dense` find things in p."""

COUNT = 0  # n
ROWS = 1  # m
MOTION = 2  # offset of q'' (n) and lambda (m), then working memory
QUADRATURES = 3  # components of y after q and q'
AUGMENTED = 4
EXPECTED = 5  # the rank that the rows have in general
REFERENCE = 6  # the largest health so far: what is small is small against it
HEALTH = 7  # size of the last independent column, now
# 8 and 9: LEAST_HEALTH and WEAK, see methods._interface.
GAIN = 10  # of what pulls the state to the constraints
CONSTANT = (
    11  # what does not change within an arc: 1 what is factored of M, 2 A as well
)
FACTORED = 12  # what of that has been factored
RANKED = 13  # the rank that was found then
HEADER = 14


def workspace(n: int, m: int) -> int:
    """Give the length from MOTION on.

    q'', lambda, the rows' largest lengths, which rows are set aside, terms, L, Y, u, v,
    what `per_row` has, and the weakest direction.
    """
    return weak_direction(n, m) + 3 * n


def weak_direction(n: int, m: int) -> int:
    """Give where z, M z and room for one more (n,) lie, from MOTION on."""
    terms = n * n + n * m + n + 3 * m + 2
    return (n + 3 * m) + terms + n * n + n * m + 2 * n + 7 * m + m * m
