"""Roots of random functions in few steps: each is met once, at its place."""

import math
import random
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.polynomial import polynomial

from lagsim import simulate
from lagsim.methods.parts import missed, search_table
from tests.choosing import tonight, turn
from tests.kernels import bind

# x = t, exactly, by any method; a row of fixed-step methods is one step.
TEXT = """
coordinates: {{x: {{}}}}
modes: {{met: 0}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: "{force}"}}
events: {{{events}}}
initial: {{x: 0, x_dot: 1}}
simulation: {{duration: 4, output_step: {step}, method: {method}, step: {step}}}
"""


def single(draw):
    """Return a polynomial, and its roots."""
    first = draw.uniform(0.1, 0.2)
    roots = sorted(first + 0.13 * k for k in draw.sample(range(28), draw.randint(1, 4)))
    return "*".join(f"(x - {r!r})" for r in roots), roots


def close_pair(draw):
    """Return a parabola with two roots that are close together."""
    first, apart = draw.uniform(0.1, 3.8), 10 ** draw.uniform(-5, -2)
    second = first + apart
    return f"{draw.uniform(1, 50)!r}*(x - {first!r})*(x - {second!r})", [first, second]


def dip(draw):
    """Return a function that is below 0 by 1e-8 between two roots."""
    steep, at = 10 ** draw.uniform(0, 2), draw.uniform(0.1, 3.9)
    half = math.sqrt(1e-8 / steep)
    return f"{steep!r}*(x - {at!r})^2 - 1e-8", [at - half, at + half]


def touch(draw):
    """Return a function whose distance from 0 is at least 1e-8."""
    return f"{10 ** draw.uniform(0, 2)!r}*(x - {draw.uniform(0.1, 3.9)!r})^2 + 1e-8", []


def periods(draw):
    """Return an oscillation of many periods, and its roots."""
    w, phase = draw.uniform(5, 60), draw.uniform(0, 2 * math.pi)
    first, last = phase / math.pi, (4 * w + phase) / math.pi
    roots = [(math.pi * k - phase) / w for k in range(math.ceil(first), int(last) + 1)]
    return f"sin({w!r}*x + {phase!r})", roots


KINDS = (single, close_pair, dip, touch, periods)


def downward(text, roots):
    """Return the roots at which a function falls below 0."""
    gaps = np.diff([0.0, *roots, 4.0])
    before = [r - gap / 4 for r, gap in zip(roots, gaps, strict=False)]
    values = eval(text.replace("^", "**"), {"x": np.array(before), "sin": np.sin})  # noqa: S307
    return [r for r, value in zip(roots, values, strict=True) if value > 0]


@pytest.mark.parametrize("method", ["rk4", "dop853", "taylor"])
@pytest.mark.parametrize("as_switch", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_each_root_is_met_once(seed, as_switch, method):
    step = turn(f"{seed} {as_switch} {method}", tonight(), (4, 0.7))
    draw = random.Random(f"{seed} {step} {method}")
    found = [kind(draw) for kind in KINDS for _ in range(2)]
    texts = [text for text, _ in found]
    each = [
        f"{k}: {{at: '{f} <= 0', set: {{met: met + 1}}}}" for k, f in enumerate(texts)
    ]
    forces = [f"sign({f})" for f in texts]
    events = "" if as_switch else ", ".join(f"n{x}" for x in each)
    force = f"1e-30*({' + '.join(forces)})" if as_switch else "0*x"
    text = TEXT.format(force=force, events=events, step=step, method=method)
    result = simulate(text, error_bar="never")
    if as_switch:
        every = sorted(root for _, roots in found for root in roots)
        assert [e.time for e in result.events] == pytest.approx(every, abs=1e-9)
    for k, (f, roots) in enumerate([] if as_switch else found):
        times = [e.time for e in result.events if e.name == f"n{k}"]
        assert times == pytest.approx(downward(f, roots), abs=1e-9), f


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "dop853", "taylor"])
@pytest.mark.parametrize("shape", ["pulse", "dip"])
def test_what_is_narrow_beside_a_point_is_met(shape, method):
    """A feature begins and ends between two neighbouring points of the search."""
    draw = random.Random(f"{shape} {method}")
    for _ in range(40):
        w, point = 10 ** draw.uniform(-7, -4.5), draw.choice([1, 2, 3, 0.618, 1.618])
        at = point + draw.choice([-1, 1]) * w * 10 ** draw.uniform(0.5, 2.5)
        condition = f"exp(-((x - {at!r})/{w!r})^2/2) >= 0.5"
        begins = at - w * math.sqrt(2 * math.log(2))
        if shape == "dip":
            condition, begins = f"(x - {at!r})^2 <= {w!r}^2", at - w
        events = f"e: {{at: '{condition}', set: {{met: 1}}}}"
        text = TEXT.format(force="0*x", events=events, step=4, method=method)
        [event] = simulate(text, error_bar="never").events
        assert event.time == pytest.approx(begins, abs=1e-9)


def dips(draw):
    """Return a narrow pulse in each period, and where it rises."""
    w, d, phase = draw.uniform(3, 200), 10 ** draw.uniform(-4, -1.5), draw.uniform(0, 6)
    half = math.acos(1 - d * math.sqrt(math.log(2))) / w
    roots = [(math.pi * (2 * j + 1) - phase) / w - half for j in range(-2, 200)]
    return f"exp(-((cos({w!r}*x + {phase!r}) + 1)/{d!r})^2) >= 0.5", roots


def gate(draw):
    """Return a gate that opens at a time."""
    steep, opens = 10 ** draw.uniform(3, 7), draw.uniform(0.1, 3.5)
    closes = opens + 50 / steep + 10 ** draw.uniform(-3, -1)
    step = "tanh({!r}*(x - {!r}))".format
    return f"{step(steep, opens)} - {step(steep, closes)} >= 1", [opens]


def resonance(draw):
    """Return a quotient that is large about a time."""
    e, at = 10 ** draw.uniform(-14, -5), draw.uniform(0.1, 3.9)
    return f"{e!r}/({e!r} + (x - {at!r})^2) >= 0.5", [at - math.sqrt(e)]


def three_pulses(draw):
    """Return three pulses of one width."""
    w, places = 10 ** draw.uniform(-7, -4), [draw.uniform(k, k + 0.9) for k in range(3)]
    pulses = " + ".join(f"exp(-((x - {at!r})/{w!r})^2)" for at in places)
    return f"{pulses} >= 0.5", [at - w * math.sqrt(math.log(2)) for at in places]


def high_power(draw):
    """Return a high power of a sine, and where it rises."""
    power, w = draw.choice([20, 100, 1000]), draw.uniform(3, 30)
    rises = math.asin(0.5 ** (1 / power))
    return f"sin({w!r}*x)^{power} >= 0.5", [
        (math.pi * j + rises) / w for j in range(99)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "dop853", "taylor"])
@pytest.mark.parametrize("kind", [dips, gate, resonance, three_pulses, high_power])
def test_each_localized_condition_is_met_once(kind, method):
    draw = random.Random(f"{kind.__name__} {method}")
    for _ in range(4):
        condition, roots = kind(draw)
        events = f"e: {{at: '{condition}', set: {{met: met + 1}}}}"
        text = TEXT.format(force="0*x", events=events, step=4, method=method)
        times = [e.time for e in simulate(text, error_bar="never").events]
        expected = [r for r in roots if 0 < r < 4]
        assert times == pytest.approx(expected, abs=1e-8), condition


def test_the_shape_of_a_step_is_the_quintic_that_it_follows():
    # A motion of degree 5 in u = (t - t0)/h is given by its values, rates and second
    # derivatives at both ends; its velocity is a cubic for other motions alone.
    n, h, degrees = 2, 0.7, 6
    motion = np.array([[1.0, -2.0, 0.5, 3.0, -1.5, 0.25], [0.3, 0.7, -1, 2, 0.9, -4]])
    ends = []
    for u in (0.0, 1.0):
        x = [polynomial.polyval(u, c) for c in motion]
        v = [polynomial.polyval(u, polynomial.polyder(c)) / h for c in motion]
        a = [polynomial.polyval(u, polynomial.polyder(c, 2)) / h**2 for c in motion]
        ends += [np.array([*x, *v]), np.array([*v, *a])]
    s = SimpleNamespace(
        shape=np.full(2 * n * degrees, np.nan), velocities=slice(n, 2 * n), n=n,
        sampled=2 * n,
    )  # fmt: skip
    missed.shape_step(s, h, *ends)
    shape = s.shape.reshape(2 * n, degrees)
    assert shape[:n] == pytest.approx(motion, rel=1e-12, abs=1e-12)
    # The cubics of the velocities have the values and the slopes of both ends.
    for c, k in zip(shape[n:], (n, n + 1), strict=True):
        old, old_rates, new, new_rates = (end[k] for end in ends)
        assert polynomial.polyval([0.0, 1.0], c) == pytest.approx([old, new])
        slopes = polynomial.polyval([0.0, 1.0], polynomial.polyder(c)) / h
        assert slopes == pytest.approx([old_rates, new_rates])
        assert c[4:] == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(("rounds", "off"), [(0, 0.5), (1, 0.31), (40, 3e-9)])
def test_the_least_value_is_located_by_sections(rounds, off):
    """Each round leaves 0.618 of the interval; half of it bounds the error."""
    places = []

    def value_at(_kind, _s, _p, _k, x):
        places.append(x)
        return abs(x - 2.3)

    locate = bind(search_table.least_of, {}, {})
    locate.__globals__["value_at"] = value_at
    found = locate(0, rounds, None, None, 0, 2.0, 3.0)
    assert abs(found - 2.3) <= off
    assert len(places) == 2 + rounds  # one evaluation a round
    assert all(2.0 < x < 3.0 for x in places)
