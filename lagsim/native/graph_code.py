"""Graph -> LLVM IR: each function of a model as straight-line code.

Every function is `void f(double t, ptr y, ptr p, ptr out)`. Expressions of parameters
alone are computed once, by the function `prepare`, into the tail of `p`. Long functions
are cut into pieces that pass values through scratch memory, also in `p`, so that
compile time grows in proportion to length.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lagsim.expressions.functions import OPERATIONS
from lagsim.expressions.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.expressions.graph import Graph

# Nodes in one piece: LLVM's time per instruction grows with the length of a function
# (a 40-link chain: 0.9 s at 800, 0.7 s at 400, and little less below).
PIECE = 400

_SIGNATURE = "double %t, ptr %y, ptr %p, ptr %out"
_ARGUMENTS = "double %t, ptr %y, ptr %p, ptr %out"


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the variables are: name -> index in y, name -> index in p.

    `fixed` names those in p that do not change while a kernel runs (parameters,
    modes); `size` is how much of p is used before what this module adds.
    """

    y: Mapping[str, int]
    p: Mapping[str, int]
    fixed: frozenset[str]
    size: int


@dataclass(frozen=True, slots=True)
class Code:
    """LLVM IR of all functions, and the length of p that they need."""

    ir: str
    p_size: int


def exponent_of(g: Graph, n: int) -> float | None:
    """Give the exponent of a power where it is a number; None for all else."""
    return g.value(g.args[n][1]) if g.ops[n] == "pow" else None


def number(x: float) -> str:
    """Give the LLVM literal of a float, bit for bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


def generate(
    g: Graph,
    functions: Mapping[str, Sequence[int]],
    layout: Layout,
    contracted: Collection[str] = (),
    sparse: Collection[str] = (),
) -> Code:
    """Give the code of `functions`: name -> the nodes written to out[0], out[1], ...

    In those named in `contracted` a product may be added without being rounded first,
    where the processor can: last digits then depend on it. Those named in `sparse` do
    not write what is zero identically: they find zeros.
    """
    hoisted = fixed_nodes(g, functions, layout)
    places = {node: layout.size + k for k, node in enumerate(hoisted)}
    scratch = layout.size + len(hoisted)
    writer = _Writer(g, layout, scratch)
    writer.function("prepare", [(node, "p", k) for node, k in places.items()], {})
    for name, nodes in functions.items():
        stores = [
            (node, "out", k)
            for k, node in enumerate(nodes)
            if node != g.zero or name not in sparse
        ]
        writer.contract = name in contracted
        writer.function(name, stores, places)
    ir = "\n".join([*sorted(writer.declared), *writer.lines, ""])
    return Code(ir, scratch + writer.scratch_used)


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


class Lines:
    """Lines of IR with fresh names."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self.contract = False
        self._fresh = 0

    def operation(self, op: str, exponent: float | None, operands: list[str]) -> str:
        """Write an operation, of a power the `exponent` where it is a number."""
        if op == "pow" and exponent is not None and exponent * 2 in _HALVES:
            return self._power(operands[0], exponent)
        row = OPERATIONS[op]
        self.declared.update(row.declares)
        fresh = {key: self._name() for key in "abcdef"}
        native = row.native
        if self.contract and op in _CONTRACTED:
            native = native.replace(" ", " contract ", 1)
        *before, last = native.format(*operands, **fresh).split("\n")
        self.lines += before
        return self.line(last)

    def _power(self, x: str, exponent: float) -> str:
        """Write x to a small whole or half power as products and a root."""
        whole = int(abs(exponent))
        result = ""
        if abs(exponent) != whole:
            self.declared.update(OPERATIONS["sqrt"].declares)
            result = self.line(f"call double @llvm.sqrt.f64(double {x})")
        while whole:
            if whole % 2:
                result = self.line(f"fmul double {result}, {x}") if result else x
            whole //= 2
            if whole:
                x = self.line(f"fmul double {x}, {x}")
        if exponent < 0:
            return self.line(f"fdiv double {number(1.0)}, {result}")
        return result

    def line(self, text: str) -> str:
        """Write an instruction; give the name of its value."""
        name = self._name()
        self.lines.append(f"{name} = {text}")
        return name

    def _name(self) -> str:
        self._fresh += 1
        return f"%v{self._fresh}"


class _Writer(Lines):
    def __init__(self, g: Graph, layout: Layout, scratch: int) -> None:
        super().__init__()
        self.g = g
        self.layout = layout
        self.scratch = scratch
        self.scratch_used = 0

    def function(
        self,
        name: str,
        stores: Sequence[tuple[int, str, int]],
        places: Mapping[int, int],
    ) -> None:
        """Write one function: each of `stores` is (node, array, index)."""
        order = self._order([node for node, _, _ in stores], places)
        pieces = [order[i : i + PIECE] for i in range(0, len(order), PIECE)] or [[]]
        at_end: dict[int, list[tuple[str, int]]] = {}
        for node, array, k in stores:
            at_end.setdefault(node, []).append((array, k))
        passed = self._passed(pieces, places)
        names = [name] if len(pieces) == 1 else [
            f"{name}.{i}" for i in range(len(pieces))
        ]  # fmt: skip
        for piece_name, piece in zip(names, pieces, strict=True):
            linkage = "" if piece_name == name else "internal "
            self.lines.append(f"define {linkage}void @{piece_name}({_SIGNATURE}) {{")
            self._piece(piece, places, passed, at_end)
            self.lines += ["ret void", "}"]
        if len(pieces) > 1:
            self.lines.append(f"define void @{name}({_SIGNATURE}) {{")
            self.lines += [f"call void @{p}({_ARGUMENTS})" for p in names]
            self.lines += ["ret void", "}"]

    def _order(self, roots: Sequence[int], places: Mapping[int, int]) -> list[int]:
        """Give what must be evaluated, stopping at what `prepare` has computed."""
        seen = set(roots)
        stack = list(seen)
        while stack:
            n = stack.pop()
            if n in places:
                continue
            for a in self.g.args[n]:
                if a not in seen:
                    seen.add(a)
                    stack.append(a)
        return sorted(seen)

    def _passed(
        self, pieces: Sequence[Sequence[int]], places: Mapping[int, int]
    ) -> dict[int, int]:
        """Give the index in p of operations that a later piece uses."""
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
        places: Mapping[int, int],
        passed: Mapping[int, int],
        at_end: Mapping[int, Sequence[tuple[str, int]]],
    ) -> None:
        here: dict[int, str] = {}

        def operand(n: int) -> str:
            if n not in here:
                here[n] = self._leaf(n, places, passed)
            return here[n]

        for n in piece:
            if self.g.args[n] and n not in places:
                operands = [operand(a) for a in self.g.args[n]]
                exponent = exponent_of(self.g, n)
                here[n] = self.operation(self.g.ops[n], exponent, operands)
                if n in passed:
                    self._pass_on(n, here[n], passed[n])
            for array, k in at_end.get(n, ()):
                self._store(operand(n), array, k)

    def _leaf(
        self, n: int, places: Mapping[int, int], passed: Mapping[int, int]
    ) -> str:
        g = self.g
        if g.ops[n] == CONSTANT:
            x = g.value(n)
            assert x is not None
            return number(x)
        if g.ops[n] == TRUTH:
            return "true" if g.payload(n) else "false"
        if g.ops[n] == VARIABLE:
            name = str(g.payload(n))
            if name == "t":
                return "%t"
            if name in self.layout.y:
                return self._load("y", self.layout.y[name])
            return self._load("p", self.layout.p[name])
        if n in places:
            return self._load("p", places[n])
        value = self._load("p", passed[n])
        if OPERATIONS[g.ops[n]].condition:
            return self.line(f"fcmp one double {value}, 0.0")
        return value

    def _pass_on(self, n: int, value: str, k: int) -> None:
        if OPERATIONS[self.g.ops[n]].condition:
            value = self.line(f"uitofp i1 {value} to double")
        self._store(value, "p", k)

    def _load(self, array: str, k: int) -> str:
        return self.line(f"load double, ptr {self._address(array, k)}")

    def _store(self, value: str, array: str, k: int) -> None:
        self.lines.append(f"store double {value}, ptr {self._address(array, k)}")

    def _address(self, array: str, k: int) -> str:
        return self.line(f"getelementptr inbounds double, ptr %{array}, i64 {k}")


_CONTRACTED = ("add", "sub", "mul")

# Twice the exponents that are written out: products are exact to an ulp or two up to
# the 6th power, and faster than `pow`.
_HALVES = frozenset(k for k in range(-12, 13) if k not in (0, 2))
