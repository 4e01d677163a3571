"""Kernels as plain Python, with what they call put in."""

from __future__ import annotations

from types import FunctionType

from lagsim.native.kernels.keys import as_kernel, is_own, names_in
from lagsim.native.kernels.words import is_external


def bind(
    function,
    externals,
    statics=None,
):
    """Give a kernel as plain Python, with its externals and statics put in.

    Parameters
    ----------
    externals : mapping
        By name, what stands for the functions marked `external`. One that is not given
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
        for name in names_in(code):
            value = names.get(name)
            if is_own(value):
                external = is_external(value)
                names[name] = (
                    externals.get(value.__name__, value) if external else copy(value)
                )
        names.update(statics or {})
        return copied

    return copy(as_kernel(function))
