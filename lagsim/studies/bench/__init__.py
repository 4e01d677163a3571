"""Comparison of methods on a model: work-precision, and stability at given steps.

This module has timed solves. Their time includes rows and excludes compilation, and is
the least of several solves. Solvers are lagsim's methods, and scipy's solvers with the
same compiled right-hand side. scipy's solvers have no constraints: a model with
constraints is solved as the ordinary differential equation for q'' with lambda
eliminated (index 1), and drifts. The steps of scipy are Python calls, as in any use of
scipy; the right-hand side is native.
"""

from __future__ import annotations

import ctypes
import os
import platform
import time
import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from lagsim.errors import InputError
from lagsim.program.signatures import FUNCTION
from lagsim.run.trajectory import Statistics
from lagsim.studies.comparison import on_grid
from lagsim.studies.trial import (
    NO_ROWS,
    NOT_BEGUN,
    TOO_SLOW,
    GivenUpError,
    Patience,
    Trial,
    tried,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lagsim.language.arrays import Floats
    from lagsim.run.session import Case


# Solves are repeated until their total time exceeds this, up to a largest number: a
# millisecond is measured well by the least of twenty, a second by itself.
REPEATING_SECONDS = 0.2
MOST_REPEATS = 20

FORMULATIONS = ("auto", "full")
# Verdict on rows that violate the constraints: no result that `auto` might give.
DRIFT = "drift"
OF_CONSTRAINTS = ("projection", "elimination", "baumgarte", DRIFT)


def with_method(
    case: Case,
    method: str = "auto",
    formulation: str = "auto",
    rtol: float | None = None,
) -> Case:
    """Return the case with a method, a formulation and rtol.

    atol and the step are set to their defaults.
    """
    return case.with_settings(
        method=method, formulation=formulation, rtol=rtol, atol=None, step=None
    )


class Own:
    """Solver: a method of lagsim in a formulation.

    Parameters
    ----------
    case, method, formulation, rtol
        See `with_method`.

    Attributes
    ----------
    setting : str
        `rtol` or `step`: the meaning of the argument of `solve`.
    value : float
        The value of the setting in the plan.
    compile_seconds : float
        The time to make the solver ready.
    names : tuple of str
        Names of the columns of rows.

    Raises
    ------
    InputError
        If the method or the formulation cannot handle the model.
    """

    def __init__(
        self,
        case: Case,
        method: str,
        formulation: str = "auto",
        rtol: float | None = None,
    ) -> None:
        began = time.perf_counter()
        self.session = with_method(case, method, formulation, rtol).ready()
        self.compile_seconds = time.perf_counter() - began
        self.case, self.plan = self.session.case, self.session.plan
        self.system = self.session.system
        self.method, self.formulation = self.plan.method, self.plan.formulation
        self.setting, self.value = self.plan.accuracy
        self.names = self.system.columns.names

    def solve(self, value: float, patience: Patience) -> Trial:
        """Solve once with the tolerance or the step `value`, within a time limit.

        The result has the rows at the output times, and the last one; no rows if the
        solve fails, exceeds its time limit, or has values that are not finite.
        """
        found = tried(self.session.by(self.plan.at(value)), patience=patience)
        rows = found.rows
        if found.complete:
            rows = on_grid(rows, self.case.settings)
        if not found.complete or not np.all(np.isfinite(rows)):
            return found._replace(rows=NO_ROWS)
        return found._replace(rows=rows, reason="")


def formulation_solvers(case: Case, method: str) -> tuple[list[Own], dict[str, str]]:
    """Return a solver for each formulation that a method supports.

    The second value has, for each other formulation, the reason why it is refused.
    """
    found: dict[str, Own] = {}
    refused: dict[str, str] = {}
    constrained = bool(case.equations.rows)
    for formulation in (*FORMULATIONS, *(OF_CONSTRAINTS if constrained else ())):
        try:
            plan = with_method(case, method, formulation).plan()
            if plan.formulation not in found:
                found[plan.formulation] = Own(case, method, formulation)
        except InputError as fault:
            prefix = f"`{method}` cannot handle this model: "
            refused[formulation] = fault.problems[0].text.removeprefix(prefix)
    return list(found.values()), refused


def fastest(solve: Callable[[], Trial]) -> Trial:
    """Return the result with the least time, of several calls of `solve`."""
    best = solve()
    spent = best.seconds
    for _ in range(1, MOST_REPEATS):
        if not len(best.rows) or spent + best.seconds >= REPEATING_SECONDS:
            break
        again = solve()
        if again.outcome == TOO_SLOW:
            break
        spent += again.seconds
        best = min(best, again, key=lambda solved: solved.seconds)
    return best


def solved(
    rows: Floats | None, seconds: float, evaluations: int, reason: str = ""
) -> Trial:
    """Return the result of a solve by another package, as a `Trial`.

    Parameters
    ----------
    rows : ndarray, shape (k, columns), or None
        The rows; None if the solve failed.
    seconds : float
        Time of the solve.
    evaluations : int
        Number of evaluations of the right-hand side.
    reason : str
        Reason of a failure.
    """
    outcome, rows = ("failed", NO_ROWS) if rows is None else ("done", rows)
    counts = NOT_BEGUN._replace(statistics=Statistics(evaluations=evaluations))
    return Trial(outcome, reason, rows=rows, trajectory=counts, seconds=seconds)


PREFIX = "scipy:"
SCIPY = tuple(PREFIX + name for name in ("DOP853", "RK45", "Radau", "LSODA", "BDF"))

# scipy refuses tolerances below a hundred units of rounding.
LEAST_RTOL = 3e-14
# Evaluations between two checks of the clock.
LOOK = 64


def index_one(case: Case) -> Own:
    """Return a solver for q'' with lambda eliminated (index 1), without projection.

    Its solution can drift off the constraints.
    """
    return Own(case, "dop853", DRIFT if case.equations.rows else "full")


def state_sizes(own: Own, rows: Floats) -> Floats:
    """Return the largest absolute value of each component of y in rows, shape (l,).

    A component that is always 0 has the largest value of all l components, or 1.

    own : the solver, which names the columns.
    rows : (k, columns), the rows of a run.
    """
    columns = [own.names.index(name) for name in own.system.state]
    sizes = np.max(np.abs(rows[:, columns]), axis=0)
    return np.where(sizes > 0.0, sizes, np.max(sizes) or 1.0)


def scipy_refusal(own: Own) -> str:
    """Return the reason why scipy's solvers cannot handle a model; "" if they can.

    own : the solver of lagsim for the model.
    """
    switches = own.system.switches
    if switches.modes or switches.state:
        return "they would step over the model's switches"
    if own.case.equations.laws:
        return "they do not handle constraints that hold at times"
    model = own.case.model
    if model.until:
        return "the end of the run is an event"
    if model.events:
        return "they do not set modes at events"
    return ""


class Scipy:
    """Solver of scipy.

    Parameters
    ----------
    own : Own
        The solver of lagsim whose right-hand side is used, and by which columns are
        computed.
    method : str
        Name of the solver in scipy, such as `DOP853`.
    rows : ndarray, shape (k, columns)
        Rows of a known solution. Output is computed at their times, and atol is rtol
        times the largest absolute values of the components of y, as in lagsim.
    """

    setting = "rtol"
    compile_seconds = 0.0

    def __init__(self, own: Own, method: str, rows: Floats) -> None:
        self.own, self.method, self.names = own, method, own.names
        self.times, self.sizes = rows[:, 0], state_sizes(own, rows)
        self.formulation = DRIFT if own.system.m else "none"

    def _derivative(
        self, check: Callable[[], None]
    ) -> Callable[[float, Floats], Floats]:
        """Return the compiled function y'(t, y), which checks the time limit.

        check : called at some evaluations; raises an exception past the time limit.
        """
        system, size = self.own.system, self.own.system.size
        runner = system.link(self.own.method)
        runner.prepare()
        call = runner.engine.function("derivative", *FUNCTION)
        state, rates = np.zeros(size), np.zeros(size + 2)
        pointers = [
            ctypes.c_void_p(array.ctypes.data)
            for array in (state, system.p.flat, rates)
        ]
        self.evaluations = 0

        def derivative(t: float, y: Floats) -> Floats:
            self.evaluations += 1
            if self.evaluations % LOOK == 0:
                check()
            state[:] = y
            call(t, *pointers)
            return rates[:size].copy()

        return derivative

    def solve(self, value: float, patience: Patience) -> Trial:
        """Solve once with the tolerance `value`, within a time limit.

        The result has no rows if that fails.
        """
        from scipy.integrate import solve_ivp

        y = self.own.system.begin(self.own.case.start)
        f = self._derivative(patience.check)
        rows, reason = None, ""
        patience.begin()
        # Values that are not finite are reported by the outcome.
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            began = time.perf_counter()
            try:
                result: Any = solve_ivp(  # type: ignore[call-overload,unused-ignore]
                    f,
                    (self.times[0], self.times[-1]),
                    y,
                    self.method.removeprefix(PREFIX),
                    t_eval=self.times,
                    rtol=max(value, LEAST_RTOL),
                    atol=value * self.sizes,
                )
                reason = result.message
            except (ValueError, ArithmeticError, np.linalg.LinAlgError) as fault:
                result, reason = None, str(fault)
            except GivenUpError:
                return patience.given_up()
            seconds = time.perf_counter() - began
        if result is not None and result.status == 0:
            states = np.column_stack([result.t, result.y.T])
            rows, reason = self.own.system.link(self.own.method).tabulate(states), ""
        return solved(rows, seconds, self.evaluations, reason)


Solver: TypeAlias = Own | Scipy


# Machine, versions and date, on which the numbers of a bench depend.

# Packages whose versions affect times.
PACKAGES = ("python", "numpy", "llvmlite", "scipy", "heyoka", "scikit-sundae")
# A load of the machine above this means that other programs were running.
BUSY = 1.5


def machine() -> dict[str, Any]:
    """Return the processor, the system, and the load of the machine."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "load": load,
    }


def today() -> str:
    """Return the date in UTC as text, in the form 2026-01-31."""
    return datetime.now(UTC).date().isoformat()


def stamp(document: Mapping[str, Any]) -> str:
    """Return the date, machine and versions of a document as text.

    Date and machine are left out if no number in the document depends on them.
    """
    known = document["versions"]
    packages = [f"{name} {known[name]}" for name in PACKAGES if name in known]
    with_ = ", ".join([f"lagsim {document['lagsim']}", *packages])
    if "machine" not in document:
        return f"Found with {with_}"
    found = document["machine"]
    threads = f"one of {found['cores']} threads"
    where = f"{found['processor']}, {threads}, {found['system']}"
    load = found["load"] or 0.0
    where += f", busy (load {load:.1f})" if load > BUSY else ""
    return f"Measured {document['date']} on {where}; {with_}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    named = {k.strip(): v.strip() for k, _, v in (x.partition(":") for x in lines)}
    return named.get("model name") or platform.machine()
