"""The page: one file with its data, its style and its script, and no network."""

from __future__ import annotations

import base64
import html
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.outputs.animation.film import extent
from lagsim.outputs.record import merged
from lagsim.tolerances import COMPUTED_ZERO, SATISFIED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.outputs.animation.film import Film

NAME = "animation.html"
# In this order: each uses what stands before.
SCRIPTS = ("motion.js", "view.js", "draw.js", "panel.js", "page.js")
# The data of a page, as `recorded` finds them.
_DATA = re.compile(
    r'<script type="application/json" id="runs">(.*?)</script>', re.DOTALL
)
# Of the length of a link: within this it does not change; of the frames: so many with
# a contact's link at its longest make it a string.
RIGID, TAUT = 1e-3, 0.02
# A view shows all of the motion, unless some hundredths of it go so many times as far.
MOST, OUTLYING = 98.0, 20.0
# Of the size of a view: so far below it a floor is still in sight.
NEAR = 0.1
# More events than these cannot be distinguished on a time line.
MOST_EVENTS = 4000


@np.errstate(all="ignore")  # a motion that diverges passes every number
def record(film: Film) -> dict[str, Any]:
    """Return a film as the page reads it, in what JSON holds."""
    size = extent(film.tracks)
    names = list(film.tracks)
    points: list[dict[str, Any]] = []
    for name, (place, rate) in film.tracks.items():
        finite = place[np.isfinite(place).all(axis=1)]
        still = (
            len(finite) == len(place)
            and np.ptp(finite, 0).max() <= COMPUTED_ZERO * size
        )
        found = {"fixed": place[0].tolist()} if still else {
            "place": _packed(place), "rate": _packed(rate),
        }  # fmt: skip
        points.append({"name": name, **found})
    events = merged(film.events)
    notes = list(film.notes)
    if len(events) > MOST_EVENTS:
        notes.append(f"the first {MOST_EVENTS} of {len(events)} events are marked")
    return {
        "name": film.name,
        "description": film.description,
        "t": _packed(film.t, "<f8"),
        "broken": np.flatnonzero(film.broken).tolist(),
        "dimension": next(iter(film.tracks.values())).place.shape[1],
        "box": (box := _box(film)),
        "floor": _floor(film, box),
        "points": points,
        "links": [_link(film, names, a, b) for a, b in film.links],
        "pushes": [
            {"name": p.constraint, "point": names.index(p.point),
             "force": _packed(p.force), "usual": _usual(p.force)}
            for p in film.pushes
        ],
        "energies": {name: _packed(values) for name, values in film.energies.items()},
        "events": [
            {"t": e.time, "kind": e.kind, "what": e.constraint or e.switch or "",
             "points": [names.index(p) for p in film.struck.get(e.constraint, ())]}
            for e in events[:MOST_EVENTS]
        ],
        "horizon": film.horizon if math.isfinite(film.horizon) else None,
        "units": dict(film.units),
        "notes": notes,
    }  # fmt: skip


def _packed(values: Floats, kind: str = "<f4") -> str:
    """Return numbers as text, row by row."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def _usual(force: Floats) -> float:
    """Return the size of a force that few frames exceed: a spike rules no scale."""
    sizes = np.linalg.norm(force, axis=1)
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    return float(np.percentile(sizes, MOST)) if len(sizes) else 0.0


def _floor(film: Film, box: Sequence[Sequence[float]]) -> float | None:
    """Return the height of a floor that is below all; None where it is out of sight."""
    last = np.concatenate([track.place[:, -1] for track in film.tracks.values()])
    lowest = float(last[np.isfinite(last)].min(initial=box[-1][0]))
    size = max(high - low for low, high in box)
    return lowest if lowest >= box[-1][0] - NEAR * size else None


def _box(film: Film) -> list[list[float]]:
    """Return the least and greatest of each component that a view is to show."""
    every = np.concatenate([track.place for track in film.tracks.values()])
    every = every[np.isfinite(every).all(axis=1)]
    if not len(every):
        return [[0.0, 0.0] for _ in range(every.shape[1])]
    low, high = every.min(axis=0), every.max(axis=0)
    usual = np.percentile(every, (100.0 - MOST, MOST), axis=0)
    if np.max(high - low) > OUTLYING * np.max(usual[1] - usual[0]) > 0:
        low, high = usual
    return [[float(a), float(b)] for a, b in zip(low, high, strict=True)]


def _link(film: Film, names: Sequence[str], a: str, b: str) -> dict[str, Any]:
    """Say what a link is like: a rod, a spring, or a string that may be slack."""
    apart = film.tracks[a].place - film.tracks[b].place
    lengths = np.linalg.norm(apart, axis=1)
    lengths = lengths[np.isfinite(lengths)]
    lengths = lengths if len(lengths) else np.zeros(1)
    longest = float(lengths.max())
    kind = "spring"
    if float(lengths.min()) >= (1.0 - RIGID) * longest:
        kind = "rod"
    elif any({a, b} & set(points) for points in film.struck.values()):
        taut = np.mean(lengths >= (1.0 - SATISFIED) * longest)
        kind = "string" if taut > TAUT else "spring"
    ends, usual = (names.index(a), names.index(b)), float(np.median(lengths))
    return {"ends": ends, "kind": kind, "longest": longest, "usual": usual}


def page(runs: Sequence[Mapping[str, Any]], title: str) -> bytes:
    """Return a page on which runs play side by side, on one clock."""
    here = Path(__file__).parent
    text = (here / "page.html").read_text("utf-8")
    data = json.dumps(runs, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    # Nothing in it may end the element that it stands in.
    data = data.replace("<", "\\u003c")
    parts = {
        "TITLE": html.escape(title),
        "STYLE": (here / "page.css").read_text("utf-8"),
        "DATA": data,
        "SCRIPT": "\n".join((here / name).read_text("utf-8") for name in SCRIPTS),
    }
    whole = re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], text)
    return whole.encode(errors="replace")


def recorded(content: str) -> list[dict[str, Any]] | None:
    """Return the runs of a page; None where it holds none."""
    found = _DATA.search(content)
    if not found:
        return None
    try:
        runs = json.loads(found[1])
    except ValueError:
        return None
    return runs if isinstance(runs, list) else None
