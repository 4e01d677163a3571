"""Graph -> a tape for each function of a model, and the small machine that runs it.

Takes the place of `straight_line` for large models. A tape is data: nothing is compiled
but the machine, and what is computed is the same to the last bit. Most of a large model
are the same steps many times, body by body: the machine has a block for each of these
sequences, a loop that runs nearly as fast as straight-line code and takes as long to
compile for a thousand bodies as for ten. What occurs once has a block for each step.

An index is free again once its value has been used for the last time, so that the
memory in use stays small. Truth values are 0 and 1.
"""

from __future__ import annotations

import struct
from collections import Counter
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.graph import VARIABLE
from lagsim.native.graph.blocks import Task, blocks
from lagsim.native.graph.lines import exponent_of
from lagsim.native.graph.machine import (
    FIRST,
    MEMORY,
    NUMBER,
    RESULT,
    SIGNATURE,
    STATE,
    STOP,
    TIME,
    Block,
    machine,
)
from lagsim.native.graph.straight_line import Code, fixed_nodes
from lagsim.native.graph.writer import ordered

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Layout
    from lagsim.native.graph.machine import Step


def generate(
    g: Graph,
    functions: Mapping[str, Sequence[int]],
    layout: Layout,
    sparse: Collection[str] = (),
) -> Code:
    """Give the code of `functions`: name -> the nodes written to out[0], out[1], ...

    Those named in `sparse` do not write what is zero identically: they find zeros.
    """
    writer = _Writer(g, layout, fixed_nodes(g, functions, layout))
    tapes = {
        name: writer.function(nodes, sparse=name in sparse)
        for name, nodes in functions.items()
    }
    tapes["prepare"] = writer.preparation()  # the last: it knows all numbers
    parts = [machine(writer.opcodes)]
    parts += [_function(name, tape) for name, tape in tapes.items()]
    return Code("\n".join(parts), writer.size)


def _function(name: str, tape: Sequence[int]) -> str:
    """Give a function that runs `tape`."""
    data = np.array(tape, dtype=np.int32).tobytes()
    text = "\\" + data.hex("\\")
    return (
        f'@tape.{name} = private constant [{len(data)} x i8] c"{text}", align 4\n'
        f"define void @{name}({SIGNATURE}) {{\n"
        f"call void @tape.run(ptr @tape.{name}, {SIGNATURE})\nret void\n}}\n"
    )


class _Writer:
    """Writes the tapes of all functions, which share numbers and memory in p.

    Attributes
    ----------
    size : int
        The length of p.
    opcodes : dict
        Of the blocks that occur.
    """

    def __init__(self, g: Graph, layout: Layout, fixed: Sequence[int]) -> None:
        self.g, self.layout = g, layout
        self.opcodes: dict[Block, int] = {}
        # What lasts while a kernel runs: what `prepare` computes, and numbers.
        self.places = {node: layout.size + k for k, node in enumerate(fixed)}
        self.numbers: dict[int, int] = {}
        self.size = layout.size + len(fixed)
        # What is not in p.
        self.elsewhere = {g.variable(name): STATE for name in layout.y}
        self.elsewhere[g.variable("t")] = TIME
        self.elsewhere |= {g.variable(name): MEMORY for name in layout.p}
        # Indices that are used again and again, and those of them that are free.
        self.temporary: set[int] = set()
        self.free: list[int] = []

    def function(self, nodes: Sequence[int], *, sparse: bool) -> list[int]:
        """Give the tape that writes `nodes` to out."""
        results: dict[int, list[int]] = {}
        for k, node in enumerate(nodes):
            if node != self.g.zero or not sparse:
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
        tasks = self._tasks(results, known)
        uses = Counter(a for task in tasks for a in task.operands)
        uses.update(pinned.keys())  # by whoever reads them later
        code: list[int] = []
        index = dict(known)
        steps = iter(tasks)
        for block, times in blocks(tasks, uses):
            opcode = self.opcodes.setdefault(block, FIRST + len(self.opcodes))
            code += [opcode, times] if block.loops else [opcode]
            for _ in range(times):
                for step, task in zip(block.steps, steps, strict=False):
                    fields = self._taken(step, task, index, uses)
                    if task.operation == RESULT:
                        code.append(task.place)
                    elif step.stored:
                        code.append(self._place(task.node, index, uses, pinned))
                    code += fields
        return [*code, STOP]

    def _tasks(
        self, results: Mapping[int, Sequence[int]], known: Mapping[int, int]
    ) -> list[Task]:
        """Give what is done, one after the other."""
        g, elsewhere = self.g, self.elsewhere
        order = ordered(g, results, known)
        uses = Counter(chain(*(g.args[n] for n in order if n not in known)))
        inner = self._inner(order, uses, {*results, *known})
        tasks = []
        for n in order:
            operands = g.args[n]
            if operands and n not in known and n not in inner:
                products = tuple([a in inner for a in operands])
                if True in products:
                    groups = (g.args[a] if a in inner else (a,) for a in operands)
                    operands = tuple(chain(*groups))
                kinds = tuple([elsewhere.get(a, MEMORY) for a in operands])
                operation = g.ops[n], exponent_of(g, n), products
                tasks.append(Task(n, operation, operands, kinds, -1))
            if n in results:
                kinds = (elsewhere.get(n, MEMORY),)
                tasks += [Task(n, RESULT, (n,), kinds, k) for k in results[n]]
        return tasks

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

    def _taken(
        self, step: Step, task: Task, index: dict[int, int], uses: Counter[int]
    ) -> list[int]:
        """Give the fields of operands, and free what is not used again."""
        fields, over = [], []
        for n, operand in zip(task.operands, step.operands, strict=True):
            if operand.kind == MEMORY:
                fields.append(index[n] if n in index else self._leaf(n))
            elif operand.kind == STATE:
                fields.append(self.layout.y[str(self.g.payload(n))])
            uses[n] -= 1
            if not uses[n]:
                over.append(n)
        for n in over:
            self._release(n, index)
        return fields

    def _place(
        self,
        n: int,
        index: dict[int, int],
        uses: Counter[int],
        pinned: Mapping[int, int],
    ) -> int:
        """Give the index of p where a value is kept, if it is needed again."""
        if n in pinned:
            place = pinned[n]
        elif self.free:
            place = self.free.pop()
        else:
            place = self.size
            self.temporary.add(place)
            self.size += 1
        index[n] = place
        if not uses[n]:
            self._release(n, index)
        return place

    def _release(self, n: int, index: dict[int, int]) -> None:
        """Let others have the index of a value that is not used again."""
        if n in index and index[n] in self.temporary:
            self.free.append(index.pop(n))

    def _leaf(self, n: int) -> int:
        """Give the index in p of a number or a variable."""
        if self.g.ops[n] == VARIABLE:
            return self.layout.p[str(self.g.payload(n))]
        if n not in self.numbers:
            self.numbers[n] = self.size
            self.size += 1
        return self.numbers[n]
