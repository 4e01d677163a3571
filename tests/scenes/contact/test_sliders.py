"""Sliders without mass between springs: Jenkins and Iwan elements, by other means.

The play operator, exact between turning points, and scipy, whose events begin and end
each slip.
"""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lagsim
from tests.scenes.contact.motions import GLOBAL, close, play, scene
from tests.support import refused

K, M, SPRING, FORCE = 3.0, 1.0, 2.0, 0.5
JENKINS = {"slider": {"relation": "s_dot = 0", "limit": FORCE}}


def jenkins(**more):
    """A mass on a spring, and on another in series with a slider."""
    given = {"x": 0.0, "s": 0.0, "x_dot": 1.0} | more.pop("start", {})
    potential = f"{K}*x^2/2 + {SPRING}*(x - s)^2/2"
    given_more = {"duration": 8, "output_step": 0.01} | more
    return scene("x s", "x_dot^2/2", potential, JENKINS, given, **given_more)


def springs(limits, stiffness, force, duration, v=0.0):
    """Motion of a mass on a spring of 1 N/m beside Jenkins elements, by scipy.

    Returns x (rows,) every 0.01 s, and the times of slips and sticks.
    """
    F, k = np.array(limits), np.array(stiffness)
    moving = np.zeros(len(F))
    y, t, times = np.array([0.0, v, *np.zeros(len(F))]), 0.0, []
    rows, grid = [], np.arange(0.0, duration + 0.005, 0.01)

    def rates(t, y):
        pull = k * (y[0] - y[2:])
        slips = np.where(moving != 0.0, y[1], 0.0)
        return [y[1], force(t) - K * y[0] - pull.sum(), *slips]

    def end_of(j):
        def slips(_, y):
            return F[j] - abs(k[j] * (y[0] - y[2 + j]))

        def sticks(_, y):
            return moving[j] * y[1]

        found = sticks if moving[j] else slips
        found.terminal, found.direction = True, -1.0
        return found

    while t < duration:
        part = solve_ivp(
            rates, (t, duration), y, "DOP853", rtol=1e-13, atol=1e-14, max_step=0.05,
            events=[end_of(j) for j in range(len(F))], dense_output=True,
        )  # fmt: skip
        inside = grid[(grid >= t) & (grid < part.t[-1])]
        rows += part.sol(inside)[0].tolist()
        t, y = part.t[-1], part.y[:, -1]
        for j, found in enumerate(part.t_events):
            if moving[j] and abs(y[1]) < 1e-10:  # all stop at one time
                moving[j] = 0.0
                times.append(t)
            elif len(found):
                moving[j] = np.sign(y[1])
                times.append(t)
    return np.array([*rows, y[0]]), times


def played(x, reach, s=0.0):
    """Positions of a slider that a spring drags along x (rows,): Moreau's play."""
    return np.array(
        list(itertools.accumulate(x, lambda s, x: np.clip(s, x - reach, x + reach),
             initial=s))
    )[1:]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "within"),
    [("dop853", GLOBAL), ("rk4", 1e-7), ("rattle", 1e-3), ("euler", 0.2)],
)
def test_a_mass_on_a_jenkins_element(method, within):
    """Motion and events by scipy; force and limit agree to rounding while it slides."""
    options = {} if method == "dop853" else {"step": 0.005}
    found = play(jenkins(method=method, **options))
    x, times = springs([FORCE], [SPRING], lambda _: 0.0, 8.0, v=1.0)
    close(found["x"], x, within)
    events = found.result.events
    assert [e.kind for e in events] == ["slip", "stick"] * (len(times) // 2) + [
        "slip"
    ] * (len(times) % 2)
    if within < 0.1:
        close([e.time for e in events], times, max(within, 1e-8))
    force = SPRING * (found["x"] - found["s"])
    close(found["lambda_slider"], -force, 1e-14)
    slides = found["residual_slider"] != 0.0
    assert 20 < slides.sum() < 400
    assert np.abs(np.abs(force[slides]) - FORCE).max() < 1e-14
    assert not found["s_dot"][~slides].any()
    if method == "dop853":
        balance = found["energy"] - found["work"]
        assert np.ptp(balance) < 1e-11


@pytest.mark.slow
def test_an_iwan_model():
    """Three elements of one mass that is driven, by scipy."""
    limits = {"a": 0.1, "b": 0.2, "c": 0.4}
    found = play(scene(
        "x a b c", "x_dot^2/2",
        f"{K}*x^2/2 + 2*((x - a)^2 + (x - b)^2 + (x - c)^2)",
        {q: {"relation": f"{q}_dot = 0", "limit": F} for q, F in limits.items()},
        dict.fromkeys(["x", "a", "b", "c"], 0.0), forces={"x": "1.5*sin(1.3*t)"},
        duration=15, output_step=0.01,
    ))  # fmt: skip
    x, times = springs(
        [*limits.values()], [4] * 3, lambda t: 1.5 * np.sin(1.3 * t), 15.0
    )
    close(found["x"], x, GLOBAL)
    close([e.time for e in found.result.events], times, 1e-8)
    assert len(times) > 15
    assert np.ptp(found["energy"] - found["work"]) < 1e-11


@pytest.mark.slow
def test_a_hysteresis_loop():
    """Under a forced displacement of amplitude X a cycle takes 4 F (X - F/k).

    Branches are Masing's: the branches of the first loading at twice its scale.
    """
    X = 0.8
    law = {"slider": {"relation": "s_dot = 0", "limit": FORCE}}
    found = play(scene(
        "s", "0", f"{SPRING}*({X}*sin(2*pi*t) - s)^2/2", law, {"s": 0},
        duration=4, output_step=0.005,
    ))  # fmt: skip
    x = X * np.sin(2 * np.pi * found["t"])
    s = played(x, FORCE / SPRING)
    close(found["s"], s, 1e-12)
    assert np.ptp(found["energy"] - found["work"]) < 1e-11
    cycle = (found["t"] >= 2.0) & (found["t"] <= 3.0)
    lost = FORCE * np.abs(np.diff(found["s"][cycle])).sum()
    close(lost, 4 * FORCE * (X - FORCE / SPRING), 1e-12)


def test_a_chain_of_springs_and_sliders():
    """Growing load: each slider slips at its limit, borne by the springs before it.

    k1 (x - a) = F1 + k2 a from x = F1/k1 on; the second slips at k2 a = F2.
    """
    k1, k2, F1, F2 = 4.0, 2.0, 0.5, 0.3
    found = play(scene(
        "a b", "0", f"{k1}*(t - a)^2/2 + {k2}*(a - b)^2/2",
        {"one": {"relation": "a_dot = 0", "limit": F1},
         "two": {"relation": "b_dot = 0", "limit": F2}},
        {"a": 0, "b": 0}, duration=1, output_step=0.01,
    ))  # fmt: skip
    first = F1 / k1
    second = (F1 + F2) / k1 + F2 / k2
    assert [(e.kind, e.constraint) for e in found.result.events] == [
        ("slip", "one"), ("slip", "two")
    ]  # fmt: skip
    close([e.time for e in found.result.events], [first, second], 1e-12)
    t = found["t"]
    a = np.clip((k1 * t - F1) / (k1 + k2), 0.0, None)
    a = np.where(t > second, t - (F1 + F2) / k1, a)
    close(found["a"], a, 1e-12)
    close(found["b"], np.where(t > second, a - F2 / k2, 0.0), 1e-12)


def test_sliders_one_after_the_other():
    """Of two in series the weaker slips, and both have its force."""
    found = play(scene(
        "a b", "0", f"{SPRING}*(t - a)^2/2",
        {"one": {"relation": "a_dot = b_dot", "limit": 0.5},
         "two": {"relation": "b_dot = 0", "limit": 0.3}},
        {"a": 0, "b": 0}, duration=1, output_step=0.01,
    ))  # fmt: skip
    assert [(e.kind, e.constraint) for e in found.result.events] == [("slip", "two")]
    force = np.minimum(SPRING * found["t"], 0.3)
    for name in "one", "two":
        close(-found[f"lambda_{name}"], force, 1e-12)
    close(found["b"], np.maximum(found["t"] - 0.3 / SPRING, 0.0), 1e-12)


def test_a_damper_beside_a_slider():
    """Bingham's: c s' = k (V t - s) - F from k V t = F on."""
    k, c, F, V = 4.0, 0.5, 0.5, 0.7
    found = play(scene(
        "s", "0", f"{k}*({V}*t - s)^2/2",
        {"slider": {"relation": "s_dot = 0", "limit": F}}, {"s": 0},
        forces={"s": f"-{c}*s_dot"}, duration=2, output_step=0.01,
    ))  # fmt: skip
    begun = F / (k * V)
    close(found.result.events[0].time, begun, 1e-10)
    late = np.maximum(found["t"] - begun, 0.0)
    tau = c / k
    close(found["s"], V * (late - tau * (1.0 - np.exp(-late / tau))), 1e-9)
    assert np.ptp(found["energy"] - found["work"]) < 1e-10


@pytest.mark.parametrize("drive", ["c0*(t - a_dot)", "c0*(-t - a_dot)"])
def test_sliders_that_dampers_join(drive):
    """Each slider slips when the damper before it transmits the force of its limit.

    c0 (t - a') = F0 + c1 (a' - b'), and c1 (a' - b') = F1 once b slips.
    """
    c0, c1, F0, F1 = 2.0, 0.5, 0.4, 0.3
    found = play(scene(
        "a b", "0", "0",
        {"one": {"relation": "a_dot = 0", "limit": F0},
         "two": {"relation": "b_dot = 0", "limit": F1}},
        {"a": 0, "b": 0}, parameters={"c0": c0, "c1": c1},
        forces={"a": f"{drive} + c1*(b_dot - a_dot)", "b": "c1*(a_dot - b_dot)"},
        duration=3, output_step=0.01,
    ))  # fmt: skip
    first = F0 / c0
    second = first + F1 / c1 * (c0 + c1) / c0
    sign = -1.0 if "-t" in drive else 1.0
    assert [(e.kind, e.constraint) for e in found.result.events] == [
        ("slip", "one"), ("slip", "two")
    ]  # fmt: skip
    close([e.time for e in found.result.events], [first, second], 1e-10)
    t = found["t"]
    a = np.where(t > second, t - (F0 + F1) / c0,
                 np.maximum(c0 * t - F0, 0.0) / (c0 + c1))  # fmt: skip
    close(found["a_dot"], sign * a, 1e-9)
    close(found["b_dot"], sign * np.where(t > second, a - F1 / c1, 0.0), 1e-9)
    close(found["lambda_two"], -sign * np.minimum(c1 * a, F1), 1e-9)
    assert np.ptp(found["energy"] - found["work"]) < 1e-10


@pytest.mark.slow
def test_a_slider_in_the_plane():
    """Dragged around: as fast as its spring, of length F/k, pulls along itself."""
    k, F = 4.0, 0.5
    found = play(scene(
        "u v", "0", f"{k}*((0.3*cos(t) - u)^2 + (0.3*sin(2*t) - v)^2)/2",
        {"brake": {"relation": ["u_dot = 0", "v_dot = 0"], "limit": F}},
        {"u": 0.3, "v": 0}, duration=8, output_step=0.01,
    ))  # fmt: skip
    path = lambda t: np.array([0.3 * np.cos(t), 0.3 * np.sin(2 * t)])  # noqa: E731
    speed = lambda t: np.array([-0.3 * np.sin(t), 0.6 * np.cos(2 * t)])  # noqa: E731
    (slip,) = found.result.events
    assert (slip.kind, slip.constraint) == ("slip", "brake")
    close(np.linalg.norm(path(slip.time) - path(0.0)), F / k, 1e-12)

    def rates(t, s):
        way = path(t) - s
        return (way @ speed(t)) / (way @ way) * way

    t = found["t"][found["t"] > slip.time]
    s = solve_ivp(
        rates, (slip.time, t[-1]), path(0.0), "DOP853", t, rtol=1e-13, atol=1e-14
    ).y  # fmt: skip
    late = found["t"] > slip.time
    close(found["u"][late], s[0], 1e-10)
    close(found["v"][late], s[1], 1e-10)
    size = np.hypot(found["lambda_brake.1"], found["lambda_brake.2"])
    assert np.abs(size[late] - F).max() < 1e-14
    assert np.ptp(found["energy"] - found["work"]) < 1e-11


@pytest.mark.slow
def test_starts():
    """At or below the limit a start is admissible; a guess is solved for the limit."""
    assert (
        lagsim.check(lagsim.load(jenkins())).record["constraints"][0]["mode"]
        == "sticks"
    )
    for v, mode, freedom in ((1.0, "slides", 2), (-1.0, "sticks", 1)):
        text = jenkins(start={"x": FORCE / SPRING, "x_dot": v})
        found = lagsim.check(lagsim.load(text)).record
        assert found["constraints"][0]["mode"] == mode
        assert found["degrees_of_freedom"] == freedom
    text = jenkins(start={"x": 0.4})
    found = lagsim.check(lagsim.load(text))
    assert not found.admissible
    repaired = found.record["repair"]
    assert SPRING * (repaired["x"] - repaired["s"]) == pytest.approx(FORCE, rel=1e-12)
    with refused("inadmissible", "slider", kind=lagsim.InadmissibleError):
        lagsim.simulate(lagsim.load(text))
    free = play(jenkins(start={"x": 0.4, "s": {"guess": 0.0}}))
    assert free["s"][0] == pytest.approx(0.4 - FORCE / SPRING, rel=1e-12)
    assert free["s_dot"][0] == free["x_dot"][0] == 1.0


@pytest.mark.slow
def test_a_start_at_rest():
    """The mass rests where its spring balances the other, which has at most the limit.

    One whose guess would pull with more is at its limit.
    """
    guesses = {"x": {"guess": 0.1}, "x_dot": 0.0}
    for s, x in ((0.2, SPRING * 0.2 / (K + SPRING)), ({"guess": 0.9}, FORCE / K)):
        found = play(jenkins(start={**guesses, "s": s}, begin="rest"))
        close(found["x"], np.full(len(found.t), x), 1e-12)
        close(SPRING * (found["s"] - found["x"])[0], K * x, 1e-12)


def test_a_limit_that_follows_the_time():
    found = play(
        jenkins(start={"x_dot": 0.5}).replace("limit: 0.5", "limit: 0.5*exp(-t)")
    )
    slides = found["residual_slider"] != 0.0
    bound = 0.5 * np.exp(-found["t"])
    force = SPRING * np.abs(found["x"] - found["s"])
    assert slides.any()
    assert np.abs(force - bound)[slides].max() < 1e-14
    assert (force <= bound + 1e-10).all()


@pytest.mark.parametrize("method", ["dop853", "rk4"])
@pytest.mark.parametrize("start", [0.0, 1000.0])
def test_a_slider_jumps_where_its_limit_falls_at_once(method, start):
    """To s = x - F/k; the mass goes on, and the spring has lost (f^2 - F^2)/(2 k)."""
    v, F, begun = 0.5, 0.1, 0.7
    options = {} if method == "dop853" else {"step": 0.005}
    text = jenkins(start={"x_dot": v}, method=method, duration=1, **options)
    text = text.replace("duration:", f"start: {start}\n  duration:")
    found = play(
        text.replace("limit: 0.5", f"limit: if(t > {start + begun}, {F}, 0.5)")
    )
    k = int(np.flatnonzero(np.diff(found.t) == 0.0)[0])
    w = np.sqrt(K + SPRING)
    x, speed = v / w * np.sin(w * begun), v * np.cos(w * begun)
    within = 1e-10 if method == "dop853" else 1e-8
    rows = [[found[c][i] for c in ("x", "s", "x_dot", "s_dot")] for i in (k, k + 1)]
    close(rows, [[x, 0, speed, 0], [x, x - F / SPRING, speed, speed]], within)
    lost = found["work"][k + 1] - found["work"][k]
    close(lost, -((SPRING * x) ** 2 - F**2) / (2 * SPRING), within)
    assert [e.kind for e in found.result.events][:2] == ["switch", "slip"]
    assert np.ptp(found["energy"] - found["work"]) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_network_jumps_to_where_each_has_slipped_against_its_force(seed):
    """Moreau's catching-up step, which is unique: |f| <= F, and less only at rest.

    Springs, some nonlinear, between sliders that are dragged until their limits fall to
    a part of their first values.
    """
    given = np.random.default_rng(seed)
    n, drive = 4, "sin(3*t)"
    names = [f"s{i}" for i in range(n)]
    ends = [(drive, names[0]), (drive, names[1])]
    ends += [(names[given.integers(i)], names[i]) for i in range(1, n)]
    k, stiffer = given.uniform(1, 4, len(ends)), given.uniform(0, 3, len(ends))
    potential = " + ".join(
        f"{c!r}*({a} - {b})^2/2 + {d!r}*({a} - {b})^4/4"
        for (a, b), c, d in zip(ends, k.tolist(), stiffer.tolist(), strict=True)
    )
    limits, begun = given.uniform(0.5, 3.0, n), 0.4
    parts = given.choice([0.0, 0.2, 0.9], n)
    laws = {
        q: {"relation": f"{q}_dot = 0", "limit": f"if(t > {begun}, {part * F}, {F})"}
        for q, part, F in zip(names, parts, limits, strict=True)
    }
    found = play(scene(
        " ".join(names), "0", potential, laws, dict.fromkeys(names, 0.0),
        duration=0.8, output_step=0.01,
    ))  # fmt: skip
    row = int(np.flatnonzero(np.diff(found.t) == 0.0)[0])
    place = {q: [found[q][row], found[q][row + 1]] for q in names}
    place[drive] = [np.sin(3 * begun)] * 2
    forces = dict.fromkeys(names, 0.0)
    for (a, b), c, d in zip(ends, k, stiffer, strict=True):
        long = place[a][1] - place[b][1]
        for end, sign in ((a, -1.0), (b, 1.0)):
            if end in forces:
                forces[end] += sign * (c * long + d * long**3)
    jumped = 0
    for q, part, F in zip(names, parts, limits, strict=True):
        force, slip = forces[q], place[q][1] - place[q][0]
        assert abs(force) <= part * F + 1e-10
        if abs(slip) > 1e-10:
            jumped += 1
            close(force * np.sign(slip), part * F, 1e-10)
    assert jumped
    assert np.ptp(found["energy"] - found["work"]) < 1e-9


def test_a_slider_in_the_plane_jumps_along_the_force_that_it_has_then():
    k, h, F, begun = 4.0, 9.0, 0.1, 0.4
    found = play(scene(
        "u v", "0", f"({k}*(0.1*t + 0.05 - u)^2 + {h}*(0.03 - v)^2)/2",
        {"brake": {"relation": ["u_dot = 0", "v_dot = 0"],
                   "limit": f"if(t > {begun}, {F}, 0.5)"}},
        {"u": 0, "v": 0}, duration=1, output_step=0.01,
    ))  # fmt: skip
    after = np.arange(len(found.t)) > np.flatnonzero(np.diff(found.t) == 0.0)[0]
    force = np.array([k * (0.1 * found.t + 0.05 - found["u"]), h * (0.03 - found["v"])])
    size = np.hypot(*force)
    close(size[after], np.full(after.sum(), F), 1e-12)
    first = int(np.flatnonzero(after)[0])
    slip = np.array([found["u"][first], found["v"][first]])
    close(slip / np.hypot(*slip), force[:, first] / F, 1e-10)
    assert np.ptp(found["energy"] - found["work"]) < 1e-10


def test_a_slider_that_is_in_force_at_times():
    """While it is not it goes along, and the mass swings on the other spring alone."""
    v, off, on = 0.5, 0.3, 0.9
    text = jenkins(start={"x_dot": v}, duration=1.5, output_step=0.001)
    found = play(
        text.replace("limit: 0.5", f"limit: 0.5\n    when: t < {off} or t > {on}")
    )
    w, W, t = np.sqrt(K + SPRING), np.sqrt(K), found["t"]
    x, speed = v / w * np.sin(w * off), v * np.cos(w * off)
    free = (t > off) & (t < on)
    swing = x * np.cos(W * (t - off)) + speed / W * np.sin(W * (t - off))
    close(found["x"][free], swing[free], 1e-10)
    close(found["s"][free], swing[free], 1e-10)
    assert np.abs(found["lambda_slider"][free]).max() < 1e-14
    assert np.ptp(found["s"][t > on + 1e-9]) == 0.0
    lost = SPRING * x**2 / 2
    close(found["work"][-1], -lost, 1e-10)
    assert np.ptp(found["energy"] - found["work"]) < 1e-10


def test_a_slider_of_two_relations_has_no_when():
    text = scene(
        "u v", "0", "(t - u)^2 + v^2",
        {"brake": {"relation": ["u_dot = 0", "v_dot = 0"], "limit": 1,
                   "when": "t > 1"}},
        {"u": 0, "v": 0}, duration=2, output_step=0.01,
    )  # fmt: skip
    with refused("no-inertia", "coordinate u ", "`when`"):
        play(text)


def test_a_slider_and_a_stop():
    """Where the mass rebounds from a stop, its slider sticks."""
    law = JENKINS | {"stop": {"relation": "x <= 0.4", "restitution": 0.5}}
    found = play(scene(
        "x s", "x_dot^2/2", f"{SPRING}*(x - s)^2/2", law,
        {"x": 0.0, "s": 0.0, "x_dot": 1.5}, duration=0.5, output_step=0.001,
    ))  # fmt: skip
    struck = found.times("impact")[0]
    assert found.times("stick")[0] == struck
    k = np.flatnonzero(np.diff(found["t"]) == 0.0)[0]
    before, after = ({q: found[q][k + i] for q in ("x_dot", "s_dot")} for i in (0, 1))
    # m v^2/2 less the work of the spring, then of the slider.
    v = np.sqrt(1.5**2 - FORCE**2 / SPRING - 2 * FORCE * (0.4 - FORCE / SPRING))
    close([before["x_dot"], before["s_dot"]], [v, v], GLOBAL)
    close([after["x_dot"], after["s_dot"]], [-v / 2, 0.0], GLOBAL)


@pytest.mark.slow
def test_sections_events_and_other_times():
    """`until` and `result.at` use positions of a slider; a late start changes none."""
    found = play(jenkins(until="s >= 0.1"))
    assert found.result.outcome == "until"
    close(found["x"][-1], 0.1 + FORCE / SPRING, 1e-10)
    plain = play(jenkins())
    late = play(jenkins().replace("duration:", "start: 1000\n  duration:"))
    times = [0.1234, 0.5678]
    at = plain.result.at(times)
    close(at["lambda_slider"], -SPRING * (at["x"] - at["s"]), 1e-14)
    close(late["x"], plain["x"], GLOBAL)


def test_what_impulses_cannot_move():
    with refused("method-refused", "`moreau`", "`slider`"):
        play(jenkins(method="moreau", step=0.01))
