"""Writer of functions of graph nodes as straight-line LLVM IR."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, DATA, TRUTH, VARIABLE
from lagsim.native.graph import keys
from lagsim.native.graph.lines import (
    CIRCULAR,
    CLEAR,
    LANES,
    Lines,
    clearing,
    exponent_of,
    number,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Layout


# Number of sums computed at a time; their count is padded to a multiple.
TOGETHER = 8
SUMS = f"<{TOGETHER} x double>"
# The sums and rows begin where lines of the cache do.
LINE_BYTES = 64

# Functions of more pieces are compiled without optimisation: in less than half the
# time, and they run 5 % longer (40 links; an arm of seven joints).
LONG = 6
# LLVM's scheduler compares each access to memory with all others of its stretch: in
# stretches of 100 accesses, a function of thousands compiles in a quarter of the time.
ACCESSES = 100
# No instruction; the scheduler moves no access past it.
END_OF_STRETCH = 'call void asm sideeffect "", ""()'
# Place of a value in memory: the name of an array, and an index in it.
Place = tuple[str, int]
NOTHING: Mapping[int, int] = MappingProxyType({})


def evaluation_order(
    g: Graph, roots: Collection[int], places: Mapping[int, object]
) -> list[int]:
    """Return the nodes to evaluate for `roots`, in order, except nodes in `places`.

    Sines and cosines come early and side by side: first the functions of angles that
    depend on no sine or cosine, then the functions of angles that depend on the first.

    places : nodes with values in memory.
    """
    order = g.cone(roots, places)
    depth: dict[int, int] = {}  # others depend on no sine or cosine
    rounds: dict[int, list[int]] = {}
    for n in order:
        waits = 0 if n in places else max([depth.get(a, 0) for a in g.args[n]] or (0,))
        if g.ops[n] in CIRCULAR and n not in places:
            waits += 1
            rounds.setdefault(waits, []).append(n)
        if waits:
            depth[n] = waits
    sorted_: dict[int, None] = {}
    for k in sorted(rounds):
        angles = [g.args[n][0] for n in rounds[k]]
        sorted_ |= dict.fromkeys(g.cone(angles, {**places, **sorted_}))
        sorted_ |= dict.fromkeys(rounds[k])
    return list(sorted_ | dict.fromkeys(order))


def _piece(count: int) -> int:
    """Return the length of the pieces of a function of `count` nodes.

    Pieces are of equal lengths: a short last one would cost a call for few operations.
    """
    if count <= keys.WHOLE:
        return max(1, count)
    return -(-count // -(-count // keys.PIECE))


class FunctionWriter(Lines):
    """Writer of the IR of one function, or of the pieces of a long one.

    A place of a value is a pair: the name of an array, such as "p" or "out", and the
    index in this array.

    Attributes
    ----------
    signature : str
        Parameters of the function.
    scratch, scratch_used : int
        First index of scratch memory in p, and its length so far.
    """

    signature = "double %t, ptr %y, ptr %p, ptr %out"

    def __init__(
        self, g: Graph, layout: Layout, scratch: int, *, contract: bool = False
    ) -> None:
        super().__init__(contract=contract)
        self.g, self.layout = g, layout
        self.scratch, self.scratch_used = scratch, 0
        self._accesses = 0

    def function(
        self,
        name: str,
        stores: Sequence[tuple[int, Place]],
        places: Mapping[int, Place],
        *,
        more: str = "",
        linkage: str = "",
        cleared: int = 0,
        longest: int = LONG,
        first: Sequence[str] = (),
        vectors: Sequence[tuple[Sequence[int], Place]] = (),
    ) -> None:
        """Write the function `name`.

        Parameters
        ----------
        stores : sequence of (node, place)
            Nodes to evaluate, each with the place where its value is stored.
        places : mapping of node to place
            Nodes that are not evaluated, with the places of their values.
        more : str
            Parameters in addition to the signature.
        linkage : str
            LLVM's linkage of the function.
        cleared : int
            This many numbers of `out` are set to 0 before any value is stored.
        longest : int
            Number of pieces (of PIECE nodes) from which on a function is compiled
            without optimisation; up to WHOLE nodes it is always optimised.
        first : sequence of str
            Functions that are called first.
        vectors : sequence of (nodes, place)
            Nodes whose values are stored side by side, as one vector of TOGETHER, with
            zeros behind. A later load of the vector then need not wait for its parts.
        """
        signature = self.signature + more
        roots = [node for node, _ in stores]
        roots += [node for nodes, _ in vectors for node in nodes]
        order = evaluation_order(self.g, roots, places)
        length, end = _piece(len(order)), ") {"
        if len(order) > max(longest * keys.PIECE, keys.WHOLE):
            length, end = -(-keys.PIECE // 2), ") noinline optnone {"
        pieces = [order[i : i + length] for i in range(0, len(order), length)] or [[]]
        at_end: dict[int, list[Place]] = {}
        for node, place in stores:
            at_end.setdefault(node, []).append(place)
        home = {n: i for i, piece in enumerate(pieces) for n in piece}
        whole: list[list[tuple[Sequence[int], Place]]] = [[] for _ in pieces]
        for nodes, (array, k) in vectors:
            homes = {home[n] for n in nodes}
            if len(homes) == 1:
                whole[homes.pop()].append((nodes, (array, k)))
                continue
            for lane, node in enumerate(nodes):
                at_end.setdefault(node, []).append((array, k + lane))
        passed = self._passed(pieces, places)
        alone = len(pieces) == 1 and not first
        names = [name] if alone else [f"{name}.{i}" for i in range(len(pieces))]
        for piece_name, piece, side in zip(names, pieces, whole, strict=True):
            kind = linkage if piece_name == name else "internal "
            self.lines.append(f"define {kind}void @{piece_name}({signature}{end}")
            self._accesses = 0
            if alone:
                self._clear(cleared)
            self._piece(piece, places, passed, at_end, side)
            self.lines += ["ret void", "}"]
        if not alone:
            self.lines.append(f"define {linkage}void @{name}({signature}) {{")
            self._clear(cleared)
            self.lines += [f"call void @{p}({signature})" for p in (*first, *names)]
            self.lines += ["ret void", "}"]

    def values(
        self,
        stores: Sequence[tuple[int, Place]],
        nodes: Sequence[int],
        places: Mapping[int, Place],
    ) -> dict[int, str]:
        """Write the evaluation of graph nodes; return the name of each value, by node.

        stores : pairs of a node and the place where its value is stored.
        nodes : more nodes, whose values are not stored.
        places : nodes that are not evaluated, with the places of their values.
        """
        at_end: dict[int, list[Place]] = {}
        for node, place in stores:
            at_end.setdefault(node, []).append(place)
        order = evaluation_order(self.g, [*at_end, *nodes], places)
        return self._piece(order, places, NOTHING, at_end)

    def _clear(self, count: int) -> None:
        if count:
            self.declared.add(CLEAR)
            self.lines.append(clearing(count))

    def _passed(
        self, pieces: Sequence[Sequence[int]], places: Mapping[int, Place]
    ) -> dict[int, int]:
        """Return node -> index in p, for values that one piece passes to a later one.

        pieces : the nodes of each piece of a function.
        places : nodes with values in memory already.
        """
        home = {n: i for i, piece in enumerate(pieces) for n in piece}
        passed: dict[int, int] = {}
        for i, piece in enumerate(pieces):
            for n in piece:
                for a in self.g.args[n] if n not in places else ():
                    earlier = home.get(a, i) < i and a not in places
                    if earlier and self.g.args[a] and a not in passed:
                        passed[a] = self.scratch + len(passed)
        self.scratch_used = max(self.scratch_used, len(passed))
        return passed

    def _piece(
        self,
        piece: Sequence[int],
        places: Mapping[int, Place],
        passed: Mapping[int, int],
        at_end: Mapping[int, Sequence[Place]],
        vectors: Sequence[tuple[Sequence[int], Place]] = (),
    ) -> dict[int, str]:
        """Write the evaluation of one piece of a function; return value names by node.

        Parameters
        ----------
        piece : sequence of node
            The nodes to evaluate, in this order.
        places : mapping of node to place
            Nodes that are not evaluated, with the places of their values.
        passed : mapping of node to int
            Nodes whose values one piece stores for later ones, with the index in p.
        at_end : mapping of node to sequence of place
            Places where the value of a node of this piece is stored.
        vectors : sequence of (nodes, place)
            See `function`.
        """
        here: dict[int, str] = {}

        def operand(n: int) -> str:
            if n not in here:
                here[n] = self.leaf(n, places, passed)
            return here[n]

        for at, n in enumerate(piece):
            if self.g.args[n] and n not in places:
                if self.g.ops[n] in CIRCULAR and n not in here:
                    self._circular(piece[at:], places, here, operand)
                elif n not in here:
                    operands = [operand(a) for a in self.g.args[n]]
                    exponent = exponent_of(self.g, n)
                    here[n] = self.operation(self.g.ops[n], exponent, operands)
                if n in passed:
                    self.store(self._number(n, here[n]), ("p", passed[n]))
            for place in at_end.get(n, ()):
                self.store(self._number(n, operand(n)), place)
        for nodes, place in vectors:
            self._vector([self._number(n, operand(n)) for n in nodes], place)
        return here

    def _circular(
        self,
        nodes: Sequence[int],
        places: Mapping[int, Place],
        here: dict[int, str],
        operand: Callable[[int], str],
    ) -> None:
        """Write sines and cosines of up to LANES angles side by side.

        The nodes of these sines and cosines are the first ones of `nodes`.

        here : node -> name of its value; extended by the sines and cosines.
        operand : function that returns the name of the value of a node.
        places : nodes with values in memory, see `function`.
        """
        g = self.g
        together: list[int] = []
        angles: dict[int, int] = {}
        for n in nodes:
            done = n in places or g.ops[n] not in CIRCULAR
            if done or g.args[n][0] in together:
                break
            angle = g.args[n][0]
            if angle not in angles and len(angles) == LANES:
                break
            angles.setdefault(angle, len(angles))
            together.append(n)
        outputs = [(g.ops[n], angles[g.args[n][0]]) for n in together]
        values = self.circular([operand(angle) for angle in angles], outputs)
        here.update(zip(together, values, strict=True))

    def leaf(
        self,
        n: int,
        places: Mapping[int, Place],
        passed: Mapping[int, int] = NOTHING,
    ) -> str:
        """Return the name of the value of node n that no operation computes here.

        n is a constant, a variable, or has a value in memory, which is loaded.

        places : nodes with the places of their values.
        passed : node -> index in p, of values that earlier pieces have stored.
        """
        g = self.g
        if g.ops[n] == CONSTANT:
            x = g.value(n)
            assert x is not None
            return number(x)
        if g.ops[n] == TRUTH:
            return "true" if g.payload(n) else "false"
        if g.ops[n] == DATA:
            return self.data(g.payload(n))
        if n in places:
            value = self.load(places[n])
        elif g.ops[n] == VARIABLE:
            return self._variable(str(g.payload(n)))
        else:
            value = self.load(("p", passed[n]))
        if g.args[n] and OPERATIONS[g.ops[n]].condition:
            return self.line(f"fcmp one double {value}, {number(0.0)}")
        return value

    def _variable(self, name: str) -> str:
        if name == "t":
            return "%t"
        if name in self.layout.y:
            return self.load(("y", self.layout.y[name]))
        return self.load(("p", self.layout.p[name]))

    def _number(self, n: int, value: str) -> str:
        """Return the name of `value` as a double: 1 or 0 if n is a truth value."""
        if self.g.args[n] and OPERATIONS[self.g.ops[n]].condition:
            return self.line(f"uitofp i1 {value} to double")
        return value

    def _vector(self, values: Sequence[str], place: Place) -> None:
        """Write code that stores values side by side in one vector, padded with 0."""
        vector = "zeroinitializer"
        for lane, value in enumerate(values):
            one = f"double {value}, i32 {lane}"
            vector = self.line(f"insertelement {SUMS} {vector}, {one}")
        self.lines.append(
            f"store {SUMS} {vector}, ptr {self.address(place)}, align {LINE_BYTES}"
        )

    def load(self, place: Place) -> str:
        """Write an instruction that loads the double at `place`; return its name."""
        return self.line(f"load double, ptr {self.address(place)}")

    def store(self, value: str, place: Place) -> None:
        """Write an instruction that stores a value at `place`."""
        self.lines.append(f"store double {value}, ptr {self.address(place)}")

    def address(self, place: Place) -> str:
        """Write an instruction for the address of `place`; return the result's name."""
        self._accesses += 1
        if self._accesses % ACCESSES == 0:
            self.lines.append(END_OF_STRETCH)
        array, k = place
        return self.line(f"getelementptr inbounds double, ptr %{array}, i64 {k}")
