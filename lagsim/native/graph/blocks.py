"""The steps of a function, as blocks of the machine: what repeats itself in loops."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from lagsim.native.graph.machine import (
    AGAIN,
    MEMORY,
    RESULT,
    STEP,
    TIME,
    Block,
    Operand,
    Operation,
    Step,
    circular,
)
from lagsim.native.graph.repeats import repeats
from lagsim.native.graph.sincos import LANES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

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
