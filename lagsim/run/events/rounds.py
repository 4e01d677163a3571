"""Rounds in which events of the file act at one instant, in a run and before it.

Events that are due together act in the order of the file, each with the modes that the
events before it have set. Events whose conditions become true by these acts are the
next round, until no further condition becomes true. The sum of the impulses is applied
after the last round (`impulses`).

At the start of a run the events act before the start is examined, since the admissible
start depends on the modes that they set (`StartModes`). At any later instant they act
on the modes in the memory of the arc (`transitions.ArcActs`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import Acted, Equations, Instant
from lagsim.mechanics.forces import generalized_impulses
from lagsim.run.events.records import NO_ACTS, NOTHING, ActsAt, Due

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Transition
    from lagsim.run.events.records import Round, Visit
    from lagsim.run.trajectory import Ending

# Largest number of acts of one event at one instant, each with other modes.
MOST_ACTS = 1000
# A condition that is false by less than this part of its change by an act counts as
# true: the difference is rounding.
FALSE = 1e-9


class ActsTarget(Protocol):
    """The modes of the file and the conditions at an instant, on which events act."""

    @property
    def modes(self) -> dict[str, float]:
        """The modes of the file, by name."""

    def begin_round(self, due: Collection[int], once: Collection[int]) -> None:
        """Mark the conditions `due` as true, and `once` for the rest of the run."""

    def impulse(self, k: int) -> tuple[Floats, Ending | None]:
        """Return the generalized impulse (n,) of event k, and an ending or None."""

    def set_modes(self, k: int) -> Ending | None:
        """Set the modes that event k assigns; return an ending or None."""

    def changed(self) -> Collection[int]:
        """Return the conditions that have become true by the acts of the round."""


def act_in_rounds(
    on: ActsTarget, events: Sequence[Transition], due: Due, acts: ActsAt
) -> tuple[Acted, ActsAt, Ending | None]:
    """Execute the events that are due, and the events that become due by their acts.

    Return the acts, the record of all acts of the instant, and the ending of the run
    where a number is not finite.

    Parameters
    ----------
    on : ActsTarget
        The modes and the conditions.
    events : sequence of Transition
        The events of the file.
    due : Due
        The events of the first round.
    acts : ActsAt
        The events that have acted at this instant.
    """
    event_of = [k for k, x in enumerate(events) if x.at is not None]
    counts, rounds = list(acts.counts or (0,) * len(events)), list(acts.rounds)
    names: list[str] = []
    impulses: list[Floats] = []
    chatter: tuple[str, ...] = ()
    is_over, ending = False, None
    while due != NOTHING and not chatter and ending is None:
        is_over |= len(event_of) in due.conditions
        own = {event_of[c]: c for c in due.conditions if c < len(event_of)}
        on.begin_round(due.conditions, [c for k, c in own.items() if events[k].once])
        if due.periodic or any(events[k].once for k in own):
            # These events act once at an instant, so no cycle contains this round.
            rounds.clear()
        else:
            visit = tuple(events[k].name for k in sorted(own)), on.modes
            if visit in rounds:
                chatter = names_of(rounds[rounds.index(visit) :])
                break
            rounds.append(visit)
        for k in sorted(due.periodic.union(own)):
            names.append(events[k].name)
            if events[k].impulses:
                one, failed = on.impulse(k)
                impulses.append(one)
                ending = ending or failed
            ending = ending or on.set_modes(k)
            counts[k] += 1
            if events[k].at is not None and counts[k] > MOST_ACTS:
                chatter = chatter or names_of(acts.visits or rounds)
        due = Due(conditions=frozenset(on.changed())) if names else NOTHING
    total = np.sum(impulses, axis=0) if impulses else None
    given = tuple(total.tolist()) if total is not None and total.any() else ()
    # Faster than `_replace`.
    after = ActsAt(tuple(counts), tuple(rounds), acts.visits, acts.is_over, acts.waited)
    return Acted(tuple(names), chatter, is_over, given), after, ending


def names_of(rounds: Sequence[Round | Visit]) -> tuple[str, ...]:
    """Return the names of the events of rounds, see `records.ActsAt`, in order."""
    return tuple(name for names, *_ in rounds for name in names)


# --- The start of a run


class StartModes:
    """The modes and the conditions at the start, before equations are compiled.

    Attributes
    ----------
    values : dict
        The numbers by name: t, parameters, modes, and the state at the start.
    """

    def __init__(self, e: Equations, state: Instant) -> None:
        self.e, model = e, e.model
        numbers = [state.t, *state.q, *state.v, *state.s]
        self.values = {p.name: p.value for p in model.parameters}
        self.values |= zip(("t", *e.state), map(float, numbers), strict=True)
        self._set = {mode for x in model.events for mode, _ in x.sets}
        self._impulses = generalized_impulses(e) if model.kicks else []
        self._spent, self._spared = set[int](), set[int]()
        self._before: list[float] = []

    @property
    def modes(self) -> dict[str, float]:
        """The modes that events set, by name."""
        return {mode: self.values[mode] for mode in self._set}

    def _evaluate(self) -> list[float]:
        """Return the values of all conditions."""
        return self._numbers([x.node for x in self.e.model.located])

    def _numbers(self, nodes: Sequence[int]) -> list[float]:
        return [float(x) for x in evaluate(self.e.graph, nodes, self.values)]

    def begin_round(self, due: Collection[int], once: Collection[int]) -> None:
        """Store the values of the conditions before the acts of a round.

        Conditions in `due` in this round, and those in `once` in all later rounds, too,
        do not count as changed by the acts.
        """
        self._spent.update(once)
        self._spared = self._spent.union(due)
        self._before = self._evaluate()

    def impulse(self, k: int) -> tuple[Floats, None]:
        """Return the generalized impulse (n,) of event k."""
        return np.array(self._numbers(self._impulses[k])), None

    def set_modes(self, k: int) -> None:
        """Set the modes that event k assigns; `examine` refuses infinite values."""
        sets = self.e.model.events[k].sets
        found = self._numbers([node for _, node in sets])
        self.values |= zip((mode for mode, _ in sets), found, strict=True)

    def changed(self) -> list[int]:
        """Return the conditions that have become true since the round began."""
        rows = zip(self.e.model.located, self._before, self._evaluate(), strict=True)
        true = [c for c, (x, a, b) in enumerate(rows) if _comes(x.equality, a, b)]
        return [c for c in true if c not in self._spared]


def after_acts_at_start(e: Equations, state: Instant) -> Equations:
    """Return the equations after the events that act at the start `state`.

    Events without a located condition (periodic ones) act first, then the events
    whose conditions become true by their assignments.
    """
    model, on = e.model, StartModes(e, state)
    due = Due(frozenset(k for k, x in enumerate(model.events) if x.at is None))
    begun, _, _ = act_in_rounds(on, model.events, due, NO_ACTS)
    if not begun.names:
        return e
    new = tuple(x._replace(value=on.values[x.name]) for x in model.parameters)
    return e.of(replace(model, parameters=new), begun_by=begun)


def _comes(equality: bool, before: float, after: float) -> bool:
    """Whether a condition changed from false to true between two values.

    equality : whether the condition is an equation, which is true where its value
        crosses 0.
    before, after : the values, not negative where an inequality is true.
    """
    least = FALSE * abs(after - before)
    if equality and before > 0.0:
        before, after = -before, -after
    return before < -least and after >= -least
