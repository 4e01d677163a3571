"""Signatures of compiled functions and kernels: the ctypes of result and arguments.

Pointers are the addresses of arrays: y, out, the memory p, or the state of a method.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

from lagsim.methods.parts import crossings, truth

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


_POINTER = ctypes.c_void_p
# Result and arguments of the functions of a model: t, y, p, out.
FUNCTION = (None, (ctypes.c_double, _POINTER, _POINTER, _POINTER))
PROJECTION = (None, (ctypes.c_double, _POINTER, _POINTER))
ADVANCE = (
    ctypes.c_int64,
    (_POINTER, _POINTER, _POINTER, ctypes.c_int64, ctypes.c_int64),
)
# Kernels that a run calls at an instant: of sections, and of conditions.
AT_SECTIONS: dict[Callable[..., Any], tuple[Any, Sequence[Any]]] = {
    crossings.update_relations: (None, (_POINTER, _POINTER)),
    crossings.finish: (None, (_POINTER, _POINTER, ctypes.c_double)),
}
AT_CONDITIONS: dict[Callable[..., Any], tuple[Any, Sequence[Any]]] = {
    truth.evaluate_with_bounds: (
        None,
        (_POINTER, _POINTER, ctypes.c_int64, ctypes.c_int64),
    ),
    truth.located_within: (ctypes.c_double, (_POINTER, _POINTER)),
    truth.wait: (ctypes.c_int64, (_POINTER, _POINTER)),
    truth.decide_before: (ctypes.c_int64, (_POINTER, _POINTER, ctypes.c_int64)),
    truth.mark_satisfied: (ctypes.c_int64, (_POINTER, _POINTER)),
    truth.mark_true: (None, (_POINTER, _POINTER)),
    truth.change: (ctypes.c_int64, (_POINTER, _POINTER)),
    truth.settle: (ctypes.c_int64, (_POINTER, _POINTER, ctypes.c_int64)),
    truth.choose_sides: (None, (_POINTER, _POINTER)),
}
# The signatures of these kernels by name. Other kernels at instants have FUNCTION.
AT_INSTANTS = {k.__name__: kind for k, kind in (AT_SECTIONS | AT_CONDITIONS).items()}
TABULATE = (
    None,
    (_POINTER, ctypes.c_int64, ctypes.c_int64, _POINTER, _POINTER, ctypes.c_int64),
)
