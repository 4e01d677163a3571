"""Tables: values, derivatives and enclosures against scipy's interpolants."""

import numpy as np
import pytest
from scipy.interpolate import (
    CubicSpline,
    PchipInterpolator,
    RectBivariateSpline,
    RegularGridInterpolator,
)

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import evaluate, evaluate_rows
from lagsim.language.graph import Graph
from lagsim.language.intervals import Enclosures
from lagsim.language.tables import KERNELS, axes_and_pieces, called
from lagsim.native.graph import straight_line, tapes
from lagsim.native.kernels.translation import translate
from lagsim.native.link.engine import Engine, compile_object
from tests.native import test_graph_code as code

X = np.array([-2.0, -1.5, 0.0, 0.25, 1.0, 3.0])
Y = np.array([1.0, 0.5, 2.0, -1.0, 0.0, 1.0])
X2 = np.array([-1.0, 0.0, 1.5, 2.0, 4.0])
Z = np.cos(np.add.outer(X, 2.0 * X2)) + np.outer(X, X2**2)
INSIDE = np.sort(np.random.default_rng(1).uniform(-2.0, 3.0, 200))
CURVES = {
    ("linear", "error"): lambda x: np.interp(x, X, Y),
    ("cubic", "extend"): CubicSpline(X, Y),
    ("cubic", "repeat"): CubicSpline(X, Y, bc_type="periodic"),
    ("monotone", "hold"): PchipInterpolator(X, Y),
}


def curve(how, outside, x=X, y=Y):
    """Graph, f(x) and f'(x) of a table of one argument."""
    g = Graph()
    f = called(g, *axes_and_pieces("f", (x,), y, how, outside), [g.variable("x")])
    return g, f, *gradient(g, f, [g.variable("x")])


def surface(how, outside):
    """Graph, f(x, y) and its two partial derivatives."""
    g = Graph()
    x, y = map(g.variable, "xy")
    f = called(g, *axes_and_pieces("f", (X, X2), Z, how, outside), [x, y])
    return g, f, *gradient(g, f, [x, y])


def values(g, nodes, x, y=0.0):
    return np.array(evaluate_rows(g, nodes, {"x": x, "y": y}, len(x)))


@pytest.mark.parametrize(("how", "outside"), CURVES)
def test_values_and_slopes_between_points_are_scipys(how, outside):
    g, *nodes = curve(how, outside)
    f, slope = values(g, nodes, INSIDE)
    expected = CURVES[how, outside]
    assert f == pytest.approx(expected(INSIDE), abs=1e-13)
    if how != "linear":
        assert slope == pytest.approx(expected(INSIDE, 1), abs=1e-12)
    assert values(g, nodes[:1], X)[0] == pytest.approx(Y, abs=1e-14)


@pytest.mark.parametrize("how", ["linear", "cubic", "monotone"])
def test_outside_the_points(how):
    far = np.array([-1e9, -2.7, -2.0000001, 3.0000001, 4.1, 1e9])
    low = far < 0.0
    assert np.isnan(
        values(*curve(how, "error")[:1], [curve(how, "error")[1]], far)
    ).all()
    g, f, slope = curve(how, "hold")
    assert (values(g, [f], far)[0] == np.where(low, Y[0], Y[-1])).all()
    assert (values(g, [slope], far)[0] == 0.0).all()
    g, f, slope = curve(how, "extend")
    ends = values(g, [slope], np.array([-2.0, 3.0]))[0]
    line = np.where(low, Y[0] + ends[0] * (far + 2.0), Y[-1] + ends[1] * (far - 3.0))
    assert values(g, [f], far)[0] == pytest.approx(line, rel=1e-13)
    g, f, slope = curve(how, "repeat")
    shifted = values(g, [f, slope], INSIDE + 35.0)
    assert shifted == pytest.approx(values(g, [f, slope], INSIDE), abs=1e-12)
    assert values(g, [f], np.array([1e300, -1e300])).shape == (1, 2)


def test_a_monotone_table_that_repeats_has_one_slope_where_it_does():
    g, _, slope = curve("monotone", "repeat")
    before, after = values(g, [slope], np.array([3.0 - 1e-12, 3.0 + 1e-12]))[0]
    assert before == pytest.approx(after, abs=1e-9)
    whole = PchipInterpolator(
        np.concatenate([X - 5.0, X[1:], X[1:] + 5.0]), [*Y, *Y[1:], *Y[1:]]
    )
    assert values(g, [slope], INSIDE)[0] == pytest.approx(whole(INSIDE, 1), abs=1e-12)


def test_two_arguments_are_scipys():
    x, y = np.random.default_rng(2).uniform([-2.0, -1.0], [3.0, 4.0], (200, 2)).T
    g, *nodes = surface("linear", "error")
    expected = RegularGridInterpolator((X, X2), Z)(np.stack([x, y], 1))
    assert values(g, nodes[:1], x, y)[0] == pytest.approx(expected, abs=1e-13)
    g, *nodes = surface("cubic", "hold")
    spline = RectBivariateSpline(X, X2, Z, s=0)
    found = values(g, nodes, x, y)
    for node, d in zip(found, ((0, 0), (1, 0), (0, 1)), strict=True):
        assert node == pytest.approx(spline.ev(x, y, *d), abs=1e-11)
    beyond = values(g, nodes, np.full(200, 7.0), y)
    assert beyond[0] == pytest.approx(spline.ev(3.0, y), abs=1e-11)
    assert (beyond[1] == 0.0).all()


@pytest.mark.parametrize("generate", [straight_line.generate, tapes.generate])
def test_native_code_gives_the_bits_of_python(generate):
    g = Graph()
    x, y = map(g.variable, "xy")
    nodes = []
    for how, outside in (*CURVES, ("linear", "repeat")):
        nodes.append(
            called(
                g,
                *axes_and_pieces(how, (X,), Y * (X < 2.0) + (X > 2.0), how, outside),
                [x],
            )
        )
        if how != "monotone":
            f = called(g, *axes_and_pieces("f", (X, X2), Z, how, "extend"), [x, y])
            nodes += [f, *gradient(g, f, [x, y])]
    nodes += gradient(g, nodes[0], [x])
    made_ = code.Compiled.__new__(code.Compiled)
    made_.functions = {"f": nodes}
    made_.code = generate(g, made_.functions, code.LAYOUT)
    texts = made_.code.ir, translate(KERNELS)
    made_.engine = Engine([compile_object(text, optimise=False) for text in texts])
    made_.p = np.full(made_.code.p_size + 1, code.GUARD)
    for a in (*INSIDE[::20], *X, -2.5, 3.5, 1e9, -1e15):
        at = {"x": float(a), "y": float(a) / 2.0}
        expected = np.array(evaluate(g, nodes, at))
        np.testing.assert_array_equal(np.array(made_.at(at)), expected)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["linear", "cubic"])
@pytest.mark.parametrize("outside", ["error", "hold", "extend", "repeat"])
@pytest.mark.parametrize("two", [False, True])
def test_enclosures_hold_all_values(how, outside, two):
    g = Graph()
    t = g.variable("t")
    args = [t, g.call("sin", t)][: 1 + two]
    z = np.zeros_like(Z) if outside == "repeat" else Z
    table = (
        axes_and_pieces("f", (X, X2), z, how, outside)
        if two
        else axes_and_pieces("f", (X,), Y, how, outside)
    )
    f = called(g, *table, args)
    nodes = [f, *tangent(g, [f], {t: g.one}), g.args[f][-1]]
    random = np.random.default_rng(3)
    for width in (0.0, 1e-6, 0.3, 8.0):
        lo = np.concatenate([random.uniform(-4.0, 5.0, 40), X])
        hi = lo + width
        found = Enclosures(g, nodes, {}, ("t",))(lo, hi)
        for part in (0.0, 0.4, 1.0):
            exact = evaluate_rows(g, nodes, {"t": lo + part * width}, len(lo))
            for enclosure, value in zip(found, exact, strict=True):
                nan = np.isnan(value)
                inside = (enclosure.lo <= value) & (value <= enclosure.hi)
                assert (
                    np.where(nan, enclosure.partial | enclosure.undefined, inside)
                ).all()
        if width == 1e-6:
            assert np.nanmedian(found[0].width) < 1e-4


def test_the_number_of_a_knot_steps_at_the_double_that_it_is():
    x = np.cumsum(np.random.default_rng(4).uniform(1e-3, 1.0, 1000))
    g, f, _ = curve("linear", "hold", x, np.sin(x))
    piece = g.args[f][-1]
    at = values(g, [piece], x)[0]
    assert at.tolist() == [*range(999), 998.0]
    before = values(g, [piece], np.nextafter(x, -np.inf))[0]
    assert before.tolist() == [-1.0, *range(999)]
    assert values(
        g, [piece], np.array([-1e300, np.nextafter(x[-1], np.inf)])
    ).tolist() == [[-1.0, 999.0]]
