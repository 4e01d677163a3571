"""Floors of lines, written as nested conditions, against sums of absolute values."""

import random
from itertools import pairwise

import numpy as np
import pytest

import lagsim

SCENE = """
coordinates: {{X: {{}}, y: {{}}}}
energy: {{kinetic: (X_dot^2 + y_dot^2)/2, potential: 9.81*y}}
forces: {{X: {push}}}
constraints: {{floor: {{relation: "y >= {floor}", restitution: {e}}}}}
initial: {{{start}}}
simulation: {{duration: 1, output_step: 0.05}}
"""
# Lines meet to rounding of their terms, which are of size 100 at most.
ROUNDING = 1e-12


def played(points=(), **words):
    text = SCENE.format(**words)
    if points:
        text += f"tables: {{F: {{points: {[[*p] for p in points]}}}}}\n"
    found = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert found.complete, found.reason
    return found


def chain(rng, slopes):
    """Return knots, heights, and a floor as nested conditions and as a sum of abs."""
    n, far = len(slopes) - 1, rng.choice([0.0, 0.0, 100.0, -3.3])
    x = sorted(rng.sample([round(far - 2 + 0.13 * i, 2) for i in range(31)], n))
    y = [round(rng.uniform(-1, 1), 3)]
    for i in range(1, n):
        y.append(round(y[-1] + slopes[i] * (x[i] - x[i - 1]), 4))

    def tree(i, j):
        if i == j:  # the line is written from its left or right knot
            k = i - 1 if i > 0 and (i == n or rng.random() < 0.5) else i
            return f"{slopes[i]!r}*(X - ({x[k]!r})) + {y[k]!r}"
        m = rng.randrange(i, j)
        return f"if(X <= {x[m]!r}, {tree(i, m)}, {tree(m + 1, j)})"

    bends = [(b - a) / 2.0 for a, b in pairwise(slopes)]
    mean = (slopes[0] + slopes[-1]) / 2.0
    height = y[0] - sum(b * abs(x[0] - c) for b, c in zip(bends, x, strict=True))
    terms = [f"{b!r}*abs(X - ({c!r}))" for b, c in zip(bends, x, strict=True)]
    rest = f"{height!r} + {mean!r}*(X - ({x[0]!r}))"
    return x, y, tree(0, n), " + ".join([rest, *terms])


def table(slopes, x, y):
    """Return the points of a chain, to 50 beyond its first and last knot."""
    ends = (x[0] - 50, y[0] - 50 * slopes[0]), (x[-1] + 50, y[-1] + 50 * slopes[-1])
    return [ends[0], *zip(x, y, strict=True), ends[1]]


def convex(rng):
    left = -round(rng.uniform(0.1, 0.8), 2)
    others = sorted(
        round(rng.uniform(0.05, 1), 2) for _ in range(rng.choice([2, 3, 4]))
    )
    return [left, *others]


SEEDS = [*range(12), *(pytest.param(s, marks=pytest.mark.slow) for s in range(12, 60))]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("spelling", ["if", "table"])
def test_a_body_rests_in_the_groove_of_a_convex_chain(seed, spelling):
    rng = random.Random(seed)
    slopes = convex(rng)
    x, y, floor, _ = chain(rng, slopes)
    points = []
    if spelling == "table":
        floor, points = "F(X)", table(slopes, x, y)
    # 9.81 times the slope of either side holds it.
    push = rng.choice([0.0, -0.4])
    e = rng.choice([0, 0.5])
    start = f"X: {x[0]!r}, y: {y[0]!r}"
    found = played(push=push, floor=floor, e=e, start=start, points=points)
    assert np.ptp(found["X"]) < ROUNDING
    assert np.ptp(found["y"]) < ROUNDING


FLOORS = (
    "if(X <= 0, -0.43*X, if(X <= 0.67, 0.19*(X - 0.67) + 0.1273, 0.66*X - 0.1876))",
    "if(X < 0, -0.6*X, if(X < 1, 0.5*X, 0.9*(X - 1) + 0.5))",
)


@pytest.mark.slow
@pytest.mark.parametrize("floor", FLOORS)
def test_a_groove_at_0_is_no_switch(floor):
    found = played(push=-0.93195, floor=floor, e=0.5, start="X: 0, y: 0")
    assert np.ptp(found["X"]) < ROUNDING
    assert not [e for e in found.events if e.kind == "switch"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_a_chain_is_the_floor_of_its_sum(seed):
    """A fall onto any chain, with grooves and ridges, and a slide down to its end."""
    rng = random.Random(1000 + seed)
    slopes = [round(rng.uniform(-0.9, 0.9), 2) for _ in range(rng.choice([3, 4, 5]))]
    x, y, *floors = chain(rng, slopes)
    at = round(x[0] + rng.uniform(0.05, 0.95) * (x[-1] - x[0]), 3)
    start = f"X: {at!r}, X_dot: {rng.uniform(-1, 1):.2f}, y: {max(y) + 0.4!r}, y_dot: 0"
    push, e = round(rng.uniform(-2, 2), 3), rng.choice([0, 0.4])
    one, other = (played(push=push, floor=f, e=e, start=start) for f in floors)
    for name in ("X", "y"):
        assert one[name] == pytest.approx(other[name], abs=1e-9)


# Two contacts have the ridge at X = 0.6; one of them is 0.34 below a body there.
RIDGED = (
    "if(X < 1.9, if(X < 1.77, if(X < 0.6, 0.895 - 0.07*X, 1.243 - 0.65*X),"
    " 0.7297 - 0.36*X), 1.6797 - 0.86*X)"
)


@pytest.mark.slow
@pytest.mark.parametrize("height", [1e-4, 1.147])
def test_a_body_over_a_ridge_falls_freely(height):
    start = f"X: 0.6, y: {0.853 + height!r}"
    found = played(push=0, floor=RIDGED, e=0, start=start)
    first = found.events[0]
    assert (first.kind, first.time) == (
        "impact", pytest.approx(np.sqrt(2 * height / 9.81), rel=1e-9),
    )  # fmt: skip


def test_a_body_on_a_ridge_slides_down_the_contact_that_it_touches():
    found = played(push=0, floor=RIDGED, e=0, start="X: 0.6, y: 0.853")
    slides = (found["X"] > 0.6) & (found["X"] < 1.76)
    t, x = found.t[slides], found["X"][slides] - 0.6
    assert len(t) > 9
    assert x == pytest.approx(9.81 * 0.65 / (1 + 0.65**2) * t**2 / 2, rel=1e-8)
