"""What stands around a picture: clock, bars, time line, mouse and keys; and space."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lagsim.notes import Event
from tests.outputs import node as page

pytestmark = page.needs_node

T = np.linspace(2, 8, 121)
LEVEL = page.LINE - 25
UNITS = {"length": "m", "energy": "J", "force": "N"}
MINUS = "\N{MINUS SIGN}"


def swing(t=T, size=1.0, **more):
    """x = a sin t: kinetic a^2 cos^2/2, potential a^2 sin^2/2 - a^2."""
    track = ([size * np.sin(t), 0 * t], [size * np.cos(t), 0 * t])
    more.setdefault("energies", {
        "kinetic": size**2 * np.cos(t) ** 2 / 2,
        "potential": size**2 * (np.sin(t) ** 2 / 2 - 1),
        "energy": size**2 * (0 * t - 0.5),
    })  # fmt: skip
    return page.film(t, {"bob": track, "wall": [0, -1]}, units=UNITS, **more)


def at(t):
    """Where a time stands on the time line."""
    return 12 + (page.LONG - 24) * (t - 2) / 6


@pytest.mark.parametrize("t", [2.0, 3.5, 5.025, 8.0])
def test_clock_and_handle(t):
    [*_, seen] = page.played([swing()], [*page.QUIET, ("hash", f"#t={t}")])
    assert seen["texts"]["clock"] == f"t = {t:.3f} s of 8.00"
    [handle] = page.arcs(seen, 1, op="fill", colour="accent")[-1:]
    assert page.near(handle, [at(t), LEVEL, 8])
    assert float(seen["line"]["aria-valuenow"]) == float(seen["data"]["t"]) == t
    assert seen["line"]["aria-valuemin"] == "2"
    assert seen["line"]["aria-valuemax"] == "8"
    assert seen["line"]["aria-valuetext"] == f"t = {t:.3f} s"
    [edge] = page.strokes(seen, 1, op="fill", colour="edge")
    gone = page.strokes(seen, 1, op="fill", colour="accent")[0]
    assert page.near(edge["path"][0][1:5], [12, LEVEL - 3, page.LONG - 24, 6])
    assert page.near(gone["path"][0][1:5], [12, LEVEL - 3, max(1, at(t) - 12), 6])


@pytest.mark.parametrize("t", [2.0, 3.5, 5.0])
def test_bars(t):
    seen = page.played([swing()], [*page.QUIET, ("hash", f"#t={t}")])[-1]
    # All of them from the least energy, -1, to the greatest, nearly 1/2.
    low, high = np.min(np.sin(T) ** 2 / 2 - 1), np.max(np.cos(T) ** 2 / 2)
    values = {
        "kinetic": np.cos(t) ** 2 / 2,
        "potential": np.sin(t) ** 2 / 2 - 1,
        "energy": -0.5,
    }  # fmt: skip
    assert [bar["label"] for bar in seen["bars"]] == list(values)
    for bar, value, colour in zip(
        seen["bars"], values.values(), ("kinetic", "potential", "total"), strict=True
    ):
        zero = -100 * low / (high - low)
        assert float(bar["zero"][8:-1]) == pytest.approx(zero, abs=1e-4)
        assert bar["colour"] == f"background: var(--{colour})"
        long = 100 * abs(value) / (high - low)
        begin = zero if value > 0 else zero - long
        assert float(bar["--from"][:-1]) == pytest.approx(begin, abs=1e-3)
        assert float(bar["--long"][:-1]) == pytest.approx(long, abs=1e-3)
        number, unit = bar["value"].replace(MINUS, "-").split()
        assert float(number) == pytest.approx(value, rel=1e-3)
        assert unit == "J"


def test_kinetic_energy_behind_the_time_line():
    [*_, seen] = page.played([swing()], page.QUIET)
    [hill] = page.strokes(seen, 1, op="fill", colour="kinetic")
    assert hill["alpha"] == 0.22
    found = page.ends(hill)
    assert page.near(found[[0, -1]], [[at(2), LEVEL], [at(8), LEVEL]])
    x, y = found[1:-1].T
    t = 2 + 6 * (x - 12) / (page.LONG - 24)
    # A step of the rows is 0.05, in which cos^2 changes by that much at most.
    wanted = LEVEL - (LEVEL - 12) * np.cos(t) ** 2
    assert page.near(y, wanted, 0.06 * (LEVEL - 12))
    assert y.min() == pytest.approx(12)


def test_marks_of_events_and_no_forecast():
    events = [
        *(Event(t, "impact", "wall") for t in (3.0, 3.001, 5.0)),
        Event(4.0, "release", "wall"), Event(7.0, "strange"), Event(6.0, "until"),
    ]  # fmt: skip
    made = swing(events=events, horizon=6.5)
    hover = ("on", 1, "pointermove", {"buttons": 0, "offsetX": at(3)})
    [*_, seen] = page.played([made], [*page.QUIET, hover])
    found = [
        one for one in seen["drawn"][1] if one.get("path", [["none"]])[0][0] == "shape"
    ]
    # Marks on each other are one; a release is hollow; what has no look has a line.
    assert [(one["op"], one["colour"]) for one in found] == [
        ("fill", "force"), ("fill", "force"), ("stroke", "potential"), ("fill", "dim"),
    ]  # fmt: skip
    for one, t in zip(found, (3, 5, 4, 7), strict=True):
        assert page.near(one["at"], [at(t), LEVEL - 11])
    assert seen["texts"]["legend"] == "impact (3)release (1)strange (1)kinetic energy"
    assert seen["titles"][1].split("\n") == [
        "t = 3.000 s: impact wall", "t = 3.001 s: impact wall",
    ]  # fmt: skip
    [clip] = page.strokes(seen, 1, op="clip")
    assert page.near(clip["path"][0][1:], [at(6.5), 2, at(8) - at(6.5), LEVEL - 2])
    [text] = page.strokes(seen, 1, text="no forecast from here on")
    assert (text["align"], text["y"]) == ("right", 3)
    assert text["x"] == pytest.approx(at(6.5) - 5)
    [hatch, *_] = page.strokes(seen, 1, op="stroke", colour="ground")
    assert page.near(page.ends(hatch), [[at(6.5) - LEVEL, LEVEL], [at(6.5), 0]])
    early = page.played([swing(horizon=3.0)], page.QUIET)[-1]
    [text] = page.strokes(early, 1, text="no forecast from here on")
    assert (text["align"], text["x"]) == ("left", at(3) + 5)


def test_the_lagrangian_has_its_colour_in_the_picture_of_energies():
    for others, colour in ((("kinetic",), "potential"), ((), "kinetic")):
        energies = dict.fromkeys((*others, "lagrangian", "energy"), 0 * T)
        seen = page.played([swing(energies=energies)], page.QUIET)[-1]
        [bar] = [bar for bar in seen["bars"] if bar["label"] == "lagrangian"]
        assert bar["colour"] == f"background: var(--{colour})"


@pytest.mark.parametrize("end", [8e4, 2e6])
def test_the_last_number_is_whole(end):
    [*_, seen] = page.played([swing(T / 8 * end)], page.QUIET)
    texts = page.strokes(seen, 1, op="fillText", colour="dim")
    assert [one["text"].endswith(" s") for one in texts] == [False] * (
        len(texts) - 1
    ) + [True]
    # A letter is 6 pixels wide here.
    [*_, last] = texts
    assert last["x"] + 3 * len(last["text"]) <= page.LONG
    assert last["x"] - 3 * len(last["text"]) > texts[-2]["x"] + 3 * len(
        texts[-2]["text"]
    )


def test_play_loop_and_speed():
    frames = [("frame", 1000 + 50 * k) for k in range(3)]
    steps = [*frames, ("frame", 5000), ("key", "+"), ("frame", 5050)]
    steps += [("key", "-"), ("key", "-"),
             ("frame", 5100)]  # fmt: skip
    seen = page.played([swing()], steps)
    times = [float(one["data"]["t"]) for one in seen]
    # A long pause between two frames is not caught up; "+" doubles, "-" halves.
    wanted = [2, 2, 2.05, 2.1, 2.2, 2.2, 2.3, 2.3, 2.3, 2.325]
    assert page.near(times, wanted, 1e-9)
    speeds = [one["texts"]["speed"] for one in seen]
    assert [speeds[0], speeds[5], speeds[-1]] == ["1×", "2×", "0.5×"]
    # At the end it rests 0.8 s, then begins anew; where it does not, it stops.
    tail = [
        ("key", "End"),
        ("key", "l"),
        ("key", "l"),
        ("key", "ArrowLeft"),
        ("key", " "),
    ]
    rest = [("frame", 100 * k) for k in range(12)]
    seen = page.played([swing()], [*tail, *rest])
    times = [float(one["data"]["t"]) for one in seen[-12:]]
    assert times[0] == 8 - 0.03
    assert times[1] == 8
    assert times.index(2) == 11 - times[::-1].index(8) + 1 == 10
    seen = page.played(
        [swing()],
        [("key", "l"), ("key", "End"), ("key", "ArrowLeft"), ("key", " "), *rest],
    )
    assert {float(one["data"]["t"]) for one in seen[-11:]} == {8}
    assert seen[-1]["pressed"]["loop"] == "false"


def test_keys_and_line():
    events = [Event(3.0, "impact"), Event(5.0, "impact")]
    names = ["End", "ArrowLeft", "Home", "PageDown", "PageDown", "PageUp", "ArrowRight"]
    steps = [("key", name) for name in names]
    steps.append(("key", "ArrowLeft", {"shiftKey": True}))
    steps += [("key", "Home", {"ctrlKey": True})]
    steps += [("on", 1, "pointerdown", {"offsetX": x}) for x in (at(4), 0, page.LONG)]
    steps += [("on", 1, "pointermove", {"offsetX": at(7), "buttons": 1})]
    seen = page.played([swing(events=events)], steps)
    times = [float(one["data"]["t"]) for one in seen]
    assert page.near(
        times, [2, 8, 7.97, 2, 3, 5, 3, 3.03, 2.73, 2.73, 4, 2, 8, 7], 1e-9
    )
    assert not seen[0]["hidden"]["jumps"]


def test_drag_wheel_and_reset():
    made = swing()
    start, _scale = page.screen(made, [np.sin(2), 0])
    press = {"offsetX": 100, "offsetY": 100}
    steps = [
        *page.QUIET, ("on", 0, "pointerdown", press),
        ("on", 0, "pointermove", {"offsetX": 130, "offsetY": 80}),
        ("on", 0, "pointerup", {}),
        ("on", 0, "wheel", {"deltaY": -200, "offsetX": 50, "offsetY": 60}),
        ("on", 0, "dblclick", {}),
        ("on", 0, "wheel", {"deltaY": 100, "offsetX": 50, "offsetY": 60}),
        ("key", "0"),
    ]  # fmt: skip
    seen = page.played([made], steps)
    dots = [
        np.array(page.arcs(one, op="fill", colour="#0072B2")[0][:2]) for one in seen
    ]
    moved = np.add(start, (30, -20))
    assert page.near(dots[3], moved)
    wheel = np.array([50, 60]) + np.exp(0.3) * (moved - [50, 60])
    assert page.near(dots[5], wheel)
    assert page.near(dots[6], start)
    assert page.near(dots[8], start)


def test_many_runs_and_one_picture():
    late = np.linspace(2, 5, 61)
    one, other = swing(name="one"), swing(late, size=2.0, name="other")
    steps = [*page.QUIET, ("hash", "#t=6"), ("key", "o")]
    [*_, seen, together] = page.played([one, other], steps)
    assert seen["panels"][1]["classes"] == ["ended"]
    assert [p["hidden"] for p in seen["panels"]] == [False, False, True]
    assert [p["hidden"] for p in together["panels"]] == [True, True, False]
    # One scale, that of the greater; the second stays where it ended.
    box = [2 * np.sin(late).min(), 2 * np.sin(late).max()]
    assert np.min(box) < np.sin(T).min()
    edge = min(64.0, 0.14 * page.HIGH)
    size = min((page.WIDE - 2 * edge) / (box[1] - box[0]), (page.HIGH - 2 * edge) / 1.0)
    middle = (box[0] + box[1]) / 2
    for canvas, x in ((0, np.sin(6)), (1, 2 * np.sin(5))):
        [dot] = page.arcs(seen, canvas, op="fill", colour="#0072B2")
        assert page.near(
            dot[:2], [page.WIDE / 2 + size * (x - middle), page.HIGH / 2 - size * 0.5]
        )
    for colour, x in (("#0072B2", np.sin(6)), ("#D55E00", 2 * np.sin(5))):
        [dot] = page.arcs(together, 2, op="fill", colour=colour)
        assert page.near(
            dot[:2], [page.WIDE / 2 + size * (x - middle), page.HIGH / 2 - size * 0.5]
        )
    points = json.loads(seen["data"]["points"])
    assert set(points) == {"one/bob", "one/wall", "other/bob", "other/wall"}
    # The same bar is the same energy.
    low, high = (
        f(f(m.energies[k]) for m in (one, other) for k in m.energies)
        for f in (min, max)
    )
    assert float(seen["bars"][0]["--long"][:-1]) == pytest.approx(
        100 * np.cos(6) ** 2 / 2 / (high - low), abs=1e-3
    )


def space():
    """A helix about z, from z = 0 to 3."""
    t = T
    place = [np.cos(t), 2 * np.sin(t), (t - 2) / 2]
    rate = [-np.sin(t), 2 * np.cos(t), 0.5 + 0 * t]
    return page.film(
        t, {"bead": (place, rate), "foot": [0, 0, 0]}, links=[("foot", "bead")]
    )


@pytest.mark.parametrize("drag", [None, (50.0, 0.0), (0.0, 40.0), (-30.0, -20.0)])
def test_space_is_turned(drag):
    steps = [*page.QUIET, ("hash", "#t=5.025")]
    azimuth, height = -0.96, 0.34
    if drag:
        steps += [
            ("on", 0, "pointerdown", {"offsetX": 0, "offsetY": 0}),
            ("on", 0, "pointermove", {"offsetX": drag[0], "offsetY": drag[1]}),
        ]
        azimuth, height = azimuth - 0.008 * drag[0], height + 0.008 * drag[1]
    made = space()
    seen = page.played([made], steps)[-1]
    # Rotations about z and about the horizontal: x to the right, z upwards.
    c, s = np.cos(azimuth), np.sin(azimuth)
    right = np.array([-s, c, 0])
    towards = np.array([np.cos(height) * c, np.cos(height) * s, np.sin(height)])
    up = np.cross(towards, right)
    every = np.concatenate([track.place for track in made.tracks.values()])
    low, high = every.min(axis=0), every.max(axis=0)
    wide = np.hypot(*(high - low)[:2])
    tall = (high - low)[2] * np.cos(0.34) + wide * np.sin(0.34)
    edge = min(64.0, 0.14 * page.HIGH)
    size = min((page.WIDE - 2 * edge) / wide, (page.HIGH - 2 * edge) / tall)

    def pixels(place):
        far = np.array(place) - (low + high) / 2
        return [page.WIDE / 2 + size * right @ far, page.HIGH / 2 - size * up @ far]

    t = 5.025
    bead = [np.cos(t), 2 * np.sin(t), (t - 2) / 2]
    [dot] = page.arcs(seen, op="fill", colour="#0072B2")
    assert page.near(dot[:2], pixels(bead), 2e-3)
    [rod] = page.strokes(seen, op="stroke", colour="rod")
    assert page.near(page.ends(rod)[[0, -1]], [pixels([0, 0, 0]), pixels(bead)], 2e-3)
    below = [*bead[:2], 0]
    [ellipse] = [
        one["path"][0] for one in page.strokes(seen, op="fill", colour="shadow")
    ]
    assert page.near(ellipse[1:3], pixels(below), 2e-3)
    assert ellipse[4] / ellipse[3] == pytest.approx(max(0.2, np.sin(height)))
    [plumb] = [
        one for one in page.strokes(seen, op="stroke", colour="ground") if one["dash"]
    ]
    assert page.near(page.ends(plumb), [pixels(bead), pixels(below)], 2e-3)
    shadow = page.strokes(seen, op="stroke", colour="shadow")
    assert page.near(page.ends(shadow[-1]), [pixels([0, 0, 0]), pixels(below)], 2e-3)
    for name, axis in zip("xyz", np.eye(3), strict=True):
        [text] = page.strokes(seen, op="fillText", text=name)
        wanted = [page.WIDE - 48 + 39 * right @ axis, page.HIGH - 46 - 39 * up @ axis]
        assert page.near([text["x"], text["y"]], wanted)
    # The floor has lines at round steps, ten or so, around all that is shown.
    reach = 0.6 * max(high - low)
    assert 0.2 < reach / 5 <= 0.5
    (west, east), (south, north) = (
        (0.5 * np.floor(2 * a + 1e-6), 0.5 * np.ceil(2 * b - 1e-6))
        for a, b in zip(low[:2], high[:2], strict=True)
    )
    wanted = [
        [pixels([x, south, 0]), pixels([x, north, 0])]
        for x in np.arange(west, east + 0.1, 0.5)
    ]
    wanted += [
        [pixels([west, y, 0]), pixels([east, y, 0])]
        for y in np.arange(south, north + 0.1, 0.5)
    ]
    lines = page.strokes(seen, op="stroke", colour="faint")
    assert page.near([page.ends(line) for line in lines], wanted, 1e-3)
    [square] = page.strokes(seen, op="fillRect", colour="ground")
    assert page.near(square["box"], [*np.array(pixels([0, 0, 0])) - 4, 8, 8])


def test_pixels_of_a_fine_screen():
    seen = page.played([swing()], page.QUIET, ratio=2)[-1]
    assert seen["transforms"] == [[2, 0, 0, 2, 0, 0]] * 2
    assert seen["sizes"] == [
        [2 * page.WIDE, 2 * page.HIGH],
        [2 * page.LONG, 2 * page.LINE],
    ]
