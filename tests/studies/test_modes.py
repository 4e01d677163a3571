"""Modes, responses and matrices against closed forms, and against runs."""

import itertools
import math

import numpy as np
import pytest

import lagsim
from lagsim.outputs.figure import encoded_figure
from lagsim.studies.modes import FrequencyResponse
from lagsim.studies.modes_drawing import _bode
from tests.support import MODELS, refused, simulate

CHAIN = """
parameters: {n: %d, k: 40, m: 0.1}
coordinates: {q(1..n): {unit: m}}
definitions: {x(0): 0, x(n+1): 0, x(i = 1..n): q(i)}
energy:
  kinetic: sum(i = 1..n, m*q_dot(i)^2/2)
  potential: sum(i = 0..n, k*(x(i+1) - x(i))^2/2)
initial: {q(1..n): 0, q(1): 0.1}
"""
OSCILLATOR = """
parameters: {m: 2, k: 50, c: 3}
coordinates: {x: {unit: m}}
energy: {kinetic: m*x_dot^2/2, potential: k*x^2/2, dissipation: c*x_dot^2/2}
forces: {x: 0}
initial: {x: 0.01}
simulation: {duration: 3, output_step: 0.1}
"""
ABSORBER = """
parameters: {m: 2, k: 50, ma: 0.3, ka: 9, ca: 0}
coordinates: {x: {unit: m}, y: {unit: m}}
energy:
  kinetic: (m*x_dot^2 + ma*y_dot^2)/2
  potential: (k*x^2 + ka*(y - x)^2)/2
  dissipation: ca*(y_dot - x_dot)^2/2
forces: {x: 0}
initial: {x: 0, y: 0}
"""
GROUND = """
parameters: {m: 3, k: 70, c: 2}
coordinates: {x: {}, b: {}}
energy:
  kinetic: m*x_dot^2/2 + b_dot^2/2
  potential: k*(x - b)^2/2
  dissipation: c*(x_dot - b_dot)^2/2
constraints: {ground: b = 0}
initial: {x: 0, b: 0}
"""
CARTESIAN = """
parameters: {l: 0.7, g: 9.81, m: 3}
coordinates: {x: {}, y: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*g*y}
constraints: {rod: x^2 + y^2 = l^2}
initial: {x: 0.1, y: {guess: -0.7}}
"""
MOTOR = """
parameters: {J: 0.02, b: 0.1, K: 0.5, L: 0.01, R: 1.2, Kp: 4, Ki: 30}
coordinates: {phi: {unit: rad}}
states:
  i: {rate: (Kp*e + Ki*s - K*phi_dot - R*i)/L, unit: A}
  s: {rate: e}
definitions: {e: -phi_dot}
energy: {kinetic: J*phi_dot^2/2, potential: 0}
forces: {phi: K*i - b*phi_dot}
initial: {phi: 0.3, i: 0, s: 0}
"""
TOP = """
parameters: {m: 1.5, g: 9.81, r: 0.2, J1: 0.05, J3: 0.02, w: 40}
coordinates: {a: {unit: rad}, b: {unit: rad}, spin: {unit: rad}}
frames: {top: {angles: [a, b, spin], axes: xyz}}
definitions: {G: "rotate(top, vec(0, 0, r))", W: omega(top)}
energy:
  kinetic: spin(vec(J1, J1, J3), W)
  potential: m*g*G.z
initial: {a: 0, b: 0, spin: 0, spin_dot: w}
"""
HOOP = """
parameters: {R: 0.8, g: 9.81, w: 5, m: 2}
coordinates: {theta: {unit: rad}}
energy:
  kinetic: m*R^2*(theta_dot^2 + w^2*sin(theta)^2)/2
  potential: -m*g*R*cos(theta)
initial: {theta: 1}
"""


def eigenvalues(found):
    return np.array([complex(*mode["eigenvalue"]) for mode in found.modes])


def rates(found):
    return 2 * math.pi * np.array([m["natural_frequency"] for m in found.modes])


@pytest.mark.parametrize("n", [1, 2, 7])
def test_a_chain_of_masses(n):
    found = lagsim.modes(CHAIN % n)
    k = np.arange(1, n + 1)
    expected = 2 * math.sqrt(40 / 0.1) * np.sin(k * math.pi / (2 * (n + 1)))
    assert rates(found) == pytest.approx(expected, rel=1e-12)
    assert found.zero == 0
    assert all(mode["stable"] for mode in found.modes)
    # The shape of mode k is sin(i k pi/(n + 1)), with 1 as its largest amplitude.
    for number, mode in enumerate(found.modes, 1):
        shape = np.sin(k * number * math.pi / (n + 1))
        got = np.array([complex(*x) for x in mode["shape"].values()])
        assert np.max(np.abs(got)) == pytest.approx(1)
        ratio = got @ shape / (shape @ shape)
        assert got == pytest.approx(ratio * shape, abs=1e-9)


def test_a_damped_oscillator():
    [mode] = lagsim.modes(OSCILLATOR).modes
    root = complex(-3, math.sqrt(4 * 2 * 50 - 9)) / 4
    assert complex(*mode["eigenvalue"]) == pytest.approx(root, rel=1e-13)
    assert mode["frequency"] == pytest.approx(root.imag / (2 * math.pi), rel=1e-13)
    assert mode["natural_frequency"] == pytest.approx(5 / (2 * math.pi), rel=1e-13)
    assert mode["damping"] == pytest.approx(3 / (2 * math.sqrt(2 * 50)), rel=1e-12)


def test_overdamped_modes_are_two():
    found = lagsim.modes(lagsim.load(OSCILLATOR).bind(c=30))
    expected = (-30 + np.array([1, -1]) * math.sqrt(900 - 400)) / 4
    assert eigenvalues(found) == pytest.approx(expected, rel=1e-12)
    assert [mode["frequency"] for mode in found.modes] == [0, 0]


def test_a_constraint_is_eliminated():
    found = lagsim.modes(CARTESIAN)
    assert rates(found) == pytest.approx([math.sqrt(9.81 / 0.7)], rel=1e-10)
    assert found.zero == 0
    assert found.about["y"] == pytest.approx(-0.7)


@pytest.mark.parametrize("unit", [1.0, 1e3, 1e-6], ids=["m", "mm", "Mm"])
def test_a_rigid_motion_has_two_zeros_in_any_unit(unit):
    text = f"""
parameters: {{k: {30 / unit**2}, m: {2 / unit**2}}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: m*(x_dot^2 + 3*y_dot^2)/2, potential: k*(y - x - {unit})^2/2}}
initial: {{x: {1e3 * unit}, y: {1001.5 * unit}}}
"""
    found = lagsim.modes(text)
    assert found.zero == 2
    expected = math.sqrt(30 / 2 * (1 + 1 / 3))
    assert rates(found) == pytest.approx([expected], rel=1e-9)


def test_a_bead_on_a_turning_hoop():
    found = lagsim.modes(HOOP)
    angle = math.acos(9.81 / (0.8 * 25))
    assert found.about["theta"] == pytest.approx(angle)
    assert rates(found) == pytest.approx([5 * math.sin(angle)], rel=1e-9)
    bottom = lagsim.modes(lagsim.load(HOOP).bind(theta=0), at="start")
    rate = math.sqrt(25 - 9.81 / 0.8)
    assert sorted(eigenvalues(bottom).real) == pytest.approx([-rate, rate])
    assert [mode["stable"] for mode in bottom.modes].count(False) == 1


def test_states_of_first_order_have_modes():
    found = lagsim.modes(MOTOR)
    J, b, K, L, R, Kp, Ki = 0.02, 0.1, 0.5, 0.01, 1.2, 4, 30
    A = [[-b / J, K / J, 0], [-(K + Kp) / L, -R / L, Ki / L], [-1, 0, 0]]
    expected = np.linalg.eigvals(np.array(A))
    got = eigenvalues(found)
    got = np.concatenate([got, got[got.imag > 0].conj()])
    assert sorted(got, key=abs) == pytest.approx(sorted(expected, key=abs), rel=1e-9)
    assert found.zero == 1  # of the angle
    assert set(found.modes[0]["states"]) == {"i", "s"}


@pytest.mark.parametrize(("part", "stable"), [(0.999, False), (1.001, True)])
def test_a_sleeping_top_is_stable_from_its_limit_on(part, stable):
    limit = 2 * math.sqrt(0.05 * 1.5 * 9.81 * 0.2) / 0.02
    found = lagsim.modes(lagsim.load(TOP).bind(w=part * limit), at="start")
    assert all(mode["stable"] for mode in found.modes) is stable
    assert found.about["spin_dot"] == pytest.approx(part * limit)


@pytest.mark.slow
@pytest.mark.parametrize(("part", "stable"), [(0.9999, False), (1.0001, True)])
def test_a_rolling_disk_is_stable_from_its_critical_speed_on(part, stable):
    # v^2 = g r/3 of a thin disk (Neimark and Fufaev).
    rate = -part * math.sqrt(9.81 / 3)
    model = lagsim.load(MODELS / "rolling-disk.yaml")
    model = model.bind(theta="pi/2", psi_dot=rate)
    found = lagsim.modes(model, at="start")
    assert all(mode["stable"] for mode in found.modes) is stable


@pytest.mark.slow
def test_the_benchmark_bicycle():
    model = lagsim.load(MODELS / "bicycle.yaml").bind(v=5, lean_dot=0)
    found = lagsim.modes(model, at="start")
    # J. P. Meijaard et al., Proc. R. Soc. A 463 (2007), table 2.
    expected = [
        -0.322866429004087,
        -0.775341882195845 + 4.464867713788229j,
        -14.078389692798265,
    ]
    assert eigenvalues(found) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"theta": 0.3}, "theta_ddot = "),
        ({"theta": 0, "theta_dot": 1}, "theta_dot = 1"),
    ],
)
def test_a_start_that_moves_is_refused(change, name):
    with refused("no-rest", name):
        lagsim.modes(lagsim.load(HOOP).bind(**change), at="start")


@pytest.mark.slow
def test_a_model_without_rest_is_refused():
    text = OSCILLATOR.replace("k*x^2/2", "-k*x")
    with refused("no-rest", "x_ddot = "):
        lagsim.modes(text)


# --- Inputs and outputs


def test_an_absorber_holds_its_mass_at_one_frequency():
    own = math.sqrt(9 / 0.3) / (2 * math.pi)
    found = lagsim.modes(ABSORBER)
    space = found.matrices(["x"], ["x", "y"])
    x, y = space.response([own])[0, :, 0]
    assert abs(x) < 1e-14
    assert y == pytest.approx(-1 / 9, rel=1e-12)


@pytest.mark.parametrize("damping", [0.02, 0.2, 0.4])
def test_a_peak_of_the_response_is_exact(damping):
    model = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 9*x^2/2, dissipation: 3*{damping}*x_dot^2}}
forces: {{x: 0*t}}
initial: {{x: 0}}
"""
    found = lagsim.modes(model, response=["x:x"]).response
    k = np.argmax(found["x:x.amplitude"])
    exact = 1 / (18 * damping * math.sqrt(1 - damping**2))
    # The error of the frequency, 1e-5 of it, enters with its square over the damping's.
    assert found["x:x.amplitude"][k] == pytest.approx(exact, rel=1e-6)
    exact = 3 * math.sqrt(1 - 2 * damping**2) / (2 * math.pi)
    assert found["frequency"][k] == pytest.approx(exact, rel=1e-5)


def test_a_valley_of_the_response_is_at_the_frequency_of_the_absorber():
    found = lagsim.modes(ABSORBER, response=["x:x"]).response
    f, amplitude = found["frequency"], found["x:x.amplitude"]
    inner = (amplitude[1:-1] < amplitude[:-2]) & (amplitude[1:-1] < amplitude[2:])
    [valley] = np.flatnonzero(inner) + 1
    exact = math.sqrt(9 / 0.3) / (2 * math.pi)
    assert f[valley] == pytest.approx(exact, rel=1e-5)


def test_the_ground_is_an_input_with_two_rates():
    found = lagsim.modes(GROUND, response=["ground:x", "ground:x_ddot"])
    f = found.response["frequency"]
    s = 2j * math.pi * f
    H = (70 + 2 * s) / (3 * s**2 + 2 * s + 70)
    amplitude = found.response["ground:x.amplitude"]
    phase = np.radians(found.response["ground:x.phase"])
    assert amplitude * np.exp(1j * phase) == pytest.approx(H, rel=1e-10)
    other = found.response["ground:x_ddot.amplitude"]
    assert other == pytest.approx(np.abs(s**2 * H), rel=1e-10)
    space = found.matrices(["ground"], ["x", "lambda_ground"])
    assert space.inputs == ("ground", "ground'", "ground''")
    assert space.states == ("x", "x_dot")
    # The force that moves the ground: lambda accelerates b by 1 and pulls the spring.
    [row] = space.response(f[:1])[0, 1:]
    expected = s[0] ** 2 + (70 + 2 * s[0]) * (1 - H[0])
    assert row[0] == pytest.approx(expected, rel=1e-9)


def test_a_parameter_is_an_input_with_those_that_follow_it():
    text = OSCILLATOR.replace("c: 3}", "c: 3, a: 2, F: 3*a}")
    text = text.replace("{x: 0}", "{x: F + a}")
    space = lagsim.modes(text).matrices(["a"], ["x"])
    assert space.response([0.0])[0, 0, 0] == pytest.approx(4 / 50, rel=1e-9)
    assert space.inputs == ("a",)


def test_a_parameter_of_a_constraint_enters_with_its_rates():
    text = GROUND.replace("b = 0", "b = u").replace("{m: 3", "{u: 0, m: 3")
    found = lagsim.modes(text)
    by_name = found.matrices(["u"], ["x", "b"])
    by_side = found.matrices(["ground"], ["x", "b"])
    assert by_name.inputs == ("u", "u'", "u''")
    for one, other in zip(by_name[:4], by_side[:4], strict=True):
        assert one == pytest.approx(other, abs=1e-10)


def test_matrices_reproduce_the_response():
    response = ["x:x", "x:y_dot", "ka:y"]
    model = lagsim.load(ABSORBER).bind(ca=0.4)
    found = lagsim.modes(model, response=response, frequencies=(0.1, 5))
    space = found.matrices(["x", "ka"], ["x", "y_dot", "y"])
    f = found.response["frequency"]
    assert f[0] == pytest.approx(0.1)
    assert f[-1] == pytest.approx(5)
    for name, i, j in (("x:x", 0, 0), ("x:y_dot", 1, 0), ("ka:y", 2, 1)):
        for k in range(0, len(f), 97):
            s = 2j * math.pi * f[k]
            H = space.C @ np.linalg.solve(s * np.eye(4) - space.A, space.B) + space.D
            assert found.response[f"{name}.amplitude"][k] == pytest.approx(
                abs(H[i, j]), rel=1e-10, abs=1e-14
            )


@pytest.mark.slow
def test_a_shipped_building_and_absorber():
    building = lagsim.load(MODELS / "shear-building.yaml").bind(c=0)
    found = lagsim.modes(building, response=["ground:u.5"])
    j = np.arange(1, 6)
    expected = 2 * math.sqrt(1000) * np.sin((2 * j - 1) * math.pi / 22)
    assert rates(found) == pytest.approx(expected, rel=1e-10)
    # A slow ground carries the whole building.
    assert found.response["ground:u.5.amplitude"][0] == pytest.approx(1, rel=0.02)
    absorber = lagsim.modes(MODELS / "vibration-absorber.yaml")
    x, y = absorber.matrices(["x"], ["x", "y"]).response([2.5 / math.pi])[0, :, 0]
    assert abs(x) < 1e-14
    assert y == pytest.approx(-1 / 10, rel=1e-10)


def test_default_matrices_are_of_all_forces_and_of_the_whole_state():
    space = lagsim.modes(ABSORBER).matrices()
    assert space.inputs == ("x",)
    assert space.states == space.outputs == ("x", "y", "x_dot", "y_dot")
    assert space.B.ravel() == pytest.approx([0, 0, 1 / 2, 0])
    assert np.array_equal(space.C, np.eye(4))


@pytest.mark.slow
def test_a_small_run_is_a_superposition_of_modes():
    ratios = []
    for size in (1e-2, 1e-3):
        model = lagsim.load(HOOP + "simulation: {duration: 2, output_step: 0.1}\n")
        angle = math.acos(9.81 / (0.8 * 25))
        model = model.bind(theta=angle + size)
        run = simulate(model)
        rate = 5 * math.sin(angle)
        linear = angle + size * np.cos(rate * run.t)
        ratios.append(np.max(np.abs(run["theta"] - linear)) / size)
    assert ratios[0] < 0.1
    assert ratios[1] == pytest.approx(ratios[0] / 10, rel=0.1)


def test_contacts_that_hold_are_constraints():
    text = """
parameters: {m: 2, k: 50, g: 9.81}
coordinates: {x: {}, y: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: k*x^2/2 + m*g*y}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
initial: {x: 0.1, y: 0}
"""
    found = lagsim.modes(text)
    assert rates(found) == pytest.approx([5], rel=1e-12)
    assert found.zero == 0


def test_friction_that_sticks_holds():
    text = """
parameters: {m: 2, k: 50, g: 9.81}
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2 + z_dot^2)/2, potential: k*(x^2 + z^2)/2 + m*g*y}
constraints:
  floor: {relation: y >= 0, restitution: 0, friction: 0.5, slip: x_dot}
initial: {x: 0.1, y: 0, z: 0}
"""
    found = lagsim.modes(text)
    assert found.about["x"] == pytest.approx(0.1)
    assert rates(found) == pytest.approx([5], rel=1e-12)
    assert found.modes[0]["shape"]["x"] == [0, 0]


def test_a_moving_constraint_stands_still_at_the_start():
    text = GROUND.replace("b = 0", "b = 0.2*cos(3*t)").replace("b: 0}", "b: 0.2}")
    found = lagsim.modes(text)
    assert found.about["x"] == pytest.approx(0.2)
    assert found.about["b_dot"] == 0
    assert rates(found) == pytest.approx([math.sqrt(70 / 3)])
    assert found.warnings[0]["code"] == "frozen-time"


def test_a_name_that_is_no_input_is_refused():
    with refused("unknown-name", "`z`"):
        lagsim.modes(ABSORBER, response=["z:x"])
    with refused("unknown-name", "`y_dit`", "`y_dot`"):
        lagsim.modes(ABSORBER, response=["x:y_dit"])


def test_a_parameter_without_an_effect_is_named():
    # At t = 0 the force F sin(w t) is 0, whatever F is.
    path = str(MODELS / "vibration-absorber.yaml")
    found = lagsim.modes(path, response=["F:x", "x:x"])
    [one] = [x for x in found.warnings if x["code"] == "no-response"]
    assert "`F`" in one["text"]
    assert "inputs: x" in one["text"]
    assert not np.any(found.response["F:x.amplitude"])
    assert np.all(found.response["x:x.amplitude"] > 0)


@pytest.mark.parametrize(("speed", "stiffness"), [(7, 50), (20, -50)])
def test_a_rotor_whirls_backward_and_forward(speed, stiffness):
    """Id w^2 -+ Ip speed w - k = 0; with k < 0 it is held by the rotation alone."""
    text = f"""
parameters: {{Id: 2, Ip: 3, speed: {speed}, k: {stiffness}}}
coordinates: {{a: {{}}, b: {{}}}}
energy:
  kinetic: Id*(a_dot^2 + b_dot^2)/2 + Ip*speed*(a_dot*b - b_dot*a)/2
  potential: k*(a^2 + b^2)/2
initial: {{a: 0, b: 0}}
"""
    found = lagsim.modes(text)
    half = 3 * speed / 4
    root = math.sqrt(half**2 + stiffness / 2)
    exact = np.array([abs(root - half), root + half]) / (2 * math.pi)
    assert [x["frequency"] for x in found.modes] == pytest.approx(exact, rel=1e-9)
    for mode in found.modes:  # circles
        a, b = (complex(*mode["shape"][name]) for name in ("a", "b"))
        assert abs(b / a) == pytest.approx(1, abs=1e-8)
        assert abs((b / a).real) < 1e-8


def test_a_beam_of_lumped_masses():
    """Pinned at both ends: w_j = 4 sin(j pi/(2 (n + 1)))^2 sqrt(EI/(m h^3))."""
    n, h = 8, 2 / 9
    text = """
parameters: {n: 8, EI: 3, m: 0.4, h: 2/(n + 1)}
coordinates: {w(1..n): {}}
definitions:
  v(0): 0
  v(i=1..n): w(i)
  v(n+1): 0
energy:
  kinetic: sum(i=1..n, m*w_dot(i)^2/2)
  potential: EI/(2*h^3)*sum(i=1..n, (v(i-1) - 2*v(i) + v(i+1))^2)
initial: {w(1..n): 0}
"""
    found = lagsim.modes(text).modes
    assert len(found) == n
    places = np.arange(1, n + 1)
    for j, mode in enumerate(found, 1):
        part = math.sin(j * math.pi / (2 * (n + 1)))
        exact = 4 * part**2 * math.sqrt(3 / (0.4 * h**3)) / (2 * math.pi)
        assert mode["frequency"] == pytest.approx(exact, rel=1e-9)
        shape = np.array([mode["shape"][f"w.{i}"][0] for i in places])
        sine = np.sin(j * math.pi * places / (n + 1))
        across = shape - sine * (shape @ sine) / (sine @ sine)
        assert np.max(np.abs(across)) < 1e-7


@pytest.mark.slow
def test_labels_of_peaks_of_several_curves_do_not_overlap():
    # Two modes of 1 and 1.6 Hz; the peaks near 1.6 Hz differ by 1 %.
    f = np.geomspace(0.1, 10, 4001)
    peaks = {"a": (1.0, 1.6, 1.0), "b": (1.0, 1.616, 0.6), "c": (1.0, 1.584, 0.8)}
    pairs = {
        f"F:{name}": k / (p**2 - f**2 + 0.02j * f) + k / (q**2 - f**2 + 0.02j * f)
        for name, (p, q, k) in peaks.items()
    }
    picture = _bode("bodies", FrequencyResponse(f, pairs), [])
    encoded_figure(picture)
    texts = [text for text in picture.axes[0].texts if text.get_text()]
    said = [text.get_text() for text in texts]
    assert said.count("1 Hz") == 1
    high = sorted(x for text in said if (x := float(text.split()[0])) > 1.5)
    assert high == pytest.approx([1.584, 1.6, 1.616], abs=2e-3)  # a step of f
    boxes = [text.get_window_extent() for text in texts]
    for one, other in itertools.combinations(boxes, 2):
        assert not one.padded(-1).overlaps(other.padded(-1))
