"""The small scenes of other tests with their closed forms, in all changes of form."""

import numpy as np

from tests.scenes.exact import Exact
from tests.small_scenes import (
    ball,
    bounced,
    ellipse,
    held_pendulum,
    on_ellipse,
    oscillator,
    pendulum,
    scene,
    stopped,
    swing,
)

LASTS = "duration: 10, output_step: 0.1"
STOP = "stop: {relation: x >= -0.5, restitution: 0.8}"
BALL = ball("duration: 2, output_step: 0.05")
ORBIT = "duration: 7, output_step: 0.1"
# With g = 9.81 it falls for sqrt(2/g), and the k-th flight lasts 2*0.8^k of that.
FALL = np.sqrt(2.0 / 9.81)
BOUNCES = [FALL * (1.0 + 2.0 * sum(0.8**k for k in range(1, n))) for n in (1, 2, 3)]


def on_a_rod(t):
    a = swing(t, 2.0)
    return {"x": np.sin(a), "y": -np.cos(a)}


SCENES = {
    "an oscillator": Exact(
        oscillator(LASTS, v=0.5),
        lambda t: {"x": np.cos(t) + 0.5 * np.sin(t)},
        events={},
    ),
    "an oscillator with a stop": Exact(
        scene("x: 1", "x^2/2", constraints=STOP, simulation=LASTS),
        lambda t: {"x": stopped(t, 0.8)[0]},
        events={"impact": stopped(np.array([10.0]), 0.8)[1]},
    ),
    "a ball": Exact(
        # Other forms have the numbers of the start: the parameter h has no use there.
        BALL.replace(", h: 1", "").replace("y: h", "y: 1"),
        lambda t: {"y": bounced(t, 0.8)},
        events={"impact": BOUNCES},
    ),
    "an ellipse": Exact(
        ellipse(0.5, ORBIT),
        lambda t: dict(zip("xy", on_ellipse(t, 0.5), strict=True)),
        events={},
    ),
    "a pendulum": Exact(pendulum(2, LASTS), lambda t: {"a": swing(t, 2.0)}, events={}),
    "a pendulum on a rod": Exact(held_pendulum(2, LASTS), on_a_rod, events={}),
}
