"""Switches of a model, and its expressions with the branches of switches frozen.

Inside an arc of a run the branch of each switch is fixed, so that the equations are
smooth there, also for a Runge-Kutta stage at or past the arc's last instant. The
expression that decides a switch (the condition of `if`, the argument of `abs`, ...) may
depend on

- parameters only: it is no switch;
- t, but no variable of the motion: a *time switch*. Its discrete function (the truth of
  the condition, the sign, the floor, ...) becomes a mode variable, constant on an arc;
- variables of the motion: a *state switch*.

Conditions joined by `and`, `or`, `not` are separated as far as their parts differ in
kind: in `if(t < 1 and x > 0, ...)`, `t < 1` is a time switch.

In `if(x > 0, -x^1.5, (-x)^1.5)` each root has a value on its own side alone. A stage
past the surface, or a start within rounding of it, would evaluate a frozen root outside
its domain: there the argument is mirrored at the end of the domain, so that the value
is continuous. As written, `sqrt(mod(x, 2))` would jump there, which would count as
rounding of y' and raise the tolerance.

Under -c |v|^p sign(v) with 0 < p < 1 a body comes to rest in a finite time. While
another force F grows slowly from 0, the velocity is about (F/c)^(1/p), close to 0, with
an unbounded rate of decay, for which no step is short enough. So the argument of the
root is at least a floor far below the tolerance: below the floor the force is dry
friction of size c floor^p, whose sticking and slipping are located as for any other dry
friction. The error of the velocity is at most the floor. For this purpose a cube root
of velocities is a switch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import CHOOSING, OPERATIONS, SMOOTH, STEPS
from lagsim.language.tables import written
from lagsim.mechanics.surfaces import (
    Corner,
    Side,
    expression_text,
    oriented,
    stepped,
    surfaces,
)

if TYPE_CHECKING:
    from collections.abc import (
        Collection,
        Iterable,
        Mapping,
        Sequence,
    )

    from lagsim.language.functions import Domain
    from lagsim.language.graph import Graph


def _mirrored(g: Graph, branch: int, decides: frozenset[str]) -> tuple[int, int] | None:
    """Return the domain of a branch of an `if`, and its continuation beyond the domain.

    The domain is a condition (node), true where the arguments of all roots and
    logarithms in the branch are in the domains of these functions. The continuation,
    the branch with these arguments mirrored at the ends of their domains, is defined
    everywhere. Only functions of the variables in `decides` count, on which the
    condition of the `if` depends, and only outside of nested branches. Returns None if
    there is no such function.

    branch : node of the branch.
    """
    found = None
    seen: set[int] = set()
    stack = [branch]
    while stack:
        n = stack.pop()
        if n not in seen and g.ops[n] not in ("if", SMOOTH):
            seen.add(n)
            stack += g.args[n]
    done: dict[int, int] = {}
    for n in g.cone([branch]):
        args = tuple(done[a] for a in g.args[n])
        operation = OPERATIONS.get(g.ops[n])
        domain = operation.domain if operation is not None else None
        if domain and n in seen and decides & g.depends([g.args[n][0]]):
            inside, _ = domain(g, g.args[n]) or (None, n)
            if inside is not None:
                found = inside if found is None else g.call("and", found, inside)
                args = (_within(g, domain, args), *args[1:])
        kept = n not in seen or args == g.args[n]
        done[n] = n if kept else g.call(g.ops[n], *args)
    return None if found is None else (found, done[branch])


def _within(g: Graph, domain: Domain, args: tuple[int, ...]) -> int:
    """Return the first argument of a function, mirrored at the end of its domain.

    The result is a node: the argument where it is in the domain of the function, such
    as u >= 0 for a root, and its mirror image at the end of the domain elsewhere.

    domain : the rule that returns the condition of the domain and the mirror image.
    args : nodes of the arguments of the function.
    """
    inside, mirrored = domain(g, args) or (None, args[0])
    return args[0] if inside is None else g.call("if", inside, args[0], mirrored)


# Functions without derivatives at 0.
ROOTS = ("pow", "sqrt", "cbrt")


class Roots(NamedTuple):
    """Roots and powers whose argument has a floor: the least value that it may have.

    Attributes
    ----------
    graph : Graph
        Expression graph of the model.
    floors : mapping of int to str
        The expression of a surface (node) -> the name of its floor.
    """

    graph: Graph
    floors: Mapping[int, str]

    @classmethod
    def among(
        cls,
        g: Graph,
        nodes: Iterable[int],
        sides: Sequence[Side],
        speeds: Collection[str],
    ) -> Roots:
        """Return the roots below `nodes` whose arguments are surfaces of velocities.

        speeds : the names of velocities.
        sides : the sides of all surfaces.
        """
        fast = g.dependent([s.node for s in sides], speeds)
        names = {
            s.node: f"floor.{k}"
            for k, s in enumerate(sides)
            if s.node in fast and not s.whole
        }
        possible = cls(g, names)
        cone = g.cone(nodes) if names else []
        used = {possible._of(n) for n in cone}
        return cls(g, {n: name for n, name in names.items() if name in used})

    def _of(self, n: int) -> str:
        found = self.floor(n)
        return found[0] if found else ""

    def floor(self, n: int) -> tuple[str, float] | None:
        """Return the least value that the argument of root or power `n` may have.

        The value is a variable of the equations times a constant factor; the result is
        the name of this variable, and the factor. None without such a floor.
        """
        g = self.graph
        if not self.floors or g.ops[n] not in ROOTS or self._smooth(n):
            return None
        node, factor = self._inside(g.args[n][0])
        return (self.floors[node], factor) if node in self.floors else None

    def _smooth(self, n: int) -> bool:
        """Whether a power has a continuous derivative at 0.

        Its exponent is then greater than 1, or an integer.
        """
        g = self.graph
        exponent = g.value(g.args[n][1]) if g.ops[n] == "pow" else 0.5
        return exponent is not None and (exponent > 1.0 or exponent % 1.0 == 0.0)

    def _inside(self, n: int) -> tuple[int, float]:
        """Return u and c > 0 with |n| = c |u|, where u is the expression of a surface.

        Where n is no multiple of a surface's expression, u is n or a part of n.

        n : the argument of a root.
        """
        g, factor = self.graph, 1.0
        while n not in self.floors:
            op, args = g.ops[n], g.args[n]
            moving = [a for a in args[op == "if" :] if g.value(a) is None]
            opposite = g.call("neg", n)
            if op in ("abs", "neg") or (op in CHOOSING and len(moving) == 1):
                n = moving[0]
            elif op == "mul" and (c := g.value(args[0])):
                n, factor = args[1], factor * abs(c)
            elif op == "div" and (c := g.value(args[1])):
                n, factor = args[0], factor / abs(c)
            elif op == "sub" and opposite in self.floors:
                n = opposite
            else:
                break
        return n, factor

    def floored(self, n: int, x: int) -> int:
        """Return the argument x of root or power `n`, limited below by its floor."""
        g = self.graph
        found = self.floor(n)
        if found is None or g.value(x) is not None:
            return x
        name, factor = found
        least = g.call("mul", g.constant(factor), g.variable(name))
        if g.ops[n] == "pow" and g.value(exponent := g.args[n][1]) is None:
            least = g.call("if", g.call("lt", exponent, g.one), least, g.zero)
        return g.call("if", g.call("gt", x, least), x, least)


def mixed(g: Graph, part: int, low: int, high: int) -> int:
    """Return the node low + part (high - low), an interpolation between two nodes."""
    return g.call("add", low, g.call("mul", part, g.call("sub", high, low)))


class TimeSwitch(NamedTuple):
    """Switch of t alone.

    Attributes
    ----------
    variable : str
        Name of the mode variable.
    discrete : int
        Node of the discrete function, which is constant between breaks.
    smooth : tuple of float
        Open interval of levels at which the switch steps without a jump of y'.
    """

    variable: str
    discrete: int
    smooth: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Switches:
    """The switches of a graph's expressions.

    Attributes
    ----------
    modes
        The time switches, one per distinct discrete function.
    state
        Discrete function of each state switch (node) -> its approximate text.
    sides
        Position of the state relative to each surface on which the motion depends.
    corners
        Index of a side -> corner of equalities on its surface.
    cuts
        The nodes atan2(y, x) whose jump is located: y = 0 is their surface.
    """

    graph: Graph
    modes: tuple[TimeSwitch, ...]
    state: Mapping[int, str]
    sides: tuple[Side, ...]
    _modes_of: Mapping[int, int]  # switch, or condition -> its mode variable's node
    _sides_of: Mapping[int, tuple[int, int]]  # discrete -> mode variable's node, sign
    _roots: Roots
    corners: Mapping[int, Corner] = field(default_factory=dict)
    cuts: frozenset[int] = frozenset()

    @property
    def acting(self) -> int:
        """The number of sides on which the motion depends; these precede all others."""
        return sum(not side.shown for side in self.sides)

    @property
    def turns(self) -> frozenset[int]:
        """Indices of the sides with corners of equalities at surfaces of positions.

        Velocities jump at these corners.
        """
        bent = self.corners.items()
        return frozenset(k for k, x in bent if x.equal and not x.moving)

    @property
    def bends(self) -> frozenset[int]:
        """Indices of the sides with corners of equalities.

        Jumps of velocities depend on these sides.
        """
        return frozenset(k for k, x in self.corners.items() if x.equal)

    def freeze(self, nodes: Iterable[int]) -> list[int]:
        """Return `nodes` with each switch decided by its mode variable.

        Time switches are frozen only in nodes in which they were found.
        """
        g = self.graph
        nodes = list(nodes)
        if not self._modes_of and not self._sides_of:
            return nodes
        done: dict[int, int] = {}
        for n in g.cone(nodes):
            args = tuple(done[a] for a in g.args[n])
            if n in self._modes_of:
                done[n] = _frozen(g, g.ops[n], args, self._modes_of[n])
            elif side := self._side_of(n):
                done[n] = self._on_a_side(n, args, *side)
            else:
                done[n] = self._rebuilt(n, args)
        return [done[n] for n in nodes]

    def among(self, chosen: Collection[int]) -> Switches:
        """Return the switches of the sides with the given numbers only.

        All other switches, time switches too, are not frozen by the result.
        """
        own = {self.graph.variable(self.sides[k].variable) for k in chosen}
        of = {d: side for d, side in self._sides_of.items() if side[0] in own}
        return replace(self, _modes_of={}, _sides_of=of)

    @property
    def decided(self) -> Switches:
        """The switches without switches that conditions and output alone contain."""
        own = {self.graph.variable(s.variable) for s in self.sides if not s.shown}
        of = {d: side for d, side in self._sides_of.items() if side[0] in own}
        return replace(self, _sides_of=of)

    def held(self) -> dict[int, int]:
        """Return, for each step function (node), the condition that it is at a level.

        The condition (a node) is true where the motion follows or rests on the surface
        of the step function, which then has its value at the level.
        """
        g, found = self.graph, {}
        modes = {g.variable(s.variable): g.variable(s.sliding) for s in self.sides}
        for n, (variable, _) in self._sides_of.items():
            mode = modes[variable]
            on = (
                g.call("gt", mode, g.constant(1.5)),
                g.call("lt", mode, g.constant(-0.5)),
            )
            found[n] = g.call("or", *on)
        return found

    def surface_nodes(self) -> list[int]:
        """Return the expressions of all surfaces, for use in an arc.

        In the expression of a surface on which the motion depends, other switches have
        the branches of the arc. No arc ends at a surface with `Side.shown`: switches in
        its expression have the values that they have in conditions, see `at_levels`.
        """
        frozen = self.freeze([x.node for x in self.sides if not x.shown])
        return frozen + self.at_levels([x.node for x in self.sides if x.shown])

    def texts(self, nodes: Iterable[int]) -> dict[str, str]:
        """Return the texts of switches at and below `nodes`, by their mode variable.

        The text is that of the first switch of each surface.
        """
        names = {self.graph.variable(x.variable): x.variable for x in self.sides}
        found: dict[str, str] = {}
        for n in self.graph.cone(nodes):
            if side := self._side_of(n):
                found.setdefault(names[side[0]], switch_text(self.graph, n))
        return found

    def moving(self, discrete: Sequence[int], names: Collection[str]) -> list[int]:
        """Return discrete functions that depend on `names` with other sides frozen.

        A function such as `sign(sign(x))` changes only with another switch and is left
        out.

        discrete : nodes of discrete functions.
        """
        g = self.graph
        nodes = [oriented(g, surfaces(g, d)[0])[0] for d in discrete]
        frozen = self.freeze(nodes)
        free = g.dependent(frozen, names)
        return [d for d, n in zip(discrete, frozen, strict=True) if n in free]

    def _side_of(self, n: int) -> tuple[int, int] | None:
        op, args = self.graph.ops[n], self.graph.args[n]
        if not self._sides_of or not args:
            return None
        if n in self.cuts:
            return self._sides_of.get(self.graph.call("sign", args[0]))
        if step := OPERATIONS[op].decided_by:
            n = self.graph.call(step, *args)
        return self._sides_of.get(n)

    def _on_a_side(
        self, n: int, args: tuple[int, ...], variable: int, sign: int
    ) -> int:
        """Return the switch n with arguments `args`, decided by a mode variable.

        variable : the mode variable, a node.
        sign : see `surfaces.oriented`.
        """
        g, op = self.graph, self.graph.ops[n]
        if op == "atan2":
            y, x = args
            return _continued(g, y, x, stepped(g, "sign", variable, sign))
        value = stepped(g, OPERATIONS[op].decided_by or op, variable, sign)
        if op == "abs":
            return g.call("mul", value, args[0])
        if op == "cbrt":
            size = self._roots.floored(n, g.call("mul", value, args[0]))
            return g.call("mul", value, g.call("cbrt", size))
        return g.call("if", value, *args) if op in ("min", "max") else value

    def _rebuilt(self, n: int, args: tuple[int, ...]) -> int:
        """Return node n with the frozen arguments `args` in place of its own.

        A root or power of an expression that is a number on one side becomes a number
        on that side, which has derivatives where the root of 0 has none.
        """
        g = self.graph
        op = g.ops[n]
        if args == g.args[n] and self._roots.floor(n) is None:
            return n
        if op == "if" and args[0] != g.args[n][0]:
            return self._with_values(n, args)
        if op in ("mul", "div"):
            return self._product(op, *args)
        if op in ROOTS and g.ops[args[0]] == "if":
            condition, *sides = g.args[args[0]]
            if any(g.value(side) is not None for side in sides):
                apart = [self._inside(n, (x, *args[1:]), args[0]) for x in sides]
                return g.call("if", condition, *apart)
        return self._inside(n, args, args[0])

    def _with_values(self, n: int, args: tuple[int, ...]) -> int:
        """Return the node `if` n with the frozen arguments `args`.

        The frozen condition may select a branch that the condition as written would not
        select, at a state where the branch has no value. The branch is then continued,
        see `_mirrored`.
        """
        g, (condition, *branches) = self.graph, args
        written = g.args[n][0]
        decides = g.depends([written])
        for k, here in enumerate((written, g.call("not", written))):
            if beyond := _mirrored(g, branches[k], decides):
                inside, mirrored = beyond
                own = g.call("or", inside, here)
                branches[k] = g.call("if", own, branches[k], mirrored)
        return g.call("if", condition, *branches)

    def _product(self, op: str, first: int, second: int) -> int:
        """Return the product or quotient of frozen arguments.

        An argument that is 0 on one side makes the result 0 on that side, also where
        the other argument is unbounded, as the derivative of a root at 0.

        op : "mul" or "div".
        first, second : nodes.
        """
        g = self.graph
        pairs = [(first, second)] if op == "div" else [(first, second), (second, first)]
        for one, other in pairs:
            if g.ops[one] == "if" and g.zero in g.args[one][1:]:
                condition, *sides = g.args[one]
                apart = [x if x == g.zero else g.call(op, x, other) for x in sides]
                return g.call("if", condition, *apart)
        return g.call(op, first, second)

    def _inside(self, n: int, args: tuple[int, ...], frozen: int) -> int:
        """Return function n of frozen arguments, continued beyond its domain.

        A stage past the surface could evaluate the root of a negative number where the
        expression as written has a root: the argument is then mirrored. Where the
        expression as written has no value, the result has none either.

        args : the frozen arguments.
        frozen : the first argument with all switches frozen.
        """
        g = self.graph
        op, written = g.ops[n], g.args[n]
        args = (self._roots.floored(n, args[0]), *args[1:])
        domain = OPERATIONS[op].domain
        found = domain(g, args) if domain else None
        if found is None or written[0] == frozen or self._roots.floor(n) is not None:
            return g.call(op, *args)
        inside, mirrored = found
        assert domain is not None
        there, _ = domain(g, (written[0], *args[1:])) or (inside, mirrored)
        own = g.call("or", inside, g.call("not", there))
        return g.call(op, g.call("if", own, args[0], mirrored), *args[1:])

    def at_levels(self, nodes: Iterable[int]) -> list[int]:
        """Return `nodes` for use in conditions, with values of steps at their levels.

        Where the motion follows a surface, or rests on it, rounding leaves the
        expression of the surface slightly above or below its level. A step then has the
        value at the level: `sign(x_dot)` is 0 where friction holds x_dot at 0. Where
        the motion leaves a surface, a step has the value of the selected side until the
        expression differs from its level by more than the slack of the surface. All
        other steps are as written.
        """
        g, half = self.graph, self.graph.constant(0.5)
        carried = g.constant(1.5)  # above CARRIED, below FOLLOWED
        kept = {g.variable(s.variable): s for s in self.sides}
        leaving: dict[int, int] = {}
        done: dict[int, int] = {}
        nodes = list(nodes)
        for n in g.cone(nodes):
            args = tuple(done[a] for a in g.args[n])
            done[n] = n if args == g.args[n] else g.call(g.ops[n], *args)
            if n not in self._sides_of:
                continue
            variable, sign = self._sides_of[n]
            side, op = kept[variable], g.ops[n]
            mode = g.variable(side.sliding)
            follows = g.call("gt", mode, carried)
            level = g.call("add", variable, half) if side.whole else g.zero
            at = g.call("if", follows, level, variable)
            on_level = g.call("or", follows, g.call("lt", mode, g.constant(-0.5)))
            if variable not in leaving:
                leaving[variable] = self._leaves(side)
            decided = g.call("or", on_level, leaving[variable])
            value = stepped(g, op, at, sign)
            if op in STEPS:
                done[n] = g.call("if", decided, value, done[n])
            else:
                free = g.call("and", g.call("not", decided), done[n])
                done[n] = g.call("or", g.call("and", decided, value), free)
        return [done[n] for n in nodes]

    def _leaves(self, side: Side) -> int:
        """Return the condition (a node) that the motion is just leaving a surface.

        It is true while the expression differs from its level by less than the slack of
        the surface, which is 0 where the expression has already left its level.
        """
        g, half = self.graph, self.graph.constant(0.5)
        (off,) = self.at_levels([side.node])
        if side.whole and side.shown:  # no arc ends at the other end of the side
            off = g.call("sub", off, g.variable(side.departed))
        elif side.whole:  # the distance from the closer end of the side
            middle = g.call("add", g.variable(side.variable), half)
            off = g.call("abs", g.call("sub", off, middle))
            off = g.call("sub", off, half)
        near = g.call("lt", g.call("abs", off), g.variable(side.slack))
        free = g.call("lt", g.variable(side.sliding), half)
        return g.call("and", free, near)

    def shown(self, nodes: Iterable[int]) -> list[int]:
        """Return `nodes` for output rows, with frozen steps on surfaces of the motion.

        Where the motion slides along a surface, or rests on it, and at corners of
        equalities, steps have the value on the side of the mode variable. All other
        steps are as written. The kernel of output rows (`program.sliding.observe`)
        combines the rows of both sides of a surface that the motion follows. It sets
        the floors of roots on all other surfaces to 0, since floors belong to the
        forces.
        """
        g, nodes = self.graph, list(nodes)
        if not self.sides:
            return nodes
        half, less = g.constant(0.5), g.constant(-0.5)
        kept = {g.variable(s.variable): g.variable(s.sliding) for s in self.sides}
        bent = {g.variable(self.sides[k].variable) for k in self.corners}
        done: dict[int, int] = {}

        def by_mode(step: int, written: int) -> int:
            variable, sign = self._sides_of[step]
            value, mode = stepped(g, g.ops[step], variable, sign), kept[variable]
            if variable in bent:
                return value
            holds = g.call("or", g.call("gt", mode, half), g.call("lt", mode, less))
            if g.ops[step] in STEPS:
                return g.call("if", holds, value, written)
            free = g.call("and", g.call("not", holds), written)
            return g.call("or", g.call("and", holds, value), free)

        cone = g.cone(nodes)
        floors = {n: x[0] for n in cone if (x := self._roots.floor(n)) is not None}
        slid = dict(zip(floors, self.freeze(floors), strict=True))
        for n in cone:
            args = tuple(done[a] for a in g.args[n])
            done[n] = n if args == g.args[n] else g.call(g.ops[n], *args)
            if n in self._sides_of:
                done[n] = by_mode(n, done[n])
            if n in floors:
                slides = g.call("gt", g.variable(floors[n]), g.zero)
                done[n] = g.call("if", slides, slid[n], done[n])
        return [done[n] for n in nodes]


def _frozen(g: Graph, op: str, args: tuple[int, ...], mode: int) -> int:
    if op in STEPS:
        return mode
    if op == "abs":
        return g.call("mul", mode, args[0])
    truth = g.call("gt", mode, g.constant(0.5))
    return g.call("if", truth, *args) if op in ("min", "max") else truth


def _continued(g: Graph, y: int, x: int, side: int) -> int:
    """Return the node of atan2(y, x), continued across its cut at y = 0, x < 0.

    side : the node of the sign of y on the side from which the function is continued.
    """
    beyond = g.call("atan", g.call("div", y, x))
    half_turn = g.call("mul", g.constant(math.pi), side)
    left = g.call("add", beyond, half_turn)
    return g.call("if", g.call("lt", x, g.zero), left, g.call("atan2", y, x))


def switch_text(g: Graph, n: int) -> str:
    """Return the text of switch n, approximately as in the model file."""
    op, args = g.ops[n], g.args[n]
    if g.ops[args[0]] == "table.knot":
        op, _, args = written(g, args[0])
    elif OPERATIONS[op].condition:
        return f"if({expression_text(g, n)}, ...)"
    return f"{op}({expression_text(g, *args)})"
