"""The motion on a page: points, rates, forces of constraints, looks of links."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

import lagsim
from lagsim.notes import Event
from lagsim.outputs import animation
from lagsim.outputs.animation import ROOM, Film, Track
from lagsim.outputs.figure import PENS
from tests.support import MODELS

# Numbers of a page have 24 bits.
ROUNDED = 2.0**-23

PENDULUM = """\
parameters: {L: 2, m: 3, g: 9.8}
coordinates: {x: {unit: m}, y: {unit: m}}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*g*y}
constraints: {rod: x^2 + y^2 = L^2}
initial: {x: L, y: 0}
simulation: {duration: 2, output_step: 0.05}
scene: {points: {pivot: [0, 0], bob: [x, y]}, links: [[pivot, bob]]}
"""
# The same in its angle: the rod's force is a reaction, asked for.
SWINGING = """\
parameters: {L: 2, m: 3, g: 9.8}
coordinates: {theta: }
definitions: {x: L*sin(theta), y: -L*cos(theta)}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*g*y}
initial: {theta: pi/2}
simulation: {duration: 2, output_step: 0.05}
scene: {points: {pivot: [0, 0], bob: [x, y]}, links: [[pivot, bob]]}
output: {reactions: [x, y]}
"""
# Two masses over a pulley: each hangs on the same tension.
ATWOOD = """\
parameters: {m1: 1, m2: 2, g: 9.8}
coordinates: {y1: , y2: }
energy: {kinetic: m1*y1_dot^2/2 + m2*y2_dot^2/2, potential: m1*g*y1 + m2*g*y2}
constraints: {rope: y1 + y2 = 0}
initial: {y1: 0, y2: 0}
simulation: {duration: 1, output_step: 0.1}
scene: {points: {one: [0, y1], other: [1, y2]}}
"""
# Two masses on a rod, thrown: the rod pulls both, with one force, to each other.
DUMBBELL = """\
parameters: {l: 1}
coordinates: {x1: , y1: , x2: , y2: }
energy: {kinetic: (x1_dot^2 + y1_dot^2 + x2_dot^2 + y2_dot^2)/2, potential: 0}
constraints: {rod: (x2 - x1)^2 + (y2 - y1)^2 = l^2}
initial: {x1: -l/2, y1: 0, x2: l/2, y2: 0, y1_dot: -1, y2_dot: 1, x1_dot: 3, x2_dot: 3}
simulation: {duration: 2, output_step: 0.05}
scene: {points: {a: [x1, y1], b: [x2, y2]}, links: [[a, b]]}
"""
SLIDE = """\
parameters: {m: 2, g: 9.8, mu: 0.25}
coordinates: {x: , y: }
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*g*y}
constraints: {floor: {relation: y >= 0, restitution: 0, friction: mu, slip: x_dot}}
initial: {x: 0, y: 0, x_dot: 10}
simulation: {duration: 1, output_step: 0.1}
scene: {points: {box: [x, y]}}
"""
STOP = """\
coordinates: {theta: }
energy: {kinetic: theta_dot^2/2, potential: -9.8*cos(theta)}
constraints: {stop: {relation: theta >= -0.5, restitution: 0.8}}
initial: {theta: 1}
simulation: {duration: 3, output_step: 0.05}
scene: {points: {bob: [sin(theta), -cos(theta)]}}
"""
BARE = """\
parameters: {w: 2}
coordinates: {a: }
definitions: {x: cos(a), y: sin(a), z: a}
energy: {kinetic: a_dot^2/2, potential: 0}
initial: {a: 0, a_dot: w}
simulation: {duration: 3, output_step: 0.5}
"""


def filmed(text, **options):
    """Return the film of a model, and its result."""
    result = lagsim.simulate(lagsim.load(text), error_bar="never", **options)
    made = result._attempt
    equations = made.session.case.equations
    frames = animation.frames_of(equations, made.session.system.columns.names)
    frames.add(result._rows)
    return animation.film(equations, frames, result.events), result


def test_points_and_their_rates():
    film, _ = filmed(BARE)
    angle, still = 2 * film.t, 0 * film.t
    place, rate = film.tracks["point"]
    # Helix: x = cos 2t, y = sin 2t, z = 2t; to the run's tolerance.
    expected = np.stack((np.cos(angle), np.sin(angle), angle), 1)
    assert np.allclose(place, expected, atol=1e-9)
    expected = np.stack((-2 * np.sin(angle), 2 * np.cos(angle), still + 2), 1)
    assert np.allclose(rate, expected, atol=1e-9)


def pull(result):
    """m v^2 = -2 m g y from rest at the pivot's height: the tension is 3 m g |y|/L."""
    x, y = result["x"], result["y"]
    return (-3 * 3 * 9.8 * np.abs(y) / 2 * np.stack((x, y)) / 2).T


def towards(result):
    """Each mass goes round at 1 on a circle of 1/2: a pull of 2 towards the other."""
    return 2 * np.stack((result["x2"] - result["x1"], result["y2"] - result["y1"]), 1)


def constant(*force):
    return lambda _: force


ROPE = constant(0, 2 * 1 * 2 / (1 + 2) * 9.8)
# Constraint and point; the force, and how near it is.
FORCES = {
    "rod": (PENDULUM, {("rod", "bob"): (pull, 1e-7)}),
    "reaction": (SWINGING, {("reaction", "bob"): (pull, 1e-7)}),
    "rope": (ATWOOD, {("rope", p): (ROPE, 1e-9) for p in ("one", "other")}),
    "rod of two": (DUMBBELL, {
        ("rod", "a"): (towards, 1e-8), ("rod", "b"): (lambda r: -towards(r), 1e-8),
    }),
    "contact": (SLIDE, {("floor", "box"): (constant(-0.25 * 19.6, 19.6), 1e-9)}),
    # A torque is no force on a point.
    "torque": (STOP, {}),
}  # fmt: skip


@pytest.mark.parametrize("name", FORCES)
def test_forces_on_points(name):
    text, wanted = FORCES[name]
    film, result = filmed(text)
    found = {(push.constraint, push.point): push.force for push in film.pushes}
    assert found.keys() == wanted.keys()
    for key, (force, near) in wanted.items():
        assert np.allclose(found[key], force(result), atol=near)
    if name == "torque":
        assert film.struck == {"stop": ("bob",)}
        assert any(e.kind == "impact" for e in film.events)


@pytest.mark.slow
def test_forces_do_the_work_of_the_constraint():
    """J^T F = Qc in every row, for the constraints of a mechanism of the notes."""
    path = MODELS / "elastic-pendulum-curve.yaml"
    film, result = filmed(path, duration=2)
    [F] = [push.force for push in film.pushes if push.constraint == "path"]
    theta, stretched = result["theta"], 1 + result["u"]
    along = np.stack((stretched * np.cos(theta), stretched * np.sin(theta)), 1)
    out = np.stack((np.sin(theta), -np.cos(theta)), 1)
    # The size of the terms, 100, times the rounding of a row.
    assert np.allclose((F * along).sum(1), result["Qc_theta"], atol=1e-11)
    assert np.allclose((F * out).sum(1), result["Qc_u"], atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "kind"),
    [
        (PENDULUM, "rod"),
        (MODELS / "elastic-pendulum.yaml", "spring"),
        (MODELS / "slack-string.yaml", "string"),
    ],
    ids=["rod", "spring", "string"],
)
def test_what_links_are_like(scene, kind):
    film, _ = filmed(scene)
    assert {link["kind"] for link in animation.record(film)["links"]} == {kind}


def test_nothing_to_draw():
    model = lagsim.load(PENDULUM.replace("scene", "x-scene").replace("x:", "u:"
        ).replace("x_dot", "u_dot").replace("x^2", "u^2"))  # fmt: skip
    [caution] = animation.nothing_to_draw(model)
    assert caution.code == "nothing-to-draw"
    assert animation.nothing_to_draw(lagsim.load(PENDULUM)) == []
    assert animation.nothing_to_draw(lagsim.load(BARE)) == []


def numbers(text, kind="<f4"):
    return np.frombuffer(base64.b64decode(text), kind)


def paged(film, title="a title"):
    return animation.page([animation.record(film)], title).decode()


@pytest.mark.slow
def test_a_page_holds_its_film_and_asks_for_nothing():
    film, result = filmed(PENDULUM)
    content = paged(film)
    [run] = animation.recorded(content)
    assert np.array_equal(numbers(run["t"], "<f8"), result.t)
    assert run["points"][0] == {"name": "pivot", "fixed": [0.0, 0.0]}
    bob = numbers(run["points"][1]["place"]).reshape(-1, 2)
    expected = np.stack((result["x"], result["y"]), 1)
    assert np.allclose(bob, expected, rtol=ROUNDED, atol=0)
    energy = numbers(run["energies"]["kinetic"])
    assert np.allclose(energy, result["kinetic"], rtol=ROUNDED, atol=0)
    for word in ("http:", "https:", "src=", "import(", "fetch(", "url("):
        assert word not in content
    assert "default-src 'none'" in content


def test_what_diverges_can_be_shown():
    """Places and energies without a number, or with more than 32 bits take."""
    t = np.array([0.0, 1.0, 2.0])
    place = np.array([[0.0, 0.0], [1e300, 1.0], [np.nan, np.inf]])
    tracks = {"p": Track(place, place), "q": Track(place * np.nan, place)}
    film = Film(
        "far", "", t, np.zeros(3, bool), tracks, [("p", "q")],
        energies={"energy": place[:, 0]}, events=[Event(1.0, "impact")] * 5000,
    )  # fmt: skip
    [shown] = animation.recorded(paged(film))
    assert shown["box"] == [[0.0, 1e300], [0.0, 1.0]]
    assert len(shown["events"]) < 5000
    assert "of 5000 events" in shown["notes"][0]
    nowhere = film._replace(tracks={"q": tracks["q"]}, links=())
    assert animation.record(nowhere)["box"] == [[0.0, 0.0], [0.0, 0.0]]


def test_no_text_of_a_model_ends_up_in_the_page():
    evil = "</script><script>alert(1)</script><!--"
    film, _ = filmed(PENDULUM + f"description: '{evil}'\n")
    content = paged(film, evil)
    assert "alert" in content
    assert "<script>alert" not in content
    assert animation.recorded(content)[0]["description"] == evil


def test_what_is_no_page_holds_no_film():
    assert animation.recorded("<html></html>") is None
    broken = '<script type="application/json" id="runs">[</script>'
    assert animation.recorded(broken) is None


@pytest.mark.parametrize(
    ("points", "rows"),
    [(1, 200_000), pytest.param(300, 20_000, marks=pytest.mark.slow)],
)
def test_a_page_has_a_bound(points, rows):
    """Neither rows nor points make a page larger than the room for its numbers."""
    many = ", ".join(f"p{k}: [cos(q + {k}), sin(q), q]" for k in range(points))
    text = f"""\
coordinates: {{q: }}
energy: {{kinetic: q_dot^2/2, potential: 0}}
initial: {{q: 0, q_dot: 1}}
simulation: {{duration: 1, output_step: 0.1}}
scene: {{points: {{{many}}}}}
"""
    made = lagsim.simulate(lagsim.load(text), error_bar="never")._attempt
    columns = made.session.system.columns.names
    equations = made.session.case.equations
    frames = animation.frames_of(equations, columns)
    table = np.zeros((rows, len(columns)))
    for name, values in (("t", 1.0), ("q", 1.0)):
        table[:, columns.index(name)] = np.linspace(0.0, values, rows)
    frames.add(table)
    run = animation.record(animation.film(equations, frames, ()))
    size = len(json.dumps(run))
    # Base64 takes a third more; names and the rest of a point a few bytes.
    assert ROOM / 4 < size < 4 / 3 * ROOM + 100 * points + 2000
    assert any("one of" in note for note in run["notes"])


def test_energies_have_the_colours_of_their_picture():
    style = (Path(animation.__file__).parent / "page.css").read_text("utf-8")
    light = style.partition("}")[0]
    for name, pen in zip(("kinetic", "potential"), PENS, strict=False):
        assert f"--{name}: {pen['color'].lower()};" in light


def test_of_too_many_events_rare_ones_are_marked():
    film, _ = filmed(STOP)
    often = [Event(k * 5e-4, "event", name="sample") for k in range(6000)]
    rare = [Event(2.99, "event", name="late"), Event(0.5, "impact", "stop")]
    # The sample at the time of the impact is not marked.
    film = film._replace(events=sorted([*often, *rare], key=lambda e: e.time))
    shown = animation.record(film)
    marked = [(e["t"], e["what"]) for e in shown["events"]]
    assert marked == sorted(marked)
    assert len(marked) == animation.MOST_EVENTS
    assert {(2.99, "late"), (0.5, "stop")} < set(marked)
    times = [t for t, what in marked if what == "sample"]
    assert (times[0], times[-1]) == (0.0, 5999 * 5e-4)
    assert max(np.diff(times)) < 3.5 * 5e-4  # two intervals, three at the impact
    assert any("4000 of 6001 events" in note for note in shown["notes"])
