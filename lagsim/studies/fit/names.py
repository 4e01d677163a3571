"""Names that a fit varies: `NAME`, `NAME=a:b`, `NAME@K`; their bounds and starts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from lagsim.codes.known import USAGE
from lagsim.errors import Problems, counted

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    import numpy as np

    from lagsim.model.model import Model

# The difference between the clocks of data and run: data time t is run time t - t0.
CLOCK = "t0"
# Ratio of the largest to the middle of the random starts of a name without bounds.
SPREAD = 2.0
# Ratio of the ends to the start of a name in fits to parts of the records.
NEAR = 20.0


class Varied(NamedTuple):
    """Name that a fit varies.

    Attributes
    ----------
    label : str
        `theta`, or `theta@2`.
    name : str
        The parameter, start value, or `t0`.
    record : int
        Number of the only record to which the name applies, from 0; -1 for all records
        that have no name or value of their own.
    low, high : float
        Bounds.
    start, scale : float
        The first value of the name, and the size of its values.
    """

    label: str
    name: str
    record: int = -1
    low: float = -math.inf
    high: float = math.inf
    start: float = 0.0
    scale: float = 1.0


def own_values(
    model: Model, texts: Mapping[str, str], records: int
) -> list[dict[str, float]]:
    """Return, for each record, the values that apply to this record only, by name.

    Parameters
    ----------
    model : Model
    texts : mapping of str to str
        Expressions by `NAME@K`; t0@K is the difference of the clocks of a record.
    records : int
        Number of records.

    Raises
    ------
    InputError
        If there is no such record, name or value.
    """
    faults, found = Problems(), [dict[str, str]() for _ in range(records)]
    values: list[dict[str, float]] = []
    for label, text in texts.items():
        name, _, number = (part.strip() for part in label.partition("@"))
        if _record_exists(f"--set {label}", number, records, faults):
            found[int(number) - 1][name] = text
    for own in found:
        values.append({})
        clock = None if CLOCK in model.parameter_values else own.pop(CLOCK, None)
        with faults.gathered():
            bound = model.bind(**own)
            starts = {x.name: x.value for x in bound.initial}
            values[-1] = {x: (bound.parameter_values | starts)[x] for x in own}
            if clock is not None:
                values[-1][CLOCK] = _clock(clock)
                if not math.isfinite(values[-1][CLOCK]):
                    faults.add(USAGE, f"--set {CLOCK}@K={clock}: a number is expected")
    faults.refuse()
    return values


def _clock(text: str) -> float:
    """Return the difference of clocks in a text, in units of time, or nan."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _record_exists(label: str, number: str, records: int, faults: Problems) -> bool:
    """Whether a record with a number exists; add a fault if not.

    label : for the message.
    number : text of the number, from 1.
    records : how many.
    """
    if number.isdecimal() and 1 <= int(number) <= records:
        return True
    message = f"{label}: there is no data file {number or '``'}"
    hint = f"there {'is' if records == 1 else 'are'} "
    hint += f"{counted(records, 'data file')}, counted from 1"
    faults.add(USAGE, message, hint=hint)
    return False


def parse_names(texts: Sequence[str], own: Sequence[Collection[str]]) -> list[Varied]:
    """Parse the names of a fit: `NAME`, `NAME=a:b`, `NAME@K`, `NAME@K=a:b`.

    Parameters
    ----------
    texts : sequence of str
    own : sequence of collection of str
        For each record, the names with a value for this record only.

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
            faults.add(USAGE, message, hint="such as --vary k, or --vary k=1:10")
            continue
        if at and not _record_exists(f"--vary {label}", number, len(own), faults):
            continue
        record = int(number) - 1 if at else -1
        label = f"{name}@{record + 1}" if at else name
        if any(label == one.label for one in found):
            faults.add(USAGE, f"--vary {label} is given twice")
        found.append(Varied(label, name, record, low, high))
    if not texts:
        faults.add(USAGE, "no name is varied", hint="such as --vary k")
    for one in found:
        if not concerned(one, found, own):
            text = f"--vary {one.name}: each data file has a value of its own"
            faults.add(USAGE, text, hint="leave out the name without a number")
    faults.refuse()
    return found


def _bounds(text: str) -> tuple[float, float]:
    """Return (a, b) of the text `a:b`; -inf or inf where a or b is missing.

    Both are nan for any other text.
    """
    low, colon, high = text.partition(":")
    try:
        ends = float(low or "-inf"), float(high or "inf")
    except ValueError:
        return math.nan, math.nan
    return ends if colon else (math.nan, math.nan)


def concerned(
    one: Varied, every: Sequence[Varied], own: Sequence[Collection[str]]
) -> list[int]:
    """Return the numbers of the records, from 0, to which a varied name applies.

    A name without a number applies to all records that have neither a varied name nor a
    value of their own.

    every : all varied names.
    own : for each record, the names with a value for this record only.
    """
    if one.record >= 0:
        return [one.record]
    varied = {x.record for x in every if x.name == one.name}
    return [
        k for k, names in enumerate(own) if k not in varied and one.name not in names
    ]


def start_within(low: float, high: float, value: float) -> float:
    """Return a value between `low` and `high`, of which at least one is finite.

    It is the middle of two bounds. With one finite bound its distance from the bound is
    the size of the bound or of `value`.
    """
    if math.isfinite(low) and math.isfinite(high):
        return 0.5 * (low + high)
    end, sign = (low, 1.0) if math.isfinite(low) else (high, -1.0)
    return end + sign * (abs(end) or abs(value) or 1.0)


def near_bounds(one: Varied) -> tuple[float, float]:
    """Return bounds of a varied name within a factor NEAR of its start value.

    A name with the start value 0 keeps its bounds.
    """
    ends = sorted((one.start / NEAR, one.start * NEAR))
    if not one.start:
        return one.low, one.high
    return max(one.low, ends[0]), min(one.high, ends[1])


def drawn_start(one: Varied, random: np.random.Generator) -> float:
    """Return a random start value of a varied name, for a fit from another start.

    It is between the bounds. Where one of them is infinite, it differs from the start
    value by a factor of at most SPREAD, or from a start value 0 by at most the scale.
    """
    part = float(random.uniform())
    if math.isfinite(one.low) and math.isfinite(one.high):
        return one.low + part * (one.high - one.low)
    value = one.start * float(SPREAD ** (2.0 * part - 1.0))
    if not one.start:
        value = one.scale * (2.0 * part - 1.0)
    return min(max(value, one.low), one.high)
