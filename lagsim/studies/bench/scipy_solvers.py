"""scipy's solvers on the same compiled right-hand side, for comparison.

They know nothing of constraints: those scenes they solve as the ordinary differential
equation for q'' with lambda solved away (index 1), and drift. Their step is a Python
call, which is what they cost who uses them; the right-hand side is not.
"""

from __future__ import annotations

import ctypes
import time
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.run.system.runner import FUNCTION
from lagsim.studies.bench.solving import Own, Solved

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats
    from lagsim.studies.bench.solving import Patience

PREFIX = "scipy:"
NAMES = tuple(PREFIX + name for name in ("DOP853", "RK45", "Radau", "LSODA", "BDF"))

# scipy refuses what is tighter than a hundred roundings.
LEAST_RTOL = 3e-14
# The clock is looked at every so many evaluations.
LOOK = 64


def refusal(own: Own) -> str:
    """Say why scipy's solvers cannot handle the scene of `own`; "" if they can."""
    switches = own.system.switches
    if switches.modes or switches.state:
        return "they would step over the model's switches"
    if own.case.equations.laws:
        return "they do not handle constraints that come and go"
    if own.case.equations.model.until:
        return "the end of the run is an event"
    return ""


class Counted:
    """The compiled right-hand side as scipy wants it.

    Attributes
    ----------
    evaluations : int
    """

    def __init__(self, own: Own, look: Callable[[], None]) -> None:
        runner = own.system.link(own.method)
        runner.prepare()
        self._call = runner.engine.function("derivative", *FUNCTION)
        self._y = np.zeros(own.system.size)
        self._out = np.zeros(own.system.size + 2)
        self._pointers = [
            ctypes.c_void_p(array.ctypes.data)
            for array in (self._y, own.system.p.flat, self._out)
        ]
        self._size = own.system.size
        self._look = look
        self.evaluations = 0

    def __call__(self, t: float, y: Floats) -> Floats:
        """Give y'."""
        self.evaluations += 1
        if self.evaluations % LOOK == 0:
            self._look()
        self._y[:] = y
        self._call(t, *self._pointers)
        return self._out[: self._size].copy()


class Scipy:
    """One of scipy's solvers.

    Parameters
    ----------
    own
        Gives the right-hand side, and makes columns of states.
    times : (k,)
        Of the rows.
    sizes : (size,)
        Of the components of y: atol is rtol times these, as in lagsim.
    """

    setting = "rtol"
    compile_seconds = 0.0

    def __init__(self, own: Own, method: str, times: Floats, sizes: Floats) -> None:
        self.own, self.times, self.sizes = own, times, sizes
        self.method = method
        self.formulation = "drift" if own.system.m else "none"
        self.names = own.names

    def solve(self, value: float, patience: Patience) -> Solved:
        """Solve once with the tolerance `value`."""
        from scipy.integrate import solve_ivp

        start = self.own.case.start
        work = np.zeros(self.own.system.works)
        y = np.concatenate([start.q, start.v, work])
        f = Counted(self.own, patience.check)
        patience.begin()
        # What becomes of values that are not finite is told by the outcome.
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
            except (ValueError, ArithmeticError, np.linalg.LinAlgError) as fault:
                seconds = time.perf_counter() - began
                return Solved(None, seconds, f.evaluations, "failed", str(fault))
            seconds = time.perf_counter() - began
        rows = None
        if result.status == 0:
            states = np.column_stack([result.t, result.y.T])
            rows = self.own.system.link(self.own.method).tabulate(states)
        outcome = "failed" if rows is None else "done"
        reason = result.message if rows is None else ""
        return Solved(rows, seconds, f.evaluations, outcome, reason)
