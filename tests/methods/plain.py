"""The kernels in plain Python, on equations given as Python or on a linked model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.methods.parts import driver
from lagsim.methods.parts import state as at
from lagsim.methods.parts.switching import search_size
from lagsim.native.kernels.code import bind
from lagsim.run.system.runner import FUNCTION

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from lagsim.run.system.runner import Runner


MOST_SURFACES = 8


def fresh_state(method: ModuleType, y: Any, **header: float) -> Any:
    """Give the array of state at y; header words by their names in `_state`."""
    used = method.state_size(len(y))
    sizes = used + at.lanes_size(len(y))
    extents = sizes + 3 * len(y)
    searched = extents + at.extents_size(len(y))
    s = np.zeros(searched + search_size(MOST_SURFACES))
    s[at.LANES_AT], s[at.SIZES_BEFORE], s[at.EXTENTS_AT] = used, sizes, extents
    s[at.SEARCH_AT] = searched
    s[extents : extents + len(y)] = np.inf
    s[extents + len(y) : extents + 2 * len(y)] = -np.inf
    words = {"SIZE": len(y), "RTOL": 1e-9, "ATOL": -1.0, "HEALTH": 1.0, "FRESH": 1.0}
    words |= {"ROW_STEP": 1.0, "END": 1e9} | header
    for name, value in words.items():
        s[getattr(at, name)] = value
    s[at.HEADER : at.HEADER + len(y)] = y
    return s


def state_of(s: Any) -> Any:
    """Give y of a state: a copy."""
    return s[at.HEADER : at.HEADER + int(s[at.SIZE])].copy()


class Plain:
    """The kernels of a method, bound; what is called of the model is given by name."""

    def __init__(
        self, method: ModuleType, model: dict[str, Callable[..., Any]], **statics: bool
    ) -> None:
        self.method = method
        self.model = model
        none = {"CONSTRAINED": False, "UNTIL": False, "SWITCHES": False, "WIDE": False}
        none["SLEEPERS"] = False
        self.statics = none | statics
        own = {"start", "step", "interpolate"}
        self.driven = model | {name: self.kernel(name) for name in own}

    def kernel(self, name: str) -> Callable[..., Any]:
        """Give a kernel of the method."""
        return bind(getattr(self.method, name), self.model, self.statics)

    def advance(self, s: Any, p: Any, out: Any, rows: int, budget: int) -> int:
        """Do what the native `advance` does; `out` is flat."""
        advance = bind(driver.advance, self.driven, self.statics)
        return int(advance(s, p, out, rows, budget))


def exact(rates: int) -> dict[str, Callable[..., Any]]:
    """Give equations of so many rates no terms of their own, and no rounding."""

    def nothing(_t: float, _y: Any, _p: Any, out: Any) -> None:
        out[:rates] = 0.0

    return {"terms": nothing, "rounding": nothing}


def first_order(
    rate: Callable[[float, Any], Any], size: int
) -> dict[str, Callable[..., Any]]:
    """Give what the kernels call for y' = rate(t, y), y of `size` components."""

    def derivative(t: float, y: Any, _p: Any, out: Any) -> None:
        out[:size] = rate(t, y[:size])

    def measure(_t: float, _y: Any, _p: Any, out: Any) -> None:
        out[:2] = 0.0

    return {"derivative": derivative, "measure": measure, **exact(size)}


def linked(runner: Runner) -> dict[str, Callable[..., Any]]:
    """Give the model's native functions, as kernels call them."""
    names = ["derivative", "measure", "terms", "rounding", "observe"]
    names += runner.method.NEEDS
    if "lagrangian" in names:
        names += ["lagrangian_slopes", "inertia"]
    if runner.system.m:
        names += ["position_step", "velocity_step"]
    if runner.system.m and runner.system.wide:
        names += ["position_steps", "velocity_steps"]
    if runner.system.equations.model.until:
        names.append("until")
    return {name: _through(runner.engine.function(name, *FUNCTION)) for name in names}


def second_order(
    acceleration: Callable[[float, float], float],
    power: Callable[[float, float, float], float],
) -> dict[str, Callable[..., Any]]:
    """Give what the kernels call for q'' = acceleration(t, q), n = 1.

    Where y has three components, work' = power(t, q, q').
    """

    def derivative(t: float, y: Any, _p: Any, out: Any) -> None:
        out[0] = y[1]
        out[1] = acceleration(t, y[0])
        out[2:3] = power(t, y[0], y[1])

    def rate(t: float, y: Any, _p: Any, out: Any) -> None:
        out[0] = power(t, y[0], y[1])

    def measure(_t: float, _y: Any, _p: Any, out: Any) -> None:
        out[:4] = 0.0

    return {"derivative": derivative, "measure": measure, "power": rate, **exact(2)}


def _through(call: Callable[..., Any]) -> Callable[..., Any]:
    def function(t: float, y: Any, p: Any, out: Any) -> None:
        call(t, y.ctypes.data, p.ctypes.data, out.ctypes.data)

    return function
