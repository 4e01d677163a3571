"""What the page draws of a plane, call by call, against closed forms of the motion."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lagsim.notes import Event
from lagsim.outputs.animation.pushes import Push
from tests.outputs import node as page

if TYPE_CHECKING:
    from lagsim.outputs.animation.film import Film

pytestmark = page.needs_node

T = np.linspace(0, 6, 121)
FIRST = "#0072B2"
# Of `page.HIGH`: the radius of a point, and the length of the usual force.
RADIUS, USUAL = 0.02 * page.HIGH, 0.18 * page.HIGH


def rim(t):
    """Where a point of a circle about (1, -2) is; its velocity beside it."""
    t = np.asarray(t, float)
    return [1 + 3 * np.cos(t), -2 + 3 * np.sin(t)], [-3 * np.sin(t), 3 * np.cos(t)]


def circle(**more) -> Film:
    tracks = {"hub": [1, -2], "rim": rim(T)}
    more.setdefault("links", [("hub", "rim")])
    return page.film(
        T, tracks, units={"length": "m", "energy": "J", "force": "N"}, **more
    )


def pulled(size) -> list[Push]:
    """A force towards the hub, of so many N at each time."""
    force = -np.stack([np.cos(T), np.sin(T)], axis=1) * np.reshape(size, (-1, 1))
    return [Push("rod", "rim", np.broadcast_to(force, (len(T), 2)))]


# Half way between two frames too, where the motion goes between rows.
@pytest.mark.parametrize("t", [0.0, 1.0, 2.525, 4.7123])
def test_points_and_rod(t):
    [*_, seen] = page.played([circle()], [*page.QUIET, ("hash", f"#t={t}")])
    place = rim(t)[0]
    wanted, _ = page.screen(circle(), place)
    hub, _ = page.screen(circle(), [1, -2])
    [dot] = page.arcs(seen, op="fill", colour=FIRST)
    assert page.near(dot, [*wanted, RADIUS], 2e-3)
    assert page.arcs(seen, op="stroke", colour="card")[-1] == dot
    [rod] = page.strokes(seen, op="stroke", colour="rod", width=0.34 * RADIUS)
    assert page.near(page.ends(rod), [hub, wanted], 2e-3)
    points = json.loads(seen["data"]["points"])
    assert np.allclose(points["rim"], place, atol=1e-5)
    assert points["hub"] == [1, -2]
    # A light that comes from the left and above.
    [shine] = page.arcs(seen, colour="rgba(255, 255, 255, .5)")
    x, y, radius = dot
    light = [x - 0.3 * radius, y - 0.32 * radius, 0.28 * radius]
    assert page.near(shine, light, 1e-6)


def test_support_below_and_above():
    tracks = {"low": [0, -1], "high": [0, 1], "bob": ([T, 0 * T], [1 + 0 * T, 0 * T])}
    made = page.film(T, tracks, links=[("low", "bob"), ("high", "bob")])
    [*_, seen] = page.played([made], page.QUIET)
    for name, side in (("low", 1), ("high", -1)):
        [x, y], _ = page.screen(made, made.tracks[name].place[0])
        # A triangle from the point outwards, and a line there, longer than it.
        [triangle] = [
            one for one in page.strokes(seen, op="fill", colour="ground")
            if page.near(one["path"][0][1:], [x, y])
        ]  # fmt: skip
        _tip, left, right = page.ends(triangle)
        assert np.isclose(left[1], right[1])
        assert side * (left[1] - y) > RADIUS
        assert np.isclose(left[0] + right[0], 2 * x)
        assert left[0] < x
        assert triangle["alpha"] == 0.45
        grounds = [
            page.ends(one) for one in page.strokes(seen, op="stroke", colour="ground")
        ]
        [bar] = [e for e in grounds if np.allclose(e[:, 1], left[1])]
        assert bar[0, 0] < left[0]
        assert bar[1, 0] > right[0]
        hatches = [
            e for e in grounds if np.isclose(e[0, 1], left[1]) and e[1, 1] != e[0, 1]
        ]
        assert len(hatches) >= 4
        assert all(side * (b - a)[1] == pytest.approx(5) for a, b in hatches)
        pins = [[*page.screen(made, p)[0], 4] for p in ([0, -1], [0, 1])]
        assert page.near(page.arcs(seen, op="fill", colour="card"), pins)


@pytest.mark.parametrize("t", [1.0, 2.525])
def test_arrow_of_a_force(t):
    made = circle(pushes=pulled(2.0))
    [*_, seen] = page.played([made], [*page.QUIET, ("hash", f"#t={t}")])
    place, _ = rim(t)
    start, _ = page.screen(made, place, forces=True)
    # Inwards; upwards on the screen is a smaller number.
    inwards = np.array([-np.cos(t), np.sin(t)])
    head, legend = page.strokes(seen, op="fill", colour="force")
    shaft, other = page.strokes(seen, op="stroke", colour="force")
    tip, left, right = page.ends(head)
    assert page.near(tip, start + USUAL * inwards, 0.02)
    assert page.near(page.ends(shaft), [start, start + (USUAL - 11) * inwards], 0.02)
    assert page.near((left + right) / 2, start + (USUAL - 11) * inwards, 0.02)
    assert np.linalg.norm(left - right) == pytest.approx(2 * 0.42 * 11)
    # What an arrow of a round length stands for: so many N have the same pixels.
    [text] = page.strokes(seen, op="fillText", text="constraint force 1 N")
    assert page.near(page.ends(other)[0], [46, page.HIGH - 34])
    assert page.near(page.ends(legend)[0], [46 + USUAL / 2, page.HIGH - 34], 1e-3)
    assert page.near([text["x"], text["y"]], [54 + USUAL / 2, page.HIGH - 34], 1e-3)


def test_forces_small_long_and_none():
    size = np.full(len(T), 2.0)
    # At 1 s five times the usual one, at 2 s a hundredth of it, at 3 s none.
    size[20], size[40], size[60] = 10.0, 0.02, 0.0
    steps = [*page.QUIET, *(("hash", f"#t={t}") for t in (1, 2, 3)), ("key", "f")]
    made = circle(pushes=pulled(size))
    [*_, long, small, none, off] = page.played([made], steps)
    start, _ = page.screen(made, rim(1.0)[0], forces=True)
    inwards = np.array([-np.cos(1), np.sin(1)])
    head, _ = page.strokes(long, op="fill", colour="force")
    assert page.near(page.ends(head)[0], start + 1.5 * USUAL * inwards, 0.02)
    first, second, _ = page.strokes(long, op="stroke", colour="force")
    gap = page.ends(second)[0] - page.ends(first)[1]
    assert page.near(gap, 5 * inwards, 0.02)
    for seen in (small, none):
        assert len(page.strokes(seen, op="fill", colour="force")) == 1
    assert not page.strokes(off, op="fill", colour="force")
    assert off["pressed"]["forces"] == "false"
    assert not off["hidden"]["forces"]


def test_names_where_asked():
    made = circle()
    [first, *_, seen] = page.played([made], [*page.QUIET, ("key", "n")])
    assert not page.strokes(first, text="rim")
    for name, place in (("rim", rim(0)[0]), ("hub", [1, -2])):
        [x, y], _ = page.screen(made, place)
        for op, colour in (("strokeText", "card"), ("fillText", "ink")):
            [text] = page.strokes(seen, op=op, colour=colour, text=name)
            assert page.near([text["x"], text["y"]], [x + RADIUS + 5, y - RADIUS])
            assert text["align"] == "left"


@pytest.mark.parametrize("passed", [0.0, 0.07, 0.28])
def test_ring_where_something_struck(passed):
    events = [Event(2.0, "impact", "wall"), Event(2.0, "release", "other")]
    made = circle(events=events, struck={"wall": ["rim"], "other": ["hub"]})
    steps = [*page.QUIET, *(("hash", f"#t={t}") for t in (1.99, 2 + passed, 2.36))]
    [*_, early, seen, late] = page.played([made], steps)
    age = passed / 0.35
    wanted, _ = page.screen(made, rim(2 + passed)[0])
    [ring] = page.arcs(seen, op="stroke", colour="force")
    assert page.near(ring, [*wanted, RADIUS * (1.2 + 2.4 * age)], 2e-3)
    [one] = page.strokes(seen, op="stroke", colour="force")
    assert one["alpha"] == pytest.approx(1 - age)
    assert one["width"] == pytest.approx(3 * (1 - age) + 0.5)
    assert not page.arcs(early, colour="force")
    assert not page.arcs(late, colour="force")
    assert seen["texts"]["legend"] == "impact (1)"  # the release is part of it


def test_trails():
    made = circle()
    steps = [*page.QUIET, ("hash", "#t=5"), ("key", "t"), ("key", "t")]
    [*_, fading, whole, none] = page.played([made], steps)
    [path] = page.strokes(whole, op="stroke", colour=FIRST)
    found = page.ends(path)
    # All of it lies on the circle, from the start to now, in the sense of the motion.
    hub, scale = page.screen(made, [1, -2])
    angle = np.unwrap(np.arctan2(hub[1] - found[:, 1], found[:, 0] - hub[0]))
    assert page.near(np.hypot(*(found - hub).T), 3 * scale, 2e-3)
    assert page.near([angle[0], angle[-1]], [0, 5], 1e-4)
    assert (np.diff(angle) > 0).all()
    # The last 0.35 of the run, thicker and stronger towards now.
    pieces = page.strokes(fading, op="stroke", colour=FIRST)
    assert len(pieces) == 24
    first, last = page.ends(pieces[0])[0], page.ends(pieces[-1])[-1]
    assert page.near(first, page.screen(made, rim(5 - 0.35 * 6)[0])[0], 2e-3)
    assert page.near(last, page.screen(made, rim(5)[0])[0], 2e-3)
    for key in ("alpha", "width"):
        assert (np.diff([piece[key] for piece in pieces]) > 0).all()
    assert pieces[-1]["alpha"] == 0.75
    assert not page.strokes(none, op="stroke", colour=FIRST)
    names = [seen["texts"]["trails"] for seen in (fading, whole, none)]
    assert names[1:] == ["Whole path", "No trails"]


def test_grid():
    made = circle()
    [*_, seen] = page.played([made], page.QUIET)
    lines = [page.ends(one) for one in page.strokes(seen, op="stroke", colour="grid")]
    (_, scale) = page.screen(made, [0, 0])
    # Round steps of at least 110 pixels.
    step = min(s for s in (1, 2, 5) if s * scale >= 110)
    for axis, size in ((0, page.WIDE), (1, page.HIGH)):
        found = [e[0, axis] for e in lines if e[0, axis] == e[1, axis]]
        wanted = [page.screen(made, [k * step] * 2)[0][axis] for k in range(-20, 20)]
        wanted = sorted(w for w in wanted if 0 <= w <= size)
        assert page.near(sorted(found), np.round(wanted) + 0.5)
    for text in page.strokes(seen, op="fillText", colour="dim"):
        if text["text"] == "m":
            continue
        value = float(text["text"].replace("\N{MINUS SIGN}", "-"))
        x, y = np.round(page.screen(made, [value, value])[0]) + 0.5
        wanted = [x, page.HIGH - 6] if text["align"] == "center" else [7, y]
        assert page.near([text["x"], text["y"]], wanted)
    # Labels keep clear of the edges and of each other.
    texts = list(page.strokes(seen, op="fillText", colour="dim"))
    for align, axis, low, high in (
        ("center", 0, 44, page.WIDE - 24),
        ("left", 1, 12, page.HIGH - 22),
    ):
        found = {one["text"] for one in texts if one["align"] == align} - {"m"}
        places = {
            k * step: page.screen(made, [k * step] * 2)[0][axis] for k in range(-9, 9)
        }
        wanted = {value for value, at in places.items() if low < at + 0.5 < high}
        assert {float(x.replace("\N{MINUS SIGN}", "-")) for x in found} == wanted
    assert page.strokes(seen, op="fillText", text="m")


def test_spring_and_string():
    t = T
    ball = [2 + np.cos(t), 0 * t], [-np.sin(t), 0 * t]
    rope = [np.minimum(2.0, 2 + np.sin(t)), 0 * t - 1], [0 * t, 0 * t]
    tracks = {"a": [0, 0], "ball": ball, "b": [0, -1], "end": rope}
    made = page.film(
        t, tracks, links=[("a", "ball"), ("b", "end")], struck={"taut": ["end"]}
    )
    [*_, seen] = page.played([made], [*page.QUIET, ("hash", "#t=4.7")])
    [coil] = [one for one in page.strokes(seen, op="stroke", colour="rod", width=1.6)
              if one["path"][0][0] == "lineTo" and len(one["path"]) > 9]  # fmt: skip
    corners = page.ends(coil)
    start, scale = page.screen(made, [0, 0])
    stop, _ = page.screen(made, [2 + np.cos(4.7), 0])
    assert page.near(corners[[0, -1]], [start, stop], 2e-3)
    across = corners[:, 1] - start[1]
    assert 3 <= across.max() <= 9
    assert across.max() == pytest.approx(-across.min())
    # As many turns as 15 pixels go into the usual length.
    usual = np.median(2 + np.cos(t)) * scale
    turns = int(np.sum((across[:-1] <= 1e-9) & (across[1:] > 1e-9)))
    assert turns == min(16, max(5, round(usual / 15)))
    [rope_drawn] = [one for one in page.strokes(seen, op="stroke", colour="rod")
                    if one["path"][-1][0] == "quadraticCurveTo"]  # fmt: skip
    (_, *first), (_, mx, my, *last) = rope_drawn["path"]
    apart = float(np.interp(4.7, t, 2 + np.sin(t)))
    one, _ = page.screen(made, [0, -1])
    other, _ = page.screen(made, [apart, -1])
    assert page.near([first, last], [one, other], 1e-2)
    # Below the middle, the more so the nearer the ends.
    sag = 0.86 * np.sqrt(4 - apart**2) * scale
    assert page.near([mx, my], [(one[0] + other[0]) / 2, one[1] + sag], 1e-2)


def test_a_break_goes_straight_and_a_gap_is_no_point():
    broken = np.zeros(len(T), bool)
    broken[20] = True
    made = circle(broken=broken)
    place, _ = made.tracks["rim"]
    wanted = (place[20] + place[21]) / 2
    [*_, seen] = page.played([made], [*page.QUIET, ("hash", "#t=1.025")])
    [dot] = page.arcs(seen, op="fill", colour=FIRST)
    assert page.near(dot[:2], page.screen(made, wanted)[0])
    lost = circle()
    lost.tracks["rim"].place[20] = np.nan
    [*_, seen] = page.played([lost], [*page.QUIET, ("hash", "#t=1")])
    assert not page.arcs(seen, op="fill", colour=FIRST)


def test_colours_of_many_points():
    def row(count):
        tracks = {
            f"p{k}": ([np.cos(T), k + 0 * T], [-np.sin(T), 0 * T]) for k in range(count)
        }
        [*_, seen] = page.played([page.film(T, tracks)], page.QUIET, dark=count == 20)
        found = page.strokes(seen, op="fill")
        return [one for one in found if one["colour"] != "rgba(255, 255, 255, .5)"]

    few, many = row(6), row(20)
    assert len({one["colour"] for one in few}) == len(few) == 6
    # From one hue to another, and smaller.
    hues = [float(one["colour"][4:].split()[0]) for one in many]
    assert page.near([hues[0], hues[-1]], [205, 20])
    assert (np.diff(hues) < 0).all()
    assert many[0]["path"][0][3] == pytest.approx(0.011 * page.HIGH)
