"""The page run by node: its drawing, call by call, and its texts."""

from __future__ import annotations

import atexit
import functools
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lagsim.outputs import animation
from lagsim.outputs.animation import SCRIPTS, Film, Track, record

FOUND = shutil.which("node")
needs_node = pytest.mark.skipif(FOUND is None, reason="no node on PATH")
# Canvases of `page_under_node.js`, in pixels; how high the line of time stands.
WIDE, HIGH, LONG, LINE = 600.0, 400.0, 700.0, 66.0
LEVEL = LINE - 25
COLOURS = ["#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9"]
FIRST, SECOND = COLOURS[:2]
ROUND = sorted(m * 10.0**k for k in range(-7, 7) for m in (1, 2, 5))


def played(films, *steps, **more) -> list[dict[str, Any]]:
    """Return the states of a page at first, and after each of the steps."""
    here = Path(animation.__file__).parent
    script = "\n".join((here / name).read_text("utf-8") for name in SCRIPTS)
    films = [films] if isinstance(films, Film) else films
    asked = {"runs": [record(film) for film in films], "script": script}
    asked |= {"steps": steps, **more}
    pages = pages_under_node()
    pages.stdin.write(json.dumps(asked) + "\n")
    said = json.loads(pages.stdout.readline())
    assert "found" in said, said
    return said["found"]


@functools.cache
def pages_under_node():
    """Return the process that runs all pages; it ends with this process."""
    line = [FOUND, Path(__file__).with_name("page_under_node.js")]
    pipe = subprocess.PIPE
    pages = subprocess.Popen(line, stdin=pipe, stdout=pipe, bufsize=1, encoding="utf-8")
    atexit.register(pages.communicate)
    return pages


def stopped(films, *steps, **more) -> list[dict[str, Any]]:
    """Return the states of a page that does not play, from its stop on."""
    return played(films, ("key", " "), *steps, **more)[1:]


def shown(films, *steps, **more) -> dict[str, Any]:
    """Return the last state of a page that does not play."""
    return stopped(films, *steps, **more)[-1]


def at(t):
    """Show a time."""
    return "hash", f"#t={t}"


def keys(names):
    return [("key", name) for name in names]


def press(x, y, finger=1, canvas=0):
    where = {"pointerId": finger, "offsetX": x, "offsetY": y}
    return "on", canvas, "pointerdown", where


def move(x, y, finger=1, **more):
    where = {"pointerId": finger, "offsetX": x, "offsetY": y}
    return "on", 0, "pointermove", where | more


def wheel(turn, x, y):
    return "on", 0, "wheel", {"deltaY": turn, "offsetX": x, "offsetY": y}


def times(every):
    return [float(seen["data"]["t"]) for seen in every]


def strokes(seen, canvas=0, **wanted):
    """Return the drawing calls with these properties, in order."""
    return [
        one
        for one in seen["drawn"][canvas]
        if all(one.get(name) == value for name, value in wanted.items())
    ]


def fills(seen, colour, canvas=0):
    return strokes(seen, canvas, op="fill", colour=colour)


def lines(seen, colour, canvas=0, **wanted):
    return strokes(seen, canvas, op="stroke", colour=colour, **wanted)


def labels(seen, canvas=0, **wanted):
    """Return the numbers and words in grey."""
    return strokes(seen, canvas, op="fillText", colour="dim", **wanted)


def ends(one):
    """Return the corners of a path."""
    return np.array([p[1:] for p in one["path"] if p[0] in ("moveTo", "lineTo")])


def arcs(drawn):
    """Return (x, y, radius) of the circles in a drawing."""
    paths = [one["path"][0] for one in drawn if "path" in one]
    return [path[1:4] for path in paths if path[0] == "arc"]


def dot(seen, canvas=0, colour=FIRST):
    """Return the place of the one point of a colour."""
    [found] = arcs(fills(seen, colour, canvas))
    return np.array(found[:2])


def film(t, tracks, **more):
    """Return a film of closed forms: each track a pair of arrays or a fixed place."""
    t = np.asarray(t, float)
    found = {}
    for name, track in tracks.items():
        if isinstance(track, tuple):
            found[name] = Track(*(np.stack(a, axis=1) for a in track))
        else:
            place = np.tile(np.asarray(track, float), (len(t), 1))
            found[name] = Track(place, np.zeros_like(place))
    more.setdefault("broken", np.zeros(len(t), bool))
    return Film(more.pop("name", "film"), "", t, tracks=found, **more)


def swing(t=(0.0, 8.0), rows=81, size=1.0, **more):
    """Return the film of x = size sin t, beside a point at the origin."""
    t = np.linspace(*t, rows)
    track = ([size * np.sin(t), 0 * t], [size * np.cos(t), 0 * t])
    return film(t, {"bob": track, "o": [0, 0]}, **more)


class Screen:
    """Map from the places of films to pixels: at one scale, upwards.

    A space is seen from an azimuth and a height above the horizon; the latter is at
    first the height for which the page has room.
    """

    def __init__(
        self, *films, forces=False, size=(WIDE, HIGH), turned=(-0.96, 0.34), scale=None
    ):
        tracks = [track.place for film in films for track in film.tracks.values()]
        self.every = np.concatenate(tracks)
        self.low, self.high = np.nanmin(self.every, 0), np.nanmax(self.every, 0)
        self.middle = (self.low + self.high) / 2
        spans, self.towards = self.high - self.low, np.array([0.0, 0.0, 1.0])
        self.axes = np.eye(2)
        if len(spans) == 3:
            (c, s), (v, u) = ((np.cos(a), np.sin(a)) for a in turned)
            self.towards = np.array([v * c, v * s, u])
            right = np.array([-s, c, 0.0])
            self.axes = np.stack([right, np.cross(self.towards, right)])
            wide = np.hypot(*spans[:2])
            spans = np.array([wide, spans[2] * np.cos(0.34) + wide * np.sin(0.34)])
        edge = 0.2 * min(size) if forces else min(64.0, 0.14 * min(size))
        self.scale = scale or min((np.array(size) - 2 * edge) / np.maximum(spans, 1e-9))
        self.origin = np.array(size) / 2

    def __call__(self, place):
        return self.origin + self.along(np.asarray(place, float) - self.middle)

    def along(self, vector):
        return self.scale * (self.axes @ vector) * [1, -1]

    def moved(self, by):
        self.origin = self.origin + by
        return self

    def zoomed(self, factor, place):
        """The pixel `place` stays where it is."""
        self.origin = np.asarray(place) + factor * (self.origin - place)
        self.scale *= factor
        return self


def near(found, wanted, within=2e-4):
    """Assert that numbers of pixels agree; a page has 24 bits of a number."""
    return np.allclose(np.array(found), np.array(wanted), rtol=0, atol=within)


def number(text):
    return float(text.replace("\N{MINUS SIGN}", "-"))
