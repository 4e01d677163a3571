"""Friction and restitution that follow the motion: closed forms, and scipy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import lagsim
from lagsim.errors import InputError
from tests.scenes.contact.motions import GLOBAL, G, close, contact, play, scene, tried
from tests.support import refused

PLANE = "(x_dot^2 + y_dot^2)/2"


def plane(potential="g*y", *, law, duration=2, start=None, **more):
    """A block of 1 kg in the plane, over a floor with a law."""
    given = {"x": 0.0, "y": 0.0} | (start or {})
    return scene(
        "x y", PLANE, potential, {"floor": law}, given, duration=duration,
        output_step=0.05, **more,
    )  # fmt: skip


def rough(friction, slip="x_dot", restitution=0, **more):
    return contact("y >= 0", restitution, friction=friction, slip=slip, **more)


# --- friction -------------------------------------------------------------------------


def slips(count, falls):
    """When a block on a belt at 0.3 m/s begins to slip, and sticks: by scipy."""
    stretched, x, t, found = G * 0.6 / 40, 0.0, 0.0, []

    def sticks(_, y):
        return y[1] - 0.3

    sticks.terminal, sticks.direction = True, 1.0
    for _ in range(count):
        t += (stretched - x) / 0.3
        found.append(("slip", t))
        part = solve_ivp(
            lambda _, y: [y[1], -40 * y[0] + G * falls(0.3 - y[1])], (0, 9),
            [stretched, 0.3], "DOP853", rtol=1e-13, atol=1e-15, events=sticks,
        )  # fmt: skip
        k = [float(x) for x in part.t_events[0]].index(max(part.t_events[0]))
        t, x = t + part.t_events[0][k], part.y_events[0][k][0]
        found.append(("stick", t))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("friction", "falls"),
    [
        (
            "0.25 + 0.35*exp(-slip_speed/0.2)",
            lambda v: 0.25 + 0.35 * np.exp(-v / 0.2),
        ),
        ({"static": 0.6, "dynamic": "0.3 - 0.2*slip_speed"}, lambda v: 0.3 - 0.2 * v),
        (
            {"static": 0.6, "dynamic": "if(slip_speed > 0.2, 0.3, 0.4)"},
            lambda v: np.where(v > 0.2, 0.3, 0.4),
        ),
    ],
)
def test_a_block_on_a_belt_sticks_and_slips(friction, falls):
    """`stick` and `slip` in turn; the third friction falls at a speed (scipy: 1e-7)."""
    law = rough(friction, "x_dot - 0.3")
    text = plane("20*x^2 + g*y", law=law, duration=6, start={"x_dot": 0.3})
    found = play(text)
    events = [(e.kind, e.time) for e in found.result.events if e.kind != "switch"]
    expected = slips(4, falls)
    assert [kind for kind, _ in events[:8]] == [kind for kind, _ in expected]
    within = 1e-6 if "if(" in str(friction) else GLOBAL
    close([t for _, t in events[:8]], [t for _, t in expected], within)
    balance = found["energy"] - found["work"]
    assert np.ptp(balance) < GLOBAL * np.ptp(found["work"])


def test_a_floor_that_grows_rougher():
    """mu = 0.1 + 0.2 x: a half of an oscillation about -0.5 with w^2 = 0.2 g."""
    found = play(plane(law=rough("0.1 + 0.2*x"), start={"x_dot": 2.0}))
    w = np.sqrt(0.2 * G)
    stop = (np.pi / 2 - np.arctan(0.5 * w / 2.0)) / w
    assert found.times("stick") == pytest.approx([stop], abs=GLOBAL)
    t = np.minimum(found.t, stop)
    close(found["x"], 2.0 / w * np.sin(w * t) - 0.5 * (1 - np.cos(w * t)))


@pytest.mark.parametrize("method", ["rk4", "taylor", "radau", "moreau"])
def test_other_methods_follow_or_say_why_not(method):
    text = plane(law=rough("0.2 + 0.1*slip_speed"), start={"x_dot": 2.0})
    if method in ("taylor", "radau"):
        with refused("method-refused", f"`{method}`"):
            play(text, method=method)
        return
    found = play(text, method=method, step=1e-3)
    stop = np.log(1 + 2.0 * 0.1 / 0.2) / (0.1 * G)
    t = np.minimum(found.t, stop)
    v = np.where(found.t < stop, 4.0 * np.exp(-0.1 * G * t) - 2.0, 0.0)
    close(found["x_dot"], v, 1e-2 if method == "moreau" else GLOBAL)


def test_a_disc_slides_by_its_speed():
    """mu = 0.02 v in every direction: velocities fall as exp(-0.02 g t)."""
    text = scene(
        "x y z", "(x_dot^2 + y_dot^2 + z_dot^2)/2", "g*z",
        {"floor": contact("z >= 0", 0, friction="0.02*slip_speed + 0*x",
                          slip=["x_dot", "y_dot"])},
        {"x": 0, "y": 0, "z": 0, "x_dot": 3, "y_dot": 4}, duration=2, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    fall = np.exp(-0.02 * G * found.t)
    close([found["x_dot"], found["y_dot"]], [3 * fall, 4 * fall])


def test_a_friction_that_becomes_negative_ends_the_run():
    """mu = 0.3 - x: z = x - 0.3 obeys z'' = g z, and is 0 at tanh(w t) = 0.15 w."""
    found = tried(plane(law=rough("0.3 - x"), start={"x_dot": 2.0}))
    w = np.sqrt(G)
    assert found.result.outcome == "failed"
    assert found.t[-1] == pytest.approx(np.arctanh(0.15 * w) / w, abs=GLOBAL)
    assert "`floor`" in found.result.reason


@pytest.mark.parametrize("duration", [2, 0.8])
def test_a_limit_that_becomes_negative_ends_the_run(duration):
    """As does one at a row's time; at the start it is a fault of the file."""
    limit = {"brake": {"relation": "x_dot = 0", "limit": "0.5 - t"}}
    given = {"x": 0.0, "x_dot": 3.0}
    text = scene("x", "x_dot^2/2", "0", limit, given, duration=duration)
    found = tried(text)
    assert found.result.outcome == "failed"
    assert found.t[-1] == pytest.approx(0.5, abs=GLOBAL)
    assert "`brake`" in found.result.reason
    late = text.replace("duration", "start: 0.75\n  duration")
    with refused("out-of-range", "`brake`", "-0.25"):
        lagsim.check(lagsim.load(late))
    with refused("out-of-range", "`floor`", "-0.2"):
        lagsim.check(lagsim.load(plane(law=rough("x - 0.2"))))
    lagsim.check(lagsim.load(plane(law=rough("x - 0.2"), start={"y": 1.0})))


# --- restitution ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("e", "worth"),
    [
        ("0.9 - 0.1*approach_speed", lambda v, _: 0.9 - 0.1 * v),
        ("0.8*exp(-t)", lambda _, t: 0.8 * np.exp(-t)),
        ("if(x > 1, 0.3, 0.7)", lambda _, t: np.where(t > 1, 0.3, 0.7)),
        ("0.6 - 0*approach_speed + 0*x", lambda *_: 0.6),
    ],
)
@pytest.mark.parametrize("law", ["newton", "poisson"])
def test_worn_stops(e, worth, law):
    """A ball flies from bounce to bounce: each has the loss of its law."""
    stop = contact("y >= 0", e, restitution_law=law)
    found = play(plane(law=stop, start={"y": 1.0, "x_dot": 1.0}))
    t, v = np.sqrt(2 / G), np.sqrt(2 * G)
    for event in [e for e in found.result.events if e.kind == "impact"][:6]:
        assert event.time == pytest.approx(t, abs=GLOBAL)
        assert event.rate_before == pytest.approx(-v, abs=GLOBAL)
        v *= worth(v, t)
        assert event.rate_after == pytest.approx(v, abs=GLOBAL)
        t += 2 * v / G


def test_a_restitution_that_varies_beside_a_constant_one():
    """Two balls fall from 5 and 20 onto floors; the second rebounds by 0.4 x at x = t.

    The first one strikes with 10 m/s, the second one at t = 2 with 20 m/s.
    """
    found = lagsim.simulate("""
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 10*(y + z)}
constraints:
  first: {relation: y >= 0, restitution: 0.3}
  second: {relation: z >= 0, restitution: 0.4*x}
initial: {x: 0, x_dot: 1, y: 5, z: 20}
simulation: {duration: 2, output_step: 0.5}
""", error_bar="never")  # fmt: skip
    after = dict.fromkeys(("first", "second"))
    for event in found.events:
        if event.kind == "impact" and after[event.constraint] is None:
            after[event.constraint] = event.rate_before, event.rate_after
    assert after["first"] == pytest.approx((-10.0, 3.0), rel=1e-12)
    assert after["second"] == pytest.approx((-20.0, 16.0), rel=1e-12)


def test_a_restitution_beyond_one_ends_the_run():
    stop = contact("y >= 0", "0.5 + 0.2*approach_speed")
    found = tried(plane(law=stop, start={"y": 1.0}))
    assert found.result.outcome == "failed"
    assert found.t[-1] == pytest.approx(np.sqrt(2 / G), abs=GLOBAL)
    assert all(x in found.result.reason for x in ("`floor`", "1.38"))


# --- Poisson's law --------------------------------------------------------------------


def tip(friction, e, law, speed):
    """A rod of mass 1 and half-length 1 that strikes with its tip at q = 0.7."""
    stop = contact(
        "y >= cos(q)", e, friction=friction, slip="x_dot - cos(q)*q_dot",
        restitution_law=law,
    )  # fmt: skip
    return scene(
        "x y q", "(x_dot^2 + y_dot^2 + q_dot^2/3)/2", "0", {"tip": stop},
        {"q": 0.7, "x": 0, "y": "cos(q)", "x_dot": speed, "y_dot": -1},
        duration=0.01, output_step=0.01,
    )  # fmt: skip


@pytest.mark.parametrize("speed", [0.1, -0.3, 3.0])
def test_poisson_with_friction(speed):
    """A contact that sticks in compression: the impulse that ends both speeds.

    Then e times its normal part again, with the slip held. A contact that slides all
    the time has Newton's impact.
    """
    e, mu, s, c = 0.5, 2.0, np.sin(0.7), np.cos(0.7)
    rows = np.array([[0, 1, s], [1, 0, -c]])
    D = rows @ np.diag([1, 1, 3.0]) @ rows.T
    before = rows @ [speed, -1.0, 0.0]
    p = np.linalg.solve(D, -before)
    if abs(p[1]) <= mu * p[0]:
        more = e * p[0] * np.array([1.0, -D[1, 0] / D[1, 1]])
        after = D @ more
    else:
        p = -before[0] / (D[0] @ [1.0, -mu]) * np.array([1.0, -mu])
        after = before + (1 + e) * D @ p
        assert after[1] > 0.0
    found = play(tip(mu, e, "poisson", speed))
    impact = next(x for x in found.result.events if x.kind == "impact")
    assert impact.rate_after == pytest.approx(after[0], abs=GLOBAL)
    last = [float(found[f"{q}_dot"][found.t == 0.0][-1]) for q in "xyq"]
    close(rows @ last, after)
    newton = next(x for x in play(tip(mu, e, "newton", speed)).result.events)
    assert newton.rate_after == pytest.approx(e, abs=GLOBAL)


def test_poisson_of_two_stops():
    """A rod that falls on two stops of other restitutions: D diag(e) D^-1 speeds."""
    stops = {
        name: contact(f"y {sign} q >= 0", e, restitution_law="poisson")
        for name, sign, e in (("left", "-", 0.5), ("right", "+", 0.8))
    }
    text = scene(
        "y q", "(y_dot^2 + 0.5*q_dot^2)/2", "0", stops,
        {"y": 0, "q": 0, "y_dot": -1, "q_dot": 0.1}, duration=0.01, output_step=0.01,
    )  # fmt: skip
    rows = np.array([[1.0, -1.0], [1.0, 1.0]])
    D = rows @ np.diag([1.0, 2.0]) @ rows.T
    after = D @ np.diag([0.5, 0.8]) @ np.linalg.solve(D, -rows @ [-1.0, 0.1])
    found = play(text)
    speeds = {e.constraint: e.rate_after for e in found.result.events}
    # What would close again is pushed more: here neither.
    assert (after > 0.0).all()
    close([speeds["left"], speeds["right"]], after)


# --- beside others, and faults --------------------------------------------------------


@pytest.mark.slow
def test_other_values_of_parameters_and_a_shifted_start():
    law = contact(
        "y >= 0", "e*exp(-approach_speed)", friction="mu*(1 + x)", slip="x_dot"
    )
    text = plane(
        law=law, start={"y": 1.0, "x_dot": 1.0}, parameters={"e": 0.5, "mu": 0.1}
    )
    other = text.replace("e: 0.5", "e: 0.8").replace("mu: 0.1", "mu: 0.2")
    model = lagsim.load(text)
    bound = lagsim.simulate(model.bind({"e": 0.8, "mu": 0.2}), error_bar="never")
    for name in ("x", "y", "work"):
        assert (bound[name] == play(other)[name]).all()
    late = play(text.replace("duration: 2", "duration: 2\n  start: 5"))
    close(late["x"], play(text)["x"])


@pytest.mark.parametrize(
    ("law", "code", "at"),
    [
        ("{restitution: x_dot}", "velocity-not-allowed", "x_dot"),
        ("{restitution: slip_speed}", "unknown-name", "slip_speed"),
        ("{restitution: 0, friction: approach_speed, slip: x_dot}", "unknown-name",
         "approach_speed"),
        ("{restitution: 0, friction: {static: slip_speed, dynamic: 1}, slip: x_dot}",
         "unknown-name", "slip_speed"),
        ("{restitution: 1.5 + 0*1}", "out-of-range", "1.5"),
        ("{restitution: 0, restitution_law: possion}", "unknown-restitution-law",
         "possion"),
        ("{restitution: lambda_floor}", "output-only", "lambda_floor"),
        # A limit of two relations.
        ("{relation: [x_dot = 0, y_dot = 0]}", "missing-key", "["),
        ("{relation: [x_dot = 0], limit: 1}", "wrong-count", "["),
        ("{relation: [x_dot = 0, y = 0], limit: 1}", "not-a-velocity", "limit"),
        ("{relation: [x_dot = 0, y_dot >= 0], limit: 1}", "not-an-equality", "y_dot"),
        ("{relation: [x_dot = 0, y_dot +], limit: 1}", "expression-syntax", "]"),
        ("{relation: [x_dot = 0, y_dot = 0], limit: -1}", "out-of-range", "-1"),
        ("{relation: [x_dot = 0, y_dot = 0], limit: v}", "unknown-name", "v"),
    ],
)  # fmt: skip
def test_faults(law, code, at):
    law = law.replace("{rest", "{relation: y >= 0, rest", 1)
    text = plane(law="LAW").replace("LAW", law)
    with pytest.raises(InputError) as fault:
        lagsim.load(text)
    (found,) = fault.value.problems
    assert found.code == code
    line = text.splitlines()[found.place.line - 1]
    assert line[found.place.column - 1 :].startswith(at)


# --- a limit of two relations ---------------------------------------------------------

BRAKE = {"relation": ["x_dot = 0", "y_dot = 0"], "limit": "F"}


def braked(potential="0", *, forces=None, **start):
    """A body of 2 kg that a brake of 3 N holds in the plane."""
    return scene(
        "x y", "x_dot^2 + y_dot^2", potential, {"brake": BRAKE},
        {"x": 0.0, "y": 0.0} | start, forces=forces, parameters={"F": 3.0},
        duration=4, output_step=0.05,
    )  # fmt: skip


@pytest.mark.parametrize("method", ["auto", "moreau"])
def test_a_planar_brake_stops_a_body_on_a_straight_line(method):
    step = {} if method == "auto" else {"step": 1e-3}
    found = play(braked(x_dot=1.5, y_dot=2.0), method=method, **step)
    stop, v = 2.0 * 2.5 / 3.0, np.maximum(2.5 - 1.5 * found.t, 0.0)
    within = GLOBAL if method == "auto" else 1e-3
    close([found["x_dot"], found["y_dot"]], [0.6 * v, 0.8 * v], within)
    if method == "auto":
        assert found.times("stick", "brake") == pytest.approx([stop], abs=GLOBAL)
        slides = found.t < stop
        force = [found[f"lambda_brake.{k}"][slides] for k in (1, 2)]
        close(force, [np.full(slides.sum(), -1.8), np.full(slides.sum(), -2.4)])
        assert (found["residual_brake.1"] == found["x_dot"]).all()
        close(found["energy"] - found["work"], np.full(len(v), 6.25))


def test_a_central_force_and_a_planar_brake():
    """On a ray, r'' = -4 r - 1.5 from 0 at 2.5: r = A sin(2 t + b) - 0.375."""
    found = play(braked("4*(x^2 + y^2)", x_dot=1.5, y_dot=2.0))
    size, phase = np.hypot(1.25, 0.375), np.arctan2(0.375, 1.25)
    turns = (np.pi / 2 - phase) / 2
    t = found.t[found.t < turns]
    r = size * np.sin(2 * t + phase) - 0.375
    close(found["x"][: len(t)], 0.6 * r)
    close(found["y"][: len(t)], 0.8 * r)


@pytest.mark.slow
@pytest.mark.parametrize("start", [0, 100, 1e5])
def test_a_slip_whose_way_turns_stops_once(start):
    """The slip turns ever faster as it ends, in times below the clock's resolution."""

    def rates(_, y):
        return [*y[2:], *(-20 * y[:2] - 8 * y[2:] / np.hypot(*y[2:]))]

    def slow(_, y):
        return np.hypot(*y[2:]) - 1e-7

    slow.terminal = True
    y = solve_ivp(
        rates, (0, 9), [1, 0, 0, 2], "DOP853", events=slow, rtol=1e-12, atol=1e-13
    )
    lost = np.linalg.norm(rates(0, y.y[:, -1])[2:])  # to 1e-7: it stops within 1e-7 s
    text = scene(
        "x y", "x_dot^2/2 + y_dot^2/2", "10*(x^2 + y^2)", {"brake": BRAKE},
        {"x": 1, "y": 0, "x_dot": 0, "y_dot": 2}, parameters={"F": 8},
        start=start, duration=4, output_step=0.05,
    )  # fmt: skip
    found = play(text)
    assert lost > 1
    resolved = 1e-7 + 8 * np.spacing(start)
    stops = [start + y.t[-1]]
    assert found.times("stick", "brake") == pytest.approx(stops, rel=0, abs=resolved)
    assert not found.times("slip", "brake")
    close([found["x"][-1], found["y"][-1]], y.y[:2, -1:].ravel(), 1e-9)


def test_a_planar_brake_holds_what_is_within_its_circle():
    """Pulled by (1.2, 1.6) t it slips at 2 t = 3, the way that it is pulled."""
    found = play(braked(forces={"x": "1.2*t", "y": "1.6*t"}))
    assert found.times("slip", "brake") == pytest.approx([1.5], abs=GLOBAL)
    v = np.where(found.t > 1.5, (found.t - 1.5) ** 2 / 2, 0.0)
    close([found["x_dot"], found["y_dot"]], [0.6 * v, 0.8 * v])


@pytest.mark.slow
def test_a_planar_brake_lets_go_where_its_limit_is_0():
    """Pulled by 1 N at (0.6, 0.8): free, held from 1.5 on, and free again from 2 on."""
    tables = "tables: {F: {points: [[0, 0], [1, 0], [1.5, 6], [2, 0], [3, 0]]}}\n"
    for limit in "if(t < 1, 0, if(t < 2, 3, 0))", "F(t)":
        text = scene(
            "x y", PLANE, "-0.6*x - 0.8*y", {"brake": BRAKE | {"limit": limit}},
            {"x": 0, "y": 0}, duration=3, output_step=0.05,
        )  # fmt: skip
        found = play((tables if "F(" in limit else "") + text)
        close(found.times("stick", "brake"), [1.5])  # 1 + s - 6 s^2 = 0 of the table
        if "if" in limit:
            close(found.times("slip", "brake"), [2.0])
            t = found.t
            v = np.where(t < 1, t, np.where(t < 2, np.maximum(3 - 2 * t, 0.0), t - 2))
            close([found["x_dot"], found["y_dot"]], [0.6 * v, 0.8 * v])


@pytest.mark.parametrize("relation", ["x_dot = 0", ["x_dot = 0", "y_dot = 0"]])
def test_a_limit_that_is_0_within_rounding_is_not_negative(relation):
    """max(0, sin(4 t)) is sin(4 pi/4), below 0 by rounding, as its branch ends."""
    law = {"relation": relation, "limit": "max(0, sin(4*t))"}
    text = scene(
        "x y", PLANE, "-x", {"brake": law},
        {"x": 0, "y": 0, "x_dot": 2}, duration=3, output_step=0.05,
    )  # fmt: skip
    found = play(text)
    turn, half = 4 * found.t, np.pi
    braked = (1 - np.cos(np.minimum(turn, half))) / 4
    braked += (1 - np.cos(np.clip(turn, 2 * half, 3 * half))) / 4
    close(found["x_dot"], 2 + found.t - braked)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "order", "least"), [("rk4", 3.8, 1e-10), ("rattle", 0.95, 4e-4)]
)
def test_a_planar_brake_that_yields_to_a_force_that_turns(method, order, least):
    """By a fixed step too, in the order that the method has for friction that turns."""
    force = lambda t: np.array([0.6 * t, 0.8 + 0.3 * np.sin(2 * t)])  # noqa: E731
    begun = brentq(lambda t: np.hypot(*force(t)) - 1, 0.2, 0.5, xtol=1e-15)
    # It begins along the force that there is, |f| - 1 = a s, and v = a s^2/2.
    a = force(begun) @ [0.6, 0.6 * np.cos(2 * begun)]
    s = 1e-5
    start = np.outer([a * s**3 / 6, a * s**2 / 2], force(begun + s)).ravel()
    exact = solve_ivp(
        lambda t, y: [*y[2:], *(force(t) - y[2:] / np.hypot(*y[2:]))],
        (begun + s, 3), start, "Radau", rtol=1e-10, atol=1e-14,
    ).y[:, -1]  # fmt: skip
    text = scene(
        "x y", PLANE, "0", {"brake": BRAKE | {"limit": 1}}, {"x": 0, "y": 0},
        forces={"x": "0.6*t", "y": "0.8 + 0.3*sin(2*t)"}, duration=3, output_step=0.1,
    )  # fmt: skip
    off = []
    for step in 0.02, 0.005:
        found = play(text, method=method, step=step)
        assert found.times("slip", "brake") == pytest.approx([begun], abs=1e-3)
        off.append(np.hypot(found["x"][-1] - exact[0], found["y"][-1] - exact[1]))
    assert off[1] < min(least, off[0] / 4**order)


def test_two_limits_are_no_planar_brake_and_other_values_are():
    """Each for itself takes 3 N along its axis; 6 N stop in half the time."""
    text = braked(x_dot=1.5, y_dot=2.0)
    model = lagsim.load(text).bind({"F": 6.0})
    found = lagsim.simulate(model, error_bar="never")
    stops = [e.time for e in found.events if e.kind == "stick"]
    assert stops == pytest.approx([2.0 * 2.5 / 6.0], abs=GLOBAL)
    apart = {k: {"relation": f"{k}_dot = 0", "limit": 3} for k in "xy"}
    other = scene(
        "x y", "x_dot^2 + y_dot^2", "0", apart,
        {"x": 0, "y": 0, "x_dot": 1.5, "y_dot": 2.0}, duration=4, output_step=0.05,
    )  # fmt: skip
    assert play(other).instants("stick") == pytest.approx([1.0, 4 / 3], abs=GLOBAL)


def test_a_brake_holds_what_rounding_alone_moves():
    # u_dot + w_dot is 6e-17 at the start, and z_dot is 0 exactly.
    text = """
coordinates: {u: {}, w: {}, z: {}}
energy: {kinetic: (u_dot^2 + w_dot^2 + z_dot^2)/2, potential: 0}
forces: {u: t, w: t, z: t}
constraints: {pad: {relation: [u_dot + w_dot = 0, z_dot = 0], limit: 1.5}}
initial: {u: 0, u_dot: 3*0.1, w: 0, w_dot: -0.3, z: 0}
simulation: {duration: 1, output_step: 0.1}
"""
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert result["lambda_pad.1"] == pytest.approx(-result.t)
    assert result["z"] == pytest.approx(0.0, abs=1e-15)
    assert result.record["steps"] < 100


def test_a_disc_that_stops_beside_a_table_stops_once():
    # The springs push by less than the brake holds: what has come to rest stays there.
    found = play("""
coordinates: {x: {}, y: {}}
energy:
  kinetic: (x_dot^2 + 1.3*y_dot^2 + 0.4*x_dot*y_dot)/2
  potential: 10*x^2 + 5*(x - y)^2
tables: {force: {points: [[-1, 1], [0, 0], [1, -1.2]], interpolation: monotone}}
forces: {x: force(x)}
constraints: {brake: {relation: [x_dot = 0, y_dot = 0], limit: 8}}
initial: {x: 0.1, x_dot: 0.4, y: 0.05, y_dot: 0.3}
simulation: {duration: 1, output_step: 0.1}
""")
    assert [event.kind for event in found.result.events] == ["stick"]


@pytest.mark.slow
def test_a_disc_stops_whenever_its_clock_began():
    # At t = 1e6 a rounding of the time changes its speed by 4e-9, late in its turn.
    text = """
coordinates: {{x: {{}}, y: {{}}}}
energy:
  kinetic: (x_dot^2 + 1.49*y_dot^2 - 0.49*x_dot*y_dot)/2
  potential: 60*x^2 + 30*(x - y)^2
constraints: {{brake: {{relation: [x_dot = 0, y_dot = 0], limit: 8.5}}}}
initial: {{x: 0.05, x_dot: -0.29, y: 0.05, y_dot: 0.32}}
simulation: {{start: {start}, duration: 1, output_step: 0.1}}
"""
    first, *later = (play(text.format(start=start)) for start in (0, 1e4, 1e6))
    for found in later:
        assert [e.kind for e in found.result.events] == [
            e.kind for e in first.result.events
        ]
        assert found["x"][-1] == pytest.approx(first["x"][-1], abs=1e-10)
        assert found["y"][-1] == pytest.approx(first["y"][-1], abs=1e-10)
