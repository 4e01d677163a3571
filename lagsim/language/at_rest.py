"""Friction bounds that step at slip 0: their values at rest and while sliding.

`if(abs(v) > 0, F1, F0)`, `F0 - (F0 - F1)*sign(abs(v))` and similar expressions step at
a single value of the slip v. While the motion holds v = 0, the bound is the value at v
= 0; while the motion slides, however slowly, it is the limit beside v = 0. Both are
expressions: in the first, each comparison and step has its value at v = 0, in the
second its value beside v = 0.

A switch at a slip other than 0, `if(abs(v) < 1e-12, F0, F1)`, keeps its place. But at
slip 0 rounding may not tell on which side of it v is: the bound at rest is the value at
v = 0 exactly, where each part that vanishes with the slip is replaced by 0. If no
computed motion has a slip between, `if(abs(v) < 1e-300, F0, F1)`, the switch is at 0.

Whether the argument of a switch vanishes with the slip, and its sign beside slip 0, is
tested at points: `abs(v)`, `v^2`, `max(v, -v)`, `hypot(v, 0)` differ only in form. A
value counts as 0 within its computed rounding error. The test must have the same result
for the parameters of the file and for other values.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.language.functions import JOINING, OPERATIONS, STEPS
from lagsim.language.graph import DATA, TRUTH
from lagsim.tolerances import UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.graph import Graph

    Values = dict[str, tuple[float, float]]

WHOLE = ("floor", "ceil")
# Number of points with the parameters of the file, and with others; multiples of an
# irrational number give each variable a different value at each point.
POINTS = 12
GOLDEN, LEAST, SPAN = 0.618033988749895, 0.2, 1.6
# Slips beside 0, and directions of a slip of two components; the least part of the
# largest value over all directions that is not 0.
SPEEDS = (1e-6, 1e-3, 0.3, 7.0)
DIRECTIONS = 64
BENT = 1e-7
# Under a force that grows with time a slip is faster than this after less time than the
# rounding of the time at which it begins.
LEAST_SLIP = 1e-30
# A value is 0 within CERTAIN error bounds; two bounds are equal within the relative
# difference SAME; a continuous bound changes by at most CHANGE over a slip of STEP, and
# a steep one falls there by more than STEEP.
CERTAIN, SAME = 8.0, 1e-9
STEP, CHANGE, STEEP = 1e-13, 1e-5, 1e-2
# Largest number of equalities; relative size of the pivot of dependent rows.
MOST_HELD, DEPENDENT = 32, 1e-9


class Bounds(NamedTuple):
    """Nodes of a friction bound: its value at rest (slip 0), and while sliding."""

    resting: int
    sliding: int


class _SlipPoint(NamedTuple):
    """Value and error of all variables at slip 0, and changes of velocities.

    `ways` has, for each component of the slip, the changes of velocities by name that
    change this component by 1.
    """

    values: Values
    ways: list[dict[str, float]]

    def at_slip(self, *slip: float) -> Values:
        """Return the values of all variables at another slip.

        slip : components of the other slip.
        """
        found = dict(self.values)
        for part, way in zip(slip, self.ways, strict=True):
            for name, change in way.items():
                found[name] = (found[name][0] + part * change, 0.0)
        return found


def bounds_at_rest(
    g: Graph,
    node: int,
    slips: Sequence[int],
    velocities: Collection[str],
    known: Mapping[str, tuple[float, float]],
    zero_rates: Sequence[int] = (),
) -> Bounds | None:
    """Return the bound `node` at rest and while sliding.

    Both are `node` itself where no switch steps at slip 0, or where both sides differ
    only by the direction of the slip.

    Parameters
    ----------
    g
        The graph.
    node
        The bound.
    slips
        The slip, or its two components: affine in the velocities.
    velocities
        Names of the velocities.
    known
        Value and rounding error of each parameter.
    zero_rates
        Expressions of velocities that are 0 in each motion: rates of equalities.

    Returns
    -------
    Bounds or None
        None where the value of a switch at slip 0 cannot be determined, or where the
        bound falls steeply there without a switch.
    """
    moving = g.dependent([node], velocities)
    if node not in moving:
        return Bounds(node, node)
    steps = any(n in moving and _is_discrete(g, n) for n in g.cone([node]))
    zero_rates = _coupled(g, [node, *slips], zero_rates, velocities)
    names = g.depends([node, *slips, *zero_rates])
    found = [_points(g, slips, names, velocities, x, zero_rates) for x in (known, {})]
    if not all(found):  # equalities prevent any slip
        return Bounds(node, node) if zero_rates else None
    beside = _Beside(g, node, moving, found[0], found[1])
    if steps:
        return beside.bounds(slips)
    return None if beside.is_steep() else Bounds(node, node)


def _coupled(
    g: Graph,
    nodes: Sequence[int],
    zero_rates: Sequence[int],
    velocities: Collection[str],
) -> list[int]:
    """Return at most MOST_HELD of `zero_rates` that share velocities with `nodes`.

    Velocities may be shared directly, or through other rates in the result.

    zero_rates : rates of equalities, which are 0 in each motion.
    """
    names = g.depends(nodes) & frozenset(velocities)
    left, found = list(zero_rates), list[int]()
    while len(found) < MOST_HELD:
        near = [n for n in left if not names.isdisjoint(g.depends([n]))]
        if not near:
            break
        found += near
        left = [n for n in left if n not in near]
        names = names | (g.depends(near) & frozenset(velocities))
    return found


def _is_discrete(g: Graph, n: int) -> bool:
    """Whether a node is a comparison or a step."""
    row = OPERATIONS.get(g.ops[n])
    return row is not None and g.ops[n] not in JOINING and (row.condition or row.step)


def _is_condition(g: Graph, n: int) -> bool:
    """Whether the value of a node is a truth value."""
    row = OPERATIONS.get(g.ops[n])
    return g.ops[n] == TRUTH or (row is not None and row.condition)


def _points(
    g: Graph,
    slips: Sequence[int],
    names: Collection[str],
    velocities: Collection[str],
    known: Mapping[str, tuple[float, float]],
    zero_rates: Sequence[int],
) -> list[_SlipPoint]:
    """Return test points at which all slips and the rates `zero_rates` are 0.

    Points at which a slip has no value are left out.

    slips, zero_rates : nodes of the slips, and of rates that are 0.
    names : variables of the bound.
    velocities : the names among these whose values may be changed.
    known : value and error of each parameter; other variables have arbitrary values.
    """
    order = sorted(names)
    speeds = [name for name in order if name in velocities]
    variables = [g.variable(v) for v in speeds]
    slopes = [gradient(g, s, variables) for s in (*slips, *zero_rates)]
    found = []
    for k in range(1, POINTS + 1):
        values: Values = {}
        for i, name in enumerate(order, 1):
            part = math.modf(GOLDEN * (k * i + k * k + 0.37 * i * i))[0]
            size = LEAST + SPAN * part
            values[name] = known.get(name, (size if (i + k) % 3 else -size, 0.0))
        point = _at_zero(g, slips, zero_rates, slopes, speeds, values)
        if point is not None:
            found.append(point)
    return found


def _at_zero(
    g: Graph,
    slips: Sequence[int],
    zero_rates: Sequence[int],
    slopes: Sequence[Sequence[int]],
    speeds: Sequence[str],
    values: Values,
) -> _SlipPoint | None:
    """Return the point with velocities at which all slips and `zero_rates` are 0.

    None if no change of velocities achieves this.

    Parameters
    ----------
    slips, zero_rates
        Nodes of the slips, and of rates that are 0.
    slopes
        Their derivatives by the velocities, a row of nodes for each.
    speeds
        Names of the velocities.
    values
        Value and error of each variable before.
    """
    plain = {name: value for name, (value, _) in values.items()}
    rows = [evaluate(g, row, plain) for row in slopes]
    inverse = _inverse(rows, len(slips))
    if inverse is None:
        return None
    # By a unit of each row; the rows of slips come first.
    ways = [
        {name: change for name, change in zip(speeds, way, strict=True) if change}
        for way in inverse
    ]
    zero = (*slips, *zero_rates)
    for _ in range(3):
        for x, way in zip(evaluate(g, zero, plain), ways, strict=True):
            for name, change in way.items():
                plain[name] -= x * change
    off = evaluate(g, zero, plain)
    if not all(map(math.isfinite, (*off, *plain.values()))):
        return None
    found = {name: (plain[name], error) for name, (_, error) in values.items()}
    for name in {name for way in ways for name in way}:
        left = sum(
            abs(x * way.get(name, 0.0)) for x, way in zip(off, ways, strict=True)
        )
        found[name] = plain[name], left + UNIT_ROUNDOFF * abs(plain[name])
    return _SlipPoint(found, ways[: len(slips)])


def _inverse(rows: list[list[float]], first: int) -> list[list[float]] | None:
    """Return r changes of velocities (r, n); change k changes row k alone, by 1.

    A row is changed by the velocity with the largest slope, by elimination with
    complete pivoting, so that no other velocity is rounded. A row that depends on
    others has the change 0. The result is None if one of the `first` rows depends on
    others.

    rows : coefficients (r, n) of the velocities.
    """
    count = len(rows)
    if not all(math.isfinite(x) for row in rows for x in row) or not rows[0]:
        return None
    size = max(abs(x) for row in rows for x in row)
    work = [[*row, *([0.0] * count)] for row in rows]
    width, open_rows, pivots = len(rows[0]), set(range(count)), dict[int, int]()
    for i, row in enumerate(work):
        row[width + i] = 1.0
    for _ in range(count):
        most, i, j = max(
            (abs(work[i][j]), i, j) for i in open_rows for j in range(width)
        )
        if not most > DEPENDENT * size:
            break
        pivot = work[i][j]
        work[i] = [x / pivot for x in work[i]]
        for k in range(count):
            factor = work[k][j]
            if k != i and factor:
                own = work[i]
                work[k] = [x - factor * z for x, z in zip(work[k], own, strict=True)]
        open_rows.discard(i)
        pivots[i] = j
    if not open_rows.isdisjoint(range(first)):
        return None
    found = [[0.0] * width for _ in rows]
    for i, j in pivots.items():
        for k in pivots:
            found[k][j] = work[i][width + k]
    return found


# Directions in which a slip of one component, or of two, leaves 0.
_TURNS = [2.0 * math.pi * i / 10.0 for i in range(10)]
_UP_AND_DOWN: list[tuple[float, ...]] = [(1.0,), (-1.0,)]
_AROUND: list[tuple[float, ...]] = [(math.cos(a), math.sin(a)) for a in _TURNS]
_AROUND += [(0.0, 1.0), (0.0, -1.0)]


class _UnclearError(Exception):
    """Signal that the value of a switch at slip 0 cannot be determined."""


# Versions of an expression: at slip 0, on either side, and with only the switches
# decided whose values are equal on both sides.
REST, ABOVE, BELOW, EVEN = range(4)


class _Beside:
    """Decision of the switches of an expression at slip 0, and at small slips.

    The argument `part` of its methods is the node of a part of the expression.

    Parameters
    ----------
    g, node
        The graph, and the expression.
    moving
        Nodes of the expression that depend on velocities.
    points, others
        Test points with the parameters of the file, and with other values.
    """

    def __init__(
        self,
        g: Graph,
        node: int,
        moving: Collection[int],
        points: list[_SlipPoint],
        others: list[_SlipPoint],
    ) -> None:
        self.g, self.node, self.moving = g, node, moving
        self.points, self.others = points, others
        self.pair = len(points[0].ways) == 2
        self.steps = self.even = self.near = False

    def bounds(self, slips: Sequence[int]) -> Bounds | None:
        """Return the bound at rest and while sliding; None where it is unclear.

        slips : nodes of the slip, or of its two components.
        """
        g, node = self.g, self.node
        try:
            versions = self._versions()
        except _UnclearError:
            same = self._is_continuous()
            return Bounds(node, node) if same else None
        rest, above, below, even = versions
        own = Bounds(rest if self.near and self._falls(rest) else node, node)
        if not self.steps:
            return None if not self.near and self.is_steep() else own
        if above == below:
            return Bounds(rest, above) if self._has_value(above) else None
        if not self.even and self._is_continuous():
            return own
        if self._same(above, below):
            up = g.call("gt", slips[0], g.zero)
            return Bounds(rest, g.call("if", up, above, below))
        return Bounds(rest, even) if self.even else own

    def _versions(self) -> list[int]:
        """Return four versions of the expression as nodes: REST, ABOVE, BELOW, EVEN.

        In each version the switches at slip 0 are decided. REST equals the expression
        at slip 0, ABOVE and BELOW at small slips of positive and negative sign, EVEN at
        small slips of both signs where these agree.
        """
        g = self.g
        done: dict[int, list[int]] = {}
        for n in g.cone([self.node]):
            args = g.args[n]
            below = [[done[a][v] for a in args] for v in range(4)]
            done[n] = [
                n if new == list(args) else g.call(g.ops[n], *new) for new in below
            ]
            if n not in self.moving or g.ops[n] == DATA:
                continue
            if _is_discrete(g, n):
                self._decide(n, below, done)
            elif not _is_condition(g, n) and self._is_zero(done[n][REST]):
                done[n][REST] = g.zero
        return done[self.node]

    def _decide(
        self, n: int, below: list[list[int]], done: dict[int, list[int]]
    ) -> None:
        """Decide switch n, whose argument vanishes at slip 0, in all four versions.

        below : the versions of each argument.
        done : the versions of each node, to which those of n are written.
        """
        g, op = self.g, self.g.ops[n]
        parts = [args[0] if op in STEPS else g.call("sub", *args) for args in below]
        vanishes = self._vanishes(parts[REST], whole=op in WHOLE)
        if op in WHOLE:
            if vanishes:
                self._refuse_jump(done[n])
            return
        if not vanishes and not self._steps_near(parts):
            return
        if self.pair:
            up = down = self._sign_around(parts[ABOVE])
        else:
            up, down = self._sign(parts[ABOVE], 1.0), self._sign(parts[BELOW], -1.0)
        if up == down == 0.0:
            return  # 0 at the points, at any slip: a switch of another argument
        if vanishes:
            done[n][REST] = _decided(g, op, 0.0)
        self.steps = True
        done[n][ABOVE] = _decided(g, op, up)
        done[n][BELOW] = _decided(g, op, down)
        if up == down:
            self.even = True
            done[n][EVEN] = done[n][ABOVE]

    def _steps_near(self, parts: Sequence[int]) -> bool:
        """Whether an argument changes its sign at a slip too small for any run.

        If the sign changes for the parameters of the file, `near` is set.

        parts : nodes of the argument in the four versions, see `_versions`.
        """
        near = [self._changes(parts, x, SPEEDS[0]) for x in self.points]
        self.near = self.near or any(map(any, near))
        near += [self._changes(parts, x, SPEEDS[0]) for x in self.others]
        every = (*self.points, *self.others)
        least = [self._changes(parts, x, LEAST_SLIP) for x in every]
        return all(map(any, near)) and least == near

    def _changes(
        self, parts: Sequence[int], point: _SlipPoint, slip: float
    ) -> list[bool]:
        """Return, for each direction of slip, whether the sign of an argument changes.

        The signs at slip 0 and at a slip of size `slip` are compared.

        parts : nodes of the argument in the four versions, see `_versions`.
        point : the values of other variables.
        """
        found = []
        here = evaluate(self.g, [parts[REST]], _plain(point.values))[0]
        for way in _AROUND if self.pair else _UP_AND_DOWN:
            beside = _plain(point.at_slip(*[slip * x for x in way]))
            side = BELOW if way == _UP_AND_DOWN[1] else ABOVE
            there = evaluate(self.g, [parts[side]], beside)[0]
            found.append(here * there <= 0.0)
        return found

    def _falls(self, rest: int) -> bool:
        """Whether the bound beside slip 0 is less than the bound at rest.

        rest : the node of the bound at rest.
        """
        for point in self.points:
            here = evaluate(self.g, [rest], _plain(point.values))[0]
            for way in _AROUND if self.pair else _UP_AND_DOWN:
                beside = _plain(point.at_slip(*[SPEEDS[0] * x for x in way]))
                if not evaluate(self.g, [self.node], beside)[0] <= here:
                    return False
        return True

    def _is_zero(self, part: int) -> bool:
        """Whether an expression is 0 at slip 0, at all points and parameter values."""
        try:
            return self._vanishes(part, whole=False)
        except _UnclearError:
            return False

    def _vanishes(self, part: int, *, whole: bool) -> bool:
        """Whether an expression is 0 at slip 0; with `whole`, whether it is an integer.

        Raises
        ------
        _UnclearError
            Where the result differs between points or values of parameters.
        """
        found = set()
        for point in (*self.points, *self.others):
            ((value, error),) = evaluate_with_error(self.g, [part], point.values)
            if math.isfinite(value):
                off = value - round(value) if whole else value
                found.add(abs(off) <= CERTAIN * error)
        if len(found) != 1:
            raise _UnclearError
        return found.pop()

    def _refuse_jump(self, versions: list[int]) -> None:
        """Raise _UnclearError if a whole-number function jumps at slip 0.

        versions : nodes of the function in the four versions.
        """
        for point in self.points:
            here = evaluate(self.g, [versions[REST]], _plain(point.values))
            for slip in (SPEEDS[0], -SPEEDS[0]):
                beside = point.at_slip(*[slip] * len(point.ways))
                if evaluate(self.g, [versions[ABOVE]], _plain(beside)) != here:
                    raise _UnclearError

    def _sign(self, part: int, way: float) -> float:
        """Return the sign of an expression at small slips in one direction.

        part : the node of the expression.
        way : 1 or -1, the direction.
        """
        found = set()
        for point in (*self.points, *self.others):
            for speed in SPEEDS:
                beside = _plain(point.at_slip(way * speed))
                value = evaluate(self.g, [part], beside)[0]
                if math.isfinite(value):
                    found.add(math.copysign(1.0, value) if value else 0.0)
        if len(found) != 1:
            raise _UnclearError
        return found.pop()

    def _sign_around(self, part: int) -> float:
        """Return the sign of an expression (a node) at small slips in all directions.

        Raises
        ------
        _UnclearError
            Where the sign differs between directions or points.
        """
        found = set()
        for point in (*self.points, *self.others):
            for speed in SPEEDS:
                values = [
                    self._around(part, point, speed, 2.0 * math.pi * i / DIRECTIONS)
                    for i in range(DIRECTIONS)
                ]
                if not all(map(math.isfinite, values)):
                    continue
                least = min(range(DIRECTIONS), key=lambda i: abs(values[i]))
                low = self._least(part, point, speed, least)
                if low <= BENT * max(map(abs, values)):
                    raise _UnclearError
                found |= {math.copysign(1.0, value) for value in values}
        if len(found) != 1:
            raise _UnclearError
        return found.pop()

    def _around(
        self, part: int, point: _SlipPoint, speed: float, angle: float
    ) -> float:
        beside = point.at_slip(speed * math.cos(angle), speed * math.sin(angle))
        return evaluate(self.g, [part], _plain(beside))[0]

    def _least(self, part: int, point: _SlipPoint, speed: float, i: int) -> float:
        """Return the least magnitude of an expression over slips near direction i.

        The minimum is found by repeated division of the range of directions into
        thirds.

        part : node of the expression.
        point : values of other variables.
        speed : size of the slips.
        i : number of the direction, of DIRECTIONS evenly spaced ones.
        """
        low, high = (2.0 * math.pi * (i + way) / DIRECTIONS for way in (-1, 1))
        for _ in range(48):
            a, b = low + (high - low) / 3.0, high - (high - low) / 3.0
            x, z = (abs(self._around(part, point, speed, c)) for c in (a, b))
            low, high = (low, b) if x < z else (a, high)
        return abs(self._around(part, point, speed, 0.5 * (low + high)))

    def _is_continuous(self) -> bool:
        """Whether the expression has no step at slip 0."""
        for point in (*self.points, *self.others):
            here = evaluate(self.g, [self.node], _plain(point.values))[0]
            for way in _AROUND if self.pair else _UP_AND_DOWN:
                beside = _plain(point.at_slip(*[STEP * x for x in way]))
                value = evaluate(self.g, [self.node], beside)[0]
                if not abs(value - here) <= CHANGE * max(abs(value), abs(here)):
                    return False
        return True

    def is_steep(self) -> bool:
        """Whether the expression falls within slips that a run cannot tell from 0.

        An example is `F0*(1 - 1e20*abs(v))`: static friction without a switch, whose
        slope is too steep for the integration of a slip that begins. The parameters
        have the values of the file.
        """
        for point in self.points:
            here = evaluate(self.g, [self.node], _plain(point.values))[0]
            for way in _AROUND if self.pair else _UP_AND_DOWN:
                beside = _plain(point.at_slip(*[STEP * x for x in way]))
                value = evaluate(self.g, [self.node], beside)[0]
                if here - value > STEEP * abs(here):
                    return True
        return False

    def _has_value(self, version: int) -> bool:
        """Whether a version is finite at slip 0."""
        values = [
            evaluate(self.g, [version], _plain(point.values))[0]
            for point in (*self.points, *self.others)
        ]
        return all(map(math.isfinite, values))

    def _same(self, one: int, other: int) -> bool:
        """Whether two versions (nodes) of an expression have equal values at slip 0."""
        for point in (*self.points, *self.others):
            a, b = evaluate(self.g, [one, other], _plain(point.values))
            if not abs(a - b) <= SAME * max(abs(a), abs(b)):
                return False
        return True


def _plain(values: Values) -> dict[str, float]:
    return {name: value for name, (value, _) in values.items()}


def _decided(g: Graph, op: str, x: float) -> int:
    """Return the value of a step function, or the truth of a comparison with 0.

    x : the argument of the step, or the number that is compared with 0 by `op`.
    """
    row = OPERATIONS[op]
    if op in STEPS:
        return g.constant(float(row(x)))
    return g.truth(bool(row(x, 0.0)))
