"""The page's keys, buttons and fingers; ticks; how long trails and rings last."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.notes import Event
from lagsim.outputs.animation.pushes import Push
from tests.outputs import node as page
from tests.outputs.node import HIGH, LINE, LONG, QUIET, WIDE

pytestmark = page.needs_node

BLUE, ORANGE = "#0072B2", "#D55E00"


def run(t=(0.0, 8.0), rows=81, **more):
    t = np.linspace(*t, rows)
    track = ([np.sin(t), 0 * t], [np.cos(t), 0 * t])
    return page.film(t, {"bob": track, "o": [0, 0]}, **more)


def times(seen):
    return [float(one["data"]["t"]) for one in seen]


def test_keys_that_are_not_for_the_page():
    steps = [
        *QUIET,
        *(("key", "End", {name: True}) for name in ("ctrlKey", "metaKey", "altKey")),
    ]
    steps += [("key", "x"), ("key", "End")]
    seen = page.played([run()], steps)
    assert times(seen) == [0, 0, 0, 0, 0, 0, 8]
    assert [one["labels"]["play"] for one in seen[:2]] == ["Pause", "Play"]


def test_steps_far_and_near():
    steps = [*QUIET, ("hash", "#t=4"), ("key", "ArrowRight", {"shiftKey": True})]
    steps += [("key", "ArrowRight"), ("key", "ArrowLeft", {"shiftKey": True})]
    assert page.near(times(page.played([run()], steps))[2:], [4, 4.4, 4.44, 4.04], 1e-9)


def test_speeds_by_keys_and_clicks():
    steps = [("key", "="), ("key", "_"), ("key", "_"), ("click", "faster")]
    steps += [("click", name) for name in ("faster", "slower")]
    steps += [("key", "+"), ("key", "-")]
    seen = page.played([run()], [*QUIET, *steps])
    texts = [one["texts"]["speed"] for one in seen[2:]]
    assert texts == ["2×", "1×", "0.5×", "1×", "2×", "1×", "2×", "1×"]


def test_letters_large_and_small_and_clicks_do_the_same():
    steps = [("key", "L"), ("click", "loop"), ("key", "T"), ("click", "names")]
    steps += [("key", "N"), ("key", "F"), ("click", "forces")]
    push = [Push("rod", "bob", np.ones((81, 2)))]
    seen = page.played([run(pushes=push)], [*QUIET, *steps])[2:]
    for name, values in {
        "loop": ["false", "true"] + ["true"] * 5,
        "names": [None, None, None, "true", "false", "false", "false"],
        "forces": [None] * 5 + ["false", "true"],
    }.items():
        assert [one["pressed"].get(name) for one in seen] == values, name


def test_light_and_dark_by_turns():
    seen = page.played([run()], [*QUIET, ("click", "theme"), ("click", "theme")])
    assert [one["theme"] for one in seen] == ["light", "light", "dark", "light"]
    assert page.arcs(seen[2], op="fill", colour="#4db2ef")
    assert page.played([run()], [("click", "theme")], dark=True)[1]["theme"] == "light"


def test_two_fingers():
    """What is between them stays there, and grows as they part; also up and down."""
    press = [(1, (100.0, 100.0)), (2, (160.0, 180.0))]
    steps = [
        ("on", 0, "pointerdown", {"pointerId": k, "offsetX": x, "offsetY": y})
        for k, (x, y) in press
    ]
    moved = {"pointerId": 2, "offsetX": 220.0, "offsetY": 260.0}
    steps += [("on", 0, "pointermove", moved)]
    seen = page.played([run()], [*QUIET, *steps])
    start, end = (np.array(page.arcs(one, op="fill", colour=BLUE)[0][:2])
                  for one in (seen[1], seen[-1]))  # fmt: skip
    # Twice as far from each other; from (130, 140) to (160, 180).
    assert page.near(end, [160, 180] + 2 * (start - [130, 140]))
    # One that is lifted moves nothing; the other one drags.
    steps += [("on", 0, "pointerup", {"pointerId": 2}), ("on", 0, "pointermove", moved)]
    steps += [("on", 0, "pointermove", {"offsetX": 107.0, "offsetY": 95.0})]
    seen = page.played([run()], [*QUIET, *steps])
    still, dragged = (np.array(page.arcs(one, op="fill", colour=BLUE)[0][:2])
                      for one in (seen[-2], seen[-1]))  # fmt: skip
    assert page.near(still, end)
    assert page.near(dragged, np.add(end, (7, -5)))


def test_shift_moves_a_space():
    t = np.linspace(0, 6, 61)
    made = page.film(
        t, {"a": ([np.cos(t), np.sin(t), t], [-np.sin(t), np.cos(t), 1 + 0 * t])}
    )
    steps = [
        *QUIET, ("on", 0, "pointerdown", {"offsetX": 0, "offsetY": 0}),
        ("on", 0, "pointermove", {"offsetX": 30, "offsetY": 20, "shiftKey": True}),
    ]  # fmt: skip
    seen = page.played([made], steps)
    before, after = (page.arcs(seen[k], op="fill", colour=BLUE)[0][:2] for k in (1, 3))
    assert page.near(np.subtract(after, before), [30, 20])
    assert seen[0]["texts"]["turning"] == "drag to turn"
    assert "turning" not in page.played([run()])[0]["texts"]


@pytest.mark.parametrize(
    ("first", "last"), [(2.3, 7.7), (-3.0, 5.0), (0.0, 0.35), (2, 8)]
)
def test_ticks_stand_at_round_times(first, last):
    seen = page.played([run((first, last))], QUIET)[-1]
    texts = page.strokes(seen, 1, op="fillText", colour="dim")
    boxes = [one["box"] for one in page.strokes(seen, 1, op="fillRect", colour="dim")]
    steps = [m * 10.0**k for k in range(-4, 3) for m in (1, 2, 5)]
    step = min(s for s in steps if s >= (last - first) / (LONG / 80) * (1 - 1e-9))
    ticks = (
        np.arange(np.ceil(first / step - 1e-6), np.floor(last / step + 1e-6) + 1) * step
    )
    places = 12 + (LONG - 24) * (ticks - first) / (last - first)
    level = LINE - 25
    assert page.near(boxes, [[np.floor(x + 0.5), level + 5, 1, 4] for x in places])
    assert {one["y"] for one in texts} == {level + 11}
    found = [
        float(one["text"].replace(" s", "").replace("\N{MINUS SIGN}", "-"))
        for one in texts
    ]
    assert np.allclose(found, ticks, atol=1e-9)
    # A letter is 6 pixels wide here.
    halves = np.array([3 * len(one["text"]) + 2 for one in texts])
    wanted = np.clip(places, halves, LONG - halves)
    assert page.near([one["x"] for one in texts], wanted)
    units = [one["text"].endswith(" s") for one in texts]
    assert units == [False] * (len(texts) - 1) + [True]


def test_help_is_of_buttons_that_are_there():
    push = [Push("rod", "bob", np.ones((81, 2)))]
    for film, hidden in ((run(), True), (run(pushes=push), False)):
        seen = page.played([film])[0]["hidden"]
        assert seen["pushing"] is hidden
        assert seen["forces"] is hidden


def test_rings_last_as_long_at_any_speed():
    # A third of a second as it is played: at twice the speed, of twice the motion.
    made = run(events=[Event(2.0, "impact", "wall")], struck={"wall": ["bob"]})
    for speed, keys in ((1.0, []), (2.0, [("key", "+")]), (0.5, [("key", "-")])):
        steps = [
            *QUIET,
            *keys,
            ("hash", f"#t={2 + 0.34 * speed}"),
            ("hash", f"#t={2 + 0.36 * speed}"),
        ]
        seen = page.played([made], steps)
        assert page.arcs(seen[-2], op="stroke", colour="force")
        assert not page.arcs(seen[-1], op="stroke", colour="force")


@pytest.mark.parametrize(("span", "long"), [(8.0, 2.8), (80.0, 5.0), (400.0, 140.0)])
def test_trails_last_a_third_of_the_run_or_five_seconds(span, long):
    made = run((0.0, span), rows=2001)
    seen = page.played([made], [*QUIET, ("hash", f"#t={0.9 * span}")])[-1]
    first, *_ = page.strokes(seen, op="stroke", colour=BLUE)
    begin = 0.9 * span - long
    low, high = np.min(np.sin(made.t)), np.max(np.sin(made.t))
    scale = (WIDE - 0.28 * HIGH) / (high - low)
    x = WIDE / 2 + scale * (np.sin(begin) - (low + high) / 2)
    assert page.near(page.ends(first)[0], [x, HIGH / 2], 0.05)


def test_one_row_is_a_picture_that_does_not_play():
    made = page.film(
        [0.0], {"bob": ([np.array([1.0]), np.array([2.0])],) * 2, "o": [0, 0]}
    )
    seen = page.played([made], [("key", " "), ("frame", 100), ("frame", 5000)])
    assert times(seen) == [0, 0, 0, 0]
    assert seen[0]["texts"]["clock"] == "t = 0 s"
    assert seen[0]["texts"]["speed"] == "1×"


def test_forces_of_one_run_of_two():
    push = [Push("rod", "bob", np.ones((81, 2)))]
    seen = page.played([run(name="a"), run(name="b", pushes=push)], QUIET)[-1]
    assert not seen["hidden"]["forces"]
    assert not page.strokes(seen, 0, op="fill", colour="force")
    assert page.strokes(seen, 1, op="fill", colour="force")
    # Room for them in both, which have one scale.
    dots = [page.arcs(seen, k, op="fill", colour=BLUE)[0] for k in (0, 1)]
    assert dots[0] == dots[1]
