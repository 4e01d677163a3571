"""The referee's run of a random model: from instant to instant.

An arc ends at the first root of all watched functions: arguments of switches,
multipliers at their bounds, gaps, rates of slips, relations of sections. At an instant
impacts, acts of events and a choice of cells and modes follow one another until the
state no longer changes.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from tests.hunt.flights import Flights, Script, given
from tests.hunt.series import (
    GRAZES,
    LITTLE,
    UndecidedError,
    constant,
    first_root,
    first_sign,
    powers,
    radius,
)
from tests.hunt.trees import HALVES, KINDS, TIE

# Instants closer than the first are one, and closer than the second undecided.
ONE_INSTANT, NEAR = 1e-12, 1e-8
# A flight between impacts may be this low: what little is missed moves little.
FLAT = 1e-14
# Speeds after an impact below this are rest on the contact that pushes back.
SPENT = 1e-7
LONGEST_STEP, MOST_INSTANTS, LARGEST = 0.5, 300, 1e6


class ChatterError(Exception):
    """Events undo each other at an instant, and no time passes."""


class Run:
    """One integration of a model: `made` fills rows, events, crossings, instants.

    rows : (t, q and v and z, modes, accelerations, shown, multipliers) by output time
    events : (t, name)
    crossings : section -> (t, values, modes)
    instants : times, and whether only clocks made them
    chatters : when events undo each other without end, or None
    """

    def __init__(self, model, step, forks=None):
        self.m, self.step, self.flights = model, step, Flights(model, forks)
        self.chatters: float | None = None
        self.rows: list[Any] = []
        self.events: list[tuple[float, str]] = []
        self.crossings: dict[str, list[Any]] = {s.name: [] for s in model.sections}
        self.instants: list[tuple[float, bool]] = []
        self.done = False
        self._spent: set[str] = set()
        self._was: dict[str, bool] = {}
        self._side: dict[Any, float] = {}
        clocks = [x for x in (*model.events, *model.sections) if x.every]
        self._due = dict.fromkeys((x.name for x in clocks), 0)
        self._periods = {x.name: x.every for x in clocks}
        self._next_row = 0

    def made(self):
        m = self.m
        y = np.array([*m.q, *m.v, *m.states.values()], float)
        arc = self.flights.choose(0.0, y, dict(m.modes))
        self._was = dict(arc.truths)
        self._side = {k: float(first_sign(x)) for k, x in arc.lines.items()}
        # A section through the start counts once the motion has left it.
        self._beginning = {k for k, x in arc.lines.items() if abs(x[0]) <= TIE}
        self._begin_ties(arc)
        try:
            arc = self._instant(Instant(0.0, y, arc, set(), start=True))
            while not self.done and arc.t < m.duration:
                arc = self._onwards(arc)
        except ChatterError as end:
            self.chatters = float(str(end))
        return self

    def _begin_ties(self, arc):
        """Decide the conditions that have one value at the start and another after it.

        They are true there but for rounding, or become true at once; or they are true
        at the start alone.
        """
        r = self.flights.reading(arc.series, {}, _at_point)
        for name, at in self._conditions().items():
            if arc.truths[name] != r.value(at):
                why = "a condition changes at the start"
                self._was[name] = bool(self.flights.fork(("start", name), 2, why))

    def _conditions(self):
        """Return the conditions of located events and of `until`, by name."""
        found = {e.name: e.at for e in self.m.events if e.at is not None}
        return found if self.m.until is None else found | {"until": self.m.until}

    def _notice_falsehood(self, arc):
        """Decide conditions that events at the start make false at the start only."""
        r = self.flights.reading(arc.series, {}, _at_point)
        for name, at in self._conditions().items():
            if self._was[name] and arc.truths[name] and not r.value(at):
                why = "a condition is false at the start alone"
                kept = self.flights.fork(("false", name), 2, why) == 0
                self._was[name] = kept

    # Between instants

    def _clock(self):
        """Return the next time of a clock."""
        times = [self._due[k] * period for k, period in self._periods.items()
                 if k not in self._spent]  # fmt: skip
        return min(times, default=math.inf)

    def _onwards(self, arc):
        """Return the arc that continues another one after its longest exact step."""
        clock = min(self._clock(), self.m.duration)
        h = min(clock - arc.t, LONGEST_STEP, radius(arc.series))
        if h <= 0.0:
            raise UndecidedError("no step")
        at_clock = h == clock - arc.t
        first, keys = self._first(arc, h, at_clock)
        at_clock &= first == h
        t = clock if at_clock else arc.t + first
        self._store(arc, t)
        y = arc.state(first)
        if np.max(np.abs(y)) > LARGEST:
            raise UndecidedError("it runs away")
        if keys or (at_clock and self._clock() <= clock):
            return self._instant(Instant(t, y, arc, keys))
        if at_clock:
            self._store(arc, t, closing=True)
            arc.t = t
            return arc
        cells = [r.cells for r in arc.readings]
        made = self.flights.solved(
            t, y, arc.modes, cells, arc.law_modes, given, Script(), arc.slide
        )
        made.held = arc.held
        return self.flights.observed(made)

    def _first(self, arc, h, at_clock):
        """Return the time to the first roots in a step, and their keys; or h."""
        found = [
            (first_root(x, h + NEAR, FLAT if key[0] == "strikes" else GRAZES), key)
            for key, x in arc.watched
        ]
        roots = sorted(root for root, _ in found if root is not None)
        if not roots:
            return h, set()
        if not at_clock and roots[0] > h - NEAR:
            return 0.75 * h, set()  # nothing happens at the end of a step
        kinds = {key[0] for root, key in found if root and root - roots[0] < NEAR}
        if kinds != {"strikes"} and any(
            ONE_INSTANT < root - roots[0] < NEAR for root in roots
        ):
            raise UndecidedError("two instants that are nearly one")
        first = roots[0]
        if at_clock and abs(first - h) < NEAR:
            if abs(first - h) > ONE_INSTANT:
                raise UndecidedError("beside the time of a clock")
            first = h
        keys = {key for root, key in found
                if root is not None and root <= roots[0] + ONE_INSTANT}  # fmt: skip
        return first, keys

    def _store(self, arc, until, *, closing=False):
        """Store rows from the arc's start up to a time; `closing`: at it, too."""
        while self._next_row >= 0:
            t = self._next_row * self.step
            last = t >= self.m.duration - 1e-9 * self.step
            t = self.m.duration if last else t
            if t > until + (ONE_INSTANT if closing else -ONE_INSTANT):
                return
            self._row(arc, t)
            self._next_row = -1 if last else self._next_row + 1

    def _row(self, arc, t):
        p = powers(t - arc.t)
        self.rows.append((
            t, arc.state(t - arc.t), dict(arc.modes),
            [x @ p for x in arc.accelerations],
            {k: float(x @ p) for k, x in arc.shown.items()},
            [float(x @ p) for x in arc.multipliers],
        ))  # fmt: skip

    # An instant

    def _instant(self, now):
        """Return the arc after an instant."""
        if len(self.instants) > MOST_INSTANTS:
            raise UndecidedError("too many instants")
        m, t = self.m, now.t
        clocks = {k for k, i in self._due.items()
                  if k not in self._spent
                  and abs(i * self._periods[k] - t) <= ONE_INSTANT}  # fmt: skip
        due = {e.name for e in m.events if e.name in clocks}
        arc = self._settled(now, due)
        for name in clocks:
            self._due[name] += 1
        if now.jumped or now.keys or clocks:
            self.instants.append((t, not now.keys and not now.struck))
        self.events += [(t, name) for name in now.acted]
        self._cross_sections(now, arc, clocks)
        if self.done:
            self._row(arc, t)
        elif t >= m.duration:
            self._store(arc, t, closing=True)
        return arc

    def _settled(self, now, due):
        """Return the arc after all impacts and acts; due : the periodic events."""
        t, modes = now.t, dict(now.before.modes)
        y = self._stopped(now, now.y.copy(), modes)
        for _ in range(30):
            # Acts at the start come before anything moves.
            if not (now.start and due):
                y = self._impact(now, y, modes)
            if now.start and now.struck:
                raise UndecidedError("the start is not admissible")
            arc = self.flights.choose(t, y, modes)
            if not now.reached:
                now.reached = {k: float(first_sign(x)) for k, x in arc.lines.items()}
            now.jumped = now.struck or modes != now.before.modes
            if now.start and now.acted:
                self._notice_falsehood(arc)
            over = arc.truths.get("until", False) and not self._was.get("until", True)
            self.done |= over
            if now.start and due:
                modes, due = self._act(now, due, arc, modes), set()
                continue
            fired = due | self._fired(now, arc)
            if not fired:
                self._was |= arc.truths
                return arc
            fired = self._in_order(fired, arc)
            # True at this instant alone: it does not become true again by these acts.
            self._was |= dict.fromkeys(now.alone, True)
            modes, due = self._act(now, fired, arc, modes), set()
        raise UndecidedError("events without end")

    def _fired(self, now, arc):
        """Return the located events that act now."""
        found = {k for k, true in arc.truths.items()
                 if true and not self._was[k] and k != "until"}  # fmt: skip
        at = self.flights.reading(arc.series, {}, _at_point)
        for e in self.m.events:
            # An event's own act does not make its condition true; that of an event
            # after it does.
            crossed = (
                e.equal is not None and self._crossed(e.name, now, arc) is not None
            )
            if crossed and e.name not in now.round:
                found.add(e.name)
            if e.at is None or e.name in now.acted:
                continue
            if not self._was[e.name] and not arc.truths[e.name]:
                why = "a condition is true at one instant alone"
                if at.value(e.at) and self.flights.fork((e.name, now.t), 2, why):
                    found.add(e.name)
                    now.alone.add(e.name)
        return found - self._spent

    def _in_order(self, fired, arc):
        """Return the events that act now, and store which conditions were true.

        Where one event moves the condition of another one, that condition is decided
        again.
        """
        events = [e for e in self.m.events if e.name in fired]
        sets = {u for e in events for u, _ in e.sets}
        moved = [
            e.name
            for e in events
            if (tree := e.at if e.at is not None else e.equal) is not None
            and sets & {x.data for x in tree.nodes()}
        ]
        before = dict(self._was)
        self._was |= arc.truths
        why = "one event of an instant moves another"
        if len(fired) == 1 or not moved or not self.flights.fork("order", 2, why):
            return fired
        first = next(e.name for e in events)
        self._was |= {k: before[k] for k in moved if k != first and k in before}
        return fired - ({*moved} - {first})

    def _act(self, now, fired, arc, modes):
        """Return the modes after the acts, in the order of the file.

        Raises
        ------
        ChatterError
            The same events act again at this instant, with the same modes.
        """
        single = any(e.once or e.every > 0.0 for e in self.m.events if e.name in fired)
        visit = frozenset(fired), tuple(sorted(modes.items()))
        if single:
            now.seen.clear()
        elif visit in now.seen:
            raise ChatterError(repr(now.t))
        else:
            now.seen.append(visit)
        now.round = set(fired)
        for e in self.m.events:
            if e.name in fired:
                series = arc.series | {u: constant(x) for u, x in modes.items()}
                r = self.flights.reading(series, {}, self.flights.either(now.t))
                modes = modes | {u: float(r.value(x)[0]) for u, x in e.sets}
                now.acted.append(e.name)
                if e.once:
                    self._spent.add(e.name)
        return modes

    def _stopped(self, now, y, modes):
        """Return the state in which the slips that have stopped have the rate 0."""
        m, n = self.m, self.m.n
        for _, j in [key for key in now.keys if key[0] == "stops"]:
            law = m.laws[j]
            A = np.array(law.row)
            rate = law.rate(self.flights.reading(self._begin(now, y, modes), {}))[0]
            y[n : 2 * n] -= (A / m.masses) * rate / (A @ (A / m.masses))
        return y

    def _begin(self, now, y, modes):
        return self.flights.begin(now.t, y, modes)

    def _impact(self, now, y, modes):
        """Return the state after an impact, if there is one."""
        m, v = self.m, y[self.m.n : 2 * self.m.n]
        r = self.flights.reading(self._begin(now, y, modes), {}, _ahead)
        rows = []
        for j, law in enumerate(m.laws):
            aim = self._aim(law, r, ("strikes", j) in now.keys)
            if aim is not None:
                rows.append((law, aim))
        rates = [float(law.at(r) @ v) for law, _ in rows]
        if all(abs(x - aim) <= TIE for x, (_, aim) in zip(rates, rows, strict=True)):
            return y
        A = np.array([law.at(r) for law, _ in rows])
        aims = np.array([aim for _, aim in rows])
        # What hardly leaves is at rest, as what hardly strikes.
        kinds = ["rest" if TIE < x < SPENT else law.kind
                 for x, (law, _) in zip(rates, rows, strict=True)]  # fmt: skip
        p = _impulses(A, m.masses, aims - rates, kinds)
        y = y.copy()
        y[m.n : 2 * m.n] += (A / m.masses).T @ p
        for row, (_, aim) in zip(A, rows, strict=True):
            # Without rounding where it is at rest.
            if aim == 0.0 and np.count_nonzero(row) == 1:
                y[m.n + int(np.flatnonzero(row)[0])] = 0.0
        # A corner is passed where the velocity on the new piece leads onto it.
        after = self.flights.reading(self._begin(now, y, modes), {}, _ahead)
        for law, _ in rows:
            if np.any(law.at(after) != law.at(r)):
                raise UndecidedError("it stops in a corner")
        now.struck = True
        now.seen.clear()
        return y

    def _aim(self, law, r, strikes):
        """Return the rate of a row after an impact, or None where it has no part."""
        if law.kind == "limit" or (law.when is not None and not r.value(law.when)):
            return None
        if law.kind == "hold":
            return float(law.belt.data) if law.belt else 0.0
        rate = law.rate(r)[0]
        if not (strikes or law.touches(r)):
            return None
        if abs(rate) < (SPENT if law.kind == "contact" else TIE):
            return 0.0
        if rate > 0.0:
            return None
        r = self.flights.reading(
            r.series | {"approach_speed": constant(-rate)}, {},
            self.flights.either(r.series["t"][0]),
        )  # fmt: skip
        rebound = -float(r.value(law.e)[0]) * rate
        return rebound if rebound >= SPENT else 0.0

    def _crossed(self, name, now, arc):
        """Return the sign of a crossing of a relation at this instant, or None.

        A jump of the relation itself past 0 is none; of the state or of a mode it is.
        """
        side, sign = self._side[name], float(first_sign(arc.lines[name]))
        if sign == side:
            # The relation itself has jumped at this instant, and a mode back.
            back = now.jumped and not now.start and now.reached[name] == -sign != 0.0
            why = "a relation jumps, and a mode back"
            return sign if back and self.flights.fork(("back", name), 2, why) else None
        if sign == 0.0:
            raise UndecidedError("a relation stays 0")
        self._side[name] = sign
        if side == 0.0 or (now.start and name in self._beginning):
            return None
        at_zero = abs(arc.lines[name][0]) <= TIE
        if ("line", name) in now.keys:
            if not (at_zero or now.jumped):
                raise UndecidedError("a relation jumps where it is 0")
            return sign
        moved = any(
            now.before.out.cells.get(x) != arc.out.cells.get(x)
            for x in self.flights.lines[name].nodes()
            if x.kind in KINDS
        )
        if now.jumped and (moved or at_zero):
            why = "a relation jumps with the state"
            return None if self.flights.fork(("jumps", name), 2, why) else sign
        return sign if now.jumped else None

    def _cross_sections(self, now, arc, clocks):
        for s in self.m.sections:
            sign = None if s.every else self._crossed(s.name, now, arc)
            # Acts at the start come before the first row: nothing has been crossed.
            sign = None if now.start else sign
            right = s.direction == "both" or (s.direction == "up") == (sign == 1.0)
            if s.name in clocks or (sign is not None and right):
                self.crossings[s.name].append((now.t, arc.state(), dict(arc.modes)))


def _impulses(A, masses, jumps, kinds):
    """Return the impulses (k,) of rows; contacts have impulses that push.

    A row without an impulse leaves faster than its target rate.

    jumps : (k,), of rates
    """
    loose = [k for k, kind in enumerate(kinds) if kind == "contact"]
    found = []
    for pushes in itertools.product([True, False], repeat=len(loose)):
        off = {k for k, own in zip(loose, pushes, strict=True) if not own}
        on = [k for k in range(len(kinds)) if k not in off]
        W = A[on] @ (A[on] / masses).T
        if on and np.linalg.cond(W) > 1e8:
            continue
        p = np.zeros(len(kinds))
        p[on] = np.linalg.solve(W, jumps[on]) if on else 0.0
        left = A @ ((A / masses).T @ p) - jumps
        if np.min(p[loose], initial=0.0) >= -TIE and all(left[k] > TIE for k in off):
            found.append(p)
    if len(found) != 1:
        raise UndecidedError(f"{len(found)} ways to strike")
    return found[0]


class Instant:
    """An instant.

    y : the state before it
    before : the arc that it ends
    keys : the keys of the roots
    """

    def __init__(self, t, y, before, keys, *, start=False):
        self.t, self.y, self.before, self.keys, self.start = t, y, before, keys, start
        self.struck = self.jumped = False
        self.acted: list[str] = []
        self.round: set[str] = set()  # the events that acted together last
        self.reached: dict[str, float] = {}  # signs of relations before all acts
        self.alone: set[str] = set()  # whose conditions are true at this time alone
        self.seen: list[Any] = []  # located events that acted together, modes before


def _at_point(_reading, tree, _point, _low, high):
    """Return the cell that contains the point at which an argument is."""
    return 0 if tree.kind in HALVES else high


def _ahead(reading, tree, _point, low, high):
    """Return the cell that an argument of positions, t and modes enters next."""
    slope = reading.arguments[tree][1]
    if abs(slope) < LITTLE and slope != 0.0:
        raise UndecidedError("it hardly leaves a corner")
    if slope == 0.0:
        return 0 if tree.kind in HALVES else high
    return high if slope > 0.0 else low
