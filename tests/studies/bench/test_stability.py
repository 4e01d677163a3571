"""Borders of stability against theory, modes against closed forms, verdicts."""

import math

import numpy as np
import pytest

import lagsim
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.linearisation import Linearisation
from lagsim.methods import method
from lagsim.model.reader import read
from lagsim.run.interrupt import Interrupt
from lagsim.run.session import open_case
from lagsim.studies.bench.stability import MapOptions, measure
from lagsim.studies.step_bounds import predicted
from tests.small_scenes import oscillator, scene
from tests.support import MODELS

OSCILLATOR = oscillator("duration: 20")
DAMPED = """
parameters: {c: 0.1, k: 1}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2, dissipation: c*x_dot^2/2}
initial: {x: 1}
simulation: {duration: 20}
"""
# Modes x1 = x2 at 1 and x1 = -x2 at w; it starts in the slow one.
COUPLED = scene(
    "x1: 1, x2: 1",
    "(x1^2 + x2^2)/2 + k*(x1 - x2)^2/2",
    parameters="w: 10, k: (w^2 - 1)/2",
    simulation="duration: 20",
)
# Henon's quadratic map, as Verlet steps through a cubic well: at h w = sqrt 3 three
# steps make a turn, and no amplitude is stable.
CUBIC = scene("x: 0.12", "x^2/2 - x^3/3", simulation="duration: 20")
ROD = scene(
    "x: sin(0.02), y: -cos(0.02)",
    "g*y",
    parameters="g: 9.81",
    constraints="rod: x^2 + y^2 = 1",
    simulation="duration: 20",
)

# Where |amplification| leaves 1 on the imaginary axis: RK4 at sqrt 8, Verlet at 2; of
# Kahan and Li's the limits are given to four digits.
LIMITS = {"rk4": math.sqrt(8.0), "verlet": 2.0, "rattle": 2.0}
LIMITS |= {name: method(name).IMAGINARY_LIMIT for name in ("kahan-li6", "kahan-li8")}


def looked_at(text, *methods, steps, strip=6, **more):
    wish = MapOptions(methods, steps, strip=strip, **more)
    return measure(open_case(read(text, "model.yaml")), wish)


@pytest.mark.parametrize(
    ("text", "methods", "steps", "rate"),
    [
        (OSCILLATOR, LIMITS, (1.0, 4.0), 1.0),
        # The mode that is not excited sets the border; a start at rest is perturbed.
        (COUPLED, ("rk4", "verlet"), (0.1, 0.4), 10.0),
        (oscillator("duration: 20", x=0), ("verlet",), (1.0, 4.0), 1.0),
        # The free direction of a constraint: the eigenvalues are +-i sqrt(g cos theta).
        (ROD, ("rattle", "rk4"), (0.3, 1.2), math.sqrt(9.81)),
    ],
)
def test_borders_of_oscillations(text, methods, steps, rate):
    found = looked_at(text, *methods, steps=steps)
    assert found["borders"].keys() == set(methods)
    for name, border in found["borders"].items():
        expected = LIMITS[name] / rate
        assert border["predicted_at_start"] == pytest.approx(expected, rel=1e-3)
        assert border["predicted_along"] == pytest.approx(expected, rel=1e-3)
        assert border["found"] == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_damped_borders():
    found = looked_at(DAMPED, "euler", "rk4", steps=(0.03, 4.0))["borders"]
    # |1 + h lambda|^2 = 1 - c h + k h^2.
    assert found["euler"]["predicted_at_start"] == pytest.approx(0.1, rel=1e-5)
    assert found["euler"]["found"] == pytest.approx(0.1, rel=0.01)
    predicted_at_start = found["rk4"]["predicted_at_start"]
    assert found["rk4"]["found"] == pytest.approx(predicted_at_start, rel=0.01)
    assert predicted_at_start > 2.8


def test_euler_grows_as_it_should():
    found = looked_at(OSCILLATOR, "euler", steps=(0.01, 0.04))
    for cell in found["cells"]:
        assert cell["verdict"] in ("grows", "diverges")
        # |1 + i h|^2 per step, of an energy perturbed by less than 1e-3.
        rate = math.log1p(cell["step"] ** 2) / cell["step"]
        assert cell["growth"] == pytest.approx(rate, rel=0.01)
    border = found["borders"]["euler"]
    assert (border["found"], border["predicted_at_start"]) == (None, 0.0)
    assert "no step holds" in border["note"]


def test_rk4_decays_and_verlet_holds():
    found = looked_at(OSCILLATOR, "rk4", "verlet", steps=(0.9, 1.1))
    told = {(cell["method"], cell["verdict"]) for cell in found["cells"]}
    assert told == {("rk4", "decays"), ("verlet", "holds")}
    for border in found["borders"].values():
        assert border["found"] is None
        assert "all steps hold" in border["note"]


@pytest.mark.slow
def test_periodic_events_end_the_range_of_steps():
    # A damped oscillator whose force is set every 0.1 s: no step is longer.
    text = DAMPED + "modes: {u: 0}\nforces: {x: u}\n"
    text += "events: {sample: {every: 0.1, set: {u: -x/10}}}\n"
    found = looked_at(text, "rk4", steps=None)["cells"]
    assert max(x["step"] for x in found) == pytest.approx(0.1)
    # Steps that are asked for past it hold as those do: each ends at an event.
    found += looked_at(text, "rk4", steps=(0.7, 0.8), strip=2)["cells"]
    assert {x["verdict"] for x in found} == {"holds"}


@pytest.mark.slow
def test_the_third_order_resonance_shows_in_a_map():
    found = looked_at(CUBIC, "verlet", steps=(1.6, 1.85), strip=26)
    lost = [
        x["step"] for x in found["cells"] if x["verdict"] not in ("holds", "decays")
    ]
    assert min(abs(step - math.sqrt(3.0)) for step in lost) < 0.02
    assert all(1.6 < step < 1.84 for step in lost)


@pytest.mark.slow
def test_a_map_over_a_parameter():
    found = looked_at(
        COUPLED, "verlet", "dop853", steps=(0.05, 0.9), name="w", between=(5.0, 20.0),
        map=(6, 3),
    )  # fmt: skip
    assert found["vary"]["values"] == [5.0, 10.0, 20.0]
    methods = [cell["method"] for cell in found["cells"]]
    assert methods == ["verlet"] * 18 + ["dop853"] * 3
    for border in found["borders"]["verlet"]:
        expected = 2.0 / border["w"]
        assert border["found"] == pytest.approx(expected, rel=0.01)
        assert border["predicted_at_start"] == pytest.approx(expected, rel=1e-6)
    for cell in found["cells"][18:]:
        assert (cell["step"], cell["verdict"]) == (None, "holds")
        assert 0.0 < cell["smallest_step"] < 20.0
        assert cell["evaluations"] > 100


@pytest.mark.slow
def test_a_parameter_that_spoils_the_start():
    found = looked_at(
        ROD.replace("g*y", "sqrt(g)*y"), "rk4", steps=(0.1, 0.2), name="g",
        between=(-1.0, 4.0), map=(2, 2),
    )  # fmt: skip
    first, second, *others = [cell["verdict"] for cell in found["cells"]]
    assert first == second == "fails"
    assert not {"fails", "diverges", "grows"} & {*others}
    assert found["cells"][0]["reason"] == found["borders"]["rk4"][0]["note"] != ""


@pytest.mark.slow
def test_an_interrupt_ends_it():
    interrupt, case = Interrupt(), open_case(read(DAMPED, "model.yaml"))

    def pressed(_fraction):
        interrupt.signal = 2

    found = measure(case, MapOptions(), interrupt=interrupt, progress=pressed)
    assert not found["complete"]
    assert not found["borders"]
    with pytest.raises(KeyboardInterrupt):  # there is nothing to be kept
        measure(case, MapOptions(), interrupt=interrupt)


def test_no_predicted_border_where_the_motion_itself_grows():
    # Growth is no instability: RK4 and midpoint on e^t, midpoint's pole at h = 2.
    for name in ("rk4", "midpoint", "verlet"):
        assert predicted(method(name).amplification, [1.0 + 0j], 100.0) is None


def test_eigenvalues_do_not_depend_on_coordinates():
    # Along the motion too: the pendulum in x, y against its angle.
    angle = scene("a: 1", "-g*cos(a)", parameters="g: 9.81", simulation="duration: 1")
    in_angle = Linearisation(derive(read(angle, "a.yaml")))
    in_plane = Linearisation(derive(read(ROD, "b.yaml")))
    for a, rate in ((0.3, 1.5), (2.0, -3.0)):
        one = in_angle.at(0.0, np.array([a]), np.array([rate]))
        q = np.array([math.sin(a), -math.cos(a)])
        v = rate * np.array([math.cos(a), math.sin(a)])
        other = in_plane.at(0.0, q, v)
        expected = np.sort_complex(one.eigenvalues())
        assert np.sort_complex(other.eigenvalues()) == pytest.approx(
            expected, rel=1e-12
        )
        assert expected**2 == pytest.approx(-9.81 * math.cos(a), rel=1e-12)


def rest(text, **overrides):
    """Return the record of a map of one run, for its equilibrium and modes."""
    model = read(text, "model.yaml", overrides)
    wish = MapOptions(("rk4",), (0.01, 0.01), strip=1)
    return measure(open_case(model), wish)


# With a force that follows the position late.
LAGGING = """
coordinates: {x: }
states: {s: {rate: (x - s)/0.2}}
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
forces: {x: -s}
initial: {x: 0.5, s: 0}
simulation: {duration: 10}
"""
# Text, overrides, the equilibrium, and of each mode frequency (1/s) and damping ratio.
MODES = [
    (COUPLED, {}, {"x1": 0, "x2": 0}, [(1, 0), (10, 0)]),
    # c / (2 sqrt(k m)), and the frequency that damping leaves.
    (DAMPED, {"c": "0.6", "k": "4"}, {"x": 0}, [(math.sqrt(4 - 0.09), 0.15)]),
    (ROD, {}, {"x": 0, "y": -1}, [(math.sqrt(9.81), 0)]),
    # Equal masses and lengths: w^2 = (2 -+ sqrt 2) g/l.
    (
        (MODELS / "double-pendulum.yaml").read_text(),
        {"g": "8", "l1": "2", "l2": "2", "theta1": "0.3", "theta2": "0.2"},
        {"theta1": 0, "theta2": 0},
        [(2 * math.sqrt(2 - math.sqrt(2)), 0), (2 * math.sqrt(2 + math.sqrt(2)), 0)],
    ),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("text", "overrides", "at", "expected"), MODES)
def test_modes_about_an_equilibrium(text, overrides, at, expected):
    found = rest(text, **overrides)
    assert found["equilibrium"] == pytest.approx(at, abs=1e-9)
    told = [(m["angular_frequency"], m["damping_ratio"]) for m in found["modes"]]
    assert told == [
        (pytest.approx(rate, rel=1e-9), pytest.approx(ratio, rel=1e-9, abs=1e-9))
        for rate, ratio in expected
    ]
    periods = [mode["period"] for mode in found["modes"]]
    assert periods == pytest.approx([2 * math.pi / rate for rate, _ in expected])


@pytest.mark.parametrize(
    ("text", "at"),
    [
        # Nearest to its start.
        pytest.param(
            MODES[3][0], {"theta1": math.pi, "theta2": 0}, marks=pytest.mark.slow
        ),
        (LAGGING, {"x": 0, "s": 0}),
    ],
)
def test_the_equilibrium_is_that_of_modes(text, at):
    found, small = rest(text), lagsim.modes(text)
    assert found["equilibrium"] == pytest.approx(at, abs=1e-9)
    assert {x: small.about[x] for x in at} == pytest.approx(at, abs=1e-9)
    told = [mode["eigenvalue"] for mode in found["modes"]]
    assert told == [mode["eigenvalue"] for mode in small.modes]


def test_shapes_of_coupled_oscillators():
    slow, fast = (mode["shape"] for mode in rest(COUPLED)["modes"])
    assert slow == pytest.approx({"x1": 1, "x2": 1})
    assert fast["x1"] == pytest.approx(-fast["x2"], abs=1e-12)


@pytest.mark.parametrize(
    ("potential", "reason"), [("x", "no position of rest"), ("t*x^2", "on time")]
)
def test_no_equilibrium(potential, reason):
    text = OSCILLATOR.replace("potential: x^2/2", f"potential: {potential}")
    found = rest(text)
    assert found["equilibrium"] is None
    assert reason in found["equilibrium_reason"]


def test_an_unstable_start_is_the_equilibrium_found():
    text = oscillator("duration: 1", x=0).replace("x^2/2}", "cos(x)}")
    found = rest(text)
    assert found["equilibrium_is_start"]
    assert found["equilibrium"] == {"x": 0.0}
    rates = sorted(mode["eigenvalue"][0] for mode in found["modes"])
    assert rates == pytest.approx([-1, 1])
    assert [mode["period"] for mode in found["modes"]] == [None, None]


def test_large_scenes_have_no_eigenvalues(monkeypatch):
    monkeypatch.setattr("lagsim.studies.bench.stability.MOST_COORDINATES", 1)
    found = looked_at(COUPLED, "verlet", steps=(0.05, 0.1))
    assert "more than 1 coordinates" in found["eigenvalues"]["unknown"]
    assert found["borders"]["verlet"]["predicted_at_start"] is None
    assert found["equilibrium"] is None
    assert "more than 1 coordinates" in found["equilibrium_reason"]
