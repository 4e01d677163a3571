"""The kernels in plain Python, on equations given as Python or on a linked model."""

from __future__ import annotations

import ctypes

from lagsim.methods.parts import driver, no_search, one_by_one, search
from lagsim.program.signatures import FUNCTION
from tests.kernels import bind


class Plain:
    """The kernels of a method, bound; the functions of the model are given by name."""

    def __init__(self, method, model, **statics):
        self.method = method
        self.model = model
        none = {"CONSTRAINED": False, "UNTIL": False, "SWITCHES": False}
        none |= {"LOCALIZED": False, "ADAPTIVE": method.ADAPTIVE}
        none |= {"PAIR": getattr(method, "PAIR", None)}
        none |= {"RATED": "balance" not in method.NEEDS}
        self.statics = none | statics
        own = {"start", "step", "interpolate"}
        own |= {"interpolate_rates"} if method.ADAPTIVE else {"make"}
        self.driven = model | {name: self.kernel(name) for name in own}
        may_end = self.statics["UNTIL"] or self.statics["SWITCHES"]
        ends = search if may_end else no_search
        rows = getattr(method, "interpolate_rows", one_by_one.interpolate_rows)
        for kernel in (ends.find_end, search.loses_rank, rows):
            self.driven[kernel.__name__] = bind(kernel, self.driven, self.statics)

    def kernel(self, name):
        """Return a kernel of the method."""
        called = self.model
        if name != "interpolate":
            called = called | {"interpolate": self.kernel("interpolate")}
        if name == "step" and not self.method.ADAPTIVE:
            called = called | {"make": self.kernel("make")}
        return bind(getattr(self.method, name), called, self.statics)

    def advance(self, s, p, out, rows, budget):
        """Integrate as the native `advance` does; `out` is flat."""
        advance = bind(driver.advance, self.driven, self.statics)
        return int(advance(s, p, out, rows, budget))


def linked(runner):
    """Return the model's native functions as callables for kernels."""
    names = ["energies_masses", "terms", "observe", *runner.method.NEEDS]
    if "balance" in names:
        names.append("effort")
    else:
        names += ["derivative", "rounding"]
    if "lagrangian" in names:
        names += ["lagrangian_slopes", "inertia"]
    if runner.system.m:
        names += ["position_step", "velocity_step"]
    if runner.system.equations.model.located:
        names += ["located", "located_slopes"]
    if runner.system.inertias:
        names.append("inertias")
    found = {name: _through(runner.engine.function(name, *FUNCTION)) for name in names}
    if "series" in names:
        found |= {
            "bend": _value(runner, "bend", 2),
            "slope": _value(runner, "slope", 2),
        }
        found |= {"weigh": _value(runner, "weigh", 4, numbers=0)}
        found |= {"reached": _value(runner, "reached", 4)}
        found |= {"reached_twice": _value(runner, "reached_twice", 4, numbers=2)}
        if runner.system.m and runner.system.plan.projected:
            found |= {"extend": _value(runner, "extend", 3)}
            found |= {"lengthen": _value(runner, "lengthen", 3, numbers=2)}
    return found


def _value(runner, name, arrays, numbers=1):
    kind = (None, [*[ctypes.c_double] * numbers, *[ctypes.c_void_p] * arrays])
    call = runner.engine.function(name, *kind)
    return lambda *given: call(
        *given[:numbers], *(x.ctypes.data for x in given[numbers:])
    )


def _through(call):
    def function(t, y, p, out):
        call(t, y.ctypes.data, p.flat.ctypes.data, out.ctypes.data)

    return function
