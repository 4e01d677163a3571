"""Referee of scenes with modes, events, tables, states and contacts, by DOP853.

It reads a written-out model (numbers alone) by sympy. Within an arc everything is
smooth: each kink has a side u = -1 or 1, each table one polynomial, each law a mode. An
arc ends where a watched function, positive before, becomes negative; this time is
located on the dense output.

    M a = f + C^T x,    A a = b        C = A but for sliding laws: A_n - s mu A_t
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import sympy as sp
import yaml
from scipy.integrate import DOP853
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import brentq

from tests.hunt.integrator import NoTruthError
from tests.hunt.mechanics import Sided
from tests.sympy_oracle import symbol

MOST_EVENTS = 1000
LARGEST = 1e5
LOOKS = np.linspace(0.0, 1.0, 9)[1:]
TINY = 1e-9


@dataclass(frozen=True)
class Law:
    """A row of A.

    kind : hold, contact, ratchet or limit (of velocities), slip
    when : a condition of t and modes
    normal : the index of a slip's contact
    e, mu, static : texts; mu of a limit is the limit
    poisson : whether restitution is Poisson's instead of Newton's
    """

    kind: str
    text: str
    when: str = "1 > 0"
    e: str = "0"
    mu: str = "0"
    static: str = ""
    normal: int = -1
    poisson: bool = False


@dataclass(frozen=True)
class Plain:
    """A written-out scene.

    document : the content of a model file, without laws and events
    tables : name -> (x, y, interpolation, outside)
    events : name -> {at or every, set, once}
    times : times at which a condition jumps
    """

    document: dict[str, Any]
    laws: tuple[Law, ...] = ()
    tables: dict[str, Any] = field(default_factory=dict)
    events: dict[str, dict[str, Any]] = field(default_factory=dict)
    sections: dict[str, tuple[str, str]] = field(default_factory=dict)
    until: str = ""
    times: tuple[float, ...] = ()

    @property
    def sets(self):
        """Return the assignments of events: names of events, modes and texts."""
        each = ((name, event["set"].items()) for name, event in self.events.items())
        return [(name, mode, text) for name, pairs in each for mode, text in pairs]


class Pieces:
    """A table's polynomials, in powers of x less the left end, and their ends."""

    def __init__(self, x, y, interpolation, outside):
        x, y = np.array(x, float), np.array(y, float)
        self.x, again = x, outside == "repeat"
        if interpolation == "linear":
            c = np.stack([0 * y[1:], 0 * y[1:], np.diff(y) / np.diff(x), y[:-1]])
        elif interpolation == "cubic":
            c = CubicSpline(x, y, bc_type="periodic" if again else "not-a-knot").c
        elif again:  # three more points at both ends
            period, k = x[-1] - x[0], min(3, len(x) - 1)
            wide = np.concatenate([x[-1 - k : -1] - period, x, x[1 : k + 1] + period])
            high = np.concatenate([y[-1 - k : -1], y, y[1 : k + 1]])
            c = PchipInterpolator(wide, high).c[:, k:-k]
        else:
            c = PchipInterpolator(x, y).c
        self.c, self.again, self.outside = c, again, outside
        slope = np.polyval(np.polyder(c[:, -1]), x[-1] - x[-2])
        self.ends = (c[2, 0], slope) if outside == "extend" else (0.0, 0.0)
        self.values = y[0], y[-1]

    def at(self, x):
        """Return left end, right end, origin and coefficients (4,) of a piece at x."""
        period = self.x[-1] - self.x[0]
        shift = np.floor((x - self.x[0]) / period) * period if self.again else 0.0
        k = int(np.searchsorted(self.x, x - shift, side="right")) - 1
        if 0 <= k < len(self.x) - 1:
            left, right = self.x[k : k + 2] + shift
            return left, right, left, self.c[:, k]
        end = 0 if k < 0 else -1
        if self.outside == "error":
            raise NoTruthError("outside a table")
        left, right = (-np.inf, self.x[0]) if k < 0 else (self.x[-1], np.inf)
        return (
            left,
            right,
            self.x[end],
            np.array([0, 0, self.ends[end], self.values[end]]),
        )


class Reading(Sided):
    """Reader of expressions, with a symbol for the present piece of each table."""

    def __init__(self, scene):
        self.pieces: list[Any] = []
        tables = {
            name: partial(self._piece, Pieces(*table))
            for name, table in scene.tables.items()
        }
        text = yaml.safe_dump(scene.document, sort_keys=False, width=10**6)
        super().__init__(text, tables)

    def name(self, name):
        if name in ("slip_speed", "approach_speed"):
            return symbol(name)
        return super().name(name)

    def _piece(self, pieces, x):
        known = [names for p, at, names in self.pieces if p is pieces and at == x]
        k = len(self.pieces)
        new = [sp.Symbol(f"piece_{k}_{i}", real=True) for i in range(5)]
        names = known[0] if known else new
        if not known:
            self.pieces.append((pieces, x, names))
        d = x - names[0]
        return ((names[1] * d + names[2]) * d + names[3]) * d + names[4]

    def side(self, relation):
        """Return an expression that is >= 0 where a relation is true."""
        left, sign, right = relation.replace("=", "").partition(
            "<" if "<" in relation else ">"
        )
        difference = self.read(left) - self.read(right)
        return -difference if sign == "<" else difference


class Equations:
    """All expressions of a scene as one function of t, y, modes, sides, pieces."""

    def __init__(self, scene):
        self.scene, self.laws = scene, scene.laws
        rows = {f"c{k}": f"{law.text} = 0" for k, law in enumerate(self.laws)}
        document = scene.document | {"constraints": rows}
        self.o = o = Reading(Plain(document, tables=scene.tables))
        self.n, self.m = len(o.q), len(self.laws)
        self.modes = list(scene.document.get("modes", {}))
        self.signs = sp.symbols(f"sign:{self.m}", real=True) if self.m else ()
        slip, approach = symbol("slip_speed"), symbol("approach_speed")
        speeds = ("limit", "slip", "ratchet")
        mu = [
            o.read(law.mu).subs(slip, self.signs[k] * o.rates[k])
            for k, law in enumerate(self.laws)
        ]
        parts = {
            "M": sp.flatten(o.M), "f": o.f, "A": sp.flatten(o.A), "b": o.b,
            "gap": [sp.Integer(0) if law.kind in speeds else g
                    for law, g in zip(self.laws, o.constraints, strict=True)],
            "rate": o.rates, "mu": mu,
            "static": [o.read(law.static or law.mu).subs(slip, 0) for law in self.laws],
            "e": [o.read(law.e).subs(approach, -r)
                  for law, r in zip(self.laws, o.rates, strict=True)],
            "on": [o.side(law.when) for law in self.laws],
            "s": [o.name(f"{s.name}_dot") for s in o.s],
            "located": [o.side(e["at"]) for e in scene.events.values() if "at" in e],
            "set": [o.read(x) for _, _, x in scene.sets],
            "sections": [o.read(text) for text, _ in scene.sections.values()],
            "until": [o.side(scene.until)] if scene.until else [],
        }  # fmt: skip
        ends = itertools.accumulate(len(part) for part in parts.values())
        self.parts = {
            key: slice(end - len(part), end)
            for (key, part), end in zip(parts.items(), ends, strict=True)
        }
        inputs = [*o.inputs, *o.sides, *(x for *_, names in o.pieces for x in names)]

        def made(flat, more=()):
            return sp.lambdify([*inputs, *more], flat, modules="math", cse=True)

        self._all = made([e for part in parts.values() for e in part], self.signs)
        # Arguments of tables and surfaces of kinks, in the order in which they nest.
        self._surface = [made([e]) for e in o.kinks]
        self._argument = [made([x]) for _, x, _ in o.pieces]

    def start(self):
        """Return y and the modes at the start."""
        document = self.scene.document
        names = [*self.o.q, *self.o.v, *self.o.s]
        y = np.array([float(document["initial"].get(x.name, 0)) for x in names])
        return y, np.array([float(document["modes"][x]) for x in self.modes])

    def look(self, t, y, modes):
        """Return the sides, pieces and ends of pieces at a state."""
        o = self.o
        sides, ends = np.zeros(len(o.sides)), np.zeros((len(o.pieces), 2))
        pieces = np.zeros((len(o.pieces), 5))
        for _ in range(2 if len(sides) + len(pieces) > 1 else 1):
            for k, x in enumerate(self._argument):
                at = x(t, *y, *modes, *sides, *pieces.flat)[0]
                left, right, origin, c = o.pieces[k][0].at(at)
                pieces[k], ends[k] = [origin, *c], [left, right]
            for k, surface in enumerate(self._surface):
                s = surface(t, *y, *modes, *sides, *pieces.flat)[0]
                sides[k] = 1.0 if s >= 0 else -1.0
        return sides, pieces, ends

    def watched(self, t, y, d):
        """Return functions that are positive while the sides and pieces are valid."""
        given = (t, *y, *d.modes, *d.sides, *d.pieces.flat)
        x = np.array([f(*given)[0] for f in self._argument])
        s = np.array([f(*given)[0] for f in self._surface])
        return np.concatenate([d.sides * s, x - d.ends[:, 0], d.ends[:, 1] - x])

    def at(self, t, y, d, signs=None):
        """Return all quantities at a state, for the modes of an arc."""
        signs = d.signs if signs is None else signs
        x = np.array(
            self._all(t, *y, *d.modes, *d.sides, *d.pieces.flat, *signs), float
        )
        found = {key: x[part] for key, part in self.parts.items()}
        found["M"] = found["M"].reshape(self.n, self.n)
        found["A"] = found["A"].reshape(self.m, self.n)
        return found


@dataclass
class Discrete:
    """Discrete state of the referee, constant within an arc.

    modes : values of the modes of the file
    sides : of each switch
    pieces, ends : coefficients and ends of the present piece of each table
    held : whether each row has a multiplier of its own
    signs : of the slip of each law; 0 where it does not slide
    """

    modes: Any
    sides: Any = None
    pieces: Any = None
    ends: Any = None
    held: Any = None
    signs: Any = None


class Hybrid:
    """One integration of a scene.

    rows : (t, y, modes) at the requested times
    events : (time, name, y)
    impacts : times
    crossings : name -> (t, y) of sections
    small : speeds of approach that count as 0, relative to the largest
    """

    def __init__(self, equations, tolerance=1e-12, small=1e-10, nudge=0.0):
        self.e, self.tolerance, self.small = equations, tolerance, small
        self.rows: list[Any] = []
        self.events: list[Any] = []
        self.impacts: list[float] = []
        self.turns: list[float] = []
        self.crossings: dict[str, list[Any]] = {k: [] for k in equations.scene.sections}
        y, modes = equations.start()
        self.y = y * (1 + nudge * np.resize([1, -1, -1, 1, 1], len(y)))
        self.d = Discrete(modes)
        self.size = np.maximum(np.abs(y), 1e-3)
        self.periodic = {
            k: 0 for k, e in equations.scene.events.items() if "every" in e
        }
        located = [k for k, e in equations.scene.events.items() if "at" in e]
        self.located = located
        self.armed = dict.fromkeys([*located, "until"], False)
        self.spent: set[str] = set()

    # Modes of an arc

    def accelerations(self, t, y, held, signs):
        """Return all quantities at a state, with a (n,) and the multipliers x (m,)."""
        s = self.e.at(t, y, self.d, signs)
        A, f = s["A"], s["f"].copy()
        C = A.copy()
        for k, law in enumerate(self.e.laws):
            if law.kind == "limit" and not held[k]:
                f -= signs[k] * s["mu"][k] * A[k]
            if law.kind == "slip" and not held[k] and signs[k]:
                C[law.normal] -= signs[k] * s["mu"][k] * A[k]
        rows = [k for k in range(self.e.m) if held[k]]
        a, x = solved(s["M"], A[rows], C[rows], f, s["b"][rows])
        s["a"], s["x"] = a, np.zeros(self.e.m)
        s["x"][rows] = x
        return s

    def slope(self, t, y):
        n = self.e.n
        if not np.max(np.abs(y)) < LARGEST:
            raise NoTruthError("it runs away")
        s = self.accelerations(t, y, self.d.held, self.d.signs)
        self.rates = np.concatenate([s["a"], s["s"]])
        return np.concatenate([y[n : 2 * n], self.rates])

    def _ahead(self, t, y):
        """Return sides, pieces and their ends shortly after the time of the state."""
        n, later = self.e.n, TINY * self.span
        rates = np.concatenate([y[n : 2 * n], self.rates])
        return self.e.look(t + later, y + later * rates, self.d.modes)

    @property
    def _small(self):
        return self.small * (1e-2 + np.max(self.size[self.e.n : 2 * self.e.n]))

    def choose(self, t, y, barred=()):
        """Choose the modes of all laws: the first ones that violate no law."""
        d, laws = self.d, self.e.laws
        d.held, d.signs = np.zeros(len(laws), bool), np.zeros(len(laws))
        d.sides, d.pieces, d.ends = self._ahead(t, y)
        s = self.e.at(t, y, d)
        near = 2 * self._small
        options = [self._options(k, s, near) for k in range(len(laws))]
        for some in itertools.product(*options):
            if any(some[k] == mode for k, mode in barred):
                continue
            held = np.array([m == "hold" for m in some], bool)
            signs = np.array([m if m in (1, -1) else 0 for m in some], float)
            for k, law in enumerate(laws):  # without its contact there is no friction
                if law.kind == "slip" and not held[law.normal]:
                    held[k], signs[k] = False, 0.0
            try:
                found = self.accelerations(t, y, held, signs)
            except np.linalg.LinAlgError:
                continue
            if all(self._fits(k, found, held, signs, near) for k in range(len(laws))):
                d.held, d.signs = held, signs
                return
        raise NoTruthError(f"no modes at {t}")

    def _options(self, k, s, near):
        law = self.e.laws[k]
        normal = law.normal if law.kind == "slip" else k
        if s["on"][normal] <= 0:
            return ["free"]
        if law.kind == "hold":
            return ["hold"]
        if law.kind in ("contact", "ratchet"):
            touches = s["gap"][k] < near and abs(s["rate"][k]) < near
            return ["hold", "free"] if touches else ["free"]
        if abs(s["rate"][k]) > near:
            return [int(np.sign(s["rate"][k]))]
        return ["hold", 1, -1]

    def _fits(self, k, s, held, signs, near):
        law = self.e.laws[k]
        least = -TINY * np.max(np.abs(s["f"]), initial=1.0)
        turn = s["A"][k] @ s["a"] - s["b"][k]
        if law.kind in ("contact", "ratchet"):
            if held[k]:
                return s["x"][k] >= least
            apart = s["gap"][k] > near or s["rate"][k] > near or s["on"][k] <= 0
            return apart or turn >= least
        if law.kind == "hold":
            return True
        if held[k]:
            return abs(s["x"][k]) <= self._bound(k, s) - least
        return signs[k] == 0 or abs(s["rate"][k]) > near or signs[k] * turn >= least

    def _bound(self, k, s):
        law = self.e.laws[k]
        return s["static"][k] * (s["x"][law.normal] if law.kind == "slip" else 1.0)

    # What ends an arc

    def watch(self, t, y):
        """Return (name, value) of all functions that are positive within the arc."""
        d, s = self.d, self.accelerations(t, y, self.d.held, self.d.signs)
        found = [("piece", x) for x in self.e.watched(t, y, d)]
        found += [x for k in range(self.e.m) for x in self._watched_law(k, s)]
        for name, x in zip(self.located, s["located"], strict=True):
            if name not in self.spent:
                found.append((("event", name), -x if self.armed[name] else x))
        found += [
            (("event", "until"), -x if self.armed["until"] else x) for x in s["until"]
        ]
        for (name, side), x in zip(self.beyond.items(), s["sections"], strict=True):
            found.append((("section", name), side * x))
        return found

    def _watched_law(self, k, s):
        """Return a function that is positive while a law keeps its mode."""
        law, held, sign = self.e.laws[k], self.d.held[k], self.d.signs[k]
        if s["on"][law.normal if law.kind == "slip" else k] <= 0 or law.kind == "hold":
            return
        if law.kind in ("contact", "ratchet"):
            free = (
                ("lands", s["gap"]) if law.kind == "contact" else ("stops", s["rate"])
            )
            what, values = ("leaves", s["x"]) if held else free
            yield (what, k), values[k]
        elif held:
            yield ("yields", k), self._bound(k, s) - abs(s["x"][k])
        elif sign:
            yield ("stops", k), sign * s["rate"][k]

    def path(self, start, times):
        """Run to the last of the times."""
        t, y, self.start = start, self.y, start
        self.span, self.rates = times[-1] - start, np.zeros(len(y) - self.e.n)
        self._periodic(t, y)
        s = self._looked(t, y)
        for name, x in zip([*self.located, "until"],
                           [*s["located"], *s["until"]], strict=False):  # fmt: skip
            self.armed[name] = bool(x < 0)
        self.beyond = dict.fromkeys(self.crossings, 0.0)
        self.choose(t, y)
        asked = list(times)
        if asked[0] == t:
            self.rows.append((asked.pop(0), y, self.d.modes.copy()))
        while asked and not self.armed.get("done"):
            t, y = self._arc(t, y, asked)
            if len(self.turns) > MOST_EVENTS:
                raise NoTruthError("too many events")
        return self

    def _looked(self, t, y):
        d = self.d
        d.sides, d.pieces, d.ends = self.e.look(t, y, d.modes)
        return self.e.at(t, y, d, np.zeros(self.e.m))

    def _next(self, t):
        """Return the next time known in advance, of a period or a condition of t."""
        events = self.e.scene.events
        clock = [self.start + k * events[name]["every"]
                 for name, k in self.periodic.items()]  # fmt: skip
        return min([x for x in (*clock, *self.e.scene.times) if x > t], default=np.inf)

    def _arc(self, t, y, asked):
        end = min(self._next(t), asked[-1])
        solver = DOP853(
            self.slope, t, y, end, rtol=self.tolerance,
            atol=self.tolerance * 1e-2 * self.size, max_step=self.span / 100,
        )  # fmt: skip
        while solver.status == "running":
            solver.step()
            if solver.status == "failed":
                raise NoTruthError("steps vanish")
            out, a, b = solver.dense_output(), solver.t_old, solver.t
            self._cross(a, out(a))
            first, what = self._first(out, a, b)
            while asked and asked[0] <= first:
                self.rows.append((asked[0], out(asked[0]), self.d.modes.copy()))
                asked.pop(0)
            self.size = np.maximum(self.size, np.abs(solver.y))
            if what is not None:
                return first, self._act(first, out(first), what)
        y = solver.y
        if self._periodic(end, y) or asked:
            y = self._after(end, y)
            if self.rows[-1][0] == end:  # it shows what holds after an event
                self.rows[-1] = (end, y, self.d.modes.copy())
        return end, y

    def _cross(self, t, y):
        """Set the sides of sections that the motion has left."""
        if any(side == 0.0 for side in self.beyond.values()):
            s = self.e.at(t, y, self.d)
            for name, x in zip(self.beyond, s["sections"], strict=True):
                if self.beyond[name] == 0.0 and abs(x) > TINY:
                    self.beyond[name] = float(np.sign(x))

    def _first(self, out, a, b):
        """Return time and kind of the first event of a step; else the end and None."""
        low, before = a, self.watch(a, out(a))
        for part in LOOKS if before else ():
            high = a + part * (b - a)
            values = self.watch(high, out(high))
            crossed = [
                (self._located(out, low, high, k, before[k][1]), k)
                for k, (_, x) in enumerate(values)
                if x < 0
            ]
            if crossed:
                t, k = min(crossed)
                return t, values[k][0]
            low, before = high, values
        return b, None

    def _located(self, out, low, high, k, before):
        """Return the time at which a watched function becomes negative.

        Its value is negative at `high`.
        """

        def value(t):
            return self.watch(t, out(t))[k][1]

        # It may begin at 0 and rise at first: a short flight after a bounce.
        ahead = [low + (high - low) * 0.5**i for i in range(1, 30)]
        begins = low if before > 0 else next((t for t in ahead if value(t) > 0), None)
        return low if begins is None else brentq(value, begins, high, xtol=1e-15)

    def _act(self, t, y, what):
        self.turns.append(t)
        if what == "piece":
            self.choose(t, y)
            return y
        kind, k = what
        if kind == "section":
            direction = self.e.scene.sections[k][1]
            side = self.beyond[k]
            self.beyond[k] = -side
            if direction == "both" or (direction == "up") == (side < 0):
                self.crossings[k].append((t, y))
            return y
        if kind == "event":
            return self._event(t, y, k)
        if kind == "lands":
            return self._after(t, y, struck=(k,))
        self.choose(t, y, barred=[(k, "hold")] if kind != "stops" else ())
        return y

    def _event(self, t, y, name):
        if not self.armed[name]:  # it has become false
            self.armed[name] = True
            return y
        self.armed[name] = False
        if name == "until":
            self.rows.append((t, y, self.d.modes.copy()))
            self.armed["done"] = True
            return y
        self._set(t, y, name)
        return self._after(t, y)

    def _set(self, t, y, name):
        events = self.e.scene.events
        self.events.append((t, name, y))
        s = self._looked(t, y)
        for value, (other, mode, _) in zip(s["set"], self.e.scene.sets, strict=True):
            if other == name:
                self.d.modes[self.e.modes.index(mode)] = value
        if events[name].get("once"):
            self.spent.add(name)

    def _periodic(self, t, y):
        """Execute the periodic events of a time; return whether one has acted."""
        near = 4.0 * math.ulp(t)  # of one instant
        due = [
            name
            for name, k in self.periodic.items()
            if self.start + k * self.e.scene.events[name]["every"] <= t + near
        ]
        for name in due:
            self.periodic[name] += 1
            if name not in self.spent:
                self._set(t, y, name)
        return bool(due)

    def _after(self, t, y, struck=()):
        """Process a change: the events that become true, impacts, and modes."""
        for _ in range(20):
            s = self._looked(t, y)
            fired = False
            for name, x in zip(self.located, s["located"], strict=True):
                if x < -TINY:
                    self.armed[name] = True
                elif self.armed[name] and x > TINY and name not in self.spent:
                    self.armed[name], fired = False, True
                    self._set(t, y, name)
            if not fired:
                break
        n = self.e.n
        for _ in range(20):
            v = self.impact(t, y, struck)
            if v is None:
                break
            y = np.concatenate([y[:n], v, y[2 * n :]])
            self.impacts.append(t)
            struck = ()
        self.choose(t, y)
        return self._settled(t, y)

    def _settled(self, t, y):
        """Return the state with the rates that are held from now on set to 0."""
        n, rows = self.e.n, np.flatnonzero(self.d.held)
        s = self.e.at(t, y, self.d, self.d.signs)
        A = s["A"][rows]
        change, _ = solved(s["M"], A, A, np.zeros(n), -s["rate"][rows])
        return np.concatenate([y[:n], y[n : 2 * n] + change, y[2 * n :]])

    # Impacts

    def impact(self, t, y, struck):
        """Return velocities after an impact, or None where there is none."""
        s, laws = self._looked(t, y), self.e.laws
        small, near = self._small, 2 * self._small
        on = [s["on"][law.normal if law.kind == "slip" else k] > 0
              for k, law in enumerate(laws)]  # fmt: skip
        held = [k for k, law in enumerate(laws) if on[k] and law.kind == "hold"]
        closed = [k for k, law in enumerate(laws) if on[k] and law.kind == "contact"
                  and (s["gap"][k] < near or k in struck)]  # fmt: skip
        if any(abs(s["gap"][k]) > 1e-5 for k in held):
            raise NoTruthError("a constraint comes into force elsewhere")
        if all(abs(s["rate"][k]) <= small for k in held) and all(
            s["rate"][k] >= -small for k in closed
        ):
            return None
        # Friction at an impact knows the slip just before it.
        signs = np.array([np.sign(r) if law.kind == "slip" else 0
                          for law, r in zip(laws, s["rate"], strict=True)])  # fmt: skip
        s["mu"] = self.e.at(t, y, self.d, signs)["mu"]
        e = np.where(s["rate"] < -near, s["e"], 0.0)
        poisson = {laws[k].poisson for k in closed}
        if len(poisson) > 1:
            raise NoTruthError("two laws of impact")
        v = y[self.e.n : 2 * self.e.n]
        if poisson == {True}:
            v, p = self._phase(s, v, held, closed, dict.fromkeys(closed, 0.0), None)
            return self._phase(
                s, v, held, closed, None, {k: e[k] * p[k] for k in closed}
            )[0]
        targets = {k: -e[k] * min(s["rate"][k], 0.0) for k in closed}
        return self._phase(s, v, held, closed, targets, None)[0]

    def _phase(self, s, v, held, closed, targets, given):
        """Return velocities and normal impulses of a phase of an impact.

        targets : rates of gaps that contacts with an impulse have afterwards, or None
        given : the normal impulses themselves, or None
        """
        laws = self.e.laws
        s.setdefault("drift", s["rate"] - s["A"] @ v)
        slips = {law.normal: k for k, law in enumerate(laws) if law.kind == "slip"}
        none = ["none"] if given is None else []
        kinds = [
            ["stick", 1, -1, *none] if k in slips else ["smooth", *none] for k in closed
        ]
        for some in itertools.product(*kinds):
            of = dict(zip(closed, some, strict=True))
            try:
                after, normal = self._impulses(s, v, held, of, slips, targets, given)
            except np.linalg.LinAlgError:
                continue
            near = 1e-10 * (1 + np.max(np.abs(s["rate"])))
            if all(
                _holds(kind, s, after, normal, k, slips.get(k), targets, near)
                for k, kind in of.items()
            ):
                return after, normal
        raise NoTruthError("no impulses")

    def _impulses(self, s, v, held, of, slips, targets, given):
        """Return velocities after impulses of these kinds, and the impulses by row."""
        A, rate = s["A"], s["A"] @ v + s["drift"]
        rows = {k: (A[k], -rate[k]) for k in held}
        push, known = np.zeros(self.e.n), {}
        for k, kind in of.items():
            if kind == "none":
                continue
            slip = slips.get(k)
            column = A[k] - kind * s["mu"][slip] * A[slip] if kind in (1, -1) else A[k]
            if given is None:
                rows[k] = column, targets[k] - rate[k]
            else:
                known[k] = given[k]
                push += given[k] * column
            if kind == "stick":
                rows[slip] = A[slip], -rate[slip]
        columns = np.array([c for c, _ in rows.values()]).reshape(-1, self.e.n)
        change = np.array([x for _, x in rows.values()])
        dv, p = solved(s["M"], A[list(rows)], columns, push, change)
        impulses = dict.fromkeys(of, 0.0) | known | dict(zip(rows, p, strict=True))
        return v + dv, impulses


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


def _holds(kind, s, v, p, k, slip, targets, near):
    """Return whether impulses p, with the velocities v after these, violate no law."""
    rate = s["A"] @ v + s["drift"]
    if kind == "none":
        return rate[k] >= targets[k] - near
    if kind == "stick" and abs(p[slip]) > s["mu"][slip] * p[k] + near:
        return False
    if kind in (1, -1) and kind * rate[slip] < -near:
        return False
    return p[k] >= -near
