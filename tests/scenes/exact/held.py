"""Bodies held at rest, or balanced: by friction, rows, contacts, springs, symmetry.

The motion is the place of the body, whatever the rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.scenes.contact.motions import contact, scene
from tests.scenes.exact import Exact

END = 3.0


@dataclass
class Parts:
    """Terms added to x and y, which are at rest at 0."""

    laws: dict[str, Any] = field(default_factory=dict)
    forces: dict[str, str] = field(default_factory=dict)
    potential: str = "0"
    # Other coordinates: where they are, and their inertia.
    more: dict[str, float] = field(default_factory=dict)

    def rubs(self, law, bound=1.5):
        """Add dry friction to x; on a floor the weight is 10."""
        if law == "sign":
            own = self.forces.get("x", "0")
            self.forces["x"] = f"{own} - {bound}*sign(x_dot)"
        elif law == "limit":
            self.laws["rest"] = {"relation": "x_dot = 0", "limit": bound}
        else:
            self.more["h"] = 0.0
            self.potential += " + 10*h"
            self.laws["floor"] = contact("h >= 0", 0, friction=bound / 10, slip="x_dot")
        return self

    def exact(self):
        names = ["x", "y", *self.more]
        text = scene(
            " ".join(names), " + ".join(f"{q}_dot^2/2" for q in names), self.potential,
            self.laws, {"x": 0, "y": 0, **self.more}, forces=self.forces, duration=END,
            output_step=END / 100,
        )  # fmt: skip
        return Exact(
            text, lambda t: dict.fromkeys("xy", 0.0 * t), within=1e-12, steps=201,
            error=1e-11,
        )  # fmt: skip


def by(law, x="0", **more):
    return Parts(forces={"x": x}, **more).rubs(law)


PUSHES = {
    "nothing": "0", "a constant": "1", "sine": "sin(3*t)", "what cancels": "1.2 - 1.1",
    "a late step": "if(t > 1, 0.9, 0)", "a pulse": "1.4*exp(-50*(t - 1.5)^2)",
    "a ramp": "0.4*t",
}  # fmt: skip
GRIP = 9.81 * 0.5 * np.cos(0.4).item()
SPRING = "(x - y + 0.3)^2"
FLAT = ["x_dot", "y_dot"]
LEGS = {
    "left": contact("h + 0.3*a >= 0", 0.3, friction=0.5, slip="x_dot"),
    "right": contact("h - 0.4*a >= 0", 0.3),
}
LIMITS = {
    "a": {"relation": "x_dot = 0", "limit": 1.5},
    "b": {"relation": "y_dot = 0", "limit": 1.2},
}
# x between two springs, of which the other ends are as far to both sides of h.
ENDS = " + ".join(f"(hypot(x {sign} 1, h) - 0.5)^2" for sign in "+-")
PARTS = {
    **{
        f"{law} against {name}": by(law, push)
        for law in ("sign", "limit", "contact")
        for name, push in PUSHES.items()
    },
    "two by sign, with a spring": Parts(
        forces={"x": "0.5*sin(5*t) - 1.5*sign(x_dot)", "y": "-1.5*sign(y_dot)"},
        potential=SPRING,
    ),
    "two by limits, with a spring": Parts(
        LIMITS, {"x": "0.5*sin(5*t)"}, potential=SPRING
    ),
    "by sign, with a fixed spring": by(
        "sign", "0.5*sin(5*t)", potential="(x + 0.3)^2"
    ),
    "by sign on an incline": Parts(
        forces={"x": "-9.81*sin(0.4)*(1 + 0.1*sin(t))"}
    ).rubs("sign", GRIP),
    "by friction on a disc": Parts(
        {"floor": contact("h >= 0", 0.0, friction=0.15, slip=FLAT)},
        {"x": "sin(3*t)", "y": "0.5*cos(3*t)"}, "10*h", {"h": 0.0},
    ),
    # h swings, and pulls at x.
    "by sign, beside a swing": by(
        "sign", "h", potential="1.5*h^2", more={"h": 1.0}
    ),
    "by a row": Parts({"hold": "x = 0"}, {"x": "1 + sin(3*t)"}),
    "by a row in force": Parts(
        {"hold": {"relation": "x = 0", "when": "t < 100"}}, {"x": "sin(3*t)"}
    ),
    "by a rope": Parts(
        {"rope": "x + y = 0"}, dict.fromkeys("xy", "1 + sin(2*t)")
    ),
    **{
        f"{name} a rod": Parts(
            {"rod": "x^2 + h^2 = 1"}, potential="10*h", more={"h": h}
        )
        for name, h in (("below", -1.0), ("on", 1.0))
    },
    "on legs": Parts(
        LEGS, {"x": "sin(3*t)"}, "9.81*h", {"a": 0.0, "h": 0.0}
    ),
    "at a wall": Parts({"wall": contact("x >= 0", 0.5)}, {"x": "-1"}),
    "in a valley": Parts(potential="2*x^2"),
    "in a loaded valley": Parts(forces={"x": "1.2"}, potential="2*(x + 0.3)^2"),
    "on a hill": Parts(potential="4*cos(x)"),
    "hanging": Parts(potential="-4*cos(x) - 2*cos(x - y)"),
    "between springs": Parts(potential=f"2*({ENDS})", more={"h": 0.7}),
    "in a valley of two": Parts(potential="(x + y)^2 + (x - y)^2*(1 + x*y)"),
}  # fmt: skip
SCENES = {f"held {name}": parts.exact() for name, parts in PARTS.items()}
