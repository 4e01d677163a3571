"""Which switches a model has, and its expressions with their branches frozen.

Inside an arc of a run the branch of each switch is fixed, so that the equations are
smooth there, also for a Runge-Kutta stage at or past the arc's last instant. What
decides a switch (the condition of `if`, the argument of `abs`, ...) may depend on

- parameters only: it is no switch;
- t, but on nothing that moves: a *time switch*. Its discrete function (the truth of the
  condition, the sign, the floor, ...) becomes a mode variable, constant on each arc;
- what moves: a *state switch*.

Conditions joined by `and`, `or`, `not` are taken apart as far as their parts differ in
kind: in `if(t < 1 and x > 0, ...)`, `t < 1` is a time switch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lagsim.expressions.evaluate import evaluate
from lagsim.expressions.functions import OPERATIONS
from lagsim.expressions.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from lagsim.expressions.graph import Graph

_JOINING = ("and", "or", "not")
_STEPS = ("sign", "heaviside", "floor", "ceil")
# For a function that is not a step itself: the discrete function that decides it.
_DECIDED_BY = {"abs": "sign", "min": "le", "max": "ge"}


@dataclass(frozen=True, slots=True)
class Mode:
    """A time switch: the mode variable's name and the node of its discrete function."""

    variable: str
    discrete: int


@dataclass(frozen=True, slots=True)
class StateSwitch:
    """A switch that depends on the state.

    Attributes
    ----------
    function
        The name of the function in the model's text: `if`, `sign`, ...
    discrete
        The node of its discrete function.
    text
        The expression that decides it, roughly as it was written.
    """

    function: str
    discrete: int
    text: str

    def __str__(self) -> str:
        """Give the switch as it may have been written."""
        shown = self.text
        if self.function == "if":
            shown += ", ..."
        return f"{self.function}({shown})"


@dataclass(frozen=True, slots=True)
class Surface:
    """A part of a discrete function that steps where `node` meets a value.

    Attributes
    ----------
    discrete
        The comparison or the sign, heaviside, floor or ceil.
    op
        Its operation.
    node
        The expression: it meets 0, or a whole number for floor and ceil. For a
        comparison a < b it is a - b.
    """

    discrete: int
    op: str
    node: int


def joined_conditions(g: Graph, discrete: int) -> list[int]:
    """Give the `and`, `or`, `not` that make up a condition, in order of evaluation."""
    found: set[int] = set()
    stack = [discrete]
    while stack:
        n = stack.pop()
        if g.ops[n] in _JOINING and n not in found:
            found.add(n)
            stack += g.args[n]
    return sorted(found)


def surfaces(g: Graph, discrete: int) -> tuple[Surface, ...]:
    """Take a discrete function apart into its surfaces."""
    joined = joined_conditions(g, discrete)
    parts = {discrete, *(a for n in joined for a in g.args[n])} - set(joined)
    found = []
    for n in sorted(parts):
        op, args = g.ops[n], g.args[n]
        if op in _STEPS:
            found.append(Surface(n, op, args[0]))
        elif args:  # else a truth value
            found.append(Surface(n, op, g.call("sub", *args)))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Switches:
    """The switches of a graph's expressions.

    Attributes
    ----------
    modes
        The time switches, one per distinct discrete function.
    state
        The state switches.
    """

    graph: Graph
    modes: tuple[Mode, ...]
    state: tuple[StateSwitch, ...]
    _modes_of: Mapping[int, int]  # switch, or condition -> its mode variable's node

    def freeze(self, nodes: Iterable[int]) -> list[int]:
        """Give `nodes` with each time switch decided by its mode variable.

        `nodes` must be among those that the switches were found in.
        """
        g = self.graph
        nodes = list(nodes)
        done: dict[int, int] = {}
        for n in g.cone(nodes):
            args = tuple(done[a] for a in g.args[n])
            mode = self._modes_of.get(n)
            if mode is not None:
                done[n] = _frozen(g, g.ops[n], args, mode)
            else:
                done[n] = n if args == g.args[n] else g.call(g.ops[n], *args)
        return [done[n] for n in nodes]

    def mode_values(
        self, start: float, end: float, values: Mapping[str, float]
    ) -> list[float]:
        """Give the mode variables on an arc without breaks, `values` the parameters."""
        discrete = [mode.discrete for mode in self.modes]
        return prevailing(
            lambda t: evaluate(self.graph, discrete, {**values, "t": t}), start, end
        )


def prevailing(
    value: Callable[[float], Sequence[float]], start: float, end: float
) -> list[float]:
    """Give the values that step functions without a break have in (start, end).

    A value that is taken at one instant only, like sign(0), is outvoted.
    """
    samples = [
        [float(x) for x in value(start + part * (end - start))]
        for part in (0.381966, 0.5, 0.723607)
    ]
    return [
        a if _same(a, b) or _same(a, c) else b for a, b, c in zip(*samples, strict=True)
    ]


def _same(a: float, b: float) -> bool:
    return a == b or (math.isnan(a) and math.isnan(b))


def _frozen(g: Graph, op: str, args: tuple[int, ...], mode: int) -> int:
    if op in _STEPS:
        return mode
    if op == "abs":
        return g.call("mul", mode, args[0])
    truth = g.call("gt", mode, g.constant(0.5))
    return g.call("if", truth, *args) if op in ("min", "max") else truth


def find_switches(g: Graph, nodes: Iterable[int], moving: Collection[str]) -> Switches:
    """Find the switches of `nodes`.

    Parameters
    ----------
    g, nodes
        The expressions, derivatives included: differentiation makes switches.
    moving
        The names of what changes along the motion, other than t.
    """
    finder = _Finder(g, list(nodes), moving)
    finder.visit()
    numbers = {d: k for k, d in enumerate(sorted(set(finder.time.values())))}
    modes = tuple(Mode(f"mode.{k}", d) for d, k in numbers.items())
    modes_of = {
        n: g.variable(modes[numbers[d]].variable) for n, d in finder.time.items()
    }
    state = tuple(
        StateSwitch(function, discrete, expression_text(g, *deciding))
        for discrete, (function, deciding) in sorted(finder.state.items())
    )
    return Switches(g, modes, state, modes_of)


class _Finder:
    """Walks down from the nodes; what only decides a time switch is not reached."""

    def __init__(self, g: Graph, nodes: list[int], moving: Collection[str]) -> None:
        self.g = g
        self.nodes = nodes
        self.moving = g.dependent(nodes, moving)
        self.timed = g.dependent(nodes, ("t",)) - self.moving
        self.time: dict[int, int] = {}  # switch or condition -> discrete function
        self.state: dict[int, tuple[str, tuple[int, ...]]] = {}

    def visit(self) -> None:
        seen = set(self.nodes)
        stack = sorted(seen)
        while stack:
            for a in self._below(stack.pop()):
                if a not in seen:
                    seen.add(a)
                    stack.append(a)

    def _below(self, n: int) -> tuple[int, ...]:
        """Record `n` if it is a switch; give where to go on."""
        g = self.g
        op, args = g.ops[n], g.args[n]
        row = OPERATIONS.get(op)
        if row is None or not (row.switch or row.condition):
            return args
        if op == "if":
            return args[1:] if _is_guard(g, n) else args
        if row.condition:
            return self._condition(n, op, args)
        if any(a in self.moving for a in args):
            discrete = self._discrete(n, op, args)
            # abs, min and max keep their name where their derivative is a switch too.
            if op not in _STEPS or discrete not in self.state:
                self.state[discrete] = op, args
        elif any(a in self.timed for a in args):
            self.time[n] = self._discrete(n, op, args)
            return () if op in _STEPS else args
        return args

    def _condition(self, n: int, op: str, args: tuple[int, ...]) -> tuple[int, ...]:
        if n in self.timed:
            self.time[n] = n
            return ()
        if n in self.moving and op not in _JOINING:
            self.state.setdefault(n, ("if", (n,)))
        return args

    def _discrete(self, n: int, op: str, args: tuple[int, ...]) -> int:
        return n if op in _STEPS else self.g.call(_DECIDED_BY[op], *args)


def _is_guard(g: Graph, n: int) -> bool:
    """Tell whether `n` is x^y log(x), with its limit 0 where x^y is 0.

    Differentiation makes these. The condition mends a single point; nothing switches.
    """
    condition, limit, product = g.args[n]
    if g.ops[condition] != "le" or limit != g.zero or g.ops[product] != "mul":
        return False
    size, zero = g.args[condition]
    return (
        zero == g.zero
        and g.ops[size] == "abs"
        and g.ops[g.args[size][0]] == "pow"
        and g.args[size][0] in g.args[product]
    )


_SYMBOLS = {
    "or": (1, " or "),
    "and": (2, " and "),
    "lt": (4, " < "),
    "le": (4, " <= "),
    "gt": (4, " > "),
    "ge": (4, " >= "),
    "add": (5, " + "),
    "sub": (5, " - "),
    "mul": (6, "*"),
    "div": (6, "/"),
    "pow": (8, "^"),
}
_PREFIXES = {"not": (3, "not "), "neg": (7, "-")}


def expression_text(g: Graph, *nodes: int, depth: int = 6) -> str:
    """Give expressions for a message, roughly as written; `...` where they are deep."""
    return ", ".join(_text(g, n, depth)[1] for n in nodes)


def _text(g: Graph, n: int, depth: int) -> tuple[int, str]:
    """Give the binding power and the text; `depth` bounds the recursion."""
    op, args = g.ops[n], g.args[n]
    if op in (VARIABLE, TRUTH):
        return 9, str(g.payload(n))
    if op == CONSTANT:
        x = g.value(n)
        assert x is not None
        return (9 if x >= 0.0 else 7), f"{x:.12g}"
    if depth == 0:
        return 9, "..."
    if op in _SYMBOLS or op in _PREFIXES:
        power, symbol = (_SYMBOLS | _PREFIXES)[op]
        parts = [_text(g, a, depth - 1) for a in args]
        # The right operand of -, / and comparisons, and the base of ^, bind tighter.
        least = [power + (op == "pow"), power + (op in ("sub", "div"))][-len(parts) :]
        shown = [
            f"({text})" if p < q else text
            for (p, text), q in zip(parts, least, strict=True)
        ]
        return power, symbol + shown[0] if op in _PREFIXES else symbol.join(shown)
    return 9, f"{op}({expression_text(g, *args, depth=depth - 1)})"
