"""Elementary functions against many digits, and at IEEE 754's special values."""

from __future__ import annotations

import ctypes
import itertools
import math

import mpmath
import numpy as np
import pytest

from lagsim.native import elementary
from lagsim.native.kernels.translation import translate
from lagsim.native.link.engine import Engine, compile_object

BY_NAME = {f.__name__: f for f in elementary.FUNCTIONS}
PAIRS = ("pow", "atan2", "hypot")
NUMPY = {"pow": "power", "asin": "arcsin", "acos": "arccos", "atan": "arctan"}
NUMPY |= {"atan2": "arctan2", "asinh": "arcsinh", "acosh": "arccosh"}
NUMPY |= {"atanh": "arctanh"}
MPMATH = {
    "pow": mpmath.power,
    "log10": lambda x: mpmath.log(x, 10),
    "log1p": lambda x: mpmath.log(1 + x),
    "cbrt": lambda x: mpmath.sign(x) * mpmath.cbrt(abs(x)),
}
# Bounds of the sizes of arguments, by their powers of ten.
SIZES = {
    "exp": (-20, 2.85), "expm1": (-20, 2.85), "sinh": (-20, 2.85), "cosh": (-20, 2.85),
    "tanh": (-20, 1.4), "asin": (-20, 0), "acos": (-20, 0), "atanh": (-20, 0),
    "acosh": (0, 20), "pow": (-3, 3), "log": (-320, 308), "log10": (-320, 308),
    "log1p": (-20, 20), "asinh": (-20, 200), "cbrt": (-320, 308),
}  # fmt: skip
# cos is nearest to 0 among all doubles there (Muller, 11.1).
WORST = 6381956970095103 * 2.0**797
SPECIAL = (
    0.0, 0.5, 1.0, 2.0, 3.0, 2.0**53, 2.0**53 + 2, 1e22, math.inf, math.nan, 5e-324,
    2.0**-1022, 1.7e308, 709.0, 745.2, 1.0 + 2.0**-52, 1.0 - 2.0**-53, WORST, 2.0**20,
)  # fmt: skip


@pytest.fixture(scope="module")
def native():
    """Return each function as compiled for portable targets."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LAGSIM_CPU", "portable")
        engine = Engine([compile_object(translate(elementary.FUNCTIONS))])
    number = ctypes.c_double
    return {
        name: engine.function(f"portable.{name}", number, [number] * arity(name))
        for name in BY_NAME
    }


def arity(name):
    return 2 if name in PAIRS else 1


def arguments(name, count):
    """Draw arguments of all sizes and both signs, and some about 1."""
    rng = np.random.default_rng(len(name))
    low, high = SIZES.get(name, (-20, 300))
    for _ in range(count):
        drawn = [
            rng.choice([-1, 1])
            * (10.0 ** rng.uniform(low, high) if rng.random() < 0.5 else x)
            for x in rng.uniform(0, 3, arity(name))
        ]
        if name in ("acosh", "log", "log10", "pow"):
            drawn[0] = abs(drawn[0])
        yield [float(x) for x in drawn]


def spacing(x):
    return np.spacing(abs(float(x)))


@pytest.mark.parametrize("count", [150, pytest.param(3000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", BY_NAME)
def test_within_two_units_of_the_last_place(name, count, native):
    exact = MPMATH.get(name) or getattr(mpmath, name)
    counted = 0
    with mpmath.workprec(2400 if name in ("log1p", "sin", "cos", "tan") else 300):
        for given in arguments(name, count):
            true = exact(*map(mpmath.mpf, given))
            if isinstance(true, mpmath.mpc) or not abs(true) < 1.7e308:
                continue
            counted += 1
            found = native[name](*given)
            assert abs(mpmath.mpf(found) - true) <= 2 * spacing(true), given
            assert BY_NAME[name](*given) == found  # CPython has the same bits
    assert counted > 5 * count / 12


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_the_hardest_angle(name, native):
    with mpmath.workprec(2400):
        true = getattr(mpmath, name)(mpmath.mpf(WORST))
        assert abs(native[name](WORST) - true) <= 2 * spacing(true)


@pytest.mark.parametrize("name", BY_NAME)
def test_special_values(name, native):
    beside = getattr(np, NUMPY.get(name, name))
    some = [*SPECIAL, *(-x for x in SPECIAL)]
    for given in itertools.product(some, repeat=arity(name)):
        if WORST in map(abs, given) and name in ("cos", "tan"):
            continue  # the C library errs there
        if name == "pow" and given in ((0.0, 0.5), (-math.inf, 0.5)):
            continue  # numpy takes a square root
        with np.errstate(all="ignore"):
            known = float(beside(*given))
        found = native[name](*given)
        assert math.isnan(found) == math.isnan(known), given
        if math.isfinite(known):
            # Both err by up to two units.
            assert abs(found - known) <= 4 * spacing(known), given
        elif not math.isnan(known):
            assert found == known, given
        if not math.isnan(known):
            assert math.copysign(1.0, found) == math.copysign(1.0, known), given


def test_a_product_less_its_rounding_is_exact():
    from fractions import Fraction

    rng = np.random.default_rng(3)
    for a, b in rng.uniform(-1, 1, (300, 2)):
        exact = Fraction(a) * Fraction(b) - Fraction(a * b)
        assert elementary.product_rounding(a, b, a * b) == exact
        assert elementary.fused(a, b, -(a * b)) == exact
