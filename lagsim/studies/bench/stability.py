"""Maps of stability: verdicts on runs over steps and a parameter.

`Subject` runs a model with one method and step, and judges the run. `_Map` selects the
range of steps and the length of runs, makes the runs, and locates the borders. The
results are stored as in stability.json.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.codes.known import ADAPTIVE_METHOD, METHOD_REFUSED, NO_STABILITY
from lagsim.errors import InputError, LagsimError, Problems, unusable
from lagsim.language.evaluate import evaluate_rows
from lagsim.mechanics.equations import Instant
from lagsim.mechanics.linearisation import (
    EigenMode,
    Linearisation,
    eigenvalues_of,
    modes,
)
from lagsim.methods import method as method_named
from lagsim.methods import names
from lagsim.outputs.manifest import head
from lagsim.plan.method_choice import method_refusal, structure
from lagsim.run.interrupt import Interrupt
from lagsim.run.observers.monitors import ResidualMonitor
from lagsim.run.trajectory import Outcome
from lagsim.studies.bench import with_method
from lagsim.studies.modes import SmallMotions
from lagsim.studies.nonlinear import Linearised, not_linear
from lagsim.studies.repeats import evaluation_cost
from lagsim.studies.rest import NoRestError
from lagsim.studies.step_bounds import predicted
from lagsim.studies.trial import Compiled, Trial, refused_trial, tried
from lagsim.tolerances import BROKEN_CONSTRAINT, COMPUTED_ZERO, CONVERGED, ENERGY_CHANGE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Caution
    from lagsim.run.session import Case
    from lagsim.studies.rest import Steady

    Progress = Callable[[float], None] | None

    Document = dict[str, Any]

HOLDS, GROWS, DECAYS = "holds", "grows", "decays"
DIVERGES, BREAKS, FAILS = "diverges", "breaks the constraint", "fails"
VERDICTS = (HOLDS, DECAYS, GROWS, DIVERGES, BREAKS, FAILS)
# Verdicts on failed runs; others fail.
LOST = {Outcome.PROJECTION_FAILED.value: BREAKS, Outcome.NOT_FINITE.value: DIVERGES}

# A change smaller than this part of the range of an oscillating quantity is not
# detected.
HIDDEN = 0.1
# An energy that has grown by more than this, unexplained, goes to infinity.
BEYOND = 1e3
# The part of a run that is compared with its start, and with its middle.
LAST, MIDDLE = 1 / 8, (7 / 16, 9 / 16)

# The velocities are changed by this part of the energy, in random directions from this
# seed, so that every mode is excited.
KICK = 1e-6
SEED = 5
# The relative amplitude that is assumed about an equilibrium.
SMALL = 1e-3

# States along the motion, and the most nodes and coordinates for them.
STATES = 100
MOST_NODES = 1_000_000
MOST_COORDINATES = 100
TRUSTED_ROWS = 400
TRUSTED_STEPS = 300_000
ADAPTIVE_STEPS = 300_000


class MapCell(NamedTuple):
    """Verdict on one run: a cell of the map.

    Attributes
    ----------
    verdict : str
        HOLDS, DECAYS or GROWS (the energy that no force explains), or the kind of
        failure.
    growth : float or None
        The growth rate of the energy without a force, per unit of time.
    evaluations, rejections : int or None
        Numbers of evaluations, and of rejected steps.
    smallest_step, duration : float or None
        The shortest step, and the time that was integrated.
    reason : str
        The reason of a failure.
    """

    verdict: str
    growth: float | None = None
    evaluations: int | None = None
    rejections: int | None = None
    smallest_step: float | None = None
    duration: float | None = None
    reason: str = ""

    @property
    def stable(self) -> bool:
        """Whether the numerical motion neither grows nor fails."""
        return self.verdict in (HOLDS, DECAYS)


class Subject:
    """Model at given parameters, with its eigenvalues, for runs at any method and step.

    Parameters
    ----------
    case : Case
        The model at these parameters, with its start.
    interrupt : Interrupt, optional
        Requests of an early end.
    compiled : Compiled, optional
        Compiled functions of the model, which are used if they fit.

    Attributes
    ----------
    energy : float
        The energy of the motion: the largest kinetic energy, or range of the remaining
        energy if larger.
    highest : float
        The largest value of the energy.
    size : float
        The largest norm of the positions in the metric of M.
    span : float
        The duration of the run.
    switches : bool
        Whether switches of the state are located one by one.
    at_start, along : ndarray of complex
        Eigenvalues at the start, and at `states` states of the motion.
    arcs : float
        The number of switches and events that end an arc, per unit of time.
    period : float
        The shortest period of an event, which bounds the step; inf without such an
        event.
    unknown : str
        The reason why there are no eigenvalues, or "".
    cautions : list of Caution
        Warnings where the motion about the start is not linear.
    costs : dict of str to float
        The cost of an evaluation in operations, by method, known after a run.
    """

    def __init__(
        self,
        case: Case,
        interrupt: Interrupt | None = None,
        compiled: Compiled | None = None,
    ) -> None:
        self.case, self.interrupt = case, interrupt
        self.compiled = compiled or Compiled()
        self.equations = e = case.equations
        endless = e.of(replace(e.model, until=None), begun_by=e.begun_by)
        self.endless = case._replace(equations=endless)
        self.span = case.settings.duration
        periods = (x.every for x in e.model.events if x.at is None)
        self.period = min(periods, default=math.inf)
        self.costs: dict[str, float] = {}
        motion = self._trusted()
        sample = motion[:: max(1, len(motion) // STATES)]
        values: dict[str, Any] = e.model.parameter_values
        values |= dict(zip(("t", *e.state), sample.T, strict=True))
        nodes = e.kinetic_form, e.energy
        kinetic, energy = evaluate_rows(e.graph, nodes, values, len(sample))
        rest = energy - kinetic
        self.highest = float(np.max(energy))
        self.energy = max(float(np.max(kinetic)), float(np.ptp(rest)))
        if self.energy <= CONVERGED * np.max(np.abs(rest)):
            self.energy = 0.0
        self.unknown, self.size, self.states = "", 0.0, 0
        self.at_start = self.along = np.zeros(0, complex)
        self.linearisation: Linearisation | None = None
        self.cautions: list[Caution] = []
        if len(e.q) > MOST_COORDINATES:
            self.unknown = f"the model has more than {MOST_COORDINATES} coordinates"
        else:
            self._linearise(motion)

    def _trusted(self) -> Floats:
        """Return rows of the motion, integrated by the method that `auto` selects.

        A row has t, q, q' and the first-order states s; the result is (k, columns).
        """
        trusted = with_method(self.case).with_settings(
            output_step=self.span / TRUSTED_ROWS
        )
        session = self.compiled.session(trusted)._replace(most_steps=TRUSTED_STEPS)
        self.switches = session.system.surfaces > 0
        trial = tried(session, interrupt=self.interrupt)
        ends = [event.kind in ("switch", "event") for event in trial.events]
        self.arcs = sum(ends) / self.span
        rows = trial.rows[:, self.equations.state_columns]
        return np.asarray(rows[np.all(np.isfinite(rows), axis=1)])

    def _linearise(self, motion: Floats) -> None:
        """Compute eigenvalues along a motion, and change the start velocities.

        The change is small, admissible and random, so that each mode is excited.

        motion : (k, columns), rows with t, q, q' and the first-order states s.
        """
        n, start = len(self.equations.q), self.case.start
        self.linearisation = linearisation = Linearisation(self.equations)
        states = max(10, min(STATES, MOST_NODES // linearisation.nodes))
        found = []
        for row in motion[:: max(1, len(motion) // states)]:
            with contextlib.suppress(ValueError, np.linalg.LinAlgError):
                state = np.split(row[1:], [n, 2 * n])
                linear = linearisation.at(row[0], *state)
                found.append(linear.eigenvalues())
        if not found:
            self.unknown = "its slopes at the start are not finite"
            return
        self.at_start, self.along = found[0], np.concatenate(found)
        self.states = len(found)
        linear = linearisation.at(start.t, start.q, start.v, start.s)
        values = linearisation.values(start.t, start.q, start.v, start.s).values
        known = self.equations, start, linearisation, values
        self.cautions = not_linear(Linearised(*known, (), (start.q, start.v)))
        sizes = np.linalg.norm(linear.lengths @ motion[:, 1 : 1 + n].T, axis=0)
        self.size = float(np.max(sizes))
        kick = KICK * self.energy
        if self.energy == 0.0:
            fastest = float(np.max(np.abs(self.along), initial=0.0)) or 1.0 / self.span
            kick = 0.5 * (SMALL * (self.size or 1.0) * fastest) ** 2
            self.energy = kick
        drawn = np.random.default_rng(SEED).standard_normal(linear.Z.shape[1])
        length = float(np.linalg.norm(drawn)) or 1.0
        change = linear.Z @ (drawn * math.sqrt(2.0 * kick) / length)
        self.endless = self.endless.at(
            Instant(start.t, start.q, start.v + change, start.s)
        )

    def run(self, name: str, step: float | None, steps: int = 0) -> MapCell:
        """Run the model by the method `name`; return its verdict, growth and costs.

        step : the fixed step, of which the run has `steps`; None: the method controls
            its step, and the run has the duration of the model.

        Raises
        ------
        InputError
            If the method cannot handle the model.
        """
        case, most = self.endless.with_settings(method=name, step=step), ADAPTIVE_STEPS
        if step is not None:
            end = case.settings.start + steps * step
            case = case.with_settings(output_step=step, end=end, rtol=None, atol=None)
            most = 2 * (steps + math.ceil(self.arcs * steps * step)) + 1000
        session = self.compiled.session(case, replace(case.plan(), step=step))
        self.costs[name] = evaluation_cost(session.system, name)
        trial = tried(session._replace(most_steps=most), interrupt=self.interrupt)
        with np.errstate(all="ignore"):
            found = self._verdict(trial)
        counts = trial.statistics
        return MapCell(
            *found, counts.evaluations, counts.rejections, counts.smallest_step,
            trial.end - case.settings.start, "" if trial.complete else trial.reason,
        )  # fmt: skip

    def _verdict(self, trial: Trial) -> tuple[str, float | None]:
        """Return the verdict on a run, and the growth rate of unexplained energy."""
        columns, rows = trial.columns, trial.rows
        works = "work" in columns
        t, energy = rows[:, 0], rows[:, columns.index("energy")]
        balance = energy - (rows[:, columns.index("work")] if works else 0.0)
        residuals = ResidualMonitor(columns)
        residuals.add(rows)
        verdict = LOST.get(trial.code, FAILS)
        # The last row of a failed run may be nan.
        known = np.isfinite(energy) & np.isfinite(balance)
        count = int(np.argmin(known)) if not known.all() else len(t)
        t, energy, balance = t[:count], energy[:count], balance[:count]
        if count < 2:
            return verdict, None
        energy, balance = energy / self.energy, (balance - balance[0]) / self.energy
        growth = _rate(t, balance)
        changes = np.abs(energy - energy[0]), np.abs(balance)
        diverges = min(float(np.max(change)) for change in changes) > BEYOND
        diverges |= count < len(known)
        if residuals.constraint_residual > BROKEN_CONSTRAINT and not diverges:
            return BREAKS, growth
        if diverges or not trial.complete:
            return (DIVERGES if diverges else verdict), growth
        ceiling = self.highest / self.energy if works else -math.inf
        return _trend(energy, balance, ceiling), growth


def _rate(t: Floats, balance: Floats) -> float | None:
    """Return the exponential rate of the energy that no force explains.

    It is a bound if the energy has decayed completely; None if it is unknown.

    t : (k,), the times of the rows.
    balance : energy less work (k,), relative to the energy of the motion.
    """
    last = max(1, int(len(t) * LAST))
    middle = float(np.mean(t[-last:])) - float(t[0])
    if balance[-1] > BEYOND or middle <= 0.0:
        last, middle = 1, float(t[-1] - t[0])
    left = max(1.0 + float(np.mean(balance[-last:])), 1e-16)
    return math.log(left) / middle if middle > 0.0 else None


def _trend(energy: Floats, balance: Floats, ceiling: float) -> str:
    """Return the verdict HOLDS, DECAYS or GROWS on the unexplained energy.

    An unexplained change moves the whole last part of a run above or below the first
    value. In a system with work of forces, growth counts only if in addition the energy
    leaves the range of the motion, and rises in the second half: the work, which is
    integrated with the order of the method, explains the energy only roughly.

    Parameters
    ----------
    energy, balance : ndarray, shape (k,)
        The energy, and the energy less the work, relative to the energy of the motion.
    ceiling : float
        The largest energy of the motion; -inf in a system without work.
    """
    last = max(1, int(len(balance) * LAST))
    low, high = float(np.min(balance[-last:])), float(np.max(balance[-last:]))
    bound = ENERGY_CHANGE * (1.0 - LAST) + HIDDEN * (high - low)
    last_energies, works = energy[-last:], ceiling > -math.inf
    level = float(np.mean(last_energies))
    if high < -bound:
        return HOLDS if works and level >= energy[0] - bound else DECAYS
    if low <= bound or level <= ceiling + ENERGY_CHANGE:
        return HOLDS
    begin, end = (int(len(energy) * part) for part in MIDDLE)
    before = energy[begin : max(end, begin + 1)]
    varies = min(float(np.ptp(last_energies)), float(np.ptp(before)))
    rises = level - np.mean(before) > 0.25 * ENERGY_CHANGE + HIDDEN * varies
    return GROWS if rises or not works else HOLDS


# Cells of a strip, and of a map: steps, values of the parameter.
STRIP = 48
MAP = (24, 16)
# Number of further runs that locate a border.
SEARCH = 14
# The range of steps: from BELOW times the smallest predicted border to ABOVE times the
# largest, with a ratio of at most WIDEST.
BELOW, ABOVE, WIDEST = 0.1, 1.6, 1e3
# The range if no border is predicted, in parts of the fastest period, or of the run.
OF_PERIOD = (0.02, 1.0)
OF_RUN = (1e-4, 0.1)
# A border is located to three digits; steps at these ratios to a predicted border are
# run in addition.
DIGITS = 2e-4
AROUND = (0.99, 1.01)

# Steps of a run: the usual number, the largest for the duration of the model, and the
# least where the budget is short.
STEPS, MOST_STEPS, LEAST_STEPS = 10_000, 40_000, 400
# Operations for all runs, about 10 s; the operations of a step and its row without its
# evaluations; and the steps of the run that measures the evaluations in a step.
BUDGET = 1e10
OVERHEAD = 1000
PILOT = 20
# A switch costs about a million, and there may be one in every ten steps.
SWITCHING = 100_000
# Operations of a switch in time. Their number is known, and a long step contains many.
ARC = 1_000_000

# The reason why a model with laws has no map.
UNSTEADY = (
    "the model has constraints that hold at times: a stability limit belongs to one "
    "set of equations, and these change during the run"
)
INSTEAD = "`lagsim bench` compares methods on such a model, for each step"


class MapOptions(NamedTuple):
    """Options of a map.

    Attributes
    ----------
    methods : tuple of str or None
        The methods; None for all that can handle the model.
    steps : tuple of float or None
        The smallest and the largest step; None for a range derived from the model.
    name : str or None
        The parameter that varies.
    between : tuple of float or None
        The smallest and the largest value of that parameter.
    strip : int
        The number of cells without a varied parameter.
    map : tuple of int
        The numbers of cells with a varied parameter: steps, and values of the
        parameter.
    """

    methods: tuple[str, ...] | None = None
    steps: tuple[float, float] | None = None
    name: str | None = None
    between: tuple[float, float] | None = None
    strip: int = STRIP
    map: tuple[int, int] = MAP


def csv_columns(name: str | None) -> list[str]:
    """Return the columns of stability.csv; `name` is the varied parameter or None."""
    varied = [] if name is None else [name]
    return ["method", "step", *varied, *MapCell._fields[:-1]]


def methods_for(
    case: Case, options: MapOptions
) -> tuple[list[str], list[str], list[dict[str, str]]]:
    """Return the methods of a map: with fixed steps, with step control, and refused.

    Refused methods are documents with method and reason.

    Raises
    ------
    InputError
        If a requested method cannot be examined, or the model has laws.
    """
    if case.equations.laws:
        raise unusable(NO_STABILITY, UNSTEADY, hint=INSTEAD)
    found: dict[bool, list[str]] = {False: [], True: []}
    refused = []
    problems = Problems()
    kind = structure(case.equations)
    for name in options.methods or names():
        adaptive = bool(method_named(name).ADAPTIVE)
        reason = method_refusal(name, case.equations, kind)
        if reason:
            text = f"`{name}` cannot handle this model: {reason}"
            problems.add(METHOD_REFUSED, text)
            refused.append({"method": name, "reason": reason})
        elif adaptive and options.name is None:
            text = (
                f"`{name}` chooses its steps: it has no stability limit on a given step"
            )
            hint = "use --vary to see how its work changes with a parameter"
            problems.add(ADAPTIVE_METHOD, text, hint=hint)
        else:
            found[adaptive].append(name)
    if options.methods is not None and problems:
        raise InputError(problems)
    return found[False], found[True], refused


def spaced(between: tuple[float, float], count: int) -> list[float]:
    """Return evenly spaced values between two ends; a geometric series if both are > 0.

    Examples
    --------
    >>> spaced((1.0, 100.0), 3), spaced((0.0, 1.0), 3)
    ([1.0, 10.0, 100.0], [0.0, 0.5, 1.0])
    """
    space = np.geomspace if min(between) > 0.0 else np.linspace
    return [float(f"{x:.6g}") for x in space(*between, count).tolist()]


def measure(
    case: Case,
    options: MapOptions,
    *,
    interrupt: Interrupt | None = None,
    progress: Progress = None,
) -> Document:
    """Run a model by each method over the range of steps, and locate the borders.

    Parameters
    ----------
    case : Case
        The case of the file; the model is bound to other values of the parameter.
    options : MapOptions
        Methods, and ranges of steps and of the parameter.

    Returns
    -------
    dict
        The content of stability.json. Later versions of lagsim add keys and remove
        none.

    Raises
    ------
    InputError
        If a method cannot be examined, or the model has laws.
    """
    interrupt = interrupt or Interrupt()
    with interrupt.raised():  # there is no result yet that could be lost
        made = _Map(case, options, interrupt, progress)
    complete = interrupt.cut(made.run)
    return made.document(complete=complete)


class _Map:
    """Runs of a map of stability.

    Parameters
    ----------
    case, options, interrupt, progress
        See `measure`.

    Attributes
    ----------
    fixed, adaptive : list of str
        Methods with fixed steps, and methods with step control.
    values : list of float or None
        Values of the parameter; [None] if none varies.
    lengths : dict
        For each method the least and the largest number of steps of a run.
    cells, borders : dict of list of dict
        For each method, the entries of stability.json.
    """

    def __init__(
        self, case: Case, options: MapOptions, interrupt: Interrupt, progress: Progress
    ) -> None:
        self.options, self.interrupt = options, interrupt
        self.progress = progress or (lambda _part: None)
        self.subject = Subject(case, interrupt)
        self.fixed, self.adaptive, self.refused = methods_for(case, options)
        self.values: list[float | None] = [None]
        if options.between is not None:
            self.values = [*spaced(options.between, options.map[1])]
        self.steps = self._steps()
        count = len(self.values) * len(self.fixed) * (len(self.steps) + SEARCH)
        self.lengths = {name: self._lengths(name, count) for name in self.fixed}
        # computed before an interrupt is handled
        self.rest = _equilibrium(self.subject)
        self.cells = {name: list[Any]() for name in (*self.fixed, *self.adaptive)}
        self.borders = {name: list[Any]() for name in self.fixed}

    def _steps(self) -> list[float]:
        """Return the step sizes of the cells, in the stated range or around borders."""
        subjects = [self.subject]
        for value in (self.values[0], self.values[-1]):
            if value is not None:
                with contextlib.suppress(LagsimError):
                    subjects.append(self._at(value))
        lows, highs = zip(*(_range(x, self.fixed) for x in subjects), strict=True)
        high = max(highs)
        between = self.options.steps or (max(min(lows), high / WIDEST), high)
        count = self.options.strip if self.options.name is None else self.options.map[0]
        return spaced(between, count) if self.fixed else []

    def _at(self, value: float) -> Subject:
        """Return the subject of the map at a value of the parameter.

        The functions compiled before serve the subject too.
        """
        case = self.subject.case.bind({str(self.options.name): value})
        return Subject(case, self.interrupt, self.subject.compiled)

    def _lengths(self, name: str, count: int) -> tuple[int, int]:
        """Return the least and the greatest number of steps of a run by a method.

        Both are limited such that `count` runs stay within the budget of operations.

        name : the method.
        """
        subject, steps = self.subject, self.steps
        trial = subject.run(name, steps[len(steps) // 2], PILOT)
        evaluations = (trial.evaluations or PILOT) / PILOT
        explicit = method_named(name).NEEDS in ((), ("power",))
        solving = 0 if explicit else (2 * len(subject.equations.q)) ** 3
        price = evaluations * subject.costs[name] + OVERHEAD + solving
        price += SWITCHING * subject.switches + ARC * subject.arcs * steps[-1]
        affordable = int(BUDGET / (count * price))
        least, most = min(STEPS, affordable), min(MOST_STEPS, affordable)
        return max(LEAST_STEPS, least), max(LEAST_STEPS, most)

    def length(self, name: str, step: float) -> int:
        """Return the number of steps of a run with a method and a step size."""
        least, most = self.lengths[name]
        return min(most, max(least, math.ceil(self.subject.span / step)))

    def run(self) -> None:
        """Run every method at every value of the parameter."""
        places = [(value, name) for value in self.values for name in self.cells]
        subject: Subject | str = self.subject
        for done, (value, name) in enumerate(places):
            varied = {} if value is None else {str(self.options.name): value}
            if value is not None and name == next(iter(self.cells)):
                try:
                    subject = self._at(value)
                except LagsimError as error:
                    subject = refused_trial(error).reason
            trial = partial(self._trial, subject, name)
            steps = self.steps if name in self.fixed else [None]
            strip = dict[Any, MapCell]()
            for part, h in enumerate(steps):
                self.progress((done + part / len(steps)) / len(places))
                strip[h] = trial(h)
            self.cells[name] += [
                {"method": name, "step": h, **varied, **found._asdict()}
                for h, found in strip.items()
            ]
            if name in self.fixed:
                border = self._border(subject, name, strip, trial)
                self.borders[name].append(varied | border)
        self.progress(1.0)

    def _trial(self, subject: Subject | str, name: str, step: float | None) -> MapCell:
        if isinstance(subject, str):
            return MapCell(FAILS, reason=subject)
        try:
            found = subject.run(
                name, step, 0 if step is None else self.length(name, step)
            )
        except InputError as error:
            found = MapCell(FAILS, reason=refused_trial(error).reason)
        with self.interrupt.raised():
            return found

    def _border(
        self,
        subject: Subject | str,
        name: str,
        strip: Mapping[float, MapCell],
        trial: Callable[[float], MapCell],
    ) -> Document:
        """Return the entry of the stability border of a method.

        The border is located by runs, and predicted by eigenvalues.

        Parameters
        ----------
        subject : Subject or str
            The model; a text if it cannot be run at a value of the parameter.
        name : str
            The method.
        strip : mapping
            Step -> verdict.
        trial : callable
            Maps a step to the verdict of a further run.
        """
        start = along = found = None
        if isinstance(subject, str):
            note = subject
        else:
            span = self.steps[-1] * self.length(name, self.steps[-1])
            amplification = method_named(name).amplification
            start = predicted(amplification, subject.at_start, span)
            along = predicted(amplification, subject.along, span)
            found, note = _found(strip, trial, (start, along))
        return {
            "found": None if found is None else float(f"{found:.4g}"),
            "predicted": min(
                (x for x in (start, along) if x is not None), default=None
            ),
            "predicted_at_start": start,
            "predicted_along": along,
            "note": note,
        }

    def document(self, *, complete: bool) -> Document:
        """Return the content of stability.json; `complete` is stored in it."""
        subject, name = self.subject, self.options.name
        model = subject.equations.model
        units = {p.name: p.unit for p in model.parameters}
        vary = name and {"name": name, "unit": units[name], "values": self.values}
        return {
            **head(model),
            "complete": complete,
            "vary": vary,
            "methods": {"fixed": self.fixed, "adaptive": self.adaptive},
            "steps": self.steps,
            "runs": {
                "steps": {
                    m: {"least": a, "most": b} for m, (a, b) in self.lengths.items()
                },
                "duration": subject.span,
                "perturbation": {
                    "energy": KICK,
                    "of": "the energy of the motion, put into the velocities so that "
                    "every mode takes part",
                    "seed": SEED,
                },
                "energy": subject.energy,
            },
            "borders": {m: x if name else x[0] for m, x in self.borders.items() if x},
            "eigenvalues": {
                "at_start": _pairs(subject.at_start),
                "along": _pairs(subject.along),
                "states": subject.states,
                "unknown": subject.unknown or None,
            },
            **self.rest,
            "refused": self.refused,
            "cells": [cell for own in self.cells.values() for cell in own],
        }


def _range(subject: Subject, methods: Sequence[str]) -> tuple[float, float]:
    """Return the least and the largest step of a map, around the predicted borders.

    Steps longer than the period of an event are all equal, since each ends at the
    event; such steps are left out.

    methods : the names of the methods.
    """
    borders = [
        predicted(method_named(name).amplification, eigenvalues, 10.0 * subject.span)
        for name in methods
        for eigenvalues in (subject.at_start, subject.along)
    ]
    if known := [border for border in borders if border]:
        high = ABOVE * max(known)
        low = max(BELOW * min(known), high / WIDEST)
    else:
        fastest = float(np.max(np.abs(subject.along), initial=0.0))
        unit, parts = subject.span, OF_RUN
        if fastest * subject.span > 1.0:
            unit, parts = 2.0 * math.pi / fastest, OF_PERIOD
        low, high = (part * unit for part in parts)
    if high > subject.period:
        return min(low, BELOW * subject.period), subject.period
    return low, high


def _found(
    strip: Mapping[float, MapCell],
    trial: Callable[[float], MapCell],
    expected: Sequence[float | None],
) -> tuple[float | None, str]:
    """Locate the stability border by bisection before the first unstable step.

    Steps around the expected borders are tried first, since an unstable range can be
    narrower than the cells of the map.

    Parameters
    ----------
    strip : mapping
        Step -> verdict.
    trial : callable
        Step -> verdict of a further run.
    expected : sequence
        Predicted borders; None where there is none.

    Returns
    -------
    tuple
        The border and "", or None and the reason.
    """
    first, last = min(strip), max(strip)
    if not strip[first].stable:
        return None, f"no step holds, down to {first:.3g} s"
    around = {part * step for step in expected if step for part in AROUND}
    known = {**strip, **{h: trial(h) for h in sorted(around) if first < h < last}}
    for before, after in pairwise(sorted(known)):
        if not known[after].stable:
            low, high = before, after
            while high / low > 1.0 + DIGITS:
                middle = math.sqrt(low * high)
                if trial(middle).stable:
                    low = middle
                else:
                    high = middle
            return high, ""
    return None, f"all steps hold, up to {last:.3g} s"


def _pairs(values: Any) -> list[list[float]]:
    return [[float(x.real), float(x.imag)] for x in values]


def _equilibrium(subject: Subject) -> Document:
    """Return the nearest rest and the modes about it, as entries of stability.json.

    If no rest is found, the entries have the reason; a linear model has modes even
    then.
    """
    kind, reason = structure(subject.equations), subject.unknown
    rest: Steady | None = None
    about: tuple[EigenMode, ...] = ()
    cautions = [(f"at the start, {c.text}", c) for c in subject.cautions]
    if not reason and not kind.autonomous:
        reason = "the equations depend on time"
    elif not reason:
        try:
            small = SmallMotions(subject.case.model)
            rest, about = small.steady, small.modes
            found = rest.cautions(small.setting)
            cautions += [(f"about the nearest rest, {c.text}", c) for c in found]
        except NoRestError as error:
            reason = str(error)
    if rest is None and subject.linearisation is not None and kind.linear:
        at = subject.endless.start
        linear = subject.linearisation.at(at.t, at.q, at.v, at.s)
        about = modes(linear, eigenvalues_of(linear.R))
    warnings = [c._replace(text=text).record for text, c in cautions]
    return {
        **({"warnings": warnings} if warnings else {}),
        "equilibrium": None if rest is None else _positions(rest),
        "equilibrium_is_start": rest is not None and _is_start(rest, subject),
        "equilibrium_reason": reason or None,
        "modes": [_mode(mode, subject.equations.q) for mode in about],
    }


def _positions(rest: Steady) -> dict[str, float]:
    """Return positions and first-order states of a rest by name; 0 within rounding."""
    names = [*rest.equations.q, *(x.name for x in rest.equations.states)]
    values = np.concatenate([rest.state.q, rest.state.s])
    size = np.max(np.abs(rest.state.q), initial=0.0)
    kept = np.abs(values) > COMPUTED_ZERO * size
    return dict(zip(names, np.where(kept, values, 0.0).tolist(), strict=True))


def _is_start(rest: Steady, subject: Subject) -> bool:
    """Whether a rest is the start of the subject's model."""
    start, at = subject.case.start, rest.state
    far = np.abs(np.concatenate([at.q - start.q, at.s - start.s]))
    size = np.max(np.abs(np.concatenate([at.q, at.s])), initial=0.0)
    return bool(np.all(far <= COMPUTED_ZERO * size) and not np.any(start.v))


def _mode(mode: EigenMode, names: Sequence[str]) -> Document:
    real, imaginary = (
        dict(zip(names, (part + 0.0).tolist(), strict=True))  # no -0
        for part in (mode.shape.real, mode.shape.imag)
    )
    return {
        "frequency": mode.frequency,
        "angular_frequency": mode.eigenvalue.imag,
        "period": mode.period,
        "damping_ratio": mode.damping_ratio + 0.0,
        "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
        "shape": real,
        "shape_imaginary": imaginary,
    }
