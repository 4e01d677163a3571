"""Frames and bodies: their expansion, and their possible faults."""

import math
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lagsim.language.evaluate import evaluate
from tests.model import test_faults as faults
from tests.model._files import model

RNG = np.random.default_rng(4)
LETTERS = "xyz"


def definitions(text, **values):
    """Evaluate the definitions of a file, as vectors where they have components."""
    found = model(text)
    numbers = {p.name: p.value for p in found.parameters} | values
    rows = evaluate(found.graph, [d.node for d in found.definitions], numbers)
    vectors: dict[str, list[float]] = {}
    for d, row in zip(found.definitions, rows, strict=True):
        vectors.setdefault(d.name.partition(".")[0], []).append(row)
    return {name: np.array(row) for name, row in vectors.items()}


def spinning(turned, q, speeds):
    """Return R and its angular velocity in the frame by differences."""
    h = 1e-5
    R = turned(q)
    ahead, behind = (turned(q + sign * h * speeds) for sign in (1, -1))
    W = R.T @ (ahead - behind) / (2 * h)
    return R, np.array([W[2, 1], W[0, 2], W[1, 0]])


def check_frame(frames, coordinates, turned):
    """Compare a frame `f` with a matrix (3, 3) as a function of the coordinates."""
    names = [f"q{k}" for k in range(coordinates)]
    text = f"""
parameters: {{v: [0.3, -1.2, 0.7]}}
coordinates: {{{", ".join(f"{name}: {{}}" for name in names)}}}
frames: {{{frames}}}
definitions:
  {{u: 'rotate(f, v)', back: 'unrotate(f, v)', w: omega(f), W: omega_space(f)}}
energy: {{kinetic: {" + ".join(f"{name}_dot^2" for name in names)}, potential: 0}}
initial: {{{", ".join(f"{name}: 1" for name in names)}}}
"""
    q, speeds = RNG.normal(size=(2, coordinates))
    values = dict(zip(names, q, strict=True))
    values |= {f"{n}_dot": x for n, x in zip(names, speeds, strict=True)}
    found = definitions(text, **values)
    R, w = spinning(turned, q, speeds)
    v = np.array([0.3, -1.2, 0.7])
    np.testing.assert_allclose(found["u"], R @ v, atol=1e-13)
    np.testing.assert_allclose(found["back"], R.T @ v, atol=1e-13)
    np.testing.assert_allclose(found["w"], w, atol=1e-8)
    np.testing.assert_allclose(found["W"], R @ w, atol=1e-8)


SEQUENCES = ["".join(s) for s in product(LETTERS, repeat=3)]
SEQUENCES = [s for s in SEQUENCES if s[0] != s[1] != s[2]]


@pytest.mark.parametrize("axes", SEQUENCES)
def test_angles_turn_about_the_frames_own_axes(axes):
    def turned(q):
        return Rotation.from_euler(axes.upper(), q).as_matrix()

    check_frame(f"f: {{angles: [q0, q1, q2], axes: {axes}}}", 3, turned)


def test_a_quaternion_of_any_length_turns():
    def turned(p):
        return Rotation.from_quat(p, scalar_first=True).as_matrix()

    check_frame("f: {quaternion: [q0, q1, q2, q3]}", 4, turned)


@pytest.mark.parametrize(
    ("axis", "direction"),
    [
        ("[1, 2, -2]", (1, 2, -2)),
        ("[0, -3, 0]", (0, -1, 0)),
        ("[0, v.y - v.y, v.x]", (0, 0, 1)),
        ("v", (0.3, -1.2, 0.7)),
    ],
)
def test_frames_are_composed(axis, direction):
    n = np.array(direction) / np.linalg.norm(direction)

    def turned(q):
        own = Rotation.from_rotvec((2 * q[1] - q[0]) * n)
        first = Rotation.from_euler("ZX", q[1:])
        last = Rotation.from_rotvec([0, 0.4, 0])
        return (first * own * last).as_matrix()

    frames = f"""
  a: {{angles: [q1, q2], axes: zx}}, same: a,
  g: {{on: same, axis: {axis}, angle: 2*q1 - q0}},
  f: {{on: g, axis: [0, 1, 0], angle: 0.4}}"""
    check_frame(frames, 3, turned)


def test_frames_of_the_plane_and_of_a_family():
    text = """
parameters: {n: 3}
coordinates: {q(1..n): {}}
frames: {arm(0): space, arm(i = 1..n): {on: arm(i-1), angle: i*q(i)}}
definitions:
  u: rotate(arm(3), vec(2, 1))
  back: unrotate(arm(2), vec(2, 1))
  still: rotate(arm(0), vec(2, 1))
  w: omega(arm(3))
  W: omega_space(arm(2))
  T: spin(5, omega(arm(2)))
energy: {kinetic: 'sum(i = 1..n, q_dot(i)^2)', potential: 0}
initial: {q(1..n): 0}
"""
    q, speeds = np.array([0.3, -0.7, 0.2]), np.array([1.1, 0.4, -0.6])
    values = {f"q.{k}": x for k, x in enumerate(q, 1)}
    values |= {f"q_dot.{k}": x for k, x in enumerate(speeds, 1)}
    found = definitions(text, **values)
    a, b = q @ [1, 2, 3], q @ [1, 2, 0]
    c, s = math.cos(a), math.sin(a)
    np.testing.assert_allclose(found["u"], [2 * c - s, 2 * s + c], rtol=1e-14)
    c, s = math.cos(b), math.sin(b)
    np.testing.assert_allclose(found["back"], [2 * c + s, c - 2 * s], rtol=1e-14)
    assert found["still"].tolist() == [2, 1]
    assert found["w"][0] == pytest.approx(speeds @ [1, 2, 3], rel=1e-14)
    rate = speeds @ [1, 2, 0]
    assert found["W"][0] == pytest.approx(rate, rel=1e-14)
    assert found["T"][0] == pytest.approx(2.5 * rate**2, rel=1e-14)


@pytest.mark.parametrize(
    ("given", "matrix"),
    [
        ("3", 3 * np.eye(3)),
        ("J", np.diag([1, 2, 3])),
        ("K", np.array([[5, 0.1, 0.2], [0.1, 6, 0.3], [0.2, 0.3, 7]])),
    ],
)
def test_spin_takes_one_three_or_six_moments(given, matrix):
    w = np.array([0.4, -0.5, 0.9])
    text = f"""
parameters: {{J: [1, 2, 3], K: [5, 6, 7, 0.1, 0.2, 0.3], w: [0.4, -0.5, 0.9]}}
definitions: {{T: 'spin({given}, w)'}}
"""
    assert definitions(text)["T"][0] == pytest.approx(w @ matrix @ w / 2, rel=1e-14)


def of_disks(radius, low, high):
    """Inertia (3,) of a solid of disks along z, mass 1, by 20 points; its centre."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    z = (high + low) / 2 + (high - low) / 2 * nodes
    r = radius(z)
    m = weights * r**2 / np.sum(weights * r**2)
    centre = m @ z
    across = m @ (r**2 / 4 + (z - centre) ** 2)
    return np.array([across, across, m @ r**2 / 2]), centre


BALL = of_disks(lambda z: np.sqrt(0.49 - z**2), -0.7, 0.7)[0]
SOLIDS = [
    ("sphere: 0.7", BALL),
    ("cylinder: [0.3, 2]", of_disks(lambda z: 0.3 + 0 * z, -1, 1)[0]),
    ("cone: [0.3, 2]", of_disks(lambda z: 0.15 * z, 0, 2)[0]),
    ("disk: 0.3", of_disks(lambda z: 0.3 + 0 * z, -1e-9, 1e-9)[0]),
    ("ring: 0.3", np.array([0.045, 0.045, 0.09])),  # every part at 0.3 from the axis
    ("box: [1, 2, 3]", np.array([13 / 12, 10 / 12, 5 / 12])),
]


@pytest.mark.parametrize(("shape", "moments"), SOLIDS)
def test_inertia_of_a_shape_in_space(shape, moments):
    frame = "f: {quaternion: [p, q, r, s]}"
    text = f"""
coordinates: {{x: {{}}, p: {{}}, q: {{}}, r: {{}}, s: {{}}}}
frames: {{{frame}}}
bodies: {{b: {{mass: 3, at: [x, 0, 0], frame: f, shape: {{{shape}}}}}}}
energy: {{kinetic: bodies, potential: 0}}
initial: {{x: 0, p: 1, q: 0, r: 0, s: 0}}
"""
    found = model(text)
    for k, name in enumerate("qrs"):
        state = dict.fromkeys(["p", f"{name}_dot"], 1.0)
        names = found.graph.depends([found.kinetic])
        values = dict.fromkeys(names, 0.0) | state
        (T,) = evaluate(found.graph, [found.kinetic], values)
        assert pytest.approx(3 * moments[k] * 2, rel=1e-13) == T  # w = 2 p_dot


CORNERS = np.array([[0, 0], [2, 0], [2, 1], [1, 3], [-0.5, 1]])


def of_triangles(corners):
    """Inertia of a polygon of mass 1 about its centre, from triangles."""
    sides = [(corners[0], *pair) for pair in pairwise(corners[1:])]
    areas = np.array([np.linalg.det([b - a, c - a]) / 2 for a, b, c in sides])
    m = areas / areas.sum()
    centres = np.array([np.mean(side, axis=0) for side in sides])
    own = [
        sum(np.sum((p - q) ** 2) for p, q in ((a, b), (b, c), (c, a))) / 36
        for a, b, c in sides
    ]
    return m @ (own + np.sum((centres - m @ centres) ** 2, axis=1))


@pytest.mark.parametrize(
    ("shape", "moment"),
    [
        ("disk: 0.5", 0.125),
        ("ring: 0.5", 0.25),
        ("box: [1, 2]", 5 / 12),
        (f"polygon: {CORNERS.tolist()}", of_triangles(CORNERS)),
        (f"polygon: {CORNERS[::-1].tolist()}", of_triangles(CORNERS)),
        (f"polygon: {(CORNERS + 7).tolist()}", of_triangles(CORNERS)),
    ],
)
def test_inertia_of_a_shape_in_the_plane(shape, moment):
    text = f"""
coordinates: {{x: {{}}, a: {{}}}}
frames: {{f: {{angle: 3*a}}}}
bodies: {{b: {{mass: 2, at: [x, 4*x], frame: f, shape: {{{shape}}}}}}}
gravity: [1, -10]
energy: {{kinetic: bodies, potential: 2 + bodies}}
initial: {{x: 0, a: 0}}
"""
    found = model(text)
    values = {"x": 2.0, "a": 0.3, "x_dot": 1.5, "a_dot": 0.7}
    T, V = evaluate(found.graph, [found.kinetic, found.potential], values)
    assert pytest.approx(17 * 1.5**2 + 2 * moment * 2.1**2 / 2, rel=1e-12) == T
    assert pytest.approx(2 - 2 * (2 - 10 * 8), rel=1e-14) == V


def test_shapes_are_drawn_where_bodies_are():
    text = """
coordinates: {x: {}, q: {}}
frames: {f: {axis: [1, 0, 0], angle: q}, g(1..2): {on: f, axis: [0, 0, 1], angle: x}}
definitions: {G: [x, 1, 2]}
bodies:
  top: {mass: 3, at: G, frame: f, shape: {cone: [0.3, 2]}}
  ball(i = 1..2): {mass: 1, at: i*G, shape: {sphere: i/10}}
energy: {kinetic: bodies, potential: 0}
initial: {x: 0, q: 0}
scene: {points: {o: [0, 0, 0]}, shapes: {wheel: {disk: 1, at: o, frame: g(2)}}}
"""
    found = model(text)
    values = {"x": 0.4, "q": 0.7}
    shapes = {shape.name: shape for shape in found.scene.shapes}
    at, axes, sizes = (
        {
            name: evaluate(found.graph, getattr(shape, what), values)
            for name, shape in shapes.items()
        }
        for what in ("at", "axes", "sizes")
    )
    assert list(shapes) == ["wheel", "top", "ball.1", "ball.2"]
    R = Rotation.from_euler("XZ", [0.7, 0.4])
    np.testing.assert_allclose(np.reshape(axes["wheel"], (3, 3)), R.as_matrix())
    R = Rotation.from_euler("X", 0.7)
    np.testing.assert_allclose(np.reshape(axes["top"], (3, 3)), R.as_matrix())
    # The tip lies three quarters of the height below the centre of mass.
    np.testing.assert_allclose(at["top"], [0.4, 1, 2] - R.apply([0, 0, 1.5]))
    assert at["ball.2"] == pytest.approx([0.8, 2, 4])
    assert (sizes["ball.2"], axes["ball.2"]) == ([0.2], [])


# See `test_faults`.
FAULTS = r"""
cycle | `a` is on itself: a -> b -> a |
    frames: {a: {on: ⟪b⟫, angle: x}, b: {on: a, angle: y}}
not-an-expression | names a frame | frames: {a: {on: ⟪[b]⟫, angle: x}}
expression-frame | `a` depends on itself |
    frames: {a: {angle: '⟪r⟫otate(a, vec(1, 2)).x'}}
velocity-not-allowed | depend on velocities |
    frames: {a: {angle: 2*x, on: b}, b: {angle: ⟪x_dot⟫}}
velocity-not-allowed | depend on accelerations |
    bodies: {b: {mass: 1, at: [x, ⟪y_ddot⟫]}}¶energy: {kinetic: bodies, potential: 0}
cycle | w -> frame.a.turn -> w | frames: {a: {angle: w}}¶definitions: {w: '⟪omega⟫(a)'}
reserved-name | `bodies` is the word |
    definitions: {⟪bodies⟫: 3}¶bodies: {b: {POINT}}¶ENERGY
cycle | `a` is on itself: a -> a | frames: {a: {on: ⟪a⟫, angle: x}}
out-of-range | has no direction | frames: {a: {axis: ⟪[0, 1 - 1, 0]⟫, angle: x}}
not-constant | `x` is none | frames: {a: {axis: [0, 0, ⟪x⟫], angle: x}}
not-constant | cannot follow a table: `k` |
    tables: {h: {points: [[0, 0], [2, 1]]}}¶parameters: {k: h(1)}¶
    frames: {a: {axis: [0, ⟪k⟫, 1], angle: x}}¶definitions: {w: omega(a)}
wrong-count | 3 components, found 2 | frames: {a: {axis: ⟪[0, 1]⟫, angle: x}}
wrong-count | 4 components, found 3 | frames: {a: {quaternion: ⟪[x, y, 1]⟫}}
wrong-count | 3 components, found 2 | frames: {a: {angles: ⟪[x, y]⟫, axes: zxz}}
unknown-name | letters x, y and z | frames: {a: {angles: [x, y], axes: ⟪zu⟫}}
unknown-name | none twice in a row | frames: {a: {angles: [x, y], axes: ⟪zz⟫}}
missing-key | `angles` but no `axes` | frames: {⟪a⟫: {angles: [x, y]}}
missing-key | `axis` but no `angle` | frames: {⟪a⟫: {axis: [0, 0, 1]}}
missing-key | has no rotation | frames: {⟪a⟫: {}}
missing-key | has no rotation | frames: {b: {angle: x}, ⟪a⟫: {on: b}}
missing-key | `angle` but no `axis` |
    frames: {⟪a⟫: {angle: x}, b: {axis: [0, 0, 1], angle: y}}
both-given | both `angles` and `quaternion` |
    frames: {⟪a⟫: {angles: [x], axes: x, quaternion: [1, 0, 0, 0]}}
unknown-key | did you mean `axis` | frames: {a: {⟪axs⟫: [0, 0, 1], angle: x}}
unknown-name | unknown name `z` | frames: {a: {angle: 2*⟪z⟫}}
reserved-name | `unit` is a function | frames: {⟪unit⟫: {angle: x}}
bad-name | `my frame` | frames: {⟪my frame⟫: {angle: x}}
duplicate-member | `space` is built in | frames: {⟪space⟫: {angle: x}}
duplicate-member | `a.2` is given twice |
    frames: {a(1..2): {angle: x}, ⟪a(2)⟫: {angle: y}}
expression-frame | did you mean `arm` |
    frames: {arm: {on: ⟪arn⟫, angle: x}, arms: {angle: x}}
expression-frame | the name of a frame | PLANE {w: 'omega(⟪2⟫)'}
expression-frame | there are `a.1` to `a.2` |
    frames: {a(1..2): {angle: x}}¶definitions: {w: 'omega(⟪a⟫(3))'}
expression-frame | the file has no `frames` | definitions: {u: 'rotate(⟪a⟫, vec(1, 2))'}
expression-arity | takes 2 arguments, found 1 | PLANE {w: '⟪rotate⟫(a)'}
expression-size | a vector of 2 in this frame, found a vector of 3 |
    PLANE {u: '⟪rotate⟫(a, vec(1, 2, 3))'}
expression-size | 1, 3 or 6 moments |
    parameters: {J: [1, 2]}¶definitions: {u: '⟪spin⟫(J, vec(1, 2, 3))'}
expression-size | of 3 components, found a number |
    parameters: {J: [1, 2, 3]}¶definitions: {u: '⟪spin⟫(J, 2)'}
expression-syntax | write spin(vec(1, 2, 3), vec(x, y, 0)) |
    definitions: {u: 'spin(⟪[⟫1, 2, 3], vec(x, y, 0))'}
expression-syntax | J: [1, 2, 3, 0, 0, 1], and write spin(J, ...) |
    definitions: {u: 'spin(⟪[⟫1, 2, 3, 0, 0, 1], vec(x, y, 0))'}
missing-key | has no `mass` | bodies: {⟪b⟫: {at: [x, y]}}
missing-key | has no `at` | bodies: {⟪b⟫: {mass: 1}}
missing-key | has no `frame` | bodies: {⟪b⟫: {mass: 1, at: [x, y], inertia: 1}}
missing-key | no `inertia` or `shape` | TURNED {⟪b⟫: {mass: 1, at: [x, y], frame: f}}
unknown-key | did you mean `mass` | bodies: {b: {⟪mas⟫: 1, at: [x, y]}}
wrong-count | 2 or 3 components, found 1 | bodies: {b: {mass: 1, at: ⟪[x]⟫}}
wrong-count | must be a number | bodies: {b: {mass: '⟪vec(1, 2)⟫', at: [x, y]}}
wrong-count | has 3 components, and its frame has 2 |
    TURNED {b: {mass: 1, at: ⟪[x, y, 0]⟫, frame: f, inertia: 1}}
wrong-count | has 2 components, and `gravity` has 3 |
    gravity: [0, 0, 1]¶bodies: {b: {mass: 1, at: ⟪[x, y]⟫}}
wrong-count | 1 components, found 3 |
    TURNED {b: {POINT, frame: f, inertia: ⟪[1, 2, 3]⟫}}
wrong-count | 2 components, found 3 |
    TURNED {b: {POINT, frame: f, shape: {box: ⟪[1, 2, 3]⟫}}}
unknown-name | `sphere` in the plane |
    TURNED {b: {POINT, frame: f, shape: {⟪sphere⟫: 1}}}
unknown-name | did you mean `disk` | bodies: {b: {POINT, shape: {⟪dsk⟫: 1}}}
wrong-count | must be one, such as | bodies: {b: {POINT, shape: ⟪{disk: 1, ring: 2}⟫}}
wrong-count | 3 or more corners | bodies: {b: {POINT, shape: {polygon: ⟪[[0, 1]]⟫}}}
expression-frame | there is no frame `g` | TURNED {b: {POINT, frame: ⟪g⟫, inertia: 1}}
expression-frame | the file has no `frames` |
    bodies: {b: {POINT, frame: ⟪g⟫, inertia: 1}}
missing-key | needs `gravity` |
    bodies: {b: {mass: 1, at: [x, y]}}¶energy: {kinetic: bodies, potential: ⟪bodies⟫}
unknown-name | in a file with `bodies` | energy: {kinetic: ⟪bodies⟫, potential: 0}
unknown-name | unknown name `k` |
    bodies: {b: {mass: 2*⟪k⟫, at: [x, y]}}¶energy: {kinetic: bodies, potential: 0}
wrong-count | 2 or 3 components, found 4 | gravity: ⟪[0, 0, 0, 1]⟫
wrong-count | 2 or 3 components, found 1 |
    gravity: ⟪9.8⟫¶bodies: {b: {POINT}}¶energy: {kinetic: bodies, potential: bodies}
"""
SHORT = {
    "PLANE": "frames: {a: {angle: x}}¶definitions:",
    "TURNED": "frames: {f: {angle: x}}¶bodies:",
    "ENERGY": "energy: {kinetic: bodies, potential: 0}",
    "POINT": "mass: 1, at: [x, y]",
}
CASES = {row[2].replace("\n", "¶"): row for row in faults.table(FAULTS, SHORT)}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_faults_of_frames_and_bodies(case):
    faults.test_fault(case)
