"""The small machine that runs tapes: a block of IR for each of its opcodes.

An instruction is an opcode, how many times it is done, and then each time the fields of
its steps: 32 bits each, the index to which a value goes and those of operands that are
not made by the same instruction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import JOINING, OPERATIONS
from lagsim.native.graph.lines import CIRCULAR, Lines

if TYPE_CHECKING:
    from collections.abc import Mapping

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
