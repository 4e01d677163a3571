"""With impacts located, errors fall with the tolerance as without impacts."""

import math

import numpy as np
import pytest

from tests.scenes.contact import scenes
from tests.scenes.contact.motions import play

TOLERANCES = 10.0 ** -np.arange(4, 10)


def ends(text, x, v):
    """Return the errors at the end at each tolerance."""
    errors = []
    for tolerance in TOLERANCES:
        found = play(text, rtol=tolerance, atol=tolerance, method="dop853")
        errors.append(math.hypot(found["x"][-1] - x, found["x_dot"][-1] - v))
    return np.array(errors)


def slope(errors):
    return np.polyfit(np.log(TOLERANCES), np.log(errors), 1)[0]


@pytest.mark.slow
def test_the_order_is_kept():
    w, e, end = 0.5, 0.9, 40.0
    t, v, count = math.pi - math.acos(w), math.sqrt(1 - w * w), 0
    while True:
        v *= e
        again = t + 2 * (math.pi - math.acos(w / math.hypot(w, v)))
        count += 1
        if again > end:
            break
        t = again
    assert count >= 8
    x = -w * math.cos(end - t) + v * math.sin(end - t)
    rate = w * math.sin(end - t) + v * math.cos(end - t)
    stopped = scenes.oscillator("x >= -0.5", e, duration=end, output_step=end)
    free = scenes.oscillator("x >= -5", e, duration=end, output_step=end)
    struck, smooth = ends(stopped, x, rate), ends(free, math.cos(end), -math.sin(end))
    assert slope(smooth) > 0.8
    assert slope(struck) > slope(smooth) - 0.15
    # Each impact adds an error of the size of those of steps, and passes others on.
    assert np.all(struck < 30 * smooth)
