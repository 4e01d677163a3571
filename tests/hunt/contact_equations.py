"""What a scene of contact says, by sympy: M, f and the rows of all laws."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

if TYPE_CHECKING:
    from tests.hunt.contacts import ContactScene


@dataclass(frozen=True)
class Row:
    """One law: what it does to velocities, and its number among all rows."""

    kind: str  # equality, contact, wheel, slip, limit
    number: int
    e: float = 0.0
    mu: float = 0.0
    static: float = 0.0
    normal: int = -1
    until: float = np.inf


class Equations:
    """M, f and all rows as functions of t, q, v."""

    def __init__(self, scene: ContactScene) -> None:
        t = sp.Symbol("t", real=True)
        q = [sp.Symbol(x, real=True) for x in scene.q]
        v = [sp.Symbol(f"{x}_dot", real=True) for x in scene.q]
        names = {str(s): s for s in [t, *q, *v]} | {
            "hypot": lambda a, b: sp.sqrt(a**2 + b**2), "max": sp.Max,
        }  # fmt: skip

        def read(text: str) -> Any:
            # The text is this hunt's own.
            return sp.sympify(text.replace("^", "**"), locals=names)  # noqa: TID251

        T, V = read(scene.kinetic), read(scene.potential)
        L = T - V
        p = [sp.diff(L, x) for x in v]
        f = []
        for i, x in enumerate(q):
            moved = sum(sp.diff(p[i], y) * w for y, w in zip(q, v, strict=True))
            force = read(scene.forces.get(scene.q[i], "0"))
            f.append(sp.diff(L, x) - moved - sp.diff(p[i], t) + force)
        self.rows: list[Row] = []
        gaps, speeds, bounds = [], [], []

        def add(gap: Any, speed: Any, kind: str, bound: Any = 0, **law: Any) -> int:
            self.rows.append(Row(kind, len(self.rows), **law))
            gaps.append(gap)
            speeds.append(speed)
            bounds.append(bound)
            return len(self.rows) - 1

        def rate(g: Any) -> Any:
            along = sum(sp.diff(g, x) * w for x, w in zip(q, v, strict=True))
            return along + sp.diff(g, t)

        for law in scene.laws:
            g = read(law.gap)
            if law.kind == "limit":
                add(sp.Integer(0), g, "limit", read(law.limit))
            elif law.kind == "wheel":
                add(sp.Integer(0), g, "wheel")
            else:
                k = add(g, rate(g), law.kind, e=law.e, until=law.until)
                if law.slip:
                    s = read(law.slip)
                    add(
                        sp.Integer(0), s, "slip", mu=law.mu,
                        static=law.static or law.mu, normal=k,
                    )  # fmt: skip
        A = [[sp.diff(s, w) for w in v] for s in speeds]
        b = [
            -sum(sp.diff(s, x) * w for x, w in zip(q, v, strict=True)) - sp.diff(s, t)
            for s in speeds
        ]
        M = [[sp.diff(x, w) for w in v] for x in p]
        every = [*itertools.chain(*M), *f, *itertools.chain(*A), *b, *gaps, *speeds]
        self.n, self.m = len(q), len(gaps)
        self._all = sp.lambdify(
            [t, *q, *v], [*every, *bounds], modules=["math", {"Max": max, "Min": min,
            "Heaviside": lambda x, *_: float(x > 0)}], cse=True,
        )  # fmt: skip

    def at(self, t: float, y: Any) -> dict[str, Any]:
        """Give all there is at a state."""
        n, m = self.n, self.m
        x = np.array(self._all(t, *y), dtype=float)
        cuts = np.cumsum([n * n, n, m * n, m, m, m])
        M, f, A, b, gap, rate, bound = np.split(x, cuts)
        return {
            "M": M.reshape(n, n), "f": f, "A": A.reshape(m, n), "b": b, "gap": gap,
            "rate": rate, "bound": bound,
        }  # fmt: skip


def solved(M: Any, A: Any, C: Any, f: Any, b: Any) -> tuple[Any, Any]:
    """Solve M a = f + C^T x, A a = b."""
    n, m = len(M), len(A)
    K = np.zeros((n + m, n + m))
    K[:n, :n], K[:n, n:], K[n:, :n] = M, -C.T, A
    scale = np.max(np.abs(K), axis=1)
    if np.any(scale == 0.0):
        raise np.linalg.LinAlgError
    right = np.concatenate([f, b]) / scale
    K = K / scale[:, None]
    if m and np.linalg.cond(K) > 1e12:
        raise np.linalg.LinAlgError
    x = np.linalg.solve(K, right)
    return x[:n], x[n:]


def outcome(  # noqa: C901
    held: list[int], s: Any, closed: Any, slips: Any, values: Any, e: Any, small: float
) -> tuple[Any, int] | None:
    """Give what impulses of these kinds add to velocities, if they break no law."""
    n, A, rate, rows = len(s["M"]), s["A"], s["rate"], list(held)
    columns, change = [A[k] for k in rows], [0.0 - rate[k] for k in rows]
    normals, tangents = {}, {}
    for r, m in zip(closed, values, strict=True):
        k = r.number
        if m is None:
            continue
        column = A[k].copy()
        slip = slips.get(k)
        if slip is not None and m:
            column -= m * slip.mu * A[slip.number]
        normals[k] = len(rows)
        rows.append(k)
        columns.append(column)
        change.append(-(1 + e[k]) * rate[k])
        if slip is not None and m == 0:
            tangents[k] = len(rows)
            rows.append(slip.number)
            columns.append(A[slip.number])
            change.append(-rate[slip.number])
    try:
        dv, p = solved(
            s["M"], A[rows], np.array(columns).reshape(-1, n), np.zeros(n),
            np.array(change),
        )  # fmt: skip
    except np.linalg.LinAlgError:
        return None
    after, tiny = rate + A @ dv, 10 * small
    struck = 0
    for r, m in zip(closed, values, strict=True):
        k = r.number
        if m is None:
            if after[k] < -e[k] * rate[k] - tiny:
                return None
            continue
        push, slip = p[normals[k]], slips.get(k)
        struck += push > tiny and r.kind == "contact"
        if push < -tiny:
            return None
        if slip is not None and m == 0 and abs(p[tangents[k]]) > slip.mu * push + tiny:
            return None
        if slip is not None and m and m * after[slip.number] < -tiny:
            return None
    return dv, int(struck)
