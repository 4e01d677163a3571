"""Graph -> LLVM IR: each function of a model as straight-line code, or as a loop.

Every function is `void f(double t, ptr y, ptr p, ptr out)`. The function `prepare`
evaluates expressions of parameters alone once, and stores their values in the tail of
`p`. Long functions are cut into pieces that pass values through scratch memory in p, so
that compile time grows in proportion to length.

A Taylor series is one loop over its order. The inner sums of all products of one order,
a_1 b_(k-1) + ... + a_(k-1) b_1, are computed side by side in the lanes of vectors: the
row of an order holds the first factors of all products, then the second ones, and sums
advance row by row. The other operations of an order are straight-line code. Each sum
has a lane of its own, so that the width of the processor's vectors does not change the
result. The memory of a series, behind the scratch memory of other functions, holds the
sums, the values of order 0 that the code of an order uses, and the rows of the orders
from 1 on.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, DATA, TRUTH, VARIABLE
from lagsim.language.series import ORDERS
from lagsim.native.graph import keys, tapes
from lagsim.native.graph.lines import (
    CIRCULAR,
    CLEAR,
    LANES,
    Code,
    Lines,
    clearing,
    exponent_of,
    fixed_nodes,
    hoisted,
    number,
)  # fmt: skip

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.language.series import Recurrence
    from lagsim.native.graph.keys import Functions, Layout, Loop, Manner


# Functions of more pieces are compiled without optimisation: in less than half the
# time, and they run 5 % longer (40 links; an arm of seven joints).
LONG = 6
# An array of a function, and an index there.
Place = tuple[str, int]


def evaluation_order(
    g: Graph, roots: Collection[int], places: Mapping[int, object]
) -> list[int]:
    """Return the nodes to evaluate for `roots`, in order; nodes in `places` are known.

    Sines and cosines come early and side by side: first the functions of angles that
    depend on no sine or cosine, then the functions of angles that depend on the first.
    """
    order = g.cone(roots, places)
    depth: dict[int, int] = {}  # others depend on no sine or cosine
    rounds: dict[int, list[int]] = {}
    for n in order:
        waits = 0 if n in places else max([depth.get(a, 0) for a in g.args[n]] or (0,))
        if g.ops[n] in CIRCULAR and n not in places:
            waits += 1
            rounds.setdefault(waits, []).append(n)
        if waits:
            depth[n] = waits
    sorted_: dict[int, None] = {}
    for k in sorted(rounds):
        angles = [g.args[n][0] for n in rounds[k]]
        sorted_ |= dict.fromkeys(g.cone(angles, {**places, **sorted_}))
        sorted_ |= dict.fromkeys(rounds[k])
    return list(sorted_ | dict.fromkeys(order))


class FunctionWriter(Lines):
    """Writer of the IR of one function, or of the pieces of a long one.

    Attributes
    ----------
    signature : str
        Parameters of the function.
    scratch, scratch_used : int
        First index of scratch memory in p, and its length so far.
    """

    signature = "double %t, ptr %y, ptr %p, ptr %out"

    def __init__(
        self, g: Graph, layout: Layout, scratch: int, *, contract: bool = False
    ) -> None:
        super().__init__(contract=contract)
        self.g, self.layout = g, layout
        self.scratch, self.scratch_used = scratch, 0

    def function(
        self,
        name: str,
        stores: Sequence[tuple[int, Place]],
        places: Mapping[int, Place],
        *,
        more: str = "",
        linkage: str = "",
        cleared: int = 0,
        longest: int = LONG,
        first: Sequence[str] = (),
    ) -> None:
        """Write the function `name`.

        Parameters
        ----------
        stores : sequence of (node, place)
            Nodes to evaluate, each with the place where its value is stored.
        places : mapping of node to place
            Nodes that are not evaluated, with the places of their values.
        more : str
            Parameters in addition to the signature.
        linkage : str
            LLVM's linkage of the function.
        cleared : int
            This many numbers of `out` are set to 0 before any value is stored.
        longest : int
            A function of more pieces is compiled without optimisation.
        first : sequence of str
            Functions that are called first.
        """
        signature = self.signature + more
        order = evaluation_order(self.g, [node for node, _ in stores], places)
        length, end = keys.PIECE, ") {"
        if len(order) > longest * length:
            length, end = -(-length // 2), ") noinline optnone {"
        pieces = [order[i : i + length] for i in range(0, len(order), length)] or [[]]
        at_end: dict[int, list[Place]] = {}
        for node, place in stores:
            at_end.setdefault(node, []).append(place)
        passed = self._passed(pieces, places)
        alone = len(pieces) == 1 and not first
        names = [name] if alone else [f"{name}.{i}" for i in range(len(pieces))]
        for piece_name, piece in zip(names, pieces, strict=True):
            kind = linkage if piece_name == name else "internal "
            self.lines.append(f"define {kind}void @{piece_name}({signature}{end}")
            if alone:
                self._clear(cleared)
            self._piece(piece, places, passed, at_end)
            self.lines += ["ret void", "}"]
        if not alone:
            self.lines.append(f"define {linkage}void @{name}({signature}) {{")
            self._clear(cleared)
            self.lines += [f"call void @{p}({signature})" for p in (*first, *names)]
            self.lines += ["ret void", "}"]

    def _clear(self, count: int) -> None:
        if count:
            self.declared.add(CLEAR)
            self.lines.append(clearing(count))

    def _passed(
        self, pieces: Sequence[Sequence[int]], places: Mapping[int, Place]
    ) -> dict[int, int]:
        """Return a place in p for each value that one piece passes to a later one.

        As node -> index. pieces : the nodes of each piece of a function.
        """
        home = {n: i for i, piece in enumerate(pieces) for n in piece}
        passed: dict[int, int] = {}
        for i, piece in enumerate(pieces):
            for n in piece:
                for a in self.g.args[n] if n not in places else ():
                    earlier = home.get(a, i) < i and a not in places
                    if earlier and self.g.args[a] and a not in passed:
                        passed[a] = self.scratch + len(passed)
        self.scratch_used = max(self.scratch_used, len(passed))
        return passed

    def _piece(
        self,
        piece: Sequence[int],
        places: Mapping[int, Place],
        passed: Mapping[int, int],
        at_end: Mapping[int, Sequence[Place]],
    ) -> None:
        here: dict[int, str] = {}

        def operand(n: int) -> str:
            if n not in here:
                here[n] = self._leaf(n, places, passed)
            return here[n]

        for at, n in enumerate(piece):
            if self.g.args[n] and n not in places:
                if self.g.ops[n] in CIRCULAR and n not in here:
                    self._circular(piece[at:], places, here, operand)
                elif n not in here:
                    operands = [operand(a) for a in self.g.args[n]]
                    exponent = exponent_of(self.g, n)
                    here[n] = self.operation(self.g.ops[n], exponent, operands)
                if n in passed:
                    self._store(self._number(n, here[n]), ("p", passed[n]))
            for place in at_end.get(n, ()):
                self._store(self._number(n, operand(n)), place)

    def _circular(
        self,
        nodes: Sequence[int],
        places: Mapping[int, Place],
        here: dict[int, str],
        operand: Callable[[int], str],
    ) -> None:
        """Write sines and cosines of the first nodes of these kinds, LANES at most.

        here : node -> name of its value, extended. operand : node -> its value's name.
        """
        g = self.g
        together: list[int] = []
        angles: dict[int, int] = {}
        for n in nodes:
            done = n in places or g.ops[n] not in CIRCULAR
            if done or g.args[n][0] in together:
                break
            angle = g.args[n][0]
            if angle not in angles and len(angles) == LANES:
                break
            angles.setdefault(angle, len(angles))
            together.append(n)
        wanted = [(g.ops[n], angles[g.args[n][0]]) for n in together]
        values = self.circular([operand(angle) for angle in angles], wanted)
        here.update(zip(together, values, strict=True))

    def _leaf(
        self, n: int, places: Mapping[int, Place], passed: Mapping[int, int]
    ) -> str:
        g = self.g
        if g.ops[n] == CONSTANT:
            x = g.value(n)
            assert x is not None
            return number(x)
        if g.ops[n] == TRUTH:
            return "true" if g.payload(n) else "false"
        if g.ops[n] == DATA:
            return self.data(g.payload(n))
        if n in places:
            value = self._load(places[n])
        elif g.ops[n] == VARIABLE:
            return self._variable(str(g.payload(n)))
        else:
            value = self._load(("p", passed[n]))
        if g.args[n] and OPERATIONS[g.ops[n]].condition:
            return self.line(f"fcmp one double {value}, {number(0.0)}")
        return value

    def _variable(self, name: str) -> str:
        if name == "t":
            return "%t"
        if name in self.layout.y:
            return self._load(("y", self.layout.y[name]))
        return self._load(("p", self.layout.p[name]))

    def _number(self, n: int, value: str) -> str:
        """Return `value` as a double: 1 or 0 for a truth value."""
        if self.g.args[n] and OPERATIONS[self.g.ops[n]].condition:
            return self.line(f"uitofp i1 {value} to double")
        return value

    def _load(self, place: Place) -> str:
        return self.line(f"load double, ptr {self._address(place)}")

    def _store(self, value: str, place: Place) -> None:
        self.lines.append(f"store double {value}, ptr {self._address(place)}")

    def _address(self, place: Place) -> str:
        array, k = place
        return self.line(f"getelementptr inbounds double, ptr %{array}, i64 {k}")


# Number of sums computed at a time; their count is padded to a multiple.
TOGETHER = 8
SUMS = f"<{TOGETHER} x double>"
# The sums and rows begin where lines of the cache do.
LINE_BYTES = 64

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
    """Write the function `name`, which evaluates a Taylor series.

    places : nodes that `prepare` has evaluated, with the places of their values.
    """
    g, r = w.g, loop.recurrence
    size, count = len(r.state), len(r.sums)
    orders = [g.variable(x) for x in ORDERS]
    edges = [g.variable(f"series.edge.{i}") for i in range(count)]
    if count > MOST_EDGES:
        edges = []
    made, firsts = _with_edges(g, r, edges)
    once = hoisted(g, made, {*orders, *r.carried, *r.sums, *edges, *firsts})
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
    found |= {n: ("orders", i) for i, n in enumerate(orders)}
    to = [("out", i) for i in range(size)] + [("row", i) for i in rows]
    to += [("w", padded + i) for i in range(len(edges))]
    w.function(f"{name}.order", list(zip(made, to, strict=True)), found, **internal)
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
    """Return the calls that compute the sums of an order; declare their function."""
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
    """Return the nodes of an order whose sums lack their first and last terms.

    Each variable in `edges` holds a_1 b_(k-1) + a_(k-1) b_1, computed with the previous
    order. Returned are the nodes to compute in an order, of which the last ones are the
    edges of the next order, and the variables of a_1 and b_1 of each sum.
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


# Least number of common nodes of several functions that become a function of their own.
# Fewer nodes are evaluated in each function: a call would take as much code.
FEW_COMMON = 48


class CommonNodes:
    """Code of the nodes that several long functions evaluate, written once.

    Nodes that the same functions use form a class, and a class is a function of its
    own. The operands of a node have all its users, so that the classes with more users
    come first.

    Attributes
    ----------
    writers : list of FunctionWriter
        The code of the classes.
    places : dict of node to place
        Values that the classes store.
    """

    def __init__(
        self,
        g: Graph,
        layout: Layout,
        first: int,
        functions: Mapping[str, Sequence[int]],
        known: Mapping[int, Place],
    ) -> None:
        users = dict[int, frozenset[str]]()
        for name, roots in functions.items():
            own = frozenset([name])
            for n in g.cone(roots, known):
                if g.args[n] and n not in known:
                    users[n] = users.get(n, frozenset()) | own
        counts = Counter(users.values())
        self._classes = [
            x for x, count in counts.items() if len(x) > 1 and count >= FEW_COMMON
        ]
        self._classes.sort(key=len, reverse=True)
        used = {n for roots in functions.values() for n in roots}
        used |= {
            a for n, own in users.items() for a in g.args[n] if users.get(a) != own
        }
        self.places: dict[int, Place] = {}
        self.writers = []
        made = {x: sorted(n for n in used if users.get(n) == x) for x in self._classes}
        total = sum(map(len, made.values()))
        for k, nodes in enumerate(made.values()):
            writer = FunctionWriter(g, layout, first + total)
            self.writers.append(writer)
            at = first + len(self.places)
            stores = [(n, ("p", at + i)) for i, n in enumerate(nodes)]
            writer.function(
                f"common.{k}", stores, {**known, **self.places}, linkage="internal ",
                longest=1,
            )  # fmt: skip
            self.places |= stores

    def calls(self, name: str) -> list[str]:
        """Return the names of the functions that a function calls first."""
        return [f"common.{k}" for k, x in enumerate(self._classes) if name in x]


def _longest(name: str, manner: Manner) -> int:
    """Return the number of pieces above which a function is not optimised."""
    return 1 if name in (*manner.once, *manner.rare) else LONG


# Where more results of a function are identically zero, all results are cleared at
# once, since LLVM compiles each store of a number.
FEW_ZEROS = 100
# A rare function of more nodes runs from a tape. An arm of seven joints: the 23,000 of
# its roundoff take 0.1 s instead of 0.7 s to be made, and 56 us instead of 7 us a call.
LONG_TAPE = 2000


def generate(
    g: Graph, functions: Functions, layout: Layout, manner: Manner = keys.PLAIN
) -> Code:
    """Return the IR of `functions`; long functions among `manner.rare` become tapes."""
    interpreted = {
        name: made
        for name, made in keys.nodes_of(functions).items()
        if name in manner.rare and len(g.cone(made)) > LONG_TAPE
    }
    functions = {k: x for k, x in functions.items() if k not in interpreted}
    fixed = fixed_nodes(g, keys.nodes_of(functions), layout.fixed)
    places = {node: ("p", layout.size + k) for k, node in enumerate(fixed)}
    scratch = layout.size + len(fixed)
    writers = [FunctionWriter(g, layout, scratch)]
    writers[0].function("prepare", list(places.items()), {})
    blank = dict(manner.blank)
    long = {
        name: [*nodes]
        for name, nodes in functions.items()
        if not isinstance(nodes, keys.Loop)
        and name not in manner.contracted
        and len(g.cone(nodes, places)) > _longest(name, manner) * keys.PIECE
    }
    common = CommonNodes(g, layout, scratch, {**long, **interpreted}, places)
    writers += common.writers
    scratch += len(common.places)
    for name, nodes in functions.items():
        writer = FunctionWriter(g, layout, scratch, contract=name in manner.contracted)
        writers.append(writer)
        if isinstance(nodes, keys.Loop):
            write(writer, name, nodes, places)
            continue
        stores = [(node, ("out", k)) for k, node in enumerate(nodes)]
        cleared = 0
        if name in blank:
            stores = [x for x in stores if x[0] != g.zero or x[1][1] >= blank[name]]
        elif nodes.count(g.zero) > FEW_ZEROS:
            cleared = len(nodes)
            stores = [store for store in stores if store[0] != g.zero]
        longest, first = _longest(name, manner), common.calls(name)
        known = {**places, **common.places} if first else places
        writer.function(
            name, stores, known, cleared=cleared, longest=longest, first=first
        )
    size = max(writer.scratch + writer.scratch_used for writer in writers)
    declared = set().union(*(x.declared for x in writers))
    lines = [line for x in writers for line in x.lines]
    if interpreted:
        stored = {n: k for n, (_, k) in {**places, **common.places}.items()}
        calls = {name: common.calls(name) for name in interpreted}
        more, tape, size = tapes.tape_functions(
            g, interpreted, layout._replace(size=size), stored, calls
        )
        declared |= more
        lines += tape
    return Code("\n".join([*sorted(declared), *lines, ""]), size)
