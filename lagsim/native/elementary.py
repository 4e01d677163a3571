"""Elementary functions as kernels, with equal bits on every target.

They replace the C library's functions where the target is portable, see `link.engine`.
They use operations of IEEE 754 alone, each rounded in the order written. `exponential`
and `logarithm` take and return a correction term for rounding, so that powers, roots
and hyperbolic functions can be computed from these two. Results are within two units
of the last place; of 800,000 random arguments of each function none was more than 1.6
units off.

Sources: J.-M. Muller, Elementary Functions, 3rd ed.: 11.2 and 11.4 (reduction by Cody
and Waite, by Payne and Hanek), 2.2 (Fast2Sum, 2Sum, Dekker's product: rounding error of
a sum or a product); special values: C11, annex F.10. Polynomials are partial sums of
Taylor series; arguments are reduced until the truncation error is below 2^-57.
"""

from __future__ import annotations

from math import copysign, factorial, floor, inf, nan, sqrt
from typing import Final

from lagsim.native.graph.lines import COSINE, LARGEST, PARTS, SINE
from lagsim.native.kernels.words import Static, bits, from_bits, unrolled

# The exponent in the bits of a double.
ONE_POWER: Final = 2**52
BIAS: Final = 1023
SMALLEST: Final = 2.0**-1022
SPLIT: Final = 2.0**27 + 1.0

# Constants whose product with a small integer is exact, or which are in two parts.
PER_LN2: Final = 1.4426950408889634
LN2_HIGH, LN2_LOW = 0.6931471804855391, 7.440617110012397e-11
PER_LN10, PER_LN10_LOW = 0.4342944819032518, 1.098319650216765e-17
THIRD, THIRD_LOW = 0.3333333333333333, 1.850371707708594e-17
QUARTER_TURN, QUARTER_TURN_LOW = 1.5707963267948966, 6.123233995736766e-17
ROOT_2: Final = 1.4142135623730951
TURN_PER_ANGLE: Final = 0.6366197723675814  # 2/pi

# (e^r - 1 - r)/r^2, and (atanh(s)/s - 1 - z/3)/z^2 in z = s^2.
EXPONENTIAL: Final = tuple(1.0 / factorial(k) for k in range(2, 15))
# (sinh(x)/x - 1)/x^2
HYPERBOLIC: Final = tuple(1.0 / factorial(2 * k + 1) for k in range(1, 10))
LOGARITHM: Final = tuple(1.0 / (2 * k + 1) for k in range(2, 14))
# (atan(u)/u - 1)/u^2; atan(j/8) in two parts.
ARC: Final = tuple((-1.0) ** k / (2 * k + 1) for k in range(1, 9))
EIGHTHS: Final = (
    0.0, 0.12435499454676144, 0.24497866312686414, 0.35877067027057225,
    0.4636476090008061, 0.5585993153435624, 0.6435011087932844, 0.7188299996216245,
    0.7853981633974483,
)  # fmt: skip
EIGHTHS_LOW: Final = (
    0.0, -3.1253241424539383e-18, 1.0698755618734451e-17, -2.4623815582638635e-17,
    2.2698777452961687e-17, -5.4556305485916264e-18, 1.5834785051444286e-17,
    -2.1478388444456983e-17, 3.061616997868383e-17,
)  # fmt: skip

# 2/pi in digits of 24 bits.
_TURNS: Final = int(
    "a2f9836e4e441529fc2757d1f534ddc0db6295993c439041fe5163abdebbc561b7246e3a"
    "424dd2e006492eea09d1921cfe1deb1cb129a73ee88235f52ebb4484e99c7026b45f7e41"
    "3991d639835339f49c845f8bbdf9283b1ff897ffde05980fef2f118b5a0a6d1f6d367ecf"
    "27cb09b74f463f669e5fea2d7527bac7ebe5f17b3d0739f78a5292ea6bfb5fb11f8d5d08"
    "56033046fc7b",
    16,
)
DIGIT: Final = 24
DIGITS: Final = tuple(
    float(_TURNS >> DIGIT * k & 2**DIGIT - 1) for k in reversed(range(50))
)
# Adding and subtracting these rounds to multiples of 2^30, of 4.
TO_2_30, TO_4 = 1.5 * 2.0**82, 1.5 * 2.0**54
# Digits of a turn used: the error is 2^-120 after the worst cancellation of an angle.
USED: Final = 9

# Kinds of results of `exponential` and `logarithm`.
VALUE, LESS_ONE, POWER = 0, 1, 2
# Kind of result of `circular` besides sines.
TANGENT: Final = -1


def product_rounding(a: float, b: float, product: float) -> float:
    """Return a*b - product, the exact rounding error of product = fl(a*b) (Dekker).

    Examples
    --------
    >>> product_rounding(0.1, 10.0, 1.0) == 2.0**-54  # 0.1 is a little more than 1/10
    True
    """
    x = SPLIT * a
    high = x - (x - a)
    low = a - high
    y = SPLIT * b
    head = y - (y - b)
    tail = b - head
    return low * tail - (((product - high * head) - low * head) - high * tail)


def missed(a: float, b: float, total: float) -> float:
    """Return a + b - total, the exact rounding error of total = fl(a + b) (2Sum).

    Examples
    --------
    >>> missed(1.0, 1e-20, 1.0)
    1e-20
    """
    back = total - a
    return (a - (total - back)) + (b - back)


def remainder(a: float, b: float, b_low: float, quotient: float) -> float:
    """Return a/(b + b_low) - quotient, the correction of quotient = fl(a/b).

    b_low : the rounding error of b.
    """
    product = quotient * b
    return (
        (a - product) - product_rounding(quotient, b, product) - quotient * b_low
    ) / b


def fused(a: float, b: float, c: float) -> float:
    """Return a*b + c, corrected by the rounding error of the product.

    The sum is rounded twice, in contrast to IEEE 754's fusedMultiplyAdd.
    """
    product = a * b
    error = product_rounding(a, b, product)
    found = product + c
    return found + error if error == error else found


def power_of_two(k: int) -> float:
    """Return 2^k, for -1022 <= k <= 1023."""
    return from_bits((k + BIAS) * ONE_POWER)


def scaled(x: float, k: int) -> float:
    """Return x 2^k, which may over- or underflow; rounded once."""
    half = k // 2
    return x * power_of_two(half) * power_of_two(k - half)


def exponential(x: float, low: float, exponent: int, kind: Static) -> float:
    """Return 2^exponent e^(x + low), or e^(x + low) - 1 for `kind` LESS_ONE.

    low : the rounding error of x, |low| << |x|.
    exponent : 0 for LESS_ONE.
    """
    if not abs(x) < 746.0:
        if x != x or x > 0.0:
            return x * inf if x > 0.0 else x
        return -1.0 if kind == LESS_ONE else 0.0
    n = floor(x * PER_LN2 + 0.5)
    high = x - n * LN2_HIGH
    second = n * LN2_LOW
    r = high - second
    rest = ((high - r) - second) + low
    bend = EXPONENTIAL[12]
    for k in unrolled(11, -1, -1):
        bend = bend * r + EXPONENTIAL[k]
    bend *= r * r
    one = 1.0 + r
    rest = ((1.0 - one) + r) + (rest + (bend + rest * (r + bend)))
    if kind == LESS_ONE and n < 54:
        part = power_of_two(n) if n > -1000 else 0.0
        return (part * one - 1.0) + part * rest
    return scaled(one + rest, n + exponent)


def logarithm(x: float, y: float, y_low: float, more: float, kind: Static) -> float:
    """Return (y + y_low) log(x) + more, or e to the power (y + y_low) log(x).

    kind : VALUE for the former, POWER for the latter, which ignores `more`, a small
        correction.
    """
    if not x > 0.0 or x == inf:
        return nan if x < 0.0 else -inf if x == 0.0 else x
    k = -BIAS
    if x < SMALLEST:
        x *= 2.0**54
        k -= 54
    whole = bits(x) // ONE_POWER
    m = from_bits(bits(x) - (whole - BIAS) * ONE_POWER)
    k += whole
    if m > ROOT_2:
        m *= 0.5
        k += 1
    # log m = 2 atanh(s), s = (m - 1)/(m + 1)
    f = m - 1.0
    d = m + 1.0
    s = f / d
    s_low = remainder(f, d, missed(m, 1.0, d), s)
    z = s * s
    z_low = product_rounding(s, s, z) + 2.0 * s * s_low
    tail = LOGARITHM[11]
    for j in unrolled(10, -1, -1):
        tail = tail * z + LOGARITHM[j]
    third = z * THIRD
    tail = z * z * tail + (
        product_rounding(z, THIRD, third) + z * THIRD_LOW + z_low * THIRD
    )
    w = third + tail
    product = s * w
    rest = product_rounding(s, w, product) + (s * missed(third, tail, w) + s_low * w)
    m = s + product
    m_low = 2.0 * (missed(s, product, m) + (s_low + rest))
    m *= 2.0
    twos = k * LN2_HIGH
    found = twos + m
    low = missed(twos, m, found) + (m_low + k * LN2_LOW)
    high = found + low
    low = missed(found, low, high)
    found = high * y
    low = product_rounding(high, y, found) + (high * y_low + low * y)
    if kind == POWER:
        return exponential(found, low, 0, VALUE)
    return found + (low + more)


def exp(x: float) -> float:
    return exponential(x, 0.0, 0, VALUE)


def expm1(x: float) -> float:
    return exponential(x, 0.0, 0, LESS_ONE) if x != 0.0 else x


def log(x: float) -> float:
    return logarithm(x, 1.0, 0.0, 0.0, VALUE)


def log10(x: float) -> float:
    return logarithm(x, PER_LN10, PER_LN10_LOW, 0.0, VALUE)


def log_one_plus(x: float, low: float) -> float:
    """Return log(1 + x + low)."""
    one = 1.0 + x
    if not one > 0.0 or one == inf:
        return log(one)
    return logarithm(one, 1.0, 0.0, (missed(1.0, x, one) + low) / one, VALUE)


def log1p(x: float) -> float:
    return log_one_plus(x, 0.0) if x != 0.0 else x


def pow(x: float, y: float) -> float:
    if y == 0.0 or x == 1.0:
        return 1.0
    if x != x or y != y:
        return x + y
    size = abs(x)
    sign = 1.0
    if copysign(1.0, x) < 0.0:
        whole = abs(y) >= 2.0**53 or y == floor(y)
        if not whole and size > 0.0 and size < inf:
            return nan
        if abs(y) < 2.0**53 and whole and floor(y) % 2 == 1:
            sign = -1.0
    if size == 0.0 or size == inf:
        grows = y < 0.0 if size == 0.0 else y > 0.0
        return sign * (inf if grows else 0.0)
    # Larger exponents result in 0, 1 or inf as well.
    return sign * logarithm(size, max(-(2.0**65), min(y, 2.0**65)), 0.0, 0.0, POWER)


def cbrt(x: float) -> float:
    size = abs(x)
    if size == 0.0 or not size < inf:
        return x
    return copysign(logarithm(size, THIRD, THIRD_LOW, 0.0, POWER), x)


def sinh(x: float) -> float:
    size = abs(x)
    if size < 1.0:
        bend = HYPERBOLIC[8]
        for k in unrolled(7, -1, -1):
            bend = bend * (x * x) + HYPERBOLIC[k]
        return x + x * (x * x) * bend
    half = exponential(size, 0.0, -1, VALUE)
    return copysign(half - 0.25 / half, x)


def cosh(x: float) -> float:
    half = exponential(abs(x), 0.0, -1, VALUE)
    return half + 0.25 / half


def tanh(x: float) -> float:
    e = expm1(2.0 * min(abs(x), 22.0)) if x == x else x
    d = e + 2.0
    found = e / d
    return copysign(found + remainder(e, d, missed(e, 2.0, d), found), x)


def asinh(x: float) -> float:
    size = abs(x)
    if size > 2.0**28:
        return copysign(log(size) + (LN2_HIGH + LN2_LOW), x)
    square = size * size
    more = square / (1.0 + sqrt(square + 1.0))
    both = size + more
    return copysign(log_one_plus(both, missed(size, more, both)), x)


def acosh(x: float) -> float:
    if x > 2.0**28:
        return log(x) + (LN2_HIGH + LN2_LOW)
    more = x - 1.0
    if more < 0.0:
        return nan
    root = sqrt(2.0 * more + more * more)
    both = more + root
    return log_one_plus(both, missed(more, root, both))


def atanh(x: float) -> float:
    size = abs(x)
    if not size < 1.0:
        return nan if size != 1.0 else copysign(inf, x)
    d = 1.0 - size
    ratio = 2.0 * size / d
    low = remainder(2.0 * size, d, missed(1.0, -size, d), ratio)
    return copysign(0.5 * log_one_plus(ratio, low), x)


def circular(x: float, shift: Static) -> float:
    """Return sin(x + shift pi/2) or, for `shift` TANGENT, tan(x)."""
    if not abs(x) < inf:
        return nan
    if abs(x) <= LARGEST:
        n = floor(x * TURN_PER_ANGLE + 0.5)
        first = x - n * PARTS[0]
        second = n * PARTS[1]
        less = first - second
        third = n * PARTS[2] - ((first - less) - second)
        r = less - third
        rest = third - (less - r)
    else:
        # (m + m_low) digits[k] 2^e, without turns, in three parts.
        power = bits(abs(x)) // ONE_POWER
        m = from_bits(bits(abs(x)) - (power - BIAS) * ONE_POWER)
        cut = SPLIT * m
        head = cut - (cut - m)
        begin = max(0, (power - BIAS - 54) // DIGIT)
        high = 0.0
        middle = 0.0
        low = 0.0
        for k in range(begin, begin + USED):
            unit = DIGITS[k] * power_of_two(power - BIAS - DIGIT * (k + 1))
            for j in unrolled(2):
                part = unit * (head if j == 0 else m - head)
                part -= (part + TO_2_30) - TO_2_30
                part -= (part + TO_4) - TO_4
                found = high + part
                part = missed(high, part, found)
                high = found
                found = middle + part
                low += missed(middle, part, found)
                middle = found
        n = floor(high + 0.5)
        high -= n
        part = high + middle
        low += missed(high, middle, part)
        r = part * QUARTER_TURN
        rest = -(product_rounding(part, QUARTER_TURN, r) + part * QUARTER_TURN_LOW)
        rest -= low * QUARTER_TURN
        if x < 0.0:
            n = -n
            r = -r
            rest = -rest
    quarter = (n + max(shift, 0)) % 4
    z = r * r
    bend = SINE[6]
    for k in unrolled(5, -1, -1):
        bend = bend * z + SINE[k]
    curve = COSINE[5]
    for k in unrolled(4, -1, -1):
        curve = curve * z + COSINE[k]
    a = r
    a_low = -(rest * (1.0 - 0.5 * z) - r * z * bend)  # keeps the sign of 0
    b = 1.0 - 0.5 * z
    b_low = ((1.0 - b) - 0.5 * z) + (z * z * curve + rest * r)
    if quarter % 2 == 1:
        a, b = b, -a
        a_low, b_low = b_low, -a_low
    value = a + a_low
    if shift == TANGENT:
        d = b + b_low
        found = value / d
        low = remainder(value, d, missed(b, b_low, d), found)
        return found + (low + missed(a, a_low, value) / d)
    return value if quarter < 2 else -value


def sin(x: float) -> float:
    return circular(x, 0)


def cos(x: float) -> float:
    return circular(x, 1)


def tan(x: float) -> float:
    return circular(x, TANGENT) if x != 0.0 else x


def angle(y: float, y_low: float, x: float, x_low: float) -> float:
    """Return atan2(y + y_low, x + x_low); y_low and x_low are small corrections."""
    if x != x or y != y:
        return x + y
    a, b = abs(y), abs(x)
    a_low = copysign(1.0, y) * y_low
    b_low = copysign(1.0, x) * x_low
    if a == inf or b == inf:
        a = 1.0 if a == inf else 0.0
        b = 1.0 if b == inf else 0.0
    if a == 0.0 and b == 0.0:
        b = 1.0
    is_steep = a > b
    if is_steep:
        a, b = b, a
        a_low, b_low = b_low, a_low
    scale = power_of_two(max(-1022, BIAS - bits(b) // ONE_POWER))
    a *= scale
    b *= scale
    # atan(u) = atan(c) + atan((a - c b)/(b + c a)), c = j/8 next to u
    j = floor(8.0 * (a / b) + 0.5)
    c = 0.125 * j
    beside = c * b
    e = a - beside
    more = c * a
    d = b + more
    u = e / d
    low = (a_low - c * b_low) * scale - product_rounding(c, b, beside)
    d_low = (
        missed(b, more, d) + product_rounding(c, a, more) + (b_low + c * a_low) * scale
    )
    low = low / d + remainder(e, d, d_low, u) if a > 2.0**-900 else 0.0
    z = u * u
    bend = ARC[7]
    for k in unrolled(6, -1, -1):
        bend = bend * z + ARC[k]
    found = EIGHTHS[j] + (u + (u * z * bend + (EIGHTHS_LOW[j] + low)))
    if is_steep:
        found = (QUARTER_TURN - found) + QUARTER_TURN_LOW
    if copysign(1.0, x) < 0.0:
        found = (2.0 * QUARTER_TURN - found) + 2.0 * QUARTER_TURN_LOW
    return copysign(found, y)


def atan2(y: float, x: float) -> float:
    return angle(y, 0.0, x, 0.0)


def atan(x: float) -> float:
    return angle(x, 0.0, 1.0, 0.0)


def beside_root(x: float, root: float) -> float:
    """Return sqrt(1 - x^2) - root, the correction of an approximate value `root`.

    0 if root is 0.
    """
    square = x * x
    rest = 1.0 - square
    product = root * root
    low = missed(1.0, -square, rest) - product_rounding(x, x, square)
    off = ((rest - product) - product_rounding(root, root, product)) + low
    return off / (2.0 * root) if root > 0.0 else 0.0


def asin(x: float) -> float:
    root = sqrt((1.0 - x) * (1.0 + x))
    return angle(x, 0.0, root, beside_root(x, root))


def acos(x: float) -> float:
    root = sqrt((1.0 - x) * (1.0 + x))
    return angle(root, beside_root(x, root), x, 0.0)


def hypot(x: float, y: float) -> float:
    a = max(abs(x), abs(y))
    b = min(abs(x), abs(y))
    if abs(x) == inf or abs(y) == inf:
        return inf
    if x != x or y != y:
        return x + y
    scale = 2.0**-600 if a > 2.0**500 else 2.0**600 if a < 2.0**-400 else 1.0
    a *= scale
    b *= scale
    return sqrt(a * a + b * b) / scale


FUNCTIONS = (
    exp, expm1, log, log10, log1p, pow, cbrt, sinh, cosh, tanh, asinh, acosh, atanh,
    sin, cos, tan, atan2, atan, asin, acos, hypot,
)  # fmt: skip
