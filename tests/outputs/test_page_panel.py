"""Elements around a picture: clock, bars, line of time, buttons, keys and mouse."""

import json

import numpy as np
import pytest

from lagsim.notes import Event
from lagsim.outputs.animation.carriers import Push
from tests.outputs import node as page
from tests.outputs.node import (
    FIRST,
    HIGH,
    LEVEL,
    LINE,
    LONG,
    SECOND,
    WIDE,
    Screen,
    at,
    dot,
    ends,
    fills,
    keys,
    labels,
    near,
    number,
    shown,
    stopped,
    strokes,
    times,
)

pytestmark = page.needs_node

T = np.linspace(2, 8, 121)
MINUS = "\N{MINUS SIGN}"
ENERGIES = ("kinetic", "potential", "lagrangian", "energy", "work")


def energetic(t=T, size=1.0, **more):
    """x = a sin t: kinetic a^2 cos^2/2, potential a^2 sin^2/2 - a^2."""
    energies = {
        "kinetic": size**2 * np.cos(t) ** 2 / 2,
        "potential": size**2 * (np.sin(t) ** 2 / 2 - 1),
        "energy": size**2 * (0 * t - 0.5),
    }
    more = {"energies": energies, "units": {"energy": "J"}} | more
    return page.swing((t[0], t[-1]), len(t), size, **more)


def place(t, first=2.0, last=8.0):
    """Where a time stands on the line of time."""
    return 12 + (LONG - 24) * (t - first) / (last - first)


def hover(t):
    return "on", 1, "pointermove", {"buttons": 0, "offsetX": place(t)}


@pytest.mark.parametrize("t", [2.0, 3.5, 5.025, 8.0])
def test_clock_and_handle(t):
    seen = shown(energetic(), at(t))
    assert seen["texts"]["clock"] == f"t = {t:.3f} s of 8.00"
    gone, handle = fills(seen, "accent", 1)
    assert near(handle["path"][0][1:4], [place(t), LEVEL, 8])
    assert seen["line"] | {
        "aria-valuenow": f"{t:g}", "aria-valuemin": "2", "aria-valuemax": "8",
        "aria-valuetext": f"t = {t:.3f} s",
    } == seen["line"]  # fmt: skip
    assert times([seen]) == [t]
    [edge] = fills(seen, "edge", 1)
    assert near(edge["path"][0][1:5], [12, LEVEL - 3, LONG - 24, 6])
    assert near(gone["path"][0][1:5], [12, LEVEL - 3, max(1, place(t) - 12), 6])


@pytest.mark.parametrize("t", [2.0, 3.5, 5.0, 5.02])
def test_bars(t):
    seen = shown(energetic(), at(t))
    # All of them from the least energy, -1, to the greatest, nearly 1/2.
    kinetic, potential = np.cos(T) ** 2 / 2, np.sin(T) ** 2 / 2 - 1
    low, high = np.min(potential), np.max(kinetic)
    zero = -100 * low / (high - low)
    # Straight between the rows, which are 0.05 apart.
    wanted = [
        ("kinetic", np.interp(t, T, kinetic), "kinetic"),
        ("potential", np.interp(t, T, potential), "potential"),
        ("energy", -0.5, "total"),
    ]
    for bar, (name, value, colour) in zip(seen["bars"], wanted, strict=True):
        assert bar["label"] == name
        assert bar["colour"] == f"background: var(--{colour})"
        long = 100 * abs(value) / (high - low)
        sides = float(bar["--from"][:-1]), float(bar["--long"][:-1])
        assert sides == pytest.approx((zero - long * (value < 0), long), abs=1e-3)
        assert float(bar["zero"][8:-1]) == pytest.approx(zero, abs=1e-4)
        digits, unit = bar["value"].split()
        assert (number(digits), unit) == (pytest.approx(value, rel=1e-3), "J")


def test_bars_of_energies_far_from_zero_show_their_change_since_the_start():
    plain, far = energetic(), energetic()
    for name in ("potential", "energy"):
        far.energies[name] = far.energies[name] + 4096.0
    (t,) = T[[34]]
    seen, wanted = (shown(made, at(t))["bars"] for made in (far, plain))
    # V starts at V0, and is drawn less V0, T + V too: all between -1/2 and 1/2, where
    # T goes from cos(2)^2/2 to 1/2 and V - V0 from there down.
    kinetic, potential = np.cos(T) ** 2 / 2, np.sin(T) ** 2 / 2
    change = potential - potential[0]
    low, high = np.min(change), np.max([kinetic, kinetic + change])
    zero = -100 * low / (high - low)
    for bar, one, value in zip(
        seen, wanted, (kinetic[34], change[34], kinetic[34] + change[34]), strict=True
    ):
        long = 100 * abs(value) / (high - low)
        sides = float(bar["--from"][:-1]), float(bar["--long"][:-1])
        assert sides == pytest.approx((zero - long * (value < 0), long), abs=0.05)
        # The number is that of the whole energy.
        digits, _ = bar["value"].split()
        shift = 4096.0 * (one["label"] != "kinetic")
        whole = number(one["value"].split()[0]) + shift
        assert number(digits) == pytest.approx(whole, rel=1e-3)


def test_thousands_of_events_are_no_black_band():
    events = [Event(t, "switch", switch="road") for t in np.linspace(2, 8, 3000)]
    for kind, least in (("switch", 5), ("impact", 10)):
        made = energetic(events=[e._replace(kind=kind) for e in events])
        marks = [
            one
            for one in shown(made)["drawn"][1]
            if one.get("path", [["none"]])[0][0] == "shape"
        ]
        gaps = np.diff([one["at"][0] for one in marks])
        assert gaps.min() >= least
        # All along the line they are there.
        assert gaps.max() < 2 * least
        assert marks[0]["at"][0] == pytest.approx(place(2))


def test_events_of_each_run_are_marked_though_one_begins_earlier():
    first = energetic(events=[Event(7.0, "impact", "a")])
    other = energetic(events=[Event(3.0, "impact", "a")], name="other")
    seen = shown([first, other])
    where = [
        one["at"][0]
        for one in seen["drawn"][-1]
        if one.get("path", [["none"]])[0][0] == "shape"
    ]
    assert near(where, [place(3), place(7)])


def test_bars_without_any_energy():
    energies = {name: np.zeros(121) for name in ENERGIES}
    seen = shown(energetic(energies=energies))
    sides = [(bar["--from"], bar["--long"]) for bar in seen["bars"]]
    assert sides == [("0%", "0%")] * 5
    # A height that is not on the scale ends where that does.
    energies["kinetic"] = np.full(121, 2.0)
    energies["work"][1:] = np.inf
    bar = shown(energetic(energies=energies), at(3))["bars"][0]
    assert (bar["--from"], bar["--long"], bar["zero"]) == ("0%", "100%", "--zero: 0%")


# Four digits; where these do not do, a power of ten with three. Rounding is 0.
DIGITS = [
    [(1e-10, "0.000"), (1e-3, "0.001000"), (9.988e-4, "9.99e-4"), (-2.5e-8, "-2.50e-8"),
     (1.5, "1.500")],
    [(-12.34, "-12.34"), (1234.4, "1234"), (34560, "3.456e4"), (1e5, "1.00e5"),
     (-6.54e9, "-6.54e9")],
    [(np.nan, "–"), (np.inf, "–"), (99985, "9.999e4"), (1.1e5, "1.10e5"),
     (1.4e-3, "0.001400")],
]  # fmt: skip


@pytest.mark.parametrize("pairs", DIGITS, ids=("small", "large", "none"))
def test_digits_of_energies(pairs):
    values = (np.full(121, value) for value, _ in pairs)
    seen = shown(energetic(energies=dict(zip(ENERGIES, values, strict=True))))
    texts = [bar["value"] for bar in seen["bars"]]
    assert texts == [f"{text.replace('-', MINUS)} J" for _, text in pairs]


def test_the_lagrangian_has_its_colour_in_the_picture_of_energies():
    for others, colour in ((("kinetic",), "potential"), ((), "kinetic")):
        energies = dict.fromkeys((*others, "lagrangian", "energy"), 0 * T)
        bars = shown(energetic(energies=energies))["bars"]
        [bar] = [bar for bar in bars if bar["label"] == "lagrangian"]
        assert bar["colour"] == f"background: var(--{colour})"


def test_kinetic_energy_behind_the_line_of_time():
    [hill] = fills(shown(energetic()), "kinetic", 1)
    assert hill["alpha"] == 0.22
    found = ends(hill)
    assert near(found[[0, -1]], [[place(2), LEVEL], [place(8), LEVEL]])
    x, y = found[1:-1].T
    t = 2 + 6 * (x - 12) / (LONG - 24)
    # A step of the rows is 0.05, in which cos^2 changes by that much at most.
    wanted = LEVEL - (LEVEL - 12) * np.cos(t) ** 2
    assert near(y, wanted, 0.06 * (LEVEL - 12))
    assert y.min() == pytest.approx(12)


def test_marks_of_events_and_no_forecast():
    events = [
        *(Event(t, "impact", "wall") for t in (3.0, 3.001, 5.0)),
        Event(4.0, "release", "wall"), Event(7.0, "strange"), Event(6.0, "until"),
    ]  # fmt: skip
    seen = shown(energetic(events=events, horizon=6.5), hover(3))
    found = [
        one for one in seen["drawn"][1] if one.get("path", [["none"]])[0][0] == "shape"
    ]
    # Marks on each other are one; a release is hollow; what has no look has a line.
    assert [(one["op"], one["colour"]) for one in found] == [
        ("fill", "force"), ("fill", "force"), ("stroke", "potential"), ("fill", "dim"),
    ]  # fmt: skip
    assert near([one["at"] for one in found], [[place(t), 30] for t in (3, 5, 4, 7)])
    assert seen["texts"]["legend"] == "impact (3)release (1)strange (1)kinetic energy"
    assert seen["titles"][1].split("\n") == [
        "t = 3.000 s: impact wall", "t = 3.001 s: impact wall",
    ]  # fmt: skip
    [clip], begin = strokes(seen, 1, op="clip"), place(6.5)
    assert near(clip["path"][0][1:], [begin, 2, place(8) - begin, LEVEL - 2])
    [hatch, *_] = page.lines(seen, "ground", 1)
    assert near(ends(hatch), [[begin - LEVEL, LEVEL], [begin, 0]])
    for horizon, align, beside in ((6.5, "right", -5), (5.0, "left", 5)):
        early = shown(energetic(horizon=horizon))
        [text] = strokes(early, 1, text="no forecast from here on")
        assert (text["align"], text["y"]) == (align, 3)
        assert text["x"] == pytest.approx(place(horizon) + beside)


def test_what_has_happened_near_a_place_of_the_line():
    pixel = 6 / (LONG - 24)
    events = [Event(3.0 + k * 0.4 * pixel, "impact", f"c{k}") for k in range(7)]
    more = [Event(3 + 5.2 * pixel, "slip", "far"), Event(3 - 4.8 * pixel, "slip", "s")]
    for listed, told in ((events + more, ["and 3 more"]), (events[:5], [])):
        text = shown(energetic(events=listed), hover(3))["titles"][1].split("\n")
        assert [line.split()[-1] for line in text[:5]] == [f"c{k}" for k in range(5)]
        assert text[5:] == told


@pytest.mark.parametrize(
    ("first", "last"),
    [(2.3, 7.7), (-3.0, 5.0), (0.0, 0.35), (2, 8), (2e4, 8e4), (5e5, 2e6)],
)
def test_ticks_stand_at_round_times(first, last):
    seen = shown(page.swing((first, last)))
    texts = labels(seen, 1)
    boxes = [one["box"] for one in strokes(seen, 1, op="fillRect", colour="dim")]
    step = min(s for s in page.ROUND if s >= (last - first) / (LONG / 80) * (1 - 1e-9))
    ticks = np.arange(np.ceil(first / step - 1e-6), last / step + 1e-6) * step
    places = place(ticks, first, last)
    assert near(boxes, [[np.floor(x + 0.5), LEVEL + 5, 1, 4] for x in places])
    assert {one["y"] for one in texts} == {LEVEL + 11}
    found = [number(one["text"].replace(" s", "")) for one in texts]
    assert np.allclose(found, ticks, rtol=0.05 if last > 9e4 else 0, atol=1e-9)
    # A letter is 6 pixels wide here; the last number is whole, too.
    halves = np.array([3 * len(one["text"]) + 2 for one in texts])
    x = np.array([one["x"] for one in texts])
    assert near(x, np.clip(places, halves, LONG - halves))
    assert (x[1:] - halves[1:] > x[:-1] + halves[:-1]).all()
    units = [one["text"].endswith(" s") for one in texts]
    assert units == [False] * (len(texts) - 1) + [True]


@pytest.mark.slow
def test_play_loop_and_speed():
    steps = [("frame", 1000 + 50 * k) for k in range(3)]
    steps += [("frame", 5000), ("key", "+"), ("frame", 5050), *keys("--")]
    seen = page.played(energetic(), *steps, ("frame", 5100))
    # A long pause between two frames is not caught up; "+" doubles, "-" halves.
    wanted = [2, 2, 2.05, 2.1, 2.2, 2.2, 2.3, 2.3, 2.3, 2.325]
    assert near(times(seen), wanted, 1e-9)
    speeds = [one["texts"]["speed"] for one in seen]
    assert [speeds[0], speeds[5], speeds[-1]] == ["1×", "2×", "0.5×"]
    # At the end it rests 0.8 s, then begins anew; where it does not, it stops.
    rest = [("frame", 100 * k) for k in range(12)]
    tail = keys(("End", "l", "l", "ArrowLeft", " "))
    found = times(page.played(energetic(), *tail, *rest)[-12:])
    assert found[:2] == [8 - 0.03, 8]
    assert found.index(2) == 11 - found[::-1].index(8) + 1 == 10
    tail = keys(("l", "End", "ArrowLeft", " "))
    seen = page.played(energetic(), *tail, *rest)
    assert set(times(seen[-11:])) == {8}
    assert seen[-1]["pressed"]["loop"] == "false"


def test_one_row_is_a_picture_that_does_not_play():
    one = [np.array([1.0]), np.array([2.0])]
    made = page.film([0.0], {"bob": (one, one), "o": [0, 0]})
    seen = page.played(made, ("key", " "), ("frame", 100), ("frame", 5000))
    assert times(seen) == [0, 0, 0, 0]
    texts = seen[0]["texts"]
    assert (texts["clock"], texts["speed"]) == ("t = 0 s", "1×")


def test_keys_and_line():
    events = [Event(3.0, "impact"), Event(5.0, "impact")]
    steps = keys(
        ["End", "ArrowLeft", "Home", "PageDown", "PageDown", "PageUp", "ArrowRight"]
    )
    steps += [("key", "ArrowLeft", {"shiftKey": True})]
    steps += [("key", "ArrowRight", {"shiftKey": True})]
    # Those are not for the page.
    steps += [("key", "Home", {k: True}) for k in ("ctrlKey", "metaKey", "altKey")]
    steps += [("key", "x")]
    steps += [page.press(x, 0, canvas=1) for x in (place(4), 0, LONG)]
    steps += [("on", 1, "pointermove", {"offsetX": place(7), "buttons": 1})]
    seen = page.played(energetic(events=events), *steps)
    wanted = [2, 8, 7.97, 2, 3, 5, 3, 3.03, 2.73, *[3.03] * 5, 4, 2, 8, 7]
    assert near(times(seen), wanted, 1e-9)
    assert not seen[0]["hidden"]["jumps"]
    assert [one["labels"]["play"] for one in seen[:2]] == ["Pause", "Play"]


def test_speeds_by_keys_and_clicks():
    clicks = [("click", name) for name in ("faster", "faster", "slower")]
    seen = stopped(page.swing(), *keys("=__"), *clicks, *keys("+-"))
    texts = [one["texts"]["speed"] for one in seen[1:]]
    assert texts == ["2×", "1×", "0.5×", "1×", "2×", "1×", "2×", "1×"]


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
    made = page.swing((0.0, span))
    texts = [one["texts"] for one in stopped(made, *keys("-" * 9 + "+" * 16))]
    assert [texts[k]["speed"] for k in (0, 9, -1)] == [usual, slow, fast]
    if span >= 1.0:
        places = max(0, -int(np.floor(np.log10(span / 200))))
        assert texts[0]["clock"] == f"t = 0 s of {span:.{places}f}"


def test_letters_large_and_small_and_clicks_do_the_same():
    steps = [("key", "L"), ("click", "loop"), ("key", "T"), ("click", "names")]
    steps += [("key", "N"), ("key", "F"), ("click", "forces")]
    push = [Push("rod", "bob", np.ones((81, 2)))]
    seen = stopped(page.swing(pushes=push), *steps)[1:]
    for name, values in {
        "loop": ["false", "true"] + ["true"] * 5,
        "names": [None, None, None, "true", "false", "false", "false"],
        "forces": [None] * 5 + ["false", "true"],
    }.items():
        assert [one["pressed"].get(name) for one in seen] == values, name


def test_light_and_dark_by_turns():
    seen = stopped(page.swing(), ("click", "theme"), ("click", "theme"))
    assert [one["theme"] for one in seen] == ["light", "dark", "light"]
    assert page.arcs(fills(seen[1], "#4db2ef"))
    assert shown(page.swing(), ("click", "theme"), dark=True)["theme"] == "light"


def test_forces_and_their_help_are_there_where_a_run_has_some():
    push = [Push("rod", "bob", np.ones((81, 2)))]
    none, some = page.swing(name="a"), page.swing(name="b", pushes=push)
    for films, hidden in (([none], True), ([some], False), ([none, some], False)):
        seen = shown(films)
        assert seen["hidden"]["pushing"] is seen["hidden"]["forces"] is hidden
    assert not fills(seen, "force", 0)
    assert fills(seen, "force", 1)
    # Room for them in both, which have one scale.
    assert near(dot(seen, 0), dot(seen, 1), 0)


def test_several_runs_on_one_line():
    """It has all their times; their events in order; no forecast from the first on."""
    events = [Event(5.0, "impact", "a"), Event(3.0, "slip", "a")]
    one = page.swing((2.0, 8.0), name="one", horizon=6.5, events=events)
    events = [Event(4.0, "impact", "b"), Event(2.5, "stick", "b")]
    other = page.swing((1.0, 5.0), name="other", horizon=4.0, events=events)
    steps = ["Home", *["PageDown"] * 5, "End", *["PageUp"] * 5]
    seen = stopped([one, other], *keys(steps))
    line = seen[0]["line"]
    assert (line["aria-valuemin"], line["aria-valuemax"]) == ("1", "8")
    assert times(seen[1:]) == [1, 2.5, 3, 4, 5, 5, 8, 5, 4, 3, 2.5, 2.5]
    [clip] = [x for x in seen[-1]["drawn"][-1] if x["op"] == "clip"]
    begin = place(4, 1, 8)
    assert near(clip["path"][0][1:], [begin, 2, LONG - 12 - begin, LINE - 27])


def test_many_runs_and_one_picture():
    late = np.linspace(2, 5, 61)
    one, other = energetic(name="one"), energetic(late, size=2.0, name="other")
    seen, together = stopped([one, other], at(6), ("key", "o"))[1:]
    assert seen["panels"][1]["classes"] == ["ended"]
    assert [p["hidden"] for p in seen["panels"]] == [False, False, True]
    assert [p["hidden"] for p in together["panels"]] == [True, True, False]
    # One scale, that of the greater; the second stays where it ended.
    screen = Screen(one, other)
    wanted = [screen([np.sin(6), 0]), screen([2 * np.sin(5), 0])]
    assert near([dot(seen, 0), dot(seen, 1)], wanted)
    assert near([dot(together, 2), dot(together, 2, SECOND)], wanted)
    points = json.loads(seen["data"]["points"])
    assert set(points) == {"one/bob", "one/o", "other/bob", "other/o"}
    # The same bar is the same energy.
    every = np.concatenate([x for m in (one, other) for x in m.energies.values()])
    wanted = 100 * np.cos(6) ** 2 / 2 / np.ptp(every)
    assert float(seen["bars"][0]["--long"][:-1]) == pytest.approx(wanted, abs=1e-3)


def test_pixels_of_a_fine_screen():
    seen = shown(page.swing(), ratio=2)
    assert seen["transforms"] == [[2, 0, 0, 2, 0, 0]] * 2
    assert seen["sizes"] == [[2 * WIDE, 2 * HIGH], [2 * LONG, 2 * LINE]]
    assert page.arcs(fills(seen, FIRST))
