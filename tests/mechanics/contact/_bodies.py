"""Bodies that touch: rows that could act, in few words."""

import numpy as np

from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import Closed, delassus

CONTACT, SLIP = Kind.CONTACT, Kind.SLIP
G = 9.81


def closed(
    masses, rows, kinds, normals=None, pairs=None, mu=0.0, static=None, e=0.0, A=None
):
    """Give the rows (r, n) of bodies with masses (n,) or a mass matrix (n, n)."""
    M = np.diag(masses) if np.ndim(masses) == 1 else np.asarray(masses)
    rows = np.asarray(rows, float)
    r, n = rows.shape
    answer = delassus(M, np.zeros((0, n)) if A is None else np.asarray(A), rows)
    normals, pairs = normals or [-1] * r, pairs or [-1] * r
    numbers = (mu, mu if static is None else static, e)
    each = (np.zeros(r) + np.asarray(x, float) for x in numbers)
    return Closed(
        answer.D, tuple(kinds), tuple(normals), tuple(pairs), *each, answer.factor
    )


def none(r):
    return np.zeros(r)
