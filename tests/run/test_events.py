"""Modes and events: against closed forms, and scipy with its own event location."""

import json
import math
import re
from contextlib import suppress

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from lagsim import InadmissibleError, check, derive, load, sweep
from lagsim.errors import InputError
from lagsim.methods import method, names
from tests.cli.conftest import lagsim  # noqa: F401
from tests.support import MODELS, refused, simulate

FREE = "coordinates: {x: {}}\nenergy: {kinetic: x_dot^2/2, potential: 0}\n"


def scene(text, begin="x: 0", duration=3, sections=FREE, **options):
    """Return the text of a model of a unit mass on a line."""
    asked = "".join(f", {key}: {value}" for key, value in options.items())
    simulation = f"simulation: {{duration: {duration}{asked}}}\n"
    return f"{sections}{text}\ninitial: {{{begin}}}\n{simulation}"


def acts(found, name=None):
    """Return names and times of events of the file, or the times of one."""
    own = [(e.name, e.time) for e in found.events if e.kind == "event"]
    return own if name is None else [t for n, t in own if n == name]


def drift(found):
    """Return the largest change of energy - work, against the largest energy."""
    balance = found["energy"] - (found["work"] if "work" in found.columns else 0.0)
    return np.ptp(balance) / np.max(np.abs(found["energy"]))


def simulated(text):
    """Simulate, if the method can handle the forces: not all methods permit drag."""
    with suppress(InputError):
        return simulate(text)
    with refused("method-refused"):
        simulate(text)
    return None


# --- Located events

# A load that falls through a fluid: v = u tanh(g t/u). At 3/4 of u a latch opens a
# brake, which is 100 v^2.
LATCH = """
modes: {open: 0}
forces: {x: 10 - (1 + 99*open)*x_dot^2/40}
events: {latch: {at: x_dot >= 15, set: {open: 1}}}
"""
OPENS = 2 * math.atanh(15 / 20)


@pytest.mark.parametrize("name", [*names(), "auto"])
def test_a_latch_opens_at_a_speed(name):
    step, far = {"euler": (1e-4, 5e-3), "moreau": (1e-4, 5e-3)}.get(name, (1e-3, 1e-5))
    far = 1e-10 if name == "auto" or method(name).ADAPTIVE else far
    text = scene(LATCH, duration=4, method=name, step=step, output_step=0.01)
    if (found := simulated(text)) is None:
        return
    [time] = acts(found, "latch")
    assert time == pytest.approx(OPENS, abs=far)
    after = found.t >= time
    assert list(found["open"]) == list(after.astype(float))
    # Then v' = 10 - 2.5 v^2: coth, since it is faster than 2.
    x = 5 * (found.t[after] - OPENS) + math.atanh(2 / 15)
    assert found["x_dot"][after] == pytest.approx(2 / np.tanh(x), abs=300 * far)


def trebuchet(p):
    """Return the times at which a stone leaves trough and sling, by scipy."""
    W, B, m, s, l, r, h, c, g = (p[k] for k in "WBmslrhcg")  # noqa: E741
    M = np.diag([W * s**2 + B * (l**2 - l * s + s**2) / 3, m, m])

    def solved(z, rows):
        a, x, y, w, u, v = z
        tip, by_a = np.array([-l * np.sin(a), h - l * np.cos(a)]), np.zeros(2)
        by_a[:] = -l * np.cos(a), l * np.sin(a)
        d, rate = [x, y] - tip, [u, v] - by_a * w
        bend = l * w**2 * np.array([np.sin(a), np.cos(a)])
        f = [(W * s - B * (l - s) / 2) * g * np.sin(a), 0, -m * g]
        A = np.array([[-d @ by_a, *d], [0, 0, 1]])[:rows]
        b = [-rate @ rate + d @ bend, 0][:rows]
        whole = np.block([[M, -A.T], [A, np.zeros((rows, rows))]])
        return np.linalg.solve(whole, [*f, *b])

    def along(_t, z):
        tip = np.array([-l * np.sin(z[0]), -l * np.cos(z[0])])
        return (z[1:3] - tip - [0, h]) @ tip / (r * l) - np.cos(c)

    times, a = [0.0], np.arccos(h / l)
    z = np.array([a, r - l * np.sin(a), 0, 0, 0, 0])

    def lifted(_t, z):
        return solved(z, 2)[4]

    for rows, ends in ((2, lifted), (1, along)):
        ends.terminal = True
        part = solve_ivp(
            lambda _t, z, n=rows: [*z[3:], *solved(z, n)[:3]], (times[-1], 5), z,
            "DOP853", events=ends, rtol=1e-13, atol=1e-13,
        )  # fmt: skip
        times.append(part.t_events[0][0])
        z = part.y_events[0][0]
    return times[1:], z


@pytest.mark.slow
def test_a_sling_lets_go():
    model = load(MODELS / "trebuchet.yaml")
    found = simulate(model)
    (trough, sling), z = trebuchet({p.name: p.value for p in model.parameters})
    happened = {(e.constraint or e.name): e.time for e in found.events}
    assert happened["trough"] == pytest.approx(trough, abs=1e-10)
    assert happened["let_go"] == happened["sling"] == pytest.approx(sling, abs=1e-10)
    # The stone flies on from there.
    t = found.t[-1] - sling
    assert found["x"][-1] == pytest.approx(z[1] + t * z[4], rel=1e-9)
    assert found["y"][-1] == pytest.approx(-0.5, abs=1e-9)
    assert z[2] + t * z[5] - 9.81 * t**2 / 2 == pytest.approx(-0.5, abs=1e-7)
    assert drift(found) < 1e-10


def hop(y, m=80.0, g=9.81, k=2e4, energy=80 * (9.81 + 12.5)):
    """Return the next apex of a runner after the apex at height y, by scipy."""
    low, foot = math.cos(math.radians(22)), math.sin(math.radians(22))
    z = [0, low, math.sqrt(2 * (energy / m - g * y)), -math.sqrt(2 * g * (y - low))]

    def stance(_t, z):
        length = math.hypot(z[0] - foot, z[1])
        push = k / m * (1 / length - 1)
        return [z[2], z[3], push * (z[0] - foot), push * z[1] - g]

    def lifts(_t, z):
        return math.hypot(z[0] - foot, z[1]) - 1

    lifts.terminal, lifts.direction = True, 1
    kept = {"rtol": 1e-13, "atol": 1e-13, "events": lifts}
    z = solve_ivp(stance, (0, 1), z, "DOP853", **kept).y[:, -1]
    return z[1] + z[3] ** 2 / (2 * g)


@pytest.mark.slow
def test_the_fixed_point_of_a_runner():
    fixed = brentq(lambda y: hop(y) - y, 0.93, 0.95, xtol=1e-14)
    start = {"y": fixed, "x_dot": math.sqrt(25 + 2 * 9.81 * (1 - fixed))}
    found = simulate(load(MODELS / "hopper.yaml", **start), duration=1.3)
    apex = found["y"] + np.where(found["stance"], -1, found["y_dot"] ** 2 / (2 * 9.81))
    flown = apex[found["stance"] == 0]
    assert len(acts(found, "touchdown")) == 5
    assert flown == pytest.approx(fixed, abs=1e-9)
    # Another height comes to it, hop by hop.
    found = simulate(MODELS / "hopper.yaml", duration=0.6)
    apex, y = found["y"] + found["y_dot"] ** 2 / (2 * 9.81), 1.0
    for time in acts(found, "liftoff"):
        y = hop(y)
        assert apex[np.searchsorted(found.t, time)] == pytest.approx(y, abs=1e-9)
    assert drift(found) < 1e-11


# A relay with hysteresis: T' = -T + 2 u between lo and hi.
RELAY = """
parameters: {lo: 0.9, hi: 1.1}
modes: {u: 0}
states: {T: {rate: -T + 2*u}}
events:
  heat: {at: T <= lo, set: {u: 1}}
  cool: {at: T >= hi, set: {u: 0}}
"""


@pytest.mark.parametrize("start", [0, 1000, -1])
@pytest.mark.parametrize("name", ["auto", "dop853", "radau", "taylor"])
def test_a_thermostat(name, start):
    text = scene(RELAY, "x: 0, T: 1.5", method=name, start=start)
    found = simulate(text)
    times = np.array([t for _, t in acts(found)]) - start
    first, rest = math.log(1.5 / 0.9), math.log(1.1 / 0.9)
    assert times == pytest.approx(first + rest * np.arange(13), abs=3e-12)
    assert [n for n, _ in acts(found)] == (["heat", "cool"] * 7)[:13]


@pytest.mark.parametrize(
    ("events", "named"),
    [
        ("on: {at: x_dot <= 1, set: {u: 2}}\n  off: {at: x_dot >= 1, set: {u: 0}}",
         ["on", "off"]),
        ("a: {at: x >= 1 + 1e-13*u, set: {u: u + 1}}", ["a"]),
    ],
)  # fmt: skip
def test_events_that_undo_each_other_end_the_run(events, named):
    text = f"modes: {{u: 0}}\nforces: {{x: u - 1}}\nevents:\n  {events}"
    found = simulate(scene(text, "x: 0, x_dot: 2"))
    assert (found.outcome, found.complete) == ("failed", False)
    failure = found.record["failure"]
    assert (failure["code"], failure["number"]) == ("events-chatter", "E512")
    assert ", ".join(f"`{n}`" for n in named) in found.record["reason"]
    assert "no time passes" in found.record["reason"]
    # It ends at the first of them: v = 2 - t; x = 2 t - t^2/2.
    time = 1.0 if named[0] == "on" else 2 - math.sqrt(2)
    assert found.record["end"] == pytest.approx(time, abs=1e-9)


@pytest.mark.parametrize(
    ("events", "names"),
    [
        ("a: {at: x >= 1, set: {u: 3}}\n  b: {at: u*x >= 2, set: {u: 0}}", ["a", "b"]),
        (("a: {at: x >= 1, set: {u: 3}}\n  b: {at: u >= 2, set: {u: 5}}\n  "
           "c: {at: u = 5, set: {u: 0}}"), ["a", "b", "c"]),
    ],
)  # fmt: skip
def test_events_that_restore_a_mode_end_nothing_if_none_is_due_again(events, names):
    text = f"modes: {{u: 0}}\nforces: {{x: u - 1}}\nevents:\n  {events}"
    found = simulate(scene(text, "x: 0, x_dot: 2"))
    assert found.outcome == "done"
    # v = 2 - t, x = 2 t - t^2/2, and x passes 1 upwards once.
    time = pytest.approx(2 - math.sqrt(2), abs=1e-9)
    assert acts(found) == [(name, time) for name in names]
    assert found["x"][-1] == pytest.approx(1.5, abs=1e-9)
    assert found["u"][-1] == 0


def relay(v, A, c, k, f, w):
    """Return acts of v' = a - k v + f sin(w t) at v = c: (names, times, chatters)."""
    t, names, times, a = 0.0, [], [], A[0]
    side = 1 if v > c else -1
    while True:
        out = solve_ivp(
            lambda t, v, a=a: a - k * v + f * math.sin(w * t), (t, 6), [v], "DOP853",
            rtol=1e-12, atol=1e-13, dense_output=True,
        ).sol  # fmt: skip
        grid = np.linspace(t, 6, 6001)
        off = side * (out(grid)[0] - c)
        off[:2] = 1  # it begins there
        if not np.any(off <= 0):
            return names, times, False
        i = int(np.argmax(off <= 0))
        t, v = brentq(lambda t, of=out: of(t)[0] - c, *grid[i - 1 : i + 1]), c
        rates = [a - k * c + f * math.sin(w * t) for a in A[1:]]  # by `lo`, by `hi`
        which = int(side < 0)
        names.append(("lo", "hi")[which])
        times.append(t)
        if (rates[which] > 0) == (side > 0):  # it turns back: the other acts, too
            which = 1 - which
            names.append(("lo", "hi")[which])
            times.append(t)
            if (rates[which] > 0) != (side > 0):
                return names, times, True
        a, side = A[1 + which], 1 if rates[which] > 0 else -1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_a_relay_without_hysteresis(seed):
    # What turns back at its level is undone at once, or passes: in any units, far from
    # the origin, and later.
    random = np.random.default_rng(seed)
    *A, c, k, f, w, v = random.uniform(
        [-2, -2, -2, -0.5, 0, 0, 0.5, -1.5], [2, 2, 2, 0.5, 2, 1.5, 3, 1.5]
    ).tolist()
    start, size, far = ((0, 1, 0), (1000, 1e6, 0), (-3, 1e-5, 100))[seed % 3]
    text = scene(
        f"modes: {{a: {A[0]!r}}}\n"
        f"definitions: {{x: X/{size}, at: x_dot + {far}}}\n"
        f'forces: {{x: "a - {k!r}*x_dot + {f!r}*sin({w!r}*(t - ({start})))"}}\n'
        "events:\n"
        f"  lo: {{at: at <= {c + far!r}, set: {{a: {A[1]!r}}}}}\n"
        f"  hi: {{at: at >= {c + far!r}, set: {{a: {A[2]!r}}}}}\n",
        f"X: 0, X_dot: {v * size!r}", 6,
        FREE.replace("{x: {}}", "{X: {}}"), start=start,
    )  # fmt: skip
    found = simulate(text)
    names, times, chatters = relay(v, A, c, k, f, w)
    assert (found.record["failure"] or {}).get("code") == (
        "events-chatter" if chatters else None
    )
    assert [n for n, _ in acts(found)] == names
    assert [t - start for _, t in acts(found)] == pytest.approx(times, abs=1e-9)


@pytest.mark.slow
def test_crossings_are_no_chatter():
    # cos t passes 0 and 0.5: each condition counts once it has been false.
    text = scene(
        "modes: {s: 1, n: 0, flip: 1}\nevents:\n"
        "  down: {at: x <= 0, set: {s: -1, n: n + 1}}\n"
        "  up: {at: x >= 0, set: {s: 1, n: n + 1}}\n"
        "  both: {at: flip*(x - 0.5) <= 0, set: {flip: -flip}}\n"
        "  equal: {at: x = 0.5, set: {s: s}}\n",
        "x: 1", "20*pi", FREE.replace("potential: 0", "potential: x^2/2"),
    )  # fmt: skip
    found = simulate(text)
    k = np.arange(20)
    assert acts(found, "down") == pytest.approx(math.pi * (2 * k[:10] + 0.5), abs=1e-10)
    assert acts(found, "up") == pytest.approx(math.pi * (2 * k[:10] + 1.5), abs=1e-10)
    assert found["n"][-1] == 20
    both = np.sort(np.concatenate([2 * math.pi * (k[1:11]) - math.pi / 3,
                                   2 * math.pi * k[:10] + math.pi / 3]))  # fmt: skip
    assert acts(found, "both") == pytest.approx(both, abs=1e-10)
    assert acts(found, "equal") == pytest.approx(both, abs=1e-10)


@pytest.mark.parametrize("options", [
    {}, {"method": "dop853"}, {"method": "rk4", "step": 0.1}, {"start": 1000},
])  # fmt: skip
@pytest.mark.parametrize("apart", [1e-3, 1e-5, 1e-6])
def test_two_roots_of_an_equation_close_together(apart, options):
    """At a uniform speed, far closer than a step is long."""
    at = f"(x - 1)*(x - 1 - {apart}) = 0"
    text = f"modes: {{n: 0}}\nevents: {{hit: {{at: {at}, set: {{n: n + 1}}}}}}"
    found = simulate(scene(text, "x: 0, x_dot: 1", **options))
    assert found.outcome == "done"
    times = np.array(acts(found, "hit")) - options.get("start", 0)
    # The second is known to what rounding leaves of f there, where f' is `apart`.
    assert times == pytest.approx([1, 1 + apart], abs=1e-12 + 3e-14 / apart)


@pytest.mark.slow
@pytest.mark.parametrize("at", ["y = G", "y <= G", "y - (G) = 0"])
@pytest.mark.parametrize(("e", "ground", "unit", "options"), [
    (0.9, "0", 1, {}),
    (0.9, "5", 1, {}),
    (0.5, "0", 1, {}),
    (0.7, "0.3*t", 1, {}),
    (0.9, "5e6", 1e6, {"start": 1000}),
    (0.9, "0", 1e-3, {"method": "rk4", "step": 0.0037}),
])  # fmt: skip
def test_an_event_at_the_ground_counts_each_impact(at, e, ground, unit, options):
    """Down to the last flight, of some 1e-6 s, at the times of all impacts."""
    at = at.replace("G", ground)
    text = (
        f"modes: {{n: 0}}\nevents: {{hit: {{at: {at!r}, set: {{n: n + 1}}}}}}\n"
        f"constraints: {{ground: {{relation: y >= {ground}, restitution: {e}}}}}"
    )
    sections = (
        "coordinates: {y: {}}\n"
        f"energy: {{kinetic: y_dot^2/2, potential: {9.81 * unit!r}*y}}\n"
    )
    first = "0" if "t" in ground else ground
    found = simulate(
        scene(text, f"y: {first} + {0.7 * unit!r}", 9, sections, **options)
    )
    struck = [x.time for x in found.events if x.kind == "impact"]
    assert acts(found, "hit") == struck
    assert found["n"][-1] == len(struck)
    if ground == "0":
        # Flights get shorter by e, down to 1e-11 of the height: by e^2 each.
        tolerance = 1e-11 if "method" not in options else 1e-9
        assert len(struck) >= math.log(tolerance) / (2 * math.log(e))


@pytest.mark.parametrize(
    "name", ["dop853", "rk4", pytest.param("euler", marks=pytest.mark.slow)]
)
def test_what_an_impact_makes_true_for_the_shortest_flight(name):
    """A ball's rate becomes positive at every impact, also where a step is a flight.

    The second row of an impact shows the modes set, and their effect.
    """
    ball = FREE.replace("potential: 0", "potential: 9.81*x + hits")
    text = """modes: {hits: 0}
events: {hit: {at: x_dot >= 0, set: {hits: hits + 1}}}
constraints: {floor: {relation: x >= 0, restitution: 0.6}}"""
    asked = {"method": name, "output_step": 0.1} | (
        {"step": 0.01} if name != "dop853" else {}
    )
    found = simulate(scene(text, "x: 0.3", 1.5, ball, **asked))
    impacts = [e.time for e in found.events if e.kind == "impact"]
    assert len(impacts) > 10
    assert acts(found, "hit") == impacts
    t, hits = found["t"], found["hits"]
    for k, time in enumerate(impacts):
        assert hits[t == time].tolist() == [k, k + 1]
        first, second = np.flatnonzero(t == time)
        assert found["potential"][second] - found["potential"][first] == pytest.approx(
            1
        )
    if name == "dop853":
        assert drift(found) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize(
    ("a", "b", "start", "method", "until"),
    [
        ("x", "z", "x: 1 + 1e-14, z: 1", "dop853", "x <= 0"),  # b is met first
        ("z - x", "x + 0.15*z", "x: 0, z: 1.25", "rk4", "z <= x"),  # in a corner
    ],
)
def test_at_an_impact_gaps_are_closed(a, b, start, method, until):
    """A ball meets two walls at once: both gaps are 0, whatever the rounding."""
    potential = "10*(x + z)" if a == "x" else "10*z"
    text = f"""
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + z_dot^2)/2, potential: {potential}}}
modes: {{n: 0, m: 0, k: 0}}
constraints:
  a: {{relation: {a} >= 0, restitution: 0.9}}
  b: {{relation: {b} >= 0, restitution: 0.9}}
events:
  a: {{at: {a} <= 0, set: {{n: n + 1}}}}
  again: {{at: {a} <= 0, set: {{k: k + 1}}}}
  b: {{at: {b} <= 0, set: {{m: m + 1}}}}
"""
    options = {"output_step": 0.1, "method": method}
    found = simulate(scene(text, start, 2.5, "", **options))
    for law, mode in ("a", "n"), ("a", "k"), ("b", "m"):
        times = [
            e.time for e in found.events if (e.kind, e.constraint) == ("impact", law)
        ]
        assert len(times) >= 2
        assert found[mode][-1] == len(times)
        assert acts(found, {"n": "a", "k": "again", "m": "b"}[mode]) == times
    ended = simulate(scene(text, start, 2.5, "", until=until, **options))
    first = math.sqrt(0.2) if a == "x" else 0.5
    assert ended.t[-1] == pytest.approx(first, abs=1e-9)


# --- Periodic events


def balanced(p, duration, start):
    """Return states of the cart-pole at its samples, by scipy from one to the next."""
    M, m, l, g, T, F = (p[k] for k in "MmlgTF")  # noqa: E741

    def rates(_t, z, u):
        _, th, v, w = z
        mass = [[M + m, m * l * np.cos(th)], [m * l * np.cos(th), m * l**2]]
        f = [u + m * l * w**2 * np.sin(th), m * g * l * np.sin(th)]
        return [v, w, *np.linalg.solve(mass, f)]

    states = [np.array(start)]
    for _ in range(round(duration / T)):
        u = np.clip(np.dot([9.33, 51, 8.74, 11.1], states[-1]), -F, F)
        kept = {"args": (u,), "rtol": 1e-13, "atol": 1e-14}
        states.append(solve_ivp(rates, (0, T), states[-1], "DOP853", **kept).y[:, -1])
    return np.array(states)


@pytest.mark.parametrize("start", [0, pytest.param(1000, marks=pytest.mark.slow)])
def test_a_sampled_controller(start):
    model = load(MODELS / "cart-pole.yaml")
    text = (MODELS / "cart-pole.yaml").read_text("utf-8")
    text = text.replace("{duration: 5,", f"{{start: {start}, duration: 2,")
    found = simulate(text)
    known = {p.name: p.value for p in model.parameters}
    expected = balanced(known, 2, [-0.5, 0.3, 0, 0])
    columns = ("x", "theta", "x_dot", "theta_dot")
    at_samples = np.array([found[name][::2] for name in columns]).T
    assert at_samples == pytest.approx(expected, abs=1e-9)
    # A row at a sample shows the force from then on, and one between what it was.
    u = np.clip(at_samples @ [9.33, 51, 8.74, 11.1], -10, 10)
    assert found["u"][::2] == pytest.approx(u, abs=1e-12)
    assert list(found["u"][1::2]) == list(found["u"][:-1:2])
    assert acts(found, "sample") == [start + k * 0.01 for k in range(201)]
    assert drift(found) < 1e-13


SAMPLED = """
modes: {u: 0}
forces: {x: u - 4*x}
events: {sample: {every: 0.25, set: {u: 1 - x_dot}}}
"""


@pytest.mark.parametrize("name", names())
def test_every_method_samples_at_the_same_times(name):
    step, far = {"euler": (1e-4, 2e-3), "moreau": (1e-4, 2e-3)}.get(name, (0.002, 1e-5))
    far = 1e-9 if method(name).ADAPTIVE else far
    text = scene(SAMPLED, "x: 1", method=name, step=step, output_step=0.05)
    if (found := simulated(text)) is None:
        assert not method(name).ADAPTIVE
        return
    x, v, values = 1.0, 0.0, []
    for _ in range(12):
        u = 1 - v
        t = np.arange(5) * 0.05
        s, c = np.sin(2 * t), np.cos(2 * t)
        values += [(x - u / 4) * c + v / 2 * s + u / 4]
        s, c = math.sin(0.5), math.cos(0.5)
        x, v = (x - u / 4) * c + v / 2 * s + u / 4, v * c - 2 * (x - u / 4) * s
    assert found["x"][:-1] == pytest.approx(np.concatenate(values), abs=far)
    assert acts(found, "sample") == [0.25 * k for k in range(13)]


def test_events_at_one_time_act_in_the_order_of_the_file():
    text = """
modes: {a: 1, b: 2, n: 0, late: 0, seen: 0, first: 0}
events:
  swap: {every: 0.3, set: {a: b, b: a}}
  count: {every: 0.1, set: {n: n + 1, first: t}, once: true}
  add: {every: 0.1, set: {n: n + 10}}
  see: {every: 0.3, set: {seen: n + 1000*a}}
  full: {at: n >= 61, set: {late: t}}
"""
    found = simulate(scene(text, "x: 0", 0.9, output_step=0.1))
    assert list(found["n"]) == [11 + 10 * k for k in range(10)]
    assert list(found["a"]) == [2, 2, 2, 1, 1, 1, 2, 2, 2, 1]
    assert list(found["b"]) == [1, 1, 1, 2, 2, 2, 1, 1, 1, 2]
    # 3*0.1 is not 0.3: within rounding they are one time.
    assert list(found["seen"]) == [2011] * 3 + [1041] * 3 + [2071] * 3 + [1101]
    assert list(found["late"]) == [0] * 5 + [pytest.approx(0.5)] * 5
    assert (len(found.t), found.t[-1], set(found["first"])) == (10, 0.9, {0.0})
    assert acts(found, "count") == [0.0]
    assert [n for n, x in acts(found) if x == 0.0] == ["swap", "count", "add", "see"]


@pytest.mark.slow
def test_a_start_is_examined_with_what_is_set_there():
    text = scene(
        "modes: {held: 0, u: 3}\n"
        "events: {first: {every: 10, set: {held: 1, u: x_dot}}}\n"
        "constraints: {wall: {relation: x_dot = 2, when: held > 0}}",
        "x: 0, x_dot: {guess: 0}",
    )  # fmt: skip
    found = check(load(text))
    assert found.constraints[0]["satisfied"]
    assert found.degrees_of_freedom == 0
    assert simulate(text)["x_dot"] == pytest.approx(2, abs=1e-14)
    with pytest.raises(InadmissibleError):
        simulate(text.replace("{guess: 0}", "0"))


# --- What changes by events


def test_what_a_mode_does_to_the_energy_is_work():
    # x = cos t until 2, then with four times the stiffness.
    text = scene(
        "modes: {K: 1}\nevents: {stiffer: {at: y >= 2, set: {K: 4}}}",
        "x: 1, y: 0, y_dot: 1",
        sections="coordinates: {x: {}, y: {}}\n"
        "energy: {kinetic: x_dot^2/2 + y_dot^2/2, potential: K*x^2/2 + K}\n",
    )  # fmt: skip
    found = simulate(text)
    after = found.t > 2
    expected = np.where(after, 3 * (math.cos(2) ** 2 / 2 + 1), 0.0)
    assert found["work"] == pytest.approx(expected, abs=1e-10)
    assert drift(found) < 1e-10
    t = found.t[after] - 2
    x = math.cos(2) * np.cos(2 * t) - math.sin(2) / 2 * np.sin(2 * t)
    assert found["x"][after] == pytest.approx(x, abs=1e-10)


@pytest.mark.parametrize("relation", ["x_dot = y_dot", "x = y", "x - y >= 0"])
def test_what_comes_into_force_strikes(relation):
    # A mass of 1 at speed 3 takes another of 2 along from x = y = 1 on.
    one_sided = ", restitution: 0" if ">" in relation else ""
    text = scene(
        f"modes: {{on: 0}}\nevents: {{hook: {{at: x >= 1, set: {{on: 1}}}}}}\n"
        f"constraints: {{c: {{relation: {relation}, when: on > 0{one_sided}}}}}",
        "x: 0, y: 1, x_dot: 3",
        sections="coordinates: {x: {}, y: {}}\n"
        "energy: {kinetic: x_dot^2/2 + y_dot^2, potential: 0}\n", duration=1,
    )  # fmt: skip
    if ">" in relation:
        text = text.replace("x - y >= 0", "y - x >= 0")
    found = simulate(text)
    assert "impact" in {e.kind for e in found.events}
    assert acts(found, "hook") == pytest.approx([1 / 3], abs=1e-12)
    assert found["x_dot"][-1] == found["y_dot"][-1] == pytest.approx(1, abs=1e-12)
    twice = np.flatnonzero(np.diff(found.t) == 0)
    assert len(twice) == 1  # rows before and after the impact
    assert drift(found) < 1e-12


@pytest.mark.slow
def test_positions_that_do_not_meet_end_the_run():
    text = scene(
        "modes: {on: 0}\nevents: {hook: {at: x >= 1, set: {on: 1}}}\n"
        "constraints: {c: {relation: x = 3, when: on > 0}}", "x: 0, x_dot: 1",
    )  # fmt: skip
    found = simulate(text)
    assert found.record["failure"]["code"] == "constraint-jumps"
    moving = text.replace("x = 3, when: on > 0", "x_dot = 1 + on")
    found = simulate(moving, method="dop853")
    assert found["x"][-1] == pytest.approx(1 + 2 * 2, abs=1e-9)
    found = simulate(scene(
        "modes: {d: 0}\nevents: {jump: {every: 1, set: {d: floor(t)}}}\n"
        "constraints: {c: x = d}"))  # fmt: skip
    assert found.record["failure"]["code"] == "constraint-jumps"
    assert found.record["end"] == 1.0


@pytest.mark.slow
def test_what_depends_on_modes_in_time_begins_anew():
    # A force from the time `on` on, and a pulse at `when`, both set by an event at 1.
    text = scene(
        "modes: {on: 9, when: 9, d: 0}\nforces: {x: heaviside(t - on)"
        " + d*exp(-((t - when)/1e-4)^2/2)/(1e-4*sqrt(2*pi))}\n"
        "events:\n  plan: {every: 1, set: {on: t + 0.3, when: t + 0.6, d: 1 + t}}\n",
        duration=2, output_step=0.1,
    )  # fmt: skip
    found = simulate(text)
    times = [e.time for e in found.events if e.kind == "switch"]
    # At the doubles of the rows, of which one is not 0.3.
    assert times == [3 * 0.1, 1.3]
    t = found.t
    v = np.clip(t - 0.3, 0, 0.7) + np.clip(t - 1.3, 0, 1) + (t > 0.65) + 2 * (t > 1.65)
    apart = (np.abs(t - 0.6) > 0.05) & (np.abs(t - 1.6) > 0.05)
    assert found["x_dot"][apart] == pytest.approx(v[apart], abs=1e-8)


@pytest.mark.parametrize("until", ["x >= 1", "n >= 3", "x_dot = 2"])
def test_until_at_the_time_of_an_event(until):
    text = scene(
        "modes: {n: 0}\nforces: {x: 2}\nevents:\n  hit: {at: x >= 1, set: {n: n + 2}}\n"
        "  tick: {every: 1, set: {n: n + 1}}\n", until=until,
    )  # fmt: skip
    found = simulate(text)
    assert (found.outcome, found.t[-1]) == ("until", pytest.approx(1.0, abs=1e-12))
    assert {n for n, t in acts(found) if t > 0.5} >= {"hit"}
    assert found["n"][-1] == 4
    assert found.events[-1].kind == "until"


def test_a_brake_that_a_mode_lets_go():
    # A block on a slope of 3, held by dry friction; sampled, its limit falls to 1.
    text = scene(
        "modes: {F: 5}\nforces: {x: 3}\n"
        "events: {ease: {every: 1, set: {F: max(1, F - 1)}}}\n"
        "constraints: {brake: {relation: x_dot = 0, limit: F}}", duration=4,
    )  # fmt: skip
    found = simulate(text)
    # F is 4, 3, 2, 1: it slips from t = 2 on (at 3 it just holds).
    t = np.clip(found.t - 2, 0, 1), np.clip(found.t - 3, 0, 1)
    assert found["x_dot"] == pytest.approx(t[0] * 1 + t[1] * 2, abs=1e-10)
    assert drift(found) < 1e-10


@pytest.mark.slow
def test_contact_and_switch_beside_events():
    # A ball on dry ground (mu 0.5): a rope pulls by a mode that samples its speed.
    text = scene(
        "modes: {u: 0, e: 0.5}\nforces: {x: u - 2*sign(x_dot)}\n"
        "events:\n"
        "  pull: {every: 0.5, set: {u: if(x_dot < 1, 6, 0), e: 0.5/(1 + 2*t)}}\n"
        "constraints: {floor: {relation: y >= 0, restitution: e}}",
        "x: 0, y: 0.45", 2.5,
        "coordinates: {x: {}, y: {}}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 10*y}\n",
    )  # fmt: skip
    found = simulate(text)
    t = found.t
    # Speeds: 4 t to 2 at 0.5, to 1 at 1 and, not < 1, on to 0 at 1.5; then anew.
    v = np.interp(t, [0, 0.5, 1, 1.5, 2, 2.5], [0, 2, 1, 0, 2, 1])
    assert found["x_dot"] == pytest.approx(v, abs=1e-9)
    assert found["u"][-2] == 0
    struck = [e.time for e in found.events if e.kind == "impact"]
    # The floor gets softer: 3 m/s becomes 1.5, then 0.375.
    assert struck[:3] == pytest.approx([0.3, 0.6, 0.675], abs=1e-10)
    assert drift(found) < 1e-10


# --- Runs again: error bars, states between rows, bindings, sweeps, resumed runs


@pytest.mark.slow
def test_repeats_begin_with_the_modes_of_the_start():
    model = load(MODELS / "hopper.yaml")
    found = simulate(model, error_bar="always", duration=1)
    assert 0 < found.error.relative < 1e-10
    again = simulate(model, duration=1)
    for name in found.columns:
        assert found[name].tobytes() == again[name].tobytes()
    at = found.at([0.2, 0.4])
    assert list(at["stance"]) == [1, 0]
    rows = np.searchsorted(found.t, [0.2, 0.4])
    assert at["y"] == pytest.approx(found["y"][rows], abs=1e-12)


@pytest.mark.slow
def test_modes_are_bound_and_swept():
    text = scene(LATCH, duration=2)
    model = load(text)
    assert acts(simulate(model.bind(open=1))) == []
    swept = sweep(text, {"open": [0, 1]}, jobs=1)
    ends = [simulate(text)["x_dot"][-1], 2 * math.tanh(10)]
    assert swept["x_dot.end"] == pytest.approx(ends, rel=1e-10)
    text = f"parameters: {{T: 0.5}}{SAMPLED}".replace("every: 0.25", "every: T")
    periods = load(scene(text))
    assert acts(simulate(periods.bind(T=1)), "sample") == [0.0, 1.0, 2.0, 3.0]


def test_what_is_not_finite_names_event_and_mode():
    text = "modes: {u: 0}\nevents: {bad: {at: x >= 1, set: {u: 1/(x_dot - 1)}}}"
    found = simulate(scene(text, "x: 0, x_dot: 1"))
    assert found.record["failure"]["code"] == "values-not-finite"
    assert "`u` in the event `bad` at t = " in found.record["reason"]


@pytest.mark.slow
def test_files_of_a_run(tmp_path, lagsim):  # noqa: F811
    (tmp_path / "latch.yaml").write_text(scene(LATCH, duration=2, output_step=0.5))
    shown = lagsim("run", "latch.yaml", "-o", "out", "--no-plots", code=0).out
    assert "events        1 event at `latch`" in shown
    record = json.loads((tmp_path / "out/run.json").read_bytes())
    [event] = record["events"]
    assert (event["kind"], event["name"]) == ("event", "latch")
    head, line = (tmp_path / "out/events.csv").read_text().splitlines()
    assert head.split(",")[-1] == "name"
    assert line.split(",")[1::6] == ["event", "latch"]
    head = (tmp_path / "out/trajectory.csv").read_text().splitlines()[0]
    assert head.startswith("t,x,x_dot,x_ddot,open,kinetic")
    for form in ("text", "latex", "json", "python"):
        shown = lagsim("derive", "latch.yaml", "--format", form, code=0).out
        assert "open" in shown
        assert "latch acts at x_dot >= 15" in shown or form != "text"
    lagsim("golden", "latch.yaml", "--update", code=0)
    lagsim("golden", "latch.yaml", code=0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["taylor", "radau", "dop853"])
@pytest.mark.parametrize(
    ("condition", "height"),
    [("floor(10*x) >= 21", 2.1), ("max(0, x - 2.14) >= 0.005", 2.145),
     ("if(x > 2.12 and t < 9, 1, 0) >= 0.5", 2.12), ("sign(x - 2.14) >= 1", 2.14),
     ("abs(x - 3) <= 0.86", 2.14)],
)  # fmt: skip
def test_a_condition_of_switches_is_met_within_a_long_step(condition, height, name):
    """Thrown up: a series of two terms is exact, and a step is the whole run."""
    text = scene(
        f"modes: {{n: 0}}\nevents: {{e: {{at: '{condition}', set: {{n: n + 1}}}}}}",
        "x: 0, x_dot: 6.4938",
        duration=50,
        sections=FREE.replace("potential: 0", "potential: 9.81*x"),
    )
    found = simulate(load(text), method=name)
    t = (6.4938 - math.sqrt(6.4938**2 - 2 * 9.81 * height)) / 9.81
    assert acts(found, "e") == [pytest.approx(t, abs=1e-9)]


def test_an_event_of_a_family_is_derived_with_its_index():
    text = scene(
        "modes: {'u(1..2)': 0}\n"
        "events: {'latch(i = 1..2)': {at: x >= i, set: {'u(i)': 1}}}"
    )
    shown = derive(text).text
    assert "latch.2 acts at x >= i for i = 2" in shown


# Events of one instant, by the rules of the contract: names and times.
INSTANTS = {
    # mod jumps from 2 to 0: `down` becomes true, `up` false, and true again by an act.
    "a jump between": (
        ("modes: {u: 0, n: 0}\n"
        "events:\n  up: {at: mod(x, 2) + 3*u >= 1, set: {n: n + 1}}\n"
        "  down: {at: mod(x, 2) + 3*u <= 1, set: {u: 1 - u}}"),
        "x: 1.5, x_dot: 0.5", [("down", 1.0), ("up", 1.0)],
    ),
    # What acts once, or by the clock, restores modes: no cycle.
    "once": (
        ("modes: {u: 0}\n"
        "events:\n  clock: {every: 1, set: {u: 1 - u}}\n"
        "  back: {at: u >= 0.5 + 0*x, once: true, set: {u: 1 - u}}"),
        "x: 0", [("clock", 0.0), ("back", 0.0), ("clock", 1.0), ("clock", 2.0)],
    ),
    "once later": (
        ("modes: {u: 1}\n"
        "events:\n  clock: {every: 1, set: {u: 1 - u}}\n"
        "  back: {at: u - 0.4*t >= 0.5 - 0*x, once: true, set: {u: 0}}"),
        "x: 0", [("clock", 0.0), ("clock", 1.0), ("back", 1.0), ("clock", 2.0)],
    ),
    # It is true just after the start, false from 1.5 to 2, and true again.
    "at once, and again": (
        "modes: {n: 0}\nevents:\n  up: {at: 'mod(-x, 2) >= 0.5', set: {n: n + 1}}",
        "x: 0, x_dot: 1",
        [("up", 0.0), ("up", 2.0)],
    ),
    # Both were due together.
    "one round at the start": (
        ("modes: {u: 1, n: 0}\n"
        "events:\n  clock: {every: 1, set: {n: n + 1}}\n"
        "  a: {at: n + 0*x >= 0.5, set: {u: 1 - u}}\n"
        "  b: {at: n + 0*x >= 0.5, set: {u: 1 - u}}"),
        "x: 0",
        [("clock", 0.0), ("a", 0.0), ("b", 0.0), ("clock", 1.0), ("clock", 2.0)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", INSTANTS)
def test_events_of_one_instant(case):
    text, begin, right = INSTANTS[case]
    found = simulate(scene(text, begin, duration=2.5))
    assert found.outcome == "done"
    assert acts(found) == [(name, pytest.approx(t, abs=1e-12)) for name, t in right]


@pytest.mark.parametrize("unit", [1.0, 1e3, 1e-9])
@pytest.mark.parametrize(
    "at",
    [
        "if(x < z, 1, 0) >= 0.5",
        "if(not (x < z), -1, 1) >= 0",
        "0.3 + sign(z - x) >= 0.9",
        "floor((x - z)/(9*a)) <= -0.5",
    ],
)
def test_an_inequality_that_accelerations_make_true_just_after_the_start(at, unit):
    # x = z = 0 with one velocity: only the deceleration of x separates the two.
    sections = f"""
parameters: {{a: {unit}}}
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: x_dot^2/2 + z_dot^2/2, potential: a*x}}
modes: {{n: 0}}
events: {{e: {{at: "{at}", set: {{n: n + 1}}}}}}
"""
    found = simulate(scene("", "x: 0, z: 0, x_dot: a, z_dot: a", 1.5, sections))
    assert acts(found) == [("e", 0.0)]
    assert (found["n"] == 1.0).all()


@pytest.mark.parametrize("method", ["taylor", "dop853", "dopri5", "radau", "rk4"])
@pytest.mark.parametrize("force", ["1 - t", "2*abs(z)*(1 - t)"])
@pytest.mark.parametrize("at", ["x + 0.9*abs(x) <= 0", "0 >= max(x, 2*x)", "x <= 0"])
def test_a_condition_true_at_a_kink_at_the_start_acts_when_it_is_true_again(
    at, force, method
):
    # x = t^2/2 - t^3/6: the mass leaves 0 from rest, and comes back at t = 3.
    step = ", step: 0.01" if method == "rk4" else ""
    sections = f"""
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: x_dot^2/2 + z_dot^2/2, potential: 0}}
forces: {{x: "{force}"}}
modes: {{n: 0}}
events: {{e: {{at: "{at}", set: {{n: n + 1}}}}}}
"""
    begin, options = "x: 0, z: 0.5", f"4, method: {method}{step}"
    found = simulate(scene("", begin, options, sections))
    assert acts(found) == [("e", pytest.approx(3.0, abs=1e-8))]


# --- Faults of a file


@pytest.mark.parametrize(
    ("event", "code", "hint"),
    [
        ("{at: x >= 1, set: {⟨x⟩: 0}}", "not-a-mode", "no event moves a body"),
        ("{at: x >= 1, set: {⟨x_dot⟩: 0}}", "not-a-mode", "write impulse: {"),
        ("{at: x >= 1, set: {⟨p⟩: 0}}", "not-a-mode", "`modes` instead of"),
        ("{at: x >= 1, set: {⟨s⟩: 0}}", "not-a-mode", "its rate may depend on a mode"),
        ("{at: x >= 1, set: {⟨hled⟩: 0}}", "unknown-name", "did you mean `held`?"),
        ("{at: x >= 1, set: {u: ⟨x_ddot⟩}}", "output-only", "for output"),
        ("{at: x >= 1, ⟨every⟩: 1, set: {u: 1}}", "both-given", "located"),
        ("{every: ⟨-1⟩, set: {u: 1}}", "out-of-range", "choose a number"),
        ("{every: ⟨held⟩, set: {u: 1}}", "not-constant", "made of parameters"),
        ("{at: ⟨p >= 1⟩, set: {u: 1}}", "no-coordinate", "`every`"),
        ("{at: x >= 1, set: {u: 1}, once: ⟨maybe⟩}", "not-a-truth", "`true`"),
        ("{at: x >= 1, ⟨sets⟩: {u: 1}}", "unknown-key", "did you mean `set`?"),
    ],
)  # fmt: skip
def test_faults(event, code, hint):
    text = scene(
        f"parameters: {{p: 1}}\nstates: {{s: {{rate: 0}}}}\nmodes: {{u: 0, held: 1}}\n"
        f"events: {{e: {event}}}", "x: 0, s: 0",
    )  # fmt: skip
    before, wrong, _ = re.split("[⟨⟩]", text)
    with pytest.raises(InputError) as error:
        load(text.replace("⟨", "").replace("⟩", ""))
    [problem] = error.value.problems
    assert (problem.code, problem.place.length) == (code, len(wrong))
    above, _, line = before.rpartition("\n")
    place = above.count("\n") + 2, len(line) + 1
    assert (problem.place.line, problem.place.column) == place
    assert hint in problem.whole.hint


@pytest.mark.parametrize(
    ("sections", "code"),
    [
        ("modes: {u: 0}\nevents: {e: {set: {u: 1}}}", "missing-key"),
        ("modes: {u: 0}\nevents: {e: {at: x >= 1}}", "missing-key"),
        ("modes: {u: 0}\nevents: {t: {at: x >= 1, set: {u: 1}}}", "reserved-name"),
        ("modes: {x: 0}", "name-clash"),
        ("parameters: {p: u}\nmodes: {u: 0}", "not-constant"),
        ("modes: {u: 0}\nevents: {e: {every: 1e-12, set: {u: 1}}}", "out-of-range"),
    ],
)  # fmt: skip
def test_faults_beside_events(sections, code):
    with pytest.raises(InputError) as error:
        simulate(scene(sections, "x: 0"))
    assert [p.code for p in error.value.problems] == [code]
