"""One margin dips and comes back while another one ends the same stretch of a step."""

import math

import pytest

from tests.support import run

# From t = 3 on x dips below 0 at 0.00586 and would be back at 0.0341. Nothing bends
# more, so that steps are as long as the time between rows.
TEXT = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: '{0}'}}
constraints: {{{1}}}
initial: {{x: 4.5601, x_dot: -3.02, y: {y}}}
simulation: {{duration: 5, output_step: 1{2}}}
"""
FIRST = 3.02 - math.sqrt(2e-4)
DIPS = 'dips: {relation: "x >= 0", restitution: 1}'
ENDS = 'ends: {relation: "y >= 0", restitution: 0.5}'
# What ends where y is 0, before and after the dip in the order of the file.
OTHERS = {
    "contact": ("y - x", f"{DIPS}, {ENDS}", ""),
    "contact before": ("y - x", f"{ENDS}, {DIPS}", ""),
    "switch": ("max(y, 0) - x", DIPS, ""),
    "until": ("y - x", DIPS, ', until: "y <= 0"'),
}


# y is 0 before the dip; in it; as it ends; after it.
@pytest.mark.parametrize("time", [0.003, 0.02, 0.034, 0.045, 0.06])
@pytest.mark.parametrize("other", OTHERS)
def test_what_dips_is_met_whatever_else_ends(other, time):
    time += 3
    found = run(TEXT.format(*OTHERS[other], y=time**2 / 2))
    assert found.trajectory.outcome.complete
    struck = [e for e in found.trajectory.events if e.constraint == "dips"]
    if other == "until" and time < FIRST:
        assert struck == []
        return
    # It rebounds at the speed that it has, and goes on as if it had met nothing.
    assert [e.kind for e in struck] == ["impact"]
    assert struck[0].time == pytest.approx(FIRST, abs=1e-12)
    speed = math.sqrt(2e-4)
    assert struck[0].rate_after == pytest.approx(speed, abs=1e-12)
    left = found["t"][-1] - FIRST
    assert found["x"][-1] == pytest.approx(speed * left + left**2 / 2, abs=1e-10)
