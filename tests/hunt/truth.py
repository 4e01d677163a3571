"""Motion of a scene by the referee, in smooth arcs between kinks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.hunt.integrator import Extrapolation, Long, NoTruthError

# Halvings and secants until a crossing is located to the last bits.
LOCATING = 200
# Switches in one run, at most: past it friction chatters and is no test.
MOST_EVENTS = 400
PROJECTIONS = 4


@dataclass(frozen=True)
class Effort:
    """Effort of the integration; `nudge` changes the start, in units of 2^-52."""

    columns: int = 8
    tolerance: float = 1e-16
    most: int = 150_000
    nudge: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Motion:
    """Rows at some times.

    q, v, a : (k, n), positions, velocities, accelerations
    lam : (k, m), multipliers
    end : the time at which the motion stopped
    """

    times: Any
    q: Any
    v: Any
    a: Any
    lam: Any
    end: float
    stopped: bool
    events: int
    evaluations: int
    # Times at which something switched: a row next to one may lie on either side.
    switched: tuple[float, ...] = ()
    # Of q and v between all steps, not of the rows alone.
    range: Any = None


class Run:
    """One integration of one scene."""

    def __init__(self, mechanics, effort):
        self.m, self.effort = mechanics, effort
        self.n = len(mechanics.q)
        self.p = list(mechanics.values)
        self.u = [Long(1)] * len(mechanics.sides)
        self.stuck: list[int] = []
        self.switched: list[float] = []
        self.method = Extrapolation(
            self.slope, self.cap, effort.columns, effort.tolerance, effort.most
        )

    # The equations, with the sides as they are

    def acceleration(self, t, y):
        return self._forced(t, y)[0]

    def _forced(self, t, y):
        """Return q'' (n,) and lam (m,)."""
        state = list(y)
        if self.stuck:
            self._balance(t, state)
        return self.m.motion(t, state, self.p, self.u)

    def _balance(self, t, state):
        """Choose the sides of stuck surfaces so that these stay where they are."""

        def rates(values):
            for k, value in zip(self.stuck, values, strict=True):
                self.u[k] = Long(value)
            a, _ = self.m.motion(t, state, self.p, self.u)
            slopes = self.m.slopes([t], state, self.p, self.u, a)
            return np.array([slopes[k] for k in self.stuck])

        count = len(self.stuck)
        base = rates([0.0] * count)
        B = np.array([rates(list(row)) - base for row in np.eye(count)]).T
        try:
            u = np.linalg.solve(B.astype(float), -base.astype(float)).astype(Long)
            for _ in range(3):  # numpy solves in double: refine in long double
                rest = base + B @ u
                u = u - np.linalg.solve(B.astype(float), rest.astype(float))
        except np.linalg.LinAlgError:
            raise NoTruthError("friction that does not act on its slip") from None
        for k, value in zip(self.stuck, u, strict=True):
            self.u[k] = value

    def slope(self, t, y):
        return np.concatenate([y[self.n :], self.acceleration(t, y)])

    def cap(self, t, y, dy):
        """Return the longest step that resolves every feature: 1/4 of its width."""
        longest = float(self.m.scene.duration) / 20
        if not self.m.features:
            return longest
        looks = self.m.looks([t], list(y), self.p, list(dy[self.n :]))
        half = len(looks) // 2
        for s, rate in zip(looks[:half], looks[half:], strict=True):
            # Far away the next look need only be half way there.
            near = max(0.3, 0.4 * (abs(float(s)) - 3.0))
            longest = min(longest, near / max(abs(float(rate)), 1e-300))
        return longest

    # The start

    def start(self):
        scene = self.m.scene
        pairs = list(scene.gathered("coordinates").items())
        q = [Long(value) for _, (value, _) in pairs]
        v = [Long(scene.start_velocity(name)) for name, _ in pairs]
        y = np.array([*q, *v], Long)
        rng = np.random.default_rng(self.effort.seed)
        unit = Long(self.effort.nudge) * Long(2) ** -52
        y = y * (1 + unit * rng.choice([-1, 1], len(y)))
        signs = rng.choice([-1, 1], len(self.p))
        if not self.m.constraints:  # else a length and a start no longer fit
            self.p = [p * (1 + unit * s) for p, s in zip(self.p, signs, strict=True)]
        t = Long(scene.start)
        return t, self.projected(t, y, far=True)

    def projected(self, t, y, *, far=False):
        """Bring a state back onto the constraints, by the least change in M."""
        if not self.m.constraints:
            return y
        y = y.copy()
        for _ in range(PROJECTIONS if far else 1):
            y[: self.n] += self.m.positions(t, list(y), self.p)
        y[self.n :] += self.m.velocities(t, list(y), self.p)
        return y

    def sizes(self, t, y):
        """Return the changes that forces at the start cause within one longest step.

        Without these sizes the first trace of a pulse would have to be followed
        exactly.
        """
        end, most = t + Long(self.m.scene.duration), np.zeros(2 * self.n, Long)
        while t < end:
            self.look(t, y)
            dy = self.slope(t, y)
            h = Long(self.cap(t, y, dy))
            a = np.abs(dy[self.n :])
            most = np.maximum(most, np.concatenate([a * h * h, a * h]))
            t = t + h
        return most

    # Sides

    def surfaces(self, t, y):
        return self.m.surfaces([t], list(y), self.p, self.u)

    def slopes(self, t, y):
        a = self.acceleration(t, y)
        return self.m.slopes([t], list(y), self.p, self.u, a)

    def look(self, t, y):
        """Set all sides by the position of the state, inner kinks before outer ones."""
        for k in range(len(self.u)):
            self.u[k] = Long(1) if self.surfaces(t, y)[k] > 0 else Long(-1)

    def choose(self, t, y, k, size):
        """Choose the side of surface k by its value, or, at 0, by its rate."""
        if k in self.stuck:
            self.stuck.remove(k)
        s = self.surfaces(t, y)[k]
        if abs(s) > size:
            self.u[k] = Long(np.sign(s))
            return
        went = {}
        for side in (1, -1):
            self.u[k] = Long(side)
            went[side] = self.slopes(t, y)[k]
        if went[1] > 0 and went[-1] > 0:
            self.u[k] = Long(1)
        elif went[1] < 0 and went[-1] < 0:
            self.u[k] = Long(-1)
        elif self.m.jerky[k] and went[1] <= 0 <= went[-1]:
            self.stuck.append(k)
        else:
            raise NoTruthError("a start that may leave a surface on either side")

    def settle(self, t, y, later):
        """Choose all sides again, those of t alone by the middle of the next piece."""
        self.stuck = []
        self.look((t + later) / 2, y)
        ruled = list(self.u)
        self.look(t, y)
        for k, on_time in enumerate(self.m.timed):
            self.u[k] = ruled[k] if on_time else self.u[k]
        now = self.surfaces(t, y)
        for k, on_time in enumerate(self.m.timed):
            if not on_time and abs(now[k]) <= self._size(t, y, k):
                self.choose(t, y, k, self._size(t, y, k))

    def _size(self, t, y, k):
        """Size below which a surface's value counts as 0: the rounding of its terms."""
        moved = self.surfaces(t, y * (1 + Long(2) ** -50))[k]
        return abs(moved - self.surfaces(t, y)[k]) + Long(10) ** -30


class Referee(Run):
    """Runs over arcs and rows."""

    def motion(self):
        scene = self.m.scene
        with np.errstate(all="ignore"):
            t, y = self.start()
            rows: list[Any] = []
            times = [Long(x) for x in scene.times]
            breaks = sorted(
                {Long(b) for b in scene.terms("breaks") if scene.start < b < times[-1]}
            )
            stopped = False
            self.method.sizes = self.sizes(t, y)
            self._begin(t, y, [*breaks, times[-1]])
            wanted = self._wanted(times)
            rows.append(self._row(t, y))
            for target in sorted({*wanted[1:], *breaks}):
                t, y, stopped = self._reach(t, y, target)
                if stopped or target in wanted:
                    rows.append(self._row(t, y))
                if stopped:
                    break
                if target in breaks:
                    self.switched.append(float(target))
                    self._begin(t, y, [b for b in [*breaks, times[-1]] if b > t])
        kept = [np.array([row[i] for row in rows]) for i in range(5)]
        return Motion(
            *kept, float(t), stopped, len(self.switched), self.method.evaluations,
            tuple(self.switched), self.method.high - self.method.low,
        )  # fmt: skip

    def _begin(self, t, y, later):
        if self.m.sides:
            self.settle(t, y, later[0] if later else t)
        self.method.step = None

    def _wanted(self, times):
        """Return about forty of the rows, evenly spaced, with both ends."""
        stride = -(-len(times) // 40)
        return sorted({*times[::stride], times[-1]})

    def _row(self, t, y):
        return t, y[: self.n], y[self.n :], *self._forced(t, y)

    def _reach(self, t, y, target):
        while t < target:
            h, dy, found, later = self.method.advance(t, y, target)
            event = self._first_event(t, y, dy, h, found)
            if event is None:
                t, y = later, self.projected(later, found)
                continue
            at, k = event
            found, _ = self.method.leap(t, y, dy, at)
            t = t + at
            y = self.projected(t, found)
            if k == len(self.u):
                return t, y, True
            self._switch(t, y, k)
        return target, y, False

    def _switch(self, t, y, k):
        self.switched.append(float(t))
        if len(self.switched) > MOST_EVENTS:
            raise NoTruthError("too many switches")
        if k in self.stuck:
            self.stuck.remove(k)
            self.u[k] = Long(np.sign(self.u[k]))
        elif self.m.jerky[k]:
            self.choose(t, y, k, np.inf)
        else:
            self.u[k] = -self.u[k]
        for other in list(self.stuck):
            self._balance(t, list(y))
            if other in self.stuck and abs(self.u[other]) > 1:
                self.stuck.remove(other)
                self.u[other] = Long(np.sign(self.u[other]))

    # Events

    def _watched(self, t, y):
        """Return functions that change their sign at an event, positive before it."""
        values = self.surfaces(t, y)
        count = len(self.u)
        if self.stuck:
            self._balance(t, list(y))
        watched = [
            1 - abs(self.u[k]) if k in self.stuck else self.u[k] * values[k]
            for k in range(count)
        ]
        for k, on_time in enumerate(self.m.timed):
            if on_time:
                watched[k] = Long(1)
        if self.m.scene.until:
            sign = 1 if "<" in self.m.scene.until else -1
            watched.append(sign * values[-1])
        return watched

    def _first_event(self, t, y, dy, h, found):
        """Return the time from t to the first event within a step, and its index.

        None if there is no event.

        y, dy : state and its rate at t
        found : the state after the step h
        """
        if not self.u and not self.m.scene.until:
            return None
        before, rates = self._watched(t, y), self._rates(t, y)

        def at(part):
            if part == h:
                return self._watched(t + h, found)
            state, _ = self.method.leap(t, y, dy, part)
            return self._watched(t + part, state)

        after, later = at(h), self._rates(t + h, found)
        first: tuple[Any, int] | None = None
        for k, value in enumerate(after):
            end = h if value < 0 else None
            fall = h * max(-rates[k], later[k])
            if end is None and rates[k] < 0 < later[k] and min(before[k], value) < fall:
                end = self._dip(t, y, dy, h, k)
            if end is None:
                continue
            low = self._positive(at, k, end, before)
            if low is None:
                continue
            where = _root(lambda s, k=k: at(s)[k], low, end)
            if first is None or where < first[0]:
                first = (where, k)
        return first

    def _rates(self, t, y):
        """Return the rates of watched functions, of stuck surfaces by differences."""
        slopes = self.slopes(t, y)
        rates = [u * s for u, s in zip(self.u, slopes, strict=False)]
        if self.stuck:
            after = Long(self.m.scene.duration) * Long(2) ** -30
            near = [self._watched(t + x, y + x * self.slope(t, y)) for x in (after, 0)]
            for k in self.stuck:
                rates[k] = (near[0][k] - near[1][k]) / after
        sign = 1 if "<" in self.m.scene.until else -1
        return [*rates, sign * slopes[-1]] if self.m.scene.until else rates

    def _positive(self, at, k, end, before):
        """Return a time before `end` at which the watched number is positive."""
        if before[k] > 0:
            return Long(0)
        part = end
        for _ in range(60):
            part = part / 2
            if at(part)[k] > 0:
                return part
        # It was not positive to begin with: on the other side since the start.
        if k == len(self.u):
            return None
        return Long(0)

    def _dip(self, t, y, dy, h, k):
        """Return a time within the step at which the number is negative, if any.

        It falls at the start and rises at the end: least where its rate vanishes.
        """

        def fall(part):
            state, _ = self.method.leap(t, y, dy, part)
            return -self._rates(t + part, state)[k]

        where = _root(fall, Long(0), h, 1e-9 * h)
        state, _ = self.method.leap(t, y, dy, where)
        return where if self._watched(t + where, state)[k] < 0 else None


def _root(value, low, high, near=0):
    """Locate a change of sign: regula falsi, Illinois, with halvings."""
    a, b = value(low), value(high)
    for k in range(LOCATING):
        if high - low <= max(near, 4 * np.spacing(high)) or b == 0:
            break
        middle = (low + high) / 2
        if k % 4 != 3 and a > 0 > b:
            middle = (low * -b + high * a) / (a - b)
        if not low < middle < high:
            middle = (low + high) / 2
            if not low < middle < high:
                break
        c = value(middle)
        if c > 0:
            low, a, b = middle, c, b / 2 if k % 4 != 3 else b
        else:
            high, b, a = middle, c, a / 2 if k % 4 != 3 else a
    return high
