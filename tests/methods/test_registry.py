"""Requirements on every method: a new file in `methods` is tested at once."""

import math
import re

import numpy as np
import pytest

from lagsim.mechanics.derivation import derive
from lagsim.methods import method, method_page, names, options, options_of
from lagsim.model.reader import read
from lagsim.plan.method_choice import structure
from tests.small_scenes import held_pendulum

DAMPED = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^2/2, dissipation: 0.1*x_dot^2}
initial: {x: 1}
"""


def refusal_of(name, text):
    model = read(f"{text}simulation: {{duration: 1}}", "model.yaml")
    return method(name).refusal(structure(derive(model)))


def test_the_methods_are_the_files():
    assert set(names()) >= {"dop853", "euler", "kahan-li6", "rattle", "rk4", "verlet"}
    assert list(names()) == sorted(names())


@pytest.mark.parametrize("name", names())
def test_a_method_says_what_it_is(name):
    module = method(name)
    assert name == module.NAME
    assert 3 < len(module.TITLE) < 60
    assert module.ORDER >= module.DENSE_ORDER >= 1
    assert isinstance(module.ADAPTIVE, bool)
    assert module.IMAGINARY_LIMIT >= 0.0
    assert module.HANDLES
    assert re.search(r"^Sources?: \S", module.__doc__, re.MULTILINE)
    larger, smaller = (module.STATE.allocate(size=k, n=k // 2) for k in (8, 4))
    assert len(larger.flat) > len(smaller.flat)
    for kernel in ("start", "step", "interpolate"):
        assert callable(getattr(module, kernel))


def test_options_are_told_apart_by_their_names():
    told = [key for name in names() for key in options_of(name)]
    assert "spectral_radius" in told
    assert len(set(told)) == len(told) == len(options())
    for name, x in options().values():
        assert x.least <= x.default <= x.most
        assert x.about in " ".join(method_page(name).split())


@pytest.mark.parametrize("name", names())
def test_the_amplification_is_that_of_its_order(name):
    # |R(z)| = |e^z| up to the next power of z, and then some constant below 1.
    module = method(name)
    refuses = refusal_of(name, DAMPED)
    # A pair that is real is a double root, which goes by the root of what errs.
    decays = () if name == "moreau" else (-0.1,)
    for z in (0.1j,) if refuses else (*decays, -0.06 + 0.08j, 0.1j):
        error = abs(module.amplification(z) - math.exp(complex(z).real))
        assert error <= 0.1 ** (module.ORDER + 1) + 1e-15


@pytest.mark.parametrize("name", names())
def test_oscillations_are_stable_up_to_the_imaginary_limit(name):
    module = method(name)
    limit = module.IMAGINARY_LIMIT
    if math.isinf(limit):
        limit = 1e4
    else:
        # Limits are given to three digits. |R(iy)|^2 - 1 is even, begins where e^iy is
        # left, at y^p+1 or y^p+2, about 1/(p+2)! of it, and is 0 at the limit again.
        y, p = 1.002 * limit + 0.01, module.ORDER
        grown = y ** (p + 2) / math.factorial(p + 2) * (y - limit) / y
        assert module.amplification(1j * y) > 1.0 + 0.5 * grown
    for y in np.linspace(0.0, 0.998 * limit, 500):
        assert module.amplification(1j * y) <= 1.0 + 1e-7


BENDY = """
coordinates: {a: {}, b: {}}
energy: {kinetic: a_dot^2*(2 + cos(b)) + b_dot^2, potential: a^2 + b^2}
initial: {a: 1, b: 0}
"""
DRAG = """
coordinates: {a: {}}
energy: {kinetic: a_dot^2, potential: a^2}
forces: {a: -a_dot*abs(a_dot)}
initial: {a: 1}
"""
BLADE = """
coordinates: {a: {}, b: {}, c: {}}
energy: {kinetic: a_dot^2 + b_dot^2 + c_dot^2, potential: 0}
constraints: {edge: a_dot*sin(c) = b_dot*cos(c)}
initial: {a: 1, b: 0, c: 0}
"""
HELD = held_pendulum()
REFUSED = [
    ("verlet", BENDY, "mass matrix varies with positions"),
    ("verlet", DRAG, "forces depend on the velocities"),
    ("verlet", HELD, "`rattle`"),
    ("verlet", BLADE, "constraints between velocities"),
    ("kahan-li8", BENDY, "`gauss4`"),
    ("rattle", BENDY, "`midpoint`"),
    ("rattle", DRAG, "forces depend on the velocities"),
    ("rattle", BLADE, "`dop853` projects"),
    ("midpoint", HELD, "`rattle`"),
    ("gauss4", BLADE, "`dop853` projects"),
]


@pytest.mark.parametrize(("name", "text", "words"), REFUSED)
def test_what_cannot_be_handled_is_refused_with_the_way_out(name, text, words):
    assert words in refusal_of(name, text)
    assert not method("euler").refusal(None)


@pytest.mark.parametrize("name", ["radau", "generalized-alpha", "midpoint", "gauss4"])
def test_scenes_too_large_for_dense_matrices_are_refused(name):
    scene = structure(derive(read(f"{DAMPED}simulation: {{duration: 1}}", "m.yaml")))
    assert method(name).refusal(scene) == ""
    assert "301" in method(name).refusal(scene._replace(unknowns=301))
