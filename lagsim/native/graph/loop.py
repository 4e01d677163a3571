"""A Taylor series as one loop over its order.

The inner sums of all products of one order, a_1 b_(k-1) + ... + a_(k-1) b_1, are
computed side by side in the lanes of vectors: the row of an order holds the first
factors of all products, then the second ones, and sums advance row by row. Sums of two
orders are computed together, since loads take longer than products. The other
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
# numbers in it, which were stored separately, have left the processor's store buffer
# (measured: 600 -> 480 ns with 15 sums; with 69 sums this takes longer than it saves).
MOST_EDGES = 32

_MORE = ", ptr %w, ptr %row, ptr %orders, ptr %ones"
# Sums over j of a[j] b[-j] and of a[j] b[1 - j], where row j follows row j - 1 after so
# many bytes; b[1] is at `first`, and `last` at the end of the second sum stands for
# a[count]. A vector is loaded once for both.
_SUMS = """\
define internal void @sums(ptr %a, ptr %b, i64 %count, ptr %first, ptr %last, ptr %to,
                           ptr %ahead) {{
entry:
%begin = load {vector}, ptr %first, align {align}
%any = icmp sgt i64 %count, 0
br i1 %any, label %each, label %done
each:
%j = phi i64 [0, %entry], [%next, %each]
%sum = phi {vector} [zeroinitializer, %entry], [%more, %each]
%sum.2 = phi {vector} [zeroinitializer, %entry], [%more.2, %each]
%before = phi {vector} [%begin, %entry], [%y, %each]
%at = mul i64 %j, {row_bytes}
%back = sub i64 0, %at
%a.j = getelementptr i8, ptr %a, i64 %at
%b.j = getelementptr i8, ptr %b, i64 %back
%x = load {vector}, ptr %a.j, align {align}
%y = load {vector}, ptr %b.j, align {align}
%product = fmul contract {vector} %x, %y
%more = fadd contract {vector} %product, %sum
%product.2 = fmul contract {vector} %x, %before
%more.2 = fadd contract {vector} %product.2, %sum.2
%next = add i64 %j, 1
%again = icmp slt i64 %next, %count
br i1 %again, label %each, label %done
done:
%all = phi {vector} [zeroinitializer, %entry], [%more, %each]
%all.2 = phi {vector} [zeroinitializer, %entry], [%more.2, %each]
%y.1 = phi {vector} [%begin, %entry], [%y, %each]
%x.1 = load {vector}, ptr %last, align {align}
%end = fmul contract {vector} %x.1, %y.1
%both = fadd contract {vector} %end, %all.2
store {vector} %all, ptr %to, align {align}
store {vector} %both, ptr %ahead, align {align}
ret void
}}
define internal void @with.ends(ptr %a, ptr %b, ptr %c, ptr %d, ptr %sum, ptr %to) {{
%x = load {vector}, ptr %a, align {align}
%y = load {vector}, ptr %b, align {align}
%z = load {vector}, ptr %c, align {align}
%w = load {vector}, ptr %d, align {align}
%before = load {vector}, ptr %sum, align {align}
%one = fmul contract {vector} %x, %y
%more = fadd contract {vector} %one, %before
%other = fmul contract {vector} %z, %w
%all = fadd contract {vector} %other, %more
store {vector} %all, ptr %to, align {align}
ret void
}}"""
# The sums of orders k and k + 1 are computed together, k = 1, 3, ..., those of order k
# + 1 but for the first and last term, of the coefficients of order k. Where the code of
# an order computes these terms for the next one, sums of order k lack them, too; the
# one term of order 2 is at both ends.
_SERIES = """\
@{name}.orders = private constant [{entries} x double] [{orders}], align 8
@{name}.zeros = private constant [{row} x double] zeroinitializer, align {align}
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
%k = phi i64 [1, %entry], [%k.3, %second]
%is.1 = icmp eq i64 %k, 1
%count = sub i64 %k, {left}
%at = mul i64 %k, {row}
%row = getelementptr double, ptr %rows.0, i64 %at
%row.1 = getelementptr double, ptr %rows.0, i64 {row}
%before = getelementptr double, ptr %row, i64 -{row}
%ends = select i1 %is.1, ptr @{name}.zeros, ptr {before}
%a = getelementptr double, ptr %rows.0, i64 {first_at}
%b = getelementptr double, ptr %row, i64 -{first_at}
{sums}
%orders.at = mul i64 %k, {each}
%orders = getelementptr double, ptr %orders.0, i64 %orders.at
%ones = select i1 %is.1, ptr @{name}.zeros, ptr %row.1
%k.2 = add i64 %k, 1
%ahead = mul i64 %k.2, {size}
%there = getelementptr double, ptr %out, i64 1
%row.out = getelementptr double, ptr %there, i64 %ahead
call void @{name}.order({called})
%more = icmp slt i64 %k.2, {last}
br i1 %more, label %second, label %end
second:
%newest = select i1 %is.1, ptr %row.1, ptr {newest}
%other = select i1 %is.1, ptr @{name}.zeros, ptr {other}
{with_ends}
%row.2 = getelementptr double, ptr %row, i64 {row}
%orders.2 = getelementptr double, ptr %orders, i64 {each}
%row.out.2 = getelementptr double, ptr %row.out, i64 {size}
call void @{name}.order({called_next})
%k.3 = add i64 %k, 2
%again = icmp slt i64 %k.3, {last}
br i1 %again, label %order, label %end
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
    # Words from w on: the sums, those of the next order, their ends, values computed
    # once, and the rows.
    padded = -(-count // TOGETHER) * TOGETHER
    kept_at = 2 * padded + len(edges)
    rows_at = -(-(kept_at + len(once)) // TOGETHER) * TOGETHER
    kept = {n: ("w", kept_at + i) for i, n in enumerate(once)}
    begin = [(n, ("out", 1 + i)) for i, n in enumerate((*r.state, *r.rates))]
    begin += [(g.zero, ("w", 2 * padded + i)) for i in range(len(edges))]
    begin += kept.items()
    internal: dict[str, Any] = {"more": _MORE, "linkage": "internal "}
    w.function(f"{name}.start", begin, places, **internal)
    rows = [i for j in range(count) for i in (j, padded + j)]
    found = {**places, **kept}
    found |= {n: ("w", i) for i, n in enumerate(r.sums)}
    found |= {n: ("w", 2 * padded + i) for i, n in enumerate(edges)}
    found |= {n: ("ones", i) for i, n in zip(rows, firsts, strict=False)}
    found |= {n: ("out", i - size) for i, n in enumerate(r.carried)}
    found |= {n: ("orders", i) for i, n in enumerate(numbers)}
    stores = [(n, ("out", i)) for i, n in enumerate(made[:size])]
    factors = made[size : size + 2 * count]
    ends = made[size + 2 * count :]
    stores += [(n, ("w", 2 * padded + i)) for i, n in enumerate(ends)]
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
    zeros = f"@{name}.zeros"
    sums, with_ends = _sums(w, padded)
    called = f"{w.signature}{_MORE}".replace("%out", "%row.out")
    called_next = f"{w.signature}, ptr %w, ptr %row.2, ptr %orders.2, ptr %row.1"
    text = _SERIES.format(
        name=name, signature=w.signature, base=base, align=LINE_BYTES,
        mask=LINE_BYTES - 1, order=number(loop.order), last=loop.order,
        size=size, each=len(ORDERS),
        entries=len(table), orders=", ".join(f"double {x}" for x in table),
        row=row, rows_before=rows_at - row, sums=sums, with_ends=with_ends,
        first_at=2 * row if edges else row, left=3 if edges else 1,
        before="%before" if edges else zeros,
        newest=zeros if edges else "%row.1", other=zeros if edges else "%row",
        called=called, called_next=called_next.replace("%out", "%row.out.2"),
    )  # fmt: skip
    w.lines.append(text)


def _sums(w: FunctionWriter, padded: int) -> tuple[str, str]:
    """Return code of the sums of orders k and k + 1, and declare its functions.

    The result is a pair of texts. The first calls compute all sums of order k, and of
    order k + 1 without the terms of the newest factors; the second calls add these
    terms.

    padded : the number of sums, rounded up to a multiple of TOGETHER.
    """
    text = _SUMS.format(vector=SUMS, row_bytes=16 * padded, align=LINE_BYTES)
    w.declared.add(text)
    # Each argument: its array, and the index of the first vector there.
    together = [("a", 0), ("b", padded), ("ends", padded), ("ends", 0), ("w", 0),
                ("w", padded)]  # fmt: skip
    ends = [("newest", 0), ("row", padded), ("other", 0), ("row.1", padded),
            ("w", padded), ("w", 0)]  # fmt: skip

    def calls(function: str, mark: str, places: Sequence[tuple[str, int]]) -> str:
        lines = []
        for k in range(0, padded, TOGETHER):
            names = [f"%{mark}.{i}.{k}" for i in range(len(places))]
            lines += [
                f"{name} = getelementptr double, ptr %{array}, i64 {first + k}"
                for name, (array, first) in zip(names, places, strict=True)
            ]
            arguments = [f"ptr {name}" for name in names]
            if function == "sums":
                arguments.insert(2, "i64 %count")
            lines.append(f"call void @{function}({', '.join(arguments)})")
        return "\n".join(lines)

    return calls("sums", "s", together), calls("with.ends", "e", ends)


def _with_edges(
    g: Graph, r: Recurrence, edges: Sequence[int]
) -> tuple[list[int], list[int]]:
    """Return the nodes of one order k of the series.

    The first and the last term of each sum of products are computed in advance, in the
    code of the order before.

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
    made = g.substitute(r.computed, {s: g.call("add", s, e) for s, e in parts})
    firsts, following = [], []
    factors = made[len(r.state) :]
    for i in range(len(edges)):
        a, b = factors[2 * i : 2 * i + 2]
        one, other = (g.variable(f"series.{x}.{i}") for x in ("first", "second"))
        firsts += [one, other]
        ends = g.call("mul", one, b), g.call("mul", a, other)
        following.append(g.call("add", *ends))
    return made + following, firsts
