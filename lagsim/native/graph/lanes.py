"""A function of the graph at several rows at once, in the lanes of vectors.

`f_rows(rows, p, out, count)` evaluates the function for up to LANES rows (t, y): each
value is a vector with a lane for each row, and sines and cosines are computed for all
rows at once. Results have the bits of the function of one row, `f(t, y, p, out)`, which
is written as well: it evaluates vectors with that row in every lane.

Only functions of a few kinds of operations are written so, each of which is an
instruction on vectors.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING

from lagsim.language.forms import multiples_in
from lagsim.native.graph.lines import (
    BOTH,
    CIRCULAR,
    LANES,
    SINCOS,
    SINCOS_DECLARES,
    VECTOR,
    exponent_of,
    is_product,
    sincos_function,
    vector_literal_of,
)
from lagsim.native.graph.writer import LINE_BYTES, NOTHING, FunctionWriter, Place

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph

OPERATIONS = frozenset(
    ("add", "sub", "mul", "div", "neg", "sqrt", "abs", "min", "max", "pow", *CIRCULAR)
)
# Longer functions are shared with others, or not optimised.
MOST_NODES = 1200

_LITERAL = re.compile(r"0x[0-9A-F]{16}")
_INTRINSIC = re.compile(r"@llvm\.(\w+)\.f64")

# Transposition of rows into lanes, and back, four numbers at a time; the last four may
# overlap those before.
_TRANSPOSITION = """\
define internal void @{name}(ptr %r.0, ptr %r.1, ptr %r.2, ptr %r.3,
                             ptr %lanes, i64 %width) {{
entry:
%last = sub i64 %width, 4
br label %each
each:
%k = phi i64 [0, %entry], [%next, %each]
%late = icmp sgt i64 %k, %last
%at = select i1 %late, i64 %last, i64 %k
{body}
%next = add i64 %k, 4
%again = icmp slt i64 %next, %width
br i1 %again, label %each, label %end
end:
ret void
}}"""
# The function of rows: rows past `count` are the last one.
_ROWS = """\
define void @{name}_rows(ptr %rows, ptr %p, ptr %out, i64 %count) {{
%y = alloca [{inputs} x {vector}], align 32
%to = alloca [{outputs} x {vector}], align 32
%last = sub i64 %count, 1
{fetches}
{addresses}
call void @rows.to.lanes({rows}, ptr %y, i64 {inputs})
call void @{name}.lanes(ptr %y, ptr %p, ptr %to)
call void @lanes.to.rows({outs}, ptr %to, i64 {outputs})
ret void
}}
define void @{name}(double %t, ptr %y, ptr %p, ptr %out) {{
%row = alloca [{inputs} x double], align 32
store double %t, ptr %row
%rest = getelementptr double, ptr %row, i64 1
call void @llvm.memcpy.p0.p0.i64(ptr %rest, ptr %y, i64 {bytes}, i1 0)
call void @{name}_rows(ptr %row, ptr %p, ptr %out, i64 1)
ret void
}}"""
_COPY = "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)"
# The memory of the rows that follow is fetched while these are computed: a table is
# new, or other work has displaced it from the cache.
_FETCH = "declare void @llvm.prefetch.p0(ptr, i32, i32, i32)"
_FETCHED = """\
%ahead.{k} = getelementptr i8, ptr %out, i64 {at}
call void @llvm.prefetch.p0(ptr %ahead.{k}, i32 1, i32 3, i32 1)"""


def suits(g: Graph, nodes: Sequence[int], size: int) -> bool:
    """Whether a function of `nodes` can be evaluated in lanes, and gains by that.

    It must have enough arguments and results, not too many operations, and only such as
    are instructions on vectors.

    size : the number of components of y.
    """
    if min(1 + size, len(nodes)) < LANES:
        return False
    cone = g.cone(nodes)
    return len(cone) <= MOST_NODES and all(
        g.ops[n] in OPERATIONS and (g.ops[n] != "pow" or is_product(exponent_of(g, n)))
        for n in cone
        if g.args[n]
    )


def with_fewer_angles(g: Graph, nodes: Sequence[int]) -> list[int]:
    """Return nodes with equal values and fewer angles of sines and cosines.

    Sines and cosines of an angle a + b or a - b become products of the sines and
    cosines of a and b, where `nodes` contain functions of both.
    """
    turning = [n for n in g.cone(nodes) if g.ops[n] in CIRCULAR]
    angles = {g.args[n][0]: multiples_in(g, g.args[n][0]) for n in turning}
    made: dict[int, dict[str, int]] = {}
    known: dict[frozenset[tuple[int, int]], int] = {}
    for angle in sorted(angles, key=lambda n: (len(angles[n]), n)):
        found = _as_sum(angles, known, angles[angle])
        known[frozenset(angles[angle].items())] = angle
        if found is None:
            made[angle] = {op: g.call(op, angle) for op in CIRCULAR}
            continue
        a, b, sign = found
        (s, c), (t, d) = ((made[x]["sin"], made[x]["cos"]) for x in (a, b))
        plus, minus = ("add", "sub") if sign > 0 else ("sub", "add")
        made[angle] = {
            "sin": g.call(plus, g.call("mul", s, d), g.call("mul", c, t)),
            "cos": g.call(minus, g.call("mul", c, d), g.call("mul", s, t)),
        }
    new = {n: made[g.args[n][0]][g.ops[n]] for n in turning}
    return g.substitute(nodes, {n: x for n, x in new.items() if n != x})


def _as_sum(
    angles: Mapping[int, Mapping[int, int]],
    known: Mapping[frozenset[tuple[int, int]], int],
    angle: Mapping[int, int],
) -> tuple[int, int, int] | None:
    """Return two known angles, and the sign of the second one, whose sum is `angle`.

    None if there are none. angles : angle -> its multiples of variables. known : these
    multiples -> angle.
    """
    for a in known.values():
        for sign in (1, -1):
            rest = Counter(angle)
            rest.subtract(angles[a])
            b = known.get(frozenset((n, sign * k) for n, k in rest.items() if k))
            if b is not None:
                return a, b, sign
    return None


class LaneWriter(FunctionWriter):
    """Writer of a function whose values are vectors, with a lane for each row.

    `y` has t before the components, and `y` and `out` have LANES numbers for each
    value.
    """

    signature = "ptr %y, ptr %p, ptr %out"

    def write(
        self, name: str, nodes: Sequence[int], places: Mapping[int, Place], size: int
    ) -> None:
        """Write the function `name` of one row, and that of several rows, `name`_rows.

        nodes : graph nodes written to out.
        places : graph nodes that `prepare` has evaluated, with the places of their
            values in memory.
        size : the number of components of y.
        """
        stores = [(node, ("out", k)) for k, node in enumerate(nodes)]
        self.function(f"{name}.lanes", stores, places, linkage="internal ", longest=1)
        inputs, outputs = 1 + size, len(nodes)
        addresses = []
        for k in range(LANES):
            addresses += [
                f"%is.{k} = icmp slt i64 {k}, %last",
                f"%k.{k} = select i1 %is.{k}, i64 {k}, i64 %last",
                f"%in.{k} = mul i64 %k.{k}, {inputs}",
                f"%row.{k} = getelementptr double, ptr %rows, i64 %in.{k}",
                f"%of.{k} = mul i64 %k.{k}, {outputs}",
                f"%out.{k} = getelementptr double, ptr %out, i64 %of.{k}",
            ]
        block = 8 * LANES * outputs
        fetches = [
            _FETCHED.format(k=k, at=block + LINE_BYTES * k)
            for k in range(-(-block // LINE_BYTES))
        ]
        self.declared |= {_COPY, _FETCH, _transpositions()}
        text = _ROWS.format(
            name=name, inputs=inputs, outputs=outputs, vector=VECTOR,
            bytes=8 * size, addresses="\n".join(addresses),
            fetches="\n".join(fetches),
            rows=", ".join(f"ptr %row.{k}" for k in range(LANES)),
            outs=", ".join(f"ptr %out.{k}" for k in range(LANES)),
        )  # fmt: skip
        self.lines.append(text)

    def operation(self, op: str, exponent: float | None, operands: list[str]) -> str:
        """Write an operation on vectors, and return the name of its value.

        Arguments as for `Lines.operation`.
        """
        first, known = len(self.lines), set(self.declared)
        value = super().operation(op, exponent, operands)
        self.lines[first:] = map(_on_vectors, self.lines[first:])
        self.declared |= {_on_vectors(x) for x in self.declared - known}
        return value

    def circular(
        self, angles: Sequence[str], outputs: Sequence[tuple[str, int]]
    ) -> list[str]:
        """Write sines and cosines of vectors of angles; return the values' names.

        Arguments as for `Lines.circular`.
        """
        self.declared.update((*SINCOS_DECLARES, sincos_function()))
        pairs = [
            self.line(f"call {BOTH} @{SINCOS}({VECTOR} {_operand(angle)})")
            for angle in angles
        ]
        return [
            self.line(f"extractvalue {BOTH} {pairs[lane]}, {CIRCULAR[op]}")
            for op, lane in outputs
        ]

    def leaf(
        self,
        n: int,
        places: Mapping[int, Place],
        passed: Mapping[int, int] = NOTHING,
    ) -> str:
        """Return the name of node n's vector, or the literal of a constant.

        A vector in memory is loaded. Arguments as for `FunctionWriter.leaf`.
        """
        g = self.g
        if n in passed and n not in places:
            return self._vector_at(("p", passed[n]))
        if n not in places and g.ops[n] == "variable":
            name = str(g.payload(n))
            if name == "t":
                return self._vector_at(("y", 0))
            if name in self.layout.y:
                return self._vector_at(("y", LANES * (1 + self.layout.y[name])))
        value = super().leaf(n, places, passed)
        return value if value.startswith("0x") else self._equal_lanes(value)

    def store(self, value: str, place: Place) -> None:
        """Write an instruction that stores a vector at `place`."""
        array, k = place
        at = self.address((array, LANES * k) if array == "out" else place)
        self.lines.append(f"store {VECTOR} {_operand(value)}, ptr {at}, align 8")

    def _passed(
        self, pieces: Sequence[Sequence[int]], places: Mapping[int, Place]
    ) -> dict[int, int]:
        """Return node -> index in p of its vector, for values passed between pieces.

        Arguments as for `FunctionWriter._passed`.
        """
        passed = super()._passed(pieces, places)
        self.scratch_used = max(self.scratch_used, LANES * len(passed))
        return {n: self.scratch + LANES * i for i, n in enumerate(passed)}

    def _vector_at(self, place: Place) -> str:
        return self.line(f"load {VECTOR}, ptr {self.address(place)}, align 8")

    def _equal_lanes(self, value: str) -> str:
        """Write the vector with `value` in each lane; return its name."""
        one = self.line(f"insertelement {VECTOR} poison, double {value}, i32 0")
        mask = f"<{LANES} x i32> zeroinitializer"
        return self.line(f"shufflevector {VECTOR} {one}, {VECTOR} poison, {mask}")


def _on_vectors(text: str) -> str:
    """Return an IR instruction or declaration on doubles as one on vectors."""
    if VECTOR in text:
        return text
    if "@" in text:
        text = _INTRINSIC.sub(rf"@llvm.\1.v{LANES}f64", text)
    text = text.replace("double", VECTOR).replace(" i1 ", f" <{LANES} x i1> ")
    if "0x" in text:
        text = _LITERAL.sub(lambda found: vector_literal_of(found.group()), text)
    return text


def _operand(value: str) -> str:
    """Return the name of a vector, or the literal of a vector of equal numbers."""
    return vector_literal_of(value) if value.startswith("0x") else value


def _transpositions() -> str:
    """Return the IR of the functions `rows.to.lanes` and `lanes.to.rows`."""
    each = range(LANES)
    rows = [f"%p.{k} = getelementptr double, ptr %r.{k}, i64 %at" for k in each]
    lanes = ["%at.lanes = mul i64 %at, 4"]
    lanes.append("%l.0 = getelementptr double, ptr %lanes, i64 %at.lanes")
    lanes += [
        f"%l.{k} = getelementptr double, ptr %l.0, i64 {4 * k}" for k in (1, 2, 3)
    ]

    def transfers(kind: str, of: str) -> list[str]:
        if kind == "load":
            return [f"%x.{k} = load {VECTOR}, ptr %{of}.{k}, align 8" for k in each]
        return [f"store {VECTOR} %z.{k}, ptr %{of}.{k}, align 8" for k in each]

    def shuffled(to: str, a: str, b: str, mask: str) -> str:
        places = ", ".join(f"i32 {k}" for k in mask.split())
        return f"{to} = shufflevector {VECTOR} {a}, {VECTOR} {b}, <4 x i32> <{places}>"

    low, high = "0 4 2 6", "1 5 3 7"
    near, far = "0 1 4 5", "2 3 6 7"
    transposed = [
        shuffled("%y.0", "%x.0", "%x.1", low), shuffled("%y.1", "%x.0", "%x.1", high),
        shuffled("%y.2", "%x.2", "%x.3", low), shuffled("%y.3", "%x.2", "%x.3", high),
        shuffled("%z.0", "%y.0", "%y.2", near), shuffled("%z.1", "%y.1", "%y.3", near),
        shuffled("%z.2", "%y.0", "%y.2", far), shuffled("%z.3", "%y.1", "%y.3", far),
    ]  # fmt: skip
    bodies = {
        "rows.to.lanes": [*rows, *transfers("load", "p"), *transposed, *lanes],
        "lanes.to.rows": [*lanes, *transfers("load", "l"), *transposed, *rows],
    }
    bodies["rows.to.lanes"] += transfers("store", "l")
    bodies["lanes.to.rows"] += transfers("store", "p")
    return "\n".join(
        _TRANSPOSITION.format(name=name, body="\n".join(lines))
        for name, lines in bodies.items()
    )
