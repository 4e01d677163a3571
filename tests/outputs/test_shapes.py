"""Shapes of scenes: where their corners lie, on paper and on the page."""

import json
from itertools import pairwise, product

import numpy as np
import pytest

import lagsim
from lagsim.outputs import animation, plots
from lagsim.outputs.animation import ROOM
from lagsim.outputs.shapes import projected
from tests.outputs import node as page
from tests.outputs.drawn import assert_legible, drawn, record
from tests.outputs.node import Screen, ends, fills, lines, near, needs_node
from tests.outputs.test_animation import filmed
from tests.support import refused

# A body that goes round (1, -2) at 3, and turns at 2.
PLANE = """\
parameters: {w: 0.4, h: 0.2}
coordinates: {a: {unit: rad}}
definitions: {x: {value: 1 + 3*cos(a), unit: m}, y: {value: -2 + 3*sin(a), unit: m}}
energy: {kinetic: a_dot^2/2, potential: 0}
initial: {a: 0, a_dot: 1}
simulation: {duration: 3, output_step: 0.1}
scene:
  points: {hub: [1, -2], rim: [x, y]}
  shapes: SHAPES
"""
SPACE = PLANE.replace("-2], rim: [x, y]", "-2, 0], rim: [x, y, a]")
BLOCK = "block: {box: [w, h], at: rim, frame: 2*a}"
CUBE = "cube: {box: [w, w, w], at: hub}"
OBLIQUE = np.array([(0.866, 0.5, 0.0), (-0.25, 0.433, 0.866)])


def filled(text, shapes):
    return text.replace("SHAPES", f"{{{shapes}}}")


def bodies(text, shapes):
    return filmed(filled(text, shapes))[0].shapes


def block(t, w=0.4, h=0.2):
    """Where the corners of the block are (4, 2)."""
    c, s = np.cos(2 * t), np.sin(2 * t)
    own = 0.5 * np.array([(-w, -h), (w, -h), (w, h), (-w, h)])
    return [1 + 3 * np.cos(t), -2 + 3 * np.sin(t)] + own @ np.array([(c, s), (-s, c)])


def sheet(text, shapes):
    """Draw the picture of a trajectory."""
    film, result = filmed(filled(text, shapes))
    names = result._attempt.session.system.columns.names
    rows = record(dict(zip(names, result._rows.T, strict=True)))
    model = result._attempt.session.case.equations.model
    return drawn(plots.trajectory, rows, ["a"], model.scene, model=model), film


# --- Bodies


def test_a_turned_box():
    [body] = bodies(PLANE, BLOCK)
    t = np.linspace(0, 3, 31)
    assert np.allclose(body.placed(range(31)), [block(x) for x in t], atol=1e-9)


def test_rows_of_a_rotation_matrix():
    turned = "[[0, 0, 1], [cos(a), -sin(a), 0], [sin(a), cos(a), 0]]"
    shapes = f"wheel: {{disk: 1, frame: {turned}}}, other: {{disk: 1, frame: a}}"
    wheel, other = bodies(SPACE, shapes)
    t = np.linspace(0, 3, 31)
    # The first corner, where the spoke ends: in the plane across x; across z.
    found = wheel.placed(range(31))[:, 0]
    assert np.allclose(found, np.stack((0 * t, np.cos(t), np.sin(t)), 1), atol=1e-9)
    found = other.placed(range(31))[:, 0]
    assert np.allclose(found, np.stack((np.cos(t), np.sin(t), 0 * t), 1), atol=1e-9)


# Volume of the polyhedron by Gauss's theorem; what is round has 32 sides.
SECTOR = 16 * np.sin(np.pi / 16)
VOLUMES = {
    "box: [0.4, 0.5, 0.6]": 0.4 * 0.5 * 0.6,
    "cylinder: [0.4, 0.5]": SECTOR * 0.16 * 0.5,
    "cone: [0.4, 0.6]": SECTOR * 0.16 * 0.6 / 3,
}


@pytest.mark.parametrize("shape", VOLUMES)
def test_faces_look_outwards_and_close_a_body(shape):
    [body] = bodies(SPACE, f"it: {{{shape}}}")
    [corners], faces, edges, seams = body[3:7]
    volume = 0.0
    for a, *others in faces:
        for b, c in pairwise(others):
            volume += np.linalg.det(corners[[a, b, c]]) / 6
    assert volume == pytest.approx(VOLUMES[shape], rel=1e-12)
    assert len(corners) - len(edges + seams) + len(faces) == 2  # Euler
    for i, j, a, b in edges + seams:
        assert {i, j} <= set(faces[a]) & set(faces[b])


def test_a_cone_stands_on_its_tip_and_a_cylinder_has_its_middle_there():
    cone, cylinder = bodies(SPACE, "a: {cone: [1, 2]}, b: {cylinder: [1, 2]}")
    [corners] = cone.corners
    assert set(corners[:, 2]) == {0.0, 2.0}
    assert corners[corners[:, 2] == 0].tolist() == [[0, 0, 0]]
    assert set(cylinder.corners[0, :, 2]) == {-1.0, 1.0}


def segments(path):
    """Return the pairs of corners (n, 2, 2) that a path joins."""
    pairs = np.stack((path[:-1], path[1:]), axis=1)
    return pairs[np.isfinite(pairs).all(axis=(1, 2))]


def test_edges_behind_are_hidden():
    cube, cylinder = bodies(SPACE, f"{CUBE}, c: {{cylinder: [1, 2]}}")
    found = projected(cube, 0, OBLIQUE)
    # Of a cube that shows a corner, three faces and nine edges are seen.
    assert (len(found.faces), len(segments(found.lines))) == (3, 9)
    far = OBLIQUE @ np.array([0.8, -1.8, -0.2])
    hidden = segments(found.hidden)
    assert len(hidden) == 3
    assert np.isclose(hidden, far, atol=1e-12).all(axis=2).any(axis=1).all()
    assert sum(turned**2 for _, turned in found.faces) == pytest.approx(1, abs=1e-3)
    # Of a cylinder a cap, half the rim of the other, and two lines along it.
    found = projected(cylinder, 0, OBLIQUE)
    assert len(segments(found.lines)) == 32 + 16 + 2
    assert len(segments(found.hidden)) == 16
    sides = segments(found.lines)[-2:]
    assert np.allclose(np.abs(sides[:, 0, 0]), 1, atol=0.01)


def test_the_equator_of_a_sphere_is_seen_in_front():
    [ball] = bodies(SPACE, "ball: {sphere: 0.5, at: hub}")
    found = projected(ball, 0, OBLIQUE)
    equator = segments(found.lines)[72:]  # after the outline
    assert len(equator) + len(segments(found.hidden)) == 72
    middle = (OBLIQUE @ np.array([1, -2, 0]))[1]
    assert equator[..., 1].mean() < middle < segments(found.hidden)[..., 1].mean()


def test_curves_stand_change_and_have_gaps():
    shapes = "e: {curve: [2*cos(s), sin(s)], s: [0, 2*pi]}, "
    shapes += "root: {curve: [s, sqrt(s)], s: [-1, 1]}, "
    shapes += "wave: {curve: [s, sin(s - t)], s: [0, 9]}"
    ellipse, root, wave = bodies(PLANE, shapes)
    x, y = ellipse.corners[0].T
    assert np.allclose((x / 2) ** 2 + y**2, 1)
    assert np.isnan(root.corners[0, :500, 1]).all()
    s, t = np.linspace(0, 9, 64), np.linspace(0, 3, 31)
    assert np.allclose(wave.corners[:, :, 1], np.sin(s - t[:, np.newaxis]))


def test_forces_and_grounds_that_move():
    shapes = "pull: {arrow: [0, -a_ddot - y_dot], at: rim, scale: 2}, "
    shapes += "table: {ground: [[0, y], [1, y]]}, none: {arrow: [Qc_a, 0]}"
    arrow, table, none = bodies(PLANE, shapes)
    assert not none.corners.any()  # without a constraint there is no column
    t = np.linspace(0, 3, 31)
    assert np.allclose(arrow.corners[:, 1, 1], -6 * np.cos(t), atol=1e-8)
    assert np.allclose(table.corners[:, 1, 1], -2 + 3 * np.sin(t), atol=1e-9)


def test_modes_move_shapes():
    text = PLANE + "modes: {up: 0}\nevents: {rise: {at: a >= 1.05, set: {up: 1}}}\n"
    [ring] = bodies(text, "r: {ring: 1, at: [up, 2*up]}")
    t = np.linspace(0, 3, 31)
    assert np.array_equal(ring.at, np.outer(t > 1.05, (1, 2)))
    assert ring.faces == []


def test_nothing_of_it_enters_the_run():
    text = PLANE.replace("  shapes: SHAPES\n", "")
    plain = lagsim.simulate(lagsim.load(text))
    shaped = lagsim.simulate(lagsim.load(filled(PLANE, BLOCK)))
    assert plain.columns == shaped.columns
    assert np.array_equal(plain._rows, shaped._rows)


def test_families_vectors_and_colours():
    text = PLANE.replace("rim: [x, y]", '"q(i = 1..2)": [x, i*y]')
    shapes = '"d(i = 1..2)": {disk: i, at: q(i)}, f: {arrow: "vec(y, x)", at: hub}, '
    shapes += "p: {polygon: [[1, -2], [x, y], [0, 0]], at: [x, x]}"
    one, two, arrow, face = bodies(text, shapes)
    assert [one.shape.point, two.shape.point] == ["q.1", "q.2"]
    assert np.ptp(two.corners[0, :, 0]) == 4
    assert np.allclose(arrow.corners[:, 1, 1], 1 + 3 * np.cos(np.linspace(0, 3, 31)))
    # Its corners are in its own axes, and its origin is no point of the scene.
    assert face.shape.point == ""


def test_other_sizes_follow_a_binding():
    model = lagsim.load(filled(PLANE, BLOCK))
    [body] = filmed_of(model.bind(w=1.0))
    assert np.ptp(body.corners[0, :, 0]) == 1
    with refused("out-of-range", "`block`", "-1"):
        model.bind(w=-1.0)


def filmed_of(model):
    result = lagsim.simulate(model, error_bar="never")
    equations = result._attempt.session.case.equations
    frames = animation.frames_of(
        equations, result._attempt.session.system.columns.names
    )
    frames.add(result._rows)
    return animation.film(equations, frames, ()).shapes


@pytest.mark.slow
def test_a_page_with_many_moving_corners_stays_small():
    shapes = ", ".join(f"c{k}: {{curve: [s, t*s], s: [0, {k}]}}" for k in range(1, 20))
    text = filled(PLANE, shapes).replace("output_step: 0.1", "output_step: 0.001")
    film, _ = filmed(text)
    size = len(animation.page([animation.record(film)], "page"))
    assert size < 2 * ROOM
    assert len(film.t) < 1000


# --- On paper


@pytest.mark.slow
def test_a_box_on_paper_is_where_it_is():
    drawing, _ = sheet(PLANE, BLOCK)
    assert_legible(drawing)
    view = drawing.panels[-1]
    [start, end] = view.areas
    for t, (_, found) in ((0, start), (3, end)):
        assert near(found[:4], pixels(view, block(t)), 0.02)
    # In the colour of its point; thin at four times between.
    own = [line for line in view.lines + view.thin if line.colour == "#0072b2"]
    thin = [line for line in own if line.width == 0.35]
    for t, line in zip((0.6, 1.2, 1.8, 2.4), thin, strict=True):
        assert near((line.x[1], line.y[1]), pixels(view, block(t)[0]), 0.02)


def pixels(view, place):
    low, high = np.transpose(view.limits)
    share = (np.asarray(place) - low) / (high - low)
    return share * [view.box.width, view.box.height] + [view.box.x0, view.box.y0]


GROUNDS = "floor: {ground: [[-2, -6], [4, -6]]}, wall: {ground: [[5, -6], [5, 2]]}"


@pytest.mark.slow
def test_grounds_are_hatched_at_their_right():
    drawing, _ = sheet(PLANE, GROUNDS)
    view = drawing.panels[-1]
    floor, wall = (line for line in view.lines if line.colour == "#555555")
    (_, low), (right, _) = pixels(view, [0, -6]), pixels(view, [5, 0])
    assert len(floor.x) > 50
    assert np.nanmin(floor.y) < low - 5
    assert np.nanmax(floor.y) < low + 0.1
    assert np.nanmax(wall.x) > right + 5
    assert np.nanmin(wall.x) > right - 0.1


# The nearer one is given first: to who sees it along y, and on the page.
BEFORE = "near: {sphere: 0.2, at: [8, -9, 0]}, far: {sphere: 0.5, at: [0, 9, 0]}"


@pytest.mark.slow
def test_what_is_near_is_drawn_last_on_paper():
    drawing, _ = sheet(SPACE, BEFORE)
    view = drawing.panels[1]
    far, near = (np.ptp(corners[:, 0]) for _, corners in view.areas)
    assert far > near


@pytest.mark.slow
def test_every_shape_is_legible_on_paper():
    text = BLOCK + ", d: {disk: 0.5, at: hub, frame: a}, r: {ring: 0.4, at: [x, 0]}, "
    text += "p: {polygon: [[0, 0], [1, 0], [0, 1]]}, g: {ground: [[-2, -6], [4, -6]]}, "
    text += "w: {ground: [[5, -5], [5, 2]]}, f: {arrow: [x_ddot, y_ddot], at: rim}, "
    text += "c: {curve: [s, sqrt(s)], s: [-1, 2]}"
    drawing, _ = sheet(PLANE, text)
    assert_legible(drawing)
    assert "r" in drawing.written()  # which has no point
    text = f"{CUBE}, s: {{sphere: 0.5, at: rim, frame: a}}, g: {{ground: -1}}, "
    text += "k: {cone: [0.3, 1], at: [x, y, 2], frame: a}, d: {disk: 1, at: rim}, "
    text += "c: {cylinder: [0.3, 1]}, l: {curve: [s, 0, t], s: [0, 1]}"
    drawing, _ = sheet(SPACE, text)
    assert_legible(drawing)


@pytest.mark.slow
def test_many_shapes_have_few_names():
    drawing, _ = sheet(PLANE, '"d(i = 1..40)": {disk: i/40, at: [x, i]}')
    assert_legible(drawing)
    assert "… 38 more …" in drawing.written()


@pytest.mark.slow
def test_a_scene_of_shapes_alone_is_drawn():
    text = PLANE.replace("  points: {hub: [1, -2], rim: [x, y]}\n", "")
    shapes = BLOCK.replace("rim", "[x, y]") + ", d: {disk: 0.1, at: [x, y]}"
    drawing, film = sheet(text, shapes)
    assert len(drawing.panels[-1].areas) == 4
    assert {line.colour for line in drawing.panels[-1].lines} == {"#0072b2", "#e69f00"}
    assert film.tracks == {}
    assert animation.record(film)["box"][0] == pytest.approx([-2.2, 4.2], abs=0.03)


# --- On the page


@needs_node
@pytest.mark.parametrize("t", [0.0, 1.0, 1.234])
def test_a_box_on_the_page_is_where_it_is(t):
    far = PLANE.replace("rim: [x, y]}", "rim: [x, y], a: [-9, -9], b: [9, 9]}")
    film, _ = filmed(filled(far, BLOCK))
    seen = page.shown(film, page.at(t))
    own = [one for one in fills(seen, page.FIRST) if one["path"][-1] == ["close"]]
    screen = Screen(film)
    assert near(ends(own[0]), [screen(p) for p in block(t)], 0.01)
    # Its point is small, to leave it in sight.
    [dot] = page.arcs(fills(seen, page.FIRST))
    assert dot[2] == 3
    assert set(json.loads(seen["data"]["points"])) == {"hub", "rim", "a", "b"}


@needs_node
def test_grounds_on_the_page_are_hatched_at_their_right():
    backwards = "wall: {ground: [[5, -6], [5, 2]]}, roof: {ground: [[4, 3], [-2, 3]]}"
    film, _ = filmed(filled(PLANE, backwards))
    found = [ends(one) for one in lines(page.shown(film, page.at(0)), "ground")]
    [(wall, _), (roof, _)] = [x for x in found if len(x) == 2 and long(x) > 100]
    hatches = [x for x in found if len(x) == 2 and 1 < long(x) < 12]
    beside = [b[0] - a[0] for a, b in hatches if abs(a[0] - wall[0]) < 1e-6]
    above = [b[1] - a[1] for a, b in hatches if abs(a[1] - roof[1]) < 1e-6]
    assert len(beside) > 9
    assert len(above) > 9
    assert min(beside) > 5
    assert max(above) < -5


def long(line):
    return np.hypot(*(line[1] - line[0]))


@needs_node
def test_a_cube_on_the_page_hides_three_edges():
    film, _ = filmed(filled(SPACE, CUBE))
    seen = page.shown(film, page.at(0))
    every = [one for one in lines(seen, "ground") if len(one["path"]) > 2]
    [dashed] = [one for one in every if one["dash"] == [3, 4]]
    assert len(ends(dashed)) - starts(dashed) == 3
    # They meet in the corner that is farthest: of the picture, with x and y in pixels.
    corners = np.unique(np.concatenate([ends(one) for one in every]).round(6), axis=0)
    screen = Screen(film)
    cube = np.array(list(product((-1, 1), repeat=3)))
    far = screen.along(cube[np.argmin(cube @ screen.towards)])
    off = ends(dashed) - corners.mean(axis=0)
    alike = np.isclose(off @ far, np.linalg.norm(off, axis=1) * np.linalg.norm(far))
    assert alike.sum() >= 2
    assert len([one for one in fills(seen, "ground") if one["alpha"] < 0.5]) == 3


@needs_node
def test_a_turned_box_of_space_on_the_page():
    turned = "[[0, 0, 1], [cos(a), -sin(a), 0], [sin(a), cos(a), 0]]"
    film, _ = filmed(filled(SPACE, f"b: {{box: [0.4, 0.8, 1.2], frame: {turned}}}"))
    seen = page.shown(film, page.at(1.25))  # between two frames
    every = [ends(one) for one in lines(seen, page.SECOND) if len(one["path"]) > 2]
    found = np.unique(np.concatenate(every).round(6), axis=0)
    c, s = np.cos(1.25), np.sin(1.25)
    own = np.array(list(product((-1, 1), repeat=3))) * [0.2, 0.4, 0.6]
    places = own @ np.array([(0, 0, 1), (c, -s, 0), (s, c, 0)]).T
    wanted = np.array([Screen(film).along(place) for place in places])
    found -= found.mean(axis=0)
    wanted *= np.abs(found).sum() / np.abs(wanted).sum()
    apart = np.linalg.norm(found[:, np.newaxis] - wanted, axis=2)
    assert apart.min(axis=1).max() < 0.05
    assert apart.min(axis=0).max() < 0.05


def starts(one):
    return sum(p[0] == "moveTo" for p in one["path"])


@needs_node
def test_a_sphere_on_the_page_is_a_circle():
    film, _ = filmed(filled(SPACE, "ball: {sphere: 0.5, at: rim}, g: {ground: -2}"))
    seen = page.shown(film, page.at(1))
    sizes = {round(r, 6) for *_, r in page.arcs(fills(seen, "card"))}
    drawn = {round(r, 6) for *_, r in page.arcs(fills(seen, page.FIRST))}
    assert len(sizes & drawn) == 1
    found = animation.record(film)
    assert found["floor"] == -2
    assert found["box"][0] == pytest.approx([-2.5, 4.5], abs=0.05)
    assert found["box"][2] == pytest.approx([-2, 3.5], abs=0.05)


@needs_node
def test_what_is_near_is_drawn_last_on_the_page():
    film, _ = filmed(filled(SPACE, BEFORE))
    far, near, *_ = page.arcs(fills(page.shown(film, page.at(0)), "card"))
    assert far[2] == pytest.approx(2.5 * near[2], rel=1e-6)


@needs_node
def test_supports_and_colours():
    text = PLANE.replace("  shapes", "  links: [[hub, rim]]\n  shapes")
    shapes = "d: {disk: 0.5, at: [x, 0]}"
    for more, count in (("", 1), (", g: {ground: [[0, -2], [9, -2]]}", 0)):
        film, _ = filmed(filled(text, shapes + more))
        seen = page.shown(film, page.at(0), ("key", "n"))
        triangles = [one for one in fills(seen, "ground") if one["alpha"] == 0.45]
        assert len(triangles) == count
        assert lines(
            seen, page.SECOND
        )  # a shape without a point has a colour of its own


@needs_node
@pytest.mark.parametrize(("look", "count"), [("damper", 4), ("rod", 1), ("line", 1)])
def test_links_look_as_asked_for(look, count):
    text = PLANE.replace(
        "  shapes: SHAPES", f"  links: [{{points: [hub, rim], as: {look}}}]"
    )
    film, _ = filmed(text)
    found = lines(page.shown(film, page.at(1)), "rod")
    wide = [one for one in found if len(one["path"]) > 1]
    assert len(wide) == count
    assert {one["width"] for one in wide} == {1 if look == "line" else wide[0]["width"]}
