"""Drawing calls of the page for a plane, against closed forms of the motion."""

import json

import numpy as np
import pytest

from lagsim.notes import Event
from lagsim.outputs.animation.carriers import Push
from tests.outputs import node as page
from tests.outputs.node import (
    COLOURS,
    FIRST,
    HIGH,
    WIDE,
    Screen,
    arcs,
    at,
    ends,
    fills,
    lines,
    near,
    shown,
    stopped,
    strokes,
)

pytestmark = page.needs_node

T = np.linspace(0, 6, 121)
SHINE = "rgba(255, 255, 255, .5)"
# The radius of a point, and the length of the usual force.
RADIUS, USUAL = 0.02 * HIGH, 0.18 * HIGH


def rim(t):
    """Where a point of a circle about (1, -2) is; its velocity beside it."""
    t = np.asarray(t, float)
    return [1 + 3 * np.cos(t), -2 + 3 * np.sin(t)], [-3 * np.sin(t), 3 * np.cos(t)]


def circle(**more):
    more = {"links": [("hub", "rim")], "units": {"length": "m", "force": "N"}} | more
    return page.film(T, {"hub": [1, -2], "rim": rim(T)}, **more)


def pulled(size):
    """A force towards the hub, of `size` N at each time."""
    force = -np.stack([np.cos(T), np.sin(T)], axis=1) * np.reshape(size, (-1, 1))
    return [Push("rod", "rim", np.broadcast_to(force, (len(T), 2)))]


def swinging(count):
    """Points side by side, each of which goes to and fro."""
    tracks = {
        f"p{k}": ([np.cos(T), k + 0 * T], [-np.sin(T), 0 * T]) for k in range(count)
    }
    return page.film(T, tracks)


# Half way between two frames too, where the motion goes between rows.
@pytest.mark.parametrize("t", [0.0, 1.0, 2.525, 4.7123])
def test_points_and_rod(t):
    seen, place, screen = shown(circle(), at(t)), rim(t)[0], Screen(circle())
    [(x, y, radius)] = [dot] = arcs(fills(seen, FIRST))
    assert near(dot, [*screen(place), RADIUS], 2e-3)
    assert arcs(lines(seen, "card"))[-1] == dot
    [rod] = lines(seen, "rod", width=0.34 * RADIUS)
    assert near(ends(rod), [screen([1, -2]), screen(place)], 2e-3)
    points = json.loads(seen["data"]["points"])
    assert np.allclose(points["rim"], place, atol=1e-5)
    assert points["hub"] == [1, -2]
    # A light that comes from the left and above.
    light = [x - 0.3 * radius, y - 0.32 * radius, 0.28 * radius]
    assert near(arcs(strokes(seen, colour=SHINE)), [light], 1e-6)


def test_support_below_and_above():
    tracks = {"low": [0, -1], "high": [0, 1], "bob": ([T, 0 * T], [1 + 0 * T, 0 * T])}
    made = page.film(T, tracks, links=[("low", "bob"), ("high", "bob")])
    seen, screen = shown(made), Screen(made)
    grounds = [ends(one) for one in lines(seen, "ground")]
    for place, side in (([0, -1], 1), ([0, 1], -1)):
        x, y = screen(place)
        # A triangle from the point outwards, and a line there, longer than it.
        [triangle] = [
            one for one in fills(seen, "ground") if near(one["path"][0][1:], [x, y])
        ]
        _tip, left, right = ends(triangle)
        assert np.isclose(left[1], right[1])
        assert side * (left[1] - y) > RADIUS
        assert np.isclose(left[0] + right[0], 2 * x)
        assert triangle["alpha"] == 0.45
        [bar] = [e for e in grounds if np.allclose(e[:, 1], left[1])]
        assert bar[0, 0] < left[0] < x < right[0] < bar[1, 0]
        hatches = [
            e for e in grounds if np.isclose(e[0, 1], left[1]) and e[1, 1] != e[0, 1]
        ]
        assert len(hatches) >= 4
        assert all(side * (b - a)[1] == pytest.approx(5) for a, b in hatches)
    pins = [[*screen(p), 4] for p in ([0, -1], [0, 1])]
    assert near(arcs(fills(seen, "card")), pins)


@pytest.mark.parametrize("t", [1.0, 2.525])
def test_arrow_of_a_force(t):
    made = circle(pushes=pulled(2.0))
    seen = shown(made, at(t))
    start = Screen(made, forces=True)(rim(t)[0])
    # Inwards; upwards on the screen is a smaller number.
    inwards = np.array([-np.cos(t), np.sin(t)])
    head, legend = fills(seen, "force")
    shaft, other = lines(seen, "force")
    tip, left, right = ends(head)
    assert near(tip, start + USUAL * inwards, 0.02)
    assert near(ends(shaft), [start, start + (USUAL - 11) * inwards], 0.02)
    assert near((left + right) / 2, start + (USUAL - 11) * inwards, 0.02)
    assert np.linalg.norm(left - right) == pytest.approx(2 * 0.42 * 11)
    # What an arrow of a round length stands for: so many N have the same pixels.
    [text] = strokes(seen, op="fillText", text="constraint force 1 N")
    assert near(ends(other)[0], [46, HIGH - 34])
    assert near(ends(legend)[0], [46 + USUAL / 2, HIGH - 34], 1e-3)
    assert near([text["x"], text["y"]], [54 + USUAL / 2, HIGH - 34], 1e-3)


def test_forces_small_long_and_none():
    size = np.full(len(T), 2.0)
    # At 1 s five times the usual one, at 2 s a hundredth of it, at 3 s none.
    size[20], size[40], size[60] = 10.0, 0.02, 0.0
    made = circle(pushes=pulled(size))
    _, long, small, none, off = stopped(made, *map(at, (1, 2, 3)), ("key", "f"))
    inwards = np.array([-np.cos(1), np.sin(1)])
    tip = Screen(made, forces=True)(rim(1.0)[0]) + 1.5 * USUAL * inwards
    assert near(ends(fills(long, "force")[0])[0], tip, 0.02)
    first, second, _ = lines(long, "force")
    assert near(ends(second)[0] - ends(first)[1], 5 * inwards, 0.02)
    assert [len(fills(seen, "force")) for seen in (small, none, off)] == [1, 1, 0]
    assert off["pressed"]["forces"] == "false"
    assert not off["hidden"]["forces"]


def test_names_where_asked():
    first, seen = stopped(circle(), ("key", "n"))
    assert not strokes(first, text="rim")
    for name, place in (("rim", rim(0)[0]), ("hub", [1, -2])):
        x, y = Screen(circle())(place)
        for op, colour in (("strokeText", "card"), ("fillText", "ink")):
            [text] = strokes(seen, op=op, colour=colour, text=name)
            assert near([text["x"], text["y"]], [x + RADIUS + 5, y - RADIUS])
            assert text["align"] == "left"


@pytest.mark.parametrize("passed", [0.0, 0.07, 0.28])
def test_ring_where_something_struck(passed):
    events = [Event(2.0, "impact", "wall"), Event(2.0, "release", "other")]
    made = circle(events=events, struck={"wall": ["rim"], "other": ["hub"]})
    _, early, seen, late = stopped(made, *map(at, (1.99, 2 + passed, 2.36)))
    age = passed / 0.35
    [one] = lines(seen, "force")
    wanted = [*Screen(made)(rim(2 + passed)[0]), RADIUS * (1.2 + 2.4 * age)]
    assert near(arcs([one]), [wanted], 2e-3)
    assert one["alpha"] == pytest.approx(1 - age)
    assert one["width"] == pytest.approx(3 * (1 - age) + 0.5)
    assert not arcs(strokes(early, colour="force") + strokes(late, colour="force"))
    assert seen["texts"]["legend"] == "impact (1)"  # the release is part of it


@pytest.mark.parametrize(
    ("speed", "keys"), [(1.0, []), (2.0, [("key", "+")]), (0.5, [("key", "-")])]
)
def test_rings_last_as_long_at_any_speed(speed, keys):
    """A third of a second as it is played: at twice the speed, of twice the motion."""
    made = circle(events=[Event(2.0, "impact", "wall")], struck={"wall": ["rim"]})
    *_, one, other = stopped(made, *keys, at(2 + 0.34 * speed), at(2 + 0.36 * speed))
    assert arcs(lines(one, "force"))
    assert not arcs(lines(other, "force"))


def test_trails():
    made = circle()
    *_, fading, whole, none = stopped(made, at(5), ("key", "t"), ("key", "t"))
    screen = Screen(made)
    [path] = lines(whole, FIRST)
    found = ends(path)
    # All of it lies on the circle, from the start to now, in the sense of the motion.
    hub = screen([1, -2])
    angle = np.unwrap(np.arctan2(hub[1] - found[:, 1], found[:, 0] - hub[0]))
    assert near(np.hypot(*(found - hub).T), 3 * screen.scale, 2e-3)
    assert near([angle[0], angle[-1]], [0, 5], 1e-4)
    assert (np.diff(angle) > 0).all()
    # The last 0.35 of the run, thicker and stronger towards now.
    pieces = lines(fading, FIRST)
    assert len(pieces) == 24
    assert near(ends(pieces[0])[0], screen(rim(5 - 0.35 * 6)[0]), 2e-3)
    assert near(ends(pieces[-1])[-1], screen(rim(5)[0]), 2e-3)
    for key in ("alpha", "width"):
        assert (np.diff([piece[key] for piece in pieces]) > 0).all()
    assert pieces[-1]["alpha"] == 0.75
    assert not lines(none, FIRST)
    names = [seen["texts"]["trails"] for seen in (whole, none)]
    assert names == ["Whole path", "No trails"]


@pytest.mark.parametrize(("span", "long"), [(8.0, 2.8), (80.0, 5.0), (400.0, 140.0)])
def test_trails_last_a_third_of_the_run_or_five_seconds(span, long):
    made = page.swing((0.0, span), rows=2001)
    first, *_ = lines(shown(made, at(0.9 * span)), FIRST)
    wanted = Screen(made)([np.sin(0.9 * span - long), 0])
    assert near(ends(first)[0], wanted, 0.05)


def test_a_trail_with_a_gap():
    made = page.swing((0.0, 6.0), rows=121)
    made.tracks["bob"].place[40:44] = np.nan
    [path] = lines(shown(made, at(5), ("key", "t")), FIRST)
    moves = [k for k, one in enumerate(path["path"]) if one[0] == "moveTo"]
    assert len(moves) == 2
    assert all(np.isfinite(one[1:]).all() for one in path["path"])
    before, after = path["path"][moves[1] - 1][1], path["path"][moves[1]][1]
    apart = Screen(made).scale * np.abs(np.sin(T[39]) - np.sin(T[44]))
    assert abs(abs(before - after) - apart) < 0.2 * apart


def assert_grid(seen, screen, unit=""):
    """Lines at round steps of 110 pixels or more, numbers clear of edges and corner."""
    step = min(step for step in page.ROUND if step * screen.scale >= 110)
    corners = [ends(one) for one in lines(seen, "grid")]
    values = step * np.arange(-300, 301)
    for axis, size, low, high, align in (
        (0, WIDE, 44, 24, "center"), (1, HIGH, 12, 22, "left"),
    ):  # fmt: skip
        places = np.array([screen([x, x])[axis] for x in values])
        # No line crosses the numbers, which are at the left and below.
        lines_from, lines_to = ((44, size), (0, size - 22))[axis]
        drawn = np.floor(places + 0.5) + 0.5
        there = (places >= -1e-9) & (places <= size) & (drawn < lines_to)
        there &= drawn > lines_from
        wanted = drawn[there]
        found = [e[0, axis] for e in corners if e[0, axis] == e[1, axis]]
        assert near(sorted(found), sorted(wanted))
        texts = page.labels(seen, align=align)
        texts = [one for one in texts if one["text"] != unit]
        kept = (wanted > low) & (wanted < size - high)
        found = [page.number(one["text"]) for one in texts]
        assert near(found, values[there][kept], 1e-9)
        for one, place in zip(texts, wanted[kept], strict=True):
            beside = [place, HIGH - 6] if axis == 0 else [7, place]
            assert near([one["x"], one["y"]], beside)
    assert bool(strokes(seen, op="fillText", text=unit)) is bool(unit)


def test_grid_wherever_the_plane_is():
    assert_grid(shown(circle()), Screen(circle()), "m")
    made = page.swing((0.0, 6.0))
    steps = page.press(0, 0), page.move(70, -45), page.wheel(300, 200, 300)
    screen = Screen(made).moved([70, -45]).zoomed(np.exp(-0.45), (200, 300))
    assert_grid(shown(made, *steps), screen)


# With nothing that moves, half of how far it is from the origin is its size; at the
# origin that is 1.
@pytest.mark.parametrize(
    ("place", "size"), [((3, -4), 2.0), ((0, 0), 1.0), ((-6e-3, 1e-3), 3e-3)]
)
def test_a_scene_at_rest_has_a_size(place, size):
    made = page.film(T, {"one": list(place)})
    seen = shown(made)
    assert_grid(seen, Screen(made, scale=(HIGH - 2 * 0.14 * HIGH) / size))
    [square] = strokes(seen, op="fillRect", colour="ground")
    assert near(square["box"], [WIDE / 2 - 4, HIGH / 2 - 4, 8, 8])


# At -far, 0 and far, and between; 488 pixels are 2 far.
@pytest.mark.parametrize(
    ("far", "texts"),
    [
        (1e6, ["-1.0e6", "-5.0e5", "0", "5.0e5", "1.0e6"]),
        (1e5, ["-1.0e5", "-50000", "0", "50000", "1.0e5"]),
        (2e-1, ["-0.2", "-0.1", "0", "0.1", "0.2"]),
        (2e-5, ["-0.00002", "-0.00001", "0", "0.00001", "0.00002"]),
        (1e-5, ["-1.0e-5", "-5.0e-6", "0", "5.0e-6", "1.0e-5"]),
    ],
)
def test_digits_of_places(far, texts):
    seen = shown(page.swing((-np.pi / 2, np.pi / 2), size=far))
    found = page.labels(seen, align="center")
    wanted = [text.replace("-", "\N{MINUS SIGN}") for text in texts]
    assert [one["text"] for one in found] == wanted


@pytest.mark.parametrize(
    ("high", "forces"), [(300.0, False), (1000.0, False), (500.0, True)]
)
def test_margins_of_small_and_large_pictures(high, forces):
    tracks = {"bob": ([0 * T, np.sin(T)], [0 * T, np.cos(T)]), "wall": [0, -1]}
    push = [Push("rod", "bob", np.ones((len(T), 2)))] if forces else []
    made, size = page.film(T, tracks, pushes=push), [WIDE, high]
    seen = shown(made, at(1), size=size)
    wanted = Screen(made, forces=forces, size=size)([0, np.sin(1)])
    assert near(page.dot(seen), wanted, 1e-3)


def test_drag_wheel_and_reset():
    made = page.swing()
    steps = [
        page.press(100, 100), page.move(130, 80), ("on", 0, "pointerup", {}),
        page.wheel(-200, 50, 60), ("on", 0, "dblclick", {}), page.wheel(100, 50, 60),
        ("key", "0"),
    ]  # fmt: skip
    dots = [page.dot(one) for one in stopped(made, *steps)]
    screen = Screen(made)
    start = screen([0, 0])
    assert near(dots[2], screen.moved([30, -20])([0, 0]))
    assert near(dots[4], screen.zoomed(np.exp(0.3), (50, 60))([0, 0]))
    assert near([dots[5], dots[7]], [start, start])


def test_how_far_it_zooms():
    made, here, there = page.swing(), (250, 150), (30, 350)
    for turn, most in ((-1e5, 200.0), (1e5, 0.1)):
        seen = stopped(made, page.wheel(turn, *here), page.wheel(turn, 10, 20))
        start, far, still = map(page.dot, seen)
        assert near(far, here + most * (start - np.array(here)), 1e-6 * most)
        assert near(still, far, 1e-6 * most)
    # Twice half as far is a quarter, about the pixel that the second one is at.
    half = np.log(2) / 0.0015
    seen = shown(made, page.wheel(half, *here), page.wheel(half, *there))
    wanted = Screen(made).zoomed(0.5, here).zoomed(0.5, there)
    assert near(page.dot(seen), wanted([0, 0]))


def test_two_fingers():
    """The picture between two fingers stays there, and grows as they part."""
    made, moved = page.swing(), page.move(220, 260, finger=2)
    steps = [page.press(100, 100), page.press(160, 180, finger=2), moved]
    # One that is lifted moves nothing; the other one drags.
    steps += [("on", 0, "pointerup", {"pointerId": 2}), moved, page.move(107, 95)]
    seen = stopped(made, *steps)
    # Twice as far from each other; from (130, 140) to (160, 180).
    screen = Screen(made).zoomed(2, (130, 140)).moved([30, 40])
    assert near([page.dot(seen[3]), page.dot(seen[5])], [screen([0, 0])] * 2)
    assert near(page.dot(seen[6]), screen.moved([7, -5])([0, 0]))


def test_spring_and_string():
    ball = [2 + np.cos(T), 0 * T], [-np.sin(T), 0 * T]
    rope = [np.minimum(2.0, 2 + np.sin(T)), 0 * T - 1], [0 * T, 0 * T]
    tracks = {"a": [0, 0], "ball": ball, "b": [0, -1], "end": rope}
    links = [("a", "ball"), ("b", "end")]
    made = page.film(T, tracks, links=links, struck={"taut": ["end"]})
    seen, screen = shown(made, at(4.7)), Screen(made)
    [coil] = [one for one in lines(seen, "rod", width=1.6) if len(one["path"]) > 9]
    corners = ends(coil)
    start, stop = screen([0, 0]), screen([2 + np.cos(4.7), 0])
    assert near(corners[[0, -1]], [start, stop], 2e-3)
    # The coils lie between straight ends, each a tenth of the whole, to their width.
    along = (corners[1:-1, 0] - start[0]) / (stop[0] - start[0])
    turn = 9.0 / (stop[0] - start[0])
    assert along[0] == pytest.approx(0.1, abs=1e-3)
    assert 0.9 - turn < along[-1] <= along.max() < 0.9
    across = corners[:, 1] - start[1]
    assert across.max() == pytest.approx(-across.min())
    # As many turns as 15 pixels go into the usual length.
    turns = int(np.sum((across[:-1] <= 1e-9) & (across[1:] > 1e-9)))
    usual = np.median(2 + np.cos(T)) * screen.scale
    assert turns == min(16, max(5, round(usual / 15)))
    [hanging] = [
        one for one in lines(seen, "rod") if one["path"][-1][0] == "quadraticCurveTo"
    ]
    (_, *first), (_, mx, my, *last) = hanging["path"]
    apart = float(np.interp(4.7, T, 2 + np.sin(T)))
    one, other = screen([0, -1]), screen([apart, -1])
    assert near([first, last], [one, other], 1e-2)
    # Below the middle, the more so the nearer the ends.
    sag = 0.86 * np.sqrt(4 - apart**2) * screen.scale
    assert near([mx, my], [(one[0] + other[0]) / 2, one[1] + sag], 1e-2)


@pytest.mark.parametrize("length", [1.5, 2.0, 5.0])
def test_a_string_has_the_length_that_the_file_gives(length):
    end = [np.minimum(2.0, 2 + np.sin(T)), 0 * T], [0 * T, 0 * T]
    tracks = {"a": [0, 0], "b": end, "far": [0, -6]}
    more = {"looks": ["string"], "lengths": [length], "links": [("a", "b")]}
    made = page.film(T, tracks, **more)
    for t in (0.5, 4.7):
        seen, screen = shown(made, at(t)), Screen(made)
        [hanging] = [
            one
            for one in lines(seen, "rod")
            if one["path"][-1][0] == "quadraticCurveTo"
        ]
        _, _, my, *_ = hanging["path"][1]
        apart = float(np.interp(t, T, end[0][0]))
        # Nearer than its length it sags, further apart it is straight.
        sag = 0.86 * np.sqrt(max(0.0, length**2 - apart**2)) * screen.scale
        assert my == pytest.approx(screen([0, 0])[1] + sag, abs=2e-2)


@pytest.mark.parametrize(("length", "turns"), [(1.0, 5), (4.0, 8), (9.0, 16)])
def test_springs_have_turns_by_their_usual_length(length, turns):
    """Usual lengths of 29, 120 and 270 pixels or so; another point is far away."""
    ball = [length * (1 + 0.3 * np.sin(T)), 0 * T]
    tracks = {"a": [0, 0], "far": [16.0, 0]}
    tracks["ball"] = (ball, [0.3 * length * np.cos(T), 0 * T])
    made = page.film(T, tracks, links=[("a", "ball")])
    [coil] = [one for one in lines(shown(made, at(1)), "rod") if len(one["path"]) > 9]
    usual = np.median(ball[0]) * Screen(made).scale
    assert turns == min(16, max(5, round(usual / 15)))
    # 16 corners a turn: one of them is a fourth of a turn.
    wide = max(3.0, min(9.0, 0.055 * usual, 0.9 * 8.0))
    assert (ends(coil)[:, 1] - HIGH / 2).max() == pytest.approx(wide, abs=1e-6)
    assert len(ends(coil)) == turns * 16 + 3


def test_a_break_goes_straight_and_a_gap_is_no_point():
    made = circle(broken=np.arange(len(T)) == 20)
    place = made.tracks["rim"].place
    wanted = Screen(made)((place[20] + place[21]) / 2)
    assert near(page.dot(shown(made, at(1.025))), wanted)
    place[20] = np.nan
    assert not fills(shown(made, at(1)), FIRST)


def test_colours_of_many_points():
    few, many = (
        [one for one in strokes(shown(swinging(count), dark=count == 20), op="fill")
         if one["colour"] != SHINE]
        for count in (6, 20)
    )  # fmt: skip
    assert len({one["colour"] for one in few}) == len(few) == 6
    # From one hue to another.
    hues = [float(one["colour"][4:].split()[0]) for one in many]
    assert near([hues[0], hues[-1]], [205, 20])
    assert (np.diff(hues) < 0).all()


@pytest.mark.parametrize(
    ("size", "count", "radius"),
    [(100, 2, 3.0), (300, 2, 6.0), (1000, 2, 11.0), (600, 12, 11.0), (600, 13, 6.6)],
)
def test_points_are_as_large_as_the_picture(size, count, radius):
    seen = shown(swinging(count), size=[size, size])
    assert strokes(seen, op="fill")[0]["path"][0][3] == pytest.approx(radius)


@pytest.mark.parametrize("end", [(3, 4), (-3, 4), (-2, -5), (4, -1), (4, 0), (-4, 0)])
def test_ground_is_hatched_below(end):
    tracks = {"a": [0, 0], "b": list(end), "c": ([T, 2 + 0 * T], [1 + 0 * T, 0 * T])}
    made = page.film(T, tracks, links=[("a", "b")])
    line, *hatches = lines(shown(made), "ground")
    first, last = ends(line)
    assert near([first, last], [Screen(made)(place) for place in ([0, 0], end)])
    assert line["width"] == 2
    long = np.linalg.norm(last - first)
    along = (last - first) / long
    # Backwards along it, and down to the side that is below.
    below = np.array([-along[1], along[0]]) * (1 if along[0] >= 0 else -1)
    assert below[1] >= 0
    assert len(hatches) == int((long - 8) // 9) + 1
    for k, hatch in enumerate(hatches):
        start, stop = ends(hatch)
        assert near(start, first + (8 + 9 * k) * along)
        assert near(stop - start, 7 * below - 7 * along)


# --- Spaces


def helix():
    """A helix about z, from z = 0 to 3."""
    place = [np.cos(T), 2 * np.sin(T), T / 2]
    rate = [-np.sin(T), 2 * np.cos(T), 0.5 + 0 * T]
    tracks = {"bead": (place, rate), "foot": [0, 0, 0]}
    return page.film(T, tracks, links=[("foot", "bead")])


def cloud(seed, count=6):
    """Points of a space that all but stand, at random."""
    random, still = np.random.default_rng(seed), np.zeros((3, len(T)))
    places = random.uniform(-1, 1, (count, 3))
    return page.film(T, {
        f"p{k}": ([x + 1e-6 * T for x in place], still + 1e-6)
        for k, place in enumerate(places)
    })  # fmt: skip


def level(z, t=T):
    return page.film(t, {"a": ([np.cos(t), np.sin(t), z], [0 * t, 0 * t, 0 * t])})


@pytest.mark.parametrize("drag", [(0, 0), (50.0, 0.0), (0.0, 40.0), (-30.0, -20.0)])
def test_space_is_turned(drag):
    made, t = helix(), 3.025
    seen = shown(made, at(t), page.press(0, 0), page.move(*drag))
    # Rotations about z and about the horizontal: x to the right, z upwards.
    height = 0.34 + 0.008 * drag[1]
    screen = Screen(made, turned=(-0.96 - 0.008 * drag[0], height))
    place = [np.cos(t), 2 * np.sin(t), t / 2]
    foot, bead, below = map(screen, ([0, 0, 0], place, [*place[:2], 0]))
    assert near(page.dot(seen), bead, 2e-3)
    [rod] = lines(seen, "rod")
    assert near(ends(rod)[[0, -1]], [foot, bead], 2e-3)
    [ellipse] = [one["path"][0] for one in fills(seen, "shadow")]
    assert near(ellipse[1:3], below, 2e-3)
    assert ellipse[4] / ellipse[3] == pytest.approx(max(0.2, np.sin(height)))
    [plumb] = [one for one in lines(seen, "ground") if one["dash"]]
    assert near(ends(plumb), [bead, below], 2e-3)
    assert near(ends(lines(seen, "shadow")[-1]), [foot, below], 2e-3)
    for name, axis in zip("xyz", np.eye(3), strict=True):
        [text] = strokes(seen, op="fillText", text=name)
        beside = 39 * screen.along(axis) / screen.scale
        wanted = np.array([WIDE - 48, HIGH - 46]) + beside
        assert near([text["x"], text["y"]], wanted)
    # The floor has lines at round steps, ten or so, around all that is shown.
    low, high = screen.low, screen.high
    step = min(s for s in page.ROUND if s >= 1.2 * max(high - low) / 10)
    (west, east), (south, north) = (
        (step * np.floor(a / step + 1e-6), step * np.ceil(b / step - 1e-6))
        for a, b in zip(low[:2], high[:2], strict=True)
    )
    xs, ys = (np.arange(a, b + 0.1, step) for a, b in ((west, east), (south, north)))
    wanted = [[screen([x, south, 0]), screen([x, north, 0])] for x in xs]
    wanted += [[screen([west, y, 0]), screen([east, y, 0])] for y in ys]
    assert near([ends(line) for line in lines(seen, "faint")], wanted, 1e-3)
    [square] = strokes(seen, op="fillRect", colour="ground")
    assert near(square["box"], [*foot - 4, 8, 8])


@pytest.mark.parametrize("drag", [(0, 0), (150, 60), (-400, 1000), (20, -1000)])
def test_the_nearer_of_two_points_hides_the_other(drag):
    made = cloud(drag[1] + 1000)
    seen = shown(made, page.press(0, 0), page.move(*drag))
    # It is turned no farther than to be seen from above, or from below.
    height = np.clip(0.34 + 0.008 * drag[1], -1.57, 1.57)
    screen = Screen(made, turned=(-0.96 - 0.008 * drag[0], height))
    places = np.array([track.place[0] for track in made.tracks.values()])
    dots = [one["colour"] for one in strokes(seen, op="fill")]
    found = [COLOURS.index(colour) for colour in dots if colour in COLOURS]
    assert found == np.argsort(places @ screen.towards).tolist()


def test_shift_moves_a_space():
    seen = stopped(helix(), page.press(0, 0), page.move(30, 20, shiftKey=True))
    assert near(page.dot(seen[2]) - page.dot(seen[0]), [30, 20])
    assert seen[0]["texts"]["turning"] == "drag to turn"
    assert "turning" not in shown(circle())["texts"]


def test_the_floor_is_below_all():
    made = level(2 + 0 * T)
    made.tracks["b"] = page.film(T, {"b": [0, 0, 1.5]}).tracks["b"]
    seen, screen = shown(made), Screen(made)
    [shadow] = [one["path"][0] for one in fills(seen, "shadow")]
    [square] = strokes(seen, op="fillRect", colour="ground")
    # `b`, under the middle of the circle, is on the floor: where shadows go round.
    apart = np.subtract(shadow[1:3], square["box"][:2]) - 4
    assert near(apart, screen.along([1.0, 0, 0]), 1e-3)


@pytest.mark.parametrize("size", [1.0, 2.1, 3.05, 6.3])
@pytest.mark.parametrize("drag", [0, 90, 260])
def test_the_whole_floor_is_seen_however_it_is_turned(size, drag):
    place = [size * np.cos(T), 0.4 + size * np.sin(T), 0.1 * size * np.sin(T)]
    rate = [-size * np.sin(T), size * np.cos(T), 0.1 * size * np.cos(T)]
    seen = shown(
        page.film(T, {"a": (place, rate)}), page.press(0, 0), page.move(drag, 0),
        size=[1000.0, 600.0],
    )  # fmt: skip
    [floor] = fills(seen, "floor")
    across = np.array([corner[1] for corner in floor["path"] if len(corner) > 2])
    assert len(across) == 4
    assert 0 <= across.min() < across.max() <= 1000


@pytest.mark.parametrize("count", [4, 5])
def test_plumb_lines_of_few_points_seen_from_above(count):
    made = cloud(1, count)
    above, *_, below = stopped(made, page.press(0, 0), page.move(0, -200))
    plumb = [one for one in lines(above, "ground") if one["dash"]]
    assert len(plumb) == (count if count <= 4 else 0)
    assert len(fills(above, "shadow")) == count
    # From below, the floor would hide what stands on it.
    assert not fills(below, "shadow") + lines(below, "faint")


def test_no_floor_through_the_motion():
    t = np.linspace(0, 6, 301)
    # One row in three hundred goes a thousand times as far, out of the view.
    for far, floor in ((0.0, True), (-1000.0, False), (1000.0, True)):
        z = np.where(np.arange(301) == 150, far, np.sin(t))
        seen = shown(level(z, t))
        assert bool(fills(seen, "floor")) is bool(fills(seen, "shadow")) is floor, far
    # All at one height: a grid, and no shadows under what lies on it.
    seen = shown(level(0 * T))
    assert not fills(seen, "floor") + fills(seen, "shadow")
    assert lines(seen, "faint")


@pytest.mark.parametrize(
    ("films", "apart"),
    [
        ([page.swing(), page.swing(size=0.21)], False),
        ([page.swing(), page.swing(size=0.19)], True),
        ([page.swing(size=0.19), page.swing(), page.swing()], True),
        ([page.swing(), cloud(0)], True),
        ([cloud(0), cloud(1)], False),
    ],
)
def test_runs_of_other_sizes_and_spaces_have_their_own_scales(films, apart):
    seen = shown(films)
    assert seen["hidden"]["together"] is apart
    for k, film in enumerate(films):
        screen = Screen(*([film] if apart else films))
        name, *_ = film.tracks
        assert near(page.dot(seen, k), screen(film.tracks[name].place[0]), 1e-3)
