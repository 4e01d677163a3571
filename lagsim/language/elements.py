"""Sums of members of one form, as single operations of the graph.

A sum such as `sum(i, sum(j = i+1..n, m(i)*m(j)/r))` has as many terms as there are
pairs, and one form. Its members are a table; its term is one expression of a few local
variables, the *slots*, in a small graph of its own. The node `elements.sums` computes
all sums at once as a vector, from the arguments that the slots of the members read;
`elements.part` selects one of its numbers. Derivatives, roundoff bounds and sizes of
terms are elements as well: they are derived once, for the term, and share the table.

An `ElementOutput` of the term is added up at a place of the vector: at the first place
(an energy), at the place of the argument that a slot reads (a force), or each member
has a place of its own (an activity indicator).
"""

from __future__ import annotations

import hashlib
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import addends, roundings
from lagsim.language.functions import ELEMENTS, OPERATIONS, PART
from lagsim.language.graph import memoized

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from lagsim.language.arrays import Floats, Ints
    from lagsim.language.graph import Graph

# Sums of fewer members are written out, and definitions of fewer members per argument:
# the cost of all else then grows as fast. With LEAST members an evaluation takes 0.9 to
# 1.1 times as long as compiled code or a tape; deriving and compiling, 0.2 to 0.9.
LEAST, PER_ARGUMENT = 400, 4
# Places of outputs that no slot determines.
TOTAL, EACH = -1, -2
# Column of slots that are equal for all members.
SHARED = -1


class Slot(NamedTuple):
    """Local variable of a term; its value is an argument or a number for each member.

    Attributes
    ----------
    node : int
        The variable, in the graph of the term.
    column : int
        Column of the table with the index of each member's entry in `places` or
        `numbers`; SHARED if all members have one value.
    places : ndarray, shape (positions,)
        Index of the argument at each position; empty for numbers.
    numbers : ndarray, shape (positions,)
        The number at each position; empty for arguments.
    rule : object
        The expression of indices whose values are `numbers`, as parsed; None for
        arguments.
    """

    node: int
    column: int
    places: Ints
    numbers: Floats
    rule: Any = None


class ElementOutput(NamedTuple):
    """Expression that each member adds to one component of the vector of sums.

    Attributes
    ----------
    node : int
        The expression, in the graph of the term.
    slot : int
        The component: that of the argument which the slot with this index reads in the
        member; TOTAL: component 0, for all members; EACH: the member's number.
    error : int or None
        In elements that bound roundoff: the node of a bound of the expression's error;
        else None.
    """

    node: int
    slot: int
    error: int | None = None


_NOWHERE, _NONE = np.zeros(0, np.int64), np.zeros(0)


class Elements:
    """All members of a sum that differ in variables and numbers only, as a table.

    It is the payload of a leaf, which is the first argument of a node `elements.sums`.

    Attributes
    ----------
    graph : Graph
        Graph of the term.
    slots : tuple of Slot
    outputs : tuple of ElementOutput
    table : ndarray, shape (members, columns)
        For each member and column, the position in `Slot.places` or `Slot.numbers`.
    count : int
        Number of arguments.
    size : int
        Length of the vector of sums.
    example : object
        The term of one member as parsed, for checks of its units.
    indices : dict
        For each index of the sum, outer ones first, its value in each member,
        (members,); it serves for showing the sum to people.
    """

    def __init__(
        self,
        graph: Graph,
        slots: Sequence[Slot],
        outputs: Sequence[ElementOutput],
        table: Ints,
        count: int,
        size: int,
        example: Any = None,
        indices: Mapping[str, Ints] | None = None,
    ) -> None:
        self.graph, self.table = graph, table
        self.indices = dict(indices or {})
        self.slots, self.outputs = tuple(slots), tuple(outputs)
        self.count, self.size, self.example = count, size, example
        self._derived: dict[Any, Elements] = {}

    name = "elements"

    @cached_property
    def digest(self) -> str:
        """Digest of all data that determine the values of the sums."""
        g, cone = self.graph, self.cone
        place = {n: k for k, n in enumerate(cone)}
        variables = {slot.node: k for k, slot in enumerate(self.slots)}
        terms = [
            (g.ops[n], [place[a] for a in g.args[n]])
            if g.args[n]
            else variables.get(n, g.value(n) if n not in variables else None)
            for n in cone
        ]
        results = [(place[n], slot, place.get(e, -1)) for n, slot, e in self._results]
        parts = [repr((terms, results, self.count, self.size, self.table.shape))]
        digest = hashlib.sha256("".join(parts).encode())
        digest.update(self.table.tobytes())
        for slot in self.slots:
            digest.update(repr((slot.column, place.get(slot.node))).encode())
            digest.update(slot.places.tobytes() + slot.numbers.tobytes())
        return digest.hexdigest()

    @property
    def _results(self) -> list[tuple[int, int, int]]:
        none = -1
        return [
            (o.node, o.slot, none if o.error is None else o.error) for o in self.outputs
        ]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Elements) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        return f"{self.name}.{self.digest}"

    @cached_property
    def cone(self) -> list[int]:
        """Nodes of the outputs and their arguments, each after its arguments."""
        nodes = [o.node for o in self.outputs]
        nodes += [o.error for o in self.outputs if o.error is not None]
        return self.graph.cone(nodes)

    @property
    def members(self) -> int:
        """Number of members."""
        return len(self.table)

    @cached_property
    def filled(self) -> list[int]:
        """Indices, ascending, of the components of the vector that slots determine.

        Other components are 0, or belong to outputs with TOTAL or EACH.
        """
        slots = (self.slots[o.slot] for o in self.outputs if o.slot >= 0)
        return sorted({k for slot in slots for k in slot.places.tolist()})

    @cached_property
    def alone(self) -> list[bool]:
        """Whether each component of an output has one addend, from a single member.

        Then no sum is rounded.
        """
        where = [self.targets(o) for o in self.outputs]
        counts = np.zeros(self.size, np.int64)
        for x in where:
            counts += np.bincount(x, minlength=self.size)
        return [bool(np.all(counts[x] == 1)) for x in where]

    @property
    def bounds(self) -> bool:
        """Whether the results are bounds of the roundoff of sums."""
        return any(o.error is not None for o in self.outputs)

    @property
    def cost(self) -> int:
        """Cost of an evaluation in additions."""
        g = self.graph
        rows = (OPERATIONS.get(g.ops[n]) for n in self.cone)
        return self.members * sum(row.cost for row in rows if row is not None)

    @property
    def operations(self) -> int:
        """Number of operations of the terms of all members."""
        own = [n for n in self.cone if self.graph.args[n]]
        return self.members * len(own)

    @property
    def couples_most(self) -> bool:
        """Whether most pairs of arguments occur together in a member's term."""
        coupled = np.zeros((self.count, self.count), bool)
        read = [x for x in self.slots if len(x.places) and x.column != SHARED]
        for one in read:
            for other in read:
                rows = one.places[self.table[:, one.column]]
                coupled[rows, other.places[self.table[:, other.column]]] = True
        return bool(np.count_nonzero(coupled) > 0.5 * coupled.size)

    def _with(
        self, outputs: Iterable[ElementOutput], size: int, more: Sequence[Slot] = ()
    ) -> Elements:
        """Return elements with the members of these, but other outputs.

        outputs : the outputs.
        size : length of their vector of sums.
        more : further slots that outputs use, whose arguments follow the arguments of
            these elements.
        """
        outputs = list(outputs)
        slots = [*self.slots, *more]
        nodes = [o.node for o in outputs]
        nodes += [o.error for o in outputs if o.error is not None]
        used = set(self.graph.cone(nodes))
        kept = [
            k for k, slot in enumerate(slots)
            if slot.node in used or any(o.slot == k for o in outputs)
        ]  # fmt: skip
        new = {k: i for i, k in enumerate(kept)}
        outputs = [o._replace(slot=new.get(o.slot, o.slot)) for o in outputs]
        count = 1 + max(
            (int(slots[k].places.max(initial=-1)) for k in kept), default=-1
        )
        count = max(count, self.count)
        return Elements(
            self.graph, [slots[k] for k in kept], outputs, self.table, count, size,
            indices=self.indices,
        )  # fmt: skip

    def _second_slot(self, word: str, slot: Slot) -> Slot:
        """Return a slot for a second quantity of the argument that `slot` reads.

        Each argument of the elements has such a quantity, for example its rate. These
        are further arguments, which follow the others in the same order.

        word : name of the quantity, such as `rate`.
        """
        name = f"{self.graph.payload(slot.node)}.{word}"
        return slot._replace(
            node=self.graph.variable(name), places=self.count + slot.places
        )

    def reads(self, slot: Slot, indices: Collection[int]) -> bool:
        """Whether a slot reads one of the arguments at `indices`."""
        return not set(slot.places.tolist()).isdisjoint(indices)

    # Elements derived from these

    def derived(self, method: str, *how: frozenset[int]) -> Elements:
        """Return `method(*how)`, further elements; memoized.

        method : name of a method, such as `slopes`.
        how : its arguments.
        """
        if (method, how) not in self._derived:
            self._derived[method, how] = getattr(self, method)(*how)
        return self._derived[method, how]

    def slopes(self, indices: Collection[int]) -> Elements:
        """Return elements for the gradient of the sum of all terms.

        The elements must have this sum as their only result (size 1), as an energy has.
        Component k of the gradient, (count,), is the derivative by argument k.

        indices : indices of the arguments by which the sum is differentiated.
        """
        assert self.size == 1
        return self._with(
            self._slopes([o.node for o in self.outputs], indices), self.count
        )

    def pulled(self, indices: Collection[int]) -> Elements:
        """Return elements for the gradient of the sum of weight_i * result_i over i.

        The weights, one for each component of the vector of sums, are further
        arguments. Component k of the result, (count,), is the derivative by argument k.

        indices : indices of the arguments by which it is differentiated.
        """
        g, more, terms = self.graph, list[Slot](), []
        for o in self.outputs:
            own = self.slots[o.slot] if o.slot >= 0 else None
            if own is None:
                node = g.variable("total.weight")
                where = np.array([self.count])
                own = Slot(node, SHARED, where, _NONE)
            else:
                own = self._second_slot("weight", own)
            more.append(own)
            terms.append(g.call("mul", own.node, o.node))
        return self._with(self._slopes(terms, indices), self.count, more)

    def _slopes(
        self, nodes: Sequence[int], indices: Collection[int]
    ) -> list[ElementOutput]:
        g, total = self.graph, self.graph.sum(nodes)
        read = [k for k, slot in enumerate(self.slots) if self.reads(slot, indices)]
        found = gradient(g, total, [self.slots[k].node for k in read])
        pairs = zip(found, read, strict=True)
        return [ElementOutput(node, k) for node, k in pairs if node != g.zero]

    def pushed(self, indices: Collection[int]) -> Elements:
        """Return elements for the time derivatives of the results.

        The rates of all arguments are further arguments.

        indices : indices of the arguments that vary.
        """
        g, read = self.graph, [x for x in self.slots if self.reads(x, indices)]
        more = [self._second_slot("rate", slot) for slot in read]
        seed = {slot.node: rate.node for slot, rate in zip(read, more, strict=True)}
        rates = tangent(g, [o.node for o in self.outputs], seed)
        outputs = (o._replace(node=n) for o, n in zip(self.outputs, rates, strict=True))
        return self._with([o for o in outputs if o.node != g.zero], self.size, more)

    def bounded(self, moving: Collection[int], state: Collection[int]) -> Elements:
        """Return elements for roundoff bounds of the results, in units of the roundoff.

        Bounds of the errors of all arguments are further arguments of the result.

        moving : indices of the arguments that vary.
        state : indices of arguments whose own roundoff is accounted for elsewhere, see
            `evaluate.roundings`.
        """
        g = self.graph
        varying = [x for x in self.slots if self.reads(x, moving)]
        names = [str(g.payload(x.node)) for x in varying]
        of_state = [x for x in varying if set(x.places.tolist()).issubset(state)]
        others = [x for x in varying if x not in of_state]
        more = [self._second_slot("error", x) for x in others]
        known = {x.node: e.node for x, e in zip(others, more, strict=True)}
        own = [str(g.payload(x.node)) for x in of_state]
        nodes = [o.node for o in self.outputs]
        errors = roundings(g, nodes, names, own, known)
        outputs = [
            o._replace(error=e) for o, e in zip(self.outputs, errors, strict=True)
        ]
        return self._with(outputs, self.size, more)

    def magnitudes(self) -> Elements:
        """Return elements whose results are, for each result, the sum of |addend|.

        The addends are those of all members' terms, see `evaluate.addends`.
        """
        g, outputs = self.graph, []
        for o in self.outputs:
            node = g.sum(g.call("abs", n) for n in addends(g, o.node))
            outputs.append(o._replace(node=node))
        return self._with(outputs, self.size)

    def listed(self, node: int) -> Elements:
        """Return elements whose results (members,) are a node's value in each member.

        node : an expression in the graph of the term.
        """
        return self._with([ElementOutput(node, EACH)], self.members)

    def without_value(self, arguments: Sequence[float]) -> int | None:
        """Return the first member with a term or slope that is not finite; else None.

        All outputs of the elements must be TOTAL.

        arguments : values of the arguments.
        """
        everything = frozenset(range(self.count))
        for of in (self, self.derived("slopes", everything)):
            for o in of.outputs:
                finite = np.isfinite(of.listed(o.node).evaluate(arguments))
                if not finite.all():
                    return int(np.argmin(finite))
        return None

    # On the graph of a model

    def written(self, g: Graph, arguments: Sequence[int], member: int) -> int:
        """Return the node, in the graph g, of the term of one member.

        arguments : nodes of the arguments.
        """
        found: dict[int, int] = {}
        for slot in self.slots:
            k = 0 if slot.column == SHARED else int(self.table[member, slot.column])
            if len(slot.numbers):
                found[slot.node] = g.constant(float(slot.numbers[k]))
            else:
                found[slot.node] = arguments[int(slot.places[k])]
        own = self.graph
        for n in self.cone:
            if n not in found:
                args = own.args[n]
                found[n] = (
                    g.call(own.ops[n], *(found[a] for a in args))
                    if args
                    else g.constant(float(own.payload(n)))
                )
        return found[self.outputs[0].node]

    def pull(
        self, g: Graph, vector: int, weights: dict[int, int], active: Collection[int]
    ) -> list[tuple[int, int]]:
        """Return the contributions of a vector of sums to adjoints of its arguments.

        Each is a pair of nodes: an argument, and the contribution to its adjoint
        (reverse differentiation).

        vector : node of the vector in g.
        weights : index of a component of the vector -> its adjoint.
        active : nodes that vary.
        """
        args = g.args[vector][1:]
        indices = _where(args, active)
        weight = weights.get(0, g.zero)
        # A weight that varies is a factor of each term, as if the terms were written
        # out.
        if self.size == 1 and set(active).isdisjoint(g.cone([weight])):
            derived = self.derived("slopes", indices)
            found = sums(g, derived, args)
            return [
                (args[k], g.call("mul", weight, part(g, found, k)))
                for k in derived.filled
                if k in indices
            ]
        derived = self.derived("pulled", indices)
        found = sums(g, derived, [*args, *_each(g, range(self.size), weights)])
        return [(args[k], part(g, found, k)) for k in derived.filled if k in indices]

    def push(self, g: Graph, vector: int, rates: Mapping[int, int]) -> int:
        """Return the node of the time derivative of a vector of these sums.

        vector : node of the vector in g.
        rates : node of an argument -> node of its rate.
        """
        args = g.args[vector][1:]
        made = self.derived("pushed", _where(args, rates))
        return sums(g, made, [*args, *_each(g, args, rates)])

    def bound(
        self,
        g: Graph,
        vector: int,
        varying: Collection[int],
        state: Collection[int],
        errors: Mapping[int, int],
    ) -> int:
        """Return the node of the roundoff bounds of a vector of these sums.

        vector : node of the vector in g.
        varying : nodes that vary.
        state : nodes of variables whose own roundoff is accounted for elsewhere.
        errors : node of an argument -> node of the bound of its error.
        """
        args = g.args[vector][1:]
        made = self.derived("bounded", _where(args, varying), _where(args, state))
        return sums(g, made, [*args, *_each(g, args, errors)])

    # Values

    def targets(self, output: ElementOutput) -> Ints:
        """Return the component to which each member adds an output, (members,)."""
        if output.slot == EACH:
            return np.arange(self.members)
        if output.slot == TOTAL:
            return np.zeros(self.members, np.int64)
        slot = self.slots[output.slot]
        if slot.column == SHARED:
            return np.full(self.members, slot.places[0])
        return np.asarray(slot.places[self.table[:, slot.column]])

    def evaluate(self, arguments: Sequence[float]) -> Floats:
        """Return the results (size,) at the values of the arguments."""
        z = np.array(arguments, dtype=float)
        found: dict[int, Any] = {}
        for slot in self.slots:
            own = slot.numbers if len(slot.numbers) else z[slot.places]
            column = slot.column
            found[slot.node] = (
                own[0] if column == SHARED else own[self.table[:, column]]
            )
        g = self.graph
        with np.errstate(all="ignore"):
            for n in self.cone:
                if n in found:
                    continue
                args = [found[a] for a in g.args[n]]
                found[n] = value_of(g.ops[n], args) if args else g.payload(n)
            sums, bounds = np.zeros(self.size), np.zeros(self.size)
            for o, alone in zip(self.outputs, self.alone, strict=True):
                where = self.targets(o)
                terms = np.broadcast_to(found[o.node], where.shape)
                sums += np.bincount(where, terms, self.size)
                if o.error is not None:
                    error = np.broadcast_to(found[o.error], where.shape)
                    bounds += np.bincount(where, error, self.size)
                if o.error is not None and not alone:
                    bounds += np.bincount(where, _partial_sums(where, terms), self.size)
        return bounds if self.bounds else sums

    def evaluate_with_error(
        self, arguments: Sequence[tuple[float, float]], unit: float
    ) -> tuple[Floats, Floats]:
        """Return the results (size,), and bounds of their errors.

        arguments : values with errors.
        unit : error of an operation, relative to its result.
        """
        everything = frozenset(range(self.count))
        made = self.derived("bounded", everything, frozenset())
        numbers, errors = [x for x, _ in arguments], [e / unit for _, e in arguments]
        return self.evaluate(numbers), unit * made.evaluate([*numbers, *errors])


def _partial_sums(where: Ints, terms: Floats) -> Floats:
    """Return the magnitude of the running sum at each term, shape (members,).

    where : (members,), the component to which each term is added; the running sum is
        that of the component.
    terms : (members,), added in the order of members.
    """
    order = np.argsort(where, kind="stable")
    running = np.cumsum(terms[order])
    first = np.flatnonzero(np.diff(where[order], prepend=-1))
    before = np.concatenate([[0.0], running])[first]
    lengths = np.diff(first, append=len(where))
    found = np.empty(len(where))
    found[order] = np.abs(running - np.repeat(before, lengths))
    return found


_BY_ARRAYS: dict[str, Any] = {
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide,
    "neg": np.negative, "sqrt": np.sqrt, "abs": np.abs, "sin": np.sin, "cos": np.cos,
    "exp": np.exp, "log": np.log, "lt": np.less, "le": np.less_equal, "gt": np.greater,
    "ge": np.greater_equal, "pow": np.power, "if": np.where,
}  # fmt: skip


def value_of(op: str, args: Sequence[Any]) -> Any:
    """Return the value of the operation `op` on arrays, element by element."""
    rule = _BY_ARRAYS.get(op)
    if rule is None:
        row = OPERATIONS[op]
        rule = np.vectorize(row.__call__, otypes=[bool if row.condition else float])
    return rule(*map(np.asarray, args))


# On the graph


def payload(g: Graph, node: int) -> Elements:
    """Return the Elements whose sums a node `elements.sums` computes."""
    found: Elements = g.payload(g.args[node][0])
    return found


def sums(g: Graph, elements: Elements, arguments: Sequence[int]) -> int:
    """Return the node of the vector of the sums of `elements`.

    arguments : nodes of the arguments, at least as many as the elements read.
    """
    return g.unsimplified(ELEMENTS, (g.data(elements), *arguments[: elements.count]))


def part(g: Graph, vector: int, k: int) -> int:
    """Return the node of component k of the node `vector`, a vector of sums."""
    return g.unsimplified(PART, (vector, g.constant(float(k))))


def gathered(g: Graph) -> bool:
    """Whether a graph contains a node `elements.sums`."""
    return bool(g.of((ELEMENTS,)))


def _where(args: Sequence[int], nodes: Collection[int]) -> frozenset[int]:
    """Return the indices of the arguments that are in `nodes`."""
    return frozenset(k for k, a in enumerate(args) if a in nodes)


def _each(g: Graph, keys: Iterable[int], known: Mapping[int, int]) -> list[int]:
    return [known.get(k, g.zero) for k in keys]


def sizes(g: Graph, node: int) -> int:
    """Return the node of the sum of |terms| of one sum of elements.

    node : the sum, a node of the operation `elements.part`.
    """
    vector, k = g.args[node]
    return part(g, _magnitudes(g, vector), int(g.value(k) or 0.0))


@memoized
def _magnitudes(g: Graph, vector: int) -> int:
    """Return the node of the vector of the sums of |terms| of the node `vector`."""
    made = payload(g, vector).derived("magnitudes")
    return sums(g, made, g.args[vector][1:])
