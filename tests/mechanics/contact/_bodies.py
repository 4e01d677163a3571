"""Bodies that touch: rows that could act, in few words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import Closed, delassus

if TYPE_CHECKING:
    from collections.abc import Sequence

CONTACT, SLIP = Kind.CONTACT, Kind.SLIP
G = 9.81


def closed(
    masses: Any,
    rows: Any,
    kinds: Sequence[Kind],
    normals: Sequence[int] | None = None,
    pairs: Sequence[int] | None = None,
    mu: Any = 0.0,
    static: Any = None,
    e: Any = 0.0,
    A: Any = None,
) -> Closed:
    """Give the rows (r, n) of bodies with masses (n,) or a mass matrix (n, n)."""
    M = np.diag(masses) if np.ndim(masses) == 1 else np.asarray(masses)
    rows = np.asarray(rows, float)
    r, n = rows.shape
    answer = delassus(M, np.zeros((0, n)) if A is None else np.asarray(A), rows)
    return Closed(
        answer.D,
        tuple(kinds),
        tuple(normals or [-1] * r),
        tuple(pairs or [-1] * r),
        np.full(r, mu) if np.ndim(mu) == 0 else np.asarray(mu, float),
        np.full(r, mu if static is None else static, float)
        if np.ndim(mu if static is None else static) == 0
        else np.asarray(mu if static is None else static, float),
        np.full(r, e, float) if np.ndim(e) == 0 else np.asarray(e, float),
        answer.factor,
    )


def none(r: int) -> np.ndarray:
    return np.zeros(r)
