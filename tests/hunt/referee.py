"""The referee: equations by sympy, arcs by scipy, modes and impacts by trying all.

    M q'' = f + A^T lam,    A q'' = b

Each kink (`sign`, `abs`, `max`, `if`, ...) is a number u with a surface s: u = +1 where
s > 0 and -1 where s < 0, or between them where friction holds s = 0. Within an arc the
sides of kinks and the modes of laws stay as they are, so that all is smooth; at its end
every combination of what each law may do is tried, and the one that violates nothing is
taken. Two that do and differ, or none, or two motions that differ with the tolerance:
no truth.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp
from scipy.integrate import DOP853
from scipy.optimize import brentq, minimize_scalar

from tests.sympy_oracle import FUNCTIONS, Oracle, expression

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.hunt.scene import Scene

EPS = 2.0**-52
# What is this near to zero, against the terms it is made of, is zero.
NEAR = 1e-10
# So many intervals of each step are searched for a change of sign, or for two.
INTERVALS = 6
MOST_EVENTS, MOST_EVALUATIONS = 600, 200_000
# Signs that do not cancel: what the rounding of a state does to accelerations.
SIGNS = np.array([1, -1, -1, 1, -1, 1, 1, -1, 1, 1, -1] * 40, float)


class NoTruthError(Exception):
    """The referee gives no answer for this scene."""


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


def rows_of(scene: Scene) -> list[tuple[Row, str, str]]:
    """Give each row with its expression and its bound: slips follow their contacts."""
    found: list[tuple[Row, str, str]] = []
    for text in scene.gathered("constraints").values():
        left, right = text.split("=")
        found.append((Row("equality", len(found)), f"{left} - ({right})", "0"))
    for law in scene.terms("laws"):
        k = len(found)
        row = Row(law.kind, k, e=law.e, until=law.until)
        found.append((row, law.gap, law.limit or "0"))
        if law.slip:
            static = law.static or law.mu
            slip = Row("slip", k + 1, mu=law.mu, static=static, normal=k)
            found.append((slip, law.slip, "0"))
    return found


class Equations(Oracle):
    """M, f, all rows and all surfaces as functions of t, y = (q, v), p and sides u."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.sides: list[sp.Symbol] = []
        self.surfaces: list[sp.Expr] = []
        self.functions = FUNCTIONS | {
            "sign": self._side,
            "abs": lambda x: self._side(x) * x,
            "max": lambda x, y: (x + y + self._side(x - y) * (x - y)) / 2,
            "min": lambda x, y: (x + y - self._side(x - y) * (x - y)) / 2,
            "if": self._if,
        }
        super().__init__(scene.text())
        moving = {*self.q, *self.v}
        self.jerky = [bool(s.free_symbols & {*self.v}) for s in self.surfaces]
        self.timed = [not s.free_symbols & moving for s in self.surfaces]
        watched, self.descends = list(self.surfaces), "<" in scene.until
        if scene.until:
            left, right = scene.until.replace(">", "<").split("<=")
            sign = 1 if self.descends else -1
            watched.append(sign * (self.read(left) - self.read(right)))
        features = [
            self.read(text) / sp.Float(width) for text, width in scene.terms("features")
        ]
        gaps = [
            sp.Integer(0) if g.free_symbols & {*self.v} else g for g in self.constraints
        ]
        self.n, self.m, self.k = len(self.q), len(gaps), len(self.sides)
        inputs = [*self.inputs, *self.sides]
        state = [sp.flatten(self.M), self.f, sp.flatten(self.A), self.b, gaps,
                 self.rates, self.bounds]  # fmt: skip
        self.cuts = np.cumsum([len(part) for part in state])[:-1]
        self._state = _compiled(inputs, [e for part in state for e in part])
        self.watched = _compiled(inputs, watched)
        self.features = _compiled(inputs, features)
        rates = [self.rate(e) for e in (*self.surfaces, *features)]
        self._slopes = _compiled([*inputs, *self.a], rates)

    def read(self, text: str) -> sp.Expr:
        return expression(text, self.name, self.functions)

    def _constraints(self, _texts: Any) -> None:
        every = rows_of(self.scene)
        self.rows = [row for row, _, _ in every]
        self.constraints = [self.read(text) for _, text, _ in every]
        self.bounds = [self.read(bound) for _, _, bound in every]

    def _side(self, surface: sp.Expr) -> sp.Expr:
        """Give the side of a surface, the same for the same surface."""
        if surface.is_number:
            return sp.sign(surface)
        for side, known in zip(self.sides, self.surfaces, strict=True):
            for sign in (1, -1):
                if sp.expand(known - sign * surface) == 0:
                    return sign * side
        self.sides.append(sp.Symbol(f"side_{len(self.sides)}", real=True))
        self.surfaces.append(surface)
        return self.sides[-1]

    def _truth(self, condition: Any) -> sp.Expr:
        """Give +1 where a condition holds and -1 where not."""
        if isinstance(condition, (sp.And, sp.Or)):
            sign = -1 if isinstance(condition, sp.And) else 1
            none = sp.Mul(*((1 - sign * self._truth(c)) / 2 for c in condition.args))
            return sign * (1 - 2 * none)
        if isinstance(condition, (sp.Gt, sp.Ge)):
            return self._side(condition.lhs - condition.rhs)
        return self._side(condition.rhs - condition.lhs)

    def _if(self, condition: Any, a: sp.Expr, b: sp.Expr) -> sp.Expr:
        side = self._truth(condition)
        return (1 + side) / 2 * a + (1 - side) / 2 * b

    def at(self, t: float, y: Any, p: Any, u: Any) -> dict[str, Any]:
        """Give all there is at a state; nan where doubles hold none of it."""
        parts = np.split(self._state(t, *y, *p, *u), self.cuts)
        M, f, A, b, gap, rate, bound = parts
        return {
            "M": M.reshape(self.n, self.n), "f": f, "A": A.reshape(self.m, self.n),
            "b": b, "gap": gap, "rate": rate, "bound": bound,
        }  # fmt: skip

    def slopes(self, t: float, y: Any, p: Any, u: Any, a: Any) -> tuple[Any, Any]:
        """Give the rates of surfaces (k,) and of features along accelerations a."""
        found = self._slopes(t, *y, *p, *u, *a)
        return found[: self.k], found[self.k :]


_POWER = sp.Function("power")


def _power(base: float, exponent: float) -> float:
    """Give a broken power; a base that the last bit took below 0 counts as 0."""
    if base > 0.0:
        return math.sqrt(base) if exponent == 0.5 else base**exponent
    return 0.0 if exponent > 0.0 else math.inf


def _compiled(inputs: list[sp.Symbol], answers: list[sp.Expr]) -> Any:
    """Compile expressions to a function to (len(answers),) doubles."""
    plain = [
        e.replace(
            lambda x: x.is_Pow and not x.exp.is_integer,
            lambda x: _POWER(x.base, x.exp),
        )
        for e in answers
    ]
    words = {
        "power": _power,
        "cosh": lambda x: math.cosh(x) if abs(x) < 350.0 else math.inf,
    }
    made = sp.lambdify(inputs, plain, modules=[words, "math"], cse=True)

    def function(*values: float) -> Any:
        try:
            return np.array(made(*map(float, values)), dtype=float)
        except (ArithmeticError, ValueError):
            return np.full(len(answers), np.nan)

    return function


def solved(
    M: Any, A: Any, C: Any, f: Any, b: Any, *, checked: bool = True
) -> tuple[Any, Any]:
    """Solve M a = f + C^T x, A a = b; `checked`, for rows that depend on each other."""
    n, m = len(M), len(A)
    if not m:
        return np.linalg.solve(M, f), b
    d = 1.0 / np.sqrt(np.abs(np.diag(M)))
    size = np.linalg.norm(A * d, axis=1)
    if not np.all(size > 0.0):
        raise np.linalg.LinAlgError
    K = np.zeros((n + m, n + m))
    K[:n, :n], K[n:, :n] = M * np.outer(d, d), A * d / size[:, None]
    K[:n, n:] = -(C * d / size[:, None]).T
    if checked and np.linalg.cond(K) > 1e12:
        raise np.linalg.LinAlgError
    x = np.linalg.solve(K, np.concatenate([f * d, b / size]))
    return x[:n] * d, x[n:] / size


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


@dataclass(frozen=True)
class Effort:
    """How hard to try.

    nudge : the start, and parameters, are moved by so much of themselves
    over : bounces whose rest takes less than this part of the run are left out
    """

    tolerance: float
    nudge: float = 0.0
    over: float = 0.0


@dataclass
class Motion:
    """Rows (k, 2n) at times (k,), and what happened when; `range` : between steps."""

    rows: list[Any] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    impacts: list[float] = field(default_factory=list)
    impulses: int = 0
    # A row next to one of these may lie on either side.
    switched: list[float] = field(default_factory=list)
    stopped: bool = False
    range: Any = None
    rate: Any = None


class Referee:
    """Integrates a scene from event to event."""

    def __init__(self, equations: Equations, effort: Effort) -> None:
        self.eq, self.scene, self.effort = equations, equations.scene, effort
        scene, states = self.scene, self.scene.gathered("coordinates")
        speeds = [scene.start_velocity(q) for q in states]
        y = np.array([*(x for x, _ in states.values()), *speeds])
        p = np.array([*scene.gathered("parameters").values()], dtype=float)
        random = np.random.default_rng(7)
        if laws := scene.terms("laws"):
            free = [q in scene.terms("loose") for q in states]
            moved = np.max(np.abs(y)) * np.abs(random.normal(size=len(y)))
            y = y + effort.nudge * moved * [*free, *free]
        else:
            y = y * (1.0 + effort.nudge * random.choice([-1, 1], len(y)))
        if not (laws or self.eq.rows):  # else a length and a start no longer fit
            p = p * (1.0 + effort.nudge * random.choice([-1, 1], len(p)))
        self.t, self.y, self.p = scene.start, y, p
        self.u = np.ones(self.eq.k)
        self.stuck: list[int] = []
        self.mode: dict[int, int | None] = {}
        self.low = self.high = self.size = y
        self.evaluations = 0
        self.found = Motion()
        for _ in range(4):
            self._project()

    def motion(self) -> Motion:
        """Integrate; the row at an impact is the one after it."""
        times, found = self.scene.times, self.found
        ends = [r.until for r in self.eq.rows] + self.scene.terms("breaks")
        breaks = sorted({b for b in ends if self.t < b < times[-1]})
        with np.errstate(all="ignore"):
            later = [*breaks, times[-1]]
            self._look((self.t + later[0]) / 2)
            self.size = self._sizes()
            self._settle(later[0])
            for events in itertools.count():
                if events > MOST_EVENTS:
                    raise NoTruthError("too many events")
                end = next((b for b in later if b > self.t), None)
                if end is None or found.stopped or len(found.rows) == len(times):
                    break
                self._arc(times, end, later)
        found.times = [*times[: len(found.rows)]]
        if found.stopped or len(found.rows) < len(times):
            found.times.append(self.t)
            found.rows.append(self.y)
        found.range, found.rate = self.high - self.low, self._field(self.t, self.y)
        return found

    # -- one arc --------------------------------------------------------------------
    def _at(self, t: float, y: Any) -> dict[str, Any]:
        if self.stuck:
            self._balance(t, y)
        return self.eq.at(t, y, self.p, self.u)

    def _field(self, t: float, y: Any) -> Any:
        self.evaluations += 1
        if self.evaluations > MOST_EVALUATIONS:
            raise NoTruthError("too many evaluations")
        s = self._at(t, y)
        if not np.all(np.isfinite(s["f"])):
            return np.full(len(y), np.nan)
        try:
            return np.concatenate([y[self.eq.n :], self._motion(s, self.mode)[0]])
        except np.linalg.LinAlgError:
            raise NoTruthError("rows that depend on each other") from None

    def _cap(self, t: float, y: Any, a: Any) -> float:
        """Give the longest step that sees every feature: a quarter of its width."""
        longest = self.scene.duration / 20
        features = self.eq.features(t, *y, *self.p, *self.u)
        rates = self.eq.slopes(t, y, self.p, self.u, a)[1]
        for s, rate in zip(features, rates, strict=True):
            # Far away the next look need only be half way there.
            near = max(0.3, 0.4 * (abs(s) - 3.0))
            longest = min(longest, near / max(abs(rate), 1e-300))
        return longest

    def _sizes(self) -> Any:
        """Give what the forces at the place of the start do within one longest step.

        Without it the first trace of a pulse would have to be followed exactly.
        """
        t, end, n = self.t, self.t + self.scene.duration, self.eq.n
        most = np.zeros(2 * n)
        while t < end:
            self._look(t)
            dy = self._field(t, self.y)
            h = self._cap(t, self.y, dy[n:])
            a = np.abs(dy[n:])
            some = np.concatenate([np.abs(dy[:n]) * h + a * h * h, a * h])
            most = np.fmax(most, some)
            t += h
        return most

    def _scale(self, y: Any) -> Any:
        """Give how far each component moves: its range, or what it may do at once."""
        self.low, self.high = np.fmin(self.low, y), np.fmax(self.high, y)
        size, n = np.maximum(self.high - self.low, self.size), self.eq.n
        largest = np.repeat([np.max(size[:n]), np.max(size[n:])], n)
        return np.maximum(size, 1e-6 * largest) + 1e-300

    def _margins(self, t: float, y: Any) -> Any:
        """Give what must stay positive in this arc: rows, sides, `until`."""
        s = self._at(t, y)
        try:
            _, push = self._motion(s, self.mode)
        except np.linalg.LinAlgError:
            raise NoTruthError("rows that depend on each other") from None
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
        k, watched = self.eq.k, self._watched(t, y)
        sides = self.u * watched[:k]
        sides[self.stuck] = 1.0 - np.abs(self.u[self.stuck])
        sides[self.eq.timed] = 1.0
        return np.array([*found, *sides, *watched[k:]])

    def _most(self, r: Row, s: Any, push: Any) -> float:
        if r.kind == "limit":
            return float(s["bound"][r.number])
        return r.static * float(push[r.normal])

    def _in_force(self, r: Row) -> bool:
        return self.t < r.until

    def _arc(self, times: list[float], end: float, later: list[float]) -> None:
        """Go on to the first event, or to `end`; displacements, for their rounding."""
        origin, began, rows = self.y, self.t, self.found.rows
        laws = [r for r in self.eq.rows if r.kind != "equality"]
        watched = bool(laws or self.eq.k or self.scene.until)
        solver = DOP853(
            lambda t, z: self._field(t, origin + z), self.t, 0.0 * origin, end,
            rtol=self.effort.tolerance, first_step=min(1e-4 * self.scene.duration,
            end - self.t), atol=1.0,
        )  # fmt: skip
        while solver.status == "running":
            y, dy = origin + solver.y, solver.f
            moved = self._field(solver.t, y * (1.0 + EPS * SIGNS[: len(y)]))
            solver.max_step = self._cap(solver.t, y, dy[self.eq.n :])
            rounding = 4.0 * EPS * np.abs(y) + 4.0 * solver.h_abs * np.abs(moved - dy)
            solver.atol = 0.1 * self.effort.tolerance * self._scale(y) + rounding
            solver.step()
            if solver.status == "failed":
                raise NoTruthError("the step of the referee fails")
            dense = solver.dense_output()

            def state(t: float, dense: Any = dense) -> Any:
                return origin + dense(t)

            event = None
            if watched:
                event = self._first(state, solver.t_old, solver.t, began)
            stop = solver.t if event is None else event[0]
            while len(rows) < len(times) and (
                times[len(rows)] <= stop if event is None else times[len(rows)] < stop
            ):
                rows.append(state(times[len(rows)]))
            if event is None and solver.status == "running":
                continue
            self.t, self.y = stop, state(stop)
            self._scale(self.y)
            if event is not None and event[1] >= self.eq.m:
                self._switch(event[1] - self.eq.m)
            elif event is not None or len(rows) < len(times):
                if event is None:
                    self.found.switched.append(self.t)
                self._settle(next((b for b in later if b > self.t), self.t))
            return

    def _first(
        self, state: Any, left: float, right: float, began: float
    ) -> tuple[float, int] | None:
        """Give the first event of a step: when, and which margin."""
        times = np.linspace(left, right, INTERVALS + 1)
        values = np.array([self._margins(t, state(t)) for t in times])
        found = []
        for i, w in enumerate(values.T):

            def value(t: float, i: int = i) -> float:
                return float(self._margins(t, state(t))[i])

            below = np.flatnonzero(w[1:] < 0.0)
            j = int(below[0]) + 1 if len(below) else int(np.argmin(w))
            if len(below):
                low, high = times[j - 1], times[j]
            elif 0 < j < INTERVALS and w[j] < 0.2 * max(w[j - 1], w[j + 1]):
                # Twice through zero between two of the times, or nearly so.
                low = times[j - 1]
                high = minimize_scalar(
                    value, bounds=(low, times[j + 1]), method="bounded",
                    options={"xatol": 1e-9 * (right - left)},
                ).x  # fmt: skip
                if value(high) >= 0.0:
                    continue
            else:
                continue
            if w[j - 1] <= 0.0:
                # It begins at zero: find where it has come clear, if it has.
                tries = low + (high - low) * np.array([1e-6, 1e-4, 1e-2, 0.1, 0.5])
                clear = [t for t in tries if value(t) > 0.0]
                if not clear and i == self.eq.m + self.eq.k:
                    continue  # `until` holds from the start: it ends when it does anew
                if not clear:
                    size = 1e-9 * max(1.0, float(np.max(np.abs(self.y))))
                    if not (w[j] > -size and low == began):
                        found.append((low, i))
                    continue
                low = clear[-1]
            near = 1e-15 * self.scene.duration
            found.append((float(brentq(value, low, high, xtol=near, rtol=1e-15)), i))
        return min(found) if found else None

    # -- sides of kinks -------------------------------------------------------------
    def _watched(self, t: float, y: Any) -> Any:
        return self.eq.watched(t, *y, *self.p, *self.u)

    def _look(self, t: float) -> None:
        """Take all sides from where the state is; inner kinks stand before outer."""
        self.stuck = []
        for k in range(self.eq.k):
            self.u[k] = 1.0 if self._watched(t, self.y)[k] > 0.0 else -1.0

    def _slopes(self) -> Any:
        """Give the rates of the surfaces, with the sides as they are."""
        s = self._at(self.t, self.y)
        a, _ = self._motion(s, self.mode)
        return self.eq.slopes(self.t, self.y, self.p, self.u, a)[0]

    def _balance(self, t: float, y: Any) -> None:
        """Choose the sides of stuck surfaces so that these stay where they are."""

        def rates(values: Any) -> Any:
            self.u[self.stuck] = values
            a, _ = self._motion(self.eq.at(t, y, self.p, self.u), self.mode)
            return self.eq.slopes(t, y, self.p, self.u, a)[0][self.stuck]

        unit = np.eye(len(self.stuck))
        base = rates(0.0 * unit[0])
        B = np.array([rates(row) - base for row in unit]).T
        try:
            self.u[self.stuck] = np.linalg.solve(B, -base)
        except np.linalg.LinAlgError:
            raise NoTruthError("friction that does not act on its slip") from None

    def _choose(self, k: int) -> None:
        """Choose the side of surface k, which the state is on: where it goes to."""
        if k in self.stuck:
            self.stuck.remove(k)
        went = {}
        for side in (1, -1):
            self.u[k] = side
            went[side] = self._slopes()[k]
        if went[1] > 0.0 and went[-1] > 0.0:
            self.u[k] = 1.0
        elif went[1] < 0.0 and went[-1] < 0.0:
            self.u[k] = -1.0
        elif self.eq.jerky[k] and went[1] <= 0.0 <= went[-1]:
            self.stuck.append(k)
        else:
            raise NoTruthError("a start that may leave a surface on either side")

    def _sided(self, later: float) -> None:
        """Choose all sides anew, those of t alone by the middle of what follows."""
        timed = np.array(self.eq.timed, dtype=bool)
        self._look((self.t + later) / 2)
        ruled = self.u.copy()
        self._look(self.t)
        self.u[timed] = ruled[timed]
        now = self._watched(self.t, self.y)
        near = self._watched(self.t, self.y * (1.0 + 16.0 * EPS))
        for k in np.flatnonzero(~timed):
            if abs(now[k]) <= abs(near[k] - now[k]) + 1e-30:
                self._choose(int(k))

    def _switch(self, k: int) -> None:
        """Pass through surface k, or begin or end to stay on it; k is `until` last."""
        if k == self.eq.k:
            self.found.stopped = True
            return
        self.found.switched.append(self.t)
        if k in self.stuck:
            self.stuck.remove(k)
            self.u[k] = np.sign(self.u[k])
        elif self.eq.jerky[k]:
            self._choose(k)
        else:
            self.u[k] = -self.u[k]
        for other in list(self.stuck):
            self._balance(self.t, self.y)
            if other in self.stuck and abs(self.u[other]) > 1.0:
                self.stuck.remove(other)
                self.u[other] = np.sign(self.u[other])

    # -- what holds -----------------------------------------------------------------
    def _motion(
        self, s: Any, mode: dict[int, int | None], *, checked: bool = False
    ) -> tuple[Any, Any]:
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
        C = np.array(columns).reshape(-1, n)
        a, x = solved(s["M"], A[held], C, f, s["b"][held], checked=checked)
        push = np.zeros(self.eq.m)
        push[held] = x
        for r in self.eq.rows:
            m = mode.get(r.number)
            if m and r.kind == "slip":
                push[r.number] = -m * r.mu * push[r.normal]
            elif m and r.kind == "limit":
                push[r.number] = -m * s["bound"][r.number]
        return a, push

    def _column(self, r: Row, A: Any, mode: dict[int, int | None]) -> Any:
        column = A[r.number].copy()
        for other in self.eq.rows:
            m = mode.get(other.number)
            if other.kind == "slip" and other.normal == r.number and m:
                column -= m * other.mu * A[other.number]
        return column

    def _settle(self, later: float) -> None:
        """Let strike what approaches; then find the sides and modes that go on."""
        for _ in range(20):
            self._project()
            self._sided(later)
            s = self._at(self.t, self.y)
            if not self._strike(s):
                break
        else:
            raise NoTruthError("impacts without end")
        s = self._at(self.t, self.y)
        scale = 1.0 + float(np.max(np.abs(self.y)))
        found: list[tuple[Any, dict[int, int | None]]] = []
        for mode in self._choices(s, scale):
            try:
                a, push = self._motion(s, mode, checked=True)
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

    def _touching(self, s: Any, scale: float) -> list[int]:
        some = []
        for r in self.eq.rows:
            k, rate = r.number, s["rate"][r.number]
            near = abs(s["gap"][k]) <= NEAR * scale and abs(rate) <= 1e2 * NEAR * scale
            if (r.kind == "contact" and self._in_force(r) and near) or (
                r.kind == "wheel" and abs(rate) <= NEAR * scale
            ):
                some.append(k)
        return some

    def _choices(self, s: Any, scale: float) -> Iterator[dict[int, int | None]]:
        touching = set(self._touching(s, scale))
        options: list[list[int | None]] = []
        for r in self.eq.rows:
            rate = s["rate"][r.number]
            moves = abs(rate) > 1e2 * NEAR * scale
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

    def _fits(self, s: Any, mode: Any, a: Any, push: Any, scale: float) -> bool:
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
                still = abs(s["rate"][k]) <= 1e2 * NEAR * scale
                if still and m * acc[k] < -small:
                    return False
        return True

    # -- impacts --------------------------------------------------------------------
    def _strike(self, s: Any) -> bool:
        """Let what approaches strike; tell whether it did."""
        scale = 1.0 + float(np.max(np.abs(self.y)))
        small = NEAR * scale
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
            self.found.impulses += found[0][1]
            self.found.impacts.append(self.t)
        self.y = np.concatenate([self.y[: self.eq.n], self.y[self.eq.n :] + v])
        return True

    def _restitution(self, r: Row, s: Any) -> float:
        """Give e, or 0 where what is left of the bounces is over in no time."""
        rate, k = s["rate"][r.number], r.number
        if r.kind == "wheel" or r.e == 0.0 or rate >= 0.0:
            return 0.0
        free = {i: m for i, m in self.mode.items() if i != k}
        free |= {o.number: None for o in self.eq.rows if o.normal == k}
        a, _ = self._motion(s, free)
        pull = -(s["A"][k] @ a - s["b"][k])
        brief = self.effort.over * self.scene.duration * (1 - r.e)
        if pull > 0.0 and r.e < 1.0 and -2 * r.e * rate / pull < brief:
            return 0.0
        return r.e

    def _project(self) -> None:
        """Bring the state back onto what holds, and is off by rounding of steps."""
        some: list[int] = [
            r.number for r in self.eq.rows
            if (r.kind == "equality" and self._in_force(r))
            or (r.kind == "contact" and self.mode.get(r.number) is not None)
        ]  # fmt: skip
        for _ in range(2):
            self._take("gap", some, 0)
        self._slow([k for k in some if self.eq.rows[k].kind == "equality"])

    def _slow(self, some: list[int]) -> None:
        """Take from velocities what these rows forbid."""
        self._take("rate", some, self.eq.n)

    def _take(self, name: str, some: list[int], first: int) -> None:
        """Take residuals of rows from positions or velocities, by the least change."""
        if not some:
            return
        s = self.eq.at(self.t, self.y, self.p, self.u)
        A = s["A"][some]
        W = np.linalg.solve(s["M"], A.T)
        less = W @ np.linalg.lstsq(A @ W, s[name][some], rcond=None)[0]
        self.y = self.y.copy()
        self.y[first : first + self.eq.n] -= less
