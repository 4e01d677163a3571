"""Responses of a motion to small changes of its model, and their detection by a golden.

Each parameter, each stated start value, and points of each table are changed slightly,
one at a time, and the run of the changed model is compared with the golden. If the
comparison passes, the change of the motion is compared with rounding errors: either the
motion does not respond to the change (an amplitude cancels, for example), or the golden
does not detect its response.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.errors import LagsimError
from lagsim.program.output_row import stated_units
from lagsim.run.session import examined
from lagsim.studies.comparison import on_grid, scales
from lagsim.studies.golden import SAFETY, Golden, judge, run
from lagsim.studies.motions import SEEDS, motion_of, perturbed
from lagsim.studies.trial import Compiled
from lagsim.tolerances import TIGHTEST_RTOL, UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model, Table
    from lagsim.run.session import Case
    from lagsim.studies.motions import SampledMotion

    Document = dict[str, Any]

# Changes, as parts of a parameter, of a start value, and of the range of a table.
OF_PARAMETER, OF_START, OF_TABLE = 1e-4, 1e-5, 1e-2
# Numbers of each section, and points of each table, that are changed in turn, at most:
# evenly chosen, with both ends.
MOST_NUMBERS, MOST_POINTS = 200, 40
# Rows of the test whether a motion responds: spacing relative to that of the run (its
# inverse), and the largest number of rows.
CLOSER, MOST_ROWS = 4, 20_000
# Least rounding error of a column, in units in the last place of its scale: each value
# is the sum of several terms.
LEAST_ROUNDING = 8.0


class Response(NamedTuple):
    """Response of a motion to a change of a number of its model.

    Attributes
    ----------
    change : float
        The amount added to the number.
    ratio : float
        The largest difference relative to its bound; inf if the run has another
        outcome.
    refused : str
        The code of the error if the changed model is not valid, else "".
    response : float
        For a change that passes the golden, the largest difference of the motion
        relative to rounding errors.
    """

    change: float
    ratio: float
    refused: str = ""
    response: float = math.inf

    @property
    def is_detected(self) -> bool:
        """Whether the changed model fails the comparison with the golden."""
        return bool(self.refused) or self.ratio > 1.0

    @property
    def is_undetected(self) -> bool:
        """Whether the comparison passes although the motion responds to the change."""
        return not self.is_detected and self.response > SAFETY

    @property
    def record(self) -> Document:
        """The entry of the response in the JSON of a golden; inf is written as null."""
        found: Document = {"change": float(f"{self.change:.3g}")}
        if self.refused:
            return found | {"refused": self.refused}
        found["ratio"] = float(f"{self.ratio:.3g}")
        if not self.is_detected:
            found["response"] = float(f"{self.response:.3g}")
        return found


def responses(
    case: Case, golden: Golden, base: SampledMotion, compiled: Compiled | None = None
) -> Document:
    """Return the responses to all changes, under `parameters`, `initial` and `tables`.

    If there are too many numbers, `untried` has the count of numbers left out, for each
    of these three.

    Parameters
    ----------
    base : SampledMotion
        The motion from which the golden was made.
    compiled : Compiled, optional
        Compiled functions of the model, which are used if they fit the case.
    """
    changes = _Changes(case, golden, base, compiled or Compiled())
    model = case.model
    found: Document = {}
    untried = {}
    for section, numbers, response in (
        ("parameters", [*_parameters(model)], changes.of_parameter),
        ("initial", [*_starts(case, base)], changes.of_start),
    ):
        chosen = _evenly(len(numbers), MOST_NUMBERS)
        found[section] = {
            name: response(name, size).record
            for name, size in (numbers[k] for k in chosen)
        }
        if len(chosen) < len(numbers):
            untried[section] = len(numbers) - len(chosen)
    if model.tables:
        found["tables"] = {table.name: _table(changes, table) for table in model.tables}
    return found | ({"untried": untried} if untried else {})


def _evenly(count: int, most: int) -> list[int]:
    """Return evenly spaced integers of range(count), both ends included.

    most : their largest number.

    Examples
    --------
    >>> _evenly(9, 3)
    [0, 4, 8]
    """
    places = np.linspace(0, count - 1, min(count, most))
    return [int(k) for k in np.rint(places)]


def _parameters(model: Model) -> Iterator[tuple[str, float]]:
    """Yield name and size of each parameter that is not a mode.

    The size of a parameter with value 0 is the least size of other parameters of its
    unit, or 1.
    """
    known = [p for p in model.parameters if not p.mode]
    for p in known:
        of_unit = [abs(x.value) for x in known if x.unit == p.unit != "" and x.value]
        yield p.name, abs(p.value) or min(of_unit, default=1.0)


def _starts(case: Case, base: SampledMotion) -> Iterator[tuple[str, float]]:
    """Yield name and size of each start value that the file states.

    The size of a start value 0 is the scale of its column, or 1.
    """
    units = stated_units(case.equations)
    sizes = dict(zip(base.columns, scales(base.columns, base.rows.T, units)))  # noqa: B905
    for x in case.model.initial:
        if x.text and not x.guess:
            yield x.name, abs(x.value) or float(sizes.get(x.name, 0.0)) or 1.0


def _table(changes: _Changes, table: Table) -> Document:
    """Return the entry of a table in the JSON of a golden.

    The keys of the entry:

    - `points`: the number of points of the table;
    - `changed`: the number of points that were changed, one at a time;
    - `least`: of the detected changes, the one with the least ratio of difference to
      bound;
    - `unseen`: the points whose change alters the motion and is not detected;
    - `unresponsive`: the points whose change does not alter the motion.
    """
    count = math.prod(int(axis.numbers[0]) + 1 for axis in table.axes)
    points = _evenly(count, MOST_POINTS)
    found = {k: changes.of_point(table.name, k) for k in points}
    detected = {k: r for k, r in found.items() if r.is_detected}
    least = min(detected, key=lambda k: detected[k].ratio, default=None)
    entry: Document = {"points": count, "changed": len(found)}
    if least is not None:
        entry |= {"least": detected[least].record | {"point": least + 1}}
    for word, group in (
        ("unseen", {k: r for k, r in found.items() if r.is_undetected}),
        (
            "unresponsive",
            {k: r for k, r in found.items() if not (r.is_detected or r.is_undetected)},
        ),
    ):
        if group:
            worst = max(r.response for r in group.values())
            entry[word] = [k + 1 for k in group]
            entry[f"{word}_response"] = float(f"{worst:.3g}")
    return entry


class _Changes:
    """Changes of single numbers of a model: each is run, and compared with a golden.

    Parameters
    ----------
    case : Case
        The case of the golden run.
    golden : Golden
    base : SampledMotion
        The motion from which the golden was made.
    compiled : Compiled
        Compiled functions of the model.
    """

    def __init__(
        self, case: Case, golden: Golden, base: SampledMotion, compiled: Compiled
    ) -> None:
        self.case, self.golden, self.base = case, golden, base
        self.compiled = compiled
        self._exact: tuple[Floats, Floats] | None = None

    def of_parameter(self, name: str, size: float) -> Response:
        """Return the response to a change of the parameter `name`.

        size : the size of the parameter, to which the change is relative.
        """
        value = {p.name: p.value for p in self.case.model.parameters}[name]

        def changed(by: float) -> Model:
            return self.case.model.bind({name: value + by})

        return self._response(changed, OF_PARAMETER * size)

    def of_start(self, name: str, size: float) -> Response:
        """Return the response to a change of the start value `name`.

        size : the size of the start value, to which the change is relative.
        """
        value = {x.name: x.value for x in self.case.model.initial}[name]

        def changed(by: float) -> Model:
            return self.case.model.bind({}, {name: value + by})

        return self._response(changed, OF_START * size)

    def of_point(self, table: str, point: int) -> Response:
        """Return the response to a change of one value of a table.

        point : the index of the value.
        """
        model = self.case.model

        def changed(by: float) -> Model:
            return model.stated.shifted(model, table, point, by)

        return self._response(changed, OF_TABLE)

    def _response(self, changed: Callable[[float], Model], by: float) -> Response:
        """Return the response to a change; to the opposite one if it is invalid.

        changed : amount -> changed model.
        by : the amount.
        """
        found = self._of(changed, by)
        return self._of(changed, -by) if found.refused else found

    def _of(self, changed: Callable[[float], Model], by: float) -> Response:
        try:
            model = changed(by)
            case = examined(self.case.equations, model, model.settings())
            motion = run(case, self.golden, self.compiled)
        except LagsimError as error:
            return Response(by, math.inf, error.code)
        verdict = judge(case, motion, self.golden)
        ratio = max((d.ratio for d in verdict.worst), default=0.0)
        if verdict.passed:
            return Response(by, ratio, "", self._against_rounding(case))
        return Response(by, ratio if verdict.failed else math.inf)

    # Runs with rounding errors alone

    def _against_rounding(self, case: Case) -> float:
        """Return the largest change of the motion as a multiple of its rounding errors.

        case : the changed case.
        """
        if self._exact is None:
            self._exact = self._rounding()
        exact, noise = self._exact
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios = _difference(self._exact_rows(case), exact) / noise
        return float(np.max(np.nan_to_num(ratios, nan=0.0, posinf=np.inf)))

    def _rounding(self) -> tuple[Floats, Floats]:
        """Return accurate rows of the golden case, and their rounding errors.

        Both have the shape (k, columns).
        """
        exact = self._exact_rows(self.case)
        others = [self._exact_rows(perturbed(self.case, k)) for k in range(SEEDS)]
        differences = functools.reduce(np.fmax, [_difference(x, exact) for x in others])
        units = stated_units(self.case.equations)
        sizes = scales(self.base.columns, exact.T, units)
        sizes = np.maximum(sizes, np.max(np.abs(exact), axis=0))
        own = LEAST_ROUNDING * UNIT_ROUNDOFF * sizes
        return exact, np.maximum.accumulate(differences, axis=0) + own

    def _exact_rows(self, case: Case) -> Floats:
        """Return rows (k, columns) of a case, at the tightest tolerance.

        They are more closely spaced than the rows of the golden.
        """
        plan, settings = self.base.plan, case.settings
        if plan.rtol is not None:
            atol = None if plan.atol is None else plan.atol * TIGHTEST_RTOL / plan.rtol
            case = case.with_settings(method=plan.method, rtol=TIGHTEST_RTOL, atol=atol)
        elif plan.step is not None:
            case = case.with_settings(step=plan.step)
        closer = max(settings.output_step / CLOSER, settings.duration / MOST_ROWS)
        case = case.with_settings(output_step=closer)
        motion = motion_of(case, 1, self.compiled)
        return on_grid(motion.rows, case.settings)


def _difference(rows: Floats, others: Floats) -> Floats:
    """Return |rows - others|, in the shape of `others`; 0 where `rows` has ended."""
    count = min(len(rows), len(others))
    found = np.zeros_like(others)
    found[:count] = np.abs(rows[:count] - others[:count])
    return found
