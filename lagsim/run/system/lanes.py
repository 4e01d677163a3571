"""A system linked to make many runs at once; see `methods.parts.lanes`."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods.taylor import buffer
from lagsim.methods.parts import driver
from lagsim.methods.parts import lanes as kernels
from lagsim.methods.parts import state as at
from lagsim.methods.parts.lanes import Ensemble
from lagsim.native.kernels.lines import LANES
from lagsim.native.link.cache import kernel_object
from lagsim.native.link.engine import Engine

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.system import System

_POINTER = ctypes.c_void_p
# A line of the cache, in bytes and in numbers.
LINE = 64
NUMBERS = LINE // 8


def aligned(count: int) -> Floats:
    """Give zeros that begin where a line of the cache does."""
    whole = np.zeros(count + NUMBERS)
    first = -whole.ctypes.data % LINE // 8
    return whole[first : first + count]


class Together:
    """A system linked with a method that has `try_plain`, for many runs at once."""

    def __init__(self, system: System, name: str) -> None:
        self.system = system
        self.runner = system.link(name)
        statics = {"CONSTRAINED": False, "SWITCHES": False}
        statics["SLEEPERS"] = bool(system.sleepers)
        method = self.runner.method
        code, self.room = self._functions()
        narrow = {"UNTIL": False, "WIDE": system.wide, "ADAPTIVE": True}
        wide = kernel_object([method.try_plain, method.take_plain], statics, wide=True)
        self.engine = Engine(
            [
                *system.objects,
                code,
                wide,
                kernel_object([method.start, method.step, method.interpolate, method.interpolate_rates], statics),
                kernel_object([driver.advance], statics | narrow),
                kernel_object([kernels.together]),
            ]
        )
        arguments = (*[_POINTER] * 6, ctypes.c_int64)
        self._call = self.engine.function("together", ctypes.c_int64, arguments)

    def _functions(self) -> tuple[bytes, int]:
        """Give the functions of the model that the wide kernels call, and the size of p."""
        system = self.system
        from lagsim.native.graph import keys
        from lagsim.native.link.cache import object_code

        names = [x for x in ("series", "measure", "terms", "inertias", "signals") if x in system.nodes_of]
        manner = {"lanes": tuple(names), "contracted": ("series",)}
        def code():
            from lagsim.native.graph import lanes

            return lanes.generate(system.equations.graph, system.nodes_of, system.layout, **{"names": names, "contracted": ("series",)})

        key = keys.fingerprint(system.equations.graph, system.nodes_of, system.layout, False, manner)
        return object_code(key, code)

    def run(self, states: Floats, parameters: Floats, most: int) -> Floats:
        """Make runs; give what each has come to (runs,), states are where it did.

        states : (runs, words) at their starts; parameters : (runs, room).
        """
        template = self.runner.method.STATE
        runs, words = states.shape
        e = Ensemble.made(
            runs=runs, words=words, room=parameters.shape[1],
            which=template.fields["which"].word, plain=template.fields["plain"].word,
            first=int(states[0, template.fields["series"].word]),
            length=buffer(self.system.size, 1.0), rows=ROWS,
        )
        e.most = most
        lanes, memory = aligned(words * LANES), aligned(parameters.shape[1] * LANES)
        rest = np.empty(ROWS * (1 + self.system.size))
        pointers = [x.ctypes.data for x in (states, parameters, lanes, memory, rest)]
        while self._call(e.address, *pointers, 10**9) > 0: pass
        return e.codes
ROWS=512
