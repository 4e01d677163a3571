"""Whether the energy's expression jumps where the motion passes a switch in it.

A jump of a potential makes no impulse: that the energy is then another is no error. But
most energies that are written with a switch are continuous there (a spring that acts on
one side), and what these lose is lost. So both sides of each switch that the rows pass
are looked at, down to neighbouring doubles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.language.functions import STEPS

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.run.observers.witness import Witness

# Functions that take one value or another, and nothing in between.
SWITCHES = STEPS | {"if"}
# An energy changes by no more than rounding between neighbours: by this part of what is
# in play, or of its own size.
ROUNDING = 1e-9
OWN_ROUNDING = 1e-13
# Ways between rows that are looked at, and switches on each.
MOST_WAYS = 64
MOST_ON_A_WAY = 8


def jumps(equations: Equations, witness: Witness, worst: Floats | None) -> bool:
    """Tell whether the energy jumps somewhere on the way.

    Parameters
    ----------
    worst
        The row where energy - work is farthest from its first value.
    """
    energy = Energy(equations)
    if not energy.switches:
        return False
    n = len(equations.q)
    states = witness.passed
    if worst is not None:
        # A jump that is still there at the worst row lies on any way to it.
        states = np.vstack([worst[: 1 + 2 * n], states])
    sides = [energy.sides(state) for state in states]
    changes = [k for k in range(len(states) - 1) if sides[k] != sides[k + 1]]
    least = ROUNDING * witness.energy_in_play
    chosen = changes[:: -(-len(changes) // MOST_WAYS) or 1]
    return any(energy.jumps(states[k], states[k + 1], least) for k in chosen)


class Energy:
    """The energy as a function of the state, and the switches in it."""

    def __init__(self, equations: Equations) -> None:
        g = equations.graph
        self.graph, self.energy = g, equations.energy
        self.names = ("t", *equations.q, *equations.velocities)
        self.parameters = {p.name: p.value for p in equations.model.parameters}
        found = sorted(
            n for n in g.dependent([self.energy], self.names) if g.ops[n] in SWITCHES
        )
        # Of a choice the condition, of the others the value.
        self.switches = [g.args[n][0] if g.ops[n] == "if" else n for n in found]

    def sides(self, state: Floats) -> list[float]:
        """Tell on which side of each switch a state is."""
        return [float(x) for x in self._values(self.switches, state)]

    def jumps(self, a: Floats, b: Floats, least: float) -> bool:
        """Tell whether the energy jumps between two states, on the straight way."""
        x = 0.0
        for _switch in range(MOST_ON_A_WAY):
            at_x = self.sides(a + x * (b - a))
            if at_x == self.sides(b):
                return False
            low, high = x, 1.0
            while low < (middle := 0.5 * (low + high)) < high:
                if self.sides(a + middle * (b - a)) == at_x:
                    low = middle
                else:
                    high = middle
            before, after = (self._of(a + y * (b - a)) for y in (low, high))
            size = max(abs(before), abs(after))
            if not abs(after - before) <= max(least, OWN_ROUNDING * size):
                return True
            x = high
        return False

    def _of(self, state: Floats) -> float:
        return float(self._values([self.energy], state)[0])

    def _values(self, nodes: list[int], state: Floats) -> list[float]:
        values = dict(zip(self.names, state.tolist(), strict=True))
        return evaluate(self.graph, nodes, self.parameters | values)
