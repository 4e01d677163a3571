"""One run of a model with one method and step, and the verdict on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import Instant
from lagsim.mechanics.linearisation import Linearisation
from lagsim.methods import method as method_named
from lagsim.run.observers import Keep
from lagsim.run.observers.monitors import judged_columns
from lagsim.run.session import Session
from lagsim.run.system import System
from lagsim.run.trajectory import Outcome
from lagsim.studies.bench.solving import asking

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case

HOLDS, GROWS, DECAYS = "holds", "grows", "decays"
DIVERGES, BREAKS, FAILS = "diverges", "breaks the constraint", "fails"
VERDICTS = (HOLDS, DECAYS, GROWS, DIVERGES, BREAKS, FAILS)
STABLE = (HOLDS, DECAYS)

# Of the energy of the motion, an unexplained change over the run.
CHANGE = 0.01
# What varies anyway hides this part of its range.
HIDDEN = 0.1
# An energy that has grown by more than this, unexplained, goes to infinity.
BEYOND = 1e3
# A residual of this part of its scale: the constraint does not hold.
BROKEN = 1e-3
# The part of a run that is compared with its start, and with its middle.
LAST, MIDDLE = 1 / 8, (7 / 16, 9 / 16)

# Every mode takes part: the velocities are changed by this part of the energy, in
# directions drawn from this seed.
KICK = 1e-6
SEED = 5
# An energy that varies by no more than this part of itself is that of rest.
REST = 1e-12
# What replaces the amplitude about an equilibrium.
SMALL = 1e-3

# States along the motion, and the most nodes and coordinates for them.
STATES = 100
MOST_NODES = 1_000_000
MOST_COORDINATES = 100
TRUSTED_ROWS = 400
TRUSTED_STEPS = 300_000
ADAPTIVE_STEPS = 300_000


@dataclass(frozen=True, slots=True)
class Cell:
    """One run.

    Attributes
    ----------
    step : float or None
        None where the method chooses its steps.
    value : float or None
        Of the parameter that varies.
    growth : float or None
        Of the energy, unexplained, per unit of time.
    """

    method: str
    step: float | None
    value: float | None
    verdict: str
    growth: float | None
    evaluations: int | None
    rejections: int | None = None
    smallest_step: float | None = None
    duration: float | None = None
    reason: str = ""

    @property
    def stable(self) -> bool:
        """Whether the motion neither grows nor is lost."""
        return self.verdict in STABLE


class Subject:
    """A model at given parameters, looked at once, ready to be run.

    Attributes
    ----------
    energy : float
        Of the motion: the largest kinetic energy, or change of the rest.
    highest : float
        The largest value of the energy.
    size : float
        Of the positions, in the metric of M.
    span : float
        How long the model runs.
    switches : bool
        Switches in the state are located, each by itself.
    at_start, along : ndarray of complex
        Eigenvalues at the start, and at `states` states of the motion.
    arcs : float
        About how many switches end an arc, per unit of time.
    unknown : str
        Why there are no eigenvalues; "" where there are.
    """

    def __init__(self, case: Case, interrupt: Interrupt | None = None) -> None:
        self.case, self.interrupt = case, interrupt
        self.equations = case.equations
        endless = replace(self.equations.model, until=None)
        self.endless = case._replace(equations=self.equations.of(endless))
        self.span = case.settings.duration
        self._systems: dict[tuple[object, ...], System] = {}
        self.motion = self._trusted()
        self._measure()
        self.unknown = ""
        self.at_start = self.along = np.zeros(0, complex)
        self.states = 0
        self.linearisation: Linearisation | None = None
        if len(self.equations.q) > MOST_COORDINATES:
            self.unknown = f"the model has more than {MOST_COORDINATES} coordinates"
        else:
            self._linearise()

    def _trusted(self) -> Floats:
        """Give rows (t, q, q') of the motion, by what `auto` takes."""
        trusted = asking(self.case).asking(output_step=self.span / TRUSTED_ROWS)
        session = trusted.ready()._replace(most_steps=TRUSTED_STEPS)
        self.switches = session.system.surfaces > 0
        kept = Keep(columns=1 + 2 * len(self.equations.q))
        with np.errstate(all="ignore"):
            trajectory = session.run([kept], interrupt=self.interrupt)
        switched = sum(event.kind == "switch" for event in trajectory.events)
        self.arcs = switched / self.span
        rows = kept.table
        return np.asarray(rows[np.all(np.isfinite(rows), axis=1)])

    def _measure(self) -> None:
        e = self.equations
        kinetic, rest = [], []
        values = {p.name: p.value for p in e.model.parameters}
        names = ("t", *e.q, *e.velocities)
        for row in self.motion[:: max(1, len(self.motion) // STATES)]:
            values |= dict(zip(names, map(float, row), strict=True))
            T, energy = evaluate(e.graph, [e.kinetic_form, e.energy], values)
            kinetic.append(T)
            rest.append(energy - T)
        self.highest = max(map(sum, zip(kinetic, rest, strict=True)))
        ranges = max(kinetic), max(rest) - min(rest)
        self.energy = max(ranges)
        if self.energy <= REST * max(map(abs, rest)):
            self.energy = 0.0

    def _linearise(self) -> None:
        n = len(self.equations.q)
        linearisation = Linearisation(self.equations)
        self.linearisation = linearisation
        states = max(10, min(STATES, MOST_NODES // linearisation.nodes))
        each = max(1, len(self.motion) // states)
        found = []
        for row in self.motion[::each]:
            try:
                linear = linearisation.at(row[0], row[1 : 1 + n], row[1 + n :])
                found.append(linear.eigenvalues())
            except (ValueError, np.linalg.LinAlgError):
                continue
        if not found:
            self.unknown = "its slopes at the start are not finite"
            self.size = 0.0
            return
        self.at_start, self.along = found[0], np.concatenate(found)
        self.states = len(found)
        start = self.case.start
        linear = linearisation.at(start.t, start.q, start.v)
        sizes = np.linalg.norm(linear.lengths @ self.motion[:, 1 : 1 + n].T, axis=0)
        self.size = float(np.max(sizes))
        fastest = float(np.max(np.abs(self.along), initial=0.0)) or 1.0 / self.span
        kick = KICK * self.energy
        if self.energy == 0.0:
            kick = 0.5 * (SMALL * (self.size or 1.0) * fastest) ** 2
            self.energy = kick
        drawn = np.random.default_rng(SEED).standard_normal(linear.Z.shape[1])
        length = float(np.linalg.norm(drawn)) or 1.0
        change = linear.Z @ (drawn * math.sqrt(2.0 * kick) / length)
        self.endless = self.endless.at(Instant(start.t, start.q, start.v + change))

    def run(
        self, name: str, step: float | None, steps: int, value: float | None
    ) -> Cell:
        """Run `steps` steps, or with None as long as the model says; judge."""
        asked = self.endless.asking(method=name, step=step)
        most = ADAPTIVE_STEPS
        if step is not None:
            end = asked.settings.start + steps * step
            asked = asked.asking(output_step=step, end=end, rtol=None, atol=None)
            most = 2 * steps + 1000
        session = self._ready(name, asked)._replace(most_steps=most)
        watch = _Watch(session.system.columns.names)
        with np.errstate(all="ignore"):
            session = session.by(replace(session.plan, step=step))
            trajectory = session.run([watch], interrupt=self.interrupt)
            verdict, growth = watch.verdict(
                trajectory.outcome, self.energy, self.highest
            )
        counts = trajectory.statistics
        complete = trajectory.outcome.complete
        return Cell(
            name, step, value, verdict, growth, counts.evaluations,
            counts.rejections, counts.smallest_step,
            trajectory.end - trajectory.start, "" if complete else trajectory.reason,
        )  # fmt: skip

    def _ready(self, name: str, case: Case) -> Session:
        """Plan; systems are shared by methods that need the same.

        Raises
        ------
        InputError
            Where it cannot handle the model.
        """
        plan = case.plan()
        key = (
            method_named(name).NEEDS, plan.formulation, plan.elimination is None,
            plan.projected, plan.tape, plan.constant, plan.newton is None,
        )  # fmt: skip
        if key not in self._systems:
            self._systems[key] = System(case.equations, plan)
        return Session(case, plan, self._systems[key])

    def evaluation(self) -> int:
        """Give about how many operations an evaluation of the equations takes."""
        e = self.equations
        nodes = [*e.mass_entries.values(), *e.f]
        nodes += [x for row in e.rows for x in (*row.A.entries.values(), row.b)]
        return len(e.graph.cone(nodes)) + 10 * (len(e.q) + len(e.rows))


class _Watch:
    """An observer that keeps what a verdict needs."""

    def __init__(self, columns: Sequence[str]) -> None:
        self._energy = columns.index("energy")
        self._work = columns.index("work") if "work" in columns else None
        self._held = list(judged_columns(columns).values())
        self._kept: list[Floats] = []
        self.residual = 0.0

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        energy = rows[:, self._energy]
        work = 0.0 if self._work is None else rows[:, self._work]
        self._kept.append(np.stack((rows[:, 0], energy, energy - work)))
        for residual, scale in self._held:
            sizes = np.maximum(np.max(rows[:, scale]), 1e-300)
            worst = np.max(np.abs(rows[:, residual])) / sizes
            self.residual = float(np.maximum(self.residual, worst))

    def verdict(
        self, outcome: Outcome, scale: float, highest: float
    ) -> tuple[str, float | None]:
        """Judge; give the growth of the energy, unexplained, per unit of time, too.

        By the energy of the motion, and the highest that it has.
        """
        t, energy, balance = np.concatenate(self._kept, axis=1)
        # The row at which a run ends without an answer may be nothing.
        known = np.isfinite(energy) & np.isfinite(balance)
        count = int(np.argmin(known)) if not known.all() else len(t)
        t, energy, balance = t[:count], energy[:count], balance[:count]
        if count < 2:
            return (FAILS if outcome.complete else _lost(outcome)), None
        energy, balance = energy / scale, (balance - balance[0]) / scale
        growth = _rate(t, balance)
        changes = np.abs(energy - energy[0]), np.abs(balance)
        gone = min(float(np.max(change)) for change in changes) > BEYOND
        gone |= count < len(known)
        if self.residual > BROKEN and not gone:
            return BREAKS, growth
        if gone or not outcome.complete:
            return (DIVERGES if gone else _lost(outcome)), growth
        ceiling = -math.inf if self._work is None else highest / scale
        return _trend(energy, balance, ceiling), growth


def _lost(outcome: Outcome) -> str:
    if outcome is Outcome.PROJECTION_FAILED:
        return BREAKS
    return DIVERGES if outcome is Outcome.NOT_FINITE else FAILS


def _rate(t: Floats, balance: Floats) -> float | None:
    """Give the rate at which what is not explained changes the energy.

    As of an exponential; what has decayed altogether decays at least at this rate.
    """
    last = max(1, int(len(t) * LAST))
    middle = float(np.mean(t[-last:])) - float(t[0])
    if balance[-1] > BEYOND or middle <= 0.0:
        last, middle = 1, float(t[-1] - t[0])
    left = max(1.0 + float(np.mean(balance[-last:])), 1e-16)
    return math.log(left) / middle if middle > 0.0 else None


def _trend(energy: Floats, balance: Floats, ceiling: float) -> str:
    """Tell whether what is not explained has changed the energy.

    A change lifts or lowers the whole last part of a run past its first value. Where
    something does work, the energy must also leave where the motion keeps it, and go
    on: the work, summed up with the order of the method, explains no more than roughly.
    """
    last = balance[-max(1, int(len(balance) * LAST)) :]
    low, high = float(np.min(last)), float(np.max(last))
    bound = CHANGE * (1.0 - LAST) + HIDDEN * (high - low)
    level = float(np.mean(energy[-len(last) :]))
    if high < -bound:
        explained = ceiling > -math.inf and level >= energy[0] - bound
        return HOLDS if explained else DECAYS
    if low <= bound or level <= ceiling + CHANGE:
        return HOLDS
    return GROWS if ceiling == -math.inf or _rises(energy, len(last)) else HOLDS


def _rises(energy: Floats, last: int) -> bool:
    """Tell whether the energy still rises in the second half."""
    begin, end = (int(len(energy) * part) for part in MIDDLE)
    late, before = energy[-last:], energy[begin : max(end, begin + 1)]
    varies = min(float(np.ptp(late)), float(np.ptp(before)))
    rise = float(np.mean(late) - np.mean(before))
    return rise > 0.25 * CHANGE + HIDDEN * varies
