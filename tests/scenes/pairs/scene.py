"""Scenes of one or two fragments, side by side or coupled, and their closed forms.

Every pair that is not in `REFUSED` is run against its closed form.
"""

from __future__ import annotations

import itertools
import re
import zlib
from typing import NamedTuple

import pytest

from tests.scenes.pairs.physical import FRAGMENTS
from tests.support import refused

STEP = 0.05
HOLDS_AT_TIMES = (
    "contact", "friction on one slip", "friction on the disc", "limit",
    "static and dynamic friction", "freewheel", "when", "groove", "ridge",
)  # fmt: skip
PAIRS = tuple(
    (a.name, b.name) for a, b in itertools.combinations_with_replacement(FRAGMENTS, 2)
)
WAYS = ("beside", "coupled")


class Refusal(NamedTuple):
    """Code of an error, and the reason that the page states."""

    code: str
    reason: str

    def expected(self, *names):
        """Expect the error with these names and the names in its reason."""
        return refused(self.code, *names, *re.findall("`[^`]+`", self.reason))


REFUSED = {
    ("until", "until"): Refusal("duplicate-key", "the key `until` is given twice"),
    ("redundant", "elimination"): Refusal(
        "formulation-refused",
        "`elimination` cannot be used: constraints are redundant",
    ),
    **dict.fromkeys(
        ((law, "elimination") for law in HOLDS_AT_TIMES),
        Refusal(
            "formulation-refused",
            "`elimination` cannot be used: the model has constraints that hold at "
            "times",
        ),
    ),
}


# The first coordinates of two fragments as sums and differences of two others.
HALVED = (("1/sqrt(2)", "1/sqrt(2)"), ("1/sqrt(2)", "-1/sqrt(2)"))


def scene(
    *fragments, coupled=False, mix=HALVED, names="uw", far=0.0, speed=0.0, later=0.0,
    heavy=0.0, extra="",
):  # fmt: skip
    """Return the model file of fragments, side by side or coupled.

    Coupled, the first coordinates x1, x2, ... are definitions by others, whose names
    are given: `mix` is an orthogonal matrix of texts, so that the motion of x1, x2, ...
    is unchanged, but no expression belongs to one fragment alone. These others may be
    far away, in a moving frame; the clock may be late, and a heavy body beside it all.
    """
    begins = later or far or speed
    sections: dict[str, dict[str, str]] = {
        "parameters": {"t0": repr(later)} if begins else {}, "coordinates": {},
        "definitions": {}, "initial": {},
    }  # fmt: skip
    for k, f in enumerate(fragments, 1):
        if coupled:
            sums = (f"({c})*{q}" for c, q in zip(mix[k - 1], names, strict=True))
            moved = f" - {far!r} - {speed!r}*(t - t0)" if far or speed else ""
            sections["definitions"][f"x{k}"] = " + ".join(sums) + moved
        own = names[k - 1] if coupled else f"x{k}"
        sections["coordinates"][own] = "{}"
        for part, added in enumerate((far, speed)):
            start = f.start[part]
            if coupled:
                rows = zip(mix, fragments, strict=True)
                start = " + ".join(
                    f"({row[k - 1]})*({g.start[part]} + {added!r})" for row, g in rows
                )
            sections["initial"][own + "_dot" * part] = start
    for k, f in enumerate(fragments, 1):
        for section, entries in f.written(k).items():
            timed = section not in ("tables", "parameters")
            sections.setdefault(section, {}).update(
                (name, _since(text) if timed and later else text)
                for name, text in entries.items()
            )
    kinetic, potential = (
        " + ".join(f"({x.replace('$', str(k))})" for k, x in enumerate(texts, 1))
        for texts in ([f.kinetic for f in fragments], [f.potential for f in fragments])
    )
    if heavy:
        sections["coordinates"]["by"] = "{}"
        sections["initial"] |= {"by": "0", "by_dot": "1"}
        kinetic += f" + {heavy!r}*by_dot^2/2"
    sections["energy"] = {"kinetic": kinetic, "potential": potential}
    settings = {f", formulation: {f.formulation}": 0 for f in fragments}
    settings.pop(", formulation: ", None)
    untils = [f.until.replace("$", str(k)) for k, f in enumerate(fragments, 1)]
    more = "".join([*(f', until: "{u}"' for u in untils if u), *settings])
    crossed = {
        name.replace("$", str(k)): text.replace("$", str(k))
        for k, f in enumerate(fragments, 1)
        for name, (text, _) in f.crossed.items()
    }
    if crossed:
        asked = ", ".join(f"{name}: {text}" for name, text in crossed.items())
        sections["output"] = {"sections": f"{{{asked}}}"}
        if found := re.fullmatch(r"output: {(\w+): (.*)}", extra):
            sections["output"][found[1]] = found[2]
            extra = ""
    lines = [
        f"{name}:\n" + "".join(f"  {key}: {text}\n" for key, text in entries.items())
        for name, entries in sections.items()
        if entries
    ]
    begin = "start: t0, " if begins else ""
    run = f"{begin}duration: 2, output_step: {STEP}{more}"
    return "".join(lines) + f"simulation: {{{run}}}\n{extra}"


def _since(text):
    """Replace the time in a text by the time since the start."""
    return re.sub(r"(?<![\w.])t\b(?!\()", "(t - t0)", text)


def motion(*fragments, t):
    """Return the closed forms of all coordinates at times t (rows,)."""
    return {
        name.replace("$", str(k)): x
        for k, f in enumerate(fragments, 1)
        for name, x in f.motion(t).items()
    }


def crossings(*fragments):
    """Return the times of the rows of each section, by its name."""
    end = min(f.end for f in fragments) + 1e-6
    return {
        name.replace("$", str(k)): [t for t in times if t <= end]
        for k, f in enumerate(fragments, 1)
        for name, (_, times) in f.crossed.items()
    }


def holds_sections(result, *fragments, bound, scale=1.0, shift=0.0):
    """Compare the rows of all sections with the closed forms."""
    assert result.sections.keys() == crossings(*fragments).keys()
    for name, times in crossings(*fragments).items():
        rows = result.sections[name]
        t = (rows["t"] - shift) * scale
        assert t == pytest.approx(times, abs=bound), name
        for q, x in motion(*fragments, t=t).items():
            assert rows[q] == pytest.approx(x, abs=bound), (name, q)


def part_of(name, parts):
    """Return whether a case is in the quick slice, by its name alone.

    The slice has one of `parts` cases.
    """
    return zlib.crc32(name.encode()) % parts == 0
