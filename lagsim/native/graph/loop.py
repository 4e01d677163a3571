"""A Taylor series as one loop over its order.

The inner sums of all products of one order, a_1 b_(k-1) + ... + a_(k-1) b_1, are
computed side by side in the lanes of vectors: the row of an order holds the first
factors of all products, then the second ones, and sums advance row by row. The other
operations of an order are straight-line code. Each sum has a lane of its own, so that
the width of the processor's vectors does not change the result. The memory of a series,
behind the scratch memory of other functions, holds the sums, the values of order 0 that
the code of an order uses, and the rows of the orders from 1 on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.language.series import ORDERS
from lagsim.native.graph.lines import hoisted, number
from lagsim.native.graph.writer import LINE_BYTES, SUMS, TOGETHER

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.language.series import Recurrence
    from lagsim.native.graph.keys import Loop
    from lagsim.native.graph.writer import FunctionWriter, Place

# Up to this number of sums, their first and last terms, of the newest coefficients, are
# computed one by one with the order before: a vector cannot be loaded before the
# numbers in it, which were stored alone, have left the processor's buffer (measured:
# 600 -> 480 ns with 15 sums; of 69 sums this takes longer than it saves).
MOST_EDGES = 32

_MORE = ", ptr %w, ptr %row, ptr %orders, ptr %ones"
# Sums over j of a[j] b[-j], where row j follows row j - 1 after so many bytes.
_SUMS = """\
define internal void @sums(ptr %a, ptr %b, i64 %count, ptr %to) {{
entry:
%some = icmp sgt i64 %count, 0
br i1 %some, label %each, label %done
each:
%j = phi i64 [0, %entry], [%next, %each]
%sum = phi {vector} [zeroinitializer, %entry], [%more, %each]
%ahead = mul i64 %j, {row_bytes}
%back = sub i64 0, %ahead
%a.j = getelementptr i8, ptr %a, i64 %ahead
%b.j = getelementptr i8, ptr %b, i64 %back
%x = load {vector}, ptr %a.j, align {align}
%y = load {vector}, ptr %b.j, align {align}
%product = fmul contract {vector} %x, %y
%more = fadd contract {vector} %product, %sum
%next = add i64 %j, 1
%again = icmp slt i64 %next, %count
br i1 %again, label %each, label %done
done:
%all = phi {vector} [zeroinitializer, %entry], [%more, %each]
store {vector} %all, ptr %to, align {align}
ret void
}}"""
# The sums of order k > 2 have terms from j = `first` to k - 1 - `left`; that of order 2
# has one, which is at both ends.
_SERIES = """\
@{name}.orders = private constant [{entries} x double] [{orders}], align 8
@{name}.zeros = private constant [{row} x double] zeroinitializer
define void @{name}({signature}) {{
entry:
%raw = getelementptr double, ptr %p, i64 {base}
%address = ptrtoint ptr %raw to i64
%negative = sub i64 0, %address
%missing = and i64 %negative, {mask}
%w = getelementptr i8, ptr %raw, i64 %missing
%rows.0 = getelementptr double, ptr %w, i64 {rows_before}
%orders.0 = getelementptr double, ptr @{name}.orders, i64 -{each}
store double {order}, ptr %out
call void @{name}.start({signature}, ptr %w, ptr null, ptr null, ptr null)
br label %order
order:
%k = phi i64 [1, %entry], [%next, %order]
%is.2 = icmp eq i64 %k, 2
%begin = select i1 %is.2, i64 1, i64 {first}
%stop = sub i64 %k, {left}
%end.j = select i1 %is.2, i64 2, i64 %stop
%count = sub i64 %end.j, %begin
%at = mul i64 %k, {row}
%row = getelementptr double, ptr %rows.0, i64 %at
%a.at = mul i64 %begin, {row}
%a = getelementptr double, ptr %rows.0, i64 %a.at
%back = sub i64 0, %a.at
%b = getelementptr double, ptr %row, i64 %back
{sums}
%orders.at = mul i64 %k, {each}
%orders = getelementptr double, ptr %orders.0, i64 %orders.at
%row.1 = getelementptr double, ptr %rows.0, i64 {row}
%is.1 = icmp eq i64 %k, 1
%ones = select i1 %is.1, ptr @{name}.zeros, ptr %row.1
%next = add i64 %k, 1
%ahead = mul i64 %next, {size}
%there = getelementptr double, ptr %out, i64 1
%row.out = getelementptr double, ptr %there, i64 %ahead
call void @{name}.order({called})
%more = icmp slt i64 %next, {last}
br i1 %more, label %order, label %end
end:
ret void
}}"""


def write(
    w: FunctionWriter, name: str, loop: Loop, places: Mapping[int, Place]
) -> None:
    """Write the function `name`, which evaluates a Taylor series by a loop.

    w : writer to whose lines the code is added.
    loop : the series.
    places : graph nodes that `prepare` has evaluated, with the places of their values
        in memory.
    """
    g, r = w.g, loop.recurrence
    size, count = len(r.state), len(r.sums)
    numbers = [g.variable(x) for x in ORDERS]
    edges = [g.variable(f"series.edge.{i}") for i in range(count)]
    if count > MOST_EDGES:
        edges = []
    made, firsts = _with_edges(g, r, edges)
    once = hoisted(g, made, {*numbers, *r.carried, *r.sums, *edges, *firsts})
    once = [n for n in once if n not in places]
    # Words from w on: the sums, their ends, values computed once, and the rows.
    padded = -(-count // TOGETHER) * TOGETHER
    kept_at = padded + len(edges)
    rows_at = -(-(kept_at + len(once)) // TOGETHER) * TOGETHER
    kept = {n: ("w", kept_at + i) for i, n in enumerate(once)}
    begin = [(n, ("out", 1 + i)) for i, n in enumerate((*r.state, *r.rates))]
    begin += [(g.zero, ("w", padded + i)) for i in range(len(edges))]
    begin += kept.items()
    internal: dict[str, Any] = {"more": _MORE, "linkage": "internal "}
    w.function(f"{name}.start", begin, places, **internal)
    rows = [i for j in range(count) for i in (j, padded + j)]
    found = {**places, **kept}
    found |= {n: ("w", i) for i, n in enumerate(r.sums)}
    found |= {n: ("w", padded + i) for i, n in enumerate(edges)}
    found |= {n: ("ones", i) for i, n in zip(rows, firsts, strict=False)}
    found |= {n: ("out", i - size) for i, n in enumerate(r.carried)}
    found |= {n: ("orders", i) for i, n in enumerate(numbers)}
    stores = [(n, ("out", i)) for i, n in enumerate(made[:size])]
    factors = made[size : size + 2 * count]
    ends = made[size + 2 * count :]
    stores += [(n, ("w", padded + i)) for i, n in enumerate(ends)]
    vectors = [
        (factors[which : 2 * count : 2][k : k + TOGETHER], ("row", which * padded + k))
        for which in range(2)
        for k in range(0, count, TOGETHER)
    ]
    w.function(f"{name}.order", stores, found, **internal, vectors=vectors)
    base = w.scratch + w.scratch_used
    row = 2 * padded
    w.scratch_used += rows_at + row * loop.order + LINE_BYTES // 8
    table = [
        number(x)
        for k in range(1, loop.order)
        for x in (k, 1.0 / k, 1.0 / (k + 1), k == 1)
    ]
    text = _SERIES.format(
        name=name, signature=w.signature, base=base, align=LINE_BYTES,
        mask=LINE_BYTES - 1, order=number(loop.order), last=loop.order,
        size=size, each=len(ORDERS),
        entries=len(table), orders=", ".join(f"double {x}" for x in table),
        row=row, rows_before=rows_at - row, sums=_sums(w, padded),
        first=2 if edges else 1, left=1 if edges else 0,
        called=(w.signature + _MORE).replace("%out", "%row.out"),
    )  # fmt: skip
    w.lines.append(text)


def _sums(w: FunctionWriter, padded: int) -> str:
    """Return the calls that compute the sums of an order; declare their function.

    padded : the number of sums, rounded up to a multiple of TOGETHER.
    """
    text = _SUMS.format(vector=SUMS, row_bytes=16 * padded, align=LINE_BYTES)
    w.declared.add(text)
    calls = []
    for k in range(0, padded, TOGETHER):
        calls += [
            f"%a.{k} = getelementptr double, ptr %a, i64 {k}",
            f"%b.{k} = getelementptr double, ptr %b, i64 {padded + k}",
            f"%to.{k} = getelementptr double, ptr %w, i64 {k}",
            f"call void @sums(ptr %a.{k}, ptr %b.{k}, i64 %count, ptr %to.{k})",
        ]
    return "\n".join(calls)


def _with_edges(
    g: Graph, r: Recurrence, edges: Sequence[int]
) -> tuple[list[int], list[int]]:
    """Return the nodes of an order k, whose first and last terms are computed before.

    r : the recurrence.
    edges : for each sum of products, a variable with its two terms a_1 b_(k-1) +
        a_(k-1) b_1, which the code of the order before has computed.

    Returns
    -------
    made : list of node
        The nodes to compute in an order; the last ones are the edges of the next order.
    firsts : list of node
        The variables of a_1 and b_1 of each sum.
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
