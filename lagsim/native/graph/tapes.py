"""Graph -> a tape for each function of a model, and the interpreter that runs it.

Takes the place of `straight_line` for large models. A tape is data: nothing is compiled
but the interpreter, and what is computed is the same to the last bit.

An instruction is an opcode, a count, and as many times the fields of one evaluation:
indices into p (32 bits) of its values and of its operands. Evaluations of one kind
whose operands are known are gathered into one instruction, so that the interpreter
decodes few instructions: a large model has the same kinds of operations body by body.
The index of a value is free again after its last use. Truth values are 0 and 1.
"""

from __future__ import annotations

from collections import Counter
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.functions import JOINING, OPERATIONS
from lagsim.language.graph import DATA, VARIABLE
from lagsim.native.graph.lines import (
    CIRCULAR,
    CLEAR,
    LANES,
    Code,
    Lines,
    clearing,
    exponent_of,
    fixed_nodes,
    number,
)  # fmt: skip

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.language.tables import Data
    from lagsim.native.graph.keys import Layout


SIGNATURE = "double %t, ptr %y, ptr %p, ptr %out"


class Kind(NamedTuple):
    """An operation, the exponent of a power, and which operands are products.

    Those are made by the same evaluation: most of an elimination is a - b*c. `data`
    are the arrays that come before the operands.
    """

    op: str
    exponent: float | None = None
    products: tuple[bool, ...] = ()
    data: tuple[Data, ...] = ()


# Fields of a STORE: index in p, index in out. Sine and cosine of LANES angles: indices
# of the sines, of the cosines, of the angles.
STORE, SINCOS = map(Kind, ("store", "sincos"))
STOP = 0


class Task(NamedTuple):
    """An evaluation: the nodes that it gives, and those that it takes."""

    kind: Kind
    values: tuple[int, ...]
    operands: tuple[int, ...]


def scheduled(tasks: Sequence[Task]) -> Iterator[tuple[Kind, list[Task]]]:
    """Put tasks into an order in which many of one kind follow each other.

    List scheduling: of what has its operands, all of the most frequent kind is next.
    """
    makes = {value: k for k, task in enumerate(tasks) for value in task.values}
    missing, users = [], dict[int, list[int]]()
    ready: dict[Kind, list[int]] = {}
    for k, task in enumerate(tasks):
        before = {makes[a] for a in task.operands if a in makes}
        missing.append(len(before))
        for j in before:
            users.setdefault(j, []).append(k)
        if not before:
            ready.setdefault(task.kind, []).append(k)
    while ready:
        kind = max(ready, key=lambda x: len(ready[x]))
        group = ready.pop(kind)
        yield kind, [tasks[k] for k in group]
        for user in chain.from_iterable(users.get(k, ()) for k in group):
            missing[user] -= 1
            if not missing[user]:
                ready.setdefault(tasks[user].kind, []).append(user)


def generate(g: Graph, functions: Mapping[str, Sequence[int]], layout: Layout) -> Code:
    """Code of `functions`: name -> the nodes written to out[0], out[1], ..."""
    nodes = fixed_nodes(g, functions, layout.fixed)
    fixed = {node: layout.size + k for k, node in enumerate(nodes)}
    tapes = _Tapes(g, layout, functions, layout.size + len(fixed))
    lines = []
    for name, made in functions.items():
        written = [(n, k) for k, n in enumerate(made) if n != g.zero]
        before = f"{clearing(len(made))}\n{tapes.state}"
        lines += _function(name, tapes.tape(written, fixed, {}), before)
    lines += _function("prepare", tapes.tape([], {}, fixed), tapes.filled)
    whole = Interpreter(tapes.opcodes, tapes.time)
    text = [*sorted(whole.declared), tapes.table, *lines, *whole.lines, ""]
    return Code("\n".join(text), tapes.size)


def _copied(array: str, name: str, first: int, count: int) -> str:
    """Write the copy of an array to p, from index `first` on."""
    return (
        f"%{name} = getelementptr double, ptr %p, i64 {first}\ncall void "
        f"@llvm.memcpy.p0.p0.i64(ptr %{name}, ptr {array}, i64 {8 * count}, i1 0)"
    )


def _function(name: str, tape: Sequence[int], before: str) -> list[str]:
    """Return a function that runs `tape`."""
    data = np.array(tape, dtype=np.int32).tobytes()
    text = "\\" + data.hex("\\")
    return [
        f'@tape.{name} = private constant [{len(data)} x i8] c"{text}", align 4',
        f"define void @{name}({SIGNATURE}) {{",
        before,
        f"call void @tape.run(ptr @tape.{name}, {SIGNATURE})",
        "ret void",
        "}",
    ]


class _Tapes:
    """The tapes of all functions, which share numbers and memory in p.

    Attributes
    ----------
    numbers : dict of int to int
        Node -> index in p, of constants.
    time, states : int
        The index of t, which y follows, and the length of y.
    nowhere : int
        That of sines and cosines that nobody uses.
    size : int
        The length of p.
    opcodes : dict
        Of the kinds that occur.
    state, filled : str
        What copies y, and the constants, to p.
    table : str
        The constants.
    """

    def __init__(
        self, g: Graph, layout: Layout, functions: Mapping[str, Sequence[int]],
        first: int,
    ) -> None:  # fmt: skip
        self.g, self.layout = g, layout
        self.opcodes: dict[Kind, int] = {}
        cone = g.cone(chain.from_iterable(functions.values()))
        leaves = [n for n in cone if not g.args[n]]
        leaves = [n for n in leaves if g.ops[n] not in (VARIABLE, DATA)]
        self.numbers = {n: first + k for k, n in enumerate(leaves)}
        self.time = first + len(leaves)
        read = {g.payload(n) for n in cone if g.ops[n] == VARIABLE}
        self.states = 1 + max([k for x, k in layout.y.items() if x in read] or (-1,))
        self.nowhere = self.time + self.states + 1
        self.size = self.nowhere + 1
        self.leaves = self.numbers | {g.variable("t"): self.time}
        self.leaves |= {g.variable(name): k for name, k in layout.p.items()}
        y = {g.variable(name): self.time + 1 + k for name, k in layout.y.items()}
        self.leaves |= y
        self.free: list[int] = []  # indices of values that are not used again
        self.state = _copied("%y", "state", self.time + 1, self.states)
        self.filled = _copied("@numbers", "numbers", first, len(leaves))
        values = [f"double {number(float(g.payload(n)))}" for n in leaves]
        numbers = f"[{len(values)} x double] [{', '.join(values)}]"
        self.table = f"@numbers = private constant {numbers}"

    def tape(
        self,
        written: Sequence[tuple[int, int]],
        known: Mapping[int, int],
        pinned: Mapping[int, int],
    ) -> list[int]:
        """Tape.

        Parameters
        ----------
        written
            Nodes, and indices in out.
        known, pinned
            Node -> index in p: of what needs no evaluation, and of what is left there.
        """
        results: dict[int, list[int]] = {}
        for node, k in written:
            results.setdefault(node, []).append(k)
        tasks = self._tasks([*results, *pinned], known)
        uses = Counter(chain.from_iterable(task.operands for task in tasks))
        uses.update((*results, *pinned))
        index = {**self.leaves, **known}
        code = self._stored([n for n in results if n in index], results, index)
        for kind, group in scheduled(tasks):
            self._append(code, kind, self._fields(kind, group, index, uses, pinned))
            made = [n for task in group for n in task.values if n in results]
            code += self._stored(made, results, index)
            for n in made:
                self._use(n, index, uses)
        return [*code, STOP]

    def _append(self, code: list[int], kind: Kind, fields: list[list[int]]) -> None:
        opcode = self.opcodes.setdefault(kind, 1 + len(self.opcodes))
        code += [opcode, len(fields), *chain.from_iterable(fields)]

    def _stored(
        self,
        nodes: Sequence[int],
        results: Mapping[int, Sequence[int]],
        index: Mapping[int, int],
    ) -> list[int]:
        """Instruction that writes results out, if there are any."""
        code: list[int] = []
        if nodes:
            fields = [[index[n], k] for n in nodes for k in results[n]]
            self._append(code, STORE, fields)
        return code

    def _tasks(self, roots: Collection[int], known: Mapping[int, int]) -> list[Task]:
        """Return the evaluations of what is not known."""
        g = self.g
        order = [n for n in g.cone(roots, known) if n not in known]
        uses = Counter(chain.from_iterable(g.args[n] for n in order))
        kept = {*roots, *known}
        inner = {
            a
            for n in order
            if g.ops[n] in ("add", "sub")
            for a in g.args[n]
            if g.ops[a] == "mul" and uses[a] == 1 and a not in kept
        }
        tasks, angles = [], dict[int, list[int]]()
        for n in order:
            arrays = OPERATIONS[g.ops[n]].data if g.args[n] else 0
            args = g.args[n][arrays:]
            if g.ops[n] in CIRCULAR:
                pair = angles.setdefault(args[0], [-1, -1])
                pair[CIRCULAR[g.ops[n]]] = n
            elif args and n not in inner:
                products = tuple([a in inner for a in args])
                taken = chain.from_iterable(
                    g.args[a] if a in inner else (a,) for a in args
                )
                data = tuple(map(g.payload, g.args[n][:arrays]))
                kind = Kind(g.ops[n], exponent_of(g, n), products, data)
                tasks.append(Task(kind, (n,), tuple(taken)))
        tasks += [Task(SINCOS, tuple(pair), (a,)) for a, pair in angles.items()]
        return tasks

    def _fields(
        self,
        kind: Kind,
        group: Sequence[Task],
        index: dict[int, int],
        uses: Counter[int],
        pinned: Mapping[int, int],
    ) -> list[list[int]]:
        """Fields of evaluations of one kind, in this order."""
        fields = []
        together = LANES if kind == SINCOS else 1
        for k in range(0, len(group), together):
            some = group[k : k + together]
            operands = [index[a] for task in some for a in task.operands]
            operands += operands[-1:] * (together - len(some))
            for task in some:
                for a in task.operands:
                    self._use(a, index, uses)
            values = [
                self.nowhere if n < 0 else self._place(n, index, pinned)
                for many in zip(*(task.values for task in some), strict=True)
                for n in (*many, *[-1] * (together - len(some)))
            ]
            fields.append([*values, *operands])
        return fields

    def _place(self, n: int, index: dict[int, int], pinned: Mapping[int, int]) -> int:
        """Index of a value to come."""
        if n in pinned:
            index[n] = pinned[n]
        elif self.free:
            index[n] = self.free.pop()
        else:
            index[n] = self.size
            self.size += 1
        return index[n]

    def _use(self, n: int, index: dict[int, int], uses: Counter[int]) -> None:
        """Count a use; after the last one others may have the index."""
        uses[n] -= 1
        if not uses[n] and index[n] > self.nowhere:
            self.free.append(index.pop(n))


class Interpreter(Lines):
    """The function that runs a tape: a loop for each opcode."""

    def __init__(self, opcodes: Mapping[Kind, int], time: int) -> None:
        super().__init__()
        self.declared.add("declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)")
        self.declared.add(CLEAR)
        for kind, k in opcodes.items():
            self.lines += [
                f"op{k}:",
                f"%count{k} = getelementptr i32, ptr %pc, i64 1",
                f"%times{k} = load i32, ptr %count{k}",
                f"%first{k} = getelementptr i32, ptr %pc, i64 2",
                f"br label %loop{k}",
                f"loop{k}:",
                f"%at{k} = phi ptr [%first{k}, %op{k}], [%after{k}, %loop{k}]",
                f"%left{k} = phi i32 [%times{k}, %op{k}], [%less{k}, %loop{k}]",
            ]
            width = self._evaluation(kind, f"%at{k}")
            self.lines += [
                f"%after{k} = getelementptr i32, ptr %at{k}, i64 {width}",
                f"%less{k} = sub i32 %left{k}, 1",
                f"%more{k} = icmp ne i32 %less{k}, 0",
                f"br i1 %more{k}, label %loop{k}, label %next",
            ]
        codes = opcodes.values()
        ends = "".join(f", [%after{k}, %loop{k}]" for k in codes)
        cases = " ".join(f"i32 {k}, label %op{k}" for k in codes)
        self.lines = [
            f"define internal void @tape.run(ptr readonly %tape, {SIGNATURE}) {{",
            "begin:",
            f"%time = getelementptr double, ptr %p, i64 {time}",
            "store double %t, ptr %time",
            "br label %next",
            "next:",
            f"%pc = phi ptr [%tape, %begin]{ends}",
            "%opcode = load i32, ptr %pc",
            f"switch i32 %opcode, label %stop [{cases}]",
            *self.lines,
            "stop:",
            "ret void",
            "}",
        ]

    def _evaluation(self, kind: Kind, at: str) -> int:
        """Write the evaluation of a kind; return how many fields it has."""
        if kind == STORE:
            self._store(self._load("p", at, 0), "out", at, 1)
            return 2
        if kind == SINCOS:
            angles = [self._load("p", at, 2 * LANES + k) for k in range(LANES)]
            wanted = [(op, k) for op in CIRCULAR for k in range(LANES)]
            for k, value in enumerate(self.circular(angles, wanted)):
                self._store(value, "p", at, k)
            return 3 * LANES
        fields, operands = 1, [self.data(data) for data in kind.data]
        for place, product in enumerate(kind.products):
            value = self._load("p", at, fields)
            fields += 1
            if product:
                other = self._load("p", at, fields)
                value = self.operation("mul", None, [value, other])
                fields += 1
            if kind.op in JOINING or (kind.op == "if" and place == 0):
                value = self.line(f"fcmp one double {value}, 0.0")
            operands.append(value)
        value = self.operation(kind.op, kind.exponent, operands)
        if OPERATIONS[kind.op].condition:
            value = self.line(f"uitofp i1 {value} to double")
        self._store(value, "p", at, 0)
        return fields

    def _address(self, array: str, at: str, k: int) -> str:
        """Address in `array` that field k from `at` on tells."""
        field = self.line(f"getelementptr inbounds i32, ptr {at}, i64 {k}")
        index = self.line(f"load i32, ptr {field}")
        return self.line(f"getelementptr inbounds double, ptr %{array}, i32 {index}")

    def _load(self, array: str, at: str, k: int) -> str:
        return self.line(f"load double, ptr {self._address(array, at, k)}")

    def _store(self, value: str, array: str, at: str, k: int) -> None:
        self.lines.append(f"store double {value}, ptr {self._address(array, at, k)}")
