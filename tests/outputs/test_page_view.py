"""Where the page puts a scene: its size, also at rest, in space, zoomed and turned."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.outputs.animation.pushes import Push
from tests.outputs import node as page
from tests.outputs.node import HIGH, QUIET, WIDE

pytestmark = page.needs_node

T = np.linspace(0, 6, 121)
EDGE = 0.14 * HIGH
MINUS = "\N{MINUS SIGN}"
COLOURS = ["#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9"]


def line(far=1.0, t=T):
    """A point between -far and far, on a line, beside one at rest."""
    return page.film(
        t, {"bob": ([far * np.sin(t), 0 * t], [far * np.cos(t), 0 * t]), "o": [0, 0]}
    )


def grid(seen, axis):
    """Give the pixels of the lines across an axis (0: across x), and their labels."""
    lines = [page.ends(one) for one in page.strokes(seen, op="stroke", colour="grid")]
    places = sorted(e[0, axis] for e in lines if e[0, axis] == e[1, axis])
    align = ("center", "left")[axis]
    texts = page.strokes(seen, op="fillText", colour="dim", align=align)
    return places, [float(one["text"].replace(MINUS, "-")) for one in texts]


def lines_at(scale, middle, size):
    """Give where lines at round steps of at least 110 pixels stand, from `middle`."""
    steps = [m * 10.0**k for k in range(-6, 4) for m in (1, 2, 5)]
    step = min(step for step in steps if step * scale >= 110)
    first = size[0] / 2 - scale * middle
    found = first + scale * step * np.arange(-200, 201)
    return np.floor(found[(found >= 0) & (found <= size[0])] + 0.5) + 0.5, step


# With nothing that moves, half of how far it is from the origin is its size; at the
# origin that is 1.
@pytest.mark.parametrize(
    ("place", "size"), [((3, -4), 2.0), ((0, 0), 1.0), ((-6e-3, 1e-3), 3e-3)]
)
def test_a_scene_at_rest_has_a_size(place, size):
    made = page.film(T, {"one": list(place)})
    seen = page.played([made], QUIET)[-1]
    found, texts = grid(seen, 0)
    wanted, step = lines_at((HIGH - 2 * EDGE) / size, place[0], (WIDE,))
    assert page.near(found, wanted)
    assert np.allclose(np.diff(texts), step)
    [square] = page.strokes(seen, op="fillRect", colour="ground")
    assert page.near(square["box"], [WIDE / 2 - 4, HIGH / 2 - 4, 8, 8])


@pytest.mark.parametrize(
    ("high", "forces"), [(300.0, False), (1000.0, False), (500.0, True)]
)
def test_margins_of_small_and_large_pictures(high, forces):
    tracks = {"bob": ([0 * T, np.sin(T)], [0 * T, np.cos(T)]), "wall": [0, -1]}
    push = [Push("rod", "bob", np.ones((len(T), 2)))] if forces else []
    made = page.film(T, tracks, pushes=push)
    seen = page.played([made], [*QUIET, ("hash", "#t=1")], size=[WIDE, high])[-1]
    low, top = -1.0, np.max(np.sin(T))
    least = min(WIDE, high)
    edge = 0.2 * least if forces else min(64.0, 0.14 * least)
    scale = (high - 2 * edge) / (top - low)
    [dot] = page.arcs(seen, op="fill", colour=COLOURS[0])
    wanted = high / 2 - scale * (np.sin(1) - (low + top) / 2)
    assert page.near(dot[:2], [WIDE / 2, wanted], 1e-3)


def test_the_grid_is_whole_wherever_the_plane_is():
    steps = [
        *QUIET,
        ("on", 0, "pointerdown", {"offsetX": 0, "offsetY": 0}),
        ("on", 0, "pointermove", {"offsetX": 70, "offsetY": -45}),
        ("on", 0, "wheel", {"deltaY": 300, "offsetX": 200, "offsetY": 300}),
    ]
    seen = page.played([line()], steps)[-1]
    low, high = np.min(np.sin(T)), np.max(np.sin(T))
    zoom = np.exp(-0.45)
    scale = zoom * (WIDE - 2 * EDGE) / (high - low)
    for axis, size, moved, fixed, middle, sign in (
        (0, WIDE, 70, 200, (low + high) / 2, 1),
        (1, HIGH, -45, 300, 0.0, -1),
    ):
        at = fixed + zoom * (size / 2 + moved - fixed)  # of the middle
        found, texts = grid(seen, axis)
        wanted, step = lines_at(scale, sign * middle + (size / 2 - at) / scale, (size,))
        assert page.near(found, wanted)
        assert np.allclose(np.abs(np.diff(texts)), step)


def test_how_far_it_zooms():
    for turn, most in ((-1e5, 200.0), (1e5, 0.1)):
        wheel = ("on", 0, "wheel", {"deltaY": turn, "offsetX": 250, "offsetY": 150})
        again = ("on", 0, "wheel", {"deltaY": turn, "offsetX": 10, "offsetY": 20})
        seen = page.played([line()], [*QUIET, wheel, again])
        start, far, still = (page.arcs(seen[k], op="fill", colour=COLOURS[0])[0]
                             for k in (1, 2, 3))  # fmt: skip
        wanted = np.array([250, 150]) + most * (np.array(start[:2]) - [250, 150])
        assert page.near(far[:2], wanted, 1e-6 * most)
        assert page.near(still[:2], far[:2], 1e-6 * most)
    # Twice half as far is a quarter, about the pixel that the second one is at.
    half = 0.0015**-1 * np.log(2)
    wheels = [
        ("on", 0, "wheel", {"deltaY": half, "offsetX": x, "offsetY": y})
        for x, y in ((250, 150), (30, 350))
    ]
    seen = page.played([line()], [*QUIET, *wheels])
    start, _, last = (np.array(page.arcs(seen[k], op="fill", colour=COLOURS[0])[0][:2])
                      for k in (1, 2, 3))  # fmt: skip
    once = np.array([250, 150]) + (start - [250, 150]) / 2
    assert page.near(last, np.array([30, 350]) + (once - [30, 350]) / 2)


def cloud(seed):
    """Six points of a space that all but stand, at random."""
    random = np.random.default_rng(seed)
    still = np.zeros((3, len(T)))
    return {
        f"p{k}": ([x + 1e-6 * T for x in place], still + 1e-6)
        for k, place in enumerate(random.uniform(-1, 1, (6, 3)))
    }


@pytest.mark.parametrize("drag", [(0, 0), (150, 60), (-400, 1000), (20, -1000)])
def test_space_from_all_sides(drag):
    tracks = cloud(drag[1] + 1000)
    made = page.film(T, tracks)
    steps = [
        *QUIET,
        ("on", 0, "pointerdown", {"offsetX": 0, "offsetY": 0}),
        ("on", 0, "pointermove", {"offsetX": drag[0], "offsetY": drag[1]}),
    ]
    seen = page.played([made], steps)[-1]
    # It is turned no farther than to be seen from above, or from below.
    azimuth = -0.96 - 0.008 * drag[0]
    height = np.clip(0.34 + 0.008 * drag[1], -1.57, 1.57)
    c, s = np.cos(azimuth), np.sin(azimuth)
    towards = np.array([np.cos(height) * c, np.cos(height) * s, np.sin(height)])
    places = np.array([[x[0] for x in track[0]] for track in tracks.values()])
    order = np.argsort(places @ towards)
    dots = [one for one in page.strokes(seen, op="fill") if one["colour"] in COLOURS]
    assert [COLOURS.index(one["colour"]) for one in dots] == order.tolist()


def test_the_floor_is_below_all():
    tracks = {"a": ([np.cos(T), np.sin(T), 2 + 0 * T], [-np.sin(T), np.cos(T), 0 * T])}
    tracks["b"] = [0, 0, 1.5]
    seen = page.played([page.film(T, tracks)], QUIET)[-1]
    [shadow] = [
        one["path"][0] for one in page.strokes(seen, op="fill", colour="shadow")
    ]
    [square] = page.strokes(seen, op="fillRect", colour="ground")
    # `b`, under the middle of the circle, is on the floor: where shadows go round.
    c, s = np.cos(-0.96), np.sin(-0.96)
    wide = np.hypot(np.ptp(np.cos(T)), np.ptp(np.sin(T)))
    tall = 0.5 * np.cos(0.34) + wide * np.sin(0.34)
    scale = min((WIDE - 2 * EDGE) / wide, (HIGH - 2 * EDGE) / tall)
    wanted = scale * np.array([-s * 1.0, np.sin(0.34) * c * 1.0])
    assert page.near(np.subtract(shadow[1:3], square["box"][:2]) - 4, wanted, 1e-3)


def test_runs_of_other_sizes_and_spaces_have_their_own_scales():
    def shown(*films):
        seen = page.played(list(films), QUIET)[-1]
        drawn = [page.arcs(seen, k, op="fill", colour=COLOURS[0])
                 for k in range(len(films))]  # fmt: skip
        return seen["hidden"]["together"], [one[0][:2] for one in drawn if one]

    apart, _ = shown(line(1.0), line(0.21))
    assert not apart
    apart, _ = shown(line(1.0), line(0.19))
    assert apart
    apart, _ = shown(line(0.19), line(1.0), line(1.0))
    assert apart
    apart, [plane, _] = shown(line(), page.film(T, cloud(0)))
    assert apart
    low, high = np.min(np.sin(T)), np.max(np.sin(T))
    scale = (WIDE - 2 * EDGE) / (high - low)
    assert page.near(plane, [WIDE / 2 - scale * (low + high) / 2, HIGH / 2])
    apart, _ = shown(page.film(T, cloud(0)), page.film(T, cloud(1)))
    assert not apart


@pytest.mark.parametrize(
    ("span", "usual", "slow", "fast"),
    [
        # The fastest is 64 times the usual speed, the slowest 1/256 of it.
        (1.0, "0.1×", "0.000391×", "6.4×"),
        (1.5, "1×", "0.00391×", "64×"),
        (90.0, "1×", "0.00391×", "64×"),
        (400.0, "50×", "0.195×", "3200×"),
        (1e-6, "1.0e-7×", "3.9e-10×", "6.4e-6×"),
        (9e-4, "0.0001×", "3.9e-7×", "0.0064×"),
    ],
)
def test_digits_of_the_speed(span, usual, slow, fast):
    t = np.linspace(0, span, 41)
    steps = [*QUIET, *[("key", "-")] * 9, ("key", "+"), *[("key", "+")] * 15]
    seen = page.played([line(t=t)], steps)
    texts = [one["texts"]["speed"] for one in seen]
    assert [texts[1], texts[10], texts[-1]] == [usual, slow, fast]
    if span >= 1.0:
        clock = f"t = 0 s of {page.digits(span, span / 200)}"
        assert seen[1]["texts"]["clock"] == clock


@pytest.mark.parametrize("end", [(3, 4), (-3, 4), (-2, -5), (4, -1), (4, 0), (-4, 0)])
def test_ground_is_hatched_below(end):
    made = page.film(
        T, {"a": [0, 0], "b": list(end), "c": ([T, 2 + 0 * T], [1 + 0 * T, 0 * T])},
        links=[("a", "b")],
    )  # fmt: skip
    seen = page.played([made], QUIET)[-1]
    line, *hatches = page.strokes(seen, op="stroke", colour="ground")
    first, last = page.ends(line)
    wanted = [page.screen(made, place)[0] for place in ([0, 0], end)]
    assert page.near([first, last], wanted)
    assert line["width"] == 2
    along = (last - first) / np.linalg.norm(last - first)
    # Backwards along it, and down to the side that is below.
    below = np.array([-along[1], along[0]]) * (1 if along[0] >= 0 else -1)
    assert below[1] >= 0
    assert len(hatches) == int((np.linalg.norm(last - first) - 8) // 9) + 1
    for k, hatch in enumerate(hatches):
        start, stop = page.ends(hatch)
        assert page.near(start, first + (8 + 9 * k) * along)
        assert page.near(stop - start, 7 * below - 7 * along)


@pytest.mark.parametrize(
    ("size", "count", "radius"),
    [
        (100.0, 2, 3.0),
        (300.0, 2, 6.0),
        (1000.0, 2, 11.0),
        (600.0, 12, 11.0),
        (600.0, 13, 6.6),
    ],
)
def test_points_are_as_large_as_the_picture(size, count, radius):
    tracks = {
        f"p{k}": ([np.cos(T), k + 0 * T], [-np.sin(T), 0 * T]) for k in range(count)
    }
    seen = page.played([page.film(T, tracks)], QUIET, size=[size, size])[-1]
    found = [one["path"][0][3] for one in page.strokes(seen, op="fill")]
    assert found[0] == pytest.approx(radius)


@pytest.mark.parametrize("count", [4, 5])
def test_plumb_lines_of_few_points_seen_from_above(count):
    tracks = dict(list(cloud(1).items())[:count])
    steps = [
        *QUIET,
        ("on", 0, "pointerdown", {"offsetX": 0, "offsetY": 0}),
        ("on", 0, "pointermove", {"offsetX": 0, "offsetY": -200}),
    ]
    seen = page.played([page.film(T, tracks)], steps)
    above, below = seen[1], seen[-1]
    plumb = [
        one for one in page.strokes(above, op="stroke", colour="ground") if one["dash"]
    ]
    assert len(plumb) == (count if count <= 4 else 0)
    assert len(page.strokes(above, op="fill", colour="shadow")) == count
    # From below, the floor would hide what stands on it.
    assert not page.strokes(below, op="fill", colour="shadow")
    assert not page.strokes(below, op="stroke", colour="faint")


def test_no_floor_through_the_motion():
    t = np.linspace(0, 6, 301)
    # One row in three hundred goes a thousand times as far, out of the view.
    for far, floor in ((0.0, True), (-1000.0, False), (1000.0, True)):
        z = np.where(np.arange(301) == 150, far, np.sin(t))
        tracks = {"a": ([np.cos(t), np.sin(t), z], [0 * t, 0 * t, 0 * t])}
        seen = page.played([page.film(t, tracks)], QUIET)[-1]
        assert bool(page.strokes(seen, op="fill", colour="floor")) is floor, far
        assert bool(page.strokes(seen, op="fill", colour="shadow")) is floor, far
    # All at one height: a grid, and no shadows under what lies on it.
    tracks = {"a": ([np.cos(t), np.sin(t), 0 * t], [-np.sin(t), np.cos(t), 0 * t])}
    seen = page.played([page.film(t, tracks)], QUIET)[-1]
    assert not page.strokes(seen, op="fill", colour="floor")
    assert not page.strokes(seen, op="fill", colour="shadow")
    assert page.strokes(seen, op="stroke", colour="faint")


def test_a_trail_with_a_gap():
    made = line()
    made.tracks["bob"].place[40:44] = np.nan
    steps = [*QUIET, ("hash", "#t=5"), ("key", "t")]
    seen = page.played([made], steps)[-1]
    [path] = page.strokes(seen, op="stroke", colour=COLOURS[0])
    moves = [k for k, one in enumerate(path["path"]) if one[0] == "moveTo"]
    assert len(moves) == 2
    assert all(np.isfinite(one[1:]).all() for one in path["path"])
    places = made.tracks["bob"].place[:, 0]
    scale = (WIDE - 2 * EDGE) / (np.nanmax(places) - np.nanmin(places))
    ends = path["path"][moves[1] - 1][1], path["path"][moves[1]][1]
    apart = scale * np.abs(np.sin(T[39]) - np.sin(T[44]))
    assert abs(abs(ends[0] - ends[1]) - apart) < 0.2 * apart


@pytest.mark.parametrize(("length", "turns"), [(1.0, 5), (4.0, 8), (9.0, 16)])
def test_springs_have_turns_by_their_usual_length(length, turns):
    """Usual lengths of 29, 120 and 270 pixels or so; another point is far away."""
    ball = [length * (1 + 0.3 * np.sin(T)), 0 * T]
    rates = [0.3 * length * np.cos(T), 0 * T]
    tracks = {"a": [0, 0], "far": [16.0, 0], "ball": (ball, rates)}
    made = page.film(T, tracks, links=[("a", "ball")])
    seen = page.played([made], [*QUIET, ("hash", "#t=1")])[-1]
    [coil] = [
        one
        for one in page.strokes(seen, op="stroke", colour="rod")
        if len(one["path"]) > 9
    ]
    corners = page.ends(coil)
    across = corners[:, 1] - HIGH / 2
    usual = np.median(ball[0]) * (WIDE - 2 * EDGE) / 16
    assert turns == min(16, max(5, round(usual / 15)))
    # 16 corners a turn: one of them is a fourth of a turn.
    wide = max(3.0, min(9.0, 0.055 * usual, 0.9 * 8.0))
    assert across.max() == pytest.approx(wide, abs=1e-6)
    assert len(corners) == turns * 16 + 3
