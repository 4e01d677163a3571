"""A system linked to make many runs at once; see `methods.parts.lanes`."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods.parts import lanes as kernels
from lagsim.methods.parts.lanes import Ensemble
from lagsim.native.graph import keys
from lagsim.native.link.cache import kernel_object, object_code
from lagsim.native.link.engine import Engine
from lagsim.run.system.runner import objects_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.methods.parts.state import State
    from lagsim.native.graph.straight_line import Code
    from lagsim.run.system import System

# A line of the cache, in bytes: a vector that lies in two of them takes longer.
LINE = 64
WORD = 8
# The functions of a model that steps in lanes call, and those with contraction.
CALLED = (
    "series", "measure", "terms", "inertias", "signals", "derivative", "rounding",
)  # fmt: skip
CONTRACTED = ("series",)


class Together:
    """A system linked with a method that has `try_plain`."""

    def __init__(self, system: System, name: str) -> None:
        self.system = system
        runner = system.link(name)
        self.method = method = runner.method
        statics = {
            "CONSTRAINED": False, "SWITCHES": False,
            "SLEEPERS": bool(system.sleepers),
        }  # fmt: skip
        tried = [method.try_plain, method.take_plain]
        code, room = self._functions()
        self.room = max(room, len(system.p.flat))
        self.places: Mapping[str, int] = keys.Layout(*system.made_from[1]).p
        self.engine = Engine(
            [
                *objects_of(system, name),
                code,
                kernel_object(tried, statics, wide=True),
                kernel_object([kernels.together]),
            ]
        )
        self._made: Ensemble | None = None
        self._call = self.engine.function(
            "together", ctypes.c_int64, (ctypes.c_void_p, ctypes.c_int64)
        )

    def _functions(self) -> tuple[bytes, int]:
        """Give the object code of what is called, and the length of p that it needs."""
        system = self.system
        g, (functions, fields) = system.equations.graph, system.made_from
        layout = keys.Layout(*fields)
        names = tuple(name for name in CALLED if name in functions)

        def code() -> Code:
            from lagsim.native.graph import lanes

            return lanes.generate(g, functions, layout, names, CONTRACTED)

        manner = {"lanes": names, "contracted": CONTRACTED}
        return object_code(keys.fingerprint(g, functions, layout, False, manner), code)

    def ensemble(self, state: State, runs: int) -> Ensemble:
        """Give the memory of runs, each at this state with these parameters.

        That of the runs before, where there were as many.
        """
        e = self._made
        if e is None or e.runs != runs:
            e = self._made = self._new(state, runs)
        e.next = e.working = e.shared = 0.0
        e.who[:] = e.codes[:] = kernels.NOBODY
        e.states.reshape(runs, -1)[:] = state.flat
        own = e.parameters.reshape(runs, -1)
        own[:, : len(self.system.p.flat)] = self.system.p.flat
        return e

    def _new(self, state: State, runs: int) -> Ensemble:
        system, fields = self.system, self.method.STATE.fields
        e = Ensemble.made(
            runs=runs, size=system.size, words=len(state.flat), room=self.room,
            columns=system.rows_observed, begin=state.place("y"),
            which=fields["which"].word, plain=fields["plain"].word,
            first=state.place("series"),
            length=(state.place("new") - state.place("series")) // 2,
        )  # fmt: skip
        return Ensemble(_aligned(e))

    def advance(self, e: Ensemble, budget: int) -> bool:
        """Go on with the runs of an ensemble; tell whether any is left."""
        return bool(self._call(e.address, budget))


def _aligned(e: Ensemble) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Copy a memory to where its lanes begin with a line of the cache."""
    whole = np.empty(len(e.flat) + LINE // WORD)
    first = -(whole.ctypes.data // WORD + e.place("lanes")) % (LINE // WORD)
    new = whole[first : first + len(e.flat)]
    new[:] = e.flat
    return new
