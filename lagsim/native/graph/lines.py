"""Lines of LLVM IR for graph operations; sines and cosines of several angles at once.

The C library's sine and cosine cost a large part of the time of a model of rods or
links. The function here evaluates the angles of a model side by side in the lanes of
vector registers, with equal results on every system.

An angle is reduced to its difference from the nearest multiple of pi/2, in two doubles,
by Cody's and Waite's method with pi/2 in three parts; polynomials approximate sine and
cosine of the reduced angle; the quadrant selects the result (J.-M. Muller, Elementary
Functions, 3rd ed., sections 11.2 and 10.2). The error is within 1 ulp. Angles above
LARGEST, inf and nan are passed to the C library, each by itself.
"""

from __future__ import annotations

import functools
import math
import struct
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import OPERATIONS

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.language.tables import Data


# Number of angles of one call.
LANES = 4
VECTOR = f"<{LANES} x double>"
BOTH = f"{{{VECTOR}, {VECTOR}}}"
SINCOS = "sincos.several"  # a name that no library has

# Up to this size multiples of pi/2 times the first two of its parts, of 33 bits, are
# exact.
LARGEST = 2.0**20
PARTS = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
# Added to a number, this rounds it, and leaves it in the last bits.
ROUNDER = 1.5 * 2.0**52

# Interpolants at Chebyshev's nodes for |r| <= pi/4, z = r^2, of (sin(r)/r - 1)/z and
# (cos(r) - 1 + z/2)/z^2, computed to 60 digits. Their error is below 2^-57.
SINE = (
    -0.16666666666666666,
    0.008333333333333331,
    -0.00019841269841265065,
    2.7557319219339163e-06,
    -2.5052106232446288e-08,
    1.605853161878178e-10,
    -7.586697105659895e-13,
)
COSINE = (
    0.041666666666666664,
    -0.0013888888888887398,
    2.4801587298765686e-05,
    -2.7557317271728623e-07,
    2.087614626815952e-09,
    -1.1382632407965617e-11,
)


# Index of each result of the vector function.
CIRCULAR = {"sin": 0, "cos": 1}

# Twice the exponents that are computed by products: these are exact to an ulp or two up
# to the 6th power, and faster than `pow`.
_HALVES = frozenset(k for k in range(-12, 13) if k not in (0, 2))


def exponent_of(g: Graph, n: int) -> float | None:
    """Return the exponent of node n if n is a power with a constant one, else None."""
    return g.value(g.args[n][1]) if g.ops[n] == "pow" else None


def is_product(exponent: float | None) -> bool:
    """Whether a power with this exponent is computed by products and a root."""
    return exponent is not None and exponent * 2 in _HALVES


class Code(NamedTuple):
    """LLVM IR of all functions, and the required length of p."""

    ir: str
    p_size: int


def hoisted(g: Graph, roots: Sequence[int], moving: Collection[int]) -> list[int]:
    """Return the operations in `roots` and below that can be computed once.

    They depend on no `moving` node, and are used: by an operation that depends on
    `moving` nodes, or as a root.
    """
    used, varying = set(roots), set(moving)
    cone = g.cone(roots)
    for n in cone:
        args = g.args[n]
        if args and (n in varying or not varying.isdisjoint(args)):
            varying.add(n)
            if not varying.issuperset(args):
                used.update(args)
    return [n for n in cone if n in used and n not in varying and g.args[n]]


def fixed_nodes(
    g: Graph, functions: Mapping[str, Sequence[int]], constant: Collection[str]
) -> list[int]:
    """Return the operations on `constant` variables, which `prepare` evaluates once.

    functions : name -> nodes that the function computes.
    constant : names of variables.
    """
    roots = [node for nodes in functions.values() for node in nodes]
    moving = [n for name, n in g.variables().items() if name not in constant]
    return hoisted(g, roots, moving)


# Declaration for `clearing`.
CLEAR = "declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)"


def clearing(count: int, first: int = 0) -> str:
    """Return the IR that sets out[first], ..., out[count - 1] to 0."""
    size = 8 * (count - first)
    return (
        f"%cleared = getelementptr double, ptr %out, i64 {first}\n"
        f"call void @llvm.memset.p0.i64(ptr %cleared, i8 0, i64 {size}, i1 0)"
    )


def number(x: float) -> str:
    """Return the LLVM literal of a float, bit for bit.

    Examples
    --------
    >>> number(1.0)
    '0x3FF0000000000000'
    """
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


class Lines:
    """Lines of IR with fresh names of values.

    contract : whether a product may be added without intermediate rounding.

    Examples
    --------
    >>> from lagsim.native.graph.lines import Lines
    >>> lines = Lines()
    >>> x = lines.line("fadd double %a, %b")
    >>> lines.operation("pow", 2.0, [x])
    '%v2'
    >>> lines.lines
    ['%v1 = fadd double %a, %b', '%v2 = fmul double %v1, %v1']
    """

    def __init__(self, *, contract: bool = False) -> None:
        self.contract = contract
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self._fresh = 0

    def operation(self, op: str, exponent: float | None, operands: list[str]) -> str:
        """Write an operation on values, and return the name of its value.

        op : the operation, as in the graph.
        exponent : the exponent of a power with a constant exponent; else None.
        operands : the names of the values.
        """
        if op == "pow" and exponent is not None and is_product(exponent):
            return self._power(operands[0], exponent)
        if op in CIRCULAR:
            return self.circular(operands, [(op, 0)])[0]
        row = OPERATIONS[op]
        self.declared.update(row.declares)
        fresh = {key: self._name() for key in "abcdef"}
        *before, last = row.native.format(*operands, **fresh).split("\n")
        self.lines += before
        return self.line(last)

    def circular(
        self, angles: Sequence[str], outputs: Sequence[tuple[str, int]]
    ) -> list[str]:
        """Write sines and cosines of up to LANES angles; return the values' names.

        angles : names of the angles.
        outputs : for each value, "sin" or "cos" and the index of the angle.
        """
        self.declared.update((*SINCOS_DECLARES, sincos_function()))
        vector = "zeroinitializer"
        for lane, angle in enumerate(angles):
            place = f"double {angle}, i32 {lane}"
            vector = self.line(f"insertelement {VECTOR} {vector}, {place}")
        call = f"@{SINCOS}({VECTOR} {vector})"
        pair = self.line(f"call {BOTH} {call}")
        values = []
        for op, lane in outputs:
            part = self.line(f"extractvalue {BOTH} {pair}, {CIRCULAR[op]}")
            one = f"extractelement {VECTOR} {part}, i32 {lane}"
            values.append(self.line(one))
        return values

    def _power(self, x: str, exponent: float) -> str:
        """Write the value x to the power `exponent`; return the name of the result.

        The exponent is a small integer or half-integer: the power is written as
        products and a root.
        """
        whole = int(abs(exponent))
        result = ""
        if abs(exponent) != whole:
            result = self.operation("sqrt", None, [x])
        while whole:
            if whole % 2:
                result = self.line(f"fmul double {result}, {x}") if result else x
            whole //= 2
            if whole:
                x = self.line(f"fmul double {x}, {x}")
        if exponent < 0:
            return self.line(f"fdiv double {number(1.0)}, {result}")
        return result

    def data(self, data: Data) -> str:
        """Declare the constant array `data`, and return its name."""
        text = "\\" + data.numbers.tobytes().hex("\\")
        kind = f"private constant [{8 * len(data.numbers)} x i8]"
        self.declared.add(f'@data.{data.digest} = {kind} c"{text}", align 8')
        return f"@data.{data.digest}"

    def line(self, text: str) -> str:
        """Write the instruction `text`, and return the name of its value."""
        name = self._name()
        if self.contract and text.startswith(("fadd double", "fsub double", "fmul d")):
            text = text.replace(" double", " contract double", 1)
        self.lines.append(f"{name} = {text}")
        return name

    def _name(self) -> str:
        self._fresh += 1
        return f"%v{self._fresh}"


class _Vectors(Lines):
    """Writer of IR lines on vectors of LANES doubles."""

    def add(self, x: str, y: str) -> str:
        return self.line(f"fadd contract {VECTOR} {x}, {y}")

    def sub(self, x: str, y: str) -> str:
        return self.line(f"fsub contract {VECTOR} {x}, {y}")

    def mul(self, x: str, y: str) -> str:
        return self.line(f"fmul contract {VECTOR} {x}, {y}")

    def polynomial(self, z: str, coefficients: tuple[float, ...]) -> str:
        """Write a polynomial in z by its even and odd halves, which overlap in time.

        Return the name of the value.

        coefficients : lowest power first.
        """
        square = self.mul(z, z)
        halves = []
        for part in (coefficients[::2], coefficients[1::2]):
            value = vector_literal(part[-1])
            for c in part[-2::-1]:
                value = self.add(self.mul(value, square), vector_literal(c))
            halves.append(value)
        return self.add(self.mul(halves[1], z), halves[0])

    def whole(self, x: str) -> str:
        return self.line(f"bitcast {VECTOR} {x} to <{LANES} x i64>")

    def integer(self, operation: str, x: str, k: int) -> str:
        each = ", ".join([f"i64 {k}"] * LANES)
        return self.line(f"{operation} <{LANES} x i64> {x}, <{each}>")

    def signed(self, value: str, quadrant: str) -> str:
        """Write `value` with the opposite sign in lanes with bit 1 of the quadrant set.

        value, quadrant : names of vectors, of doubles and of integers.
        """
        sign = self.integer("shl", self.integer("and", quadrant, 2), 62)
        bits = self.line(f"xor <{LANES} x i64> {self.whole(value)}, {sign}")
        return self.line(f"bitcast <{LANES} x i64> {bits} to {VECTOR}")


def vector_literal(x: float) -> str:
    """Return the literal of a vector of LANES equal numbers."""
    return vector_literal_of(number(x))


def vector_literal_of(literal: str) -> str:
    """Return the literal of a vector of LANES equal numbers, from that of a number."""
    return "<" + ", ".join([f"double {literal}"] * LANES) + ">"


@functools.cache
def sincos_function() -> str:
    """Return the IR of the function that returns sines and cosines of LANES angles."""
    b = _Vectors()
    rounded = b.add(b.mul("%x", vector_literal(2.0 / math.pi)), vector_literal(ROUNDER))
    n = b.sub(rounded, vector_literal(ROUNDER))
    # r - rest is the reduced angle in twice the precision.
    first = b.sub("%x", b.mul(n, vector_literal(PARTS[0])))
    second = b.mul(n, vector_literal(PARTS[1]))
    less = b.sub(first, second)
    rounding = b.sub(b.sub(first, less), second)
    third = b.sub(b.mul(n, vector_literal(PARTS[2])), rounding)
    r = b.sub(less, third)
    rest = b.sub(third, b.sub(less, r))
    z = b.mul(r, r)
    # sin(r - rest) = r + (r z S - rest (1 - z/2))
    half = b.mul(z, vector_literal(0.5))
    top = b.sub(vector_literal(1.0), half)
    bend = b.mul(b.mul(r, z), b.polynomial(z, SINE))
    sine = b.add(r, b.sub(bend, b.mul(rest, top)))
    none = b.line(f"fcmp oeq {VECTOR} {r}, zeroinitializer")  # keeps the sign of 0
    sine = b.line(f"select <{LANES} x i1> {none}, {VECTOR} {r}, {VECTOR} {sine}")
    # cos(r - rest) = (1 - z/2) + (its rounding error + z^2 C + rest r)
    left = b.sub(b.sub(vector_literal(1.0), top), half)
    bend = b.mul(b.mul(z, z), b.polynomial(z, COSINE))
    cosine = b.add(top, b.add(left, b.add(bend, b.mul(rest, r))))
    quadrant = b.whole(rounded)
    odd = b.line(f"trunc <{LANES} x i64> {quadrant} to <{LANES} x i1>")
    kinds = f"<{LANES} x i1> {odd}, {VECTOR}"
    sines = b.line(f"select {kinds} {cosine}, {VECTOR} {sine}")
    cosines = b.line(f"select {kinds} {sine}, {VECTOR} {cosine}")
    sines = b.signed(sines, quadrant)
    cosines = b.signed(cosines, b.integer("add", quadrant, 1))
    usual = len(b.lines)
    far = ["undef", "undef"]
    for lane in range(LANES):
        angle = b.line(f"extractelement {VECTOR} %x, i32 {lane}")
        for name, k in CIRCULAR.items():
            value = b.line(f"call double @llvm.{name}.f64(double {angle})")
            place = f"double {value}, i32 {lane}"
            far[k] = b.line(f"insertelement {VECTOR} {far[k]}, {place}")
    return _TEXT.format(
        body="\n".join(b.lines[:usual]), sines=sines, cosines=cosines,
        far="\n".join(b.lines[usual:]), far_sines=far[0], far_cosines=far[1],
        largest=vector_literal(LARGEST), vector=VECTOR, both=BOTH, lanes=LANES,
        name=SINCOS,
    )  # fmt: skip


# Declarations for `sincos_function`.
SINCOS_DECLARES = (
    *(f"declare double @llvm.{name}.f64(double)" for name in CIRCULAR),
    f"declare {VECTOR} @llvm.fabs.v{LANES}f64({VECTOR})",
)

_TEXT = """\
define internal {both} @{name}({vector} %x) noinline {{
%size = call {vector} @llvm.fabs.v{lanes}f64({vector} %x)
%small = fcmp ole {vector} %size, {largest}
%bits = bitcast <{lanes} x i1> %small to i{lanes}
%all = icmp eq i{lanes} %bits, -1
{body}
br i1 %all, label %usual, label %far
usual:
%pair = insertvalue {both} undef, {vector} {sines}, 0
%done = insertvalue {both} %pair, {vector} {cosines}, 1
ret {both} %done
far:
{far}
%s = select <{lanes} x i1> %small, {vector} {sines}, {vector} {far_sines}
%c = select <{lanes} x i1> %small, {vector} {cosines}, {vector} {far_cosines}
%two = insertvalue {both} undef, {vector} %s, 0
%given = insertvalue {both} %two, {vector} %c, 1
ret {both} %given
}}
"""
