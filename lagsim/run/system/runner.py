"""A system linked with a method: what a run calls."""

from __future__ import annotations

import ctypes
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.methods import method
from lagsim.methods.parts import driver
from lagsim.native.layout import address
from lagsim.native.link.cache import kernel_object
from lagsim.native.link.engine import Engine
from lagsim.run.interrupt import Pace
from lagsim.run.system.functions import coupled, joined

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats
    from lagsim.methods.parts.driver import State
    from lagsim.run.system import System

# Rows in one block: a few hundred kilobytes; fewer where there are many columns.
BLOCK = 2048
MOST_NUMBERS = 2**20
_POINTER = ctypes.c_void_p
# Of the functions of a model: t, y, p, out.
FUNCTION = (None, (ctypes.c_double, _POINTER, _POINTER, _POINTER))
_PROJECTION = (None, (ctypes.c_double, _POINTER, _POINTER))
_ADVANCE = (
    ctypes.c_int64,
    (_POINTER, _POINTER, _POINTER, ctypes.c_int64, ctypes.c_int64),
)
_TABULATE = (
    None,
    (_POINTER, ctypes.c_int64, ctypes.c_int64, _POINTER, _POINTER, ctypes.c_int64),
)


class Runner:
    """A system linked with a method.

    Parameters
    ----------
    name : str
        That of the method.

    Attributes
    ----------
    method : module
    pace : Pace
        That of the runs so far.
    block : ndarray, shape (rows, 1 + size)
        Times and states of the rows that the last call of `advance` has written.
    """

    def __init__(self, system: System, name: str) -> None:
        around = kernel_object(
            [driver.advance, driver.tabulate], _statics(system, name)
        )
        kernels = [kernel_object(*of_method(system, name)), around]
        self.system, self.engine = system, Engine([*system.objects, *kernels])
        self.pace = Pace()
        self._functions: dict[Any, Callable[[float, Floats], Floats]] = {}
        self.method = method(name)
        self._prepare = self.engine.function("prepare", *FUNCTION)
        self._advance = self.engine.function("advance", *_ADVANCE)
        if system.watched > 0:
            self._project = self.engine.function("project_sliding", *_PROJECTION)
        self._tabulate = self.engine.function("tabulate", *_TABULATE)
        columns, width = system.rows_observed, 1 + system.size
        self._columns, self._width = columns, width
        self.block = np.empty((max(1, min(BLOCK, MOST_NUMBERS // columns)), width))
        self._rows = address(self.block)

    @cached_property
    def empty(self) -> State:
        """A state that nothing has been put into: for copies, of all bindings."""
        system = self.system
        sizes = {} if system.newton is None else system.newton.sizes_of_factors
        state: State = self.method.STATE.made(
            n=system.n,
            size=system.size,
            signals=len(system.indicators),
            surfaces=system.watched,
            inertias=len(system.inertias),
            **{key: x for key, x in sizes.items() if key in self.method.STATE.fields},
        )
        state.kinds[:] = [x.kind for x in system.indicators]
        state.powers[:] = [x.power for x in system.indicators]
        rows = system.equations.rows
        fixed = all(row.holonomic and row.scleronomic for row in rows)
        state.fixed_rows = float(fixed and not system.laws)
        state.joined[:] = coupled(system.equations)
        state.linked[:] = joined(system.n, [row.A.entries for row in rows])
        return state

    def over(self, system: System) -> Runner:
        """Return the same code over the memory of a system bound to other values."""
        new = copy(self)
        new.__dict__ |= {"system": system, "_functions": {}}
        return new

    def function(
        self, name: str, length: int | None = None
    ) -> Callable[[float, Floats], Floats]:
        """Return one of the model's functions as (t, y) -> out (length,)."""
        known = self._functions.get((name, length))
        if known is not None:
            return known
        call = self.engine.function(name, *FUNCTION)
        p, system = self.system.p.address, self.system
        size = length or max(system.rows_observed, system.size + 2, 2 + system.n)

        def evaluate(t: float, y: Floats) -> Floats:
            out, y = np.zeros(size), np.array(y, dtype=float, order="C")
            call(t, address(y), p, address(out))
            return out

        self._functions[name, length] = evaluate
        return evaluate

    def event_functions(self, t: float, y: Floats) -> Floats:
        """Event functions of the modes: of surfaces, then laws."""
        return self.function("event_functions", self.system.watched)(t, y)

    def project_sliding(self, t: float, y: Floats) -> None:
        """Project y, in place, onto the surfaces that the motion slides along."""
        self._project(t, y.ctypes.data, self.system.p.address)

    def prepare(self) -> None:
        """Compute what depends on parameters and modes alone, before each arc.

        No arc sees what another one left in the working memory.
        """
        p = self.system.p
        p.reference = self.system.plan.smallest_singular_value
        p.factored = p.noted = 0.0
        p.sigma = p.least_sigma = 1.0
        p.flat[p.place("motion") :] = self.system.unused
        if self.system.has_loops:
            rows = len(self.system.plan.lengths)  # laws have none
            p.lengths[:rows] = self.system.plan.lengths
            p.aside[:rows] = self.system.plan.set_aside
        self._prepare(0.0, None, p.address, None)

    def advance(self, state: State, rows: int, budget: int) -> int:
        """Run the method on, for so many rows at most; see `driver.advance`."""
        rows = min(rows, len(self.block))
        code: int = self._advance(
            state.address, self.system.p.address, self._rows, rows, budget
        )
        return code

    def shown(self, count: int) -> Floats:
        """Columns (count, columns) of the first rows of the block."""
        return self._columns_of(self._rows, count, self._width - 1)

    def tabulate(self, states: Floats) -> Floats:
        """Columns (rows, columns) of `states` (rows, 1 + size)."""
        states = np.ascontiguousarray(states)
        count, width = states.shape
        return self._columns_of(states.ctypes.data, count, width - 1)

    def _columns_of(self, states: int, count: int, size: int) -> Floats:
        out = np.empty((count, self._columns))
        if count:
            self._tabulate(
                states, count, size, self.system.p.address, address(out), self._columns
            )
        return out


def of_method(
    system: System, name: str
) -> tuple[list[Callable[..., Any]], dict[str, object]]:
    """Kernels of a method, and what is known of the system they work on."""
    by, statics = method(name), _statics(system, name)
    del statics["ADAPTIVE"]
    # What a method must make ready for `until` it must for switches.
    statics["UNTIL"] = statics["UNTIL"] or statics["SWITCHES"]
    statics["SPARSE"] = system.newton is not None
    kernels = [by.start, by.step, by.interpolate]
    kernels.append(by.interpolate_rates if by.ADAPTIVE else by.make)
    return kernels, {key: x for key, x in statics.items() if hasattr(by, key)}


def _statics(system: System, name: str) -> dict[str, object]:
    return {
        "CONSTRAINED": system.m > 0 and system.plan.projected,
        "UNTIL": system.equations.model.until is not None,
        "SWITCHES": system.watched > 0,
        "LOCALIZED": bool(system.indicators),
        "ADAPTIVE": method(name).ADAPTIVE,
    }
