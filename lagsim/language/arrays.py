"""Names of array types for signatures, which do not load numpy."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

Floats: TypeAlias = "npt.NDArray[np.float64]"
"""A one-dimensional array of doubles, unless stated otherwise."""
Flags: TypeAlias = "npt.NDArray[np.bool_]"
Ints: TypeAlias = "npt.NDArray[np.intp]"
Complexes: TypeAlias = "npt.NDArray[np.complex128]"
