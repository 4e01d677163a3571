"""What a scene of contact says, by sympy: M, f and the rows of all laws."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from tests.hunt.scene import Item, Law
from tests.sympy_oracle import Oracle


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


def rows_of(scene):
    """Give each row with its expression and its bound: slips follow their contacts."""
    found: list[tuple[Row, str, str]] = []
    for law in scene.terms("laws"):
        k = len(found)
        row = Row(law.kind, k, e=law.e, until=law.until)
        found.append((row, law.gap, law.limit or "0"))
        if law.slip:
            static = law.static or law.mu
            slip = Row("slip", k + 1, mu=law.mu, static=static, normal=k)
            found.append((slip, law.slip, "0"))
    return found


class Equations:
    """M, f and all rows as functions of t, q, v."""

    def __init__(self, scene):
        every = rows_of(scene)
        self.rows = [row for row, _, _ in every]
        held = Item("held", laws=tuple(Law("equality", text) for _, text, _ in every))
        items = tuple(replace(item, laws=()) for item in scene.items)
        o = Oracle(replace(scene, items=(*items, held)).text())
        speeds = {"wheel", "slip", "limit"}
        gaps = [
            sp.Integer(0) if row.kind in speeds else g
            for row, g in zip(self.rows, o.constraints, strict=True)
        ]
        bounds = [o.read(bound) for _, _, bound in every]
        # Within an arc each max(0, x) has its side: x is above 0, or not.
        bends = sorted(sp.Matrix(o.f).atoms(sp.Max), key=str)
        sides = sp.symbols(f"side:{len(bends)}")
        taken = {bend: x * bend.args[1] for bend, x in zip(bends, sides, strict=True)}
        f = [force.subs(taken) for force in o.f]
        flat = [*sp.flatten(o.M), *f, *sp.flatten(o.A), *o.b, *gaps, *o.rates]
        flat += [*bounds, *(bend.args[1] for bend in bends)]
        self.n, self.m, self.sides = len(o.q), len(gaps), np.zeros(len(bends))
        self._all = sp.lambdify(
            [*o.inputs, *sides], flat, cse=True,
            modules=["math", {"Heaviside": lambda x, *_: float(x > 0)}],
        )  # fmt: skip

    def at(self, t, y):
        """Give all there is at a state."""
        n, m = self.n, self.m
        x = np.array(self._all(t, *y, *self.sides), dtype=float)
        cuts = np.cumsum([n * n, n, m * n, m, m, m, m])
        M, f, A, b, gap, rate, bound, bends = np.split(x, cuts)
        return {
            "M": M.reshape(n, n), "f": f, "A": A.reshape(m, n), "b": b, "gap": gap,
            "rate": rate, "bound": bound, "bends": bends,
        }  # fmt: skip


def solved(M, A, C, f, b):
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
    held, s, closed, slips, values, e, small
):
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
