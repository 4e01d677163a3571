"""The alarm for what a method without events leaves of constraints in its steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lagsim.studies.alarms import about_constraints
from tests.studies.judged import codes, evidence
from tests.support import run

HELD = "constraint-not-held"
FALLING = """\
coordinates: {{y: {{}}{names}}}
energy: {{kinetic: {mass}*y_dot^2/2{kinetic}, potential: {mass}*9.81*y}}
constraints: {{floor: {{relation: y >= {floor}, restitution: 0}}}}
initial: {{y: {start}{initial}}}
simulation: {{duration: 1.5, output_step: {every}}}
"""


def falling(unit=1.0, mass=1.0, every=0.01, floor="0", names="", kinetic="", more=""):
    return FALLING.format(
        mass=mass, every=every, floor=floor, start=unit, names=names,
        kinetic=kinetic, initial=more,
    )  # fmt: skip


@pytest.mark.parametrize("step", [1e-2, 1e-3])
@pytest.mark.parametrize("every", [0.01, 1.5])
@pytest.mark.parametrize("mass", [1e-6, 1e6])
def test_what_lands_may_stay_as_deep_as_a_step_goes(step, every, mass):
    found = run(falling(mass=mass, every=every), method="moreau", step=step)
    # It strikes at sqrt(2 g) = 4.43.
    assert -1e-6 > found["y"][-1] > -4.43 * step
    assert codes(found) == []


def test_on_a_floor_that_rises():
    # 1 - 9.81 t^2/2 = 2 t at t = 0.29.
    found = run(falling(floor="2*t", every=0.5), method="moreau", step=0.01)
    assert found["y"][-1] < 3.0
    assert codes(found) == []


@pytest.mark.parametrize(
    # What a contact closes with: the body's speed, and that of the floor.
    ("floor", "speeds", "closing"), [("0", 4.43, 4.43), ("2*t", 0.5, 2.5)],
)  # fmt: skip
def test_what_is_deeper_is_told_whatever_flies_beside_it(floor, speeds, closing):
    fast = falling(
        names=", x: {}", kinetic=" + x_dot^2", more=", x: 0, x_dot: 1e6", floor=floor
    )
    found = run(fast, method="moreau", step=0.02)
    depth = -np.min(found["missed.floor"])
    assert depth > 1e-4
    extents = {"x_dot": (0.0, 1e6), "y_dot": (-speeds, 0.1)}
    trajectory = found.trajectory._replace(extents=extents)
    # Two steps at that speed come as deep, or not quite.
    for part, told in ((0.9, [HELD]), (1.1, [])):
        plan = replace(found.plan, step=part * depth / closing / 2)
        session = found.session._replace(plan=plan)
        other = replace(found, session=session, trajectory=trajectory)
        assert [c.code for c in about_constraints(evidence(other))] == told


# Constraint, its start, and by how much it changes in a step h, from its closed form:
# pendulum, drive, knife edge, speed of a falling point.
EQUALITIES = {
    "x^2 + z^2 = {u}^2": ("z_dot: {u}", 2.0, True),
    "x = 0.1*{u}*sin(2*pi*t)": ("x_dot: 0.2*pi*{u}", 0.4 * np.pi**2, True),
    "x = {u}*if(t < 0.7, 0, t - 0.7)": ("a_dot: 0", 1.0, True),
    "sin(a)*x_dot = cos(a)*z_dot": ("x_dot: 0.8*{u}, a_dot: 1.5", 1.2, False),
    "x_dot^2 + z_dot^2 = {u}^2": ("x_dot: {u}", 2.0, False),
}
HELD_ROW = """\
coordinates: {{x: {{}}, z: {{}}, a: {{}}}}
energy:
  kinetic: {mass}*(x_dot^2 + z_dot^2)/2 + {mass}*({unit})^2*a_dot^2/2
  potential: {mass}*{unit}*z
constraints: {{row: "{row}"}}
initial: {{x: {x}, z: 0, a: 0, {start}}}
simulation: {{duration: 2, output_step: 0.05}}
"""


def held(row, start, unit=1.0, mass=1.0):
    text = {"row": row.format(u=unit), "start": start.format(u=unit)}
    x = unit if row.startswith("x^2") else 0.0
    return HELD_ROW.format(**text, x=x, unit=unit, mass=mass)


@pytest.mark.parametrize("step", [0.01, 1e-3])
@pytest.mark.parametrize(("unit", "mass"), [(1.0, 1.0), (1e-4, 1e3), (1e5, 1e-6)])
@pytest.mark.parametrize("row", EQUALITIES)
def test_equalities_may_be_off_by_what_they_change_in_a_step(row, unit, mass, step):
    start, _, _ = EQUALITIES[row]
    found = run(held(row, start, unit, mass), method="moreau", step=step)
    assert HELD not in codes(found)


@pytest.mark.parametrize("row", EQUALITIES)
def test_what_is_off_by_more_is_told(row):
    start, change, of_places = EQUALITIES[row]
    found = run(held(row, start), method="moreau", step=0.01)
    rows = found.rows.copy()
    # Ten times what a step may leave: the change in it, in places over the step.
    rows[20, found.system.columns.names.index("residual_row")] = (
        10.0 * change * (1e-4 if of_places and "if" not in row else 1e-2)
    )
    cautions = about_constraints(evidence(replace(found, rows=rows)))
    assert [c.code for c in cautions] == [HELD]
