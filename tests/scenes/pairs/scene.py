"""Scenes of one or two fragments, side by side or coupled, and their closed forms.

Every pair that is not in `REFUSED` is run against its closed form.
"""

from __future__ import annotations

import itertools
import json
import zlib

from tests.scenes.pairs.physical import FRAGMENTS

STEP = 0.05
HOLDS_AT_TIMES = (
    "contact", "friction on one slip", "friction on the disc", "limit", "freewheel",
    "when",
)  # fmt: skip
PAIRS = tuple(
    (a.name, b.name) for a, b in itertools.combinations_with_replacement(FRAGMENTS, 2)
)
WAYS = ("beside", "coupled")
# The words of the refusal, which names both features.
REFUSED = {
    ("until", "until"): r"the key `until` is given twice",
    ("redundant", "elimination"): r"`elimination` cannot be used: constraints are "
    r"redundant",
    **dict.fromkeys(
        ((law, "elimination") for law in HOLDS_AT_TIMES),
        "`elimination` cannot be used: the model has constraints that come and go",
    ),
}


def _quoted(items):
    return "\n".join(f"  {name}: {text}" for name, text in items.items()) or "  {}"


def scene(*fragments, coupled=False, extra=""):
    """Give the model file of fragments.

    Coupled, the first coordinates x1 and x2 of two fragments are definitions,
    (u + w)/sqrt(2) and (u - w)/sqrt(2) of coordinates u and w: the motion of x1 and x2
    stays as it is, but no expression is one fragment's alone.
    """
    coordinates, initial = {}, {}
    forces: dict[str, str] = {}
    constraints: dict[str, str] = {}
    modes: dict[str, str] = {}
    events: dict[str, str] = {}
    sums: tuple[list[str], list[str]] = ([], [])
    untils = [f.until.replace("$", str(k)) for k, f in enumerate(fragments, 1)]
    for k, f in enumerate(fragments, 1):

        def own(text, k=k):
            return text.replace("$", str(k))

        starts = dict(f.more) if coupled else {"x$": f.start, **f.more}
        for name, (value, rate) in starts.items():
            coordinates[own(name)] = "{}"
            initial[own(name)] = value
            initial[f"{own(name)}_dot"] = rate
        forces |= {own(n): json.dumps(own(text)) for n, text in f.forces.items()}
        constraints |= {own(n): own(text) for n, text in f.constraints.items()}
        modes |= {own(n): own(text) for n, text in f.modes.items()}
        events |= {own(n): own(text) for n, text in f.events.items()}
        sums[0].append(own(f.kinetic))
        sums[1].append(own(f.potential))
    definitions = {}
    if coupled:
        (a, a_dot), (b, b_dot) = (f.start for f in fragments)
        coordinates = {"u": "{}", "w": "{}", **coordinates}
        definitions = {"x1": "(u + w)/sqrt(2)", "x2": "(u - w)/sqrt(2)"}
        for name, sign in (("u", "+"), ("w", "-")):
            initial[name] = f"({a} {sign} ({b}))/sqrt(2)"
            initial[f"{name}_dot"] = f"({a_dot} {sign} ({b_dot}))/sqrt(2)"
    until = "".join(f', until: "{u}"' for u in untils if u)
    formulation = "".join(
        {f", formulation: {f.formulation}": 0 for f in fragments if f.formulation}
    )
    duration = 2
    return f"""
coordinates:
{_quoted(coordinates)}
definitions:
{_quoted(definitions)}
energy:
  kinetic: {" + ".join(sums[0])}
  potential: {" + ".join(sums[1])}
forces:
{_quoted(forces)}
constraints:
{_quoted(constraints)}
modes:
{_quoted(modes)}
events:
{_quoted(events)}
initial:
{_quoted(initial)}
simulation: {{duration: {duration}, output_step: {STEP}{until}{formulation}}}
{extra}"""


def motion(*fragments, t):
    """Give the closed forms of all coordinates at times t (rows,)."""
    return {
        name.replace("$", str(k)): x
        for k, f in enumerate(fragments, 1)
        for name, x in f.motion(t).items()
    }


def part_of(name, parts):
    """Tell whether a case is in the quick slice: one of so many, by its name alone."""
    return zlib.crc32(name.encode()) % parts == 0
