"""Golden of a motion: reference rows, bounds of their errors, horizon, invariants.

A later run of the model may differ from the golden by as much as the variants of the
golden run do, see `motions`. Near a jump, of a velocity at an impact or of a force at a
switch, a row can lie on either side of the jump, and may differ by the jump as well.

`<name>.csv` holds the rows of a golden, and `<name>.json` everything else.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import orjson

from lagsim import files
from lagsim.codes.known import BAD_GOLDEN, NO_GOLDEN, NOT_FINITE
from lagsim.errors import InputError, Place, Problems, several, unusable
from lagsim.language.columns import FORCE, RESIDUAL, base, is_of_kind
from lagsim.language.evaluate import evaluate_rows, evaluate_with_error
from lagsim.language.names import rated
from lagsim.mechanics.pieces import whole
from lagsim.mechanics.reduction import MOMENTUM, conserved
from lagsim.methods import method as method_named
from lagsim.model.model import DEFAULT_RTOL, Model
from lagsim.outputs.manifest import encode, versions
from lagsim.outputs.results import open_results
from lagsim.outputs.units import of_table
from lagsim.program.output_row import stated_units
from lagsim.run.error import HIGHER, could_push
from lagsim.studies.comparison import (
    ComparedColumn,
    Deviation,
    Verdict,
    kind,
    scales,
    sorted_deviations,
)
from lagsim.studies.motions import (
    SampledMotion,
    at_impacts,
    before_impacts,
    column_jumps,
    kept_rows,
    motion_of,
    variants,
)
from lagsim.studies.tables import read_table
from lagsim.studies.trial import Compiled
from lagsim.tolerances import SAME_ROW, UNIT_ROUNDOFF, VALUE_ROUNDOFF
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.notes import Caution
    from lagsim.run.session import Case

    Document = dict[str, Any]

# The numbers of rows that a golden stores, at most and at least (as far as the run has
# rows before the horizon): one of `stride` rows is stored.
MOST_ROWS = 200
LEAST_ROWS = 50
MOST_CELLS = 2400

BALANCE = "energy - work"


def invariants(equations: Equations, motion: SampledMotion) -> dict[str, Floats]:
    """Return the conserved quantities of a motion by name, each of shape (rows,).

    These are the energy (less the work), the residual of each constraint that always
    holds, and the momentum of each coordinate that occurs neither in the Lagrangian nor
    in a force nor in a constraint. Of a quantity that must be >= 0, such as a gap, only
    the negative part is returned.
    """
    column = dict(zip(motion.columns, motion.rows.T, strict=True))
    energy, work = column["energy"], column.get("work")
    found = {"energy": energy} if work is None else {BALANCE: energy - work}
    laws = {RESIDUAL.of(whole(law.row.name)): law for law in equations.laws}
    for name, values in column.items():
        law = laws.get(name)
        if is_of_kind(name, RESIDUAL) and law is None:
            found[name] = values
        elif law and law.one_sided and law.when is None:
            found[name] = np.minimum(values, 0.0)
    if free := conserved(equations):
        known = equations.model.parameter_values | column
        nodes = [equations.momenta[k] for k in free]
        values = evaluate_rows(equations.graph, nodes, known, len(motion.rows))
        names = [MOMENTUM + equations.q[k] for k in free]
        found |= dict(zip(names, values, strict=True))
    return found


# Bound of a column relative to the largest difference of the variants. The variants are
# samples of runs that should pass: with other steps, at up to a hundred times the
# tolerance, and with rounding errors, which another processor makes in every step and
# not only in the first. Such a run may exceed the largest difference several times over
# (shipped models by 3.3 at 85 times the tolerance), but not tenfold.
SAFETY = 10.0
# Values are rounded to a tenth of their bound, or better: a twentieth, added to it.
DIGITS = 0.1
# The horizon is the first time at which the bound of a coordinate or a velocity exceeds
# this part of its scale: past it a comparison shows little.
LOST = 1 / 3
# Bounds increase with time, except near jumps. Each increase is by this factor at
# least, so that there are few.
ROOM = 1.5
# A difference that exceeds that of both neighbouring rows by this factor is a jump.
SPIKE = 1e3
# Columns that are kept of long tables.
MOST_COLUMNS = 60
LEAVE_OUT = (
    "without a number no run can be compared with it: leave it out of "
    "`output.columns`, or give it a value there by `if`"
)


class Invariant(NamedTuple):
    """Value of a conserved quantity, and the bound of deviations from the value."""

    value: float
    bound: float


@dataclass(frozen=True)
class Golden:
    """Reference motion with bounds of its error, up to its horizon.

    Attributes
    ----------
    columns : tuple of str
        Names of the stored columns; the first is the time.
    rows : ndarray, shape (k, columns)
    steps : dict of str to list
        For each column a list of (time, bound): each bound holds from its time until
        the time of the next.
    horizon : float or None
        The time past which only invariants are compared.
    invariants : dict of str to Invariant
    stride : int
        One of `stride` rows of the run is stored.
    about : mapping
        Data on the run from which the golden was made, as the JSON file stores these.
    """

    columns: tuple[str, ...]
    rows: Floats
    steps: dict[str, list[tuple[float, float]]]
    horizon: float | None
    invariants: dict[str, Invariant]
    stride: int
    about: Document = field(default_factory=dict)

    def bounds(self, column: str) -> Floats:
        """Return the bounds of a column, shape (k,)."""
        times, bounds = np.array(self.steps[column]).T
        place = np.searchsorted(times, self.rows[:, 0], side="right") - 1
        return np.asarray(bounds[np.maximum(place, 0)])


def new_golden(
    case: Case, compiled: Compiled | None = None
) -> tuple[Golden, SampledMotion]:
    """Return the golden of a case, and the motion from which it was made.

    Parameters
    ----------
    compiled : Compiled, optional
        Compiled functions of the model, which are used if they fit the case.
    """
    spacing, compiled = case.settings.output_step, compiled or Compiled()
    stride = _stride(
        int(case.settings.duration / spacing) + 2, compiled.session(case).columns.table
    )
    while True:
        base = motion_of(case, stride, compiled)
        if stride > 1 and len(base.rows) < LEAST_ROWS:  # the run ended early
            stride = _stride(base.count, len(base.columns))
            base = motion_of(case, stride, compiled)
        golden = _measured(case, base, stride, compiled)
        if stride == 1 or len(golden.rows) >= LEAST_ROWS:
            return golden, base
        # The horizon is early: closer rows before it.
        stride = max(1, len(golden.rows) * stride // (LEAST_ROWS + 2))


def _measured(
    case: Case, base: SampledMotion, stride: int, compiled: Compiled
) -> Golden:
    spacing = case.settings.output_step
    others = [*variants(case, base, stride, compiled)]
    periodic = [x.name for x in case.model.events if x.at is None]
    near = kept_rows(base, others, case.settings, periodic)
    rows, wide = base.rows[near.rows], column_jumps(case, base, near, compiled)
    same_columns = [x for x in others if x.columns == base.columns]
    with np.errstate(invalid="ignore"):
        same = SAME_ROW * spacing
        found = (other.at(rows[:, 0], same, ends=True) for other in same_columns)
        differences = (np.abs(other - rows) for other in found)
        largest = functools.reduce(np.fmax, differences, np.zeros_like(rows))
    floors = _floors(case, base, rows)
    sizes = scales(base.columns, rows.T, stated_units(case.equations))
    rest = _rest(case, base, rows)
    floors, sizes = floors + rest.rounding, np.maximum(sizes, rest.sizes)
    # An impact that differs between variants is not compared: after it, where rounding
    # errors decide whether a slip sticks, impacts have other forms.
    apart = floors + SAFETY * largest
    odd = (apart > LOST * sizes)[:, sizes > 0.0].any(axis=1) & at_impacts(rows[:, 0])
    first = before_impacts(rows[:, 0])
    odd[1:] |= odd[:-1] & first[:-1]
    odd[:-1] |= odd[1:] & first[:-1]
    rows, wide, floors, largest = (x[~odd] for x in (rows, wide, floors, largest))
    bounds = _bounds_of(rows[:, 0], floors, largest, wide)
    moving = [base.columns.index(name) for name in case.equations.state]
    lost = np.flatnonzero((bounds.steady > LOST * sizes)[:, moving].any(axis=1))
    horizon = float(rows[lost[0], 0]) if len(lost) else None
    names = _kept(base.columns, case)
    chosen = [base.columns.index(name) for name in names]
    end = lost[0] if len(lost) else len(rows)
    rows = rows[:end, chosen]
    steady, wide = (x[:end, chosen] for x in bounds)
    _check_finite(names, rows, steady + wide)
    steps = {
        name: _steps(rows[:, 0], *own)
        for name, *own in zip(names, steady.T, wide.T, strict=True)
    }
    kept = _bounded(case, base, same_columns)
    golden = Golden(names, rows, steps, horizon, kept, stride)
    return replace(golden, about=_about(case, golden, base))


class _Bounds(NamedTuple):
    """Bounds of errors in each row, as the sum of two arrays, shape (rows, columns).

    `steady` never decreases with time. `wide` is 0 except in single rows, near events.
    """

    steady: Floats
    wide: Floats


def _bounds_of(t: Floats, floors: Floats, largest: Floats, wide: Floats) -> _Bounds:
    """Return the bounds of errors in rows at the times t (k,).

    Parameters
    ----------
    floors, largest, wide : ndarray, shape (k, columns)
        Least bounds, largest differences of the variants, and jumps near each row.
    """
    bounds = floors + SAFETY * largest
    around = np.maximum(np.roll(bounds, 1, axis=0), np.roll(bounds, -1, axis=0))
    around[[0, -1]] = np.inf
    around[at_impacts(t)] = np.inf
    jumping = (wide > floors) | (bounds > SPIKE * around)
    steady = np.maximum.accumulate(np.where(jumping, floors, bounds), axis=0)
    # For a variant on the other side of a jump the difference is known.
    wide = np.where(jumping, np.maximum(wide, largest), 0.0)
    spared = 1.0 + DIGITS / 2
    return _Bounds(steady * spared, wide * spared)


def _stride(rows: int, columns: int) -> int:
    most = min(MOST_ROWS, max(LEAST_ROWS, MOST_CELLS // min(columns, MOST_COLUMNS)))
    return max(1, min(-(-rows // most), (rows - 1) // LEAST_ROWS))


def _kept(columns: Sequence[str], case: Case) -> tuple[str, ...]:
    """Return the names of the columns that a golden stores.

    At most MOST_COLUMNS are selected, evenly spaced. Accelerations, constraint forces
    and residuals are stored only if fewer other columns exist.

    columns : the columns of the table.
    """
    rates = case.equations.accelerations
    rest = [x for x in columns if x in rates or is_of_kind(x, FORCE, RESIDUAL)]
    first = [x for x in columns if x not in rest]
    chosen = set[str]()
    for names, most in ((first, MOST_COLUMNS), (rest, MOST_COLUMNS - len(first))):
        if names and most > 0:
            chosen |= {*names[:: -(-len(names) // most)]}
    return tuple(name for name in columns if name in chosen)


def _floors(case: Case, base: SampledMotion, rows: Floats) -> Floats:
    """Return the least bound of the error in each cell: tolerance plus rounding.

    base : the motion.
    rows : (k, columns), like the result.
    """
    rtol = base.plan.rtol or DEFAULT_RTOL
    of = stated_units(case.equations)
    alone = scales(base.columns, rows.T, of)
    sizes = alone.copy()
    for k, name in enumerate(base.columns):
        sizes[k] = base.scales.get(name, sizes[k])
        # A definition can be the difference of two others, and consist of errors only.
        if of.get(name) and kind(name, base.columns) == "definition":
            same_unit = [i for i, c in enumerate(base.columns) if of.get(c) == of[name]]
            sizes[k] = np.max(alone[same_unit])
    floors = rtol * sizes + VALUE_ROUNDOFF * np.max(np.abs(rows), axis=0)
    when, floors[0] = floors[0], 0.0
    floors = floors + _roundings(case, base, rows)
    floors[at_impacts(rows[:, 0]), 0] = when  # of an impact that is compared
    return np.asarray(floors)


class _Rest(NamedTuple):
    """Motion of coordinates at rest: sizes, and rounding errors, of each column.

    Both have the shape (columns,), with 0 for the columns of all other coordinates.
    """

    sizes: Floats
    rounding: Floats


def _rest(case: Case, base: SampledMotion, rows: Floats) -> _Rest:
    """Return sizes and rounding errors of the motion of coordinates at rest.

    The size is the distance by which each force alone would move the coordinate. A
    coordinate rests if it moves no farther than the rounding of its forces moves it;
    the range of such a motion is no scale of errors.

    base : the motion.
    rows : (k, columns), the rows of a run.
    """
    e, n = case.equations, len(case.equations.q)
    sizes, rounding = np.zeros((2, rows.shape[1]))
    columns = [base.columns.index(name) for name in ("t", *e.state)]
    names = [FORCE.of(q) for q in e.q]
    forces = [base.columns.index(x) for x in names if x in base.columns]
    forces_of = np.max(np.abs(rows[:, forces]), axis=0) if forces else None
    motion, span = rows[:, columns], float(np.ptp(rows[:, 0]))
    if not span > 0.0:
        return _Rest(sizes, rounding)
    found = could_push(e, motion, range(n), span, forces_of)
    rests = np.ptp(motion[:, 1 : 1 + n], axis=0) <= HIGHER * found.displacement
    reach, displacements = np.where(rests, (found.reach, found.displacement), 0.0)
    sizes[columns[1 : 1 + n]], rounding[columns[1 : 1 + n]] = reach, displacements
    speeds = columns[1 + n : 1 + 2 * n]
    sizes[speeds], rounding[speeds] = (
        reach / span,
        displacements / case.settings.output_step,
    )
    for k, name in enumerate(base.columns):
        if kind(name, base.columns) == "energy":
            rounding[k] = float(displacements @ found.forces)
    return _Rest(sizes, rounding)


def _check_finite(names: Sequence[str], rows: Floats, bounds: Floats) -> None:
    """Raise an InputError if columns have values or bounds that are not finite.

    names : the names of the columns.
    rows, bounds : (k, columns).
    """
    problems = Problems()
    for name, *both in zip(names, rows.T, bounds.T, strict=True):
        # Without a value in a row, no bound may have one.
        wrong = next((~ok for x in both if not (ok := np.isfinite(x)).all()), None)
        if wrong is not None:
            t = rows[np.argmax(wrong), 0]
            text = f"`{name}` has no finite value, or no bound, at t = {t:.6g}"
            problems.add(NOT_FINITE, text, hint=LEAVE_OUT)
    problems.refuse()


def _roundings(case: Case, base: SampledMotion, rows: Floats) -> Floats:
    """Return the rounding errors of the definitions in each row, (k, columns).

    They are 0 for other columns.

    rows : (k, columns), the rows of a run.
    """
    model = case.model
    shown = [d for d in model.definitions if d.name in base.columns]
    found = np.zeros_like(rows)
    places = [base.columns.index(d.name) for d in shown]
    eps = 2.0 * UNIT_ROUNDOFF
    parameters = model.parameter_values
    nodes = [d.node for d in shown]
    for k, row in enumerate(rows.tolist() if shown else ()):
        values = parameters | dict(zip(base.columns, row, strict=True))
        rounded = {name: (x, eps * abs(x)) for name, x in values.items()}
        errors = evaluate_with_error(model.graph, nodes, rounded)
        found[k, places] = [error for _, error in errors]
    return np.nan_to_num(found, nan=0.0, posinf=0.0)


def _steps(t: Floats, steady: Floats, wide: Floats) -> list[tuple[float, float]]:
    """Return the bounds of a column as a step function: a short list of (time, bound).

    Parameters
    ----------
    t : ndarray, shape (k,)
        Times of the rows.
    steady, wide : ndarray, shape (k,)
        Bounds that never decrease, and additions in single rows.
    """
    found: list[tuple[float, float]] = []
    level = -1.0
    lists = (x.tolist() for x in (t, steady, wide))
    for time, bound, more in zip(*lists, strict=True):
        if bound > level:
            level = rounded_up(ROOM * bound if found else bound)
        own = rounded_up(level + more) if more else level
        if not found or own != found[-1][1]:
            found.append((time, own))
    return found


def rounded_up(x: float) -> float:
    """Return the number rounded up to two significant digits.

    Examples
    --------
    >>> rounded_up(0.001234), rounded_up(98.7), rounded_up(0.0)
    (0.0013, 99.0, 0.0)
    """
    if not 0.0 < x < np.inf:
        return float(x)
    unit = 10.0 ** (np.floor(np.log10(x)) - 1)
    return float(f"{np.ceil(x / unit) * unit:.1e}")


def _bounded(
    case: Case, base: SampledMotion, others: Sequence[SampledMotion]
) -> dict[str, Invariant]:
    """Return the conserved quantities by name, with bounds of their deviations.

    base : the motion of the golden run.
    others : the motions of its variants, which determine the bounds.
    """
    found, rtol = {}, base.plan.rtol or DEFAULT_RTOL
    kept, *_ = apart = [invariants(case.equations, x) for x in (base, *others)]
    momenta = [np.max(np.abs(v)) for n, v in kept.items() if n.startswith(MOMENTUM)]
    moving = scales(base.columns, base.rows.T)[base.columns.index("energy")]
    for name, values in kept.items():
        value = 0.0 if name in base.scales else float(values[0])
        size = base.scales.get(name, moving)
        if name.startswith(MOMENTUM):
            size = float(max(momenta))
        reached = max(float(np.max(np.abs(values[name] - value))) for values in apart)
        bound = SAFETY * reached + rtol * size + VALUE_ROUNDOFF * abs(value)
        found[name] = Invariant(value, rounded_up(bound))
    return found


# Changes of the model.

# Key of the JSON for responses to changes of the model, see `responses`.
CHANGES = "changes"


class Summary(NamedTuple):
    """Numbers of a model, by the effect of their changes on the verdict of a golden.

    Attributes
    ----------
    detected : int
        The count of numbers whose change makes the golden fail.
    undetected : list of str
        Numbers whose change alters the motion, but passes the golden.
    unresponsive : list of str
        Numbers whose change does not alter the motion.
    """

    detected: int
    undetected: list[str]
    unresponsive: list[str]


def summary(golden: Golden) -> Summary | None:
    """Return the summary of changes stored in a golden; None if it stores none."""
    found = golden.about.get(CHANGES)
    if not found:
        return None
    count, undetected, unresponsive = 0, [], []
    for name, x in (found["parameters"] | found["initial"]).items():
        if "response" not in x:
            count += 1
        elif x["response"] > SAFETY:
            undetected.append(name)
        else:
            unresponsive.append(name)
    for name, x in found.get("tables", {}).items():
        unseen, still = (x.get(word, ()) for word in ("unseen", "unresponsive"))
        count += x["changed"] - len(unseen) - len(still)
        for names, points in ((undetected, unseen), (unresponsive, still)):
            if points:
                noun = "point" if len(points) == 1 else "points"
                names.append(f"{name}, {noun} {several(map(str, points), 8)}")
    return Summary(count, undetected, unresponsive)


# Files.

FOLDER = "golden"
# Time limit, in s, for other processes that store goldens of other models in the
# folder; each takes some milliseconds.
PATIENCE_SECONDS = 10.0
# The largest number of digits of a value: those of a double.
MOST_DIGITS = 17


def table(golden: Golden) -> bytes:
    """Return the golden's rows as CSV, with as many digits as the bounds justify."""
    columns = []
    for name, values in zip(golden.columns, golden.rows.T.tolist(), strict=True):
        bounds = golden.bounds(name).tolist()
        cells = map(repr, values) if name == "t" else map(certain, values, bounds)
        columns.append([name, *cells])
    lines = map(",".join, zip(*columns, strict=True))
    return ("\n".join(lines) + "\n").encode()


def certain(value: float, bound: float) -> str:
    """Return the shortest decimal that differs from `value` by at most `bound`/10."""
    if not (bound > 0.0 and math.isfinite(value)):
        return repr(value)
    last = math.floor(math.log10(DIGITS * bound))
    first = math.floor(math.log10(abs(value))) if value else last
    digits = first - last + 1
    if digits < 1:
        return "0.0"
    text = repr(float(f"{value:.{min(digits, MOST_DIGITS) - 1}e}"))
    return text.removesuffix(".0") if len(text) > 3 else text


def _inputs(model: Model) -> dict[str, Document]:
    """Return the inputs that a golden stores: parameters, start values, expressions."""
    return {
        "parameters": model.parameter_values,
        "initial": {x.name: x.value for x in model.initial},
        "expressions": {k: x.text for k, x in model.stated.texts().items()},
    }


def _about(case: Case, golden: Golden, base: SampledMotion) -> Document:
    """Return the entry `about` of a golden's JSON: data on the run behind the golden.

    Later versions of lagsim add keys to the entry and remove none.
    """
    model, plan = case.model, base.plan
    return {
        "lagsim": __version__,
        "versions": versions(),
        "model": model.name,
        "model_sha256": model.sha256,
        **_inputs(model),
        "method": plan.method,
        "formulation": plan.formulation,
        "rtol": plan.rtol,
        "atol": plan.atol,
        "step": plan.step,
        "start": case.settings.start,
        "end": base.trial.end,
        "outcome": base.trial.outcome,
        "output_step": case.settings.output_step,
        "run_rows": base.count,
        "stride": golden.stride,
        "horizon": golden.horizon,
        "invariants": {k: x._asdict() for k, x in golden.invariants.items()},
        "columns": list(base.columns),
    }


def document(golden: Golden) -> bytes:
    """Return the JSON of a golden."""
    about = {k: x for k, x in golden.about.items() if k != CHANGES}
    parts = [encode(about).removesuffix(b"\n}\n")]
    changes = golden.about.get(CHANGES)
    if changes:
        inner = (_lines(name, own, 2) for name, own in changes.items())
        parts.append(b'  "%b": {\n%b\n  }' % (CHANGES.encode(), b",\n".join(inner)))
    bounds = {name: golden.steps[name] for name in golden.columns}
    return b",\n".join([*parts, _lines("bounds", bounds, 1)]) + b"\n}\n"


def _lines(name: str, entries: Document, depth: int) -> bytes:
    """Return a JSON object as text with one line for each entry, for human readers.

    name : key of the object.
    entries : its content.
    depth : the depth at which an entry is written on one line.
    """
    margin = depth * b"  "
    lines = (
        b"%b  %b: %b" % (margin, orjson.dumps(k), orjson.dumps(x))
        for k, x in entries.items()
    )
    head = b"%b%b: {" % (margin, orjson.dumps(name))
    return head + (b"\n%b\n%b}" % (b",\n".join(lines), margin) if entries else b"}")


def store(name: str, golden: Golden, folder: Path) -> tuple[int, list[Caution]]:
    """Write the golden of the model `name` to a folder, in place of an older one.

    Returns
    -------
    tuple
        The number of bytes written, and warnings.

    Raises
    ------
    InputError
        If the folder cannot be used.
    OSError
        If the disk is full; the older golden is then left unchanged.
    """
    rows, about = table(golden), document(golden)
    with open_results(folder, f"{name}.json", patience=PATIENCE_SECONDS) as results:
        results.write(f"{name}.csv", rows)
        results.commit(about)
    return len(rows) + len(about), results.cautions


def load(folder: Path, model_name: str) -> Golden:
    """Read the golden of a model from its folder.

    Raises
    ------
    InputError
        If there is no golden, or it cannot be read.
    """
    path = folder / f"{model_name}.json"
    try:
        about: Any = orjson.loads(files.content(path))
    except FileNotFoundError:
        text = f"there is no golden of {model_name} in {folder}"
        raise unusable(NO_GOLDEN, text) from None
    except OSError as error:
        raise _broken(path, f"cannot be read: {error.strerror}") from None
    except ValueError:
        raise _broken(path, "is not a JSON document") from None
    table = read_table(folder / f"{model_name}.csv")
    rows = np.ascontiguousarray(table.data.T)
    try:
        steps = {
            name: [(float(t), float(bound)) for t, bound in pairs]
            for name, pairs in about["bounds"].items()
        }
        if tuple(steps) != table.columns or not all(steps.values()):
            raise ValueError  # noqa: TRY301
        horizon = None if about["horizon"] is None else float(about["horizon"])
        for key in ("output_step", "end"):
            float(about[key])
        kept = {
            name: Invariant(float(entry["value"]), float(entry["bound"]))
            for name, entry in about["invariants"].items()
        }
        stride = int(about["stride"])
        if not isinstance(about.get(CHANGES, {}), dict):
            raise TypeError  # noqa: TRY301
    except (KeyError, TypeError, ValueError, AttributeError):
        raise _broken(path, "is not a golden, or not the one of these rows") from None
    return Golden(table.columns, rows, steps, horizon, kept, stride, about)


def _broken(path: Path, why: str) -> InputError:
    return unusable(BAD_GOLDEN, f"{path} {why}")


# Verdicts.

# Suffix of the name of an invariant, to distinguish it from the column.
CONSTANT = " (constant)"


def run(case: Case, golden: Golden, compiled: Compiled | None = None) -> SampledMotion:
    """Return the motion of a case with rows at the times of the golden.

    Parameters
    ----------
    compiled : Compiled, optional
        Compiled functions of the model, which are used if they fit the case.
    """
    spacing = float(golden.about["output_step"])
    plan = case.plan()
    step = None if method_named(plan.method).ADAPTIVE else plan.step
    other = case.with_settings(output_step=spacing, step=step)
    return motion_of(other, golden.stride, compiled)


def judge(case: Case, motion: SampledMotion, golden: Golden) -> Verdict:
    """Compare a motion of the case with its golden, and return the verdict.

    motion : the motion, with rows at the times of the golden, see `run`.
    """
    about, model = golden.about, case.model
    pairs = dict(_pairs(case, motion, golden))
    known = about.get("columns", golden.columns)
    changed, places = _changed(model, about)
    worst = sorted_deviations(pair.deviation(name) for name, pair in pairs.items())
    places += _places_of(model, worst)
    return Verdict(
        worst=worst,
        missing=tuple(c for c in golden.columns if c not in motion.columns),
        extra=tuple(c for c in motion.columns if c not in known),
        faults=tuple(_faults(motion, about)),
        of=pairs.__getitem__,
        notes=tuple(_notes(case, motion, about, changed)),
        changed=tuple(changed or ()),
        place=next(iter(places), None),
    )


def _changed(model: Model, about: Document) -> tuple[list[str] | None, list[Place]]:
    """Return texts on inputs that differ from the golden, and places of these inputs.

    The texts are None if the golden does not store its inputs. Start values that follow
    from a changed parameter are left out.
    """
    found: list[str] | None = None
    places: list[Place] = []
    starts = {x.name: x.place for x in model.initial}
    stated = {name: x.place for name, x in model.stated.texts().items()}
    words = ("parameter", "start value", "expression")
    lines = (model.places, starts, stated)
    inputs = zip(_inputs(model).items(), words, lines, strict=True)
    for (key, now), word, where in inputs:
        was = about.get(key)
        if not isinstance(was, dict) or (found and key == "initial"):
            continue
        found = found or []
        for name in [n for n in now if now[n] != was.get(n)]:
            other = f"in the golden {was[name]!r}" if name in was else "and is new"
            found.append(f"{word} `{name}` is {now[name]!r}, {other}")
            places += [where[name]] if name in where else []
        found += [f"{word} `{n}` no longer exists" for n in was if n not in now]
    return found, places


def _places_of(model: Model, worst: Sequence[Deviation]) -> list[Place]:
    """Return the places in the file of inputs with the names of columns that differ.

    worst : the deviations of columns.
    """
    places = dict(model.places)
    places |= {c.name: c.relation.place for c in model.constraints}
    found = []
    for deviation in worst:
        if not deviation.passed:
            owner = base(deviation.column.removesuffix(CONSTANT))
            names = (owner, rated(owner)[0])
            found += [places[name] for name in names if name in places]
    return found


def _pairs(
    case: Case, motion: SampledMotion, golden: Golden
) -> Iterator[tuple[str, ComparedColumn]]:
    """Yield the columns to compare, by name, with the values of both motions.

    Columns of both motions are compared in the rows of the golden, and invariants in
    all rows.
    """
    t, near = golden.rows[:, 0], SAME_ROW * float(golden.about["output_step"])
    rows = motion.at(t, near, ends=golden.horizon is None)
    new = dict(zip(motion.columns, rows.T, strict=True))
    for name, old in zip(golden.columns, golden.rows.T, strict=True):
        if name in new:
            bounds = golden.bounds(name)
            if name == "t":  # the times are equal up to the tolerance of the search
                bounds = bounds + np.where(at_impacts(t), 0.0, near)
            yield name, ComparedColumn(t, old, new[name], bounds)
    now, t = invariants(case.equations, motion), motion.rows[:, 0]
    for name, kept in golden.invariants.items():
        if name in now:
            value, bound = (np.full(len(t), x) for x in kept)
            yield f"{name}{CONSTANT}", ComparedColumn(t, value, now[name], bound)


def _faults(motion: SampledMotion, about: Document) -> Iterator[str]:
    trial = motion.trial
    if not trial.complete:
        yield f"the run does not finish: {trial.reason}"
    elif trial.outcome != (was := about.get("outcome", trial.outcome)):
        yield f"the run ends by `{trial.outcome}`, the golden by `{was}`"


def _notes(
    case: Case, motion: SampledMotion, about: Document, changed: list[str] | None
) -> Iterator[str]:
    """Yield notes on changes of file, method, versions or end; not on the motion.

    about : data on the golden's run.
    changed : texts on changed inputs, or None.
    """
    if case.model.sha256 != about.get("model_sha256"):
        text = "the model file has changed since its golden was stored"
        if changed is not None:
            text += (
                f": {'; '.join(changed) or 'not in the parts that the golden stores'}"
            )
        yield text
    for name in ("method", "formulation"):
        now, was = getattr(motion.plan, name), about.get(name)
        if now != was:
            yield f"{name} {now}, the golden's is {was}"
    was = {"lagsim": about.get("lagsim"), **about.get("versions", {})}
    now = {"lagsim": __version__, **versions()}
    others = [f"{k} {was[k]}" for k in now if k in was and was[k] != now[k]]
    if others:
        yield f"the golden is from {', '.join(others)}"
    spacing, end = float(about["output_step"]), float(about["end"])
    if case.settings.output_step != spacing:
        yield f"rows every {about['output_step']!r}, as in the golden"
    reached = motion.trial.end
    if abs(reached - end) > SAME_ROW * spacing:
        yield f"the run ends at t = {reached!r}, the golden's at {end!r}"


def picture(case: Case, verdict: Verdict) -> bytes:
    """Return a PNG of the columns with the largest deviations of a verdict."""
    from lagsim.outputs.letters import letters_of
    from lagsim.studies import comparison_chart

    model = case.model
    columns = [d.column.partition(" ")[0] for d in verdict.worst]
    letters, units = letters_of(model), of_table(case.equations, columns)
    subject = ", ".join(comparison_chart.summary_texts(verdict, letters))
    title = f"{model.name} differs from its golden"
    return comparison_chart.picture(
        title, subject, verdict, letters, units, verdict.changed
    )
