"""Rows of constraints as their elimination wants them: combinations of those given.

    (1/2) of   2 dx x'' + 2 dy y'' = -2 (dx'^2 + dy'^2),

a number that all of a row has in common is taken out, and where rows agree in all
coordinates that they share (bodies that meet in one joint), each is taken from the
next: S = A M^-1 A^T then has fewer entries. Both are exact.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.sparse import fill

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.language.collected import Collected
    from lagsim.mechanics.constraints import Row

Vector = dict[int, int]  # index -> node


class Combined(NamedTuple):
    """A combination of rows.

    Attributes
    ----------
    weights : dict
        Which, and how often: index of a row -> number.
    A : dict
        Index of a coordinate -> node.
    b : int
    """

    weights: dict[int, float]
    A: dict[int, int]
    b: int


def shortest(
    x: Collected, rows: Sequence[Row], forward: Callable[[dict[int, int]], Vector]
) -> list[Combined]:
    """Give the rows that S takes fewest operations for; `forward` gives Z of one."""
    plain = shared_out(x, rows)
    others = differences(x, rows, plain)
    if others == plain:
        return plain
    return min(plain, others, key=lambda found: fill([forward(r.A) for r in found]))


def shared_out(x: Collected, rows: Sequence[Row]) -> list[Combined]:
    """Give rows without common numbers, one for each of `rows`."""
    return [_of(x, rows, {i: 1.0 / _content(x, row)}) for i, row in enumerate(rows)]


def differences(
    x: Collected, rows: Sequence[Row], found: Sequence[Combined]
) -> list[Combined]:
    """Give `found` with rows taken from others that they agree with."""
    holders: dict[tuple[int, int], int] = {}  # coordinate and entry -> row that has it
    differing: list[Combined] = []
    for k, row in enumerate(found):
        near = {holders[entry] for entry in row.A.items() if entry in holders}
        weights = row.weights
        for i in sorted(near, reverse=True):
            other = found[i]
            if all(other.A[j] == row.A[j] for j in row.A.keys() & other.A.keys()):
                weights = _less(differing[i].weights[i], other, row)
                break
        holders |= dict.fromkeys(row.A.items(), k)
        new = row if len(weights) == 1 else _of(x, rows, weights)
        differing.append(new)
    return differing


def _less(sign: float, one: Combined, other: Combined) -> dict[int, float]:
    """Give the weights of one - other, or of other - one if `sign` is negative.

    So what is left of `one` has the sign that it has in the row of its own.
    """
    one, other = (one, other) if sign > 0 else (other, one)
    return one.weights | {i: -w for i, w in other.weights.items()}


def _of(x: Collected, rows: Sequence[Row], weights: Mapping[int, float]) -> Combined:
    g = x.g
    entries: dict[int, list[tuple[int, int]]] = {}
    b = []
    for i, weight in weights.items():
        w = g.constant(weight)
        for j, node in rows[i].A.entries.items():
            entries.setdefault(j, []).append((w, node))
        b += [(w, sign, n) for sign, n in x.addends(rows[i].b)]
    A = {j: x.sum(terms) for j, terms in sorted(entries.items())}
    return Combined(
        dict(weights), {j: n for j, n in A.items() if n != g.zero}, x.sum(b)
    )


def _content(x: Collected, row: Row) -> float:
    """Give the size of the number that most entries of a row are multiples of."""
    found = Counter[float]()
    for node in row.A.entries.values():
        still, core = x.parts(node)
        if core != x.g.one:
            found[abs(_number(x, still))] += 1
    return found.most_common(1)[0][0] if found else 1.0


def _number(x: Collected, still: int) -> float:
    g = x.g
    if g.ops[still] == "neg":
        return -_number(x, g.args[still][0])
    if g.ops[still] == "mul":
        still = g.args[still][0]
    value = g.value(still)
    return value or 1.0
