"""Events of the file that act at the start of a run."""

from __future__ import annotations

from dataclasses import replace

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import Begun, Equations, Instant
from lagsim.mechanics.forces import generalized_impulses

# A condition that is false by less than this part of its change by an act counts as
# true: the difference is rounding.
FALSE = 1e-9


# Greatest number of acts of events at a start.
MOST_ACTS = 1000


def after_initial_events(e: Equations, state: Instant) -> Equations:
    """Return the equations after the events that act at the start `state`.

    Events without a located condition (periodic ones) act first, then the events
    whose conditions become true by their assignments.
    """
    model, numbers = e.model, [state.t, *state.q, *state.v, *state.s]
    values = {p.name: p.value for p in model.parameters}
    values |= zip(("t", *e.state), map(float, numbers), strict=True)
    initial = _begin(e, values)
    new = tuple(x._replace(value=values[x.name]) for x in model.parameters)
    if not initial.acts:
        return e
    return e.of(replace(model, parameters=new), begun_by=initial)


def _begin(e: Equations, values: dict[str, float]) -> Begun:
    """Execute the events that act at the start, and return a record of the acts.

    Events act in rounds: each round holds the events whose conditions became true in
    the round before. If events undo each other without end, only these are recorded, as
    `chatter`, with the names of all acts.

    The assignments of the events change the entries in place.

    values : numbers by name (t, parameters, modes, state) at the start.
    """
    g, model = e.graph, e.model
    impulses = generalized_impulses(e) if model.kicks else []
    given = [0.0] * len(e.q)
    located = [k for k, x in enumerate(model.events) if x.at is not None]
    due = [k for k, x in enumerate(model.events) if x.at is None]
    modes = {mode for x in model.events for mode, _ in x.sets}
    acts: list[str] = []
    rounds: list[tuple[list[str], dict[str, float]]] = []
    spent: set[int] = set()
    is_over = False
    while due:
        before = evaluate(g, [x.node for x in model.located], values)
        events = [model.events[k] for k in due]
        former = {mode: values[mode] for mode in modes}
        for k, event in zip(due, events, strict=True):
            if event.impulses:
                one = evaluate(g, impulses[k], values)
                given = [a + float(b) for a, b in zip(given, one, strict=True)]
            found = evaluate(g, [node for _, node in event.sets], values)
            values |= zip((mode for mode, _ in event.sets), found, strict=True)
        acts += [event.name for event in events]
        spent.update(k for k in due if model.events[k].once)
        now, seen = {mode: values[mode] for mode in modes}, [x for _, x in rounds]
        rounds.append(([event.name for event in events], former))
        if any(event.at is None or event.once for event in events):
            rounds.clear()  # events act once, so no cycle contains this round
        elif (now != former and now in seen) or len(acts) > MOST_ACTS:
            cycle = rounds[seen.index(now) if now in seen else 0 :]
            return Begun(tuple(acts), tuple(x for names, _ in cycle for x in names))
        after = evaluate(g, [x.node for x in model.located], values)
        rows = zip(model.located, before, after, strict=True)
        true = [k for k, (x, a, b) in enumerate(rows) if _comes(x.equality, a, b)]
        is_over |= len(located) in true
        # An event's own act does not make its condition true.
        spared = spent.union(due)
        due = [located[k] for k in true if k < len(located)]
        due = [k for k in due if k not in spared]
    kicked = tuple(given) if any(given) else ()
    return Begun(tuple(acts), is_over=is_over, impulses=kicked)


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
