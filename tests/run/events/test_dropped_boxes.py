"""Boxes dropped on two corners, whose impacts accumulate while the other is in flight.

A corner that is set on the floor too early or too late ends elsewhere at another
tolerance: equal ends at both tolerances mean that it was closed at its own gap.
"""

import random
import re
from dataclasses import replace

import numpy as np
import pytest

from lagsim.model.reader import read
from lagsim.run.events import contacts
from lagsim.run.trajectory import Outcome
from tests.support import run

# Beside it an oscillator of 50 kJ, in which an error of the box's energy is rounding.
BOX = """
name: box
parameters: {{m: 2, a: {a}, h: 0.5, g: 9.81, s: {s}, M: 1e5}}
coordinates: {{x: {{}}, y: {{}}, f: {{}}, z: {{}}}}
definitions:
  xl: x - a*cos(f) + h*sin(f)
  yl: y - a*sin(f) - h*cos(f)
  xr: x + a*cos(f) + h*sin(f)
  yr: y + a*sin(f) - h*cos(f)
energy:
  kinetic: m*(x_dot^2 + y_dot^2)/2 + m*(a^2 + h^2)/6*f_dot^2 + M*z_dot^2/2
  potential: m*g*(cos(s)*y - sin(s)*x) + M*z^2/2
constraints:
  l: {{relation: yl >= 0, restitution: {e}, friction: {mu}, slip: xl_dot}}
  r: {{relation: yr >= 0, restitution: {e}, friction: {mu}, slip: xr_dot}}
initial: {{x: 0, y: {y}, f: {f}, x_dot: 0.4, z: {z}}}
simulation: {{duration: 1.2, output_step: 0.02}}
"""
# Impacts multiply errors: 1e-10 of the motion grew to 5.1e-7 in one of 120 such boxes.
ALIKE = 1e-6


def box(k):
    source = random.Random(f"box {k}")
    f, a = source.uniform(0.02, 0.3), source.choice([0.25, 0.3, 0.4])
    lowest = a * np.sin(f) + 0.5 * np.cos(f)
    return BOX.format(
        a=a, f=f, y=lowest + source.uniform(0.05, 0.35), s=source.uniform(0.0, 0.3),
        e=source.uniform(0.18, 0.42), mu=source.uniform(0.0, 0.32), z=k % 2,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    "part", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 24))]
)
def test_boxes_end_alike_at_two_tolerances(part):
    for k in range(5 * part, 5 * part + 5):
        ends = []
        for rtol in ("1e-10", "1e-12"):
            found = run(read(box(k), "box.yaml", options={"rtol": rtol}))
            assert found.trajectory.outcome.complete
            ends.append([found[q][-1] for q in "xyf"])
        assert np.max(np.abs(np.subtract(*ends))) < ALIKE, box(k)


@pytest.mark.slow
@pytest.mark.parametrize("rtol", ["1e-5", "1e-8", "1e-11"])
@pytest.mark.parametrize("M", [1e-3, 1e9])
@pytest.mark.parametrize("mu", [0.05, 0.3])
def test_impacts_that_end_a_series_have_their_friction(mu, M, rtol):
    """A box that slides in one direction loses mu times its normal impulses.

    So x' + mu y' = x'(0) + g (sin s - mu cos s) t, whatever its impacts are.
    """
    for k in range(6):
        text = box(k).replace("M: 1e5", f"M: {M}").replace("x_dot: 0.4", "x_dot: 40")
        text = re.sub(r"friction: [^,]*,", f"friction: {mu},", text)
        found = run(read(text, "box.yaml", options={"rtol": rtol}))
        s = float(re.findall(r"g: 9.81, s: ([^,]*),", text)[0])
        kept = 40 + 9.81 * (np.sin(s) - mu * np.cos(s)) * found["t"]
        assert found.trajectory.event_counts["zeno"]
        off = np.max(np.abs(found["x_dot"] + mu * found["y_dot"] - kept))
        assert off < 1e-10 + 0.4 * float(rtol), text


@pytest.mark.slow
@pytest.mark.parametrize("k", [3, 11])
def test_a_loose_tolerance_is_that_of_gaps_too(k):
    found = run(read(box(k), "box.yaml", options={"rtol": "1e-2"}))
    assert found.trajectory.outcome.complete
    assert np.min([found["yl"], found["yr"]]) > -0.1 * np.ptp(found["y"])


@pytest.mark.parametrize("solved", [True, False])
def test_an_impact_without_an_impulse(monkeypatch, solved):
    """Of rates that are rounding it is none; without a solution it ends the run."""
    known = contacts.impact

    def changed(*args):
        result = known(*args)
        return replace(result, impulses=0.0 * result.impulses, found=solved)

    monkeypatch.setattr(contacts, "impact", changed)
    found = run(read(box(3), "box.yaml")).trajectory
    assert (found.outcome is Outcome.PARADOX) is not solved
    assert "impact" not in found.event_counts


@pytest.mark.parametrize("mass", [1.0, 1e6])
@pytest.mark.parametrize("restitution", [0, 0.5])
@pytest.mark.parametrize("method", ["auto", "rk4"])
def test_a_gap_that_jumps_ends_the_run(method, restitution, mass):
    """A ball that runs into the riser of a step at x = 1, at 0.5 s."""
    found = run(read(f"""
name: riser
parameters: {{m: {mass:g}}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*9.81*y}}
constraints:
  floor: {{relation: y >= 0.2*floor(x), restitution: {restitution}}}
initial: {{x: 0.1, y: 0, x_dot: 1.8}}
simulation: {{duration: 3, output_step: 0.1, method: {method}}}
""", "riser.yaml"))  # fmt: skip
    assert found.trajectory.outcome is Outcome.CONSTRAINT_JUMPS
    assert found.trajectory.end == pytest.approx(0.5, abs=1e-6)
    assert np.max(found["y"]) < 1e-6
