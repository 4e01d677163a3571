"""Kernels as plain Python, with the functions that they call inserted."""

from __future__ import annotations

from types import FunctionType, ModuleType, SimpleNamespace

from lagsim.native.kernels.keys import as_kernel, is_own, names_in
from lagsim.native.kernels.words import is_external


def bind(
    function,
    externals,
    statics=None,
):
    """Return a kernel as plain Python, with its externals and statics inserted.

    Parameters
    ----------
    externals : mapping
        By name, replacements of the functions marked `external`. A function without one
        raises when called.
    statics : mapping, optional
        As for `translate`.

    Returns
    -------
    function
        A copy: the same code, so that debugger and coverage see the kernel's text.
    """
    copies: dict[FunctionType, FunctionType] = {}

    def copy(original):
        if original in copies:
            return copies[original]
        names = dict(original.__globals__)
        code, closure = original.__code__, original.__closure__
        copied = FunctionType(code, names, original.__name__, None, closure)
        copies[original] = copied
        used = names_in(code)
        for name in used:
            value = names.get(name)
            if isinstance(value, ModuleType):
                found = {n: put_in(x) for n, x in vars(value).items() if n in used}
                names[name] = SimpleNamespace(**found)
            elif is_own(value):
                names[name] = put_in(value)
        names.update(statics or {})
        return copied

    def put_in(value):
        if not is_own(value):
            return value
        external = is_external(value)
        return externals.get(value.__name__, value) if external else copy(value)

    return copy(as_kernel(function))
