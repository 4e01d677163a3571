"""Graph -> LLVM IR: each function of a model as straight-line code.

Every function is `void f(double t, ptr y, ptr p, ptr out)`. Expressions of parameters
alone are computed once, by the function `prepare`, into the tail of `p`. Long functions
are cut into pieces that pass values through scratch memory, also in `p`, so that
compile time grows in proportion to length.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE
from lagsim.native.graph import keys, sincos
from lagsim.native.graph.lines import CIRCULAR, Lines, exponent_of
from lagsim.native.kernels.lines import UNOPTIMISED

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Layout

_SIGNATURE = "double %t, ptr %y, ptr %p, ptr %out"


class Code(NamedTuple):
    """LLVM IR of all functions, and the length of p that they need."""

    ir: str
    p_size: int


def generate(
    g: Graph,
    functions: Mapping[str, Sequence[int]],
    layout: Layout,
    contracted: Collection[str] = (),
    sparse: Collection[str] = (),
    wide: Collection[str] = (),
    rare: Collection[str] = (),
) -> Code:
    """Give the code of `functions`: name -> the nodes written to out[0], out[1], ...

    In those named in `contracted` a product may be added without being rounded first,
    where the processor can: last digits then depend on it. Those named in `sparse` do
    not write what is zero identically: they find zeros. Those named in `wide` are of
    LANES states at once: t and then y (1 + size, LANES), out (k, LANES). Those named in
    `rare` are called a few times: LLVM takes less time for them, with the same bits.
    """
    hoisted = fixed_nodes(g, functions, layout)
    places = {node: layout.size + k for k, node in enumerate(hoisted)}
    scratch = layout.size + len(hoisted)
    writers = [Writer(g, layout, scratch)]
    writers[0].function("prepare", [(node, "p", k) for node, k in places.items()], {})
    for name, nodes in functions.items():
        stores = [
            (node, "out", k)
            for k, node in enumerate(nodes)
            if node != g.zero or name not in sparse
        ]
        writer = Writer(
            g, layout, scratch, contract=name in contracted, wide=name in wide
        )
        manner = f" {UNOPTIMISED}" if name in rare else ""
        writer.function(name, stores, places, manner)
        writers.append(writer)
    declared = sorted(set().union(*(writer.declared for writer in writers)))
    lines = [line for writer in writers for line in writer.lines]
    used = max(writer.scratch_used for writer in writers)
    return Code("\n".join([*declared, *lines, ""]), scratch + used)


def fixed_nodes(
    g: Graph, functions: Mapping[str, Sequence[int]], layout: Layout
) -> list[int]:
    """Give the operations that are done once, by `prepare`."""
    roots = sorted({node for nodes in functions.values() for node in nodes})
    return _hoisted(g, roots, _varying(g, roots, layout))


def _varying(g: Graph, roots: Sequence[int], layout: Layout) -> set[int]:
    """Give the nodes that change while a kernel runs."""
    found: set[int] = set()
    for n in g.cone(roots):
        if g.ops[n] == VARIABLE:
            if g.payload(n) not in layout.fixed:
                found.add(n)
        elif any(a in found for a in g.args[n]):
            found.add(n)
    return found


def _hoisted(g: Graph, roots: Sequence[int], varying: set[int]) -> list[int]:
    """Give the operations on fixed values that varying ones, or outputs, use."""
    used: set[int] = set(roots)
    for n in g.cone(roots):
        if n in varying:
            used.update(g.args[n])
    return sorted(
        n
        for n in used
        if n not in varying and g.args[n] and not OPERATIONS[g.ops[n]].condition
    )


def ordered(g: Graph, roots: Collection[int], places: Mapping[int, int]) -> list[int]:
    """Give what must be evaluated, stopping at what `prepare` has computed.

    Sines and cosines come early and side by side: first those of angles that wait
    for none, then those that wait for these.
    """
    order = g.cone(roots, places)
    depth: dict[int, int] = {}  # what is not in it waits for none
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


class Writer(Lines):
    """Writes one function.

    signature: of the function, as it is defined and called.
    """

    signature = _SIGNATURE

    def __init__(self, g: Graph, layout: Layout, scratch: int, **how: bool) -> None:
        super().__init__(**how)
        self.g = g
        self.layout = layout
        self.scratch = scratch
        self.scratch_used = 0

    @property
    def passed_width(self) -> int:
        """The numbers that a value takes which a later piece uses."""
        return sincos.LANES if self.wide else 1

    @property
    def time_first(self) -> bool:
        """Whether y begins with t."""
        return self.wide

    def _time(self) -> str:
        return self._load("y", 0) if self.wide else "%t"

    def function(
        self,
        name: str,
        stores: Sequence[tuple[int, str, int]],
        places: Mapping[int, int],
        manner: str = "",
    ) -> None:
        """Write it: each of `stores` is (node, array, index)."""
        order = ordered(self.g, [node for node, _, _ in stores], places)
        pieces = [
            order[i : i + keys.PIECE] for i in range(0, len(order), keys.PIECE)
        ] or [[]]
        at_end: dict[int, list[tuple[str, int]]] = {}
        for node, array, k in stores:
            at_end.setdefault(node, []).append((array, k))
        passed = self._passed(pieces, places)
        names = [name] if len(pieces) == 1 else [
            f"{name}.{i}" for i in range(len(pieces))
        ]  # fmt: skip
        for piece_name, piece in zip(names, pieces, strict=True):
            linkage = "" if piece_name == name else "internal "
            head = f"define {linkage}void @{piece_name}({self.signature}){manner} {{"
            self.lines.append(head)
            self._piece(piece, places, passed, at_end)
            self.lines += ["ret void", "}"]
        if len(pieces) > 1:
            self.lines.append(f"define void @{name}({self.signature}) {{")
            self.lines += [f"call void @{p}({self.signature})" for p in names]
            self.lines += ["ret void", "}"]

    def _passed(
        self, pieces: Sequence[Sequence[int]], places: Mapping[int, int]
    ) -> dict[int, int]:
        """Give the index in p of operations that a later piece uses."""
        home = {n: i for i, piece in enumerate(pieces) for n in piece}
        passed: dict[int, int] = {}
        width = self.passed_width
        for i, piece in enumerate(pieces):
            for n in piece:
                for a in self.g.args[n] if n not in places else ():
                    earlier = home.get(a, i) < i and a not in places
                    if earlier and self.g.args[a] and a not in passed:
                        passed[a] = self.scratch + width * len(passed)
        self.scratch_used = width * len(passed)
        return passed

    def _piece(
        self,
        piece: Sequence[int],
        places: Mapping[int, int],
        passed: Mapping[int, int],
        at_end: Mapping[int, Sequence[tuple[str, int]]],
    ) -> None:
        here: dict[int, str] = {}

        def operand(n: int) -> str:
            if n not in here:
                here[n] = self._leaf(n, places, passed)
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
                    self._pass_on(n, here[n], passed[n])
            for array, k in at_end.get(n, ()):
                self._store(operand(n), array, k)

    def _circular(
        self,
        nodes: Sequence[int],
        places: Mapping[int, int],
        here: dict[int, str],
        operand: Callable[[int], str],
    ) -> None:
        """Write the sines and cosines that `nodes` begin with, of several angles."""
        g = self.g
        together: list[int] = []
        angles: dict[int, int] = {}
        for n in nodes:
            done = n in places or g.ops[n] not in CIRCULAR
            if done or g.args[n][0] in together:
                break
            angle = g.args[n][0]
            if angle not in angles and len(angles) == sincos.LANES:
                break
            angles.setdefault(angle, len(angles))
            together.append(n)
        wanted = [(g.ops[n], angles[g.args[n][0]]) for n in together]
        values = self.circular([operand(angle) for angle in angles], wanted)
        here.update(zip(together, values, strict=True))

    def _leaf(
        self, n: int, places: Mapping[int, int], passed: Mapping[int, int]
    ) -> str:
        g = self.g
        if g.ops[n] == CONSTANT:
            x = g.value(n)
            assert x is not None
            return self.literal(x)
        if g.ops[n] == TRUTH:
            return self.widened("true" if g.payload(n) else "false")
        if g.ops[n] == VARIABLE:
            name = str(g.payload(n))
            if name == "t":
                return self._time()
            if name in self.layout.y:
                return self._load("y", self.layout.y[name] + self.time_first)
            return self._load_same(self.layout.p[name])
        if n in places:
            return self._load_same(places[n])
        value = self._load("p", passed[n])
        if OPERATIONS[g.ops[n]].condition:
            return self.line(f"fcmp one {self.kind} {value}, {self.literal(0.0)}")
        return value

    def _pass_on(self, n: int, value: str, k: int) -> None:
        if OPERATIONS[self.g.ops[n]].condition:
            value = self.line(self.widened(f"uitofp i1 {value} to double"))
        self._store(value, "p", k)

    def _load(self, array: str, k: int) -> str:
        return self.line(f"load {self.kind}, ptr {self._address(array, k)}, align 8")

    def _load_same(self, k: int) -> str:
        """Load a number from p, the same for all lanes."""
        value = self.line(f"load double, ptr {self._address('p', k)}")
        return self.joined([value] * sincos.LANES) if self.wide else value

    def _store(self, value: str, array: str, k: int) -> None:
        place = f"ptr {self._address(array, k)}, align 8"
        self.lines.append(f"store {self.kind} {value}, {place}")

    def _address(self, array: str, k: int) -> str:
        if self.wide and array != "p":
            k *= sincos.LANES
        return self.line(f"getelementptr inbounds double, ptr %{array}, i64 {k}")
