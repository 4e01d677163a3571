"""Expressions of equal form -> one loop over tables of indices and numbers.

The functions of a family of masses, laws or rows have an expression for each member,
and these differ in variables and numbers only. A function is divided into *statements*:
a node whose value is stored, or is used more than once, with the nodes below that have
no other use. Statements of equal form that do not depend on each other are a loop; its
code does not grow with the number of members. The columns of the loop, each a variable,
a number or the place of a result, are tables, or progressions where the members are in
order. A long sum is a loop over its addends, from left to right. All other statements
remain straight-line code between the loops.

The operations and their order are those of straight-line code: values have equal bits.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, DATA, TRUTH
from lagsim.native.graph.lines import CIRCULAR, exponent_of, is_product, number
from lagsim.native.graph.writer import LONG, UNOPTIMISED, evaluation_order, is_long

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from lagsim.native.graph.writer import FunctionWriter, Place

# Least number of members of a loop, and of operations and stores that the loops of a
# function save: below these, straight-line code is as short.
LEAST, SAVED = 16, 100
# Largest part of the nodes that is straight-line code beside loops: values that pass
# between loops and code go through memory.
MOST_STRAIGHT = 0.25
_NUMBER = re.compile(r"\.\d+")
# Largest number of operations of a statement.
LONGEST = 64
# Operations whose operands may be exchanged without a change of bits.
_COMMUTING = ("add", "mul")
# Element of a form: the kind of a leaf, or an operation with its exponent.
Form = tuple[object, ...]


class Statement(NamedTuple):
    """A node with the nodes below that are evaluated together with it.

    Attributes
    ----------
    root : int
        The node whose value is stored.
    form : tuple
        The operations in postfix notation, with the kinds of the leaves.
    leaves : list of int
        The nodes whose values are read, in the order of the form.
    nodes : list of int
        The nodes that are evaluated; none for a copy of a value.
    places : sequence of place
        Places of the value, besides scratch memory.
    """

    root: int
    form: Form
    leaves: list[int]
    nodes: list[int]
    places: Sequence[Place]


class Repeated(NamedTuple):
    """Statements of equal form, which one loop evaluates.

    members : the statements, in the order in which the loop evaluates them.
    """

    members: list[Statement]

    @property
    def leaves(self) -> list[int]:
        """The nodes whose values the loop reads."""
        return [a for x in self.members for a in x.leaves]

    @property
    def made(self) -> list[int]:
        """The nodes whose values the loop stores."""
        return [x.root for x in self.members if x.nodes]


class LongSum(NamedTuple):
    """A long sum, from left to right.

    Attributes
    ----------
    first : int
        The first addend.
    addends, made : list of int
        The other addends, and the nodes of the sums up to each of these.
    """

    first: int
    addends: list[int]
    made: list[int]

    @property
    def leaves(self) -> list[int]:
        """The nodes whose values the sum reads."""
        return [self.first, *self.addends]


Step = list[int] | Repeated | LongSum


class LoopedFunction(NamedTuple):
    """A function in loops and straight-line code, in the order of evaluation.

    Attributes
    ----------
    steps : list
        Nodes of straight-line code; or a loop: `Repeated` or `LongSum`.
    kept : list of int
        Nodes whose values one step stores for others.
    at_end : mapping of node to list of place
        Places where straight-line code stores the values of nodes.
    """

    steps: list[Step]
    kept: list[int]
    at_end: Mapping[int, list[Place]]

    @property
    def straight(self) -> int:
        """Number of nodes of straight-line code."""
        return sum(len(x) for x in self.steps if isinstance(x, list))


class _Statements:
    """Statements and sums of a function of the graph g.

    Parameters
    ----------
    writer : FunctionWriter
        The graph, and the places of variables.
    order : sequence of int
        The nodes of the function in the order of evaluation.
    stores : sequence of (node, place)
        The results.
    places : mapping of node to place
        Nodes with values in memory.
    """

    def __init__(
        self,
        writer: FunctionWriter,
        order: Sequence[int],
        stores: Sequence[tuple[int, Place]],
        places: Mapping[int, Place],
    ) -> None:
        self.g, self.writer, self.order = writer.g, writer, order
        self.known, args, ops = places, self.g.args, self.g.ops
        self.evaluated = {n for n in order if args[n] and n not in places}
        own = [n for n in order if n in self.evaluated]
        self.uses = Counter(a for n in own for a in args[n])
        self.stored: dict[int, list[Place]] = {}
        for node, place in stores:
            self.stored.setdefault(node, []).append(place)
        self.sums = self._sums(own)
        self.totals = {n for x in self.sums for n in x.made}
        single = {n for x in self.sums for n in x.leaves}.union(self.stored)
        single.update(a for n in own if ops[n] in CIRCULAR for a in (n, *args[n]))
        sizes = dict[int, int]()
        self.roots = set[int]()
        for n in own:
            size = 1 + sum(sizes.get(a, 0) for a in args[n])
            if n in single or self.uses[n] > 1 or size > LONGEST:
                self.roots.add(n)
                size = 0
            sizes[n] = size
        self.roots -= self.totals
        self.inner = self.roots | self.totals
        self.all = [self._statement(n) for n in own if n in self.roots]
        self.all += [
            Statement(n, (self._kind(n),), [n], [], [place])
            for n, to in self.stored.items()
            for place in to
            if n not in self.roots
        ]

    def _sums(self, own: Sequence[int]) -> list[LongSum]:
        """Return all sums of more than LEAST addends.

        own : the nodes that are evaluated.
        """
        g, lengths = self.g, dict[int, int]()
        for n in own:
            if g.ops[n] == "add":
                lengths[n] = 1 + max(lengths.get(a, 0) for a in g.args[n])
        found, taken = list[LongSum](), set[int]()
        for top in sorted(lengths, key=lambda n: -lengths[n]):
            if lengths[top] < LEAST:
                break
            n, made, addends = top, list[int](), list[int]()
            while n in lengths and n not in taken:
                more, total = sorted(g.args[n], key=lambda a: lengths.get(a, 0))
                made.append(n)
                addends.append(more)
                n = total
            if len(made) >= LEAST:
                taken.update(made)
                found.append(LongSum(n, addends[::-1], made[::-1]))
        return found

    def _kind(self, n: int) -> object:
        """Return the kind of a value that a statement reads, for its `form`.

        Values of equal kinds are read by equal code: constants, or numbers of one
        array.
        """
        op = self.g.ops[n]
        if op == CONSTANT:
            return op
        if op in (TRUTH, DATA):
            return op, n
        if self.g.args[n] and OPERATIONS[op].condition:
            return TRUTH
        return self.array(n)

    def array(self, n: int) -> str:
        """Return the name of the array that has the value of node n; "t" for time."""
        if n in self.evaluated:
            return "p"
        if n in self.known:
            return self.known[n][0]
        return self.writer.place_of(n)[0]

    def _statement(self, root: int) -> Statement:
        form, leaves, nodes = self._read(root, top=True)
        return Statement(root, form, leaves, nodes, self.stored.get(root, ()))

    def _read(self, n: int, *, top: bool = False) -> tuple[Form, list[int], list[int]]:
        """Return form, leaves and nodes of the part of a statement below node n.

        top : whether n is the root of the statement, and so no leaf.
        """
        g = self.g
        if not top and (n not in self.evaluated or n in self.inner):
            return (self._kind(n),), [n], []
        exponent, own = exponent_of(g, n), g.args[n]
        own = own[:1] if is_product(exponent) else own
        parts = [self._read(a) for a in own]
        if g.ops[n] in _COMMUTING:
            parts.sort(key=lambda x: str(x[0]))
        form: Form = (*(x for part in parts for x in part[0]), (g.ops[n], exponent))
        leaves = [a for part in parts for a in part[1]]
        return form, leaves, [*(a for part in parts for a in part[2]), n]

    def levels(self) -> dict[int, int] | None:
        """Return the depth in statements of each stored node; None for a cycle.

        Stored are the roots of statements, and the nodes of long sums. There is a cycle
        if the addends of a sum depend on parts of the sum.
        """
        units = [([x.root], x.leaves) for x in self.all if x.nodes]
        units += [(x.made, x.leaves) for x in self.sums]
        home = {n: k for k, (made, _) in enumerate(units) for n in made}
        needs = [{home[a] for a in leaves if a in home} for _, leaves in units]
        users: list[list[int]] = [[] for _ in units]
        for k, below in enumerate(needs):
            for j in below:
                users[j].append(k)
        left, level = [len(below) for below in needs], [1] * len(units)
        ready = [k for k, count in enumerate(left) if not count]
        for k in ready:  # the list grows during the loop
            for j in users[k]:
                level[j] = max(level[j], level[k] + 1)
                left[j] -= 1
                if not left[j]:
                    ready.append(j)
        if len(ready) < len(units):
            return None
        return {n: level[k] for n, k in home.items()}

    def alike(self, levels: Mapping[int, int]) -> Iterator[list[Statement]]:
        """Yield statements of equal form, none of which depends on another.

        levels : see `levels`.
        """
        groups: dict[tuple[object, ...], list[Statement]] = {}
        for x in self.all:
            if x.nodes and self.g.ops[x.root] in CIRCULAR:
                continue
            used = bool(x.nodes) and self.uses[x.root] > 0
            level = max((levels.get(a, 0) for a in x.leaves), default=0)
            key = (x.form, level, used, tuple(array for array, _ in x.places))
            groups.setdefault(key, []).append(x)
        yield from (x for x in groups.values() if len(x) >= LEAST)


def largest_family(names: Iterable[str]) -> int:
    """Return the size of the largest set of names that differ in numbers only.

    Examples
    --------
    >>> from lagsim.native.graph.repeated import largest_family
    >>> largest_family(["x.1", "x_dot.1", "x.2", "x.3", "x_dot.2", "k"])
    3
    """
    stems = Counter(_NUMBER.sub(".", name) for name in names if "." in name)
    return max(stems.values(), default=0)


def division(
    writer: FunctionWriter,
    order: Sequence[int],
    stores: Sequence[tuple[int, Place]],
    places: Mapping[int, Place],
) -> LoopedFunction | None:
    """Return a function with loops; None if loops would save too little.

    Parameters
    ----------
    writer, order, stores, places
        See `_Statements`.
    """
    if len(order) + len(stores) < SAVED:
        return None
    found = _Statements(writer, order, stores, places)
    levels = found.levels()
    if levels is None:
        return None
    loops = list(found.alike(levels))
    saved = sum(len(x) * (len(x[0].nodes) + len(x[0].places)) for x in loops)
    if saved + sum(len(x.made) for x in found.sums) < SAVED:
        return None
    in_loops = {id(x) for members in loops for x in members}
    straight = [x for x in found.all if id(x) not in in_loops]
    steps = _steps(found, straight, [*map(Repeated, loops), *found.sums])
    written = sum(len(x) for x in steps if isinstance(x, list))
    if written > MOST_STRAIGHT * len(order):
        return None
    at_end: dict[int, list[Place]] = {}
    for x in straight:
        at_end.setdefault(x.root, []).extend(x.places)
    return LoopedFunction(steps, _kept(found, steps, at_end), at_end)


def _steps(
    found: _Statements,
    straight: Sequence[Statement],
    loops: Sequence[Repeated | LongSum],
) -> list[Step]:
    """Return all steps in order of evaluation.

    straight : the statements that belong to no loop.
    """
    done, steps = set[int](), list[Step]()
    waiting, left = [*loops], [*straight]

    def ready(leaves: Collection[int]) -> bool:
        return all(a in done or a not in found.inner for a in leaves)

    while waiting or left:
        nodes, rest = set[int](), list[Statement]()
        for x in left:
            if not ready(x.leaves):
                rest.append(x)
                continue
            nodes.update(x.nodes or [x.root])
            done.update(x.nodes)
        if nodes:
            steps.append([n for n in found.order if n in nodes])
        now = [x for x in waiting if ready(x.leaves)]
        assert now or len(rest) < len(left)
        for loop in now:
            done.update(loop.made)
        steps += now
        waiting = [x for x in waiting if x not in now]
        left = rest
    return steps


def _kept(
    found: _Statements, steps: Sequence[Step], at_end: Collection[int]
) -> list[int]:
    """Return the nodes whose values a step stores for others, side by side in loops.

    at_end : nodes that straight-line code stores as results.
    """
    args, inner = found.g.args, found.inner
    used, home = set[int](), dict[int, int]()
    for k, step in enumerate(steps):
        if isinstance(step, list):
            home |= {n: k for n in step if n in found.roots}
    for k, step in enumerate(steps):
        if isinstance(step, list):
            read = {a for n in step for a in args[n]}
            read.update(n for n in step if n in at_end and n in found.totals)
        else:
            read = {*step.leaves}
        used.update(a for a in read if a in inner and home.get(a) != k)
        if isinstance(step, Repeated):
            used.update(n for n in step.made if found.uses[n])
    for x in found.sums:
        used.update(x.made if not used.isdisjoint(x.made[:-1]) else x.made[-1:])
    kept = [n for x in found.sums for n in x.addends if n in used]
    kept += [n for x in steps if not isinstance(x, list) for n in x.made if n in used]
    return list(dict.fromkeys([*kept, *sorted(used)]))


def divides(writer: FunctionWriter, nodes: Sequence[int]) -> bool:
    """Whether loops evaluate most of the results `nodes` of a function."""
    stores = [(node, ("out", k)) for k, node in enumerate(nodes)]
    return (
        division(writer, evaluation_order(writer.g, nodes, {}), stores, {}) is not None
    )


def function(
    writer: FunctionWriter,
    name: str,
    stores: Sequence[tuple[int, Place]],
    places: Mapping[int, Place],
    *,
    cleared: int = 0,
    longest: int = LONG,
    together: int = 1,
) -> bool:
    """Write a function with loops; return whether loops save enough.

    Otherwise nothing is written.

    Parameters
    ----------
    writer : FunctionWriter
        Receives the code.
    name, stores, places, cleared, longest
        See `FunctionWriter.function`.
    together : int
        Number of members of a pass of a loop.
    """
    order = evaluation_order(writer.g, [node for node, _ in stores], places)
    divided = division(writer, order, stores, places)
    if divided is None:
        return False
    end = UNOPTIMISED if is_long(divided.straight, longest) else ") {"
    writer.lines.append(f"define void @{name}({writer.signature}{end}")
    writer.clear(cleared)
    kept: dict[int, Place] = {
        n: ("p", writer.scratch + k) for k, n in enumerate(divided.kept)
    }
    writer.scratch_used = max(writer.scratch_used, len(kept))
    looped = {n for x in divided.steps if not isinstance(x, list) for n in x.made}
    for step in divided.steps:
        if isinstance(step, list):
            here = kept.keys() & set(step) - looped
            passed = {n: kept[n][1] for n in here}
            before = {n: x for n, x in kept.items() if n not in passed}
            writer.piece(step, {**places, **before}, passed, divided.at_end)
        else:
            _write(writer, step, kept, places, together)
    writer.lines += ["ret void", "}"]
    return True


def _write(
    writer: FunctionWriter, step: Repeated | LongSum, kept: Mapping[int, Place],
    known: Mapping[int, Place], together: int,
) -> None:  # fmt: skip
    """Write the code of a loop.

    together : number of members of a pass.
    kept : places of the nodes whose values are passed from step to step.
    known : places of all nodes with values in memory.
    """
    places = {**known, **kept}
    if isinstance(step, LongSum):
        _write_sum(writer, step, kept, places)
        return
    members, first = step.members, step.members[0]
    columns = [[x.leaves[i] for x in members] for i in range(len(first.leaves))]
    targets = [[x.places[i] for x in members] for i in range(len(first.places))]
    if first.nodes and first.root in kept:
        targets.append([kept[x.root] for x in members])

    def member(k: str, more: int) -> None:
        stack, leaves = list[str](), iter(columns)
        for x in first.form:
            if isinstance(x, tuple) and len(x) == 2 and x[0] in OPERATIONS:
                op, exponent = x
                count = 1 if is_product(exponent) else OPERATIONS[op].arity
                operands = stack[len(stack) - count :]
                del stack[len(stack) - count :]
                stack.append(writer.operation(op, exponent, operands))
            else:
                stack.append(_value(writer, next(leaves), k, more, places))
        value = writer.as_number(first.root, stack.pop())
        for target in targets:
            writer.store_at(value, _address(writer, target, k, more))

    def several(k: str) -> None:
        for more in range(together):
            member(k, more)

    whole = len(members) - len(members) % together
    writer.loop(whole, several, together)
    for more in range(whole, len(members)):
        member("0", more)


def _write_sum(
    writer: FunctionWriter, of: LongSum, kept: Mapping[int, Place],
    places: Mapping[int, Place],
) -> None:  # fmt: skip
    """Write the code of a long sum; arguments as for `_write`."""
    stored = of.made[0] in kept
    at = writer.place_of

    def where(n: int) -> Place:
        return places[n] if n in places else at(n)

    runs: list[list[int]] = []
    kinds: list[str] = []
    for k, n in enumerate(of.addends):
        leaf = writer.g.ops[n] == CONSTANT and n not in places
        kind = "" if leaf else where(n)[0]
        if kind in ("y", "p") and kinds and kinds[-1] == kind:
            runs[-1].append(k)
        else:
            runs.append([k])
            kinds.append(kind)
    total = writer.leaf(of.first, places)
    for run, kind in zip(runs, kinds, strict=True):
        if kind in ("y", "p") and len(run) >= LEAST:
            nodes = [of.addends[k] for k in run]
            to = [kept[of.made[k]] for k in run] if stored else []
            total = _run(writer, total, [where(n) for n in nodes], to)
            continue
        for k in run:
            value = writer.leaf(of.addends[k], places)
            total = writer.operation("add", None, [total, value])
            if stored:
                writer.store(total, kept[of.made[k]])
    if not stored:
        writer.store(total, kept[of.made[-1]])


def _run(
    writer: FunctionWriter, total: str, addends: Sequence[Place], to: Sequence[Place]
) -> str:
    """Write a loop that adds numbers in memory to a total; return the sum's name.

    to : the places of all sums; none if these are not stored.
    """

    def added(k: str, before: str) -> str:
        value = writer.line(f"load double, ptr {_address(writer, addends, k)}")
        after = writer.operation("add", None, [before, value])
        if to:
            writer.store_at(after, _address(writer, to, k))
        return after

    return writer.loop_with(len(addends), total, added)


def _value(
    writer: FunctionWriter, nodes: Sequence[int], k: str, more: int,
    places: Mapping[int, Place],
) -> str:  # fmt: skip
    """Write code for the value that member k + more reads; return the value's name.

    nodes : the node of each member.
    """
    g, n = writer.g, nodes[0]
    if n not in places:
        if g.ops[n] == CONSTANT:
            numbers = np.array([g.payload(a) for a in nodes], float)
            if len({number(x) for x in numbers}) == 1:
                return number(float(numbers[0]))
            table = writer.constant(numbers.tobytes())
            place = _element(writer, "double", table, k, more)
            return writer.line(f"load double, ptr {place}")
        if g.ops[n] in (TRUTH, DATA) or g.payload(n) == "t":
            return writer.leaf(n, places)
    where = [places[a] if a in places else writer.place_of(a) for a in nodes]
    value = writer.line(f"load double, ptr {_address(writer, where, k, more)}")
    return writer.as_operand(n, value)


def _element(writer: FunctionWriter, kind: str, table: str, k: str, more: int) -> str:
    """Write code for the address of element k + more of a table; return its name."""
    if more:
        table = writer.line(f"getelementptr {kind}, ptr {table}, i64 {more}")
    return writer.line(f"getelementptr {kind}, ptr {table}, i64 {k}")


def _address(
    writer: FunctionWriter, where: Sequence[Place], k: str, more: int = 0
) -> str:
    """Write code for the address of member k + more; return the address's name.

    where : the place of each member, all in one array.
    """
    array, first = where[0]
    indices = np.array([i for _, i in where])
    step = int(indices[1] - indices[0])
    if (np.diff(indices) == step).all():
        if step == 0:
            return writer.address((array, first))
        shift = k if step == 1 else writer.line(f"mul i64 {k}, {step}")
        begin = writer.address((array, first + more * step))
        return writer.line(f"getelementptr inbounds double, ptr {begin}, i64 {shift}")
    table = writer.constant(indices.astype(np.int32).tobytes())
    place = _element(writer, "i32", table, k, more)
    index = writer.line(f"load i32, ptr {place}")
    wide = writer.line(f"sext i32 {index} to i64")
    return writer.line(f"getelementptr inbounds double, ptr %{array}, i64 {wide}")
