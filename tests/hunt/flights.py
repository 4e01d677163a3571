"""Motions of random models in fixed cells and modes, and the choice of cells and modes.

Bodies of constant mass move along coordinates of their own. Between two instants each
switch is in one cell and each law in one mode, so that positions, velocities and states
are power series of the time (`Flights.solved`), exact where the motion is a polynomial.
Cells and modes are right where the series that they give leads into them. A motion with
no such choice slides along a switch by Filippov's rule, where that is possible; with
several choices, or with a margin that rounding decides, it is undecided.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tests.hunt.series import (
    COUNTED,
    LITTLE,
    NOTHING,
    ORDER,
    UndecidedError,
    constant,
    deflated,
    first_sign,
    integral,
    over,
    powers,
    rate_of,
    times,
)
from tests.hunt.trees import CONTINUOUS, HALVES, KINDS, TIE, Reading, Tree

# The most cells and modes that are tried at one instant.
MOST_CHOICES = 1000


@dataclass(eq=False)
class Law:
    """A row of rates sum_i row[i] v_i - belt.

    kind : limit, contact, or hold
    bound, static : the bound of a limit, and its own static value or None
    where, height : the gap of a contact is sum_i row[i] q_i - where - height, with a
        height of straight pieces or none; a hold with a height is one of positions
    e : restitution
    when : a condition of modes and t
    """

    kind: str
    row: list[float]
    belt: Tree | None = None
    bound: Tree | None = None
    static: Tree | None = None
    where: float = 0.0
    height: Tree | None = None
    e: Tree | None = None
    when: Tree | None = None
    name: str = ""

    def at(self, r):
        """Return the row (n,) in the cells of a reading."""
        row = np.array(self.row)
        if self.height is not None:
            row -= [r.slope(self.height, f"q{k}")[0] for k in range(1, len(row) + 1)]
        return row

    def rate(self, r):
        x = constant(0.0)
        for k, c in enumerate(self.at(r), 1):
            x = x + c * r.series[f"v{k}"]
        return x - r.value(self.belt) if self.belt else x

    def gap(self, r):
        x = constant(-self.where)
        for k, c in enumerate(self.row, 1):
            x = x + c * r.series[f"q{k}"]
        return x - r.value(self.height) if self.height else x

    def touches(self, r):
        return abs(self.gap(r)[0]) <= TIE * max(1.0, abs(self.where))


@dataclass(eq=False)
class Event:
    """An event, with one of three triggers.

    at : a condition
    equal : the expression of a trigger `expression = 0`
    every : a period
    """

    name: str
    at: Tree | None = None
    equal: Tree | None = None
    every: float = 0.0
    once: bool = False
    sets: list[tuple[str, Tree]] = field(default_factory=list)


@dataclass(eq=False)
class Section:
    """A section.

    at : left side less right side of the equation
    every : the period of a strobe, in place of an equation
    """

    name: str
    at: Tree | None = None
    every: float = 0.0
    direction: str = "both"


@dataclass(eq=False)
class Model:
    """A model. Trees name t, coordinates q1, velocities v1, states z1, and modes u1.

    shown : definitions
    nudge : factor of all forces; the motion with another factor shows how well this
        motion is known
    """

    masses: list[float]
    q: list[float]
    v: list[float]
    forces: list[list[Tree]]
    duration: float
    potentials: list[Tree] = field(default_factory=list)
    dissipations: list[Tree] = field(default_factory=list)
    states: dict[str, float] = field(default_factory=dict)
    rates: dict[str, Tree] = field(default_factory=dict)
    modes: dict[str, float] = field(default_factory=dict)
    laws: list[Law] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)
    shown: dict[str, Tree] = field(default_factory=dict)
    until: Tree | None = None
    nudge: float = 1.0

    @property
    def n(self):
        return len(self.masses)

    def nudged(self, *, forces=0.0, speeds=0.0):
        """Return the model with forces, and speeds at the start, a little larger."""
        v = [x * (1.0 + speeds) for x in self.v]
        return replace(self, v=v, nudge=1.0 + forces)


@dataclass
class Script:
    """Choices of a search in depth: `picks` of `options`, in the order of asking."""

    picks: list[int] = field(default_factory=list)
    options: list[int] = field(default_factory=list)
    asked: int = 0

    def pick(self, count):
        k = self.asked
        self.asked += 1
        if k == len(self.picks):
            self.picks.append(0)
            self.options.append(count)
        return self.picks[k]

    def again(self):
        """Return a script of the choices made, and the first ways after them."""
        return Script(self.picks[: self.asked], self.options[: self.asked])

    def next(self):
        """Return the script of the next choice, or None."""
        picks = self.picks[: self.asked]
        options = self.options[: self.asked]
        while picks:
            picks[-1] += 1
            if picks[-1] < options[-1]:
                return Script(picks, options)
            picks.pop()
            options.pop()
        return None


@dataclass
class Arc:
    """A motion in fixed cells and modes, as series from its start.

    readings : one reading; in a slide the readings of both sides
    share : the share of the second side in a slide
    held : whether a switch at rest may have another value
    law_modes : off, on, stick, 1, -1, closed, or open
    out : the reading of conditions
    watched : (key, series) of functions that are positive after the start
    """

    t: float
    series: dict[str, Any]
    modes: dict[str, float]
    readings: list[Reading]
    law_modes: list[Any]
    multipliers: list[Any]
    accelerations: list[Any]
    slide: Tree | None = None
    share: Any = None
    held: bool = False
    out: Any = None
    truths: dict[str, bool] = field(default_factory=dict)
    lines: dict[str, Any] = field(default_factory=dict)
    shown: dict[str, Any] = field(default_factory=dict)
    watched: list[Any] = field(default_factory=list)

    def state(self, d=0.0):
        """Return positions, velocities and states after a time d."""
        s = self.series
        names = [*sorted(x for x in s if x[0] == "q"),
                 *sorted(x for x in s if x[0] == "v"),
                 *sorted(x for x in s if x[0] == "z")]  # fmt: skip
        p = powers(d)
        return np.array([s[x] @ p for x in names])


@dataclass
class Tie:
    """A switch whose argument is at a point between two cells, and its cell."""

    tree: Tree
    point: float
    low: int
    high: int
    cell: int
    cells: dict[Tree, int]

    def fits(self, argument):
        """Return whether an argument leads into the cell, or stays in it."""
        sign = first_sign(argument - constant(self.point))
        if self.tree.kind in HALVES:
            return self.cell == sign
        return (self.cell == self.high) == (sign >= 0)


class HeldError(UndecidedError):
    """The motion rests at a jump, where any value between both sides is possible."""


class NoSlideError(Exception):
    """Both sides of a switch have equal forces, so that no slide is determined."""


class Flights:
    """Motions of a model within arcs.

    forks : the decisions that the model leaves open; each script is another motion
    """

    def __init__(self, model, forks=None):
        self.m, self.forks = model, forks
        self._forked: dict[Any, int] = {}
        self.lines = {s.name: s.at for s in model.sections if s.at is not None} | {
            e.name: e.equal for e in model.events if e.equal is not None
        }
        # Whether a switch depends on positions and the time alone.
        self.placed: dict[Tree, bool] = {}
        # What has no jump but makes one in a force.
        self.kinks = {x for tree in model.potentials for x in tree.nodes()}
        self.tied: list[Tree] = []
        self._left = MOST_CHOICES
        self.slides = self.helds = 0

    # What a model leaves open

    def fork(self, key, count, why):
        """Return the way taken at a fork of several ways; one key has one way.

        Raises
        ------
        UndecidedError
            No forks are allowed.
        """
        if self.forks is None:
            raise UndecidedError(why)
        if key not in self._forked:
            self._forked[key] = self.forks.pick(count)
        return self._forked[key]

    def _rounded(self, reading, tree, point, low, high):
        """Return the cell of an argument at a point between cells, to rounding."""
        x = float(reading.arguments[tree][0])
        near = high if x > point else low
        cells = [near, 0] if tree.kind in HALVES else [low, high]
        key = (tree, x)
        return cells[self.fork(key, 2, f"a value at a point of {tree.kind}")]

    def either(self, t):
        """Return a function that chooses cells where both sides are possible at t."""

        def choose(reading, tree, point, low, high):
            cells = [0, high, low] if tree.kind in HALVES else [high, low]
            why = f"a value at a point of {tree.kind}"
            rests = first_sign(reading.arguments[tree] - constant(point)) == 0
            return cells[self.fork((tree, None if rests else t), len(cells), why)]

        return choose

    def reading(self, series, cells, choose=None):
        return Reading(series, cells, choose, self._rounded)

    def begin(self, t, y, modes):
        """Return series of all variables at an instant, of positions with a slope."""
        n, s = self.m.n, {}
        for k in range(n):
            s[f"q{k + 1}"], s[f"v{k + 1}"] = constant(y[k]), constant(y[n + k])
            s[f"q{k + 1}"][1] = y[n + k]
        for k, z in enumerate(self.m.states):
            s[z] = constant(y[2 * n + k])
        s["t"] = constant(t)
        s["t"][1] = 1.0
        return s | {u: constant(x) for u, x in modes.items()}

    # A motion in fixed cells

    def _forces(self, r):
        m, found = self.m, []
        for k, own in enumerate(m.forces, 1):
            f = constant(0.0)
            for tree in own:
                f = f + r.value(tree)
            for tree in m.potentials:
                f = f - r.slope(tree, f"q{k}")
            for tree in m.dissipations:
                f = f - r.slope(tree, f"v{k}")
            found.append(m.nudge * f)
        return found

    def _law_mode(self, law, r, script):
        if law.when is not None and not r.value(law.when):
            return "off"
        if law.kind == "hold":
            return "on"
        rate = law.rate(r)[0]
        if law.kind == "contact":
            if not law.touches(r) or rate > TIE:
                return "open"
            return ("closed", "open")[script.pick(2)]
        if abs(rate) > TIE:
            return 1 if rate > 0 else -1
        return ("stick", 1, -1)[script.pick(3)]

    def _motion(self, r, law_modes):
        """Return accelerations, multipliers and rates of states, all series."""
        m, f = self.m, self._forces(r)
        held, multipliers = [], [constant(0.0) for _ in m.laws]
        for j, (law, mode) in enumerate(zip(m.laws, law_modes, strict=True)):
            if law.when is not None:
                r.value(law.when)
            if law.height is not None:
                r.value(law.height)
            if mode == "stick":
                r.value(law.static or law.bound)
            if mode in (1, -1):
                bound = r.value(law.bound)
                multipliers[j] = -mode * bound
                f = [x - mode * c * bound for x, c in zip(f, law.row, strict=True)]
            if mode in ("on", "stick", "closed"):
                held.append(j)
        a = [x / mass for x, mass in zip(f, m.masses, strict=True)]
        if held:
            a, p = self._held(r, a, held)
            for j, x in zip(held, p, strict=True):
                multipliers[j] = x
        return a, multipliers, {z: r.value(x) for z, x in m.rates.items()}

    def _held(self, r, a, held):
        """Return accelerations and multipliers under rows whose rates stay 0."""
        laws = [self.m.laws[j] for j in held]
        A = np.array([law.at(r) for law in laws])
        W = A @ (A / self.m.masses).T
        if np.linalg.cond(W) > 1e8:
            raise UndecidedError("redundant rows")
        want = np.zeros((len(held), ORDER + 1))
        for i, law in enumerate(laws):
            if law.belt:
                want[i, :-1] = r.value(law.belt)[1:] * COUNTED
        p = np.linalg.solve(W, want - A @ np.array(a))
        return list(np.array(a) + (A / self.m.masses).T @ p), p

    def solved(self, t, y, modes, cells, law_modes, choose, script, slide=None):
        """Solve for the arc after (t, y) in given cells and modes.

        cells : numbers of the cells of discrete functions, for each reading.
        law_modes : modes of the laws; None to choose them by accelerations.
        slide : the switch in which two readings differ, along which the motion slides.
        """
        s, share = self.begin(t, y, modes), None
        for _ in range(ORDER + 3):
            readings = [self.reading(s, c, choose) for c in cells]
            if law_modes is None:
                law_modes = [
                    self._law_mode(x, readings[0], script) for x in self.m.laws
                ]
            parts = [self._motion(r, law_modes) for r in readings]
            motion = parts[0]
            if slide is not None:
                share, motion = self._mixed(slide, readings, parts)
            new = self._integrated(s, motion)
            change = max(
                float(np.max(np.abs(new[k] - s[k]) / (1.0 + np.abs(s[k])))) for k in new
            )
            s = s | new
            if change < 1e-17:
                break
        if not all(np.all(np.isfinite(x)) for x in s.values()):
            raise UndecidedError("not finite")
        readings = [self.reading(s, c, choose) for c in cells]
        for r in readings:
            self._motion(r, law_modes)
        return Arc(t, s, modes, readings, law_modes, motion[1], motion[0], slide, share)

    def _integrated(self, s, motion):
        new = {}
        for k, a in enumerate(motion[0], 1):
            new[f"v{k}"] = integral(s[f"v{k}"], a)
            new[f"q{k}"] = integral(s[f"q{k}"], new[f"v{k}"])
        return new | {z: integral(s[z], x) for z, x in motion[2].items()}

    def _mixed(self, slide, readings, parts):
        """Return the weight of the upper side in a slide, and its motion."""
        pairs = list(zip(readings, parts, strict=True))
        below, above = (self._drift(slide, r, p) for r, p in pairs)
        gap = below - above
        if abs(gap[0]) <= NOTHING and max(abs(below[0]), abs(above[0])) <= NOTHING:
            # It rests at a switch of places alone, and both sides push.
            below, above = (self._push(slide, r, p) for r, p in pairs)
            gap = below - above
        if abs(gap[0]) <= NOTHING:
            raise NoSlideError
        if abs(gap[0]) < 1e-6:
            raise UndecidedError("a slide that no side moves")
        share = over(below, gap)

        def mix(a, b):
            return a + times(share, b - a)

        (a, p, z), (b, r, w) = parts
        return share, (
            [mix(x, y) for x, y in zip(a, b, strict=True)],
            [mix(x, y) for x, y in zip(p, r, strict=True)],
            {k: mix(z[k], w[k]) for k in z},
        )

    def _drift(self, slide, r, part):
        """Return the rate of a switch's argument in the motion of one side."""
        a, _, rates = part
        by = {"t": constant(1.0)} | rates
        for k, x in enumerate(a, 1):
            by |= {f"v{k}": x, f"q{k}": r.series[f"v{k}"]}
        total = constant(0.0)
        for name, rate in by.items():
            total = total + times(self._slope(slide, r, name), rate)
        return total

    def _push(self, slide, r, part):
        """Return the second derivative of a switch's argument in the motion of a side.

        It is that in the motion of the series, but for the accelerations.
        """
        total = rate_of(self._drift(slide, r, part))
        for k, a in enumerate(part[0], 1):
            more = a - rate_of(r.series[f"v{k}"])
            total = total + times(self._slope(slide, r, f"q{k}"), more)
        return total

    def _slope(self, slide, r, name):
        slopes = [r.slope(tree, name) for tree in slide.args]
        return KINDS[slide.kind].of(slide.data, *slopes)

    # The choice of cells and modes

    def choose(self, t, y, modes):
        """Return the arc whose series leads into its own cells and modes."""
        self.tied, self._left = [], MOST_CHOICES
        try:
            found = self._ways(t, y, modes, loose=False)
        except HeldError as held:
            self.helds += 1
            found = _different(
                _holding(self._candidates(t, y, modes, None, loose=True))
            )
            if len(found) > 1:
                # One policy for the whole run: the values at the switch decide.
                way = self.fork("held", 3, str(held))
                found = [found[way % len(found)]]
            for arc in found:
                arc.held = True
        if not found:
            raise UndecidedError(f"no way on at {t}")
        way = 0
        if len(found) > 1:
            way = self.fork(("ways", t), len(found), f"{len(found)} ways on at {t}")
        return self.observed(found[way])

    def _ways(self, t, y, modes, *, loose):
        found = self._candidates(t, y, modes, None, loose=loose)
        if not found and self.tied:
            for node in self.tied:
                found += self._candidates(t, y, modes, node, loose=loose)
            found = _different(found)  # along one surface by several switches
            self.slides += bool(found)
        return _holding(found)

    def _candidates(self, t, y, modes, slide, *, loose=False):
        """Return all arcs whose motions stay in the cells and modes chosen for them.

        loose : whether a switch whose argument rests at a point may be in any cell
        """
        found, script = [], Script()
        while script is not None:
            self._left -= 1
            if self._left < 0:
                raise UndecidedError("too many choices")
            script.asked = 0
            arc = self._tried(t, y, modes, script, slide, loose=loose)
            if arc is not None:
                found.append(arc)
            script = script.next()
        return found

    def _tried(self, t, y, modes, script, slide, *, loose=False):
        """Return the arc of the choices of a script where these are consistent."""
        ties: list[Tie] = []
        cells = [{}] if slide is None else self._sides(slide, t, y, modes)

        def choose(reading, tree, point, low, high):
            if slide is None and self._jumps(tree) and tree not in self.tied:
                self.tied.append(tree)
            if not np.any(self._gradient(tree, reading)):
                # Switches make it constant: its value is that of its cells.
                if float(reading.arguments[tree][0]) == point:
                    return 0 if tree.kind in HALVES else high
                return self._rounded(reading, tree, point, low, high)
            if slide is not None and (c := self._along(slide, tree, reading)):
                return high if (reading.cells is cells[1]) == (c > 0) else low
            slope = reading.arguments[tree][1]
            if self._is_placed(tree) and abs(slope) > LITTLE:
                cell = high if slope > 0 else low
            else:
                options = [low, high, 0] if tree.kind in HALVES else [low, high]
                cell = options[script.pick(len(options))]
            ties.append(Tie(tree, point, low, high, cell, reading.cells))
            return cell

        try:
            arc = self.solved(t, y, modes, cells, None, choose, script, slide)
        except NoSlideError:
            return None
        if not self._ties_fit(arc, ties, loose=loose):
            return None
        if slide is not None and not (
            first_sign(arc.share) >= 0 and first_sign(constant(1.0) - arc.share) >= 0
        ):
            return None
        return arc if self._laws_fit(arc) else None

    def _ties_fit(self, arc, ties, *, loose):
        """Whether a motion leads into the cells chosen for it."""
        rests = self._rests(arc, ties)
        for tie in ties:
            # In a slide each side has cells of its own.
            found = [r.arguments[tie.tree] for r in arc.readings
                     if r.cells is tie.cells and tie.tree in r.arguments]  # fmt: skip
            at_rest = loose and tie.tree in rests
            if not at_rest and not all(tie.fits(x) for x in found):
                return False
        if not loose and self._is_ambiguous(arc, rests):
            raise HeldError("held on a switch")
        return True

    def _along(self, slide, tree, reading):
        """Return the ratio of the gradients of two arguments, or 0 if not parallel."""
        if tree in slide.nodes():
            return 0.0
        a, b = (self._gradient(x, reading) for x in (slide, tree))
        ratio = float(a @ b / (a @ a)) if np.any(a) else 0.0
        return ratio if np.max(np.abs(b - ratio * a)) <= NOTHING else 0.0

    def _gradient(self, tree, reading):
        """Return the derivatives of a switch's argument by all that moves."""
        names = [x for x in reading.series if x[0] not in "ua"]
        return np.array([self._slope(tree, reading, name)[0] for name in names])

    def _rests(self, arc, ties):
        """Return the switches of positions whose arguments are constant, at a point."""
        known = arc.readings[0].arguments
        return [
            tie.tree
            for tie in ties
            if self._is_placed(tie.tree)
            and tie.tree in known
            and first_sign(known[tie.tree] - constant(tie.point)) == 0
        ]

    def _is_ambiguous(self, arc, rests):
        """Whether a motion rests on a jump that does not determine the motion alone.

        The value there is arbitrary between both sides: Filippov's motion is not
        unique.
        """
        held = bool({"stick", "closed"} & set(arc.law_modes)) or len(rests) > 1
        return held and any(map(self._jumps, rests))

    def _jumps(self, tree):
        return tree.kind not in CONTINUOUS or tree in self.kinks

    def _is_placed(self, tree):
        """Whether an argument depends on positions, t and modes alone."""
        if tree not in self.placed:
            names = {x.data[0] for x in tree.nodes() if x.kind == "var"}
            self.placed[tree] = not names & set("vz")
        return self.placed[tree]

    def _sides(self, slide, t, y, modes):
        """Return the cells on both sides of a switch that slides."""
        r = self.reading(self.begin(t, y, modes), {}, _upper)
        r.value(slide)
        x, kind = float(r.arguments[slide][0]), KINDS[slide.kind]
        aside = 10.0 * TIE * max(1.0, abs(x))
        return [{slide: kind.cell(slide.data, x + c * aside)} for c in (-1.0, 1.0)]

    def _laws_fit(self, arc):
        laws = zip(self.m.laws, arc.law_modes, arc.multipliers, strict=True)
        return all(self._law_fits(arc, *each) for each in laws)

    def _law_fits(self, arc, law, mode, p):
        r = arc.readings[0]
        if mode == "stick":
            bound = r.value(law.static or law.bound)
            return min(first_sign(bound - p), first_sign(bound + p)) >= 0
        if mode in (1, -1):
            if r.value(law.bound)[0] < 0:
                raise UndecidedError("a limit below 0")
            return first_sign(mode * law.rate(r)) > 0
        if mode == "closed":
            return first_sign(p) >= 0
        if mode == "open" and law.touches(r):
            gap = law.gap(r)
            gap[:2] = np.where(np.abs(gap[:2]) <= TIE, 0.0, gap[:2])
            return gap[1] > 0.0 or first_sign(gap) > 0
        return True

    # What ends an arc

    def observed(self, arc):
        """Evaluate expressions without effect on the motion; collect conditions."""
        m, slides = self.m, arc.slide is not None
        r = arc.out = self.reading(
            arc.series, {} if slides else dict(arc.readings[0].cells), _later
        )
        arc.truths = {e.name: r.value(e.at) for e in m.events if e.at is not None}
        if m.until is not None:
            arc.truths["until"] = r.value(m.until)
        arc.lines = {k: r.value(x) for k, x in self.lines.items()}
        if not slides and not arc.held:
            arc.shown = {k: r.value(x) for k, x in m.shown.items()}
        watched = [*self._watched_cells(arc), *self._watched_laws(arc)]
        if slides:
            watched += [("share", arc.share), ("share", constant(1.0) - arc.share)]
        for name, x in arc.lines.items():
            watched.append((("line", name), (first_sign(x) or 1) * x))
        arc.watched = [(key, deflated(x)) for key, x in watched]
        return arc

    def _watched_cells(self, arc):
        for r in (*arc.readings, arc.out):
            for tree, x in r.arguments.items():
                cell = r.cells[tree]
                if tree is arc.slide or (cell == 0 and tree.kind in HALVES):
                    continue
                low, high = KINDS[tree.kind].bounds(tree.data, cell)
                for point, sign in ((low, 1.0), (high, -1.0)):
                    if math.isfinite(point):
                        yield ("cell", tree), sign * (x - constant(point))

    def _watched_laws(self, arc):
        r = arc.readings[0]
        laws = zip(self.m.laws, arc.law_modes, arc.multipliers, strict=True)
        for j, (law, mode, p) in enumerate(laws):
            if mode == "stick":
                bound = r.value(law.static or law.bound)
                yield ("slips", j), bound - p
                yield ("slips", j), bound + p
            elif mode in (1, -1):
                yield ("stops", j), mode * law.rate(r)
            elif mode == "closed":
                yield ("leaves", j), p
            elif mode == "open":
                yield ("strikes", j), law.gap(r)


def _holding(found):
    """Return the arcs in which most laws hold and do not slide."""
    most = max((a.law_modes.count("stick") for a in found), default=0)
    return [a for a in found if a.law_modes.count("stick") == most]


def _different(found):
    """Return the arcs with different motions."""
    own: list[Arc] = []
    for a in found:
        if not any(_same(a, b) for b in own):
            own.append(a)
    return own


def _same(a, b):
    """Return whether two arcs have equal motions, in equal or in different cells."""
    if a.law_modes != b.law_modes:
        return False
    both = [
        [*x.accelerations, *x.multipliers, *(x.series[z] for z in sorted(x.series))]
        for x in (a, b)
    ]
    return all(np.max(np.abs(x - y)) <= NOTHING for x, y in zip(*both, strict=True))


def _upper(_reading, _tree, _point, _low, high):
    return high


def _later(reading, tree, point, low, high):
    """Return the cell that an argument, a series in time, enters after the instant."""
    sign = first_sign(reading.arguments[tree] - constant(point))
    if sign == 0:
        return 0 if tree.kind in HALVES else high
    return high if sign > 0 else low


def given(_reading, tree, _point, _low, _high):
    raise UndecidedError(f"the cell of a {tree.kind} is missing")
