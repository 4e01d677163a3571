"""Graph -> a tape for each function of a model, and the small machine that runs it.

Takes the place of `straight_line` for large models. A tape is data: nothing is compiled
but the machine, which takes as long for a thousand operations as for a million, and
what is computed is the same to the last bit.

An instruction is an opcode, the index in p that its value goes to, and the indices of
its operands, 32 bits each. Truth values are 0 and 1. An index is free again once its
value has been used for the last time, so that the memory in use stays small.
"""

from __future__ import annotations

import struct
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.functions import JOINING, OPERATIONS
from lagsim.language.graph import VARIABLE
from lagsim.native.graph.lines import Lines, exponent_of
from lagsim.native.graph.straight_line import Code, fixed_nodes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Layout

# The operation, the exponent of a power, and which of its operands are products that
# the same instruction makes: most of an elimination is a - b*c.
Operation = tuple[str, float | None, tuple[bool, ...]]

# Opcodes; those of operations begin at FIRST.
STOP, NUMBER, TIME, STATE, RESULT, FIRST = range(6)

_SIGNATURE = "double %t, ptr %y, ptr %p, ptr %out"


def generate(g: Graph, functions: Mapping[str, Sequence[int]], layout: Layout) -> Code:
    """Give the code of `functions`: name -> the nodes written to out[0], out[1], ..."""
    writer = _Writer(g, layout, fixed_nodes(g, functions, layout))
    tapes = {name: writer.function(nodes) for name, nodes in functions.items()}
    tapes["prepare"] = writer.preparation()  # the last: it knows all numbers
    parts = [_machine(writer.opcodes)]
    parts += [_function(name, tape) for name, tape in tapes.items()]
    return Code("\n".join(parts), writer.size)


def _function(name: str, tape: Sequence[int]) -> str:
    """Give a function that runs `tape`."""
    data = np.array(tape, dtype=np.int32).tobytes()
    text = "\\" + data.hex("\\")
    return (
        f'@tape.{name} = private constant [{len(data)} x i8] c"{text}", align 4\n'
        f"define void @{name}({_SIGNATURE}) {{\n"
        f"call void @tape.run(ptr @tape.{name}, {_SIGNATURE})\nret void\n}}\n"
    )


class _Writer:
    """Writes the tapes of all functions, which share numbers and memory in p.

    Attributes
    ----------
    size : int
        The length of p.
    opcodes : dict
        Of the operations that occur.
    """

    def __init__(self, g: Graph, layout: Layout, fixed: Sequence[int]) -> None:
        self.g, self.layout = g, layout
        self.opcodes: dict[Operation, int] = {}
        # What lasts while a kernel runs: what `prepare` computes, and numbers.
        self.places = {node: layout.size + k for k, node in enumerate(fixed)}
        self.numbers: dict[int, int] = {}
        self.size = layout.size + len(fixed)
        # Indices that are used again and again, and those of them that are free.
        self.temporary: set[int] = set()
        self.free: list[int] = []

    def function(self, nodes: Sequence[int]) -> list[int]:
        """Give the tape that writes `nodes` to out."""
        results: dict[int, list[int]] = {}
        for k, node in enumerate(nodes):
            results.setdefault(node, []).append(k)
        return self._tape(results, self.places, {})

    def preparation(self) -> list[int]:
        """Give the tape of what lasts."""
        tape = self._tape(dict.fromkeys(self.places, ()), {}, self.places)
        filled: list[int] = []
        for node, index in self.numbers.items():
            halves = struct.unpack("=ii", struct.pack("=d", self.g.payload(node)))
            filled += [NUMBER, index, *halves]
        return filled + tape

    def _tape(
        self,
        results: Mapping[int, Sequence[int]],
        known: Mapping[int, int],
        pinned: Mapping[int, int],
    ) -> list[int]:
        """Give a tape.

        Parameters
        ----------
        results
            Node -> indices in out.
        known, pinned
            Node -> index in p: of what needs no evaluation, and of what is to be left
            where it is told.
        """
        g = self.g
        order = g.cone(results, known)
        uses = Counter(a for n in order if n not in known for a in g.args[n])
        uses.update({n: len(wanted) for n, wanted in results.items()})
        inner = self._inner(order, uses, {*results, *known})
        code: list[int] = []
        index = dict(known)

        def taken(nodes: Sequence[int]) -> list[int]:
            """Give the indices of operands, and free those that are not used again."""
            fields = []
            for n in nodes:
                if n not in index:
                    index[n] = self._leaf(n, code)
                fields.append(index[n])
                uses[n] -= 1
            for n in nodes:
                if not uses[n] and n in index and index[n] in self.temporary:
                    self.free.append(index.pop(n))
            return fields

        for n in order:
            args = g.args[n]
            if args and n not in known and n not in inner:
                products = tuple(a in inner for a in args)
                if any(products):
                    groups = (g.args[a] if a in inner else (a,) for a in args)
                    args = tuple(a for group in groups for a in group)
                fields = taken(args)
                index[n] = pinned[n] if n in pinned else self._new()
                code += [self._opcode(n, products), index[n], *fields]
            for k in results.get(n, ()):
                code += [RESULT, k, *taken((n,))]
        return [*code, STOP]

    def _inner(
        self, order: Sequence[int], uses: Counter[int], kept: set[int]
    ) -> set[int]:
        """Give the products that are only used in one sum or difference."""
        g = self.g
        return {
            a
            for n in order
            if g.ops[n] in ("add", "sub")
            for a in g.args[n]
            if g.ops[a] == "mul" and uses[a] == 1 and a not in kept
        }

    def _leaf(self, n: int, code: list[int]) -> int:
        """Give the index of a number or a variable, loaded where it is not in p."""
        g = self.g
        if g.ops[n] != VARIABLE:
            if n not in self.numbers:
                self.numbers[n] = self.size
                self.size += 1
            return self.numbers[n]
        name = str(g.payload(n))
        if name in self.layout.p:
            return self.layout.p[name]
        index = self._new()
        if name == "t":
            code += [TIME, index]
        else:
            code += [STATE, index, self.layout.y[name]]
        return index

    def _new(self) -> int:
        if self.free:
            return self.free.pop()
        self.temporary.add(self.size)
        self.size += 1
        return self.size - 1

    def _opcode(self, n: int, products: tuple[bool, ...]) -> int:
        operation = self.g.ops[n], exponent_of(self.g, n), products
        return self.opcodes.setdefault(operation, FIRST + len(self.opcodes))


def _machine(opcodes: Mapping[Operation, int]) -> str:
    """Give the function that runs a tape."""
    machine = _Machine()
    machine.specials()
    for operation, opcode in opcodes.items():
        machine.block(operation, opcode)
    return machine.text()


class _Machine(Lines):
    """Writes the machine: a block of IR for each opcode."""

    def __init__(self) -> None:
        super().__init__()
        self.cases: list[str] = []
        self.ends: list[str] = []

    def specials(self) -> None:
        """Write the blocks that load and store."""
        self._begin(NUMBER)
        halves = self.line("getelementptr inbounds i32, ptr %pc, i64 2")
        self._end(NUMBER, 4, self.line(f"load double, ptr {halves}, align 4"))
        self._begin(TIME)
        self._end(TIME, 2, "%t")
        self._begin(STATE)
        self._end(STATE, 3, self._load("y", 2))
        self._begin(RESULT)
        self._end(RESULT, 3, self._load("p", 2), to="out")

    def block(self, operation: Operation, opcode: int) -> None:
        """Write the block of an operation."""
        op, exponent, products = operation
        self._begin(opcode)
        length = 2
        operands: list[str] = []
        for k, product in enumerate(products):
            factors = [self._load("p", length + i) for i in range(1 + product)]
            length += len(factors)
            value = self.operation("mul", None, factors) if product else factors[0]
            if op in JOINING or (op == "if" and k == 0):
                value = self.line(f"fcmp one double {value}, 0.0")
            operands.append(value)
        value = self.operation(op, exponent, operands)
        if OPERATIONS[op].condition:
            value = self.line(f"uitofp i1 {value} to double")
        self._end(opcode, length, value)

    def text(self) -> str:
        """Give the whole function."""
        return "\n".join(
            [
                *sorted(self.declared),
                f"define internal void @tape.run(ptr %tape, {_SIGNATURE}) {{",
                "begin:",
                "br label %next",
                "next:",
                f"%pc = phi ptr [%tape, %begin], {', '.join(self.ends)}",
                "%opcode = load i32, ptr %pc",
                f"switch i32 %opcode, label %stop [{' '.join(self.cases)}]",
                *self.lines,
                "stop:",
                "ret void",
                "}",
            ]
        )

    def _begin(self, opcode: int) -> None:
        self.lines.append(f"op{opcode}:")
        self.cases.append(f"i32 {opcode}, label %op{opcode}")

    def _end(self, opcode: int, length: int, value: str, to: str = "p") -> None:
        """Store the value of an instruction, and go to the next."""
        self.lines.append(f"store double {value}, ptr {self._place(to, 1)}")
        after = self.line(f"getelementptr inbounds i32, ptr %pc, i64 {length}")
        self.lines.append("br label %next")
        self.ends.append(f"[{after}, %op{opcode}]")

    def _load(self, array: str, k: int) -> str:
        return self.line(f"load double, ptr {self._place(array, k)}")

    def _place(self, array: str, k: int) -> str:
        """Give the address in `array` that field k of the instruction tells."""
        field = self.line(f"getelementptr inbounds i32, ptr %pc, i64 {k}")
        index = self.line(f"load i32, ptr {field}")
        return self.line(f"getelementptr inbounds double, ptr %{array}, i32 {index}")
