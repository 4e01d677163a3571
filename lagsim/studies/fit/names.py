"""Names that a fit varies: `NAME`, `NAME=a:b`, `NAME@K`; their bounds and starts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from lagsim.errors import Problems, counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

# The difference between the clocks of data and run: data time t is run time t - t0.
CLOCK = "t0"
# Ratio of the largest to the middle of the random starts of a name without bounds.
SPREAD = 2.0


class Varied(NamedTuple):
    """Name that a fit varies.

    Attributes
    ----------
    label : str
        `theta`, or `theta@2`.
    name : str
        The parameter, start value, or `t0`.
    record : int
        Number of the only record that it concerns, from 0; -1 for all records without
        a name of their own.
    low, high : float
        Bounds.
    start, scale : float
        The first value, and its size.
    """

    label: str
    name: str
    record: int = -1
    low: float = -math.inf
    high: float = math.inf
    start: float = 0.0
    scale: float = 1.0


def parse_names(texts: Sequence[str], records: int) -> list[Varied]:
    """Parse the names of a fit: `NAME`, `NAME=a:b`, `NAME@K`, `NAME@K=a:b`.

    Parameters
    ----------
    texts : sequence of str
    records : int
        Number of records.

    Raises
    ------
    InputError
        If a text is malformed, or a name is given twice.
    """
    faults, found = Problems(), list[Varied]()
    for text in texts:
        label, equals, after = (part.strip() for part in text.partition("="))
        name, at, number = (part.strip() for part in label.partition("@"))
        low, high = _bounds(after) if equals else (-math.inf, math.inf)
        if not name or not low < high:
            message = f"--vary {text}: a name, and bounds if any, are expected"
            faults.add("usage", message, hint="such as --vary k, or --vary k=1:10")
            continue
        record = -1
        if at:
            known = number.isdecimal() and 1 <= int(number) <= records
            if not known:
                message = f"--vary {label}: there is no data file {number or '``'}"
                hint = f"there {'is' if records == 1 else 'are'} "
                hint += f"{counted(records, 'data file')}, counted from 1"
                faults.add("usage", message, hint=hint)
                continue
            record = int(number) - 1
        label = f"{name}@{record + 1}" if at else name
        if any(label == one.label for one in found):
            faults.add("usage", f"--vary {label} is given twice")
        found.append(Varied(label, name, record, low, high))
    if not texts:
        faults.add("usage", "no name is varied", hint="such as --vary k")
    for one in found:
        if one.record < 0 and not concerned(one, found, records):
            text = f"--vary {one.name}: each data file has a value of its own"
            faults.add("usage", text, hint="leave out the name without a number")
    faults.refuse()
    return found


def _bounds(text: str) -> tuple[float, float]:
    """Return (a, b) of the text `a:b`; -inf or inf where a or b is missing.

    For other texts the numbers are nan.
    """
    low, colon, high = text.partition(":")
    try:
        ends = float(low or "-inf"), float(high or "inf")
    except ValueError:
        return math.nan, math.nan
    return ends if colon else (math.nan, math.nan)


def concerned(one: Varied, every: Sequence[Varied], records: int) -> list[int]:
    """Return the numbers of the records, from 0, to which a varied name applies.

    A name without a number applies to all records that have no name of their own.

    every : all varied names. records : the count of records.
    """
    if one.record >= 0:
        return [one.record]
    own = {x.record for x in every if x.name == one.name}
    return [k for k in range(records) if k not in own]


def start_within(low: float, high: float, value: float) -> float:
    """Return a value inside bounds of which one, at least, is finite.

    It is the middle, or beside the finite bound by the size of that bound or of
    `value`.
    """
    if math.isfinite(low) and math.isfinite(high):
        return 0.5 * (low + high)
    end, sign = (low, 1.0) if math.isfinite(low) else (high, -1.0)
    return end + sign * (abs(end) or abs(value) or 1.0)


def drawn_start(one: Varied, random: np.random.Generator) -> float:
    """Return a random start value of a name.

    It is between the bounds, or from half to double of the value.
    """
    part = float(random.uniform())
    if math.isfinite(one.low) and math.isfinite(one.high):
        return one.low + part * (one.high - one.low)
    value = one.start * float(SPREAD ** (2.0 * part - 1.0))
    if not one.start:
        value = one.scale * (2.0 * part - 1.0)
    return min(max(value, one.low), one.high)
