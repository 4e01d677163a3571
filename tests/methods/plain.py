"""The kernels in plain Python, on equations given as Python or on a linked model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.methods.parts import driver
from lagsim.run.system.runner import FUNCTION
from tests.kernels import bind

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from lagsim.run.system.runner import Runner


class Plain:
    """The kernels of a method, bound; what is called of the model is given by name."""

    def __init__(
        self, method: ModuleType, model: dict[str, Callable[..., Any]], **statics: bool
    ) -> None:
        self.method = method
        self.model = model
        none = {"CONSTRAINED": False, "UNTIL": False, "SWITCHES": False}
        none |= {"LOCALIZED": False, "ADAPTIVE": method.ADAPTIVE}
        self.statics = none | statics
        own = {"start", "step", "interpolate"}
        own |= {"interpolate_rates"} if method.ADAPTIVE else {"make"}
        self.driven = model | {name: self.kernel(name) for name in own}

    def kernel(self, name: str) -> Callable[..., Any]:
        """Give a kernel of the method."""
        called = self.model
        if name != "interpolate":
            called = called | {"interpolate": self.kernel("interpolate")}
        if name == "step" and not self.method.ADAPTIVE:
            called = called | {"make": self.kernel("make")}
        return bind(getattr(self.method, name), called, self.statics)

    def advance(self, s: Any, p: Any, out: Any, rows: int, budget: int) -> int:
        """Do what the native `advance` does; `out` is flat."""
        advance = bind(driver.advance, self.driven, self.statics)
        return int(advance(s, p, out, rows, budget))


def linked(runner: Runner) -> dict[str, Callable[..., Any]]:
    """Give the model's native functions, as kernels call them."""
    names = ["energies_masses", "terms", "observe", *runner.method.NEEDS]
    if "balance" in names:
        names.append("effort")
    else:
        names += ["derivative", "rounding"]
    if "lagrangian" in names:
        names += ["lagrangian_slopes", "inertia"]
    if runner.system.m:
        names += ["position_step", "velocity_step"]
    if runner.system.equations.model.until:
        names.append("until")
    if runner.system.inertias:
        names.append("inertias")
    return {name: _through(runner.engine.function(name, *FUNCTION)) for name in names}


def _through(call: Callable[..., Any]) -> Callable[..., Any]:
    def function(t: float, y: Any, p: Any, out: Any) -> None:
        call(t, y.ctypes.data, p.flat.ctypes.data, out.ctypes.data)

    return function
