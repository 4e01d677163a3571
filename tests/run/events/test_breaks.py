import itertools
import math
import random
import time
import tracemalloc
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
import yaml

from lagsim.language.evaluate import evaluate
from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import Graph
from lagsim.language.intervals import RULES, Enclosures, interval
from lagsim.language.parser import parse
from lagsim.mechanics.switch_search import find_switches
from lagsim.run.events import times
from lagsim.run.events.breaks import _NEW, Division, Prevailing, breaks_of
from lagsim.run.trajectory import Outcome
from tests.patience import PATIENCE
from tests.support import simulate


def search(text, start, end, **values):
    g = Graph()
    node = parse(text).build(g, g.variable)
    switches = find_switches(g, [node], ("x",))
    discrete = [mode.discrete for mode in switches.modes]
    return breaks_of(Prevailing(g, discrete, values, start, end), start, end)


def breaks(text, start, end, **values):
    return list(search(text, start, end, **values))


def after(x):
    return math.nextafter(x, math.inf)


PI, ROOT = math.pi, math.sqrt(2.0)
# Functions of t, the stretch of it, and the first doubles at which they have changed.
EXACT = [
    ("heaviside(t - 1)", 0, 1e6, [1]),
    ("sign(t - 1)", 0, 1e6, [1]),
    ("if(t < 1, 1, 0)", 0, 1e6, [1]),
    ("if(t > 1, 1, 0)", 0, 1e6, [after(1.0)]),
    ("x*abs(t - 1)", 0, 1e6, [1]),
    # Breaks lie strictly inside.
    *((f, *ends, []) for ends in ((1, 1.5), (0.5, 1)) for f in
      ("heaviside(t - 1)", "if(t > 1, 1, 0)", "sign(t - 1)", "floor(t)")),
    ("sign(sin(t))", 0, 3, []),
    ("floor(t)", 1.5, 1.5, []),
    ("floor(p)", 0, 9, []),
    # A joined condition breaks only where the whole changes.
    ("if(t < 1 and t > 0.5 or t > 3, 1, 0)", 0, 10, [after(0.5), 1, after(3.0)]),
    ("if(t < 1 or t < 2, 1, 0)", 0, 10, [2]),
    ("if(not (t < 1) and p > 0, 1, 0)", 0, 10, [1]),
    ("if(not (t < 1) and -p > 0, 1, 0)", 0, 10, []),
    ("min(t, 2 - t)", -9, 9, [after(1.0)]),
    ("max(t, 2 - t)", -9, 9, [1]),
    ("sign((t - 1)*(t - 2)*(t - 3))", 0, 1e6, [1, 2, 3]),
    # Nested switches.
    ("if(t < 1, if(t < 0.5, 1, 2), if(t - 2 > 0, floor(t/4), 2))", 0, 9,
     [0.5, 1, after(2.0), 4, 8]),
    # Parameters move the breaks; functions that switch together break once.
    ("heaviside(t - 6*p)", 0, 9, [3]),
    ("heaviside(t - 10*p)", 0, 9, [5]),
    ("if(t > 1, 1, 0) + heaviside(t - 1)*x", 0, 9, [1]),
    # Poles, and ends of domains: a comparison with nan is false.
    ("sign(1/(t - 1))", 0, 9, [1]),
    ("sign(1/(t - 1)^2)", 0, 9, []),
    ("if(sqrt(t - 1) >= 0, 1, 0)", 0, 9, [1]),
    # Zero on a stretch.
    ("sign(max(0, t - 1))", 0, 9, [after(1.0)]),
    ("floor(min(2, max(1, t)))", 0, 9, [2]),
    ("sign(if(t < 3, 0, t - 5))", 0, 9, [3, 5]),
    # Whole numbers are exact.
    ("floor(sqrt(floor(t)))", 1, 10, [4, 9]),
    ("if(floor(t)*floor(t) >= 4, 1, 0)", 1, 10, [2]),
    ("if(floor(t)^3 >= 27, 1, 0)", 1, 10, [3]),
]  # fmt: skip
# Others, to a few units in the last place.
CLOSE = [
    ("sign(t^2 - 2)", -9, 9, [-ROOT, ROOT]),
    ("abs(sin(t) - 0.5)", 0, 13, [k * PI / 6 for k in (1, 5, 13, 17)]),
    ("sign(sin(t) - cos(t))", 0, 4, [PI / 4, 5 * PI / 4]),
    ("sign(tan(t))", 0.5, 6, [PI / 2, PI, 1.5 * PI]),
    ("if(acos(t) > 1, 1, 0)", -3, 3, [-1, math.cos(1.0)]),
    # A square wave: the surface itself jumps.
    ("if(t - floor(t/0.7)*0.7 < 0.3, 1, 0)", 0, 70,
     sorted([0.7 * k + 0.3 for k in range(100)] + [0.7 * k for k in range(1, 100)])),
]  # fmt: skip


@pytest.mark.slow
def test_where_functions_break():
    for text, start, end, expected in EXACT:
        assert breaks(text, float(start), float(end), p=0.5) == expected, text
    for text, start, end, expected in CLOSE:
        rel = 1e-14 if len(expected) > 5 else 1e-15
        found = breaks(text, float(start), float(end))
        assert found == pytest.approx(expected, rel=rel), text


@pytest.mark.parametrize("width", [1e-3, 1e-9, 1e-12])
def test_a_narrow_pulse_in_a_long_run(width):
    found = breaks("if(t >= 50 and t < 50 + w, 1, 0)", 0.0, 1000.0, w=width)
    assert found == [50.0, 50.0 + width]


def test_a_narrow_gap_between_two_oscillations():
    # |sin t| < 1e-7 about each multiple of pi: wide cells see nothing of it.
    found = breaks("if(abs(sin(t)) < 1e-7, 1, 0)", 1.0, 20.0)
    expected = [k * math.pi + s * 1e-7 for k in range(1, 7) for s in (-1, 1)]
    assert found == pytest.approx(expected, abs=1e-14, rel=0)


def test_zeros_of_the_sine_to_the_last_place():
    found = breaks("sign(sin(t))", 0.0, 1000.0)
    assert len(found) == 318
    for k, t in enumerate(found, 1):
        assert abs(t - k * math.pi) <= 2 * math.ulp(t)  # k * math.pi rounds too
        assert math.sin(t) * math.sin(math.nextafter(t, 0.0)) < 0.0


@pytest.mark.parametrize(
    "text",
    ["sign((t - 1)^2)", "heaviside(-(t - 1)^2)", "if((t - 1)^2 > 0, 1, 0)",
     "if(t <= 1 and t >= 1, 1, 0)", "floor(t*(2 - t))", "sign(sin(t) - 1)",
     "sign(t^2 - 2*t + 1)", "sign(abs(t - 1))"],
)  # fmt: skip
def test_a_touching_root_makes_no_arc(text):
    assert breaks(text, 0.5, 10.0 if "floor" not in text else 1.9) == []


@pytest.mark.slow
def test_the_first_breaks_of_many_come_at_once():
    begin = time.process_time()
    found = list(itertools.islice(search("sign(sin(1000*t))", 0.0, 1e6), 50))
    assert time.process_time() - begin < 1.0 * PATIENCE
    expected = [k * math.pi / 1000 for k in range(1, 51)]
    assert found == pytest.approx(expected, rel=4e-16)


@pytest.mark.slow
def test_phases_at_the_edge_of_rounding_are_still_told_apart():
    # At 1e5 the double spacing of t is 0.015 rad of phase.
    found = breaks("sign(sin(1e9*t))", 1e5, 1e5 + 1e-6)
    assert 318 <= len(found) <= 319
    first = list(itertools.islice(search("sign(sin(1e9*t))", 0.0, 1e7), 3))
    assert first == pytest.approx([1e-9 * math.pi * k for k in (1, 2, 3)], rel=1e-15)


@pytest.mark.slow
def test_a_surface_lost_in_rounding_ends():
    assert len(breaks("sign((t + 1e9) - t - 1e9)", 0.0, 1.0)) <= 2
    # A triple root, expanded: known to the cube root of the rounding error only.
    (found,) = breaks("sign(t^3 - 3*t^2 + 3*t - 1)", 0.0, 20.0)
    assert found == pytest.approx(1.0, abs=1e-4)
    assert len(breaks("sign((t + 1) - t - 1)", 0.0, 20.0)) <= 20
    assert len(breaks("sign(sin(1e20*t))", 1.0, 2.0)) <= 2


def test_a_part_lost_in_rounding_leaves_the_other_parts_alone():
    text = "if((t + 1e9) - t - 1e9 < -3e-7 or sin(5*t) > 0.5, 1, 0)"
    found = breaks(text, 0.0, 2.0)
    expected = [math.pi * x / 30 for x in (1, 5, 13, 17)]
    assert found == pytest.approx(expected, rel=1e-15)


NOISE = "(sin(t)^2 + cos(t)^2 - 1)"
WHOLE = "(0.3*sin(t) - mod(0.3*sin(t), 1))"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *((f"{outer}({WHOLE})", [PI]) for outer in ("abs", "floor")),
        (f"max({WHOLE}, -{WHOLE})", [PI]),
        (f"abs({NOISE})", []),
        (f"sign(max({NOISE}, -{NOISE}))", []),
        (f"if({NOISE} > 0, 1, 0)", []),
        (f"floor({NOISE})", []),
        ("max(sin(2*t), 2*sin(t)*cos(t))", []),
        ("if(exp(t)*exp(-t) > 1, 1, 0)", []),
        ("sign((t + 0.1) - t - 0.1)", []),
        # Real changes beside the zero, and pulses within it.
        (f"sign(max(0, 3 - t) + {NOISE})", [3]),
        (f"sign(max(0, t - 3) + {NOISE})", [3]),
        (f"sign(max(0, abs(t - 2) - 1.5) + {NOISE})", [0.5, 3.5]),
        (f"sign(max(0, 1e-4 - abs(t - 3)) + {NOISE})", [3 - 1e-4, 3 + 1e-4]),
        (f"sign(if(t < 3, {NOISE}, sin(2*t)))", [3, PI, 1.5 * PI]),
        (f"if({NOISE} > 1e-6 or sin(2*t) > 0, 1, 0)", [PI / 2, PI, 1.5 * PI]),
    ],
)
def test_a_surface_that_is_zero_but_for_rounding_costs_few_cells(
    monkeypatch, text, expected
):
    """Decisions within the zero are either side: a few further breaks may be there."""
    cells, enclose = [], Division._enclose
    monkeypatch.setattr(
        Division,
        "_enclose",
        lambda self, new: (
            cells.append(np.count_nonzero(new["task"] == _NEW)) or enclose(self, new)
        ),
    )
    found = breaks(text, 0.0, 5.0)
    assert sum(cells) < 20_000
    assert len(found) <= len(expected) + 2
    for known in expected:  # steps are lost within a few units of rounding, 2e-16
        assert min(abs(known - t) for t in found) < 1e-13


@pytest.mark.slow
def test_an_undecided_interval_leaves_the_decided_ones_beside_it_alone():
    inner = f"sign(max(0, 0.1 - t) + {NOISE})"  # undecided from 0.1 on
    found = breaks(f"if({inner} > 0.5 or sin(2*t) > 0.99, 1, 0)", 0.0, 5.0)
    assert min(found) == pytest.approx(0.1, abs=1e-13)


@pytest.mark.slow
def test_breaks_that_accumulate():
    found = breaks("sign(sin(1/t))", 0.01, 1.0)
    expected = [1 / (k * math.pi) for k in range(31, 0, -1)]
    assert found == pytest.approx(expected, rel=1e-14)
    first = list(itertools.islice(search("sign(sin(1/t))", 0.0, 1.0), 3))
    assert len(first) == 3
    assert 0.0 < first[0] < first[1] < first[2] < 1e-9


@pytest.mark.slow
def test_a_wave_faster_than_the_doubles_is_given_up():
    text = "if(floor(1e20*t) - 2*floor(5e19*t) > 0.5, 1, 0)"
    assert len(breaks(text, 1.0, 2.0)) <= 2


@pytest.mark.slow
def test_a_search_pauses_after_some_cells(monkeypatch):
    monkeypatch.setattr("lagsim.run.events.breaks.PATIENCE", 1000)
    assert 0.0 < next(search("sign(sin(1e6*t)^2)", 0.0, 1e6)) < 0.01


@pytest.mark.slow
def test_a_search_without_end_pauses():
    begin = time.process_time()
    assert 0.0 < next(search("sign(sin(1e6*t)^2)", 0.0, 1e6)) < 1.0
    assert time.process_time() - begin < 20.0 * PATIENCE


@pytest.mark.slow
def test_memory_is_bounded():
    first = search("floor(1e6*t)", 0.0, 1e9)
    tracemalloc.start()
    try:
        assert sum(1 for _ in itertools.islice(first, 5_000)) == 5_000
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


def random_expression(draw, depth):
    if depth == 0:
        return draw.choice(["t", "t", "0.5", "2", "p", "1.3"])
    a, b = (random_expression(draw, depth - 1) for _ in range(2))
    return draw.choice(
        [f"({a} + {b})", f"({a} - {b})", f"{a}*{b}", f"sin({a})", f"cos(3*{a})",
         f"abs({a})", f"max({a}, {b})", f"if({a} < {b}, {b}, {a})", f"exp(-{a}^2)",
         f"floor({a})", f"{a}/(1.5 + {b}^2)", f"sqrt(abs({a}))", f"atan2({a}, {b})"]
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(40), 102, 166, 216, 350])
def test_no_change_is_missed_and_none_invented(seed):
    draw = random.Random(seed)
    a, b = random_expression(draw, 3), random_expression(draw, 3)
    g = Graph()
    text = f"if({a} < {b} and {b} < 2 or sin(5*t) > {a}, 1, 0)"
    node = parse(text).build(g, g.variable)
    if not find_switches(g, [node], ()).modes:
        return
    discrete = g.args[node][0]
    found = breaks(text, -3.0, 3.0, p=0.7)
    assert len(found) < 500

    def value(t):
        return evaluate(g, [discrete], {"t": t, "p": 0.7})[0]

    grid = [draw.uniform(-3, 3) for _ in range(1500)]
    ends = [-3.0, *found, 3.0]
    for start, end in itertools.pairwise(ends):
        inside = [t for t in grid if start + 1e-7 < t < end - 1e-7]
        assert len({value(t) for t in inside}) <= 1, text


# ------------------------------------------------------------------ intervals


def random_interval(rng, n):
    centre = rng.choice([0.0, 1.0, -1.0, 2.0, 1.5707963267948966, 3.0, 700.0], n)
    centre = np.where(rng.random(n) < 0.5, centre, rng.normal(0, 3, n))
    spread = 10.0 ** rng.uniform(-17, 1.5, n) * (rng.random(n) < 0.9)
    low, high = rng.integers(0, 2, n), rng.integers(0, 2, n)
    low, high = centre - spread * low, centre + spread * high
    return np.minimum(low, high), np.maximum(low, high)


@pytest.mark.parametrize("name", sorted(x for x in RULES if "." not in x))
def test_intervals_enclose_every_value(name):
    row = OPERATIONS[name]
    rng = np.random.default_rng(sum(map(ord, name)))
    n = 800
    args, samples = [], []
    for k in range(row.arity):
        lo, hi = random_interval(rng, n)
        if name == "pow" and k == 1:
            whole = rng.integers(-4, 6, n).astype(float)
            pick = rng.random(n) < 0.6
            lo, hi = np.where(pick, whole, lo), np.where(pick, whole, hi)
        points = [
            lo,
            hi,
            *(np.clip(lo + (hi - lo) * rng.random(n), lo, hi) for _ in range(6)),
        ]
        if name in ("and", "or", "not") or (name == "if" and k == 0):
            lo = rng.integers(0, 2, n).astype(float)
            hi = np.maximum(lo, rng.integers(0, 2, n))
            points = [lo, hi] * 4
        args.append(interval(lo, hi))
        samples.append(points)
    with np.errstate(all="ignore"):
        found = RULES[name](*args)
    conditions = name in ("and", "or", "not")
    for picks in itertools.product(range(8), repeat=row.arity):
        if row.arity == 3 and picks[0] > 1:
            continue
        for i in range(n) if row.arity == 1 else range(picks[0], n, 7):
            point = [float(samples[k][j][i]) for k, j in enumerate(picks)]
            if conditions or name == "if":
                point[0] = bool(point[0])
            if conditions:
                point[-1] = bool(point[-1])
            y = float(row(*point))
            if math.isnan(y):
                assert found.partial[i] or math.isnan(found.lo[i]), point
            else:
                assert found.lo[i] <= y <= found.hi[i], (point, found[i : i + 1])


@pytest.mark.parametrize(
    "text", ["floor(t)", "tan(t*1.5707963267948966)", "1/(t - 1)", "sign(t - 1)",
             "if(t < 1, 0, 1)", "atan2(t - 1, -1)", "(t - 1)^-1", "log(t - 1)"]
)  # fmt: skip
def test_a_discontinuity_is_seen(text):
    g = Graph()
    node = parse(text).build(g, g.variable)
    (found,) = Enclosures(g, [g.call("sin", node)], {})(
        np.array([0.9]), np.array([1.1])
    )
    assert found.jumps[0] or found.partial[0]


def last_of(monkeypatch, breaks):
    """Pass the breaks in time; return the last one of a run, and its ending."""
    monkeypatch.setattr(times, "breaks_of", lambda *_: iter(breaks))
    arc = MagicMock()
    arc.settings.start, arc.settings.duration = 0.0, breaks[-1]
    found = times.TimeBreaks(arc)
    for t in breaks:
        decision = found.select(SimpleNamespace(t=t, settings=arc.settings))
        if decision.ending is not None:
            return t, decision.ending.outcome
    return t, None


K = np.arange(1.0, 4001.0)


@pytest.mark.parametrize("of", [lambda k: 0.7 - 1 / (k + 1), lambda k: 9 - k**-1.5])
def test_breaks_toward_a_pole_end_a_run(monkeypatch, of):
    t, outcome = last_of(monkeypatch, of(K).tolist())
    assert outcome is Outcome.SWITCHES_ACCUMULATE
    assert t < of(K[-1])


@pytest.mark.parametrize(
    "of", [lambda k: k, np.sqrt, np.log, lambda k: k**0.05, lambda k: 5 + 1e-6 * k]
)
def test_breaks_that_come_faster_and_have_no_end_do_not(monkeypatch, of):
    assert last_of(monkeypatch, of(K).tolist()) == (of(K[-1]), None)


@pytest.mark.parametrize(
    ("text", "pieces"),
    [
        ("sign(mod(floor(2*t + 0.625), 1.5))", {0.1875: 1, 1.1875: 0, 1.6875: 1}),
        ("heaviside(0.1 - mod(floor(t)/3, 1/3))", {}),
        ("if(mod(3*floor(t), 2) > 0, 1, 0)", {1.0: 1, 2.0: 0}),
        ("sign(floor(floor(t)*0.5) - floor(t)*0.5)", {1.0: -1, 2.0: 0}),
    ],
)
def test_steps_that_stay_at_a_level_of_other_steps_have_breaks(text, pieces):
    model = {
        "coordinates": {"x": {}},
        "energy": {"kinetic": "x_dot^2/2", "potential": "0"},
        "forces": {"x": text},
        "initial": {"x": 0, "x_dot": 0},
        "simulation": {"duration": 2.5, "output_step": 0.5},
    }
    found = simulate(yaml.safe_dump(model))
    assert [e.time for e in found.events if e.kind == "switch"] == pytest.approx(
        list(pieces), abs=1e-12
    )
    first = {"heaviside(0.1 - mod(floor(t)/3, 1/3))": 1}.get(text, 0)
    times, values = [0.0, *pieces, 2.5], [first, *pieces.values()]
    spans = (b - a for a, b in itertools.pairwise(times))
    speed = sum(v * span for v, span in zip(values, spans, strict=True))
    assert found["x_dot"][-1] == pytest.approx(speed, abs=1e-12)


@pytest.mark.parametrize(("force", "breaks", "more"), [
    ("curve(t^2)", [], 0.0),
    # A jump at the time of a knot, t = 1, and one at another time.
    ("curve(t^2) + sign(t - 1)", [1.0], -1.0),
    ("curve(t^2) + sign(t - 1.5)", [1.5], -1.75),
])  # fmt: skip
def test_knots_of_smooth_tables_are_no_events_unless_a_force_jumps(force, breaks, more):
    """The table of u^2 at u = t^2: x'' = t^4, beside a force whose sign changes."""
    points = [[u, u * u] for u in (0.0, 0.5, 1.0, 2.0, 3.0, 4.5)]
    found = simulate(yaml.safe_dump({
        "coordinates": {"x": {}},
        "energy": {"kinetic": "x_dot^2/2", "potential": "0"},
        "tables": {"curve": {"interpolation": "cubic", "points": points}},
        "forces": {"x": force},
        "initial": {"x": 0, "x_dot": 0},
        "simulation": {"duration": 2, "output_step": 0.25},
    }))  # fmt: skip
    assert [(e.kind, e.time) for e in found.events] == [("switch", t) for t in breaks]
    assert found["x"][-1] == pytest.approx(2**6 / 30 + more, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("ceil(floor(0.2*t) - 1.8*t)", [1 / 1.8]),
        ("ceil(2*floor(t) - 2.5*t)", [1 / 2.5, 2 / 2.5]),
        ("ceil(floor(0.2*t) - t)", []),
    ],
)
def test_a_step_that_is_0_at_one_instant_and_minus_0_after_it(text, expected):
    # ceil(0) is 0, ceil(-1e-9) is -0: these are equal, and no break.
    assert breaks(text, 0.0, 0.95) == pytest.approx(expected)
