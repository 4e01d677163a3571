"""Contact without lagsim: derived by sympy, modes and impacts by trying all of them.

An arc is integrated by scipy; at its end every combination of what each law may do is
tried, and the one that violates nothing is taken. Two that do and differ, or none, or
two motions that differ with the tolerance: no truth.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq, minimize_scalar

from tests.hunt.contact_equations import outcome, solved
from tests.hunt.integrator import NoTruthError

# So many looks at each step for what changes its sign twice.
LOOKS = 8
MOST = 600


@dataclass
class Path:
    """A motion: rows (k, 2n) at the times asked for, and what happened when."""

    rows: list[Any] = field(default_factory=list)
    impacts: list[float] = field(default_factory=list)
    impulses: int = 0


class Faller:
    """Integrates a scene from event to event.

    over : bounces whose rest takes less than this part of the run are left out
    near : what is so near to zero, against the terms it is made of, is zero
    """

    def __init__(self, scene, equations, tolerance, nudge, over, near):
        self.eq, self.scene, self.tolerance = equations, scene, tolerance
        self.over, self.near = over, near
        states = scene.gathered("coordinates")
        y = np.array([state[k] for k in (0, 1) for state in states.values()])
        random = np.random.default_rng(7)
        if nudge:
            size = np.maximum(np.abs(y), np.max(np.abs(y)))
            free = [q in scene.terms("loose") for q in states]
            y = y + nudge * size * np.abs(random.normal(size=len(y))) * [*free, *free]
        self.y, self.t = y, 0.0
        self.mode: dict[int, int | None] = {}

    def path(self, times):
        """Integrate; the row at an impact is the one after it."""
        path, k, events = Path(), 0, 0
        breaks = sorted({r.until for r in self.eq.rows if r.until < times[-1]})
        self._settle(path)
        while k < len(times):
            events += 1
            if events > MOST:
                raise NoTruthError("too many events")
            end = next((b for b in breaks if b > self.t), times[-1])
            k = self._arc(path, times, k, end)
        return path

    # -- one arc --------------------------------------------------------------------
    def _margins(self, t, y):
        """Give what must stay positive in this arc."""
        s = self.eq.at(t, y)
        _, push = self._motion(s, self.mode)
        found = []
        for r in self.eq.rows:
            mode = self.mode.get(r.number)
            if r.kind == "contact" and self._in_force(r):
                found.append(s["gap"][r.number] if mode is None else push[r.number])
            elif r.kind == "wheel":
                found.append(s["rate"][r.number] if mode is None else push[r.number])
            elif r.kind in ("slip", "limit") and mode is not None:
                most = self._most(r, s, push)
                size = abs(push[r.number])
                found.append(most - size if mode == 0 else mode * s["rate"][r.number])
            else:
                found.append(1.0)
        return np.array([*found, *(np.where(self.eq.sides, 1, -1) * s["bends"])])

    def _most(self, r, s, push):
        if r.kind == "limit":
            return float(s["bound"][r.number])
        return r.static * float(push[r.normal])

    def _in_force(self, r):
        return self.t < r.until

    def _arc(self, path, times, k, end):
        def field_(t, y):
            a, _ = self._motion(self.eq.at(t, y), self.mode)
            return np.concatenate([y[self.eq.n :], a])

        span = times[-1]
        solver = DOP853(
            field_, self.t, self.y, end, rtol=self.tolerance,
            atol=self.tolerance * 1e-2 * (1e-3 + np.max(np.abs(self.y))),
            max_step=span / 50, first_step=min(1e-4 * span, end - self.t),
        )  # fmt: skip
        ahead = self.y + 1e-9 * span * field_(self.t, self.y)
        self.eq.sides = self.eq.at(self.t, ahead)["bends"] > 0.0
        began, before = self.t, self._margins(self.t, self.y)
        while solver.status == "running":
            solver.step()
            if solver.status == "failed":
                raise NoTruthError("the step of the referee fails")
            dense, left = solver.dense_output(), solver.t_old
            first = None
            for t in np.linspace(left, solver.t, LOOKS + 1)[1:]:
                now = self._margins(t, dense(t))
                right, low = self._dip(dense, left, t, before, now)
                first = self._first(dense, left, right, before, low, began)
                if first is not None:
                    break
                left, before = t, now
            stop = solver.t if first is None else first
            while k < len(times) and times[k] <= stop and (
                first is None or times[k] < first
            ):  # fmt: skip
                path.rows.append(dense(times[k]))
                k += 1
            if first is not None or solver.status == "finished":
                self.t, self.y = stop, dense(stop)
                if k < len(times) or first is not None:
                    self._settle(path)
                return k
        return k

    def _dip(self, dense, left, right, before, now):
        """Give a time at which a margin is below 0 in between, or `right`; and all."""
        small = 1e-4 * (right - left)
        falls = self._margins(left + small, dense(left + small)) < before
        rises = self._margins(right - small, dense(right - small)) < now
        for i in np.flatnonzero(falls & rises & (np.minimum(before, now) > 0.0)):
            at = minimize_scalar(
                lambda t, i=i: self._margins(t, dense(t))[i],
                bounds=(left, right), method="bounded", options={"xatol": small},
            )  # fmt: skip
            if at.fun < 0.0:
                return at.x, self._margins(at.x, dense(at.x))
        return right, now

    def _first(self, dense, left, right, before, now, began):
        found = []
        for i, (a, b) in enumerate(zip(before, now, strict=True)):
            if not b < 0.0:
                continue
            low = left
            if a <= 0.0:
                # It begins at zero: find where it has come clear, if it has.
                tries = left + (right - left) * np.array([1e-6, 1e-4, 1e-2, 0.1, 0.5])
                clear = [t for t in tries if self._margins(t, dense(t))[i] > 0.0]
                if not clear:
                    size = 1e-9 * max(1.0, float(np.max(np.abs(self.y))))
                    if b > -size and left == began:
                        continue
                    found.append(left)
                    continue
                low = clear[-1]

            def value(t, i=i):
                return float(self._margins(t, dense(t))[i])

            found.append(float(brentq(value, low, right, xtol=1e-15, rtol=1e-15)))
        return min(found) if found else None

    # -- what holds -----------------------------------------------------------------
    def _motion(self, s, mode):
        """Solve for accelerations and forces with these modes."""
        n, A, f = self.eq.n, s["A"], s["f"].copy()
        held, columns = [], []
        for r in self.eq.rows:
            m = mode.get(r.number)
            if r.kind == "equality" and self._in_force(r):
                held.append(r.number)
                columns.append(A[r.number])
            elif r.kind == "slip" and m:
                pass
            elif r.kind == "limit" and m:
                f -= m * s["bound"][r.number] * A[r.number]
            elif m is not None:
                held.append(r.number)
                columns.append(self._column(r, A, mode))
        a, x = solved(
            s["M"], A[held], np.array(columns).reshape(-1, n), f, s["b"][held]
        )
        push = np.zeros(self.eq.m)
        push[held] = x
        for r in self.eq.rows:
            m = mode.get(r.number)
            if m and r.kind == "slip":
                push[r.number] = -m * r.mu * push[r.normal]
            elif m and r.kind == "limit":
                push[r.number] = -m * s["bound"][r.number]
        return a, push

    def _column(self, r, A, mode):
        column = A[r.number].copy()
        for other in self.eq.rows:
            m = mode.get(other.number)
            if other.kind == "slip" and other.normal == r.number and m:
                column -= m * other.mu * A[other.number]
        return column

    def _settle(self, path):
        for _ in range(20):
            self._project()
            s = self.eq.at(self.t, self.y)
            if not self._strike(s, path):
                break
        else:
            raise NoTruthError("impacts without end")
        s = self.eq.at(self.t, self.y)
        scale = 1.0 + float(np.max(np.abs(self.y)))
        found: list[tuple[Any, dict[int, int | None]]] = []
        for mode in self._choices(s, scale):
            try:
                a, push = self._motion(s, mode)
            except np.linalg.LinAlgError:
                continue
            if self._fits(s, mode, a, push, scale):
                found.append((a, mode))
        if not found:
            raise NoTruthError("no modes fit")
        size = 1.0 + max(float(np.max(np.abs(a))) for a, _ in found)
        if any(np.max(np.abs(a - found[0][0])) > 1e-6 * size for a, _ in found):
            raise NoTruthError("several motions")
        # Of those that are the same now the one that holds least: it may part.
        self.mode = found[0][1]
        kinds = ("contact", "wheel", "slip", "limit")
        still = [r.number for r in self.eq.rows
                 if (r.kind == "equality" and self._in_force(r))
                 or (r.kind in kinds and self.mode[r.number] == 0)]  # fmt: skip
        self._slow(still)

    def _touching(self, s, scale):
        some = []
        for r in self.eq.rows:
            k, rate = r.number, s["rate"][r.number]
            near = (
                abs(s["gap"][k]) <= self.near * scale
                and abs(rate) <= 1e2 * self.near * scale
            )
            if (r.kind == "contact" and self._in_force(r) and near) or (
                r.kind == "wheel" and abs(rate) <= self.near * scale
            ):
                some.append(k)
        return some

    def _choices(self, s, scale):
        touching = set(self._touching(s, scale))
        options: list[list[int | None]] = []
        for r in self.eq.rows:
            rate = s["rate"][r.number]
            moves = abs(rate) > 1e2 * self.near * scale
            if r.kind in ("contact", "wheel"):
                options.append([None, 0] if r.number in touching else [None])
            elif r.kind in ("slip", "limit"):
                some: list[int | None] = [int(np.sign(rate))] if moves else [0, 1, -1]
                options.append([*some, None] if r.kind == "slip" else some)
            else:
                options.append([None])
        for values in itertools.product(*options):
            mode = dict(enumerate(values))
            pairs = [r for r in self.eq.rows if r.kind == "slip"]
            if all((mode[r.number] is None) == (mode[r.normal] is None) for r in pairs):
                yield mode

    def _fits(self, s, mode, a, push, scale):
        size = 1.0 + float(np.max(np.abs(a))) + float(np.max(np.abs(push), initial=0.0))
        small = 1e-8 * size
        acc = s["A"] @ a - s["b"]
        touching = self._touching(s, scale)
        for r in self.eq.rows:
            k, m = r.number, mode[r.number]
            if r.kind in ("contact", "wheel"):
                if m is None and k in touching and acc[k] < -small:
                    return False
                if m is not None and push[k] < -small:
                    return False
            elif m == 0:
                if abs(push[k]) > self._most(r, s, push) + small:
                    return False
            elif m is not None:
                still = abs(s["rate"][k]) <= 1e2 * self.near * scale
                if still and m * acc[k] < -small:
                    return False
        return True

    # -- impacts --------------------------------------------------------------------
    def _strike(self, s, path):
        """Let what approaches strike; tell whether it did."""
        scale = 1.0 + float(np.max(np.abs(self.y)))
        small = self.near * scale
        closed = [
            r for r in self.eq.rows
            if (r.kind == "contact" and self._in_force(r)
                and s["gap"][r.number] <= small and s["rate"][r.number] <= 1e2 * small)
            or (r.kind == "wheel" and s["rate"][r.number] <= small)
        ]  # fmt: skip
        if not any(s["rate"][r.number] < -10 * small for r in closed):
            return False
        slips = {r.normal: r for r in self.eq.rows if r.kind == "slip"}
        e = {r.number: self._restitution(r, s) for r in closed}
        options: list[list[int | None]] = [
            [None, 0, 1, -1] if r.number in slips else [None, 0] for r in closed
        ]
        held = [
            r.number for r in self.eq.rows
            if r.kind == "equality" and self._in_force(r)
        ]  # fmt: skip
        found = []
        for values in itertools.product(*options):
            after = outcome(held, s, closed, slips, values, e, small)
            if after is not None:
                found.append(after)
        if not found:
            raise NoTruthError("no impact fits")
        v = found[0][0]
        if any(np.max(np.abs(w - v)) > 1e-7 * scale for w, _ in found):
            raise NoTruthError("several impacts")
        if found[0][1] > 0:
            path.impulses += found[0][1]
            path.impacts.append(self.t)
        self.y = np.concatenate([self.y[: self.eq.n], self.y[self.eq.n :] + v])
        return True

    def _restitution(self, r, s):
        """Give e, or 0 where what is left of the bounces is over in no time."""
        rate, k = s["rate"][r.number], r.number
        if r.kind == "wheel" or r.e == 0.0 or rate >= 0.0:
            return 0.0
        free = {i: m for i, m in self.mode.items() if i != k}
        free |= {o.number: None for o in self.eq.rows if o.normal == k}
        a, _ = self._motion(s, free)
        pull = -(s["A"][k] @ a - s["b"][k])
        span = self.scene.duration
        if (
            pull > 0.0
            and r.e < 1.0
            and -2 * r.e * rate / pull < self.over * span * (1 - r.e)
        ):
            return 0.0
        return r.e

    def _project(self):
        """Bring the state back onto what holds, and is off by rounding of steps."""
        n = self.eq.n
        some: list[int] = []
        for _ in range(2):
            s = self.eq.at(self.t, self.y)
            some = [
                r.number for r in self.eq.rows
                if (r.kind == "equality" and self._in_force(r))
                or (r.kind == "contact" and self.mode.get(r.number) is not None)
            ]  # fmt: skip
            if not some:
                return
            rows = s["A"][some]
            self.y[:n] -= np.linalg.lstsq(rows, s["gap"][some], rcond=None)[0]
        self._slow([k for k in some if self.eq.rows[k].kind == "equality"])

    def _slow(self, some):
        """Take from velocities what these rows forbid: the least change in M."""
        s, n = self.eq.at(self.t, self.y), self.eq.n
        if some:
            A = s["A"][some]
            W = np.linalg.solve(s["M"], A.T)
            self.y[n:] -= W @ np.linalg.lstsq(A @ W, s["rate"][some], rcond=None)[0]
