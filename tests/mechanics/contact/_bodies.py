"""Bodies that touch, and the laws that forces between them have to satisfy."""

import numpy as np

from lagsim.mechanics.constraints import CONTACT, SLIP
from lagsim.mechanics.rows import Closed, RowTable, delassus

G = 9.81
COLUMNS = "low", "high", "gapped"


def closed(
    masses, rows, kinds, normals=None, pairs=None, mu=0.0, static=None, e=0.0, A=None
):
    """Return the rows (r, n) of bodies with masses (n,) or a mass matrix (n, n)."""
    M = np.diag(masses) if np.ndim(masses) == 1 else np.asarray(masses)
    rows = np.asarray(rows, float)
    r, n = rows.shape
    answer = delassus(M, np.zeros((0, n)) if A is None else np.asarray(A), rows)
    normals, pairs = normals or [-1] * r, pairs or [-1] * r
    numbers = (mu, mu if static is None else static, e)
    each = (np.zeros(r) + np.asarray(x, float) for x in numbers)
    columns = (np.array([getattr(kind, x) for kind in kinds]) for x in COLUMNS)
    low, high, gapped = columns
    normals, pairs = np.array(normals, dtype=int), np.array(pairs, dtype=int)
    newton = np.zeros(r, dtype=bool)
    table = RowTable(low, high, normals, pairs, gapped, newton)
    return Closed(table, answer.D, *each, answer.factor)


def touching(masses, rows, slips=0, *, kind=CONTACT, **numbers):
    """Return rows of contacts, each followed by `slips` slips."""
    kinds, normals, pairs = [], [], []
    for n in range(0, len(rows), 1 + slips):
        kinds += [kind, *[SLIP] * slips]
        normals += [-1, *[n] * slips]
        pairs += [-1, n + 2, n + 1] if slips == 2 else [-1] * (1 + slips)
    return closed(masses, rows, kinds, normals, pairs, **numbers)


def none(r):
    return np.zeros(r)


def broken(body, p, w, slack, mu=None):
    """Return the rows whose laws are violated by p (r,) and rates w (r,).

    Signorini's law of a contact: p, w >= 0, of which one is 0. Coulomb's law of its
    slips: a force within mu times p, and of this size against a slip that continues.
    """
    mu = body.bounds if mu is None else mu
    found = []
    normals, pairs = body.table.normals.tolist(), body.table.pairs.tolist()
    for k, (n, pair) in enumerate(zip(normals, pairs, strict=True)):
        if n < 0:
            wrong = abs(min(p[k], w[k])) > slack
        else:
            own = [k, pair] if pair >= 0 else [k]
            bound, slip = mu[k] * p[n], np.linalg.norm(w[own])
            short = bound + p[own] @ w[own] / slip if slip else 0.0
            wrong = np.linalg.norm(p[own]) > bound + slack or min(slip, short) > slack
        found += [k] if wrong else []
    return found
