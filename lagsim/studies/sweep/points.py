"""Points of a sweep that are no grid: rows of a table, and random samples.

A sample is the same on every machine. The 53 bits of each draw are those of Philox, a
counter-based generator whose stream numpy promises not to change (J. K. Salmon et al.,
Parallel random numbers, 2011); its key is the seed and the place of the name, so that a
name that is added does not change the draws of those before it. What a distribution
makes of them takes sums, products and roots, which IEEE 754 rounds alike everywhere,
and a logarithm of lagsim's own.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
import re
from typing import TYPE_CHECKING

import numpy as np

from lagsim import files
from lagsim.errors import InputError, Problem, Problems, unusable
from lagsim.native.elementary import log
from lagsim.studies.sweep.runs import Axis, Grid, grid_of, refuse_many

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model

EXAMPLE = "such as --sample K=normal(25.6, 0.5) --sample theta=uniform(0, 1) -N 500"
_DRAWN = re.compile(r"(normal|uniform)\s*\((.*),(.*)\)", re.DOTALL)


def of_file(model: Model, path: Path) -> Grid:
    """Give the points of a CSV file: a column for each name, a row for each run.

    Raises
    ------
    InputError
        With the line of each fault.
    """
    try:
        text = files.content(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", "") or "it is no text in UTF-8"
        raise unusable("bad-points", f"{path}: {why}") from None
    table = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    lines = [(table.line_num, [x.strip() for x in row]) for row in table]
    (first, names), *rows = [(k, row) for k, row in lines if any(row)] or [(1, [])]
    faults = []
    if len({*names}) < len(names) or not all(names):
        faults.append((first, "the header has an empty name, or one twice"))
    if not rows:
        faults.append((first, "no points: a header and a row for each run expected"))
    points = []
    for line, row in rows:
        if len(row) != len(names):
            faults.append((line, f"{len(row)} values for {len(names)} names"))
            continue
        points.append([*map(_number, row)])
        faults += [
            (line, f"`{cell}` of {name} is no finite number")
            for name, cell, x in zip(names, row, points[-1], strict=True)
            if not math.isfinite(x)
        ]
    if faults:
        raise InputError(
            [Problem("bad-points", f"{path}:{line}: {text}") for line, text in faults]
        )
    refuse_many(len(rows))
    given = dict(zip(names, zip(*points, strict=True), strict=True))
    try:
        return grid_of(model, given, together=True)
    except InputError as error:
        where = f"{path}:{first}: "
        raise InputError(
            [x if x.place else x._replace(text=where + x.text) for x in error.problems]
        ) from None


def _number(cell: str) -> float:
    """Give the number of a cell; nan where it is none."""
    with contextlib.suppress(ValueError):
        return math.nan if "_" in cell else float(cell)
    return math.nan


def drawn(
    model: Model, given: Iterable[tuple[str, str]], runs: int, seed: int = 0
) -> Grid:
    """Draw so many values of each name, of the distribution that it is given with.

    Raises
    ------
    InputError
    """
    problems, values = Problems(), dict[str, list[float | str]]()
    distributions = {}
    refuse_many(runs)
    for place, (name, text) in enumerate(given):
        if name in values:
            problems.add("usage", f"{name} is given twice", hint=EXAMPLE)
        distributions[name] = text
        with problems.gathered():
            uniform = _uniform(seed, place, runs)
            values[name] = [*_distributed(model, name, text, uniform).tolist()]
    problems.refuse()
    grid = grid_of(model, values, together=True)
    axes = (axis._replace(drawn=distributions[axis.name]) for axis in grid.axes)
    return grid._replace(axes=tuple(axes), seed=seed)


def _uniform(seed: int, place: int, count: int) -> Floats:
    """Draw from 0 to 1, neither of them (count,)."""
    raw = np.random.Philox(key=seed + (place << 64)).random_raw(count)
    return np.asarray(((raw >> np.uint64(11)) + 0.5) * 2.0**-53)


def _distributed(model: Model, name: str, text: str, uniform: Floats) -> Floats:
    """Turn uniform draws into those of a distribution."""
    found = _DRAWN.fullmatch(text)
    if found is None:
        wrong = f"{name}={text}: normal(mean, deviation) or uniform(low, high) expected"
        raise unusable("usage", wrong, hint=EXAMPLE)
    a, b = Axis.of(model, name, [part.strip() for part in found.groups()[1:]]).values
    normal = found[1] == "normal"
    if not (b > 0.0 if normal else a < b):
        rule = "the deviation is more than 0" if normal else "low is less than high"
        raise unusable("usage", f"{name}={text}: {rule}", hint=EXAMPLE)
    return a + b * _normal(uniform) if normal else a + (b - a) * uniform


# Rational functions of the inverse normal distribution, to 1e-16: numerator, then
# denominator, highest power first, in the middle, at its sides, and far out.
# Source: M. J. Wichura, Algorithm AS 241, Applied Statistics 37 (1988), 477.
_MIDDLE = (
    (2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4,
     4.5921953931549871457e4, 1.3731693765509461125e4, 1.9715909503065514427e3,
     1.3314166789178437745e2, 3.3871328727963666080e0),
    (5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4,
     2.1213794301586595867e4, 5.3941960214247511077e3, 6.8718700749205790830e2,
     4.2313330701600911252e1, 1.0),
)  # fmt: skip
_SIDES = (
    (7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1,
     1.27045825245236838258e0, 3.64784832476320460504e0, 5.76949722146069140550e0,
     4.63033784615654529590e0, 1.42343711074968357734e0),
    (1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2,
     1.48103976427480074590e-1, 6.89767334985100004550e-1, 1.67638483018380384940e0,
     2.05319162663775882187e0, 1.0),
)  # fmt: skip
_FAR = (
    (2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3,
     2.65321895265761230930e-2, 2.96560571828504891230e-1, 1.78482653991729133580e0,
     5.46378491116411436990e0, 6.65790464350110377720e0),
    (2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5,
     7.86869131145613259100e-4, 1.48753612908506148525e-2, 1.36929880922735805310e-1,
     5.99832206555887937690e-1, 1.0),
)  # fmt: skip


def _normal(uniform: Floats) -> Floats:
    """Turn uniform draws into normal ones of mean 0 and deviation 1."""
    q = uniform - 0.5
    r = 0.180625 - q * q
    found = q * np.polyval(_MIDDLE[0], r) / np.polyval(_MIDDLE[1], r)
    for k in np.flatnonzero(r < 0.0).tolist():
        p = float(min(uniform[k], 1.0 - uniform[k]))
        root = math.sqrt(-log(p))
        (above, below), shift = (_SIDES, 1.6) if root <= 5.0 else (_FAR, 5.0)
        size = np.polyval(above, root - shift) / np.polyval(below, root - shift)
        found[k] = math.copysign(size, q[k])
    return np.asarray(found)
