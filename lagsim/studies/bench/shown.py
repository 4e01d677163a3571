"""Which curves a chart shows: at most a dozen, those that matter, cheapest first."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.studies.bench.scipy_solvers import PREFIX

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

MOST = 12
# Of them at most so many of scipy's, where there are others.
OF_SCIPY = 2
# A point that is further off than this costs what it does for no digits.
AN_ANSWER = 0.1

# Rows that leave the constraints: no answer that `auto` might give.
DRIFT = "drift"

# A row of work_precision.json.
Row = dict[str, Any]
# Method and formulation.
Key = tuple[str, str]


class Shown(NamedTuple):
    """Curves by method and formulation; of those left out, how many times costlier."""

    curves: dict[Key, list[Row]]
    left_out: dict[Key, float]


def shown(rows: Sequence[Row], worst: float) -> Shown:
    """Choose among the rows of work_precision.json that have an error up to `worst`.

    First come the curves that `auto` takes, then those on the front, then of each
    method the formulation that comes closest to it, two of scipy's among them, then
    other formulations; of them first those that stay on the constraints. They are given
    cheapest first.
    """
    curves: dict[Key, list[Row]] = defaultdict(list)
    for row in rows:
        if row["error"] is not None and row["error"] <= worst:
            curves[row["method"], row["formulation"]].append(row)
    times = {key: _times(entries, rows) for key, entries in curves.items()}
    ranked = sorted(times, key=lambda key: times[key])
    taken = list(_in_turn(ranked, curves))[:MOST]
    return Shown(
        {key: curves[key] for key in ranked if key in taken},
        {key: times[key] for key in ranked if key not in taken},
    )


def _in_turn(ranked: list[Key], curves: Mapping[Key, list[Row]]) -> Iterator[Key]:
    """Give curves by how much a chart would miss them."""
    best = [key for key in ranked if any(row["chosen"] for row in curves[key])]
    ranked = sorted(ranked, key=lambda key: key[1] == DRIFT)
    best += [
        key
        for key in ranked
        if key not in best and any(row["front_seconds"] for row in curves[key])
    ]
    first: list[Key] = []
    for key in ranked:
        if key not in best and key[0] not in {method for method, _ in (*best, *first)}:
            first.append(key)
    scipy = [key for key in first if key[0].startswith(PREFIX)]
    own = [key for key in first if key not in scipy]
    room = max(0, MOST - len(best) - min(len(scipy), OF_SCIPY))
    yield from (*best, *own[:room], *scipy[:OF_SCIPY], *own[room:])
    later = [key for key in ranked if key not in {*best, *first}]
    yield from (*later, *scipy[OF_SCIPY:])


def _times(entries: Sequence[Row], rows: Sequence[Row]) -> float:
    """Give how many times a curve costs what the front does, on the average."""
    front = [(row["error"], row["seconds"]) for row in rows if row["front_seconds"]]
    found = []
    for row in entries:
        beside = [cost for error, cost in front if error <= row["error"]]
        if beside and row["error"] <= AN_ANSWER:
            found.append(math.log(row["seconds"] / min(beside)))
    return math.exp(sum(found) / len(found)) if found else math.inf
