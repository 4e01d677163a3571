"""Coordinates that constraints move: rows that alias it, impacts, rows that part."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.scenes.contact.motions import contact, scene
from tests.scenes.exact import Exact
from tests.small_scenes import bounced

SCENES: dict[str, Exact] = {}


def on_a_spring(relation, linked, x=0.0, y=0.0, **simulation):
    """x is prescribed, a spring joins x and y, and a heavy z may be linked to both."""
    laws, start = {"a": relation}, simulation.get("start", 0.0)
    initial: dict[str, Any] = {"x": {"guess": x}, "x_dot": {"guess": 0}, "y": y}
    if linked:
        laws["b"] = "z = 3*x + t"
        initial |= {"z": 3 * x + start, "z_dot": {"guess": 0}}
    more = (" z", " + 1e6*z_dot^2/2") if linked else ("", "")
    return scene(
        f"x y{more[0]}", f"(x_dot^2 + y_dot^2)/2{more[1]}", "(y - x)^2/2", laws,
        initial, **simulation,
    )  # fmt: skip


def aliased(start):
    """x = cos(w t), y = P x + C cos(t - start) + D sin(t - start), P = 1/(1 - w^2)."""
    w = 4.0 * np.pi
    P = 1.0 / (1.0 - w * w)
    C, D = 1.0 - P * np.cos(w * start), P * w * np.sin(w * start)

    def motion(t):
        x, s = np.cos(w * t), t - start
        return {"x": x, "y": P * x + C * np.cos(s) + D * np.sin(s)}

    return motion


def struck(t):
    w = 2.0 * np.pi
    return {"x": np.sin(w * t), "y": (np.sin(w * t) - w * np.sin(t)) / (1.0 - w * w)}


def at_once(t):
    """Return x_dot in all rows: 0 at the start, as stated, then 2 pi cos(2 pi t)."""
    rates = 2.0 * np.pi * np.cos(2.0 * np.pi * t)
    rates[0] = 0.0
    return {"x_dot": rates}


for linked in (False, True):
    tail = " and moves another" if linked else ""
    # All rows show x at one place; y knows that it moves.
    for relation, start, step in (
        ("x = cos(4*pi*t)", 0.125, 0.25),
        ("x/2 = cos(4*pi*t)/2", 0.125, 0.5),
        ("x - cos(4*pi*t) = 0", 7.125, 0.25),
        ("x = cos(4*pi*t)", 0.0, 0.5),
    ):
        SCENES[f"aliases {relation} from {start}{tail}"] = Exact(
            on_a_spring(
                relation, linked, 0.0 if start else 1.0, 1.0, start=start,
                duration=5, output_step=step,
            ),
            aliased(start), events={}, within=1e-8,
        )  # fmt: skip
    for relation in (
        "x = max(0, sin(2*pi*t))",
        "x = if(t > 0, sin(2*pi*t), 0)",
        "x = abs(sin(2*pi*t))",
        "x = if(sin(2*pi*t) > 0, sin(2*pi*t), 0)",
    ):
        SCENES[f"strikes at once by {relation}{tail}"] = Exact(
            on_a_spring(relation, linked, duration=0.45, output_step=0.05), struck,
            at_once, events={"impact": [0.0]},
        )  # fmt: skip
# Its speed is that of its motion before the start.
SCENES["goes on as it was"] = Exact(
    on_a_spring("x = max(0, t + 1)", False, 1.0, duration=1, output_step=0.1),
    lambda t: {"x": 1.0 + t, "y": 1.0 + t - np.cos(t) - np.sin(t)}, events={},
)  # fmt: skip

# Two relations agree, and part at 2.91: rows from 3 on are no answer.
PAIRS = {
    "lines": ("x + 3*y = 2", "2*x + 6*y = 4 + {more}"),
    "circles": ("x^2 + y^2 = 1", "2*x^2 + 2*y^2 = 2 + {more}"),
    "speeds": ("x_dot + 3*y_dot = 0", "2*x_dot + 6*y_dot = {more}"),
}


def parting(relations, **simulation):
    laws = dict(zip("ab", relations, strict=True))
    return scene(
        "x y z", "x_dot^2 + y_dot^2 + z_dot^2/2", "0", laws,
        {
            "x": {"guess": 0}, "y": {"guess": 0.5}, "z": 1, "x_dot": {"guess": 0.3},
            "y_dot": {"guess": 0}, "z_dot": 2,
        },
        duration=5, output_step=0.1, **simulation,
    )  # fmt: skip


REDUNDANT = frozenset({"redundant", "multipliers-not-unique"})


def passing(t):
    return {"z": 1.0 + 2.0 * t}


for name, (one, other) in PAIRS.items():
    codes = REDUNDANT if name == "lines" else REDUNDANT | {"undetermined-guess"}
    for more in ("if(t < 2.91, 0, (t - 2.91)^3)", "max(0, t - 2.91)",
                 "1 - cos(max(0, t - 2.91))"):  # fmt: skip
        laws = [one, other.format(more=more)]
        for way, text in {
            "": parting(laws),
            ", the other first": parting(laws[::-1]),
            ", by dop853": parting(laws, method="dop853"),
        }.items():
            SCENES[f"{name} part by {more}{way}"] = Exact(
                text,
                passing,
                fails=("no-answer", 2.9),
                warned=codes,
                # There the cube at 3 is less than a millionth of the places.
                unlike=("shifted", "boosted") if "^3" in more else (),
            )
    laws = [one, other.format(more="0*max(0, t - 2.97)")]
    SCENES[f"{name} agree to the end"] = Exact(parting(laws), passing, warned=codes)

# At x = 1, half a unit of time after the start, the ground is 0.2 higher.
for relation in ("y >= 0.2*floor(x)", "y >= if(x >= 1, 0.2, 0)",
                 "y >= 0.2*heaviside(x - 1)"):  # fmt: skip
    for e, y in ((0.0, 0.0), (0.5, 0.05)):
        SCENES[f"runs into {relation} from {y}"] = Exact(
            scene(
                "x y", "(x_dot^2 + y_dot^2)/2", "g*y", {"s": contact(relation, e)},
                {"x": 0.5, "y": y, "x_dot": 1}, duration=3, output_step=0.05,
            ),
            lambda t, e=e, y=y: {"x": 0.5 + t, "y": bounced(t, e, y)},
            fails=("constraint-jumps", 0.5),
        )  # fmt: skip
