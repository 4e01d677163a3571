"""The page under node: what it draws, call by call, and what it says."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lagsim.outputs import animation
from lagsim.outputs.animation.film import Film, Track
from lagsim.outputs.animation.page import SCRIPTS, record

FOUND = shutil.which("node")
needs_node = pytest.mark.skipif(FOUND is None, reason="no node on PATH")
# Canvases of `page_under_node.js`, in pixels.
WIDE, HIGH, LONG, LINE = 600.0, 400.0, 700.0, 66.0
# A page plays at first.
QUIET = [("key", " ")]


def played(films, steps=(), **more) -> list[dict[str, Any]]:
    """Give what a page shows at first, and after each of the steps."""
    here = Path(animation.__file__).parent
    script = "\n".join((here / name).read_text("utf-8") for name in SCRIPTS)
    asked = {"runs": [record(film) for film in films], "script": script}
    asked |= {"steps": list(steps), **more}
    driver = Path(__file__).with_name("page_under_node.js")
    done = subprocess.run(
        [FOUND, driver], input=json.dumps(asked).encode(), capture_output=True
    )
    assert done.returncode == 0, done.stderr.decode()
    return json.loads(done.stdout)


def strokes(seen, canvas=0, **wanted):
    """Give what is drawn with these properties, in order."""
    return [
        one
        for one in seen["drawn"][canvas]
        if all(one.get(name) == value for name, value in wanted.items())
    ]


def ends(one):
    """Give the corners of a path."""
    return np.array([p[1:] for p in one["path"] if p[0] in ("moveTo", "lineTo")])


def arcs(seen, canvas=0, **wanted):
    """Give (x, y, radius) of circles that are drawn so."""
    found = strokes(seen, canvas, **wanted)
    return [one["path"][0][1:4] for one in found if one["path"][0][0] == "arc"]


def film(t, tracks, **more):
    """Give a film of closed forms: each track a pair of arrays or a fixed place."""
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


def screen(film, place, *, forces=False):
    """Give the pixels of a place of the plane, at one scale, y upwards."""
    every = np.concatenate([track.place for track in film.tracks.values()])
    low, high = every.min(axis=0), every.max(axis=0)
    edge = 0.2 * HIGH if forces else min(64.0, 0.14 * HIGH)
    size = min((np.array([WIDE, HIGH]) - 2 * edge) / (high - low))
    x, y = size * (np.asarray(place) - (low + high) / 2)
    return np.array([WIDE / 2 + x, HIGH / 2 - y]), size


def near(found, wanted, within=2e-4):
    """Hold numbers of pixels to others; a page has 24 bits of a number."""
    return np.allclose(np.array(found), np.array(wanted), rtol=0, atol=within)


def digits(value, step):
    return f"{value:.{max(0, -math.floor(math.log10(step)))}f}".replace(
        "-", "\N{MINUS SIGN}"
    )
