"""Taylor coefficients on the graph against mpmath, for every row of the table."""

import math

import mpmath as mp
import pytest
from hypothesis import given

from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.language.forms import normal_form
from lagsim.language.functions import OPERATIONS, PART, SMOOTH
from lagsim.language.graph import Graph
from lagsim.language.series import taylor_series
from tests.language._cases import CASES, DIGITS
from tests.language._programs import CONTINUOUS, AsWritten, on_graph, programs, states

ORDER = 9
START = 0.3
# x and y as polynomials of t, inside the domain of every function at START.
X = (0.35, 0.7, -0.4)
Y = (1.3, -0.6, 0.8)
MOVED = {"acosh": (1.6, 0.7, -0.4)}  # defined above 1


def moving(g, coefficients):
    a, b, c = map(g.constant, coefficients)
    t = g.variable("t")
    return g.sum([a, g.call("mul", b, t), g.call("mul", c, g.call("mul", t, t))])


def value(coefficients, t):
    a, b, c = map(mp.mpf, coefficients)
    return a + b * t + c * t * t


def coefficients(g, node, **values):
    """Return the coefficients of `node` in t.

    The series of y' = node has these coefficients, divided by k + 1, at order k + 1.
    """
    rows = taylor_series(g, [g.variable("y")], [node], ORDER + 1)
    nodes = [g.call("mul", g.constant(k), y) for k, (y,) in enumerate(rows)]
    return evaluate(g, nodes[1:], {"t": START, **values})


def assert_taylor(found, exact):
    with mp.workdps(DIGITS):
        expected = mp.taylor(exact, mp.mpf(START), ORDER)
    for k, (a, b) in enumerate(zip(found, expected, strict=True)):
        # Some ten operations per order, on coefficients that do not shrink: rounding.
        assert abs(a - b) < 1e-13 * max(1.0, *map(abs, expected)), k


@pytest.mark.parametrize("name", CASES)
def test_every_function(name):
    g = Graph()
    laws = [MOVED.get(name, X), Y][: len(CASES[name].domain)]
    node = g.call(name, *(moving(g, law) for law in laws))
    exact = CASES[name].exact
    assert_taylor(coefficients(g, node), lambda t: exact(*(value(c, t) for c in laws)))


def test_no_function_is_forgotten():
    conditions = {x for x, row in OPERATIONS.items() if row.condition or row.data}
    assert set(CASES) == set(OPERATIONS) - conditions - {"if", SMOOTH, PART}


@pytest.mark.parametrize(
    "p", [2, 3, 4, 7, -1, -2, -3, 0.5, 1.5, -0.5, -1.5, 2.3, -0.7, 65, 100.5]
)
def test_powers(p):
    g = Graph()
    fixed = g.call("pow", moving(g, Y), g.constant(p))
    exact = lambda t: mp.power(value(Y, t), mp.mpf(p))  # noqa: E731
    assert_taylor(coefficients(g, fixed), exact)
    parameter = g.call("pow", moving(g, Y), g.variable("p"))
    assert_taylor(coefficients(g, parameter, p=p), exact)


def test_whole_powers_pass_zero():
    # (t - 0.3)^4 at 0.3: a recurrence that divides by the base would give nan.
    g = Graph()
    base = g.call("sub", g.variable("t"), g.constant(START))
    for p in (2, 3, 4, 5, 6, 12):
        node = g.call("pow", base, g.constant(p))
        expected = [float(k == p) for k in range(ORDER + 1)]
        assert coefficients(g, node) == expected


def test_a_selection_keeps_its_branch():
    g = Graph()
    x, y = moving(g, X), moving(g, Y)
    for condition, law in (("lt", X), ("gt", Y)):
        node = g.call("if", g.call(condition, x, y), x, y)
        assert_taylor(coefficients(g, node), lambda t, law=law: value(law, t))


def test_a_motion():
    # y' = -2 t y^2, y(0) = 1: y = 1/(1 + t^2).
    g = Graph()
    y, t = g.variable("y"), g.variable("t")
    ty = g.call("mul", t, g.call("mul", y, y))
    rate = g.call("mul", g.constant(-2.0), ty)
    rows = taylor_series(g, [y], [rate], 12)
    found = evaluate(g, [row[0] for row in rows], {"t": 0.0, "y": 1.0})
    assert found == [(-1.0) ** (k // 2) * (k % 2 == 0) for k in range(13)]


@pytest.mark.slow
@given(programs(CONTINUOUS), states)
def test_the_normal_form_is_equal(program, state):
    g = AsWritten()
    node = on_graph(g, program)
    [new] = normal_form(g, [node], g.dependent([node], ("x", "y")))
    errors = {name: (x, 0.0) for name, x in state.items()}
    (x, ex), (y, ey) = evaluate_with_error(g, [node, new], errors)
    # A factor that is cancelled may have been 0.
    if math.isfinite(x + y) and ex + ey < 1e-6 * (1 + abs(x)):
        assert abs(x - y) <= 8 * (ex + ey)


def test_a_motion_of_several():
    # x' = v, v' = -x: neither coefficient may be taken for the next one.
    g = Graph()
    x, v = map(g.variable, "xv")
    rows = taylor_series(g, [x, v], [v, g.call("neg", x)], 7)
    for k, row in enumerate(rows):
        found = evaluate(g, row, {"x": 1.0, "v": 0.0})
        sign = (-1.0) ** ((k + 1) // 2) / math.factorial(k)
        assert found == pytest.approx([sign * (1 - k % 2), sign * (k % 2)], rel=1e-15)
