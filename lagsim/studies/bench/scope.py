"""What `lagsim stability` looks at: methods, steps, values, how long runs are."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.errors import InputError, LagsimError, Problem
from lagsim.mechanics.structure import structure
from lagsim.methods import method as method_named
from lagsim.methods import names
from lagsim.plan.integration import refusal
from lagsim.studies.bench.borders import predicted
from lagsim.studies.bench.trial import Subject

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Case

    CaseAt = Callable[[float | None], Case]

# Cells of a strip, and of a map: steps, values of the parameter.
STRIP = 48
MAP = (24, 16)
# Runs that find a border, besides.
SEARCH = 14
# The range of steps: from this part of the smallest border predicted to so many times
# the largest, but not wider than the third.
BELOW, ABOVE, WIDEST = 0.1, 1.6, 1e3
# Without a border, in parts of the fastest period, or of the run.
OF_PERIOD = (0.02, 1.0)
OF_RUN = (1e-4, 0.1)

# Steps of a run: so many, or what the model lasts, within what all of it may cost.
STEPS, MOST_STEPS, LEAST_STEPS = 10_000, 40_000, 400
# Operations, worth about 10 s; a step and its row cost so many besides those of its
# evaluations, which a few steps tell.
BUDGET = 1e10
OVERHEAD = 1000
PILOT = 20
# A switch costs about a million, and there may be one in every ten steps.
SWITCHING = 100_000
# The same of one in time, and those are counted: a long step takes in many of them.
ARC = 1_000_000

# Why there is no map of a scene with laws.
UNSTEADY = (
    "the model has constraints that come and go: a stability limit belongs to one "
    "set of equations, and these change during the run"
)
INSTEAD = "`lagsim bench` compares methods on such a model, for each step"


@dataclass(frozen=True)
class Wish:
    """What is asked for.

    Attributes
    ----------
    methods
        Only these; None for all that apply.
    steps
        Smallest and largest; None for a choice from the scene.
    name, values
        Of the parameter that varies.
    strip, map
        How many cells.
    """

    methods: tuple[str, ...] | None = None
    steps: tuple[float, float] | None = None
    name: str | None = None
    between: tuple[float, float] | None = None
    strip: int = STRIP
    map: tuple[int, int] = MAP


class Refused(NamedTuple):
    """A method that does not apply."""

    method: str
    reason: str


def methods_for(
    case: Case, wish: Wish
) -> tuple[tuple[str, ...], tuple[str, ...], list[Refused]]:
    """Give those of fixed steps, those of chosen steps, and those that refuse.

    Raises
    ------
    InputError
        Where one that was asked for cannot be looked at, or the scene has laws.
    """
    if case.equations.laws:
        raise InputError([Problem("no-stability", UNSTEADY, hint=INSTEAD)])
    found: dict[bool, list[str]] = {False: [], True: []}
    refused = []
    problems = []
    kind = structure(case.equations)
    for name in wish.methods or names():
        module = method_named(name)
        reason = refusal(name, case.equations, kind)
        if reason:
            text = f"`{name}` cannot handle this model: {reason}"
            problems.append(Problem("method-refused", text))
            refused.append(Refused(name, reason))
        elif module.ADAPTIVE and wish.name is None:
            text = (
                f"`{name}` chooses its steps: it has no stability limit on a given step"
            )
            hint = "use --vary to see how its work changes with a parameter"
            problems.append(Problem("adaptive-method", text, hint=hint))
        else:
            found[bool(module.ADAPTIVE)].append(name)
    if wish.methods is not None and problems:
        raise InputError(problems)
    return tuple(found[False]), tuple(found[True]), refused


def runs_for(
    subject: Subject, name: str, steps: list[float], count: int
) -> tuple[int, int]:
    """Give the least and the largest number of steps that each of `count` runs has."""
    pilot = subject.run(name, steps[len(steps) // 2], PILOT, None)
    evaluations = (pilot.evaluations or PILOT) / PILOT
    n = len(subject.equations.q)
    solving = (2 * n) ** 3 if method_named(name).NEEDS not in ((), ("power",)) else 0
    cost = evaluations * (subject.evaluation() + 50) + OVERHEAD + solving
    cost += SWITCHING if subject.switches else 0
    cost += ARC * subject.arcs * steps[-1]
    affordable = int(BUDGET / (count * cost))
    return (
        max(LEAST_STEPS, min(STEPS, affordable)),
        max(LEAST_STEPS, min(MOST_STEPS, affordable)),
    )


def spaced(between: tuple[float, float], count: int) -> Iterator[float]:
    """Give values from the first to the second: by a factor where both are above 0."""
    first, last = between
    if first > 0.0 and last > 0.0:
        for k in np.linspace(math.log10(first), math.log10(last), count):
            yield float(f"{10.0**k:.6g}")
    else:
        yield from (float(f"{x:.6g}") for x in np.linspace(first, last, count))


def usual_value(case: Case, name: str | None) -> float | None:
    """Give the value that the file gives a parameter."""
    known = {p.name: p.value for p in case.equations.model.parameters}
    return None if name is None else known[name]


def subjects_at_ends(
    case_at: CaseAt, values: list[float | None], interrupt: Interrupt | None
) -> Iterator[Subject]:
    """Give the scene at both ends of the parameter's range, where it can be had."""
    for value in (values[0], values[-1]):
        if value is not None:
            with contextlib.suppress(LagsimError):
                yield Subject(case_at(value), interrupt)


def steps_for(
    subjects: list[Subject], methods: tuple[str, ...], wish: Wish
) -> list[float]:
    """Give the steps of the cells: those asked for, or around the borders predicted."""
    ranges = [_range(subject, methods) for subject in subjects]
    low, high = min(a for a, _ in ranges), max(b for _, b in ranges)
    between = wish.steps or (max(low, high / WIDEST), high)
    count = wish.strip if wish.name is None else wish.map[0]
    return list(spaced(between, count)) if methods else []


def _range(subject: Subject, methods: tuple[str, ...]) -> tuple[float, float]:
    """Give the range of steps around the borders predicted."""
    span = 10.0 * subject.span
    borders = [
        border
        for name in methods
        for eigenvalues in (subject.at_start, subject.along)
        if (border := predicted(method_named(name).amplification, eigenvalues, span))
    ]
    if borders:
        high = ABOVE * max(borders)
        return max(BELOW * min(borders), high / WIDEST), high
    fastest = float(np.max(np.abs(subject.along), initial=0.0))
    if fastest * subject.span > 1.0:
        low, high = (part * 2.0 * math.pi / fastest for part in OF_PERIOD)
        return low, high
    return OF_RUN[0] * subject.span, OF_RUN[1] * subject.span
