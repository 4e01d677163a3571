"""The referee against closed forms: who judges must be judged first."""

import math

import numpy as np
import pytest
import yaml

from tests.hunt.contacts import ContactScene
from tests.hunt.fixed_steps import Runs
from tests.hunt.grammar import scene as scene_of
from tests.hunt.hybrid import Equations, Hybrid, Plain
from tests.hunt.hybrid_verdict import truth as hybrid_truth
from tests.hunt.integrator import Extrapolation, NoTruthError
from tests.hunt.lagsim_runs import Answer
from tests.hunt.scene import Item, Law, Scene
from tests.hunt.verdict import Verdict, judge, truth

Long = np.longdouble
# What two ways of computing in long double may differ by after a few thousand steps.
CLOSE = 1e-14


# Tests of a tool of the nightly hunts: quick tests need it only in a few cases.
pytestmark = pytest.mark.slow


def a_scene(*items, duration=10.0, step=0.5, **more):
    return Scene("test", items, more.pop("start", 0.0), duration, step, **more)


def slider(x=1.0, v=0.0, *, potential="0", force=None, **more):
    """Return a unit mass on a line."""
    return Item(
        "slider", coordinates={"x": (x, v)}, kinetic=("x_dot^2/2",),
        potential=(potential,), forces=(("x", force),) if force else (), **more,
    )  # fmt: skip


def motion(item, **more):
    return truth(a_scene(item, **more)).motion


def path(scene):
    """Return the hybrid referee's motion of a scene, and its error."""
    return hybrid_truth(ContactScene(scene).told())[:2]


def test_an_oscillator_follows_the_cosine():
    found = motion(slider(potential="x^2/2"), duration=20.0)
    assert np.max(np.abs(found.q[:, 0] - np.cos(found.times))) < CLOSE
    assert np.max(np.abs(found.a[:, 0] + np.cos(found.times))) < CLOSE


@pytest.mark.parametrize(
    "method", [pytest.param("x: 0", marks=pytest.mark.slow), "rod"]
)
def test_a_pendulum_on_a_rod_is_the_pendulum_of_an_angle(method):
    angle = Item(
        "angle", coordinates={"a": (0.5, 0.0)}, kinetic=("a_dot^2/2",),
        potential=("-9.81*cos(a)",),
    )  # fmt: skip
    start = (float(np.sin(0.5)), float(-np.cos(0.5)))
    law = "x^2 + y^2 = 1" if method == "rod" else "x*x_dot + y*y_dot = 0"
    rod = Item(
        "rod", coordinates={"x": (start[0], 0.0), "y": (start[1], 0.0)},
        kinetic=("(x_dot^2 + y_dot^2)/2",), potential=("9.81*y",),
        constraints={"rod": law},
    )  # fmt: skip
    one, other = motion(angle), motion(rod)
    # The start is rounded to doubles, and swings magnify that by their phase.
    assert np.max(np.abs(np.sin(one.q[:, 0]) - other.q[:, 0])) < 1e-13
    pull = other.lam[:, 0] * (2.0 if method == "rod" else 1.0)
    swing = -(one.v[:, 0] ** 2) - 9.81 * np.cos(one.q[:, 0])
    assert np.max(np.abs(pull - swing)) < 1e-11


def test_kepler_comes_back_after_a_period():
    planet = Item(
        "planet", coordinates={"x": (0.5, 0.0), "y": (0.0, float(np.sqrt(3)))},
        kinetic=("(x_dot^2 + y_dot^2)/2",), potential=("-1/sqrt(x^2 + y^2)",),
    )  # fmt: skip
    found = motion(planet, duration=float(2 * np.pi), step=float(np.pi))
    assert np.max(np.abs(found.q[:, 0] - np.array([0.5, -1.5, 0.5]))) < 1e-14
    # sqrt(3) and pi are rounded to doubles; a period magnifies that some ten times.
    assert np.max(np.abs(found.q[:, 1])) < 1e-14


def test_dry_friction_stops_the_oscillator_where_it_sticks():
    found = motion(slider(potential="x^2/2", force="-0.11*sign(x_dot)"), duration=20.0)
    # Each swing loses 0.22; past 0.12 the last one ends at 0.1, within the friction.
    assert abs(found.q[-1, 0] - Long(0.1)) < 1e-15
    assert np.allclose(found.switched, np.pi * np.arange(1, 6), rtol=0, atol=1e-14)
    assert found.v[-1, 0] == pytest.approx(0.0, abs=1e-17)
    assert found.a[-1, 0] == pytest.approx(0.0, abs=1e-17)


def test_a_block_sticks_to_a_belt_until_the_spring_tears_it_off():
    block = slider(0.0, 0.25, potential="x^2/2", force="-sign(x_dot - 0.25)")
    found = motion(block, duration=6.0, step=3.9)
    assert found.q[1, 0] == pytest.approx(3.9 / 4)
    # From x = 1 at t = 4: x = 1 + sin(t - 4)/4 under the spring and sliding friction.
    assert abs(found.q[-1, 0] - 1 - np.sin(Long(2)) / 4) < CLOSE


def test_a_block_that_slips_for_a_moment_within_a_step_is_seen():
    found = motion(
        slider(0.0, 0.2, force="1.0001 - (t - 5.03)^2 - sign(x_dot)"), start=4.0,
        duration=2.0, step=2.0,
    )  # fmt: skip
    # Past the friction by 0.0001 - (t - 5.03)^2: it slides from 4 to a stop, and again
    # from 5.02 to 5.05, by 0.03^3/300 - 0.03^4/12.
    past = np.polynomial.Polynomial([1e-4 - 5.03**2, 2 * 5.03, -1.0])
    speed = past.integ(lbnd=4.0) + 0.2
    stop = min(x.real for x in speed.roots() if x.real > 4.0)
    assert np.allclose(found.switched, [stop, 5.02, 5.05], rtol=0, atol=1e-12)
    way = speed.integ(lbnd=4.0)(stop) + 0.03**3 / 300 - 0.03**4 / 12
    assert abs(found.q[-1, 0] - way) < 1e-13


@pytest.mark.parametrize(
    ("law", "speed"),
    [
        ("-0.5*x_dot", lambda t: 2 * np.exp(-t / 2)),
        ("-0.5*abs(x_dot)*x_dot", lambda t: 2 / (1 + t)),
        ("-sign(x_dot)*abs(x_dot)^1.5", lambda t: (2**-0.5 + t / 2) ** -2),
        ("-sign(x_dot)*sqrt(abs(x_dot))", lambda t: max(0, 2**0.5 - t / 2) ** 2),
        ("-x_dot^3", lambda t: (1 / 4 + 2 * t) ** -0.5),
    ],
)
def test_drag_slows_as_its_law_says(law, speed):
    found = motion(slider(0.0, 2.0, force=law), duration=2.5)
    exact = np.array([speed(t) for t in found.times.astype(float)])
    assert np.max(np.abs(found.v[:, 0] - exact)) < 1e-14


def test_until_is_located():
    fall = slider(5.0, 0.0, potential="8*x")
    found = motion(fall, until="x <= 1.76")
    assert found.stopped
    assert found.end == pytest.approx(0.9, abs=1e-15)
    dips = slider(potential="x^2/2")
    found = motion(dips, until="x <= -0.9999999", step=10.0)
    assert found.end == pytest.approx(np.arccos(-0.9999999), abs=1e-9)


def test_a_narrow_pulse_is_seen():
    pulse = slider(
        0.0, force="exp(-((t - 5.3)/0.001)^2)", features=(("t - 5.3", 0.0005),)
    )
    found = motion(pulse, duration=6.0, step=3.0)
    assert abs(found.v[-1, 0] - Long(0.001) * np.sqrt(Long(np.pi))) < 1e-17


def test_a_narrow_hill_turns_back_what_is_slow():
    hill = slider(
        -1.0, 1.0, potential="exp(-(x/0.01)^2)", features=(("x", 0.005),)
    )  # fmt: skip
    found = motion(hill, duration=3.0)
    assert abs(found.v[-1, 0] + 1) < 1e-13


def test_forces_that_jump_in_time_are_met():
    box = slider(
        0.0, force="if(t > 1 and t < 1.5, 4, 0) + sign(sin(pi*t))",
        breaks=(1.0, 1.5, 2.0, 3.0, 4.0),
    )  # fmt: skip
    found = motion(box, duration=4.0)
    # Box: speed 2 from 1.5 on, 1/2 + 2*(t - 1.5); square wave: up 1, down 1, twice.
    assert abs(found.q[-1, 0] - (0.5 + 2 * 2.5 + 2)) < 1e-13


def test_a_wall_gives_back_the_speed():
    wall = slider(1.0, -1.0, potential="100*max(0, -x)^2/2")
    found = motion(wall, duration=4.0, step=4.0)
    # Half a period, pi/10, in the wall.
    assert abs(found.q[-1, 0] - (4.0 - 1.0 - Long(np.pi) / 10)) < 1e-14
    assert len(found.switched) == 2


@pytest.mark.slow
def test_a_chaotic_scene_gives_no_truth():
    arms = Item(
        "double", coordinates={"a": (3.0, 0.0), "b": (2.5, 0.0)},
        kinetic=("a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b)",),
        potential=("-20*cos(a) - 10*cos(b)",),
    )  # fmt: skip
    with pytest.raises(NoTruthError):
        truth(a_scene(arms, duration=25.0, step=25.0))


def test_the_verdict_sees_what_is_wrong_and_grants_what_is_told():
    scene = a_scene(slider(potential="x^2/2"), duration=2.0, step=1.0)
    exact = truth(scene)
    times = np.array([0.0, 1.0, 2.0])

    def verdict(shift, told, *, warnings=(), code=0, outcome="done", choice="method"):
        rows = np.stack([times, np.cos(times) + shift * times, -np.sin(times)], axis=1)
        record = {
            "complete": True, "outcome": outcome, "warnings": list(warnings),
            "method": "m", "rtol": 1e-11, "plan": [{"choice": choice, "reason": ""}],
            "error": {"coordinates": {"x": {"largest": told}}},
        }  # fmt: skip
        answer = Answer(code, "", record, ["t", "x", "x_dot"], rows)
        return judge(scene, answer, exact)

    assert verdict(0.0, 1e-12).kind == "fine"
    assert verdict(1e-9, 1e-10).kind == "fine"
    assert verdict(1e-9, 1e-10).ratio == pytest.approx(20, rel=1e-3)
    assert verdict(1e-4, 1e-9).kind == "silent-wrong"
    told = [{"code": "horizon", "text": ""}]
    assert verdict(1e-4, 1e-6, warnings=told).kind == "fine"
    assert verdict(1e-9, 0.5, warnings=told).kind == "false-horizon"
    assert verdict(1e-4, 1e-9, warnings=told).kind == "told-too-small"
    assert verdict(1e-4, 1e-9, warnings=[{"code": "step-unused"}]).is_fault
    assert verdict(0.0, 1e-12, outcome="until").kind == "wrong-rows"
    assert verdict(0.0, 1e-12, code=70).kind == "crash"
    assert verdict(0.0, 1e-12, code=3).kind == "refused-3"
    assert verdict(0.0, 1e-12, code=-1).kind == "hang"
    assert verdict(0.0, 1e-12, choice="repeated: radau").kind == "repeated"


class OneNumber:
    """A program whose run has one number, by its step; other methods are refused."""

    def __init__(self, numbers):
        self.numbers = iter(numbers)

    def run(self, _text, _option, method, *_steps):
        if method != "rk4":
            return Answer(2, f"{method} cannot handle this model [E402]")
        return Answer(
            0, "", {"complete": True}, ["x"], np.array([[next(self.numbers)]])
        )


@pytest.mark.parametrize(
    ("numbers", "magnified", "kind"),
    [
        ([1 + 1e-4, 1 + 1e-5], 1.0, "fine"),
        ([1 + 1e-2, 1 + 1e-3, 1 + 1e-4], 1.0, "fine"),
        ([2 + 1e-4, 2 + 1e-5], 1.0, "wrong"),
        ([1 + 1e-5, 1 + 1e-5], 1.0, "wrong"),
        ([1.4, 0.8, 1.2], 1.0, "unsettled"),
        ([1.4, 0.8, 1.2], 100.0, "uncounted"),
    ],
)
def test_runs_with_fixed_steps_may_be_off_by_their_distance(numbers, magnified, kind):
    def judged(answer, apart):
        return Verdict("fine" if abs(answer.rows[0, 0] - 1) < apart else "wrong")

    runs = Runs(OneNumber(numbers), ["verlet", "rk4"], ())
    found = runs.verdict("", 1.0, lambda x: x.rows, magnified, judged)
    assert (found.kind, found.text[:4]) == (kind, "rk4:")


def test_scenes_follow_from_their_seed():
    scene = scene_of("same-0")
    assert scene.text() == scene_of("same-0").text()
    assert list(yaml.safe_load(scene.text())["coordinates"]) == scene.q
    assert scene_of("same-1").text() != scene.text()


@pytest.mark.slow
def test_a_touch_of_a_bumper_within_a_step_is_seen():
    """At x = -0.02 a bumper of w = 141 is met at u = 0.002, and left at u."""
    u, w = 0.002, 20000**0.5
    start = (0.04 + u**2) ** 0.5
    bumper = slider(
        0.0, -start, potential="-x", force="20000*max(0, -0.02 - x)",
        laws=(Law("contact", "x + 9"),),
    )  # fmt: skip
    last = path(a_scene(bumper, duration=3.0, step=3.0))[0].rows[-1][1]
    left = 3.0 - (start - u) - 2 * math.atan(u * w) / w
    assert last[0] == pytest.approx(-0.02 + u * left + left**2 / 2, abs=1e-10)


def ball(e, **law):
    """A ball of mass 2 that is dropped from 1 and slides at 3."""
    item = Item(
        "ball", coordinates={"x": (0.0, 3.0), "y": (1.0, 0.0)}, loose=("x", "y"),
        kinetic=("x_dot^2 + y_dot^2",), potential=("2*9.81*y",),
        laws=(Law("contact", "y", e, slip="x_dot", **law),),
    )  # fmt: skip
    return a_scene(item, duration=3.0, step=0.1)


@pytest.mark.slow
def test_the_hybrid_referee_knows_bounces_rest_and_friction():
    found, known = path(ball(0.5, mu=0.1))
    times = math.sqrt(2 / 9.81) * (1 + 2 * (1 - 0.5 ** np.arange(4)))
    assert found.impacts[:4] == pytest.approx(times, abs=1e-10)
    # Once it lies the floor has pushed as much as its weight, and a tenth along.
    # Bounces that take 3e-9 of the run are left out.
    last = found.rows[-1][1]
    assert last[1:] == pytest.approx([0, 3 - 0.981 * 3, 0], abs=2e-8)
    assert np.max(known) < 1e-7
    stopped, _ = path(ball(0.0, mu=0.5))
    assert stopped.rows[-1][1][2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_the_hybrid_referee_knows_tables_and_events():
    document = {
        "coordinates": {"x": {}}, "initial": {"x": 0}, "modes": {"u": 1},
        "energy": {"kinetic": "x_dot^2/2", "potential": "0"}, "forces": {"x": "u*f(t)"},
    }  # fmt: skip
    events = {"off": {"at": "x >= 1/6", "set": {"u": "0"}}}
    tables = {"f": ([0, 1], [0, 1], "linear", "extend")}
    scene = Plain(document, tables=tables, events=events)
    found = Hybrid(Equations(scene)).path(0.0, [0.0, 2.0])
    # x = t^3/6 up to t = 1, and straight on from there.
    assert found.events[0][0] == pytest.approx(1.0, abs=1e-12)
    assert found.rows[-1][1] == pytest.approx([1 / 6 + 0.5, 0.5], abs=1e-11)


@pytest.mark.parametrize("past", [0.0009, 0.002, 0.004])
def test_a_kink_just_before_the_end_of_a_step_is_seen(past):
    # A throw with drag as the square of the speed: it is up at atan(2), and a step
    # ends a little later, past all the midpoints but not past the kink.
    top = np.arctan(Long(2))
    end = top + Long(past)

    def slope(_, y):
        return np.array([y[1], -1 - abs(y[1]) * y[1]])

    step = Extrapolation(slope, lambda *_: float(end) / 20, 7, 1e-16, 150_000)
    t, y = Long(0), np.array([0, 2], Long)
    while t < end:
        _, _, y, t = step.advance(t, y, end)
    assert abs(y[1] + np.tanh(Long(past))) < 1e-14
