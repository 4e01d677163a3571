"""Quantities that `golden --update` measures: bounds of rows, invariants, impacts."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import orjson
import pytest

from lagsim.model.reader import read
from lagsim.notes import Event
from lagsim.run.session import open_case
from lagsim.studies.golden import certain, document, judge, new_golden, run
from lagsim.studies.motions import (
    _asked,
    at_impacts,
    before_impacts,
    kept_rows,
    motion_of,
    perturbed,
)
from tests.golden.scenes import judged, replaced, scene, stored
from tests.scenes.contact import scenes
from tests.support import MODELS, refused

# Bounds from runs whose differences are invented

PENDULUM = """
parameters: {g: 9.8, l: 1, zero: 0}
coordinates: {a: {}, s: {}}
energy: {kinetic: (l^2*a_dot^2 + s_dot^2)/2 + zero*s, potential: -g*l*cos(a)}
forces: {a: "0.1*cos(2*t)"}
initial: {a: 1, s: 0, s_dot: 0.5}
simulation: {duration: 10, output_step: 0.1, rtol: 1e-9}
"""
# Rounding errors and the tolerance itself: a tiny part of what is invented below.
TINY = 1e-6
# Bounds are rounded up to two digits, are kept a twentieth larger for the digits that
# are cut, and rise in steps that make room for half as much again.
LEAST, MOST = 1.05, 1.05 * 1.5 * 1.11


@pytest.fixture(scope="module")
def pendulum():
    return open_case(read(PENDULUM, "pendulum.yaml"))


@pytest.fixture
def measured(pendulum, monkeypatch):
    """Return a function that measures with invented runs beside the golden one.

    The runs are pairs: a column, and a function of t that is added to the column.
    """

    def measured(*invented):
        def variants(_scene, base, *_):
            for column, off in invented:
                t = base.rows[:, 0]
                values = base.rows[:, base.columns.index(column)] + off(t)
                yield replaced(base, column, values)

        monkeypatch.setattr("lagsim.studies.golden.variants", variants)
        return new_golden(pendulum)

    return measured


@pytest.mark.slow
def test_bounds_grow_with_the_spread(measured):
    golden, base = measured(("a", lambda t: TINY * np.exp(t / 2)))
    t = golden.rows[:, 0]
    spread = 10 * TINY * np.exp(t / 2)
    bounds = golden.bounds("a")
    assert np.all(bounds >= LEAST * spread * (1 - 1e-9))
    assert np.all(bounds <= MOST * spread * 1.05 + 1e-8)
    # Few steps: each makes room for half as much again, or more.
    steps = golden.steps["a"]
    assert len(steps) <= math.log(bounds[-1] / bounds[0]) / math.log(1.5) + 2
    # The other coordinate does not suffer: it has its tolerance and rounding.
    assert np.max(golden.bounds("s")) < 2e-8
    assert len(base.rows) == 101


def test_the_largest_of_the_samples_counts_and_bounds_never_fall(measured):
    golden, _ = measured(
        ("a", lambda t: TINY * (np.abs(t - 5.0) < 0.51)),
        ("a", lambda t: -2 * TINY * (np.abs(t - 5.0) < 0.51)),
        ("a", lambda t: 3 * TINY * (np.abs(t - 5.0) < 0.51)),
    )
    t, bounds = golden.rows[:, 0], golden.bounds("a")
    assert np.all(np.diff(bounds) >= 0.0)
    assert np.all(bounds[t < 4.45] < 0.1 * TINY)
    assert np.all(bounds[t > 4.45] >= LEAST * 10 * 3 * TINY)
    assert np.all(bounds <= MOST * 10 * 3 * TINY + 1e-7 * TINY)


def test_the_horizon_is_where_a_third_of_the_scale_is_lost(measured):
    # The angle swings by about 2 rad, its rate by about 6 rad/s.
    golden, base = measured(("a", lambda t: 1e-9 * 10.0 ** (0.9 * t)))
    width = np.ptp(base.rows[:, base.columns.index("a")])
    lost = math.log10(width / 3 / 1e-8) / 0.9
    assert golden.horizon == pytest.approx(lost, abs=0.15)
    assert golden.rows[-1, 0] < golden.horizon
    assert measured(("a", lambda t: 0 * t + TINY))[0].horizon is None


def test_the_bound_of_an_energy_can_fail(measured, pendulum):
    golden, base = measured(("energy", lambda t: TINY * t / 10))
    [name] = [n for n in golden.invariants if n.startswith("energy")]
    kept = golden.invariants[name]
    energy, work = (base.rows[:, base.columns.index(x)] for x in ("energy", "work"))
    assert kept.value == pytest.approx(energy[0] - work[0])
    own = 10 * np.max(np.abs(energy - work - kept.value))
    assert 10 * TINY <= kept.bound <= 1.11 * (10 * TINY + own + 1e-7)
    about = {"output_step": 0.1, "end": 10.0, "outcome": "done"}
    for part, passes in ((0.5, True), (3.0, False)):
        energies = energy.copy()
        energies[-1] += part * kept.bound
        other = replaced(base, "energy", energies)
        found = judge(pendulum, other, replace(golden, about=about))
        [worst] = [d for d in found.worst if d.column == f"{name} (constant)"]
        assert worst.passed == passes


@pytest.mark.slow
def test_momenta_and_residuals_are_bounded_too(monkeypatch):
    for name, keeps in (
        ("heavy-top", {"energy", "momentum.phi", "momentum.psi"}),
        ("elastic-pendulum-curve", {"energy", "residual_path"}),
        ("forced-oscillator", {"energy - work"}),
    ):
        monkeypatch.setattr("lagsim.studies.golden.variants", lambda *_: [])
        golden, base = new_golden(scene(name))
        assert set(golden.invariants) == keeps
        for kept, invariant in golden.invariants.items():
            assert 0.0 < invariant.bound < 1e-8
            if kept.startswith("residual"):
                assert invariant.value == 0.0
        assert len(base.rows) >= 100


def test_without_any_spread_a_bound_is_tolerance_and_rounding(measured):
    golden, base = measured()
    for column, least in (("a", 1e-9), ("s", 1e-9)):
        values = base.rows[:, base.columns.index(column)]
        bound = golden.steps[column][0][1]
        size = np.ptp(values)
        assert least * size <= bound <= 1.2 * least * size + 1e-13
    assert golden.steps["t"] == [(0.0, 0.0)]


def test_rows_beside_events_at_which_nothing_jumps_are_as_others(measured, monkeypatch):
    event, end = Event(5.0 + 1e-5, "switch"), Event(3.0, "until")

    def with_events(case, stride, compiled):
        base = motion_of(case, stride, compiled)
        trajectory = base.trial.trajectory._replace(events=(event, end))
        return replace(base, trial=base.trial._replace(trajectory=trajectory))

    usual, _ = measured()
    monkeypatch.setattr("lagsim.studies.golden.motion_of", with_events)
    golden, _ = measured()
    assert np.array_equal(golden.rows, usual.rows)
    assert golden.steps == usual.steps


# x_ddot is c for t < 1 and 2 c after it: x_dot and x have no jump, x_ddot one of c.
STEP = """
parameters: {c: 3}
coordinates: {x: {}}
definitions: {side: "if(t < 1, 1, 2)", kink: "max(t, 1)"}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: "if(t < 1, c, 2*c)"}
initial: {x: 0}
simulation: {duration: 2, output_step: 0.02}
"""
# A ball that is let go from 5 meets the floor at t = 1, a row's time, at a speed of 10,
# and leaves it at 5.
DROP = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 10*x}
constraints: {floor: {relation: x >= 0, restitution: 0.5}}
initial: {x: 5}
simulation: {duration: 1.5, output_step: 0.015625}
"""
# A saw whose teeth end at each second row, which is one of two that are kept.
SAW = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: "mod(50*t, 2)"}
initial: {x: 0}
simulation: {duration: 4, output_step: 0.02}
"""


@pytest.mark.slow
@pytest.mark.parametrize("text", [STEP, STEP.replace("t < 1", "x < 1.5")])
def test_rows_beside_a_jump_may_lie_on_either_side(text):
    case = open_case(read(text, "step.yaml"))
    golden, base = new_golden(case)
    assert len(golden.rows) == 101
    (k,) = np.flatnonzero(np.abs(golden.rows[:, 0] - 1.0) < 1e-9)
    for column, jump in (("x_ddot", 3.0), ("side", 1.0), ("kink", 0.0), ("x", 0.0)):
        bounds = golden.bounds(column)
        assert jump <= bounds[k] < 1.12 * jump + 1e-8
        assert np.max(np.delete(bounds, k)) < 1e-8
    other = base.rows[k - 1, base.columns.index("x_ddot")]
    if base.rows[k, base.columns.index("x_ddot")] == other:
        other += 3.0
    for by, passes in ((0.0, True), (1.0, False)):
        values = base.rows[:, base.columns.index("x_ddot")].copy()
        values[k] = other + by * (other - 4.5)
        assert judge(case, replaced(base, "x_ddot", values), golden).passed == passes


@pytest.mark.slow
def test_an_impact_at_the_time_of_a_row_is_kept():
    golden, _ = new_golden(open_case(read(DROP, "drop.yaml")))
    t, speed = golden.rows[:, 0], golden.rows[:, golden.columns.index("x_dot")]
    assert len(golden.rows) == 97 + 1
    (first,) = np.flatnonzero(before_impacts(t))
    assert speed[first] == pytest.approx(-10.0, abs=1e-9)
    assert speed[first + 1] == pytest.approx(5.0, abs=1e-9)
    assert np.max(golden.bounds("x_dot")) < 1e-8


@pytest.mark.slow
def test_jumps_at_every_row_that_is_kept_cost_none():
    golden, _ = new_golden(open_case(read(SAW, "saw.yaml")))
    assert len(golden.rows) == 101
    # Where a tooth of height 2 ends the acceleration may be 2 or 0.
    assert np.all(golden.bounds("x_ddot")[1:-1] == pytest.approx(2.1, rel=0.05))
    assert np.max(golden.bounds("x_dot")) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize(("rows", "kept"), [(40, 41), (1000, 168)])
def test_a_golden_has_fifty_rows_or_all(rows, kept):
    text = PENDULUM.replace("output_step: 0.1", f"output_step: {10 / rows}")
    golden, _ = new_golden(open_case(read(text, "pendulum.yaml")))
    assert len(golden.rows) == kept


def test_what_is_run_besides(pendulum):
    def run_besides(case):
        asked = [x.settings for x in _asked(case, motion_of(case, 10).plan)]
        assert asked.count(case.settings) == 4  # start and parameters moved
        return [settings for settings in asked if settings != case.settings]

    # Nobody has named a method: at another tolerance another may be the best.
    found = run_besides(pendulum)
    free = [x.rtol for x in found if x.method == "auto"]
    assert free == pytest.approx([k * 1e-9 for k in (*range(100, 0, -10), 0.1)])
    named = {x.method for x in found if x.method != "auto"}
    assert "radau" in named < {"dop853", "taylor", "radau"}
    fixed = run_besides(pendulum.with_settings(method="rk4", step=0.01))
    assert [x.step for x in fixed if x.method == "rk4"] == [0.02, 0.005]


def test_perturbed_by_one_unit_in_the_last_place(pendulum):
    directions = set()
    for seed in range(6):
        other = perturbed(pendulum, seed)
        old = {p.name: p.value for p in pendulum.equations.model.parameters}
        new = {p.name: p.value for p in other.equations.model.parameters}
        assert new["zero"] == 0.0
        for name in ("g", "l"):
            neighbours = [math.nextafter(old[name], s * math.inf) for s in (-1, 1)]
            assert new[name] in neighbours
            directions.add((name, new[name] > old[name]))
        for a, b in (
            (pendulum.start.q, other.start.q),
            (pendulum.start.v, other.start.v),
        ):
            apart = np.abs(b - a)
            assert np.all((apart == 0.0) == (a == 0.0))
            assert np.all(apart <= np.spacing(np.abs(a)))
    assert len(directions) == 4


@pytest.mark.parametrize("bound", [1e-9, 3.7e-4, 0.5, 12.0])
@pytest.mark.parametrize("value", [math.pi, -1234.5678901234, 1e-7 / 3, 0.0])
def test_digits_are_cut_by_a_twentieth_of_the_bound_at_most(value, bound):
    text = certain(value, bound)
    assert abs(float(text) - value) <= bound / 20 * (1 + 1e-9)
    # And not kept for nothing: two digits fewer would be too few.
    digits = text.replace("-", "").replace(".", "").split("e")[0].strip("0")
    most = math.log10(max(abs(value) / bound, 1e-9)) + 3
    assert len(digits) <= max(1, most)


@pytest.mark.parametrize("ends", [True, False])
def test_rows_are_found_by_their_times(pendulum, ends):
    motion = motion_of(pendulum, 10)
    t = motion.rows[:, 0]
    assert np.array_equal(motion.at(t + 1e-10, 1e-9, ends=ends), motion.rows)
    between = motion.at(t[:-1] + 0.01, 1e-9, ends=ends)
    assert np.all(np.isnan(between[:-1]))
    # The end of a motion is a result: it goes with the end of the other.
    last = motion.rows[-1] if ends else np.full(len(motion.columns), np.nan)
    assert np.array_equal(between[-1], last, equal_nan=True)


@pytest.mark.slow
def test_what_never_moves_is_stored():
    # All ranges and all bounds but those of the time may be 0.
    text = """
name: still
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
initial: {x: 3}
simulation: {duration: 2, output_step: 0.1}
"""
    case = open_case(read(text, "still.yaml"))
    golden, _ = new_golden(case)
    kept = orjson.loads(document(golden))
    assert kept["bounds"].keys() == set(golden.columns)
    assert all(bound == 0.0 for _, bound in kept["bounds"]["kinetic"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "since"), [("1/x", 1), ("sqrt(x)", 0), ("log(abs(x))", 1)]
)
def test_columns_that_no_run_can_be_held_against_are_refused(where, since):
    # x = t - 1 passes 0 in a row: 1/x is infinite there, sqrt(x) no number before.
    text = f"""
coordinates: {{x: {{}}}}
definitions: {{odd: {where}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
initial: {{x: -1, x_dot: 1}}
simulation: {{duration: 2, output_step: 0.25}}
"""
    with refused("not-finite", "`odd`", f"t = {since}") as fault:
        new_golden(open_case(read(text, "m.yaml")))
    assert len(fault.value.problems) == 1


# Impacts, whose times are results

IMPACTS = ["bouncing-ball", "slack-string", "newtons-cradle", "rocking-block"]


def changed(name, old, new):
    text = (MODELS / f"{name}.yaml").read_text()
    assert text.count(old) == 1
    return open_case(read(text.replace(old, new), f"{name}.yaml"))


@pytest.mark.parametrize("name", IMPACTS)
def test_goldens_keep_both_rows_of_impacts_which_do_not_spoil_the_others(name):
    golden = stored(name)
    assert 2 <= np.count_nonzero(at_impacts(golden.rows[:, 0])) <= 12
    assert golden.horizon is None
    # The tolerance is 1e-11; what hundreds of impacts make of it stays below 1e-7.
    for column, values in zip(golden.columns, golden.rows.T, strict=True):
        size = max(1.0, float(np.max(np.abs(values))))
        assert golden.bounds(column)[-1] < 1e-7 * size


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("bouncing-ball", "restitution: 0.8", "restitution: 0.80000001"),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in (
            ("slack-string", "l: {value: 1.0,", "l: {value: 1.00000001,"),
            ("newtons-cradle", "gap: {value: 1e-4", "gap: {value: 1.00001e-4"),
        )),
    ],
)  # fmt: skip
def test_a_small_change_is_seen(name, old, new):
    assert not judged(name, changed(name, old, new)).passed


def test_an_impact_that_moves_by_rounding_is_the_same():
    # g off by 1e-15 of itself moves impacts by about that.
    found = changed("bouncing-ball", "value: 9.81,", "value: 9.81*(1 + 1e-15),")
    assert judged("bouncing-ball", found).passed


def shifted(motion, by):
    """Return the motion with each impact `by` later, and no other change."""
    rows = motion.rows.copy()
    rows[at_impacts(rows[:, 0]), 0] += by
    return replace(motion, rows=rows)


def test_the_time_of_an_impact_is_judged_and_one_that_is_gone_is_missed():
    name = "bouncing-ball"
    case = scene(name)
    motion = run(case, stored(name))
    bound = float(stored(name).bounds("t")[-1])
    assert judged(name, case, shifted(motion, 0.5 * bound)).passed
    found = judged(name, case, shifted(motion, 2 * bound))
    assert {d.column for d in found.worst if not d.passed} == {"t"}
    gone = replace(motion, rows=motion.rows[~at_impacts(motion.rows[:, 0])])
    assert not judged(name, case, gone).passed


@pytest.mark.slow
@pytest.mark.parametrize("text", [scenes.sphere(50), scenes.dry(as_limit=True)])
def test_laws_of_every_kind_are_the_same_again(text):
    case = open_case(read(text, "m.yaml"))
    golden, base = new_golden(case)
    assert golden.horizon is None
    about = {"output_step": case.settings.output_step, "end": base.trial.end}
    found = judge(case, base, replace(golden, about=about))
    assert found.passed
    # What slides has no residual that stays zero; the gap stays above it.
    bounds = [v.bound for k, v in golden.invariants.items() if k.startswith("resid")]
    assert all(bound < 1e-8 for bound in bounds)


def test_twins():
    t = np.array([0.0, 1, 1, 2, 2, 2, 3, 4, 4])
    assert before_impacts(t).tolist() == [k in (1, 7) for k in range(9)]
    assert at_impacts(t).tolist() == [k in (1, 2, 7, 8) for k in range(9)]
    for short in ([], [1.0]):
        assert not at_impacts(np.array(short)).any()


# At rest: in stable balance of a double pendulum, of masses on springs, in a corner.
RESTS = {
    "pendulum": """
coordinates: {a: {}, b: {}}
energy:
  kinetic: a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b)
  potential: -9.81*(2*cos(a) + cos(b)) - p*a - b
initial: {a: {guess: 0.1}, b: {guess: 0.1}}
simulation: {duration: 20, output_step: 0.2, begin: rest}
""",
    "springs": """
coordinates: {x(1..3): {}, y(1..3): {}}
energy:
  kinetic: sum(i = 1..3, x_dot(i)^2 + y_dot(i)^2)/2
  potential: 9.81*sum(i = 1..3, y(i)) - 3*p*x(3) + 500*(hypot(x(1), y(1)) - 0.3)^2 +
    sum(i = 2..3, 500*(hypot(x(i) - x(i-1), y(i) - y(i-1)) - 0.3)^2)
initial: {x(i = 1..3): {guess: 0.2*i}, y(i = 1..3): {guess: -0.3*i}}
simulation: {duration: 10, output_step: 0.1, begin: rest}
""",
    "corner": """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y*p}
constraints: {wire: y = 0.5*abs(x)}
initial: {x: 0, y: 0}
simulation: {duration: 5, output_step: 0.05}
""",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RESTS)
def test_rows_of_a_motion_at_rest_are_kept(name):
    """Rounding in a balance of forces is no motion that could be lost."""

    def opened(p):
        return open_case(read(f"parameters: {{p: {p}}}\n{RESTS[name]}", "rest.yaml"))

    case = opened(1)
    golden, _ = new_golden(case)
    assert golden.horizon is None
    assert len(golden.rows) >= 50
    assert judge(case, run(case, golden), golden).passed
    # Another balance differs, also by a little.
    other = opened(1 + 1e-6)
    assert not judge(other, run(other, golden), golden).passed


def test_rows_beside_twenty_thousand_impacts_are_found():
    """As a matrix, distances of rows from impacts would take gigabytes."""
    impacts = np.linspace(0.0005, 19.9995, 20_000)
    t = np.sort(np.concatenate([np.arange(0, 20.05, 0.1), impacts, impacts]))
    events = [Event(float(x), "impact", "floor") for x in impacts]

    def motion(by):
        trial = SimpleNamespace(events=[replace_time(e, e.time + by) for e in events])
        return SimpleNamespace(rows=t[:, None] + by, trial=trial)

    def replace_time(event, time):
        return Event(time, event.kind, event.constraint)

    settings = SimpleNamespace(output_step=0.1, start=0.0)
    near = kept_rows(motion(0.0), [motion(1e-6)], settings)
    # Each row has an impact on either side, at half of the distance of two.
    grid = [k for k in near.rows if abs(round(10 * t[k]) - 10 * t[k]) < 1e-9]
    assert len(grid) >= 201
    assert not near.events
    near = kept_rows(motion(0.0), [motion(6e-5)], settings)
    assert {place for place, *_ in near.events} >= {*range(2, 199)}
    for place, time, late in near.events:
        assert abs(time - t[near.rows[place]]) == pytest.approx(5e-4, rel=1e-6)
        assert late == pytest.approx(6e-4, rel=1e-9)
