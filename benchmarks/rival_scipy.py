"""scipy: DOP853 of solve_ivp, and LSODA through odeint, on a compiled y'.

Their steps are Python's and Fortran's; the right-hand side is called through ctypes.
"""

from __future__ import annotations

import time
import warnings

import numpy as np
from by_textbook import Compiled
from scipy.integrate import odeint, solve_ivp

from lagsim.studies.bench import LEAST_RTOL, solved


class Scipy:
    """DOP853, or LSODA with `by_odeint`, at one tolerance.

    It integrates y' of `nodes` of the graph g; rows have the shape (k, 1 + state).
    """

    def __init__(self, g, nodes, names, times, sizes, rtol, *, by_odeint):
        self.f = Compiled(g, nodes, names)
        self.times, self.by_odeint = times, by_odeint
        self.tolerances = {"rtol": max(rtol, LEAST_RTOL), "atol": rtol * sizes}

    def solve(self, start):
        """Integrate once from a start; return rows, seconds and evaluations."""
        self.f.evaluations = 0
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            began = time.perf_counter()
            states = (self._odeint if self.by_odeint else self._dop853)(start)
            seconds = time.perf_counter() - began
        if states is None:
            return solved(None, seconds, self.f.evaluations)
        rows = np.column_stack([self.times, states])
        return solved(rows, seconds, self.f.evaluations)

    def _dop853(self, start):
        span = (self.times[0], self.times[-1])
        found = solve_ivp(
            self.f, span, start, "DOP853", t_eval=self.times, **self.tolerances
        )
        return found.y.T if found.status == 0 else None

    def _odeint(self, start):
        found, said = odeint(
            self.f, start, self.times, tfirst=True, full_output=True, mxstep=100_000,
            **self.tolerances,
        )  # fmt: skip
        return found if said["message"] == "Integration successful." else None
