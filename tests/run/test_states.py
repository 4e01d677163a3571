"""First-order states s' = g(t, q, q', s) beside the motion, against closed forms."""

import re

import numpy as np
import pytest
import sympy as sp
import yaml
from scipy.integrate import solve_ivp
from scipy.linalg import eigvals, expm

from lagsim import check, load
from lagsim.api.models import model_of
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.linearisation import Linearisation
from lagsim.methods import method, names
from lagsim.model.reader import read
from tests.invariance.same import CHANGES, EPS, Sizes
from tests.invariance.transforms import document
from tests.studies.judged import barred
from tests.support import MODELS, refused, run, simulate
from tests.sympy_oracle import Oracle

CAN = [name for name in names() if getattr(method(name), "STATES", False)]
FREE = "energy: {kinetic: q_dot^2/2, potential: 0}\n"


def stateful(states, sections=FREE, start="q: 1, s: 0.2", **options):
    """Read a model of a coordinate q with states: name -> rate."""
    options.setdefault("method", "dop853")
    rates = "".join(f'  {s}: {{rate: "{rate}"}}\n' for s, rate in states.items())
    text = f"coordinates: {{q: {{}}}}\nstates:\n{rates}initial: {{{start}}}\n{sections}"
    text += "\nsimulation: {duration: 4, output_step: 0.05}"
    options = {key: str(value) for key, value in options.items()}
    return read(text, "model.yaml", options=options)


def happened(found):
    return [(event.kind, event.time) for event in found.trajectory.events]


OSCILLATOR = "energy: {kinetic: q_dot^2/2, potential: 2*q^2}\n"
FOLLOWS = {"s": "(q - s)/0.3"}, OSCILLATOR
FOLLOWED = [[0, 1, 0], [-4, 0, 0], [1 / 0.3, 0, -1 / 0.3]]


@pytest.mark.parametrize("loops", [False, True])
@pytest.mark.parametrize("name", CAN)
def test_relaxation_towards_an_oscillator(name, loops):
    if loops and name == "taylor":
        pytest.skip("made from nodes of the graph")
    step, far = (1e-4, 2e-3) if name == "euler" else (0.002, 2e-9)
    found = run(stateful(*FOLLOWS, method=name, step=step), loops=loops)
    z = np.array([expm(x * np.array(FOLLOWED)) @ [1, 0, 0.2] for x in found["t"]])
    for column, values in zip(("q", "q_dot", "s"), z.T, strict=True):
        assert found[column] == pytest.approx(values, abs=far)
    assert found["s_dot"] == pytest.approx((z[:, 0] - z[:, 2]) / 0.3, abs=10 * far)
    assert "work" not in found.system.columns.names


@pytest.mark.parametrize("name", [x for x in names() if x not in CAN])
def test_a_method_that_cannot_refuses(name):
    with refused("method-refused", f"`{name}`", "`s`"):
        run(stateful(*FOLLOWS, method=name))


@pytest.mark.slow
def test_a_controller_is_a_state_or_a_massless_coordinate():
    text = (MODELS / "dc-motor.yaml").read_text(encoding="utf-8")
    held = re.sub("(?m)^  z: .*\n", "", text).replace("phi: {", "z: {}\n  phi: {", 1)
    held = held.replace("z: 0}", "z: 0, z_dot: w_set/Ti}")
    held += "\nconstraints: {integral: z_dot = error/Ti}"
    state, coordinate = (simulate(load(x, U=1000)) for x in (text, held))
    for name in ("phi", "phi_dot", "i", "z"):
        size = np.max(np.abs(state[name]))
        assert state[name] == pytest.approx(coordinate[name], abs=3e-9 * size)
    assert state.record["energy_drift"] < 1e-12 * np.max(state["energy"])


def test_the_error_of_a_state_is_told():
    energy = OSCILLATOR.replace("2*q^2", "2*q^2*(1 + s/9)")
    states = {"s": "(q - s)/0.3"}
    _, bar = barred(stateful(states, energy, rtol=1e-6), always=True)
    loose, tight = (run(stateful(states, energy, rtol=x)) for x in (1e-6, 1e-12))
    assert bar.names == ("q", "s")
    for name, errors in zip(bar.names, bar.errors.T, strict=True):
        true = np.max(np.abs(loose[name] - tight[name]))
        assert np.max(errors) == pytest.approx(true, rel=0.3)


# F. Mazzia, C. Magherini, Test Set for IVP Solvers 2.4 (2008): rates, starts, the
# duration, and values at its end.
STIFF = {
    "VDPOL": (
        {"x": "y", "y": "1e6*((1 - x^2)*y - x)"}, "x: 2, y: 0", 2,
        {"x": 1.706167732170483, "y": -0.8928097010247975},
    ),
    "HIRES": (
        {
            "a": "-1.71*a + 0.43*b + 8.32*c + 0.0007", "b": "1.71*a - 8.75*b",
            "c": "-10.03*c + 0.43*d + 0.035*f", "d": "8.32*b + 1.71*c - 1.12*d",
            "f": "-1.745*f + 0.43*g + 0.43*h",
            "g": "-280*g*k + 0.69*d + 1.71*f - 0.43*g + 0.69*h",
            "h": "280*g*k - 1.81*h", "k": "-280*g*k + 1.81*h",
        },
        "a: 1, b: 0, c: 0, d: 0, f: 0, g: 0, h: 0, k: 0.0057", 321.8122,
        {
            "a": 0.7371312573325668e-3, "d": 0.1175651343283149e-2,
            "h": 0.2849998395185769e-2, "k": 0.2850001604814231e-2,
        },
    ),
    "OREGO": (
        {
            "a": "77.27*(b + a*(1 - 8.375e-6*a - b))", "b": "(c - (1 + a)*b)/77.27",
            "c": "0.161*(a - c)",
        },
        "a: 1, b: 2, c: 3", 360,
        {"a": 1.000814870318523, "b": 1228.178521549917, "c": 132.0554942846706},
    ),
    "ROBER": (
        {
            "a": "-0.04*a + 1e4*b*c", "b": "0.04*a - 1e4*b*c - 3e7*b^2",
            "c": "3e7*b^2",
        },
        "a: 1, b: 0, c: 0", 1e11,
        {"a": 0.2083340149701255e-7, "c": 0.9999999791665050},
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("VDPOL", "auto"), ("VDPOL", "radau"), ("HIRES", "taylor"), ("HIRES", "radau"),
        ("OREGO", "auto"), ("OREGO", "radau"), ("ROBER", "auto"), ("ROBER", "radau"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("rtol", [1e-9, 1e-11])
def test_stiff_states_are_right_without_a_repeat(name, method, rtol):
    # Tolerances are relative to ranges: up to 5e7 times the size of the last values.
    rates, start, duration, right = STIFF[name]
    options = {"duration": duration, "output_step": duration / 50}
    options |= {"method": method, "rtol": rtol}
    found = run(stateful(rates, start=f"q: 0, {start}", **options))
    for key, value in right.items():
        least = rtol * np.max(np.abs(found[key]))
        assert found[key][-1] == pytest.approx(value, rel=3e3 * rtol, abs=least)


@pytest.mark.slow
def test_van_der_pol_by_auto_goes_over_to_radau():
    # F. Mazzia, C. Magherini, Test Set for IVP Solvers 2.4 (2008), VDPOL: y(2).
    rates = {"x": "y", "y": "1e6*((1 - x^2)*y - x)"}
    start, options = "q: 0, x: 2, y: 0", {"duration": 2, "rtol": 1e-9}
    found = run(stateful(rates, start=start, method="auto", **options))
    assert found["x"][-1] == pytest.approx(1.706167732170483, abs=1e-8)
    assert found["y"][-1] == pytest.approx(-0.8928097010247975, abs=1e-7)
    [changed] = found.trajectory.choices
    assert "radau" in changed.choice
    assert "`y`" in changed.reason


@pytest.mark.parametrize("name", ["dop853", "radau", "taylor"])
def test_a_switch_of_a_state_is_located(name):
    force = FREE + 'forces: {q: "if(s > 0.5, 1, 0)"}'
    found = run(stateful({"s": "1 - s"}, force, "q: 0, s: 0", method=name))
    since = np.maximum(found["t"] - np.log(2.0), 0.0)
    assert found["q"] == pytest.approx(since**2 / 2.0, abs=1e-8)


@pytest.mark.parametrize("name", ["dop853", "radau", "taylor"])
def test_a_state_slides_along_a_surface_of_its_own(name):
    found = run(stateful({"s": "-sign(s) + 0.3"}, start="q: 0, s: 0.5", method=name))
    [(kind, time)] = happened(found)
    assert (kind, time) == ("stick", pytest.approx(0.5 / 0.7, abs=1e-10))
    after = found["t"] > time
    assert np.max(np.abs(found["s"][after])) < 1e-14
    assert np.max(np.abs(found["s_dot"][after])) < 1e-14


SLIDES = {
    # A state that is led along a moving surface, until it is too fast to be followed.
    "led": ("-2*sign(s - 2*sin(t)^2)", "", "q: 0, s: 0", lambda t: 2 * np.sin(t) ** 2),
    # A velocity that is led by a state.
    "drives": ("cos(t)", "forces: {q: -4*sign(q_dot - s)}", "q: 0, s: 0", np.sin),
    # Both step: w = 1/2 of q'' = -4, 4 and s' = 2, -2, from 1/2 apart.
    "both": ("2*sign(q_dot - s)", "forces: {q: -4*sign(q_dot - s)}", "q: 0, s: 0.5",
             lambda t: 0 * t + 1 / 3),
}  # fmt: skip


@pytest.mark.parametrize("case", SLIDES)
def test_sliding_of_states_and_velocities(case):
    rate, force, start, level = SLIDES[case]
    found = run(stateful({"s": rate}, FREE + force, start, duration=0.7))
    assert happened(found)[0][0] == "stick"
    late = found["t"] > 0.2
    expected = level(found["t"][late])
    assert found["s"][late] == pytest.approx(expected, abs=1e-12)
    if force:
        assert found["q_dot"][late] == pytest.approx(expected, abs=1e-12)
        assert found.drift < 1e-11


LED = "energy: {kinetic: q_dot^2, potential: 0}\nconstraints: {led: q_dot = s}"
BRAKE = FREE + "constraints: {led: {relation: q_dot = 0, limit: s}}"


@pytest.mark.parametrize("loops", [False, True])
def test_a_relation_of_velocities_follows_a_state(loops):
    found = run(stateful({"s": "-s"}, LED, "q: 0, q_dot: 1, s: 1"), loops=loops)
    assert found["q"] == pytest.approx(1.0 - np.exp(-found["t"]), abs=1e-9)
    assert found["lambda_led"] == pytest.approx(-2.0 * np.exp(-found["t"]), abs=1e-8)
    assert found.drift < 1e-8


def test_a_brake_that_is_applied_slowly():
    found = run(stateful({"s": "20 - 2*s"}, BRAKE, "q: 0, q_dot: 3, s: 0"))
    # q' = 3 - 10 t + 5 (1 - exp(-2 t)) until it is 0.
    [(kind, time)] = happened(found)
    assert kind == "stick"
    assert 3 - 10 * time + 5 * (1 - np.exp(-2 * time)) == pytest.approx(0.0, abs=1e-10)
    assert found["q_dot"][-1] == 0.0
    assert found.drift < 1e-10


@pytest.mark.slow
def test_a_belt_whose_speed_is_a_state_carries_a_block_that_falls_on_it():
    # It ends once the belt is at 1.9.
    found = simulate("""
coordinates: {x: {}, y: {}}
states: {belt: {rate: 2 - belt}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {on: {relation: y >= 0, restitution: 0, friction: 0.1, slip: x_dot - belt}}
initial: {x: 0, y: 1, belt: 0}
simulation: {duration: 4, until: belt >= 1.9}
""")
    assert found["belt"] == pytest.approx(2 - 2 * np.exp(-found.t), abs=1e-10)
    assert found.t[-1] == pytest.approx(np.log(20.0), abs=1e-10)
    assert found["x_dot"][-1] == pytest.approx(1.9, abs=1e-12)
    assert found.record["energy_drift"] < 1e-11
    kinds = [x.kind for x in found.events]
    assert kinds == ["impact", "contact", "stick", "until"]


def chance(seed):
    """Return the text of a model with 1 or 2 coordinates and 1 to 3 states."""
    random = np.random.default_rng(seed)

    def number(low=0.2, high=1.5):
        return f"{random.uniform(low, high):.3f}"

    def one(of):
        return of[int(random.integers(len(of)))]

    q = [f"q{i}" for i in range(random.integers(1, 3))]
    s = [f"s{k}" for k in range(random.integers(1, 4))]
    v = [f"{x}_dot" for x in q]
    T = f"0.1*{v[0]}*{v[-1]} + {number()}*{one(s)}*{one(v)}"
    for x in v:
        part = one([f"sin({one(q)})^2", f"tanh({one(s)})^2", "cos(t)^2"])
        T += f" + ({number()} + {number(0.1, 0.5)}*{part})*{x}^2"
    V = " + ".join(f"{number()}*{x}^2*(1 + 0.3*sin({one(s)}))" for x in q)
    rates = {}
    for k, x in enumerate(s):
        drive = one([*v, *q, "sin(t)", f"{one(q)}*{one(v)}"])
        rates[x] = f"{number()}*{drive} - {number()}*{x} + 0.2*{one(s)}*{one(q)}"
        rates[x] += f" + 0.1*{s[k - 1]}_dot" if k else ""
    sections = {
        "coordinates": {x: {} for x in q},
        "states": {x: {"rate": rate} for x, rate in rates.items()},
        "energy": {"kinetic": T, "potential": V},
        "forces": {x: f"{number()}*{one(s)} - {number()}*{x}_dot" for x in q},
        "initial": {x: number(-1, 1) for x in (*q, *v, *s)},
        "simulation": {"duration": 3, "output_step": 0.1},
    }
    return yaml.safe_dump(sections, sort_keys=False, width=10**6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_scenes_by_chance_against_scipy(seed):
    model, oracle = load(chance(seed)), Oracle(chance(seed))
    found = simulate(model, method=("auto", "dop853", "taylor", "radau")[seed % 4])
    n, rates = len(oracle.q), [oracle.name(f"{s.name}_dot") for s in oracle.s]
    state = [*oracle.q, *oracle.v, *oracle.s]
    terms = sp.lambdify([oracle.t, state], [sp.Matrix(oracle.M), oracle.f, rates])

    def rhs(t, y):
        M, f, s_dot = terms(t, y)
        return [*y[n : 2 * n], *np.linalg.solve(M, np.array(f, float)), *s_dot]

    start, options = [x.value for x in model.initial], {"rtol": 1e-12, "atol": 1e-13}
    solved = solve_ivp(rhs, (0, 3), start, "DOP853", found.t, **options)
    expected = solved.y
    for x, values in zip(model.initial, expected, strict=True):
        assert found[x.name] == pytest.approx(values, abs=2e-10)
    assert found.record["energy_drift"] < 1e-10
    assert found.warnings == []
    # The same accelerations, and rates, as a function.
    motion = model.rhs.motion(found.t, *np.split(expected.T, [n, 2 * n], axis=1))
    a = [found[f"{q.name}_ddot"] for q in oracle.q]
    s_dot = [found[f"{s.name}_dot"] for s in oracle.s]
    assert pytest.approx(np.array(a), abs=1e-8) == motion.accelerations.T
    assert pytest.approx(np.array(s_dot), abs=1e-8) == motion.rates.T


# A spring, a filter that feeds back, and a follower that slides.
FOLLOWER = """
coordinates: {x: {}}
states: {s: {rate: (x - s)/0.3}, h: {rate: -sign(h - s)/2}}
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
forces: {x: -s - h/3}
initial: {x: 1, s: 0, h: 0}
simulation: {duration: 3, output_step: 1/16, method: dop853}
"""


@pytest.mark.slow
@pytest.mark.parametrize("word", CHANGES)
def test_the_same_motion_in_other_words(word):
    changed = CHANGES[word].put(document(FOLLOWER), Sizes(1.0, 2.0, 3.0))
    base, found = simulate(FOLLOWER), simulate(changed.text())
    bound = 2e-10 + 100.0 * EPS * CHANGES[word].rounding
    for name in ("x", "s", "h"):
        assert found[name] == pytest.approx(base[name], abs=bound)
    times = [(e.time - changed.shift) * changed.scale for e in found.events]
    assert times == pytest.approx([e.time for e in base.events], abs=5.0 * bound)
    assert len(times) == 2


STEADY = [
    ({"s": "q - s^3"}, "q: 8, s: {steady: 1}", 2.0),
    ({"s": "q - exp(s)"}, "q: 5, s: {steady: 20}", np.log(5.0)),
    ({"s": "z - s", "z": "q - 2*z"}, "q: 8, s: {steady: 1}, z: {steady: 0}", 4.0),
    ({"s": "q_dot - s"}, "q: 0, q_dot: 3, s: {steady: 0}", 3.0),
]


@pytest.mark.parametrize(("rates", "start", "s"), STEADY)
def test_a_steady_start(rates, start, s):
    found = run(stateful(rates, start=start))
    assert found["s"][0] == pytest.approx(s, rel=1e-14)
    assert abs(found["s_dot"][0]) < 1e-13


@pytest.mark.parametrize(("rate", "admissible"), [("1 + s^2", False), ("q", True)])
def test_a_start_that_cannot_be_steady(rate, admissible):
    found = check(model_of(stateful({"s": rate}, start="q: 0, s: {steady: 1}")))
    assert found.admissible is admissible
    assert [x["code"] for x in found.warnings] == ["undetermined-guess"] * admissible
    assert [x["name"] for x in found.start_values] == ["s_dot: 0"] * (not admissible)


def test_eigenvalues_with_states_under_a_constraint():
    # A pendulum in the plane, driven by a filter of its own speed along the rope.
    model = read("""
coordinates: {x: {}, y: {}}
states: {s: {rate: (x_dot - s)/0.2}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9*y}
forces: {x: -2*s}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: 0, y: -1, s: 0}
simulation: {duration: 1}
""", "model.yaml")  # fmt: skip
    at = 0.0, np.array([0.0, -1.0]), np.zeros(2), np.zeros(1)
    found = np.sort_complex(Linearisation(derive(model)).at(*at).eigenvalues())
    expected = np.sort_complex(eigvals([[0, 1, 0], [-9, 0, -2], [0, 5, -5]]))
    assert found == pytest.approx(expected, abs=1e-12)


@pytest.mark.slow
def test_a_motor_at_rest_is_where_its_equations_say():
    found = simulate(MODELS / "dc-motor.yaml", duration=2)
    [switch, load] = [x.time for x in found.events if x.kind == "switch"]
    before = np.searchsorted(found.t, load) - 1
    for row, current, integral in ((before, 1.92, 36.52), (-1, 5.92, 60.52)):
        known = [found[name][row] for name in ("phi_dot", "i", "z")]
        assert known == pytest.approx([100.0, current, integral], abs=1e-3)
    assert 0.0 < switch < 0.02
    assert found.at([0.3])["z"] == pytest.approx(found["z"][found.t == 0.3], abs=1e-12)
    assert found.record["energy_drift"] < 1e-12
