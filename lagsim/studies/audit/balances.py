"""Energy balances of a run, of all coordinates and of decoupled groups.

Where the energy is a sum over decoupled groups of coordinates, each group has a balance
of its own, the energy of the group less the work done on it (see
`mechanics.equations`), so that a large group does not hide the drift of a small one.
Values come from the rows that the monitor has stored.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.language.evaluate import evaluate, evaluate_rows, evaluate_with_error
from lagsim.language.functions import STEPS
from lagsim.mechanics.groups import NOBODY, groups, owners_of, shared
from lagsim.tolerances import (
    COMPUTED_ZERO,
    ENERGY_ROUNDOFF,
    HALF_OF_DIGITS,
    SAME_ENERGY,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.run.observers.monitors import EnergyMonitor

# The largest number of rows that are evaluated, and of operations for all rows.
MOST_ROWS = 512
MOST_OPERATIONS = 2e5
# The rows represent a velocity if they contain this part of its largest value.
SHOWN = 0.5


class Balance(NamedTuple):
    """Energy balance, energy - work, of all coordinates or of a decoupled group.

    Attributes
    ----------
    coordinates : sequence of int
        Indices of the coordinates of the group.
    names : tuple of str
        Names of the coordinates of a group; empty for the whole system.
    energy : int
        The node of the energy.
    in_play : float
        The energy in play: the largest of the kinetic energy (rows and steps), of the
        range of the remaining energy, and of `work_range`.
    work_range : float
        The range of the work done on the group.
    drift : float
        The largest absolute deviation of energy - work from its first value.
    farthest : float
        The deviation of size `drift`, with its sign.
    worst_row : ndarray or None
        The row with the largest deviation: time, coordinates, velocities and more.
    conserved : ndarray, shape (k,)
        Energy - work at `rows`.
    rows : ndarray, shape (k, 1 + 2 n)
        Times, coordinates and velocities of some rows.
    since : callable
        Returns, for a bound, the first time at which the drift exceeds it, or None.
    """

    coordinates: Sequence[int]
    names: tuple[str, ...]
    energy: int
    in_play: float
    work_range: float
    drift: float
    farthest: float
    worst_row: Floats | None
    conserved: Floats
    rows: Floats
    since: Callable[[float], float | None]

    @property
    def label(self) -> str:
        """Name of the balance in messages."""
        return f"energy - work{self.of}"

    @property
    def of(self) -> str:
        """The names of the group in messages, as in " of x, y".

        "" for the whole system.
        """
        return f" of {', '.join(self.names)}" if self.names else ""

    @property
    def part(self) -> float:
        """The drift relative to the energy in play."""
        return self.drift / (self.in_play or 1.0)


def group_balances(equations: Equations, monitor: EnergyMonitor) -> list[Balance]:
    """Return the balance of each decoupled group; [] if there are no groups.

    monitor : the energies and states of the rows.
    """
    e, g = equations, equations.graph
    found = groups(e) if len(e.q) > 1 and len(monitor.passed) > 1 else []
    if len(found) < 2 or (len(e.works) == 1 and e.works[0].energy == e.energy):
        return []
    energies, forms = (shared(e, found, x)[0] for x in (e.energy, e.kinetic_form))
    nodes = [*energies, *forms]
    group_of = {x[j]: k for k, many in enumerate(found)
                for x in (e.q, e.velocities) for j in many}  # fmt: skip
    cone = g.cone(nodes)
    owners, own = owners_of(g, cone, group_of), 2 * [*range(len(found))]
    if any(owners[x] not in (k, NOBODY) for k, x in zip(own, nodes, strict=True)):
        return []
    most = min(MOST_ROWS, int(MOST_OPERATIONS / len(cone)))
    stride = -(-len(monitor.passed) // max(most, 2))
    rows, worked = monitor.passed[::stride], monitor.worked[::stride]
    known: dict[str, Any] = e.model.parameter_values
    known |= dict(zip(("t", *e.state), rows.T, strict=True))
    each, kinetic = np.split(evaluate_rows(g, nodes, known, len(rows)), 2)
    fastest = np.max(np.abs(kinetic), axis=1)
    for speeds in _between(e.velocities, known, monitor.extents):
        more = evaluate_rows(g, forms, known | speeds, len(rows))
        fastest = np.fmax(fastest, np.max(more, axis=1))
    rest = np.sum(each, axis=0) - np.sum(worked, axis=1) - monitor.balance[::stride]
    # Terms without a coordinate depend on time alone; `work` contains them unchanged.
    timed = [k for k, work in enumerate(e.works) if not work.coordinates]
    rest += np.sum(worked[:, timed], axis=1)
    if not np.ptp(rest) <= SAME_ENERGY * np.max(np.abs(each)):
        return []
    done = np.zeros_like(each)
    of_first = {e.q[group[0]]: i for i, group in enumerate(found)}
    for work, its in zip(e.works, worked.T, strict=True):
        for i in {of_first[name] for name in work.coordinates if name in of_first}:
            done[i] += its
    ranges, work_ranges = np.ptp(each - kinetic, axis=1), np.ptp(done, axis=1)
    drifts = each - done - (each[:, :1] - done[:, :1])
    sizes = np.abs(drifts)
    made = []
    for i, (group, k) in enumerate(zip(found, np.argmax(sizes, axis=1), strict=True)):
        in_play = max(fastest[i], ranges[i], work_ranges[i])
        made.append(
            Balance(
                group, tuple(e.q[j] for j in group), energies[i], float(in_play),
                float(work_ranges[i]), float(sizes[i, k]), float(drifts[i, k]),
                rows[k], drifts[i], rows, partial(_since, rows[:, 0], sizes[i]),
            )
        )  # fmt: skip
    return made


def _since(times: Floats, sizes: Floats, bound: float) -> float | None:
    """Return the first time at which a size exceeds a bound; None if there is none.

    times, sizes : (k,).
    """
    off = np.flatnonzero(sizes > bound)
    return float(times[off[0]]) if len(off) else None


def _between(
    velocities: Sequence[str],
    rows: Mapping[str, Floats],
    extents: Mapping[str, tuple[float, float]],
) -> list[dict[str, float]]:
    """Return the extremes of velocities that exceed all values in rows.

    The result has two entries, the least and the greatest values by name; [] if rows
    show the extremes of all velocities.

    velocities : names.
    rows : columns of the table by name.
    extents : least and greatest value by name, at the ends of steps.
    """
    missed = {
        v: extents[v]
        for v in velocities
        if v in extents
        and np.max(np.abs(rows[v])) < SHOWN * np.max(np.abs(extents[v])) < np.inf
    }
    return [{v: x[k] for v, x in missed.items()} for k in (0, 1)] if missed else []


def energy_error(equations: Equations, node: int, row: Floats, errors: Floats) -> float:
    """Return the error of an energy for given errors of the state.

    Parameters
    ----------
    node : int
        The node of the energy.
    row : ndarray
        Time, coordinates, velocities, and further columns.
    errors : ndarray, shape (2 n,)
        Error bounds of coordinates and velocities.
    """
    values = {p.name: (p.value, 0.0) for p in equations.model.parameters}
    names, off = ("t", *equations.state), [0.0, *errors.tolist()]
    state = zip_longest(row[: len(names)].tolist(), off, fillvalue=0.0)
    values |= dict(zip(names, state, strict=False))
    ((_, error),) = evaluate_with_error(equations.graph, [node], values)
    return float(error)


# A jump of a potential exerts no impulse in the model, so a jump of the energy there is
# no error. Most energies with a switch are continuous at the switch, however (a spring
# that acts on one side), and a loss of energy there is an error. Therefore the energy
# is evaluated on both sides of each switch that the rows pass, at neighbouring doubles,
# its jumps are subtracted, and the remaining drift is compared with the usual bounds.

# Functions that jump where an argument changes its sign: an angle at its cut, quotients
# and powers at a pole. The value is the index of that argument.
CUT = {"atan2": 0, "div": 1, "pow": 0}
# All functions that jump: step functions, choices, and functions with a cut.
SWITCHES = STEPS | {"if", *CUT}
# The largest number of switches located between one row and the next.
MOST_ON_A_WAY = 8


def energy_jumps(equations: Equations, balance: Balance) -> Floats:
    """Return the jumps of an energy at its switches between rows of a balance, (k,).

    Entry 0 is the jump from the worst row of the balance to `balance.rows[0]`; entry
    j > 0 is the jump from row j - 1 to row j of `balance.rows`.
    """
    energy, rows = Energy(equations, balance.energy), balance.rows
    if not energy.switches:
        return np.zeros(len(rows))
    worst = rows[0] if balance.worst_row is None else balance.worst_row
    states = np.vstack([worst[: rows.shape[1]], rows])
    sides = energy.sides_of_rows(states)
    least = COMPUTED_ZERO * balance.in_play
    found = np.zeros(len(rows))
    for k in np.flatnonzero((sides[:, 1:] != sides[:, :-1]).any(axis=0)):
        found[k] = energy.jump(states[k], states[k + 1], least)
    return found


def without_jumps(equations: Equations, balance: Balance) -> Floats | None:
    """Return `balance.conserved` (k,) less the jumps of the energy.

    None if the energy does not jump.
    """
    jumped, kept = energy_jumps(equations, balance)[1:], balance.conserved
    sizes = np.abs(jumped[jumped != 0.0])
    if not len(sizes):
        return None
    changes, size = np.diff(kept) - jumped, float(np.max(sizes))
    if np.ptp(sizes) <= HALF_OF_DIGITS * size < np.inf:
        changes -= size * np.round(changes / size)
    return np.asarray(np.concatenate([[0.0], np.cumsum(changes)]) + kept[0])


class Energy:
    """An energy as a function of the state, and the switches that it contains.

    Parameters
    ----------
    equations : Equations
    energy : int
        The node of the energy.
    """

    def __init__(self, equations: Equations, energy: int) -> None:
        g = equations.graph
        self.graph, self.energy = g, energy
        self.names = ("t", *equations.state)
        self.parameters = equations.model.parameter_values
        found = sorted(
            n for n in g.dependent([energy], self.names) if g.ops[n] in SWITCHES
        )
        # The node whose value decides the side: the condition of a choice, the argument
        # whose sign changes for an angle or a quotient, otherwise the value of the
        # switch.
        inner = {**CUT, "if": 0}
        ops = [g.ops[n] for n in found]
        pairs = [*zip(found, ops, strict=True)]
        self.switches = [g.args[n][inner[op]] if op in inner else n for n, op in pairs]
        self.cut = [op in CUT for op in ops]

    def sides(self, state: Floats) -> list[float]:
        """Return the side of each switch at a state, as a number.

        A switch has a different number on each of its sides.

        state : (1 + 2 n,), time, coordinates and velocities.
        """
        values = zip(self._values(self.switches, state), self.cut, strict=True)
        return [math.copysign(1.0, x) if cut else float(x) for x, cut in values]

    def sides_of_rows(self, states: Floats) -> Floats:
        """Return the sides of all switches at states, see `sides`, (switches, k).

        states : (k, 1 + 2 n).
        """
        values = self.parameters | dict(zip(self.names, states.T, strict=True))
        found = evaluate_rows(self.graph, self.switches, values, len(states))
        cut = np.array(self.cut)[:, np.newaxis]
        return np.where(cut, np.copysign(1.0, found), found)

    def jump(self, a: Floats, b: Floats, least: float) -> float:
        """Return the sum of the jumps of the energy on the line from state a to b.

        Jumps of at most `least`, or of the size of rounding, are left out.

        Parameters
        ----------
        a, b : ndarray, shape (1 + 2 n,)
            Time, coordinates and velocities.
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
            ends = (self._values([self.energy], a + y * (b - a)) for y in (low, high))
            (before,), (after,) = ends
            size = max(abs(before), abs(after))
            if not abs(after - before) <= max(least, ENERGY_ROUNDOFF * size):
                found += after - before
            x = high
        return found

    def _values(self, nodes: list[int], state: Floats) -> list[float]:
        values = dict(zip(self.names, state.tolist(), strict=True))
        return evaluate(self.graph, nodes, self.parameters | values)
