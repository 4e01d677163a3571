"""Graph -> a tape for each function of a model, and the small machine that runs it.

Takes the place of `straight_line` for large models. A tape is data: nothing is compiled
but the machine, and what is computed is the same to the last bit. Most of a large model
are the same steps many times, body by body: the machine has a block for each of these
sequences, a loop that runs nearly as fast as straight-line code and takes as long to
compile for a thousand bodies as for ten. What occurs once has a block for each step.

An instruction is an opcode, how many times it is done, and then each time the fields of
its steps: 32 bits each, the index to which a value goes and those of operands that are
not made by the same instruction. An index is free again once its value has been used
for the last time, so that the memory in use stays small. Truth values are 0 and 1.
"""

from __future__ import annotations

import struct
from collections import Counter
from heapq import heapify, heappop, heappush
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.functions import JOINING, OPERATIONS
from lagsim.language.graph import VARIABLE
from lagsim.native.graph.lines import CIRCULAR, LANES, Lines, exponent_of
from lagsim.native.graph.straight_line import Code, fixed_nodes, ordered

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Layout


# Longer ones would take as long to compile as straight-line code.
LONGEST = 256
# What is repeated less often, or is shorter in all, is not worth a loop.
LEAST_TIMES = 4
LEAST_LENGTH = 16


class Repeat(NamedTuple):
    """From `start` on, `times` times `period` elements, each time the same."""

    start: int
    period: int
    times: int

    @property
    def length(self) -> int:
        """How many elements they are together."""
        return self.period * self.times


def repeats(sequence: Sequence[int]) -> list[Repeat]:
    """Find stretches that repeat themselves, apart from each other, in order.

    The longest first, and of those that are equally long the one of least period.
    """
    elements = np.asarray(sequence, dtype=np.int64)
    queue = [_rank(x) for x in _all(elements)]
    heapify(queue)
    free = np.ones(len(elements) + 1, dtype=bool)
    free[-1] = False
    found = []
    while queue:
        _, period, start, times = heappop(queue)
        whole = Repeat(start, period, times)
        pieces = [
            Repeat(first, period, (end - first) // period)
            for first, end in _stretches(free, whole)
        ]
        if pieces == [whole]:
            found.append(whole)
            free[start : start + whole.length] = False
            continue
        for piece in pieces:
            if piece.times >= LEAST_TIMES and piece.length >= LEAST_LENGTH:
                heappush(queue, _rank(piece))
    return sorted(found)


def _all(elements: np.ndarray) -> Iterator[Repeat]:
    """Give all stretches that repeat themselves, however they overlap."""
    for period in range(1, min(LONGEST, len(elements) // LEAST_TIMES) + 1):
        same = np.zeros(len(elements) - period + 2, dtype=np.int8)
        same[1:-1] = elements[period:] == elements[:-period]
        starts, ends = np.flatnonzero(np.diff(same)).reshape(-1, 2).T
        times = (ends - starts) // period + 1
        worth = (times >= LEAST_TIMES) & (times * period >= LEAST_LENGTH)
        for start, count in zip(starts[worth], times[worth], strict=True):
            yield Repeat(int(start), period, int(count))


def _rank(repeat: Repeat) -> tuple[int, int, int, int]:
    return -repeat.length, repeat.period, repeat.start, repeat.times


def _stretches(free: np.ndarray, repeat: Repeat) -> list[tuple[int, int]]:
    """Give the parts of `repeat` that nothing longer has."""
    within = np.zeros(repeat.length + 2, dtype=np.int8)
    within[1:-1] = free[repeat.start : repeat.start + repeat.length]
    edges = np.flatnonzero(np.diff(within)).reshape(-1, 2) + repeat.start
    return [(start, end) for start, end in edges.tolist()]


# The operation, the exponent of a power, and which of its operands are products that
# the same step makes: most of an elimination is a - b*c.
Operation = tuple[str, float | None, tuple[bool, ...]]

# Opcodes; those of blocks begin at FIRST.
STOP, NUMBER, FIRST = range(3)

SIGNATURE = "double %t, ptr %y, ptr %p, ptr %out"

# Where an operand comes from: what t, y and p are, the value of an earlier step of the
# same time, or what an earlier step has loaded.
TIME, STATE, MEMORY, STEP, AGAIN = "t", "y", "p", "step", "again"
LOADED = (STATE, MEMORY)
RESULT: Operation = ("result", None, (False,))


class Operand(NamedTuple):
    """One operand: of STEP its place in the block, of AGAIN that and which operand."""

    kind: str
    step: int = 0
    operand: int = 0


class Step(NamedTuple):
    """An operation of a block.

    Attributes
    ----------
    stored : bool
        Its value goes to p; of RESULT to out.
    together : int
        How many steps from here on are sines and cosines that are made at once.
    """

    operation: Operation
    operands: tuple[Operand, ...]
    stored: bool
    together: int

    @property
    def fields(self) -> int:
        """How many fields it has."""
        return self.stored + sum(x.kind in LOADED for x in self.operands)


class Block(NamedTuple):
    """What an instruction does; where it `loops`, many times."""

    steps: tuple[Step, ...]
    loops: bool


def machine(opcodes: Mapping[Block, int]) -> str:
    """Give the function that runs a tape."""
    writer = _Machine()
    writer.number()
    for block, opcode in opcodes.items():
        _Block(writer, block, opcode).write()
    return writer.text()


class _Machine(Lines):
    def __init__(self) -> None:
        super().__init__()
        self.cases: list[str] = []
        self.ends: list[str] = []

    def number(self) -> None:
        """Write the block that keeps a number."""
        self.begin(NUMBER)
        place = self.address("p", "%pc", 1)
        halves = self.line("getelementptr inbounds i32, ptr %pc, i64 2")
        value = self.line(f"load double, ptr {halves}, align 4")
        self.lines.append(f"store double {value}, ptr {place}")
        self.end(NUMBER, self.line("getelementptr inbounds i32, ptr %pc, i64 4"))

    def begin(self, opcode: int) -> None:
        """Begin the block of an opcode."""
        self.lines.append(f"op{opcode}:")
        self.cases.append(f"i32 {opcode}, label %op{opcode}")

    def end(self, opcode: int, after: str, label: str = "op") -> None:
        """Go to the next instruction."""
        self.lines.append("br label %next")
        self.ends.append(f"[{after}, %{label}{opcode}]")

    def address(self, array: str, at: str, k: int) -> str:
        """Give the address in `array` that field k from `at` on tells."""
        field = self.line(f"getelementptr inbounds i32, ptr {at}, i64 {k}")
        index = self.line(f"load i32, ptr {field}")
        return self.line(f"getelementptr inbounds double, ptr %{array}, i32 {index}")

    def text(self) -> str:
        """Give the whole function."""
        head = f"ptr noalias readonly %tape, {SIGNATURE}"
        return "\n".join(
            [
                *sorted(self.declared),
                f"define internal void @tape.run({head}) {{",
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


class _Block:
    """Writes one block."""

    def __init__(self, to: _Machine, block: Block, opcode: int) -> None:
        self.to, self.opcode = to, opcode
        self.steps, self.loops = block
        self.values: list[str] = []
        self.loaded: dict[tuple[int, int], str] = {}
        self.begins = [0]
        for step in self.steps:
            self.begins.append(self.begins[-1] + step.fields)
        self.at = "%pc"

    def write(self) -> None:
        to, k = self.to, self.opcode
        to.begin(k)
        first = to.line(f"getelementptr inbounds i32, ptr %pc, i64 {1 + self.loops}")
        self.at = first
        if not self.loops:
            self._steps()
            to.end(k, self._after())
            return
        last = self.begins[-1]
        place = to.line("getelementptr inbounds i32, ptr %pc, i64 1")
        times = to.line(f"load i32, ptr {place}")
        self.at = f"%at{k}"
        to.lines += [
            f"br label %loop{k}",
            f"loop{k}:",
            f"{self.at} = phi ptr [{first}, %op{k}], [%after{k}, %loop{k}]",
            f"%left{k} = phi i32 [{times}, %op{k}], [%less{k}, %loop{k}]",
        ]
        self._steps()
        to.lines += [
            f"%after{k} = getelementptr inbounds i32, ptr {self.at}, i64 {last}",
            f"%less{k} = sub i32 %left{k}, 1",
            f"%more{k} = icmp ne i32 %less{k}, 0",
            f"br i1 %more{k}, label %loop{k}, label %done{k}",
            f"done{k}:",
        ]
        to.end(k, f"%after{k}", "done")

    def _after(self) -> str:
        last = self.begins[-1]
        return self.to.line(f"getelementptr inbounds i32, ptr {self.at}, i64 {last}")

    def _steps(self) -> None:
        for k, step in enumerate(self.steps):
            if k == len(self.values):
                self.values += self._values(k)
            if step.stored:
                array = "out" if step.operation == RESULT else "p"
                place = self.to.address(array, self.at, self.begins[k])
                self.to.lines.append(f"store double {self.values[k]}, ptr {place}")

    def _values(self, k: int) -> list[str]:
        """Give the values of what is made with step k."""
        step = self.steps[k]
        if step.together:
            return self._circular(k, step.together)
        op, exponent, products = step.operation
        given = iter([self._operand(k, i) for i in range(len(step.operands))])
        operands = []
        for place, product in enumerate(products):
            value = next(given)
            if product:
                value = self.to.operation("mul", None, [value, next(given)])
            if op in JOINING or (op == "if" and place == 0):
                value = self.to.line(f"fcmp one double {value}, 0.0")
            operands.append(value)
        if step.operation == RESULT:
            return operands
        value = self.to.operation(op, exponent, operands)
        if OPERATIONS[op].condition:
            value = self.to.line(f"uitofp i1 {value} to double")
        return [value]

    def _circular(self, k: int, together: int) -> list[str]:
        angles: dict[str, int] = {}
        wanted = []
        for j in range(k, k + together):
            angle = self._operand(j, 0)
            wanted.append(
                (self.steps[j].operation[0], angles.setdefault(angle, len(angles)))
            )
        return self.to.circular(list(angles), wanted)

    def _operand(self, k: int, i: int) -> str:
        operands = self.steps[k].operands
        kind, step, operand = operands[i]
        if kind == TIME:
            return "%t"
        if kind == STEP:
            return self.values[step]
        if kind == AGAIN:
            return self.loaded[step, operand]
        before = sum(x.kind in LOADED for x in operands[:i])
        field = self.begins[k] + self.steps[k].stored + before
        place = self.to.address(kind, self.at, field)
        value = self.to.line(f"load double, ptr {place}")
        self.loaded[k, i] = value
        return value


def circular(operation: Operation) -> bool:
    """Tell whether it is a sine or a cosine."""
    return operation[0] in CIRCULAR


# A loop is rolled out to about so many steps: several bodies' then go side by side.
ROLLED_OUT = 16
# Steps of all loops of a function: they compile in a second or two.
MOST_STEPS = 3000


class Task(NamedTuple):
    """A step of a function: `node` is made of `operands`, or written to out[place].

    `kinds` are those of the operands where nothing else is known of them.
    """

    node: int
    operation: Operation
    operands: tuple[int, ...]
    kinds: tuple[str, ...]
    place: int


def blocks(
    tasks: Sequence[Task], uses: Mapping[int, int]
) -> Iterator[tuple[Block, int]]:
    """Give the blocks that do `tasks` in order, each with how often.

    Parameters
    ----------
    uses
        How often each node is used, by tasks and others.
    """
    signs: dict[object, int] = {}
    found = repeats(
        [signs.setdefault((x.operation, x.kinds), len(signs)) for x in tasks]
    )
    made = {x.node: k for k, x in enumerate(tasks) if x.operation != RESULT}
    steps, taken = 0, []
    for repeat in sorted(found, key=lambda x: -x.length):
        steps += repeat.period
        if steps <= MOST_STEPS:
            taken.append(repeat)
    at = 0
    for start, period, times in sorted(taken):
        yield from _apart(tasks[at:start])
        more = max(1, min(ROLLED_OUT // period, times // 2))
        loop = _Loop(tasks, made, start, period * more, times // more)
        yield loop.block(uses), loop.times
        at = start + loop.times * loop.period
    yield from _apart(tasks[at:])


def _apart(tasks: Sequence[Task]) -> Iterator[tuple[Block, int]]:
    """Give a block for each of these."""
    for task in tasks:
        operands = tuple(Operand(kind) for kind in task.kinds)
        step = Step(task.operation, operands, True, int(circular(task.operation)))
        yield Block((step,), False), 1


class _Loop:
    """Tasks that repeat themselves: finds what is the same each time."""

    def __init__(
        self,
        tasks: Sequence[Task],
        made: Mapping[int, int],
        start: int,
        period: int,
        times: int,
    ) -> None:
        self.made, self.period, self.times = made, period, times
        end = start + period * times
        self.starts = range(start, end, period)
        # For each step of the loop its tasks, time by time.
        self.columns = [tasks[start + j : end : period] for j in range(period)]

    def block(self, uses: Mapping[int, int]) -> Block:
        """Give the block of the loop."""
        operands = self._operands()
        inside = Counter(x.step for row in operands for x in row if x.kind == STEP)
        together = self._together(operands)
        steps = [
            Step(
                column[0].operation,
                operands[j],
                column[0].operation == RESULT
                or any(uses[task.node] != inside[j] for task in column),
                together[j],
            )
            for j, column in enumerate(self.columns)
        ]
        return Block(tuple(steps), True)

    def _operands(self) -> list[tuple[Operand, ...]]:
        loaded: dict[int, tuple[int, int]] = {}
        rows = []
        for j, column in enumerate(self.columns):
            row = []
            for i, kind in enumerate(column[0].kinds):
                operand = self._operand(j, i, kind, loaded)
                if operand.kind not in (STEP, AGAIN, TIME):
                    loaded[column[0].operands[i]] = j, i
                row.append(operand)
            rows.append(tuple(row))
        return rows

    def _operand(
        self, j: int, i: int, kind: str, loaded: Mapping[int, tuple[int, int]]
    ) -> Operand:
        if kind == TIME:
            return Operand(TIME)
        nodes = [task.operands[i] for task in self.columns[j]]
        by = self.made.get(nodes[0], -1) - self.starts[0]
        if 0 <= by < j and nodes == [task.node for task in self.columns[by]]:
            return Operand(STEP, by)
        if nodes[0] in loaded:
            step, operand = loaded[nodes[0]]
            if nodes == [task.operands[operand] for task in self.columns[step]]:
                return Operand(AGAIN, step, operand)
        return Operand(kind)

    def _together(self, operands: Sequence[tuple[Operand, ...]]) -> list[int]:
        """Give how many sines and cosines from each step on are made at once."""
        found = [0] * self.period
        j = 0
        while j < self.period:
            first, angles = j, set[Operand]()
            while j < self.period and self._joins(first, j, operands, angles):
                j += 1
            found[first] = j - first
            j = max(j, first + 1)
        return found

    def _joins(
        self,
        first: int,
        j: int,
        operands: Sequence[tuple[Operand, ...]],
        angles: set[Operand],
    ) -> bool:
        """Tell whether step j can be made at once with those from `first` on."""
        column = self.columns[j]
        if not circular(column[0].operation):
            return False
        [operand] = operands[j]
        if operand.kind == STEP and operand.step >= first:
            return False
        waits = operand.kind == MEMORY and any(
            start + first <= self.made.get(task.operands[0], -1) < start + j
            for start, task in zip(self.starts, column, strict=True)
        )
        fresh = operand.kind not in (STEP, AGAIN)
        angle = Operand(AGAIN, j, 0) if fresh else operand
        if waits or len(angles | {angle}) > LANES:
            return False
        angles.add(angle)
        return True


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
