"""Energy balances of decoupled groups of coordinates: none hides another's.

Where the energy is a sum over groups, each has a balance: its energy less the work that
is done on it, see `mechanics.equations`. Values come from the rows that the monitor has
kept.

A jump of a potential makes no impulse: that the energy is then another is no error. But
most energies that are written with a switch are continuous there (a spring that acts on
one side), and what these lose is lost. So both sides of each switch that the rows pass
are looked at, down to neighbouring doubles. What is left of energy - work without the
jumps is held against the same bounds as ever.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.evaluate import evaluate, evaluate_rows, evaluate_with_error
from lagsim.language.functions import STEPS
from lagsim.mechanics.equations import groups, shared
from lagsim.tolerances import ENERGY_ROUNDOFF, FLAT_RANGE, SAME_ENERGY, SAME_JUMP

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.plan.plan import Plan
    from lagsim.run.observers.monitors import EnergyMonitor, ResidualMonitor

# Rows that are looked at, and operations for them, at most.
MOST_ROWS = 512
MOST_OPERATIONS = 2e5
# Rows that show a speed to this part of it show the motion.
SHOWN = 0.5


class Balance(NamedTuple):
    """The energy balance, energy - work, of all coordinates, or of a decoupled group.

    Attributes
    ----------
    coordinates : sequence of int
    names : tuple of str
        Of the coordinates of a group; none of the whole.
    energy : int
        The node of its energy.
    in_play : float
        Its largest kinetic energy, between rows too, or range of what else it has, or
        of the work.
    work_range : float
        Of the work that is done on it.
    drift : float
        The largest size of energy - work less its first value.
    farthest : float
        The same with its sign.
    worst_row : ndarray or None
        The row of that: time, coordinates and velocities first.
    kept, rows : ndarray, shapes (k,) and (k, 1 + 2 n)
        Energy - work in some rows, and their time, coordinates and velocities.
    since : callable
        Gives the first time at which the drift is more than a bound, or None.
    """

    coordinates: Sequence[int]
    names: tuple[str, ...]
    energy: int
    in_play: float
    work_range: float
    drift: float
    farthest: float
    worst_row: Floats | None
    kept: Floats
    rows: Floats
    since: Callable[[float], float | None]

    @property
    def label(self) -> str:
        """Its name in messages."""
        of = f" of {', '.join(self.names)}" if self.names else ""
        return f"energy - work{of}"

    @property
    def part(self) -> float:
        """The drift, as a part of the energy in play."""
        return self.drift / (self.in_play or 1.0)


def balances(
    equations: Equations, plan: Plan, residuals: ResidualMonitor, monitor: EnergyMonitor
) -> list[Balance]:
    """Return the balance of each group, then of the whole.

    A tolerance that a person gave in absolute numbers is no measure of small groups.
    """
    whole = Balance(
        range(len(equations.q)), (), equations.energy, monitor.energy_in_play,
        monitor.work_range, residuals.energy_drift, residuals.energy_gained,
        residuals.worst_row, monitor.balance, monitor.passed, residuals.drift_since,
    )  # fmt: skip
    return [*(group_balances(equations, monitor) if plan.atol is None else ()), whole]


def group_balances(equations: Equations, monitor: EnergyMonitor) -> list[Balance]:
    """Return the balance of each group; none where the energy is no sum over some."""
    e, g, n = equations, equations.graph, len(equations.q)
    if n < 2 or len(monitor.passed) < 2:
        return []
    found = groups(e)
    if len(found) < 2 or (len(e.works) == 1 and e.works[0].energy == e.energy):
        return []
    energies, forms = (shared(e, found, x)[0] for x in (e.energy, e.kinetic_form))
    nodes = [*energies, *forms]
    for group, *own in zip(found, energies, forms, strict=True):
        within = {x[j] for x in (e.q, e.velocities) for j in group}
        if g.depends(own) & {*e.q, *e.velocities} - within:
            return []
    most = min(MOST_ROWS, int(MOST_OPERATIONS / len(g.cone(nodes))))
    stride = -(-len(monitor.passed) // max(most, 2))
    rows, worked = monitor.passed[::stride], monitor.worked[::stride]
    moving = dict(zip(("t", *e.q, *e.velocities), rows.T, strict=True))
    fixed = {p.name: p.value for p in e.model.parameters}
    values = evaluate_rows(g, nodes, fixed | moving, len(rows))
    each, kinetic = values[: len(found)], values[len(found) :]
    fastest = np.max(np.abs(kinetic), axis=1)
    for speeds in _between(e.velocities, moving, monitor.extents):
        more = evaluate_rows(g, forms, fixed | moving | speeds, len(rows))
        fastest = np.fmax(fastest, np.max(more, axis=1))
    rest = np.sum(each, axis=0) - np.sum(worked, axis=1) - monitor.balance[::stride]
    # What stands in no group depends on time alone, and is in `work` as it is.
    timed = [k for k, work in enumerate(e.works) if not work.coordinates]
    rest += np.sum(worked[:, timed], axis=1)
    if not np.ptp(rest) <= SAME_ENERGY * np.max(np.abs(each)):
        return []
    made = []
    for i, group in enumerate(found):
        names = tuple(e.q[j] for j in group)
        own = [k for k, x in enumerate(e.works) if names[0] in x.coordinates]
        done = np.sum(worked[:, own], axis=1)
        in_play = max(fastest[i], np.ptp(each[i] - kinetic[i]), np.ptp(done))
        drifts = each[i] - done - (each[i, 0] - done[0])
        k = int(np.argmax(np.abs(drifts)))
        made.append(
            Balance(
                group, names, energies[i], float(in_play), float(np.ptp(done)),
                float(abs(drifts[k])), float(drifts[k]), rows[k], drifts, rows,
                partial(_since, rows[:, 0], np.abs(drifts)),
            )
        )  # fmt: skip
    return made


def _since(times: Floats, sizes: Floats, bound: float) -> float | None:
    """Return the first of the times at which a size exceeds a bound."""
    off = np.flatnonzero(sizes > bound)
    return float(times[off[0]]) if len(off) else None


def _between(
    velocities: Sequence[str],
    rows: Mapping[str, Floats],
    extents: Mapping[str, tuple[float, float]],
) -> list[dict[str, float]]:
    """Return velocities between rows: all least ones, and all greatest ones."""
    missed = {
        v: extents[v]
        for v in velocities
        if v in extents
        and np.max(np.abs(rows[v])) < SHOWN * np.max(np.abs(extents[v])) < np.inf
    }
    return [{v: x[k] for v, x in missed.items()} for k in (0, 1)] if missed else []


def energy_error(equations: Equations, node: int, row: Floats, errors: Floats) -> float:
    """Return the error of an energy by errors (2 n,) of the state at a row."""
    values = {p.name: (p.value, 0.0) for p in equations.model.parameters}
    names = (*equations.q, *equations.velocities)
    state = zip(row[1 : 1 + len(names)].tolist(), errors.tolist(), strict=True)
    values |= {"t": (float(row[0]), 0.0)} | dict(zip(names, state, strict=True))
    ((_, error),) = evaluate_with_error(equations.graph, [node], values)
    return float(error)


# Functions that step where an argument changes its sign: an angle at its cut, quotients
# and powers at a pole.
CUT = {"atan2": 0, "div": 1, "pow": 0}
# And those that take one value or another, and nothing in between.
SWITCHES = STEPS | {"if", *CUT}
# Switches that are looked at on the way from one row to the next.
MOST_ON_A_WAY = 8


def jumps(equations: Equations, balance: Balance) -> Floats:
    """Return by how much the energy jumps between rows (k,).

    From the worst row to the first, then from row to row: a jump that is still there at
    the worst row lies on any way to it.
    """
    energy, rows = Energy(equations, balance.energy), balance.rows
    if not energy.switches:
        return np.zeros(len(rows))
    worst = rows[0] if balance.worst_row is None else balance.worst_row
    ways = pairwise([worst[: rows.shape[1]], *rows])
    least = FLAT_RANGE * balance.in_play
    return np.array([energy.jump(a, b, least) for a, b in ways])


def without_jumps(equations: Equations, balance: Balance) -> Floats | None:
    """Return energy - work (k,) of the rows, without the jumps of its expression.

    None where there are none.
    """
    jumped, kept = jumps(equations, balance)[1:], balance.kept
    sizes = np.abs(jumped[jumped != 0.0])
    if not len(sizes):
        return None
    changes = np.diff(kept) - jumped
    size = float(np.max(sizes))
    if np.ptp(sizes) <= SAME_JUMP * size < np.inf:
        changes -= size * np.round(changes / size)
    rest = np.concatenate([[0.0], np.cumsum(changes)]) + kept[0]
    return np.asarray(rest)


class Energy:
    """An energy as a function of the state, and the switches in it."""

    def __init__(self, equations: Equations, energy: int) -> None:
        g = equations.graph
        self.graph, self.energy = g, energy
        self.names = ("t", *equations.q, *equations.velocities)
        self.parameters = {p.name: p.value for p in equations.model.parameters}
        found = sorted(
            n for n in g.dependent([energy], self.names) if g.ops[n] in SWITCHES
        )
        # Of a choice the condition, of an angle or a quotient what changes its sign, of
        # the others the value.
        inner = {**CUT, "if": 0}
        self.switches = [
            g.args[n][inner[g.ops[n]]] if g.ops[n] in inner else n for n in found
        ]
        self.cut = {k for k, n in enumerate(found) if g.ops[n] in CUT}

    def sides(self, state: Floats) -> list[float]:
        """Tell on which side of each switch a state is."""
        values = self._values(self.switches, state)
        return [
            math.copysign(1.0, x) if k in self.cut else float(x)
            for k, x in enumerate(values)
        ]

    def jump(self, a: Floats, b: Floats, least: float) -> float:
        """Give by how much the energy jumps between two states, on the straight way.

        What is no more than `least`, or rounding, does not count.
        """
        x = found = 0.0
        at_b = self.sides(b)
        for _switch in range(MOST_ON_A_WAY):
            at_x = self.sides(a + x * (b - a))
            if at_x == at_b:
                break
            low, high = x, 1.0
            while low < (middle := 0.5 * (low + high)) < high:
                if self.sides(a + middle * (b - a)) == at_x:
                    low = middle
                else:
                    high = middle
            before, after = (self._of(a + y * (b - a)) for y in (low, high))
            size = max(abs(before), abs(after))
            if not abs(after - before) <= max(least, ENERGY_ROUNDOFF * size):
                found += after - before
            x = high
        return found

    def _of(self, state: Floats) -> float:
        return float(self._values([self.energy], state)[0])

    def _values(self, nodes: list[int], state: Floats) -> list[float]:
        values = dict(zip(self.names, state.tolist(), strict=True))
        return evaluate(self.graph, nodes, self.parameters | values)
