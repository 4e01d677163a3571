"""Friction bounds that step at slip 0: the value at rest, and the limits beside it."""

import pytest

from lagsim.language.at_rest import bounds_at_rest
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from tests.language._programs import build

OTHERS = {"x": 0.7, "r": 0.3}
KNOWN = {"r": (0.3, 6e-17)}


def bounds(text, slips, held=()):
    """Return a function that evaluates both bounds, or None where these are unclear."""
    g = Graph()
    nodes = [build(g, slip) for slip in slips]
    rates = [build(g, rate) for rate in held]
    found = bounds_at_rest(g, build(g, text), nodes, ("v", "w", "u"), KNOWN, rates)
    if found is None:
        return None

    def values(**speeds):
        known = {"v": 0.0, "w": 0.0, "u": 0.0, **OTHERS, **speeds}
        return evaluate(g, [found.resting, found.sliding], known)

    return values


SMALL = 1e-9
# The bound, its value at rest, its limits for slips v > 0 and v < 0.
OF_ONE = [
    ("if(abs(v) > 0, 2, 5)", 5, 2, 2),
    ("if(abs(v) > 0, 2 + x, 5*x)", 3.5, 2.7, 2.7),
    ("5 - 3*sign(abs(v))", 5, 2, 2),
    ("5 - 3*sign(v)^2", 5, 2, 2),
    ("5 - 3*heaviside(-v^2)", 2, 5, 5),
    ("if(v^2 <= 0, 5, 2)", 5, 2, 2),
    ("if(max(v, -v) > 0, 2, 5)", 5, 2, 2),
    ("if(hypot(v, 0) <= 0, 5, 2)", 5, 2, 2),
    ("if(abs(r*v) + v^2 > 0, 2, 5)", 5, 2, 2),
    # The switch is so near slip 0 that no motion has a slip between.
    ("if(abs(v) < 1e-300, 5, 2)", 5, 2, 2),
    # Its place is kept; beyond it the bound falls, and at rest it is the value at 0.
    ("if(abs(v) < 1e-12, 5, 2)", 5, 2, 2),
    ("if(abs(v) < 1e-4, 5, 2)", 5, 5, 5),
    ("5 - x*abs(v)", 5, 5, 5),
    ("x + 1", 1.7, 1.7, 1.7),
    # The direction of the slip decides.
    ("if(v > 0, 2, 3)", 3, 2, 3),
    ("if(v > 0, 5 + v, 5 - v)", 5, 5, 5),
    ("if(v > 0, 2 + v, if(v < 0, 2 - v, 5))", 5, 2, 2),
    ("if(v > 0, 2, 3)*sign(abs(v)) + if(abs(v) > 0, 0, 5)", 5, 2, 3),
    ("2 + floor(abs(v))", 2, 2, 2),
]


@pytest.mark.parametrize(("text", "rest", "above", "below"), OF_ONE)
def test_a_bound_of_one_slip(text, rest, above, below):
    values = bounds(text, ["v"])
    found = values()[0], values(v=SMALL)[1], values(v=-SMALL)[1]
    assert found == pytest.approx((rest, above, below), rel=1e-8)


@pytest.mark.parametrize(
    ("text", "beside"),
    [
        ("if(abs(v) > 0, 2 + x, 5)", 2.7),
        ("if(v > 0, 2 + v, if(v < 0, 2 - v, 5))", 2),
        # The limits differ: the bound stays as written.
        ("if(v > 0, 2, if(v < 0, 3, 5))", 5),
        ("if(v > 0, 2, if(v < 0, -2, 5))", 5),
    ],
)
def test_the_bound_of_a_slide_has_the_limit_at_slip_0_too(text, beside):
    assert bounds(text, ["v"])()[1] == pytest.approx(beside, rel=1e-12)


# The slips, rates that are 0 in each motion, the bound, its value at rest, its limit
# for small slips, and a slip in which all rates are 0.
OF_SEVERAL = [
    (["v - w"], [], "if(abs(v - w) > 0, 2, 5)", 5, 2, {"v": SMALL}),
    (["w - v"], [], "if((v - w)^2 > 0, 2, 5)", 5, 2, {"v": SMALL}),
    (["r*v - w"], [], "if(abs(w - r*v) > 0, 2, 5)", 5, 2, {"w": SMALL}),
    (["v", "w"], [], "if(hypot(v, w) > 0, 2, 5)", 5, 2, {"w": SMALL}),
    (["v", "w"], [], "if(hypot(v, w) < 1e-300, 5, 2)", 5, 2, {"w": -SMALL}),
    pytest.param(
        ["v", "w"], [], "5 - 3*sign(v^2 + x^2*w^2)", 5, 2, {"v": -SMALL},
        marks=pytest.mark.slow,
    ),
    (["v", "w"], [], "5 - hypot(v, w)", 5, 5, {"v": SMALL}),
    # Another velocity than the slip vanishes with it by equalities alone.
    (["v"], [], "if(abs(w) > 0, 2, 5)", 5, 5, {"v": SMALL}),
    (["v"], ["w - 2*v"], "if(abs(w) > 0, 2, 5)", 5, 2, {"v": SMALL, "w": 2 * SMALL}),
    (["v"], ["u - 2*v", "w + u"], "if(abs(w) > 0, 2, 5)", 5, 2, {"v": SMALL, "w": -1}),
    # By the equality there is no slip, and the bound is as written.
    (["v"], ["v"], "if(abs(v) > 0, 1, 2)", 2, 1, {"v": SMALL}),
    (["v"], [], "if(v + x > 0, 2, 5)", 2, 2, {"v": SMALL}),
]  # fmt: skip


@pytest.mark.parametrize(("slips", "held", "text", "rest", "beside", "at"), OF_SEVERAL)
def test_a_bound_of_several_velocities(slips, held, text, rest, beside, at):
    values = bounds(text, slips, held)
    assert (values()[0], values(**at)[1]) == pytest.approx((rest, beside), rel=1e-8)


@pytest.mark.parametrize(
    ("text", "slips"),
    [
        # Too steep for a slip that begins, without a switch.
        ("5*(1 - 1e20*abs(v))", ["v"]), ("5*(1 - 1e20*hypot(v, w))", ["v", "w"]),
        ("5 + min(0, 1e20*v)", ["v"]),
        ("if(abs(v) < 1e-4, 5*(1 - 1e20*abs(v)), 2)", ["v"]),
        # The side of the switch depends on another value, or on the direction.
        ("if(abs(v)*x > 0, 2, 5)", ["v"]), ("if(v*r > 0, 2, 5)", ["v"]),
        ("if(v*w > 0, 2, 5)", ["v", "w"]), ("if(abs(v) > 0, 2, 5)", ["v", "w"]),
        ("if(v > 0, 2, 5)", ["v", "w"]),
        # Jumps of whole numbers; no limit.
        ("5 - 3*ceil(abs(v))", ["v"]), ("ceil(v) + 2", ["v"]),
        ("if(abs(v) > 0, 1/v, 5)", ["v"]),
    ],
)  # fmt: skip
def test_unclear_bounds(text, slips):
    assert bounds(text, slips) is None
