"""Elements -> a function that evaluates their sums by a loop over the members.

The function copies the values that the slots read into rows, one for each position of a
column of the table, with the slots of that column side by side. The loop reads the
positions of a member, evaluates the term, and adds its outputs to sums beside the rows.
At the end the sums are added to the results, which precede the rows in memory. Its code
contains neither the number of members nor that of arguments but as bounds of loops.

In a column with about as many positions as members, as in strings and nets, a row would
be read only once: the loop then reads each member's arguments where they are, and adds
to the results.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.elements import EACH, SHARED
from lagsim.language.graph import CONSTANT, TRUTH
from lagsim.native.graph.lines import Lines, exponent_of, number

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Ints
    from lagsim.language.elements import Elements, Slot


class MemberColumn(NamedTuple):
    """Memory of a column of the table; indices count doubles from the results on.

    Attributes
    ----------
    length : int
        Number of positions.
    slots : list of int
        Slots that are read at a position, by their indices.
    outputs : list of int
        Outputs that are added up at a position, by their indices.
    first : int
        Index of the first row.
    width : int
        Length of a row: a value for each slot, then the sums.
    direct : bool
        Whether members read arguments, and add to the results, without rows. Roundoff
        bounds need the running sum of each output, and have rows of sums alone.
    """

    length: int
    slots: list[int]
    outputs: list[int]
    first: int
    width: int
    direct: bool

    @property
    def copied(self) -> list[int]:
        """Slots whose values the rows hold."""
        return [] if self.direct else self.slots


# Members for each position of a column from which on its arguments are copied to rows.
PER_POSITION = 2


def columns(of: Elements) -> dict[int, MemberColumn]:
    """Return the memory layout of each column of the table of members, by its index.

    SHARED, the column of arguments that all members share, has a single position.
    """
    found: dict[int, MemberColumn] = {}
    first = of.size
    each = 2 if of.bounds else 1
    for c in (SHARED, *range(of.table.shape[1])):
        own = [k for k, slot in enumerate(of.slots) if slot.column == c]
        added = [
            k for k, o in enumerate(of.outputs)
            if (c == SHARED if o.slot < 0 else of.slots[o.slot].column == c)
        ]  # fmt: skip
        lengths = [max(len(of.slots[k].places), len(of.slots[k].numbers)) for k in own]
        length = max(lengths, default=1)
        direct = c != SHARED and of.members < PER_POSITION * length
        width = 0 if direct else len(own)
        width += 0 if direct and not of.bounds else each * len(added)
        found[c] = MemberColumn(length, own, added, first, width, direct)
        first += length * width
    return found


def words(of: Elements) -> int:
    """Return the number of doubles that the vector of sums and all rows occupy."""
    return of.size + sum(x.length * x.width for x in columns(of).values())


def name_of(of: Elements) -> str:
    """Return the name of the function of some elements."""
    return f"elements.{of.digest}"


class MembersFunction(Lines):
    """Writer of the function `(ptr %at, ptr %p)` that evaluates the sums of elements.

    %at points to integers: the index in p of the vector of sums, then the index in p of
    each argument.

    Parameters
    ----------
    of : Elements
    """

    def __init__(self, of: Elements) -> None:
        super().__init__()
        self.of, self.columns = of, columns(of)
        self.name = name_of(of)
        self._blocks = 0
        self.declared.add("declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)")
        where = self.line("load i32, ptr %at")
        self.results = self.line(f"getelementptr double, ptr %p, i32 {where}")
        size = 8 * words(of)
        self.lines.append(
            f"call void @llvm.memset.p0.i64(ptr {self.results}, i8 0, i64 {size}, i1 0)"
        )
        for column in self.columns.values():
            self._read(column)
        self._loop(of.members, self._member)
        for column in self.columns.values():
            self._add_up(column)
        self.lines = [
            f"define internal void @{self.name}(ptr %at, ptr %p) {{",
            *self.lines,
            "ret void",
            "}",
        ]

    def _loop(self, count: int, body: Callable[[str], None]) -> None:
        """Write a loop over k = 0 ... count - 1.

        body : function of the name of k, which writes the code of one pass.
        """
        if not count:
            return
        self._blocks += 1
        b = self._blocks
        before, head = f"before{b}", f"head{b}"
        self.lines += [
            f"br label %{before}",
            f"{before}:",
            f"br label %{head}",
            f"{head}:",
            f"%k{b} = phi i64 [0, %{before}], [%next{b}, %{head}]",
        ]
        body(f"%k{b}")
        self.lines += [
            f"%next{b} = add i64 %k{b}, 1",
            f"%more{b} = icmp slt i64 %next{b}, {count}",
            f"br i1 %more{b}, label %{head}, label %after{b}",
            f"after{b}:",
        ]

    def _table(self, numbers: Ints) -> str:
        """Declare `numbers` as an array of integers of 32 bits; return its name."""
        return self._constant(np.ascontiguousarray(numbers, np.int32).tobytes())

    def _constant(self, data: bytes) -> str:
        """Declare a constant array of bytes, and return its name."""
        import hashlib

        name = f"@members.{hashlib.sha256(data).hexdigest()}"
        text = "\\" + data.hex("\\")
        kind = f"private constant [{len(data)} x i8]"
        self.declared.add(f'{name} = {kind} c"{text}", align 8')
        return name

    def _whole(self, table: str, k: str) -> str:
        """Write code that loads number k of a table of integers; return its name."""
        place = self.line(f"getelementptr i32, ptr {table}, i64 {k}")
        return self.line(f"load i32, ptr {place}")

    def _row(self, column: MemberColumn, k: str) -> str:
        """Write code for the address of row k of a column; return the address's name.

        column : the column's memory.
        k : the name, in the code, of the row's number.
        """
        start = f"getelementptr double, ptr {self.results}, i64 {column.first}"
        if column.length == 1:
            return self.line(start)
        at = self.line(f"mul i64 {k}, {column.width}")
        first = self.line(start)
        return self.line(f"getelementptr double, ptr {first}, i64 {at}")

    def _load(self, row: str, k: int | str) -> str:
        place = self.line(f"getelementptr double, ptr {row}, i64 {k}")
        return self.line(f"load double, ptr {place}")

    def _add(self, value: str, row: str, k: int | str) -> str:
        """Write code that adds a value to an element in memory; return the sum's name.

        value : name of the value.
        row : name of the address of an array.
        k : index of the element.
        """
        place = self.line(f"getelementptr double, ptr {row}, i64 {k}")
        old = self.line(f"load double, ptr {place}")
        new = self.line(f"fadd double {old}, {value}")
        self.lines.append(f"store double {new}, ptr {place}")
        return new

    def _read(self, column: MemberColumn) -> None:
        """Write the loop that copies the values of a column's slots into its rows.

        The rows in memory have an entry for each slot that is read at a position.
        """
        sources = []
        for k in column.copied:
            slot = self.of.slots[k]
            numbers = len(slot.numbers) > 0
            data = (
                self._constant(np.ascontiguousarray(slot.numbers, float).tobytes())
                if numbers
                else self._table(1 + np.asarray(slot.places))
            )
            sources.append((data, numbers))

        def copied(k: str) -> None:
            row = self._row(column, k)
            for i, (data, numbers) in enumerate(sources):
                if numbers:
                    value = self._load(data, k)
                else:
                    index = self._whole("%at", self._wide(self._whole(data, k)))
                    value = self._load("%p", self._wide(index))
                place = self.line(f"getelementptr double, ptr {row}, i64 {i}")
                self.lines.append(f"store double {value}, ptr {place}")

        if sources:
            self._loop(column.length, copied)

    def _wide(self, index: str) -> str:
        return self.line(f"sext i32 {index} to i64")

    def _member(self, m: str) -> None:
        """Write the code that adds the terms of one member to the rows it uses.

        The rows are those of the member's positions.

        m : name of the member's number.
        """
        values, rows = dict[int, str](), dict[int, str]()
        for c, column in self.columns.items():
            if column.direct:
                slots = [self.of.slots[s] for s in column.slots]
                values |= {slot.node: self._argument(slot, m) for slot in slots}
            if column.width:
                rows[c] = self._row_of(c, m)
            for i, s in enumerate(column.copied):
                values[self.of.slots[s].node] = self._load(rows[c], i)
        self._term(values)
        for c, column in self.columns.items():
            for i in range(len(column.outputs)):
                self._add_output(column, i, m, rows.get(c, ""), values)

    def _row_of(self, c: int, m: str) -> str:
        """Write code for the address of a member's row; return the address's name.

        c : the column of the row's position.
        m : name of the member's number.
        """
        k = m
        if c != SHARED:
            at = self.line(f"mul i64 {m}, {self.of.table.shape[1]}")
            at = self.line(f"add i64 {at}, {c}")
            k = self._wide(self._whole(self._table(self.of.table), at))
        return self._row(self.columns[c], k)

    def _add_output(
        self, column: MemberColumn, i: int, m: str, row: str, values: dict[int, str]
    ) -> None:
        """Write code that adds output i of a column, in one member, to its sum.

        m : name of the member's number.
        row : name of the address of the member's row; "" for a column without rows.
        values : node of the term -> name of its value.
        """
        of, j = self.of, column.outputs[i]
        output, value = of.outputs[j], values[of.outputs[j].node]
        if output.slot == EACH:
            place = f"getelementptr double, ptr {self.results}, i64 {m}"
            self.lines.append(f"store double {value}, ptr {self.line(place)}")
            return
        if not row:
            to = self._whole(self._table(of.targets(output)), m)
            self._add(value, self.results, self._wide(to))
            return
        first = len(column.copied) + (2 if of.bounds else 1) * i
        total = self._add(value, row, first)
        if output.error is not None:
            error = values[output.error]
            if not of.alone[j]:
                size = self.operation("abs", None, [total])
                error = self.line(f"fadd double {error}, {size}")
            self._add(error, row, first + 1)

    def _argument(self, slot: Slot, m: str) -> str:
        """Write code that reads a slot's value in member m; return the value's name."""
        positions = self.of.table[:, slot.column]
        if len(slot.numbers):
            numbers = np.ascontiguousarray(slot.numbers[positions], float)
            return self._load(self._constant(numbers.tobytes()), m)
        place = self._whole(self._table(slot.places[positions]), m)
        after = self.line("getelementptr i32, ptr %at, i64 1")
        return self._load("%p", self._wide(self._whole(after, self._wide(place))))

    def _term(self, values: dict[int, str]) -> None:
        """Write the evaluation of the term's nodes for a member.

        values : node of the term -> name of its value; has the slots at first, and all
            nodes at the end.
        """
        g = self.of.graph
        for n in self.of.cone:
            if n in values:
                continue
            if g.ops[n] == CONSTANT:
                values[n] = number(float(g.payload(n)))
            elif g.ops[n] == TRUTH:
                values[n] = "true" if g.payload(n) else "false"
            else:
                operands = [values[a] for a in g.args[n]]
                values[n] = self.operation(g.ops[n], exponent_of(g, n), operands)

    def _add_up(self, column: MemberColumn) -> None:
        """Write the loop over a column's positions that adds up the results.

        The sums over members at a position, which the row of the position holds, are
        added to the components of the vector of sums that belong to the position.
        """
        of, each = self.of, 2 if self.of.bounds else 1
        added = [
            (len(column.copied) + each * i + each - 1, of.outputs[j].slot)
            for i, j in enumerate(column.outputs)
            if of.outputs[j].slot != EACH and column.width
        ]

        def scattered(k: str) -> None:
            row = self._row(column, k)
            for at, slot in added:
                value, place = self._load(row, at), "0"
                if slot >= 0:
                    table = self._table(of.slots[slot].places)
                    place = self._wide(self._whole(table, k))
                self._add(value, self.results, place)

        if added:
            self._loop(column.length, scattered)


def written(elements: Sequence[Elements]) -> tuple[set[str], list[str]]:
    """Return declarations and IR lines of the functions of the given elements."""
    made = [MembersFunction(of) for of in elements]
    declared = set().union(*(x.declared for x in made))
    return declared, [line for x in made for line in x.lines]
