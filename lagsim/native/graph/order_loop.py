"""A Taylor series as one loop over its order, in LLVM IR.

The inner sums of all products of one order, a_1 b_(k-1) + ... + a_(k-1) b_1, are made
side by side in the lanes of vectors: a row for each order holds the first factors of
all products, then the second ones, and a sum is row by row. What is left of an order is
straight-line code. Each sum has a lane of its own, so that how many of them the
processor takes at once changes nothing.

Memory, behind what other functions use: the sums, what the code of an order needs of
order 0, and the rows of the orders from 1 on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.language.series import ORDERS
from lagsim.native.graph.lines import number
from lagsim.native.graph.writer import hoisted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.language.series import Recurrence
    from lagsim.native.graph.keys import Loop
    from lagsim.native.graph.writer import Place, Writer

# Numbers in a vector. LLVM takes two or four registers where they are shorter.
TOGETHER = 8
VECTOR = f"<{TOGETHER} x double>"
# Vectors of sums in one loop: enough to overlap, and no more than there are registers.
AT_ONCE = 4
# The sums and rows begin where lines of the cache do.
LINE_BYTES = 64

# Where there are no more sums, their first and last terms, of the newest coefficients,
# are made one by one with the order before: a vector cannot be loaded before the
# numbers in it, which were stored alone, have left the processor's buffer (measured:
# 600 -> 480 ns with 15 sums; of 69 sums this takes longer than it saves).
MOST_EDGES = 32

_MORE = ", ptr %w, ptr %row, ptr %orders, ptr %ones"


_FUSED_NAME = f"llvm.fmuladd.v{TOGETHER}f64"
_FUSED = f"declare {VECTOR} @{_FUSED_NAME}({VECTOR}, {VECTOR}, {VECTOR})"


class _Memory:
    """Where things are, counted in numbers."""

    def __init__(self, loop: Loop, first_order: int) -> None:
        self.count = len(loop.recurrence.sums)
        self.padded = -(-self.count // TOGETHER) * TOGETHER
        self.edges = self.padded if self.count <= MOST_EDGES else 0
        self.kept = self.padded + (self.count if self.edges else 0)
        self.rows = -(-(self.kept + first_order) // TOGETHER) * TOGETHER
        self.row = 2 * self.padded
        self.size = self.rows + self.row * loop.order + LINE_BYTES // 8


def write(w: Writer, name: str, loop: Loop, places: Mapping[int, Place]) -> None:
    """Write the function `name`."""
    g, r = w.g, loop.recurrence
    size, count = len(r.state), len(r.sums)
    orders = [g.variable(x) for x in ORDERS]
    edges = [g.variable(f"series.edge.{i}") for i in range(count)]
    if count > MOST_EDGES:
        edges = []
    made, firsts = _with_edges(g, r, edges)
    once = hoisted(g, made, {*orders, *r.carried, *r.sums, *edges, *firsts})
    once = [n for n in once if n not in places]
    memory = _Memory(loop, len(once))
    kept = {n: ("w", memory.kept + i) for i, n in enumerate(once)}
    begin = [(n, ("out", 1 + i)) for i, n in enumerate((*r.state, *r.rates))]
    begin += [(g.zero, ("w", memory.edges + i)) for i in range(len(edges))]
    begin += kept.items()
    internal: dict[str, Any] = {"more": _MORE, "linkage": "internal "}
    w.function(f"{name}.start", begin, places, **internal)
    rows = [i for j in range(count) for i in (j, memory.padded + j)]
    found = {**places, **kept}
    found |= {n: ("w", i) for i, n in enumerate(r.sums)}
    found |= {n: ("w", memory.edges + i) for i, n in enumerate(edges)}
    found |= {n: ("ones", i) for i, n in zip(rows, firsts, strict=False)}
    found |= {n: ("out", i - size) for i, n in enumerate(r.carried)}
    found |= {n: ("orders", i) for i, n in enumerate(orders)}
    to = [("out", i) for i in range(size)] + [("row", i) for i in rows]
    to += [("w", memory.edges + i) for i in range(len(edges))]
    w.function(f"{name}.order", list(zip(made, to, strict=True)), found, **internal)
    base = w.scratch + w.scratch_used
    w.scratch_used += memory.size
    w.lines += _tables(name, loop, memory)
    w.lines.append(f"define void @{name}({w.signature}) {{")
    w.lines += _whole(w, name, loop, memory, base)
    w.declared.add(_FUSED)


def _with_edges(
    g: Graph, r: Recurrence, edges: Sequence[int]
) -> tuple[list[int], list[int]]:
    """Give what an order makes where the ends of its sums were made before.

    The variables `edges` hold a_1 b_(k-1) + a_(k-1) b_1; what follows as the last of
    what is made are those of the next order. With the variables of a_1, b_1 of each.
    """
    parts = zip(r.sums, edges, strict=False)
    made = g.substitute(r.made, {s: g.call("add", s, e) for s, e in parts})
    firsts, following = [], []
    factors = made[len(r.state) :]
    for i in range(len(edges)):
        a, b = factors[2 * i : 2 * i + 2]
        one, other = (g.variable(f"series.{x}.{i}") for x in ("first", "second"))
        firsts += [one, other]
        ends = g.call("mul", one, b), g.call("mul", a, other)
        following.append(g.call("add", *ends))
    return made + following, firsts


def _tables(name: str, loop: Loop, memory: _Memory) -> list[str]:
    """Write what ORDERS are of each order, and a row of zeros."""
    orders = ", ".join(
        f"double {number(x)}"
        for k in range(1, loop.order)
        for x in (k, 1.0 / k, 1.0 / (k + 1), k == 1)
    )
    table = f"[{len(ORDERS) * (loop.order - 1)} x double]"
    return [
        f"@{name}.orders = private constant {table} [{orders}], align 8",
        f"@{name}.zeros = private constant [{memory.row} x double] zeroinitializer",
    ]


def _whole(w: Writer, name: str, loop: Loop, memory: _Memory, base: int) -> list[str]:
    """Write what calls the others, order by order."""
    size, each = len(loop.recurrence.state), len(ORDERS)
    lines = [
        "entry:",
        f"%raw = getelementptr double, ptr %p, i64 {base}",
        "%address = ptrtoint ptr %raw to i64",
        "%negative = sub i64 0, %address",
        f"%missing = and i64 %negative, {LINE_BYTES - 1}",
        "%w = getelementptr i8, ptr %raw, i64 %missing",
        f"%first = getelementptr double, ptr %w, i64 {memory.rows - memory.row}",
        f"%orders.0 = getelementptr double, ptr @{name}.orders, i64 {-each}",
    ]
    null = "ptr null, ptr null, ptr null"
    called = (w.signature + _MORE).replace("%out", "%row.out")
    lines += [
        f"store double {number(loop.order)}, ptr %out",
        f"call void @{name}.start({w.signature}, ptr %w, {null})",
        "br label %order",
        "order:",
        "%k = phi i64 [1, %entry], [%next, %made]",
        f"%at = mul i64 %k, {memory.row}",
        "%row = getelementptr double, ptr %first, i64 %at",
        *_ends(memory),
    ]
    lines += _sums(memory)
    lines += [
        "made:",
        f"%entry.k = mul i64 %k, {each}",
        "%orders = getelementptr double, ptr %orders.0, i64 %entry.k",
        f"%row.1 = getelementptr double, ptr %first, i64 {memory.row}",
        "%is.1 = icmp eq i64 %k, 1",
        f"%ones = select i1 %is.1, ptr @{name}.zeros, ptr %row.1",
        "%next = add i64 %k, 1",
        f"%ahead = mul i64 %next, {size}",
        "%there = getelementptr double, ptr %out, i64 1",
        "%row.out = getelementptr double, ptr %there, i64 %ahead",
        f"call void @{name}.order({called})",
        f"%more = icmp slt i64 %next, {loop.order}",
        "br i1 %more, label %order, label %end",
        "end:",
        "ret void",
        "}",
    ]
    return lines


def _ends(memory: _Memory) -> list[str]:
    """Write which terms the sums have: from %begin on, before %end.

    Those of order 2 have one, which is at both ends.
    """
    one, all_ = ("2", "-1") if memory.edges else ("1", "0")
    return [
        "%is.2 = icmp eq i64 %k, 2",
        f"%begin = select i1 %is.2, i64 1, i64 {one}",
        f"%short = add i64 %k, {all_}",
        "%stop = select i1 %is.2, i64 2, i64 %short",
        "%some = icmp slt i64 %begin, %stop",
        f"%a.at = mul i64 %begin, {memory.row}",
        "%a.row = getelementptr double, ptr %first, i64 %a.at",
        "%back = sub i64 0, %a.at",
        "%b.row = getelementptr double, ptr %row, i64 %back",
    ]


def _sums(memory: _Memory) -> list[str]:
    """Write the loops over j, of AT_ONCE vectors of sums each."""
    lines: list[str] = []
    starts = list(range(0, memory.padded, AT_ONCE * TOGETHER))
    label = "order"
    for i, start in enumerate(starts):
        after = f"sums.{i + 1}" if i + 1 < len(starts) else "made"
        lines += _some_sums(i, start, label, after, memory)
        if after != "made":
            lines.append(f"{after}:")
        label = after
    return lines or ["br label %made"]


def _some_sums(
    i: int, start: int, before: str, after: str, memory: _Memory
) -> list[str]:
    """Write the loop over j for the sums from `start` on."""
    vectors = range(start, min(start + AT_ONCE * TOGETHER, memory.padded), TOGETHER)
    loop, done = f"each.{i}", f"done.{i}"
    back = -8 * memory.row
    lines = [
        f"%a.{i} = getelementptr double, ptr %a.row, i64 {start}",
        f"%b.{i} = getelementptr double, ptr %b.row, i64 {memory.padded + start}",
        f"br i1 %some, label %{loop}, label %{done}",
        f"{loop}:",
        f"%j.{i} = phi i64 [%begin, %{before}], [%j.{i}.next, %{loop}]",
        f"%a.{i}.j = phi ptr [%a.{i}, %{before}], [%a.{i}.next, %{loop}]",
        f"%b.{i}.j = phi ptr [%b.{i}, %{before}], [%b.{i}.next, %{loop}]",
    ]
    lines += [
        f"%s.{v} = phi {VECTOR} [zeroinitializer, %{before}], [%s.{v}.next, %{loop}]"
        for v in vectors
    ]
    for v in vectors:
        for x in "ab":
            lines += [
                f"%{x}.{v}.at = getelementptr double, ptr %{x}.{i}.j, i64 {v - start}",
                f"%{x}.{v}.is = load {VECTOR}, ptr %{x}.{v}.at, align {LINE_BYTES}",
            ]
        operands = f"{VECTOR} %a.{v}.is, {VECTOR} %b.{v}.is, {VECTOR} %s.{v}"
        lines.append(f"%s.{v}.next = call {VECTOR} @{_FUSED_NAME}({operands})")
    lines += [
        f"%a.{i}.next = getelementptr i8, ptr %a.{i}.j, i64 {-back}",
        f"%b.{i}.next = getelementptr i8, ptr %b.{i}.j, i64 {back}",
        f"%j.{i}.next = add i64 %j.{i}, 1",
        f"%again.{i} = icmp slt i64 %j.{i}.next, %stop",
        f"br i1 %again.{i}, label %{loop}, label %{done}",
        f"{done}:",
    ]
    for v in vectors:
        zero = f"[zeroinitializer, %{before}]"
        lines.append(f"%s.{v}.all = phi {VECTOR} {zero}, [%s.{v}.next, %{loop}]")
    for v in vectors:
        lines += [
            f"%s.{v}.to = getelementptr double, ptr %w, i64 {v}",
            f"store {VECTOR} %s.{v}.all, ptr %s.{v}.to, align {LINE_BYTES}",
        ]
    return [*lines, f"br label %{after}"]
