"""Digits that the page writes, and what is told of several runs on one line of time."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.notes import Event
from tests.outputs import node as page
from tests.outputs.node import LINE, LONG, QUIET

pytestmark = page.needs_node

MINUS = "\N{MINUS SIGN}"
ENERGIES = ("kinetic", "potential", "lagrangian", "energy", "work")


def run(t=(0.0, 6.0), far=1.0, **more):
    t = np.linspace(*t, 61)
    track = ([far * np.sin(t), 0 * t], [far * np.cos(t), 0 * t])
    return page.film(t, {"bob": track, "o": [0, 0]}, **more)


def minus(text):
    return text.replace("-", MINUS)


# Four digits; where these do not do, a power of ten with three.
DIGITS = [
    [(0, "0.000"), (1e-3, "0.001000"), (9.988e-4, "9.99e-4"), (-2.5e-30, "-2.50e-30"),
     (1.5, "1.500")],
    [(-12.34, "-12.34"), (1234.4, "1234"), (34560, "3.456e4"), (1e5, "1.00e5"),
     (-6.54e12, "-6.54e12")],
    [(np.nan, "–"), (np.inf, "–"), (99985, "9.999e4"), (1.1e5, "1.10e5"),
     (1.4e-3, "0.001400")],
]  # fmt: skip


@pytest.mark.parametrize("pairs", DIGITS, ids=("small", "large", "none"))
def test_digits_of_energies(pairs):
    values = (np.full(61, value) for value, _ in pairs)
    energies = dict(zip(ENERGIES, values, strict=True))
    seen = page.played([run(energies=energies, units={"energy": "J"})], QUIET)[-1]
    texts = [bar["value"] for bar in seen["bars"]]
    assert texts == [f"{minus(text)} J" for _, text in pairs]


def test_bars_without_any_energy():
    energies = {name: np.zeros(61) for name in ENERGIES}
    seen = page.played([run(energies=energies)], QUIET)[-1]
    assert [(bar["--from"], bar["--long"]) for bar in seen["bars"]] == [
        ("0%", "0%")
    ] * 5
    # A height that is not on the scale ends where that does.
    energies["kinetic"] = np.full(61, 2.0)
    energies["work"][1:] = np.inf
    steps = [*QUIET, ("hash", "#t=3")]
    seen = page.played([run(energies=energies)], steps)[-1]
    assert (seen["bars"][0]["--from"], seen["bars"][0]["--long"]) == ("0%", "100%")
    assert seen["bars"][0]["zero"] == "--zero: 0%"


# Lines of the grid at so many units, and what stands at them.
@pytest.mark.parametrize(
    ("far", "texts"),
    [
        # 488 pixels are 2 far: lines at 110 pixels or more.
        (1e6, ["-1.0e6", "-5.0e5", "0", "5.0e5", "1.0e6"]),
        (1e5, ["-1.0e5", "-50000", "0", "50000", "1.0e5"]),
        (2e-1, ["-0.2", "-0.1", "0.0", "0.1", "0.2"]),
        (2e-5, ["-0.00002", "-0.00001", "0", "0.00001", "0.00002"]),
        (1e-5, ["-1.0e-5", "-5.0e-6", "0", "5.0e-6", "1.0e-5"]),
    ],
)
def test_digits_of_places(far, texts):
    made = run((-np.pi / 2, np.pi / 2), far)
    seen = page.played([made], QUIET)[-1]
    found = page.strokes(seen, op="fillText", colour="dim", align="center")
    wanted = [minus("0" if float(text) == 0 else text) for text in texts]
    assert [one["text"] for one in found] == wanted


@pytest.mark.slow
def test_several_runs_on_one_line():
    """It has all their times; their events in order; no forecast from the first on."""
    events = [Event(5.0, "impact", "a"), Event(3.0, "slip", "a")]
    one = run((2.0, 8.0), name="one", horizon=6.5, events=events)
    events = [Event(4.0, "impact", "b"), Event(2.5, "stick", "b")]
    other = run((1.0, 5.0), name="other", horizon=4.0, events=events)
    steps = [*QUIET, ("key", "Home"), *[("key", "PageDown")] * 5]
    seen = page.played([one, other], steps)
    assert seen[0]["line"]["aria-valuemin"] == "1"
    assert seen[0]["line"]["aria-valuemax"] == "8"
    times = [float(x["data"]["t"]) for x in seen[2:]]
    assert times == [1.0, 2.5, 3.0, 4.0, 5.0, 5.0]
    [clip] = page.strokes(seen[-1], 2, op="clip") or page.strokes(
        seen[-1], 3, op="clip"
    )
    scale = (LONG - 24) / 7
    wanted = [12 + scale * 3, 2, scale * 4, LINE - 27]
    assert page.near(clip["path"][0][1:], wanted)
    back = page.played([one, other], [*QUIET, ("key", "End"), *[("key", "PageUp")] * 5])
    assert [float(x["data"]["t"]) for x in back[2:]] == [8.0, 5.0, 4.0, 3.0, 2.5, 2.5]


def test_what_has_happened_near_a_place_of_the_line():
    scale = (LONG - 24) / 6
    events = [Event(3.0 + k * 0.4 / scale, "impact", f"c{k}") for k in range(7)]
    events += [
        Event(3.0 + 5.2 / scale, "slip", "far"),
        Event(3 - 4.8 / scale, "slip", "s"),
    ]
    hover = [("on", 1, "pointermove", {"buttons": 0, "offsetX": 12 + scale * 3})]
    told = page.played([run(events=events)], [*QUIET, *hover])[-1]["titles"][1]
    lines = told.split("\n")
    assert len(lines) == 6
    assert lines[-1] == "and 3 more"
    assert [line.split()[-1] for line in lines[:5]] == [f"c{k}" for k in range(5)]
    told = page.played([run(events=events[:5])], [*QUIET, *hover])[-1]["titles"][1]
    assert len(told.split("\n")) == 5
    assert "more" not in told
