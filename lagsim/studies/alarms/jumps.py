"""Jumps of the energy's expression where the motion passes a switch in it.

A jump of a potential makes no impulse: that the energy is then another is no error. But
most energies that are written with a switch are continuous there (a spring that acts on
one side), and what these lose is lost. So both sides of each switch that the rows pass
are looked at, down to neighbouring doubles. What is left of energy - work without the
jumps is held against the same bounds as ever.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.language.functions import STEPS

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.studies.alarms.groups import Balance, Whole

# Functions that step where an argument changes its sign: an angle at its cut, quotients
# and powers at a pole.
CUT = {"atan2": 0, "div": 1, "pow": 0}
# And those that take one value or another, and nothing in between.
SWITCHES = STEPS | {"if", *CUT}
# An energy changes by no more than rounding between neighbours: by this part of what is
# in play, or of its own size.
ROUNDING = 1e-9
OWN_ROUNDING = 1e-13
# Ways between rows that are looked at for any jump, and switches on each.
MOST_WAYS = 64
MOST_ON_A_WAY = 8
# Jumps that differ by no more than this part of themselves are of one size: then rows
# need not resolve how many there are.
ALIKE = 1e-6


def jumps(equations: Equations, account: Balance | Whole) -> bool:
    """Tell whether the energy of an account jumps somewhere on the way."""
    energy = Energy(equations, account.energy)
    if not energy.switches:
        return False
    n = len(equations.q)
    states, worst = account.rows, account.worst_row
    if worst is not None:
        # A jump that is still there at the worst row lies on any way to it.
        states = np.vstack([worst[: 1 + 2 * n], states])
    sides = [energy.sides(state) for state in states]
    changes = [k for k in range(len(states) - 1) if sides[k] != sides[k + 1]]
    least = ROUNDING * account.in_play
    chosen = changes[:: -(-len(changes) // MOST_WAYS) or 1]
    return any(energy.jump(states[k], states[k + 1], least) != 0.0 for k in chosen)


def besides_jumps(equations: Equations, account: Balance | Whole) -> Floats | None:
    """Give energy - work (k,) of the rows that are kept, without jumps on the way.

    None where there are none.
    """
    energy = Energy(equations, account.energy)
    states, balance = account.rows, account.kept
    if not energy.switches or len(states) < 2:
        return None
    least = ROUNDING * account.in_play
    jumped = np.array([energy.jump(a, b, least) for a, b in pairwise(states)])
    sizes = np.abs(jumped[jumped != 0.0])
    if not len(sizes):
        return None
    changes = np.diff(balance) - jumped
    size = float(np.max(sizes))
    if np.ptp(sizes) <= ALIKE * size < np.inf:
        changes -= size * np.round(changes / size)
    rest = np.concatenate([[0.0], np.cumsum(changes)]) + balance[0]
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
            if not abs(after - before) <= max(least, OWN_ROUNDING * size):
                found += after - before
            x = high
        return found

    def _of(self, state: Floats) -> float:
        return float(self._values([self.energy], state)[0])

    def _values(self, nodes: list[int], state: Floats) -> list[float]:
        values = dict(zip(self.names, state.tolist(), strict=True))
        return evaluate(self.graph, nodes, self.parameters | values)
